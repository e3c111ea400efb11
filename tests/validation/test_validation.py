"""The suites of published numbers: each verdict, and what becomes of a number that is changed on purpose."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tex import with_tex
from validation_page import coded

import lcpimpact as li
from lcpimpact import InputError, UnknownNameError, validate
from lcpimpact.cli.main import main
from lcpimpact.validation import validate as module
from lcpimpact.validation.arch import accumulated, by_reset_maps, drivetrain, gearbox, meshed_at, returns
from lcpimpact.validation.case import Fate, Published, Suite, numbers_of
from lcpimpact.validation.modelica import SAMPLES
from lcpimpact.validation.papers import algorithmic_energy, largest_gain, measured_order, struck_chain
from lcpimpact.validation.suites import SUITES

REFUTED = {
    "code-aster": [
        ("SDND100", "x(0.063 s), file c"),
        ("SDND100", "x(0.0945 s), file c"),
        ("SDND122", "frequency in Hz, printed formula"),
        ("SDNL111", "u(0.0006 s) in m"),
        ("SDNL111", "u(0.001 s) in m"),
    ],
    "arch": [],
    "modelica": [
        *(("BouncingBall, 2019", f"impact {k} at t in s") for k in range(1, 12)),
        ("BouncingBall, 2019", "at rest from t in s"),
        *(("BouncingBall, 2026", f"h({t} s) in m") for t in (0.17, 0.57, 0.97, 1.37, 1.77, 2.17, 2.57)),
        *((f"ElastoGap, mass{k}", "largest difference from rows of the file, in m and m/s") for k in (1, 2)),
    ],
    "engines": [(f"contactCoordinateTest, {law}", "height at 0.25 s in m") for law in ("its law", "pushing only")],
    "papers": [],
}
"""The numbers of each suite that a closed form refutes."""

EXACT_RTOL = {"code-aster": 2e-9, "arch": 1e-12, "modelica": 1e-8, "engines": 5e-9, "papers": 1e-9}
"""Largest error of the methods that locate events, relative to a closed form."""


def printed(capsys, *arguments):
    with pytest.raises(SystemExit) as end:
        main(arguments)
    out, err = capsys.readouterr()
    return end.value.code, out, err


@pytest.fixture(scope="module")
def results():
    return {name: validate(name) for name in SUITES}


@pytest.mark.parametrize("name", list(SUITES))
def test_every_number_is_met_or_refuted(results, name):
    table = results[name].table
    assert list(table.loc[table["verdict"] == "not met", "quantity"]) == []
    refuted = table[table["verdict"] == "refuted"]
    assert list(zip(refuted["case"], refuted["quantity"], strict=True)) == REFUTED[name]
    assert (refuted["why"] != "").all()
    assert (table["source"] != "").all()
    assert results[name].success
    assert len(table) == sum(len(case.published) for case in SUITES[name].cases) + len(SUITES[name].not_found)
    assert (table.loc[table["verdict"] == "not found", "why"] != "").all()


@pytest.mark.parametrize("name", list(SUITES))
def test_methods_that_locate_events_have_the_digits_of_closed_forms(results, name):
    table = results[name].table
    known = table[np.isfinite(table["truth"])]
    located = [each for each in ("exact", "event-driven") if each in known]
    compared = 0
    for method in located:
        rows = known[np.isfinite(known[method])]
        scale = np.maximum(abs(rows["truth"]), rows["tolerance"].fillna(0.0))
        assert (abs(rows[method] - rows["truth"]) <= EXACT_RTOL[name] * scale).all(), method
        compared += len(rows)
    assert compared > 5


@pytest.mark.parametrize("name", list(SUITES))
def test_the_page_has_each_number_with_its_verdict(results, name):
    text = (Path(li.__file__).parents[1] / "docs" / "guide" / "validate.md").read_text(encoding="utf-8")
    for row in results[name].table.to_dict("records"):
        case, quantity, why = coded(row["case"]), coded(row["quantity"]), with_tex(row["why"])
        if row["verdict"] == "not found":
            assert f"**Not found: {row['case']}**, {quantity}: {why}." in text
        else:
            line = next(each for each in text.splitlines() if each.startswith(f"| {case} | {quantity} |"))
            assert line.endswith(f"| {row['verdict']} |")
            assert row["verdict"] == "met" or why in text


def changed(monkeypatch, name, k, **changes):
    """Let the suite ``name`` be its k-th case alone, with its first published number changed, and run it."""
    case = SUITES[name].cases[k]
    first, *others = case.published
    suite = Suite("changed", (replace(case, published=(replace(first, **changes), *others)),))
    monkeypatch.setattr(module, "SUITES", {name: suite})
    return module.validate(name)


def test_a_number_that_is_changed_is_not_met_and_with_a_derivation_refuted(monkeypatch):
    wrong = SUITES["code-aster"].cases[0].published[0].value * 1.01
    found = changed(monkeypatch, "code-aster", 0, value=wrong)
    assert found.table["verdict"][0] == "not met"
    assert not found.success
    assert "1 not met" in found.summary()
    found = changed(monkeypatch, "code-aster", 0, value=wrong, derivation="because")
    assert found.table["verdict"][0] == "refuted"
    assert "because" in found.summary()
    found = changed(monkeypatch, "code-aster", 0, value=wrong, derivation="because", truth=wrong)
    assert found.table["verdict"][0] == "not met", "the closed form and the methods disagree"


@pytest.mark.parametrize(
    ("published", "ours", "verdict"),
    [
        (Published("x", 1.0, "x", rtol=0.1), [1.05, 0.95], Fate.MET),
        (Published("x", 1.0, "x", rtol=0.1), [1.05, 0.85], Fate.NOT_MET),
        (Published("x", 1.0, "x", atol=0.1, derivation="d"), [1.5], Fate.NOT_MET),
        (Published("x", 1.0, "x", atol=0.1, derivation="d"), [1.5, 1.51], Fate.REFUTED),
        (Published("x", 1.0, "x", atol=0.1), [1.5, 1.51], Fate.NOT_MET),
        (Published("x", 1.0, "x", atol=0.1, derivation="d"), [1.5, 1.7], Fate.NOT_MET),
        (Published("x", 1.0, "x", atol=0.1, derivation="d", truth=1.5), [1.51], Fate.REFUTED),
        (Published("x", 1.0, "x", atol=0.1, derivation="d", truth=1.0), [1.51, 1.51], Fate.NOT_MET),
        (Published("x", 1.0, "x", atol=0.1, derivation="d", truth=1.5), [math.nan], Fate.NOT_MET),
        (Published("x", 1.0, "x", below=True), [0.5, 0.9], Fate.MET),
        (Published("x", 1.0, "x", below=True), [0.5, 1.0], Fate.NOT_MET),
        (Published("x", 1.0, "x", below=True), [0.5, math.nan], Fate.NOT_MET),
    ],
)
def test_verdicts(published, ours, verdict):
    assert published.verdict(np.array(ours)) is verdict


def test_a_run_that_fails_says_why(monkeypatch):
    case = SUITES["code-aster"].cases[0]
    failing = replace(case, runs=(li.Run("bs23", dt=1e-3),))
    monkeypatch.setattr(module, "SUITES", {"code-aster": Suite("failing", (failing,))})
    found = module.validate()
    assert set(found.table["verdict"]) == {"not met"}
    assert found.table["why"].str.contains("bs23").all()


def test_what_is_not_there_is_refused(capsys):
    code, out, err = printed(capsys, "validate", "code-astr")
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    assert "unknown suite 'code-astr': did you mean 'code-aster'" in err
    with pytest.raises(UnknownNameError):
        validate(["code-aster", "nothing"])
    with pytest.raises(InputError, match=r"the data file 'no\.csv' of published numbers is not there"):
        numbers_of("no.csv")


def test_the_command_says_the_verdicts_and_ends_with_their_exit_code(monkeypatch, capsys, tmp_path):
    case = SUITES["code-aster"].cases[0]
    monkeypatch.setattr(module, "SUITES", {"one": Suite("one", (case,), SUITES["code-aster"].not_found)})
    page, table = tmp_path / "page.html", tmp_path / "table.csv"
    code, out, err = printed(capsys, "validate", "one", "--report", str(page), "--out", str(table))
    assert (code, err) == (0, "")
    assert out.startswith("7 published values of 1 cases: 5 met, 2 refuted, 0 not met\n")
    assert "refuted: SDND100: x(0.063 s), file c; x(0.0945 s), file c: " in out
    assert "half period" in page.read_text(encoding="utf-8")
    assert table.read_text(encoding="utf-8").count("refuted") == 2
    worse = replace(case, published=(replace(case.published[0], value=1.0), *case.published[1:]))
    monkeypatch.setattr(module, "SUITES", {"one": Suite("one", (worse,))})
    code, out, err = printed(capsys, "validate", "one", "--json")
    assert (code, err) == (1, "")
    assert [row["verdict"] for row in json.loads(out)["table"]].count("not met") == 1


def test_the_file_of_the_fmu_is_by_explicit_euler_steps():
    """h and v by the text of the model, in steps of 1 ms."""
    h, v, g, step, heights = 1.0, 0.0, -9.81, 1e-3, {}
    for n in range(1, 3001):
        h, v = h + step * v, v + step * g
        if h <= 0.0 and v < 0.0:
            h, v = np.finfo(float).tiny, -0.7 * v
            if v < 0.1:
                v, g = 0.0, 0.0
        heights[n] = h
    assert len(SAMPLES) == 7
    for t, value in SAMPLES.items():
        assert heights[round(1000 * t)] == pytest.approx(value, rel=0.0, abs=1e-13)


def test_the_drivetrain_passes_its_backlash():
    run = li.simulate(drivetrain(0.0), "exact", dt=0.01, error=False)
    assert li.crossing(run, "x1", -0.03) > 0.2
    assert li.crossing(run, "x1", 0.03) > li.crossing(run, "x1", -0.03)
    assert returns(run) == 0.0


def test_rattle_ns_is_solved_at_one_millisecond_with_an_impact_too_many():
    problem = gearbox(-0.0167, 0.003, 3.2)
    coarse, fine = (li.simulate(problem, "rattle-ns", dt=dt, error=False) for dt in (1e-3, 1e-4))
    teeth = [sum(each.contact != "mesh" and each.t < meshed_at(run) for each in run.events) for run in (coarse, fine)]
    assert coarse.success
    assert teeth == [4, 3]
    assert accumulated(coarse, 3.2) > 18.5
    assert accumulated(fine, 3.2) == pytest.approx(by_reset_maps(-0.0167, 0.003, 3.2)[1], abs=0.01)


def test_the_gearbox_has_the_digits_of_its_reset_maps():
    t, impulse = by_reset_maps(-0.0167, 0.003, 3.2)
    assert t == pytest.approx(0.14921396677221357, rel=1e-13)
    assert impulse == pytest.approx(16.8254667994825, rel=1e-13)
    run = li.simulate(gearbox(-0.0167, 0.003, 3.2), "exact", dt=0.01, error=False)
    times = [each.t for each in run.events[:4]]
    assert times == pytest.approx([0.03402440084925911, 0.058919369701918856, 0.10782861030272109, t], rel=1e-12)
    assert sum(each.impulse for each in run.events[:3]) == pytest.approx(14.53946764, abs=1e-8)


@pytest.mark.parametrize(("theta", "e", "gains"), [(2.0 / 3.0, 0.5, False), (2.0 / 3.0, 1.0, True), (1.0, 1.0, True)])
def test_the_theta_step_gains_energy_above_one_over_one_plus_e(theta, e, gains):
    run = li.simulate(struck_chain(e), "moreau-jean", theta=theta, dt=0.02, error=False)
    assert (largest_gain(run) > 1e-2) is gains


def test_the_algorithmic_energy_of_hht_falls_where_that_of_the_system_grows():
    run = li.simulate(struck_chain(0.0), "newmark-ns", alpha=-0.1, dt=0.02, error=False)
    d = run.dynamics
    stored = 0.5 * np.einsum("ti,ij,tj->t", run.v, d.M, run.v) + 0.5 * np.einsum("ti,ij,tj->t", run.q, d.K, run.q)
    assert np.diff(stored).max() > 1e-4 * stored[0]
    assert largest_gain(run) < 1e-12
    assert np.all(algorithmic_energy(run) >= stored - 1e-12 * stored[0])


def test_without_detection_of_switches_the_order_is_lost():
    problem = li.load_problem("coulomb-oscillator")
    run = li.simulate(problem, "radau", dt=problem.t_end / 80, error=False)
    assert measured_order(run) < 1.5
