"""The buck converter against an independent map of one period: matrix exponentials, and switching times by bisection."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

import lcpimpact as li

T, L, C, R, V_REF, GAIN, LOW, HIGH = 400e-6, 20e-3, 47e-6, 22.0, 11.3, 8.4, 3.8, 8.2
A = np.array([[-1.0 / (R * C), 1.0 / C], [-1.0 / L, 0.0]])


def exponential(t, source):
    """The matrix that takes the circuit's state and a constant 1 through the time t with a source."""
    whole = np.zeros((3, 3))
    whole[:2, :2], whole[1, 2] = A, source / L
    return expm(whole * t)


def flow(x, t, source):
    """The circuit's state after t with a source."""
    return (exponential(t, source) @ np.append(x, 1.0))[:2]


def excess(v, t):
    """How far the control voltage is above the sawtooth."""
    return GAIN * (v - V_REF) - (LOW + (HIGH - LOW) * t / T)


def cycle(x, E):
    """The state after a period, and the switching times in it, found on 400 points and refined by bisection."""
    t, switches = 0.0, []
    on = GAIN * (x[0] - V_REF) < LOW
    while t < T:
        source = E if on else 0.0

        def error(s, x=x, t=t, source=source):
            return excess(flow(x, s - t, source)[0], s)

        # Just after a switch the error is zero.
        points = np.linspace(t + 1e-9, T, 401)
        states = [exponential(points[0] - t, source) @ np.append(x, 1.0)]
        step = exponential(points[1] - points[0], source)
        for _ in points[1:]:
            states.append(step @ states[-1])
        signs = excess(np.array(states)[:, 0], points) < 0.0
        changes = np.flatnonzero(signs != on)
        if not len(changes):
            return flow(x, T - t, source), switches
        k = changes[0]
        end = brentq(error, points[k - 1], points[k], xtol=1e-18) if k else points[0]
        x, t, on = flow(x, end - t, source), end, not on
        switches.append(end)
    return x, switches


def converter(E, periods, **q0):
    problem = li.load_problem("buck-converter", E=E, periods=periods)
    return li.Problem("converter", problem.scheme, q0={**problem.q0, **q0}, t_end=problem.t_end)


@pytest.mark.parametrize("E", [22.0, *(pytest.param(E, marks=pytest.mark.slow) for E in (28.0, 33.0))])
def test_periods_and_switching_times_by_an_independent_map(E):
    """Also in chaos, as long as rounding allows: 12 periods from rest."""
    run = li.simulate(converter(E, 12.0, v=0.0, i=0.0), "exact", dt=T, t_end=12.0 * T)
    x, switches = np.zeros(2), []
    for k in range(12):
        x, found = cycle(x, E)
        switches += [k * T + s for s in found]
        assert [run["v"][k + 1], run["i"][k + 1]] == pytest.approx(x.tolist(), abs=1e-9), k
    inside = [event.t for event in run.events if min(event.t % T, T - event.t % T) > 1e-9]
    assert inside == pytest.approx(switches, abs=1e-12)


@pytest.mark.parametrize(("E", "period"), [(22.0, 1), (28.0, 2), (31.5, 4)])
def test_the_period_doubles_where_the_literature_says(E, period):
    """From 24.52 V on two periods of the sawtooth are one of the motion, and four at 31.5 V (Fossas and Olivar)."""
    run = li.simulate(converter(E, 150.0, v=12.05), "exact", dt=T, t_end=150.0 * T)
    # Without the end, at which the sawtooth ends too.
    v = run["v"][-17:-1]
    assert np.abs(v[period:] - v[:-period]).max() < 1e-6
    if period > 1:
        half = period // 2
        assert np.abs(v[half:] - v[:-half]).max() > 1e-3


@pytest.mark.slow
def test_the_multiplier_of_the_motion_is_minus_one_at_the_doubling():
    def multiplier(E):
        q0 = li.load_problem("buck-converter", E=E).q0
        x, h = np.array([q0["v"], q0["i"]]), 1e-6
        columns = [(cycle(x + h * e, E)[0] - cycle(x - h * e, E)[0]) / (2.0 * h) for e in np.eye(2)]
        return np.linalg.eigvals(np.array(columns).T).real.min()

    assert brentq(lambda E: multiplier(E) + 1.0, 24.0, 25.0, xtol=1e-4) == pytest.approx(24.516, abs=2e-3)


@pytest.mark.parametrize("method", ["event-driven", "radau-fesd", "moreau-jean", "radau"])
def test_other_methods(method):
    problem = li.load_problem("buck-converter")
    steps = 20_000 if method in ("moreau-jean", "radau") else 100
    run = li.simulate(problem, method, dt=problem.t_end / steps, t_end=problem.t_end)
    assert run.success
    assert len(run.events) == 7
    assert np.abs(run.q - problem.motion(run.t)[0])[:, :2].max() < (5e-3 if steps > 100 else 1e-7)


def test_the_diode_blocks_where_the_current_would_turn():
    """With a load of 2000 Ω the current stops in each period, and the diode holds it at zero."""
    system = li.load_problem("buck-converter").scheme
    light = li.LinearComplementaritySystem(
        [[-1.0 / (2000.0 * C), 1.0 / C], [-1.0 / L, 0.0]], system.B, system.C, c=system.c, states=system.states,
        multipliers=system.multipliers, lower=system.lower, upper=system.upper,
    )  # fmt: skip
    for method in ("exact", "event-driven"):
        run = li.simulate(li.Problem("light", light, q0={"v": 11.0}), method, dt=T / 50, t_end=10.0 * T)
        assert run["i"].min() > -1e-12
        assert {event.kind for event in run.events if event.contact == "λ_D"} == {"close", "open"}
    with pytest.raises(li.InputError, match="R = 2000 the current stops in each period"):
        li.load_problem("buck-converter", R=2000.0)
