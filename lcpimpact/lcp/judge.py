r"""Independent checks of solutions and rays: residuals and certificates from M and q only.

A solution of the boxed LCP is a zero of the natural residual

.. math:: z - P(z - w) = \max(\min(w, z - lower), z - upper), \qquad w = M z + q,

with P the projection on the box; for lower = 0 and upper = inf it is min(z, w).
"""

from __future__ import annotations

import numpy as np

from lcpimpact.arrays import Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.lcp.storage import (
    absolute_product,
    absolute_transposed_product,
    longest_row,
    product,
    spread,
    transposed_product,
    weight,
)
from lcpimpact.numerics.rounding import EPS, TINY

PROOF_RTOL = 1e-6
"""Maximum rounding error of a row, relative to its size, at which a check is conclusive."""


@compiled()
def sizes(
    W: Matrix, q: Vector, lower: Vector, upper: Vector, z: Vector, terms: Vector, size: Vector, rounding: float
) -> None:
    """Remove from ``size`` the terms of the z_j that are not determined by the data.

    The data are q and the z_j at a bound. They determine z_j if they exceed the rounding error in its row,
    |q_j| > ε/PROOF_RTOL terms_j, and such z_j determine others in turn. The remaining z_j result from cancellation.
    """
    n = len(q)
    known = np.empty(n)
    unknown = np.zeros(n, np.bool_)
    left = 0
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


@compiled()
def row_defect(
    W: Matrix, q: Vector, lower: Vector, upper: Vector, z: Vector, w: Vector, rounding: float
) -> tuple[float, float]:
    """Return the largest scaled defect of the point z, w.

    Parameters
    ----------
    rounding : float
        Relative rounding error of each term of w_i; 0 for an exact w.

    Returns
    -------
    scaled : float
        Maximum over the rows of the smaller of two defects: w_i relative to the size of row i, its terms |q_i| and
        |M_ij z_j|, times the fraction of the terms of a free row due to q or a bound; and the distance of z_i from its
        bound, measured by the change it causes in any row, and relative to the distance of two finite bounds. Values
        below rounding error count as zero. Infinite if a number is not finite.
    rounding : float
        Largest bound of the rounding error of a w_i, relative to the size of its row.
    """
    n = len(q)
    vectors, bounded = np.empty((3, n)), False
    terms = vectors[0]
    held = vectors[1]
    size = vectors[2]
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
        if abs(w[i]) <= rounding * terms[i] + TINY:
            continue
        room = z[i] - lower[i] if w[i] > 0.0 else upper[i] - z[i]
        defect = abs(w[i]) / max(size[i], EPS * abs(w[i]))
        if room > 0.0 and defect > scaled:
            weight_i = weight(W, i, size)
            change = room * weight_i if weight_i > 0.0 else 0.0  # an infinite room times zero is no number
            width = upper[i] - lower[i]
            if 0.0 < width < np.inf:
                change = max(change, room / width)
            scaled = max(scaled, min(defect, change) if change > 0.0 else defect)
    return scaled, most


@compiled()
def measure(W: Matrix, q: Vector, lower: Vector, upper: Vector, z: Vector, w: Vector) -> tuple[float, float, float]:
    """Set w = M z + q, and return the residuals of z.

    Returns
    -------
    scaled : float
        Largest scaled defect of a row, as defined by `row_defect`; infinite if a number is not finite.
    natural : float
        ‖z - P(z - w)‖_inf / max(1, ‖q‖_inf), in the units of the data.
    rounding : float
        Bound of the rounding error of w, in the units of ``scaled``; if it is large the check is inconclusive.
    """
    n = len(q)
    product(W, z, w)
    natural, largest_q = 0.0, 1.0
    for i in range(n):
        w[i] += q[i]
        # z - P(z - w), in a form without cancellation of w against a large z.
        natural = max(natural, abs(max(min(w[i], z[i] - lower[i]), z[i] - upper[i])))
        largest_q = max(largest_q, abs(q[i]))
    scaled, rounding = row_defect(W, q, lower, upper, z, w, (longest_row(W) + 2) * EPS)
    return scaled, natural / largest_q if scaled < np.inf else np.inf, rounding


