"""ARCH competition, affine and hybrid systems: the gearbox that is to mesh, and the drivetrain with backlash."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.problems.base import Problem
from lcpimpact.reading import read
from lcpimpact.scheme.elements.base import GROUND
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.load import Load
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.scheme.signals import Ramp
from lcpimpact.scheme.system import LinearComplementaritySystem
from lcpimpact.schemefile import Run
from lcpimpact.trajectory import Trajectory
from lcpimpact.validation.case import NotFound, Published, PublishedCase, Suite

GEARBOX = (
    "ARCH-COMP 2024, github.com/JuliaReach/ARCH2024_AFF_RE, models/Gearbox/gearbox.jl at ace7237e60; "
    "hylaa, github.com/stanleybak/hylaa, examples/gearbox/gearbox.py at a774f8eb5e"
)
DRIVETRAIN = "hylaa, github.com/stanleybak/hylaa, examples/drivetrain/drivetrain.py at a774f8eb5e"

# ---- the gearbox ---------------------------------------------------------------------------------------------------

THETA = math.radians(36.0)
TOOTH = np.array([math.sin(THETA), math.cos(THETA)])
"""Normal of the upper tooth; that of the lower one has the other sign along y."""

GEAR, RESTITUTION, DEPTH = 18.1, 0.9, -0.003
"""Mass of the gear in kg, coefficient of restitution, and where the sleeve meshes in m."""

PULL, DRAG = 70.0, -0.08 / 0.7
"""Force on the sleeve in N, and acceleration of the gear in m/s²."""


def gearbox(px: float, py: float, m_s: float) -> Problem:
    """Return the gearbox from rest at (px, py), with the mass m_s of the sleeve."""
    scheme = Scheme(
        Mass("x", m=m_s),
        Mass("y", m=GEAR),
        Load("x", PULL),
        Load("y", GEAR * DRAG),
        Bumper({"x": TOOTH[0], "y": TOOTH[1]}, GROUND, e=RESTITUTION, name="upper"),
        Bumper({"x": TOOTH[0], "y": -TOOTH[1]}, GROUND, e=RESTITUTION, name="lower"),
        Bumper("x", GROUND, gap=DEPTH, e=0.0, name="mesh"),
    )
    return Problem("gearbox", scheme, q0={"x": px, "y": py}, t_end=0.2)


def meshed_at(run: Trajectory) -> float:
    """Return the instant of meshing in s, inf without it."""
    return next((each.t for each in run.events if each.contact == "mesh"), math.inf)


def accumulated(run: Trajectory, m_s: float) -> float:
    """Return the impulses of the teeth until the mesh, and there m_s (|v_x| + |v_y|), in N s; inf without a mesh."""
    total = 0.0
    for each in run.events:
        if each.contact == "mesh":
            return total + m_s * float(np.abs(each.left.v).sum())
        total += each.impulse
    return math.inf


def by_reset_maps(px: float, py: float, m_s: float) -> tuple[float, float]:
    """Return the instant of meshing and the impulse by parabolas of flight and the reset maps of the source."""
    p, v, t, impulse = np.array([px, py]), np.zeros(2), 0.0, 0.0
    a = np.array([PULL / m_s, DRAG])
    normals = np.array([TOOTH, TOOTH * [1.0, -1.0], [1.0, 0.0]])
    while True:
        apart = np.array([0.0, 0.0, DEPTH]) - normals @ p
        rates, curvatures = normals @ v, normals @ a
        times = [
            _first_root(0.5 * c, u, -gap) for c, u, gap in zip(curvatures, rates, apart, strict=True)
        ]  # fmt: skip
        k = int(np.argmin(times))
        p, v, t = p + v * times[k] + 0.5 * a * times[k] ** 2, v + a * times[k], t + times[k]
        if k == 2:
            return t, impulse + m_s * float(np.abs(v).sum())
        pushed = (1.0 + RESTITUTION) * float(normals[k] @ v) / (TOOTH[0] ** 2 / m_s + TOOTH[1] ** 2 / GEAR)
        v = v - pushed * normals[k] / [m_s, GEAR]
        impulse += pushed


def _first_root(a: float, b: float, c: float) -> float:
    """Return the first t > 0 at which a t² + b t + c reaches zero from below, for a > 0 and c <= 0 up to rounding."""
    root = math.sqrt(b * b - 4.0 * a * min(c, 0.0))
    return (-b + root) / (2.0 * a) if b < 0.0 else -2.0 * min(c, 0.0) / (b + root)


def gearbox_case(name: str, px: float, py: float, m_s: float) -> PublishedCase:
    """Return the requirements on one start of a box."""
    truths = by_reset_maps(px, py, m_s)
    return PublishedCase(
        f"{name}, m_s = {m_s} kg",
        "gearbox that is to mesh",
        GEARBOX,
        partial(gearbox, px, py, m_s),
        (Run("exact", dt=0.01), Run("moreau-jean", dt=1e-5)),
        (
            Published("meshed before t in s", 0.2, meshed_at, truth=truths[0], below=True),
            Published("impulse below, in N s", 20.0, partial(accumulated, m_s=m_s), truth=truths[1], below=True),
        ),
    )


BOXES = {
    "GRBX01": ((-0.0168, -0.0166), (0.0029, 0.0031)),
    "GRBX02": ((-0.01675, -0.01665), (0.00285, 0.00315)),
}
"""Intervals of the start along x and y in m."""

STARTS = {"centre": (-0.0167, 0.003)} | {
    f"{name} at ({px}, {py})": (px, py) for name, (xs, ys) in BOXES.items() for px in xs for py in ys
}


# ---- the drivetrain ------------------------------------------------------------------------------------------------


def drivetrain(a: float) -> Problem:
    """Return the drivetrain from its centre + a times its generator; beyond ±0.03 rad of backlash a stiff shaft acts."""
    A = np.zeros((11, 11))
    rows: dict[int, dict[int, float]] = {
        1: {7: 1 / 12, 9: -1.0},
        2: {1: -60.0, 2: -80 / 3, 3: 60.0, 4: 60.0, 7: -5.0, 8: -60.0},
        3: {4: 1.0},
        5: {6: 1.0},
        6: {5: -5000 / 7, 6: -0.04, 10: 5000 / 7},
        7: {2: 10 / 3},
        8: {9: 1.0},
        9: {8: -1000.0, 9: -0.01, 10: 1000.0},
        10: {11: 1.0},
        11: {5: 1000.0, 8: 1000.0, 10: -2000.0, 11: -0.01},
    }
    for i, row in rows.items():
        for j, value in row.items():
            A[i - 1, j - 1] = value
    shaft = np.zeros(11)
    shaft[[1, 6, 8]] = 125000 / 9, -25000 / 9, 100.0
    twist = np.eye(11)[0]
    inputs = [0.0] * 11
    system = LinearComplementaritySystem(
        A,
        np.column_stack([shaft, -shaft]),
        np.vstack([-twist, twist]),
        np.eye(2),
        a=[
            Ramp(-300.0, 300.0, 0.2, 0.2) if i == 1 else Ramp(-5.0, 5.0, 0.2, 0.2) if i == 3 else inputs[i]
            for i in range(11)
        ],
        c=[0.03, 0.03],
    )
    centre = [-0.0432, -11.0, 0.0, 30.0, 0.0, 30.0, 360.0, -0.0013, 30.0, -0.0013, 30.0]
    generator = [0.0056, 4.67, 0.0, 10.0, 0.0, 10.0, 120.0, 0.0006, 10.0, 0.0006, 10.0]
    start = {f"x{i}": x + a * g for i, (x, g) in enumerate(zip(centre, generator, strict=True), 1)}
    return Problem("drivetrain", system, q0=start, t_end=2.0)


def returns(run: Trajectory, *, backlash: float = 0.03) -> float:
    """Return how often the twist leaves the last mode that it reached: the mode of error in the source."""
    times: Array = np.linspace(0.2, 2.0, 20_001)
    x = read(run, "x1", times)
    return float(sum(((x[:-1] > side) & (x[1:] <= side)).sum() for side in (-backlash, backlash)))


def drivetrain_case(a: float) -> PublishedCase:
    """Return the requirement on one start of the drivetrain."""
    return PublishedCase(
        f"drivetrain, centre {a:+g} generator",
        "drivetrain with backlash",
        DRIVETRAIN,
        partial(drivetrain, a),
        (Run("exact", dt=0.01), Run("moreau-jean", dt=1e-4)),
        (Published("fewer returns into the backlash than", 1.0, returns, below=True),),
    )


SUITE = Suite(
    "ARCH competition, affine and hybrid systems",
    (
        *(gearbox_case(name, *at, m_s) for m_s in (3.2, 3.4) for name, at in STARTS.items()),
        *(drivetrain_case(a) for a in (-1.0, 0.0, 1.0)),
    ),
    (
        NotFound(
            "GRBX01, GRBX02",
            "digits of a trajectory",
            GEARBOX,
            "the tools publish yes or no and a time of computing; ours by `exact` and by the reset maps stand in the table, "
            "of single starts and not of the box",
        ),
        NotFound("drivetrain", "digits of a trajectory", DRIVETRAIN, "the example states its modes and starts alone"),
        NotFound(
            "platoon, converters",
            "systems whose matrix A changes with the mode",
            "ARCH-COMP 2024",
            "refused: a system here has one A, and what changes is the set of closed contacts; switched gains are none",
        ),
        NotFound(
            "HyPro",
            "digits of the bouncing ball",
            "HyPro, github.com/hypro/hypro, examples/input/bouncing_ball.model at 03d8e6674c",
            "it states a box of starts, x in [10, 10.2], e = 0.75 and 3 s, and no result; its unsafe set, x in [4, 6] with "
            "v in [-2.5, 0], is a comment, and every start of the box enters it after its only bounce",
        ),
    ),
)
