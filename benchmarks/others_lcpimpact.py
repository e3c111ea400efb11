"""The contestant lcpimpact in `others.py`: `simulate` as it is, with a smaller step, and by its most accurate methods."""

from __future__ import annotations

from functools import partial

import numpy as np
from others_problems import CASES, Case, Motion

import lcpimpact as li

VERSIONS = ("lcpimpact", "numpy", "llvmlite")


def run(case: Case, method: str, dt: float) -> Motion:
    """Run a registered problem by one method; dt is the step, or the spacing of the samples of event-driven methods."""
    found = li.simulate(li.load_problem(case.name), method, dt=dt, t_end=case.t_end, progress=False)
    q = np.column_stack([found[name] for name in case.columns])
    v = np.column_stack([found[f"v_{name}"] for name in case.columns])
    return Motion(found.t, q, v, found.reaction[:, 0] if found.reaction.shape[1] else None)


STEPS = {
    "bouncing-ball": 5e-3, "bouncing-ball to rest": 5e-3, "system-1": 1e-3, "system-2": 1e-3, "system-3": 1e-3,
    "impact-oscillator": 5e-3, "newtons-cradle": 5e-4, "pi-billiard": 5e-3, "coulomb-oscillator": 1e-2,
    "block-on-incline": 5e-3, "diode-bridge": 1e-6, "filippov": 1e-3,
}  # fmt: skip
"""Steps in s: those of Siconos' tutorials where it has the problem, and of their order elsewhere."""

FINER = {"bouncing-ball": 50, "bouncing-ball to rest": 50, "newtons-cradle": 50, "pi-billiard": 50, "diode-bridge": 5}
"""By what the steps of the tuned runs are finer; 10 elsewhere."""


def settings(title: str) -> dict[str, tuple[str, partial[Motion]]]:
    """Return the runs of a problem: default, smaller steps, and the most accurate method that is not its truth."""
    case, h = CASES[title], STEPS[title]
    best = "exact" if case.known else "radau-fesd"
    fine = h / FINER.get(title, 10)
    return {
        "default": (f"moreau-jean, h = {h:g} s", partial(run, case, "moreau-jean", h)),
        "tuned": (f"moreau-jean, h = {fine:g} s", partial(run, case, "moreau-jean", fine)),
        "accurate": (f"{best}, h = {h:g} s", partial(run, case, best, h)),
    }
