"""The comparison of two states: what differs in a verdict or in a value is found, and rounding is not."""

import copy
import json

import pytest
import verdicts

import lcpimpact as li


@pytest.fixture(scope="module")
def runs():
    problem = li.load_problem("bouncing-ball")
    return {
        f"bouncing-ball by {name}, 50 steps": verdicts.found(problem, name, 50) for name in ("moreau-jean", "rk4-paper")
    }


def changed(runs, change):
    other = copy.deepcopy(runs)
    change(other["bouncing-ball by moreau-jean, 50 steps"])
    return other


def test_a_run_is_kept_with_its_verdicts_and_its_end(runs):
    run, refused = runs.values()
    assert run["status"] == "SOLVED"
    assert run["verdicts"]["momentum"] is True
    assert run["events"]["impact"] > 0
    assert 1.0 <= run["largest"]["q"] < 1.2, "the floor is 1 m away, and a step is long"
    assert refused == {"status": "UnsupportedError"}
    assert json.loads(json.dumps(runs)) == runs


def test_equal_runs_do_not_differ(runs, capsys):
    assert verdicts.compare(runs, json.loads(json.dumps(runs)), verdicts.TOL) == 0
    assert "2 runs in both, 0 missing, 0 new: 0 differ" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda run: run["verdicts"].update(momentum=False), "momentum: False -> True"),
        (lambda run: run["verdicts"].pop("momentum"), "momentum: None -> True"),
        (lambda run: run.update(status="VIOLATED"), "status: VIOLATED -> SOLVED"),
        (lambda run: run["events"].update(impact=1), "impact: 1 -> "),
        (lambda run: run["end"]["q"].append(0.0), "q differs by inf"),
        (lambda run: run["largest"].update(r=float("nan")), "r differs by inf"),
    ],
)
def test_what_differs_is_named(runs, change, said, capsys):
    assert verdicts.compare(runs, changed(runs, change), verdicts.TOL) == 1
    out = capsys.readouterr().out
    assert said in out
    assert "bouncing-ball by moreau-jean, 50 steps" in out


@pytest.mark.parametrize(
    ("part", "size", "differs"), [("q", 2e-11, 1), ("v", 2e-11, 1), ("r", 2e-11, 1), ("v", 5e-12, 0)]
)
def test_values_are_compared_relative_to_the_largest(runs, part, size, differs):
    def move(run):
        run["end"][part][0] += size * run["largest"][part]

    assert verdicts.compare(changed(runs, move), runs, verdicts.TOL) == differs


def test_a_missing_run_is_a_difference(runs):
    first = dict(list(runs.items())[:1])
    assert verdicts.compare(first, runs, verdicts.TOL) == 1
    assert verdicts.compare(runs, first, verdicts.TOL) == 0
