"""Draw docs/images/gradients.svg: the place of a ball over the height of its fall by runs, and errors of its derivative.

python docs/pictures/gradients.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lcpimpact import Drawing, convergence, load_problem, simulate, style

PICTURE = Path(__file__).parents[1] / "images" / "gradients.svg"
STEPS = 37
SHOWN = {"moreau-jean": "C0", "generalized-alpha": "C1", "schatzman-paoli": "C2"}


def place(H: float, method: str) -> float:
    """Return where the ball is at 1 s."""
    run = simulate(load_problem("bouncing-ball", e=0.8, H=H), method, dt=1 / STEPS, t_end=1.0, error=False, throw=False)
    return float(run["x"][-1])


@style()
def draw() -> Drawing:
    """Return the picture: x(1) over H, and the error of its derivative over the step."""
    figure = Drawing(figsize=(7.2, 3.3), layout="constrained")
    near, far = figure.subplots(1, 2)
    H = np.linspace(0.9, 1.1, 401)
    near.plot(H, [place(each, "exact") for each in H], color="lightsteelblue", linewidth=4.0, label="exact")
    for method, colour in SHOWN.items():
        x = np.array([place(each, method) for each in H])
        jumps = np.abs(np.diff(x)) > 0.008
        near.plot(H, _cut(x, jumps), color=colour)
    near.set_xlabel("$H$ [m]")
    near.set_ylabel(f"$x(1)$ [m], {STEPS} steps")
    for gradient, line in ((("x@1", "H"), "-"), (("x@1", "e"), "--")):
        found = convergence(
            load_problem("bouncing-ball", e=0.8), list(SHOWN), [0.03 / 1.6**i for i in range(9)], t_end=1.0,
            gradient=gradient, progress=False,
        )  # fmt: skip
        for method, runs in found.table.groupby("method", sort=False):
            far.loglog(runs["dt"], runs["gradient"] / abs(found.gradient.truth), line, color=SHOWN[method], marker="o",
                       markersize=3.5, label=f"{method}, by ${gradient[1]}$")  # fmt: skip
    far.set_xlabel("$h$ [s]")
    far.set_ylabel("relative error of the derivative")
    figure.legend(*far.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _cut(x: np.ndarray, jumps: np.ndarray) -> np.ndarray:
    """Return the values with a gap in the line before each jump."""
    return np.where(np.append(jumps, False), np.nan, x)


if __name__ == "__main__":
    draw().save(PICTURE)
