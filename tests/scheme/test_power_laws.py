"""Non-linear springs: Hertz and Hunt-Crossley by Newton around the LCP, against DOP853 and closed forms."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import lcpimpact as li
from lcpimpact import (
    Bumper,
    Harmonic,
    HertzSpring,
    HuntCrossley,
    KelvinVoigt,
    Load,
    Mass,
    PrescribedMotion,
    Scheme,
    Spring,
)
from lcpimpact.scheme.power_law import extended_force, force_at_rate, mean_force, spring_energy, spring_force
from lcpimpact.scheme.terms import PowerLaw


def reference(rate, state, times):
    run = solve_ivp(
        rate, (0.0, times[-1]), state, "DOP853", t_eval=times, rtol=1e-12, atol=1e-14, max_step=times[-1] / 500
    )
    return run.y


LAWS = [
    np.array(PowerLaw("law", "x", "y", 0.0, *each).numbers)
    for each in (
        (8.0, 1.5), (3.0, 2.0, 0.7), (5.0, 1.0, 0.0, 2.0, 0.0, 0.0, 0.0), (4.0, 1.5, 0.4, 1.5, 0.0, 0.0, 0.0),
        (5.0, 1.0, 0.0, 2.0), (5.0, 1.2, 0.0, 2.0, 0.0, 0.0, 0.0, 2.0), (5.0, 1.0, 0.0, 2.0, 0.0, 0.0, 1.0),
        (4.0, 1.5, 0.0, 1.5, 0.25), (4.0, 1.5, 0.0, 1.5, 0.5, 0.0, 0.0), (4.0, 1.5, 0.0, 1.5, 0.0, 0.5, 0.0),
    )
]  # fmt: skip
"""Hertz, Hunt and Crossley, Kelvin and Voigt, all terms at once, and the other stops: rows of `PowerLaw`."""


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("rate", [-3.0, -0.2, 0.0, 0.9])
@pytest.mark.parametrize("δ", [-0.6, -0.02, 0.03, 0.8])
def test_the_derivatives_of_the_law_are_its_slopes(law, δ, rate):
    η = 1e-6
    of_a_step = [lambda x, y, h=h: mean_force(law, x, y, h) for h in (1e-3, 0.5)]
    for f in (lambda x, y: spring_force(law, x, y), lambda x, y: extended_force(law, x, y), *of_a_step):
        _, by_δ, by_rate = f(δ, rate)
        assert by_δ == pytest.approx((f(δ + η, rate)[0] - f(δ - η, rate)[0]) / (2.0 * η), rel=1e-6, abs=1e-7)
        if rate:  # where the ends touch in the step, the mean has a corner at δ' = 0
            assert by_rate == pytest.approx((f(δ, rate + η)[0] - f(δ, rate - η)[0]) / (2.0 * η), rel=1e-6, abs=1e-7)
    energy = [spring_energy(*law[1:3], δ + η), spring_energy(*law[1:3], δ - η)]
    assert spring_force(law, δ, 0.0)[0] == pytest.approx((energy[0] - energy[1]) / (2.0 * η), rel=1e-6, abs=1e-7)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("y", [-0.9, 0.2, 3.0])
@pytest.mark.parametrize("δ", [-0.6, -0.02, 0.03, 0.8])
def test_newtons_method_has_the_slope_of_the_force_by_the_rate_of_separation(law, δ, y):
    η, θh, h = 1e-6, 0.03, 0.05
    slope = (force_at_rate(law, δ, y + η, θh, h)[0] - force_at_rate(law, δ, y - η, θh, h)[0]) / (2.0 * η)
    assert force_at_rate(law, δ, y, θh, h)[1] == pytest.approx(slope, rel=1e-6, abs=1e-7)


@pytest.mark.parametrize("rate", [-2.0, -0.1, 0.1, 2.0])
@pytest.mark.parametrize("δ", [-0.4, -0.01, 0.01, 0.4])
def test_the_mean_of_a_step_has_the_mean_of_the_damping(δ, rate):
    """c δ' dt over the part of a step in which the ends touch, by the times at which δ + δ' τ changes its sign."""
    c, h = 2.0, 0.5
    touch = sorted(np.clip([-0.5 * h, -δ / rate, 0.5 * h], -0.5 * h, 0.5 * h))
    touched = sum(b - a for a, b in pairwise(touch) if δ + rate * (a + b) / 2.0 > 0.0)
    F = max(0.0, 5.0 * max(δ, 0.0) + c * rate * touched / h)
    assert mean_force(LAWS[2], δ, rate, h)[0] == pytest.approx(F, abs=1e-12)


def test_the_law_and_its_energy():
    dynamics = Scheme(
        Mass("x", 1.0),
        Mass("y", 1.0),
        HertzSpring("x", "y", K=8.0, gap=0.5),
        HuntCrossley("y", "ground", K=3.0, b=0.5, n=2.0),
    ).assemble()
    q, v = np.array([2.0, -0.75]), np.array([0.25, 0.5])
    # δ = x - y - gap = 2.25 at the first; the second is apart.
    assert dynamics.approach(q).tolist() == [2.25, -0.75]
    np.testing.assert_allclose(dynamics.spring_force(q, v), [-8.0 * 2.25**1.5, 8.0 * 2.25**1.5], rtol=1e-14)
    assert float(dynamics.elastic_energy(q)) == pytest.approx(0.4 * 8.0 * 2.25**2.5, rel=1e-14)
    assert float(dynamics.spring_losses(q, v).sum()) == 0.0
    q = np.array([0.0, 0.5])
    np.testing.assert_allclose(dynamics.spring_force(q, v), [0.0, -3.0 * 0.25 * (1.0 + 0.5 * 0.5)], rtol=1e-14)
    assert float(dynamics.spring_losses(q, v).sum()) == pytest.approx(0.5 * 3.0 * 0.25 * 0.5**2, rel=1e-14)


@settings(max_examples=20)
@given(
    n=st.floats(1.0, 2.5),
    K=st.floats(10.0, 1e4),
    b=st.floats(0.0, 1.0),
    k=st.floats(1.0, 200.0),
    a=st.floats(0.0, 20.0),
)
def test_moreau_jean_follows_a_chain_with_a_power_law(n, K, b, k, a):
    """Two masses, a linear spring between them, a power law to the ground, a load."""
    law = HuntCrossley("y", "ground", K, b, n) if b > 0.0 else HertzSpring("y", "ground", K, n)
    scheme = Scheme(Mass("x", 1.0), Mass("y", 0.5), Spring("x", "y", k), law, Load("x", Harmonic(a, 5.0)))
    case = li.Problem("chain", scheme, q0={"y": -0.1, "x": -0.1}, v0={"x": 1.0, "y": 1.0})

    def rate(t, s):
        x, y, dx, dy = s
        δ = max(y, 0.0)
        force = K * δ**n * (1.0 + b * dy)
        return [dx, dy, k * (y - x) + a * math.cos(5.0 * t), 2.0 * (k * (x - y) - force)]

    y = reference(rate, [-0.1, -0.1, 1.0, 1.0], np.linspace(0.0, 1.0, 201))

    def error(steps):
        run = li.simulate(case, dt=1.0 / steps, t_end=1.0)
        return np.abs(run.q[:: steps // 200].T - y[:2]).max()

    # Where in its step the force has its kink is a matter of chance.
    coarse, fine = (max(error(factor * steps) for steps in (1_000, 1_200, 1_400)) for factor in (1, 8))
    assert coarse < 8e-3
    assert fine < max(coarse / 4.0, 1e-9)


def test_the_order_is_two_in_smooth_motion():
    case = li.Problem(
        "pressed", Scheme(Mass("x", 1.0), HertzSpring("x", "ground", 1e3), Load("x", 50.0)), q0={"x": 0.1}
    )

    def rate(t, s):
        return [s[1], 50.0 - 1e3 * max(s[0], 0.0) ** 1.5]

    counts, errors = (101, 173, 307, 499, 797, 1201), []
    for steps in counts:
        run = li.simulate(case, dt=1.0 / steps, t_end=1.0)
        errors.append(np.abs(run["x"] - reference(rate, [0.1, 0.0], run.t)[0]).max())
    assert np.polyfit(np.log(1.0 / np.array(counts)), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.2)


def test_rows_and_springs_together_obey_the_law_of_contact():
    """A body on a Hertzian layer, which pushes a plate with a stop under it: the LCP inside Newton's iteration."""
    scheme = Scheme(
        Mass("x", 1.0), Load("x", 9.81), Mass("y", 0.5), Load("y", 4.905), HertzSpring("x", "y", 1e4),
        Bumper("y", "z"), KelvinVoigt("z", "ground", 2e3, 20.0), Bumper("y", "ground", gap=0.02, e=0.5, name="S"),
    )  # fmt: skip
    case = li.Problem("layer", scheme, v0={"x": 2.0, "y": 2.0})
    coarse, fine = (li.simulate(case, dt=dt, t_end=0.5) for dt in (1e-4, 2.5e-5))
    assert fine.stats.newton_iterations > 0
    assert (fine["R"] > 0.0).any()
    assert any(event.kind == "impact" for event in fine.events)
    assert fine.certificate.complementarity < 1e-9
    assert fine.certificate.penetration < 1e-3
    assert np.abs(coarse["x"] - fine["x"][::4]).max() < 2e-3
    # No rule of energy for a non-linear spring: what the midpoint adds falls with h².
    assert fine.certificate.energy_balance < 1e-3 * fine.certificate.energy_scale


