"""The exact motion of a linear system as a chain of segments, each a mode with its initial state.

`lcpimpact.integrators.exact` samples it on a grid; the studies of periodic orbits follow it without one, and
`lcpimpact.hybrid.tangent` differentiates it.
"""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.errors import InputError, Status
from lcpimpact.hybrid.contact_loop import (
    END_RTOL,
    GAP_RESOLUTION,
    LAST_FLIGHT_RTOL,
    MIN_FLIGHTS,
    ContactTable,
    Log,
    LoopLimits,
    Present,
    Reason,
    find_end,
    follow_contacts,
)
from lcpimpact.hybrid.event_loop import Ending, EventLoop, Unresolved, refuse_undetermined
from lcpimpact.hybrid.flow import Flow
from lcpimpact.hybrid.gaps import gaps, still
from lcpimpact.hybrid.generator import SparseRows
from lcpimpact.hybrid.impacts import impact
from lcpimpact.hybrid.sampling import Expansions, Segments, at_windows, expand
from lcpimpact.hybrid.state_jump import enter_constraint
from lcpimpact.hybrid.system import (
    FINE_ZERO,
    ZERO,
    Mode,
    Still,
    System,
    refuse_mixed_degrees,
    round_to_zero,
    rounded_product,
    system_of,
)
from lcpimpact.hybrid.transition import enter, happened, parted, state_of
from lcpimpact.lcp.solve import solve_lcp
from lcpimpact.numerics.double_double import DoubleDouble
from lcpimpact.problems.base import GIVEN_ZERO_RTOL, Problem
from lcpimpact.record import Event, State
from lcpimpact.scheme.dynamics import Dynamics

MAX_COLLAPSE_IMPACTS = 10_000
"""Maximum number of impacts of unresolved order."""

MIN_CUTS, MAX_CUTS = 4_000, 100_000
"""Numbers of instants at which a segment, and the whole motion, is sampled for the energy balance."""

RECENT_FLIGHTS, SLOW_IMPACT_RTOL = 64, 1e-12
"""Impacts accumulate (see `MIN_FLIGHTS`) if their approach rates are below SLOW_IMPACT_RTOL times the largest velocities.
Contacts with an impact within RECENT_FLIGHTS such flights accumulate together."""


@dataclass(frozen=True, eq=False)
class Segment:
    """One mode from t0 on: X(t) = exp(A (t - t0)) X.

    Attributes
    ----------
    start : DoubleDouble    its initial instant, in s
    before : (N,) array     the left limit of the state there; of the first segment the given state
    state : DoubleDouble    the right limit (N,)
    mode : Mode             the contact mode
    ended : (N,) array      the row c of the last segment whose zero began this one; zero for the first, and after a
                            breakpoint of the signals
    events : tuple          the events at t0
    """

    start: DoubleDouble
    before: Array
    state: DoubleDouble
    mode: Mode
    ended: Array
    events: tuple[Event, ...]

    @property
    def t0(self) -> float:
        """The initial instant as a float."""
        return float(self.start.hi)

    @property
    def X(self) -> Array:
        """The right limit in floats (N,)."""
        return self.state.hi

    def since(self, t: Array) -> Array:
        """Return the times t relative to its start."""
        return np.asarray((t - self.t0) - float(self.start.lo))


