"""Steps with banded equations against those by dense tables, and LCPs from a kept basis against a solver."""

from __future__ import annotations

import numpy as np
import pytest

from lcpimpact import Bar, Bumper, Load, Mass, Scheme, load_problem, simulate, solve_lcp
from lcpimpact.integrators import METHODS
from lcpimpact.integrators.moreau_jean import MoreauJean
from lcpimpact.integrators.stepping import linear_step
from lcpimpact.integrators.stepping.banded_table import DENSE
from lcpimpact.integrators.stepping.kept_basis import SMALLEST_KEPT, kept_basis, solve_from_basis
from lcpimpact.integrators.stepping.law import ContactProblem
from lcpimpact.problems.base import Problem
from lcpimpact.record import Grid

MASSIVE = ("moreau-jean", "newmark-ns", "generalized-alpha", "stormer-verlet-ns", "moreau-midpoint", "cd-lagrange")
"""Methods with one equation and with several, with memory and without, with one law and with two."""


def struck_bar() -> Problem:
    """Return a bar with mass at its contact, which a body strikes while a load pulls."""
    bar = Bar("y", "w", 900.0, 1.0, 1.0, 10.0, 40)
    scheme = Scheme(Mass("x", 10.0), Bumper("x", "y", e=0.3), bar, Load("w", lambda t: 20.0 * np.sin(3.0 * t)))
    return Problem("struck bar", scheme, v0={"x": 5.0}, t_end=0.5)


def both(problem: Problem, method: str, steps: int, monkeypatch: pytest.MonkeyPatch) -> tuple:
    """Return the run with banded equations, and that by the dense table."""
    dt = problem.t_end / steps
    banded = simulate(problem, method, dt=dt)
    problem.dynamics.memo.pop(linear_step.LinearStep, None)
    with monkeypatch.context() as patch:
        patch.setattr(linear_step, "banded_table", lambda *_: DENSE)
        dense = simulate(problem, method, dt=dt)
    problem.dynamics.memo.pop(linear_step.LinearStep, None)
    return banded, dense


@pytest.mark.parametrize("name", ["bar-impact", "bouncing-bar", "plastic-bar-impact"])
def test_registered_bars_move_as_by_dense_tables(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    banded, dense = both(load_problem(name), "moreau-jean", 1200, monkeypatch)
    assert banded.status == dense.status
    assert [each.kind for each in banded.events] == [each.kind for each in dense.events]
    for one, other in ((banded.q, dense.q), (banded.v, dense.v), (banded.reaction, dense.reaction)):
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-8 * np.abs(other).max())


@pytest.mark.parametrize("method", MASSIVE)
def test_methods_with_several_equations_move_as_by_dense_tables(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = struck_bar()
    step = METHODS[method]().prepare(problem.dynamics, 1e-3, "auto")
    assert (len(step.banded.factors) > 0) == METHODS[method].sums_alone
    banded, dense = both(problem, method, 500, monkeypatch)
    assert banded.status == dense.status
    for one, other in ((banded.q, dense.q), (banded.v, dense.v), (banded.reaction, dense.reaction)):
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-8 * np.abs(other).max())


def test_few_nodes_keep_their_dense_table() -> None:
    for name, elements in (("bar-impact", 20), ("plastic-bar-impact", 10)):
        assert not len(
            MoreauJean().prepare(load_problem(name, elements=elements).dynamics, 1e-3, "auto").banded.factors
        )
    assert len(MoreauJean().prepare(load_problem("bar-impact").dynamics, 1e-3, "auto").banded.factors) == 1


def test_many_nodes_that_are_not_joined_keep_their_dense_table_for_straight_line_code() -> None:
    scheme = Scheme(*(Mass(f"x{i}", 1.0 + i) for i in range(40)), Bumper("x0", "x1", e=0.5))
    step = MoreauJean().prepare(Problem("apart", scheme, t_end=1.0).dynamics, 1e-3, "auto")
    assert step.in_closed_form
    assert not len(step.banded.factors)


def test_a_run_has_the_same_bits_in_blocks() -> None:
    problem, integrator, grid = load_problem("plastic-bar-impact"), MoreauJean(), Grid(0.4, 800)
    whole = simulate(problem, dt=grid.h, t_end=0.4)

    d = problem.dynamics
    record = linear_step.Record(
        grid.times(0, 800),
        np.zeros_like(whole.q),
        np.zeros_like(whole.v),
        whole.t_reaction,
        np.zeros((800, len(d.contacts))),
    )
    carry = integrator.start(problem, grid, "auto", record)
    for first, last in ((0, 1), (1, 350), (350, 800)):
        integrator.advance(carry, record, first, last)
    np.testing.assert_array_equal(record.q, whole.q)
    np.testing.assert_array_equal(record.v, whole.v)


def test_a_kept_basis_solves_each_of_a_sequence_of_problems() -> None:
    rng, n, found = np.random.default_rng(7), 2 * SMALLEST_KEPT, 0
    B = rng.normal(size=(n, n))
    W, kept = B @ B.T / n + 0.2 * np.eye(n), kept_basis(n)
    lower, upper = np.full(n, -1.0), np.where(np.arange(n) % 3, 1.0, np.inf)
    q, z = rng.normal(size=n), np.zeros(n)
    for k in range(200):
        q = q + 0.05 * rng.normal(size=n)
        active = np.flatnonzero(rng.random(n) < 0.9) if k % 10 == 0 else np.arange(n)
        part = z[active]
        residual = solve_from_basis(ContactProblem(W, q, lower, upper), active, kept, part, 1e-10)
        expected = solve_lcp(W[np.ix_(active, active)], q[active], lower=lower[active], upper=upper[active]).z
        if residual < np.inf:
            found += 1
            np.testing.assert_allclose(part, expected, rtol=0.0, atol=1e-10)
        z[:] = 0.0
        z[active] = expected
    assert found > 150


def test_a_kept_basis_refuses_a_singular_pivot() -> None:
    n = 2 * SMALLEST_KEPT
    W, guess = np.ones((n, n)), np.full(n, 0.5)
    rows = ContactProblem(W, np.full(n, -1.0), np.zeros(n), np.ones(n))
    assert solve_from_basis(rows, np.arange(n), kept_basis(n), guess, 1e-10) == np.inf
    np.testing.assert_array_equal(guess, 0.5)
