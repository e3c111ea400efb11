"""The terms of M, C, K, f and H that elements contribute."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from itertools import accumulate, pairwise
from typing import NamedTuple, cast

import numpy as np
from scipy import sparse

from lcpimpact.arrays import Array, Flags, Indices, Sparse
from lcpimpact.formula import Number
from lcpimpact.scheme.force_law import ForceLaw
from lcpimpact.scheme.held_force import HeldForce
from lcpimpact.scheme.laws import CONTACT, Bounded, RowLaw
from lcpimpact.scheme.signals import Signal, TimeFunction

GROUND = "ground"
"""The name of the node that does not move."""

End = str | Mapping[str, float]
"""An end of a contact: a node, or a point that moves by a sum of coordinates, as {"x": 1.0, "φ": -0.1}."""


def nodes_of(end: End) -> tuple[str, ...]:
    """Return the nodes of an end."""
    return tuple(end) if isinstance(end, Mapping) else (end,)


def coefficients_of(end: End) -> Iterable[tuple[str, float]]:
    """Return the nodes of an end with their coefficients."""
    return end.items() if isinstance(end, Mapping) else ((end, 1.0),)


def name_of(end: End) -> str:
    """Return a node's name, or a sum in words.

    Examples
    --------
    >>> name_of({"x": 1.0, "φ": -0.1})
    'x - 0.1 φ'
    """
    if not isinstance(end, Mapping):
        return end
    terms = [f"{'-' if c < 0.0 else '+'} {'' if abs(c) == 1.0 else f'{abs(c):g} '}{node}" for node, c in end.items()]
    text = " ".join(terms).removeprefix("+ ")
    return f"-{text[2:]}" if text.startswith("- ") else text


class NodeKind(IntEnum):
    """Kinds of nodes: quasi-static, massless with dashpots, with mass, with prescribed motion."""

    FREE = -1
    DAMPED = 0
    MASSIVE = 1
    DRIVEN = 2


@dataclass(frozen=True)
class Row(Bounded):
    """A row of H with its law: u = q_lower - q_upper + gap, r_min <= r <= r_max, and r pushes the two nodes apart.

    Attributes
    ----------
    element : str           the element, for messages
    name : str              the name of the reaction
    upper, lower : End      the nodes, or sums of coordinates
    gap : float             u in m at zero coordinates
    e : float or None       coefficient of restitution, where one is given
    law : RowLaw
    bounds : (float, float) r_min and r_max in N
    mu, mu_s : float        kinetic and static coefficient of friction
    normal : str            name of the row whose reaction bounds the friction
    """

    element: str
    name: str
    upper: End
    lower: End
    gap: float
    e: float | None = None
    law: RowLaw = CONTACT
    bounds: tuple[float, float] = (0.0, math.inf)
    mu: float = 0.0
    mu_s: float = 0.0
    normal: str = ""


@dataclass(frozen=True)
class PowerLaw:
    r"""A non-linear spring, or compliant contact: K δⁿ (1 + b δ') + c D(δ) δ' for δ > 0, which pushes two nodes apart.

    δ = q_upper - q_lower - gap is the approach of the nodes; the force is zero where δ <= 0. D = δᵖ, or with a depth d
    z² (3 - 2 z), z = min(δ/d, 1). The force is kept between ``least`` and ``most`` times K δⁿ.

    Attributes
    ----------
    element : str           the element, for messages
    upper, lower : str      the nodes
    gap : float             opening in m at zero coordinates
    K : float               N/mⁿ
    n : float               exponent, at least 1
    b : float               s/m; 0 for a spring without this loss
    c : float               N s/mᵖ⁺¹; 0 for a spring without this loss
    p : float               exponent of D, zero or positive
    depth : float           d in m; 0 for D = δᵖ
    least, most : float     bounds of the force relative to K δⁿ: 0 where nothing pulls
    name : str              the name of the force
    """

    element: str
    upper: str
    lower: str
    gap: float
    K: float
    n: float
    b: float = 0.0
    c: float = 0.0
    p: float = 0.0
    depth: float = 0.0
    least: float = -math.inf
    most: float = math.inf
    name: str = "F"

    @property
    def numbers(self) -> tuple[float, ...]:
        """Its row of `lcpimpact.scheme.power_law`."""
        return self.gap, self.K, self.n, self.b, self.c, self.p, self.depth, self.least, self.most

    @property
    def lossy(self) -> bool:
        """Whether it dissipates."""
        return self.b > 0.0 or self.c > 0.0


@dataclass(frozen=True)
class RateLaw:
    """A non-linear dashpot: the force F(v) that pulls two nodes together, v the rate at which they part.

    Attributes
    ----------
    element : str               the element, for messages
    a, b : str                  the nodes, with v = v_b - v_a
    numbers : tuple of float    its row of `lcpimpact.scheme.rate_law`
    """

    element: str
    a: str
    b: str
    numbers: tuple[float, ...]

    @property
    def rises(self) -> bool:
        """Whether F rises everywhere, so that it determines v."""
        F = self.numbers[9::2]
        return min(self.numbers[3:5]) > 0.0 if self.numbers[2] > 0.0 else all(a < b for a, b in pairwise(F))

    @property
    def usual_slope(self) -> float:
        """The slope of a power at 1 m/s, or the largest of a table, in N s/m."""
        if self.numbers[2] > 0.0:
            return self.numbers[2] * max(self.numbers[3:5])
        points = pairwise(zip(self.numbers[8::2], self.numbers[9::2], strict=True))
        return max((F_2 - F_1) / (v_2 - v_1) for (v_1, F_1), (v_2, F_2) in points)


class MatrixEntries(NamedTuple):
    """MatrixEntries of a matrix: their rows, columns and values (ne,) each."""

    row: Indices
    column: Indices
    value: Array

    def at(self, rows: Flags, columns: Flags) -> MatrixEntries:
        """Return the entries in some rows and columns, given by flags."""
        kept = rows[self.row] & columns[self.column]
        return MatrixEntries(self.row[kept], self.column[kept], self.value[kept])


def entries_of(matrix: Array | Sparse) -> MatrixEntries:
    """Return the entries that are not zero, row by row."""
    if isinstance(matrix, np.ndarray):
        row, column = np.nonzero(matrix)
        return MatrixEntries(row, column, matrix[row, column])
    found = matrix.tocoo()
    return MatrixEntries(found.row, found.col, found.data)


class Sum:
    """A matrix as a sum of terms: entries at places, of which those at one place add up, in any format of a matrix.

    Attributes
    ----------
    shape : (int, int)
    terms : list            each a value, or an array of values, and its rows and columns
    """

    def __init__(self, rows: int, columns: int, kind: type = float) -> None:
        self.shape = rows, columns
        self.kind = kind
        self.terms: list[tuple[Number | Array, tuple[int | Indices, ...]]] = []

    def add(self, term: Number | Array, at: tuple[int | Indices, ...]) -> None:
        """Add a term to the entries ``at``."""
        self.terms.append((term, at))

    @property
    def entries(self) -> MatrixEntries:
        """The entries, in the order in which they were added."""
        rows, columns, values = zip(*self._parts(), strict=True)
        return MatrixEntries(
            np.concatenate([np.zeros(0, np.int64), *rows]).astype(np.int64),
            np.concatenate([np.zeros(0, np.int64), *columns]).astype(np.int64),
            np.concatenate([np.zeros(0, self.kind), *values]),
        )

    def _parts(self) -> Iterator[tuple[list[int], list[int], list[Number]]]:
        """Yield the rows, columns and values of the entries, terms of one entry together."""
        rows: list[int] = []
        columns: list[int] = []
        values: list[Number] = []
        for term, (i, j) in self.terms:
            if isinstance(i, int) and isinstance(j, int) and not isinstance(term, np.ndarray):
                rows.append(i)
                columns.append(j)
                values.append(term)
                continue
            yield rows, columns, values
            rows, columns, values = ([], [], [])
            row, column, value = np.broadcast_arrays(i, j, np.asarray(term, dtype=self.kind))
            yield row.ravel().tolist(), column.ravel().tolist(), value.ravel().tolist()
        yield rows, columns, values

    def full(self) -> tuple[Array, Array]:
        """Return the full matrix, and its rounding error.

        Springs of 1e9 and 1 N/m at one node sum to a float that has lost half the digits of the weaker one, and the rows of
        a stiffness that should cancel in a rigid motion no longer do. The rounding error of a sum is itself a float (Knuth).
        """
        sums: dict[tuple[int, int], tuple[Number, Number]] = {}
        for part in self._parts():
            for i, j, term in zip(*part, strict=True):
                before, lost = sums.get((i, j), (0.0, 0.0))
                total = before + term
                gained = total - before
                sums[i, j] = total, lost + ((before - (total - gained)) + (term - gained))
        value: Array = np.full(self.shape, 0.0, self.kind)
        residue: Array = np.full(self.shape, 0.0, self.kind)
        for place, (total, lost) in sums.items():
            value[place] = total
            residue[place] = lost
        return value, residue

    @property
    def value(self) -> Array:
        """The full matrix; it cannot be written into."""
        value, _ = self.full()
        value.flags.writeable = False
        return value

    def compressed(self) -> Sparse:
        """Return the matrix in compressed rows."""
        entries = self.entries
        found = sparse.coo_array((entries.value, (entries.row, entries.column)), shape=self.shape).tocsr()
        found.eliminate_zeros()
        return found


class Bumpers(NamedTuple):
    """Bumpers by arrays: names, indices of the upper and the lower nodes (-1 for the ground), gaps and e."""

    names: Sequence[str]
    upper: Indices
    lower: Indices
    gap: Array
    e: Array


class ConstraintRows:
    """The rows of H in the order in which they were added: single ones, and bumpers by arrays.

    Parameters
    ----------
    places : dict of str to int     position of each node in q
    """

    def __init__(self, places: Mapping[str, int]) -> None:
        self.places = places
        self._blocks: list[list[Row] | Bumpers] = []

    def append(self, row: Row) -> None:
        """Add a row."""
        if not self._blocks or isinstance(self._blocks[-1], Bumpers):
            self._blocks.append([])
        cast(list[Row], self._blocks[-1]).append(row)

    def add_bumpers(self, names: Sequence[str], upper: Indices, lower: Indices, gap: Array, e: Array) -> None:
        """Add bumpers by arrays."""
        self._blocks.append(Bumpers(names, upper, lower, gap, e))

    def _starts(self) -> list[int]:
        sizes = [len(block.names if isinstance(block, Bumpers) else block) for block in self._blocks]
        return [0, *accumulate(sizes)]

    def __len__(self) -> int:
        return self._starts()[-1]

    def __iter__(self) -> Iterator[Row]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, i: int) -> Row:
        starts = self._starts()
        k = bisect_right(starts, i) - 1
        block = self._blocks[k]
        return self._bumper(block, i - starts[k]) if isinstance(block, Bumpers) else block[i - starts[k]]

    def _bumper(self, block: Bumpers, i: int) -> Row:
        nodes = list(self.places)
        upper, lower = (GROUND if each[i] < 0 else nodes[each[i]] for each in (block.upper, block.lower))
        element = f"Bumper between {upper!r} and {lower!r}"
        return Row(element, block.names[i], upper, lower, float(block.gap[i]), float(block.e[i]))

    def single(self) -> Iterator[tuple[int, Row]]:
        """Yield the rows that were added one by one, with their numbers; all others are bumpers."""
        for start, block in zip(self._starts(), self._blocks, strict=False):
            yield from () if isinstance(block, Bumpers) else enumerate(block, start)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the reactions."""
        names: list[str] = []
        for block in self._blocks:
            names += block.names if isinstance(block, Bumpers) else [row.name for row in block]
        return tuple(names)

    def _array(
        self, of_row: Callable[[Row], float | None], of_bumpers: Callable[[Bumpers], Array | Indices], kind: type
    ) -> np.ndarray:
        parts = [
            of_bumpers(block) if isinstance(block, Bumpers) else [of_row(row) for row in block]
            for block in self._blocks
        ]
        return np.concatenate([np.zeros(0, kind), *(np.asarray(part, dtype=kind) for part in parts)])

    def gaps(self, kind: type = float) -> Array:
        """Return u of each row in m at zero coordinates (nc,)."""
        return self._array(lambda row: row.gap, lambda block: block.gap, kind)

    @property
    def e(self) -> Array:
        """Coefficient of restitution of each row, NaN where none is given (nc,)."""
        return self._array(lambda row: row.e, lambda block: block.e, float)

    @property
    def impenetrable(self) -> Flags:
        """Flags of the rows with u >= 0 (nc,)."""
        return self._array(lambda row: row.impenetrable, lambda block: np.ones(len(block.names)), np.bool_)

    @property
    def ends(self) -> tuple[Indices, Indices]:
        """The upper and the lower node of each row (nc,): -1 for the ground, -2 for a sum of coordinates."""
        upper = self._array(lambda row: self._place(row.upper), lambda block: block.upper, np.int64)
        lower = self._array(lambda row: self._place(row.lower), lambda block: block.lower, np.int64)
        return upper, lower

    def _place(self, end: End) -> int:
        return self.places.get(end, -1) if isinstance(end, str) else -2

    def matrix(self) -> Sum:
        """Return H: in each row +1 at the lower and -1 at the upper node, or the coefficients of sums."""
        H = Sum(len(self), len(self.places))
        for start, block in zip(self._starts(), self._blocks, strict=False):
            if isinstance(block, Bumpers):
                for nodes, sign in ((block.lower, 1.0), (block.upper, -1.0)):
                    at = np.flatnonzero(nodes >= 0)
                    H.add(sign, (start + at, nodes[at]))
                continue
            for i, row in enumerate(block, start):
                for end, sign in ((row.lower, 1.0), (row.upper, -1.0)):
                    for node, coefficient in coefficients_of(end):
                        if node != GROUND:
                            H.add(sign * coefficient, (i, self.places[node]))
        return H


class Terms:
    """The terms of M, C, K, f and H that elements have added so far: floats, or with ``kind=object`` formulas.

    Attributes
    ----------
    index : dict of str to int      position of each node in q
    M, C, K : Sum                   what has been added so far
    loads : list                    index of the node and the load
    load_arrays : list              the indices of different nodes, factors, and the load that these multiply
    rows : ConstraintRows                     the rows of H
    springs : list of PowerLaw      the non-linear springs
    dashpots : list of RateLaw      the non-linear dashpots
    force_laws : list of ForceLaw   the general forces
    holds : list of HeldForce       the sampled forces
    motions : dict                  index of each node with prescribed motion, and its motion

    Examples
    --------
    >>> from lcpimpact import Spring, Terms
    >>> terms = Terms(("x", "y"))
    >>> Spring("x", "y", k=100.0).contribute(terms)
    >>> terms.K.value
    array([[ 100., -100.],
           [-100.,  100.]])
    """

    def __init__(self, nodes: Sequence[str], kind: type = float) -> None:
        n = len(nodes)
        self.index = {node: i for i, node in enumerate(nodes)}
        self.M, self.C, self.K = (Sum(n, n, kind) for _ in range(3))
        self.loads: list[tuple[int, float | TimeFunction]] = []
        self.load_arrays: list[tuple[Indices, Array, float | TimeFunction]] = []
        self.rows = ConstraintRows(self.index)
        self.springs: list[PowerLaw] = []
        self.dashpots: list[RateLaw] = []
        self.force_laws: list[ForceLaw] = []
        self.holds: list[HeldForce] = []
        self.motions: dict[int, Signal] = {}

    def direction(self, a: End, b: End) -> Array:
        """Return the row (n,) for which row·q = q_b - q_a; the ground does not move."""
        row = np.zeros(len(self.index))
        for end, sign in ((b, 1.0), (a, -1.0)):
            for node, coefficient in coefficients_of(end):
                if node != GROUND:
                    row[self.index[node]] += sign * coefficient
        return row

    def places(self, nodes: Iterable[str]) -> Indices:
        """Return the indices of nodes, -1 for the ground."""
        return np.array([self.index.get(node, -1) for node in nodes], dtype=np.int64)

    def link(self, matrix: Sum, a: str, b: str, value: float) -> None:
        """Add ``value`` times the square of (q_b - q_a) to the quadratic form of ``matrix``."""
        ends = [self.index[node] for node in (a, b) if node != GROUND]
        for i in ends:
            for j in ends:
                matrix.add(value if i == j else -value, (i, j))

    def link_all(self, matrix: Sum, a: Indices, b: Indices, values: Array) -> None:
        """Add each of ``values`` times the square of its (q_b - q_a) to the quadratic form of ``matrix``."""
        for i, j, sign in ((a, a, 1.0), (b, b, 1.0), (a, b, -1.0), (b, a, -1.0)):
            both = (i >= 0) & (j >= 0)
            matrix.add(sign * values[both], (i[both], j[both]))
