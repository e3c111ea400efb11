"""Sparse steps against the dense ones of the same scheme, closed forms, and solvers that fail."""

from __future__ import annotations

import pickle
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import lcpimpact as li
from lcpimpact import (
    Bar,
    Bumper,
    Chain,
    Dashpot,
    Harmonic,
    HertzSpring,
    KelvinVoigt,
    Load,
    Mass,
    PrescribedMotion,
    Problem,
    Scheme,
    Slider,
    SparseScheme,
    Spring,
    Status,
    Substructure,
    energy_ledger,
    penalized,
    read_run,
    simulate,
    solve_lcp,
    write_scheme_file,
)
from lcpimpact.errors import FailureError, InputError, UnsupportedError
from lcpimpact.events import steps_of
from lcpimpact.integrators.stepping import sparse_kernel, sparse_table
from lcpimpact.integrators.stepping.stencil import apply, stencil
from lcpimpact.interpreter import interpreted
from lcpimpact.lcp.judge import clear_residual_of_chain, holds, measure
from lcpimpact.lcp.solvers.banded import isotonic_chain, pools_for
from lcpimpact.lcp.sparse_pivoting import SparseMatrix, SparseProduct, pivot_contacts
from lcpimpact.numerics.banded import solve_banded
from lcpimpact.problems.balls import pile
from lcpimpact.quantities import SUMMARY

sparse = pytest.importorskip("scipy.sparse")

EPS = np.finfo(float).eps


def mean_forces(run):
    """The mean forces of all steps of a dense run, impulses included."""
    rows = {contact.name: i for i, contact in enumerate(run.problem.dynamics.contacts)}
    struck = [event for event in run.events if event.impulse]
    forces = run.reaction.copy()
    for event, k in zip(struck, steps_of(struck, run.t, run.q, run.v), strict=True):
        forces[k, rows[event.contact]] += event.impulse / (run.t[k + 1] - run.t[k])
    return forces


def both(elements, dt, t_end, q0=None, v0=None, **options):
    """The dense and the sparse run of the same elements."""
    kinds = (Scheme, SparseScheme)
    return [
        simulate(Problem("p", kind(*elements), q0=q0 or {}, v0=v0 or {}), dt=dt, t_end=t_end, throw=False, **options)
        for kind in kinds
    ]


def assert_same(dense, sparse, rtol=1e-9):
    """Steps of both runs differ by rounding, which impacts amplify."""
    assert sparse.status is Status.SOLVED, sparse.message
    for name in ("q", "v"):
        wanted, found = getattr(dense, name), getattr(sparse, name)
        assert np.abs(found - wanted).max() <= rtol * np.abs(wanted).max() + 1e-300, name
    forces = mean_forces(dense)
    assert np.abs(sparse.reaction - forces).max(initial=0.0) <= rtol * np.abs(forces).max(initial=0.0)
    np.testing.assert_array_equal(sparse.t, dense.t)
    np.testing.assert_array_equal(sparse.t_reaction, dense.t_reaction)
    assert sparse.names == dense.names


@pytest.mark.always
def test_a_column_falls_as_the_dense_one():
    column = Chain(60, m=0.1, gap=1e-3, e=0.0, f=0.981, b="ground", name="bead")
    dense, found = both([column], 1e-3, 1.0)
    assert_same(dense, found)
    assert (found.reaction[-1] > 0.0).all()  # all beads have come to rest
    c = found.certificate
    assert c.holds
    assert c.energy_balance < 1e-12 * c.energy_scale


CHAINS = st.integers(0, 2**32 - 1)


def random_chain(rng):
    """A chain with random constants, ends and initial state; some gaps are equal, some zero."""
    n = int(rng.integers(1, 40))
    ends = {"a": rng.choice([None, "ground"]), "b": rng.choice([None, "ground"])}
    ends = {key: value and str(value) for key, value in ends.items()}
    links = n - 1 + sum(value is not None for value in ends.values())
    e = [0.0, float(rng.random()), rng.random(links)][rng.integers(3)]
    gap = [0.01 * rng.random(links), 0.01 * np.round(2.0 * rng.random(links))][rng.integers(2)]
    if links and ends["a"] and ends["b"]:
        gap = gap + 1e-3  # bumpers between two walls that can all be closed are refused
    springs = {"k": 10.0 ** rng.uniform(1, 4), "c": 10.0 ** rng.uniform(-2, 1)} if rng.random() < 0.3 else {}
    bumpers = {"gap": gap, "e": e} if links else {}
    chain = Chain(
        n, m=10.0 ** rng.uniform(-1, 1, n), f=rng.choice([0.0, 9.81]) * np.ones(n), name="x", **ends, **bumpers,
        **(springs if links else {}),
    )  # fmt: skip
    return chain, dict(zip(chain.masses, rng.choice([0.0, 1.0]) * rng.standard_normal(n), strict=True))


