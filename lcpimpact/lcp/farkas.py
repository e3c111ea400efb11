"""Certificates of infeasibility by a linear program (Farkas)."""

from __future__ import annotations

import numpy as np

from lcpimpact.arrays import Array


def infeasibility(M: Array, q: Array, lower: Array, upper: Array) -> Array | None:
    r"""Return a certificate v that no z between the bounds has w of the right signs, or None if none is found.

    For an LCP this is Farkas' alternative to z >= 0, M z + q >= 0, scaled to a unit diagonal and normalised:

    .. math:: \min_{0 \le v \le 1} q^T v, \qquad M^T v \le 0 .

    With bounds, :math:`\max_z (M^T v)^T z = \sum_j t_j` over the box is added, and the sign of v_i (free, >= 0, <= 0 or 0)
    follows from the finite bounds of row i. The result must be verified by `judge.proves_infeasible`.

    Parameters
    ----------
    M : (n, n) array
    q, lower, upper : (n,) arrays

    References
    ----------
    Cottle, Pang and Stone, *The Linear Complementarity Problem* (1992), section 2.7.
    """
    from scipy.optimize import linprog

    n = len(q)
    below, above = np.isfinite(lower), np.isfinite(upper)
    unit = np.abs(M).max(axis=1)
    unit = np.where(unit > 0.0, unit, 1.0)
    N = (M / unit[:, None]).T  # c = N v' with v = v'/unit
    # Unknowns (v', t); t_j >= c_j times each finite bound, and c_j of one sign where a bound is infinite.
    rows = [np.hstack([bound[at, None] * N[at], -np.eye(n)[at]]) for at, bound in ((below, lower), (above, upper))]
    rows += [np.hstack([sign * N[~at], np.zeros((int((~at).sum()), n))]) for at, sign in ((above, 1.0), (below, -1.0))]
    A = np.vstack(rows)
    sides = [(0.0 if one else -1.0, 0.0 if other else 1.0) for one, other in zip(below, above, strict=True)]
    # v and t have the unit of q.
    p = np.abs(q / unit).max() or 1.0
    cost = np.r_[q / unit, np.ones(n)] / p
    found = linprog(cost, A_ub=A, b_ub=np.zeros(len(A)), bounds=[*sides, *[(None, None)] * n], method="highs")
    if found.x is None or not found.fun < -1e-9:
        return None
    v: Array = found.x[:n] / unit
    return v
