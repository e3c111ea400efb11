"""Where the contact mode changed, read off the steps of a method that does not locate events itself."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lcpimpact.arrays import Array, Flags
from lcpimpact.integrators.base import SLIPS, Event, Record, State
from lcpimpact.scheme.dynamics import Contact, Dynamics


def events_of_steps(dynamics: Dynamics, record: Record, impact_steps: int = 1) -> tuple[tuple[Event, ...], Flags]:
    """Return the changes of the contact mode in a run, in the order of time, and which reactions are impulses.

    A closing is where the gap, an opening where the reaction, extrapolated from its last two positive values, reaches
    zero, within the step that it must lie in; limits are the neighbouring values on the grid. Where both sides of a contact
    have mass, the step that closes it, or the first ``impact_steps`` of them, holds an impact: its mean force is an impulse
    over h and belongs to the event.
    """
    impulsive = np.zeros(record.reaction.shape, dtype=bool)
    if len(record.t) < 2:
        return (), impulsive
    steps_of_force = len(record.t_reaction) < len(record.t)
    found: list[tuple[float, int, Event]] = []
    for i, contact in enumerate(dynamics.contacts):
        r = record.reaction[:, i]
        if contact.r0 is not None:
            found += [(event.t, i, event) for event in _friction_events(contact, i, record)]
            continue
        closed = r > 0.0
        before = np.append(closed[0], closed[:-1])
        u, U = dynamics.gap(record.q[0])[i], dynamics.gap_rate(record.v[0])[i]
        if steps_of_force:
            # The first step closes a contact that is open, or that meets with both sides massive, when it begins.
            before[0] &= u <= 0.0 and (contact.relative_degree < 2 or U >= 0.0)
        elif u <= 0.0 and closed[1]:
            # Plates that touch at the start are closed even where their force starts from zero.
            before[1] = closed[0] = True
        for j in map(int, np.flatnonzero(closed != before)):
            # j is the first sample of the new mode: a node, or the step that begins there; the switch is after ``node``.
            node = j if steps_of_force else j - 1
            last = min(node + 1, len(record.t) - 1)
            if before[j]:
                t = _zero(record.t_reaction[j - 2 : j], r[j - 2 : j], record.t_reaction[j - 1], record.t_reaction[j])
                kind = "open"
                if contact.relative_degree == 2 and not before[max(j - impact_steps, 0) : j].all():
                    continue
            else:
                # Where D r counts in u, the gaps of the grid say nothing.
                gaps = dynamics.gap(record.q[node - 1 : node + 1])[:, i] if not dynamics.D[i].any() else np.zeros(0)
                t = _zero(record.t[node - 1 : node + 1], gaps, record.t[node], record.t[last])
                kind = "impact" if contact.relative_degree == 2 else "close"
            impulse = 0.0
            if kind == "impact":
                impulse = float(r[j : j + impact_steps].sum() * (record.t[last] - record.t[node]))
                impulsive[j : j + impact_steps, i] = True
            left = State(
                record.q[node], record.v[node], record.reaction[j - 1] if j > 0 else np.zeros(len(record.reaction[j]))
            )
            right = State(record.q[last], record.v[last], record.reaction[j])
            found.append((t, i, Event(t, contact.name, kind, left, right, impulse)))
    return tuple(event for _, _, event in sorted(found, key=lambda each: each[:2])), impulsive


def _friction_events(contact: Contact, i: int, record: Record) -> Iterator[Event]:
    """Yield where a slider stops and where it begins to slip, or to slip the other way: between two forces on both sides."""
    r, t = record.reaction[:, i], record.t_reaction
    assert contact.r0 is not None
    side = np.where(np.abs(r) < contact.r0 * (1.0 - SLIPS), 0.0, np.sign(r))
    # A slider that turns is between its thresholds for one step; it does not stop.
    turning = 1 + np.flatnonzero((side[1:-1] == 0.0) & (side[:-2] * side[2:] < 0.0))
    side[turning] = side[turning + 1]
    for j in map(int, np.flatnonzero(np.diff(side)) + 1):
        before, after = np.searchsorted(record.t, t[j - 1], side="right") - 1, np.searchsorted(record.t, t[j])
        left = State(record.q[before], record.v[before], record.reaction[j - 1])
        right = State(record.q[after], record.v[after], record.reaction[j])
        kind = "stick" if side[j] == 0.0 else "slip"
        yield Event(float(0.5 * (t[j - 1] + t[j])), contact.name, kind, left, right)


def _zero(t: Array, values: Array, earliest: float, latest: float) -> float:
    """Return where the line through two falling values reaches zero, kept between ``earliest`` and ``latest``."""
    if len(values) < 2 or not values[0] > values[1]:
        return float(0.5 * (earliest + latest))
    crossing = t[1] + values[1] * (t[1] - t[0]) / (values[0] - values[1])
    return float(min(max(crossing, earliest), latest))
