r"""The linear complementarity system of a scheme, its contact modes, and the motion in each.

In first-order form (see `lcpimpact.scheme.first_order`) the system is X' = A X + B r, u = C X + D r, 0 <= u ⟂ r >= 0. A
*mode* is the set of closed rows, on which u ≡ 0. With ρ_i the relative degree of row i,

.. math:: u_i^{(ρ_i)} = O_i X + G_i r, \qquad O_i = C_i A^{ρ_i}, \qquad G_i = D_i,\; C_i B,\; C_i A B \quad (ρ_i = 0, 1, 2),

so the closed rows give r = F X, and the mode moves by X' = (A + B F) X.

*Joint relative degree.* Closed rows with a common massless node have combinations T u in which it cancels, and whose
relative degree is higher than theirs: bodies that ride on one plate, a body on a plate that is stopped, or the diodes of a
bridge (see `lcpimpact.scheme.decomposition.degrees_together`). A mode then imposes each combination at its own level,

.. math:: (T u)_k^{(ρ_k)} = (T C)_k A^{ρ_k} X + (T G)_k r = 0 .

A slider is a row too: it sticks, with u constant and -r_0 < r < r_0, or slips with r = -r_0 sign U. On a
spring only (ρ = 0), the position p at which it sticks is an additional state, and u counts from there.

A relay is the same with u in place of U: it slides, with u ≡ 0 and r_min < r < r_max, or r = r_min where u > 0 and r = r_max
where u < 0. A sliding mode is Filippov's: r is what keeps u at zero.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import null_space

from lcpimpact.arrays import Array, Flags, Indices, Matrix, Stack, Vector
from lcpimpact.errors import UnsupportedError
from lcpimpact.hybrid.flow import DiagonalBlock, Flow
from lcpimpact.hybrid.generator import SparseRows, sparse
from lcpimpact.hybrid.windows import BERNSTEIN
from lcpimpact.lcp.friction import GLOCKER, FrictionRows, friction_maps
from lcpimpact.lcp.solve import PreparedLCP, prepare_lcp
from lcpimpact.memo import Memo, remembered
from lcpimpact.numerics.double_double import DoubleDouble, lifted, stacked, with_slopes
from lcpimpact.numerics.elimination import solve_finely
from lcpimpact.scheme.decomposition import degrees_together, is_singular
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.first_order import FirstOrderForm, first_order_form

MAX_STATES = 32
"""Largest number of states of a small system."""

ZERO = 1e-12
"""Tolerance for zero in a state of floats, relative to the terms of the sum at their largest so far: a root located
to rounding leaves about 1e-15 of them."""

FINE_ZERO = 2.0**-95
"""Tolerance for zero in a state of double-doubles, likewise: a root leaves about 1e-31."""


@dataclass(frozen=True)
class Mode:
    """The contact mode: the state of each row, and how it begins.

    Attributes
    ----------
    closed : tuple of int       the rows with u ≡ 0: closed contacts, sticking sliders and sliding relays
    slips : tuple of (int, int) the sliders that slip, with the sign of U, and the relays at a bound, with that of u
    order : tuple of int        initial order of the zero of its event function, -1 if it is zero for ever
    side : tuple of int         1 or -1 for a slider or relay that begins to stick or slide with r at r_max or r_min, else 0
    other_order : tuple of int  of sticking friction, the order of the zero of μ_s r_N + r_T; ``order`` is that of
                                μ_s r_N - r_T
    """

    closed: tuple[int, ...]
    slips: tuple[tuple[int, int], ...]
    order: tuple[int, ...]
    side: tuple[int, ...]
    other_order: tuple[int, ...] = ()

    @property
    def key(self) -> tuple[tuple[int, ...], tuple[tuple[int, int], ...]]:
        """The part that determines the flow."""
        return self.closed, self.slips


def contact_mode(closed: Flags, order: Indices) -> Mode:
    """Return the mode of contacts only, with the order of the zero of each (nc,)."""
    none = (0,) * len(order)
    return Mode(tuple(np.flatnonzero(closed).tolist()), (), tuple(order.tolist()), none, none)


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
    entries : SparseRows            the same
    order : (k,) array          the order of the zero with which it begins
    held : Still                zeros as long as the mode lasts
    """

    contacts: Indices
    rows: DoubleDouble
    entries: SparseRows
    order: Indices
    held: Still


