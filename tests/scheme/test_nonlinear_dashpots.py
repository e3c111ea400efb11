"""Non-linear dashpots: closed forms of a braked mass, and the paper's Systems 1 and 2 against DOP853 with their cases."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import lcpimpact as li
from lcpimpact import Bumper, Dashpot, Load, Mass, NonlinearDashpot, Problem, Scheme, Spring, simulate

G = 9.81
M, K, K_O = 100.0, 1962.0, 3924.0
V_O = math.sqrt(2.0 * G * 5.0)


def braked(c: float, n: float, f: float = 0.0, v: float = 3.0, m: float = 2.0, **law) -> Problem:
    return Problem(
        "braked", Scheme(Mass("x", m=m), Load("x", f), NonlinearDashpot("x", "ground", c=c, n=n, **law)), v0={"x": v}
    )


def free_velocity(t, c: float, n: float, v: float = 3.0, m: float = 2.0):
    if n == 1.0:
        return v * np.exp(-c * t / m)
    return np.maximum(v ** (1.0 - n) - (1.0 - n) * c * t / m, 0.0) ** (1.0 / (1.0 - n))


def system(number: int, *dampers) -> Problem:
    """The paper's System 1 or 2 with other dampers on the plate."""
    chain = [Bumper("x", "z")] if number == 1 else [Spring("x", "y", k=K), Bumper("y", "z")]
    scheme = Scheme(Mass("x", m=M), Load("x", f=M * G), *chain, Spring("z", "ground", k=K_O), *dampers)
    return Problem(f"system {number}", scheme, v0={"x": V_O})


def system_2_by_cases(rate_of, T: float) -> np.ndarray:
    """x, x' and z at T by Eq. (6) with z' = F⁻¹(p), by DOP853 while the plate gives way, while it returns, and apart."""
    state, t = np.array([0.0, V_O, 0.0]), 0.0
    for closed, side in ((True, 1.0), (True, -1.0), (False, -1.0)):

        def balance(y, closed=closed):
            return (K * (y[0] - y[2]) if closed else 0.0) - K_O * y[2]

        def rate(t, y, closed=closed, side=side, balance=balance):
            x, v, z = y
            return [v, G - (K * (x - z) / M if closed else 0.0), rate_of(side * max(side * balance(y), 0.0))]

        def ends(t, y, begun=t, side=side, balance=balance):
            return 1.0 if t <= begun + 1e-10 else balance(y) if side > 0.0 else y[0] - y[2]

        ends.terminal, ends.direction = closed, -1.0
        run = solve_ivp(rate, (t, T), state, "DOP853", rtol=1e-11, atol=1e-13, events=ends, max_step=0.02)
        t, state = float(run.t[-1]), run.y[:, -1]
        if t == T:
            break
    return state


@pytest.mark.parametrize("n", [0.5, 0.75, 1.0, 1.5, 2.0, 3.0])
def test_a_braked_mass_has_its_closed_form_to_second_order(n: float) -> None:
    errors = []
    for dt in (0.04, 0.02, 0.01):
        run = simulate(braked(0.4, n), dt=dt, t_end=5.0, error=False)
        errors.append(np.abs(run["v_x"] - free_velocity(run.t, 0.4, n)).max())
    assert math.log2(errors[0] / errors[2]) / 2.0 == pytest.approx(2.0, abs=0.05)
    assert errors[2] < 1e-4


@pytest.mark.parametrize("n", [0.5, 0.75])
@pytest.mark.parametrize("dt", [0.2, 0.01])
def test_a_root_of_the_velocity_stops_a_mass_within_a_time_and_leaves_it_at_rest(n: float, dt: float) -> None:
    stops = 2.0 * 3.0 ** (1.0 - n) / (0.4 * (1.0 - n))
    run = simulate(braked(0.4, n), dt=dt, t_end=dt * round(2.0 * stops / dt), error=False)
    after = run.t > stops + 2.0 * dt
    assert np.abs(run["v_x"][after]).max() < 2.0 * dt**2
    assert np.abs(run["v_x"][run.t > 1.3 * stops]).max() == 0.0
    assert np.ptp(run["x"][run.t > 1.3 * stops]) == 0.0
    assert run["x"][-1] == pytest.approx(2.0 * 3.0 ** (2.0 - n) / (0.4 * (2.0 - n)), rel=dt)


