r"""Contact modes of a Lagrangian system: accelerations, impacts, jams, and the next mode.

In a mode some rows a have U' = 0 and an unknown reaction; friction that slides, or that other rows hold at rest, is in a
ratio to its normal force. So r = T r_a, and

.. math:: M v' = F + H^T T r_a, \qquad H_a v' + κ_a = 0, \qquad G = H_a M^{-1} H^T T .

The next mode is a solution of the LCP of accelerations, in which the rates that are not zero tell where friction slides.
While it does G is not symmetric, and the LCP may have no solution or several (Painlevé). Without a solution an impulse
follows that keeps U_N = 0, an impact without collision: here a *jam*. So it does where

.. math:: p = \det G / \prod_i (H_i M^{-1} H_i^T)

falls to zero, and the forces grow without limit.

Sources: Pfeiffer and Glocker, *Multibody Dynamics with Unilateral Contacts* (1996); Génot and Brogliato, *New results on
Painlevé paradoxes* (1999).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.hybrid.friction import ImpactLCP, NoVelocity
from lcpimpact.hybrid.mode_choice import SAME_RTOL, Ambiguous, ModeLCP, basic_solutions
from lcpimpact.hybrid.system import ZERO, Mode
from lcpimpact.lcp.friction import GLOCKER, FrictionRows, friction_maps
from lcpimpact.numerics.double_double import DoubleDouble
from lcpimpact.scheme.lagrangian import LagrangianDynamics, images
from lcpimpact.scheme.motion_function import MotionFunction

DEPENDENT_RTOL = 1e-9
"""Part of a row that is left when other rows are removed from it, below which it depends on them."""

PRESS_RTOL = 1e-9
"""Approach in units of the speeds by which forces press in a jam."""


class Here(NamedTuple):
    """M, F, g, H, χ and κ at a time, a place and a velocity (..., shape)."""

    M: Array
    F: Array
    g: Array
    H: Array
    chi: Array
    kappa: Array

    def rates(self, v: Array) -> Array:
        """Return U = H v + χ (..., nc)."""
        return images(self.H, v) + self.chi


@dataclass(frozen=True)
class MovingMode:
    """A contact mode of a Lagrangian system.

    Attributes
    ----------
    mode : Mode                     the rows with u = 0 or U = 0, and the directions of slips, as events name them
    active : tuple of int           the rows with an unknown reaction and U' = 0
    ratios : tuple of (int, float)  the rows whose friction is in a ratio to the normal force, and the ratio
    at_limit : tuple of int         rows that stick with friction at its limit
    grazing : tuple of int          open contacts that touch without a force
    """

    mode: Mode
    active: tuple[int, ...]
    ratios: tuple[tuple[int, float], ...]
    at_limit: tuple[int, ...] = ()
    grazing: tuple[int, ...] = ()

    @property
    def unsymmetric(self) -> bool:
        """Whether friction in a ratio to normal forces makes G unsymmetric, so that it may become singular."""
        return any(ratio for _, ratio in self.ratios)


class KnownRows(NamedTuple):
    """Rows as they are known before the next mode is chosen (nc,) each.

    Attributes
    ----------
    closed : array of bool      contacts with g = 0 and U = 0 that may stay closed
    signs : array of int        signs of the rates of friction, 0 where it may stick
    breaks : bool               whether friction breaks loose, so that what is at its limit with it slips too
    """

    closed: Flags
    signs: Indices
    breaks: bool


@dataclass(frozen=True, eq=False)
class MovingSystem:
    """A Lagrangian system, with the mechanics of its modes.

    Attributes
    ----------
    d : LagrangianDynamics
    solver : str                name of an LCP solver
    values : MotionFunction     all of `Here`
    rubbing : (nf,) array       the rows with friction, μ > 0
    """

    d: LagrangianDynamics
    solver: str
    values: MotionFunction
    rubbing: Indices

    @classmethod
    def of(cls, d: LagrangianDynamics, solver: str) -> MovingSystem:
        """Return the system whose LCPs a solver solves."""
        values = MotionFunction(d.forces_of.traced, (*d.forces_of.results[:2], *d.rows_of.results))
        return cls(d, solver, values, np.flatnonzero(d.tangential & (d.mu > 0.0)))

    def here(self, t: float | Array, q: Array, v: Array) -> Here:
        """Return the values for t (...), q and v (..., n)."""
        return Here(*self.values(t, q, v))

    def reactions_of(self, mode: MovingMode) -> Array:
        """Return T (nc, k), with which r = T r_a."""
        T = np.zeros((len(self.d.contacts), len(mode.active)))
        T[list(mode.active), np.arange(len(mode.active))] = 1.0
        for i, ratio in mode.ratios:
            T[i] = ratio * T[self.d.normals[i]]
        return T

    def accelerations(self, here: Here, mode: MovingMode) -> tuple[Array, Array, Array]:
        """Return v' (..., n), r (..., nc) and p (...,) in a mode."""
        active = list(mode.active)
        if not active:
            free = solved(here.M, here.F[..., None])[..., 0]
            return free, np.zeros((*free.shape[:-1], len(self.d.contacts))), np.ones(free.shape[:-1])
        T, Ha = self.reactions_of(mode), here.H[..., active, :]
        back = np.swapaxes(here.H, -1, -2)
        X = solved(here.M, np.concatenate([here.F[..., None], back @ T, back[..., active]], axis=-1))
        k = len(active)
        G, sizes = Ha @ X[..., 1 : k + 1], np.einsum("...in,...ni->...i", Ha, X[..., k + 1 :])
        q = images(Ha, X[..., 0]) + here.kappa[..., active]
        p = np.asarray(np.linalg.det(G / sizes[..., None]), dtype=np.float64)
        G = np.where(p[..., None, None] == 0.0, np.nan, G)
        r = solved(G, -q[..., None])[..., 0]
        return X[..., 0] + images(X[..., 1 : k + 1], r), r @ T.T, p

    def projected(
        self, t: float | Array, q: Array, v: Array, places: list[int], rates: list[int], *, rounds: int = 2
    ) -> tuple[Array, Array]:
        """Return q and v (..., n) with g = 0 in the rows ``places`` and U = 0 in ``rates``, by the least change.

        Changes are measured by the kinetic energy that they would have as velocities.

        ``rounds``: number of corrections of q, of which each squares the error.
        """
        here = self.here(t, q, v)
        for _ in range(rounds):
            here = self.here(t, q, v)
            q = q - _least(here, places, here.g)
        return q, v - _least(here, rates, here.rates(v))

    # ---- impulses ----------------------------------------------------------------------------------------------------

    def impact(self, here: Here, v: Array, near: Flags, e: Array, speeds: Array) -> Array:
        """Return the impulses (nc,) of an impact of the contacts ``near`` (nc,), with coefficients e (nc,).

        ``speeds`` (nc,) are the sizes of the rates, of which `ZERO` is rounding.

        Raises
        ------
        NoVelocity
            If no velocity is found that obeys the law.
        """
        U = here.rates(v)
        back = np.where(self.d.impenetrable & (-ZERO * speeds < U), 0.0, e)
        return self._impulses(here, near, U * (1.0 + back), self.d.mu)

    def jam(self, here: Here, v: Array, near: Flags, speeds: Array, p: float = 0.0, *, beyond: float = 4.0) -> Array:
        """Return the impulses (nc,) of an impact without collision of the closed contacts ``near`` (nc,).

        With U_N = 0 no impulse solves the law always. The one sought is the limit of those by which forces that press for a
        moment bring contacts with a small approach to rest. Where |p| has just come to zero, to ``p``, it is that beyond it.

        ``beyond``: increase of μ in units of p, with which p has changed its sign.

        Raises
        ------
        NoVelocity
            If no impulse is found.
        """
        d = self.d
        U = np.where(d.impenetrable, 0.0, here.rates(v))
        mu = d.mu * (1.0 + beyond * p)
        ξ, press = U * (1.0 + d.restitution), np.where(d.impenetrable, PRESS_RTOL * speeds.max(), 0.0)
        once, twice = (self._impulses(here, near, ξ - factor * press, mu) for factor in (1.0, 2.0))
        P = 2.0 * once - twice
        if not (np.abs(P) > 2.0 * np.abs(twice - once)).any():
            raise NoVelocity
        return P

    def _impulses(self, here: Here, near: Flags, ξ: Array, mu: Array) -> Array:
        """Return the impulses (nc,) of contacts and joints with ξ (nc,) = U + e U, by the law of impact."""
        d = self.d
        rubbing = self.rubbing[near[d.normals[self.rubbing]]]
        rows = np.concatenate([np.flatnonzero(near), rubbing, np.flatnonzero(d.bilateral)])
        place = np.full(len(d.contacts), -1)
        place[rows] = np.arange(len(rows))
        H = here.H[rows]
        G = DoubleDouble.of(H @ solved(here.M, H.T))
        friction = FrictionRows(place[rubbing], place[d.normals[rubbing]], mu[rubbing], GLOCKER)
        law = ImpactLCP(G, DoubleDouble.of(ξ[rows]), d.r_min[rows], d.r_max[rows], friction, self.solver, ZERO)
        P, found = law.solve_directions()[0].hi, np.zeros(len(d.contacts))
        terms = np.abs(ξ[rows]) + np.abs(G.hi) @ np.abs(P)
        # An impulse that is rounding is no impact.
        found[rows] = np.where(np.abs(P * np.diag(G.hi)) <= ZERO * terms, 0.0, P)
        return found

    # ---- the next mode -----------------------------------------------------------------------------------------------

    def choose(self, here: Here, known: KnownRows) -> MovingMode:
        """Return the mode by the LCP of accelerations.

        Raises
        ------
        FailureError
            If it has no solution.
        Ambiguous
            If it has several that accelerate the system differently.
        """
        mode, loose = self._chosen(here, known)
        while known.breaks and loose:
            signs = known.signs.copy()
            for i, sign in loose:
                signs[i] = sign
            known = known._replace(signs=signs)
            mode, loose = self._chosen(here, known)
        return replace(mode, at_limit=tuple(i for i, _ in loose))

    def _chosen(self, here: Here, known: KnownRows) -> tuple[MovingMode, list[tuple[int, int]]]:
        """Return the mode by the LCP of accelerations, and friction at its limit, with the sign of the slip that follows."""
        d = self.d
        contacts, joints = np.flatnonzero(known.closed), np.flatnonzero(d.bilateral)
        rubbing = self.rubbing[known.closed[d.normals[self.rubbing]]]
        sticking = rubbing[known.signs[rubbing] == 0]
        sliding = rubbing[known.signs[rubbing] != 0]
        rows = np.concatenate([contacts, sticking, joints])
        place = np.full(len(d.contacts), -1)
        place[rows] = np.arange(len(rows))
        T = np.zeros((len(d.contacts), len(rows)))
        T[rows, np.arange(len(rows))] = 1.0
        T[sliding] = -(known.signs * d.mu)[sliding, None] * T[d.normals[sliding]]
        X = solved(here.M, np.column_stack([here.F, here.H.T @ T]))
        H, W = here.H[rows], here.H[rows] @ X[:, 1:]
        q = H @ X[:, 0] + here.kappa[rows]
        terms = np.abs(H) @ np.abs(X[:, 0]) + np.abs(here.kappa[rows])
        friction = FrictionRows(place[sticking], place[d.normals[sticking]], d.mu[sticking], GLOCKER)
        maps = friction_maps(W, d.r_min[rows], d.r_max[rows], friction)
        lcp = ModeLCP(
            DoubleDouble.of(maps.E @ W @ maps.T + maps.V),
            DoubleDouble.of(np.where(np.abs(q) <= ZERO * terms, 0.0, q) @ maps.E.T), maps.lower, maps.upper,
        )  # fmt: skip
        answers = [maps.T @ z for z in basic_solutions(lcp, self.solver)] if len(rows) else [np.zeros(0)]
        by_force = np.abs(X[:, 1:])
        for other in answers[1:]:
            size = np.abs(X[:, 0]) + by_force @ (np.abs(other) + np.abs(answers[0]))
            if (np.abs(X[:, 1:] @ (other - answers[0])) > SAME_RTOL * size).any():
                raise Ambiguous(lcp)
        r, reaction = answers[0], np.zeros(len(d.contacts))
        reaction[rows] = r
        acceleration, tiny = np.zeros(len(d.contacts)), np.zeros(len(d.contacts))
        acceleration[rows] = q + W @ r
        tiny[rows] = SAME_RTOL * (terms + np.abs(W) @ np.abs(r))
        unit = np.zeros(len(d.contacts))
        unit[rows] = np.abs(np.einsum("in,ni->i", H, solved(here.M, H.T)))
        return self._sorted(here, known, reaction, acceleration, tiny, unit)

    def _sorted(
        self, here: Here, known: KnownRows, r: Array, a: Array, tiny: Array, unit: Array
    ) -> tuple[MovingMode, list[tuple[int, int]]]:
        """Return the mode by forces r and accelerations a (nc,), and the friction at its limit, with the sign of its slip.

        Accelerations below ``tiny`` (nc,) are rounding, and so are forces that change them by less, ``unit`` (nc,) each.
        """
        d = self.d
        active: list[int] = []
        basis = RowBasis(here.M)
        closed, grazing = list[int](), list[int]()
        slips: list[tuple[int, int]] = []
        ratios: list[tuple[int, float]] = []
        loose: list[tuple[int, int]] = []
        pressed = [i for i in map(int, np.flatnonzero(known.closed)) if r[i] * unit[i] > tiny[i]]
        for i in (*map(int, np.flatnonzero(d.bilateral)), *pressed):
            closed.append(i)
            if basis.add(here.H[i]):
                active.append(i)
        for i in map(int, np.flatnonzero(known.closed)):
            if i in pressed or a[i] > tiny[i]:
                continue
            if basis.depends(here.H[i]):
                closed.append(i)
            else:
                grazing.append(i)
        for i in map(int, self.rubbing):
            normal, μ = int(d.normals[i]), float(d.mu[i])
            if normal not in closed:
                continue
            sign = int(known.signs[i])
            at_bound = sign or (μ * r[normal] - abs(r[i])) * unit[i] <= tiny[i]
            if sign or (at_bound and normal in active and abs(a[i]) > tiny[i]):
                sign = sign or int(np.sign(a[i]))
                slips.append((i, sign))
                ratios.append((i, -sign * μ))
                continue
            closed.append(i)
            if normal not in active:
                continue
            if not basis.add(here.H[i]):
                ratios.append((i, float(np.clip(r[i] / r[normal], -μ, μ))))
                continue
            active.append(i)
            if at_bound:
                loose.append((i, -int(np.sign(r[i]))))
        none = (0,) * len(d.contacts)
        mode = Mode(tuple(sorted(closed)), tuple(slips), none, none)
        return MovingMode(mode, tuple(active), tuple(ratios), (), tuple(grazing)), loose


