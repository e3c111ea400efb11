"""Make the moving picture at the head of the README: ``python docs/pictures/moving.py``."""

from pathlib import Path

from lcpimpact import load_problem, simulate

IMAGES = Path(__file__).parents[1] / "images"

if __name__ == "__main__":
    run = simulate(load_problem("bouncing-ball"), "exact", dt=1e-2, t_end=3.0, progress=False)
    run.animate(IMAGES / "bouncing-ball.gif", seconds=4.0, fps=12)
