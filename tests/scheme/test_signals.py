"""Signals as loads and motions: closed forms, DOP853 started anew at each breakpoint, superposition, and refusals."""

from __future__ import annotations

import itertools
import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

import lcpimpact as li
from lcpimpact import (
    Bumper,
    Harmonic,
    Jenkins,
    KelvinVoigt,
    Load,
    Mass,
    Polynomial,
    PrescribedMotion,
    Problem,
    Ramp,
    Scheme,
    Slider,
    Spring,
    Square,
    Table,
    simulate,
)
from lcpimpact.problems.penalty import penalized
from lcpimpact.scheme.first_order import first_order_form
from lcpimpact.scheme.waves import MAX_ANGLE, cosine, sine

SIGNALS = [
    Polynomial([1.0, -2.0, 3.0, 0.5]),
    Ramp(start=-1.0, end=2.0, t_start=0.305, t_end=1.112),
    Table([0.2, 0.5, 0.9, 1.7], [1.0, -2.0, 0.5, 3.0]),
    Square(amplitude=2.0, omega=5.0, phase=0.4),
    Table([0.5, 1.0, 1.0, 2.0], [1.0, 2.0, -1.0, 4.0]),
]
LOCATED = ("exact", "event-driven", "radau-fesd")


def oscillator(signal, m=2.0, k=50.0, *more):
    return Problem("driven", Scheme(Mass("x", m), Spring("x", "ground", k), Load("x", signal), *more))


def driven_base(motion):
    return Problem("base", Scheme(PrescribedMotion("b", motion), Mass("x", 2.0), Spring("x", "b", 50.0)))


# ---- the signals themselves ------------------------------------------------------------------------------------------


@given(st.floats(-MAX_ANGLE, MAX_ANGLE, exclude_min=True, exclude_max=True) | st.floats(-50.0, 50.0))
def test_sine_and_cosine_are_those_of_the_c_library_to_rounding(x):
    rounding = 4e-16 + (1e-15 * abs(x) if abs(x) > 2e6 else 0.0)
    assert abs(sine(x) - math.sin(x)) <= min(rounding, 4e-16 * abs(x) + rounding * (abs(x) > 1.0))
    assert abs(cosine(x) - math.cos(x)) <= rounding
    at_once = np.array([x, 0.0])
    assert (sine(at_once)[0], cosine(at_once)[0]) == (sine(x), cosine(x))


@pytest.mark.parametrize("x", [MAX_ANGLE, -MAX_ANGLE, 1e16, -1e19, 1e50, 1e308])
def test_angles_without_digits_have_no_sine(x):
    with np.errstate(over="ignore", invalid="ignore"):
        assert math.isnan(sine(x))
        assert math.isnan(cosine(x))
        assert np.isnan(cosine(np.array([x]))).all()


@pytest.mark.parametrize("signal", [*SIGNALS, Harmonic(1.0, 2.0)], ids=repr)
def test_a_signal_is_hashable_and_survives_a_pickle(signal):
    again = pickle.loads(pickle.dumps(signal))
    assert again == signal
    assert hash(again) == hash(signal)


@pytest.mark.parametrize("signal", SIGNALS, ids=repr)
def test_between_breakpoints_a_signal_is_the_taylor_polynomial_of_its_right_limits(signal):
    edges = [0.0, *signal.breakpoints(0.0, 3.0), 3.0]
    for a, b in itertools.pairwise(edges):
        t = np.linspace(a, b, 7)[:-1]
        taylor = sum(d * (t - a) ** k / math.factorial(k) for k, d in enumerate(signal.derivatives(a)))
        assert_allclose([signal(each) for each in t], taylor, rtol=0, atol=1e-13 * (1.0 + np.abs(taylor).max()))
        slope = (signal(t[3]) - signal(t[2])) / (t[3] - t[2])
        if signal.degree < 2:
            assert signal.rate(t[2]) == pytest.approx(slope, abs=1e-12 * (1.0 + abs(slope)))


