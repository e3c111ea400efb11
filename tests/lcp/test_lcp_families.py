"""Every class of problems that contacts lead to: no wrong answer by any solver, and no solvable problem missed by auto."""

from __future__ import annotations

import itertools
from collections import Counter

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from lcp_families import FAMILIES, Case

from lcpimpact import InputError, Status, UnsupportedError
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.operators import Banded, Dense
from lcpimpact.lcp.problem import LCPSolution, bounds
from lcpimpact.lcp.rational import MAX_ORDER, decide
from lcpimpact.lcp.solve import solve_lcp

WRONG = 1e-6
UNSOLVABLE = (Status.RAY, Status.INFEASIBLE)

ORDERS = {1: 10, 2: 10, 3: 10, 5: 10, 8: 10, 16: 10, 32: 6, 64: 4, 128: 2, 256: 2}
"""Orders to the number of instances of each family."""


def dense(case: Case):
    """M, q, lower and upper as plain arrays."""
    n = len(case.q)
    M = case.M.array() if isinstance(case.M, Banded) else case.M
    lower = np.zeros(n) if case.lower is None else case.lower
    return M, case.q, lower, np.full(n, np.inf) if case.upper is None else case.upper


def error(case: Case, z) -> float:
    """‖z - P(z - w)‖_inf in units where max |M| = max |q| = 1, by sparse products where M is large."""
    n, q = len(case.q), case.q
    if isinstance(case.M, Banded):
        bands = case.M.bands
        w = q + bands[0] * z
        for k in range(1, len(bands)):
            w[k:] += bands[k, : n - k] * z[: n - k]
            w[: n - k] += bands[k, : n - k] * z[k:]
        s = np.abs(bands).max()
        lower = np.zeros(n) if case.lower is None else case.lower
        upper = np.full(n, np.inf) if case.upper is None else case.upper
    else:
        M, q, lower, upper = dense(case)
        w, s = M @ z + q, np.abs(M).max()
    s, p = s or 1.0, np.abs(q).max() or 1.0
    return float(np.abs(np.maximum(np.minimum(w / p, (z - lower) * s / p), (z - upper) * s / p)).max())


def solve(case: Case, name: str, **options) -> LCPSolution:
    return solve_lcp(case.M, case.q, name, lower=case.lower, upper=case.upper, throw=False, **options)


def verdict(case: Case, solvable: bool, solution: LCPSolution) -> str:
    """Return what is to be said of an answer: right, wrong, missed, undecided."""
    if solution.success:
        return "right" if solvable and error(case, solution.z) <= WRONG else "wrong"
    if solvable:
        return "wrong" if solution.status in UNSOLVABLE else "missed"
    return "right" if solution.status in UNSOLVABLE or rounding_solves(case) else "undecided"


def rounding_solves(case: Case) -> bool:
    """Whether the floats of a problem without a solution have one, far away, as rounded entries of M may give."""
    M, q, lower, upper = dense(case)
    decision = decide(Dense(M), q, *bounds(len(q), lower, upper)[:2])
    return decision is not None and decision.z is not None


@pytest.mark.parametrize("name", FAMILIES)
def test_a_family_is_what_it_says(name):
    family = FAMILIES[name]
    assert family.name == name
    assert family.summary
    assert family.source
    for n in (1, 2, 3, 4, 7, 12):
        if not family.has_order(n):
            continue
        case, again = (family.make(n, np.random.default_rng(n)) for _ in range(2))
        M, q, *_ = dense(case)
        assert (dense(again)[0] == M).all()
        assert (again.q == q).all()
        assert M.shape == (len(q), len(q))
        assert 0 < len(q) <= n
        assert family.boxed == (case.lower is not None or case.upper is not None)
        if "symmetric" in family.tags:
            np.testing.assert_allclose(M, M.T, rtol=0.0, atol=1e-14 * np.abs(M).max())
        if "psd" in family.tags:
            assert np.linalg.eigvalsh(M + M.T)[0] >= -1e-10 * np.abs(M).max()
        if "p" in family.tags and len(q) <= 7:
            for rows in range(1, 2 ** len(q)):
                chosen = [i for i in range(len(q)) if rows >> i & 1]
                assert np.linalg.det(M[np.ix_(chosen, chosen)]) > 0.0
        if case.z is not None:
            assert family.solvable
            assert error(case, case.z) <= 1e-12
        if not family.solvable and len(q) <= 5:
            assert solve_lcp(M, q, "enumeration", throw=False).status is not Status.SOLVED


