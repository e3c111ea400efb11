r"""The contact modes of a linear system, and the choice of the next one by LCPs.

In first-order form (see `lcpimpact.scheme.first_order`) the system is X' = A X + B r, u = C X + D r, 0 <= u ⟂ r >= 0. A
*mode* is the set of closed rows, on which u ≡ 0. With ρ_i the relative degree of row i,

.. math:: u_i^{(ρ_i)} = O_i X + G_i r, \qquad O_i = C_i A^{ρ_i}, \qquad G_i = D_i,\; C_i B,\; C_i A B \quad (ρ_i = 0, 1, 2),

so the closed rows give r = F X, and the mode moves by X' = (A + B F) X. The mode is chosen, at the start and after every
event, by LCPs on the one-sided derivatives: first 0 <= r ⟂ O X + G r >= 0 on the rows that touch, then, for the rows
that it leaves undecided (both sides zero: grazing, and every switch without a jump), the same for the next derivatives
of r and u, until each is decided. At contacts of relative degree 2 that close with U < 0, Newton's law of impact is another
LCP: 0 <= P ⟂ U⁺ + e U⁻ >= 0 with U⁺ = U⁻ + C A B P.

*Joint relative degree.* Closed rows with a common massless node have combinations T u in which it
cancels, and whose relative degree is higher than theirs: bodies that ride on one plate, or a body on a plate that is stopped
(see `lcpimpact.scheme.decomposition.degrees_together`). A mode then imposes each combination at its own level,

.. math:: (T u)_k^{(ρ_k)} = (T C)_k A^{ρ_k} X + (T G)_k r = 0 ,

and since these rows are not known beforehand, the mode is the set of closed rows for which the first nonzero derivatives of
r and u are positive, found by Murty's least-index exchanges. Impulses act on
impulse paths, by the law of `lcpimpact.hybrid.impact_law`.

A slider is a row too: it sticks, with u constant and -r_0 < r < r_0, or slips with r = -r_0 sign U. The LCPs are the same,
within bounds: -r_0 <= r <= r_0 at first, and for the derivatives r' >= 0 where r = -r_0, r' <= 0 where r = r_0. On a
spring only (ρ = 0), the position p at which it sticks is an additional state, and u counts from there.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numba import types
from numpy.typing import ArrayLike
from scipy.linalg import null_space

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.compiled import compiled, cube, f8, flags, indices, matrix, vector
from lcpimpact.double_double import DoubleDouble, add, multiply, solve, stacked
from lcpimpact.errors import UnsupportedError
from lcpimpact.hybrid.complementarity import FLOAT_ZERO, approach, at_rest, complementary, rebound
from lcpimpact.hybrid.flow import Flow, Sparse, sparse
from lcpimpact.hybrid.impact_law import restitution as path_restitution
from lcpimpact.lcp.solve import PreparedLCP, prepare_lcp, solve_lcp
from lcpimpact.scheme.decomposition import degrees_together
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.first_order import FirstOrderForm, first_order_form
from lcpimpact.scheme.signals import PiecewisePolynomial

ZERO = 1e-12
"""Tolerance for zero in a state of floats, relative to the terms of the sum at their largest so far: a root located
to rounding leaves about 1e-15 of them."""

REFINEMENTS = 2
"""Number of corrections in floats, which give the digits of double-doubles."""

NO_PATHS = np.zeros((0, 0))

ZERO_FACTORS = (1.0, 16.0, 256.0)
"""Factors on the tolerance for zero that are tried in turn until a mode fits."""

FINE_ZERO = 2.0**-95
"""Tolerance for zero in a state of double-doubles, likewise: a root leaves about 1e-31."""


@dataclass(frozen=True)
class Mode:
    """The contact mode: the state of each row, and how it begins.

    Attributes
    ----------
    closed : tuple of int       the rows with u ≡ 0: closed contacts and sticking sliders
    slips : tuple of (int, int) the sliders that slip, with the sign of U
    order : tuple of int        initial order of the zero of its event function, -1 if it is zero for ever
    side : tuple of int         sign of r of a slider that begins to stick with its force at a threshold, else 0
    """

    closed: tuple[int, ...]
    slips: tuple[tuple[int, int], ...]
    order: tuple[int, ...]
    side: tuple[int, ...]

    @property
    def key(self) -> tuple[tuple[int, ...], tuple[tuple[int, int], ...]]:
        """The part that determines the flow."""
        return self.closed, self.slips


@dataclass(frozen=True, eq=False)
class Still:
    """The openings u and rates U that are zero by the last mode or an impact.

    A closed contact stays closed, whatever the rounding of its gap, until its own force ends that.

    Attributes
    ----------
    u, U : (nc,) arrays of bool
    closed : (nc,) array of bool    rows of any degree that are closed, so that sums of their gaps alone are zero too
    """

    u: Flags
    U: Flags
    closed: Flags

    @cached_property
    def none(self) -> bool:
        """Whether there are none."""
        return not (self.u.any() or self.U.any())


class Watch(NamedTuple):
    """The event functions of a mode, and its zeros.

    Attributes
    ----------
    contacts : (k,) array       the row of H of each
    rows : DoubleDouble         rows c (k, N + nw); the mode ends when c·(X, w) turns negative
    entries : Sparse            the same
    order : (k,) array          the order of the zero with which it begins
    held : Still                zeros as long as the mode lasts
    """

    contacts: Indices
    rows: DoubleDouble
    entries: Sparse
    order: Indices
    held: Still


class Coordinates(NamedTuple):
    """Rows that give q, v and r in terms of the state in a mode.

    Attributes
    ----------
    rows : DoubleDouble     (2 n + nc, N)
    entries : Sparse        the same
    """

    rows: DoubleDouble
    entries: Sparse


class Together(NamedTuple):
    """Constraints of jointly closed rows: T u = 0, each combination at its own relative degree.

    Attributes
    ----------
    T : (k, k) array            the combinations, the lowest degree first
    degree : (k,) array         the relative degree of each
    C, CA, O : DoubleDouble     T C, T C A, and row by row T C A^ρ (k, N)
    G : DoubleDouble            row by row T D, T C B or T C A B (k, nc)
    """

    T: Array
    degree: Indices
    C: DoubleDouble
    CA: DoubleDouble
    O: DoubleDouble  # noqa: E741
    G: DoubleDouble


class Fine(NamedTuple):
    """The matrices of a system as double-doubles: A (N, N), B (N, nc), C and C A (nc, N), D (nc, nc), O, G."""

    A: DoubleDouble
    B: DoubleDouble
    C: DoubleDouble
    D: DoubleDouble
    CA: DoubleDouble
    O: DoubleDouble  # noqa: E741
    G: DoubleDouble


@dataclass(frozen=True, eq=False)
class System:
    """The first-order form with its Markov parameters, and the flow of each mode.

    Attributes
    ----------
    dynamics : Dynamics
    given : FirstOrderForm, optional
        The form, if not that of ``dynamics``: linearised about an instant, or with inputs beside r.
    inputs : pair of (N, nw) and (nc, nw) arrays, optional
        E and D_w with X' = A X + B r + E w, u = C X + D r + D_w w.
    """

    dynamics: Dynamics
    given: FirstOrderForm | None = None
    inputs: tuple[Array, Array] | None = None
    flows: dict[object, tuple[Flow, DoubleDouble]] = field(default_factory=dict)
    switches: dict[object, tuple[Indices, Indices, DoubleDouble]] = field(default_factory=dict)
    readings: dict[object, Coordinates] = field(default_factory=dict)
    known: dict[Mode, Watch] = field(default_factory=dict)
    lcps: dict[object, PreparedLCP] = field(default_factory=dict)
    combinations: dict[tuple[int, ...], Together] = field(default_factory=dict)

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
        """The sliders of degree 0, whose positions p are the last states of X."""
        return np.flatnonzero(self.slides & (self.degree == 0))

    @cached_property
    def fine(self) -> Fine:
        """The matrices as double-doubles, with the states p, p' = 0, and u - p in the rows of the sliders they belong to."""
        A, B, C, D, _, _ = self.form.double_doubles
        N, memory, nc = len(A), len(self.remembered), len(self.degree)
        places = np.zeros((nc, memory))
        places[self.remembered, np.arange(memory)] = -1.0
        A = stacked([[A, np.zeros((N, memory))], [np.zeros((memory, N + memory))]])
        B, C = stacked([[B], [np.zeros((memory, nc))]]), stacked([[C, places]])
        CA = C @ A
        # Row i of O and of G is that of the degree of contact i.
        O, G = (  # noqa: E741
            DoubleDouble(np.ascontiguousarray(np.stack([m.parts for m in each], 1)[:, self.degree, np.arange(nc)]))
            for each in ((C, CA, CA @ A), (D, C @ B, CA @ B))
        )
        return Fine(*(DoubleDouble(np.ascontiguousarray(each.parts)) for each in (A, B, C, D, CA, O, G)))

    @cached_property
    def matrices(self) -> tuple[Array, Array, Array]:
        """A, B and C in floats."""
        return self.fine.A.hi, self.fine.B.hi, self.fine.C.hi

    @cached_property
    def read(self) -> tuple[Array, Array]:
        """Q and Qr with q = Q X + Qr r."""
        return np.pad(self.form.Q, ((0, 0), (0, len(self.remembered)))), self.form.Qr

    def state(self, q: Array, v: Array) -> Array:
        """Return X at t = 0; a slider of degree 0 begins at the initial coordinates."""
        return np.concatenate([self.form.state(q, v), self.dynamics.gap(q)[self.remembered]])

    def put(self, X: DoubleDouble, i: int, u: DoubleDouble) -> DoubleDouble:
        """Return X with the position of slider i, of degree 0, moved by u."""
        move = np.zeros(len(X))
        move[len(self.form.A) :] = self.remembered == i
        return X + move * u

    @cached_property
    def derivatives(self) -> Array:
        """C, C A, C A²: (3, nc, N)."""
        A, _, C = self.matrices
        return np.array([C, C @ A, C @ A @ A])

    @property
    def O(self) -> Array:  # noqa: E743
        """The row C_i A^ρ_i of each contact (nc, N)."""
        return self.fine.O.hi

    @property
    def G(self) -> Array:
        """The row D_i, C_i B or C_i A B of each contact (nc, nc)."""
        return self.fine.G.hi

    def reaction(self, mode: Mode) -> tuple[Flow, DoubleDouble]:
        """Return the flow of a mode, and the F with r = F X."""
        if mode.key not in self.flows:
            A, B, *_ = self.fine
            F = np.zeros((2, len(self.degree), len(A)))
            for i, sign in mode.slips:
                F[0, i, self.form.constant] = -sign * self.dynamics.r_max[i]
            rows = list(mode.closed)
            if rows:
                O, G = self._held(mode)  # noqa: E741
                terms = np.abs(O.hi) + np.abs(G.hi) @ np.abs(F[0])
                F[:, rows] = -_solve(G[:, rows], O + G @ DoubleDouble(F)).parts
                if self.mixed:
                    cancels = np.abs(F[0, rows]) <= FINE_ZERO * (np.abs(np.linalg.inv(G.hi[:, rows])) @ terms)
                    F[:, rows] = np.where(cancels, 0.0, F[:, rows])
            # Cancellation in A + B F is set to zero: balanced forces cause no motion.
            closed = A + B @ DoubleDouble(F)
            closed.parts[:, np.abs(closed.hi) <= FINE_ZERO * (np.abs(A.hi) + np.abs(B.hi) @ np.abs(F[0]))] = 0.0
            self.flows[mode.key] = Flow(closed), DoubleDouble(F)
        return self.flows[mode.key]

    def _held(self, mode: Mode) -> tuple[DoubleDouble, DoubleDouble]:
        """Return O (k, N) and G (k, nc) of the constraints of a mode, O X + G r = 0."""
        if self.mixed:
            held = self.together(mode.closed)
            return held.O, held.G
        rows = list(mode.closed)
        return self.fine.O[rows], self.fine.G[rows]

    @cached_property
    def mixed_degrees(self) -> list[str]:
        """Contacts that can be closed together while a combination of their gaps has a higher degree than each."""
        H = self.dynamics.H
        for degree in np.unique(self.degree):
            rows = np.flatnonzero(self.degree == degree)
            for combination in null_space(self.G[np.ix_(rows, rows)], rcond=1e-12).T:
                # A combination of gaps that no motion changes is not zero (assembly saw to it): its rows never close
                # together.
                if np.abs(combination @ H[rows]).max() > 1e-9:
                    return [self.dynamics.contacts[i].name for i in rows[np.abs(combination) > 1e-9]]
        return []

    @property
    def mixed(self) -> bool:
        """Whether contacts can be closed together with combinations of a higher degree than their own."""
        return bool(self.mixed_degrees)

    def together(self, rows: tuple[int, ...]) -> Together:
        """Return the constraints of jointly closed contacts."""
        if rows not in self.combinations:
            A, B, C, D, *_ = self.fine
            at = list(rows)
            T, degree = degrees_together(self.dynamics.H[at], self.form.parts)
            TC, TD = _combined(T, C[at]), _combined(T, D[at])
            TCA = _product(TC, A)
            levels = (TC, TCA, _product(TCA, A)), (TD, _product(TC, B), _product(TCA, B))
            k = np.arange(len(at))
            O, G = (  # noqa: E741
                DoubleDouble(np.ascontiguousarray(np.stack([m.parts for m in each], 1)[:, degree, k]))
                for each in levels
            )
            self.combinations[rows] = Together(T, degree, TC, TCA, O, G)
        return self.combinations[rows]

    @cached_property
    def lines(self) -> Array:
        """The impulse paths that lead over massless nodes (np, nc)."""
        return self.dynamics.impulse_lines if self.mixed else np.zeros((0, len(self.degree)))

    def openings(self, F: DoubleDouble) -> DoubleDouble:
        """Return C + D F (nc, N), of u = C X + D r in a mode, with cancellation set to zero."""
        _, _, C, D, *_ = self.fine
        found = C + D @ F
        found.parts[:, np.abs(found.hi) <= FINE_ZERO * (np.abs(C.hi) + np.abs(D.hi) @ np.abs(F.hi))] = 0.0
        return found

    def rates(self, mode: Mode) -> DoubleDouble:
        """Return the rows (nc, N) of the opening rates U in a mode, those of massless nodes included."""
        flow, F = self.reaction(mode)
        U = _product(self.openings(F), flow.generator)
        U.parts[:, list(mode.closed)] = 0.0
        return U

    def mode(self, mode: Mode) -> tuple[Flow, Array]:
        """Return the flow of a mode, and the F with r = F X in floats."""
        flow, F = self.reaction(mode)
        return flow, F.hi

    def coordinates(self, mode: Mode) -> Coordinates:
        """Return the rows of q, v and r in terms of the state in a mode."""
        if mode.key not in self.readings:
            (flow, F), (_, _, _, _, Q, Qr) = self.reaction(mode), self.form.double_doubles
            # The forces of springs at a stopped plate cancel.
            place = stacked([[Q, np.zeros((len(Q), len(self.remembered)))]]) + Qr @ F
            terms = np.abs(self.read[0]) + np.abs(Qr.hi) @ np.abs(F.hi)
            place.parts[:, np.abs(place.hi) <= FINE_ZERO * terms] = 0.0
            rows = stacked([[place], [place @ flow.generator], [F]])
            self.readings[mode.key] = Coordinates(rows, sparse(rows))
        return self.readings[mode.key]

    @cached_property
    def pushes(self) -> Array:
        """|B| (N, nc): the change of X by impulses."""
        return np.abs(self.fine.B.hi)

    @cached_property
    def reach(self) -> Array:
        """Effect of each component of X on the others within a window, without contact forces (N, N).

        The residual of balanced forces is rounding relative to this.
        """
        return np.abs(self.fine.A.hi) * self.mode(Mode((), (), (), ()))[0].window

    @cached_property
    def names(self) -> dict[str, int]:
        """The row of each contact by its name."""
        return {contact.name: i for i, contact in enumerate(self.dynamics.contacts)}

    @cached_property
    def restitution(self) -> Array:
        """Coefficient of restitution of each row (nc,)."""
        return self.dynamics.restitution

    @cached_property
    def slides(self) -> Flags:
        """Which rows are sliders (nc,)."""
        return self.dynamics.slides

    @cached_property
    def meets(self) -> Flags:
        """Which rows are contacts at which impulses act (nc,)."""
        return np.asarray((self.degree == 2) & ~self.slides)

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """r_min and r_max (nc,)."""
        return self.dynamics.r_min, self.dynamics.r_max

    def impact_lcp(self, G: DoubleDouble, lines: Array, meeting: Indices, solver: str) -> PreparedLCP:
        """Return the prepared LCP of the impulses at the rows ``meeting`` and ``lines`` of G."""
        key = meeting.tobytes(), lines.tobytes() if len(lines) else b"", solver
        if key not in self.lcps:
            self.lcps[key] = prepare_lcp(G.hi[np.ix_(meeting, meeting)], solver)
        return self.lcps[key]

    def path_matrices(self, lines: Array) -> tuple[DoubleDouble, DoubleDouble]:
        """Return R C A B Rᵀ and B Rᵀ, where the rows R are those of the contacts, and after them the impulse paths."""
        R = np.vstack([np.eye(len(self.degree)), lines])
        A, B, C, *_ = self.fine
        G = _product(_product(_product(_combined(R, C), A), B), DoubleDouble.of(R.T))
        return G, _product(B, DoubleDouble.of(R.T))

    @cached_property
    def O_w(self) -> Array:
        """The rows D_w, C_i E or C_i A E of each contact (nc, nw)."""
        A, _, C = self.matrices
        E, Dw = self.input_matrices
        return np.asarray(np.array([Dw, C @ E, C @ A @ E])[self.degree, np.arange(len(self.degree))])

    def input_response(self, mode: Mode) -> Array:
        """Return F_w (nc, nw) of the reactions r = F X + F_w w of a mode."""
        rows, found = list(mode.closed), np.zeros_like(self.O_w)
        if found.size:
            E, Dw = self.input_matrices
            G, O_w = block(self.fine.G, rows, rows), self.O_w[rows]
            if self.mixed:
                held = self.together(mode.closed)
                levels = np.array([held.T @ Dw[rows], held.C.hi @ E, held.CA.hi @ E])
                G, O_w = held.G[:, rows], levels[held.degree, np.arange(len(rows))]
            found[rows] = -_solve(G, DoubleDouble.of(O_w)).hi
        return found

    def ends(self, mode: Mode) -> tuple[Indices, Indices, DoubleDouble]:
        """Return the event functions of a mode: for each the row of H, its side, and the row c of c·(X, w).

        The side is that of the threshold of a slider that sticks, and 0 for all others; without inputs it is c·X.
        """
        if mode.key not in self.switches:
            (flow, F), Fw = self.reaction(mode), self.input_response(mode)
            E, Dw = self.input_matrices
            D, B = self.fine.D, self.matrices[1]
            gap = self.openings(F)
            # A slider that slips has degree 1 or 2, or no input acts on it: then u' holds no rate of an input.
            U = stacked([[gap @ flow.generator, gap @ (E + B @ Fw)]]).parts
            u, r = stacked([[gap, Dw + D @ Fw]]).parts, stacked([[F, Fw]]).parts
            slips, found = dict(mode.slips), []
            for i, contact in enumerate(self.dynamics.contacts):
                if contact.r0 is None:
                    found.append((i, 0, r[:, i] if i in mode.closed else u[:, i]))
                elif i in slips:
                    found.append((i, 0, slips[i] * U[:, i]))
                else:
                    for side in (1, -1):
                        room = DoubleDouble(-side * r[:, i])
                        threshold = np.zeros(len(room))
                        threshold[self.form.constant] = contact.r0
                        found.append((i, side, (room + threshold).parts))
            rows = np.array([row for _, _, row in found]).reshape(len(found), 2, u.shape[2])
            self.switches[mode.key] = (
                np.array([i for i, _, _ in found], dtype=np.int64),
                np.array([side for _, side, _ in found], dtype=np.int64),
                DoubleDouble(np.ascontiguousarray(rows.transpose(1, 0, 2))),
            )
        return self.switches[mode.key]

    def watch(self, mode: Mode) -> Watch:
        """Return the event functions of a mode, and its zeros."""
        if mode not in self.known:
            contacts, side, rows = self.ends(mode)
            order = np.array(mode.order, dtype=np.int64)[contacts]
            kept = np.flatnonzero(order >= 0)
            order = np.where((side != 0) & (side != np.array(mode.side, dtype=np.int64)[contacts]), 0, order)
            nc = len(self.degree)
            closed = np.isin(np.arange(nc), mode.closed)
            held = closed | ((np.array(mode.order, dtype=np.int64) < 0) & ~self.slides)
            still = Still(held & ~self.slides & (self.degree > 0), held & (self.degree == 2), closed)
            self.known[mode] = Watch(contacts[kept], rows[kept], sparse(rows[kept]), order[kept], still)
        return self.known[mode]

    def watched(self, mode: Mode) -> tuple[Indices, DoubleDouble, Indices]:
        """Return the rows of `ends` that may turn negative, with their contacts and the orders of their zeros."""
        watch = self.watch(mode)
        return watch.contacts, watch.rows, watch.order