def test_values_by_hand():
    p, r, t, s, j = SIGNALS
    assert p(2.0) == 1.0 - 4.0 + 12.0 + 4.0
    assert p.rate(2.0) == -2.0 + 12.0 + 6.0
    assert (r(0.0), r(0.305), r(1.112), r(9.0), r.rate(1.112)) == (-1.0, -1.0, 2.0, 2.0, 0.0)
    assert (t(-1.0), t(0.2), t.rate(0.2), t(2.0), t.rate(1.7)) == (1.0, 1.0, pytest.approx(-10.0), 3.0, 0.0)
    assert (s(0.0), s(0.3), j(0.99999), j(1.0)) == (2.0, -2.0, pytest.approx(2.0, abs=1e-4), -1.0)
    assert Ramp(1.0, 4.0, 2.0, 2.0)(2.0) == 4.0


@given(ω=st.floats(1e-3, 1e6), φ=st.floats(-100.0, 100.0), start=st.floats(0.0, 1e4), count=st.integers(1, 50))
def test_a_square_wave_jumps_at_its_breakpoints_and_nowhere_else(ω, φ, start, count):
    signal = Square(1.0, ω, φ)
    instants = signal.breakpoints(start, start + count * math.pi / ω)
    assert count - 1 <= len(instants) <= count + 1
    assert signal.derivatives(instants)[:, 0].tolist() == [
        -each for each in signal.derivatives(np.nextafter(instants, -np.inf))[:, 0]
    ]
    middle = 0.5 * (instants[1:] + instants[:-1])
    assert_allclose(signal.derivatives(middle)[:, 0], np.sign(np.cos(ω * middle + φ)), rtol=0)


def test_loads_and_motions_of_many_instants_are_those_of_each():
    signal = SIGNALS[2]
    scheme = Scheme(PrescribedMotion("b", signal), Mass("x", 1.0), Spring("x", "b", 1.0), Load("x", SIGNALS[3]))
    d, t = scheme.assemble(), np.linspace(0.0, 3.0, 12).reshape(3, 4)
    y, rate = d.motion(t)
    assert y.shape == rate.shape == (3, 4, 1)
    assert y[1, 2, 0] == signal(t[1, 2])
    assert rate[1, 2, 0] == signal.rate(t[1, 2])
    assert d.force(t)[2, 1].tolist() == [0.0, SIGNALS[3](t[2, 1])]


def test_equal_signals_share_their_states_and_their_part_of_a_is_nilpotent():
    signal = SIGNALS[0]
    nodes = [each for n in "ab" for each in (Mass(n, 1.0), Load(n, signal), Load(n, Square(1.0, 2.0)))]
    form = first_order_form(Scheme(*nodes).assemble())
    assert len(form.signals) == 1 + 4 + 1
    part = form.A[form.constant :, form.constant :]
    assert not np.linalg.matrix_power(part, 4).any()
    assert_allclose(form.signals_at(np.array(0.5))[1:5], signal.derivatives(0.5), rtol=1e-15)


# ---- exact against closed forms --------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", LOCATED)
def test_a_mass_under_a_polynomial_load_moves_by_its_double_integral(method):
    c, m = (1.0, -2.0, 3.0, 0.5), 2.0
    problem = Problem("pushed", Scheme(Mass("x", m), Load("x", Polynomial(c))), v0={"x": 0.3})
    run = simulate(problem, method, dt=1e-2, t_end=3.0)
    x = 0.3 * run.t + sum(a * run.t ** (k + 2) / ((k + 1) * (k + 2)) for k, a in enumerate(c)) / m
    assert_allclose(run["x"], x, rtol=0, atol=1e-12)


def ramped(t, F, t_0, t_1, k, ω):
    """k x'' / ω² + k x = F (t - t_0)/(t_1 - t_0) from t_0 to t_1 and F after, from rest."""

    def one(s):
        return np.where(s > 0.0, s - np.sin(ω * s) / ω, 0.0)

    return F / k / (t_1 - t_0) * (one(t - t_0) - one(t - t_1))


@pytest.mark.parametrize(("method", "atol"), [("exact", 1e-14), ("event-driven", 1e-8), ("radau-fesd", 1e-9)])
def test_an_oscillator_under_a_ramp(method, atol):
    run = simulate(oscillator(Ramp(0.0, 10.0, 0.305, 1.112)), method, dt=1e-2, t_end=5.0)
    assert_allclose(run["x"], ramped(run.t, 10.0, 0.305, 1.112, 50.0, 5.0), rtol=0, atol=atol)
    assert run.certificate.energy_balance < 100.0 * atol


