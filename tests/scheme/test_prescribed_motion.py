"""Nodes whose motion is given: forced vibration in closed form, the work of the drive, and refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest

import lcpimpact as li
from lcpimpact import Bumper, Harmonic, KelvinVoigt, Load, Mass, Motion, PrescribedMotion, Scheme, Spring
from lcpimpact.scheme.decomposition import decompose

A, Ω, M, K, C = 0.1, 7.0, 1.5, 60.0, 2.0
DRIVEN = PrescribedMotion("b", Harmonic(A, Ω, 0.3))
SHAKEN = Scheme(DRIVEN, Mass("x", M), KelvinVoigt("x", "b", K, C))


def steady(t):
    """x and x' of m x'' + c (x' - y') + k (x - y) = 0, y = a cos(Ω t + φ), by the complex transfer function."""
    transfer = (K + 1j * C * Ω) / (K - M * Ω**2 + 1j * C * Ω)
    phasor = A * transfer * np.exp(1j * (Ω * np.asarray(t) + 0.3))
    return phasor.real, (1j * Ω * phasor).real


START = {"q0": {"x": float(steady(0.0)[0])}, "v0": {"x": float(steady(0.0)[1])}}


def test_exact_is_the_transfer_function():
    run = li.simulate(li.Problem("shaken", SHAKEN, **START), "exact", dt=1e-2, t_end=10.0)
    x, v = steady(run.t)
    np.testing.assert_allclose(run["x"], x, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(run["v_x"], v, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(run["b"], A * np.cos(Ω * run.t + 0.3), rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(run["v_b"], -A * Ω * np.sin(Ω * run.t + 0.3), rtol=0.0, atol=1e-12)
    assert run.certificate.energy_balance < 1e-11


@pytest.mark.parametrize(("theta", "order"), [(0.5, 2.0), (1.0, 1.0)])
def test_moreau_jean_has_its_order_under_a_motion_that_is_given(theta, order):
    problem = li.Problem("shaken", SHAKEN, **START)
    counts, errors = (401, 797, 1201, 1999, 3001, 4001), []
    for n in counts:
        run = li.simulate(problem, dt=5.0 / n, t_end=5.0, theta=theta)
        errors.append(np.abs(run["x"] - steady(run.t)[0]).max())
        np.testing.assert_allclose(run["b"], A * np.cos(Ω * run.t + 0.3), rtol=0.0, atol=1e-15)
    assert -np.polyfit(np.log(counts), np.log(errors), 1)[0] == pytest.approx(order, abs=0.2)


def test_the_balance_of_energy_counts_the_drive():
    run = li.simulate(li.Problem("shaken", SHAKEN, **START), dt=1e-3, t_end=5.0)
    assert run.certificate.energy_balance < 1e-10
    # Without the work of the drive it would not close: the dashpot takes more than the energy that is there.
    assert (np.gradient(run["x"] - run["b"], run.t) ** 2).mean() * C * 5.0 > run.certificate.energy_scale


def test_a_function_of_your_own_with_its_velocity_is_a_motion():
    ramp = Motion(lambda t: 0.5 * t, lambda t: 0.5)
    scheme = Scheme(PrescribedMotion("b", ramp), Mass("x", 1.0), Spring("x", "b", 100.0))
    run = li.simulate(li.Problem("pulled", scheme), dt=1e-4, t_end=1.0)
    np.testing.assert_allclose(run["x"], 0.5 * run.t - 0.05 * np.sin(10.0 * run.t), rtol=0.0, atol=1e-7)
    with pytest.raises(li.UnsupportedError, match="motion of 'b' is a function of time"):
        li.simulate(li.Problem("pulled", scheme), "exact", dt=1e-4, t_end=1.0)


def test_a_plate_on_a_spring_follows_a_node_that_is_driven():
    """A massless node between two springs, one of them driven: half the motion, by either method."""
    scheme = Scheme(PrescribedMotion("b", Harmonic(1.0, 3.0)), Spring("b", "y", 10.0), Spring("y", "ground", 10.0))
    for method in ("moreau-jean", "exact"):
        run = li.simulate(li.Problem("half", scheme, q0={"y": 0.5}), method, dt=1e-2, t_end=2.0)
        np.testing.assert_allclose(run["y"], 0.5 * np.cos(3.0 * run.t), rtol=0.0, atol=1e-12)


def test_impacts_count_the_velocity_of_the_table():
    """A table that rises at 1 m/s meets a resting ball: U⁺ = -e U⁻ asks for 1.5 m/s."""
    scheme = Scheme(
        PrescribedMotion("y", Motion(lambda t: 0.5 - t, lambda t: -1.0)), Mass("x", 1.0), Bumper("x", "y", e=0.5)
    )
    run = li.simulate(li.Problem("rising", scheme), dt=1e-3, t_end=1.0)
    (impact,) = run.events
    assert impact.t == pytest.approx(0.5, abs=2e-3)
    assert run["v_x"][-1] == pytest.approx(-1.5, rel=1e-12)
    assert impact.impulse == pytest.approx(1.5, rel=1e-9)


def test_driven_nodes_are_no_coordinates_of_their_own():
    dynamics = SHAKEN.assemble()
    parts = decompose(dynamics.M, dynamics.C, dynamics.driven)
    assert [part.shape[1] for part in (parts.massive, parts.damped, parts.static, parts.driven)] == [1, 0, 0, 1]
    assert dynamics.massive.tolist() == [False, True]
    assert not dynamics.massive[dynamics.driven].any()


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: PrescribedMotion("ground", Harmonic(1.0, 1.0)), r"the ground does not move"),
        (lambda: PrescribedMotion("b"), r"must be a motion that knows its velocity"),
        (lambda: PrescribedMotion("b", math.sin), r"must be a motion that knows its velocity"),
        (
            lambda: Scheme(PrescribedMotion("b", Harmonic(1.0, 1.0)), Mass("b", 1.0)).assemble(),
            r"'b' has a mass and a prescribed motion",
        ),
        (
            lambda: Scheme(
                PrescribedMotion("b", Harmonic(1.0, 1.0)), PrescribedMotion("b", Harmonic(2.0, 1.0))
            ).assemble(),
            r"'b' has two prescribed motions",
        ),
        (
            lambda: li.Problem("shaken", SHAKEN, q0={"b": 1.0}),
            r"q0\['b'\] of problem 'shaken': the motion .* leave the value out",
        ),
    ],
)
def test_what_contradicts_a_given_motion_is_refused(make, says):
    with pytest.raises(li.InputError, match=says):
        make()