def block(G: DoubleDouble, rows: list[int], columns: list[int]) -> DoubleDouble:
    """Return the entries of some rows and columns."""
    return G[np.ix_(rows, columns)]


def _solve(G: DoubleDouble, right: DoubleDouble) -> DoubleDouble:
    """Solve with a block of G; where it is singular, the contact forces are not uniquely determined."""
    if len(G) > 1:
        # Rows of springs and of masses have different units, which must not make them look dependent.
        rows = np.abs(G.hi).max(axis=1, keepdims=True)
        balanced = G.hi / np.where(rows > 0.0, rows, 1.0)
        columns = np.abs(balanced).max(axis=0)
        if not np.linalg.cond(balanced / np.where(columns > 0.0, columns, 1.0)) < 1e13:
            raise np.linalg.LinAlgError
    return solve(G, right)


def _product(a: DoubleDouble, b: DoubleDouble) -> DoubleDouble:
    """Return a b, with cancellation set to zero."""
    found = a @ b
    found.parts[:, np.abs(found.hi) <= FINE_ZERO * (np.abs(a.hi) @ np.abs(b.hi))] = 0.0
    return found


def _combined(T: Array, b: DoubleDouble) -> DoubleDouble:
    """Return T b, with cancellation set to zero."""
    return _product(DoubleDouble.of(T), b)


