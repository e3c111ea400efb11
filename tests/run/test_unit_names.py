"""Units by their names: factors, dimensions, and what names no unit."""

from fractions import Fraction

import numpy as np
import pytest

import lcpimpact as li
from lcpimpact.problems import PROBLEMS
from lcpimpact.quantities import SUMMARY
from lcpimpact.scheme.elements import ELEMENTS
from lcpimpact.stated import stated
from lcpimpact.units import Unit, conversion, is_unit

WITH_A_LETTER = {"N/mⁿ", "N s^α/m", "N s/m^q", "N sⁿ/mⁿ"}
"""Units whose power is a parameter."""


@pytest.mark.parametrize(
    ("text", "factor", "coherent"),
    [
        ("ms", "1e-3", "s"), ("us", "1e-6", "s"), ("\u00b5s", "1e-6", "s"), ("\u03bcs", "1e-6", "s"), ("min", 60, "s"),
        ("kN", 1000, "N"), ("daN", 10, "N"), ("lbf", "4.4482216152605", "N"), ("mm", "1e-3", "m"), ("cm", "1e-2", "m"),
        ("in", "0.0254", "m"), ("mm/s", "1e-3", "m/s"), ("mm/s²", "1e-3", "m/s2"), ("m s⁻¹", 1, "m s⁻¹"),
        ("kN/mm", "1e6", "N/m"), ("N·s/mm", 1000, "N·s/m"), ("kNm", 1000, "N m"), ("N/(mm s)", 1000, "N/(m s)"),
        ("g", "1e-3", "kg"), ("kg", 1, "kg"), ("mm^2", "1e-6", "m^2"), ("1/ms", 1000, "1/s"), ("msec", "1e-3", "s"),
        ("km/h", Fraction(1000, 3600), "m/s"), ("g/mm^3", "1e6", "kg/m^3"), ("mV", "1e-3", "V"), ("kΩ", 1000, "Ω"),
    ],
)  # fmt: skip
def test_factors_are_exact(text, factor, coherent):
    found = Unit.of(text)
    assert found.factor == Fraction(factor)
    assert found.coherent == coherent


@pytest.mark.parametrize(
    ("text", "same"),
    [("N", "kg m/s²"), ("J", "N m"), ("Pa", "N/m²"), ("W", "J/s"), ("V", "W/A"), ("Ω", "V/A"), ("F", "A s/V"),
     ("H", "V s/A"), ("Hz", "1/s"), ("Ns", "N s"), ("Nm", "N m"), ("bar", "N/m²")],
)  # fmt: skip
def test_dimensions_follow_from_one_another(text, same):
    assert Unit.of(text).dimension == Unit.of(same).dimension


def test_broken_powers():
    assert Unit.of("m/s^(1/2)").dimension == (0, 1, Fraction(-1, 2), 0, 0)
    assert float(Unit.of("mm^(1/2)").factor) == pytest.approx(10.0**-1.5)


def test_values_are_rounded_once():
    values = np.array([9.7, 0.1, 3.3, 123.456])
    assert conversion("ms", "s").converted(values).tolist() == [float(Fraction(each) / 1000) for each in values]
    assert conversion("kN", "N").converted(values).tolist() == [float(Fraction(each) * 1000) for each in values]
    assert conversion("°", "rad").converted(np.array([180.0])).tolist() == [np.pi]


def test_what_is_wanted_may_be_any_unit():
    assert conversion("m", "mm").factor == 1000
    assert conversion("divisions", "divisions").factor == 1
    with pytest.raises(li.InputError, match="unknown unit 'divisions'"):
        conversion("m", "divisions")


@pytest.mark.parametrize("text", ["", "1", "-"])
def test_pure_numbers(text):
    assert (Unit.of(text).factor, any(Unit.of(text).dimension)) == (1, False)
    assert not is_unit(text)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("kNn", "unknown unit 'kNn': did you mean 'kN'?"), ("KN", "unknown unit 'KN': did you mean 'kN'?"),
        ("°C", "unknown unit 'C'"), ("kmin", "unknown unit 'kmin': did you mean 'min'?"), ("‰", "unknown unit '‰'"),
        ("m/", "unknown unit"), ("5 N", "unknown unit"), ("N/mⁿ", "unknown unit"), ("Kraft", "unknown unit 'Kraft'"),
    ],
)  # fmt: skip
def test_what_names_no_unit_is_refused(text, says):
    with pytest.raises(li.InputError) as raised:
        Unit.of(text)
    assert says in str(raised.value)
    assert not is_unit(text)


@pytest.mark.parametrize(("text", "wanted"), [("kg", "N"), ("mm", "rad"), ("rad/s", "1/s"), ("g", "m/s²"), ("s", "m")])
def test_a_unit_of_another_dimension_is_refused(text, wanted):
    with pytest.raises(li.InputError, match=f"{text!r} is no unit for what is in {wanted}"):
        conversion(text, wanted)


def test_every_unit_that_the_package_states_is_known_and_coherent():
    units = {unit for unit, _ in SUMMARY.values()}
    for registry in (PROBLEMS, ELEMENTS):
        units |= {each.unit for name in registry for each in stated(registry[name]).values()}
    for problem in map(li.load_problem, PROBLEMS):
        units |= {fact.unit for fact in problem.facts}
        d = problem.dynamics
        units |= {problem.unit(name) for name in ("t", *d.nodes, *(f"v_{node}" for node in d.nodes))}
        units |= {problem.unit(each.name) for each in d.forces}
    assert len(units) > 20
    assert {unit for unit in units if unit and not is_unit(unit)} == WITH_A_LETTER
    assert {unit for unit in units - WITH_A_LETTER if Unit.of(unit).factor != 1} == set()
