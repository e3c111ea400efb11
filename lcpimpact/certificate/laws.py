"""Forces on nodes, accelerations of gaps, and violations of friction and bounds, for given states of a system."""

from __future__ import annotations

import numpy as np

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.certificate.theta_balance import DAMPED, DRIVEN, FREE, MASSIVE
from lcpimpact.scheme.dynamics import Dynamics


def node_kinds(d: Dynamics) -> Indices:
    """Return the kinds of the nodes: 1 with mass, 2 with prescribed motion, 0 massless with dashpots, -1 without (n,)."""
    driven, massive = d.driven, d.massive
    loose: Flags = np.zeros(len(massive), dtype=np.bool_)
    if not (driven | massive).all():
        loose = np.asarray(d.decomposition.static.any(axis=1))
    return np.select([driven, massive, loose], [DRIVEN, MASSIVE, FREE], DAMPED).astype(np.int64)


def accelerations(d: Dynamics, g: Array) -> Array:
    """Return bounds of the acceleration U' of each row in m/s² by the forces g on the nodes with mass (nc,)."""
    massive = d.massive
    M = d.M[np.ix_(massive, massive)]
    if np.count_nonzero(M) == len(M):
        largest = np.abs(g).max(axis=0, initial=0.0)[massive] / np.diag(M)
    else:
        largest = np.abs(np.linalg.solve(M, g[:, massive].T)).max(axis=1, initial=0.0)
    return np.asarray(np.abs(d.H[:, massive]) @ largest)


def friction_residual(d: Dynamics, r: Array, U: Array) -> Array:
    """Return the power r0 |U| + r U in W by which sliders dissipate too little; zero for other rows (..., nc)."""
    bounds = np.where(d.slides, d.r_max, 0.0)
    return np.asarray(np.where(d.slides, bounds * np.abs(U) + r * U, 0.0))


def bound_violation(d: Dynamics, r: Array) -> Array:
    """Return the violation of the bounds of the reactions in N (..., nc)."""
    return np.maximum(np.maximum(d.r_min - r, r - d.r_max), 0.0)


def forces_on_nodes(d: Dynamics, t: Array, q: Array, v: Array, r: Array | None) -> tuple[Array, Array]:
    """Return the loads f, and the forces f + s - K q - C v + B r on the nodes (nt, n); with r None, without reactions."""
    f = np.broadcast_to(d.force(0.0), q.shape) if d.constant_loads else d.force(t)
    g = f - q @ d.K.T - v @ d.C.T
    if d.springs:
        g += d.spring_force(q, v)
    if r is not None:
        g += r @ d.B.T
    return f, g
