"""Compliant stops and penalised problems: against closed forms, hand-written integration, and the rigid motion."""

from __future__ import annotations

import dataclasses
import math
import pickle
from decimal import Decimal, localcontext
from functools import cache

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import lambertw

import lcpimpact as li
from lcpimpact import (
    Bar,
    Bumper,
    Dashpot,
    Harmonic,
    HertzSpring,
    HuntCrossley,
    KelvinVoigt,
    KelvinVoigtStop,
    Load,
    Mass,
    PrescribedMotion,
    Problem,
    Rope,
    Scheme,
    Slider,
    Spring,
    convergence,
    load_problem,
    penalized,
    simulate,
)
from lcpimpact.integrators import METHODS
from lcpimpact.problems.penalty import damping_ratio, loss_number
from lcpimpact.scheme.elements.base import Compound, Element
from lcpimpact.scheme.structure import Feature
from lcpimpact.scheme.terms import Row as Contact

SMOOTH = [name for name, kind in METHODS.items() if Feature.POWER_LAWS in kind.declared.handles]
"""The methods that run compliant laws."""

COUNTS = (307, 487, 773, 1229, 1951, 3089)


def slope(x, errors):
    return np.polyfit(np.log(x), np.log(errors), 1)[0]


def restitution(ζ):
    """e of a stop that does not pull, ζ = c/(2 sqrt(k m)), from the literature's formula."""
    if ζ < 1.0:
        return math.exp(-2.0 * ζ * math.acos(ζ) / math.sqrt(1.0 - ζ**2))
    return math.exp(-2.0 * ζ * math.acosh(ζ) / math.sqrt(ζ**2 - 1.0))


def bounces(k, c, m, weight, gap, x, v, times):
    """A mass over a Kelvin-Voigt stop: free flight and contact one after the other, each ended by an event of DOP853."""

    def free(t, s):
        return [s[1], weight / m]

    def contact(t, s):
        return [s[1], (weight - k * (s[0] - gap) - c * s[1]) / m]

    def touches(t, s):
        return s[0] - gap

    def leaves(t, s):
        return k * (s[0] - gap) + c * s[1]

    touches.terminal, touches.direction = True, 1.0
    leaves.terminal, leaves.direction = True, -1.0
    t, state, found, touching = 0.0, [x, v], [], x >= gap and v > 0.0
    while t < times[-1]:
        run = solve_ivp(
            contact if touching else free, (t, times[-1]), state, "DOP853", dense_output=True, rtol=1e-12, atol=1e-14,
            events=leaves if touching else touches, max_step=0.05 if touching else 0.2,
        )  # fmt: skip
        here = times[(times >= t) & (times <= run.t[-1])]
        found.append(run.sol(here) if len(here) else np.empty((2, 0)))
        t, state, touching = run.t[-1], run.y[:, -1], not touching
    return np.hstack(found)


def ball_on_stop(k=4e3, c=20.0):
    elements = (Mass("x", 2.0), Load("x", 20.0), KelvinVoigtStop("x", "ground", k, c, gap=0.5))
    return Problem("ball on a stop", Scheme(*elements), v0={"x": 1.0}, t_end=2.0)


# ---- the element ----------------------------------------------------------------------------------------------------


def test_the_force_of_the_stop_its_energy_and_its_loss():
    stop = KelvinVoigtStop("x", "y", k=8.0, c=3.0, gap=0.5)
    d = Scheme(Mass("x", 1.0), Mass("y", 1.0), stop).assemble()

    def at(x, y, vx, vy):
        q, v = np.array([x, y]), np.array([vx, vy])
        force = d.spring_force(q, v)
        assert force[1] == -force[0]
        return -force[0], float(d.elastic_energy(q)), float(d.spring_losses(q, v).sum())

    # Overlapping by 1.5 and approaching at 2; leaving slowly; leaving faster than the spring follows; apart.
    assert at(2.0, 0.0, 3.0, 1.0) == (8.0 * 1.5 + 3.0 * 2.0, 9.0, 12.0)
    assert at(2.0, 0.0, -2.0, 1.0) == (8.0 * 1.5 - 3.0 * 3.0, 9.0, 27.0)
    assert at(2.0, 0.0, -6.0, 1.0) == (0.0, 9.0, 12.0 * 7.0)
    assert at(0.4, 0.0, 9.0, 0.0) == (0.0, 0.0, 0.0)
    many = d.push(np.array([[2.0, 0.0], [0.4, 0.0]]), np.array([[3.0, 1.0], [9.0, 0.0]]))
    np.testing.assert_array_equal(many, [[18.0], [0.0]])


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"k": None}, "k is missing"),
        ({"c": None}, "c is missing; give a number in N s/m, 0 for a stop without loss"),
        ({"k": 0.0}, "k = 0.0 must be a positive"),
        ({"c": -1.0}, "c = -1.0 must be a finite number in N s/m, at least 0"),
        ({"c": math.inf}, "c = inf must"),
        ({"gap": "0"}, "gap = '0' must be a finite number in m"),
        ({"lower": "x"}, "both ends are one node"),
    ],
)
def test_constants_of_the_stop_are_refused_by_name(changed, says):
    constants = {"upper": "x", "lower": "ground", "k": 1.0, "c": 1.0} | changed
    with pytest.raises(li.InputError, match=says):
        KelvinVoigtStop(**constants)


