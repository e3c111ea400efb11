"""The command line as people call it: exit codes, one line for what is wrong, nothing half written."""

import os
import signal
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest

import lcpimpact as li
from lcpimpact.cli.commands import app
from lcpimpact.cli.main import main
from lcpimpact.course import LESSONS, PROJECTS
from lcpimpact.integrators import METHODS
from lcpimpact.lcp import SOLVERS
from lcpimpact.problems import PROBLEMS
from lcpimpact.scheme.elements import ELEMENTS


def call(capsys, *arguments):
    with pytest.raises(SystemExit) as stop:
        main([str(each) for each in arguments])
    captured = capsys.readouterr()
    return stop.value.code, captured.out, captured.err


def test_simulate_says_what_came_out_and_writes_it(capsys, tmp_path):
    out, plot = tmp_path / "run.csv", tmp_path / "run.png"
    code, said, _ = call(
        capsys,
        "simulate",
        "system-1",
        "--set",
        "c_o=300",
        "--set",
        "theta=1",
        "--dt",
        "1e-2",
        "--out",
        out,
        "--plot",
        plot,
    )
    assert code == 0
    assert "theta=1" in said
    assert "solved" in said
    expected = li.simulate(li.load_problem("system-1", c_o=300.0), dt=1e-2, t_end=3.0, theta=1.0)
    written = np.genfromtxt(out, delimiter=",", names=True)
    assert written["x"].tolist() == expected["x"].tolist()
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_options_of_a_method_are_set_by_name(capsys):
    told = ["--set", "ode_solver=RK45", "--set", "kinks=false", "--set", "rtol=1e-6"]
    code, said, _ = call(
        capsys, "simulate", "bouncing-ball", "--method", "event-driven", *told, "--dt", "0.1", "--t-end", "1"
    )
    assert code == 0
    assert "ode_solver=RK45, rtol=1e-06" in said
    assert "kinks=False" in said


@pytest.mark.parametrize("method", ["exact", "rk4-paper"])
def test_simulate_by_other_methods(capsys, method):
    code, said, _ = call(capsys, "simulate", "system-3", "--method", method, "--dt", "1e-2", "--t-end", "1")
    assert code == 0
    assert f"by {method}" in said


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        ("problems", PROBLEMS),
        ("methods", METHODS),
        ("solvers", SOLVERS),
        ("elements", ELEMENTS),
        ("lessons", LESSONS),
        ("projects", PROJECTS),
    ],
)
def test_list_shows_the_whole_registry(capsys, kind, names):
    code, said, _ = call(capsys, "list", kind)
    assert code == 0
    for name in names:
        assert name in said


def test_help_teaches(capsys):
    code, said, _ = call(capsys, "--help")
    assert code == 0
    places = [said.index(f"\n  {command} ") for command in ("reproduce", "simulate", "list")]
    assert places == sorted(places)
    assert "..." not in said.replace("[ARGS]...", "")  # no sentence is cut
    for command in app.commands:
        assert command in said
        assert call(capsys, command, "--help")[0] == 0
    assert call(capsys, "--version")[1].strip() == f"lcpimpact {li.__version__}"


