"""Plots of sweeps: a line, a heat map with contours, parallel coordinates of samples, and Sobol' indices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.plotting.style import INK, PALETTE, Drawing, style
from lcpimpact.plotting.timeline import math_text, plain_text
from lcpimpact.registry import nearest
from lcpimpact.study.sweep_study import SweepStudy
from lcpimpact.sweeps.indices import sobol_indices
from lcpimpact.sweeps.samples import SAMPLE, swept_parameters

if TYPE_CHECKING:
    from lcpimpact.sweeps.samples import DataArray, Dataset

COLORS = "viridis"
"""Colour map, even in lightness and safe for the colour-blind."""

NO_VALUE = "#c9d0d8"
"""Colour of sets without a value."""


@style()
@checked
def plot_sweep(
    dataset: Any, output: str | None = None, *, x: str | None = None, at: Mapping[str, float] | None = None
) -> Figure:
    """Draw an output of a sweep.

    Over one parameter it is a line; over two a heat map with contours, or with ``x`` a line for each value of the other; of
    samples it is drawn in parallel coordinates, one line a sample. Sets without a value are left out, or grey.

    Parameters
    ----------
    dataset : xarray.Dataset
        Of `lcpimpact.sweep`.
    output : str, optional
        Name of an output that is a number; by default the first.
    x : str, optional
        The parameter along the horizontal axis.
    at : mapping of str to float, optional
        Values of further parameters, of which the nearest in the grid are taken.

    Raises
    ------
    InputError
        For an unknown output or parameter, more than two parameters that ``at`` leaves, and outputs without any value.

    Examples
    --------
    >>> from lcpimpact import load_problem, sweep
    >>> found = sweep(load_problem("system-1"), {"k_o": [3000.0, 4000.0, 5000.0]}, dt=1e-2)
    >>> plot_sweep(found, "R.max").axes[0].get_ylabel()
    'R.max [N]'
    """
    chosen = _chosen(dataset, output, at or {})
    if not np.isfinite(chosen.values).any():
        raise InputError(f"{chosen.name} has no value in any set: see status and message of the sweep")
    if chosen.dims == (SAMPLE,):
        return _parallel_coordinates(dataset, chosen)
    if x is not None and x not in chosen.dims:
        raise InputError(nearest(x, list(map(str, chosen.dims)), "parameter"))
    if len(chosen.dims) == 2 and x is None:
        return _heat_map(dataset, chosen)
    if len(chosen.dims) > 2:
        more = ", ".join(map(str, chosen.dims[:-2]))
        raise InputError(
            f"{len(chosen.dims)} parameters are too many for a picture: give values of {more} by at={{...}}"
        )
    return _lines(dataset, chosen, x or str(chosen.dims[0]))


def plot_sweep_study(study: SweepStudy, *, output: str | None = None) -> Figure:
    """Draw an output of a sweep, by default the first: Sobol' indices of saltelli samples, else as `plot_sweep`."""
    name = study.output(output)
    if study.dataset.attrs["rule"] == "saltelli":
        return plot_sobol(sobol_indices(study.dataset, name), f"{study.problem}: {name}")
    return plot_sweep(study.dataset, name)


@style()
@checked
def plot_sobol(table: pd.DataFrame, title: str = "") -> Figure:
    """Draw Sobol' indices of the parameters as bars with their 95 % intervals.

    Parameters
    ----------
    table : DataFrame
        Of `lcpimpact.sobol_indices`.
    title : str

    Raises
    ------
    InputError
        For another table.
    """
    for name in ("parameter", "first", "total"):
        if name not in table:
            raise InputError(f"the table has no column {name!r}: get it from sobol_indices")
    figure = Drawing(figsize=(5.2, 1.4 + 0.5 * len(table)), layout="constrained")
    ax = figure.add_subplot()
    ordered = table.sort_values("total")
    place = np.arange(len(ordered))
    for name, words, shift, color in (
        ("total", "total, with interactions", -0.19, PALETTE[5]),
        ("first", "alone", 0.19, PALETTE[0]),
    ):
        value = ordered[name].to_numpy()
        spread = np.abs([value - ordered[f"{name}_low"], ordered[f"{name}_high"] - value])
        ax.barh(place + shift, value, 0.36, color=color, label=words)
        ax.errorbar(value, place + shift, xerr=spread, fmt="none", ecolor=INK, elinewidth=0.9, capsize=2.5)
    ax.set_yticks(place, [math_text(name) for name in ordered["parameter"]])
    ax.set_ylim(-0.6, len(ordered) - 0.4)
    ax.grid(axis="y", visible=False)
    ax.axvline(0.0, color=INK, lw=0.8)
    ax.set_xlabel("part of the variance")
    ax.set_title(plain_text(title))
    handles, labels = ax.get_legend_handles_labels()
    figure.legend(handles[::-1], labels[::-1], loc="outside lower center", ncols=2, frameon=False)
    return figure


