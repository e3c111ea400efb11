"""Elements against matrices by hand, closed forms and condensation by numpy; what they refuse; the page of the elements."""

from __future__ import annotations

import dataclasses
import inspect
import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import solve_ivp
from scipy.linalg import eigh, expm

import lcpimpact as li
from lcpimpact.scheme.elements import ELEMENTS
from lcpimpact.scheme.elements.bar import COUPLING_MASSES

constants = st.integers(1, 4000).map(lambda i: i / 16.0)


def run(elements, method="exact", dt=1e-2, t_end=1.0, q0=None, v0=None, **options):
    problem = li.Problem("elements", li.Scheme(*elements), q0=q0 or {}, v0=v0 or {})
    return li.simulate(problem, method, dt=dt, t_end=t_end, **options)


def matrices(*elements):
    """Return nodes, K and C of elements whose nodes may hang loose, which the assembly would refuse."""
    from lcpimpact.scheme.terms import GROUND, Terms

    nodes = list(dict.fromkeys(node for element in elements for node in element.nodes if node != GROUND))
    terms = Terms(nodes)
    for element in elements:
        element.contribute(terms)
    return nodes, terms


def complex_stiffness(element, omega):
    """Force over elongation at the frequency ω, with the inner nodes condensed."""
    _, terms = matrices(element)
    D = terms.K.value + 1j * omega * terms.C.value
    return D[0, 0] - D[0, 1:] @ np.linalg.solve(D[1:, 1:], D[1:, 0])


def relaxation(element, times):
    """Force after a unit step of the first node: the inner nodes relax by their own equations, by matrix exponentials."""
    _, terms = matrices(element)
    K, C = terms.K.value, terms.C.value
    rest = -np.linalg.solve(K[1:, 1:], K[1:, 0])
    rate = -np.linalg.solve(C[1:, 1:], K[1:, 1:])
    # Dashpots do not move in an instant: the inner nodes start from zero.
    return np.array([K[0, 0] + K[0, 1:] @ (rest - expm(rate * t) @ rest) for t in times])


# ---- viscoelastic elements ------------------------------------------------------------------------------------------


@given(k=constants, c=constants)
def test_maxwell_by_hand(k, c):
    nodes, terms = matrices(li.Maxwell("x", "y", k, c, name="s"))
    assert nodes == ["x", "s.1", "y"]
    assert_array_equal(terms.K.value, [[k, -k, 0], [-k, k, 0], [0, 0, 0]])
    assert_array_equal(terms.C.value, [[0, 0, 0], [0, c, -c], [0, -c, c]])
    assert not terms.M.value.any()


def test_zener_by_hand():
    nodes, terms = matrices(li.Zener("x", "ground", 3.0, 5.0, 2.0))
    assert nodes == ["x", "x-ground.1"]
    assert_array_equal(terms.K.value, [[8.0, -5.0], [-5.0, 5.0]])
    assert_array_equal(terms.C.value, [[0.0, 0.0], [0.0, 2.0]])


def test_generalized_maxwell_by_hand():
    nodes, terms = matrices(li.GeneralizedMaxwell("x", "ground", 3.0, [5.0, 7.0], [2.0, 0.5], name="s"))
    assert nodes == ["x", "s.1", "s.2"]
    assert_array_equal(terms.K.value, [[15.0, -5.0, -7.0], [-5.0, 5.0, 0.0], [-7.0, 0.0, 7.0]])
    assert_array_equal(terms.C.value, np.diag([0.0, 10.0, 3.5]))
    _, without = matrices(li.GeneralizedMaxwell("x", "ground", 0.0, (5.0,), (2.0,)))
    assert_array_equal(without.K.value, [[5.0, -5.0], [-5.0, 5.0]])


def test_special_cases_of_the_generalized_maxwell_element():
    for special, general in (
        (li.Maxwell("x", "ground", 5.0, 10.0), li.GeneralizedMaxwell("x", "ground", 0.0, (5.0,), (2.0,))),
        (li.Zener("x", "ground", 3.0, 5.0, 10.0), li.GeneralizedMaxwell("x", "ground", 3.0, (5.0,), (2.0,))),
    ):
        assert special.nodes == general.nodes
        (_, one), (_, other) = matrices(special), matrices(general)
        assert_array_equal(one.K.value, other.K.value)
        assert_array_equal(one.C.value, other.C.value)
        t = np.linspace(0.0, 9.0, 7)
        assert_allclose(special.modulus(t), general.modulus(t), rtol=1e-15, atol=0.0)


@given(k=constants, c=constants, omega=constants)
def test_maxwell_is_a_series_and_zener_adds_a_spring(k, c, omega):
    series = 1.0 / (1.0 / k + 1.0 / (1j * omega * c))
    assert_allclose(complex_stiffness(li.Maxwell("x", "ground", k, c), omega), series, rtol=1e-10)
    assert_allclose(complex_stiffness(li.Zener("x", "ground", 2.0, k, c), omega), 2.0 + series, rtol=1e-10)


@given(
    k_inf=st.sampled_from([0.0, 0.5, 30.0]),
    arms=st.lists(st.tuples(constants, st.integers(1, 64).map(lambda i: i / 8.0)), min_size=1, max_size=4),
)
def test_the_modulus_is_what_the_matrices_relax_by(k_inf, arms):
    k, tau = zip(*arms, strict=True)
    element = li.GeneralizedMaxwell("x", "ground", k_inf, k, tau)
    t = np.array([0.0, 0.03, 0.4, 2.0, 11.0])
    assert_allclose(element.modulus(t), relaxation(element, t), rtol=1e-9, atol=1e-9 * sum(k))
    assert element.modulus(t.reshape(5, 1)).shape == (5, 1)


