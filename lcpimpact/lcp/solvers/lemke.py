"""Lemke's complementary pivoting with the lexicographic rule, which cannot cycle."""

from __future__ import annotations

import numpy as np
from numba import types

from lcpimpact.arrays import Array, Indices
from lcpimpact.compiled import compiled, i8, indices, matrix
from lcpimpact.errors import Status
from lcpimpact.lcp.judge import holds, measure, proves_infeasible
from lcpimpact.lcp.polish import polish
from lcpimpact.lcp.problem import FREE, LOWER, SIGNATURE, is_plain
from lcpimpact.lcp.reduction import from_lcp, to_lcp
from lcpimpact.lcp.scaling import equilibrate, units
from lcpimpact.lcp.solver import CompiledSolver
from lcpimpact.lcp.trace import note

SOLVED, RAY, UNDECIDED, MAX_ITER = int(Status.SOLVED), int(Status.RAY), int(Status.UNDECIDED), int(Status.MAX_ITER)

COVERINGS = 4
"""Covering vectors to try in each of the two units, one after another, while the path proves nothing."""

GOLDEN = 0.6180339887498949

THRESHOLD = 1e-11
"""Least entry of a scaled tableau that may be a pivot."""

TIE = 1e-10
"""Relative distance of two ratios that counts as none: after hundreds of pivots rounding has grown to this."""


@compiled(types.void(matrix, i8, i8))
def exchange(T: Array, r: int, c: int) -> None:
    """Exchange the basic variable of row r with the one outside the basis of column c."""
    width = T.shape[1]
    pivot = 1.0 / T[r, c]
    for j in range(width):
        T[r, j] *= pivot
    T[r, c] = pivot
    for i in range(T.shape[0]):
        factor = T[i, c]
        if i != r and factor != 0.0:
            for j in range(width):
                T[i, j] -= factor * T[r, j]
            T[i, c] = -factor * pivot


@compiled(types.boolean(matrix, indices, indices, i8, i8, i8))
def precedes(T: Array, inside: Indices, outside: Indices, i: int, k: int, c: int) -> bool:
    """Return whether row i of the inverse basis over T_ic is lexicographically less than row k over T_kc."""
    n = T.shape[0]
    slot = np.full(n, -1)
    for j in range(n + 1):
        if outside[j] < n:
            slot[outside[j]] = j
    for j in range(n):
        if slot[j] >= 0:
            new, old = T[i, slot[j]] / T[i, c], T[k, slot[j]] / T[k, c]
        else:
            new = 1.0 / T[i, c] if inside[i] == j else 0.0
            old = 1.0 / T[k, c] if inside[k] == j else 0.0
        if abs(new - old) > TIE * max(abs(new), abs(old)) + 1e-3 * TIE:
            return bool(new < old)
    return False


@compiled(i8(matrix, indices, indices, i8))
def blocking_row(T: Array, inside: Indices, outside: Indices, c: int) -> int:
    """Return the row whose variable reaches zero first as that of column c grows, or -1 for a ray.

    The ratio test is lexicographic: ties in the right side are broken by the rows of the inverse basis, which stand in
    the columns of w. The covering variable leaves whenever it can, since that ends the method.
    """
    n = T.shape[0]
    covering, right = 2 * n, n + 1
    best = -1
    for i in range(n):
        if T[i, c] <= THRESHOLD:
            continue
        if best < 0:
            best = i
            continue
        new, old = T[i, right] / T[i, c], T[best, right] / T[best, c]
        margin = TIE * max(abs(new), abs(old)) + 1e-3 * TIE
        if new < old - margin or (
            new <= old + margin
            and inside[best] != covering
            and (inside[i] == covering or precedes(T, inside, outside, i, best, c))
        ):
            best = i
    return best


