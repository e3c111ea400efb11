"""Complementary bases: the rows at a bound and the free ones, and the basic solution."""

from __future__ import annotations

import numpy as np

from lcpimpact.arrays import Indices, Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.lcp.lapack import cholesky_solve, lu_solve
from lcpimpact.lcp.problem import FREE, LOWER, UPPER
from lcpimpact.lcp.storage import diagonal, product, row_terms
from lcpimpact.numerics.banded import factor, solve_banded
from lcpimpact.numerics.rounding import EPS

PATIENCE = 5
"""Maximum number of successive block exchanges that do not reduce the number of infeasible rows."""


@compiled()
def sides(z: Vector, lower: Vector, upper: Vector, side: Indices) -> None:
    """Set ``side`` to LOWER, FREE or UPPER according to z; a row without bounds is always free."""
    for i in range(len(z)):
        if lower[i] == -np.inf and upper[i] == np.inf:
            side[i] = FREE
        elif z[i] <= lower[i] or lower[i] == upper[i]:
            side[i] = LOWER
        else:
            side[i] = UPPER if z[i] >= upper[i] else FREE


@compiled()
def row_roots(W: Matrix, q: Vector, root: Vector) -> float:
    """Set ``root`` to sqrt(M_ii), or to the root of the largest M_ii where M_ii <= 0; return max |q_i| / root_i."""
    diagonal(W, root)
    widest, size = 0.0, 0.0
    for i in range(len(q)):
        widest = max(widest, root[i])
    for i in range(len(q)):
        root[i] = np.sqrt(root[i] if root[i] > 0.0 else (widest if widest > 0.0 else 1.0))
        size = max(size, abs(q[i]) / root[i])
    return size


@compiled()
def violation(side: int, z: float, w: float, lower: float, upper: float, root: float) -> float:
    """Return the infeasibility of a row of a basic solution, in the unit of w; root² = M_ii."""
    if side == FREE:
        return max(lower - z, z - upper) * root * root
    return 0.0 if lower == upper else -w if side == LOWER else w


@compiled()
def is_rounding(W: Matrix, q: Vector, z: Vector, i: int, value: float) -> bool:
    """Return whether a value is below the rounding error of (M z + q)_i."""
    terms = abs(q[i]) + row_terms(W, i, z)
    rounding: bool = abs(value) <= 64.0 * EPS * terms
    return rounding


@compiled()
def banded_solve(W: Matrix, rows: Indices, b: Vector) -> bool:
    """Overwrite b with M_αα⁻¹ b by L D Lᵀ, for banded M and ascending rows α; return False if M_αα is not definite.

    A principal submatrix of a banded matrix has at most the same bandwidth.
    """
    bands, k = W.shape[0], len(rows)
    A = np.zeros((bands, k))
    for c in range(k):
        for a in range(c, min(k, c + bands)):
            distance = rows[a] - rows[c]
            if distance < bands:
                A[a - c, c] = W[distance, rows[c]]
    regular = factor(A, A[:0], 4.0 * bands * EPS)
    if regular:
        solve_banded(A, b)
    return regular


@compiled()
def solve_rows(W: Matrix, definite: bool, rows: Indices, b: Vector) -> bool:
    """Overwrite b with M_αα⁻¹ b for ascending rows α; return False if M_αα is singular, or not definite as declared."""
    k = len(rows)
    if W.shape[0] != W.shape[1]:
        return banded_solve(W, rows, b)
    A = np.empty((k, k))
    if definite:
        for a in range(k):
            for c in range(a, k):
                A[a, c] = W[rows[a], rows[c]]
        return cholesky_solve(A, b)
    for a in range(k):
        for c in range(k):
            A[a, c] = W[rows[a], rows[c]]
    return lu_solve(A, b)


@compiled()
def basic_solution(
    W: Matrix, definite: bool, q: Vector, lower: Vector, upper: Vector, side: Indices, z: Vector
) -> bool:
    """Set z_β to the bounds given by ``side``, and solve M_αα z_α = -(q_α + M_αβ z_β) for the free rows α.

    Returns False, with z_α = 0, if M_αα is singular, or, with ``definite`` (Cholesky), not positive definite.
    """
    n = len(q)
    rows = np.empty(n, np.int64)
    k = 0
    shifted = False
    for i in range(n):
        z[i] = 0.0
        if side[i] == FREE:
            rows[k] = i
            k += 1
        else:
            z[i] = lower[i] if side[i] == LOWER else upper[i]
            shifted = shifted or z[i] != 0.0
    if k == 0:
        return True
    b = np.empty(k)
    for a in range(k):
        b[a] = -q[rows[a]]
    if shifted:
        w = np.empty(n)
        product(W, z, w)
        for a in range(k):
            b[a] -= w[rows[a]]
    regular = solve_rows(W, definite, rows[:k], b)
    if regular:
        for a in range(k):
            z[rows[a]] = b[a]
    return regular