@pytest.mark.parametrize("name", list(SOLVERS))
def test_no_solver_is_ever_wrong(name):
    """Small problems of every family that the solver takes; the iterative ones may give up."""
    solver, taken = SOLVERS[name], 0
    for family in FAMILIES.values():
        for n in (1, 2, 3, 6, 9):
            case = family.make(n, np.random.default_rng([n, 5])) if family.has_order(n) else None
            if case is None:
                continue
            try:
                solution = solve(case, name, max_iter=min(solver.max_iter, 2000))
            except UnsupportedError:
                continue
            taken += 1
            assert verdict(case, family.solvable, solution) != "wrong", (family.name, n, solution)
    assert taken >= (20 if solver.largest == 2 else 50)


@pytest.mark.parametrize("name", FAMILIES)
def test_auto_solves_every_family(name):
    family = FAMILIES[name]
    for n in (1, 2, 3, 4, 8, 17, 33):
        for seed in range(2):
            if family.has_order(n):
                case = family.make(n, np.random.default_rng([n, seed]))
                solution = solve(case, "auto")
                # That the floats of a larger problem have no solution is said only if a ray proves it.
                said = {"right"} if family.solvable or n <= MAX_ORDER else {"right", "undecided"}
                assert verdict(case, family.solvable, solution) in said, (n, seed, solution.explanation)
                if case.z is not None and "p" in family.tags:
                    np.testing.assert_allclose(
                        solution.z, case.z, rtol=0.0, atol=1e-6 * (1.0 + np.abs(case.z).max()), err_msg=str(n)
                    )


def test_two_rows_at_condition_1e8_need_no_second_method():
    family = FAMILIES["ill-conditioned"]
    for seed in range(400):
        case = family.make(2, np.random.default_rng([2, seed]))
        solution = solve(case, "auto")
        assert verdict(case, True, solution) == "right", seed
        assert solution.route == ("closed-form",), seed


@pytest.mark.parametrize("name", [name for name in FAMILIES if "p" in FAMILIES[name].tags])
def test_block_pivoting_is_finite_for_p_matrices(name):
    """Its safeguard is what ends the cycles that Ben Gharbia and Gilbert made for Newton's method without one."""
    for n in (1, 2, 3, 5, 8, 13):
        if FAMILIES[name].has_order(n):
            case = FAMILIES[name].make(n, np.random.default_rng(n))
            assert verdict(case, True, solve(case, "block-pivoting")) == "right", n


@pytest.mark.parametrize("name", [name for name in FAMILIES if {"symmetric", "psd"} <= set(FAMILIES[name].tags)])
def test_the_active_set_decides_every_semidefinite_problem(name):
    """With redundant contacts and bounds too, and where there is no solution it shows why."""
    family = FAMILIES[name]
    for n, seed in itertools.product((1, 2, 3, 4, 5, 6, 8, 13, 21), range(4)):
        if family.has_order(n):
            case = family.make(n, np.random.default_rng([n, seed]))
            assert verdict(case, family.solvable, solve(case, "active-set")) == "right", (n, seed)


@pytest.mark.slow
def test_auto_on_two_thousand_problems():
    counts, bad = Counter(), []
    for family in FAMILIES.values():
        for n, instances in ORDERS.items():
            for seed in range(instances if family.has_order(n) else 0):
                case = family.make(n, np.random.default_rng([n, seed, 77]))
                solution = solve(case, "auto")
                said = verdict(case, family.solvable, solution)
                counts[said] += 1
                # That the floats of a larger problem have no solution is said only if a ray proves it.
                if said != "right" and (said, n > MAX_ORDER, family.solvable) != ("undecided", True, False):
                    bad.append((family.name, n, seed, said, solution.status.name, solution.explanation))
    for name in ("spd", "chain"):
        for seed in range(2):
            case = FAMILIES[name].make(1000, np.random.default_rng(seed))
            counts[verdict(case, True, solve(case, "auto"))] += 1
    assert not bad
    assert counts.total() >= 2000
    assert counts["right"] >= 0.98 * counts.total()


DTYPES = ["float64", "float32", "float16", "int64", "int8", "uint8", ">f8", "<i4", "bool"]
LAYOUTS = ["C", "F", "strided", "reversed", "read-only", "lists", "transposed view"]


