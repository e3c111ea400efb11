"""What a run says of itself in tables and files: columns, units, and what made it."""

import importlib.util
import json
import math
import shutil
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from exact_csv import CSV_OPTIONS
from scipy.io import loadmat

import lcpimpact as li
from lcpimpact.run_files import WRITERS, companions, matlab_names, write_workbook

HAS = {name: importlib.util.find_spec(name) is not None for name in ("pyarrow", "xarray")}
needs_pyarrow = pytest.mark.skipif(not HAS["pyarrow"], reason="needs pyarrow")
needs_xarray = pytest.mark.skipif(not HAS["xarray"], reason="needs xarray")

SAID = {
    "problem": "system-1",
    "method": "moreau-jean(theta=0.5, lcp_solver=auto)",
    "dt": 0.01,
    "t_end": 0.5,
    "status": "SOLVED",
    "version": f"lcpimpact {li.__version__}",
}
UNITS = {"t": "s", "x": "m", "z": "m", "v_x": "m/s", "v_z": "m/s", "t_R": "s", "R": "N"}


@pytest.fixture(scope="module")
def run():
    return li.simulate(li.load_problem("system-1", c_o=300.0), dt=1e-2, t_end=0.5)


def check(found, run, parameters):
    """What a file or table says of its run is what the run was asked for."""
    assert {name: found[name] for name in SAID if name != "method"} | {"method": SAID["method"]} == SAID
    assert found["method"] == run.method
    assert found["method"].startswith("moreau-jean")
    assert found["message"] == run.message
    assert parameters == run.problem.parameters
    assert parameters["c_o"] == 300.0


def test_the_table_has_the_columns_of_the_csv(run, tmp_path):
    frame = run.to_pandas()
    read = pd.read_csv(run.save(tmp_path / "run.csv"), **CSV_OPTIONS)
    pd.testing.assert_frame_equal(frame, read, check_exact=True)
    assert list(frame) == list(UNITS)
    assert (len(frame), frame["R"].isna().sum(), frame["t_R"].isna().sum()) == (51, 1, 1)
    np.testing.assert_array_equal(frame["R"].to_numpy()[:-1], run["R"])
    assert frame.attrs["units"] == UNITS
    check(frame.attrs, run, frame.attrs["parameters"])


def test_a_table_of_a_run_with_forces_on_the_grid_has_no_gaps():
    frame = li.simulate(li.load_problem("system-1"), "exact", dt=1e-2, t_end=0.5).to_pandas()
    assert not frame.isna().any(axis=None)


def test_a_csv_has_its_metadata_beside_it(run, tmp_path):
    run.save(tmp_path / "run.csv")
    found = json.loads((tmp_path / "run.meta.json").read_text(encoding="utf-8"))
    check(found, run, found["parameters"])
    assert found["units"] == UNITS


def test_an_npz_says_its_units_and_parameters(run, tmp_path):
    with np.load(run.save(tmp_path / "run.npz"), allow_pickle=False) as file:
        found = {name: file[name].item() for name in (*SAID, "message", "parameters")}
        assert dict(zip(file["names"], file["units"], strict=True)) == {k: UNITS[k] for k in run.names}
    check(found, run, json.loads(found["parameters"]))


@needs_xarray
def test_netcdf_says_its_units_and_parameters(run, tmp_path):
    import xarray

    for data in (run.to_xarray(), xarray.load_dataset(run.save(tmp_path / "run.nc"), engine="scipy")):
        check(data.attrs, run, json.loads(data.attrs["parameters"]))
        assert {name: data[name].attrs["units"] for name in UNITS} == UNITS


@needs_pyarrow
def test_parquet_says_its_units_and_parameters(run, tmp_path):
    path = run.save(tmp_path / "run.parquet")
    frame = pd.read_parquet(path)
    pd.testing.assert_frame_equal(frame, run.to_pandas(), check_exact=True)
    check(frame.attrs, run, frame.attrs["parameters"])
    assert frame.attrs["units"] == UNITS
    assert [each.name for each in companions(path) if each.exists()] == ["run.events.parquet"]


def struct(found):
    return {name: found[name][0, 0] for name in found.dtype.names}


