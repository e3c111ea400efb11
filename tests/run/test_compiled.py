"""Generated sources, the folder of compiled code, and the processes that compile."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from lcpimpact import background, cache, compiled
from lcpimpact.compiler.kinds import REAL, FunctionKind

pytestmark = [pytest.mark.compiled, pytest.mark.always]


KIND = FunctionKind((REAL,), REAL)


def third(x):
    return x / 3.0


# ---- texts that are compiled ----------------------------------------------------------------------------------------


TEXT = "def run(x):\n    return x * 2.0\n"
HINT = Callable[[float], float]


def test_a_text_is_compiled_and_its_code_kept(folder):
    for kept in (False, True):
        run = compiled.compiled_text(TEXT, HINT, {})
        assert (run(1.5), run.from_disk) == (3.0, kept)
    other = compiled.compiled_text(TEXT.replace("2.0", "3.0"), HINT, {})
    assert (other(1.5), other.from_disk) == (4.5, False)  # the same code but for a constant


def test_texts_of_many_patterns_do_not_fill_the_disk(folder, monkeypatch):
    """The oldest go; functions of the package stay."""
    monkeypatch.setitem(cache.forget_generated.__kwdefaults__, "most", 3)
    other = compiled.compiled(KIND)(third)
    assert other(3.0) == 1.0
    for k in range(5):
        run = compiled.compiled_text(TEXT.replace("2.0", f"{k}.0"), HINT, {})
        assert run(1.5) == 1.5 * k
        names = [*(each.name for each in (folder / "generated").iterdir())]
        assert len(names) == min(k + 1, 3)
        assert run.code_file().name in names
    assert len(list(folder.glob("third.*.o"))) == 1


def test_what_another_process_removed_meanwhile_ends_nothing(folder, monkeypatch):
    monkeypatch.setitem(cache.forget_generated.__kwdefaults__, "most", 0)
    (folder / "generated").mkdir(parents=True)
    (folder / "generated" / "gone.o").symlink_to(folder / "nowhere")
    assert compiled.compiled_text(TEXT, HINT, {})(1.5) == 3.0


# ---- whose folder ---------------------------------------------------------------------------------------------------


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="Windows")
@pytest.mark.parametrize(("mode", "kept"), [(0o700, True), (0o755, True), (0o775, False), (0o777, False)])
def test_a_folder_in_which_others_can_write_is_not_used(folder, caplog, mode, kept):
    folder.mkdir()
    folder.chmod(mode)
    function = compiled.compiled(KIND)(third)
    assert function(3.0) == 1.0
    assert bool(list(folder.rglob("*.o"))) == kept
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
        compiled.compiled_text(TEXT, HINT, {})(1.5)
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
    function = compiled.compiled(KIND)(third)
    monkeypatch.setattr(sys.modules[__name__], "third", function)
    assert function(3.0) == 1.0
    assert function.ready
    compiled.compile_ahead(("math",))
