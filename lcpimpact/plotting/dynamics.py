"""Plots of nonsmooth dynamics: sections, bifurcations, basins of attraction, orbits and their multipliers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.plotting.style import CURVE_POINTS, GREY, INK, LIGHT_GREY, PALETTE, Drawing, style
from lcpimpact.plotting.timeline import axis_label, math_text, plain_text
from lcpimpact.registry import nearest
from lcpimpact.study.dynamics.basins import Basins
from lcpimpact.study.dynamics.continuation import Branch
from lcpimpact.study.dynamics.curves import BifurcationCurve
from lcpimpact.study.dynamics.diagrams import BifurcationDiagram
from lcpimpact.study.dynamics.lyapunov import LyapunovExponents
from lcpimpact.study.dynamics.sections import Impacts, PoincareSection
from lcpimpact.study.dynamics.shooting import PeriodicOrbit

BASIN_COLORS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#f0e442")
"""Okabe and Ito's colours for basins; initial states that do not converge are grey."""

NO_ATTRACTOR_COLOR = "#8d95a1"

ATTRACTOR: dict[str, Any] = {"marker": "o", "mfc": "white", "mec": INK, "ms": 5.0, "mew": 1.2}
"""Mark of the points of an attractor."""

CURVES = {"fold": (PALETTE[0], "-"), "flip": (PALETTE[1], "--"), "grazing": (PALETTE[2], "-.")}
"""Colour and line of each bifurcation in the plane of two parameters."""

MAX_LARGE_POINTS = 12
"""Maximum number of section points drawn with large markers."""

_STABILITY = [
    Line2D([], [], color=PALETTE[0], label="stable orbit"),
    Line2D([], [], color=PALETTE[1], ls="--", label="orbit that is not stable"),
]


@style()
@checked
def plot_poincare(study: PoincareSection, *, x: str | None = None, y: str | None = None) -> Figure:
    """Draw the points of a Poincaré section.

    Parameters
    ----------
    study : PoincareSection
        Of `lcpimpact.poincare`.
    x, y : str, optional
        Columns; by default the first coordinate and its velocity, or, if that coordinate is constant on the section, as at
        a stop, the phase of the force and the velocity.

    Raises
    ------
    InputError
        For an unknown column, or a table without points.
    """
    table, node = study.table, study.problem.dynamics.nodes[0]
    if len(table) == 0:
        raise InputError("the table has no points: run longer, or take another section")
    constant = np.ptp(table[node]) <= 1e-6 * max(np.ptp(table[f"v_{node}"]), 1e-300)
    fixed = constant or isinstance(study.section, Impacts)
    across = x or ("phase" if fixed and "phase" in table and table["phase"].notna().all() else node)
    up = y or f"v_{node}"
    _check(table, across, up)
    figure = Drawing(figsize=(5.2, 4.2), layout="constrained")
    ax = figure.add_subplot()
    few = len(np.unique(np.round(table[[across, up]].to_numpy(), 6), axis=0)) <= MAX_LARGE_POINTS
    ax.plot(table[across], table[up], "o", color=PALETTE[0], ms=5.0 if few else 1.8, mew=0.0)
    ax.margins(0.12 if few else 0.05)
    if across == "phase":
        ax.set_xlim(0.0, 1.0)
    _widen(ax)
    ax.set_xlabel(_label(across, study.problem.units))
    ax.set_ylabel(_label(up, study.problem.units))
    ax.set_title(plain_text(f"{study.problem.name} by {study.method}"))
    return figure


