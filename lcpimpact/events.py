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
    if len(record.t_reaction) < 2:
        return (), impulsive
    steps_of_force = len(record.t_reaction) < len(record.t)
    found: list[tuple[float, int, Event]] = []
    for i, contact in enumerate(dynamics.contacts):
        r = record.reaction[:, i]
        closed = r > 0.0
        # Plates that touch at the start are closed even where their force starts from zero.
        closed[0] |= closed[min(1, len(closed) - 1)] and dynamics.gap(record.q[0])[i] <= 0.0
        for j in map(int, np.flatnonzero(closed[1:] != closed[:-1])):
            # j is the last sample of the old mode: a node, or the step that begins there.
            node = j + 1 if steps_of_force else j
            last = min(node + 1, len(record.t) - 1)
            if closed[j]:
                t = _zero(
                    record.t_reaction[j - 1 : j + 1], r[j - 1 : j + 1], record.t_reaction[j], record.t_reaction[j + 1]
                )
                kind = "open"
                lasted = j > 0 and closed[j - 1]
                if contact.relative_degree == 2 and not lasted:
                    continue
            else:
                u = dynamics.gap(record.q[node - 1 : node + 1])[:, i]
                t = _zero(record.t[node - 1 : node + 1], u, record.t[node], record.t[last])
                kind = "impact" if contact.relative_degree == 2 else "close"
            impulse = 0.0
            if kind == "impact":
                impulse = float(r[j + 1] * (record.t[last] - record.t[node]))
                impulsive[j + 1, i] = True
            left = State(record.q[node], record.v[node], record.reaction[j])
            right = State(record.q[last], record.v[last], record.reaction[j + 1])
            found.append((t, i, Event(t, contact.name, kind, left, right, impulse)))
    return tuple(event for _, _, event in sorted(found, key=lambda each: each[:2])), impulsive


def _zero(t: Array, values: Array, earliest: float, latest: float) -> float:
    """Return where the line through two falling values reaches zero, kept between ``earliest`` and ``latest``."""
    if len(t) < 2 or not values[0] > values[1]:
        return float(0.5 * (earliest + latest))
    crossing = t[1] + values[1] * (t[1] - t[0]) / (values[0] - values[1])
    return float(min(max(crossing, earliest), latest))
