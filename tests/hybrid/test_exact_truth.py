"""Motions whose truth is known in closed form, on which `exact` must not lose a digit."""

import math

import mpmath
import numpy as np
import pytest
from event_reference import Reference
from numpy.testing import assert_allclose
from schemes import column, plate_beside_an_impact
from scipy.optimize import brentq

import lcpimpact as li
from lcpimpact.errors import Status
from lcpimpact.hybrid.flow import Flow
from lcpimpact.numerics.double_double import DoubleDouble


def run_exact(problem, dt, t_end, **options):
    return li.simulate(problem, "exact", dt=dt, t_end=t_end, throw=False, **{"max_events": 3000} | options)


@pytest.mark.parametrize("t_end", [100.0, pytest.param(1000.0, marks=pytest.mark.slow)])
def test_bodies_that_a_force_holds_together_do_not_part_because_another_bounces(t_end):
    scheme = li.Scheme(
        li.Mass("a", 1.3), li.Load("a", 30.0),
        li.Mass("b", 2.1), li.Spring("b", "ground", 170.3),
        li.Bumper("a", "b", gap=0.0, e=0.5, name="R"),
        li.Mass("c", 1.0), li.Spring("c", "ground", 0.3),
        li.Bumper("c", "ground", gap=0.5, e=1.0, name="G"),
    )  # fmt: skip
    problem = li.Problem("three", scheme, q0={"a": 0.1, "b": 0.1}, v0={"a": 0.9, "b": 0.9, "c": 1.0})
    run = run_exact(problem, 0.5, t_end)
    assert run.success
    # Alone, c swings against its stop with a fixed period.
    ω = math.sqrt(0.3)
    first, period = math.asin(0.5 * ω) / ω, (math.pi + 2.0 * math.asin(0.5 * ω)) / ω
    assert {(each.kind, each.contact) for each in run.events} == {("impact", "G")}
    assert_allclose(
        [each.t for each in run.events], first + period * np.arange(len(run.events)), rtol=0, atol=1e-12 * t_end
    )
    assert len(run.events) == 1 + int((t_end - first) / period)
    # a and b are one oscillator.
    Ω = math.sqrt(170.3 / 3.4)
    rest = 30.0 / 170.3
    x = rest + (0.1 - rest) * np.cos(Ω * run.t) + 0.9 / Ω * np.sin(Ω * run.t)
    acceleration = -(Ω**2) * (x - rest)
    assert_allclose(run["a"], x, rtol=0, atol=1e-12 * max(t_end, 100.0) / 10.0)
    assert_allclose(run["b"], run["a"], rtol=0, atol=1e-14)
    assert_allclose(run["R"], 30.0 - 1.3 * acceleration, rtol=0, atol=1e-9)


def test_a_plate_that_is_pressed_down_stays_down_beside_an_impact():
    problem = plate_beside_an_impact()
    run = run_exact(problem, 0.05, 2.0)
    assert run.success
    assert [(each.kind, each.contact) for each in run.events] == [("impact", "S")]
    assert_allclose(run.events[0].t, 0.5329687861794, rtol=0, atol=1e-12)
    truth = Reference(problem, 2.0)
    assert_allclose(run.events[0].t, float(truth.events[0].t), rtol=1e-13)
    assert (run["F"] > 0.0).all()
    assert_allclose(run["p"], 0.0, atol=1e-15)


