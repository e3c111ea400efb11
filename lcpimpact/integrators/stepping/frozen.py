r"""Steps of Lagrangian systems: each is one step of the linear system frozen where it is half way.

Where each matrix stands decides the order. Forces and their directions are those at (t + θ h, q + θ h v), as are
C = -∂F/∂v and K = -∂F/∂q; the law holds with the rows at the end of the step, (t + h, q + h v), so that

.. math:: W = H_1 A^{-1} H_θ^T

is not symmetric; and e is that of U at its start. So a method of order 2 has order 2 here without iterations, as
these places are off by O(h²). Joints hold for velocities; at its end a step projects q onto them, by the least change in the
kinetic metric.

The equations of a method, with formulas in place of the matrices, are written once as a text from (t, y) to the table of its
step; systems of more coordinates have their tables by linear algebra.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from typing import Any, ClassVar, NamedTuple, Protocol, TypeAlias, TypeVar

import numpy as np

from lcpimpact.arrays import Array, Flags, Matrix, Stack, Vector
from lcpimpact.compiled import (
    COMPILING,
    ByAddress,
    as_it_is,
    call_with,
    compiled,
    compiled_text,
    function_at,
    interpret,
    waits,
)
from lcpimpact.expressions import Assign, Name, names
from lcpimpact.formula import Formula, SymbolicProgram
from lcpimpact.integrators.stepping.banded_table import BandedTable
from lcpimpact.integrators.stepping.kernel import (
    SOLVED,
    Block,
    FeaturedSolver,
    Features,
    StepOutput,
    StepState,
    StepTable,
    Ways,
    Workspace,
    steps,
)
from lcpimpact.integrators.stepping.law import SpringSolver, solve_law
from lcpimpact.interpreter import function_of, interpreted, throughout
from lcpimpact.lcp.solver import Kernel
from lcpimpact.numerics.elimination import product, solve
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.lagrangian import LagrangianDynamics, MotionRows
from lcpimpact.scheme.motion_function import SCALAR, MotionFunction, without_constants

F = TypeVar("F", bound=Callable[..., Any])

UNSYMMETRIC = np.array([[1.0, 2.0], [1.0, 1.0]])
"""A matrix without the properties that W may lose on its way: it is neither symmetric nor a P-matrix."""

MAX_WRITTEN = 64
"""Number of coordinates up to which the table of a step is written as a text."""

MANY_STEPS = 3_000
"""Number of steps in the interpreter that take longer than to compile a table."""

FILLED = "known", "unknown", "W", "near"
"""The arrays of a table that depend on the motion."""

Fill: TypeAlias = Callable[[float, Vector, Vector, Matrix, Matrix, Stack, Matrix], None]
"""Type of the function of a text: t, y and the constants, and the arrays known, unknown, W and near that it fills."""

Project: TypeAlias = Callable[[float, Vector, Vector], None]
"""Type of a projection: t, q which it changes, and the constants."""


class FrozenWays(NamedTuple):
    """The functions of a step: those of `Ways`, the table, and the projection onto joints."""

    plain: ByAddress[Kernel]
    featured: ByAddress[FeaturedSolver]
    springs: ByAddress[SpringSolver]
    fill: ByAddress[Fill]
    project: ByAddress[Project]


fill_at, project_at = map(function_at, (Fill, Project))


@compiled()
def frozen_steps(
    block: Block,
    times: Vector,
    constants: tuple[Vector, Vector],
    joined: bool,
    table: StepTable,
    banded: BandedTable,
    features: Features,
    state: StepState,
    path: StepOutput,
    room: Workspace,
    ways: FrozenWays,
) -> tuple[int, int, int, int, float]:
    """Take a block of steps, each with a table of its own, as `steps` does."""
    fill = fill_at(ways.fill)
    project = project_at(ways.project)
    of_table, of_joints = constants
    plain = Ways(ways.plain, ways.featured, ways.springs)
    n = path.q.shape[1]
    iterations = 0
    newton = 0
    worst = 0.0
    for k in range(block.first, block.last):
        fill(times[k - block.first], state.y, of_table, table.known, table.unknown, table.W, table.near)
        one = Block(k, k + 1, block.loads, block.tol, block.max_iter, block.stops, block.keeps, block.watched)
        status, reached, count, tried, residual = steps(one, table, banded, features, state, path, room, plain)
        iterations += count
        newton += tried
        worst = max(worst, residual)
        if status != SOLVED:
            return status, reached, iterations, newton, worst
        if joined:
            project(times[k + 1 - block.first], state.y[:n], of_joints)
            path.q[k + 1, :] = state.y[:n]
    return SOLVED, block.last, iterations, newton, worst


READERS: dict[str, Any] = dict.fromkeys(("kernel_at", "featured_at", "springs_at", "fill_at", "project_at"), as_it_is)
"""Readers of the addresses of functions that solve a law; in the interpreter they return the functions themselves."""


@cache
def in_python(function: F) -> F:
    """Return a compiled function as the interpreter runs it, with the LCP solver's own kernel in it."""
    return interpreted(function, solve_law=interpreted(solve_law), **READERS)


