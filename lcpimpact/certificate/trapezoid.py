"""The trapezoidal rule over the steps of a run, with error bounds by the second differences of the run."""

from __future__ import annotations

import numpy as np
from numba import types

from lcpimpact.arrays import Array, Flags
from lcpimpact.compiled import compiled, f8, flags, matrix, vector
from lcpimpact.record import SLIP_RTOL

SLOPE, JUMP = 0.25, 0.6
"""Differences of a method from the trapezoidal rule, in units of h times a change and of h times a second difference;
the rule's own are 1/12 and 1/2."""

NEIGHBOURS = 5
"""Number of points on either side of a step whose second differences bound the error of the step."""

MIN_POINTS = 3
"""Maximum number of points of a run without usable second differences."""


@compiled(matrix(vector, matrix, f8))
def trapezoid_errors(h: Array, values: Array, order: float) -> Array:
    """Return bounds of the accumulated error of the trapezoidal rule after kinks and jumps (nt - 1, n).

    For smooth values the errors cancel except h/12 times the change of slope; at a jump the error is up to h/2 times the
    jump, which may appear only at the end of the next step, so the larger change of each step and the next counts. For a
    method of order 1 the bound is h times the change of the values. Up to `MIN_POINTS` points no kink is detectable.
    """
    steps, n = len(h), values.shape[1]
    left_out = np.empty((steps, n))
    for i in range(n):
        slope, few, bent, changed = 0.0, 0.0, 0.0, 0.0
        before, now = 0.0, values[min(1, steps), i] - values[0, i]
        for k in range(steps):
            after = values[k + 2, i] - values[k + 1, i] if k + 2 <= steps else now
            slope = max(slope, h[k] * max(abs(now), abs(after)))
            bend = abs(now - before)
            if k + 2 <= steps:
                bend = max(bend, abs(after - now))
            bent += h[k] * bend
            left_out[k, i] = JUMP * bent
            if order < 2.0:
                changed = max(changed, abs(values[k + 1, i] - values[0, i]))
                left_out[k, i] += h[k] * changed
            before, now = now, after
        if steps < MIN_POINTS:
            for k in range(steps + 1):
                few = max(few, abs(values[k, i]))
        for k in range(steps):
            left_out[k, i] += SLOPE * (slope + h[k] * few)
    return left_out


@compiled(matrix(vector, matrix, matrix, matrix, vector))
def out_of_balance(h: Array, x: Array, rate: Array, given: Array, start: Array) -> Array:
    """Return start + x - x(0) - ∫ rate dt - Σ given at each point but the first (nt - 1, n), by the trapezoidal rule.

    ``given`` (nt - 1, n) belongs to the steps; without rows it is zero.
    """
    sums, lack = start.copy(), np.empty((len(h), x.shape[1]))
    for k in range(len(h)):
        for i in range(x.shape[1]):
            sums[i] += x[k + 1, i] - x[k, i] - 0.5 * h[k] * (rate[k + 1, i] + rate[k, i])
            if len(given) > 0:
                sums[i] -= given[k, i]
            lack[k, i] = sums[i]
    return lack


@compiled(types.void(matrix, matrix, matrix, flags))
def changes_of_mode(r: Array, r_min: Array, r_max: Array, loud: Flags) -> None:
    """Mark in ``loud`` (nt - 1,) the steps near a change of contact activation or slip, by r and its bounds (nr, nc)."""
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
                loud[k - 1] = True
                loud[min(k, len(loud) - 1)] = True
            before = mode


@compiled(matrix(vector, matrix, matrix, matrix, matrix, flags, vector, f8))
def worst_steps(
    h: Array, x: Array, rate: Array, given: Array, kicks: Array, loud: Flags, rounding: Array, slack: float
) -> Array:
    """Return |x⁺ - x - ∫ rate dt - given| of the smooth step with the largest ratio to its limit, and that limit (2, n).

    A step is smooth if no step within `NEIGHBOURS` + 1 of it is marked in ``loud`` (nt - 1,). Its limit is the sum of the
    rounding error, ``kicks`` (nt - 1, n; none without rows), and ``slack`` h times the neighbouring second differences of
    the rate, except those that involve its own end points, and their mean.
    """
    steps, n = len(h), x.shape[1]
    quiet, count, last = np.zeros(steps, np.bool_), 0, -1
    for k in range(steps):
        if loud[k]:
            last = k
        quiet[k] = NEIGHBOURS <= k < steps - NEIGHBOURS and k - last > NEIGHBOURS + 1
    last = 2 * steps
    for k in range(steps - 1, -1, -1):
        if loud[k]:
            last = k
        quiet[k] = quiet[k] and last - k > NEIGHBOURS + 1
        count += quiet[k]
    worst = np.zeros((2, n))
    bend = np.zeros(steps + 1)
    for i in range(n):
        mean, ratio = 0.0, 0.0
        for k in range(1, steps):
            bend[k] = abs(rate[k + 1, i] - 2.0 * rate[k, i] + rate[k - 1, i])
            if quiet[k]:
                mean += bend[k] / count
        for k in range(steps):
            if not quiet[k]:
                continue
            off = x[k + 1, i] - x[k, i] - 0.5 * h[k] * (rate[k + 1, i] + rate[k, i])
            if len(given) > 0:
                off -= given[k, i]
            off = abs(off)
            if off <= rounding[i] + slack * h[k] * mean:
                continue
            around = max(max(bend[k - 2], bend[k - 3]), max(bend[k + 3], bend[k + 4]))
            limit = rounding[i] + slack * h[k] * (around + mean)
            if len(kicks) > 0:
                limit += kicks[k, i]
            if not off <= ratio * limit:
                worst[0, i], worst[1, i], ratio = off, limit, off / limit
    return worst