def test_radau_fesd_keeps_the_plate_down_too():
    run = li.simulate(plate_beside_an_impact(), "radau-fesd", dt=0.01, t_end=1.0, throw=False)
    assert run.success
    assert [each.contact for each in run.events] == ["S"]
    assert_allclose(run.events[0].t, 0.5329687861794, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("m", "k", "T"),
    [(1.0, 50.0, 1e4), (1.0, 5e5, 100.0), (3.0, 50.0, 1e4), (3.0, 5e5, 100.0), (3.0, 50.0, 1e5), (0.7, 1234.5, 1e5)],
)
def test_bodies_joined_by_a_spring_fly_to_a_wall_in_time(m, k, T):
    scheme = li.Scheme(
        li.Mass("a", m), li.Mass("b", 1.0), li.Spring("a", "b", k), li.Bumper("b", "ground", gap=T, e=0.5)
    )
    problem = li.Problem("flight", scheme, v0={"a": 1.0, "b": 1.0})
    run = run_exact(problem, T / 100.0, 1.01 * T)
    assert run.success
    flown = run.t <= T
    assert_allclose(run.q[flown], np.column_stack([run.t, run.t])[flown], rtol=0, atol=1e-12 * T)
    assert_allclose(run.events[0].t, T, rtol=1e-12)
    assert_allclose(run.events[0].impulse, 1.5, rtol=1e-12)
    truth = Reference(problem, 1.01 * T)
    # The reference follows an accumulation to flights of 1e-30 s; floats tell no instants apart below their last digit.
    limits = [float(limit) for limit, _ in truth.accumulations]
    told, known = (
        [float(each.t) for each in events if all(abs(float(each.t) - limit) > 1e-11 * T for limit in limits)]
        for events in (run.events, truth.events)
    )
    assert_allclose(told, known, rtol=1e-12)


def test_bodies_that_turn_slowly_about_each_other_do_not_drift_from_a_wall_behind():
    """Three bodies on two springs, one at an end set swinging: their centre of mass flies on for 1e5 s."""
    scheme = li.Scheme(
        li.Mass("a", 1.0), li.Mass("b", 2.0), li.Mass("c", 1.5),
        li.Spring("a", "b", 40.0), li.KelvinVoigt("b", "c", 30.0, 0.5),
    )  # fmt: skip
    run = run_exact(li.Problem("train", scheme, v0={"a": 4.5}), 1e3, 1e5)
    assert run.success
    assert_allclose(run.q @ [1.0, 2.0, 1.5] / 4.5, run.t, rtol=0, atol=1e-12 * 1e5)


def test_three_bodies_that_collapse_end_together():
    problem = column((1.0, 1.0, 1.0), (1.0, 1.0), (1.0, 0.0, -0.5), 0.05)
    run = run_exact(problem, 0.1, 4.0)
    assert run.success
    assert_allclose(run.v[-1], 1 / 6, rtol=0, atol=1e-12)
    assert_allclose(run.q[-1] - [1.0, 0.0, -1.0], run.q[-1][1], rtol=0, atol=1e-12)
    limit = float(Reference(problem, 4.0).accumulations[0][0])
    assert max(each.t for each in run.events) == pytest.approx(limit, abs=1e-12)


def impacts_of_a_pair(m, a, h, e, count):
    """Two bodies fall together, the lower one faster: impacts on the floor (e) and, plastic, of the pair, in 300 digits.

    Each pair of impacts slows them, and the next gap between them is about the square of the last.
    """
    with mpmath.workdps(300):
        m1, m2, a1, a2, h, e = map(mpmath.mpf, (*m, *a, h, e))
        t, apart, above, v1, v2 = mpmath.mpf(0), mpmath.mpf(0), h, mpmath.mpf(0), mpmath.mpf(0)
        found = []
        for _ in range(count):
            flight = 2 * above / (v2 + mpmath.sqrt(v2**2 + 2 * a2 * above))
            apart += (v2 - v1) * flight + (a2 - a1) * flight**2 / 2
            t, v1, v2 = t + flight, v1 + a1 * flight, -e * (v2 + a2 * flight)
            found.append((t, "floor", v1, v2))
            closing = v1 - v2
            flight = 2 * apart / (closing + mpmath.sqrt(closing**2 - 2 * (a2 - a1) * apart))
            above = -v2 * flight - a2 * flight**2 / 2
            t, v1, v2 = t + flight, v1 + a1 * flight, v2 + a2 * flight
            v1 = v2 = (m1 * v1 + m2 * v2) / (m1 + m2)
            apart = mpmath.mpf(0)
            found.append((t, "pair", v1, v2))
        return [(float(t), contact, float(v1), float(v2)) for t, contact, v1, v2 in found]


