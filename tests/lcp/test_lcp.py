"""Contract tests over every LCP solver: the declared property is measured, and the judge is written anew here."""

from __future__ import annotations

import itertools
import json
import math
from fractions import Fraction

import numpy as np
import pytest
import qpsolvers
from hypothesis import assume, given
from hypothesis import strategies as st

from lcpimpact import FailureError, InputError, Status, UnsupportedError, solve_lcp
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.judge import measure
from lcpimpact.lcp.operators import Dense, Factored, Property
from lcpimpact.lcp.problem import LCPSolution, unbounded_above
from lcpimpact.lcp.solve import prepare_lcp, verdict
from lcpimpact.lcp.solver import CompiledSolver, LCPSolver, SolverState

NAMES = list(SOLVERS)
if "daqp" in qpsolvers.available_solvers:
    NAMES += ["qp:daqp", "qp:daqp:primal"]
COMPILED = [name for name in NAMES if name == "auto" or isinstance(SOLVERS[name], CompiledSolver)]
ITERATIVE = ["pgs", "psor", "apgd", "nncg", "newton-fb", "interior-point"]
DIRECT = [name for name in COMPILED if name not in ITERATIVE]
SYMMETRIC_ONLY = [name for name in NAMES if Property.SYMMETRIC in SOLVERS[name].requires]
ANY_MATRIX = [name for name in COMPILED if not SOLVERS[name].requires and name != "closed-form"]
P_MATRIX = [name for name in NAMES if not {Property.SYMMETRIC, Property.PSD} & set(SOLVERS[name].requires)]
SEMIDEFINITE = [name for name in NAMES if name not in ("block-pivoting", "banded", "murty", "dantzig", "nnls")]
"""Solvers that take singular M; the others may say that it is singular, and may not say anything wrong."""


def largest(name: str) -> int:
    """The size up to which a solver is tried here."""
    return min(SOLVERS[name].largest or 6, 6)


def scaled_residual(M, q, z) -> float:
    """The defect that the judge measures."""
    return measure(np.array(M), np.array(q), *unbounded_above(len(q)), z, np.empty(len(q)))[0]


def defect(M, q, z) -> float:
    """How far z is from a solution, each row in the unit of its terms times the share of q in the terms of a free row.

    z_i is as far from zero as what it changes in any row. What is rounding of the terms is nothing.
    """
    M, q, z = (np.asarray(a, dtype=float) for a in (M, q, z))
    w, terms, worst = M @ z + q, np.abs(M) @ np.abs(z) + np.abs(q), 0.0
    given = np.abs(q) + np.abs(M) @ np.abs(np.minimum(z, 0.0))
    unit = terms * max((given[i] / terms[i] for i in range(len(q)) if z[i] > 0.0 and terms[i] > 0.0), default=1.0)
    for i in range(len(q)):
        change = max((abs(M[k, i]) / unit[k] for k in range(len(q)) if unit[k] > 0.0), default=0.0)
        if abs(w[i]) > 4.0 * len(q) * 2.0**-52 * terms[i]:
            relative = abs(w[i]) / unit[i] if unit[i] > 0.0 else math.inf
            worst = max(worst, relative if w[i] < 0.0 else min(relative, max(z[i], 0.0) * (change or math.inf)))
        worst = max(worst, -z[i] * change)
    return worst


def assert_solution(solution: LCPSolution, M, q, tol: float) -> None:
    """z >= 0, w >= 0 and z·w = 0 to ``tol``, each row in its own unit; and the report tells the truth."""
    assert isinstance(solution, LCPSolution)
    assert solution.status is Status.SOLVED
    assert solution.success
    M, q = np.asarray(M, dtype=float), np.asarray(q, dtype=float)
    p = np.abs(q).max() or 1.0
    assert (solution.z >= 0.0).all()
    assert defect(M, q, solution.z) <= tol
    np.testing.assert_allclose(
        solution.w, M @ solution.z + q, rtol=0.0, atol=1e-13 * (p + (np.abs(M) @ solution.z).max())
    )
    expected = np.abs(np.minimum(solution.z, M @ solution.z + q)).max() / max(1.0, np.abs(q).max())
    assert solution.residual == pytest.approx(expected, rel=1e-6, abs=1e-14)


def error_bound(M, q, tol: float) -> float:
    """Pang's bound on ‖z - z*‖_inf for an SPD M and an answer whose scaled residual is ``tol``."""
    s, p = np.abs(M).max(), np.abs(q).max() or 1.0
    values = np.linalg.eigvalsh(M / s)
    return float((1.0 + values[-1]) / values[0] * math.sqrt(len(q)) * tol * p / s)


def exact_defect(M, q, z) -> Fraction:
    """The same in rational arithmetic, for answers so large that M z + q is all rounding in floating point."""
    s, p = Fraction(float(np.abs(M).max())) or Fraction(1), Fraction(float(np.abs(q).max())) or Fraction(1)
    worst = Fraction(0)
    for i in range(len(q)):
        w = Fraction(float(q[i])) + sum(Fraction(float(a)) * Fraction(float(b)) for a, b in zip(M[i], z, strict=True))
        worst = max(worst, abs(min(Fraction(float(z[i])) * s / p, w / p)))
    return worst


@st.composite
def spd_problems(draw, largest: int = 6):
    """A well-conditioned symmetric positive definite M and a q that often has zeros and ties."""
    n = draw(st.integers(1, largest))
    whole = st.integers(-20, 20)
    B = np.array(draw(st.lists(whole, min_size=n * n, max_size=n * n)), dtype=float).reshape(n, n) / 20.0
    shift = draw(st.integers(1, 8)) / 4.0
    q = np.array(draw(st.lists(st.integers(-40, 40), min_size=n, max_size=n)), dtype=float) / 4.0
    return B.T @ B + shift * np.eye(n), q


