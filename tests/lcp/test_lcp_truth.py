"""No answer called solved is wrong, and no problem that has a solution is called infeasible."""

from __future__ import annotations

import itertools
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lcpimpact import FailureError, Status, UnsupportedError, all_solutions, solve_lcp
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.judge import clear_residual, holds, measure
from lcpimpact.lcp.operators import Banded, Dense, Factored
from lcpimpact.lcp.problem import LCPSolution, bounds, unbounded_above
from lcpimpact.lcp.rational import decide, nearest_floats, proof, proves_infeasible
from lcpimpact.lcp.solve import prepare_lcp
from lcpimpact.lcp.solvers.block_triangular import components, is_irreducible

NAMES = list(SOLVERS)
ANY_MATRIX = ["auto", "lemke", "enumeration", "block-triangular", "closed-form"]
P_MATRIX = ["auto", "lemke", "enumeration", "block-triangular", "murty", "block-pivoting", "active-set"]
NO_SOLUTION = (Status.RAY, Status.INFEASIBLE)


def fractions(values) -> list:
    """An array as nested lists of fractions."""
    array = np.asarray(values, dtype=float)
    return [fractions(each) if array.ndim > 1 else Fraction(float(each)) for each in array]


def solved_exactly(A: list[list[Fraction]], b: list[Fraction]) -> list[Fraction] | None:
    """The x with A x = b by Gauss and Jordan, or None where A is singular."""
    rows, n = [[*row, right] for row, right in zip(A, b, strict=True)], len(b)
    for c in range(n):
        pivot = next((r for r in range(c, n) if rows[r][c] != 0), None)
        if pivot is None:
            return None
        rows[c], rows[pivot] = rows[pivot], rows[c]
        rows[c] = [a / rows[c][c] for a in rows[c]]
        for r in range(n):
            if r != c:
                rows[r] = [a - rows[r][c] * b for a, b in zip(rows[r], rows[c], strict=True)]
    return [row[n] for row in rows]


def basic_solutions(M, q, lower=None, upper=None) -> list[list[Fraction]]:
    """Every solution at a regular complementary basis."""
    N, p, n = fractions(M), fractions(q), len(q)
    low = [0.0] * n if lower is None else list(lower)
    high = [np.inf] * n if upper is None else list(upper)
    found = []
    for side in itertools.product((-1, 0, 1), repeat=n):
        if any((s < 0 and a == -np.inf) or (s > 0 and b == np.inf) for s, a, b in zip(side, low, high, strict=True)):
            continue
        z = [Fraction(float(a if s < 0 else b)) if s else Fraction(0) for s, a, b in zip(side, low, high, strict=True)]
        free = [i for i in range(n) if side[i] == 0]
        right = [-p[i] - sum(N[i][j] * z[j] for j in range(n)) for i in free]
        x = solved_exactly([[N[i][j] for j in free] for i in free], right)
        if x is None:
            continue
        for i, value in zip(free, x, strict=True):
            z[i] = value
        w = [p[i] + sum(N[i][j] * z[j] for j in range(n)) for i in range(n)]
        inside = all(low[i] <= z[i] <= high[i] for i in range(n))
        signs = all(
            (w[i] >= 0 or z[i] == high[i]) and (w[i] <= 0 or z[i] == low[i]) for i in range(n)
        )  # fmt: skip
        if inside and signs:
            found.append(z)
    return found


def exact_defect(M, q, z) -> Fraction:
    """How far the floats z are from a solution, without rounding: w_i by the terms of its row, z_i by what it changes."""
    N, p, x, n = fractions(M), fractions(q), fractions(z), len(q)
    w = [p[i] + sum(N[i][j] * x[j] for j in range(n)) for i in range(n)]
    unit = [abs(p[i]) + sum(abs(N[i][j] * x[j]) for j in range(n)) for i in range(n)]
    free = [abs(p[i]) / unit[i] for i in range(n) if x[i] > 0 and unit[i] > 0]
    share = max(free, default=Fraction(1)) or Fraction(1)
    worst = Fraction(0)
    for i in range(n):
        assert x[i] >= 0
        if w[i] == 0 or (w[i] > 0 and x[i] == 0):
            continue
        change = max(abs(N[k][i] * x[i]) / (unit[k] * share) for k in range(n) if unit[k] > 0)
        relative = abs(w[i]) / (unit[i] * share)
        worst = max(worst, relative if w[i] < 0 or change == 0 else min(relative, change))
    return worst