class Coordinates(NamedTuple):
    """Rows that give q, v and r in terms of the state in a mode.

    Attributes
    ----------
    rows : DoubleDouble     (2 n + nc, N)
    entries : SparseRows        the same
    """

    rows: DoubleDouble
    entries: SparseRows


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


class Laws(NamedTuple):
    """The laws of all rows as complementarity of y and w = O X + G y, with r = T y.

    Of each row with friction there are two unknowns, μ r_N + r_T and the negative part of the slip acceleration (see
    `lcpimpact.lcp.friction`): the former in the place of r_T, the latter after those of all rows (m unknowns).

    Attributes
    ----------
    O : DoubleDouble (m, N)
    G : DoubleDouble (m, m)
    by_force : DoubleDouble (m, nc)     w by given forces r
    T : (nc, m) array
    weights : (m, nc) array             rounding of w by that of the rows
    lower, upper : (m,) arrays          bounds of y
    rank : (m,) array                   relative degree of the row that w is of, less one where it is of the rate U
    """

    O: DoubleDouble  # noqa: E741
    G: DoubleDouble
    by_force: DoubleDouble
    T: Array
    weights: Array
    lower: Array
    upper: Array
    rank: Indices


class Fine(NamedTuple):
    """The matrices of a system as double-doubles: A (N, N), B (N, nc), C and C A (nc, N), D (nc, nc), O, G."""

    A: DoubleDouble
    B: DoubleDouble
    C: DoubleDouble
    D: DoubleDouble
    CA: DoubleDouble
    O: DoubleDouble  # noqa: E741
    G: DoubleDouble


class Plant(NamedTuple):
    """A small system of contacts only, with Newton's law, for compiled code: its matrices as double-doubles (2, ...).

    Attributes
    ----------
    A, B, C, CA, O, G : double-doubles
    degree : (nc,) array        relative degrees
    meets : (nc,) array         which rows have impacts
    e : (nc,) array             coefficients of restitution
    reach : (N, N) array        effect of each state on the others within a window
    moves : (N,) array          the states that are not signals
    basis : (2, p + 1, p + 1)   from monomial to Bernstein coefficients
    breakpoints : (nb,) array   those of the signals
    """

    A: Stack
    B: Stack
    C: Stack
    CA: Stack
    O: Stack  # noqa: E741
    G: Stack
    degree: Indices
    meets: Flags
    e: Vector
    reach: Matrix
    moves: Flags
    basis: Stack
    breakpoints: Vector


