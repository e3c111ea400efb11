"""What is given and what is handed on: kinds of arguments, names, cells, memory, and what is nobody's fault but ours."""

from __future__ import annotations

import math
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pandas as pd
import pytest

import lcpimpact as li
from lcpimpact import memory
from lcpimpact.cli.main import main
from lcpimpact.lcp.files import read_lcp
from lcpimpact.numbers import is_count, is_real
from lcpimpact.study.accuracy.reference import reference
from lcpimpact.study.design.curves import CurveTable


def ball(name="ball", node="x", contact="R"):
    scheme = li.Scheme(li.Mass(node, 1.0), li.Load(node, 9.81), li.Bumper(node, "ground", gap=0.1, e=0.5, name=contact))
    return li.Problem(name, scheme)


def run(**names):
    return li.simulate(ball(**names), dt=0.05, t_end=0.3)


@pytest.mark.parametrize(
    "value", [Decimal(1), Fraction(1, 2), np.array(1.0), np.bool_(True), "1", 1j, 10**400, math.nan]
)
def test_what_is_no_real_number(value):
    assert not is_real(value)
    assert is_real(np.float32(1.0))
    assert not is_count(1e300)


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: li.energy_ledger(3), r"^run = 3 must be a Trajectory: get one from simulate"),
        (lambda: li.fit(ball(), ["k"], starts=2.0), r"^starts = 2.0 must be a whole number"),
        (lambda: li.convergence(ball(), ["exact"], ["0.1"]), r"^dts\[0\] = '0.1' must be a number"),
        (lambda: li.convergence(ball(), "exact", [0.1]), r"^methods = 'exact' must be a sequence: write \['exact'\]"),
        (lambda: li.with_values(ball(), {"0.m": None}), r"^values\['0.m'\] = None must be a number"),
        (lambda: li.design("hertz", m=True, v0=1.0), r"^m = True must be a number"),
        (lambda: li.solve_lcp([[1.0]], [1.0], max_iter=1e300), r"^max_iter = 1e\+300 must be a whole number"),
    ],
)
def test_an_argument_of_another_kind_is_named_with_what_it_must_be(call, says):
    with pytest.raises(li.InputError, match=says):
        call()


@pytest.mark.parametrize("name", ["", "a\x1b[31m", "line\nline", "\ud800", "\u202e", 3])
def test_names_that_nobody_can_see_are_refused_where_they_are_given(name):
    for names in ({"name": name}, {"node": name}, {"contact": name}):
        with pytest.raises(li.InputError, match="hidden characters"):
            ball(**names)
    with pytest.raises(li.InputError, match="must hold 1 names"):
        li.LinearComplementaritySystem([[-1.0]], [[1.0]], [[1.0]], states=[name])


@pytest.mark.parametrize("name", ["$$", r"$\frac{$", "=1+1", "θ"])
def test_names_that_look_like_something_else_are_drawn_as_they_are(name, tmp_path):
    for what, ending in (("name", ".svg"), ("name", ".png"), ("node", ".png"), ("contact", ".svg")):
        run(**{what: name}).plot(tmp_path / f"run{ending}")
    found = li.compare(ball(name), {name: "moreau-jean"}, dt=0.05, t_end=0.3)
    found.plot(tmp_path / "compared.png")


@pytest.mark.parametrize("name", ["=1+1", "+x", "-x", "@x", "'=x", "x=1"])
def test_no_spreadsheet_runs_a_name_and_our_own_reader_knows_it(name, tmp_path):
    given = run(node=name, contact="=R")
    given.save(tmp_path / "run.csv")
    for file in ("run.csv", "run.events.csv"):
        for line in (tmp_path / file).read_text(encoding="utf-8").splitlines():
            assert not [
                cell for cell in line.split(",") if cell[:1] in tuple("=+@") or (cell[:1] == "-" and cell[1:2] == "x")
            ]
    if name != "x=1":
        assert f"t,'{name}," in (tmp_path / "run.csv").read_text(encoding="utf-8")
    assert CurveTable.of(tmp_path / "run.csv").curve([name])[name].tolist() == given[name].tolist()


