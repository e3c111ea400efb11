r"""The Moreau-Jean θ-step: one linear solve and one LCP a step, the same lines for relative degree 0, 1 and 2.

With w the mean velocity of the step, q⁺ = q + h w and v⁺ = v + (w - v)/θ on the nodes with mass, the balance of forces
at t_θ reads

.. math:: A w = f_θ - K q + \frac{1}{θ h} M v + H^T r, \qquad A = \frac{1}{θ h} M + C + θ h K .

Massless nodes stay unknowns. The law of a row is imposed where its relative degree puts it,

.. math:: 0 \le r \perp \frac{u^+}{h} = H w + \frac{u}{h} \ge 0 \quad (0, 1), \qquad
          0 \le r \perp θ (U^+ + e U) = H w + (θ e - (1 - θ)) U \ge 0 \quad (2),

the latter only on rows whose gap is predicted to close, u + h U/2 <= 0. With w = w_free + A⁻¹ Hᵀ r this is an LCP with
the Delassus matrix W = H A⁻¹ Hᵀ.

A slider's law stands on rates instead: -r_0 <= r <= r_0 is complementary to H w (0, 1) or to θ U⁺ (2). So the LCP has
bounds, and is otherwise the same. A system given directly, u = C x + D λ + c, is met at t_θ in the rows of D that are not
zero, as λ is a mean of the step; in the other rows u closes at its end.

A node that only springs hold has no memory, and θ = 1/2 would let it alternate about its place for ever. So after a step
the static coordinates that no closed contact and no sticking slider touches are put where the forces balance.

A node whose motion is given takes its place from that: its row of A is that of the identity. Non-linear springs are met
at t_θ by Newton's method around the LCP; see `lcpimpact.integrators.newton`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import types

from lcpimpact.arrays import Array, Indices
from lcpimpact.compiled import compiled, f8, i8, indices, interpreted, matrix, vector
from lcpimpact.errors import InputError, Status
from lcpimpact.integrators.base import SLIPS, Declared, Record
from lcpimpact.integrators.law import SPRINGS, Springs, around, examine, solve_law, tally
from lcpimpact.integrators.time_stepping import TimeStepping
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.judge import clear_residual
from lcpimpact.lcp.lapack import lu_solve
from lcpimpact.lcp.operators import Dense
from lcpimpact.lcp.problem import KERNEL
from lcpimpact.lcp.solve import limits
from lcpimpact.lcp.solver import Kernel, State
from lcpimpact.numbers import is_real
from lcpimpact.scheme.decomposition import decompose
from lcpimpact.scheme.dynamics import Dynamics, Feature

SOLVED, NON_FINITE = int(Status.SOLVED), int(Status.NON_FINITE)

MASSIVE, DRIVEN = 1, 2


@compiled(types.void(vector, vector, vector, vector, vector, matrix, matrix, matrix))
def balance_static(q: Array, r: Array, r_min: Array, r_max: Array, f: Array, S: Array, K: Array, H: Array) -> None:
    """Shift q along the columns of S that nothing holds so that Sᵀ (f - K q + Hᵀ r) = 0 there."""
    n, ns = S.shape
    free = np.empty(ns, np.int64)
    nf = 0
    for s in range(ns):
        held = False
        for i in range(len(r)):
            moved = 0.0
            for j in range(n):
                moved += H[i, j] * S[j, s]
            near = SLIPS * r_max[i] if r_max[i] < np.inf else 0.0
            held = held or (moved != 0.0 and r_min[i] + near < r[i] < r_max[i] - near)
        if not held:
            free[nf] = s
            nf += 1
    stiffness, force = np.zeros((nf, nf)), np.zeros(nf)
    for a in range(nf):
        for i in range(n):
            if S[i, free[a]] == 0.0:
                continue
            unbalanced = f[i]
            for j in range(n):
                unbalanced -= K[i, j] * q[j]
            for c in range(len(r)):
                unbalanced += H[c, i] * r[c]
            force[a] += S[i, free[a]] * unbalanced
            for b in range(nf):
                for j in range(n):
                    stiffness[a, b] += S[i, free[a]] * K[i, j] * S[j, free[b]]
    if lu_solve(stiffness, force):
        for a in range(nf):
            for i in range(n):
                q[i] += S[i, free[a]] * force[a]


@compiled(matrix(matrix, indices))
def submatrix(W: Array, rows: Indices) -> Array:
    """Return W with only these rows and columns."""
    part = np.empty((len(rows), len(rows)))
    for i in range(len(rows)):
        for j in range(len(rows)):
            part[i, j] = W[rows[i], rows[j]]
    return part


@compiled(
    types.Tuple((i8, i8, i8, i8, f8))(
        i8, i8, f8, f8, matrix, matrix, matrix, matrix, matrix, matrix, matrix, vector, vector, vector, vector, vector,
        indices, indices, matrix, matrix, matrix, matrix, matrix, matrix, matrix, matrix, f8, i8, KERNEL, SPRINGS,
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
    level: Array,
    e: Array,
    r_min: Array,
    r_max: Array,
    degree: Indices,
    kind: Indices,
    S: Array,
    K: Array,
    N: Array,
    Gs: Array,
    springs: Array,
    q: Array,
    v: Array,
    r: Array,
    tol: float,
    max_iter: int,
    solve: Kernel,
    solve_with_springs: Springs,
) -> tuple[int, int, int, int, float]:
    """Take the steps first ... last: fill q[k + 1], v[k + 1] and r[k] from q[k] and v[k].

    w_free = Pq q + Pv v + Pf, with one row of Pf (A⁻¹ f_θ) and of f (the load at the end) for each step, or one for all;
    G = A⁻¹ B and Gs = A⁻¹ Nᵀ; ``level`` (nc,) is what u is divided by time with; ``kind`` (n,) tells nodes without mass
    (0), with mass (1), and with a motion that stands in q and v already (2); S holds the static coordinates. Returns the
    status, the step reached, the sums of the LCP and Newton iterations, and the largest residual, found outside the solver.
    """
    n, nc, ns = len(kind), len(degree), len(springs)
    w, b, z, active = np.empty(n), np.empty(nc), np.zeros(nc), np.empty(nc, np.int64)
    lower, upper, gap = np.zeros(nc), np.full(nc, np.inf), np.empty(nc)
    y_free, δ, y, s = np.empty(ns), np.empty(ns), np.zeros(ns), np.zeros(ns)
    NGs = N @ Gs
    plain = True
    for i in range(nc):
        plain = plain and r_max[i] == np.inf
    iterations, newton, worst = 0, 0, 0.0
    per_θ = 1.0 / θ
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
                b[na] = U_free + u * level[i]
            elif u + 0.5 * h * U <= 0.0 or r_max[i] < np.inf:
                b[na] = U_free + (θ * e[i] - (1.0 - θ)) * U
            else:
                continue
            if not plain:
                lower[na], upper[na] = r_min[i], r_max[i]
            active[na] = i
            z[na] = r[k - 1, i] if k > 0 else 0.0
            na += 1

        status, count, tried, residual = SOLVED, 0, 0, 0.0
        if ns > 0:
            HGs, NG = np.zeros((na, ns)), np.zeros((ns, na))
            for a in range(ns):
                y_free[a], δ[a] = 0.0, -springs[a, 0]
                for j in range(n):
                    y_free[a] += N[a, j] * w[j]
                    δ[a] -= N[a, j] * q[k, j]
                    for i in range(na):
                        HGs[i, a] += H[active[i], j] * Gs[j, a]
                        NG[a, i] += N[a, j] * G[j, active[i]]
            status, count, tried, residual = solve_with_springs(
                submatrix(W, active[:na]), b[:na], lower[:na], upper[:na], z[:na], gap[:na], plain, tol, max_iter, solve,
                HGs, NG, NGs, y_free, δ, springs, θ * h, h, y, s,
            )  # fmt: skip
            for a in range(ns):
                for i in range(n):
                    w[i] += Gs[i, a] * s[a]
        elif na == nc and nc > 0:
            # The lines of solve_law: to call it costs as much as to solve one row.
            status, count = solve(W, b, lower, upper, z, tol, max_iter)
            residual = clear_residual(W, b, z, tol) if plain else np.inf
            if residual == np.inf:
                status, residual = examine(status, W, b, lower, upper, z, gap, tol)
        elif na > 0:
            status, count, residual = solve_law(
                submatrix(W, active[:na]), b[:na], lower[:na], upper[:na], z[:na], gap[:na], plain, tol, max_iter, solve
            )
        iterations += count
        newton += tried
        if status != SOLVED:
            return status, k, iterations, newton, worst
        worst = max(worst, residual)
        for a in range(na):
            r[k, active[a]] = z[a]
            for i in range(n):
                w[i] += G[i, active[a]] * z[a]

        for i in range(n):
            if kind[i] == DRIVEN:
                continue
            q[k + 1, i] = q[k, i] + h * w[i]
            v[k + 1, i] = v[k, i] + (w[i] - v[k, i]) * per_θ if kind[i] == MASSIVE else w[i]
            if not abs(q[k + 1, i]) < np.inf:
                return NON_FINITE, k, iterations, newton, worst
        if S.shape[1] > 0:
            balance_static(q[k + 1], r[k], r_min, r_max, f[p], S, K, H)
    return SOLVED, last, iterations, newton, worst


@dataclass(frozen=True)
class Step:
    """The operators of one step size: everything that a block of steps needs and no step changes."""

    h: float
    operators: tuple[Array, ...]
    loads: Callable[[Array], tuple[Array, Array]]
    constant: tuple[Array, Array] | None
    contacts: Dense
    solver: State
    around: Springs
    tol: float
    max_iter: int


@dataclass(frozen=True)
class MoreauJean(TimeStepping[Step]):
    """The θ-step with an LCP.

    Parameters
    ----------
    theta : float
        θ in (0, 1]; 1/2 is of second order and keeps the energy of smooth motion, 1 damps and is of first order.
    tol, max_iter, rtol : optional
        As of `lcpimpact.integrators.time_stepping.TimeStepping`.

    Raises
    ------
    InputError
        If θ lies outside (0, 1].

    Notes
    -----
    Velocities of massless nodes are means of the step. The reaction is the mean force that balances at t + θ h, and is
    to be read there. Where both sides of a contact have mass, the step that closes it holds an impact, whose impulse stands
    in the event and not among the reactions.
    """

    theta: float = 0.5

    name: ClassVar[str] = "moreau-jean"
    declared: ClassVar[Declared] = Declared(
        summary="θ-step with an LCP; massless nodes stay unknowns",
        order_smooth=2,
        order_force_jump=2,
        order_force_kink=2,
        order_impact=1,
        order_friction=1,
        order_penetration=1,
        level="velocity; position where r does not impact",
        relative_degrees=(0, 1, 2),
        handles=tuple(Feature),
        reaction_lives="at t + θ h, one for each step",
        energy="θ = 1/2 keeps it in smooth motion; approaching bodies never gain for 1/2 <= θ <= 1/(1 + e)",
        dissipates=True,
        source="Moreau (1988); Jean (1999); Acary and Brogliato (2008), chapter 10",
        adaptive="dt, or halved where rtol is given",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not is_real(self.theta) or not 0.0 < self.theta <= 1.0:
            raise InputError(f"theta = {self.theta!r} must lie in (0, 1]: 0.5 for second order, 1.0 for damping")

    @property
    def reaction_at(self) -> float:
        """θ."""
        return self.theta

    def balance_point(self) -> float:
        """Return θ."""
        return self.theta

    def begin(self, d: Dynamics, q: Array, v: Array, h: float) -> Array:
        """Return q and v."""
        return np.concatenate([q, v])

    def put(self, step: Step, record: Record, y: Array) -> None:
        """Write q and v."""
        record.q[0], record.v[0] = np.split(y, 2)

    def get(self, step: Step, record: Record) -> Array:
        """Return q and v."""
        return np.concatenate([record.q[1], record.v[1]])

    def prepare(self, d: Dynamics, h: float, lcp_solver: str) -> Step:
        """Factor A, and return the operators of steps of length h."""
        θ, driven, free = self.theta, d.driven, ~d.driven
        A = d.M / (θ * h) + d.C + θ * h * d.K
        columns = np.column_stack([-d.K, d.M / (θ * h), d.B, d.directions.T])
        A[driven], columns[driven] = np.eye(len(A))[driven], 0.0
        parts = np.cumsum([len(A), len(A), len(d.contacts), len(d.springs)])
        Pq, Pv, G, Gs, inverse = np.split(np.linalg.solve(A, np.column_stack([columns, np.eye(len(A))])), parts, axis=1)
        # u counts at the end of the step, or at t_θ where λ, a mean of the step, enters it; a slider's place does not count.
        level = np.where(d.D.any(axis=1), 1.0 / (θ * h), 1.0 / h)
        W = d.H @ G + level[:, None] * d.D
        level[d.slides] = 0.0

        solver = SOLVERS[lcp_solver]
        # Without contacts the kernel is never called.
        contacts = Dense(np.eye(1))
        if len(d.contacts):
            schemed = d.stores_energy and not d.springs
            contacts = Dense(W, A=A[np.ix_(free, free)], H=d.H[:, free]) if schemed else Dense(W)
            solver.check(contacts, bool(d.slides.any()))
        kind = np.select([driven, d.massive], [DRIVEN, MASSIVE], 0)
        static = decompose(d.M, d.C, driven).static
        static = static[:, ~(np.abs(d.directions) @ np.abs(static)).any(axis=0)]
        operators = tuple(
            np.array(a, order="C")
            for a in (
                *(Pq, Pv, G, W, d.H, d.u0, level, d.restitution, d.r_min, d.r_max, d.relative_degree, kind),
                *(static, d.K, d.directions, Gs, d.power_laws),
            )
        )
        tol, max_iter = limits(solver, self.tol, self.max_iter)

        def loads(t: Array) -> tuple[Array, Array]:
            """Return A⁻¹ f_θ, f_θ = (1 - θ) f(t) + θ f(t + h), and f(t + h) for steps between the instants t."""
            f = d.force(t)
            mean = (1.0 - θ) * f[:-1] + θ * f[1:]
            mean[:, driven] = np.diff(d.motion(t)[0], axis=0) / h
            return np.ascontiguousarray(mean @ inverse.T), f[1:].copy()

        constant = loads(np.array([0.0, h])) if d.constant_loads and not d.motions else None
        return Step(h, operators, loads, constant, contacts, solver.init(contacts), around(d), tol, max_iter)

    def run(self, step: Step, solver: State, record: Record, times: Array, first: int) -> tuple[Status, int]:
        """Take steps in compiled code, or in the interpreter where the solver lives there."""
        Pf, f = step.constant or step.loads(times)
        kernel: Callable[..., tuple[int, int, int, int, float]] = steps
        springs = step.around
        if not solver.compiled:
            inner = interpreted(solve_law)
            kernel, springs = interpreted(steps, solve_law=inner), interpreted(springs, solve_law=inner)
        code, reached, iterations, newton, residual = kernel(
            first, first + len(times) - 1, step.h, self.theta, Pf, f, *step.operators,
            record.q, record.v, record.reaction, step.tol, step.max_iter, solver.kernel, springs,
        )  # fmt: skip
        tally(record.stats, reached - first, iterations, residual, newton)
        return Status(code), reached
