"""Radau IIA with and without switch detection: coefficients, orders across switches, no switch missed, honest failure."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from schemes import column
from scipy.linalg import expm

import lcpimpact as li
from lcpimpact.hybrid.finite_elements import first_crossing
from lcpimpact.hybrid.radau_iia import RadauIIA, radau_iia
from lcpimpact.integrators.radau_fesd import RadauFESD
from lcpimpact.problems.bouncing_ball import closed_form
from lcpimpact.problems.reference import KNOWN
from lcpimpact.study.accuracy.orders import observed_order

FACTORS = {
    "m": (10.0, 500.0),
    "k": (500.0, 20e3),
    "k_o": (500.0, 20e3),
    "c": (20.0, 1e3),
    "c_o": (20.0, 1e3),
    "v_o": (0.5, 15.0),
}
USED = {1: ("m", "k_o", "c_o", "v_o"), 2: ("m", "k", "k_o", "c_o", "v_o"), 3: tuple(FACTORS)}

MANY = (101, 157, 211, 307, 401, 613)
FEW = (29, 43, 61, 89, 127, 181)


def fesd(problem, dt=1e-2, t_end=3.0, **options):
    return li.simulate(problem, "radau-fesd", dt=dt, t_end=t_end, **options)


def plain(problem, dt=1e-2, t_end=3.0, **options):
    return li.simulate(problem, "radau", dt=dt, t_end=t_end, **options)


def exact(problem, dt=1e-2, t_end=3.0):
    return li.simulate(problem, "exact", dt=dt, t_end=t_end)


def problem_of(known):
    return li.load_problem(known.problem, **known.parameters)


def happened(run):
    return [(event.contact, event.kind) for event in run.events]


# ---- the coefficients -----------------------------------------------------------------------------------------------


def test_coefficients_of_two_and_three_stages():
    assert_allclose(radau_iia(1).a, [[1.0]], rtol=1e-15)
    assert_allclose(radau_iia(2).a, [[5 / 12, -1 / 12], [3 / 4, 1 / 4]], rtol=1e-14)
    w = np.sqrt(6.0)
    assert_allclose(radau_iia(3).c, [(4 - w) / 10, (4 + w) / 10, 1.0], rtol=1e-14)
    assert_allclose(radau_iia(3).a[0], [(88 - 7 * w) / 360, (296 - 169 * w) / 1800, (-2 + 3 * w) / 225], rtol=1e-13)


@pytest.mark.parametrize("s", [1, 2, 3, 4, 5])
def test_one_step_is_the_pade_approximant(s):
    # R(z) of Radau IIA has the degrees (s - 1, s), and agrees with exp z to order 2 s - 1; it vanishes at infinity.
    radau, A = radau_iia(s), np.array([[0.0, 1.0], [-9.0, -0.4]])
    X, h = np.array([1.0, 0.5]), np.array([0.2, 0.1])
    states = np.broadcast_to(X[:, None], (2, 2, 1))
    ends = radau.stages(A, h, states)[:, -1, :, 0]
    errors = [np.abs(end - expm(A * each) @ X).max() for end, each in zip(ends, h, strict=True)]
    assert errors[1] < 1.5 * errors[0] / 2.0 ** (2 * s) + 1e-15
    if s <= 3:
        assert errors[1] > 0.5 * errors[0] / 2.0 ** (2 * s)
    stiff = radau.stages(np.array([[-1e9]]), np.array([1.0]), np.ones((1, 1, 1)))[0, -1, 0, 0]
    assert abs(stiff) < 1e-7


@pytest.mark.parametrize("s", [1, 3, 4])
def test_stages_solve_the_collocation_equations(s):
    radau, A, X, h = (
        radau_iia(s),
        np.array([[0.0, 1.0, 0.0], [-30.0, -2.0, 9.81], [0.0, 0.0, 0.0]]),
        np.array([0.1, 2.0, 1.0]),
        0.3,
    )
    system = np.eye(3 * s) - h * np.kron(radau.a, A)
    expected = np.linalg.solve(system, np.tile(X, s)).reshape(s, 3)
    found = radau.stages(A, np.array([h]), X[None, :, None])[0, :, :, 0]
    assert_allclose(found, expected, rtol=0, atol=1e-13)
    # What does not change keeps its last digit.
    assert (found[:, 2] == 1.0).all()
    end, rate = radau.end_and_rate(A, h, X)
    assert_allclose(end, expected[-1], rtol=0, atol=1e-13)
    two = [radau.end_and_rate(A, h + d, X)[0] for d in (1e-5, -1e-5)]
    assert_allclose(rate, (two[0] - two[1]) / 2e-5, rtol=0, atol=1e-7)


def test_coefficients_that_are_wrong_are_refused():
    radau = radau_iia(3)
    with pytest.raises(ValueError, match="order 5"):
        RadauIIA(radau.c, radau.a * (1.0 + 1e-12))
    for stages in (0, 6, 2.5, "3"):
        with pytest.raises(li.InputError, match="stages"):
            radau_iia(stages)
    with pytest.raises(li.InputError, match="rtol"):
        RadauFESD(rtol=0.0)
    with pytest.raises(li.InputError, match="max_newton"):
        RadauFESD(max_newton=0)
    with pytest.raises(li.InputError, match="max_events"):
        RadauFESD(max_events=True)


# ---- radau-fesd -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("known", KNOWN, ids=lambda known: known.label)
def test_ten_digits_with_a_hundredth_of_the_steps(known):
    steps = 101
    run = fesd(problem_of(known), dt=3.0 / steps, stages=4)
    assert np.abs(run["x"] - exact(problem_of(known), dt=3.0 / steps)["x"]).max() < 1e-10
    assert run.stats.steps <= steps + len(known.switches)
    assert run.stats.rejected == 0
    # The θ-step does not reach 1e-7 with a hundred times as many.
    theta = li.simulate(problem_of(known), dt=3.0 / (100 * steps), t_end=3.0)
    assert np.abs(theta["x"] - exact(problem_of(known), dt=3.0 / (100 * steps))["x"]).max() > 1e-7


@pytest.mark.parametrize("known", KNOWN, ids=lambda known: known.label)
def test_digits_of_40_digit_arithmetic(known):
    run = fesd(problem_of(known), stages=5, dt=3.0 / 97)
    assert [event.kind for event in run.events] == list(known.kinds[: len(known.switches)])
    assert_allclose([event.t for event in run.events], known.switches, rtol=0, atol=1e-11)
    for name, value in known.at_3.items():
        assert_allclose(run[name][-1], value, rtol=0, atol=1e-7 if name == "R" else 1e-10)
    assert 0.0 < run.stats.residual < 1e-12
    assert run.certificate.penetration < 1e-12
    assert run.certificate.energy_balance < 1e-9 * run.certificate.energy_scale


@pytest.mark.parametrize("stages", [2, 3])
@pytest.mark.parametrize("known", KNOWN[:3], ids=lambda known: known.label)
def test_no_order_is_lost_at_switches(known, stages):
    counts = {2: MANY, 3: FEW}[stages]
    assert_allclose(
        observed_order(problem_of(known), "radau-fesd", counts, 3.0, stages=stages).slope, 2 * stages - 1, atol=0.35
    )


@pytest.mark.slow
@pytest.mark.parametrize("known", KNOWN[:3], ids=lambda known: known.label)
def test_one_stage_is_of_first_order(known):
    order = observed_order(problem_of(known), "radau-fesd", (3001, 4001, 6007, 9001, 12007, 18013), 3.0, stages=1)
    assert_allclose(order.slope, 1.0, atol=0.2)


@pytest.mark.parametrize("norm", ["sup_q", "l1_v"])
@pytest.mark.parametrize(
    ("name", "t_end", "counts"),
    [
        ("impact-oscillator", 10.0, MANY),
        ("oscillator-stop", 1.0, FEW),
        ("two-balls-spring", 0.5, (151, 211, 307, 401, 503, 613)),
    ],
)
def test_no_order_is_lost_at_impacts(name, t_end, counts, norm):
    assert_allclose(observed_order(li.load_problem(name), "radau-fesd", counts, t_end, norm=norm).slope, 5.0, atol=0.35)


def test_no_order_is_lost_where_a_slider_turns_or_stops():
    assert_allclose(observed_order(li.load_problem("coulomb-oscillator"), "radau-fesd", FEW, 3.0).slope, 5.0, atol=0.35)


@pytest.mark.parametrize("e", [0.0, 0.5, 0.9])
def test_ball_through_its_accumulation_to_rest(e):
    # Gravity is integrated exactly, so steps of any length will do; 0.24 s hold dozens of impacts.
    t_end = 12.0 if e == 0.9 else 3.0
    for steps in (50, 307):
        run = fesd(li.load_problem("bouncing-ball", e=e), dt=t_end / steps, t_end=t_end)
        assert_allclose(run["x"], closed_form(run.t, 9.81, 1.0, e)[0], rtol=0, atol=1e-10)
        assert_allclose(run["R"][-1], 9.81, rtol=1e-12)
        impacts = [event for event in run.events if event.kind == "impact"]
        assert_allclose(impacts[0].t, np.sqrt(2.0 / 9.81), rtol=1e-13)
        assert_allclose(impacts[0].impulse, (1 + e) * np.sqrt(2 * 9.81), rtol=1e-13)
        assert_allclose(impacts[0].right.v, -e * impacts[0].left.v, rtol=1e-13)
        assert run.certificate.penetration < 1e-13


def test_accumulation_on_a_grid_point_is_passed():
    # 4.0637127... is where a ball with e = 0.8 comes to rest.
    rest = np.sqrt(2.0 / 9.81) * (1.0 + 2.0 * 0.8 / 0.2)
    run = fesd(li.load_problem("bouncing-ball", e=0.8), dt=rest / 320, t_end=rest * 1.25)
    assert_allclose(run["x"], closed_form(run.t, 9.81, 1.0, 0.8)[0], rtol=0, atol=1e-10)


def draw(rng, system):
    low, high = (np.array([FACTORS[name][j] for name in USED[system]]) for j in (0, 1))
    return dict(zip(USED[system], np.exp(rng.uniform(np.log(low), np.log(high))).tolist(), strict=True))


def compare_with_exact(sets, seed, **options):
    rng = np.random.default_rng(seed)
    for i in range(sets):
        system = 1 + i % 3
        problem = li.load_problem(f"system-{system}", **draw(rng, system))
        run, truth = fesd(problem, **options), exact(problem)
        assert happened(run) == happened(truth), problem.parameters
        times = [[event.t for event in each.events] for each in (run, truth)]
        assert_allclose(times[0], times[1], rtol=0, atol=1e-6, err_msg=str(problem.parameters))
        assert_allclose(run["x"], truth["x"], rtol=0, atol=1e-6 * np.abs(truth["x"]).max())


@pytest.mark.parametrize("dt", [0.1, 1.0])
def test_three_bodies_that_collapse_end_together(dt):
    problem = column((1.0, 1.0, 1.0), (1.0, 1.0), (1.0, 0.0, -0.5), 0.05)
    found = li.simulate(problem, "radau-fesd", dt=dt, t_end=4.0)
    assert_allclose(found.v[-1], 1 / 6, rtol=0, atol=1e-12)
    assert_allclose(found.q[-1] - [1.0, 0.0, -1.0], found.q[-1][1], rtol=0, atol=1e-12)
    assert max(event.t for event in found.events) == pytest.approx(14 / 9, abs=1e-11)


@pytest.mark.parametrize("e", [0.05, 0.15, 0.17])
@pytest.mark.parametrize("steps", [60, 1800])
def test_four_bodies_that_collapse_come_to_rest(e, steps):
    """Of the finer grid some points fall into the time in which impacts follow each other in quick succession."""
    found = li.simulate(
        column((1.0,) * 4, (1.0,) * 3, (1.0, 0.0, 0.0, -1.0), e), "radau-fesd", dt=6.0 / steps, t_end=6.0
    )
    assert_allclose(found.v[-1], 0.0, atol=1e-12)
    assert_allclose(found.q[-1], [1.5, 0.5, -0.5, -1.5], rtol=0, atol=1e-12)
    truth = li.simulate(found.problem, "exact", dt=6.0 / steps, t_end=6.0)
    assert_allclose(found.q, truth.q, rtol=0, atol=1e-12)


def test_a_grid_point_within_a_collapse_is_read_off_it():
    """14/9 s is where the bodies end together; the grid has points within the last microsecond before."""
    problem = column((1.0, 1.0, 1.0), (1.0, 1.0), (1.0, 0.0, -0.5), 0.05)
    t_end = 14.0 / 9.0 * (1.0 - 1e-9)
    found, truth = (li.simulate(problem, m, dt=t_end / 7, t_end=t_end) for m in ("radau-fesd", "exact"))
    assert_allclose(found.q, truth.q, rtol=0, atol=1e-13)
    assert_allclose(found.v, truth.v, rtol=0, atol=1e-9)


def test_three_bodies_meet_eleven_times_at_e_of_8_per_cent():
    problem = column((1.0, 1.0, 1.0), (1.0, 1.0), (1.0, 0.0, -0.5), 0.08)
    found = li.simulate(problem, "radau-fesd", dt=0.5, t_end=20.0)
    assert len(found.events) == 11
    assert_allclose(found.events[-1].t, 10.90824943252093, rtol=1e-9)


def test_bodies_joined_by_a_spring_fly_to_a_wall_in_time():
    """Rounding in the matrix of a step is a small force on what is free to move: 1e-9 of the way after 1e4 s."""
    scheme = li.Scheme(
        li.Mass("a", 3.0), li.Mass("b", 1.0), li.Spring("a", "b", 50.0), li.Bumper("b", "ground", gap=1e4, e=0.5)
    )
    problem = li.Problem("flight", scheme, v0={"a": 1.0, "b": 1.0})
    found = li.simulate(problem, "radau-fesd", dt=100.0, t_end=1.01e4)
    assert_allclose(found.events[0].t, 1e4, rtol=1e-9)


@pytest.mark.slow
def test_no_switch_is_missed_over_300_parameter_sets():
    compare_with_exact(300, seed=11, stages=4)


@pytest.mark.slow
def test_no_switch_is_missed_with_adaptive_elements():
    compare_with_exact(60, seed=5, rtol=1e-9)


@pytest.mark.parametrize("dt", [0.5, 1e-2])
@pytest.mark.parametrize("beyond", [1e-4, 1e-8, 1e-10])
def test_a_short_excursion_within_an_element_is_found(beyond, dt):
    # A body thrown up against a stop at 1 m, which it would pass by so little, or misses by as much.
    def throw(beyond):
        scheme = li.Scheme(li.Mass("x", 1.0), li.Load("x", 9.81), li.Bumper("ground", "x", gap=1.0, e=0.5))
        return fesd(li.Problem("throw", scheme, v0={"x": -np.sqrt(2.0 * 9.81 * (1.0 + beyond))}), dt=dt, t_end=1.0)

    assert throw(-beyond).events == ()
    met = throw(beyond).events
    assert [event.kind for event in met] == ["impact"]
    assert_allclose(met[0].left.v[0], -np.sqrt(2.0 * 9.81 * beyond), rtol=1e-4)


@pytest.mark.parametrize(("gap", "impacts"), [(2.0 + 1e-9, 0), (2.0 - 1e-9, 1)])
def test_grazing(gap, impacts):
    # x = 1 - cos t reaches 2 at t = π.
    scheme = li.Scheme(
        li.Mass("x", 1.0), li.Spring("x", "ground", 1.0), li.Load("x", 1.0), li.Bumper("x", "ground", gap=gap, e=0.5)
    )
    run = fesd(li.Problem("swing", scheme), dt=6.0 / 61, t_end=6.0, stages=5)
    assert len(run.events) == impacts
    if impacts:
        assert_allclose(run.events[0].t, np.arccos(-1.0 + 1e-9), rtol=0, atol=1e-6)
    else:
        assert_allclose(run["x"], 1.0 - np.cos(run.t), rtol=0, atol=1e-9)


def test_many_switches_within_one_step():
    # A buffer that is shaken at 5 rad/s; a step of half a second holds several switches.
    scheme = li.Scheme(
        li.Mass("x", 1.0),
        li.Load("x", 10.0),
        li.Load("x", li.Harmonic(30.0, 20.0)),
        li.Bumper("x", "z"),
        li.KelvinVoigt("z", "ground", k=100.0, c=2.0),
    )
    problem = li.Problem("shaken", scheme)
    run, truth = fesd(problem, dt=0.5, t_end=10.0, rtol=1e-11, stages=5), exact(problem, dt=0.5, t_end=10.0)
    assert len(truth.events) > 40
    assert happened(run) == happened(truth)
    assert_allclose(run.q, truth.q, rtol=0, atol=1e-7)


def test_rtol_halves_elements_until_their_error_is_below_it():
    problem, found = li.load_problem("system-3", c=60.0), []
    truth = exact(problem, dt=0.5)
    for rtol in (1e-4, 1e-7, 1e-10):
        run = fesd(problem, dt=0.5, rtol=rtol)
        assert np.abs(run.q - truth.q).max() < 100.0 * rtol * np.abs(truth.q).max()
        found.append(run.stats.steps)
    assert 6 < found[0] < found[1] < found[2] < 3000
    assert fesd(problem, dt=0.5).stats.steps < found[0]


@pytest.mark.parametrize(
    ("name", "t_end", "tolerance"),
    [
        ("coulomb-oscillator", 5.0, 1e-6),
        ("jenkins-cycle", 2.2, 1e-8),
        ("vibrating-table", 0.34, 1e-8),
        ("rocking-block", 3.0, 1e-7),
        ("diode-bridge", 1.5e-2, 1e-6),
        ("newtons-cradle", 0.3, 1e-9),
        ("maxwell-impact", 1.0, 1e-8),
        ("bilinear-oscillator", 3.0, 1e-6),
    ],
)
def test_all_that_it_handles_against_exact(name, t_end, tolerance):
    problem, dt = li.load_problem(name), t_end / 601
    run, truth = fesd(problem, dt=dt, t_end=t_end), exact(problem, dt=dt, t_end=t_end)
    assert happened(run) == happened(truth)
    for series in ("q", "v", "reaction"):
        expected = getattr(truth, series)
        assert_allclose(getattr(run, series), expected, rtol=0, atol=tolerance * np.abs(expected).max(initial=1e-300))


def test_bodies_at_rest_on_each_other():
    scheme = li.Scheme(
        li.Mass("a", 2.0),
        li.Mass("b", 3.0),
        li.Load("a", 20.0),
        li.Load("b", 30.0),
        li.Bumper("a", "b", e=0.3, name="R2"),
        li.Bumper("b", "ground", e=0.3, name="R1"),
    )
    for run in (fesd, plain):
        found = run(li.Problem("pile", scheme), t_end=1.0)
        assert found.events == ()
        assert_allclose(found["R1"], 50.0, rtol=1e-12)
        assert_allclose(found["R2"], 20.0, rtol=1e-12)
        assert_allclose(found.q, 0.0, atol=1e-14)


def test_samples_between_grid_points_and_on_both_sides_of_switches():
    problem = li.load_problem("system-1")
    run, truth = fesd(problem, dt=3.0 / 61, stages=5), exact(problem)
    t = np.linspace(0.0, 3.0, 1237)
    for name in ("q", "v", "reaction"):
        found, expected = getattr(run.sample(t), name), getattr(truth.sample(t), name)
        away = np.min(np.abs(t[:, None] - [event.t for event in truth.events]), axis=1) > 1e-9
        assert_allclose(found[away], expected[away], rtol=0, atol=1e-9 * np.abs(expected).max())
    close = run.events[1]
    assert run.sample(close.t, "left").reaction[0, 0] == 0.0 == close.left.reaction[0]
    assert_allclose(run.sample(close.t, "right").reaction[0], close.right.reaction, rtol=1e-13)
    assert close.right.reaction[0] > 100.0
    assert_allclose(run.sample(3.0).q[0], run.q[-1], rtol=1e-13)


def test_a_run_equals_its_whole_steps_taken_one_by_one():
    # Whole steps are taken together, as far as nothing is in doubt: the driver's blocks must not show.
    problem = li.load_problem("system-2")
    run, integrator = fesd(problem), RadauFESD()
    grid_steps = 300
    from lcpimpact.record import Grid, Record

    grid = Grid(3.0, grid_steps)
    record = Record(grid.times(0, 300), np.empty((301, 3)), np.empty((301, 3)), grid.times(0, 300), np.empty((301, 1)))
    carry = integrator.start(problem, grid, "auto", record)
    for k in range(grid_steps):
        assert integrator.advance(carry, record, k, k + 1) == (li.Status.SOLVED, k + 1)
    assert_allclose(record.q, run.q, rtol=0, atol=1e-12)
    assert_allclose(record.reaction, run.reaction, rtol=0, atol=1e-9)


def test_starved_newton_says_so_and_keeps_the_steps_before():
    problem = li.load_problem("system-1")
    run = fesd(problem, dt=0.3, max_newton=1, throw=False)
    assert run.status is li.Status.SWITCH
    assert run.t[-1] == pytest.approx(0.3)
    assert run.events == ()
    assert np.isfinite(run.q).all()
    with pytest.raises(li.FailureError, match=r"after step 1 .* raise max_newton"):
        fesd(problem, dt=0.3, max_newton=1)
    assert fesd(problem, dt=0.3).success


def test_max_events_is_a_status():
    run = fesd(li.load_problem("bouncing-ball", e=1.0), t_end=20.0, max_events=3, throw=False)
    assert run.status is li.Status.MAX_EVENTS
    assert len(run.events) == 3
    assert run.t[-1] >= run.events[-1].t
    # What happened within a step that was not finished is not reported.
    run = fesd(li.load_problem("bouncing-ball", e=0.5), dt=2.0, t_end=2.0, max_events=3, throw=False)
    assert run.status is li.Status.MAX_EVENTS
    assert run.events == ()
    assert_allclose(run.t, [0.0], atol=0.0)


def test_an_element_whose_equations_do_not_hold_is_not_accepted(monkeypatch):
    true = RadauIIA.stages
    monkeypatch.setattr(RadauIIA, "stages", lambda self, A, h, X: true(self, A, h * (1.0 + 1e-6), X))
    run = fesd(li.load_problem("system-1"), throw=False)
    assert run.status is li.Status.SWITCH
    assert len(run.t) == 1


def test_the_first_crossing_is_the_one_that_counts():
    # Rows 0, 1 and 2: above for ever, below after 0.75, below after 0.25; row 3 is below from the start.
    lines = np.array([[1.0 + 0.1 * i for i in range(6)], np.linspace(0.75, -0.25, 6), np.linspace(0.25, -0.75, 6)])
    zeros, safe, noise = np.zeros(3, dtype=np.int64), np.array([True, False, False]), np.full(3, 1e-12)
    row, where = first_crossing(lines, lines, safe, zeros, noise)
    assert row == 2
    assert_allclose(where, 0.25, rtol=1e-12)
    gone = np.vstack([lines, np.linspace(-0.1, -1.0, 6)])
    assert first_crossing(gone, gone, np.append(safe, False), np.zeros(4, dtype=np.int64), np.full(4, 1e-12)) == (
        3,
        0.0,
    )
    assert first_crossing(lines[:1], lines[:1], np.array([False]), zeros[:1], noise[:1]) is None


def test_what_is_not_handled_is_refused_by_name():
    with pytest.raises(li.UnsupportedError, match=r"radau-fesd does not handle non-linear springs"):
        fesd(li.load_problem("hertz-impact"))
    plate = li.Scheme(
        li.Mass("a", 1.0),
        li.Mass("b", 1.0),
        li.Load("a", 10.0),
        li.Spring("p", "ground", 100.0),
        li.Slider("a", "ground", r0=1.0),
        li.Bumper("a", "p", name="Ra"),
        li.Bumper("b", "p", name="Rb"),
    )
    with pytest.raises(li.UnsupportedError, match=r"Ra.*radau-fesd.*beside sliders.*moreau-jean"):
        fesd(li.Problem("plate", plate, v0={"a": 1.0, "b": 2.0}))


@settings(max_examples=15)
@given(e=st.floats(0.0, 1.0), h=st.floats(1e-3, 0.2), stages=st.integers(1, 5))
def test_energy_is_never_gained(e, h, stages):
    """Radau IIA is algebraically stable, and Newton's law gains nothing for e <= 1."""
    scheme = li.Scheme(
        li.Mass("a", 1.0),
        li.Mass("b", 2.0),
        li.Spring("a", "ground", 30.0),
        li.Spring("b", "ground", 10.0),
        li.Bumper("a", "b", gap=0.05, e=e, name="R1"),
        li.Bumper("b", "ground", gap=0.2, e=e, name="R2"),
    )
    problem = li.Problem("pair", scheme, v0={"a": 1.0, "b": 0.3})
    for run in (fesd, plain):
        found = run(problem, dt=h, t_end=200 * h, stages=stages, throw=False)
        assert found.ended or found.status is li.Status.MAX_EVENTS
        energy = problem.dynamics.energy(found.q, found.v)
        assert np.diff(energy).max() < 1e-12


