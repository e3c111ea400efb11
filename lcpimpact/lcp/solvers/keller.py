"""Keller's principal pivoting: one negative w after another is driven up to zero, and what is not negative stays so.

It takes positive semidefinite M, symmetric or not: where a pivot of the diagonal vanishes, two pairs are exchanged at once.
"""

from __future__ import annotations

import numpy as np
from numba import types

from lcpimpact.arrays import Array
from lcpimpact.compiled import compiled, f8, i8, matrix, vector
from lcpimpact.errors import Status
from lcpimpact.lcp.judge import holds, measure, proves_infeasible
from lcpimpact.lcp.lapack import EPS
from lcpimpact.lcp.operators import Property
from lcpimpact.lcp.polish import polish
from lcpimpact.lcp.problem import FREE, LOWER, SIGNATURE
from lcpimpact.lcp.scaling import units
from lcpimpact.lcp.solver import CompiledSolver
from lcpimpact.lcp.trace import NONE, note
from lcpimpact.lcp.transform import THRESHOLD, exchange, refresh, relieve, swap

SOLVED, RAY, UNDECIDED = int(Status.SOLVED), int(Status.RAY), int(Status.UNDECIDED)
MAX_ITER, SINGULAR, INACCURATE = int(Status.MAX_ITER), int(Status.SINGULAR), int(Status.INACCURATE)

REFRESHES = 4
"""How often the point may be computed anew before its residual is taken as it is."""

HELD = -2.0
"""Where a negative variable is held while another is driven: less than any is at first, in units of max |q|."""


@compiled(types.Tuple((f8, i8))(matrix, vector, vector, vector, i8, types.boolean))
def next_event(T: Array, x: Array, y: Array, floor: Array, r: int, first: bool) -> tuple[float, int]:
    """Return how far x_r grows, and the pair that ends this, r if min(x_r, y_r) = 0 does, or NONE.

    Of pairs that end it together the one whose y falls fastest is taken, or the first.
    """
    length, s = np.inf, NONE
    if y[r] >= 0.0:
        length, s = max(-x[r], 0.0), r
    elif T[r, r] > THRESHOLD:
        length, s = -y[r] / T[r, r], r
    for i in range(len(x)):
        if i == r or T[i, r] >= -THRESHOLD:
            continue
        share = max(y[i] - floor[i], 0.0) / -T[i, r]
        margin = 1e-12 * share + 1e-15
        tied = share <= length + margin and s != r and s != NONE
        if share < length - margin or (tied and not first and T[i, r] < T[s, r]):
            length, s = share, i
    return length, s


@compiled(SIGNATURE)
def keller(W: Array, q: Array, lower: Array, upper: Array, z: Array, tol: float, max_iter: int) -> tuple[int, int]:
    """Let x_r grow until the negative member of its pair is zero; pairs whose y ends this on the way are exchanged.

    The pair is at first (z_r, w_r) with the most negative w_r. All is in units where M has a unit diagonal and max |q| = 1.
    After n steps of no length the least index is taken, with which the method cannot cycle. If nothing ends the growth of
    x_r, that proves that there is no solution.
    """
    n = len(q)
    T, x, y = np.empty((n, n)), np.zeros(n), np.empty(n)
    unit, scale, floor, w = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    free, side, basis, unshifted = np.zeros(n, np.bool_), np.empty(n, np.int64), np.arange(n), np.zeros(n)
    units(W, q, unit)
    size = 0.0
    for i in range(n):
        size = max(size, abs(q[i]) * unit[i])
        z[i] = 0.0
    if size == 0.0:
        return SOLVED, 0
    for i in range(n):
        for j in range(n):
            T[i, j] = W[i, j] * unit[i] * unit[j]
        y[i] = q[i] * unit[i] / size
    for i in range(n):
        scale[i] = unit[i] * size
        unit[i] = size / unit[i]
    note(z, basis, NONE, NONE, unshifted)

    status, count, refreshes, tiny = UNDECIDED, 0, 0, THRESHOLD
    while True:
        r, least = NONE, -tiny
        for i in range(n):
            if min(x[i], y[i]) < least:
                r, least = i, min(x[i], y[i])
        if r == NONE:
            if refreshes == REFRESHES:
                status = INACCURATE
                break
            refreshes += 1
            refresh(W, q, unit, scale, T, x, y, free)
            terms = 0.0
            for i in range(n):
                terms += abs(y[i] if free[i] else x[i])
            tiny = 1e-14 + 8.0 * EPS * terms
            continue

        stalled, s, exchanged = 0, NONE, 0
        while True:
            for i in range(n):
                floor[i] = 0.0 if y[i] >= -tiny else HELD
            length, s = next_event(T, x, y, floor, r, stalled > n)
            if s == NONE:
                break
            if count == max_iter:
                status = MAX_ITER
                break
            count += 1
            stalled = stalled + 1 if length <= 1e-14 else 0
            rising = y[r] < 0.0
            x[r] += length
            for i in range(n):
                y[i] += length * T[i, r]
            exchanged, entering, leaving = 0, NONE, NONE
            if s != r:
                y[s] = floor[s]
                exchanged = relieve(T, x, y, free, r, s)
            elif rising:
                y[r] = 0.0
                exchange(T, r)
                swap(x, y, free, r)
                exchanged = 1
            else:
                x[r] = 0.0
            if exchanged == 1:
                entering, leaving = (n + s, s) if free[s] else (s, n + s)
            for i in range(n):
                z[i] = scale[i] * (y[i] if free[i] else x[i])
                basis[i] = n + i if free[i] else i
            note(z, basis, entering, leaving, unshifted)
            if s == r or exchanged == 0:
                break
        if status == MAX_ITER:
            break
        if s == NONE:
            for i in range(n):
                z[i] = T[i, r] * scale[i] / size if free[i] and T[i, r] > THRESHOLD else 0.0
            if not free[r]:
                z[r] = scale[r] / size
            if proves_infeasible(W, q, lower, upper, z):
                return RAY, count
            break
        if s != r:
            status = SINGULAR
            break
        refresh(W, q, unit, scale, T, x, y, free)

    for i in range(n):
        z[i] = max(scale[i] * (y[i] if free[i] else x[i]), 0.0)
        side[i] = FREE if free[i] else LOWER
    if status != MAX_ITER:
        polish(W, q, lower, upper, side, z)
        scaled, _, rounding = measure(W, q, lower, upper, z, w)
        status = SOLVED if holds(scaled, rounding, tol) else status
    return status, count


SOLVER = CompiledSolver(
    name="keller",
    summary="principal pivoting with 1x1 and 2x2 exchanges; semidefinite M, symmetric or not",
    requires=(Property.PSD,),
    storages=("dense",),
    boxed=False,
    tol=1e-10,
    max_iter=10_000,
    source="Keller (1973); Cottle, Pang and Stone (1992), section 4.3; Cottle and Chang (1992) for the least index",
    kernel=keller,
)
