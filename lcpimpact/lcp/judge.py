r"""Independent checks of solutions and rays: residuals and certificates from M and q only.

A solution of the boxed LCP is a zero of the natural residual

.. math:: z - P(z - w) = \max(\min(w, z - lower), z - upper), \qquad w = M z + q,

with P the projection on the box; for lower = 0 and upper = inf it is min(z, w).
"""

from __future__ import annotations

import numpy as np
from numba import types

from lcpimpact.arrays import Array
from lcpimpact.compiled import compiled, f8, matrix, vector
from lcpimpact.lcp.lapack import EPS
from lcpimpact.lcp.storage import (
    absolute_product,
    absolute_transposed_product,
    product,
    spread,
    transposed_product,
    weight,
)

PROOF_RTOL = 1e-6
"""Largest rounding error of a row, relative to its size, at which a check is conclusive."""


@compiled(types.void(matrix, vector, vector, vector, vector, vector, vector, f8))
def sizes(W: Array, q: Array, lower: Array, upper: Array, z: Array, terms: Array, size: Array, rounding: float) -> None:
    """Remove from ``size`` the terms of those z_j that the data do not determine.

    The data are q and the z_j at a bound. They determine the z_j of a row in which they exceed rounding,
    |q_j| > ε/PROOF_RTOL terms_j, and such z_j determine others in turn. The rest has the size of a cancellation.
    """
    n = len(q)
    known, unknown, left = np.empty(n), np.zeros(n, np.bool_), 0
    for i in range(n):
        known[i] = z[i]
        if lower[i] < z[i] < upper[i] and not rounding * terms[i] <= PROOF_RTOL * size[i]:
            known[i], unknown[i] = 0.0, True
            left += 1
    absolute_product(W, known, size)
    for i in range(n):
        size[i] += abs(q[i])
    before, forward = left + 1, True
    while left < before:
        before = left
        for k in range(n):
            i = k if forward else n - 1 - k
            if unknown[i] and rounding * terms[i] <= PROOF_RTOL * size[i]:
                unknown[i] = False
                left -= 1
                spread(W, i, z[i], size)
        forward = not forward


@compiled(types.UniTuple(f8, 2)(matrix, vector, vector, vector, vector, vector, f8))
def row_defect(
    W: Array, q: Array, lower: Array, upper: Array, z: Array, w: Array, rounding: float
) -> tuple[float, float]:
    """Return how far z with its w is from a solution, each row in its own unit.

    Parameters
    ----------
    rounding : float
        The relative error of each term of w_i; 0 where w was computed without.

    Returns
    -------
    scaled : float
        The largest over the rows of the lesser of two: w_i relative to the size of row i, that is to its terms |q_i| and
        |M_ij z_j|, times the share that q or a bound has in the terms of a free row; and z_i from its bound, by what
        that changes in any row. What is rounding counts as zero. Infinite where a number is not finite.
    rounding : float
        The largest bound of the rounding of a w_i, relative to the size of its row.
    """
    n = len(q)
    terms, held, size = np.empty(n), np.empty(n), np.empty(n)
    bounded = False
    for i in range(n):
        held[i] = 0.0 if lower[i] < z[i] < upper[i] else z[i]
        bounded = bounded or held[i] != 0.0
    absolute_product(W, z, terms)
    if bounded:
        absolute_product(W, held, size)
    share, lost = -1.0, False
    for i in range(n):
        size[i] = abs(q[i]) + (size[i] if bounded else 0.0)
        terms[i] += abs(q[i])
        if not (terms[i] < np.inf and abs(w[i]) < np.inf):
            return np.inf, 0.0
        if lower[i] < z[i] < upper[i]:
            share = max(share, size[i] / terms[i] if terms[i] > 0.0 else 0.0)
            lost = lost or not max(rounding, EPS) * terms[i] <= PROOF_RTOL * size[i]
    share = 1.0 if share < 0.0 else share
    if lost:
        sizes(W, q, lower, upper, z, terms, size, max(rounding, EPS))
    else:
        size[:] = terms
    most = 0.0
    for i in range(n):
        if rounding * terms[i] > most * size[i]:
            most = rounding * terms[i] / size[i]
    for i in range(n):
        size[i] *= share
    scaled = 0.0
    for i in range(n):
        outside = max(lower[i] - z[i], z[i] - upper[i])
        if outside > 0.0:
            scaled = max(scaled, min(outside * weight(W, i, size), 1.0 / EPS))
        if abs(w[i]) <= rounding * terms[i]:
            continue
        room = z[i] - lower[i] if w[i] > 0.0 else upper[i] - z[i]
        defect = abs(w[i]) / max(size[i], EPS * abs(w[i]))
        if room > 0.0 and defect > scaled:
            change = room * weight(W, i, size)
            scaled = max(scaled, min(defect, change) if change > 0.0 else defect)
    return scaled, most


