"""SciPy between events: against `exact`, closed forms, and SciPy with modes and springs written by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from event_reference import Reference
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from piecewise_ode import solve
from random_schemes import random_problem
from schemes import column, plate_beside_an_impact
from scipy import integrate

import lcpimpact as li
from lcpimpact import (
    Bumper,
    Harmonic,
    HertzSpring,
    HuntCrossley,
    KelvinVoigt,
    KelvinVoigtStop,
    Load,
    Mass,
    PrescribedMotion,
    Scheme,
    Slider,
    Spring,
)
from lcpimpact.integrators.event_driven import SCIPY_SOLVERS
from lcpimpact.problems.bouncing_ball import closed_form
from lcpimpact.problems.reference import KNOWN


def run(problem, dt=1e-2, t_end=3.0, **options):
    return li.simulate(problem, "event-driven", dt=dt, t_end=t_end, progress=False, **options)


def exact(problem, dt=1e-2, t_end=3.0):
    return li.simulate(problem, "exact", dt=dt, t_end=t_end, progress=False)


def history(trajectory):
    return [(event.contact, event.kind) for event in trajectory.events]


# --- linear schemes ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("known", KNOWN, ids=lambda known: known.label)
def test_digits_of_40_digit_arithmetic(known):
    problem = li.load_problem(known.problem, **known.parameters)
    for rtol, within in ((1e-9, 1e-8), (1e-12, 5e-11)):
        found = run(problem, rtol=rtol)
        assert [event.kind for event in found.events] == list(known.kinds[: len(known.switches)])
        assert_allclose([event.t for event in found.events], known.switches, rtol=0, atol=within)
        for name, value in known.at_3.items():
            if name != "R":
                assert_allclose(found[name][-1], value, rtol=0, atol=10 * within)
        assert found.certificate.penetration < 1e-13
        assert found.certificate.energy_balance < 1e-7 * found.certificate.energy_scale


@pytest.mark.parametrize(
    "name",
    [
        *(
            "impact-oscillator",
            "oscillator-stop",
            "bilinear-oscillator",
            "two-balls-spring",
            "three-balls",
            "newtons-cradle",
        ),
        *("two-ball-drop", "coulomb-oscillator", "vibrating-table", "rocking-block", "diode-bridge", "maxwell-impact"),
    ],
)
def test_every_kind_of_problem_against_exact(name):
    problem = li.load_problem(name)
    dt = problem.t_end / 400
    found, truth = run(problem, dt=dt, t_end=problem.t_end, rtol=1e-11), exact(problem, dt=dt, t_end=problem.t_end)
    assert history(found) == history(truth)
    assert_allclose(
        [event.t for event in found.events], [event.t for event in truth.events], rtol=0, atol=1e-8 * problem.t_end
    )
    assert_allclose(found.q, truth.q, rtol=0, atol=1e-8 * np.abs(truth.q).max())
    for a, b in zip(found.events, truth.events, strict=True):
        assert_allclose(a.impulse, b.impulse, rtol=1e-7)
        for side in ("left", "right"):
            assert_allclose(getattr(a, side).v, getattr(b, side).v, rtol=0, atol=1e-6 * np.abs(truth.v).max())
    times = np.linspace(0.0, problem.t_end, 1013)
    assert_allclose(found.sample(times).q, truth.sample(times).q, rtol=0, atol=1e-8 * np.abs(truth.q).max())
    assert found.certificate.penetration < 1e-12


CONSTANTS = st.fixed_dictionaries(
    {
        "m": st.floats(10.0, 500.0),
        "k": st.floats(500.0, 20_000.0),
        "k_o": st.floats(500.0, 20_000.0),
        "c": st.floats(20.0, 1_000.0),
        "c_o": st.floats(20.0, 1_000.0),
        "v_o": st.floats(0.5, 15.0),
    }
)
USED = {1: ("m", "k_o", "c_o", "v_o"), 2: ("m", "k", "k_o", "c_o", "v_o"), 3: ("m", "k", "k_o", "c", "c_o", "v_o")}


@settings(max_examples=40)
@given(system=st.sampled_from([1, 2, 3]), constants=CONSTANTS)
def test_random_constants_against_exact(system, constants):
    problem = li.load_problem(f"system-{system}", **{name: constants[name] for name in USED[system]})
    found, truth = run(problem, dt=0.05, rtol=1e-11), exact(problem, dt=0.05)
    assert history(found) == history(truth)
    assert_allclose([event.t for event in found.events], [event.t for event in truth.events], rtol=0, atol=1e-6)
    assert_allclose(found["x"], truth["x"], rtol=0, atol=1e-6)


def test_modes_written_by_hand_give_the_same():
    constants = {"m": 80.0, "k": 3e3, "k_o": 5e3, "c": 200.0, "c_o": 300.0}
    found = run(li.load_problem("system-3", **constants, v_o=6.0), rtol=1e-12)
    x, _, switches = solve(3, 3.0, 6.0, found.t, g=9.81, **constants)
    assert_allclose([event.t for event in found.events], switches, rtol=0, atol=1e-10)
    assert_allclose(found["x"], x, rtol=0, atol=1e-10)


@pytest.mark.parametrize("solver", [*SCIPY_SOLVERS, integrate.DOP853])
def test_every_solver_of_scipy_follows_its_tolerance(solver):
    problem, truth = li.load_problem("system-3"), exact(li.load_problem("system-3"))
    errors = []
    for rtol in (1e-4, 1e-7):
        found = run(problem, ode_solver=solver, rtol=rtol, atol=rtol * 1e-2)
        assert history(found) == history(truth)
        errors.append(np.abs(found.q - truth.q).max())
    assert errors[1] < 1e-4
    assert errors[1] < 0.1 * errors[0]


def test_the_output_spacing_changes_nothing():
    coarse, fine = run(li.load_problem("system-1"), dt=0.5), run(li.load_problem("system-1"), dt=1e-3)
    assert_allclose(coarse.q, fine.q[::500], rtol=0, atol=1e-15)
    assert coarse.stats.steps == fine.stats.steps


def test_smooth_motion_is_that_of_scipy():
    problem = li.Problem("spring", Scheme(Mass("x", 1.0), HertzSpring("x", "ground", 1e3, n=2.0)), q0={"x": 0.1})
    found = run(problem, dt=0.01, t_end=0.05)
    other = integrate.solve_ivp(
        lambda t, s: [s[1], -1e3 * s[0] ** 2],
        (0.0, 0.05),
        [0.1, 0.0],
        "DOP853",
        t_eval=np.minimum(found.t, 0.05),
        rtol=1e-9,
        atol=1e-12,
    )
    assert_allclose(found["x"], other.y[0], rtol=0, atol=1e-9)


# --- impacts that accumulate, rest, grazing ---------------------------------------------------------------------------


@pytest.mark.parametrize("e", [0.0, 0.3, 0.5, 0.9])
def test_the_ball_comes_to_rest_after_its_accumulation(e):
    t_end = 12.0
    found = run(li.load_problem("bouncing-ball", e=e), t_end=t_end)
    x, _ = closed_form(found.t, 9.81, 1.0, e)
    # An impact of speed v is met with a time error of some eps/v, which v falling by e each time sums up.
    assert_allclose(found["x"], x, rtol=0, atol=4e-12)
    rest = math.sqrt(2.0 / 9.81) * (1.0 + e) / (1.0 - e)
    closed = [event.t for event in found.events if event.kind == "close"]
    # The rule: what is left out after a flight of T is e T/(1 - e), T of the tolerance or of the rounding of the gap.
    T = max(1e-9 * t_end, math.sqrt(8.0 * 4.0 * np.finfo(float).eps * 2.0 / 9.81))
    assert len(closed) == 1
    assert abs(closed[0] - rest) < T / (1.0 - e) + 1e-12
    after = found.t > rest + 0.01
    assert_allclose(found["x"][after], 1.0, rtol=0, atol=1e-13)
    assert_allclose(found["R"][after], 9.81, rtol=1e-13)
    assert_allclose(found["v_x"][after], 0.0, atol=1e-13)
    impacts = [event for event in found.events if event.kind == "impact"]
    assert_allclose(impacts[0].impulse, (1.0 + e) * math.sqrt(2.0 * 9.81), rtol=1e-13)
    assert found.certificate.energy_balance < 1e-11


def test_a_coarser_rule_ends_the_accumulation_earlier():
    found = run(li.load_problem("bouncing-ball", e=0.5), zeno=1e-3)
    rest = 3.0 * math.sqrt(2.0 / 9.81)
    assert 1e-5 < rest - found.events[-1].t < 3e-3
    assert len(found.events) < len(run(li.load_problem("bouncing-ball", e=0.5)).events)


def test_a_column_of_beads_comes_to_rest_on_itself():
    """Their impacts accumulate together, in flights that do not shrink in turn and end below the rounding of the gaps."""
    elements = []
    for i in range(6):
        m, below = 1.0 + 0.13 * i, f"b{i + 1}" if i < 5 else "ground"
        elements += [Mass(f"b{i}", m), Load(f"b{i}", 9.81 * m), Bumper(f"b{i}", below, gap=0.1, e=0.4, name=f"R{i}")]
    problem = li.Problem("column", Scheme(*elements))
    found, truth = run(problem, t_end=0.3), exact(problem, t_end=0.3)
    assert_allclose(found.q, truth.q, rtol=0, atol=1e-8)
    assert len([event for event in found.events if event.kind == "close"]) == 3
    assert_allclose(found.reaction[-1], truth.reaction[-1], rtol=0, atol=1e-6)


def test_an_elastic_ball_never_rests():
    found = run(li.load_problem("bouncing-ball", e=1.0), t_end=20.0, zeno=0.1)
    fall = math.sqrt(2.0 / 9.81)
    assert_allclose([event.t for event in found.events], fall * np.arange(1, 2 * len(found.events), 2), rtol=1e-12)
    assert len(found.events) == int((20.0 / fall + 1) / 2)


def test_what_lies_stays_and_is_borne():
    pile = Scheme(
        Mass("a", 2.0),
        Mass("b", 3.0),
        Load("a", 20.0),
        Load("b", 30.0),
        Bumper("a", "b", e=0.3, name="R2"),
        Bumper("b", "ground", e=0.3, name="R1"),
    )
    found = run(li.Problem("pile", pile), t_end=100.0)
    assert found.events == ()
    assert_allclose(found["R1"], 50.0, rtol=1e-13)
    assert_allclose(found["R2"], 20.0, rtol=1e-13)
    assert_allclose(found.q, 0.0, atol=1e-13)
    # On System 1's buffer the body settles at m g/k_o and stays.
    settled = run(li.load_problem("system-1"), t_end=60.0)
    assert_allclose(settled["R"][-1], 981.0, rtol=1e-6)
    assert_allclose(settled["x"][-1], 981.0 / 3924.0, rtol=1e-6)
    assert [event.kind for event in settled.events][-1] == "close"


@pytest.mark.parametrize("δ", [1e-4, 1e-6, 1e-8])
def test_grazing_is_passed_and_just_beyond_it_there_is_contact(δ):
    # x = 1 - cos(t) reaches 2 at t = π.
    def swing(gap):
        scheme = Scheme(
            Mass("x", 1.0), Spring("x", "ground", 1.0), Load("x", 1.0), Bumper("x", "ground", gap=gap, e=0.5)
        )
        return run(li.Problem("swing", scheme), t_end=6.0, rtol=1e-12, atol=1e-14)

    assert swing(2.0 + δ).events == ()
    met = swing(2.0 - δ)
    assert [event.kind for event in met.events] == ["impact"]
    assert_allclose(met.events[0].t, math.acos(-1.0 + δ), rtol=0, atol=1e-11 / math.sqrt(δ))
    assert_allclose(met.events[0].left.v[0], math.sin(math.acos(-1.0 + δ)), rtol=0, atol=1e-11 / math.sqrt(δ))


def test_two_sign_changes_within_a_step_are_seen():
    # A throw is one step of the solver: the stop is passed by a hair in its middle, and only in its middle.
    scheme = Scheme(Mass("x", 1.0), Load("x", 9.81), Bumper("ground", "x", gap=1.0, e=0.5))
    for beyond in (1e-3, 1e-6, 1e-9):
        found = run(li.Problem("throw", scheme, v0={"x": -math.sqrt(2.0 * 9.81 * (1.0 + beyond))}), t_end=5.0)
        assert [event.kind for event in found.events] == ["impact"]
        assert_allclose(found.events[0].left.v[0], -math.sqrt(2.0 * 9.81 * beyond), rtol=1e-4)
        assert (
            run(li.Problem("throw", scheme, v0={"x": -math.sqrt(2.0 * 9.81 * (1.0 - beyond))}), t_end=5.0).events == ()
        )


# --- impacts of several bodies that accumulate ------------------------------------------------------------------------


def test_three_bodies_that_collapse_end_together():
    problem = column((1.0, 1.0, 1.0), (1.0, 1.0), (1.0, 0.0, -0.5), 0.05)
    found = run(problem, dt=0.1, t_end=4.0)
    assert_allclose(found.v[-1], 1 / 6, rtol=0, atol=1e-12)
    assert_allclose(found.q[-1] - [1.0, 0.0, -1.0], found.q[-1][1], rtol=0, atol=1e-12)
    limit = float(Reference(problem, 4.0).accumulations[0][0])
    assert max(event.t for event in found.events) == pytest.approx(limit, abs=1e-11)


@pytest.mark.parametrize("e", [0.05, 0.15, 0.17])
def test_four_bodies_that_collapse_come_to_rest(e):
    found = run(column((1.0,) * 4, (1.0,) * 3, (1.0, 0.0, 0.0, -1.0), e), dt=0.1, t_end=6.0)
    assert_allclose(found.v[-1], 0.0, atol=1e-12)
    assert_allclose(found.q[-1], [1.5, 0.5, -0.5, -1.5], rtol=0, atol=1e-12)


def test_three_bodies_meet_eleven_times_at_e_of_8_per_cent():
    found = run(column((1.0, 1.0, 1.0), (1.0, 1.0), (1.0, 0.0, -0.5), 0.08), dt=0.5, t_end=20.0)
    assert len(found.events) == 11
    # Gaps shrink to 1e-7 and grow again, and their rounding, 1e-16/1e-7, with them.
    assert_allclose(found.events[-1].t, 10.90824943252093, rtol=5e-9)


def test_a_collapse_under_a_load_that_is_any_function():
    """The load acts on all three alike, so it moves them and changes nothing between them."""
    scheme = column((1.0, 1.0, 1.0), (1.0, 1.0), (1.0, 0.0, -0.5), 0.05).scheme
    pushed = Scheme(*scheme.elements, *(Load(name, lambda t: math.sin(t)) for name in "abc"))
    found = run(li.Problem("pushed", pushed, v0={"a": 1.0, "b": 0.0, "c": -0.5}), dt=0.1, t_end=4.0)
    assert_allclose(found.v[-1], 1 / 6 + 1.0 - math.cos(4.0), rtol=0, atol=1e-8)
    assert max(event.t for event in found.events) == pytest.approx(14 / 9, abs=1e-8)


@pytest.mark.parametrize("e", [0.05, 0.2, 0.5])
def test_a_column_that_collapses_on_the_ground_under_gravity(e):
    elements = []
    for i in range(3):
        m, below = 1.0 + 0.1 * i, f"b{i + 1}" if i < 2 else "ground"
        elements += [Mass(f"b{i}", m), Load(f"b{i}", 9.81 * m), Bumper(f"b{i}", below, gap=0.1, e=e, name=f"R{i}")]
    found = run(li.Problem("column", Scheme(*elements)), t_end=2.0)
    assert_allclose(found.q[-1], [0.3, 0.2, 0.1], rtol=0, atol=1e-12)
    assert_allclose(found.reaction[-1], 9.81 * np.cumsum([1.0, 1.1, 1.2]), rtol=1e-9)


# --- flights that are long, and runs that are -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("m", "k", "T"),
    [
        (1.0, 50.0, 1e3),
        (3.0, 5e5, 10.0),
        pytest.param(3.0, 50.0, 3e3, marks=pytest.mark.slow),  # 24,000 radians, some four times those of the others
    ],
)
def test_bodies_joined_by_a_spring_fly_to_a_wall_in_time(m, k, T):
    scheme = Scheme(Mass("a", m), Mass("b", 1.0), Spring("a", "b", k), Bumper("b", "ground", gap=T, e=0.5))
    found = run(li.Problem("flight", scheme, v0={"a": 1.0, "b": 1.0}), dt=T / 100.0, t_end=1.01 * T)
    flown = found.t <= T
    assert_allclose(found.q[flown], np.column_stack([found.t, found.t])[flown], rtol=0, atol=1e-12 * T)
    assert_allclose(found.events[0].t, T, rtol=1e-12)


def test_what_is_pressed_together_stays_so_beside_an_impact():
    found = run(plate_beside_an_impact(), dt=0.05, t_end=2.0)
    assert [(event.kind, event.contact) for event in found.events] == [("impact", "S")]
    assert_allclose(found.events[0].t, 0.5329687861794, rtol=1e-9)
    assert (found["F"] > 0.0).all()


def test_a_stiff_plate_ends_at_the_limit_of_steps_and_names_the_remedy():
    scheme = Scheme(
        Mass("x", 1.0), Load("x", 9.81), Bumper("x", "z", gap=0.01), KelvinVoigt("z", "ground", k=1e12, c=1e3)
    )
    problem = li.Problem("stiff", scheme)
    found = run(problem, t_end=0.2, max_steps=2000, throw=False)
    assert found.status is li.Status.MAX_STEPS
    assert "ode_solver='Radau'" in found.message
    implicit, truth = run(problem, t_end=0.2, ode_solver="Radau", max_steps=2000), exact(problem, t_end=0.2)
    assert_allclose(implicit["x"], truth["x"], rtol=0, atol=1e-8)


def test_the_dense_output_keeps_the_digits_of_the_steps():
    """SciPy controls the error at the ends of steps alone: a step of several radians was 1e-5 off between them."""
    problem = random_problem(124)
    truth, found = (
        li.simulate(problem, method, dt=5e-3, t_end=2.0, progress=False) for method in ("exact", "event-driven")
    )
    assert np.abs(found.q - truth.q).max() < 1e-8 * np.abs(truth.q).max()


# --- non-linear springs, loads, sliders, motions ----------------------------------------------------------------------


@pytest.mark.parametrize("kinks", [True, False])
def test_springs_and_any_load_against_scipy(kinks):
    scheme = Scheme(
        Mass("x", 1.0),
        Mass("y", 0.5),
        Spring("x", "y", 50.0),
        HuntCrossley("y", "ground", 2e3, 0.3, 1.5),
        Load("x", lambda t: 5.0 * math.sin(3.0 * t)),
    )
    problem = li.Problem("chain", scheme, q0={"x": -0.1, "y": -0.1}, v0={"x": 1.0, "y": 1.0})

    def rate(t, s):
        x, y, dx, dy = s
        force = 2e3 * max(y, 0.0) ** 1.5 * (1.0 + 0.3 * dy)
        return [dx, dy, 50.0 * (y - x) + 5.0 * math.sin(3.0 * t), 2.0 * (50.0 * (x - y) - force)]

    found = run(problem, t_end=2.0, kinks=kinks)
    other = integrate.solve_ivp(
        rate,
        (0.0, 2.0),
        [-0.1, -0.1, 1.0, 1.0],
        "DOP853",
        t_eval=np.minimum(found.t, 2.0),
        rtol=1e-12,
        atol=1e-14,
        max_step=2e-3,
    )
    assert_allclose(found.q.T, other.y[:2], rtol=0, atol=1e-8)
    assert_allclose(found.v.T, other.y[2:], rtol=0, atol=1e-7)
    assert found.certificate.energy_balance < 1e-6 * found.certificate.energy_scale


@pytest.mark.parametrize("name", ["hertz-impact", "hunt-crossley-impact"])
def test_the_facts_of_compliant_impacts(name):
    problem = li.load_problem(name)
    found = run(problem, dt=problem.t_end / 100, t_end=problem.t_end, rtol=1e-11, atol=1e-17)
    for fact in problem.facts:
        assert_allclose(fact.measure(found), fact.value, rtol=1e-7)


def test_the_stop_of_kelvin_and_voigt_pushes_and_never_pulls():
    k, c, m, v = 800.0, 10.0, 2.0, 1.0
    problem = li.Problem("stop", Scheme(Mass("x", m), KelvinVoigtStop("x", "ground", k=k, c=c, gap=0.1)), v0={"x": v})
    found = run(problem, t_end=0.5)
    δ = c / (2 * m)
    ω = math.sqrt(k / m - δ**2)
    leaves = (math.pi - math.atan2(2.0 * δ * ω, ω**2 - δ**2)) / ω
    speed = v * math.exp(-δ * leaves) * (math.cos(ω * leaves) - δ / ω * math.sin(ω * leaves))
    assert_allclose(found["v_x"][-1], speed, rtol=1e-8)
    assert_allclose(run(problem, t_end=0.5, kinks=False)["v_x"][-1], speed, rtol=1e-7)


def test_springs_and_contacts_together():
    """A ball on a Hertzian layer meets a stop, lies on it, and is borne by both."""
    scheme = Scheme(
        Mass("x", 1.0), Load("x", 50.0), HertzSpring("x", "ground", 1e3), Bumper("x", "ground", gap=0.05, e=0.4)
    )
    problem = li.Problem("layer", scheme, v0={"x": 1.0})
    found = run(problem, t_end=3.0)

    def rate(t, s):
        return [s[1], 50.0 - 1e3 * max(s[0], 0.0) ** 1.5]

    def meets(t, s):
        return 0.05 - s[0]

    meets.terminal = True
    meets.direction = -1
    t, s, times = 0.0, [0.0, 1.0], []
    for _ in range(4):
        leg = integrate.solve_ivp(rate, (t, 3.0), s, "DOP853", events=meets, rtol=1e-12, atol=1e-14)
        t, s = leg.t[-1], [0.05, -0.4 * leg.y[1, -1]]
        times.append(t)
    impacts = [event.t for event in found.events if event.kind == "impact"]
    assert_allclose(impacts[:4], times, rtol=0, atol=1e-7)
    assert found.events[-1].kind == "close"
    assert_allclose(found["x"][-1], 0.05, rtol=0, atol=1e-13)
    assert_allclose(found["R"][-1], 50.0 - 1e3 * 0.05**1.5, rtol=1e-12)


def test_a_load_that_is_any_function_is_as_good_as_a_harmonic_one():
    def plate(load):
        scheme = Scheme(
            Mass("x", 100.0),
            Load("x", 981.0),
            Spring("x", "y", 1962.0),
            Bumper("y", "z"),
            KelvinVoigt("z", "ground", 3924.0, 250.0),
            Load("y", load),
        )
        return li.Problem("plate", scheme, v0={"x": 5.0})

    found, truth = run(plate(lambda t: 200.0 * math.cos(7.0 * t))), exact(plate(Harmonic(200.0, 7.0)))
    assert history(found) == history(truth) != []
    assert_allclose(found.q, truth.q, rtol=0, atol=1e-8)
    assert_allclose(found.v, truth.v, rtol=0, atol=1e-6)


def test_a_load_that_turns_lifts_what_lies():
    for scheme_load in (lambda t: 10.0 * math.sin(t), Harmonic(10.0, 1.0, -0.5 * math.pi)):
        scheme = Scheme(Mass("x", 1.0), Bumper("x", "ground", e=0.3), Load("x", scheme_load))
        found = run(li.Problem("lifted", scheme), t_end=5.0)
        assert [event.kind for event in found.events] == ["open"]
        assert_allclose(found.events[0].t, math.pi, rtol=0, atol=1e-8)


def test_what_touches_without_a_force_is_borne_once_it_has_one():
    scheme = Scheme(Mass("x", 1.0), Bumper("x", "ground", e=0.5), Load("x", lambda t: max(t - 1.0, 0.0)))
    found = run(li.Problem("weightless", scheme), t_end=2.0, max_step=0.1)
    assert_allclose(found["x"], 0.0, atol=1e-9)
    assert_allclose(found["R"], np.maximum(found.t - 1.0, 0.0), rtol=0, atol=1e-3)


def test_a_jump_of_a_load_is_found():
    scheme = Scheme(Mass("x", 1.0), Bumper("x", "ground", e=0.5), Load("x", lambda t: 10.0 if t < 1.0 else -10.0))
    found = run(li.Problem("switched", scheme), t_end=2.0, max_step=0.1)
    assert [event.kind for event in found.events] == ["open"]
    assert_allclose(found.events[0].t, 1.0, rtol=0, atol=1e-6)
    assert_allclose(found["x"][-1], -5.0, rtol=0, atol=1e-5)


def test_sliders_and_motions():
    scheme = Scheme(
        PrescribedMotion("b", Harmonic(0.1, 5.0)),
        Mass("x", 1.0),
        Spring("x", "b", 100.0),
        Slider("x", "ground", r0=4.0),
    )
    problem = li.Problem("dragged", scheme, v0={"x": 0.5})
    found, truth = run(problem), exact(problem)
    assert history(found) == history(truth)
    assert len(found.events) > 4
    assert_allclose(found.q, truth.q, rtol=0, atol=1e-7)


# --- refusals, options, failures --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("elements", "says"),
    [
        ((HertzSpring("x", "y", 1e3), Spring("y", "ground", 1e3)), r"HertzSpring .* 'y', which is quasi-static"),
        (
            (HuntCrossley("x", "y", 1e3, 0.2), KelvinVoigt("y", "ground", 1e3, 10.0)),
            r"'y', which is massless, and it has a loss.*'event-driven'.*give the node a mass",
        ),
        (
            (PrescribedMotion("b", li.Motion(math.sin, math.cos)), Spring("x", "b", 10.0)),
            r"motion of 'b' is a function of time",
        ),
        (
            (Spring("x", "y", 1e3), Slider("y", "ground", r0=1.0), Load("y", lambda t: t)),
            r"slider 'F'.*load that is a function of time.*Harmonic",
        ),
        (
            (
                *(Mass("b", 1.0), Spring("p", "ground", 1e2), Slider("b", "ground", r0=1.0)),
                *(Bumper("x", "p", name="Ra"), Bumper("b", "p", name="Rb")),
            ),
            r"Ra.*Rb.*'event-driven'.*beside sliders.*moreau-jean",
        ),
    ],
)
def test_what_is_refused_by_name(elements, says):
    with pytest.raises(li.UnsupportedError, match=says):
        run(li.Problem("refused", Scheme(Mass("x", 1.0), *elements)), t_end=0.1)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"ode_solver": "RK54"}, "did you mean 'RK45'"),
        ({"ode_solver": 5}, "OdeSolver class"),
        ({"ode_solver": dict}, "OdeSolver class"),
        ({"rtol": 1e-15}, "rtol = 1e-15 must lie between"),
        ({"atol": 0.0}, "atol = 0.0 must be above zero"),
        ({"max_step": -1.0}, "max_step = -1.0"),
        ({"max_events": 0}, "max_events = 0"),
        ({"max_steps": 0}, "max_steps = 0"),
        ({"zeno": 1.0}, "zeno = 1.0 must be a part"),
        ({"kinks": 1}, "kinks = 1 must be True or False"),
    ],
)
def test_options_that_cannot_be_used(options, says):
    with pytest.raises(li.InputError, match=says):
        run(li.load_problem("system-1"), **options)


def test_max_events_is_a_status_and_keeps_what_was_reached():
    found = run(li.load_problem("bouncing-ball", e=1.0), t_end=20.0, max_events=3, throw=False)
    assert found.status is li.Status.MAX_EVENTS
    fall = math.sqrt(2.0 / 9.81)
    assert 5.0 * fall < found.t[-1] + 1e-2 < 7.0 * fall + 2e-2
    assert np.isfinite(found.q).all()
    assert found.sample(found.t).q.shape == found.q.shape


def test_a_solver_that_cannot_go_on_is_a_status():
    scheme = Scheme(Mass("x", 1.0), Load("x", lambda t: 1.0 / (0.5 - t) ** 2 if t != 0.5 else 1e300))
    found = run(li.Problem("pole", scheme), t_end=1.0, rtol=1e-4, throw=False)
    assert found.status in (li.Status.STEP_SIZE, li.Status.NON_FINITE)
    assert 0.4 < found.t[-1] <= 0.5
    assert np.isfinite(found.q).all()
    with pytest.raises(li.FailureError, match="event-driven stopped after step"):
        run(li.Problem("pole", scheme), t_end=1.0, rtol=1e-4)


@pytest.mark.parametrize("solver", SCIPY_SOLVERS)
@pytest.mark.parametrize(("ends", "v"), [(0.0, 0.0), (0.3, 1.0), (0.5, 0.0)], ids=["at once", "at an impact", "later"])
def test_a_load_that_is_no_number_from_some_instant_on_ends_the_run(solver, ends, v):
    scheme = Scheme(
        Mass("x", 1.0), Load("x", lambda t: 1.0 if t <= ends else math.nan), Bumper("x", "ground", gap=0.3, e=0.5)
    )
    found = run(li.Problem("broken", scheme, v0={"x": v}), t_end=1.0, ode_solver=solver, throw=False)
    assert found.status is li.Status.NON_FINITE
    assert "is not finite" in found.message
    assert found.t[-1] <= ends
    assert np.isfinite(found.q).all()


@pytest.mark.parametrize("method", ["event-driven", "radau-fesd", "dopri5", "exact", "moreau-jean"])
@pytest.mark.parametrize("gap", [1e-13, 0.0, 1e-3])
def test_a_gap_too_narrow_to_tell_from_contact_is_said(method, gap):
    """Three equal elastic balls: one after the other they hand the velocity on, as exact finds for each gap but zero."""
    balls = [li.Mass(x, 1.0) for x in "abc"]
    scheme = li.Scheme(*balls, li.Bumper("a", "b", gap=0.5, e=1.0), li.Bumper("b", "c", gap=gap, e=1.0, name="R2"))
    start = {"a": 1.0, "b": 1.0, "c": 1.0}
    run = li.simulate(li.Problem("balls", scheme, q0=start, v0={"a": 1.0}), method, dt=1e-2, t_end=1.0)
    told = method in ("event-driven", "radau-fesd", "dopri5") and gap == 1e-13
    assert ("too narrow" in run.message and "'R2'" in run.message) == told
    if method == "exact" and gap > 0.0:
        assert run.v[-1] == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)


def test_a_stop_that_pulls_where_rounding_has_opened_it():
    """Light bodies on strong stops; the last, which pulls, is left at a penetration of -6e-14 m with 2e-13 m/s."""
    scheme = li.Scheme(
        li.Mass("a", m=8.480981491222022e-05),
        li.Mass("b", m=0.00024254189860791752),
        li.Mass("c", m=0.0002891822249573177),
        li.HardStop("a", "b", k=1.5000938002440694e-06, c=0.0002530158004634653, rebound="undamped"),
        li.HardStop(
            "b", "c", k=2.1547849489380276e-05, c=2.8699818831113626e-05, rebound="damped", gap=8.438388059383966
        ),
        li.HardStop(
            "c", "ground", k=0.00026277603697025687, c=0.0008585819048431237, rebound="damped", gap=4.347905732976839
        ),
        li.Dashpot("c", "ground", c=1.468457438027402e-06),
        li.Spring("a", "ground", k=1.0725662002592087e-08),
    )
    start = {"a": 0.11545503451135818, "b": -0.07497310635561014, "c": 0.2953425386039684}
    case, T = li.Problem("row", scheme, v0=start), 155.66135429857334
    run = li.simulate(case, "event-driven", dt=T / 50, t_end=T, rtol=1e-9, throw=False, error=False, progress=False)
    assert run.status is li.Status.SOLVED, run.message
    steps = li.simulate(case, "moreau-jean", dt=T / 20_000, t_end=T, error=False, progress=False)
    assert_allclose(run.q[-1], steps.q[-1], rtol=1e-4)


def test_a_segment_that_begins_without_a_number_is_tried_with_a_shorter_step(monkeypatch):
    """The step before is known by then, and is not taken as the first one."""
    begin, inside, failed = integrate.DOP853.__init__, [], []

    def init(self, *given, **options):
        inside.append(options)
        begin(self, *given, **options)
        inside.clear()

    def weight(t):
        if t > 0.0 and inside and "first_step" in inside[0] and not failed:
            failed.append(inside.pop())
            return math.nan
        return -9.81 - t

    ball = Scheme(Mass("x", m=1.0), Load("x", f=weight), HertzSpring("ground", "x", K=1e5))
    case = li.Problem("ball", ball, q0={"x": 0.1})
    whole = li.simulate(case, "event-driven", dt=0.01, t_end=0.5, progress=False, error=False)
    monkeypatch.setattr(integrate.DOP853, "__init__", init)
    run = li.simulate(case, "event-driven", dt=0.01, t_end=0.5, progress=False, error=False)
    assert failed
    assert_allclose(run.q, whole.q, atol=1e-6)
