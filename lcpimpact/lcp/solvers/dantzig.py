r"""Dantzig's principal pivoting between bounds, as physics engines do it: the rows are brought in one at a time.

The points (z_i, w_i) that a row allows form a staircase: down along z = lower, across w = 0, down along z = upper. A row
that lies below its own is driven up, one above it down, until it meets it; the rows already brought in stay on theirs, and
change sides where they come to a corner. For semidefinite M and for P-matrices z_r and w_r rise together, so that they do
meet it.
"""

from __future__ import annotations

import numpy as np
from numba import types

from lcpimpact.arrays import Array, Flags
from lcpimpact.compiled import compiled, f8, i8, matrix, vector
from lcpimpact.errors import Status
from lcpimpact.lcp.judge import holds, measure, proves_infeasible
from lcpimpact.lcp.lapack import EPS
from lcpimpact.lcp.operators import Property
from lcpimpact.lcp.polish import polish
from lcpimpact.lcp.problem import FREE, LOWER, SIGNATURE, UPPER
from lcpimpact.lcp.scaling import units
from lcpimpact.lcp.solver import CompiledSolver
from lcpimpact.lcp.storage import product
from lcpimpact.lcp.trace import NONE, note
from lcpimpact.lcp.transform import THRESHOLD, exchange, flags, refresh, relieve, swap

SOLVED, RAY, UNDECIDED = int(Status.SOLVED), int(Status.RAY), int(Status.UNDECIDED)
MAX_ITER, SINGULAR, INACCURATE = int(Status.MAX_ITER), int(Status.SINGULAR), int(Status.INACCURATE)

REFRESHES = 4
"""How often the point may be computed anew before its residual is taken as it is."""

ALONE, GUARDED, LAST = 0, 1, 2
"""Phases: the rows not yet brought in are ignored; they may not get worse; they are ignored again, as a last resort."""


@compiled(i8(f8, f8, f8, f8, f8))
def direction(z: float, w: float, lower: float, upper: float, tiny: float) -> int:
    """Return the way to the staircase: 1 from a point below it, -1 from one above, 0 on it to rounding."""
    if z < lower - tiny or (z < upper - tiny and w < -tiny):
        return 1
    return -1 if z > upper + tiny or (z > lower + tiny and w > tiny) else 0


@compiled(f8(f8, f8, f8))
def reach(x: float, rate: float, end: float) -> float:
    """Return when x gets to ``end``: at once if it is there or beyond, never if it does not move."""
    if x >= end:
        return 0.0
    return (end - x) / rate if rate > THRESHOLD else np.inf


@compiled(types.Tuple((f8, i8))(f8, f8, f8, f8, f8, f8))
def meeting(z: float, w: float, dz: float, dw: float, lower: float, upper: float) -> tuple[float, int]:
    """Return when and where a point that moves up meets the staircase: at a bound, or between them with w = 0."""
    ceiling, ground, crossing = reach(z, dz, upper), reach(z, dz, lower), reach(w, dw, 0.0)
    if ceiling <= max(ground, crossing):
        return ceiling, UPPER
    if ground > crossing:
        return ground, LOWER
    return crossing, (LOWER if z + crossing * dz <= lower else FREE)


@compiled(f8(f8, f8, f8, f8, f8, types.boolean))
def room(x: float, y: float, rate: float, lower: float, upper: float, free: bool) -> float:
    """Return how far a row can follow its staircase before it comes to a corner; x = z and y = w, or the reverse if free."""
    if abs(rate) <= THRESHOLD or lower == upper:
        return np.inf
    if free:
        return max(upper - y if rate > 0.0 else y - lower, 0.0) / abs(rate)
    if x == lower:
        return max(y, 0.0) / -rate if rate < 0.0 else np.inf
    if x == upper:
        return max(-y, 0.0) / rate if rate > 0.0 else np.inf
    return 0.0


