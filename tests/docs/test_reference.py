"""The reference lists every public name once, and what the project says of itself stands in one place."""

import re
from pathlib import Path

import lcpimpact

ROOT = Path(__file__).parents[2]


def test_the_reference_lists_every_public_name_once():
    pages = [page.read_text(encoding="utf-8") for page in (ROOT / "docs" / "reference").glob("*.md")]
    blocks = [block for page in pages for block in re.findall(r"autosummary::\n(?: +:.*\n)*\n((?: +\w+\n)+)", page)]
    listed = [name for block in blocks for name in block.split()]
    assert sorted(listed) == sorted(set(lcpimpact.__all__) - {"__version__"})


def test_the_version_stands_in_one_place():
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert 'dynamic = ["version"]' in project
    assert 'path = "lcpimpact/__init__.py"' in project
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert not re.search(r"^version:", citation, re.MULTILINE)
    assert "license: BSD-3-Clause" in citation
    newest = re.search(r"^## (.*)$", (ROOT / "docs" / "changelog.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert newest
    assert newest[1] == "Unreleased" or newest[1].startswith(f"{lcpimpact.__version__} (")


def test_the_paper_has_the_length_that_journals_ask_for():
    text = (ROOT / "docs" / "paper" / "paper.md").read_text(encoding="utf-8").split("---", 2)[2]
    assert 500 <= len(text.split()) <= 1000
    known = set(
        re.findall(r"^@\w+\{(\w+),", (ROOT / "lcpimpact" / "references.bib").read_text(encoding="utf-8"), re.MULTILINE)
    )
    assert set(re.findall(r"@(\w+)", text)) <= known
