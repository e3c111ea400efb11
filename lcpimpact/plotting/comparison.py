"""Plots of comparisons, energy ledgers and cross-validations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.typing import LineStyleType

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.certificate.energy import INFLOWS, STORED
from lcpimpact.plotting.style import EXACT, GREY, INK, PALETTE, Drawing, Look, style
from lcpimpact.plotting.timeline import (
    axis_label,
    coordinates_label,
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
from lcpimpact.study.accuracy.comparison import Comparison
from lcpimpact.study.accuracy.cross_validation import CrossValidation
from lcpimpact.study.ledger import Ledger
from lcpimpact.trajectory import Trajectory

MARKS = "os^Dv<>"
"""Markers of the methods."""

MARKERS = 40
"""Approximate number of markers on a curve of forces."""

MAX_COORDINATES = 3
"""Maximum number of coordinates and of contacts drawn."""

ALLOWED: dict[str, Any] = {"marker": "|", "markersize": 15.0, "markeredgewidth": 2.4}
"""Mark of an allowed difference."""


@style()
@checked
def plot_comparison(comparison: Comparison, *, up: bool = False) -> Figure:
    """Draw all runs on one page: coordinates, forces or impulses, and the largest difference from the reference.

    The reference is a wide pale line. Coordinates that point downwards are drawn so, as in the plot of a run. Forces are
    drawn as points at their instants: one per step, or on the grid. At most three coordinates and contacts are shown.

    Parameters
    ----------
    comparison : Comparison
        With at least one run.
    up : bool
        Whether coordinates that point downwards are drawn as heights.

    Examples
    --------
    >>> from lcpimpact import compare, load_problem
    >>> figure = compare(load_problem("system-1"), ["moreau-jean", "rk4"], dt=1e-2).plot()
    >>> [ax.get_ylabel() for ax in figure.axes]
    ['coordinates [m], downwards', 'reaction [N]', 'largest difference [m]']
    """
    runs = dict(comparison.runs)
    truth = comparison.reference.trajectory if comparison.reference is not None else None
    first = truth if truth is not None else next(iter(runs.values()), None)
    if first is None:
        figure = Drawing(figsize=(7.0, 1.5), layout="constrained")
        figure.text(0.5, 0.5, "no method reached the end", ha="center", va="center", color=GREY)
        return figure
    nodes = first.problem.dynamics.nodes
    coordinates = axes_of(first.problem, [nodes[i] for i in shown_nodes(first)[:MAX_COORDINATES]], up=up)
    contacts = [first.rows[i].name for i in shown_forces(first)[:MAX_COORDINATES]]
    everyone = [first, *runs.values()]
    impulsive = any(event.impulse > 0.0 for run in everyone for event in shown_events(run))
    pushed = any(np.nan_to_num(_forces(run.forces, run, contacts)).any() for run in everyone)
    forces = bool(contacts) and (pushed or not impulsive)
    heights = [2.8, *[1.9] * (len(coordinates) - 1), *[1.9] * forces, *[1.3] * impulsive, 1.6]
    figure = Drawing(figsize=(7.0, 1.1 + sum(heights)), layout="constrained")
    axes = list(figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0])
    for ax, axis in zip(axes, coordinates, strict=False):
        _draw_coordinates(ax, axis, truth, runs)
    if forces:
        _draw_forces(axes[len(coordinates)], contacts, truth, runs)
    if impulsive:
        _draw_impulses(axes[-2], truth, runs, contacts)
        axes[-2].set_ylabel(impulse_label(first.problem))
    _draw_differences(axes[-1], first, runs)
    axes[0].set_xlim(float(first.t[0]), float(first.t[-1]))
    axes[-1].set_xlabel(axis_label("$t$", first.problem.unit("t")))
    mark_events(axes, shown_events(first))
    _legend(figure, comparison)
    figure.suptitle(plain_text(comparison.problem.name), x=0.01, ha="left", fontsize=11.0)
    return figure


def _line_style(number: int) -> Look:
    lines: tuple[LineStyleType, ...] = ("-", "--", ":", "-.")
    return {"color": PALETTE[number % len(PALETTE)], "linestyle": lines[number % len(lines)]}


def _legend(figure: Figure, comparison: Comparison) -> None:
    handles = []
    if comparison.reference is not None:
        name = comparison.reference.name.partition(" (")[0]
        handles.append(Line2D([], [], color=EXACT, linewidth=5.0, label=f"{name} (reference)"))
    for number, (label, run) in enumerate(comparison.runs.items()):
        label = plain_text(label)
        entry = label if run.dense is not None else f"{label}, $h={run.t[-1] / (len(run.t) - 1):.3g}$ s"
        look: Look = {"marker": MARKS[number % 7], "markersize": 3.6, "markerfacecolor": "none", **_line_style(number)}
        handles.append(Line2D([], [], label=entry, **look))
    figure.legend(handles=handles, loc="outside lower center", ncols=min(3, len(handles)))


def _draw_coordinates(ax: Axes, axis: CoordinateAxis, truth: Trajectory | None, runs: Mapping[str, Trajectory]) -> None:
    """Draw coordinates of all runs, and name them at the ends of the curves."""
    for number, run in enumerate(([truth] if truth is not None else []) + list(runs.values())):
        t, q, _, _ = curves(run)
        drawn = axis.values(q[:, [run.nodes.index(node) for node in axis.nodes]])
        if run is truth and number == 0:
            ax.plot(t, drawn, color=EXACT, linewidth=5.0, linestyle="-", solid_capstyle="butt")
        else:
            ax.plot(t, drawn, linewidth=1.2, **_line_style(number - (truth is not None)))
        if number == 0:
            ends = drawn[-1].tolist()
    largest = max(float(np.abs(run.q).max(initial=0.0)) for run in runs.values()) if runs else 0.0
    axis.orient(ax, largest)
    ax.set_ylabel(axis.label)
    _write_names(ax, list(zip(map(math_text, axis.nodes), ends, strict=True)))


def _draw_forces(ax: Axes, contacts: Sequence[str], truth: Trajectory | None, runs: Mapping[str, Trajectory]) -> None:
    """Draw the forces of contacts: as points at their instants, and as lines where a compliant law has them at all times."""
    everyone = ([truth] if truth is not None else []) + list(runs.values())
    first = everyone[0]
    if truth is not None:
        _, _, t, r = curves(truth)
        drawn = _forces(r, truth, contacts)
        ax.plot(t, drawn, color=EXACT, linewidth=5.0, linestyle="-", solid_capstyle="butt")
    for number, run in enumerate(runs.values()):
        look = _line_style(number)
        if run.problem.dynamics.springs and not first.problem.dynamics.springs:
            _, _, t, r = curves(run)
            ax.plot(t, _forces(r, run, contacts), linewidth=1.0, **look)
            continue
        every = max(1, len(run.t_reaction) // MARKERS)
        shift = (number * every) // max(1, len(runs))
        ax.plot(
            run.t_reaction, _forces(run.forces, run, contacts), linestyle="none", marker=MARKS[number % 7], markersize=3.6,
            markerfacecolor="none", markevery=(shift, every), color=look["color"],
        )  # fmt: skip
    ends = _forces(first.forces, first, contacts)[-1].tolist()
    _write_names(ax, list(zip(map(math_text, contacts), ends, strict=True)))
    problem = first.problem
    what = "force" if any(run.problem.dynamics.springs for run in everyone) else "reaction"
    stores = problem.dynamics.stores_energy
    ax.set_ylabel(axis_label(what, problem.unit(contacts[0])) if stores else "multipliers")


def _forces(forces: Array, run: Trajectory, contacts: Sequence[str]) -> Array:
    """Return the columns of forces (nt, nf) of a run that belong to contacts, by their names."""
    return forces[:, [run.force_names.index(name) for name in contacts]]


def _write_names(ax: Axes, names: Sequence[tuple[str, float]]) -> None:
    low, high = ax.get_ylim()
    ends: list[tuple[float, list[str]]] = []
    places = [((value - low) / (high - low), name) for name, value in names]
    for place, name in sorted(places):
        if ends and place - ends[-1][0] < 0.08:
            ends[-1][1].append(name)
        else:
            ends.append((place, [name]))
    for place, labels in ends:
        ax.annotate(
            ", ".join(labels), (1.0, place), (4.0, 0.0), xycoords="axes fraction", textcoords="offset points",
            va="center", color=INK, annotation_clip=False,
        )  # fmt: skip


def _draw_impulses(ax: Axes, truth: Trajectory | None, runs: Mapping[str, Trajectory], contacts: Sequence[str]) -> None:
    """Draw the impulses as stems: the reference wide and pale, the methods as markers."""

    def impacts(run: Trajectory) -> tuple[list[float], list[float]]:
        found = [(e.t, e.impulse) for e in run.events if e.impulse > 0.0 and e.contact in contacts]
        return [t for t, _ in found], [impulse for _, impulse in found]

    if truth is not None:
        t, impulse = impacts(truth)
        ax.vlines(t, 0.0, impulse, colors=EXACT, linewidths=4.0, zorder=1.0)
    for number, run in enumerate(runs.values()):
        ax.plot(
            *impacts(run), linestyle="none", marker=MARKS[number % 7], markersize=3.6, markerfacecolor="none",
            color=_line_style(number)["color"],
        )  # fmt: skip
    ax.set_ylim(bottom=0.0)


def _draw_differences(
    ax: Axes, truth: Trajectory, runs: Mapping[str, Trajectory], *, difference_decades: float = 9.0
) -> None:
    """Draw the largest difference of the coordinates at the grid points of each run, on a logarithmic scale.

    ``difference_decades``: number of decades below the largest difference that are drawn.
    """
    massive = truth.problem.dynamics.massive
    judged = massive if massive.any() else ~massive
    found: dict[str, float] = {}
    for number, (label, run) in enumerate(runs.items()):
        if run is truth:
            continue
        t = run.t[run.t <= truth.t[-1]]
        difference = np.abs(run.q[: len(t)] - truth.sample(t).q)[:, judged].max(axis=1)
        found[label] = float(difference.max())
        ax.semilogy(t, np.where(difference > 0.0, difference, np.nan), linewidth=1.1, **_line_style(number))
    largest = max(found.values(), default=0.0)
    least = largest * 10.0**-difference_decades
    if largest > 0.0:
        ax.set_ylim(least, 4.0 * largest)
    below = [f"{plain_text(label)} below {2.0 * each:.0e}" for label, each in found.items() if each <= least]
    ax.text(0.01, 0.03, ", ".join(below), transform=ax.transAxes, fontsize=8.0, color=GREY)
    base = next((f"from {plain_text(label)}" for label, run in runs.items() if run is truth), "")
    nodes = truth.problem.dynamics.nodes
    ax.set_ylabel(coordinates_label(truth.problem, nodes, f"difference {base}" if base else "largest difference"))


@style()
@checked
def plot_ledger(ledger: Ledger) -> Figure:
    """Draw the energy ledger: the stacked stored and dissipated energies, and the balance below.

    The potential of constant loads is relative to its minimum in the run, so that every layer is positive. The black line
    is the initial energy plus the work of loads and prescribed motions; it differs from the top layer by the balance.

    Parameters
    ----------
    ledger : Ledger
        Of any run.

    Examples
    --------
    >>> from lcpimpact import energy_ledger, load_problem, simulate
    >>> run = simulate(load_problem("system-1"), "exact", dt=1e-2, t_end=3.0)
    >>> figure = energy_ledger(run).plot()
    >>> [ax.get_ylabel() for ax in figure.axes]
    ['energy [J]', '|balance| [J]']
    """
    table = ledger.table
    t = table["t"].to_numpy()
    layers = _layers(table, ledger.dissipated)
    figure = Drawing(figsize=(7.0, 4.6), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[3.2, 1.0])
    colors = {"kinetic": PALETTE[0], "elastic": PALETTE[5], "gravity": "#a9c4da"}
    warm = iter((PALETTE[1], PALETTE[4], PALETTE[3], PALETTE[2], "#8c6d46", "#b9b2a5"))
    shades = [colors[name] if name in colors else next(warm) for name in layers]
    upper.stackplot(t, list(layers.values()), colors=shades, linewidth=0.0, alpha=0.85, rasterized=True)
    inflow = table[list(INFLOWS)].sum(axis=1).to_numpy()
    initial = sum(values[0] for values in layers.values())
    upper.plot(t, initial + inflow, color=INK, linewidth=1.2, linestyle="-")
    top = float(np.max(initial + inflow))
    upper.set(xlim=(t[0], t[-1] if t[-1] > t[0] else t[0] + 1.0), ylim=(0.0, 1.06 * top if top > 0.0 else 1.0))
    upper.set_ylabel("energy [J]")
    patches = [
        Line2D([], [], color=shade, linewidth=7.0, alpha=0.85, label=_layer_name(name))
        for name, shade in zip(layers, shades, strict=True)
    ]
    start = "at the start" if not inflow.any() else "at the start and brought in since"
    patches = [*patches[::-1], Line2D([], [], color=INK, linewidth=1.2, label=start)]
    figure.legend(handles=patches, loc="outside right center", fontsize=8.5)
    balance = np.abs(table["balance"].to_numpy())
    lower.semilogy(t, np.where(balance > 0.0, balance, np.nan), color=INK, linewidth=0.9, linestyle="-")
    lowest = max(float(ledger.scale), 1e-300) * 1e-17
    highest = max(10.0 * float(balance.max()), 1e3 * lowest)
    lower.set(ylim=(lowest, highest), ylabel="|balance| [J]", xlabel="$t$ [s]")
    title = plain_text(f"{ledger.problem.name} by {ledger.method.partition('(')[0]}")
    figure.suptitle(title, x=0.01, ha="left", fontsize=11.0)
    return figure


def _layers(
    table: pd.DataFrame, dissipated: Sequence[str], *, max_layers: int = 5, negligible_rtol: float = 1e-9
) -> dict[str, Array]:
    """Return the energies to stack, from below: the stored ones, then the losses, largest first.

    ``max_layers``: maximum number of dissipating elements with separate layers; the others are summed in one.
    ``negligible_rtol``: energy, relative to the largest, below which a layer is left out.
    """
    stored = {name: table[name].to_numpy() for name in STORED}
    # The constant of the potential is chosen so that no layer is negative.
    stored = {name: values - min(0.0, float(values.min())) for name, values in stored.items()}
    lost = {name: np.maximum(table[name].to_numpy(), 0.0) for name in dissipated}
    ranked = sorted(lost, key=lambda name: -float(lost[name][-1]))
    kept = ranked[:max_layers]
    rest = {"others": np.sum([lost[name] for name in ranked[max_layers:]], axis=0)} if ranked[max_layers:] else {}
    layers = {**{name: lost[name] for name in kept}, **rest}
    largest = max((float(values.max()) for values in [*stored.values(), *layers.values()]), default=0.0)
    # Dissipated energies only grow, so they are stacked first.
    return {name: values for name, values in {**layers, **stored}.items() if values.max() > negligible_rtol * largest}


def _layer_name(name: str) -> str:
    return {"elastic": "springs", "gravity": "constant loads"}.get(name, name)


@style()
@checked
def plot_cross_validation(verdict: CrossValidation) -> Figure:
    """Draw the difference of each route from the one it is compared with, and the allowed difference.

    Parameters
    ----------
    verdict : CrossValidation
        Of any problem.

    Examples
    --------
    >>> from lcpimpact import cross_validate, load_problem
    >>> figure = cross_validate(load_problem("system-1"), ["exact", "moreau-jean"]).plot()
    >>> [text.get_text() for text in figure.axes[0].get_yticklabels()]
    ['moreau-jean', 'exact']
    """
    table = verdict.table[(verdict.table["failure"] == "") & verdict.table["difference"].notna()].iloc[::-1]
    figure = Drawing(figsize=(7.0, 1.5 + 0.3 * max(2, len(table))), layout="constrained")
    ax = figure.add_subplot()
    scale = verdict.scale or 1.0
    lowest = 1e-17 * scale
    for place, row in enumerate(table.itertuples()):
        color = PALETTE[2] if row.agrees else PALETTE[1]
        difference = max(float(row.difference), lowest)
        ax.plot([difference, row.allowed], [place, place], color=color, linewidth=1.2, alpha=0.5, linestyle="-")
        ax.plot(difference, place, "o" if row.agrees else "X", color=color, markersize=7.0, zorder=3.0)
        ax.plot(row.allowed, place, color=INK, zorder=3.0, **ALLOWED)
    ax.set_xscale("log")
    ax.set_yticks(range(len(table)), list(map(plain_text, table["route"])))
    ax.tick_params(length=5.0, labelsize=11.0)
    ax.set_ylim(-0.6, len(table) - 0.4)
    nodes = verdict.problem.dynamics.nodes
    ax.set_xlabel(coordinates_label(verdict.problem, nodes, "largest difference of the coordinates"))
    ax.grid(visible=False, axis="y")
    handles = [
        Line2D([], [], marker="o", color=PALETTE[2], linestyle="none", label="difference: agrees"),
        Line2D([], [], color=INK, linestyle="none", label="allowed", **ALLOWED),
    ]
    if not table["agrees"].all():
        handles.insert(
            1, Line2D([], [], marker="X", color=PALETTE[1], linestyle="none", label="difference: does not agree")
        )
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    figure.suptitle(plain_text(f"{verdict.problem.name}: {verdict.outcome.value}"), x=0.01, ha="left", fontsize=11.0)
    return figure