@dataclass(eq=False)
class HybridMotion(EventLoop[System]):
    """The exact motion so far: its segments, and the next event (inf: none before the end).

    Attributes
    ----------
    next_event : (DoubleDouble, array, DoubleDouble)
        Its instant, the row that falls through zero, and X there; at a breakpoint of the signals the row is zero.
    row : int                               the row of the system whose event function that is; -1 if none
    impacts : (2, nc) array                 the last impact of each row, double-doubles
    short : (nc,) array                     number of consecutive short flights of each row
    collapsed : int                         the last segment that began by a collapse
    horizon : float                         end of the run that a burst is part of, up to which impacts accumulate
    table : ContactTable, optional          that of the compiled loop, of a system that has one
    segments : list of Segment
    solution : ExactSolution, optional            the motion once it has ended
    """

    next_event: tuple[DoubleDouble, Array, DoubleDouble]
    impacts: Array
    short: Indices
    table: ContactTable | None = None
    row: int = -1
    collapsed: int = 0
    horizon: float = 0.0
    segments: list[Segment] = field(default_factory=list)
    solution: ExactSolution | None = None

    max_at_once: ClassVar[int] = 1_000

    @property
    def events(self) -> list[Event]:
        """The events so far."""
        return [event for segment in self.segments for event in segment.events]

    def integrate(self, until: float) -> Ending | Status:
        """Return the next event, which is known since the start of the segment; events of contacts are followed at once."""
        if self.table is not None and self.next_event[0].hi <= until:
            _follow_contacts(self, self.table, until)
        t, row, X = self.next_event
        if not t.hi <= until:
            return Status.SOLVED
        start, falls = self.segments[-1].start, bool(row.any())
        since = float((t.hi - start.hi) + (t.lo - start.lo))
        return Ending(float(t.hi), since, X.hi, 0 if falls else -1, not falls)

    def enter(self, ending: Ending) -> Status:
        """Begin the next segment, with the next event in double-doubles."""
        t, row, X = self.next_event
        # At a breakpoint the signals are floats again, with their rounding.
        _begin_segment(self, t, X, row, GIVEN_ZERO_RTOL if ending.breakpoint else FINE_ZERO)
        return Status.SOLVED


def begin(
    system: System,
    X: Array,
    end: float,
    start: float = 0.0,
    solver: str = "auto",
    max_events: int = 100_000,
    scale: Array | None = None,
    v: Array | None = None,
) -> HybridMotion:
    """Return the motion from the state X (N,) at ``start``, after impacts there and the choice of the mode.

    If X was computed by a motion, its ``scale`` is the scale of the rounding in X. The velocities v (n,) before the start
    include those of massless nodes, which are not in X.
    """
    none = np.zeros(len(X))
    nc = len(system.degree)
    t = DoubleDouble.of(start)
    never = np.stack([np.full(nc, -np.inf), np.zeros(nc)])
    short = np.zeros(nc, dtype=np.int64)
    size = np.abs(X) if scale is None else scale
    breakpoints = system.form.breakpoints(start, end)
    X = np.where(np.arange(len(X)) == system.form.constant, 1.0, X)
    next_event = (DoubleDouble.of(np.inf), none, DoubleDouble.of(X))
    table = ContactTable.of(system, system.plant) if system.plant is not None and solver == "auto" else None
    motion = HybridMotion(system, end, solver, max_events, breakpoints, size, next_event, never, short, table)
    _begin_segment(motion, t, DoubleDouble.of(X), none, GIVEN_ZERO_RTOL if scale is None else ZERO, v)
    return motion


def begin_problem(
    problem: Problem,
    method: str,
    end: float,
    solver: str = "auto",
    max_events: int = 100_000,
    dynamics: Dynamics | None = None,
    *,
    longest_run: float = 1e150,
) -> HybridMotion:
    """Return the motion from the initial state of a problem, by its own dynamics unless others are given.

    ``longest_run``: longest run in s: its square is a number, with room for accelerations beside it.

    Raises
    ------
    UnsupportedError
        If contacts have no common relative degree, or the initial state leaves their forces undetermined.
    InputError
        If the run is longer than `longest_run`.
    """
    if end > longest_run:
        raise InputError(f"t_end = {end:g} s is longer than {longest_run:g} s, and t² no number: take a shorter t_end")
    problem, _ = enter_constraint(problem, solver)
    system = system_of(dynamics or problem.dynamics, end)
    refuse_mixed_degrees(system, method, except_contacts=True)
    q, v = problem.initial_coordinates, problem.initial_velocities
    with refuse_undetermined(problem, method):
        return begin(system, system.state(q, v), end, 0.0, solver, max_events, v=v)


def state_before(motion: HybridMotion, t: float) -> Array:
    """Return the left limit of X at an instant of the last segment (N,)."""
    segment = motion.segments[-1]
    flow, _ = motion.system.reaction(segment.mode)
    return flow.move(segment.state, float(segment.since(np.asarray(t)))).hi