@pytest.mark.parametrize("method", [m for m in ("moreau-jean", "moreau-midpoint", "event-driven") if m in METHODS])
@pytest.mark.parametrize("ζ", [0.05, 0.2, 0.8, 2.5])
def test_restitution_and_contact_time_are_those_of_the_closed_form(method, ζ):
    """After the contact x = x_open - e v0 (t - t_1 - t_c), x_open = c e v0/k where the force has fallen to zero."""
    m, k, v0, gap = 1.5, 600.0, 3.0, 0.3
    ω = math.sqrt(k / m)
    c, e = 2.0 * ζ * math.sqrt(k * m), restitution(ζ)
    φ = math.acos(ζ) / math.sqrt(1.0 - ζ**2) if ζ < 1.0 else math.acosh(ζ) / math.sqrt(ζ**2 - 1.0)
    case = Problem("kv", Scheme(Mass("x", m), KelvinVoigtStop("x", "ground", k, c, gap)), v0={"x": v0})
    run = simulate(case, method, dt=1.0 / 16_127, t_end=1.0)
    assert run["v_x"][-1] == pytest.approx(-e * v0, rel=2e-5)
    x = gap + c * e * v0 / k - e * v0 * (1.0 - gap / v0 - 2.0 * φ / ω)
    assert run["x"][-1] == pytest.approx(x, abs=2e-6)


@pytest.mark.parametrize("θ", [0.5, 0.7, 1.0])
def test_a_step_solves_the_law_that_is_written_down(θ):
    """The θ-step of one mass on the stop as a scalar equation, solved by bisection: F falls with w, so there is one root."""
    case, h, m, k, c, gap = ball_on_stop(), 2e-3, 2.0, 4e3, 20.0, 0.5
    run = simulate(case, dt=h, t_end=2.0, theta=θ)
    x, v = 0.0, 1.0
    for i in range(1000):

        def unbalanced(w, x=x, v=v):
            δ = x + θ * h * w - gap
            before, after = max(δ - 0.5 * h * w, 0.0), max(δ + 0.5 * h * w, 0.0)
            force = max(0.0, k * max(δ, 0.0) + c * (after - before) / h)
            return m * (w - v) - θ * h * (20.0 - force)

        w = brentq(unbalanced, -50.0, 50.0, xtol=1e-15)
        x, v = x + h * w, v + (w - v) / θ
        assert run["x"][i + 1] == pytest.approx(x, abs=1e-10)
        x, v = run["x"][i + 1], run["v_x"][i + 1]


@pytest.mark.parametrize("method", ["moreau-jean", "moreau-midpoint"])
def test_the_jump_of_the_force_costs_no_order(method):
    case = ball_on_stop()
    runs = [simulate(case, method, dt=2.0 / steps, t_end=2.0) for steps in COUNTS]
    times = np.unique(np.concatenate([run.t for run in runs]))
    x = bounces(4e3, 20.0, 2.0, 20.0, 0.5, 0.0, 1.0, times)[0]
    errors = [np.abs(run["x"] - x[np.searchsorted(times, run.t)]).max() for run in runs]
    assert slope(2.0 / np.array(COUNTS), errors) > 1.65
    assert errors[-1] < 3e-4


def random_chain(seed):
    """Up to four masses between which stiff stops, springs, Hertzian contacts and bumpers act, many of them overlapping."""
    rng = np.random.default_rng(seed)
    names = [f"m{j}" for j in range(rng.integers(1, 5))]
    elements: list[Element] = []
    for name in names:
        elements += [Mass(name, 10.0 ** rng.uniform(-2, 2)), Load(name, float(rng.uniform(-50, 50)))]
    for j, upper in enumerate(names):
        for lower in [*names[j + 1 :], "ground"]:
            kind = rng.random()
            if kind < 0.6:
                k, c = 10.0 ** rng.uniform(2, 9), 10.0 ** rng.uniform(-2, 6)
                elements.append(KelvinVoigtStop(upper, lower, k, c, float(rng.uniform(-0.5, 1.0))))
            elif kind < 0.75:
                elements.append(HertzSpring(upper, lower, 10.0 ** rng.uniform(2, 6)))
            elif kind < 0.9:
                elements.append(Spring(upper, lower, 10.0 ** rng.uniform(1, 4)))
            elif kind < 0.95:
                elements.append(Bumper(upper, lower, 2.0 + rng.random(), 0.5, f"R{upper}{lower}"))
    q0 = {name: float(rng.uniform(-1, 1)) for name in names}
    return Problem("chain", Scheme(*elements), q0, {name: float(rng.uniform(-5, 5)) for name in names})


@pytest.mark.parametrize("θ", [0.5, 0.7, 1.0])
def test_every_step_has_a_solution_and_newton_finds_it(θ):
    """Steps far too long for such stiff laws: without the search along the way one run in six would end with NEWTON."""
    for seed in range(60):
        run = simulate(random_chain(seed), dt=1e-3, t_end=0.1, theta=θ, throw=False)
        # Steps as long as that may make energy, which their certificate says.
        assert run.status in (li.Status.SOLVED, li.Status.VIOLATED), (seed, run.message)
        assert np.isfinite(run.q).all()


