"""One assembly: the same matrices, kinds of nodes and refusals for full and for sparse matrices."""

import numpy as np
import pytest

from lcpimpact import (
    Bumper,
    Chain,
    Dashpot,
    Harmonic,
    InputError,
    Lattice,
    LcpImpactError,
    Load,
    Loads,
    Mass,
    Maxwell,
    NegativeSpring,
    PrescribedMotion,
    Scheme,
    SparseScheme,
    Spring,
    Square,
    UnsupportedError,
)
from lcpimpact.problems import PROBLEMS, load_problem
from lcpimpact.scheme.terms import ConstraintRows, Sum

FIGHTING = [
    *(Mass("x", 1.0), Spring("x", "a", 1.0)),
    *(NegativeSpring("a", "b", 2.0), Spring("a", "c", 3.0), Spring("b", "c", 3.0)),
    *(NegativeSpring("a", "ground", 1.0), Spring("b", "ground", 2.0), Spring("c", "ground", 3.0)),
]
"""Springs with positive coefficients at each node, and no stable equilibrium."""


@pytest.mark.parametrize("kind", [Scheme, SparseScheme])
@pytest.mark.parametrize(
    ("elements", "match"),
    [
        ([], "no element"),
        ([Chain(2, m=1.0), Bumper("x.2", "y", 1.0)], "^nothing holds node 'y': join it"),
        ([Mass("x", 1.0), Mass("y", 1.0), Dashpot("z", "w", 1.0)], "^nothing holds node 'z', 'w': join it"),
        ([Mass("x", 1.0), *(Dashpot("y0", f"y{i}", 1.0) for i in range(1, 9))], "'y4' and 4 others: join it"),
        ([Mass("x", 1.0), Spring("x", "Ground", 1.0)], "^node 'Ground' has no mass: did you mean 'ground'?"),
        ([Mass("x", 1.0), Maxwell("x", "y", 1.0, 1.0), Maxwell("x", "y", 1.0, 1.0)], "both make a node"),
        ([Mass("x", 1.0), PrescribedMotion("x", Harmonic(1.0, 1.0))], "^node 'x' has a mass and a prescribed motion"),
        (
            [Mass("x", 1.0), Bumper("x", "ground", 1.0)],
            "^Bumper between 'x' and 'ground': both sides have mass, so imp",
        ),
        (
            [Mass("x", 1.0), Bumper("x", "z", 0.0, 0.5), Spring("z", "ground", 1.0)],
            "^Bumper between 'x' and 'z': e = 0.5 means nothing, .*relative degree 0",
        ),
        (
            [Chain(2, m=1.0, gap=0.0, e=0.0, a="ground", b="ground")],
            "^Bumper between 'x.2' and 'ground': bumper 'x.R3' acts in parallel with 'x.R[12]', 'x.R[12]', so",
        ),
        (
            [Chain(9, m=1.0, gap=0.0, e=0.0, a="ground", b="ground")],
            "bumper 'x.R10' acts in parallel with .* and 4 others, so",
        ),
        (
            [Chain(2, m=1.0, gap=0.0, e=0.0), Bumper("x.2", "x.1", 0.0, 0.0)],
            "^Bumper between 'x.2' and 'x.1': .*'x.R1'",
        ),
        (
            [
                *(Mass("x", 1.0), Mass("y", 1.0), Bumper("x", "y", 0.1, 0.0, "A")),
                *(Bumper("x", "y", 0.2, 0.0, "B"), Bumper("x", "y", 0.2, 0.0, "C")),
            ],
            "bumper 'C' acts in parallel with 'B'",
        ),
        (
            [Chain(2, m=1.0, gap=0.0, e=0.0), Bumper("x.1", "ground", 1.0, 0.0, "x.2")],
            "the reaction of Bumper .* same n",
        ),
        ([Chain(2, m=1.0), Mass("v_x.1", 1.0)], "the velocity of 'x.1' and node 'v_x.1' have the same name"),
        ([Mass("t", 1.0)], "^node 't' and the time have the same name"),
        (
            [Mass("x", 1.0), Bumper("x", "ground", 0.1, 0.0, "R"), Bumper("x", "ground", 0.2, 0.0, "R")],
            "^two forces have the same name 'R', each the reaction of Bumper",
        ),
        ([Mass("x", 1.0), Spring("x", "z", 1.0), NegativeSpring("z", "ground", 2.0)], "^node 'z' .*outweighs"),
        (FIGHTING, "outweighs"),
        ([Mass("x", 1.0), Spring("x", "z", 1.0), Load("z", Square(1.0, 3.0))], "^the load on 'z' jumps, and so would"),
        (
            [Chain(2, m=1.0), Spring("x.2", "x.3", 1.0), Loads([1, 3], f=Square(1.0, 3.0))],
            "^the load on 'x.3' jumps, and so would",
        ),
        (
            [Mass("x", 1.0), Spring("x", "z", 1.0), Bumper({"z": 2.0}, "ground", 1.0)],
            "^Bumper between '?2 z'? and '?ground'?: 'z' has the coefficient 2 and no mass",
        ),
    ],
)
def test_wrong_schemes_are_refused_in_the_same_words(kind, elements, match):
    with pytest.raises(InputError, match=match) as caught:
        kind(*elements).assemble()
    other = SparseScheme if kind is Scheme else Scheme
    with pytest.raises(InputError) as told:
        other(*elements).assemble()
    assert str(told.value) == str(caught.value)