def _begin_segment(
    motion: HybridMotion,
    t: DoubleDouble,
    X: DoubleDouble,
    ended: Array,
    zero: float,
    v: Array | None = None,
    *,
    rest_rtol: float = 2.0**-76,
) -> None:
    """Begin a segment at t: impacts, the mode, the events, and the next switch.

    ``rest_rtol``: gap rate, relative to its terms, below which a contact is at rest.
    """
    system = motion.system
    motion.scale = np.maximum(motion.scale, np.abs(X.hi))
    held = None
    breakpoint = bool(motion.segments) and not ended.any()
    resolved = None if breakpoint else _resolved(motion, t, X)
    if resolved is not None:
        first, known = resolved
        before_it, motion.switches = len(motion.segments), motion.switches - len(motion.segments)
        del motion.segments[first + 1 :]
        limit = _collapse(motion, t, rest_rtol if known else SLOW_IMPACT_RTOL)
        if len(motion.segments) == before_it == first + 1:
            resolved = None  # no contact lands by its rate alone, but by forces
        else:
            t, X, held = limit
            motion.collapsed, zero = len(motion.segments), FINE_ZERO
            motion.end = max(motion.end, float(t.hi))
        motion.switches += len(motion.segments)
    before = motion.segments[-1].mode if motion.segments else None
    at = system, float(t.hi), before, X, motion.scale, motion.solver
    found = enter(*at, zero=zero, held=held, breakpoint=breakpoint, v=v)
    together = _accumulated(motion, t, found.events) if resolved is None and not breakpoint else None
    if together is not None:
        found = enter(*at, zero=zero, together=together, v=v)
    motion.segments.append(Segment(t, found.left.hi, found.state, found.mode, ended, found.events))
    motion.scale = np.maximum(found.scale, system.reach @ found.scale)
    _find_end(motion)


def _find_end(motion: HybridMotion) -> None:
    """Find the end of the last segment: an event, a breakpoint of the signals, or none; in compiled code if it is near."""
    if motion.table is not None:
        plant = motion.table.plant._replace(breakpoints=motion.breakpoints)
        present = _present(motion, motion.table)
        if find_end(plant, motion.table.modes, present, _limits(motion, motion.end)):
            _unpack(motion, motion.table, present)
            return
    _find_end_generally(motion)


def _find_end_generally(motion: HybridMotion) -> None:
    """Find the end of the last segment in any number of windows, or the breakpoint that ends it."""
    segment, system = motion.segments[-1], motion.system
    flow, _ = system.reaction(segment.mode)
    watch = system.watch(segment.mode)
    stop = motion.next_breakpoint(segment.t0)
    end = motion.end * (1.0 + END_RTOL)
    horizon = min(stop, end) - segment.t0
    crossing = flow.first_crossing(segment.state, motion.scale, watch.rows, watch.order, horizon, watch.entries)
    motion.scale = crossing.scale
    found = segment.start + crossing.t
    if crossing.row >= 0 and found.hi <= end and found.hi < stop:
        when = found if found.hi <= motion.end else DoubleDouble.of(motion.end)
        motion.next_event = (when, watch.rows.hi[crossing.row], crossing.state)
        motion.row = int(watch.contacts[crossing.row])
        return
    never, motion.row = np.zeros(len(segment.state)), -1
    if stop <= motion.end:
        length = DoubleDouble.of(stop) - segment.start
        there = flow.move(segment.state, float(length.hi), float(length.lo))
        motion.next_event = (DoubleDouble.of(stop), never, there)
    else:
        motion.next_event = (DoubleDouble.of(np.inf), never, crossing.state)


def _follow_contacts(motion: HybridMotion, table: ContactTable, until: float) -> None:
    """Follow the motion up to an instant, or to an event that the compiled loop leaves to the general code."""
    plant = table.plant._replace(breakpoints=motion.breakpoints)
    limits = _limits(motion, until)
    while motion.next_event[0].hi <= until:
        present, log = _present(motion, table), table.new_log()
        why, count = follow_contacts(plant, table.modes, present, log, limits)
        if count:
            _append(motion, table, log, count)
            _unpack(motion, table, present)
            if why == Reason.NO_END:
                _find_end_generally(motion)
        if why == Reason.NEW_MODE:
            table.place(motion.system, tuple(np.flatnonzero(present.wanted).tolist()))
        elif why not in (Reason.NO_END, Reason.FULL):
            return


