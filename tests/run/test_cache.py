"""Compiled code on the disk: damaged, foreign, without room; what is long unused goes, and nothing else."""

import errno
import json
import logging
import os
import shutil
import subprocess
import sys
import time

import pytest

from lcpimpact import background, cache, compiled
from lcpimpact.cli.main import main
from lcpimpact.compiler.kinds import REAL, FunctionKind

pytestmark = [pytest.mark.compiled, pytest.mark.always]


KIND = FunctionKind((REAL,), REAL)


def total(x):
    return x + 1.0


def double(x):
    return 2.0 * x


def made(function):
    """Compile as a new process would; return the answer for 3 and whether it came from the disk."""
    code = compiled.compiled(KIND)(function)
    return code(3.0), code.from_disk


def file(folder, name="total"):
    (found,) = folder.glob(f"{name}.*.o")
    return found


def test_compiled_code_is_read_again(folder):
    assert [made(total), made(total)] == [(4.0, False), (4.0, True)]
    assert cache.warned == []


inner = None  # a function that compiled code calls


def twice(x):
    return inner(x) + inner(x)


def once(x):
    return inner(x)


def test_what_compiled_code_calls_is_part_of_it(folder, monkeypatch):
    """It has no entry from Python before somebody calls it there."""
    code = compiled.compiled(KIND)(total)
    monkeypatch.setattr(sys.modules[__name__], "inner", code)
    assert made(twice) == (8.0, False)
    assert (code.taken_in, code.ready) == (True, False)
    assert {each.name.split(".")[0] for each in folder.glob("*.o")} == {"twice"}
    assert code(3.0) == 4.0
    assert len(list(folder.glob("total.*"))) == 1


def test_what_other_compiled_code_takes_in_is_not_compiled_by_itself(folder, monkeypatch):
    monkeypatch.setattr(compiled, "DEFERRED", [])
    monkeypatch.setattr(sys.modules[__name__], "inner", compiled.compiled(KIND)(total))
    for each in (double, once):
        compiled.compiled(KIND)(each)
    compiled.compile_imported()
    assert [each.ready for each in compiled.DEFERRED] == [False, True, True]


def test_modules_are_compiled_where_this_process_imports_them(folder, tmp_path, monkeypatch):
    """A process started in a folder with a module of the same name would else compile that one."""
    for place in ("here", "installed"):
        (tmp_path / place).mkdir()
        (tmp_path / place / "marked.py").write_text(f"open({str(tmp_path / 'imported')!r}, 'w').write({place!r})")
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setattr(sys, "path", [str(tmp_path / "installed"), *sys.path])
    compiled.compile_ahead(("marked",))
    assert (tmp_path / "imported").read_text() == "installed"


def test_modules_are_compiled_ahead_once_and_again_where_that_failed(folder, monkeypatch):
    started, codes = [], [0, 1, 0, 0]

    class Process:
        def __init__(self, command, **options):
            started.append(command[-1])
            self.code = codes.pop(0)

        def wait(self, timeout):
            return self.code

        def kill(self):
            pass

    monkeypatch.setattr(background.subprocess, "Popen", Process)
    for _ in range(3):
        compiled.compile_ahead(("one", "two"), ("three:four",))
    everything = "from lcpimpact.compiled import compile_imported; compile_imported()"
    modules = f"import one; import two; {everything}"
    assert [each.split("]; ")[1] for each in started] == [modules, "from three import four; four.resolve()"] * 2


