r"""The statements of a linear step, written from the non-zeros of its table, as nodes that know no language.

The kernel of `lcpimpact.integrators.stepping.kernel` runs any table by loops over its rows and columns. Here every row is
one sum of named scalars, in the same order, so that results have the same bits.

Covered are steps without non-linear springs and impulse paths. A law of one row is solved in closed form; larger ones, and
those with friction, which only some printers take, are left to a solver, or of two plain rows to `two_rows`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import reduce
from operator import add
from typing import TypeAlias

import numpy as np

from lcpimpact.expressions import (
    TRUE,
    ZERO,
    Assign,
    Expression,
    Name,
    Statement,
    Unless,
    When,
    equal,
    every,
    expression,
    finite,
    in_turn,
    largest,
    replaced,
    select,
    smallest,
)
from lcpimpact.integrators.stepping.kernel import StepTable
from lcpimpact.integrators.stepping.static_balance import Static
from lcpimpact.interpreter import interpreted
from lcpimpact.lcp.solvers.closed_form import TwoRows, two_rows
from lcpimpact.numerics.rounding import EPS
from lcpimpact.record import SLIP_RTOL

MAX_TERMS = 2_000
"""Maximum number of terms in the sums of a step; a larger table is no faster as straight-line code."""

ROUNDED = Name("rounding") <= Name("tol") * Name("size")
"""The condition that the residual of a row is known well enough to be judged."""


@dataclass(frozen=True)
class SolveLaw:
    """Solve a law of nc rows by the LCP solver, from q, the conditions of activation, and the normal rows of friction."""

    law: int
    nc: int
    touching: tuple[Expression, ...]
    q: tuple[Name, ...]
    normals: tuple[int, ...]


@dataclass(frozen=True)
class StoreStatement:
    """Record q or v at the end of the step, or the mean force r of the step."""

    array: str
    column: int
    value: Name


StepStatement: TypeAlias = Statement | SolveLaw | StoreStatement


@dataclass
class StepWriter:
    """Statements of one step of a table, and the coefficients that they name.

    Attributes
    ----------
    normals : tuple of int                          the row that bounds the friction of each row; -1 of other rows
    coefficients : dict of str to (array, index)    where the value of each named coefficient is found
    statements : list of StepStatement
    """

    table: StepTable
    static: Static
    n: int
    normals: tuple[int, ...] = ()
    coefficients: dict[str, tuple[str, tuple[int, ...]]] = field(default_factory=dict)
    statements: list[StepStatement] = field(default_factory=list)

    @property
    def sizes(self) -> tuple[int, int, int, int]:
        """The numbers of state variables, loads, contacts and laws."""
        laws, nc, _ = self.table.W.shape
        rows = self.table.known.shape[1]
        knowns = self.table.known.shape[0]
        states = rows - 2 * laws * nc - nc - len(self.static.SKS)
        return states, knowns - states - 1, nc, laws

    def coefficient(self, array: str, *index: int) -> Name:
        """Return the name of a coefficient."""
        name = f"{array}_{'_'.join(map(str, index))}"
        self.coefficients[name] = array, index
        return Name(name)

    def term(self, array: str, value: float, index: tuple[int, ...], factor: Name) -> Expression:
        """Return a coefficient times a factor, which for 1 and -1 is the factor itself."""
        if abs(value) == 1.0:
            return factor if value > 0.0 else -factor
        return self.coefficient(array, *index) * factor

    def row(self, row: int, laws: int) -> Expression:
        """Return a row of the table as a sum of the knowns and the impulses of the first laws."""
        known, unknown = self.table.known, self.table.unknown
        states, loads, nc, _ = self.sizes
        found: list[Expression] = []
        if known[states, row] != 0.0:
            found.append(self.coefficient("known", states, row))
        knowns = [*((j, Name(f"y{j}")) for j in range(states))]
        knowns += [(states + 1 + j, Name(f"load{j}")) for j in range(loads)]
        found += [self.term("known", known[j, row], (j, row), name) for j, name in knowns if known[j, row] != 0.0]
        found += [
            self.term("unknown", unknown[j, row], (j, row), Name(f"z{j}"))
            for j in range(laws * nc)
            if unknown[j, row] != 0.0
        ]
        return reduce(add, found) if found else ZERO


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
    write = writer.statements.append
    for i in range(states):
        write(Assign(f"new{i}", writer.row(new + i, laws)))
    for i in range(nc):
        write(Assign(f"r{i}", writer.row(new + states + i, laws)))
    write(Unless(every(finite(Name(f"new{i}")) for i in range(n))))
    if len(static.SKS):
        writer.statements += _balance(writer, writer.row(new + states + nc, laws))
    for i in range(states):
        write(Assign(f"y{i}", Name(f"new{i}")))
    for j in range(laws * nc):
        write(Assign(f"P{j}", Name(f"z{j}")))
    for i in range(n):
        writer.statements += [
            StoreStatement("q", i, Name(f"y{i}")), StoreStatement("v", i, Name(f"y{n + i}"))
        ]  # fmt: skip
    writer.statements += [StoreStatement("r", i, Name(f"r{i}")) for i in range(nc)]
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


def _law(writer: StepWriter, law: int) -> Iterator[StepStatement]:
    """Yield the solution of a law: the impulses P of its rows."""
    _, _, nc, _ = writer.sizes
    first = 2 * law * nc
    q = tuple(Name(f"free{i}") for i in range(nc))
    for i in range(nc):
        yield Assign(q[i].name, writer.row(first + nc + i, law))
    # Friction is active where its normal row is.
    touching = [_activation(writer, law, i if normal < 0 else normal) for i, normal in enumerate(writer.normals)]
    if nc == 1:
        yield from _one_row(writer, law, touching[0])
    elif nc > 1:
        yield SolveLaw(law, nc, tuple(touching), q, writer.normals)


def _activation(writer: StepWriter, law: int, i: int) -> Expression:
    """Return the condition that a row is active."""
    table = writer.table
    states, _, nc, _ = writer.sizes
    row, P = 2 * law * nc + i, Name(f"P{law * nc + i}")
    varying = np.delete(table.known[:, row], states).any() or table.unknown[: law * nc, row].any()
    if not varying and table.known[states, row] < 0.0:
        return TRUE
    touching = writer.row(row, law)
    near = writer.coefficient("near", law, i) * largest(P, 0.0) if table.near[law, i] > 0.0 else ZERO
    return touching < near if table.strictly[law] else (touching < near) | equal(touching, 0.0)


def _one_row(writer: StepWriter, law: int, touching: Expression) -> Iterator[Statement]:
    """Yield the solution of a law of one row: -q/W between its bounds, and its residual."""
    table, W = writer.table, writer.coefficient("W", law, 0, 0)
    low, high = table.lower[law, 0], table.upper[law, 0]
    q, z = Name("free0"), Name("z")
    w, size, tol, rounding, worst = map(Name, ("w", "size", "tol", "rounding", "worst"))
    within = list[Expression]()
    solution: Expression = -q / W
    if low > -np.inf:
        lower = ZERO if low == 0.0 else writer.coefficient("lower", law, 0)
        solution = largest(solution, lower)
        within.append(z > lower)
    if high < np.inf:
        upper = writer.coefficient("upper", law, 0)
        solution = smallest(solution, upper)
        within.append(z < upper)
    residual = (
        Assign("w", abs(q + W * z)),
        Assign("size", abs(q)),
        Assign("rounding", expression(3.0 * EPS) * (size + W * abs(z))),
        Unless((w <= tol * size) & ROUNDED),
        When((w > rounding) & (w > worst * size), (Assign("worst", w / size),)),
    )
    solved = (Assign("z", solution), *((When(every(within), residual),) if within else residual))
    yield Assign("z", ZERO)
    yield from solved if touching == TRUE else (When(touching, solved),)
    yield Assign(f"z{law}", z)


def _balance(writer: StepWriter, unbalanced: Expression) -> Iterator[Statement]:
    """Yield the shift of one quasi-static coordinate until its forces balance, unless a row holds it."""
    static = writer.static
    if static.SKS[0, 0] == 0.0:
        return
    yield Assign("unbalanced", unbalanced)
    free = []
    for i in map(int, np.flatnonzero(static.HS[:, 0])):
        r = Name(f"r{i}")
        if static.r_max[i] < np.inf:
            r_max = writer.coefficient("r_max", i)
            near: Expression = expression(SLIP_RTOL) * r_max
            free.append((r <= writer.coefficient("r_min", i) + near) | (r >= r_max - near))
        else:
            free.append(r <= writer.coefficient("r_min", i) + ZERO)
    S = [writer.coefficient("S", j, 0) for j in range(writer.n)]
    shift = Name("unbalanced") / writer.coefficient("SKS", 0, 0)
    moved = [Assign(f"new{j}", Name(f"new{j}") + S[j] * shift) for j in np.flatnonzero(static.S[:, 0])]
    yield from (When(every(free), tuple(moved)),) if free else moved


def two_row_law(solve: SolveLaw) -> list[Assign]:
    """Return the solution of a law of two plain rows with W_ii > 0 on those that are active, and its check.

    It sets ``bad`` to 1 where no basis has unambiguous signs, or the solution does not hold.
    """
    z = [Name(f"z{2 * solve.law + i}") for i in range(2)]
    W = [[Name(f"W_{solve.law}_{i}_{j}") for j in range(2)] for i in range(2)]
    on = [Name("on0"), Name("on1")]
    found = interpreted(two_rows, select=select)(TwoRows(*W[0], *W[1], *solve.q))  # type: ignore[arg-type]
    positive = {W[i][i] > 0.0: TRUE for i in range(2)}
    x, y, neither, first, second, free = (replaced(expression(each), positive) for each in found)
    both, bad = on[0] & on[1], Name("bad")
    alone = [select(on[i], largest(-solve.q[i] / W[i][i], 0.0), 0.0) for i in range(2)]
    lines = [Assign(on[i].name, solve.touching[i]) for i in range(2)]
    lines += in_turn(
        {
            "bad": select(~both | neither | first | second | free, bad, 1.0),
            z[0].name: select(both, x, alone[0]),
            z[1].name: select(both, y, alone[1]),
        },
        prefix="s",
    )
    w, size, terms, held = map(Name, ("w", "size", "terms", "held"))
    for i in range(2):
        q = solve.q[i]
        a = W[i][0] * z[0]
        b = W[i][1] * z[1]
        pushes = (z[i] > 0.0) & (abs(w) <= size) & (terms <= size)
        lines += [
            Assign("w", q + a + b),
            Assign("size", Name("tol") * abs(q)),
            Assign("terms", expression(4.0 * EPS) * (abs(q) + abs(a) + abs(b))),
            Assign("held", select(equal(z[i], 0.0), w >= -size, pushes)),
            Assign("bad", select(held | ~on[i], bad, 1.0)),
        ]
    return lines
