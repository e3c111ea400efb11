"""The trapezoidal rule over the steps of a run, with error bounds by the second differences of the run."""

from __future__ import annotations

import numpy as np

from lcpimpact.arrays import Array, Flags, Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.record import SLIP_RTOL

SLOPE_FACTOR, JUMP_FACTOR = 0.25, 0.6
"""Allowed differences of a method from the trapezoidal rule, in units of h times a first and a second difference; those of
the rule itself are 1/12 and 1/2."""

NEIGHBOURS = 5
"""Number of points on either side of a step whose second differences bound the error of the step."""

MIN_POINTS = 3
"""Maximum number of points of a run without usable second differences."""


@compiled()
def trapezoid_errors(h: Vector, values: Matrix, order: float) -> Matrix:
    """Return bounds of the accumulated error of the trapezoidal rule after kinks and jumps (nt - 1, n).

    For smooth values the errors cancel except h/12 times the change of slope; at a jump the error is up to h/2 times the
    jump, which may appear only at the end of the next step, so the larger change of each step and the next counts. For a
    method of order 1 the bound is h times the change of the values. Up to `MIN_POINTS` points no kink is detectable.
    """
    steps, n = len(h), values.shape[1]
    bounds = np.empty((steps, n))
    for i in range(n):
        slope = 0.0
        largest = 0.0
        curvature = 0.0
        variation = 0.0
        before, now = 0.0, values[min(1, steps), i] - values[0, i]
        for k in range(steps):
            after = values[k + 2, i] - values[k + 1, i] if k + 2 <= steps else now
            slope = max(slope, h[k] * max(abs(now), abs(after)))
            second_difference = abs(now - before)
            if k + 2 <= steps:
                second_difference = max(second_difference, abs(after - now))
            curvature += h[k] * second_difference
            bounds[k, i] = JUMP_FACTOR * curvature
            if order < 2.0:
                variation = max(variation, abs(values[k + 1, i] - values[0, i]))
                bounds[k, i] += h[k] * variation
            before, now = now, after
        if steps < MIN_POINTS:
            for k in range(steps + 1):
                largest = max(largest, abs(values[k, i]))
        for k in range(steps):
            bounds[k, i] += SLOPE_FACTOR * (slope + h[k] * largest)
    return bounds


def trapezoids(h: Array, rate: Array) -> Array:
    """Return ∫ rate dt of each step h (steps, 1) by the trapezoidal rule (steps, n), for the rate at its ends (nt, n)."""
    return np.asarray(0.5 * h * (rate[1:] + rate[:-1]))


@compiled()
def mark_mode_changes(r: Matrix, r_min: Matrix, r_max: Matrix, nonsmooth: Flags) -> None:
    """Mark in ``nonsmooth`` (nt - 1,) the steps near a change of contact activation or slip, by r and bounds (nr, nc)."""
    for i in range(r.shape[1]):
        before = 0
        for k in range(len(r)):
            if r_max[k, i] < np.inf:
                mode = (
                    1
                    if r[k, i] >= r_max[k, i] * (1.0 - SLIP_RTOL)
                    else -1
                    if r[k, i] <= r_min[k, i] * (1.0 - SLIP_RTOL)
                    else 0
                )
            else:
                mode = 1 if r[k, i] != 0.0 else 0
            if k > 0 and mode != before:
                nonsmooth[k - 1] = True
                nonsmooth[min(k, len(nonsmooth) - 1)] = True
            before = mode


@compiled()
def largest_step_errors(
    h: Vector, off: Matrix, rate: Matrix, margins: Matrix, nonsmooth: Flags, rounding: Vector, slack: float
) -> Matrix:
    """Return the imbalance |off| of the smooth step with the largest ratio to its limit, and that limit (2, n).

    An imbalance is that of a quantity with its given ``rate`` by the trapezoidal rule.
    A step is smooth if no step within `NEIGHBOURS` + 1 of it is marked in ``nonsmooth`` (nt - 1,). Its limit is the sum of
    the rounding error, ``margins`` (nt - 1, n; zero without rows), and ``slack`` h times the neighbouring second differences
    of the rate, except those that involve its own end points, plus their mean.
    """
    steps, n = off.shape
    smooth = np.zeros(steps, np.bool_)
    count = 0
    last = -1
    for k in range(steps):
        if nonsmooth[k]:
            last = k
        smooth[k] = NEIGHBOURS <= k < steps - NEIGHBOURS and k - last > NEIGHBOURS + 1
    last = 2 * steps
    for k in range(steps - 1, -1, -1):
        if nonsmooth[k]:
            last = k
        smooth[k] = smooth[k] and last - k > NEIGHBOURS + 1
        count += smooth[k]
    largest_errors = np.zeros((2, n))
    second_difference = np.zeros(steps + 1)
    for i in range(n):
        mean, ratio = 0.0, 0.0
        for k in range(1, steps):
            second_difference[k] = abs(rate[k + 1, i] - 2.0 * rate[k, i] + rate[k - 1, i])
            if smooth[k]:
                mean += second_difference[k] / count
        for k in range(steps):
            if not smooth[k]:
                continue
            error = abs(off[k, i])
            if error <= rounding[i] + slack * h[k] * mean:
                continue
            neighbours = max(
                max(second_difference[k - 2], second_difference[k - 3]),
                max(second_difference[k + 3], second_difference[k + 4]),
            )
            limit = rounding[i] + slack * h[k] * (neighbours + mean)
            if len(margins) > 0:
                limit += margins[k, i]
            if not error <= ratio * limit:
                largest_errors[0, i] = error
                largest_errors[1, i] = limit
                ratio = error / limit
    return largest_errors
