"""The dense output of a solver: the first event within a step, found on it, and the motion at any time.

The dense output is a polynomial. It is sampled at Chebyshev points and written in Bernstein's basis, whose coefficients
bound it; the root is then found on the dense output itself.
"""

from __future__ import annotations

import math
import warnings
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from itertools import groupby
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array, Indices
from lcpimpact.errors import Status
from lcpimpact.hybrid.event_loop import AnySystem, Ending, EventLoop, follow, read_segments
from lcpimpact.hybrid.flow import Flow
from lcpimpact.hybrid.forced_modes import ZERO_FOR_EVER, ForcedSegment, ForcedSystem
from lcpimpact.numerics.double_double import DoubleDouble
from lcpimpact.numerics.polynomials import ROOT_RTOL, ROOT_STEPS, basis, fall_before, first_fall, without_zeros
from lcpimpact.numerics.rounding import EPS, TINY
from lcpimpact.record import Event, Record, Stats

DENSE_DEGREE, SINGLE_STEP_DEGREE = 12, 7
"""Degree of the polynomial through the samples of a step: SciPy's dense outputs have degree 12 at most, those of its
single-step methods 7. The lowest sufficient degree is the least sensitive to rounding."""

MAX_ORDER = 7
"""Number of orders, from 0 on, of an initial zero of a row that are told apart; higher orders count as the last of these."""


class WatchedSegment(Protocol):
    """A segment from t0 on whose event functions, ``rows`` of what is ``watched``, begin with zeros of an ``order``."""

    @property
    def t0(self) -> float:
        """The initial instant in s."""

    @property
    def rows(self) -> Array:
        """The event functions (k, m)."""

    @property
    def order(self) -> Indices:
        """Order of the initial zero of each (k,)."""

    def watched(self, τ: Array, X: Array) -> Array:
        """Return the terms (nt, m) of which the rows make sums."""

    def value(self, row: Array, τ: float, dense: Callable[[float | Array], Array]) -> float:
        """Return the value of a row at t0 + τ on the dense output."""


class ChebyshevSamples(NamedTuple):
    """The samples of a polynomial on [0, 1], and the matrices that yield its Bernstein coefficients.

    Attributes
    ----------
    points : (p + 1,) array             Chebyshev points
    fit : (p + 1, p + 1) array          matrix from values there to Bernstein coefficients of degree p
    divided : list of arrays            factors by which the coefficients of sᵐ p(s), without the first m, become those of p
    noise : float                       rounding of the coefficients, relative to the terms of a sample
    """

    points: Array
    fit: Array
    divided: list[Array]
    noise: float


@cache
def samples_of(p: int) -> ChebyshevSamples:
    """Return the samples for the degree p."""
    s = 0.5 - 0.5 * np.cos(np.pi * np.arange(p + 1) / p)
    fit = np.asarray(np.linalg.inv(basis(p, s)), dtype=np.float64)
    divided = [without_zeros(p, m)[m:] for m in range(min(p, MAX_ORDER))]
    return ChebyshevSamples(s, fit, divided, 8.0 * EPS * float(np.abs(fit).sum(axis=1).max()))


def first_root(
    segment: WatchedSegment,
    samples: ChebyshevSamples,
    scale: Array,
    start: float,
    end: float,
    dense: Callable[[float | Array], Array],
    atol: Callable[[], Array],
) -> tuple[float, int] | None:
    """Return the first instant in a step at which a watched row falls below zero, and which row.

    ``atol`` returns the absolute tolerance of each state, which only rows that are zero for ever ask for.
    """
    if not len(segment.rows):
        return None
    width = end - start
    τ = start + width * samples.points
    terms = segment.watched(τ, dense(τ).T)
    b = samples.fit @ (terms @ segment.rows.T)
    size = _size(segment, scale, terms)
    found: list[tuple[float, int]] = []
    for k, row in enumerate(segment.rows):
        # A zero of order m at the start of the segment is a factor sᵐ, and what the row has there is rounding.
        m = min(max(int(segment.order[k]), 0), len(samples.divided) - 1) if start == 0.0 else 0
        zero = float(b[0, k]) if m else 0.0
        coefficients = (b[m:, k] - zero) * samples.divided[m]
        floor = float(samples.noise * size[k] * samples.divided[m][0])
        if segment.order[k] == ZERO_FOR_EVER:
            tolerance = atol()
            floor += float(np.abs(row[: len(tolerance)]) @ tolerance)
        if coefficients.min() >= -floor:
            continue
        s = first_fall(np.array([coefficients, np.zeros_like(coefficients)]), -floor)
        if math.isnan(s):
            continue
        if segment.order[k] == ZERO_FOR_EVER:
            # It falls below zero from zero itself: what counts is where it is below it by more than the tolerance.
            found.append((start + s * width, k))
            continue
        s, slope = fall_before(coefficients, s)
        root = Root(segment, row, dense, EPS * float(size[k]), samples.noise * float(size[k]) + 2.0 * abs(zero))
        found.append((root.near(start + s * width, s**m * slope / width, start, None if m else end), k))
    return min(found) if found else None


