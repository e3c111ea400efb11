r"""Quasi-static coordinates: equilibrium of massless nodes held by springs only.

With θ = 1/2 they would oscillate about equilibrium for ever. So after a step the coordinates s that no closed contact and no
sticking slider constrains are projected onto equilibrium,

.. math:: S^T \bigl( f(t + h) - K (q^+ + S s) + H^T r \bigr) = 0 .
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.integrators.stepping.law import submatrix
from lcpimpact.lcp.lapack import lu_solve
from lcpimpact.record import SLIP_RTOL
from lcpimpact.scheme.dynamics import Dynamics


class Static(NamedTuple):
    """The quasi-static coordinates of a system.

    Attributes
    ----------
    S : (n, k) array            the coordinates, as columns
    SKS : (k, k) array          Sᵀ K S
    HS : (nc, k) array          H S
    r_min, r_max : (nc,) arrays bounds of the reactions
    """

    S: Matrix
    SKS: Matrix
    HS: Matrix
    r_min: Vector
    r_max: Vector


def static_coordinates(d: Dynamics) -> Static:
    """Return the quasi-static coordinates of a system without non-linear springs on them."""
    S = d.decomposition.static
    S = S[:, ~(np.abs(d.directions) @ np.abs(S)).any(axis=0)].copy()
    return Static(S, S.T @ d.K @ S, np.array(d.H @ S, order="C"), d.r_min.copy(), d.r_max.copy())


def no_static() -> Static:
    """Return no quasi-static coordinates, for other steps."""
    return Static(np.zeros((0, 0)), np.zeros((0, 0)), np.zeros((0, 0)), np.zeros(0), np.zeros(0))


@compiled()
def is_held(static: Static, s: int, r: Vector) -> bool:
    """Return whether a closed contact or a sticking slider constrains a quasi-static coordinate."""
    for i in range(len(r)):
        near = SLIP_RTOL * static.r_max[i] if static.r_max[i] < np.inf else 0.0
        if static.HS[i, s] != 0.0 and static.r_min[i] + near < r[i] < static.r_max[i] - near:
            return True
    return False


@compiled()
def balance_together(static: Static, unbalanced: Vector, r: Vector, q: Vector) -> None:
    """Shift q along several quasi-static coordinates, as `balance` does along one."""
    held = np.empty(len(unbalanced), np.bool_)
    for s in range(len(held)):
        held[s] = is_held(static, s, r)
    free = np.flatnonzero(~held)
    force = unbalanced[free]
    if len(free) > 0 and lu_solve(submatrix(static.SKS, free), force):
        for a in range(len(free)):
            for j in range(len(q)):
                q[j] += static.S[j, free[a]] * force[a]


@compiled()
def balance(static: Static, unbalanced: Vector, r: Vector, q: Vector) -> None:
    """Shift q along the free quasi-static coordinates until the ``unbalanced`` forces Sᵀ(f - K q + Hᵀ r) vanish."""
    if len(unbalanced) > 1:
        balance_together(static, unbalanced, r, q)
    elif static.SKS[0, 0] != 0.0 and not is_held(static, 0, r):
        for j in range(len(q)):
            q[j] += static.S[j, 0] * (unbalanced[0] / static.SKS[0, 0])
