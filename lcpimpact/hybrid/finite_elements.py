"""Finite elements of Radau IIA in one contact mode: their tables, and the proof that they are free of events.

An element of the length h takes X to R(h A_m) X. With K derivatives at each end an event function is interpolated by a
polynomial of degree 2 K - 1, which its Bernstein coefficients bound; the derivative of order 2 K bounds the error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.hybrid.event_loop import read_segments
from lcpimpact.hybrid.radau_iia import RadauIIA
from lcpimpact.hybrid.spectrum import balance
from lcpimpact.hybrid.system import Mode, System
from lcpimpact.hybrid.transition import coordinates
from lcpimpact.numerics.polynomials import first_fall, without_zeros
from lcpimpact.numerics.rounding import EPS

K = 3
"""Number of derivatives, the value included, that interpolate an event function at each end of an element."""

DEGREE = 2 * K - 1

ELEMENT_ROUNDING = 32.0 * EPS
"""Rounding error of an event function on an element, relative to its terms."""


def _end_coefficients() -> Array:
    """Return the matrix from (h^j g^(j)(0)), j < K, to the first K Bernstein coefficients of degree 2 K - 1."""
    n = DEGREE
    return np.array([[math.comb(i, j) * math.factorial(n - j) / math.factorial(n) for j in range(K)] for i in range(K)])


AT_END = _end_coefficients()
SIGNS = (-1.0) ** np.arange(K)


def _error_factor(m: int, p: int) -> float:
    """Return max s^(K - m) (1 - s)^(K - p) / (2 K)!."""
    a, b = K - m, K - p
    return float(a**a * b**b / (a + b) ** (a + b) / math.factorial(2 * K))


WEIGHTS = np.array([[without_zeros(DEGREE, m, p) for p in (0, 1)] for m in range(K + 1)])
ERROR = np.array([[_error_factor(m, p) for p in (0, 1)] for m in range(K + 1)])


@dataclass(frozen=True, eq=False)
class ElementTable:
    """The matrices of an element of one length in one mode, applied to its initial state.

    Attributes
    ----------
    stages : (s, N, N) array            X_i
    hull : (nw, 2 K, N) array           Bernstein coefficients of the event functions
    size : (nw, 2 K, N) array           the sum of their absolute terms
    highest : (nw, s + 1, N) array      h^2K g^(2K) at the start and the stages
    estimate : (N, N) array or None     R(h) - R(h/2)², the error estimate
    """

    stages: Array
    hull: Array
    size: Array
    highest: Array
    estimate: Array | None

    @property
    def end(self) -> Array:
        """R(h A)."""
        return np.asarray(self.stages[-1])

    def states(self, X: Array, count: int) -> Array:
        """Return R^j X, j = 0 ... count: (count + 1, N), by doubling."""
        found, step = X[None, :], self.end
        while len(found) <= count:
            found = np.concatenate([found, found @ step.T])
            step = step @ step
        return found[: count + 1]


@dataclass(frozen=True, eq=False)
class Elements:
    """The elements of one mode.

    Attributes
    ----------
    mode : Mode                 the mode
    radau : RadauIIA            the method
    A : (N, N) array            A + B F
    rows : (nw, N) array        the event functions
    contacts : (nu, N) array    the gaps of the closed rows, which stay zero
    terms : (nu, N) array       the sum of their absolute terms, and of those of their way in a step
    h : float                   the step; tables of h, h/2, h/4, ... are cached
    estimated : bool            whether the tables hold the error estimate
    constant : int              the first state of the signals
    """

    mode: Mode
    radau: RadauIIA
    A: Array
    rows: Array
    contacts: Array
    terms: Array
    h: float
    estimated: bool
    constant: int
    kept: dict[float, ElementTable] = field(default_factory=dict)

    @cached_property
    def units(self) -> Array:
        """The scales of the states that balance A (N,)."""
        return balance(self.A)[1]

    @cached_property
    def derivatives(self) -> Array:
        """The rows of g, g', ..., g^(2K): (2 K + 1, nw, N)."""
        found = [self.rows]
        for _ in range(2 * K):
            found.append(found[-1] @ self.A)
        return np.array(found)

    def table(self, length: float) -> ElementTable:
        """Return the table of one length."""
        if length in self.kept:
            return self.kept[length]
        made = self._make(length)
        if math.frexp(length)[0] == math.frexp(self.h)[0]:
            self.kept[length] = made
        return made

    def _make(self, length: float) -> ElementTable:
        stages = self._propagators(np.array([length]))[0]
        powers = length ** np.arange(2 * K + 1)
        scaled = self.derivatives * powers[:, None, None]
        left = np.einsum("ij,jwn->win", AT_END, scaled[:K])
        right = np.einsum("ij,jwn->win", AT_END * SIGNS, scaled[:K])[:, ::-1]
        hull = np.concatenate([left, right @ stages[-1]], axis=1)
        size = np.concatenate([np.abs(left), np.abs(right) @ np.abs(stages[-1])], axis=1)
        highest = np.concatenate([scaled[-1][:, None], np.einsum("wn,inm->wim", scaled[-1], stages)], axis=1)
        estimate = None
        if self.estimated:
            half = self._propagators(np.array([0.5 * length]))[0, -1]
            estimate = stages[-1] - half @ half
        return ElementTable(stages, hull, size, highest, estimate)

    def _propagators(self, lengths: Array) -> Array:
        """Return the matrices of the stages (nt, s, N, N)."""
        return self.radau.stages(self.A, lengths, np.broadcast_to(np.eye(len(self.A)), (len(lengths), *self.A.shape)))

    def at(self, X: Array, times: Array, quantum: float, *, max_entries: int = 2_000_000) -> Array:
        """Return the ends of elements of the lengths ``times`` (nt,) from X (nt, N); those within ``quantum`` are one.

        ``max_entries``: maximum number of entries in a batch of matrices.
        """
        _, first, which = np.unique(np.round(times / quantum), return_index=True, return_inverse=True)
        found = np.empty_like(X)
        chunk = max(1, max_entries // (len(self.radau.c) * self.A.size))
        if 2 * len(first) > len(times):
            for begin in range(0, len(times), chunk):
                here = slice(begin, begin + chunk)
                found[here] = self.radau.stages(self.A, times[here], X[here, :, None])[:, -1, :, 0]
            return found
        for begin in range(0, len(first), chunk):
            ends = self._propagators(times[first[begin : begin + chunk]])[:, -1]
            mine = (which >= begin) & (which < begin + chunk)
            found[mine] = np.einsum("tij,tj->ti", ends[which[mine] - begin], X[mine])
        return found

    def safe(
        self, table: ElementTable, X: Array, scale: Array, zeros: Indices, ends: Indices
    ) -> tuple[Flags, Array, Array]:
        """Return whether each event function stays positive on elements from the states X (nt, N): (nt, nw).

        ``zeros`` (nw,) is the order of the zero at the start, at most K, and ``ends`` (nw,) is 1 for a row with a zero at
        the end. Returned too are the Bernstein coefficients without these zeros, and those with them.
        """
        b = np.einsum("win,tn->twi", table.hull, X)
        b -= np.where(zeros > 0, b[:, :, 0], 0.0)[:, :, None]
        noise = ELEMENT_ROUNDING * (table.size @ np.maximum(scale, np.abs(X).max(axis=0)))
        # The highest derivative is known at the start and the stages; twice the largest value bounds it between them.
        D = 2.0 * np.abs(np.einsum("win,tn->twi", table.highest, X)).max(axis=2)
        weights = WEIGHTS[zeros, ends]
        error = D * ERROR[zeros, ends]
        reduced, kept = b * weights, weights > 0.0
        clear = (reduced - error[:, :, None] - noise * weights > 0.0) | ~kept
        within = ((b >= -noise) | ~kept) & (error <= noise[:, 0])[:, :, None]
        return clear.all(axis=2) | within.all(axis=2), reduced, b

    def noise(self, scale: Array) -> Array:
        """Return the rounding error of the event functions (nw,)."""
        return ELEMENT_ROUNDING * (np.abs(self.rows) @ scale)

    def judge(self, stages: Array, X: Array, length: float, scale: Array) -> float:
        """Return the largest error of the equations of elements: of their stages (nt, s, N), and of complementarity.

        Across the stages r of open rows is zero by F; so what remains are the gaps of closed rows, and the forces and gaps
        that end below zero; each relative to its terms.
        """
        rates = stages @ self.A.T
        error = np.abs(stages - X[:, None] - length * (self.radau.a @ rates)).max(axis=(0, 1))
        size = np.maximum(np.abs(X).max(axis=0), np.abs(stages).max(axis=(0, 1)))
        terms = size + length * (np.abs(self.A) @ size)
        terms, scale = (np.maximum(each, self._floor(each)) for each in (terms, np.maximum(scale, size)))
        below = np.maximum(-stages[:, -1] @ self.rows.T, 0.0).max(axis=0, initial=0.0)
        closed = np.abs(stages @ self.contacts.T).max(axis=(0, 1), initial=0.0)
        errors = np.concatenate([error, below, closed])
        terms = np.concatenate([terms, np.abs(self.rows) @ scale, self.terms @ scale])
        return float((errors / np.maximum(terms, np.finfo(float).tiny)).max())

    def _floor(self, sizes: Array, *, small_state: float = 1e-6) -> Array:
        """Return the least sizes of states at rest, which have the rounding error of the others, where A is balanced (N,).

        The signals are others: their units have nothing to do with those of the motion.

        ``small_state``: states below this, relative to the largest of their kind, are judged on the scale of
        the largest.
        """
        within = sizes / self.units
        moving, signals = np.split(within, [self.constant])
        largest = np.repeat([moving.max(initial=0.0), signals.max()], [len(moving), len(signals)])
        return np.asarray(small_state * self.units * largest)

    def root(
        self, X: Array, row: int, zero: float, guess: float, length: float, scale: Array, most: int
    ) -> tuple[float | None, int]:
        """Solve for the stages and the length of the element at whose end a row vanishes; return it, and the iterations.

        Newton's method from ``guess``, kept in the bracket [0, length]; None if it does not converge. ``zero`` is the
        value of the row at its zero: its initial rounding error, if it began at zero.
        """
        c = self.rows[row]
        low = 0.0
        high = length
        h = guess
        enough = 4.0 * EPS * float(np.abs(c) @ np.maximum(scale, np.abs(X)))
        for steps in range(1, most + 1):
            end, rate = self.radau.end_and_rate(self.A, h, X)
            value, slope = float(c @ end) - zero, float(c @ rate)
            low, high = (h, high) if value > 0.0 else (low, h)
            if abs(value) <= enough or high - low <= 2.0 * EPS * high:
                return float(h), steps
            step = h - value / slope if slope < 0.0 else -1.0
            h = step if low < step < high else 0.5 * (low + high)
        return None, most


def first_crossing(b: Array, reduced: Array, safe: Flags, zeros: Indices, noise: Array) -> tuple[int, float] | None:
    """Return the row that seems to end a mode first on an element, and where on [0, 1], from its Bernstein coefficients."""
    found = []
    for row in map(int, np.flatnonzero(~safe)):
        m = int(zeros[row])
        if m == 0 and (b[row, 0] < -noise[row] or b[row, 1] < b[row, 0] <= 0.0):
            found.append((0.0, row))
        elif b[row, -1] < -noise[row] and reduced[row, m] > 0.0:
            found.append((first_fall(np.array([reduced[row, m:], np.zeros(DEGREE + 1 - m)]), 0.0), row))
    return min(found)[::-1] if found else None


@dataclass(frozen=True, eq=False)
class ElementSolution:
    """Continuous solution by elements, each with an initial state (N,) and a mode, that end at the requested times."""

    system: System
    kinds: tuple[Elements, ...]
    starts: Array
    states: Array
    kind: Indices
    rounding: float

    def __call__(self, t: Array, side: str) -> tuple[Array, Array, Array]:
        """Return q, v and r at the sorted times t (nt,), on one side of the events."""

        def read_mode(owner: Indices, mine: Indices | slice) -> tuple[Array, Array, Array]:
            """Return q, v and r at times in elements of one mode."""
            elements = self.kinds[self.kind[owner[0]]]
            X = elements.at(self.states[owner], np.maximum(t[mine] - self.starts[owner], 0.0), self.rounding)
            return coordinates(self.system, elements.mode, X)

        return read_segments(self.system.dynamics, self.starts, self.kind, t, side, read_mode)