def test_a_load_that_steps_up_doubles_the_static_deflection():
    run = simulate(oscillator(Ramp(0.0, 10.0, 0.3, 0.3)), "exact", dt=1e-2, t_end=3.0)
    x = np.where(run.t > 0.3, 0.2 * (1.0 - np.cos(5.0 * (run.t - 0.3))), 0.0)
    assert_allclose(run["x"], x, rtol=0, atol=1e-14)


def rung(t, a, ω, k):
    """An oscillator at rest under a sign cos ω t at its own frequency: it turns about a/k and -a/k by turns."""
    z, last, sign = 0.0 + 0.0j, 0.0, 1.0
    jumps = (np.arange(int(t[-1] * ω / math.pi + 0.5)) + 0.5) * math.pi / ω
    found = np.zeros_like(t)
    for jump in [*jumps, np.inf]:
        here = (t >= last) & (t < jump)
        centre = sign * a / k
        found[here] = (centre + (z - centre) * np.exp(-1j * ω * (t[here] - last))).real
        if jump < np.inf:
            z = centre + (z - centre) * np.exp(-1j * ω * (jump - last))
        last, sign = jump, -sign
    return found


def test_a_square_wave_at_resonance_adds_its_share_in_each_half_period():
    a, k, ω = 2.0, 25.0, 5.0
    run = simulate(oscillator(Square(a, ω), 1.0, k), "exact", dt=1e-2, t_end=60.0)
    assert_allclose(run["x"], rung(run.t, a, ω, k), rtol=0, atol=1e-12 * np.abs(run["x"]).max())
    # Each half period adds 2 a/k to the amplitude.
    peaks = np.abs(run["x"][-130:]).max()
    assert peaks == pytest.approx(2.0 * a / k * 60.0 * ω / math.pi, rel=2e-2)
    assert run.certificate.energy_balance < 1e-11 * run.certificate.energy_scale
    assert run.events == ()


def test_breakpoints_are_no_events_and_do_not_count_as_such():
    run = simulate(oscillator(Square(1.0, 200.0)), "exact", dt=1e-2, t_end=10.0, max_events=5)
    assert run.success
    assert run.events == ()


@pytest.mark.parametrize("method", ["exact", "radau-fesd"])
@pytest.mark.parametrize("signal", [SIGNALS[2], SIGNALS[4], Square(3.0, 7.0, 0.2)], ids=repr)
def test_against_dop853_started_anew_at_each_breakpoint(method, signal):
    m, k, c = 2.0, 50.0, 1.3
    problem = Problem(
        "driven", Scheme(Mass("x", m), KelvinVoigt("x", "ground", k, c), Load("x", signal)), v0={"x": 1.0}
    )
    run = simulate(problem, method, dt=1e-2, t_end=3.0)
    X, found = np.array([0.0, 1.0]), []
    edges = [0.0, *signal.breakpoints(0.0, 3.0), 3.0]
    for a, b in itertools.pairwise(edges):
        f = signal.derivatives(a)

        def rate(t, X, a=a, f=f):
            load = sum(each * (t - a) ** j for j, each in enumerate(f))
            return [X[1], (load - k * X[0] - c * X[1]) / m]

        here = run.t[(run.t >= a) & (run.t < b)] if b < 3.0 else run.t[run.t >= a]
        solved = solve_ivp(rate, (a, b), X, "DOP853", here, rtol=1e-13, atol=1e-15, dense_output=True)
        found.append(solved.sol(here)[0])
        X = solved.sol(b)
    assert_allclose(run["x"], np.concatenate(found), rtol=0, atol=1e-11 if method == "exact" else 1e-9)


TABLES = st.lists(st.tuples(st.floats(1e-3, 1.0), st.floats(-10.0, 10.0)), min_size=2, max_size=6)


@given(points=TABLES)
def test_a_table_is_the_sum_of_its_ramps(points):
    times = np.cumsum([step for step, _ in points])
    values = [value for _, value in points]
    pieces = zip(times[:-1], times[1:], values[:-1], values[1:], strict=True)
    ramps = [Load("x", Ramp(0.0, b - a, s, t)) for s, t, a, b in pieces]
    whole = simulate(oscillator(Table(times, values)), "exact", dt=0.05, t_end=3.0)
    parts = simulate(oscillator(values[0], 2.0, 50.0, *ramps), "exact", dt=0.05, t_end=3.0)
    assert_allclose(whole["x"], parts["x"], rtol=0, atol=1e-12)
    assert_allclose(whole["v_x"], parts["v_x"], rtol=0, atol=1e-11)


