"""The flow in blocks of its rates: the same motion as in windows of all of them, and no event missed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import solve_ivp
from scipy.linalg import block_diag, eigh, expm

import lcpimpact as li
from lcpimpact.hybrid import spectrum
from lcpimpact.hybrid.event_loop import follow
from lcpimpact.hybrid.flow import Flow
from lcpimpact.hybrid.motion import begin_problem
from lcpimpact.hybrid.spectrum import split_rates
from lcpimpact.hybrid.stiff_flow import StiffFlow
from lcpimpact.numerics.double_double import DoubleDouble, product, product_by_columns

FAST = np.array([-3e5, -7e3])


def stiff_flow(duration=20.0):
    """Return a flow of two fast rates, a pair, a slower pair without decay and a slow rate, mixed, and its generator."""
    rng = np.random.default_rng(3)
    blocks = [*FAST.reshape(2, 1, 1), [[-50.0, 90.0], [-90.0, -50.0]], [[0.0, 3.0], [-3.0, 0.0]], [[-0.1]]]
    Z = np.eye(7) + 0.2 * rng.standard_normal((7, 7))
    A = Z @ block_diag(*blocks) @ np.linalg.inv(Z)
    return Flow(DoubleDouble.of(A), duration), A


def rotations(*rates):
    """Return the generator of rotations that decay, by their decays and frequencies."""
    return block_diag(*([[-decay, omega], [-omega, -decay]] for decay, omega in rates))


def test_products_of_double_doubles_have_the_same_bits_column_by_column():
    rng = np.random.default_rng(0)
    A, B = rng.standard_normal((2, 2, 6, 6))
    A[1] *= 1e-17 * A[0]
    B[1] *= 1e-17 * B[0]
    A[:, 2] = A[:, :, 4] = 0.0
    assert_array_equal(product_by_columns(A, B), product(A, B))


def test_the_blocks_are_those_of_the_generator():
    flow, A = stiff_flow()
    rates = split_rates(flow.generator)
    assert np.diff(rates.bounds).tolist() == [1, 1, 2, 1, 2]
    assert_allclose(rates.decay, [*-FAST, 50.0, 0.1, 0.0], rtol=1e-9)
    back = (rates.Z @ rates.B) @ rates.L - DoubleDouble.of(A)
    assert np.abs(back.hi).max() <= 2.0**-90 * np.abs(A).max()


def test_decays_far_below_the_fastest_rate_have_all_their_digits():
    """Of two light masses on strong dashpots the slow rates are those of C x' + K x = 0; floats of A know them to 10%."""
    C, K = np.array([[1.1e6, -1e5], [-1e5, 1.01e5]]), np.array([[2.0, -1.0], [-1.0, 2.0]])
    M = np.diag([1e-6, 2e-6])
    A = block_diag(np.zeros((4, 4)), 0.0)
    A[:2, 2:4], A[2:4, :2], A[2:4, 2:4] = np.eye(2), -np.linalg.inv(M) @ K, -np.linalg.inv(M) @ C
    rates = split_rates(DoubleDouble.of(A))
    assert_allclose(rates.decay[2:], [*eigh(K, C, eigvals_only=True)[::-1], 0.0], rtol=1e-9)


@pytest.mark.parametrize("t", [0.0, 1e-6, 3e-4, 0.02, 7.0])
def test_a_stiff_flow_is_the_matrix_exponential(t):
    flow, A = stiff_flow()
    assert isinstance(flow.stiff, StiffFlow)
    X = np.arange(1.0, 8.0)
    assert_allclose(flow.move(DoubleDouble.of(X), t).hi, expm(A * t) @ X, rtol=0.0, atol=1e-9)
    assert_allclose(flow.at(X, np.array([t]))[0], flow.move(DoubleDouble.of(X), t).hi, rtol=0.0, atol=2e-14)


def test_levels_resolve_the_slow_blocks_alone():
    flow, _ = stiff_flow()
    levels = flow.stiff.levels
    assert [level.block for level in levels] == [0, 1, 2, 3]
    assert levels[0].window.δ < 1e-5
    assert levels[-1].window.δ > 0.1


