"""Modelica: the bouncing ball of the Reference FMUs, and the example ElastoGap of the standard library."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from lcpimpact.problems import load_problem
from lcpimpact.problems.base import Problem
from lcpimpact.reading import read
from lcpimpact.scheme.elements.base import GROUND
from lcpimpact.scheme.elements.dashpot import Dashpot
from lcpimpact.scheme.elements.load import Load
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.elements.spring import Spring
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.schemefile import Run
from lcpimpact.trajectory import Trajectory
from lcpimpact.validation.case import NotFound, Published, PublishedCase, Suite, numbers_of

FMUS = "Reference FMUs, github.com/modelica/Reference-FMUs, BouncingBall"
LIBRARY = (
    "Modelica Standard Library 4.0.0, github.com/modelica/MAP-LIB_ReferenceResults, "
    "Modelica/Mechanics/Translational/Examples/ElastoGap/ElastoGap.csv at d6a2b9b204"
)

# ---- the bouncing ball ---------------------------------------------------------------------------------------------

FIRST = math.sqrt(2.0 / 9.81)
"""Time of the first fall from 1 m in s."""


REST = FIRST * 1.7 / 0.3
"""When its impacts accumulate in s, e = 0.7."""


def impact_at(k: int) -> float:
    """Return the instant of the k-th impact in s, e = 0.7."""
    return FIRST * (1.0 + 2.0 * sum(0.7**i for i in range(1, k)))


def height_at(t: float) -> float:
    """Return the height of the ball in m, e = 0.7."""
    if t >= REST:
        return 0.0
    k = next(k for k in range(1, 100) if impact_at(k) > t) - 1
    if k == 0:
        return 1.0 - 0.5 * 9.81 * t**2
    after = t - impact_at(k)
    return after * (9.81 * FIRST * 0.7**k - 0.5 * 9.81 * after)


def ball() -> Problem:
    """Return the ball that falls 1 m, e = 0.7."""
    return load_problem("bouncing-ball", m=1.0, g=9.81, H=1.0, e=0.7)


def height(run: Trajectory, t: float) -> float:
    """Return the height of the ball in m."""
    return 1.0 - float(read(run, "x", [t])[0])


IMPACTS = (0.451522, 1.08365, 1.52613, 1.83585, 2.05263, 2.20436, 2.31052, 2.38477, 2.43665, 2.47284, 2.498)
"""Instants of the rows in which v changes its sign, and of the last, from which on it is zero."""

LOSES_SPEED = (
    "A flight that begins with v⁺ ends with -v⁺ after 2 v⁺/g. Those of the file end slower than they begin (3.1006 m/s and "
    "3.10058 m/s, 0.177933 m/s and 0.177103 m/s) and so are too short: its program loses speed in free flight."
)
TOO_EARLY = (
    "The model sets v = 0 after the first impact whose rebound is slower than 0.1 m/s, the eleventh. By the law of impact "
    "v⁺ = -e v⁻ the ball rests where its impacts accumulate, at sqrt(2 h/g) (1 + e)/(1 - e)."
)
EULER = (
    "The rows are those of explicit Euler steps τ of 1 ms, which begin the fall with h = 1 - g τ² n (n - 1)/2 in place of "
    "1 - g τ² n²/2, and take an impact at the end of the step that passes the floor."
)
SAMPLES = {
    0.17: 0.8590793500000008,
    0.57: 0.2973872069999994,
    0.97: 0.29974160699999497,
    1.37: 0.22943265029999957,
    1.77: 0.0944897924700007,
    2.17: 0.03015808083629997,
    2.57: 0.0008986814312129663,
}
"""Heights in m at instants in s of the file of today."""

BALL_2019 = PublishedCase(
    "BouncingBall, 2019",
    "bouncing ball",
    f"{FMUS}/BouncingBall_ref.csv at 00bd2dd569",
    ball,
    (Run("exact", dt=0.1, t_end=2.6), Run("event-driven", dt=0.1, t_end=2.6)),
    (
        *(
            Published(
                f"impact {k} at t in s",
                value,
                f"impact:{k}",
                atol=5e-7 if k == 1 else 5e-6,
                truth=impact_at(k),
                derivation=LOSES_SPEED,
            )
            for k, value in enumerate(IMPACTS, 1)
        ),
        Published("at rest from t in s", 2.498, "close:1", atol=5e-6, truth=REST, derivation=TOO_EARLY),
    ),
)

BALL_TODAY = PublishedCase(
    "BouncingBall, 2026",
    "bouncing ball",
    f"{FMUS}/BouncingBall_out.csv at 1258711a41",
    ball,
    (Run("exact", dt=0.1, t_end=2.6), Run("event-driven", dt=0.1, t_end=2.6)),
    tuple(
        Published(f"h({t} s) in m", value, partial(height, t=t), atol=1e-15, truth=height_at(t), derivation=EULER)
        for t, value in SAMPLES.items()
    ),
)


# ---- ElastoGap -----------------------------------------------------------------------------------------------------


def elasto_gap(t: float, s: float, v: float) -> float:
    """Return the force of the two gaps on the mass in N: springs of 10 N/m, their dashpots bounded by the spring force."""
    side = 1.0 if s.real > 0.0 else -1.0
    δ, rate = side * s - 0.5, side * v
    if δ.real <= 0.0:
        return 0.0 * s
    spring, damping = 10.0 * δ, 1.5 * rate
    if damping.real > spring.real:
        damping = spring
    elif damping.real < -spring.real:
        damping = -spring
    return -side * (spring + damping)


def between_gaps() -> Problem:
    """Return the mass of 1 kg between two gaps, from rest at 2 m."""
    return Problem("ElastoGap", Scheme(Mass("s", m=1.0), Load("s", elasto_gap)), q0={"s": 2.0}, t_end=5.0)


def between_springs() -> Problem:
    """Return the mass of 1 kg between two springs and dashpots, from rest at 2 m."""
    scheme = Scheme(Mass("s", m=1.0), Spring("s", GROUND, k=20.0), Dashpot("s", GROUND, c=3.0))
    return Problem("SpringDamper", scheme, q0={"s": 2.0}, t_end=5.0)


def off(run: Trajectory, *, rate: int, place: int) -> float:
    """Return the largest difference from the columns of a rate v and of a place 2 - s."""
    rows = numbers_of("elastogap.csv")
    at = rows[:, 0]
    v, s = read(run, "v_s", at), read(run, "s", at)
    return float(np.abs(np.concatenate([v - rows[:, rate], 2.0 - s - rows[:, place]])).max())


SOLVER = (
    "The file was made by Dassl with a relative tolerance of 1e-6, and prints 17 digits: its numbers differ from the motion "
    "by more than ten times that. Between the springs it is that of s'' = -20 s - 3 s', a closed form that `exact` has; "
    "between the gaps two methods of ours agree."
)
ROWS = "largest difference from rows of the file, in m and m/s"

SPRINGS = PublishedCase(
    "ElastoGap, mass1",
    "mass between springs and dashpots",
    LIBRARY,
    between_springs,
    (Run("exact", dt=0.1), Run("moreau-jean", dt=1e-4)),
    (Published(ROWS, 0.0, partial(off, rate=3, place=4), atol=1e-5, derivation=SOLVER),),
)

GAPS = PublishedCase(
    "ElastoGap, mass2",
    "mass between gaps, with damping bounded by the spring force",
    LIBRARY,
    between_gaps,
    (Run("event-driven", dt=0.1), Run("rk4", dt=2e-3)),
    (Published(ROWS, 0.0, partial(off, rate=1, place=2), atol=1e-5, derivation=SOLVER),),
)

SUITE = Suite(
    "Modelica: Reference FMUs, and ElastoGap of the standard library",
    (BALL_2019, BALL_TODAY, SPRINGS, GAPS),
    (
        NotFound(
            "ElastoGap",
            "tolerance of the regression test",
            LIBRARY,
            "the folder names the signals and no tolerance; here ten times the tolerance of its solver is allowed",
        ),
    ),
)