@given(points=TABLES)
def test_a_spring_pulled_by_a_table_is_pushed_by_k_times_it(points):
    times, values = np.cumsum([step for step, _ in points]), np.array([value for _, value in points])
    start = {"q0": {"x": values[0]}}
    pulled = Scheme(PrescribedMotion("b", Table(times, values)), Mass("x", 2.0), Spring("x", "b", 50.0))
    pushed = Scheme(Load("x", Table(times, 50.0 * values)), Mass("x", 2.0), Spring("x", "ground", 50.0))
    a, b = (simulate(Problem("p", each, **start), "exact", dt=0.05, t_end=3.0) for each in (pulled, pushed))
    assert_allclose(a["x"], b["x"], rtol=0, atol=1e-12)
    assert_allclose(a["b"], Table(times, values).derivatives(a.t)[:, 0], rtol=0, atol=1e-13)
    assert a.certificate.energy_balance < 1e-11 * (1.0 + a.certificate.energy_scale)


def test_a_steep_piece_that_is_over_blurs_nothing():
    """A pulse of 1e-9 s, whose slope is 1e15 N/s, and after it a ball that touches down as without it."""
    pulse = Table([0.1, 0.1 + 1e-9, 0.1 + 2e-9], [0.0, 1e6, 0.0])
    ball = [Mass("x", 1.0), Load("x", 9.81), Bumper("x", "ground", gap=1.0, e=0.5)]
    run = simulate(Problem("pulse", Scheme(*ball, Load("x", pulse))), "exact", dt=1e-2, t_end=0.6)
    # The impulse 1e-3 N s about t = 0.1 s + 1e-9 s.
    v = 1e-3
    t = (-v + math.sqrt(v**2 + 2.0 * 9.81 * (1.0 + v * (0.1 + 1e-9)))) / 9.81
    assert run.events[0].t == pytest.approx(t, abs=1e-12)
    assert len(run.events) == 1


# ---- impacts and friction --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", LOCATED)
def test_stick_and_slip_on_a_belt_of_constant_speed(method):
    m, k, F, v = 1.0, 100.0, 5.0, 0.3
    belt = PrescribedMotion("b", Polynomial([0.0, v]))
    scheme = Scheme(belt, Mass("x", m), Spring("x", "ground", k), Slider("x", "b", F))
    run = simulate(Problem("belt", scheme), method, dt=1e-3, t_end=3.0)
    ω = math.sqrt(k / m)
    t_1 = math.asin(v / (ω * F / k)) / ω
    x_1 = F / k * (1.0 - math.cos(ω * t_1))
    t_2 = t_1 + (F / k - x_1) / v
    tight = method != "event-driven"
    events = run.events
    if not tight:
        # In each period the body comes up to the speed of the belt and no further: within its tolerance it sticks there.
        since = [b.t - a.t for a, b in zip(events[2::2], events[3::2], strict=True)]
        assert max(since, default=0.0) < 1e-5
        events = events[:2]
    assert [event.kind for event in events] == ["stick", "slip"]
    assert_allclose([event.t for event in events], [t_1, t_2], rtol=0, atol=1e-12 if tight else 1e-8)
    t = run.t
    slides, sticks = F / k * (1.0 - np.cos(ω * t)), x_1 + v * (t - t_1)
    x = np.where(t < t_1, slides, np.where(t < t_2, sticks, F / k + v / ω * np.sin(ω * (t - t_2))))
    assert_allclose(run["x"], x, rtol=0, atol=1e-11 if tight else 1e-8)
    assert run.certificate.energy_balance < (1e-11 if tight else 1e-7)


