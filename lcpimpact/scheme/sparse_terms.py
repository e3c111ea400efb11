"""The terms of sparse M, C, K, f and H that elements contribute, by entries and by arrays."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from lcpimpact.arrays import Array, Indices, Sparse
from lcpimpact.scheme.signals import Signals
from lcpimpact.scheme.terms import GROUND, End, Row, Terms


class SparseSum:
    """A matrix as a list of entries at places of rows and columns; entries at one place add up."""

    def __init__(self) -> None:
        self.entries: list[tuple[Any, Any, Any]] = []

    def add(self, term: Any, at: tuple[Any, Any]) -> None:
        """Add a term to the entries ``at``."""
        values, rows, columns = np.broadcast_arrays(np.asarray(term, dtype=np.float64), *at)
        self.entries.append((values.ravel(), rows.ravel(), columns.ravel()))

    def matrix(self, rows: int, columns: int) -> Sparse:
        """Return the sum in compressed rows."""
        if not self.entries:
            return sparse.csr_array((rows, columns))
        values, i, j = (np.concatenate(each) for each in zip(*self.entries, strict=True))
        found = sparse.coo_array((values, (i, j)), shape=(rows, columns)).tocsr()
        found.eliminate_zeros()
        return found


class Bumpers(NamedTuple):
    """Bumpers by arrays: names, indices of the upper and the lower nodes (-1 for the ground), gaps and e."""

    names: Sequence[str]
    upper: Indices
    lower: Indices
    gap: Array
    e: Array


class SparseTerms(Terms):
    """The terms of sparse M, C, K, f and H that elements have added so far; see `Terms`."""

    def __init__(self, nodes: Sequence[str]) -> None:
        self.index = {node: i for i, node in enumerate(nodes)}
        self.M: Any = SparseSum()
        self.C: Any = SparseSum()
        self.K: Any = SparseSum()
        self.f = np.zeros(len(nodes))
        self.F, self.signals = SparseSum(), Signals()
        self.loads = []
        self.rows = []
        self.springs = []
        self.force_laws = []
        self.motions = {}
        self.bumper_arrays: list[tuple[int, Bumpers]] = []

    def places(self, nodes: Iterable[str]) -> Indices:
        """Return the indices of nodes, -1 for the ground."""
        return np.array([self.index.get(node, -1) for node in nodes], dtype=np.int64)

    def load(self, at: Any, amplitudes: Any, f: Any = 1.0) -> None:
        """Add loads to nodes, all different: amplitudes times a constant or a signal."""
        if callable(f):
            unit, place = self.signals.place(f)
            self.F.add(unit * np.asarray(amplitudes), (at, place))
        else:
            self.f[at] += f * amplitudes

    def link(self, matrix: Any, a: str, b: str, value: float) -> None:
        """Add ``value`` times the square of (q_b - q_a) to the quadratic form of ``matrix``."""
        self.link_all(matrix, self.places([a]), self.places([b]), np.array([value]))

    def link_all(self, matrix: SparseSum, a: Indices, b: Indices, values: Array) -> None:
        """Add each of ``values`` times the square of its (q_b - q_a) to the quadratic form of ``matrix``."""
        for i, j, sign in ((a, a, 1.0), (b, b, 1.0), (a, b, -1.0), (b, a, -1.0)):
            both = (i >= 0) & (j >= 0)
            matrix.add(sign * values[both], (i[both], j[both]))

    def bumpers(self, names: Sequence[str], upper: Indices, lower: Indices, gap: Array, e: Array) -> None:
        """Add bumpers, after the rows added so far."""
        self.bumper_arrays.append((len(self.rows), Bumpers(names, upper, lower, gap, e)))

    def all_bumpers(self) -> Iterator[tuple[Sequence[str], Array, Array, Sparse]]:
        """Yield the names, gaps, e and rows of H of all bumpers, in the order in which they were added."""
        last, n = 0, len(self.index)
        for first, arrays in (*self.bumper_arrays, (len(self.rows), None)):
            if rows := self.rows[last:first]:
                yield [row.name for row in rows], *_gaps(rows), self._directions(rows)
            last = first
            if arrays is not None:
                H = SparseSum()
                for places, sign in ((arrays.upper, -1.0), (arrays.lower, 1.0)):
                    at = np.flatnonzero(places >= 0)
                    H.add(sign, (at, places[at]))
                yield arrays.names, arrays.gap, arrays.e, H.matrix(len(arrays.names), n)

    def _directions(self, rows: Sequence[Row]) -> Sparse:
        """Return the rows of H of single bumpers."""
        H = SparseSum()
        for i, row in enumerate(rows):
            for end, sign in ((row.upper, -1.0), (row.lower, 1.0)):
                for node, coefficient in _coefficients(end):
                    if node != GROUND:
                        H.add(sign * coefficient, (i, self.index[node]))
        return H.matrix(len(rows), len(self.index))


def _coefficients(end: End) -> Iterable[tuple[str, float]]:
    return end.items() if isinstance(end, Mapping) else ((end, 1.0),)


def _gaps(rows: Sequence[Row]) -> tuple[Array, Array]:
    """Return the gaps and the coefficients of restitution of single bumpers, NaN where none is given."""
    return np.array([row.gap for row in rows]), np.array([row.e for row in rows], dtype=np.float64)
