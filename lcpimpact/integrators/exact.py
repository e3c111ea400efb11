r"""The exact solution of a linear scheme: a matrix exponential for each contact mode, joined at events found to rounding.

In first-order form (see `lcpimpact.scheme.lcs`) the scheme is X' = A X + B r, u = C X + D r, 0 <= u ⟂ r >= 0. A *mode* is
the set of closed rows, on which u ≡ 0. With ρ_i the relative degree of row i,

.. math:: u_i^{(ρ_i)} = O_i X + G_i r, \qquad O_i = C_i A^{ρ_i}, \qquad G_i = D_i,\; C_i B,\; C_i A B \quad (ρ_i = 0, 1, 2),

so the closed rows give r = F X, and the mode moves by X' = (A + B F) X. The mode is chosen, at the start and after every
event, by LCPs on the one-sided derivatives: first 0 <= r ⟂ O X + G r >= 0 on the rows that touch, then, for the rows
that it leaves undecided (both sides zero: grazing, and every switch that is not a jump), the same for the next derivatives
of r and u, until each is decided. Where plates that both have mass meet with U < 0, Newton's law of impact is an LCP of its
own: 0 <= P ⟂ U⁺ + e U⁻ >= 0 with U⁺ = U⁻ + C A B P.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np
from scipy.linalg import null_space

from lcpimpact.arrays import Array, Indices
from lcpimpact.errors import InputError, Status, UnsupportedError
from lcpimpact.integrators.base import Declared, Dense, Event, Grid, Integrator, Record, State
from lcpimpact.integrators.flow import Flow
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.solve import solve_lcp
from lcpimpact.problems.base import Problem
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.lcs import LinearComplementaritySystem, first_order_form

ZERO = 1e-12
"""What counts as zero, relative to the terms of the sum that gave it, each taken at its largest value so far: a root found
to rounding leaves about 1e-15 of them."""

ZENO = 1e-12
"""An approach this slow, relative to the fastest that the contact has met, ends an accumulation of impacts (e = 0)."""


STALL = 100
"""So many events at one instant are no motion: the run ends as if it had reached max_events."""


@dataclass(frozen=True, eq=False)
class Mode:
    """The closed rows, and how each row leaves zero: ``order[i]`` is the order of the zero, -1 if it is zero for ever."""

    closed: tuple[int, ...]
    order: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class System:
    """The first-order form with its Markov parameters, and the flow of each mode."""

    dynamics: Dynamics
    flows: dict[tuple[int, ...], tuple[Flow, Array]] = field(default_factory=dict)

    @cached_property
    def lcs(self) -> LinearComplementaritySystem:
        """The linear complementarity system."""
        return first_order_form(self.dynamics)

    @cached_property
    def degree(self) -> Indices:
        """ρ (nc,)."""
        return self.dynamics.relative_degree

    @cached_property
    def derivatives(self) -> Array:
        """C, C A, C A²: (3, nc, N)."""
        C, A = self.lcs.C, self.lcs.A
        return np.array([C, C @ A, C @ A @ A])

    @cached_property
    def O(self) -> Array:  # noqa: E743
        """The row C_i A^ρ_i of each contact (nc, N)."""
        return np.asarray(self.derivatives[self.degree, np.arange(len(self.degree))])

    @cached_property
    def G(self) -> Array:
        """The row D_i, C_i B or C_i A B of each contact (nc, nc)."""
        B = self.lcs.B
        markov = np.array([self.lcs.D, self.lcs.C @ B, self.lcs.C @ self.lcs.A @ B])
        return np.asarray(markov[self.degree, np.arange(len(self.degree))])

    def mode(self, closed: tuple[int, ...]) -> tuple[Flow, Array]:
        """Return the flow of a mode, and the F with r = F X."""
        if closed not in self.flows:
            F = np.zeros_like(self.O)
            rows = list(closed)
            G = self.G[np.ix_(rows, rows)]
            F[rows] = -np.linalg.solve(G, self.O[rows])
            self.flows[closed] = Flow(self.lcs.A + self.lcs.B @ F), F
        return self.flows[closed]


@dataclass(frozen=True, eq=False)
class Segment:
    """One mode from t0 on: X(t) = exp(A (t - t0)) X."""

    t0: float
    X: Array
    mode: Mode


@dataclass
class Run:
    """What travels from block to block: the segments found so far, and the next event (inf: none before the end)."""

    system: System
    grid: Grid
    solver: str
    max_events: int
    segments: list[Segment]
    next_event: tuple[float, int]
    fastest: Array
    scale: Array


def _zero(terms: Array, values: Array) -> Array:
    """Set values to zero that are rounding, compared with the sum of the absolute terms that they came from."""
    return np.where(np.abs(values) <= ZERO * terms, 0.0, values)


def gaps(system: System, X: Array, scale: Array) -> tuple[Array, Array]:
    """Return u and U of the rows (nc,), for r = 0, with rounding residues set to zero."""
    C, CA = system.derivatives[:2]
    return _zero(np.abs(C) @ scale, C @ X), _zero(np.abs(CA) @ scale, CA @ X)


def choose_mode(system: System, X: Array, scale: Array, solver: str) -> Mode:
    """Return the mode in which the motion goes on from X, by LCPs on the one-sided derivatives."""
    A, B, G = system.lcs.A, system.lcs.B, system.G
    nc = len(system.degree)
    u, U = gaps(system, X, scale)
    # A force may act on rows of degree 0, and on those that touch and do not open.
    opening = (system.degree > 0) & ((u > 0.0) | ((system.degree == 2) & (U > 0.0)))
    undecided = [int(i) for i in np.flatnonzero(~opening)]
    closed: list[int] = []
    order = [0 if u[i] > 0.0 else 1 for i in range(nc)]
    for level in range(len(X) + 1):
        if not undecided:
            break
        # On closed rows the derivative of u is zero, which gives theirs of r; what remains is an LCP.
        g, terms = system.O @ X, np.abs(system.O) @ scale
        c, m = closed, undecided
        eliminated = np.linalg.solve(G[np.ix_(c, c)], np.column_stack([g[c], G[np.ix_(c, m)]]))
        q = g[m] - G[np.ix_(m, c)] @ eliminated[:, 0]
        summed = terms[m] + np.abs(G[np.ix_(m, c)]) @ np.abs(eliminated[:, 0])
        W = G[np.ix_(m, m)] - G[np.ix_(m, c)] @ eliminated[:, 1:]
        q = _zero(summed, q)
        solution = solve_lcp(W, q, solver)
        r = np.zeros(nc)
        r[m] = solution.z
        r[c] = -eliminated[:, 0] - eliminated[:, 1:] @ solution.z
        w_zero = ZERO * (summed + np.abs(W) @ solution.z)
        undecided = []
        for i, z, w, tiny in zip(m, solution.z, solution.w, w_zero, strict=True):
            if z * abs(G[i, i]) > tiny:
                closed.append(i)
                order[i] = level
            elif w > tiny:
                order[i] = int(system.degree[i]) + level
            else:
                undecided.append(i)
        X, scale = A @ X + B @ r, np.abs(A) @ scale + np.abs(B) @ np.abs(r)
    for i in undecided:
        order[i] = -1
    return Mode(tuple(sorted(int(i) for i in closed)), tuple(order))


def impact(run: Run, X: Array) -> tuple[Array, Array]:
    """Return X after the impacts at this instant, and the impulses (nc,): 0 <= P ⟂ U⁺ + e U⁻ >= 0."""
    system = run.system
    P = np.zeros(len(system.degree))
    u, U = gaps(system, X, run.scale)
    meeting = np.flatnonzero((system.degree == 2) & (u <= 0.0))
    if not (U[meeting] < 0.0).any():
        return X, P
    run.fastest[meeting] = np.maximum(run.fastest[meeting], -U[meeting])
    e = np.where(ZENO * run.fastest < -U, system.dynamics.restitution, 0.0)
    q = (U + e * np.minimum(U, 0.0))[meeting]
    P[meeting] = solve_lcp(system.G[np.ix_(meeting, meeting)], q, run.solver).z
    return X + system.lcs.B @ P, P


def refuse_mixed_degrees(system: System) -> None:
    """Refuse contacts that can be closed together while a combination of their gaps has a higher degree than each."""
    H = system.dynamics.H
    for degree in (0, 1, 2):
        rows = np.flatnonzero(system.degree == degree)
        for combination in null_space(system.G[np.ix_(rows, rows)], rcond=1e-12).T:
            # A combination of gaps that no motion changes is not zero (assembly saw to it): its rows never close together.
            if np.abs(combination @ H[rows]).max() > 1e-9:
                names = [repr(system.dynamics.contacts[i].name) for i in rows[np.abs(combination) > 1e-9]]
                raise UnsupportedError(
                    f"the contacts {', '.join(names)} have no common relative degree when all are closed, and 'exact' "
                    "does not handle that: take method='moreau-jean'"
                )


@dataclass(frozen=True)
class Exact(Integrator):
    """The piecewise matrix exponential.

    Parameters
    ----------
    max_events : int
        Limit of events, for runs in which impacts go on without end.

    Notes
    -----
    Handles constant and `Harmonic` loads. The reaction is the force at each instant of the grid (its right limit at an
    event); impulses stand in the events.
    """

    max_events: int = 100_000

    name: ClassVar[str] = "exact"
    declared: ClassVar[Declared] = Declared(
        summary="matrix exponential in each contact mode, events to rounding; the reference",
        order_smooth=float("inf"),
        order_force_jump=float("inf"),
        order_impact=float("inf"),
        relative_degrees=(0, 1, 2),
        reaction_lives="at t, right limit",
        energy="exact",
        source="modes by the linear dynamic complementarity problem: van der Schaft and Schumacher (1998)",
    )

    def __post_init__(self) -> None:
        if isinstance(self.max_events, bool) or not isinstance(self.max_events, int) or self.max_events < 1:
            raise InputError(f"max_events = {self.max_events!r} must be a whole number above zero")

    def reaction_times(self, grid: Grid) -> Array:
        """Return the grid."""
        return grid.times(0, grid.steps)

    def start(self, problem: Problem, grid: Grid, lcp_solver: str, record: Record) -> Run:
        """Choose the first mode and write the initial values; impacts at t = 0 come before them."""
        SOLVERS[lcp_solver]
        system = System(problem.dynamics)
        refuse_mixed_degrees(system)
        X = system.lcs.state(problem.initial_coordinates, problem.initial_velocities)
        record.events = []
        run = Run(system, grid, lcp_solver, self.max_events, [], (0.0, -1), np.zeros(len(system.degree)), np.abs(X))
        _enter(run, record, 0.0, X)
        _sample(run, record, 0, 0)
        return run

    def advance(self, carry: Run, record: Record, first: int, last: int) -> tuple[Status, int]:
        """Follow the events to t_last and sample the block on the grid."""
        t_last = carry.grid.t_end * last / carry.grid.steps
        while carry.next_event[0] <= t_last:
            stalled = len(carry.segments) > STALL and carry.segments[-STALL].t0 == carry.next_event[0]
            if len(carry.segments) > carry.max_events or stalled:
                reached = int(np.searchsorted(carry.grid.times(first, last), carry.next_event[0])) - 1 + first
                _sample(carry, record, first + 1, reached)
                return Status.MAX_EVENTS, reached
            segment = carry.segments[-1]
            t = carry.next_event[0]
            flow, _ = carry.system.mode(segment.mode.closed)
            _enter(carry, record, t, flow.at(segment.X, np.array([t - segment.t0]))[0])
        _sample(carry, record, first + 1, last)
        return Status.SOLVED, last

    def dense(self, carry: Run) -> Dense:
        """Return the solution at any times of the run."""
        segments, system, t_end = tuple(carry.segments), carry.system, carry.grid.t_end
        ends = [*(segment.t0 for segment in segments[1:]), t_end]
        cuts = [
            np.linspace(segment.t0, end, _windows(system, segment, end), endpoint=False)
            for segment, end in zip(segments, ends, strict=True)
        ]
        return Dense(lambda t, side: _read(system, segments, t, side), np.concatenate([*cuts, [t_end]]))


def _windows(system: System, segment: Segment, end: float) -> int:
    """Return how many windows of the flow the segment takes."""
    return math.ceil((end - segment.t0) / system.mode(segment.mode.closed)[0].window)


def _enter(run: Run, record: Record, t: float, X: Array) -> None:
    """Begin a segment at t: impacts, the mode, the events that this makes, and the next switch."""
    system, events = run.system, record.events
    assert events is not None
    run.scale = np.maximum(run.scale, np.abs(X))
    after, P = impact(run, X)
    mode = choose_mode(system, after, run.scale, run.solver)
    flow, F = system.mode(mode.closed)
    new = Segment(t, after, mode)
    old = run.segments[-1] if run.segments else None
    closed_before = set(old.mode.closed) if old else set(mode.closed)
    right = _state(system, new, after)
    left = _state(system, old, X) if old else _state(system, new, X)
    for i, contact in enumerate(system.dynamics.contacts):
        if P[i] > 0.0:
            events.append(Event(t, contact.name, "impact", left, right, float(P[i])))
        if i in mode.closed and i not in closed_before:
            events.append(Event(t, contact.name, "close", left, right))
        if i not in mode.closed and i in closed_before:
            events.append(Event(t, contact.name, "open", left, right))
    run.segments.append(new)

    watched = [i for i in range(len(mode.order)) if mode.order[i] >= 0]
    rows = np.array([F[i] if i in mode.closed else system.lcs.C[i] + system.lcs.D[i] @ F for i in watched])
    order = np.array([mode.order[i] for i in watched], dtype=np.int64)
    crossing = flow.first_crossing(after, run.scale, rows, order, run.grid.t_end - t) if watched else None
    run.next_event = (t + crossing[0], watched[crossing[1]]) if crossing else (np.inf, -1)
    end = min(run.next_event[0], run.grid.t_end)
    run.scale = np.maximum(run.scale, np.abs(flow.windows(after, 1 + _windows(system, new, end))).max(axis=0))


def _state(system: System, segment: Segment, X: Array) -> State:
    """Return what X means in the coordinates of the scheme, in the mode of a segment."""
    q, v, r = _coordinates(system, segment, X[None, :])
    return State(q[0], v[0], r[0])


def _coordinates(system: System, segment: Segment, X: Array) -> tuple[Array, Array, Array]:
    """Return q, v and r for the states X (nt, N)."""
    flow, F = system.mode(segment.mode.closed)
    read = system.lcs.Q + system.lcs.Qr @ F
    return X @ read.T, X @ (read @ flow.A).T, np.maximum(X @ F.T, 0.0)


def _read(system: System, segments: tuple[Segment, ...], t: Array, side: str) -> tuple[Array, Array, Array]:
    """Return q, v and r at the times t, which must be sorted; ``side`` tells which limit is meant at an event."""
    starts = np.array([segment.t0 for segment in segments])
    owner = np.maximum(np.searchsorted(starts, t, side="right" if side == "right" else "left") - 1, 0)
    n, nc = len(system.dynamics.nodes), len(system.degree)
    q, v, r = np.empty((len(t), n)), np.empty((len(t), n)), np.empty((len(t), nc))
    for k in np.unique(owner):
        segment, mine = segments[k], owner == k
        flow, _ = system.mode(segment.mode.closed)
        q[mine], v[mine], r[mine] = _coordinates(system, segment, flow.at(segment.X, t[mine] - segment.t0))
    return q, v, r


def _sample(run: Run, record: Record, first: int, last: int) -> None:
    """Write the grid points first ... last to the record."""
    here = slice(first, last + 1)
    record.q[here], record.v[here], record.reaction[here] = _read(
        run.system, tuple(run.segments), record.t[here], "right"
    )
