"""The folder of a sweep holds that sweep and no other, appears whole, and what is lost of it is computed again."""

import functools
import json
import math
import os
import re
import resource
import shutil
import subprocess
import sys
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import lcpimpact as li
from lcpimpact.compiled import compiled
from lcpimpact.integrators.moreau_jean import MoreauJean
from lcpimpact.sweeps import store
from lcpimpact.sweeps.identity import digest

pytest.importorskip("xarray")
pytest.importorskip("zarr")
SYSTEM_1 = li.load_problem("system-1")


def push(amplitude):
    return lambda t: amplitude * math.sin(5.0 * t)


def push_by_default(amplitude):
    def force(t, a=amplitude):
        return a * math.sin(5.0 * t)

    return force


def push_by_global(amplitude):
    return eval("lambda t: AMPLITUDE * sin(5.0 * t)", {"AMPLITUDE": amplitude, "sin": math.sin})


def push_by_code(amplitude):
    return eval(f"lambda t: {amplitude} * sin(5.0 * t)", {"sin": math.sin})


def push_by_attribute(amplitude):
    def force(t):
        return force.amplitude * math.sin(5.0 * t)

    force.amplitude = amplitude
    return force


def push_in_a_partial(amplitude):
    return functools.partial(lambda a, t: a * math.sin(5.0 * t), amplitude)


class Push:
    def __init__(self, amplitude):
        self.amplitude = amplitude

    def __call__(self, t):
        return self.amplitude * math.sin(5.0 * t)

    def at(self, t):
        return self(t)


class Slotted:
    __slots__ = ("amplitude",)
    __init__, __call__ = Push.__init__, Push.__call__


def push_by_method(amplitude):
    return Push(amplitude).at


def push_by_class(amplitude):
    return type("Push", (), {"amplitude": amplitude, "__call__": Push.__call__})()


def push_through_a_table(amplitude):
    table = amplitude * np.sin(5.0 * np.linspace(0.0, 1.0, 101))
    return lambda t: float(table[round(100 * t)])


def push_through_numpy(amplitude):
    return np.vectorize(lambda t: amplitude * np.sin(5.0 * t), otypes=[float])


def push_remembered(amplitude):
    return functools.lru_cache(push(amplitude))


def push_within(amplitude):
    inner = push(amplitude)

    def force(t):
        return sum(inner(s) for s in (t,))

    return force


PUSHES = [
    push, push_by_default, push_by_global, push_by_code, push_by_attribute, push_in_a_partial, Push, Slotted, push_by_method,
    push_by_class, push_through_a_table, push_remembered, push_within,
]  # fmt: skip


def pushed(force, **more):
    scheme = li.Scheme(li.Mass("x", m=1.0), li.Spring("x", "ground", k=4.0), li.Load("x", f=force))
    return li.Problem("pushed", scheme, t_end=1.0, **more)


def sweep_of(problem, out, parameters=None, **options):
    given = {"Spring.k": [4.0, 5.0]} if parameters is None else parameters
    return li.sweep(
        problem, given, dt=1e-2, out=out, outputs=options.pop("outputs", ("x.max",)), progress=False, **options
    )


# ---- which sweep it is ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", PUSHES)
def test_a_function_is_known_by_what_it_does(make):
    assert digest(make(1.0), "f") == digest(make(1.0), "f") != digest(make(7.0), "f")


def test_a_function_that_calls_itself_or_a_module_is_known(tmp_path, monkeypatch):
    (tmp_path / "own_loads.py").write_text("amplitude = 1.0\n")
    monkeypatch.syspath_prepend(tmp_path)
    import own_loads

    def force(t):
        return own_loads.amplitude if t > 0.0 else force(t + 1.0)

    before = digest(force, "f")
    assert digest(force, "f") == before
    own_loads.amplitude = 2.0
    assert digest(force, "f") != before


def test_a_compiled_function_is_the_one_that_it_was_compiled_from():
    force = push(1.0)
    assert digest(compiled()(force), "f") == digest(compiled()(push(1.0)), "f")
    assert digest(compiled()(push(7.0)), "f") != digest(compiled()(force), "f")


def test_another_load_is_another_sweep_and_the_same_resumes(tmp_path, counted):
    out = tmp_path / "x.zarr"
    first = sweep_of(pushed(push(1.0)), out)["x.max"].values
    with pytest.raises(li.InputError, match="holds another sweep, which differs in the scheme"):
        sweep_of(pushed(push(7.0)), out)
    del counted[:]
    assert_array_equal(sweep_of(pushed(push(1.0)), out)["x.max"], first)
    assert counted == []
    # Response of the undamped oscillator to A sin(5 t), in closed form, at the greatest of the grid.
    t = np.linspace(0.0, 1.0, 101)
    exact = (np.sin(5.0 * t) - 2.5 * np.sin(2.0 * t)) / (4.0 - 25.0)
    np.testing.assert_allclose(first[0], exact.max(), rtol=1e-2)