def assert_a_proof(M, q, ray) -> None:
    """v >= 0, Mᵀ v <= 0 and q·v < 0, in fractions of the floats that were returned."""
    N, p, v = fractions(M), fractions(q), fractions(ray)
    assert min(v) >= 0
    assert all(sum(N[i][j] * v[i] for i in range(len(v))) <= 0 for j in range(len(v)))
    assert sum(a * b for a, b in zip(p, v, strict=True)) < 0


def assert_true(found: LCPSolution, M, q, solvable: bool, tol: float) -> None:
    """Whatever was said of the problem holds."""
    if found.status is Status.SOLVED:
        assert exact_defect(M, q, found.z) <= Fraction(4.0 * tol)
    elif found.status in NO_SOLUTION:
        assert not solvable
    assert (found.ray is not None) == (found.status is Status.RAY)
    if found.ray is not None:
        assert_a_proof(M, q, found.ray)


def answers(M, q, names=NAMES):
    """What each solver that takes the problem says of it."""
    for name in names:
        if len(q) <= (SOLVERS[name].largest or len(q)):
            try:
                yield name, solve_lcp(M, q, name, throw=False)
            except UnsupportedError:
                continue


def arrays(draw, entries, *shape):
    """An array of whole numbers."""
    count = int(np.prod(shape))
    return np.array(draw(st.lists(entries, min_size=count, max_size=count)), dtype=float).reshape(shape)


# ---- proofs of infeasibility ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("k", [20, 40, 44, 46, 48, 50, 52])
def test_a_p_matrix_that_is_nearly_singular_is_solved_and_never_called_infeasible(k):
    d = 2.0**-k
    M, q, z = [[1.0, -1.0], [-1.0, 1.0 + d]], [-1.0, -1.0], [(2.0 + d) / d, 2.0 / d]
    for name, found in answers(M, q):
        assert found.status not in NO_SOLUTION, name
        if found.success and SOLVERS[name].tol <= 1e-9:
            np.testing.assert_allclose(found.z, z, rtol=1e-6, atol=0.0)
    found = solve_lcp(M, q, throw=False)
    if k < 52:
        assert found.z.tolist() == z
        assert found.w.tolist() == [0.0, 0.0]
    else:
        assert found.status is Status.INACCURATE, "2^53 + 1 is no float, and no float near it solves the problem"


@pytest.mark.parametrize("k", [30, 45, 50])
def test_a_nearly_singular_problem_of_several_rows_is_solved(k):
    d = 2.0**-k
    M = np.eye(5)
    M[1:3, 1:3] = [[1.0, -1.0], [-1.0, 1.0 + d]]
    M[3, 1] = M[0, 4] = M[4, 2] = M[2, 0] = 0.5
    q = np.array([-1.0, -1.0, -1.0, 1.0, 1.0])
    (expected,) = basic_solutions(M, q)
    np.testing.assert_allclose(solve_lcp(M, q).z, [float(a) for a in expected], rtol=1e-14, atol=0.0)


def test_a_true_ray_is_said_though_rounding_has_spoilt_it():
    """A null vector in thirds and fifths, as the pivots leave it, is the proof again once it is short."""
    v = np.array([3.0, 5.0, 7.0, 1.0])
    rng, spoils = np.random.default_rng(0), 0
    for _ in range(20):
        B = rng.integers(-9, 10, (4, 4)).astype(float)
        M = B * 105.0 - np.outer(v, 105.0 * (v @ B)) / (v @ v)
        M = np.rint(M * (v @ v))
        assert (v @ M == 0.0).all()
        q = -np.abs(rng.integers(1, 5, 4)).astype(float)
        spoilt = v / 7.0 * (1.0 + 1e-13 * rng.normal(size=4))
        plain = unbounded_above(4)
        spoils += not proves_infeasible(Dense(M), q, *plain, spoilt)
        found = proof(Dense(M), q, *plain, spoilt)
        assert found is not None
        assert_a_proof(M, q, found)
        assert solve_lcp(M, q, throw=False).status is Status.RAY
    assert spoils > 10


