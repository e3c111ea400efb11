"""Lesson 12: a pendulum that strikes a wall, its impacts by elliptic integrals, and the order of the frozen step."""

from __future__ import annotations

import math

from lcpimpact.course.lesson import FunctionTask, Lesson, Mistake
from lcpimpact.problems.pendulums import impacts_with_wall


def first_impact(phi: float, wall: float, g: float, L: float) -> float:
    """Return the time when a pendulum let go at phi < 0 strikes a wall at an angle not below 0 [s]."""
    return impacts_with_wall(phi, wall, 1.0, math.sqrt(g / L), 1)[0]


def turning_angle(phi: float, wall: float, e: float) -> float:
    """Return the angle, below zero, at which the pendulum turns after its first impact [rad]."""
    return -math.acos(math.cos(wall) - e * e * (math.cos(wall) - math.cos(phi)))


def order(phi: float, g: float, L: float, t: float, n: int) -> float:
    """Return log2 of the error of the angle at t after n frozen steps over that after 2 n."""
    return math.log2(_error(phi, g, L, t, n) / _error(phi, g, L, t, 2 * n))


def _error(phi: float, g: float, L: float, t: float, n: int, half_way: float = 1.0, slope: float = 1.0) -> float:
    """Return the error of the angle at t of a pendulum let go at phi < 0, without a wall, after n frozen steps [rad]."""
    from scipy.special import ellipj

    h, square, k = t / n, g / L, math.sin(-0.5 * phi)
    q, v = phi, 0.0
    for _ in range(n):
        middle = q + half_way * 0.5 * h * v
        K = slope * square * math.cos(middle)
        w = (-square * math.sin(middle) + K * (middle - q) + 2.0 * v / h) / (2.0 / h + 0.5 * h * K)
        q, v = q + h * w, 2.0 * w - v
    _, cn, dn, _ = ellipj(math.sqrt(square) * t, k * k)
    return abs(q + 2.0 * math.asin(k * float(cn / dn)))


def _order_of(phi: float, g: float, L: float, t: float, n: int, half_way: float, slope: float) -> float:
    return math.log2(_error(phi, g, L, t, n, half_way, slope) / _error(phi, g, L, t, 2 * n, half_way, slope))


def _swing(phi: float, wall: float, g: float, L: float, signs: tuple[float, float], power: int = 2) -> float:
    """Return a K + b F over ω_0, with K and F of a power of k."""
    from scipy.special import ellipk, ellipkinc

    k = math.sin(-0.5 * phi)
    F = ellipkinc(math.asin(math.sin(0.5 * wall) / k), k**power)
    return float(signs[0] * ellipk(k**power) + signs[1] * F) / math.sqrt(g / L)


STARTS = (
    {"phi": -1.0, "wall": 0.3, "g": 9.81, "L": 1.0},
    {"phi": -2.5, "wall": 0.8, "g": 9.81, "L": 0.4},
    {"phi": -0.6, "wall": 0.5, "g": 1.62, "L": 2.0},
)
IMPACTS = (
    {"phi": -1.0, "wall": 0.3, "e": 0.8},
    {"phi": -2.5, "wall": 0.8, "e": 0.5},
    {"phi": -0.6, "wall": 0.1, "e": 0.9},
)
SWINGS: tuple[dict[str, float], ...] = (
    {"phi": -1.0, "g": 9.81, "L": 1.0, "t": 0.6, "n": 5},
    {"phi": -2.0, "g": 9.81, "L": 0.5, "t": 0.4, "n": 8},
    {"phi": -1.5, "g": 1.62, "L": 1.0, "t": 1.2, "n": 10},
)

LESSON = Lesson(
    "a pendulum strikes",
    (
        FunctionTask(
            "first_impact",
            first_impact,
            STARTS,
            "s",
            "from rest to the bottom takes K/ω_0, from there to the wall F/ω_0, both with k = sin(phi/2)",
            (
                Mistake(
                    "this is the linear pendulum, which is early: large angles swing slowly",
                    lambda phi, wall, g, L: math.acos(wall / phi) / math.sqrt(g / L),
                ),
                Mistake(
                    "this is the time to the bottom, and the wall stands beyond it",
                    lambda phi, wall, g, L: _swing(phi, wall, g, L, (1.0, 0.0)),
                ),
                Mistake(
                    "the start and the wall are on different sides of the bottom, so that the two times add up",
                    lambda phi, wall, g, L: _swing(phi, wall, g, L, (1.0, -1.0)),
                ),
                Mistake(
                    "SciPy's ellipk and ellipkinc take m = k², not k",
                    lambda phi, wall, g, L: _swing(phi, wall, g, L, (1.0, 1.0), power=1),
                ),
            ),
        ),
        FunctionTask(
            "turning_angle",
            turning_angle,
            IMPACTS,
            "rad",
            "the energy after the impact is that at the wall, with e times the speed; it turns where all of it is potential",
            (
                Mistake(
                    "it swings back to the side that it came from, where angles are below zero",
                    lambda phi, wall, e: -turning_angle(phi, wall, e),
                ),
                Mistake("e multiplies the speed at the wall, not the angle", lambda phi, wall, e: e * phi),
                Mistake(
                    "the energy of the linear pendulum goes with φ²; here it goes with 1 - cos φ",
                    lambda phi, wall, e: -math.hypot(wall, e * math.sqrt(phi**2 - wall**2)),
                ),
                Mistake(
                    "the impact keeps e times the speed, and so e² times the kinetic energy",
                    lambda phi, wall, e: turning_angle(phi, wall, math.sqrt(e)),
                ),
                Mistake(
                    "at the wall a part of the energy is potential, and the impact does not take of that",
                    lambda phi, wall, e: turning_angle(phi, 0.0, e),
                ),
            ),
        ),
        FunctionTask(
            "order",
            order,
            SWINGS,
            "",
            "compare the angle at t after n and after 2 n frozen steps with θ = 1/2 with that of Jacobi's functions",
            (
                Mistake(
                    "this is the order of a step whose force is that of its beginning: take it half way, with its slope",
                    lambda phi, g, L, t, n: _order_of(phi, g, L, t, n, 0.0, 0.0),
                ),
                Mistake(
                    "the force is half way, but its slope K is missing in A",
                    lambda phi, g, L, t, n: _order_of(phi, g, L, t, n, 1.0, 0.0),
                ),
                Mistake(
                    "the force and its slope are those half way, at φ + h v/2, not at the beginning of the step",
                    lambda phi, g, L, t, n: _order_of(phi, g, L, t, n, 0.0, 1.0),
                ),
                Mistake(
                    "the error with n steps stands over that with 2 n: an order is positive where smaller steps help",
                    lambda phi, g, L, t, n: -order(phi, g, L, t, n),
                ),
                Mistake(
                    "the steps are halved, so that the logarithm is that to the base 2",
                    lambda phi, g, L, t, n: math.log(2.0) * order(phi, g, L, t, n),
                ),
            ),
            rtol=1e-5,
        ),
    ),
)