def test_a_mat_file_says_its_units_and_parameters(run, tmp_path):
    told = loadmat(run.save(tmp_path / "run.mat"))
    for name in UNITS:
        np.testing.assert_array_equal(told[name][:, 0], run.to_pandas()[name].dropna())
    assert {name: unit.item() for name, unit in struct(told["units"]).items()} == UNITS
    found = struct(told["metadata"])
    parameters = {name: value.item() for name, value in struct(found.pop("parameters")).items()}
    check({name: value.item() for name, value in found.items()}, run, parameters)


def test_the_same_run_gives_the_same_mat_file(run, tmp_path, monkeypatch):
    first = run.save(tmp_path / "a.mat").read_bytes()
    monkeypatch.setattr("time.asctime", lambda *_: "Thu Jan  1 00:00:00 1970")
    assert run.save(tmp_path / "b.mat").read_bytes() == first
    assert first[:21] == b"MATLAB 5.0 MAT-file b"


def test_names_that_matlab_refuses_are_renamed_and_told(tmp_path):
    block = li.simulate(li.load_problem("rocking-block"), dt=0.01, t_end=0.1)
    told = loadmat(block.save(tmp_path / "run.mat"))
    np.testing.assert_array_equal(told["theta"][:, 0], block["θ"])
    assert struct(told["names"])["v_theta"].item() == "v_θ"
    names = matlab_names(["a" * 99, "a" * 98, "end", "events", "_", "é", "日本", "x y", "Σ", "σ"])
    assert len(set(names)) == len(names)
    assert all(name.isidentifier() and name.isascii() and name[0].isalpha() and len(name) < 64 for name in names)
    assert not {"end", "events", "units", "metadata", "names"} & set(names)


@pytest.mark.skipif(shutil.which("octave-cli") is None, reason="needs Octave")
def test_octave_reads_a_mat_file(run, tmp_path):
    run.save(tmp_path / "run.mat")
    ball = li.simulate(li.load_problem("bouncing-ball", e=0.5), "exact", dt=0.1, t_end=1.0)
    ball.save(tmp_path / "ball.mat")
    script = (
        "r = load('run.mat'); b = load('ball.mat');"
        "printf('%.17g|%d|%s|%s|%.17g|%s|%s|%.17g', r.x(end), numel(r.R), r.units.v_x, r.metadata.problem,"
        "r.metadata.parameters.c_o, r.metadata.status, b.events.kind{1}, b.events.v_right(1))"
    )
    command = ["octave-cli", "--no-init-file", "--eval", script]
    said = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True, timeout=120).stdout.split(
        "|"
    )
    assert said[1:4] == ["50", "m/s", "system-1"]
    assert said[5:7] == ["SOLVED", "impact"]
    assert [float(said[i]) for i in (0, 4, 7)] == [run["x"][-1], 300.0, ball.events[0].right.v[0]]


def test_a_system_of_equations_states_no_units(tmp_path):
    circuit = li.simulate(li.load_problem("diode-bridge"), dt=1e-5, t_end=1e-3)
    units = circuit.to_pandas().attrs["units"]
    assert units.pop("t") == units.pop("t_R") == "s"
    assert set(units.values()) == {""}
    for ending in (".csv", ".npz", ".mat"):
        assert circuit.save(tmp_path / f"run{ending}").stat().st_size > 0


def test_a_sparse_run_is_saved_in_every_format(tmp_path):
    beads = li.Problem("beads", li.SparseScheme(li.Chain(50, m=1.0, gap=0.1, e=0.0, f=9.81, b="ground")))
    found = li.simulate(beads, dt=1e-3, t_end=2e-3, record=["x.1"])
    assert list(found.to_pandas()) == ["t", "x.1", "v_x.1", "t_R"]
    for ending in WRITERS:
        if (ending, HAS["xarray"]) != (".nc", False) and (ending, HAS["pyarrow"]) != (".parquet", False):
            assert found.save(tmp_path / f"run{ending}").stat().st_size > 0