@compiled(SIGNATURE)
def lemke(W: Array, q: Array, lower: Array, upper: Array, z: Array, tol: float, max_iter: int) -> tuple[int, int]:
    """Follow the almost complementary path of w = M z + q + d z0 from a large z0 until z0 leaves the basis.

    The problem is first scaled to a unit diagonal and max |q| = 1. Columns of the tableau: those outside the basis, then
    the right side; at first z, z0, q. The answer is recomputed from M and q for the final basis, so that rounding does not
    accumulate over the pivots. A ray whose direction proves that there is no solution ends the method; after any other, or
    an answer that does not hold, it starts anew with another d, and at last with units of w and z that are not tied by the
    diagonal. Bounds are turned into more unknowns first.
    """
    N, p, row, sign, base = W, q, np.arange(len(q)), np.ones(len(q)), np.zeros(len(q))
    if not is_plain(lower, upper):
        N, p, row, sign, base = to_lcp(W, q, lower, upper)
    n = len(p)
    zero, infinite = np.zeros(n), np.full(n, np.inf)
    y, unit, of_z = np.zeros(n), np.empty(n), np.empty(n)
    T, inside, outside, side = (
        np.empty((n, n + 2)),
        np.empty(n, np.int64),
        np.empty(n + 1, np.int64),
        np.empty(n, np.int64),
    )
    d, shift, w = np.empty(n), np.empty(n), np.empty(n)
    covering, right = 2 * n, n + 1
    status, count = SOLVED, 0
    for i in range(n):
        status = UNDECIDED if p[i] < 0.0 else status
    size, widest, attempt = 0.0, 0.0, 0
    while status == UNDECIDED and attempt < 2 * COVERINGS:
        attempt += 1
        if attempt == 1:
            units(N, p, unit)
            of_z[:] = unit
        elif attempt == COVERINGS + 1:
            equilibrate(N, unit, of_z)
        if attempt == 1 or attempt == COVERINGS + 1:
            size, widest = 0.0, 0.0
            for i in range(n):
                size = max(size, -p[i] * unit[i])
                widest = max(widest, unit[i])
        r = 0
        outside[n] = covering
        for i in range(n):
            inside[i], outside[i] = i, n + i
            for j in range(n):
                T[i, j] = -N[i, j] * unit[i] * of_z[j]
            # d = (1, ..., 1) in the units of q; later tries spread it between 1 and 2 in those of the scaled problem.
            d[i] = unit[i] / widest if attempt == 1 else 1.0 + GOLDEN * (i + 1) * attempt % 1.0
            T[i, n] = -d[i]
            T[i, right] = p[i] * unit[i] / size
            # The first to leave is the lexicographic minimum of (q, I)/d: the least ratio, and of equals the last.
            if T[i, right] / d[i] <= T[r, right] / d[r]:
                r = i
        c = n
        while True:
            if count == max_iter:
                status = MAX_ITER
                break
            count += 1
            entering, leaving = outside[c], inside[r]
            exchange(T, r, c)
            inside[r], outside[c] = entering, leaving
            y[:] = 0.0
            z0 = 0.0
            for i in range(n):
                if inside[i] == covering:
                    z0 = T[i, right] * size
                elif inside[i] >= n:
                    y[inside[i] - n] = max(T[i, right], 0.0) * size * of_z[inside[i] - n]
            for i in range(n):
                shift[i] = d[i] * z0 / unit[i]
            note(y, inside, entering, leaving, shift)
            if leaving == covering:
                for i in range(n):
                    side[i] = LOWER
                for i in range(n):
                    if inside[i] >= n:
                        side[inside[i] - n] = FREE
                polish(N, p, zero, infinite, side, y)
                scaled, _, rounding = measure(N, p, zero, infinite, y, w)
                status = SOLVED if attempt == 2 * COVERINGS or holds(scaled, rounding, tol) else UNDECIDED
                break
            wanted = leaving + n if leaving < n else leaving - n
            for j in range(n + 1):
                if outside[j] == wanted:
                    c = j
            r = blocking_row(T, inside, outside, c)
            if r < 0:
                y[:] = 0.0
                for i in range(n):
                    if inside[i] >= n and inside[i] != covering:
                        y[inside[i] - n] = max(-T[i, c], 0.0) * of_z[inside[i] - n]
                if wanted >= n:
                    y[wanted - n] = of_z[wanted - n]
                status = RAY if proves_infeasible(N, p, zero, infinite, y) else UNDECIDED
                break
    for i in range(len(q)):
        z[i] = 0.0 if status == RAY else base[i]
    from_lcp(row, sign, y, z)
    if status != RAY:
        for i in range(len(q)):
            z[i] = min(max(z[i], lower[i]), upper[i])
    return status, count


SOLVER = CompiledSolver(
    name="lemke",
    summary="lexicographic complementary pivoting; takes singular, non-symmetric and copositive M, and bounds",
    requires=(),
    storages=("dense",),
    boxed=True,
    tol=1e-10,
    max_iter=10_000,
    source="Lemke (1965); Cottle, Pang and Stone (1992), section 4.4",
    kernel=lemke,
)
