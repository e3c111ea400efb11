"""Pairing of the events of two runs, within the accuracy of their times."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from lcpimpact.record import Event

CLOSED_AFTER = {"close": True, "stick": True, "open": False, "slip": False, "slide": True, "switch": False}
"""Whether a contact is closed, a slider sticks or a relay slides, after an event; undetermined after an impact."""


@dataclass(frozen=True)
class Pairing:
    """Differences between the events of two runs.

    Attributes
    ----------
    time : float            largest time difference of corresponding events, in s
    impulse : float         largest difference of impulses, in N s; a missing impact has zero impulse
    missing : tuple of str  descriptions of events missing in one run
    """

    time: float
    impulse: float
    missing: tuple[str, ...]


def pair_events(a: Sequence[Event], b: Sequence[Event], window: float, end: float, least: float) -> Pairing:
    """Compare the events of two runs, contact by contact.

    Events of one contact within ``window`` of each other form a group, whose internal order is not resolved. A group with
    one event from each run must agree in kind; a larger one in the sum of its impulses and in the contact state after it; a
    group with events from one run only is missing in the other, unless its impulses are too small to be resolved.

    Parameters
    ----------
    a, b : sequence of Event
        In order of time.
    window : float
        Maximum time difference of corresponding events, in s.
    end : float
        End of the runs in s; an event within ``window`` of it may be missing in one of them, and so may one that is no
        impact near the start, where the first mode begins with it.
    least : float
        Resolution of impulses, in N s.

    Examples
    --------
    >>> from lcpimpact import load_problem, simulate
    >>> ball = load_problem("bouncing-ball")
    >>> events = simulate(ball, "exact", dt=0.1, t_end=1.0).events
    >>> pair_events(events, events[:-1], 1e-9, 1.0, 0.0).missing
    ('an impact of R at t = 0.451524 s',)
    """
    time = 0.0
    impulse = 0.0
    missing = []
    for mine, others in _groups(a, b, window):
        # An event near the end may lie beyond it in the other run, and one near the start before it.
        sure = [
            [event for event in events if event.t <= end - window and (event.t > window or event.kind == "impact")]
            for events in (mine, others)
        ]
        at_ends = len(sure[0]) + len(sure[1]) < len(mine) + len(others)
        apart = min(abs(_impulse(p) - _impulse(q)) for p in (mine, sure[0]) for q in (others, sure[1]))
        impulse = max(impulse, apart)
        if not mine or not others:
            lone = sure[0] or sure[1]
            if any(event.kind != "impact" for event in lone) or (lone and apart > least):
                missing.append(_in_words(lone))
            continue
        if at_ends:
            continue
        if len(mine) == len(others) == 1:
            time = max(time, abs(mine[0].t - others[0].t))
        kinds = {mine[0].kind, others[0].kind} if len(mine) == len(others) == 1 else set()
        after = {CLOSED_AFTER.get(mine[-1].kind), CLOSED_AFTER.get(others[-1].kind)}
        if after == {True, False} or (len(kinds) == 2 and "impact" not in kinds):
            missing.append(f"{_in_words(mine)}, which is {_in_words(others)} in the other")
    return Pairing(time, impulse, tuple(missing))


def farthest(a: Sequence[Event], b: Sequence[Event], end: float, *, end_rtol: float = 1e-7) -> float:
    """Return the largest distance in s from an event of either run to the nearest of the same contact in the other.

    Infinite if a contact has events in one run only. An event at ``end`` may be missing in the other run.

    ``end_rtol``: distance of an event from the end, relative to the duration, within which another run may not
    contain it.
    """
    found = 0.0
    for some, others in ((a, b), (b, a)):
        for event in some:
            if event.t >= end * (1.0 - end_rtol):
                continue
            there = (abs(event.t - other.t) for other in others if other.contact == event.contact)
            found = max(found, min(there, default=math.inf))
    return found


def _groups(a: Sequence[Event], b: Sequence[Event], window: float) -> Iterator[tuple[list[Event], list[Event]]]:
    """Yield groups of neighbouring events of both runs."""
    both = sorted([(e.contact, e.t, 0, e) for e in a] + [(e.contact, e.t, 1, e) for e in b], key=lambda each: each[:3])
    group: tuple[list[Event], list[Event]] = ([], [])
    last = ("", -math.inf)
    for contact, t, run, event in both:
        if contact != last[0] or t - last[1] > window:
            if group[0] or group[1]:
                yield group
            group = ([], [])
        group[run].append(event)
        last = contact, t
    if group[0] or group[1]:
        yield group


def _impulse(events: Sequence[Event]) -> float:
    return float(sum(event.impulse for event in events))


def _in_words(events: Sequence[Event]) -> str:
    first = events[0]
    article = "an" if first.kind[0] in "aeiou" else "a"
    what = {"close": "closing", "open": "opening"}.get(first.kind, first.kind)
    more = f" and {len(events) - 1} more by t = {events[-1].t:.6g} s" if len(events) > 1 else ""
    return f"{article} {what} of {first.contact} at t = {first.t:.6g} s{more}"
