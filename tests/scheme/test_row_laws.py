"""A row law that the package does not have, in an element of its own: the methods take it as it stands, by closed forms."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq

import lcpimpact as li
from lcpimpact.integrators import METHODS
from lcpimpact.scheme.elements.base import Link, distinct
from lcpimpact.scheme.laws import RowLaw
from lcpimpact.scheme.structure import Feature
from lcpimpact.scheme.terms import Row

FREEWHEEL = RowLaw("freewheel", of_rate=True, at_bound="overrun", between="engage")


@dataclass(frozen=True)
class Freewheel(Link):
    """0 <= T ⟂ v_b - v_a >= 0: the ends may part at any rate, and never come nearer."""

    a: str
    b: str
    name: str | None = None
    symbols: tuple[str, ...] = ()

    reaction: ClassVar[str] = "T"

    def __post_init__(self):
        distinct(self)

    @property
    def ends(self):
        return self.a, self.b

    def contribute(self, terms):
        terms.rows.append(Row(str(self), self.name or self.reaction, self.a, self.b, 0.0, law=FREEWHEEL))


BRAKE = RowLaw("one-way brake", of_rate=True, at_bound="slip", between="stick")


@dataclass(frozen=True)
class Brake(Link):
    """0 <= F <= r0, complementary to v_b - v_a: friction against coming nearer alone."""

    a: str
    b: str
    r0: float
    name: str | None = None
    symbols: tuple[str, ...] = ("r_0",)

    reaction: ClassVar[str] = "F"

    def __post_init__(self):
        distinct(self)

    @property
    def ends(self):
        return self.a, self.b

    def contribute(self, terms):
        name, bounds = self.name or self.reaction, (0.0, self.r0)
        terms.rows.append(Row(str(self), name, self.a, self.b, 0.0, law=BRAKE, bounds=bounds))


TAKE_RATES = [name for name in METHODS if Feature.SLIDERS in METHODS[name].declared.handles]
LOCATE = ("exact", "radau-fesd", "event-driven")
"""The methods that locate events."""


def run(method, *elements, t_end=1.0, **start):
    problem = li.Problem("row law", li.Scheme(*elements), t_end=t_end, **start)
    return li.simulate(problem, method, dt=1e-3, throw=False, error=False)


def near(run, q, v, method):
    """Assert the end of a run, if it is called solved: to rounding of located events, else to the order of the step."""
    assert run.status in (li.Status.SOLVED, li.Status.VIOLATED)
    if method not in ("cd-lagrange", "schatzman-paoli"):
        assert run.status is li.Status.SOLVED, run.certificate.failures
    if run.status is li.Status.SOLVED:
        tolerance = 1e-6 if method in LOCATE else 2e-3
        assert_allclose(run.q[-1], q, rtol=0.0, atol=tolerance)
        assert_allclose(run.v[-1], v, rtol=0.0, atol=5.0 * tolerance)


def events(run):
    return [(event.kind, event.contact) for event in run.events]


@pytest.mark.parametrize("method", TAKE_RATES)
def test_a_freewheel_holds_a_spring_that_it_let_pass(method):
    """X = -cos ω t until it turns, and then the force of the spring for ever."""
    elements = li.Mass("x", 1.0), li.Spring("x", "ground", k=100.0), Freewheel("ground", "x")
    found = run(method, *elements, q0={"x": -1.0})
    near(found, [1.0], [0.0], method)
    assert_allclose(found.reaction[-1], [100.0], rtol=1e-4)
    assert events(found) == [("engage", "T")]
    assert_allclose(found.events[0].t, math.pi / 10.0, rtol=0.0, atol=1e-9 if method in LOCATE else 1e-3)


@pytest.mark.parametrize("method", TAKE_RATES)
def test_a_freewheel_is_a_wall_to_one_side_and_nothing_to_the_other(method):
    """A ball on a block of twice its mass, e = 1/2: free, v = (0, 1/2); against the freewheel, the rebound from a wall."""
    ball, block = li.Mass("b", 1.0), li.Mass("x", 2.0)
    freed = run(
        method,
        ball,
        block,
        li.Bumper("b", "x", e=0.5),
        Freewheel("ground", "x"),
        t_end=2.0,
        q0={"b": -1.0},
        v0={"b": 1.0},
    )
    near(freed, [0.0, 0.5], [0.0, 0.5], method)
    assert events(freed) == [("impact", "R")]
    held = run(
        method,
        ball,
        block,
        li.Bumper("x", "b", e=0.5),
        Freewheel("ground", "x"),
        t_end=2.0,
        q0={"b": 1.0},
        v0={"b": -1.0},
    )
    near(held, [0.5, 0.0], [0.5, 0.0], method)
    assert events(held) == [("impact", "R"), ("impact", "T")]
    assert_allclose([event.impulse for event in held.events], [1.5, 1.5], rtol=1e-9)


@pytest.mark.parametrize("method", TAKE_RATES)
def test_a_load_drives_a_freewheel_forward_only(method):
    """A sin Ω t - b on a mass: it starts where the load turns positive, and engages where its rate is zero again."""
    A, Ω, b = 2.0, 2.0 * math.pi, 1.0
    load = li.Load("x", li.Harmonic(A, Ω, phase=-math.pi / 2.0)), li.Load("x", -b)
    found = run(method, li.Mass("x", 1.0), *load, Freewheel("ground", "x"), t_end=1.0)
    start = math.asin(b / A) / Ω

    def rate(t):
        return A / Ω * (math.cos(Ω * start) - math.cos(Ω * t)) - b * (t - start)

    end = brentq(rate, 0.5, 0.99, xtol=1e-15)
    way = A / Ω * (math.cos(Ω * start) * (end - start) - (math.sin(Ω * end) - math.sin(Ω * start)) / Ω)
    way -= 0.5 * b * (end - start) ** 2
    near(found, [way], [0.0], method)
    if found.status is li.Status.SOLVED:
        assert_allclose([event.t for event in found.events[-2:]], [start, end], rtol=0.0, atol=2e-3)


@pytest.mark.parametrize("method", TAKE_RATES)
def test_a_brake_of_one_direction(method):
    """x'' = -1 + 3 while it moves backward, to rest at t = 1/2, where it is held by a force of 1."""
    found = run(method, li.Mass("x", 1.0), li.Load("x", -1.0), Brake("ground", "x", 3.0), v0={"x": -1.0})
    near(found, [-0.25], [0.0], method)
    assert_allclose(found.reaction[-1], [1.0], rtol=1e-6)
    assert events(found) == [("stick", "F")]


@pytest.mark.parametrize("method", ["moreau-jean", "schatzman-paoli", "rattle-ns", "radau", "exact", "event-driven"])
def test_the_certificate_refuses_a_freewheel_that_runs_backward(method):
    """The run of a brake, certified for a freewheel: it obeys the law where it is held, and not where it runs backward."""

    def problem(row, load):
        return li.Problem("one way", li.Scheme(li.Mass("x", 1.0), li.Load("x", load), row), t_end=1.0)

    wheel = Freewheel("ground", "x", name="F")
    backward = li.simulate(problem(Brake("ground", "x", 3.0), -5.0), method, dt=1e-3, error=False)
    assert any("impact" in each for each in backward.certify(problem(wheel, -5.0)).failures)
    held = li.simulate(problem(Brake("ground", "x", 3.0), -1.0), method, dt=1e-3, error=False)
    assert held.certify(problem(wheel, -1.0)).holds
    assert_allclose(held.reaction, np.ones_like(held.reaction), rtol=0.0, atol=1e-9)


def test_methods_without_laws_of_the_rate_refuse_it_by_its_name():
    with pytest.raises(li.UnsupportedError, match="freewheel 'T'"):
        run("rk4", li.Mass("x", 1.0), Freewheel("ground", "x"))


def test_routes_agree_on_a_freewheel():
    elements = li.Mass("x", 1.0), li.Mass("y", 2.0), li.Spring("x", "y", k=100.0), li.Load("x", li.Harmonic(20.0, 7.0))
    scheme = li.Scheme(*elements, Freewheel("ground", "x"), Freewheel("ground", "y", name="T2"))
    found = li.cross_validate(li.Problem("two freewheels", scheme, t_end=1.0), progress=False)
    assert found.agree, found


@pytest.mark.parametrize("bounds", [(-5.0, math.inf), (-math.inf, 0.0), (1.0, math.inf)])
def test_a_half_line_that_does_not_begin_at_zero_is_refused(bounds):
    """Its bound would be no impulse: none of the laws of impact says what it takes."""

    @dataclass(frozen=True)
    class Odd(Freewheel):
        def contribute(self, terms):
            terms.rows.append(Row(str(self), "T", self.a, self.b, 0.0, law=FREEWHEEL, bounds=bounds))

    with pytest.raises(li.InputError, match=r"a row has 0 and inf, two finite ones or none"):
        li.Scheme(li.Mass("x", 1.0), Odd("ground", "x")).assemble()


def test_rates_against_the_law_are_refused():
    """At the start, and of a motion whose velocity may jump: the law says no impulse for either."""
    with pytest.raises(li.InputError, match=r"freewheel 'T' .* starts at the rate -1 m/s"):
        run("exact", li.Mass("x", 1.0), Freewheel("ground", "x"), v0={"x": -1.0})
    driven = (
        li.PrescribedMotion("d", li.Table([0.0, 0.5, 1.0], [0.0, 0.0, 0.5])),
        li.Mass("x", 1.0),
        Freewheel("d", "x"),
    )
    with pytest.raises(li.InputError, match=r"freewheel 'T' .* acts on 'd', whose prescribed velocity may jump"):
        run("moreau-jean", *driven)


@pytest.mark.parametrize("method", ["moreau-jean", "radau", "exact", "event-driven"])
def test_a_freewheel_on_a_spring_holds_its_load_at_rest(method):
    """A load against the freewheel, which holds it from the start; and one on a plate without mass."""
    loaded = run(
        method, li.Mass("x", 1.0), li.Spring("x", "ground", k=50.0), li.Load("x", 30.0), Freewheel("x", "ground")
    )
    near(loaded, [0.0], [0.0], method)
    assert_allclose(loaded.reaction[-1], [30.0], rtol=1e-9)
    plate = run(method, li.Mass("x", 1.0), li.Spring("p", "ground", k=50.0), Freewheel("p", "x"), v0={"x": -1.0})
    truth = run("exact", li.Mass("x", 1.0), li.Spring("p", "ground", k=50.0), Freewheel("p", "x"), v0={"x": -1.0})
    near(plate, truth.q[-1], truth.v[-1], method)
