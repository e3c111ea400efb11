"""Sliders: the law, stick and slip by the exact solution against routes that share none of its code, and orders."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import lcpimpact as li
from lcpimpact import Bumper, Dashpot, Harmonic, Jenkins, KelvinVoigt, Load, Mass, PrescribedMotion, Slider, Spring

DRIVE = Load("x", Harmonic(30.0, 7.0, -0.5 * math.pi))


def problem(*elements, **start):
    return li.Problem("friction", li.Scheme(*elements), v0={"x": 1.0}, **start)


def test_a_slider_is_a_row_with_a_box():
    dynamics = li.Scheme(Mass("x", 2.0), Mass("y", 1.0), Slider("x", "y", r0=3.0)).assemble()
    np.testing.assert_array_equal(dynamics.H, [[-1.0, 1.0]])
    assert (dynamics.r_min.tolist(), dynamics.r_max.tolist()) == ([-3.0], [3.0])
    assert dynamics.of_rate.tolist() == [True]
    assert dynamics.contacts[0].relative_degree == 2
    assert "no impulse acts" in dynamics.contacts[0].sentence


@pytest.mark.parametrize(
    ("elements", "degree"),
    [
        ((Mass("x", 1.0), Slider("x", "ground", r0=1.0)), 2),
        ((Mass("x", 1.0), KelvinVoigt("x", "y", 1.0, 1.0), Slider("y", "ground", r0=1.0)), 1),
        ((Mass("x", 1.0), Spring("x", "y", 1.0), Slider("y", "ground", r0=1.0)), 0),
        ((Mass("x", 1.0), Jenkins("x", "ground", 1.0, 1.0)), 0),
    ],
)
def test_the_relative_degree_of_a_slider(elements, degree):
    assert li.Scheme(*elements).assemble().relative_degree.tolist() == [degree]


# ---- stick and slip against DOP853 with the modes written by hand ----------------------------------------------------


def forced_oscillator(m, k, F, a, ω, x0, t_end, times):
    """m x'' + k x + F sign x' = a sin ωt by DOP853: slips until x' = 0, sticks while |a sin ωt - k x| <= F."""
    t, x, v, found, switches = 0.0, x0, 0.0, np.empty(len(times)), []
    done = 0
    while t < t_end:
        push = a * math.sin(ω * t) - k * x
        if v == 0.0 and abs(push) < F * (1.0 - 1e-12):

            def excess(s, y):
                return F - abs(a * math.sin(ω * s) - k * y[0])

            rate, event, sign = (lambda s, y: [0.0, 0.0]), excess, 0
        else:
            sign = math.copysign(1.0, v if v != 0.0 else push)

            def rate(s, y, sign=sign):
                return [y[1], (a * math.sin(ω * s) - k * y[0] - sign * F) / m]

            def event(s, y, sign=sign):
                return sign * y[1]

        event.terminal, event.direction = True, -1
        run = solve_ivp(rate, (t, t_end), [x, v], "DOP853", events=event, rtol=1e-12, atol=1e-14, dense_output=True,
                        max_step=0.05)  # fmt: skip
        upto = int(np.searchsorted(times, run.t[-1], side="right"))
        if upto > done:
            found[done:upto] = run.sol(times[done:upto])[0]
        done, t, (x, v) = upto, run.t[-1], run.y[:, -1]
        if run.status == 1:
            switches.append(t)
            v = 0.0 if sign else v
    return found, switches


@settings(max_examples=25)
@given(
    k=st.floats(20.0, 200.0),
    F=st.floats(1.0, 12.0),
    a=st.floats(2.0, 30.0),
    ω=st.floats(2.0, 12.0),
    x0=st.floats(-1.0, 1.0),
)
def test_exact_follows_a_forced_oscillator_with_dry_friction(k, F, a, ω, x0):
    scheme = li.Scheme(
        Mass("x", 1.5),
        Spring("x", "ground", k),
        Slider("x", "ground", F),
        Load("x", Harmonic(a, ω, -0.5 * math.pi)),
    )
    run = li.simulate(li.Problem("forced", scheme, q0={"x": x0}), "exact", dt=0.01, t_end=3.0)
    x, switches = forced_oscillator(1.5, k, F, a, ω, x0, 3.0, run.t)
    np.testing.assert_allclose(run["x"], x, rtol=0.0, atol=1e-8)
    # The reference stops for an instant where the slider turns; the exact solution does not.
    assert all(min(abs(event.t - t) for t in switches) < 1e-6 for event in run.events)
    assert (np.abs(run["F"]) <= F).all()


def test_exact_follows_a_jenkins_element_by_return_mapping():
    """Elastic-plastic with hardening, driven in place: the force by the classical return mapping on a fine path."""
    k, f_y, k_h = 100.0, 5.0, 20.0
    scheme = li.Scheme(PrescribedMotion("x", Harmonic(0.2, 5.0, -0.5 * math.pi)), Jenkins("x", "ground", k, f_y, k_h))
    run = li.simulate(li.Problem("cycle", scheme), "exact", dt=1e-3, t_end=4.0)
    fine = 0.2 * np.sin(5.0 * np.linspace(0.0, 4.0, 400_001))
    plastic, found = 0.0, np.empty(4001)
    for n, x in enumerate(fine):
        trial = k * (x - plastic) - k_h * plastic
        if abs(trial) > f_y:
            plastic += math.copysign((abs(trial) - f_y) / (k + k_h), trial)
        if n % 100 == 0:
            found[n // 100] = plastic
    np.testing.assert_allclose(run["F.1"], found, rtol=0.0, atol=1e-9)


def test_a_force_beyond_the_threshold_at_the_start_gives_way_at_once():
    """A Jenkins element stretched to four times its yield force before the run begins."""
    scheme = li.Scheme(Mass("x", 1.0), Jenkins("x", "ground", 100.0, 5.0))
    run = li.simulate(li.Problem("overstretched", scheme, q0={"x": 0.2}), "exact", dt=1e-3, t_end=0.5)
    assert run["F.1"][0] == pytest.approx(0.15, rel=1e-12)
    # From 0.2 m at rest with the spring at its threshold it swings about 0.15 m as on the spring alone.
    np.testing.assert_allclose(run["x"], 0.15 + 0.05 * np.cos(10.0 * run.t), rtol=0.0, atol=1e-12)


# ---- orders and laws -------------------------------------------------------------------------------------------------

SCHEMES = {
    "degree 0": (Mass("x", 1.0), Spring("x", "ground", 50.0), Jenkins("x", "ground", 100.0, 5.0), DRIVE),
    "degree 0 with hardening": (Mass("x", 1.0), Jenkins("x", "ground", 100.0, 5.0, k_h=20.0), DRIVE),
    "degree 1": (Mass("x", 1.0), KelvinVoigt("x", "y", 100.0, 3.0), Slider("y", "ground", 5.0), DRIVE),
    "Bingham": (
        Mass("x", 1.0),
        Spring("x", "y", 100.0),
        Dashpot("y", "ground", 3.0),
        Slider("y", "ground", 5.0),
        DRIVE,
    ),
    "degree 2": (Mass("x", 1.0), Spring("x", "ground", 100.0), Slider("x", "ground", 5.0), DRIVE),
    "two bodies": (
        Mass("x", 1.0),
        Mass("y", 2.0),
        Spring("x", "ground", 100.0),
        Spring("x", "y", 300.0),
        Slider("x", "y", 5.0, name="F1"),
        Slider("y", "ground", 4.0, name="F2"),
        DRIVE,
    ),
    "stop": (
        Mass("x", 1.0),
        Spring("x", "ground", 100.0),
        Slider("x", "ground", 3.0),
        Bumper("x", "z", gap=0.05),
        KelvinVoigt("z", "ground", 500.0, 10.0),
        DRIVE,
    ),
    "table": (
        PrescribedMotion("b", Harmonic(0.1, 9.0)),
        Mass("x", 1.0),
        KelvinVoigt("x", "b", 100.0, 2.0),
        Slider("x", "ground", 2.0),
    ),
}
COUNTS = (307, 499, 797, 1201, 1999, 3001, 4999, 7993)


@pytest.mark.parametrize("name", SCHEMES)
def test_moreau_jean_has_its_declared_order_with_sliders(name):
    case = li.Problem(name, li.Scheme(*SCHEMES[name]), v0={"x": 1.0})
    exact = li.simulate(case, "exact", dt=0.03, t_end=3.0)
    assert any(event.kind == "slip" for event in exact.events)
    massive = case.dynamics.massive
    errors = []
    for n in COUNTS:
        run = li.simulate(case, dt=3.0 / n, t_end=3.0)
        errors.append(np.abs(run.q - exact.sample(run.t).q)[:, massive].max())
    slope = np.polyfit(np.log(3.0 / np.array(COUNTS)), np.log(errors), 1)[0]
    sliders = case.dynamics.relative_degree[case.dynamics.of_rate]
    declared = 1.0 if 2 in sliders else 2.0
    assert slope == pytest.approx(declared, abs=0.35)


@pytest.mark.parametrize("method", ["moreau-jean", "exact"])
@pytest.mark.parametrize("name", SCHEMES)
def test_the_law_of_coulomb_holds_and_the_energy_balances(name, method):
    case = li.Problem(name, li.Scheme(*SCHEMES[name]), v0={"x": 1.0})
    run = li.simulate(case, method, dt=1e-3, t_end=3.0)
    c = run.certificate
    assert c.complementarity < 1e-11 * (1.0 + c.energy_scale)
    assert c.penetration < 1e-11
    # At degree 0 the slider's place is set right after a step, which takes energy of second order.
    allowed = 2e-2 if method == "moreau-jean" and "degree 0" in name else 1e-10 * (1.0 + c.energy_scale)
    assert c.energy_balance < allowed


def test_a_body_comes_to_rest_and_stays_there():
    run = li.simulate(problem(Mass("x", 1.0), Slider("x", "ground", 2.0)), dt=1e-3, t_end=2.0)
    assert [event.kind for event in run.events] == ["stick"]
    assert run.events[0].t == pytest.approx(0.5, abs=2e-3)
    assert (run["v_x"][600:] == 0.0).all()
    assert run["x"][-1] == pytest.approx(0.25, abs=2e-3)
    exact = li.simulate(problem(Mass("x", 1.0), Slider("x", "ground", 2.0)), "exact", dt=1e-2, t_end=2.0)
    assert exact.events[0].t == pytest.approx(0.5, rel=1e-13)
    assert exact["x"][-1] == pytest.approx(0.25, rel=1e-13)


def test_a_slider_that_turns_slips_anew_and_does_not_stick():
    case = li.Problem("turns", li.Scheme(Mass("x", 1.0), Spring("x", "ground", 100.0), Slider("x", "ground", 10.0)),
                      q0={"x": 1.05})  # fmt: skip
    for method in ("moreau-jean", "exact"):
        run = li.simulate(case, method, dt=1e-3, t_end=3.0)
        assert [event.kind for event in run.events] == ["slip"] * 4 + ["stick"]
        assert run.events[-1].t == pytest.approx(0.5 * math.pi, abs=2e-3)


@pytest.mark.parametrize("solver", ["lemke", "pgs", "active-set", "block-pivoting", "enumeration", "qp:osqp"])
def test_every_kind_of_solver_takes_the_box(solver):
    case = li.Problem("two", li.Scheme(*SCHEMES["two bodies"]), v0={"x": 1.0})
    reference = li.simulate(case, dt=1e-3, t_end=0.2)
    run = li.simulate(case, dt=1e-3, t_end=0.2, lcp_solver=solver)
    np.testing.assert_allclose(run.q, reference.q, rtol=0.0, atol=1e-6)


def test_a_solver_without_bounds_is_refused_by_name():
    case = li.Problem("two", li.Scheme(*SCHEMES["two bodies"]), v0={"x": 1.0})
    with pytest.raises(li.UnsupportedError, match=r"'nnls' needs lower = 0 and upper = inf"):
        li.simulate(case, dt=1e-3, t_end=0.2, lcp_solver="nnls")


def test_a_stop_beside_a_slider_leaves_the_shares_open_and_the_motion_determined():
    """Bumper and slider between the same two nodes: W is singular where both hold."""
    case = li.Problem(
        "stop",
        li.Scheme(Mass("x", 1.0), Load("x", 9.0), Slider("x", "ground", 2.0), Bumper("x", "ground", gap=0.1, e=0.0)),
    )
    run = li.simulate(case, dt=1e-3, t_end=1.0)
    assert run["x"][-1] == pytest.approx(0.1, abs=1e-3)
    assert run["R"][-1] + run["F"][-1] == pytest.approx(9.0, rel=1e-9)


# ---- refusals --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Slider("x", "ground"), r"Slider between 'x' and 'ground': r0 is missing"),
        (lambda: Slider("x", "ground", r0=-1.0), r"r0 = -1.0 must be a positive finite number in N"),
        (lambda: Slider("x", "x", r0=1.0), r"both ends are one node"),
        (lambda: Slider("x", "ground", r0=1.0, name=""), r"name = '' must be a string"),
        (lambda: Jenkins("x", "ground", k=1.0), r"f_y is missing"),
        (lambda: Jenkins("x", "ground", 1.0, 1.0, k_h=0.0), r"k_h = 0.0 must be a positive"),
    ],
)
def test_bad_constants_are_refused_by_name(make, says):
    with pytest.raises(li.InputError, match=says):
        make()


@pytest.mark.parametrize(
    ("elements", "says"),
    [
        (
            (Mass("x", 1.0), Slider("x", "ground", 1.0), Slider("x", "ground", 2.0, name="G")),
            r"closes a loop with others",
        ),
        ((Mass("x", 1.0), *(Jenkins("x", "ground", k, 1.0, name="F") for k in (1.0, 2.0))), r"another name="),
        ((Mass("x", 1.0), Slider("x", "y", 1.0)), r"nothing holds node 'y'"),
    ],
)
def test_schemes_that_leave_something_open_are_refused(elements, says):
    with pytest.raises(li.InputError, match=says):
        li.Scheme(*elements).assemble()


def test_the_papers_method_refuses_sliders_by_name():
    case = problem(Mass("x", 1.0), Slider("x", "ground", 2.0))
    with pytest.raises(li.UnsupportedError, match=r"rk4-paper does not handle .*'moreau-jean' or .*'exact'"):
        li.simulate(case, "rk4-paper", dt=1e-3, t_end=1.0)


@pytest.mark.parametrize("method", ["exact", "event-driven", "radau-fesd"])
def test_a_jenkins_element_that_is_carried_along_has_no_force(method):
    """A body at the speed of the belt; the force of the slider is the rounding of k (x - y), and no error of the record."""
    scheme = li.Scheme(
        Mass("x", 1.0), PrescribedMotion("belt", li.Polynomial((0.0, 0.5))), Jenkins("x", "belt", 30.0, 0.4)
    )
    run = li.simulate(li.Problem("carried", scheme, v0={"x": 0.5}), method, dt=0.02, t_end=1.0)
    np.testing.assert_allclose(run["x"], 0.5 * run.t, rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(run.reaction, 0.0, atol=1e-13)
    assert not run.events