# ---- laws that every solver obeys on SPD problems -------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
@given(data=st.data())
def test_answer_is_complementary_to_the_declared_tolerance(name, data):
    M, q = data.draw(spd_problems(largest(name)))
    solution = solve_lcp(M, q, name)
    assert_solution(solution, M, q, SOLVERS[name].tol)
    assert solution.solver == name


@pytest.mark.parametrize("name", NAMES)
@given(data=st.data(), a=st.sampled_from([1e-9, 1e-3, 0.7, 3.0, 1e5]))
def test_scaling_q_scales_z(name, data, a):
    M, q = data.draw(spd_problems(largest(name)))
    z, scaled = solve_lcp(M, q, name).z, solve_lcp(M, a * q, name).z
    tol = 1e-12 if name in DIRECT else SOLVERS[name].tol
    np.testing.assert_allclose(scaled / a, z, rtol=1e-10, atol=2.0 * error_bound(M, q, tol))


@pytest.mark.parametrize("name", NAMES)
@given(data=st.data())
def test_permuting_the_rows_permutes_the_answer(name, data):
    M, q = data.draw(spd_problems(largest(name)))
    order = np.array(data.draw(st.permutations(range(len(q)))))
    z = solve_lcp(M, q, name).z
    permuted = solve_lcp(M[np.ix_(order, order)], q[order], name).z
    tol = 1e-12 if name in DIRECT else SOLVERS[name].tol
    np.testing.assert_allclose(permuted, z[order], rtol=1e-10, atol=2.0 * error_bound(M, q, tol))


@given(problem=spd_problems())
def test_all_solvers_agree(problem):
    M, q = problem
    reference = solve_lcp(M, q, "enumeration").z
    scale = max(np.abs(reference).max(), 1e-30)
    for name in NAMES:
        if len(q) > largest(name):
            continue
        z = solve_lcp(M, q, name).z
        atol = 1e-10 * scale if name in DIRECT else error_bound(M, q, SOLVERS[name].tol)
        np.testing.assert_allclose(z, reference, rtol=0.0, atol=atol, err_msg=name)


@given(problem=spd_problems())
def test_the_enumeration_against_all_bases_by_numpy(problem):
    """The oracle itself, against a loop that shares nothing with it."""
    M, q = problem
    n = len(q)
    best = None
    for k in range(n + 1):
        for support in itertools.combinations(range(n), k):
            z = np.zeros(n)
            rows = list(support)
            if rows:
                z[rows] = np.linalg.solve(M[np.ix_(rows, rows)], -q[rows])
            if best is None or defect(M, q, z) < defect(M, q, best):
                best = z
    np.testing.assert_allclose(
        solve_lcp(M, q, "enumeration").z, best, rtol=1e-9, atol=1e-12 * (1.0 + np.abs(best).max())
    )


