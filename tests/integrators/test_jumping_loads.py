"""Loads, inputs and velocities of prescribed motions that jump at an instant, and loads within a step: none is smeared."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import trapezoid

import lcpimpact as li
from lcpimpact import Bumper, KelvinVoigt, Load, Mass, PrescribedMotion, Problem, Scheme, Square, Table
from lcpimpact.integrators import METHODS
from lcpimpact.scheme.signals import Ramp, breakpoints_at, limits_at, limits_in_steps, means_in_steps

STEPPING = [name for name in METHODS if name not in ("exact", "event-driven", "radau-fesd", "rk4-paper")]
TWO_STEP = ("cd-lagrange", "schatzman-paoli")
WITH_MOTIONS = [name for name in STEPPING if METHODS[name].declared.order_force_jump]


def moved(t, ulps):
    """The float so many floats after t."""
    for _ in range(abs(ulps)):
        t = float(np.nextafter(t, math.copysign(math.inf, ulps)))
    return t


def pushed(jump=1.0):
    """A free body of 1 kg under 1 N until the jump, and nothing after it."""
    return Problem("pushed", Scheme(Mass("x", 1.0), Load("x", Table([0.0, jump, jump], [1.0, 1.0, 0.0]))), t_end=2.0)


def run(problem, method, dt=0.1, **options):
    return li.simulate(problem, method, dt=dt, progress=False, **options)


@pytest.mark.parametrize("ulps", [-4, -1, 0, 1, 4])
@pytest.mark.parametrize("method", STEPPING)
def test_the_impulse_of_a_load_that_ends_at_an_instant_is_its_own(method, ulps):
    found = run(pushed(moved(1.0, ulps)), method)
    assert_allclose(found["v_x"][10:], 1.0, rtol=0, atol=1e-14)
    assert_allclose(found["x"][10:], found.t[10:] - 0.5, rtol=0, atol=1e-13)
    assert found.certificate.missed_impulse == 0.0


@pytest.mark.parametrize("end", [1.03, 1.0 + 1e-9, 1.1 - 1e-9])
@pytest.mark.parametrize("method", STEPPING)
def test_the_impulse_of_a_load_that_ends_inside_a_step_is_its_own(method, end):
    """With the memory of generalized-alpha a jump acts over some steps, by ever less."""
    found = run(pushed(end), method)
    assert_allclose(found["v_x"][-1], end, rtol=0, atol=1e-5 if method == "generalized-alpha" else 1e-13)
    assert found.success
    assert found.certificate.missed_impulse == 0.0


@pytest.mark.parametrize("method", STEPPING)
def test_the_impulse_of_a_table_with_several_points_in_each_step_is_its_own(method):
    rng = np.random.default_rng(3)
    times, values = np.sort(rng.uniform(0.0, 1.9, 70)), rng.normal(size=70)
    values[[0, -1]] = 0.0
    problem = Problem("record", Scheme(Mass("x", 2.0), Load("x", Table(times, values))), t_end=4.0)
    found = run(problem, method)
    assert_allclose(
        found["v_x"][-1],
        0.5 * trapezoid(values, times),
        rtol=0,
        atol=1e-8 if method == "generalized-alpha" else 1e-12,
    )


@pytest.mark.parametrize("kind", [Scheme, li.SparseScheme])
def test_a_node_that_a_spring_alone_holds_is_in_balance_at_each_instant(kind):
    table = Table([0.0, 0.2517, 0.4533, 1.0], [0.0, 3.0, -2.0, 0.0])
    elements = (Mass("x", 1.0), li.Spring("x", "ground", 5.0), li.Spring("z", "ground", 100.0), Load("z", table))
    found = run(Problem("held", kind(*elements), v0={"x": 1.0}, t_end=1.0), "moreau-jean")
    assert_allclose(found["z"], [table(float(t)) / 100.0 for t in found.t], rtol=0, atol=1e-15)


@pytest.mark.parametrize("theta", [0.5, 0.7, 1.0])
def test_so_it_is_with_every_weight(theta):
    assert_allclose(run(pushed(1.03), "moreau-jean", theta=theta)["v_x"][-1], 1.03, rtol=0, atol=1e-14)


@pytest.mark.parametrize("method", ["cd-lagrange", "schatzman-paoli"])
def test_two_step_methods_let_a_contact_open_half_a_step_late(method):
    """A jump acts by its mean over the step around it, here 1 N on the floor, and its second half, -3 N h/2, is lost."""
    load = Load("x", Table([0.0, 1.0, 1.0], [5.0, 5.0, -3.0]))
    scheme = Scheme(Mass("x", 1.0), load, Bumper("x", "ground", e=0.0, name="R"))
    found = run(Problem("lifted", scheme, t_end=2.0), method)
    assert_allclose(found["v_x"][-1] + 3.0 * 1.0, 3.0 * 0.05, rtol=1e-9)


@pytest.mark.parametrize("method", ["moreau-jean", "newmark-ns"])
def test_steps_that_are_halved_see_it_too(method):
    found = run(pushed(), method, rtol=1e-6)
    assert_allclose(found["v_x"][found.t >= 1.0], 1.0, rtol=0, atol=1e-14)


@pytest.mark.parametrize("method", ["bs23", "dopri5"])
def test_steps_under_control_see_it_too(method):
    found = run(pushed(), method, rtol=1e-6)
    assert_allclose(found["v_x"][10:], 1.0, rtol=0, atol=1e-14)


@pytest.mark.parametrize("method", STEPPING)
def test_the_order_is_that_of_smooth_motion(method):
    """A damped oscillator under a square wave of period 1 s, whose jumps at 1/4 s, 3/4 s, ... are instants of the grid."""
    scheme = Scheme(Mass("x", 1.0), KelvinVoigt("x", "ground", 4.0, 0.3), Load("x", Square(1.0, 2.0 * np.pi)))
    problem = Problem("square", scheme, t_end=2.0)
    truth = run(problem, "exact", dt=0.05)
    coarse, fine = (run(problem, method, dt=dt) for dt in (0.05, 0.025))
    errors = [np.abs(each.q - truth.sample(each.t).q).max() for each in (coarse, fine)]
    order = METHODS[method].declared.order_smooth
    assert errors[1] < 1e-10 or math.log2(errors[0] / errors[1]) > order - 0.5


@pytest.mark.parametrize("method", [name for name in STEPPING if name not in (*TWO_STEP, "radau")])
def test_a_contact_opens_where_its_load_does(method):
    """A body that is pressed on the floor by 5 N until t = 1 s, and then pulled off by 3 N."""
    load = Load("x", Table([0.0, 1.0, 1.0], [5.0, 5.0, -3.0]))
    found = run(
        Problem("lifted", Scheme(Mass("x", 1.0), load, Bumper("x", "ground", e=0.0, name="R")), t_end=2.0), method
    )
    assert [(event.kind, round(event.t, 12)) for event in found.events] == [("open", 1.0)]
    assert_allclose(found["R"][found.t_reaction < 0.999], 5.0, rtol=1e-12)
    assert_allclose(found["x"], -1.5 * np.maximum(found.t - 1.0, 0.0) ** 2, rtol=0, atol=1e-13)


@pytest.mark.parametrize("method", WITH_MOTIONS)
def test_a_table_that_stops_at_an_instant(method):
    """The velocity of a table jumps, and so does the force of a dashpot to it."""
    table = PrescribedMotion("y", Table([0.0, 1.0, 2.0], [0.0, 1.0, 1.0]))
    problem = Problem("table", Scheme(table, Mass("x", 1.0), KelvinVoigt("x", "y", 4.0, 0.3)), t_end=2.0)
    truth = run(problem, "exact", dt=0.1)
    coarse, fine = (run(problem, method, dt=dt) for dt in (0.1, 0.05))
    errors = [np.abs(each.q - truth.sample(each.t).q).max() for each in (coarse, fine)]
    assert math.log2(errors[0] / errors[1]) > METHODS[method].declared.order_smooth - 0.5


@pytest.mark.parametrize("method", ["moreau-jean", "radau"])
def test_a_relay_switches_where_its_input_jumps(method):
    """x' in -Sgn(x - 2 H(t - 1)): x falls from 0.5 to 0 and rests, then rises from t = 1 on."""
    relay = li.LinearComplementaritySystem(
        [[0.0]], [[1.0]], [[1.0]], c=[Table([0.0, 1.0, 1.0], [0.0, 0.0, -2.0])], lower=[-1.0], upper=[1.0]
    )
    found = run(Problem("relay", relay, q0={"x1": 0.5}, t_end=2.0), method)
    x = np.where(found.t < 1.0, np.maximum(0.5 - found.t, 0.0), found.t - 1.0)
    assert_allclose(found["x1"], x, rtol=0, atol=1e-12)