def test_an_event_of_slow_blocks_has_the_digits_of_double_doubles():
    """c·X = exp(-t) - 1/2 beside a fast mode that has long decayed, at t = ln 2."""
    A = np.diag([-1e6, -1.0, 0.0])
    flow = Flow(DoubleDouble.of(A), 1.0)
    crossing = flow.first_crossing(np.ones(3), np.ones(3), np.array([[1.0, 1.0, -0.5]]), np.zeros(1, np.int64), 1.0)
    assert crossing.row == 0
    assert float(crossing.t.hi) == math.log(2.0)
    assert abs(float(crossing.t.lo) - 2.3190468138462996e-17) < 1e-28
    assert abs(crossing.state.hi[1] - 0.5) <= 1e-16


def test_fast_modes_that_beat_are_not_dropped_before_their_bound():
    """Two fast modes that cancel at first, for more windows than are tried before longer ones."""
    A = block_diag(rotations((2e3, 1e6), (2e3, 1.1e6)), [[-1.0]])
    X, row = np.array([1.0, 0.0, -1.0, 0.0, 1.0]), np.array([[1.0, 0.0, 1.0, 0.0, 1.5]])
    flow = Flow(DoubleDouble.of(A), 10.0)
    assert len(flow.stiff.levels) > 1
    t = np.linspace(0.0, 4e-5, 400_001)
    u = np.exp(-2e3 * t) * (np.cos(1e6 * t) - np.cos(1.1e6 * t)) + 1.5 * np.exp(-t)
    first = t[np.argmax(u < 0.0)]
    crossing = flow.first_crossing(X, np.abs(X), row, np.zeros(1, np.int64), 10.0)
    assert crossing.row == 0
    assert crossing.t.hi == pytest.approx(first, abs=2e-10)
    assert first > 2e-5


def test_a_dip_shorter_than_the_slow_windows_is_found():
    """A rate of 1e4 dips below zero while the slow mode stands at 0.24: z - z² with z = exp(-1e4 t)."""
    A = np.diag([-1e7, -2e4, -1e4, -1e-2])
    flow = Flow(DoubleDouble.of(A), 10.0)
    row = np.array([[0.0, 1.0, -1.0, 0.24]])
    crossing = flow.first_crossing(np.ones(4), np.ones(4), row, np.zeros(1, np.int64), 10.0)
    assert crossing.row == 0
    assert crossing.t.hi == pytest.approx(-1e-4 * math.log(0.6), rel=1e-4)


@pytest.mark.parametrize("t", [0.26, 1.0])
def test_a_body_beside_keeps_its_motion_at_an_impact(t):
    """A body on a damper, at rates of 1e5 and 20, when another one falls on the ground: its slow mode is in no row."""
    scheme = li.Scheme(
        li.Mass("x", 1.0),
        li.Load("x", 9.81),
        li.Bumper("x", "ground", gap=0.5 * 9.81 * t**2, e=0.0, name="R"),
        li.Mass("y", 1.0),
        li.KelvinVoigt("y", "ground", 2e6, 1e5),
    )
    problem = li.Problem("beside", scheme, q0={"y": 1.0}, v0={"y": 2.0}, t_end=300.0)
    run = li.simulate(problem, "exact", dt=3.0)
    assert run.certificate.holds
    assert run.certificate.velocity_scale <= 1.01 * max(9.81 * t, 2.0)  # no effect of forces in pieces as long as 16 s
    event = run.events[0]
    fast = -5e4 - math.sqrt(25e8 - 2e6)
    slow = 2e6 / fast
    y = (2.0 - fast) / (slow - fast) * math.exp(slow * t)  # the fast mode has vanished
    assert event.t == pytest.approx(t, rel=1e-15)
    for state in (event.left, event.right):
        assert state.q[1] == pytest.approx(y, rel=1e-12)
        assert state.v[1] == pytest.approx(slow * y, rel=1e-12)


def test_hops_that_are_small_beside_the_modes_end_with_an_impact_each():
    """Hops of a micrometre, and modes of decimetres that cancel in them: no gap at an impact is more than its rounding."""
    scheme = li.Scheme(
        li.Mass("x", 1.0),
        li.Load("x", li.Harmonic(5.0, 20.0)),
        li.Load("x", 10.0),
        li.Spring("x", "ground", 50.0),
        li.Bumper("x", "ground", gap=1e-6, e=1.0, name="R"),
        li.Mass("y", 0.3),
        li.KelvinVoigt("y", "ground", 1.2e5, 6e3),
    )
    motion = begin_problem(li.Problem("hops", scheme, q0={"y": 1.0}, t_end=0.5), "exact", 0.5, max_events=30)
    follow(motion, 0.5)
    assert len(motion.segments) > 30
    assert all([event.kind for event in segment.events] == ["impact"] for segment in motion.segments[1:])


