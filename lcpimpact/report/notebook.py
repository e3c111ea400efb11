"""Pictures and tables that notebooks show in place of the text of an object."""

from __future__ import annotations

from html import escape
from typing import Any

from lcpimpact.errors import LcpImpactError
from lcpimpact.registry import load
from lcpimpact.report.report import fragment

CONTENTS = {
    "Scheme": "lcpimpact.report.contents.schemes:scheme",
    "LinearComplementaritySystem": "lcpimpact.report.contents.schemes:system",
    "Lagrangian": "lcpimpact.report.contents.schemes:lagrangian",
    "Problem": "lcpimpact.report.contents.schemes:problem",
    "Trajectory": "lcpimpact.report.contents.runs:run",
    "Summary": "lcpimpact.report.contents.runs:summary",
    "SparseTrajectory": "lcpimpact.report.contents.runs:sparse_run",
    "LCPSolution": "lcpimpact.report.contents.lcps:solution",
    "Trace": "lcpimpact.report.contents.lcps:trace",
    "Study": "lcpimpact.report.contents.studies:study",
}
"""Class to the function that returns its first line, in HTML, and its sections; each is imported on its first use."""


def html_of(thing: Any) -> str:
    """Return the lead and the sections of an object as HTML; where they cannot be made, its text and the reason."""
    name = next(each.__name__ for each in type(thing).__mro__ if each.__name__ in CONTENTS)
    try:
        lead, sections = load(CONTENTS[name])(thing)
        return fragment(lead, sections)
    except LcpImpactError as error:
        return fragment(f"<pre>{escape(repr(thing))}</pre>{escape(str(error))}", [])
