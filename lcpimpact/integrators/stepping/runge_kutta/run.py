"""The run of an explicit Runge-Kutta method: its matrices, its states on the grid, and their coordinates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, TypeVar

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import Status
from lcpimpact.hybrid.system import System
from lcpimpact.integrators.stepping.law import solve_law
from lcpimpact.integrators.stepping.runge_kutta.corrections import end_step
from lcpimpact.integrators.stepping.runge_kutta.dashpots import Dashpots
from lcpimpact.integrators.stepping.runge_kutta.loop import GridValues, StepBlock, Weights, steps
from lcpimpact.integrators.stepping.runge_kutta.right_side import ZERO_RTOL, Matrices, room_for, spring_forces
from lcpimpact.integrators.stepping.runge_kutta.tableau import Tableau
from lcpimpact.interpreter import interpreted
from lcpimpact.lcp.operators import Dense
from lcpimpact.lcp.solver import SolverState as Solver
from lcpimpact.record import Grid, Record, Stats
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.first_order import FirstOrderForm, Inputs
from lcpimpact.scheme.signals import (
    Harmonic,
    PiecewisePolynomial,
    breaks,
    limits_at_breakpoints,
    means_in_steps,
    terms_of,
)

F = TypeVar("F", bound=Callable[..., Any])


@dataclass(frozen=True, eq=False)
class RungeKuttaRun:
    """State carried from block to block: the matrices, and the states, rates, forces and impulses on the grid.

    ``forces`` writes the forces of springs and general forces at x, as `spring_forces` does.
    """

    grid: Grid
    form: FirstOrderForm
    inputs: Inputs
    system: System
    matrices: Matrices
    forces: Callable[[Array, Matrices, Array], None]
    motion: GridValues
    scale: Array
    contacts: Dense
    solver: Solver
    tol: float
    max_iter: int
    step: Array
    largest: Array
    energy: Array
    metric: Array

    def given(self, t: Array) -> Array:
        """Return the `given` inputs at the times t, with the shape of t followed by (ng,)."""
        return given(self.form, self.inputs, t)

    def given_in_steps(self, t: Array, c: Array, h: float, first: float | None = None) -> Array:
        """Return the `given` inputs in the steps between instants, at t + c h and last at its end (steps, s + 1, ng).

        A stage at the end of a step sees the left limits of signals, all else the right ones. Of a load with breakpoints in
        the step, stages after the first, which has the weight b = ``first``, see what gives its mean with that.
        """
        found = self.given(t[:-1, None] + np.append(c, 1.0) * h)
        at = 1
        for signal in self.form.sources:
            states = 2 if isinstance(signal, Harmonic) else signal.degree + 1
            columns = slice(at, at + states)
            if isinstance(signal, PiecewisePolynomial):
                i, before, after = limits_at_breakpoints(signal, t)
                late, early = np.flatnonzero(c == 1.0), np.flatnonzero(c == 0.0)
                ends, begins = i > 0, i < len(found)
                found[i[ends, None] - 1, late, columns] = before[ends, None]
                found[i[ends] - 1, -1, columns] = after[ends]
                found[i[begins, None], early, columns] = after[begins, None]
            if first is not None and breaks(signal) and signal not in self.motions:
                k, mean = means_in_steps(signal, t)
                found[k, 1:-1, columns] = 0.0
                found[k, 1:-1, at] = ((mean - first * found[k, 0, at]) / (1.0 - first))[:, None]
            at += states
        return found

    @cached_property
    def motions(self) -> frozenset[Callable[[float], float]]:
        """The terms of the prescribed motions."""
        return frozenset(term for each in self.system.dynamics.motions.values() for term in terms_of(each))


def given(form: FirstOrderForm, inputs: Inputs, t: Array) -> Array:
    """Return the signals, the loads and, where a general force acts, t at the times t, with its shape and (ng,)."""
    functions = (*inputs.loads, float) if inputs.force_laws else inputs.loads
    loads = [[f(float(s)) for f in functions] for s in np.ravel(t)]
    return np.concatenate([form.signals_at(t), np.array(loads).reshape(*np.shape(t), len(functions))], axis=-1)


def matrices_of(system: System, inputs: Inputs) -> Matrices:
    """Return the matrices of the kernel over x = (y, signals, loads) and t, with y without the signals."""
    form, d = system.form, system.dynamics
    ny = form.constant
    ns = inputs.of_state
    slots = inputs.of_dashpots
    clock = int(len(inputs.force_laws) > 0)
    C, CA = system.derivatives[:2]

    def over(states: Array, loads: Array | None = None) -> Array:
        """Return the matrix over x with these columns of the states and the loads."""
        behind = np.zeros((len(states), len(inputs.loads))) if loads is None else loads
        return np.column_stack([states, behind, np.zeros((len(states), clock))])

    return Matrices(
        A=over(form.A, inputs.E[:, ns:])[:ny].copy(),
        B=form.B[:ny].copy(),
        E=inputs.E[:ny, :ns].copy(),
        C=over(C, inputs.D[:, ns:]),
        U=over(CA),
        O=over(system.O, system.O_w[:, ns:]),
        O_s=system.O_w[:, :ns].copy(),
        G=np.array(system.G, order="C"),
        approach=over(inputs.approach),
        rate=over(inputs.rate),
        law=inputs.law.copy(),
        dashpots=Dashpots(
            inputs.rate_laws.copy(),
            slots.start,
            over(inputs.parting, inputs.w_parting[:, ns:]),
            inputs.w_parting[:, :ns].copy(),
            inputs.r_parting.copy(),
            system.O_w[:, slots].copy(),
            inputs.E[:ny, slots].copy(),
        ),
        degree=d.relative_degree,
        e=d.restitution,
    )


def energy_metric(d: Dynamics, form: FirstOrderForm) -> Array:
    """Return G with ½ yᵀ G y the energy of springs and masses (ny, ny); zero of a system that has none."""
    ny, massive = form.constant, form.parts.massive
    G = np.zeros((ny, ny))
    if d.stores_energy:
        Q, speeds = form.Q[:, :ny], slice(ny - massive.shape[1], ny)
        G += Q.T @ d.K @ Q
        G[speeds, speeds] += massive.T @ d.M @ massive
    return G


def state_forces(inputs: Inputs) -> Callable[[Array, Matrices, Array], None]:
    """Return the function that writes the forces of springs and general forces at x; without the latter, `spring_forces`."""
    if not inputs.force_laws:
        return spring_forces

    def write(x: Array, system: Matrices, s: Array) -> None:
        """Write the forces s (ns + ng,) at x, which ends with t."""
        spring_forces(x, system, s[: len(system.law)])
        s[inputs.given :] = inputs.motion_forces(float(x[-1]), x)

    return write


def functions(run: RungeKuttaRun, solver: Solver) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Return `end_step` and `steps`, compiled or, if the solver or a force is written in Python, interpreted."""
    if solver.compiled and not run.inputs.force_laws:
        return end_step, steps
    return in_python(end_step, run.forces), in_python(steps, run.forces)


