"""Lesson 4: an impact as the limit of stiff springs."""

from __future__ import annotations

import math

from lcpimpact.course.lesson import FunctionTask, Lesson, Mistake


def stiffness(m: float, v: float, d: float) -> float:
    """Return the stiffness with which a mass penetrates by d, by the balance of energy m v² = k d² [N/m]."""
    return m * v * v / (d * d)


def contact_time(m: float, k: float) -> float:
    """Return half a period of the mass on the spring [s]."""
    return math.pi / math.sqrt(k / m)


def peak_force(m: float, v: float, k: float) -> float:
    """Return k times the greatest penetration v/ω [N]."""
    return k * v / math.sqrt(k / m)


def impulse(m: float, v: float, e: float) -> float:
    """Return the change of momentum from v to -e v [N s]."""
    return m * v - m * (-e * v)


LESSON = Lesson(
    "three views of one impact",
    (
        FunctionTask(
            "stiffness",
            stiffness,
            ({"m": 1.0, "v": 4.43, "d": 1e-3}, {"m": 0.2, "v": 2.0, "d": 1e-4}, {"m": 5.0, "v": 0.3, "d": 1e-2}),
            "N/m",
            "at the greatest penetration the spring holds all the kinetic energy",
            (
                Mistake(
                    "both energies, of the mass and of the spring, have the factor one half",
                    lambda m, v, d: 0.5 * m * v * v / (d * d),
                ),
                Mistake(
                    "both energies, of the mass and of the spring, have the factor one half",
                    lambda m, v, d: 2.0 * m * v * v / (d * d),
                ),
                Mistake(
                    "the energy of a spring goes with the square of its penetration", lambda m, v, d: m * v * v / d
                ),
                Mistake("this balances the weight at rest; the impact needs more", lambda m, v, d: m * 9.81 / d),
            ),
        ),
        FunctionTask(
            "contact_time",
            contact_time,
            ({"m": 1.0, "k": 1e6}, {"m": 0.2, "k": 1e4}, {"m": 5.0, "k": 300.0}),
            "s",
            "while it touches, the mass is an oscillator that starts at its position of rest",
            (
                Mistake(
                    "this is a whole period; the mass leaves as soon as the force is zero again, after half of it",
                    lambda m, k: 2.0 * contact_time(m, k),
                ),
                Mistake(
                    "this is the time to the greatest penetration; the mass still has to return",
                    lambda m, k: 0.5 * contact_time(m, k),
                ),
                Mistake(
                    "mass and stiffness are exchanged: a stiffer spring makes a shorter contact",
                    lambda m, k: math.pi * math.sqrt(k / m),
                ),
            ),
        ),
        FunctionTask(
            "peak_force",
            peak_force,
            ({"m": 1.0, "v": 4.43, "k": 1e6}, {"m": 0.2, "v": 2.0, "k": 1e4}, {"m": 5.0, "v": 0.3, "k": 300.0}),
            "N",
            "the peak force is k times the greatest penetration",
            (
                Mistake(
                    "this is the mean force over the contact, impulse over time; the peak of a half sine is larger",
                    lambda m, v, k: 2.0 * m * v / contact_time(m, k),
                ),
                Mistake("the penetration is v/ω with ω² = k/m, not v/ω²", lambda m, v, k: m * v),
            ),
        ),
        FunctionTask(
            "impulse",
            impulse,
            ({"m": 1.0, "v": 4.43, "e": 0.8}, {"m": 0.2, "v": 2.0, "e": 0.0}, {"m": 5.0, "v": 0.3, "e": 1.0}),
            "N s",
            "the impulse is the change of momentum, and the velocity changes its sign",
            (
                Mistake("this stops the mass; the rebound needs an impulse too", lambda m, v, e: m * v),
                Mistake(
                    "the rebound goes the other way, so that the momenta add up", lambda m, v, e: m * v * (1.0 - e)
                ),
                Mistake("this is right for e = 1 only", lambda m, v, e: 2.0 * m * v),
            ),
        ),
    ),
)
