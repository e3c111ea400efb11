"""What commands print: --json, --quiet, --verbose, the lists, the completion of a shell, and the help."""

import csv
import json
import logging
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import lcpimpact as li
from lcpimpact.cli.commands import app
from lcpimpact.cli.main import main
from lcpimpact.cli.options import names_of
from lcpimpact.cli.output import plain
from lcpimpact.integrators import METHODS
from lcpimpact.lcp import SOLVERS
from lcpimpact.logs import LOG, bars_shown, progress_bar
from lcpimpact.problems import PROBLEMS
from lcpimpact.scheme.elements import ELEMENTS
from lcpimpact.scheme.structure import Feature

REGISTRIES = {"problems": PROBLEMS, "methods": METHODS, "solvers": SOLVERS, "elements": ELEMENTS}


def call(capsys, *arguments):
    with pytest.raises(SystemExit) as stop:
        main([str(each) for each in arguments])
    captured = capsys.readouterr()
    return stop.value.code, captured.out, captured.err


def answer(capsys, *arguments):
    code, said, error = call(capsys, *arguments, "--json")
    assert error == ""
    return code, json.loads(said, parse_constant=pytest.fail)


def test_without_a_command_the_help_is_printed_and_all_is_well(capsys):
    code, said, error = call(capsys)
    assert (code, error) == (0, "")
    assert said == call(capsys, "--help")[1]


# --- list -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", REGISTRIES)
def test_a_list_as_json_has_every_entry_with_what_it_declares(capsys, kind):
    code, entries = answer(capsys, "list", kind)
    assert code == 0
    assert [each["name"] for each in entries] == list(REGISTRIES[kind])
    assert all(each["summary"] and each["about"] for each in entries)
    assert len({tuple(each) for each in entries}) == 1


def test_what_a_method_handles_is_listed_in_one_order(capsys):
    order = [each.value for each in Feature]
    _, entries = answer(capsys, "list", "methods")
    for each in entries:
        if each["name"] in ("exact", "radau-fesd", "event-driven"):
            assert each["handles"] == sorted(each["handles"], key=order.index)


@pytest.mark.parametrize(
    ("kind", "name", "said"),
    [
        ("problems", "bouncing-ball", ["H=1", "t_∞ = 4.063712769 s", "exact", "relative degree 2", "Zeno's problem"]),
        ("methods", "schatzman-paoli", ["Paoli and Schatzman", "relative degrees: 2", "solves lcp: yes"]),
        ("solvers", "lemke", ["bounds: yes", "Lemke (1965)", "storages: dense"]),
        ("solvers", "qp:osqp", ["OSQP"]),
        ("elements", "Bumper", ["constants", "gap", "0 <= u"]),
    ],
)
def test_a_name_after_the_kind_tells_all_of_it(capsys, kind, name, said):
    code, text, _ = call(capsys, "list", kind, name)
    assert code == 0
    assert text.startswith(f"{name}: ")
    for each in said:
        assert each.lower() in text.lower()


def test_a_list_is_filtered_by_text_and_by_what_goes_together(capsys):
    _, relays = answer(capsys, "list", "problems", "--matching", "RELAY", "--matching", "twist")
    assert [each["name"] for each in relays] == ["twisting"]
    _, able = answer(capsys, "list", "methods", "--for", "bouncing-ball")
    names = [each["name"] for each in able]
    assert "moreau-jean" in names
    assert "rk4-paper" not in names
    for name in METHODS:  # by a run, not by the declaration
        try:
            li.simulate(li.load_problem("bouncing-ball"), name, dt=1e-2, t_end=0.1, throw=False)
        except li.UnsupportedError:
            assert name not in names
        else:
            assert name in names
    _, paper = answer(capsys, "list", "problems", "--for", "rk4-paper")
    taken = [each["name"] for each in paper]
    assert taken[:3] == ["system-1", "system-2", "system-3"]
    assert "bouncing-ball" not in taken
    code, text, _ = call(capsys, "list", "solvers", "--matching", "no such words")
    assert code == 0
    assert "qp:NAME" not in text


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["problems", "bouncing-bal"], "did you mean 'bouncing-ball'"),
        (["methods", "--for", "sytem-1"], "did you mean 'system-1'"),
        (["problems", "--for", "exat"], "did you mean 'exact'"),
        (["solvers", "--for", "system-1"], "leave it out for solvers"),
        (["solvers", "lemke", "--matching", "x"], "leave --matching and --for out"),
    ],
)
def test_a_list_that_cannot_be_is_refused(capsys, arguments, said):
    code, out, error = call(capsys, "list", *arguments)
    assert (code, out) == (2, "")
    assert said in error
    assert len(error.splitlines()) == 1


# --- json -------------------------------------------------------------------------------------------------------------


