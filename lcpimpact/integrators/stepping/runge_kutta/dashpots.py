r"""Non-linear dashpots on the right-hand side, whose rates at massless nodes follow from a balance of forces.

Between masses a rate is a state. At massless nodes it depends on the reactions and on the forces of the dashpots,

.. math:: v = V x + V_s s + V_r r, \qquad s = c_* v - F(v) ,

since such a node has been eliminated with a linear dashpot c_* in the place of the other; see
`lcpimpact.scheme.first_order.Inputs`. While a set of contacts pushes, u^(ρ) = 0 gives their r, and what remains is the
equation of `lcpimpact.scheme.rate_law.rates_together`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Indices, Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.lcp.lapack import lu_solve
from lcpimpact.numerics.rounding import EPS
from lcpimpact.scheme.rate_law import dashpot_force, rates_together


class Dashpots(NamedTuple):
    """The non-linear dashpots of a system over x = (y, signals, loads).

    Attributes
    ----------
    laws : (nd, nr) array           rows of `lcpimpact.scheme.rate_law`, c_* with the sign minus
    first : int                     the position of their forces among those of springs and general forces, s
    V, V_s, V_r : arrays            v = V x + V_s s + V_r r (nd, .)
    O_s, E : arrays                 how their forces enter u^(ρ) and y' (., nd)
    """

    laws: Matrix
    first: int
    V: Matrix
    V_s: Matrix
    V_r: Matrix
    O_s: Matrix
    E: Matrix


class Pushing(NamedTuple):
    """The contacts that push (na,), their part of G (na, na), and their u^(ρ) without reactions and dashpots (na,)."""

    rows: Indices
    G: Matrix
    free: Vector


@compiled()
def dashpot_forces(dashpots: Dashpots, free: Vector, pushing: Pushing, s: Vector, v: Matrix) -> bool:
    """Write the rates v (1, nd) of the dashpots, and their forces into s, while some contacts push.

    ``free`` are their rates without reactions and their own forces. Returns False where the contacts that push do not
    determine their reactions.
    """
    nd, na = len(free), len(pushing.rows)
    first = dashpots.first
    mobility = np.empty((nd, nd))
    known = np.empty((1, nd))
    for j in range(nd):
        known[0, j] = free[j]
        for k in range(nd):
            mobility[j, k] = dashpots.V_s[j, first + k]
    b = np.empty(na)
    for k in range(nd + 1 if na > 0 else 0):
        for a in range(na):
            b[a] = dashpots.O_s[pushing.rows[a], k] if k < nd else pushing.free[a]
        if not lu_solve(pushing.G, b):
            return False
        for j in range(nd):
            moved = 0.0
            for a in range(na):
                moved += dashpots.V_r[j, pushing.rows[a]] * b[a]
            if k < nd:
                mobility[j, k] -= moved
            else:
                known[0, j] -= moved
    rates_together(dashpots.laws, mobility, known, v, 4e-16, 1000)
    for j in range(nd):
        F, _ = dashpot_force(dashpots.laws[j], v[0, j])
        s[first + j] = -dashpots.laws[j, 7] * v[0, j] - F
    return True


@compiled()
def add_secants(dashpots: Dashpots, v: Vector, G: Matrix, B: Matrix) -> None:
    """Add to G and B what the secants F/v of the dashpots change in them, by which they follow impulses of a short time."""
    nd, first = len(v), dashpots.first
    J = np.empty(nd)
    S = np.empty((nd, nd))
    y = np.empty(nd)
    for j in range(nd):
        c = -dashpots.laws[j, 7]
        F, slope = dashpot_force(dashpots.laws[j], v[j])
        secant = F / v[j] if v[j] != 0.0 else slope  # infinite for n < 1
        J[j] = c - min(secant, c / EPS)
    for i in range(G.shape[1]):
        for j in range(nd):
            y[j] = dashpots.V_r[j, i]
            for k in range(nd):
                S[j, k] = (1.0 if j == k else 0.0) - dashpots.V_s[j, first + k] * J[k]
        if not lu_solve(S, y):
            continue
        for j in range(nd):
            for row in range(G.shape[0]):
                G[row, i] += dashpots.O_s[row, j] * J[j] * y[j]
            for row in range(B.shape[0]):
                B[row, i] += dashpots.E[row, j] * J[j] * y[j]
