"""Draw docs/images/impact-laws.svg, print tables of docs/guide/impact-laws.md: ``python docs/pictures/impact_laws.py``."""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp

import lcpimpact as li

IMAGES = Path(__file__).parents[1] / "images"

LAWS: dict[str, str | li.LZB] = {
    "newton": "newton",
    "sequential": "sequential",
    "poisson": "poisson",
    "lzb, η = 1": li.LZB(exponent=1.0),
    "lzb, η = 3/2": li.LZB(exponent=1.5),
}
CASES = {
    "three balls": ([1.0, 0.0, 0.0], [1.0, 1.0, 1.0]),
    "five balls": ([1.0, 0.0, 0.0, 0.0, 0.0], [1.0] * 5),
    "two strike three": ([1.0, 1.0, 0.0, 0.0, 0.0], [1.0] * 5),
    "masses 1, 2, 4": ([1.0, 0.0, 0.0], [1.0, 2.0, 4.0]),
}


def by_law(law: str | li.LZB, v0: list[float], masses: list[float], e: float) -> np.ndarray:
    """Return the velocities of a row of balls that touch after the impact."""
    names = [f"x{i}" for i in range(1, len(masses) + 1)]
    bumpers = [li.Bumper(a, b, e=e, name=f"R{i}") for i, (a, b) in enumerate(pairwise(names), start=1)]
    scheme = li.Scheme(*map(li.Mass, names, masses), *bumpers, impact_law=law)
    row = li.Problem("row", scheme, v0=dict(zip(names, v0, strict=True)))
    return li.simulate(row, "exact", dt=0.005, t_end=0.01, error=False).v[-1]


def by_springs(exponent: float, v0: list[float], masses: list[float]) -> np.ndarray:
    """Return the velocities after stiff springs k δ^η between the balls: k is no matter."""
    m, n = np.array(masses), len(masses)

    def slope(_: float, y: np.ndarray) -> np.ndarray:
        force = np.maximum(y[: n - 1] - y[1:n], 0.0) ** exponent
        return np.concatenate([y[n:], (np.append(0.0, force) - np.append(force, 0.0)) / m])

    return solve_ivp(slope, (0.0, 300.0), [0.0] * n + v0, method="DOP853", rtol=1e-12, atol=1e-14).y[n:, -1]


@li.style()
def main() -> None:
    """Draw the picture and print the tables."""
    for name, (v0, masses) in CASES.items():
        sys.stdout.write(f"\n{name}, e = 1\n")
        rows = {law: by_law(each, v0, masses, 1.0) for law, each in LAWS.items()}
        rows |= {f"springs, η = {η:g}": by_springs(η, v0, masses) for η in (1.0, 1.5)}
        for law, v in rows.items():
            sys.stdout.write(f"| {law} | {' | '.join(f'{each:.4f}' for each in v + 0.0)} |\n")
    figure = Figure(figsize=(9.6, 3.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    e = np.linspace(0.0, 1.0, 21)
    v0, masses = CASES["three balls"]
    for law, each in LAWS.items():
        v = np.array([by_law(each, v0, masses, value) for value in e])
        left.plot(e, v[:, 2], label=law)
        right.plot(e, (v**2).sum(axis=1))
    left.set(xlabel="$e$", ylabel="$v_3^+/v_1^-$")
    right.set(xlabel="$e$", ylabel="$T^+/T^-$", ylim=(0.3, 1.02))
    left.legend()
    figure.savefig(IMAGES / "impact-laws.svg")


if __name__ == "__main__":
    main()
