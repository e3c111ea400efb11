"""The units in which a method works: those that give M a unit diagonal."""

from __future__ import annotations

import numpy as np
from numba import types

from lcpimpact.arrays import Array
from lcpimpact.compiled import compiled, matrix, vector


@compiled(types.void(matrix, vector, vector))
def units(M: Array, q: Array, unit: Array) -> None:
    """Set ``unit`` to the D that gives D M D a unit diagonal, or a largest entry near one where M_ii <= 0."""
    n = len(q)
    for i in range(n):
        size = M[i, i]
        if not size > 0.0:
            size = 0.0
            for j in range(n):
                size = max(size, max(abs(M[i, j]), abs(M[j, i])))
        unit[i] = 1.0 / np.sqrt(size) if size > 0.0 else 1.0
