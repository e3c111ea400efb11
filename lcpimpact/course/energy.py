"""Lesson 5: the energy that impacts and steps take."""

from __future__ import annotations

from lcpimpact.course.lesson import FunctionTask, Lesson, Mistake


def dissipated(m1: float, m2: float, v1: float, v2: float, e: float) -> float:
    """Return the kinetic energy before the impact less that after it, by the velocities after it [J]."""
    mean = (m1 * v1 + m2 * v2) / (m1 + m2)
    u1, u2 = mean - e * (v1 - mean), mean - e * (v2 - mean)
    return 0.5 * (m1 * (v1**2 - u1**2) + m2 * (v2**2 - u2**2))


def energy_ratio(omega: float, h: float, theta: float) -> float:
    """Return the energy of a free oscillator after one step of the θ-method over the one before."""
    return (1.0 + ((1.0 - theta) * omega * h) ** 2) / (1.0 + (theta * omega * h) ** 2)


IMPACTS = (
    {"m1": 1.0, "m2": 2.0, "v1": 3.0, "v2": -1.0, "e": 0.5},
    {"m1": 0.3, "m2": 5.0, "v1": 2.0, "v2": 1.0, "e": 0.0},
    {"m1": 4.0, "m2": 4.0, "v1": 1.0, "v2": -1.5, "e": 0.9},
)


def _reduced(m1: float, m2: float, v1: float, v2: float) -> float:
    return 0.5 * m1 * m2 / (m1 + m2) * (v1 - v2) ** 2


LESSON = Lesson(
    "where the energy goes",
    (
        FunctionTask(
            "dissipated",
            dissipated,
            IMPACTS,
            "J",
            "momentum is kept, and the relative velocity becomes -e times what it was: this gives the velocities",
            (
                Mistake(
                    "the motion of the common centre of mass loses nothing; only the energy of the relative motion does",
                    lambda m1, m2, v1, v2, e: 0.5 * (1.0 - e * e) * (m1 * v1**2 + m2 * v2**2),
                ),
                Mistake(
                    "the relative speed falls by the factor e, and the energy of the relative motion by its square",
                    lambda m1, m2, v1, v2, e: (1.0 - e) * _reduced(m1, m2, v1, v2),
                ),
                Mistake(
                    "this is the energy of the relative motion that is left, not the one that is lost",
                    lambda m1, m2, v1, v2, e: e * e * _reduced(m1, m2, v1, v2),
                ),
                Mistake(
                    "the mass of the relative motion is m1 m2/(m1 + m2), which is less than either",
                    lambda m1, m2, v1, v2, e: 0.5 * (1.0 - e * e) * (m1 + m2) * (v1 - v2) ** 2,
                ),
                Mistake(
                    "this is the gain: what is lost is counted positive",
                    lambda m1, m2, v1, v2, e: -dissipated(m1, m2, v1, v2, e),
                ),
            ),
        ),
        FunctionTask(
            "energy_ratio",
            energy_ratio,
            (
                {"omega": 10.0, "h": 0.05, "theta": 0.5},
                {"omega": 10.0, "h": 0.05, "theta": 1.0},
                {"omega": 3.0, "h": 0.2, "theta": 0.75},
            ),
            "",
            "write the step for q and v together, and compare ω² q² + v² before and after it",
            (
                Mistake(
                    "θ and 1 - θ are exchanged: θ = 1 takes the forces at the end of the step, and dissipates",
                    lambda omega, h, theta: 1.0 / energy_ratio(omega, h, theta),
                ),
                Mistake(
                    "this is the ratio of the amplitudes; the energy goes with their square",
                    lambda omega, h, theta: energy_ratio(omega, h, theta) ** 0.5,
                ),
                Mistake("this holds for θ = 1 only", lambda omega, h, theta: energy_ratio(omega, h, 1.0)),
                Mistake("this is right for θ = 1/2 only", lambda omega, h, theta: 1.0),
            ),
        ),
    ),
)
