r"""Steps that are linear in the state, the loads and the impulses: written as equations, tabulated once, run compiled.

Every quantity of such a step, q⁺ as well as the gap that activates a contact, is a sum

.. math:: q^+ = A_1 q + A_2 v + A_3 f + A_4 P + \dots

A method writes its equations with *symbols*: matrices whose columns belong to the knowns of a step (q, v, other memory of
the method, the constant 1, the loads at some instants) and to its unknowns (the impulses P of each of its LCPs, the forces s
of the non-linear springs and of any other kind). Then ``q + 0.5 * h * v`` is the matrix of that sum, and the rows of a law

.. math:: 0 \le P_j \perp L_j \ge 0

give its LCP: the columns of P_j are the Delassus matrix, and the others, times the knowns, the free motion. One kernel runs
all such methods.
"""

from __future__ import annotations

import sys
from abc import abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypeVar

import numpy as np
from scipy import sparse

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.compiled import COMPILING, call_with
from lcpimpact.errors import InputError, Status
from lcpimpact.integrators.printed.step import MAX_TERMS, covers, pattern
from lcpimpact.integrators.stepping.banded_table import DENSE, BandedTable, banded_table
from lcpimpact.integrators.stepping.features import no_features, solve_features, solve_kept_rows
from lcpimpact.integrators.stepping.force_newton import solve_with_forces
from lcpimpact.integrators.stepping.frozen import UNSYMMETRIC, FrozenSteps, MovingStep, in_python
from lcpimpact.integrators.stepping.impulse_paths import Paths, no_paths
from lcpimpact.integrators.stepping.kept_basis import kept_basis
from lcpimpact.integrators.stepping.kernel import (
    IRREGULAR,
    SWITCHES,
    UNWATCHED,
    Block,
    FeaturedSolver,
    StaticFriction,
    StepOutput,
    StepSprings,
    StepState,
    StepTable,
    Watched,
    Ways,
    room_for,
    steps,
)
from lcpimpact.integrators.stepping.law import SpringSolver, fallback_solvers, no_springs
from lcpimpact.integrators.stepping.static_balance import Static, no_static
from lcpimpact.integrators.stepping.strong_dashpots import blows
from lcpimpact.integrators.stepping.time_stepping import SteppingRun, TimeStepping
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.friction import ANITESCU_POTRA, FORMULATIONS, GLOCKER, FrictionRows, friction_maps, lcp_matrix
from lcpimpact.lcp.operators import Dense
from lcpimpact.lcp.solve import limits, solve_lcp
from lcpimpact.lcp.solver import SolverState
from lcpimpact.numerics.elimination import MAX_ROWS, product, solve
from lcpimpact.record import Record
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.lagrangian import FrozenDynamics, LagrangianDynamics, MotionRows
from lcpimpact.scheme.signals import breaks, jumps, limits_at
from lcpimpact.scheme.sparse_dynamics import SparseDynamics
from lcpimpact.scheme.structure import Feature

if TYPE_CHECKING:
    from lcpimpact.integrators.printed.straight_line import StraightLine

F = TypeVar("F", bound=Callable[..., Any])
K = TypeVar("K", bound=str | float)

AT_VELOCITY_LEVEL = (
    Feature.SLIDERS,
    Feature.POWER_LAWS,
    Feature.RESTITUTION,
    Feature.FRICTION,
    Feature.STATIC_FRICTION,
    Feature.JOINTS,
    Feature.LAGRANGIAN,
)
"""Features that a step handles whose law is at velocity level, with masses at all nodes."""

FEW_LEFT = 32
"""Number of steps that straight-line code may leave to the kernel, in a block and of which it may leave one."""

DRIFT_FACTOR = 0.5
"""Opening below which a curved contact of a Lagrangian system that has just pushed is closed, in the same units."""

REST_GAP_FACTOR = 1e-6
"""Opening below which a resting contact is closed, as a fraction of the displacement that its force causes in a step."""


class Named(dict[K, Array]):
    """Symbols by name; an undeclared one is refused with a message."""

    def __init__(self, declared: str, symbols: dict[K, Array]) -> None:
        super().__init__(symbols)
        self.declared = declared

    def __missing__(self, name: K) -> Array:
        named = (*self, name)
        raise InputError(
            f"the equations of the step use {name!r}, which the method does not declare: "
            f"declare {name!r} in {self.declared}, as {self.declared} = {named!r}"
        )


@dataclass(frozen=True, eq=False)
class Prescribed:
    """Position and velocity at t + h of nodes with prescribed motion, and the mean rate; 0 of others (n, size)."""

    place: Array
    rate: Array
    mean_rate: Array