@style()
@checked
def plot_bifurcation(
    study: BifurcationDiagram, *, y: str | None = None, marks: Sequence[tuple[float, str]] = ()
) -> Figure:
    """Draw the points of a bifurcation diagram and its branches of periodic orbits.

    A branch is solid where the orbit is stable, else dashed. It is evaluated at phase 0 of the force, or at the fastest
    impact of a period.

    Parameters
    ----------
    study : BifurcationDiagram
        Of `lcpimpact.bifurcation`.
    y : str, optional
        Column; by default that of the study, or the first coordinate, or the speed of impacts.
    marks : sequence of (float, str)
        Parameter values to mark by a labelled line, such as a grazing.

    Raises
    ------
    InputError
        For an unknown column, or a table without points.
    """
    table, branches = study.table, study.branches
    if "point" not in table or table["point"].isna().all():
        raise InputError("the table has no points: see its column failure")
    node = _first_node(table)
    up = y or study.y or ("speed" if isinstance(study.section, Impacts) else node)
    _check(table, up)
    figure = Drawing(figsize=(6.4, 4.0), layout="constrained")
    ax = figure.add_subplot()
    count = len(table)
    size = float(np.clip(150.0 / math.sqrt(count), 1.5, 3.0))
    ax.plot(table["value"], table[up], "o", color=INK, ms=size, mew=0.0, alpha=0.75, rasterized=count > 2_000)
    for branch in branches:
        _draw_branch(ax, branch, up)
    for value, word in marks:
        ax.axvline(value, color=GREY, lw=0.9, ls=":")
        ax.annotate(word, (value, 1.0), (0.0, 3.0), xycoords=("data", "axes fraction"), textcoords="offset points",
                    ha="center", fontsize=9.0, color=INK, annotation_clip=False)  # fmt: skip
    failed = table.loc[table["failure"].fillna("") != "", "value"]
    if len(failed):
        ax.plot(failed, np.full(len(failed), 0.01), "x", color=PALETTE[1], ms=4.0, transform=ax.get_xaxis_transform())
    handles = [Line2D([], [], color=INK, marker="o", ls="none", ms=2.5, label="where motions end up")]
    handles += _STABILITY if branches else []
    if len(failed):
        handles.append(Line2D([], [], color=PALETTE[1], marker="x", ls="none", ms=4.0, label="no result"))
    if len(handles) > 1:
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)
    ax.margins(x=0.01)
    ax.set_xlabel(_parameter_label(study.parameter, study.units))
    ax.set_ylabel(_label(up, study.units))
    ax.set_title(plain_text(f"{study.name} by {study.method}"), pad=18.0 if marks else None)
    return figure


@style()
@checked
def plot_branch(branch: Branch, *, y: str | None = None) -> Figure:
    """Draw a branch of periodic orbits along its parameter, dashed where unstable.

    Parameters
    ----------
    branch : Branch
        Of `lcpimpact.continue_orbit`.
    y : str, optional
        Column; by default the speed of the fastest impact, or the first coordinate if there is no impact.

    Raises
    ------
    InputError
        For an unknown column.
    """
    nodes = branch.orbits[0].problem.dynamics.nodes
    up = y or ("speed" if branch.table["impacts"].max() > 0 else nodes[0])
    figure = Drawing(figsize=(6.4, 4.0), layout="constrained")
    ax = figure.add_subplot()
    _draw_branch(ax, branch, up)
    figure.legend(handles=_STABILITY, loc="outside lower center", ncols=2, frameon=False)
    units = branch.orbits[0].problem.units
    ax.set_xlabel(_parameter_label(branch.parameter, units))
    ax.set_ylabel(_label(up, units))
    ax.set_title(plain_text(branch.title.format(branch)))
    return figure


@style()
@checked
def plot_bifurcation_curve(curve: BifurcationCurve, *, others: Sequence[BifurcationCurve] = ()) -> Figure:
    """Draw curves of bifurcations in the plane of two parameters; points where two kinds meet are marked.

    Parameters
    ----------
    curve : BifurcationCurve
        Of `lcpimpact.bifurcation_curve`.
    others : sequence of BifurcationCurve
        Other curves in the plane of the same parameters.

    Raises
    ------
    InputError
        If another curve is of other parameters.
    """
    p, s = curve.parameters
    figure = Drawing(figsize=(6.4, 4.0), layout="constrained")
    ax = figure.add_subplot()
    for each in (curve, *others):
        if each.parameters != curve.parameters:
            raise InputError(f"others: a curve is in the plane of {' and '.join(each.parameters)}, not of {p} and {s}")
        (color, line), table = CURVES[each.kind], each.table
        ax.plot(table[p], table[s], color=color, ls=line)
        marked = table[table["point"] != ""]
        ax.plot(marked[p], marked[s], ls="none", **ATTRACTOR)
        for x, y, word in marked[[p, s, "point"]].itertuples(index=False):
            ax.annotate(word, (x, y), (8.0, -10.0), textcoords="offset points", fontsize=9.0, color=INK)
    kinds = dict.fromkeys(each.kind for each in (curve, *others))
    handles = [Line2D([], [], label=kind, color=CURVES[kind][0], ls=CURVES[kind][1]) for kind in kinds]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)
    units = curve.orbits[0].problem.units
    ax.set_xlabel(_parameter_label(p, units))
    ax.set_ylabel(_parameter_label(s, units))
    ax.set_title(plain_text(f"Bifurcations of periodic orbits of {curve.orbits[0].problem.name}"))
    return figure