def _limits(motion: HybridMotion, until: float) -> LoopLimits:
    """Return where the compiled loop ends."""
    return LoopLimits(float(until), float(motion.end), motion.max_events, motion.max_at_once)


def _present(motion: HybridMotion, table: ContactTable) -> Present:
    """Return the last segment and the next event of a motion, for compiled code."""
    last = motion.segments[-1]
    t, _, X = motion.next_event
    numbers = [table.place(motion.system, last.mode.closed), motion.row, motion.switches, motion.at_once]
    start = np.array(last.start.parts, order="C")
    state = np.array(last.state.parts, order="C")
    when = np.array(t.parts, order="C")
    there = np.array(X.parts, order="C")
    order = np.array(last.mode.order)
    wanted = np.zeros(len(motion.short), np.bool_)
    return Present(
        start, state, when, there, motion.scale.copy(), order, motion.impacts, motion.short, np.array(numbers), wanted
    )


def _unpack(motion: HybridMotion, table: ContactTable, present: Present) -> None:
    """Write the next event from compiled code into the motion."""
    place, motion.row, motion.switches, motion.at_once = present.numbers.tolist()
    motion.scale = present.scale
    row = table.rows[place][motion.row] if motion.row >= 0 else np.zeros(len(motion.scale))
    motion.next_event = (DoubleDouble(present.t), row, DoubleDouble(present.X))


def _append(motion: HybridMotion, table: ContactTable, log: Log, count: int) -> None:
    """Append the segments of a log."""
    system = motion.system
    start = log.start
    before = log.before
    state = log.state
    left = log.left
    right = log.right
    impulse = log.impulse
    order = log.order
    switch = log.switch
    states = [[State(*each) for each in zip(*parted(system, side[:count]), strict=True)] for side in (left, right)]
    for k, (old, new, row) in enumerate(switch[:count].tolist()):
        mode = table.mode(new, order[k])
        was = motion.segments[-1].mode
        events = happened(system.dynamics, float(start[k, 0]), was, mode, impulse[k], states[0][k], states[1][k])
        segment = Segment(
            DoubleDouble(start[k]), before[k], DoubleDouble(state[k]), mode, table.rows[old][row], tuple(events)
        )
        motion.segments.append(segment)


def _accumulated(motion: HybridMotion, t: DoubleDouble, events: tuple[Event, ...]) -> Flags | None:
    """Record the impacts at t, and return the rows whose impacts have accumulated (nc,), if any."""
    system = motion.system
    shortest = LAST_FLIGHT_RTOL * abs(float(t.hi))
    hit = [
        event for event in events if event.impulse > 0.0 and system.dynamics.impenetrable[system.names[event.contact]]
    ]
    if not hit:
        return None
    rows = [system.names[event.contact] for event in hit]
    # Contacts that were closed have no impact: they only transmit impulses.
    passes_on = still(system, motion.segments[-1].mode if motion.segments else None).U
    tired = []
    for i in rows:
        if passes_on[i]:
            continue
        flight = (t.hi - motion.impacts[0, i]) + (t.lo - motion.impacts[1, i])
        motion.short[i] = motion.short[i] + 1 if flight < shortest else 0
        motion.impacts[:, i] = t.parts
        if motion.short[i] >= MIN_FLIGHTS and system.dynamics.rebounds_decay[i]:
            tired.append(i)
    if not tired:
        return None
    slow = SLOW_IMPACT_RTOL * (np.abs(system.fine.CA.hi) @ motion.scale)
    before, after = (system.dynamics.H @ each.v for each in (hit[0].left, hit[0].right))
    if not (np.abs(before) <= slow)[tired].any():
        return None
    since = (t.hi - motion.impacts[0]) + (t.lo - motion.impacts[1])
    together = (motion.short > 0) & (since < RECENT_FLIGHTS * shortest) & (np.abs(after) <= slow)
    motion.short[together] = 0
    if system.dynamics.has_other_impact_law:
        # There e of a contact that passes an impact on counts, too.
        together[rows] |= (np.abs(before) <= slow)[rows]
    return np.asarray(together)