@pytest.mark.parametrize("n", [0.5, 1.0, 2.0, 3.0])
@pytest.mark.parametrize("c", [0.4, 4e2, 4e5])
@pytest.mark.parametrize("dt", [0.5, 0.01])
def test_a_dashpot_of_any_strength_leads_to_the_terminal_velocity_without_throwing_back(
    n: float, c: float, dt: float
) -> None:
    end = (5.0 / c) ** (1.0 / n)
    run = simulate(braked(c, n, f=5.0, v=3.0 + end), dt=dt, t_end=40.0 * dt, error=False)
    v = run["v_x"]
    assert (v >= -1e-9).all() or n < 1.0
    assert (np.abs(np.diff(v[20:])) <= 0.2 * np.abs(v[20:-1]) + 1e-12).all()
    if c > 1.0 and n >= 1.0:
        assert abs(v[-1] - end) < 0.5 * abs(v[0] - end)


def test_quadratic_drag_has_the_velocity_of_the_book() -> None:
    t_end, c, m = 4.0, 0.7, 2.0
    run = simulate(braked(c, 2.0), "event-driven", dt=0.5, t_end=t_end, error=False)
    np.testing.assert_allclose(run["v_x"], 3.0 / (1.0 + c * 3.0 * run.t / m), rtol=1e-8)
    np.testing.assert_allclose(run["x"], m / c * np.log1p(c * 3.0 * run.t / m), rtol=1e-8, atol=1e-9)
    falling = simulate(braked(c, 2.0, f=m * G, v=0.0), "event-driven", dt=0.5, t_end=t_end, error=False)
    end = math.sqrt(m * G / c)
    np.testing.assert_allclose(falling["v_x"], end * np.tanh(G * falling.t / end), rtol=1e-8)


@pytest.mark.parametrize("method", ["moreau-jean", "event-driven"])
def test_one_side_two_constants_and_a_table_brake_as_they_say(method: str) -> None:
    table = {"law": "table", "rates": [-4.0, -1.0, 0.0, 2.0, 8.0], "forces": [-5.0, -4.0, 0.0, 1.0, 10.0]}
    laws = {
        "compression": ({"law": "compression", "c": 3.0, "n": 2.0}, lambda v: 3.0 * v * abs(v) if v < 0.0 else 0.0),
        "extension": ({"law": "extension", "c": 3.0, "n": 2.0}, lambda v: 3.0 * v * abs(v) if v > 0.0 else 0.0),
        "both": ({"c": 3.0, "n": 1.5, "c_extension": 0.5}, lambda v: (0.5 if v > 0.0 else 3.0) * v * abs(v) ** 0.5),
        "table": (table, lambda v: float(np.interp(v, table["rates"], table["forces"]))),
    }
    for name, (given, F) in laws.items():
        # x on a spring to the ground: b is the ground, so that v_b - v_a = -x'.
        scheme = Scheme(Mass("x", m=2.0), Spring("x", "ground", k=40.0), NonlinearDashpot("x", "ground", **given))
        run = simulate(Problem(name, scheme, v0={"x": 3.0}), method, dt=2e-3, t_end=4.0, error=False)

        def rate(t, y, F=F):
            return [y[1], (F(-y[1]) - 40.0 * y[0]) / 2.0]

        expected = solve_ivp(
            rate, (0.0, 4.0), [0.0, 3.0], "DOP853", t_eval=run.t, rtol=1e-10, atol=1e-12, max_step=0.01
        ).y
        np.testing.assert_allclose(run["x"], expected[0], atol=1e-4 if method == "moreau-jean" else 1e-7)
        np.testing.assert_allclose(run["v_x"], expected[1], atol=5e-4 if method == "moreau-jean" else 1e-6)


