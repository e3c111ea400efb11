r"""Dantzig's principal pivoting method with bounds, as in physics engines: the rows are added one at a time.

The complementary points (z_i, w_i) of a row form a staircase: down along z = lower, across w = 0, down along z = upper. A
row below its staircase is driven up, a row above it down, until it is reached; rows already added follow theirs and change
sides at corners. For semidefinite M and for P-matrices z_r and w_r increase together, so the staircase is reached.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Flags, Indices, Matrix, Vector
from lcpimpact.compiled import FEW_ROWS, compiled
from lcpimpact.errors import Status
from lcpimpact.lcp.judge import proves_infeasible
from lcpimpact.lcp.operators import Property
from lcpimpact.lcp.pivoting import (
    MAX_REFRESHES,
    PIVOT_TOL,
    PivotTableau,
    advance,
    direction_of,
    ends_before,
    finish,
    pair,
    pivot,
    record,
    refresh,
    relieve,
    scaled_tableau,
)
from lcpimpact.lcp.problem import FREE, LOWER, UPPER
from lcpimpact.lcp.solver import CompiledSolver
from lcpimpact.lcp.trace import NONE, note

SOLVED = int(Status.SOLVED)
RAY = int(Status.RAY)
UNDECIDED = int(Status.UNDECIDED)
MAX_ITER = int(Status.MAX_ITER)
SINGULAR = int(Status.SINGULAR)
INACCURATE = int(Status.INACCURATE)

ALL_SETTLED = -2
"""Return value of `next_row` when every row has been added."""


class Phase(IntEnum):
    """Phases of a pass: rows not yet added are ignored, must not move further away, or are ignored as a last resort."""

    IGNORED = 0
    GUARDED = 1
    LAST = 2


@compiled()
def direction(z: float, w: float, lower: float, upper: float, tiny: float) -> int:
    """Return the direction to the staircase: 1 from below, -1 from above, 0 on it to rounding."""
    if z < lower - tiny or (z < upper - tiny and w < -tiny):
        return 1
    return -1 if z > upper + tiny or (z > lower + tiny and w > tiny) else 0


@compiled()
def reach(x: float, rate: float, end: float) -> float:
    """Return the step length at which x reaches ``end``: 0 if it is there or beyond, inf if it does not move."""
    if x >= end:
        return 0.0
    return (end - x) / rate if rate > PIVOT_TOL else np.inf


@compiled()
def length_to_staircase(z: float, w: float, dz: float, dw: float, lower: float, upper: float) -> tuple[float, int]:
    """Return the step length and side at which an upward moving point reaches the staircase."""
    ceiling = reach(z, dz, upper)
    ground = reach(z, dz, lower)
    crossing = reach(w, dw, 0.0)
    if ceiling <= max(ground, crossing):
        return ceiling, UPPER
    if ground > crossing:
        return ground, LOWER
    return crossing, (LOWER if z + crossing * dz <= lower else FREE)


@compiled()
def length_to_corner(x: float, y: float, rate: float, lower: float, upper: float, free: bool) -> float:
    """Return the step length to the next corner of a row's staircase; x = z and y = w, or the reverse if free."""
    if abs(rate) <= PIVOT_TOL or lower == upper:
        return np.inf
    if free:
        return max(upper - y if rate > 0.0 else y - lower, 0.0) / abs(rate)
    if x == lower:
        return max(y, 0.0) / -rate if rate < 0.0 else np.inf
    if x == upper:
        return max(-y, 0.0) / rate if rate > 0.0 else np.inf
    return 0.0


class Rows(NamedTuple):
    """The staircases of the rows, and the state of each row.

    Attributes
    ----------
    low, high : (n,) arrays     bounds of z, in its unit
    settled : (n,) flags        rows on their staircase
    deferred : (n,) flags       rows whose motion was unbounded, to be tried again after another row
    step : (n,) array           level of w on the staircase that a row follows, inf if it is not constrained
    """

    low: Vector
    high: Vector
    settled: Flags
    deferred: Flags
    step: Vector


@compiled(inline="always")
def rows_of(lower: Vector, upper: Vector, z_unit: Vector) -> Rows:
    """Return the rows, none added."""
    n = len(lower)
    return Rows(lower / z_unit, upper / z_unit, np.zeros(n, np.bool_), np.zeros(n, np.bool_), np.empty(n))


