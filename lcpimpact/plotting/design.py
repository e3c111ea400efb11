"""Plots of a designed impact and of a fit."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from lcpimpact.arguments import checked
from lcpimpact.plotting.style import EXACT, GREY, INK, LIGHT_GREY, PALETTE, Drawing, Look, style
from lcpimpact.plotting.timeline import axis_label, math_text, plain_text
from lcpimpact.plotting.vertical import axes_of
from lcpimpact.reading import read
from lcpimpact.study.design.fit import Fit
from lcpimpact.study.design.sizing import Design, unit_of

POINTS = 1200
"""Number of points of a curve."""

REQUIRED_COLOR, RESULT_COLOR = PALETTE[1], GREY
"""Colours of required and resulting values."""

SYMBOLS = {
    "e": "$e$", "contact_time": "$t_c$", "peak_force": "$F_\\mathrm{max}$", "deflection": "$x_\\mathrm{max}$",
    "k": "$k$", "c": "$c$", "b": "$b$", "A": "$A$", "n": "$n$",
}  # fmt: skip


class Scale(NamedTuple):
    """A unit, and the number of it in the SI unit."""

    factor: float
    unit: str


@style()
@checked
def plot_design(design: Design) -> Figure:
    """Draw the force over time and over the displacement of the mass, with the required values marked.

    The area of the loop is the dissipated energy. Required values are drawn in colour, others in grey.

    Parameters
    ----------
    design : Design
        Result of `lcpimpact.design`, which is simulated.

    Examples
    --------
    >>> from lcpimpact import design
    >>> figure = design("kelvin-voigt", m=1.0, v0=2.0, e=0.5, contact_time=0.01).plot()
    >>> [ax.get_xlabel() for ax in figure.axes]
    ['$t$ [ms]', '$x$ [mm]']
    """
    run = design.simulate()
    end = min(design.contact_time, float(run.t[-1]))
    t = np.linspace(0.0, end, POINTS)
    force = read(run, design.force(run), t, "left")
    displacement = read(run, "x", t)
    force[0] = read(run, design.force(run), [0.0])[0]
    if math.isfinite(design.contact_time):
        displacement[-1] = read(run, "x", [end])[0]
    figure = Drawing(figsize=(7.0, 3.3), layout="constrained")
    over_time, over_displacement = figure.subplots(1, 2, sharey=True)
    second = _scaled(float(t[-1]), "s")
    metre = _scaled(float(np.abs(displacement).max()), "m")
    over_time.plot(np.append(0.0, t) * second.factor, np.append(0.0, force), color=PALETTE[0])
    loop = np.append(0.0, displacement) * metre.factor, np.append(0.0, force)
    over_displacement.fill(*loop, color=LIGHT_GREY)
    over_displacement.plot(*loop, color=PALETTE[0])
    over_time.set(xlabel=f"$t$ [{second.unit}]", ylabel="force on the mass [N]")
    over_displacement.set(xlabel=f"$x$ [{metre.unit}]")
    low, high = min(0.0, float(force.min())), design.peak_force
    over_time.set_ylim(low - 0.04 * (high - low), high + 0.16 * (high - low))
    for ax in (over_time, over_displacement):
        ax.margins(x=0.09)
        ax.xaxis.set_major_locator(MaxNLocator(5))
        ax.axhline(0.0, color=INK, linewidth=0.6)
        if design.g > 0.0:
            ax.axhline(design.m * design.g, color=GREY, linewidth=0.7, linestyle=":")
    if design.g > 0.0:
        over_displacement.annotate(
            "$m g$", (0.0, design.m * design.g), (3.0, 1.5), xycoords=over_displacement.get_yaxis_transform(),
            textcoords="offset points", ha="left", color=GREY, fontsize=8.5,
        )  # fmt: skip
    _mark(over_time, design, "peak_force", Scale(1.0, "N"))
    _mark(over_time, design, "contact_time", second)
    _mark(over_displacement, design, "deflection", metre)
    figure.suptitle(_title(design), x=0.01, ha="left", fontsize=10.0)
    return figure


def _scaled(largest: float, unit: str) -> Scale:
    """Return the unit, or a thousandth or millionth of it, in which a value is at least 0.1."""
    if largest >= 0.1 or largest == 0.0:
        return Scale(1.0, unit)
    return Scale(1e3, f"m{unit}") if largest >= 1e-4 else Scale(1e6, f"µ{unit}")


def _mark(ax: Axes, design: Design, name: str, scale: Scale) -> None:
    """Draw a line at one of the outputs, with its value."""
    value = getattr(design, name) * scale.factor
    if not math.isfinite(value):
        return
    color = REQUIRED_COLOR if name in design.wanted else RESULT_COLOR
    line: Look = {"color": color, "linewidth": 0.9, "linestyle": "--", "zorder": 1.8}
    look: Look = {"color": color, "fontsize": 9.0, "textcoords": "offset points"}
    text = f"{SYMBOLS[name]} = {value:.4g} {scale.unit}"
    if name == "peak_force":
        ax.axhline(value, **line)
        ax.annotate(
            text, (0.55, value), (0.0, 3.0), xycoords=ax.get_yaxis_transform(), ha="center", va="bottom", **look
        )
        return
    ax.axvline(value, **line)
    # The force has fallen where it ends, so that there is room beside the line of the contact time.
    height, va = (0.99, "top") if name == "deflection" else (0.75, "center")
    ground = {"facecolor": "white", "edgecolor": "none", "pad": 1.0, "alpha": 0.85}
    ax.annotate(
        text, (value, height), (-3.0, 0.0), xycoords=ax.get_xaxis_transform(), ha="right", va=va, bbox=ground, **look
    )


def _title(design: Design) -> str:
    """Return the title: the law, its constants, the restitution, and the required values."""
    constants = [f"{SYMBOLS[name]} = {getattr(design, name):.6g} {_unit(design, name)}" for name in ("k", "c", "b", "A")
                 if getattr(design, name) is not None]  # fmt: skip
    outcome = f"$e$ = {design.e:.4g}" if math.isfinite(design.contact_time) else "the mass stays"
    first = f"{design.law}: {', '.join(constants)}; {outcome}"
    required = [f"{SYMBOLS[name]} = {value:.6g} {_unit(design, name)}".strip() for name, value in design.wanted.items()]
    case = f"$m$ = {design.m:.4g} kg, $v_0$ = {design.v0:.4g} m/s" + (
        f", $g$ = {design.g:.4g} m/s²" if design.g else ""
    )
    return f"{first}\ngiven: {', '.join(required)}; {case}"


def _unit(design: Design, name: str) -> str:
    unit, _, power = unit_of(design.law, name, design.n).partition("^")
    return f"{unit}$^{{{power}}}$" if power else unit


@style()
@checked
def plot_fit(fit: Fit) -> Figure:
    """Draw the data and the fitted curve of each series with the residuals below, and the relative errors of targets.

    Coordinates that point downwards are drawn so, and their residuals too. Two bands lie about the curve, and about zero
    behind the residuals: where the curve is, and, lighter, where a reading is, at the level of the fit.

    Parameters
    ----------
    fit : Fit
        Of `lcpimpact.fit`.

    Examples
    --------
    >>> from lcpimpact import Target, fit, load_problem
    >>> from lcpimpact.reading import peak
    >>> found = fit(load_problem("kelvin-voigt-impact"), ["k"], outputs={"x_max": Target(lambda run: peak(run, "x"), 1.0)})
    >>> len(found.plot().axes)
    1
    """
    left = fit.residuals
    curves = [(name, rows) for name, rows in left[left["t"].notna()].groupby("series", sort=False)]
    targets = left[left["t"].isna()]
    heights = [2.4, 1.0] * len(curves) + [0.5 + 0.28 * len(targets)] * bool(len(targets))
    figure = Drawing(figsize=(7.0, 1.2 + sum(heights)), layout="constrained")
    axes = list(figure.subplots(len(heights), 1, squeeze=False, height_ratios=heights)[:, 0])
    second = fit.problem.unit("t")
    for i, (name, rows) in enumerate(curves):
        above, below = axes[2 * i], axes[2 * i + 1]
        below.sharex(above)
        band = fit.band[fit.band["series"] == name]
        for low, high, alpha, label in (
            ("reading_low", "reading_high", 0.15, f"{fit.level:.0%} of readings"),
            ("low", "high", 0.45, f"{fit.level:.0%} band of the curve"),
        ):
            known = np.isfinite(band[low]) & np.isfinite(band[high])
            look: Look = {"color": PALETTE[0], "alpha": alpha, "linewidth": 0.0, "label": label}
            above.fill_between(band["t"], band[low].where(known), band[high].where(known), **look)
            below.fill_between(band["t"], *(band[end].where(known) - band["fitted"] for end in (low, high)), **look)
        above.plot(rows["t"], rows["measured"], ".", color=GREY, markersize=3.5, label="measured", zorder=2.3)
        above.plot(band["t"], band["fitted"], color=PALETTE[0], linewidth=1.0, label="fitted", zorder=2.5)
        above.set_ylabel(axis_label(math_text(str(name)), fit.problem.unit(str(name))))
        if name in fit.run.nodes:
            axis = axes_of(fit.problem, [str(name)])[0]
            above.set_ylabel(axis.label)
            axis.orient(above)
            below.yaxis.set_inverted(axis.down)
        above.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        above.tick_params(labelbottom=False)
        below.axhline(0.0, color=INK, linewidth=0.7)
        below.vlines(rows["t"], 0.0, rows["residual"], colors=EXACT, linewidths=0.8)
        below.plot(rows["t"], rows["residual"], ".", color=PALETTE[1], markersize=3.0)
        below.set(xlabel=axis_label("$t$", second), ylabel=axis_label("residual", fit.problem.unit(str(name))))
    if len(targets):
        ax = axes[-1]
        relative = targets["residual"] / targets["measured"].abs().where(targets["measured"] != 0.0, 1.0)
        places = np.arange(len(targets))[::-1]
        ax.axvline(0.0, color=INK, linewidth=0.7)
        ax.hlines(places, 0.0, relative, colors=EXACT)
        ax.plot(relative, places, "o", color=PALETTE[1], markersize=4.5)
        pairs = zip(targets["series"], targets["measured"], strict=True)
        ax.set_yticks(places, [f"{math_text(name)} = {value:.4g}" for name, value in pairs])
        ax.set_ylim(-0.7, len(targets) - 0.3)
        widest = max(float(relative.abs().max()), 1e-12)
        ax.set(xlabel="(fitted - wanted)/|wanted|", xlim=(-1.15 * widest, 1.15 * widest))
    figure.align_ylabels(axes)
    figure.suptitle(_fit_title(fit), x=0.01, ha="left", fontsize=10.0)
    return figure


def _fit_title(fit: Fit) -> str:
    """Return the title: the parameters with their units and intervals, two per line."""
    parts = []
    for row in fit.table.itertuples():
        value = f"{math_text(row.parameter)} = {row.value:.5g} {plain_text(row.unit)}".rstrip()
        if math.isfinite(row.low) and math.isfinite(row.high):
            parts.append(f"{value} ({row.low:.5g} … {row.high:.5g})")
        else:
            parts.append(f"{value} (no interval)")
    lines = [", ".join(parts[i : i + 2]) for i in range(0, len(parts), 2)]
    return f"{plain_text(fit.problem.name)}, fitted, with {fit.level:.0%} intervals\n" + "\n".join(lines)