def test_a_run_as_json_has_the_numbers_of_the_run(capsys, tmp_path):
    out = tmp_path / "run.csv"
    code, found = answer(capsys, "simulate", "bouncing-ball", "--dt", "1e-2", "--t-end", "1", "--out", out)
    assert code == 0
    run = li.simulate(li.load_problem("bouncing-ball"), dt=1e-2, t_end=1.0)
    assert found["summary"] == {key: None if math.isnan(value) else value for key, value in run.summary().items()}
    assert (found["status"], found["steps"], found["t_end"]) == ("SOLVED", 100, 1.0)
    assert found["facts"]["t_1"]["value"] == pytest.approx(math.sqrt(2.0 / 9.81))
    assert found["facts"]["t_∞"]["measured"] is None
    assert found["files"] == [str(out), *(str(tmp_path / name) for name in ("run.events.csv", "run.meta.json"))]


def test_a_study_and_a_sweep_as_json_are_their_tables(capsys, tmp_path):
    out = tmp_path / "table.csv"
    told = ["converge", "system-1", "--methods", "moreau-jean", "--counts", "50,100", "--t-end", "0.5", "--out", out]
    code, found = answer(capsys, *told)
    assert code == 0
    with out.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(found["table"]) > 0
    for row, said in zip(rows, found["table"], strict=True):
        assert row.keys() == said.keys()
        for key, value in said.items():
            if isinstance(value, float):
                assert float(row[key]) == value
    assert found["files"] == [str(out)]
    swept = ["sweep", "system-1", "--set", "k_o=3000,4000", "--output", "peak_force", "--dt", "1e-2"]
    _, found = answer(capsys, *swept)
    single = li.simulate(li.load_problem("system-1", k_o=4000.0), dt=1e-2).summary()["peak_force"]
    assert [each["k_o"] for each in found["table"]] == [3000.0, 4000.0]
    assert found["table"][1]["peak_force"] == single


def test_a_solution_as_json_and_one_that_fails(capsys, tmp_path):
    file = tmp_path / "two.lcp"
    file.write_text("2 1\n1 2\n-5 -6\n")
    code, found = answer(capsys, "solve", file)
    assert code == 0
    np.testing.assert_allclose(found["z"], [4.0 / 3.0, 7.0 / 3.0], rtol=1e-14)
    assert found["ray"] is None
    file.write_text("-1 0\n0 -1\n-1 -1\n")
    code, said, error = call(capsys, "solve", file, "--json")
    assert code == 1
    assert json.loads(said)["success"] is False
    assert len(error.splitlines()) == 1


def test_plain_data():
    assert plain({1: np.float64("inf"), "b": np.arange(2), "c": np.bool_(True), "d": (None, np.int64(3))}) == {
        "1": None,
        "b": [0, 1],
        "c": True,
        "d": [None, 3],
    }


# --- quiet and verbose ------------------------------------------------------------------------------------------------


def test_quiet_prints_nothing_but_errors(capsys, tmp_path):
    out = tmp_path / "run.csv"
    told = ["simulate", "system-1", "--dt", "1e-2", "--quiet"]
    assert call(capsys, *told, "--out", out) == (0, "", "")
    assert out.exists()
    assert LOG.level == logging.NOTSET
    code, said, error = call(capsys, "simulate", "system-2x", "--quiet")
    assert (code, said) == (2, "")
    assert "system-2" in error
    assert json.loads(call(capsys, *told, "--json")[1])["success"]


def test_verbose_logs_each_run_to_standard_error(capsys):
    told = ["compare", "system-1", "--methods", "moreau-jean,rk4-paper", "--dt", "1e-2"]
    code, said, error = call(capsys, *told, "-v")
    assert code == 0
    assert said == call(capsys, *told)[1]
    for name in ("moreau-jean", "rk4-paper"):
        assert any(line.startswith(f"lcpimpact: system-1 by {name}(") for line in error.splitlines())
    assert LOG.handlers == []
    assert LOG.level == logging.NOTSET
    code, _, error = call(capsys, *told, "-v", "-q")
    assert code == 2
    assert "contradict" in error


@pytest.mark.compiled
def test_twice_verbose_names_what_is_compiled(tmp_path):
    found = subprocess.run(
        [sys.executable, "-m", "lcpimpact", "solve", "two.lcp", "--solver", "pgs", "-vv"],
        cwd=_with_problem(tmp_path),
        env=os.environ | {"LCPIMPACT_CACHE": str(tmp_path / "cache"), "LCPIMPACT_COMPILE": "later"},  # but pgs
        capture_output=True,
        text=True,
        check=True,
    )
    assert "lcpimpact: compiled pgs in " in found.stderr


def _with_problem(folder):
    (folder / "two.lcp").write_text("2 1\n1 2\n-5 -6\n")
    return folder


def test_the_level_of_the_logger_hides_progress_bars():
    assert bars_shown(True)
    LOG.setLevel(logging.ERROR)
    try:
        assert not bars_shown(True)
    finally:
        LOG.setLevel(logging.NOTSET)
    assert not bars_shown(False)


