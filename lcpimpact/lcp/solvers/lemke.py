"""Lemke's complementary pivoting method with the lexicographic ratio test, which cannot cycle in exact arithmetic."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Indices, Matrix, Vector
from lcpimpact.compiled import FEW_ROWS, compiled
from lcpimpact.errors import Status
from lcpimpact.lcp.judge import proves_infeasible
from lcpimpact.lcp.pivoting import PIVOT_TOL, exchange
from lcpimpact.lcp.polish import polish
from lcpimpact.lcp.problem import FREE, LOWER, is_plain
from lcpimpact.lcp.reduction import (
    eliminate_equations,
    from_lcp,
    has_equations,
    remaining,
    restore,
    restore_ray,
    to_lcp,
)
from lcpimpact.lcp.scaling import equilibrate, units
from lcpimpact.lcp.solver import CompiledSolver
from lcpimpact.lcp.trace import NONE, note_covered, note_problem

SOLVED = int(Status.SOLVED)
RAY = int(Status.RAY)
UNDECIDED = int(Status.UNDECIDED)
MAX_ITER = int(Status.MAX_ITER)

MAX_COVERINGS = 4
"""Maximum number of covering vectors tried in each of the two scalings until a path is conclusive."""

GOLDEN = 0.6180339887498949

TIE_RTOL = 1e-10
"""Relative tolerance for ties in the ratio test: the rounding error after hundreds of pivots."""


class LemkePath(NamedTuple):
    """The scaled tableau of an almost complementary path: inside = T (outside, 1); initially w = N z + d z0 + p.

    Attributes
    ----------
    T : (n, n + 2) array
    inside : (n,) indices       basic variables, numbered as in `note`
    outside : (n + 1,) indices  nonbasic variables
    d : (n,) array              covering vector
    w_unit, z_unit : (n,) arrays    1/unit of w and z, apart from that of p
    """

    T: Matrix
    inside: Indices
    outside: Indices
    d: Vector
    w_unit: Vector
    z_unit: Vector


@compiled()
def precedes(path: LemkePath, i: int, k: int, c: int) -> bool:
    """Return whether row i of the inverse basis over -T_ic is lexicographically less than row k over -T_kc."""
    T = path.T
    inside = path.inside
    outside = path.outside
    n = len(T)
    slot = np.full(n, -1)
    for j in range(n + 1):
        if outside[j] < n:
            slot[outside[j]] = j
    for j in range(n):
        if slot[j] >= 0:
            new, old = T[i, slot[j]] / T[i, c], T[k, slot[j]] / T[k, c]
        else:
            new = -1.0 / T[i, c] if inside[i] == j else 0.0
            old = -1.0 / T[k, c] if inside[k] == j else 0.0
        if abs(new - old) > TIE_RTOL * max(abs(new), abs(old)) + 1e-3 * TIE_RTOL:
            return bool(new < old)
    return False


@compiled()
def blocking_row(path: LemkePath, c: int) -> int:
    """Return the blocking row as the variable of column c increases, or NONE for a ray.

    The ratio test is lexicographic: ties are broken by the rows of the inverse basis, stored in the columns of w. The
    covering variable leaves whenever it can, since that ends the method.
    """
    T = path.T
    inside = path.inside
    n = len(T)
    covering, right = 2 * n, n + 1
    best = NONE
    for i in range(n):
        if T[i, c] >= -PIVOT_TOL:
            continue
        if best == NONE:
            best = i
            continue
        new = T[i, right] / -T[i, c]
        old = T[best, right] / -T[best, c]
        margin = TIE_RTOL * max(abs(new), abs(old)) + 1e-3 * TIE_RTOL
        if new < old - margin or (
            new <= old + margin and inside[best] != covering and (inside[i] == covering or precedes(path, i, best, c))
        ):
            best = i
    return best


@compiled()
def cover(N: Matrix, p: Vector, path: LemkePath, attempt: int) -> tuple[float, int]:
    """Set up the tableau for a covering vector; return the size of -p before normalisation, and the first row to leave."""
    T = path.T
    inside = path.inside
    outside = path.outside
    d = path.d
    w_unit = path.w_unit
    z_unit = path.z_unit
    n = len(p)
    if attempt == 1:
        units(N, p, w_unit)
        z_unit[:] = w_unit
    elif attempt == MAX_COVERINGS + 1:
        equilibrate(N, w_unit, z_unit)
    size = 0.0
    widest = 0.0
    r = 0
    for i in range(n):
        size = max(size, -p[i] * w_unit[i])
        widest = max(widest, w_unit[i])
    outside[n] = 2 * n
    for i in range(n):
        inside[i], outside[i] = i, n + i
        for j in range(n):
            T[i, j] = N[i, j] * w_unit[i] * z_unit[j]
        # d = (1, ..., 1) in the units of q; later attempts spread it between 1 and 2 in the units of the scaled problem.
        d[i] = w_unit[i] / widest if attempt == 1 else 1.0 + GOLDEN * (i + 1) * attempt % 1.0
        T[i, n] = d[i]
        T[i, n + 1] = p[i] * w_unit[i] / size
        # The lexicographic minimum of (q, I)/d leaves first: the least ratio; the last row of a tie.
        if T[i, n + 1] / d[i] <= T[r, n + 1] / d[r]:
            r = i
    return size, r


@compiled()
def basic_point(path: LemkePath, size: float, y: Vector) -> float:
    """Set y to the basic solution, and return its z0."""
    n = len(y)
    y[:] = 0.0
    z0: float = 0.0
    for i in range(n):
        k = path.inside[i]
        if k == 2 * n:
            z0 = path.T[i, n + 1] * size
        elif k >= n:
            y[k - n] = max(path.T[i, n + 1], 0.0) * size * path.z_unit[k - n]
    return z0


@compiled()
def ray_direction(path: LemkePath, c: int, y: Vector) -> None:
    """Set y to the direction of the unbounded ray of column c."""
    n = len(y)
    y[:] = 0.0
    for i in range(n):
        k = path.inside[i]
        if n <= k < 2 * n:
            y[k - n] = max(path.T[i, c], 0.0) * path.z_unit[k - n]
    k = path.outside[c]
    if k >= n:
        y[k - n] = path.z_unit[k - n]


@compiled()
def follow(path: LemkePath, r: int, size: float, y: Vector, count: int, max_iter: int) -> tuple[int, int, int]:
    """Pivot z0 into the basis at row r, then the complement of each leaving variable, until z0 leaves; y at the end.

    Returns SOLVED, RAY if no variable blocks, UNDECIDED if a basis recurs, as rounding may break ties in a circle, or
    MAX_ITER; the number of pivots; and the last entering column.
    """
    T = path.T
    inside = path.inside
    outside = path.outside
    d = path.d
    w_unit = path.w_unit
    n = len(y)
    c = len(y)
    begin = count
    shift = np.empty(n)
    noted = np.zeros(2 * n + 1, np.bool_)
    next_note = 1
    while r != NONE:
        if count == max_iter:
            return MAX_ITER, count, c
        recurs = count > begin
        for k in inside:
            recurs = recurs and noted[k]
        if recurs:
            return UNDECIDED, count, c
        if count - begin == next_note:  # Brent's search for a circle: the basis of step 1, 2, 4, 8, ... is kept
            noted[:] = False
            for k in inside:
                noted[k] = True
            next_note *= 2
        count += 1
        entering, leaving = outside[c], inside[r]
        exchange(T, r, c)
        inside[r], outside[c] = entering, leaving
        z0 = basic_point(path, size, y)
        for i in range(n):
            shift[i] = d[i] * z0 / w_unit[i]
        note_covered(y, inside, entering, leaving, shift)
        if leaving == 2 * n:
            return SOLVED, count, c
        for j in range(n + 1):
            if outside[j] == (leaving + n if leaving < n else leaving - n):
                c = j
        r = blocking_row(path, c)
    return RAY, count, c


@compiled(most=FEW_ROWS)
def follow_paths(
    W: Matrix, q: Vector, lower: Vector, upper: Vector, z: Vector, tol: float, max_iter: int
) -> tuple[int, int]:
    """Follow the almost complementary path of w = M z + q + d z0 from a large z0 until z0 leaves the basis.

    Bounds are first reduced to more unknowns, and the problem is scaled to a unit diagonal and max |q| = 1. The columns of
    the tableau are the nonbasic variables, initially z and z0, then the constant. The solution is recomputed from M and q
    for the final basis, so that rounding does not accumulate over the pivots. A ray that certifies infeasibility ends the
    method; after any other ray, a basis that recurs, or a residual above tolerance, it restarts with another d, and finally
    with independent scalings of w and z.
    """
    N = W
    p = q
    row = np.arange(len(q))
    sign = np.ones(len(q))
    base = np.zeros(len(q))
    if not is_plain(lower, upper):
        N, p, row, sign, base = to_lcp(W, q, lower, upper)
    note_problem(N, p)
    n = len(p)
    zero = np.zeros(n)
    infinite = np.full(n, np.inf)
    y = np.zeros(n)
    side = np.empty(n, np.int64)
    T = np.empty((n, n + 2))
    inside = np.empty(n, np.int64)
    outside = np.empty(n + 1, np.int64)
    path = LemkePath(T, inside, outside, np.empty(n), np.empty(n), np.empty(n))
    status = SOLVED
    count = 0
    attempt = 0
    for i in range(n):
        status = UNDECIDED if p[i] < 0.0 else status
    while status == UNDECIDED and attempt < 2 * MAX_COVERINGS:
        attempt += 1
        size, r = cover(N, p, path, attempt)
        status, count, c = follow(path, r, size, y, count, max_iter)
        if status == SOLVED:
            side[:] = LOWER
            for k in inside:
                if k >= n:
                    side[k - n] = FREE
            holds = polish(N, p, zero, infinite, side, y, tol)
            status = SOLVED if holds or attempt == 2 * MAX_COVERINGS else UNDECIDED
        elif status == RAY:
            ray_direction(path, c, y)
            status = RAY if proves_infeasible(N, p, zero, infinite, y) else UNDECIDED
    for i in range(len(q)):
        z[i] = 0.0 if status == RAY else base[i]
    from_lcp(row, sign, y, z)
    if status != RAY:
        for i in range(len(q)):
            z[i] = min(max(z[i], lower[i]), upper[i])
    return status, count


@compiled(most=FEW_ROWS)
def without_equations(
    W: Matrix, q: Vector, lower: Vector, upper: Vector, z: Vector, tol: float, max_iter: int
) -> tuple[int, int]:
    """Eliminate the equations by block pivots, and follow the path of the rest; the solution is recomputed from M and q."""
    n = len(q)
    problem = eliminate_equations(W, q, lower, upper)
    if len(problem.kept) == n:
        return UNDECIDED, 0
    M, p, low, high = remaining(problem, lower, upper)
    x, side = np.zeros(len(p)), np.empty(n, np.int64)
    status, count = follow_paths(M, p, low, high, x, tol, max_iter)
    if status == RAY:
        restore_ray(problem, x, z)
        return (RAY if proves_infeasible(W, q, lower, upper, z) else UNDECIDED), count
    restore(problem, x, lower, upper, z, side)
    holds = polish(W, q, lower, upper, side, z, tol)
    return (SOLVED if holds else status if status != SOLVED else UNDECIDED), count


@compiled(most=FEW_ROWS)
def lemke(W: Matrix, q: Vector, lower: Vector, upper: Vector, z: Vector, tol: float, max_iter: int) -> tuple[int, int]:
    """Solve by `without_equations`; where there are none, or it does not decide, by `follow_paths` of the whole problem."""
    status, count = UNDECIDED, 0
    if has_equations(lower, upper):
        status, count = without_equations(W, q, lower, upper, z, tol, max_iter)
    if status != SOLVED and status != RAY:
        status, more = follow_paths(W, q, lower, upper, z, tol, max_iter)
        count += more
    return status, count


SOLVER = CompiledSolver(
    name="lemke",
    summary="lexicographic complementary pivoting; takes singular, non-symmetric and copositive M, and bounds",
    requires=(),
    storages=("dense",),
    boxed=True,
    tol=1e-10,
    max_iter=10_000,
    source="Lemke1965; CottlePangStone2009, section 4.4",
    kernel=lemke,
)
