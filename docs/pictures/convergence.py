"""Draw docs/images/convergence.svg and work-precision.svg: run it as ``python docs/pictures/convergence.py``."""

from __future__ import annotations

from pathlib import Path

from lcpimpact import convergence, load_problem, work_precision

IMAGES = Path(__file__).parents[1] / "images"


def main() -> None:
    """Draw both pictures."""
    methods = ["moreau-jean", "heun", "rk4", "radau-fesd", "rk4-paper"]
    errors = convergence(load_problem("system-1"), methods, [3.0 / (40 * 1.6**i) for i in range(8)], norms=["sup_q"])
    errors.plot(IMAGES / "convergence.svg")

    costs = work_precision(
        load_problem("impact-oscillator"),
        ["moreau-jean", "generalized-alpha", "dopri5", "radau-fesd", "event-driven"],
        [10.0 / (50 * 3**i) for i in range(6)],
        penalties=[("kelvin-voigt", 1e6)],
        norms=["l1_v"],
        t_end=10.0,
        repeats=1,
    )
    costs.plot(IMAGES / "work-precision.svg", cost="evaluations")


if __name__ == "__main__":
    main()