@pytest.mark.parametrize("method", [*LOCATED, "moreau-jean"])
def test_a_body_struck_by_a_wall_that_moves_as_a_ramp(method):
    """u = 0.7 - t, so U⁻ = -1 m/s at t = 0.7 s, and U⁺ = e."""
    e, m = 0.7, 2.0
    scheme = Scheme(PrescribedMotion("w", Ramp(0.5, -0.5, 0.2, 1.2)), Mass("x", m), Bumper("x", "w", e=e))
    run = simulate(Problem("wall", scheme), method, dt=1e-3, t_end=1.5)
    (impact,) = [event for event in run.events if event.kind == "impact"]
    tight = method != "moreau-jean"
    assert impact.t == pytest.approx(0.7, abs=1e-13 if tight else 2e-3)
    assert impact.impulse == pytest.approx(m * (1.0 + e), rel=1e-12)
    assert run["v_x"][-1] == pytest.approx(-(1.0 + e), rel=1e-12)
    assert run["x"][-1] == pytest.approx(-(1.0 + e) * 0.8, abs=1e-12 if tight else 2e-3)


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("method", LOCATED)
def test_a_body_at_rest_on_a_table_whose_velocity_jumps_goes_with_it(method, e):
    """U⁻ is the left limit, zero, so U⁺ = 0 whatever e: the limit of tables that start to move ever more steeply."""
    g, m, w = 9.81, 2.0, 0.5
    table = PrescribedMotion("y", Table([0.5, 1.0], [0.0, -0.5 * w]))
    scheme = Scheme(table, Mass("x", m), Load("x", m * g), Bumper("x", "y", e=e))
    run = simulate(Problem("kicked", scheme), method, dt=1e-2, t_end=1.05)
    assert [(event.kind, event.t) for event in run.events] == [("impact", 0.5), ("open", 1.0)]
    assert run.events[0].impulse == pytest.approx(m * w, rel=1e-12)
    s = run.t - 1.0
    x = np.where(s < 0.0, -w * np.maximum(run.t - 0.5, 0.0), -0.5 * w - w * s + 0.5 * g * s**2)
    assert_allclose(run["x"], x, rtol=0, atol=1e-12)
    assert run.certificate.energy_balance < 1e-12


def test_a_table_that_starts_ever_more_steeply_carries_the_body_as_one_whose_velocity_jumps():
    def last(δ):
        curve = np.linspace(0.0, 1.0, 41)
        table = Table(np.append(0.5 + δ * curve, 1.0), -0.5 * np.append(0.5 * δ * curve**2, 0.5 - 0.5 * δ))
        scheme = Scheme(PrescribedMotion("y", table), Mass("x", 1.0), Load("x", 9.81), Bumper("x", "y", e=0.0))
        return simulate(Problem("smooth", scheme), "exact", dt=1e-2, t_end=1.0)["x"][-1]

    jump = -0.25
    assert [abs(last(δ) - jump) for δ in (1e-2, 1e-4)] == pytest.approx([0.25e-2, 0.25e-4], rel=1e-6)


@pytest.mark.parametrize("t_1", [0.5, 0.50043])
@pytest.mark.parametrize("θ", [0.5, 1.0])
def test_moreau_jean_tends_to_it_wherever_the_velocity_jumps_in_a_step(t_1, θ):
    table = PrescribedMotion("y", Table([t_1, t_1 + 0.3], [0.0, -0.3]))
    scheme = Scheme(table, Mass("x", 1.0), Load("x", 9.81), Bumper("x", "y", e=0.5))
    problem = Problem("kicked", scheme)
    truth = simulate(problem, "exact", dt=1e-2, t_end=0.9)
    counts, errors = [97, 211, 401, 811, 1601, 3203], []
    for n in counts:
        run = simulate(problem, dt=0.9 / n, t_end=0.9, theta=θ)
        errors.append(np.abs(run["x"] - truth.sample(np.minimum(run.t, 0.9)).q[:, 1]).max())
    assert -np.polyfit(np.log(counts), np.log(errors), 1)[0] > 0.7
    assert errors[-1] < 1e-3


def test_a_wall_that_arrives_at_its_own_breakpoint_meets_the_body_once():
    for e in (0.0, 0.4):
        wall = Ramp(0.5, 0.0, 0.0, 1.0)
        scheme = Scheme(PrescribedMotion("w", wall), Mass("x", 1.0), Bumper("x", "w", e=e))
        run = simulate(Problem("arrives", scheme, v0={"x": -0.0}), "exact", dt=1e-2, t_end=2.0)
        hits = [event for event in run.events if event.kind == "impact"]
        # U⁻ = -0.5 m/s, and the wall has stopped: U⁺ = e/2.
        assert [event.t for event in hits] == ([1.0] if e else [])
        assert run["v_x"][-1] == pytest.approx(-0.5 * e, abs=1e-13)


