"""Runs: the curves, the verdict and the usual quantities of an impact."""

from __future__ import annotations

from html import escape

import pandas as pd

from lcpimpact.plotting.trajectory import plot_trajectory
from lcpimpact.quantities import SUMMARY
from lcpimpact.report.report import Section, folded
from lcpimpact.sparse_run import SparseTrajectory
from lcpimpact.trajectory import Trajectory


def run(given: Trajectory) -> tuple[str, list[Section]]:
    """Return the plot of a run, whether it holds, and `Trajectory.summary`."""
    first, *lines = repr(given).split("\n")
    numbers = pd.DataFrame(
        [
            (name.replace("_", " "), value, unit)
            for (name, (unit, _)), value in zip(SUMMARY.items(), given.summary().values(), strict=True)
        ],
        columns=["quantity", "value", "unit"],
    )
    sections = [
        Section("", figures=[plot_trajectory(given)]),
        Section("", text=escape(given.message), verdict=given.success),
        Section("", table=numbers, form=".6g"),
        Section("", text=folded("Certificate and events", "\n".join(lines))),
    ]
    return f"<b>{escape(first)}</b>", sections


def sparse_run(given: SparseTrajectory) -> tuple[str, list[Section]]:
    """Return the text of a run that has no plot."""
    return f"<pre>{escape(repr(given))}</pre>", []