def still(system: System, mode: Mode | None) -> Still:
    """Return the zeros of a mode."""
    if mode is not None:
        return system.watch(mode).held
    none = np.zeros(len(system.degree), dtype=np.bool_)
    return Still(none, none, none)


def settled(
    system: System, mode: Mode | None, X: DoubleDouble, scale: Array, held: Still | None = None
) -> DoubleDouble:
    """Return X projected onto the zero gaps and rates of a mode, or of ``held``."""
    held = held or still(system, mode)
    C, CA = system.fine.C, system.fine.CA
    if held.none and not system.mixed:
        return X
    if system.mixed:
        closed = system.together(mode.closed if mode else ())
        constraint = stacked([[closed.C[closed.degree > 0]], [closed.CA[closed.degree == 2]]])
    else:
        rows, rates = np.flatnonzero(held.u), np.flatnonzero(held.U & ~system.slides)
        constraint = stacked([[C[rows]], [CA[rates]]])
    return _put_to_zero(system, constraint, X, scale)


def scale_after(system: System, scale: Array, P: Array) -> Array:
    """Return the scale (N,) with the effect of impulses P (nc,): the residual of balanced ones is rounding."""
    return np.maximum(scale, system.pushes @ P) if P.any() else scale


def _put_to_zero(system: System, constraint: DoubleDouble, X: DoubleDouble, scale: Array) -> DoubleDouble:
    """Return X projected so that these rows of it are zero."""
    # The constant and the signals stay; the other states move in proportion to their size.
    moves = np.where(np.arange(len(X)) < system.form.constant, scale, 0.0)
    for _ in range(REFINEMENTS):
        rest = (constraint @ X).hi
        if not rest.any():
            break
        correction = np.linalg.lstsq(constraint.hi * moves, rest, rcond=ZERO)[0]
        X = X - DoubleDouble.of(moves * correction)
    return X


