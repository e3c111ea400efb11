r"""Rates after an impact of several contacts by another law than Newton's, computed in another way than by the run.

In coordinates z = Lᵀ v of the velocities, in which the masses M = L Lᵀ are one, and with the directions X = L⁻¹ Hᵀ of the
impulses, U = Xᵀ z. Impulses P >= 0 that are complementary to U = Xᵀ (z + X P) >= 0 are those of the shortest z + X P, so
that Poisson's compression and expansion are problems of non-negative least squares. Of redundant contacts these leave the
shares of the compression open: those are taken that fit the recorded impulses. The springs of the law of Liu, Zhao and
Brogliato are followed by another method than in the run, of order 5, across the instants at which contacts open and close.
"""

from __future__ import annotations

from functools import lru_cache, partial
from typing import TypeAlias

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.scheme.impact_laws import LZB, ImpactLaw

Numbers: TypeAlias = tuple[float, ...]


def rates_after(law: ImpactLaw, X: Array, U: Array, e: Array, P: Array, k: Array) -> Array:
    """Return U⁺ (k,) of closed contacts; NaN if the impact does not end.

    Parameters
    ----------
    law : str or LZB
    X : (n, k) array        directions of their impulses
    U, e : (k,) arrays      rates before, and coefficients of restitution
    P : (k,) array          recorded impulses, which choose among the shares of redundant contacts
    k : (k,) array          stiffnesses
    """
    size, speed = np.abs(X).max(), np.abs(U).max()
    X = X / size
    if isinstance(law, LZB):
        numbers = (X.T @ X, U / speed, e, k / k.max())
        after = _after_springs(*(tuple(each.ravel().tolist()) for each in numbers), law.exponent)
    elif law == "poisson":
        after = _after_poisson(X, U / speed, e, P * size**2 / speed)
    else:
        after = _after_sequence(X, U / speed, e)
    return np.asarray(speed * after)


def _pushed(X: Array, U: Array) -> Array:
    """Return P >= 0 that are complementary to U + Xᵀ X P >= 0."""
    from scipy.optimize import nnls  # here, as most runs do without it

    return np.asarray(nnls(X, -np.linalg.lstsq(X.T, U, rcond=None)[0])[0])


def _after_poisson(X: Array, U: Array, e: Array, P: Array) -> Array:
    P_c = _pushed(X, U)
    if np.linalg.matrix_rank(X) < X.shape[1]:
        P_c = _fitting_shares(X, P_c, e, P, U + X.T @ (X @ P))
    returned = (1.0 + e) * P_c
    after = U + X.T @ (X @ returned)
    return np.asarray(after + X.T @ (X @ _pushed(X, after)))


def _fitting_shares(X: Array, P_c: Array, e: Array, P: Array, after: Array, *, opens_rate: float = 1e-8) -> Array:
    """Return the shares of a compression that P fit best: P is (1 + e) P_c, or more where a contact stays closed.

    ``opens_rate``: rate ``after`` the impact, in units of the largest before, above which a contact opens.
    """
    from scipy.optimize import nnls

    n = len(e)
    more = np.eye(n)[:, after <= opens_rate]
    A = np.block([[X, np.zeros((len(X), more.shape[1]))], [np.diag(1.0 + e), more]])
    return np.asarray(nnls(A, np.concatenate([X @ P_c, P]))[0][:n])


def _after_sequence(
    X: Array, U: Array, e: Array, *, equal_rates_rtol: float = 1e-12, max_sequence: int = 100_000
) -> Array:
    """Return U⁺ after impacts of one contact after another, the fastest first.

    ``equal_rates_rtol``: difference of two approach rates, relative to them, below which they have impacts at once.
    ``max_sequence``: maximum number of impacts.
    """
    z, given = np.zeros(len(X)), U
    for _ in range(max_sequence):
        U = given + X.T @ z
        fastest = float(-U.min())
        if fastest <= np.finfo(float).eps * np.abs(given).max():
            return U
        at = np.flatnonzero((1.0 - equal_rates_rtol) * fastest <= -U)
        z = z + X[:, at] @ _pushed(X[:, at], (1.0 + e[at]) * U[at])
    return np.full(len(U), np.nan)


@lru_cache(maxsize=1024)
def _after_springs(
    G_: Numbers,
    U_: Numbers,
    e_: Numbers,
    k_: Numbers,
    η: float,
    *,
    rtol: float = 1e-13,
    slow: float = 1e-11,
    no_rate: float = 1e-12,
    max_steps: int = 20_000,
) -> Array:
    """Return U⁺ after springs whose expansion takes e² of the way of their compression.

    ``rtol``: tolerance of the integration.
    ``slow``: rate, in units of the largest before, of springs that have come to rest.
    ``no_rate``: rate, in the same units, that is rounding.
    ``max_steps``: maximum number of steps.
    """  # fmt: skip
    from scipy.integrate import RK45, DenseOutput
    from scipy.optimize import brentq

    n = len(U_)
    G = np.reshape(G_, (n, n))
    U, e = np.array(U_), np.array(e_)
    k = np.array(k_)
    swift = 1.0 / np.where(e > 0.0, e, 1.0) ** 2

    def rate(y: Array) -> Array:
        return np.asarray(U + G @ y[n:])

    def slope(_: float, y: Array) -> Array:
        x, V = y[:n], rate(y)
        moves = np.where((x > 0.0) | (V < 0.0), -V * np.where(V > 0.0, swift, 1.0), 0.0)
        return np.concatenate([moves, k * np.maximum(x, 0.0) ** η])

    def solver_from(y: Array) -> RK45:
        return RK45(slope, 0.0, y, np.inf, rtol=rtol, atol=0.1 * rtol)

    solver = solver_from(np.zeros(2 * n))
    for _ in range(max_steps):
        before = rate(solver.y)
        solver.step()
        V = rate(solver.y)
        turns = np.flatnonzero((e < 1.0) & (before < -no_rate) & (no_rate < V))
        if len(turns):
            read = solver.dense_output()

            def rate_of(i: int, s: float, read: DenseOutput = read) -> float:
                return float(rate(read(s))[i])

            roots = [brentq(partial(rate_of, i), solver.t_old, solver.t) for i in turns.tolist()]
            y = read(min(roots))
            released = turns[np.argmin(roots)]
            y[released] *= e[released] > 0.0
            solver = solver_from(y)
        V, energies = rate(solver.y), k * np.maximum(solver.y[:n], 0.0) ** (η + 1.0)
        released = (energies <= slow**2).all()
        if released and (-slow <= V).all():
            return V
    return np.full(n, np.nan)