def _draw_branch(ax: Axes, branch: Branch, up: str) -> None:
    table = branch.table[branch.table["failure"] == ""]
    if up not in table:
        raise InputError(nearest(up, [name for name in table.columns if name != "failure"], "column of the branch"))
    stable = table["stable"].to_numpy(dtype=bool)
    x = table["value"].to_numpy(dtype=float)
    y = table[up].to_numpy(dtype=float)
    # Each piece extends to the next point, so that the line is not broken at a change of stability.
    for mask, color, line in ((stable, PALETTE[0], "-"), (~stable, PALETTE[1], "--")):
        shown = mask.copy()
        shown[1:] |= mask[:-1]
        ax.plot(x, np.where(shown, y, np.nan), color=color, ls=line, lw=1.6, zorder=3)


@style()
@checked
def plot_lyapunov(study: LyapunovExponents) -> Figure:
    """Draw the finite-time Lyapunov exponents over time.

    Parameters
    ----------
    study : LyapunovExponents
        Of `lcpimpact.lyapunov`.
    """
    figure = Drawing(figsize=(6.4, 3.6), layout="constrained")
    ax = figure.add_subplot()
    for k, name in enumerate(study.table.columns[1:]):
        label = f"λ = {study.exponents[k]:.4g}"
        ax.plot(
            study.table["t"], study.table[name].replace(-np.inf, np.nan), color=PALETTE[k % len(PALETTE)], label=label
        )
    ax.axhline(0.0, color=INK, lw=0.7)
    figure.legend(loc="outside right upper")
    second = study.problem.unit("t")
    ax.set_xlabel(axis_label("$t$", second))
    ax.set_ylabel(axis_label("average of ln |R| over time", f"1/{second}" if second else ""))
    ax.set_title(plain_text(study.problem.name))
    return figure


@style()
@checked
def plot_basins(result: Basins) -> Figure:
    """Draw the basins of attraction in the plane of initial states.

    Parameters
    ----------
    result : Basins
        Of `lcpimpact.basins`.
    """
    table = result.table
    first, second = table.columns[:2]
    grid = table.pivot(index=second, columns=first, values="attractor")
    count = int(table["attractor"].max())
    shown = min(count, len(BASIN_COLORS))
    colors = ListedColormap([NO_ATTRACTOR_COLOR, *BASIN_COLORS[:shown]])
    figure = Drawing(figsize=(6.0, 4.4), layout="constrained")
    ax = figure.add_subplot()
    ax.pcolormesh(
        _edges(grid.columns.to_numpy()),
        _edges(grid.index.to_numpy()),
        np.minimum(grid.to_numpy(), shown),
        cmap=colors,
        norm=BoundaryNorm(np.arange(-0.5, shown + 1.0), shown + 1),
        rasterized=True,
    )
    ax.grid(False)
    marked = _draw_attractors(ax, result, str(first), str(second))
    named = enumerate(BASIN_COLORS[:shown], 1)
    handles: list[Artist] = [Patch(color=color, label=_attractor(result, k, shown < count)) for k, color in named]
    unattracted = float((table["attractor"] == 0).mean())
    if unattracted > 0.0:
        word = "no period found"
        handles.append(Patch(color=NO_ATTRACTOR_COLOR, label=f"{word}, {_percentage(unattracted)}"))
    if marked:
        handles.append(Line2D([], [], ls="none", label="attractor at phase 0", **ATTRACTOR))
    figure.legend(handles=handles, loc="outside lower center", ncols=min(len(handles), 3), frameon=False)
    ax.set_xlabel(_start_label(str(first), result.units))
    ax.set_ylabel(_start_label(str(second), result.units))
    ax.set_title(plain_text(f"{result.name}: the attractor that each start leads to"))
    return figure


