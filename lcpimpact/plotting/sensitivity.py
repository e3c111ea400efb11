"""The pictures of sensitivities and of what follows from uncertain parameters: a tornado of each output."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from lcpimpact.arguments import checked
from lcpimpact.plotting.style import INK, PALETTE, Drawing, style
from lcpimpact.plotting.timeline import plain_text
from lcpimpact.study.sensitivity import Sensitivity
from lcpimpact.study.uncertainty import Uncertainty


@style()
@checked
def plot_sensitivity(found: Sensitivity, *, panels_beside: int = 2) -> Figure:
    """Draw the relative derivatives of each output as bars, the longest above: its change in % for 1 % of a parameter.

    Of an output that is 0, or of parameters that are, the bars are missing.

    Parameters
    ----------
    found : Sensitivity
        Result of `lcpimpact.sensitivity`.
    panels_beside : int
        Largest number of panels side by side.

    Examples
    --------
    >>> from lcpimpact import load_problem, sensitivity
    >>> figure = sensitivity(load_problem("bouncing-ball"), ["g", "H"], ["impact:1"], t_end=0.6).plot()
    >>> [label.get_text() for label in figure.axes[0].get_yticklabels()]
    ['g', 'H']
    """
    return _tornado(found.relative, list(found.parameters), "change in % for 1 % of the parameter", panels_beside)


@style()
@checked
def plot_uncertainty(found: Uncertainty, *, panels_beside: int = 2) -> Figure:
    """Draw the change of each output for one standard deviation of each parameter as bars, the longest above.

    Parameters
    ----------
    found : Uncertainty
        Result of `Sensitivity.uncertainty`.
    panels_beside : int
        Largest number of panels side by side.

    Examples
    --------
    >>> from lcpimpact import load_problem, sensitivity
    >>> found = sensitivity(load_problem("bouncing-ball"), ["g", "H"], ["impact:1"], t_end=0.6)
    >>> figure = found.uncertainty({"g": 0.01, "H": 0.02}).plot()
    >>> [label.get_text() for label in figure.axes[0].get_yticklabels()]
    ['g', 'H']
    """
    label = "change for one standard deviation of the parameter"
    units = [f" [{unit}]" if unit else "" for unit in found.table["unit"]]
    return _tornado(found.table.assign(output=found.table["output"] + units), list(found.values), label, panels_beside)


def _tornado(table: pd.DataFrame, names: list[str], label: str, panels_beside: int) -> Figure:
    """Draw the bars of each row of a table, a panel each."""
    columns = min(len(table), panels_beside)
    lines = -(-len(table) // columns)
    figure = Drawing(figsize=(3.5 * columns, lines * (0.9 + 0.28 * len(names))), layout="constrained")
    panels = figure.subplots(lines, columns, squeeze=False).ravel()
    for ax, (_, row) in zip(panels, table.iterrows(), strict=False):
        values = row[names].to_numpy(dtype=np.float64)
        order = np.argsort(np.nan_to_num(np.abs(values)), kind="stable")
        colors = [PALETTE[0] if value > 0.0 else PALETTE[1] for value in values[order]]
        ax.barh(np.arange(len(names)), values[order], color=colors, height=0.7)
        ax.set_yticks(np.arange(len(names)), [plain_text(names[j]) for j in order])
        ax.axvline(0.0, color=INK, linewidth=0.8)
        ax.set_title(plain_text(str(row["output"])))
        ax.set_xlabel(label)
        ax.locator_params(axis="x", nbins=4)
        ax.xaxis.set_major_formatter("{x:g}")  # a common power of ten would stand on the label
    for ax in panels[len(table) :]:
        ax.set_axis_off()
    return figure
