"""Final refinement: the basis is solved again, without the accumulated rounding of pivots or iterates."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import types

from lcpimpact.arrays import Array, Indices
from lcpimpact.compiled import compiled, f8, i8, indices, matrix, vector
from lcpimpact.lcp.basis import basic_solution
from lcpimpact.lcp.judge import holds, measure


@compiled(types.boolean(matrix, vector, vector, vector, indices, vector, f8))
def polish(W: Array, q: Array, lower: Array, upper: Array, side: Indices, z: Array, tol: float) -> bool:
    """Put the basic solution of ``side`` in the place of z if its residual is smaller: what remains then is rounding.

    Returns whether what z is then holds.
    """
    n = len(q)
    exact, w = np.empty(n), np.empty(n)
    scaled, _, rounding = measure(W, q, lower, upper, z, w)
    if basic_solution(W, False, q, lower, upper, side, exact):
        for i in range(n):
            exact[i] = min(max(exact[i], lower[i]), upper[i])
        finer, _, of_finer = measure(W, q, lower, upper, exact, w)
        if finer <= scaled:
            z[:] = exact
            scaled, rounding = finer, of_finer
    return holds(scaled, rounding, tol)


class Sides(NamedTuple):
    """The sides of an iterate, of the one before, and of the basis that was tried last; (n,) indices."""

    now: Indices
    before: Indices
    tried: Indices


sides_type = types.NamedUniTuple(indices, 3, Sides)

UNKNOWN_SIDE = 2
"""Side of a row that is not known yet."""


@compiled(sides_type(i8))
def unknown_sides(n: int) -> Sides:
    """Return the sides at the start."""
    return Sides(np.empty(n, np.int64), np.full(n, UNKNOWN_SIDE), np.full(n, UNKNOWN_SIDE))


@compiled(types.boolean(matrix, vector, vector, vector, sides_type, vector, f8))
def identified(W: Array, q: Array, lower: Array, upper: Array, sides: Sides, z: Array, tol: float) -> bool:
    """Return whether z solves the problem, or its basic solution does, which then takes its place.

    A basis is tried once two iterates agree on it, and not twice.
    """
    now, before, tried = sides
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
