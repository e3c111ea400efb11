"""Studies: the summary, the picture and the table."""

from __future__ import annotations

from html import escape

from lcpimpact.report.contents import MAX_ROWS
from lcpimpact.report.report import Section
from lcpimpact.study.result import Study


def study(given: Study) -> tuple[str, list[Section]]:
    """Return the summary, the picture and the first rows of the table."""
    lines = given.summary().split("\n")
    table = given.table.head(MAX_ROWS)
    return f"<pre>{escape(chr(10).join(lines[:MAX_ROWS]))}</pre>", [
        Section("", figures=[given.plot()]),
        Section("", table=table, form=".6g", folded=True),
    ]