def test_without_pyarrow_the_remedy_is_named_and_nothing_written(run, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(li.UnsupportedError, match=r"pyarrow is not installed: pip install 'lcpimpact\[parquet\]'"):
        run.save(tmp_path / "run.parquet")
    assert list(tmp_path.iterdir()) == []


def test_the_command_misses_a_package_before_it_runs(tmp_path, capsys, monkeypatch):
    from lcpimpact.cli.main import main

    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setattr("lcpimpact.simulation.simulate", lambda *_, **__: pytest.fail("it ran"))
    with pytest.raises(SystemExit) as stop:
        main(["simulate", "bouncing-ball", "--dt", "0.01", "--out", str(tmp_path / "run.parquet")])
    assert stop.value.code == 2
    assert "pip install 'lcpimpact[parquet]'" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize("ending", list(WRITERS))
def test_the_command_line_writes_every_format(ending, tmp_path, capsys):
    if (ending, HAS["xarray"]) == (".nc", False) or (ending, HAS["pyarrow"]) == (".parquet", False):
        pytest.skip("needs an extra")
    from lcpimpact.cli.main import main

    out = tmp_path / f"run{ending}"
    with pytest.raises(SystemExit) as stop:
        main(["simulate", "bouncing-ball", "--dt", "0.01", "--t-end", "1", "--json", "--out", str(out)])
    assert stop.value.code == 0
    files = json.loads(capsys.readouterr().out)["files"]
    assert sorted(files) == sorted(map(str, tmp_path.iterdir()))
    assert files == [str(out), *map(str, companions(out))]


# ---- decimal commas and Excel ---------------------------------------------------------------------------------------


def test_decimal_commas_are_the_same_run(run, tmp_path):
    run.save(tmp_path / "run.csv", decimal=",")
    read = pd.read_csv(tmp_path / "run.csv", sep=";", decimal=",", **CSV_OPTIONS)
    pd.testing.assert_frame_equal(run.to_pandas(), read, check_exact=True)
    events = pd.read_csv(tmp_path / "run.events.csv", sep=";", decimal=",", **CSV_OPTIONS)
    assert events["t"].tolist() == [each.t for each in run.events]
    assert json.loads((tmp_path / "run.meta.json").read_text(encoding="utf-8"))["dt"] == run.t[1]


@pytest.mark.parametrize(
    ("name", "decimal", "says"),
    [("run.npz", ",", "decimal = ',' is for .csv"), ("run.csv", ";", "decimal = ';' must be '.' or ','")],
)
def test_another_mark_is_refused_and_nothing_is_written(run, tmp_path, name, decimal, says):
    with pytest.raises(li.InputError, match=says):
        run.save(tmp_path / name, decimal=decimal)
    assert not list(tmp_path.iterdir())


def test_a_workbook_holds_the_run(run, tmp_path):
    pytest.importorskip("openpyxl")
    sheets = pd.read_excel(run.save(tmp_path / "run.xlsx"), sheet_name=None)
    assert list(sheets) == ["run", "events", "units", "metadata"]
    pd.testing.assert_frame_equal(run.to_pandas(), sheets["run"].astype(float), rtol=1e-15, atol=0.0)
    assert dict(sheets["units"].to_numpy()) == UNITS
    assert sheets["events"]["t"].tolist() == pytest.approx([each.t for each in run.events], rel=1e-15)
    told = dict(sheets["metadata"].to_numpy())
    assert told["dt"] == pytest.approx(1e-2)
    assert json.loads(told["parameters"]) == run.problem.parameters
    assert json.loads(told["certificate"])["momentum"] == run.certificate.momentum


def test_a_sheet_is_no_larger_than_those_of_excel(tmp_path):
    pytest.importorskip("openpyxl")
    for size in ({"most_rows": 3}, {"most_columns": 1}):
        with pytest.raises(li.InputError, match=r"a sheet of Excel has .* and table has more: write .csv or .npz"):
            write_workbook(tmp_path / "a.xlsx", {"table": (["a", "b"], [[1.0, 2.0]] * 3)}, **size)
    write_workbook(tmp_path / "a.xlsx", {"table": (["a", "b"], [[1.0, 2.0]] * 2)}, most_rows=3, most_columns=2)


def test_texts_are_no_formulas_and_numbers_may_be_none(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    write_workbook(tmp_path / "a.xlsx", {"table": (["=a", "b"], [["=1+1", math.nan], ["-x", math.inf]])})
    rows = list(openpyxl.load_workbook(tmp_path / "a.xlsx")["table"].iter_rows())
    assert [[cell.value for cell in row] for row in rows] == [["'=a", "b"], ["'=1+1", None], ["'-x", "inf"]]
    assert {cell.data_type for row in rows for cell in row} <= {"s", "n", "inlineStr"}
    for text in ("a\x01", "a" * 32_768):
        with pytest.raises(li.InputError, match="a cell of Excel cannot hold"):
            write_workbook(tmp_path / "b.xlsx", {"table": (["a"], [[text]])})
