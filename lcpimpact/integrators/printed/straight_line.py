r"""Straight-line code of a linear step: its statements in Python, compiled for one run of many steps.

For a small table most of the time of the kernel is indices and zeros. A step in which anything is out of the ordinary,
such as an LCP without a solution, is left to the kernel.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from lcpimpact.arrays import Array, Vector
from lcpimpact.compiled import COMPILING, ByAddress, compiled_text, source_file
from lcpimpact.expressions import TRUE, Assign, Unless, When, python_lines
from lcpimpact.integrators.printed.step import SolveLaw, StepStatement, StepWriter, StoreStatement, write_step
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

SHORT_BLOCK = 500
"""Number of steps below which a block is left to the kernel."""

WORTH_COMPILING = 10_000_000
"""Number of steps of one pattern in a process from which straight-line code repays its compilation, of 0.3 s and more."""

WORTH_LOADING = 300_000
"""Number of steps from which it repays being read from the cache, 10 ms."""

IRREGULAR = -2
"""Status of a block that ends before a step out of the ordinary."""

StraightSteps: TypeAlias = Callable[
    [Block, StepTable, Vector, StepState, StepOutput, Workspace, ByAddress[Kernel]], tuple[int, int, int, int, float]
]
"""Type of the function of `python_source`."""


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


def _python(statement: StepStatement) -> list[str]:
    """Return the lines of a statement."""
    match statement:
        case Assign() | When() | Unless():
            return [*python_lines([statement])]
        case StoreStatement(array, column, value):
            return [f"path.{array}[k{'' if array == 'r' else ' + 1'}, {column}] = {value}"]
        case SolveLaw(law, nc, touching, q, _):
            lines = [f"free[{i}] = {name}" for i, name in enumerate(q)] + ["na = 0"]
            for i, condition in enumerate(touching):
                add = [f"room.active[na], room.z[na] = {i}, P{law * nc + i}", "na += 1"]
                lines += add if condition == TRUE else [f"if {condition}:", *(f"    {each}" for each in add)]
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
