r"""The judge of every answer: it stands outside the solvers, and shares nothing with them but M and q.

A solution of the boxed LCP is a zero of the natural residual

.. math:: z - P(z - w) = \max(\min(w, z - lower), z - upper), \qquad w = M z + q,

with P the projection on the box; for lower = 0 and upper = inf it is min(z, w).
"""

from __future__ import annotations

import numpy as np
from numba import types

from lcpimpact.arrays import Array
from lcpimpact.compiled import compiled, f8, matrix, vector
from lcpimpact.lcp.lapack import EPS, largest
from lcpimpact.lcp.storage import absolute_product, product, transposed_product

WRONG = 1e-6
"""Largest rounding that excuses a residual above the tolerance."""


@compiled(f8(f8, vector, vector, vector))
def unit(s: float, q: Array, lower: Array, upper: Array) -> float:
    """Return the unit of q: max |q|, or for q = 0 the largest force s |bound| of a finite bound."""
    p, bound = 0.0, 0.0
    for i in range(len(q)):
        p = max(p, abs(q[i]))
        if abs(lower[i]) < np.inf:
            bound = max(bound, abs(lower[i]))
        if abs(upper[i]) < np.inf:
            bound = max(bound, abs(upper[i]))
    if p == 0.0:
        p = s * bound
    return p if p > 0.0 else 1.0


@compiled(f8(matrix, vector, vector))
def magnitude(W: Array, q: Array, z: Array) -> float:
    """Return max_i (|M| |z| + |q|)_i, which times ε bounds the rounding of M z + q."""
    bands, n = W.shape
    terms, found = np.zeros(n), 0.0
    if bands != n:
        absolute_product(W, z, terms)
    for i in range(n):
        for j in range(n if bands == n else 0):
            terms[i] += abs(W[i, j] * z[j])
        found = max(found, terms[i] + abs(q[i]))
    return found


@compiled(types.UniTuple(f8, 3)(matrix, vector, vector, vector, vector, vector))
def measure(W: Array, q: Array, lower: Array, upper: Array, z: Array, w: Array) -> tuple[float, float, float]:
    """Set w = M z + q, and return how far z is from a solution.

    Returns
    -------
    scaled : float
        The natural residual in units where max |M| = max |q| = 1; infinite where a number is not finite.
    natural : float
        ‖z - P(z - w)‖_inf / max(1, ‖q‖_inf), in the units of the data.
    rounding : float
        A bound of the rounding of w itself, in the units of ``scaled``: no z near this one can be told from it.
    """
    n = len(q)
    s = largest(W)
    s = s if s > 0.0 else 1.0
    p = unit(s, q, lower, upper)
    product(W, z, w)
    scaled, natural, largest_q, sum_z = 0.0, 0.0, 1.0, 0.0
    for i in range(n):
        w[i] += q[i]
        # In units first, so that a sum cannot overflow there; NaN fails every comparison.
        x, y = z[i] * (s / p), w[i] / p
        # x - P(x - y), in the form in which a large x does not swallow y.
        defect = abs(max(min(y, x - lower[i] * (s / p)), x - upper[i] * (s / p)))
        if not defect < np.inf:
            return np.inf, np.inf, 0.0
        scaled = max(scaled, defect)
        natural = max(natural, abs(max(min(w[i], z[i] - lower[i]), z[i] - upper[i])))
        largest_q = max(largest_q, abs(q[i]))
        sum_z += abs(x)
    terms = min(n, 2 * W.shape[0] - 1) + 2
    rounding = terms * EPS * (1.0 + sum_z)
    # The bound by the norms is cheap; where it would decide, the one by rows is taken.
    if rounding > 1e-3 * WRONG or (scaled > 1e-12 and rounding > 1e-13):
        rounding = terms * EPS * magnitude(W, q, z) / p
    return scaled, natural / largest_q, rounding


@compiled(f8(matrix, vector, vector, f8))
def clear_residual(M: Array, q: Array, z: Array, tol: float) -> float:
    """Return the scaled residual of a plain LCP if it and the rounding of w are within ``tol``, and infinity if not.

    It is the first look of a time loop at a few rows; what is not clear is for `measure` and `holds` to judge.
    """
    n = len(q)
    s, p, residual, sum_z = 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        p = max(p, abs(q[i]))
        sum_z += abs(z[i])
        for j in range(n):
            s = max(s, abs(M[i, j]))
    for i in range(n):
        w = q[i]
        for j in range(n):
            w += M[i, j] * z[j]
        residual = max(residual, abs(min(w, s * z[i])))
    if residual <= tol * p and (n + 2) * EPS * (p + s * sum_z) <= tol * p:
        return residual / p if p > 0.0 else 0.0
    return np.inf


@compiled(types.boolean(f8, f8, f8))
def holds(scaled: float, rounding: float, tol: float) -> bool:
    """Return whether an answer may be called solved.

    Its residual must be within ``tol``, or within the rounding of the check; and where rounding alone is larger than
    both ``tol`` and `WRONG`, the check shows nothing.
    """
    return rounding <= max(tol, WRONG) and scaled <= max(tol, min(rounding, WRONG))


@compiled(types.boolean(matrix, vector, vector, vector, vector))
def proves_infeasible(W: Array, q: Array, lower: Array, upper: Array, v: Array) -> bool:
    r"""Return whether v is a certificate that no z has w of the right signs.

    For lower = 0, upper = inf: v >= 0, Mᵀ v <= 0 and q·v < 0, so that v·w = (Mᵀ v)·z + q·v < 0 for every z >= 0, while
    w >= 0 asks for v·w >= 0 (Farkas). With bounds: v_i >= 0 where only ``lower`` is finite, <= 0 where only ``upper``
    is, any where neither is, 0 where both are; and the largest value of (Mᵀ v)·z over the box stands for the first term.
    """
    n = len(q)
    u, c, sizes = np.empty(n), np.empty(n), np.empty(n)
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
    absolute_product(W, u, sizes)
    for j in range(n):
        bound = upper[j] if c[j] > 0.0 else lower[j]
        if abs(bound) < np.inf:
            total += c[j] * bound
            terms += abs(c[j] * bound)
        elif abs(c[j]) > 64.0 * n * EPS * sizes[j]:
            return False
    return total < -1e-9 * terms