@settings(max_examples=60, deadline=None)
@given(seed=CHAINS)
def test_random_chains_move_as_the_dense_ones(seed):
    rng = np.random.default_rng(seed)
    chain, v0 = random_chain(rng)
    theta = float(rng.choice([0.5, 0.6, 1.0]))
    dense, found = both([chain], 1e-3, 0.1, v0=v0, theta=theta)
    if not dense.ended:
        assert not found.success
        return
    # A difference of rounding decides which contacts of a tie act in a step: compared up to the first one that differs.
    P, P_found = mean_forces(dense) > 0.0, found.reaction > 0.0
    differ = np.flatnonzero((P_found != P).any(axis=1))
    last = differ[0] if len(differ) else len(P)
    scale = np.abs(dense.v).max() + 1e-300
    assert np.abs(found.v - dense.v)[: last + 1].max() <= 1e-9 * scale
    if len(differ):
        forces = np.abs(mean_forces(dense)[last] - found.reaction[last])
        assert forces.max() <= 1e-6 * np.abs(found.reaction).max()
    assert found.ended
    assert found.success or not dense.success, found.message


def test_single_elements_assemble_to_the_matrices_of_the_dense_scheme():
    elements = [
        Mass("x", 1.0), Mass("y", 2.0), Spring("x", "y", 30.0), Spring("y", "ground", 7.0), Dashpot("x", "y", 0.5),
        Load("x", 3.0), Load("x", 1.5), Bumper("x", "y", 0.1, 0.5), Bumper("ground", {"x": 1.0, "y": -2.0}, 0.2, 0.25, "S"),
        Chain(3, m=(1.0, 2.0, 3.0), k=5.0, c=0.1, gap=0.3, e=0.5, f=1.0, a="y", b="ground", name="z"),
    ]  # fmt: skip
    dense, found = Scheme(*elements).assemble(), SparseScheme(*elements).assemble()
    assert found.nodes == dense.nodes
    assert found.reactions == tuple(contact.name for contact in dense.contacts)
    for name in ("M", "C", "K", "H", "B"):
        np.testing.assert_allclose(getattr(found, name).toarray(), getattr(dense, name), rtol=1e-15, atol=0.0)
    np.testing.assert_array_equal(found.u0, dense.u0)
    np.testing.assert_array_equal(found.restitution, dense.restitution)
    np.testing.assert_array_equal(found.f, dense.force(0.0))
    dense, found = both(elements, 1e-3, 1.0)
    assert_same(dense, found)


def test_contacts_of_a_column_at_rest_carry_the_weight_above():
    n = 20_000
    m = 10.0 ** np.random.default_rng(1).uniform(-1.0, 1.0, n)
    column = SparseScheme(Chain(n, m=m, gap=0.0, e=0.3, f=9.81 * m, b="ground"))
    run = simulate(Problem("column", column), dt=1e-3, t_end=0.01, record=["x.1", "x.R1", f"x.R{n}"])
    np.testing.assert_allclose(run.final.reaction, np.cumsum(9.81 * m), rtol=1e-11)
    assert np.abs(run.final.v).max() < 1e-9
    assert run.q.shape == (11, 1)
    assert run.reaction.shape == (10, 2)
    np.testing.assert_allclose(run[f"x.R{n}"], 9.81 * m.sum(), rtol=1e-11)


def test_an_elastic_bar_at_a_wall_has_the_force_and_the_contact_time_of_d_alembert():
    n, L, v0 = 2000, 10.0, 10.0
    E, A, rho = 900.0, 1.0, 1.0
    dx, c = L / n, np.sqrt(E / rho)
    m = np.full(n + 1, rho * A * dx)
    m[[0, -1]] /= 2.0
    bar = Chain(n + 1, m=m, k=E * A / dx, name="u")
    scheme = SparseScheme(bar, Bumper(f"u.{n + 1}", "ground", 0.0, 0.0))
    dt = 0.5 * dx / c
    problem = Problem("bar", scheme, v0=dict.fromkeys(bar.masses, v0))
    steps = round(1.2 * 2.0 * L / c / dt)
    run = simulate(problem, dt=dt, t_end=steps * dt, record=["u.1", "R"])
    R, t, end = run["R"], run.t_reaction, 2.0 * L / c
    assert run.certificate.energy_balance < 1e-9 * run.certificate.energy_scale
    exact = np.where(t < end, rho * c * A * v0, 0.0)
    assert np.abs(R - exact).sum() < 0.01 * exact.sum()
    assert np.abs(t[R > 1.0].max() - end) < 0.01 * end
    assert R.sum() * dt == pytest.approx(2.0 * rho * A * L * v0, rel=2e-3)


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_bars_and_substructures_move_as_in_a_dense_scheme(mass):
    bar = Bar("top", "bottom", E=900.0, A=1.0, rho=1.0, L=10.0, elements=40, mass=mass)
    body = Substructure(("x", "φ"), ((2.0, 0.5), (0.5, 1.0)), None, ((3.0, -1.0), (-1.0, 3.0)), (1.5, 0.0))
    bumpers = [Bumper("bottom", "ground", 0.2, 0.0), Bumper("x", {"top": 1.0, "φ": 0.5}, 0.3, 0.5)]
    dense, found = both([bar, body, *bumpers], 2e-3, 1.0, v0=dict.fromkeys(bar.joints, 3.0))
    assert_same(dense, found)
    assert (found.reaction > 0.0).any(axis=0).all()


