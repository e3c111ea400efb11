"""The path of an LCP solver in the plane or space of z, pivot by pivot: of Lemke's method, the almost complementary path."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.lcp.trace import Trace
from lcpimpact.plotting.style import GREY, INK, LCP, PALETTE, RK4, Drawing, save, style

ROOM = 0.18
"""Margin around the path, relative to its extent."""

BOUNDARIES = PALETTE[2], PALETTE[3], PALETTE[4]
HALO = [withStroke(linewidth=3.0, foreground="white")]


@style()
@checked
def plot_trace(trace: Trace, path: str | Path | None = None) -> Figure:
    """Draw the steps of a solver on an LCP of order 2 or 3.

    On the left is the path in the plane or space of z, its points numbered as in ``print(trace)``, with the lines w_i = 0 in
    the plane. On the right is what goes to zero: of Lemke's method the covering variable z0, with w = M z + q + d z0 >= 0
    and the covering vector d; of others the natural residual. Below it stand the variables that enter and leave the basis.

    Parameters
    ----------
    trace : Trace
        From ``solve_lcp(M, q, solver, trace=True).trace``.
    path : str or Path, optional
        A file ending in .png, .svg or .pdf to write.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        If the LCP is not of order 2 or 3, or no step was traced; for another ending, or a folder that cannot be written.

    Examples
    --------
    >>> from lcpimpact import solve_lcp
    >>> trace = solve_lcp([[2.0, 1.0], [1.0, 2.0]], [-5.0, -6.0], "lemke", trace=True).trace
    >>> plot_trace(trace).get_suptitle()
    'lemke in 3 steps: $z$ = (1.333, 2.333); covering vector $d$ = (1, 1)'

    References
    ----------
    Cottle, Pang and Stone, *The Linear Complementarity Problem* (1992), section 4.4.
    """
    n = len(trace.q)
    if n not in (2, 3):
        raise InputError(f"the LCP has order {n}; the path of z can be drawn for order 2 and 3: print the trace")
    if not len(trace):
        raise InputError(f"{trace.solver} has no steps in this trace: take a solver that pivots, as 'lemke'")
    figure = Drawing(figsize=(10.0, 4.6), layout="constrained")
    ax = figure.add_subplot(1, 2, 1, projection="3d" if n == 3 else None)
    z = np.array([step.z for step in trace.steps])
    if n == 2:
        _draw_in_plane(ax, trace, z)
    else:
        _draw_in_space(ax, trace, z)
    _draw_progress(figure.add_subplot(1, 2, 2), trace)
    last = ", ".join(f"{each:.4g}" for each in z[-1] + 0.0)
    z0 = trace.steps[-1].z0
    steps = f"{len(trace)} step{'s' if len(trace) > 1 else ''}"
    end = f"$z$ = ({last})" if not z0 else f"it stops at $z$ = ({last}) with $z_0$ = {z0:.4g}"
    figure.suptitle(f"{trace.solver} in {steps}: {end}{_covering(trace)}", x=0.01, ha="left", fontsize=10.0)
    if path is not None:
        save(figure, path)
    return figure


def _covering(trace: Trace) -> str:
    """Return the covering vector in words, where there is one."""
    for step in trace.steps:
        if step.z0:
            d = (step.w - trace.M @ step.z - trace.q) / step.z0
            return f"; covering vector $d$ = ({', '.join(f'{each:.4g}' for each in d)})"
    return ""


def _places(trace: Trace, z: Array, *, same_place_tol: float = 0.03) -> list[tuple[Array, str]]:
    """Return the points of the path that are apart, each with the numbers of the steps there; of iterates the ends.

    ``same_place_tol``: distance of two steps, relative to the extent of the path, below which they have one label.
    """
    if not any(step.entering or step.leaving for step in trace.steps):
        return [(z[0], "1"), *([(z[-1], str(len(z)))] if len(z) > 1 else [])]
    size = float(np.ptp(z, axis=0).max()) or 1.0
    found: list[tuple[Array, list[int]]] = []
    for number, point in enumerate(z, 1):
        for other, numbers in found:
            if np.abs(point - other).max() <= same_place_tol * size:
                numbers.append(number)
                break
        else:
            found.append((point, [number]))
    return [(point, _numbers(numbers)) for point, numbers in found]


def _numbers(numbers: list[int]) -> str:
    few = [str(each) for each in numbers]
    return ", ".join(few if len(few) < 5 else [*few[:2], "...", few[-1]])


def _limits(z: Array) -> Array:
    """Return the lower and upper limit of each axis (n, 2), with room around the path and the origin."""
    low = np.minimum(z.min(axis=0), 0.0)
    high = np.maximum(z.max(axis=0), 0.0)
    size = float((high - low).max()) or 1.0
    room = np.maximum(ROOM * (high - low), 0.3 * size - 0.5 * (high - low))
    return np.column_stack([low - room, high + room])


def _draw_in_plane(ax: Axes, trace: Trace, z: Array) -> None:
    """Draw the path among the lines w_i = 0, which are those of z0 = 0."""
    (left, right), (low, high) = _limits(z)
    for i, (row, q, color) in enumerate(zip(trace.M, trace.q, BOUNDARIES, strict=False), 1):
        if row[1]:
            ends = [(x, -(q + row[0] * x) / row[1]) for x in (left, right)]
        elif row[0]:
            ends = [(-q / row[0], y) for y in (low, high)]
        else:
            continue
        ax.plot(*zip(*ends, strict=True), color=color, linestyle="--", linewidth=1.2, label=f"$w_{i} = 0$", zorder=2.0)
    ax.axhline(0.0, color=INK, linewidth=0.8, zorder=1.5)
    ax.axvline(0.0, color=INK, linewidth=0.8, zorder=1.5)
    ax.plot(*z.T, color=LCP, linestyle="-", marker="o", markersize=5.0, zorder=3.0)
    for a, b in pairwise(z):
        middle, ahead = 0.5 * (a + b), a + 0.56 * (b - a)
        arrow = {"arrowstyle": "-|>", "color": LCP, "linewidth": 1.4, "shrinkA": 0.0, "shrinkB": 0.0}
        ax.annotate("", (ahead[0], ahead[1]), (middle[0], middle[1]), arrowprops=arrow, zorder=3.0)
    ax.plot(*z[-1], color=RK4, linestyle="", marker="D", markersize=7.0, zorder=3.5)
    for (x, y), name in _places(trace, z):
        ax.annotate(name, (x, y), (7.0, 7.0), textcoords="offset points", fontsize=11.0, path_effects=HALO, zorder=4.0)
    ax.set(xlim=(left, right), ylim=(low, high), xlabel="$z_1$", ylabel="$z_2$")
    if ax.get_legend_handles_labels()[0]:
        ax.legend(loc="best")


def _draw_in_space(ax: Any, trace: Trace, z: Array) -> None:
    """Draw the path with its shadow on the plane of z1 and z2."""
    limits = _limits(z)
    floor = np.column_stack([z[:, :2], np.full(len(z), limits[2, 0])])
    ax.plot(*floor.T, color=GREY, linestyle="-", linewidth=1.0)
    for point, below in zip(z, floor, strict=True):
        ax.plot(*np.array([below, point]).T, color=GREY, linestyle=":", linewidth=0.9)
    ax.plot(*z.T, color=LCP, linestyle="-", marker="o", markersize=5.0)
    ax.plot(*z[-1:].T, color=RK4, linestyle="", marker="D", markersize=7.0)
    for point, name in _places(trace, z):
        ax.text(*point, f"  {name}", fontsize=11.0, path_effects=HALO, zorder=10.0)
    ax.set(xlim=limits[0], ylim=limits[1], zlim=limits[2], xlabel="$z_1$", ylabel="$z_2$", zlabel="$z_3$")
    ax.view_init(elev=22.0, azim=-58.0)


def _draw_progress(ax: Axes, trace: Trace, *, max_named_steps: int = 12) -> None:
    """Draw z0 over the steps, or without it the natural residual, with the exchanges of the basis.

    ``max_named_steps``: maximum number of steps whose exchanges are written on the axis.
    """
    z0 = np.array([step.z0 for step in trace.steps])
    numbers = np.arange(1, len(trace) + 1)
    exchanges = [_exchange(step.entering, step.leaving) for step in trace.steps]
    if z0.any():
        ax.plot(numbers, z0, color=LCP, linestyle="-", marker="o", markersize=5.0)
        ax.set(ylabel="$z_0$", ylim=(-0.06 * z0.max(), 1.1 * z0.max()))
        ax.axhline(0.0, color=INK, linewidth=0.8, zorder=1.5)
    else:
        residual = [float(np.linalg.norm(np.minimum(step.z, step.w))) for step in trace.steps]
        ax.plot(numbers, residual, color=LCP, linestyle="-", marker="o", markersize=5.0)
        ax.set(ylabel=r"$\|\min(z, w)\|$")
        if not any(exchanges):  # iterates
            ax.set(yscale="log")
    ax.set(xlim=(0.5, len(trace) + 0.5), xlabel="step")
    if any(exchanges) and len(trace) <= max_named_steps:
        names = [f"{k}\n{each}" for k, each in zip(numbers, exchanges, strict=True)]
        ax.set_xticks(numbers, names)
        ax.set(xlabel="step, and the variables that enter and leave the basis")
    else:
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))


def _exchange(entering: str, leaving: str) -> str:
    """Return the variables of an exchange in two lines."""
    signed = (("+", entering), ("\N{MINUS SIGN}", leaving))
    return "\n".join(f"{sign} ${name[0]}_{{{name[1:]}}}$" for sign, name in signed if name)