@pytest.mark.parametrize(
    "element", [li.Maxwell("x", "ground", 5.0, 2.0), li.Zener("x", "ground", 3.0, 5.0, 2.0)], ids=str
)
def test_maxwell_and_zener_relax_by_their_modulus(element):
    t = np.array([0.0, 0.1, 1.0, 4.0])
    assert_allclose(element.modulus(t), relaxation(element, t), rtol=1e-12)
    assert element.modulus(0.0) == pytest.approx(5.0 if isinstance(element, li.Maxwell) else 8.0)


@pytest.mark.parametrize(("method", "tolerance"), [("exact", 1e-13), ("moreau-jean", 2e-6)])
def test_zener_creeps(method, tolerance):
    k, k_1, c_1, F = 3.0, 5.0, 2.0, 7.0
    found = run([li.Zener("x", "ground", k, k_1, c_1), li.Load("x", F)], method, dt=1e-3, t_end=5.0)
    tau = c_1 * (k + k_1) / (k * k_1)
    closed_form = F / k * (1.0 - k_1 / (k + k_1) * np.exp(-found.t / tau))
    assert_allclose(found["x"][1:], closed_form[1:], rtol=0.0, atol=tolerance)


def test_maxwell_creeps_without_end():
    found = run([li.Maxwell("x", "ground", 4.0, 2.0), li.Load("x", 3.0)], t_end=2.0)
    assert_allclose(found["x"], 3.0 / 4.0 + 3.0 * found.t / 2.0, rtol=1e-13)


@pytest.mark.parametrize(("method", "dt", "tolerance"), [("exact", 1e-2, 1e-12), ("moreau-jean", 1e-3, 1e-5)])
def test_a_mass_stopped_by_a_maxwell_element(method, dt, tolerance):
    """The force F of m x'' = -F, F' = k x' - F/τ: a damped sine of ω_d² = k/m - 1/(4τ²), which ends in a flow."""
    m, k, c, v_0 = 2.0, 50.0, 8.0, 3.0
    a = k / (2.0 * c)
    omega = math.sqrt(k / m - a * a)
    found = run([li.Mass("x", m), li.Maxwell("x", "ground", k, c)], method, dt=dt, t_end=2.0, v0={"x": v_0})
    t = found.t
    v = v_0 * np.exp(-a * t) * (np.cos(omega * t) + a / omega * np.sin(omega * t))
    assert_allclose(found["v_x"], v, rtol=0.0, atol=tolerance * v_0)
    force = k * (found["x"] - found["x-ground.1"])
    assert_allclose(force, v_0 * k / omega * np.exp(-a * t) * np.sin(omega * t), rtol=0.0, atol=tolerance * 30.0)


def test_a_mass_on_a_prony_series_against_dop853():
    element = li.GeneralizedMaxwell("x", "ground", 20.0, (30.0, 40.0), (0.3, 0.05))
    found = run([li.Mass("x", 2.0), element], dt=0.05, t_end=3.0, v0={"x": 1.0})

    def rate(_, s):
        x, v, *F = s
        return [v, -(20.0 * x + sum(F)) / 2.0, 30.0 * v - F[0] / 0.3, 40.0 * v - F[1] / 0.05]

    other = solve_ivp(rate, (0.0, 3.0), [0.0, 1.0, 0.0, 0.0], "DOP853", found.t, rtol=1e-13, atol=1e-14)
    assert_allclose(found["x"], other.y[0], rtol=0.0, atol=1e-12)


def test_two_elements_side_by_side_need_a_name():
    pair = [li.Maxwell("x", "ground", 1.0, 1.0), li.Zener("x", "ground", 1.0, 1.0, 1.0)]
    with pytest.raises(li.InputError, match=r"both make a node 'x-ground.1': give one of them another name="):
        li.Scheme(*pair).assemble()
    assert li.Scheme(pair[0], dataclasses.replace(pair[1], name="z")).assemble().nodes == ("x", "x-ground.1", "z.1")


# ---- the spring-pot -------------------------------------------------------------------------------------------------

spans = st.tuples(st.floats(-9.0, 3.0), st.floats(0.05, 12.0)).map(lambda s: (10.0 ** s[0], 10.0 ** (s[0] + s[1])))
tolerances = st.floats(-11.0, -0.1).map(lambda e: 10.0**e)


def power_law(alpha, t):
    return t**-alpha / math.gamma(1.0 - alpha)


@settings(max_examples=150)
@given(alpha=st.floats(0.01, 0.99), span=spans, rtol=tolerances)
def test_the_bound_of_the_spring_pot_holds_and_is_near(alpha, span, rtol):
    pot = li.SpringPot("x", "ground", 2.0, alpha, *span, rtol=rtol)
    assert pot.bound <= rtol
    k_inf, k, tau = pot.prony
    assert k_inf == 0.0
    assert min(k) > 0.0
    assert min(tau) > 0.0
    t = np.geomspace(*span, 3001)
    series = (np.exp(-t[:, None] / np.array(tau)) * np.array(k)).sum(axis=1)
    error = np.abs(series / (2.0 * power_law(alpha, t)) - 1.0).max()
    assert error <= pot.bound * (1.0 + 1e-9) + 1e-13
    if span[1] > 100.0 * span[0]:  # a shorter span may miss the peaks
        assert error >= 0.1 * pot.bound
    # A motion of constant speed from t = 0 on has the force c_α v t^(1-α)/Γ(2-α), within the same bound.
    ramp = pot.c_0 + (np.array(k) * np.array(tau) * -np.expm1(-t[:, None] / np.array(tau))).sum(axis=1)
    assert_allclose(ramp, 2.0 * t ** (1.0 - alpha) / math.gamma(2.0 - alpha), rtol=pot.bound + 1e-13)