@dataclass(frozen=True, eq=False)
class Symbols:
    """The knowns and unknowns of a step, each as a matrix with one column for each of their components; see `LinearStep`.

    The matrices have the format of those of the dynamics: full, or compressed rows.

    Attributes
    ----------
    q, v : (n, size) arrays             coordinates and velocities at t
    memory : dict                       other memory of the method, by name (n, size)
    one : (1, size) array               the constant 1
    loads : dict                        f(t + c h) by c (n, size): at c = 0 the right limit and at c = 1 the left one
    jump : (n, size) array              the jump of the loads at t, or where the method asks for it
    prescribed : Prescribed             places and rates of the nodes whose motion is prescribed
    P : tuple of (nc, size) arrays      the impulses of each law in N s
    s : tuple of (ns, size) arrays      the forces of the non-linear springs, then the general forces, in N, in each law
    held : (nu, size) array             the sampled forces, which are among the loads too
    w : tuple of (n, size) arrays       the solutions of the first equations A w = b, where they are kept as unknowns
    equations : list of (A, b)          those solved so far
    moving : MovingStep                 of a Lagrangian system what holds elsewhere than the forces of the dynamics
    """

    dynamics: Dynamics
    q: Array
    v: Array
    memory: Named[str]
    one: Array
    loads: Named[float]
    jump: Array
    prescribed: Prescribed
    P: tuple[Array, ...]
    s: tuple[Array, ...]
    w: tuple[Array, ...] = ()
    held: Array | None = None
    equations: list[tuple[Array, Array]] = field(default_factory=list)
    moving: MovingStep | None = None

    def solve(self, A: Array, b: Array) -> Array:
        """Return w with A w = b (n, size): A⁻¹ b, or the unknown w where it is kept as one and A is not diagonal."""
        if not isinstance(A, np.ndarray) and not (A - sparse.diags_array(A.diagonal())).count_nonzero():
            return sparse.diags_array(1.0 / A.diagonal()) @ b
        self.equations.append((A, b))
        kept = len(self.equations) <= len(self.w)
        return self.w[len(self.equations) - 1] if kept else solve(A, b)

    def column(self, values: Array) -> Array:
        """Return constants as symbols (n, size)."""
        dense = isinstance(self.one, np.ndarray)
        return values[:, None] * self.one if dense else sparse.csr_array(values[:, None]) @ self.one

    def gap(self, q: Array, before_end: float = 0.0) -> Array:
        """Return u = H q + u0 (nc, size); that of a gap that moves by itself some time before the end of the step."""
        d = self.dynamics
        u = times(d.H, q) + self.column(d.u0)
        return u - before_end * self.column(d.chi) if before_end and (d.chi.dtype == object or d.chi.any()) else u

    def gap_rate(self, v: Array) -> Array:
        """Return U = H v + χ (nc, size)."""
        U, χ = self.rate_change(v), self.rows.chi
        return U + self.column(χ) if χ.dtype == object or χ.any() else U

    def rate_change(self, v: Array) -> Array:
        """Return H v, the change of U by a change v of the velocities (nc, size)."""
        return times(self.rows.H, v)

    @property
    def rows(self) -> Dynamics | MotionRows:
        """The rows of the laws: of a Lagrangian system those where the laws hold."""
        return self.moving.law if self.moving else self.dynamics

    @property
    def start(self) -> Symbols:
        """The symbols with the masses, forces and rows of a Lagrangian system where the step starts."""
        if self.moving is None:
            return self
        d = self.moving.start()
        loads = Named("instants", dict.fromkeys(self.loads, self.column(d.force(0.0))))
        return replace(self, dynamics=d, loads=loads, moving=None)

    @property
    def end(self) -> Symbols:
        """The symbols with the rows of a Lagrangian system where the step ends, for laws that hold later."""
        return replace(self, moving=None) if self.moving else self

    @property
    def first_rate(self) -> Array:
        """U at the start of the step (nc, size)."""
        return self.column(self.moving.U) if self.moving else self.gap_rate(self.v)

    @property
    def rest_gap(self) -> Array:
        """Opening below which a row that pushes is closed, in the units of `REST_GAP_FACTOR` (nc, 1).

        Velocities obey the law of a curved contact, and its gap drifts by O(h³) in a step. The places of a prescribed motion
        differ by O(h²) from the sum of its rates by the rule of the step: a contact with it is closed while it pushes.
        """
        if self.moving:
            return np.where(self.moving.curved, DRIFT_FACTOR, REST_GAP_FACTOR)[:, None]
        d = self.dynamics
        moved = (abs(d.H[:, d.driven]).sum(axis=1) > 0.0) & (d.relative_degree == 2)
        return np.where(moved, 1.0 / REST_GAP_FACTOR, REST_GAP_FACTOR)[:, None]

    @property
    def mass(self) -> Array:
        """The mass matrix by which impulses act (n, n)."""
        return self.moving.mass if self.moving else self.dynamics.M

    def momentum(self, v: Array) -> Array:
        """Return M v (n, size)."""
        return times(self.dynamics.M, v)

    def after_jump(self, memory: Array, matrix: Array | None = None, h: float = 1.0) -> Array:
        """Return a memory of forces, or of their effect A⁻¹ h f with the ``matrix`` A, behind the jump of the loads."""
        if not self.jump.any():
            return memory
        return np.asarray(memory + (self.jump if matrix is None else self.solve(matrix, h * self.jump)))

    def push(self, impulse: Array) -> Array:
        """Return the impulses or forces of the rows on the nodes, Hᵀ P (n, size)."""
        return times(self.dynamics.B, impulse)

    def force(self, c: float, q: Array, v: Array, law: int = 0) -> Array:
        """Return f(t + c h) - K q - C v + s on the nodes (n, size), with the spring forces of a law, by its number.

        Raises
        ------
        InputError
            If the method does not declare c in its ``instants``.
        """
        d = self.dynamics
        linear = self.loads[c] - times(d.K, q) - times(d.C, v)
        return linear + product(d.pushes.T, self.s[law]) if self.s else linear


def times(A: Array, x: Array) -> Array:
    """Return A x, of matrices in one format: full, or in compressed rows."""
    return product(A, x) if isinstance(A, np.ndarray) else A @ x


def held(L: Array, P: Array) -> Array:
    """Return the change W_ii P_i of each row of a law by its own unknown P."""
    return np.asarray(np.diag(product(L, P.T))[:, None] * P)


def pushed(L: Array, P: Array) -> Array:
    """Return w/W_ii - z for each row of a law with the unknown P: negative if it is active, positive if not.

    Either z or w is zero, but an iterative solver leaves both near it.
    """
    return np.asarray(L / np.diag(product(L, P.T))[:, None] - P)


