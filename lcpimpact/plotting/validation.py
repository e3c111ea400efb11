"""The plot of a validation: how far ours are from published numbers, by the tolerance of the source."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from lcpimpact.plotting.style import GREY, PALETTE, Drawing, style
from lcpimpact.validation.case import Fate
from lcpimpact.validation.validate import Validation

COLOURS = {Fate.MET: PALETTE[0], Fate.REFUTED: PALETTE[1], Fate.NOT_MET: PALETTE[3]}


@style()
def plot_validation(validation: Validation, *, least: float = 1e-6) -> Figure:
    """Draw the largest error of our methods over the tolerance, of each published number that has one.

    Parameters
    ----------
    validation : Validation
        Of `lcpimpact.validate`.
    least : float
        Part of the tolerance that smaller errors are drawn at.
    """
    table = validation.table[validation.table["tolerance"] > 0.0]
    ours = table[validation.methods].to_numpy(dtype=np.float64)
    error = np.nanmax(abs(ours - table[["published"]].to_numpy()), axis=1) / table["tolerance"].to_numpy()
    figure = Drawing(figsize=(7.0, 1.0 + 0.16 * len(table)), layout="constrained")
    axes = figure.subplots()
    places = np.arange(len(table))[::-1]
    for verdict, colour in COLOURS.items():
        mine = (table["verdict"] == verdict.value).to_numpy()
        if mine.any():
            axes.plot(
                np.maximum(error[mine], least), places[mine], "o", color=colour, markersize=4, label=verdict.value
            )
    axes.axvline(1.0, color=GREY, linewidth=1.0)
    names = [f"{row.case}: {row.quantity}" for row in table.itertuples()]
    axes.set_yticks(places, names, fontsize=6)
    axes.set(
        xscale="log", xlabel="largest error of our methods over the tolerance of the source", ylim=(-1, len(table))
    )
    axes.legend()
    return figure