@compiled(
    types.Tuple((f8, i8, i8))(matrix, vector, vector, flags, flags, vector, vector, vector, i8, i8, types.boolean)
)
def next_event(
    T: Array, x: Array, y: Array, free: Flags, guarded: Flags, step: Array, low: Array, high: Array, r: int, sign: int,
    first: bool,
) -> tuple[float, int, int]:  # fmt: skip
    """Return how far x_r moves along ``sign``, the row that ends this or NONE, and where row r meets its staircase.

    A row that is not guarded but free has its w fixed, and z within bounds. Of rows that end the motion together the one
    that changes fastest is taken, or the first.
    """
    rate = T[r, r] if T[r, r] > THRESHOLD else 0.0
    a, b, da, db = (y[r], x[r], rate, 1.0) if free[r] else (x[r], y[r], 1.0, rate)
    if sign > 0:
        length, end = meeting(a, b, da, db, low[r], high[r])
    else:
        length, end = meeting(-a, -b, da, db, -high[r], -low[r])
        end = -end
    s = r if length < np.inf else NONE
    for i in range(len(x)):
        if i == r or not (guarded[i] or free[i]):
            continue
        height = y[i] if free[i] else y[i] - step[i]
        share = room(x[i], height, sign * T[i, r], low[i], high[i], free[i])
        if share == np.inf:
            continue
        margin = 1e-12 * share + 1e-15
        tied = share <= length + margin and s != r and s != NONE
        if share < length - margin or (tied and not first and abs(T[i, r]) > abs(T[s, r])):
            length, s = share, i
    return length, s, end