@compiled(cube(cube, cube, matrix, vector, flags, flags, f8))
def reading(C: Array, CA: Array, X: Array, scale: Array, no_gap: Flags, no_rate: Flags, zero: float) -> Array:
    """Return C X and C A X (2, 2, nc) of X (2, N), with held values and rounding set to zero."""
    found = np.zeros((2, 2, C.shape[1]))
    for k, (rows, at_zero) in enumerate(((C, no_gap), (CA, no_rate))):
        for i in range(C.shape[1]):
            size, x, x_lo = 0.0, 0.0, 0.0
            for j in range(C.shape[2]):
                if rows[0, i, j] != 0.0:
                    y, y_lo = multiply(rows[0, i, j], rows[1, i, j], X[0, j], X[1, j])
                    x, x_lo = add(x, x_lo, y, y_lo)
                    size += abs(rows[0, i, j]) * scale[j]
            if not at_zero[i] and abs(x) > zero * size:
                found[k, 0, i], found[k, 1, i] = x, x_lo
    return found


def gaps(
    system: System, X: ArrayLike | DoubleDouble, scale: Array, held: Still | None = None, zero: float = ZERO
) -> tuple[DoubleDouble, DoubleDouble]:
    """Return u and U of the rows (nc,), for r = 0, with held values and rounding set to zero."""
    u, U = openings_and_rates(system, DoubleDouble.of(X), scale, held or still(system, None), zero)
    return DoubleDouble(u), DoubleDouble(U)


