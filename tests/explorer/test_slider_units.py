"""The units beside the sliders, as docstrings state them."""

from __future__ import annotations

import pytest

import lcpimpact as li
from lcpimpact.explorer.units import stated_units, units_of
from lcpimpact.problems.parameters import numbers_of
from lcpimpact.scheme.elements import ELEMENTS


@pytest.mark.parametrize(
    ("name", "units"),
    [
        ("system-3", {"m": "kg", "k": "N/m", "k_o": "N/m", "c": "N s/m", "c_o": "N s/m", "g": "m/s²", "h_o": "m"}),
        ("bouncing-ball", {"m": "kg", "g": "m/s²", "H": "m"}),
        ("forced-coulomb-oscillator", {"m": "kg", "k": "N/m", "F": "N", "P": "N", "omega": "rad/s"}),
        ("diode-bridge", {"L": "H", "C": "F", "R": "Ω", "v0": "V"}),
        ("shaw-holmes", {}),
    ],
)
def test_units_of_parameters(name, units):
    problem = li.load_problem(name)
    assert units_of(problem, numbers_of(problem)) == units


def test_units_of_the_constants_of_elements():
    """Every constant of an element has its unit, but for coefficients of restitution."""
    scheme = li.Scheme(li.Mass("x", m=2.0), li.Load("x", f=3.0), li.Bumper("x", "ground", gap=1.0, e=0.5))
    addresses = ["Mass.m", "Load.f", "Bumper.gap", "Bumper.e", "v0.x", "0.m", "theta"]
    assert units_of(li.Problem("mine", scheme), addresses) == {
        "Mass.m": "kg", "Load.f": "N", "Bumper.gap": "m", "v0.x": "m/s", "0.m": "kg"
    }  # fmt: skip
    assert {name for name, kind in ELEMENTS.items() if not stated_units(kind)} == {
        "Friction",
        "RigidLink",
        "Substructure",
    }


def test_a_power_of_a_unit_is_none_of_those_that_are_read():
    def fractional(c, e):
        """Example.

        Parameters
        ----------
        c : float
            Stiffness in N s^α/m.
        e : float
            Coefficient of restitution in [0, 1].
        """

    assert stated_units(fractional) == {}