def _chosen(dataset: Dataset, output: str | None, at: Mapping[str, float]) -> DataArray:
    """Return the array of an output at values of some parameters."""
    dims = {SAMPLE, *swept_parameters(dataset)}
    numbers = [
        name for name in dataset.data_vars if name not in ("status", "message") and dims >= set(dataset[name].dims)
    ]
    if not numbers:
        raise InputError("the sweep has whole series only: take an output that is a number, as x.max")
    if output is not None and output not in numbers:
        raise InputError(nearest(output, list(map(str, numbers)), "output"))
    chosen = dataset[numbers[0] if output is None else output]
    for name in at:
        if name not in chosen.dims:
            raise InputError(f"at: {nearest(name, list(map(str, chosen.dims)), 'parameter')}")
    return chosen.sortby(list(at)).sel(dict(at), method="nearest") if at else chosen


def _label(dataset: Dataset, name: str) -> str:
    """Return the name of an output or parameter with its unit."""
    unit = dataset[name].attrs.get("units", "")
    text = math_text(name) if name in swept_parameters(dataset) else plain_text(name.replace("_", " "))
    return f"{text} [{plain_text(unit)}]" if unit else text


def _title(dataset: Dataset) -> str:
    return plain_text(f"{dataset.attrs['problem']} by {dataset.attrs['method'].split('(')[0]}")


def _lines(dataset: Dataset, chosen: DataArray, x: str, *, marked_values: int = 40) -> Figure:
    # marked_values: largest number of values of a line that are marked.
    figure = Drawing(figsize=(6.0, 3.8), layout="constrained")
    ax = figure.add_subplot()
    across = np.asarray(dataset[x])
    order = np.argsort(across)
    mark = "o" if len(across) <= marked_values else ""
    others = [str(name) for name in chosen.dims if name != x]
    values = np.asarray(chosen.transpose(x, *others)).reshape(len(across), -1)
    if not others:
        ax.plot(across[order], values[order], marker=mark, ms=3.5)
    else:
        given = np.asarray(chosen[others[0]])
        scale = _color_scale(given)
        for value, column in zip(given, values.T, strict=True):
            ax.plot(across[order], column[order], marker=mark, ms=3.0, ls="-", color=scale.to_rgba(value))
        figure.colorbar(scale, ax=ax, label=_label(dataset, others[0]), aspect=30)
    without = across[np.isnan(values).any(axis=1)]
    if len(without):
        ax.plot(
            without,
            np.full(len(without), 0.015),
            "x",
            color=PALETTE[1],
            ms=4.5,
            transform=ax.get_xaxis_transform(),
            label="no value",
        )
        figure.legend(loc="outside lower center", frameon=False)
    ax.set_xlabel(_label(dataset, x))
    ax.set_ylabel(_label(dataset, str(chosen.name)))
    ax.set_title(_title(dataset))
    return figure


