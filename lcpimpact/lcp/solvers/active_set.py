"""Primal active-set method with Cholesky updates: one row enters or leaves the free set per iteration.

It minimises ½ zᵀ M z + qᵀ z over the box for symmetric positive semidefinite M. Where a contact would make the factor
singular (duplicated contacts, more contacts than coordinates) it moves along the null direction to the next bound; if
there is none, that direction certifies infeasibility.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Flags, Indices, Matrix, Vector
from lcpimpact.compiled import FEW_ROWS, compiled
from lcpimpact.errors import Status
from lcpimpact.lcp.basis import row_roots
from lcpimpact.lcp.operators import Property
from lcpimpact.lcp.solver import CompiledSolver
from lcpimpact.lcp.storage import column
from lcpimpact.lcp.trace import NONE, note
from lcpimpact.numerics.rounding import EPS

SOLVED = int(Status.SOLVED)
RAY = int(Status.RAY)
MAX_ITER = int(Status.MAX_ITER)


class ActiveSet(NamedTuple):
    """The free rows α, and the factor of M_αα.

    Attributes
    ----------
    rows : (n,) indices     α in the order of entry
    free : (n,) flags       whether a row is in α
    basis : (n,) indices    the basis in the form of `note`
    L : (n, n) array        L Lᵀ = M_αα, with one more row where that is singular
    C : (n, n) array        C_j = M_·j, loaded when row j first moves
    loaded : (n,) flags     whether C_j has been loaded
    """

    rows: Indices
    free: Flags
    basis: Indices
    L: Matrix
    C: Matrix
    loaded: Flags


@compiled()
def append(L: Matrix, k: int, rows: Indices, column: Vector, j: int) -> bool:
    """Append row j, given by M_·j, to the Cholesky factor L of M_αα; return False if it depends linearly on α.

    Even then the row of L is written: it holds the direction of zero curvature.
    """
    pivot = rest = column[j]
    for a in range(k):
        total = column[rows[a]]
        for c in range(a):
            total -= L[a, c] * L[k, c]
        L[k, a] = total / L[a, a]
        rest -= L[k, a] * L[k, a]
    if not (rest > 8.0 * (k + 2) * EPS * pivot and rest > 0.0):
        return False
    L[k, k] = np.sqrt(rest)
    return True


@compiled()
def remove(L: Matrix, k: int, p: int) -> None:
    """Delete row and column p from L Lᵀ of order k by Givens rotations."""
    for a in range(p, k - 1):
        for c in range(a + 2):
            L[a, c] = L[a + 1, c]
    for a in range(p, k - 1):
        x, y = L[a, a], L[a, a + 1]
        h = np.sqrt(x * x + y * y)
        cos, sin = x / h, y / h
        L[a, a], L[a, a + 1] = h, 0.0
        for b in range(a + 1, k - 1):
            x, y = L[b, a], L[b, a + 1]
            L[b, a], L[b, a + 1] = cos * x + sin * y, cos * y - sin * x


@compiled()
def back_substitute(L: Matrix, k: int, y: Vector) -> None:
    """Overwrite y with L⁻ᵀ y."""
    for a in range(k - 1, -1, -1):
        y[a] /= L[a, a]
        for c in range(a):
            y[c] -= L[a, c] * y[a]


@compiled()
def forward_substitute(L: Matrix, k: int, y: Vector) -> None:
    """Overwrite y with L⁻¹ y."""
    for a in range(k):
        for c in range(a):
            y[a] -= L[a, c] * y[c]
        y[a] /= L[a, a]


@compiled()
def freedom(z: float, d: float, lower: float, upper: float) -> float:
    """Return the step length along d at which z reaches a bound."""
    if d > 0.0:
        return max(upper - z, 0.0) / d
    return max(z - lower, 0.0) / -d if d < 0.0 else np.inf


@compiled(inline="always")
def enter(active: ActiveSet, k: int, j: int) -> bool:
    """Add row j, whose column is loaded, to the k free rows; return False if it depends linearly on them."""
    rows = active.rows
    free = active.free
    basis = active.basis
    L = active.L
    C = active.C
    independent = append(L, k, rows, C[j], j)
    if independent:
        rows[k] = j
        free[j] = True
        basis[j] = len(rows) + j
    return independent


@compiled(inline="always")
def drop(active: ActiveSet, k: int, a: int) -> None:
    """Remove the a-th of k free rows."""
    rows = active.rows
    free = active.free
    basis = active.basis
    L = active.L
    i = rows[a]
    free[i], basis[i] = False, i
    remove(L, k, a)
    for c in range(a, k - 1):
        rows[c] = rows[c + 1]


@compiled(inline="always")
def load(active: ActiveSet, W: Matrix, j: int) -> None:
    """Load column j of M unless already loaded."""
    if not active.loaded[j]:
        column(W, j, active.C[j])
        active.loaded[j] = True


@compiled(inline="always")
def begin(active: ActiveSet, W: Matrix, lower: Vector, upper: Vector, z: Vector) -> int:
    """Free the rows of the initial guess that lie strictly between their bounds; return their number."""
    k = 0
    for i in range(len(z)):
        z[i] = min(max(z[i], lower[i]), upper[i])
        inside = lower[i] < z[i] < upper[i]
        if z[i] != 0.0 or inside:
            load(active, W, i)
        if inside and enter(active, k, i):
            k += 1
    return k


@compiled(inline="always")
def add_bounds(C: Matrix, free: Flags, q: Vector, z: Vector, base: Vector) -> None:
    """Set ``base`` to q plus the contribution to M z of the rows at their bounds."""
    n = len(q)
    for i in range(n):
        base[i] = q[i]
    for j in range(n):
        if not free[j] and z[j] != 0.0:
            for i in range(n):
                base[i] += z[j] * C[j, i]


@compiled(inline="always")
def add_free(C: Matrix, rows: Indices, base: Vector, z: Vector, root: Vector, w: Vector) -> float:
    """Set w to ``base`` plus the contribution of the free rows; return Σ |z| scaled to a unit diagonal."""
    n, terms = len(w), 0.0
    for i in range(n):
        w[i] = base[i]
        terms += root[i] * abs(z[i])
    for a in range(len(rows)):
        j = rows[a]
        for i in range(n):
            w[i] += z[j] * C[j, i]
    return terms


@compiled(inline="always")
def minimise(
    L: Matrix, rows: Indices, base: Vector, lower: Vector, upper: Vector, z: Vector, y: Vector
) -> tuple[float, int]:
    """Move z_α towards y = -M_αα⁻¹ base_α until a bound blocks; return the step length and the blocking row or NONE."""
    k = len(rows)
    for a in range(k):
        y[a] = -base[rows[a]]
    forward_substitute(L, k, y)
    back_substitute(L, k, y)
    length, block = 1.0, NONE
    for a in range(k):
        i = rows[a]
        if y[a] < lower[i] or y[a] > upper[i]:
            share = freedom(z[i], y[a] - z[i], lower[i], upper[i])
            if share < length or block == NONE:
                length, block = min(share, 1.0), a
    for a in range(k):
        i = rows[a]
        z[i] = min(max(z[i] + length * (y[a] - z[i]) if length < 1.0 else y[a], lower[i]), upper[i])
    return length, block


@compiled()
def excess(z: float, w: float, lower: float, upper: float) -> float:
    """Return the magnitude by which w violates its sign condition."""
    if w < 0.0:
        return -w if z < upper else 0.0
    return w if z > lower else 0.0


@compiled(inline="always")
def most_wrong(
    free: Flags, z: Vector, w: Vector, lower: Vector, upper: Vector, root: Vector, rounding: float, first: bool
) -> int:
    """Return the row at a bound with the largest scaled sign violation of w, or the first; NONE within rounding error."""
    entering, worst = NONE, rounding
    for i in range(len(z)):
        if not free[i]:
            wrong = excess(z[i], w[i], lower[i], upper[i])
            if wrong > worst * root[i]:
                entering, worst = i, wrong / root[i]
                if first:
                    return i
    return entering


@compiled()
def slightly_wrong(active: ActiveSet, q: Vector, z: Vector, w: Vector, lower: Vector, upper: Vector) -> int:
    """Return the first row whose w violates its sign by more than the rounding error of its own terms.

    A value below the rounding error of the largest terms may be significant in a row of small ones.
    """
    C = active.C
    for i in range(len(z)):
        if not active.free[i] and excess(z[i], w[i], lower[i], upper[i]) > 0.0:
            own = abs(q[i])
            for j in range(len(z)):
                if z[j] != 0.0:
                    own += abs(z[j] * C[j, i])
            if abs(w[i]) > 64.0 * EPS * own:
                return i
    return NONE


@compiled()
def slide(
    active: ActiveSet, k: int, e: int, sign: float, lower: Vector, upper: Vector, z: Vector, y: Vector
) -> tuple[float, int]:
    """Move along the null direction d, d_e = sign and M d = 0, until a bound blocks.

    Returns the step length and the blocking row, k for e itself. The objective decreases linearly along d; if no bound
    blocks, z is set to d.
    """
    rows = active.rows
    L = active.L
    for a in range(k):
        y[a] = -sign * L[k, a]
    back_substitute(L, k, y)
    length, block = freedom(z[e], sign, lower[e], upper[e]), k
    for a in range(k):
        i = rows[a]
        share = freedom(z[i], y[a], lower[i], upper[i])
        if share < length:
            length, block = share, a
    if length == np.inf:
        z[:] = 0.0
    for a in range(k):
        i = rows[a]
        z[i] = y[a] if length == np.inf else min(max(z[i] + length * y[a], lower[i]), upper[i])
    if length == np.inf:
        z[e] = sign
    elif block == k:
        z[e] = upper[e] if sign > 0.0 else lower[e]
    else:
        i = rows[block]
        z[e] = min(max(z[e] + length * sign, lower[e]), upper[e])
        z[i] = upper[i] if y[block] > 0.0 else lower[i]
    return length, block


class DescentWorkspace(NamedTuple):
    """Vectors (n,): the part of w from rows at their bounds, w, the minimiser over the free rows, and sqrt(M_ii)."""

    base: Vector
    w: Vector
    y: Vector
    root: Vector


@compiled()
def descend(
    W: Matrix,
    q: Vector,
    lower: Vector,
    upper: Vector,
    z: Vector,
    max_iter: int,
    active: ActiveSet,
    room: DescentWorkspace,
) -> tuple[int, int]:
    """Minimise over the free rows, drop the first blocking row, and enter the row with the largest violation of w."""
    rows = active.rows
    free = active.free
    basis = active.basis
    L = active.L
    C = active.C
    base = room.base
    w = room.w
    y = room.y
    root = room.root
    n = len(q)
    size = row_roots(W, q, root)
    k = begin(active, W, lower, upper, z)
    entering = NONE
    leaving = NONE
    stalled = 0
    fine = 2 * n
    for step in range(1, max_iter + 1):
        add_bounds(C, free, q, z, base)
        length, block = minimise(L, rows[:k], base, lower, upper, z, y)
        if block != NONE:
            i = rows[block]
            note(z, basis, entering, n + i)
            z[i] = lower[i] if y[block] < lower[i] else upper[i]
            drop(active, k, block)
            k -= 1
            entering = NONE
            continue
        terms = add_free(C, rows[:k], base, z, root, w)
        note(z, basis, entering, leaving)

        e = most_wrong(free, z, w, lower, upper, root, 1e-14 * size + 8.0 * EPS * terms, stalled > n)
        if e == NONE and fine > 0:
            e = slightly_wrong(active, q, z, w, lower, upper)
            fine -= 1
        if e == NONE:
            return SOLVED, step
        entering, leaving = n + e, e
        stalled = stalled + 1 if length == 0.0 else 0
        load(active, W, e)
        if enter(active, k, e):
            k += 1
            continue
        length, block = slide(active, k, e, 1.0 if w[e] < 0.0 else -1.0, lower, upper, z, y)
        if length == np.inf:
            return RAY, step
        stalled = stalled + 1 if length == 0.0 else 0
        if block < k:
            leaving = n + rows[block]
            drop(active, k, block)
            k -= 1
            if enter(active, k, e):
                k += 1
    return MAX_ITER, max_iter


@compiled(most=FEW_ROWS)
def active_set(
    W: Matrix, q: Vector, lower: Vector, upper: Vector, z: Vector, tol: float, max_iter: int
) -> tuple[int, int]:
    """Allocate the workspace and `descend` from the initial guess.

    Rows of the guess strictly between their bounds are free initially. Tolerances refer to the problem scaled to a unit
    diagonal, plus the rounding error of a product. After n exchanges without decrease the first violated row enters.
    """
    n = len(q)
    rows = np.empty(n, np.int64)
    free = np.zeros(n, np.bool_)
    basis = np.arange(n)
    loaded = np.zeros(n, np.bool_)
    active = ActiveSet(rows, free, basis, np.empty((n, n)), np.empty((n, n)), loaded)
    return descend(
        W, q, lower, upper, z, max_iter, active, DescentWorkspace(np.empty(n), np.empty(n), np.empty(n), np.empty(n))
    )


SOLVER = CompiledSolver(
    name="active-set",
    summary="active set with an updated Cholesky factor; semidefinite M, warm starts, and operators by their factors",
    requires=(Property.SYMMETRIC, Property.PSD),
    storages=("dense", "banded", "factored"),
    boxed=True,
    tol=1e-10,
    max_iter=10_000,
    source="LawsonHanson1995, chapter 23; NocedalWright2006, section 16.5",
    kernel=active_set,
)
