"""Pages, examples and pictures use nothing but public names of the package, which a reader may use too."""

import ast
import re
from pathlib import Path

import pytest

import lcpimpact

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
BUILT = {"changelog.md", "reference/command-line.md"}
"""Read as a text file, and written by the build."""

PAGES = [
    ROOT / "README.md",
    *(page for page in sorted(DOCS.rglob("*.md")) if page.relative_to(DOCS).as_posix() not in BUILT),
]
SCRIPTS = [*sorted((DOCS / "gallery").glob("*.py")), *sorted((DOCS / "pictures").glob("*.py"))]
BLOCK = re.compile(r"^(```+|~~~+)(?:python|py|\{code-cell\}[^\n]*)\n(.*?)^\1$", re.DOTALL | re.MULTILINE)
PROMPTED = re.compile(r"^(?:>>>|\.\.\.) ?(.*)$", re.MULTILINE)


def code_of(page: Path) -> list[str]:
    """The blocks of Python of a page: cells without their options, sessions without their output."""
    text = page.read_text(encoding="utf-8")
    if page.suffix == ".py":
        return [text]
    found = []
    for block in (match[2] for match in BLOCK.finditer(text)):
        if block.startswith(">>>"):
            found.append("\n".join(PROMPTED.findall(block)))
        else:
            found.append(
                "\n".join(line for line in block.splitlines() if not line.startswith((":tags:", ":mystnb:", "%")))
            )
    return found


def private_names(code: str) -> list[str]:
    """The names of the package that a piece of code uses and that are not public."""
    tree = ast.parse(code)
    aliases, used = {"li"}, []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for each in node.names:
                if each.name.startswith("lcpimpact."):
                    used.append(each.name)
                elif each.name == "lcpimpact":
                    aliases.add(each.asname or each.name)
        elif isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "lcpimpact":
            if node.module != "lcpimpact":
                used.append(node.module)
            else:
                used += [each.name for each in node.names if each.name not in lcpimpact.__all__]
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in aliases:
            used += [node.attr] * (node.attr not in lcpimpact.__all__)
    return used


@pytest.mark.parametrize("page", [*PAGES, *SCRIPTS], ids=lambda page: page.relative_to(ROOT).as_posix())
def test_a_page_uses_public_names_only(page):
    assert [name for code in code_of(page) for name in private_names(code)] == []


@pytest.mark.parametrize(
    ("code", "found"),
    [
        ("import lcpimpact as li\nli.simulate(li.load_problem('system-1'), dt=1e-2)", []),
        ("from lcpimpact import Mass, load_problem", []),
        ("from lcpimpact.plotting.style import style", ["lcpimpact.plotting.style"]),
        ("def f():\n    import lcpimpact.reading", ["lcpimpact.reading"]),
        ("from lcpimpact import reading", ["reading"]),
        ("import lcpimpact as lab\nlab.study.accuracy", ["study"]),
        ("li.sumulate()", ["sumulate"]),
        ("import lcpimpact_of_mine\nfrom mine.lcpimpact import x", []),
    ],
)
def test_a_private_name_is_seen(code, found):
    assert private_names(code) == found


def test_the_code_of_pages_is_seen():
    assert len([page for page in PAGES if code_of(page)]) > 30
    assert any("li.style()" in code for code in code_of(DOCS / "course" / "lesson-01.md"))
