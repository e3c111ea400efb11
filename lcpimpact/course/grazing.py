"""Lesson 9: where an oscillator first touches its stop, and how its stroboscopic map contracts areas."""

from __future__ import annotations

import math

from lcpimpact.course.lesson import FunctionTask, Lesson, Mistake


def grazing_force(m: float, k: float, c: float, gap: float, omega: float) -> float:
    """Return the amplitude of the force with which the steady vibration just reaches the stop [N]."""
    return gap * math.hypot(k - m * omega**2, c * omega)


def contraction(m: float, c: float, e: float, omega: float, impacts: float) -> float:
    """Return the determinant of the derivative of the map over one period of the force."""
    return math.exp(2.0 * impacts * math.log(e) - c / m * 2.0 * math.pi / omega)


GRAZING = (
    {"m": 1.0, "k": 1.0, "c": 0.1, "gap": 1.0, "omega": 2.5},
    {"m": 2.0, "k": 50.0, "c": 4.0, "gap": 0.02, "omega": 3.0},
    {"m": 0.5, "k": 8.0, "c": 0.5, "gap": 0.1, "omega": 4.0},
)
MAPS = (
    {"m": 1.0, "c": 0.1, "e": 0.8, "omega": 2.5, "impacts": 1},
    {"m": 2.0, "c": 4.0, "e": 0.6, "omega": 9.0, "impacts": 2},
    {"m": 0.5, "c": 0.2, "e": 0.9, "omega": 4.0, "impacts": 0},
)


def _damping(m: float, c: float, omega: float) -> float:
    return math.exp(-c / m * 2.0 * math.pi / omega)


LESSON = Lesson(
    "grazing and chaos",
    (
        FunctionTask(
            "grazing_force",
            grazing_force,
            GRAZING,
            "N",
            "the steady vibration has the amplitude f/|k - m ω² + i c ω|: it grazes where this is the gap",
            (
                Mistake(
                    "this is the static force; a vibration has inertia and damping", lambda m, k, c, gap, omega: k * gap
                ),
                Mistake(
                    "damping belongs to the dynamic stiffness too",
                    lambda m, k, c, gap, omega: gap * abs(k - m * omega**2),
                ),
                Mistake(
                    "the forces of spring and dashpot are a quarter of a period apart: they add as perpendicular vectors do",
                    lambda m, k, c, gap, omega: gap * (abs(k - m * omega**2) + c * omega),
                ),
                Mistake(
                    "the damping force goes with the velocity, c ω",
                    lambda m, k, c, gap, omega: gap * math.hypot(k - m * omega**2, c),
                ),
                Mistake(
                    "this is the amplitude that a force of the size of the gap gives, the inverse question",
                    lambda m, k, c, gap, omega: gap / math.hypot(k - m * omega**2, c * omega),
                ),
            ),
        ),
        FunctionTask(
            "contraction",
            contraction,
            MAPS,
            "",
            "the free motion contracts areas by exp(-c T/m) over a period, and each impact has its own factor",
            (
                Mistake(
                    "the saltation matrix of an impact has the factor -e twice on its diagonal",
                    lambda m, c, e, omega, impacts: e**impacts * _damping(m, c, omega),
                ),
                Mistake(
                    "the dashpot contracts areas too, between the impacts",
                    lambda m, c, e, omega, impacts: e ** (2 * impacts),
                ),
                Mistake(
                    "each impact of the period contracts areas", lambda m, c, e, omega, impacts: _damping(m, c, omega)
                ),
                Mistake(
                    "the trace of the system's matrix is -c/m: areas contract twice as fast as amplitudes",
                    lambda m, c, e, omega, impacts: e ** (2 * impacts) * _damping(m, 0.5 * c, omega),
                ),
                Mistake(
                    "the period is 2 π/ω", lambda m, c, e, omega, impacts: e ** (2 * impacts) * math.exp(-c / m / omega)
                ),
            ),
        ),
    ),
)