@compiled(inline="always")
def next_row(rows: Rows) -> int:
    """Return the next row to add, rows without bounds first; NONE if all are deferred, or ALL_SETTLED."""
    low = rows.low
    high = rows.high
    settled = rows.settled
    deferred = rows.deferred
    r, found = NONE, ALL_SETTLED
    for i in range(len(low)):
        if not settled[i]:
            found = NONE
            if not deferred[i]:
                if low[i] == -np.inf and high[i] == np.inf:
                    return i
                r = i if r == NONE else r
    return r if r != NONE else found


@compiled()
def all_settled(tableau: PivotTableau, rows: Rows, tiny: float) -> bool:
    """Recompute the settled rows, and return whether all are."""
    x = tableau.x
    y = tableau.y
    free = tableau.free
    low = rows.low
    high = rows.high
    settled = rows.settled
    complete = True
    for i in range(len(x)):
        z, w = pair(x[i], y[i], free[i])
        settled[i] = direction(z, w, low[i], high[i], tiny) == 0
        complete = complete and settled[i]
    return complete


@compiled(inline="always")
def settle(tableau: PivotTableau, rows: Rows, r: int) -> None:
    """Place row r, which is on its staircase to rounding, exactly on it, and free it if between its bounds."""
    T = tableau.T
    x = tableau.x
    y = tableau.y
    free = tableau.free
    if T[r, r] > PIVOT_TOL and free[r] != (rows.low[r] < pair(x[r], y[r], free[r])[0] < rows.high[r]):
        pivot(tableau, r)
    x[r] = 0.0 if free[r] else min(max(x[r], rows.low[r]), rows.high[r])
    rows.settled[r] = True


@compiled(inline="always")
def guard(tableau: PivotTableau, rows: Rows, everyone: bool, tiny: float) -> None:
    """Set the staircases of the settled rows, or of all rows, each at its current level."""
    x = tableau.x
    y = tableau.y
    free = tableau.free
    low = rows.low
    high = rows.high
    settled = rows.settled
    step = rows.step
    for i in range(len(x)):
        z, w = pair(x[i], y[i], free[i])
        if settled[i]:
            step[i] = 0.0
        else:
            on = everyone and direction(z, w, low[i], high[i], tiny) == 0
            step[i] = 0.0 if on else w if everyone else np.inf


@compiled(inline="always")
def next_event(tableau: PivotTableau, rows: Rows, r: int, sign: int, first: bool) -> tuple[float, int, int]:
    """Return the step length of x_r along ``sign``, the blocking row or NONE, and the side where row r would settle.

    A free row without a staircase keeps its w, and its z stays within bounds. Ties are broken by the fastest rate, or with
    ``first`` by the smallest index.
    """
    T = tableau.T
    x = tableau.x
    y = tableau.y
    free = tableau.free
    low = rows.low
    high = rows.high
    step = rows.step
    rate = T[r, r] if T[r, r] > PIVOT_TOL else 0.0
    z, w = pair(x[r], y[r], free[r])
    dz, dw = (rate, 1.0) if free[r] else (1.0, rate)
    if sign > 0:
        length, end = length_to_staircase(z, w, dz, dw, low[r], high[r])
    else:
        length, end = length_to_staircase(-z, -w, dz, dw, -high[r], -low[r])
        end = -end
    s, fastest = r if length < np.inf else NONE, np.inf
    for i in range(len(x)):
        if i != r and (step[i] < np.inf or free[i]):
            height = y[i] if free[i] else y[i] - step[i]
            blocking_length = length_to_corner(x[i], height, sign * T[i, r], low[i], high[i], free[i])
            if blocking_length < np.inf and ends_before(blocking_length, length, abs(T[i, r]), fastest):
                length = blocking_length
                s = i
                fastest = np.inf if first else abs(T[i, r])
    return length, s, end


@compiled(inline="always")
def place_on_staircase(tableau: PivotTableau, rows: Rows, r: int, end: int) -> int:
    """Place row r on its staircase, at a bound or between bounds; return the number of pairs exchanged."""
    T = tableau.T
    x = tableau.x
    y = tableau.y
    free = tableau.free
    bound = rows.low[r] if end == LOWER else rows.high[r]
    if (end == FREE) == free[r]:
        x[r] = 0.0 if free[r] else bound
        return 0
    y[r] = bound if free[r] else 0.0
    return pivot(tableau, r) if T[r, r] > PIVOT_TOL else 0


