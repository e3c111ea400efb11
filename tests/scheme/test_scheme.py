"""Schemes: the paper's equations by hand, relative degrees, energies, the first-order form, and refusals by name."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import lcpimpact
from lcpimpact import (
    Bumper,
    Dashpot,
    Harmonic,
    InputError,
    Jenkins,
    KelvinVoigt,
    Load,
    Mass,
    Rope,
    Scheme,
    Slider,
    Spring,
    UnsupportedError,
    load_problem,
)
from lcpimpact.scheme.elements import ELEMENTS
from lcpimpact.scheme.first_order import first_order_form

constants = st.integers(1, 10_000).map(lambda i: i / 16.0)
EXACT = {"rtol": 1e-15, "atol": 0.0}
ROUNDING = {"rtol": 1e-13, "atol": 1e-13}


# ---- Eqs (2), (5), (7) by hand --------------------------------------------------------------------------------------


def assert_equations(dynamics, nodes, M, C, K, H, f):
    assert dynamics.nodes == nodes
    np.testing.assert_allclose(dynamics.M, M, **EXACT)
    np.testing.assert_allclose(dynamics.C, C, **EXACT)
    np.testing.assert_allclose(dynamics.K, K, **EXACT)
    np.testing.assert_array_equal(dynamics.H, H)
    np.testing.assert_array_equal(dynamics.u0, np.zeros(1))
    np.testing.assert_allclose(dynamics.force(0.0), f, **EXACT)
    assert [contact.name for contact in dynamics.contacts] == ["R"]


@given(m=constants, k_o=constants, c_o=constants, g=constants)
def test_system_1_is_eq_2(m, k_o, c_o, g):
    """m x'' = m g - R, c_o z' + k_o z = R, u = z - x."""
    dynamics = load_problem("system-1", m=m, k_o=k_o, c_o=c_o, g=g).dynamics
    assert_equations(
        dynamics, ("x", "z"), np.diag([m, 0.0]), np.diag([0.0, c_o]), np.diag([0.0, k_o]), [[-1, 1]], [m * g, 0.0]
    )
    assert dynamics.massive.tolist() == [True, False]


@given(m=constants, k=constants, k_o=constants, c_o=constants, g=constants)
def test_system_2_is_eq_5(m, k, k_o, c_o, g):
    """m x'' = m g - R, k (y - x) = -R, c_o z' + k_o z = R, u = z - y."""
    dynamics = load_problem("system-2", m=m, k=k, k_o=k_o, c_o=c_o, g=g).dynamics
    K = [[k, -k, 0.0], [-k, k, 0.0], [0.0, 0.0, k_o]]
    C, M = np.diag([0.0, 0.0, c_o]), np.diag([m, 0.0, 0.0])
    assert_equations(dynamics, ("x", "y", "z"), M, C, K, [[0, -1, 1]], [m * g, 0.0, 0.0])
    assert dynamics.massive.tolist() == [True, False, False]


@given(m=constants, k=constants, k_o=constants, c=constants, c_o=constants, g=constants)
def test_system_3_is_eq_7(m, k, k_o, c, c_o, g):
    """m x'' = m g - R, c (y' - x') + k (y - x) = -R, c_o z' + k_o z = R, u = z - y."""
    dynamics = load_problem("system-3", m=m, k=k, k_o=k_o, c=c, c_o=c_o, g=g).dynamics
    K = [[k, -k, 0.0], [-k, k, 0.0], [0.0, 0.0, k_o]]
    C = [[c, -c, 0.0], [-c, c, 0.0], [0.0, 0.0, c_o]]
    assert_equations(dynamics, ("x", "y", "z"), np.diag([m, 0.0, 0.0]), C, K, [[0, -1, 1]], [m * g, 0.0, 0.0])


def test_table_1_and_the_fall_from_rest():
    published = {"m": 100.0, "k": 1962.0, "k_o": 3924.0, "c": 125.0, "c_o": 250.0, "g": 9.81, "h_o": 5.0}
    for name, has in (
        ("system-1", "m k_o c_o g h_o"),
        ("system-2", "m k k_o c_o g h_o"),
        ("system-3", " ".join(published)),
    ):
        problem = load_problem(name)
        v_o = problem.parameters["v_o"]
        assert v_o == pytest.approx(9.904544411531507, rel=1e-15)
        assert dict(problem.parameters) == {key: published[key] for key in has.split()} | {"v_o": v_o}
        assert problem.initial_velocities.tolist() == [v_o] + [0.0] * (len(problem.dynamics.nodes) - 1)
        assert problem.initial_coordinates.tolist() == [0.0] * len(problem.dynamics.nodes)
    assert load_problem("system-1", v_o=2.0, h_o=7.0).initial_velocities[0] == 2.0
    assert load_problem("system-1", h_o=20.0, g=10.0).initial_velocities[0] == pytest.approx(20.0, rel=1e-15)


def test_bouncing_ball_by_hand():
    dynamics = load_problem("bouncing-ball", m=2.0, g=3.0, H=4.0, e=0.25).dynamics
    assert dynamics.nodes == ("x",)
    assert (dynamics.M.tolist(), dynamics.C.tolist(), dynamics.K.tolist()) == ([[2.0]], [[0.0]], [[0.0]])
    assert (dynamics.H.tolist(), dynamics.u0.tolist(), dynamics.force(0.0).tolist()) == ([[-1.0]], [4.0], [6.0])
    assert dynamics.restitution.tolist() == [0.25]