@dataclass(frozen=True, eq=False)
class MovingStep:
    """Parts of a step of a Lagrangian system beside the system that is frozen, which has the rows where the step ends.

    Attributes
    ----------
    law : MotionRows            rows of the laws of velocities
    U : (nc,) array             opening rates a step before them
    mass : (n, n) array         mass matrix by which impulses act
    curved : (nc,) flags        rows whose rates change without forces
    start : callable            the system frozen where the step begins
    """

    law: MotionRows
    U: Array
    mass: Array
    curved: Flags
    start: Callable[[], Dynamics]


class FrozenMethod(Protocol):
    """A method whose steps take a frozen system; see `lcpimpact.integrators.stepping.linear_step.LinearStep`."""

    remembers: ClassVar[tuple[str, ...]]

    @property
    def frozen_at(self) -> float:
        """Instant in units of the step, at which the forces are those of the step."""

    @property
    def directed_at(self) -> float:
        """Instant at which the reactions act."""

    @property
    def law_at(self) -> float:
        """Instant at which velocities obey the laws."""

    @property
    def moved_by(self) -> str:
        """Name of the velocity along which these instants lie: v, or one of those it remembers."""

    def frozen_table(self, d: Dynamics, moving: MovingStep, h: float, y: Array) -> StepTable:
        """Return the table of a step of length h from the state y."""


@dataclass(frozen=True, eq=False)
class FrozenSteps:
    """The steps of one length of a method on a Lagrangian system."""

    method: FrozenMethod
    dynamics: LagrangianDynamics
    h: float

    def table(self, t: float, y: Array) -> StepTable:
        """Return the coefficients of the step from the state y (N,) at t."""
        q, v = self._moved(y)
        return self._table(y, lambda function, part: function(t + part * self.h, q + part * self.h * v, v))

    def _moved(self, y: Array) -> tuple[Array, Array]:
        """Return q and the velocity by which it moves (n,)."""
        n, parts = len(self.dynamics.nodes), ("q", "v", *self.method.remembers)
        first = n * parts.index(self.method.moved_by)
        return y[:n], y[first : first + n]

    def _table(self, y: Array, at: Callable[[MotionFunction, float], list[Array]]) -> StepTable:
        """Return the coefficients by the values of functions ``at`` instants in units of the step, on the line along v."""
        d, h, method = self.dynamics, self.h, self.method
        q, v = self._moved(y)
        at = cache(at)

        def rows(part: float) -> MotionRows:
            return MotionRows(*at(d.rows_of, part))

        def frozen(forces: float, end: float, directed: float) -> Dynamics:
            M, F, K, C, damping = at(d.forces_of, forces)
            f = F + K @ (q + forces * h * v) + C @ v
            found = d.linear(M, C, K, f, damping, rows(end), q + end * h * v)
            return replace(found, B=np.ascontiguousarray(rows(directed).H.T))

        law, mass = rows(method.law_at), at(d.inertia, method.directed_at)[0]
        moving = MovingStep(law, rows(method.law_at - 1.0).rates(v), mass, d.curved, lambda: frozen(0.0, 0.0, 0.0))
        return method.frozen_table(frozen(method.frozen_at, 1.0, method.directed_at), moving, h, y)

    @cached_property
    def written(self) -> WrittenTable:
        """The table as a text."""
        h, n = self.h, len(self.dynamics.nodes)
        size = n * (2 + len(self.method.remembers))
        program = SymbolicProgram()
        y = np.array([program.argument(f"y{i}") for i in range(size)], dtype=object)
        lines = [Assign(f"y{i}", Name(f"y[{i}]")) for i in range(size)]

        q, v = (each.tolist() for each in self._moved(np.array([f"y{i}" for i in range(size)])))

        def at(function: MotionFunction, part: float) -> list[Array]:
            found, more = function.at(point := f"_{part:g}".replace(".", "_"), program)
            lines.append(Assign(f"t{point}", Name("t") + part * h))
            for i in range(n):
                lines.append(Assign(f"q{i}{point}", Name(q[i]) + Name(v[i]) * (part * h)))
                lines.append(Assign(f"v{i}{point}", Name(v[i])))
            lines.extend(more)
            return found

        table = self._table(y, at)
        results = {
            f"{name}[{', '.join(map(str, index))}]": value
            for name in FILLED
            for index, value in np.ndenumerate(getattr(table, name))
            if isinstance(value, Formula)
        }
        lines += program.assignments(results, assumed=False)
        known, unknown, W, near = (_values(getattr(table, name)) for name in FILLED)
        filled = table._replace(known=known, unknown=unknown, W=W, near=near)
        return WrittenTable(*_text("fill(t, y, c, known, unknown, W, near)", lines, set(results)), filled)

    @property
    def by_text(self) -> bool:
        """Whether its table is written as a text."""
        return len(self.dynamics.nodes) <= MAX_WRITTEN

    def call(
        self, arguments: Sequence[Any], times: Array, ways: Ways, solver_compiled: bool, left: int
    ) -> tuple[Callable[..., tuple[int, int, int, int, float]], tuple[Any, ...]]:
        """Return the function that takes a block of the steps ``left``, and its arguments; see `LinearStep`."""
        block, _, *others = arguments
        table, (text, of_joints) = self.written, self.written_projection
        joined = bool(self.dynamics.bilateral.any())
        # Runs of one system side by side, in threads, fill arrays of their own.
        own = table.table._replace(**{name: getattr(table.table, name).copy() for name in FILLED})
        given = block, times, (table.constants, of_joints), joined, own, *others
        texts = (table.text, Fill), (text, Project)
        by_python, by_machine = ([_function(*each, compiles) for each in texts] for compiles in (False, True))
        if not (COMPILING and solver_compiled):
            return throughout(frozen_steps), (*given, FrozenWays(*map(throughout, ways), *by_python))

        def run() -> tuple[int, int, int, int, float]:
            function, all_given = call_with(frozen_steps, given, FrozenWays(*ways, *by_machine))
            found: tuple[int, int, int, int, float] = function(*all_given)
            return found

        if not waits(frozen_steps, given, 1, ways) and _repays(by_machine, left):
            return run, ()
        return partial(interpret, frozen_steps, (*given, FrozenWays(*map(throughout, ways), *by_python)), run), ()

    def project(self, t: float, q: Array) -> None:
        """Move q (n,) at t onto the joints, by the least change in the kinetic metric, M Δq = Jᵀ λ."""
        d = self.dynamics
        if not d.bilateral.any():
            return
        rows = d.rows(t, q, np.zeros(len(q)))
        q -= to_joints(d.mass(q), rows.H[d.bilateral], rows.g[d.bilateral])

    @cached_property
    def written_projection(self) -> tuple[str, Array]:
        """The projection as a text, and its constants."""
        d, n = self.dynamics, len(self.dynamics.nodes)
        program = SymbolicProgram()
        lines = [Assign(f"q{i}_1", Name(f"q[{i}]")) for i in range(n)] + [Assign("t_1", Name("t"))]
        (M, _), of_mass = d.inertia.at("_1", program)
        found, of_rows = d.rows_of.at("_1", program)
        rows = MotionRows(*found)
        results = {}
        if d.bilateral.any():
            moved = to_joints(M, rows.H[d.bilateral], rows.g[d.bilateral])
            q = [program.argument(f"q{i}_1") for i in range(n)]
            results = {f"q[{i}]": each for i, each in enumerate(np.array(q, dtype=object) - moved)}
        lines += [*of_mass, *of_rows, *program.assignments(results, assumed=False)]
        return _text("project(t, q, c)", lines, set(results))


