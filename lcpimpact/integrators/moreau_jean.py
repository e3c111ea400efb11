r"""The Moreau-Jean θ-step: one linear solve and one LCP a step, the same lines for relative degree 0, 1 and 2.

With w the mean velocity of the step, q⁺ = q + h w and v⁺ = v + (w - v)/θ on the nodes with mass, the balance of forces
at t_θ reads

.. math:: A w = f_θ - K q + \frac{1}{θ h} M v + H^T r, \qquad A = \frac{1}{θ h} M + C + θ h K .

Massless nodes stay unknowns. The law of a row is imposed where its relative degree puts it,

.. math:: 0 \le r \perp \frac{u^+}{h} = H w + \frac{u}{h} \ge 0 \quad (0, 1), \qquad
          0 \le r \perp θ (U^+ + e U) = H w + (θ e - (1 - θ)) U \ge 0 \quad (2),

the latter only on rows whose gap is predicted to close, u + h U/2 <= 0. With w = w_free + A⁻¹ Hᵀ r this is an LCP with
the Delassus matrix W = H A⁻¹ Hᵀ.

A node that only springs hold has no memory, and θ = 1/2 would let it alternate about its place for ever. So after a step
the static coordinates that no closed contact touches are put where the springs balance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numba import types

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.compiled import compiled, f8, i8, indices, interpreted, matrix, vector
from lcpimpact.errors import InputError, Status
from lcpimpact.integrators.base import Declared, Grid, Integrator, Record
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.judge import clear_residual, holds, measure
from lcpimpact.lcp.lapack import lu_solve
from lcpimpact.lcp.operators import Dense
from lcpimpact.lcp.problem import KERNEL
from lcpimpact.lcp.solve import limits
from lcpimpact.lcp.solver import Kernel, State
from lcpimpact.numbers import is_real
from lcpimpact.problems.base import Problem
from lcpimpact.scheme.decomposition import decompose

SOLVED, INACCURATE, NON_FINITE = int(Status.SOLVED), int(Status.INACCURATE), int(Status.NON_FINITE)


@compiled(types.void(vector, vector, vector, matrix, matrix, matrix))
def balance_static(q: Array, r: Array, f: Array, S: Array, K: Array, H: Array) -> None:
    """Shift q along the columns of S that no closed contact touches so that Sᵀ (f - K q) = 0 there."""
    n, ns = S.shape
    free = np.empty(ns, np.int64)
    nf = 0
    for s in range(ns):
        held = False
        for i in range(len(r)):
            moved = 0.0
            for j in range(n):
                moved += H[i, j] * S[j, s]
            held = held or (r[i] > 0.0 and moved != 0.0)
        if not held:
            free[nf] = s
            nf += 1
    stiffness, force = np.zeros((nf, nf)), np.zeros(nf)
    for a in range(nf):
        for i in range(n):
            unbalanced = f[i]
            for j in range(n):
                unbalanced -= K[i, j] * q[j]
            force[a] += S[i, free[a]] * unbalanced
            for b in range(nf):
                for j in range(n):
                    stiffness[a, b] += S[i, free[a]] * K[i, j] * S[j, free[b]]
    if lu_solve(stiffness, force):
        for a in range(nf):
            for i in range(n):
                q[i] += S[i, free[a]] * force[a]


@compiled(
    types.UniTuple(f8, 4)(
        i8, i8, f8, f8, matrix, matrix, matrix, matrix, matrix, matrix, matrix, vector, vector, indices,
        types.boolean[::1], matrix, matrix, matrix, matrix, matrix, f8, i8, KERNEL,
    )
)  # fmt: skip
def steps(
    first: int,
    last: int,
    h: float,
    θ: float,
    Pf: Array,
    f: Array,
    Pq: Array,
    Pv: Array,
    G: Array,
    W: Array,
    H: Array,
    u0: Array,
    e: Array,
    degree: Indices,
    massive: Flags,
    S: Array,
    K: Array,
    q: Array,
    v: Array,
    r: Array,
    tol: float,
    max_iter: int,
    solve: Kernel,
) -> tuple[float, float, float, float]:
    """Take the steps first ... last: fill q[k + 1], v[k + 1] and r[k] from q[k] and v[k].

    w_free = Pq q + Pv v + Pf, with one row of Pf (A⁻¹ f_θ) and of f (the load at the end) for each step, or one for all;
    G = A⁻¹ Hᵀ; S holds the static coordinates. Returns the status, the step reached, the sum of the LCP iterations, and
    the largest residual, found outside the solver.
    """
    n, nc = len(massive), len(degree)
    w, b, z, active = np.empty(n), np.empty(nc), np.zeros(nc), np.empty(nc, np.int64)
    lower, upper, gap = np.zeros(nc), np.full(nc, np.inf), np.empty(nc)
    iterations, worst = 0, 0.0
    per_h, per_θ = 1.0 / h, 1.0 / θ
    for k in range(first, last):
        p = k - first if len(Pf) > 1 else 0
        for i in range(n):
            free = Pf[p, i]
            for j in range(n):
                free += Pq[i, j] * q[k, j] + Pv[i, j] * v[k, j]
            w[i] = free

        na = 0
        for i in range(nc):
            u, U, U_free = u0[i], 0.0, 0.0
            for j in range(n):
                u += H[i, j] * q[k, j]
                U += H[i, j] * v[k, j]
                U_free += H[i, j] * w[j]
            r[k, i] = 0.0
            if degree[i] < 2:
                b[na] = U_free + u * per_h
            elif u + 0.5 * h * U <= 0.0:
                b[na] = U_free + (θ * e[i] - (1.0 - θ)) * U
            else:
                continue
            active[na] = i
            na += 1

        for i in range(na):
            z[i] = r[k - 1, active[i]] if k > 0 else 0.0
        residual, fits = 0.0, True
        if na == nc and nc > 0:
            status, count = solve(W, b, lower, upper, z, tol, max_iter)
            residual = clear_residual(W, b, z, tol)
            if residual == np.inf:
                residual, _, rounding = measure(W, b, lower, upper, z, gap)
                fits = holds(residual, rounding, tol)
        elif na > 0:
            W_active = np.empty((na, na))
            for i in range(na):
                for j in range(na):
                    W_active[i, j] = W[active[i], active[j]]
            status, count = solve(W_active, b[:na], lower[:na], upper[:na], z[:na], tol, max_iter)
            residual = clear_residual(W_active, b[:na], z[:na], tol)
            if residual == np.inf:
                residual, _, rounding = measure(W_active, b[:na], lower[:na], upper[:na], z[:na], gap[:na])
                fits = holds(residual, rounding, tol)
        else:
            status, count = SOLVED, 0
        iterations += count
        if status != SOLVED:
            return float(status), float(k), float(iterations), worst
        if not fits:
            code = INACCURATE if residual < np.inf else NON_FINITE
            return float(code), float(k), float(iterations), worst
        worst = max(worst, residual)
        for a in range(na):
            r[k, active[a]] = z[a]
            for i in range(n):
                w[i] += G[i, active[a]] * z[a]

        for i in range(n):
            q[k + 1, i] = q[k, i] + h * w[i]
            v[k + 1, i] = v[k, i] + (w[i] - v[k, i]) * per_θ if massive[i] else w[i]
            if not abs(q[k + 1, i]) < np.inf:
                return float(NON_FINITE), float(k), float(iterations), worst
        if S.shape[1] > 0:
            balance_static(q[k + 1], r[k], f[p], S, K, H)
    return float(SOLVED), float(last), float(iterations), worst


@dataclass(frozen=True)
class Step:
    """The operators of one step size: everything that a block of steps needs and no step changes."""

    grid: Grid
    operators: tuple[Array, ...]
    loads: Callable[[Array], tuple[Array, Array]]
    constant: tuple[Array, Array] | None
    contacts: Dense
    solver: State
    tol: float
    max_iter: int


@dataclass(frozen=True)
class MoreauJean(Integrator):
    """The θ-step with an LCP.

    Parameters
    ----------
    theta : float
        θ in (0, 1]; 1/2 is of second order and keeps the energy of smooth motion, 1 damps and is of first order.
    tol : float, optional
        Largest LCP residual, in units where max |W| = max |q| = 1; by default what the LCP solver declares.
    max_iter : int, optional
        Limit of LCP iterations in a step; by default what the LCP solver declares.

    Raises
    ------
    InputError
        If θ lies outside (0, 1], or tol or max_iter is not positive.

    Notes
    -----
    Velocities of massless nodes are means of the step. The reaction is the mean force that balances at t + θ h, and is
    to be read there. Where both sides of a contact have mass, the step that closes it holds an impact, whose impulse stands
    in the event and not among the reactions.
    """

    theta: float = 0.5
    tol: float | None = None
    max_iter: int | None = None

    name: ClassVar[str] = "moreau-jean"
    declared: ClassVar[Declared] = Declared(
        summary="θ-step with an LCP; massless nodes stay unknowns",
        order_smooth=2,
        order_force_jump=2,
        order_impact=1,
        relative_degrees=(0, 1, 2),
        reaction_lives="at t + θ h, one for each step",
        energy="θ = 1/2 keeps it in smooth motion; approaching bodies never gain for 1/2 <= θ <= 1/(1 + e)",
        source="Moreau (1988); Jean (1999); Acary and Brogliato (2008), chapter 10",
    )

    def __post_init__(self) -> None:
        if not is_real(self.theta) or not 0.0 < self.theta <= 1.0:
            raise InputError(f"theta = {self.theta!r} must lie in (0, 1]: 0.5 for second order, 1.0 for damping")
        limits(SOLVERS["auto"], self.tol, self.max_iter)

    def reaction_times(self, grid: Grid) -> Array:
        """Return t_k + θ h, one for each step."""
        t = grid.times(0, grid.steps - 1)
        t += self.theta * grid.h
        return t

    def start(self, problem: Problem, grid: Grid, lcp_solver: str, record: Record) -> Step:
        """Write the initial state, and factor A once."""
        dynamics, h, θ = problem.dynamics, grid.h, self.theta
        record.q[0], record.v[0] = problem.initial_coordinates, problem.initial_velocities
        M, C, K, H = dynamics.M, dynamics.C, dynamics.K, dynamics.H
        A = M / (θ * h) + C + θ * h * K
        columns = np.column_stack([-K, M / (θ * h), H.T, np.eye(len(M))])
        Pq, Pv, G, inverse = np.split(np.linalg.solve(A, columns), np.cumsum([len(M), len(M), len(H)]), axis=1)
        W = H @ G

        solver = SOLVERS[lcp_solver]
        # Without contacts the kernel is never called.
        contacts = Dense(W, A=A, H=H) if len(H) else Dense(np.eye(1))
        if len(H):
            solver.check(contacts)
        operators = tuple(
            np.array(a, order="C")
            for a in (
                *(Pq, Pv, G, W, H, dynamics.u0, dynamics.restitution, dynamics.relative_degree, dynamics.massive),
                *(decompose(M, C).static, K),
            )
        )
        tol, max_iter = limits(solver, self.tol, self.max_iter)

        def loads(t: Array) -> tuple[Array, Array]:
            """Return A⁻¹ f_θ, f_θ = (1 - θ) f(t) + θ f(t + h), and f(t + h) for steps between the instants t."""
            f = dynamics.force(t)
            return np.ascontiguousarray(((1.0 - θ) * f[:-1] + θ * f[1:]) @ inverse.T), f[1:].copy()

        constant = loads(np.zeros(2)) if dynamics.constant_loads else None
        return Step(grid, operators, loads, constant, contacts, solver.init(contacts), tol, max_iter)

    def advance(self, carry: Step, record: Record, first: int, last: int) -> tuple[Status, int]:
        """Take the steps of the block; one whose LCP the first method did not solve is tried by those it falls back on."""
        status, reached = self._run(carry, carry.solver, record, first, last)
        while status is not Status.SOLVED:
            for name in carry.solver.fallbacks:
                again, after = self._run(carry, SOLVERS[name].init(carry.contacts), record, reached, reached + 1)
                if again is Status.SOLVED:
                    break
            else:
                return status, reached
            if after == last:
                return Status.SOLVED, last
            status, reached = self._run(carry, carry.solver, record, after, last)
        return status, reached

    def _run(self, carry: Step, solver: State, record: Record, first: int, last: int) -> tuple[Status, int]:
        """Take steps in compiled code, or in the interpreter where the solver lives there."""
        Pf, f = carry.constant or carry.loads(carry.grid.times(first, last))
        run: Callable[..., tuple[float, float, float, float]] = steps if solver.compiled else interpreted(steps)
        code, reached, iterations, residual = run(
            first, last, carry.grid.h, self.theta, Pf, f, *carry.operators,
            record.q, record.v, record.reaction, carry.tol, carry.max_iter, solver.kernel,
        )  # fmt: skip
        stats: dict[str, Any] = record.stats
        stats["lcp_solves"] = stats.get("lcp_solves", 0) + int(reached) - first
        stats["lcp_iterations"] = stats.get("lcp_iterations", 0) + int(iterations)
        stats["residual"] = max(stats.get("residual", 0.0), residual)
        return Status(int(code)), int(reached)