# ---- radau ----------------------------------------------------------------------------------------------------------


def test_without_detection_the_order_is_lost_at_switches():
    smooth = li.Problem("contact", li.load_problem("system-1").scheme, v0={"x": 9.9}, t_end=0.5)
    assert_allclose(observed_order(smooth, "radau", (11, 13, 17, 23, 31, 43)).slope, 5.0, atol=0.2)
    many = (307, 367, 439, 541, 653, 773, 937, 1129, 1361, 1637, 1951, 2357, 2819)
    for known in KNOWN[:3]:
        found = observed_order(problem_of(known), "radau", many, 3.0)
        assert 1.5 < found.slope < 2.5
        fine = plain(problem_of(known), dt=3.0 / 307)
        detected = fesd(problem_of(known), dt=3.0 / 307)
        truth = exact(problem_of(known), dt=3.0 / 307)
        assert np.abs(fine.q - truth.q).max() > 1e3 * np.abs(detected.q - truth.q).max()


@pytest.mark.parametrize("stages", [1, 2, 4, 5])
def test_smooth_order_of_other_stages(stages):
    smooth = li.Problem("contact", li.load_problem("system-1").scheme, v0={"x": 9.9}, t_end=0.5)
    counts = {1: MANY, 2: FEW, 4: (7, 11, 13, 17, 19, 23), 5: (2, 3, 4, 5, 6, 7)}[stages]
    assert_allclose(observed_order(smooth, "radau", counts, stages=stages).slope, 2 * stages - 1, atol=0.25)