def test_other_units_and_initial_values_are_another_sweep(tmp_path):
    out = tmp_path / "x.zarr"
    sweep_of(pushed(push(1.0)), out)
    for more, what in (({"units": {"x": "rad"}}, "units"), ({"v0": {"x": 1.0}}, "initial values")):
        with pytest.raises(li.InputError, match=f"differs in the {what}"):
            sweep_of(pushed(push(1.0), **more), out)


def own_method(gain):
    @dataclass(frozen=True)
    class Own(MoreauJean):
        name = "own"

        def limits(self):
            return super().limits() if gain else None

    return Own


def test_the_code_of_the_method_is_part_of_the_sweep(tmp_path):
    out = tmp_path / "x.zarr"
    sweep_of(pushed(push(1.0)), out, method=own_method(1.0)())
    sweep_of(pushed(push(1.0)), out, method=own_method(1.0)())
    with pytest.raises(li.InputError, match="differs in the code of the method"):
        sweep_of(pushed(push(1.0)), out, method=own_method(2.0)())
    with pytest.raises(li.InputError, match="differs in the method"):
        sweep_of(pushed(push(1.0)), out, method=own_method(1.0)(theta=1.0))


def test_another_version_of_lcpimpact_is_another_sweep(tmp_path, monkeypatch):
    out = tmp_path / "x.zarr"
    sweep_of(SYSTEM_1, out, {"k_o": [3000.0]})
    monkeypatch.setattr(store, "source", lambda: "another")
    with pytest.raises(li.InputError, match="differs in the source of lcpimpact"):
        sweep_of(SYSTEM_1, out, {"k_o": [3000.0]})


def test_what_has_no_content_is_refused_by_name_and_only_where_it_is_stored(tmp_path):
    numbers = (0.1 * n for n in range(10**9))
    stream = pushed(lambda t: next(numbers))
    with pytest.raises(li.InputError, match="scheme of problem 'pushed' cannot be told from another one: generator"):
        sweep_of(stream, tmp_path / "x.zarr")
    assert list(tmp_path.iterdir()) == []
    assert sweep_of(stream, None)["x.max"].shape == (2,)
    with pytest.raises(li.InputError, match="known by its name only"):
        digest(np.frompyfunc(push(1.0), 1, 1), "f")
    nested = functools.reduce(lambda inner, _: [inner], range(5000), [])
    with pytest.raises(li.InputError, match="it is nested too deeply"):
        digest(nested, "f")


SCRIPT = """
import lcpimpact as li, math, sys

class Push:
    def __init__(self, a):
        self.a, self.tags = a, {"one", "two", "three"}
    def __call__(self, t):
        return self.a * math.sin(5.0 * t)

scheme = li.Scheme(li.Mass("x", m=1.0), li.Spring("x", "ground", k=4.0), li.Load("x", f=Push(float(sys.argv[2]))))
found = li.sweep(li.Problem("p", scheme), {"Spring.k": [4.0, 5.0]}, dt=1e-2, t_end=0.1, outputs=("x.max",), out=sys.argv[1])
print(found["x.max"].values.tolist())
"""


@pytest.mark.slow
def test_another_process_resumes_and_tells_another_load(tmp_path):
    (tmp_path / "run.py").write_text(SCRIPT)

    def run(amplitude, seed):
        call = [sys.executable, tmp_path / "run.py", tmp_path / "x.zarr", amplitude]
        return subprocess.run(
            call, capture_output=True, text=True, env={**os.environ, "PYTHONHASHSEED": seed}, check=False
        )

    first = run("1", "1")
    assert first.returncode == 0, first.stderr
    assert run("1", "2").stdout == first.stdout
    assert "differs in the scheme" in run("7", "1").stderr


# ---- damage ---------------------------------------------------------------------------------------------------------


GRID = {"k_o": [3000.0, 4000.0, 5000.0], "c_o": [-1.0, 200.0, 250.0]}


def pieces(out, name):
    return sorted(path for path in (out / name).rglob("*") if path.is_file() and path.name != "zarr.json")


def lose_a_piece(out):
    pieces(out, "R.max")[1].unlink()


def lose_the_last_piece_of_a_series(out):
    pieces(out, "x")[-1].unlink()


def cut_a_piece(out):
    piece = pieces(out, "x")[2]
    piece.write_bytes(piece.read_bytes()[:20])


def change_a_byte(out):
    for name in ("R.max", "message"):
        piece = pieces(out, name)[0]
        held = bytearray(piece.read_bytes())
        held[-1] ^= 1
        piece.write_bytes(held)


def swap_two_pieces(out):
    a, b = pieces(out, "R.max")[1:3]
    held = a.read_bytes()
    a.write_bytes(b.read_bytes())
    b.write_bytes(held)


def lose_the_sums(out):
    shutil.rmtree(out / store.SUMS)


def lose_an_array(out):
    shutil.rmtree(out / "R.max")


def lose_the_status(out):
    shutil.rmtree(out / "status")


def lose_a_coordinate(out):
    shutil.rmtree(out / "k_o")


def spoil_an_array(out):
    (out / "x" / "zarr.json").write_text("[]")


def cut_the_values_of_a_parameter(out):
    pieces(out, "c_o")[0].write_bytes(b"")