def test_a_cradle_hands_on_the_momentum_and_keeps_it():
    """Equal balls that are apart by little hand on the velocity one by one; e = 1."""
    n = 50
    cradle = Chain(n, m=1.0, gap=1e-3, e=1.0, name="ball")
    run = simulate(Problem("cradle", SparseScheme(cradle), v0={"ball.1": 1.0}), dt=1e-4, t_end=0.1)
    np.testing.assert_allclose(run.v.sum(axis=1), 1.0, rtol=1e-12)
    np.testing.assert_allclose(run.v[-1], [0.0] * (n - 1) + [1.0], atol=1e-12)
    assert run.certificate.energy_balance < 1e-12


@pytest.mark.parametrize("exponent", [-60, -20, 20, 60])
def test_units_that_are_powers_of_two_change_no_digit(exponent):
    unit = 2.0**exponent
    runs = []
    for factor in (1.0, unit):
        chain = Chain(30, m=0.1 * factor, gap=1e-3, e=0.25, f=0.981 * factor, b="ground")
        runs.append(simulate(Problem("p", SparseScheme(chain)), dt=1e-3, t_end=0.3))
    np.testing.assert_array_equal(runs[1].q, runs[0].q)
    np.testing.assert_array_equal(runs[1].reaction, unit * runs[0].reaction)


@pytest.mark.parametrize("seed", range(4))
def test_units_are_no_matter_of_pivoting_with_sparse_factors(monkeypatch, seed):
    monkeypatch.setattr(sparse_table, "FEW", 0)
    units, runs = (1.0, 2.0**-60, 2.0**60), []
    for factor in units:
        rng = np.random.default_rng(seed)
        m, gap = factor * 10.0 ** rng.uniform(-2.0, 2.0, 30), 0.01 * rng.random(30)
        chain = Chain(30, m=m, k=1e4 * factor, c=0.5 * factor, gap=gap, e=0.3, f=9.81 * factor, b="ground")
        v0 = dict(zip(chain.masses, rng.standard_normal(30), strict=True))
        runs.append(simulate(Problem("p", SparseScheme(chain), v0=v0), dt=1e-3, t_end=0.1))
    for unit, run in zip(units, runs, strict=True):
        np.testing.assert_allclose(run.q, runs[0].q, rtol=0.0, atol=1e-11)
        np.testing.assert_allclose(run.reaction, unit * runs[0].reaction, atol=1e-8 * run.reaction.max())


@pytest.mark.parametrize("seed", range(4))
def test_masses_of_any_ratio_hold_or_are_not_called_solved(seed):
    rng = np.random.default_rng(seed)
    m = 2.0 ** rng.integers(-60, 61, 20).astype(float)
    chain = Chain(20, m=m, gap=0.0, e=0.0, f=9.81 * m, b="ground")
    _, found = both([chain], 1e-3, 0.05)
    if found.success:
        np.testing.assert_allclose(found.reaction[-1], np.cumsum(9.81 * m), rtol=1e-6)
    else:
        assert found.message


def test_ties_of_beads_that_touch_and_fall_together():
    """All gaps between the beads are zero, so all of them move as one body until the floor stops them."""
    column = Chain(100, m=0.1, gap=[0.0] * 99 + [0.05], e=0.0, f=0.981, b="ground")
    dense, found = both([column], 1e-3, 0.2)
    assert_same(dense, found)
    assert np.ptp(found.q[50]) < 1e-15


# Contacts that are no chain


def tree(rng, n):
    """Bodies in a tree, each above its parent; the root is above the ground."""
    gaps = 0.01 * rng.random(n)
    parents = ["ground" if i == 0 else f"n{rng.integers(i)}" for i in range(n)]
    elements = [Bumper(f"n{i}", parents[i], gaps[i], float(rng.random() / 2), f"R{i}") for i in range(n)]
    return [*elements, *(each for i in range(n) for each in (Mass(f"n{i}", 0.5 + rng.random()), Load(f"n{i}", 9.81)))]


@pytest.mark.parametrize("seed", range(6))
def test_trees_and_chains_with_springs_move_as_the_dense_ones(monkeypatch, seed):
    """With a full W, and by pivoting with sparse factors; A by bands, and by a sparse factor."""
    rng = np.random.default_rng(seed)
    springs = Chain(12, m=1.0, k=1e3, c=0.3, gap=0.01 * rng.random(12), e=0.25, f=9.81, b="ground")
    for elements in (tree(rng, 25), [springs]):
        v0 = {node: float(rng.standard_normal()) for node in SparseScheme(*elements).assemble().nodes}
        with monkeypatch.context() as patched:
            patched.setattr(sparse_table, "FEW", 256)
            dense, found = both(elements, 1e-3, 0.2, v0=v0)
            assert_same(dense, found)
            patched.setattr(sparse_table, "FEW", 0)
            for widest in (32, 0):
                patched.setattr(sparse_table, "WIDEST_BAND", widest)
                assert_same(dense, simulate(Problem("p", SparseScheme(*elements), v0=v0), dt=1e-3, t_end=0.2))


