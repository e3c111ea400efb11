"""Final refinement: the basic solution is recomputed from M and q, free of the rounding accumulated over the pivots."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Indices, Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.lcp.basis import basic_solution, solve_rows
from lcpimpact.lcp.judge import holds, measure
from lcpimpact.lcp.problem import FREE, UNKNOWN_SIDE
from lcpimpact.lcp.storage import absolute_product, diagonal
from lcpimpact.numerics.rounding import EPS


@compiled()
def move_to_bounds(W: Matrix, q: Vector, lower: Vector, upper: Vector, z: Vector) -> bool:
    """Set the z_i to their bounds whose distances from them are rounding errors of row i; return whether there are any.

    A row without q_i, and with such z_i alone, has no other size than that of their rounding.
    """
    n, moved = len(q), False
    terms, slope = np.empty(n), np.empty(n)
    absolute_product(W, z, terms)
    diagonal(W, slope)
    for i in range(n):
        rounding = 4.0 * n * EPS * (terms[i] + abs(q[i]))
        for bound in (lower[i], upper[i]):
            if z[i] != bound and slope[i] > 0.0 and slope[i] * abs(z[i] - bound) <= rounding:
                z[i], moved = bound, True
    return moved


@compiled()
def refine(W: Matrix, q: Vector, lower: Vector, upper: Vector, side: Indices, w: Vector, z: Vector) -> bool:
    """Correct a basic solution z by one step of iterative refinement, from w = M z + q; return False if M_αα is singular.

    Its rounding errors are then small in the units of each row, and not only in those of the largest one.
    """
    rows = np.flatnonzero(side == FREE)
    b = -w[rows]
    regular = solve_rows(W, False, rows, b)
    if regular:
        for a in range(len(rows)):
            i = rows[a]
            z[i] = min(max(z[i] + b[a], lower[i]), upper[i])
    return regular


@compiled()
def polish(W: Matrix, q: Vector, lower: Vector, upper: Vector, side: Indices, z: Vector, tol: float) -> bool:
    """Replace z by the basic solution of ``side``, refined if need be, if its residual is smaller.

    Returns whether the final z meets the tolerance.
    """
    n = len(q)
    trial, w = np.empty(n), np.empty(n)
    scaled, _, rounding = measure(W, q, lower, upper, z, w)
    found = basic_solution(W, False, q, lower, upper, side, trial)
    for i in range(n):
        trial[i] = min(max(trial[i], lower[i]), upper[i])
    for attempt in range(3):
        if found:
            finer, _, of_finer = measure(W, q, lower, upper, trial, w)
            if finer <= scaled:
                z[:] = trial
                scaled, rounding = finer, of_finer
        if holds(scaled, rounding, tol):
            return True
        if attempt == 0:
            found = found and refine(W, q, lower, upper, side, w, trial)
        else:
            trial[:] = z
            found = move_to_bounds(W, q, lower, upper, trial)
    return False


class Sides(NamedTuple):
    """Sides of the current iterate, the previous one, and the basis tried last; (n,) indices."""

    now: Indices
    before: Indices
    tried: Indices


@compiled()
def unknown_sides(n: int) -> Sides:
    """Return the initial sides."""
    return Sides(np.empty(n, np.int64), np.full(n, UNKNOWN_SIDE), np.full(n, UNKNOWN_SIDE))


@compiled()
def identified(W: Matrix, q: Vector, lower: Vector, upper: Vector, sides: Sides, z: Vector, tol: float) -> bool:
    """Return whether z, or else the basic solution of its active set, solves the problem; z is set to the solution.

    A basis is tried once, when two successive iterates agree on it.
    """
    now = sides.now
    before = sides.before
    tried = sides.tried
    scaled, _, rounding = measure(W, q, lower, upper, z, np.empty(len(q)))
    near = holds(scaled, rounding, tol)
    agreed, fresh = True, False
    for i in range(len(q)):
        agreed = agreed and now[i] == before[i]
        fresh = fresh or now[i] != tried[i]
        before[i] = now[i]
    if not near and not (agreed and fresh):
        return False
    tried[:] = now
    trial = z.copy()
    if polish(W, q, lower, upper, now, trial, tol):
        z[:] = trial
        return True
    return near
