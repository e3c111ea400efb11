r"""General forces within a θ-step: Newton's method around the LCP, in the interpreter.

As in `lcpimpact.integrators.stepping.newton`, the forces s act at rates y = N w of the step, along with those of non-linear
springs. For a general force y is the mean velocity of its node, and f(t_θ, q_θ, y) has q_θ = θ h y - δ. So

.. math:: J = \frac{∂f}{∂v} + θ h \frac{∂f}{∂q}

is full among the nodes of one law. With w = w_free + G r + G_s s the linearised law s = f + J (y⁺ - y) is
(I - J N G_s) s = f + J (y_free - y + N G r), and what is left is an LCP for r.

Forces need not decrease with y, so that no convex function bounds the steps; they are shortened until |f - s| falls. A step
of the part t solves the linearised law for s + t (f - s) in place of f, so that its r, s and y belong together, as those of
the start do: |f - s| alone is no measure at a y that the contacts do not allow (Ralph, 1994).
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import Status
from lcpimpact.integrators.stepping.law import (
    MAX_NEWTON,
    NEWTON_TOL,
    RATE_ROUNDING,
    ContactProblem,
    Solving,
    Springs,
    SpringSolver,
    solve_law,
)
from lcpimpact.interpreter import interpreted
from lcpimpact.numerics.rounding import TINY
from lcpimpact.scheme import force_law
from lcpimpact.scheme.dynamics import Dynamics

DECREASE, SHORTEST = 0.25, 1e-6
"""Part of a step by which |f - s| must fall, relative to itself, and the shortest part that is tried."""


def solve_with_forces(d: Dynamics, t: float) -> SpringSolver:
    """Return the solver of the rows, the springs and the general forces of a system at the time t.

    It takes the arguments of `lcpimpact.integrators.stepping.newton.solve_with_springs`, and returns the same.
    """
    return partial(_solve, d, t)


class ForceIterate(NamedTuple):
    """The forces s and rates y, the forces f of the laws at y with their derivatives J, and the tolerance of f - s."""

    s: Array
    y: Array
    f: Array
    J: Array
    tolerance: float

    @property
    def error(self) -> float:
        """The largest |f - s|."""
        return float(np.abs(self.f - self.s).max())


def _iterate(d: Dynamics, t: float, springs: Springs, free: tuple[Array, Array], s: Array, y: Array) -> ForceIterate:
    """Return the iterate at s and y (ns + ng,), with the free rates and penetrations."""
    y_free, δ = free
    ns = len(y) - len(d.acted_on)
    f = np.empty(len(y))
    J = np.zeros((len(y), len(y)))
    if ns:
        from lcpimpact.scheme.rate_law import law_at_rate  # here, as it is compiled

        least = RATE_ROUNDING * (TINY + np.abs(y_free) + np.abs(y) + np.abs(springs.room.NGs) @ np.abs(s))
        for j, law in enumerate(springs.law[:ns]):
            f[j], J[j, j] = law_at_rate(law, δ[j], y[j], springs.θh, springs.h, least[j])
    at = t, springs.θh * y[ns:] - δ[ns:], y[ns:]
    f[ns:] = force_law.forces(d.force_laws, *at)
    by_q, by_v = force_law.tangents(d.force_laws, *at)
    J[ns:, ns:] = by_v + springs.θh * by_q
    rounding = np.abs(J) @ (TINY + np.abs(y_free) + np.abs(y) + np.abs(springs.room.NGs) @ np.abs(s))
    return ForceIterate(s, y, f, J, NEWTON_TOL * float(np.abs(f).max()) + RATE_ROUNDING * float(rounding.max()))


def _solve(
    d: Dynamics,
    t: float,
    rows: ContactProblem,
    springs: Springs,
    y_free: Array,
    δ: Array,
    z: Array,
    y: Array,
    s: Array,
    solving: Solving,
) -> tuple[int, int, int, float]:
    """Solve the rows and the forces together: z, y and s are a guess on entry and the answer on return."""
    W = rows.W
    q = rows.q
    lower = rows.lower
    upper = rows.upper
    m = len(z)
    NGs = springs.room.NGs
    HGs, NG = springs.room.HGs[:m], springs.room.NG[:, :m]
    now = _iterate(d, t, springs, (y_free, δ), s.copy(), y.copy())
    whole = False
    total = 0
    residual = 0.0
    for newton in range(MAX_NEWTON + 1):
        if not now.error < np.inf or not np.isfinite(now.J).all():
            return Status.NON_FINITE, total, newton, residual
        if whole and now.error <= now.tolerance:
            s[:], y[:] = now.s, now.y
            return Status.SOLVED, total, newton, residual
        part = 1.0
        before = now
        whole = True
        while part >= SHORTEST:
            goal = before.f if whole else before.s + part * (before.f - before.s)
            J = before.J
            try:
                solved = np.linalg.solve(
                    np.eye(len(s)) - J @ NGs, np.column_stack([J @ NG, goal + J @ (y_free - before.y)])
                )
            except np.linalg.LinAlgError:
                return Status.SINGULAR, total, newton, residual
            S, s_0 = solved[:, :-1], solved[:, -1]
            status, count, residual = _contacts(ContactProblem(W + HGs @ S, q + HGs @ s_0, lower, upper), z, solving)
            total += count
            if status != Status.SOLVED:
                return status, total, newton, residual
            ds = s_0 + S @ z - before.s
            dy = y_free + NGs @ (before.s + ds) + NG @ z - before.y
            now = _iterate(d, t, springs, (y_free, δ), before.s + ds, before.y + dy)
            if now.error <= max((1.0 - DECREASE * part) * before.error, now.tolerance):
                break
            part, whole = 0.5 * part, False
            if newton == 0 and m and part == 0.5:
                # The guess of y is that without contacts: begin with the one that belongs to s.
                status, count, residual = _contacts(ContactProblem(W, q + HGs @ before.s, lower, upper), z, solving)
                total += count
                if status != Status.SOLVED:
                    return status, total, newton, residual
                now = _iterate(d, t, springs, (y_free, δ), before.s, y_free + NGs @ before.s + NG @ z)
                break
    return Status.NEWTON, total, MAX_NEWTON, residual


def _contacts(problem: ContactProblem, z: Array, solving: Solving) -> tuple[int, int, float]:
    """Solve a contact problem from the guess z, if it has rows: status, iterations, residual."""
    if not len(z):
        return Status.SOLVED, 0, 0.0
    return interpreted(solve_law)(problem, z, solving)
