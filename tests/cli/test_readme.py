"""What the README says is so: its table of errors, its example, its links."""

import re
from pathlib import Path

import pytest

from lcpimpact.reproduce.runs import Case, run_case

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
METHODS = {
    "moreau-jean, θ = 1/2": ("moreau-jean", (("theta", 0.5),)),
    "moreau-jean, θ = 1": ("moreau-jean", (("theta", 1.0),)),
    "rk4-paper": ("rk4-paper", ()),
}


def table_of_errors():
    part = README.split("<!-- table: errors -->")[1].split("<!-- end -->")[0]
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


EXAMPLES = [
    pytest.param(code, id=f"{page}-{i}")
    for page in (
        *("README.md", "docs/penalty.md", "docs/norms.md"),
        *(f"docs/{name}.md" for name in ("convergence", "comparing", "design", "dynamics", "sweeps", "many-contacts")),
    )
    for i, code in enumerate(re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL))
]


@pytest.mark.parametrize("code", EXAMPLES)
def test_every_example_runs(code, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "example", "exec"), {})


@pytest.mark.parametrize(
    "page", [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))], ids=lambda page: page.name
)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8")):
        if "://" not in target:
            assert (page.parent / target).exists(), target