def test_order_one_across_impacts_without_detection():
    many = (307, 367, 439, 541, 653, 773, 937, 1129, 1361, 1637, 1951, 2357, 2819)
    for name, t_end in (("bouncing-ball", 2.5), ("impact-oscillator", 10.0)):
        assert_allclose(observed_order(li.load_problem(name), "radau", many, t_end, norm="l1_v").slope, 1.0, atol=0.35)


@pytest.mark.parametrize("e", [0.0, 0.5, 0.8])
def test_ball_comes_to_rest_without_detection(e):
    errors = []
    for steps in (1009, 4001):
        found = plain(li.load_problem("bouncing-ball", e=e), dt=5.0 / steps, t_end=5.0)
        errors.append(np.abs(found["x"] - closed_form(found.t, 9.81, 1.0, e)[0]).max())
        assert abs(found["v_x"][-1]) < 1e-12
        assert_allclose(found["R"][-1], 9.81, rtol=1e-10)
    assert errors[1] < 0.5 * errors[0] < 0.05
    first = found.events[0]
    assert first.kind == "impact"
    assert_allclose(first.t, np.sqrt(2.0 / 9.81), rtol=0, atol=5.0 / 4001)
    assert_allclose(first.impulse, (1 + e) * first.left.v[0], rtol=5e-3)
    assert found["R"].max() < 2.0 * 9.81