def test_a_bar_whose_matrix_has_no_bands_is_factored_as_a_sparse_one(monkeypatch):
    monkeypatch.setattr(sparse_table, "WIDEST_BAND", 0)
    bar = [Chain(30, m=0.1, k=1e4, f=0.981), Bumper("x.30", "ground", 0.01, 0.0)]
    assert_same(*both(bar, 1e-3, 0.3))


def test_forces_pass_straight_through_a_pile():
    """Each disc adds half its weight to both lines of contacts below it: N = (discs above on the line) m g/(2 sin 60°)."""
    rows = 24
    run = simulate(pile(rows, 2e-3), dt=1e-3, t_end=0.25, record=["y0.0"])
    found = dict(zip(run.problem.dynamics.reactions, run.final.reaction, strict=True))
    for r in range(rows):
        for i in range(rows - r):
            above = {"L": rows - r - i, "R": i + 1}
            for side, count in above.items():
                assert found[f"{side}{r}.{i}"] == pytest.approx(count * 9.81 / np.sqrt(3.0), rel=1e-9)
    assert run.stats.lcp_iterations < 2 * run.stats.steps


def test_too_few_pivots_end_the_run():
    rng = np.random.default_rng(7)
    v0 = {f"n{i}": float(rng.standard_normal()) for i in range(300)}
    problem = Problem("tree", SparseScheme(*tree(rng, 300)), v0=v0)
    assert simulate(problem, dt=1e-3, t_end=0.1).stats.lcp_iterations > 100
    run = simulate(problem, dt=1e-3, t_end=0.1, max_iter=1, throw=False)
    assert run.status is Status.MAX_ITER
    assert "stopped after step" in run.message


@pytest.mark.parametrize("seed", range(20))
def test_pivoting_finds_the_solution_of_small_problems(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 9))
    F = rng.standard_normal((n, n + 1))
    W = F @ F.T + 1e-3 * np.eye(n)
    q, active = rng.standard_normal(n), rng.random(n) < 0.8
    z = np.where(rng.random(n) < 0.5, rng.random(n), 0.0)
    A = sparse.csr_array(np.diag(1.0 + rng.random(n)))
    product = SparseProduct(sparse.csr_array(W), A, A.tocsr())
    for contacts in (SparseMatrix(sparse.csr_array(W)), product):
        found = z.copy()
        status, _, residual = pivot_contacts(contacts, q, active, found, 1e-10, 100)
        assert status is Status.SOLVED
        assert residual < 1e-12
        assert (found[~active] == 0.0).all()
        if active.any():
            exact = solve_lcp(W[np.ix_(active, active)], q[active]).z
            np.testing.assert_allclose(found[active], exact, rtol=1e-7, atol=1e-9)


def test_what_pivoting_returns_is_judged(monkeypatch):
    """A factor of another matrix gives a wrong z, which no status calls solved."""
    W = SparseMatrix(sparse.csr_array(np.diag([1.0, 2.0, 3.0])))
    monkeypatch.setattr(W, "factor", lambda free: lambda q: 0.5 * q)
    z = np.zeros(3)
    status, _, residual = pivot_contacts(W, -np.ones(3), np.ones(3, dtype=bool), z, 1e-10, 5)
    assert status is not Status.SOLVED
    assert residual > 1e-10
    singular = SparseMatrix(sparse.csr_array(np.ones((2, 2))))
    assert pivot_contacts(singular, -np.ones(2), np.ones(2, dtype=bool), np.zeros(2), 1e-10, 5)[0] is Status.SINGULAR


# What fails is said


COLUMN = SparseScheme(Chain(50, m=0.1, gap=0.0, e=0.0, f=0.981, b="ground"))


def run_with(monkeypatch, solve, scheme=COLUMN, **options):
    """Run with another contact solver; the loop runs in the interpreter."""
    tabulate = sparse_table.tabulate_sparse

    def tabulated(*arguments):
        loop = interpreted(sparse_kernel.sparse_steps, take_step=interpreted(sparse_kernel.take_step))
        return replace(tabulate(*arguments), solve=solve, loop=loop)

    monkeypatch.setattr("lcpimpact.sparse_run.tabulate_sparse", tabulated)
    return simulate(Problem("p", scheme), dt=1e-3, t_end=0.01, throw=False, **options)


def test_a_solver_that_claims_a_wrong_solution_is_found_out_by_the_laws(monkeypatch):
    def lies(contacts, z, kernel):
        z[:] = 0.0
        return int(Status.SOLVED), 1, 0.0

    run = run_with(monkeypatch, lies)
    assert run.status is Status.VIOLATED
    assert "penetrate" in run.message or "impact law" in run.message

    def pulls(contacts, z, kernel):
        z[:] = -1.0
        return int(Status.SOLVED), 1, 0.0

    run = run_with(monkeypatch, pulls)
    assert run.status is Status.VIOLATED
    assert "complementarity" in run.message


