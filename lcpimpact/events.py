"""Where the contact mode changed, read off the steps of a method that does not locate events itself."""

from __future__ import annotations

import numpy as np

from lcpimpact.arrays import Array, Flags
from lcpimpact.integrators.base import Event, Record, State
from lcpimpact.scheme.dynamics import Dynamics


def events_of_steps(dynamics: Dynamics, record: Record) -> tuple[tuple[Event, ...], Flags]:
    """Return the closings, openings and impacts of a run, in the order of time, and which reactions are impulses.

    A closing is where the gap, an opening where the reaction, extrapolated from its last two positive values, reaches
    zero, within the step that it must lie in; limits are the neighbouring values on the grid. Where both sides of a contact
    have mass, the step that closes it holds an impact: its mean force is an impulse over h and belongs to the event.
    """
    impulsive = np.zeros(record.reaction.shape, dtype=bool)
    if len(record.t) < 2:
        return (), impulsive
    steps_of_force = len(record.t_reaction) < len(record.t)
    found: list[tuple[float, int, Event]] = []
    for i, contact in enumerate(dynamics.contacts):
        r = record.reaction[:, i]
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
                if contact.relative_degree == 2 and not before[j - 1]:
                    continue
            else:
                gaps = dynamics.gap(record.q[node - 1 : node + 1])[:, i]
                t = _zero(record.t[node - 1 : node + 1], gaps, record.t[node], record.t[last])
                kind = "impact" if contact.relative_degree == 2 else "close"
            impulse = 0.0
            if kind == "impact":
                impulse = float(r[j] * (record.t[last] - record.t[node]))
                impulsive[j, i] = True
            left = State(
                record.q[node], record.v[node], record.reaction[j - 1] if j > 0 else np.zeros(len(record.reaction[j]))
            )
            right = State(record.q[last], record.v[last], record.reaction[j])
            found.append((t, i, Event(t, contact.name, kind, left, right, impulse)))
    return tuple(event for _, _, event in sorted(found, key=lambda each: each[:2])), impulsive


def _zero(t: Array, values: Array, earliest: float, latest: float) -> float:
    """Return where the line through two falling values reaches zero, kept between ``earliest`` and ``latest``."""
    if len(t) < 2 or not values[0] > values[1]:
        return float(0.5 * (earliest + latest))
    crossing = t[1] + values[1] * (t[1] - t[0]) / (values[0] - values[1])
    return float(min(max(crossing, earliest), latest))
