"""Make the pictures of comparing.md: ``python docs/pictures/comparing.py``."""

from pathlib import Path

from lcpimpact import compare, cross_validate, energy_ledger, load_problem, simulate

IMAGES = Path(__file__).parents[1] / "images"

if __name__ == "__main__":
    system = load_problem("system-3")
    compare(system, ["moreau-jean", "rk4-paper"], dt=1e-2).plot(IMAGES / "comparing.svg")
    ball = load_problem("bouncing-ball", e=0.8)
    views = compare(ball, ["moreau-jean", "exact"], dt=1e-3, t_end=1.5, penalties=[("kelvin-voigt", 1e4)])
    views.plot(IMAGES / "three-views.svg")
    run = simulate(system, "exact", dt=1e-2, t_end=3.0, progress=False)
    energy_ledger(run).plot(IMAGES / "ledger.svg")
    cross_validate(system).plot(IMAGES / "cross-validation.svg")
