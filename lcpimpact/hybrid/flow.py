r"""The flow X(s) = exp(A s) X(0) of one contact mode, and the first instant at which an event function c·X turns negative.

The time is cut into windows of length δ with ρ δ <= 1, where ρ is the spectral radius of |A|: the infimum of ‖D⁻¹ A D‖
over all units D of the states. So windows depend on no units, and loads, however large, do not shorten them. No event is
missed: `lcpimpact.hybrid.windows` proves for each window that there is none in it, or finds the first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array, Flags, Indices, inverse
from lcpimpact.compiled import or_whole
from lcpimpact.hybrid.generator import (
    DEGREE,
    FINE_TERMS,
    NO_BAND,
    Generator,
    SparseRows,
    expand_finely,
    exponential,
    horner,
    products,
    sparse,
    unit_rows,
    walk,
)
from lcpimpact.hybrid.sampling import Expansions, Segments, sample, sample_together
from lcpimpact.hybrid.spectrum import spectral_radius, split_rates
from lcpimpact.hybrid.stiff_flow import StiffFlow, ZeroCrossing, endless
from lcpimpact.hybrid.windows import BERNSTEIN, NO_HULLS, Window, scan
from lcpimpact.numerics.banded import factor, lower_bands
from lcpimpact.numerics.double_double import FINE_EPS, DoubleDouble, add

MAX_KEPT = 1 << 20
"""Numbers in the polynomials that are kept from one reading to the next: 8 MB."""

FIRST_WINDOWS, WINDOWS_PER_CALL = 64, 20_000
"""Smallest number of windows in the first call of compiled code, and number in each later one; Ctrl-C acts between calls."""

MIN_WINDOWS = 16
"""Minimum number of windows of a run."""

WINDOW_RTOL = 1e-3
"""Excess of a window over 1/ρ, so that the rounding of ρ does not halve it where ρ is a power of two."""

SPLIT_COST = 16
"""Windows, in units of the number of states, that cost as much as splitting off the fastest rates."""

NO_STEP = np.zeros((2, 0, 0))


class DiagonalBlock(NamedTuple):
    """The block of P in A = P⁻¹ Q: its first row, and P itself (nb, nb), positive definite."""

    first: int
    P: DoubleDouble


@dataclass(frozen=True, eq=False)
class Flow:
    """The flow of X' = A X.

    Attributes
    ----------
    generator : DoubleDouble        A (N, N)
    duration : float                that of the run in s
    block : Block, optional         the block of P where A = P⁻¹ Q with a sparser Q
    """

    generator: DoubleDouble
    duration: float
    block: DiagonalBlock | None = None

    @property
    def A(self) -> Array:
        """A in floats (N, N)."""
        return self.generator.hi

    @cached_property
    def window(self) -> float:
        """δ, the length of a window in s, a power of two."""
        longest = 1.0 / max(spectral_radius(np.ascontiguousarray(self.A)), MIN_WINDOWS / self.duration)
        return float(2.0 ** math.floor(math.log2((1.0 + WINDOW_RTOL) * longest)))

    @cached_property
    def factors(self) -> Generator:
        """A, or P⁻¹ and Q if a product with them costs less."""
        plain = Generator(sparse(self.generator), 0, NO_BAND)
        if self.block is None:
            return plain
        first, P = self.block
        rows = slice(first, first + len(P))
        width = int(np.abs(np.subtract(*np.nonzero(P.hi))).max(initial=0))
        A = self.generator[rows]
        Q = DoubleDouble(self.generator.parts.copy())
        Q.parts[:, rows] = (P @ A).parts
        Q.parts[:, rows][:, np.abs(Q.hi[rows]) <= FINE_EPS * (np.abs(P.hi) @ np.abs(A.hi))] = 0.0
        band = np.array([lower_bands(part, width) for part in P.parts])
        found = Generator(sparse(Q), first, band)
        return found if factor(band[0], band[1], 0.0) and products(found) < products(plain) else plain

    @cached_property
    def walks(self) -> bool:
        """Whether the series of a window costs less than a product with exp(A δ)."""
        return FINE_TERMS * products(self.factors) + DEGREE * len(self.A) < len(self.A) ** 2

    @cached_property
    def step(self) -> Array:
        """exp(A δ) (2, N, N), or an empty array if the flow walks."""
        return NO_STEP if self.walks else self.squares[0].parts

    @cached_property
    def squares(self) -> list[DoubleDouble]:
        """exp(A δ), exp(2 A δ), exp(4 A δ) ...: the powers computed so far."""
        return [DoubleDouble(exponential(self.factors, self.window, len(self.A), DEGREE))]

    def doubled(self, k: int) -> DoubleDouble:
        """Return exp(2ᵏ A δ)."""
        while len(self.squares) <= k:
            self.squares.append(self.squares[-1] @ self.squares[-1])
        return self.squares[k]

    def move(self, X: DoubleDouble, t: float, t_lo: float = 0.0, far: bool = False) -> DoubleDouble:
        """Return exp(A t) X for one state X (N,) and one time t >= 0, a double-double; by powers of exp(A δ) if ``far``."""
        if self.stiff is not None:
            return self.stiff.move(X, t, t_lo)
        δ, windows = self.window, math.floor(t / self.window)
        if self.walks and not far and windows <= SPLIT_COST * len(X):
            X = DoubleDouble(walk(self.factors, δ, np.ascontiguousarray(X.parts), windows, DEGREE))
        else:
            for k in range(windows.bit_length()):
                if windows >> k & 1:
                    X = self.doubled(k) @ X
        within, rest = add(t, t_lo, -windows * δ, 0.0)
        terms = expand_finely(self.factors, δ, np.ascontiguousarray(X.parts), DEGREE)
        return DoubleDouble(horner(terms, within / δ, rest / δ))

    def over(self, t: float) -> Array:
        """Return exp(A t) for one time t >= 0 (N, N)."""
        return np.column_stack([self.move(DoubleDouble.of(unit), t, far=True).hi for unit in np.eye(len(self.A))])

    def at(self, X: ArrayLike | DoubleDouble, times: Array) -> Array:
        """Return exp(A t) X at the times t >= 0 (nt,), in floats: (nt, N)."""
        t = np.asarray(times, dtype=np.float64)
        order = np.argsort(times, kind="stable")
        states = np.array(DoubleDouble.of(X).parts, order="C")[None]
        return self.along(states, [t[order]], unit_rows(len(self.A))).T[inverse(order)]

    def along(self, states: Array, times: Sequence[Array], rows: SparseRows) -> Array:
        """Return R exp(A t) X (m, nt) of states (ns, 2, N) at sorted times t >= 0 after each, one after the other."""
        bounds = np.cumsum([0, *map(len, times)])
        found = np.empty((len(rows.starts) - 1, bounds[-1]))
        chain = Segments(np.zeros((len(states), 2)), states)
        kept = self.expansions(np.array([np.inf]), rows)
        self.read(chain, np.arange(len(states)), np.concatenate(times), bounds, rows, kept, found)
        return found

    def terms(self, rows: DoubleDouble, *, cost: int = 10) -> DoubleDouble | None:
        """Return c (A δ)^i/i! of each row, the maps from X to its coefficients over a window: (m (p + 1), N).

        The last powers, which add nothing to the ones before, are left out. None if their product with a state is more than
        ``cost`` times as long as the series.
        """
        n, m = len(self.A), len(rows)
        series = FINE_TERMS * (products(self.factors) + n + np.count_nonzero(rows.hi))
        if self.stiff is not None or self.walks or m * (DEGREE + 1) * n > cost * series:
            return None
        powers = np.zeros((2, n, DEGREE + 1, n))
        for j, unit in enumerate(np.eye(n)):
            Z = expand_finely(self.factors, self.window, DoubleDouble.of(unit).parts, DEGREE)
            powers[:, :, : len(Z), j] = Z.transpose(1, 2, 0)
        found = (rows @ DoubleDouble(powers.reshape(2, n, -1))).parts.reshape(2, m, DEGREE + 1, n)
        size = np.abs(found[0])
        counts = size > FINE_EPS * size.max(axis=1, keepdims=True)
        last = np.flatnonzero(counts.any(axis=(0, 2))).max(initial=0)
        return DoubleDouble(found[:, :, : last + 1].reshape(2, -1, n))

    def expansions(self, lengths: Array, rows: SparseRows) -> Expansions:
        """Return room for the polynomials of segments of given lengths in s; none above `MAX_KEPT` numbers."""
        m = len(rows.starts) - 1
        windows = lengths.sum() / self.window + len(lengths)
        if self.stiff is not None or not windows * m * (DEGREE + 1) <= MAX_KEPT:
            lengths = lengths[:0]
        first = np.zeros(len(lengths) + 1, np.int64)
        np.cumsum(np.maximum(lengths / self.window, 0.0).astype(np.int64) + 1, out=first[1:])
        return Expansions(first, np.full(first[-1], -1), np.empty((first[-1], m, DEGREE + 1)), False)

    def read(
        self,
        chain: Segments,
        mine: Indices,
        t: Array,
        bounds: Indices,
        rows: SparseRows,
        kept: Expansions,
        found: Array,
    ) -> None:
        """Write R X at the sorted times t (nt,) in some segments of a chain, in floats, into ``found`` (m, nt).

        Parameters
        ----------
        chain : Chain                   all segments (ns)
        mine : (k,) array               those of this flow
        t : (nt,) array
        bounds : (ns + 1,) array        the first time in each segment, and the end
        rows : SparseRows               R (m, N)
        kept : Expansions               the polynomials that several readings share, those of `expansions`
        found : (m, nt) array
        """
        read = mine[bounds[mine + 1] > bounds[mine]]
        if not len(read):
            return
        if self.stiff is not None:
            self.stiff.read(chain, read, t, bounds, rows, found)
            return
        last = 0.0  # window that is reached from the start of its segment
        if not kept.together:
            last = max(float((t[bounds[read + 1] - 1] - chain.starts[read, 0]).max()), 0.0) / self.window
        if self.walks and last <= SPLIT_COST * (len(t) + len(self.A)):
            powers = np.zeros((0, 2, 0, 0))
        else:
            self.doubled(max(int(last).bit_length() - 1, 0))
            powers = np.array([power.parts for power in self.squares])
        given = Window(self.factors, self.window, NO_STEP), powers, chain, mine, t, bounds, rows, kept, found
        if kept.together:
            or_whole(sample, sample_together, *given)
        else:
            sample(*given)

    @cached_property
    def stiff(self) -> StiffFlow | None:
        """The flow in the blocks of its rates, if it has many windows and the fastest decay; None if not."""
        return in_blocks(self)

    def cuts(self, length: float, most: int) -> tuple[Array, Flags]:
        """Return times in [0, ``length``), and whether exp(A t) is resolved between them.

        They are the windows, and if there are more than ``most``, those that resolve the rates that have not decayed. If
        these are too many, they are some of the windows, each with the gap behind it as one piece.
        """
        windows = math.ceil(length / self.window)
        if windows <= max(most, 1):
            return np.arange(windows, dtype=np.float64) * (length / max(windows, 1)), np.ones(windows, np.bool_)
        if self.stiff is not None and len(times := self.stiff.cuts(length, most)) <= most:
            return times, np.ones(len(times), np.bool_)
        some = np.unique(np.floor(np.geomspace(1.0, windows, most // 2)) - 1.0)
        times = np.unique(np.append(some, some[:-1] + 1.0))
        return times * (length / windows), np.isin(times, some)

    def first_crossing(
        self,
        X: ArrayLike | DoubleDouble,
        scale: Array,
        rows: ArrayLike | DoubleDouble,
        order: Indices,
        horizon: float,
        entries: SparseRows | None = None,
        *,
        max_windows: int = 10**11,
    ) -> ZeroCrossing:
        """Return the first instant up to ``horizon`` at which a row turns negative.

        ``max_windows``: maximum number of windows of a segment, some hours of computation.

        Parameters
        ----------
        X : (N,) array or DoubleDouble      state at the start
        scale : (N,) array                  largest |X| of the run so far, the scale of rounding
        rows : (k, N) array or DoubleDouble rows c; c·X is zero or positive right after the start
        order : (k,) array                  order of the zero of c·X at the start, which is factored out of the first window
        horizon : float                     length of time in s
        entries : SparseRows, optional          those of the rows, if known

        """
        δ, lines = self.window, DoubleDouble.of(rows)
        if self.stiff is not None:
            return self.stiff.first_crossing(DoubleDouble.of(X), scale, lines, order, horizon, max_windows)
        window = Window(self.factors, δ, self.step)
        state = np.array(DoubleDouble.of(X).parts, order="C")
        largest = np.array(scale, dtype=np.float64)
        total = math.floor(min(horizon / δ, 1e300)) + 1
        done = 0
        count = max(FIRST_WINDOWS, SPLIT_COST * len(scale))
        zeros = np.asarray(order, dtype=np.int64)
        entries = entries or sparse(lines)
        while done < total:
            count = min(count, total - done)
            j, row, s, s_lo = scan(window, state, entries, NO_HULLS, zeros, BERNSTEIN, count, largest)
            if j >= 0:
                t = DoubleDouble(np.array(add(s * δ, s_lo * δ, (done + j) * δ, 0.0)))  # δ is a power of two
                return ZeroCrossing(row if t.hi <= horizon else -1, t, largest, DoubleDouble(state))
            done = done + count
            count = WINDOWS_PER_CALL
            zeros = np.zeros_like(zeros)
            if total - done > max_windows:
                raise endless(horizon, total - done)
        return ZeroCrossing(-1, DoubleDouble.of(horizon), largest, DoubleDouble(state))


def in_blocks(flow: Flow, *, many_windows: int = 2_048) -> StiffFlow | None:
    """Return a flow in the blocks of its rates, if it has ``many_windows`` and the fastest rates decay; None if not."""
    if flow.duration < many_windows * flow.window:
        return None
    try:
        rates = split_rates(flow.generator)
    except np.linalg.LinAlgError:
        return None
    if rates is None:
        return None
    each = [Flow(rates.B[here, here], flow.duration) for here in rates.blocks]
    windows = np.array([block.window for block in each])
    fastest = Window(flow.factors, min(flow.window, float(windows.min())), NO_STEP)
    found = StiffFlow.of(rates, fastest, windows, lambda B, y, t: Flow(B, flow.duration).at(y, t).T)
    return found if len(found.levels) > 1 else None