def test_a_problem_begins_where_the_motion_begins():
    problem = li.Problem("table", Scheme(PrescribedMotion("y", Harmonic(0.2, 2.0, 1.0)), Mass("x", 1.0), Load("x", 1.0),
                                         Bumper("x", "y", gap=1.0, e=0.0)))  # fmt: skip
    assert problem.initial_coordinates[0] == pytest.approx(0.2 * math.cos(1.0), rel=1e-15)
    assert problem.initial_velocities[0] == pytest.approx(-0.4 * math.sin(1.0), rel=1e-15)
    with pytest.raises(li.InputError, match="starts penetrated"):
        li.Problem(
            "table", Scheme(PrescribedMotion("y", Harmonic(0.2, 2.0, 3.0)), Mass("x", 1.0), Bumper("x", "y", e=0.0))
        )


@pytest.mark.parametrize("method", ["exact", "event-driven", "moreau-jean"])
def test_a_table_that_sets_off_as_a_sine_under_a_body_pushes_it(method):
    """Its place at the start is 6e-18 m, the rounding of a cos(-π/2): P = m a ω, then R = (k - m ω²) a sin(ω t)."""
    a, ω, m, k, T = 0.1, 5.0, 1.0, 100.0, 0.3
    table = PrescribedMotion("w", Harmonic(a, ω, -0.5 * math.pi))
    scheme = Scheme(table, Mass("x", m), Spring("x", "ground", k), Bumper("w", "x", e=0.0))
    run = li.simulate(li.Problem("pushed", scheme), method, dt=1e-3, t_end=T)
    (impact,) = (event for event in run.events if event.kind == "impact")
    rtol = 1e-2 if method == "moreau-jean" else 1e-9
    assert impact.impulse == pytest.approx(m * a * ω, rel=rtol)
    assert run["x"][-1] == pytest.approx(a * math.sin(ω * T), rel=rtol)
    assert run["R"][-1] == pytest.approx((k - m * ω**2) * a * math.sin(ω * T), rel=rtol)


