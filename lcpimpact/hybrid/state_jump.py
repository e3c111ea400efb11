r"""The state jump of a linear complementarity system with an inconsistent initial state.

Where no λ solves 0 <= λ ⟂ C x⁻ + c + D λ >= 0, the multipliers contain impulses, λ = p δ(t), and the state jumps,

.. math:: x^+ = x^- + B p, \qquad Q \ni p \perp C x^+ + c \in Q^*, \qquad
          Q = \{ p : 0 \le p \perp D p \ge 0 \} = \{ p \ge 0 : D p \ge 0, \; (D + D^T) p = 0 \},

the latter for D positive semidefinite; Q* is the dual cone, of all C x + c from which the motion continues without a jump.
For D = 0 this is the LCP 0 <= p ⟂ C x⁺ + c >= 0. In a passive system x⁺ is the consistent state nearest to x⁻ in the
metric of the storage function, and the limit of backward Euler steps. In a circuit the jump is the charge that flows at once
when a voltage is applied to a capacitor through diodes.

With the multipliers μ >= 0 of D p >= 0 and ν of (D + Dᵀ) p = 0 it is one mixed LCP,

.. math:: 0 \le p \perp C B p + C x^- + c - D^T μ - (D + D^T) ν \ge 0, \qquad 0 \le μ \perp D p \ge 0,
          \qquad (D + D^T) p = 0.

Equations y = 0 must hold at the start. Their multipliers follow those of the contacts, so that B and D stand for B T and
D T with r = T r, and the jump keeps to the equations.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import null_space

from lcpimpact.arrays import Array
from lcpimpact.errors import UnsupportedError
from lcpimpact.hybrid.system import System
from lcpimpact.lcp.operators import Dense, Property
from lcpimpact.lcp.solve import solve_lcp
from lcpimpact.problems.base import Problem
from lcpimpact.record import Event, State
from lcpimpact.scheme.first_order import forced_form

SINGULAR_RTOL = 1e-12
"""Eigenvalues below this, relative to the largest entry, are zero."""


def state_jump(B: Array, C: Array, D: Array, u: Array, solver: str = "auto") -> Array | None:
    """Return the impulses p (m,) of the jump x⁺ = x⁻ + B p; zero if the state is consistent, None if undetermined.

    Parameters
    ----------
    B : (n, m), C : (m, n), D : (m, m) arrays
        As in x' = A x + B λ, u = C x + D λ + c.
    u : (m,) array
        C x⁻ + c.
    solver : str
        Name of an LCP solver for any matrix.

    Returns
    -------
    p : (m,) array or None
        None if D is not positive semidefinite, the law has no solution, or x⁺ is not unique: it is unique if C B is
        positive semidefinite on (D + Dᵀ) p = 0 and singular only where B p = 0 (as in passive systems), or D = 0 and C B
        is a P-matrix.

    Examples
    --------
    A capacitor at -1 V that a diode keeps at or above zero receives 1 C:

    >>> state_jump(np.eye(1), np.eye(1), np.zeros((1, 1)), np.array([-1.0]))
    array([1.])

    References
    ----------
    Camlibel, Heemels and Schumacher, *On linear passive complementarity systems* (2002); Frasca, Camlibel, Goknar, Iannelli
    and Vasca, *Linear passive networks with ideal switches* (2010).
    """
    if not len(u) or solve_lcp(D, u, throw=False).success:
        return np.zeros(len(u))
    m = len(u)
    symmetric = D + D.T
    W = C @ B
    if np.linalg.eigvalsh(symmetric).min() < -SINGULAR_RTOL * np.abs(D).max() or not _unique(B, W, symmetric):
        return None
    zero = np.zeros((2 * m, 2 * m))
    M = np.block([[W, np.hstack([-D.T, -symmetric])], [np.vstack([D, symmetric]), zero]])
    q = np.concatenate([u, np.zeros(2 * m)])
    lower = np.repeat([0.0, 0.0, -np.inf], m)
    used = np.abs(M).max(axis=1) > 0.0
    used[:m] = True
    found = solve_lcp(M[np.ix_(used, used)], q[used], solver, lower=lower[used], upper=np.inf, throw=False)
    p = found.z[:m]
    return p if found.success and solve_lcp(D, _rounded(u, W, p), throw=False).success else None


def _rounded(u: Array, W: Array, p: Array) -> Array:
    """Return u + W p, with rounding set to zero."""
    terms = np.abs(u) + np.abs(W) @ np.abs(p)
    after = u + W @ p
    return np.where(np.abs(after) <= SINGULAR_RTOL * terms, 0.0, after)


def _unique(B: Array, W: Array, symmetric: Array) -> bool:
    """Return whether the law determines x⁺ wherever it has a solution."""
    if not symmetric.any() and Dense(W).has(Property.P):
        return True
    V = null_space(symmetric, rcond=SINGULAR_RTOL) if symmetric.any() else np.eye(len(W))
    monotone = V.T @ (W + W.T) @ V
    values, vectors = np.linalg.eigh(monotone)
    size = np.abs(monotone).max(initial=0.0)
    kernel = V @ vectors[:, values <= SINGULAR_RTOL * size]
    return bool(
        (values >= -SINGULAR_RTOL * size).all() and (np.abs(B @ kernel) <= 1e-9 * np.abs(B).max(initial=0.0)).all()
    )


def enter_constraint(problem: Problem, solver: str = "auto") -> tuple[Problem, Array]:
    """Return the problem after the jump at t = 0, and the impulses p (nc,); a scheme never jumps.

    Raises
    ------
    UnsupportedError
        If the initial state is inconsistent, and the matrices do not determine the jump.
    """
    d = problem.dynamics
    if d.stores_energy:
        return problem, np.zeros(len(d.contacts))
    x = problem.initial_coordinates
    p = np.zeros(len(d.contacts))
    c = d.impenetrable
    B = d.B @ d.elimination
    C = d.H
    D = d.D @ d.elimination
    u = d.gap(0.0, x)
    if (by_equations := d.D[np.ix_(c, d.bilateral)]).any():
        C, u = C.copy(), u.copy()
        by_state, value = _multipliers_of_equations(problem)
        C[c] += by_equations @ by_state
        u[c] += by_equations @ value
    # Relays take no impulses.
    jump = state_jump(B[:, c], C[c], D[np.ix_(c, c)], u[c], solver)
    if jump is not None and jump.any() and D[np.ix_(c, d.switches)].any():
        jump = None
    if jump is None:
        names = ", ".join(repr(each.name) for each, opening in zip(d.contacts, u, strict=True) if opening < 0.0)
        raise UnsupportedError(
            f"{problem.name!r} starts outside its constraint (u of {names} is negative, and no finite multiplier makes it "
            "up), and A, B, C, D do not determine a jump into it: start it inside"
        )
    p[c] = jump
    if not p.any():
        return problem, p
    p = d.elimination @ p
    after = dict(zip(d.nodes, map(float, x + d.B @ p), strict=True))
    return replace(
        problem, q0={node: value for node, value in after.items() if d.nodes.index(node) not in d.motions}
    ), p


def _multipliers_of_equations(problem: Problem) -> tuple[Array, Array]:
    """Return λ of the equations without others at t = 0 (nj,), and what it changes with the state (nj, n)."""
    d, joints = problem.dynamics, problem.dynamics.bilateral
    form, inputs = forced_form(d, "a jump at the start")
    system = System(d, 1.0, form, (inputs.E, inputs.D))
    X = system.state(problem.initial_coordinates, problem.initial_velocities)
    w = np.array([load(0.0) for load in inputs.loads])
    value = system.O[joints] @ X + system.O_w[joints] @ w
    O, G = system.O[joints][:, : len(d.nodes)], system.G[np.ix_(joints, joints)]  # noqa: E741
    return -np.asarray(np.linalg.solve(G, O)), -np.asarray(np.linalg.solve(G, value))


def into_balance(problem: Problem, *, balance_rtol: float = 1e-9) -> tuple[Problem, tuple[str, ...]]:
    r"""Return the problem with its quasi-static nodes in balance at t = 0, and the names of those that moved.

    They have no motion of their own, so that none begins elsewhere. With s along them,

    .. math:: S^T (f(0) - K (q + S s) + H^T r) = 0, \qquad 0 \le r \perp u(q + S s) \ge 0 .

    Nodes with sliders or non-linear springs stay where they are.

    ``balance_rtol``: distance from balance at the start, relative to the coordinates and gaps, below which a node
    stays where it is.
    """
    d = problem.dynamics
    S = d.decomposition.static if d.stores_energy else np.zeros((len(d.nodes), 0))
    rows = np.abs(d.H @ S).sum(axis=1) > 0.0
    if not S.shape[1] or (d.directions @ S).any() or (rows & d.of_rate).any():
        return problem, ()
    q, K = problem.initial_coordinates, S.T @ d.K @ S
    f = S.T @ (d.force(0.0) - d.K @ q)
    push = S.T @ d.B[:, rows]
    H = (d.H @ S)[rows]
    r = np.zeros(len(H))
    if len(H):
        found = solve_lcp(
            H @ np.linalg.solve(K, push), d.gap(0.0, q)[rows] + H @ np.linalg.solve(K, f),
            lower=d.r_min[rows], upper=d.r_max[rows], throw=False,
        )  # fmt: skip
        if not found.success:
            return problem, ()
        r = found.z
    moves = S @ np.linalg.solve(K, f + push @ r)
    size = np.abs(q).max() + np.abs(moves).max(initial=0.0) + np.abs(d.u0).max(initial=0.0)
    moved = np.abs(moves) > balance_rtol * size
    if not moved.any():
        return problem, ()
    places = {node: float(x) for node, x, m in zip(d.nodes, q + moves, moved, strict=True) if m}
    return replace(problem, q0={**problem.q0, **places}), tuple(places)


def jump_events(problem: Problem, p: Array, after: State) -> tuple[Event, ...]:
    """Return the events "jump" at t = 0 with the impulses p (nc,), by which a problem jumps to the state ``after``."""
    before = replace(after, q=problem.initial_coordinates)
    return tuple(
        Event(0.0, contact.name, "jump", before, after, float(impulse))
        for contact, impulse in zip(problem.dynamics.contacts, p, strict=True)
        if impulse != 0.0
    )