@lru_cache(maxsize=4)
def in_python(function: F, forces: Callable[[Array, Matrices, Array], None]) -> F:
    """Return a compiled function as the interpreter runs it, with the LCP solver's own kernel and the forces in it."""
    return interpreted(function, solve_law=interpreted(solve_law), spring_forces=forces)


def take_steps(
    run: RungeKuttaRun,
    solver: Solver,
    stats: Stats,
    block: StepBlock,
    tableau: Tableau,
    motion: GridValues,
    ahead: Array,
) -> tuple[Status, int]:
    """Take steps of one length, and count their cost."""
    _, step = functions(run, solver)
    weights = Weights(tableau.matrix, np.array(tableau.b), tableau.error)
    now = (np.empty(len(run.scale)), run.scale)
    room = room_for(run.matrices, tableau.stages)
    code, reached, iterations, residual = step(block, run.matrices, weights, motion, now, ahead, room, solver.kernel)
    stats.add_lcps(tableau.stages * (reached - block.first), iterations, residual)
    return Status(code), reached


def coordinates(
    run: RungeKuttaRun, t: Array, y: Array, dy: Array, r: Array, diverges: bool = False
) -> tuple[Array, Array]:
    """Return q and v (nt, n) from the states, their rates and the forces.

    A quasi-static node follows the others by its balance of forces; its velocity needs r', which keeps closed gaps closed.
    Where a run ``diverges``, the rounding of a gap is that of the states up to each instant, given from the start on.
    """
    form = run.form
    inputs = run.inputs
    system = run.system
    ns = run.inputs.of_state
    given = run.given(t)
    generator = form.A[form.constant :, form.constant :]
    nl = len(generator)
    signals = given[:, :nl]
    loads = given[:, nl : nl + len(inputs.loads)]
    X = np.column_stack([y, signals])
    rate = np.column_stack([dy, signals @ generator.T])
    Q_w, D_w = inputs.Q[:, ns:], inputs.D[:, ns:]
    q = X @ form.Q.T + r @ form.Qr.T + loads @ Q_w.T
    v = rate @ form.Q.T
    if form.Qr.any() or Q_w.any():
        δ = 1e-6 * run.grid.t_end
        dloads = (run.given(t + δ) - run.given(t - δ))[:, nl : nl + len(inputs.loads)] / (2.0 * δ)
        v += dloads @ Q_w.T
        u = X @ form.C.T + loads @ D_w.T
        du = rate @ form.C.T + dloads @ D_w.T
        size = np.abs(run.matrices.C)
        so_far = np.maximum.accumulate(np.abs(X), axis=0) if diverges else None
        tiny = ZERO_RTOL * size @ run.scale if so_far is None else ZERO_RTOL * so_far @ size.T
        closed = ((r > 0.0) | ((u <= tiny) & (du < 0.0))) & (system.degree == 0)
        for pattern in np.unique(closed, axis=0):
            rows = np.flatnonzero(pattern)
            here = (closed == pattern).all(axis=1)
            D = form.D[np.ix_(rows, rows)]
            v[here] -= np.linalg.solve(D, du[np.ix_(here, rows)].T).T @ form.Qr[:, rows].T
    return q, v


def write(run: RungeKuttaRun, record: Record, first: int, last: int, diverges: bool = False) -> None:
    """Write the grid points first ... last to the record.

    All are written anew of a run that ``diverges``: its scale has grown since, by how much depends on the length of a block
    of steps, and that on the clock.
    """
    if last >= first:
        here = slice(first, last + 1)
        y = run.motion.y[here]
        dy = run.motion.dy[here]
        r = run.motion.r[here]
        record.reaction[here] = r
        record.q[here], record.v[here] = coordinates(run, record.t[here], y, dy, r, diverges)
