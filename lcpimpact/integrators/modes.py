r"""The contact modes of a linear system, and which one comes next.

In first-order form (see `lcpimpact.scheme.first_order`) the system is X' = A X + B r, u = C X + D r, 0 <= u ⟂ r >= 0. A
*mode* is the set of closed rows, on which u ≡ 0. With ρ_i the relative degree of row i,

.. math:: u_i^{(ρ_i)} = O_i X + G_i r, \qquad O_i = C_i A^{ρ_i}, \qquad G_i = D_i,\; C_i B,\; C_i A B \quad (ρ_i = 0, 1, 2),

so the closed rows give r = F X, and the mode moves by X' = (A + B F) X. The mode is chosen, at the start and after every
event, by LCPs on the one-sided derivatives: first 0 <= r ⟂ O X + G r >= 0 on the rows that touch, then, for the rows
that it leaves undecided (both sides zero: grazing, and every switch that is not a jump), the same for the next derivatives
of r and u, until each is decided. Where plates that both have mass meet with U < 0, Newton's law of impact is an LCP of its
own: 0 <= P ⟂ U⁺ + e U⁻ >= 0 with U⁺ = U⁻ + C A B P.

A slider is a row too: it sticks, with u constant and -r_0 < r < r_0, or slips with r = -r_0 sign U. The LCPs are the same,
within bounds: -r_0 <= r <= r_0 at first, and for the derivatives r' >= 0 where r = -r_0, r' <= 0 where r = r_0. Where a
spring alone gives way to it (ρ = 0), the place p where it sticks is a state of its own, and u counts from there.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.linalg import null_space

from lcpimpact.arrays import Array, Indices
from lcpimpact.errors import UnsupportedError
from lcpimpact.integrators.flow import Flow
from lcpimpact.lcp.solve import PreparedLCP, prepare_lcp, solve_lcp
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.first_order import FirstOrderForm, first_order_form

ZERO = 1e-12
"""What counts as zero, relative to the terms of the sum that gave it, each taken at its largest value so far: a root found
to rounding leaves about 1e-15 of them. An approach this slow is none: that ends an accumulation of impacts."""


@dataclass(frozen=True, eq=False)
class Mode:
    """What each row does, and how it begins.

    Attributes
    ----------
    closed : tuple of int       the rows with u ≡ 0: closed contacts and sticking sliders
    slips : tuple of (int, int) the sliders that slip, with the sign of U
    order : tuple of int        order of the zero with which what ends the mode leaves it, -1 if it is zero for ever
    side : tuple of int         sign of r of a slider that begins to stick with its force at a threshold, else 0
    """

    closed: tuple[int, ...]
    slips: tuple[tuple[int, int], ...]
    order: tuple[int, ...]
    side: tuple[int, ...]

    @property
    def key(self) -> tuple[tuple[int, ...], tuple[tuple[int, int], ...]]:
        """What its flow depends on."""
        return self.closed, self.slips


@dataclass(frozen=True, eq=False)
class System:
    """The first-order form with its Markov parameters, and the flow of each mode.

    Attributes
    ----------
    dynamics : Dynamics
    given : FirstOrderForm, optional
        The form, where it is not that of ``dynamics`` alone: linear about one instant, or with inputs beside r.
    inputs : pair of (N, nw) and (nc, nw) arrays, optional
        E and D_w with X' = A X + B r + E w, u = C X + D r + D_w w.
    """

    dynamics: Dynamics
    given: FirstOrderForm | None = None
    inputs: tuple[Array, Array] | None = None
    flows: dict[object, tuple[Flow, Array]] = field(default_factory=dict)
    lcps: dict[object, PreparedLCP] = field(default_factory=dict)

    @cached_property
    def form(self) -> FirstOrderForm:
        """The first-order form."""
        return self.given or first_order_form(self.dynamics)

    @cached_property
    def input_matrices(self) -> tuple[Array, Array]:
        """E (N, nw), with rows for the states p, and D_w (nc, nw)."""
        E, Dw = self.inputs or (np.zeros((len(self.form.A), 0)), np.zeros((len(self.degree), 0)))
        return np.pad(E, ((0, len(self.remembered)), (0, 0))), Dw

    @cached_property
    def degree(self) -> Indices:
        """ρ (nc,)."""
        return self.dynamics.relative_degree

    @cached_property
    def remembered(self) -> Indices:
        """The sliders of degree 0, whose places p are states, the last of X."""
        return np.flatnonzero(self.dynamics.slides & (self.degree == 0))

    @cached_property
    def matrices(self) -> tuple[Array, Array, Array]:
        """A, B and C with the states p, p' = 0, and u - p in the rows of the sliders that they belong to."""
        memory = len(self.remembered)
        A = np.pad(self.form.A, ((0, memory), (0, memory)))
        B = np.pad(self.form.B, ((0, memory), (0, 0)))
        C = np.pad(self.form.C, ((0, 0), (0, memory)))
        C[self.remembered, len(self.form.A) + np.arange(memory)] = -1.0
        return A, B, C

    @cached_property
    def read(self) -> tuple[Array, Array]:
        """Q and Qr with q = Q X + Qr r."""
        return np.pad(self.form.Q, ((0, 0), (0, len(self.remembered)))), self.form.Qr

    def state(self, q: Array, v: Array) -> Array:
        """Return X at t = 0; a slider of degree 0 begins where the coordinates have it."""
        return np.concatenate([self.form.state(q, v), self.dynamics.gap(q)[self.remembered]])

    def put(self, X: Array, i: int, u: float) -> None:
        """Move the place of slider i, which has degree 0, by u."""
        X[len(self.form.A) :][self.remembered == i] += u

    @cached_property
    def derivatives(self) -> Array:
        """C, C A, C A²: (3, nc, N)."""
        A, _, C = self.matrices
        return np.array([C, C @ A, C @ A @ A])

    @cached_property
    def O(self) -> Array:  # noqa: E743
        """The row C_i A^ρ_i of each contact (nc, N)."""
        return np.asarray(self.derivatives[self.degree, np.arange(len(self.degree))])

    @cached_property
    def G(self) -> Array:
        """The row D_i, C_i B or C_i A B of each contact (nc, nc)."""
        A, B, C = self.matrices
        markov = np.array([self.form.D, C @ B, C @ A @ B])
        return np.asarray(markov[self.degree, np.arange(len(self.degree))])

    def mode(self, mode: Mode) -> tuple[Flow, Array]:
        """Return the flow of a mode, and the F with r = F X."""
        if mode.key not in self.flows:
            A, B, _ = self.matrices
            F = np.zeros_like(self.O)
            for i, sign in mode.slips:
                F[i, self.form.constant] = -sign * self.dynamics.r_max[i]
            rows = list(mode.closed)
            F[rows] = -_solve(self.G[np.ix_(rows, rows)], self.O[rows] + self.G[rows] @ F)
            self.flows[mode.key] = Flow(A + B @ F), F
        return self.flows[mode.key]

    def impact_lcp(self, rows: tuple[int, ...], solver: str) -> PreparedLCP:
        """Return the LCP of the impulses of some rows, made ready."""
        if (rows, solver) not in self.lcps:
            self.lcps[rows, solver] = prepare_lcp(self.G[np.ix_(rows, rows)], solver)
        return self.lcps[rows, solver]

    @cached_property
    def O_w(self) -> Array:
        """The rows D_w, C_i E or C_i A E of each contact (nc, nw)."""
        A, _, C = self.matrices
        E, Dw = self.input_matrices
        return np.asarray(np.array([Dw, C @ E, C @ A @ E])[self.degree, np.arange(len(self.degree))])

    def share(self, mode: Mode) -> Array:
        """Return F_w (nc, nw), by which the reactions of a mode, r = F X + F_w w, answer to the inputs."""
        rows, found = list(mode.closed), np.zeros_like(self.O_w)
        if found.size:
            found[rows] = -_solve(self.G[np.ix_(rows, rows)], self.O_w[rows])
        return found

    def watched(self, mode: Mode) -> list[tuple[int, Array, int]]:
        """Return what ends a mode where it turns negative.

        For each the row of H, the row c of c·(X, w), and the order of its zero; without inputs it is c·X.
        """
        flow, F = self.mode(mode)
        E, Dw = self.input_matrices
        Fw, B = self.share(mode), self.matrices[1]
        u = self.derivatives[0] + self.form.D @ F
        # A slider that slips has degree 1 or 2, or no input acts on it: then u' holds no rate of an input.
        U = np.column_stack([u @ flow.A, u @ (E + B @ Fw)])
        u = np.column_stack([u, Dw + self.form.D @ Fw])
        F = np.column_stack([F, Fw])
        found = []
        slips = dict(mode.slips)
        for i, contact in enumerate(self.dynamics.contacts):
            if mode.order[i] < 0:
                continue
            if contact.r0 is None:
                found.append((i, F[i] if i in mode.closed else u[i], mode.order[i]))
            elif i in slips:
                found.append((i, slips[i] * U[i], mode.order[i]))
            else:
                for sign in (1, -1):
                    row = -sign * F[i]
                    row[self.form.constant] += contact.r0
                    found.append((i, row, mode.order[i] if sign == mode.side[i] else 0))
        return found