@pytest.mark.parametrize("omega", [2.0 * np.pi, 7.3])
def test_sparse_steps_are_the_dense_ones(omega):
    elements = (Mass("x", 1.0), KelvinVoigt("x", "ground", 4.0, 0.3), Load("x", Square(1.0, omega)))
    dense, sparse = (
        run(Problem("square", kind(*elements), t_end=2.0), "moreau-jean", dt=0.05) for kind in (Scheme, li.SparseScheme)
    )
    assert_allclose(sparse.q, dense.q, rtol=0, atol=1e-14)
    assert sparse.success


@pytest.mark.parametrize("end", [1.0, 1.03])
def test_a_sweep_sees_it(end):
    found = li.sweep(pushed(end), {"0.m": [1.0, 2.0, 4.0]}, dt=0.1, outputs=("v_x.max",), progress=False)
    assert_allclose(found["v_x.max"].values, np.multiply(end, [1.0, 0.5, 0.25]), rtol=1e-13)


@pytest.mark.parametrize("method", ["moreau-jean", "rk4"])
def test_a_function_of_time_is_sampled(method):
    """Nobody knows where a function jumps: the step before the jump takes its value there for one at its end."""
    load = Load("x", lambda t: 1.0 if t < 1.0 else 0.0)
    found = run(Problem("sampled", Scheme(Mass("x", 1.0), load), t_end=2.0), method)
    assert 0.9 < found["v_x"][-1] < 1.0 - 0.1 / 7.0