@pytest.mark.parametrize("number", [1, 2])
@pytest.mark.parametrize("c", [250.0, 2e4, 3.0])
def test_a_power_of_one_is_the_linear_dashpot(number: int, c: float) -> None:
    for dt in (0.02, 1e-3):
        of_power, linear = (
            simulate(system(number, damper), dt=dt, t_end=2.0, error=False)
            for damper in (NonlinearDashpot("z", "ground", c=c, n=1.0), Dashpot("z", "ground", c=c))
        )
        # Where a weak plate swings back alone, the non-linear one does not throw it over.
        np.testing.assert_allclose(of_power["x"], linear["x"], atol=1e-9 if c > 200.0 else 2e-1 * dt)
    if c == 250.0:
        exact = simulate(system(number, Dashpot("z", "ground", c=c)), "exact", dt=0.01, t_end=2.0, error=False)
        found = simulate(
            system(number, NonlinearDashpot("z", "ground", c=c, n=1.0)), "event-driven", dt=0.01, t_end=2.0, error=False
        )
        np.testing.assert_allclose(found["x"], exact["x"], atol=1e-8)
        assert [each.kind for each in found.events] == [each.kind for each in exact.events]


@pytest.mark.parametrize("n", [0.5, 1.5, 2.0, 3.0])
@pytest.mark.parametrize("strength", [1.0, 10.0])
def test_system_2_with_a_power_has_the_motion_of_its_cases(n: float, strength: float) -> None:
    c = strength * 2476.0 / V_O**n
    t_end = 0.6

    def rate_of(p: float) -> float:
        return math.copysign((abs(p) / c) ** (1.0 / n), p)

    expected = system_2_by_cases(rate_of, t_end)
    problem = system(2, NonlinearDashpot("z", "ground", c=c, n=n))
    errors = []
    for dt in (0.02, 0.01, 0.005):
        run = simulate(problem, dt=dt, t_end=t_end, error=False)
        errors.append(abs(run["x"][-1] - expected[0]))
    assert errors[2] < min(2e-4, 0.5 * errors[0])
    if n < 1.0:
        run = simulate(problem, "event-driven", dt=0.1, t_end=t_end, error=False)
        found = [run["x"][-1], run["v_x"][-1], run["z"][-1]]
        np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("n", [1.5, 2.0, 3.0])
def test_a_plate_that_is_left_alone_comes_to_rest_within_a_time(n: float) -> None:
    c, z_0 = 25.0, 0.4
    scheme = Scheme(Mass("far", m=1.0), Spring("z", "ground", k=K_O), NonlinearDashpot("z", "ground", c=c, n=n))
    a = 1.0 - 1.0 / n
    stops = z_0**a / (a * (K_O / c) ** (1.0 / n))
    for steps in (41, 803):
        dt = 4.0 * stops / steps
        run = simulate(Problem("plate", scheme, q0={"z": z_0}), dt=dt, t_end=4.0 * stops, error=False)
        expected = np.maximum(z_0**a - a * (K_O / c) ** (1.0 / n) * run.t, 0.0) ** (1.0 / a)
        assert np.abs(run["z"] - expected).max() < 2.0 * z_0 * dt / stops
        assert np.abs(run["z"][run.t > 2.0 * stops]).max() < 1e-3 * z_0 * (dt / stops)


def test_a_table_on_the_plate_has_the_motion_of_its_cases() -> None:
    v, F = [-20.0, -1.0, 0.0, 1.0, 20.0], [-6000.0, -300.0, 0.0, 400.0, 4000.0]
    problem = system(2, NonlinearDashpot("z", "ground", law="table", rates=v, forces=F))
    # The plate's rate is z' = v_a, and v = v_b - v_a.
    expected = system_2_by_cases(lambda p: -float(np.interp(-p, F, v)), 0.9)
    run = simulate(problem, "event-driven", dt=0.1, t_end=0.9, error=False)
    np.testing.assert_allclose([run["x"][-1], run["v_x"][-1], run["z"][-1]], expected, rtol=1e-7)
    assert abs(simulate(problem, dt=2e-3, t_end=0.9, error=False)["x"][-1] - expected[0]) < 1e-4