@pytest.mark.parametrize("method", ["exact", "event-driven", "radau-fesd"])
@pytest.mark.parametrize(("m", "e"), [((3.0, 1.0), 1.0), ((10.0, 1.0), 1.0), ((3.0, 1.0), 0.5)])
def test_plates_that_a_force_has_parted_by_less_than_rounding_take_no_part_in_an_impact(method, m, e):
    """After six impacts the gap between them is rounding; were they one body, both would rebound from the floor."""
    a, h = (9.0, 10.0), 1.0
    bodies = [li.Mass("x", m[0]), li.Load("x", m[0] * a[0]), li.Mass("y", m[1]), li.Load("y", m[1] * a[1])]
    contacts = li.Bumper("y", "ground", gap=h, e=e, name="floor"), li.Bumper("x", "y", e=0.0, name="pair")
    run = li.simulate(li.Problem("pair", li.Scheme(*bodies, *contacts)), method, dt=1e-2, t_end=1.0)
    impacts = [event for event in run.events if event.kind == "impact"]
    true = impacts_of_a_pair(m, a, h, e, 8)
    assert run.success
    for event, (t, contact, *v) in zip(impacts, true, strict=False):
        assert event.contact == contact
        assert event.t == pytest.approx(t, rel=1e-8)
        assert_allclose(event.right.v, v, rtol=1e-6)
    after = run.t > true[-1][0] + 1e-9
    assert len(impacts) > len(true)
    assert_allclose(run["x"][after], h, rtol=1e-12)
    assert_allclose(run["y"][after], h, rtol=1e-12)


@pytest.mark.parametrize("e", [0.06, 0.05, 0.04, 0.02])
@pytest.mark.parametrize("method", ["exact", "event-driven"])
def test_a_contact_that_only_passes_impulses_on_takes_part_in_a_collapse(method, e):
    """The middle one of three equal bodies is two halves that touch: what hits one of them hits both."""
    scheme = li.Scheme(
        li.Mass("a", 1.0),
        li.Mass("b", 0.5),
        li.Mass("c", 0.5),
        li.Mass("d", 1.0),
        li.Bumper("a", "b", gap=1.0, e=e),
        li.Bumper("b", "c", e=0.0),
        li.Bumper("c", "d", gap=1.0, e=e),
    )
    problem = li.Problem("halves", scheme, v0={"a": 1.0, "d": -0.5})
    run = li.simulate(problem, method, dt=0.1, t_end=6.0)
    # All end together, with the momentum and the centre of mass that they had.
    centre = 6.0 / 6.0
    assert_allclose(run.v[-1], 1.0 / 6.0, rtol=0, atol=1e-12)
    assert_allclose(run.q[-1], [1.0 + centre, centre, centre, centre - 1.0], rtol=0, atol=1e-12)


@pytest.mark.parametrize("seed", [9, 14, 34, 51, 77])
def test_four_unequal_bodies_whose_impacts_repeat_in_no_pattern_are_followed(seed):
    rng = np.random.default_rng(seed)
    m, e = 10.0 ** rng.uniform(-1.0, 1.0, 4), rng.uniform(0.02, 0.3, 3)
    scheme = li.Scheme(
        *(li.Mass(node, each) for node, each in zip("abcd", m, strict=True)),
        *(
            li.Bumper(*pair, gap=rng.uniform(0.1, 1.0), e=each)
            for pair, each in zip(("ab", "bc", "cd"), e, strict=True)
        ),
    )
    v0 = dict(zip("abcd", np.sort(rng.uniform(-1.0, 1.0, 4))[::-1].tolist(), strict=True))
    problem = li.Problem("four", scheme, v0=v0)
    run, truth = run_exact(problem, 0.1, 20.0), Reference(problem, 20.0)
    assert run.success, run.message
    _, v, _ = truth.at(19.9)
    assert_allclose(run.v[199], [float(each) for each in v], rtol=0, atol=1e-11)


