"""The picture of sensitivities: a tornado of each output."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from lcpimpact.arguments import checked
from lcpimpact.plotting.style import INK, PALETTE, Drawing, style
from lcpimpact.plotting.timeline import plain_text
from lcpimpact.study.sensitivity import Sensitivity


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
    table, names = found.relative, list(found.parameters)
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
        ax.set_xlabel("change in % for 1 % of the parameter")
    for ax in panels[len(table) :]:
        ax.set_axis_off()
    return figure
