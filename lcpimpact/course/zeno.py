"""Lesson 6: infinitely many impacts in finite time."""

from __future__ import annotations

import math

from lcpimpact.course.lesson import FunctionTask, Lesson, Mistake


def rest_time(g: float, H: float, v0: float, e: float) -> float:
    """Return the instant at which a ball thrown downwards with v0 from H comes to rest, the sum of all its flights [s]."""
    speed = math.sqrt(v0 * v0 + 2.0 * g * H)
    t, flight = (speed - v0) / g, 2.0 * e * speed / g
    while flight > 1e-17 * t:
        t, flight = t + flight, e * flight
    return t


def resolved_impacts(g: float, H: float, e: float, h: float) -> float:
    """Return the number of impacts of a ball dropped from H that are followed by a flight of at least h."""
    flight, count = 2.0 * e * math.sqrt(2.0 * H / g), 0
    while flight >= h:
        flight, count = e * flight, count + 1
    return count


def _speed(g: float, H: float, v0: float) -> float:
    return math.sqrt(v0 * v0 + 2.0 * g * H)


LESSON = Lesson(
    "Zeno's ball",
    (
        FunctionTask(
            "rest_time",
            rest_time,
            (
                {"g": 9.81, "H": 1.0, "v0": 0.0, "e": 0.8},
                {"g": 9.81, "H": 1.0, "v0": 3.0, "e": 0.5},
                {"g": 1.62, "H": 0.3, "v0": -2.0, "e": 0.9},
            ),
            "s",
            "the first fall ends with the speed sqrt(v0² + 2 g H); the flights after it are a geometric series",
            (
                Mistake(
                    "v0 changes the speed of the first impact and the time of the first fall",
                    lambda g, H, v0, e: rest_time(g, H, 0.0, e),
                ),
                Mistake(
                    "the first fall begins with the speed v0, and is shorter for v0 > 0",
                    lambda g, H, v0, e: rest_time(g, H, v0, e) + v0 / g,
                ),
                Mistake(
                    "each flight goes up and down: it takes twice its take-off speed over g",
                    lambda g, H, v0, e: (_speed(g, H, v0) - v0) / g + e / (1.0 - e) * _speed(g, H, v0) / g,
                ),
                Mistake(
                    "the first flight takes off with e times the speed of the first impact: the series begins with e, not 1",
                    lambda g, H, v0, e: (_speed(g, H, v0) - v0) / g + 2.0 / (1.0 - e) * _speed(g, H, v0) / g,
                ),
                Mistake("v0 is positive downwards: its sign is reversed", lambda g, H, v0, e: rest_time(g, H, -v0, e)),
            ),
        ),
        FunctionTask(
            "resolved_impacts",
            resolved_impacts,
            (
                {"g": 9.81, "H": 1.0, "e": 0.8, "h": 0.01},
                {"g": 9.81, "H": 1.0, "e": 0.5, "h": 0.001},
                {"g": 1.62, "H": 0.5, "e": 0.9, "h": 0.1},
            ),
            "",
            "the flight after impact n lasts eⁿ times what a flight without loss lasts: compare it with h",
            (
                Mistake(
                    "the flight after the first impact has lost its factor e already: the count is one too many",
                    lambda g, H, e, h: resolved_impacts(g, H, e, e * h),
                ),
                Mistake(
                    "a flight goes up and down: it lasts twice the time of a fall from its apex",
                    lambda g, H, e, h: resolved_impacts(g, H, e, 2.0 * h),
                ),
                Mistake(
                    "a count is a whole number: the last flight that lasts h",
                    lambda g, H, e, h: math.log(h / (2.0 * math.sqrt(2.0 * H / g))) / math.log(e),
                ),
                Mistake(
                    "e is the ratio of the speeds, and a flight lasts in proportion to its speed, not to its height",
                    lambda g, H, e, h: math.floor(math.log(h / (2.0 * math.sqrt(2.0 * H / g))) / (2.0 * math.log(e))),
                ),
            ),
            rtol=1e-9,
        ),
    ),
)