@compiled()
def clear_residual(M: Matrix, q: Vector, lower: Vector, upper: Vector, z: Vector, tol: float) -> float:
    """Return the scaled residual of an LCP if each row is within ``tol`` of its own q_i, else infinity.

    A cheap first check of small problems in time loops; otherwise `measure` and `holds` decide.
    """
    n = len(q)
    residual = 0.0
    for i in range(n):
        w = q[i]
        terms = abs(q[i])
        near = tol * abs(q[i])
        for j in range(n):
            term = M[i, j] * z[j]
            w += term
            terms += abs(term)
        rounding = (n + 2) * EPS * terms
        if z[i] != 0.0 and not rounding <= near < np.inf:
            return np.inf
        if z[i] == lower[i]:
            if not w >= -near:
                return np.inf
        elif z[i] == upper[i]:
            if not w <= near:
                return np.inf
        elif not (lower[i] < z[i] < upper[i] and abs(w) <= near):
            return np.inf
        elif abs(w) > rounding:
            residual = max(residual, abs(w) / abs(q[i]))
    return residual


@compiled()
def clear_residual_of_chain(bands: Matrix, q: Vector, z: Vector) -> float:
    """Return 0 if each row of a tridiagonal LCP without bounds holds to the rounding error of its terms, else infinity.

    Then `measure` returns 0 too, and `holds` accepts it: the check is conclusive, as q or the z of a row determined before
    determine each z_i > 0 far beyond rounding, from the first row to the last or from the last to the first. Rows with
    q_i = inf do not act.
    """
    n = len(q)
    rounding = 5.0 * EPS
    left = 0
    known = True
    for i in range(n):
        below = bands[1, i - 1] * z[i - 1] if i > 0 else 0.0
        above = bands[1, i] * z[i + 1] if i < n - 1 else 0.0
        own, q_i = bands[0, i] * z[i], q[i]
        terms = abs(q_i) + abs(below) + abs(own) + abs(above)
        w = q_i + below + own + above
        if z[i] == 0.0:
            if not (w >= -rounding * terms and terms >= 0.0):
                return np.inf
            known = True
        else:
            if not (z[i] > 0.0 and abs(w) <= rounding * terms and terms < np.inf):
                return np.inf
            known = rounding * terms <= PROOF_RTOL * (abs(q_i) + (abs(below) if known else 0.0))
            left += not known
    if left > 0:
        known = True
        for k in range(n):
            i = n - 1 - k
            if z[i] == 0.0:
                known = True
                continue
            below = bands[1, i - 1] * z[i - 1] if i > 0 else 0.0
            above = bands[1, i] * z[i + 1] if i < n - 1 else 0.0
            terms = abs(q[i]) + abs(below) + abs(bands[0, i] * z[i]) + abs(above)
            known = rounding * terms <= PROOF_RTOL * (abs(q[i]) + (abs(above) if known else 0.0))
            if not known:
                return np.inf
    return 0.0


@compiled()
def holds(scaled: float, rounding: float, tol: float) -> bool:
    """Return whether a solution is accepted: its rows are within ``tol``, and the check is conclusive."""
    return rounding <= max(tol, PROOF_RTOL) and scaled <= tol


@compiled()
def proves_infeasible(W: Matrix, q: Vector, lower: Vector, upper: Vector, v: Vector) -> bool:
    r"""Return whether v is a certificate that no z has w of the right signs.

    For lower = 0, upper = inf: v >= 0, Mᵀ v <= 0 and q·v < 0, so that v·w = (Mᵀ v)·z + q·v < 0 for every z >= 0, while
    w >= 0 requires v·w >= 0 (Farkas). With bounds, v_i >= 0 where only ``lower`` is finite, <= 0 where only ``upper`` is,
    free where neither is, 0 where both are, and the first term is replaced by max (Mᵀ v)·z over the box.
    """
    n = len(q)
    u = np.empty(n)
    c = np.empty(n)
    terms_of = np.empty(n)
    size = 0.0
    for i in range(n):
        size = max(size, abs(v[i]))
    if not 0.0 < size < np.inf:
        return False
    total, terms = 0.0, 0.0
    for i in range(n):
        below, above = lower[i] > -np.inf, upper[i] < np.inf
        # Entries within rounding error have no definite sign; u is v without them.
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
