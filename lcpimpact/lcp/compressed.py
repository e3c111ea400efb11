"""Sparse storage of M in compiled solvers: the functions of `storage`, for rows and columns of entries.

A kernel or judge that is compiled for arrays is compiled again for this storage on its first use, from the same source.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple, cast

import numpy as np

from lcpimpact.arrays import Indices, Matrix, Vector
from lcpimpact.compiled import COMPILING, F, compiled, kind_of
from lcpimpact.interpreter import interpreted
from lcpimpact.numerics.rounding import EPS


class Entries(NamedTuple):
    """The entries of M by rows and by columns; entry k of row i, row_start[i] <= k < row_start[i + 1], is in row_column[k].

    Attributes
    ----------
    row_start, column_start : (n + 1,) indices
    row_column, column_row : (m,) indices           ascending in each row or column
    row_value, column_value : (m,) arrays
    """

    row_start: Indices
    row_column: Indices
    row_value: Vector
    column_start: Indices
    column_row: Indices
    column_value: Vector


@compiled()
def entry(W: Entries, i: int, j: int) -> float:
    """Return M_ij."""
    low, high = W.row_start[i], W.row_start[i + 1]
    while low < high:
        middle = (low + high) // 2
        if W.row_column[middle] < j:
            low = middle + 1
        else:
            high = middle
    found: float = 0.0
    if low < W.row_start[i + 1] and W.row_column[low] == j:
        found = W.row_value[low]
    return found


@compiled(inline="always")
def _sum_of(start: Indices, place: Indices, value: Vector, i: int, x: Vector) -> float:
    """Return the product of row or column i with x."""
    total = 0.0
    for k in range(start[i], start[i + 1]):
        total += value[k] * x[place[k]]
    return total


@compiled(inline="always")
def _terms_of(start: Indices, place: Indices, value: Vector, i: int, x: Vector) -> float:
    """Return the product of |row or column i| with |x|."""
    total = 0.0
    for k in range(start[i], start[i + 1]):
        total += abs(value[k] * x[place[k]])
    return total


@compiled(inline="always")
def row_product(W: Entries, i: int, z: Vector) -> float:
    """Return M_i· z."""
    return _sum_of(W.row_start, W.row_column, W.row_value, i, z)


@compiled()
def row_terms(W: Entries, i: int, z: Vector) -> float:
    """Return |M_i·| |z|."""
    return _terms_of(W.row_start, W.row_column, W.row_value, i, z)


@compiled()
def product(W: Entries, z: Vector, w: Vector) -> None:
    """Set w = M z."""
    for i in range(len(w)):
        w[i] = row_product(W, i, z)


@compiled()
def transposed_product(W: Entries, v: Vector, c: Vector) -> None:
    """Set c = Mᵀ v."""
    for j in range(len(c)):
        c[j] = _sum_of(W.column_start, W.column_row, W.column_value, j, v)


@compiled()
def absolute_product(W: Entries, z: Vector, c: Vector) -> None:
    """Set c = |M| |z|; ε c bounds the rounding error of M z."""
    for i in range(len(c)):
        c[i] = row_terms(W, i, z)


@compiled()
def absolute_transposed_product(W: Entries, v: Vector, c: Vector) -> None:
    """Set c = |M|ᵀ |v|."""
    for j in range(len(c)):
        c[j] = _terms_of(W.column_start, W.column_row, W.column_value, j, v)


@compiled()
def spread(W: Entries, j: int, x: float, c: Vector) -> None:
    """Add |M_·j x| to c."""
    for k in range(W.column_start[j], W.column_start[j + 1]):
        c[W.column_row[k]] += abs(W.column_value[k] * x)


@compiled()
def weight(W: Entries, j: int, size: Vector) -> float:
    """Return max_i |M_ij| / size_i: the largest effect of a unit change of z_j on a row, relative to its size."""
    found: float = 0.0
    for k in range(W.column_start[j], W.column_start[j + 1]):
        i, value = W.column_row[k], abs(W.column_value[k])
        if value > found * size[i]:
            found = value / size[i]
    return found


@compiled()
def column(W: Entries, j: int, c: Vector) -> None:
    """Set c = M_·j."""
    c[:] = 0.0
    for k in range(W.column_start[j], W.column_start[j + 1]):
        c[W.column_row[k]] = W.column_value[k]


@compiled()
def longest_row(W: Entries) -> int:
    """Return the largest number of entries of a row."""
    longest = 0
    for i in range(len(W.row_start) - 1):
        longest = max(longest, W.row_start[i + 1] - W.row_start[i])
    return longest


@compiled()
def has_positive_diagonal(W: Entries) -> bool:
    """Return whether every M_ii > 0."""
    positive = True
    for i in range(len(W.row_start) - 1):
        positive = positive and entry(W, i, i) > 0.0
    return positive


@compiled()
def is_symmetric(W: Entries) -> bool:
    """Return whether M is symmetric to |M_ij - M_ji| <= 1e-12 sqrt(|M_ii M_jj|), or to the rounding of M_ij."""
    n = len(W.row_start) - 1
    root = np.empty(n)
    for i in range(n):
        root[i] = np.sqrt(abs(entry(W, i, i)))
    for i in range(n):
        for k in range(W.row_start[i], W.row_start[i + 1]):
            j, value = W.row_column[k], W.row_value[k]
            difference = abs(value - entry(W, j, i))
            if difference > 4.0 * EPS * abs(value) and difference > 1e-12 * (root[i] * root[j]):
                return False
    return True


STORAGE = {
    each.__name__: each
    for each in cast(
        tuple[Any, ...],
        (
            entry, row_product, row_terms, product, transposed_product, absolute_product, absolute_transposed_product,
            spread, weight, column, longest_row, has_positive_diagonal, is_symmetric,
        ),
    )
}  # fmt: skip


@cache
def for_entries(function: F) -> F:
    """Return a kernel or judge for this storage: compiled again, with the functions that it calls."""
    if not COMPILING:
        return interpreted(function, **STORAGE)

    def again(before: Any, python: Any) -> Any:
        kind = before.declared
        takes = tuple(kind_of(Entries) if each == kind_of(Matrix) else each for each in kind.takes)
        return compiled(replace(kind, takes=takes), most=0)(python)

    return interpreted(function, again, **STORAGE)
