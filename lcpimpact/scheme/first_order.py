r"""The first-order form of a system, without algebraic coordinates.

.. math:: X' = A X + B r, \qquad u = C X + D r

The massless coordinates are eliminated: those with a dashpot by their first-order equation, those with springs only by
their balance of forces, and those whose motion is given by that motion. Constant and harmonic signals become states of
their own (1, and a cosine with its sine), and so do a piecewise polynomial and its derivatives, each the rate of the one
before. So the system is homogeneous and its solution in each contact mode is a matrix exponential; at a breakpoint only the
states of the signals change, to the right limits there. A sampled force is a constant state, which is set anew at each of
its instants.

Forces that are no such signals, those of non-linear springs, general forces, and loads that are other functions of time, are
inputs beside the reactions: X' = A X + B r + E w; see `forced_form`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag

from lcpimpact.arrays import Array, Flags
from lcpimpact.errors import UnsupportedError
from lcpimpact.numerics.double_double import DoubleDouble, lifted, stacked, with_slopes
from lcpimpact.numerics.elimination import solve_finely
from lcpimpact.scheme.decomposition import Decomposition
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.force_law import ForceLaw, forces, tangents
from lcpimpact.scheme.held_force import HeldForce
from lcpimpact.scheme.signals import SIGNAL_NAMES, Described, Harmonic, PiecewisePolynomial, TimeFunction, terms_of


@dataclass(frozen=True)
class FirstOrderForm:
    """X' = A X + B r, u = C X + D r, q = Q X + Qr r.

    Attributes
    ----------
    A : (N, N), B : (N, nc), C : (nc, N), D : (nc, nc) arrays
        The system; X = (q_m, q_d, v_m, 1, signal states).
    Q : (n, N), Qr : (n, nc) arrays
        How the coordinates of the scheme are read off.
    parts : Decomposition
        The coordinates with mass, damped, static and driven.
    signals : (N - 2 nm - nd,) array
        The states of the signals at t = 0: 1; a cosine and a sine for each harmonic; the value and the derivatives, right
        limits, of each piecewise polynomial; and 0 for each node of a sampled force.
    sources : tuple
        The signals that these states are of, after the first.
    holds : tuple of HeldForce
        The sampled forces, whose states follow.
    rest : tuple of (1 + 2 p, ...) arrays, optional
        What rounding has left out of A, B, C, D, Q and Qr, nothing where they were given as floats; and their derivatives by
        p parameters, as in `DoubleDouble.parts`.
    signal_slopes : (p, N - 2 nm - nd) array, optional
        The derivatives of ``signals``.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    Q: Array
    Qr: Array
    parts: Decomposition
    signals: Array
    sources: tuple[Harmonic | PiecewisePolynomial, ...] = ()
    holds: tuple[HeldForce, ...] = ()
    rest: tuple[Array, ...] | None = None
    signal_slopes: Array | None = None

    @property
    def double_doubles(self) -> tuple[DoubleDouble, ...]:
        """A, B, C, D, Q and Qr as double-doubles."""
        high = (self.A, self.B, self.C, self.D, self.Q, self.Qr)
        rest = self.rest or tuple(np.zeros((1, *each.shape)) for each in high)
        return tuple(DoubleDouble(np.concatenate([a[None], b])) for a, b in zip(high, rest, strict=True))

    @property
    def constant(self) -> int:
        """The position in X of the state that is 1."""
        return len(self.A) - len(self.signals)

    @property
    def piecewise(self) -> Flags:
        """Which states are those of piecewise polynomials (N,)."""
        sizes = [2 if isinstance(each, Harmonic) else each.degree + 1 for each in self.sources]
        kinds = [isinstance(each, PiecewisePolynomial) for each in self.sources]
        found = np.zeros(len(self.A), dtype=np.bool_)
        found[self.constant + 1 : self.constant + 1 + sum(sizes)] = np.repeat(kinds, sizes)
        return found

    def signals_at(self, t: Array) -> Array:
        """Return the states of the signals at the times t, right limits, with the shape of t followed by (nl,)."""
        return _states_at(self.sources, np.asarray(t, dtype=np.float64))

    def signals_finely(self, t: float) -> DoubleDouble:
        """Return `signals_at` one time, with the derivatives of the harmonics."""
        value, A_p = self.signals_at(np.array(t)), self.double_doubles[0].slopes.hi
        starts = np.zeros((len(A_p), len(self.signals))) if self.signal_slopes is None else self.signal_slopes
        slopes, at = np.zeros((len(A_p), len(value))), 1
        for signal in self.sources:
            if isinstance(signal, Harmonic):
                ω_p = A_p[:, self.constant + at + 1, self.constant + at]
                φ_p = self.signals[at] * starts[:, at + 1] - self.signals[at + 1] * starts[:, at]
                turn = ω_p * t + φ_p
                slopes[:, at], slopes[:, at + 1] = -value[at + 1] * turn, value[at] * turn
            at += 2 if isinstance(signal, Harmonic) else signal.degree + 1
        return with_slopes(value, slopes)

    @property
    def signal_sizes(self) -> Array:
        """Sizes of the states of the signals at the start: the amplitude 1 of a harmonic (nl,)."""
        sizes = [2 * [1.0] if isinstance(each, Harmonic) else np.abs(each.derivatives(0.0)) for each in self.sources]
        return np.concatenate([[1.0], *sizes])

    def breakpoints(self, start: float, end: float) -> Array:
        """Return the instants start < t <= end at which the states of the signals may jump, in their order."""
        pieces = [each.breakpoints(start, end) for each in self.sources if isinstance(each, PiecewisePolynomial)]
        pieces += [held.breakpoints(start, end) for held in self.holds]
        return np.unique(np.concatenate(pieces)) if pieces else np.zeros(0)

    def right_of(self, t: float, X: ArrayLike | DoubleDouble, scale: Array) -> DoubleDouble:
        """Return the state X at t, or a longer one that begins so, with the right limits of the piecewise polynomials.

        In ``scale``, the scale of rounding, they replace the old values: a past steep piece causes no rounding.
        """
        parts, at = DoubleDouble.of(X).parts.copy(), self.constant + 1
        for signal in self.sources:
            states = 2 if isinstance(signal, Harmonic) else signal.degree + 1
            if isinstance(signal, PiecewisePolynomial):
                parts[0, at : at + states] = signal.derivatives(t)
                parts[1, at : at + states] = 0.0
                scale[at : at + states] = np.abs(parts[0, at : at + states])
            at += states
        return DoubleDouble(parts)

    def sampled(self, t: float, X: DoubleDouble, scale: Array) -> DoubleDouble:
        """Return the state X behind the impacts at t with the sampled forces that are set there, as in `right_of`."""
        if not any(held.sets_at(t) for held in self.holds):
            return X
        parts, known = X.parts.copy(), X.hi[: len(self.A)]
        place = self.Q @ known
        speed = self.Q @ (self.A @ known)
        first = self.constant + len(_states_at(self.sources, np.array(t)))
        for held in self.holds:
            at, here = list(held.at), slice(first, first + len(held.at))
            if held.sets_at(t):
                parts[0, here] = held(t, place[at], speed[at])
                parts[1, here] = 0.0
                scale[here] = np.abs(parts[0, here])
            first = here.stop
        return DoubleDouble(parts)

    @cached_property
    def basis(self) -> Array:
        """The coordinates by kinds (n, n): unit vectors, except for the static groups, which move with their first node."""
        parts = self.parts
        return np.column_stack([parts.massive, parts.damped, parts.static, parts.driven])

    def state(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Return X at t = 0 for the coordinates q and velocities v of the scheme (n,); static ones are not states."""
        q = np.asarray(q, dtype=np.float64)
        v = np.asarray(v, dtype=np.float64)
        parts = self.parts
        coordinates = np.linalg.solve(self.basis, q)
        dynamic = parts.massive.shape[1] + parts.damped.shape[1]
        return np.concatenate([coordinates[:dynamic], parts.massive.T @ v, self.signals])


def first_order_form(dynamics: Dynamics) -> FirstOrderForm:
    """Eliminate the massless coordinates of a system.

    Parameters
    ----------
    dynamics : Dynamics
        The system; its springs must be linear, and its loads and prescribed motions constant or described signals.

    Raises
    ------
    UnsupportedError
        If a load or a motion is another function of time.
    """
    parts = dynamics.decomposition
    Em = parts.massive
    Ed = parts.damped
    Es = parts.static
    Ep = parts.driven
    nm, nd = Em.shape[1], Ed.shape[1]
    states = signal_states(dynamics)
    f, y, generator, signals = (
        with_slopes(value, dynamics.slopes[name]) if name in dynamics.slopes else DoubleDouble.of(value)
        for name, value in (("F", states.F), ("Y", states.Y), ("G", states.G), ("s", states.start()))
    )
    mass, C, K, H, input_ = map(dynamics.finely, ("M", "C", "K", "H", "B"))

    # Every quantity is a row block against (q_m, q_d, v_m, signals) and a block against r.
    zero = np.zeros
    nl = len(signals)
    M = Em.T @ mass @ Em
    to_state = stacked([[Em, Ed, zero((len(Em), nm)), Ep @ y]])
    load = stacked([[zero((len(f), nm + nd + nm)), f]])

    # Static: K_ss q_s = f_s + B_s r - K_sm q_m - K_sd q_d - K_sp y.
    K_ss = Es.T @ K @ Es
    Qs = solve_finely(K_ss, Es.T @ (load - K @ to_state))
    Qsr = solve_finely(K_ss, Es.T @ input_)
    Q = to_state + Es @ Qs
    Qr = Es @ Qsr

    # Damped: C_dd q_d' = f_d + B_d r - K_d q - C_dm v_m - C_dp y'.
    v_m = np.column_stack([zero((nm, nm + nd)), np.eye(nm), zero((nm, nl))])
    known = stacked([[zero((len(Em), nm + nd + nm)), Ep @ y @ generator]]) + Em @ v_m
    C_dd = Ed.T @ C @ Ed
    Vd = solve_finely(C_dd, Ed.T @ (load - K @ Q - C @ known))
    Vdr = solve_finely(C_dd, Ed.T @ (input_ - K @ Qr))

    # Massive: M v_m' = f_m + B_m r - K_m q - C_m q'.
    rate, rate_r = known + Ed @ Vd, Ed @ Vdr
    Am = solve_finely(M, Em.T @ (load - K @ Q - C @ rate))
    Amr = solve_finely(M, Em.T @ (input_ - K @ Qr - C @ rate_r))

    opening = stacked([[zero((len(H), 2 * nm + nd)), dynamics.finely("u0")[:, None], zero((len(H), nl - 1))]])
    found = (
        stacked([[v_m], [Vd], [Am], [stacked([[zero((nl, nm + nd + nm)), generator]])]]),
        stacked([[zero((nm, input_.shape[1]))], [Vdr], [Amr], [zero((nl, input_.shape[1]))]]),
        H @ Q + opening,
        H @ Qr + dynamics.finely("D"),
        Q,
        Qr,
    )
    matrices = dict(zip(("A", "B", "C", "D", "Q", "Qr"), (each.hi for each in found), strict=True))
    length = max(len(each.parts) for each in (*found, signals))
    rest = tuple(lifted(each, length)[1:] for each in found)
    more = lifted(signals, length)[2 : 2 + (length - 2) // 2] if length > 2 else None
    return FirstOrderForm(
        **matrices,
        parts=parts,
        signals=signals.hi,
        sources=states.sources,
        holds=dynamics.holds,
        rest=rest,
        signal_slopes=more,
    )


@dataclass(frozen=True, eq=False)
class Inputs:
    """The forces w beside the reactions: X' = A X + B r + E w, u = C X + D r + D_w w, q = Q X + Qr r + Q_w w.

    w holds the forces of the non-linear springs, s(δ, δ') with δ = approach·X and δ' = rate·X, after them
    those of the non-linear dashpots, c_* v - F(v) with the rates v = parting X + w_parting w + r_parting r, the general
    forces, f(t, place X, speed X), and then the loads that are functions of time. A massless node moves by the linear
    dashpot c_* (see `lcpimpact.scheme.dynamics.Dynamics.substitutes`), so that its rate depends on w and r.

    Attributes
    ----------
    E : (N, nw), D : (nc, nw), Q : (n, nw) arrays
        How the forces enter.
    approach, rate : (ns, N) arrays
        Rows that give δ and δ' from the state; the rate is zero for a spring without loss.
    law : (ns, 9) array
        The row of `lcpimpact.scheme.power_law` of each spring; the gap is already included in ``approach``.
    rate_laws : (nd, nr) array
        Numbers of the dashpots, of `lcpimpact.scheme.rate_law`, that of c_* with the sign minus.
    parting, w_parting, r_parting : (nd, N), (nd, nw), (nd, nc) arrays
        How the rates of the dashpots follow from the state, the forces and the reactions.
    place, speed : (ng, N) arrays
        Rows that read q and v of the nodes of the general forces off the state.
    force_laws : tuple of ForceLaw
        The general forces.
    loads : tuple of callable
        Functions of time.
    """

    E: Array
    D: Array
    Q: Array
    approach: Array
    rate: Array
    law: Array
    rate_laws: Array
    parting: Array
    w_parting: Array
    r_parting: Array
    place: Array
    speed: Array
    force_laws: tuple[ForceLaw, ...]
    loads: tuple[TimeFunction, ...]

    @property
    def elastic_law(self) -> Array:
        """The law without damping (ns, 9)."""
        return np.asarray(self.law * np.repeat([1.0, 0.0, 1.0], [3, 2, 4]))

    @property
    def count(self) -> int:
        """Number of forces."""
        return int(self.E.shape[1])

    @property
    def of_state(self) -> int:
        """Number of forces that depend on the state: all but the loads (ns + nd + ng)."""
        return self.given + len(self.place)

    @property
    def given(self) -> int:
        """Number of forces of springs and dashpots, which elements give and no function of the user (ns + nd)."""
        return len(self.law) + len(self.rate_laws)

    @property
    def of_dashpots(self) -> slice:
        """The positions of the forces of the dashpots."""
        return slice(len(self.law), self.given)

    def motion_forces(self, t: float, X: Array) -> Array:
        """Return the general forces at the state X (ng,)."""
        X = X[: self.place.shape[1]]
        return forces(self.force_laws, t, self.place @ X, self.speed @ X)

    def motion_tangents(self, t: float, X: Array) -> tuple[Array, Array]:
        """Return the derivatives of the general forces at the state X by q and v of their nodes (ng, ng)."""
        X = X[: self.place.shape[1]]
        return tangents(self.force_laws, t, self.place @ X, self.speed @ X)


def forced_form(dynamics: Dynamics, method: str) -> tuple[FirstOrderForm, Inputs]:
    """Eliminate the massless coordinates of a system whose springs need not be linear, nor its loads described signals.

    Parameters
    ----------
    dynamics : Dynamics
        The system; prescribed motion must be described signals.
    method : str
        The method, for messages.

    Raises
    ------
    UnsupportedError
        If a non-linear spring acts on a quasi-static node, where its force would be the solution of an equation; if a motion
        comes to rest infinitely fast on a non-linear dashpot; if a spring with loss, or a general force, acts on a massless
        node, whose velocity depends on it; or if a prescribed motion is another function of time.
    """
    d = dynamics
    n = len(dynamics.nodes)
    nc = len(dynamics.contacts)
    parts = d.decomposition
    for spring, direction in zip(d.springs, d.directions, strict=True):
        for basis, where, hinders in (
            (parts.static, "quasi-static (held by springs only)", True),
            (parts.damped, "massless, and it has a loss", spring.lossy),
        ):
            moved = (direction @ basis != 0.0) & hinders
            if moved.any():
                node = d.nodes[int(np.flatnonzero(basis[:, int(np.argmax(moved))])[0])]
                raise UnsupportedError(
                    f"{spring.element} stands at the node {node!r}, which is {where}; {method!r} does not handle that: "
                    "give the node a mass, or ",
                    ("moreau-jean",),
                )
    _refuse_stiff_dashpots(d, method)
    for law in d.force_laws:
        if massless := [node for node in law.nodes if parts.damped[d.nodes.index(node)].any()]:
            raise UnsupportedError(
                f"{law.element} stands at the node {massless[0]!r}, which is massless, so that its velocity depends on the "
                f"force; {method!r} does not handle that: give the node a mass, or ",
                ("moreau-jean",),
            )
    signals = tuple((i, f) for i, f in d.loads if not callable(f) or isinstance(f, Described))
    others = [(i, f) for i, f in d.loads if callable(f) and not isinstance(f, Described)]
    unit = np.eye(n)[:, [i for i, _ in others]]
    added = np.column_stack([d.pushes.T, unit])
    widened = replace(
        d,
        loads=signals,
        C=d.substitute_damping,
        B=np.column_stack([d.B, added]),
        D=np.column_stack([d.D, np.zeros((nc, added.shape[1]))]),
    )
    form = first_order_form(widened)
    reactions, acting = slice(0, nc), slice(nc, None)
    approach = -d.directions @ form.Q
    approach[:, form.constant] -= d.power_laws[:, 0]
    rate = np.where(d.power_laws[:, 3:5].sum(axis=1, keepdims=True) > 0.0, approach @ form.A, 0.0)
    place = form.Q[d.acted_on]
    ends = d.rate_directions @ form.Q
    rate_laws = d.rate_laws.copy()
    rate_laws[:, 7:8] = -d.substitutes[:, None]
    inputs = Inputs(
        E=form.B[:, acting], D=form.D[:, acting], Q=form.Qr[:, acting], approach=approach, rate=rate, law=d.power_laws,
        rate_laws=rate_laws, parting=ends @ form.A, w_parting=ends @ form.B[:, acting],
        r_parting=ends @ form.B[:, reactions],
        place=place, speed=place @ form.A, force_laws=d.force_laws, loads=tuple(f for _, f in others),
    )  # fmt: skip
    assert form.rest is not None
    A, B, C, D, Q, Qr = form.rest
    rest = (A, B[..., reactions], C, D[..., reactions], Q, Qr[..., reactions])
    form = replace(form, B=form.B[:, reactions], D=form.D[:, reactions], Qr=form.Qr[:, reactions], rest=rest)
    return form, inputs


def _refuse_stiff_dashpots(d: Dynamics, method: str) -> None:
    """Refuse non-linear dashpots at which a motion comes to rest infinitely fast.

    They are those of the slope zero that alone damp a massless node, and those of an infinite slope on which masses act, by
    themselves or by a contact of relative degree 1.
    """
    light = d.decomposition.damped.any(axis=1)
    struck = (d.H[d.relative_degree == 1] != 0.0).any(axis=0)
    for law, ends in zip(d.dashpots, d.rate_directions != 0.0, strict=True):
        n = law.numbers[2]
        node = d.nodes[int(np.argmax(ends & light if n > 1.0 else ends))]
        if n > 1.0 and (ends & light & (np.diag(d.C) == 0.0)).any():
            why = f"whose slope is zero at rest, alone damps the node {node!r}, which has no mass"
            remedy = "put a Dashpot beside it, give the node a mass"
        elif 0.0 < n < 1.0 and (not (ends & light).any() or (ends & light & struck).any()):
            why = f"whose slope is infinite at rest, stops the motion of {node!r} within a time"
            remedy = "take n = 1 or more"
        else:
            continue
        raise UnsupportedError(
            f"{law.element}, {why}: it comes to rest infinitely fast, which {method!r} does not handle: {remedy}, or ",
            ("moreau-jean",),
        )


class SignalStates(NamedTuple):
    """The states s of the signals, with f(t) = F s, y(t) = Y s and s' = G s.

    They are 1, the states of each signal, of which equal ones have common states, and those of sampled forces.

    Attributes
    ----------
    F : (n, nl), Y : (nd, nl), G : (nl, nl) arrays
    sources : tuple of signals
    """

    F: Array
    Y: Array
    G: Array
    sources: tuple[Harmonic | PiecewisePolynomial, ...]

    def start(self) -> Array:
        """Return s at t = 0, with sampled forces that are not set yet."""
        found = _states_at(self.sources, np.array(0.0))
        return np.append(found, np.zeros(len(self.G) - len(found)))


def signal_states(dynamics: Dynamics, kind: type = float) -> SignalStates:
    """Return the states of the signals, or with ``kind=object`` their formulas.

    Raises
    ------
    UnsupportedError
        If a load or a motion is another function of time.
    """
    n, driven = len(dynamics.nodes), sorted(dynamics.motions)
    constant: Array = np.zeros(n + len(driven), dtype=kind)
    places: dict[Harmonic | PiecewisePolynomial, list[int]] = {}
    motions = [(n + k, term) for k, i in enumerate(driven) for term in terms_of(dynamics.motions[i])]
    for i, signal in [*dynamics.loads, *motions]:
        if isinstance(signal, Harmonic | PiecewisePolynomial):
            places.setdefault(signal, []).append(i)
        elif callable(signal):
            what, node = ("load on", i) if i < n else ("motion of", driven[i - n])
            raise UnsupportedError(
                f"the {what} {dynamics.nodes[node]!r} is a function of time, which has no exact solution here: "
                f"give it as {SIGNAL_NAMES}, or ",
                ("moreau-jean",),
            )
        else:
            constant[i] = constant[i] + signal
    columns: list[Array] = [constant]
    generators: list[Array] = [np.zeros((1, 1), dtype=kind)]
    for signal, at in places.items():
        generator: Array
        if isinstance(signal, Harmonic):
            amplitude = signal.amplitude
            generator = np.array([[0.0, -signal.omega], [signal.omega, 0.0]], dtype=kind)
        else:
            amplitude, generator = 1.0, np.eye(signal.degree + 1, k=1)
        value = np.zeros_like(constant)
        np.add.at(value, at, amplitude)
        columns += [value, *np.zeros((len(generator) - 1, len(constant)))]
        generators.append(generator)
    for i in dynamics.held_at:
        columns.append(np.eye(len(constant))[i])
        generators.append(np.zeros((1, 1)))
    found = np.column_stack(columns)
    return SignalStates(found[:n], found[n:], block_diag(*generators), tuple(places))


def _states_at(sources: tuple[Harmonic | PiecewisePolynomial, ...], t: Array) -> Array:
    """Return 1 and the states of the signals at the times t, right limits, with the shape of t followed by (nl,)."""
    states = [np.ones((*t.shape, 1))]
    for signal in sources:
        if isinstance(signal, Harmonic):
            angle = signal.omega * t + signal.phase
            states.append(np.stack([np.cos(angle), np.sin(angle)], axis=-1))
        else:
            states.append(signal.derivatives(t))
    return np.concatenate(states, axis=-1)