def to_joints(M: Array, J: Array, g: Array) -> Array:
    """Return M⁻¹ Jᵀ (J M⁻¹ Jᵀ)⁻¹ g, of floats or of formulas (n,)."""
    moved = solve(M, J.T)
    return product(moved, solve(product(J, moved), g)[:, None])[:, 0]


@dataclass(frozen=True, eq=False)
class WrittenTable:
    """The table of a step as a text.

    Attributes
    ----------
    text : str              a function of t, y and c that fills what depends on them
    constants : array       c
    table : StepTable       with 0 where it does
    """

    text: str
    constants: Array
    table: StepTable


def _text(head: str, lines: Sequence[Assign], results: set[str]) -> tuple[str, Array]:
    """Return a function of what some results need, and its constants."""
    kept, constants = without_constants(needed_for(lines, results))
    given = [f"c{i} = c[{i}]" for i in range(len(constants))]
    body = [*given, *kept] or ["pass"]
    return f"def {head}:\n" + "".join(f"    {line}\n" for line in body), np.array(constants)


def _repays(functions: Sequence[Any], left: int) -> bool:
    """Return whether compiled functions are in the cache, or so many steps are left that they repay their compilation."""
    if left >= MANY_STEPS:
        return True
    files = [each.code_file() for each in functions if not each.ready]
    return all(file and file.exists() for file in files)


@cache
def _function(text: str, hint: Any, compiles: bool) -> Any:
    """Return the function of a text, compiled or of the interpreter."""
    if compiles:
        return compiled_text(text, hint, SCALAR)
    function = function_of(text, SCALAR)

    def called(t: float, y: Vector, c: Vector, *arrays: Array) -> None:
        try:
            function(t, y.tolist() if arrays else y, c, *arrays)
        except (ArithmeticError, ValueError):  # of floats, where compiled code has NaN or infinities
            for each in arrays or (y,):
                each[...] = np.nan

    return called


def needed_for(lines: Sequence[Assign], results: set[str]) -> list[Assign]:
    """Return the assignments that some results need."""
    needed, found = set(results), []
    for line in reversed(lines):
        if line.name in needed:
            needed |= names(line.value)
            found.append(line)
    return found[::-1]


def _values(numbers: Array) -> Array:
    """Return numbers as floats, 0 in place of formulas."""
    return np.array([0.0 if isinstance(each, Formula) else each for each in numbers.flat]).reshape(numbers.shape)
