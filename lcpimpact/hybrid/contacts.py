"""Impacts and the choice of the mode in small systems of contacts, in compiled code.

The laws are those of `lcpimpact.hybrid.impacts` and `lcpimpact.hybrid.mode_choice`. Without friction, sliders and relays,
and where the matrix G determines the forces, they need no general solver: principal pivots find the one solution. Each
answer says whether it is determined.
"""

from __future__ import annotations

import math

import numpy as np

from lcpimpact.arrays import Flags, Indices, Matrix, Stack, Vector
from lcpimpact.compiled import compiled
from lcpimpact.hybrid.complementarity import Meeting, approach, at_rest, exchange, rebound
from lcpimpact.hybrid.gaps import REFINEMENTS, reading
from lcpimpact.hybrid.system import Plant
from lcpimpact.numerics.double_double import add, multiply, product, total
from lcpimpact.numerics.elimination import quotient

REGULAR_RTOL = 1e-8
"""Smallest pivot of a regular matrix of contacts, relative to its diagonal."""


@compiled()
def size_of(row: Vector, scale: Vector) -> float:
    """Return Σ |c_j| s_j, the size of the terms of c·X."""
    size = 0.0
    for j in range(len(row)):
        size += abs(row[j]) * abs(scale[j])
    return size


@compiled()
def applied(A: Stack, X: Matrix) -> Matrix:
    """Return A X (2, m) of a matrix (2, m, N) and a vector (2, N)."""
    Y = np.zeros((2, A.shape[1]))
    for i in range(A.shape[1]):
        for j in range(A.shape[2]):
            if A[0, i, j] != 0.0:
                x, x_lo = multiply(A[0, i, j], A[1, i, j], X[0, j], X[1, j])
                Y[0, i], Y[1, i] = add(Y[0, i], Y[1, i], x, x_lo)
    return Y


@compiled()
def regular(G: Matrix, rows: Indices) -> bool:
    """Return whether a block of G is positive definite beyond rounding, and symmetric if it has more than two rows."""
    n = len(rows)
    L = np.zeros((n, n))
    for a in range(n):
        for b in range(n):
            L[a, b] = G[rows[a], rows[b]]
            size = math.sqrt(abs(G[rows[a], rows[a]] * G[rows[b], rows[b]]))
            if n > 2 and not abs(L[a, b] - G[rows[b], rows[a]]) <= REGULAR_RTOL * size:
                return False
    for k in range(n):
        if not L[k, k] > REGULAR_RTOL * abs(G[rows[k], rows[k]]):
            return False
        for a in range(k + 1, n):
            factor = L[a, k] / L[k, k]
            for b in range(k, n):
                L[a, b] -= factor * L[k, b]
    return True


@compiled()
def settle(plant: Plant, X: Matrix, scale: Vector, no_gap: Flags, no_rate: Flags) -> tuple[Matrix, bool]:
    """Return X with held gaps and rates put back to zero, and whether their rows are independent.

    The states change in proportion to their size, and as little as possible: by wᵀ (w wᵀ)⁻¹ of the rest, where w are the
    rows in units of the states.
    """
    n = X.shape[1]
    nc = len(no_gap)
    k = 0
    constraint = np.zeros((2, 2 * nc, n))
    for rates in range(2):
        for i in range(nc):
            if no_rate[i] if rates else no_gap[i]:
                for part in range(2):
                    for m in range(n):
                        constraint[part, k, m] = plant.CA[part, i, m] if rates else plant.C[part, i, m]
                k += 1
    if k == 0:
        return X, True
    w = np.zeros((k, n))
    size = np.zeros(k)
    gram = np.zeros((2, k, k))
    rest = np.zeros((2, k, 1))
    for a in range(k):
        for m in range(n):
            w[a, m] = constraint[0, a, m] * scale[m] if plant.moves[m] else 0.0
            size[a] += w[a, m] * w[a, m]
        size[a] = math.sqrt(size[a])
        for m in range(n):
            w[a, m] = w[a, m] / size[a] if size[a] > 0.0 else 0.0
        for b in range(a + 1):
            for m in range(n):
                gram[0, a, b] += w[a, m] * w[b, m]
            gram[0, b, a] = gram[0, a, b]
    if not regular(gram[0], np.arange(k)):
        return X, False
    change = np.zeros((2, n))
    for _ in range(REFINEMENTS):
        now = applied(constraint, X)
        moves = False
        for a in range(k):
            rest[0, a, 0] = now[0, a] / size[a]
            moves |= now[0, a] != 0.0
        if not moves:
            break
        y = quotient(gram, rest)
        for m in range(n):
            change[0, m] = 0.0
            for a in range(k):
                change[0, m] -= w[a, m] * y[0, a, 0]
            change[0, m] *= scale[m]
        X = total(X, change)
    return X, True


@compiled()
def strike(
    plant: Plant, X: Matrix, scale: Vector, no_gap: Flags, no_rate: Flags, zero: float
) -> tuple[Matrix, Vector, Flags, bool]:
    """Return X after the impacts, their impulses (nc,), the rates that are zero then, and whether that is determined."""
    opening = reading(plant.C, plant.CA, X, scale, no_gap, no_rate, zero)
    u, U = opening[0], opening[1]
    rows, bounce, _, meet = approach(u, U, U, plant.e, plant.meets)
    P = np.zeros(len(no_gap))
    if not meet:
        return X, P, no_rate, True
    if not regular(plant.G[0], rows):
        return X, P, no_rate, False
    meeting = Meeting(rows, bounce, U, U)
    _, impulses, ended = rebound(plant.G, plant.B, X, meeting, np.zeros(len(rows)), zero)
    if not ended:
        return X, P, no_rate, False
    after, impulses, ended = rebound(plant.G, plant.B, X, meeting, impulses[0][rows], zero)
    P = impulses[0].copy()
    return after, P, at_rest(P, U, plant.e, plant.G[0].copy(), no_rate, plant.degree), ended


