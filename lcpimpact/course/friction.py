"""Lesson 7: stick and slip of a block on an incline."""

from __future__ import annotations

import math

import numpy as np

from lcpimpact.course.lesson import FunctionTask, Lesson, Mistake


def stop_time(g: float, alpha: float, mu: float, v0: float) -> float:
    """Return the first instant of rest of a block with v0 down the slope, or infinity [s]."""
    pull, friction = g * math.sin(alpha), mu * g * math.cos(alpha)
    if v0 < 0.0:
        return -v0 / (pull + friction)
    return v0 / (friction - pull) if friction > pull else math.inf


def resting_friction(m: float, g: float, alpha: float, mu: float) -> float:
    """Return the friction, up the slope, on a block set down at rest [N]."""
    return min(m * g * math.sin(alpha), mu * m * g * math.cos(alpha))


SLOPES = (
    {"g": 9.81, "alpha": 0.3, "mu": 0.5, "v0": 2.0},
    {"g": 9.81, "alpha": 0.3, "mu": 0.2, "v0": 2.0},
    {"g": 9.81, "alpha": 0.3, "mu": 0.5, "v0": -2.0},
    {"g": 1.62, "alpha": 0.6, "mu": 0.4, "v0": -1.0},
)
BLOCKS = (
    {"m": 2.0, "g": 9.81, "alpha": 0.3, "mu": 0.5},
    {"m": 2.0, "g": 9.81, "alpha": 0.6, "mu": 0.5},
    {"m": 0.7, "g": 1.62, "alpha": 0.1, "mu": 0.2},
)


def _up_as_down(g: float, alpha: float, mu: float, v0: float) -> float:
    return stop_time(g, alpha, mu, abs(v0))


def _net(g: float, alpha: float, mu: float, v0: float) -> float:
    with np.errstate(divide="ignore"):
        return float(v0 / (mu * g * math.cos(alpha) - g * math.sin(alpha)))


def _level(g: float, alpha: float, mu: float, v0: float) -> float:
    return abs(v0) / (mu * g * math.cos(alpha))


def _whole_weight(g: float, alpha: float, mu: float, v0: float) -> float:
    pull, friction = g * math.sin(alpha), mu * g
    if v0 < 0.0:
        return -v0 / (pull + friction)
    return v0 / (friction - pull) if friction > pull else math.inf


LESSON = Lesson(
    "stick and slip",
    (
        FunctionTask(
            "stop_time",
            stop_time,
            SLOPES,
            "s",
            "friction opposes the motion, so that its sign is that of -v; write the acceleration for either direction",
            (
                Mistake("a block that moves up is slowed by gravity and friction together", _up_as_down),
                Mistake(
                    "friction opposes the motion: its sign changes with that of v0, and a block that is driven more than it "
                    "is braked never stops",
                    _net,
                ),
                Mistake("gravity pulls down the slope too", _level),
                Mistake("the normal force on a slope is m g cos α, not m g", _whole_weight),
            ),
        ),
        FunctionTask(
            "resting_friction",
            resting_friction,
            BLOCKS,
            "N",
            "decide first whether the block sticks: friction is then what equilibrium asks for, and never more than μ times "
            "the normal force",
            (
                Mistake(
                    "μ times the normal force is the largest friction; one that sticks has what equilibrium asks for",
                    lambda m, g, alpha, mu: mu * m * g * math.cos(alpha),
                ),
                Mistake(
                    "friction cannot exceed μ times the normal force; a block on a steeper slope slips",
                    lambda m, g, alpha, mu: m * g * math.sin(alpha),
                ),
                Mistake(
                    "friction on a block that would slide down points up the slope, and is counted positive there",
                    lambda m, g, alpha, mu: -resting_friction(m, g, alpha, mu),
                ),
                Mistake("the normal force on a slope is m g cos α, not m g", lambda m, g, alpha, mu: mu * m * g),
            ),
        ),
    ),
)
