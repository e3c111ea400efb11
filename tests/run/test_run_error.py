"""The estimated error of a run: against closed forms, and by halving against what the exact motion says."""

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
from lagrangian_names import LAGRANGIAN
from numpy.testing import assert_allclose
from random_schemes import frictional, random_problem

import lcpimpact as li
from lcpimpact.problems import PROBLEMS
from lcpimpact.run_error import OFF
from lcpimpact.simulation import methods_that_handle
from lcpimpact.trajectory import NOT_ESTIMATED

G = 9.81


def ball(e=0.5, m=2.0):
    """A ball that falls by 1 m, from rest."""
    scheme = li.Scheme(li.Mass("x", m), li.Load("x", m * G), li.Bumper("x", "ground", gap=1.0, e=e))
    return li.Problem("ball", scheme)


def fall(t, e=0.5):
    """x, v of the ball until its second impact, right limits."""
    first = math.sqrt(2.0 / G)
    before = t < first
    s = t - first
    v1 = -e * G * first
    return np.where(before, G * t * t / 2, 1.0 + v1 * s + G * s * s / 2), np.where(before, G * t, v1 + G * s)


def test_the_error_of_a_ball_is_that_by_its_closed_form():
    run = li.simulate(ball(), dt=1e-2, t_end=0.8)
    x, v = fall(run.t)
    error = run.error
    assert (error.how, error.coarse, run.error) == ("exact", False, error)
    assert_allclose(error["x"], np.abs(run["x"] - x).max(), rtol=1e-9)
    (event,) = error.events
    first = math.sqrt(2.0 / G)
    assert_allclose(event.instant, abs(run.events[0].t - first), rtol=1e-6)
    assert_allclose(event.impulse, abs(run.events[0].impulse - 2.0 * 1.5 * G * first), rtol=1e-9)
    away = np.abs(run.t - first) > 1.0001e-2
    assert_allclose(error["v_x"], np.abs(run["v_x"] - v)[away].max(), rtol=1e-9)
    assert_allclose(error.summary["rebound_speed"], abs(run.summary()["rebound_speed"] - 0.5 * G * first), rtol=1e-9)
    assert error.summary["restitution"] == 0.0
    assert_allclose(error.relative["x"], error["x"] / np.ptp(x), rtol=1e-9)


def test_halving_of_smooth_motion_has_its_order_and_its_error():
    scheme = li.Scheme(li.Mass("x", 1.0), li.Spring("x", "ground", 9.0))
    run = li.simulate(li.Problem("spring", scheme, q0={"x": 1.0}), dt=1e-2, t_end=2.0)
    error = run.estimate_error("halving")
    truth = {"x": np.cos(3.0 * run.t), "v_x": -3.0 * np.sin(3.0 * run.t)}
    for name, values in truth.items():
        assert_allclose(error[name], np.abs(run[name] - values).max(), rtol=2e-3)
    assert (error.how, round(error.order, 1), error.reason) == ("halving", 2.0, "dt/2 and dt/4, order 2.0")
    assert_allclose(run.estimate_error("exact")["x"], error["x"], rtol=2e-3)


@pytest.mark.parametrize(
    ("m", "f", "gap", "v0", "t_end", "dt"),
    [
        (0.6938, 8.3292, 0.2838, 0.42445, 2.0, 0.01),  # "solved", and 61 % off
        (1.0, 9.81, 1.0, 0.0, 3.0, 1.0),  # 4.9 m under its floor
    ],
)
@pytest.mark.parametrize("how", ["exact", "halving"])
def test_a_run_that_resolves_nothing_is_coarse(m, f, gap, v0, t_end, dt, how):
    scheme = li.Scheme(li.Mass("x", m), li.Load("x", f), li.Bumper("x", "ground", gap=gap, e=1.0))
    problem = li.Problem("ball", scheme, v0={"x": v0})
    run = li.simulate(problem, dt=dt, t_end=t_end)
    assert run.success
    error = run.estimate_error(how)
    assert error.coarse
    assert "% of the range of its motion: take dt = " in str(error)
    fine = li.simulate(problem, dt=error.dt, t_end=t_end)
    assert not fine.estimate_error("exact").coarse


