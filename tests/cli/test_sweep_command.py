"""The command sweep."""

import json

import numpy as np
import pandas as pd
import pytest

import lcpimpact as li
from lcpimpact.cli.main import main

xarray = pytest.importorskip("xarray")


def told(capsys, *words):
    with pytest.raises(SystemExit) as stop:
        main(["sweep", *words])
    return stop.value.code, capsys.readouterr()


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_a_grid_as_a_table_and_a_picture(capsys, tmp_path):
    code, said = told(
        capsys, "system-1", "--set", "k_o=3000:5000:3", "--set", "c_o=-1,250", "--set", "m=90", "--output", "R.max",
        "--output", "restitution", "--dt", "0.01", "--out", "a.csv", "--plot", "a.png",
    )  # fmt: skip
    assert code == 0
    assert "3 x 2 sets of k_o, c_o" in said.out
    assert "3 without a result: KelvinVoigt" in said.out
    table = pd.read_csv("a.csv")
    assert list(table.columns) == ["k_o", "c_o", "R.max", "restitution", "status", "message"]
    run = li.simulate(li.load_problem("system-1", m=90.0, k_o=4000.0, c_o=250.0), dt=1e-2)
    row = table[(table["k_o"] == 4000.0) & (table["c_o"] == 250.0)].iloc[0]
    assert (row["R.max"], row["status"]) == (run["R"].max(), 0)
    assert (tmp_path / "a.png").stat().st_size > 1000


def test_a_sweep_has_the_report_and_the_formats_of_every_study(capsys, tmp_path):
    words = ["system-1", "--over", "k_o=3000:5000:3", "--dt", "0.01", "--report", "a.html", "--out", "a.tex"]
    code, said = told(capsys, *words)
    assert code == 0
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "system-1: a sweep" in page
    assert "<figure" in page
    assert "toprule" in (tmp_path / "a.tex").read_text(encoding="utf-8")
    found = li.SweepStudy(li.sweep(li.load_problem("system-1"), {"k_o": [3000.0, 4000.0, 5000.0]}, dt=1e-2))
    assert found.summary() in said.out
    assert found.failures.empty
    assert found.plot().axes[0].get_ylabel() == "R.max [N]"
    with pytest.raises(li.InputError, match="give one of sweep"):
        li.SweepStudy(xarray.Dataset())
    with pytest.raises(li.InputError, match="did you mean"):
        found.plot(output="R.mx")


@pytest.mark.parametrize("name", ["a.nc", "a.zarr", "a.csv"])
def test_the_files_of_a_sweep_are_said(name, capsys, tmp_path):
    if name.endswith(".zarr"):
        pytest.importorskip("zarr")
    words = ["system-1", "--over", "k_o=3000,4000", "--dt", "0.1", "--out", name]
    code, said = told(capsys, *words, "--json")
    assert code == 0
    assert json.loads(said.out)["files"] == [name]
    assert (tmp_path / name).exists()
    code, said = told(capsys, *words)
    assert f"wrote {name}" in said.out.splitlines()


def test_one_name_for_what_is_varied(capsys, tmp_path):
    for option, name in (("--over", "a.csv"), ("--set", "b.csv")):
        words = ["system-1", option, "k_o=3000,4000", "--set", "m=90", "--dt", "0.01", "--out", name]
        assert told(capsys, *words)[0] == 0
    pd.testing.assert_frame_equal(pd.read_csv("a.csv"), pd.read_csv("b.csv"))


def test_netcdf_with_whole_series_and_logarithmic_values(capsys):
    assert (
        told(capsys, "system-1", "--set", "c_o=10:1000:3:log", "--output", "x", "--dt", "0.1", "--out", "a.nc")[0] == 0
    )
    found = xarray.open_dataset("a.nc")
    np.testing.assert_allclose(found["c_o"], [10.0, 100.0, 1000.0])
    assert found["x"].dims == ("c_o", "t")


@pytest.mark.parametrize("words", [[], ["--no-certify"]])
def test_certificates_may_be_left_out(words, capsys):
    told(capsys, "bouncing-ball", "--set", "e=0.5,0.6", "--dt", "0.01", "--output", "x.max", "--out", "a.nc", *words)
    assert xarray.open_dataset("a.nc").attrs["certify"] == (not words)


