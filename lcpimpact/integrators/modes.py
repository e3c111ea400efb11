r"""The contact modes of a linear scheme, and which one comes next.

In first-order form (see `lcpimpact.scheme.lcs`) the scheme is X' = A X + B r, u = C X + D r, 0 <= u ⟂ r >= 0. A *mode* is
the set of closed rows, on which u ≡ 0. With ρ_i the relative degree of row i,

.. math:: u_i^{(ρ_i)} = O_i X + G_i r, \qquad O_i = C_i A^{ρ_i}, \qquad G_i = D_i,\; C_i B,\; C_i A B \quad (ρ_i = 0, 1, 2),

so the closed rows give r = F X, and the mode moves by X' = (A + B F) X. The mode is chosen, at the start and after every
event, by LCPs on the one-sided derivatives: first 0 <= r ⟂ O X + G r >= 0 on the rows that touch, then, for the rows
that it leaves undecided (both sides zero: grazing, and every switch that is not a jump), the same for the next derivatives
of r and u, until each is decided. Where plates that both have mass meet with U < 0, Newton's law of impact is an LCP of its
own: 0 <= P ⟂ U⁺ + e U⁻ >= 0 with U⁺ = U⁻ + C A B P.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.linalg import null_space

from lcpimpact.arrays import Array, Indices
from lcpimpact.errors import UnsupportedError
from lcpimpact.integrators.flow import Flow
from lcpimpact.lcp.solve import solve_lcp
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.lcs import LinearComplementaritySystem, first_order_form

ZERO = 1e-12
"""What counts as zero, relative to the terms of the sum that gave it, each taken at its largest value so far: a root found
to rounding leaves about 1e-15 of them. An approach this slow is none: that ends an accumulation of impacts."""


@dataclass(frozen=True, eq=False)
class Mode:
    """The closed rows, and how each row leaves zero: ``order[i]`` is the order of the zero, -1 if it is zero for ever."""

    closed: tuple[int, ...]
    order: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class System:
    """The first-order form with its Markov parameters, and the flow of each mode."""

    dynamics: Dynamics
    flows: dict[tuple[int, ...], tuple[Flow, Array]] = field(default_factory=dict)

    @cached_property
    def lcs(self) -> LinearComplementaritySystem:
        """The linear complementarity system."""
        return first_order_form(self.dynamics)

    @cached_property
    def degree(self) -> Indices:
        """ρ (nc,)."""
        return self.dynamics.relative_degree

    @cached_property
    def derivatives(self) -> Array:
        """C, C A, C A²: (3, nc, N)."""
        C, A = self.lcs.C, self.lcs.A
        return np.array([C, C @ A, C @ A @ A])

    @cached_property
    def O(self) -> Array:  # noqa: E743
        """The row C_i A^ρ_i of each contact (nc, N)."""
        return np.asarray(self.derivatives[self.degree, np.arange(len(self.degree))])

    @cached_property
    def G(self) -> Array:
        """The row D_i, C_i B or C_i A B of each contact (nc, nc)."""
        B = self.lcs.B
        markov = np.array([self.lcs.D, self.lcs.C @ B, self.lcs.C @ self.lcs.A @ B])
        return np.asarray(markov[self.degree, np.arange(len(self.degree))])

    def mode(self, closed: tuple[int, ...]) -> tuple[Flow, Array]:
        """Return the flow of a mode, and the F with r = F X."""
        if closed not in self.flows:
            F = np.zeros_like(self.O)
            rows = list(closed)
            G = self.G[np.ix_(rows, rows)]
            F[rows] = -np.linalg.solve(G, self.O[rows])
            self.flows[closed] = Flow(self.lcs.A + self.lcs.B @ F), F
        return self.flows[closed]


def _zero(terms: Array, values: Array) -> Array:
    """Set values to zero that are rounding, compared with the sum of the absolute terms that they came from."""
    return np.where(np.abs(values) <= ZERO * terms, 0.0, values)


def gaps(system: System, X: Array, scale: Array) -> tuple[Array, Array]:
    """Return u and U of the rows (nc,), for r = 0, with rounding residues set to zero."""
    C, CA = system.derivatives[:2]
    return _zero(np.abs(C) @ scale, C @ X), _zero(np.abs(CA) @ scale, CA @ X)


def choose_mode(system: System, X: Array, scale: Array, solver: str) -> Mode:
    """Return the mode in which the motion goes on from X, by LCPs on the one-sided derivatives."""
    A, B, G = system.lcs.A, system.lcs.B, system.G
    nc = len(system.degree)
    u, U = gaps(system, X, scale)
    # A force may act on rows of degree 0, and on those that touch and do not open.
    opening = (system.degree > 0) & ((u > 0.0) | ((system.degree == 2) & (U > 0.0)))
    undecided = [int(i) for i in np.flatnonzero(~opening)]
    closed: list[int] = []
    order = [0 if u[i] > 0.0 else 1 for i in range(nc)]
    for level in range(len(X) + 1):
        if not undecided:
            break
        # On closed rows the derivative of u is zero, which gives theirs of r; what remains is an LCP.
        g, terms = system.O @ X, np.abs(system.O) @ scale
        c, m = closed, undecided
        eliminated = np.linalg.solve(G[np.ix_(c, c)], np.column_stack([g[c], G[np.ix_(c, m)]]))
        q = g[m] - G[np.ix_(m, c)] @ eliminated[:, 0]
        summed = terms[m] + np.abs(G[np.ix_(m, c)]) @ np.abs(eliminated[:, 0])
        W = G[np.ix_(m, m)] - G[np.ix_(m, c)] @ eliminated[:, 1:]
        q = _zero(summed, q)
        solution = solve_lcp(W, q, solver)
        r = np.zeros(nc)
        r[m] = solution.z
        r[c] = -eliminated[:, 0] - eliminated[:, 1:] @ solution.z
        w_zero = ZERO * (summed + np.abs(W) @ solution.z)
        undecided = []
        for i, z, w, tiny in zip(m, solution.z, solution.w, w_zero, strict=True):
            if z * abs(G[i, i]) > tiny:
                closed.append(i)
                order[i] = level
            elif w > tiny:
                order[i] = int(system.degree[i]) + level
            else:
                undecided.append(i)
        X, scale = A @ X + B @ r, np.abs(A) @ scale + np.abs(B) @ np.abs(r)
    for i in undecided:
        order[i] = -1
    return Mode(tuple(sorted(int(i) for i in closed)), tuple(order))


def impact(system: System, X: Array, scale: Array, solver: str) -> tuple[Array, Array]:
    """Return X after the impacts at this instant, and the impulses (nc,): 0 <= P ⟂ U⁺ + e U⁻ >= 0."""
    P = np.zeros(len(system.degree))
    u, U = gaps(system, X, scale)
    meeting = np.flatnonzero((system.degree == 2) & (u <= 0.0))
    if not (U[meeting] < 0.0).any():
        return X, P
    q = (U + system.dynamics.restitution * np.minimum(U, 0.0))[meeting]
    P[meeting] = solve_lcp(system.G[np.ix_(meeting, meeting)], q, solver).z
    return X + system.lcs.B @ P, P


def refuse_mixed_degrees(system: System) -> None:
    """Refuse contacts that can be closed together while a combination of their gaps has a higher degree than each."""
    H = system.dynamics.H
    for degree in (0, 1, 2):
        rows = np.flatnonzero(system.degree == degree)
        for combination in null_space(system.G[np.ix_(rows, rows)], rcond=1e-12).T:
            # A combination of gaps that no motion changes is not zero (assembly saw to it): its rows never close together.
            if np.abs(combination @ H[rows]).max() > 1e-9:
                names = [repr(system.dynamics.contacts[i].name) for i in rows[np.abs(combination) > 1e-9]]
                raise UnsupportedError(
                    f"the contacts {', '.join(names)} have no common relative degree when all are closed, and 'exact' "
                    "does not handle that: take method='moreau-jean'"
                )
