"""Products and solutions of the equations of a step, by sums in one order.

A table must be the same, bit for bit, whether it is made for one run or for many side by side. Libraries of linear algebra
sum in orders of their own, which change with the machine; here the same lines run compiled on floats, and in the interpreter
on formulas. Large matrices, which are never tabulated side by side, are left to LAPACK. Double-doubles take the same
elimination.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array, Matrix, Stack
from lcpimpact.compiled import FEW_ROWS, compiled
from lcpimpact.interpreter import interpreted, throughout
from lcpimpact.numerics.double_double import DoubleDouble, add, divide, lifted, multiply, with_slopes

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

    Formulas without values, which cannot be compared, are eliminated in their order; their A is near a mass matrix.

    Raises
    ------
    LinAlgError
        If A is singular.
    """
    floats = A.dtype == B.dtype == np.float64
    if floats and len(A) > MAX_ROWS:
        return np.asarray(np.linalg.solve(A, B))
    kind = np.float64 if floats else object
    if not floats and any(getattr(each, "incomparable", False) for each in A.flat):
        return _solve_in_order(A, B)
    rows = np.array(np.hstack([A, B.reshape(len(A), -1)]), dtype=kind, order="C")
    if not (eliminate if floats else throughout(eliminate))(rows, rows[:0], 0.0):
        raise np.linalg.LinAlgError("Singular matrix")
    return np.array(rows[:, len(A) :], order="C").reshape(B.shape)


def _solve_in_order(A: Array, B: Array) -> Array:
    """Return A⁻¹ B by elimination without pivoting."""
    n = len(A)
    rows = np.hstack([A, B.reshape(n, -1)]).astype(object)
    for k in range(n):
        rows[k] = [each / rows[k, k] for each in rows[k]]
        for i in range(n):
            if i != k:
                rows[i] = rows[i] - rows[i, k] * rows[k]
    return rows[:, n:].reshape(B.shape)


@compiled()
def add_product(A: Matrix, B: Matrix, C: Matrix) -> None:
    """Add A B to C."""
    for i in range(A.shape[0]):
        for k in range(A.shape[1]):
            for j in range(B.shape[1]):
                C[i, j] = C[i, j] + A[i, k] * B[k, j]


@compiled(inline="always")
def subtract(rows: Matrix, low: Matrix, i: int, j: int, factor: tuple[float, float], k: int) -> None:
    """Subtract a factor times the entry of row k from the one of row i, in column j."""
    if len(low) == 0:
        rows[i, j] = rows[i, j] - factor[0] * rows[k, j]
    elif factor[0] != 0.0:
        x, x_lo = multiply(factor[0], factor[1], rows[k, j], low[k, j])
        rows[i, j], low[i, j] = add(rows[i, j], low[i, j], -x, -x_lo)


@compiled()
def eliminate(rows: Matrix, low: Matrix, least: float) -> bool:
    """Replace B in the rows (A, B) by A⁻¹ B, by partial pivoting; return False if a pivot of A is not above ``least``.

    The low parts of double-doubles are in ``low``, which has no rows for floats and formulas.
    """
    n, columns = rows.shape
    fine = len(low) > 0
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(rows[i, k]) > abs(rows[pivot, k]):
                pivot = i
        if not abs(rows[pivot, k]) > least:
            return False
        if pivot != k:
            for j in range(k, columns):
                rows[k, j], rows[pivot, j] = rows[pivot, j], rows[k, j]
                if fine:
                    low[k, j], low[pivot, j] = low[pivot, j], low[k, j]
        for i in range(k + 1, n):
            factor = divide(rows[i, k], low[i, k], rows[k, k], low[k, k]) if fine else (rows[i, k] / rows[k, k], 0.0)
            for j in range(k + 1, columns):
                subtract(rows, low, i, j, factor, k)
    for k in range(n - 1, -1, -1):
        for j in range(n, columns):
            for i in range(k + 1, n):
                subtract(rows, low, k, j, (rows[k, i], low[k, i] if fine else 0.0), i)
            if fine:
                rows[k, j], low[k, j] = divide(rows[k, j], low[k, j], rows[k, k], low[k, k])
            else:
                rows[k, j] = rows[k, j] / rows[k, k]
    return True


@compiled()
def unit_of(x: float) -> float:
    """Return the power of two that scales x into [1/2, 1], or 1 for zero: the scaling is exact."""
    return math.ldexp(1.0, max(-math.frexp(x)[1], -1000)) if 0.0 < x < np.inf else 1.0


@compiled(most=8 * FEW_ROWS)  # many entries are zero, and are passed over
def quotient(A: Stack, b: Stack) -> Stack:
    """Return A⁻¹ b of double-doubles, for A (2, n, n) and b (2, n, p); NaN where A is singular."""
    n = A.shape[1]
    rows = np.empty((2, n, n + b.shape[2]))
    for i in range(n):
        unit = unit_of(np.abs(A[0, i]).max())  # so that pivots are chosen among rows of one size
        for part in range(2):
            for j in range(rows.shape[2]):
                rows[part, i, j] = (A[part, i, j] if j < n else b[part, i, j - n]) * unit
    return rows[:, :, n:].copy() if eliminate(rows[0], rows[1], 0.0) else np.full_like(b, np.nan)


def solve_finely(A: ArrayLike | DoubleDouble, b: ArrayLike | DoubleDouble) -> DoubleDouble:
    """Return A⁻¹ b of double-doubles, for b of shape (n,) or (n, p).

    Raises
    ------
    LinAlgError
        If A is singular.
    """
    matrix, right = DoubleDouble.of(A), DoubleDouble.of(b)
    sides = right.parts[..., None] if right.parts.ndim == 2 else right.parts
    columns = np.ascontiguousarray(sides[:2])
    found = DoubleDouble(quotient(np.ascontiguousarray(matrix.parts[:2]), columns))
    if not np.isfinite(found.parts).all():
        raise np.linalg.LinAlgError("singular matrix")
    if max(len(matrix.parts), len(sides)) > 2:
        # A x' = b' - A' x, for all parameters at once.
        rest = (DoubleDouble(lifted(DoubleDouble(sides), max(len(matrix.parts), len(sides)))) - matrix @ found).slopes
        n, q = found.shape
        k = len(rest)
        slopes = solve_finely(matrix.value, DoubleDouble(rest.parts.transpose(0, 2, 1, 3).reshape(2, n, k * q)))
        found = with_slopes(found, DoubleDouble(slopes.parts.reshape(2, n, k, q).transpose(0, 2, 1, 3)))
    return DoubleDouble(found.parts.reshape(len(found.parts), *right.shape))