@dataclass(frozen=True, eq=False)
class System(Memo):
    """The first-order form with its Markov parameters, and the flow of each mode.

    Attributes
    ----------
    dynamics : Dynamics
    duration : float
        That of the run in s.
    given : FirstOrderForm, optional
        The form, if not that of ``dynamics``: linearised about an instant, or with inputs beside r.
    inputs : pair of (N, nw) and (nc, nw) arrays, optional
        E and D_w with X' = A X + B r + E w, u = C X + D r + D_w w.
    """

    dynamics: Dynamics
    duration: float
    given: FirstOrderForm | None = None
    inputs: tuple[Array, Array] | None = None

    @cached_property
    def form(self) -> FirstOrderForm:
        """The first-order form."""
        return self.given or first_order_form(self.dynamics)

    @cached_property
    def input_matrices(self) -> tuple[Array, Array]:
        """E (N, nw), with rows for the states p, and D_w (nc, nw)."""
        E, Dw = self.inputs or (np.zeros((len(self.form.A), 0)), np.zeros((len(self.degree), 0)))
        return np.pad(E, ((0, len(self.remembered)), (0, 0))), Dw

    @property
    def degree(self) -> Indices:
        """ρ (nc,)."""
        return self.dynamics.relative_degree

    @cached_property
    def remembered(self) -> Indices:
        """The sliders of degree 0, whose positions p are the last states of X."""
        return np.flatnonzero(self.dynamics.of_rate & (self.degree == 0))

    @cached_property
    def fine(self) -> Fine:
        """The matrices as double-doubles, with the states p, p' = 0, and u - p in the rows of the sliders they belong to."""
        A, B, C, D, _, _ = self.form.double_doubles
        N = len(A)
        memory = len(self.remembered)
        nc = len(self.degree)
        places = np.zeros((nc, memory))
        places[self.remembered, np.arange(memory)] = -1.0
        A = stacked([[A, np.zeros((N, memory))], [np.zeros((memory, N + memory))]])
        B = stacked([[B], [np.zeros((memory, nc))]])
        C = stacked([[C, places]])
        levels = [C, C @ A]
        for _ in range(1, max(2, self.degree.max(initial=0))):
            levels.append(levels[-1] @ A)
        O = at_degree(self.degree, *levels)  # noqa: E741
        G = at_degree(self.degree, D, *(each @ B for each in levels[:-1]))
        return Fine(*(DoubleDouble(np.ascontiguousarray(each.parts)) for each in (A, B, C, D, levels[1], O, G)))

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
        return np.concatenate([self.form.state(q, v), self.dynamics.gap(0.0, q)[self.remembered]])

    def start(self, q: DoubleDouble, v: DoubleDouble) -> DoubleDouble:
        """Return `state` with its derivatives."""
        form, d = self.form, self.dynamics
        signals = DoubleDouble.of(form.signals)
        if form.signal_slopes is not None:
            signals = with_slopes(signals, form.signal_slopes)
        rows = (q, v, signals, (d.finely("H") @ q + d.finely("u0"))[self.remembered])
        length = max(len(each.parts) for each in rows)
        slopes = [
            np.concatenate([form.state(q_p, v_p)[: form.constant], s_p, u_p])
            for q_p, v_p, s_p, u_p in zip(*(DoubleDouble(lifted(each, length)).slopes.hi for each in rows), strict=True)
        ]
        return with_slopes(self.state(q.hi, v.hi), np.reshape(slopes, (length // 2 - 1, len(self.fine.A))))

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
        """C_i A^ρ_i of each row i (nc, N)."""
        return self.fine.O.hi

    @property
    def G(self) -> Array:
        """D_i, C_i B or C_i A B of each row i (nc, nc)."""
        return self.fine.G.hi

    def reaction(self, mode: Mode) -> tuple[Flow, DoubleDouble]:
        """Return the flow of a mode, and the F with r = F X."""
        return remembered(self, ("reaction", mode.key), lambda: self._reaction(mode))

    def _reaction(self, mode: Mode) -> tuple[Flow, DoubleDouble]:
        A = self.fine.A
        B = self.fine.B
        laws = {name: self.dynamics.finely(name) for name in ("r_min", "r_max", "mu")}
        length = max(len(each.parts) for each in (A, self.fine.G, *laws.values()))
        F = np.zeros((length, len(self.degree), len(A)))
        slips = mode.slips
        rubs = [i for i, _ in mode.slips if i in self.friction]
        for i, sign in (each for each in slips if each[0] not in rubs):
            F[:, i, self.form.constant] = lifted(laws["r_min" if sign > 0 else "r_max"][i], length)
        rows = list(mode.closed)
        if rows:
            O, G = self._held(mode)  # noqa: E741
            if rubs:
                G = G @ self.coupling(mode)
            terms = np.abs(O.hi) + np.abs(G.hi) @ np.abs(F[0])
            F[:, rows] = -lifted(solve_regular(G[:, rows], O + G @ DoubleDouble(F)), length)
            if self.mixed:
                cancels = np.abs(F[0, rows]) <= FINE_ZERO * (np.abs(np.linalg.inv(G.hi[:, rows])) @ terms)
                F[:2, rows] = np.where(cancels, 0.0, F[:2, rows])
        if rubs:
            F[:, rubs] = lifted(self.coupling(mode)[rubs] @ DoubleDouble(F), length)
        # Cancellation in A + B F is set to zero: balanced forces cause no motion.
        closed = round_to_zero(A + B @ DoubleDouble(F), np.abs(A.hi) + np.abs(B.hi) @ np.abs(F[0]))
        return Flow(closed, self.duration, self.mass), DoubleDouble(F)

    @cached_property
    def mass(self) -> DiagonalBlock | None:
        """The mass matrix of the massive coordinates, whose velocities are states side by side, if it is not diagonal."""
        d, E = self.dynamics, self.form.parts.massive
        M = E.T @ d.finely("M").value @ E
        diagonal = not (M.hi - np.diag(np.diag(M.hi))).any()
        return None if diagonal else DiagonalBlock(E.shape[1] + self.form.parts.damped.shape[1], M)

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
        d = self.dynamics
        # What signals alone move closes no rows of a system together, but for instants.
        H = d.H if d.stores_energy else np.where(d.driven, 0.0, d.H)
        # The equations of a system determine their own forces, whatever those of the other rows.
        G = self.G @ d.elimination
        others = ~d.switches & ~(d.bilateral & (not d.stores_energy))
        for degree in np.unique(self.degree):
            rows = np.flatnonzero((self.degree == degree) & others)
            for combination in null_space(G[np.ix_(rows, rows)], rcond=1e-12).T:
                # A combination of gaps that no motion changes is not zero (assembly saw to it): its rows never close
                # together.
                if np.abs(combination @ H[rows]).max() > 1e-9:
                    return [d.contacts[i].name for i in rows[np.abs(combination) > 1e-9]]
        return []

    @property
    def mixed(self) -> bool:
        """Whether contacts can be closed together with combinations of a higher degree than their own."""
        return bool(self.mixed_degrees)

    def together(self, rows: tuple[int, ...]) -> Together:
        """Return the constraints of jointly closed contacts."""
        return remembered(self, ("together", rows), lambda: self._together(rows))

    def _together(self, rows: tuple[int, ...]) -> Together:
        A = self.fine.A
        B = self.fine.B
        C = self.fine.C
        D = self.fine.D
        at = list(rows)
        H, parts = self.dynamics.H[at], self.form.parts
        of_system = (D.hi[np.ix_(at, at)], (C[at] @ B).hi[:, at])
        levels = (H @ parts.static, H @ parts.damped) if self.dynamics.stores_energy else of_system
        T, degree = degrees_together(levels)
        TC, TD = combined(T, C[at]), combined(T, D[at])
        TCA = rounded_product(TC, A)
        O = at_degree(degree, TC, TCA, rounded_product(TCA, A))  # noqa: E741
        G = at_degree(degree, TD, rounded_product(TC, B), rounded_product(TCA, B))
        return Together(T, degree, TC, TCA, O, G)

    @cached_property
    def lines(self) -> Array:
        """The impulse paths that lead over massless nodes (np, nc)."""
        return self.dynamics.impulse_lines if self.mixed else np.zeros((0, len(self.degree)))

    def openings(self, F: DoubleDouble) -> DoubleDouble:
        """Return C + D F (nc, N), of u = C X + D r in a mode, with cancellation set to zero."""
        C = self.fine.C
        D = self.fine.D
        return round_to_zero(C + D @ F, np.abs(C.hi) + np.abs(D.hi) @ np.abs(F.hi))

    def rates(self, mode: Mode) -> DoubleDouble:
        """Return the rows (nc, N) of the opening rates U in a mode, those of massless nodes included."""
        flow, F = self.reaction(mode)
        U = rounded_product(self.openings(F), flow.generator)
        U.parts[:, list(mode.closed)] = 0.0
        return U

    def mode(self, mode: Mode) -> tuple[Flow, Array]:
        """Return the flow of a mode, and the F with r = F X in floats."""
        flow, F = self.reaction(mode)
        return flow, F.hi

    def coordinates(self, mode: Mode) -> Coordinates:
        """Return the rows of q, v and r in terms of the state in a mode."""
        return remembered(self, ("coordinates", mode.key), lambda: self._coordinates(mode))

    def terms(self, mode: Mode) -> DoubleDouble | None:
        """Return the `Flow.terms` of the rows of q, v and r in a mode."""
        return remembered(self, ("terms", mode.key), lambda: self.mode(mode)[0].terms(self.coordinates(mode).rows))

    def _coordinates(self, mode: Mode) -> Coordinates:
        flow, F = self.reaction(mode)
        _, _, _, _, Q, Qr = self.form.double_doubles
        # The forces of springs at a stopped plate cancel.
        place = stacked([[Q, np.zeros((len(Q), len(self.remembered)))]]) + Qr @ F
        place = round_to_zero(place, np.abs(self.read[0]) + np.abs(Qr.hi) @ np.abs(F.hi))
        rows = stacked([[place], [place @ flow.generator], [F]])
        return Coordinates(rows, sparse(rows))

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
    def plant(self) -> Plant | None:
        """The system for compiled code if it is small, of contacts of one degree each, and of Newton's law; else None."""
        contacts, fine = self.dynamics.contacts, self.fine
        plain = bool(contacts) and self.dynamics.impenetrable.all() and not self.dynamics.has_other_impact_law
        if not plain or len(fine.A) > MAX_STATES or self.inputs is not None or self.mixed:
            return None
        A, B, C, CA, O, G = (  # noqa: E741
            np.ascontiguousarray(each.parts) for each in (fine.A, fine.B, fine.C, fine.CA, fine.O, fine.G)
        )
        laws = (
            np.asarray(self.degree, dtype=np.int64),
            self.dynamics.rigid,
            np.asarray(self.dynamics.restitution, dtype=np.float64),
        )
        moves = np.arange(A.shape[1]) < self.form.constant
        return Plant(A, B, C, CA, O, G, *laws, self.reach, moves, BERNSTEIN, np.zeros(0))

    @cached_property
    def names(self) -> dict[str, int]:
        """Index of each row by its name."""
        return {contact.name: i for i, contact in enumerate(self.dynamics.contacts)}

    @cached_property
    def friction(self) -> list[int]:
        """The rows with friction that a normal force bounds."""
        return list(map(int, np.flatnonzero(self.dynamics.tangential)))

    @cached_property
    def has_friction_or_joints(self) -> bool:
        """Whether any row has friction that a normal force bounds, or takes part in any impact, as a joint does."""
        return bool(self.friction) or bool(self.dynamics.permanent.any())

    @cached_property
    def laws(self) -> Laws:
        """The laws of all rows."""
        d = self.dynamics
        rows, normals, mu = self.dynamics.friction
        rank = self.degree - d.of_rate
        if not len(rows):
            same = np.eye(len(self.degree))
            return Laws(self.fine.O, self.fine.G, self.fine.G, same, same, *self.bounds, rank)
        maps = friction_maps(self.fine.G.hi.copy(), *self.bounds, FrictionRows(rows, normals, mu, GLOCKER))
        E, T = DoubleDouble.of(maps.E), DoubleDouble.of(maps.T)
        by_force = E @ self.fine.G
        rank = np.append(rank, np.zeros(len(rows), dtype=np.int64))
        weights, unit = maps.E.copy(), np.abs(np.diag(self.G))
        # μ r_N - r_T has the rounding of the rows that give r_N and r_T.
        last = len(self.degree) + np.arange(len(rows))
        weights[last, rows] = 1.0
        weights[last, normals] = 2.0 * mu * unit[rows] / unit[normals]
        return Laws(E @ self.fine.O, by_force @ T + maps.V, by_force, maps.T, weights, maps.lower, maps.upper, rank)

    def with_static_friction(self, rows: tuple[int, ...]) -> System:
        """Return the system in which the friction of some rows has the static coefficient."""
        if not rows:
            return self
        return remembered(self, ("static friction", rows), lambda: self._with_static_friction(rows))

    def _with_static_friction(self, rows: tuple[int, ...]) -> System:
        d = self.dynamics
        mu = np.where(np.isin(np.arange(len(d.mu)), rows), d.mu_s, d.mu)
        return replace(self, dynamics=replace(d, mu=mu), given=self.form)

    def coupling(self, mode: Mode) -> DoubleDouble:
        """Return T with r = T r (nc, nc): where friction slips, r_T = -μ sign(U) r_N."""
        return slip_coupling(self.dynamics, [(i, -sign) for i, sign in mode.slips if i in self.friction])

    @property
    def bounds(self) -> tuple[Array, Array]:
        """r_min and r_max (nc,)."""
        return self.dynamics.r_min, self.dynamics.r_max

    def impact_lcp(self, G: DoubleDouble, lines: Array, meeting: Indices, solver: str) -> PreparedLCP:
        """Return the prepared LCP of the impulses at the rows ``meeting`` and ``lines`` of G."""
        key = "impact", meeting.tobytes(), lines.tobytes() if len(lines) else b"", solver
        return remembered(self, key, lambda: prepare_lcp(G.hi[np.ix_(meeting, meeting)], solver))

    def path_matrices(self, lines: Array) -> tuple[DoubleDouble, DoubleDouble]:
        """Return R C A B Rᵀ and B Rᵀ, where the rows of R are the contacts, and after them the impulse paths."""
        R = np.vstack([np.eye(len(self.degree)), lines])
        A = self.fine.A
        B = self.fine.B
        C = self.fine.C
        G = rounded_product(rounded_product(rounded_product(combined(R, C), A), B), DoubleDouble.of(R.T))
        return G, rounded_product(B, DoubleDouble.of(R.T))

    @cached_property
    def O_w(self) -> Array:
        """D_w, C_i E or C_i A E of each row i (nc, nw)."""
        A, _, C = self.matrices
        E, Dw = self.input_matrices
        levels = [Dw]
        for _ in range(max(2, self.degree.max(initial=0))):
            levels.append(C @ E)
            C = C @ A
        return np.array(levels)[self.degree, np.arange(len(self.degree))]

    def input_response(self, mode: Mode) -> Array:
        """Return F_w (nc, nw) of the reactions r = F X + F_w w of a mode."""
        rows, found = list(mode.closed), np.zeros_like(self.O_w)
        if found.size:
            E, Dw = self.input_matrices
            O_w = self.O_w[rows]
            if self.mixed:
                held = self.together(mode.closed)
                levels = np.array([held.T @ Dw[rows], held.C.hi @ E, held.CA.hi @ E])
                O_w = levels[held.degree, np.arange(len(rows))]
            T = self.coupling(mode).hi
            G = self._held(mode)[1]
            found[rows] = -solve_regular((G @ T if self.friction else G)[:, rows], DoubleDouble.of(O_w)).hi
            found = T @ found
        return found

    def ends(self, mode: Mode) -> tuple[Indices, Indices, DoubleDouble]:
        """Return the event functions of a mode: for each the row of H, its side, and the row c of c·(X, w).

        The side is that of the bound of a slider that sticks or a relay that slides, and 0 for all others; without inputs it
        is c·X.
        """
        return remembered(self, ("ends", mode.key), lambda: self._ends(mode))

    def _ends(self, mode: Mode) -> tuple[Indices, Indices, DoubleDouble]:
        flow, F = self.reaction(mode)
        Fw = self.input_response(mode)
        E, Dw = self.input_matrices
        D, B = self.fine.D, self.matrices[1]
        gap = self.openings(F)
        # A slider that slips has degree 1 or 2, or no input acts on it: then u' holds no rate of an input.
        U = stacked([[gap @ flow.generator, gap @ (E + B @ Fw)]])
        u = stacked([[gap, Dw + D @ Fw]])
        r = stacked([[F, Fw]])
        d = self.dynamics
        constant = np.zeros(u.shape[1])
        constant[self.form.constant] = 1.0
        slips, found = dict(mode.slips), list[tuple[int, int, DoubleDouble]]()
        for i, contact in enumerate(d.contacts):
            if contact.impenetrable:
                found.append((i, 0, r[i] if i in mode.closed else u[i]))
            elif i in slips:
                found.append((i, 0, (U if contact.law.of_rate else u)[i] * float(slips[i])))
            elif contact.law.tangential and i in mode.closed:
                bound = r[contact.normal] * d.finely("mu_s")[i]
                found += [(i, side, bound - r[i] * float(side)) for side in (1, -1)]
            elif not contact.law.tangential:
                for side, limit in ((1, d.finely("r_max")[i]), (-1, d.finely("r_min")[i])):
                    if math.isfinite(float(limit.hi)):
                        found.append((i, side, (limit * constant - r[i]) * float(side)))
        blocks: list[list[ArrayLike | DoubleDouble]] = [[row[None]] for _, _, row in found]
        return (
            np.array([i for i, _, _ in found], dtype=np.int64),
            np.array([side for _, side, _ in found], dtype=np.int64),
            stacked([[np.zeros((0, len(constant)))], *blocks]),
        )

    def watch(self, mode: Mode) -> Watch:
        """Return the event functions of a mode, and its zeros."""
        return remembered(self, ("watch", mode), lambda: self._watch(mode))

    def _watch(self, mode: Mode) -> Watch:
        contacts, side, rows = self.ends(mode)
        order = np.array(mode.order, dtype=np.int64)[contacts]
        rubs = np.isin(contacts, self.friction)
        if rubs.any():
            order = np.where(rubs & (side < 0), np.array(mode.other_order, dtype=np.int64)[contacts], order)
        kept = np.flatnonzero(order >= 0)
        order = np.where((side != 0) & ~rubs & (side != np.array(mode.side, dtype=np.int64)[contacts]), 0, order)
        nc = len(self.degree)
        closed = np.isin(np.arange(nc), mode.closed)
        held = closed | ((np.array(mode.order, dtype=np.int64) < 0) & ~self.dynamics.of_rate)
        still = Still(held & ~self.dynamics.of_rate & (self.degree > 0), held & (self.degree >= 2), closed)
        return Watch(contacts[kept], rows[kept], sparse(rows[kept]), order[kept], still)


def system_of(dynamics: Dynamics, duration: float) -> System:
    """Return the system of a run, with all modes known so far if the last run of these dynamics was as long."""
    known: System | None = dynamics.memo.get(System)
    if known is None or known.duration != duration:
        known = dynamics.memo[System] = System(dynamics, duration)
    return known


def slip_coupling(dynamics: Dynamics, slips: Iterable[tuple[int, float]]) -> DoubleDouble:
    """Return T with r = T r (nc, nc), r_T = ± μ r_N, for rows of friction with the sign of their forces."""
    mu = dynamics.finely("mu")
    parts = lifted(np.eye(len(mu)), len(mu.parts)).copy()
    for i, sign in slips:
        parts[:, i] = 0.0
        parts[:, i, dynamics.normals[i]] = sign * mu.parts[:, i]
    return DoubleDouble(parts)


def at_degree(degree: Indices, *levels: DoubleDouble) -> DoubleDouble:
    """Return the matrix whose row i is row i of the level ``degree[i]``."""
    length = max(len(level.parts) for level in levels)
    parts = np.stack([lifted(level, length) for level in levels], 1)
    return DoubleDouble(np.ascontiguousarray(parts[:, degree, np.arange(len(degree))]))


def solve_regular(G: DoubleDouble, right: DoubleDouble) -> DoubleDouble:
    """Solve with a block of G; where it is singular, the contact forces are not uniquely determined."""
    if is_singular(G.hi):
        raise np.linalg.LinAlgError
    return solve_finely(G, right)


def round_to_zero(found: DoubleDouble, terms: Array, zero: float = FINE_ZERO) -> DoubleDouble:
    """Set numbers to zero that are within the rounding of the ``terms`` of their sums, and return all."""
    found.parts[:2, np.abs(found.hi) <= zero * terms] = 0.0
    return found


def rounded_product(a: DoubleDouble, b: DoubleDouble) -> DoubleDouble:
    """Return a b, with cancellation set to zero."""
    return round_to_zero(a @ b, np.abs(a.hi) @ np.abs(b.hi))


def combined(T: Array, b: DoubleDouble) -> DoubleDouble:
    """Return T b, with cancellation set to zero."""
    return rounded_product(DoubleDouble.of(T), b)


def refuse_mixed_degrees(system: System, method: str, except_contacts: bool = False) -> None:
    """Refuse contacts without a common relative degree; with ``except_contacts`` only beside rows of another law."""
    names, d = system.mixed_degrees, system.dynamics
    others = (
        ((d.of_rate & ~d.tangential).any(), "sliders"),
        (d.switches.any(), "relays"),
        (system.friction, "friction"),
        (d.bilateral.any(), "joints" if d.stores_energy else "equations"),
    )
    beside = next((f" beside {what}" for present, what in others if present), "") if except_contacts else ""
    prescribed = [name for name in names if not system.G[system.names[name]].any()]
    if not names or (except_contacts and not beside and (d.stores_energy or not prescribed)):
        return
    able = ("moreau-jean", "radau") if except_contacts else ("exact", "moreau-jean", "radau")
    if prescribed:
        raise UnsupportedError(
            f"no force changes the rate of {prescribed[0]!r}, which prescribed motions alone determine, and {method!r} does "
            "not handle that: ",
            able,
        )
    raise UnsupportedError(
        f"the contacts {', '.join(map(repr, names))} have no common relative degree when all are closed, and {method!r} "
        f"does not handle that{beside}: ",
        able,
    )
