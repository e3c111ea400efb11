r"""Impacts with friction and joints: Newton's law for normal, tangential and bilateral rows, as one LCP.

.. math:: 0 \le P_N \perp U_N^+ + e U_N^- \ge 0, \qquad
          -μ P_N \le P_T \le μ P_N \;\perp\; U_T^+ + e_T U_T^-, \qquad U_J^+ = 0, \qquad U^+ = U^- + G P,

with Glocker's rows for the friction (see `lcpimpact.lcp.friction`), first in floats and then in double-doubles.
"""

from __future__ import annotations

import numpy as np

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.double_double import DoubleDouble
from lcpimpact.hybrid.complementarity import complementary
from lcpimpact.hybrid.system import System
from lcpimpact.lcp.friction import GLOCKER, FrictionRows, friction_maps
from lcpimpact.lcp.solve import solve_lcp


def frictional_impact(
    system: System, state: DoubleDouble, meeting: Indices, e: Array, U: Array, before: Array, solver: str, zero: float
) -> tuple[DoubleDouble, Array, Flags]:
    """Return X after the impacts (N,), the impulses (nc,), and the rows whose rate they bring to zero (nc,).

    Parameters
    ----------
    state : DoubleDouble
        X (N,) before.
    meeting : array of int
        The normal rows with impacts.
    e : (nc,) array
        Coefficients of restitution, 0 at contacts that open already.
    U, before : (2, nc) arrays
        The right and the left limits of the rates U, which differ where a prescribed velocity jumps, as double-doubles.
    """
    d, nc = system.dynamics, len(system.degree)
    rubbing = np.flatnonzero(d.frictional & (d.relative_degree == 2) & np.isin(d.normals, meeting))
    rows = np.concatenate([meeting, rubbing, np.flatnonzero(d.joints & (d.relative_degree == 2))])
    position = {int(i): a for a, i in enumerate(rows)}
    slips, normals = (
        np.array([position[int(i)] for i in each], dtype=np.int64) for each in (rubbing, d.normals[rubbing])
    )
    G, B = system.fine.G[np.ix_(rows, rows)], system.fine.B[:, rows]
    ξ = DoubleDouble(np.ascontiguousarray(U[:, rows])) + DoubleDouble(np.ascontiguousarray(before[:, rows])) * e[rows]
    low, high = system.bounds
    maps = friction_maps(G.hi.copy(), low[rows], high[rows], FrictionRows(slips, normals, d.mu[rubbing], GLOCKER))
    E, T = DoubleDouble.of(maps.E), DoubleDouble.of(maps.T)
    W, q = E @ G @ T + maps.V, E @ ξ
    guess = solve_lcp(W.hi, q.hi, solver, lower=maps.lower, upper=maps.upper).z
    tiny = zero * (np.abs(maps.E) @ np.abs(ξ.hi) + np.abs(W.hi) @ np.abs(guess))
    z, w = complementary(W, q, guess, maps.lower, maps.upper, tiny)
    P = T @ z
    impulses, rests = np.zeros(nc), np.zeros(nc, dtype=np.bool_)
    impulses[rows] = P.hi
    bounces = e[rows] * before[0, rows] != 0.0
    reached = np.abs(w.hi) <= tiny
    n, nf = len(rows), len(rubbing)
    held = (impulses[rows] > 0.0) | d.joints[rows]
    # Friction sticks where neither of its bounds is reached.
    held[slips] = (z.hi[slips] > 0.0) & (w.hi[n : n + nf] > 0.0) & reached[slips]
    rests[rows] = held & ~bounces
    return state + B @ P, impulses, rests