def openings_and_rates(system: System, X: DoubleDouble, scale: Array, held: Still, zero: float) -> Array:
    """Return the parts of u and U of `gaps` (2, 2, nc)."""
    fine = system.fine
    return reading(fine.C.parts, fine.CA.parts, np.ascontiguousarray(X.parts), scale, held.u, held.U, zero)


@compiled(types.int64[:, ::1](cube, indices, flags))
def motions(opening: Array, degree: Indices, slides: Flags) -> Indices:
    """Return whether a force is unknown in each row, the sign of U of slipping sliders, and the order of the zero (3, nc).

    A force is unknown in rows of degree 0, at closed contacts that do not open, and at sliders that do not slip. ``opening``
    holds u and U.
    """
    found = np.zeros((3, len(degree)), np.int64)
    for i in range(len(degree)):
        u, U = opening[0, 0, i], opening[1, 0, i] if degree[i] == 2 else 0.0
        moves = slides[i] and U != 0.0
        opens = not slides[i] and degree[i] > 0 and (u > 0.0 or U > 0.0)
        found[0, i] = not (moves or opens)
        found[1, i] = np.sign(U) if moves else 0
        found[2, i] = 0 if u > 0.0 or moves else 1
    return found


def choose_mode(
    system: System,
    X: ArrayLike | DoubleDouble,
    scale: Array,
    solver: str,
    held: Still | None = None,
    zero: float = ZERO,
) -> tuple[Mode, DoubleDouble]:
    """Return the next mode from X, by LCPs on the one-sided derivatives, and X.

    X differs only in the positions of sliders of degree 0, which have slipped, or begin beyond their threshold.

    Parameters
    ----------
    system : System
    X : (N,) array or DoubleDouble
    scale : (N,) array          largest |X| of the run so far
    solver : str                name of an LCP solver
    held : Still, optional      exact zeros
    zero : float                tolerance for zero, relative to the terms of a sum
    """
    if system.mixed:
        return _exchanged_mode(system, DoubleDouble.of(X), scale, held or still(system, None), zero)
    A, B, _, _, _, O, G = system.fine  # noqa: E741
    degree, r_max = system.degree, system.bounds[1]
    slides, nc = system.slides, len(system.degree)
    state = DoubleDouble.of(X)
    sought, sign, order = motions(
        openings_and_rates(system, state, scale, held or still(system, None), zero), degree, slides
    ).tolist()
    undecided, side = [i for i in range(nc) if sought[i]], [0] * nc
    closed: list[int] = []
    slips = [(i, sign[i]) for i in range(nc) if sign[i]]
    if not undecided:
        return Mode((), tuple(slips), tuple(order), tuple(side)), state
    start = state
    r = DoubleDouble.of(-np.array(sign) * np.where(slides, r_max, 0.0))
    for level in range(len(state) + 1):
        if not undecided:
            break
        # On closed rows the derivative of u is zero, which gives theirs of r; what remains is an LCP.
        g, terms = O @ state + G @ r, np.abs(O.hi) @ scale + np.abs(G.hi) @ np.abs(r.hi)
        c, m = closed, undecided
        q, W, summed = g[m], block(G, m, m), terms[m]
        if c:
            eliminated = _solve(block(G, c, c), stacked([[g[c][:, None], block(G, c, m)]]))
            q = q - block(G, m, c) @ eliminated[:, 0]
            W = W - block(G, m, c) @ eliminated[:, 1:]
            summed = summed + np.abs(block(G, m, c).hi) @ np.abs(eliminated.hi[:, 0])
        q.parts[:, np.abs(q.hi) <= zero * summed] = 0.0
        lower, upper = _bounds(system, m, side, level)
        answer = solve_lcp(W.hi, q.hi, solver, lower=lower, upper=upper).z
        tiny = zero * (summed + np.abs(W.hi) @ np.abs(answer))
        z, w = complementary(W, q, answer, lower, upper, tiny)
        force = r.parts.copy()
        force[:, m] = z.parts
        if c:
            force[:, c] = (-eliminated[:, 0] - eliminated[:, 1:] @ z).parts
        r = DoubleDouble(force)
        undecided = []
        for k, i in enumerate(m):
            unit, z_i, w_i = abs(G.hi[i, i]) or np.abs(G.hi[:, i]).max(), float(z.hi[k]), float(w.hi[k])
            room = min(z_i + r_max[i], r_max[i] - z_i) if slides[i] and level == 0 else abs(z_i)
            if room * unit > tiny[k]:
                closed.append(i)
                order[i] = level
                continue
            if slides[i] and level == 0:
                side[i] = 1 if z_i > 0.0 else -1
                if degree[i] == 0:
                    start, state = system.put(start, i, w[k]), system.put(state, i, w[k])
                    w_i = 0.0
            if abs(w_i) > tiny[k]:
                order[i] = int(degree[i]) + level - int(slides[i])
                if slides[i]:
                    slips.append((i, -side[i]))
            else:
                undecided.append(i)
        state, scale = A @ state + B @ r, np.abs(A.hi) @ scale + np.abs(B.hi) @ np.abs(r.hi)
        r = DoubleDouble.of(np.zeros(nc))
    for i in undecided:
        order[i] = -1
        if slides[i]:
            slips.append((i, -side[i]))
    return Mode(tuple(sorted(closed)), tuple(sorted(slips)), tuple(order), tuple(side)), start


