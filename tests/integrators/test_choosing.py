"""The page on choosing a method is generated, the page on writing one runs, and other packages can register theirs."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import lcpimpact as li
from lcpimpact.cli.main import main
from lcpimpact.integrators import METHODS
from lcpimpact.registry import Registry
from lcpimpact.scheme.structure import Feature

DOCS = Path(__file__).parents[2] / "docs"
NEW_METHOD = (DOCS / "howto" / "new-method.md").read_text(encoding="utf-8")
CODE = re.findall(r"```python\n(.*?)```", NEW_METHOD, re.DOTALL)


@pytest.fixture(scope="module")
def choose():
    spec = importlib.util.spec_from_file_location("integrators_page", DOCS / "integrators_page.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_page_is_up_to_date(choose):
    assert (DOCS / "guide" / "integrators.md").read_text(encoding="utf-8") == choose.page(), (
        "run: python docs/integrators_page.py"
    )


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
    assert f"- Energy: {choose.with_tex(d.energy)}." in page


def test_formulas_become_tex(choose):
    assert (
        choose.markdown("a ``b.c``\n\n.. math:: x = 1,\n          y = 2\n\nso") == "a `b.c`\n\n$$x = 1,\ny = 2$$\n\nso"
    )
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


@pytest.mark.slow
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


def register(folder, package, **entries):
    """Make a package that registers methods, as an installed one does."""
    info = folder / f"{package}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
    lines = "".join(f"{name} = {value}\n" for name, value in entries.items())
    (info / "entry_points.txt").write_text(f"[lcpimpact.methods]\n{lines}")


@pytest.fixture
def plugins(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def registry():
    entries = {"moreau-jean": "lcpimpact.integrators.moreau_jean:MoreauJean"}
    return Registry("method", entries, group="lcpimpact.methods", check="lcpimpact.integrators.base:check_method")


def test_an_entry_point_takes_no_name_that_is_taken(plugins):
    register(plugins, "thief", **{"moreau-jean": "plugin:Other"})
    methods = registry()
    assert methods["moreau-jean"] is METHODS["moreau-jean"]
    assert list(methods) == ["moreau-jean"]
    assert methods.broken == {}


BROKEN = """
import dataclasses
import lcpimpact.integrators.base as base
from lcpimpact.integrators.moreau_jean import MoreauJean
number = 7
class Bare(base.Integrator):
    pass
@dataclasses.dataclass(frozen=True)
class Mute(MoreauJean):
    declared = "the best"
@dataclasses.dataclass(frozen=True)
class Boaster(MoreauJean):
    declared = dataclasses.replace(MoreauJean.declared, handles="everything")
@dataclasses.dataclass(frozen=True)
class Good(MoreauJean):
    name = "good"
"""

REASONS = {
    "no-such-package": ("nowhere:Method", "No module named 'nowhere'"),
    "no-such-name": ("broken_methods:Other", "Other"),
    "no-location": ("nothing", "ValueError"),
    "raises": ("raises_at_import:Method", "ZeroDivisionError: division by zero"),
    "leaves": ("leaves_at_import:Method", "SystemExit: 3"),
    "number": ("broken_methods:number", "7 is no class"),
    "bare": ("broken_methods:Bare", "Bare must be a dataclass"),
    "mute": ("broken_methods:Mute", "declared = 'the best' must be a Declared"),
    "boaster": ("broken_methods:Boaster", "handles = 'everything'"),
}


@pytest.fixture
def broken(plugins):
    (plugins / "broken_methods.py").write_text(BROKEN)
    (plugins / "raises_at_import.py").write_text("1 / 0\n")
    (plugins / "leaves_at_import.py").write_text("import sys\nsys.exit(3)\n")
    register(plugins, "broken_methods", good="broken_methods:Good", **{name: at for name, (at, _) in REASONS.items()})
    garbage = plugins / "garbage-1.0.dist-info"
    garbage.mkdir()
    (garbage / "entry_points.txt").write_bytes(b"[lcpimpact.methods\n\xff\xfe=")
    return plugins


def test_what_another_package_breaks_is_named_with_its_reason_and_harms_no_other(broken):
    methods = registry()
    assert list(methods) == ["moreau-jean", "good"]
    assert len(methods) == 2
    assert methods["good"].__name__ == "Good"
    assert methods.broken.keys() == REASONS.keys()
    for name, (location, reason) in REASONS.items():
        assert reason in methods.broken[name]
        assert name not in methods
        with pytest.raises(li.InputError) as refused:
            methods[name]
        for part in (name, location, reason, "repair or uninstall"):
            assert part in str(refused.value)
    with pytest.raises(li.InputError, match=r"known are moreau-jean, good$"):
        methods["moreau"]


def test_the_command_line_lists_what_is_broken_and_refuses_as_ever(broken, capsys, monkeypatch):
    monkeypatch.delitem(METHODS.__dict__, "_added", raising=False)
    monkeypatch.setattr(METHODS, "_loaded", dict(METHODS._loaded))
    monkeypatch.setattr(METHODS, "_broken", {})

    def call(*arguments):
        with pytest.raises(SystemExit) as ended:
            main(arguments)
        return ended.value.code, *capsys.readouterr()

    code, said, _ = call("list", "methods")
    assert code == 0
    for name, (_, reason) in REASONS.items():
        assert name in said
        assert reason in said
    code, _, said = call("simulate", "system-1", "--method", "leaves", "--dt", "0.1")
    assert code == 2
    assert "SystemExit: 3" in said
    assert said.count("\n") == 1
    code, _, said = call("simulate", "coulomb-oscillator", "--method", "rk4-paper", "--dt", "0.1", "--t-end", "1")
    assert code == 2
    assert "take method=" in said
    monkeypatch.undo()
    METHODS.__dict__.pop("_added", None)