def test_the_load_on_a_closed_contact_may_pull_it_open_by_a_jump():
    load = Table([0.5, 0.5], [10.0, -10.0])
    scheme = Scheme(Mass("x", 2.0), Load("x", load), Bumper("x", "ground", e=0.0))
    for method in LOCATED:
        run = simulate(Problem("let go", scheme), method, dt=1e-2, t_end=1.0)
        assert [(event.kind, event.t) for event in run.events] == [("open", 0.5)]
        assert_allclose(run["x"], -2.5 * np.maximum(run.t - 0.5, 0.0) ** 2, rtol=0, atol=1e-13)
        assert run.sample(0.5, side="left").reaction[0, 0] == pytest.approx(10.0)
        assert run.sample(0.5).reaction[0, 0] == 0.0


def test_event_driven_does_not_step_over_a_short_pulse():
    pulse = Table([0.7, 0.7 + 1e-5, 0.7 + 1e-5, 0.7 + 2e-5], [0.0, 1e5, 0.0, 0.0])
    problem = Problem("pulse", Scheme(Mass("x", 1.0), Load("x", pulse)))
    run = simulate(problem, "event-driven", dt=0.5, t_end=2.0)
    assert run["v_x"][-1] == pytest.approx(0.5, rel=1e-10)
    assert run["x"][-1] == pytest.approx(0.5 * (1.3 - 2e-5 / 3.0), rel=1e-9)


@pytest.mark.parametrize("method", LOCATED)
def test_a_breakpoint_at_the_last_instant_has_its_right_limit(method):
    problem = Problem(
        "p", Scheme(Mass("x", 1.0), Load("x", Table([1.0, 1.0], [3.0, 7.0])), Bumper("x", "ground", e=0.0))
    )
    run = simulate(problem, method, dt=0.1, t_end=1.0)
    assert_allclose(run["R"], [3.0] * 10 + [7.0], rtol=1e-14)


def test_a_slider_behind_a_spring_follows_a_table_as_its_yield_curve():
    """An elastic-plastic element, k = 100 and f_y = 5, pulled to 0.2 and back to 0.05."""
    pull = Table([0.0, 1.0, 2.0], [0.0, 0.2, 0.05])
    scheme = Scheme(PrescribedMotion("x", pull), Jenkins("x", "ground", 100.0, 5.0))
    for method in LOCATED:
        run = simulate(Problem("pulled", scheme), method, dt=1e-2, t_end=2.5)
        kinds = [(event.kind, event.t) for event in run.events]
        assert [kind for kind, _ in kinds] == ["slip", "stick", "slip"]
        # It yields at 0.05, sticks at the turn, and yields back after 2 f_y/k.
        assert_allclose([t for _, t in kinds], [0.25, 1.0, 1.0 + 0.1 / 0.15], rtol=0, atol=1e-8)
        assert run["F.1"][-1] == pytest.approx(0.1, abs=1e-9)


# ---- beside the runs -------------------------------------------------------------------------------------------------


def test_penalised_contacts_take_every_signal():
    scheme = Scheme(PrescribedMotion("w", Ramp(0.5, -0.5, 0.2, 1.2)), Mass("x", 2.0), Bumper("x", "w", e=0.7))
    rigid = Problem("wall", scheme, t_end=1.5)
    soft = penalized(rigid, "kelvin-voigt", k=1e7)
    run = simulate(soft, "event-driven", dt=1e-2, t_end=1.5)
    assert run["v_x"][-1] == pytest.approx(-1.7, rel=1e-2)


def test_the_ledger_closes_over_breakpoints():
    scheme = Scheme(
        Mass("x", 2.0), KelvinVoigt("x", "ground", 50.0, 1.0), Load("x", SIGNALS[4]), Load("x", Square(3.0, 7.0))
    )
    run = simulate(Problem("driven", scheme), "exact", dt=1e-2, t_end=3.0)
    assert li.energy_ledger(run).balance < 1e-12 * run.certificate.energy_scale
    assert run.certificate.energy_balance < 1e-12 * run.certificate.energy_scale


