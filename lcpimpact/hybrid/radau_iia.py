r"""The Radau IIA methods of s = 1 ... 5 stages, which check their own order conditions, and one step of a linear system.

Their nodes are the zeros of P_s - P_{s-1} on [0, 1], with Legendre polynomials P, so the last is the end of the step.
A step of X' = A X is

.. math:: X_i = X + h \sum_j a_{ij} A X_j, \qquad X^+ = X_s = R(h A) X ,

of order 2 s - 1, stiffly accurate and L-stable. With the eigenvalues μ_i of (a_ij) the stages decouple into s systems with
the matrices 1 - h μ_i A.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.numbers import is_count

MAX_STAGES = 5
"""Maximum number of stages: beyond, the order conditions hold in double precision no better than the errors of the step."""


@dataclass(frozen=True, eq=False)
class RadauIIA:
    """The coefficients of one method.

    Attributes
    ----------
    c : (s,) array      nodes
    a : (s, s) array    weights of the stages; the last row is that of the end of the step
    """

    c: Array
    a: Array

    def __post_init__(self) -> None:
        c = self.c
        a = self.a
        b = self.a[-1]
        s = len(self.c)
        errors = [b @ c ** (k - 1) - 1.0 / k for k in range(1, 2 * s)]
        errors += [np.abs(a @ c ** (k - 1) - c**k / k).max() for k in range(1, s + 1)]
        errors += [np.abs((b * c ** (k - 1)) @ a - b * (1.0 - c**k) / k).max() for k in range(1, s)]
        if not np.abs(errors).max() < 1e-14:
            raise ValueError(f"a and c break the conditions of order {2 * s - 1} by {np.abs(errors).max():.1e}")

    @property
    def order(self) -> int:
        """2 s - 1."""
        return 2 * len(self.c) - 1

    @cached_property
    def inverse(self) -> Array:
        """The inverse of a: its rows give the derivatives of the collocation polynomial at the nodes."""
        return np.asarray(np.linalg.inv(self.a))

    @cached_property
    def eigen(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The eigenvalues μ of a, its eigenvectors T, and T⁻¹ (1, ..., 1)."""
        μ, T = np.linalg.eig(self.a)
        return μ, T, np.linalg.solve(T, np.ones(len(μ), dtype=T.dtype))

    def stages(self, A: Array, h: Array, X: Array) -> Array:
        """Return the stages of steps of the lengths h (nt,) from the states X (nt, N, m): (nt, s, N, m).

        The unknowns are the increments X_i - X, so that a constant state keeps its last digit.
        """
        μ, T, ones = self.eigen
        hμ = (h[:, None] * μ)[:, :, None, None]
        y = np.linalg.solve(np.eye(len(A)) - hμ * A, hμ * ones[:, None, None] * (A @ X)[:, None])
        return np.asarray(X[:, None] + np.einsum("ij,tjnm->tinm", T, y).real)

    def end_and_rate(self, A: Array, h: float, X: Array) -> tuple[Array, Array]:
        """Return the end R(h A) X of a step, and its derivative by h, for one state X (N,)."""
        μ, T, ones = self.eigen
        shifted = np.eye(len(A)) - (h * μ)[:, None, None] * A
        source = ones[:, None] * (A @ X)
        y = np.linalg.solve(shifted, ((h * μ)[:, None] * source)[:, :, None])
        # (1 - h μ A) y = h μ A X, by h.
        rate = np.linalg.solve(shifted, μ[:, None, None] * (source[:, :, None] + A @ y))
        return X + (T[-1] @ y[:, :, 0]).real, (T[-1] @ rate[:, :, 0]).real


@cache
def radau_iia(s: int) -> RadauIIA:
    """Return the method of s stages.

    Parameters
    ----------
    s : int
        1 to 5.

    Raises
    ------
    InputError
        For another number.

    Examples
    --------
    >>> radau_iia(2).a
    array([[ 0.41666667, -0.08333333],
           [ 0.75      ,  0.25      ]])

    References
    ----------
    Hairer and Wanner, *Solving Ordinary Differential Equations II* (1996), section IV.5.
    """
    if not is_count(s) or s > MAX_STAGES:
        raise InputError(f"stages = {s!r} must be a whole number from 1 to {MAX_STAGES}")
    legendre = np.polynomial.Legendre.basis(int(s)) - np.polynomial.Legendre.basis(int(s) - 1)
    x = np.sort(legendre.roots().real)
    x -= legendre(x) / legendre.deriv()(x)
    c = 0.5 * (1.0 + x)
    c[-1] = 1.0
    powers = np.arange(int(s))
    # Collocation: Σ_j a_ij c_j^k = c_i^(k+1)/(k+1).
    a = np.linalg.solve((c[:, None] ** powers).T, (c[:, None] ** (powers + 1) / (powers + 1)).T).T
    return RadauIIA(c, np.ascontiguousarray(a))
