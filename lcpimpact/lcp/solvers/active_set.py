"""Active set with an updated Cholesky factor: one contact enters or leaves at a time.

It minimises ½ zᵀ M z + qᵀ z over the box for symmetric positive semidefinite M. Where a contact would make the factor
singular (duplicated contacts, more contacts than coordinates) it moves along the null direction to the next bound; if
there is none, that direction proves that no solution exists.
"""

from __future__ import annotations

import numpy as np
from numba import types

from lcpimpact.arrays import Array
from lcpimpact.compiled import compiled, f8, i8, matrix, vector
from lcpimpact.errors import Status
from lcpimpact.lcp.lapack import EPS
from lcpimpact.lcp.operators import Property
from lcpimpact.lcp.problem import SIGNATURE
from lcpimpact.lcp.solver import CompiledSolver
from lcpimpact.lcp.storage import column, diagonal
from lcpimpact.lcp.trace import NONE, note

SOLVED, RAY, MAX_ITER = int(Status.SOLVED), int(Status.RAY), int(Status.MAX_ITER)


@compiled(types.boolean(matrix, i8, vector, f8))
def append(L: Array, k: int, row: Array, pivot: float) -> bool:
    """Append a row to L, L Lᵀ = M_αα: ``row`` = M_jα and ``pivot`` = M_jj; return False if j depends on α.

    The row of L is written even then: it holds the direction in which M_αα has no curvature.
    """
    rest = pivot
    for a in range(k):
        total = row[a]
        for c in range(a):
            total -= L[a, c] * L[k, c]
        L[k, a] = total / L[a, a]
        rest -= L[k, a] * L[k, a]
    if not (rest > 8.0 * (k + 2) * EPS * pivot and rest > 0.0):
        return False
    L[k, k] = np.sqrt(rest)
    return True


@compiled(types.void(matrix, i8, i8))
def remove(L: Array, k: int, p: int) -> None:
    """Take row and column p out of L Lᵀ of order k, by rotations of neighbouring columns."""
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


@compiled(types.void(matrix, i8, vector))
def back_substitute(L: Array, k: int, y: Array) -> None:
    """Overwrite y with L⁻ᵀ y."""
    for a in range(k - 1, -1, -1):
        y[a] /= L[a, a]
        for c in range(a):
            y[c] -= L[a, c] * y[a]


@compiled(types.void(matrix, i8, vector))
def forward_substitute(L: Array, k: int, y: Array) -> None:
    """Overwrite y with L⁻¹ y."""
    for a in range(k):
        for c in range(a):
            y[a] -= L[a, c] * y[c]
        y[a] /= L[a, a]


@compiled(f8(f8, f8, f8, f8))
def room(z: float, d: float, lower: float, upper: float) -> float:
    """Return how far z may go along d before it meets a bound."""
    if d > 0.0:
        return max(upper - z, 0.0) / d
    return max(z - lower, 0.0) / -d if d < 0.0 else np.inf