@compiled(types.UniTuple(f8, 3)(matrix, vector, vector, vector, vector, vector))
def measure(W: Array, q: Array, lower: Array, upper: Array, z: Array, w: Array) -> tuple[float, float, float]:
    """Set w = M z + q, and return how far z is from a solution.

    Returns
    -------
    scaled : float
        The largest defect of a row in its own unit, as `row_defect` defines it; infinite where a number is not finite.
    natural : float
        ‖z - P(z - w)‖_inf / max(1, ‖q‖_inf), in the units of the data.
    rounding : float
        A bound of the rounding of w itself, in the units of ``scaled``: where it is large the check shows nothing.
    """
    n = len(q)
    product(W, z, w)
    natural, largest_q = 0.0, 1.0
    for i in range(n):
        w[i] += q[i]
        # z - P(z - w), in the form in which a large z does not swallow w.
        natural = max(natural, abs(max(min(w[i], z[i] - lower[i]), z[i] - upper[i])))
        largest_q = max(largest_q, abs(q[i]))
    scaled, rounding = row_defect(W, q, lower, upper, z, w, (min(n, 2 * W.shape[0] - 1) + 2) * EPS)
    return scaled, natural / largest_q if scaled < np.inf else np.inf, rounding


@compiled(f8(matrix, vector, vector, vector, vector, f8), allocates=False)
def clear_residual(M: Array, q: Array, lower: Array, upper: Array, z: Array, tol: float) -> float:
    """Return the scaled residual of an LCP without bounds if each row is within ``tol`` of its own q_i, else infinity.

    It is the first look of a time loop at a few rows; what is not clear is for `measure` and `holds` to judge.
    """
    n = len(q)
    residual = 0.0
    for i in range(n):
        if lower[i] != 0.0 or upper[i] != np.inf:
            return np.inf
        w, terms = q[i], abs(q[i])
        for j in range(n):
            term = M[i, j] * z[j]
            w += term
            terms += abs(term)
        if z[i] == 0.0:
            if not w >= -tol * abs(q[i]):
                return np.inf
        elif not (z[i] > 0.0 and abs(w) <= tol * abs(q[i]) and (n + 2) * EPS * terms <= tol * abs(q[i])):
            return np.inf
        else:
            residual = max(residual, abs(w) / abs(q[i]))
    return residual


@compiled(types.boolean(f8, f8, f8))
def holds(scaled: float, rounding: float, tol: float) -> bool:
    """Return whether an answer may be called solved: its rows are within ``tol``, and the check is no mere rounding."""
    return rounding <= max(tol, PROOF_RTOL) and scaled <= tol


@compiled(types.boolean(matrix, vector, vector, vector, vector))
def proves_infeasible(W: Array, q: Array, lower: Array, upper: Array, v: Array) -> bool:
    r"""Return whether v is a certificate that no z has w of the right signs.

    For lower = 0, upper = inf: v >= 0, Mᵀ v <= 0 and q·v < 0, so that v·w = (Mᵀ v)·z + q·v < 0 for every z >= 0, while
    w >= 0 asks for v·w >= 0 (Farkas). With bounds: v_i >= 0 where only ``lower`` is finite, <= 0 where only ``upper``
    is, any where neither is, 0 where both are; and the largest value of (Mᵀ v)·z over the box stands for the first term.
    """
    n = len(q)
    u, c, terms_of = np.empty(n), np.empty(n), np.empty(n)
    size = 0.0
    for i in range(n):
        size = max(size, abs(v[i]))
    if not 0.0 < size < np.inf:
        return False
    total, terms = 0.0, 0.0
    for i in range(n):
        below, above = lower[i] > -np.inf, upper[i] < np.inf
        # What is rounding has no sign to be wrong; u stands for v without it.
        u[i] = v[i] if abs(v[i]) > 1e-11 * size else 0.0
        if (below and u[i] < 0.0) or (above and u[i] > 0.0):
            return False
        total += q[i] * u[i]
        terms += abs(q[i] * u[i])
    transposed_product(W, u, c)
    absolute_transposed_product(W, u, terms_of)
    for j in range(n):
        bound = upper[j] if c[j] > 0.0 else lower[j]
        if abs(bound) < np.inf:
            total += c[j] * bound
            terms += abs(c[j] * bound)
        elif abs(c[j]) > 64.0 * n * EPS * terms_of[j]:
            return False
    return total < -1e-9 * terms