@given(alpha=st.floats(0.05, 0.95), span=spans)
def test_more_accuracy_costs_few_arms(alpha, span):
    """The number of arms grows with the logarithm of the span and of 1/rtol only."""
    pots = [li.SpringPot("x", "ground", 1.0, alpha, *span, rtol=rtol) for rtol in (1e-2, 1e-4, 1e-8)]
    few, some, many = (len(pot.prony.k) for pot in pots)
    assert few <= some < many
    assert many <= 25 + 5 * math.log10(span[1] / span[0])


def test_the_spring_pot_acts_as_its_series_and_a_dashpot():
    pot = li.SpringPot("x", "ground", 3.0, 0.4, 1e-2, 1e2, 1e-3, name="s")
    n = len(pot.prony.k)
    assert pot.nodes == ("x", *(f"s.{i}" for i in range(1, n + 1)), "ground")
    assert pot.approximation.nodes == pot.nodes
    t = np.geomspace(1e-2, 1e2, 30)
    assert_allclose(pot.modulus(t), 3.0 * power_law(0.4, t), rtol=1e-14)
    assert_allclose(relaxation(pot, t), pot.modulus(t), rtol=pot.bound)
    _, terms = matrices(pot)
    assert terms.C.value[0, 0] == pot.c_0
    assert repr(pot).count("=") == 9  # its fields alone, so that a scheme reads back


@pytest.mark.parametrize("alpha", [0.2, 0.5, 0.8])
def test_the_complex_modulus_of_the_spring_pot(alpha):
    pot = li.SpringPot("x", "ground", 3.0, alpha, 1e-6, 1e6, 1e-6)
    for omega in (1e-2, 1.0, 1e2):
        assert_allclose(complex_stiffness(pot, omega), 3.0 * (1j * omega) ** alpha, rtol=5e-6)


def mittag_leffler(a, b, z):
    """Return E_{a,b}(z) by its series, which serves for |z| of a few units."""
    return sum(z**n / math.gamma(a * n + b) for n in range(60))


def test_a_mass_on_a_spring_pot():
    """m x'' + c D^α x = 0 from x = 0 with v_0: x = v_0 t E_{2-α,2}(-(c/m) t^(2-α))."""
    alpha, c, m, v_0 = 0.5, 3.0, 2.0, 1.5
    pot = li.SpringPot("x", "ground", c, alpha, 1e-3, 1.0, 1e-5)
    found = run([li.Mass("x", m), pot], dt=0.05, t_end=1.0, v0={"x": v_0})
    z = -c / m * found.t ** (2.0 - alpha)
    assert_allclose(found["x"], v_0 * found.t * mittag_leffler(2.0 - alpha, 2.0, z), rtol=0.0, atol=2e-6)
    assert_allclose(found["v_x"], v_0 * mittag_leffler(2.0 - alpha, 1.0, z), rtol=0.0, atol=1e-5)


# ---- rope and negative spring ---------------------------------------------------------------------------------------


def test_a_rope_is_a_bumper_with_its_plates_exchanged():
    body = [li.Mass("x", 1.0), li.Mass("y", 2.0)]
    rope = li.Scheme(*body, li.Rope("x", "y", slack=0.5, e=0.25)).assemble()
    bumper = li.Scheme(*body, li.Bumper("y", "x", gap=0.5, e=0.25, name="T")).assemble()
    assert_array_equal(rope.H, [[1.0, -1.0]])
    assert_array_equal(rope.H, bumper.H)
    assert_array_equal(rope.u0, bumper.u0)
    assert rope.contacts == bumper.contacts
    # 0.7 apart: stretched by 0.2. A tension pulls x down and y up.
    assert rope.gap(0.0, [0.1, 0.8]).tolist() == pytest.approx([-0.2])
    assert (rope.B @ [1.0]).tolist() == [1.0, -1.0]


@pytest.mark.parametrize("method", ["exact", "moreau-jean"])
def test_jumping_on_a_rope_is_bouncing_in_the_mirror(method):
    """A ball thrown up against a ceiling by g < 0, and one falling into a rope from there."""
    rope = run([li.Mass("x", 1.0), li.Load("x", 9.81), li.Rope("ground", "x", 1.0, e=0.5)], method, dt=1e-3)
    wall = run([li.Mass("x", 1.0), li.Load("x", -9.81), li.Bumper("ground", "x", 1.0, e=0.5)], method, dt=1e-3)
    assert len(rope.events) == len(wall.events) > 0
    assert_array_equal(rope["x"], -wall["x"])
    assert_array_equal(rope["v_x"], -wall["v_x"])


def test_an_elastic_rope_is_a_rope_and_a_spring_in_series():
    """A mass jumps into it: T = k (x - l) while taut, half a sine about the static place."""
    m, k, l, v_0 = 2.0, 50.0, 0.3, 1.2  # noqa: E741
    found = run([li.Mass("x", m), li.Spring("x", "y", k), li.Rope("ground", "y", slack=l)], v0={"x": v_0}, t_end=2.0)
    omega = math.sqrt(k / m)
    s = found.t - l / v_0
    taut = (s >= 0.0) & (s <= math.pi / omega)
    assert_allclose(found["T"], np.where(taut, v_0 * math.sqrt(k * m) * np.sin(omega * s), 0.0), rtol=0.0, atol=1e-10)
    assert found["v_x"][-1] == pytest.approx(-v_0, rel=1e-12)
    assert [event.kind for event in found.events] == ["close", "open"]


