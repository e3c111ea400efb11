"""Pages warn of lines that are cut, their pictures have words, and numbers and formulas stay readable on a phone."""

import io
from pathlib import Path

import pytest

pytest.importorskip("sphinx")

PAGE = r"""
The page
========

Section
-------

.. container:: cell

   .. image:: drawn.svg

*The words below the picture.*

.. container:: cell

   .. image:: other.svg

No caption.

.. image:: third.svg
   :alt: its own words

.. math:: a = b, \qquad c = d

.. math:: \left( a \qquad b \right)

==== ================
h    error
==== ================
1e-2 1.5e-03, 2 ± 0.1
==== ================

::

   {lines}
"""


@pytest.mark.slow
@pytest.mark.parametrize(("length", "warned"), [(78, False), (79, True)])
def test_pages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, length: int, warned: bool) -> None:
    from docutils import nodes
    from sphinx.application import Sphinx

    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "docs"))
    (tmp_path / "index.rst").write_text(PAGE.replace("{lines}", length * "x"), encoding="utf-8")
    for name in ("drawn", "other", "third"):
        (tmp_path / f"{name}.svg").write_text("<svg xmlns='http://www.w3.org/2000/svg'/>")
    said = io.StringIO()
    settings = {"extensions": ["sphinx.ext.mathjax", "pages"]}
    app = Sphinx(tmp_path, None, tmp_path / "out", tmp_path / "trees", "html", settings, status=None, warning=said)
    resolved: list[nodes.document] = []
    app.connect("doctree-resolved", lambda _app, page, _name: resolved.append(page), priority=900)
    app.build()
    assert ("79 characters are cut to 78" in said.getvalue()) is warned
    (page,) = resolved
    alts = [image["alt"] for image in page.findall(nodes.image)]
    assert alts == ["The words below the picture.", "Picture: Section", "its own words"]
    (row,) = (each for each in page.findall(nodes.paragraph) if "formulas" in each["classes"])
    assert [each.astext() for each in row.findall(nodes.math)] == [r"\displaystyle a = b,", r"\displaystyle c = d"]
    assert len(list(page.findall(nodes.math_block))) == 1
    numbers = [each.astext() for each in page.findall(nodes.inline) if "number" in each["classes"]]
    assert numbers == ["1e-2", "1.5e-03", "2 ± 0.1"]
