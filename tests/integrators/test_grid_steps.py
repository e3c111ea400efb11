"""Runge-Kutta methods on Lagrangian systems: their declared orders, the laws they keep, and what they refuse."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from lagrangian_names import LAGRANGIAN
from scipy.integrate import RK23, RK45
from test_frozen_steps import bead, damped_pendulum, double_pendulum, ends, rod

import lcpimpact as li
from lcpimpact.hybrid.grid_steps import GridDense
from lcpimpact.integrators import METHODS
from lcpimpact.integrators.radau import Radau
from lcpimpact.integrators.stepping.runge_kutta.method import ExplicitRungeKutta

METHODS_OF_STAGES = [name for name, kind in METHODS.items() if issubclass(kind, ExplicitRungeKutta | Radau)]

CLASSES = {
    "bead": bead,
    "rolling": lambda: bead(mu=1.0),
    "joints": rod,
    "smooth": double_pendulum,
    "damped": damped_pendulum,
}

CHANCE = "painleve-jam"
"""Flight and jam are both solutions where its forces become singular."""


@pytest.mark.parametrize("problem", CLASSES)
@pytest.mark.parametrize("method", METHODS_OF_STAGES)
def test_declared_order_is_kept_on_curved_contacts_and_joints(method, problem):
    declared = METHODS[method].declared.order_smooth
    q = ends(CLASSES[problem](), method, [40, 80, 160])
    coarse, fine = (np.abs(a - b).max() for a, b in pairwise(q))
    assert math.log2(coarse / fine) > declared - 0.85


LITERATURE = {
    "heun": ([[0.0, 0.0], [1.0, 0.0]], [0.5, 0.5], [0.0, 1.0]),
    "ssprk3": ([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.25, 0.25, 0.0]], [1 / 6, 1 / 6, 2 / 3], [0.0, 1.0, 0.5]),
    "rk4": (
        [[0.0, 0.0, 0.0, 0.0], [0.5, 0.0, 0.0, 0.0], [0.0, 0.5, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
        [1 / 6, 1 / 3, 1 / 3, 1 / 6],
        [0.0, 0.5, 0.5, 1.0],
    ),
    "bs23": (RK23.A, RK23.B, RK23.C),
    "dopri5": (RK45.A, RK45.B, RK45.C),
}
"""a, b and c of the explicit methods: typed, or those of SciPy."""


@pytest.mark.parametrize("method", LITERATURE)
def test_steps_in_smooth_motion_are_those_of_the_literature(method):
    """Every stage counts, also where a wrong one costs less than an order on coarse grids."""
    problem = pushed_pendulum()
    d, h = problem.dynamics, 0.05

    def rate(t, X):
        M, F, *_ = d.forces_at(t, X[:2], X[2:])
        return np.concatenate([X[2:], np.linalg.solve(M, F)])

    a, b, c = (np.asarray(each) for each in LITERATURE[method])
    X = np.concatenate([problem.initial_coordinates, problem.initial_velocities])
    for k in range(20):
        K = np.zeros((len(b), len(X)))
        for i in range(len(b)):
            K[i] = rate((k + c[i]) * h, X + h * a[i, :i] @ K[:i])
        X = X + h * b @ K
    run = li.simulate(problem, method, dt=h, t_end=1.0, error=False)
    np.testing.assert_allclose(np.concatenate([run.q[-1], run.v[-1]]), X, rtol=1e-12)


def pushed_pendulum() -> li.Problem:
    """The double pendulum with a moment that depends on time."""
    still = double_pendulum().scheme
    system = li.Lagrangian(still.nodes, still.M, still.V, lambda t, q, v: np.array([np.sin(7.0 * t), 0.0]))
    return li.Problem("pushed pendulum", system, q0={"φ1": -0.8, "φ2": -0.3})


@pytest.mark.parametrize("name", LAGRANGIAN)
@pytest.mark.parametrize("method", ["dopri5", pytest.param("radau", marks=pytest.mark.slow)])
def test_registered_systems_keep_their_laws_and_facts(method, name):
    problem = li.load_problem(name)
    run = li.simulate(problem, method, dt=problem.t_end / 200, throw=False, error=False)
    assert run.success, run.message
    assert run.certificate.holds
    assert name == CHANCE or max(fact.error(run) for fact in problem.facts) < 4e-3


def test_an_impact_costs_no_order():
    """A pendulum that strikes a wall between two instants of the grid."""
    problem = li.load_problem("pendulum-and-wall")
    q = ends(problem, "rk4", [160, 320, 640, 2560])
    errors = [np.abs(each - q[-1]).max() for each in q[:-1]]
    assert math.log2(errors[0] / errors[2]) / 2.0 > 3.3


def test_positions_within_a_step_have_degree_five():
    t0, t1 = 0.3, 0.8
    quintic, cubic = np.poly1d([1.0, -2.0, 0.5, 3.0, -1.0, 0.2]), np.poly1d([2.0, -1.0, 0.3, 0.7])
    for q in (quintic, cubic):
        v, a = q.deriv(), q.deriv(2)
        ends_of_step = [(t, np.array([q(t), v(t)]), np.array([v(t), a(t)])) for t in (t0, t1)]
        dense = GridDense(*ends_of_step[0], *ends_of_step[1])
        t = np.linspace(t0, t1, 9)
        np.testing.assert_allclose(dense(t)[0], q(t), rtol=1e-13)
        assert dense(t0).tolist() == ends_of_step[0][1].tolist()
    np.testing.assert_allclose(dense(t)[1], v(t), rtol=1e-13)


def test_reactions_are_those_at_the_instants():
    for method in ("rk4", "radau"):
        run = li.simulate(bead(), method, dt=bead().t_end / 100, error=False)
        assert run.t_reaction.tolist() == run.t.tolist()
        # At the lowest point m g + m v²/R, with v² = 2 g (height).
        height = 0.9 * (1.0 - math.cos(0.6))
        assert run["bowl"][-1] == pytest.approx(9.81 + 2.0 * 9.81 * height / 0.9, rel=1e-6)


def test_step_control_is_refused_by_name():
    with pytest.raises(li.UnsupportedError, match=r"'dopri5' has steps of dt on a Lagrangian system.*'event-driven'"):
        li.simulate(double_pendulum(), "dopri5", dt=0.1, rtol=1e-6)


def test_steps_that_do_not_converge_end_the_run():
    system = li.Lagrangian("x", lambda q: np.array([[1.0]]), Q=lambda t, q, v: 1.0 / (0.5 - t) ** 2 * np.exp(q))
    run = li.simulate(li.Problem("blow-up", system), "radau", dt=0.1, t_end=1.0, throw=False, error=False)
    assert not run.success
    assert np.isfinite(run.q).all()
    assert all(b > a for a, b in pairwise(run.t))
