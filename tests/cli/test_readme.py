"""What the README and the pages say is so: the table of errors, examples, links."""

import re
from pathlib import Path

import pytest

from lcpimpact.reproduce.runs import Case, run_case

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
METHODS = {
    "moreau-jean, $\\theta = 1/2$": ("moreau-jean", (("theta", 0.5),)),
    "moreau-jean, $\\theta = 1$": ("moreau-jean", (("theta", 1.0),)),
    "rk4-paper": ("rk4-paper", ()),
}


def table_of_errors():
    page = (ROOT / "docs" / "benchmarks" / "errors.md").read_text(encoding="utf-8")
    part = page.split("<!-- table: errors -->")[1].split("<!-- end -->")[0]
    rows = [[cell.strip() for cell in line.strip("| ").split("|")] for line in part.strip().splitlines()]
    assert rows[0] == ["system", "method", "h [s]", "sup err x [m]", "sup err x' [m/s]", "mean err R [N]"]
    return rows[2:]


def test_the_table_is_complete():
    assert len(table_of_errors()) == 4 * 3 * 3


@pytest.mark.parametrize("row", table_of_errors(), ids=lambda row: ", ".join(row[:3]))
def test_the_table_of_errors_is_as_produced(row):
    system, method, h, *errors = row
    name, options = METHODS[method]
    found = run_case(Case(system, name, options, "auto", float(h)))
    assert [f"{value:.1e}" for value in (found.sup_x, found.sup_v, found.mean_R)] == errors


def test_the_example_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    code = re.search(r"```python\n(.*?)```", README, re.DOTALL).group(1)
    assert len([line for line in code.splitlines() if line.strip()]) <= 15
    exec(compile(code, "README.md", "exec"), {})
    said = capsys.readouterr().out
    assert "solved" in said
    assert float(said.split()[-1]) < 2e-5
    assert (tmp_path / "my-buffer.png").read_bytes().startswith(b"\x89PNG")


DOCS = ROOT / "docs"
PAGES = [*sorted(ROOT.glob("*.md")), ROOT / "benchmarks" / "README.md", *sorted(DOCS.rglob("*.md"))]
TESTED_ELSEWHERE = {"lcp.md", "elements.md", "scheme-files.md", "run-files.md", "problems.md"}
"""Their examples need files or hold prompts."""


def is_notebook(page: Path) -> bool:
    """Notebooks are executed by the build of the site."""
    return page.read_text(encoding="utf-8").startswith("---\njupytext")


def examples(page: Path) -> list[str]:
    return re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize(
    "page",
    [page for page in PAGES if examples(page) and page.name not in TESTED_ELSEWHERE and not is_notebook(page)],
    ids=lambda page: str(page.relative_to(ROOT)),
)
def test_the_examples_of_a_page_run(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    said = {"__name__": "example"}
    for code in examples(page):
        exec(compile(code, str(page), "exec"), said)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text(encoding="utf-8")):
        if "://" not in target:
            assert (page.parent / target).exists(), target