@pytest.mark.parametrize("scale", [2.0**-40, 1.0, 2.0**50])
def test_a_proof_does_not_depend_on_units(scale):
    D = np.array([1.0, scale, 1.0 / scale])
    v = np.array([1.0, 2.0, 3.0])
    M = np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -3.0], [0.0, -1.0, 2.0]])
    assert (v @ M == 0.0).all()
    for name, found in answers(D[:, None] * M * D, -D):
        assert not found.success, name
        if name == "auto" or found.status is Status.RAY:
            assert_a_proof(D[:, None] * M * D, -D, found.ray)


def test_a_proof_by_bands_and_by_factors_is_checked_as_given():
    n = 300
    walls = Banded(np.vstack([np.r_[1.0, np.full(n - 2, 2.0), 1.0], np.full(n, -1.0)]))
    plain = unbounded_above(n)
    assert proves_infeasible(walls, np.full(n, -0.1), *plain, np.ones(n))
    assert not proves_infeasible(walls, np.full(n, -0.1), *plain, np.ones(n) - 1e-15 * (np.arange(n) == 4))
    H = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0]])
    operator, q = Factored(np.diag([3.0, 0.1]), H), np.array([-1.0, -1.0, 1.0])
    assert proves_infeasible(operator, q, *unbounded_above(3), np.array([1.0, 1.0, 0.0]))
    assert not proves_infeasible(operator, q, *unbounded_above(3), np.array([1.0, 1.0 + 1e-15, 0.0]))
    assert solve_lcp(operator, q, throw=False).ray.tolist() == [1.0, 1.0, 0.0]


@given(data=st.data())
def test_what_is_decided_in_fractions_is_true(data):
    """Against all bases by another elimination; bounds of every kind."""
    n = data.draw(st.integers(1, 4))
    whole = st.integers(-3, 3)
    M, q = arrays(data.draw, whole, n, n), arrays(data.draw, whole, n)
    kinds = data.draw(st.lists(st.integers(0, 4), min_size=n, max_size=n))
    lower = np.array([(0.0, -np.inf, -1.0, -np.inf, 2.0)[kind] for kind in kinds])
    upper = np.array([(np.inf, np.inf, 1.5, 0.25, 2.0)[kind] for kind in kinds])
    found = decide(Dense(M), q, *bounds(n, lower, upper)[:2])
    assert found is not None
    if found.z is not None:
        w = [a + sum(b * c for b, c in zip(row, found.z, strict=True)) for a, row in zip(q, fractions(M), strict=True)]
        for i, z in enumerate(found.z):
            assert lower[i] <= z <= upper[i]
            assert w[i] >= 0 or z == upper[i]
            assert w[i] <= 0 or z == lower[i]
        return
    assert not basic_solutions(M, q, lower, upper)
    if found.ray is not None:
        assert proves_infeasible(Dense(M), q, lower, upper, nearest_floats(found.ray))


@given(data=st.data())
def test_no_solver_says_what_is_not_so_of_whole_numbers(data):
    n = data.draw(st.integers(1, 4))
    whole = st.integers(-3, 3)
    M, q = arrays(data.draw, whole, n, n), arrays(data.draw, whole, n)
    if data.draw(st.booleans()):
        M = M.T @ M
    solvable = bool(basic_solutions(M, q))
    for name, found in answers(M, q):
        assert_true(found, M, q, solvable, SOLVERS[name].tol)
        if name == "auto":
            assert found.status in (Status.SOLVED, *NO_SOLUTION)
            assert found.success or not solvable


@given(data=st.data())
def test_no_solver_says_what_is_not_so_within_an_ulp_of_a_singular_matrix(data):
    """Rank one and a few units in the last place: what rounding makes of it is one of both, and only one is true."""
    n = data.draw(st.integers(2, 4))
    a, b = (arrays(data.draw, st.integers(-3, 3), n) for _ in range(2))
    M = np.outer(a, b) * (1.0 + 2.0**-48 * arrays(data.draw, st.integers(-4, 4), n, n))
    q = arrays(data.draw, st.integers(-2, 2), n)
    solvable = bool(basic_solutions(M, q))
    for name, found in answers(M, q):
        assert_true(found, M, q, solvable, SOLVERS[name].tol)


