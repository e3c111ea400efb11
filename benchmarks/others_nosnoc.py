"""The contestant nosnoc in `others.py`: Filippov systems by finite elements with switch detection, solved by IPOPT.

Written after the examples of nosnoc_py (`simplest_example`, `periodic_stick_slip`): Stewart's form, Radau IIA, and the
simulation loop. The released package (0.2.0) has no model of impacts; its main branch has, by FESD-J, since August 2026
(nosnoc_py#75).
"""

from __future__ import annotations

import contextlib
import io
import math
from functools import partial

import nosnoc
import numpy as np
from casadi import SX, horzcat, vertcat
from others_problems import CASES, Motion

VERSIONS = ("nosnoc", "casadi")


def filippov() -> nosnoc.NosnocModel:
    """Return the relay; time is a state, since its input falls."""
    x, t = SX.sym("x"), SX.sym("t")
    modes = horzcat(vertcat(2.0 - t + 1.0, 1.0), vertcat(2.0 - t - 1.0, 1.0))
    return nosnoc.NosnocModel(x=vertcat(x, t), F=[modes], S=[np.array([[-1], [1]])], c=[x], x0=np.array([-1.5, 0.0]))


def rubbing(acceleration: float, k: float, friction: float, x0: float, v0: float) -> nosnoc.NosnocModel:
    """Return a body of unit mass with dry friction: x'' = a - k x - F sign x'."""
    x, v = SX.sym("x"), SX.sym("v")
    free = acceleration - k * x
    modes = horzcat(vertcat(v, free + friction), vertcat(v, free - friction))
    return nosnoc.NosnocModel(x=vertcat(x, v), F=[modes], S=[np.array([[-1], [1]])], c=[v], x0=np.array([x0, v0]))


SLOPE, NORMAL = 9.81 * math.sin(math.pi / 6.0), 9.81 * math.cos(math.pi / 6.0)

RUNS = {
    "filippov": filippov,
    "coulomb-oscillator": partial(rubbing, 0.0, 100.0, 5.0, 0.53, 0.0),
    "block-on-incline": partial(rubbing, SLOPE, 0.0, 0.7 * NORMAL, 0.0, 2.0),
}

JUMPS = "the released package (0.2.0) has no impacts; its main branch has them by FESD-J (nosnoc_py#75)"
ABSENT = {
    **dict.fromkeys(
        ("bouncing-ball", "bouncing-ball to rest", "impact-oscillator", "newtons-cradle", "pi-billiard"), JUMPS
    ),
    **dict.fromkeys(
        ("system-1", "system-2", "system-3"), "a complementarity system of massless plates, no Filippov system"
    ),
    "diode-bridge": "a complementarity system, no Filippov system",
}


def run(title: str, steps: int, stages: int, tolerance: float) -> Motion:
    """Run the simulation loop, with two finite elements a step."""
    case = CASES[title]
    options = nosnoc.NosnocOpts()
    options.n_s, options.N_finite_elements = stages, 2
    options.comp_tol = options.sigma_N = tolerance
    options.step_equilibration = nosnoc.StepEquilibrationMode.HEURISTIC_MEAN
    options.terminal_time = case.t_end / steps
    with contextlib.redirect_stdout(io.StringIO()):
        model = RUNS[title]()
        loop = nosnoc.NosnocSimLooper(nosnoc.NosnocSolver(options, model), model.x0, steps)
        loop.run()
    found = loop.get_results()
    t, x = np.array(found["t_grid"]).ravel(), np.array(found["X_sim"]).reshape(-1, 2)
    if title == "filippov":
        return Motion(t, x[:, :1], x[:, :1])
    still = np.zeros((len(t), len(case.columns) - 1))
    return Motion(t, np.hstack([x[:, :1], still]), np.hstack([x[:, 1:], still]))


def settings(title: str) -> dict[str, tuple[str, partial[Motion]]]:
    """Return the runs of a problem."""
    return {
        "default": ("Radau IIA, 2 stages, 20 steps", partial(run, title, 20, 2, 1e-8)),
        "tuned": ("Radau IIA, 4 stages, 40 steps, tolerance 1e-10", partial(run, title, 40, 4, 1e-10)),
    }
