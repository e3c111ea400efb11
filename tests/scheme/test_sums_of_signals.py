"""Sums of signals and periodic tables: superposition, closed forms, DOP853 and numpy.interp, files, and refusals."""

from __future__ import annotations

import itertools
import math
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

import lcpimpact as li
from lcpimpact import (
    Harmonic,
    Load,
    Mass,
    Polynomial,
    PrescribedMotion,
    Problem,
    Ramp,
    Scheme,
    SignalSum,
    Square,
    Table,
)
from lcpimpact.scheme.system import LinearComplementaritySystem
from lcpimpact.schemefile import read_scheme_file, write_scheme_file
from lcpimpact.study.dynamics.shooting import force_period

TERMS = (
    Harmonic(3.0, 7.0, 0.4),
    Ramp(0.0, 5.0, 0.5, 1.3),
    Table([0.0, 0.3, 0.7], [0.0, 4.0, -2.0], period=0.7),
    Square(2.0, 9.0),
    Polynomial([1.0, -0.5, 0.25]),
)
LOCATED = [("exact", 1e-13), ("event-driven", 3e-9), ("radau-fesd", 3e-9)]
SAWTOOTH = [("exact", 0.03, 1e-13), ("event-driven", 0.03, 1e-9), ("moreau-jean", 1e-3, 1e-5)]
SMOOTH = Harmonic(0.03, 7.0, 0.4) + Ramp(0.0, 0.05, 0.5, 1.3) + Table([0.0, 0.3, 0.7], [0.0, 0.04, 0.0], period=0.7)


def oscillator(*forces, end=3.0):
    loads = (Load("x", each) for each in forces)
    scheme = Scheme(Mass("x", 2.0), li.Spring("x", "ground", 50.0), li.Dashpot("x", "ground", 1.0), *loads)
    return Problem("driven", scheme, t_end=end, q0={"x": 0.1})


def by_dop853(rate, cuts, state):
    """The state at the last of the cuts, of a field that is smooth between them and continuous from the right there."""
    for a, b in itertools.pairwise(cuts):
        state = solve_ivp(
            lambda t, y, b=b: rate(min(t, np.nextafter(b, 0.0)), y), (a, b), state, method="DOP853", rtol=1e-13, atol=1e-15
        ).y[:, -1]  # fmt: skip
    return state


# ---- sums --------------------------------------------------------------------------------------------------------------


def test_arithmetic_is_that_of_the_values():
    a, b = TERMS[2], TERMS[0]
    made = np.float64(0.5) * (1.5 - (2.0 * a - b)) + sum([a, -b, b])
    for t in (0.0, 0.31, 0.7, 5.3):
        assert made(t) == pytest.approx(0.5 * (1.5 - 2.0 * a(t) + b(t)) + a(t), abs=1e-14)
        assert made.rate(t) == pytest.approx(0.5 * (b.rate(t) - 2.0 * a.rate(t)) + a.rate(t), abs=1e-12)
    assert pickle.loads(pickle.dumps(made)) == made
    assert eval(repr(made)) == made
    assert hash(a + b) == hash(SignalSum((a, b)))


@pytest.mark.parametrize(("method", "atol"), LOCATED)
def test_a_load_that_is_a_sum_against_dop853_started_anew_at_each_breakpoint(method, atol):
    f = sum(TERMS) + 1.5
    cuts = np.concatenate([[0.0], f.breakpoints(0.0, 2.999), [3.0]])
    expected = by_dop853(lambda t, y: [y[1], (f(t) - 50.0 * y[0] - y[1]) / 2.0], cuts, [0.1, 0.0])
    run = li.simulate(oscillator(f), method, dt=1e-2)
    assert_allclose([run.q[-1, 0], run.v[-1, 0]], expected, rtol=0.0, atol=atol)


