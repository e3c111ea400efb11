r"""Growth of errors in the steps of an explicit method beyond its limit of stability, in systems without energy.

While the same rows a act, with D_aa regular, x' = A x + B λ + f and 0 = C_a x + D_aa λ_a + c_a leave x' = Ā x + ... with

.. math:: \bar A = A - B_a D_{aa}^{-1} C_a .

In a step the method multiplies the part of x along an eigenvector of Ā by R(h λ), and the motion multiplies it by exp(h λ).
Where |R| is the greater of the two and above one, errors grow by the ratio. The laws of such steps hold, and as there is no
energy nothing else tells.
"""

from __future__ import annotations

import numpy as np

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.integrators.base import Integrator
from lcpimpact.record import Record
from lcpimpact.scheme.dynamics import Dynamics


def judge_growth(d: Dynamics, record: Record, integrator: Integrator, *, most: float = 10.0) -> tuple[float, float]:
    """Return the factor by which errors grow in the steps of an explicit method, 0 up to ``most``, and that."""
    free = np.flatnonzero(~d.driven)
    h = np.diff(record.t)[:, None]
    if integrator.amplification(np.zeros(1)) is None or d.massive.any() or not len(free):
        return 0.0, most
    r = record.reaction[: len(h)]
    acts = (r > d.r_min) & (r < d.r_max)
    logarithm = 0.0
    for rows in np.unique(acts, axis=0):
        z = h[(acts == rows).all(axis=1)] * _eigenvalues(d, free, rows)
        R = np.asarray(integrator.amplification(z))
        factor = np.abs(R) / np.maximum(np.exp(z.real), 1.0)
        logarithm += float(np.log(np.maximum(factor, 1.0)).max(axis=1, initial=0.0).sum())
    grown = float(np.exp(min(logarithm, 700.0)))
    return (grown if grown > most else 0.0), most


def _eigenvalues(d: Dynamics, free: Indices, rows: Flags) -> Array:
    """Return the eigenvalues of Ā while these rows act; 0 where D or C leaves no such equation."""
    C, K = d.C[np.ix_(free, free)], d.K[np.ix_(free, free)]
    D = d.D[np.ix_(rows, rows)]
    if any(len(each) and np.linalg.matrix_rank(each) < len(each) for each in (C, D)):
        return np.zeros(1)
    gain = np.linalg.solve(D.T, d.B[free][:, rows].T).T
    return np.asarray(np.linalg.eigvals(np.linalg.solve(C, -K - gain @ d.H[rows][:, free])))