def _attractor(result: Basins, k: int, more: bool) -> str:
    rows = result.attractors[result.attractors["attractor"] == k]
    period = int(rows["period"].iloc[0])
    share = float(rows["share"].iloc[0])
    others = " and others" if more and k == len(BASIN_COLORS) else ""
    return f"period {period}{others}, {_percentage(share)}"


def _percentage(share: float) -> str:
    return f"{share:.0%}" if share >= 0.01 else "< 1%"


def _draw_attractors(ax: Axes, result: Basins, first: str, second: str) -> bool:
    """Mark the points of the attractors if the grid is a coordinate and its velocity; return whether it is."""
    names = list(result.attractors.columns)
    across = first.rstrip("0").rstrip("_")
    up = second.rstrip("0").rstrip("_")
    nodes = [name[2:] for name in names if name.startswith("v_")]
    up = f"v_{across}" if up == "v" and across in nodes else up
    if across not in names or up not in names:
        return False
    limits = ax.axis()
    ax.plot(result.attractors[across], result.attractors[up], ls="none", **ATTRACTOR)
    ax.axis(limits)
    return True


def _edges(x: Array) -> Array:
    """Return the edges of the cells around grid points."""
    if len(x) == 1:
        return np.array([x[0] - 0.5, x[0] + 0.5])
    middle = 0.5 * (x[1:] + x[:-1])
    return np.concatenate([[2.0 * x[0] - middle[0]], middle, [2.0 * x[-1] - middle[-1]]])


@style()
@checked
def plot_orbit(orbit: PeriodicOrbit, *, node: str | None = None) -> Figure:
    """Draw a periodic orbit in the phase plane of a coordinate, beside its Floquet multipliers and the unit circle.

    Parameters
    ----------
    orbit : PeriodicOrbit
        Of `lcpimpact.periodic_orbit`.
    node : str, optional
        Coordinate; by default the first with a mass.

    Raises
    ------
    InputError
        For an unknown coordinate.
    """
    d = orbit.problem.dynamics
    if node is not None and node not in d.nodes:
        raise InputError(nearest(node, list(d.nodes), "coordinate"))
    massive = np.flatnonzero(d.massive)
    i = d.nodes.index(node) if node is not None else int(massive[0]) if len(massive) else 0
    figure = Drawing(figsize=(7.6, 3.9), layout="constrained")
    phase, circle = figure.subplots(1, 2)

    joins = np.array(sorted({event.t for event in orbit.events}))
    fine = np.union1d(np.linspace(orbit.start, orbit.start + orbit.T, CURVE_POINTS, endpoint=False), joins)
    left = orbit.sample(joins, "left")
    right = orbit.sample(joins, "right")
    now = orbit.sample(fine)
    # An event contributes the left limit, a break, and the right limit.
    gap = np.full(len(joins), np.nan)
    after = np.repeat(np.searchsorted(fine, joins), 2)
    q = np.insert(now.q[:, i], after, np.column_stack([left.q[:, i], gap]).ravel())
    v = np.insert(now.v[:, i], after, np.column_stack([left.v[:, i], gap]).ravel())
    phase.plot(np.append(q, q[0]), np.append(v, v[0]), color=PALETTE[0])
    jumps = np.abs(right.v[:, i] - left.v[:, i]) > 1e-9 * np.abs(now.v[:, i]).max()
    for before, behind, x, y in zip(
        left.v[jumps, i], right.v[jumps, i], left.q[jumps, i], right.q[jumps, i], strict=True
    ):
        phase.plot([x, y], [before, behind], color=PALETTE[1], lw=1.4, ls="--")
    phase.plot(left.q[:, i], left.v[:, i], "o", color=PALETTE[1], ms=4.0)
    if jumps.any():
        handle = Line2D([], [], color=PALETTE[1], marker="o", ms=4.0, ls="--", lw=1.4, label="impact, from the dot")
        phase.legend(handles=[handle], loc="upper left", bbox_to_anchor=(0.0, -0.16), frameon=False)
    phase.set_xlabel(_label(d.nodes[i], orbit.problem.units))
    phase.set_ylabel(_label(f"v_{d.nodes[i]}", orbit.problem.units))
    period = f"T = {orbit.T:.6g} {orbit.problem.unit('t')}".strip()
    phase.set_title(f"{plain_text(orbit.problem.name)}: {period}, {_impacts(orbit)}")

    turn = np.linspace(0.0, 2.0 * math.pi, 361)
    circle.fill(np.cos(turn), np.sin(turn), color=LIGHT_GREY, zorder=0)
    circle.plot(np.cos(turn), np.sin(turn), color=GREY, lw=0.9, ls="-")
    μ = orbit.floquet
    inside = np.abs(μ) < 1.0
    for which, color in ((inside, PALETTE[0]), (~inside, PALETTE[1])):
        circle.plot(μ.real[which], μ.imag[which], "o", color=color, ms=5.5, zorder=3)
    reach = 1.15 * max(1.0, float(np.abs(μ).max(initial=1.0)))
    circle.set_xlim(-reach, reach)
    circle.set_ylim(-reach, reach)
    for ax in (phase, circle):
        ax.set_box_aspect(1.0)
    circle.set_xlabel("Re μ")
    circle.set_ylabel("Im μ")
    verdict = "stable" if orbit.stable else "not stable"
    circle.set_title(f"multipliers: {verdict}, |μ| ≤ {orbit.growth:.4g}")
    return figure


