"""The last step of a pivoting method: its basis is solved anew, so that rounding does not accumulate over the pivots."""

from __future__ import annotations

import numpy as np
from numba import types

from lcpimpact.arrays import Array, Indices
from lcpimpact.compiled import compiled, f8, indices, matrix, vector
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
