"""The exact solution of a linear scheme: a matrix exponential for each contact mode, joined at events found to rounding.

`lcpimpact.integrators.modes` chooses the mode at the start and after every event; `lcpimpact.integrators.flow` finds where
it ends, and misses no event.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import FailureError, InputError, Status, UnsupportedError
from lcpimpact.integrators.base import Declared, Dense, Grid, Integrator, Record
from lcpimpact.integrators.modes import Mode, System, refuse_mixed_degrees
from lcpimpact.integrators.transition import coordinates, enter
from lcpimpact.lcp import SOLVERS
from lcpimpact.problems.base import Problem
from lcpimpact.scheme.dynamics import Feature

MOST_CUTS = 4_000
"""So many instants show a segment well enough for its scale and its balance of energy."""

STALL = 100
"""So many events at one instant are no motion: the run ends as if it had reached max_events."""


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
    scale: Array


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
        order_force_kink=float("inf"),
        order_impact=float("inf"),
        order_friction=float("inf"),
        order_penetration=float("inf"),
        level="position and velocity",
        relative_degrees=(0, 1, 2),
        handles=(Feature.SLIDERS, Feature.MOTIONS, Feature.SYSTEMS, Feature.MASSLESS, Feature.RESTITUTION),
        reaction_lives="at t, right limit",
        energy="exact",
        dissipates=True,
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
        X = system.state(problem.initial_coordinates, problem.initial_velocities)
        record.events = []
        run = Run(system, grid, lcp_solver, self.max_events, [], (0.0, -1), np.abs(X))
        try:
            _enter(run, record, 0.0, X)
        except np.linalg.LinAlgError:
            raise UnsupportedError(
                f"some contacts or sliders of {problem.name!r} hold together at the start in a way that leaves their shares "
                "undetermined, which 'exact' does not handle: take method='moreau-jean'"
            ) from None
        _sample(run, record, 0, 0)
        return run

    def advance(self, carry: Run, record: Record, first: int, last: int) -> tuple[Status, int]:
        """Follow the events to t_last and sample the block on the grid."""
        t_last = carry.grid.t_end * last / carry.grid.steps
        while carry.next_event[0] <= t_last:
            stalled = len(carry.segments) > STALL and carry.segments[-STALL].t0 == carry.next_event[0]
            if len(carry.segments) > carry.max_events or stalled:
                return Status.MAX_EVENTS, _sample_before(carry, record, first, last)
            segment = carry.segments[-1]
            t = carry.next_event[0]
            flow, _ = carry.system.mode(segment.mode)
            try:
                _enter(carry, record, t, flow.at(segment.X, np.array([t - segment.t0]))[0])
            except FailureError as failure:
                return failure.result.status, _sample_before(carry, record, first, last)
            except np.linalg.LinAlgError:
                return Status.SINGULAR, _sample_before(carry, record, first, last)
        _sample(carry, record, first + 1, last)
        return Status.SOLVED, last

    def dense(self, carry: Run) -> Dense:
        """Return the solution at any times of the run."""
        segments, system, t_end = tuple(carry.segments), carry.system, carry.grid.t_end
        ends = [*(segment.t0 for segment in segments[1:]), t_end]
        cuts = [_cuts(system, segment, end) for segment, end in zip(segments, ends, strict=True)]
        return Dense(lambda t, side: _read(system, segments, t, side), np.concatenate([*cuts, [t_end]]))


def _cuts(system: System, segment: Segment, end: float) -> Array:
    """Return times from the start of a segment, its end not included, between which it turns little.

    They are the windows of its flow. Where a stiff mode has more of them than `MOST_CUTS`, its fast parts decay soon, and
    the times spread out geometrically after the start.
    """
    windows = math.ceil((end - segment.t0) / system.mode(segment.mode)[0].window)
    if windows <= MOST_CUTS:
        return np.linspace(segment.t0, end, windows, endpoint=False)
    return segment.t0 + (end - segment.t0) * np.append(0.0, np.geomspace(1.0 / windows, 1.0, MOST_CUTS)[:-1])


def _enter(run: Run, record: Record, t: float, X: Array) -> None:
    """Begin a segment at t: impacts, the mode, the events that this makes, and the next switch."""
    system = run.system
    assert record.events is not None
    before = run.segments[-1].mode if run.segments else None
    run.scale = np.maximum(run.scale, np.abs(X))
    mode, after, events = enter(system, t, before, X, run.scale, run.solver)
    record.events += events
    flow, _ = system.mode(mode)
    new = Segment(t, after, mode)
    run.segments.append(new)

    watched = system.watched(mode)
    rows = np.array([row for _, row, _ in watched])
    order = np.array([zeros for _, _, zeros in watched], dtype=np.int64)
    crossing = flow.first_crossing(after, run.scale, rows, order, run.grid.t_end - t) if watched else None
    run.next_event = (t + crossing[0], watched[crossing[1]][0]) if crossing else (np.inf, -1)
    end = min(run.next_event[0], run.grid.t_end)
    seen = flow.at(after, np.append(_cuts(system, new, end), end) - t)
    run.scale = np.maximum(run.scale, np.abs(seen).max(axis=0))


def _read(system: System, segments: tuple[Segment, ...], t: Array, side: str) -> tuple[Array, Array, Array]:
    """Return q, v and r at the times t, which must be sorted; ``side`` tells which limit is meant at an event."""
    starts = np.array([segment.t0 for segment in segments])
    owner = np.maximum(np.searchsorted(starts, t, side="right" if side == "right" else "left") - 1, 0)
    n, nc = len(system.dynamics.nodes), len(system.degree)
    q, v, r = np.empty((len(t), n)), np.empty((len(t), n)), np.empty((len(t), nc))
    for k in np.unique(owner):
        segment, mine = segments[k], owner == k
        flow, _ = system.mode(segment.mode)
        q[mine], v[mine], r[mine] = coordinates(system, segment.mode, flow.at(segment.X, t[mine] - segment.t0))
    return q, v, r


def _sample_before(run: Run, record: Record, first: int, last: int) -> int:
    """Write the grid points after ``first`` that come before the next event, and return the last of them."""
    reached = first + int(np.searchsorted(run.grid.times(first, last), run.next_event[0])) - 1
    _sample(run, record, first + 1, reached)
    return reached


def _sample(run: Run, record: Record, first: int, last: int) -> None:
    """Write the grid points first ... last to the record."""
    here = slice(first, last + 1)
    record.q[here], record.v[here], record.reaction[here] = _read(
        run.system, tuple(run.segments), record.t[here], "right"
    )