@compiled(SIGNATURE)
def active_set(W: Array, q: Array, lower: Array, upper: Array, z: Array, tol: float, max_iter: int) -> tuple[int, int]:
    """Minimise over the free rows, drop the first that meets a bound, and let in the one whose w is most wrong.

    The rows of a guess that lie between their bounds are free from the start. Thresholds are those of the problem scaled to
    a unit diagonal, with the rounding of a product added. After n exchanges without progress the first wrong row enters.
    """
    n = len(q)
    rows, basis = np.empty(n, np.int64), np.arange(n)
    free, loaded = np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    C, L = np.empty((n, n)), np.empty((n, n))  # C_j = M_·j, read when row j first moves
    base, w, y, root, picked = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    unshifted = np.zeros(n)
    diagonal(W, root)
    widest = 0.0
    for i in range(n):
        widest = max(widest, root[i])
    size = 0.0
    for i in range(n):
        root[i] = np.sqrt(root[i] if root[i] > 0.0 else (widest if widest > 0.0 else 1.0))
        size = max(size, abs(q[i]) / root[i])
        z[i] = min(max(z[i], lower[i]), upper[i])

    k, entering, leaving, stalled, fine = 0, NONE, NONE, 0, 2 * n
    for i in range(n):
        if z[i] != 0.0 or lower[i] < z[i] < upper[i]:
            column(W, i, C[i])
            loaded[i] = True
        if lower[i] < z[i] < upper[i]:
            for a in range(k):
                picked[a] = C[i, rows[a]]
            if append(L, k, picked, C[i, i]):
                rows[k] = i
                k += 1
                free[i] = True
                basis[i] = n + i

    for step in range(1, max_iter + 1):
        for i in range(n):
            base[i] = q[i]
        for j in range(n):
            if not free[j] and z[j] != 0.0:
                for i in range(n):
                    base[i] += z[j] * C[j, i]
        for a in range(k):
            y[a] = -base[rows[a]]
        forward_substitute(L, k, y)
        back_substitute(L, k, y)
        length, block = 1.0, NONE
        for a in range(k):
            i = rows[a]
            if y[a] < lower[i] or y[a] > upper[i]:
                share = room(z[i], y[a] - z[i], lower[i], upper[i])
                if share < length or block == NONE:
                    length, block = min(share, 1.0), a
        for a in range(k):
            i = rows[a]
            z[i] = min(max(z[i] + length * (y[a] - z[i]) if length < 1.0 else y[a], lower[i]), upper[i])
        if block != NONE:
            i = rows[block]
            note(z, basis, entering, n + i, unshifted)
            z[i] = lower[i] if y[block] < lower[i] else upper[i]
            remove(L, k, block)
            for a in range(block, k - 1):
                rows[a] = rows[a + 1]
            k -= 1
            free[i] = False
            basis[i] = i
            entering = NONE
            continue

        terms = 0.0
        for i in range(n):
            w[i] = base[i]
            terms += root[i] * abs(z[i])
        for a in range(k):
            j = rows[a]
            for i in range(n):
                w[i] += z[j] * C[j, i]
        rounding = 1e-14 * size + 8.0 * EPS * terms
        note(z, basis, entering, leaving, unshifted)
        entering, worst = NONE, rounding
        for i in range(n):
            if not free[i]:
                wrong = (-w[i] if z[i] < upper[i] else 0.0) if w[i] < 0.0 else (w[i] if z[i] > lower[i] else 0.0)
                if wrong > worst * root[i]:
                    entering = i
                    if stalled > n:
                        break
                    worst = wrong / root[i]
        # What is rounding beside the largest terms may be all that a row of small ones has.
        for i in range(n):
            if entering != NONE or fine == 0:
                break
            if not free[i] and (w[i] < 0.0 if z[i] < upper[i] else w[i] > 0.0 and z[i] > lower[i]):
                own = abs(q[i])
                for j in range(n):
                    if z[j] != 0.0:
                        own += abs(z[j] * C[j, i])
                if abs(w[i]) > 64.0 * EPS * own:
                    entering = i
                    fine -= 1
        if entering == NONE:
            return SOLVED, step
        e = entering
        entering, leaving = n + e, e
        stalled = stalled + 1 if length == 0.0 else 0
        if not loaded[e]:
            column(W, e, C[e])
            loaded[e] = True
        for a in range(k):
            picked[a] = C[e, rows[a]]
        if not append(L, k, picked, C[e, e]):
            # d has no curvature, M d = 0, and the objective falls along it.
            sign = 1.0 if w[e] < 0.0 else -1.0
            for a in range(k):
                y[a] = -sign * L[k, a]
            back_substitute(L, k, y)
            length, block = room(z[e], sign, lower[e], upper[e]), k
            for a in range(k):
                share = room(z[rows[a]], y[a], lower[rows[a]], upper[rows[a]])
                if share < length:
                    length, block = share, a
            if length == np.inf:
                for i in range(n):
                    z[i] = 0.0
                for a in range(k):
                    z[rows[a]] = y[a]
                z[e] = sign
                return RAY, step
            stalled = stalled + 1 if length == 0.0 else 0
            for a in range(k):
                i = rows[a]
                z[i] = min(max(z[i] + length * y[a], lower[i]), upper[i])
            if block == k:
                z[e] = upper[e] if sign > 0.0 else lower[e]
                continue
            z[e] = min(max(z[e] + length * sign, lower[e]), upper[e])
            i = rows[block]
            z[i] = upper[i] if y[block] > 0.0 else lower[i]
            leaving = n + i
            remove(L, k, block)
            for a in range(block, k - 1):
                rows[a] = rows[a + 1]
            k -= 1
            free[i] = False
            basis[i] = i
            for a in range(k):
                picked[a] = C[e, rows[a]]
            if not append(L, k, picked, C[e, e]):
                continue
        rows[k] = e
        k += 1
        free[e] = True
        basis[e] = n + e
    return MAX_ITER, max_iter


SOLVER = CompiledSolver(
    name="active-set",
    summary="active set with an updated Cholesky factor; semidefinite M, warm starts, and operators by their factors",
    requires=(Property.SYMMETRIC, Property.PSD),
    storages=("dense", "banded", "factored"),
    boxed=True,
    tol=1e-10,
    max_iter=10_000,
    source="Lawson and Hanson (1974), chapter 23; Nocedal and Wright (2006), section 16.5",
    kernel=active_set,
)