def test_what_all_runs_penetrate_is_an_error():
    """Where u < 0 at an instant of the run, x is off, whatever finer runs do."""
    run = li.simulate(ball(), dt=1e-2, t_end=0.8)
    deep = run.q.copy()
    deep[40, 0] = 1.3
    assert replace(run, q=deep).estimate_error("halving")["x"] >= 0.3


def test_runs_that_are_all_late_alike_are_seen():
    """The switch is in the first quarter of a step, so that the runs at dt, dt/2 and dt/4 begin it at the same instant."""
    problem = li.load_problem("filippov")
    run = li.simulate(problem, dt=problem.t_end / 400)
    truth = run.estimate_error("exact")["x"]
    assert truth > 1e-4
    assert 1 / 3 < run.estimate_error("halving")["x"] / truth < 3


@pytest.mark.parametrize(
    ("seed", "method"),
    [
        (317, "rk4"),  # an impact shortly before an instant of the run, which all nested grids share
        (525, "moreau-jean"),  # its impacts lie so in their steps that the run at dt/2 is off more than that at dt
    ],
)
def test_the_phase_of_an_impact_in_its_step_does_not_mislead(seed, method):
    problem = random_problem(seed)
    run = li.simulate(problem, method, dt=problem.t_end / 200)
    truth = run.estimate_error("exact")["n0"]
    assert 1 / 2 < run.estimate_error("halving")["n0"] / truth < 2


def test_an_event_soon_before_an_instant_that_all_runs_share_is_seen():
    """A contact of a plate closes 0.052 steps before an instant: the orders are 4.1, but the error is 52 times as large."""
    problem = random_problem(127)
    run = li.simulate(problem, "rk4", dt=problem.t_end / 200)
    truth, found = (run.estimate_error(how) for how in ("exact", "halving"))
    for node in run.nodes:
        assert 1 / 3 < found[node] / truth[node] < 3


def test_a_run_that_is_by_luck_as_close_as_finer_ones_is_not_called_better_than_it_is():
    """Its impact falls 0.04 steps before an instant, that of the fourth run 0.8 of its own steps."""
    problem = frictional(60)
    run = li.simulate(problem, "radau", dt=problem.t_end / 200)
    truth, found = (run.estimate_error(how) for how in ("exact", "halving"))
    assert 1 / 3 < found["F0.1"] / truth["F0.1"] < 3


@pytest.mark.parametrize("method", ["moreau-jean", "radau"])
def test_a_plate_that_leaves_its_given_velocity_at_once_is_not_off_by_that(method):
    """c x' + k x = f without mass: x' = f/c e^(-kt/c) from the start, where 0 is given."""
    f, c, k = 8.0, 4.0, 20.0
    scheme = li.Scheme(li.Mass("m", 1.0), li.KelvinVoigt("z", "ground", k, c), li.Load("z", f))
    run = li.simulate(li.Problem("plate", scheme), method, dt=5e-3, t_end=1.0)
    off = np.abs(run["v_z"] - f / c * np.exp(-k * run.t / c))[1:].max()
    truth, found = (run.estimate_error(how)["v_z"] for how in ("exact", "halving"))
    assert_allclose(truth, off, rtol=1e-6, atol=1e-12)
    assert off / 3 - 1e-12 < found < 3 * off + 1e-12


@pytest.mark.parametrize(("t_end", "known"), [(0.8, True), (1.5, False)])
def test_the_number_of_accumulating_impacts_is_not_known(t_end, known):
    """The impacts of the ball accumulate at 3 sqrt(2/g) = 1.35 s: each method counts those that its steps resolve."""
    error = li.simulate(ball(), dt=1e-2, t_end=t_end).estimate_error("halving")
    assert (error.summary["impacts"] == 0.0) is known
    assert math.isnan(error.summary["impacts"]) is not known


def test_a_load_that_jumps_at_an_instant_is_no_error():
    """The load doubles at an instant of the run; the finer runs have it among theirs."""
    load = li.Table([0.0, 0.2, 0.2], [5.0, 5.0, 10.0])
    scheme = li.Scheme(li.Mass("x", 1.0), li.Load("x", load), li.Bumper("x", "ground", gap=0.4, e=0.5))
    problem = li.Problem("step", scheme, t_end=0.8)
    run = li.simulate(problem, "rk4", dt=0.1)
    truth = run.estimate_error("exact")["x"]
    assert 1 / 3 < run.estimate_error("halving")["x"] / truth < 3