def test_a_driven_node_does_work_through_a_power_law():
    """A shaker beats a body through Hertz's law: the balance must count the shaker's force."""
    scheme = Scheme(
        PrescribedMotion("b", Harmonic(0.05, 10.0)), Mass("x", 1.0), HertzSpring("x", "b", 1e3), Load("x", 9.81)
    )
    case = li.Problem("shaker", scheme)
    coarse, fine = (li.simulate(case, dt=dt, t_end=2.0).certificate for dt in (1e-3, 1e-4))
    assert coarse.energy_balance > 20.0 * fine.energy_balance
    assert fine.energy_balance < 1e-3 * fine.energy_scale


@pytest.mark.parametrize("solver", ["auto", "qp:osqp", "qp:daqp:primal", "lemke"])
def test_solvers_of_either_kind_stand_inside_newton(solver):
    scheme = Scheme(
        Mass("x", 1.0),
        Mass("y", 1.0),
        HertzSpring("x", "y", 1e3),
        Bumper("y", "z"),
        KelvinVoigt("z", "ground", 1e3, 5.0),
    )
    case = li.Problem("chain", scheme, v0={"x": 1.0})
    run = li.simulate(case, dt=1e-3, t_end=0.3, lcp_solver=solver)
    np.testing.assert_allclose(run.q, li.simulate(case, dt=1e-3, t_end=0.3).q, rtol=0.0, atol=1e-6)


