"""Private names of numba, and what is done without them: always run on the oldest and the newest numba."""

import ast
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from numba.types import float64 as f8

import lcpimpact
from lcpimpact import background, cache, compiled

pytestmark = [pytest.mark.compiled, pytest.mark.always]

PACKAGE = Path(lcpimpact.__file__).parent


def test_one_short_file_takes_private_names_of_numba():
    assert len((PACKAGE / "numba_internals.py").read_text(encoding="utf-8").splitlines()) <= 230
    for file in PACKAGE.rglob("*.py"):
        taken = set()
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            taken |= {node.module or ""} if isinstance(node, ast.ImportFrom) else set()
            taken |= {each.name for each in node.names} if isinstance(node, ast.Import) else set()
        private = {each for each in taken if each.startswith("numba.")} - {"numba.extending"}
        assert not private or file.name == "numba_internals.py", (file, private)


CALLS = """
import json, logging, sys
import numpy as np
from numba import types


class Words(logging.Handler):
    written = []

    def emit(self, record):
        self.written.append(record.getMessage())


logging.getLogger("lcpimpact").addHandler(Words())
{before}
from lcpimpact import compiled

f8 = types.float64
vector = f8[::1]
KIND = types.FunctionType(f8(f8))


def third(x):
    return x / 3.0


def divided(x, y):
    return THIRD(x) / y


def total(x, functions):
    f = AT(functions[0])
    s = 0.0
    for i in range(len(x)):
        s += f(x[i])
    return s


for each in (third, divided, total):
    each.__code__ = each.__code__.replace(co_filename=compiled.__file__)
THIRD = compiled.compiled(f8(f8), inline="always", allocates=False)(third)
DIVIDED = compiled.compiled(f8(f8, f8))(divided)
AT = compiled.function_at(KIND)
TOTAL = compiled.compiled(f8(vector, types.UniTuple(compiled.address_type(KIND), 1)))(total)


class Functions(tuple):
    _make = classmethod(lambda cls, items: tuple(items))


x = np.linspace(0.1, 1.0, 7)
function, arguments = compiled.call_with(TOTAL, (x,), Functions((THIRD,)), (KIND,))
found = [THIRD(1.0), DIVIDED(1, 0.0), DIVIDED(1.0, 7.0)]
found.append(function(*arguments))
print(json.dumps([[each.hex() for each in found], compiled.by_numba().__name__, Words.written]))
"""

LOSE = """
import {module} as module
owner = module{owner}
kept = vars(owner)["{name}"]
delattr(owner, "{name}")
from lcpimpact.compiled import by_numba
by_numba()
setattr(owner, "{name}", kept)  # which numba itself needs
"""

LOST = {
    "a class": LOSE.format(module="numba.core.codegen", owner="", name="JITCodeLibrary"),
    "a function": LOSE.format(module="numba.core.serialize", owner="", name="dumps"),
    "a method": LOSE.format(module="numba.core.compiler", owner=".CompileResult", name="_rebuild"),
}


def third(x):
    return x / 3.0


EXPECTED = [
    (1.0 / 3.0).hex(),
    "inf",
    (1.0 / 3.0 / 7.0).hex(),
    float(sum(x / 3.0 for x in np.linspace(0.1, 1.0, 7).tolist())).hex(),
]


def test_the_private_part_gives_the_numbers_of_python(python, tmp_path):
    for when in ("first", "later"):
        found, by, words = python(CALLS.format(before=""), NUMBA_CACHE_DIR=str(tmp_path), LCPIMPACT_COMPILE=when)
        assert (found, by, words) == (EXPECTED, "lcpimpact.numba_internals", [])


@pytest.mark.parametrize("lost", LOST)
def test_without_a_private_name_the_public_ones_do_and_it_is_said_once(python, tmp_path, lost):
    code = CALLS.format(before=LOST[lost])
    for _ in range(2):
        found, by, words = python(code, NUMBA_CACHE_DIR=str(tmp_path), LCPIMPACT_COMPILE="first")
        assert (found, by, len(words)) == (EXPECTED, "lcpimpact.numba_public", 1)
        assert "lacks what lcpimpact takes from its inner parts" in words[0]
    kept = list(tmp_path.rglob("*.nbc"))
    assert len(kept) == 4, kept  # three functions and the reading of an address, each compiled once
    assert {each.relative_to(tmp_path).parts[0] for each in kept} == {cache.source()}


@pytest.mark.parametrize("before", ["", LOST["a class"]])
def test_no_locator_of_numba_is_asked(python, tmp_path, before):
    """With one of its own, numba 0.68 found code that was compiled from an older source of a called function."""
    (tmp_path / "home").mkdir()
    here, home = tmp_path / "here", {"HOME": str(tmp_path / "home"), "XDG_CACHE_HOME": str(tmp_path / "home")}
    found, *_ = python(
        CALLS.format(before=before), NUMBA_CACHE_DIR=str(here), NUMBA_CACHE_LOCATOR_CLASSES="UserWideCacheLocator",
        LCPIMPACT_COMPILE="first", **home,
    )  # fmt: skip
    assert found == EXPECTED
    assert list(here.glob(f"{cache.source()}/**/*.nbc"))
    assert not list((tmp_path / "home").rglob("*.nb?"))


