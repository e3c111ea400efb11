"""The event simulator of `event_reference` against closed forms, rational arithmetic and conservation laws."""

import math
from fractions import Fraction

import numpy as np
import pytest
from event_reference import Reference, collide
from numpy.testing import assert_allclose
from schemes import column

import lcpimpact as li


def test_three_bodies_meet_eleven_times_at_e_of_8_per_cent():
    impacts, _, v = collide([1, 1, 1], [0, 1, 2], [1, 0, Fraction(-1, 2)], Fraction(2, 25))
    assert len(impacts) == 11
    assert_allclose(float(impacts[-1][0]), 10.90824943252093, rtol=0, atol=1e-14)
    assert sum(v) == Fraction(1, 2)
    assert v[0] < v[1] < v[2]


def test_three_bodies_collapse_below_7_minus_4_sqrt_3():
    start = [1, 1, 1], [0, 1, 2], [1, 0, Fraction(-1, 2)]
    below, above = 7 - 4 * math.sqrt(3) - 1e-4, 7 - 4 * math.sqrt(3) + 1e-4
    impacts, x, v = collide(*start, below, most=150)
    assert len(impacts) == 150
    assert_allclose([float(each) for each in v], 1 / 6, rtol=0, atol=1e-40)
    assert_allclose([float(each) for each in x], float(x[0]), rtol=0, atol=1e-40)
    assert len(collide(*start, above, most=150)[0]) < 150


def test_four_bodies_collapse_below_3_minus_2_sqrt_2():
    # The outer ones come towards each other at one speed: the middle pair is a wall to each side.
    start = [1, 1, 1, 1], [0, 1, 2, 3], [1, 0, 0, -1]
    impacts, _, v = collide(*start, 3 - 2 * math.sqrt(2) - 1e-3, most=200)
    assert len(impacts) == 200
    assert_allclose([float(each) for each in v], 0, atol=1e-40)
    assert len(collide(*start, 3 - 2 * math.sqrt(2) + 1e-3, most=200)[0]) < 200


@pytest.mark.parametrize("e", [0.3, 0.5, 0.9, 1.0])
@pytest.mark.parametrize("masses", [(1.0, 1.0, 1.0), (0.7, 2.1, 1.3, 0.9)])
def test_without_forces_it_is_what_fractions_say(masses, e):
    gaps = (1.0, 0.75, 0.5)[: len(masses) - 1]
    speeds = (1.0, 0.125, -0.5, -2.0)[: len(masses)]
    # The places of bodies that touch where x_1 = x_2, counted from the gaps.
    places = [Fraction(0)]
    for gap in gaps:
        places.append(places[-1] + Fraction(gap))
    impacts, x, v = collide(masses, places, speeds, e)
    last = float(impacts[-1][0])
    found = Reference(column(masses, gaps, speeds, e), last + 1.0)
    assert [each.contact for each in found.events] == ["RST"[i] for _, i in impacts]
    assert_allclose([float(each.t) for each in found.events], [float(t) for t, _ in impacts], rtol=1e-15)
    q, velocities, r = found.at(last + 1.0)
    ends = [float(place - start + speed) for place, start, speed in zip(x, places, v, strict=True)]
    assert_allclose(q, ends, rtol=1e-14, atol=1e-14)
    assert_allclose(velocities, [float(each) for each in v], rtol=1e-15)
    assert_allclose(r, 0.0, atol=0.0)


def test_three_bodies_that_collapse_go_on_together():
    found = Reference(column((1.0, 1.0, 1.0), (1.0, 1.0), (1.0, 0.0, -0.5), 0.05), 4.0)
    ((t, names),) = found.accumulations
    assert names == ("R", "S")
    # With the speed 1/6 of the centre of mass, at 1 for the first: where R and S close, it is at 1 + (t - 1)/6 + ...
    q, v, _ = found.at(4.0)
    assert_allclose(v, 1 / 6, rtol=0, atol=1e-15)
    assert_allclose(q[0] - 1.0, q[1], rtol=0, atol=1e-15)
    assert_allclose(q[1] - 1.0, q[2], rtol=0, atol=1e-15)
    assert_allclose(q.sum(), 0.5 * 4.0, rtol=1e-15)
    assert 1.0 < float(t) < 2.0