def test_limits_at_instants_of_a_grid():
    t = np.array([0.0, 0.5, 1.0, 1.5])
    jump = moved(1.0, 3)
    signal = Table([0.0, jump, jump, 2.0], [2.0, 2.0, 5.0, 6.0])
    left, right = limits_at(signal, t)
    assert_allclose(left, [2.0, 2.0, 2.0, 5.5])
    assert_allclose(right, [2.0, 2.0, 5.0, 5.5])
    at, breaks = breakpoints_at(signal, t)
    assert (at.tolist(), breaks.tolist()) == ([0, 2], [0.0, jump])
    signal = Table([0.0, moved(1.0, 5), moved(1.0, 5)], [2.0, 2.0, 5.0])
    assert [each.tolist() for each in limits_at(signal, t)] == [[2.0, 2.0, 2.0, 5.0]] * 2


def test_the_left_limit_of_a_steep_slope_is_the_value_at_its_end():
    """A pulse that grows for eight floats before it ends, late in a run."""
    end = 1e6
    signal = Table([0.0, moved(end, -8), end, end], [0.0, 0.0, 3.0, 1.0])
    assert [each.tolist() for each in limits_at(signal, np.array([0.0, end, 2.0 * end]))] == [
        [0.0, 3.0, 1.0], [0.0, 1.0, 1.0],
    ]  # fmt: skip


HALF_OFF = {
    "a slope of one float": Table([0.0, 0.3, 0.1 + 0.2, 1.0], [5.0, 5.0, 0.0, 0.0]),
    "two jumps a float apart": Table([0.0, 0.3, 0.3, 0.1 + 0.2, 0.1 + 0.2, 1.0], [5.0, 5.0, 2.0, 2.0, 0.0, 0.0]),
}
"""Pushes of 5 N over 0.3 s, whose end has two floats."""


@pytest.mark.parametrize("push", HALF_OFF.values(), ids=HALF_OFF)
@pytest.mark.parametrize(
    ("method", "kind"), [*((method, Scheme) for method in STEPPING), ("moreau-jean", li.SparseScheme)]
)
def test_breakpoints_that_rounding_parts_are_one_jump(method, kind, push):
    found = run(Problem("pushed", kind(Mass("x", 1.0), Load("x", push)), t_end=1.0), method)
    assert found.success
    assert_allclose(found["v_x"][-1], 1.5, rtol=0, atol=1e-5 if method == "generalized-alpha" else 1e-13)


@pytest.mark.parametrize(
    "signal",
    [Square(2.0, 5.0, 0.3), Ramp(1.0, -2.0, 0.37, 0.71), Table([0.0, 0.2, 0.2, 0.9], [1.0, 3.0, -1.0, 0.5])],
)
def test_means_in_steps_are_those_of_fine_sums(signal):
    t = np.linspace(0.0, 1.5, 13)
    steps, means = means_in_steps(signal, t)
    inside = [k for k in range(12) if len(signal.breakpoints(t[k] + 1e-12, t[k + 1] - 1e-12))]
    assert steps.tolist() == inside
    for k, mean in zip(steps, means, strict=True):
        middles = t[k] + (np.arange(200_000) + 0.5) / 200_000 * (t[k + 1] - t[k])
        assert mean == pytest.approx(signal.derivatives(middles)[:, 0].mean(), abs=1e-5)
    for kept in (None, 0.0, 1.0):
        left, right = limits_in_steps(signal, t, kept)
        plain_left, plain_right = limits_at(signal, t)
        assert_allclose(0.5 * (right[steps] + left[steps + 1]), means, rtol=0, atol=1e-15)
        others = np.setdiff1d(np.arange(12), steps)
        assert (right[others] == plain_right[others]).all()
        assert (left[others + 1] == plain_left[others + 1]).all()