def test_a_force_that_passes_zero_does_not_stop_newton():
    """Pulled apart at 1/b the force of Hunt and Crossley is zero but for the rounding of 1 - 1, which no step can beat."""
    law = HuntCrossley("y", "ground", 50.0, 0.5, 2.0)
    scheme = Scheme(
        Mass("x", 1.0), Mass("y", 0.5), Spring("x", "y", 49.0), law, Load("x", Harmonic(16.073307876010453, 5.0))
    )
    case = Problem("chain", scheme, q0={"y": -0.1, "x": -0.1}, v0={"x": 1.0, "y": 1.0})
    assert simulate(case, dt=1.25e-4, t_end=1.0).success


def test_the_balance_of_energy_counts_the_loss_of_the_stop():
    case = ball_on_stop(c=60.0)
    coarse, fine = (simulate(case, dt=dt, t_end=2.0).certificate for dt in (1e-3, 1e-4))
    lost = 2.0 * 10.0 * 0.5 + 0.5 * 2.0  # what the ball had over its place of rest, to within 0.005 m of it
    run = simulate(case, dt=1e-4, t_end=2.0)
    assert case.dynamics.energy(run.q[-1], run.v[-1]) < 0.02 * lost + 20.0 * 0.006
    assert fine.energy_balance < 1e-3 * lost
    assert coarse.energy_balance > 5.0 * fine.energy_balance


def test_a_shaker_works_through_the_stop():
    scheme = Scheme(
        PrescribedMotion("b", Harmonic(0.05, 10.0)),
        Mass("x", 1.0),
        KelvinVoigtStop("x", "b", 1e3, 10.0),
        Load("x", 9.81),
    )
    case = Problem("shaker", scheme)
    coarse, fine = (simulate(case, dt=dt, t_end=2.0) for dt in (1e-3, 1e-4))
    assert coarse.certificate.energy_balance < 1e-4 * coarse.certificate.energy_scale
    assert fine.certificate.energy_balance < 1e-5 * fine.certificate.energy_scale

    def rate(t, s):
        x, v = s
        δ, dδ = x - 0.05 * math.cos(10.0 * t), v + 0.5 * math.sin(10.0 * t)
        return [v, 9.81 - (max(0.0, 1e3 * δ + 10.0 * dδ) if δ > 0.0 else 0.0)]

    other = solve_ivp(rate, (0.0, 2.0), [0.0, 0.0], "DOP853", fine.t[::200], rtol=1e-10, atol=1e-12, max_step=1e-3)
    np.testing.assert_allclose(fine["x"][::200], other.y[0], rtol=0.0, atol=1e-5)


def test_stops_bumpers_and_sliders_stand_side_by_side():
    """A body with dry friction that falls on a stop, under which a plate on a Kelvin-Voigt block stops it for good."""
    scheme = Scheme(
        Mass("x", 1.0), Load("x", 9.81), Slider("x", "ground", 2.0), KelvinVoigtStop("x", "ground", 500.0, 5.0, 0.1),
        Bumper("x", "z", gap=0.15), KelvinVoigt("z", "ground", 4e3, 30.0),
    )  # fmt: skip
    case = Problem("all", scheme, v0={"x": 1.0})
    run = simulate(case, dt=2e-5, t_end=0.25)

    def rate(t, s):
        x, v, z = s
        # The plate moves with the body while that presses, and creeps home else; the body does not turn before t_end.
        touching = x - 0.15 >= z
        force = max(0.0, 4e3 * z + 30.0 * v) if touching else 0.0
        stop = max(0.0, 500.0 * (x - 0.1) + 5.0 * v) if x > 0.1 else 0.0
        return [
            v,
            9.81 - 2.0 * math.copysign(1.0, v) - stop - force,
            v if touching and force > 0.0 else -4e3 / 30.0 * z,
        ]

    other = solve_ivp(rate, (0.0, 0.25), [0.0, 1.0, 0.0], "RK45", run.t[::500], rtol=1e-9, atol=1e-11, max_step=2e-5)
    assert (run["R"] > 0.0).any()
    np.testing.assert_allclose(run["x"][::500], other.y[0], rtol=0.0, atol=2e-4)


# ---- what c and b belong to e ----------------------------------------------------------------------------------------


@given(e=st.floats(1e-6, 1.0))
def test_the_damping_ratio_is_that_of_e(e):
    assert restitution(min(damping_ratio(e), 0.999999)) == pytest.approx(e, rel=1e-9) or damping_ratio(e) > 0.999999
    if damping_ratio(e) > 1.000001:
        assert restitution(damping_ratio(e)) == pytest.approx(e, rel=1e-9)
    assert (damping_ratio(e) == 0.0) == (e == 1.0)


