"""The page on choosing a method is generated, the page on writing one runs, and other packages can register theirs."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import lcpimpact as li
from lcpimpact.integrators import METHODS
from lcpimpact.registry import Registry
from lcpimpact.scheme.dynamics import Feature

DOCS = Path(__file__).parent.parent / "docs"
NEW_METHOD = (DOCS / "new-method.md").read_text(encoding="utf-8")
CODE = re.findall(r"```python\n(.*?)```", NEW_METHOD, re.DOTALL)


@pytest.fixture(scope="module")
def choose():
    spec = importlib.util.spec_from_file_location("choose", DOCS / "choose.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_page_is_up_to_date(choose):
    assert (DOCS / "integrators.md").read_text(encoding="utf-8") == choose.page(), "run: python docs/choose.py"


@pytest.mark.parametrize("name", METHODS)
def test_the_page_says_what_a_method_declares(choose, name):
    d = METHODS[name].declared
    page = choose.page()
    (row,) = re.findall(rf"^\| \[{name}\]\(#{name}\) \| (?=yes|  ?\|)(.*) \|$", page, re.MULTILINE)[:1]
    cells = [cell.strip() == "yes" for cell in row.split("|")]
    assert cells == [
        *(degree in d.relative_degrees for degree in (0, 1, 2)),
        *(feature in d.handles for feature in choose.FEATURES),
    ]
    assert set(choose.FEATURES) == set(Feature)
    assert f"## {name}\n" in page
    assert f"- Energy: {d.energy}." in page


def test_formulas_become_tex(choose):
    assert choose.markdown("a ``b``\n\n.. math:: x = 1,\n          y = 2\n\nc") == "a `b`\n\n$$x = 1,\ny = 2$$\n\nc"
    assert choose.markdown(".. math::\n\n    x = 1") == "$$\nx = 1$$"


def test_the_walk_through_runs(capsys):
    lines = [line for line in CODE[0].split("class SymplecticEuler")[1].splitlines() if line.strip()]
    assert len(lines) <= 20
    names: dict[str, object] = {"__name__": "walk"}
    for block in CODE:
        exec(compile(block, "new-method.md", "exec"), names)
    said = capsys.readouterr().out
    assert "solved" in said
    slope, scatter = map(float, said.splitlines()[-1].split())
    assert 0.65 < slope < 1.35
    assert scatter < 0.2
    # What the page's method finds is what its equations say, by a loop with floats.
    h, x, v = 1e-3, 0.0, 0.0
    run = names["run"]
    for k in range(len(run.t) - 1):
        free = v + h * 9.81
        v = max(free if x < 1.0 else min(free, -0.7 * v), -np.inf)
        x += h * v
        assert abs(run["x"][k + 1] - x) < 1e-12


PLUGIN = """
import sys
import lcpimpact as li
from lcpimpact.cli.main import main
run = li.simulate(li.load_problem("bouncing-ball"), "symplectic-euler", dt=1e-2, t_end=1.0)
assert run.success and run.method.startswith("symplectic-euler")
main(["list", "methods"])
"""


def test_another_package_registers_a_method_by_an_entry_point(tmp_path):
    (tmp_path / "plugin.py").write_text(CODE[0], encoding="utf-8")
    info = tmp_path / "plugin-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: plugin\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[lcpimpact.methods]\nsymplectic-euler = plugin:SymplecticEuler\n")
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(tmp_path)!r})\n{PLUGIN}"],
        capture_output=True, text=True, timeout=240,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "symplectic-euler" in done.stdout
    assert "folklore" in done.stdout


def test_an_entry_point_takes_no_name_that_is_taken(monkeypatch):
    class Point:
        name, value = "moreau-jean", "plugin:Other"

    monkeypatch.setattr("importlib.metadata.entry_points", lambda group: [Point] if group == "g" else [])
    registry = Registry("method", {"moreau-jean": "lcpimpact.integrators.moreau_jean:MoreauJean"}, group="g")
    assert registry["moreau-jean"] is METHODS["moreau-jean"]
    assert list(registry) == ["moreau-jean"]


def test_a_broken_entry_point_is_named(monkeypatch):
    class Point:
        name, value = "broken", "no_such_package:Method"

    monkeypatch.setattr("importlib.metadata.entry_points", lambda group: [Point])
    registry = Registry("method", {}, group="g")
    with pytest.raises(li.InputError, match=r"broken.*no_such_package"):
        registry["broken"]
