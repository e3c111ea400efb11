r"""Radau IIA on finite elements whose ends are the switches: the lengths of the elements are unknowns of the collocation.

Within a step the contact mode may change any number of times. The step is cut into elements of lengths h_1 + h_2 + ... = h,
the mode is constant on each (so r and u of an element are complementary across all its stages, and not only stage by
stage), and where a mode ends the row c that ends it vanishes:

.. math:: X_i = X + h_n \sum_j a_{ij} A_m X_j, \qquad c \cdot X_s = 0, \qquad A_m = A + B F .

With the length free these are as many equations as unknowns, and Newton's method solves them; the stages are eliminated,
which leaves φ(h_n) = c·R(h_n A_m) X = 0. So no order is lost: 2 s - 1 in smooth motion and across switches.

What may end a mode is watched on the whole element, not at its stages. With k derivatives at each end (A_m^j X is known)
a row is a polynomial of degree 2 k - 1, whose error is

.. math:: |g - g_{2k-1}| \le \max |g^{(2k)}| \frac{(τ (h_n - τ))^k}{(2k)!} ,

and which lies in the hull of its Bernstein coefficients. An element is accepted where they exceed that error; where one
turns negative at the end, Newton finds where; and where neither can be said, or the estimate of the error is above rtol,
it is halved. What is accepted has been checked again with the length that Newton gave.

Impacts of several bodies in quick succession are followed in double-doubles (see `lcpimpact.hybrid.burst`), and to
their limit where they accumulate. A row that falls to zero within 1e-12 of the run at its end makes a switch there. The
matrix of a step is one of floats, whose rounding is a small force on what is free to move: two bodies on a spring of
ω = 8/s are off by 2e-10 of their way after 1e4 s, and by 1e-8 after 1e5 s.

Nurkanović, Sperl, Albrecht and Diehl (2024) make one complementarity problem of a step, with its lengths and modes; here the
mode comes from the LCPs of `lcpimpact.hybrid.modes`, and restitution is Newton's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.double_double import DoubleDouble
from lcpimpact.errors import FailureError, InputError, Status, UnsupportedError
from lcpimpact.hybrid.burst import Meetings, follow_burst
from lcpimpact.hybrid.flow import balance
from lcpimpact.hybrid.modes import Mode, System, refuse_mixed_degrees, settled
from lcpimpact.hybrid.transition import coordinates, enter
from lcpimpact.integrators.base import Declared, Integrator, Limits
from lcpimpact.integrators.stepping.radau_iia import RadauIIA, radau_iia
from lcpimpact.lcp import SOLVERS
from lcpimpact.numbers import count, is_real
from lcpimpact.problems.base import Problem
from lcpimpact.record import ContinuousSolution, Event, Grid, Record
from lcpimpact.scheme.dynamics import Feature

K = 3
"""Number of derivatives, the value included, that interpolate a watched row at each end of an element."""

DEGREE = 2 * K - 1

EPS = float(np.finfo(float).eps)

ZERO_RTOL = 32.0 * EPS

DEFECT_RTOL = 1e-9
"""Largest defect of the equations of an accepted element, judged outside the solve, relative to their terms."""

SMALL_STATE = 1e-6
"""States below this, relative to the largest, are judged on the scale of the largest."""

END_RTOL, LOOK_BACK = 1e-12, 0.1
"""Distance of a switch from the end of the run, relative to the run, below which it is at the end, if its row falls over
the part LOOK_BACK of the last element."""

MAX_SWITCHES_AT_ONCE = 100
"""Maximum number of switches at one instant."""

MAX_STRIDE = 256
"""Maximum number of whole steps taken at once."""

MAX_ENTRIES = 2_000_000
"""Maximum number of entries in a batch of matrices."""


def _end_coefficients() -> Array:
    """Return the matrix from (h^j g^(j)(0)), j < K, to the first K Bernstein coefficients of degree 2 K - 1."""
    n = DEGREE
    return np.array([[math.comb(i, j) * math.factorial(n - j) / math.factorial(n) for j in range(K)] for i in range(K)])


AT_END = _end_coefficients()
SIGNS = (-1.0) ** np.arange(K)


def _weights(m: int, p: int) -> Array:
    """Return what makes of Bernstein coefficients of g those of g / (s^m (1 - s)^p), 0 for those that drop out."""
    n = DEGREE
    kept = range(m, n + 1 - p)
    return np.array([math.comb(n, i) / math.comb(n - m - p, i - m) if i in kept else 0.0 for i in range(n + 1)])


def _error_factor(m: int, p: int) -> float:
    """Return max s^(K - m) (1 - s)^(K - p) / (2 K)!."""
    a, b = K - m, K - p
    return float(a**a * b**b / (a + b) ** (a + b) / math.factorial(2 * K))


def _bernstein(n: int) -> Array:
    """Return Bernstein's polynomials of degree n at equal distances on [0, 1]: (33, n + 1)."""
    s = np.linspace(0.0, 1.0, 33)[:, None]
    i = np.arange(n + 1)
    return np.asarray([math.comb(n, j) for j in i] * s**i * (1.0 - s) ** (n - i))