def _opening(motion: HybridMotion, mode: Mode, X: DoubleDouble) -> tuple[Array, Array]:
    """Return u and U (nc,) in floats, with constrained values and rounding set to zero."""
    u, U = gaps(motion.system, X, motion.scale, still(motion.system, mode), FINE_ZERO)
    return u.hi, U.hi


def _accelerations(motion: HybridMotion, flow: Flow, X: DoubleDouble) -> Array:
    """Return the opening accelerations (nc,) in the state X of a mode, with zero in place of rounding."""
    rows = rounded_product(motion.system.fine.CA, flow.generator)
    return round_to_zero(rows @ X, np.abs(rows.hi) @ motion.scale).hi


def _resolved(
    motion: HybridMotion,
    t: DoubleDouble,
    X: DoubleDouble,
    *,
    collapse_rtol: float = 2.0**-40,
    deflection_rtol: float = 1e-6,
) -> tuple[int, bool] | None:
    """Return the segment from which impacts follow each other too fast for double-doubles to order them.

    Two or more contacts close at t, and the gap of one has too few digits to order them; so the motion goes back to where
    all gaps are known, unless forces deflect the flights since: then the flag is False. So do contacts that still open at
    t, with a gap below rounding, while others close. None if all is resolved.

    ``collapse_rtol``: time since the last impact, relative to the time, below which impacts of unresolved order are
    followed even if forces deflect the flights.
    ``deflection_rtol``: relative change of a gap rate by forces above which they deflect a flight.
    """
    system, segments = motion.system, motion.segments
    if len(segments) <= motion.collapsed or np.count_nonzero(system.dynamics.rigid) < 2:
        return None
    size = np.abs(system.fine.C.hi) @ motion.scale

    def opening(segment: Segment) -> tuple[Array, Flags]:
        """Return U, and which gaps have too few digits, at the start of a segment."""
        u, U = _opening(motion, segment.mode, segment.state)
        return U, system.dynamics.rigid & (u > 0.0) & (u < GAP_RESOLUTION * size)

    _, unknown = opening(segments[-1])
    u, U = _opening(motion, segments[-1].mode, X)
    landing = (u <= 0.0) & system.dynamics.rigid & ~still(system, segments[-1].mode).u
    if landing.sum() < 2 or not (U[landing] < 0.0).any():
        return None
    near = segments[-1].t0 >= float(t.hi) * (1.0 - collapse_rtol)
    if not (landing & unknown).any():
        # What forces alone have opened since is ahead of what lands, however small its gap.
        return (len(segments) - 1, True) if near and (U[landing] > 0.0).any() else None
    first, speed = len(segments) - 1, np.abs(U[landing]).max()
    while unknown.any():
        before = segments[first - 1]
        bends = np.abs((system.fine.O @ before.state).hi[landing]) * float((t - before.start).hi)
        if first - 1 < motion.collapsed or (bends > deflection_rtol * speed).any():
            return (first, False) if near else None
        first -= 1
        U, unknown = opening(segments[first])
        speed = np.abs(U[landing]).max()
    return first, True


