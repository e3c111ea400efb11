"""The units beside the sliders, as annotations state them."""

from __future__ import annotations

import pytest

import lcpimpact as li
from lcpimpact.explorer.units import units_of
from lcpimpact.problems.parameters import numbers_of


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
