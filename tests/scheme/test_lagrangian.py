"""Lagrangian systems: derivatives of traced functions, their rows, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mpmath import mp

import lcpimpact as li
from lcpimpact.errors import InputError
from lcpimpact.formula import SymbolicProgram

L1, L2, M1, M2, M3, J1, J2, J3 = 0.153, 0.306, 0.038, 0.038, 0.076, 7.4e-5, 5.9e-4, 2.7e-6
G = 9.81


def slider_crank() -> li.Lagrangian:
    """Crank, rod and slider of Flores et al., with a corner of the slider as contact."""

    def M(q):
        x = (M2 / 2 + M3) * L1 * L2 * np.cos(q[1] - q[0])
        return np.array(
            [
                [J1 + (M1 / 4 + M2 + M3) * L1**2, x, 0.0],
                [x, J2 + (M2 / 4 + M3) * L2**2, 0.0],
                [0.0, 0.0, J3],
            ]
        )

    def V(q):
        return G * ((M1 / 2 + M2 + M3) * L1 * np.sin(q[0]) + (M2 / 2 + M3) * L2 * np.sin(q[1]))

    def gap(t, q):
        return 0.026 - L1 * np.sin(q[0]) - L2 * np.sin(q[1]) + 0.05 * np.sin(q[2]) - 0.025 * np.cos(q[2])

    def slip(t, q, v):
        return -L1 * np.sin(q[0]) * v[0] - L2 * np.sin(q[1]) * v[1] + 0.05 * np.sin(q[2]) * v[2]

    return li.Lagrangian("θ1 θ2 θ3", M, V, contacts=[li.FrictionContact("corner", gap, slip, mu=0.01, e=0.4)])


def forces_by_hand(q, v):
    """F of the slider-crank, as Flores et al. write it: gyroscopic terms of the two links, and weights."""
    x = (M2 / 2 + M3) * L1 * L2 * np.sin(q[1] - q[0])
    return np.array(
        [
            x * v[1] ** 2 - G * (M1 / 2 + M2 + M3) * L1 * np.cos(q[0]),
            -x * v[0] ** 2 - G * (M2 / 2 + M3) * L2 * np.cos(q[1]),
            0.0,
        ]
    )


@given(
    st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3), st.lists(st.floats(-200.0, 200.0), min_size=3, max_size=3)
)
@settings(max_examples=50, deadline=None)
def test_gyroscopic_terms_are_those_typed_by_hand(q, v):
    q, v = np.array(q), np.array(v)
    d = slider_crank().assemble()
    F = forces_by_hand(q, v)
    size = abs(F) + (M2 / 2 + M3) * L1 * L2 * (v**2).max() + G
    assert np.abs(d.forces_at(0.0, q, v).F - F).max() <= 1e-14 * size.max()


@given(st.lists(st.floats(-2.0, 2.0), min_size=4, max_size=4))
@settings(max_examples=20, deadline=None)
def test_slopes_of_forces_are_derivatives_in_many_digits(state):
    q, v = np.array([*state[:2], 0.3]), np.array([*state[2:], 1.0])
    K, C = slider_crank().assemble().forces_at(0.0, q, v)[2:4]
    with mp.workdps(40):
        x = (mp.mpf(M2) / 2 + M3) * L1 * L2

        def F(i, a):
            bend = x * mp.sin(a[1] - a[0])
            weight = (
                G * (mp.mpf(M1) / 2 + M2 + M3) * L1 * mp.cos(a[0]),
                G * (mp.mpf(M2) / 2 + M3) * L2 * mp.cos(a[1]),
            )
            return (bend * a[3] ** 2, -bend * a[2] ** 2)[i] - weight[i]

        point = [mp.mpf(each) for each in (q[0], q[1], v[0], v[1])]
        for i in range(2):
            for j in range(4):
                h = mp.mpf(10) ** -15
                ahead, behind = list(point), list(point)
                ahead[j] += h
                behind[j] -= h
                exact = float((F(i, ahead) - F(i, behind)) / (2 * h))
                ours = -(K if j < 2 else C)[i, j % 2]
                assert ours == pytest.approx(exact, rel=1e-12, abs=1e-13)


FUNCTIONS = {
    "tan": (lambda x: np.tan(x), mp.tan),
    "arctan": (lambda x: np.arctan(x), mp.atan),
    "arcsin": (lambda x: np.arcsin(0.5 * x), lambda x: mp.asin(x / 2)),
    "arccos": (lambda x: np.arccos(0.5 * x), lambda x: mp.acos(x / 2)),
    "sinh": (lambda x: np.sinh(x), mp.sinh),
    "cosh": (lambda x: np.cosh(x), mp.cosh),
    "tanh": (lambda x: np.tanh(x), mp.tanh),
    "log": (lambda x: np.log(1.5 + x), lambda x: mp.log(1.5 + x)),
    "sqrt": (lambda x: np.sqrt(2.0 + x), lambda x: mp.sqrt(2 + x)),
    "power": (
        lambda x: (2.0 + x) ** 2.3 + x**5 - (2.0 + x) ** -1.5 + 2.0**x,
        lambda x: (2 + x) ** mp.mpf(2.3) + x**5 - (2 + x) ** mp.mpf(-1.5) + 2**x,
    ),
    "norm": (lambda x: np.linalg.norm(np.array([x, 1.0])), lambda x: mp.hypot(x, 1)),
    "hypot": (lambda x: np.hypot(x, 0.5), lambda x: mp.hypot(x, 0.5)),
    "arctan2": (lambda x: np.arctan2(x, 1.0 + x), lambda x: mp.atan2(x, 1 + x)),
    "abs": (lambda x: abs(x), abs),
    "quotient": (lambda x: (1.0 + x) / (3.0 - x * x), lambda x: (1 + x) / (3 - x * x)),
}


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize("x", [-0.9, 0.3, 1.1])
def test_functions_and_two_derivatives(name, x):
    """V(q) and a gap of the same function: their values, -F, K and κ against mpmath."""
    ours, theirs = FUNCTIONS[name]
    system = li.Lagrangian(
        "x",
        lambda q: np.array([[1.0]]),
        lambda q: ours(q[0]),
        contacts=[li.FrictionContact("N", lambda t, q: ours(q[0]))],
    )
    d, q, v = system.assemble(), np.array([x]), np.array([0.7])
    exact = [float(mp.diff(theirs, x, k)) for k in range(3)]
    forces, rows = d.forces_at(0.0, q, v), d.rows(0.0, q, v)
    assert [d.elastic_energy(q), -forces.F[0], forces.K[0, 0]] == pytest.approx(exact, rel=1e-9, abs=1e-12)
    assert [rows.g[0], rows.H[0, 0], rows.kappa[0]] == pytest.approx([*exact[:2], exact[2] * 0.49], rel=1e-9, abs=1e-12)


def test_rows_of_a_wall_that_moves():
    """g = x - sin 2t - t x²: H, χ and κ = U' - H v' from the derivatives written out."""
    system = li.Lagrangian(
        "x",
        lambda q: np.array([[1.0]]),
        contacts=[li.FrictionContact("N", lambda t, q: q[0] - np.sin(2.0 * t) - t * q[0] ** 2)],
    )
    t, x, v = 0.3, 0.7, -1.2
    rows = system.assemble().rows(t, np.array([x]), np.array([v]))
    assert rows.H[0, 0] == pytest.approx(1.0 - 2.0 * t * x, rel=1e-15)
    assert rows.chi[0] == pytest.approx(-2.0 * math.cos(2.0 * t) - x**2, rel=1e-15)
    assert rows.kappa[0] == pytest.approx(4.0 * math.sin(2.0 * t) - 4.0 * x * v - 2.0 * t * v**2, rel=1e-14)
    assert rows.rates(np.array([v]))[0] == pytest.approx((1.0 - 2.0 * t * x) * v - 2.0 * math.cos(2.0 * t) - x**2)


def test_many_samples_at_once_are_those_one_by_one():
    d = slider_crank().assemble()
    rng = np.random.default_rng(1)
    t, q, v = rng.random(7), rng.standard_normal((7, 3)), rng.standard_normal((7, 3))
    for function in (d.forces_at, d.rows):
        together = function(t, q, v)
        for i in range(7):
            for all_, one in zip(together, function(t[i], q[i], v[i]), strict=True):
                np.testing.assert_allclose(all_[i], one, rtol=1e-14, atol=1e-16)


def test_frozen_system_has_the_forces_and_slopes_where_it_is():
    d = slider_crank().assemble()
    t, q, v = 0.1, np.array([0.4, -0.2, 0.1]), np.array([3.0, -2.0, 1.0])
    here, forces = d.at(t, q, v), d.forces_at(t, q, v)
    np.testing.assert_allclose(here.force(t) - here.K @ q - here.C @ v, forces.F, rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(here.gap(t, q), d.gap(t, q), atol=1e-15)
    np.testing.assert_allclose(here.gap_rate(t, q, v), d.gap_rate(t, q, v), atol=1e-15)
    assert here.at(0.0, q, v) is here


def test_text_depends_on_the_structure_and_not_on_the_constants():
    def pendulum(m):
        return li.Lagrangian(
            "φ", lambda q: np.array([[m * 0.3**2]]), lambda q: -m * 9.81 * 0.3 * np.cos(q[0])
        ).assemble()

    assert pendulum(1.3).forces_of.written[0] == pendulum(2.9).forces_of.written[0]


BODY = {"M": lambda q: np.diag([1.0, 1.0])}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"nodes": ""}, "names of coordinates"),
        ({"nodes": "x x"}, "two series of the name 'x'"),
        ({"M": 1.0}, "M = 1.0 of a Lagrangian system must be a function"),
        ({"M": lambda q: np.eye(3)}, r"M \(a function of q\) returns .*\(3, 3\): return an array of the shape \(2, 2\)"),
        ({"M": lambda q: np.diag([1.0, math.sin(q[0])])}, r"np.sin in place of math.sin"),
        ({"V": lambda q: q}, "V .* return a number"),
        ({"V": lambda q: np.nan}, "V .* return finite numbers"),
        ({"V": lambda q: np.maximum(q[0], 0.0)}, "V .* compares numbers .* without cases"),
        ({"V": lambda q: q[0] if q[0] > 0.0 else 0.0}, "V .* compares numbers"),
        ({"V": lambda q: float(q[0])}, "V .* in place of assignments to np.zeros"),
        ({"V": lambda q: q[7]}, "V .* fails by IndexError"),
        ({"Q": lambda t, q: q}, "Q .* fails by TypeError"),
        ({"Q": lambda t, q, v: np.floor(q)}, "Q .* floor"),
        ({"contacts": [3]}, "contacts = .* must be a sequence of FrictionContact"),
        ({"joints": li.Joint("J", lambda t, q: q[0])}, "joints = .* must be a sequence of Joint"),
        ({"contacts": [li.FrictionContact("N", lambda t, q: q)]}, "gap of 'N' .* return a number"),
        (
            {"contacts": [li.FrictionContact("N", lambda t, q: q[0], lambda t, q, v: v[0] * v[1], mu=0.1)]},
            "slip of 'N' is not linear in v",
        ),
        ({"contacts": [li.FrictionContact("x", lambda t, q: q[0])]}, "two series of the name 'x'"),
    ],
)  # fmt: skip
def test_a_system_that_cannot_be_used_is_refused_by_name(arguments, words):
    with pytest.raises(InputError, match=words):
        li.Lagrangian(**({"nodes": "x y"} | BODY | arguments))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"mu": 0.3}, "contact 'N' has friction, and no slip"),
        ({"mu": -1.0}, "mu of contact 'N' = -1.0"),
        ({"e": 1.5}, "e of contact 'N' = 1.5 must lie between 0 and 1"),
        ({"e_T": -0.5, "slip": lambda t, q, v: v[0]}, "e_T of contact 'N'"),
        ({"slip": 1.0}, "slip = 1.0"),
        ({"gap": 1.0}, "gap = 1.0 of contact 'N'"),
        ({"name": ""}, "name = ''"),
    ],
)
def test_a_contact_that_cannot_be_used_is_refused(arguments, words):
    with pytest.raises(InputError, match=words):
        li.FrictionContact(**({"name": "N", "gap": lambda t, q: q[0]} | arguments))


@pytest.mark.parametrize(
    ("arguments", "start", "words"),
    [
        ({"M": lambda q: np.array([[1.0, 0.5], [0.2, 1.0]])}, {}, "M.q. is not symmetric"),
        ({"M": lambda q: np.diag([1.0, q[0]])}, {}, "M.q. is not positive definite"),
        ({"M": lambda q: np.array([[1.0, 2.0], [2.0, 1.0]])}, {}, "M.q. is not positive definite"),
        ({"M": lambda q: np.diag([1.0, 1.0 / q[0]])}, {}, "M.q. is"),
        ({"contacts": [li.FrictionContact("N", lambda t, q: q[0] - 1.0)]}, {}, "'N' .* starts penetrated by 1 m"),
        ({"contacts": [li.FrictionContact("N", lambda t, q: np.sqrt(q[0]))]}, {}, "gap of 'N', .* not a finite number"),
        ({"joints": [li.Joint("J", lambda t, q: q[0] - q[1])]}, {"q0": {"x": 0.1}}, "joint 'J' .* is open by 0.1 in q0"),
        ({"joints": [li.Joint("J", lambda t, q: q[0] - q[1])]}, {"v0": {"x": 0.1}}, "joint 'J' .* is open by 0.1 in v0"),
        (
            {"joints": [li.Joint("J", lambda t, q: q[0] - q[1]), li.Joint("K", lambda t, q: q[1] - q[0])]},
            {},
            "joints 'J', 'K' repeat or contradict",
        ),
        ({}, {"q0": {"z": 1.0}}, "'z'"),
    ],
)  # fmt: skip
def test_a_start_that_cannot_be_used_is_refused_by_name(arguments, start, words):
    with pytest.raises(InputError, match=words):
        li.Problem("p", li.Lagrangian(**({"nodes": "x y"} | BODY | arguments)), **start)


def test_formulas_without_values_are_not_compared():
    x = SymbolicProgram().argument("x")
    with pytest.raises(TypeError, match="compares"):
        bool(x > 0.0)


@pytest.mark.parametrize("size", [np.abs, lambda v: np.sqrt(v**2), lambda v: np.sqrt(v @ v)])
def test_quadratic_drag_lets_a_body_start_from_rest(size):
    fall = li.Lagrangian("x y", M=lambda q: np.eye(2), Q=lambda t, q, v: np.array([0.0, -10.0]) - 0.1 * v * size(v))
    run = li.simulate(li.Problem("fall", fall), dt=1e-3, t_end=1.0)
    assert run["v_y"][-1] == pytest.approx(-10.0 * np.tanh(1.0), rel=1e-6)