def test_system_1_has_its_closed_mode_and_opens_where_the_force_ends() -> None:
    n, c, t_end = 1.5, 79.5, 0.7

    def force(y):
        return c * y[1] * abs(y[1]) ** (n - 1.0) + K_O * y[0]

    def opens(t, y):
        return force(y)

    opens.terminal, opens.direction = True, -1.0
    run = solve_ivp(
        lambda t, y: [y[1], G - force(y) / M], (0.0, t_end), [0.0, V_O], "DOP853", events=opens, rtol=1e-12, atol=1e-13
    )
    t_open, (x, v) = run.t[-1], run.y[:, -1]
    beside = NonlinearDashpot("z", "ground", c=c, n=n)
    found = simulate(system(1, beside), dt=1e-3, t_end=t_end, error=False)
    rest = t_end - t_open
    assert found["x"][-1] == pytest.approx(x + v * rest + 0.5 * G * rest**2, abs=2e-4)
    assert found["R"][0] == pytest.approx(force([0.0, V_O]), rel=0.02)


def test_what_the_dashpot_takes_is_in_the_ledger() -> None:
    problem = system(2, NonlinearDashpot("z", "ground", c=25.0, n=2.0))
    run = simulate(problem, dt=1e-3, t_end=0.9, error=False)
    x, v, y, z = (run[name][-1] for name in ("x", "v_x", "y", "z"))
    stored = 0.5 * M * v**2 + 0.5 * K * (y - x) ** 2 + 0.5 * K_O * z**2 - M * G * x
    assert run.summary()["dissipated"] == pytest.approx(0.5 * M * V_O**2 - stored, rel=1e-3)
    table = li.energy_ledger(run).table
    assert table["NonlinearDashpot z to ground"].iloc[-1] == pytest.approx(0.5 * M * V_O**2 - stored, rel=1e-3)


def test_several_dashpots_that_move_each_other_are_solved_together() -> None:
    def chain(kind, *laws):
        return Problem("chain", Scheme(
            Mass("x", m=M), Load("x", f=M * G), Spring("x", "y", k=K), kind("x", "y", **laws[0]), Bumper("y", "z"),
            Spring("z", "ground", k=K_O), kind("z", "ground", **laws[1]),
        ), v0={"x": V_O})  # fmt: skip

    linear = simulate(chain(Dashpot, {"c": 60.0}, {"c": 250.0}), "exact", dt=0.05, t_end=2.6, error=False)
    powers = chain(NonlinearDashpot, {"c": 60.0, "n": 1.0}, {"c": 250.0, "n": 1.0})
    found = simulate(powers, "event-driven", dt=0.05, t_end=2.6, error=False)
    np.testing.assert_allclose(found["x"], linear["x"], atol=1e-7)
    np.testing.assert_allclose(found["R"], linear["R"], atol=1e-4)


def test_a_rate_that_no_force_determines_is_refused_with_a_remedy_that_works() -> None:
    one_sided = NonlinearDashpot("z", "ground", law="compression", c=50.0, n=1.0)
    with pytest.raises(li.InputError, match=r"does not rise with the rate everywhere.*'z'.*put a Dashpot beside it"):
        system(2, one_sided).dynamics  # noqa: B018
    assert simulate(system(2, one_sided, Dashpot("z", "ground", c=20.0)), dt=0.01, t_end=1.0, error=False).success
    alone = [Mass("x", m=1.0), Bumper("x", "z"), NonlinearDashpot("z", "ground", c=2.0, n=2.0)]
    with pytest.raises(li.InputError, match=r"'z' has no mass, and a non-linear dashpot alone holds it: put a Spring"):
        Scheme(*alone).assemble()
    beside = Problem("beside", Scheme(*alone, Spring("z", "ground", k=10.0)), v0={"x": 1.0})
    assert simulate(beside, dt=0.01, t_end=1.0, error=False).success


