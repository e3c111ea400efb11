"""Scaling of problems: to a unit diagonal of M, or to entries near one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Matrix, Vector
from lcpimpact.compiled import compiled


@compiled()
def units(M: Matrix, q: Vector, unit: Vector) -> None:
    """Set ``unit`` to the D for which D M D has a unit diagonal, or a largest row entry near one where M_ii <= 0."""
    n = len(q)
    for i in range(n):
        size = M[i, i]
        if not size > 0.0:
            size = 0.0
            for j in range(n):
                size = max(size, max(abs(M[i, j]), abs(M[j, i])))
        unit[i] = 1.0 / np.sqrt(size) if size > 0.0 else 1.0


class ScaledProblem(NamedTuple):
    """A problem in x = z / unit, with a unit diagonal of N and max |p| = 1.

    Attributes
    ----------
    N : (n, n) array
    p, low, high, unit : (n,) arrays
    """

    N: Matrix
    p: Vector
    low: Vector
    high: Vector
    unit: Vector


@compiled()
def scaled(M: Matrix, q: Vector, lower: Vector, upper: Vector) -> ScaledProblem:
    """Return the scaled problem."""
    n = len(q)
    N = np.empty((n, n))
    p = np.empty(n)
    low = np.empty(n)
    high = np.empty(n)
    unit = np.empty(n)
    units(M, q, unit)
    size, widest = 0.0, 0.0
    for i in range(n):
        size = max(size, abs(q[i]) * unit[i])
        if abs(lower[i]) < np.inf:
            widest = max(widest, abs(lower[i]) / unit[i])
        if abs(upper[i]) < np.inf:
            widest = max(widest, abs(upper[i]) / unit[i])
    size = size if size > 0.0 else widest if widest > 0.0 else 1.0
    for i in range(n):
        for j in range(n):
            N[i, j] = M[i, j] * unit[i] * unit[j]
        p[i] = q[i] * unit[i] / size
    for i in range(n):
        unit[i] *= size
        low[i], high[i] = lower[i] / unit[i], upper[i] / unit[i]
    return ScaledProblem(N, p, low, high, unit)


SCALING_SWEEPS = 4
"""Number of sweeps over rows and columns; further sweeps hardly improve the scaling."""


@compiled()
def equilibrate(M: Matrix, row: Vector, column: Vector) -> None:
    """Set ``row`` and ``column`` so that the entries of diag(row) M diag(column) are near one.

    In each row and column the largest and the smallest entry are, as far as possible, reciprocal.
    """
    n = len(M)
    row[:] = 1.0
    column[:] = 1.0
    for sweep in range(2 * SCALING_SWEEPS):
        by_rows = sweep % 2 == 0
        for i in range(n):
            most, least = 0.0, np.inf
            for j in range(n):
                value = abs(M[i, j]) * row[i] * column[j] if by_rows else abs(M[j, i]) * row[j] * column[i]
                if value > 0.0:
                    most, least = max(most, value), min(least, value)
            if 0.0 < most < np.inf:
                factor = 1.0 / (np.sqrt(most) * np.sqrt(least))
                if by_rows:
                    row[i] *= factor
                else:
                    column[i] *= factor