@dataclass(frozen=True, eq=False)
class Law:
    """A contact law 0 <= P ⟂ L >= 0 on the active rows; sliders have bounds instead of 0 and inf, and are always active.

    An example is in `LinearStep`.

    Attributes
    ----------
    L : (nc, size) array                complementary to P
    touching : (nc, size) array         activation: a row is active where it is <= 0; None for all rows
    springs_at : pair of (n, size)      the q and v at which the spring forces s of this law are evaluated
    strictly : bool                     a row is active where ``touching`` is < 0, and not where it is 0
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
    """The end of a step; an example is in `LinearStep`.

    Attributes
    ----------
    q, v : (n, size) arrays         coordinates and velocities at t + h
    impulse : (nc, size) array      the impulses of the rows over the step in N s
    laws : tuple of Law             in the order of their solution; later ones may use the P and s of earlier ones
    memory : dict                   other memory of the method, by name (n, size)
    paths : Paths                   impulse paths over massless nodes that obey the law of impact at the end of the step
    static : Static                 quasi-static coordinates, projected onto equilibrium at the end of the step
    """

    q: Array
    v: Array
    impulse: Array
    laws: tuple[Law, ...]
    memory: dict[str, Array] = field(default_factory=dict)
    paths: Paths = field(default_factory=no_paths)
    static: Static = field(default_factory=no_static)


@dataclass(frozen=True, eq=False)
class Tabulated:
    """The constant data of steps of one length.

    Attributes
    ----------
    table : StepTable                   the coefficients for the kernel
    banded : BandedTable                those with banded equations, where they take less time
    features : tuple                    springs, impulse paths, quasi-static coordinates, friction, static friction
    springs : callable                  the Newton solver of the springs
    forces : callable, optional         that of springs and general forces, for the instant at which these are evaluated
    loads : callable                    the loads of the steps between instants, one row a step
    contacts : Dense                    the matrix of the first law
    solver : SolverState                the LCP solver prepared for it
    tol, max_iter : float, int          its tolerance and limit of iterations
    at_switches : Tabulated, optional   the step used instead at a change of the active contacts
    closed : ClosedModes, optional      the steps used instead while contacts on strong dashpots are closed
    keeps : bool                        whether the basis of the LCP may be kept from step to step
    frozen : FrozenSteps, optional      those of a Lagrangian system, each with a table of its own
    """

    table: StepTable
    banded: BandedTable
    features: tuple[StepSprings, Paths, Static, FrictionRows, StaticFriction]
    springs: SpringSolver
    forces: Callable[[float], SpringSolver] | None
    loads: Callable[[Array], Array]
    contacts: Dense
    solver: SolverState
    tol: float
    max_iter: int
    at_switches: Tabulated | None
    closed: ClosedModes | None
    keeps: bool
    frozen: FrozenSteps | None = None

    @property
    def alone(self) -> bool:
        """Whether it is taken by itself, as its forces or its table are made in the interpreter."""
        return bool(self.forces or (self.frozen and not self.frozen.by_text))

    @property
    def constant(self) -> bool:
        """Whether no run changes it: its solver is a compiled function, and there is no static friction."""
        return self.solver.compiled and len(self.features[4].static) == 0

    def watched(self, state: StepState, rtol: float | None) -> Indices:
        """Return how contacts on strong dashpots begin a block: as closed where they have pushed (nc,)."""
        if self.closed is None:
            return UNWATCHED
        watched = self.closed.watched.copy()
        # Steps that may be halved have no last one.
        pushed = (watched[: state.P.shape[1]] == Watched.OPEN) & (state.P[0] > 0.0) & (rtol is None)
        watched[: len(pushed)][pushed] = Watched.CLOSED
        return watched

    @cached_property
    def featured(self) -> FeaturedSolver:
        """The function that solves a law with springs, friction or impulse paths, if there are any."""
        springs, paths, _, friction, _ = self.features
        return solve_features if len(springs.law) + len(paths.lines) + len(friction.rows) else no_features

    @cached_property
    def written(self) -> bool:
        """Whether its steps can be written as straight-line statements, in which a law of one row has its closed form."""
        springs, paths, static, _, _ = self.features
        closed = self.table.W.shape[1] != 1 or self.solver.name == "closed-form"
        plain = closed and not self.forces and not self.frozen and self.at_switches is None and self.closed is None
        return plain and covers(self.table, static, len(springs.law), len(paths.lines))

    @property
    def plain(self) -> bool:
        """Whether they can, and no law has friction."""
        return self.written and not len(self.features[3].rows)

    @property
    def in_closed_form(self) -> bool:
        """Whether each law of plain steps has a closed form: those of one row, and of two contacts."""
        table, nc = self.table, self.table.W.shape[1]
        contacts = (
            not table.lower.any() and np.isinf(table.upper).all() and (table.W.diagonal(axis1=1, axis2=2) > 0.0).all()
        )
        two = nc == 2 and self.solver.name == "closed-form" and contacts
        return self.plain and (nc < 2 or bool(two))

    @cached_property
    def pattern(self) -> bytes:
        """Key of its straight-line code: the sizes and patterns on which the statements depend."""
        rubbing = self.features[3]
        return (
            pattern(self.table, self.features[2]) + repr((self.in_closed_form, rubbing.rows, rubbing.normals)).encode()
        )

    def line(self, n: int, count: int, left: int, *, short_block: int = 16) -> StraightLine | None:
        """Return the straight-line code of n coordinates for a block of steps of those left, if it is worth it.

        ``short_block``: number of steps below which a block is left to the kernel.
        """
        closed = self.in_closed_form
        faster = closed or not getattr(steps, "ready", True)
        if not faster or not COMPILING or count < short_block or not (self.written and self.solver.compiled):
            return None
        from lcpimpact.integrators.printed.straight_line import straight_line  # here, as the interpreter does without

        normals = np.full(self.table.W.shape[1], -1)
        normals[self.features[3].rows] = self.features[3].normals
        return straight_line(self.pattern, self.table, self.features[2], n, normals.tolist(), closed, left)


@dataclass(frozen=True, eq=False)
class ClosedModes:
    """The steps on strong dashpots, by the contacts that are closed and the blows that end.

    Attributes
    ----------
    watched : (nc + ns,) array  `OPEN` or `APART` for contacts on dashpots and for springs that damp, 0 for others
    tabulate : callable         the step of a mode, by its ``watched``
    known : dict                those tabulated so far, by its bytes
    """

    watched: Indices
    tabulate: Callable[[Indices], Tabulated]
    known: dict[bytes, Tabulated] = field(default_factory=dict)

    def step(self, watched: Indices) -> Tabulated:
        """Return the step of a mode."""
        key = watched.tobytes()
        if key not in self.known:
            self.known[key] = self.tabulate(watched)
        return self.known[key]


class Way(NamedTuple):
    """One way to take the next steps of a block.

    Attributes
    ----------
    usual : Tabulated           the step of the block
    step : Tabulated            the step taken: this one, that at switches, or that of a mode of closed contacts
    solver : SolverState        the LCP solver
    most : int                  number of steps at most
    line : StraightLine         its straight-line code, if there is any
    watched : (nc,) array       what is known of contacts on strong dashpots
    others : iterator           the solvers left to try, where this one is not the first
    failure : int               why the first has failed
    """

    usual: Tabulated
    step: Tabulated
    solver: SolverState
    most: int
    line: StraightLine | None
    watched: Indices
    others: Iterator[SolverState] | None = None
    failure: int = 0

    @classmethod
    def begin(cls, step: Tabulated, state: StepState, rtol: float | None, line: StraightLine | None = None) -> Way:
        """Return the way in which a block begins."""
        usual = cls(step, step, step.solver, 1 if step.alone else sys.maxsize, line, step.watched(state, rtol))
        return usual.by_mode()

    def by_mode(self) -> Way:
        """Return the way in which the contacts that are watched are closed."""
        if self.usual.closed is None:
            return self
        step = self.usual.closed.step(self.watched)
        return self._replace(step=step, solver=step.solver if self.others is None else self.solver)

    def after(self, code: int, begin: Callable[[], Way]) -> tuple[Way | None, Status]:
        """Return the way of the steps that follow those which ended with a code, or none and the reason.

        ``begin`` returns that of a new block.
        """
        if code == Status.SOLVED:
            return (self.by_mode() if self.usual.closed and self.others is None else begin()), Status.SOLVED
        if code == IRREGULAR:
            return self._replace(line=None, most=1), Status.SOLVED
        if code == SWITCHES and self.step.at_switches:
            return self._replace(step=self.step.at_switches, line=None, most=1), Status.SOLVED
        if code == SWITCHES:
            return self.by_mode(), Status.SOLVED
        others, failure = self.others, self.failure
        if others is None:
            others, failure = fallback_solvers(self.usual.solver, self.usual.contacts), code
        solver = next(others, None)
        if solver is None:
            return None, Status(failure)
        return begin()._replace(solver=solver, most=1, line=None, others=others, failure=failure), Status.SOLVED


@dataclass(frozen=True)
class LinearStep(TimeStepping[Tabulated]):
    """A method whose step is linear; to write one, declare it and write `equations`.

    Examples
    --------
    The symplectic Euler method, with Newton's law of impact on the rows that are closed:

    >>> from lcpimpact import Declared, Feature, Law, LinearStep, Step, load_problem, simulate
    >>> class SymplecticEuler(LinearStep):
    ...     name = "symplectic-euler"
    ...     instants = (0.0,)
    ...     declared = Declared(
    ...         summary="velocities first", source="folklore", level="velocity", order_smooth=1, order_impact=1,
    ...         order_penetration=1, relative_degrees=(2,), handles=(Feature.RESTITUTION,), reaction_time="at t + h/2",
    ...         energy="near its value in smooth motion", dissipates=False,
    ...     )
    ...
    ...     def equations(self, y, d, h):
    ...         v = y.solve(d.M, y.momentum(y.v) + h * y.force(0.0, y.q, y.v) + y.push(y.P[0]))
    ...         L = y.gap_rate(v) + d.restitution[:, None] * y.gap_rate(y.v)
    ...         law = Law(L=L, touching=y.gap(y.q), springs_at=(y.q, y.v))
    ...         return Step(q=y.q + h * v, v=v, impulse=y.P[0], laws=(law,))
    >>> run = simulate(load_problem("bouncing-ball", e=0.7), SymplecticEuler(), dt=1e-3, t_end=0.5)
    >>> run.success, run.events[0].kind
    (True, 'impact')
    """

    laws: ClassVar[int] = 1
    """Number of LCPs in a step."""

    instants: ClassVar[tuple[float, ...]] = (1.0,)
    """The c for which the equations use the loads at t + c h."""

    means: ClassVar[tuple[float, ...]] = ()
    """The ``instants`` at which a load that jumps acts by its mean: there one step follows another in the equations."""

    jumps_at: ClassVar[float | None] = None
    """The c, 0 or 1, of the jump of the loads in the symbols, for methods whose memory holds the effect of one side."""

    formulation: ClassVar[str] = FORMULATIONS[GLOCKER]
    """Formulation of friction as an LCP, of `lcpimpact.lcp.friction`."""

    remembers: ClassVar[tuple[str, ...]] = ()
    """Names of the memory beside q and v, one vector (n,) each."""

    sums_alone: ClassVar[bool] = True
    """Whether the equations only add symbols, so that solutions may stay unknowns, and never read a coefficient of one."""

    @property
    def ends_blows(self) -> bool:
        """Whether steps by `in_mode` end the blows of springs that the usual ones would make throws of."""
        return False

    @property
    def reaction_at(self) -> float:
        """1/2."""
        return 0.5

    @property
    def frozen_at(self) -> float:
        """Instant in units of the step, at which the forces of a Lagrangian system are those of its step."""
        return self.reaction_at

    @property
    def directed_at(self) -> float:
        """Instant in units of the step, at which the reactions of a Lagrangian system act by its mass."""
        return self.frozen_at

    @property
    def law_at(self) -> float:
        """Instant in units of the step, at which velocities obey the laws of a Lagrangian system."""
        return 1.0

    @property
    def moved_by(self) -> str:
        """Name of the velocity along which a Lagrangian system moves in its step: v, or one of ``remembers``."""
        return "v"

    @abstractmethod
    def equations(self, y: Symbols, d: Dynamics, h: float) -> Step:
        """Write one step of length h of the dynamics d, in the symbols y."""

    def remember(self, d: Dynamics, q: Array, v: Array, h: float) -> dict[str, Array]:
        """Return the memory at t = 0, by name (n,)."""
        return {}

    def begin(self, d: Dynamics, q: Array, v: Array, h: float) -> Array:
        """Return q, v, the memory, and the sampled forces, which are zero."""
        memory = self.remember(d, q, v, h)
        return np.concatenate([q, v, *(memory[name] for name in self.remembers), np.zeros(len(d.held_at))])

    def contact_matrix(self, d: Dynamics, h: float, W: Array) -> Dense:
        """Return the matrix W of a law for the LCP solver, with its known properties."""
        return Dense(W)

    def _lcp_matrix(self, d: Dynamics, h: float, W: Array) -> Dense:
        """Return the matrix of a law's LCP; with friction it has no structure."""
        if not d.tangential.any():
            return self.contact_matrix(d, h, W)
        return Dense(lcp_matrix(W, d.r_min, d.r_max, self._friction_rows(d)))

    def _friction_rows(self, d: Dynamics, lcp_solver: str = "") -> FrictionRows:
        """Return the rows with friction; the relaxed law has no cases, and a solver by name solves each LCP."""
        formulation = FORMULATIONS.index(self.formulation)
        return FrictionRows(*d.friction, formulation, lcp_solver == "auto" and formulation != ANITESCU_POTRA)

    def on_moving(self, d: LagrangianDynamics) -> LinearStep:
        """Return the method used on a Lagrangian system."""
        return self

    def at_switches(self, d: Dynamics) -> LinearStep | None:
        """Return the method used in steps at a change of the active contacts; None for this one."""
        return None

    def stopping_contacts(self, d: Dynamics, h: float) -> Indices | None:
        """Return the contacts and springs that need other steps, marked `OPEN` or `APART`, else 0 (nc + ns,).

        None where all steps are alike.
        """
        return None

    def in_mode(self, d: Dynamics, watched: Indices) -> LinearStep:
        """Return the method used in steps in which contacts and springs are in the states ``watched``."""
        return self

    def frozen_table(self, d: Dynamics, moving: MovingStep, h: float, y: Array) -> StepTable:
        """Return the table of a step of a Lagrangian system, frozen in d, from the state y; its sum is the column of 1."""
        n, nc, m = len(d.nodes), len(d.contacts), self.laws
        columns = np.eye(1 + m * nc)
        one, P = columns[:1], tuple(np.split(columns[1:], m))
        nothing, none = np.zeros((n, len(columns))), np.zeros((0, len(columns)))
        q, v, *memory = (part[:, None] * one for part in np.split(y, len(y) // n))
        loads = d.force(0.0)[:, None] * one
        symbols = Symbols(
            d, q, v, Named("remembers", dict(zip(self.remembers, memory, strict=True))), one,
            Named("instants", dict.fromkeys(self.instants, loads)), nothing, Prescribed(nothing, nothing, nothing), P,
            (none,) * m, held=none, moving=moving,
        )  # fmt: skip
        table, _ = tabulate(symbols, self.equations(symbols, d, h), self.remembers, h)
        known = np.vstack([np.zeros((len(y), table.known.shape[1])), table.known])
        return table._replace(known=known)

    def tabulate(self, d: Dynamics, h: float) -> tuple[StepTable, StepSprings, Step]:
        """Return the coefficient tables of a step of length h, and the step they belong to."""
        symbols = self._symbols(d)
        self.stopping_contacts(d, h)  # which holds for formulas as far as they assume it
        try:
            step = self.equations(symbols, d, h)
        except np.linalg.LinAlgError:
            raise InputError(
                f"the matrix of a step of {h:g} s is singular to rounding: bring the constants closer in size, "
                "or take another dt"
            ) from None
        table, springs = tabulate(symbols, step, self.remembers, h)
        return table, springs._replace(mobility=blows(d)) if self.ends_blows else springs, step

    def prepare(self, d: Dynamics, h: float, lcp_solver: str) -> Tabulated:
        """Tabulate the step."""
        if isinstance(d, LagrangianDynamics):
            return self._prepare_frozen(d, h, lcp_solver)
        table, springs, step = self.tabulate(d, h)
        solver, contacts = SOLVERS[lcp_solver], [Dense(np.eye(1))]
        if len(d.contacts):
            contacts = [self._lcp_matrix(d, h, W) for W in table.W]
            for each in contacts:
                solver.check(each, not d.one_sided.all())
        other = self.at_switches(d)
        watched = self.stopping_contacts(d, h)

        def in_mode(states: Indices) -> Tabulated:
            return self.in_mode(d, states).prepare(d, h, lcp_solver)

        return Tabulated(
            table,
            self._banded(d, h, table),
            (springs, step.paths, step.static, self._friction_rows(d, lcp_solver), _static_friction(d)),
            spring_solver(d),
            partial(solve_with_forces, d) if d.force_laws else None,
            self.loads(d, h),
            contacts[0],
            solver.init(contacts[0]),
            *limits(solver, self.tol, self.max_iter),
            at_switches=other.prepare(d, h, lcp_solver) if other else None,
            closed=None if watched is None else ClosedModes(watched, in_mode),
            keeps=lcp_solver == "auto" and self.laws == 1 and other is None and watched is None,
        )

    def _prepare_frozen(self, d: LagrangianDynamics, h: float, lcp_solver: str) -> Tabulated:
        """Return the step of a Lagrangian system, whose table is that of the state: here it is one of no motion."""
        table, springs, step = self.tabulate(d.still, h)
        nc = len(d.contacts)
        solver, contacts = SOLVERS[lcp_solver], Dense(UNSYMMETRIC)
        if nc:
            of_rows = np.resize(UNSYMMETRIC, (nc, nc)) if nc > 1 else np.eye(1)
            contacts = Dense(lcp_matrix(of_rows, d.r_min, d.r_max, self._friction_rows(d)))
            solver.check(contacts, not d.one_sided.all())
        return Tabulated(
            table,
            DENSE,
            (springs, step.paths, step.static, self._friction_rows(d, lcp_solver), _static_friction(d)),
            no_springs,
            None,
            no_loads,
            contacts,
            solver.init(contacts),
            *limits(solver, self.tol, self.max_iter),
            at_switches=None,
            closed=None,
            keeps=False,
            frozen=FrozenSteps(self.on_moving(d), d, h),
        )

    def prepared(self, d: Dynamics, h: float, lcp_solver: str, *, max_tables: int = 16) -> Tabulated:
        """Return the table of an earlier run of the same system, if it holds nothing that runs change.

        ``max_tables``: number of tables of a system that are kept for its next runs.
        """
        tables: dict[tuple[LinearStep, float, str], Tabulated] = d.memo.setdefault(LinearStep, {})
        try:
            found = tables.get(key := (self, h, lcp_solver))
        except TypeError:  # a method of another package has an option without a hash
            return self.prepare(d, h, lcp_solver)
        if found is None:
            found = self.prepare(d, h, lcp_solver)
            if found.constant:
                if len(tables) >= max_tables:
                    tables.clear()
                tables[key] = found
        return found

    def first_state(self, d: Dynamics, y: Array, h: float) -> StepState:
        """Return the initial state, y without impulses."""
        nc = len(d.contacts)
        # Steps of one length have one matrix.
        return StepState(y.copy(), np.zeros((self.laws, nc)), kept_basis(nc if self.rtol is None else 0))

    def _banded(self, d: Dynamics, h: float, table: StepTable, *, most_equations: int = 6) -> BandedTable:
        """Return the step with banded equations, where its dense table of many nodes takes longer.

        ``most_equations``: number of solutions w of a step that are kept as unknowns at most; others are
        eliminated, which is slower.
        """
        # Straight-line code and lanes, of few terms, have the bits of the dense table.
        few = len(d.nodes) <= MAX_ROWS or np.count_nonzero(table.known) <= MAX_TERMS
        if few or len(d.pushes) or not self.sums_alone:
            return DENSE
        symbols = self._symbols(d, most_equations)
        rows, _ = step_rows(symbols, self.equations(symbols, d, h), self.remembers, h)
        used = len(symbols.q.T) - (most_equations - len(symbols.equations)) * len(d.nodes)
        equations = [(A, b[:, :used]) for A, b in symbols.equations]
        return banded_table(equations[:most_equations], rows[:, :used], int(np.argmax(symbols.one[0])), table)

    def _symbols(self, d: Dynamics, kept: int = 0) -> Symbols:
        """Return one column for each known and unknown; constant loads belong to the column of 1.

        The first ``kept`` solutions of equations are unknowns, too.
        """
        n = len(d.nodes)
        nc = len(d.contacts)
        ns = len(d.pushes)
        varying = varying_loads(d)
        jumping = jumping_nodes(d, self.jumps_at)
        sizes = (
            [n] * (2 + len(self.remembers))
            + [len(d.held_at), 1]
            + [varying.sum()] * len(self.instants)
            + [jumping.sum()]
        )
        sizes += [d.driven.sum()] * 3 + [nc] * self.laws + [ns] * self.laws + [n] * kept
        blocks = iter(np.split(np.eye(sum(sizes)), np.cumsum(sizes)[:-1]))
        q, v = next(blocks), next(blocks)
        memory = {name: next(blocks) for name in self.remembers}
        held = next(blocks)
        one = next(blocks)
        constant = np.where(varying, 0.0, d.force(0.0))[:, None] * one + np.eye(n)[:, d.held_at] @ held
        loads = {c: constant + np.eye(n)[:, varying] @ next(blocks) for c in self.instants}
        jump = np.eye(n)[:, jumping] @ next(blocks)
        prescribed = Prescribed(*(np.eye(n)[:, d.driven] @ next(blocks) for _ in range(3)))
        P, s = (tuple(next(blocks) for _ in range(self.laws)) for _ in range(2))
        memory = Named("remembers", memory)
        loads = Named("instants", loads)
        return Symbols(d, q, v, memory, one, loads, jump, prescribed, P=P, s=s, w=tuple(blocks), held=held)

    def loads(self, d: Dynamics, h: float) -> Callable[[Array], Array]:
        """Return the function that lists variable loads and prescribed motion in the steps between instants."""
        varying = varying_loads(d)
        if not varying.any() and not d.motions:
            return no_loads

        def loads(t: Array) -> Array:
            columns = [d.force((1.0 - c) * t[:-1] + c * t[1:])[:, varying] for c in self.instants]
            if d.breaking_loads:
                columns = self._with_breakpoints(d, t)
            if d.motions:
                y, rate = d.motion(t)
                mean = self.mean_rates(d, h, t, y, rate)
                for k, (_, motion) in enumerate(sorted(d.motions.items())):
                    if jumps(motion):
                        y[:, k] = limits_at(motion, t)[1]
                columns += [y[1:], rate[1:], mean]
            return np.ascontiguousarray(np.hstack(columns))

        return loads

    def _with_breakpoints(self, d: Dynamics, t: Array) -> list[Array]:
        """Return the loads as the steps see them, without jumps at their own ends, and after them the jumps of the symbols.

        A step reads of its neighbour the limit of the loads between them, which is that of the loads themselves.
        """
        kept = 0.0 if 1.0 in self.means else 1.0 if self.means or self.jumps_at == 0.0 else None
        left, right = d.force_limits(t, kept)
        left[t == 0.0] = d.force(0.0)  # the memory begins behind a jump
        varying, found = varying_loads(d), []
        for c in self.instants:
            below, above = (0.5 * (left + right),) * 2 if c in self.means else (left, right)
            given = {0.0: above[:-1], 1.0: below[1:]}[c] if c in (0.0, 1.0) else d.force_in_steps(t, c)
            found.append(given[:, varying])
        jump = (right - left)[:, jumping_nodes(d, self.jumps_at)]
        return [*found, jump[1:] if self.jumps_at == 1.0 else jump[:-1]]

    def mean_rates(self, d: Dynamics | SparseDynamics, h: float, t: Array, y: Array, rate: Array) -> Array:
        """Return the mean rates of the prescribed motions in the steps between instants (steps, nd)."""
        if not any(jumps(motion) for motion in d.motions.values()):
            return np.diff(y, axis=0) / h
        left, right = (y.copy() for _ in range(2))
        for k, (_, motion) in enumerate(sorted(d.motions.items())):
            left[:, k], right[:, k] = limits_at(motion, t)
        return (left[1:] - right[:-1]) / h

    def advance(self, carry: SteppingRun[Tabulated], record: Record, first: int, last: int) -> tuple[Status, int]:
        """Take the steps of the block, each in the way that the outcome of those before it asks for."""
        if carry.halving:
            return carry.halving.advance(carry.grid, first, last, carry.held.set)
        step, state = carry.steps[0], carry.state
        timeless = step.loads is no_loads and not step.forces and not step.frozen
        times = np.broadcast_to(0.0, last - first + 1) if timeless else carry.times(first, last)
        line = step.line(record.q.shape[1], last - first, carry.grid.steps - first)

        def begin() -> Way:
            return Way.begin(step, state, self.rtol, line)

        way: Way | None = begin()
        status, k = Status.SOLVED, first
        left = 0
        while way and k < last:
            carry.held.set(k, state.y)
            end = min(k + way.most, carry.held.next_after(k, last))
            function, arguments = self._call(way, record, times[k - first : end - first + 1], k, state)
            code, reached, iterations, newton, residual = function(*arguments)
            record.stats.add_lcps(self.laws * (reached - k), iterations, residual, newton)
            if step.frozen and step.alone and reached > k:
                step.frozen.project(times[reached - first], record.q[reached])
                state.y[: record.q.shape[1]] = record.q[reached]
            k = reached
            left += code == IRREGULAR
            line = line if left < FEW_LEFT + (k - first) // FEW_LEFT else None
            way, status = way.after(code, begin)
        return status, k

    def _call(
        self, way: Way, record: Record, times: Array, first: int, state: StepState
    ) -> tuple[Callable[..., tuple[int, int, int, int, float]], tuple[Any, ...]]:
        """Return the function that takes steps, and its arguments.

        It is compiled, or in the interpreter where the solver or a force is written in Python. General forces depend on
        the time, so that they take one step at a time.
        """
        step, solver = way.step, way.solver
        table, features = step.table, step.features
        if step.frozen and step.alone:
            table = step.frozen.table(times[0], state.y)
        last = first + len(times) - 1
        stops = step.at_switches is not None
        plain = step.featured is no_features
        keeps = plain and len(state.kept.T) > 0 and step.keeps and solver is step.solver
        block = Block(first, last, step.loads(times), step.tol, step.max_iter, stops, keeps, way.watched)
        path = StepOutput(record.q, record.v, record.reaction)
        room = room_for(table, len(features[0].law), step.banded)
        arguments = block, table, step.banded, features, state, path, room
        ways = Ways(solver.kernel, solve_kept_rows if keeps else step.featured, step.springs)
        if step.frozen and not step.alone:
            return step.frozen.call(arguments, times, ways, solver.compiled, len(record.t) - 1 - first)
        if way.line and way.line.closed:
            return way.line.take, (*arguments, ways)
        if solver.compiled and not step.forces:
            return call_with(steps, arguments, ways, way.line.take if way.line else None)
        featured, springs = map(in_python, ways[1:])
        if step.forces:
            springs = step.forces(float(times[0] + self.reaction_at * (times[1] - times[0])))
        return in_python(steps), (*arguments, Ways(solver.kernel, featured, springs))


def no_loads(t: Array) -> Array:
    """Return the loads of steps without variable ones."""
    return np.zeros((len(t) - 1, 0))


def spring_solver(d: Dynamics) -> SpringSolver:
    """Return the Newton solver of the non-linear springs and dashpots, compiled only if there are any."""
    if not len(d.push_laws):
        return no_springs
    from lcpimpact.integrators.stepping.newton import solve_with_springs

    return solve_with_springs


def _static_friction(d: Dynamics) -> StaticFriction:
    """Return the static friction, with no rows where none is above the kinetic one."""
    rows = np.flatnonzero(d.tangential & (d.mu_s > d.mu).any())
    U, near = np.zeros((2, len(rows)))
    return StaticFriction(d.mu[rows], d.mu_s[rows], d.H[rows], U, near, np.zeros(len(rows), dtype=np.bool_))


def varying_loads(d: Dynamics) -> Flags:
    """Return the nodes with a load that depends on time (n,)."""
    return np.isin(np.arange(len(d.nodes)), [i for i, load in d.loads if callable(load)])


def jumping_nodes(d: Dynamics, jumps_at: float | None) -> Flags:
    """Return the nodes with a load that jumps for some step, if the symbols hold its jump at one end of it (n,)."""
    found = [] if jumps_at is None else [i for i, load in d.loads if breaks(load)]
    return np.isin(np.arange(len(d.nodes)), found)


def step_rows(y: Symbols, step: Step, remembers: tuple[str, ...], h: float) -> tuple[Array, Array]:
    """Return the rows of the table of a step, in its symbols, and θh of the springs of each law."""
    d, N = y.dynamics, y.dynamics.pushes
    gaps, damps = d.push_laws[:, :1], d.damps[:, None]
    rows = []
    θh = []
    always = ~d.impenetrable & ~d.tangential
    for law, (low, high), P, s in zip(step.laws, _bounds(d, step, h), y.P, y.s, strict=True):
        rate = product(N, law.springs_at[1])
        # The place of a dashpot is its rate at the start, and as implicit as that of a spring.
        approach = -(product(N, law.springs_at[0]) + gaps * y.one + np.where(damps, product(N, y.v - y.q), 0.0))
        touching = -y.one if law.touching is None else np.where(always[:, None], -y.one, law.touching)
        touching = np.where(d.tangential[:, None], y.one, touching)
        rows += [np.where((high > low)[:, None], touching, y.one), law.L, rate, approach]
        θh.append(_shared_step(-approach, rate, P, s))
    rows += [step.q, step.v, *(step.memory[name] for name in remembers)]
    rows += [*([] if y.held is None else [y.held]), step.impulse / h]
    static = step.static.S
    if static.size:
        rows.append(product(static.T, y.loads[1.0] - product(d.K, step.q) + y.push(step.impulse / h)))
    return np.vstack(rows), np.array(θh)


def _bounds(d: Dynamics, step: Step, h: float) -> list[tuple[Array, Array]]:
    """Return the bounds of P in each law: those of the forces, or 0 and infinite."""
    weights = [h if law.weight is None else law.weight for law in step.laws]

    def impulses(weight: float, bound: Array) -> Array:
        return np.asarray(weight * np.where(d.limited, bound, 0.0) + np.where(d.limited, 0.0, bound))

    return [(impulses(weight, d.r_min), impulses(weight, d.r_max)) for weight in weights]


def tabulate(y: Symbols, step: Step, remembers: tuple[str, ...], h: float) -> tuple[StepTable, StepSprings]:
    """Return the coefficients of a step for the kernel."""
    d = y.dynamics
    lower, upper = (np.array(bounds) for bounds in zip(*_bounds(d, step, h), strict=True))
    rows, θh = step_rows(y, step, remembers, h)
    columns = np.array(rows.T, order="C")
    known = len(columns) - sum(map(len, (*y.P, *y.s)))
    unknown = np.vstack([each for pair in zip(y.P, y.s, strict=True) for each in pair])
    W = np.array([product(law.L, P.T) for law, P in zip(step.laws, y.P, strict=True)])
    # A row with friction is active with its normal row, whatever its impulse is.
    rests = y.rest_gap[:, 0] * h * ~d.tangential
    near = np.array([rests * np.diag(each) * (not law.strictly) for each, law in zip(W, step.laws, strict=True)])
    table = StepTable(
        columns[:known], product(unknown, columns), W, lower, upper, np.array([law.strictly for law in step.laws]), near
    )
    N, light = (np.where(here, d.pushes, 0.0) for here in (d.massive | d.driven, ~d.massive))
    return table, StepSprings(d.push_laws, θh, h, N, light, np.zeros(0))


def smooth_force(d: Dynamics, q: Array, v: Array) -> Array:
    """Return f - K q - C v + s at t = 0, without reactions (n,)."""
    Kq, Cv = (product(A, x[:, None])[:, 0] for A, x in ((d.K, q), (d.C, v)))
    return np.asarray(d.applied(0.0, q, v) - Kq - Cv + d.spring_force(q, v) + d.dashpot_force(v))


def first_reactions(d: Dynamics, q: Array, v: Array, h: float, M: Array) -> Array:
    """Return at t = 0 the forces of closed contacts that do not approach, and of sliders (nc,), on the mass matrix M.

    With them the velocity after half a step, v + h/2 q'', obeys the laws. Approaching contacts are left to the first impact,
    and so are those that jam, with an impulse in place of a force: it grows as 1/h.
    """
    u = d.gap(0.0, q)
    U = d.gap_rate(0.0, q, v)
    r = np.zeros(len(d.contacts))
    slips, normals, mu = d.friction
    pushes = (d.of_rate | ((u <= 0.0) & (U >= 0.0))) & ~d.tangential
    pushes[slips] = pushes[normals]
    rows = np.flatnonzero(pushes)
    if len(rows):
        H, push = d.H[rows], d.B[:, rows]
        κ: Array | float = d.kappa[rows] if isinstance(d, FrozenDynamics) else 0.0
        rate = H @ solve(M, smooth_force(d, q, v)) + κ
        acts = pushes[slips]
        at, normal = (np.searchsorted(rows, each[acts]) for each in (slips, normals))
        rubbing = FrictionRows(at, normal, mu[acts], GLOCKER)

        def reactions(half: float) -> Array:
            W = half * H @ solve(M, push)
            if not len(at):
                return solve_lcp(W, U[rows] + half * rate, lower=d.r_min[rows], upper=d.r_max[rows]).z
            maps = friction_maps(W, d.r_min[rows], d.r_max[rows], rubbing)
            matrix = maps.E @ W @ maps.T + maps.V
            z = solve_lcp(matrix, maps.E @ (U[rows] + half * rate), lower=maps.lower, upper=maps.upper).z
            return np.asarray(maps.T @ z)

        found = reactions(0.5 * h)
        if not (len(at) and (reactions(0.25 * h)[normal] > 1.5 * found[normal]).any()):
            r[rows] = found
    return r


def first_acceleration(d: Dynamics, q: Array, v: Array, h: float, M: Array) -> Array:
    """Return q'' at t = 0, with the `first_reactions`, on the mass matrix M (n,)."""
    return np.asarray(solve(M, smooth_force(d, q, v) + d.B @ first_reactions(d, q, v, h, M)))


def _shared_step(place: Array, rate: Array, P: Array, s: Array) -> float:
    """Return the θh by which the unknowns of a law move the springs' ends: place = θh rate in the columns of P and s.

    Newton's iteration has one unknown a spring, its rate; the places follow it. If they do not, since only one of them is
    implicit, θh = 0 and the positions are the known ones.
    """
    unknown = np.vstack([P, s]).T
    moved, rates = place @ unknown, rate @ unknown
    if not moved.any():
        return 0.0
    θh = float((moved * rates).sum() / (rates * rates).sum())
    if not np.allclose(moved, θh * rates, rtol=1e-9, atol=1e-12 * np.abs(moved).max()):
        raise InputError(
            "the places and rates of the springs in a law must be those of one implicit step, which rounding may hide: "
            "bring the constants closer in size, or take another dt"
        )
    return θh