def test_three_bodies_meet_eleven_times_at_e_of_8_per_cent():
    run = run_exact(column((1.0, 1.0, 1.0), (1.0, 1.0), (1.0, 0.0, -0.5), 0.08), 0.5, 20.0)
    assert run.success
    assert len(run.events) == 11
    # At e = 2/25 it is 10.90824943252093; what 0.08 is in binary moves it by 4e-13.
    assert_allclose(run.events[-1].t, 10.908249432521288, rtol=0, atol=1e-11)


@pytest.mark.parametrize("e", [0.05, 0.15, 0.17])
def test_four_bodies_that_collapse_come_to_rest(e):
    run = run_exact(column((1.0, 1.0, 1.0, 1.0), (1.0, 1.0, 1.0), (1.0, 0.0, 0.0, -1.0), e), 0.1, 6.0)
    assert run.success
    assert_allclose(run.v[-1], 0.0, atol=1e-12)
    # By symmetry they meet where the middle of the four was.
    assert_allclose(run.q[-1], [1.5, 0.5, -0.5, -1.5], rtol=0, atol=1e-12)


@pytest.mark.parametrize("e", [0.18, 0.3])
def test_four_bodies_part_above_3_minus_2_sqrt_2(e):
    problem = column((1.0, 1.0, 1.0, 1.0), (1.0, 1.0, 1.0), (1.0, 0.0, 0.0, -1.0), e)
    run = run_exact(problem, 1.0, 200.0)
    truth = Reference(problem, 200.0)
    assert run.success
    assert not truth.accumulations
    assert_allclose([each.t for each in run.events], [float(each.t) for each in truth.events], rtol=1e-12)
    _, v, _ = truth.at(200.0)
    assert_allclose(run.v[-1], [float(each) for each in v], rtol=0, atol=1e-12)


