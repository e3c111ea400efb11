"""A self-contained HTML page of text, pictures and tables."""

from __future__ import annotations

import base64
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from lcpimpact import __version__
from lcpimpact.arguments import checked
from lcpimpact.files import check_output, whole_file
from lcpimpact.plotting.style import svg_text
from lcpimpact.study.result import cell

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

ENDINGS = (".html",)

SYMBOL = re.compile(r"\b([^\W\d_])_(\w+)")
"""A letter with an index, as t_1."""


@dataclass(frozen=True)
class Picture:
    """A figure of a report, with its caption.

    Attributes
    ----------
    figure : matplotlib Figure, or Path of an SVG file
    caption : str               HTML
    title : str                 alternative text
    anchor : str                name that a link may end in
    """

    figure: Figure | Path
    caption: str = ""
    title: str = ""
    anchor: str = ""


@dataclass(frozen=True)
class Section:
    """A part of a report.

    Attributes
    ----------
    title : str
    text : str                      HTML, below the title
    figures : sequence              figures or `Picture` objects; with ``beside`` they are in one row
    table : DataFrame, optional     table with its columns as header, without the index
    form : str                      format specification of its numbers
    formats : mapping               column to its own format specification
    verdict : bool, optional        whether what the text states holds, which colours it
    folded : bool                   whether the table opens only on demand
    """

    title: str
    text: str = ""
    figures: Sequence[Figure | Picture] = ()
    table: pd.DataFrame | None = None
    form: str = ".3g"
    formats: Mapping[str, str] = field(default_factory=dict)
    verdict: bool | None = None
    folded: bool = False
    beside: bool = False


@checked
def write_report(path: str | Path, title: str, lead: str, sections: Sequence[Section]) -> Path:
    """Write a report to a file that ends in .html; the write is atomic.

    Parameters
    ----------
    path : str or Path
        The file.
    title : str
        Title of the page.
    lead : str
        Introduction, in HTML.
    sections : sequence of Section
        The sections in their order.

    Raises
    ------
    InputError
        For another ending, or a folder that cannot be written.
    """
    path = Path(path)
    check_output(path, ENDINGS)
    page = _rendered("page.html.j2", sections, title=title, lead=lead, version=__version__)
    with whole_file(path) as part:
        part.write_text(page, encoding="utf-8")
    return path


def fragment(lead: str, sections: Sequence[Section]) -> str:
    """Return sections as HTML that stands within another page, as of a notebook.

    Parameters
    ----------
    lead : str
        The first paragraph, in HTML.
    sections : sequence of Section
        The sections in their order.
    """
    return _rendered("fragment.html.j2", sections, lead=lead)


def folded(title: str, text: str) -> str:
    """Return text that opens on demand, as HTML."""
    return f"<details><summary>{escape(title)}</summary><pre>{escape(text)}</pre></details>"


def _rendered(template: str, sections: Sequence[Section], **given: str) -> str:
    environment = Environment(
        loader=PackageLoader("lcpimpact.report", ""), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    shown = [
        {
            **vars(section),
            "figures": [_picture(each) for each in section.figures],
            "table": None if section.table is None else _table(section),
        }
        for section in sections
    ]
    return environment.get_template(template).render(sections=shown, **given)


def _picture(given: Figure | Picture) -> dict[str, Any]:
    picture = given if isinstance(given, Picture) else Picture(given)
    here = picture.figure
    svg = here.read_bytes() if isinstance(here, Path) else svg_text(here).encode()
    return {**vars(picture), "data": "data:image/svg+xml;base64," + base64.b64encode(svg).decode("ascii")}


def _table(section: Section) -> dict[str, Any]:
    table = section.table
    assert table is not None
    words = [not any(isinstance(value, (int, float)) for value in table[name]) for name in table.columns]
    forms = [section.formats.get(str(name), section.form) for name in table.columns]
    rows = [list(map(cell, row, forms)) for row in table.itertuples(index=False, name=None)]
    return {"header": [_typeset(str(name)) for name in table.columns], "words": words, "rows": rows}


def _typeset(name: str) -> str:
    """Return the head of a column as HTML, with the index of a symbol of one letter as such."""
    return SYMBOL.sub(r"<i>\1</i><sub>\2</sub>", escape(name))
