"""A motion does not depend on the units in which it is stated: kilograms or grams, metres or micrometres."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose
from schemes import frictional, random_problem

import lcpimpact as li
from lcpimpact.integrators import METHODS

EXPONENTS = {
    "m": (1, 0, 0), "k": (1, 0, -2), "k_h": (1, 0, -2), "c": (1, 0, -1), "f": (1, 1, -2), "f_y": (1, 1, -2),
    "r0": (1, 1, -2), "gap": (0, 1, 0), "y": (0, 1, 0),
}  # fmt: skip
"""Powers of mass, length and time in the unit of each constant of an element."""

UNITS = [(17, -23, 11), (-25, 31, -19), (60, 0, 0), (0, -60, 0), (0, 0, -40)]
"""Units of mass, length and time, as powers of two, so that no constant is rounded."""

SMALL_LENGTH = (0, 40, 0)
"""A unit in which loads are so large beside rates that the windows of `exact`, 2⁻⁴⁰ s, are too many."""


def restated(problem, units):
    """The problem with its constants in other units."""

    def factor(exponents):
        return 2.0 ** float(np.dot(units, exponents))

    def in_units(element):
        values = {}
        for each in dataclasses.fields(element):
            value = getattr(element, each.name)
            if each.name not in EXPONENTS or value is None:
                continue
            unit = factor(EXPONENTS[each.name])
            if isinstance(value, li.Harmonic):
                values[each.name] = dataclasses.replace(
                    value, amplitude=value.amplitude * unit, omega=value.omega / factor((0, 0, 1))
                )
            else:
                values[each.name] = value * unit
        return dataclasses.replace(element, **values)

    scheme = li.Scheme(*(in_units(each) for each in problem.scheme.elements))
    q0 = {node: value * factor((0, 1, 0)) for node, value in problem.q0.items()}
    v0 = {node: value * factor((0, 1, -1)) for node, value in problem.v0.items()}
    return li.Problem(problem.name, scheme, q0=q0, v0=v0)


def run(problem, method, end):
    try:
        return li.simulate(problem, method, dt=end / 60, t_end=end, progress=False, throw=False)
    except li.UnsupportedError as refusal:
        pytest.skip(str(refusal))


def agrees(problem, method, end):
    first = run(restated(problem, (0, 0, 0)), method, end)
    tolerance = 1e-6 if method in ("event-driven", "radau-fesd") else 1e-9
    for units in UNITS if method == "exact" else (*UNITS, SMALL_LENGTH):
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


@pytest.mark.parametrize("method", sorted(set(METHODS) - {"rk4-paper"}))
@pytest.mark.parametrize("name", ["system-2", "bouncing-ball", "coulomb-oscillator", "impact-oscillator"])
def test_a_motion_does_not_depend_on_its_units(name, method):
    problem = li.load_problem(name)
    agrees(problem, method, problem.t_end)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2, 3, 4, 6, 7])
@pytest.mark.parametrize("make", [random_problem, frictional])
@pytest.mark.parametrize("method", sorted(set(METHODS) - {"rk4-paper"}))
def test_nor_does_that_of_a_random_scheme(method, make, seed):
    agrees(make(seed), method, 1.0)