def random_elements(rng):
    """Return elements at nodes of any kind, of which some schemes are refused."""
    nodes = [*(f"n{i}" for i in range(int(rng.integers(2, 8)))), "ground"]
    elements = [Mass(node, float(rng.integers(1, 4))) for node in nodes[:-1] if rng.random() < 0.5] or [Mass("n0", 1.0)]
    for _ in range(int(rng.integers(1, 14))):
        a, b = map(str, rng.choice(nodes, 2, replace=False))
        kind = (Spring, Spring, Dashpot, NegativeSpring)[rng.integers(4)]
        elements.append(kind(a, b, float(rng.uniform(1.0, 3.0))))
    for k in range(int(rng.integers(0, 5))):
        a, b = map(str, rng.choice(nodes, 2, replace=False))
        e = None if rng.random() < 0.5 else float(rng.random())
        elements.append(Bumper(a, b, float(rng.integers(0, 3)) / 8.0, e, f"R{k}"))
    return elements


def refusal(kind, elements):
    """Return the equations of motion, or the error."""
    try:
        return kind(*elements).assemble()
    except LcpImpactError as error:
        return error


def assert_same(dense, sparse):
    """Check that two equations of motion are equal: their entries to the order of sums, all else exactly."""
    for name in "MCKH":
        full = getattr(dense, name)
        atol = 1e-14 * np.abs(full).max(initial=0.0)
        np.testing.assert_allclose(getattr(sparse, name).toarray(), full, rtol=1e-14, atol=atol)
    assert sparse.nodes == dense.nodes
    assert sparse.reactions == tuple(row.name for row in dense.contacts)
    for name in ("u0", "restitution", "relative_degree", "massive", "driven"):
        np.testing.assert_array_equal(getattr(sparse, name), getattr(dense, name))
    np.testing.assert_array_equal(sparse.kinds.static.toarray(), dense.decomposition.static)
    t = np.array([0.0, 0.3])
    loads = sparse.f + (sparse.F @ sparse.signals(t).T).T
    np.testing.assert_allclose(loads, dense.force(t), rtol=1e-13, atol=1e-13)


def test_random_schemes_are_assembled_and_refused_alike():
    outcomes = {"assembled": 0, "refused": 0, "unsupported": 0}
    for seed in range(400):
        elements = random_elements(np.random.default_rng(seed))
        dense = refusal(Scheme, elements)
        sparse = refusal(SparseScheme, elements)
        if isinstance(sparse, UnsupportedError):
            outcomes["unsupported"] += 1
        elif isinstance(dense, LcpImpactError):
            assert (type(sparse), str(sparse)) == (type(dense), str(dense))
            outcomes["refused"] += 1
        else:
            assert_same(dense, sparse)
            outcomes["assembled"] += 1
    assert min(outcomes["assembled"], outcomes["refused"]) > 50, outcomes


@pytest.mark.parametrize("name", PROBLEMS)
def test_problems_of_the_registry_have_the_same_matrices(name):
    scheme = load_problem(name).scheme
    if not isinstance(scheme, Scheme):
        return
    sparse = refusal(SparseScheme, scheme.elements)
    if not isinstance(sparse, UnsupportedError):
        assert_same(scheme.assemble(), sparse)


def test_arrays_of_elements_have_the_matrices_of_their_parts():
    elements = (
        Lattice(
            3, 4, m=[0.1 * i for i in range(1, 13)], k=7.0, k_side=0.3, c_side=0.1, gap=0.1, e=0.5, f=0.981, b="ground"
        ),
        Loads([(1, 2), (3, 4)], f=Harmonic(1.0, 3.0), a=[2.0, 0.5]),
    )
    assert_same(Scheme(*elements).assemble(), SparseScheme(*elements).assemble())


def test_a_sum_keeps_the_rounding_errors_of_its_terms():
    total = Sum(2, 2)
    for term in (1e16, 1.0, 1.0, -1e16):
        total.add(term, (0, 0))
    value, residue = total.full()
    assert value[0, 0] + residue[0, 0] == 2.0
    assert value[0, 0] != 2.0
    assert not value[1].any()


def test_rows_are_read_in_the_order_in_which_they_are_added():
    chain = Chain(2, m=1.0, gap=[0.1, 0.2], e=[0.0, 1.0], b="ground")
    elements = (Mass("y", 1.0), Bumper("y", "ground", 0.3, 0.5), chain, Bumper("x.1", "y", 0.4, 0.25))
    d = SparseScheme(*elements).assemble()
    assert d.reactions == ("R", "x.R1", "x.R2", "R_2")
    np.testing.assert_array_equal(d.u0, [0.3, 0.1, 0.2, 0.4])
    np.testing.assert_array_equal(d.restitution, [0.5, 0.0, 1.0, 0.25])
    rows = ConstraintRows({"a": 0, "b": 1})
    rows.add_bumpers(["A", "B"], np.array([0, 1]), np.array([1, -1]), np.array([0.5, 0.25]), np.array([0.0, 1.0]))
    assert [(row.name, row.upper, row.lower, row.gap, row.e) for row in rows] == [
        ("A", "a", "b", 0.5, 0.0),
        ("B", "b", "ground", 0.25, 1.0),
    ]
