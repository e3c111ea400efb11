"""What every picture over time shares: curves broken at jumps, marks of the events, and times in contact."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes

from lcpimpact.arrays import Array
from lcpimpact.integrators.base import Event
from lcpimpact.plotting.style import INK, SOFT
from lcpimpact.trajectory import Trajectory

FINE = 2000
"""Points of a smooth curve: more than a page resolves."""

MANY = 12
"""From so many events on, they are marked but no longer named."""

WORDS = {"open": "opens", "close": "closes", "impact": "impact"}


def math(symbol: str) -> str:
    """Return a symbol as math text.

    Examples
    --------
    >>> math("k_o"), math("c_12"), math("mg")
    ('$k_o$', '$c_{12}$', '$mg$')
    """
    return "$" + re.sub(r"_(\w{2,})", r"_{\1}", symbol.replace("$", r"\$")) + "$"


def curves(trajectory: Trajectory) -> tuple[Array, Array, Array, Array]:
    """Return t, q, t_reaction and reaction to draw as lines, with a row of nan wherever a line must break.

    Between its events an exact run is sampled finely, each piece with its own one-sided limits; any other run is drawn
    as it was recorded.
    """
    if trajectory.dense is None or len(trajectory.t) < 2:
        return trajectory.t, trajectory.q, trajectory.t_reaction, trajectory.reaction
    start, end = trajectory.t[0], trajectory.t[-1]
    inner = {event.t for event in trajectory.events if start < event.t < end}
    cuts = [start, *sorted(inner), end]
    fine = np.union1d(trajectory.t, np.linspace(start, end, FINE + 1))
    pieces = [_piece(trajectory, fine, a, b) for a, b in pairwise(cuts)]
    t, q, r = (np.concatenate(parts)[:-1] for parts in zip(*pieces, strict=True))
    return t, q, t, r


def _piece(trajectory: Trajectory, fine: Array, a: float, b: float) -> tuple[Array, Array, Array]:
    t = np.concatenate([[a], fine[np.searchsorted(fine, a, "right") : np.searchsorted(fine, b)]])
    after, before = trajectory.sample(t, "right"), trajectory.sample(b, "left")
    rows = [
        np.vstack([right, left, np.full(right.shape[1], np.nan)])
        for right, left in ((after.q, before.q), (after.reaction, before.reaction))
    ]
    return np.append(t, [b, np.nan]), rows[0], rows[1]


def contact_intervals(trajectory: Trajectory, contact: str) -> list[tuple[float, float]]:
    """Return the times from each closing of a contact to its next opening."""
    switches = [event for event in trajectory.events if event.contact == contact and event.kind != "impact"]
    since = trajectory.t[0] if _starts_closed(trajectory, contact, switches) else None
    intervals = []
    for event in switches:
        if event.kind == "close":
            since = event.t
        elif since is not None:
            intervals.append((float(since), event.t))
            since = None
    if since is not None:
        intervals.append((float(since), float(trajectory.t[-1])))
    return intervals


def _starts_closed(trajectory: Trajectory, contact: str, switches: Sequence[Event]) -> bool:
    if switches:
        return switches[0].kind == "open"
    return bool((trajectory[contact] > 0.0).any())


def mark_events(axes: Sequence[Axes], events: Sequence[Event], *, named: bool = True) -> None:
    """Mark the events in panels that share a time axis and, if they are few, name them above the first panel."""
    if not events:
        return
    times = sorted({event.t for event in events})
    for ax in axes:
        # Many lines side by side would bury the curves, so they shrink to a rug along the axis.
        few = len(times) < MANY

        ax.vlines(
            times,
            0.0,
            1.0 if few else 0.04,
            transform=ax.get_xaxis_transform(),
            colors=SOFT,
            linewidths=0.7,
            linestyles="dashed" if few else "solid",
            zorder=1.5,
        )
    if named and len(times) < MANY:
        _name_events(axes[0], events)


def _name_events(ax: Axes, events: Sequence[Event]) -> None:
    several = len({event.contact for event in events}) > 1
    first, last = ax.get_xlim()
    taken = [-np.inf] * 3
    for t in sorted({event.t for event in events}):
        words = [(f"{math(e.contact)} " if several else "") + WORDS.get(e.kind, e.kind) for e in events if e.t == t]
        name = ", ".join(dict.fromkeys(words))
        # A name takes about 1/90 of the width a letter; where its neighbour stands too near it goes one line up.
        place, half = (t - first) / (last - first), len(name.replace("$", "")) / 180.0
        row = next((i for i, end in enumerate(taken) if place - half > end), None)
        if row is None:
            continue
        taken[row] = place + half
        ax.annotate(
            name,
            (place, 1.0),
            (0.0, 3.0 + 11.0 * row),
            xycoords="axes fraction",
            textcoords="offset points",
            ha="center",
            va="bottom",
            fontsize=8.5,
            color=INK,
            annotation_clip=False,
        )
