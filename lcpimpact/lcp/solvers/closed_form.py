"""Closed-form solution of one or two rows by enumeration of the complementary bases."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.errors import Status
from lcpimpact.lcp.problem import FREE, LOWER, UPPER
from lcpimpact.lcp.solver import CompiledSolver
from lcpimpact.numerics.rounding import EPS

SOLVED = int(Status.SOLVED)
INFEASIBLE = int(Status.INFEASIBLE)
UNDECIDED = int(Status.UNDECIDED)


@compiled()
def one_row(m: float, q: float, lower: float, upper: float) -> tuple[float, float]:
    """Return z for the row m z + q with m <= 0 from the basis with the smallest residual z - P(z - w), and this residual."""
    z, smallest = 0.0, np.inf
    for basis in (LOWER, FREE, UPPER):
        trial = lower if basis == LOWER else upper if basis == UPPER else -q / m if m != 0.0 else 0.0
        if -np.inf < trial < np.inf:
            trial = min(max(trial, lower), upper)
            residual = abs(max(min(m * trial + q, trial - lower), trial - upper))
            if residual < smallest:
                z, smallest = trial, residual
    return z, smallest


@compiled(inline="always")
def select(condition: bool, a: float, b: float) -> float:
    """Return a under a condition, else b."""
    return a if condition else b


@compiled()
def both_free(a: float, b: float, c: float, d: float, f: float, g: float) -> tuple[float, float]:
    """Solve a x + b y + f = 0, c x + d y + g = 0 by elimination with partial pivoting; return inf if singular.

    Cramer's rule would be shorter but loses half of the digits at condition number 1e8.
    """
    swap = abs(a) < abs(c)
    A = select(swap, c, a)
    B = select(swap, d, b)
    F = select(swap, g, f)
    C = select(swap, a, c)
    D = select(swap, b, d)
    G = select(swap, f, g)
    multiplier = C / A
    rest = D - multiplier * B
    y = (multiplier * F - G) / rest
    x = -(F + B * y) / A
    regular = abs(rest) > 1e-15 * (abs(D) + abs(multiplier * B))
    return select(regular, x, np.inf), select(regular, y, np.inf)


class TwoRows(NamedTuple):
    """The rows a x + b y + f and c x + d y + g."""

    a: float
    b: float
    c: float
    d: float
    f: float
    g: float


@compiled()
def two_row_defect(rows: TwoRows, bounds: tuple[float, float, float, float], v: float, t: float) -> float:
    """Return the defect of x = v, y = t with l0 <= x <= u0, l1 <= y <= u1, each row scaled by its terms.

    The distance of a variable from a bound is measured by the change it causes in either row.
    """
    a = rows.a
    b = rows.b
    c = rows.c
    d = rows.d
    f = rows.f
    g = rows.g
    l0, l1, u0, u1 = bounds
    first = abs(a * v) + abs(b * t) + abs(f)
    second = abs(c * v) + abs(d * t) + abs(g)
    first = first if first > 0.0 else 1.0
    second = second if second > 0.0 else 1.0
    x = (a * v + b * t + f) / first
    y = (c * v + d * t + g) / second
    by_v = max(abs(a) / first, abs(c) / second)
    by_t = max(abs(b) / first, abs(d) / second)
    by_v = by_v if by_v > 0.0 else np.inf
    by_t = by_t if by_t > 0.0 else np.inf
    room_v = v - l0 if x > 0.0 else u0 - v
    room_t = t - l1 if y > 0.0 else u1 - t
    return max(min(abs(x), room_v * by_v if room_v > 0.0 else 0.0), min(abs(y), room_t * by_t if room_t > 0.0 else 0.0))


@compiled()
def two_rows(rows: TwoRows) -> tuple[float, float, bool, bool, bool, bool]:
    """Return x and y of a plain LCP of two rows, and whether a basis has unambiguous signs.

    In this order: neither row is free, the first, the second, both. There are no branches, so that steps are printed for
    many sets at once from a trace of these lines.
    """
    a = rows.a
    b = rows.b
    c = rows.c
    d = rows.d
    f = rows.f
    g = rows.g
    x, y = -f / a, -g / d
    neither = (f >= 0.0) & (g >= 0.0)
    first = (f < 0.0) & (a > 0.0) & (x * c + g >= 0.0)
    second = (g < 0.0) & (d > 0.0) & (y * b + f >= 0.0)
    x_both, y_both = both_free(a, b, c, d, f, g)
    both = (x_both >= 0.0) & (x_both < np.inf) & (y_both >= 0.0) & (y_both < np.inf)
    x = select(neither, 0.0, select(first, x, select(second, 0.0, x_both)))
    y = select(neither | first, 0.0, select(second, y, y_both))
    return x, y, neither, first, second, both


@compiled()
def closed_form(
    W: Matrix, q: Vector, lower: Vector, upper: Vector, z: Vector, tol: float, max_iter: int
) -> tuple[int, int]:
    """Solve one or two rows by enumerating their bases: each row at its lower bound, at its upper bound, or free.

    The data are scaled to max |M| = max |q| = 1 against overflow. The candidate with the smallest residual is accepted if
    within tol, so the result does not depend on rounding at a corner.
    """
    if len(q) == 1 and W[0, 0] > 0.0:
        z[0] = min(max(-q[0] / W[0, 0], lower[0]), upper[0])
        return SOLVED, 1
    p = abs(q[0]) if len(q) == 1 else max(abs(q[0]), abs(q[1]))
    p = p if p > 0.0 else 1.0
    if len(q) == 1:
        s = abs(W[0, 0]) if W[0, 0] != 0.0 else 1.0
        x, residual = one_row(W[0, 0] / s, q[0] / p, lower[0] * (s / p), upper[0] * (s / p))
        z[0] = min(max(x * (p / s), lower[0]), upper[0])
        return (SOLVED if residual <= tol else INFEASIBLE), 1

    if lower[0] == 0.0 and lower[1] == 0.0 and upper[0] == np.inf and upper[1] == np.inf:
        x, y, neither, first, second, both = two_rows(TwoRows(W[0, 0], W[0, 1], W[1, 0], W[1, 1], q[0], q[1]))
        if neither or first or second or both:
            z[0], z[1] = x, y
            return SOLVED, 1 if neither else 2 if first else 3 if second else 4
    s = max(max(abs(W[0, 0]), abs(W[0, 1])), max(abs(W[1, 0]), abs(W[1, 1])))
    s = s if s > 0.0 else 1.0
    u = s / p
    a = W[0, 0] / s
    b = W[0, 1] / s
    c = W[1, 0] / s
    d = W[1, 1] / s
    f = q[0] / p
    g = q[1] / p
    l0 = lower[0] * u
    l1 = lower[1] * u
    u0 = upper[0] * u
    u1 = upper[1] * u
    rows, bounds = TwoRows(a, b, c, d, f, g), (l0, l1, u0, u1)
    x = 0.0
    y = 0.0
    smallest = np.inf
    tried = 0
    for i in (LOWER, FREE, UPPER):
        for j in (LOWER, FREE, UPPER):
            v = l0 if i == LOWER else u0
            t = l1 if j == LOWER else u1
            if i == FREE and j == FREE:
                v, t = both_free(a, b, c, d, f, g)
            elif i == FREE:
                v = -(f + b * t) / a if a != 0.0 else 0.0
            elif j == FREE:
                t = -(g + c * v) / d if d != 0.0 else 0.0
            if not (abs(v) < np.inf and abs(t) < np.inf):
                continue
            tried += 1
            v, t = min(max(v, l0), u0), min(max(t, l1), u1)
            residual = two_row_defect(rows, bounds, v, t)
            if residual < smallest:
                x = v
                y = t
                smallest = residual
    z[0] = min(max(x / u, lower[0]), upper[0])
    z[1] = min(max(y / u, lower[1]), upper[1])
    if smallest <= tol:
        return SOLVED, tried
    # If rounding makes the best residual inconclusive, infeasibility is not proved.
    rounding = 8.0 * EPS * (1.0 + abs(x) + abs(y))
    return (UNDECIDED if smallest <= 10.0 * rounding else INFEASIBLE), tried


SOLVER = CompiledSolver(
    name="closed-form",
    summary="one or two rows by cases; what the paper's own steps need",
    requires=(),
    storages=("dense",),
    boxed=True,
    tol=1e-12,
    max_iter=9,
    source="enumeration of the complementary bases",
    largest=2,
    kernel=closed_form,
)