# ---- texts that are compiled ----------------------------------------------------------------------------------------


@pytest.fixture
def folder(monkeypatch, tmp_path):
    monkeypatch.setenv(compiled.WHEN_TO_COMPILE, "first")
    for module in (cache, compiled):
        monkeypatch.setattr(module, "folder", lambda: tmp_path / "code")
    monkeypatch.setattr(cache, "warned", [])
    cache.usable.cache_clear()
    yield tmp_path / "code"
    cache.usable.cache_clear()


TEXT = "def run(x):\n    return x * 2.0\n"

OTHER_TEXTS = {
    "another": TEXT.replace("2.0", "3.0").encode(),
    "truncated": TEXT.encode()[:12],
    "empty": b"",
    "binary": bytes(range(256)),
}


@pytest.mark.parametrize("kind", OTHER_TEXTS)
def test_the_text_at_hand_is_compiled_whatever_is_in_its_file(folder, kind):
    file = compiled.source_file(TEXT)
    for _ in range(2):
        assert compiled.compiled_text(TEXT, "run", f8(f8), {})(1.5) == 3.0
        file.write_bytes(OTHER_TEXTS[kind])
    other = TEXT.replace("2.0", "3.0")
    assert compiled.compiled_text(other, "run", f8(f8), {})(1.5) == 4.5  # the same code but for a constant


def test_texts_of_many_patterns_do_not_fill_the_disk(folder, monkeypatch):
    """The oldest go with their code; functions of the package stay."""
    monkeypatch.setitem(cache.forget_generated.__kwdefaults__, "most", 7)
    other = compiled.compiled(f8(f8))(third)
    assert other(3.0) == 1.0
    for k in range(5):
        text = TEXT.replace("2.0", f"{k}.0")
        assert compiled.compiled_text(text, "run", f8(f8), {})(1.5) == 1.5 * k
        names = [*(each.name for each in (folder / "generated").iterdir())]
        assert len(names) <= 9
        assert compiled.source_file(text).name in names
    assert sum(name.startswith("run-") for name in names) == 6
    assert len(list(folder.glob("third-*.nbc"))) == 2


# ---- whose folder ---------------------------------------------------------------------------------------------------


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="Windows")
@pytest.mark.parametrize(("mode", "kept"), [(0o700, True), (0o755, True), (0o775, False), (0o777, False)])
def test_a_folder_in_which_others_can_write_is_not_used(folder, caplog, mode, kept):
    folder.mkdir()
    folder.chmod(mode)
    function = compiled.compiled(f8(f8))(third)
    assert function(3.0) == 1.0
    assert bool(list(folder.rglob("*.nbc"))) == kept
    why = f"{folder} is not kept (others can write in the folder: its mode is {mode:o})"
    assert [why in each.message for each in caplog.records] == ([] if kept else [True])


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only the administrator can give it away")
def test_a_folder_of_another_user_is_not_used(folder):
    folder.mkdir()
    os.chown(folder, 4321, 4321)
    assert not cache.usable()
    assert "belongs to another user, 4321" in cache.warned[0]


def test_a_link_to_a_folder_is_not_used(folder, tmp_path):
    folder.symlink_to(tmp_path)
    assert not cache.usable()
    assert "is no folder but a link" in cache.warned[0]


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="Windows")
def test_what_is_kept_is_closed_to_others_whatever_the_umask(folder):
    before = os.umask(0)
    try:
        compiled.compiled_text(TEXT, "run", f8(f8), {})(1.5)
    finally:
        os.umask(before)
    assert {each.stat().st_mode & 0o777 for each in [folder, *folder.rglob("*")] if each.is_dir()} == {0o700}


# ---- processes beside -----------------------------------------------------------------------------------------------

PARENT = """
import time
from lcpimpact.background import start_python
print(start_python("import time; time.sleep(120.0)").pid, flush=True)
time.sleep(120.0)
"""


def runs(process):
    """Whether a process runs: one that has ended and waits for its parent does not."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="no Linux")
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGTERM])
def test_a_process_beside_ends_with_its_parent(end):
    parent = subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE, text=True)
    child = int(parent.stdout.readline())
    time.sleep(0.5)
    assert runs(child)
    parent.send_signal(end)
    assert parent.wait() == -end
    until = time.monotonic() + 30.0
    while runs(child) and time.monotonic() < until:
        time.sleep(0.05)
    parent.stdout.close()
    assert not runs(child)


@pytest.mark.parametrize("why", ["EAGAIN", "no program"])
def test_where_no_process_starts_the_function_is_compiled_here(folder, monkeypatch, why):
    def refuse(*arguments, **options):
        raise BlockingIOError(11, "Resource temporarily unavailable")

    monkeypatch.setenv(compiled.WHEN_TO_COMPILE, "later")
    monkeypatch.setattr(compiled, "PATIENCE", 0.0)
    monkeypatch.setattr(compiled, "BESIDE", compiled.Beside())
    if why == "EAGAIN":
        monkeypatch.setattr(background.subprocess, "Popen", refuse)
    else:
        monkeypatch.setattr(background.sys, "executable", None)
    function = compiled.compiled(f8(f8))(third)
    monkeypatch.setattr(sys.modules[__name__], "third", function)
    assert function(3.0) == 1.0
    assert function.ready
    compiled.compile_ahead(("math",))