def test_an_orbit_under_a_square_wave_has_its_period_and_decays_as_the_oscillator():
    m, k, c, ω = 1.0, 20.0, 0.5, 3.0
    problem = Problem("driven", Scheme(Mass("x", m), KelvinVoigt("x", "ground", k, c), Load("x", Square(8.0, ω))))
    orbit = li.periodic_orbit(problem)
    T = 2.0 * math.pi / ω
    assert pytest.approx(T, rel=1e-14) == orbit.T
    assert_allclose(np.abs(orbit.floquet), math.exp(-0.5 * c / m * T), rtol=1e-10)
    # Its Fourier series: 8 · 4/π Σ (-1)^j cos((2j+1) ω t)/(2j+1) through the transfer function.
    n = 2 * np.arange(4000) + 1
    terms = 32.0 / math.pi * (-1.0) ** np.arange(4000) / n / (k - m * (n * ω) ** 2 + 1j * c * n * ω)
    assert orbit.sample(0.0).q[0, 0] == pytest.approx(terms.real.sum(), abs=1e-9)


def test_an_orbit_under_a_ramp_has_no_period():
    with pytest.raises(li.UnsupportedError, match=r"period is unknown.*Square"):
        li.periodic_orbit(oscillator(Ramp(0.0, 1.0, 0.0, 1.0)))


def test_a_linear_system_takes_signals_as_its_inputs():
    """x' = -x + a(t) with a step at 1: x = 1 - exp(-(t - 1))."""
    system = li.LinearComplementaritySystem([[-1.0]], [[1.0]], [[1.0]], a=[Ramp(0.0, 1.0, 1.0, 1.0)])
    run = simulate(Problem("low pass", system), "exact", dt=1e-2, t_end=3.0)
    assert_allclose(run["x1"], 1.0 - np.exp(-np.maximum(run.t - 1.0, 0.0)), rtol=0, atol=1e-14)


@pytest.mark.parametrize("method", ["rk4", "radau", "moreau-jean"])
def test_a_jump_inside_a_step_leaves_order_two_to_methods_that_take_its_mean(method):
    problem, counts = oscillator(Table([1 / 3, 1 / 3], [0.0, 10.0])), [97, 211, 400, 811, 1600, 3202]
    errors = []
    for n in counts:
        run = simulate(problem, method, dt=1.0 / n, t_end=1.0)
        x = np.where(run.t > 1 / 3, 0.2 * (1.0 - np.cos(5.0 * (run.t - 1 / 3))), 0.0)
        errors.append(np.abs(run["x"] - x).max())
    assert -np.polyfit(np.log(counts), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.1)


