"""A motion does not depend on the units in which it is stated: kilograms or grams, metres or micrometres."""

import dataclasses
from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose
from random_schemes import frictional, random_problem

import lcpimpact as li
from lcpimpact.hybrid.event_loop import follow
from lcpimpact.hybrid.motion import begin_problem
from lcpimpact.integrators import METHODS
from lcpimpact.scheme.signals import Described

EXPONENTS = {
    "m": (1, 0, 0), "k": (1, 0, -2), "k_h": (1, 0, -2), "c": (1, 0, -1), "f": (1, 1, -2), "f_y": (1, 1, -2),
    "r0": (1, 1, -2), "gap": (0, 1, 0), "y": (0, 1, 0),
}  # fmt: skip
"""Powers of mass, length and time in the unit of each constant of an element."""

UNITS = [
    (17, -23, 11), (-25, 31, -19), (60, 0, 0), (-70, 0, 0), (0, -60, 0), (0, -70, 0), (0, 40, 0), (0, 70, 0), (0, 0, -40),
    (0, 0, 50), (70, 70, 50), (-70, 60, -50),
]  # fmt: skip
"""Units of mass, length and time, as powers of two, so that no constant is rounded."""


def signal_restated(signal, value, time):
    """A load or a motion with its values and its times in other units."""
    if not isinstance(signal, Described):
        return signal * value
    match signal:
        case li.Harmonic() | li.Square():
            return dataclasses.replace(signal, amplitude=signal.amplitude * value, omega=signal.omega / time)
        case li.Table():
            return li.Table([t * time for t in signal.times], [x * value for x in signal.values])
        case li.Ramp():
            return li.Ramp(signal.start * value, signal.end * value, signal.t_start * time, signal.t_end * time)
        case li.Polynomial():
            return li.Polynomial([c * value / time**i for i, c in enumerate(signal.coefficients)])
    raise NotImplementedError(signal)


def restated(problem, units):
    """The problem with its constants in other units."""

    def factor(exponents):
        return 2.0 ** float(np.dot(units, exponents))

    def in_units(element):
        values = {}
        for each in dataclasses.fields(element):
            value = getattr(element, each.name)
            if each.name == "K":
                values["K"] = value * factor((1, 1.0 - element.n, -2))
            elif each.name == "b" and isinstance(element, li.HuntCrossley):
                values["b"] = value * factor((0, -1, 1))
            elif each.name in EXPONENTS and value is not None:
                values[each.name] = signal_restated(value, factor(EXPONENTS[each.name]), factor((0, 0, 1)))
        return dataclasses.replace(element, **values)

    scheme = li.Scheme(*(in_units(each) for each in problem.scheme.elements))
    q0 = {node: value * factor((0, 1, 0)) for node, value in problem.q0.items()}
    v0 = {node: value * factor((0, 1, -1)) for node, value in problem.v0.items()}
    return li.Problem(problem.name, scheme, q0=q0, v0=v0)


def shaken():
    """A body over a massless plate on a table that follows given values, under a square wave and a ramp."""
    scheme = li.Scheme(
        li.PrescribedMotion("table", li.Table((0.0, 0.3, 0.5, 0.9, 1.5), (0.0, 0.04, -0.02, 0.05, 0.0))),
        li.KelvinVoigt("p", "table", k=900.0, c=7.0),
        li.Mass("b", 1.3), li.Load("b", 12.0), li.Load("b", li.Square(9.0, 11.0, 0.3)),
        li.Mass("d", 0.7), li.Load("d", li.Ramp(0.0, 25.0, 0.2, 0.7)), li.Spring("d", "b", 150.0),
        li.Bumper("b", "p", gap=0.03), li.Bumper("d", "ground", gap=0.05, e=0.5, name="S"),
    )  # fmt: skip
    return li.Problem("shaken", scheme, v0={"b": 0.4})