@compiled(inline="always")
def drive(
    tableau: PivotTableau, rows: Rows, r: int, sign: int, z: Vector, basis: Indices, count: int, max_iter: int
) -> tuple[int, int]:
    """Move x_r along ``sign`` until row r reaches its staircase; rows that reach a corner change sides.

    Returns SOLVED, RAY if the motion is unbounded, SINGULAR or MAX_ITER, and the number of moves.
    """
    T = tableau.T
    y = tableau.y
    free = tableau.free
    stalled = 0
    while True:
        length, s, end = next_event(tableau, rows, r, sign, stalled > len(y))
        if s == NONE:
            return RAY, count
        if count == max_iter:
            return MAX_ITER, count
        count += 1
        stalled = stalled + 1 if length <= 1e-14 else 0
        advance(tableau, r, sign * length)
        if s == r:
            exchanged = place_on_staircase(tableau, rows, r, end)
        else:
            y[s] = rows.step[s] if not free[s] else rows.high[s] if sign * T[s, r] > 0.0 else rows.low[s]
            exchanged = relieve(tableau, r, s)
        record(tableau, s, exchanged, z, basis)
        if s == r or exchanged == 0:
            return (SOLVED if s == r else SINGULAR), count


@compiled(most=FEW_ROWS)
def dantzig(
    W: Matrix, q: Vector, lower: Vector, upper: Vector, z: Vector, tol: float, max_iter: int
) -> tuple[int, int]:
    """Add the rows without bounds, then the others, each starting from the z nearest to zero.

    An unbounded motion is inconclusive if rows not yet added would block it. These are then kept on staircases at their
    current level; if that does not help either, the row is deferred until another one is added.
    """
    tableau = scaled_tableau(W, q, lower, upper, z)
    if tableau.size == 0.0:
        return SOLVED, 0
    rows = rows_of(lower, upper, tableau.z_unit)
    basis = np.arange(len(q))
    note(z, basis, NONE, NONE)
    status = UNDECIDED
    count = 0
    refreshes = 0
    tiny = PIVOT_TOL
    phase = Phase.IGNORED
    while True:
        r = next_row(rows)
        if r == ALL_SETTLED:
            status = INACCURATE
            if refreshes == MAX_REFRESHES:
                break
            refreshes += 1
            tiny = refresh(W, q, tableau)
            if all_settled(tableau, rows, tiny):
                break
            continue
        if r == NONE:
            status = UNDECIDED
            if phase == Phase.LAST:
                break
            phase = Phase.LAST
            for i in range(len(q)):
                rows.deferred[i] = False
            continue
        z_r, w_r = pair(tableau.x[r], tableau.y[r], tableau.free[r])
        sign = direction(z_r, w_r, rows.low[r], rows.high[r], tiny)
        if sign == 0:
            settle(tableau, rows, r)
            continue
        guard(tableau, rows, phase == Phase.GUARDED, tiny)
        status, count = drive(tableau, rows, r, sign, z, basis, count, max_iter)
        if status == SOLVED:
            rows.settled[r] = True
            for i in range(len(q)):
                rows.deferred[i] = False
            phase = Phase.GUARDED if phase == Phase.LAST else phase
            refresh(W, q, tableau)
        elif status == RAY:
            direction_of(tableau, r, sign, z)
            if proves_infeasible(W, q, lower, upper, z):
                return RAY, count
            rows.deferred[r] = phase != Phase.IGNORED
            phase = Phase.GUARDED if phase == Phase.IGNORED else phase
        else:
            break
    return finish(W, q, lower, upper, tableau, z, tol, status), count


SOLVER = CompiledSolver(
    name="dantzig",
    summary="principal pivoting between bounds, the rows brought in one at a time, as in physics engines",
    requires=(Property.PSD,),
    storages=("dense",),
    boxed=True,
    tol=1e-10,
    max_iter=10_000,
    source="CottleDantzig1968; Baraff1994, for bounds",
    kernel=dantzig,
)
