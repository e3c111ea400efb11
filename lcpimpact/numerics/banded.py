"""Symmetric positive definite matrices of small bandwidth: A = L D Lᵀ, and solutions in a time proportional to n.

The lower bands (w + 1, n) of A hold A_{j+k, j} in row k and column j; its factors stand likewise, 1/D in row 0 and L in the
others.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from lcpimpact.arrays import Array, Matrix, Stack, Vector
from lcpimpact.compiled import compiled
from lcpimpact.numerics.double_double import add, divide, multiply


def half_bandwidth(A: Any) -> int:
    """Return the largest |i - j| with an entry of a sparse matrix."""
    entries = A.tocoo()
    return int(np.abs(entries.row - entries.col).max(initial=0))


def lower_bands(A: Any, width: int) -> Array:
    """Return the lower bands (width + 1, n) of a symmetric sparse matrix."""
    bands = np.zeros((width + 1, A.shape[0]))
    for k in range(width + 1):
        bands[k, : A.shape[0] - k] = A.diagonal(-k)
    return bands


@compiled(inline="always")
def subtract_product(A: Matrix, low: Matrix, i: int, j: int, k: int) -> None:
    """Subtract the product of the entries (i, k) and (j, k) from the entry (i, j)."""
    if len(low) == 0:
        A[i - j, j] -= A[i - k, k] * A[j - k, k]
    else:
        x, x_lo = multiply(A[i - k, k], low[i - k, k], A[j - k, k], low[j - k, k])
        A[i - j, j], low[i - j, j] = add(A[i - j, j], low[i - j, j], -x, -x_lo)


@compiled()
def factor(A: Matrix, low: Matrix, rtol: float) -> bool:
    """Overwrite the lower bands (w + 1, n) of A by its factors; return False if a D_j is not above rtol A_jj.

    The low parts of double-doubles are in ``low``, which has no rows for floats.
    """
    bands, n = A.shape
    fine = len(low) > 0
    for i in range(n):
        first = max(0, i - bands + 1)
        for j in range(first, i):
            # L_ij D_j until row i is finished, so that each product has one factor with D and one without.
            for k in range(first, j):
                subtract_product(A, low, i, j, k)
        D, D_lo = A[0, i], low[0, i] if fine else 0.0
        for j in range(first, i):
            x = A[i - j, j] * A[0, j]
            if fine:
                x, x_lo = multiply(A[i - j, j], low[i - j, j], A[0, j], low[0, j])
                y, y_lo = multiply(x, x_lo, A[i - j, j], low[i - j, j])
                D, D_lo = add(D, D_lo, -y, -y_lo)
                low[i - j, j] = x_lo
            else:
                D -= x * A[i - j, j]
            A[i - j, j] = x
        if not rtol * A[0, i] < D:
            return False
        A[0, i] = 1.0 / D
        if fine:
            A[0, i], low[0, i] = divide(1.0, 0.0, D, D_lo)
    return True


@compiled()
def solve_banded(factors: Matrix, b: Vector) -> None:
    """Overwrite b by A⁻¹ b.

    Each row waits for the last one: its term is subtracted last, and there is no division.
    """
    bands, n = factors.shape
    for i in range(n):
        total = b[i]
        for k in range(min(bands - 1, i), 0, -1):
            total -= factors[k, i - k] * b[i - k]
        b[i] = total
    for r in range(n):
        i = n - 1 - r
        total = b[i] * factors[0, i]
        for k in range(min(bands - 1, r), 0, -1):
            total -= factors[k, i] * b[i + k]
        b[i] = total


@compiled()
def solve_finely(factors: Stack, first: int, x: Matrix) -> None:
    """Overwrite n columns b of x (2, N), double-doubles, from the column ``first`` on, by A⁻¹ b."""
    bands, n = factors.shape[1], factors.shape[2]
    for i in range(n):
        for k in range(min(bands - 1, i), 0, -1):
            j = first + i - k
            y, y_lo = multiply(factors[0, k, i - k], factors[1, k, i - k], x[0, j], x[1, j])
            x[0, first + i], x[1, first + i] = add(x[0, first + i], x[1, first + i], -y, -y_lo)
    for r in range(n):
        i = n - 1 - r
        x[0, first + i], x[1, first + i] = multiply(
            factors[0, 0, i], factors[1, 0, i], x[0, first + i], x[1, first + i]
        )
        for k in range(min(bands - 1, r), 0, -1):
            j = first + i + k
            y, y_lo = multiply(factors[0, k, i], factors[1, k, i], x[0, j], x[1, j])
            x[0, first + i], x[1, first + i] = add(x[0, first + i], x[1, first + i], -y, -y_lo)