DAMAGE = {
    "empty": lambda content: b"",
    "half": lambda content: content[: len(content) // 2],
    "zeros at the end": lambda content: content[: len(content) // 2] + bytes(len(content) // 2),
    "a changed byte": lambda content: content[:-200] + bytes([content[-200] ^ 1]) + content[-199:],
    "not ours": lambda content: b"hello, world" * 100,
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_damaged_code_is_made_anew_and_said_once(folder, damage, caplog):
    made(total), made(double)
    for name in ("total", "double"):
        for path in folder.glob(f"{name}.*.o"):
            path.write_bytes(DAMAGE[damage](path.read_bytes()))
    assert [made(total), made(double)] == [(4.0, False), (6.0, False)]
    (record,) = caplog.records
    assert record.levelno == logging.WARNING
    assert str(folder) in record.message
    assert "`lcpimpact cache --clear`" in record.message
    assert [made(total), made(double)] == [(4.0, True), (6.0, True)]


def test_the_code_of_another_function_is_not_run(folder):
    made(total), made(double)
    shutil.copy(file(folder, "double"), file(folder, "total"))
    assert made(total) == (4.0, False)
    assert "damaged" in cache.warned[0]


def test_a_full_disk_costs_a_compilation_in_each_run(folder, monkeypatch, caplog):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(cache.Path, "write_bytes", full)
    assert [made(total), made(double), made(total)] == [(4.0, False), (6.0, False), (4.0, False)]
    assert [("No space left on device" in each.message, str(folder) in each.message) for each in caplog.records] == [
        (True, True)
    ]


def test_without_a_folder_nothing_is_saved(folder, monkeypatch, caplog):
    def refuse():
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(cache, "mark_used", refuse)
    assert [made(total), made(total)] == [(4.0, False), (4.0, False)]
    (record,) = caplog.records
    assert "Permission denied" in record.message
    assert not folder.exists()


CODE = """
import json, resource, sys
from lcpimpact import compiled
from lcpimpact.compiler.kinds import REAL, FunctionKind
if {limit}:
    resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, resource.RLIM_INFINITY))
from lcpimpact.numerics.polynomials import only_root
import numpy as np
print(json.dumps([only_root(np.array([-1.0, 1.0])), int(only_root.from_disk)]))
"""


@pytest.mark.slow
def test_a_process_that_cannot_write_says_so_on_stderr_and_goes_on(tmp_path):
    (tmp_path / "file").write_text("")
    where = {"limit": (tmp_path / "cache", 512), "file": (tmp_path / "file" / "below", 0)}
    for place, limit in where.values():
        for _ in range(2):
            done = subprocess.run(
                [sys.executable, "-c", CODE.format(limit=limit)],
                env=os.environ | {"LCPIMPACT_CACHE": str(place), "LCPIMPACT_COMPILE": "first"},
                capture_output=True, text=True, timeout=240,
            )  # fmt: skip
            assert done.returncode == 0, done.stderr
            assert json.loads(done.stdout)[1] == 0
            assert done.stderr.startswith(f"lcpimpact: the compiled code in {place}")
            assert done.stderr.count("\n") == 1


@pytest.fixture
def base(tmp_path, monkeypatch):
    monkeypatch.setenv("LCPIMPACT_CACHE", str(tmp_path))
    monkeypatch.setattr(cache, "folder", lambda: tmp_path / "this")
    return tmp_path


VARIABLES = """
import json
from lcpimpact import cache, compiled
from lcpimpact.compiler import machine
print(json.dumps([str(cache.base()), machine.processor()[0], compiled.COMPILING]))
"""


def test_former_names_of_the_variables_hold_where_the_new_ones_are_not_set(python, tmp_path):
    former = {"NUMBA_CACHE_DIR": str(tmp_path / "former"), "NUMBA_CPU_NAME": "generic", "NUMBA_DISABLE_JIT": "1"}
    unset = dict.fromkeys(cache.FORMER_NAMES, "")
    assert python(VARIABLES, **former, **unset) == [str(tmp_path / "former"), "generic", False]
    new = {"LCPIMPACT_CACHE": str(tmp_path / "new"), "LCPIMPACT_CPU": "x86-64", "LCPIMPACT_COMPILE": "later"}
    assert python(VARIABLES, **former, **new) == [str(tmp_path / "new"), "x86-64", True]
    assert python(VARIABLES, **former | {"NUMBA_DISABLE_JIT": "0"}, **unset)[2]


def of_another_source(base, name, days):
    (base / name).mkdir()
    (base / name / "f.o").write_bytes(bytes(1000))
    (base / name / cache.TAG).write_text(cache.SIGNATURE)
    os.utime(base / name / cache.TAG, (time.time() - days * cache.DAY,) * 2)


def test_a_new_source_lets_go_of_what_is_long_unused(base):
    for days in (1, 2, 3, 29, 31, 400):
        of_another_source(base, f"d{days}", days)
    (base / "code-of-others").mkdir()
    cache.mark_used()
    assert sorted(each.name for each in base.iterdir()) == ["code-of-others", "d1", "d2", "d29", "d3", "this"]


def test_the_newest_few_stay_however_old(base):
    for days in (100, 200, 300, 400):
        of_another_source(base, f"d{days}", days)
    cache.mark_used()
    assert sorted(each.name for each in base.iterdir()) == ["d100", "d200", "d300", "this"]


def test_use_is_noted_once_a_day(base):
    of_another_source(base, "this", 10)
    cache.mark_used()
    tag = base / "this" / cache.TAG
    assert time.time() - tag.stat().st_mtime < 60
    before = tag.stat().st_mtime_ns
    cache.mark_used()
    assert tag.stat().st_mtime_ns == before


def test_a_folder_that_goes_while_another_process_removes_it(base, monkeypatch):
    of_another_source(base, "d1", 1)
    monkeypatch.setattr(cache.Path, "rename", lambda self, to: (_ for _ in ()).throw(FileNotFoundError))
    cache.remove(base / "d1")


def test_the_command_shows_and_clears_our_folders_only(base, capsys):
    def run(*arguments):
        with pytest.raises(SystemExit) as ended:
            main(arguments)
        assert ended.value.code == 0
        return capsys.readouterr().out

    of_another_source(base, "d1", 1)
    cache.mark_used()
    (base / "others").mkdir()
    shown = run("cache")
    assert shown.startswith(f"{base}: 0.0 MB of compiled code of 2 versions")
    assert run("cache", "--clear").strip().endswith("removed")
    assert [each.name for each in base.iterdir()] == ["others"]
    assert "of 0 versions" in run("cache")