def _solve(G: Array, right: Array) -> Array:
    """Solve with a block of G; where it is singular, the closed rows share their force as they like."""
    if len(G) > 1 and not np.linalg.cond(G) < 1e13:
        raise np.linalg.LinAlgError
    return np.asarray(np.linalg.solve(G, right))


def _zero(terms: Array, values: Array) -> Array:
    """Set values to zero that are rounding, compared with the sum of the absolute terms that they came from."""
    return np.where(np.abs(values) <= ZERO * terms, 0.0, values)


def gaps(system: System, X: Array, scale: Array) -> tuple[Array, Array]:
    """Return u and U of the rows (nc,), for r = 0, with rounding residues set to zero."""
    C, CA = system.derivatives[:2]
    return _zero(np.abs(C) @ scale, C @ X), _zero(np.abs(CA) @ scale, CA @ X)


def choose_mode(system: System, X: Array, scale: Array, solver: str) -> tuple[Mode, Array]:
    """Return the mode in which the motion goes on from X, by LCPs on the one-sided derivatives, and X.

    X differs only in the places of sliders of degree 0, which have slipped, or begin with a force beyond their threshold.
    """
    A, B, _ = system.matrices
    G, degree, r_max = system.G, system.degree, system.dynamics.r_max
    slides, nc = system.dynamics.slides, len(system.degree)
    u, U = gaps(system, X, scale)
    # A force is sought on rows of degree 0, on those that touch and do not open, and on sliders that do not move.
    moving = slides & (degree == 2) & (U != 0.0)
    opening = ~slides & (degree > 0) & ((u > 0.0) | ((degree == 2) & (U > 0.0)))
    undecided = [int(i) for i in np.flatnonzero(~opening & ~moving)]
    closed: list[int] = []
    slips = [(int(i), int(np.sign(U[i]))) for i in np.flatnonzero(moving)]
    order = [0 if u[i] > 0.0 or moving[i] else 1 for i in range(nc)]
    side = [0] * nc
    start, level = X.copy(), 0
    r = np.where(moving, -np.sign(U) * np.where(slides, r_max, 0.0), 0.0)
    for level in range(len(X) + 1):
        if not undecided:
            break
        # On closed rows the derivative of u is zero, which gives theirs of r; what remains is an LCP.
        g, terms = system.O @ X + G @ r, np.abs(system.O) @ scale + np.abs(G) @ np.abs(r)
        c, m = closed, undecided
        eliminated = _solve(G[np.ix_(c, c)], np.column_stack([g[c], G[np.ix_(c, m)]]))
        q = g[m] - G[np.ix_(m, c)] @ eliminated[:, 0]
        summed = terms[m] + np.abs(G[np.ix_(m, c)]) @ np.abs(eliminated[:, 0])
        W = G[np.ix_(m, m)] - G[np.ix_(m, c)] @ eliminated[:, 1:]
        q = _zero(summed, q)
        lower, upper = _bounds(system, m, side, level)
        solution = solve_lcp(W, q, solver, lower=lower, upper=upper)
        r[m] = solution.z
        r[c] = -eliminated[:, 0] - eliminated[:, 1:] @ solution.z
        w_zero = ZERO * (summed + np.abs(W) @ np.abs(solution.z))
        undecided = []
        for i, z, w, tiny in zip(m, solution.z, solution.w, w_zero, strict=True):
            unit = abs(G[i, i]) or np.abs(G[:, i]).max()
            room = min(z + r_max[i], r_max[i] - z) if slides[i] and level == 0 else abs(z)
            if room * unit > tiny:
                closed.append(i)
                order[i] = level
                continue
            if slides[i] and level == 0:
                side[i] = 1 if z > 0.0 else -1
                if degree[i] == 0:
                    system.put(start, i, w)
                    system.put(X, i, w)
                    w = 0.0
            if abs(w) > tiny:
                order[i] = int(degree[i]) + level - int(slides[i])
                if slides[i]:
                    slips.append((i, -side[i]))
            else:
                undecided.append(i)
        X, scale = A @ X + B @ r, np.abs(A) @ scale + np.abs(B) @ np.abs(r)
        r = np.zeros(nc)
    for i in undecided:
        order[i] = -1
        if slides[i]:
            slips.append((i, -side[i]))
    return Mode(tuple(sorted(closed)), tuple(sorted(slips)), tuple(order), tuple(side)), start


