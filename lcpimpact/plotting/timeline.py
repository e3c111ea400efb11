"""Common parts of plots over time: curves broken at jumps, event marks, and contact intervals."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import numpy as np
from matplotlib.axes import Axes

from lcpimpact.arrays import Array
from lcpimpact.plotting.style import CURVE_POINTS, GREY, INK
from lcpimpact.problems.base import Problem
from lcpimpact.record import Event
from lcpimpact.scheme.elements.base import Element
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.scheme.system import LinearComplementaritySystem
from lcpimpact.trajectory import Trajectory

MAX_NAMED_EVENTS = 12
"""Maximum number of events that are labelled; more are only marked."""

FORMULA = re.compile(r"([^\W_](_[^\W_]+)?|[ ()+=,.'-])+")
"""Letters with or without a subscript, and the operators between them."""

WORDS = {
    "open": "opens",
    "close": "closes",
    "impact": "impact",
    "stick": "sticks",
    "slip": "slips",
    "slide": "slides",
    "switch": "switches",
    "jam": "jams",
}


def plain_text(text: str) -> str:
    r"""Return external text, such as the name of a problem, with every $ escaped.

    Examples
    --------
    >>> plain_text("5 $ and a_b")
    '5 \\$ and a_b'
    """
    return text.replace("$", r"\$")


def math_text(symbol: str) -> str:
    """Return a symbol as math text, or unchanged if it is not a formula.

    Examples
    --------
    >>> math_text("k_o"), math_text("c_12"), math_text("x1"), math_text("mg")
    ('$k_o$', '$c_{12}$', '$x_1$', '$mg$')
    """
    symbol = plain_text(symbol)
    if not FORMULA.fullmatch(symbol):
        return symbol
    # A letter and a number behind it are a symbol with its index, x1 as well as x_1.
    symbol = re.sub(r"\b([^\W\d_])(\d+)\b", r"\1_\2", symbol)
    return "$" + re.sub(r"_(\w{2,})", r"_{\1}", symbol).replace(" ", r"\ ") + "$"


def axis_label(symbol: str, unit: str) -> str:
    """Return the label of an axis: what is drawn, and its unit.

    Examples
    --------
    >>> axis_label("$x$", "m"), axis_label("$x$", "")
    ('$x$ [m]', '$x$ (dimensionless)')
    """
    return f"{symbol} [{plain_text(unit)}]" if unit else f"{symbol} (dimensionless)"


def coordinates_label(problem: Problem, nodes: Iterable[str], what: str = "coordinates") -> str:
    """Return the label of an axis that coordinates share, with their units."""
    if isinstance(problem.scheme, LinearComplementaritySystem):
        return what.replace("coordinates", "states")
    return axis_label(what, ", ".join(dict.fromkeys(map(problem.unit, nodes))))


def impulse_label(problem: Problem) -> str:
    """Return the label of an axis of impulses."""
    unit = problem.own_unit("N s")
    return axis_label("impulse", unit) if unit else "impulse\n(dimensionless)"


def shown_nodes(trajectory: Trajectory) -> list[int]:
    """Return the coordinates to draw, without the internal nodes of elements."""
    nodes = trajectory.nodes
    inner = {node for element in _elements(trajectory) for node in element.inner}
    return [i for i, node in enumerate(nodes) if node not in inner] or list(range(len(nodes)))


def shown_forces(trajectory: Trajectory) -> list[int]:
    """Return the forces to draw, without those inside an element drawn as one symbol."""
    inner = {node for e in _elements(trajectory) if e in e.drawn() for node in e.inner}
    return [i for i, each in enumerate(trajectory.rows) if not {each.upper, each.lower} & inner]


def shown_events(trajectory: Trajectory) -> list[Event]:
    """Return the events of the forces to draw."""
    forces = trajectory.rows
    names = {forces[i].name for i in shown_forces(trajectory)}
    return [event for event in trajectory.events if event.contact in names]


def _elements(trajectory: Trajectory) -> Sequence[Element]:
    scheme = trajectory.problem.scheme
    return scheme.elements if isinstance(scheme, Scheme) else ()


def curves(trajectory: Trajectory) -> tuple[Array, Array, Array, Array]:
    """Return t, q, t_reaction and the forces to draw as lines, with a row of nan at each break.

    An exact run is sampled finely between its events, with one-sided limits; any other run is drawn as recorded.
    """
    if trajectory.dense is None or len(trajectory.t) < 2:
        return trajectory.t, trajectory.q, trajectory.t_reaction, trajectory.forces
    start, end = trajectory.t[0], trajectory.t[-1]
    inner = np.unique([event.t for event in trajectory.events if start < event.t < end])
    fine = np.union1d(trajectory.t, np.linspace(start, end, CURVE_POINTS + 1))
    begins = np.union1d(inner, fine[:-1])
    ends = np.append(inner, end)
    after = trajectory.sample(begins, "right")
    before = trajectory.sample(ends, "left")
    d = trajectory.problem.dynamics
    forces = (np.hstack([each.reaction, d.push(each.q, each.v)]) for each in (before, after))

    # An event contributes the left limit, a break, and the right limit, in this order.
    t = np.concatenate([ends, inner, begins])
    order = np.lexsort((np.repeat([0, 1, 2], [len(ends), len(inner), len(begins)]), t))
    q, force = (
        np.vstack([left, np.full((len(inner), left.shape[1]), np.nan), right])[order]
        for left, right in ((before.q, after.q), forces)
    )
    return t[order], q, t[order], force


def contact_intervals(trajectory: Trajectory, contact: str) -> list[tuple[float, float]]:
    """Return the times from each closing of a contact to its next opening."""
    switches = [event for event in trajectory.events if event.contact == contact and event.kind in ("close", "open")]
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
    return bool((trajectory[contact][-1:] > 0.0).any())


def mark_events(axes: Sequence[Axes], events: Sequence[Event]) -> None:
    """Mark the events in panels that share a time axis and, if they are few, name them above the first panel."""
    if not events:
        return
    times = sorted({event.t for event in events})
    few = len(times) < MAX_NAMED_EVENTS
    for ax in axes:
        # Many lines would hide the curves, so they shrink to ticks along the axis.
        ax.vlines(
            times,
            0.0,
            1.0 if few else 0.04,
            transform=ax.get_xaxis_transform(),
            colors=GREY,
            linewidths=0.7,
            linestyles="dashed" if few else "solid",
            zorder=1.5,
        )
    if few:
        _name_events(axes[0], events)


def _name_events(ax: Axes, events: Sequence[Event]) -> None:
    several = len({event.contact for event in events}) > 1
    one_kind = len({event.kind for event in events}) == 1
    first, last = ax.get_xlim()
    row_ends, row_names = [-np.inf] * 3, [""] * 3
    for t in sorted({event.t for event in events}):
        together: dict[str, list[str]] = {}
        for event in (event for event in events if event.t == t):
            together.setdefault(WORDS.get(event.kind, event.kind), []).append(math_text(event.contact))
        words = [f"{', '.join(dict.fromkeys(names))} {word}" if several else word for word, names in together.items()]
        name = ", ".join(words)
        if several and one_kind and np.isfinite(row_ends[0]):
            # Where all events are of one kind, the first label says which.
            name = name.rpartition(" ")[0]
        # A letter is about 1/90 of the width; a name too near its neighbour goes one line up.
        place = (t - first) / (last - first)
        half = len(name.replace("$", "")) / 180.0
        if row_names[0] == name and place - half <= row_ends[0]:
            continue
        row = next((i for i, end in enumerate(row_ends) if place - half > end), None)
        if row is None:
            continue
        row_ends[row], row_names[row] = place + half, name
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
