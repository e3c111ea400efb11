"""Impacts and the choice of the mode in small systems of contacts, in compiled code.

The laws are those of `lcpimpact.hybrid.impacts` and `lcpimpact.hybrid.mode_choice`. Without friction, sliders and relays,
and where the matrix G determines the forces, they need no general solver: principal pivots find the one solution. Each
answer says whether it is determined.
"""

from __future__ import annotations

import math

import numpy as np
from numba import types

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.compiled import compiled, cube, f8, flags, indices, matrix, vector
from lcpimpact.double_double import add, eliminate, product, total
from lcpimpact.hybrid.complementarity import Meeting, approach, at_rest, exchange, rebound
from lcpimpact.hybrid.gaps import reading
from lcpimpact.hybrid.system import ZERO, Plant

REGULAR_RTOL = 1e-8
"""Smallest pivot of a regular matrix of contacts, relative to its diagonal."""

plant_type = types.NamedTuple(
    (cube, cube, cube, cube, cube, cube, indices, flags, vector, matrix, flags, cube, vector), Plant
)


@compiled(types.boolean(matrix, indices))
def regular(G: Array, rows: Indices) -> bool:
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
            L[a] -= L[a, k] / L[k, k] * L[k]
    return True


@compiled(matrix(plant_type, matrix, vector, flags, flags))
def settle(plant: Plant, X: Array, scale: Array, no_gap: Flags, no_rate: Flags) -> Array:
    """Return X with held gaps and rates put back to zero by changes in proportion to the size of states."""
    n, gaps, rates = X.shape[1], np.flatnonzero(no_gap), np.flatnonzero(no_rate)
    k, X = len(gaps) + len(rates), X.copy()
    if k == 0:
        return X
    constraint = np.empty((2, k, n))
    for part in range(2):
        for a, i in enumerate(gaps):
            constraint[part, a] = plant.C[part, i]
        for a, i in enumerate(rates):
            constraint[part, len(gaps) + a] = plant.CA[part, i]
    moves = np.where(plant.moves, scale, 0.0)
    weighted, change = constraint[0] * moves, np.zeros((2, n))
    for _ in range(2):
        rest = product(constraint, X.copy().reshape(2, n, 1))[0, :, 0].copy()
        if not rest.any():
            break
        if k == 1:
            size = np.sum(weighted[0] * weighted[0])
            change[0] = -moves * (weighted[0] * (rest[0] / size if size > 0.0 else 0.0))
        else:
            change[0] = -moves * np.linalg.lstsq(weighted, rest, ZERO)[0]
        X = total(X, change)
    return X


@compiled(types.Tuple((matrix, vector, flags, types.boolean))(plant_type, matrix, vector, flags, flags, f8))
def strike(
    plant: Plant, X: Array, scale: Array, no_gap: Flags, no_rate: Flags, zero: float
) -> tuple[Array, Array, Flags, bool]:
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