def root_at_end(
    segment: WatchedSegment,
    samples: ChebyshevSamples,
    scale: Array,
    start: float,
    end: float,
    dense: Callable[[float | Array], Array],
    within: float,
    *,
    look_back: float = 0.1,
) -> tuple[float, int] | None:
    """Return when a row falls below zero at the end of a step, or less than ``within`` s after it, and which row.

    ``look_back``: fraction of the last step over which a row must decrease.
    """
    if not len(segment.rows):
        return None
    τ = np.array([end - look_back * (end - start), end])
    terms = segment.watched(τ, dense(τ).T)
    before, last = terms @ segment.rows.T
    size = _size(segment, scale, terms)
    fall = np.where((before > samples.noise * size) & (segment.order != ZERO_FOR_EVER), before - last, 0.0)
    falling = np.flatnonzero((fall > 0.0) & (last * (τ[1] - τ[0]) <= fall * within))
    if not len(falling):
        return None
    k = int(falling[np.argmin(last[falling] / fall[falling])])
    ahead = float(last[k] / fall[k] * (τ[1] - τ[0]))
    if ahead <= 0.0:
        return end, k
    return Root(segment, segment.rows[k], dense).near(end + ahead, 0.0, end, end + within), k


def _size(segment: WatchedSegment, scale: Array, terms: Array) -> Array:
    """Return the sum of the absolute terms of the watched rows, for samples (nt, ...) of them."""
    size = np.abs(terms).max(axis=0)
    size[: len(scale)] = np.maximum(size[: len(scale)], scale)
    return np.asarray(np.abs(segment.rows) @ size)


@dataclass(frozen=True, eq=False)
class Root:
    """The fall of a row of a segment through zero, on the dense output itself.

    Values below ``rounding`` tell nothing; the polynomial through the samples, whose root is known, differs by ``blurred``.
    """

    segment: WatchedSegment
    row: Array
    dense: Callable[[float | Array], Array]
    rounding: float = 0.0
    blurred: float = 0.0

    def value(self, τ: float) -> float:
        """Return the value of the row at τ."""
        return self.segment.value(self.row, τ, self.dense)

    def near(
        self, τ: float, slope: float, start: float, end: float | None, *, interpolation_rtol: float = 1e-9
    ) -> float:
        """Return the root near τ, or τ where the values there are rounding.

        A negative ``slope`` of the row there is known, or it is 0. Without an ``end`` the row begins at zero, and only a
        root close to τ is another one.

        ``interpolation_rtol``: distance of the polynomial through the samples from the dense output.
        """
        # What the polynomial through the samples lacks of a smooth row is rounding, and Newton's method mends it.
        root = τ
        best = τ
        least = math.inf
        about = max(interpolation_rtol * (τ - start), self.blurred / max(-slope, TINY))
        for _ in range(ROOT_STEPS if slope < 0.0 else 0):
            u = self.value(root)
            if abs(u) <= -slope * ROOT_RTOL * root:
                return root
            if not abs(u) < 0.5 * least:
                break
            best = root
            least = abs(u)
            root = root - u / slope
            if not start < root < τ + about or root < τ - about:
                break
        if least <= self.rounding:
            return best
        width = 1e-15 * (τ - start)
        widest = 1e-4 * (τ - start) if end is None else end - start
        while 0.0 < width < widest:
            before = max(τ - width, start)
            after = τ + width if end is None else min(τ + width, end)
            if self.value(before) > 0.0 > self.value(after):
                from scipy.optimize import brentq  # here, as most runs do without it

                root = float(brentq(self.value, before, after, xtol=1e-300, rtol=ROOT_RTOL))
                # Where a load jumps, the event is the first instant after the jump.
                step = float(np.spacing(self.segment.t0 + root))
                while self.value(root) > 0.0 and root + step < after:
                    root, step = root + step, 2.0 * step
                return root
            width *= 8.0
        return τ


@dataclass(frozen=True, eq=False)
class AtRest:
    """The dense output of no time at all: X, whenever it is asked for."""

    X: Array

    def __call__(self, τ: ArrayLike) -> Array:
        """Return X at τ: (N,), or (N, nt)."""
        return np.multiply.outer(self.X, np.ones_like(τ, dtype=np.float64))


@dataclass(frozen=True, eq=False)
class InBurst:
    """The dense output of a segment that was followed in double-doubles: X without the ``added`` states of inputs."""

    flow: Flow
    state: DoubleDouble
    added: slice

    def __call__(self, τ: ArrayLike) -> Array:
        """Return X at τ: (N,), or (N, nt)."""
        τ = np.asarray(τ, dtype=np.float64)
        X = np.delete(self.flow.at(self.state, np.maximum(τ.ravel(), 0.0)), self.added, axis=1)
        return X[0] if τ.ndim == 0 else X.T