@given(k=constants)
def test_a_negative_spring_takes_stiffness_away(k):
    _, terms = matrices(li.NegativeSpring("x", "y", k))
    assert_array_equal(terms.K.value, [[-k, k], [k, -k]])
    assert not terms.C.value.any()
    assert not terms.M.value.any()


def test_what_stands_falls_as_a_hyperbolic_cosine():
    found = run([li.Mass("x", 2.0), li.NegativeSpring("x", "ground", 18.0)], t_end=2.0, q0={"x": 0.1})
    assert_allclose(found["x"], 0.1 * np.cosh(3.0 * found.t), rtol=1e-12)
    energy = found.problem.dynamics.energy(found.q, found.v)
    assert energy[0] == pytest.approx(-0.5 * 18.0 * 0.1**2, rel=1e-14)
    assert_allclose(energy, energy[0], rtol=0.0, atol=1e-11 * 9.0 * found["x"][-1] ** 2)


@pytest.mark.parametrize(
    ("held", "weight"),
    [
        ([li.NegativeSpring("y", "ground", 1.0)], "outweighs"),
        ([li.Spring("x", "y", 1.0), li.NegativeSpring("y", "ground", 2.0)], "outweighs"),
        ([li.Spring("x", "y", 1.0), li.NegativeSpring("y", "ground", 1.0)], "nothing holds"),
        ([li.Spring("x", "y", 1.0), li.Spring("z", "y", 1.0), li.NegativeSpring("z", "ground", 0.6)], "outweighs"),
        # The dashpot between y and z does not hold the two of them.
        (
            [li.Dashpot("z", "y", 9.0), li.Spring("x", "y", 1.0), li.NegativeSpring("z", "ground", 2.0)],
            "outweighs",
        ),
    ],
    ids=lambda v: str(len(v)) if isinstance(v, list) else v,
)
def test_a_negative_spring_holds_no_massless_node(held, weight):
    with pytest.raises(li.InputError, match=rf"node '[yz]'.*{weight}|{weight} node 'y'") as caught:
        li.Scheme(li.Mass("x", 1.0), *held).assemble()
    assert "give it a Mass" in str(caught.value)


def test_a_negative_spring_may_stand_beside_a_stiffer_spring_or_a_dashpot():
    mass, spring = li.Mass("x", 1.0), li.Spring("x", "y", 1.0)
    li.Scheme(mass, spring, li.NegativeSpring("y", "ground", 0.5)).assemble()
    li.Scheme(mass, spring, li.NegativeSpring("y", "ground", 2.0), li.Dashpot("y", "ground", 1.0)).assemble()
    # y' = 2 y/c from y = 1: growth, and no refusal.
    elements = [li.NegativeSpring("y", "ground", 2.0), li.Dashpot("y", "ground", 4.0)]
    found = run(elements, q0={"y": 1.0})
    assert_allclose(found["y"], np.exp(0.5 * found.t), rtol=1e-13)


# ---- bar ------------------------------------------------------------------------------------------------------------

STEEL = {"E": 900.0, "A": 2.0, "rho": 4.0, "L": 6.0}  # c = 15 m/s


def test_bar_by_hand():
    nodes, terms = matrices(li.Bar("a", "b", **STEEL, elements=2, mass="lumped"))
    assert nodes == ["a", "a-b.1", "b"]
    assert_allclose(terms.K.value, 600.0 * np.array([[1, -1, 0], [-1, 2, -1], [0, -1, 1]]), rtol=1e-15)
    assert_allclose(terms.M.value, np.diag([12.0, 24.0, 12.0]), rtol=1e-15)
    _, terms = matrices(li.Bar("a", "b", **STEEL, elements=2))
    assert_allclose(terms.M.value, np.array([[8, 4, 0], [4, 16, 4], [0, 4, 8]]), rtol=1e-14)
    _, terms = matrices(li.Bar("ground", "b", **STEEL, elements=2, mass=0.125))
    assert_allclose(terms.M.value, np.array([[18, 3], [3, 9]]), rtol=1e-14)
    _, terms = matrices(li.Bar("a", "b", **STEEL, elements=2, massless="b"))
    assert_allclose(terms.M.value, np.array([[8, 4, 0], [4, 32, 0], [0, 0, 0]]), rtol=1e-14, atol=1e-14)
    assert not terms.M.value[2].any()


@pytest.mark.parametrize("massless", [(), "a", "b", ("a", "b")], ids=str)
@pytest.mark.parametrize("mass", [*COUPLING_MASSES, 0.2])
def test_a_bar_keeps_its_mass(mass, massless):
    bar = li.Bar("a", "b", **STEEL, elements=5, mass=mass, massless=massless)
    M = bar.mass_matrix()
    assert M.sum() == pytest.approx(48.0, rel=1e-14)
    assert sum(load.f for load in bar.weight(10.0)) == pytest.approx(480.0, rel=1e-14)
    still = [0] * ("a" in bar.massless) + [5] * ("b" in bar.massless)
    assert np.flatnonzero(M.diagonal() == 0.0).tolist() == still
    assert not M[still].any()
    assert eigh(np.delete(np.delete(M, still, 0), still, 1), eigvals_only=True)[0] > 0.1
    dynamics = li.Scheme(bar).assemble()
    assert dynamics.massive.sum() == 6 - len(still)