def _exchanged_mode(
    system: System, X: DoubleDouble, scale: Array, held: Still, zero: float
) -> tuple[Mode, DoubleDouble]:
    """Return the mode of contacts without common relative degrees, and X.

    A number near the tolerance may count as zero in one combination and not in another, and then no mode fits: so larger
    tolerances are tried, too.

    Raises
    ------
    numpy.linalg.LinAlgError
        If no mode fits without an impulse.
    """
    for wider in ZERO_FACTORS:
        found = _exchanged(system, X, scale, held, wider * zero)
        if found is not None:
            return found
    raise np.linalg.LinAlgError("no mode")


def _exchanged(
    system: System, X: DoubleDouble, scale: Array, held: Still, zero: float
) -> tuple[Mode, DoubleDouble] | None:
    """Return the mode, by exchanges of the last row with a wrong sign, and X; None if the exchanges cycle.

    They do not, but for rounding, since the rows depend on their forces by a P-matrix of rational functions, ordered by the
    first terms of their series. X differs only by rounding, which is set to zero beforehand.
    """
    degree, nc = system.degree, len(system.degree)
    u, U = gaps(system, X, scale, held, zero)
    apart = (degree > 0) & ((u.hi > 0.0) | ((degree == 2) & (U.hi > 0.0)))
    every, near = system.together(tuple(range(nc))), tuple(map(int, np.flatnonzero(~apart)))
    slow = zero * float((np.abs(every.CA.hi[every.degree == 2]) @ scale).max(initial=0.0))
    X = _at_rest(system, near, X, (u, slow), held, scale, zero)
    u, U = gaps(system, X, scale, held, zero)
    closed: set[int] = set()
    seen: set[tuple[int, ...]] = set()
    while (rows := tuple(sorted(closed))) not in seen:
        seen.add(rows)
        order, sign, impulsive = _first_terms(system, rows, X, (u, U), held, scale, zero, slow)
        wrong = np.flatnonzero((sign < 0.0) & ~apart)
        if len(wrong) == 0:
            first = np.where(apart, np.where(u.hi > 0.0, 0, 1), order)
            return None if impulsive else (Mode(rows, (), tuple(map(int, first)), (0,) * nc), X)
        closed ^= {int(wrong[-1])}
    return None


