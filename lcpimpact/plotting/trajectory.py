"""The plot of one run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from textwrap import wrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.typing import LineStyleType

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.integrators import METHODS
from lcpimpact.plotting.style import PALETTE, Drawing, Look, save, style
from lcpimpact.plotting.timeline import (
    MAX_NAMED_EVENTS,
    axis_label,
    curves,
    impulse_label,
    mark_events,
    math_text,
    plain_text,
    shown_events,
    shown_forces,
    shown_nodes,
)
from lcpimpact.plotting.vertical import CoordinateAxis, axes_of
from lcpimpact.record import Event
from lcpimpact.scheme.structure import Contact
from lcpimpact.scheme.system import LinearComplementaritySystem
from lcpimpact.trajectory import Trajectory

DASHES: tuple[LineStyleType, ...] = ("-", (0, (5, 3)), (0, (1.2, 1.8)), (0, (6, 2, 1.2, 2)))
"""Line styles of the curves of a panel, in turn."""


@dataclass(frozen=True, eq=False)
class Panel:
    """Curves that share an axis.

    Attributes
    ----------
    label : str                 label of the axis
    names : tuple of str        names of the curves
    t : (nt,) array             time in s
    values : (nt, n) array      values, with rows of nan at breaks
    axis : CoordinateAxis, optional       the coordinates that it shows
    largest : float             largest of all coordinates of the run
    """

    label: str
    names: tuple[str, ...]
    t: Array
    values: Array
    axis: CoordinateAxis | None = None
    largest: float = 0.0


@style()
@checked
def plot_trajectory(trajectory: Trajectory, path: str | Path | None = None, *, up: bool = False) -> Figure:
    """Draw coordinates over time, with forces and, if there are impacts, impulses below; mark the events.

    Coordinates of one unit and direction share a panel, whose axis is inverted where they point downwards, as in the drawing
    of the scheme; resting surfaces that bodies meet are hatched (`lcpimpact.plotting.vertical`). Nodes and forces inside an
    element drawn as one symbol, such as a `Bar`, and purely impulsive reactions are omitted.

    Parameters
    ----------
    trajectory : Trajectory
        Any run; one that ended early is drawn up to its end.
    path : str or Path, optional
        A file ending in .png, .svg or .pdf to write.
    up : bool
        Whether coordinates that point downwards are drawn as heights above the floor, or where there is none above zero.

    Raises
    ------
    InputError
        For another ending, or a folder that cannot be written.

    Examples
    --------
    >>> from lcpimpact import load_problem, simulate
    >>> figure = plot_trajectory(simulate(load_problem("bouncing-ball"), "exact", dt=1e-2, t_end=1.0))
    >>> [ax.get_ylabel() for ax in figure.axes]
    ['$x$ [m], downwards', 'impulse [N s]']
    """
    contents = panels(trajectory, up=up)
    events = shown_events(trajectory)
    impacts = any(event.impulse > 0.0 for event in events)
    heights = [3.0, *[2.0] * (len(contents) - 1), *[1.2] * impacts]
    figure = Drawing(figsize=(7.0, 0.9 + sum(heights)), layout="constrained")
    axes = list(figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0])
    for ax, panel in zip(axes, contents, strict=False):
        draw_panel(ax, panel)
    if impacts:
        _draw_impulses(axes[-1], events, force_names(trajectory), impulse_label(trajectory.problem))

    axes[0].set_xlim(*_span(trajectory.t))
    axes[-1].set_xlabel(axis_label("$t$", trajectory.problem.unit("t")))
    mark_events(axes, events)
    figure.suptitle(title_of(trajectory), x=0.01, ha="left", fontsize=10.0)
    if caption := caption_of(trajectory):
        figure.supxlabel(caption, x=0.01, ha="left", fontsize=8.0)
    if path is not None:
        save(figure, path)
    return figure


def panels(trajectory: Trajectory, *, up: bool = False) -> list[Panel]:
    """Return the panels of a run: its coordinates, and its forces unless there are none or only impulses."""
    rows = trajectory.rows
    t, q, t_force, force = curves(trajectory)
    nodes = shown_nodes(trajectory)
    forces = shown_forces(trajectory)
    given = isinstance(trajectory.problem.scheme, LinearComplementaritySystem)
    problem = trajectory.problem
    found = []
    largest = float(np.nanmax(np.abs(q[:, nodes]), initial=0.0))
    for axis in axes_of(problem, [trajectory.nodes[i] for i in nodes], up=up):
        columns = [trajectory.nodes.index(node) for node in axis.nodes]
        found.append(Panel(axis.label, axis.nodes, t, axis.values(q[:, columns]), axis, largest))
    impulsive = any(event.impulse > 0.0 for event in shown_events(trajectory))
    if forces and not (impulsive and not np.nan_to_num(force[:, forces]).any()):
        unilateral = any(isinstance(each := rows[i], Contact) and each.impenetrable for i in forces)
        label = "multipliers" if given else "reaction" if unilateral else "force"
        if len(trajectory.t_reaction) < len(trajectory.t):
            label = f"mean {label} of a step"
        label = label if given else axis_label(label, problem.unit(rows[forces[0]].name))
        found.append(Panel(label, force_names(trajectory), t_force, force[:, forces]))
    return found


def force_names(trajectory: Trajectory) -> tuple[str, ...]:
    """Return the names of the forces to draw."""
    return tuple(trajectory.rows[i].name for i in shown_forces(trajectory))


def draw_panel(ax: Axes, panel: Panel, *, faint: bool = False) -> None:
    """Draw the curves of a panel, with their names beside it."""
    n = len(panel.names)
    for i, (name, column) in enumerate(zip(panel.names, panel.values.T, strict=True)):
        # Later curves are narrower and broken, so that coincident curves are all visible.
        look: Look = {"linewidth": 1.4 + 0.8 * max(0, min(n, 4) - 1 - i), "alpha": 0.25 if faint else 1.0}
        if n <= len(PALETTE):
            look["linestyle"] = DASHES[i % len(DASHES)]
        ax.plot(panel.t, column, label=math_text(name), **look)
    ax.set_ylabel(panel.label)
    _name_lines(ax)
    if panel.axis is not None:
        panel.axis.orient(ax, panel.largest)


def title_of(trajectory: Trajectory) -> str:
    """Return the title of a plot."""
    title = plain_text(f"{trajectory.problem.name} by {_method(trajectory.method)}")
    if not trajectory.success:
        title += f": {trajectory.status.name.lower().replace('_', '-')} at t = {trajectory.t[-1]:g} s"
    if (events := len(shown_events(trajectory))) >= MAX_NAMED_EVENTS:
        title += f", {events} events"
    return title


def caption_of(trajectory: Trajectory, *, caption_length: int = 110) -> str:
    """Return the caption of a plot: the estimated error, where it is known or quick.

    ``caption_length``: maximum number of characters in a line of the caption.
    """
    error = trajectory.quick_error() if trajectory.estimates else None
    if error is None or not error.known:
        return ""
    text = f"error: {error.lines(trajectory.problem.unit)[0]}"
    text = f"{text}; {error.remark}" if error.coarse else text
    return "\n".join(wrap(plain_text(text), caption_length))


def _method(method: str) -> str:
    """Return the name of a method with its non-default options."""
    name, _, options = method.removesuffix(")").partition("(")
    known = METHODS.get(name)
    usual = {"lcp_solver=auto"} | {f"{each.name}={each.default}" for each in (fields(known) if known else ())}
    chosen = [each for each in options.split(", ") if each and each not in usual]
    return f"{name}({', '.join(chosen)})" if chosen else name


def _draw_impulses(ax: Axes, events: Sequence[Event], contacts: Sequence[str], label: str) -> None:
    for i, contact in enumerate(contacts):
        impacts = [(e.t, e.impulse) for e in events if e.contact == contact and e.impulse > 0.0]
        if impacts:
            t, impulse = np.array(impacts).T
            ax.vlines(t, 0.0, impulse, colors=f"C{i}", linewidths=1.0)
            ax.plot(t, impulse, "os^Dv"[i % 5], color=f"C{i}", markersize=3.0, label=math_text(contact))
    ax.set_ylim(bottom=-0.06 * ax.get_ylim()[1])
    ax.set_ylabel(label)
    _name_lines(ax)


def _name_lines(ax: Axes) -> None:
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), ncols=1 + len(ax.get_lines()) // 15)


def _span(t: Array) -> tuple[float, float]:
    return (float(t[0]), float(t[-1])) if t[-1] > t[0] else (float(t[0]), float(t[0]) + 1.0)
