r"""Dashpots that stop masses within a step.

Dashpots take the velocities v of the masses by M v' = -C v, with the massless nodes eliminated from C. In a direction p with
C p = λ M p velocities decay by exp(-z) in a step, z = λ h: c h/m of one body on one dashpot. A step of weight θ multiplies
them by (1 - (1 - θ) z)/(1 + θ z), which for z > 1/(1 - θ) changes their sign: a body would be thrown back by a dashpot.
There the weight is instead

.. math:: θ_k = \frac{1}{1 - e^{-z}} - \frac{1}{z} \ge 1 - \frac{1}{z} ,

with which the velocity decays by exp(-z) and moves by its integral; from 1 - 1/z on it does not change its sign.

A closed contact adds to C, or takes directions away. With w of the massless nodes eliminated, unit forces r of contacts of
relative degree 1 change the rates of their gaps by Y through the dashpots alone, and by G in unit time,

.. math:: \hat H = H_m - H_d C_{dd}^{-1} C_{dm}, \qquad Y = H_d C_{dd}^{-1} H_d^T, \qquad
          G = \hat H M^{-1} \hat H^T ,

so that while they are closed C is greater by Ĥᵀ Y⁻¹ Ĥ. While contacts of relative degree 2 are closed, H v = 0: a light
plate on a dashpot moves with the body that rests on it.

A blow of a spring that damps may begin and end within one step. From the rate -U of its ends, with their mean rate w, they
part with e U of their law in a step of weight θ_k where (U + w)/θ_k = (1 + e) U; a smaller one throws them.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from scipy.linalg import null_space
from scipy.sparse.linalg import splu

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.errors import UnsupportedError
from lcpimpact.formula import Formula, Number, Unknown
from lcpimpact.memo import once
from lcpimpact.numerics.elimination import product, solve
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.sparse_dynamics import SparseDynamics

LEAST_COUPLING = 1e-12
"""Least compliance between rows that give way to each other, relative to their own; none on one massless node."""

WEIGHTS = 64
"""Number n of the weights 1/θ_k = 1 + i/n in the direction of a spring whose blow a step ends."""

ONE_STAGE = 2.0
"""Factor of z for steps of several stages, between which velocities oscillate from z = 1 on."""


class DampedRows(NamedTuple):
    """The contacts of relative degree 1.

    Attributes
    ----------
    rows : (nr,) array      their numbers among all rows
    H : (nr, n) array       Ĥ, how they act on the masses
    Y, G : (nr, nr) array   mobility through the dashpots in m/(N s), and of the masses in 1/kg
    """

    rows: Indices
    H: Array
    Y: Array
    G: Array


@once
def damped_rows(d: Dynamics) -> DampedRows:
    """Return the contacts of relative degree 1 of a scheme."""
    rows = np.flatnonzero(d.impenetrable & (d.relative_degree == 1) & d.stores_energy)
    massive, E = np.flatnonzero(d.massive), d.decomposition.damped
    H, kind = d.H[rows], np.result_type(d.M, d.C)
    if not len(rows) or not len(massive):
        none = np.zeros((0, 0))
        return DampedRows(rows[:0], np.zeros((0, len(d.nodes))), none, none)
    C_d, H_d = product(E.T, d.substitute_damping), product(H, E)
    transmitted = solve(product(C_d, E), np.array(H_d.T, dtype=kind)).T
    acting: Array = np.full(H.shape, 0.0, dtype=kind)
    acting[:, massive] = (H - product(transmitted, C_d))[:, massive]
    M = d.M[np.ix_(massive, massive)]
    moved = solve(M, np.array(acting[:, massive].T, dtype=kind))
    return DampedRows(rows, acting, product(transmitted, H_d.T), product(acting[:, massive], moved))


def may_stop(d: Dynamics, h: Number, θ: float) -> bool:
    """Return whether some contacts may have z > 1/(1 - θ): by the sums of |h G| over the rows, and Y of each alone."""
    found = damped_rows(d)
    for i in range(len(found.rows)):
        z: Number = 0.0
        for j in range(len(found.rows)):
            if found.Y[j, j] > 0.0:
                z = z + h * abs(found.G[i, j]) / found.Y[j, j]
        if z * (1.0 - θ) > 1.0:
            return True
    return False


def refuse_strong_dashpots(d: SparseDynamics, h: float, θ: float, *, most_examined: int = 100) -> None:
    """Refuse sparse steps that would throw bodies back from dashpots, each contact by itself.

    ``most_examined``: number of contacts of a sparse scheme that are examined one by one.

    Raises
    ------
    UnsupportedError
        If a contact has z > 1/(1 - θ): of relative degree 2, by the dashpots on two masses that move together.
    """
    rows = np.flatnonzero(d.relative_degree == 1)
    m = np.flatnonzero(d.massive)
    plates = np.flatnonzero(d.kinds.massless)
    if not len(m) or θ == 1.0:
        return

    def refuse(i: int, z: float) -> None:
        raise UnsupportedError(
            f"the dashpot under contact {d.reactions[i]!r} stops its body within a step of {h:g} s, from which "
            f"sparse steps would throw it back: take dt <= {h / (z * (1.0 - θ)):.3g}, theta=1, or Scheme in place of "
            "SparseScheme"
        )

    together = abs(d.H)[:, m]
    both = np.flatnonzero((d.relative_degree == 2) & (np.diff(together.tocsr().indptr) == 2))
    p = together[both]
    damped, moved = (np.asarray((p @ A[m][:, m]).multiply(p).sum(axis=1)).ravel() for A in (d.C, d.M))
    if len(both) and (z := h * damped / moved).max() * (1.0 - θ) > 1.0:
        refuse(int(both[np.argmax(z)]), float(z.max()))
    if not len(rows):
        return
    M, C = d.M.diagonal()[m], d.C[plates]
    strength = C[:, plates].diagonal()
    held = abs(d.H[rows])[:, plates] @ strength
    # A plate gives way at least as its own dashpots do, if all else is held.
    strong = rows[2.0 * h * held * (1.0 - θ) > M.min()][:most_examined]
    if not len(strong):
        return
    S = d.kinds.static[plates]
    factors = splu((C[:, plates] + strength.max() * (S @ S.T)).tocsc())
    for i in strong:
        H = d.H[[int(i)]].toarray()[0]
        moved = factors.solve(H[plates])
        acting = H[m] - C[:, m].T @ moved
        z = h * float(acting**2 @ (1.0 / M)) / float(H[plates] @ moved)
        if z * (1.0 - θ) > 1.0:
            refuse(int(i), z)


@once
def damping(d: Dynamics) -> Array:
    """Return C of the masses, with the massless nodes on dashpots eliminated (nm, nm)."""
    massive, E = np.flatnonzero(d.massive), d.decomposition.damped
    C, C_d = (each := d.substitute_damping)[np.ix_(massive, massive)], product(E.T, each)
    if vanishes(C_d[:, massive]):
        return C
    given = solve(product(C_d, E), np.array(C_d[:, massive]))
    return C - product(C_d[:, massive].T, given)


def vanishes(A: Array) -> bool:
    """Return whether all entries of a matrix are zero, and none is a formula."""
    if A.dtype == np.float64:
        return not A.any()
    return not any(isinstance(each, Formula) or each != 0.0 for each in A.flat)


def may_damp(d: Dynamics, h: float, θ: float) -> bool:
    """Return whether without contacts some direction may have z > 1/(1 - θ): by the sums of |h M⁻¹ C| over the rows.

    Of numbers it is known.
    """
    if θ == 1.0 or not d.stores_energy or vanishes(d.C) or vanishes(C := damping(d)):
        return False
    massive = np.flatnonzero(d.massive)
    rates = solve(d.M[np.ix_(massive, massive)], np.array(C))
    for z in h * np.abs(rates).sum(axis=1):
        if z * (1.0 - θ) > 1.0:
            return rates.dtype != np.float64 or bool(directions(d, h, θ, none(d)))
    return False


def none(d: Dynamics) -> Flags:
    """Return the mode without closed contacts (nc,)."""
    return np.zeros(len(d.contacts), dtype=np.bool_)


def on_strong_dashpots(d: Dynamics, h: float, θ: float) -> Indices | None:
    """Return the contacts that change how masses stop within a step; None if no dashpot stops any.

    They are those of relative degree 1, and those that join masses to what stops, through other contacts too.
    """
    damps, rows = may_damp(d, h, θ), damped_rows(d).rows
    if not (damps or may_stop(d, h, θ)):
        return None
    if not damps or d.C.dtype != np.float64 or d.M.dtype != np.float64:
        return rows
    joined = np.zeros(len(d.contacts), dtype=np.bool_)
    H = d.H != 0.0
    nodes = np.any([np.abs(p) > LEAST_COUPLING * np.abs(p).max() for _, p in directions(d, h, θ, none(d))], axis=0)
    while (more := H[:, nodes].any(axis=1) & ~joined).any():
        joined |= more
        nodes |= H[joined].any(axis=0)
    joined &= d.rigid
    return np.union1d(rows, np.flatnonzero(joined))


def directions(d: Dynamics, h: float, θ: float, closed: Flags) -> list[tuple[float, Array]]:
    """Return z > 1/(1 - θ) and p (n,) of the directions in which masses stop within a step while contacts are ``closed``."""
    massive = np.flatnonzero(d.massive)
    size, X = np.linalg.eigh(d.M[np.ix_(massive, massive)])
    root = X / np.sqrt(size)
    C = root.T @ damping(d) @ root
    rows, H, Y, _ = damped_rows(d)
    pushed = closed[rows]
    rigid = (closed | d.permanent) & (d.relative_degree == 2)
    if pushed.any():
        acting = H[pushed][:, massive] @ root
        given = Y[np.ix_(pushed, pushed)]
        C = C + acting.T @ np.linalg.solve(given + LEAST_COUPLING * np.trace(given) * np.eye(len(given)), acting)
    free = null_space(d.H[rigid][:, massive] @ root) if rigid.any() else np.eye(len(massive))
    λ, P = np.linalg.eigh(free.T @ C @ free)
    found = []
    for z, y in zip(h * λ, (free @ P).T, strict=True):
        if z * (1.0 - θ) > 1.0:
            p = np.zeros(len(d.nodes))
            p[massive] = root @ y
            found.append((float(z), p))
    return found


def weight(z: float) -> float:
    """Return θ_k, with which a velocity decays by exp(-z) in a step, and moves by its integral."""
    return float(1.0 / -np.expm1(-z) - 1.0 / z)


def starting_mass(d: Dynamics, h: float, θ: float) -> Array:
    """Return the matrix of the acceleration with which a step begins, at the start or after a jump of a load.

    It is M, or M + θ h C where some dashpot stops a mass within a step: there M⁻¹ F decays before the step has begun to
    move by it. That of a Lagrangian system is M, as its C is no number.
    """
    if any(isinstance(each, Unknown) for each in d.C.flat):
        return d.M
    return np.asarray(d.M + θ * h * d.C) if may_damp(d, h, 0.5) else d.M


def largest_weight(d: Dynamics, h: float, θ: float, closed: Flags) -> float:
    """Return the largest θ_k of the directions in which ``closed`` contacts of relative degree 1 act, θ for none."""
    rows, H, _, _ = damped_rows(d)
    acting = H[closed[rows]]
    return max([θ, *(weight(z) for z, p in directions(d, h, θ, closed) if (np.abs(acting @ p) > LEAST_COUPLING).any())])


@once
def blows(d: Dynamics) -> Array:
    """Return the mobility 1/m of the masses at each of the `pushes` that is a spring that damps, 0 of others (ns,).

    And 0 where an end is a massless node on more than dashpots to the ground: on these alone it gives way, and e is smaller.
    """
    found = np.zeros(len(d.pushes))
    massive = np.flatnonzero(d.massive)
    held = np.abs(d.K).sum(axis=1) + np.abs(d.H).sum(axis=0) + np.abs(d.C - np.diag(np.diag(d.C))).sum(axis=1) > 0.0
    loose = d.directions[:, ~(d.massive | d.driven) & (held | (np.count_nonzero(d.pushes, axis=0) > 1))].any(axis=1)
    damps = np.flatnonzero(d.power_laws[:, 3:5].any(axis=1) & ~loose)
    if len(damps):
        N = d.directions[np.ix_(damps, massive)]
        found[damps] = np.einsum("ji,ij->j", N, solve(d.M[np.ix_(massive, massive)], np.array(N.T)))
    return found


def added_mass(d: Dynamics, h: float, θ: float, closed: Flags, ends: Mapping[int, int] = MappingProxyType({})) -> Array:
    """Return N (n, n), by which M/θ_k exceeds M/θ in the directions of strong dashpots while contacts are ``closed``.

    And in those of the springs whose blows it ``ends``, each with the i of its weight 1/θ_k = 1 + i/n.
    """
    N = np.zeros((len(d.nodes), len(d.nodes)))
    for z, p in directions(d, h, θ, closed):
        N += (1.0 / weight(z) - 1.0 / θ) * np.outer(d.M @ p, d.M @ p)
    if ends:
        m = np.ix_(d.massive, d.massive)
        R, M = d.directions[list(ends)][:, d.massive], d.M[m]
        G = np.linalg.pinv(R @ np.linalg.solve(M, R.T))
        kept = np.eye(len(M)) - np.linalg.solve(M, R.T) @ G @ R
        inverse_weights = np.array([min(1.0 + i / WEIGHTS, 1.0 / θ) for i in ends.values()])
        N[m] = kept.T @ (M / θ + N[m]) @ kept + R.T @ G @ (inverse_weights[:, None] * R) - M / θ
    return N


def early_weights(d: Dynamics, h: float, θ: float, closed: Indices, ends: Mapping[int, int]) -> Array:
    """Return E (n, n) with w = v + (θ + E) (v⁺ - v) at the masses, while some contacts are closed and blows end."""
    E = np.zeros((len(d.nodes), len(d.nodes)))
    m = np.ix_(d.massive, d.massive)
    N = added_mass(d, h, θ, np.isin(np.arange(len(d.contacts)), closed), ends)[m]
    if N.any():
        M = d.M[m]
        E[m] = np.linalg.solve(M / θ + N, M) - θ * np.eye(len(M))
    return E
