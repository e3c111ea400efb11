"""Sparse M: the same verdicts as for dense M, and problems of ten thousand rows against closed forms."""

from __future__ import annotations

import itertools
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls

from lcpimpact.errors import InputError, Status, UnsupportedError
from lcpimpact.lcp import SOLVERS, judge, storage
from lcpimpact.lcp.compressed import STORAGE, for_entries
from lcpimpact.lcp.operators import Dense, Factored, Property, Sparse, as_operator
from lcpimpact.lcp.problem import LOWER
from lcpimpact.lcp.solve import prepare_lcp, solve_lcp
from lcpimpact.lcp.solver import CompiledSolver
from lcpimpact.lcp.solvers import auto
from lcpimpact.lcp.solvers.auto import widest_level
from lcpimpact.lcp.sparse_pivoting import SparseMatrix, pivot
from lcpimpact.problems.balls import pile

NAMES = [name for name in SOLVERS if "sparse" in SOLVERS[name].storages and not name.startswith("qp:")]
INF = np.inf


def lattice(k):
    """The five-point matrix of k × k contacts."""
    T = sp.diags_array([-np.ones(k - 1), 2.0 * np.ones(k), -np.ones(k - 1)], offsets=[-1, 0, 1])
    return sp.csr_array(sp.kron(T, sp.eye_array(k)) + sp.kron(sp.eye_array(k), T))


