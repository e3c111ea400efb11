"""The last step of a pivoting method: its basis is solved anew, so that rounding does not accumulate over the pivots."""

from __future__ import annotations

import numpy as np
from numba import types

from lcpimpact.arrays import Array, Indices
from lcpimpact.compiled import compiled, indices, matrix, vector
from lcpimpact.lcp.basis import basic_solution
from lcpimpact.lcp.judge import measure


@compiled(types.void(matrix, vector, vector, vector, indices, vector))
def polish(W: Array, q: Array, lower: Array, upper: Array, side: Indices, z: Array) -> None:
    """Put the basic solution of ``side`` in the place of z if its residual is smaller: what remains then is rounding."""
    n = len(q)
    exact, w = np.empty(n), np.empty(n)
    if basic_solution(W, False, q, lower, upper, side, exact):
        for i in range(n):
            exact[i] = min(max(exact[i], lower[i]), upper[i])
        if measure(W, q, lower, upper, exact, w)[0] <= measure(W, q, lower, upper, z, w)[0]:
            z[:] = exact