@compiled(types.Tuple((matrix, matrix, vector, types.boolean))(plant_type, matrix, vector, indices, indices, f8))
def forces_of(
    plant: Plant, X: Array, scale: Array, closed: Indices, undecided: Indices, zero: float
) -> tuple[Array, Array, Array, bool]:
    """Return the forces of all rows (2, nc) for one derivative of the motion, openings and tolerances of undecided ones.

    The flag says whether the LCP is determined.
    """
    n, nc, k, m = X.shape[1], len(plant.degree), len(closed), len(undecided)
    g = product(plant.O, X.copy().reshape(2, n, 1))
    summed, q, W, r = np.zeros(m), np.empty((2, m)), np.empty((2, m, m)), np.zeros((2, nc))
    for a, i in enumerate(undecided):
        summed[a] = np.sum(np.abs(plant.O[0, i]) * scale)
        for part in range(2):
            q[part, a] = g[part, i, 0]
            for b, j in enumerate(undecided):
                W[part, a, b] = plant.G[part, i, j]
    eliminated = np.empty((2, k, m + 1))
    if k:
        block, coupling = np.empty((2, k, k)), np.empty((2, m, k))
        for part in range(2):
            for a, i in enumerate(closed):
                eliminated[part, a, 0] = g[part, i, 0]
                for b, j in enumerate(closed):
                    block[part, a, b] = plant.G[part, i, j]
                for b, j in enumerate(undecided):
                    eliminated[part, a, 1 + b] = plant.G[part, i, j]
                    coupling[part, b, a] = plant.G[part, j, i]
        eliminated = eliminate(block, eliminated)
        back = product(coupling, eliminated)
        for a in range(m):
            q[0, a], q[1, a] = add(q[0, a], q[1, a], -back[0, a, 0], -back[1, a, 0])
            summed[a] += np.sum(np.abs(coupling[0, a]) * np.abs(eliminated[0, :, 0]))
            for b in range(m):
                W[0, a, b], W[1, a, b] = add(W[0, a, b], W[1, a, b], -back[0, a, 1 + b], -back[1, a, 1 + b])
    for a in range(m):
        if abs(q[0, a]) <= zero * summed[a]:
            q[0, a], q[1, a] = 0.0, 0.0
    lower, upper = np.zeros(m), np.full(m, np.inf)
    z, w, ended = exchange(W, q, lower, lower, upper, zero * summed)
    tiny = zero * summed
    for a in range(m):
        tiny[a] += zero * np.sum(np.abs(W[0, a]) * np.abs(z[0]))
    if ended:
        z, w, ended = exchange(W, q, z[0].copy(), lower, upper, tiny)
    for a, i in enumerate(undecided):
        r[0, i], r[1, i] = z[0, a], z[1, a]
    for a, i in enumerate(closed):
        x, x_lo = -eliminated[0, a, 0], -eliminated[1, a, 0]
        for b in range(m):
            y = product(eliminated[:, a : a + 1, 1 + b : 2 + b].copy(), z[:, b].copy().reshape(2, 1, 1))
            x, x_lo = add(x, x_lo, -y[0, 0, 0], -y[1, 0, 0])
        r[0, i], r[1, i] = x, x_lo
    return r, w, tiny, ended


@compiled(types.Tuple((flags, indices, types.boolean))(plant_type, matrix, vector, flags, flags, f8))
def choose(
    plant: Plant, X: Array, scale: Array, no_gap: Flags, no_rate: Flags, zero: float
) -> tuple[Flags, Indices, bool]:
    """Return the closed rows of the next mode, the order of each zero (-1: for ever), and whether that is determined.

    See `lcpimpact.hybrid.mode_choice`: contacts that touch and do not open are decided by the LCPs of the derivatives.
    """
    n, nc = X.shape[1], len(plant.degree)
    opening = reading(plant.C, plant.CA, X, scale, no_gap, no_rate, zero)
    u, U = opening[0], opening[1]
    closed, undecided, order = np.zeros(nc, np.bool_), np.empty(nc, np.bool_), np.empty(nc, np.int64)
    for i in range(nc):
        undecided[i] = plant.degree[i] == 0 or not (u[0, i] > 0.0 or (plant.degree[i] == 2 and U[0, i] > 0.0))
        order[i] = 0 if u[0, i] > 0.0 else 1
    if not undecided.any():
        return closed, order, True
    if not regular(plant.G[0], np.flatnonzero(undecided)):
        return closed, order, False
    for level in range(n + 1):
        rows, unknown = np.flatnonzero(closed), np.flatnonzero(undecided)
        if len(unknown) == 0:
            break
        r, w, tiny, determined = forces_of(plant, X, scale, rows, unknown, zero)
        if not determined:
            return closed, order, False
        for a, i in enumerate(unknown):
            if abs(r[0, i]) * plant.G[0, i, i] > tiny[a]:
                closed[i], undecided[i], order[i] = True, False, level
            elif abs(w[0, a]) > tiny[a]:
                undecided[i], order[i] = False, plant.degree[i] + level
        size = np.empty(n)
        for i in range(n):
            size[i] = np.sum(np.abs(plant.A[0, i]) * scale) + np.sum(np.abs(plant.B[0, i]) * np.abs(r[0]))
        pushed = product(plant.B, r.reshape(2, nc, 1))[:, :, 0].copy()
        X, scale = total(product(plant.A, X.copy().reshape(2, n, 1))[:, :, 0].copy(), pushed), size
    order[undecided] = -1
    return closed, order, True