@given(data=st.data())
def test_a_problem_made_from_its_solution_is_never_called_infeasible(data):
    """M of any rank: where all bases that fit are singular, too."""
    n = data.draw(st.integers(2, 5))
    k = data.draw(st.integers(1, n))
    M = arrays(data.draw, st.integers(-3, 3), n, k) @ arrays(data.draw, st.integers(-3, 3), k, n)
    z, w = (arrays(data.draw, st.integers(0, 3), n) for _ in range(2))
    w[z > 0.0] = 0.0
    q = w - M @ z
    for name, found in answers(M, q):
        assert_true(found, M, q, True, SOLVERS[name].tol)
    assert solve_lcp(M, q).success


# ---- units ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("small", [1e-13, 1e-30, 1e-100])
@pytest.mark.parametrize("name", NAMES)
def test_rows_of_different_units_are_both_solved(name, small):
    M = np.diag([1.0, small])
    found = solve_lcp(M, -np.diag(M), name, throw=False)
    if name in P_MATRIX or name == "closed-form":
        assert found.success
        np.testing.assert_allclose(found.z, [1.0, 1.0], rtol=1e-8)
    assert not found.success or np.abs(found.z - 1.0).max() < 1e-5


def test_the_judge_sees_a_row_of_small_numbers():
    M, q, plain, w = np.diag([1.0, 1e-13]), np.array([-1.0, -1e-13]), unbounded_above(2), np.empty(2)
    for z, solved in (([1.0, 0.0], False), ([1.0, 1.0], True), ([1.0, 1.0 + 1e-9], False), ([0.0, 1.0], False)):
        scaled, _, rounding = measure(M, q, *plain, np.array(z), w)
        assert bool(holds(scaled, rounding, 1e-10)) is solved, z
        assert (
            clear_residual(M, q, np.zeros(len(q)), np.full(len(q), np.inf), np.array(z), 1e-10) < np.inf
        ) is solved, z
    # A residue of rounding in q is no unit of its own where another row presses.
    M, q = np.array([[1.0, -0.5], [-0.5, 1.0]]), np.array([-1.0, 1e-20])
    scaled, _, rounding = measure(M, q, *plain, np.array([4.0, 2.0]) / 3.0, w)
    assert holds(scaled, rounding, 1e-10)