WRONG = {
    "unknown problem": (["simulate", "sytem-1"], "did you mean 'system-1'"),
    "unknown method": (["simulate", "system-1", "--method", "moreau"], "did you mean 'moreau-jean'"),
    "unknown solver": (["simulate", "system-1", "--solver", "lemk"], "did you mean 'lemke'"),
    "unknown parameter": (["simulate", "system-1", "--set", "k_0=3"], "did you mean 'k_o'"),
    "no value": (["simulate", "system-1", "--set", "k_o"], "NAME=VALUE"),
    "word for a number": (["simulate", "system-1", "--set", "k_o=stiff"], "k_o"),
    "negative mass": (["simulate", "system-1", "--set", "m=-1"], "Mass at 'x'"),
    "zero c_o": (["simulate", "system-1", "--set", "c_o=0"], "c_o = 0"),
    "nan": (["simulate", "system-1", "--set", "k_o=nan"], "k_o"),
    "theta": (["simulate", "system-1", "--set", "theta=2"], "theta = 2"),
    "negative step": (["simulate", "system-1", "--dt", "-1"], "dt = -1"),
    "no whole number of steps": (["simulate", "system-1", "--t-end", "3", "--dt", "0.7"], "take dt ="),
    "no number": (["simulate", "system-1", "--dt", "fast"], "--dt"),
    "no whole number of processes": (["reproduce", "--workers", "two"], "'--workers': 'two' is not a valid integer."),
    "no process": (["reproduce", "--workers", "0"], "'--workers': 0 is not in the range x>=1."),
    "unknown command": (["smulate"], "simulate"),
    "unknown option": (["simulate", "system-1", "--stepp", "3"], "--stepp"),
    "unknown list": (["list", "methodz"], "'KIND': 'methodz' is not one of 'problems', 'methods'"),
    "not handled": (["simulate", "bouncing-ball", "--method", "rk4-paper"], "moreau-jean"),
    "folder that is not there": (["simulate", "system-1", "--out", "/nowhere/run.csv"], "/nowhere/run.csv"),
    "unknown ending": (["simulate", "system-1", "--out", "run.xls"], ".csv"),
    "folder that cannot be made": (["reproduce", "--out", "/dev/null/report"], "/dev/null/report"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_input_exits_2_with_one_line(capsys, case, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arguments, said = WRONG[case]
    code, _, error = call(capsys, *arguments)
    assert code == 2
    assert len(error.strip().splitlines()) == 1
    assert error.startswith("lcpimpact: ")
    assert said in error
    assert list(tmp_path.iterdir()) == []


def test_wrong_output_is_found_before_the_run(capsys, monkeypatch):
    import lcpimpact.reproduce.run
    import lcpimpact.simulation

    monkeypatch.setattr(lcpimpact.simulation, "simulate", lambda *a, **k: pytest.fail("the run was started"))
    monkeypatch.setattr(lcpimpact.reproduce.run, "run_all", lambda *a, **k: pytest.fail("the runs were started"))
    assert call(capsys, "simulate", "system-1", "--out", "/nowhere/run.csv")[0] == 2
    assert call(capsys, "simulate", "system-1", "--plot", "run.xls")[0] == 2
    assert call(capsys, "animate", "system-1", "--out", "run.xls")[0] == 2
    assert call(capsys, "reproduce", "--out", "/dev/null/report")[0] == 2


@pytest.mark.parametrize("command", ["converge", "work-precision"])
def test_an_unknown_norm_is_refused_before_the_runs(capsys, monkeypatch, command):
    for study in ("convergence", "work_precision"):
        monkeypatch.setattr(
            f"lcpimpact.study.accuracy.convergence.{study}", lambda *a, **k: pytest.fail("a run was started")
        )
    code, _, error = call(capsys, command, "system-1", "--norm", "l2_w")
    assert code == 2
    assert "unknown norm 'l2_w': did you mean 'l2_v'" in error


def test_a_failed_run_exits_1_and_says_why(capsys):
    code, _, error = call(
        capsys,
        "simulate",
        "bouncing-ball",
        "--method",
        "exact",
        "--set",
        "e=1",
        "--set",
        "max_events=2",
        "--dt",
        "0.01",
    )
    assert code == 1
    assert "max_events" in error


def test_ctrl_c_leaves_no_half_written_file(tmp_path):
    out = tmp_path / "run.csv"
    out.write_text("older")
    # A shell that runs the tests in the background lets its children ignore Ctrl-C; a terminal does not.
    start = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
    command = [sys.executable, "-c", start + "from lcpimpact.cli.main import main; main()", "simulate", "system-1"]
    process = subprocess.Popen(
        [*command, "--dt", "1e-6", "--t-end", "20", "--out", str(out)],
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**os.environ, "COLUMNS": "200"},
    )
    time.sleep(3.0)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=60)
    assert process.returncode == 130
    assert b"interrupted" in error
    assert b"Traceback" not in error
    assert b"" not in error.splitlines()
    assert [path.name for path in tmp_path.iterdir()] == ["run.csv"]
    assert out.read_text() == "older"


@pytest.mark.parametrize("dt", ["0.7", "0.031"])
def test_a_step_that_does_not_divide_the_own_end_of_a_problem_is_refused_as_in_python(capsys, dt):
    code, _, error = call(capsys, "simulate", "system-1", "--dt", dt)
    assert code == 2
    with pytest.raises(li.InputError) as refused:
        li.simulate(li.load_problem("system-1"), dt=float(dt))
    assert " ".join(error.split()) == f"lcpimpact: {refused.value}"
    assert call(capsys, "simulate", "system-1", "--dt", "0.029", "--quiet")[0] == 0


def test_the_error_of_a_fact_is_relative_to_its_value(capsys):
    _, said, _ = call(capsys, "simulate", "system-1", "--dt", "0.3")
    row = next(line.split() for line in said.splitlines() if line.split()[:1] == ["R(0+)"])
    exact, measured, error = float(row[1]), float(row[3]), float(row[4])
    assert error == pytest.approx(abs(measured - exact) / exact, rel=0.06)
    assert error > 0.1


@pytest.mark.parametrize("name", ["x.json", "scheme.yaml", "my.toml.txt"])
def test_a_file_of_another_ending_is_told_that_scheme_files_are_toml(capsys, name):
    code, _, error = call(capsys, "simulate", name, "--dt", "0.1")
    assert code == 2
    assert f"'{name}' is no registered problem, and a scheme file ends in .toml" in " ".join(error.split())


def test_a_zip_application_has_all_names(tmp_path):
    package = Path(li.__file__).parent
    with zipfile.ZipFile(tmp_path / "app.zip", "w") as archive:
        for file in package.rglob("*.py*"):
            if file.suffix in (".py", ".pyi"):
                archive.write(file, file.relative_to(package.parent))
    code = "import lcpimpact as li; print(li.__file__, len(li.__all__), li.load_problem('system-1').name)"
    given = {**os.environ, "PYTHONPATH": str(tmp_path / "app.zip")}
    ended = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=given, cwd=tmp_path, check=True
    )
    assert ended.stdout.split() == [f"{tmp_path}/app.zip/lcpimpact/__init__.py", str(len(li.__all__)), "system-1"]
