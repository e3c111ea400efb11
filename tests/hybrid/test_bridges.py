"""A diode bridge between an oscillating circuit and a filter, whose rows have no common relative degree."""

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import lcpimpact as li

L, C, R, FILTER, T_END = 1e-2, 1e-6, 1e3, 3e-7, 2e-3
"""Of the tutorial DiodeBridgeCapFilter of Siconos, in SI units."""


def bridge(v_L, v_f, **more):
    system = li.LinearComplementaritySystem(
        A=[[0.0, -1.0 / C, 0.0], [1.0 / L, 0.0, 0.0], [0.0, 0.0, -1.0 / (R * FILTER)]],
        B=[[0.0, 0.0, -1.0 / C, 1.0 / C], [0.0] * 4, [1.0 / FILTER, 0.0, 1.0 / FILTER, 0.0]],
        C=[[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [-1.0, 0.0, 1.0], [1.0, 0.0, 0.0]],
        D=[[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 1.0, -1.0], [0.0, -1.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]],
        states=("v_L", "i_L", "v_f"), multipliers=("i_DR1", "-v_DF2", "i_DF1", "i_DR2"), **more,
    )  # fmt: skip
    return li.Problem("bridge", system, q0={"v_L": v_L, "v_f": v_f}, t_end=T_END)


@cache
def outside(v):
    """By DOP853, from v on both capacitors: apart while |v_L| < v_f, and as one while the bridge has a current."""
    t, y, feeds, switches = 0.0, np.array([v, 0.0, v]), True, []
    while t < T_END:

        def current(t, y, feeds):
            # What the filter takes while both have one rate, (C + FILTER) |v_L|' = -± i_L - |v_L|/R
            side = np.sign(y[0])
            return FILTER * (-side * y[1] - y[2] / R) / (C + FILTER) + y[2] / R

        def apart(t, y, feeds):
            return y[2] - abs(y[0])

        def rhs(t, y, feeds):
            i = np.sign(y[0]) * current(t, y, feeds) if feeds else 0.0
            return [(-y[1] - i) / C, y[0] / L, (abs(i) - y[2] / R) / FILTER]

        if t == 0.0:
            feeds = current(t, y, feeds) > 0.0
        event = current if feeds else apart
        event.terminal, event.direction = True, -1.0
        run = solve_ivp(
            rhs, (t, T_END), y, "DOP853", rtol=1e-12, atol=1e-13, events=event, max_step=1e-5, args=(feeds,)
        )
        t, y = run.t[-1], run.y[:, -1]
        if len(run.t_events[0]):
            switches.append(t)
            feeds = not feeds
    return y, switches


@pytest.mark.parametrize(
    ("method", "v"), [("exact", 7.0), ("exact", 10.0), ("event-driven", 10.0), ("radau-fesd", 10.0)]
)
def test_a_filter_behind_a_bridge(method, v):
    run = li.simulate(bridge(v, v), method, dt=T_END / 400, t_end=T_END)
    y, switches = outside(v)
    assert run.q[-1] == pytest.approx(y, abs=1e-6)
    instants = {round(event.t, 12) for event in run.events if event.contact in ("i_DF1", "i_DR1")}
    assert sorted(instants) == pytest.approx(switches, abs=1e-9)
    # Of the diodes that conduct each takes the whole current, and none has a voltage.
    assert run.reaction.min() > -1e-9
    assert len(switches) >= 6


def test_an_empty_filter_takes_its_charge_at_once():
    """10 V on 1 µF beside 0.3 µF: the charge is kept, 10/1.3 V."""
    run = li.simulate(bridge(10.0, 0.0), "exact", dt=T_END / 400, t_end=T_END)
    assert run.events[0].kind == "jump"
    assert run.events[0].right.q[[0, 2]] == pytest.approx([10.0 / 1.3] * 2, rel=1e-12)
    inside = li.simulate(bridge(10.0 / 1.3, 10.0 / 1.3), "exact", dt=T_END / 400, t_end=T_END)
    assert run.q[-1] == pytest.approx(inside.q[-1], abs=1e-9)


def test_beside_a_relay_or_an_equation_it_is_refused_by_name():
    system = bridge(5.0, 5.0).scheme
    for lower, upper, what in ((-1.0, 1.0, "relays"), (-np.inf, np.inf, "equations")):
        more = li.LinearComplementaritySystem(
            np.pad(system.A, (0, 1)), np.pad(system.B, ((0, 1), (0, 1))) + np.outer(np.eye(4)[3], -np.eye(5)[4]),
            np.pad(system.C, (0, 1)) + np.outer(np.eye(5)[4], -np.eye(4)[3]), np.pad(system.D, (0, 1)),
            lower=[0.0] * 4 + [lower], upper=[np.inf] * 4 + [upper],
        )  # fmt: skip
        with pytest.raises(li.UnsupportedError, match=f"does not handle that beside {what}"):
            li.simulate(li.Problem("more", more, q0={"x1": 5.0, "x3": 5.0}), "exact", dt=1e-5, t_end=1e-3)
