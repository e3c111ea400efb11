"""Runs: the curves, the verdict and the usual quantities of an impact."""

from __future__ import annotations

from html import escape

import pandas as pd

from lcpimpact.plotting.trajectory import plot_trajectory
from lcpimpact.quantities import Summary
from lcpimpact.report.report import Section, folded
from lcpimpact.sparse_run import SparseTrajectory
from lcpimpact.trajectory import Trajectory


def run(given: Trajectory) -> tuple[str, list[Section]]:
    """Return the plot of a run, whether it holds, and `Trajectory.summary`."""
    first, *lines = str(given).split("\n")
    error = [f"Error: {line}" for line in given.error_lines()[:1]]
    error += given.error_lines()[1:]
    sections = [
        Section("", figures=[plot_trajectory(given)]),
        Section("", text=escape(given.message), verdict=given.success),
        *[Section("", text=escape("; ".join(error)))] * bool(error),
        *summary(given.summary())[1],
        Section("", text=folded("Certificate and events", "\n".join(lines))),
    ]
    return f"<b>{escape(first)}</b>", sections


def summary(given: Summary) -> tuple[str, list[Section]]:
    """Return the table of a summary."""
    table = pd.DataFrame(given.rows(), columns=["quantity", "value", "unit"])
    errors = given.errors()
    if errors:
        table["error"] = [f"{errors[name]:.1e}" if errors[name] == errors[name] else "-" for name in given]
    return "", [Section("", table=table, form=".6g")]


def sparse_run(given: SparseTrajectory) -> tuple[str, list[Section]]:
    """Return the text of a run that has no plot."""
    return f"<pre>{escape(str(given))}</pre>", []