def compliant():
    """Two bodies between springs of Hertz, with and without loss, under a harmonic load."""
    scheme = li.Scheme(
        li.Mass("a", 0.8), li.Mass("b", 1.7), li.Load("a", li.Harmonic(30.0, 9.0)), li.Load("b", 15.0),
        li.HertzSpring("a", "b", K=4e3, gap=0.02, name="H"),
        li.HuntCrossley("b", "ground", K=9e3, b=0.4, gap=0.05, name="G"),
        li.KelvinVoigt("a", "ground", k=60.0, c=0.6),
    )  # fmt: skip
    return li.Problem("compliant", scheme, v0={"a": 1.5})


def run(problem, method, end):
    try:
        return li.simulate(problem, method, dt=end / 60, t_end=end, progress=False, throw=False)
    except li.UnsupportedError as refusal:
        pytest.skip(str(refusal))


def agrees(problem, method, end, every=UNITS):
    first = run(restated(problem, (0, 0, 0)), method, end)
    tolerance = 1e-6 if method in ("event-driven", "radau-fesd") else 1e-9
    for units in every:
        mass, length, time = (2.0**power for power in units)
        other = run(restated(problem, units), method, end * time)
        assert other.status == first.status, f"{units}: {other.message}"
        for ours, theirs, unit, kept in (
            (first.q, other.q, length, slice(None)),
            # Those of an instant in the grid at which something jumps may be from before or after.
            (first.v, other.v, length / time, slice(-1, None)),
            (first.reaction, other.reaction, mass * length / time**2, slice(-1, None)),
        ):
            atol = tolerance * np.abs(ours).max(initial=0.0)
            assert_allclose(theirs[kept] / unit, ours[kept], rtol=0.0, atol=atol, err_msg=f"{units}")


MOVING = ("system-2", "bouncing-ball", "coulomb-oscillator", "impact-oscillator")


@pytest.mark.parametrize("method", sorted(set(METHODS) - {"rk4-paper"}))
@pytest.mark.parametrize("name", MOVING)
def test_a_motion_does_not_depend_on_its_units(name, method):
    """Each method meets all units, a quarter of them on each problem."""
    problem = li.load_problem(name)
    agrees(problem, method, problem.t_end, UNITS[MOVING.index(name) :: len(MOVING)])


@pytest.mark.parametrize("method", sorted(set(METHODS) - {"rk4-paper"}))
@pytest.mark.parametrize("make", [shaken, compliant])
def test_nor_does_that_of_moved_plates_and_of_nonlinear_springs(make, method):
    agrees(make(), method, 1.0, UNITS[make is shaken :: 2])


@pytest.mark.parametrize(
    "make", [shaken, partial(random_problem, 0), partial(random_problem, 3), partial(frictional, 0)]
)
def test_the_windows_of_exact_are_the_same_in_all_units(make):
    def windows(units):
        time = 2.0 ** units[2]
        motion = begin_problem(restated(make(), units), "exact", time)
        follow(motion, time)
        return [(key[1], found[0].window / time) for key, found in motion.system.memo.items() if key[0] == "reaction"]

    first = windows((0, 0, 0))
    for units in UNITS:
        assert windows(units) == first, units


@pytest.mark.parametrize("make", [random_problem, frictional])
def test_radau_solves_its_stages_with_massless_nodes_in_any_unit(make):
    agrees(make(0), "radau", 1.0)


def test_the_defect_of_elements_is_judged_alike_in_any_unit_of_length():
    first, other = (
        run(restated(li.load_problem("system-2"), units), "radau-fesd", 3.0) for units in ((0, 0, 0), (0, -70, 0))
    )
    assert 0.1 < other.stats.residual / first.stats.residual < 10.0


def test_impacts_of_unresolved_order_end_in_any_unit():
    """The next impact is where a flight is the shortest: u + U δ need not round to zero there."""
    problem = random_problem(58)
    first, other = (run(restated(problem, units), "exact", 1.0) for units in ((0, 0, 0), (0, 63, 0)))
    assert first.status == other.status == 0
    assert_allclose(other.q / 2.0**63, first.q, rtol=0.0, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 2, 3, 6])
@pytest.mark.parametrize("make", [random_problem, frictional])
@pytest.mark.parametrize("method", sorted(set(METHODS) - {"rk4-paper"}))
def test_nor_does_that_of_a_random_scheme(method, make, seed):
    agrees(make(seed), method, 1.0)