@given(e=st.floats(1e-6, 0.999))
def test_the_loss_number_is_that_of_e(e):
    """e = (1 + W_0(-(1 + a) exp(-(1 + a))))/a, Lambert's function as in the literature."""
    a = loss_number(e)
    assert float(1.0 + lambertw(-(1.0 + a) * math.exp(-(1.0 + a))).real) / a == pytest.approx(e, rel=1e-9)


def test_the_loss_number_near_no_loss_has_no_cancellation():
    """In sixty digits the equation changes its sign within a part in 1e11 of the a that is returned."""
    for tiny in (1e-2, 1e-3, 1e-4):
        e = Decimal(1.0 - tiny)
        with localcontext() as context:
            context.prec = 60
            a = Decimal(loss_number(1.0 - tiny))
            low, high = (
                x - (1 + x).ln() + e * x + (1 - e * x).ln()
                for x in (a * (1 - Decimal("1e-11")), a * (1 + Decimal("1e-11")))
            )
        assert low * high < 0
    for tiny in (1e-5, 1e-8, 1e-12):
        assert loss_number(1.0 - tiny) == pytest.approx(1.5 * (1.0 - (1.0 - tiny)), rel=20.0 * tiny)
    assert loss_number(1.0) == 0.0


@pytest.mark.parametrize("e", [0.3, 0.8])
def test_hunt_crossley_returns_with_e_at_the_speed_that_is_given(e):
    soft = penalized(load_problem("oscillator-stop", e=e), "hunt-crossley", k=1e9, v0=2.5)
    law = next(each for each in soft.scheme.elements if isinstance(each, HuntCrossley))
    m = next(each.m for each in soft.scheme.elements if isinstance(each, Mass))

    def back(t, s):
        return s[0]

    back.terminal, back.direction = True, -1.0
    for v0, same in ((2.5, True), (5.0, False)):
        run = solve_ivp(
            lambda t, s: [s[1], -law.K * max(s[0], 0.0) ** 1.5 * (1.0 + law.b * s[1]) / m], (0.0, 1.0), [0.0, v0],
            "DOP853", rtol=1e-11, atol=1e-16, events=back, first_step=1e-9,
        )  # fmt: skip
        assert (abs(-run.y[1, -1] / v0 - e) < 1e-7) == same


# ---- penalized ------------------------------------------------------------------------------------------------------


def test_what_a_penalised_problem_keeps_and_what_it_leaves_out():
    rigid = load_problem("bouncing-ball", e=0.7, m=2.0)
    soft = penalized(rigid, "kelvin-voigt", k=5e4)
    assert soft.name == "bouncing-ball (kelvin-voigt)"
    assert (soft.q0, soft.v0, soft.t_end, soft.parameters, soft.source) == (
        rigid.q0, rigid.v0, rigid.t_end, rigid.parameters, rigid.source,
    )  # fmt: skip
    assert soft.facts == ()
    assert soft.motion is None
    assert rigid.facts
    mass, load, stop = soft.scheme.elements
    assert (mass, load) == rigid.scheme.elements[:2]
    assert (stop.upper, stop.lower, stop.k, stop.gap) == ("x", "ground", 5e4, 1.0)
    assert restitution(stop.c / (2.0 * math.sqrt(5e4 * 2.0))) == pytest.approx(0.7, rel=1e-12)
    assert soft.dynamics.contacts == ()


def test_the_effective_mass_is_that_of_both_sides():
    m1, m2, k, e = 2.0, 3.0, 1e4, 0.6
    scheme = Scheme(
        Mass("a", m1), Mass("b", m2), Bumper("a", "b", gap=1.0, e=e), PrescribedMotion("p", Harmonic(0.05, 10.0)),
        Bumper("b", "p", e=e, name="S"),
    )  # fmt: skip
    _, _, between, _, on_plate = penalized(Problem("two", scheme), "kelvin-voigt", k=k).scheme.elements
    ζ = brentq(lambda ζ: restitution(ζ) - e, 1e-9, 0.9, xtol=1e-14)
    assert between.c == pytest.approx(2.0 * ζ * math.sqrt(k * m1 * m2 / (m1 + m2)), rel=1e-9)
    assert on_plate.c == pytest.approx(2.0 * ζ * math.sqrt(k * m2), rel=1e-9)


def test_the_effective_mass_of_a_bar_counts_its_whole_mass_matrix():
    bar = Bar("a", "b", E=900.0, A=1.0, rho=1.0, L=10.0, elements=4, mass="consistent")
    rigid = Problem("bar", Scheme(bar, Bumper("b", "ground", gap=5.0, e=0.5)))
    stop = penalized(rigid, "kelvin-voigt", k=1e4).scheme.elements[-1]
    h = rigid.dynamics.H[0]
    m_eff = 1.0 / (h @ np.linalg.inv(rigid.dynamics.M) @ h)
    assert m_eff < 0.9 * rigid.dynamics.M[-1, -1]
    assert restitution(stop.c / (2.0 * math.sqrt(1e4 * m_eff))) == pytest.approx(0.5, rel=1e-9)