def _impacts(orbit: PeriodicOrbit) -> str:
    count = len(orbit.impacts)
    return "1 impact" if count == 1 else f"{count} impacts" if count else "no impact"


def _first_node(table: pd.DataFrame) -> str:
    """Return the first node with position and velocity columns in the table of a section."""
    return next(name[2:] for name in map(str, table.columns) if name.startswith("v_"))


def _check(table: pd.DataFrame, *columns: str) -> None:
    numbers = [name for name in table.columns if name not in ("failure", "point")]
    for name in columns:
        if name not in numbers:
            raise InputError(nearest(name, numbers, "column"))
        if not pd.api.types.is_numeric_dtype(table[name]):
            raise InputError(f"column {name!r} is not numeric; choose another")


def _widen(ax: Axes) -> None:
    """Widen the axes so that points that differ by rounding error appear as one."""
    for limits, set_limits in ((ax.get_xlim(), ax.set_xlim), (ax.get_ylim(), ax.set_ylim)):
        middle = 0.5 * (limits[0] + limits[1])
        half = 0.5 * (limits[1] - limits[0])
        least = 1e-3 * max(abs(middle), 1e-3)
        if half < least:
            set_limits(middle - 100.0 * least, middle + 100.0 * least)


def _label(name: str, units: Mapping[str, str]) -> str:
    """Return the label of a column, with the unit of its coordinate where that is not m."""
    dimensionless = bool(units) and not any(units.values())
    if name in ("phase", "period"):
        return {"phase": "phase of the force"}.get(name, name)
    if name == "speed":
        return axis_label("speed of the impact", "" if dimensionless else "m/s")
    if name == "t":
        return axis_label("$t$", "" if dimensionless else "s")
    if name.startswith("v_"):
        unit = units.get(name[2:], "m")
        return axis_label(f"{math_text(name[2:])}'", unit and f"{unit}/s")
    return axis_label(math_text(name), units.get(name, "m"))


def _parameter_label(name: str, units: Mapping[str, str]) -> str:
    """Return the label of a parameter, whose unit is known only in dimensionless problems."""
    return axis_label(math_text(name), "") if units and not any(units.values()) else math_text(name)


def _start_label(name: str, units: Mapping[str, str]) -> str:
    """Return the label of an initial value: x0 as x_0."""
    indexed = len(name) > 1 and name.endswith("0") and not name.endswith("_0")
    return _parameter_label(f"{name[:-1]}_0" if indexed else name, units)