@pytest.mark.parametrize(
    ("name", "t_end", "tolerance"),
    [
        ("system-1", 3.0, 1e-4),
        ("system-2", 3.0, 1e-4),
        ("system-3", 3.0, 1e-4),
        ("coulomb-oscillator", 5.0, 5e-3),
        ("jenkins-cycle", 2.2, 1e-3),
        ("rocking-block", 1.0, 5e-2),
        ("diode-bridge", 1.5e-2, 1e-5),
        ("newtons-cradle", 0.3, 5e-3),
        ("maxwell-impact", 1.0, 1e-4),
        ("bilinear-oscillator", 3.0, 1e-3),
        ("bouncing-bar", 1.0, 2e-2),
    ],
)
def test_radau_on_all_that_it_handles(name, t_end, tolerance):
    problem = li.load_problem(name, **({"elements": 6.0} if name == "bouncing-bar" else {}))
    run, truth = plain(problem, dt=t_end / 1009, t_end=t_end), exact(problem, dt=t_end / 1009, t_end=t_end)
    assert np.abs(run.q - truth.q).max() < tolerance * np.abs(truth.q).max()
    assert run.stats.residual < 1e-9
    assert run.stats.lcp_solves > 0


def test_velocities_of_nodes_on_springs_follow_the_force():
    # y of System 2 has neither mass nor dashpot: its place holds R, and its velocity the rate of R.
    problem = li.load_problem("system-2")
    run, truth = plain(problem, dt=1e-3, t_end=0.9), exact(problem, dt=1e-3, t_end=0.9)
    assert_allclose(run["v_y"][2:], truth["v_y"][2:], rtol=0, atol=1e-4)


