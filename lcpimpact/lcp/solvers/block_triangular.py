"""Block-triangular matrices by block forward substitution.

Row i depends on row j where M_ij != 0. The strongly connected components of this graph are the diagonal blocks of M
permuted to block lower triangular form; each is an LCP whose q includes the contributions of the preceding blocks.
"""

from __future__ import annotations

import numpy as np

from lcpimpact.arrays import Indices, Matrix, Vector
from lcpimpact.compiled import FEW_ROWS, compiled
from lcpimpact.errors import Status
from lcpimpact.lcp.solver import CompiledSolver
from lcpimpact.lcp.solvers.block_pivoting import block_pivoting
from lcpimpact.lcp.solvers.closed_form import closed_form
from lcpimpact.lcp.solvers.lemke import lemke
from lcpimpact.lcp.trace import NONE, note
from lcpimpact.numerics.rounding import EPS

SOLVED, UNDECIDED = int(Status.SOLVED), int(Status.UNDECIDED)


@compiled()
def is_irreducible(M: Matrix) -> bool:
    """Return whether M is irreducible: row 0 depends on every other row, and every other row on it."""
    n = len(M)
    queue = np.zeros(n, np.int64)
    for forward in (True, False):
        reached = np.zeros(n, np.bool_)
        reached[0] = True
        count, k = 1, 0
        while k < count < n:
            i = queue[k]
            k += 1
            for j in range(n):
                if not reached[j] and (M[i, j] if forward else M[j, i]) != 0.0:
                    reached[j] = True
                    queue[count] = j
                    count += 1
        if count < n:
            return False
    return True


@compiled()
def components(M: Matrix, block: Indices) -> int:
    """Set ``block`` to each row's block number, in topological order; return the number of blocks.

    Tarjan's algorithm: ``lowest`` is the earliest visited row on the stack that is reachable from a row.
    """
    n = len(M)
    visit = np.full(n, -1)
    lowest = np.empty(n, np.int64)
    column = np.zeros(n, np.int64)
    path, stack = np.empty(n, np.int64), np.empty(n, np.int64)
    visits = 0
    height = 0
    blocks = 0
    for i in range(n):
        block[i] = -1
    for root in range(n):
        if visit[root] >= 0:
            continue
        path[0], length = root, 1
        while length > 0:
            i = path[length - 1]
            if visit[i] < 0:
                visit[i], lowest[i] = visits, visits
                visits += 1
                stack[height] = i
                height += 1
            descends = False
            while column[i] < n and not descends:
                j = column[i]
                if M[i, j] != 0.0:
                    if visit[j] < 0:
                        path[length] = j
                        length += 1
                        descends = True
                        continue
                    if block[j] < 0:
                        lowest[i] = min(lowest[i], lowest[j])
                column[i] += 1
            if descends:
                continue
            length -= 1
            if lowest[i] == visit[i]:
                while block[i] < 0:
                    height -= 1
                    block[stack[height]] = blocks
                blocks += 1
    return blocks


@compiled(most=FEW_ROWS)
def block_triangular(
    W: Matrix, q: Vector, lower: Vector, upper: Vector, z: Vector, tol: float, max_iter: int
) -> tuple[int, int]:
    """Solve block by block: one or two rows in closed form, more by block pivoting, then by Lemke's method if that fails.

    If an earlier block has several solutions, a later block may be infeasible for the one found. So an infeasible block
    proves nothing, and the problem is left undecided.
    """
    n = len(q)
    block, basis = np.empty(n, np.int64), np.empty(n, np.int64)
    rows = np.empty(n, np.int64)
    count = 0
    for i in range(n):
        z[i] = min(max(z[i], lower[i]), upper[i])
    for number in range(components(W, block)):
        k = 0
        for i in range(n):
            if block[i] == number:
                rows[k] = i
                k += 1
        M = np.empty((k, k))
        p = np.empty(k)
        low = np.empty(k)
        high = np.empty(k)
        x = np.empty(k)
        for a in range(k):
            i = rows[a]
            low[a] = lower[i]
            high[a] = upper[i]
            x[a] = z[i]
            p[a], terms = q[i], abs(q[i])
            for j in range(n):
                if block[j] < number:
                    p[a] += W[i, j] * z[j]
                    terms += abs(W[i, j] * z[j])
            if abs(p[a]) <= n * EPS * terms:
                p[a] = 0.0
            for c in range(k):
                M[a, c] = W[i, rows[c]]
        guess = x.copy()
        status, tried = UNDECIDED, 0
        if k <= 2:
            status, tried = closed_form(M, p, low, high, x, tol, 9)
        else:
            status, tried = block_pivoting(M, p, low, high, x, tol, max_iter)
        count += tried
        if status != SOLVED:
            x[:] = guess
            status, tried = lemke(M, p, low, high, x, tol, max_iter)
            count += tried
        if status != SOLVED:
            return UNDECIDED, count
        for a in range(k):
            z[rows[a]] = x[a]
        for i in range(n):
            basis[i] = n + i if block[i] <= number and lower[i] < z[i] < upper[i] else i
        note(z, basis, NONE, NONE)
    return SOLVED, count


SOLVER = CompiledSolver(
    name="block-triangular",
    summary="the strongly connected blocks of M in turn, by substitution; for triangular and decoupled problems",
    requires=(),
    storages=("dense",),
    boxed=True,
    tol=1e-10,
    max_iter=10_000,
    source="Tarjan1972, for the blocks; CottlePangStone2009, section 3.3 for triangular P-matrices",
    kernel=block_triangular,
)
