r"""Explicit Runge-Kutta methods on the reduced equations, with an LCP at each stage.

The massless coordinates are eliminated (`lcpimpact.scheme.first_order`), so

.. math:: X' = A X + B r + E s(X), \qquad u = C X + D r,

and the right side is a function of X: the reactions obey the contact law at the level of the relative degree,

.. math:: 0 \le r \perp u^{(ρ)} = O X + G r + O_s s \ge 0 ,

which is the "differential succession" of the paper's Fig. 3. At relative degree 0 all rows are active; at 1 those with u
<= 0; at 2 those with u <= 0 and U = 0. A step that violates a constraint is corrected at its end
(`lcpimpact.integrators.stepping.runge_kutta.corrections`).

The rates of non-linear dashpots at massless nodes follow from the right-hand side itself
(`lcpimpact.integrators.stepping.runge_kutta.dashpots`).

Loads are read at the instants of the stages, and may be any functions of time. General forces stand among those of the
springs, s(t, X); they are functions of Python, with which a block runs in the interpreter. "u <= 0" is meant up to rounding,
1e-12 of the largest terms of u so far.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError, Status, UnsupportedError
from lcpimpact.hybrid.grid_steps import GridMotion, Stages
from lcpimpact.hybrid.impacts import refuse_velocity_jumps
from lcpimpact.hybrid.system import System, refuse_mixed_degrees
from lcpimpact.integrators.base import Declared, Integrator, Limits
from lcpimpact.integrators.stepping.law import with_fallbacks
from lcpimpact.integrators.stepping.runge_kutta.events import happened
from lcpimpact.integrators.stepping.runge_kutta.loop import GridValues, StepBlock
from lcpimpact.integrators.stepping.runge_kutta.right_side import ACTIVE_GAP_FACTOR, ZERO_RTOL, Point, room_for
from lcpimpact.integrators.stepping.runge_kutta.run import (
    RungeKuttaRun,
    energy_metric,
    functions,
    given,
    matrices_of,
    state_forces,
    take_steps,
    write,
)
from lcpimpact.integrators.stepping.runge_kutta.tableau import Tableau
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.operators import Dense
from lcpimpact.lcp.solve import limits
from lcpimpact.lcp.solver import SolverState as Solver
from lcpimpact.problems.base import Problem
from lcpimpact.record import Grid, Record
from lcpimpact.scheme.first_order import forced_form
from lcpimpact.scheme.lagrangian import LagrangianDynamics
from lcpimpact.scheme.structure import Feature

declare = partial(
    Declared,
    order_force_jump=2,
    order_force_kink=2,
    order_impact=1,
    order_penetration=math.inf,
    level="acceleration within a step, position and velocity at its end",
    relative_degrees=(0, 1, 2),
    # All but sliders, whose force jumps as the velocity reverses.
    handles=(
        Feature.POWER_LAWS,
        Feature.DASHPOTS,
        Feature.FORCES,
        Feature.MOTIONS,
        Feature.SYSTEMS,
        Feature.MASSLESS,
        Feature.RESTITUTION,
        Feature.LAGRANGIAN,
    ),
    moving=(Feature.FRICTION, Feature.JOINTS),
    reaction_time="at t, right limit",
    energy="no bound; grows beyond the stability limit",
    dissipates=False,
)
"""Declared properties of an explicit Runge-Kutta method: the shared ones, and the arguments."""


@dataclass(frozen=True)
class ExplicitRungeKutta(Integrator):
    """An explicit Runge-Kutta method; to write one, declare it and give its tableau.

    Parameters
    ----------
    tol : float, optional
        Largest LCP residual, in units where max |W| = max |q| = 1; by default what the LCP solver declares.
    max_iter : int, optional
        Limit of LCP iterations in a stage; by default what the LCP solver declares.

    Raises
    ------
    InputError
        If tol or max_iter is not positive.

    Notes
    -----
    The reaction is the force at each instant of the grid, its right limit at an event. Impulses act at grid points, and the
    instants of the events are read between them. A step beyond the stability limit makes the motion grow without
    bound: the rate of a stiff plate, k_o/c_o, counts as well as ω.

    On a Lagrangian system, also with friction and joints, a step ends at an event, which is located in it, and the next
    leads to the next instant of the grid; see `lcpimpact.hybrid.grid_steps`.
    """

    tol: float | None = None
    max_iter: int | None = None

    narrowest: ClassVar[float] = ZERO_RTOL
    family: ClassVar[str] = "explicit Runge-Kutta"
    tableau: ClassVar[Tableau]

    def __post_init__(self) -> None:
        limits(SOLVERS["auto"], self.tol, self.max_iter)

    def limits(self) -> Limits:
        """Return the limits for contacts imposed at acceleration level, which drift within `ACTIVE_GAP_FACTOR`."""
        return replace(super().limits(), precision=1e2 * ACTIVE_GAP_FACTOR * ZERO_RTOL)

    def amplification(self, z: Array) -> Array:
        """Return the stability function of the tableau."""
        return self.tableau.amplification(z)

    def start(self, problem: Problem, grid: Grid, lcp_solver: str, record: Record) -> RungeKuttaRun | GridMotion:
        """Eliminate the massless coordinates, and write the initial values; impacts at t = 0 come before them."""
        d, solver = problem.dynamics, SOLVERS[lcp_solver]
        if isinstance(d, LagrangianDynamics):
            if self.rtol is not None:
                raise UnsupportedError(
                    f"{self.name!r} has steps of dt on a Lagrangian system, without step control: leave out rtol, or ",
                    ("event-driven",),
                )
            used = self.tableau.fixed
            stages = Stages(used.matrix, np.array(used.b), np.array(used.c))
            return GridMotion.start(problem, grid, lcp_solver, record, self.name, stages)
        form, inputs = forced_form(d, self.name)
        system = System(d, grid.t_end, form, (inputs.E, inputs.D))
        refuse_mixed_degrees(system, self.name)
        refuse_velocity_jumps(d, grid.t_end, self.name)
        matrices = matrices_of(system, inputs)
        contacts = Dense(matrices.G if len(d.contacts) else np.eye(1))
        if len(d.contacts):
            solver.check(contacts, False)
        ny, nc = form.constant, len(d.contacts)
        motion = GridValues(*(np.zeros((grid.steps + 1, size)) for size in (ny, ny, nc, nc, nc)))
        tol, max_iter = limits(solver, self.tol, self.max_iter)
        X = form.state(problem.initial_coordinates, problem.initial_velocities)
        x = np.append(X[:ny], given(form, inputs, np.array(0.0)))
        run = RungeKuttaRun(
            grid=grid, form=form, inputs=inputs, system=system, matrices=matrices, forces=state_forces(inputs),
            motion=motion, scale=np.abs(x), contacts=contacts, solver=solver.init(contacts), tol=tol, max_iter=max_iter,
            step=np.array([grid.h]), largest=np.abs(X[:ny]), energy=np.zeros(1), metric=energy_metric(d, form),
        )  # fmt: skip

        def begin(state: Solver, first: int, last: int) -> tuple[Status, int]:
            """Apply the impacts at t = 0."""
            right, _ = functions(run, state)
            end = Point(x.copy(), motion.dy[0], motion.r[0], motion.P[0], motion.since[0])
            room = room_for(matrices, 1)
            code, _, _ = right(end, matrices, run.scale, (0.0, grid.h), room, tol, max_iter, state.kernel)
            motion.y[0] = end.x[:ny]
            return Status(code), 1

        status, _ = with_fallbacks(begin, run.solver, contacts, 0, 1)
        if status is not Status.SOLVED:
            raise InputError(f"the contacts of {problem.name!r} have no reactions at the start: {status.sentence}")
        start = np.array([motion.y[0] - matrices.B @ motion.P[0], motion.y[0]])
        record.events = happened(run, np.zeros(2), GridValues(*(each[[0, 0]] for each in motion))._replace(y=start))
        write(run, record, 0, 0)
        return run

    def advance(self, carry: RungeKuttaRun | GridMotion, record: Record, first: int, last: int) -> tuple[Status, int]:
        """Take the steps of the block."""
        if isinstance(carry, GridMotion):
            return carry.advance(record, first, last)
        tableau = self.tableau.fixed
        constant = len(carry.form.signals) == 1 and not carry.inputs.loads and not carry.inputs.force_laws
        instants = carry.grid.times(0, 1) if constant else carry.grid.times(first, last)
        given = carry.given_in_steps(instants, np.array(tableau.c), carry.grid.h, tableau.b[0])
        given = np.ascontiguousarray(given)

        def run(solver: Solver, begin: int, end: int) -> tuple[Status, int]:
            part = given if constant else given[begin - first : end - first]
            h = carry.grid.h
            ahead = np.zeros((2, carry.motion.y.shape[1]))
            block = StepBlock(begin, end, h, h, part, carry.tol, carry.max_iter)
            return take_steps(carry, solver, record.stats, block, tableau, carry.motion, ahead)

        status, reached = with_fallbacks(run, carry.solver, carry.contacts, first, last)
        t = carry.grid.times(first, reached)
        closed = carry.motion.r[first : reached + 1] > 0.0
        impacts = (carry.motion.P[first + 1 : reached + 1] > 0.0) & (carry.system.degree == 2)
        assert record.events is not None
        for k in first + np.flatnonzero((impacts | (closed[1:] != closed[:-1])).any(axis=1)):
            here = t[k - first : k - first + 2]
            record.events += happened(carry, here, GridValues(*(each[k : k + 2] for each in carry.motion)))
        if status is Status.SOLVED:
            write(carry, record, first + 1, reached)
        else:
            write(carry, record, 1, reached, diverges=True)
        return status, reached
