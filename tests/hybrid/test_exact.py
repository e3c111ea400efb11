"""The exact solution against digits, closed forms and SciPy's DOP853; each reference is computed without lcpimpact."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from piecewise_ode import solve

import lcpimpact as li
from lcpimpact.errors import Status
from lcpimpact.hybrid import flow
from lcpimpact.hybrid.flow import Flow
from lcpimpact.hybrid.generator import DEGREE
from lcpimpact.hybrid.windows import BERNSTEIN
from lcpimpact.integrators.exact import Exact
from lcpimpact.interpreter import interpreted
from lcpimpact.numerics.double_double import DoubleDouble
from lcpimpact.numerics.polynomials import casteljau, first_fall, only_root
from lcpimpact.problems.bouncing_ball import closed_form
from lcpimpact.problems.reference import KNOWN
from lcpimpact.reproduce.runs import peak_reaction


def exact(problem, dt=1e-2, t_end=3.0, **options):
    return li.simulate(problem, "exact", dt=dt, t_end=t_end, **options)


@pytest.mark.parametrize("known", KNOWN, ids=lambda known: known.label)
def test_digits_of_40_digit_arithmetic(known):
    run = exact(li.load_problem(known.problem, **known.parameters))
    assert [event.kind for event in run.events] == list(known.kinds[: len(known.switches)])
    assert_allclose([event.t for event in run.events], known.switches, rtol=0, atol=1e-12)
    for name, value in known.at_3.items():
        assert_allclose(run[name][-1], value, rtol=0, atol=1e-8 if name == "R" else 1e-11)
    if known.peak is not None:
        assert_allclose(peak_reaction(run), known.peak, rtol=0, atol=1e-4)


def test_force_jumps_to_c_o_v_o_at_first_touch():
    assert_allclose(exact(li.load_problem("system-1"))["R"][0], 250.0 * np.sqrt(2 * 9.81 * 5), rtol=1e-14)
    series = 1.0 / (1.0 / 125.0 + 1.0 / 250.0)
    assert_allclose(exact(li.load_problem("system-3"))["R"][0], series * np.sqrt(2 * 9.81 * 5), rtol=1e-13)
    assert exact(li.load_problem("system-2"))["R"][0] == 0.0


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


def against_dop853(system, constants):
    run = exact(li.load_problem(f"system-{system}", **{name: constants[name] for name in USED[system]}))
    v_o = constants["v_o"]
    others = {name: value for name, value in constants.items() if name != "v_o"}
    x, R, switches = solve(system, 3.0, v_o, run.t, g=9.81, **others)
    away = np.ones(len(run.t), dtype=bool)
    for t in switches:
        away &= np.abs(run.t - t) > 1e-9
    assert len(run.events) == len(switches)
    assert_allclose([event.t for event in run.events], switches, rtol=0, atol=1e-9)
    assert_allclose(run["x"], x, rtol=0, atol=1e-9)
    assert_allclose(run["R"][away], R[away], rtol=0, atol=1e-9 * (1.0 + np.abs(R).max()))


@pytest.mark.parametrize("system", [1, 2, 3])
@settings(max_examples=4)
@given(constants=CONSTANTS)
def test_against_dop853(system, constants):
    against_dop853(system, constants)


def test_what_is_zero_is_measured_against_the_whole_run():
    # The body travels 10 m and opens at 0.4 mm: rounding is that of 10 m.
    against_dop853(2, {"m": 175.5735866993122, "k": 500.0, "k_o": 20000.0, "c": 1000.0, "c_o": 20.0, "v_o": 15.0})


@pytest.mark.slow
@settings(max_examples=30)
@given(system=st.sampled_from([1, 2, 3]), constants=CONSTANTS)
def test_against_dop853_on_30_parameter_sets(system, constants):
    """Some ten of each system, beside the four above: what errs only now and then is for `test_against_reference`."""
    against_dop853(system, constants)


@pytest.mark.parametrize("e", [0.0, 0.5, 0.9])
def test_bouncing_ball_through_its_accumulation_to_rest(e):
    run = exact(li.load_problem("bouncing-ball", e=e), dt=1e-3, t_end=12.0 if e == 0.9 else 3.0)
    x, _ = closed_form(run.t, 9.81, 1.0, e)
    assert_allclose(run["x"], x, rtol=0, atol=1e-10)
    impacts = [event for event in run.events if event.kind == "impact"]
    assert_allclose(impacts[0].t, np.sqrt(2.0 / 9.81), rtol=1e-14)
    assert_allclose(-impacts[0].left.v[0] * e, impacts[0].right.v[0], rtol=1e-13)
    assert_allclose(impacts[0].impulse, (1 + e) * np.sqrt(2 * 9.81), rtol=1e-13)
    assert run["v_x"][-1] == pytest.approx(0.0, abs=1e-10)
    assert_allclose(run["R"][-1], 9.81, rtol=1e-12)
    assert run.certificate.energy_balance < 1e-10 * run.certificate.energy_scale


def test_elastic_ball_keeps_bouncing_on_time():
    run = exact(li.load_problem("bouncing-ball", e=1.0), dt=1e-2, t_end=20.0)
    fall = np.sqrt(2.0 / 9.81)
    assert_allclose([event.t for event in run.events], fall * np.arange(1, 2 * len(run.events), 2), rtol=1e-12)
    assert len(run.events) == int((20.0 / fall + 1) / 2)


def test_rounding_of_long_times_is_no_event():
    # At t = 500 s an instant is known to 1e-13 s, so a contact opens at a gap of that order, of either sign.
    run = exact(li.load_problem("bouncing-ball", e=1.0), dt=0.5, t_end=500.0)
    fall = np.sqrt(2.0 / 9.81)
    assert len(run.events) == int((500.0 / fall + 1) / 2)
    assert_allclose([event.t for event in run.events], fall * np.arange(1, 2 * len(run.events), 2), rtol=1e-11)


def test_a_shaken_buffer_opens_for_hundreds_of_periods():
    scheme = li.Scheme(
        li.Mass("x", 1.0),
        li.Load("x", 10.0),
        li.Load("x", li.Harmonic(30.0, 5.0)),
        li.Bumper("x", "z"),
        li.KelvinVoigt("z", "ground", k=100.0, c=2.0),
    )
    run = exact(li.Problem("shaken", scheme), dt=0.1, t_end=500.0)
    kinds = [event.kind for event in run.events]
    assert len(kinds) > 200
    assert set(kinds[::2]) == {"open"}
    assert set(kinds[1::2]) == {"close"}
    assert run.certificate.penetration < 1e-11
    assert run.certificate.energy_balance < 1e-9 * 30.0 * np.abs(run.v).max() * 500.0


def test_max_events_is_a_status_and_keeps_what_was_reached():
    run = exact(li.load_problem("bouncing-ball", e=1.0), dt=1e-2, t_end=20.0, max_events=3, throw=False)
    assert run.status is li.Status.MAX_EVENTS
    assert 0.0 < run.t[-1] < 20.0
    assert np.isfinite(run.q).all()
    with pytest.raises(li.FailureError, match="max_events"):
        exact(li.load_problem("bouncing-ball", e=1.0), dt=1e-2, t_end=20.0, max_events=3)


def test_harmonic_load_against_the_closed_form_of_the_driven_oscillator():
    m, k, a, ω = 2.0, 50.0, 3.0, 4.0
    scheme = li.Scheme(li.Mass("x", m), li.Spring("x", "ground", k), li.Load("x", li.Harmonic(a, ω)))
    run = exact(li.Problem("driven", scheme, q0={"x": 0.1}), t_end=5.0)
    ω0 = np.sqrt(k / m)
    particular = a / (k - m * ω**2)
    x = (0.1 - particular) * np.cos(ω0 * run.t) + particular * np.cos(ω * run.t)
    assert_allclose(run["x"], x, rtol=0, atol=1e-13)


def test_grazing_is_passed_and_just_beyond_it_there_is_contact():
    # x = 1 - cos(t) reaches 2 at t = π; a stop at 2 + δ is missed for δ > 0 and met for δ < 0.
    def swing(gap):
        scheme = li.Scheme(
            li.Mass("x", 1.0),
            li.Spring("x", "ground", 1.0),
            li.Load("x", 1.0),
            li.Bumper("x", "ground", gap=gap, e=0.5),
        )
        return exact(li.Problem("swing", scheme), t_end=6.0)

    assert [event for event in swing(2.0 + 1e-9).events if event.impulse > 0.0] == []
    assert_allclose(swing(2.0)["x"], 1.0 - np.cos(np.linspace(0, 6, 601)), rtol=0, atol=1e-9)
    met = swing(2.0 - 1e-9)
    assert [event.kind for event in met.events] == ["impact"]
    assert_allclose(met.events[0].t, np.arccos(-1.0 + 1e-9), rtol=0, atol=1e-8)


@pytest.mark.parametrize("t_end", [2.0, 500.0])
def test_grazing_in_free_flight(t_end):
    # A body thrown up against a stop at 1 m, which it would pass by 1e-10 m, or miss by as much.
    def throw(beyond):
        scheme = li.Scheme(li.Mass("x", 1.0), li.Load("x", 9.81), li.Bumper("ground", "x", gap=1.0, e=0.5))
        problem = li.Problem("throw", scheme, v0={"x": -np.sqrt(2.0 * 9.81 * (1.0 + beyond))})
        return exact(problem, dt=t_end / 10, t_end=t_end)

    assert throw(-1e-10).events == ()
    met = throw(1e-10).events
    assert [event.kind for event in met] == ["impact"]
    assert_allclose(met[0].left.v[0], -np.sqrt(2.0 * 9.81 * 1e-10), rtol=1e-4)


def test_no_event_is_missed_however_short_the_excursion():
    # cos(t) dips below -1 + ε for a time of order sqrt(ε): far below any window.
    flow = Flow(DoubleDouble.of([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), 10.0)
    start = np.array([1.0, 0.0, 1.0])
    for ε in (1e-4, 1e-8, 1e-12):
        row = np.array([[1.0, 0.0, 1.0 - ε]])
        crossing = flow.first_crossing(start, np.abs(start), row, np.array([0]), 10.0)
        assert crossing.row == 0
        assert_allclose(crossing.t.hi, np.arccos(-1.0 + ε), rtol=0, atol=1e-15 / np.sqrt(ε) + 1e-14)
    row = np.array([[1.0, 0.0, 1.0 + 1e-12]])
    assert flow.first_crossing(start, np.abs(start), row, np.array([0]), 10.0).row < 0


@pytest.mark.parametrize(
    ("A", "start", "instant", "rate"),
    [
        (
            [[0.0, 1.0, 0.0], [0.0, 0.0, -2.0], [0.0, 0.0, 0.0]],
            [3.0, 0.0, 1.0],
            "1.7320508075688772935274463415058723669",
            "-3.4641016151377545870548926830117447339",
        ),
        ([[0.0, 1.0], [-1.0, 0.0]], [0.0, 1.0], "3.1415926535897932384626433832795028842", "-1"),
    ],
    ids=["fall", "vibration"],
)
def test_a_crossing_has_the_digits_of_double_doubles(A, start, instant, rate):
    # The fall is a polynomial of degree 2, whose higher powers are zero; the vibration crosses in its fourth window.
    row, order = np.eye(len(A))[:1], np.array([int(start[0] == 0.0)])
    found = Flow(DoubleDouble.of(A), 10.0).first_crossing(np.array(start), np.abs(start), row, order, 10.0)
    assert found.row == 0
    for value, truth in ((found.t, instant), (found.state[0], "0"), (found.state[1], rate)):
        assert abs(Fraction(float(value.hi)) + Fraction(float(value.lo)) - Fraction(truth)) < 1e-29


@given(roots=st.lists(st.floats(0.01, 0.99), min_size=1, max_size=6))
def test_first_sign_change_is_the_first_root(roots):
    polynomial = np.polynomial.Polynomial.fromroots(sorted(roots))
    if polynomial(0.0) < 0.0:
        polynomial = -polynomial
    a = np.zeros(DEGREE + 1)
    a[: len(polynomial.coef)] = polynomial.coef
    floor = -1e-13
    found = first_fall(np.array([BERNSTEIN[0] @ a, np.zeros(DEGREE + 1)]), floor)
    fine = np.linspace(0.0, 1.0, 20_001)
    below = fine[polynomial(fine) < floor * 10]
    if np.isnan(found):
        assert len(below) == 0
    else:
        assert polynomial(found) == pytest.approx(0.0, abs=1e-12)
        assert len(below) == 0 or found <= below[0]


@pytest.mark.parametrize("root", [1e-9, 0.1, 1.0 / 3.0, 0.7, 1.0 - 1e-9])
def test_a_simple_root_takes_the_steps_of_newtons_method(root):
    a = np.append([root, -1.0], np.zeros(DEGREE - 1))
    a[3:6] = a[1] * np.array([0.2, -0.05, 0.01])
    a[0] = -np.polynomial.polynomial.polyval(root, np.append(0.0, a[1:]))
    seen = []
    found = interpreted(only_root, casteljau=lambda b, s: seen.append(s) or casteljau(b, s))(BERNSTEIN[0] @ a)
    assert_allclose(found, root, rtol=0, atol=1e-15)
    assert len(seen) <= 10


@given(st.floats(0.0, 30.0), st.floats(0.1, 50.0))
def test_flow_is_the_matrix_exponential(t, ω):
    oscillator = Flow(DoubleDouble.of([[0.0, 1.0], [-(ω**2), 0.0]]), 30.0)
    assert_allclose(
        oscillator.at(np.array([1.0, 0.0]), np.array([t]))[0],
        [np.cos(ω * t), -ω * np.sin(ω * t)],
        rtol=0,
        atol=1e-12 * (1.0 + ω) * (1.0 + ω * t),
    )


@pytest.mark.parametrize("name", ["system-1", "bouncing-ball", "kelvin-voigt-tension", "bar-impact"])
def test_polynomials_kept_from_one_reading_to_the_next_change_no_bit(name, monkeypatch):
    problem = li.load_problem(name, **({"elements": 20.0} if name == "bar-impact" else {}))
    run = exact(problem, dt=problem.t_end / 50, t_end=problem.t_end)
    t = np.random.default_rng(1).uniform(0.0, problem.t_end, 200)
    monkeypatch.setattr(flow, "MAX_KEPT", 0)
    alone = exact(problem, dt=problem.t_end / 50, t_end=problem.t_end)
    for side in ("right", "left"):
        one, other = run.sample(t, side), alone.sample(t, side)
        for each in ("q", "v", "reaction"):
            assert_array_equal(getattr(one, each), getattr(other, each))
    assert_array_equal(run.q, alone.q)
    assert run.certificate == alone.certificate


class Altered(Exact):
    """Alters one instant of its record."""

    def finish(self, carry, record):
        super().finish(carry, record)
        record.v[7] *= 1.0 + 1e-6


def test_a_record_that_is_not_the_solution_is_no_solved_run():
    run = li.simulate(li.load_problem("system-2"), Altered(), dt=1e-2, t_end=3.0, throw=False)
    assert run.status is Status.VIOLATED
    assert [failure.split(" by ")[0] for failure in run.certificate.failures] == [
        "the record differs from the continuous solution"
    ]


def test_simultaneous_contacts_of_two_bodies_share_the_load():
    # Two bodies at rest, one on the other, on the ground: R1 carries both, R2 the upper one.
    scheme = li.Scheme(
        li.Mass("a", 2.0),
        li.Mass("b", 3.0),
        li.Load("a", 20.0),
        li.Load("b", 30.0),
        li.Bumper("a", "b", e=0.3, name="R2"),
        li.Bumper("b", "ground", e=0.3, name="R1"),
    )
    run = exact(li.Problem("pile", scheme), t_end=1.0)
    assert_allclose(run["R1"], 50.0, rtol=1e-13)
    assert_allclose(run["R2"], 20.0, rtol=1e-13)
    assert_allclose(run.q, 0.0, atol=1e-14)


def test_energy_balance_closes_on_the_papers_systems():
    for name in ("system-1", "system-2", "system-3"):
        certificate = exact(li.load_problem(name)).certificate
        assert certificate.energy_balance < 1e-10 * certificate.energy_scale
        assert certificate.penetration < 1e-13


def test_a_run_equals_its_two_halves_at_any_output_step():
    whole = exact(li.load_problem("system-1"), dt=1e-3)
    coarse = exact(li.load_problem("system-1"), dt=0.5)
    assert_allclose(coarse.q, whole.q[::500], rtol=0, atol=1e-13)


def test_contacts_without_a_common_relative_degree_are_refused_by_name_beside_sliders():
    scheme = li.Scheme(
        li.Mass("a", 1.0),
        li.Mass("b", 1.0),
        li.Spring("p", "ground", 100.0),
        li.Bumper("a", "p", name="Ra"),
        li.Bumper("b", "p", name="Rb"),
        li.Slider("a", "ground", r0=0.5),
    )
    with pytest.raises(li.UnsupportedError, match=r"'Ra', 'Rb'.*beside sliders.*moreau-jean"):
        exact(li.Problem("plate", scheme, v0={"a": 1.0, "b": 2.0}))


def test_an_impact_at_the_start_is_no_gap_in_the_balance_of_energy():
    """The record begins after it, and so must the work."""
    ball = li.Scheme(li.Mass("x", m=2.0), li.Load("x", f=20.0), li.Bumper("x", "ground", gap=0.0, e=0.5))
    run = li.simulate(li.Problem("ball", ball, v0={"x": 3.0}), "exact", dt=0.01, t_end=0.25)
    assert [event.t for event in run.events] == [0.0]
    assert run["v_x"][0] == -1.5
    assert run.certificate.energy_balance < 1e-13