def test_a_body_within_a_table_that_is_moved_starts_penetrated():
    scheme = Scheme(PrescribedMotion("w", Harmonic(0.1, 5.0, -0.5 * math.pi)), Mass("x", 1.0), Bumper("w", "x", e=0.0))
    with pytest.raises(li.InputError, match=r"starts penetrated by 1\S*e-12 m"):
        li.Problem("within", scheme, q0={"x": -1e-12})


def on_a_cam(scheme, ω, φ, *, A=0.005, m=0.2, k=2000.0, F=60.0):
    """A follower that a spring presses on y = A cos(ω t + φ) from the start, for three turns."""
    cam = PrescribedMotion("y", Harmonic(A, ω, φ))
    parts = Spring("x", "ground", k), Mass("x", m), Load("x", F), cam, Bumper("x", "y", e=0.0)
    start = {"q0": {"x": A * math.cos(φ)}, "v0": {"x": -A * ω * math.sin(φ)}}
    return li.Problem("cam", scheme(*parts), **start, t_end=6.0 * math.pi / ω)


@pytest.mark.parametrize("scheme", [Scheme, li.SparseScheme])
@pytest.mark.parametrize("φ", [0.0, 2.0, 4.0])
@pytest.mark.parametrize("steps", [100, 1000])
def test_a_follower_stays_on_a_cam_that_it_is_pressed_on(scheme, φ, steps):
    """Below the jump speed R = F + (m ω² - k) A cos(ω t + φ) > 0 throughout, though places and rates drift by O(h²)."""
    ω = 250.0
    problem = on_a_cam(scheme, ω, φ)
    h = problem.t_end / steps
    run = li.simulate(problem, "moreau-jean", dt=h, error=False)
    assert run.success
    assert not run.events
    R = 60.0 + (0.2 * ω**2 - 2000.0) * 0.005 * np.cos(ω * run.t_reaction + φ)
    # The first step takes the rate at the start to the mean ones of the motion, O(h²) away.
    np.testing.assert_allclose(run["R"][1:], R[1:], rtol=0.0, atol=0.3 * (ω * h) ** 2 * R.max())
    np.testing.assert_allclose(run["x"], run["y"], rtol=0.0, atol=0.2 * 0.005 * (ω * h) ** 2)


def test_a_follower_leaves_its_cam_once_in_a_turn():
    """Above it the force falls to zero at cos(ω t_1 + φ) = -F/((m ω² - k) A)."""
    ω, φ = 300.0, 2.0
    run = li.simulate(on_a_cam(Scheme, ω, φ), "moreau-jean", dt=6.0 * math.pi / ω / 1000, error=False)
    assert [event.kind for event in run.events] == ["open", "impact"] * 3
    t_1 = (math.pi - math.acos(60.0 / ((0.2 * ω**2 - 2000.0) * 0.005)) - φ) / ω
    for turn, event in enumerate(run.events[::2]):
        assert event.t == pytest.approx(t_1 + turn * 2.0 * math.pi / ω, abs=3.0 * run.t[1])