@pytest.mark.parametrize("number", [1, 2])
def test_what_comes_to_rest_infinitely_fast_is_refused_by_event_driven_with_a_remedy_that_works(number: int) -> None:
    quadratic = NonlinearDashpot("z", "ground", c=25.0, n=2.0)
    with pytest.raises(li.UnsupportedError, match=r"slope is zero at rest.*put a Dashpot beside it.*moreau-jean"):
        simulate(system(number, quadratic), "event-driven", dt=0.01, t_end=0.5)
    with_linear = system(number, quadratic, Dashpot("z", "ground", c=20.0))
    accurate = simulate(with_linear, "event-driven", dt=0.01, t_end=1.5, error=False)
    np.testing.assert_allclose(
        simulate(with_linear, dt=1e-3, t_end=1.5, error=False)["x"][::10], accurate["x"], atol=2e-3
    )
    with pytest.raises(li.UnsupportedError, match=r"slope is infinite at rest.*moreau-jean"):
        simulate(braked(0.4, 0.5), "event-driven", dt=0.01, t_end=0.5)
    with pytest.raises(li.UnsupportedError, match=r"slope is infinite at rest.*moreau-jean"):
        simulate(braked(0.4, 0.5), "rk4", dt=0.01, t_end=0.5)
    for method in ("exact", "radau", "newmark-ns"):
        with pytest.raises(li.UnsupportedError, match="non-linear dashpots"):
            simulate(braked(0.4, 2.0), method, dt=0.01, t_end=0.5)


EXPLICIT = ("heun", "ssprk3", "rk4", "bs23", "dopri5")
BLOW_OFF = NonlinearDashpot(
    "z",
    "ground",
    law="table",
    rates=[-3.0, -1.0, 0.0, 0.2, 1.0, 4.0],
    forces=[-2500.0, -2000.0, 0.0, 1500.0, 2000.0, 2600.0],
)
PLATES = {
    "power": [Dashpot("z", "ground", c=250.0), NonlinearDashpot("z", "ground", c=25.0, n=2.0)],
    "compression": [
        Dashpot("z", "ground", c=250.0),
        NonlinearDashpot("z", "ground", law="compression", c=500.0, n=1.5),
    ],
    "extension": [Dashpot("z", "ground", c=250.0), NonlinearDashpot("z", "ground", law="extension", c=500.0, n=1.5)],
    "table": [BLOW_OFF],
}


@pytest.mark.parametrize(
    ("method", "order"), [("heun", 2.0), ("ssprk3", 3.0), ("rk4", 4.0), ("bs23", 3.0), ("dopri5", 5.0)]
)
def test_explicit_methods_have_their_order_on_a_braked_mass(method: str, order: float) -> None:
    errors = []
    for dt in (0.2, 0.1, 0.05):
        run = simulate(braked(0.4, 2.0), method, dt=dt, t_end=5.0, error=False)
        errors.append(np.abs(run["v_x"] - free_velocity(run.t, 0.4, 2.0)).max())
    assert math.log2(errors[1] / errors[2]) == pytest.approx(order, abs=0.7)


@pytest.mark.parametrize("number", [1, 2])
@pytest.mark.parametrize("law", PLATES)
def test_explicit_methods_take_plates_on_dashpots(law: str, number: int) -> None:
    problem = system(number, *PLATES[law])
    expected = simulate(problem, "event-driven", dt=0.04, t_end=3.0, error=False)
    located = simulate(problem, "dopri5", dt=0.04, t_end=3.0, rtol=1e-9, error=False)
    np.testing.assert_allclose(located["x"], expected["x"], atol=5e-7)
    assert [each.kind for each in located.events] == [each.kind for each in expected.events]
    np.testing.assert_allclose([e.t for e in located.events], [e.t for e in expected.events], atol=2e-5)
    for method in EXPLICIT:
        errors = []
        for dt in (0.01, 0.0025):
            run = simulate(problem, method, dt=dt, t_end=3.0, error=False)
            errors.append(np.abs(run["x"][:: round(0.04 / dt)] - expected["x"]).max())
        assert errors[1] < 3e-4
        assert errors[1] < 0.5 * errors[0]