@pytest.mark.parametrize("name", ["system-1", "system-2", "system-3", "bouncing-bar"])
def test_where_a_plate_has_no_mass_there_is_no_loss_unless_it_is_given(name):
    stops = [
        each
        for each in penalized(load_problem(name), "kelvin-voigt", k=1e6).scheme.elements
        if isinstance(each, KelvinVoigtStop)
    ]
    assert stops
    assert all(each.c == 0.0 for each in stops)
    hertzian = penalized(load_problem(name), "hunt-crossley", k=1e6).scheme.elements
    assert any(isinstance(each, HertzSpring) for each in hertzian)
    given_ = penalized(load_problem(name), "kelvin-voigt", k=1e6, c=7.0).scheme.elements
    assert all(each.c == 7.0 for each in given_ if isinstance(each, KelvinVoigtStop))


def test_constants_that_are_given_come_before_those_of_e():
    ball = load_problem("bouncing-ball", e=0.5)
    assert penalized(ball, "kelvin-voigt", k=1e4, c=3.0).scheme.elements[-1] == KelvinVoigtStop(
        "x", "ground", 1e4, 3.0, 1.0, "R"
    )
    assert penalized(ball, "kelvin-voigt", k=1e4, e=1.0).scheme.elements[-1].c == 0.0
    assert penalized(ball, "hertz", k=1e4, e=1.0).scheme.elements[-1] == HertzSpring("x", "ground", 1e4, 1.5, 1.0, "R")
    assert penalized(ball, "hertz", k=1e4, e=1.0, n=2.0).scheme.elements[-1].n == 2.0
    law = penalized(ball, "hunt-crossley", k=1e4, b=0.2, n=1.25).scheme.elements[-1]
    assert law == HuntCrossley("x", "ground", 1e4, 0.2, 1.25, 1.0, "R")
    assert penalized(ball, "hunt-crossley", k=1e4, b=0.0).scheme.elements[-1] == HertzSpring(
        "x", "ground", 1e4, 1.5, 1.0, "R"
    )
    assert penalized(ball, "hunt-crossley", k=1e4, e=0.5, v0=2.0).scheme.elements[-1].b == pytest.approx(
        loss_number(0.5) / 2.0
    )


def test_a_rope_gives_way_too_and_nodes_keep_their_order():
    """A body hung by a rope is one that falls on a stop: the law pulls where the bumper's would push."""
    hung = Problem(
        "hung",
        Scheme(
            Rope("a", "x", slack=1.0, e=0.5),
            Mass("a", 2.0),
            Spring("a", "ground", 50.0),
            Mass("x", 1.0),
            Load("x", 9.81),
        ),
    )
    soft = penalized(hung, "kelvin-voigt", k=1e5)
    assert soft.dynamics.nodes == hung.dynamics.nodes == ("a", "x")
    run = simulate(soft, dt=1e-4, t_end=1.0)

    def rate(t, s):
        a, x, da, dx = s
        δ, dδ = x - a - 1.0, dx - da
        c = next(each.c for each in soft.scheme.elements if isinstance(each, KelvinVoigtStop))
        T = max(0.0, 1e5 * δ + c * dδ) if δ > 0.0 else 0.0
        return [da, dx, (T - 50.0 * a) / 2.0, 9.81 - T]

    other = solve_ivp(
        rate, (0.0, 1.0), [0.0, 0.0, 0.0, 0.0], "DOP853", run.t[::100], rtol=1e-10, atol=1e-12, max_step=1e-4
    )
    np.testing.assert_allclose(run.q[::100], other.y[:2].T, rtol=0.0, atol=1e-4)
    assert run["a"].max() > 0.1


@dataclasses.dataclass(frozen=True)
class Cradle(Compound):
    """A mass between two stops, one element of a user's own."""

    upper: str
    lower: str

    @property
    def nodes(self):
        return (self.upper, "inside", self.lower)

    def parts(self):
        return (
            Mass("inside", 2.0),
            Bumper("inside", self.lower, 0.5, 0.5, "B1"),
            Dashpot(self.upper, "inside", 3.0),
            Bumper(self.upper, "inside", 0.5, 0.5, "B2"),
        )


@dataclasses.dataclass(frozen=True)
class Hook(Element):
    """An element that makes a unilateral row by itself."""

    node: str

    @property
    def nodes(self):
        return (self.node,)

    def contribute(self, terms):
        terms.rows.append(Contact("Hook", "R", self.node, "ground", 1.0, 0.0))


def test_bumpers_inside_a_compound_are_replaced_and_others_are_refused():
    soft = penalized(Problem("cradle", Scheme(Mass("x", 1.0), Cradle("x", "ground"))), "kelvin-voigt", k=1e4)
    kinds = [type(each).__name__ for each in soft.scheme.elements]
    assert kinds == ["Mass", "Mass", "KelvinVoigtStop", "Dashpot", "KelvinVoigtStop"]
    assert soft.dynamics.nodes == ("x", "inside")
    with pytest.raises(li.UnsupportedError, match=r"Hook at 'x' makes a unilateral row by itself"):
        penalized(Problem("hook", Scheme(Mass("x", 1.0), Hook("x"))), "kelvin-voigt", k=1e4)


BALL = {"problem": load_problem("bouncing-ball", e=0.5), "law": "kelvin-voigt", "k": 1e4}


