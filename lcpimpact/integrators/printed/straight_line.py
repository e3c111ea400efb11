r"""Straight-line code of a linear step: its statements as instructions of LLVM, compiled in 20 ms for a run of many steps.

For a small table most of the time of the kernel is indices and zeros. Arithmetic is that of the statements, one operation
after the other, so that results have the same bits. A law without closed form is solved by a function of Python. A step in
which anything is out of the ordinary, such as an LCP without a solution, is left to the kernel.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from ctypes import CFUNCTYPE, c_double, c_int64, c_void_p, cast
from dataclasses import dataclass
from functools import partial, reduce
from itertools import count

import numpy as np
from llvmlite import ir

from lcpimpact.compiler import machine
from lcpimpact.expressions import (
    ZERO,
    Assign,
    Constant,
    Expression,
    Name,
    Operation,
    Unless,
    When,
    assigned,
    equal,
    select,
)
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

ARRAYS = "c", "y", "P", "q", "v", "r", "load", "free", "z", "sums"
"""Arrays of numbers that the code reads and writes: ``sums`` are those of `COUNTED`."""

COUNTED = "worst", "iterations"
"""The largest residual, and the number of solutions, of laws in closed form."""

REAL, WHOLE = ir.DoubleType(), ir.IntType(64)
INSTRUCTIONS = {"+": "fadd", "-": "fsub", "*": "fmul", "/": "fdiv", "and": "and_", "or": "or_"}

LawSolver = CFUNCTYPE(c_int64, c_int64)
"""Type of the function law (nc + 1) + number of its active rows -> status that solves a law without closed form."""

NUMBERS = count()


class Printer:
    """The instructions of a function that takes steps, and returns how many: fewer where one is out of the ordinary.

    A variable is the value that it has at this place of the code, and a phi where branches meet.

    Parameters
    ----------
    writer : StepWriter
    closed : bool           whether each law has a closed form
    name : str
    """

    def __init__(self, writer: StepWriter, closed: bool, name: str) -> None:
        self.writer = writer
        self.closed = closed
        self.module = ir.Module(name)
        solver = ir.FunctionType(WHOLE, [WHOLE]).as_pointer()
        takes = [WHOLE, REAL, *[REAL.as_pointer()] * len(ARRAYS), WHOLE.as_pointer(), solver]
        self.function = ir.Function(self.module, ir.FunctionType(WHOLE, takes), name)
        steps, tol = self.function.args[:2]
        self.arrays = dict(zip(ARRAYS, self.function.args[2:-2], strict=True))
        self.active, self.solver = self.function.args[-2:]
        self.abs = self.module.declare_intrinsic("llvm.fabs", [REAL])
        states, loads = writer.sizes[:2]
        self.state = [("y", i) for i in range(states)]
        self.state += [("P", i) for i in range(writer.table.lower.size)]
        entry, head = (self.function.append_basic_block() for _ in range(2))
        body, self.end = (self.function.append_basic_block() for _ in range(2))
        self.to = b = ir.IRBuilder(entry)
        self.values = {name: b.load(self.place("c", i)) for i, name in enumerate(writer.coefficients)} | {"tol": tol}
        first = {f"{array}{i}": b.load(self.place(array, i)) for array, i in self.state}
        first |= dict.fromkeys(COUNTED, REAL(0.0))
        b.branch(head)
        b.position_at_end(head)
        self.k = b.phi(WHOLE)
        begun = {name: self.meeting((entry, value)) for name, value in first.items()}
        self.values |= begun
        b.cbranch(b.icmp_signed("<", self.k, steps), body, self.end)
        b.position_at_end(body)
        self.values |= {f"load{j}": b.load(self.place("load", j, loads)) for j in range(loads)}
        self.print(writer.statements)
        self.k.add_incoming(WHOLE(0), entry)
        self.k.add_incoming(b.add(self.k, WHOLE(1)), b.block)
        for name, phi in begun.items():
            phi.add_incoming(self.values[name], b.block)
        b.branch(head)
        b.position_at_end(self.end)
        b.store(begun["worst"], self.place("sums", 0))
        b.store(begun["iterations"], self.place("sums", 1))
        self.keep_state(begun)
        b.ret(self.k)

    def place(self, array: str, column: int, columns: int = 0) -> ir.Value:
        """Return the address of a number in an array, or in the row of this step where it has so many columns."""
        b, index = self.to, WHOLE(column)
        return b.gep(self.arrays[array], [b.add(b.mul(self.k, WHOLE(columns)), index) if columns else index])

    def meeting(self, *ways: tuple[ir.Block, ir.Value]) -> ir.Value:
        """Return the value that a variable has behind each of some blocks."""
        found = self.to.phi(ways[0][1].type)
        for block, value in ways:
            found.add_incoming(value, block)
        return found

    def keep_state(self, values: dict[str, ir.Value]) -> None:
        """Store the state of a step."""
        for array, i in self.state:
            self.to.store(values[f"{array}{i}"], self.place(array, i))

    def print(self, statements: Iterable[StepStatement]) -> None:
        """Print statements."""
        b = self.to
        for each in statements:
            match each:
                case Assign(name, value):
                    self.values[name] = self.value(value)
                    if name == "z" and value != ZERO:  # of a law of one row
                        self.values["iterations"] = b.fadd(self.values["iterations"], REAL(1.0))
                case Unless(condition):
                    self.unless(self.value(condition))
                case When(condition, then):
                    self.when(self.value(condition), {*COUNTED, *assigned(then)}, partial(self.print, then))
                case StoreStatement(array, column, value):
                    columns = self.writer.sizes[2] if array == "r" else self.writer.n
                    # Sums of the kernel begin at zero, without its sign.
                    b.store(b.fadd(self.value(value), REAL(0.0)), self.place(array, column, columns))
                case SolveLaw() if self.closed:
                    self.two_rows(each)
                case SolveLaw():
                    self.solve(each)

    def unless(self, condition: ir.Value) -> None:
        """Print the end of the steps, before this one, where a condition does not hold."""
        on = self.function.append_basic_block()
        self.to.cbranch(condition, on, self.end)
        self.to.position_at_end(on)

    def when(self, condition: ir.Value, changed: Iterable[str], then: Callable[[], None]) -> None:
        """Print what is done under a condition, which changes some variables."""
        inside, after = (self.function.append_basic_block() for _ in range(2))
        before, block = dict(self.values), self.to.block
        self.to.cbranch(condition, inside, after)
        self.to.position_at_end(inside)
        then()
        end, found = self.to.block, self.values
        self.to.branch(after)
        self.to.position_at_end(after)
        self.values = before | {
            name: self.meeting((block, before[name]), (end, found[name])) for name in sorted(changed) if name in before
        }

    def two_rows(self, law: SolveLaw) -> None:
        """Print the closed form of a law of two plain rows, and count what its solver would."""
        self.values["bad"] = REAL(0.0)
        z, on = [Name(f"z{2 * law.law + i}") for i in range(2)], [Name("on0"), Name("on1")]
        tried = select(equal(z[1], 0.0), select(equal(z[0], 0.0), 1.0, 2.0), select(equal(z[0], 0.0), 3.0, 4.0))
        count = Name("iterations") + select(on[0] & on[1], tried, select(on[0] | on[1], 1.0, 0.0))
        self.print([*two_row_law(law), Unless(equal(Name("bad"), 0.0)), Assign("iterations", count)])
        worst, w, rounding = map(Name, ("worst", "w", "rounding"))
        for i, q in enumerate(law.q):
            terms = [Name(f"W_{law.law}_{i}_{j}") * z[j] for j in range(2)]
            size = abs(q) + abs(terms[0]) + abs(terms[1])
            seen = (z[i] > 0.0) & (w > rounding) & (w > worst * abs(q))
            self.print(
                [
                    Assign("w", abs(q + terms[0] + terms[1])),
                    Assign("rounding", select(on[0] & on[1], 4.0 * EPS, 3.0 * EPS) * size),
                    When(seen, (Assign("worst", w / abs(q)),)),
                ]
            )

    def solve(self, law: SolveLaw) -> None:
        """Print a law that the `LawSolver` solves: rows with friction come behind those that bound it, as in the kernel."""
        b, first = self.to, law.law * law.nc
        order = sorted(range(law.nc), key=lambda i: law.normals[i] >= 0)
        on = {i: self.value(law.touching[i]) for i in order}
        names = [f"z{first + i}" for i in range(law.nc)]
        self.values |= dict.fromkeys(names, REAL(0.0))

        def solved() -> None:
            self.keep_state(self.values)
            for i, q in enumerate(law.q):
                b.store(self.value(q), self.place("free", 2 * first + law.nc + i))
            at, active = {}, WHOLE(0)
            for i in order:
                at[i] = active
                b.store(WHOLE(i), b.gep(self.active, [active]))
                b.store(self.values[f"P{first + i}"], b.gep(self.arrays["z"], [active]))
                active = b.add(active, b.zext(on[i], WHOLE))
            status = b.call(self.solver, [b.add(WHOLE(law.law * (law.nc + 1)), active)])
            self.unless(b.icmp_signed("==", status, WHOLE(SOLVED)))
            for i, name in enumerate(names):
                self.values[name] = b.select(on[i], b.load(b.gep(self.arrays["z"], [at[i]])), REAL(0.0))

        self.when(reduce(b.or_, on.values()), names, solved)

    def value(self, node: Expression) -> ir.Value:
        """Return the value of an expression."""
        b = self.to
        match node:
            case Name(name):
                return self.values[name]
            case Constant("True"):
                return ir.IntType(1)(1)
            case Constant(text):
                return REAL(float(text))
            case Operation("-", (operand,)):
                return b.fneg(self.value(operand))
            case Operation("not", (operand,)):
                return b.not_(self.value(operand))
            case Operation("abs", (operand,)):
                return b.call(self.abs, [self.value(operand)])
            case Operation("if", operands):
                return b.select(*map(self.value, operands))
            case Operation("max" | "min" as name, operands):
                first, other = map(self.value, operands)
                return b.select(b.fcmp_ordered(">" if name == "max" else "<", other, first), other, first)
            case Operation(name, operands) if name in INSTRUCTIONS:
                return reduce(getattr(b, INSTRUCTIONS[name]), map(self.value, operands))
            case Operation("<" | "<=" | ">" | ">=" | "==" as name, operands):
                return b.fcmp_ordered(name, *map(self.value, operands))
        raise TypeError(f"{node!r} has no instructions")


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
    run: Callable[..., int]
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
        c, sums = np.array([named[name][index] for name, index in self.places]), np.zeros(len(COUNTED))
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
        arrays = c, state.y, state.P, *rows, block.loads, room.sums, room.z, sums, room.active
        laws = solve()
        next(laws)
        called = LawSolver(laws.send)
        taken = self.run(asked, block.tol, *(each.ctypes.data for each in arrays), cast(called, c_void_p))
        if raised and not isinstance(raised[0], Exception):
            raise raised[0]
        found.append((int(sums[1]), 0, float(sums[0])))
        iterations, newton, residuals = zip(*found, strict=True)
        status = SOLVED if taken == asked else IRREGULAR
        return status, first + taken, sum(iterations), sum(newton), max(residuals)


LINES: dict[tuple[int, bytes], StraightLine] = {}
"""By the number of coordinates and the pattern of the table."""


def compiled_steps(writer: StepWriter, closed: bool) -> Callable[..., int]:
    """Return the compiled function of a step's statements; ``closed`` says whether each law has a closed form."""
    name = f"steps_{next(NUMBERS)}"
    machine.load(machine.machine_code(str(Printer(writer, closed, name).module), passes=False), {})
    return CFUNCTYPE(c_int64, c_int64, c_double, *[c_void_p] * (len(ARRAYS) + 2))(machine.address_of(name))


def straight_line(
    key: bytes,
    table: StepTable,
    static: Static,
    n: int,
    normals: list[int],
    closed: bool,
    left: int,
    *,
    least: int = 500,
    least_a_term: int = 4,
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