@pytest.mark.parametrize("dt", [0.04, 0.01])
def test_a_plate_on_a_non_linear_dashpot_alone_is_judged_beside_a_strong_linear_one(dt: float) -> None:
    light = [Mass("y", m=1.0), Dashpot("x", "y", c=5e3), Spring("x", "y", k=K)]
    scheme = Scheme(
        Mass("x", m=M), Load("x", f=M * G), *light, Bumper("y", "z"), Spring("z", "ground", k=K_O), BLOW_OFF
    )
    problem = Problem("strong", scheme, v0={"x": V_O, "y": V_O})
    expected = simulate(problem, "event-driven", dt=0.04, t_end=0.4, ode_solver="Radau", error=False)["x"][-1]
    assert simulate(problem, dt=dt, t_end=0.4, error=False)["x"][-1] == pytest.approx(expected, abs=0.02)


@pytest.mark.parametrize("method", ["rk4", "dopri5"])
@pytest.mark.parametrize("n", [0.5, 0.75])
def test_explicit_methods_follow_the_cases_of_system_2_with_a_root(n: float, method: str) -> None:
    c = 2476.0 / V_O**n
    expected = system_2_by_cases(lambda p: math.copysign((abs(p) / c) ** (1.0 / n), p), 0.6)
    run = simulate(system(2, NonlinearDashpot("z", "ground", c=c, n=n)), method, dt=1e-3, t_end=0.6, error=False)
    np.testing.assert_allclose([run["x"][-1], run["v_x"][-1], run["z"][-1]], expected, rtol=1e-5)


def test_explicit_methods_solve_dashpots_that_move_each_other_together() -> None:
    falling = [Mass("a", m=1.0), Load("a", 9.81), Bumper("a", "p")]
    plates = [
        Spring("p", "r", k=300.0),
        Dashpot("p", "r", c=5.0),
        Spring("r", "ground", k=500.0),
        Dashpot("r", "ground", c=10.0),
    ]
    powers = [NonlinearDashpot("p", "r", c=5.0, n=2.0), NonlinearDashpot("r", "ground", c=5.0, n=1.5)]
    drag = Load("a", lambda t, q, v: -0.3 * v * np.sqrt(v**2 + 1e-12))
    for others in ([], [drag]):
        problem = Problem("series", Scheme(*falling, *plates, *powers, *others), v0={"a": 2.0})
        expected = simulate(problem, "event-driven", dt=0.05, t_end=1.5, error=False)
        found = simulate(problem, "dopri5", dt=0.05, t_end=1.5, rtol=1e-9, error=False)
        np.testing.assert_allclose(found["a"], expected["a"], atol=1e-8)
        np.testing.assert_allclose(found["R"][1:], expected["R"][1:], atol=1e-5)