@pytest.mark.parametrize("method", ["rk4", "radau"])
@pytest.mark.parametrize("name", ["kelvin-voigt-impact", "maxwell-impact", "reflected-motion"])
def test_errors_far_below_those_of_reading_between_instants_are_seen(name, method):
    """Steps that resolve the events keep their order, 4 and 5; errors of 1e-11 m were said to be 1e-6 m."""
    problem = li.load_problem(name)
    run = li.simulate(problem, method, dt=problem.t_end / 200)
    truth, found = run.error, run.estimate_error("halving")
    assert (truth.how, found.how) == ("exact", "halving")
    for node in run.nodes:
        assert truth[node] / 2 < found[node] < 2 * truth[node]


def test_an_event_that_only_one_run_has_excuses_nothing():
    run = li.simulate(ball(), dt=1e-2, t_end=0.8)
    (event,) = run.events
    late = replace(run, v=np.concatenate([run.v[:1], run.v[:1], run.v[:1], run.v[:-3]]))
    known = replace(late, events=(replace(event, t=event.t + 0.03),)).error
    assert known["v_x"] < 0.4
    assert_allclose(known.events[0].instant, 0.03, rtol=1e-3)
    assert replace(late, events=()).error["v_x"] > 6.0
    more = replace(run, events=(*run.events, replace(run.events[0], t=0.7))).error
    assert math.isnan(more.events[1].instant)
    assert "1 of 2 events have no counterpart" in str(more)


def test_a_method_that_chooses_its_steps_is_judged_by_its_tolerance():
    run = li.simulate(li.load_problem("system-1"), dt=1e-2, t_end=1.0, rtol=1e-4)
    found, truth = (run.estimate_error(how) for how in ("halving", "exact"))
    assert found.reason == "against the run with rtol = 1e-06"
    assert 1 / 3 < found["x"] / truth["x"] < 3


def test_where_there_is_no_exact_motion_the_error_is_that_of_halving():
    """The drop on a Hertz contact: against the event-driven run."""
    problem = li.load_problem("hertz-impact")
    run = li.simulate(problem, dt=problem.t_end / 200)
    truth = li.simulate(problem, "event-driven", dt=problem.t_end / 200, rtol=1e-12)
    assert run.error.how == "halving"
    for name in ("x", "v_x"):
        assert 0.8 < run.error[name] / np.abs(run[name] - truth[name]).max() < 1.25
    assert run.estimate_error("exact").how == "unknown"
    assert "exact does not handle non-linear springs" in run.estimate_error("exact").reason


def test_an_error_that_cannot_be_estimated_says_why():
    def sudden(t):
        return 1.0 if t in {0.0, 0.125, 0.25, 0.375, 0.5} else math.nan

    scheme = li.Scheme(li.Mass("x", 1.0), li.Load("x", sudden))
    run = li.simulate(li.Problem("sudden", scheme), "schatzman-paoli", dt=0.125, t_end=0.5, throw=False)
    error = run.error
    assert error.how == "unknown"
    assert error.reason
    assert math.isnan(error["x"])
    assert not error.coarse
    assert str(error).startswith("unknown: ")


def test_an_exact_run_is_exact_to_rounding():
    run = li.simulate(ball(), "exact", dt=1e-2, t_end=0.8)
    x, v = fall(run.t)
    assert run.error.how == "exact"
    assert np.abs(run["x"] - x).max() <= run.error["x"] <= 1e-10
    assert np.abs(run["v_x"] - v).max() <= run.error["v_x"] <= 1e-10


def test_the_text_shows_the_error_and_repr_only_if_it_is_there():
    run = li.simulate(ball(), dt=1e-2, t_end=0.8)
    assert "error" not in repr(run)
    text = str(run)
    assert "  error       " in text
    line = next(line for line in text.split("\n") if line.startswith("  error"))
    run.error  # noqa: B018
    kept = next(line for line in repr(run).split("\n") if line.startswith("  error"))
    assert kept == f"  error       x {run.error['x']:.1e} m (against the exact motion)"
    assert line.split()[1] in ("x", "not")
    assert f"±{run.error.summary['impulse']:.1e}" in str(run.summary())
    assert repr(pickle.loads(pickle.dumps(run)).error) == repr(run.error)