def test_a_solver_that_gives_up_ends_the_run(monkeypatch):
    run = run_with(monkeypatch, lambda contacts, z, kernel: (int(Status.MAX_ITER), 1, np.inf))
    assert run.status is Status.MAX_ITER
    assert len(run.t) == 1
    assert "step 0" in run.message
    with pytest.raises(FailureError, match="stopped after step 0"):
        simulate(Problem("p", COLUMN), dt=1e-3, t_end=0.01)


def test_pooling_without_its_answer_falls_back_to_block_pivoting(monkeypatch):
    """Where pooling leaves nonsense, block pivoting with the banded factor solves the step, and the result is the same."""
    wanted = simulate(Problem("p", COLUMN), dt=1e-3, t_end=0.01)

    def spoils(contacts, z, kernel):
        z[:] = np.linspace(3.0, 0.0, len(z))
        return sparse_kernel.solve_doubtful_chain(contacts, z)

    found = run_with(monkeypatch, spoils)
    assert found.success
    assert found.stats.lcp_iterations > 0
    np.testing.assert_allclose(found.reaction, wanted.reaction, rtol=1e-9)


def test_a_wrong_answer_of_pooling_is_checked_and_solved_again(monkeypatch):
    wanted = simulate(Problem("p", COLUMN), dt=1e-3, t_end=0.01)

    def wrong(mass, q, z, pools):
        isotonic_chain(mass, q, z, pools)
        z[:] *= 1.001
        return int(Status.SOLVED)

    found = run_with(monkeypatch, interpreted(sparse_kernel.solve_chain, isotonic_chain=wrong))
    assert found.success
    np.testing.assert_allclose(found.reaction, wanted.reaction, rtol=1e-9)


def test_the_cheap_check_of_a_chain_accepts_nothing_that_the_full_one_rejects():
    rng, accepted = np.random.default_rng(5), 0
    for trial in range(400):
        n = int(rng.integers(3, 30))
        inverse = 10.0 ** rng.uniform(-3, 3, n + 1)
        inverse[0] = rng.choice([0.0, inverse[0]])
        bands = np.array([inverse[:-1] + inverse[1:], np.append(-inverse[1:-1], 0.0)])
        mass = np.where(inverse > 0.0, 1.0 / np.where(inverse > 0.0, inverse, 1.0), np.inf)
        q, z = rng.choice([0.0, 1.0, 1e-8]) * rng.standard_normal(n), np.zeros(n)
        isotonic_chain(mass, q, z, pools_for(n))
        if trial % 2:
            z[rng.integers(n)] *= 1.0 + 10.0 ** rng.uniform(-16, -6)
        if clear_residual_of_chain(bands, q, z) == 0.0:
            accepted += 1
            scaled, _, rounding = measure(bands, q, np.zeros(n), np.full(n, np.inf), z, np.empty(n))
            assert holds(scaled, rounding, 1e-10)
    assert accepted > 100


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1.0])
def test_the_cheap_check_of_a_chain_rejects_what_is_no_solution(bad):
    bands = np.array([[2.0] * 4, [-1.0, -1.0, -1.0, 0.0]])
    z = np.ones(4)
    z[2] = bad
    assert clear_residual_of_chain(bands, -np.ones(4), z) == np.inf


# Sparse sums


def test_a_stencil_is_its_matrix():
    rng = np.random.default_rng(2)
    for rows, columns in ((1, 1), (5, 40), (3000, 9001)):
        S = sparse.random(rows, columns, density=min(0.001 + 2.0 / columns, 1.0), random_state=rng, format="csr")
        band = sparse.diags_array([np.full(rows, 2.0), rng.random(rows)], offsets=[0, 1], shape=(rows, columns))
        for matrix in (S, S + band, band.tocsr(), sparse.csr_array((rows, columns))):
            c, x, y = rng.random(rows), rng.random(columns), np.empty(rows)
            apply(stencil(matrix, c), x, y)
            np.testing.assert_allclose(y, matrix @ x + c, rtol=1e-13, atol=1e-14)


def test_banded_solves():
    rng = np.random.default_rng(3)
    for n, width in ((1, 0), (6, 2), (50, 3)):
        A = np.diag(10.0 + rng.random(n))
        for k in range(1, width + 1):
            A += np.diag(rng.random(n - k), k)
        A = np.triu(A) + np.triu(A, 1).T
        b = rng.random(n)
        x = b.copy()
        solve_banded(sparse_table.banded_factor(sparse.csr_array(A)), x)
        np.testing.assert_allclose(A @ x, b, rtol=1e-12)


# Refusals


@pytest.mark.parametrize(
    ("elements", "match"),
    [
        ([Mass("x", 1.0), Load("x", lambda t, q, v: -v)], "not Load at 'x': take Scheme"),
        ([Mass("x", 1.0), Slider("x", "ground", 1.0)], "not Slider between 'x' and 'ground' .a slider.: take Scheme"),
        ([Mass("x", 1.0), HertzSpring("x", "ground", 1.0)], "not HertzSpring between .*: take Scheme"),
        (
            [Mass("x", 1.0), Bumper("x", "z", 0.1, 0.0), Bumper("z", "ground", 0.1, 0.0), Spring("z", "ground", 1.0)],
            "impulses pass through 'z'.*give it a Mass, or take Scheme",
        ),
        (
            [Mass("x", 1.0), PrescribedMotion("y", Harmonic(1.0, 1.0)), Bumper("y", "ground", 9.0, 0.0)],
            "both sides of the bumper",
        ),
    ],
)
def test_what_sparse_steps_do_not_take(elements, match):
    Scheme(*elements).assemble()
    with pytest.raises(UnsupportedError, match=match):
        SparseScheme(*elements).assemble()


