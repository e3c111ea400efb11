"""The plot of a score: how many digits of each fact are right, and the error of the motion."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from lcpimpact.arguments import checked
from lcpimpact.plotting.style import EXACT, GREY, PALETTE, Drawing, style
from lcpimpact.plotting.timeline import math_text
from lcpimpact.study.accuracy.score import Score


@style()
@checked
def plot_score(score: Score, *, most_digits: float = 16.0) -> Figure:
    """Draw the right digits of each fact, and the relative error of each coordinate over time.

    Parameters
    ----------
    score : Score
        Of `lcpimpact.score`.
    most_digits : float
        Number of digits that an error of zero shows: those of a float.

    Examples
    --------
    >>> from lcpimpact import load_problem, score, simulate
    >>> run = simulate(load_problem("bouncing-ball"), dt=1e-3, t_end=1.0)
    >>> len(score(run.to_pandas(), "bouncing-ball").plot().axes)
    2
    """
    facts, errors = score.facts, score.errors
    height = 0.8 + 0.26 * len(facts)
    figure = Drawing(figsize=(7.0, 2.6 + height), layout="constrained")
    above, below = figure.subplots(2, 1, height_ratios=[height, 2.4])
    places = np.arange(len(facts))[::-1]
    told = (facts["failure"] == "").to_numpy()
    relative = np.maximum(facts["relative"].to_numpy(), 10.0**-most_digits)
    digits = np.clip(-np.log10(np.where(told, relative, 1.0)), 0.0, most_digits)
    above.barh(places[told], digits[told], height=0.6, color=PALETTE[0])
    for place in places[~told]:
        above.annotate(
            "not told", (0.0, place), (4, 0), textcoords="offset points", color=GREY, fontsize=9, va="center"
        )
    above.set_yticks(places, [math_text(symbol).replace("_∞", "$_\\infty$") for symbol in facts["quantity"]])
    above.set_ylim(-0.6, len(facts) - 0.4)
    above.tick_params(axis="y", length=0)
    above.set(
        xlim=(0.0, most_digits),
        xlabel="digits that are right",
        title=f"{score.problem.name}: {len(score.run.t)} samples",
    )
    above.grid(axis="y", visible=False)
    columns = list(errors.columns[1:])
    for i, name in enumerate(columns):
        colour = PALETTE[i % len(PALETTE)]
        # Errors below rounding would fill the axis, and zero has no logarithm.
        shown = errors[name].clip(lower=10.0 ** -(most_digits + 1.0))
        below.plot(errors["t"], shown, color=colour, linewidth=1.0, linestyle="-", label=math_text(str(name)))
    second = score.problem.unit("t")
    below.set(yscale="log", xlabel=f"$t$ [{second}]" if second else "$t$", ylabel="error over largest value")
    if columns:
        below.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    else:
        below.set(yscale="linear", yticks=[], facecolor=EXACT)
        below.set_title(f"Motion compared with {score.against.split(',')[0]}")
    return figure
