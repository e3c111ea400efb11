"""Draw the pictures of docs/guide/design.md. Run it as ``python docs/pictures/design.py``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from lcpimpact import design, fit, load_problem, simulate

IMAGES = Path(__file__).parents[1] / "images"


def main() -> None:
    """Write both."""
    design("kelvin-voigt", m=1.0, v0=2.0, g=9.81, e=0.5, contact_time=0.01).plot(IMAGES / "design.svg")
    truth = simulate(load_problem("system-1"), "exact", dt=0.025, t_end=3.0)
    noise = np.random.default_rng(0).normal(0.0, 60.0, len(truth.t))
    data = pd.DataFrame({"t": truth.t, "R": truth["R"] + noise})
    fit(load_problem("system-1"), {"k_o": 3500.0, "c_o": 300.0}, data).plot(IMAGES / "fit.svg")


if __name__ == "__main__":
    main()