def test_newton_that_does_not_converge_says_so():
    """A spring so stiff that rounding alone is a force: the run ends with a status of its own."""
    case = li.Problem("stiff", Scheme(Mass("x", 1.0), HertzSpring("x", "ground", 1e60, n=30.0)), v0={"x": 1e3})
    run = li.simulate(case, dt=0.1, t_end=1.0, throw=False)
    assert run.status in (li.Status.NEWTON, li.Status.NON_FINITE)
    assert not run.success
    with pytest.raises(li.FailureError, match="did not converge"):
        li.simulate(case, dt=0.1, t_end=1.0)


def test_exact_refuses_springs_that_are_not_linear():
    case = li.Problem("hertz", Scheme(Mass("x", 1.0), HertzSpring("x", "ground", 1e3)), v0={"x": 1.0})
    with pytest.raises(
        li.UnsupportedError, match=r"exact does not handle non-linear springs \(HertzSpring .*moreau-jean"
    ):
        li.simulate(case, "exact", dt=1e-3, t_end=1.0)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: HertzSpring("x", "ground"), r"K is missing"),
        (lambda: HertzSpring("x", "ground", K=-1.0), r"K = -1.0 must be a positive"),
        (lambda: HertzSpring("x", "ground", K=1.0, n=0.5), r"n = 0.5 must be a finite number, at least 1"),
        (lambda: HertzSpring("x", "ground", K=1.0, gap=math.inf), r"gap = inf must be a finite"),
        (lambda: HuntCrossley("x", "ground", K=1.0), r"b is missing"),
        (lambda: Scheme(Mass("x", 1.0), HertzSpring("x", "y", K=1.0)).assemble(), r"nothing holds node 'y'"),
    ],
)
def test_bad_constants_are_refused_by_name(make, says):
    with pytest.raises(li.InputError, match=says):
        make()