def test_samples_and_indices(capsys, tmp_path):
    words = ["system-1", "--set", "c_o=100:300", "--set", "k_o=3000:5000:log", "--dt", "0.1", "--t-end", "0.5"]
    assert (
        told(
            capsys, *words, "--samples", "8", "--rule", "saltelli", "--seed", "2", "--plot", "a.svg", "--out", "a.csv"
        )[0]
        == 0
    )
    table = pd.read_csv("a.csv")
    assert len(table) == 32
    assert table["k_o"].between(3000.0, 5000.0).all()
    assert (tmp_path / "a.svg").exists()


def test_a_scheme_file_and_its_elements(capsys):
    li.write_scheme_file(li.load_problem("system-1"), "mine.toml")
    assert (
        told(
            capsys,
            "mine.toml",
            "--set",
            "KelvinVoigt.k=3000,3924",
            "--set",
            "v0.x=5,6",
            "--dt",
            "0.01",
            "--out",
            "a.csv",
        )[0]
        == 0
    )
    assert len(pd.read_csv("a.csv")) == 4


def test_a_store_resumes_and_refuses_another_sweep(capsys, tmp_path):
    pytest.importorskip("zarr")
    words = ["system-1", "--set", "k_o=3000:5000:3", "--dt", "0.1", "--out", "a.zarr"]
    assert told(capsys, *words)[0] == told(capsys, *words)[0] == 0
    before = json.loads((tmp_path / "a.zarr" / "zarr.json").read_text(encoding="utf-8"))
    code, said = told(capsys, *words, "--set", "theta=1")
    assert code == 2
    assert "holds another sweep, which differs in the method" in said.err
    assert json.loads((tmp_path / "a.zarr" / "zarr.json").read_text(encoding="utf-8")) == before


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--set", "k_o=3"], "names no range"),
        (["--set", "k_o"], "must read NAME=VALUE"),
        (["--over", "k_o"], "must read NAME=VALUES"),
        (["--set", "k_o=1:2"], "NAME=LOW:HIGH:COUNT"),
        (["--set", "k_o=1:2:x"], "NAME=LOW:HIGH:COUNT"),
        (["--set", "k_o=1:2:3:lin"], "NAME=LOW:HIGH:COUNT"),
        (["--set", "k_o=0:2:3:log"], "above zero"),
        (["--set", "k_o=1:2:3", "--set", "k_o=1:2:4"], "given twice"),
        (["--set", "k_o=1:2:3", "--samples", "4"], "must read NAME=LOW:HIGH,"),
        (["--set", "k_o=2:1", "--samples", "4"], "lower one first"),
        (["--set", "k_o=1:2", "--samples", "4", "--rule", "grid"], "unknown rule"),
        (["--set", "kk_o=1:2:3"], "did you mean 'k_o'"),
        (["--set", "k_o=1:2:3", "--output", "R.mx"], "did you mean 'R.max'"),
        (["--set", "k_o=1:2:3", "--output", "x", "--out", "a.csv"], "no whole series"),
        (["--set", "k_o=1:2:3", "--out", "a.xls"], "must end in one of"),
        (["--set", "k_o=1:2:3", "--out", "nowhere/a.zarr"], "no folder"),
        (["--set", "k_o=1:2:3", "--plot", "a.csv"], "must end in one of"),
    ],
)
def test_wrong_input_is_one_sentence_and_nothing_is_written(words, said, capsys, tmp_path):
    code, printed = told(capsys, "system-1", *words)
    assert code == 2
    assert said in printed.err
    assert len(printed.err.splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_a_sweep_without_any_result_fails(capsys, tmp_path):
    code, said = told(capsys, "system-1", "--set", "c_o=-1,-2", "--out", "a.csv")
    assert code == 1
    assert "no set has a result" in said.err
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_processes(capsys):
    words = ["system-1", "--set", "k_o=3000:5000:7", "--dt", "0.01"]
    assert told(capsys, *words, "--out", "a.csv")[0] == told(capsys, *words, "--workers", "2", "--out", "b.csv")[0] == 0
    assert pd.read_csv("a.csv").equals(pd.read_csv("b.csv"))
