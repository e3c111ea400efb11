r"""The compiled loop of all methods with linear steps.

The *knowns* of a step are the state y, the constant 1 and the loads. Its *unknowns* are, for each law of the rows, the
impulses P of the rows and the forces s of the non-linear springs. Every quantity of the step is a row of a table with
one column for each of these numbers: in turn for each law

- the activation of the nc rows, of which a contact is active where it is negative,
- L of the law 0 <= P ⟂ L >= 0 (nc rows),
- the rates and the penetrations of the springs in this law (ns rows each),

then the new state (N rows), the reactions (nc rows), and the residual forces at the quasi-static coordinates. The loop adds
the columns of the knowns, and those of the unknowns once they are solved.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from typing import NamedTuple, TypeAlias

import numpy as np

from lcpimpact.arrays import Flags, Indices, Matrix, Stack, Vector
from lcpimpact.compiled import ByAddress, compiled, function_at
from lcpimpact.errors import Status
from lcpimpact.integrators.stepping.banded_table import DENSE, BandedTable, find_rows
from lcpimpact.integrators.stepping.impulse_paths import Paths
from lcpimpact.integrators.stepping.kept_basis import KeptBasis
from lcpimpact.integrators.stepping.law import (
    ContactProblem,
    Solving,
    SpringRoom,
    SpringSolver,
    room_for_springs,
    solve_active,
    solve_law,
)
from lcpimpact.integrators.stepping.static_balance import Static, balance
from lcpimpact.lcp.friction import FrictionRows
from lcpimpact.lcp.solver import Kernel

SOLVED = int(Status.SOLVED)
NON_FINITE = int(Status.NON_FINITE)

IRREGULAR = -2
"""Status of a block of straight-line code that ends before a step out of the ordinary."""

NO_SPRINGS = room_for_springs(0, 0)

FEW_IMPULSES = 16
"""Number of impulses of a banded step up to which adding their dense columns is faster than to solve its equations again."""

SWITCHES = -1
"""Status of steps that stop at a change of the active contacts."""

UNWATCHED: Indices = np.zeros(0, dtype=np.int64)
"""The watched contacts of steps with one table."""


class Watched(IntEnum):
    """States of a watched contact or spring, which choose the table of a step; 0 of others.

    A contact is open or closed, and with restitution apart, or struck in this step. A spring is apart, or a step ends its
    blow with the weight 1/θ_k = 1 + i/n, n = `strong_dashpots.WEIGHTS`: then its state is BLOW + i.
    """

    OPEN = 1
    CLOSED = 2
    APART = 3
    STRUCK = 4
    BLOW = 5


class StepTable(NamedTuple):
    """The coefficients of a step of one length.

    Attributes
    ----------
    known : (N + 1 + nl, rows) array        columns of y, 1 and the loads
    unknown : (m (nc + ns), rows) array     columns of P and s of each law
    W : (m, nc, nc) array                   L by P of each law
    lower, upper : (m, nc) arrays           bounds of P
    strictly : (m,) array                   whether a contact needs a negative activation, zero not being enough
    near : (m, nc) array                    gap by P up to which a contact that has just pushed takes part, as rounding
                                            may have opened it
    """

    known: Matrix
    unknown: Matrix
    W: Stack
    lower: Matrix
    upper: Matrix
    strictly: Flags
    near: Matrix


class StepSprings(NamedTuple):
    """The non-linear springs: the row of each (ns, 9), θh in s of each law (m,), and h.

    N (ns, n) are their rows at masses and prescribed motions, ``light`` (ns, n) at prescribed motions and plates, and 1/m
    (ns,) the mobilities between ends of which a step may make a throw of a blow, else 0.
    """

    law: Matrix
    θh: Vector
    h: float
    N: Matrix
    light: Matrix
    mobility: Vector


class StepState(NamedTuple):
    """State carried from step to step.

    Attributes
    ----------
    y : (N,) array
    P : (m, nc) array       the impulses of each law, 0 at inactive rows
    kept : KeptBasis        the basis of the last LCP, where it is kept
    """

    y: Vector
    P: Matrix
    kept: KeptBasis


class StepOutput(NamedTuple):
    """Results of the steps: q[k + 1] and v[k + 1] (n,), and the mean forces r[k] (nc,)."""

    q: Matrix
    v: Matrix
    r: Matrix


class Block(NamedTuple):
    """The steps of a block.

    Attributes
    ----------
    first, last : int       indices of the first and the last instant
    loads : (steps, nl)     variable loads, one row a step
    tol, max_iter           tolerance of the LCP solver, and its limit of iterations
    stops : bool            whether to stop before a step with other active rows than the last one
    keeps : bool            whether the basis of the LCP is kept from step to step
    watched : (nc + ns,)    the states of the contacts and springs that the table assumes, others where one pushes or
                            throws; no entries where there is one table for all
    """

    first: int
    last: int
    loads: Matrix
    tol: float
    max_iter: int
    stops: bool
    keeps: bool
    watched: Indices


class Workspace(NamedTuple):
    """Arrays a step works in: sums (rows,), the active rows of a law (nc,), their z (nc,), spring forces s (ns,).

    Those of banded equations are their knowns and unknowns x, and right sides.
    """

    sums: Vector
    active: Indices
    z: Vector
    s: Vector
    springs: SpringRoom
    x: Vector
    right: Vector


def room_for(table: StepTable, ns: int, banded: BandedTable = DENSE, *, max_rows: int = 3) -> Workspace:
    """Return arrays for the steps of a table with ns springs.

    ``max_rows``: maximum number of rows by which a formulation of friction replaces one of its rows.
    """
    nc = table.W.shape[1]
    springs = room_for_springs(max_rows * nc, ns) if ns else NO_SPRINGS
    right = np.zeros(len(banded.right.c))
    x = np.zeros(len(table.known) + len(table.W) * nc + len(right))
    return Workspace(
        np.zeros(table.known.shape[1]), np.zeros(nc, np.int64), np.zeros(nc), np.zeros(ns), springs, x, right
    )


class Ways(NamedTuple):
    """The functions that solve a law; a step calls them by their addresses, so that only those that it needs are compiled.

    Attributes
    ----------
    plain       the kernel of the LCP solver
    featured    a law with springs, friction or impulse paths, or of many rows from the basis of the last step
    springs     the Newton solver of springs
    """

    plain: ByAddress[Kernel]
    featured: ByAddress[FeaturedSolver]
    springs: ByAddress[SpringSolver]


class StaticFriction(NamedTuple):
    """Static friction above the kinetic one, and its memory in a step; no rows without.

    Attributes
    ----------
    kinetic, static : (nf,) arrays      coefficients of all rows with friction
    H : (nf, n) array                   their rows of U
    U, near : (nf,) arrays              U at the start of the step, 0 for rows that stick, and its rounding
    turned : (nf,) array                whether a row that slides would turn back in the step
    """

    kinetic: Vector
    static: Vector
    H: Matrix
    U: Vector
    near: Vector
    turned: Flags


Features: TypeAlias = tuple[StepSprings, Paths, Static, FrictionRows, StaticFriction]
FeaturedSolver: TypeAlias = Callable[
    [StepTable, Features, StepState, Workspace, tuple[int, int], Solving, SpringSolver], tuple[int, int, int, float]
]
"""Type of `features.solve_features` and `features.solve_kept_rows`."""

kernel_at, featured_at, springs_at = map(function_at, (Kernel, FeaturedSolver, SpringSolver))


@compiled(inline="always")
def copy(source: Vector, target: Vector) -> None:
    """Copy a vector."""
    for i in range(len(target)):
        target[i] = source[i]


@compiled(inline="always")
def add_column(sums: Vector, x: float, columns: Matrix, j: int, first: int) -> None:
    """Add x times column j, from a given row."""
    if x != 0.0:
        for i in range(first, len(sums)):
            sums[i] += x * columns[j, i]


@compiled(inline="always")
def solve_rows(
    table: StepTable, law: int, q: Vector, na: int, room: Workspace, solving: Solving
) -> tuple[int, int, float]:
    """Solve a law on its ``na`` active rows, from the guess in the workspace: status, iterations, residual."""
    rows = ContactProblem(table.W[law], q, table.lower[law], table.upper[law])
    if na < len(q):
        return solve_active(rows, room.active[:na], room.z[:na], solving)
    return solve_law(rows, room.z, solving)


@compiled(inline="always")
def add_impulses(table: StepTable, column: int, na: int, first: int, room: Workspace, P: Vector) -> None:
    """Add the columns of the ``na`` impulses in the workspace, from a given row, and store them in P."""
    for i in range(len(P)):
        P[i] = 0.0
    for a in range(na):
        P[room.active[a]] = room.z[a]
        add_column(room.sums, room.z[a], table.unknown, column + room.active[a], first)


@compiled(inline="always")
def add_knowns(columns: Matrix, y: Vector, loads: Matrix, k: int, sums: Vector) -> None:
    """Write the sums of the columns of y, 1 and the loads of step k."""
    N = len(y)
    for i in range(len(sums)):
        sums[i] = columns[N, i]
    for j in range(N):
        add_column(sums, y[j], columns, j, 0)
    for j in range(loads.shape[1]):
        add_column(sums, loads[k, j], columns, N + 1 + j, 0)


@compiled(inline="always")
def begin_step(table: StepTable, banded: BandedTable, state: StepState, loads: Matrix, k: int, room: Workspace) -> None:
    """Write the rows of step k without impulses."""
    if len(banded.factors) == 0:
        add_knowns(table.known, state.y, loads, k, room.sums)
        return
    x = room.x
    N = len(state.y)
    known = len(table.known)
    copy(state.y, x[:N])
    for j in range(loads.shape[1]):
        x[N + 1 + j] = loads[k, j]
    for j in range(known, known + state.P.size):
        x[j] = 0.0
    find_rows(banded, x, room.right, room.sums)


@compiled(inline="always")
def end_law(
    table: StepTable, banded: BandedTable, law: int, na: int, after: int, room: Workspace, state: StepState
) -> None:
    """Add the impulses of a law to the rows from ``after`` on, and store them in the state."""
    P, ns = state.P[law], len(room.s)
    nc = len(P)
    if len(banded.factors) == 0:
        add_impulses(table, law * (nc + ns), na, after, room, P)
        return
    first = len(table.known) + law * nc
    add_impulses(table, law * nc, na if na <= FEW_IMPULSES else 0, after, room, P)
    for a in range(na):
        P[room.active[a]] = room.z[a]
    copy(P, room.x[first : first + nc])
    if na > FEW_IMPULSES:
        find_rows(banded, room.x, room.right, room.sums)


@compiled(inline="always")
def choose_rows(table: StepTable, law: int, first: int, P: Vector, room: Workspace) -> int:
    """Write the active contacts of a law whose rows begin at ``first``, with P as a guess of z; return their number."""
    na, strictly = 0, table.strictly[law]
    for i in range(len(P)):
        touching = room.sums[first + i]
        if touching < table.near[law, i] * max(P[i], 0.0) or (touching == 0.0 and not strictly):
            room.active[na], room.z[na] = i, P[i]
            na += 1
    return na


@compiled(inline="always")
def add_friction_rows(friction: FrictionRows, na: int, P: Vector, room: Workspace) -> int:
    """Add the rows with friction whose normal rows are among the ``na`` active ones; return the number of all."""
    last = na
    for k in range(len(friction.rows)):
        for a in range(na):
            if room.active[a] == friction.normals[k]:
                room.active[last] = friction.rows[k]
                room.z[last] = P[friction.rows[k]]
                last += 1
    return last


@compiled(inline="always")
def switches(active: Indices, z: Vector, P: Vector) -> bool:
    """Return whether a row becomes active or inactive between impulses P and z of the active ones."""
    changed = False
    for a in range(len(active)):
        changed = changed or (z[a] > 0.0) != (P[active[a]] > 0.0)
    return changed


@compiled(inline="always")
def closes(watched: Indices, active: Indices, z: Vector) -> bool:
    """Mark the watched contacts that are open and push as closed; return whether any does."""
    found = False
    for a in range(len(active)):
        i = active[a]
        if (watched[i] == Watched.OPEN or watched[i] == Watched.APART) and z[a] > 0.0:
            watched[i] = Watched.CLOSED if watched[i] == Watched.OPEN else Watched.STRUCK
            found = True
    return found


@compiled(inline="always")
def throws(watched: Indices, ends: Vector) -> bool:
    """Mark the watched springs that would throw as ended blows; return whether any does."""
    found = False
    first = len(watched) - len(ends)
    for j in range(len(ends)):
        if ends[j] >= 0.0 and watched[first + j] == Watched.APART:
            watched[first + j] = Watched.BLOW + int(ends[j])
            found = True
    return found


@compiled(inline="always")
def opens(watched: Indices, P: Vector) -> bool:
    """Mark the watched contacts that are closed and do not push, and what was struck, as open; return whether any is."""
    found = False
    for i in range(len(watched)):
        if watched[i] >= Watched.BLOW:
            watched[i] = Watched.APART
            found = True
        elif watched[i] == Watched.STRUCK or (watched[i] == Watched.CLOSED and not P[i] > 0.0):
            watched[i] = Watched.APART if watched[i] == Watched.STRUCK else Watched.OPEN
            found = True
    return found


@compiled()
def steps(
    block: Block,
    table: StepTable,
    banded: BandedTable,
    features: Features,
    state: StepState,
    path: StepOutput,
    room: Workspace,
    ways: Ways,
) -> tuple[int, int, int, int, float]:
    """Take a block of steps and overwrite the state; compiled code knows the ways to solve a law by their addresses.

    Returns the status, SWITCHES at a change of the active contacts, the step reached, the sums of the LCP and Newton
    iterations, and the largest independent residual. A block ends early where a watched contact has opened.
    """
    springs, paths, static, friction, _ = features
    sums = room.sums
    active = room.active
    z = room.z
    n = path.q.shape[1]
    nc = table.W.shape[1]
    ns = len(springs.law)
    N = len(state.y)
    m = len(table.W)
    new = m * 2 * (nc + ns)
    forces = new + N
    simple = ns == 0 and len(paths.lines) == 0
    solving = Solving(block.tol, block.max_iter, kernel_at(ways.plain))
    simple = simple and len(friction.rows) == 0 and not block.keeps
    solve_featured = featured_at(ways.featured)
    solve_springs = springs_at(ways.springs)
    may_open = False
    for i in range(len(block.watched)):
        may_open = may_open or block.watched[i] == Watched.CLOSED or block.watched[i] >= Watched.STRUCK
    iterations = 0
    newton = 0
    worst = 0.0
    for k in range(block.first, block.last):
        begin_step(table, banded, state, block.loads, k - block.first, room)
        for law in range(m):
            first = law * 2 * (nc + ns)
            after, P = first + 2 * (nc + ns), state.P[law]
            na = choose_rows(table, law, first, P, room)
            if len(friction.rows) > 0:
                na = add_friction_rows(friction, na, P, room)
            status = SOLVED
            count = 0
            tried = 0
            residual = 0.0
            if simple and na > 0:
                status, count, residual = solve_rows(table, law, sums[first + nc : after], na, room, solving)
            elif na + ns > 0:
                status, count, tried, residual = solve_featured(
                    table, features, state, room, (law, na), solving, solve_springs
                )
            iterations += count
            newton += tried
            if status != SOLVED:
                return status, k, iterations, newton, worst
            worst = max(worst, residual)
            if block.stops and (k == 0 or switches(active[:na], z, P)):
                return SWITCHES, k, iterations, newton, worst
            if len(block.watched) > 0 and closes(block.watched, active[:na], z):
                return SWITCHES, k, iterations, newton, worst
            if len(block.watched) > 0 and ns > 0 and throws(block.watched, room.springs.vectors[8]):
                return SWITCHES, k, iterations, newton, worst
            end_law(table, banded, law, na, after, room, state)
            for j in range(ns):
                add_column(sums, room.s[j], table.unknown, law * (nc + ns) + nc + j, after)
        for i in range(n):
            if not abs(sums[new + i]) < np.inf:
                return NON_FINITE, k, iterations, newton, worst
        copy(sums[forces : forces + nc], path.r[k])
        if len(static.SKS) > 0:
            balance(static, sums[forces + nc :], path.r[k], sums[new : new + n])
        copy(sums[new : new + N], state.y)
        copy(state.y[:n], path.q[k + 1])
        copy(state.y[n : 2 * n], path.v[k + 1])
        if may_open and opens(block.watched, state.P[0]):
            return SOLVED, k + 1, iterations, newton, worst
    return SOLVED, block.last, iterations, newton, worst
