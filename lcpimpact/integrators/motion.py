"""The exact motion of a linear system as a chain of segments, each a mode with the state that it begins from.

`lcpimpact.integrators.exact` samples it on a grid; the studies of periodic orbits follow it without one, and
`lcpimpact.integrators.tangent` differentiates it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.double_double import DoubleDouble
from lcpimpact.errors import FailureError, Status, UnsupportedError
from lcpimpact.integrators.base import Event
from lcpimpact.integrators.modes import (
    FINE_ZERO,
    ZERO,
    Mode,
    System,
    gaps,
    impact,
    refuse_mixed_degrees,
    settled,
    still,
)
from lcpimpact.integrators.state_jump import enter_constraint
from lcpimpact.integrators.transition import enter, parted, state_of
from lcpimpact.problems.base import GIVEN_ZERO, Problem
from lcpimpact.scheme.dynamics import Dynamics

MOST_CUTS = 4_000
"""So many instants show a segment well enough for its balance of energy."""

STALL = 1_000
"""So many events at one instant are no motion: the run ends as if it had reached max_events."""

AT_END = 4.0 * float(np.finfo(float).eps)
"""An event this little after the end, relative to it, is one at the end, which is a float."""

NEAR, PATTERN, MOST_IMPACTS = 2.0**-40, 6, 10_000
"""Impacts whose order is lost in rounding: this near to the one before, of the time passed; the longest pattern in which
they may repeat; and the most that are followed until plates meet at rest."""

RECENT, FLIGHTS, SHORT, SLOW = 64, 3, 2.0**-52, 1e-12
"""Impacts accumulate when this many flights in a row are each shorter than SHORT of the time passed, below which instants
cannot be told apart, and the plates meet at less than SLOW of the largest velocities of the run. Those that met within
RECENT of such times accumulate together."""


class Unresolved(Exception):
    """Impacts of several bodies accumulate in no order that repeats."""


@dataclass(frozen=True, eq=False)
class Segment:
    """One mode from t0 on: X(t) = exp(A (t - t0)) X.

    Attributes
    ----------
    start : DoubleDouble    the instant at which it begins, in s
    before : (N,) array     the left limit of the state there; of the first segment what it was given
    state : DoubleDouble    the right limit (N,)
    mode : Mode             what each row does
    ended : (N,) array      the row c of the segment before whose fall through zero began this one; zero of the first, and of
                            one that begins at a breakpoint of the signals
    events : tuple          what happened at t0
    """

    start: DoubleDouble
    before: Array
    state: DoubleDouble
    mode: Mode
    ended: Array
    events: tuple[Event, ...]

    @property
    def t0(self) -> float:
        """The instant at which it begins, as a float."""
        return float(self.start.hi)

    @property
    def X(self) -> Array:
        """The right limit in floats (N,)."""
        return self.state.hi

    def since(self, t: Array) -> Array:
        """Return how long after its beginning the times t are."""
        return np.asarray((t - self.t0) - float(self.start.lo))


@dataclass(eq=False)
class Motion:
    """What travels along the motion: the segments found so far, and the next event (inf: none before the end).

    Attributes
    ----------
    system : System
    end : float                             the instant to which events are looked for, in s
    solver : str                            name of an LCP solver
    max_events : int
    next_event : (DoubleDouble, array, DoubleDouble)
        When it is, the row that falls through zero, and X there; at a breakpoint of the signals no row does.
    breakpoints : (nb,) array               those of the signals, from the start to the end
    scale : (N,) array                      largest |X| so far, to which rounding is relative
    impacts : list of DoubleDouble          the last impact of each row
    short : (nc,) array                     how many flights of each row were short, one after the other
    history : list of tuple of int          the rows of each impact
    segments : list of Segment
    """

    system: System
    end: float
    solver: str
    max_events: int
    next_event: tuple[DoubleDouble, Array, DoubleDouble]
    breakpoints: Array
    scale: Array
    impacts: list[DoubleDouble]
    short: Indices
    history: list[tuple[int, ...]] = field(default_factory=list)
    segments: list[Segment] = field(default_factory=list)

    @property
    def events(self) -> list[Event]:
        """What has happened so far."""
        return [event for segment in self.segments for event in segment.events]


def begin(
    system: System,
    X: Array,
    end: float,
    start: float = 0.0,
    solver: str = "auto",
    max_events: int = 100_000,
    scale: Array | None = None,
    v: Array | None = None,
) -> Motion:
    """Return the motion from the state X (N,) at ``start``, where impacts come first and the mode is chosen.

    Where X was itself found by a motion, its ``scale`` says what in X is rounding. The velocities v (n,) before the
    start hold those of massless nodes, which are no part of X.
    """
    none, nc, t = np.zeros(len(X)), len(system.degree), DoubleDouble.of(start)
    never, short = [DoubleDouble.of(-np.inf)] * nc, np.zeros(nc, dtype=np.int64)
    size, breakpoints = np.abs(X) if scale is None else scale, system.form.breakpoints(start, end)
    X = np.where(np.arange(len(X)) == system.form.constant, 1.0, X)
    next_event = (DoubleDouble.of(np.inf), none, DoubleDouble.of(X))
    motion = Motion(system, end, solver, max_events, next_event, breakpoints, size, never, short)
    _enter(motion, t, DoubleDouble.of(X), none, GIVEN_ZERO if scale is None else ZERO, v)
    return motion


def begin_problem(
    problem: Problem,
    method: str,
    end: float,
    solver: str = "auto",
    max_events: int = 100_000,
    dynamics: Dynamics | None = None,
) -> Motion:
    """Return the motion from the initial state of a problem, by its own dynamics unless others are given.

    Raises
    ------
    UnsupportedError
        If contacts have no common relative degree, or begin in a way that leaves their forces open.
    """
    problem, _ = enter_constraint(problem, solver)
    system = System(dynamics or problem.dynamics)
    refuse_mixed_degrees(system, method, except_schemes=True)
    q, v = problem.initial_coordinates, problem.initial_velocities
    try:
        return begin(system, system.state(q, v), end, 0.0, solver, max_events, v=v)
    except np.linalg.LinAlgError:
        raise UnsupportedError(
            f"some contacts or sliders of {problem.name!r} hold together at the start in a way that leaves their shares "
            f"undetermined, which {method!r} does not handle: take method='moreau-jean'"
        ) from None


def follow(motion: Motion, until: float) -> Status:
    """Find the segments that begin up to ``until``; a status other than SOLVED says why they end before."""
    while motion.next_event[0].hi <= until:
        segments, (t, c, X) = motion.segments, motion.next_event
        stalled = len(segments) > STALL and np.array_equal(segments[-STALL].start.parts, t.parts)
        passed = int(motion.breakpoints.searchsorted(t.hi))
        if len(segments) - passed > motion.max_events or stalled:
            return Status.MAX_EVENTS
        try:
            _enter(motion, t, X, c, FINE_ZERO)
        except Unresolved:
            return Status.ACCUMULATION
        except FailureError as failure:
            return Status(failure.result.status)
        except np.linalg.LinAlgError:
            return Status.SINGULAR
    return Status.SOLVED


def state_before(motion: Motion, t: float) -> Array:
    """Return the left limit of X at an instant of the last segment (N,)."""
    segment = motion.segments[-1]
    flow, _ = motion.system.reaction(segment.mode)
    return flow.move(segment.state, float(segment.since(np.asarray(t)))).hi


def _enter(motion: Motion, t: DoubleDouble, X: DoubleDouble, ended: Array, zero: float, v: Array | None = None) -> None:
    """Begin a segment at t: impacts, the mode, the events that this makes, and the next switch."""
    system, now = motion.system, float(t.hi)
    before = motion.segments[-1].mode if motion.segments else None
    motion.scale, left = np.maximum(motion.scale, np.abs(X.hi)), None
    if before is not None and not ended.any():
        # At a breakpoint the signals are floats anew, and so is what they decide.
        left, zero = settled(system, before, X, motion.scale), GIVEN_ZERO
        X = system.form.right_of(now, left, motion.scale)
    met: list[Event] = []
    state, together = X, _unresolved(motion, t, X) if left is None else None
    if together is not None:
        state, met = _collapse(motion, now, X, together)
    else:
        mode, after, events = enter(system, now, before, X, motion.scale, motion.solver, zero=zero, left=left, v=v)
        together = _accumulated(motion, t, events) if left is None else None
    if together is not None:
        mode, after, events = enter(
            system, now, before, state, motion.scale, motion.solver, zero=zero, together=together
        )
    motion.segments.append(Segment(t, (X if left is None else left).hi, after, mode, ended, (*met, *events)))

    flow, _ = system.reaction(mode)
    watch = system.watch(mode)
    later = int(motion.breakpoints.searchsorted(now, side="right"))
    stop = float(motion.breakpoints[later]) if later < len(motion.breakpoints) else np.inf
    end = motion.end * (1.0 + AT_END)
    horizon = min(stop, end) - now
    crossing = flow.first_crossing(after, motion.scale, watch.rows, watch.order, horizon, watch.entries)
    motion.scale = crossing.scale
    found = t + crossing.t
    if crossing.row >= 0 and found.hi <= end and found.hi < stop:
        when = found if found.hi <= motion.end else DoubleDouble.of(motion.end)
        motion.next_event = (when, watch.rows.hi[crossing.row], crossing.state)
    elif stop <= motion.end:
        length = DoubleDouble.of(stop) - t
        there = flow.move(after, float(length.hi), float(length.lo))
        motion.next_event = (DoubleDouble.of(stop), np.zeros(len(X)), there)
    else:
        motion.next_event = (DoubleDouble.of(np.inf), np.zeros(len(X)), crossing.state)


def _accumulated(motion: Motion, t: DoubleDouble, events: list[Event]) -> Flags | None:
    """Note the impacts at t, and return the rows whose impacts have accumulated (nc,), if any: they meet without end."""
    d, shortest, over = motion.system.dynamics, SHORT * abs(float(t.hi)), False
    hit = [event for event in events if event.impulse > 0.0]
    if hit:
        motion.history.append(tuple(motion.system.names[event.contact] for event in hit))
        for event in hit:
            i = motion.system.names[event.contact]
            last = motion.impacts[i]
            flight = (t.hi - last.hi) + (t.lo - last.lo)
            motion.short[i] = motion.short[i] + 1 if flight < shortest else 0
            motion.impacts[i] = t
            if motion.short[i] >= FLIGHTS and d.contacts[i].e < 1.0:
                speed = np.abs(motion.system.fine.CA.hi[i]) @ motion.scale
                over |= bool(abs(d.gap_rate(event.left.v)[i]) <= SLOW * speed)
    if not over:
        return None
    since = np.array([(t.hi - last.hi) + (t.lo - last.lo) for last in motion.impacts])
    together = (motion.short > 0) & (since < RECENT * shortest)
    motion.short[together] = 0
    return np.asarray(together)


def _unresolved(motion: Motion, t: DoubleDouble, X: DoubleDouble) -> Flags | None:
    """Return the rows whose impacts accumulate faster than double-doubles resolve (nc,), if there are any.

    Such a row has just bounced, and is so near to closed again that it cannot be said which plates meet next.
    """
    if not motion.history or motion.segments[-1].t0 < float(t.hi) * (1.0 - NEAR):
        return None
    system, before = motion.system, motion.segments[-1].mode
    u, U = gaps(system, X, motion.scale, still(system, before), FINE_ZERO)
    landing = (u.hi <= 0.0) & system.meets & ~np.isin(np.arange(len(u)), before.closed)
    if not (U.hi[landing] < 0.0).any() or landing.sum() < 2:
        return None
    recent = np.array([(t.hi - last.hi) + (t.lo - last.lo) < NEAR * abs(t.hi) for last in motion.impacts])
    last = motion.history[-1]
    if not any(recent[i] and i in last for i in np.flatnonzero(landing)):
        return None
    return np.asarray(np.isin(np.arange(len(u)), np.unique(np.concatenate(motion.history[-PATTERN:]))) & recent)


def _collapse(motion: Motion, t: float, X: DoubleDouble, rows: Flags) -> tuple[DoubleDouble, list[Event]]:
    """Return X and the impacts at t, where impacts of several bodies follow each other in a pattern without end.

    The impacts go on in the order in which they came, without time between them, until the plates meet at rest.

    Raises
    ------
    Unresolved
        If they came in no order that repeats, or do not come to rest in it.
    """
    system, history = motion.system, motion.history
    events: list[Event] = []
    periods = [p for p in range(2, PATTERN + 1) if len(history) >= 2 * p and history[-p:] == history[-2 * p : -p]]
    speed = np.abs(system.fine.CA.hi) @ motion.scale
    if periods:
        pattern, mode = history[-periods[0] :], motion.segments[-1].mode
        free = replace(mode, closed=tuple(i for i in mode.closed if not rows[i]))
        for k in range(MOST_IMPACTS):
            U = (system.fine.CA @ X).hi
            if (np.abs(U[rows]) <= SLOW * speed[rows]).all():
                return X, events
            among = np.isin(np.arange(len(rows)), pattern[k % len(pattern)])
            if not (U[among] < 0.0).all():
                break
            after, P, _ = impact(system, X, motion.scale, motion.solver, zero=FINE_ZERO, among=among)
            left, right = state_of(system, free, X), state_of(system, free, after)
            names = [contact.name for contact in system.dynamics.contacts]
            events += [Event(t, names[i], "impact", left, right, float(P[i])) for i in np.flatnonzero(P > 0.0)]
            X = after
    raise Unresolved


def segment_cuts(system: System, segment: Segment, end: float) -> Array:
    """Return times from the start of a segment, its end not included, between which it turns little.

    They are the windows of its flow. Where a stiff mode has more of them than `MOST_CUTS`, its fast parts decay soon, and
    the times spread out geometrically after the start.
    """
    windows = math.ceil((end - segment.t0) / system.mode(segment.mode)[0].window)
    if windows == 1:
        return np.array([segment.t0])
    if windows <= MOST_CUTS:
        return np.linspace(segment.t0, end, windows, endpoint=False)
    return segment.t0 + (end - segment.t0) * np.append(0.0, np.geomspace(1.0 / windows, 1.0, MOST_CUTS)[:-1])


def cuts(motion: Motion) -> Array:
    """Return times from the start to the end between which the motion is smooth and turns little (nk,)."""
    ends = [*(segment.t0 for segment in motion.segments[1:]), motion.end]
    found = [segment_cuts(motion.system, each, end) for each, end in zip(motion.segments, ends, strict=True)]
    return np.concatenate([*found, [motion.end]])


def read(system: System, segments: tuple[Segment, ...], t: Array, side: str) -> tuple[Array, Array, Array]:
    """Return q, v and r at the times t, which must be sorted; ``side`` tells which limit is meant at an event."""
    starts = np.array([segment.start.parts for segment in segments])
    owner = np.maximum(np.searchsorted(starts[:, 0], t, side="right" if side == "right" else "left") - 1, 0)
    since = (t - starts[owner, 0]) - starts[owner, 1]
    states = np.array([segment.state.parts for segment in segments])
    kinds: dict[object, int] = {}
    kind = np.array([kinds.setdefault(segment.mode.key, len(kinds)) for segment in segments], dtype=np.int64)
    n, nc = len(system.dynamics.nodes), len(system.degree)
    q, v, r = np.empty((len(t), n)), np.empty((len(t), n)), np.empty((len(t), nc))
    for each in np.unique(kind[owner]):
        mine, mode = np.flatnonzero(kind[owner] == each), segments[int(np.argmax(kind == each))].mode
        flow, _ = system.mode(mode)
        found = flow.read(states, since[mine], owner[mine], system.coordinates(mode).entries)
        q[mine], v[mine], r[mine] = parted(system, found)
    return q, v, r
