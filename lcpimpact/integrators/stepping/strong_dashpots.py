r"""Closed contacts on dashpots that stop a body within a step.

A contact of relative degree 1 moves masses against the dashpots of its massless nodes. With w of those eliminated,
unit forces r of such contacts change the rates of their gaps by Y through the dashpots alone, and by G in unit time,

.. math:: \hat H = H_m - H_d C_{dd}^{-1} C_{dm}, \qquad Y = H_d C_{dd}^{-1} H_d^T, \qquad
          G = \hat H M^{-1} \hat H^T .

While they are closed, their approach decays by exp(-z) in a step, with z the eigenvalues of h Y⁻¹ G: c h/m of one body on
one dashpot. A step of weight θ multiplies it by (1 - (1 - θ) z)/(1 + θ z), which for z > 1/(1 - θ) changes its sign:
the body would be thrown back by a dashpot. There the weight is instead

.. math:: θ_k = \frac{1}{1 - e^{-z}} - \frac{1}{z} \ge 1 - \frac{1}{z} ,

with which the approach decays by exp(-z) and moves by its integral; from 1 - 1/z on it does not change its sign.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.sparse.linalg import splu

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.errors import UnsupportedError
from lcpimpact.integrators.stepping.elimination import product, solve
from lcpimpact.scheme.dynamics import Dynamics, once
from lcpimpact.scheme.sparse import SparseDynamics

ROUNDING = 1e-9
"""Eigenvalues below this part of the largest are zero: rows on one massless node do not give way to each other."""

MOST_EXAMINED = 100
"""Number of contacts of a sparse scheme that are examined one by one."""


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
    rows = np.flatnonzero(d.unilateral & (d.relative_degree == 1) & d.stores_energy)
    massive, E = np.flatnonzero(d.massive), d.decomposition.damped
    H, kind = d.H[rows], np.result_type(d.M, d.C)
    if not len(rows) or not len(massive):
        none = np.zeros((0, 0))
        return DampedRows(rows[:0], np.zeros((0, len(d.nodes))), none, none)
    C_d, H_d = product(E.T, d.C), product(H, E)
    transmitted = solve(product(C_d, E), np.array(H_d.T, dtype=kind)).T
    acting: Any = np.full(H.shape, 0.0, dtype=kind)
    acting[:, massive] = (H - product(transmitted, C_d))[:, massive]
    M = d.M[np.ix_(massive, massive)]
    moved = solve(M, np.array(acting[:, massive].T, dtype=kind))
    return DampedRows(rows, acting, product(transmitted, H_d.T), product(acting[:, massive], moved))


def may_stop(d: Dynamics, h: float, θ: float) -> bool:
    """Return whether some contacts may have z > 1/(1 - θ): by the sums of |h G| over the rows, and Y of each alone."""
    found = damped_rows(d)
    for i in range(len(found.rows)):
        z: Any = 0.0
        for j in range(len(found.rows)):
            if found.Y[j, j] > 0.0:
                z = z + h * abs(found.G[i, j]) / found.Y[j, j]
        if z * (1.0 - θ) > 1.0:
            return True
    return False


def refuse_strong_dashpots(d: SparseDynamics, h: float, θ: float) -> None:
    """Refuse sparse steps that would throw bodies back from dashpots, each contact by itself.

    Raises
    ------
    UnsupportedError
        If a contact has z > 1/(1 - θ).
    """
    rows, m = np.flatnonzero(d.relative_degree == 1), np.flatnonzero(d.massive)
    plates = np.flatnonzero(d.kinds.massless)
    if not len(rows) or not len(m) or θ == 1.0:
        return
    M, C = d.M.diagonal()[m], d.C[plates]
    strength = C[:, plates].diagonal()
    held = abs(d.H[rows])[:, plates] @ strength
    # A plate gives way at least as its own dashpots do, if all else is held.
    strong = rows[2.0 * h * held * (1.0 - θ) > M.min()][:MOST_EXAMINED]
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
            raise UnsupportedError(
                f"the dashpot under contact {d.reactions[int(i)]!r} stops its body within a step of {h:g} s, from which "
                f"sparse steps would throw it back: take dt <= {h / (z * (1.0 - θ)):.3g}, theta=1, or Scheme in place of "
                "SparseScheme"
            )


def weights(d: Dynamics, h: float, θ: float, closed: Flags) -> list[tuple[float, list[int]]]:
    """Return θ_k > θ of ``closed`` contacts that stop masses within a step, with their numbers among the damped rows.

    Contacts that neither share a mass nor a dashpot have their own θ_k.
    """
    rows, _, Y, G = damped_rows(d)
    found, left = [], set(np.flatnonzero(closed[rows]).tolist())
    while left:
        part = _joined(left, (Y != 0.0) | (G != 0.0))
        left -= set(part)
        z = h * _largest_ratio(G[np.ix_(part, part)], Y[np.ix_(part, part)])
        if z * (1.0 - θ) > 1.0:
            found.append((float(1.0 / -np.expm1(-z) - 1.0 / z), part))
    return found


def largest_weight(d: Dynamics, h: float, θ: float, closed: Flags) -> float:
    """Return the largest of the `weights`, θ for none."""
    return max([θ, *(θ_k for θ_k, _ in weights(d, h, θ, closed))])


def added_mass(d: Dynamics, h: float, θ: float, closed: Flags) -> Array:
    """Return N (n, n), by which M/θ_k exceeds M/θ in the directions of ``closed`` contacts."""
    _, H, _, G = damped_rows(d)
    N = np.zeros((len(d.nodes), len(d.nodes)))
    for θ_k, part in weights(d, h, θ, closed):
        inertia = np.linalg.pinv(G[np.ix_(part, part)], rcond=ROUNDING, hermitian=True)
        N += (1.0 / θ_k - 1.0 / θ) * (H[part].T @ inertia @ H[part])
    return N


def early_weights(d: Dynamics, h: float, θ: float, closed: Indices) -> Array:
    """Return E (n, n) with w = v + (θ + E) (v⁺ - v) at the masses, while some contacts are closed."""
    E, m = np.zeros((len(d.nodes), len(d.nodes))), np.ix_(d.massive, d.massive)
    N = added_mass(d, h, θ, np.isin(np.arange(len(d.contacts)), closed))[m]
    if N.any():
        M = d.M[m]
        E[m] = np.linalg.solve(M / θ + N, M) - θ * np.eye(len(M))
    return E


def _joined(left: set[int], linked: Flags) -> list[int]:
    """Return the rows that are linked with the first of ``left``, among them."""
    part, new = [], [min(left)]
    while new:
        part.append(i := new.pop())
        new += [j for j in left if linked[i, j] and j not in part and j not in new]
    return sorted(part)


def _largest_ratio(G: Array, Y: Array) -> float:
    """Return the largest eigenvalue of Y⁻¹ G, where Y is not zero."""
    sizes, X = np.linalg.eigh(Y)
    given = sizes > ROUNDING * sizes[-1]
    roots = X[:, given] / np.sqrt(sizes[given])
    return float(np.linalg.eigvalsh(roots.T @ G @ roots)[-1])
