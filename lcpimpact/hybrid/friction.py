r"""Impacts with friction and joints: Newton's law for normal, tangential and bilateral rows, as one LCP.

.. math:: 0 \le P_N \perp U_N^+ + e U_N^- \ge 0, \qquad
          -μ P_N \le P_T \le μ P_N \;\perp\; U_T^+ + e_T U_T^-, \qquad U_J^+ = 0, \qquad U^+ = U^- + G P,

with Glocker's rows for the friction (see `lcpimpact.lcp.friction`), first in floats and then in double-doubles.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.errors import FailureError
from lcpimpact.hybrid.complementarity import complementary
from lcpimpact.hybrid.system import System
from lcpimpact.lcp.friction import GLOCKER, FrictionRows, friction_maps
from lcpimpact.lcp.solve import solve_lcp
from lcpimpact.numerics.double_double import DoubleDouble


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
    rubbing = np.flatnonzero(d.tangential & (d.relative_degree == 2) & np.isin(d.normals, meeting))
    rows = np.concatenate([meeting, rubbing, np.flatnonzero(d.permanent & (d.relative_degree == 2))])
    place = np.full(nc, -1)
    place[rows] = np.arange(len(rows))
    G = system.fine.G[np.ix_(rows, rows)]
    low, high = system.bounds
    ξ = DoubleDouble(np.ascontiguousarray(U[:, rows])) + DoubleDouble(np.ascontiguousarray(before[:, rows])) * e[rows]
    mu = np.where(before[0] == 0.0, d.mu_s, d.mu)[rubbing]
    friction = FrictionRows(place[rubbing], place[d.normals[rubbing]], mu, GLOCKER)
    law = ImpactLCP(G, ξ, low[rows], high[rows], friction, solver, zero)
    P, sticks, moves = law.solve_directions()
    while (loose := moves & (mu > d.mu[rubbing])).any():
        mu[loose] = d.mu[rubbing][loose]
        P, sticks, moves = law.solve_directions()
    impulses, rests = np.zeros(nc), np.zeros(nc, dtype=np.bool_)
    terms = np.abs(ξ.hi) + np.abs(G.hi) @ np.abs(P.hi)
    # An impulse that is rounding is no impact.
    impulses[rows] = np.where(np.abs(P.hi * np.diag(G.hi)) <= zero * terms, 0.0, P.hi)
    stops = (P.hi > 0.0) | d.bilateral[rows]
    stops[friction.rows] = sticks
    rests[rows] = stops & (e[rows] * before[0, rows] == 0.0)
    return state + system.fine.B[:, rows] @ P, impulses, rests


class NoVelocity(np.linalg.LinAlgError):
    """No velocity was found that obeys the law of impact."""


class ImpactLCP(NamedTuple):
    """The law of impact of some rows, ξ = G P + ξ_0 with the bounds of P, and their friction."""

    G: DoubleDouble
    ξ: DoubleDouble
    lower: Array
    upper: Array
    friction: FrictionRows
    solver: str
    zero: float

    def solve_directions(self) -> tuple[DoubleDouble, Flags, Flags]:
        """Return P, which rows with friction stick, and which slip after the impact (nf,)."""
        # What slips keeps its direction in most impacts; then its impulse follows from the normal one at any scale.
        rows = self.friction.rows
        signs = np.sign(self.ξ.hi[rows])
        found = self.try_signs(signs)
        while found is None or not found[2].all():
            # That no impulse keeps these directions says nothing of the impact.
            signs = np.zeros(len(rows)) if found is None else np.where(found[2], signs, 0.0)
            found = self.try_signs(signs)
        P, sticks, _ = found
        size = self.zero * (np.abs(self.ξ.hi) + np.abs(self.G.hi) @ np.abs(P.hi))[rows]
        return P, sticks, np.abs((self.ξ + self.G @ P).hi[rows]) > size

    def try_signs(self, signs: Array) -> tuple[DoubleDouble, Flags, Flags] | None:
        """Return the result of `solve`, None if no impulses keep the ``signs``.

        Raises
        ------
        NoVelocity
            If none are found without ``signs``.
        """
        try:
            return self.solve(signs)
        except (FailureError, np.linalg.LinAlgError):
            if not signs.any():
                raise NoVelocity from None
            return None

    def solve(self, signs: Array) -> tuple[DoubleDouble, Flags, Flags]:
        """Return P if slips keep their ``signs``, where these are not 0; which stick, and which keep their sign (nf,)."""
        rows, normals, mu = self.friction[:3]
        open_ = np.flatnonzero(signs == 0.0)
        slips = np.flatnonzero(signs)
        part = FrictionRows(rows[open_], normals[open_], mu[open_], GLOCKER)
        maps = friction_maps(self.G.hi.copy(), self.lower, self.upper, part)
        T, n = maps.T.copy(), len(self.lower)
        T[rows[slips]] = 0.0
        T[rows[slips], normals[slips]] = -signs[slips] * mu[slips]
        kept = np.setdiff1d(np.arange(len(maps.lower)), rows[slips])
        E, T = DoubleDouble.of(maps.E[kept]), T[:, kept]
        W = E @ self.G @ DoubleDouble.of(T) + maps.V[np.ix_(kept, kept)]
        q = E @ self.ξ
        low, high = maps.lower[kept], maps.upper[kept]
        guess = solve_lcp(W.hi, q.hi, self.solver, lower=low, upper=high).z
        tiny = self.zero * (np.abs(E.hi) @ np.abs(self.ξ.hi) + np.abs(W.hi) @ np.abs(guess))
        z, w = complementary(W, q, guess, low, high, tiny)
        P = DoubleDouble.of(T) @ z
        after = (self.ξ + self.G @ P).hi[rows]
        size = self.zero * (np.abs(self.ξ.hi) + np.abs(self.G.hi) @ np.abs(P.hi))[rows]
        sticks = np.zeros(len(rows), dtype=np.bool_)
        place = np.searchsorted(kept, np.arange(len(maps.lower)))
        first = place[rows[open_]]
        last = place[n + np.arange(len(open_))]
        # Friction sticks where neither of its bounds is reached.
        sticks[open_] = (z.hi[first] > 0.0) & (w.hi[last] > tiny[last]) & (np.abs(w.hi[first]) <= tiny[first])
        return P, sticks, (signs == 0.0) | (signs * after >= -size)