# ---- refusals --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Polynomial([]), r"Polynomial: it has 0 coefficients"),
        (lambda: Polynomial([1.0] * 22), r"22 coefficients, and 1 to 21"),
        (lambda: Polynomial(3.0), r"Polynomial: coefficients = 3.0 must be a sequence"),
        (lambda: Polynomial("12"), r"must be a sequence"),
        (lambda: Polynomial([0.0, math.nan]), r"coefficients\[1\] = nan must be a finite number"),
        (lambda: Polynomial([0.0] * 20 + [1e300]), r"a derivative is larger than any number"),
        (lambda: Ramp(0.0, 1.0, 2.0, 1.0), r"ends at 1 s, before it starts"),
        (lambda: Ramp(0.0, True, 0.0, 1.0), r"must be finite numbers"),
        (lambda: Ramp(-1e308, 1e308, 0.0, 1.0), r"slope is larger than any number"),
        (lambda: Table([0.0, 1.0], [0.0]), r"2 times and 1 values"),
        (lambda: Table([], []), r"0 times and 0 values"),
        (lambda: Table([0.0, 2.0, 1.0], [0.0, 1.0, 2.0]), r"the time 1 s follows 2 s"),
        (lambda: Table([0.0, 1.0, 1.0, 1.0], [0.0, 1.0, 2.0, 3.0]), r"1 s is listed more than twice"),
        (lambda: Table([0.0, 1e-300], [0.0, 1e300]), r"slope is larger than any number"),
        (lambda: Square(1.0, 0.0), r"omega above zero"),
        (lambda: Square(1.0, 2.0, "a"), r"must be finite numbers"),
        (lambda: PrescribedMotion("b", Square(1.0, 2.0)), r"y is a Square that jumps"),
        (lambda: PrescribedMotion("b", Ramp(0.0, 1.0, 2.0, 2.0)), r"y is a Ramp that jumps"),
        (lambda: PrescribedMotion("b", SIGNALS[4]), r"y is a Table that jumps"),
        (
            lambda: Scheme(Spring("x", "ground", 1.0), Load("x", Square(1.0, 2.0))).assemble(),
            r"the load on 'x' jumps, and so would that node",
        ),
        (lambda: simulate(oscillator(Square(1.0, 1e12)), "exact", dt=0.1, t_end=1.0), r"jumps 3.2e\+11 times until 1 s"),
        (lambda: simulate(oscillator(Square(1.0, 3.0, 1e30)), "exact", dt=0.1, t_end=1.0), "a phase of more than 1.1e"),
        (lambda: simulate(oscillator(Harmonic(1.0, 1e18)), dt=0.1, t_end=1.0), r"turns by 1.0e\+18 rad until 1 s"),
        (lambda: simulate(oscillator(Harmonic(1.0, 1e8, -1e9)), dt=0.1, t_end=1.0), r"turns by 1.1e\+09 rad"),
        (lambda: simulate(driven_base(Harmonic(1.0, 1e10)), "exact", dt=0.1, t_end=1.0), r"turns by 1.0e\+10 rad"),
    ],
)  # fmt: skip
def test_what_is_no_signal_is_refused_in_one_sentence(make, says):
    with pytest.raises(li.InputError, match=says) as error:
        make()
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("method", ["rk4", "dopri5", "radau"])
def test_restitution_on_a_node_whose_velocity_jumps_needs_its_left_limit(method):
    scheme = Scheme(PrescribedMotion("w", Ramp(0.5, -0.5, 0.2, 1.2)), Mass("x", 2.0), Bumper("x", "w", e=0.7))
    with pytest.raises(li.UnsupportedError, match=r"velocity of the node 'w' jumps, and the contact 'R'.*exact"):
        simulate(Problem("wall", scheme), method, dt=1e-2, t_end=1.0)
    plastic = replace(scheme.elements[2], e=0.0)
    run = simulate(Problem("wall", Scheme(*scheme.elements[:2], plastic)), method, dt=1e-3, t_end=1.0)
    assert run["v_x"][-1] == pytest.approx(-1.0, rel=1e-12)


@pytest.mark.parametrize("method", LOCATED)
def test_energy_is_balanced_over_impacts_at_breakpoints(method):
    """A body on a rope from a hook that is drawn up, held, and let down."""
    hook = PrescribedMotion("w", Table([0.5, 1.0, 1.3, 2.0], [0.0, -0.2, -0.2, 0.3]))
    scheme = Scheme(hook, Mass("x", 1.0), Load("x", 9.81), li.Rope("w", "x", slack=0.0, e=0.3))
    run = simulate(Problem("hook", scheme), method, dt=1e-3, t_end=2.0)
    assert (run.events[0].kind, run.events[0].t) == ("impact", 0.5)
    assert run.events[0].impulse == pytest.approx(0.4, rel=1e-12)
    assert run.certificate.energy_balance < 1e-9


def test_the_derivative_of_an_orbit_counts_the_breakpoints():
    """Floquet multipliers against difference quotients of the period map of the orbit."""
    loads = Load("x", Square(8.0, 3.0, 0.3))
    scheme = Scheme(Mass("x", 1.0), KelvinVoigt("x", "ground", 20.0, 0.8), loads, Bumper("x", "ground", gap=0.3, e=0.6))
    problem = Problem("struck", scheme)
    orbit = li.periodic_orbit(problem, transient=40)
    assert len(orbit.impacts) == 2
    state, δ = orbit.sample(0.0), 1e-6

    def after(q, v):
        run = simulate(replace(problem, q0={"x": q}, v0={"x": v}), "exact", dt=orbit.T, t_end=orbit.T)
        return np.array([run["x"][-1], run["v_x"][-1]])

    q, v = float(state.q[0, 0]), float(state.v[0, 0])
    J = np.column_stack([after(q + δ, v) - after(q - δ, v), after(q, v + δ) - after(q, v - δ)]) / (2.0 * δ)
    assert_allclose(np.sort(np.linalg.eigvals(J).real), np.sort(orbit.floquet.real), rtol=0, atol=1e-6)
