r"""Straight-line code of a linear step: its statements as a text in Python, which is compiled for a run of many steps.

For a small table most of the time of the kernel is indices and zeros. Arithmetic is that of the statements, one operation
after the other, so that results have the same bits. A law without closed form is solved by a function of Python. A step in
which anything is out of the ordinary, such as an LCP without a solution, is left to the kernel.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterable, Iterator
from ctypes import CFUNCTYPE, c_int64, c_void_p, cast
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from lcpimpact.arrays import Indices, Matrix, Vector
from lcpimpact.compiled import compiled_text
from lcpimpact.expressions import ZERO, Assign, Name, Unless, When, equal, python_lines, select
from lcpimpact.integrators.printed.step import (
    SolveLaw,
    StepStatement,
    StepWriter,
    StoreStatement,
    two_row_law,
    write_step,
)
from lcpimpact.integrators.stepping.banded_table import BandedTable
from lcpimpact.integrators.stepping.kernel import (
    IRREGULAR,
    SOLVED,
    Block,
    Features,
    StepOutput,
    StepState,
    StepTable,
    Ways,
    Workspace,
    solve_rows,
)
from lcpimpact.integrators.stepping.law import Solving
from lcpimpact.integrators.stepping.static_balance import Static
from lcpimpact.interpreter import throughout
from lcpimpact.numerics.rounding import EPS

LineSteps: TypeAlias = Callable[
    [
        int, float, Vector, Vector, Vector, Matrix, Matrix, Matrix, Matrix, Vector, Vector, Vector, Indices,
        Callable[[int], int],
    ],
    int,
]  # fmt: skip
"""Type of the function of a text."""

LawSolver = CFUNCTYPE(c_int64, c_int64)
"""Type of the function law (nc + 1) + number of its active rows -> status that solves a law without closed form."""


def text_of(writer: StepWriter, closed: bool) -> str:
    """Return the text of a function that takes steps, and returns how many: fewer where one is out of the ordinary.

    ``closed`` says whether each law has a closed form. The array ``sums`` gets the largest residual, and the number of
    solutions, of these.
    """
    states, loads = writer.sizes[:2]
    state = [("y", i) for i in range(states)] + [("P", i) for i in range(writer.table.lower.size)]
    keep_state = [f"{array}[{i}] = {array}{i}" for array, i in state]
    step = [line for each in writer.statements for line in _lines(each, writer, closed, keep_state)]
    lines = [
        *(f"{name} = c[{i}]" for i, name in enumerate(writer.coefficients)),
        *(f"{array}{i} = {array}[{i}]" for array, i in state),
        "worst, iterations, largest, solved, done = 0.0, 0.0, 0.0, 0.0, 0",
        "for k in range(steps):",
        *(f"    load{j} = load[k, {j}]" for j in range(loads)),
        *(f"    {line}" for line in step),
        "    largest = worst",
        "    solved = iterations",
        "    done += 1",
        "sums[0] = largest",
        "sums[1] = solved",
        *keep_state,
        "return done",
    ]
    head = "def run(steps, tol, c, y, P, q, v, r, load, free, guess, sums, active, solve):\n"
    return head + "".join(f"    {line}\n" for line in lines)


def _lines(statement: StepStatement, writer: StepWriter, closed: bool, keep_state: Iterable[str]) -> Iterator[str]:
    """Yield the lines of a statement."""
    match statement:
        case Assign(name, value):
            yield str(statement)
            if name == "z" and value != ZERO:  # of a law of one row
                yield "iterations += 1.0"
        case When(condition, then):
            yield f"if {condition}:"
            yield from (f"    {line}" for each in then for line in _lines(each, writer, closed, keep_state))
        case Unless():
            yield from python_lines([statement])
        case StoreStatement(array, column, value):
            yield f"{array}[k, {column}] = {value} + 0.0"  # sums of the kernel begin at zero, without its sign
        case SolveLaw() if closed:
            yield "bad = 0.0"
            yield from python_lines(_two_rows(statement))
        case SolveLaw():
            yield from _solve(statement, keep_state)


def _two_rows(law: SolveLaw) -> Iterator[Assign | When | Unless]:
    """Yield the closed form of a law of two plain rows, and count what its solver would."""
    z, on = [Name(f"z{2 * law.law + i}") for i in range(2)], [Name("on0"), Name("on1")]
    tried = select(equal(z[1], 0.0), select(equal(z[0], 0.0), 1.0, 2.0), select(equal(z[0], 0.0), 3.0, 4.0))
    count = Name("iterations") + select(on[0] & on[1], tried, select(on[0] | on[1], 1.0, 0.0))
    yield from two_row_law(law)
    yield Unless(equal(Name("bad"), 0.0))
    yield Assign("iterations", count)
    worst, w, rounding = map(Name, ("worst", "w", "rounding"))
    for i, q in enumerate(law.q):
        terms = [Name(f"W_{law.law}_{i}_{j}") * z[j] for j in range(2)]
        size = abs(q) + abs(terms[0]) + abs(terms[1])
        seen = (z[i] > 0.0) & (w > rounding) & (w > worst * abs(q))
        yield Assign("w", abs(q + terms[0] + terms[1]))
        yield Assign("rounding", select(on[0] & on[1], 4.0 * EPS, 3.0 * EPS) * size)
        yield When(seen, (Assign("worst", w / abs(q)),))


def _solve(law: SolveLaw, keep_state: Iterable[str]) -> Iterator[str]:
    """Yield a law that the `LawSolver` solves: rows with friction come behind those that bound it, as in the kernel."""
    first = law.law * law.nc
    order = sorted(range(law.nc), key=lambda i: law.normals[i] >= 0)
    for i in order:
        yield f"on{i} = {law.touching[i]}"
        yield f"z{first + i} = 0.0"
    yield f"if {' or '.join(f'on{i}' for i in order)}:"
    lines = [*keep_state, *(f"free[{2 * first + law.nc + i}] = {q}" for i, q in enumerate(law.q)), "na = 0"]
    for i in order:
        lines += [f"at{i} = na", f"active[na] = {i}", f"guess[na] = P{first + i}", f"na += on{i}"]
    lines += [f"if solve({law.law * (law.nc + 1)} + na) != {SOLVED}:", "    break"]
    lines += [f"z{first + i} = guess[at{i}] if on{i} else 0.0" for i in order]
    yield from (f"    {line}" for line in lines)


@dataclass(frozen=True, eq=False)
class StraightLine:
    """The compiled steps of all tables with one pattern.

    Attributes
    ----------
    places : tuple of (array, index)    where the coefficients are found
    run : callable                      takes steps
    closed : bool                       whether each law has a closed form
    """

    places: tuple[tuple[str, tuple[int, ...]], ...]
    run: Any
    closed: bool

    def take(
        self,
        block: Block,
        table: StepTable,
        banded: BandedTable,
        features: Features,
        state: StepState,
        path: StepOutput,
        room: Workspace,
        ways: Ways,
    ) -> tuple[int, int, int, int, float]:
        """Take a block of steps as the kernel does, with its arguments; ``ways`` are functions in the interpreter."""
        first, asked = block.first, block.last - block.first
        nc = table.W.shape[1]
        named = table._asdict() | features[2]._asdict()
        c, sums = np.array([named[name][index] for name, index in self.places]), np.zeros(2)
        solving = Solving(block.tol, block.max_iter, ways.plain)
        plain = len(features[3].rows) == 0 and not block.keeps
        found: list[tuple[int, int, float]] = []
        raised: list[BaseException] = []

        def solve() -> Generator[int, int, None]:
            # A signal that arrives in compiled code raises its error where this goes on: inside of the try.
            try:
                status = SOLVED
                while True:
                    law, na = divmod((yield int(status)), nc + 1)
                    if plain:
                        q = room.sums[2 * law * nc + nc : 2 * (law + 1) * nc]
                        status, iterations, residual = throughout(solve_rows)(table, law, q, na, room, solving)
                        newton = 0
                    else:
                        which = law, na
                        status, iterations, newton, residual = ways.featured(
                            table, features, state, room, which, solving, ways.springs
                        )
                    if status == SOLVED:
                        found.append((iterations, newton, residual))
            except GeneratorExit:
                return
            except BaseException as error:  # noqa: BLE001 (which does not pass through compiled code)
                raised.append(error)
                yield IRREGULAR

        rows = path.q[first + 1 :], path.v[first + 1 :], path.r[first:]
        laws = solve()
        next(laws)
        called = LawSolver(laws.send)
        address = cast(called, c_void_p).value
        given = c, state.y, state.P.reshape(-1), *rows, block.loads, room.sums, room.z, sums, room.active, address
        taken = self.run(asked, block.tol, *given)
        if raised and not isinstance(raised[0], Exception):
            raise raised[0]
        found.append((int(sums[1]), 0, float(sums[0])))
        iterations, newton, residuals = zip(*found, strict=True)
        status = SOLVED if taken == asked else IRREGULAR
        return status, first + taken, sum(iterations), sum(newton), max(residuals)


LINES: dict[tuple[int, bytes], StraightLine] = {}
"""By the number of coordinates and the pattern of the table."""


def compiled_steps(writer: StepWriter, closed: bool) -> Any:
    """Return the compiled function of a step's statements; ``closed`` says whether each law has a closed form."""
    run = compiled_text(text_of(writer, closed), LineSteps, {"INFINITY": math.inf})
    run.resolve()
    return run


def straight_line(
    key: bytes,
    table: StepTable,
    static: Static,
    n: int,
    normals: list[int],
    closed: bool,
    left: int,
    *,
    least: int = 1000,
    least_a_term: int = 8,
    most: int = 1000,
) -> StraightLine | None:
    """Return the compiled code for a table whose `pattern` is the key, if the steps left of a run are worth it.

    ``least``, ``least_a_term``: number of steps that take as long in the interpreter as the compilation, of a small pattern
    and for each term of a large one. ``most``: number of patterns of a process, of which each keeps 0.1 MB or more.
    """
    terms = int(np.count_nonzero(table.known)) + int(np.count_nonzero(table.unknown))
    if (n, key) not in LINES and len(LINES) < most and left >= max(least, least_a_term * terms):
        writer = write_step(table, static, n, normals)
        for law, i, j in np.ndindex(table.W.shape if closed and table.W.shape[1] == 2 else (0, 0, 0)):
            writer.coefficient("W", law, i, j)
        run = compiled_steps(writer, closed)
        LINES[n, key] = StraightLine(tuple(writer.coefficients.values()), run, closed)
    return LINES.get((n, key))
