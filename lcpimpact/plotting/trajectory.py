"""The picture of one run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lcpimpact.arrays import Array
from lcpimpact.plotting.style import save, style
from lcpimpact.plotting.timeline import MANY, curves, mark_events, math_text
from lcpimpact.trajectory import Trajectory


@style()
def plot_trajectory(trajectory: Trajectory, path: str | Path | None = None) -> Figure:
    """Draw coordinates over time, reactions below, and impulses below those if there are impacts; mark the events.

    Parameters
    ----------
    trajectory : Trajectory
        Any run; one that ended early is drawn as far as it came.
    path : str or Path, optional
        A file ending in .png, .svg or .pdf to write.

    Raises
    ------
    InputError
        For another ending, or a folder that cannot be written.

    Examples
    --------
    >>> from lcpimpact import load_problem, simulate
    >>> figure = plot_trajectory(simulate(load_problem("bouncing-ball"), "exact", dt=1e-2, t_end=1.0))
    >>> [ax.get_ylabel() for ax in figure.axes]
    ['coordinates [m]', 'reaction [N]', 'impulse [N s]']
    """
    dynamics = trajectory.problem.dynamics
    contacts = [contact.name for contact in dynamics.contacts]
    impacts = any(event.impulse > 0.0 for event in trajectory.events)
    heights = [3.0] + [2.0] * bool(contacts) + [1.2] * impacts
    figure = Figure(figsize=(7.0, 0.9 + sum(heights)), layout="constrained")
    panels = list(figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0])

    t, q, t_reaction, reaction = curves(trajectory)
    _draw_series(panels[0], t, q, dynamics.nodes, "coordinates [m]")
    if contacts:
        averaged = len(trajectory.t_reaction) < len(trajectory.t)
        _draw_series(
            panels[1], t_reaction, reaction, contacts, "mean reaction of a step [N]" if averaged else "reaction [N]"
        )
    if impacts:
        _draw_impulses(panels[-1], trajectory, contacts)

    panels[0].set_xlim(*_span(trajectory.t))
    panels[-1].set_xlabel("$t$ [s]")
    mark_events(panels, trajectory.events)
    figure.suptitle(_title(trajectory), x=0.01, ha="left", fontsize=10.0)
    if path is not None:
        save(figure, path)
    return figure


def _draw_series(ax: Axes, t: Array, values: Array, names: Sequence[str], label: str) -> None:
    for i, (name, column) in enumerate(zip(names, values.T, strict=True)):
        # Where curves coincide, the later and narrower one leaves a rim of the earlier.
        ax.plot(t, column, label=math_text(name), linewidth=1.4 + 0.8 * max(0, min(len(names), 4) - 1 - i))
    ax.set_ylabel(label)
    _name_lines(ax)


def _draw_impulses(ax: Axes, trajectory: Trajectory, contacts: Sequence[str]) -> None:
    for i, contact in enumerate(contacts):
        impacts = [(e.t, e.impulse) for e in trajectory.events if e.contact == contact and e.impulse > 0.0]
        if impacts:
            t, impulse = np.array(impacts).T
            ax.vlines(t, 0.0, impulse, colors=f"C{i}", linewidths=1.0)
            ax.plot(t, impulse, "o", color=f"C{i}", markersize=3.0, label=math_text(contact))
    ax.set_ylim(bottom=-0.06 * ax.get_ylim()[1])
    ax.set_ylabel("impulse [N s]")
    _name_lines(ax)


def _name_lines(ax: Axes) -> None:
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), ncols=1 + len(ax.get_lines()) // 15)


def _span(t: Array) -> tuple[float, float]:
    return (float(t[0]), float(t[-1])) if t[-1] > t[0] else (float(t[0]), float(t[0]) + 1.0)


def _title(trajectory: Trajectory) -> str:
    title = f"{trajectory.problem.name} by {trajectory.method}"
    if not trajectory.success:
        title += f": {trajectory.status.name.lower().replace('_', '-')} at t = {trajectory.t[-1]:g} s"
    if len(trajectory.events) >= MANY:
        title += f", {len(trajectory.events)} events"
    return title