def test_forces_of_the_last_stage_do_not_ring():
    problem = li.load_problem("system-1")
    run = plain(problem, dt=1e-3, t_end=0.5)
    assert_allclose(run["R"], exact(problem, dt=1e-3, t_end=0.5)["R"][1:], rtol=0, atol=1e-6 * 5818.0)
    assert_allclose(run.t_reaction, run.t[1:], rtol=1e-15)


def test_another_solver_gives_the_same():
    for name, solver, stages in (
        ("system-2", "lemke", 3),
        ("coulomb-oscillator", "lemke", 2),
        ("three-balls", "qp:daqp", 1),
    ):
        problem = li.load_problem(name)
        one, other = (plain(problem, t_end=0.5, lcp_solver=each, stages=stages) for each in ("auto", solver))
        assert_allclose(other.q, one.q, rtol=0, atol=1e-8 * np.abs(one.q).max())
    # With more stages W is not symmetric, and there is no QP.
    with pytest.raises(li.UnsupportedError, match="symmetric"):
        plain(li.load_problem("system-2"), lcp_solver="qp:daqp")


@pytest.mark.parametrize("steps", [50, 100, 200, 400])
def test_what_the_waves_have_not_reached_yet_is_no_defect(steps):
    """Of ten masses at rest the last is shaken: the first hardly move for a while, which leaves them made of rounding."""
    elements = [li.Spring("m0", "ground", 400.0), li.Load("m9", li.Harmonic(5.0, 3.0)), li.Mass("m0", 1.0)]
    for i in range(1, 10):
        elements += [
            li.Mass(f"m{i}", 1.0),
            li.Spring(f"m{i - 1}", f"m{i}", 400.0),
            li.Dashpot(f"m{i - 1}", f"m{i}", 0.5),
        ]
    chain = li.Problem("chain", li.Scheme(*elements))
    found = li.simulate(chain, "radau-fesd", dt=3.0 / steps, t_end=3.0)
    truth = li.simulate(chain, "exact", dt=3.0 / steps, t_end=3.0)
    assert np.abs(found.q - truth.q).max() < 2e-3 * (50.0 / steps) ** 4