def _collapse(motion: HybridMotion, t: DoubleDouble, rest: float) -> tuple[DoubleDouble, DoubleDouble, Still]:
    r"""Append a segment for each impact after the start of the last one; return their end, X, and the zeros there.

    The gaps u are integrated as separate numbers, which keep their digits however small they become, with

    .. math:: u ← u + U δ, \qquad δ = \min_{U_i < 0} \frac{u_i}{-U_i} ,

    and the impacts at u = 0, until the next flight is long compared with the time since the start. Contacts slower than
    ``rest`` times the largest velocities are at rest. Forces do not deflect such short flights.

    Raises
    ------
    Unresolved
        If the impacts do not end.
    """
    system = motion.system
    now = motion.segments[-1].start
    X = motion.segments[-1].state
    mode, rows = motion.segments[-1].mode, system.dynamics.rigid
    names = [contact.name for contact in system.dynamics.contacts]
    held = still(system, mode)
    u, U = _opening(motion, mode, X)
    size = np.abs(system.fine.C.hi) @ motion.scale
    slow = rest * (np.abs(system.fine.CA.hi) @ motion.scale)
    latest = t + RECENT_FLIGHTS * max(float((t - now).hi), LAST_FLIGHT_RTOL * float(now.hi))
    for _ in range(MAX_COLLAPSE_IMPACTS):
        flights = np.divide(u, -U, out=np.full(len(u), np.inf), where=rows & (U < 0.0))
        δ = flights.min()
        if not (now + δ).hi <= latest.hi:
            rests = rows & (u <= GAP_RESOLUTION * size) & (np.abs(U) <= slow)
            return now, X, Still(held.u & ~rows | rests, held.U | rests, held.closed & ~rows | rests)
        meets = flights == δ
        flow, _ = system.mode(mode)
        near = rows & (u <= GAP_RESOLUTION * size)
        newton = not (system.has_friction_or_joints or system.dynamics.has_other_impact_law)
        if (meets & near).any() and (np.abs(U) <= slow)[near].all() and newton:
            # Rates below rounding take their time, too: all meet at the limit.
            limit = _time_to_limit(system, near, u, U, held, float(now.hi))
            there = np.abs(gaps(system, flow.move(X, limit), motion.scale, held, FINE_ZERO)[1].hi)
            last = min(max(motion.end, motion.horizon), motion.next_breakpoint(float(now.hi))) - float(now.hi)
            if δ < limit < flights[~near].min(initial=last) and (there <= slow)[near].all():
                δ, meets = limit, near
        opens = (u == 0.0) & ~held.u & ~meets & ((U > 0.0) | (U == 0.0) & (_accelerations(motion, flow, X) > 0.0))
        now, X = now + δ, flow.move(X, δ)
        u = np.where(meets, 0.0, np.maximum(u + U * δ, 0.0))
        e = np.where(-slow <= U, 0.0, system.dynamics.restitution)
        touches = rows & (u == 0.0) & ~opens
        after, P, held = impact(system, X, motion.scale, motion.solver, e, held, FINE_ZERO, touches)
        left, t0 = state_of(system, mode, X), float(now.hi)
        mode = replace(mode, closed=tuple(i for i in mode.closed if held.U[i] or not rows[i]))
        right = state_of(system, mode, after)
        ended = system.fine.C.hi[np.argmax(meets)]
        law = system.dynamics.law_of_impacts
        events = tuple(Event(t0, names[i], "impact", left, right, float(P[i]), law) for i in np.flatnonzero(P))
        motion.segments.append(Segment(now, X.hi, after, mode, ended, events))
        X = after
        U = gaps(system, X, motion.scale, held, FINE_ZERO)[1].hi
    raise Unresolved


def _time_to_limit(system: System, near: Flags, u: Array, U: Array, held: Still, t: float) -> float:
    """Return the time in s to the limit of the impacts of the rows ``near`` (nc,), or to the last one; 0 if they do not end.

    Gaps and rates are followed as separate numbers, without forces, and in units that shrink with them.
    """
    u = u[near]
    U = U[near]
    G = system.G[np.ix_(near, near)]
    closed = held.u[near]
    e = system.dynamics.restitution[near]
    since = 0.0
    short = 0
    for _ in range(MAX_COLLAPSE_IMPACTS):
        flights = np.divide(u, -U, out=np.full(len(u), np.inf), where=U < 0.0)
        δ = float(flights.min())
        if not math.isfinite(δ):
            return since
        since = since + δ
        short = short + 1 if δ < LAST_FLIGHT_RTOL * t else 0
        if short == MIN_FLIGHTS:
            return since
        meets = flights == δ
        u = np.where(meets, 0.0, np.maximum(u + U * δ, 0.0))
        struck = meets | closed
        W = G[np.ix_(struck, struck)]
        P = (
            solve_lcp(W, (U + e * np.minimum(U, 0.0))[struck]).z
            if len(W) > 1
            else -(1.0 + e[struck]) * U[struck] / W[0]
        )
        U = U + G[:, struck] @ P
        closed &= U <= 0.0
        unit = math.ldexp(1.0, -math.frexp(float(np.abs(U).max()))[1])
        u, U = u * unit, U * unit
    return 0.0


