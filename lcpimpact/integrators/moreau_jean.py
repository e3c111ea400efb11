r"""The Moreau-Jean θ-step: one linear solve and one LCP a step, the same lines for relative degree 0, 1 and 2.

With w the mean velocity of the step, q⁺ = q + h w and v⁺ = v + (w - v)/θ on the nodes with mass, the balance of forces
at t_θ reads

.. math:: A w = f_θ - K q + \frac{1}{θ h} M v + H^T r, \qquad A = \frac{1}{θ h} M + C + θ h K .

Massless nodes stay unknowns. The law of a row is imposed where its relative degree puts it,

.. math:: 0 \le r \perp \frac{u^+}{h} = H w + \frac{u}{h} \ge 0 \quad (0, 1), \qquad
          0 \le r \perp θ (U^+ + e U) = H w + (θ e - (1 - θ)) U \ge 0 \quad (2),

the latter only on rows whose gap is predicted to close, u + h U/2 <= 0. With w = w_free + A⁻¹ Hᵀ r this is an LCP with
the Delassus matrix W = H A⁻¹ Hᵀ.

*Impulse paths.* On a massless plate that is stopped, rows of degree 0 and 1 together bind masses (see
`lcpimpact.scheme.impulse_paths`), and gaps that are closed at the end of the step would make v ring. So where all rows of a
path come out pushing, the LCP is solved again, and they may overlap by amounts s with

.. math:: Σ (u^+ + s) = θ h Σ (U^+ + ρ e \min(U, 0)) \ge 0,
          \qquad ρ Σ \min(U, 0) = Σ U \text{ where that is negative, else } ρ = 0,

so that together they obey Newton's law as one row of degree 2, each with its own restitution. ρ is 1 for left limits; the
rates of massless nodes, which are means of steps, are none after an impact.

A slider's law stands on rates instead: -r_0 <= r <= r_0 is complementary to H w (0, 1) or to θ U⁺ (2). So the LCP has
bounds, and is otherwise the same. A system given directly, u = C x + D λ + c, is met at t_θ in the rows of D that are not
zero, as λ is a mean of the step; in the other rows u closes at its end. Where such rows can bind x itself, as diodes without
resistance bind the voltage of a capacitor to a source, x would alternate about that for ever with θ < 1: there a step in
which rows begin or cease to push is taken with θ = 1.

A node that only springs hold has no memory, and θ = 1/2 would let it alternate about its place for ever. So after a step
the static coordinates that no closed contact and no sticking slider touches are put where the forces balance.

A node whose motion is given takes its place from that: its row of A is that of the identity. Non-linear springs are met
at t_θ by Newton's method around the LCP; see `lcpimpact.integrators.stepping.newton`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numba import types
from scipy.optimize import linprog

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.compiled import compiled, f8, flags, i8, indices, interpreted, matrix, vector
from lcpimpact.errors import InputError, Status
from lcpimpact.integrators.base import Declared
from lcpimpact.integrators.stepping.law import SPRINGS, Springs, examine, solve_law
from lcpimpact.integrators.stepping.time_stepping import TimeStepping, spring_solver
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.judge import clear_residual
from lcpimpact.lcp.lapack import lu_solve
from lcpimpact.lcp.operators import Dense
from lcpimpact.lcp.problem import KERNEL
from lcpimpact.lcp.solve import limits
from lcpimpact.lcp.solver import Kernel, State
from lcpimpact.numbers import is_real
from lcpimpact.record import SLIPS, Record
from lcpimpact.scheme.dynamics import Dynamics, Feature
from lcpimpact.scheme.signals import PiecewisePolynomial

SOLVED, NON_FINITE = int(Status.SOLVED), int(Status.NON_FINITE)
SWITCHES = -1

MASSIVE, DRIVEN = 1, 2


@compiled(matrix(matrix, indices))
def submatrix(W: Array, rows: Indices) -> Array:
    """Return W with only these rows and columns."""
    part = np.empty((len(rows), len(rows)))
    for i in range(len(rows)):
        for j in range(len(rows)):
            part[i, j] = W[rows[i], rows[j]]
    return part


@compiled(types.void(matrix, i8, matrix, matrix, i8, vector, vector, matrix, matrix, matrix, matrix, indices, vector))
def balance_static(
    q: Array, k: int, r: Array, f: Array, p: int, r_min: Array, r_max: Array, S: Array, SK: Array, SKS: Array, HS: Array,
    free: Indices, force: Array,
) -> None:  # fmt: skip
    """Shift q[k + 1] along the rows of S that nothing holds so that S (f[p] - K q[k + 1] + Hᵀ r[k]) = 0 there.

    SK = S K, SKS = S K Sᵀ and HS = H Sᵀ; ``free`` and ``force`` (ns,) are room to work in.
    """
    ns, nc = HS.shape[1], HS.shape[0]
    nf = 0
    for s in range(ns):
        held, unbalanced = False, 0.0
        for i in range(nc):
            near = SLIPS * r_max[i] if r_max[i] < np.inf else 0.0
            held = held or (HS[i, s] != 0.0 and r_min[i] + near < r[k, i] < r_max[i] - near)
            unbalanced += HS[i, s] * r[k, i]
        if not held:
            for j in range(S.shape[1]):
                unbalanced += S[s, j] * f[p, j] - SK[s, j] * q[k + 1, j]
            free[nf], force[nf] = s, unbalanced
            nf += 1
    if nf == 1 and SKS[free[0], free[0]] != 0.0:
        force[0] /= SKS[free[0], free[0]]
    elif nf == 0 or not lu_solve(submatrix(SKS, free[:nf]), force[:nf]):
        return
    for a in range(nf):
        for j in range(S.shape[1]):
            q[k + 1, j] += S[free[a], j] * force[a]


@compiled(types.boolean(matrix, types.boolean[::1], indices, vector))
def closes(lines: Array, meets: Flags, active: Indices, z: Array) -> bool:
    """Add the impulse paths to ``meets`` whose contacts all push; return whether there are any that were not in it."""
    found = False
    for a in range(len(lines)):
        if meets[a]:
            continue
        length, pushing = 0, 0
        for i in range(lines.shape[1]):
            length += lines[a, i] > 0.0
        for i in range(len(active)):
            pushing += lines[a, active[i]] > 0.0 and z[i] > 0.0
        if pushing == length:
            meets[a] = found = True
    return found


@compiled(f8(vector, vector))
def rebounding(line: Array, U: Array) -> float:
    """Return the ρ in [0, 1] by which the approaches on a path count, so that Σ ρ min(U, 0) = Σ U; 0 where it opens.

    Rates of massless nodes are means of a step: after an impact they are no left limits, but their sum cancels.
    """
    opening, approach = 0.0, 0.0
    for i in range(len(U)):
        if line[i] > 0.0:
            opening += U[i]
            approach += min(U[i], 0.0)
    return opening / approach if opening < 0.0 else 0.0


@compiled(types.void(
    matrix, types.boolean[::1], indices, matrix, vector, vector, indices, vector, vector, f8, f8, vector
))  # fmt: skip
def overlaps(
    lines: Array, meets: Flags, order: Indices, H: Array, u0: Array, e: Array, kind: Indices, q: Array, v: Array, h: float,
    θ: float, shift: Array,
) -> None:  # fmt: skip
    """Set by how much each contact may overlap at the end of the step, so that paths that meet obey the law of impact.

    Σ (u⁺ + shift) = θ h Σ (U⁺ + ρ e U) over each of these paths. Of its contacts those that come last in ``order`` take the
    sum, and the others close exactly: the rates of massless nodes, which cancel in the sum, are eliminated row by row.
    """
    n, nc = H.shape[1], len(shift)
    U, rebounds = np.zeros(nc), np.zeros(nc)
    for i in range(nc):
        for j in range(n):
            U[i] += H[i, j] * v[j]
    for a in range(len(lines)):
        if meets[a]:
            ρ = rebounding(lines[a], U)
            for i in range(nc):
                if lines[a, i] > 0.0:
                    rebounds[i] = max(rebounds[i], ρ)
    shift[:] = 0.0
    pivots, columns, count = np.zeros((n, n + 1)), np.zeros(n, np.int64), 0
    row = np.empty(n + 1)
    for i in order:
        marked = False
        for a in range(len(lines)):
            marked = marked or (meets[a] and lines[a, i] > 0.0)
        if not marked:
            continue
        u = u0[i]
        for j in range(n):
            u += H[i, j] * q[j]
            row[j] = H[i, j] if kind[j] == 0 else 0.0
        row[n] = h * (θ * e[i] * rebounds[i] * min(U[i], 0.0) - (1.0 - θ) * U[i]) - u
        for p in range(count):
            row -= row[columns[p]] * pivots[p]
        largest = int(np.argmax(np.abs(row[:n])))
        if row[largest] == 0.0:
            shift[i] = row[n]
        else:
            pivots[count], columns[count] = row / row[largest], largest
            count += 1


@compiled(
    types.Tuple((i8, i8, i8, f8))(
        i8, f8, f8, matrix, matrix, vector, indices, i8, matrix, vector, vector, vector, vector, vector, types.boolean, f8,
        i8, KERNEL, SPRINGS, matrix, matrix, matrix, matrix, matrix, matrix, vector, vector, vector, vector, matrix, flags,
        indices, vector, vector, indices, vector,
    )
)  # fmt: skip
def solve_step(
    k: int, h: float, θ: float, q: Array, v: Array, w: Array, active: Indices, na: int, W: Array, b: Array, lower: Array,
    upper: Array, z: Array, gap: Array, plain: bool, tol: float, max_iter: int, solve: Kernel, solve_with_springs: Springs,
    H: Array, G: Array, N: Array, Gs: Array, NGs: Array, springs: Array, y_free: Array, δ: Array, y: Array, s: Array,
    lines: Array, meets: Flags, order: Indices, u0: Array, e: Array, kind: Indices, shift: Array,
) -> tuple[int, int, int, float]:  # fmt: skip
    """Solve the law of step k on its ``na`` active rows, with the springs, and again while impulse paths meet in it."""
    ns, n = len(springs), len(kind)
    iterations, newton = 0, 0
    while True:
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
        else:
            status, count, residual = solve_law(
                submatrix(W, active[:na]), b[:na], lower[:na], upper[:na], z[:na], gap[:na], plain, tol, max_iter, solve
            )
            tried = 0
        iterations, newton = iterations + count, newton + tried
        if status != SOLVED or not closes(lines, meets, active[:na], z):
            meets[:], shift[:] = False, 0.0
            return status, iterations, newton, residual
        for a in range(na):
            b[a] -= shift[active[a]] / h
        overlaps(lines, meets, order, H, u0, e, kind, q[k], v[k], h, θ, shift)
        for a in range(na):
            b[a] += shift[active[a]] / h


@compiled(
    types.Tuple((i8, i8, i8, i8, f8))(
        i8, i8, f8, f8, matrix, matrix, matrix, matrix, matrix, matrix, matrix, vector, vector, vector, vector, vector,
        indices, indices, matrix, indices, matrix, matrix, matrix, matrix, matrix, matrix, matrix, matrix, matrix, matrix,
        f8, i8, KERNEL, SPRINGS, types.boolean,
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
    lines: Array,
    order: Indices,
    S: Array,
    SK: Array,
    SKS: Array,
    HS: Array,
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
    stops: bool,
) -> tuple[int, int, int, int, float]:
    """Take the steps first ... last: fill q[k + 1], v[k + 1] and r[k] from q[k] and v[k].

    w_free = Pq q + Pv v + Pf, with one row of Pf (A⁻¹ f_θ) and of f (the load at the end) for each step, or one for all;
    G = A⁻¹ B and Gs = A⁻¹ Nᵀ; ``level`` (nc,) is what u is divided by time with; ``kind`` (n,) tells nodes without mass
    (0), with mass (1), and with a motion that stands in q and v already (2); ``lines`` (np, nc) are the impulse paths over
    massless nodes, and ``order`` (nc,) is that of `overlaps`; the rows of S are the static coordinates, with the products
    of `balance_static`. With ``stops`` the status is SWITCHES where other rows push than in the step before, and that step
    is not taken. Returns the status, the step reached, the sums of the LCP and Newton iterations, and the largest residual,
    found outside the solver.
    """
    n, nc, ns = len(kind), len(degree), len(springs)
    w, b, z, active = np.empty(n), np.empty(nc), np.zeros(nc), np.empty(nc, np.int64)
    lower, upper, gap = np.zeros(nc), np.full(nc, np.inf), np.empty(nc)
    y_free, δ, y, s = np.empty(ns), np.empty(ns), np.zeros(ns), np.zeros(ns)
    nl = len(lines)
    meets, shift = np.zeros(nl, np.bool_), np.zeros(nc)
    free_static, force_static = np.empty(len(S), np.int64), np.empty(len(S))
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
        if na == nc > 0 and ns == 0 and nl == 0:
            # The lines of solve_law: to call it costs as much as to solve one row.
            status, count = solve(W, b, lower, upper, z, tol, max_iter)
            residual = clear_residual(W, b, z, tol) if plain else np.inf
            if residual == np.inf:
                status, residual = examine(status, W, b, lower, upper, z, gap, tol)
        elif na + ns > 0:
            status, count, tried, residual = solve_step(
                k, h, θ, q, v, w, active, na, W, b, lower, upper, z, gap, plain, tol, max_iter, solve, solve_with_springs,
                H, G, N, Gs, NGs, springs, y_free, δ, y, s, lines, meets, order, u0, e, kind, shift,
            )  # fmt: skip
        iterations += count
        newton += tried
        if status != SOLVED:
            return status, k, iterations, newton, worst
        if stops:
            switches = k == 0
            for a in range(na):
                switches = switches or (z[a] > 0.0) != (r[k - 1, active[a]] > 0.0)
            if switches:
                return SWITCHES, k, iterations, newton, worst
        worst = max(worst, residual)
        for a in range(ns):
            for i in range(n):
                w[i] += Gs[i, a] * s[a]
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
        if len(S) > 0:
            balance_static(q, k, r, f, p, r_min, r_max, S, SK, SKS, HS, free_static, force_static)
    return SOLVED, last, iterations, newton, worst


@dataclass(frozen=True)
class Step:
    """The operators of one step size: everything that a block of steps needs and no step changes.

    ``implicit`` is the step with θ = 1, where a system asks for it when rows begin or cease to push.
    """

    h: float
    θ: float
    implicit: Step | None
    operators: tuple[Array, ...]
    loads: Callable[[Array], tuple[Array, Array]]
    constant: tuple[Array, Array] | None
    contacts: Dense
    solver: State
    springs: Springs
    tol: float
    max_iter: int


@dataclass(frozen=True)
class MoreauJean(TimeStepping[Step]):
    """The θ-step with an LCP.

    Parameters
    ----------
    theta : float
        θ in [1/2, 1]; 1/2 is of second order and keeps the energy of smooth motion, 1 damps and is of first order.
    tol, max_iter, rtol : optional
        As of `lcpimpact.integrators.stepping.time_stepping.TimeStepping`.

    Raises
    ------
    InputError
        If θ lies outside [1/2, 1]: an undamped vibration ω grows in each step by the factor
        sqrt((1 + (1 - θ)² ω² h²)/(1 + θ² ω² h²)), which is above 1 for θ < 1/2 however small h is.

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
        balances_energy=True,
        dissipates=True,
        source="Moreau (1988); Jean (1999); Acary and Brogliato (2008), chapter 10",
        adaptive="dt, or halved where rtol is given",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not is_real(self.theta) or not 0.5 <= self.theta <= 1.0:
            raise InputError(
                f"theta = {self.theta!r} must lie in [0.5, 1]: 0.5 for second order, 1.0 for damping; below 0.5 vibrations "
                "grow at every dt"
            )

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
        # Along an impulse path the contacts at a mass close exactly, and those at the ground overlap.
        order = np.argsort(-np.abs(d.H[:, d.massive]).sum(axis=1), kind="stable")
        static = d.decomposition.static
        static = static[:, ~(np.abs(d.directions) @ np.abs(static)).any(axis=0)]
        operators = tuple(
            np.array(a, order="C")
            for a in (
                *(Pq, Pv, G, W, d.H, d.u0, level, d.restitution, d.r_min, d.r_max, d.relative_degree, kind),
                *(d.impulse_lines, order, static.T, static.T @ d.K, static.T @ d.K @ static, d.H @ static),
                *(d.directions, Gs, d.power_laws),
            )
        )
        tol, max_iter = limits(solver, self.tol, self.max_iter)
        struck = (d.H[d.relative_degree == 2] != 0.0).any(axis=0)
        kinked = [
            (k, i, motion)
            for k, (i, motion) in enumerate(sorted(d.motions.items()))
            if struck[i] and isinstance(motion, PiecewisePolynomial)
        ]

        def loads(t: Array) -> tuple[Array, Array]:
            """Return A⁻¹ f_θ, f_θ = (1 - θ) f(t) + θ f(t + h), and f(t + h) for steps between the instants t."""
            f = d.force(t)
            with np.errstate(invalid="ignore"):  # the step says what is not finite
                mean = (1.0 - θ) * f[:-1] + θ * f[1:]
                y, rate = d.motion(t)
                mean[:, driven] = np.diff(y, axis=0) / h
                for k, i, motion in kinked:
                    # Where y' jumps in a step, U⁺ of its impacts is that with y' at its end.
                    steps = np.searchsorted(t, motion.breakpoints(t[0], t[-1])) - 1
                    mean[steps, i] = (1.0 - θ) * rate[steps, k] + θ * rate[steps + 1, k]
                return np.ascontiguousarray(mean @ inverse.T), f[1:].copy()

        constant = loads(np.array([0.0, h])) if d.constant_loads and not d.motions else None
        implicit = replace(self, theta=1.0).prepare(d, h, lcp_solver) if θ < 1.0 and can_jump(d) else None
        return Step(
            h, θ, implicit, operators, loads, constant, contacts, solver.init(contacts), spring_solver(d), tol, max_iter
        )

    def run(self, step: Step, solver: State, record: Record, times: Array, first: int) -> tuple[Status, int]:
        """Take steps of θ, and in a system that can jump those with θ = 1 in which rows begin or cease to push."""
        k, last = first, first + len(times) - 1
        while k < last:
            code, k = self._steps(step, solver, record, times[k - first :], k, step.implicit is not None)
            if code == SWITCHES and step.implicit:
                code, k = self._steps(step.implicit, solver, record, times[k - first : k - first + 2], k, False)
            if code != SOLVED:
                return Status(code), k
        return Status.SOLVED, last

    def _steps(
        self, step: Step, solver: State, record: Record, times: Array, first: int, stops: bool
    ) -> tuple[int, int]:
        """Take steps in compiled code, or in the interpreter where the solver lives there."""
        Pf, f = step.constant or step.loads(times)
        kernel: Callable[..., tuple[int, int, int, int, float]] = steps
        springs = step.springs
        if not solver.compiled:
            law = interpreted(solve_law)
            kernel, springs = interpreted(steps, solve_law=law), interpreted(springs, solve_law=law)
        code, reached, iterations, newton, residual = kernel(
            first, first + len(times) - 1, step.h, step.θ, Pf, f, *step.operators,
            record.q, record.v, record.reaction, step.tol, step.max_iter, solver.kernel, springs, stops,
        )  # fmt: skip
        record.stats.add_lcps(reached - first, iterations, residual, newton)
        return code, reached


def can_jump(d: Dynamics) -> bool:
    """Return whether rows with D ≠ 0 can take impulses, p >= 0 with D p >= 0 and (D + Dᵀ) p = 0.

    Their u = 0 binds x; met at t_θ with θ < 1, x would alternate about that binding for ever.
    """
    direct, symmetric = d.D.any(axis=1), d.D + d.D.T
    if not direct.any():
        return False
    if np.linalg.eigvalsh(symmetric)[0] < -1e-12 * np.abs(d.D).max():
        return True
    found = linprog(-direct.astype(float), -d.D, np.zeros(len(d.D)), symmetric, np.zeros(len(d.D)), (0.0, 1.0))
    return bool(found.fun < -1e-9)
