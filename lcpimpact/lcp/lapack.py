"""Linear systems inside LCP solvers: plain loops where the matrix is small, BLAS and LAPACK where it is not.

SciPy offers its BLAS and LAPACK as addresses. Compiled code calls them by a symbol of ours, so that it can still be cached;
with compilation switched off the same addresses are called through ctypes, and give the same bits.
"""

from __future__ import annotations

import ctypes
from typing import Annotated, TypeAlias

import numpy as np
from numpy.typing import NDArray

from lcpimpact.arrays import Axes, Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.compiler.routines import routine
from lcpimpact.lcp.scaling import equilibrate
from lcpimpact.numerics.elimination import eliminate, unit_of
from lcpimpact.numerics.rounding import EPS

MAX_LOOP_ORDER = 20
"""Maximum order at which loops are faster than a LAPACK call."""

PIVOT_TOL = 1e-14
"""Pivot below which a matrix with entries near one is singular."""


FortranInteger: TypeAlias = Annotated[NDArray[np.int32], Axes(1)]

_dgemv = routine("scipy.linalg.cython_blas.dgemv", 11)
_idamax = routine("scipy.linalg.cython_blas.idamax", 3, ctypes.c_int)
_dasum = routine("scipy.linalg.cython_blas.dasum", 3, ctypes.c_double)
_dposv = routine("scipy.linalg.cython_lapack.dposv", 8)
_dgesv = routine("scipy.linalg.cython_lapack.dgesv", 8)


@compiled()
def pointed(value: int) -> FortranInteger:
    """Return an integer by reference, as Fortran expects."""
    cell = np.empty(1, np.int32)
    cell[0] = value
    return cell


LETTER_L, LETTER_T = ord("L"), ord("T")  # Fortran reads the low byte as a character


@compiled()
def multiply(A: Matrix, x: Vector, y: Vector) -> None:
    """Set y = A x for a matrix of any shape."""
    rows, columns = A.shape
    if rows * columns <= MAX_LOOP_ORDER * MAX_LOOP_ORDER:
        for i in range(rows):
            total = 0.0
            for j in range(columns):
                total += A[i, j] * x[j]
            y[i] = total
        return
    # An array in C order is transposed for Fortran.
    transposed = pointed(LETTER_T)
    m = pointed(columns)
    n = pointed(rows)
    one = pointed(1)
    alpha, beta = np.ones(1), np.zeros(1)
    _dgemv(
        transposed.ctypes, m.ctypes, n.ctypes, alpha.ctypes, A.ctypes, m.ctypes, x.ctypes, one.ctypes, beta.ctypes,
        y.ctypes, one.ctypes,
    )  # fmt: skip


