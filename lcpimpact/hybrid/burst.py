"""Impacts of several bodies in quick succession, followed in double-doubles.

Where impacts of several contacts accumulate, gaps fall below the rounding of positions while bodies still approach, and
floats do not determine the next impact. Before that, when two contacts have had impacts within a time that is short against
the flights of the run, methods with states in floats leave the motion to `lcpimpact.hybrid.motion`, which follows it to the
limit, or until the flights are long again. Its initial state has the rounding error of gaps that are still large.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from lcpimpact.arrays import Array, Indices
from lcpimpact.errors import Status
from lcpimpact.hybrid.event_loop import EventLoop, follow
from lcpimpact.hybrid.gaps import settled
from lcpimpact.hybrid.motion import HybridMotion, Segment, begin
from lcpimpact.hybrid.system import ZERO, Mode, System
from lcpimpact.numerics.double_double import DoubleDouble
from lcpimpact.numerics.rounding import EPS, TINY
from lcpimpact.problems.base import GIVEN_ZERO_RTOL

SHORT_FLIGHT_RTOL = 1e-6
"""Duration below which a flight is short, relative to the longest of the run."""


@dataclass
class ImpactHistory:
    """The last impact of each contact, and the longest time without an impact.

    Attributes
    ----------
    last : (nc,) array      the last impact of each row
    longest : float         longest time without an impact so far, in s
    latest : float          the last impact of all
    short : (nc,) array     number of consecutive short flights of each row before its last impact
    """

    last: Array
    short: Indices
    longest: float = 0.0
    latest: float = 0.0

    @classmethod
    def none(cls, contacts: int) -> ImpactHistory:
        """Return the history before any impact."""
        return cls(np.full(contacts, -np.inf), np.zeros(contacts, dtype=np.int64))

    def note(self, t: float, rows: Indices) -> None:
        """Record an impact of these rows at t."""
        self.longest = max(self.longest, t - self.latest)
        self.latest = t
        self.last[rows] = t

    def land(self, t: float, rows: Indices, short: float, low: Array) -> None:
        """Record an impact of these rows at t; a flight is short below ``short``, or below ``low`` of its row."""
        flight = t - self.last[rows]
        self.short[rows] = np.where((flight < short) | (flight < low), self.short[rows] + 1, 0)
        self.note(t, rows)

    def take(self, burst: HybridMotion) -> None:
        """Record the impacts of a burst; the counts of short flights start again."""
        self.short[:] = 0
        for event in burst.events:
            if event.impulse > 0.0 and burst.system.dynamics.impenetrable[burst.system.names[event.contact]]:
                self.last[burst.system.names[event.contact]] = self.latest = event.t

    def quick(
        self,
        system: System,
        t: float,
        rows: Indices,
        rates: Array,
        scale: Array,
        least: float = 0.0,
        *,
        gap_rtol: float = 1e8 * EPS,
        long_flight_rtol: float = 0.1,
    ) -> float:
        """Return the duration of a short flight, if impacts of these rows at t, at ``rates`` (nc,), follow others; else 0.

        A flight below ``least`` is short in any case.

        ``gap_rtol``: gap, relative to its terms, known to eight digits; flights too low for it are short, too.
        ``long_flight_rtol``: duration above which no flight is short, relative to the longest of the run.
        """
        others = self.last > -np.inf
        others[rows] = False
        if not len(rows) or not others.any():
            return 0.0
        rounding = gap_rtol * (np.abs(system.matrices[2][rows]) @ scale) / np.maximum(-rates[rows], TINY)
        short = max(
            least, SHORT_FLIGHT_RTOL * self.longest, min(float(rounding.min()), long_flight_rtol * self.longest)
        )
        return short if (t - self.last[others] < short).any() else 0.0


def follow_burst(
    run: EventLoop[System],
    system: System,
    t: float,
    X: DoubleDouble,
    mode: Mode,
    scale: Array,
    short: float,
    most: float = np.inf,
) -> tuple[Status, HybridMotion]:
    """Follow impacts from the state X (N,) after those at t in a mode, until a flight is longer than ``short``.

    They are followed to the end of the run, or for ``most`` seconds, and those that accumulate to their limit, however long
    it takes. The last segment of the motion continues in floats.
    """
    state = settled(system, mode, X, scale)
    # Zeros of these floats have their rounding error, and not that of a root.
    size = np.maximum(np.abs(X.hi), GIVEN_ZERO_RTOL / ZERO * scale)
    end = min(t + 2.0 * short, run.end)
    left = max(run.max_events - run.switches, 1)
    motion = begin(system, state.hi, end, t, run.solver, left, scale=size)
    motion.horizon = min(run.end, run.next_breakpoint(t), t + most)
    motion.scale = np.maximum(motion.scale, scale)
    status = Status.SOLVED
    while status is Status.SOLVED and (following := _next(motion)) - motion.segments[-1].t0 <= min(short, most):
        if following - t > most:
            break
        # The next flight is followed for as long as it may be short.
        motion.end = min(following + 2.0 * short, run.end)
        motion.breakpoints = system.form.breakpoints(t, motion.end)
        status = follow(motion, following)
    return status, motion


def passed(motion: HybridMotion) -> list[tuple[Segment, float]]:
    """Return the segments before the last, with their ends, that last longer than the rounding of time."""
    return [(each, after.t0) for each, after in pairwise(motion.segments) if after.t0 > each.t0]


def _next(motion: HybridMotion) -> float:
    """Return the instant of the next event, or inf if it is a breakpoint of the signals."""
    when, row, _ = motion.next_event
    return float(when.hi) if row.any() else np.inf