def repeating(pattern, e):
    """Gaps and velocities of four equal bodies from which impacts repeat the pattern for ever, with the limit t_inf.

    The rates w of the gaps after one round of the pattern are λ w, and the times between impacts μ times as long:
    every gap is zero at each of its impacts, which is one linear equation for the six times of a round each.
    """
    rows = ["RST".index(name) for name in pattern]
    hits = []
    for i in rows:
        hit = np.eye(3)
        hit[i, i] = -e
        hit[[j for j in (i - 1, i + 1) if 0 <= j < 3], i] = 0.5 * (1.0 + e)
        hits.append(hit)
    values, vectors = np.linalg.eig(np.linalg.multi_dot(hits[::-1]))
    λ, w = values.real.max(), vectors[:, np.argmax(values.real)].real
    w = -w * np.sign(w[rows[0]])
    rates = list(np.array([np.linalg.multi_dot([np.eye(3), *hits[k::-1], w]) for k in range(len(rows))]))

    def meeting(i, μ, first):
        """How far gap i closes until its next impact: the factor of each time of a round."""
        found, n = np.zeros(len(rows)), len(rows)
        for k in range(first, first + 3 * n):
            found[k % n] += rates[k % n][i] * (λ * μ) ** (k // n)
            if rows[(k + 1) % n] == i:
                return found
        raise AssertionError

    def equations(μ):
        return np.array([meeting(i, μ, k) for k, i in enumerate(rows)])

    guesses = np.geomspace(1e-7, 1.0, 2000)
    signs = np.sign([np.linalg.det(equations(μ)) for μ in guesses])
    first = int(np.flatnonzero(signs[1:] != signs[:-1])[0])
    μ = brentq(lambda μ: np.linalg.det(equations(μ)), guesses[first], guesses[first + 1], xtol=1e-300, rtol=1e-15)
    times = np.linalg.svd(equations(μ))[2][-1]
    times = times / times[0]
    gaps = -w - np.array([0.0 if i == rows[0] else meeting(i, μ, 0) @ times for i in range(3)])
    v = np.cumsum([0.0, *w])
    return gaps, v - v.mean(), times, 1.0 + times.sum() / (1.0 - μ)


@pytest.mark.parametrize("e", [0.05, 0.09, 0.1, 0.101])
def test_impacts_that_repeat_ababcb_accumulate_below_5_minus_2_sqrt_6(e):
    gaps, v, times, limit = repeating("RSRSTS", e)
    assert (times > 0.0).all()
    problem = column((1.0, 1.0, 1.0, 1.0), gaps.tolist(), v.tolist(), e)
    run = run_exact(problem, limit / 10.0, 2.0 * limit)
    assert "".join(each.contact for each in run.events[:18]) == 3 * "RSRSTS"
    assert_allclose(max(each.t for each in run.events), limit, rtol=1e-11)
    # The pattern is unstable: rounding of the start may lead to another, or leave no order that `exact` can follow.
    assert run.success or run.status is Status.ACCUMULATION
    if run.success:
        _, v, _ = Reference(problem, 2.0 * limit).at(1.9 * limit)
        assert_allclose(run.v[-1], [float(each) for each in v], rtol=0, atol=1e-12)


def test_no_impacts_repeat_ababcb_above_5_minus_2_sqrt_6():
    above = 5.0 - 2.0 * math.sqrt(6.0) + 1e-4
    assert (repeating("RSRSTS", above)[2] < 0.0).any()


def test_a_stiff_plate_with_a_rate_of_1e9_has_one_event():
    scheme = li.Scheme(
        li.Mass("x", 1.0),
        li.Load("x", 9.81),
        li.Bumper("x", "z", gap=0.01),
        li.KelvinVoigt("z", "ground", k=1e12, c=1e3),
    )
    problem = li.Problem("stiff", scheme)
    run = run_exact(problem, 0.01, 0.2, max_events=1000)
    truth = Reference(problem, 0.2)
    assert run.success
    assert [each.kind for each in run.events] == [each.kind for each in truth.events]
    assert_allclose([each.t for each in run.events], [float(each.t) for each in truth.events], rtol=1e-12)


@pytest.mark.slow
def test_a_stiff_plate_with_a_stop_a_nanometre_below_it():
    """Flights are parabolas and contacts an oscillator of 1 MHz; both were joined once in arithmetic of 50 digits."""
    scheme = li.Scheme(
        li.Mass("x", 1.0),
        li.Load("x", 9.81),
        li.Bumper("x", "z", gap=0.01, e=0.5, name="R"),
        li.KelvinVoigt("z", "ground", k=1e12, c=1e3),
        li.Bumper("z", "ground", gap=1e-9, e=0.5, name="S"),
    )
    run = run_exact(li.Problem("nanometre", scheme), 0.01, 0.2)
    kinds = [each.kind for each in run.events]
    assert (kinds.count("close"), kinds.count("open"), kinds.count("impact")) == (439, 439, 26)
    assert run.events[-1].t == pytest.approx(0.19993411911671078, rel=1e-14)
    assert run["x"][-1] == pytest.approx(0.0099999882756354962, rel=1e-12)
    assert run["v_x"][-1] == pytest.approx(0.00014517505219247599, rel=1e-9)


def test_the_instants_that_show_a_flow_grow_with_rates_only_until_they_have_decayed():
    turning = [[0.0, 0.0, -1.0], [0.0, -1e9, 0.0], [1.0, 0.0, 0.0]]
    flow = Flow(DoubleDouble.of(turning), 10.0)
    cuts, little = flow.cuts(10.0, 4000)
    assert len(cuts) < 150
    assert little.all()
    assert (np.diff(np.append(cuts, 10.0)) <= np.where(np.append(cuts[1:], 10.0) <= 4e-8, 1e-9, 1.0)).all()


def test_of_too_many_oscillations_some_windows_show_a_flow():
    undamped = Flow(DoubleDouble.of([[0.0, 1e9, 0.0], [-1e9, 0.0, 0.0], [0.0, 0.0, -1.0]]), 10.0)
    cuts, little = undamped.cuts(10.0, 4000)
    lengths = np.diff(np.append(cuts, 10.0))
    assert 1500 < little.sum() < 4000
    assert_allclose(lengths[little], undamped.window, rtol=1e-5)
    assert lengths[~little].sum() > 9.99
    every, little = undamped.cuts(1e-6, 4000)
    assert little.all()
    assert_allclose(np.diff(every), every[1], rtol=1e-12)
    assert every[1] <= undamped.window


@pytest.mark.parametrize("t_end", [10.0, 1000.0])
def test_a_long_oscillation_is_certified_and_another_spring_found_out(t_end):
    def column(k):
        return li.Problem(
            "high",
            li.Scheme(li.Mass("a", m=1.0), li.Spring("a", "ground", k=k), li.Bumper("a", "ground", gap=1.0, e=0.5)),
            q0={"a": 0.1},
        )

    run = run_exact(column(1e6), t_end / 100.0, t_end)
    t = run.t
    assert_allclose(run["a"], 0.1 * np.cos(1000.0 * t), atol=1e-15 * 1000.0 * t_end)
    assert run.certify().holds
    assert run.certify(column(1.001e6)).failures


def test_a_body_that_an_impact_stops_where_no_force_acts_on_it_stays_closed_or_open_for_good():
    # Each impact of the ball presses the plate to the ground, at e = 0 for it, and its spring has its neutral length there.
    scheme = li.Scheme(
        li.Mass("b0", m=1.0359261983442176),
        li.Spring("b0", "ground", k=86.72051309760138),
        li.Mass("b1", m=2.0843309834538797),
        li.Spring("b1", "ground", k=224.86356353857911),
        li.Bumper("b0", "b1", e=0.368280954659927, name="R0"),
        li.Bumper("b1", "ground", e=0.3673708440498272, name="R1"),
    )
    problem = li.Problem("pressed", scheme, v0={"b0": 3.0827685319739304, "b1": -2.331311912369221})
    run = run_exact(problem, 0.1, 3.9)
    half = math.pi * math.sqrt(1.0359261983442176 / 86.72051309760138)
    assert_allclose([each.t for each in run.events], np.repeat(half * np.arange(12), 2), rtol=1e-14)
    assert {each.kind for each in run.events} == {"impact"}
    assert_allclose(run["b1"], 0.0, atol=1e-30)


def heavy_on_light(ratio):
    """A mass ``ratio`` falls 0.1 m behind a mass of 1 kg, whose floor is 1 m below it; nothing rebounds."""
    scheme = li.Scheme(
        li.Mass("x", m=1.0), li.Load("x", f=9.81), li.Bumper("x", "ground", gap=1.0, e=0.0, name="F"),
        li.Mass("y", m=ratio), li.Load("y", f=9.81 * ratio), li.Bumper("y", "x", gap=0.0, e=0.0, name="R"),
    )  # fmt: skip
    return li.Problem("heavy on light", scheme, q0={"y": -0.1})


@pytest.mark.parametrize("ratio", [1e9, 1e12])
@pytest.mark.parametrize("method", ["exact", "event-driven", "radau-fesd"])
def test_a_heavy_body_lands_on_a_light_one(method, ratio):
    """Floats know the impulses between them to 16 digits, which are 1e-16 of the ratio of the velocity of the light one."""
    run = li.simulate(heavy_on_light(ratio), method, dt=0.1, t_end=1.0)
    assert_allclose(run.q[-1], 1.0, rtol=1e-8)
    assert_allclose(run.v[-1], 0.0, atol=1e-15)
    assert_allclose([run["R"][-1], run["F"][-1]], [9.81 * ratio, 9.81 * (ratio + 1.0)], rtol=1e-13)
    impacts = {event.contact: event for event in run.events if event.kind == "impact"}
    assert_allclose(impacts["R"].t, math.sqrt(2.2 / 9.81), rtol=1e-8)
    assert_allclose(impacts["R"].impulse, ratio * math.sqrt(2.2 * 9.81), rtol=1e-8)


@pytest.mark.parametrize(("method", "ratio"), [("moreau-jean", 1e9), ("moreau-jean", 1e15), ("exact", 1e15)])
def test_masses_that_floats_cannot_hold_together_are_named(method, ratio):
    run = li.simulate(heavy_on_light(ratio), method, dt=0.01, t_end=1.0, throw=False)
    assert run.status is Status.INACCURATE
    assert f"masses of bodies with contacts differ by a factor of {ratio:.0e}" in run.message
    assert ("take method='exact'" in run.message) == (ratio < 1e13)