S = TypeVar("S")


@dataclass(frozen=True, eq=False)
class Piece(Generic[S]):
    """One step of the solver from ``start`` on, or what an event left of it up to ``end``: X at t0 + τ.

    ``row`` is the event function of the segment whose fall through zero ends it; -1 if none.
    """

    segment: S
    start: float
    end: float
    dense: Callable[[float | Array], Array]
    row: int = -1


class SolvedSegment(WatchedSegment, Protocol):
    """A segment that a solver follows, at most to its end."""

    @property
    def end(self) -> float:
        """The last instant in s."""


G = TypeVar("G", bound=SolvedSegment)


@dataclass(eq=False, kw_only=True)
class SolverLoop(EventLoop[AnySystem], Generic[AnySystem, G]):
    """A motion by the steps of a solver of SciPy, with its current segment, which starts from the state ``begun``."""

    events: list[Event]
    stats: Stats
    samples: ChebyshevSamples
    expected: Array
    """Scale of each state that the motion soon has, even where it starts from zero (N,)."""
    pieces: list[Piece[G]] = field(default_factory=list, init=False)
    last_segment: G | None = None
    begun: Array = field(init=False)
    solution: Any = field(init=False)
    """The motion at any time of its pieces."""
    steps: Any = None
    first_step: float | None = None

    @property
    def segment(self) -> G:
        """The current segment."""
        assert self.last_segment is not None
        return self.last_segment

    @abstractmethod
    def step(self) -> Ending | Status:
        """Take one step of the solver, up to the first event in it."""

    def advance(self, record: Record, first: int, last: int) -> tuple[Status, int]:
        """Step past t_last, and sample the block on the grid; return the status and the last instant that was reached."""
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            status = follow(self, float(record.t[last]))
        if status is not Status.SOLVED:
            reached = self.pieces[-1].end if self.pieces else 0.0
            last = max(first + int(np.searchsorted(record.t[first : last + 1], reached)) - 1, first)
        here = slice(first + 1, last + 1)
        record.q[here], record.v[here], record.reaction[here] = self.solution(record.t[here], "right")
        return status, last

    def integrate(self, until: float) -> Ending | Status:
        """Take steps of the solver past ``until``, or up to the first event or breakpoint."""
        found: Ending | Status = Status.SOLVED
        while found is Status.SOLVED and (not self.pieces or self.pieces[-1].end < until):
            found = self.step()
        return found

    def keep_step(self, scale: Array, atol: Callable[[], Array], within: float) -> Ending:
        """Keep the step that the solver has taken, up to the first event in it, and return its end, with row -1 for none.

        ``scale``, ``atol`` and ``within`` are those of `first_root` and `root_at_end`.
        """
        segment, steps = self.segment, self.steps
        dense = steps.dense_output()
        finished = steps.status == "finished"
        step = segment, self.samples, scale, steps.t_old, steps.t, dense
        found = first_root(*step, atol)
        if finished and not found:
            found = root_at_end(*step, within)
        τ, row = (found[0], self.row_at(*found, dense)) if found else (steps.t, -1)
        t = segment.end if finished and not found else min(segment.t0 + τ, segment.end)
        X = dense(τ) if found else steps.y
        self.scale = np.maximum(self.scale, np.abs(X))
        self.pieces.append(Piece(segment, segment.t0 + steps.t_old, t, dense, row))
        if finished or found:
            self.stats.evaluations += steps.nfev
            self.first_step = float(getattr(steps, "h_abs", 0.0)) or None
        return Ending(t, t - segment.t0, X, row)

    def row_at(self, τ: float, row: int, dense: Callable[[float | Array], Array]) -> int:
        """Return the event function that ends a segment where one has a root at t0 + τ."""
        return row


@dataclass(frozen=True, eq=False)
class EventDrivenSolution:
    """The pieces of a run: the motion at any time."""

    forced: ForcedSystem
    pieces: list[Piece[ForcedSegment]]

    @property
    def chain(self) -> list[list[Piece[ForcedSegment]]]:
        """The pieces of each segment, from event to event."""
        return [list(each) for _, each in groupby(self.pieces, lambda piece: id(piece.segment))]

    def __call__(self, t: Array, side: str) -> tuple[Array, Array, Array]:
        """Return q, v and r at the sorted times t (nt,); ``side`` tells which limit is meant at an event."""

        def read_piece(owner: Indices, mine: Indices | slice) -> tuple[Array, Array, Array]:
            """Return q, v and r at times in one piece."""
            piece = self.pieces[owner[0]]
            τ = t[mine] - piece.segment.t0
            return self.forced.coordinates(piece.segment, τ, piece.dense(τ).T)

        starts = np.array([piece.start for piece in self.pieces])
        return read_segments(self.forced.system.dynamics, starts, np.arange(len(starts)), t, side, read_piece)