def test_a_trace_of_a_box_is_that_of_the_problem_that_was_solved():
    found = li.solve_lcp(
        [[2.0, 1.0], [1.0, 2.0]], [-5.0, -6.0], "lemke", lower=[0.0, 0.0], upper=[1.0, 1.0], trace=True
    )
    assert found.z.tolist() == [1.0, 1.0]
    assert "lemke on an LCP of order 4" in str(found.trace)
    assert found.trace.steps[-1].z[:2] == pytest.approx([1.0, 1.0], rel=1e-14)


def test_what_a_run_and_a_problem_hold_is_theirs():
    given = run()
    for array in (given.t, given.q, given.v, given.t_reaction, given.reaction, given["x"]):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    assert given.certify().holds
    start = {"x": 0.05}
    problem = li.Problem("ball", given.problem.scheme, q0=start)
    start["x"] = 9.0
    assert problem.q0 == {"x": 0.05}


def test_arrays_that_unpack_to_gigabytes_are_refused_before_they_are_unpacked(tmp_path, monkeypatch):
    np.savez_compressed(tmp_path / "trap.npz", M=np.zeros((12_000, 12_000)), q=np.zeros(12_000))
    with pytest.raises(li.InputError, match=r"trap.npz': it unpacks to 1.15 GB from 0.00\d+ GB.*give a sparse"):
        read_lcp(tmp_path / "trap.npz")
    np.savez(tmp_path / "large.npz", M=np.eye(100), q=np.zeros(100))
    monkeypatch.setattr(memory, "free_memory", lambda: 1e5)
    monkeypatch.setattr(memory, "SMALL", 0.0)
    with pytest.raises(li.InputError, match=r"large.npz': its arrays do not fit in memory.*give a sparse"):
        read_lcp(tmp_path / "large.npz")


def test_a_defect_says_that_it_is_one_and_where_to_report_it(monkeypatch, capsys):
    def defect(*_, **__):
        raise LookupError("no \x1b[31m key")

    monkeypatch.setattr("lcpimpact.schemefile.registered_problem", defect)
    for shown in (False, True):
        if shown:
            monkeypatch.setenv("LCPIMPACT_TRACEBACK", "1")
        with pytest.raises(SystemExit) as stop:
            main(["simulate", "system-1"])
        said = capsys.readouterr().err
        assert stop.value.code == 70
        assert (
            "this is a defect of lcpimpact: LookupError: no \\x1b[31m key. Please report it at the issue tracker"
            in said
        )
        assert ("Traceback" in said) is shown


def test_sizes_beyond_all_numbers_are_refused_in_words():
    for m, v0, g in ((1e300, 1e-300, 0.0), (1e-300, 1e300, 0.0), (1e160, 1e160, 1e160)):
        with pytest.raises(li.InputError, match=r"a number overflows or underflows|no block"):
            li.design("kelvin-voigt", m=m, v0=v0, g=g, k=1e300, c=1e-300)


def test_a_file_of_words_is_written_as_words(tmp_path):
    from lcpimpact.cli.finish import write_table

    write_table(pd.DataFrame({"=a": ["=1", "x"], "t": [-1.0, 2.0]}), tmp_path / "t.csv")
    assert (tmp_path / "t.csv").read_text() == "'=a,t\n'=1,-1.0\nx,2.0\n"


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: CurveTable.of(pd.DataFrame({"t": [0.0], "x": ["a"]})).curve(pd.DataFrame({"x": []})), "x"),
        (lambda: li.LinearComplementaritySystem([[1.0]], None, [[1.0]]), "B"),
        (lambda: reference(li.load_problem("bouncing-ball"), 10**400), "t_end = .* must be a finite number"),
        (lambda: li.simulate(li.load_problem("bouncing-ball"), "exact", dt=1e297, t_end=1e300), "shorter t_end"),
        (lambda: li.load_problem("shaw-holmes", omega=1e300).facts, "omega = 1e\\+300.*nearer to 1"),
    ],
)
def test_what_a_fuzzer_found_is_refused(call, says):
    with pytest.raises(li.InputError, match=says):
        call()