def _at_rest(
    system: System,
    rows: tuple[int, ...],
    X: DoubleDouble,
    opening: tuple[DoubleDouble, float],
    held: Still,
    scale: Array,
    zero: float,
) -> DoubleDouble:
    """Return X projected onto closed combinations of these rows, and onto zero rates of the slow ones.

    ``opening`` holds u, and the rate that is slow.
    """
    u, slow = opening
    together = system.together(rows)
    touches = (_openings(system, rows, u, held, scale, zero).hi == 0.0) & (together.degree > 0)
    lines = _combined(_touching(system, u, held, scale, zero), system.fine.C)
    rates = stacked([[together.CA[touches & (together.degree == 2)]], [_product(lines, system.fine.A)]])
    rests = rates[np.abs((rates @ X).hi) <= slow]
    return _put_to_zero(system, stacked([[together.C[touches]], [lines], [rests]]), X, scale)


def _first_terms(
    system: System,
    rows: tuple[int, ...],
    X: DoubleDouble,
    opening: tuple[DoubleDouble, DoubleDouble],
    held: Still,
    scale: Array,
    zero: float,
    slow: float,
) -> tuple[Indices, Array, bool]:
    """Return the order and the sign of the first nonzero term of r on closed ``rows``, and of u on others.

    The order is -1 if there is none. Rows inconsistent with the state, whose ``opening`` is (u, U), need impulses,
    r = p' δ' + p δ + ..., whose signs come first; the flag says whether there are any. Combinations of degree 2 that open no
    faster than ``slow`` are at rest.
    """
    A, B, *_ = system.fine
    at, together = list(rows), system.together(rows)
    u, U = opening
    order, sign = np.full(len(system.degree), -1), np.zeros(len(system.degree))
    impulsive, state, sizes = False, X, scale

    def push(lacks: DoubleDouble) -> DoubleDouble:
        """Return B p of the impulses p that make the combinations consistent, and write the signs of p."""
        p = np.zeros((2, len(sign)))
        p[:, at] = _solve(together.G[:, at], -lacks).parts
        size = np.zeros(len(sign))
        size[at] = np.abs(np.linalg.inv(together.G.hi[:, at])) @ np.abs(lacks.hi)
        new = (np.abs(p[0]) > FLOAT_ZERO * size) & (sign == 0.0)
        order[new], sign[new] = 0, np.sign(p[0, new])
        return B @ DoubleDouble(p)

    gap = _openings(system, rows, u, held, scale, zero)
    if gap.hi.any():
        impulsive = True
        # δ' displaces the masses to close their gaps; δ displaces the rest and stops the masses.
        state = state + A @ push(DoubleDouble(np.where(together.degree == 2, gap.parts, 0.0)))
        sizes = np.maximum(sizes, np.abs(state.hi))
    rate = together.CA @ state
    rate.parts[:, (together.degree < 2) | (np.abs(rate.hi) <= slow)] = 0.0
    if gap.hi.any() or rate.hi.any():
        impulsive = True
        first = together.C @ state
        first.parts[:, ~((together.degree == 1) & (gap.hi != 0.0))] = 0.0
        state = state + push(first + rate)
        sizes = np.maximum(sizes, np.abs(state.hi))
    flow, F = system.reaction(Mode(rows, (), (), ()))
    reads = system.openings(F)
    reads.parts[:, at] = F.parts[:, at]
    open_ = np.isin(np.arange(len(sign)), at, invert=True)
    for k in range(len(X) + 1):
        value = (reads @ state).hi
        if k == 0 and not impulsive:
            direct = open_ & (system.degree > 0)
            value = np.where(direct, u.hi, value)
        elif k == 1 and not impulsive:
            value = np.where(open_ & (system.degree == 2), U.hi, value)
        new = (sign == 0.0) & (np.abs(value) > zero * (np.abs(reads.hi) @ sizes))
        order[new], sign[new] = k, np.sign(value[new])
        if sign.all():
            break
        state, sizes = flow.generator @ state, np.abs(flow.generator.hi) @ sizes
    return order, sign, impulsive


def _bounds(system: System, rows: list[int], side: list[int], level: int) -> tuple[Array, Array]:
    """Return the bounds of r, and at a higher level those of its derivative, for undecided rows."""
    slides = system.slides[rows]
    if level == 0:
        return system.bounds[0][rows], system.bounds[1][rows]
    at = np.array([side[i] for i in rows])
    return np.where(slides & (at > 0), -np.inf, 0.0), np.where(slides & (at > 0), 0.0, np.inf)