@pytest.mark.parametrize(
    ("changed", "error", "says"),
    [
        ({"law": "kelvin"}, li.InputError, "unknown law 'kelvin': did you mean 'kelvin-voigt'"),
        ({"k": 0.0}, li.InputError, "k = 0 must be above zero"),
        ({"k": "1"}, li.InputError, "k = '1' must be a finite number"),
        ({"k": None}, li.InputError, "k is missing"),
        ({"c": -1.0}, li.InputError, "c = -1 must not be below zero"),
        ({"c": 1.0, "e": 0.5}, li.InputError, "c and e both determine the loss"),
        ({"b": 1.0}, li.InputError, "the law 'kelvin-voigt' has no b"),
        ({"v0": 1.0}, li.InputError, "the law 'kelvin-voigt' has no v0"),
        ({"e": 1.5}, li.InputError, "e = 1.5 must lie between 0 and 1"),
        ({"e": 0.0}, li.InputError, "bumper 'R' has e = 0, which no finite c reaches: give c="),
        ({"law": "hertz"}, li.InputError, "e = 0.5, and Hertz's law is conservative: take law='hunt-crossley'"),
        ({"law": "hertz", "n": 0.5}, li.InputError, "n = 0.5 must be at least 1"),
        ({"law": "hunt-crossley"}, li.InputError, "at one speed: give v0="),
        ({"law": "hunt-crossley", "v0": 0.0}, li.InputError, "v0 = 0 must be above zero"),
        ({"law": "hunt-crossley", "e": 0.0, "v0": 1.0}, li.InputError, "no finite b reaches"),
        ({"problem": load_problem("diode-bridge")}, li.UnsupportedError, "'diode-bridge' is given by its matrices"),
        ({"problem": load_problem("hertz-impact")}, li.InputError, "'hertz-impact' has no bumper"),
    ],
)
def test_what_cannot_be_penalised_is_refused_by_name(changed, error, says):
    given_ = BALL | changed
    with pytest.raises(error) as caught:
        penalized(given_.pop("problem"), given_.pop("law"), **given_)
    assert says in str(caught.value)


# ---- penalised problems by every method, and the rigid limit ----------------------------------------------------------


@cache
def two_balls_over_a_compliant_ground(law):
    """The penalised problem, and its motion by DOP853 with the law written out by hand."""
    constants = {"k": 2e4} if law == "kelvin-voigt" else {"k": 2e5, "v0": 4.0}
    soft = penalized(load_problem("two-balls-spring"), law, **constants)
    d = soft.dynamics
    (spring,) = d.springs
    C, K, M, row, f = d.C, d.K, d.M, d.directions[0], d.force(0.0)

    def rate(t, s):
        q, v = s[:2], s[2:]
        δ, dδ = -(row @ q + spring.gap), -(row @ v)
        F = 0.0
        if δ > 0.0:
            F = max(0.0, spring.K * δ + spring.c * dδ) if spring.c else spring.K * δ**1.5 * (1.0 + spring.b * dδ)
        return np.concatenate([v, np.linalg.solve(M, f - K @ q - C @ v + F * row)])

    start = np.concatenate([soft.initial_coordinates, soft.initial_velocities])
    times = np.linspace(0.0, 0.5, 26)
    run = solve_ivp(rate, (0.0, 0.5), start, "DOP853", times, rtol=1e-10, atol=1e-12, max_step=5e-4)
    return soft, times, run.y[:2].T


@pytest.mark.parametrize("law", ["kelvin-voigt", "hunt-crossley"])
@pytest.mark.parametrize("method", SMOOTH)
def test_every_method_that_runs_compliant_laws_agrees_with_scipy(method, law):
    soft, times, q = two_balls_over_a_compliant_ground(law)
    run = simulate(soft, method, dt=5e-5, t_end=0.5)
    np.testing.assert_allclose(run.sample(times).q, q, rtol=0.0, atol=2e-4)
    assert soft.dynamics.approach(run.q).max() > 5e-3


def test_the_rigid_motion_is_reached_as_one_over_the_root_of_k():
    """Three bounces of a ball: contact time and depth go as k^-1/2, and so does what they leave over."""
    rigid, end = load_problem("bouncing-ball", e=0.8), 1.9
    stiffness, errors, thirds = 10.0 ** np.arange(4, 10), [], []
    for k in stiffness:
        stop = penalized(rigid, "kelvin-voigt", k=k).scheme.elements[-1]
        t = np.linspace(0.0, end, 2001)
        x = bounces(k, stop.c, 1.0, 9.81, 1.0, 0.0, 0.0, t)[0] if k > 1e7 else None
        if x is None:
            run = simulate(penalized(rigid, "kelvin-voigt", k=k), dt=end / round(end * 60.0 * math.sqrt(k)), t_end=end)
            t, x = run.t, run["x"]
        exact = rigid.motion(t)[0][:, 0]
        errors.append(np.abs(x - exact).max())
        if k <= 1e7:
            third = t[1:][(x[:-1] <= 1.0) & (x[1:] > 1.0)][2]
            thirds.append(third - math.sqrt(2.0 / 9.81) * (1.0 + 2.0 * 0.8 + 2.0 * 0.64))
    assert slope(stiffness, errors) == pytest.approx(-0.5, abs=0.02)
    assert errors[-1] < 1e-3
    # Two contacts have passed before the third touch, so it comes late by what they took.
    assert slope(stiffness[: len(thirds)], thirds) == pytest.approx(-0.5, abs=0.05)