@given(st.integers(0, 10**6))
def test_what_the_cheap_check_accepts_the_judge_accepts_too(seed):
    """Rows with bounds of any kind, at points near a solution, near a bound, and anywhere."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 4))
    A = rng.normal(size=(n, n)) * 10.0 ** rng.uniform(-4, 4, n)
    M, q = A @ A.T + np.eye(n), rng.normal(size=n) * 10.0 ** rng.uniform(-6, 6, n)
    lower = np.where(rng.random(n) < 0.5, 0.0, np.where(rng.random(n) < 0.3, -np.inf, -rng.random(n)))
    upper = np.where(rng.random(n) < 0.5, np.inf, rng.random(n))
    solved = solve_lcp(M, q, lower=lower, upper=upper, throw=False).z
    for z in (solved, solved * (1.0 + 1e-9 * rng.normal(size=n)), np.clip(rng.normal(size=n), lower, upper), -solved):
        residual = clear_residual(M, q, lower, upper, z, 1e-10)
        scaled, _, rounding = measure(M, q, lower, upper, z, np.empty(n))
        assert residual == np.inf or (holds(scaled, rounding, 1e-10) and residual <= 1e-10)


def test_the_cheap_check_decides_rows_at_their_bounds():
    M, lower, upper = np.eye(1), np.array([-2.0]), np.array([2.0])
    for q, z, right in (
        (-5.0, 2.0, True),
        (5.0, -2.0, True),
        (5.0, 2.0, False),
        (-5.0, -2.0, False),
        (1.0, -1.0, True),
    ):
        assert (clear_residual(M, np.array([q]), lower, upper, np.array([z]), 1e-10) < np.inf) is right, (q, z)


def test_a_cancellation_passes_for_no_solution():
    """At (t, t) the terms of these rows cancel but for q_i = -1; the third row makes t a number that the data know."""
    M, q, w = np.array([[1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [1.0, 0.0, 1.0]]), np.array([-1.0, -1.0, 0.0]), np.empty(3)
    for t in 10.0 ** np.arange(0, 17):
        q[2] = -2.0 * t
        scaled, _, rounding = measure(M, q, *unbounded_above(3), np.array([t, t, t]), w)
        assert not holds(scaled, rounding, 1e-10)
    assert solve_lcp(M, q, throw=False).status is Status.RAY


@given(data=st.data())
@pytest.mark.parametrize("name", NAMES)
def test_units_of_w_and_of_z_change_nothing(name, data):
    """w in units of D1 and z in those of 1/D2: the solution of (D1 M D2, D1 q) is D2⁻¹ z, by construction."""
    n = data.draw(st.integers(1, min(5, SOLVERS[name].largest or 5)))
    B = arrays(data.draw, st.integers(-3, 3), n, n)
    symmetric = data.draw(st.booleans())
    M = B.T @ B + np.eye(n) if symmetric else B - np.diag(np.diag(B)) + np.diag(np.abs(B).sum(axis=1) + 1.0)
    z, w = (arrays(data.draw, st.integers(0, 3), n) for _ in range(2))
    w[z > 0.0] = 0.0
    powers = 2.0 ** arrays(data.draw, st.integers(-40, 40), 2, n)
    if data.draw(st.booleans()):
        powers[:] = 10.0 ** arrays(data.draw, st.integers(-12, 12), 2, n)
    of_w, of_z = (powers[0], powers[0]) if symmetric else powers
    try:
        found = solve_lcp(of_w[:, None] * M * of_z, of_w * (w - M @ z), name, throw=False)
    except UnsupportedError:
        return
    if name in P_MATRIX and (symmetric or name in ANY_MATRIX):
        assert found.success
    if found.success:
        tol = max(1e-11, 100.0 * SOLVERS[name].tol)
        np.testing.assert_allclose(found.z * of_z, z, rtol=0.0, atol=tol * np.linalg.cond(M) * (1.0 + z.max()))
    assert found.status not in NO_SOLUTION


# ---- what auto begins with ------------------------------------------------------------------------------------------


def test_a_zero_on_the_diagonal_costs_no_pivots():
    """Block pivoting needs a positive diagonal: auto does not begin with it, neither here nor in a time step."""
    rng = np.random.default_rng(2)
    for n in (3, 6, 12):
        M = rng.normal(size=(n, n))
        M = M @ M.T + np.eye(n)
        M[0, 0], M[0, 1:] = 0.0, np.abs(M[0, 1:])
        state = prepare_lcp(M).state
        assert "block-pivoting" not in (state.name, *prepare_lcp(M).solve(rng.normal(size=n), throw=False).route)
        for _ in range(20):
            q = rng.normal(size=n)
            _, pivots = state.kernel(state.W, q, *unbounded_above(n), np.zeros(n), 1e-10, 10_000)
            assert pivots <= 50 * n


def test_a_matrix_that_is_no_p_matrix_does_not_go_round_in_circles():
    """Exchanging one row at a time comes back to a basis before: that ends it, and not the limit of 10,000."""
    rng = np.random.default_rng(0)
    ended = 0
    for _ in range(200):
        n = int(rng.integers(3, 8))
        M = rng.normal(size=(n, n))
        np.fill_diagonal(M, np.abs(np.diag(M)))
        found = solve_lcp(M, rng.normal(size=n), "block-pivoting", throw=False, max_iter=10_000)
        ended += found.status is Status.UNDECIDED
        assert found.status is not Status.MAX_ITER
        assert found.iterations <= 3 * 2**n + 20
    assert ended > 20


# ---- blocks ---------------------------------------------------------------------------------------------------------


def murty(n: int):
    return np.eye(n) + 2.0 * np.tri(n, k=-1), -np.ones(n)


@pytest.mark.parametrize("n", [3, 16, 30, 200])
def test_murtys_triangle_takes_one_step_a_row(n):
    M, q = murty(n)
    order = np.random.default_rng(n).permutation(n)
    for at in (np.arange(n), order):
        found = solve_lcp(M[np.ix_(at, at)], q[at])
        assert found.route == ("block-triangular",)
        assert found.iterations == n
        assert found.z.tolist() == (at == 0).astype(float).tolist()


@given(data=st.data())
def test_the_blocks_are_the_strongly_connected_components_in_an_order_of_substitution(data):
    n = data.draw(st.integers(1, 7))
    M = arrays(data.draw, st.sampled_from([0, 0, 0, 1]), n, n)
    reach = np.linalg.matrix_power(np.eye(n) + M, n) > 0.0
    block = np.empty(n, np.int64)
    count = components(M, block)
    assert sorted(set(block)) == list(range(count))
    assert is_irreducible(M) == (count == 1)
    for i, j in itertools.product(range(n), repeat=2):
        assert (block[i] == block[j]) == (reach[i, j] and reach[j, i])
        assert M[i, j] == 0.0 or block[j] <= block[i]


@given(data=st.data())
def test_block_triangular_p_matrices_have_the_solution_of_the_whole(data):
    sizes = data.draw(st.lists(st.integers(1, 3), min_size=2, max_size=3))
    n, whole = sum(sizes), st.integers(-3, 3)
    M, q, start = np.tril(arrays(data.draw, whole, n, n), -1), arrays(data.draw, whole, n), 0
    for size in sizes:
        B = arrays(data.draw, whole, size, size)
        at = slice(start, start + size)
        M[at, at] = B + np.diag(np.abs(B).sum(axis=1) + 1.0 - np.diag(B))
        start += size
    at = np.array(data.draw(st.permutations(range(n))))
    M, q = M[np.ix_(at, at)], q[at]
    expected = [[float(a) for a in z] for z in basic_solutions(M, q)]
    for name in ("block-triangular", "auto"):
        np.testing.assert_allclose(solve_lcp(M, q, name).z, expected[0], rtol=1e-12, atol=1e-12)


def test_a_block_with_several_solutions_is_no_dead_end():
    """The first row alone is solved by z = 0 and by z = 1; with 0 the second row has no solution, with 1 it has."""
    M, q = np.array([[-1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.array([1.0, -1.0, -3.0])
    assert solve_lcp(M, q, "block-triangular", throw=False).status is Status.UNDECIDED
    found = solve_lcp(M, q)
    assert found.z.tolist() == [1.0, 0.0, 3.0]
    assert found.route[0] == "block-triangular"


# ---- bounds far from what q asks for, and the ends of the range of floats ---------------------------------------------


@pytest.mark.parametrize("name", [name for name in SOLVERS if SOLVERS[name].boxed])
@pytest.mark.parametrize("q", [-1e11, 1e13, -1e20])
def test_a_z_at_the_wrong_bound_is_no_solution(name, q):
    # From one bound to the other z changes w by less than 1e-10 of it: the sign of w tells the bound all the same.
    found = solve_lcp([[1.0]], [q], name, lower=-1.0, upper=1.0, throw=False)
    assert found.status is not Status.SOLVED or found.z == -np.sign(q)
    assert [z.item() for z in all_solutions([[1.0]], [q], lower=-1.0, upper=1.0)] == [-np.sign(q)]


@pytest.mark.parametrize("unit", [1e-60, 1e-9, 1.0, 1e9, 1e60])
def test_the_number_of_solutions_does_not_depend_on_units(unit):
    assert len(all_solutions([[1.0, 2.0], [2.0, 1.0]], [-unit, -unit])) == 3
    assert len(all_solutions(unit * np.array([[1.0, 2.0], [2.0, 1.0]]), [-1.0, -1.0])) == 3


def test_the_vertices_of_a_box_are_told_apart_by_their_places():
    assert len(all_solutions(np.zeros((2, 2)), [0.0, 0.0], lower=0.0, upper=[1.0, 2.0])) == 4


def test_solutions_that_rounding_hides_are_not_called_none():
    with pytest.raises(FailureError, match="rounding hides"):
        all_solutions([[10.000000001, -10.0], [-10.0, 10.000000001]], [-2.0, -4.0])
    assert all_solutions([[0.0, 0.0], [0.0, 1.0]], [-1.0, 1.0]) == []


def test_what_overflows_is_said_so():
    M = np.array([[-3.0, -3.0], [-3.0, -2.0]])
    found = solve_lcp(1e45 * M, [1.0, 0.0], lower=[0.0, 2.0], upper=[1e300, 2.0], throw=False)
    assert found.status is Status.NON_FINITE
    far = solve_lcp([[8.0, -6.0, 0.0], [-6.0, 5.0, 2.0], [0.0, 2.0, 8.0]], [0.0, -7e165, -3e166], "psor", throw=False)
    near = solve_lcp([[8.0, -6.0, 0.0], [-6.0, 5.0, 2.0], [0.0, 2.0, 8.0]], [0.0, -0.7, -3.0])
    assert np.allclose(far.z, 1e166 * near.z, rtol=1e-9, atol=0.0)


def mixed_problem(n: int, equations: int, kind: str):
    """M, q, lower and the planted z of an LCP with some rows w = 0, each of them written times -1."""
    g = np.random.default_rng([n, equations, len(kind)])
    free = g.choice(n, equations, replace=False)
    B = g.integers(-2, 3, (n, n))
    M = B @ B.T + np.eye(n)
    if kind == "definite":
        skew = np.triu(g.integers(-2, 3, (n, n)), 1)
        M += skew - skew.T
    else:  # constraints and their multipliers
        M[np.ix_(free, free)] = 0.0
        M[free] = -M[:, free].T
    M[free] *= -1.0
    z = np.where(g.random(n) < 0.5, 0.0, g.integers(1, 5, n))
    z[free] = g.integers(-4, 5, equations)
    w = np.where(z == 0.0, g.integers(0, 3, n), 0.0)
    w[free] = 0.0
    lower = np.zeros(n)
    lower[free] = -np.inf
    return M, w - M @ z, lower, z


@pytest.mark.parametrize("kind", ["definite", "multipliers"])
@pytest.mark.parametrize(("n", "equations"), [(4, 1), (10, 2), (16, 1), (16, 5), (40, 1), (40, 5)])
def test_equations_may_be_written_with_either_sign(kind, n, equations):
    M, q, lower, planted = mixed_problem(n, equations, kind)
    found = solve_lcp(M, q, lower=lower)
    free = lower < 0.0
    assert found.route[-1] == "lemke"
    assert np.abs(np.where(free, found.w, np.minimum(found.w, found.z))).max() < 1e-12 * np.abs(q).max()
    if kind == "definite":  # the only solution
        assert found.z == pytest.approx(planted, abs=1e-11)
    other = np.where(free, -1.0, 1.0)
    assert found.z[~free] == pytest.approx(solve_lcp(other[:, None] * M, other * q, lower=lower).z[~free], abs=1e-11)


@pytest.mark.parametrize("seed", range(12))
def test_equations_may_be_permuted_and_scaled(seed):
    """Each row and column in its own unit, from 1e-6 to 1e6."""
    n, equations = 5 + 2 * seed, 1 + seed % 4
    M, q, lower, planted = mixed_problem(n, equations, "definite")
    g, order, free = np.random.default_rng(seed), np.arange(n), np.flatnonzero(lower < 0.0)
    order[free] = g.permutation(free)
    row, column = 10.0 ** g.integers(-6, 7, (2, n))
    found = solve_lcp(row[:, None] * M[order] * column, row * q[order], "lemke", lower=lower)
    assert found.z * column == pytest.approx(planted, abs=1e-9)


def test_no_solution_is_not_said_of_rounding():
    """q = -M z is rounded: 0.3 z1 <= q1 and 0.7 z1 >= -q2 may contradict each other in the last digit."""
    M = np.array([[-0.3, 0.0, 0.0], [0.7, 0.0, 0.0], [0.2, 0.0, 1.0]])
    missed = 0
    for seed in range(30):
        q = -(M @ [np.random.default_rng(seed).random(), 0.0, 1.0])
        exact = decide(Dense(M), q, *unbounded_above(3))
        missed += exact.z is None
        assert decide(Dense(M), q, *unbounded_above(3), rounded=True).z is not None
        for name in ("auto", "lemke", "enumeration"):
            assert solve_lcp(M, q, name, throw=False).status not in NO_SOLUTION
        assert solve_lcp(M, q).residual < 1e-10
    assert missed > 0
    far = decide(Dense(np.array([[-1.0]])), np.array([-1e-30]), *unbounded_above(1), rounded=True)
    assert far.z is None


def test_auto_does_not_advise_itself():
    """An LCP that no path decides, and too large for fractions."""
    for name in ("auto", "lemke"):
        solution = LCPSolution(np.zeros(1), np.zeros(1), Status.UNDECIDED, 1.0, 0, name, (name,))
        assert ("solver='auto'" in solution.message) == (name == "lemke")