def test_the_arrays_cannot_be_changed():
    dynamics = load_problem("system-3").dynamics
    for array in (dynamics.M, dynamics.C, dynamics.K, dynamics.H, dynamics.u0):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 1.0


# ---- relative degrees -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "degree", "plates", "reason"),
    [
        ("system-1", 1, "'x' and 'z'", "the contact plate is massless and rests on a dashpot"),
        ("system-2", 0, "'y' and 'z'", "the contact plate is massless and carried by a spring"),
        ("system-3", 1, "'y' and 'z'", "the contact plate is massless and rests on a dashpot"),
        ("bouncing-ball", 2, "'x' and 'ground'", "both sides have mass"),
    ],
)
def test_relative_degrees_and_their_sentences(name, degree, plates, reason):
    dynamics = load_problem(name).dynamics
    assert dynamics.relative_degree.tolist() == [degree]
    (contact,) = dynamics.contacts
    assert contact.relative_degree == degree
    assert contact.sentence.startswith(f"R between {plates} has relative degree {degree}: {reason}")


@pytest.mark.parametrize(
    ("held", "degree"),
    [
        ([Mass("p", m=1.0)], 2),
        ([Mass("p", m=1.0), KelvinVoigt("p", "ground", k=1.0, c=1.0)], 2),
        ([Dashpot("p", "ground", c=1.0)], 1),
        ([KelvinVoigt("p", "x", k=1.0, c=1.0)], 1),
        ([Spring("p", "ground", k=1.0)], 0),
        # A Maxwell element: the inner node has a dashpot to ground, the plate only a spring.
        ([Spring("p", "i", k=1.0), Dashpot("i", "ground", c=1.0)], 0),
        # Turned round: plate and inner node are joined by a dashpot, and a spring holds both.
        ([Dashpot("p", "i", c=1.0), Spring("i", "ground", k=1.0)], 0),
        # Two dashpots in series to a mass.
        ([Dashpot("p", "i", c=1.0), Dashpot("i", "x", c=1.0)], 1),
    ],
)
def test_relative_degree_of_a_plate(held, degree):
    """A mass meets a plate that is held in different ways."""
    e = 0.5 if degree == 2 else None
    dynamics = Scheme(Mass("x", m=1.0), *held, Bumper("x", "p", gap=1.0, e=e)).assemble()
    assert dynamics.relative_degree.tolist() == [degree]


# ---- gaps, energies, powers -----------------------------------------------------------------------------------------

numbers = st.integers(-200, 200).map(lambda i: i / 8.0)


@given(q=st.tuples(numbers, numbers, numbers), v=st.tuples(numbers, numbers, numbers))
def test_energies_and_powers_of_system_3(q, v):
    dynamics = load_problem("system-3").dynamics
    m, k, k_o, c, c_o, g = 100.0, 1962.0, 3924.0, 125.0, 250.0, 9.81
    (x, y, z), (dx, dy, dz) = q, v
    kinetic = 0.5 * m * dx**2
    elastic = 0.5 * k * (y - x) ** 2 + 0.5 * k_o * z**2
    close = {"rel": 1e-12, "abs": 1e-6}
    assert float(dynamics.kinetic_energy(q, v)) == pytest.approx(kinetic, **close)
    assert float(dynamics.elastic_energy(q)) == pytest.approx(elastic, **close)
    assert float(dynamics.energy(q, v)) == pytest.approx(kinetic + elastic, **close)
    assert float(v @ dynamics.C @ v) == pytest.approx(c * (dy - dx) ** 2 + c_o * dz**2, **close)
    assert float(dynamics.force(0.0) @ v) == pytest.approx(m * g * dx, **close)
    assert dynamics.gap(0.0, q).tolist() == [z - y]
    assert dynamics.gap_rate(0.0, q, v).tolist() == [dz - dy]


def test_energies_of_many_states_at_once():
    dynamics = load_problem("system-3").dynamics
    rng = np.random.default_rng(1)
    q, v = rng.normal(size=(2, 4, 5, 3))
    for function, arguments in (
        (dynamics.kinetic_energy, (q, v)),
        (dynamics.elastic_energy, (q,)),
        (dynamics.energy, (q, v)),
    ):
        many = function(*arguments)
        assert many.shape == (4, 5)
        np.testing.assert_allclose(many[2, 3], function(*(a[2, 3] for a in arguments)), rtol=1e-14, atol=0.0)
    assert dynamics.gap(0.0, q).shape == dynamics.gap_rate(0.0, q, v).shape == (4, 5, 1)


def test_gaps_have_the_opening_of_the_bumper():
    dynamics = Scheme(Mass("x", m=1.0), Bumper("x", "ground", gap=0.75, e=0.0), Mass("y", m=1.0),
                      Bumper("y", "x", gap=-0.5, e=1.0, name="S")).assemble()  # fmt: skip
    assert dynamics.gap(0.0, [0.25, -2.0]).tolist() == [0.5, 1.75]
    assert dynamics.gap_rate(0.0, [0.25, -2.0], [3.0, 1.0]).tolist() == [-3.0, 2.0]


