r"""The first-order form of a system, whose state holds no algebraic coordinate.

.. math:: X' = A X + B r, \qquad u = C X + D r

The massless coordinates are eliminated: those with a dashpot by their first-order equation, those with springs only by
their balance of forces, and those whose motion is given by that motion. Constant and harmonic signals become states of
their own (1, and a cosine with its sine), so the system is homogeneous and its solution in each contact mode is a matrix
exponential.

Forces that are no such signals, those of non-linear springs and loads that are other functions of time, are inputs beside
the reactions: X' = A X + B r + E w; see `forced_form`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag

from lcpimpact.arrays import Array
from lcpimpact.errors import UnsupportedError
from lcpimpact.scheme.decomposition import Decomposition, decompose
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.signals import Harmonic


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
        The states of the signals at t = 0: 1, and a cosine and a sine for each harmonic.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    Q: Array
    Qr: Array
    parts: Decomposition
    signals: Array

    @property
    def constant(self) -> int:
        """The position in X of the state that is 1."""
        return len(self.A) - len(self.signals)

    def signals_at(self, t: Array) -> Array:
        """Return the states of the signals at the times t, with the shape of t followed by (nl,)."""
        found = np.empty((*np.shape(t), len(self.signals)))
        found[..., 0] = 1.0
        for j in range(1, len(self.signals), 2):
            ω, (cos, sin) = self.A[self.constant + j + 1, self.constant + j], self.signals[j : j + 2]
            found[..., j] = cos * np.cos(ω * t) - sin * np.sin(ω * t)
            found[..., j + 1] = cos * np.sin(ω * t) + sin * np.cos(ω * t)
        return found

    def state(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Return X at t = 0 for the coordinates q and velocities v of the scheme (n,); static ones are not states.

        The basis is made of unit vectors but for the static groups, which shift with their first node.
        """
        q, v = np.asarray(q, dtype=np.float64), np.asarray(v, dtype=np.float64)
        parts = self.parts
        basis = np.column_stack([parts.massive, parts.damped, parts.static, parts.driven])
        coordinates = np.linalg.solve(basis, q)
        dynamic = parts.massive.shape[1] + parts.damped.shape[1]
        return np.concatenate([coordinates[:dynamic], parts.massive.T @ v, self.signals])


def first_order_form(dynamics: Dynamics) -> FirstOrderForm:
    """Eliminate the massless coordinates of a system.

    Parameters
    ----------
    dynamics : Dynamics
        The system; its springs must be linear, and its loads and given motions constant or `Harmonic`.

    Raises
    ------
    UnsupportedError
        If a load or a motion is another function of time.
    """
    parts = decompose(dynamics.M, dynamics.C, dynamics.driven)
    Em, Ed, Es, Ep = parts.massive, parts.damped, parts.static, parts.driven
    nm, nd = Em.shape[1], Ed.shape[1]
    f, y, generator, signals = _signal_states(dynamics)
    H, input_, K, C = dynamics.H, dynamics.B, dynamics.K, dynamics.C

    # Every quantity is a row block against (q_m, q_d, v_m, signals) and a block against r.
    zero = np.zeros
    nl = len(signals)
    M = Em.T @ dynamics.M @ Em
    to_state = np.column_stack([Em, Ed, zero((len(H.T), nm)), Ep @ y])
    load = np.column_stack([zero((len(f), nm + nd + nm)), f])

    # Static: K_ss q_s = f_s + B_s r - K_sm q_m - K_sd q_d - K_sp y.
    K_ss = Es.T @ K @ Es
    Qs = _solve(K_ss, Es.T @ (load - K @ to_state))
    Qsr = _solve(K_ss, Es.T @ input_)
    Q = to_state + Es @ Qs
    Qr = Es @ Qsr

    # Damped: C_dd q_d' = f_d + B_d r - K_d q - C_dm v_m - C_dp y'.
    v_m = np.column_stack([zero((nm, nm + nd)), np.eye(nm), zero((nm, nl))])
    known = Em @ v_m + np.column_stack([zero((len(H.T), nm + nd + nm)), Ep @ y @ generator])
    C_dd = Ed.T @ C @ Ed
    Vd = _solve(C_dd, Ed.T @ (load - K @ Q - C @ known))
    Vdr = _solve(C_dd, Ed.T @ (input_ - K @ Qr))

    # Massive: M v_m' = f_m + B_m r - K_m q - C_m q'.
    rate, rate_r = known + Ed @ Vd, Ed @ Vdr
    Am = _solve(M, Em.T @ (load - K @ Q - C @ rate))
    Amr = _solve(M, Em.T @ (input_ - K @ Qr - C @ rate_r))

    A = np.vstack([v_m, Vd, Am, np.column_stack([zero((nl, nm + nd + nm)), generator])])
    B = np.vstack([zero((nm, input_.shape[1])), Vdr, Amr, zero((nl, input_.shape[1]))])
    output = H @ Q
    output[:, 2 * nm + nd] += dynamics.u0
    return FirstOrderForm(A, B, output, H @ Qr + dynamics.D, Q, Qr, parts, signals)


