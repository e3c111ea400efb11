r"""The flow X' = A X whose rates differ by orders of magnitude, in windows as long as the motion allows.

In `RateBlocks` y = L X, blocks of rates move each by itself. Of a block that decays |S y| never grows, so

.. math:: c \cdot X(t) \ge \sum_{slow} (c Z)\, y(t) - ρ, \qquad
          ρ = \sum_{fast} |(c Z) S^{-1}|\, |S y(t_0)|, \qquad t \ge t_0 .

So the windows of the slow blocks prove that a row stays positive: the bound ρ of the fast ones is subtracted from it, as a
state that stands still. A window that this does not prove is cut into those of faster blocks, down to the fastest. An event
is located in the fastest windows, of X itself: it keeps the modes that no row sees, and the digits of what is small in X.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Array, Indices
from lcpimpact.errors import InputError
from lcpimpact.hybrid.generator import DEGREE, NO_BAND, Generator, SparseRows, expand_finely, horner, sparse
from lcpimpact.hybrid.sampling import Segments
from lcpimpact.hybrid.spectrum import RateBlocks
from lcpimpact.hybrid.windows import BERNSTEIN, NO_HULLS, Window, scan
from lcpimpact.interpreter import throughout
from lcpimpact.numerics.double_double import FINE_EPS, DoubleDouble, add, multiply
from lcpimpact.numerics.rounding import EPS


class RateLevel(NamedTuple):
    """The blocks from one on, resolved by windows of 2ᵏ those of all blocks.

    Attributes
    ----------
    block : int             the first of them
    k : int
    window : Window         of their states, and of one that stands still
    """

    block: int
    k: int
    window: Window


class ZeroCrossing(NamedTuple):
    """The first event: the row that turns negative first.

    Attributes
    ----------
    row : int               its number; -1 if there is none
    t : DoubleDouble        the instant, from the start; the horizon if there is none
    scale : (N,) array      the largest |X| up to there
    state : DoubleDouble    X there; without an event that of the last window
    """

    row: int
    t: DoubleDouble
    scale: Array
    state: DoubleDouble


@dataclass(frozen=True, eq=False)
class ConjugatePair:
    """The flow of a block B (2, 2) of two conjugate rates, with their decay in 1/s and turns per s."""

    B: Array
    decay: float
    turns: DoubleDouble

    def __call__(self, y: DoubleDouble, t: Array) -> Array:
        """Return exp(B t) y (2, nt) at times t: whole turns, which are counted in double-doubles, change no digit."""
        turns = DoubleDouble(np.array(throughout(multiply)(self.turns.hi, self.turns.lo, t, 0.0)))
        angle = math.tau * ((turns.hi - np.rint(turns.hi)) + turns.lo)
        rate = (self.B @ y.hi + self.decay * y.hi) / (math.tau * float(self.turns.hi))
        around = np.multiply.outer(y.hi, np.cos(angle)) + np.multiply.outer(rate, np.sin(angle))
        return np.asarray(np.exp(-self.decay * t) * around)


def pair_of(B: DoubleDouble, *, rtol: float = 1e-2) -> ConjugatePair | None:
    """Return the flow of a block of two conjugate rates, ω² of which is at least ``rtol`` of its terms; None for others."""
    if len(B) != 2:
        return None
    (a, b), (c, d) = ([B[i, j] for j in range(2)] for i in range(2))
    square = -b * c - (a - d) * (a - d) * 0.25
    if not square.hi > rtol * abs(b.hi * c.hi):
        return None
    root = DoubleDouble.of(math.sqrt(square.hi))
    turn = DoubleDouble(np.array([math.tau, 2.4492935982947064e-16]))
    return ConjugatePair(B.hi, -0.5 * float(a.hi + d.hi), (root + square / root) * 0.5 / turn)


@dataclass(frozen=True, eq=False)
class StiffFlow:
    """The flow in the blocks of its rates.

    Attributes
    ----------
    rates : RateBlocks
    fastest : Window            of X itself, which resolves all blocks
    windows : (nb,) array       length of the windows of each block in s, powers of two
    others : list               the blocks of several states
    moves : list                the flow of each of these: exp(B t) y (n, nt) at sorted times t
    vanishing : (nb,) array     the time in s after which each block has vanished in floats; inf if it does not decay
    single : (k,) array         the states that are blocks of their own
    squares : list              exp(2ᵏ B δ) of the single states, and of each other block, as far as it is known
    """

    rates: RateBlocks
    fastest: Window
    windows: Array
    others: list[slice]
    moves: list[Callable[[DoubleDouble, Array], Array]]
    vanishing: Array
    single: Indices
    squares: list[tuple[DoubleDouble, list[DoubleDouble]]] = field(default_factory=list)

    @classmethod
    def of(
        cls,
        rates: RateBlocks,
        fastest: Window,
        windows: Array,
        at: Callable[[DoubleDouble, DoubleDouble, Array], Array],
    ) -> StiffFlow:
        """Return the flow; ``at(B, y, t)`` is exp(B t) y (n, nt) of a block that is no pair."""
        others = [each for each in rates.blocks if each.stop - each.start > 1]
        moves: list[Callable[[DoubleDouble, Array], Array]] = []
        for here in others:
            B = rates.B[here, here]
            moves.append(pair_of(B) or partial(at, B))
        single = np.array([each.start for each in rates.blocks if each.stop - each.start == 1], dtype=np.int64)
        return cls(rates, fastest, windows, others, moves, vanishing_times(rates), single)

    @property
    def window(self) -> float:
        """δ, the length of the windows of all blocks."""
        return self.fastest.δ

    def doubled(self, k: int) -> tuple[DoubleDouble, list[DoubleDouble]]:
        """Return exp(2ᵏ B δ)."""
        if not self.squares:
            B, δ = self.rates.B, self.window
            alone = exponential(B[self.single, self.single], δ)
            self.squares.append((alone, [exponential(B[here, here], δ) for here in self.others]))
        while len(self.squares) <= k:
            alone, together = self.squares[-1]
            self.squares.append((alone * alone, [each @ each for each in together]))
        return self.squares[k]

    def moved(self, y: DoubleDouble, windows: int) -> DoubleDouble:
        """Return y after a number of windows."""
        parts = y.parts.copy()
        for k in range(windows.bit_length()):
            if windows >> k & 1:
                alone, together = self.doubled(k)
                parts[:, self.single] = (alone * DoubleDouble(parts[:, self.single])).parts
                for here, each in zip(self.others, together, strict=True):
                    parts[:, here] = (each @ DoubleDouble(parts[:, here])).parts
        return DoubleDouble(parts)

    def move(self, X: DoubleDouble, t: float, t_lo: float) -> DoubleDouble:
        """Return exp(A t) X for one state X (N,) and one time t >= 0, a double-double."""
        windows = math.floor(t / self.window)
        within, rest = add(t, t_lo, -windows * self.window, 0.0)
        y = np.ascontiguousarray(self.moved(self.rates.L @ X, windows).parts)
        terms = expand_finely(Generator(sparse(self.rates.B), 0, NO_BAND), self.window, y, DEGREE)
        return self.rates.Z @ DoubleDouble(horner(terms, within / self.window, rest / self.window))

    def read(
        self, chain: Segments, mine: Indices, t: Array, bounds: Indices, rows: SparseRows, found: Array,
        *, at_once: int = 1 << 12,
    ) -> None:  # fmt: skip
        """Write R X at sorted times into ``found``, as `Flow.read` does; the sums over blocks are floats.

        ``at_once``: number of times that are read together, which bounds the memory.
        """
        dense = np.zeros((2, len(rows.starts) - 1, len(self.rates.B)))
        dense[:, np.repeat(np.arange(dense.shape[1]), np.diff(rows.starts)), rows.columns] = rows.entries
        R = (DoubleDouble(dense) @ self.rates.Z).hi
        for i in mine:
            y = self.rates.L @ DoubleDouble(chain.states[i])
            for first in range(bounds[i], bounds[i + 1], at_once):
                here = slice(first, min(first + at_once, bounds[i + 1]))
                since = np.maximum((t[here] - chain.starts[i, 0]) - chain.starts[i, 1], 0.0)
                found[:, here] = R @ self.at(y, since)

    def at(self, y: DoubleDouble, t: Array) -> Array:
        """Return exp(B t) y at sorted times t (N, nt), in floats."""
        Y = np.zeros((len(y), len(t)))
        rates = self.rates.B.hi[self.single, self.single]
        Y[self.single] = y.hi[self.single, None] * np.exp(rates[:, None] * t)
        for here, move in zip(self.others, self.moves, strict=True):
            live = int(t.searchsorted(self.vanishing[self.rates.blocks.index(here)]))
            Y[here, :live] = move(y[here], t[:live])
        return Y

    def largest(self, y: DoubleDouble, length: float, windows: float, *, most: int = 64) -> Array:
        """Return the largest |X| at the ends of some windows, at most ``most`` of them, from y on (N,)."""
        t = np.linspace(0.0, length, int(min(windows, most)) + 1)
        return np.asarray(np.abs(self.rates.Z.hi @ self.at(y, t)).max(axis=1))

    def cuts(self, length: float, most: int) -> Array:
        """Return at most most + 1 times in [0, ``length``) between which the blocks that have not vanished are resolved."""
        found: list[float] = []
        t, longest = 0.0, float(self.windows.max())
        while t < length and len(found) <= most:
            found.append(t)
            t += float(self.windows[t < self.vanishing].min(initial=longest))
        return np.array(found)

    @cached_property
    def levels(self) -> list[RateLevel]:
        """The levels, that of all blocks first; the windows of each are at least four times as long as the ones before."""
        found = [RateLevel(0, 0, self.fastest)]
        for block in range(min(int(np.count_nonzero(self.rates.decay)) + 1, len(self.windows))):
            δ = float(self.windows[block:].min())
            if δ >= 4.0 * found[-1].window.δ:
                first, k = self.rates.bounds[block], round(math.log2(δ / self.window))
                parts = (self.rates.B.parts, self._step(k))
                B, step = (np.pad(each[:, first:, first:], ((0, 0), (0, 1), (0, 1))) for each in parts)
                step[0, -1, -1] = 1.0
                generator = Generator(sparse(DoubleDouble(B)), 0, NO_BAND)
                found.append(RateLevel(block, k, Window(generator, δ, np.ascontiguousarray(step))))
        return found

    def _step(self, k: int) -> Array:
        """Return exp(2ᵏ B δ) as a matrix (2, N, N)."""
        step = np.zeros_like(self.rates.B.parts)
        alone, together = self.doubled(k)
        step[:, self.single, self.single] = alone.parts
        for here, each in zip(self.others, together, strict=True):
            step[:, here, here] = each.parts
        return step

    def bound(self, rows: Array, y: Array, block: int) -> Array:
        """Return the largest that the blocks before one can contribute to rows c Z (k, N), from y on: (k,)."""
        rates, found = self.rates, np.zeros(len(rows))
        n = rates.bounds[block]
        scaled = rows[:, :n] @ rates.inverse[:n, :n]
        size = rates.norm[:n, :n] @ y[:n]
        for here in rates.blocks[:block]:
            found += np.linalg.norm(scaled[:, here], axis=1) * np.linalg.norm(size[here])
        return np.asarray((1.0 + 4.0 * n * EPS) * found)

    def first_crossing(
        self, X: DoubleDouble, scale: Array, rows: DoubleDouble, order: Indices, horizon: float, max_windows: int,
        *, tried: int = 8, max_scanned: int = 20_000,
    ) -> ZeroCrossing:  # fmt: skip
        """Return the first instant up to ``horizon`` at which a row turns negative, as `Flow.first_crossing` does.

        ``tried``: number of windows of a level after which longer ones are tried.
        ``max_scanned``: maximum number of windows in one call of compiled code; Ctrl-C acts between calls.
        """
        rates, lines = self.rates, rows @ self.rates.Z
        y, size = rates.L @ X, np.abs(rates.L.hi) @ scale
        largest = np.maximum(scale, np.abs(X.hi))
        if not len(rows):  # nothing can end a mode without rows
            largest = np.maximum(largest, self.largest(y, horizon, math.inf))
            return ZeroCrossing(-1, DoubleDouble.of(horizon), largest, self.move(X, horizon, 0.0))
        negligible = FINE_EPS / 16.0 * (np.abs(rows.hi) @ scale)
        zeros = np.asarray(order, dtype=np.int64)
        many = tried
        at = done = 0
        while done * self.window <= horizon:
            level = self.levels[at]
            first, δ = rates.bounds[level.block], level.window.δ
            last = at == len(self.levels) - 1
            left = math.floor((horizon - done * self.window) / δ) + 1
            if last and left > max_windows:
                raise endless(horizon, left)
            many = min(2 * many, max_scanned) if last else tried
            count = min(left, many)
            if at == 0:  # as it is: what is small in X may cancel in y
                state = np.array((rates.Z @ y if done else X).parts, order="C")
                j, row, s, s_lo = scan(self.fastest, state, sparse(rows), NO_HULLS, zeros, BERNSTEIN, count, largest)
                if j >= 0:
                    t = DoubleDouble(np.array(add(s * δ, s_lo * δ, (done + j) * δ, 0.0)))  # δ is a power of two
                    return ZeroCrossing(row if t.hi <= horizon else -1, t, largest, DoubleDouble(state))
                passed, lower = count, 0
            else:
                rest = self.bound(lines.hi, y.hi, level.block)
                below = np.stack([-rest, np.zeros_like(rest)])
                entries = sparse(DoubleDouble(np.concatenate([lines.parts[:, :, first:], below[:, :, None]], axis=2)))
                state = np.concatenate([y.parts[:, first:], [[1.0], [0.0]]], axis=1)
                sizes = np.append(size[first:], 1.0)
                j, row, s, s_lo = scan(level.window, state, entries, NO_HULLS, zeros, BERNSTEIN, count, sizes)
                size[first:] = sizes[:-1]
                windows = count if j < 0 else j
                largest = np.maximum(largest, self.largest(y, windows * δ, windows))
                passed, lower = windows << level.k, at - 1
                if j >= 0 and (rest <= negligible).all():
                    passed, lower = passed + max(math.floor(s * δ / self.window) - 1, 0), 0
            y, done = self.moved(y, passed), done + passed
            zeros = np.zeros_like(zeros) if passed else zeros
            at = lower if j >= 0 else min(at + 1, len(self.levels) - 1)
        return ZeroCrossing(-1, DoubleDouble.of(horizon), largest, rates.Z @ y)


def endless(horizon: float, windows: int) -> InputError:
    """Return the refusal of a run of too many windows."""
    return InputError(
        f"{horizon:.3g} s are {windows:.1e} times what the motion turns in: take a shorter t_end, or moreau-jean"
    )


def vanishing_times(rates: RateBlocks, *, exponent: float = 40.0) -> Array:
    """Return the time in s after which each block has vanished in floats (nb,), inf for one that does not decay.

    ``exponent``: that at which a decaying mode has vanished: exp(-40) = 4e-18.
    """
    after = np.full(len(rates.decay), np.inf)
    for k, here in enumerate(rates.blocks):
        if rates.decay[k] > 0.0:
            after[k] = (exponent + math.log(np.linalg.cond(rates.norm[here, here]))) / rates.decay[k]
    return after


def exponential(B: DoubleDouble, δ: float) -> DoubleDouble:
    """Return exp(B δ) of a matrix (n, n), or entry by entry of a vector (n,); δ is a power of two."""
    matrix = B.parts.ndim == 3
    term = found = DoubleDouble.of(np.eye(len(B)) if matrix else np.ones(len(B)))
    step = DoubleDouble(B.parts * δ)
    for i in range(1, DEGREE + 1):
        term = (step @ term if matrix else step * term) / float(i)
        found = found + term
        if not (np.abs(term.hi) > FINE_EPS**2).any():
            break
    return found