@pytest.mark.parametrize(("name", "law", "power"), [
    ("system-1", "kelvin-voigt", -1.0), ("system-2", "kelvin-voigt", -1.0), ("system-3", "kelvin-voigt", -1.0),
    ("system-1", "hunt-crossley", -2.0 / 3.0), ("bouncing-ball", "hertz", -0.4),
])  # fmt: skip
def test_the_rigid_limit_of_the_other_laws_and_of_plates_without_mass(name, law, power):
    """Where r is a function the law is only a spring in series, δ = (r/k)^(1/n); impacts by Hertz's law last k^-2/5."""
    rigid = load_problem(name, **({"e": 1.0} if name == "bouncing-ball" else {}))
    end = 1.3 if name == "bouncing-ball" else 3.0
    truth = simulate(rigid, "exact", dt=end / 100, t_end=end)
    stiffness, errors = 10.0 ** (np.arange(5, 8) if law == "kelvin-voigt" else np.arange(6, 10)), []
    for k in stiffness:
        run = simulate(penalized(rigid, law, k=k), dt=end / 50_000, t_end=end)
        errors.append(np.abs(run.q - truth.sample(run.t).q).max())
    assert slope(stiffness, errors) == pytest.approx(power, abs=0.03)


def test_a_ball_at_rest_sinks_in_by_its_weight():
    soft = penalized(load_problem("bouncing-ball", e=0.3), "kelvin-voigt", k=1e4)
    run = simulate(soft, dt=1e-3, t_end=6.0)
    assert run["x"][-1] - 1.0 == pytest.approx(9.81 / 1e4, rel=1e-9)
    assert soft.dynamics.push(run.q[-1], run.v[-1])[0] == pytest.approx(9.81, rel=1e-9)


# ---- smooth against nonsmooth ---------------------------------------------------------------------------------------


def test_a_table_has_a_row_for_each_variant_method_and_step():
    rigid = load_problem("bouncing-ball", e=0.8)
    table = convergence(
        rigid,
        ["moreau-jean", "moreau-midpoint"],
        [1e-3, 1e-4],
        penalties=[("kelvin-voigt", 1e6), ("hertz", 1e8, {"e": 1.0})],
        norms=["sup_q", "l1_v", "penetration"],
        t_end=1.0,
    )
    assert list(table[["law", "k", "method"]].itertuples(index=False, name=None))[::2] == [
        (law, k, method)
        for law, k in (("rigid", math.inf), ("kelvin-voigt", 1e6), ("hertz", 1e8))
        for method in ("moreau-jean", "moreau-midpoint")
    ]
    assert list(table["steps"]) == [1009, 10007] * 6
    assert not any(table["failure"])
    assert (table["closings"] == 1).all(), "one impact before t = 1"
    coarse, fine, *_ = rows = list(table.itertuples())
    assert coarse.sup_q > 3.0 * fine.sup_q
    assert coarse.l1_v > 3.0 * fine.l1_v
    soft = rows[5]
    # The deepest place of a stop without weight, v0/ω exp(-ζ acos ζ/sqrt(1 - ζ²)) = v0/ω sqrt(e).
    assert soft.penetration == pytest.approx(math.sqrt(2.0 * 9.81 / 1e6 * 0.8), rel=4e-3)
    t = np.linspace(0.0, 1.0, soft.steps + 1)
    stop = penalized(rigid, "kelvin-voigt", k=1e6).scheme.elements[-1]
    x = bounces(1e6, stop.c, 1.0, 9.81, 1.0, 0.0, 0.0, t)[0]
    assert soft.sup_q == pytest.approx(np.abs(x - rigid.motion(t)[0][:, 0]).max(), rel=1e-3)
    assert (rows[0].lcp_solves, rows[0].newton_iterations, rows[0].evaluations) == (1009, 0, 1009)
    assert soft.lcp_solves == 0
    assert soft.newton_iterations >= 10_007
    assert soft.evaluations == soft.steps + soft.newton_iterations
    assert (table["seconds"] > 0.0).all()
    # The declared orders are those of the rigid motion, and of the model nothing is declared.
    assert list(table["declared"].dropna()) == [1.0] * 4


def test_what_fails_is_a_row_with_its_reason():
    rigid = load_problem("bouncing-ball", e=0.5)
    table = convergence(
        rigid,
        ["exact", "rk4-paper"],
        [0.03],
        penalties=[("hertz", 1e6), ("kelvin-voigt", 1e6)],
        norms=["sup_q"],
        t_end=1.0,
    )
    rows = list(table.itertuples())
    assert [bool(row.failure) for row in rows] == [False, True, True, True, True, True]
    assert rows[0].sup_q < 1e-12
    assert rows[0].dt == 1.0 / 37.0
    assert "rk4-paper does not handle relative degree 2" in rows[1].failure
    assert "Hertz's law is conservative" in rows[2].failure
    assert "exact does not handle non-linear springs" in rows[4].failure
    assert math.isnan(rows[4].sup_q)