@compiled(SIGNATURE)
def dantzig(W: Array, q: Array, lower: Array, upper: Array, z: Array, tol: float, max_iter: int) -> tuple[int, int]:
    """Bring in the rows without bounds, then the others, each from the z nearest to zero.

    All is in units where M has a unit diagonal and max |M z + q| = 1 at the start. When nothing ends the motion of a row and
    this proves nothing, because rows not yet brought in would end it, these are kept on staircases of their own height
    from then on; if that does not help either the row waits for the others.
    """
    n = len(q)
    T, x, y = np.empty((n, n)), np.empty(n), np.empty(n)
    unit, scale, low, high, w = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    free, settled, waiting = np.zeros(n, np.bool_), np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    guarded, step = np.zeros(n, np.bool_), np.zeros(n)
    side, basis, unshifted = np.empty(n, np.int64), np.arange(n), np.zeros(n)
    units(W, q, unit)
    size = 0.0
    for i in range(n):
        z[i] = min(max(0.0, lower[i]), upper[i])
    product(W, z, w)
    for i in range(n):
        size = max(size, max(abs(q[i]), abs(w[i] + q[i])) * unit[i])
    if size == 0.0:
        return SOLVED, 0
    for i in range(n):
        for j in range(n):
            T[i, j] = W[i, j] * unit[i] * unit[j]
        y[i] = (w[i] + q[i]) * unit[i] / size
    for i in range(n):
        scale[i] = unit[i] * size
        unit[i] = size / unit[i]
        low[i], high[i] = lower[i] / scale[i], upper[i] / scale[i]
        x[i] = min(max(0.0, low[i]), high[i])
    note(z, basis, NONE, NONE, unshifted)

    status, count, refreshes, tiny, phase = UNDECIDED, 0, 0, THRESHOLD, ALONE
    while True:
        r, complete = NONE, True
        for i in range(n):
            complete = complete and settled[i]
            if not settled[i] and not waiting[i]:
                unbounded = low[i] == -np.inf and high[i] == np.inf
                if r == NONE or (unbounded and not (low[r] == -np.inf and high[r] == np.inf)):
                    r = i
        if complete:
            if refreshes == REFRESHES:
                status = INACCURATE
                break
            refreshes += 1
            refresh(W, q, unit, scale, T, x, y, free)
            terms = 0.0
            for i in range(n):
                terms += abs(y[i] if free[i] else x[i])
            tiny = 1e-14 + 8.0 * EPS * terms
            for i in range(n):
                a, b = (y[i], x[i]) if free[i] else (x[i], y[i])
                settled[i] = direction(a, b, low[i], high[i], tiny) == 0
                complete = complete and settled[i]
            if complete:
                status = INACCURATE
                break
            continue
        if r == NONE:
            if phase == LAST:
                break
            phase = LAST
            for i in range(n):
                waiting[i] = False
            continue

        a, b = (y[r], x[r]) if free[r] else (x[r], y[r])
        sign = direction(a, b, low[r], high[r], tiny)
        if sign == 0:
            if T[r, r] > THRESHOLD and free[r] != (low[r] < a < high[r]):
                exchange(T, r)
                swap(x, y, free, r)
            x[r] = 0.0 if free[r] else min(max(x[r], low[r]), high[r])
            settled[r] = True
            continue
        for i in range(n):
            a, b = (y[i], x[i]) if free[i] else (x[i], y[i])
            guarded[i] = settled[i] or phase == GUARDED
            step[i] = 0.0 if settled[i] or direction(a, b, low[i], high[i], tiny) == 0 else b
        stalled, exchanged = 0, 0
        while True:
            length, s, end = next_event(T, x, y, free, guarded, step, low, high, r, sign, stalled > n)
            if s == NONE:
                break
            if count == max_iter:
                status = MAX_ITER
                break
            count += 1
            stalled = stalled + 1 if length <= 1e-14 else 0
            x[r] += sign * length
            for i in range(n):
                y[i] += sign * length * T[i, r]
            exchanged, entering, leaving = 0, NONE, NONE
            if s != r:
                y[s] = step[s] if not free[s] else high[s] if sign * T[s, r] > 0.0 else low[s]
                exchanged = relieve(T, x, y, free, r, s)
            else:
                bound = low[r] if end == LOWER else high[r]
                if free[r]:
                    x[r], y[r] = (0.0, y[r]) if end == FREE else (x[r], bound)
                else:
                    x[r], y[r] = (x[r], 0.0) if end == FREE else (bound, y[r])
                if free[r] != (end == FREE) and T[r, r] > THRESHOLD:
                    exchange(T, r)
                    swap(x, y, free, r)
                    exchanged = 1
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
        if s == r:
            settled[r] = True
            phase = GUARDED if phase == LAST else phase
            for i in range(n):
                waiting[i] = False
            refresh(W, q, unit, scale, T, x, y, free)
        elif s == NONE:
            for i in range(n):
                z[i] = sign * T[i, r] * scale[i] / size if free[i] and abs(T[i, r]) > THRESHOLD else 0.0
            if not free[r]:
                z[r] = sign * scale[r] / size
            if proves_infeasible(W, q, lower, upper, z):
                return RAY, count
            waiting[r] = phase != ALONE
            phase = GUARDED if phase == ALONE else phase
        else:
            status = SINGULAR
            break

    regular = True
    for i in range(n):
        z[i] = min(max(scale[i] * (y[i] if free[i] else x[i]), lower[i]), upper[i])
        side[i] = FREE if free[i] else LOWER if x[i] == low[i] else UPPER
        regular = regular and (free[i] or x[i] == low[i] or x[i] == high[i])
    if status != MAX_ITER:
        if regular:
            polish(W, q, lower, upper, side, z)
        scaled, _, rounding = measure(W, q, lower, upper, z, w)
        status = SOLVED if holds(scaled, rounding, tol) else status
    return status, count


SOLVER = CompiledSolver(
    name="dantzig",
    summary="principal pivoting between bounds, the rows brought in one at a time, as in physics engines",
    requires=(Property.PSD,),
    storages=("dense",),
    boxed=True,
    tol=1e-10,
    max_iter=10_000,
    source="Cottle and Dantzig (1968); Baraff (1994) for bounds",
    kernel=dantzig,
)