def test_a_scheme_without_rows_has_nothing_to_scan(monkeypatch):
    def refuse(*_arguments, **_options):
        raise AssertionError("scanned")

    for module in ("flow", "stiff_flow"):
        monkeypatch.setattr(f"lcpimpact.hybrid.{module}.scan", refuse)
    scheme = li.Scheme(li.Mass("x", 1.0), li.KelvinVoigt("x", "ground", 4.0, 1e8))
    run = li.simulate(li.Problem("creep", scheme, q0={"x": 1.0}, t_end=1e7), "exact", dt=1e6)
    assert_allclose(run["x"], np.exp(-4e-8 * run.t), rtol=1e-12)


@pytest.mark.parametrize("c", [1e6, 1e9])
def test_a_small_mass_that_falls_on_a_strong_dashpot(c):
    """Free fall to a massless plate, then m x'' = m g - c x' - k x from x' = v: creep towards m g/k."""
    scheme = li.Scheme(
        li.Mass("x", 1e-3),
        li.Load("x", 9.81e-3),
        li.Bumper("x", "y", gap=0.05, name="R"),
        li.KelvinVoigt("y", "ground", 1e3, c),
    )
    run = li.simulate(li.Problem("creep", scheme, t_end=1.0), "exact", dt=0.01)
    t = math.sqrt(0.1 / 9.81)
    assert [event.kind for event in run.events] == ["close"]
    assert run.events[0].t == pytest.approx(t, rel=1e-15)
    assert run.certificate.holds
    slow = -1e3 / c * (1.0 + 1e-3 * 1e3 / c**2)
    y0 = 1e-3 * 9.81 * t / c  # the way in which the dashpot stops it
    expected = 9.81e-6 + (y0 - 9.81e-6) * np.exp(slow * (run.t[run.t > t + 1e-3] - t))
    assert_allclose(run["y"][run.t > t + 1e-3], expected, rtol=2e-4)


def test_a_mass_that_falls_on_a_prony_pad_against_radau():
    pad = li.GeneralizedMaxwell("y", "ground", 2e3, (1e3,) * 4, (1e-6, 1e-5, 1e-3, 1e-1))
    scheme = li.Scheme(li.Mass("x", 1.0), li.Load("x", 9.81), li.Bumper("x", "y", gap=0.1, name="R"), pad)
    run = li.simulate(li.Problem("pad", scheme, t_end=0.4), "exact", dt=0.01)
    assert [event.kind for event in run.events] == ["close", "open"]
    k, tau = np.full(4, 1e3), np.array([1e-6, 1e-5, 1e-3, 1e-1])

    def motion(_t, X):
        x, v, arms = X[0], X[1], X[2:]
        return np.concatenate([[v, 9.81 - 2e3 * x - k @ (x - arms)], (x - arms) / tau])

    def force(_t, X):
        return 2e3 * X[0] + k @ (X[0] - X[2:])

    force.terminal, force.direction = True, -1.0
    closes = math.sqrt(0.2 / 9.81)
    start = np.array([0.0, 9.81 * closes, *[0.0] * 4])
    peer = solve_ivp(motion, (closes, 0.4), start, "Radau", rtol=1e-10, atol=1e-13, events=force)
    opened = run.events[1].left
    assert run.events[1].t == pytest.approx(peer.t[-1], abs=1e-9)
    assert opened.q[0] - 0.1 == pytest.approx(peer.y[0, -1], abs=1e-9)
    assert opened.v[0] == pytest.approx(peer.y[1, -1], abs=1e-7)


def test_rates_that_do_not_decay_are_told_before_their_bases_are_computed(monkeypatch):
    """Those of an undamped bar of 100 elements took 20 s, of which nothing was kept."""
    monkeypatch.setattr(spectrum, "eig", lambda *a, **k: pytest.fail("bases of rates were computed"))
    K = 2.0 * np.eye(40) - np.eye(40, k=1) - np.eye(40, k=-1)
    generator = np.block([[np.zeros((40, 40)), np.eye(40)], [-1e6 * K, np.zeros((40, 40))]])
    assert spectrum.split_rates(DoubleDouble.of(generator)) is None
