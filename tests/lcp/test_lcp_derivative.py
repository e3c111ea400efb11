"""Derivatives of solutions of LCPs: closed forms, differences of solutions, ties, and what is refused."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
import qpsolvers
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.sparse import csr_array, diags_array, eye_array, kron

from lcpimpact import InputError, UnsupportedError, solve_lcp
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.derivative import _factors
from lcpimpact.lcp.operators import Banded, Dense, Factored, Property, Sparse

NAMES = list(SOLVERS)
if "daqp" in qpsolvers.available_solvers:
    NAMES += ["qp:daqp", "qp:daqp:primal"]
BOXED = [name for name in NAMES if SOLVERS[name].boxed]
STEP = 1e-5


def largest(name: str) -> int:
    return min(SOLVERS[name].largest or 6, 6)


def needs_symmetry(name: str) -> bool:
    return bool({Property.SYMMETRIC, Property.PSD} & set(SOLVERS[name].requires))


@st.composite
def problems(draw, order: int, symmetric: bool):
    """A P-matrix, its rates and those of q."""
    n = draw(st.integers(1, order))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    B, dM = rng.normal(size=(2, n, n))
    M = B @ B.T / n + np.eye(n)
    if symmetric:
        dM = dM + dM.T
    else:
        M += np.tril(rng.normal(size=(n, n)), -1) - np.triu(
            M, 1
        )  # x·Mx need not be positive; triangular, so a P-matrix
    return M, rng.normal(size=n), dM, rng.normal(size=n)


def differences(M, q, dM, dq, lower=0.0, upper=np.inf, dlower=0.0, dupper=0.0):
    """Central differences of solutions by enumeration, where both have one basis."""
    found = [
        solve_lcp(M + h * dM, q + h * dq, "enumeration", lower=lower + h * dlower, upper=upper + h * dupper)
        for h in (-STEP, STEP)
    ]
    sides = [np.where(np.abs(each.w) > 1e-9, np.sign(each.w), 0.0) for each in found]
    assume((sides[0] == sides[1]).all())
    assume(all(np.minimum(np.abs(each.w) + 1.0 * (each.z - lower), 1.0).min() > 1e-3 for each in found))
    return (found[1].z - found[0].z) / (2.0 * STEP)


# ---- closed forms ---------------------------------------------------------------------------------------------------


def test_two_rows_in_closed_form():
    """Both contacts press: dz = -M⁻¹ (dq + dM z)."""
    M, q = np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([-5.0, -6.0])
    found = solve_lcp(M, q)
    np.testing.assert_allclose(found.derivative(dq=[3.0, 0.0]), [-2.0, 1.0], atol=1e-15)
    # z = (4/3, 7/3) and dM z = (4/3, 0)
    np.testing.assert_allclose(found.derivative([[1.0, 0.0], [0.0, 0.0]]), [-8.0 / 9.0, 4.0 / 9.0], atol=1e-15)
    assert (found.derivative() == 0.0).all()


def test_a_row_at_a_bound_moves_with_it():
    found = solve_lcp([[2.0]], [-5.0], lower=-1.0, upper=1.0)
    assert found.derivative(dq=[7.0]) == 0.0
    assert found.derivative(dupper=3.0, dlower=5.0) == 3.0
    assert solve_lcp([[2.0]], [5.0], lower=-1.0, upper=1.0).derivative(dupper=3.0, dlower=5.0) == 5.0
    assert solve_lcp([[2.0]], [1.0], lower=-1.0, upper=1.0).derivative(dq=[7.0], dupper=3.0) == -3.5


def test_an_equation_has_no_bound_and_a_fixed_row_no_force():
    """Row 0: w = 0; row 1 is held at 2."""
    found = solve_lcp([[4.0, 1.0], [1.0, 3.0]], [-6.0, 1.0], lower=[-np.inf, 2.0], upper=[np.inf, 2.0])
    np.testing.assert_allclose(found.z, [1.0, 2.0])
    np.testing.assert_allclose(found.derivative(dq=[8.0, 5.0], dlower=[0.0, 4.0], dupper=[0.0, 4.0]), [-3.0, 4.0])
    # One number for all bounds leaves the infinite ones out.
    np.testing.assert_allclose(found.derivative(dlower=4.0, dupper=4.0), [-1.0, 4.0])


def test_saddle_points_with_a_zero_diagonal():
    """z_1 is the multiplier of z_0 = q_1: M_11 = 0."""
    free = np.full(2, np.inf)
    found = solve_lcp([[2.0, -1.0], [1.0, 0.0]], [1.0, -3.0], lower=-free, upper=free)
    np.testing.assert_allclose(found.derivative(dq=[0.5, -1.0]), [1.0, 2.5])


# ---- differences of solutions, over the registry --------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
@given(data=st.data())
def test_derivative_is_the_limit_of_differences(name, data):
    M, q, dM, dq = data.draw(problems(largest(name), needs_symmetry(name)))
    expected = differences(M, q, dM, dq)
    found = solve_lcp(M, q, name).derivative(dM, dq)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6 * (1.0 + np.abs(expected).max()))


@pytest.mark.parametrize("name", BOXED)
@given(data=st.data())
def test_derivative_in_a_box(name, data):
    M, q, dM, dq = data.draw(problems(largest(name), needs_symmetry(name)))
    rates = np.linspace(-1.0, 1.0, len(q))
    box = {"lower": np.full(len(q), -0.3), "upper": np.full(len(q), 0.2)}
    moving = {"dlower": rates, "dupper": 0.5 - rates}
    expected = differences(M, q, dM, dq, **box, **moving)
    z = solve_lcp(M, q, "enumeration", **box).z
    assume(np.all((z == -0.3) | (z == 0.2) | (np.minimum(z + 0.3, 0.2 - z) > 1e-3)))
    found = solve_lcp(M, q, name, **box).derivative(dM, dq, **moving)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6 * (1.0 + np.abs(expected).max()))


@given(data=st.data(), scale=st.sampled_from([1e-12, 1e-5, 1.0, 1e9]))
def test_units_of_rows_do_not_matter(data, scale):
    M, q, dM, dq = data.draw(problems(5, False))
    D = np.geomspace(1.0, scale, len(q))
    expected = solve_lcp(M, q).derivative(dM, dq)
    found = solve_lcp(D[:, None] * M * D, D * q).derivative(D[:, None] * dM * D, D * dq)
    np.testing.assert_allclose(D * found, expected, rtol=1e-8, atol=1e-9 * (1.0 + np.abs(expected).max()))


# ---- forms of M -----------------------------------------------------------------------------------------------------


def forms():
    """One M, H A⁻¹ Hᵀ of a chain, in every form."""
    n = 12
    A = diags_array(np.linspace(1.0, 3.0, n + 1)).tocsr()
    H = diags_array([np.ones(n), -np.ones(n)], offsets=[0, 1], shape=(n, n + 1)).tocsr()
    M = (H @ diags_array(1.0 / A.diagonal()) @ H.T).tocsr()
    bands = np.zeros((2, n))
    bands[0], bands[1, :-1] = M.diagonal(), M.diagonal(-1)
    return {
        "array": M.toarray(),
        "dense": Dense(M.toarray()),
        "banded": Banded(bands),
        "entries": csr_array(M),
        "sparse": Sparse(M),
        "factored": Factored(A.toarray(), H.toarray()),
        "sparse factors": Factored(A, H),
        "mixed factors": Factored(A, H.toarray()),
    }


@pytest.mark.parametrize("form", forms())
@pytest.mark.parametrize("rate", ["array", "banded", "sparse", "sparse factors"])
def test_every_form_of_m_and_of_its_rate(form, rate):
    M = forms()
    full, q = M["array"], 0.5 + np.sin(np.arange(12.0) ** 2)
    dq = np.cos(np.arange(12.0))
    found = solve_lcp(M[form], q)
    rows = np.flatnonzero(found.z > 0.0)
    assert 3 <= len(rows) <= 9
    expected = np.zeros(12)
    expected[rows] = -np.linalg.solve(full[np.ix_(rows, rows)], (dq + full @ found.z)[rows])
    np.testing.assert_allclose(found.derivative(M[rate], dq), expected, rtol=1e-12)


def test_indefinite_bands():
    bands = np.array([[-1.0, 2.0, 3.0, 4.0, 4.0, 4.0, 4.0, 4.0], [1.0, 0.5, 0.2, 0.1, 0.1, 0.1, 0.1, 0.0]])
    M = Banded(bands)
    free = np.full(8, np.inf)
    found = solve_lcp(M, np.ones(8), lower=-free, upper=free)
    np.testing.assert_allclose(found.derivative(dq=np.arange(8.0)), -np.linalg.solve(M.array(), np.arange(8.0)))


def test_a_lattice_of_many_contacts():
    line = diags_array([2.0, -1.0, -1.0], offsets=[0, 1, -1], shape=(40, 40))
    lattice = (kron(line, eye_array(40)) + kron(eye_array(40), line)).tocsr()
    rng = np.random.default_rng(1)
    q, dq = 0.3 + rng.normal(size=1600), rng.normal(size=1600)
    found = solve_lcp(lattice, q)
    assert 400 < (found.z > 0.0).sum() < 1400
    dz = found.derivative(dq=dq)
    np.testing.assert_allclose((lattice @ dz + dq)[found.z > 0.0], 0.0, atol=1e-11)
    assert (dz[found.z == 0.0] == 0.0).all()


# ---- ties -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_a_tie_is_refused_and_has_one_sided_derivatives(name):
    if largest(name) == 1:
        M, z = np.array([[2.0]]), np.array([0.0])
    else:
        M, z = np.array([[2.0, 0.3], [0.3, 1.5]]), np.array([1.0, 0.0])
    tie = solve_lcp(M, -M @ z, name)
    dq = np.array([0.7, -0.4])[: len(z)]
    with pytest.raises(UnsupportedError, match=rf"row {len(z) - 1} is a tie.*one_sided=True"):
        tie.derivative(dq=dq)
    for sign in (1.0, -1.0):
        # z is piecewise linear in q.
        expected = (solve_lcp(M, -M @ z + 1e-3 * sign * dq).z - z) / 1e-3
        np.testing.assert_allclose(tie.derivative(dq=sign * dq, one_sided=True), expected, atol=1e-9)
    assert not np.allclose(tie.derivative(dq=dq, one_sided=True), -tie.derivative(dq=-dq, one_sided=True)), (
        "the two sides differ"
    )


@given(data=st.data())
def test_one_sided_derivatives_are_limits_of_one_sided_differences(data):
    """Ties at both bounds of a box, and every rate."""
    M, _, dM, dq = data.draw(problems(6, data.draw(st.booleans())))
    n = len(M)
    lower, upper = np.full(n, -1.0), np.full(n, 2.0)
    place = np.array(data.draw(st.lists(st.sampled_from([-1.0, 0.4, 2.0]), min_size=n, max_size=n)))
    push = np.array(data.draw(st.lists(st.sampled_from([0.0, 0.0, 1.5]), min_size=n, max_size=n)))
    w = np.where(place == -1.0, push, np.where(place == 2.0, -push, 0.0))
    q = w - M @ place
    dlower, dupper = np.linspace(0.0, 0.5, n), np.linspace(0.3, -0.4, n)
    tie = solve_lcp(M, q, lower=lower, upper=upper)
    np.testing.assert_allclose(tie.z, place, atol=1e-12)
    found = tie.derivative(dM, dq, dlower=dlower, dupper=dupper, one_sided=True)
    for h in (1e-4, 1e-6):
        moved = solve_lcp(M + h * dM, q + h * dq, lower=lower + h * dlower, upper=upper + h * dupper)
        np.testing.assert_allclose((moved.z - place) / h, found, atol=(2e3 * h + 1e-8) * (1.0 + np.abs(found).max()))
    if not ((place != 0.4) & (push == 0.0)).any():
        np.testing.assert_allclose(tie.derivative(dM, dq, dlower=dlower, dupper=dupper), found, atol=1e-12)
    else:
        with pytest.raises(UnsupportedError, match="is a tie"):
            tie.derivative(dM, dq)


def test_a_small_reaction_is_no_tie():
    """z_1 = 1e-12 beside z_0 = 1 is far above its rounding."""
    found = solve_lcp(np.eye(2), [-1.0, -1e-12])
    np.testing.assert_allclose(found.derivative(dq=[0.0, -1.0]), [0.0, 1.0])


def test_a_tie_spoilt_by_the_condition_of_m_is_one():
    """z_2 = 0 is found to cond(M) ε, 1e-9, only."""
    M = np.array([[1.0, 1.0, 0.0], [1.0, 1.0 + 1e-7, 1.0], [0.0, 1.0, 1e8]])
    z = np.array([1.0, 1.0 / 3.0, 0.0])
    found = solve_lcp(M, -M @ z)
    assert 0.0 < np.abs(found.z - z).max() < 1e-6, "the rounding of q is seen"
    with pytest.raises(UnsupportedError, match="row 2 is a tie"):
        found.derivative(dq=[1.0, 0.0, 0.0])


# ---- refusals -------------------------------------------------------------------------------------------------------


def test_redundant_contacts_have_no_derivative():
    found = solve_lcp([[1.0, 1.0], [1.0, 1.0]], [-1.0, -1.0])
    with pytest.raises(UnsupportedError, match=r"M is singular.*redundant contacts|several solutions"):
        found.derivative(dq=[1.0, 0.0], one_sided=True)
    both = solve_lcp([[1.0, 1.0], [1.0, 1.0]], [-1.0, -1.0], "interior-point")
    assert (both.z > 0.1).all()
    with pytest.raises(UnsupportedError, match=r"M is singular.*redundant contacts"):
        both.derivative(dq=[1.0, 0.0])


def test_redundant_sparse_contacts_have_no_derivative():
    H = csr_array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    for M in (Factored(eye_array(2).tocsr(), H), Sparse(H @ H.T)):
        found = solve_lcp(M, [-1.0, -1.0, 1.0], "apgd")
        assert (found.z[:2] > 0.1).all()
        with pytest.raises(UnsupportedError, match=r"M is singular"):
            found.derivative(dq=[1.0, 0.0, 0.0])


@pytest.mark.parametrize("form", [Dense, Sparse])
def test_what_is_singular_but_for_rounding_has_no_derivative(form):
    M = np.array([[0.1, 0.3], [0.3, 0.9]])
    assert np.linalg.det(M) != 0.0, "0.1 · 0.9 is not 0.3² in floats"
    found = solve_lcp(form(M), [-0.1, -0.3], "apgd")
    assert (found.z > 0.1).all()
    with pytest.raises(UnsupportedError, match=r"M is singular"):
        found.derivative(dq=[1.0, 0.0])


@pytest.mark.parametrize("form", [Dense, Sparse])
def test_factors_solve_with_m_and_with_its_transpose(form):
    A, rows = np.array([[2.0, 5.0, 1.0], [0.0, 0.0, 3.0], [4.0, 1e6, 1.0]]), np.array([0, 2])
    found, inverse = _factors(form(A), rows), np.linalg.inv(A[np.ix_(rows, rows)])
    np.testing.assert_allclose(found.solve(np.eye(2)), inverse, rtol=1e-14)
    np.testing.assert_allclose(found.transposed(np.eye(2)), inverse.T, rtol=1e-14)


def test_several_continuations_are_refused():
    """z = 0 and z = q/1 solve 0 <= z ⟂ q - z >= 0 for q > 0: at q = 0 they meet."""
    with pytest.raises(UnsupportedError, match="several solutions may continue"):
        solve_lcp([[-1.0]], [0.0]).derivative(dq=[1.0], one_sided=True)


def test_an_inexact_solution_is_refused():
    M = np.array([[1.0, 0.99], [0.99, 1.0]])
    wrong = solve_lcp(M, [-1.0, -0.98])._replace(z=np.array([0.0, 0.98]), w=M @ [0.0, 0.98] + [-1.0, -0.98])
    with pytest.raises(UnsupportedError, match="'auto' is too inexact"):
        wrong.derivative(dq=[1.0, 0.0])


def test_an_unsolved_problem_is_refused():
    none = solve_lcp([[0.0, 1.0], [-1.0, 0.0]], [-1.0, -1.0], throw=False)
    with pytest.raises(UnsupportedError, match="no solution to differentiate"):
        none.derivative(dq=[1.0, 0.0])


def test_changed_data_are_refused():
    M, q = np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([-5.0, -6.0])
    found = solve_lcp(M, q)
    M[0, 0] = 2.0 + 1e-9
    with pytest.raises(InputError, match="no longer that of the solution"):
        found.derivative(dq=[1.0, 0.0])


def test_a_solution_keeps_its_problem_in_another_process():
    found = solve_lcp(np.array([[2.0]]), [-5.0])
    assert pickle.loads(pickle.dumps(found)).derivative(dq=[1.0]) == -0.5


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"dq": [1.0]}, r"dq must have shape \(2,\)"),
        ({"dq": 1.0}, r"dq must have shape \(2,\)"),
        ({"dq": [1.0, np.nan]}, "dq has an entry that is not finite"),
        ({"dM": np.eye(3)}, "dM must be of order 2"),
        ({"dM": [1.0, 2.0]}, "dM is given in a form of M"),
        ({"dlower": [1.0]}, r"dlower must have shape \(2,\)"),
        ({"dupper": [1.0, 0.0]}, r"dupper\[0\] = 1 moves no bound"),
    ],
)
def test_bad_rates_get_one_sentence(given, words):
    with pytest.raises(InputError, match=words):
        solve_lcp(np.eye(2), [-1.0, -1.0]).derivative(**given)


def test_a_row_held_by_both_bounds_keeps_them_together():
    with pytest.raises(InputError, match=r"lower\[0\] = upper\[0\] must stay so"):
        solve_lcp([[1.0]], [1.0], lower=2.0, upper=2.0).derivative(dlower=1.0)
