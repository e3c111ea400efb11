"""Engines of rigid bodies: verification of Newton, a test of Exudyn, and a benchmark of SimBenchmark."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.optimize import brentq

from lcpimpact.problems import load_problem
from lcpimpact.problems.base import Problem
from lcpimpact.reading import at, instant
from lcpimpact.scheme.elements.base import GROUND
from lcpimpact.scheme.elements.kelvin_voigt_stop import KelvinVoigtStop
from lcpimpact.scheme.elements.load import Load
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.elements.slider import Slider
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.schemefile import Run
from lcpimpact.trajectory import Trajectory
from lcpimpact.validation.case import NotFound, Published, PublishedCase, Suite

NEWTON_TESTS = "Newton, github.com/newton-physics/newton, newton/tests/{} at 41a5392c13"
EXUDYN = "Exudyn, github.com/jgerstmayr/EXUDYN, main/pythonDev/TestModels/contactCoordinateTest.py at e44aca1b4f"
SIMBENCHMARK = (
    "SimBenchmark, github.com/leggedrobotics/SimBenchmark, benchmark/include/RollingBenchmark.hpp at 3fd1764635"
)

# ---- Newton --------------------------------------------------------------------------------------------------------


def bounce(e: float) -> Problem:
    """Return the ball that falls 1 m with g = 10 m/s²."""
    return load_problem("bouncing-ball", m=1.0, g=10.0, H=1.0, e=e)


def rebound(run: Trajectory) -> float:
    """Return the height half way between the first two impacts in m."""
    return 1.0 - at(run, "x", 0.5 * (instant(run, "impact") + instant(run, "impact", 2)))


def restitution_case(e: float) -> PublishedCase:
    """Return the rebound of one coefficient."""
    height = Published("rebound in m", e**2, rebound, 0.01, truth=e**2)
    runs = (Run("exact", dt=0.01, t_end=1.3), Run("moreau-jean", dt=1e-3, t_end=1.3))
    source = NEWTON_TESTS.format("test_physics_verification.py")
    return PublishedCase(f"restitution, e = {e}", "ball on a floor", source, partial(bounce, e), runs, (height,))


def thrown() -> Problem:
    """Return a body that is thrown from (0, 10) m by (5, 10) m/s; y is downwards here."""
    scheme = Scheme(Mass("x", m=1.0), Mass("y", m=1.0), Load("y", 10.0))
    return Problem("projectile", scheme, q0={"y": -10.0}, v0={"x": 5.0, "y": -10.0}, t_end=0.1)


PROJECTILE = PublishedCase(
    "projectile",
    "parabola of flight",
    NEWTON_TESTS.format("test_physics_verification.py"),
    thrown,
    (Run("exact", dt=0.01), Run("moreau-jean", dt=1e-3)),
    (
        Published("x(0.1 s) in m", 0.5, "x@0.1", atol=1e-3, truth=0.5),
        Published("height at 0.1 s in m", 10.95, lambda run: -at(run, "y", 0.1), atol=1e-3, truth=10.95),
    ),
)

COEFFICIENTS = (0.1, 0.3, 0.5, 0.7, 1.0)
ANGLES = (3.0, 10.0, 20.0, 30.0, 40.0)


def slopes() -> Problem:
    """Return a block of 1 kg on each of 25 slopes."""
    scheme = Scheme()
    for i, mu in enumerate(COEFFICIENTS):
        for j, angle in enumerate(map(math.radians, ANGLES)):
            node = f"x{i}{j}"
            scheme.add(Mass(node, m=1.0), Load(node, 9.81 * math.sin(angle)))
            scheme.add(Slider(node, GROUND, r0=mu * 9.81 * math.cos(angle)))
    return Problem("slopes", scheme, t_end=0.75)


def misjudged(run: Trajectory) -> float:
    """Return how many blocks do the wrong thing from 0.5 s to 0.75 s: 2 cm on a flat one, less on a steep."""
    moved = run.sample([0.5, 0.75]).q
    slides = (moved[1] - moved[0] >= 0.02).reshape(len(COEFFICIENTS), len(ANGLES))
    steep = np.subtract.outer(-np.degrees(np.arctan(COEFFICIENTS)), -np.array(ANGLES)) > 0.0
    return float((slides != steep).sum())


SLOPES = PublishedCase(
    "friction threshold",
    "blocks on 25 slopes",
    NEWTON_TESTS.format("test_rigid_friction_ramp.py"),
    slopes,
    (Run("exact", dt=0.05), Run("moreau-jean", dt=1.0 / 1800.0)),
    (Published("blocks that stick or slide against the angle of friction", 0.0, misjudged, truth=0.0),),
)

STOPPING = (0.2, 0.4, 0.7)


def sliding_blocks() -> Problem:
    """Return blocks of 1 kg that slide on a floor, from 2 m/s."""
    scheme = Scheme()
    for i, mu in enumerate(STOPPING):
        scheme.add(Mass(f"x{i}", m=1.0), Slider(f"x{i}", GROUND, r0=mu * 9.81))
    return Problem("stopping distance", scheme, v0={f"x{i}": 2.0 for i in range(3)}, t_end=1.1)


DISTANCES = PublishedCase(
    "stopping distance",
    "blocks that slide on a floor",
    NEWTON_TESTS.format("test_rigid_friction_ramp.py"),
    sliding_blocks,
    (Run("exact", dt=0.05), Run("moreau-jean", dt=5e-4)),
    tuple(
        Published(f"distance in m, μ = {mu}", 4.0 / (2.0 * mu * 9.81), f"x{i}.max", 0.01, truth=2.0 / (mu * 9.81))
        for i, mu in enumerate(STOPPING)
    ),
)

# ---- Exudyn --------------------------------------------------------------------------------------------------------

M, K, D, G, DROP, END = 0.25, 2e6, 200.0, 9.81, 0.05, 0.25
"""Mass in kg, stiffness in N/m, damping in N s/m, gravity in m/s², height of fall in m and end in s."""


def elastic_contact(*loads: Load | KelvinVoigtStop) -> Problem:
    """Return the mass that falls 0.05 m on its contact."""
    return Problem("contact", Scheme(Mass("x", m=M), Load("x", M * G), *loads), t_end=END)


def pulling(t: float, x: float, v: float) -> float:
    """Return the force of the contact by the law of its source in N: linear while it is closed."""
    return -K * (x - DROP) - D * v if x.real > DROP else 0.0 * x


def by_flights(*, pulls: bool) -> float:
    """Return the height of the mass at the end in m, by parabolas and damped oscillations.

    The contact ends where its penetration is zero, or if it cannot pull where its force is.
    """
    δ, v, t = -DROP, 0.0, 0.0
    while True:
        speed = math.sqrt(v * v - 2.0 * G * δ)  # down to δ = 0
        flight = (speed - v) / G
        if t + flight > END:
            left = END - t
            return 0.05 - δ - v * left - 0.5 * G * left**2
        t += flight
        damped, sag = 0.5 * D / M, M * G / K
        ω = math.sqrt(K / M - damped**2)

        def penetration(s: float, u: float = speed, ω: float = ω, damped: float = damped, sag: float = sag) -> float:
            turn = math.cos(ω * s) * -sag + math.sin(ω * s) * (u - damped * sag) / ω
            return sag + math.exp(-damped * s) * turn

        def rate(s: float, u: float = speed, ω: float = ω, damped: float = damped, sag: float = sag) -> float:
            across = (u - damped * sag) / ω
            turned = (across * ω + damped * sag) * math.cos(ω * s) + (sag * ω - damped * across) * math.sin(ω * s)
            return math.exp(-damped * s) * turned

        ends: Callable[[float], float] = penetration if pulls else lambda s: K * penetration(s) + D * rate(s)
        contact = float(brentq(ends, 0.3 * math.pi / ω, 1.3 * math.pi / ω, xtol=1e-16, rtol=1e-14))
        δ, v, t = penetration(contact), rate(contact), t + contact


TOO_COARSE = (
    "The contact lasts π sqrt(m/k) = 1.1 ms, and the script integrates it by the trapezoidal rule in steps of 0.2 ms, as it "
    "says itself with a result that changes with the strategy. The law of its source is linear between events: a parabola "
    "and a damped oscillation by turns, solved for their ends."
)
PULLS = "The force k g + d g' of its source pulls before it opens; a contact that only pushes opens where the force is zero."

STORED = 0.055313199503736685

CONTACTS = tuple(
    PublishedCase(
        f"contactCoordinateTest, {name}",
        "mass on an elastic contact with damping",
        EXUDYN,
        partial(elastic_contact, element),
        (Run("event-driven", dt=0.01),),
        (
            Published(
                "height at 0.25 s in m",
                STORED,
                lambda run: 0.1 - at(run, "x", END),
                atol=1e-12,
                truth=by_flights(pulls=pulls),
                derivation=f"{TOO_COARSE} {PULLS}" if not pulls else TOO_COARSE,
            ),
        ),
    )
    for name, element, pulls in (
        ("its law", Load("x", pulling), True),
        ("pushing only", KelvinVoigtStop("x", GROUND, k=K, c=D, gap=DROP), False),
    )
)

# ---- SimBenchmark --------------------------------------------------------------------------------------------------


def rolling() -> Problem:
    """Return a box of 10 kg under 150 N on a floor, with 25 balls of 1 kg that roll on it."""
    radius = 0.1  # of which the motion is free
    scheme = Scheme(Mass("box", m=10.0), Load("box", 150.0), Slider("box", GROUND, r0=0.4 * 35.0 * 9.81))
    for i in range(1, 26):
        ball, turn = f"ball{i}", f"turn{i}"
        scheme.add(Mass(ball, m=1.0), Mass(turn, m=0.4 * radius**2))
        scheme.add(Slider("box", {ball: 1.0, turn: radius}, r0=0.8 * 9.81))
    return Problem("rolling", scheme, t_end=4.0)


ON_THE_FLOOR = 0.4 * 35.0 * 9.81
ON_A_BALL = (150.0 - ON_THE_FLOOR) / 10.0 / (3.5 + 25.0 / 10.0)
BOX = (150.0 - ON_THE_FLOOR - 25.0 * ON_A_BALL) / 10.0

ROLLING = PublishedCase(
    "rolling",
    "balls that roll on a box",
    SIMBENCHMARK,
    rolling,
    (Run("exact", dt=0.1), Run("moreau-jean", dt=1e-2)),
    (
        Published("speed of the box at 4 s in m/s", 4.0 * BOX, "v_box@4.0", 1e-9, truth=4.0 * BOX),
        Published("speed of a ball at 4 s in m/s", 4.0 * ON_A_BALL, "v_ball1@4.0", 1e-9, truth=4.0 * BOX / 3.5),
    ),
)

SUITE = Suite(
    "Engines: Newton, Exudyn, SimBenchmark",
    (restitution_case(0.5), restitution_case(0.8), PROJECTILE, SLOPES, DISTANCES, *CONTACTS, ROLLING),
    (
        NotFound(
            "restitution of MuJoCo, joints, four-bar",
            "other tests of Newton",
            NEWTON_TESTS.format("test_physics_verification.py"),
            "they are about that engine's parameters, or about mechanisms in space",
        ),
        NotFound(
            "rolling",
            "errors of the engines",
            SIMBENCHMARK,
            "it publishes errors of other programs and sets no tolerance",
        ),
    ),
)