def test_bumpers_with_gaps_on_both_sides_are_not_parallel():
    SparseScheme(Chain(5, m=1.0, gap=0.1, e=0.0, a="ground", b="ground")).assemble()


@pytest.mark.parametrize(
    ("options", "error", "match"),
    [
        ({"method": "newmark-ns"}, UnsupportedError, "moreau-jean"),
        ({"rtol": 1e-6}, UnsupportedError, "without rtol"),
        ({"lcp_solver": "lemke"}, UnsupportedError, "by itself"),
        ({"record": ["x.9"]}, InputError, "x.9"),
        ({"record": "x.1"}, InputError, "sequence"),
    ],
)
def test_runs_that_are_refused(options, error, match):
    with pytest.raises(error, match=match):
        simulate(Problem("p", SparseScheme(Chain(3, m=1.0))), dt=0.1, t_end=0.1, **options)


def test_record_is_for_sparse_schemes():
    with pytest.raises(InputError, match="SparseScheme"):
        simulate(Problem("p", Scheme(Mass("x", 1.0))), dt=0.1, t_end=0.1, record=["x"])


def test_a_sparse_problem_refuses_penetration_and_unknown_nodes():
    scheme = SparseScheme(Chain(3, m=1.0, gap=0.1, e=0.0, b="ground"))
    with pytest.raises(InputError, match=r"x\.R3.*penetrated"):
        Problem("p", scheme, q0={"x.3": 0.2})
    with pytest.raises(InputError, match="node"):
        Problem("p", scheme, v0={"y": 0.2})


def test_a_sparse_run_is_saved_and_sampled(tmp_path):
    scheme = SparseScheme(Chain(3, m=1.0, gap=0.1, e=0.0, f=1.0, b="ground"))
    run = simulate(Problem("p", scheme), dt=0.1, t_end=1.0, record=["x.3", "x.R3"])
    assert run.names == ("x.3", "v_x.3", "x.R3")
    path = run.save(tmp_path / "run.csv")
    assert path.read_text(encoding="utf-8").splitlines()[0] == "t,x.3,v_x.3,t_R,x.R3"
    assert run.sample(0.05).q.shape == (1, 1)
    assert "3 nodes and 3 contacts; 1 and 1 recorded" in repr(run)
    with pytest.raises(UnsupportedError, match="sparse run"):
        run.certify()


@pytest.mark.parametrize("ending", [".npz", ".nc"])
def test_chosen_series_are_read_back_and_drawn(tmp_path, ending):
    problem = Problem("p", SparseScheme(Chain(3, m=1.0, gap=0.1, e=0.0, f=1.0, b="ground")))
    run = simulate(problem, dt=0.05, t_end=1.0, record=["x.3", "x.R2", "x.R3"])
    again = read_run(run.save(tmp_path / f"run{ending}"), problem)
    assert (type(again), again.names) == (type(run), run.names)
    for name in run.names:
        np.testing.assert_array_equal(again[name], run[name])
    assert again.certificate == run.certificate
    place, force = again.plot().axes
    np.testing.assert_array_equal(place.get_lines()[0].get_ydata(), run["x.3"])
    assert force.get_ylabel() == "mean reaction of a step [N]"
    np.testing.assert_array_equal(force.get_lines()[1].get_ydata(), run["x.R3"])
    assert run.summary().keys() == again.summary().keys() == SUMMARY.keys()
    assert all(np.isnan(value) for value in again.summary().values())
    with pytest.raises(InputError, match="the series of its run are"):
        read_run(tmp_path / f"run{ending}", Problem("p", SparseScheme(Chain(2, m=1.0))))


def test_a_run_of_all_series_has_the_summary_and_the_plot_of_the_dense_one():
    chain = Chain(3, m=1.0, gap=0.1, e=0.4, f=1.0, b="ground")
    elements = (chain, Mass("y", 1.0), Load("y", 1.0), Bumper("y", "z", 0.1), KelvinVoigt("z", "ground", 500.0, 3.0))
    dense, run = (simulate(Problem("p", kind(*elements)), dt=0.01, t_end=2.0) for kind in (Scheme, SparseScheme))
    assert [each.name for each in run.problem.dynamics.contacts] == [
        each.name for each in dense.problem.dynamics.contacts
    ]
    assert run.problem.dynamics.contacts == dense.problem.dynamics.contacts
    assert dense.summary()["impacts"] > 1.0
    for name, value in dense.summary().items():
        assert run.summary()[name] == pytest.approx(value, rel=1e-9, nan_ok=True), name
    drawn = [[line.get_ydata() for ax in each.plot().axes for line in ax.get_lines()] for each in (dense, run)]
    for ours, theirs in zip(*drawn, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-12)