@pytest.mark.parametrize(("name", "order"), [("lumped", 2), ("consistent", 2), ("higher-order", 4)])
@pytest.mark.parametrize("ends", ["free", "clamped"])
def test_natural_frequencies_have_their_order(name, order, ends):
    """Free-free cκ with κ = jπ/L, clamped-free with κ = (j - 1/2)π/L; the first mode, the third and their errors."""
    errors = []
    for elements in (12, 24, 48):
        bar = li.Bar("a" if ends == "free" else "ground", "b", **STEEL, elements=elements, mass=name)
        _, terms = matrices(bar)
        found = np.sqrt(np.maximum(eigh(terms.K.value, terms.M.value, eigvals_only=True), 0.0))
        j = np.arange(1, 4)
        kappa = (j if ends == "free" else j - 0.5) * math.pi / 6.0
        omega = found[1:4] if ends == "free" else found[:3]
        # The formula of the docstring, then how far it is from the continuum.
        s = np.sin(0.5 * kappa * bar.dx)
        assert_allclose(omega, 2.0 * 15.0 / bar.dx * s / np.sqrt(1.0 - 4.0 * bar.mu * s * s), rtol=1e-9)
        errors.append(np.abs(omega / (15.0 * kappa) - 1.0))
        if order == 2:
            leading = (kappa * bar.dx) ** 2 * (bar.mu / 2.0 - 1.0 / 24.0)
            assert_allclose(omega / (15.0 * kappa) - 1.0, leading, rtol=0.1)
    slopes = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert_allclose(slopes[-1], order, atol=0.1)


@pytest.mark.parametrize("r", [0.25, 0.5, 0.9, 1.0])
def test_for_step_cancels_the_errors_of_space_and_time(r):
    """The trapezoidal rule turns ω into (2/h) atan(ω h/2): to the fourth order cκ, and exactly so for h = Δx/c."""
    errors = []
    for elements in (20, 40):
        plain = li.Bar("ground", "b", **STEEL, elements=elements)
        h = r * plain.dx / plain.wave_speed
        bar = plain.for_step(h)
        assert bar.mass == pytest.approx(1.0 / 12.0 + r * r / 6.0, rel=1e-14)
        _, terms = matrices(bar)
        omega = np.sqrt(eigh(terms.K.value, terms.M.value, eigvals_only=True))[:3]
        kappa = (np.arange(1, 4) - 0.5) * math.pi / 6.0
        errors.append(np.abs(2.0 / h * np.arctan(omega * h / 2.0) / (15.0 * kappa) - 1.0))
    if r == 1.0:
        assert max(error.max() for error in errors) < 1e-10
    else:
        assert_allclose(np.log2(errors[0] / errors[1]), 4.0, atol=0.1)


def test_a_pulse_travels_at_the_wave_speed():
    """A bar pushed at a, F = F_0 sin² over t_0: b moves with twice the arriving velocity from L/c on, and not before."""
    bar = li.Bar("a", "b", **STEEL, elements=120, massless="b").for_step(6.0 / 120 / 15.0)
    push = [li.Load("a", 1.0), li.Load("a", li.Harmonic(-1.0, 2.0 * math.pi / 0.1))]
    found = run([bar, *push], "moreau-jean", dt=6.0 / 120 / 15.0, t_end=0.6)
    Z = 2.0 * math.sqrt(900.0 * 4.0)  # A sqrt(E ρ)
    arriving = np.where(found.t > 0.4, (1.0 - np.cos(2.0 * math.pi * (found.t - 0.4) / 0.1)) / Z, 0.0)
    v = np.gradient(found["b"], found.t)
    assert_allclose(v, 2.0 * arriving, rtol=0.0, atol=0.03 * 4.0 / Z)
    assert np.abs(v[found.t < 0.38]).max() < 1e-3 * 4.0 / Z


def test_a_hanging_bar_is_exact_at_its_nodes():
    """u(x) = ρ g (L x - x²/2)/E, of the bar's own weight; a spring of E A/L from end to end."""
    bar = li.Bar("ground", "b", **STEEL, elements=7)
    dynamics = li.Scheme(bar, *bar.weight(10.0)).assemble()
    x = np.arange(1, 8) * bar.dx
    assert_allclose(
        np.linalg.solve(dynamics.K, dynamics.force(0.0)), 40.0 * (6.0 * x - x * x / 2.0) / 900.0, rtol=1e-12
    )
    assert_allclose(np.linalg.inv(dynamics.K)[-1, -1], 6.0 / (900.0 * 2.0), rtol=1e-12)
    assert [load.node for load in bar.weight(10.0)] == list(dynamics.nodes)


def test_an_elastic_plastic_bar():
    """With its sliders stuck it has the stiffness E A/L, with all of them sliding E_t A/L, and yields at A σ_y."""
    bar = li.Bar("a", "b", **STEEL, elements=4, sigma_y=3.0, E_t=90.0, name="rod")
    dynamics = li.Scheme(bar).assemble()
    assert dynamics.nodes == (
        "a", "rod.F1.1", "rod.1", "rod.F2.1", "rod.2", "rod.F3.1", "rod.3", "rod.F4.1", "b"
    )  # fmt: skip
    assert [contact.name for contact in dynamics.contacts] == ["rod.F1", "rod.F2", "rod.F3", "rod.F4"]
    assert {contact.bounds[1] for contact in dynamics.contacts} == {6.0}

    def end_stiffness(K):
        """Of b against a, with everything else condensed."""
        return 1.0 / np.linalg.inv(K[1:, 1:])[-1, -1]

    assert_allclose(end_stiffness(dynamics.K), 90.0 * 2.0 / 6.0, rtol=1e-12)
    stuck = dynamics.K + 1e12 * dynamics.H.T @ dynamics.H
    assert_allclose(end_stiffness(stuck), 900.0 * 2.0 / 6.0, rtol=1e-6)
    perfect = li.Scheme(dataclasses.replace(bar, E_t=None)).assemble()
    assert np.linalg.matrix_rank(perfect.K) == 4
    assert_allclose(perfect.M, dynamics.M, rtol=0.0, atol=0.0)


