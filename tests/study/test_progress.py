"""Every study that runs for long shows its progress in one way: a bar, or a function of the caller."""

from __future__ import annotations

import inspect
from pathlib import Path

import numpy as np
import pytest

import lcpimpact as li
from lcpimpact import simulation
from lcpimpact.study.progress import counted

DRIVEN = li.load_problem("impact-oscillator")
STRUCK = li.load_problem("shaw-holmes", omega=2.7)


def touched(f):
    return li.load_problem("shaw-holmes", omega=0.8, s=1.0, f=f)


STUDIES = {
    "points": lambda watch: li.poincare(DRIVEN, "impact", skip=2, points=5, progress=watch),
    "points of steps": lambda watch: li.poincare(DRIVEN, points=3, method="moreau-jean", progress=watch),
    "Newton steps": lambda watch: li.periodic_orbit(STRUCK, transient=5, max_iter=30, progress=watch),
    "orbits": lambda watch: li.grazing(touched, (0.1, 1.0), progress=watch),
    "events": lambda watch: li.lyapunov(DRIVEN, t_end=20.0, progress=watch),
}


@pytest.mark.parametrize(("seconds", "shown"), [(np.inf, 0), (0.0, 1)])
def test_a_run_has_a_bar_once_a_block_of_steps_is_long(seconds, shown, monkeypatch):
    bars = []

    class Bar:
        def __init__(self, wanted, total, initial, **_):
            bars.append(self)
            self.total, self.passed = total, initial

        def update(self, steps):
            self.passed += steps

        __enter__ = __exit__ = lambda self, *_: None

    monkeypatch.setattr(simulation, "BLOCK_SECONDS", seconds)
    monkeypatch.setattr(simulation, "progress_bar", Bar)
    li.simulate(DRIVEN, dt=DRIVEN.t_end / 4000)
    assert [(bar.total, bar.passed) for bar in bars] == shown * [(4000, 4000)]


@pytest.mark.parametrize("what", STUDIES)
def test_a_function_sees_the_things_pass(what):
    told, passed = [], []

    def watch(items, total, what):
        told.append((total, what))
        for item in items:
            yield item
            passed.append(item)

    STUDIES[what](watch)
    ((total, words),) = told
    assert what.startswith(words)
    assert 0 < len(passed) <= total
    if words == "points":
        assert len(passed) == total


def test_a_study_stops_at_an_interrupt_of_the_function_that_watches():
    def watch(items, total, what):
        for number, item in enumerate(items):
            if number == 2:
                raise KeyboardInterrupt
            yield item

    for what in STUDIES:
        with pytest.raises(KeyboardInterrupt):
            STUDIES[what](watch)


def test_what_is_no_loop_is_counted_once():
    passed, closed = [], []

    def watch(items, total, what):
        try:
            for item in items:
                yield item
                passed.append(item)
        finally:
            closed.append(what)

    with counted(9, "roots", watch) as done:
        assert passed == []
        done(2)
        assert passed == [0, 1]
        done(1)
        done(4)
        assert passed == [0, 1, 2, 3]
    assert closed == ["roots"]
    with counted(2, "roots", list_of) as done:
        done(7)


def list_of(items, total, what):
    return list(items)


def test_every_function_of_the_package_that_shows_progress_calls_it_so():
    functions = {name: getattr(li, name) for name in li.__all__ if inspect.isfunction(getattr(li, name))}
    shows = {name for name, each in functions.items() if "progress" in inspect.signature(each).parameters}
    assert shows >= {
        "basins", "bifurcation", "compare", "continue_orbit", "convergence", "cross_validate", "fit", "grazing", "lyapunov",
        "periodic_orbit", "poincare", "simulate", "work_precision",
    }  # fmt: skip
    for name in shows:
        assert inspect.signature(functions[name]).parameters["progress"].default is True, name


NOTEBOOK = """
import json, sys, types, warnings
kernel = types.SimpleNamespace(config={"IPKernelApp": {}})
sys.modules["IPython"] = types.SimpleNamespace(get_ipython=lambda: kernel)
sys.modules["ipykernel.zmqshell"] = types.ModuleType("zmqshell")
sys.modules["ipywidgets"] = sys.modules["IPython.html"] = sys.modules["IPython.display"] = None
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    BAR
print(json.dumps([str(each.message) for each in caught]))
"""
"""A kernel of a notebook without ipywidgets."""


def test_a_notebook_without_widgets_gets_no_warning(python):
    by_tqdm = python(NOTEBOOK.replace("BAR", "from tqdm.auto import tqdm"))
    assert "IProgress not found" in by_tqdm[0], "or this is no longer needed"
    assert python(NOTEBOOK.replace("BAR", "from lcpimpact.logs import progress_bar; progress_bar(True, [1])")) == []


def test_bars_are_made_in_one_place():
    package = Path(li.__file__).parent
    assert [file.name for file in package.rglob("*.py") if "import tqdm" in file.read_text(encoding="utf-8")] == [
        "logs.py"
    ]
