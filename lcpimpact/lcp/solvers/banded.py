"""Banded LCPs in linear time: isotonic regression for chains of contacts, else block pivoting with banded factors.

In a chain of bodies with inverse masses c_0, c_1, ..., contact i is between the bodies i and i + 1. Then

    M_ii = c_i + c_{i+1},    M_{i,i+1} = -c_{i+1},    w_i = v_{i+1} - v_i,    v_j = y_j + c_j (z_{j-1} - z_j)

with y the velocities without contact, q_i = y_{i+1} - y_i. So v is the mass-weighted projection of y onto the
non-decreasing sequences: isotonic regression, which pooling adjacent violators solves in one pass.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Indices, Matrix, Vector
from lcpimpact.compiled import FEW_ROWS, compiled
from lcpimpact.errors import Status
from lcpimpact.lcp.operators import Property
from lcpimpact.lcp.problem import is_plain
from lcpimpact.lcp.solver import CompiledSolver
from lcpimpact.lcp.solvers.block_pivoting import block_pivoting
from lcpimpact.numerics.rounding import EPS

SOLVED = int(Status.SOLVED)
RAY = int(Status.RAY)
UNDECIDED = int(Status.UNDECIDED)


@compiled()
def chain_masses(W: Matrix, mass: Vector) -> bool:
    """Set ``mass`` (n + 1,) to the body masses if M is that of a chain; else return False.

    The end masses may be infinite (ground, wall).
    """
    bands, n = W.shape
    if bands != 2:
        return False
    left = 0.0
    for i in range(n):
        right = -W[1, i] if i < n - 1 else W[0, i] - left
        if i == 0:
            left = W[0, 0] - right if n > 1 else 0.0
        tiny = 8.0 * EPS * W[0, i]
        if i in (0, n - 1):
            left = 0.0 if abs(left) <= tiny else left
            right = 0.0 if abs(right) <= tiny else right
        if not abs(W[0, i] - left - right) <= tiny or left < 0.0 or right < 0.0 or (right == 0.0 and i < n - 1):
            return False
        if i == 0:
            mass[0] = 1.0 / left if left > 0.0 else np.inf
        mass[i + 1] = 1.0 / right if right > 0.0 else np.inf
        left = right
    return True


class Pools(NamedTuple):
    """The pools of bodies that move with one velocity v: v - y of the first and the last, their mass, and the last body."""

    of_first: Vector
    of_last: Vector
    weight: Vector
    end: Indices


@compiled()
def pools_for(n: int) -> Pools:
    """Return room for the pools of n contacts."""
    return Pools(np.empty(n + 1), np.empty(n + 1), np.empty(n + 1), np.empty(n + 1, np.int64))


@compiled()
def isotonic_chain(mass: Vector, q: Vector, z: Vector, room: Pools) -> int:
    """Set z to the impulses of a chain by pooling adjacent violators.

    A pool moves with one velocity v, stored as v - y of its first and of its last body: y grows along a flying stack, and
    storing v itself would cancel the small differences that determine the impulses. A contact with q_i = inf never acts.

    Returns SOLVED; or RAY between two approaching walls, with the certificate z = 1.
    """
    n = len(q)
    of_first = room.of_first
    of_last = room.of_last
    weight = room.weight
    end = room.end
    pools = 0
    for j in range(n + 1):
        first = 0.0
        last = 0.0
        m = mass[j]
        while pools > 0 and of_last[pools - 1] > q[end[pools - 1]] + first:
            pools -= 1
            # Relative to the first body of the previous pool: y of the first and last body of this pool.
            start = of_first[pools] - of_last[pools] + q[end[pools]]
            stop = start + (first - last)
            if weight[pools] < np.inf:
                share = m / (m + weight[pools]) if m < np.inf else 1.0
                first = of_first[pools] + (start + first - of_first[pools]) * share
                m += weight[pools]
            elif m < np.inf:
                first, m = of_first[pools], np.inf
            else:
                z[:] = 1.0
                return RAY
            last = first - stop
        of_first[pools] = first
        of_last[pools] = last
        weight[pools] = m
        end[pools] = j
        pools += 1
    begin = 0
    for pool in range(pools):
        total = 0.0
        if mass[end[pool]] < np.inf:
            excess = of_last[pool]  # v - y_j
            for j in range(end[pool], begin, -1):
                total += mass[j] * excess
                z[j - 1] = max(total, 0.0)
                excess += q[j - 1]
        else:
            excess = of_first[pool]
            for j in range(begin, end[pool]):
                total -= mass[j] * excess
                z[j] = max(total, 0.0)
                excess -= q[j]
        if end[pool] < n:
            z[end[pool]] = 0.0
        begin = end[pool] + 1
    return SOLVED


@compiled(most=FEW_ROWS)
def banded(W: Matrix, q: Vector, lower: Vector, upper: Vector, z: Vector, tol: float, max_iter: int) -> tuple[int, int]:
    """Solve by isotonic regression if M is the matrix of a chain and the only bounds are z >= 0, else by block pivoting."""
    mass = np.empty(len(q) + 1)
    if is_plain(lower, upper) and chain_masses(W, mass):
        return isotonic_chain(mass, q, z, pools_for(len(q))), 1
    return block_pivoting(W, q, lower, upper, z, tol, max_iter)


SOLVER = CompiledSolver(
    name="banded",
    summary="chains and bars in O(n): isotonic regression, or block pivoting with a banded factor",
    requires=(Property.SYMMETRIC, Property.POSITIVE_DIAGONAL),
    storages=("banded", "dense"),
    boxed=True,
    tol=1e-10,
    max_iter=1_000,
    source="BestChakravarti1990, for the pooling; PortugalJudiceVicente1994",
    kernel=banded,
)