@pytest.mark.parametrize("method", EXPLICIT)
@pytest.mark.parametrize("c", [1e2, 1e4, 1e6])
@pytest.mark.parametrize("n", [1.5, 2.0])
def test_explicit_methods_refuse_what_their_steps_do_not_resolve_or_say_how_far_off_they_are(
    method: str, c: float, n: float
) -> None:
    problem = braked(c, n)
    run = simulate(problem, method, dt=0.01, t_end=1.0, throw=False)
    if not run.success:
        assert "smaller dt" in run.message
        return
    way = simulate(problem, "event-driven", dt=0.01, t_end=1.0, error=False)["x"]
    assert np.abs(run["x"] - way).max() < 1.5 * run.error["x"] + 1e-9


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({}, "c is missing"),
        ({"c": 1.0}, "n is missing"),
        ({"c": -1.0, "n": 1.0}, "c = -1.0 must be"),
        ({"c": 1.0, "n": 0.0}, "n = 0.0 must be"),
        ({"law": "cubic", "c": 1.0, "n": 1.0}, "cubic"),
        ({"law": "compression", "c": 1.0, "n": 1.0, "c_extension": 2.0}, "c_extension is of the law 'power'"),
        ({"c": 1.0, "n": 1.0, "rates": [0.0, 1.0]}, "rates and forces are of the law 'table'"),
        ({"law": "table", "rates": [0.0, 1.0], "forces": [0.0, 1.0], "c": 1.0}, "c belongs to a power"),
        ({"law": "table", "rates": [0.0], "forces": [0.0]}, "two points or more"),
        ({"law": "table", "rates": [0.0, 1.0], "forces": [0.0]}, "2 rates and 1 forces"),
        ({"law": "table", "rates": [1.0, 0.0], "forces": [0.0, 1.0]}, "sort the points"),
        ({"law": "table", "rates": [0.0, 1.0, 2.0], "forces": [0.0, 2.0, 1.0]}, "falls from 2 to 1 N"),
        ({"law": "table", "rates": [-1.0, 1.0], "forces": [-1.0, 3.0]}, "at rest is 1 N"),
        ({"law": "table", "rates": [0.0, math.nan], "forces": [0.0, 1.0]}, "rates"),
    ],
)
def test_what_is_no_dashpot_is_refused(given, message: str) -> None:
    with pytest.raises(li.InputError, match=message):
        NonlinearDashpot("x", "ground", **given)


def test_scheme_files_hold_every_law(tmp_path) -> None:
    dampers = [
        NonlinearDashpot("x", "ground", c=2.0, n=0.5, c_extension=3.0),
        NonlinearDashpot("x", "ground", law="extension", c=2.0, n=1.5),
        NonlinearDashpot("x", "ground", law="table", rates=[-1.0, 0.0, 2.0], forces=[-3.0, 0.0, 1.0]),
    ]
    problem = Problem("file", Scheme(Mass("x", m=1.0), *dampers), v0={"x": 1.0})
    path = li.write_scheme_file(problem, tmp_path / "file.toml")
    assert li.read_scheme_file(path).problem.scheme == problem.scheme


def test_turning_points_of_a_root_keep_their_order() -> None:
    damper = NonlinearDashpot("x", "ground", c=0.5, n=0.5)
    problem = Problem("swing", Scheme(Mass("x", m=1.0), Spring("x", "ground", k=100.0), damper), q0={"x": 1.0})
    instant = []
    for dt in (2e-3, 1e-3, 5e-4):
        run = simulate(problem, dt=dt, t_end=3.0, error=False)
        instant.append(run["x"][-1])

    def rate(t, y):
        return [y[1], -100.0 * y[0] - 0.5 * np.sign(y[1]) * math.sqrt(abs(y[1]))]

    expected = solve_ivp(rate, (0.0, 3.0), [1.0, 0.0], "Radau", rtol=1e-10, atol=1e-12, max_step=1e-3).y[0, -1]
    errors = np.abs(np.array(instant) - expected)
    assert errors[0] / errors[2] > 8.0


@pytest.mark.parametrize("dt", [0.1, 0.01])
def test_a_general_force_beside_a_dashpot_that_stops_a_body_within_a_step_keeps_the_balances(dt: float) -> None:
    drag = Load("z", lambda t, q, v: -5.0 * v * np.sqrt(v**2 + 1e-12))
    plate = [Mass("z", m=1.0), Spring("z", "ground", k=K_O), Dashpot("z", "ground", c=250.0), drag]
    scheme = Scheme(Mass("x", m=M), Load("x", f=M * G), Bumper("x", "z", e=0.0), *plate)
    assert simulate(Problem("drag", scheme, v0={"x": V_O}), dt=dt, t_end=1.0, error=False).success
