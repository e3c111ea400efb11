"""The format of the matrices follows from the number of nodes, where sparse ones take the scheme."""

import numpy as np
import pytest

import lcpimpact as li
from lcpimpact.scheme.sparse_dynamics import SparseDynamics

MANY = 1_001


def column(n, *others, kind=li.Scheme, **options):
    """A column of n beads above the ground, with other elements."""
    beads = [li.Mass(f"b{i}", 0.1) for i in range(n)]
    loads = [li.Load(f"b{i}", 0.981) for i in range(n)]
    bumpers = [li.Bumper(f"b{i}", f"b{i + 1}" if i + 1 < n else "ground", gap=1e-4, e=0.0) for i in range(n)]
    return li.Problem("column", kind(*beads, *loads, *bumpers, *others, **options), t_end=0.01)


@pytest.fixture(scope="module")
def large():
    return column(MANY)


def test_a_scheme_of_many_nodes_runs_as_a_sparse_one(large):
    assert large.sparse
    assert not column(MANY - 1).sparse
    mine, theirs = (li.simulate(each, dt=1e-3) for each in (large, column(MANY, kind=li.SparseScheme)))
    assert mine.success
    assert mine[f"R_{MANY}"].max() > 0.0
    for name in ("q", "v", "reaction"):
        assert np.array_equal(getattr(mine, name), getattr(theirs, name))


def test_another_method_says_which_format_it_takes(large):
    with pytest.raises(li.UnsupportedError, match=r"in sparse matrices.*not by newmark-ns.*format='full'"):
        li.simulate(large, "newmark-ns", dt=1e-3)


def test_a_format_that_is_asked_for_is_kept():
    few = column(3)
    assert not few.sparse
    assert column(3, format="sparse").sparse
    assert isinstance(li.SparseScheme(*few.scheme.elements).assemble(), SparseDynamics)
    chain = li.Chain(MANY, m=0.1, k=1e3, name="bead", b="ground")
    assert not li.Problem("bar", li.Scheme(chain, format="full")).sparse
    with pytest.raises(li.InputError, match=r"unknown format of matrices 'dense'"):
        li.Scheme(format="dense")


def test_a_law_that_sparse_matrices_do_not_take_keeps_full_ones():
    assert not column(MANY, li.Slider("b0", "ground", 1.0)).sparse
    with pytest.raises(
        li.InputError,
        match=r"10,001 nodes, and full matrices are kept of 10,000: model it coarser, or of masses.* sparse ones take$",
    ):
        column(10_001, li.Slider("b0", "ground", 1.0))


def test_a_format_is_shown(large):
    full = li.Scheme(li.Mass("x", 1.0), format="full")
    assert repr(full) == "Scheme(\n    Mass(node='x', m=1.0),\n    format='full',\n)"
    assert repr(li.SparseScheme(li.Mass("x", 1.0))) == "SparseScheme(\n    Mass(node='x', m=1.0),\n)"


def test_names_of_many_reactions_are_found_in_a_time_that_grows_with_their_number():
    scheme = li.Scheme(li.Bumper("x", "ground", name="R_3"))
    scheme.add(*(li.Bumper(f"x{i}", "ground") for i in range(4)))
    assert [each.name for each in scheme.elements] == ["R_3", "R", "R_2", "R_4", "R_5"]