@settings(max_examples=15)
@given(k=st.floats(1e3, 1e7), c=st.floats(0.0, 1e3), v=st.floats(0.1, 10.0), h=st.floats(1e-4, 0.05))
@example(k=7850773.0, c=584.0, v=1.0, h=0.046875)  # at rest, with velocities of less than the smallest normal number
def test_a_stop_never_gives_energy_at_any_step(k, c, v, h):
    """θ = 1 damps: a mass that meets a stop never leaves it faster than it came."""
    case = Problem("stop", Scheme(Mass("x", 1.0), KelvinVoigtStop("x", "ground", k, c, gap=0.05)), v0={"x": v})
    run = simulate(case, dt=h, t_end=100 * h, theta=1.0, throw=False)  # a coarse step may lose more than it declares
    assert run.status in (li.Status.SOLVED, li.Status.VIOLATED)
    E = case.dynamics.energy(run.q, run.v)
    assert E.max() <= E[0] * (1.0 + 1e-9)


def test_contacts_of_a_lagrangian_system_are_forces_by_hand():
    """A ball that is in the floor by δ: K δⁿ (1 + b δ') along the gap, and friction against the slip of its lowest point."""
    rigid = load_problem("ball-with-spin")
    K, n, b, v_s, δ = 1e5, 1.5, 0.3, 0.02, 1e-3
    R, μ = rigid.parameters["R"], rigid.dynamics.mu[1]
    d = penalized(rigid, "hunt-crossley", k=K, n=n, b=b, v_s=v_s).dynamics
    v = np.array([0.4, -2.0, 1.5])
    U = v[0] + R * v[2]
    f = K * δ**n * (1.0 + b * 2.0)
    T = -μ * f * U / math.hypot(U, v_s)
    assert d.motion_forces(0.0, np.array([0.2, R - δ, 0.7]), v) == pytest.approx([T, f, R * T], rel=1e-9)
    assert not d.motion_forces(0.0, np.array([0.2, R + δ, 0.7]), v).any()
    assert not d.contacts


def test_a_penalised_pendulum_tends_to_the_rigid_one():
    """By k^(-1/2), as the time of contact does."""
    rigid = load_problem("pendulum-and-wall", e=1.0)
    exact = simulate(rigid, "event-driven", dt=1e-2, t_end=1.0, rtol=1e-10, error=False).q[-1, 0]
    off = []
    for k in (1e4, 1e5):
        soft = pickle.loads(pickle.dumps(penalized(rigid, "hertz", k=k, n=1.0)))
        run = simulate(soft, "newmark-ns", dt=1e-4, t_end=1.0, error=False)
        assert run.certificate.holds
        off.append(abs(run.q[-1, 0] - exact))
    assert off[0] / off[1] == pytest.approx(math.sqrt(10.0), rel=0.1)


def test_regularised_friction_turns_a_ball_as_coulombs_does():
    rigid = load_problem("ball-with-spin")
    soft = penalized(rigid, "hunt-crossley", k=1e6, n=1.0, v0=3.0, v_s=1e-3)
    run = simulate(soft, "newmark-ns", dt=1e-4, t_end=0.5, error=False)
    assert run["v_x"][-1] == pytest.approx(-0.9, rel=0.01)
    assert run["v_φ"][-1] == pytest.approx(27.5, rel=0.01)


@pytest.mark.parametrize(
    ("name", "law", "given", "message"),
    [
        ("pendulum-and-wall", "kelvin-voigt", {}, "jumps where a contact closes.*take law='hunt-crossley', with n=1"),
        ("ball-with-spin", "hunt-crossley", {"v0": 1.0}, "has friction: give v_s="),
        ("pendulum-and-wall", "hunt-crossley", {}, "give v0="),
        ("pendulum-xy", "hertz", {}, "has no contact"),
        ("bouncing-ball", "hertz", {"v_s": 1.0}, "v_s is of the friction of Lagrangian systems"),
    ],
)
def test_what_a_lagrangian_system_cannot_have_is_refused(name, law, given, message):
    with pytest.raises(li.LcpImpactError, match=message):
        penalized(load_problem(name), law, k=1e5, **given)


def test_laws_that_a_compliant_contact_cannot_have_are_not_left_out_silently():
    with pytest.raises(li.UnsupportedError, match=r"contact 'N' has e_T = 0\.5"):
        penalized(load_problem("ball-with-spin", e_T=0.5), "hunt-crossley", k=1e5, v0=1.0, v_s=1e-3)
    floor, ball = li.Wall("floor", li.Line((0.0, 0.0), (1.0, 0.0))), li.Body("ball", 1.0, 0.004, li.Disk(0.1))
    bodies = Problem("ball", Scheme(floor, ball, li.Touch("ball", "floor", e=0.5)), q0={"ball.y": 0.1})
    with pytest.raises(li.UnsupportedError, match="Touch between 'ball' and 'floor' makes a unilateral row by itself"):
        penalized(bodies, "hertz", k=1e5, e=1.0)
