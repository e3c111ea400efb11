"""Formulas of the pages are TeX, not Unicode or ASCII in running text."""

import re
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
PLAIN = {"changelog.md", "reference/command-line.md"}
"""Read as a text file, and written by the build from the help of the commands."""

PAGES = [page for page in sorted(DOCS.rglob("*.md")) if page.relative_to(DOCS).as_posix() not in PLAIN]
NOT_PROSE = re.compile(
    r"^(```+|~~~+).*?^\1$"  # a fenced block
    r"|^\$\$.*?\$\$"  # a displayed formula
    r"|\$[^$\n]+(?:\n[^$\n]+)?\$"  # a formula in the text
    r"|`[^`]*`"  # code
    r"|^    .*?$"  # an indented block
    r"|N/mⁿ|N s\^α/m|Ω",  # units
    flags=re.DOTALL | re.MULTILINE,
)
FORMULA = re.compile(r"[α-ωΑ-ΩϑϕⁿᵀΣ⁰¹⁴-⁹⁺⁻₀-₉⟂≤≥≠≡≈∂∑√∫∞∈½‖]|(?<![ms])[²³]|<=|>=")
INDENTED = re.compile(r"^    .*[⟂ᵀ⁺⁻∂∫≤≥].*$", flags=re.MULTILINE)


def without(pattern: re.Pattern[str], text: str) -> str:
    """Return the text with the lines of each match left empty, so that line numbers stay."""
    return pattern.sub(lambda match: "\n" * match[0].count("\n"), text)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(DOCS).as_posix())
def test_formulas_are_tex(page):
    text = page.read_text(encoding="utf-8")
    prose = without(NOT_PROSE, text).split("\n")
    assert [(number, line) for number, line in enumerate(prose, 1) if FORMULA.search(line)] == []
    unfenced = without(re.compile(r"^(```+|~~~+).*?^\1$", flags=re.DOTALL | re.MULTILINE), text)
    assert INDENTED.findall(unfenced) == [], "a formula in an indented block"
    assert [(number, line) for number, line in enumerate(prose, 1) if "$" in line] == [], (
        "a dollar sign without its pair"
    )
