r"""The first-order form of a scheme: a linear complementarity system whose state holds no algebraic coordinate.

.. math:: X' = A X + B r, \qquad u = C X + D r, \qquad 0 \le u \perp r \ge 0

The massless coordinates are eliminated: those with a dashpot by their first-order equation, those with springs only by
their balance of forces. Constant and harmonic loads become states of their own (1, and a cosine with its sine), so the
system is homogeneous and its solution in each contact mode is a matrix exponential.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag

from lcpimpact.arrays import Array
from lcpimpact.errors import UnsupportedError
from lcpimpact.scheme.decomposition import Decomposition, decompose
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.elements.load import Harmonic


@dataclass(frozen=True)
class LinearComplementaritySystem:
    """X' = A X + B r, u = C X + D r, q = Q X + Qr r.

    Attributes
    ----------
    A : (N, N), B : (N, nc), C : (nc, N), D : (nc, nc) arrays
        The system; X = (q_m, q_d, v_m, 1, load states).
    Q : (n, N), Qr : (n, nc) arrays
        How the coordinates of the scheme are read off.
    parts : Decomposition
        The coordinates with mass, damped and static.
    loads : (N - 2 nm - nd,) array
        The load states at t = 0.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    Q: Array
    Qr: Array
    parts: Decomposition
    loads: Array

    def state(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Return X at t = 0 for the coordinates q and velocities v of the scheme (n,); static ones are not states.

        The basis is made of unit vectors but for the static groups, which shift with their first node.
        """
        q, v = np.asarray(q, dtype=np.float64), np.asarray(v, dtype=np.float64)
        basis = np.column_stack([self.parts.massive, self.parts.damped, self.parts.static])
        coordinates = np.linalg.solve(basis, q)
        dynamic = self.parts.massive.shape[1] + self.parts.damped.shape[1]
        return np.concatenate([coordinates[:dynamic], self.parts.massive.T @ v, self.loads])


def first_order_form(dynamics: Dynamics) -> LinearComplementaritySystem:
    """Eliminate the massless coordinates of a scheme.

    Parameters
    ----------
    dynamics : Dynamics
        The scheme; its loads must be constant or `Harmonic`.

    Raises
    ------
    UnsupportedError
        If a load is another function of time.
    """
    parts = decompose(dynamics.M, dynamics.C)
    Em, Ed, Es = parts.massive, parts.damped, parts.static
    nm, nd = Em.shape[1], Ed.shape[1]
    F, generator, loads = _load_states(dynamics)
    H = dynamics.H

    # Every quantity is a row block against (q_m, q_d, v_m, loads) and a block against r.
    zero = np.zeros
    nl = len(loads)
    M = Em.T @ dynamics.M @ Em
    to_state = np.column_stack([Em, Ed, zero((len(H.T), nm + nl))])

    # Static: K_ss q_s = f_s + H_sᵀ r - K_sm q_m - K_sd q_d.
    K_ss = Es.T @ dynamics.K @ Es
    load_columns = np.column_stack([zero((len(F), nm + nd + nm)), F])
    Qs = _solve(K_ss, Es.T @ (load_columns - dynamics.K @ to_state))
    Qsr = _solve(K_ss, Es.T @ H.T)
    Q = to_state + Es @ Qs
    Qr = Es @ Qsr

    # Damped: C_dd q_d' = f_d + H_dᵀ r - K_d q - C_dm v_m.
    velocity = np.column_stack([zero((nm, nm + nd)), np.eye(nm), zero((nm, nl))])
    C_dd = Ed.T @ dynamics.C @ Ed
    Vd = _solve(C_dd, Ed.T @ (load_columns - dynamics.K @ Q - dynamics.C @ Em @ velocity))
    Vdr = _solve(C_dd, Ed.T @ (H.T - dynamics.K @ Qr))

    # Massive: M v_m' = f_m + H_mᵀ r - K_m q - C_m q'.
    rate, rate_r = Em @ velocity + Ed @ Vd, Ed @ Vdr
    Am = _solve(M, Em.T @ (load_columns - dynamics.K @ Q - dynamics.C @ rate))
    Amr = _solve(M, Em.T @ (H.T - dynamics.K @ Qr - dynamics.C @ rate_r))

    generator_rows = np.column_stack([zero((nl, nm + nd + nm)), generator])
    A = np.vstack([velocity, Vd, Am, generator_rows])
    B = np.vstack([zero((nm, len(H))), Vdr, Amr, zero((nl, len(H)))])
    C = H @ Q
    C[:, 2 * nm + nd] += dynamics.u0
    return LinearComplementaritySystem(A, B, C, H @ Qr, Q, Qr, parts, loads)


def _solve(matrix: Array, right: Array) -> Array:
    """Solve, allowing for a block without rows."""
    return np.asarray(np.linalg.solve(matrix, right) if len(matrix) else np.zeros((0, right.shape[1])))


def _load_states(dynamics: Dynamics) -> tuple[Array, Array, Array]:
    """Return F, G and s(0) with f(t) = F s, s' = G s: first the constant state 1, then a pair for each harmonic."""
    columns = [np.zeros(len(dynamics.nodes))]
    generators, start = [np.zeros((1, 1))], [1.0]
    for i, load in dynamics.loads:
        if isinstance(load, Harmonic):
            unit = np.zeros(len(dynamics.nodes))
            unit[i] = load.amplitude
            columns += [unit, np.zeros(len(dynamics.nodes))]
            generators.append(np.array([[0.0, -load.omega], [load.omega, 0.0]]))
            start += [math.cos(load.phase), math.sin(load.phase)]
        elif callable(load):
            raise UnsupportedError(
                f"the load on {dynamics.nodes[i]!r} is a function of time, which has no exact solution here: "
                "give it as Harmonic(...), or take method='moreau-jean'"
            )
        else:
            columns[0][i] += load
    return np.column_stack(columns), block_diag(*generators), np.array(start)
