"""Final refinement: the basic solution is recomputed from M and q, free of the rounding accumulated over the pivots."""

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
    """Replace z by the basic solution of ``side`` if its residual is smaller.

    Returns whether the final z meets the tolerance.
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
    """Sides of the current iterate, the previous one, and the basis tried last; (n,) indices."""

    now: Indices
    before: Indices
    tried: Indices


sides_type = types.NamedUniTuple(indices, 3, Sides)

UNKNOWN_SIDE = 2
"""Side of a row not yet identified."""


@compiled(sides_type(i8))
def unknown_sides(n: int) -> Sides:
    """Return the initial sides."""
    return Sides(np.empty(n, np.int64), np.full(n, UNKNOWN_SIDE), np.full(n, UNKNOWN_SIDE))


@compiled(types.boolean(matrix, vector, vector, vector, sides_type, vector, f8))
def identified(W: Array, q: Array, lower: Array, upper: Array, sides: Sides, z: Array, tol: float) -> bool:
    """Return whether z, or else the basic solution of its active set, solves the problem; z is set to the solution.

    A basis is tried once, when two successive iterates agree on it.
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