def laid_out(array, layout):
    """The same numbers in another layout."""
    if layout == "F":
        return np.asfortranarray(array)
    if layout == "strided":
        wide = np.zeros(tuple(2 * k for k in array.shape), array.dtype)
        view = wide[tuple(slice(None, None, 2) for _ in array.shape)]
        view[...] = array
        return view
    if layout == "reversed":
        back = tuple(slice(None, None, -1) for _ in array.shape)
        return array[back].copy()[back]
    if layout == "read-only":
        array = array.copy()
        array.flags.writeable = False
        return array
    if layout == "lists":
        return array.tolist()
    return array.T.copy().T if layout == "transposed view" else array


@st.composite
def inputs(draw):
    n = draw(st.integers(1, 7))
    numbers = st.integers(0, 12) if draw(st.booleans()) else st.integers(-12, 12)
    M = np.array(draw(st.lists(numbers, min_size=n * n, max_size=n * n)), dtype=float).reshape(n, n)
    kind = draw(st.sampled_from(["any", "symmetric", "gram", "dominant", "zero rows"]))
    if kind == "symmetric":
        M = M + M.T
    elif kind == "gram":
        M = M[: draw(st.integers(1, n))].T @ M[: draw(st.integers(1, n))] if n == 1 else M[:-1].T @ M[:-1]
    elif kind == "dominant":
        np.fill_diagonal(M, np.abs(M).sum(axis=1) + 1.0)
    elif kind == "zero rows":
        M[draw(st.integers(0, n - 1))] = 0.0
    q = np.array(draw(st.lists(st.integers(-9, 9), min_size=n, max_size=n)), dtype=float)
    dtype = draw(st.sampled_from(DTYPES))
    if dtype.startswith(("float", ">f")):
        scales = st.sampled_from([0, 0, 0, -9, -6, 3, 9] if dtype != "float16" else [0, -2])
        M, q = M * 10.0 ** draw(scales), q * 10.0 ** draw(scales)
    with np.errstate(all="ignore"):
        M, q = M.astype(dtype), q.astype(dtype)
    lower = draw(st.sampled_from([None, None, None, 0, -1.0, -np.inf]))
    upper = draw(st.sampled_from([None, None, None, np.inf, 2, 1e-3]))
    name = draw(st.sampled_from(["auto"] * 4 + [name for name in SOLVERS if not name.startswith("qp:")]))
    return M, q, lower, upper, name, draw(st.sampled_from(LAYOUTS)), draw(st.sampled_from(LAYOUTS))


def check_any_input(problem):
    """Whatever comes in: a solution that holds, a failure that says so, or a refusal by name."""
    M, q, lower, upper, name, layout_M, layout_q = problem
    try:
        solution = solve_lcp(
            laid_out(M, layout_M), laid_out(q, layout_q), name, lower=lower, upper=upper, throw=False, max_iter=3000
        )
    except UnsupportedError:
        assert name != "auto"
        return
    except InputError:
        assert not (np.isfinite(M).all() and np.isfinite(q).all())
        return
    n = len(q)
    assert solution.z.shape == solution.w.shape == (n,)
    assert np.isfinite(solution.z).all()
    case = Case(
        M.astype(float), q.astype(float), np.full(n, 0.0 if lower is None else lower), np.full(n, upper or np.inf)
    )
    assert ((case.lower <= solution.z) & (solution.z <= case.upper)).all()
    assert isinstance(solution.status, Status)
    if solution.success:
        # Rows are judged in their own units: beside a q of 1e-9 the rounding of M z counts as large in those of q.
        rounding = 8.0 * np.finfo(float).eps * (np.abs(case.M) @ np.abs(solution.z) + np.abs(case.q)).max()
        assert error(case, solution.z) <= WRONG or solution.residual <= rounding
    elif name == "auto" and solution.status in UNSOLVABLE:
        assert solve(case, "enumeration", max_iter=3**7).status is not Status.SOLVED


@given(problem=inputs())
def test_any_input(problem):
    check_any_input(problem)


@pytest.mark.slow
@settings(max_examples=2_000, deadline=None, suppress_health_check=list(HealthCheck))
@given(problem=inputs())
def test_any_of_two_thousand_inputs(problem):
    check_any_input(problem)