def test_a_run_of_all_series_is_judged_again_from_them():
    chain = Chain(3, m=1.0, gap=0.1, e=0.4, f=1.0, b="ground")
    run = simulate(Problem("p", SparseScheme(chain)), dt=0.01, t_end=2.0)
    assert run.certify().holds
    elastic = SparseScheme(replace(chain, e=0.9))
    assert "impact law" in "; ".join(run.certify(Problem("p", elastic)).failures)
    v = run.v.copy()
    v[100, 1] += 1e-3
    assert "coordinates and velocities differ" in "; ".join(replace(run, v=v).certify().failures)


def test_what_needs_full_matrices_refuses_a_sparse_scheme(tmp_path):
    problem = Problem("p", SparseScheme(Chain(3, m=1.0, gap=0.1, e=0.0, f=1.0, b="ground")))
    run = simulate(problem, dt=0.1, t_end=1.0)
    refused = (
        lambda: penalized(problem, "hertz", k=1.0),
        lambda: write_scheme_file(problem, tmp_path / "p.toml"),
        lambda: energy_ledger(run),
        lambda: simulate(problem, "exact", dt=0.1, t_end=1.0),
        lambda: problem.dynamics.impulse_paths,
    )
    for call in refused:
        with pytest.raises((InputError, UnsupportedError)):
            call()
    assert problem.scheme != Scheme(*problem.scheme.elements)
    copy = pickle.loads(pickle.dumps(run))
    np.testing.assert_array_equal(copy.final.q, run.final.q)
    assert copy.problem.dynamics.nodes == problem.dynamics.nodes
    assert set(run.to_xarray().data_vars) >= {"x.1", "v_x.3", "x.R3"}


def test_a_contact_that_acts_at_a_distance_is_found_out(monkeypatch):
    """A step that takes open contacts for closed ones holds its beads in the air, which only the law of the gap forbids."""
    tabulate = sparse_table.tabulate_sparse

    def blind(*arguments):
        found = tabulate(*arguments)
        touching = found.table.touching
        return replace(found, table=found.table._replace(touching=touching._replace(c=touching.c - 1.0)))

    monkeypatch.setattr("lcpimpact.sparse_run.tabulate_sparse", blind)
    scheme = SparseScheme(Chain(50, m=0.1, gap=0.01, e=0.0, f=0.981, b="ground"))
    run = simulate(Problem("p", scheme), dt=1e-3, t_end=0.01, throw=False)
    assert run.status is Status.VIOLATED
    assert "complementarity" in run.message


def test_a_step_that_misses_contacts_is_found_out(monkeypatch):
    tabulate = sparse_table.tabulate_sparse

    def blind(*arguments):
        found = tabulate(*arguments)
        touching = found.table.touching
        return replace(found, table=found.table._replace(touching=touching._replace(c=touching.c + 1.0)))

    monkeypatch.setattr("lcpimpact.sparse_run.tabulate_sparse", blind)
    scheme = SparseScheme(Chain(50, m=0.1, gap=0.001, e=0.0, f=0.981, b="ground"))
    run = simulate(Problem("p", scheme), dt=1e-3, t_end=0.1, throw=False)
    assert run.status is Status.VIOLATED
    assert "impact law" in run.message


@pytest.mark.parametrize("part", ["end", "L"])
def test_a_step_with_a_wrong_coefficient_is_found_out(monkeypatch, part):
    tabulate = sparse_table.tabulate_sparse

    def off(*arguments):
        found = tabulate(*arguments)
        stencil = getattr(found.table, part)
        value = stencil.value.copy()
        value[0] *= 1.0 + 1e-5
        return replace(found, table=found.table._replace(**{part: stencil._replace(value=value)}))

    monkeypatch.setattr("lcpimpact.sparse_run.tabulate_sparse", off)
    run = simulate(Problem("p", COLUMN), dt=1e-3, t_end=0.01, throw=False)
    assert run.status in (Status.VIOLATED, Status.SOLVED)
    moving = SparseScheme(Chain(50, m=0.1, gap=0.001, e=0.5, f=0.981, b="ground"))
    run = simulate(Problem("p", moving), dt=1e-3, t_end=0.1, throw=False)
    assert run.status is Status.VIOLATED
    assert part == "end" or "impact law" in run.message


@pytest.mark.parametrize(("row", "law"), [(20, "kinematics"), (70, "momentum")])
def test_a_law_that_a_step_does_not_obey_is_named(monkeypatch, row, law):
    """Each step moves a bead too far, or adds to its velocity, by as much in all steps."""
    tabulate = sparse_table.tabulate_sparse

    def off(*arguments):
        found = tabulate(*arguments)
        end = found.table.end
        c = end.c + 1e-9 * (np.arange(100) == row)
        return replace(found, table=found.table._replace(end=end._replace(c=c)))

    monkeypatch.setattr("lcpimpact.sparse_run.tabulate_sparse", off)
    scheme = SparseScheme(Chain(50, m=0.1, k=10.0, f=0.981))
    run = simulate(Problem("p", scheme), dt=1e-3, t_end=0.1, throw=False)
    limits = run.certificate.limits
    assert run.status is Status.VIOLATED
    assert {law, "energy_balance"} <= {name for name in limits if getattr(run.certificate, name) > limits[name]}


