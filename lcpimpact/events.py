"""Where the contact mode changed, read off the steps of a method that does not locate events itself."""

from __future__ import annotations

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.integrators.base import Event, Record, State
from lcpimpact.scheme.dynamics import Dynamics


def events_of_steps(dynamics: Dynamics, record: Record) -> tuple[Event, ...]:
    """Return the closings, openings and impacts of a run, in the order of time.

    A closing is where the gap, an opening where the reaction, extrapolated from its last two positive values, reaches
    zero, within the step that it must lie in; limits are the neighbouring values on the grid.
    """
    steps_of_force = len(record.t_reaction) < len(record.t)
    u = dynamics.gap(record.q)
    found: list[tuple[float, int, Event]] = []
    for i, contact in enumerate(dynamics.contacts):
        r = record.reaction[:, i]
        closed = r > 0.0
        # Plates that touch at the start are closed even where their force starts from zero.
        closed[0] |= closed[min(1, len(closed) - 1)] and u[0, i] <= 0.0
        for j in np.flatnonzero(closed[1:] != closed[:-1]):
            # j is the last sample of the old mode: a node, or the step that begins there.
            node = j + 1 if steps_of_force else j
            if closed[j]:
                t = _zero(record.t_reaction, r, j, record.t_reaction[j + 1])
                kind = "open"
                lasted = j > 0 and closed[j - 1]
                if contact.relative_degree == 2 and not lasted:
                    continue
            else:
                t = _zero(record.t, u[:, i], node, record.t[min(node + 1, len(record.t) - 1)])
                kind = "impact" if contact.relative_degree == 2 else "close"
            last = min(node + 1, len(record.t) - 1)
            impulse = 0.0
            if kind == "impact":
                impulse = float(r[j + 1] * (record.t[last] - record.t[node]))
            left = State(record.q[node], record.v[node], record.reaction[j])
            right = State(record.q[last], record.v[last], record.reaction[j + 1])
            found.append((t, i, Event(t, contact.name, kind, left, right, impulse)))
    return tuple(event for _, _, event in sorted(found, key=lambda each: each[:2]))


def _zero(t: Array, values: Array, j: int, latest: float) -> float:
    """Return where the line through samples j - 1 and j reaches zero, kept between t[j] and ``latest``."""
    earliest = float(t[j])
    if j == 0 or not values[j - 1] > values[j]:
        return 0.5 * (earliest + float(latest))
    slope = (values[j] - values[j - 1]) / (t[j] - t[j - 1])
    return float(min(max(earliest - values[j] / slope, earliest), float(latest)))
