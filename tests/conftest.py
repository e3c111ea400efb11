"""Hypothesis profiles, compiled code warmed once, and what several test files share."""

from __future__ import annotations

import importlib
import json
import math
import os
import pkgutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from zlib import crc32

import pytest
from hypothesis import HealthCheck, settings

from lcpimpact.cache import variable

settings.register_profile("ci", deadline=None, derandomize=True, max_examples=40)
settings.register_profile("thorough", deadline=None, max_examples=1000, suppress_health_check=[HealthCheck.too_slow])
os.environ["LCPIMPACT_COMPILE"] = variable("LCPIMPACT_COMPILE") or "first"  # so that what is tested is compiled
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "ci"))

OF_COMPILED_CODE = (
    "compiler/test_language.py", "integrators/test_executors.py", "integrators/test_straight_line.py",
    "run/test_cache.py", "run/test_interpreter.py", "run/test_compiled.py",
)  # fmt: skip
collect_ignore = [] if find_spec("llvmlite") else list(OF_COMPILED_CODE)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options of a sample of the tests."""
    parser.addoption("--every", type=int, default=1, help="run one test of n of those that are selected")
    parser.addoption("--at-most", type=float, default=0.0, help="skip tests after so many seconds of the processor")


@pytest.hookimpl(trylast=True)  # after -m and -k
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Take one test of n, whatever others are there; skip what needs compiled code where there is none."""
    from lcpimpact.compiled import COMPILING

    n = config.getoption("--every")
    drawn = {each: crc32(each.nodeid.encode()) % n == 0 for each in items}
    config.hook.pytest_deselected(items=[each for each in items if not drawn[each]])
    items[:] = [each for each in items if drawn[each]]
    for each in items:
        if not COMPILING and each.get_closest_marker("compiled"):
            each.add_marker(pytest.mark.skip(reason="nothing is compiled"))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    """Skip a test once it takes too long, whatever the interrupt became on its way out (Hypothesis alters exceptions)."""
    seconds = item.config.getoption("--at-most")
    if not seconds:
        return (yield)
    late = []

    def interrupt(*_: object) -> None:
        late.append(True)
        raise TimeoutError

    signal.signal(signal.SIGVTALRM, interrupt)
    signal.setitimer(signal.ITIMER_VIRTUAL, seconds)
    try:
        return (yield)
    except BaseException:
        if late:
            pytest.skip(f"takes more than {seconds:g} s")
        raise
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)


@pytest.hookimpl(trylast=True)  # after the terminal's reporter
def pytest_configure(config: pytest.Config) -> None:
    """Compile once for all processes of pytest-xdist, which would each compile everything otherwise."""
    if not hasattr(config, "workerinput") and getattr(config.option, "numprocesses", None):
        from lcpimpact.compiled import compile_ahead

        modules = {part: modules_of(f"lcpimpact.{part}") for part in ("lcp.solvers", "integrators")}
        config.get_terminal_writer().line("compiling for all processes, some 20 s where the cache is empty")
        first = ("lcpimpact.numerics.double_double", "lcpimpact.hybrid.contact_loop", "lcpimpact.certificate")
        stepping = "lcpimpact.integrators.stepping"
        compile_ahead(
            (*modules["lcp.solvers"], f"{stepping}.sparse_kernel"),
            (*first, *modules["integrators"], f"{stepping}.newton"),
        )


def modules_of(package: str) -> list[str]:
    """Return the names of the modules of a package."""
    folder = importlib.import_module(package).__path__
    return [f"{package}.{each.name}" for each in pkgutil.iter_modules(folder) if not each.ispkg]


@pytest.fixture(scope="session", autouse=True)
def warm() -> None:
    """Compile (or load from the cache) once, so that no test pays for it."""
    import lcpimpact

    lcpimpact.solve_lcp([[2.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 1.0]], [-5.0, -6.0, 1.0])
    lcpimpact.simulate(lcpimpact.load_problem("system-2"), dt=1e-2, t_end=1e-2)


@pytest.fixture
def python() -> Callable[..., Any]:
    """Run code in a fresh interpreter with extra environment variables; return the JSON that it prints."""

    def run(code: str, **environment: str) -> Any:
        done = subprocess.run(
            [sys.executable, "-c", code], env=os.environ | environment, capture_output=True, text=True, timeout=900
        )
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return run


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty folder for compiled code, as of a new process that compiles first."""
    from lcpimpact import cache, compiled

    monkeypatch.setenv(compiled.WHEN_TO_COMPILE, "first")
    for module in (cache, compiled):
        monkeypatch.setattr(module, "folder", lambda: tmp_path / "code")
    monkeypatch.setattr(cache, "warned", [])
    cache.usable.cache_clear()
    yield tmp_path / "code"
    cache.usable.cache_clear()


@pytest.fixture(autouse=True)
def no_lines_of_progress(request, monkeypatch):
    """What a command says on standard error is its own: no line of progress falls due on a machine that is slow."""
    if "cli" in request.path.parts:
        monkeypatch.setattr("lcpimpact.logs.SECONDS_A_LINE", math.inf)