@pytest.mark.parametrize("E_t", [None, 90.0])
@pytest.mark.parametrize(("massless", "sliders"), [("a", "234"), ("b", "123"), (("a", "b"), "23")], ids=str)
def test_the_element_of_a_massless_end_stays_elastic(massless, sliders, E_t):
    bar = li.Bar("a", "b", **STEEL, elements=4, massless=massless, sigma_y=3.0, E_t=E_t)
    dynamics = li.Scheme(bar, li.Bumper("b", "ground", gap=1.0, e=None if "b" in massless else 0.0)).assemble()
    assert [contact.name for contact in dynamics.contacts] == [*(f"a-b.F{i}" for i in sliders), "R"]
    assert dynamics.relative_degree[-1] == (0 if "b" in massless else 2)
    assert set(bar.nodes) == {node for piece in bar.pieces() for node in piece.nodes}


def falling_bar(g, v_0, elements, mass, massless, r):
    """Return the run of a bar of E = 900, ρ = A = 1, L = 10 that falls from 5 above a wall, and its step."""
    bar = li.Bar("a", "b", E=900.0, A=1.0, rho=1.0, L=10.0, elements=elements, massless="b" if massless else ())
    h = r * bar.dx / bar.wave_speed
    bar = bar.for_step(h) if mass == "for_step" else dataclasses.replace(bar, mass=mass)
    elements = [bar, *bar.weight(g), li.Bumper("b", "ground", gap=5.0, e=None if massless else 0.0)]
    t_end = 16.0 / 3.0 if g else 2.0
    return run(elements, "moreau-jean", dt=h, t_end=t_end, v0=dict.fromkeys(bar.joints, v_0), progress=False), h


def force_of(g, t):
    """The force of the wall: 300 over [1/2, 7/6]; with gravity 300 ... 500 over [1, 5/3], 500 ... 300 over [11/3, 13/3]."""
    if g == 0.0:
        return np.where((t >= 0.5) & (t <= 7.0 / 6.0), 300.0, 0.0)
    up, down = (t - 1.0) * 1.5, (t - 11.0 / 3.0) * 1.5
    return np.where((up >= 0) & (up <= 1), 300.0 + 200.0 * up, 0.0) + np.where(
        (down >= 0) & (down <= 1), 500.0 - 200.0 * down, 0.0
    )


def error_of_force(found, h, g):
    """∫ |R - R_exact| / ∫ R_exact, with R constant over each step."""
    parts = ((np.arange(16) + 0.5) / 16.0 - 0.5) * h
    closed_form = force_of(g, found.t_reaction[:, None] + parts)
    return np.abs(found["R"][:, None] - closed_form).sum() / closed_form.sum()


def energy_of(found):
    """Stored energy and that of the weight, over 500 J, the energy of the impact."""
    dynamics = found.problem.dynamics
    return (dynamics.energy(found.q, found.v) - found.q @ dynamics.force(0.0)) / 500.0


def greatest_gain(energy):
    return float((energy - np.minimum.accumulate(energy)).max())


@pytest.mark.parametrize(("g", "v_0", "limit"), [(0.0, 10.0, 0.014), (10.0, 0.0, 0.03)])
def test_the_force_on_a_falling_bar(g, v_0, limit):
    found, h = falling_bar(g, v_0, 80, "for_step", True, 1.0)
    assert error_of_force(found, h, g) < limit
    assert greatest_gain(energy_of(found)) < 1e-9
    assert found.problem.dynamics.relative_degree.tolist() == [0]
    assert not any(event.kind == "impact" for event in found.events)


@pytest.mark.parametrize("E_t", [None, 100.0])
def test_the_force_on_a_bar_that_yields(E_t):
    """Behind the elastic wave of the stress σ_y a plastic one follows: σ = σ_y + ρ c_p (v_0 - σ_y/(ρ c))."""
    bar = li.Bar("a", "b", E=900.0, A=1.0, rho=1.0, L=10.0, elements=40, sigma_y=200.0, E_t=E_t)
    h = bar.dx / bar.wave_speed
    contact = li.Bumper("b", "ground", gap=1.0, e=0.0)
    found = run([bar, contact], "moreau-jean", dt=h, t_end=0.5, v0=dict.fromkeys(bar.joints, 10.0))
    plateau = found["R"][(found.t_reaction > 0.2) & (found.t_reaction < 0.4)]
    closed_form = 200.0 + math.sqrt(E_t or 0.0) * (10.0 - 200.0 / 30.0)
    assert_allclose(plateau.mean(), closed_form, rtol=0.01 if E_t else 1e-5)
    assert np.abs(found.reaction[:, :-1]).max() <= 200.0 * (1.0 + 1e-12)
    assert greatest_gain(found.problem.dynamics.energy(found.q, found.v)) < 1e-6


def table_of_settings():
    line = r"^ *(lumped|consistent|higher-order|for_step) +(with mass|massless) +(\S+) +(\S+) % +(\S+) % +(\S+)$"
    rows = re.findall(line, li.Bar.__doc__, re.MULTILINE)
    assert len(rows) == 9
    return rows