def test_loads_add_up_and_depend_on_time():
    push = Harmonic(amplitude=2.0, omega=3.0, phase=0.5)
    scheme = Scheme(Mass("x", m=1.0), Mass("y", m=1.0), Load("y", f=5.0), Load("y", f=-1.5), Load("x", f=push),
                    Load("x", f=lambda t: t**2))  # fmt: skip
    dynamics = scheme.assemble()
    t = np.array([[0.0, 0.5], [1.0, 2.0]])
    assert not dynamics.constant_loads
    assert dynamics.force(t).shape == (2, 2, 2)
    np.testing.assert_allclose(dynamics.force(t)[..., 0], 2.0 * np.cos(3.0 * t + 0.5) + t**2, rtol=1e-15, atol=0.0)
    np.testing.assert_array_equal(dynamics.force(t)[..., 1], 3.5 * np.ones((2, 2)))
    power = float(dynamics.force(0.5) @ [2.0, -1.0])
    assert power == pytest.approx(2.0 * (2.0 * math.cos(2.0) + 0.25) - 3.5, rel=1e-14)
    assert load_problem("system-1").dynamics.constant_loads


# ---- the first-order form -------------------------------------------------------------------------------------------


@given(m=constants, k_o=constants, c_o=constants, g=constants)
def test_first_order_form_of_system_1(m, k_o, c_o, g):
    """X = (x, z, x', 1): z' = -(k_o/c_o) z + R/c_o, x'' = g - R/m, u = z - x."""
    lcs = first_order_form(load_problem("system-1", m=m, k_o=k_o, c_o=c_o, g=g).dynamics)
    A = [[0, 0, 1, 0], [0, -k_o / c_o, 0, 0], [0, 0, 0, g], [0, 0, 0, 0]]
    np.testing.assert_allclose(lcs.A, A, **ROUNDING)
    np.testing.assert_allclose(lcs.B, [[0.0], [1.0 / c_o], [-1.0 / m], [0.0]], **ROUNDING)
    np.testing.assert_allclose(lcs.C, [[-1.0, 1.0, 0.0, 0.0]], **ROUNDING)
    np.testing.assert_allclose(lcs.D, [[0.0]], **ROUNDING)
    np.testing.assert_allclose(lcs.Q, [[1, 0, 0, 0], [0, 1, 0, 0]], **ROUNDING)
    np.testing.assert_allclose(lcs.Qr, [[0.0], [0.0]], **ROUNDING)
    np.testing.assert_array_equal(lcs.state([2.0, 3.0], [4.0, 99.0]), [2.0, 3.0, 4.0, 1.0])


@given(m=constants, k=constants, k_o=constants, c_o=constants, g=constants)
def test_first_order_form_of_system_2(m, k, k_o, c_o, g):
    """y = x - R/k is eliminated, so u = z - x + R/k: relative degree zero."""
    lcs = first_order_form(load_problem("system-2", m=m, k=k, k_o=k_o, c_o=c_o, g=g).dynamics)
    A = [[0, 0, 1, 0], [0, -k_o / c_o, 0, 0], [0, 0, 0, g], [0, 0, 0, 0]]
    np.testing.assert_allclose(lcs.A, A, **ROUNDING)
    np.testing.assert_allclose(lcs.B, [[0.0], [1.0 / c_o], [-1.0 / m], [0.0]], **ROUNDING)
    np.testing.assert_allclose(lcs.C, [[-1.0, 1.0, 0.0, 0.0]], **ROUNDING)
    np.testing.assert_allclose(lcs.D, [[1.0 / k]], **ROUNDING)
    np.testing.assert_allclose(lcs.Q, [[1, 0, 0, 0], [1, 0, 0, 0], [0, 1, 0, 0]], **ROUNDING)
    np.testing.assert_allclose(lcs.Qr, [[0.0], [-1.0 / k], [0.0]], **ROUNDING)
    np.testing.assert_array_equal(lcs.state([2.0, -7.0, 3.0], [4.0, 0.0, 0.0]), [2.0, 3.0, 4.0, 1.0])


@given(m=constants, k=constants, k_o=constants, c=constants, c_o=constants, g=constants)
def test_first_order_form_of_system_3(m, k, k_o, c, c_o, g):
    """X = (x, y, z, x', 1): y' = x' + (k/c)(x - y) - R/c; in m x'' the spring and dashpot sum to R."""
    lcs = first_order_form(load_problem("system-3", m=m, k=k, k_o=k_o, c=c, c_o=c_o, g=g).dynamics)
    A = np.zeros((5, 5))
    A[0, 3] = 1.0
    A[1] = [k / c, -k / c, 0.0, 1.0, 0.0]
    A[2, 2] = -k_o / c_o
    A[3, 4] = g
    big = 1e-13 * (1.0 + (k + c) / m + k / c)
    np.testing.assert_allclose(lcs.A, A, rtol=1e-13, atol=big)
    np.testing.assert_allclose(lcs.B[:, 0], [0.0, -1.0 / c, 1.0 / c_o, -1.0 / m, 0.0], rtol=1e-12, atol=big)
    np.testing.assert_allclose(lcs.C, [[0.0, -1.0, 1.0, 0.0, 0.0]], **ROUNDING)
    np.testing.assert_allclose(lcs.D, [[0.0]], **ROUNDING)


