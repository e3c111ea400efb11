"""Sparse affine functions y = S x + c by the diagonals of S, which compiled loops add in strips that stay in the cache."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Array, Indices, Matrix, Sparse, Vector
from lcpimpact.compiled import compiled

STRIP = 1024
"""Rows that are summed at once: the rows and the x that they need stay in the first cache."""


class Stencil(NamedTuple):
    """A function y = S x + c.

    Attributes
    ----------
    c : (rows,) array                           the constants
    offset, first, last : (nd,) arrays          column minus row of each diagonal, and the range of its rows
    value : (nd,) array                         the entry of diagonals of equal entries
    place : (nd,) array                         row of ``entries`` of other diagonals, else -1
    entries : (nv, rows) array                  the entries of these
    row, column : (ne,) arrays, single          the entries that are not on a diagonal of many
    """

    c: Vector
    offset: Indices
    first: Indices
    last: Indices
    value: Vector
    place: Indices
    entries: Matrix
    row: Indices
    column: Indices
    single: Vector


def stencil(S: Sparse, c: Array | None = None, *, fewest: float = 0.05) -> Stencil:
    """Return the stencil of a sparse matrix S and constants c, zero by default.

    ``fewest``: part of the rows that a diagonal must fill to be kept as one; the entries of other diagonals are
    kept one by one.
    """
    entries = S.tocoo()
    rows = S.shape[0]
    order = np.lexsort((entries.row, entries.col - entries.row.astype(np.int64)))
    i = np.asarray(entries.row)[order]
    j = np.asarray(entries.col)[order]
    values = np.asarray(entries.data)[order]
    i, j = i.astype(np.int64), j.astype(np.int64)
    found: list[tuple[int, int, int, int, float]] = []
    varying: list[Array] = []
    starts = np.flatnonzero(np.diff(j - i, prepend=-(2**62)))
    lengths = np.diff(starts, append=len(i))
    many = lengths >= fewest * rows
    rest = ~np.repeat(many, lengths)
    for begin, length in zip(starts[many].tolist(), lengths[many].tolist(), strict=True):
        end, here = begin + length, slice(begin, begin + length)
        first, last = int(i[begin]), int(i[end - 1]) + 1
        equal = end - begin == last - first and bool((values[here] == values[begin]).all())
        found.append((int(j[begin]) - first, first, last, -1 if equal else len(varying), float(values[begin])))
        if not equal:
            diagonal = np.zeros(rows)
            diagonal[i[here]] = values[here]
            varying.append(diagonal)
    offsets, starts_at, ends_at, places = (np.array([each[k] for each in found], dtype=np.int64) for k in range(4))
    return Stencil(
        np.zeros(rows) if c is None else np.array(c, dtype=np.float64),
        offsets,
        starts_at,
        ends_at,
        np.array([each[4] for each in found], dtype=np.float64),
        places,
        np.array(varying, dtype=np.float64).reshape(len(varying), rows),
        i[rest],
        j[rest],
        np.asarray(values[rest], dtype=np.float64),
    )


@compiled()
def apply(f: Stencil, x: Vector, y: Vector) -> None:
    """Set y = S x + c."""
    rows = len(y)
    for start in range(0, rows, STRIP):
        end = min(start + STRIP, rows)
        part, constant = y[start:end], f.c[start:end]
        for k in range(end - start):
            part[k] = constant[k]
        for d in range(len(f.offset)):
            low, high = max(f.first[d], start), min(f.last[d], end)
            if low >= high:
                continue
            target = y[low:high]
            source = x[low + f.offset[d] : high + f.offset[d]]
            if f.place[d] < 0:
                value = f.value[d]
                for k in range(high - low):
                    target[k] += value * source[k]
            else:
                entries = f.entries[f.place[d], low:high]
                for k in range(high - low):
                    target[k] += entries[k] * source[k]
    for p in range(len(f.row)):
        y[f.row[p]] += f.single[p] * x[f.column[p]]


@compiled(inline="always")
def is_empty(f: Stencil) -> bool:
    """Return whether S has no entry."""
    return len(f.offset) == 0 and len(f.row) == 0