def test_progress_is_written_line_by_line_to_what_is_no_terminal(capsys, monkeypatch):
    monkeypatch.setattr("lcpimpact.logs.SECONDS_A_LINE", 1e-9)
    assert list(progress_bar(True, range(3), desc="runs")) == [0, 1, 2]
    lines = capsys.readouterr().err.splitlines()
    assert [line.split("|")[0] for line in lines] == [f"runs: {part:>4}" for part in ("33%", "67%", "100%", "100%")]
    assert list(progress_bar(False, range(3))) == [0, 1, 2]
    assert capsys.readouterr().err == ""


def test_every_command_takes_the_three_options(capsys):
    assert "simulate" in app.commands
    for name in app.commands:
        said = call(capsys, name, "--help")[1]
        for option in ("--json", "--quiet", "--verbose"):
            assert option in said, name


# --- completion -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("lcpimpact simulate syst", ["plain,system-1", "plain,system-2", "plain,system-3"]),
        ("lcpimpact simulate my.to", ["file,my.to"]),
        ("lcpimpact simulate system-1 --method rk4", ["plain,rk4", "plain,rk4-paper"]),
        ("lcpimpact simulate system-1 --solver lem", ["plain,lemke"]),
        ("lcpimpact conv", ["plain,converge"]),
    ],
)
def test_a_shell_completes_commands_and_names(line, expected):
    words = line.split()
    found = subprocess.run(
        [sys.executable, "-m", "lcpimpact"],
        env=os.environ
        | {"_LCPIMPACT_COMPLETE": "bash_complete", "COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert sorted(found.stdout.split()) == sorted(expected)
    assert found.stderr == ""


def test_names_that_begin_so():
    assert names_of(PROBLEMS)(None, None, "two-") == ["two-ball-drop", "two-balls-spring"]


# --- decimal commas and workbooks ------------------------------------------------------------------------------------

TABLED = {
    "simulate": ["simulate", "bouncing-ball", "--dt", "1e-2", "--t-end", "1"],
    "converge": ["converge", "system-1", "--methods", "moreau-jean", "--counts", "50,100", "--t-end", "0.5"],
    "design": ["design", "kelvin-voigt", "--m", "1", "--v0", "2", "--e", "0.5", "--contact-time", "0.01"],
    "sweep": ["sweep", "system-1", "--set", "k_o=3000,4000", "--output", "peak_force", "--dt", "1e-2"],
    "solve": ["solve", "two.lcp"],
}


@pytest.fixture
def lcp(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("two.lcp").write_text("2 1\n1 2\n-5 -6\n")


def untimed(table):
    return table.drop(columns="seconds", errors="ignore")


@pytest.mark.parametrize("name", TABLED)
def test_decimal_commas_are_the_same_numbers(name, lcp, capsys):
    for out, option in (("a.csv", []), ("b.csv", ["--decimal-comma"])):
        assert call(capsys, *TABLED[name], "--out", out, *option)[0] == 0
    points, commas = untimed(pd.read_csv("a.csv")), untimed(pd.read_csv("b.csv", sep=";", decimal=","))
    pd.testing.assert_frame_equal(points, commas, check_exact=True)
    cells = pd.read_csv("b.csv", sep=";", dtype=str)[list(commas.select_dtypes("float"))].stack()
    assert cells.str.contains(",").any()
    assert not cells.str.contains(".", regex=False).any()


@pytest.mark.parametrize("name", [each for each in TABLED if each != "solve"])
def test_a_workbook_has_the_numbers_of_the_csv(name, lcp, capsys):
    pytest.importorskip("openpyxl")
    for out in ("a.csv", "a.xlsx"):
        assert call(capsys, *TABLED[name], "--out", out)[0] == 0
    text, book = untimed(pd.read_csv("a.csv", float_precision="round_trip")), untimed(pd.read_excel("a.xlsx"))
    assert list(text) == list(book)
    for column in text:
        if pd.api.types.is_numeric_dtype(text[column]):
            # openpyxl writes 16 digits
            np.testing.assert_allclose(book[column].to_numpy(float), text[column].to_numpy(float), rtol=1e-15, atol=0.0)
        else:
            assert list(text[column].fillna("")) == list(book[column].fillna(""))


def test_a_workbook_without_its_package_is_refused_before_any_run(lcp, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    for name, module in (("simulate", "runs"), ("converge", "convergence"), ("sweep", "sweep")):
        monkeypatch.setattr(f"lcpimpact.cli.{module}.resolve_run", pytest.fail)
        code, out, error = call(capsys, *TABLED[name], "--out", "a.xlsx")
        assert (code, out) == (2, "")
        assert "openpyxl is not installed: pip install 'lcpimpact[excel]'" in error
    assert not Path("a.xlsx").exists()


def test_commands_without_tables_have_no_decimal_commas(lcp, capsys):
    code, _, error = call(capsys, "draw", "system-1", "--decimal-comma")
    assert code == 2
    assert "--decimal-comma" in error
