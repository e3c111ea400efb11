"""Lesson 2: the steps of a ball on a floor, and the LCP of one step for two balls on top of each other."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.course.lesson import FunctionTask, Lesson, Mistake

Matrices = tuple[Array, Array, Array]


def bounce(H: float, g: float, e: float, h: float, steps: int) -> Array:
    """Return position and velocity of a ball that falls from rest, downwards from there, after the steps [m, m/s]."""
    return _stepped(H, g, e, h, steps)


def _stepped(
    H: float,
    g: float,
    e: float,
    h: float,
    steps: int,
    ahead: float = 0.5,
    part: float = 0.5,
    law: Callable[[float, float, float], float] = lambda free, v, e: min(free, -e * v),
) -> Array:
    """Return the last state of steps of Moreau and Jean, or of steps with a mistake.

    ``ahead``: the part of a step after which the gap is predicted.
    ``part``: the part of the way of a step that the new velocity makes.
    ``law``: the velocity after a step in which the contact is closed, of the free velocity, that before it, and e.
    """
    x, v = 0.0, 0.0
    for _ in range(steps):
        free = v + h * g
        after = law(free, v, e) if x + ahead * h * v >= H else free
        x += h * ((1.0 - part) * v + part * after)
        v = after
    return np.array([x, v])


def _pile(m1: float, m2: float, v1: float, v2: float) -> Matrices:
    """Return the inverse masses, the rows of the gap rates and the velocities, positive downwards."""
    return np.array([1.0 / m1, 1.0 / m2]), np.array([[-1.0, 0.0], [1.0, -1.0]]), np.array([v1, v2])


def delassus(m1: float, m2: float) -> Array:
    """Return W = H M⁻¹ Hᵀ [1/kg]."""
    inverse, H, _ = _pile(m1, m2, 0.0, 0.0)
    return (H * inverse) @ H.T


def free_rates(v1: float, v2: float, g: float, h: float, e: float) -> Array:
    """Return q = H (v + h g) + e H v [m/s]."""
    _, H, v = _pile(1.0, 1.0, v1, v2)
    return H @ (v + h * g) + e * (H @ v)


FALLS = (
    {"H": 1.0, "g": 9.81, "e": 0.8, "h": 0.01, "steps": 150},
    {"H": 0.5, "g": 1.62, "e": 0.2, "h": 0.03, "steps": 30},
    {"H": 2.0, "g": 9.81, "e": 1.0, "h": 0.005, "steps": 400},
)
MASSES = ({"m1": 1.0, "m2": 2.0}, {"m1": 0.5, "m2": 4.0}, {"m1": 3.0, "m2": 0.25})
STATES = (
    {"v1": 1.0, "v2": 2.0, "g": 9.81, "h": 0.01, "e": 0.5},
    {"v1": 2.0, "v2": -0.5, "g": 1.62, "h": 0.1, "e": 0.0},
    {"v1": 0.0, "v2": 3.0, "g": 9.81, "h": 0.001, "e": 1.0},
)


def _sign(v1: float, v2: float, g: float, h: float, e: float) -> Array:
    return -free_rates(v1, v2, g, h, e)


LESSON = Lesson(
    "one step is an LCP",
    (
        FunctionTask(
            "bounce",
            bounce,
            FALLS,
            "m, m/s",
            "a step: the free velocity v + h g; the contact is closed where x + h v/2 >= H; there P = max(0, m (v + h g + "
            "e v)); the new velocity v + h g - P/m; and x moves on by h times the mean of both velocities",
            (
                Mistake(
                    "the contact is closed where the gap is used up half way in the step, x + h v/2, not at its beginning",
                    lambda H, g, e, h, steps: _stepped(H, g, e, h, steps, ahead=0.0),
                ),
                Mistake(
                    "the contact is closed where the gap is used up half way in the step, x + h v/2, not at its end",
                    lambda H, g, e, h, steps: _stepped(H, g, e, h, steps, ahead=1.0),
                ),
                Mistake(
                    "the ball moves with the mean of both velocities, not with the new one alone",
                    lambda H, g, e, h, steps: _stepped(H, g, e, h, steps, part=1.0),
                ),
                Mistake(
                    "the ball moves with the mean of both velocities, not with the old one alone",
                    lambda H, g, e, h, steps: _stepped(H, g, e, h, steps, part=0.0),
                ),
                Mistake(
                    "the floor never pulls: where the ball leaves a closed contact by itself, P = 0",
                    lambda H, g, e, h, steps: _stepped(H, g, e, h, steps, law=lambda free, v, e: -e * v),
                ),
                Mistake(
                    "Newton's law takes the velocity before the step: the ball leaves with -e v, not with -e (v + h g)",
                    lambda H, g, e, h, steps: _stepped(H, g, e, h, steps, law=lambda free, v, e: min(free, -e * free)),
                ),
                Mistake(
                    "the ball stops at the floor: e times the velocity before the step belongs to the law",
                    lambda H, g, e, h, steps: _stepped(H, g, e, h, steps, law=lambda free, v, e: min(free, 0.0)),
                ),
            ),
        ),
        FunctionTask(
            "delassus",
            delassus,
            MASSES,
            "1/kg",
            "column j of W holds the changes of both gap rates by a unit impulse in contact j alone",
            (
                Mistake(
                    "an impulse between the balls pushes the lower one towards the floor: it slows the opening of that "
                    "contact, so that the contacts are coupled with a negative sign",
                    lambda m1, m2: np.abs(delassus(m1, m2)),
                ),
                Mistake(
                    "an impulse in one contact changes the gap rate of the other one too, since both hold the lower ball",
                    lambda m1, m2: np.diag(np.diag(delassus(m1, m2))),
                ),
                Mistake(
                    "W holds the inverses of the masses: a unit impulse moves a light ball more than a heavy one",
                    lambda m1, m2: np.array([[m1, -m1], [-m1, m1 + m2]]),
                ),
                Mistake(
                    "the contacts are in another order than asked for: the first is that with the floor",
                    lambda m1, m2: delassus(m1, m2)[::-1, ::-1],
                ),
                Mistake(
                    "the balls are in another order than asked for: m1 is the lower one",
                    lambda m1, m2: delassus(m2, m1),
                ),
            ),
        ),
        FunctionTask(
            "free_rates",
            free_rates,
            STATES,
            "m/s",
            "q is what the rows w of the LCP are without impulses: the gap rates at the end of the step, and e times those "
            "at its beginning",
            (
                Mistake(
                    "velocities are positive downwards, and a gap rate is positive where the contact opens: all signs are "
                    "reversed",
                    _sign,
                ),
                Mistake(
                    "Newton's law asks for U⁺ + e U⁻ >= 0, so that e times the gap rates before the step belongs to q",
                    lambda v1, v2, g, h, e: free_rates(v1, v2, g, h, 0.0),
                ),
                Mistake(
                    "Newton's law is U⁺ + e U⁻ >= 0: e has the wrong sign",
                    lambda v1, v2, g, h, e: free_rates(v1, v2, g, h, -e),
                ),
                Mistake(
                    "gravity accelerates the balls during the step: h g belongs to the velocities without impulses",
                    lambda v1, v2, g, h, e: free_rates(v1, v2, 0.0, h, e),
                ),
                Mistake(
                    "gravity acts on both balls alike, so that it does not change the rate of the gap between them",
                    lambda v1, v2, g, h, e: free_rates(v1, v2, g, h, e) - np.array([0.0, g * h]),
                ),
            ),
        ),
    ),
)
