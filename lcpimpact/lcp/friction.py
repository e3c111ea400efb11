r"""Planar Coulomb friction as a linear complementarity problem, in three formulations.

The rows ξ = W P + q hold normal ones, 0 <= ξ_N ⟂ P_N >= 0, and tangential ones,

.. math:: -μ P_N \le P_T \le μ P_N , \qquad P_T \in -μ P_N \operatorname{Sgn} ξ_T .

*Glocker's* three rows a contact have the unknowns P_N, P_R = μ P_N + P_T and ξ_L, the negative part of ξ_T,

.. math:: 0 \le P_N \perp ξ_N \ge 0, \qquad 0 \le P_R \perp ξ_T + ξ_L \ge 0, \qquad 0 \le ξ_L \perp μ P_N - P_T \ge 0 .

*Stewart and Trinkle* split P_T = β⁺ - β⁻ and have the largest |ξ_T| = λ of four rows,

.. math:: 0 \le P_N \perp ξ_N \ge 0, \qquad 0 \le β^\pm \perp λ \pm ξ_T \ge 0, \qquad
          0 \le λ \perp μ P_N - β^+ - β^- \ge 0 .

Both have the same solutions; neither matrix is positive semidefinite. With ξ_N - μ λ in place of ξ_N it would be: so do
*Anitescu and Potra* relax the law to a convex problem that always has a solution, at the price that sliding bodies lift off
at the rate μ |ξ_T|.

A box with the bounds μ P_N of the last iterate, solved again until they agree, is not offered: of random problems with two
contacts it needs 9 boxes at μ = 0.1, and does not converge within 200 in 4 % at μ = 0.6 and in 8 % at μ = 1.

References
----------
Glocker, *Set-Valued Force Laws* (2001); Stewart and Trinkle (1996); Anitescu and Potra (1997); Anitescu (2006).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Array, Indices, Matrix, Vector
from lcpimpact.compiled import compiled

FORMULATIONS = ("glocker", "stewart-trinkle", "anitescu-potra")
"""Names of the formulations; a `FrictionRows` has the position in this tuple."""

GLOCKER, STEWART_TRINKLE, ANITESCU_POTRA = range(3)


class FrictionRows(NamedTuple):
    """Rows with friction.

    Attributes
    ----------
    rows, normals : (nf,) arrays    the tangential row and the normal row of each
    mu : (nf,) array                coefficients of friction
    formulation : int               position in `FORMULATIONS`
    continues : bool                whether a step tries first whether each row stays open, sticks or slips as before
    """

    rows: Indices
    normals: Indices
    mu: Vector
    formulation: int
    continues: bool = False


class FrictionMaps(NamedTuple):
    """The complementarity problem of rows with friction: unknowns z with P = T z, and its rows w = E ξ + V z.

    Attributes
    ----------
    E : (m, n) array
    T : (n, m) array
    V : (m, m) array
    lower, upper : (m,) arrays      bounds of z
    """

    E: Matrix
    T: Matrix
    V: Matrix
    lower: Vector
    upper: Vector


@compiled()
def friction_maps(W: Matrix, lower: Vector, upper: Vector, friction: FrictionRows) -> FrictionMaps:
    """Return the complementarity problem of rows ξ = W P + q of which some have friction; its matrix is E W T + V.

    λ and ξ_L are in units of ξ_T/W_TT, with a power of two near W_TT, so that all entries of the matrix have one unit.
    """
    n = len(lower)
    nf = len(friction.rows)
    split = friction.formulation != GLOCKER
    m = n + (2 if split else 1) * nf
    E = np.zeros((m, n))
    T = np.zeros((n, m))
    V = np.zeros((m, m))
    low, high = np.zeros(m), np.full(m, np.inf)
    for i in range(n):
        E[i, i] = T[i, i] = 1.0
        low[i], high[i] = lower[i], upper[i]
    for k in range(nf):
        t = friction.rows[k]
        j = friction.normals[k]
        μ = friction.mu[k]
        unit = math.ldexp(1.0, math.frexp(W[t, t])[1]) if W[t, t] > 0.0 else 1.0
        last = m - nf + k
        low[t], high[t] = 0.0, np.inf
        V[t, last] = unit
        if split:
            other = n + k
            E[other, t] = T[t, other] = -1.0
            V[other, last] = unit
            V[last, j] = μ * unit
            V[last, t] = -unit
            V[last, other] = -unit
            if friction.formulation == ANITESCU_POTRA:
                V[j, last] = -μ * unit
        else:
            T[t, j] = -μ
            V[last, j], V[last, t] = 2.0 * μ * unit, -unit
    return FrictionMaps(E, T, V, low, high)


def lcp_matrix(W: Array, lower: Array, upper: Array, friction: FrictionRows) -> Array:
    """Return the matrix of the complementarity problem of rows of which some have friction."""
    maps = friction_maps(W, lower, upper, friction)
    return np.asarray(maps.E @ W @ maps.T + maps.V)


@compiled()
def unknowns(T: Matrix, P: Vector, friction: FrictionRows) -> Vector:
    """Return a guess of the unknowns z from impulses P (n,)."""
    z = np.zeros(T.shape[1])
    z[: len(P)] = P
    for k in range(len(friction.rows)):
        t = friction.rows[k]
        if friction.formulation == GLOCKER:
            z[t] = P[t] + friction.mu[k] * P[friction.normals[k]]
        else:
            z[t], z[len(P) + k] = max(P[t], 0.0), max(-P[t], 0.0)
    return z