@pytest.mark.parametrize("method", ["moreau-jean", "generalized-alpha", "rk4", "radau", "exact"])
def test_a_sum_acts_as_its_terms_one_by_one(method):
    one = li.simulate(oscillator(sum(TERMS) + 1.5), method, dt=1e-2)
    apart = li.simulate(oscillator(*TERMS, 1.5), method, dt=1e-2)
    assert one.certificate.holds
    assert_allclose(one.q, apart.q, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize(("method", "atol"), [*LOCATED, ("moreau-jean", 1e-5)])
def test_a_motion_that_is_a_sum_against_dop853(method, atol):
    base = Problem("base", Scheme(PrescribedMotion("b", SMOOTH), Mass("x", 2.0), li.Spring("x", "b", 50.0)), t_end=3.0)
    start = SMOOTH(0.0)
    cuts = np.concatenate([[0.0], SMOOTH.breakpoints(0.0, 2.999), [3.0]])
    expected = by_dop853(lambda t, y: [y[1], 25.0 * (SMOOTH(t) - y[0])], cuts, [start, 0.0])
    run = li.simulate(Problem("base", base.scheme, q0={"x": start}, t_end=3.0), method, dt=1e-3)
    assert run.certificate.holds
    x = run.problem.dynamics.nodes.index("x")
    assert_allclose([run.q[-1, x], 0.1 * run.v[-1, x]], expected * [1.0, 0.1], rtol=0.0, atol=atol)


@pytest.mark.parametrize("method", ["exact", "moreau-jean", "radau"])
def test_a_table_shaken_by_two_waves_carries_the_body_until_it_falls_faster(method):
    # The floor moves by y = a (cos ωt + cos 2ωt); the body leaves it where y'' = g, downwards positive, for good until then.
    a, ω, g = 0.01, 20.0, 9.81
    floor = Harmonic(a, ω) + Harmonic(a, 2.0 * ω)
    scheme = Scheme(Mass("x", 1.0), Load("x", g), li.Bumper("x", "y", e=0.0), PrescribedMotion("y", floor))
    run = li.simulate(Problem("shaken", scheme, q0={"x": 2.0 * a}, t_end=0.2), method, dt=1e-4)
    t = np.linspace(0.0, 0.2, 200_001)
    away = t[np.argmax(-a * ω**2 * (np.cos(ω * t) + 4.0 * np.cos(2.0 * ω * t)) > g)]
    opened = next(event.t for event in run.events if event.kind == "open" and event.t > 0.01)
    assert opened == pytest.approx(away, abs=2e-4)
    assert run.certificate.holds


def test_a_sum_that_jumps_is_an_input_of_a_given_system():
    # x' = λ with x + c(t) >= 0 and λ >= 0 in size 1: x follows -c at most by the rate 1, c = s + w.
    c = [Table([0.0, 0.5, 0.5], [0.3, 0.3, 0.1]) + Harmonic(0.01, 2.0)]
    one = LinearComplementaritySystem([[0.0]], [[1.0]], [[1.0]], c=c, lower=[-1.0], upper=[1.0])
    runs = [li.simulate(Problem("r", one, q0={"x1": 0.0}, t_end=1.0), m, dt=1e-3) for m in ("exact", "moreau-jean")]
    for run in runs:
        assert run.certificate.holds
        x = run.q[:, run.problem.dynamics.nodes.index("x1")]
        assert x[400] == pytest.approx(-0.3 - 0.01 * math.cos(0.8), abs=2e-3)
        assert x[-1] == pytest.approx(-0.1 - 0.01 * math.cos(2.0), abs=2e-3)


def test_sparse_schemes_take_sums_as_full_ones_do():
    f = Harmonic(3.0, 7.0) + Table([0.0, 0.3, 0.7], [0.0, 4.0, -2.0], period=0.7) + 2.0
    parts = (
        Mass("x.1", 1.0), Mass("x.2", 1.0), li.Spring("x.1", "x.2", 100.0), li.Spring("x.1", "b", 50.0),
        PrescribedMotion("b", SMOOTH), Load("x.1", 0.5 * f), li.Loads([1, 2], f=f, a=[0.5, 2.0]),
    )  # fmt: skip
    runs = [
        li.simulate(Problem("pair", form(*parts), t_end=2.0), "moreau-jean", dt=1e-3)
        for form in (Scheme, li.SparseScheme)
    ]
    for node in ("x.1", "x.2", "b"):
        at = [run.q[:, list(run.problem.dynamics.nodes).index(node)] for run in runs]
        assert_allclose(*at, rtol=0.0, atol=1e-12)


# ---- periodic tables -----------------------------------------------------------------------------------------------------

UNITS = st.sampled_from([1e-9, 1.0, 1e9])


@given(
    st.lists(st.integers(0, 99), min_size=1, max_size=6, unique=True),
    st.integers(-300, 300),
    UNITS,
    st.integers(1, 10**5),
)
def test_a_periodic_table_is_what_numpy_interpolates(places, start, unit, later):
    times = unit * np.sort(np.array(places) + start) / 100.0
    values = np.cos(np.arange(len(times)) * 2.5)
    table = Table(times, values, period=unit)
    t = unit * (np.linspace(-5.0, 5.0, 173) + later)
    steepest = np.abs(table.derivatives(t)[:, 1]).max()
    expected = np.interp(t, times, values, period=unit)
    assert_allclose(
        table.derivatives(t)[:, 0], expected, rtol=0.0, atol=1e-14 + 4.0 * steepest * np.spacing(np.abs(t).max())
    )


@pytest.mark.parametrize("T", [0.1, 1e-9 / 3.0, 7e8])
def test_breakpoints_are_whole_periods_after_the_points_and_the_values_jump_there(T):
    table = Table([0.0, 0.3 * T, T], [1.0, -1.0, 2.0], period=T)
    breaks = table.breakpoints(0.0, 1e5 * T)
    k = np.arange(1, 100_001)
    assert np.array_equal(breaks[1::2], k * T)
    assert np.array_equal(table.derivatives(k * T)[:, 0], np.ones(100_000))
    assert_allclose(table.derivatives(np.nextafter(k * T, 0.0))[:, 0], 2.0, rtol=0.0, atol=1e-9)
    assert not table.continuous
    assert Table([0.0, T], [1.0, 1.0], period=T).continuous
    steep = Table([0.0, 1e-12 * T, 2e-12 * T, 3e-12 * T], [0.0, 1.0, 2.0, 3.0], period=T)
    assert steep(1e5 * T) == 3.0  # the instants of all are that one
    assert not Table([0.0, 0.0], [1.0, 2.0], period=T).continuous


def sawtooth(n, T, F, m):
    """Place and velocity of a free mass m after n periods of F (t/T - floor(t/T)) from rest."""
    return F * T**2 / m * (n * (n - 1) / 4 + n / 6), n * F * T / (2.0 * m)


@pytest.mark.parametrize(("method", "dt", "rtol"), SAWTOOTH)
def test_a_mass_under_a_sawtooth_by_hand(method, dt, rtol):
    push = Table([0.0, 0.3], [0.0, 50.0], period=0.3)
    run = li.simulate(Problem("saw", Scheme(Mass("x", 2.0), Load("x", push))), method, dt=dt, t_end=9.0)
    assert_allclose([run.q[-1, 0], run.v[-1, 0]], sawtooth(30, 0.3, 50.0, 2.0), rtol=rtol)
    assert run.certificate.holds


def test_after_a_hundred_thousand_periods_the_phase_is_that_of_the_first():
    push = Table([0.0, 0.05, 0.05, 0.1], [1.0, 1.0, -1.0, -1.0], period=0.1)
    run = li.simulate(Problem("PWM", Scheme(Mass("x", 2.0), Load("x", push))), "moreau-jean", dt=0.05, t_end=1e4)
    assert run.certificate.holds
    # A triangle: rounding would add up with a phase that drifts.
    assert_allclose(run.v[::2, 0], 0.0, rtol=0.0, atol=1e-11)
    assert_allclose(run.v[1::2, 0], 0.025, rtol=0.0, atol=1e-11)


def test_the_exact_motion_over_three_hundred_periods():
    push = Table([0.0, 0.1], [-1.0, 1.0], period=0.1) + Harmonic(1.0, 20.0 * math.pi)
    run = li.simulate(Problem("saw", Scheme(Mass("x", 1.0), Load("x", push))), "exact", dt=3.0, t_end=30.0)
    # x falls by T²/6 a period, and the wave adds (1 - cos ωt)/ω², zero after each.
    assert_allclose(run.q[:, 0], -0.01 / 6.0 * 10.0 * run.t, rtol=0.0, atol=1e-9)
    assert_allclose(run.v[:, 0], 0.0, rtol=0.0, atol=1e-11)


def test_an_orbit_has_the_period_of_its_table_or_the_common_one_of_a_sum():
    bumps = Table([0.0, 0.2], [0.0, 1.0], period=0.5)
    assert force_period(oscillator(bumps).dynamics, tables=True) == pytest.approx(0.5)
    both = bumps + Harmonic(1.0, 3.0 * math.pi) + 2.0
    assert force_period(oscillator(both).dynamics, tables=True) == pytest.approx(2.0)
    orbit = li.periodic_orbit(oscillator(both), transient=5)
    assert pytest.approx(2.0) == orbit.T
    assert np.abs(orbit.floquet) == pytest.approx(math.exp(-0.25 * 2.0))
    with pytest.raises(li.UnsupportedError, match="with period="):
        force_period(oscillator(Ramp(0.0, 1.0, 0.0, 1.0)).dynamics, tables=True)
    with pytest.raises(li.UnsupportedError, match="or give it a period"):
        li.periodic_orbit(oscillator(Table([0.0, 0.5, 1.0, 1.5, 2.0], [0.0, 1.0, 0.0, 1.0, 0.0])))


# ---- files, and what is refused ------------------------------------------------------------------------------------------


def test_files_hold_sums_and_periods(tmp_path):
    f = TERMS[2] + 2.0 * TERMS[0] - 3.0
    scheme = Scheme(PrescribedMotion("b", SMOOTH), Mass("x", 2.0), li.Spring("x", "b", 50.0), Load("x", f))
    path = tmp_path / "sum.toml"
    write_scheme_file(Problem("sum", scheme), path)
    found = read_scheme_file(path).problem
    assert [each.f for each in found.scheme.elements if isinstance(each, Load)] == [f]
    assert [each.y for each in found.scheme.elements if isinstance(each, PrescribedMotion)] == [SMOOTH]


HEAD = 'name = "sum"\n[[elements]]\ntype = "Mass"\nnode = "x"\nm = 1.0\n[[elements]]\ntype = "Load"\nnode = "x"\n'


def test_a_list_of_signals_and_numbers_is_their_sum(tmp_path):
    path = tmp_path / "sum.toml"
    path.write_text(
        HEAD + 'f = [9.81, { amplitude = 2.0, omega = 3.0 }, { type = "Table", times = [0], values = [1], period = 2 }]'
    )
    d = read_scheme_file(path).problem.dynamics
    assert d.loads == ((0, 9.81), (0, Harmonic(2.0, 3.0)), (0, Table([0], [1], period=2)))


@pytest.mark.parametrize(("line", "says"),
    [
        ("f = []", "f is an empty list; give the signals"),
        ("f = [1.0, 'x']", r"f\[1\] = 'x' must be a number or a table"),
        ("f = [{ amplitude = 2.0, omega = 3.0 }, { type = 'Tabel' }]", r"f\[1\]: .*'Tabel'.*Table"),
        ("f = { type = 'Table', times = [0, 1], values = [0, 1], period = 0.5 }", "period = 0.5 s is shorter"),
    ],
)  # fmt: skip
def test_lists_that_are_no_sums_are_refused(tmp_path, line, says):
    path = tmp_path / "sum.toml"
    path.write_text(HEAD + line)
    with pytest.raises(li.InputError, match=says):
        read_scheme_file(path)


@pytest.mark.parametrize(("make", "says"),
    [
        (lambda: Harmonic(1.0, 2.0) + (lambda t: t), "a function of Python stands beside"),
        (lambda: (lambda t: t) + Harmonic(1.0, 2.0), "a function of Python stands beside"),
        (lambda: Harmonic(1.0, 2.0) - (lambda t: t), "a function of Python stands beside"),
        (lambda: Harmonic(1.0, 2.0) + np.ones(2), "to finite numbers"),
        (lambda: Harmonic(1.0, 2.0) + math.nan, "to finite numbers"),
        (lambda: Harmonic(1.0, 2.0) * math.inf, "the factor must be a finite number"),
        (lambda: Harmonic(1e300, 2.0) * 1e300, "must be finite numbers"),
        (lambda: SignalSum(()), "must be a tuple of Harmonic"),
        (lambda: SignalSum((1.0,)), r"terms\[0\] = 1.0 must be Harmonic"),
        (lambda: Table([0, 1], [0, 1], period=0.5), "extend over 1 s, and period = 0.5 s is shorter"),
        (lambda: Table([0, 1], [0, 1], period=-1.0), "period = -1.0 must be a positive"),
        (lambda: Table([0, 1], [0, 1], period=math.nan), "period = nan must be a positive"),
        (lambda: Table([0, 0, 1], [0, 1, 2], period=1), "more than twice, with those a period later"),
        (lambda: Table([1e12, 1e12], [0, 1], period=1e-3), "too many periods"),
        (lambda: li.simulate(oscillator(Table([0], [1], period=1e-9)), dt=0.1), "period = 1e-09 s has .* points"),
        (lambda: PrescribedMotion("x", Table([0, 1], [0, 1], period=1.0)), "jumps, and a node moves continuously"),
        (lambda: PrescribedMotion("x", Harmonic(1.0, 2.0) + Square(1.0, 1.0)), "y is a SignalSum that jumps"),
    ],
)  # fmt: skip
def test_what_has_no_sum_or_period_is_refused_in_one_sentence(make, says):
    with pytest.raises(li.InputError, match=says):
        make()