@compiled()
def largest(A: Matrix) -> float:
    """Return max |A_ij| of a finite array."""
    rows, columns = A.shape
    found: float = 0.0
    if rows * columns > MAX_LOOP_ORDER * MAX_LOOP_ORDER:
        size, one = pointed(rows * columns), pointed(1)
        at = _idamax(size.ctypes, A.ctypes, one.ctypes) - 1
        found = abs(A[at // columns, at % columns])
    else:
        for i in range(rows):
            for j in range(columns):
                found = max(found, abs(A[i, j]))
    return found


@compiled()
def absolute_sum(x: Vector) -> float:
    """Return Σ |x_i|, NaN if one is."""
    if len(x) > MAX_LOOP_ORDER * MAX_LOOP_ORDER:
        size, one = pointed(len(x)), pointed(1)
        total: float = _dasum(size.ctypes, x.ctypes, one.ctypes)
        return total
    total = 0.0
    for i in range(len(x)):
        total += abs(x[i])
    return total


@compiled()
def cholesky_solve(A: Matrix, b: Vector) -> bool:
    """Overwrite b with A⁻¹ b for symmetric A; return False if A is not positive definite to rounding.

    Only the upper triangle of A is read, and it is overwritten by the factor U of A = Uᵀ U.
    """
    n = len(b)
    least = np.empty(n)
    for k in range(n):
        least[k] = 4.0 * n * EPS * A[k, k]
    if n > MAX_LOOP_ORDER:
        # The lower triangle is the upper one in C order.
        lower = pointed(LETTER_L)
        order = pointed(n)
        one = pointed(1)
        info = pointed(0)
        _dposv(
            lower.ctypes, order.ctypes, one.ctypes, A.ctypes, order.ctypes, b.ctypes, order.ctypes, info.ctypes
        )  # fmt: skip
        regular: bool = info[0] == 0
        for k in range(n):
            regular = regular and A[k, k] * A[k, k] > least[k]
        return regular
    for k in range(n):
        pivot = A[k, k]
        if not (pivot > least[k] and pivot > 0.0):
            return False
        scale = 1.0 / np.sqrt(pivot)
        for j in range(k, n):
            A[k, j] *= scale
        for i in range(k + 1, n):
            factor = A[k, i]
            for j in range(i, n):
                A[i, j] -= factor * A[k, j]
    for k in range(n):
        b[k] /= A[k, k]
        for j in range(k + 1, n):
            b[j] -= A[k, j] * b[k]
    for k in range(n - 1, -1, -1):
        total = b[k]
        for j in range(k + 1, n):
            total -= A[k, j] * b[j]
        b[k] = total / A[k, k]
    return True


@compiled()
def solve_scaled(A: Matrix, b: Vector, row: Vector, unit: Vector, rows: Matrix) -> bool:
    """Write the solution of Σ_j row_i A_ij unit_j x_j = row_i b_i into the last column of rows (n, n + 1).

    Returns False if the scaled matrix, with entries near one, is singular.
    """
    n = len(b)
    for i in range(n):
        for j in range(n):
            rows[i, j] = A[i, j] * row[i] * unit[j]
        rows[i, n] = b[i] * row[i]
    if n <= MAX_LOOP_ORDER:
        return eliminate(rows, rows[:0], PIVOT_TOL)
    columns, x = rows[:, :n].T.copy(), rows[:, n].copy()
    order = pointed(n)
    one = pointed(1)
    info = pointed(0)
    swaps = np.empty(n, np.int32)
    _dgesv(
        order.ctypes, one.ctypes, columns.ctypes, order.ctypes, swaps.ctypes, x.ctypes, order.ctypes, info.ctypes
    )  # fmt: skip
    least = np.inf
    for k in range(n):
        least = min(least, abs(columns[k, k]))
        rows[k, n] = x[k]
    return info[0] == 0 and least > PIVOT_TOL


@compiled()
def lu_solve(A: Matrix, b: Vector) -> bool:
    """Overwrite b with A⁻¹ b; return False if A is singular to rounding.

    Rows and then columns are first scaled to a largest entry near one, so that units do not make A look singular. If A
    still does, because rows and columns have units of many sizes, the means of their entries are scaled to one.
    """
    n = len(b)
    if n == 1:
        b[0] /= A[0, 0] if A[0, 0] != 0.0 else 1.0
        return bool(0.0 < abs(A[0, 0]) < np.inf)
    row = np.empty(n)
    unit = np.empty(n)
    rows = np.empty((n, n + 1))
    for i in range(n):
        found: float = 0.0
        for j in range(n):
            found = max(found, abs(A[i, j]))
        row[i] = unit_of(found)
    for j in range(n):
        found = 0.0
        for i in range(n):
            found = max(found, abs(A[i, j] * row[i]))
        unit[j] = unit_of(found)
    regular = solve_scaled(A, b, row, unit, rows)
    if not regular:
        equilibrate(A, row, unit)
        regular = solve_scaled(A, b, row, unit, rows)
    for j in range(n):
        b[j] = rows[j, n] * unit[j]
    return regular