@given(m=constants, k=constants, c=constants)
def test_first_order_form_of_a_maxwell_bumper(m, k, c):
    """A plate p on a spring on a dashpot: k (p - i) = R and c i' = R, so i' = R/c and u = i + R/k - x."""
    scheme = Scheme(Mass("x", m=m), Bumper("x", "p"), Spring("p", "i", k=k), Dashpot("i", "ground", c=c))
    lcs = first_order_form(scheme.assemble())  # nodes x, p, i; X = (x, i, x', 1)
    np.testing.assert_allclose(lcs.A, [[0, 0, 1, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(lcs.B[:, 0], [0.0, 1.0 / c, -1.0 / m, 0.0], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(lcs.C, [[-1.0, 1.0, 0.0, 0.0]], **ROUNDING)
    np.testing.assert_allclose(lcs.D, [[1.0 / k]], **ROUNDING)


def test_a_callable_load_has_no_first_order_form():
    dynamics = Scheme(Mass("x", m=1.0), Load("x", f=math.sin)).assemble()
    with pytest.raises(UnsupportedError, match=r"'x'.*Harmonic.*moreau-jean"):
        first_order_form(dynamics)


@st.composite
def schemes(draw) -> Scheme:
    """Massive and massless nodes, each held by a spring, a dashpot or both; more links, loads, up to two bumpers."""
    n = draw(st.integers(1, 5))
    nodes = [f"n{i}" for i in range(n)]
    elements: list = [Mass(node, m=draw(constants)) for node in nodes if draw(st.booleans())]
    links = [(i, draw(st.integers(-1, i - 1))) for i in range(n)]
    pairs = [(i, j) for i in range(n) for j in range(-1, i)]
    links += draw(st.lists(st.sampled_from(pairs), max_size=3))
    value = st.integers(1, 64).map(lambda i: i / 8.0)
    for i, j in links:
        a, b = nodes[i], "ground" if j < 0 else nodes[j]
        kind = draw(st.sampled_from(["k", "c", "kc"]))
        if kind == "k":
            elements.append(Spring(a, b, k=draw(value)))
        elif kind == "c":
            elements.append(Dashpot(b, a, c=draw(value)))
        else:
            elements.append(KelvinVoigt(a, b, k=draw(value), c=draw(value)))
    for node in nodes:
        load = draw(st.sampled_from([None, "constant", "harmonic"]))
        if load == "constant":
            elements.append(Load(node, f=draw(numbers)))
        elif load == "harmonic":
            elements.append(Load(node, f=Harmonic(draw(numbers), draw(value), draw(numbers))))
    # Bumpers along a path through the nodes and the ground never close a loop.
    path = draw(st.permutations([*nodes, "ground"]))
    for i in range(min(draw(st.integers(0, 2)), len(path) - 1)):
        gap, name = draw(value), f"R{i}"
        for e in (None, 0.5):
            bumper = Bumper(path[i], path[i + 1], gap=gap, e=e, name=name)
            try:
                Scheme(*elements, bumper).assemble()
            except InputError:
                continue
            elements.append(bumper)
    return Scheme(*draw(st.permutations(elements)))


@given(scheme=schemes(), data=st.data())
def test_the_first_order_form_satisfies_the_equations_it_came_from(scheme, data):
    """M q'' + C q' + K q = f + Hᵀ r for any state and any r, with the eliminated coordinates put back."""
    dynamics = scheme.assemble()
    lcs = first_order_form(dynamics)
    Em, Ed, Es = lcs.parts.massive, lcs.parts.damped, lcs.parts.static
    nm, nd = Em.shape[1], Ed.shape[1]
    t = data.draw(numbers)
    coordinates = np.array(data.draw(st.lists(numbers, min_size=2 * nm + nd, max_size=2 * nm + nd)))
    r = np.array(data.draw(st.lists(numbers, min_size=len(dynamics.H), max_size=len(dynamics.H))))
    harmonics = [load for _, load in dynamics.loads if isinstance(load, Harmonic)]
    waves = [wave(h.omega * t + h.phase) for h in harmonics for wave in (math.cos, math.sin)]
    X = np.concatenate([coordinates, [1.0], waves])

    rate = lcs.A @ X + lcs.B @ r
    q = lcs.Q @ X + lcs.Qr @ r
    velocity = Em @ rate[:nm] + Ed @ rate[nm : nm + nd]  # and any rate of the static ones, which C does not see
    acceleration = Em @ rate[nm + nd : 2 * nm + nd]
    terms = [
        dynamics.M @ acceleration,
        dynamics.C @ velocity,
        dynamics.K @ q,
        -dynamics.force(t),
        -dynamics.H.T @ r,
    ]
    size = 1.0 + sum(np.abs(term).max() for term in terms) + np.abs(dynamics.K).max() * np.abs(q).max()
    np.testing.assert_allclose(sum(terms), 0.0, rtol=0.0, atol=1e-9 * size)
    np.testing.assert_allclose(rate[:nm], X[nm + nd : 2 * nm + nd], rtol=0.0, atol=1e-12 * (1.0 + np.abs(X).max()))
    np.testing.assert_allclose(
        lcs.C @ X + lcs.D @ r, dynamics.gap(0.0, q), rtol=1e-10, atol=1e-9 * (1.0 + np.abs(q).max())
    )
    # The load states turn as their harmonics do.
    turning = [
        h.omega * d for h in harmonics for d in (-math.sin(h.omega * t + h.phase), math.cos(h.omega * t + h.phase))
    ]
    np.testing.assert_allclose(rate[2 * nm + nd :], [0.0, *turning], rtol=1e-12, atol=1e-12)
    # The basis is one: massive nodes are unit vectors, dashpots do not see the static ones, and nothing is lost.
    assert np.linalg.matrix_rank(np.column_stack([Em, Ed, Es])) == len(dynamics.nodes)
    assert ((np.diag(dynamics.M) > 0.0) == Em.any(axis=1)).all()
    np.testing.assert_allclose(dynamics.C @ Es, 0.0, rtol=0.0, atol=1e-12 * (1.0 + np.abs(dynamics.C).max()))


@given(scheme=schemes())
def test_the_relative_degree_is_where_r_first_appears(scheme):
    """The Markov parameters D, C B, C A B of each row: the first that is not zero."""
    dynamics = scheme.assemble()
    lcs = first_order_form(dynamics)
    for i, degree in enumerate(dynamics.relative_degree):
        markov = [lcs.D[i, i], lcs.C[i] @ lcs.B[:, i], lcs.C[i] @ lcs.A @ lcs.B[:, i]]
        assert abs(markov[degree]) > 1e-7
        sizes = [np.abs(lcs.D).max(), np.abs(lcs.C[i]) @ np.abs(lcs.B[:, i]), 0.0]
        for lower in range(degree):
            assert abs(markov[lower]) <= 1e-10 * (1.0 + sizes[lower])


@given(scheme=schemes(), data=st.data())
def test_the_initial_state_reads_back(scheme, data):
    dynamics = scheme.assemble()
    lcs = first_order_form(dynamics)
    n = len(dynamics.nodes)
    q, v = (np.array(data.draw(st.lists(numbers, min_size=n, max_size=n))) for _ in range(2))
    X = lcs.state(q, v)
    assert X.shape == (len(lcs.A),)
    difference = q - lcs.Q @ X
    Es = lcs.parts.static
    shift = np.linalg.lstsq(Es, difference, rcond=None)[0] if Es.size else np.zeros(0)
    np.testing.assert_allclose(Es @ shift, difference, rtol=0.0, atol=1e-8 * (1.0 + np.abs(lcs.Q @ X).max()))
    f = dynamics.force(0.0)
    static_balance = Es.T @ (f - dynamics.K @ (lcs.Q @ X))
    np.testing.assert_allclose(static_balance, 0.0, rtol=0.0, atol=1e-8 * (1.0 + np.abs(lcs.Q @ X).max() * 64.0))


@given(scheme=schemes(), data=st.data())
def test_matrices_are_symmetric_and_the_energies_positive(scheme, data):
    dynamics = scheme.assemble()
    n = len(dynamics.nodes)
    for matrix in (dynamics.M, dynamics.C, dynamics.K):
        assert (matrix == matrix.T).all()
    v = np.array(data.draw(st.lists(numbers, min_size=n, max_size=n)))
    slack = -1e-9 * (1.0 + (v @ v) * 1e3)
    assert dynamics.kinetic_energy(v, v) >= 0.0
    assert dynamics.elastic_energy(v) >= slack
    assert v @ dynamics.C @ v >= slack


@given(scheme=schemes(), shift=numbers)
def test_links_feel_no_rigid_motion(scheme, shift):
    """Without the links to the ground, moving all nodes as one stretches nothing."""
    inner = [
        e for e in scheme.elements
        if "ground" not in e.nodes and not isinstance(e, Bumper)
    ]  # fmt: skip
    assume(inner)
    massed = [Mass(node, m=1.0) for node in {node for e in inner for node in e.nodes}]
    dynamics = Scheme(*inner, *massed).assemble()
    together = np.full(len(dynamics.nodes), shift)
    np.testing.assert_allclose(dynamics.K @ together, 0.0, rtol=0.0, atol=1e-12 * (1.0 + abs(shift)) * 640.0)
    np.testing.assert_allclose(dynamics.C @ together, 0.0, rtol=0.0, atol=1e-12 * (1.0 + abs(shift)) * 640.0)


# ---- refusals -------------------------------------------------------------------------------------------------------

BODY = (Mass("x", m=1.0), Load("x", f=9.81))


@pytest.mark.parametrize(
    "loose",
    [
        (Bumper("x", "lost"),),
        (Load("lost", f=1.0),),
        (Spring("lost", "lost2", k=1.0),),
        (KelvinVoigt("lost", "lost2", k=1.0, c=2.0), Bumper("x", "lost2")),
        (Dashpot("lost", "lost2", c=0.1), Spring("lost2", "lost3", k=0.3)),
    ],
)
def test_a_loose_massless_node_is_refused_by_name(loose):
    with pytest.raises(InputError, match=r"nothing holds node 'lost'.*Spring or a Dashpot"):
        Scheme(*BODY, *loose).assemble()
    # Held anywhere, it is accepted.
    assert "lost" in Scheme(*BODY, *loose, Dashpot("lost", "ground", c=1.0)).assemble().nodes
    assert "lost" in Scheme(*BODY, *loose, Spring("x", "lost", k=1.0)).assemble().nodes


def test_an_empty_scheme_is_refused():
    with pytest.raises(InputError, match=r"no element.*add"):
        Scheme().assemble()


@pytest.mark.parametrize(
    "bumpers",
    [
        (Bumper("x", "ground", gap=1.0, e=0.0), Bumper("x", "ground", gap=1.0, e=0.0, name="S")),
        (Bumper("x", "ground", e=0.0), Bumper("ground", "x", e=0.0, name="S")),
        (Bumper("x", "ground", gap=1.0, e=0.0), Bumper("ground", "x", gap=-1.0, e=0.0, name="S")),
        (
            Mass("y", m=1.0),
            Bumper("x", "y", gap=1.0, e=0.0, name="P"),
            Bumper("y", "ground", gap=2.0, e=0.0),
            Bumper("x", "ground", gap=3.0, e=0.0, name="S"),
        ),
    ],
)
def test_bumpers_that_close_together_in_parallel_are_refused_by_name(bumpers):
    with pytest.raises(InputError, match=r"'S'.*parallel.*'R'.*remove one of them"):
        Scheme(*BODY, *bumpers).assemble()


@pytest.mark.parametrize(
    "bumpers",
    [
        (Bumper("x", "ground", gap=1.0, e=0.0), Bumper("ground", "x", gap=1.0, e=0.0, name="S")),
        (Bumper("x", "ground", gap=1.0, e=0.0), Bumper("ground", "x", gap=0.0, e=0.0, name="S")),
        (Bumper("x", "ground", gap=1.0, e=0.0), Bumper("x", "ground", gap=2.0, e=0.0, name="S")),
        (
            Mass("y", m=1.0),
            Bumper("x", "y", gap=1.0, e=0.0, name="P"),
            Bumper("y", "ground", gap=2.0, e=0.0),
            Bumper("ground", "x", gap=0.5, e=0.0, name="S"),
        ),
        # No two of these three can be closed at once, nor all of them.
        (
            Bumper("x", "ground", gap=1.0, e=0.0),
            Bumper("ground", "x", gap=1.0, e=0.0, name="S"),
            Bumper("x", "ground", gap=2.0, e=0.0, name="T"),
        ),
        # Two bodies between two walls, each with its own stop: at most two of the four are closed at once.
        (
            Mass("y", m=1.0),
            Bumper("ground", "x", gap=1.0, e=0.0),
            Bumper("x", "ground", gap=1.0, e=0.0, name="S"),
            Bumper("x", "y", gap=0.5, e=0.0, name="T"),
            Bumper("y", "ground", gap=3.0, e=0.0, name="U"),
        ),
    ],
    ids=["two stops", "two stops, touching one", "a nearer stop", "a row of two", "three stops", "two in a box"],
)
def test_bumpers_that_cannot_close_together_are_accepted(bumpers):
    dynamics = Scheme(*BODY, *bumpers).assemble()
    assert len(dynamics.contacts) == sum(isinstance(each, Bumper) for each in bumpers)


def test_a_body_between_two_stops_runs():
    box = Scheme(
        Mass("x", m=1.0), Bumper("x", "ground", gap=1.0, e=1.0), Bumper("ground", "x", gap=1.0, e=1.0, name="S")
    )
    problem = lcpimpact.Problem("box", box, v0={"x": 1.0})
    traj = lcpimpact.simulate(problem, "exact", dt=0.5, t_end=6.5)
    np.testing.assert_allclose([event.t for event in traj.events], [1.0, 3.0, 5.0], rtol=1e-12, atol=0.0)
    assert [event.contact for event in traj.events] == ["R", "S", "R"]
    assert traj["x"][-1] == pytest.approx(-0.5, abs=1e-12)


def two_bumpers(**names):
    return [Bumper(node, "ground", e=0.0, name=names.get(node)) for node in "xy"]


def reactions(scheme):
    return [contact.name for contact in scheme.assemble().contacts]


def test_two_reactions_of_one_name_are_refused():
    with pytest.raises(InputError, match=r"same name 'A'.*name="):
        Scheme(*BODY, Mass("y", m=1.0), *two_bumpers(x="A", y="A")).assemble()
    named = Scheme(*BODY, Mass("y", m=1.0), *two_bumpers()).add(Mass("z", m=1.0))
    with pytest.raises(InputError, match=r"same name 'R_2'.*name="):
        named.add(Bumper("z", "ground", e=0.0, name="R_2")).assemble()


def test_reactions_without_a_name_are_numbered_in_the_order_of_the_elements():
    bodies = [Mass(node, m=1.0) for node in "xyz"]
    springs = [Slider("x", "y", r0=1.0), Jenkins("y", "z", k=1.0, f_y=2.0), Rope("x", "ground", slack=1.0, e=0.0)]
    scheme = Scheme(*bodies, *two_bumpers(), *springs)
    assert reactions(scheme) == ["R", "R_2", "F", "F_2", "T"]
    assert scheme.assemble().nodes == (*"xyz", "F_2.1")
    scheme.add(Bumper("z", "ground", e=0.0), Rope("y", "ground", slack=1.0, e=0.0))
    assert reactions(scheme) == ["R", "R_2", "F", "F_2", "T", "R_3", "T_2"], "what has a name keeps it"


def test_names_that_are_given_are_kept_and_passed_over():
    bodies = [Mass("x", m=1.0), Mass("y", m=1.0), Mass("z", m=1.0)]
    third = Bumper("z", "ground", e=0.0)
    assert reactions(Scheme(*bodies, *two_bumpers(y="R"), third)) == ["R_2", "R", "R_3"]
    assert reactions(Scheme(*bodies, *two_bumpers(x="R_2"), third)) == ["R_2", "R", "R_3"]


def test_a_numbered_bumper_is_drawn_by_its_name_unless_told_otherwise():
    told = Bumper("z", "ground", e=0.0, symbols=("N",))
    scheme = Scheme(*(Mass(node, m=1.0) for node in "xyz"), *two_bumpers(), told)
    assert [each.symbols for each in scheme.elements[3:]] == [("R",), ("R_2",), ("N",)]


@pytest.mark.parametrize(
    ("elements", "clash"),
    [
        ((Mass("R", m=1.0), Bumper("R", "ground", gap=1.0, e=0.0)), "R"),
        ((Mass("x", m=1.0), Bumper("x", "ground", gap=1.0, e=0.0, name="v_x")), "v_x"),
        ((Mass("x", m=1.0), Mass("v_x", m=1.0)), "v_x"),
        ((Mass("t", m=1.0),), "t"),
        ((Mass("t_R", m=1.0),), "t_R"),
        ((Mass("x", m=1.0), Bumper("x", "ground", gap=1.0, e=0.0, name="t")), "t"),
    ],
)
def test_names_that_a_run_could_not_tell_apart_are_refused(elements, clash):
    """traj["R"], or a column of the CSV, would be two things."""
    with pytest.raises(InputError, match=f"'{clash}'"):
        Scheme(*elements).assemble()


@pytest.mark.parametrize("name", ["", 3, True], ids=repr)
def test_a_reaction_without_a_name_is_refused(name):
    with pytest.raises(InputError, match="name"):
        Bumper("x", "z", name=name)


def test_restitution_is_needed_where_impulses_act_and_meaningless_elsewhere():
    with pytest.raises(InputError, match=r"Bumper between 'x' and 'ground'.*restitution.*give e="):
        Scheme(*BODY, Bumper("x", "ground", gap=1.0)).assemble()
    for held, degree in ((Dashpot("z", "ground", c=1.0), 1), (Spring("z", "ground", k=1.0), 0)):
        with pytest.raises(
            InputError, match=rf"Bumper between 'x' and 'z'.*e = 0\.5 means nothing.*{degree}.*leave e out"
        ):
            Scheme(*BODY, held, Bumper("x", "z", e=0.5)).assemble()
        assert Scheme(*BODY, held, Bumper("x", "z")).assemble().restitution.tolist() == [0.0]


CONSTANTS = [
    ("Mass", ("p",), {}, "m", "kg"),
    ("Spring", ("p", "q"), {}, "k", "N/m"),
    ("Dashpot", ("p", "q"), {}, "c", "N s/m"),
    ("KelvinVoigt", ("p", "q"), {"c": 1.0}, "k", "N/m"),
    ("KelvinVoigt", ("p", "q"), {"k": 1.0}, "c", "N s/m"),
]
BAD_CONSTANTS = [0, 0.0, -0.0, -1.0, math.nan, math.inf, -math.inf, "1", True, 1.0j, [1.0], 10**400]


@pytest.mark.parametrize("value", BAD_CONSTANTS, ids=lambda v: repr(v)[:8])
@pytest.mark.parametrize(("kind", "nodes", "others", "symbol", "unit"), CONSTANTS)
def test_a_constant_that_is_not_positive_and_finite_is_refused(kind, nodes, others, symbol, unit, value):
    with pytest.raises(InputError) as caught:
        ELEMENTS[kind](*nodes, **others, **{symbol: value})
    text = str(caught.value)
    assert f"{symbol} = " in text
    assert "positive finite" in text
    assert text.endswith(unit)
    assert all(repr(node) in text for node in nodes)


@pytest.mark.parametrize(("kind", "nodes", "others", "symbol", "unit"), CONSTANTS)
def test_physics_has_no_default(kind, nodes, others, symbol, unit):
    with pytest.raises(InputError, match=rf"{kind}.*'p'.*{symbol} is missing; give .* {unit}$"):
        ELEMENTS[kind](*nodes, **others)


@pytest.mark.parametrize("gap", [math.nan, math.inf, None, "1", True], ids=repr)
def test_a_gap_that_is_no_number_is_refused(gap):
    with pytest.raises(InputError, match=r"Bumper between 'x' and 'z'.*gap = .*finite"):
        Bumper("x", "z", gap=gap)


@pytest.mark.parametrize("e", [-0.1, 1.1, math.nan, math.inf, "0.5", True], ids=repr)
def test_a_restitution_outside_0_to_1_is_refused(e):
    with pytest.raises(InputError, match=r"Bumper between 'x' and 'z'.*e = .*between 0 and 1"):
        Bumper("x", "z", e=e)


@pytest.mark.parametrize("f", [math.nan, math.inf, "9.81", True, 1.0j, [1.0]], ids=repr)
def test_a_load_that_is_no_force_is_refused(f):
    with pytest.raises(InputError, match=r"Load at 'x'.*f = .*finite force"):
        Load("x", f=f)


def test_a_load_that_is_missing_is_refused():
    with pytest.raises(InputError, match=r"Load at 'x'.*f is missing"):
        Load("x")


@pytest.mark.parametrize(
    "values", [(math.nan, 1.0, 0.0), (1.0, 0.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, math.inf), ("1", 1.0, 0.0)], ids=repr
)
def test_a_harmonic_that_is_none_is_refused(values):
    with pytest.raises(InputError, match=r"amplitude, omega and phase must be finite.*omega above zero"):
        Harmonic(*values)


@pytest.mark.parametrize("kind", ["Spring", "Dashpot", "KelvinVoigt", "Bumper"])
@pytest.mark.parametrize("node", ["x", "ground"])
def test_one_node_at_both_ends_is_refused(kind, node):
    given_ = {"Spring": {"k": 1.0}, "Dashpot": {"c": 1.0}, "KelvinVoigt": {"k": 1.0, "c": 1.0}, "Bumper": {}}[kind]
    with pytest.raises(InputError, match=f"'{node}'.*both ends are one node"):
        ELEMENTS[kind](node, node, **given_)


@pytest.mark.parametrize("node", ["", 3, None], ids=repr)
def test_a_node_that_is_no_name_is_refused(node):
    for make in (
        lambda: Mass(node, m=1.0),
        lambda: Load(node, f=1.0),
        lambda: Spring("x", node, k=1.0),
        lambda: Dashpot(node, "x", c=1.0),
        lambda: Bumper("x", node),
    ):
        with pytest.raises(InputError, match=r"the node name .* must be a string"):
            make()


def test_mass_and_load_on_the_ground_are_refused():
    with pytest.raises(InputError, match=r"Mass at 'ground'.*ground does not move"):
        Mass("ground", m=1.0)
    with pytest.raises(InputError, match=r"Load at 'ground'.*name another node"):
        Load("ground", f=1.0)


@pytest.mark.parametrize("thing", ["Mass", 3, None, Mass, Scheme()], ids=repr)
def test_only_elements_are_added(thing):
    with pytest.raises(InputError, match=r"not an element.*Mass"):
        Scheme(thing)
    scheme = Scheme(*BODY)
    with pytest.raises(InputError, match="not an element"):
        scheme.add(Mass("y", m=1.0), thing)
    assert scheme.elements == BODY


# ---- equality and repr ----------------------------------------------------------------------------------------------

NAMESPACE = {name: getattr(lcpimpact, name) for name in [*ELEMENTS, "Scheme", "Harmonic"]}


@given(scheme=schemes())
def test_repr_evaluates_to_an_equal_scheme(scheme):
    again = eval(repr(scheme), dict(NAMESPACE))
    assert again == scheme
    first, second = scheme.assemble(), again.assemble()
    for name in ("M", "C", "K", "H", "u0"):
        assert getattr(first, name).tobytes() == getattr(second, name).tobytes()


@pytest.mark.parametrize("name", ["system-1", "system-2", "system-3", "bouncing-ball"])
def test_repr_of_the_registered_schemes(name):
    scheme = load_problem(name).scheme
    assert eval(repr(scheme), dict(NAMESPACE)) == scheme


def test_equality_sees_every_difference():
    base = Scheme(*BODY, Bumper("x", "z"), KelvinVoigt("z", "ground", k=2.0, c=3.0))
    assert base == Scheme(*BODY).add(Bumper("x", "z")).add(KelvinVoigt("z", "ground", k=2.0, c=3.0))
    for other in (
        Scheme(*BODY),
        Scheme(*BODY, Bumper("x", "z", gap=1.0), KelvinVoigt("z", "ground", k=2.0, c=3.0)),
        Scheme(*BODY, Bumper("x", "z"), KelvinVoigt("z", "ground", k=2.0, c=3.5)),
        Scheme(*BODY, Bumper("x", "z"), Spring("z", "ground", k=2.0)),
        "Scheme",
    ):
        assert base != other
    with pytest.raises(TypeError, match="unhashable"):
        hash(base)


def test_add_returns_the_scheme_and_keeps_the_order():
    scheme = Scheme(Spring("b", "ground", k=1.0))
    assert scheme.add(Mass("a", m=1.0), Mass("b", m=2.0)) is scheme
    assert scheme.assemble().nodes == ("b", "a")
    assert scheme.assemble().M.diagonal().tolist() == [2.0, 1.0]


def test_a_node_that_only_springs_hold_begins_in_balance():
    """Nothing moves it from q0 = 0 to f/k, where the balance of energy would miss f²/2k."""
    loaded = lcpimpact.Scheme(lcpimpact.Spring("x", "ground", 2.0), lcpimpact.Load("x", 1.0))
    between = lcpimpact.Scheme(
        lcpimpact.Mass("y", 1.0),
        lcpimpact.Spring("y", "x", 2.0),
        lcpimpact.Spring("x", "ground", 1.0),
        lcpimpact.Load("x", 1.0),
    )
    stopped = lcpimpact.Scheme(
        lcpimpact.Spring("x", "ground", 1.0), lcpimpact.Load("x", 1.0), lcpimpact.Bumper("x", "ground", gap=0.5)
    )
    for scheme, place in ((loaded, 0.5), (between, 1.0 / 3.0), (stopped, 0.5)):
        problem = lcpimpact.Problem("static", scheme, t_end=1.0)
        for method in ("moreau-jean", "radau", "exact", "rk4"):
            run = lcpimpact.simulate(problem, method, dt=0.1, progress=False)
            assert run["x"][0] == pytest.approx(place, abs=1e-14)
            assert run.certificate.energy_balance < 1e-6
            assert "begin in balance, and not where q0 says: 'x'." in run.message
    begun = lcpimpact.Problem("static", loaded, q0={"x": 0.5}, t_end=1.0)
    assert lcpimpact.simulate(begun, dt=0.1, progress=False).message == lcpimpact.Status.SOLVED.sentence
