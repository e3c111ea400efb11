"""Studies on Lagrangian systems: what they find, and what they refuse."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import ellipk

import lcpimpact as li
from lcpimpact.quantities import forces_without_impulses, peak_force

PENDULUM = li.load_problem("pendulum-and-wall")


@pytest.mark.parametrize(
    ("study", "remedy"),
    [
        (lambda: li.lyapunov(PENDULUM), "take another method"),
        (lambda: li.poincare(PENDULUM, "impact"), "method='event-driven'"),
        (lambda: li.sensitivity(PENDULUM, ["phi"], ["φ@1"]), "differences of its runs by 'event-driven'"),
        (lambda: li.sensitivity(PENDULUM, ["phi"], ["φ@1"], method="event-driven"), "differences of its runs"),
    ],
)
def test_studies_of_exact_motions_refuse_in_one_sentence(study, remedy):
    with pytest.raises(li.UnsupportedError, match=r"depend on the motion \(M\(q\)\)") as refusal:
        study()
    assert remedy in str(refusal.value)
    assert "\n" not in str(refusal.value)


# ---- cross-validation -----------------------------------------------------------------------------------------------


def test_an_impact_may_be_exact_by_chance_in_a_coarse_run():
    # The first impact is right to 6e-5 s with the coarsest step, and to 3e-3 s with a third of it.
    verdict = li.cross_validate(PENDULUM, ["event-driven", "moreau-jean"])
    errors = [
        abs(li.simulate(PENDULUM, dt=PENDULUM.t_end / n, progress=False).events[0].t - PENDULUM.facts[0].value)
        for n in (195, 585)
    ]
    assert errors[0] < 0.1 * errors[1]
    assert verdict.agree, str(verdict)


def test_reactions_of_redundant_rows_are_compared_by_their_force_on_the_body():
    block = li.load_problem("block-on-corners")
    runs = [li.simulate(block, method, dt=block.t_end / 195) for method in ("event-driven", "moreau-jean")]
    assert max(abs(runs[0].reaction[-1] - runs[1].reaction[-1])) > 1.0  # N; A_T = -B_T is free
    verdict = li.cross_validate(block, ["event-driven", "moreau-jean"])
    assert verdict.agree, str(verdict)
    for run in runs:
        assert sorted((event.kind, event.contact) for event in run.events) == [("stick", "A_T"), ("stick", "B_T")]


def test_a_wrong_friction_is_told_though_rows_are_redundant():
    block = li.load_problem("block-on-corners")
    slower = li.load_problem("block-on-corners", mu=1.01 * block.parameters["mu"])
    verdict = li.cross_validate(block, {"event-driven": "event-driven", "mine": slower.motion})
    assert verdict.outcome.name == "DISAGREE"


def test_siconos_refuses_matrices_that_change():
    verdict = li.cross_validate(PENDULUM, ["event-driven", "siconos"])
    (reason,) = [each for each in verdict.reasons if each.startswith("'siconos'")]
    assert "masses and directions that depend on the motion, which the route by Siconos" in reason


def test_what_begins_at_its_limit_may_slip_in_the_first_mode_or_right_after_it():
    toy = li.load_problem("woodpecker-bodies")
    verdict = li.cross_validate(toy, ["event-driven", "moreau-jean"], t_end=0.05)
    assert verdict.outcome.name != "DISAGREE", str(verdict)


# ---- orbits ---------------------------------------------------------------------------------------------------------


def test_an_orbit_with_an_impact_is_that_of_the_linear_oscillator():
    ζ, ω, e, f = 0.05, 2.6, 0.8, 1.0
    stop = li.FrictionContact("R", gap=lambda t, q: -q[0], e=e)
    oscillator = li.Lagrangian(
        "x",
        M=lambda q: np.array([[1.0]]),
        V=lambda q: 0.5 * q[0] ** 2,
        Q=lambda t, q, v: np.array([f * np.cos(ω * t) - 2.0 * ζ * v[0]]),
        contacts=[stop],
    )
    linear = li.Scheme(
        li.Mass("x", 1.0),
        li.KelvinVoigt("x", "ground", 1.0, 2.0 * ζ),
        li.Load("x", li.Harmonic(f, ω)),
        li.Bumper("x", "ground", e=e, name="R"),
    )
    start = {"x": -0.3}
    by_differences = li.periodic_orbit(
        li.Problem("moving", oscillator, q0=start), T=2.0 * math.pi / ω, transient=8, progress=False
    )
    exact = li.periodic_orbit(li.Problem("linear", linear, q0=start), transient=8, progress=False)
    assert len(exact.impacts) >= 1
    assert by_differences.forced
    assert by_differences.stable == exact.stable
    assert_allclose(by_differences.speeds, exact.speeds, rtol=1e-8)
    assert_allclose(by_differences.floquet, exact.floquet, rtol=1e-6)
    with pytest.raises(li.InputError, match="give their period, T"):
        li.periodic_orbit(li.Problem("moving", oscillator, q0=start))


def test_the_period_of_a_pendulum_by_an_elliptic_integral():
    pendulum = li.Lagrangian("φ", M=lambda q: np.array([[1.0]]), V=lambda q: -np.cos(q[0]))
    orbit = li.periodic_orbit(li.Problem("pendulum", pendulum, q0={"φ": 1.2}), T=6.5, progress=False)
    state = orbit.sample(0.0)
    sine = math.sqrt(0.5 * (0.5 * state.v[0, 0] ** 2 + 1.0 - math.cos(state.q[0, 0])))
    assert_allclose(orbit.T, 4.0 * ellipk(sine**2), rtol=1e-9)
    assert not orbit.forced


def test_the_woodpecker_falls_and_returns():
    # Its multiplier by saltation matrices; y, on which nothing depends, does not return.
    orbit = li.periodic_orbit(li.load_problem("woodpecker"), T=0.146, progress=False)
    assert_allclose(orbit.T, 0.14597606514, rtol=1e-10)
    assert_allclose(orbit.floquet[:2].real, [1.0, -0.839156], rtol=1e-6)
    y = orbit.sample(0.1 + orbit.T * np.arange(3.0)).q[:, 0]
    assert_allclose(np.diff(y), 0.019445379285, rtol=1e-9)


@pytest.mark.slow
def test_the_woodpecker_as_bodies_has_the_orbit_of_the_linear_one():
    exact, bodies = (
        li.periodic_orbit(li.load_problem(name), T=0.146, progress=False)
        for name in ("woodpecker", "woodpecker-bodies")
    )
    assert_allclose(bodies.T, exact.T, rtol=1e-10)
    assert_allclose(bodies.floquet[:2], exact.floquet[:2], rtol=1e-7)


def test_forces_of_gaps_in_metres_are_in_newtons_though_coordinates_are_angles():
    assert PENDULUM.unit("N") == "N"
    assert PENDULUM.unit("v_φ") == "rad/s"
    run = li.simulate(PENDULUM, "event-driven", dt=0.01, t_end=1.0)
    assert_allclose(run.events[0].impulse, PENDULUM.facts[2].value, rtol=1e-9)
    assert PENDULUM.facts[2].unit == "N s"
    assert PENDULUM.own_unit("N s") == "N s"


# ---- steps on contacts that turn ------------------------------------------------------------------------------------


def test_forces_of_a_contact_that_turns_are_no_impulses():
    disc = li.load_problem("disc-in-bowl")
    run = li.simulate(disc, dt=disc.t_end / 1000)
    assert (forces_without_impulses(run) == run.forces).all()
    rod = li.load_problem("painleve-jam")
    run = li.simulate(rod, dt=rod.t_end / 1039)
    assert_allclose(peak_force(run), run["N"].max(), rtol=1e-3)


def test_steps_tell_the_jam_that_they_take_and_the_one_that_they_pass():
    rod = li.load_problem("painleve-jam")
    jammed = li.simulate(rod, dt=rod.t_end / 2078)
    (jam,) = (event for event in jammed.events if event.kind == "jam" and event.contact == "N")
    assert_allclose(jam.impulse, rod.facts[4].value, rtol=0.02)  # O(h)
    assert abs(jam.t - rod.facts[2].value) < 2.0 * rod.t_end / 2078
    passed = li.simulate(rod, dt=rod.t_end / 1039)
    assert not passed.events
    assert "no motion without an impulse obeys the laws of friction, and the steps slid on" in passed.message
