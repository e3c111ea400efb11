r"""Straight-line code of a linear step, written from the non-zeros of its table.

The kernel of `lcpimpact.integrators.stepping.kernel` runs any table by loops over its rows and columns. For a small table
most of their time is indices and zeros: here every row is one sum of named scalars, in the same order, so that results have
the same bits. The statements know no language; `python_source` prints them for the compiler.

Covered are steps without non-linear springs and impulse paths. A law of one row, or of two plain rows, is solved in closed
form; larger ones, and those with friction, which only some printers take, are left to a solver. A step in which anything is
out of the ordinary, such as an LCP without a solution, is left to the kernel.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from lcpimpact.arrays import Array, Vector
from lcpimpact.compiled import COMPILING, ByAddress, compiled_text, source_file
from lcpimpact.integrators.stepping.kernel import (
    SOLVED,
    Block,
    StepOutput,
    StepState,
    StepTable,
    Workspace,
    kernel_at,
    solve_rows,
)
from lcpimpact.integrators.stepping.law import Solving
from lcpimpact.integrators.stepping.static_balance import Static
from lcpimpact.lcp.solver import Kernel
from lcpimpact.numba_types import numba_type
from lcpimpact.numerics.rounding import EPS
from lcpimpact.record import SLIP_RTOL

SHORT_BLOCK = 500
"""Number of steps below which a block is left to the kernel."""

MAX_TERMS = 2_000
"""Maximum number of terms in the sums of a step; a larger table is no faster as straight-line code."""

WORTH_COMPILING = 10_000_000
"""Number of steps of one pattern in a process from which straight-line code repays its compilation, of 0.3 s and more."""

WORTH_LOADING = 300_000
"""Number of steps from which it repays being read from the cache, 10 ms."""

IRREGULAR = -2
"""Status of a block that ends before a step out of the ordinary."""

ROUNDED = "rounding <= tol * size"
"""The condition that the residual of a row is known well enough to be judged."""

StraightSteps: TypeAlias = Callable[
    [Block, StepTable, Vector, StepState, StepOutput, Workspace, ByAddress[Kernel]], tuple[int, int, int, int, float]
]
"""Type of the function of `python_source`."""


@dataclass(frozen=True)
class Set:
    """name = value."""

    name: str
    value: str


@dataclass(frozen=True)
class When:
    """Statements under a condition, in which "and" and "or" join comparisons."""

    condition: str
    then: tuple[Statement, ...]


@dataclass(frozen=True)
class Unless:
    """End before this step, which is out of the ordinary, unless a condition holds."""

    condition: str


@dataclass(frozen=True)
class SolveLaw:
    """Solve a law of nc rows by the LCP solver, from q, the conditions of activation, and the normal rows of friction."""

    law: int
    nc: int
    touching: tuple[str, ...]
    q: tuple[str, ...]
    normals: tuple[int, ...]


@dataclass(frozen=True)
class StoreStatement:
    """Record q or v at the end of the step, or the mean force r of the step."""

    array: str
    column: int
    value: str


Statement: TypeAlias = Set | When | Unless | SolveLaw | StoreStatement


@dataclass
class StepWriter:
    """Statements of one step of a table, and the coefficients that they name.

    Attributes
    ----------
    normals : tuple of int                          the row that bounds the friction of each row; -1 of other rows
    coefficients : dict of str to (array, index)    where the value of each named coefficient is found
    statements : list of Statement
    """

    table: StepTable
    static: Static
    n: int
    normals: tuple[int, ...] = ()
    coefficients: dict[str, tuple[str, tuple[int, ...]]] = field(default_factory=dict)
    statements: list[Statement] = field(default_factory=list)

    @property
    def sizes(self) -> tuple[int, int, int, int]:
        """The numbers of state variables, loads, contacts and laws."""
        laws, nc, _ = self.table.W.shape
        rows = self.table.known.shape[1]
        knowns = self.table.known.shape[0]
        states = rows - 2 * laws * nc - nc - len(self.static.SKS)
        return states, knowns - states - 1, nc, laws

    def coefficient(self, array: str, *index: int) -> str:
        """Return the name of a coefficient."""
        name = f"{array}_{'_'.join(map(str, index))}"
        self.coefficients[name] = array, index
        return name

    def term(self, array: str, value: float, index: tuple[int, ...], factor: str) -> str:
        """Return a coefficient times a factor, which for 1 and -1 is the factor itself."""
        if abs(value) == 1.0:
            return factor if value > 0.0 else f"-{factor}"
        return f"{self.coefficient(array, *index)} * {factor}"

    def row(self, row: int, laws: int) -> str:
        """Return a row of the table as a sum of the knowns and the impulses of the first laws."""
        known, unknown = self.table.known, self.table.unknown
        states, loads, nc, _ = self.sizes
        found = []
        if known[states, row] != 0.0:
            found.append(self.coefficient("known", states, row))
        names = [*((j, f"y{j}") for j in range(states)), *((states + 1 + j, f"load{j}") for j in range(loads))]
        found += [self.term("known", known[j, row], (j, row), name) for j, name in names if known[j, row] != 0.0]
        found += [
            self.term("unknown", unknown[j, row], (j, row), f"z{j}") for j in range(laws * nc) if unknown[j, row] != 0.0
        ]
        return " + ".join(found) or "0.0"


def finite(name: str) -> str:
    """Return the condition that a number is finite."""
    return f"abs({name}) < INFINITY"


def write_step(table: StepTable, static: Static, n: int, normals: Sequence[int] = ()) -> StepWriter:
    """Return the statements of one step of a table.

    Parameters
    ----------
    table : StepTable
    static : Static     the quasi-static coordinates
    n : int             number of coordinates
    normals : sequence of int, optional
        The row that bounds the friction of each row, -1 of other rows; nothing without friction.
    """
    writer = StepWriter(table, static, n, tuple(normals) or (-1,) * table.W.shape[1])
    states, _, nc, laws = writer.sizes
    for law in range(laws):
        writer.statements += _law(writer, law)
    new = laws * 2 * nc
    add = writer.statements.append
    for i in range(states):
        add(Set(f"new{i}", writer.row(new + i, laws)))
    for i in range(nc):
        add(Set(f"r{i}", writer.row(new + states + i, laws)))
    add(Unless(" and ".join(finite(f"new{i}") for i in range(n))))
    if len(static.SKS):
        writer.statements += _balance(writer, writer.row(new + states + nc, laws))
    for i in range(states):
        add(Set(f"y{i}", f"new{i}"))
    for j in range(laws * nc):
        add(Set(f"P{j}", f"z{j}"))
    for i in range(n):
        writer.statements += [StoreStatement("q", i, f"y{i}"), StoreStatement("v", i, f"y{n + i}")]
    writer.statements += [StoreStatement("r", i, f"r{i}") for i in range(nc)]
    return writer


def covers(table: StepTable, static: Static, springs: int, paths: int) -> bool:
    """Return whether the step of a table can be written as straight-line code, but for its friction."""
    plain = springs == 0 and paths == 0 and len(static.SKS) <= 1
    filled = np.count_nonzero(table.known) + np.count_nonzero(table.unknown)
    return bool(plain and filled <= MAX_TERMS and all(W[0, 0] > 0.0 for W in table.W if len(W) == 1))


def pattern(table: StepTable, static: Static) -> bytes:
    """Return the key of the statements: sizes, signs, and which coefficients are 1, -1 or infinite."""
    arrays = [np.asarray(each, dtype=np.float64) for each in (*table, *static)]
    kinds = [np.sign(a) * np.select([np.abs(a) == 1.0, np.isinf(a)], [2.0, 3.0], 1.0) for a in arrays]
    shapes = repr([a.shape for a in arrays])
    return shapes.encode() + b"".join(kind.astype(np.int8).tobytes() for kind in kinds)


def _law(writer: StepWriter, law: int) -> Iterator[Statement]:
    """Yield the solution of a law: the impulses P of its rows."""
    _, _, nc, _ = writer.sizes
    first = 2 * law * nc
    names = [f"z{law * nc + i}" for i in range(nc)]
    q = [f"free{i}" for i in range(nc)]
    for i in range(nc):
        yield Set(q[i], writer.row(first + nc + i, law))
    # Friction is active where its normal row is.
    touching = [_activation(writer, law, i if normal < 0 else normal) for i, normal in enumerate(writer.normals)]
    if nc == 1:
        yield from _one_row(writer, law, names[0], touching[0])
    elif nc > 1:
        yield SolveLaw(law, nc, tuple(touching), tuple(q), writer.normals)


def _activation(writer: StepWriter, law: int, i: int) -> str:
    """Return the comparison for an active row; "" for a row that is always active."""
    table = writer.table
    states, _, nc, _ = writer.sizes
    row, name = 2 * law * nc + i, f"P{law * nc + i}"
    varying = np.delete(table.known[:, row], states).any() or table.unknown[: law * nc, row].any()
    if not varying and table.known[states, row] < 0.0:
        return ""
    touching = f"({writer.row(row, law)})"
    near = f"{writer.coefficient('near', law, i)} * max({name}, 0.0)" if table.near[law, i] > 0.0 else "0.0"
    return f"{touching} < {near}" if table.strictly[law] else f"{touching} < {near} or {touching} == 0.0"


def _one_row(writer: StepWriter, law: int, name: str, touching: str) -> Iterator[Statement]:
    """Yield the solution of a law of one row: -q/W between its bounds, and its residual."""
    table, W = writer.table, writer.coefficient("W", law, 0, 0)
    low, high = table.lower[law, 0], table.upper[law, 0]
    lower = "0.0" if low == 0.0 else writer.coefficient("lower", law, 0) if low > -np.inf else ""
    upper = writer.coefficient("upper", law, 0) if high < np.inf else ""
    z = f"-free0 / {W}"
    z = f"max({z}, {lower})" if lower else z
    z = f"min({z}, {upper})" if upper else z
    residual = (
        Set("w", f"abs(free0 + {W} * z)"),
        Set("size", "abs(free0)"),
        Set("rounding", f"{3.0 * EPS!r} * (size + {W} * abs(z))"),
        Unless(f"w <= tol * size and {ROUNDED}"),
        When("w > rounding and w > worst * size", (Set("worst", "w / size"),)),
    )
    within = " and ".join([f"z > {lower}"] * bool(lower) + [f"z < {upper}"] * bool(upper))
    solved: tuple[Statement, ...] = (Set("z", z), *((When(within, residual),) if within else residual))
    yield Set("z", "0.0")
    yield from (When(touching, solved),) if touching else solved
    yield Set(name, "z")


def _balance(writer: StepWriter, unbalanced: str) -> Iterator[Statement]:
    """Yield the shift of one quasi-static coordinate until its forces balance, unless a row holds it."""
    static = writer.static
    if static.SKS[0, 0] == 0.0:
        return
    yield Set("unbalanced", unbalanced)
    free = []
    for i in map(int, np.flatnonzero(static.HS[:, 0])):
        near = f"{SLIP_RTOL!r} * {writer.coefficient('r_max', i)}" if static.r_max[i] < np.inf else "0.0"
        high = f" or r{i} >= {writer.coefficient('r_max', i)} - {near}" if static.r_max[i] < np.inf else ""
        free.append(f"(r{i} <= {writer.coefficient('r_min', i)} + {near}{high})")
    S = [writer.coefficient("S", j, 0) for j in range(writer.n)]
    SKS = writer.coefficient("SKS", 0, 0)
    shift = [Set(f"new{j}", f"new{j} + {S[j]} * (unbalanced / {SKS})") for j in np.flatnonzero(static.S[:, 0])]
    yield from (When(" and ".join(free), tuple(shift)),) if free else shift


def python_source(writer: StepWriter) -> str:
    """Return the source of a function that takes a block of steps, as the kernel does."""
    states, loads, nc, laws = writer.sizes
    begin = [
        *(f"{name} = c[{i}]" for i, name in enumerate(writer.coefficients)),
        *(f"y{i} = state.y[{i}]" for i in range(states)),
        *(f"P{law * nc + i} = state.P[{law}, {i}]" for law in range(laws) for i in range(nc)),
        "first, last, tol, worst, iterations = block.first, block.last, block.tol, 0.0, 0",
        "solving = Solving(tol, block.max_iter, kernel_at(solve))",
        f"free, reached, status = room.sums[:{nc}], first, IRREGULAR",
    ]
    step = [f"load{j} = block.loads[k - first, {j}]" for j in range(loads)]
    for statement in writer.statements:
        step += _python(statement)
    end = [
        *(f"state.y[{i}] = y{i}" for i in range(states)),
        *(f"state.P[{law}, {i}] = P{law * nc + i}" for law in range(laws) for i in range(nc)),
        "return status, reached, iterations, 0, worst",
    ]
    lines = [*begin, "for k in range(first, last):", *(f"    {line}" for line in step), "    reached = k + 1"]
    lines += ["if reached == last:", "    status = SOLVED", *end]
    return "def run(block, table, c, state, path, room, solve):\n" + "".join(f"    {line}\n" for line in lines)


def _python(statement: Statement) -> list[str]:
    """Return the lines of a statement."""
    match statement:
        case Set(name, value):
            return [f"{name} = {value}"]
        case When(condition, then):
            return [f"if {condition}:", *(f"    {line}" for each in then for line in _python(each))]
        case Unless(condition):
            return [f"if not ({condition}):", "    break"]
        case StoreStatement(array, column, value):
            return [f"path.{array}[k{'' if array == 'r' else ' + 1'}, {column}] = {value}"]
        case SolveLaw(law, nc, touching, q, _):
            lines = [f"free[{i}] = {name}" for i, name in enumerate(q)] + ["na = 0"]
            for i, condition in enumerate(touching):
                add = [f"room.active[na], room.z[na] = {i}, P{law * nc + i}", "na += 1"]
                lines += [f"if {condition}:", *(f"    {each}" for each in add)] if condition else add
            lines += [
                "if na > 0:",
                f"    code, count, residual = solve_rows(table, {law}, free, na, room, solving)",
                "    if code != SOLVED:",
                "        break",
                "    iterations, worst = iterations + count, max(worst, residual)",
                "free[:] = 0.0",
                "for a in range(na):",
                "    free[room.active[a]] = room.z[a]",
            ]
            return lines + [f"z{law * nc + i} = free[{i}]" for i in range(nc)]


@dataclass(frozen=True, eq=False)
class StraightLine:
    """The compiled steps of all tables with one pattern.

    Attributes
    ----------
    places : tuple of (array, index)    where the coefficients are found
    run : callable                      takes a block of steps, as the kernel does
    """

    places: tuple[tuple[str, tuple[int, ...]], ...]
    run: StraightSteps

    def coefficients(self, table: StepTable, static: Static) -> Array:
        """Return the coefficients of a table with this pattern."""
        arrays = table._asdict() | static._asdict()
        return np.array([arrays[name][index] for name, index in self.places])


@dataclass
class Tally:
    """The steps that tables of one pattern have taken by the kernel, and their straight-line code once it is worth it."""

    steps: int = 0
    writer: StepWriter | None = None
    code: StraightLine | None = None


TALLIES: dict[tuple[int, bytes], Tally] = {}
"""By the number of coordinates and the pattern of the table."""


def straight_line(key: bytes, table: StepTable, static: Static, n: int, steps: int) -> StraightLine | None:
    """Return the compiled code for a table that is about to take some steps, or None while it is not worth its cost.

    The ``key`` is the `pattern` of the table.
    """
    if not COMPILING:
        return None
    tally = TALLIES.setdefault((n, key), Tally())
    tally.steps += steps
    if tally.code is None and tally.steps >= WORTH_LOADING:
        tally.writer = tally.writer or write_step(table, static, n)
        source = python_source(tally.writer)
        if tally.steps >= WORTH_COMPILING or source_file(source).exists():
            names = {"Solving": Solving, "kernel_at": kernel_at, "solve_rows": solve_rows, "np": np, "SOLVED": SOLVED}
            run = compiled_text(
                source, "run", numba_type(StraightSteps).signature, names | {"INFINITY": np.inf, "IRREGULAR": IRREGULAR}
            )
            tally.code = StraightLine(tuple(tally.writer.coefficients.values()), run) if run else None
    return tally.code