WEIGHTS = np.array([[_weights(m, p) for p in (0, 1)] for m in range(K + 1)])
ERROR = np.array([[_error_factor(m, p) for p in (0, 1)] for m in range(K + 1)])
SAMPLES = [_bernstein(DEGREE - m) for m in range(K + 1)]


@dataclass(frozen=True, eq=False)
class Table:
    """What an element of one length in one mode makes of the state at its start.

    Attributes
    ----------
    stages : (s, N, N) array            X_i
    hull : (nw, 2 K, N) array           Bernstein coefficients of the watched rows
    size : (nw, 2 K, N) array           the sum of the absolute terms that these are made of
    highest : (nw, s + 1, N) array      h^2K g^(2K) at the start and the stages
    estimate : (N, N) array or None     R(h) - R(h/2)², what two elements would do otherwise
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
    rows : (nw, N) array        what ends the mode where it turns negative
    contacts : (nu, N) array    the gaps of the closed rows, which stay zero
    terms : (nu, N) array       the sum of the absolute terms that these are made of
    h : float                   the step: tables of h, h/2, h/4, ... are kept
    estimated : bool            whether the tables hold the estimate of the error
    """

    mode: Mode
    radau: RadauIIA
    A: Array
    rows: Array
    contacts: Array
    terms: Array
    h: float
    estimated: bool
    kept: dict[float, Table] = field(default_factory=dict)

    @cached_property
    def units(self) -> Array:
        """The sizes of the states against one another for which A is balanced (N,)."""
        return balance(self.A)[1]

    @cached_property
    def derivatives(self) -> Array:
        """The rows of g, g', ..., g^(2K): (2 K + 1, nw, N)."""
        found = [self.rows]
        for _ in range(2 * K):
            found.append(found[-1] @ self.A)
        return np.array(found)

    def table(self, length: float) -> Table:
        """Return the table of one length."""
        if length in self.kept:
            return self.kept[length]
        made = self._make(length)
        if math.frexp(length)[0] == math.frexp(self.h)[0]:
            self.kept[length] = made
        return made

    def _make(self, length: float) -> Table:
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
        return Table(stages, hull, size, highest, estimate)

    def _propagators(self, lengths: Array) -> Array:
        """Return the matrices of the stages (nt, s, N, N)."""
        return self.radau.stages(self.A, lengths, np.broadcast_to(np.eye(len(self.A)), (len(lengths), *self.A.shape)))

    def at(self, X: Array, times: Array, quantum: float) -> Array:
        """Return the ends of elements of the lengths ``times`` (nt,) from X (nt, N); those within ``quantum`` are one."""
        _, first, which = np.unique(np.round(times / quantum), return_index=True, return_inverse=True)
        found = np.empty_like(X)
        chunk = max(1, MAX_ENTRIES // (len(self.radau.c) * self.A.size))
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

    def safe(self, table: Table, X: Array, scale: Array, zeros: Indices, ends: Indices) -> tuple[Flags, Array, Array]:
        """Return whether each watched row stays positive on elements from the states X (nt, N): (nt, nw).

        ``zeros`` (nw,) is the order of the zero at the start, at most K, and ``ends`` (nw,) is 1 for a row with a zero at
        the end. Returned too are the Bernstein coefficients without these zeros, and those with them.
        """
        b = np.einsum("win,tn->twi", table.hull, X)
        b -= np.where(zeros > 0, b[:, :, 0], 0.0)[:, :, None]
        noise = ZERO_RTOL * (table.size @ np.maximum(scale, np.abs(X).max(axis=0)))
        # The highest derivative is known at the start and the stages; twice the largest stands for what is between.
        D = 2.0 * np.abs(np.einsum("win,tn->twi", table.highest, X)).max(axis=2)
        weights = WEIGHTS[zeros, ends]
        error = D * ERROR[zeros, ends]
        reduced, kept = b * weights, weights > 0.0
        clear = (reduced - error[:, :, None] - noise * weights > 0.0) | ~kept
        within = ((b >= -noise) | ~kept) & (error <= noise[:, 0])[:, :, None]
        return clear.all(axis=2) | within.all(axis=2), reduced, b

    def noise(self, scale: Array) -> Array:
        """Return what is rounding in the watched rows (nw,)."""
        return np.asarray(ZERO_RTOL * (np.abs(self.rows) @ scale))

    def judge(self, stages: Array, X: Array, length: float, scale: Array) -> float:
        """Return the largest error of the equations of elements: of their stages (nt, s, N), and of complementarity.

        Across the stages r of open rows is zero by F; so what remains are the gaps of closed rows, and the forces and gaps
        that end below zero; each relative to its terms.
        """
        rates = stages @ self.A.T
        error = np.abs(stages - X[:, None] - length * (self.radau.a @ rates)).max(axis=(0, 1))
        size = np.maximum(np.abs(X).max(axis=0), np.abs(stages).max(axis=(0, 1)))
        terms = size + length * (np.abs(self.A) @ size)
        # What has hardly begun to move is made of rounding of what moves, in the units in which A is balanced.
        terms, scale = (
            np.maximum(each, SMALL_STATE * self.units * (each / self.units).max())
            for each in (terms, np.maximum(scale, size))
        )
        below = np.maximum(-stages[:, -1] @ self.rows.T, 0.0).max(axis=0, initial=0.0)
        closed = np.abs(stages @ self.contacts.T).max(axis=(0, 1), initial=0.0)
        errors = np.concatenate([error, below, closed])
        terms = np.concatenate([terms, np.abs(self.rows) @ scale, self.terms @ scale])
        return float((errors / np.maximum(terms, np.finfo(float).tiny)).max())

    def root(
        self, X: Array, row: int, zero: float, guess: float, length: float, scale: Array, most: int
    ) -> tuple[float | None, int]:
        """Solve for the stages and the length of the element that ends where a row vanishes; return it, and the iterations.

        Newton's method from ``guess``, kept in the bracket [0, length]; None where it does not converge. ``zero`` is what
        the row has where it vanishes: the rounding that it began with, if it began at zero.
        """
        c, low, high, h = self.rows[row], 0.0, length, guess
        enough = 4.0 * EPS * float(np.abs(c) @ np.maximum(scale, np.abs(X)))
        for steps in range(1, most + 1):
            end, rate = self.radau.end_and_rate(self.A, h, X)
            value, slope = float(c @ end) - zero, float(c @ rate)
            low, high = (h, high) if value > 0.0 else (low, h)
            if abs(value) <= enough or high - low <= 2.0 * EPS * length:
                return float(h), steps
            step = h - value / slope if slope < 0.0 else -1.0
            h = step if low < step < high else 0.5 * (low + high)
        return None, most


@dataclass
class Run:
    """What travels from block to block: where the motion is, the mode in which it goes on, and the elements so far.

    ``zeros`` are the orders of the zeros with which the watched rows begin, where a mode has just begun; of the
    ``breakpoints`` of the signals so many are ``passed``.
    """

    system: System
    radau: RadauIIA
    grid: Grid
    solver: str
    estimated: bool
    scale: Array
    breakpoints: Array
    meetings: Meetings
    max_events: int
    passed: int = 0
    switches: int = 0
    t: float = 0.0
    stride: int = 1
    X: Array = field(init=False)
    elements: Elements = field(init=False)
    zeros: Indices = field(init=False)
    modes: dict[object, Elements] = field(default_factory=dict)
    starts: list[Array] = field(default_factory=list)
    states: list[Array] = field(default_factory=list)
    owners: list[Elements] = field(default_factory=list)

    def enter(self, t: float, X: Array, record: Record, breakpoint: bool = False, v: Array | None = None) -> Status:
        """Pass into the next mode at t, with the impacts before it, and those that come in quick succession after it.

        v (n,) are the velocities before the start of the run.
        """
        system = self.system
        before, left = self.elements.mode if self.modes else None, None
        if breakpoint:
            self.passed += 1
            left = settled(system, before, DoubleDouble.of(X), self.scale)
            X = system.form.right_of(t, left, self.scale).hi
        mode, after, events = enter(system, t, before, X, self.scale, self.solver, left=left, v=v)
        assert record.events is not None
        record.events += events
        status, short = Status.SOLVED, self._land(t, events)
        if short and t < self.grid.t_end:
            left_over = max(self.max_events - self.switches, 1)
            burst = follow_burst(
                system, t, after, mode, self.scale, self.solver, self.grid.t_end, short, left_over
            )  # fmt: skip
            for segment, _ in burst.passed:
                self.starts.append(np.array([segment.t0]))
                self.states.append(segment.X[None, :])
                self.owners.append(self._elements(segment.mode))
            record.events += burst.events
            self.switches += len(burst.motion.segments) - 1
            self.meetings.take(burst)
            self.scale = np.maximum(self.scale, burst.motion.scale)
            self.t, mode, after, status = burst.last.t0, burst.last.mode, burst.last.state, burst.status
        self.X, self.elements = after.hi, self._elements(mode)
        self.zeros = np.minimum(system.watched(mode)[2], K)
        self.scale, self.stride = np.maximum(self.scale, np.abs(self.X)), 1
        return status

    def _land(self, t: float, events: list[Event]) -> float:
        """Note the impacts at t, and return what a short flight is where they follow others, else 0."""
        hits = [event for event in events if event.impulse > 0.0]
        if not hits:
            return 0.0
        rates = self.system.dynamics.gap_rate(hits[0].left.v)
        rows = np.array([self.system.names[event.contact] for event in hits], dtype=np.int64)
        rows = rows[rates[rows] < 0.0]
        short = self.meetings.quick(self.system, t, rows, rates, self.scale)
        self.meetings.note(t, rows)
        return short

    def _elements(self, mode: Mode) -> Elements:
        """Return the elements of a mode."""
        system = self.system
        _, ends, _ = system.watched(mode)
        key = (mode.key, tuple(order < 0 for order in mode.order))
        if key not in self.modes:
            flow, F = system.mode(mode)
            contacts = [i for i in mode.closed if not system.dynamics.slides[i]]
            C, D = system.derivatives[0], system.form.D
            u, terms = (C + D @ F)[contacts], (np.abs(C) + np.abs(D) @ np.abs(F))[contacts]
            self.modes[key] = Elements(mode, self.radau, flow.A, ends.hi, u, terms, self.grid.h, self.estimated)
        return self.modes[key]

    def at(self, t: float) -> tuple[Elements, Array]:
        """Return the state at one instant, at most that which has been reached, and the elements that it belongs to."""
        if t >= self.t:
            return self.elements, self.X
        for starts, states, elements in zip(
            reversed(self.starts), reversed(self.states), reversed(self.owners), strict=True
        ):
            if starts[0] <= t:
                j = int(np.searchsorted(starts, t, side="right")) - 1
                return elements, elements.at(states[j : j + 1], np.array([t - starts[j]]), EPS * self.grid.t_end)[0]
        raise ValueError(f"t = {t} lies before the run")

    def pieces(self, t: float, begin: float, h: float) -> list[tuple[float, float, bool]]:
        """Return what is left of a step from t on: begin, end, and whether that is a breakpoint; the first piece last."""
        later = self.breakpoints[self.passed :]
        offsets = later[later <= t + h * (1.0 + 4.0 * EPS) + 4.0 * EPS * t] - t
        # A breakpoint on the grid is no piece of its own.
        offsets = np.where(h - offsets <= 4.0 * EPS * (t + h), h, np.maximum(offsets, begin))
        edges = [begin, *offsets.tolist(), h]
        breaks = [True] * len(offsets) + [False]
        return list(zip(edges[:-1], edges[1:], breaks, strict=True))[::-1]

    def take(self, starts: Array, states: Array, end: float, residual: float, record: Record) -> None:
        """Make elements that start at ``starts`` from all but the last of the ``states`` part of the run."""
        self.starts.append(starts)
        self.states.append(states[:-1])
        self.owners.append(self.elements)
        self.t, self.X, self.zeros = end, states[-1], np.zeros_like(self.zeros)
        self.scale = np.maximum(self.scale, np.abs(states).max(axis=0))
        record.stats.steps += len(starts)
        record.stats.evaluations += len(starts)
        record.stats.residual = max(record.stats.residual, residual)

    def write(self, record: Record, first: int, states: Array, elements: Elements | None = None) -> None:
        """Write states of this mode, or of that of other elements, to the grid from ``first`` on."""
        here, mode = slice(first, first + len(states)), (elements or self.elements).mode
        record.q[here], record.v[here], record.reaction[here] = coordinates(self.system, mode, states)


@dataclass(frozen=True, eq=False)
class Solution:
    """What elements give at any time: each begins at a state (N,), is of a kind (a mode), and ends wherever it is read."""

    system: System
    kinds: tuple[Elements, ...]
    starts: Array
    states: Array
    kind: Indices
    rounding: float

    def __call__(self, t: Array, side: str) -> tuple[Array, Array, Array]:
        """Return q, v and r at the sorted times t (nt,), on one side of the events."""
        mine = np.maximum(np.searchsorted(self.starts, t, side="right" if side == "right" else "left") - 1, 0)
        n, nc = len(self.system.dynamics.nodes), len(self.system.degree)
        q, v, r = np.empty((len(t), n)), np.empty((len(t), n)), np.empty((len(t), nc))
        for j, elements in enumerate(self.kinds):
            here = np.flatnonzero(self.kind[mine] == j)
            if len(here):
                lengths = np.maximum(t[here] - self.starts[mine[here]], 0.0)
                X = elements.at(self.states[mine[here]], lengths, self.rounding)
                q[here], v[here], r[here] = coordinates(self.system, elements.mode, X)
        return q, v, r


@dataclass(frozen=True)
class RadauFESD(Integrator):
    """Radau IIA on finite elements with switch detection.

    Parameters
    ----------
    stages : int
        s, from 1 to 5; the order is 2 s - 1, in smooth motion and across switches.
    rtol : float, optional
        Halve elements until the error estimate of each state is below rtol times its largest value so far; None for
        elements as long as the step and the switches allow.
    max_newton : int
        Limit of Newton's iterations for one switch.
    max_events : int
        Limit of switches, for runs in which impacts go on without end.

    Raises
    ------
    InputError
        If stages is not 1 to 5, rtol lies outside [1e-14, 1), or a limit is not a whole number above zero.

    Notes
    -----
    Handles constant loads and signals, whose breakpoints end an element. The declared orders are those of three stages. The
    reaction is the force at each instant of the grid (its right limit at a switch); impulses stand in the events.
    """

    stages: int = 3
    rtol: float | None = None
    max_newton: int = 20
    max_events: int = 100_000

    name: ClassVar[str] = "radau-fesd"
    family: ClassVar[str] = "Radau IIA"
    mode_choice: ClassVar[str] = "modes.py"
    declared: ClassVar[Declared] = Declared(
        summary="Radau IIA on finite elements that end where the contact mode does",
        order_smooth=5,
        order_force_jump=5,
        order_force_kink=5,
        order_impact=5,
        order_friction=5,
        order_penetration=float("inf"),
        level="position and velocity",
        relative_degrees=(0, 1, 2),
        handles=tuple(each for each in Feature if each is not Feature.POWER_LAWS),
        reaction_lives="at t, right limit",
        energy="never gains in smooth motion and impacts; loses at order 2 s - 1",
        balances_energy=True,
        precision=1e-7,
        slack=24.0,
        dissipates=True,
        accuracy=1e-9,
        source="Nurkanović, Sperl, Albrecht and Diehl (2024); Hairer and Wanner (1996), section IV.5",
        adaptive="with rtol, halves the elements of a step by their error estimate",
    )

    def __post_init__(self) -> None:
        radau_iia(self.stages)
        if self.rtol is not None and not (is_real(self.rtol) and 1e-14 <= self.rtol < 1.0):
            raise InputError(
                f"rtol = {self.rtol!r} must lie in [1e-14, 1), or be None for elements of the step's length"
            )
        for option in ("max_newton", "max_events"):
            count(option, getattr(self, option))

    def limits(self) -> Limits:
        """Return those of its stages."""
        return replace(super().limits(), order=2.0 * self.stages - 1.0)

    def reaction_times(self, grid: Grid) -> Array:
        """Return the grid."""
        return grid.times(0, grid.steps)

    def start(self, problem: Problem, grid: Grid, lcp_solver: str, record: Record) -> Run:
        """Choose the first mode and write the initial values; impacts at t = 0 come before them."""
        SOLVERS[lcp_solver]
        system = System(problem.dynamics)
        refuse_mixed_degrees(system, self.name, except_schemes=True)
        X = system.state(problem.initial_coordinates, problem.initial_velocities)
        breakpoints = system.form.breakpoints(0.0, grid.t_end)
        run = Run(
            system, radau_iia(self.stages), grid, lcp_solver, self.rtol is not None, np.abs(X), breakpoints,
            Meetings.none(len(system.degree)), self.max_events,
        )  # fmt: skip
        record.events = []
        try:
            run.enter(0.0, X, record, v=problem.initial_velocities)
        except np.linalg.LinAlgError:
            raise UnsupportedError(
                f"some contacts or sliders of {problem.name!r} hold together at the start in a way that leaves their shares "
                "undetermined, which 'radau-fesd' does not handle: take method='moreau-jean'"
            ) from None
        run.write(record, 0, run.X[None, :])
        return run

    def advance(self, carry: Run, record: Record, first: int, last: int) -> tuple[Status, int]:
        """Take whole steps together where nothing is in doubt, and the others element by element."""
        assert record.events is not None
        k = first
        while k < last:
            ahead = carry.breakpoints[carry.passed : carry.passed + 1]
            # The last step is taken by itself, for what may happen at its end.
            clear = min([last - k, carry.grid.steps - 1 - k, *(np.searchsorted(record.t[k : last + 1], ahead) - 1)])
            clear = clear if carry.t <= record.t[k] else 0
            taken = self._whole_steps(carry, record, k, min(carry.stride, clear)) if clear else 0
            k += taken
            if taken == carry.stride:
                carry.stride = min(2 * carry.stride, MAX_STRIDE)
            elif k < last:
                carry.stride, before = 1, len(record.events)
                status = self._step(carry, record, k)
                if status is not Status.SOLVED:
                    del record.events[before:]
                    return status, k
                k += 1
        return Status.SOLVED, last

    def _whole_steps(self, run: Run, record: Record, k: int, count: int) -> int:
        """Take up to ``count`` steps of one element each, as many as are beyond doubt, and return how many."""
        elements, h = run.elements, run.grid.h
        table = elements.table(h)
        states = table.states(run.X, count)
        if not np.isfinite(states).all():
            return 0
        none = np.zeros_like(run.zeros)
        good = np.array(elements.safe(table, states[:-1], run.scale, none, none)[0].all(axis=1))
        if run.zeros.any():
            good[0] = elements.safe(table, states[:1], run.scale, run.zeros, none)[0].all()
        good &= self._accurate(table, states[:-1], run.scale)
        taken = count if good.all() else int(np.argmin(good))
        if taken == 0:
            return 0
        states = states[: taken + 1]
        stages = np.einsum("inm,tm->tin", table.stages, states[:-1])
        residual = elements.judge(stages, states[:-1], h, np.maximum(run.scale, np.abs(states).max(axis=0)))
        if not residual <= DEFECT_RTOL:
            return 0
        run.write(record, k + 1, states[1:])
        run.take(record.t[k : k + taken], states, float(record.t[k + taken]), residual, record)
        return taken

    def _accurate(self, table: Table, X: Array, scale: Array) -> Flags:
        """Return whether the error estimate of elements from X (nt, N) is below rtol (nt,)."""
        if table.estimate is None or self.rtol is None:
            return np.ones(len(X), dtype=np.bool_)
        largest = np.maximum(np.maximum(scale, np.abs(X)), np.abs(X @ table.end.T))
        return np.asarray((np.abs(X @ table.estimate.T) <= self.rtol * largest).all(axis=1))

    def _step(self, run: Run, record: Record, k: int) -> Status:
        """Take one step by as many elements as it needs."""
        h, t, stalled = run.grid.h, float(record.t[k]), 0
        waiting = run.pieces(t, max(run.t - t, 0.0), h)
        while waiting and run.t < t + h:
            begin, end, breaks = waiting.pop()
            status, length, switches = Status.SOLVED, 0.0, False
            if end > begin:
                # What begins at a breakpoint begins at its very instant, as its events do.
                last = run.breakpoints[run.passed - 1] if run.passed else -np.inf
                start = last if abs(t + begin - last) <= 4.0 * EPS * (t + h) else run.t
                status, length, switches = self._element(run, record, start, end - begin)
            if switches and status is Status.SOLVED:
                stalled = stalled + 1 if length <= 2.0 * EPS * t else 0
                status = Status.SWITCH if stalled > MAX_SWITCHES_AT_ONCE else self._switch(run, record, run.t)
                waiting = run.pieces(t, max(begin + length, run.t - t), h)
            elif length == end - begin:
                status = self._breakpoint(run, record) if breaks else status
            elif status is Status.SOLVED:
                if end - begin <= 4.0 * EPS * (t + h):
                    return Status.SWITCH
                middle = begin + 0.5 * (end - begin)
                waiting += [(middle, end, breaks), (begin, middle, False)]
                record.stats.rejected += 1
            if status is not Status.SOLVED:
                return status
        end = float(record.t[k + 1])
        if run.t - end <= 4.0 * EPS * end:
            run.t = end
            status = self._switch(run, record, end) if k + 1 == run.grid.steps and _ends(run) else Status.SOLVED
            run.write(record, k + 1, run.X[None, :])
            return status
        elements, X = run.at(end)
        run.write(record, k + 1, X[None, :], elements)
        return Status.SOLVED

    def _element(self, run: Run, record: Record, t: float, length: float) -> tuple[Status, float, bool]:
        """Take one element: the status, its length, and whether a switch ends it.

        The length is zero without a switch where something is in doubt, and with one where the mode has ended already.
        """
        elements, none = run.elements, np.zeros_like(run.zeros)
        table = elements.table(length)
        X = run.X[None, :]
        if not np.isfinite(table.end @ run.X).all():
            return Status.NON_FINITE, 0.0, False
        if not self._accurate(table, X, run.scale)[0]:
            return Status.SOLVED, 0.0, False
        safe, reduced, b = elements.safe(table, X, run.scale, run.zeros, none)
        if safe.all():
            return self._take(run, record, t, length, table), length, False
        crossing = first_crossing(b[0], reduced[0], safe[0], run.zeros, elements.noise(run.scale))
        if crossing is None:
            return Status.SOLVED, 0.0, False
        row, guess = crossing
        if guess == 0.0:
            return Status.SOLVED, 0.0, True
        starts_at = float(elements.rows[row] @ run.X) if run.zeros[row] > 0 else 0.0
        root, count = elements.root(run.X, row, starts_at, guess * length, length, run.scale, self.max_newton)
        record.stats.newton_iterations += count
        record.stats.evaluations += count
        if root is None:
            return Status.SWITCH, 0.0, False
        table, ends = elements.table(root), none.copy()
        ends[row] = 1
        if not elements.safe(table, X, run.scale, run.zeros, ends)[0].all():
            return Status.SOLVED, 0.0, False
        return self._take(run, record, t, root, table), root, True

    def _take(self, run: Run, record: Record, t: float, length: float, table: Table) -> Status:
        """Make an element part of the run, if its equations hold."""
        stages = table.stages @ run.X
        scale = np.maximum(run.scale, np.abs(stages[-1]))
        residual = run.elements.judge(stages[None], run.X[None, :], length, scale)
        if not residual <= DEFECT_RTOL:
            return Status.SWITCH
        run.take(np.array([t]), np.array([run.X, stages[-1]]), t + length, residual, record)
        return Status.SOLVED

    def _switch(self, run: Run, record: Record, t: float) -> Status:
        """Pass into the next mode at t."""
        if run.switches >= self.max_events:
            return Status.MAX_EVENTS
        status = self._enter(run, record, t, False)
        run.switches += status is Status.SOLVED
        return status

    def _breakpoint(self, run: Run, record: Record) -> Status:
        """Pass the next breakpoint of the signals."""
        return self._enter(run, record, float(run.breakpoints[run.passed]), True)

    def _enter(self, run: Run, record: Record, t: float, breakpoint: bool) -> Status:
        """Pass into the next mode at t, and say what fails."""
        try:
            return run.enter(t, run.X, record, breakpoint)
        except FailureError as failure:
            status: Status = failure.result.status
            return status
        except np.linalg.LinAlgError:
            return Status.SINGULAR

    def dense(self, carry: Run) -> ContinuousSolution:
        """Return the solution at any times of the run, by elements that end there instead."""
        run, kinds = carry, list(carry.modes.values())
        starts = np.concatenate([*run.starts, [run.t]])
        states = np.concatenate([*run.states, run.X[None, :]])
        kind = np.repeat([kinds.index(each) for each in run.owners], [len(each) for each in run.starts])
        kind = np.append(kind, kinds.index(run.elements)).astype(np.int64)

        return ContinuousSolution(
            Solution(run.system, tuple(kinds), starts, states, kind, 8.0 * EPS * run.grid.t_end), starts
        )


def first_crossing(b: Array, reduced: Array, safe: Flags, zeros: Indices, noise: Array) -> tuple[int, float] | None:
    """Return the row that seems to end a mode first on an element, and where on [0, 1], from its Bernstein coefficients."""
    found: list[tuple[float, int]] = []
    for row in map(int, np.flatnonzero(~safe)):
        m = int(zeros[row])
        if m == 0 and (b[row, 0] < -noise[row] or b[row, 1] < b[row, 0] <= 0.0):
            found.append((0.0, row))
        elif b[row, -1] < -noise[row] and reduced[row, m] > 0.0:
            values = SAMPLES[m] @ reduced[row, m:]
            j = int(np.argmax(values < 0.0))
            found.append(((j - values[j] / (values[j] - values[j - 1])) / (len(values) - 1), row))
    return min(found)[::-1] if found else None


def _ends(run: Run) -> bool:
    """Return whether a row falls to zero at the end of the last element, which is that of the run."""
    elements, length = run.elements, run.t - float(run.starts[-1][-1])
    if elements is not run.owners[-1] or not length > 0.0:
        return False
    part = LOOK_BACK * length
    before = elements.rows @ elements.at(run.states[-1][-1:], np.array([length - part]), EPS * run.grid.t_end)[0]
    last = elements.rows @ run.X
    falls = (before > elements.noise(run.scale)) & (last * part <= (before - last) * END_RTOL * run.grid.t_end)
    return bool(falls.any())
