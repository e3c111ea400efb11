"""Gaussian elimination for the small systems inside LCP solvers."""

from __future__ import annotations

import numpy as np
from numba import types

from lcpimpact.arrays import Array, Indices
from lcpimpact.compiled import compiled, indices, matrix, vector


@compiled(types.boolean(matrix, vector))
def eliminate(A: Array, b: Array) -> bool:
    """Overwrite b with A⁻¹ b, and A with its elimination; return False if A is singular to rounding."""
    n = len(b)
    scale = 0.0
    for i in range(n):
        for j in range(n):
            scale = max(scale, abs(A[i, j]))
    for k in range(n):
        p = k
        for i in range(k + 1, n):
            if abs(A[i, k]) > abs(A[p, k]):
                p = i
        if not abs(A[p, k]) > 1e-14 * scale:
            return False
        for j in range(n):
            A[k, j], A[p, j] = A[p, j], A[k, j]
        b[k], b[p] = b[p], b[k]
        for i in range(k + 1, n):
            factor = A[i, k] / A[k, k]
            for j in range(k, n):
                A[i, j] -= factor * A[k, j]
            b[i] -= factor * b[k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            b[k] -= A[k, j] * b[j]
        b[k] /= A[k, k]
    return True


@compiled(types.boolean(matrix, vector, indices, vector))
def solve_basis(M: Array, q: Array, support: Indices, z: Array) -> bool:
    """Set z to the basic solution M_αα z_α = -q_α, zero elsewhere, for α = support; return False if M_αα is singular."""
    k = len(support)
    block = np.empty((k, k))
    right = np.empty(k)
    for a in range(k):
        right[a] = -q[support[a]]
        for b in range(k):
            block[a, b] = M[support[a], support[b]]
    regular = eliminate(block, right)
    z[:] = 0.0
    if regular:
        for a in range(k):
            z[support[a]] = right[a]
    return regular