@dataclass(frozen=True, eq=False)
class Inputs:
    """The forces w beside the reactions: X' = A X + B r + E w, u = C X + D r + D_w w, q = Q X + Qr r + Q_w w.

    w holds the forces of the non-linear springs, s = K δⁿ (1 + b δ') + c δ' with δ = approach·X and δ' = rate·X, and after
    them the loads that are functions of time.

    Attributes
    ----------
    E : (N, nw), D : (nc, nw), Q : (n, nw) arrays
        How the forces enter.
    approach, rate : (ns, N) arrays
        Rows that read δ and δ' off the state; the rate is zero where there is no loss.
    law : (ns, 5) array
        Gap, K, n, b and c of each spring; the gap stands in ``approach`` already.
    loads : tuple of callable
        Functions of time.
    """

    E: Array
    D: Array
    Q: Array
    approach: Array
    rate: Array
    law: Array
    loads: tuple[Callable[[float], float], ...]

    @property
    def count(self) -> int:
        """How many forces there are."""
        return int(self.E.shape[1])


def forced_form(dynamics: Dynamics, method: str) -> tuple[FirstOrderForm, Inputs]:
    """Eliminate the massless coordinates of a system whose springs need not be linear, nor its loads harmonic.

    Parameters
    ----------
    dynamics : Dynamics
        The system; motions that are given must be constant or `Harmonic`.
    method : str
        Who asks, for messages.

    Raises
    ------
    UnsupportedError
        If a non-linear spring stands at a node that only springs hold, where its force would be the solution of an
        equation; if one with loss stands at a node without mass, whose velocity its force is part of; or if a motion that
        is given is another function of time.
    """
    d, n, nc = dynamics, len(dynamics.nodes), len(dynamics.contacts)
    parts = decompose(d.M, d.C, d.driven)
    for spring, direction in zip(d.springs, d.directions, strict=True):
        for basis, where, hinders in (
            (parts.static, "held by springs only", True),
            (parts.damped, "without mass, and it has a loss", spring.b + spring.c > 0.0),
        ):
            moved = (direction @ basis != 0.0) & hinders
            if moved.any():
                node = d.nodes[int(np.flatnonzero(basis[:, int(np.argmax(moved))])[0])]
                raise UnsupportedError(
                    f"{spring.element} stands at the node {node!r}, which is {where}; {method!r} does not handle that: "
                    "give the node a mass, or take method='moreau-jean'"
                )
    signals = tuple((i, f) for i, f in d.loads if not callable(f) or isinstance(f, Harmonic))
    others = [(i, f) for i, f in d.loads if callable(f) and not isinstance(f, Harmonic)]
    unit = np.eye(n)[:, [i for i, _ in others]]
    added = np.column_stack([d.directions.T, unit])
    widened = replace(
        d, loads=signals, B=np.column_stack([d.B, added]), D=np.column_stack([d.D, np.zeros((nc, added.shape[1]))])
    )
    form = first_order_form(widened)
    reactions, forces = slice(0, nc), slice(nc, None)
    approach = -d.directions @ form.Q
    approach[:, form.constant] -= d.power_laws[:, 0]
    rate = np.where(d.power_laws[:, 3:].sum(axis=1, keepdims=True) > 0.0, approach @ form.A, 0.0)
    inputs = Inputs(
        form.B[:, forces], form.D[:, forces], form.Qr[:, forces], approach, rate, d.power_laws,
        tuple(f for _, f in others),
    )  # fmt: skip
    form = replace(form, B=form.B[:, reactions], D=form.D[:, reactions], Qr=form.Qr[:, reactions])
    return form, inputs


def _solve(matrix: Array, right: Array) -> Array:
    """Solve, allowing for a block without rows."""
    return np.asarray(np.linalg.solve(matrix, right) if len(matrix) else np.zeros((0, right.shape[1])))


def _signal_states(dynamics: Dynamics) -> tuple[Array, Array, Array, Array]:
    """Return F, Y, G and s(0) with f(t) = F s, y(t) = Y s, s' = G s: s is 1, then a pair for each harmonic."""
    n, driven = len(dynamics.nodes), sorted(dynamics.motions)
    sources: list[tuple[int, Any]] = [
        *dynamics.loads,
        *((n + k, dynamics.motions[i]) for k, i in enumerate(driven)),
    ]
    columns = [np.zeros(n + len(driven))]
    generators, start = [np.zeros((1, 1))], [1.0]
    for i, signal in sources:
        if isinstance(signal, Harmonic):
            unit = np.zeros_like(columns[0])
            unit[i] = signal.amplitude
            columns += [unit, np.zeros_like(unit)]
            generators.append(np.array([[0.0, -signal.omega], [signal.omega, 0.0]]))
            start += [math.cos(signal.phase), math.sin(signal.phase)]
        elif callable(signal):
            what, node = ("load on", i) if i < n else ("motion of", driven[i - n])
            raise UnsupportedError(
                f"the {what} {dynamics.nodes[node]!r} is a function of time, which has no exact solution here: "
                "give it as Harmonic(...), or take method='moreau-jean'"
            )
        else:
            columns[0][i] += signal
    found = np.column_stack(columns)
    return found[:n], found[n:], block_diag(*generators), np.array(start)