@compiled()
def forces_of(
    plant: Plant, X: Matrix, scale: Vector, closed: Indices, undecided: Indices, zero: float
) -> tuple[Matrix, Matrix, Vector, bool]:
    """Return the forces of all rows (2, nc) for one derivative of the motion, openings and tolerances of undecided ones.

    The flag says whether the LCP is determined.
    """
    nc = len(plant.degree)
    k = len(closed)
    m = len(undecided)
    g = applied(plant.O, X)
    summed = np.zeros(m)
    q = np.empty((2, m))
    W = np.empty((2, m, m))
    r = np.zeros((2, nc))
    for a, i in enumerate(undecided):
        summed[a] = size_of(plant.O[0, i], scale)
        for part in range(2):
            q[part, a] = g[part, i]
            for b, j in enumerate(undecided):
                W[part, a, b] = plant.G[part, i, j]
    eliminated = np.empty((2, k, m + 1))
    if k:
        block, coupling = np.empty((2, k, k)), np.empty((2, m, k))
        for part in range(2):
            for a, i in enumerate(closed):
                eliminated[part, a, 0] = g[part, i]
                for b, j in enumerate(closed):
                    block[part, a, b] = plant.G[part, i, j]
                for b, j in enumerate(undecided):
                    eliminated[part, a, 1 + b] = plant.G[part, i, j]
                    coupling[part, b, a] = plant.G[part, j, i]
        eliminated = quotient(block, eliminated)
        back = product(coupling, eliminated)
        for a in range(m):
            q[0, a], q[1, a] = add(q[0, a], q[1, a], -back[0, a, 0], -back[1, a, 0])
            for b in range(k):
                summed[a] += abs(coupling[0, a, b] * eliminated[0, b, 0])
            for b in range(m):
                W[0, a, b], W[1, a, b] = add(W[0, a, b], W[1, a, b], -back[0, a, 1 + b], -back[1, a, 1 + b])
    for a in range(m):
        if abs(q[0, a]) <= zero * summed[a]:
            q[0, a], q[1, a] = 0.0, 0.0
    lower, upper = np.zeros(m), np.full(m, np.inf)
    z, w, ended = exchange(W, q, lower, lower, upper, zero * summed)
    tiny = zero * summed
    for a in range(m):
        tiny[a] += zero * size_of(W[0, a], z[0])
    if ended:
        z, w, ended = exchange(W, q, z[0].copy(), lower, upper, tiny)
    for a, i in enumerate(undecided):
        r[0, i], r[1, i] = z[0, a], z[1, a]
    for a, i in enumerate(closed):
        x, x_lo = -eliminated[0, a, 0], -eliminated[1, a, 0]
        for b in range(m):
            y, y_lo = multiply(eliminated[0, a, 1 + b], eliminated[1, a, 1 + b], z[0, b], z[1, b])
            x, x_lo = add(x, x_lo, -y, -y_lo)
        r[0, i], r[1, i] = x, x_lo
    return r, w, tiny, ended


@compiled()
def choose(
    plant: Plant, X: Matrix, scale: Vector, no_gap: Flags, no_rate: Flags, zero: float
) -> tuple[Flags, Indices, bool]:
    """Return the closed rows of the next mode, the order of each zero (-1: for ever), and whether that is determined.

    See `lcpimpact.hybrid.mode_choice`: contacts that touch and do not open are decided by the LCPs of the derivatives.
    """
    n, nc = X.shape[1], len(plant.degree)
    opening = reading(plant.C, plant.CA, X, scale, no_gap, no_rate, zero)
    u, U = opening[0], opening[1]
    closed = np.zeros(nc, np.bool_)
    undecided = np.empty(nc, np.bool_)
    order = np.empty(nc, np.int64)
    for k in range(nc):
        opens = u[0, k] > 0.0 or (plant.degree[k] == 2 and U[0, k] > 0.0)
        undecided[k] = plant.degree[k] == 0 or not opens
        order[k] = 0 if u[0, k] > 0.0 else 1
    if not undecided.any():
        return closed, order, True
    if not regular(plant.G[0], np.flatnonzero(undecided)):
        return closed, order, False
    for level in range(n + 1):
        rows = np.flatnonzero(closed)
        unknown = np.flatnonzero(undecided)
        if len(unknown) == 0:
            break
        r, w, tiny, determined = forces_of(plant, X, scale, rows, unknown, zero)
        if not determined:
            return closed, order, False
        for a, i in enumerate(unknown):
            if abs(r[0, i]) * plant.G[0, i, i] > tiny[a]:
                closed[i] = True
                undecided[i] = False
                order[i] = level
            elif abs(w[0, a]) > tiny[a]:
                undecided[i], order[i] = False, plant.degree[i] + level
        size = np.empty(n)
        for k in range(n):
            size[k] = size_of(plant.A[0, k], scale) + size_of(plant.B[0, k], r[0])
        X = total(applied(plant.A, X), applied(plant.B, r))
        scale = size
    for k in range(nc):
        order[k] = -1 if undecided[k] else order[k]
    return closed, order, True
