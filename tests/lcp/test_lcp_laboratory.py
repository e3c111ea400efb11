"""Bounds, free rows, forms of M, the choice of a method, certificates, traces: what the LCP laboratory has beyond z >= 0."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import assume, given
from hypothesis import strategies as st

from lcpimpact import FailureError, InputError, Status, UnsupportedError
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.judge import measure, proves_infeasible
from lcpimpact.lcp.lapack import MAX_LOOP_ORDER, absolute_sum, cholesky_solve, largest, lu_solve, multiply
from lcpimpact.lcp.operators import Banded, Dense, Factored, Property, Sparse, all_finite, as_operator
from lcpimpact.lcp.problem import bounds, unbounded_above
from lcpimpact.lcp.reduction import from_lcp, to_lcp
from lcpimpact.lcp.solve import prepare_lcp, solve_lcp
from lcpimpact.lcp.solvers.banded import chain_masses, isotonic_chain, pools_for
from lcpimpact.lcp.solvers.enumeration import all_solutions
from lcpimpact.lcp.storage import bandwidth, column, diagonal, entry, is_symmetric, product, row_product

BOXED = [name for name in SOLVERS if SOLVERS[name].boxed]
PLAIN = [name for name in SOLVERS if not SOLVERS[name].boxed]
ITERATIVE = ("pgs", "psor", "apgd", "newton-fb", "interior-point")
DIRECT_BOXED = [name for name in BOXED if name not in ITERATIVE and not name.startswith("qp:")]


def box_defect(M, q, lower, upper, z) -> float:
    """How far z is from a solution, by the three cases of the statement, in units of the largest term."""
    w = M @ z + q
    s, p = np.abs(M).max() or 1.0, max(np.abs(q).max(), (np.abs(M) @ np.abs(z)).max(), 1e-300)
    worst = max(0.0, (lower - z).max() * s / p, (z - upper).max() * s / p)
    for i in range(len(q)):
        inside = min(z[i] - lower[i], upper[i] - z[i]) * s / p
        negative, positive = max(-w[i], 0.0) / p, max(w[i], 0.0) / p
        # w < 0 asks for z = upper, w > 0 for z = lower.
        worst = max(worst, min(negative, (upper[i] - z[i]) * s / p), min(positive, (z[i] - lower[i]) * s / p))
        assert inside >= -1e-9
    return float(worst)


@st.composite
def boxed_problems(draw, largest: int = 5):
    """An SPD M, q with ties and zeros, and bounds of every kind: none, one, two, equal."""
    n = draw(st.integers(1, largest))
    whole = st.integers(-20, 20)
    B = np.array(draw(st.lists(whole, min_size=n * n, max_size=n * n)), dtype=float).reshape(n, n) / 20.0
    M = B.T @ B + draw(st.integers(1, 8)) / 4.0 * np.eye(n)
    q = np.array(draw(st.lists(st.integers(-40, 40), min_size=n, max_size=n)), dtype=float) / 4.0
    kinds = draw(st.lists(st.integers(0, 5), min_size=n, max_size=n))
    low = [(0.0, -np.inf, -1.0, -np.inf, 0.5, 2.0)[kind] for kind in kinds]
    high = [(np.inf, np.inf, 1.0, 0.25, 0.5, 7.0)[kind] for kind in kinds]
    return M, q, np.array(low), np.array(high)


def largest_n(name: str) -> int:
    return min(SOLVERS[name].largest or 5, 5)


# ---- bounds ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", BOXED)
@given(data=st.data())
def test_answers_between_bounds(name, data):
    M, q, lower, upper = data.draw(boxed_problems(largest_n(name)))
    solution = solve_lcp(M, q, name, lower=lower, upper=upper)
    assert solution.success
    assert ((lower <= solution.z) & (solution.z <= upper)).all()
    assert box_defect(M, q, lower, upper, solution.z) <= 4.0 * SOLVERS[name].tol
    np.testing.assert_allclose(solution.w, M @ solution.z + q, rtol=0.0, atol=1e-12 * (1.0 + np.abs(q).max()))
    w, z = solution.w, solution.z
    expected = np.abs(z - np.clip(z - w, lower, upper)).max() / max(1.0, np.abs(q).max())
    assert solution.residual == pytest.approx(expected, rel=1e-6, abs=1e-13)


@given(problem=boxed_problems(4))
def test_all_boxed_solvers_agree(problem):
    M, q, lower, upper = problem
    reference = solve_lcp(M, q, "enumeration", lower=lower, upper=upper).z
    scale = 1.0 + np.abs(reference).max()
    for name in BOXED:
        if len(q) <= largest_n(name):
            z = solve_lcp(M, q, name, lower=lower, upper=upper).z
            atol = 1e-9 * scale if name in DIRECT_BOXED else 1e-4 * scale
            np.testing.assert_allclose(z, reference, rtol=0.0, atol=atol, err_msg=name)


@given(problem=boxed_problems(4))
def test_the_boxed_enumeration_against_all_bases_by_numpy(problem):
    """The oracle itself, against a loop that shares nothing with it."""
    M, q, lower, upper = problem
    n, best = len(q), None
    for sides in itertools.product((-1, 0, 1), repeat=n):
        at = np.array(sides)
        if (np.isinf(lower) & (at < 0)).any() or (np.isinf(upper) & (at > 0)).any():
            continue
        z = np.where(at < 0, lower, np.where(at > 0, upper, 0.0))
        free = at == 0
        z[free] = np.linalg.solve(M[np.ix_(free, free)], -(q + M[:, ~free] @ z[~free])[free])
        error = np.abs(z - np.clip(z - M @ z - q, lower, upper)).max()
        if best is None or error < best[0]:
            best = error, z
    found = solve_lcp(M, q, "enumeration", lower=lower, upper=upper).z
    np.testing.assert_allclose(found, best[1], rtol=1e-9, atol=1e-10)


def test_a_slider_sticks_slips_and_turns():
    """|r| <= 2 against a rate r + q: the boxed law of dry friction by hand."""
    for q, z, w in ((1.0, -1.0, 0.0), (5.0, -2.0, 3.0), (-5.0, 2.0, -3.0), (2.0, -2.0, 0.0)):
        for name in BOXED:
            solution = solve_lcp([[1.0]], [q], name, lower=-2.0, upper=2.0)
            np.testing.assert_allclose([solution.z[0], solution.w[0]], [z, w], rtol=0.0, atol=1e-6, err_msg=name)


@pytest.mark.parametrize("name", [*DIRECT_BOXED])
def test_free_rows_are_a_linear_system(name):
    """All rows free: w = 0 everywhere, whatever the sign of z."""
    M = np.array([[4.0, 1.0], [1.0, 3.0]])
    solution = solve_lcp(M, [1.0, -2.0], name, lower=-np.inf, upper=np.inf)
    np.testing.assert_allclose(solution.z, np.linalg.solve(M, [-1.0, 2.0]), rtol=1e-12, atol=0.0)


@pytest.mark.parametrize(
    "name", [name for name in ("auto", "lemke", "enumeration", "newton-fb", "interior-point") if name in SOLVERS]
)
@given(data=st.data())
def test_the_equations_of_motion_with_their_contacts_as_one_mixed_problem(name, data):
    """A v - Hᵀ r = f, 0 <= r ⟂ H v + b >= 0, with v free, gives the r of the condensed LCP."""
    whole = st.integers(-4, 4)
    m, nc = 3, data.draw(st.integers(1, 3))
    B = np.array(data.draw(st.lists(whole, min_size=m * m, max_size=m * m)), dtype=float).reshape(m, m)
    H = np.array(data.draw(st.lists(whole, min_size=nc * m, max_size=nc * m)), dtype=float).reshape(nc, m)
    f, b = (np.array(data.draw(st.lists(whole, min_size=k, max_size=k)), dtype=float) for k in (m, nc))
    A = B @ B.T / 4.0 + np.eye(m)
    W = H @ np.linalg.solve(A, H.T)
    assume(np.linalg.eigvalsh(W)[0] > 1e-3)
    M = np.block([[A, -H.T], [H, np.zeros((nc, nc))]])
    lower = np.concatenate([np.full(m, -np.inf), np.zeros(nc)])
    mixed = solve_lcp(M, np.concatenate([-f, b]), name, lower=lower)
    condensed = solve_lcp(W, H @ np.linalg.solve(A, f) + b, "enumeration")
    np.testing.assert_allclose(mixed.z[m:], condensed.z, rtol=0.0, atol=1e-7 * (1.0 + condensed.z.max()))
    np.testing.assert_allclose(mixed.w[:m], 0.0, rtol=0.0, atol=1e-8 * (1.0 + np.abs(mixed.z).max()))


@pytest.mark.parametrize("name", PLAIN)
def test_solvers_without_bounds_refuse_them(name):
    with pytest.raises(UnsupportedError, match=rf"{name}.*lower = 0 and upper = inf.*auto"):
        solve_lcp([[1.0]], [-1.0], name, upper=0.5)
    assert solve_lcp([[1.0]], [-1.0], name, lower=0.0, upper=np.inf).success


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"lower": 1.0, "upper": 0.0}, r"lower\[0\] = 1 and upper\[0\] = 0"),
        ({"lower": [0.0, 3.0], "upper": [1.0, 2.0]}, r"lower\[1\] = 3 and upper\[1\] = 2"),
        ({"lower": np.nan}, "lower must be"),
        ({"upper": [1.0, 2.0, 3.0]}, "upper must be one number or 2 numbers"),
        ({"lower": np.inf}, "leave no value"),
        ({"upper": -np.inf, "lower": -np.inf}, "leave no value"),
        ({"lower": "low"}, "lower must be"),
    ],
)
def test_bad_bounds_are_named(given, words):
    with pytest.raises(InputError, match=words):
        solve_lcp(np.eye(2), [-1.0, -1.0], **given)


@given(problem=boxed_problems(5))
def test_the_reduction_to_a_plain_lcp_has_the_same_solution(problem):
    M, q, lower, upper = problem
    N, p, row, sign, base = to_lcp(M, q, lower, upper)
    z = base.copy()
    if len(p):
        assert np.linalg.eigvalsh(N + N.T)[0] >= -1e-9 * np.abs(N).max(), "a semidefinite problem stays one"
        y = solve_lcp(N, p, "lemke").z
        from_lcp(row, sign, y, z)
    np.testing.assert_allclose(
        z, solve_lcp(M, q, "enumeration", lower=lower, upper=upper).z, rtol=0.0, atol=1e-9 * (1.0 + np.abs(z).max())
    )


@pytest.mark.parametrize("name", BOXED)
@pytest.mark.parametrize(("on_M", "on_q"), [(1e-6, 1e-6), (1e-9, 1e-9), (1.0, 1e-9), (1e9, 1.0)])
def test_scaled_boxes(name, on_M, on_q):
    M = np.array([[2.0, 0.5], [0.5, 1.0]])
    q, lower, upper = np.array([-3.0, 1.5]), np.array([-1.0, -0.25]), np.array([1.0, np.inf])
    expected = solve_lcp(M, q, "enumeration", lower=lower, upper=upper).z
    assert expected.tolist() == [1.0, -0.25]
    unit = on_q / on_M
    z = solve_lcp(on_M * M, on_q * q, name, lower=lower * unit, upper=upper * unit).z
    np.testing.assert_allclose(z / unit, expected, rtol=0.0, atol=1e-12 if name in DIRECT_BOXED else 1e-6)


# ---- the forms of M -------------------------------------------------------------------------------------------------


def random_bands(rng, n, b):
    bands = rng.normal(size=(b + 1, n))
    bands[0] = 2.0 * np.abs(bands).sum(axis=0) + 4.0 * b + 1.0
    return bands


@pytest.mark.parametrize("n", [1, 2, 3, 7, MAX_LOOP_ORDER + 3, 60])
def test_the_two_storages_are_one_matrix(n):
    rng = np.random.default_rng(n)
    b = min(2, n - 1)
    operator = Banded(random_bands(rng, n, b))
    M = operator.array()
    assert (M == M.T).all()
    assert bandwidth(M) == b
    z, dense, banded = rng.normal(size=n), np.empty(n), np.empty(n)
    product(M, z, dense)
    product(operator.W, z, banded)
    np.testing.assert_allclose(dense, M @ z, rtol=1e-13, atol=1e-12)
    np.testing.assert_allclose(banded, M @ z, rtol=1e-13, atol=1e-12)
    for W in (M, operator.W):
        d, c = np.empty(n), np.empty(n)
        diagonal(W, d)
        assert (d == np.diag(M)).all()
        for i in range(n):
            column(W, i, c)
            assert (c == M[:, i]).all()
            assert row_product(W, i, z) == pytest.approx(M[i] @ z, rel=1e-12, abs=1e-11)
            assert [entry(W, i, j) for j in range(n)] == M[i].tolist()


@pytest.mark.parametrize("n", [1, 2, 5, MAX_LOOP_ORDER, MAX_LOOP_ORDER + 1, 70])
def test_linear_algebra_against_numpy(n):
    """On both sides of the size from which LAPACK is called."""
    rng = np.random.default_rng(n)
    B, b = rng.normal(size=(n, n)), rng.normal(size=n)
    S = B @ B.T + np.eye(n)
    x, y = b.copy(), b.copy()
    assert cholesky_solve(S.copy(), x)
    np.testing.assert_allclose(x, np.linalg.solve(S, b), rtol=1e-9, atol=1e-12)
    assert lu_solve(B.copy(), y)
    np.testing.assert_allclose(y, np.linalg.solve(B, b), rtol=1e-7, atol=1e-9)
    product_ = np.empty(n)
    multiply(B, b, product_)
    np.testing.assert_allclose(product_, B @ b, rtol=1e-12, atol=1e-12)
    assert largest(B) == np.abs(B).max()
    assert absolute_sum(B.reshape(-1)) == pytest.approx(np.abs(B).sum(), rel=1e-12)
    if n > 1:
        singular = S.copy()
        singular[-1] = singular[0]
        singular[:, -1] = singular[:, 0]
        singular[-1, -1] = singular[0, 0]
        assert not cholesky_solve(singular.copy(), b.copy())
        assert not lu_solve(singular.copy(), b.copy())
    assert not cholesky_solve(-S, b.copy())


@pytest.mark.parametrize("n", [3, 40])
def test_finite_and_symmetric_are_seen(n):
    x = np.ones(n * n)
    assert all_finite(x)
    assert all_finite(np.full(n * n, 1e308)), "their sum overflows, and each is finite"
    for bad in (np.nan, np.inf, -np.inf):
        x[n] = bad
        assert not all_finite(x)
    M = np.ones((n, n)) + np.eye(n)
    assert is_symmetric(M)
    M[n - 1, 1] += 1e-9
    assert not is_symmetric(M)
    assert is_symmetric(np.ones((2, n))), "bands are"


@pytest.mark.parametrize("name", [name for name in SOLVERS if "banded" in SOLVERS[name].storages])
@pytest.mark.parametrize("b", [1, 2, 4])
def test_banded_storage_gives_the_answer_of_the_dense_one(name, b):
    rng = np.random.default_rng(b)
    for n in (b + 1, b + 2, 12, 40):
        operator = Banded(random_bands(rng, n, b))
        q = rng.normal(size=n)
        z = solve_lcp(operator, q, name).z
        reference = solve_lcp(operator.array(), q, "lemke").z
        np.testing.assert_allclose(z, reference, rtol=0.0, atol=1e-8 * (1.0 + reference.max()))
        if SOLVERS[name].boxed:
            z = solve_lcp(operator, q, name, lower=-0.01, upper=0.02).z
            reference = solve_lcp(operator.array(), q, "lemke", lower=-0.01, upper=0.02).z
            np.testing.assert_allclose(z, reference, rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("name", [name for name in SOLVERS if "factored" in SOLVERS[name].storages])
@pytest.mark.parametrize("kind", [np.asarray, sp.csr_matrix, sp.csc_array])
def test_an_operator_by_its_factors_gives_the_answer_of_the_dense_one(name, kind):
    rng = np.random.default_rng(3)
    for m, n in ((4, 2), (6, 6), (3, 6)):
        B = rng.normal(size=(m, m))
        A, H = B @ B.T + np.eye(m), rng.normal(size=(n, m))
        operator = Factored(kind(A), kind(H))
        M = H @ np.linalg.solve(A, H.T)
        np.testing.assert_allclose(operator.array(), M, rtol=0.0, atol=1e-12)
        if n > m and Property.PSD not in SOLVERS[name].requires and name not in ("auto", "active-set"):
            continue  # M is singular
        q = rng.normal(size=n) if n <= m else M @ -rng.random(n)
        solution = solve_lcp(operator, q, name, max_iter=20_000)
        assert box_defect(M, q, np.zeros(n), np.full(n, np.inf), solution.z) <= 4.0 * SOLVERS[name].tol
        np.testing.assert_allclose(solution.w, M @ solution.z + q, rtol=0.0, atol=1e-11)


def test_the_factors_are_not_multiplied_out(monkeypatch):
    """Of 300 columns only those of rows that become free are asked for; the diagonal takes one solve each, once."""
    n, m = 300, 400
    rng = np.random.default_rng(0)
    A = sp.diags([np.full(m - 1, -1.0), np.full(m, 2.5), np.full(m - 1, -1.0)], [-1, 0, 1])
    H = sp.random(n, m, 0.02, random_state=1, format="csr")
    operator = Factored(A, H)
    operator.diagonal(np.empty(n))
    asked: list[int] = []
    plain = Factored.column

    def counting(self, j, c):
        asked.append(j)
        plain(self, j, c)

    monkeypatch.setattr(Factored, "column", counting)
    monkeypatch.setattr(Factored, "array", lambda self: pytest.fail("M was formed"))
    q = np.abs(rng.normal(size=n))
    q[:5] *= -1.0
    solution = prepare_lcp(operator).solve(q)
    assert 2 <= (solution.z > 0.0).sum() < 40
    assert len(asked) == len(set(asked)) < 60


def scattered(M, rng):
    """M with the entries of each row in any order, and with entries in two parts."""
    csr, parts = sp.csr_array(M), sp.coo_array(M)
    order = np.concatenate([rng.permutation(np.arange(a, b)) for a, b in itertools.pairwise(csr.indptr)])
    unsorted = sp.csr_array((csr.data[order], csr.indices[order], csr.indptr.copy()), shape=csr.shape)
    i, j, x = np.tile(parts.row, 2), np.tile(parts.col, 2), np.r_[parts.data * 0.25, parts.data * 0.75]
    order = rng.permutation(len(x))
    twice = sp.coo_array((x[order], (i[order], j[order])), shape=parts.shape)
    return unsorted, twice, sp.csc_array(twice), sp.lil_array(csr), sp.dia_array(csr)


@pytest.mark.parametrize("seed", range(10))
def test_a_sparse_matrix_is_the_same_in_any_order_of_its_entries(seed):
    rng = np.random.default_rng(seed)
    n, b = int(rng.integers(12, 60)), int(rng.integers(1, 3))
    root = np.tril(np.triu(rng.standard_normal((n, n)) * (rng.random((n, n)) < 0.8), -b))
    M, q = root @ root.T + 0.1 * np.eye(n), rng.standard_normal(n)
    wanted = solve_lcp(M, q)
    for each in scattered(M, rng):
        before = each.toarray()
        found = solve_lcp(each, q)
        np.testing.assert_allclose(as_operator(each).array(), M, rtol=0, atol=1e-13 * np.abs(M).max())
        np.testing.assert_allclose(found.z, wanted.z, rtol=1e-9, atol=1e-9 * np.abs(wanted.z).max())
        assert (each.toarray() == before).all()


def test_a_row_without_weight_beside_no_bound_is_judged():
    """A contact that nothing moves: an infinite room times its weight, zero, is no number."""
    operator = Factored(np.eye(3), np.array([[0.0, 0.0, 0.0], [1.0, -1.0, 0.0]]))
    found = solve_lcp(operator, [-1.0, -1.0], throw=False)
    assert found.status in (Status.RAY, Status.INFEASIBLE)


def test_sparse_matrices_become_bands_or_dense():
    chain = sp.diags([np.full(29, -1.0), np.full(30, 2.0), np.full(29, -1.0)], [-1, 0, 1])
    assert as_operator(chain).storage == "banded"
    np.testing.assert_array_equal(as_operator(chain).array(), chain.toarray())
    lopsided = chain.tolil()
    lopsided[0, 1] = -0.5
    assert as_operator(lopsided).storage == "dense"
    np.testing.assert_array_equal(as_operator(lopsided).array(), lopsided.toarray())
    assert as_operator(sp.csr_array(np.ones((3, 3)))).storage == "dense"
    with pytest.raises(InputError, match="square"):
        as_operator(sp.csr_array(np.ones((3, 2))))
    chain = chain.tolil()
    chain[4, 4] = np.nan
    with pytest.raises(InputError, match="not finite"):
        as_operator(chain)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Banded(np.ones((3, 2))), r"\(b \+ 1, n\)"),
        (lambda: Banded(np.ones(3)), r"\(b \+ 1, n\)"),
        (lambda: Banded([[1.0, np.nan]]), "not finite"),
        (lambda: Factored(np.eye(2), np.ones((1, 3))), "H must have 2 columns"),
        (lambda: Factored(np.ones((2, 3)), np.ones((1, 3))), "A must be square"),
        (lambda: Factored(-np.eye(2), np.ones((1, 2))), "positive definite"),
        (lambda: Factored(np.array([[1.0, 2.0], [2.0, 1.0]]), np.ones((1, 2))), "positive definite"),
        (lambda: Factored(sp.csc_array(np.array([[1.0, 2.0], [2.0, 1.0]])), np.ones((1, 2))), "positive definite"),
        (lambda: Factored(sp.csc_array(np.array([[1.0, 0.5], [0.0, 1.0]])), np.ones((1, 2))), "positive definite"),
        (lambda: Factored(np.array([[1.0, 0.5], [0.0, 1.0]]), np.ones((1, 2))), "positive definite"),
        (lambda: Dense(np.eye(2), tags=["psdd"]), "did you mean 'psd'"),
        (lambda: solve_lcp(Dense(np.eye(2)), [1.0, 1.0], tags=["psd"]), "tags stand with the operator"),
    ],
)
def test_bad_operators_are_named(make, words):
    with pytest.raises(InputError, match=words):
        make()


def test_a_matrix_that_is_too_large_to_be_dense_is_refused():
    big = Banded(np.vstack([np.full(30_000, 2.0), np.full(30_000, -1.0)]))
    with pytest.raises(UnsupportedError, match=r"dense M of order 30000 takes 7 GB.*auto"):
        solve_lcp(big, -np.ones(30_000), "lemke")
    assert solve_lcp(big, -np.ones(30_000)).success
    far = sp.coo_array(([1.0], ([0], [29_999])), shape=(30_000, 30_000))
    assert as_operator(far).storage == "sparse"
    with pytest.raises(UnsupportedError, match=r"dense M of order 30000 takes 7 GB.*auto"):
        solve_lcp(far, -np.ones(30_000), "lemke")
    with pytest.raises(UnsupportedError, match=r"no solver takes a sparse M of order 30000"):
        solve_lcp(far, -np.ones(30_000))


# ---- tags -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("M", "found"),
    [
        (np.eye(2), {"SYMMETRIC", "PSD", "P", "POSITIVE_DIAGONAL"}),
        (np.array([[1.0, -1.0], [-1.0, 1.0]]), {"SYMMETRIC", "PSD", "POSITIVE_DIAGONAL"}),
        (np.array([[1.0, 2.0], [2.0, 1.0]]), {"SYMMETRIC", "POSITIVE_DIAGONAL"}),
        (np.array([[1.0, 3.0], [0.0, 1.0]]), {"P", "POSITIVE_DIAGONAL"}),
        (np.array([[0.0, -1.0], [1.0, 0.0]]), {"PSD"}),
        (np.array([[4.0, 1.0], [-2.0, 3.0]]), {"PSD", "P", "POSITIVE_DIAGONAL"}),
        (-np.eye(3), {"SYMMETRIC"}),
        (np.zeros((1, 1)), {"SYMMETRIC", "PSD"}),
        (np.eye(12) + 3.0 * np.eye(12, k=1), {"POSITIVE_DIAGONAL"}),  # P, but too large to try all minors
        (np.eye(6) + 3.0 * np.eye(6, k=1), {"P", "POSITIVE_DIAGONAL"}),
    ],
)
def test_properties_are_found(M, found):
    assert {each.name for each in Property if Dense(M).has(each)} == found


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_properties_of_bands_and_factors(scale):
    chain = Banded(scale * np.array([[2.0] * 9, [-1.0] * 9]))
    assert all(chain.has(each) for each in Property)
    loose = Banded(scale * np.array([[1.0] * 9, [-1.0] * 9]))
    assert loose.has(Property.SYMMETRIC)
    assert not loose.has(Property.PSD)
    factors = Factored(np.eye(3), np.ones((2, 3)))
    assert factors.has(Property.PSD)
    assert factors.has(Property.SYMMETRIC)
    assert not factors.has(Property.P)


def test_a_declared_property_is_not_looked_for(monkeypatch):
    M = np.array([[1.0, 2.0], [2.0, 1.0]])
    with pytest.raises(UnsupportedError, match="positive semidefinite"):
        solve_lcp(M, [-1.0, -1.0], "active-set")
    # Who declares what is not so gets a checked answer or a failure, and no wrong one.
    solution = solve_lcp(M, [-1.0, -1.0], "active-set", tags=["psd"], throw=False)
    assert (
        not solution.success
        or box_defect(M, np.array([-1.0, -1.0]), np.zeros(2), np.full(2, np.inf), solution.z) < 1e-9
    )


# ---- the choice -----------------------------------------------------------------------------------------------------


def spd(n, seed=0):
    B = np.random.default_rng(seed).normal(size=(n, n))
    return B @ B.T / n + 0.1 * np.eye(n)


def test_auto_says_what_it_took():
    rng = np.random.default_rng(1)
    assert solve_lcp([[2.0]], [-1.0]).route == ("closed-form",)
    assert solve_lcp(spd(5), rng.normal(size=5)).route == ("block-pivoting",)
    chain = 2.0 * np.eye(40) - np.eye(40, k=1) - np.eye(40, k=-1)
    assert solve_lcp(chain, rng.normal(size=40)).route == ("banded",)
    doubled = np.tile(spd(4), (2, 2))
    redundant = solve_lcp(doubled, np.tile([-1.0, 1.0, -2.0, 0.5], 2))
    assert redundant.route == ("block-pivoting", "active-set")
    assert redundant.solver == "auto"
    assert "auto: active-set after block-pivoting had given no answer that holds" in redundant.explanation
    declared = solve_lcp(doubled, np.tile([-1.0, 1.0, -2.0, 0.5], 2), tags=["symmetric", "psd"])
    assert declared.route == ("active-set",)
    skew = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    assert solve_lcp(skew, [1.0, -1.0, 2.0]).route[-1] == "lemke"
    assert "block-pivoting (" in solve_lcp(spd(5), rng.normal(size=5)).explanation


def test_auto_decides_what_lemke_cannot():
    """A ray that proves nothing leaves Lemke undecided; all bases decide."""
    M, q = np.array([[1.0, -1.0, 3.0], [2.0, -1.0, 3.0], [-1.0, -2.0, 0.0]]), -np.ones(3)
    alone = solve_lcp(M, q, "lemke", throw=False)
    both = solve_lcp(M, q, throw=False)
    assert alone.status in (Status.RAY, Status.UNDECIDED)
    assert both.status in (Status.RAY, Status.INFEASIBLE)
    assert not both.success


@pytest.mark.parametrize(
    ("M", "q", "z"),
    [
        ([[1.0, 3.0], [2.0, -1.0]], [-3.0, -3.0], [3.0, 0.0]),
        ([[1.0, 1.0], [3.0, -1.0]], [-1.0, -1.0], [1.0, 0.0]),
        ([[-2.0, -3.0, 0.0], [2.0, -1.0, 2.0], [-2.0, -3.0, -1.0]], [0.0, -2.0, 1.0], [0.0, 0.0, 1.0]),
    ],
)
def test_lemke_covers_anew_after_a_ray_that_proves_nothing(M, q, z):
    """From z0 (1, ..., 1) the path ends on a ray, and there is a solution."""
    found = solve_lcp(M, q, "lemke", trace=True)
    assert found.z.tolist() == z
    assert [step.entering for step in found.trace.steps].count("z0") > 1


def test_the_last_basis_is_solved_anew():
    """At condition 1e8 the tableau has lost digits that the matrix has not."""
    rng = np.random.default_rng(1)
    for _ in range(8):
        Q, _ = np.linalg.qr(rng.normal(size=(40, 40)))
        M = Q @ np.diag(np.logspace(-8, 0, 40)) @ Q.T
        M, q = 0.5 * (M + M.T), rng.normal(size=40)
        z = solve_lcp(M, q, "lemke").z
        alpha, fresh = z > 0.0, np.zeros(40)
        fresh[alpha] = np.linalg.solve(M[np.ix_(alpha, alpha)], -q[alpha])
        free = np.full(40, np.inf)
        limit = 3.0 * box_defect(M, q, np.zeros(40), free, np.maximum(fresh, 0.0))
        assert box_defect(M, q, np.zeros(40), free, z) <= limit


def test_every_method_that_auto_falls_back_on_is_registered():
    from lcpimpact.lcp.solvers.auto import LARGEST_TABLEAU, methods

    operators = [
        Dense([[1.0]]), Dense(spd(4)), Dense(np.ones((4, 4)), tags=["psd"]), Banded(np.ones((2, 9))),
        Factored(np.eye(2), np.eye(2)), Sparse(sp.eye_array(500)), Sparse(sp.csr_array((500, 500))),
    ]  # fmt: skip
    for operator in operators:
        for name in methods(operator):
            assert name in SOLVERS
            # Few rows are made dense for methods that have no other storage.
            assert operator.storage in SOLVERS[name].storages or operator.n <= LARGEST_TABLEAU


# ---- certificates ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [name for name in SOLVERS if name != "closed-form"])
@given(data=st.data())
def test_a_ray_is_a_proof(name, data):
    """Whoever says RAY shows v >= 0 with Mᵀ v <= 0 and q·v < 0: then v·w < 0 for every z >= 0."""
    n = data.draw(st.integers(2, 5))
    whole = st.integers(-3, 3)
    k = data.draw(st.integers(1, n - 1))
    B = np.array(data.draw(st.lists(whole, min_size=k * n, max_size=k * n)), dtype=float).reshape(k, n)
    q = np.array(data.draw(st.lists(whole, min_size=n, max_size=n)), dtype=float)
    M = B.T @ B
    assume((np.diag(M) > 0.0).all())
    try:
        solution = solve_lcp(M, q, name, throw=False, max_iter=2000)
    except UnsupportedError:
        return
    if solution.status is Status.RAY:
        v = solution.ray
        assert (v >= -1e-9 * v.max()).all()
        assert v @ q < 0.0
        assert (M.T @ v).max() <= 1e-9 * np.abs(M).max() * v.max()
        assert solve_lcp(M, q, "enumeration", throw=False).status is not Status.SOLVED
    else:
        assert solution.ray is None


def test_the_certificate_is_checked_on_every_count():
    M, q = np.array([[1.0, -1.0], [-1.0, 1.0]]), np.array([-2.0, 1.0])
    plain = unbounded_above(2)
    assert proves_infeasible(M, q, *plain, np.array([1.0, 1.0]))
    assert not proves_infeasible(M, q, *plain, np.array([1.0, 0.5])), "Mᵀ v has a positive entry"
    assert not proves_infeasible(M, -q, *plain, np.array([1.0, 1.0])), "q·v > 0"
    assert not proves_infeasible(M, np.array([-1.0, 1.0]), *plain, np.array([1.0, 1.0])), "q·v = 0 leaves a solution"
    assert not proves_infeasible(M, q, *plain, np.array([-1.0, -1.0])), "v < 0"
    assert not proves_infeasible(M, q, *plain, np.zeros(2))
    assert not proves_infeasible(M, q, *plain, np.array([np.nan, 1.0]))
    # Between bounds there is always a solution, so nothing proves that there is none.
    rng = np.random.default_rng(5)
    for _ in range(200):
        N, p, v = rng.normal(size=(3, 3)), rng.normal(size=3), rng.normal(size=3)
        assert not proves_infeasible(N, p, -np.ones(3), np.ones(3), v)
    # An upper bound takes the force that would be needed, and a row that must not fall has none to spare.
    lower, upper = np.array([0.0, 0.0]), np.array([1.0, np.inf])
    N, p = np.array([[-1.0, 0.0], [1.0, 0.0]]), np.array([0.0, -2.0])
    assert proves_infeasible(N, p, lower, upper, np.array([0.0, 1.0]))
    assert not proves_infeasible(N, p / 2.5, lower, upper, np.array([0.0, 1.0]))
    assert solve_lcp(N, p, lower=lower, upper=upper, throw=False).status in (Status.RAY, Status.INFEASIBLE)
    assert solve_lcp(N, p / 2.5, lower=lower, upper=upper).success


def test_a_nearly_singular_matrix_is_no_proof():
    """At condition 1e12 a direction that M all but annuls looks like a ray, and there is a solution."""
    for seed in range(40):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(2, 12))
        Q, _ = np.linalg.qr(rng.normal(size=(n, n)))
        M = Q @ np.diag(np.logspace(-12, 0, n)) @ Q.T
        M = 0.5 * (M + M.T)
        v = np.abs(Q[:, 0])  # a copy of M with the annulled direction in the positive orthant
        signs = np.where(Q[:, 0] < 0.0, -1.0, 1.0)
        M = signs[:, None] * M * signs
        assert np.abs(M @ v).max() < 1e-11
        assert not proves_infeasible(M, -M @ v, *unbounded_above(n), v), "z = v is a solution"
        assert solve_lcp(M, -M @ v, throw=False).status not in (Status.RAY, Status.INFEASIBLE)


def test_two_walls_that_close_on_each_other():
    """Bodies between walls that come nearer: the impulses that hold them apart would have to grow for ever."""
    n = 20
    free = Banded(np.vstack([np.r_[1.0, np.full(n - 2, 2.0), 1.0], np.full(n, -1.0)]))
    solution = solve_lcp(free, np.full(n, -0.1), throw=False)
    assert solution.status is Status.RAY
    assert solution.ray.tolist() == [1.0] * n
    assert solve_lcp(free, np.full(n, -0.1), "block-pivoting", throw=False).status is Status.SINGULAR
    assert solve_lcp(free, np.where(np.arange(n) == 3, 1.0, -1.0 / n)).success


# ---- chains ---------------------------------------------------------------------------------------------------------


def chain_of(masses) -> Banded:
    c = 1.0 / np.asarray(masses, dtype=float)
    bands = np.vstack([c[:-1] + c[1:], np.r_[-c[1:-1], 0.0]])
    return Banded(bands if len(c) > 2 else bands[:1])


@given(data=st.data())
def test_pooling_solves_chains(data):
    n = data.draw(st.integers(1, 7))
    masses = np.array(data.draw(st.lists(st.integers(1, 9), min_size=n + 1, max_size=n + 1)), dtype=float)
    if data.draw(st.booleans()):
        masses[0] = np.inf
    elif data.draw(st.booleans()):
        masses[-1] = np.inf
    q = np.array(data.draw(st.lists(st.integers(-6, 6), min_size=n, max_size=n)), dtype=float)
    operator = chain_of(masses)
    M = operator.array()
    found, z = np.empty(n + 1), np.empty(n)
    if n > 2:
        assert chain_masses(operator.W, found)
        np.testing.assert_allclose(1.0 / found, 1.0 / masses, rtol=0.0, atol=1e-15)
    assert isotonic_chain(masses, q, z, pools_for(len(q))) == int(Status.SOLVED)
    reference = solve_lcp(M, q, "enumeration").z
    np.testing.assert_allclose(z, reference, rtol=0.0, atol=1e-10 * (1.0 + reference.max()))


def test_what_is_no_chain_is_seen():
    room = np.empty(9)
    assert chain_masses(chain_of(np.arange(1.0, 10.0)).W, room)
    for k, j, factor in ((0, 4, 1.001), (1, 4, 0.999), (1, 4, -1.0), (1, 0, 0.0)):
        bands = chain_of(np.arange(1.0, 10.0)).bands
        bands[k, j] *= factor
        assert not chain_masses(bands, room), (k, j, factor)
    assert not chain_masses(np.ones((3, 8)), room)


def test_a_long_chain_under_gravity():
    """N bodies that fall together onto the ground carry what stands on them: z_i = (mass above) times the stop."""
    n = 100_000
    masses = np.r_[np.inf, np.random.default_rng(0).uniform(0.5, 2.0, n)]
    q = np.zeros(n)
    q[0] = -1.0
    solution = solve_lcp(chain_of(masses), q)
    assert solution.route == ("banded",)
    np.testing.assert_allclose(solution.z, np.cumsum(masses[:0:-1])[::-1], rtol=1e-10, atol=0.0)


def test_a_stack_that_flies_keeps_its_small_differences():
    """Bodies thrown upwards in a long row: y grows to thousands along it, and the impulses of a few contacts stay small."""
    n = 50_000
    rng = np.random.default_rng(4)
    q = 0.1 + 0.01 * rng.random(n)
    q[1000::7000] = -1e-3
    solution = solve_lcp(chain_of(np.r_[np.inf, rng.uniform(0.5, 2.0, n)]), q)
    assert solution.route == ("banded",)
    assert (solution.z > 0.0).sum() == len(range(1000, n, 7000))
    assert solution.residual <= 1e-15


# ---- many right sides -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", list(SOLVERS))
def test_prepared_solves_equal_single_ones(name):
    n = largest_n(name)
    M, rng = spd(n, 7), np.random.default_rng(7)
    prepared = prepare_lcp(M, name)
    for _ in range(5):
        q = rng.normal(size=n)
        first, second = prepared.solve(q), solve_lcp(M, q, name)
        assert first.z.tobytes() == second.z.tobytes()
        assert first.iterations == second.iterations


@pytest.mark.parametrize("name", ["block-pivoting", "active-set", "banded", "auto"])
def test_the_right_guess_takes_one_factorisation(name):
    M, rng = spd(30, 3), np.random.default_rng(3)
    q = rng.normal(size=30)
    prepared = prepare_lcp(M, name)
    cold = prepared.solve(q)
    warm = prepared.solve(q + 1e-6, z0=cold.z)
    assert warm.iterations == 1
    assert ((warm.z > 0.0) == (cold.z > 0.0)).all()


def test_the_caller_keeps_his_arrays():
    M, q, z0 = spd(4), np.array([-1.0, 2.0, -3.0, 0.5]), np.ones(4)
    lower, upper = np.full(4, -1.0), np.full(4, 2.0)
    before = [each.copy() for each in (M, q, z0, lower, upper)]
    for name in BOXED:
        if (SOLVERS[name].largest or 4) >= 4:
            solve_lcp(M, q, name, z0=z0, lower=lower, upper=upper)
    for now, then in zip((M, q, z0, lower, upper), before, strict=True):
        assert (now == then).all()
    prepared = prepare_lcp(M)
    expected = prepared.solve(q).z
    M[:] = 0.0
    assert (prepared.solve(q).z == expected).all()
    assert bounds(4, None, None)[0].tolist() == [0.0] * 4


# ---- traces ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["lemke", "keller", "dantzig"])
def test_the_trace_has_the_pivots_of_the_steps_that_a_method_calls(name):
    trace = solve_lcp([[2.0, 1.0], [1.0, 2.0]], [-5.0, -6.0], name, trace=True).trace
    assert set(trace.steps[-1].basis) == {"z1", "z2"}
    assert all(step.entering and step.leaving for step in trace.steps[-2:]), "each pivot exchanges one pair"


@pytest.mark.parametrize("name", list(SOLVERS))
def test_a_trace_ends_with_the_answer(name):
    n = min(largest_n(name), 4)
    M, q = spd(n, 2), np.array([-1.0, 0.5, -2.0, -0.25])[:n]
    solution = solve_lcp(M, q, name, trace=True)
    assert solution.trace is not None
    last = solution.trace.steps[-1]
    np.testing.assert_allclose(last.z, solution.z, rtol=0.0, atol=1e-8)
    for step in solution.trace.steps:
        np.testing.assert_allclose(step.w, M @ step.z + q + (step.w - M @ step.z - q).max(), rtol=0.0, atol=1e-9)
        assert len(step.basis) == n
    assert str(solution.trace).count("\n") == len(solution.trace) + 1
    assert solve_lcp(M, q, name).trace is None


def test_lemkes_path_of_the_textbook():
    """Cottle, Pang and Stone: z0 drives w2 out, and each complement enters in turn."""
    trace = solve_lcp([[2.0, 1.0], [1.0, 2.0]], [-5.0, -6.0], "lemke", trace=True).trace
    assert [(s.entering, s.leaving) for s in trace.steps] == [("z0", "w2"), ("z2", "w1"), ("z1", "z0")]
    assert [s.z0 for s in trace.steps] == pytest.approx([6.0, 4.0, 0.0], abs=1e-12)
    assert trace.steps[1].basis == ("z2", "z0")
    rows = trace.tableau(2).splitlines()
    assert rows[0].split() == ["1", "w1", "w2"]
    assert rows[1].split() == ["z2", "2.33333", "-0.333333", "0.666667"]
    assert rows[2].split() == ["z1", "1.33333", "0.666667", "-0.333333"]


@given(problem=boxed_problems(4))
def test_the_tableau_of_each_basis_holds_at_its_point(problem):
    """basic = constant + Σ coefficient · nonbasic, with the nonbasic variables at zero, is the point of the step."""
    M, q, _, _ = problem
    trace = solve_lcp(M, q, "lemke", trace=True).trace
    for k, step in enumerate(trace.steps):
        for row in trace.tableau(k).splitlines()[1:]:
            name, constant = row.split()[0], float(row.split()[1])
            value = step.z0 if name == "z0" else (step.z if name[0] == "z" else step.w)[int(name[1:]) - 1]
            assert constant == pytest.approx(value, rel=1e-4, abs=1e-6)


# ---- all solutions --------------------------------------------------------------------------------------------------


def test_all_solutions_of_problems_with_many():
    assert len(all_solutions([[1.0, 2.0], [2.0, 1.0]], [-1.0, -1.0])) == 3
    # M = -I: each row is at 0 or at q_i, by itself.
    found = all_solutions(-np.eye(3), [1.0, 2.0, 3.0])
    assert sorted(map(tuple, found)) == sorted(itertools.product((0.0, 1.0), (0.0, 2.0), (0.0, 3.0)))
    assert all_solutions([[-1.0]], [-1.0]) == []
    assert [z.tolist() for z in all_solutions([[1.0]], [-3.0], lower=-1.0, upper=2.0)] == [[2.0]]
    with pytest.raises(UnsupportedError, match="n <= 15"):
        all_solutions(np.eye(16), np.ones(16))
    with pytest.raises(InputError, match="square"):
        all_solutions([[1.0, 2.0]], [1.0])


@given(problem=boxed_problems(4))
def test_a_p_matrix_has_one_solution(problem):
    M, q, lower, upper = problem
    assert len(all_solutions(M, q, lower=lower, upper=upper)) == 1


# ---- no method is stuck where another is not ------------------------------------------------------------------------


def test_a_failed_solve_keeps_its_point_within_the_bounds():
    with pytest.raises(FailureError, match="auto") as caught:
        solve_lcp([[-1.0, 0.0], [0.0, -1.0]], [-1.0, -1.0], lower=[0.5, 0.0])
    result = caught.value.result
    assert result.z[0] >= 0.5
    assert np.isfinite(result.w).all()
    assert measure(np.eye(1), np.ones(1), *unbounded_above(1), np.ones(1), np.empty(1))[0] == 1.0