@pytest.mark.slow
@pytest.mark.parametrize("row", table_of_settings(), ids=lambda row: ", ".join(row[:3]))
def test_the_table_of_the_bar_is_as_measured(row):
    mass, node, ratio, impact, bouncing, lost = row
    r = float(ratio.split("/")[0]) / float((ratio + "/1").split("/")[1])
    found, h = falling_bar(0.0, 10.0, 400, mass, node == "massless", r)
    assert 100.0 * error_of_force(found, h, 0.0) == pytest.approx(float(impact), rel=0.05)
    found, h = falling_bar(10.0, 0.0, 400, mass, node == "massless", r)
    assert 100.0 * error_of_force(found, h, 10.0) == pytest.approx(float(bouncing), rel=0.05)
    energy = energy_of(found)
    assert energy[0] - energy.min() == pytest.approx(float(lost), rel=0.35)
    assert greatest_gain(energy) < 1e-8
    if mass == "for_step":
        assert float(impact) < 1.0
        assert float(bouncing) < 1.0


# ---- refusals -------------------------------------------------------------------------------------------------------

GOOD = {
    "Maxwell": (("x", "y"), {"k": 1.0, "c": 1.0}),
    "Zener": (("x", "y"), {"k": 1.0, "k_1": 1.0, "c_1": 1.0}),
    "GeneralizedMaxwell": (("x", "y"), {"k_inf": 1.0, "k": (1.0,), "tau": (1.0,)}),
    "SpringPot": (("x", "y"), {"c_alpha": 1.0, "alpha": 0.5, "t_min": 0.1, "t_max": 1.0}),
    "Rope": (("x", "y"), {"slack": 1.0}),
    "NegativeSpring": (("x", "y"), {"k": 1.0}),
    "Bar": (("x", "y"), {"E": 1.0, "A": 1.0, "rho": 1.0, "L": 1.0, "elements": 2}),
}
POSITIVE = [
    ("Maxwell", "k", "N/m"), ("Maxwell", "c", "N s/m"), ("Zener", "k", "N/m"), ("Zener", "k_1", "N/m"),
    ("Zener", "c_1", "N s/m"), ("SpringPot", "c_alpha", "N s^α/m"), ("SpringPot", "t_min", "s"),
    ("SpringPot", "t_max", "s"), ("NegativeSpring", "k", "N/m"), ("Bar", "E", "Pa"), ("Bar", "A", "m²"),
    ("Bar", "rho", "kg/m³"), ("Bar", "L", "m"), ("Bar", "sigma_y", "Pa"),
]  # fmt: skip
NO_NUMBERS = [0.0, -1.0, math.nan, math.inf, "1", True, 1.0j, [1.0]]


@pytest.mark.parametrize("value", NO_NUMBERS, ids=repr)
@pytest.mark.parametrize(("kind", "symbol", "unit"), POSITIVE)
def test_a_constant_that_is_not_positive_is_refused(kind, symbol, unit, value):
    nodes, others = GOOD[kind]
    with pytest.raises(li.InputError) as caught:
        ELEMENTS[kind](*nodes, **(others | {symbol: value}))
    assert str(caught.value).startswith(f"{kind} between 'x' and 'y': {symbol} = ")
    assert str(caught.value).endswith(unit)


@pytest.mark.parametrize("kind", GOOD)
def test_physics_has_no_default(kind):
    nodes, given_ = GOOD[kind]
    for symbol in given_:
        with pytest.raises(li.InputError, match=rf"^{kind} between 'x' and 'y': {symbol} "):
            ELEMENTS[kind](*nodes, **{key: value for key, value in given_.items() if key != symbol})


@pytest.mark.parametrize("kind", GOOD)
def test_ends_and_names_that_are_none_are_refused(kind):
    (a, b), given_ = GOOD[kind]
    with pytest.raises(li.InputError, match=rf"^{kind} .*both ends are one node"):
        ELEMENTS[kind](a, a, **given_)
    for node in ("", 3, None):
        with pytest.raises(li.InputError, match=r"the node name .* must be a string"):
            ELEMENTS[kind](a, node, **given_)
    if "name" in {field.name for field in dataclasses.fields(ELEMENTS[kind])}:
        for name in ("", 3):
            with pytest.raises(li.InputError, match=r"name = .*must be a string"):
                ELEMENTS[kind](a, b, **given_, name=name)


