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
from typing import NamedTuple

import numpy as np
from numba import types
from numpy.typing import ArrayLike
from scipy.linalg import null_space

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.compiled import compiled, cube, f8, flags, indices, matrix, vector
from lcpimpact.double_double import DoubleDouble, add, eliminate, multiply, product, solve, stacked, total
from lcpimpact.errors import UnsupportedError
from lcpimpact.integrators.flow import Flow, Sparse, sparse
from lcpimpact.lcp.solve import PreparedLCP, prepare_lcp, solve_lcp
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.first_order import FirstOrderForm, first_order_form
from lcpimpact.scheme.signals import PiecewisePolynomial

ZERO = 1e-12
"""What counts as zero in a state of floats, relative to the terms of the sum that gave it, each taken at its largest value
so far: a root found to rounding leaves about 1e-15 of them."""

FLOAT_ZERO = 16.0 * float(np.finfo(float).eps)
"""What counts as rounding in the solution of an LCP in floats."""

FINE_ZERO = 2.0**-95
"""What counts as zero in a state of double-doubles, likewise: a root leaves about 1e-31."""


@dataclass(frozen=True)
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
class Still:
    """Which openings u and which rates U are zero by what the mode before, or an impact, has made of them.

    What is closed stays closed, whatever rounding makes of its gap, until its own force ends that.

    Attributes
    ----------
    u, U : (nc,) arrays of bool
    """

    u: Flags
    U: Flags


class Watch(NamedTuple):
    """What ends a mode, and what it holds.

    Attributes
    ----------
    contacts : (k,) array       the row of H of each
    rows : DoubleDouble         rows c (k, N + nw), where c·(X, w) turning negative ends the mode
    entries : Sparse            the same
    order : (k,) array          the order of the zero with which it begins
    held : Still                what is zero as long as the mode lasts
    """

    contacts: Indices
    rows: DoubleDouble
    entries: Sparse
    order: Indices
    held: Still


