"""Quantities of a run by name, judged by closed forms of registered problems and by momentum and energy."""

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

import lcpimpact as li
from lcpimpact.problems import PROBLEMS
from lcpimpact.quantities import SUMMARY, forces_without_impulses, quantity, series_names


def facts(problem):
    return {fact.symbol: fact.value for fact in problem.facts}


def run_of(name, method="exact", steps=1000, **parameters):
    problem = li.load_problem(name, **parameters)
    return problem, li.simulate(problem, method, dt=problem.t_end / steps)


def value(run, name):
    return quantity(name, run.problem).measure(run)


@pytest.mark.parametrize(
    ("name", "method", "expected"),
    [
        ("system-1", "exact", {"peak_force": "R_max", "contact_time": "t_1", "R.max": "R_max", "open:1": "t_1"}),
        ("system-2", "exact", {"peak_force": "R_max", "contact_time": "t_1", "close:1": "t_2"}),
        ("system-3", "exact", {"peak_force": "R_max", "contact_time": "t_1", "x@3.0": "x(3)", "R@3": "R(3)"}),
        ("hertz-impact", "event-driven",
         {"peak_force": "F_max", "contact_time": "T", "restitution": "e", "deformation": "δ_max", "F.max": "F_max"}),
        ("hunt-crossley-impact", "event-driven",
         {"peak_force": "F_max", "restitution": "e", "rebound_speed": "e", "deformation": "δ_max"}),
        ("kelvin-voigt-impact", "exact",
         {"peak_force": "R_max", "contact_time": "t_c", "restitution": "e", "deformation": "x_max"}),
        ("maxwell-impact", "exact",
         {"peak_force": "R_max", "contact_time": "t_c", "restitution": "e"}),
        ("bouncing-ball", "exact",
         {"impact:1": "t_1", "impact:3": "t_3", "impact:1.speed": "v_1", "R.impact:3.speed": "v_3"}),
    ],
)  # fmt: skip
def test_the_closed_form_of_a_problem(name, method, expected):
    problem, run = run_of(name, method)
    known = facts(problem)
    for asked, symbol in expected.items():
        assert_allclose(value(run, asked), known[symbol], rtol=3e-8, atol=1e-12, err_msg=asked)


@pytest.mark.parametrize("method", ["exact", "moreau-jean", "newmark-ns", "event-driven", "schatzman-paoli"])
@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_the_first_impacts_of_a_ball(method, e):
    problem = li.load_problem("bouncing-ball", e=e)
    run = li.simulate(problem, method, dt=1e-4, t_end=0.6)
    v = math.sqrt(2.0 * 9.81)
    found, tol = run.summary(), 2e-3
    assert found["impacts"] == 1
    assert_allclose(found["restitution"], e, atol=tol)
    assert_allclose(found["rebound_speed"], e * v, atol=tol * v)
    assert_allclose(found["dissipated"], 9.81 * (1.0 - e**2), atol=tol * 9.81)
    # The weight acts all along, the impulses change the momentum back.
    assert_allclose(
        found["impulse"], 9.81 * 0.6 - float(run.v[-1, 0]), rtol=1e-9 if method != "schatzman-paoli" else 1e-4
    )
    assert_allclose(value(run, "impact:1.impulse"), (1.0 + e) * v, rtol=tol)
    assert math.isnan(value(run, "impact:2"))
    assert math.isnan(found["deformation"])
    assert found["contact_time"] == 0.0 if e else math.isnan(found["contact_time"])


@pytest.mark.parametrize("steps", [1009, 3001])
@pytest.mark.parametrize("method", ["moreau-jean", "rattle-ns", "generalized-alpha", "cd-lagrange", "radau", "exact"])
def test_the_last_of_accumulating_impacts_are_no_force(method, steps):
    """A ball that comes to rest presses with its weight, m g from the instant (1 + e)/(1 - e) sqrt(2 H/g) on."""
    run = li.simulate(li.load_problem("bouncing-ball", m=2.0, e=0.5), method, dt=3.0 / steps, t_end=3.0)
    assert run.summary()["peak_force"] == pytest.approx(2.0 * 9.81, rel=1e-3)


