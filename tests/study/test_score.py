"""Scores of results: good runs score well, wrong ones badly, and bad input is one sentence."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import lcpimpact as li
from lcpimpact.cli.main import main


def table(run):
    """Return the columns of a run."""
    return run.to_pandas()


def closed_form(name, steps=1009):
    """Return samples of the motion in closed form, without reactions."""
    problem = li.load_problem(name)
    t = np.arange(steps + 1) * problem.t_end / steps
    q, v = problem.motion(t)
    nodes = problem.dynamics.nodes
    rates = {f"v_{node}": v[:, i] for i, node in enumerate(nodes)}
    return pd.DataFrame({"t": t} | {node: q[:, i] for i, node in enumerate(nodes)} | rates)


def relative(score):
    """Return the relative errors of the facts that are told, by symbol."""
    return score.facts[score.facts["failure"] == ""].set_index("quantity")["relative"].to_dict()


OWN = {
    "system-1": 1e-4, "system-2": 1e-4, "bouncing-ball": 0.02, "kelvin-voigt-impact": 1e-5, "maxwell-impact": 1e-5,
    "impact-oscillator": 0.01, "two-ball-drop": 5e-3, "pi-billiard": 0.03, "inelastic-collapse": 0.02, "hertz-impact": 1e-5,
    "coulomb-oscillator": 2e-3, "jenkins-cycle": 0.02, "stick-slip-belt": 0.01, "thrown-block": 2e-3, "spinning-ball": 2e-3,
    "vibrating-table": 5e-3, "plastic-ball": 0.01, "rocking-block": 5e-3, "diode-bridge": 1e-3, "filippov": 2e-3,
    "twisting": 0.02, "reflected-motion": 1e-4,
}  # fmt: skip


@pytest.mark.parametrize("name", OWN)
def test_a_run_of_this_package_scores_well(name):
    problem = li.load_problem(name)
    run = li.simulate(problem, "moreau-jean", dt=problem.t_end / 2001, progress=False)
    score = li.score(table(run), problem)
    assert not len(score.failures)
    assert max(relative(score).values()) <= OWN[name]
    assert score.table["relative"].iloc[len(problem.facts) :].max() <= max(
        OWN[name], 0.15 * (name == "pi-billiard"), 0.08
    )
    assert score.run.t.tolist() == run.t.tolist()


@pytest.mark.parametrize(
    "name",
    [
        "bouncing-ball",
        "rocking-block",
        "vibrating-table",
        "pi-billiard",
        "bilinear-oscillator",
        "block-on-belt",
        "super-ball",
    ],
)
def test_the_closed_form_scores_to_rounding(name):
    score = li.score(closed_form(name), name)
    motion = score.table.iloc[len(score.problem.facts) :]
    assert motion["relative"].max() <= 1e-12 or name == "bilinear-oscillator"  # whose plate jumps in its rate
    assert score.against == "closed form"
    assert max(error for symbol, error in relative(score).items() if symbol != "t_∞") <= 3e-3


def test_parabolas_are_read_without_error_at_impacts():
    """The ball flies on parabolas, which are what the samples beside an impact are continued by."""
    found = relative(li.score(closed_form("bouncing-ball"), "bouncing-ball"))
    assert max(found[symbol] for symbol in ("t_1", "v_1", "t_3", "v_3")) <= 1e-12
    (impact, *_) = li.score(closed_form("bouncing-ball"), "bouncing-ball").run.events
    assert impact.left.q[0] == pytest.approx(1.0, rel=1e-12)
    assert impact.right.q[0] == pytest.approx(1.0, rel=1e-12)
    assert impact.impulse == pytest.approx(1.8 * np.sqrt(2.0 * 9.81), rel=1e-12)
    assert 1e-3 <= found["t_∞"] <= 0.05  # the last impacts lie between two samples


def test_both_limits_at_a_jump_are_right():
    """A sample at the impact itself may have the velocity before it, or after it."""
    ball = closed_form("bouncing-ball")
    t_1 = li.load_problem("bouncing-ball").facts[0].value
    before = pd.DataFrame({"t": [t_1], "x": [1.0], "v_x": [9.81 * t_1]})
    score = li.score(pd.concat([ball, before]).sort_values("t"), "bouncing-ball")
    assert score.table["relative"].iloc[-1] <= 1e-12


def test_samples_without_rates_are_differentiated():
    ball = closed_form("bouncing-ball")[["t", "x"]]
    found = relative(li.score(ball, "bouncing-ball"))
    assert 0.0 < max(found[symbol] for symbol in ("t_1", "t_3")) <= 2e-3
    assert 0.0 < max(found[symbol] for symbol in ("v_1", "v_3")) <= 0.03


def test_events_may_be_given(tmp_path):
    problem = li.load_problem("bouncing-ball")
    run = li.simulate(problem, "exact", dt=problem.t_end / 500, progress=False)
    run.save(tmp_path / "run.csv")
    score = li.score(tmp_path / "run.csv", "bouncing-ball", events=tmp_path / "run.events.csv")
    assert max(relative(score).values()) <= 1e-12
    assert relative(li.score(tmp_path / "run.csv", "bouncing-ball"))["t_∞"] > 1e-3
    few = pd.DataFrame({"t": [0.4515236409857309], "contact": ["R"], "kind": ["impact"]})
    score = li.score(tmp_path / "run.csv", "bouncing-ball", events=few)
    assert relative(score)["t_1"] <= 1e-14
    assert 0.0 < relative(score)["v_1"] <= 0.03  # the sample before
    (failure, *_) = score.failures["failure"]
    assert "number 3 is required" in failure


@pytest.mark.parametrize(
    ("change", "worst"),
    [
        (lambda ball: ball.assign(t=ball["t"] * 1.05), 0.04),
        (lambda ball: ball.assign(x=ball["x"] + 0.1), 0.02),
        (lambda ball: ball.assign(x=-ball["x"], v_x=-ball["v_x"]), 1.0),
        (lambda ball: ball.iloc[::60], 0.05),
        (lambda ball: ball.assign(v_x=0.9 * ball["v_x"]), 0.02),
    ],
    ids=["stretched", "shifted", "wrong sign", "coarse", "slow"],
)
def test_a_wrong_result_scores_badly(change, worst):
    score = li.score(change(closed_form("bouncing-ball")), "bouncing-ball")
    motion = score.table.iloc[len(score.problem.facts) :]
    told = relative(score)
    assert max(told.values(), default=1.0) >= worst or len(told) < 5
    assert motion["relative"].max() >= worst or len(score.run.t) < 50


def test_what_is_missing_cannot_be_told():
    problem = li.load_problem("system-1")
    run = li.simulate(problem, dt=1e-3, progress=False)
    without = table(run)[["t", "x", "v_x"]]
    score = li.score(without, problem)
    failures = score.failures.set_index("quantity")["failure"]
    assert set(failures.index) == {"R(0+)", "t_1", "t_2", "t_3", "t_4", "R(3)", "R_max"}
    events = failures[["t_1", "t_2", "t_3", "t_4"]]
    assert set(events) == {
        "the results have no columns z, R, without which no events are found: write them, or give an events file"
    }
    assert all("the results have no columns z, v_z, R" in each for each in failures.drop(events.index))
    assert relative(score)["x(3)"] <= 1e-4
    assert "1 of 8 facts can be told" in score.summary()
    assert list(score.table["quantity"][8:]) == ["x", "v_x"]


def test_without_a_coordinate_no_fact_of_events_is_told():
    problem = li.load_problem("system-1")
    run = table(li.simulate(problem, dt=1e-3, progress=False))
    score = li.score(run.drop(columns=["z", "v_z"]), problem)
    assert set(score.failures["quantity"]) == {"t_1", "t_2", "t_3", "t_4"}
    assert all("have no column z" in each for each in score.failures["failure"])
    assert max(relative(score).values()) <= 1e-4
    given = pd.DataFrame({"t": [problem.facts[1].value], "contact": ["R"], "kind": ["open"]})
    assert relative(li.score(run.drop(columns=["z", "v_z"]), problem, events=given))["t_1"] == 0.0


def test_the_head_names_the_largest_error_of_facts_and_motion():
    run = table(li.simulate(li.load_problem("system-1"), dt=1e-3, progress=False))
    swapped = run.rename(columns={"x": "z", "z": "x"})
    score = li.score(swapped, "system-1")
    told = score.table[score.table["failure"] == ""].set_index("quantity")["relative"]
    assert told.idxmax() in ("x", "z", "v_x", "v_z")
    assert f"is {told.max():.1e}, of {told.idxmax()} (" in score.head()[1]
    ball = closed_form("bouncing-ball")
    assert "error is" in li.score(ball, "bouncing-ball").head()[1]
    assert "error of 2 of 5 facts and of the motion is" in li.score(ball[ball["t"] < 1.0], "bouncing-ball").head()[1]


def test_after_a_hole_no_events_are_told():
    ball = closed_form("bouncing-ball", 3000)
    t = ball["t"]
    failures = li.score(ball[(t <= 0.3) | (t >= 0.6)], "bouncing-ball").failures.set_index("quantity")["failure"]
    assert set(failures.index) == {"t_1", "v_1", "t_3", "v_3", "t_∞"}
    assert all(
        re.fullmatch(r"no samples from 0.\d+ to 0.\d+ s, where events may lie: .* or give an events file", each)
        for each in failures
    )
    later = li.score(ball[(t <= 1.0) | (t >= 1.3)], "bouncing-ball")
    assert max(relative(later)[symbol] for symbol in ("t_1", "v_1")) <= 1e-12
    assert set(later.failures["quantity"]) == {"t_3", "v_3", "t_∞"}
    # from 0.1 to 0.2 s the ball is too high to fall and come back
    assert not len(li.score(ball[(t <= 0.1) | (t >= 0.2)], "bouncing-ball").failures)
    given = pd.DataFrame({"t": [later.problem.facts[0].value], "contact": ["R"], "kind": ["impact"]})
    assert relative(li.score(ball[(t <= 0.3) | (t >= 0.6)], "bouncing-ball", events=given))["t_1"] == 0.0


def test_units_in_headers_are_read_and_other_numbers_refused(tmp_path):
    ball = closed_form("bouncing-ball")
    scaled = ball.assign(t=1e3 * ball["t"], x=1e3 * ball["x"]).rename(columns={"t": "t [ms]", "x": "x (mm)"})
    score = li.score(scaled, "bouncing-ball")
    assert score.left_out == ()
    assert max(relative(score)[symbol] for symbol in ("t_1", "v_1")) <= 1e-9
    with pytest.raises(
        li.InputError, match=r"end at t = 5079\.64 s, .*write t in s, or its unit in the header, as t \[ms\]"
    ):
        li.score(ball.assign(t=1e3 * ball["t"]), "bouncing-ball")
    with pytest.raises(li.InputError, match="column x holds complex numbers: write real ones"):
        li.score(ball.assign(x=ball["x"] + 0.0j), "bouncing-ball")
    with pytest.raises(li.InputError, match="'N' is no unit for what is in m"):
        li.score(ball.rename(columns={"x": "x [N]"}), "bouncing-ball")


def test_a_short_result_says_that_it_is_short():
    ball = closed_form("bouncing-ball")
    score = li.score(ball[ball["t"] < 1.0], "bouncing-ball")
    assert set(score.failures["quantity"]) == {"v_3", "t_3", "t_∞"}
    assert "run longer" in score.summary()


def test_a_result_is_a_study(tmp_path):
    ball = closed_form("bouncing-ball").assign(energy=1.0)
    score = li.score(ball, "bouncing-ball")
    assert "were left out: energy" in score.summary()
    assert score.plot(tmp_path / "score.png").axes
    assert score.report(tmp_path / "score.html").read_text(encoding="utf-8").count("t_∞") >= 1
    assert li.score(ball[["t", "x"]].iloc[:100], "bouncing-ball").plot()


# ---- the command ----------------------------------------------------------------------------------------------------


def call(capsys, *arguments):
    with pytest.raises(SystemExit) as stop:
        main([str(each) for each in arguments])
    captured = capsys.readouterr()
    return stop.value.code, captured.out, captured.err


def test_the_command_scores_a_file(capsys, tmp_path):
    run = li.simulate(li.load_problem("bouncing-ball", e=0.5), dt=2e-3, t_end=2.0, progress=False)
    run.save(tmp_path / "run.csv")
    told = [tmp_path / "run.csv", "--problem", "bouncing-ball", "--set", "e=0.5", "--out", tmp_path / "table.csv"]
    code, said, _ = call(capsys, "score", *told)
    assert code == 0
    assert "5 of 5 facts can be told from 1001 samples" in said
    assert pd.read_csv(tmp_path / "table.csv")["quantity"].tolist()[:2] == ["t_1", "v_1"]
    code, said, _ = call(capsys, "score", *told[:3])
    assert code == 0, "a bad score is no bad input"
    assert "v_3" in said


WANTED = (
    "line 1 of '{}': the columns wanted are t, x, and if they are known v_x, R, in SI units or with their units as in "
    "t [ms]; found are "
)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("time,pos\n0,0\n1,1\n2,2\n", f"{WANTED}time, pos"),
        ("t,y\n0,0\n1,1\n2,2\n", f"{WANTED}t, y"),
        ("t,x\n0,0\n1,one\n2,2\n", "cannot read '{}': column x: no finite number in line 3, as 'one'; fill or delete them"),
        ("t,x\n0,0\n1,\n2,2\n", "cannot read '{}': column x: no finite number in line 3; fill or delete them"),
        ("t,x\n0,0\n2,1\n1,2\n", "cannot read '{}': t does not rise in line 4; sort the rows and delete doubles"),
        ("t,x\n0.5,0\n1,1\n2,2\n", "begin at t = 0.5 s and have 3 samples: write the state at t = 0"),
        ("t,x\n", "are empty and have 0 samples: write the state at t = 0"),
        ("", "it holds no table; write a header and numbers"),
    ],
    ids=["names", "no coordinate", "word", "hole", "order", "start", "empty", "nothing"],
)  # fmt: skip
def test_bad_results_are_one_sentence(capsys, tmp_path, text, expected):
    file = tmp_path / "results.csv"
    file.write_text(text)
    code, said, error = call(capsys, "score", file, "--problem", "bouncing-ball", "--out", tmp_path / "table.csv")
    assert (code, said) == (2, "")
    assert expected.format(file) in error
    assert error.count("\n") == 1
    assert not (tmp_path / "table.csv").exists()


def test_bad_names_and_events_are_one_sentence(capsys, tmp_path):
    closed_form("bouncing-ball").to_csv(tmp_path / "ball.csv", index=False)
    told = ["score", tmp_path / "ball.csv", "--problem"]
    assert "did you mean 'bouncing-ball'" in call(capsys, *told, "bouncing-bal")[2]
    assert "did you mean 'e'" in call(capsys, *told, "bouncing-ball", "--set", "ee=0.5")[2]
    assert call(capsys, *told, "bouncing-ball", "--set", "e=high")[0] == 2
    assert call(capsys, "score", tmp_path / "none.csv", "--problem", "bouncing-ball")[0] == 2
    events = tmp_path / "events.csv"
    for text, expected in (
        ("t,kind\n0.5,impact\n", f"line 1 of '{events}': the columns wanted are t, contact and kind"),
        ("t,contact,kind\n0.5,S,impact\n", f"line 2 of '{events}'"),
        (
            "t,contact,kind\n0.5,R,impact\n0.4,R,impact\n",
            f"line 3 of '{events}': t = 0.4 s lies before 0.5 s, the event above",
        ),
        ("t,contact,kind\n-1,R,impact\n", f"line 2 of '{events}': t = -1 s lies before 0 s, the start"),
        ("t,contact,kind\n0.5,R,impact\nlate,R,impact\n", f"line 3 of '{events}': t = 'late' is no number"),
        ("t,contact,kind\n,R,impact\n", f"line 2 of '{events}': t = '' is no number"),
        ("t,contact,kind\n99,R,impact\n", f"line 2 of '{events}': t = 99 s lies after the last sample, at "),
        ("t,contact,kind\n0.5,R,Impact\n", f"line 2 of '{events}': unknown kind 'Impact': did you mean 'impact'"),
        ("t,contact,kind,impulse\n0.5,R,impact,big\n", f"line 2 of '{events}': impulse = 'big' is no number"),
        ("t,contact,kind,v_x_left\n0.5,R,impact,fast\n", f"line 2 of '{events}': v_x_left = 'fast' is no number"),
    ):
        events.write_text(text)
        code, _, error = call(capsys, *told, "bouncing-ball", "--events", events)
        assert code == 2
        assert expected in error
    events.write_text("t;contact;kind;impulse;vx_left\n0,52;R;impact;8,5;1,5\n")
    code, said, _ = call(capsys, *told, "bouncing-ball", "--events", events)
    assert code == 0
    assert re.search(r"t_1 .* 0\.52 ", said)
    assert "Columns that the problem does not have were left out: vx_left" in said
    assert li.score(tmp_path / "ball.csv", "bouncing-ball", events=events).run.events[0].impulse == 8.5
    carriage = li.Problem("own", li.Scheme(li.Mass("x", 1.0)))
    with pytest.raises(li.InputError, match="own has no facts"):
        li.score(closed_form("bouncing-ball"), carriage)


@pytest.mark.parametrize(
    "command", [("score", "results.csv", "--problem"), ("truths",), ("cite",)], ids=lambda each: each[0]
)
def test_a_scheme_file_has_nothing_to_score(capsys, command):
    code, said, error = call(capsys, *command, "fall.toml")
    assert (code, said) == (2, "")
    assert (
        "'fall.toml' is a scheme file, which states no facts and no source: take a problem of lcpimpact list" in error
    )


# ---- another program ------------------------------------------------------------------------------------------------

SYSTEM_PYTHON = "/usr/bin/python3"


def has_siconos():
    found = shutil.which(SYSTEM_PYTHON)
    return found and subprocess.run([found, "-c", "import siconos.kernel"], capture_output=True).returncode == 0


@pytest.mark.slow
@pytest.mark.skipif(not has_siconos(), reason="Debian's python3-siconos is not installed")
def test_siconos_is_scored_by_the_page(tmp_path):
    page = Path(__file__).parents[2] / "docs" / "howto" / "your-code.md"
    text = page.read_text(encoding="utf-8").split("## Siconos")[1].split("```python\n")[1].split("```")[0]
    (tmp_path / "ball.py").write_text(text, encoding="utf-8")
    li.write_truths(tmp_path / "truths", ["bouncing-ball"])
    subprocess.run([SYSTEM_PYTHON, "ball.py"], cwd=tmp_path, check=True, capture_output=True, timeout=300)
    score = li.score(tmp_path / "results.csv", "bouncing-ball")
    assert not len(score.failures)
    assert max(relative(score).values()) <= 0.01
