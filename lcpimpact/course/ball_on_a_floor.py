"""Lesson 1: the instants and heights of a ball that bounces on a floor."""

from __future__ import annotations

import math

from lcpimpact.course.lesson import FunctionTask, Lesson, Mistake


def impact_time(n: int, g: float, H: float, e: float) -> float:
    """Return the instant of the n-th impact of a ball dropped from H, flight by flight [s]."""
    t, speed = math.sqrt(2.0 * H / g), math.sqrt(2.0 * g * H)
    for _ in range(n - 1):
        speed *= e
        t += 2.0 * speed / g
    return t


def apex(n: int, H: float, e: float) -> float:
    """Return the greatest height after the n-th impact [m]."""
    return H * (e * e) ** n


CASES = (
    {"n": 1, "g": 9.81, "H": 1.0, "e": 0.8},
    {"n": 2, "g": 9.81, "H": 1.0, "e": 0.8},
    {"n": 3, "g": 1.62, "H": 2.5, "e": 0.6},
    {"n": 7, "g": 9.81, "H": 0.4, "e": 0.95},
)


def _fall(g: float, H: float) -> float:
    return math.sqrt(2.0 * H / g)


LESSON = Lesson(
    "a ball on a floor",
    (
        FunctionTask(
            "impact_time",
            impact_time,
            CASES,
            "s",
            "add up the first fall and the flights between impacts, each of which takes twice its take-off speed over g",
            (
                Mistake(
                    "a flight goes up and down again, so that only the first fall is half a flight",
                    lambda n, g, H, e: _fall(g, H) * sum(e**i for i in range(n)),
                ),
                Mistake(
                    "the first fall begins at rest at the height H, and takes half of what a whole flight would",
                    lambda n, g, H, e: 2.0 * _fall(g, H) * sum(e**i for i in range(n)),
                ),
                Mistake(
                    "e is the ratio of the speeds after and before an impact; the ratio of the heights is another",
                    lambda n, g, H, e: _fall(g, H) * (1.0 + 2.0 * sum(math.sqrt(e) ** i for i in range(1, n))),
                ),
                Mistake(
                    "this is the instant of the next impact: the first one, n = 1, ends the first fall",
                    lambda n, g, H, e: impact_time(n + 1, g, H, e),
                ),
                Mistake(
                    "the first impact, n = 1, ends the first fall; what is counted here begins with n = 0",
                    lambda n, g, H, e: impact_time(n - 1, g, H, e) if n > 1 else 0.0,
                ),
            ),
        ),
        FunctionTask(
            "apex",
            apex,
            tuple({"n": case["n"], "H": case["H"], "e": case["e"]} for case in CASES),
            "m",
            "compare the energies before and after an impact, m g H and half m times the square of the speed",
            (
                Mistake(
                    "e is the ratio of the speeds, and the height goes with the square of the speed",
                    lambda n, H, e: H * e**n,
                ),
                Mistake(
                    "this is the height before the n-th impact, not the one after it",
                    lambda n, H, e: H * e ** (2 * n - 2),
                ),
                Mistake(
                    "this is the depth below H, not the height above the floor", lambda n, H, e: H - H * e ** (2 * n)
                ),
            ),
        ),
    ),
)