def solved(A: Array, b: Array) -> Array:
    """Return A⁻¹ b for matrices A (..., n, n), and b (..., n, m) or one b (n,)."""
    return np.asarray(np.linalg.solve(A, b), dtype=np.float64)


def _least(here: Here, rows: list[int], off: Array) -> Array:
    """Return the least x (..., n), in the metric of M, with H x = ``off`` (..., nc) in some rows."""
    J = here.H[..., rows, :]
    MJ = solved(here.M, np.swapaxes(J, -1, -2))
    forces = solved(J @ MJ, off[..., rows, None])[..., 0]
    return images(MJ, forces)


class RowBasis:
    """Rows that are independent in the metric of M⁻¹."""

    def __init__(self, M: Array) -> None:
        self.L = np.asarray(np.linalg.cholesky(M), dtype=np.float64)
        self.rows = np.zeros((0, len(M)))

    def rest(self, row: Array) -> tuple[Array, float]:
        """Return the part of a row beyond those of the basis, scaled, and its length relative to that of the row."""
        scaled = solved(self.L, row)
        left = scaled
        for _ in range(2):
            left = left - self.rows.T @ (self.rows @ left)
        size = float(np.linalg.norm(scaled))
        return left, float(np.linalg.norm(left)) / size if size > 0.0 else 0.0

    def depends(self, row: Array) -> bool:
        """Return whether a row depends on those of the basis."""
        return self.rest(row)[1] <= DEPENDENT_RTOL

    def add(self, row: Array) -> bool:
        """Add a row to the basis, unless it depends on those of it, and return whether it was added."""
        left, part = self.rest(row)
        if part <= DEPENDENT_RTOL:
            return False
        self.rows = np.vstack([self.rows, left / np.linalg.norm(left)])
        return True
