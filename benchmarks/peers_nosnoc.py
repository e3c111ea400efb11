"""Examples of nosnoc at 0abef40107, run by ``nosnoc_others.py``, and the same systems here.

The examples are of MATLAB; the Python package nosnoc 0.2.0 has their Filippov systems, and neither impacts nor projected
systems nor time freezing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from peers_base import Example, run_by, version_in

from lcpimpact import (
    Dashpot,
    LinearComplementaritySystem,
    Load,
    Mass,
    Polynomial,
    PrescribedMotion,
    Problem,
    Scheme,
    Slider,
    Spring,
)

SCRIPT = Path(__file__).with_name("nosnoc_others.py")
TWO_STAGES = {"stages": 2, "rtol": None}


def relay(name: str, A: list, b: list, a: list, start: list, c: list) -> Problem:
    """Return x' = A x + a - b λ with λ in Sgn(c x)."""
    states = [f"x{i + 1}" for i in range(len(A))]
    B, C = -np.array(b)[:, None], -np.array([c])
    system = LinearComplementaritySystem(A, B, C, a=a, states=states, lower=[-1.0], upper=[1.0])
    return Problem(name, system, q0=dict(zip(states, start, strict=True)))


def filippov(problem: Problem, h: float, t_end: float, elements: int) -> Example:
    """Return an example that both programs run by finite elements with two stages of Radau IIA."""
    data = {"example": problem.name, "elements": elements}
    return Example(problem, h, t_end, data, method="radau-fesd", options=TWO_STAGES, parts=elements)


def crossing() -> Example:
    """Return the first of switching_cases."""
    return filippov(relay("crossing", [[0.0]], [0.9], [1.1], [-1.0], [1.0]), 0.15, 1.5, 2)


def sliding() -> Example:
    """Return the second."""
    return filippov(relay("sliding", [[0.0]], [1.0], [0.0], [-0.5], [1.0]), 0.15, 1.5, 2)


def leaving() -> Example:
    """Return the fourth; time is an input here."""
    return filippov(relay("leaving", [[0.0]], [1.0], [Polynomial([0.0, 1.0])], [0.0], [1.0]), 0.15, 1.5, 2)


def feedback() -> Example:
    """Return relay_feedback_system, to 2 of its 10 s."""
    ω, ξ, σ = 25.0, 0.05, 1.0
    A = [[-(2 * ξ * ω + 1), 1.0, 0.0], [-(2 * ξ * ω + ω**2), 0.0, 1.0], [-(ω**2), 0.0, 0.0]]
    start = [0.0, -0.001, -0.02]
    problem = relay("relay_feedback_system", A, [1.0, -2.0 * σ, 1.0], [0.0] * 3, start, [1.0, 0.0, 0.0])
    return filippov(problem, 0.025, 2.0, 3)


def blocks() -> Example:
    """Return friction_example_stewart."""
    scheme, before = Scheme(), "ground"
    for name in ("q1", "q2", "q3"):
        scheme.add(Mass(name, m=1.0), Spring(before, name, k=1.0), Dashpot(name, "ground", c=1.0))
        scheme.add(Slider(name, "ground", r0=0.3))
        before = name
    q0, v0 = {"q1": -1.0, "q2": 1.0, "q3": -1.0}, {"q1": -1.0, "q2": 1.0, "q3": 1.0}
    return filippov(Problem("friction_example_stewart", scheme, q0=q0, v0=v0), 12.0 / 85.0, 12.0, 3)


def stick_slip() -> Example:
    """Return periodic_slip_stick_codim1: dry friction of 1 N and u/(1 + |u|), u the rate of sliding on a belt."""
    scheme = Scheme(
        Mass("x1", m=1.0), Spring("x1", "ground", k=1.0), PrescribedMotion("belt", Polynomial([0.0, 0.2])),
        Slider("belt", "x1", r0=1.0),
        Load("x1", f=lambda t, q, v: (v - 0.2) / (1.0 + abs(v - 0.2)),
             jacobian=lambda t, q, v: (0.0, 1.0 / (1.0 + abs(v - 0.2)) ** 2)),
    )  # fmt: skip
    problem = Problem("periodic_slip_stick", scheme, q0={"x1": -0.8}, v0={"x1": -1.0})
    data = {"example": problem.name, "elements": 2}
    fine = {"rtol": 1e-12, "atol": 1e-13}
    return Example(
        problem, 0.4, 40.0, data, "event-driven", {"rtol": 1e-6, "atol": 1e-9}, "event-driven", fine, columns=("x1",)
    )


EXAMPLES: dict[str, Callable[[], Example]] = {
    "crossing": crossing,
    "sliding": sliding,
    "leaving": leaving,
    "relay_feedback_system": feedback,
    "friction_example_stewart": blocks,
    "periodic_slip_stick": stick_slip,
}


def example(name: str) -> Example:
    """Return an example."""
    found = EXAMPLES[name]()
    return replace(found, problem=replace(found.problem, t_end=found.t_end))


def version(python: str) -> str:
    """Return the version of nosnoc, or raise `RuntimeError`."""
    return version_in(python, "nosnoc")


def theirs(example: Example, repeats: int, python: str) -> tuple[np.ndarray, float]:
    """Return the columns of x by nosnoc that are compared, and the median of its seconds of CPU."""
    x, seconds = run_by(python, SCRIPT, example, repeats)
    compared = len(example.columns) or len(example.problem.scheme.assemble().nodes)
    return x[:, :compared], seconds