def test_system_1_against_an_integration_of_its_own():
    """Restitution, loss and momentum of the first contact by DOP853, which knows nothing of the package."""
    m, k, c, g = 100.0, 3924.0, 250.0, 9.81
    end = li.load_problem("system-1").facts[1].value
    v0 = math.sqrt(2.0 * g * 5.0)
    found = solve_ivp(
        lambda t, y: [y[1], g - (k * y[0] + c * y[1]) / m, c * y[1] ** 2, k * y[0] + c * y[1]],
        (0.0, end), [0.0, v0, 0.0, 0.0], method="DOP853", rtol=1e-12, atol=1e-12,
    ).y[:, -1]  # fmt: skip
    run = li.simulate(li.load_problem("system-1"), "exact", dt=end / 200, t_end=end)
    again = li.simulate(li.load_problem("system-1"), "exact", dt=1e-2, t_end=1.0)
    assert_allclose(again.summary()["restitution"], -found[1] / v0, rtol=1e-9)
    assert_allclose(again.summary()["rebound_speed"], -found[1], rtol=1e-9)
    assert_allclose(run.summary()["dissipated"], found[2], rtol=1e-9)
    assert_allclose(run.summary()["impulse"], found[3], rtol=1e-9)
    by_steps = li.simulate(li.load_problem("system-1"), dt=1e-4, t_end=1.0).summary()
    assert_allclose(by_steps["restitution"], -found[1] / v0, rtol=1e-5)
    assert_allclose(by_steps["contact_time"], end, rtol=1e-5)
    assert_allclose(by_steps["peak_time"], again.summary()["peak_time"], rtol=1e-3)
    # At the peak of the force its rate is zero: k x' + c x'' = 0.
    at_peak = again.sample(again.summary()["peak_time"])
    x, v = float(at_peak.q[0, 0]), float(at_peak.v[0, 0])
    a = g - (k * x + c * v) / m
    assert abs(k * v + c * a) < 1e-5 * k * v0


def test_a_contact_among_several_and_what_does_not_happen():
    run = li.simulate(li.load_problem("newtons-cradle"), "exact", dt=1e-3)
    names = [contact.name for contact in run.problem.dynamics.contacts]
    last = [event.t for event in run.events if event.contact == names[-1] and event.kind == "impact"]
    assert value(run, f"{names[-1]}.impact:1") == last[0] > value(run, "impact:1")
    assert math.isnan(value(run, f"{names[-1]}.impact:{len(last) + 1}.speed"))
    at_rest = li.simulate(
        li.Problem("rest", li.Scheme(li.Mass("x", 1.0), li.Load("x", 9.81), li.Bumper("x", "ground", e=0.5))), dt=0.1
    ).summary()
    assert math.isnan(at_rest["restitution"])
    assert_allclose(at_rest["peak_force"], 9.81)


def test_series_extremes_and_values_at_an_instant():
    run = li.simulate(li.load_problem("system-1"), dt=1e-2, t_end=1.0)
    assert value(run, "R.max") == run["R"].max()
    assert value(run, "v_x.min") == run["v_x"].min()
    assert value(run, "x@0.5") == run["x"][50]
    assert (quantity("R", run.problem).series, quantity("v_x", run.problem).series) == ("t_R", "t")
    np.testing.assert_array_equal(value(run, "R"), run["R"])
    units = {name: quantity(name, run.problem).unit for name in ("x.max", "v_x@0", "R", "open:1", "open:1.speed")}
    assert list(units.values()) == ["m", "m/s", "N", "s", "m/s"]
    # The bodies part, and the plate stays behind: U of the contact is zero before, and jumps with its force.
    exact = li.simulate(li.load_problem("system-1"), "exact", dt=1e-2, t_end=1.0)
    event = next(each for each in exact.events if each.kind == "open")
    assert_allclose(value(exact, "open:1.speed"), abs(event.right.v[1] - event.right.v[0]), rtol=1e-12)