DAMAGES = [
    lose_a_piece, lose_the_last_piece_of_a_series, cut_a_piece, change_a_byte, swap_two_pieces, lose_the_sums, lose_an_array,
    lose_the_status, lose_a_coordinate, spoil_an_array, cut_the_values_of_a_parameter,
]  # fmt: skip


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A finished sweep in a folder of chunks of two sets, and its results."""
    out = tmp_path_factory.mktemp("sweep") / "x.zarr"
    return out, sweep_of(SYSTEM_1, out, GRID, outputs=("R.max", "x"), t_end=0.5, chunk=2).load()


@pytest.mark.parametrize("damage", DAMAGES)
def test_what_is_lost_or_damaged_is_computed_again(damage, whole, tmp_path, counted):
    out = tmp_path / "x.zarr"
    shutil.copytree(whole[0], out)
    damage(out)
    found = sweep_of(SYSTEM_1, out, GRID, outputs=("R.max", "x"), t_end=0.5)
    assert found.load().equals(whole[1])
    assert sum(counted) <= 9
    assert bool(counted) == ("parameter" not in damage.__name__ and "coordinate" not in damage.__name__)
    del counted[:]
    assert sweep_of(SYSTEM_1, out, GRID, outputs=("R.max", "x"), t_end=0.5).load().equals(whole[1])
    assert counted == []


@pytest.mark.parametrize("text", ["[]", "", "{}", '{"zarr_format": 3}', "\0"])
def test_a_folder_that_cannot_be_read_is_refused_in_words(text, whole, tmp_path):
    out = tmp_path / "x.zarr"
    shutil.copytree(whole[0], out)
    (out / "zarr.json").write_text(text)
    with pytest.raises(li.InputError, match=r"is there, and is no sweep.*name another folder, or remove it"):
        sweep_of(SYSTEM_1, out, GRID, outputs=("R.max", "x"), t_end=0.5)


def test_a_sweep_of_the_older_form_is_refused_in_words(whole, tmp_path):
    out = tmp_path / "x.zarr"
    shutil.copytree(whole[0], out)
    described = json.loads((out / "zarr.json").read_text())
    for name in ("form", "chunk", "units", "source_of_lcpimpact"):
        described["attributes"].pop(name)
    (out / "zarr.json").write_text(json.dumps(described))
    with pytest.raises(li.InputError, match=r"is a sweep of an older lcpimpact.*remove it"):
        sweep_of(SYSTEM_1, out, GRID, outputs=("R.max", "x"), t_end=0.5)


# ---- making and writing it ------------------------------------------------------------------------------------------


def test_a_folder_appears_whole_or_not_at_all(tmp_path, monkeypatch):
    out = tmp_path / "x.zarr"
    make = store._make
    for count in range(6):
        made = []

        def ends(root, *arguments, made=made, count=count):
            made.append(make(root, *arguments))
            assert not out.exists()
            if len(made) > count:
                raise KeyboardInterrupt
            return made[-1]

        with monkeypatch.context() as patch:
            patch.setattr(store, "_make", ends)
            with pytest.raises(KeyboardInterrupt):
                sweep_of(SYSTEM_1, out, GRID)
        assert list(tmp_path.iterdir()) == []
    assert sweep_of(SYSTEM_1, out, GRID)["status"].max() == 21
    assert [path.name for path in tmp_path.iterdir()] == ["x.zarr"]


def test_of_two_that_make_it_at_once_the_second_goes_on_in_the_folder_of_the_first(tmp_path, monkeypatch):
    out = tmp_path / "x.zarr"
    consolidate = store._consolidate

    def late(path):
        consolidate(path)
        monkeypatch.setattr(store, "_consolidate", consolidate)
        sweep_of(SYSTEM_1, out, GRID, chunk=1)

    monkeypatch.setattr(store, "_consolidate", late)
    found = sweep_of(SYSTEM_1, out, GRID, chunk=3)
    assert store.import_extra("zarr", "sweep").open_group(out)["status"].chunks == (1, 1)
    assert found.load().equals(sweep_of(SYSTEM_1, tmp_path / "y.zarr", GRID).load())
    assert sorted(path.name for path in tmp_path.iterdir()) == ["x.zarr", "y.zarr"]


@pytest.fixture
def small_files():
    """Let no file of this process grow beyond some bytes, as on a full disk."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)

    def limit(size):
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))

    yield limit
    resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@pytest.mark.parametrize("size", [0, 700, 2000])
def test_a_disk_without_room_is_one_sentence_and_the_same_call_resumes(size, whole, tmp_path, small_files):
    out = tmp_path / "x.zarr"
    small_files(size)
    with pytest.raises(
        li.InputError, match=rf"cannot write '{re.escape(str(out))}': File too large.*the same call resumes"
    ):
        sweep_of(SYSTEM_1, out, GRID, outputs=("R.max", "x"), t_end=0.5, chunk=2)
    small_files(resource.getrlimit(resource.RLIMIT_FSIZE)[1])
    assert sweep_of(SYSTEM_1, out, GRID, outputs=("R.max", "x"), t_end=0.5).load().equals(whole[1])
