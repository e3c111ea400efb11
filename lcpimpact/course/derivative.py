"""Lesson 11: how an impact passes small changes on, and how the place of a ball depends on the height of its fall."""

from __future__ import annotations

import math

from lcpimpact.course.lesson import FunctionTask, Lesson, Mistake


def saltation(v: float, e: float, a: float, a_after: float) -> list[list[float]]:
    """Return the matrix that takes small changes of (x, v) before an impact on a floor at rest to those after it."""
    return [[-e, 0.0], [(a_after + e * a) / v, -e]]


def place_by_height(t: float, g: float, H: float, e: float) -> float:
    """Return dx(t)/dH of a ball dropped from H, between its first and second impact; x is the way down."""
    v = math.sqrt(2.0 * g * H)
    return (1.0 + e) * (1.0 - g * (t - v / g) / v)


IMPACTS = (
    {"v": 4.0, "e": 0.8, "a": 9.81, "a_after": 9.81},
    {"v": 1.5, "e": 0.5, "a": -2.0, "a_after": 3.0},
    {"v": 0.2, "e": 1.0, "a": 0.3, "a_after": 0.1},
)
FALLS = (
    {"t": 1.0, "g": 9.81, "H": 1.0, "e": 0.8},
    {"t": 3.0, "g": 1.62, "H": 2.5, "e": 0.6},
    {"t": 0.4, "g": 9.81, "H": 0.4, "e": 0.95},
)

LESSON = Lesson(
    "the derivative of a bounce",
    (
        FunctionTask(
            "saltation",
            saltation,
            IMPACTS,
            "",
            "a change dx of the place brings the impact forward by dx/v; follow the motion to it, through the law, and back",
            (
                Mistake(
                    "this is the law of impact alone, as if its instant did not move",
                    lambda v, e, a, a_after: [[1.0, 0.0], [0.0, -e]],
                ),
                Mistake(
                    "the impact moves, and with it the time for which each acceleration acts",
                    lambda v, e, a, a_after: [[-e, 0.0], [0.0, -e]],
                ),
                Mistake(
                    "the acceleration before the impact goes through the law as well",
                    lambda v, e, a, a_after: [[-e, 0.0], [a_after / v, -e]],
                ),
                Mistake(
                    "with an earlier impact the acceleration before it acts for a shorter time, the one after it for longer",
                    lambda v, e, a, a_after: [[-e, 0.0], [-(a_after + e * a) / v, -e]],
                ),
                Mistake(
                    "rows are what changes after the impact, columns what has changed before it",
                    lambda v, e, a, a_after: [[-e, (a_after + e * a) / v], [0.0, -e]],
                ),
            ),
        ),
        FunctionTask(
            "place_by_height",
            place_by_height,
            FALLS,
            "",
            "raising the fall by dH delays the impact by dH/v: where is the ball then, and with which speed does it leave?",
            (
                Mistake(
                    "the impact is at another instant if the fall is higher; this is what a step says that keeps it",
                    lambda t, g, H, e: 0.0,
                ),
                Mistake("the floor moves with H, but the ball has left it before t", lambda t, g, H, e: 1.0),
                Mistake(
                    "this is the change of the place at the impact; the ball also leaves with another speed",
                    lambda t, g, H, e: 1.0 + e,
                ),
                Mistake(
                    "the impact is later, so that gravity acts on the way up for a shorter time, too",
                    lambda t, g, H, e: 1.0 + e - e * g * (t - math.sqrt(2.0 * H / g)) / math.sqrt(2.0 * g * H),
                ),
            ),
        ),
    ),
)
