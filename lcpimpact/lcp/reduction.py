"""Reduction of a boxed LCP to a plain LCP with more unknowns, for methods without bounds."""

from __future__ import annotations

import numpy as np
from numba import types

from lcpimpact.arrays import Array, Indices
from lcpimpact.compiled import compiled, indices, matrix, vector
from lcpimpact.lcp.lapack import largest
from lcpimpact.lcp.storage import product


@compiled(types.Tuple((matrix, vector, indices, vector, vector))(matrix, vector, vector, vector))
def to_lcp(M: Array, q: Array, lower: Array, upper: Array) -> tuple[Array, Array, Indices, Array, Array]:
    r"""Return LCP(N, p) in y >= 0, the row and the sign of each unknown, and z at y = 0.

    .. math:: z_i = lower_i + y_i, \quad z_i = upper_i - y_i, \quad z_i = y_i - y_j

    for a row with a lower bound, with an upper bound only, and without bounds. A row with both bounds also has a multiplier
    μ, 0 <= μ ⟂ upper - lower - y >= 0, with sign 0 here. A row with lower = upper has no unknown.
    """
    n = len(q)
    row, sign, base = np.empty(2 * n, np.int64), np.empty(2 * n), np.zeros(n)
    count = 0
    for i in range(n):
        below, above = lower[i] > -np.inf, upper[i] < np.inf
        base[i] = lower[i] if below else upper[i] if above else 0.0
        if lower[i] == upper[i]:
            continue
        row[count], sign[count] = i, 1.0 if below or not above else -1.0
        count += 1
        if below == above:
            row[count], sign[count] = i, 0.0 if below else -1.0
            count += 1
    s = largest(M)
    s = s if s > 0.0 else 1.0
    w = np.empty(n)
    product(M, base, w)
    N, p = np.zeros((count, count)), np.empty(count)
    for a in range(count):
        i = row[a]
        if sign[a] == 0.0:
            p[a] = s * (upper[i] - lower[i])
            N[a, a - 1], N[a - 1, a] = -s, s
            continue
        p[a] = sign[a] * (q[i] + w[i])
        for b in range(count):
            if sign[b] != 0.0:
                N[a, b] = sign[a] * sign[b] * M[i, row[b]]
    return N, p, row[:count], sign[:count], base


@compiled(types.void(indices, vector, vector, vector))
def from_lcp(row: Indices, sign: Array, y: Array, z: Array) -> None:
    """Add the contribution of y to z; on entry z is its value at y = 0 for a solution, 0 for a direction."""
    for a in range(len(y)):
        z[row[a]] += sign[a] * y[a]