@pytest.mark.parametrize("name", P_MATRIX)
@given(data=st.data())
def test_p_matrices_that_are_not_symmetric(name, data):
    """A row-dominant M with positive diagonal is a P-matrix: one solution for every q."""
    n = data.draw(st.integers(1, largest(name)))
    whole = st.integers(-10, 10)
    M = np.array(data.draw(st.lists(whole, min_size=n * n, max_size=n * n)), dtype=float).reshape(n, n)
    np.fill_diagonal(M, 0.0)
    M += np.diag(np.abs(M).sum(axis=1) + 1.0)
    q = np.array(data.draw(st.lists(st.integers(-20, 20), min_size=n, max_size=n)), dtype=float)
    solution = solve_lcp(M, q, name)
    assert_solution(solution, M, q, SOLVERS[name].tol)
    np.testing.assert_allclose(solution.z, solve_lcp(M, q, "enumeration").z, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("name", SEMIDEFINITE)
@given(data=st.data())
def test_rank_deficient_positive_semidefinite(name, data):
    """M = Bᵀ B with fewer rows than columns and q = M (z* - ...) made solvable: w = M z is unique, z is not."""
    n = data.draw(st.integers(2, largest(name)))
    k = data.draw(st.integers(1, n - 1))
    whole = st.integers(-4, 4)
    B = np.array(data.draw(st.lists(whole, min_size=k * n, max_size=k * n)), dtype=float).reshape(k, n)
    assume((np.abs(B).sum(axis=0) > 0.0).all())
    parts = st.lists(st.integers(0, 3), min_size=n, max_size=n)
    z, w = np.array(data.draw(parts), dtype=float), np.array(data.draw(parts), dtype=float)
    w[z > 0.0] = 0.0
    M = B.T @ B
    q = w - M @ z
    solution = solve_lcp(M, q, name)
    assert_solution(solution, M, q, SOLVERS[name].tol)
    s, p = np.abs(M).max(), np.abs(q).max() or 1.0
    scale = p * max(1.0, np.abs(solution.z).max() * s / p)
    np.testing.assert_allclose(solution.w, w, rtol=0.0, atol=10.0 * scale * math.sqrt(SOLVERS[name].tol))


@pytest.mark.parametrize("name", SEMIDEFINITE)
@given(data=st.data())
def test_duplicated_contacts(name, data):
    """Each row of a regular problem, twice: W is singular, and the forces of the two copies add up."""
    M, q = data.draw(spd_problems(largest(name) // 2))
    twice = np.repeat(np.arange(len(q)), 2)
    single = solve_lcp(M, q, "enumeration").z
    solution = solve_lcp(M[np.ix_(twice, twice)], q[twice], name)
    assert_solution(solution, M[np.ix_(twice, twice)], q[twice], SOLVERS[name].tol)
    total = solution.z[0::2] + solution.z[1::2]
    np.testing.assert_allclose(total, single, rtol=1e-10, atol=4.0 * error_bound(M, q, SOLVERS[name].tol))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("on_M", "on_q"), [(1e-6, 1e-6), (1e-9, 1e-9), (1.0, 1e-9), (1e9, 1e9), (1e-9, 1.0)])
def test_scaled_copies(name, on_M, on_q):
    n = largest(name)
    rng = np.random.default_rng(7)
    B = rng.normal(size=(n, n))
    M, q = B @ B.T + np.eye(n), rng.normal(size=n)
    q[0] = -abs(q[0])
    z = solve_lcp(M, q, "enumeration").z
    assert z.max() > 0.0
    solution = solve_lcp(on_M * M, on_q * q, name)
    assert_solution(solution, on_M * M, on_q * q, SOLVERS[name].tol)
    tol = 1e-12 if name in DIRECT else SOLVERS[name].tol
    np.testing.assert_allclose(solution.z * (on_M / on_q), z, rtol=1e-10, atol=error_bound(M, q, tol))


@pytest.mark.parametrize("name", DIRECT)
@pytest.mark.parametrize("scale", [1e-200, 1e200])
def test_the_units_may_be_extreme(name, scale):
    """The product of two entries under- or overflows; that is no reason to call the problem infeasible."""
    solution = solve_lcp(scale * np.array([[2.0, 1.0], [1.0, 2.0]]), [-5.0 * scale, -6.0 * scale], name)
    np.testing.assert_allclose(solution.z, [4.0 / 3.0, 7.0 / 3.0], rtol=1e-13, atol=0.0)


@pytest.mark.parametrize("name", DIRECT)
def test_a_degenerate_row_that_rounding_puts_on_neither_side(name):
    """w_2 = -1e-15 with row 1 alone, z_2 = -1e-16 with both: each basis misses by rounding, and M is SPD."""
    M = np.array([[8.187570051375204, -6.8706027100567555], [-6.8706027100567555, 9.711886351847385]])
    q = np.array([-66.10129666001953, 55.46892974605019])
    solution = solve_lcp(M, q, name)
    assert_solution(solution, M, q, SOLVERS[name].tol)
    np.testing.assert_allclose(solution.z, [-q[0] / M[0, 0], 0.0], rtol=1e-14, atol=1e-14)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["auto", "lemke"])
@pytest.mark.parametrize("n", [16, 64])
@pytest.mark.parametrize("kind", ["spd", "singular", "condition 1e8", "chain", "duplicated", "p-matrix"])
def test_larger_classes(name, n, kind):
    rng = np.random.default_rng(n)
    B = rng.normal(size=(n, n))
    q = rng.normal(size=n)
    if kind == "spd":
        M = B @ B.T + np.eye(n)
    elif kind == "singular":
        M = B[:, : n // 2] @ B[:, : n // 2].T
        q = np.abs(q) * (rng.random(n) < 0.5) - M @ (np.abs(rng.normal(size=n)) * (rng.random(n) < 0.5))
    elif kind == "condition 1e8":
        Q, _ = np.linalg.qr(B)
        M = Q @ np.diag(np.logspace(-8, 0, n)) @ Q.T
        M = 0.5 * (M + M.T)
    elif kind == "chain":
        M = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    elif kind == "duplicated":
        half = B[: n // 2] @ B[: n // 2].T + np.eye(n // 2)
        M, q = np.tile(half, (2, 2)), np.tile(q[: n // 2], 2)
    else:
        M = B - B.T + np.eye(n)
    assert_solution(solve_lcp(M, q, name), M, q, SOLVERS[name].tol)


# ---- problems from books --------------------------------------------------------------------------------------------


def fathi(n):
    L = np.eye(n) + 2.0 * np.tri(n, k=-1)
    return L @ L.T


FRICTION = [  # Stewart and Trinkle's friction problem of one contact with µ = 1/2
    [1.0, 0.0, 0.0, 0.0],
    [0.0, 1.0, -1.0, 1.0],
    [0.0, -1.0, 1.0, 1.0],
    [0.5, -1.0, -1.0, 0.0],
]

BOOK = {
    "Murty (1988), example 2.8": (
        [[1, -1, -1, -1], [-1, 1, -1, -1], [1, 1, 2, 0], [1, 1, 0, 2]], [3, 5, -9, -5], [2, 1, 3, 1],
    ),
    "Murty's exponential family, n = 8": (
        np.eye(8) + 2.0 * np.tri(8, k=-1).T, -np.ones(8), [0, 0, 0, 0, 0, 0, 0, 1],
    ),
    "Fathi's exponential family, n = 8": (fathi(8), -np.ones(8), [1, 0, 0, 0, 0, 0, 0, 0]),
    "Csizmadia's family, n = 6": (np.eye(6) - np.tri(6, k=-1), -np.ones(6), [1, 2, 4, 8, 16, 32]),
    "Kostreva (1979), example 1: Lemke cycles without a tie rule": (
        [[1, 2, 0], [0, 1, 2], [2, 0, 1]], [-1, -1, -1], [1 / 3, 1 / 3, 1 / 3],
    ),
    "Ben Gharbia and Gilbert (2012): plain min-Newton cycles": (
        [[1, 0, 2], [2, 1, 0], [0, 2, 1]], [-1, -1, -1], [1 / 3, 1 / 3, 1 / 3],
    ),
    "Cottle, Pang and Stone (1992), example 1.1 of 2 by 2 with the solution (4/3, 7/3)": (
        [[2, 1], [1, 2]], [-5, -6], [4 / 3, 7 / 3],
    ),
    "degenerate: q has a zero in an inactive row": ([[2, 1], [1, 2]], [0, -1], [0, 1 / 2]),
    "degenerate: both z and w vanish in row 2": ([[2, 1], [1, 2]], [-1, -1 / 2], [1 / 2, 0]),
    "q = 0": ([[2, 1], [1, 2]], [0, 0], [0, 0]),
    "only the second row acts": ([[2, 1], [1, 2]], [3, -1], [0, 1 / 2]),
    "only the first row acts": ([[2, 1], [1, 2]], [-1, 3], [1 / 2, 0]),
    "a chain of three contacts": ([[2, -1, 0], [-1, 2, -1], [0, -1, 2]], [-1, -1, -1], [1.5, 2, 1.5]),
    "skew: the optimality conditions of a linear program": ([[0, -1], [1, 0]], [2, -1], [1, 2]),
    "friction that sticks (copositive)": (FRICTION, [-1.0, 0.2, -0.2, 0.0], [1.0, 0.0, 0.2, 0.0]),
    "friction that slides (copositive)": (FRICTION, [-1.0, 2.0, -2.0, 0.0], [1.0, 0.0, 0.5, 1.5]),
    "n = 1, acts": ([[4.0]], [-2.0], [0.5]),
    "n = 1, does not act": ([[4.0]], [2.0], [0.0]),
}  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("title", BOOK)
def test_book(name, title):
    M, q, z = (np.array(a, dtype=float) for a in BOOK[title])
    assert defect(M, q, z) <= 1e-15, "the book's answer solves the book's problem"
    try:
        SOLVERS[name].check(Dense(M))
    except UnsupportedError:
        # Refused for a reason that can be checked: too large, or not symmetric, semidefinite or of positive diagonal.
        lowest = np.linalg.eigvalsh(0.5 * (M + M.T))[0]
        plain = (M == M.T).all() and lowest >= 0.0 and (np.diag(M) > 0.0).all()
        assert len(M) > 2 if name == "closed-form" else not plain
        return
    solution = solve_lcp(M, q, name)
    assert_solution(solution, M, q, SOLVERS[name].tol)
    atol = 1e-12 if name in DIRECT else 1e-4 if "degenerate" in title else 1e-5
    np.testing.assert_allclose(solution.z, z, rtol=1e-12, atol=atol * max(1.0, z.max()))


@pytest.mark.parametrize("name", SEMIDEFINITE)
@pytest.mark.parametrize(
    ("M", "q", "w"),
    [
        ([[1.0, -1.0], [-1.0, 1.0]], [-1.0, 1.0], [0.0, 0.0]),
        ([[1.0, -1.0], [-1.0, 1.0]], [-1.0, 2.0], [0.0, 1.0]),
        ([[1.0, 1.0], [1.0, 1.0]], [-1.0, -1.0], [0.0, 0.0]),
        ([[49.0, 49.0], [49.0, 49.0]], [-1.0, -1.0], [0.0, 0.0]),  # 49 (1/49) < 1 in floating point
        ([[3.0, 3.0], [3.0, 3.0]], [-0.1, -0.1], [0.0, 0.0]),
        ([[4.0, 6.0], [6.0, 9.0]], [-2.0, -3.0], [0.0, 0.0]),
    ],
)
def test_singular_pairs(name, M, q, w):
    """Rank one: z is not unique, w is."""
    solution = solve_lcp(M, q, name)
    assert_solution(solution, np.array(M), np.array(q), SOLVERS[name].tol)
    np.testing.assert_allclose(solution.w, w, rtol=0.0, atol=1e-5)


# ---- traps ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["closed-form", *ANY_MATRIX])
@pytest.mark.parametrize("M", [0.0, -1.0, -1e-9])
@pytest.mark.parametrize("q", [1.0, 0.0])
def test_n_1_with_m_not_positive_and_q_not_negative_is_solved_by_zero(name, M, q):
    solution = solve_lcp([[M]], [q], name)
    assert solution.z.tolist() == [0.0]
    assert solution.w.tolist() == [q]


@pytest.mark.parametrize("name", ["closed-form", *ANY_MATRIX])
@pytest.mark.parametrize("M", [0.0, -1.0, -1e-9])
def test_n_1_with_m_not_positive_and_q_negative_has_no_solution(name, M):
    """The shortcut z = -q/M would say 1 or inf... or -1."""
    solution = solve_lcp([[M]], [-1.0], name, throw=False)
    assert solution.status in (Status.RAY, Status.INFEASIBLE, Status.UNDECIDED)
    assert np.isfinite(solution.z).all()


INFEASIBLE = {
    "Murty (1988), example 2.9": ([[-1, 0, -3], [1, -2, -5], [-2, -1, -2]], [-3, -2, -1]),
    "Kostreva (1979), example 2": ([[1, -1, 3], [2, -1, 3], [-1, -2, 0]], [-1, -1, -1]),
    "rank one, q outside its range": ([[1, -1], [-1, 1]], [-1, -1]),
    "rank one, tilted": ([[1, -1], [-1, 1]], [-2, 1.999]),
    "a row of zeros": ([[1, 0], [0, 0]], [-1, -1]),
    "zero": ([[0]], [-1]),
    "negative": ([[-1]], [-1]),
}


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("title", INFEASIBLE)
def test_infeasible_is_never_called_solved(name, title):
    M, q = (np.array(a, dtype=float) for a in INFEASIBLE[title])
    try:
        solution = solve_lcp(M, q, name, throw=False, max_iter=2000)
    except UnsupportedError:
        assert SOLVERS[name].requires or len(M) > SOLVERS[name].largest
        return
    assert not solution.success
    assert solution.status in (
        Status.RAY, Status.INFEASIBLE, Status.UNDECIDED, Status.MAX_ITER, Status.SINGULAR, Status.INACCURATE,
    )  # fmt: skip
    assert solution.z.shape == q.shape


@pytest.mark.parametrize("name", NAMES)
@given(data=st.data())
def test_infeasible_semidefinite_is_never_called_solved(name, data):
    """M a = 0 with a > 0 gives a·w = a·q < 0 for every z, so no w >= 0 exists."""
    n = data.draw(st.integers(1, largest(name)))
    whole = st.integers(-4, 4)
    B = np.array(data.draw(st.lists(whole, min_size=n * n, max_size=n * n)), dtype=float).reshape(n, n)
    a = np.array(data.draw(st.lists(st.integers(1, 3), min_size=n, max_size=n)), dtype=float)
    q = np.array(data.draw(st.lists(whole, min_size=n, max_size=n)), dtype=float)
    B -= np.outer(B @ a, a) / (a @ a)
    M = B.T @ B
    assume(a @ q < -0.5)
    try:
        solution = solve_lcp(M, q, name, throw=False, max_iter=500)
    except UnsupportedError:
        assume(False)
    # Rounding may have made M regular with a solution near 1e16; who claims it must hold it to the tolerance.
    if solution.success:
        assert exact_defect(M, q, solution.z) <= SOLVERS[name].tol
        assert solution.residual <= 1e-6, "the report agrees with the status"


@pytest.mark.parametrize("name", ANY_MATRIX)
@given(data=st.data())
def test_a_row_that_cannot_become_positive_is_never_called_solved(name, data):
    n = data.draw(st.integers(1, 5))
    whole = st.integers(-4, 4)
    M = np.array(data.draw(st.lists(whole, min_size=n * n, max_size=n * n)), dtype=float).reshape(n, n)
    q = np.array(data.draw(st.lists(whole, min_size=n, max_size=n)), dtype=float)
    row = data.draw(st.integers(0, n - 1))
    M[row], q[row] = -np.abs(M[row]), -1.0
    assert not solve_lcp(M, q, name, throw=False).success


@pytest.mark.parametrize("name", NAMES)
@given(data=st.data())
def test_starved_solvers_do_not_claim_success(name, data):
    M, q = data.draw(spd_problems(largest(name)))
    solution = solve_lcp(M, q, name, max_iter=1, throw=False)
    if solution.success:
        assert defect(M, q, solution.z) <= SOLVERS[name].tol
    else:
        assert solution.status in (Status.MAX_ITER, Status.UNDECIDED, Status.INACCURATE)


@pytest.mark.parametrize("name", [n for n in NAMES if n.startswith("qp:osqp") or n in ("lemke", "pgs", "enumeration")])
def test_one_iteration_is_not_enough_for_the_iterative_ones(name):
    """Four coupled contacts that all act need more than one pivot, sweep or basis."""
    solution = solve_lcp(2.0 * np.eye(4) + 1.0, [-1.0, -2.0, -3.0, -4.0], name, max_iter=1, throw=False)
    assert solution.status is Status.MAX_ITER
    assert solution.iterations <= 1


@pytest.mark.parametrize("name", SYMMETRIC_ONLY)
def test_not_symmetric_is_refused(name):
    with pytest.raises(UnsupportedError, match=rf"{name}.*symmetric.*lemke"):
        solve_lcp([[2.0, 1.0], [0.0, 2.0]], [-1.0, -1.0], name)
    with pytest.raises(UnsupportedError, match="symmetric"):
        solve_lcp([[2.0, 1.0 + 1e-9], [1.0, 2.0]], [-1.0, -1.0], name)


@pytest.mark.parametrize("name", [name for name in NAMES if Property.PSD in SOLVERS[name].requires])
def test_indefinite_is_refused(name):
    with pytest.raises(UnsupportedError, match=rf"{name}.*positive semidefinite.*lemke"):
        solve_lcp([[1.0, 2.0], [2.0, 1.0]], [-1.0, -1.0], name)


@pytest.mark.parametrize(
    ("name", "M", "words"),
    [
        ("closed-form", np.eye(3), "n <= 2"),
        ("enumeration", np.eye(16), "n <= 15"),
        ("pgs", np.diag([1.0, 0.0]), "positive diagonal"),
        ("block-pivoting", np.diag([1.0, 0.0]), "positive diagonal"),
    ],
)
def test_what_a_solver_is_not_made_for_is_refused(name, M, words):
    with pytest.raises(UnsupportedError, match=rf"{name}.*{words}.*lemke"):
        solve_lcp(M, -np.ones(len(M)), name)


@pytest.mark.parametrize("name", NAMES)
def test_never_none_and_always_whole(name):
    """Whatever happens, z and w are arrays of n numbers, and the rest has its type."""
    for M, q in (([[2.0, 1.0], [1.0, 2.0]], [-5.0, -6.0]), ([[1.0, -1.0], [-1.0, 1.0]], [-1.0, -1.0])):
        solution = solve_lcp(M, q, name, throw=False, max_iter=50)
        assert solution.z.shape == solution.w.shape == (2,)
        assert solution.z.dtype == solution.w.dtype == np.float64
        assert (solution.z >= 0.0).all()
        assert isinstance(solution.status, Status)
        assert isinstance(solution.iterations, int)
        assert isinstance(solution.residual, float)
        assert solution.message == solution.status.sentence
        assert solution.solver == name


@pytest.mark.parametrize("name", NAMES)
def test_a_then_b_equals_b_alone(name):
    """No state leaks, neither between calls nor between the q of one prepared kernel."""
    M, q = np.array([[2.0, 1.0], [1.0, 3.0]]), np.array([-5.0, -6.0])
    alone = solve_lcp(M, q, name)
    solve_lcp([[9.0, -1.0], [-1.0, 5.0]], [-1.0, -100.0], name)
    solve_lcp([[1.0, -1.0], [-1.0, 1.0]], [-1.0, -1.0], name, throw=False, max_iter=20)
    after = solve_lcp(M, q, name)
    assert after.z.tobytes() == alone.z.tobytes()
    assert after.iterations == alone.iterations

    prepared = prepare_lcp(M, name)
    for other in ([-1.0, 7.0], [3.0, 4.0], [-2.0, -200.0]):
        prepared.solve(other)
    again = prepared.solve(q)
    assert again.z.tobytes() == alone.z.tobytes()
    assert again.iterations == alone.iterations


def test_a_guess_helps_the_iterative_solver_and_harms_no_other():
    M, q = np.eye(4) + 0.4, np.array([-1.0, -2.0, 3.0, -4.0])
    cold = solve_lcp(M, q, "pgs")
    guess = cold.z.copy()
    warm = solve_lcp(M, q, "pgs", z0=guess)
    assert warm.iterations == 1 < cold.iterations
    assert guess.tobytes() == cold.z.tobytes()
    for name in NAMES:
        if name != "closed-form":
            other = solve_lcp(M, q, name, z0=[100.0, 0.0, 100.0, 0.0])
            np.testing.assert_allclose(other.z, cold.z, rtol=0.0, atol=error_bound(M, q, SOLVERS[name].tol) + 1e-12)


# ---- inputs ---------------------------------------------------------------------------------------------------------


def variants():
    M, q = np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([-5.0, -6.0])
    frozen = M.copy(), q.copy()
    for array in frozen:
        array.flags.writeable = False
    wide, long = np.zeros((4, 6)), np.zeros(4)
    wide[::2, ::3], long[::2] = M, q
    return {
        "lists": (M.tolist(), q.tolist()),
        "tuples": (tuple(map(tuple, M.tolist())), tuple(q)),
        "int": (M.astype(int), q.astype(int)),
        "float32": (M.astype(np.float32), q.astype(np.float32)),
        "Fortran": (np.asfortranarray(M), q),
        "strided": (wide[::2, ::3], long[::2]),
        "reversed": (M[::-1, ::-1], q[::-1]),
        "read-only": frozen,
        "big-endian": (M.astype(">f8"), q.astype(">f8")),
    }


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("kind", variants())
def test_layouts_and_types_of_inputs(name, kind):
    M, q = variants()[kind]
    before = np.array(M), np.array(q)
    solution = solve_lcp(M, q, name)
    expected = [7 / 3, 4 / 3] if kind == "reversed" else [4 / 3, 7 / 3]
    np.testing.assert_allclose(solution.z, expected, rtol=0.0, atol=1e-12 if name in DIRECT else 1e-5)
    assert (np.array(M) == before[0]).all()
    assert (np.array(q) == before[1]).all()


BAD_DATA = {
    "NaN in M": ([[np.nan]], [1.0], "M .*not finite"),
    "inf in M": ([[1.0, 0.0], [np.inf, 1.0]], [1.0, 1.0], "M .*not finite"),
    "NaN in q": ([[1.0]], [np.nan], "q .*not finite"),
    "inf in q": ([[1.0]], [-np.inf], "q .*not finite"),
    "M is a vector": ([1.0], [1.0], r"M must be square.*\(1,\)"),
    "M is a number": (1.0, [1.0], r"M must be square.*\(\)"),
    "M is not square": ([[1.0, 2.0]], [1.0], r"M must be square.*\(1, 2\)"),
    "q is too long": ([[1.0]], [1.0, 2.0], r"q must have shape \(1,\).*\(2,\)"),
    "q is a column": ([[1.0]], [[1.0]], r"q must have shape \(1,\).*\(1, 1\)"),
    "q is a number": ([[1.0]], 1.0, r"q must have shape \(1,\).*\(\)"),
    "empty": (np.zeros((0, 0)), [], "empty"),
    "ragged": ([[1.0, 2.0], [3.0]], [1.0, 2.0], "M must be an array of real numbers"),
    "words": ([["a"]], [1.0], "M must be an array of real numbers"),
    "None": (None, [1.0], "M"),
    "complex list": ([[1.0 + 1.0j]], [1.0], "real numbers"),
    "complex array": (np.array([[1.0 + 1.0j]]), [1.0], "real numbers"),
}


@pytest.mark.parametrize("name", ["auto", "pgs", "qp:osqp"])
@pytest.mark.parametrize("kind", BAD_DATA)
def test_bad_data_is_named(name, kind):
    M, q, words = BAD_DATA[kind]
    with pytest.raises(InputError, match=words):
        solve_lcp(M, q, name)


@pytest.mark.parametrize(
    "z0", ["abc", [1.0, 2.0], [np.nan], [np.inf], [[1.0]], 1.0, [1.0j], [[1.0, 2.0], [3.0]]], ids=repr
)
def test_bad_guess_is_named(z0):
    with pytest.raises(InputError, match="z0"):
        solve_lcp([[1.0]], [-1.0], "pgs", z0=z0)


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf, "1e-3", [1.0]], ids=repr)
def test_bad_tol_is_named(value):
    with pytest.raises(InputError, match="tol"):
        solve_lcp([[1.0]], [-1.0], tol=value)


@pytest.mark.parametrize("value", [0, -1, 0.5, np.nan, np.inf, "10", [1]], ids=repr)
def test_bad_max_iter_is_named(value):
    with pytest.raises(InputError, match="max_iter"):
        solve_lcp([[1.0]], [-1.0], max_iter=value)


@pytest.mark.parametrize(
    ("wrong", "right"),
    [("lemkee", "lemke"), ("pgss", "pgs"), ("closedform", "closed-form"), ("enumerate", "enumeration"),
     ("qp:osq", "qp:osqp"), ("qp:osqp:prim", "primal")],
)  # fmt: skip
def test_unknown_solver_offers_the_nearest(wrong, right):
    with pytest.raises(InputError, match=f"did you mean '{right}'"):
        solve_lcp([[1.0]], [-1.0], wrong)


@pytest.mark.parametrize("wrong", [None, 3, ["lemke"]], ids=repr)
def test_a_solver_that_is_no_name_is_refused(wrong):
    with pytest.raises(InputError, match=r"solver = .* must be a string or an LCPSolver"):
        solve_lcp([[1.0]], [-1.0], wrong)


def test_failure_carries_its_result():
    with pytest.raises(FailureError, match=r"lemke.*no solution.*ray") as caught:
        solve_lcp([[-1.0]], [-1.0], "lemke")
    assert caught.value.result.status is Status.RAY
    assert caught.value.result.z.tolist() == [0.0]
    with pytest.raises(FailureError, match=r"pgs.*max_iter") as caught:
        solve_lcp(2.0 * np.eye(4) + 1.0, [-1.0, -2.0, -3.0, -4.0], "pgs", max_iter=2)
    assert caught.value.result.status is Status.MAX_ITER
    assert caught.value.result.iterations == 2


# ---- the judge ------------------------------------------------------------------------------------------------------


@given(problem=spd_problems(), z=st.lists(st.floats(-5.0, 5.0, allow_subnormal=False), min_size=6, max_size=6))
def test_the_judge_measures_each_row_in_its_own_unit(problem, z):
    M, q = problem
    z = np.array(z[: len(q)])
    assume((q[z > 0.0] != 0.0).all())
    assert scaled_residual(M, q, z) == pytest.approx(defect(M, q, z), rel=1e-10, abs=1e-11)
    w = np.empty(len(q))
    natural = measure(M, q, *unbounded_above(len(q)), z, w)[1]
    plain = np.abs(np.minimum(z, M @ z + q)).max() / max(1.0, np.abs(q).max())
    assert natural == pytest.approx(plain, rel=1e-12, abs=1e-15)
    np.testing.assert_allclose(w, M @ z + q, rtol=0.0, atol=1e-13 * (1.0 + np.abs(M).max() * np.abs(z).sum()))


def test_the_judge_overrules_the_solver():
    assert verdict(Status.SOLVED, 1e-11, 0.0, 1e-10) is Status.SOLVED
    assert verdict(Status.SOLVED, 1e-9, 0.0, 1e-10) is Status.INACCURATE
    assert verdict(Status.SOLVED, math.inf, 0.0, 1e-10) is Status.NON_FINITE
    assert verdict(Status.SOLVED, math.nan, 0.0, 1e-10) is Status.NON_FINITE
    assert verdict(Status.RAY, 0.0, 0.0, 1e-10) is Status.RAY
    # What is rounding is left out of the defect; where it hides everything the check shows nothing.
    assert verdict(Status.SOLVED, 1e-9, 2e-9, 1e-10) is Status.INACCURATE
    assert verdict(Status.SOLVED, 0.0, 2e-9, 1e-10) is Status.SOLVED
    assert verdict(Status.SOLVED, 0.0, 2e-5, 1e-10) is Status.INACCURATE
    assert verdict(Status.SOLVED, 1e-4, 2e-5, 1e-3) is Status.SOLVED
    M, q = np.eye(2), np.array([-1.0, -1.0])
    z = np.array([1.0, np.nan])
    assert measure(M, q, *unbounded_above(2), z, np.empty(2))[:2] == (math.inf, math.inf)


class Liar(LCPSolver):
    """A solver that says SOLVED and leaves z as it is; a ray that it claims is (1, ..., 1)."""

    says = Status.SOLVED

    def init(self, M):
        def kernel(W, q, lower, upper, z, tol, max_iter):
            z[:] = 1.0 if self.says is Status.RAY else z
            return int(self.says), 1

        return SolverState(M.W, kernel, False, self.name)


LIAR = Liar(
    name="liar", summary="-", requires=(), storages=("dense",), boxed=True, tol=1e-10, max_iter=10, source="a test"
)


def test_a_lying_solver_is_found_out(monkeypatch):
    assert solve_lcp([[1.0]], [-1.0], LIAR, throw=False).status is Status.INACCURATE
    assert solve_lcp([[1.0]], [1.0], LIAR).success
    assert solve_lcp([[1.0]], [1.0], LIAR, trace=True).trace.steps[-1].z.tolist() == [0.0]
    monkeypatch.setattr(Liar, "says", Status.RAY)
    found = solve_lcp([[1.0]], [-1.0], LIAR, throw=False)
    assert found.status is Status.UNDECIDED, "1 proves nothing for M = 1"
    assert found.ray is None
    assert found.z.tolist() == [0.0]
    proved = solve_lcp([[-1.0]], [-1.0], LIAR, throw=False)
    assert proved.status is Status.RAY
    assert proved.ray.tolist() == [1.0]


def test_no_tolerance_asks_for_less_than_rounding():
    """With tol near zero an answer counts if its residual cannot be told from rounding, and only then."""
    M, q = np.array([[3.0, 1.0], [1.0, 7.0]]), np.array([-0.1, -0.7])
    exact = solve_lcp(M, q, "closed-form", tol=1e-300)
    assert exact.success
    assert defect(M, q, exact.z) <= 1e-15
    rough = solve_lcp(M, q, "pgs", tol=1e-300, max_iter=8, throw=False)
    assert 1e-12 < defect(M, q, rough.z) < 1e-3
    assert not rough.success
    assert solve_lcp(M, q, "pgs", tol=1e-3, max_iter=8).success


# ---- the primal form ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [n for n in NAMES if n.endswith(":primal")])
def test_the_primal_form_from_a_and_h(name):
    """Gauss's principle with the A and H of a mechanical system, scaled as masses are, gives the dual's forces."""
    A = np.array([[200.0, -3.0, 0.0], [-3.0, 0.5, 0.1], [0.0, 0.1, 4.0]])
    H = np.array([[-1.0, 1.0, 0.0], [0.0, -1.0, 1.0]])
    W = H @ np.linalg.solve(A, H.T)
    q = np.array([-3.0, 0.2])
    reference = solve_lcp(W, q, "enumeration").z
    assert reference[0] > 0.0
    for operator in (Dense(W, A=A, H=H), Factored(A, H)):
        z = solve_lcp(operator, q, name).z
        np.testing.assert_allclose(z, reference, rtol=0.0, atol=error_bound(W, q, SOLVERS[name].tol))


# ---- the same bits without compilation ------------------------------------------------------------------------------

BITS = """
import json
import numpy as np
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.operators import Banded, Dense
from lcpimpact.lcp.solve import prepare_lcp, solve_lcp

def bits(names):
    rng, out = np.random.default_rng(20), {}

    def keep(key, s):
        out[key] = [*map(float.hex, s.z.tolist()), s.iterations, int(s.status)]

    for case in range(10):
        n = (1, 2, 3, 4, 5, 6, 8, 24, 40, 40)[case]
        B = rng.normal(size=(n, n))
        M, q = B @ B.T + 0.3 * np.eye(n), rng.normal(size=n)
        for name in names:
            if n <= (SOLVERS[name].largest or 40) and not (n > 10 and name == "enumeration"):
                keep(f"{name} {case}", solve_lcp(M, q, name, throw=False))
                if SOLVERS[name].boxed and n <= 8:
                    keep(f"{name} {case} boxed", solve_lcp(M, q, name, lower=-0.1, upper=0.2, throw=False))
    chain = Banded([[2.0] * 30, [-1.0] * 30])
    for name in names:
        for number, (M, q) in enumerate((
            (np.array([[1.0, 2, 0], [0, 1, 2], [2, 0, 1]]), -np.ones(3)),
            (np.array([[1.0, -1.0], [-1.0, 1.0]]), -np.ones(2)),
            (chain, np.cos(np.arange(30.0))),
        )):
            operator = M if isinstance(M, Banded) else Dense(M)
            solver = SOLVERS[name]
            if operator.n <= (solver.largest or 40) and name != "enumeration" and all(map(operator.has, solver.requires)):
                keep(f"{name} special {number}", solve_lcp(M, q, name, throw=False))
    return out
"""


@pytest.mark.compiled
def test_the_interpreter_gives_the_bits_of_the_compiled_code(python):
    namespace: dict = {}
    exec(BITS, namespace)
    assert all(prepare_lcp([[1.0]], name).state.compiled for name in COMPILED)
    compiled = json.loads(json.dumps(namespace["bits"](COMPILED)))
    interpreted = python(
        f"{BITS}\nassert not any(prepare_lcp([[1.0]], n).state.compiled for n in {COMPILED})\n"
        f"print(json.dumps(bits({COMPILED})))",
        LCPIMPACT_COMPILE="never",
    )
    assert len(compiled) > 15 * len(COMPILED)
    assert interpreted == compiled


def test_nothing_warns_where_nothing_is_compiled(python):
    """A zero in a row that is not active, no diagonal, a row of zeros, and numbers near the largest."""
    code = f"""
import json, warnings
import numpy as np
from lcpimpact import all_solutions, prepare_lcp, solve_lcp
from lcpimpact.errors import UnsupportedError

warnings.simplefilter("error")
solved = 0
for M, q in (
    ([[2, 1], [1, 2]], [-1, 0]), ([[0, 1], [-1, 0]], [0, -1]), ([[1, 0], [0, 0]], [-1, 0]),
    ([[1e308, 0], [0, 1e308]], [-1e308, 1e308]),
):
    for name in {COMPILED}:
        try:
            solved += solve_lcp(M, q, name, max_iter=100, throw=False, trace=True).success
            solved += prepare_lcp(M, name).solve(q, max_iter=100, throw=False).success
        except UnsupportedError:
            continue
    solved += len(all_solutions(M, q, lower=[-np.inf, -1.0], upper=[np.inf, 1.0]))
print(json.dumps(solved))
"""
    assert python(code, LCPIMPACT_COMPILE="never") > 40
