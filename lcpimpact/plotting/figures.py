"""Figures 2, 3 and 6 to 9 of Grzesikiewicz and Zbiciak."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import LogLocator

from lcpimpact.arrays import Array
from lcpimpact.plotting.style import EXACT, GREY, INK, LCP, LIGHT_GREY, PALETTE, RK4, Drawing, Look, style
from lcpimpact.plotting.timeline import contact_intervals, curves, mark_events, math_text
from lcpimpact.trajectory import Trajectory

CIRCLES: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 4.5, "markerfacecolor": "none"}
CROSSES: dict[str, Any] = {"linestyle": "none", "marker": "x", "markersize": 4.5}
"""Markers of the LCP and of RK4; RK4's are half way between those of the LCP."""


class Corner(NamedTuple):
    """Labels in the graph of a complementarity condition between R and an abscissa."""

    abscissa: str
    closed: str
    opened: str
    left: str
    inside: str
    below: str


@style()
def figure_2() -> Figure:
    """Draw Fig. 2: the graph of 0 <= u ⟂ R >= 0, Eq. (2c).

    Examples
    --------
    >>> len(figure_2().axes)
    1
    """
    return _draw_corner(
        Corner(
            abscissa="$u$",
            closed="closed:\n$u=0,\\ R\\geq 0$",
            opened="open: $u>0,\\ R=0$",
            left="$u<0$:\npenetration",
            inside="$u>0,\\ R>0$:\nforce at a distance",
            below="$R<0$: adhesion",
        )
    )


@style()
def figure_3() -> Figure:
    """Draw Fig. 3: the velocity-level graph 0 <= u' ⟂ R >= 0 for u = 0.

    Examples
    --------
    >>> len(figure_3().axes)
    1
    """
    return _draw_corner(
        Corner(
            abscissa="$\\dot u$   at $u=0$",
            closed="pressed:\n$\\dot u=0,\\ R\\geq 0$",
            opened="parting: $\\dot u>0,\\ R=0$",
            left="$\\dot u<0$:\npenetration",
            inside="$\\dot u>0,\\ R>0$:\nforce while parting",
            below="$R<0$: adhesion",
        )
    )


def _draw_corner(text: Corner) -> Figure:
    figure = Drawing(figsize=(4.2, 3.6), layout="constrained")
    ax = figure.add_subplot(aspect="equal")
    low, high = -1.0, 2.4
    for corner, width, height in (((low, low), -low, high - low), ((0.0, low), high, -low)):
        ax.add_patch(
            Rectangle(corner, width, height, facecolor="none", edgecolor="#ccd3dc", hatch="////", linewidth=0.0)
        )
    for tip in ((high + 0.25, 0.0), (0.0, high + 0.25)):
        tail = (low, 0.0) if tip[0] else (0.0, low)
        ax.annotate(
            "", tip, tail, arrowprops={"arrowstyle": "-|>", "color": INK, "lw": 0.8, "shrinkA": 0.0, "shrinkB": 0.0}
        )
    ax.plot([0.0, 0.0, high], [high, 0.0, 0.0], color=LCP, linewidth=3.5, solid_joinstyle="miter", zorder=3.0)

    ground = {"facecolor": "white", "edgecolor": "none", "boxstyle": "round,pad=0.25"}
    ax.text(
        high + 0.2, 0.1, text.abscissa, ha="right" if len(text.abscissa) > 6 else "center", va="bottom", fontsize=12.0
    )
    ax.text(-0.12, high + 0.2, "$R$", ha="right", va="center", fontsize=12.0)
    ax.text(0.14, 0.85, text.closed, ha="left", va="center", color=LCP)
    ax.text(1.2, -0.22, text.opened, ha="center", va="center", color=LCP, bbox=ground)
    ax.text(low / 2.0, 1.5, text.left, ha="center", va="center", color=GREY, bbox=ground, fontsize=9.0)
    ax.text(1.4, 1.75, text.inside, ha="center", va="center", color=GREY, fontsize=9.0)
    ax.text(1.2, -0.7, text.below, ha="center", va="center", color=GREY, bbox=ground, fontsize=9.0)
    ax.set(xlim=(low - 0.02, high + 0.3), ylim=(low - 0.02, high + 0.4))
    ax.set_axis_off()
    return figure