def _color_scale(values: Array) -> ScalarMappable:
    """Return the scale from values to colours."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    return ScalarMappable(Normalize(low, high if high > low else low + 1.0), COLORS)


def _heat_map(dataset: Dataset, chosen: DataArray, *, min_contour: int = 4) -> Figure:
    # min_contour: least number of values of both parameters for contours.
    figure = Drawing(figsize=(5.6, 4.2), layout="constrained")
    ax = figure.add_subplot()
    up, across = map(str, chosen.dims[::-1])
    ordered = chosen.sortby([across, up])
    x, y = np.asarray(ordered[across]), np.asarray(ordered[up])
    z = np.ma.masked_invalid(np.asarray(ordered).T)
    ax.set_facecolor(NO_VALUE)
    # As an image, since viewers of vector graphics draw seams between cells.
    drawn = ax.pcolormesh(x, y, z, shading="nearest", cmap=COLORS, rasterized=True)
    if min(z.shape) >= min_contour and float(np.ptp(z.compressed())) > 0.0:
        lines = ax.contour(x, y, z, 7, colors="white", linewidths=0.8, linestyles="-")
        ax.clabel(lines, fontsize=8.0, fmt="%.4g")
    ax.grid(visible=False)
    figure.colorbar(drawn, ax=ax, label=_label(dataset, str(chosen.name)), aspect=30)
    ax.set_xlabel(_label(dataset, across))
    ax.set_ylabel(_label(dataset, up))
    grey = " (grey: no value)" if np.ma.is_masked(z) else ""
    ax.set_title(_title(dataset) + grey)
    return figure


def _parallel_coordinates(dataset: Dataset, chosen: DataArray) -> Figure:
    """Draw each sample as a line over one axis a parameter, and one of the output, whose value is its colour."""
    names = [*swept_parameters(dataset), str(chosen.name)]
    columns = np.column_stack([np.asarray(dataset[name], dtype=np.float64) for name in names])
    low = np.nanmin(columns, axis=0)
    high = np.nanmax(columns, axis=0)
    heights = (columns - low) / np.where(high > low, high - low, 1.0)
    figure = Drawing(figsize=(max(4.5, 1.5 * len(names) + 1.0), 4.0), layout="constrained")
    ax = figure.add_subplot()
    output = columns[:, -1]
    scale = _color_scale(output)
    # The greatest values are on top.
    order = np.argsort(np.where(np.isnan(output), -np.inf, output))
    heights[np.isnan(output), -1] = -0.08
    shown = [NO_VALUE if np.isnan(value) else scale.to_rgba(value) for value in output[order]]
    strands = np.stack([np.broadcast_to(np.arange(len(names)), heights.shape), heights], axis=-1)[order]
    thin = float(np.clip(30.0 / np.sqrt(len(output)), 0.4, 1.6))
    ax.add_collection(
        LineCollection(list(strands), colors=shown, linewidths=thin, alpha=0.8, rasterized=len(output) > 2_000)
    )
    _scales(ax, dataset, names, low, high)
    figure.colorbar(scale, ax=ax, label=_label(dataset, names[-1]), aspect=30)
    without = int(np.isnan(output).sum())
    ax.set_title(_title(dataset) + (f" (grey: {without} without a value)" if without else ""))
    return figure


def _scales(ax: Axes, dataset: Dataset, names: Sequence[str], low: Array, high: Array) -> None:
    """Draw the vertical axes with their ends."""
    ax.set_xlim(-0.25, len(names) - 0.75)
    ax.set_ylim(-0.1, 1.1)
    ax.grid(visible=False)
    ax.set_yticks([])
    ax.spines[["left", "bottom"]].set_visible(False)
    ax.tick_params(axis="x", length=0.0)
    ax.set_xticks(range(len(names)), [_label(dataset, name) for name in names])
    for k, (bottom, top) in enumerate(zip(low, high, strict=True)):
        ax.plot([k, k], [0.0, 1.0], color=INK, lw=1.0, ls="-", zorder=3)
        for end, value, side in ((0.0, bottom, "top"), (1.0, top, "bottom")):
            ax.annotate(
                f"{value:.4g}", (k, end), (0.0, 3.0 if end else -3.0), textcoords="offset points", ha="center", va=side,
                fontsize=8.5, color=INK, bbox={"fc": "white", "ec": "none", "pad": 0.5}, zorder=4,
            )  # fmt: skip
