"""Examples of nosnoc in nosnoc, for `peers_nosnoc.py`: it needs a Python in which nosnoc is installed.

    python nosnoc_others.py '{"example": "crossing", "h": 0.15, "t_end": 1.5, "elements": 2, "repeats": 1}'

Written after the examples: Stewart's form, Radau IIA with two stages, the simulation loop. Its last line is JSON: x at the
ends of its steps, and the median of the CPU times of the repeats, from the building of the model on.
"""

import contextlib
import io
import json
import statistics
import sys
import time

import nosnoc
import numpy as np
from casadi import SX, horzcat, vertcat

ENDS = np.array([[-1], [1]])
"""The signs of the switching function in the two regions."""


def line(below, above, start):
    """Return x' = below or above, by the sign of x."""
    x = SX.sym("x")
    return nosnoc.NosnocModel(x=x, F=[horzcat(SX(below), SX(above))], S=[ENDS], c=[x], x0=np.array([start]))


def leaving():
    """Return x' = t + 1 or t - 1; time is a state."""
    x, t = SX.sym("x"), SX.sym("t")
    modes = horzcat(vertcat(1.0 + t, 1.0), vertcat(-1.0 + t, 1.0))
    return nosnoc.NosnocModel(x=vertcat(x, t), F=[modes], S=[ENDS], c=[x], x0=np.zeros(2))


def relay():
    """Return relay_feedback_system."""
    ω, ξ, σ = 25.0, 0.05, 1.0
    x = SX.sym("x", 3)
    A = np.array([[-(2 * ξ * ω + 1), 1, 0], [-(2 * ξ * ω + ω**2), 0, 1], [-(ω**2), 0, 0]])
    b = np.array([[1.0], [-2.0 * σ], [1.0]])
    modes = horzcat(A @ x + b, A @ x - b)
    return nosnoc.NosnocModel(x=x, F=[modes], S=[ENDS], c=[x[0]], x0=np.array([0.0, -0.001, -0.02]))


def blocks():
    """Return friction_example_stewart: three masses in a row with friction on the ground."""
    q, v = SX.sym("q", 3), SX.sym("v", 3)
    pull = vertcat(-q[0] + (q[1] - q[0]), (q[0] - q[1]) + (q[2] - q[1]), q[1] - q[2]) - v
    modes = []
    for i in range(3):
        base = vertcat(v, pull) if i == 0 else SX.zeros(6)
        push = SX.zeros(6)
        push[3 + i] = 0.3
        modes.append(horzcat(base + push, base - push))
    start = np.array([-1.0, 1.0, -1.0, -1.0, 1.0, 1.0])
    return nosnoc.NosnocModel(x=vertcat(q, v), F=modes, S=[ENDS] * 3, c=[v[i] for i in range(3)], x0=start)


def stick_slip():
    """Return periodic_slip_stick_codim1."""
    x = SX.sym("x", 2)
    modes = horzcat(vertcat(x[1], -x[0] + 1.0 / (1.2 - x[1])), vertcat(x[1], -x[0] - 1.0 / (0.8 + x[1])))
    return nosnoc.NosnocModel(x=x, F=[modes], S=[ENDS], c=[x[1] - 0.2], x0=np.array([-0.8, -1.0]))


EXAMPLES = {
    "crossing": lambda: line([2.0], [0.2], -1.0),
    "sliding": lambda: line([1.0], [-1.0], -0.5),
    "leaving": leaving,
    "relay_feedback_system": relay,
    "friction_example_stewart": blocks,
    "periodic_slip_stick": stick_slip,
}


def run(example, h, t_end, elements):
    """Return x at the ends of the steps."""
    options = nosnoc.NosnocOpts()
    options.n_s, options.N_finite_elements = 2, elements
    options.comp_tol = options.sigma_N = 1e-9
    options.step_equilibration = nosnoc.StepEquilibrationMode.HEURISTIC_MEAN
    options.terminal_time = h
    model = EXAMPLES[example]()
    loop = nosnoc.NosnocSimLooper(nosnoc.NosnocSolver(options, model), model.x0, round(t_end / h))
    loop.run()
    found = loop.get_results()
    t, x = np.array(found["t_grid"]).ravel(), np.array(found["X_sim"]).reshape(-1, len(model.x0))
    wanted = h * np.arange(round(t_end / h) + 1)
    return x[np.abs(t[:, None] - wanted).argmin(axis=0)]


def main(repeats, **asked):
    """Run it as often as asked, and print what it found."""
    seconds = []
    for _ in range(repeats):
        began = time.process_time()
        with contextlib.redirect_stdout(io.StringIO()):
            x = run(**asked)
        seconds.append(time.process_time() - began)
    print()
    print(json.dumps({"q": x.tolist(), "seconds": statistics.median(seconds)}))


if __name__ == "__main__":
    main(**json.loads(sys.stdin.read()))