def _bounds(system: System, rows: list[int], side: list[int], level: int) -> tuple[Array, Array]:
    """Return the bounds of r, and for a higher level those of its derivative, for rows that are undecided."""
    slides = system.dynamics.slides[rows]
    if level == 0:
        return system.dynamics.r_min[rows], system.dynamics.r_max[rows]
    at = np.array([side[i] for i in rows])
    return np.where(slides & (at > 0), -np.inf, 0.0), np.where(slides & (at > 0), 0.0, np.inf)


def impact(
    system: System, X: Array, scale: Array, solver: str, restitution: Array | None = None
) -> tuple[Array, Array]:
    """Return X after the impacts at this instant, and the impulses (nc,): 0 <= P ⟂ U⁺ + e U⁻ >= 0.

    The coefficients e are those of the rows, or ``restitution`` (nc,).
    """
    e = system.dynamics.restitution if restitution is None else restitution
    P = np.zeros(len(system.degree))
    u, U = gaps(system, X, scale)
    meeting = np.flatnonzero((system.degree == 2) & (u <= 0.0) & ~system.dynamics.slides)
    if not (U[meeting] < 0.0).any():
        return X, P
    q = (U + e * np.minimum(U, 0.0))[meeting]
    P[meeting] = system.impact_lcp(tuple(meeting.tolist()), solver).solve(q).z
    return X + system.matrices[1] @ P, P


def refuse_mixed_degrees(system: System, method: str = "exact") -> None:
    """Refuse contacts that can be closed together while a combination of their gaps has a higher degree than each."""
    H = system.dynamics.H
    for degree in (0, 1, 2):
        rows = np.flatnonzero(system.degree == degree)
        for combination in null_space(system.G[np.ix_(rows, rows)], rcond=1e-12).T:
            # A combination of gaps that no motion changes is not zero (assembly saw to it): its rows never close together.
            if np.abs(combination @ H[rows]).max() > 1e-9:
                names = [repr(system.dynamics.contacts[i].name) for i in rows[np.abs(combination) > 1e-9]]
                raise UnsupportedError(
                    f"the contacts {', '.join(names)} have no common relative degree when all are closed, and {method!r} "
                    "does not handle that: take method='moreau-jean'"
                )
