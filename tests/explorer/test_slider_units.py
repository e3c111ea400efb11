"""The units beside the sliders, as annotations state them."""

from __future__ import annotations

import pytest

import lcpimpact as li
from lcpimpact.problems.parameters import numbers_of, units_of


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


def test_units_of_constants_between_angles():
    scheme = li.Scheme(
        li.Mass("φ", m=2.0), li.Spring("φ", "ground", k=3.0), li.Mass("x", 1.0), li.Spring("x", "ground", 4.0)
    )
    mixed = li.Problem("mine", scheme, units={"φ": "rad"})
    assert units_of(mixed, ["0.m", "1.k", "2.m", "3.k", "q0.φ", "v0.x"]) == {
        "0.m": "kg m²", "1.k": "N m/rad", "2.m": "kg", "3.k": "N/m", "q0.φ": "rad", "v0.x": "m/s"
    }  # fmt: skip
