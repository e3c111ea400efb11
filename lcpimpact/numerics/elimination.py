"""Products and solutions of the equations of a step, by sums in one order.

A table must be the same, bit for bit, whether it is made for one run or for many side by side. Libraries of linear algebra
sum in orders of their own, which change with the machine; here the same lines run compiled on floats, and in the interpreter
on formulas. Large matrices, which are never tabulated side by side, are left to LAPACK.
"""

from __future__ import annotations

import numpy as np

from lcpimpact.arrays import Array, Matrix
from lcpimpact.compiled import compiled
from lcpimpact.interpreter import interpreted

MAX_ROWS = 32
"""Number of rows above which LAPACK is faster by more than its call costs."""


def product(A: Array, B: Array) -> Array:
    """Return A B (m, n), of floats or of formulas."""
    if A.dtype == B.dtype == np.float64:
        if len(A) > MAX_ROWS:
            return np.asarray(A @ B)
        C = np.zeros((len(A), B.shape[1]))
        add_product(np.array(A, order="C"), np.array(B, order="C"), C)  # copies, for matrices may be read-only
        return C
    C = np.full((len(A), B.shape[1]), 0.0, dtype=object)
    interpreted(add_product)(A, B, C)
    return C


def solve(A: Array, B: Array) -> Array:
    """Return A⁻¹ B (n,) or (n, m), of floats or of formulas, by elimination with partial pivoting.

    Raises
    ------
    LinAlgError
        If A is singular.
    """
    floats = A.dtype == B.dtype == np.float64
    if floats and len(A) > MAX_ROWS:
        return np.asarray(np.linalg.solve(A, B))
    kind = np.float64 if floats else object
    rows = np.array(np.hstack([A, B.reshape(len(A), -1)]), dtype=kind, order="C")
    if not (eliminate if floats else interpreted(eliminate))(rows, 0.0):
        raise np.linalg.LinAlgError("Singular matrix")
    return np.array(rows[:, len(A) :], order="C").reshape(B.shape)


@compiled(allocates=False)
def add_product(A: Matrix, B: Matrix, C: Matrix) -> None:
    """Add A B to C."""
    for i in range(A.shape[0]):
        for k in range(A.shape[1]):
            for j in range(B.shape[1]):
                C[i, j] = C[i, j] + A[i, k] * B[k, j]


@compiled(allocates=False)
def eliminate(rows: Matrix, least: float) -> bool:
    """Replace B in the rows (A, B) by A⁻¹ B, by partial pivoting; return False if a pivot of A is not above ``least``."""
    n = rows.shape[0]
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(rows[i, k]) > abs(rows[pivot, k]):
                pivot = i
        if not abs(rows[pivot, k]) > least:
            return False
        if pivot != k:
            for j in range(k, rows.shape[1]):
                rows[k, j], rows[pivot, j] = rows[pivot, j], rows[k, j]
        for i in range(k + 1, n):
            factor = rows[i, k] / rows[k, k]
            for j in range(k + 1, rows.shape[1]):
                rows[i, j] = rows[i, j] - factor * rows[k, j]
    for k in range(n - 1, -1, -1):
        for j in range(n, rows.shape[1]):
            for i in range(k + 1, n):
                rows[k, j] = rows[k, j] - rows[k, i] * rows[i, j]
            rows[k, j] = rows[k, j] / rows[k, k]
    return True
