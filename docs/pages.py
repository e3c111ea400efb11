"""Sphinx extension: lines that fit their column, formulas and numbers that a phone does not cut, and pictures with words."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.transforms import SphinxTransform
from sphinx.util import logging

WIDTH = 78
"""Characters of a line of code, or of what code prints, that a page shows without cutting it."""

DOCSTRINGS = "reference/names/"
"""The pages of docstrings, whose examples have the lines of the package."""

NUMBER = re.compile(r"([\d.]+e-\d+|[\d.]+ ± [\d.]+)")
"""A number that a browser would break, behind its hyphen or before its scatter."""

WIDE = 8
"""Columns from which on a table is set smaller."""

APART = re.compile(r"\\qquad\b|(?<=,)\s*\\quad\b")
"""What stands between formulas that are side by side."""


class Unbroken(SphinxTransform):
    """Keep the numbers of tables in one piece, and let formulas that stand side by side go below each other."""

    default_priority = 745  # after the formulas of docstrings

    def apply(self, **_: Any) -> None:
        """Go through the tables and the formulas of a page."""
        for columns in self.document.findall(nodes.tgroup):
            if columns["cols"] >= WIDE:
                columns.parent["classes"].append("wide")
        for cell in self.document.findall(nodes.entry):
            for text in [each for each in cell.findall(nodes.Text) if NUMBER.search(each)]:
                if isinstance(text.parent, nodes.paragraph):
                    parts = enumerate(NUMBER.split(text.astext()))
                    text.parent.replace(
                        text,
                        [
                            nodes.inline(part, part, classes=["number"]) if i % 2 else nodes.Text(part)
                            for i, part in parts
                        ],
                    )
        for formula in list(self.document.findall(nodes.math_block)):
            parts = [part.strip() for part in APART.split(formula.astext())]
            if len(parts) > 1 and not formula.get("label") and not any(map(_is_open, parts)):
                row = nodes.paragraph("", "", classes=["formulas"])
                for part in parts:
                    row += [nodes.math("", rf"\displaystyle {part}"), nodes.Text(" ")]
                formula.replace_self(row)


def _is_open(part: str) -> bool:
    """Whether a part of a formula has a brace or an environment that another part closes."""
    return r"\begin" in part or r"\end" in part or r"\left" in part or part.count("{") != part.count("}")


def check_lines(app: Sphinx, page: nodes.document, name: str) -> None:
    """Warn of lines that the column of a page would cut."""
    if name.startswith(DOCSTRINGS):
        return
    for block in page.findall(nodes.literal_block):
        for line in block.astext().splitlines():
            if len(line) > WIDTH:
                logging.getLogger(__name__).warning(
                    "%d characters are cut to %d: %s", len(line), WIDTH, line, location=name
                )


def describe_pictures(app: Sphinx, page: nodes.document, name: str) -> None:
    """Give a picture that a cell draws the words below it that are its caption, or the title of its section."""
    for image in page.findall(nodes.image):
        if "alt" not in image:
            section = _above(image, nodes.section)
            cell = _above(image, nodes.container)
            while cell is not None and _above(cell.parent, nodes.container) is not None:
                cell = _above(cell.parent, nodes.container)
            below = cell.next_node(nodes.paragraph, descend=False, siblings=True) if cell is not None else None
            if below is not None and len(below.children) == 1 and isinstance(below[0], nodes.emphasis):
                image["alt"] = below.astext()
            elif section is not None:
                image["alt"] = f"Picture: {section[0].astext()}"


def _above(node: nodes.Node | None, kind: type[nodes.Element]) -> Any:
    """Return the node, or the nearest above it, that is of a kind, or None."""
    while node is not None and not isinstance(node, kind):
        node = node.parent
    return node


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect to Sphinx."""
    app.add_transform(Unbroken)
    app.connect("doctree-resolved", check_lines)
    app.connect("doctree-resolved", describe_pictures)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