def cuts(motion: HybridMotion) -> tuple[Array, Flags]:
    """Return times from the start to the end (nk,), and whether the motion is resolved between them (nk - 1,)."""
    ends = [*(segment.t0 for segment in motion.segments[1:]), motion.end]
    most = max(MIN_CUTS, MAX_CUTS // len(motion.segments))
    found = []
    for segment, end in zip(motion.segments, ends, strict=True):
        times, little = motion.system.mode(segment.mode)[0].cuts(end - segment.t0, most)
        found.append((segment.t0 + times, little))
    times, little = (np.concatenate(each) for each in zip(*found, strict=True))
    return np.append(times, motion.end), little


@dataclass(frozen=True, eq=False)
class ExactSolution:
    """The segments of a motion up to ``end``, in s, which are read at any times.

    What was read for a record is ``known`` until the certificate asks for it.
    """

    system: System
    segments: tuple[Segment, ...]
    end: float
    known: list[tuple[Array, Array]] = field(default_factory=list)

    @classmethod
    def of(cls, motion: HybridMotion) -> ExactSolution:
        """Return a motion as far as it is known."""
        return cls(motion.system, tuple(motion.segments), motion.end)

    def __getstate__(self) -> dict[str, Any]:
        return {"system": self.system, "segments": self.segments, "end": self.end, "known": []}

    @cached_property
    def chain(self) -> Segments:
        """The initial instants and states of the segments."""
        parts = [(segment.start.parts, segment.state.parts) for segment in self.segments]
        starts, states = (np.array(each) for each in zip(*parts, strict=True))
        return Segments(starts, states)

    @cached_property
    def kinds(self) -> list[tuple[Flow, Indices, SparseRows, Expansions]]:
        """The flow of each mode, its segments, the rows of q, v and r, and their polynomials in its windows."""
        found: dict[Hashable, list[int]] = {}
        for i, segment in enumerate(self.segments):
            found.setdefault(segment.mode.key, []).append(i)
        ends = np.append(self.chain.starts[1:, 0], self.end)
        kinds = []
        for each in found.values():
            mode, mine = self.segments[each[0]].mode, np.array(each)
            flow, _ = self.system.mode(mode)
            rows = self.system.coordinates(mode).entries
            kept = flow.expansions(ends[mine] - self.chain.starts[mine, 0], rows)
            terms = self.system.terms(mode)
            if terms is not None and len(kept.last):
                kept = expand(kept, terms, at_windows(flow.step, self.chain, mine, kept.first))
            kinds.append((flow, mine, rows, kept))
        return kinds

    def __call__(self, t: Array, side: str) -> tuple[Array, Array, Array]:
        """Return q, v and r at the sorted times t; ``side`` selects the limit at an event."""
        if side == "right" and self.known and self.known[0][0] is t:
            return parted(self.system, self.known.pop()[1])
        return parted(self.system, self._values(t, side))

    def of_record(self, t: Array) -> tuple[Array, Array, Array]:
        """Return q, v and r at the times of a record, right limits, and know them for the next reading there."""
        self.known[:] = [(t, self._values(t, "right"))]
        return parted(self.system, self.known[0][1])

    def _values(self, t: Array, side: str) -> Array:
        """Return the values of the rows of `System.coordinates` at the sorted times t (nt, 2 n + nc)."""
        found = np.empty((2 * len(self.system.dynamics.nodes) + len(self.system.degree), len(t)))
        bounds = np.empty(len(self.segments) + 1, np.int64)
        bounds[:-1] = t.searchsorted(self.chain.starts[:, 0], "left" if side == "right" else "right")
        bounds[0], bounds[-1] = 0, len(t)
        for flow, mine, rows, kept in self.kinds:
            flow.read(self.chain, mine, t, bounds, rows, kept, found)
        return found.T