@pytest.mark.parametrize(
    ("kind", "changed", "says"),
    [
        ("GeneralizedMaxwell", {"k_inf": -1.0}, "k_inf = -1.0 must be a finite number in N/m, at least 0"),
        ("GeneralizedMaxwell", {"k_inf": "1"}, "k_inf = '1' must"),
        ("GeneralizedMaxwell", {"k": 1.0}, "k must hold a positive finite number in N/m for each arm"),
        ("GeneralizedMaxwell", {"k": ()}, "k must hold"),
        ("GeneralizedMaxwell", {"k": (1.0, "2")}, "k must hold"),
        ("GeneralizedMaxwell", {"tau": (0.0,)}, "tau must hold a positive finite number in s"),
        ("GeneralizedMaxwell", {"tau": "1"}, "tau must hold"),
        ("GeneralizedMaxwell", {"k": (1.0, 2.0)}, "2 values of k and 1 of tau"),
        ("SpringPot", {"alpha": 0.0}, "alpha = 0.0 must lie between 0 and 1"),
        ("SpringPot", {"alpha": 1.0}, "alpha = 1.0 must lie between 0 and 1"),
        ("SpringPot", {"alpha": math.nan}, "alpha = nan must lie"),
        ("SpringPot", {"t_min": 2.0}, "t_min = 2.0 must be below t_max = 1.0"),
        ("SpringPot", {"rtol": 1e-13}, "rtol = 1e-13 must lie between 1e-12 and 1"),
        ("SpringPot", {"rtol": 1.0}, "rtol = 1.0 must lie"),
        ("Rope", {"slack": math.inf}, "slack = inf must be a finite number in m"),
        ("Rope", {"e": 1.5}, "e = 1.5 must lie between 0 and 1"),
        ("Bar", {"elements": 0}, "elements = 0 must be a whole number from 1 to"),
        ("Bar", {"elements": 2.5}, "elements = 2.5 must be"),
        ("Bar", {"mass": "lump"}, "mass = 'lump' must be 'lumped', 'consistent'"),
        ("Bar", {"mass": 0.3}, "mass = 0.3 must be"),
        ("Bar", {"mass": -0.1}, "mass = -0.1 must be"),
        ("Bar", {"mass": 0.25}, "a zigzag of its nodes has no mass: give massless="),
        ("Bar", {"massless": "z"}, "massless = 'z' must name one of its ends"),
        ("Bar", {"massless": 3}, "massless = 3 must name an end"),
        ("Bar", {"massless": "x", "elements": 1}, "elements = 1 leaves no node to take the mass"),
        ("Bar", {"E_t": 0.5}, "E_t without sigma_y means nothing"),
        ("Bar", {"sigma_y": 1.0, "E_t": 1.0}, "E_t = 1.0 must be below E = 1.0"),
        ("Bar", {"sigma_y": 1.0, "E_t": -1.0}, "E_t = -1.0 must be a positive"),
    ],
)
def test_what_means_nothing_is_refused(kind, changed, says):
    nodes, given_ = GOOD[kind]
    with pytest.raises(li.InputError) as caught:
        ELEMENTS[kind](*nodes, **(given_ | changed))
    assert says in str(caught.value)
    assert str(caught.value).startswith(f"{kind} between 'x' and 'y': ")


def test_a_massless_ground_and_a_step_that_is_too_long_are_refused():
    bar = li.Bar("ground", "b", **STEEL, elements=4)
    with pytest.raises(li.InputError, match=r"massless = 'ground' must name one of its ends that is not the ground"):
        dataclasses.replace(bar, massless="ground")
    for dt in (0.2, 0.0, -0.1):
        with pytest.raises(li.InputError, match=rf"dt = {dt} s must be positive and at most dx/c = 0\.1 s"):
            bar.for_step(dt)


def test_a_contact_of_a_massless_end_takes_no_restitution():
    bar = li.Bar("a", "b", **STEEL, elements=4, massless="b")
    with pytest.raises(li.InputError, match=r"e = 0\.5 means nothing.*relative degree 0"):
        li.Scheme(bar, li.Bumper("b", "ground", gap=1.0, e=0.5)).assemble()
    with pytest.raises(li.InputError, match=r"restitution.*give e="):
        li.Scheme(dataclasses.replace(bar, massless=()), li.Bumper("b", "ground", gap=1.0)).assemble()


# ---- what every element has -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", GOOD)
def test_lists_are_kept_as_tuples_and_an_element_reads_back(kind):
    nodes, given_ = GOOD[kind]
    element = ELEMENTS[kind](*nodes, **given_)
    lists = {key: list(value) if isinstance(value, tuple) else value for key, value in given_.items()}
    assert ELEMENTS[kind](*nodes, **lists) == element
    assert hash(ELEMENTS[kind](*nodes, **lists)) == hash(element)
    assert eval(repr(li.Scheme(element)), {"Scheme": li.Scheme, kind: ELEMENTS[kind]}) == li.Scheme(element)
    for symbol, value in given_.items():
        larger = 2 * value if not isinstance(value, tuple) else tuple(2 * each for each in value)
        if symbol == "alpha":
            larger = 0.75
        assert ELEMENTS[kind](*nodes, **(given_ | {symbol: larger})) != element


@pytest.mark.parametrize("name", list(ELEMENTS))
def test_every_element_teaches(name):
    text = inspect.getdoc(ELEMENTS[name])
    picture = re.search(r"^::\n\n((?: .*\n|\n)+)", text, re.MULTILINE)
    assert picture, "an ASCII picture"
    assert re.search(r"[-=|<>\\/]", picture.group(1))
    assert re.search(r"\bo\b|\+--", picture.group(1)), "with its nodes"
    assert re.search(r"energ|dissipat|power", text), "where its energy goes"
    for section in ("Parameters", "Raises", "Examples"):
        assert f"{section}\n---" in text
    for field in dataclasses.fields(ELEMENTS[name]):
        assert re.search(rf"^(\w+, )*{field.name}(, \w+)* : ", text, re.MULTILINE), field.name


PAGE = (Path(__file__).parents[2] / "docs" / "guide" / "elements.md").read_text(encoding="utf-8")


def test_the_page_of_the_elements_lists_them_all():
    """| element | constants | law | energy |, in the order of the registry, with the constants of the dataclass."""
    elements = PAGE.split("## Signals")[0]
    rows = re.findall(r"^\| `(\w+)` \| ([^|]*) \| ([^|]*) \| ([^|]*) \|$", elements, re.MULTILINE)
    assert [row[0] for row in rows] == list(ELEMENTS)
    for name, constants_, law, energy in rows:
        fields = [field.name for field in dataclasses.fields(ELEMENTS[name]) if field.name != "symbols"]
        assert re.findall(r"`(\w+)`", constants_) == fields, name
        assert law.strip()
        assert energy.strip()


def test_the_example_of_the_page_runs():
    for code in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL):
        exec(compile(code, "elements.md", "exec"), {})


def test_symbols_are_one_for_each_constant():
    with pytest.raises(li.InputError, match=r"symbols = \('k',\) of a KelvinVoigt must be a tuple of 2 strings"):
        li.KelvinVoigt("x", "ground", 1.0, 1.0, symbols=("k",))
