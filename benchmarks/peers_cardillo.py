"""Examples of cardillo at 451d581dff, run by ``cardillo_others.py``, and the same systems here.

cardillo is no package of a registry: a copy of its repository is installed by ``pip install .``, in a Python of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import peers_siconos
from peers_base import Example, run_by, version_in

from lcpimpact import (
    Dashpot,
    FrictionContact,
    Lagrangian,
    Load,
    Mass,
    Polynomial,
    PrescribedMotion,
    Problem,
    Scheme,
    Slider,
    Spring,
)

SCRIPT = Path(__file__).with_name("cardillo_others.py")
FINE = {"rtol": 1e-12, "atol": 1e-13}


def two_masses() -> Example:
    """Return two_mass_oscillator: places from the middle, and the spring as long as at rest."""
    scheme = Scheme(Mass("x1", m=1.0), Mass("x2", m=1.0), Spring("x1", "x2", k=100.0), Dashpot("x1", "x2", c=2.0))
    problem = Problem("two_mass_oscillator", scheme, q0={"x1": -0.45, "x2": 0.45}, t_end=3.0)
    return Example(problem, 1e-2, 3.0, method="dopri5", options={"rtol": 1e-8, "atol": 1e-10})


def ball() -> Example:
    """Return bouncing_ball, whose motion stays in a plane; the angle is that about y."""
    R, g, density = 0.05, 10.0, 1.0
    m = density * 4.0 / 3.0 * np.pi * R**3
    system = Lagrangian(
        "x z φ", M=lambda q: np.diag([m, m, 0.4 * m * R**2]), V=lambda q: m * g * q[1],
        contacts=[FrictionContact(
            "floor", gap=lambda t, q: q[1] - R, slip=lambda t, q, v: v[0] - R * v[2], mu=0.5, e=0.75
        )],
    )  # fmt: skip
    problem = Problem("bouncing_ball", system, q0={"x": -0.75, "z": 8 * R}, v0={"x": 1.0, "φ": -25.0}, t_end=3.0)
    return Example(problem, 2e-3, 3.0, method="moreau-midpoint", judge="event-driven", judge_options=FINE)


def belt() -> Example:
    """Return friction_belt: Coulomb's law with 5 N, and a smooth force that falls with the speed of sliding."""
    scheme = Scheme(
        Mass("x", m=1.0), Spring("x", "ground", k=1.0), Slider("belt", "x", r0=5.0),
        PrescribedMotion("belt", Polynomial([0.0, 3.0])),
        Load("x", f=lambda t, q, v: 4.0 / np.pi * np.arctan(3.0 * (v - 3.0))),
    )  # fmt: skip
    problem = Problem("friction_belt", scheme, q0={"x": 0.2}, v0={"x": 0.2}, t_end=20.0)
    return Example(problem, 1e-2, 20.0, judge="event-driven", judge_options=FINE, columns=("x",))


def double_pendulum() -> Example:
    """Return double_pendulum: the angle of the first link, and that of the second in its joint."""
    g, φ, ψ = 10.0, np.pi / 4.0, np.pi / 3.0
    (m1, c1, J1), (m2, c2, J2) = (
        (0.26703, (2.1727e-06, 3.6012e-02), 4.0827e-04), (0.33238, (1.9371e-10, 1.0088e-01), 1.1753e-03)
    )  # fmt: skip
    length = 0.1

    def turned(angle: float, y: float, z: float) -> tuple[float, float]:
        """Return a vector of a link whose angle is given, upside down as there."""
        return -(y * np.cos(angle) - z * np.sin(angle)), -(y * np.sin(angle) + z * np.cos(angle))

    def absolute(q: np.ndarray) -> tuple[float, float]:
        return q[0], q[1] + q[0] - φ

    def M(q: np.ndarray) -> list:
        a, b = absolute(q)
        joint, centre = turned(a, 0.0, length), turned(b, *c2)
        coupled = m2 * (joint[0] * centre[0] + joint[1] * centre[1])
        first = J1 + m1 * (c1[0] ** 2 + c1[1] ** 2) + m2 * length**2
        second = J2 + m2 * (c2[0] ** 2 + c2[1] ** 2)
        return [[first + 2.0 * coupled + second, coupled + second], [coupled + second, second + 0.0 * q[0]]]

    def V(q: np.ndarray) -> float:
        a, b = absolute(q)
        return g * (m1 * turned(a, *c1)[1] + m2 * (turned(a, 0.0, length)[1] + turned(b, *c2)[1]))

    problem = Problem("double_pendulum", Lagrangian("φ1 φ2", M=M, V=V), q0={"φ1": φ, "φ2": ψ}, t_end=2.0)
    loose = {"rtol": 1e-3, "atol": 1e-6}
    return Example(problem, 1e-2, 2.0, method="event-driven", options=loose, judge="event-driven", judge_options=FINE)


def woodpecker() -> Example:
    """Return woodpecker_toy, with the sleeve on the pole at the start, not 0.9 µm inside of it."""
    return replace(peers_siconos.example("WoodPecker"), h=1e-4, t_end=0.15, method="moreau-midpoint")


EXAMPLES: dict[str, Callable[[], Example]] = {
    "two_mass_oscillator": two_masses,
    "double_pendulum": double_pendulum,
    "friction_belt": belt,
    "bouncing_ball": ball,
    "woodpecker_toy": woodpecker,
}
SHIFT = {"two_mass_oscillator": np.array([-1.0, 1.0])}
"""Where the places here have another origin."""


def example(name: str) -> Example:
    """Return an example."""
    found = EXAMPLES[name]()
    return replace(found, data={"example": name})


def version(python: str) -> str:
    """Return the version of cardillo, or raise `RuntimeError`."""
    return version_in(python, "cardillo")


def theirs(example: Example, repeats: int, python: str) -> tuple[np.ndarray, float]:
    """Return q by cardillo, and the median of its seconds of CPU."""
    q, seconds = run_by(python, SCRIPT, example, repeats)
    return q - SHIFT.get(example.data["example"], 0.0), seconds
