"""Keller's principal pivoting method: each negative w is driven to zero while the others stay non-negative.

M is positive semidefinite, symmetric or not: where a diagonal pivot vanishes, a 2 by 2 block pivot is made.
"""

from __future__ import annotations

import numpy as np

from lcpimpact.arrays import Indices, Matrix, Vector
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
    pivot,
    record,
    refresh,
    relieve,
    scaled_tableau,
)
from lcpimpact.lcp.solver import CompiledSolver
from lcpimpact.lcp.trace import NONE, note

SOLVED = int(Status.SOLVED)
RAY = int(Status.RAY)
UNDECIDED = int(Status.UNDECIDED)
MAX_ITER = int(Status.MAX_ITER)
SINGULAR = int(Status.SINGULAR)
INACCURATE = int(Status.INACCURATE)

HELD_LEVEL = -2.0
"""Lower bound of negative variables while another is driven, in units of max |q|: below any initial value."""


@compiled()
def most_negative(tableau: PivotTableau, tiny: float) -> int:
    """Return the pair with the most negative variable, or NONE if all are non-negative to rounding."""
    r, least = NONE, -tiny
    for i in range(len(tableau.x)):
        if min(tableau.x[i], tableau.y[i]) < least:
            r, least = i, min(tableau.x[i], tableau.y[i])
    return r


@compiled()
def floor(y: float, tiny: float) -> float:
    """Return the lower bound of y in the ratio test."""
    return 0.0 if y >= -tiny else HELD_LEVEL


@compiled()
def ratio_test(T: Matrix, x: Vector, y: Vector, r: int, tiny: float, first: bool) -> tuple[float, int]:
    """Return the increase of x_r and the blocking pair: r if min(x_r, y_r) reaches 0, or NONE.

    Ties are broken by the fastest decrease of y, or with ``first`` by the smallest index.
    """
    length = np.inf
    s = NONE
    fastest = np.inf
    if y[r] >= 0.0:
        length, s = max(-x[r], 0.0), r
    elif T[r, r] > PIVOT_TOL:
        length, s = -y[r] / T[r, r], r
    for i in range(len(x)):
        if i != r and T[i, r] < -PIVOT_TOL:
            share = max(y[i] - floor(y[i], tiny), 0.0) / -T[i, r]
            if ends_before(share, length, -T[i, r], fastest):
                length = share
                s = i
                fastest = np.inf if first else -T[i, r]
    return length, s


@compiled()
def drive(
    tableau: PivotTableau, r: int, tiny: float, z: Vector, basis: Indices, count: int, max_iter: int
) -> tuple[int, int]:
    """Increase x_r until the negative variable of its pair is zero, pivoting on blocking pairs.

    Returns SOLVED, RAY if the increase is unbounded, SINGULAR or MAX_ITER, and the number of moves.
    """
    T = tableau.T
    x = tableau.x
    y = tableau.y
    stalled = 0
    while True:
        length, s = ratio_test(T, x, y, r, tiny, stalled > len(x))
        if s == NONE:
            return RAY, count
        if count == max_iter:
            return MAX_ITER, count
        count += 1
        stalled = stalled + 1 if length <= 1e-14 else 0
        rising, least = y[r] < 0.0, floor(y[s], tiny)
        advance(tableau, r, length)
        exchanged = 0
        if s != r:
            y[s] = least
            exchanged = relieve(tableau, r, s)
        elif rising:
            y[r] = 0.0
            exchanged = pivot(tableau, r)
        else:
            x[r] = 0.0
        record(tableau, s, exchanged, z, basis)
        if s == r or exchanged == 0:
            return (SOLVED if s == r else SINGULAR), count


@compiled(most=FEW_ROWS)
def keller(W: Matrix, q: Vector, lower: Vector, upper: Vector, z: Vector, tol: float, max_iter: int) -> tuple[int, int]:
    """Drive the most negative variable of a pair to zero, at first a w_r, until none is negative.

    After n degenerate steps the least-index rule is used, with which the method cannot cycle. An unbounded increase of x_r
    certifies infeasibility.
    """
    tableau = scaled_tableau(W, q, lower, upper, z)
    if tableau.size == 0.0:
        return SOLVED, 0
    basis = np.arange(len(q))
    note(z, basis, NONE, NONE)
    count = 0
    refreshes = 0
    tiny = PIVOT_TOL
    while True:
        r = most_negative(tableau, tiny)
        if r == NONE:
            if refreshes == MAX_REFRESHES:
                status = INACCURATE
                break
            refreshes += 1
            tiny = refresh(W, q, tableau)
            continue
        status, count = drive(tableau, r, tiny, z, basis, count, max_iter)
        if status == RAY:
            direction_of(tableau, r, 1, z)
            if proves_infeasible(W, q, lower, upper, z):
                return RAY, count
            status = UNDECIDED
        if status != SOLVED:
            break
        refresh(W, q, tableau)
    return finish(W, q, lower, upper, tableau, z, tol, status), count


SOLVER = CompiledSolver(
    name="keller",
    summary="principal pivoting with 1x1 and 2x2 exchanges; semidefinite M, symmetric or not",
    requires=(Property.PSD,),
    storages=("dense",),
    boxed=False,
    tol=1e-10,
    max_iter=10_000,
    source="Keller1973; CottlePangStone2009, section 4.3; CottleChang1992, for the least index",
    kernel=keller,
)