def scattered_matrix(rng, n, kind):
    """A sparse matrix in one of the kinds of KINDS, as a dense array."""
    B = rng.standard_normal((n, n)) * (rng.random((n, n)) < 3.0 / n)
    if kind == "singular":
        B = np.vstack([B[: max(1, n // 2)], np.zeros((n - max(1, n // 2), n))])
        return B.T @ B
    if kind == "empty rows":
        B[:, rng.random(n) < 0.3] = 0.0
        return B.T @ B
    if kind == "integers":
        B = np.round(2.0 * B)
        return B.T @ B + np.eye(n)
    M = B.T @ B + 0.1 * np.eye(n)
    if kind == "units":
        unit = 10.0 ** rng.integers(-12, 13, n)
        M = M * unit[:, None] * unit
    elif kind == "unsymmetric":
        off = B - np.diag(np.diag(B))
        M = off + np.diag(np.abs(off).sum(axis=1) + 0.1)
    elif kind == "indefinite":
        M = B + B.T
    return M


KINDS = ("definite", "singular", "empty rows", "integers", "units", "unsymmetric", "indefinite")


def right_side(rng, M, kind):
    n = len(M)
    root = np.sqrt(np.where(np.diag(M) > 0.0, np.diag(M), 1.0)) if kind == "units" else np.ones(n)
    x = np.where(rng.random(n) < 0.5, rng.random(n), 0.0)
    return {
        "random": rng.standard_normal(n) * root,
        "degenerate": -(M @ (x / root)),
        "zero": np.zeros(n),
    }[rng.choice(["random", "random", "degenerate", "zero"])]


def box(rng, n, boxed):
    if not boxed:
        return np.zeros(n), np.full(n, INF)
    low = np.where(rng.random(n) < 0.8, -rng.random(n), -INF)
    high = np.where(rng.random(n) < 0.6, rng.random(n), INF)
    return low, np.where(rng.random(n) < 0.1, np.maximum(low, -1.0), high)


# ---- storage and judge ------------------------------------------------------------------------------------------------


@given(st.integers(0, 2**32 - 1), st.integers(1, 12))
@settings(max_examples=150, deadline=None)
def test_the_functions_of_storage_agree(seed, n):
    """Of the same M by its entries and as an array."""
    rng = np.random.default_rng(seed)
    M = rng.standard_normal((n, n)) * (rng.random((n, n)) < 0.4)
    M = M + M.T if seed % 2 else M
    W, z, size, j = Sparse(M).W, rng.standard_normal(n), rng.random(n) + 0.1, int(rng.integers(n))
    for name in ("product", "transposed_product", "absolute_product", "absolute_transposed_product"):
        found, wanted = np.empty(n), np.empty(n)
        STORAGE[name](W, z, found)
        getattr(storage, name)(M, z, wanted)
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-14 * n)
    for i in range(n):
        assert STORAGE["entry"](W, i, j) == M[i, j]
        np.testing.assert_allclose(STORAGE["row_product"](W, i, z), M[i] @ z, atol=1e-13)
        np.testing.assert_allclose(STORAGE["row_terms"](W, i, z), abs(M[i]) @ abs(z), atol=1e-13)
        np.testing.assert_allclose(storage.row_terms(M, i, z), abs(M[i]) @ abs(z), atol=1e-13)
    column, wanted, d = np.empty(n), np.ones(n), np.empty(n)
    STORAGE["column"](W, j, column)
    np.testing.assert_array_equal(column, M[:, j])
    STORAGE["spread"](W, j, -2.0, wanted)
    np.testing.assert_array_equal(wanted, 1.0 + 2.0 * abs(M[:, j]))
    assert STORAGE["weight"](W, j, size) == storage.weight(M, j, size)
    for_entries(storage.diagonal)(W, d)
    np.testing.assert_array_equal(d, np.diag(M))
    assert STORAGE["longest_row"](W) == (M != 0.0).sum(axis=1).max()
    assert STORAGE["is_symmetric"](W) == storage.is_symmetric(M) == bool((M == M.T).all())
    assert STORAGE["has_positive_diagonal"](W) == storage.has_positive_diagonal(M)
    assert (W.row_value is W.column_value) == bool((M == M.T).all())


def test_storage_has_every_function_that_a_kernel_may_call():
    own = {name for name, each in vars(storage).items() if getattr(each, "__module__", "") == storage.__name__}
    own |= {name for name, each in vars(storage).items() if hasattr(each, "py_func") and name != "multiply"}
    assert own - {"bandwidth", "diagonal"} == set(STORAGE), "the diagonal is read by its entries"


@given(st.integers(0, 2**32 - 1), st.integers(1, 25), st.sampled_from(KINDS), st.booleans())
@settings(max_examples=300, deadline=None)
def test_the_judge_measures_a_sparse_matrix_as_a_dense_one(seed, n, kind, boxed):
    """Of points near a solution, far from one, and outside the bounds; with the same bound of the rounding error."""
    rng = np.random.default_rng(seed)
    M = scattered_matrix(rng, n, kind)
    q, (lower, upper) = right_side(rng, M, kind), box(rng, n, boxed)
    z = np.clip(rng.standard_normal(n), lower, upper)
    free = (z > lower) & (z < upper)
    if rng.random() < 0.7 and free.any():
        z[free] = np.linalg.lstsq(M[np.ix_(free, free)], -(q + M[:, ~free] @ z[~free])[free], rcond=None)[0]
    z += rng.choice([0.0, 1e-14, 1e-11, 1e-8, 1e-3]) * rng.standard_normal(n) * np.abs(z).max()
    sparse, w, wanted = Sparse(M), np.empty(n), M @ z + q
    with np.errstate(all="ignore"):  # as in compiled code
        scaled, natural, rounding = for_entries(judge.measure)(sparse.W, q, lower, upper, z, w)
    np.testing.assert_allclose(w, wanted, rtol=1e-9, atol=1e-13 * (abs(M) @ abs(z) + abs(q)).max())
    bound = (STORAGE["longest_row"](sparse.W) + 2) * np.finfo(float).eps
    with np.errstate(all="ignore"):
        dense = judge.row_defect(M, q, lower, upper, z, w, bound)
    np.testing.assert_allclose((scaled, rounding), dense, rtol=1e-7, atol=1e-300)
    assert natural == np.abs(np.maximum(np.minimum(w, z - lower), z - upper)).max() / max(1.0, np.abs(q).max())


@pytest.mark.parametrize("name", NAMES)
def test_what_a_kernel_claims_of_a_sparse_matrix_is_judged(name, monkeypatch):
    """A z that is wrong in one row of ten thousand, called solved, is not."""
    M, rng = lattice(100), np.random.default_rng(0)
    q = rng.standard_normal(10_000)
    exact = solve_lcp(M, q).z

    def claims(W, q, lower, upper, z, tol, max_iter):
        z[:] = exact
        z[1234] += 1e-6
        return int(Status.SOLVED), 1

    prepared = prepare_lcp(Sparse(M), name)
    prepared = prepared._replace(state=prepared.state._replace(kernel=claims, fallbacks=()))
    assert prepared.solve(q, throw=False).status is Status.INACCURATE


# ---- forms --------------------------------------------------------------------------------------------------------------


def forms(M, rng):
    """M in SciPy's formats, with entries in any order, in two parts, and explicit zeros."""
    csr, parts = sp.csr_array(M), sp.coo_array(M)
    order = np.concatenate([rng.permutation(np.arange(a, b)) for a, b in itertools.pairwise(csr.indptr)])
    yield sp.csr_array((csr.data[order], csr.indices[order], csr.indptr.copy()), shape=csr.shape)
    i, j, x = np.tile(parts.row, 2), np.tile(parts.col, 2), np.r_[parts.data * 0.25, parts.data * 0.75]
    zeros = rng.integers(0, len(M), (2, len(M)))
    i, j, x = np.r_[i, zeros[0]], np.r_[j, zeros[1]], np.r_[x, np.zeros(len(M))]
    order = rng.permutation(len(x))
    twice = sp.coo_array((x[order], (i[order], j[order])), shape=parts.shape)
    yield from (twice, sp.csc_array(twice), sp.csc_matrix(csr), sp.csr_matrix(csr, copy=True), sp.coo_matrix(csr))
    yield from (sp.lil_array(csr), sp.dia_array(csr), sp.dok_array(csr), sp.bsr_array(csr), M)


@pytest.mark.parametrize("seed", range(4))
def test_a_sparse_operator_is_the_same_in_any_form(seed):
    rng = np.random.default_rng(seed)
    M = scattered_matrix(rng, 30, "unsymmetric" if seed % 2 else "definite")
    q = rng.standard_normal(30)
    wanted = solve_lcp(M, q)
    for each in forms(M, rng):
        before = each.toarray() if sp.issparse(each) else each.copy()
        operator = Sparse(each)
        np.testing.assert_allclose(operator.array(), M, rtol=0, atol=1e-15 * np.abs(M).max())
        assert (operator.M.data != 0.0).all()
        assert operator.M.has_canonical_format
        for name in ("auto", "block-pivoting"):
            np.testing.assert_allclose(solve_lcp(operator, q, name).z, wanted.z, rtol=1e-9, atol=1e-11)
        assert ((each.toarray() if sp.issparse(each) else each) == before).all()
        if sp.issparse(each) and hasattr(each, "data") and each.format == "csr":
            each.data[:] = 7.0  # a copy was taken
            np.testing.assert_allclose(operator.array(), M, rtol=0, atol=1e-15 * np.abs(M).max())


def test_whole_numbers_and_flags_are_numbers():
    small = sp.coo_array((np.array([100, 100, 3], np.int8), ([0, 0, 1], [0, 0, 1])))
    np.testing.assert_array_equal(Sparse(small).array(), [[200.0, 0.0], [0.0, 3.0]])
    np.testing.assert_array_equal(Sparse(sp.eye_array(2, dtype=bool)).array(), np.eye(2))


@pytest.mark.parametrize(
    ("M", "words"),
    [
        (sp.csr_array((2, 3)), "square"),
        (sp.csr_array((0, 0)), "empty"),
        (sp.csr_array([[1.0, np.nan], [0.0, 1.0]]), "not finite"),
        (sp.coo_array(([1e308, 1e308], ([0, 0], [0, 0])), shape=(1, 1)), "not finite"),
        (sp.coo_array(([np.inf, -np.inf], ([0, 0], [0, 0])), shape=(1, 1)), "not finite"),
        (sp.csr_array([[1.0 + 1.0j]]), "real numbers"),
        (sp.csr_array((np.ones(2), np.array([0, 5]), np.array([0, 1, 2])), shape=(2, 2)), "can be read"),
    ],
)
def test_bad_sparse_matrices_are_named(M, words):
    with pytest.raises(InputError, match=words):
        Sparse(M)
    with pytest.raises(InputError, match=words):
        solve_lcp(M, np.ones(M.shape[0]))


def test_when_a_sparse_matrix_stays_sparse():
    assert as_operator(lattice(18)).storage == "dense"
    assert as_operator(lattice(25)).storage == "sparse"
    assert as_operator(sp.csr_array(np.ones((500, 500)))).storage == "dense"
    # Small rows beside large ones are not rounded away: this M of two bands is not symmetric.
    rows = sp.diags_array([np.r_[1.0, np.full(499, 1e-20)], np.full(499, 5e-21)], offsets=[0, 1])
    assert as_operator(rows).storage == "sparse"
    np.testing.assert_allclose(solve_lcp(rows, np.full(500, -1e-20)).w, 0.0, atol=1e-30)


def test_properties_of_sparse_matrices():
    rng = np.random.default_rng(0)
    for n, kind in itertools.product((1, 3, 8, 25), KINDS):
        M = scattered_matrix(rng, n, kind)
        for each in Property:
            assert Sparse(M).has(each) == Dense(M).has(each), (n, kind, each)
    swap = sp.csc_array([[0.0, 1.0], [1.0, 0.0]])
    assert not Sparse(swap).has(Property.PSD)
    with pytest.raises(InputError, match="positive definite"):
        Factored(swap, np.eye(2))


# ---- solvers ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
@given(st.integers(0, 2**32 - 1), st.integers(1, 25), st.sampled_from(KINDS), st.booleans())
@settings(max_examples=20, deadline=None)
def test_a_solver_gives_sparse_and_dense_matrices_the_same_verdict(name, seed, n, kind, boxed):
    rng = np.random.default_rng(seed)
    M = scattered_matrix(rng, n, kind)
    q, (lower, upper) = right_side(rng, M, kind), box(rng, n, boxed)
    smallest, auto.SMALLEST_SPARSE = auto.SMALLEST_SPARSE, 0
    try:
        sparse = solve_lcp(Sparse(M), q, name, lower=lower, upper=upper, throw=False)
    except UnsupportedError:
        assert not all(Dense(M).has(each) for each in SOLVERS[name].requires)
        return
    finally:
        auto.SMALLEST_SPARSE = smallest
    dense = solve_lcp(M, q, name, lower=lower, upper=upper, throw=False)
    if sparse.success:
        _, scaled, _ = exact_residual(M, q, lower, upper, sparse.z)
        assert scaled <= SOLVERS[name].tol * 1.01
    definite = kind in ("definite", "integers")
    if definite or (name == "auto" and kind in ("singular", "empty rows")):
        assert sparse.status is dense.status or {sparse.status, dense.status} <= {Status.RAY, Status.INFEASIBLE}
    if definite and sparse.success:
        np.testing.assert_allclose(sparse.z, dense.z, rtol=1e-6, atol=1e-7)
    contradiction = {sparse.status, dense.status}
    assert not (Status.SOLVED in contradiction and contradiction & {Status.RAY, Status.INFEASIBLE})


def exact_residual(M, q, lower, upper, z):
    """The scaled residual of z with w in rational arithmetic."""
    w, scaled, natural = prepare_lcp(M, lower=lower, upper=upper)._without_rounding(q, z)
    return w, scaled, natural


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("boxed", [False, True])
def test_lattices_of_contacts_by_each_solver(name, boxed):
    rng = np.random.default_rng(1)
    M = lattice(19)
    q = rng.standard_normal(361)
    limits = {"lower": -0.1, "upper": np.where(rng.random(361) < 0.5, 0.2, INF)} if boxed else {}
    wanted = solve_lcp(M.toarray(), q, "lemke", **limits).z
    found = solve_lcp(Sparse(M), q, name, **limits)
    np.testing.assert_allclose(found.z, wanted, rtol=0, atol=1e-8)
    again = solve_lcp(Sparse(M), q + 1e-3 * rng.standard_normal(361), name, z0=found.z, **limits)
    assert again.success


@pytest.mark.parametrize("seed", range(20))
def test_pivoting_alone_with_bounds_and_fixed_rows(seed):
    """From a wrong side of each row, to both bounds, with rows whose bounds are equal; for M that need not be symmetric."""
    rng = np.random.default_rng(seed)
    n = 40
    M = scattered_matrix(rng, n, "unsymmetric" if seed % 2 else "definite")
    q = 3.0 * rng.standard_normal(n)
    lower = -0.3 * rng.random(n)
    upper = np.where(rng.random(n) < 0.3, lower, 0.3 * rng.random(n))
    side, z = rng.integers(-1, 2, n), np.empty(n)
    side[lower == upper] = LOWER
    status, steps, residual = pivot(SparseMatrix(sp.csr_array(M), seed % 2 == 0), q, lower, upper, side, z, 1e-10, 100)
    assert status is Status.SOLVED
    assert steps <= 20
    assert residual < 1e-13
    np.testing.assert_allclose(z, solve_lcp(M, q, "lemke", lower=lower, upper=upper).z, rtol=0, atol=1e-10)
    assert (z == upper).sum() > (upper == lower).sum()


@pytest.mark.parametrize("name", ["qp:osqp", "qp:clarabel"])
def test_backends_take_sparse_matrices(name, monkeypatch):
    pytest.importorskip(name.removeprefix("qp:"))
    M, q = Sparse(lattice(30)), np.random.default_rng(7).standard_normal(900)
    wanted = solve_lcp(M, q).z
    monkeypatch.setattr(Sparse, "array", lambda self: pytest.fail("M was made dense"))
    np.testing.assert_allclose(solve_lcp(M, q, name).z, wanted, rtol=0, atol=1e-4)


def test_contacts_against_least_squares_of_scipy():
    """With M = Bᵀ B and q = -Bᵀ b the LCP is min ‖B z - b‖ over z >= 0."""
    rng = np.random.default_rng(2)
    B = sp.vstack([sp.random_array((400, 150), density=0.03, random_state=rng), 0.1 * sp.eye_array(150)])
    b = rng.standard_normal(550)
    wanted, _ = nnls(B.toarray(), b)
    for name in ("block-pivoting", "nncg", "psor"):
        np.testing.assert_allclose(solve_lcp(Sparse(B.T @ B), -(B.T @ b), name).z, wanted, rtol=0, atol=1e-8)


@pytest.mark.parametrize("name", ["auto", "block-pivoting", "nncg"])
def test_a_string_over_an_obstacle_has_its_closed_form(name):
    """u'' = 1 over the obstacle u >= -c on 0..1, u = 0 at both ends: z = u + c = (x - a)²/2 up to a = sqrt(2 c)."""
    n, c = 2_000 if name == "nncg" else 10_000, 0.02
    x = np.arange(1, n + 1) / (n + 1)
    T = sp.diags_array([-np.ones(n - 1), 2.0 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1])
    psi = np.full(n, -c)
    h = x[0]
    q = T @ psi + h * h
    found = solve_lcp(Sparse(T), q, name, tol=1e-12 if name == "auto" else None).z
    a = np.sqrt(2.0 * c)
    wanted = np.where(x < a, (x - a) ** 2 / 2.0, np.where(x > 1.0 - a, (x - 1.0 + a) ** 2 / 2.0, 0.0))
    assert np.abs(found - wanted).max() < 2.0 * h * a
    assert found[n // 2] == 0.0


def test_a_pile_of_discs_cold_and_warm():
    """H M⁻¹ Hᵀ of 5,050 discs, by its entries and by its factors."""
    d = pile(70, 0.0).dynamics
    H, A = sp.csr_array(d.H), sp.csc_array(d.M)
    M, n, rng = sp.csr_array(d.H @ d.B), d.H.shape[0], np.random.default_rng(3)
    q = M @ -np.where(rng.random(n) < 0.7, rng.random(n), 0.0) + 0.1 * rng.standard_normal(n)
    prepared = prepare_lcp(M)
    cold = prepared.solve(q)
    assert cold.route == ("block-pivoting",)
    assert cold.iterations <= 10
    assert prepared.solve(q, z0=cold.z).iterations == 1
    factors = solve_lcp(Factored(A, H), q, "block-pivoting")
    np.testing.assert_allclose(factors.z, cold.z, rtol=0, atol=1e-9)
    np.testing.assert_allclose(prepare_lcp(M, "nncg").solve(q).z, cold.z, rtol=0, atol=1e-6)


@pytest.mark.parametrize("redundant", [False, True])
@pytest.mark.parametrize("coupled", [False, True])
def test_sparse_factors_give_the_answer_of_their_dense_product(coupled, redundant):
    """Contacts of bodies with each other, where M is sparse too if A is diagonal, and with some of them stated twice."""
    n, rng = 450, np.random.default_rng(8)
    of, others = np.arange(n), (rng.integers(1, 5, n), rng.integers(0, n, n))
    H = sp.csr_array(
        (np.repeat([1.0, -1.0, 0.3], n), (np.tile(of, 3), np.r_[of, of + others[0], others[1]])), (n, n + 5)
    )
    H = sp.csr_array(sp.vstack([H, H[:40]])) if redundant else H
    A = sp.diags_array(1.0 + rng.random(n + 5)) + coupled * 0.2 * sp.diags_array([1.0] * (n + 4), offsets=1)
    A, q = sp.csc_array(0.5 * (A + A.T)), H @ rng.standard_normal(n + 5)
    M = Factored(A, H)
    assert (M.formed() is None) == coupled
    found = solve_lcp(M, q)
    assert found.route[0] == "block-pivoting"
    full = H @ np.linalg.solve(A.toarray(), H.T.toarray())
    np.testing.assert_allclose(found.w, full @ found.z + q, rtol=0, atol=1e-12 * np.abs(full).max() * found.z.max())
    np.testing.assert_allclose(found.w, solve_lcp(full, q).w, rtol=0, atol=1e-8)
    assert found.z.min() >= 0.0


def test_sparse_factors_without_a_solution_are_disproved():
    """Two walls that approach a body of many, which stands between them."""
    n = 500
    H = sp.csr_array(sp.vstack([sp.eye_array(n), -sp.eye_array(n, format="csr")[[7]]]))
    q = np.ones(n + 1)
    q[[7, n]] = -1.0
    found = solve_lcp(Factored(sp.eye_array(n, format="csc"), H), q, throw=False)
    assert found.status is Status.RAY
    assert (np.flatnonzero(found.ray) == [7, n]).all()


def test_prepared_solves_share_factors_and_not_answers():
    M, rng = lattice(40), np.random.default_rng(4)
    prepared, right = prepare_lcp(M), rng.standard_normal((12, 1600))
    alone = [prepare_lcp(M).solve(q).z for q in right]
    with ThreadPoolExecutor(4) as threads:
        together = list(threads.map(lambda q: prepared.solve(q).z, right))
    for one, other in zip(alone, together, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-12 * np.abs(one).max())


@pytest.mark.parametrize("name", NAMES)
def test_no_solution_is_proved_for_large_sparse_matrices(name):
    """One contact between walls that approach, far among others: M_ij is singular there, and z = (1, 1) pushes for ever."""
    M = sp.lil_array(lattice(40))
    for k in (700, 701):
        M[k, :], M[:, k] = 0.0, 0.0
    M[700, 700] = M[701, 701] = 1.0
    M[700, 701] = M[701, 700] = -1.0
    q = np.random.default_rng(5).standard_normal(1600)
    q[700], q[701] = -1.0, -1.0
    found = solve_lcp(Sparse(M, ["psd"]), q, name, throw=False, max_iter=None if name == "auto" else 2000)
    assert found.status is not Status.SOLVED
    if name not in ("block-pivoting", "pgs"):
        assert found.status is Status.RAY
        assert found.ray is not None
        v = found.ray
        assert (v >= 0.0).all()
        assert (M.T @ v <= 0.0).all()
        assert q @ v < 0.0


def test_unsymmetric_contacts_are_factored():
    rng = np.random.default_rng(6)
    n = 2_000
    B = sp.random_array((n, n), density=2.0 / n, random_state=rng)
    M = sp.csr_array(B + sp.diags_array(np.asarray(abs(B).sum(axis=1)).ravel() + 0.1))
    q = rng.standard_normal(n)
    found = solve_lcp(M, q)
    assert found.route == ("block-pivoting",)
    np.testing.assert_allclose(found.w, M @ found.z + q, rtol=0, atol=1e-12)
    assert np.abs(np.minimum(found.z, found.w)).max() < 1e-11
    for name in ("nncg", "pgs", "psor", "apgd"):
        with pytest.raises(UnsupportedError, match="symmetric"):
            solve_lcp(M, q, name)


# ---- the choice ---------------------------------------------------------------------------------------------------------


def test_the_width_of_graphs():
    assert widest_level(Sparse(sp.eye_array(7))) == 1
    assert widest_level(Sparse(lattice(1))) == 1
    assert widest_level(Sparse(lattice(30))) == 30
    star = sp.lil_array(np.eye(9))
    star[0, :], star[:, 0] = 1.0, 1.0
    assert widest_level(Sparse(star)) == 7
    both = sp.block_diag([sp.eye_array(5), lattice(12)])
    assert widest_level(Sparse(both)) == 12


def test_the_choice_by_width(monkeypatch):
    M = Sparse(lattice(30))
    assert auto.methods(M)[:2] == ("block-pivoting", "nncg")
    monkeypatch.setattr(auto, "WIDEST_FAST_FACTOR", 29)
    assert auto.methods(M)[:2] == ("nncg", "block-pivoting")
    monkeypatch.setattr(auto, "WIDEST_FACTOR", 29)
    assert "block-pivoting" not in auto.methods(M)
    assert solve_lcp(M, -np.ones(900)).route == ("nncg",)
    rows = sp.lil_array(lattice(30))
    rows[5, :], rows[:, 5] = 0.0, 0.0
    assert auto.methods(Sparse(rows))[0] == "apgd"
    assert solve_lcp(rows, np.ones(900)).success


def test_solvers_of_sparse_matrices_are_compiled_for_them():
    kernel = SOLVERS["nncg"].kernel
    assert isinstance(SOLVERS["nncg"], CompiledSolver)
    assert prepare_lcp(Sparse(lattice(3)), "nncg").state.kernel is for_entries(kernel)
    assert for_entries(kernel) is not kernel
