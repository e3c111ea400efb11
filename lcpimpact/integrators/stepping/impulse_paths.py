r"""Impacts through massless nodes in a θ-step.

Where a massless plate is stopped, contacts of relative degree 0 and 1 together constrain masses (see
`lcpimpact.scheme.impulse_paths`), and gaps imposed at the end of the step would make v oscillate. So if all contacts of a
path are active, the contact problem is solved again with admissible penetrations s such that

.. math:: Σ (u^+ + s) = θ h Σ (U^+ + ρ e \min(U, 0)) \ge 0,
          \qquad ρ Σ \min(U, 0) = Σ U \text{ where that is negative, else } ρ = 0 .

Together they obey Newton's law as one contact of relative degree 2, each with its own restitution. ρ is 1 for left limits;
velocities of massless nodes, which are means of steps, are none after an impact.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Flags, Indices, Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.formula import number
from lcpimpact.scheme.dynamics import Dynamics


class Paths(NamedTuple):
    """The impulse paths over massless nodes, for steps of one length.

    Attributes
    ----------
    lines : (np, nc) array          weights of the contacts of each path
    order : (nc,) array             contacts at masses first: they close exactly, and those at the ground are shifted
    H : (nc, n) array               constraint matrix
    u0, e : (nc,) arrays            gaps at rest, coefficients of restitution
    massless : (n,) array           massless nodes whose motion is not prescribed
    θ, h : float                    of the step
    """

    lines: Matrix
    order: Indices
    H: Matrix
    u0: Vector
    e: Vector
    massless: Flags
    θ: float
    h: float


def impulse_paths(d: Dynamics, θ: float, h: float) -> Paths:
    """Return the impulse paths of a system."""
    if not len(d.impulse_lines):
        return no_paths()
    order = np.argsort(-np.abs(d.H[:, d.massive]).sum(axis=1), kind="stable")
    lines = np.array(d.impulse_lines, order="C")
    H = np.array(d.H, order="C")
    return Paths(lines, order, H, d.u0.copy(), d.restitution.copy(), ~(d.massive | d.driven), number(θ), h)


def no_paths() -> Paths:
    """Return no impulse paths, for other steps."""
    nothing = np.zeros((0, 0))
    return Paths(nothing, np.zeros(0, np.int64), nothing, np.zeros(0), np.zeros(0), np.zeros(0, bool), 1.0, 1.0)


@compiled()
def closes(lines: Matrix, closed: Flags, active: Indices, z: Vector) -> bool:
    """Add the paths to ``closed`` whose contacts are all active; return whether any is new."""
    found = False
    for a in range(len(lines)):
        if closed[a]:
            continue
        length, pushing = 0, 0
        for i in range(lines.shape[1]):
            length += lines[a, i] > 0.0
        for i in range(len(active)):
            pushing += lines[a, active[i]] > 0.0 and z[i] > 0.0
        if pushing == length:
            closed[a] = found = True
    return found


@compiled()
def rebounding(line: Vector, U: Vector) -> float:
    """Return the weight ρ in [0, 1] of the approach velocities of a path, so that Σ ρ min(U, 0) = Σ U; 0 if it opens."""
    opening, approach = 0.0, 0.0
    for i in range(len(U)):
        if line[i] > 0.0:
            opening += U[i]
            approach += min(U[i], 0.0)
    return opening / approach if opening < 0.0 else 0.0


@compiled()
def rebounds(paths: Paths, closed: Flags, U: Vector) -> Vector:
    """Return ρ of each contact on closed paths, and -1 of those on none (nc,)."""
    ρ = np.full(len(U), -1.0)
    for a in range(len(closed)):
        if closed[a]:
            ρ_a = rebounding(paths.lines[a], U)
            for i in range(len(U)):
                if paths.lines[a, i] > 0.0:
                    ρ[i] = max(ρ[i], ρ_a)
    return ρ


@compiled()
def write_shifts(paths: Paths, closed: Flags, q: Vector, v: Vector, shift: Vector) -> None:
    """Write the penetration of each contact at the end of the step with which closed paths obey the law of impact.

    Σ (u⁺ + shift) = θ h Σ (U⁺ + ρ e U) over each of these paths. The contacts that come last in the order are
    shifted, and the others close exactly: velocities of massless nodes, which cancel in the sum, are eliminated row by row.
    """
    n = len(q)
    nc = len(shift)
    θ = paths.θ
    h = paths.h
    U = np.zeros(nc)
    for i in range(nc):
        for j in range(n):
            U[i] += paths.H[i, j] * v[j]
    ρ = rebounds(paths, closed, U)
    shift[:] = 0.0
    pivots = np.zeros((n, n + 1))
    columns = np.zeros(n, np.int64)
    count = 0
    row = np.empty(n + 1)
    for k in range(nc):
        i = paths.order[k]
        if ρ[i] < 0.0:
            continue
        u = paths.u0[i]
        for j in range(n):
            u += paths.H[i, j] * q[j]
            row[j] = paths.H[i, j] if paths.massless[j] else 0.0
        row[n] = h * (θ * paths.e[i] * ρ[i] * min(U[i], 0.0) - (1.0 - θ) * U[i]) - u
        for p in range(count):
            row -= row[columns[p]] * pivots[p]
        largest = int(np.argmax(np.abs(row[:n])))
        if row[largest] == 0.0:
            shift[i] = row[n]
        else:
            pivots[count], columns[count] = row / row[largest], largest
            count += 1