def impact(
    system: System,
    X: ArrayLike | DoubleDouble,
    scale: Array,
    solver: str,
    restitution: Array | None = None,
    held: Still | None = None,
    zero: float = ZERO,
    among: Flags | None = None,
    left: DoubleDouble | None = None,
    rates: ArrayLike | DoubleDouble | None = None,
) -> tuple[DoubleDouble, Array, Still]:
    """Return X after the impacts at this instant, the impulses (nc,), and the zeros after them.

    Newton's law is 0 <= P ⟂ U⁺ + e U⁻ >= 0; at contacts that open already e is 0. The coefficients e
    are those of the rows, or ``restitution`` (nc,). The rows ``among`` (nc,), or else all closed ones, undergo impacts. If a
    prescribed velocity jumps, X has its right limit, and ``left`` (N,), which gives U⁻, its left limit. The left limits
    ``rates`` (nc,) of U, with those of massless nodes, which are not in X, determine the rebound of the impulse paths of
    `lcpimpact.hybrid.impact_law`.
    """
    e = system.restitution if restitution is None else restitution
    state, held = DoubleDouble.of(X), held or still(system, None)
    u, U = openings_and_rates(system, state, scale, held, zero)
    before = U if left is None else openings_and_rates(system, left, scale, held, zero)[1]
    if among is None:
        meeting, bounce, q, meet = approach(u, U, before, e, system.meets)
    else:
        meeting, bounce, q, meet = approach(np.zeros_like(u), U, before, e, system.meets & among)
    lines, (G, B), toward, back = NO_PATHS, (system.fine.G, system.fine.B), U, before
    if len(system.lines) and rates is not None and among is None:
        lines = _touching(system, DoubleDouble(u), held, scale, zero)
        speeds, known = _line_rates(system, lines, state, scale, zero), DoubleDouble.of(rates)
        rebounds = path_restitution(lines, known.hi, e)
        G, B = system.path_matrices(lines)
        toward, back = (
            np.concatenate([each, more.parts], 1) for each, more in ((U, speeds), (before, DoubleDouble.of(rebounds)))
        )
        meeting = np.append(meeting, len(e) + np.arange(len(lines)))
        bounce = np.append(bounce, np.ones(len(lines)))
        q = toward[0, meeting] + bounce * back[0, meeting]
        meet = bool((q < 0.0).any())
    if not meet:
        return state, np.zeros(len(system.degree)), held
    z = system.impact_lcp(G, lines, meeting, solver).solve(q).z
    parts = np.ascontiguousarray(state.parts)
    after, impulses, ended = rebound(G.parts, B.parts, parts, toward, back, bounce, meeting, z, zero)
    if not ended:
        raise np.linalg.LinAlgError("no complementary basis")
    P = impulses[0] if len(lines) == 0 else impulses[0, : len(e)] + impulses[0, len(e) :] @ lines
    rests = at_rest(P, before, e, system.G, held.U, system.degree)
    return DoubleDouble(after), P, Still(held.u, rests, held.closed)


def _touching(system: System, u: DoubleDouble, held: Still, scale: Array, zero: float) -> Array:
    """Return the impulse paths (np, nc) over massless nodes whose contacts, with the openings ``u``, are all closed."""
    found = [
        not (_openings(system, tuple(map(int, np.flatnonzero(line))), u, held, scale, zero).hi > 0.0).any()
        for line in system.lines
    ]
    return np.asarray(system.lines[np.array(found, dtype=np.bool_)])


def _openings(
    system: System, rows: tuple[int, ...], u: DoubleDouble, held: Still, scale: Array, zero: float
) -> DoubleDouble:
    """Return the combinations T u of the openings of rows, those of degree 0 as zero, since forces decide on them."""
    together, at = system.together(rows), list(rows)
    found = DoubleDouble.of(together.T) @ u[at]
    by_definition = ~(together.T[:, ~held.closed[at]] != 0.0).any(axis=1)
    terms = np.abs(together.T) @ (np.abs(system.fine.C.hi[at]) @ scale)
    found.parts[:, (together.degree == 0) | by_definition | (np.abs(found.hi) <= zero * terms)] = 0.0
    return found


def _line_rates(system: System, lines: Array, X: DoubleDouble, scale: Array, zero: float) -> DoubleDouble:
    """Return the opening rates of impulse paths, which do not depend on massless nodes, with rounding set to zero."""
    rates = _product(_combined(lines, system.fine.C), system.fine.A)
    found = rates @ X
    found.parts[:, np.abs(found.hi) <= zero * (np.abs(rates.hi) @ scale)] = 0.0
    return found


def refuse_velocity_jumps(dynamics: Dynamics, t_end: float, method: str) -> None:
    """Refuse a bumper with e > 0 on a node whose prescribed velocity jumps, for methods with the right limit of U only."""
    for i, motion in dynamics.motions.items():
        rows = np.flatnonzero(
            (dynamics.H[:, i] != 0.0) & (dynamics.relative_degree == 2) & (dynamics.restitution > 0.0)
        )
        if len(rows) and isinstance(motion, PiecewisePolynomial) and len(motion.breakpoints(0.0, t_end)):
            raise UnsupportedError(
                f"the velocity of the node {dynamics.nodes[i]!r} jumps, and the contact {dynamics.contacts[rows[0]].name!r} "
                f"there has a coefficient of restitution, which {method!r} does not handle: take method='exact' or "
                "'moreau-jean'"
            )


def refuse_mixed_degrees(system: System, method: str, except_schemes: bool = False) -> None:
    """Refuse contacts without a common relative degree; with ``except_schemes`` only beside sliders and in systems."""
    names = system.mixed_degrees
    if not names or (except_schemes and system.dynamics.stores_energy and not system.slides.any()):
        return
    beside = " beside sliders" if except_schemes and system.dynamics.stores_energy else ""
    others = "'moreau-jean'" if except_schemes else "'exact' or 'moreau-jean'"
    raise UnsupportedError(
        f"the contacts {', '.join(map(repr, names))} have no common relative degree when all are closed, and {method!r} "
        f"does not handle that{beside}: take method={others}"
    )