def test_an_estimate_that_would_take_longer_is_not_made(monkeypatch):
    monkeypatch.setattr("lcpimpact.trajectory.QUICK", 0.0)
    run = li.simulate(ball(), dt=1e-4, t_end=0.8)
    object.__setattr__(run.stats, "seconds", 1e-9)
    assert run.quick_error() is None
    assert NOT_ESTIMATED in str(run)
    assert "error" not in repr(run)


def test_it_can_be_turned_off():
    run = li.simulate(ball(), dt=1e-2, t_end=0.8, error=False)
    assert "error" not in str(run)
    assert "error" not in str(run.summary())
    assert (run.error.how, run.error.reason) == ("unknown", OFF)
    assert run.estimate_error().how == "exact"


def test_some_columns_and_unknown_names():
    run = li.simulate(ball(), dt=1e-2, t_end=0.8)
    assert list(run.estimate_error(columns=["v_x"])) == ["v_x"]
    with pytest.raises(li.InputError, match="unknown series 'y'"):
        run.estimate_error(columns=["y"])
    with pytest.raises(li.InputError, match="how = 'guess' must be 'auto', 'exact' or 'halving'"):
        run.estimate_error("guess")


def test_a_sparse_run_is_halved():
    scheme = li.SparseScheme(li.Mass("x", 1.0), li.Load("x", 1.0), li.Bumper("x", "ground", gap=0.1, e=0.5))
    dense = li.Scheme(*scheme.elements)
    runs = [li.simulate(li.Problem("s", each), dt=1e-2, t_end=0.7) for each in (scheme, dense)]
    assert_allclose(runs[0].error["x"], runs[1].estimate_error("halving")["x"], rtol=1e-2)


# ---- estimates against the truth ------------------------------------------------------------------------------------


def ratio(problem, method, steps):
    """Return the estimate by halving over the error of the coordinate that is off most; None where it is not off."""
    run = li.simulate(problem, method, dt=problem.t_end / steps, throw=False, progress=False)
    truth = run.estimate_error("exact")
    if not run.ended or not truth.known:
        return None
    found, name = run.estimate_error("halving"), truth.worst[0]
    if not found.known:
        return math.nan
    rounding = 1e-12 * truth.ranges[name]
    return max(found[name], rounding) / max(truth[name], rounding)


def judge(problems, method, steps):
    found = [each for each in (ratio(problem, method, steps) for problem in problems) if each is not None]
    unknown = sum(map(math.isnan, found))
    within = sum(1 / 3 <= each <= 3 for each in found)
    assert len(found) >= 0.7 * len(problems)
    assert within >= 0.95 * (len(found) - unknown) - 1.0
    assert unknown <= 0.05 * len(found)


def some(make, seeds):
    found = []
    for seed in seeds:
        try:
            found.append(make(seed))
        except li.InputError:  # impulses through nodes without mass
            continue
    return found


def test_halving_of_some_random_schemes():
    judge(some(random_problem, range(8)), "moreau-jean", 200)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["moreau-jean", "newmark-ns", "rattle-ns", "schatzman-paoli"])
def test_halving_of_random_schemes(method):
    taken = [each for each in some(random_problem, range(100, 160)) if method in methods_that_handle(each.dynamics)]
    judge(taken[:10], method, 200)


@pytest.mark.slow
def test_halving_of_random_schemes_with_friction():
    judge(some(frictional, range(20)), "moreau-jean", 200)


@pytest.mark.slow
def test_halving_over_the_registry():
    """Bars have ten elements: the exact motion of a hundred takes a minute, and those of ten bounce as they do."""
    bars = {name: {"elements": 10.0} for name in PROBLEMS if "bar" in name}
    judge(
        [li.load_problem(name, **bars.get(name, {})) for name in PROBLEMS if name not in LAGRANGIAN], "moreau-jean", 400
    )
