"""Lemke's complementary pivoting with the lexicographic rule, which cannot cycle."""

from __future__ import annotations

import numpy as np
from numba import types

from lcpimpact.arrays import Array, Indices
from lcpimpact.compiled import compiled, f8, i8, indices, matrix, vector
from lcpimpact.errors import Status
from lcpimpact.lcp.gauss import solve_basis
from lcpimpact.lcp.problem import scaled_residual
from lcpimpact.lcp.solver import CompiledSolver

SOLVED, RAY, MAX_ITER = int(Status.SOLVED), int(Status.RAY), int(Status.MAX_ITER)


@compiled(types.void(matrix, i8, i8))
def pivot(tableau: Array, row: int, column: int) -> None:
    """Exchange: make ``column`` the unit vector of ``row``."""
    width = tableau.shape[1]
    scale = 1.0 / tableau[row, column]
    for j in range(width):
        tableau[row, j] *= scale
    tableau[row, column] = 1.0
    for i in range(tableau.shape[0]):
        factor = tableau[i, column]
        if i != row and factor != 0.0:
            for j in range(width):
                tableau[i, j] -= factor * tableau[row, j]
            tableau[i, column] = 0.0


@compiled(i8(matrix, indices, i8, f8))
def blocking_row(tableau: Array, basis: Indices, column: int, threshold: float) -> int:
    """Return the row that blocks the entering column, or -1 for a ray.

    The ratio test is lexicographic: ties in the right side are broken by the rows of the inverse basis, which stand in
    the columns of w. The covering variable z0 leaves whenever it can, since that ends the method.
    """
    n = tableau.shape[0]
    covering, right = 2 * n, 2 * n + 1
    best = -1
    for i in range(n):
        if tableau[i, column] <= threshold:
            continue
        if best < 0:
            best = i
            continue
        for level in range(n + 1):
            j = right if level == 0 else level - 1
            new = tableau[i, j] / tableau[i, column]
            old = tableau[best, j] / tableau[best, column]
            margin = 1e-12 * max(abs(new), abs(old)) + 1e-15
            if level == 0 and abs(new - old) <= margin:
                if basis[best] == covering:
                    break
                if basis[i] == covering:
                    best = i
                    break
            if new < old - margin:
                best = i
                break
            if new > old + margin:
                break
    return best


@compiled(types.UniTuple(i8, 2)(matrix, vector, vector, f8, i8))
def lemke(M: Array, q: Array, z: Array, tol: float, max_iter: int) -> tuple[int, int]:
    """Follow the almost complementary path of w = M z + q + 1 z0 from a large z0 until z0 leaves the basis.

    The problem is first scaled to max |M| = max |q| = 1. Columns of the tableau: w, z, z0, right side. The answer is
    recomputed from M and q for the final basis, so that rounding does not accumulate over the pivots.
    """
    n = len(q)
    s, p = 0.0, 0.0
    for i in range(n):
        p = max(p, -q[i])
        for j in range(n):
            s = max(s, abs(M[i, j]))
    z[:] = 0.0
    if p == 0.0:
        return SOLVED, 0
    if s == 0.0:
        return RAY, 0

    covering, right = 2 * n, 2 * n + 1
    tableau = np.zeros((n, 2 * n + 2))
    basis = np.empty(n, np.int64)
    row = 0
    for i in range(n):
        basis[i] = i
        tableau[i, i] = 1.0
        for j in range(n):
            tableau[i, n + j] = -M[i, j] / s
        tableau[i, covering] = -1.0
        tableau[i, right] = q[i] / p
        # The first to leave is the lexicographic minimum of (q, I): the least q, and of equals the last.
        if tableau[i, right] <= tableau[row, right]:
            row = i

    entering = covering
    for step in range(max_iter):
        pivot(tableau, row, entering)
        leaving, basis[row] = basis[row], entering
        if leaving == covering:
            support = np.empty(n, np.int64)
            k = 0
            for i in range(n):
                if basis[i] >= n:
                    support[k] = basis[i] - n
                    k += 1
                    z[basis[i] - n] = max(tableau[i, right], 0.0) * (p / s)
            polished = np.empty(n)
            if solve_basis(M, q, support[:k], polished):
                for i in range(n):
                    polished[i] = max(polished[i], 0.0)
                if scaled_residual(M, q, polished) <= scaled_residual(M, q, z):
                    z[:] = polished
            return SOLVED, step + 1
        entering = leaving + n if leaving < n else leaving - n
        row = blocking_row(tableau, basis, entering, 1e-11)
        if row < 0:
            return RAY, step + 1
    return MAX_ITER, max_iter


SOLVER = CompiledSolver(
    name="lemke",
    summary="lexicographic complementary pivoting; takes singular, non-symmetric and copositive M",
    requires=(),
    tol=1e-10,
    max_iter=10_000,
    source="Lemke (1965); Cottle, Pang and Stone (1992), section 4.4",
    kernel=lemke,
)
