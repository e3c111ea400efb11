"""Sphinx extension: docstrings hold their formulas as plain text, and the pages show them as TeX (see ``tex``)."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.ext.autosummary import autosummary_table
from sphinx.transforms import SphinxTransform
from tex import UNIT, parts, spelled, tex

SPECIAL = re.compile(r"(?P<code>``.*?``|`[^`]*`_?)|[|]|(?<=\w)_(?=\W|$)")
VERBATIM = (
    nodes.literal_block, nodes.doctest_block, nodes.math, nodes.math_block, nodes.term, nodes.classifier, nodes.reference,
    addnodes.desc_signature, addnodes.pending_xref,
)  # fmt: skip
"""What holds code, names or formulas that are TeX already."""

FORMULA = re.compile(r"[^\x00-\x7f]|\^|\w [-+=<>*/]=? ")
"""What tells a formula from a name or an argument, in a literal."""


def escape_formulas(_app: object, _what: str, _name: str, _thing: object, _options: object, lines: list[str]) -> None:
    """Escape what a formula in plain text and reStructuredText read differently, |u| and M_, outside of code."""
    literal = None  # the indentation of the line before a literal block
    for i, line in enumerate(lines):
        indent = len(line) - len(line.lstrip())
        if literal is not None and line.strip() and indent <= literal:
            literal = None
        if literal is None and not line.lstrip().startswith((">>>", "..", ":", "=")):
            lines[i] = SPECIAL.sub(lambda found: found["code"] or f"\\{found[0]}", line)
        if literal is None and (line.rstrip().endswith("::") or line.lstrip().startswith((">>>", ".. math::"))):
            literal = indent


class Formulas(SphinxTransform):
    """Replace the plain formulas of docstrings, and of the tables that list them, by TeX."""

    default_priority = 740  # before quotes become typographic, and primes with them

    def apply(self, **_: Any) -> None:
        """Go through the texts of a page."""
        described = [*self.document.findall(addnodes.desc), *self.document.findall(autosummary_table)]
        for node in {
            id(node): node for thing in described for node in thing.findall()
        }.values():  # equal texts are equal
            if isinstance(node, nodes.math | nodes.math_block):
                formula = nodes.Text(spelled(node.astext()))
                node.clear()
                node += formula  # which then knows its parent, as the transform of quotes asks
            elif isinstance(node, nodes.Text) and not _is_verbatim(node):
                _translate(node)


def _is_verbatim(text: nodes.Text) -> bool:
    """Whether a text stands in something that holds no plain formulas."""
    above: Any = text.parent
    while above is not None and not isinstance(above, VERBATIM):
        above = above.parent
    return above is not None


def _translate(text: nodes.Text) -> None:
    """Replace a text, or the literal that it is, by its formulas and the words between them."""
    parent = text.parent
    if isinstance(parent, nodes.literal):
        found = _formula(text.astext())
        if found:
            parent.parent.replace(parent, found)
        return
    if UNIT.fullmatch(text.astext()):
        return
    made: list[nodes.Node] = []
    for part, formula in parts(text.astext()):
        if formula:
            made.append(nodes.math(part, part))
        elif made and isinstance(made[-1], nodes.Text):
            made[-1] = nodes.Text(made[-1].astext() + part)
        else:
            made.append(nodes.Text(part))
    parent.replace(text, made)


def _formula(literal: str) -> nodes.math | None:
    """Return a literal that is a formula as such."""
    if not FORMULA.search(literal):
        return None
    try:
        found = tex(literal)
    except ValueError:
        return None
    return nodes.math(found, found)


def setup(app: Any) -> dict[str, Any]:
    """Register what reads docstrings before numpydoc does, and what reads the pages that are made of them."""
    app.connect("autodoc-process-docstring", escape_formulas, priority=400)
    app.add_transform(Formulas)
    return {"parallel_read_safe": True}
