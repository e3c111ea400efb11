r"""Steps that are linear in the state, the loads and the impulses: written as equations, tabulated once, run compiled.

Every quantity of such a step, q⁺ as well as the gap that decides on contact, is a sum

.. math:: q^+ = A_1 q + A_2 v + A_3 f + A_4 P + \dots

A method writes its equations with *symbols*: matrices whose columns belong to what a step starts from (q, v, what else the
method remembers, the constant 1, the loads at some instants) and to what it solves for (the impulses P of each of its
LCPs, the forces s of the non-linear springs). Then ``q + 0.5 * h * v`` is the matrix of that sum, and the rows of a law

.. math:: 0 \le P_j \perp L_j \ge 0

give its LCP: the columns of P_j are the Delassus matrix, and the rest, times what is known, is the free motion. One kernel
runs all such methods.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numba import types

from lcpimpact.arrays import Array, Flags
from lcpimpact.compiled import compiled, f8, i8, interpreted, matrix, vector
from lcpimpact.errors import InputError, Status
from lcpimpact.integrators.stepping.law import SPRINGS, Springs, solve_law
from lcpimpact.integrators.stepping.time_stepping import TimeStepping, spring_solver
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.operators import Dense
from lcpimpact.lcp.problem import KERNEL
from lcpimpact.lcp.solve import limits, solve_lcp
from lcpimpact.lcp.solver import Kernel, State
from lcpimpact.record import Record
from lcpimpact.scheme.dynamics import Dynamics

SOLVED, NON_FINITE = int(Status.SOLVED), int(Status.NON_FINITE)

cube = types.float64[:, :, ::1]

REST_GAP = 1e-6
"""A gap is read c h² further on, where the smooth forces lead from rest in a thousandth of a step, so that they close what
rounding has opened."""


class Named(dict[Any, Array]):
    """Symbols by what names them; what the method has not declared is refused by a sentence."""

    def __init__(self, declared: str, symbols: dict[Any, Array]) -> None:
        super().__init__(symbols)
        self.declared = declared

    def __missing__(self, name: Any) -> Array:
        named = (*self, name)
        raise InputError(
            f"the equations of the step use {name!r}, which the method does not declare: "
            f"declare {name!r} in {self.declared}, as {self.declared} = {named!r}"
        )


@dataclass(frozen=True, eq=False)
class Symbols:
    """What a step starts from and what it solves for, each as a matrix with one column for each number of them all.

    Attributes
    ----------
    q, v : (n, size) arrays             coordinates and velocities at t
    memory : dict                       what else the method remembers, by its name (n, size)
    one : (1, size) array               the constant 1
    loads : dict                        f(t + c h) by c (n, size)
    P : tuple of (nc, size) arrays      the impulses of each law in N s
    s : tuple of (ns, size) arrays      the forces of the non-linear springs in N, as they stand in each law
    """

    dynamics: Dynamics
    q: Array
    v: Array
    memory: Named
    one: Array
    loads: Named
    P: tuple[Array, ...]
    s: tuple[Array, ...]

    def gap(self, q: Array) -> Array:
        """Return u = H q + u0 (nc, size)."""
        return np.asarray(self.dynamics.H @ q + self.dynamics.u0[:, None] * self.one)

    def gap_rate(self, v: Array) -> Array:
        """Return U = H v (nc, size)."""
        return np.asarray(self.dynamics.H @ v)

    def push(self, impulse: Array) -> Array:
        """Return what impulses or forces of the contacts do on the nodes, Hᵀ P (n, size)."""
        return np.asarray(self.dynamics.B @ impulse)

    def force(self, c: float, q: Array, v: Array, law: int = 0) -> Array:
        """Return f(t + c h) - K q - C v + s on the nodes (n, size), with the springs' forces of the law of that number.

        Raises
        ------
        InputError
            If the method does not declare c in its ``instants``.
        """
        d = self.dynamics
        return np.asarray(self.loads[c] - d.K @ q - d.C @ v + d.directions.T @ self.s[law])


def pushed(L: Array, P: Array) -> Array:
    """Return w/W_ii - z for each row of a law with the unknown P: below zero where it pushes, above where it is open.

    Of z and w one is zero, but a solver that iterates leaves both near it.
    """
    return np.asarray(L / np.diag(L @ P.T)[:, None] - P)


@dataclass(frozen=True, eq=False)
class Law:
    """0 <= P ⟂ L >= 0 on the rows that touch; bounds instead of 0 and inf for sliders, which always do.

    Attributes
    ----------
    L : (nc, size) array                what is complementary to P
    touching : (nc, size) array         a row takes part where this is <= 0; all rows do where it is None
    springs_at : pair of (n, size)      the q and v at which the springs' forces s of this law stand
    strictly : bool                     a row takes part where ``touching`` is < 0, and not where it is 0
    weight : float or None              what a force times it is an impulse of this law, in s; None for the step h, 0 for a
                                        law in which sliders take no part
    """

    L: Array
    touching: Array | None
    springs_at: tuple[Array, Array]
    strictly: bool = False
    weight: float | None = None


@dataclass(frozen=True, eq=False)
class Step:
    """Where a step ends.

    Attributes
    ----------
    q, v : (n, size) arrays         coordinates and velocities at t + h
    impulse : (nc, size) array      the impulse of the contacts over the step in N s
    laws : tuple of Law             in the order in which they are solved; later ones may use the P and s of earlier ones
    memory : dict                   what else is remembered, by its name (n, size)
    """

    q: Array
    v: Array
    impulse: Array
    laws: tuple[Law, ...]
    memory: dict[str, Array] = field(default_factory=dict)


def solve(A: Array, b: Array) -> Array:
    """Return A⁻¹ b for symbols b (n, size)."""
    return np.asarray(np.linalg.solve(A, b))


@compiled(types.void(matrix, vector, vector))
def sum_columns(columns: Array, z: Array, result: Array) -> None:
    """Write Σ_j z_j columns[j] to the result."""
    result[:] = 0.0
    for j in range(len(z)):
        if z[j] != 0.0:
            for i in range(len(result)):
                result[i] += columns[j, i] * z[j]


@compiled(
    types.Tuple((i8, i8, i8, i8, f8))(
        i8, i8, f8, matrix, i8, i8, i8, cube, cube, types.boolean[::1], types.boolean[::1], matrix, matrix, cube, cube,
        matrix, vector, matrix, vector, matrix, matrix, matrix, matrix, f8, i8, KERNEL, SPRINGS,
    )
)  # fmt: skip
def steps(
    first: int,
    last: int,
    h: float,
    loads: Array,
    n: int,
    nc: int,
    ns: int,
    L: Array,
    touching: Array,
    everywhere: Flags,
    strictly: Flags,
    lower: Array,
    upper: Array,
    rates: Array,
    approaches: Array,
    law_of_springs: Array,
    θh: Array,
    result: Array,
    y: Array,
    guess: Array,
    q: Array,
    v: Array,
    r: Array,
    tol: float,
    max_iter: int,
    solve: Kernel,
    solve_with_springs: Springs,
) -> tuple[int, int, int, int, float]:
    """Take the steps first ... last: fill q[k + 1], v[k + 1] and r[k], and leave the state in y.

    What a step starts from and solves for stands in one vector x: the state y, the constant 1, the loads (one row of
    ``loads`` for each step, or one for all), then P and s of each law. ``L``, ``touching``, ``rates`` and ``approaches``
    hold for each law the columns of its rows, ``result`` those of the new state and of r. Returns the status, the step
    reached, the sums of the LCP and Newton iterations, and the largest residual, found outside the solver.
    """
    m, size, N, load = len(L), len(result), len(y), loads.shape[1]
    x, new = np.zeros(size), np.empty(result.shape[1])
    known = N + 1 + load
    b, touch, gap = np.empty(nc), np.empty(nc), np.empty(nc)
    z, active = np.empty(nc), np.empty(nc, np.int64)
    low, high, q_law = np.empty(nc), np.empty(nc), np.empty(nc)
    y_free, δ, rate, s = np.empty(ns), np.empty(ns), np.zeros(ns), np.zeros(ns)
    plain = True
    for i in range(nc):
        plain = plain and upper[0, i] == np.inf
    iterations, newton, worst = 0, 0, 0.0
    for k in range(first, last):
        for i in range(N):
            x[i] = y[i]
        x[N] = 1.0
        p = k - first if len(loads) > 1 else 0
        for i in range(load):
            x[N + 1 + i] = loads[p, i]
        for i in range(known, size):
            x[i] = 0.0
        for j in range(m):
            sum_columns(touching[j], x, touch)
            at_P, at_s = known + j * nc, known + m * nc + j * ns
            na = 0
            for i in range(nc):
                touches = everywhere[j] or touch[i] < 0.0 or (touch[i] == 0.0 and not strictly[j])
                if upper[j, i] > 0.0 and (touches or upper[j, i] < np.inf):
                    active[na], z[na] = i, guess[j, i]
                    low[na], high[na] = lower[j, i], upper[j, i]
                    na += 1
                guess[j, i] = 0.0
            if na + ns == 0:
                continue
            sum_columns(L[j], x, b)
            W = np.empty((na, na))
            for a in range(na):
                q_law[a] = b[active[a]]
                for c in range(na):
                    W[a, c] = L[j, at_P + active[c], active[a]]
            status, count, tried, residual = SOLVED, 0, 0, 0.0
            if ns > 0:
                sum_columns(rates[j], x, y_free)
                sum_columns(approaches[j], x, δ)
                HGs, NG, NGs = np.empty((na, ns)), np.empty((ns, na)), np.empty((ns, ns))
                for a in range(ns):
                    δ[a] += θh[j] * y_free[a]
                    rate[a] = y_free[a]
                    s[a] = 0.0
                    for c in range(na):
                        HGs[c, a] = L[j, at_s + a, active[c]]
                        NG[a, c] = rates[j, at_P + active[c], a]
                    for c in range(ns):
                        NGs[a, c] = rates[j, at_s + c, a]
                status, count, tried, residual = solve_with_springs(
                    W, q_law[:na], low[:na], high[:na], z[:na], gap[:na], plain, tol, max_iter, solve,
                    HGs, NG, NGs, y_free, δ, law_of_springs, θh[j], h, rate, s,
                )  # fmt: skip
                x[at_s : at_s + ns] = s
            elif na > 0:
                status, count, residual = solve_law(
                    W, q_law[:na], low[:na], high[:na], z[:na], gap[:na], plain, tol, max_iter, solve
                )
            iterations += count
            newton += tried
            if status != SOLVED:
                return status, k, iterations, newton, worst
            worst = max(worst, residual)
            for a in range(na):
                x[at_P + active[a]] = guess[j, active[a]] = z[a]
        sum_columns(result, x, new)
        for i in range(n):
            if not abs(new[i]) < np.inf:
                return NON_FINITE, k, iterations, newton, worst
        for i in range(N):
            y[i] = new[i]
        for i in range(n):
            q[k + 1, i], v[k + 1, i] = new[i], new[n + i]
        for i in range(nc):
            r[k, i] = new[N + i]
    return SOLVED, last, iterations, newton, worst


@dataclass(frozen=True, eq=False)
class Tabulated:
    """A step of one length: what a block of steps needs, and the state and the guesses that travel with it."""

    h: float
    sizes: tuple[int, int, int]
    tables: tuple[Array, ...]
    loads: Callable[[Array], Array]
    constant: Array | None
    y: Array
    guess: Array
    contacts: Dense
    solver: State
    springs: Springs
    tol: float
    max_iter: int


@dataclass(frozen=True)
class LinearStep(TimeStepping[Tabulated]):
    """A method whose step is linear; to write one, declare it and write `equations`."""

    laws: ClassVar[int] = 1
    """How many LCPs a step solves."""

    instants: ClassVar[tuple[float, ...]] = (1.0,)
    """The c for which the equations use the loads at t + c h."""

    remembers: ClassVar[tuple[str, ...]] = ()
    """What travels from step to step beside q and v, one vector (n,) each."""

    reaction_at: ClassVar[float] = 0.5
    """The instant in its step at which a mean force is best read."""

    @abstractmethod
    def equations(self, y: Symbols, d: Dynamics, h: float) -> Step:
        """Write one step of length h of the dynamics d, in the symbols y."""

    def remember(self, d: Dynamics, q: Array, v: Array, h: float) -> dict[str, Array]:
        """Return what is remembered at t = 0, by its name (n,)."""
        return {}

    def begin(self, d: Dynamics, q: Array, v: Array, h: float) -> Array:
        """Return q, v and what is remembered."""
        memory = self.remember(d, q, v, h)
        return np.concatenate([q, v, *(memory[name] for name in self.remembers)])

    def put(self, step: Tabulated, record: Record, y: Array) -> None:
        """Write the state."""
        step.y[:] = y

    def get(self, step: Tabulated, record: Record) -> Array:
        """Return the state."""
        return step.y.copy()

    def prepare(self, d: Dynamics, h: float, lcp_solver: str) -> Tabulated:
        """Tabulate the step."""
        symbols = self._symbols(d)
        tables = _tables(symbols, self.equations(symbols, d, h), self.remembers, d, h)

        solver = SOLVERS[lcp_solver]
        contacts = Dense(np.eye(1))
        for j, P in enumerate(symbols.P if len(d.contacts) else ()):
            W = (tables[0][j].T @ P.T).copy()
            contacts = Dense(W) if j == 0 else contacts
            solver.check(Dense(W), bool(d.slides.any()))
        tol, max_iter = limits(solver, self.tol, self.max_iter)

        def loads(t: Array) -> Array:
            """Return the loads at the instants of the steps that begin at t, side by side."""
            return np.ascontiguousarray(np.hstack([d.force(t + c * h) for c in self.instants]))

        constant = loads(np.zeros(1)) if d.constant_loads else None
        sizes = (len(d.nodes), len(d.contacts), len(d.springs))
        y, guess = np.zeros(len(symbols.q) * (2 + len(self.remembers))), np.zeros((self.laws, len(d.contacts)))
        init = solver.init(contacts)
        return Tabulated(h, sizes, tables, loads, constant, y, guess, contacts, init, spring_solver(d), tol, max_iter)

    def _symbols(self, d: Dynamics) -> Symbols:
        """Return one column for each number that a step starts from or solves for."""
        n, nc, ns = len(d.nodes), len(d.contacts), len(d.springs)
        sizes = [n] * (2 + len(self.remembers)) + [1] + [n] * len(self.instants) + [nc] * self.laws + [ns] * self.laws
        blocks = np.split(np.eye(sum(sizes)), np.cumsum(sizes)[:-1])
        q, v, *memory = blocks[: 2 + len(self.remembers)]
        one, *rest = blocks[2 + len(self.remembers) :]
        loads, P, s = np.split(np.arange(len(rest)), np.cumsum([len(self.instants), self.laws]))
        return Symbols(
            d,
            q,
            v,
            Named("remembers", dict(zip(self.remembers, memory, strict=True))),
            one,
            Named("instants", {c: rest[i] for c, i in zip(self.instants, loads, strict=True)}),
            tuple(rest[i] for i in P),
            tuple(rest[i] for i in s),
        )

    def run(self, step: Tabulated, solver: State, record: Record, times: Array, first: int) -> tuple[Status, int]:
        """Take steps in compiled code, or in the interpreter where the solver lives there."""
        loads = step.loads(times[:-1]) if step.constant is None else step.constant
        kernel: Callable[..., tuple[int, int, int, int, float]] = steps
        springs = step.springs
        if not solver.compiled:
            law = interpreted(solve_law)
            kernel, springs = interpreted(steps, solve_law=law), interpreted(springs, solve_law=law)
        code, reached, iterations, newton, residual = kernel(
            first, first + len(times) - 1, step.h, loads, *step.sizes, *step.tables, step.y, step.guess,
            record.q, record.v, record.reaction, step.tol, step.max_iter, solver.kernel, springs,
        )  # fmt: skip
        record.stats.add_lcps(self.laws * (reached - first), iterations, residual, newton)
        return Status(code), reached


def _tables(y: Symbols, step: Step, remembers: tuple[str, ...], d: Dynamics, h: float) -> tuple[Array, ...]:
    """Return what the kernel reads: the columns of each law, their bounds, those of the springs, and of the result."""
    nothing = np.zeros_like(y.P[0])
    touching = [nothing if law.touching is None else law.touching for law in step.laws]
    weights = [h if law.weight is None else law.weight for law in step.laws]
    threshold = np.where(d.slides, d.r_max, 0.0)
    unbounded = np.where(d.slides, 0.0, d.r_max)
    N, power_laws = d.directions, d.power_laws
    rates = [N @ law.springs_at[1] for law in step.laws]
    approaches = [-(N @ law.springs_at[0] + power_laws[:, :1] * y.one) for law in step.laws]
    θh = [_shared_step(-δ, rate, P, s) for δ, rate, P, s in zip(approaches, rates, y.P, y.s, strict=True)]
    result = np.vstack([step.q, step.v, *(step.memory[name] for name in remembers), step.impulse / h])

    def columns(rows: list[Array]) -> Array:
        return np.array([each.T for each in rows], order="C")

    return (
        columns([law.L for law in step.laws]),
        columns(touching),
        np.array([law.touching is None for law in step.laws]),
        np.array([law.strictly for law in step.laws]),
        np.array([-w * threshold for w in weights]),
        np.array([w * threshold + unbounded for w in weights]),
        columns(rates),
        columns(approaches),
        power_laws.copy(),
        np.array(θh),
        result.T.copy(),
    )


def smooth_force(d: Dynamics, q: Array, v: Array) -> Array:
    """Return f - K q - C v + s at t = 0, without reactions (n,)."""
    return np.asarray(d.force(0.0) - d.K @ q - d.C @ v + d.spring_force(q, v))


def first_acceleration(d: Dynamics, q: Array, v: Array, h: float) -> Array:
    """Return q'' at t = 0, with the forces of contacts that are closed and do not approach, and of sliders (n,).

    They keep the velocity after half a step, v + h/2 q'', within their laws. What approaches is left to the first impact.
    """
    F = smooth_force(d, q, v)
    u, U = d.gap(q), d.gap_rate(v)
    rows = np.flatnonzero(d.slides | ((u <= 0.0) & (U >= 0.0)))
    if len(rows):
        H, push = d.H[rows], d.B[:, rows]
        b = U[rows] + 0.5 * h * H @ np.linalg.solve(d.M, F)
        W = 0.5 * h * H @ np.linalg.solve(d.M, push)
        F = F + push @ solve_lcp(W, b, lower=d.r_min[rows], upper=d.r_max[rows]).z
    return np.asarray(np.linalg.solve(d.M, F))


def _shared_step(place: Array, rate: Array, P: Array, s: Array) -> float:
    """Return the θh with which what a law solves for moves the springs' ends: place = θh rate in the columns of P and s.

    Newton's iteration has one unknown a spring, its rate; the places follow it. A step in which they do not follow one
    another, because one is implicit and the other is not, has θh = 0 where the places are those known before.
    """
    unknown = np.vstack([P, s]).T
    moved, rates = place @ unknown, rate @ unknown
    if not moved.any():
        return 0.0
    θh = float((moved * rates).sum() / (rates * rates).sum())
    if not np.allclose(moved, θh * rates, rtol=1e-9, atol=1e-12 * np.abs(moved).max()):
        raise ValueError("the places and rates of the springs in a law must be those of one implicit step")
    return θh