@pytest.mark.parametrize(
    ("name", "units"),
    [
        ("bouncing-ball", ["m", "m/s", "N", "s", "m/s", "N s", "N", "s", "J"]),
        ("rocking-block", ["rad", "rad/s", "N m", "s", "rad/s", "N m s", "N m", "s", "J"]),  # angles alone
        ("spinning-ball", ["rad", "rad/s", "N", "s", "m/s", "N s", "N", "s", "J"]),  # gaps of displacements
        ("impact-oscillator", [""] * 9),
        ("diode-bridge", ["", "", "", "s", "", "", "", "s", ""]),
    ],
)
def test_units_are_those_of_the_problem(name, units):
    problem = li.load_problem(name)
    d = problem.dynamics
    node, force = d.nodes[-1], d.forces[0].name
    names = (node, f"v_{node}.max", force, "open:1", "impact:1.speed", "impact:1.impulse")
    names = (*names, "peak_force", "contact_time", "dissipated")
    assert [quantity(each, problem).unit for each in names] == units
    run = li.simulate(problem, dt=problem.t_end / 1000, throw=False)
    summary = pickle.loads(pickle.dumps(run.summary()))
    assert [summary.units[each] for each in names[-3:]] == units[-3:]
    assert [row[2] for row in summary.rows()] == [summary.units[each] for each in SUMMARY]
    text = repr(run)
    assert f" {run.q[-1, -1]:.6g} {units[0]}".rstrip() + "\n" in text
    assert f"... {run.t[-1]:g} {units[3]}".rstrip() + " in " in text
    assert f"{np.abs(forces_without_impulses(run)[:, 0]).max():.6g} {units[2]}".rstrip() + ";" in text
    found = li.convergence(problem, ["moreau-jean"], [run.t[-1] / 500], norms=["sup_q"], reference=run, progress=False)
    of_both = {"spinning-ball": "m"}.get(name, units[0])
    assert found.head()[1].removeprefix("sup_q: greatest error of the coordinates").removeprefix(", ") == of_both


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("R.mx", "did you mean 'R.max'"),
        ("peak_forc", "did you mean 'peak_force'"),
        ("opne:1", "did you mean 'open:1'"),
        ("R.open:0", "counted from 1"),
        ("Q.open:1", "unknown contact 'Q'"),
        ("x@end", "instant in s"),
        ("x@-1", "instant in s"),
        ("", "unknown output"),
    ],
)
def test_an_unknown_name_gets_one_sentence_with_the_nearest(name, said):
    with pytest.raises(li.InputError, match=said) as caught:
        quantity(name, li.load_problem("system-1"))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", PROBLEMS)
def test_every_problem_has_a_summary_of_the_same_keys(name):
    problem = li.load_problem(name)
    run = li.simulate(problem, dt=problem.t_end / 500, throw=False)
    found = run.summary()
    assert list(found) == list(SUMMARY)
    assert all(isinstance(each, float) for each in found.values())
    assert not any(math.isinf(each) for each in found.values())
    for series in series_names(problem.dynamics)[:3]:
        assert math.isfinite(value(run, f"{series}.max"))
    pickle.loads(pickle.dumps(quantity("peak_force", problem)))


@pytest.mark.parametrize("method", ["moreau-jean", "exact", "rk4"])
def test_the_summary_of_a_run_that_ended_at_once(method):
    run = li.simulate(li.load_problem("system-1"), method, dt=1e-2, t_end=0.1)
    none = len(run.t_reaction) == len(run.t)
    short = replace(
        run,
        t=run.t[:1],
        q=run.q[:1],
        v=run.v[:1],
        t_reaction=run.t_reaction[:none],
        reaction=run.reaction[:none],
        events=(),
    )
    found = short.summary()
    assert (found["impacts"], found["impulse"], found["dissipated"]) == (0.0, 0.0, 0.0)
    assert math.isnan(found["restitution"])


@pytest.mark.parametrize("method", ["moreau-jean", "rattle-ns", "newmark-ns"])
@pytest.mark.parametrize("dt", [1e-2, 1e-3])
def test_the_largest_force_of_a_body_that_bounces_to_rest_is_that_at_rest(method: str, dt: float) -> None:
    scheme = li.Scheme(
        li.Mass("x", m=2.0), li.KelvinVoigt("x", "ground", k=50.0, c=3.0), li.Load("x", f=19.62),
        li.Bumper("x", "ground", gap=0.2, e=0.6),
    )  # fmt: skip
    problem = li.Problem("fall", scheme, q0={"x": -0.3})
    run = li.simulate(problem, method, dt=dt, t_end=4.0, error=False)
    at_rest = 19.62 - 0.2 * 50.0
    assert run["R"].max() > 1.03 * at_rest  # the last impacts are in the mean forces of steps
    assert quantity("R.max", problem).measure(run) == pytest.approx(at_rest, rel=1e-3)
    assert f"at most {quantity('R.max', problem).measure(run):.6g} N" in str(run)