@style()
def force_figure(exact: Trajectory, lcp: Trajectory, rk4: Trajectory, *, number: int) -> Figure:
    """Draw Fig. 6, 7 or 8: R(t) of one system by three methods, with the errors of two below.

    The LCP's force is the mean over a step, drawn at its midpoint; errors are taken at the instants of the force.

    Parameters
    ----------
    exact, lcp, rk4 : Trajectory
        Runs of one problem with one bumper over the same time.
    number : int
        The number of the figure.
    """
    figure, force, error = _two_panels(f"Fig. {number}.  {_system(exact)}: force between the bumper plates")
    _, _, t, R = curves(exact)
    peak = float(np.nanmax(R)) or 1.0
    force.plot(t, R[:, 0], color=EXACT, linewidth=5.0, solid_capstyle="butt", label="exact")
    force.plot(
        lcp.t_reaction, lcp.reaction[:, 0], color=LCP, markevery=_every(lcp), label=f"LCP, {_step(lcp)}", **CIRCLES
    )
    force.plot(
        rk4.t_reaction, rk4.reaction[:, 0], color=RK4, markevery=_every(rk4, 0.5), label=f"RK4, {_step(rk4)}", **CROSSES
    )
    force.set(xlim=(exact.t[0], exact.t[-1]), ylim=(-0.03 * peak, 1.2 * peak), ylabel="$R$ [N]")
    figure.legend(loc="outside lower center", ncols=3)
    _annotate_peak(force, t, R[:, 0])
    for run, look in _looks(lcp, rk4, LCP, RK4):
        _draw_error(error, run.t_reaction, run.reaction - exact.sample(run.t_reaction).reaction, look)
    _limit_decades(error, "$|R-R_\\mathrm{exact}|$ [N]")
    mark_events((force, error), exact.events)
    return figure


@style()
def motion_figure(exact: Trajectory, lcp: Trajectory, rk4: Trajectory, *, number: int) -> Figure:
    """Draw Fig. 9: the coordinates of one system by three methods, with contact intervals shaded and the errors below.

    Parameters
    ----------
    exact, lcp, rk4 : Trajectory
        Runs of one problem over the same time.
    number : int
        The number of the figure.
    """
    names = exact.problem.dynamics.nodes
    every = ", ".join(math_text(name) for name in names)
    figure, motion, error = _two_panels(f"Fig. {number}.  {_system(exact)}: motion")
    t, q, _, _ = curves(exact)
    for i, name in enumerate(names):
        color = PALETTE[i % len(PALETTE)]
        # In contact y and z coincide: the later line is narrower, and its markers are between, so that both are visible.
        part = i / (2.0 * len(names))
        motion.plot(t, q[:, i], color=color, alpha=0.35, linewidth=max(1.5, 6.5 - 2.0 * i))
        motion.plot(lcp.t, lcp.q[:, i], color=color, markevery=_every(lcp, part), **CIRCLES)
        motion.plot(rk4.t, rk4.q[:, i], color=INK, markevery=_every(rk4, 0.5 + part), **CROSSES)
        top = int(np.nanargmax(np.abs(q[:, i])))
        above = i + 1 == len(names) or q[top, i] < 0.0
        motion.annotate(
            math_text(name), (t[top], q[top, i]), (0.0, 6.0 if above else -6.0), textcoords="offset points", color=color,
            fontsize=12.0, ha="center", va="bottom" if above else "top",
        )  # fmt: skip
    motion.set(xlim=(exact.t[0], exact.t[-1]), ylabel=f"{every} [m]")
    shading: Look = {"color": LIGHT_GREY, "linewidth": 0.0}
    for contact in exact.problem.dynamics.contacts:
        for start, end in contact_intervals(exact, contact.name):
            motion.axvspan(start, end, zorder=0.5, **shading)
    entries = [
        Line2D([], [], color=GREY, alpha=0.35, linewidth=5.0, label="exact"),
        Line2D([], [], color=GREY, label=f"LCP, {_step(lcp)}", **CIRCLES),
        Line2D([], [], color=INK, label=f"RK4, {_step(rk4)}", **CROSSES),
        Rectangle((0.0, 0.0), 1.0, 1.0, label="in contact", **shading),
    ]
    figure.legend(handles=entries, loc="outside lower center", ncols=4)
    for run, look in _looks(lcp, rk4, GREY, INK):
        _draw_error(error, run.t, run.q - exact.sample(run.t).q, look)
    _limit_decades(error, "largest error [m]")
    mark_events((motion, error), exact.events)
    return figure


