"""Solutions of LCPs, and the traces of their solvers."""

from __future__ import annotations

from html import escape

import pandas as pd

from lcpimpact.lcp.problem import LCPSolution
from lcpimpact.lcp.trace import Trace
from lcpimpact.plotting.cones import plot_cones
from lcpimpact.plotting.pivots import plot_trace
from lcpimpact.report.contents import MAX_ORDER, MAX_ROWS
from lcpimpact.report.report import Section, folded


def solution(given: LCPSolution) -> tuple[str, list[Section]]:
    """Return z and w, whether they hold, and the trace."""
    n = len(given.z)
    rows = pd.DataFrame({"i": range(1, n + 1), "z": given.z, "w": given.w}).head(MAX_ROWS)
    more = f"The first {MAX_ROWS} of {n:,} rows." if n > MAX_ROWS else ""
    sections = [
        Section("", text=escape(given.message), verdict=given.success),
        Section("", text=more, table=rows, form=".6g"),
    ]
    if given.trace is not None:
        sections += trace(given.trace)[1]
    return escape(given.explanation), sections


def trace(given: Trace) -> tuple[str, list[Section]]:
    """Return the steps with their tableaus, and of order 2 or 3 their path and the complementary cones."""
    first, *rows = str(given).split("\n")
    drawn = len(given.q) in (2, 3) and len(given) > 0
    figures = [plot_trace(given), plot_cones(given.M, given.q)] if drawn else []
    tableaus = "".join(
        folded(f"Tableau {k + 1}", given.tableau(k))
        for k in range(min(len(given), MAX_ROWS))
        if len(given.q) <= MAX_ORDER
    )
    steps = f"<pre>{escape(chr(10).join(rows[: MAX_ROWS + 1]))}</pre>"
    return escape(first), [Section("", text=steps + tableaus, figures=figures)]