def test_numbers_that_overflow_end_a_run():
    scheme = SparseScheme(Chain(50, m=1.0, k=1.0, f=1.0, a="ground"))
    run = simulate(Problem("p", scheme, v0={"x.50": 1e308}), dt=1e-3, t_end=0.1, throw=False)
    assert run.status is Status.NON_FINITE
    assert len(run.t) < 101


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"n": 0, "m": 1.0}, "whole number"),
        ({"n": 2}, "m is missing"),
        ({"n": 2, "m": -1.0}, "positive"),
        ({"n": 2, "m": [1.0, 1.0, 1.0]}, "2 of them"),
        ({"n": 2, "m": 1.0, "gap": 0.0}, "both gap and e"),
        ({"n": 2, "m": 1.0, "gap": 0.0, "e": 2.0}, "e must lie"),
        ({"n": 1, "m": 1.0, "k": 1.0}, "no links"),
        ({"n": 2, "m": 1.0, "a": "x.1"}, "beside its masses"),
        ({"n": 2, "m": 1.0, "a": "y", "b": "y"}, "different nodes"),
        ({"n": 2, "m": np.nan}, "not finite"),
    ],
)
def test_chains_that_are_refused(arguments, match):
    with pytest.raises(InputError, match=match):
        Chain(**arguments)


@pytest.mark.parametrize("c", [1e3, 1e5, 1e7])
def test_a_sparse_run_that_rings_on_a_strong_dashpot_is_not_solved(c):
    """At z = c h/m = 10 to 1e5 the rate of a body is thrown to and fro, where it would stop; dense steps stop it."""
    elements = li.Mass("x", 1.0), li.Dashpot("x", "ground", c=c)
    run = li.simulate(li.Problem("stop", li.SparseScheme(*elements), v0={"x": 1.0}, t_end=0.5), dt=1e-2, throw=False)
    assert run.status is li.Status.VIOLATED
    assert run.certificate.damping > 0.3
    assert "dashpots stop masses" in run.message
    assert li.simulate(li.Problem("stop", li.Scheme(*elements), v0={"x": 1.0}, t_end=0.5), dt=1e-2).success


def damped(*elements, t_end=1.0, **start):
    problem = li.Problem("damped", li.SparseScheme(*elements), t_end=t_end, **start)
    return li.simulate(problem, dt=1e-2, throw=False, error=False)


def test_what_rings_beside_a_common_velocity_is_not_solved():
    """The rate of a dashpot is thrown to and fro, whatever the bodies at its ends have in common."""
    bodies = li.Mass("x", 1.0), li.Mass("y", 1.0), li.Dashpot("x", "y", c=2e3)
    for v in ({"x": 1.0, "y": -1.0}, {"x": 6.0, "y": 4.0}):
        assert damped(*bodies, v0=v).status is li.Status.VIOLATED


@pytest.mark.parametrize("z", [10.0, 100.0, 1e4])
def test_a_body_that_follows_its_motion_is_solved_and_one_that_its_jump_throws_is_not(z):
    """The rate of a table jumps at the end of the run, where x = t all along, or in it, where x is thrown to and fro."""
    body = li.Mass("x", 1.0), li.Dashpot("d", "x", c=z / 1e-2)
    follows = damped(li.PrescribedMotion("d", li.Table([0.0, 1.0], [0.0, 1.0])), *body, v0={"x": 1.0})
    assert follows.status is li.Status.SOLVED
    assert abs(follows["x"] - follows.t).max() < 1e-10
    jump = li.PrescribedMotion("d", li.Table([0.0, 0.5, 1.0], [0.0, 0.0, 0.5]))
    assert damped(jump, *body).status is li.Status.VIOLATED


@pytest.mark.parametrize("c", [1.0, 1e2])
@pytest.mark.parametrize("load", [0.0, 5.0])
def test_dashpots_that_steps_resolve_and_bodies_that_creep_are_solved(c, load):
    """A chain that moves as a whole, and a body that creeps on a dashpot of z = 1e5 under its weight from its own rate."""
    names = [f"x{i}" for i in range(20)]
    chain = [li.Mass(name, 1.0) for name in names]
    chain += [li.KelvinVoigt(a, b, k=1e3, c=1e5) for a, b in pairwise(names)]
    chain += [li.Dashpot(names[0], "ground", c=c), li.Load(names[-1], load)]
    problem = li.Problem("together", li.SparseScheme(*chain), v0=dict.fromkeys(names, 1.0), t_end=1.0)
    assert li.simulate(problem, dt=1e-2).success
    creep = li.SparseScheme(li.Mass("x", 1.0), li.Dashpot("x", "ground", c=1e7), li.Load("x", 10.0))
    assert li.simulate(li.Problem("creep", creep, v0={"x": 1e-6}, t_end=1.0), dt=1e-2).success
