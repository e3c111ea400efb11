"""The exact motion of a linear system as a chain of segments, each a mode with the state that it begins from.

`lcpimpact.integrators.exact` samples it on a grid; the studies of periodic orbits follow it without one, and
`lcpimpact.integrators.tangent` differentiates it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import FailureError, Status, UnsupportedError
from lcpimpact.integrators.base import Event
from lcpimpact.integrators.modes import Mode, System, refuse_mixed_degrees
from lcpimpact.integrators.transition import coordinates, enter
from lcpimpact.problems.base import Problem
from lcpimpact.scheme.dynamics import Dynamics

MOST_CUTS = 4_000
"""So many instants show a segment well enough for its scale and its balance of energy."""

STALL = 100
"""So many events at one instant are no motion: the run ends as if it had reached max_events."""


@dataclass(frozen=True, eq=False)
class Segment:
    """One mode from t0 on: X(t) = exp(A (t - t0)) X.

    Attributes
    ----------
    t0 : float              the instant at which it begins, in s
    before : (N,) array     the left limit of the state there; of the first segment what it was given
    X : (N,) array          the right limit
    mode : Mode             what each row does
    ended : (N,) array      the row c of the segment before whose fall through zero began this one; of the first, zero
    events : tuple          what happened at t0
    """

    t0: float
    before: Array
    X: Array
    mode: Mode
    ended: Array
    events: tuple[Event, ...]


@dataclass(eq=False)
class Motion:
    """What travels along the motion: the segments found so far, and the next event (inf: none before the end).

    Attributes
    ----------
    system : System
    end : float                     the instant to which events are looked for, in s
    solver : str                    name of an LCP solver
    max_events : int
    next_event : (float, array)     when it is, and the row that falls through zero
    scale : (N,) array              largest |X| so far, to which rounding is relative
    segments : list of Segment
    """

    system: System
    end: float
    solver: str
    max_events: int
    next_event: tuple[float, Array]
    scale: Array
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
) -> Motion:
    """Return the motion from the state X (N,) at ``start``, where impacts come first and the mode is chosen.

    Where X was itself found by a motion, its ``scale`` says what in X is rounding.
    """
    none = np.zeros(len(X))
    motion = Motion(system, end, solver, max_events, (np.inf, none), np.abs(X) if scale is None else scale)
    _enter(motion, start, X, none)
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
    system = System(dynamics or problem.dynamics)
    refuse_mixed_degrees(system)
    try:
        X = system.state(problem.initial_coordinates, problem.initial_velocities)
        return begin(system, X, end, 0.0, solver, max_events)
    except np.linalg.LinAlgError:
        raise UnsupportedError(
            f"some contacts or sliders of {problem.name!r} hold together at the start in a way that leaves their shares "
            f"undetermined, which {method!r} does not handle: take method='moreau-jean'"
        ) from None


def follow(motion: Motion, until: float) -> Status:
    """Find the segments that begin up to ``until``; a status other than SOLVED says why they end before."""
    while motion.next_event[0] <= until:
        segments, (t, c) = motion.segments, motion.next_event
        stalled = len(segments) > STALL and segments[-STALL].t0 == t
        if len(segments) > motion.max_events or stalled:
            return Status.MAX_EVENTS
        try:
            _enter(motion, t, state_before(motion, t), c)
        except FailureError as failure:
            return Status(failure.result.status)
        except np.linalg.LinAlgError:
            return Status.SINGULAR
    return Status.SOLVED


def state_before(motion: Motion, t: float) -> Array:
    """Return the left limit of X at an instant of the last segment (N,)."""
    segment = motion.segments[-1]
    flow, _ = motion.system.mode(segment.mode)
    return np.asarray(flow.at(segment.X, np.array([t - segment.t0]))[0])


def _enter(motion: Motion, t: float, X: Array, ended: Array) -> None:
    """Begin a segment at t: impacts, the mode, the events that this makes, and the next switch."""
    system = motion.system
    before = motion.segments[-1].mode if motion.segments else None
    motion.scale = np.maximum(motion.scale, np.abs(X))
    mode, after, events = enter(system, t, before, X, motion.scale, motion.solver)
    flow, _ = system.mode(mode)
    new = Segment(t, X, after, mode, ended, tuple(events))
    motion.segments.append(new)

    watched = system.watched(mode)
    rows = np.array([row for _, row, _ in watched])
    order = np.array([zeros for _, _, zeros in watched], dtype=np.int64)
    crossing = flow.first_crossing(after, motion.scale, rows, order, motion.end - t) if watched else None
    motion.next_event = (t + crossing[0], rows[crossing[1]]) if crossing else (np.inf, np.zeros(len(X)))
    last = min(motion.next_event[0], motion.end)
    # The end of the segment counts when the next one begins.
    windows = max(1, math.ceil((last - t) / flow.window))
    few = windows <= MOST_CUTS
    seen = flow.windows(after, windows) if few else flow.at(after, segment_cuts(system, new, last) - t)
    motion.scale = np.maximum(motion.scale, np.abs(seen).max(axis=0))


def segment_cuts(system: System, segment: Segment, end: float) -> Array:
    """Return times from the start of a segment, its end not included, between which it turns little.

    They are the windows of its flow. Where a stiff mode has more of them than `MOST_CUTS`, its fast parts decay soon, and
    the times spread out geometrically after the start.
    """
    windows = math.ceil((end - segment.t0) / system.mode(segment.mode)[0].window)
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
    starts = np.array([segment.t0 for segment in segments])
    owner = np.maximum(np.searchsorted(starts, t, side="right" if side == "right" else "left") - 1, 0)
    n, nc = len(system.dynamics.nodes), len(system.degree)
    q, v, r = np.empty((len(t), n)), np.empty((len(t), n)), np.empty((len(t), nc))
    for k in np.unique(owner):
        segment, mine = segments[k], owner == k
        flow, _ = system.mode(segment.mode)
        q[mine], v[mine], r[mine] = coordinates(system, segment.mode, flow.at(segment.X, t[mine] - segment.t0))
    return q, v, r