def _two_panels(title: str) -> tuple[Figure, Axes, Axes]:
    figure = Drawing(figsize=(7.0, 5.6), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[2.0, 1.0])
    lower.set_xlabel("$t$ [s]")
    figure.suptitle(title, x=0.01, ha="left", fontsize=11.0)
    return figure, upper, lower


def _system(trajectory: Trajectory) -> str:
    return trajectory.problem.name.replace("system-", "System No. ")


def _step(trajectory: Trajectory) -> str:
    return f"$h={trajectory.t[1] - trajectory.t[0]:g}$ s"


def _every(trajectory: Trajectory, part: float = 0.0, *, marker_count: int = 40) -> tuple[int, int]:
    """Return the first marker, at a part of the distance of two, and that distance in steps.

    ``marker_count``: approximate number of markers of each method on a curve.
    """
    every = max(1, len(trajectory.t) // marker_count)
    return int(part * every), every


def _looks(
    lcp: Trajectory, rk4: Trajectory, lcp_color: str, rk4_color: str
) -> Sequence[tuple[Trajectory, dict[str, Any]]]:
    """Return the two runs with the looks of their errors, with the markers of their curves."""
    return (
        (lcp, {**CIRCLES, "color": lcp_color, "linestyle": "-", "markevery": _every(lcp)}),
        (rk4, {**CROSSES, "color": rk4_color, "linestyle": ":", "markevery": _every(rk4, 0.5)}),
    )


def _annotate_peak(ax: Axes, t: Array, R: Array) -> None:
    top = int(np.nanargmax(R))
    # The text is to the right of the tip, clear of the vertical axis even for an early peak.
    ax.annotate(
        f"peak {R[top]:.0f} N",
        (t[top], R[top]),
        (-8.0, 16.0),
        textcoords="offset points",
        va="bottom",
        fontsize=9.0,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.5},
        arrowprops={"arrowstyle": "-|>", "color": INK, "linewidth": 0.8, "relpos": (0.0, 0.0), "shrinkB": 3.0},
    )


def _draw_error(ax: Axes, t: Array, difference: Array, look: dict[str, Any]) -> None:
    """Draw the largest error at each instant on a logarithmic scale; the line is broken where it is zero."""
    error = np.abs(difference).max(axis=1)
    ax.semilogy(t, np.where(error > 0.0, error, np.nan), linewidth=1.1, **look)


def _limit_decades(ax: Axes, label: str, *, error_decades: float = 12.0, dips: float = 0.01) -> None:
    """Limit the axis to the errors, without the sharp dips where one changes its sign.

    ``error_decades``: maximum number of decades below the largest error that are drawn.
    ``dips``: fraction of the errors of a method that are below the axis.
    """
    errors = [np.asarray(line.get_ydata(), dtype=float) for line in ax.get_lines()]
    largest = max(float(np.nanmax(np.append(each, 1e-300))) for each in errors)
    least = min(float(np.nanquantile(np.append(each, largest), dips)) for each in errors)
    low = max(0.3 * least, largest * 10.0**-error_decades)
    ax.set(ylim=(low, 3.0 * largest), ylabel=label)
    ax.yaxis.set_major_locator(LogLocator(numticks=6))
