"""Sphinx extension: the lessons of the course as Jupyter notebooks, beside their pages, with a link under each title."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import jupytext
from sphinx.application import Sphinx

LESSONS = re.compile(r"course/lesson-\d+")
REFERENCE = re.compile(r"\{doc\}`([^`<]+?) *<[^`]*>`|\{eq\}`([^`]+)`|\{cite:[pt]\}`([^`]+)`")
"""What Sphinx resolves and a notebook does not: its text is kept."""

LABEL = re.compile(r"(\$\$) \(([\w-]+)\)$", re.MULTILINE)


def add_link(app: Sphinx, page: str, template: str, context: dict[str, Any], tree: object) -> None:
    """Put the link to the notebook under the title of a lesson."""
    if LESSONS.fullmatch(page):
        file = f"{Path(page).name}.ipynb"
        link = f'<p><a class="reference download" href="{file}" download>Download this lesson as a notebook</a></p>'
        context["body"] = context["body"].replace("</h1>", f"</h1>\n{link}", 1)


def write_notebooks(app: Sphinx, error: Exception | None) -> None:
    """Write each lesson as .ipynb, without outputs."""
    if error is not None or app.builder.name != "html":
        return
    for page in filter(LESSONS.fullmatch, sorted(app.env.found_docs)):
        notebook = jupytext.read(Path(app.srcdir, f"{page}.md"))
        for cell in notebook.cells:
            if cell.cell_type == "markdown":
                text = REFERENCE.sub(lambda found: next(filter(None, found.groups())), cell.source)
                cell.source = LABEL.sub(r"\1", text)
        jupytext.write(notebook, Path(app.outdir, f"{page}.ipynb"), fmt="ipynb")


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect to Sphinx."""
    app.connect("html-page-context", add_link)
    app.connect("build-finished", write_notebooks)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