@pytest.mark.parametrize("e", [0.0, 0.5, 0.8])
def test_a_bouncing_ball_comes_to_rest_at_the_sum_of_its_flights(e):
    found = Reference(li.load_problem("bouncing-ball", g=9.81, H=1.0, e=e), 5.0)
    fall = math.sqrt(2.0 / 9.81)
    impacts = [each for each in found.events if each.kind == "impact"]
    closed_form = [fall * (1.0 + 2.0 * sum(e**k for k in range(1, n + 1))) for n in range(len(impacts))]
    assert_allclose([float(each.t) for each in impacts], closed_form, rtol=1e-15)
    assert_allclose([float(each.impulse) for each in impacts][:40],
                    [(1.0 + e) * e**n * 9.81 * fall for n in range(len(impacts))][:40], rtol=1e-14)  # fmt: skip
    assert found.events[-1].kind == "close"
    assert_allclose(float(found.events[-1].t), fall * (1.0 + e) / (1.0 - e), rtol=1e-15)
    q, v, r = found.at(5.0)
    assert (q[0], v[0], r[0]) == (1.0, 0.0, 9.81)


def test_an_oscillator_against_a_wall_keeps_its_period():
    ω, gap = 1.7, 0.3
    scheme = li.Scheme(
        li.Mass("x", 1.0), li.Spring("x", "ground", ω**2), li.Bumper("x", "ground", gap=gap, e=1.0)
    )  # fmt: skip
    found = Reference(li.Problem("wall", scheme, v0={"x": 1.0}), 30.0)
    k = math.sqrt(ω**2)
    first = math.asin(gap * k) / k
    period = (math.pi + 2.0 * math.asin(gap * k)) / k
    assert_allclose([float(each.t) for each in found.events], first + period * np.arange(len(found.events)), rtol=1e-15)
    assert len(found.events) == 1 + int((30.0 - first) / period)


def test_systems_1_to_3_against_digits_of_40_digit_arithmetic():
    for known in li.problems.reference.KNOWN:
        found = Reference(li.load_problem(known.problem, **known.parameters), 3.0)
        assert [each.kind for each in found.events] == list(known.kinds[: len(known.switches)])
        assert_allclose([float(each.t) for each in found.events], known.switches, rtol=1e-15)


def test_a_plate_that_bottoms_out_leaves_with_e():
    """A body on a plate on a Kelvin-Voigt block, whose stop is hit: the impulse of both rows turns the body round."""
    e = 0.0

    def flow(stop):
        elements = [li.Mass("x", m=100.0), li.Load("x", f=981.0), li.Bumper("x", "z", e=e if stop else None, name="R")]
        elements += [li.KelvinVoigt("z", "ground", k=3924.0, c=250.0)]
        elements += [li.Bumper("z", "ground", gap=0.5, e=e, name="S")] if stop else []
        return Reference(li.Problem("buffer", li.Scheme(*elements), v0={"x": 9.9}), 0.4)

    met = flow(True)
    t = float(met.events[0].t)
    q, v, _ = flow(False).at(t)
    assert_allclose(q[0], 0.5, rtol=1e-14)
    assert [(each.kind, each.contact) for each in met.events[:2]] == [("impact", "R"), ("impact", "S")]
    assert_allclose([float(each.impulse) for each in met.events[:2]], 100.0 * (1.0 + e) * v[0], rtol=1e-14)


def test_two_bodies_that_fly_together_arrive_on_time():
    scheme = li.Scheme(
        li.Mass("a", 3.0), li.Mass("b", 1.0), li.Spring("a", "b", 5e5), li.Bumper("b", "ground", gap=1e5, e=0.5)
    )
    found = Reference(li.Problem("flight", scheme, v0={"a": 1.0, "b": 1.0}), 100_000.0001)
    assert float(found.events[0].t) == 1e5


def test_energy_of_four_elastic_bodies_is_kept():
    problem = column((1.0, 2.0, 0.5, 1.5), (0.1, 0.2, 0.3), (2.0, 0.5, 0.0, -1.0), 1.0)
    found = Reference(problem, 10.0)
    _, v, _ = found.at(10.0)
    m = np.array([1.0, 2.0, 0.5, 1.5])
    start = np.array([2.0, 0.5, 0.0, -1.0])
    assert_allclose(m @ v**2, m @ start**2, rtol=1e-15)
    assert_allclose(m @ v, m @ start, rtol=1e-15)