class Coordinates(NamedTuple):
    """How q, v and r are read off the state in a mode.

    Attributes
    ----------
    rows : DoubleDouble     (2 n + nc, N)
    entries : Sparse        the same
    """

    rows: DoubleDouble
    entries: Sparse


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
        The form, where it is not that of ``dynamics`` alone: linear about one instant, or with inputs beside r.
    inputs : pair of (N, nw) and (nc, nw) arrays, optional
        E and D_w with X' = A X + B r + E w, u = C X + D r + D_w w.
    """

    dynamics: Dynamics
    given: FirstOrderForm | None = None
    inputs: tuple[Array, Array] | None = None
    flows: dict[object, tuple[Flow, DoubleDouble]] = field(default_factory=dict)
    lines: dict[object, tuple[Indices, Indices, DoubleDouble]] = field(default_factory=dict)
    readings: dict[object, Coordinates] = field(default_factory=dict)
    known: dict[Mode, Watch] = field(default_factory=dict)
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
        """Return X at t = 0; a slider of degree 0 begins where the coordinates have it."""
        return np.concatenate([self.form.state(q, v), self.dynamics.gap(q)[self.remembered]])

    def put(self, X: DoubleDouble, i: int, u: DoubleDouble) -> DoubleDouble:
        """Return X with the place of slider i, which has degree 0, moved by u."""
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
            A, B, _, _, _, O, G = self.fine  # noqa: E741
            F = np.zeros((2, *O.shape))
            for i, sign in mode.slips:
                F[0, i, self.form.constant] = -sign * self.dynamics.r_max[i]
            rows = list(mode.closed)
            if rows:
                F[:, rows] = -_solve(block(G, rows, rows), O[rows] + G[rows] @ DoubleDouble(F)).parts
            # What cancels in A + B F is zero: nothing moves where forces balance.
            closed = A + B @ DoubleDouble(F)
            closed.parts[:, np.abs(closed.hi) <= FINE_ZERO * (np.abs(A.hi) + np.abs(B.hi) @ np.abs(F[0]))] = 0.0
            self.flows[mode.key] = Flow(closed), DoubleDouble(F)
        return self.flows[mode.key]

    def mode(self, mode: Mode) -> tuple[Flow, Array]:
        """Return the flow of a mode, and the F with r = F X in floats."""
        flow, F = self.reaction(mode)
        return flow, F.hi

    def coordinates(self, mode: Mode) -> Coordinates:
        """Return the rows by which q, v and r are read off the state in a mode."""
        if mode.key not in self.readings:
            (flow, F), (_, _, _, _, Q, Qr) = self.reaction(mode), self.form.double_doubles
            place = stacked([[Q, np.zeros((len(Q), len(self.remembered)))]]) + Qr @ F
            rows = stacked([[place], [place @ flow.generator], [F]])
            self.readings[mode.key] = Coordinates(rows, sparse(rows))
        return self.readings[mode.key]

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
            found[rows] = -_solve(block(self.fine.G, rows, rows), DoubleDouble.of(self.O_w[rows])).hi
        return found

    def ends(self, mode: Mode) -> tuple[Indices, Indices, DoubleDouble]:
        """Return what ends a mode where it turns negative: for each the row of H, its side, and the row c of c·(X, w).

        The side is that of the threshold of a slider that sticks, and 0 for all others; without inputs it is c·X.
        """
        if mode.key not in self.lines:
            (flow, F), Fw = self.reaction(mode), self.share(mode)
            E, Dw = self.input_matrices
            D, B = self.fine.D, self.matrices[1]
            gap = self.fine.C + D @ F
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
            self.lines[mode.key] = (
                np.array([i for i, _, _ in found], dtype=np.int64),
                np.array([side for _, side, _ in found], dtype=np.int64),
                DoubleDouble(np.ascontiguousarray(rows.transpose(1, 0, 2))),
            )
        return self.lines[mode.key]

    def watch(self, mode: Mode) -> Watch:
        """Return what ends a mode, and what it holds at zero."""
        if mode not in self.known:
            contacts, side, rows = self.ends(mode)
            order = np.array(mode.order, dtype=np.int64)[contacts]
            kept = np.flatnonzero(order >= 0)
            order = np.where((side != 0) & (side != np.array(mode.side, dtype=np.int64)[contacts]), 0, order)
            nc = len(self.degree)
            closed = np.isin(np.arange(nc), mode.closed)
            held = closed | ((np.array(mode.order, dtype=np.int64) < 0) & ~self.slides)
            still = Still(held & ~self.slides & (self.degree > 0), held & (self.degree == 2))
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
    """Solve with a block of G; where it is singular, the closed rows share their force as they like."""
    if len(G) > 1 and not np.linalg.cond(G.hi) < 1e13:
        raise np.linalg.LinAlgError
    return solve(G, right)


def _zero(terms: Array, values: Array, zero: float) -> Array:
    """Set values to zero that are rounding, compared with the sum of the absolute terms that they came from."""
    return np.where(np.abs(values) <= zero * terms, 0.0, values)


def still(system: System, mode: Mode | None) -> Still:
    """Return what a mode holds at zero."""
    if mode is not None:
        return system.watch(mode).held
    none = np.zeros(len(system.degree), dtype=np.bool_)
    return Still(none, none)


def settled(
    system: System, mode: Mode | None, X: DoubleDouble, scale: Array, held: Still | None = None
) -> DoubleDouble:
    """Return X with the gaps and rates put back to zero that a mode, or what is ``held``, keeps at zero."""
    held = held or still(system, mode)
    C, CA = system.fine.C, system.fine.CA
    if not (held.u.any() or held.U.any()):
        return X
    rows, rates = np.flatnonzero(held.u), np.flatnonzero(held.U & ~system.slides)
    constraint = stacked([[C[rows]], [CA[rates]]])
    rest = (constraint @ X).hi
    if not rest.any():
        return X
    # What is given, the constant and the signals, stays what it is; the rest moves in proportion to its size.
    moves = np.where(np.arange(len(X)) < system.form.constant, scale, 0.0)
    correction = np.linalg.lstsq(constraint.hi * moves, rest, rcond=ZERO)[0]
    return X - DoubleDouble.of(moves * correction)


@compiled(matrix(cube, matrix, vector, flags, f8))
def reading(C: Array, X: Array, scale: Array, at_zero: Flags, zero: float) -> Array:
    """Return C X (2, n) for C (2, n, N) and X (2, N), with what is held at zero and what is rounding set to zero."""
    found = np.zeros((2, C.shape[1]))
    for i in range(C.shape[1]):
        size, x, x_lo = 0.0, 0.0, 0.0
        for j in range(C.shape[2]):
            if C[0, i, j] != 0.0:
                y, y_lo = multiply(C[0, i, j], C[1, i, j], X[0, j], X[1, j])
                x, x_lo = add(x, x_lo, y, y_lo)
                size += abs(C[0, i, j]) * scale[j]
        if not at_zero[i] and abs(x) > zero * size:
            found[0, i], found[1, i] = x, x_lo
    return found


def gaps(
    system: System, X: ArrayLike | DoubleDouble, scale: Array, held: Still | None = None, zero: float = ZERO
) -> tuple[DoubleDouble, DoubleDouble]:
    """Return u and U of the rows (nc,), for r = 0, with what is held and what is rounding set to zero."""
    state, held = np.ascontiguousarray(DoubleDouble.of(X).parts), held or still(system, None)
    u = reading(system.fine.C.parts, state, scale, held.u, zero)
    U = reading(system.fine.CA.parts, state, scale, held.U, zero)
    return DoubleDouble(u), DoubleDouble(U)


@compiled(types.Tuple((matrix, matrix, types.boolean))(cube, matrix, vector, vector, vector, vector))
def exchange(W: Array, q: Array, z: Array, lower: Array, upper: Array, tiny: Array) -> tuple[Array, Array, bool]:
    """Return z and w = W z + q, complementary within bounds, as double-doubles, from a solution z in floats.

    The rows that lie between their bounds in floats are solved for; where a sign then is wrong by more than ``tiny`` (in the
    unit of q), the last such row is exchanged (Murty's rule) until none is; the flag says whether that came to an end.
    """
    n = len(z)
    free, high, slack = np.zeros(n, np.bool_), np.zeros(n, np.bool_), np.zeros(n)
    found, w = np.zeros((2, n)), q.copy()
    for i in range(n):
        unit = abs(W[0, i, i]) if W[0, i, i] != 0.0 else np.abs(W[0, :, i]).max()
        slack[i] = tiny[i] / unit if unit > 0.0 else 0.0
        w0 = q[0, i]
        for j in range(n):
            w0 += W[0, i, j] * z[j]
        # A float that lies at its bound but for rounding begins there: two rows that share a force must not both be free.
        near = max(slack[i], FLOAT_ZERO * abs(z[i]))
        free[i] = z[i] - lower[i] > near and upper[i] - z[i] > near and (z[i] - lower[i]) * unit > w0
        high[i] = not free[i] and upper[i] - z[i] < z[i] - lower[i]
    for _ in range(4 * n + 4):
        for i in range(n):
            found[0, i] = 0.0 if free[i] else (upper[i] if high[i] else lower[i])
            found[1, i] = 0.0
        rows = np.flatnonzero(free)
        if len(rows):
            rest = product(W, found.reshape(2, n, 1))
            block, right = np.empty((2, len(rows), len(rows))), np.empty((2, len(rows), 1))
            for a, k in enumerate(rows):
                x, x_lo = add(q[0, k], q[1, k], rest[0, k, 0], rest[1, k, 0])
                right[0, a, 0], right[1, a, 0] = -x, -x_lo
                for b, m in enumerate(rows):
                    block[0, a, b], block[1, a, b] = W[0, k, m], W[1, k, m]
            solution = eliminate(block, right)
            if np.isnan(solution[0, 0, 0]):
                return found, w, False
            for a, k in enumerate(rows):
                found[0, k], found[1, k] = solution[0, a, 0], solution[1, a, 0]
        w = total(q, product(W, found.reshape(2, n, 1))[:, :, 0].copy())
        wrong, above = -1, False
        for i in range(n):
            if free[i]:
                if found[0, i] < lower[i] - slack[i] or found[0, i] > upper[i] + slack[i]:
                    wrong, above = i, found[0, i] > upper[i] + slack[i]
            elif lower[i] < upper[i] and (w[0, i] > tiny[i] if high[i] else w[0, i] < -tiny[i]):
                wrong, above = i, False
        if wrong < 0:
            return found, w, True
        free[wrong], high[wrong] = not free[wrong], above
    return found, w, False


def complementary(
    W: DoubleDouble, q: DoubleDouble, z: Array, lower: Array, upper: Array, tiny: Array
) -> tuple[DoubleDouble, DoubleDouble]:
    """Return z and w = W z + q, complementary within bounds, as double-doubles, from a solution z in floats.

    Raises
    ------
    numpy.linalg.LinAlgError
        If no exchange of rows leads to signs that are right.
    """
    found, w, ended = exchange(
        np.ascontiguousarray(W.parts), np.ascontiguousarray(q.parts), *(np.asarray(a) for a in (z, lower, upper, tiny))
    )
    if not ended:
        raise np.linalg.LinAlgError("no complementary basis")
    return DoubleDouble(found), DoubleDouble(w)


def choose_mode(
    system: System,
    X: ArrayLike | DoubleDouble,
    scale: Array,
    solver: str,
    held: Still | None = None,
    zero: float = ZERO,
) -> tuple[Mode, DoubleDouble]:
    """Return the mode in which the motion goes on from X, by LCPs on the one-sided derivatives, and X.

    X differs only in the places of sliders of degree 0, which have slipped, or begin with a force beyond their threshold.

    Parameters
    ----------
    system : System
    X : (N,) array or DoubleDouble
    scale : (N,) array          largest |X| of the run so far
    solver : str                name of an LCP solver
    held : Still, optional      what is zero by definition
    zero : float                what counts as zero, relative to the terms that gave it
    """
    A, B, _, _, _, O, G = system.fine  # noqa: E741
    degree, r_max = system.degree, system.bounds[1]
    slides, nc = system.slides, len(system.degree)
    state = DoubleDouble.of(X)
    u, U = (each.hi for each in gaps(system, state, scale, held, zero))
    # A force is sought on rows of degree 0, on those that touch and do not open, and on sliders that do not move.
    moving = slides & (degree == 2) & (U != 0.0)
    opening = ~slides & (degree > 0) & ((u > 0.0) | ((degree == 2) & (U > 0.0)))
    undecided = [int(i) for i in np.flatnonzero(~opening & ~moving)]
    closed: list[int] = []
    slips = [(int(i), int(np.sign(U[i]))) for i in np.flatnonzero(moving)]
    order = [0 if u[i] > 0.0 or moving[i] else 1 for i in range(nc)]
    side = [0] * nc
    start = state
    r = DoubleDouble.of(np.where(moving, -np.sign(U) * np.where(slides, r_max, 0.0), 0.0))
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


def _bounds(system: System, rows: list[int], side: list[int], level: int) -> tuple[Array, Array]:
    """Return the bounds of r, and for a higher level those of its derivative, for rows that are undecided."""
    slides = system.slides[rows]
    if level == 0:
        return system.bounds[0][rows], system.bounds[1][rows]
    at = np.array([side[i] for i in rows])
    return np.where(slides & (at > 0), -np.inf, 0.0), np.where(slides & (at > 0), 0.0, np.inf)


@compiled(types.Tuple((matrix, matrix, types.boolean))(cube, cube, matrix, matrix, matrix, vector, indices, vector, f8))
def rebound(
    G: Array, B: Array, X: Array, U: Array, before: Array, bounce: Array, rows: Indices, z: Array, zero: float
) -> tuple[Array, Array, bool]:
    """Return X + B P and P, double-doubles, where 0 <= P ⟂ G P + U + e U⁻ >= 0 on the rows that meet; U⁻ is ``before``.

    ``bounce`` is e on the rows that meet, and z the impulses in floats (see `exchange`).
    """
    n = len(rows)
    W, q, tiny, P = np.empty((2, n, n)), np.empty((2, n)), np.empty(n), np.zeros((2, G.shape[1]))
    for a, i in enumerate(rows):
        back, back_lo = multiply(before[0, i], before[1, i], bounce[a], 0.0)
        q[0, a], q[1, a] = add(U[0, i], U[1, i], back, back_lo)
        tiny[a] = abs(q[0, a])
        for b, j in enumerate(rows):
            W[0, a, b], W[1, a, b] = G[0, i, j], G[1, i, j]
            tiny[a] += abs(W[0, a, b] * z[b])
    found, _, ended = exchange(W, q, z, np.zeros(n), np.full(n, np.inf), zero * tiny)
    for a, i in enumerate(rows):
        if found[0, a] > 0.0:
            P[0, i], P[1, i] = found[0, a], found[1, a]
    return total(X, product(B, P.reshape(2, -1, 1))[:, :, 0].copy()), P, ended


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
) -> tuple[DoubleDouble, Array, Still]:
    """Return X after the impacts at this instant, the impulses (nc,), and what is held at zero after them.

    Newton's law is 0 <= P ⟂ U⁺ + e U⁻ >= 0; where plates part already it only forbids that they meet. The coefficients e
    are those of the rows, or ``restitution`` (nc,). The rows ``among`` (nc,) meet, or else all that touch. Where a
    prescribed velocity jumps, X has its right limit, and ``left`` (N,) the left one, of which U⁻ is made.
    """
    e = system.restitution if restitution is None else restitution
    state, held = DoubleDouble.of(X), held or still(system, None)
    u, U = gaps(system, state, scale, held, zero)
    meeting = np.flatnonzero(((u.hi <= 0.0) if among is None else among) & system.meets)
    before = U if left is None else gaps(system, left, scale, held, zero)[1]
    approach = before.hi[meeting]
    bounce = np.where(approach < 0.0, e[meeting], 0.0)
    q = U.hi[meeting] + bounce * approach
    if not (q < 0.0).any():
        return state, np.zeros(len(system.degree)), held
    z = system.impact_lcp(tuple(meeting.tolist()), solver).solve(q).z
    fine, parts = system.fine, np.ascontiguousarray(state.parts)
    after, impulses, ended = rebound(fine.G.parts, fine.B.parts, parts, U.parts, before.parts, bounce, meeting, z, zero)
    if not ended:
        raise np.linalg.LinAlgError("no complementary basis")
    P = impulses[0]
    stays = ((P > 0.0) & (e * np.minimum(before.hi, 0.0) == 0.0)) | (held.U & (system.G @ P == 0.0))
    return DoubleDouble(after), P, Still(held.u, stays)


def refuse_velocity_jumps(dynamics: Dynamics, t_end: float, method: str) -> None:
    """Refuse a bumper with e > 0 on a node whose given velocity jumps, for methods that know only the right limit of U."""
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
