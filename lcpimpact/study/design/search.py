"""All solutions of f(λ) = goal on an interval, and the range of f where there is none."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

from scipy.optimize import brentq, minimize_scalar

from lcpimpact.arrays import Array


@dataclass(frozen=True)
class Roots:
    """The solutions in ascending order, and the minimum and maximum of f (nan if undefined)."""

    solutions: tuple[float, ...]
    low: float
    high: float


def solve(f: Callable[[float], float], grid: Array, goal: float, *, tangency_rtol: float = 1e-12) -> Roots:
    r"""Find every λ in the interval of a grid with f(λ) = goal, where f may be undefined (nan) in parts.

    The interval is cut into pieces on which f is monotone: at its extrema, found to rounding between points of the grid, and
    at the ends of the parts where it is defined, found by bisection. A piece has a root if and only if the goal lies between
    its ends. What could be missed is a swing up and down between two points of the grid.

    ``tangency_rtol``: difference of an extremum from the goal, relative to it, below which it is a solution.

    Examples
    --------
    >>> import numpy as np
    >>> found = solve(lambda λ: (λ - 2.0) ** 2, np.linspace(0.0, 5.0, 11), goal=1.0)
    >>> [round(λ, 12) for λ in found.solutions], round(found.low, 12), found.high
    ([1.0, 3.0], 0.0, 9.0)
    """
    points = [(float(λ), f(float(λ))) for λ in grid]
    points += [_border(f, a, b) for a, b in pairwise(points) if math.isnan(a[1] + b[1])]
    points.sort()
    points += [
        _extremum(f, *three)
        for three in zip(points, points[1:], points[2:], strict=False)
        if (three[1][1] - three[0][1]) * (three[2][1] - three[1][1]) < 0.0
    ]
    points.sort()
    values = [value for _, value in points if not math.isnan(value)]
    if not values:
        return Roots((), math.nan, math.nan)
    roots = [λ for λ, value in points if abs(value - goal) <= tangency_rtol * abs(goal)]
    for (a, f_a), (b, f_b) in pairwise(points):
        if (f_a - goal) * (f_b - goal) < 0.0:
            root = float(brentq(lambda λ: f(λ) - goal, a, b, xtol=1e-300, rtol=1e-14))
            if all(abs(root - other) > 1e-9 * abs(root) for other in roots):
                roots.append(root)
    return Roots(tuple(sorted(roots)), min(values), max(values))


def _border(
    f: Callable[[float], float], a: tuple[float, float], b: tuple[float, float], *, domain_rtol: float = 1e-10
) -> tuple[float, float]:
    """Return the last point at which f is defined, towards one where it is not.

    ``domain_rtol``: distance to which the boundary of the domain of f is approached.
    """
    inside, outside = (b, a[0]) if math.isnan(a[1]) else (a, b[0])
    if math.isnan(inside[1]):
        return inside
    while abs(inside[0] - outside) > 1e-12 * abs(inside[0]) + domain_rtol:
        middle = 0.5 * (inside[0] + outside)
        value = f(middle)
        if math.isnan(value):
            outside = middle
        else:
            inside = (middle, value)
    return inside


def _extremum(
    f: Callable[[float], float], a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]
) -> tuple[float, float]:
    """Return the extremum about b."""
    sign = -1.0 if b[1] > a[1] else 1.0

    def upright(λ: float) -> float:
        value = f(λ)
        return math.inf if math.isnan(value) else sign * value

    found = minimize_scalar(upright, bounds=(a[0], c[0]), method="bounded", options={"xatol": 1e-9 * (c[0] - a[0])})
    best = (float(found.x), sign * float(found.fun))
    return best if upright(best[0]) < sign * b[1] else b
