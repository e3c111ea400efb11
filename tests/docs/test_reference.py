"""The reference lists every public name once, and what the project says of itself stands in one place."""

import ast
import re
import tomllib
from pathlib import Path

import lcpimpact
from lcpimpact.integrators import METHODS
from lcpimpact.problems import PROBLEMS

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
    changelog = (ROOT / "docs" / "changelog.md").read_text(encoding="utf-8")
    released = re.search(rf"^## {re.escape(lcpimpact.__version__)} \((.*)\)$", changelog, re.MULTILINE)
    assert released
    assert f"\nversion: {lcpimpact.__version__}\ndate-released: {released[1]}\n" in citation
    assert "license: BSD-3-Clause" in citation
    newest = re.search(r"^## (.*)$", changelog, re.MULTILINE)
    assert newest
    assert newest[1] == "Unreleased" or newest[1].startswith(f"{lcpimpact.__version__} (")


def test_the_paper_has_the_sections_and_the_length_that_journals_ask_for():
    text = (ROOT / "docs" / "paper" / "paper.md").read_text(encoding="utf-8").split("---", 2)[2]
    assert 750 <= len(text.split()) <= 1750
    assert re.findall(r"^# (.*)$", text, re.MULTILINE) == [
        "Summary", "Statement of need", "State of the field", "Software design", "Research impact statement",
        "AI usage disclosure", "Acknowledgements", "References",
    ]  # fmt: skip
    known = set(
        re.findall(r"^@\w+\{(\w+),", (ROOT / "lcpimpact" / "references.bib").read_text(encoding="utf-8"), re.MULTILINE)
    )
    assert set(re.findall(r"@(\w+)", text)) <= known


def words(page):
    return " ".join((ROOT / page).read_text(encoding="utf-8").split())


def test_the_paper_and_the_readme_count_what_there_is():
    assert (len(METHODS), len(PROBLEMS)) == (19, 82)
    for page in ("README.md", "docs/paper/paper.md"):
        assert "nineteen integrators" in words(page)
        assert re.search(r"eighty-two \[?classic problems", words(page))


def test_the_use_of_generative_ai_is_said_in_the_same_words():
    statement = re.search(r"# AI usage disclosure (.*?) The same holds for this paper\.", words("docs/paper/paper.md"))
    assert statement
    assert "generative AI" in statement[1]
    assert statement[1] in words("README.md")
    assert statement[1] in words("CONTRIBUTING.md")


def test_the_lower_bounds_are_the_versions_that_are_tested():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    bounds = [*project["dependencies"], *(each for name in ("test", "solvers", "sweep") for each in extras[name])]
    asked = dict(re.fullmatch(r"([\w-]+)>=([\d.]+)(?:,<[\d.]+)?", each).groups() for each in bounds)
    tested = dict(re.findall(r"^([\w-]+)==([\d.]+)$", (ROOT / ".ci" / "lowest.txt").read_text(), re.MULTILINE))
    assert set(asked) - {"ruff", "mypy"} == set(tested)
    for name, version in tested.items():
        assert re.fullmatch(rf"{re.escape(asked[name])}(\.0)*", version), name


def test_the_tasks_run_what_contributing_says():
    tree = ast.parse((ROOT / "noxfile.py").read_text(encoding="utf-8"))
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and ast.unparse(node.func) == "session.run"]
    tasks = {" ".join(each.value for each in call.args if isinstance(each, ast.Constant)) for call in calls}
    block = re.search(r"```sh\n(.*?)```", (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"), re.DOTALL)[1]
    lines = [re.sub(r"\.venv/bin/| *#.*", "", each) for each in block.splitlines()[1:]]
    assert tasks == {command for line in lines for command in line.split(" && ")}
