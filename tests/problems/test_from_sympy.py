"""Mechanisms of SymPy as problems: their equations are SymPy's, and what is missing is refused by name."""

from __future__ import annotations

import numpy as np
import pytest

import lcpimpact as li
from lcpimpact.errors import InputError

sympy = pytest.importorskip("sympy")
mechanics = pytest.importorskip("sympy.physics.mechanics")

a, b, w = mechanics.dynamicsymbols("a b w")
m, L, g, c = sympy.symbols("m L g c")
NUMBERS = {m: 1.3, L: 0.7, g: 9.81, c: 0.2}
kinetic = m * L**2 * (2 * a.diff() ** 2 + b.diff() ** 2 + 2 * sympy.cos(a - b) * a.diff() * b.diff()) / 2
potential = -m * g * L * (2 * sympy.cos(a) + sympy.cos(b))


def lagrange(forces=None, formed=True, frame=None):
    method = mechanics.LagrangesMethod(kinetic - potential, [a, b], forcelist=forces, frame=frame)
    if formed:
        method.form_lagranges_equations()
    return method


def test_equations_are_those_of_sympy():
    """M and F at random states against SymPy's own numbers, with a torque c q' at the first joint."""
    frame = mechanics.ReferenceFrame("N")
    arm = frame.orientnew("A", "Axis", [a, frame.z])
    arm.set_ang_vel(frame, a.diff() * frame.z)
    method = lagrange([(arm, -c * a.diff() * frame.z)], frame=frame)
    d = li.SympyMechanism(method, NUMBERS).problem("two arms").dynamics
    rng = np.random.default_rng(3)
    for _ in range(5):
        q, v = rng.standard_normal((2, 2))
        numbers = NUMBERS | dict(zip([a.diff(), b.diff(), a, b], [*v, *q], strict=True))
        M, F = (np.array(each.subs(numbers), dtype=float) for each in (method.mass_matrix, method.forcing))
        forces = d.forces_at(0.0, q, v)
        np.testing.assert_allclose(forces.M, M, rtol=1e-14)
        np.testing.assert_allclose(forces.F, F[:, 0], rtol=1e-12, atol=1e-13)
        assert d.elastic_energy(q) == pytest.approx(float(potential.subs(numbers)), rel=1e-14)


def test_kane_and_lagrange_give_one_pendulum():
    frame = mechanics.ReferenceFrame("N")
    arm = frame.orientnew("A", "Axis", [a, frame.z])
    arm.set_ang_vel(frame, w * frame.z)
    pivot = mechanics.Point("O")
    pivot.set_vel(frame, 0)
    tip = pivot.locatenew("P", -L * arm.y)
    tip.v2pt_theory(pivot, frame, arm)
    kane = mechanics.KanesMethod(frame, q_ind=[a], u_ind=[w], kd_eqs=[a.diff() - w])
    kane.kanes_equations([mechanics.Particle("bob", tip, m)], [(tip, -m * g * frame.y)])
    mechanism = li.SympyMechanism(kane, NUMBERS)
    d = mechanism.problem("pendulum", q0={"a": -1.0}).dynamics
    q, v = np.array([0.4]), np.array([2.0])
    assert d.forces_at(0.0, q, v).F[0] == pytest.approx(-1.3 * 9.81 * 0.7 * np.sin(0.4), rel=1e-14)
    gap = mechanism.function(L * (sympy.sin(0.3) - sympy.sin(a)) + 0.1 * w)
    assert gap(0.0, q, v) == pytest.approx(0.7 * (np.sin(0.3) - np.sin(0.4)) + 0.2, rel=1e-14)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: li.SympyMechanism(lagrange(formed=False), NUMBERS), "LagrangesMethod are not formed"),
        (lambda: li.SympyMechanism(lagrange(), {m: 1.0}), "L, g of the mechanism have no value"),
    ],
)
def test_what_is_missing_is_named(make, words):
    with pytest.raises(InputError, match=words):
        make()
