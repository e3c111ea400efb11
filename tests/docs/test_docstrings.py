"""The formulas of docstrings are TeX in the reference; names, units and code stay."""

import sys
from pathlib import Path

import pytest

pytest.importorskip("sphinx")
pytest.importorskip("numpydoc")

PAGE = """\
.. currentmodule:: lcpimpact

.. autosummary::
   :nosignatures:

   Bumper

.. autoclass:: Bumper

.. autoclass:: Bar
"""


@pytest.mark.slow
def test_formulas_of_docstrings_are_tex(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from docutils import nodes
    from sphinx.application import Sphinx

    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "docs"))
    (tmp_path / "index.rst").write_text(PAGE)
    extensions = ["numpydoc", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "docstrings"]
    settings = {"extensions": extensions, "numpydoc_show_class_members": False, "default_role": "py:obj"}
    app = Sphinx(
        tmp_path, None, tmp_path / "out", tmp_path / "trees", "html", settings, status=None, warning=sys.stderr
    )
    app.build()
    page = app.env.get_doctree("index")
    formulas = [each.astext() for each in page.findall(nodes.math)]
    assert formulas.count(r"0 \le u \perp R \ge 0") == 2
    assert r"U^+ = -e U^-" in formulas
    assert r"c = \sqrt{E/\rho}" in formulas
    assert not {"s", "m", "N"} & set(formulas)
    blocks = [each.astext() for each in page.findall(nodes.math_block)]
    assert any(r"\rho A \Delta x" in each for each in blocks)
    terms = [each.astext() for each in page.findall(nodes.term)]
    assert any(each.startswith("E_t") for each in terms)
    assert "“lumped”, “consistent”, “higher-order”, or" in page.astext()
