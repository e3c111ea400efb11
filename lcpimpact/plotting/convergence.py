"""Plots of convergence, with slope triangles of the observed orders, and of work against precision."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from matplotlib.ticker import LogFormatterSciNotation, LogLocator, NullFormatter
from matplotlib.typing import LineStyleType

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.plotting.style import GREY, LIGHT_GREY, PALETTE, Drawing, Look, style
from lcpimpact.plotting.timeline import axis_label, plain_text
from lcpimpact.registry import nearest
from lcpimpact.study.accuracy.convergence import COSTS, GRIDS, Convergence, WorkPrecision, observed_orders
from lcpimpact.study.accuracy.fitted_order import stated

MARKERS = "os^DvP<>X*"
DASHES: tuple[LineStyleType, ...] = ("-", "--", ":", "-.")

COST_LABELS = {
    "steps": "steps",
    "lcp_solves": "LCPs solved",
    "lcp_iterations": "pivots or sweeps",
    "newton_iterations": "Newton iterations",
    "evaluations": "evaluations of the right-hand side",
    "seconds": "time [s]",
}

ORDER_TOL = 0.15
"""Maximum standard error of an order, and distance from a multiple of 1/2, for which a slope triangle is drawn."""


@style()
@checked
def plot_convergence(study: Convergence, *, norm: str | None = None) -> Figure:
    """Draw the errors of each method over the step, with a slope triangle for each observed order.

    A cross at the upper edge marks a failed run. The legend shows the observed order of each method and its standard error.

    Parameters
    ----------
    study : Convergence
        Of `lcpimpact.convergence`.
    norm : str, optional
        Which of its norms; by default that of the study.

    Raises
    ------
    InputError
        If the table has no such norm.

    Examples
    --------
    >>> from lcpimpact import convergence, load_problem
    >>> study = convergence(load_problem("system-1"), ["moreau-jean"], [0.03, 0.01, 0.003], norms=["sup_q"])
    >>> study.plot().axes[0].get_xlabel()
    'step $h$ [s]'
    """
    table, norm = study.table, _chosen_norm(study, norm)
    orders = observed_orders(study, norm).set_index(["method", "law", "k"])
    figure = Drawing(figsize=(7.0, 4.2), layout="constrained")
    ax = figure.add_subplot()
    lines = []
    slopes = []
    resolved = []
    any_resolved = bool(orders["points"].any())
    for (key, runs), look in zip(_groups(table), _line_styles(table), strict=True):
        row = orders.loc[key]
        # Errors at rounding level are drawn only if there are no others.
        good = runs[(runs["failure"] == "") & (runs[norm] > 0.0) & bool(row["points"] or not any_resolved)]
        shown = look if len(good) else {**look, "marker": "", "linestyle": "none"}
        ax.plot(good["dt"], good[norm], label=f"{_group_name(key)}:  {_order_label(row, runs)}", **shown)
        resolved += list(good[norm])
        if len(good):
            known = row["standard_error"] < ORDER_TOL and abs(row["order"] - _nearest_half(row["order"])) < ORDER_TOL
            lines.append(np.log10(np.column_stack([good["dt"], good[norm]]).astype(float)))
            slopes.append(_nearest_half(row["order"]) if known else 0.0)
        if len(good):
            _mark_failures(ax, runs["dt"], runs["failure"], look)
    ax.set(
        xscale="log", yscale="log", xlabel=axis_label("step $h$", study.problem.unit("t")), ylabel=_label(study, norm)
    )
    _set_title(ax, study, norm)
    _limit_errors(ax, study.scales.get(norm, 0.0), resolved)
    _draw_legend(figure, ax, "observed order ± standard error")
    _draw_triangles(ax, lines, slopes)
    return figure


@style()
@checked
def plot_work_precision(study: WorkPrecision, *, norm: str | None = None, cost: str | None = None) -> Figure:
    """Draw the errors of each method over the cost of its runs; lower and further left is better.

    The legend shows the number of failed runs of each method, and methods without a cost of that kind.

    Parameters
    ----------
    study : WorkPrecision
        Of `lcpimpact.work_precision`.
    norm : str, optional
        Which of its norms; by default that of the study.
    cost : {"seconds", "steps", "evaluations", "lcp_solves", "lcp_iterations", "newton_iterations"}, optional
        Which of its costs; by default that of the study.

    Raises
    ------
    InputError
        If the table has no such norm or cost.

    Examples
    --------
    >>> from lcpimpact import load_problem, work_precision
    >>> study = work_precision(load_problem("system-1"), ["moreau-jean"], [0.03, 0.01], norms=["sup_q"], repeats=1)
    >>> study.plot(cost="evaluations").axes[0].get_xlabel()
    'evaluations of the right-hand side'
    """
    table, norm = study.table, _chosen_norm(study, norm)
    cost = study.cost if cost is None else cost
    if cost not in COSTS:
        raise InputError(nearest(str(cost), list(COSTS), "cost"))
    figure = Drawing(figsize=(7.0, 4.2), layout="constrained")
    ax = figure.add_subplot()
    for (key, runs), look in zip(_groups(table), _line_styles(table), strict=True):
        solved = runs[runs["failure"] == ""]
        good = solved[(solved[norm] > 0.0) & (solved[cost] > 0)].sort_values(cost)
        failed = len(runs) - len(solved)
        note = f": {failed} of {len(runs)} runs without a result" if failed else ""
        if failed == len(runs):
            note = ": no result"
        elif len(good) == 0 and len(solved):
            note = f": no {COST_LABELS[cost]}" if not (solved[cost] > 0).any() else ": no error"
        if len(good) == 0:
            look |= {"marker": "", "linestyle": "none"}
        ax.plot(good[cost].astype(float), good[norm], label=_group_name(key) + note, **look)
    ax.set(xscale="log", yscale="log", xlabel=COST_LABELS[cost], ylabel=_label(study, norm))
    _set_title(ax, study, norm)
    _limit_errors(ax, study.scales.get(norm, 0.0), [])
    _draw_legend(figure, ax, None)
    return figure


def _chosen_norm(study: Convergence, norm: str | None) -> str:
    chosen = study.norm if norm is None else norm
    if chosen not in study.norms:
        raise InputError(nearest(chosen, list(study.norms), "norm of this table"))
    return chosen


def _groups(table: pd.DataFrame) -> Iterator[tuple[tuple[str, str, float], pd.DataFrame]]:
    yield from table.groupby(["method", "law", "k"], sort=False)


def _line_styles(table: pd.DataFrame) -> Iterator[Look]:
    """Yield a colour and a marker for each method, and a line style for each variant of the problem."""
    methods = list(dict.fromkeys(table["method"]))
    variants = list(dict.fromkeys(zip(table["law"], table["k"], strict=True)))
    for (method, law, k), _ in _groups(table):
        i = methods.index(method)
        # Later curves are narrower and their markers are smaller, so that coincident curves are all visible.
        last = max(0, min(len(methods), 5) - 1 - i)
        yield {
            "color": PALETTE[i % len(PALETTE)],
            "marker": MARKERS[i % len(MARKERS)],
            "linestyle": DASHES[(variants.index((law, k)) + i // len(PALETTE)) % len(DASHES)],
            "linewidth": 1.2 + 0.5 * last,
            "markersize": 4.0 + 1.2 * last,
            "markerfacecolor": "none",
        }


def _group_name(key: tuple[str, str, float]) -> str:
    method, law, k = plain_text(key[0]), *key[1:]
    return method if law == "rigid" else f"{method}, {law} {_power(k)}"


def _power(k: float) -> str:
    mantissa = f"{k:.3g}" if 0.1 <= k < 1e4 else f"{k:e}"
    exponent = 0
    if "e" in mantissa:
        digits, _, power = mantissa.partition("e")
        factor, exponent = f"{float(digits):g}", int(power)
        mantissa = f"$10^{{{exponent}}}$" if factor == "1" else rf"${factor}\cdot 10^{{{exponent}}}$"
    return f"$k$ = {mantissa}"


def _nearest_half(order: float) -> float:
    return round(2.0 * order) / 2.0 if np.isfinite(order) else 0.0


def _order_label(row: pd.Series, runs: pd.DataFrame) -> str:
    if row["verdict"] == "failed":
        return "no result"
    if runs["rtol"].notna().any():
        return "steps of its own"
    if np.isfinite(row["order"]):
        return stated(row["order"], row["standard_error"])
    return "rounding" if row["rounding"] else "one step"


def _set_ticks(ax: Axes) -> None:
    """Label 1, 2 and 5 on an axis of less than two decades."""
    low, high = ax.get_xlim()
    if high < 100.0 * low:
        ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        ax.xaxis.set_major_formatter(LogFormatterSciNotation(minor_thresholds=(math.inf, math.inf)))
    ax.xaxis.set_minor_formatter(NullFormatter())


def _limit_errors(ax: Axes, scale: float, resolved: Sequence[float], *, max_error: float = 30.0) -> None:
    """Limit the axis to exclude errors at rounding level and those of unbounded runs.

    A triangle at the upper edge marks an error beyond it.

    ``max_error``: maximum error drawn, in units of the scale of its norm.
    """
    ax.autoscale_view()
    _set_ticks(ax)
    low, high = ax.get_ylim()
    if resolved:
        low = max(low, min(resolved) / 4.0)
    if scale > 0.0:
        high = max(min(high, max_error * scale), 10.0 * low)
    ax.set_ylim(low, high)
    for line in ax.get_lines():
        x, y = np.asarray(line.get_xydata(), dtype=np.float64).T
        if (y > high).any():
            look: Look = {"color": line.get_color(), "marker": "^", "linestyle": "none", "markersize": 6.0}
            ax.plot(x[y > high], np.full((y > high).sum(), high), label="_", clip_on=False, **look)


def _draw_legend(figure: Figure, ax: Axes, title: str | None, *, max_label_length: int = 28) -> None:
    # max_label_length: maximum number of characters of a label inside the axes; longer labels are placed below.
    labels = [str(line.get_label()) for line in ax.get_lines() if not str(line.get_label()).startswith("_")]
    if max(map(len, labels), default=0) <= max_label_length:
        figure.legend(loc="outside right center", title=title, alignment="left")
        return
    figure.legend(loc="outside lower center", title=title, ncols=2)
    figure.set_figheight(figure.get_figheight() + 0.2 * (len(labels) // 2 + 1))


def _label(study: Convergence, norm: str) -> str:
    found = study.norms[norm]
    if study.problem.dimensionless:
        return axis_label(f"${found.symbol}$", "")
    unit = plain_text(found.unit_in(study.problem)).replace("^(1/2)", "$^{1/2}$")
    return f"${found.symbol}$" + (f"  [{unit}]" if unit else "")


def _set_title(ax: Axes, study: Convergence, norm: str) -> None:
    references = plain_text(" or ".join(dict.fromkeys(name for name in study.table["reference"] if name)))
    ax.set_title(f"{plain_text(study.problem.name)}: {study.norms[norm].what}")
    if references:
        ax.annotate(
            f"against {references}; {GRIDS}", (0.0, 0.0), (0.0, -35.0), xycoords="axes fraction", textcoords="offset points",
            fontsize=8.0, color=GREY, va="top",
        )  # fmt: skip


def _mark_failures(ax: Axes, dts: Sequence[float], failures: Sequence[str], look: Look) -> None:
    failed = [dt for dt, failure in zip(dts, failures, strict=True) if failure]
    mark = Line2D(
        failed, [0.98] * len(failed), transform=ax.get_xaxis_transform(), color=look["color"], marker="x",
        linestyle="none", markersize=6.0, clip_on=False,
    )  # fmt: skip
    if failed:
        ax.add_line(mark)
        ax.update_datalim([(dt, 1.0) for dt in failed], updatey=False)


def _draw_triangles(
    ax: Axes,
    lines: Sequence[Array],
    slopes: Sequence[float],
    *,
    triangle_width: float = 0.16,
    triangle_height: float = 0.22,
) -> None:
    """Draw a slope triangle for each observed order, clear of all lines and other triangles.

    ``triangle_width``: maximum width of a slope triangle, relative to the axes.
    ``triangle_height``: maximum height of a slope triangle, relative to the axes.
    """
    if not lines:
        return
    low, high = (np.log10(each) for each in zip(ax.get_xlim(), ax.get_ylim(), strict=True))
    size = high - low
    curves = [(line - low) / size for line in lines]
    occupied = [_refine(curve) for curve in curves]
    for order in sorted(set(slopes) - {0.0}):
        own = [curve for curve, slope in zip(curves, slopes, strict=True) if slope == order]
        steepness = order * size[0] / size[1]
        if order <= 0.0:
            continue
        width = min(triangle_width, triangle_height / steepness)
        corners = _place(own, occupied, width, steepness * width)
        if corners is None:
            continue
        occupied.append(_refine(np.vstack([corners, corners[:1]])))
        _draw_triangle(ax, low + corners * size, order)


def _refine(curve: Array) -> Array:
    """Return points on a polyline dense enough to detect all of its crossings."""
    pieces = [np.linspace(a, b, 60) for a, b in pairwise(curve)]
    return np.vstack(pieces) if pieces else curve


def _place(
    own: Sequence[Array], occupied: Sequence[Array], width: float, height: float, *, triangle_margin: float = 0.03
) -> Array | None:
    """Return the corners, in axes units, of the triangle nearest to a line of its order that touches no line.

    ``triangle_margin``: margin around a slope triangle, relative to the axes.
    """
    obstacles = np.vstack(occupied)
    best, nearest_so_far = None, np.inf
    for x in np.linspace(0.05, 0.93 - width, 45):
        for y in np.linspace(0.08, 0.95 - height, 45):
            inside = (
                (obstacles[:, 0] > x - triangle_margin)
                & (obstacles[:, 0] < x + width + 2.0 * triangle_margin)
                & (obstacles[:, 1] > y - 2.0 * triangle_margin)
                & (obstacles[:, 1] < y + height + triangle_margin)
            )
            if inside.any():
                continue
            middle = np.array([x + 0.5 * width, y + 0.5 * height])
            distance = min(float(np.hypot(*(_refine(curve) - middle).T).min()) for curve in own)
            if distance < nearest_so_far:
                best = np.array([[x, y], [x + width, y], [x + width, y + height]])
                nearest_so_far = distance
    return best


def _draw_triangle(ax: Axes, corners: Array, order: float) -> None:
    """Draw a triangle given by its corners in log10 of dt and of the error, labelled with its order."""
    ax.add_patch(Polygon(10.0**corners, closed=True, facecolor=LIGHT_GREY, edgecolor=GREY, linewidth=0.8, zorder=1.2))
    where = 10.0 ** (0.5 * (corners[1] + corners[2]))
    ax.annotate(
        f"{order:g}", tuple(where), (3.0, 0.0), textcoords="offset points", va="center", fontsize=9.0, color=GREY
    )
    where = 10.0 ** (0.5 * (corners[0] + corners[1]))
    ax.annotate(
        "1", tuple(where), (0.0, -2.5), textcoords="offset points", ha="center", va="top", fontsize=9.0, color=GREY
    )
