r"""The principal pivotal transform: y = T x + const, where each pair (z_i, w_i) has one member in x and the other in y.

At first x = z, y = w and T = M. An exchange of the pairs α turns T into

.. math:: T'_{αα} = T_{αα}^{-1}, \quad T'_{αβ} = -T_{αα}^{-1} T_{αβ}, \quad T'_{βα} = T_{βα} T_{αα}^{-1}, \quad
          T'_{ββ} = T_{ββ} - T_{βα} T_{αα}^{-1} T_{αβ},

and what M is, positive semidefinite or a P-matrix, T' is too. x and y are kept as values, so a nonbasic variable may stand
anywhere, and an exchange swaps two numbers.
"""

from __future__ import annotations

import numpy as np
from numba import types

from lcpimpact.arrays import Array, Flags
from lcpimpact.compiled import compiled, i8, matrix, vector
from lcpimpact.lcp.storage import product

flags = types.boolean[::1]

THRESHOLD = 1e-11
"""Least rate, in a problem of unit diagonal, that is no rounding."""


@compiled(types.void(matrix, i8))
def exchange(T: Array, s: int) -> None:
    """Exchange the members of pair s."""
    n = len(T)
    inverse = 1.0 / T[s, s]
    for j in range(n):
        T[s, j] *= -inverse
    T[s, s] = inverse
    for i in range(n):
        factor = T[i, s]
        if i != s and factor != 0.0:
            for j in range(n):
                T[i, j] += factor * T[s, j]
            T[i, s] = factor * inverse


@compiled(types.void(matrix, i8, i8))
def exchange_two(T: Array, r: int, s: int) -> None:
    """Exchange the members of the pairs r and s at once."""
    n = len(T)
    determinant = T[r, r] * T[s, s] - T[r, s] * T[s, r]
    a, b, c, d = T[s, s] / determinant, -T[r, s] / determinant, -T[s, r] / determinant, T[r, r] / determinant
    for j in range(n):
        x, y = T[r, j], T[s, j]
        T[r, j], T[s, j] = -(a * x + b * y), -(c * x + d * y)
    T[r, r], T[r, s], T[s, r], T[s, s] = a, b, c, d
    for i in range(n):
        x, y = T[i, r], T[i, s]
        if i != r and i != s and (x != 0.0 or y != 0.0):
            for j in range(n):
                T[i, j] += x * T[r, j] + y * T[s, j]
            T[i, r], T[i, s] = x * a + y * c, x * b + y * d


@compiled(types.void(vector, vector, flags, i8))
def swap(x: Array, y: Array, free: Flags, i: int) -> None:
    """Exchange the values of pair i."""
    x[i], y[i] = y[i], x[i]
    free[i] = not free[i]


@compiled(i8(matrix, vector, vector, flags, i8, i8))
def relieve(T: Array, x: Array, y: Array, free: Flags, r: int, s: int) -> int:
    """Exchange pair s, which has stopped x_r, or r with it where T_ss is too small; return how many were exchanged.

    The path on which x_r moves is the same either way. 0 means that neither can be done.
    """
    across = T[r, s] * T[s, r]
    if T[s, s] > THRESHOLD and T[s, s] * T[s, s] > 1e-10 * abs(across):
        exchange(T, s)
        swap(x, y, free, s)
        return 1
    if T[r, r] * T[s, s] - across > THRESHOLD * THRESHOLD:
        exchange_two(T, r, s)
        swap(x, y, free, r)
        swap(x, y, free, s)
        return 2
    return 0


@compiled(types.void(matrix, vector, vector, vector, matrix, vector, vector, flags))
def refresh(W: Array, q: Array, unit: Array, scale: Array, T: Array, x: Array, y: Array, free: Flags) -> None:
    """Compute the basic variables anew from M and q; twice, for T⁻¹ is known only as well as the exchanges have kept it.

    ``unit`` is that of w, ``scale`` that of z.
    """
    n = len(q)
    z, w = np.empty(n), np.empty(n)
    for _ in range(2):
        for i in range(n):
            z[i] = scale[i] * (y[i] if free[i] else x[i])
        product(W, z, w)
        for i in range(n):
            w[i] = (w[i] + q[i]) / unit[i]
            if not free[i]:
                y[i] = w[i]
        for i in range(n):
            if free[i]:
                for j in range(n):
                    if free[j]:
                        y[i] += T[i, j] * (x[j] - w[j])
