r"""The Hausdorff distance between filled-in graphs of discontinuous functions.

.. math:: d(A, B) = \max\Bigl(\sup_{a \in A} \inf_{b \in B} |a - b|_\infty,\;
                               \sup_{b \in B} \inf_{a \in A} |a - b|_\infty\Bigr)

A graph is a polyline, vertical where the function jumps. The distance of a point from a segment is a convex function of the
point, so over a piece of the other graph it is bounded by its values at the ends. Branch and bound: pieces whose bound does
not exceed the value reached are discarded, others halved. The supremum is thus computed, not sampled.
"""

from __future__ import annotations

import numpy as np

from lcpimpact.arrays import Array, Matrix
from lcpimpact.compiled import compiled
from lcpimpact.errors import FailureError

SUPREMUM_RTOL = 1e-13
"""Gap between the bounds of a supremum, relative to the size of the graphs, at which it has converged."""

MAX_PIECES = 20_000_000
"""Maximum number of pieces of a graph."""


def polyline(start: Array, length: Array, c: Array, tolerance: float) -> Array:
    """Return the points (np, 2) of a polyline within ``tolerance`` of a graph.

    Parameters
    ----------
    start, length : (nk,) arrays    pieces, in order
    c : (nk, p + 1) array           Chebyshev coefficients on each
    tolerance : float

    Raises
    ------
    FailureError
        If it would have more than `MAX_PIECES` pieces.
    """
    k = np.arange(c.shape[1])
    # |T_k''| <= k² (k² - 1)/3, and a chord of length 2/m on [-1, 1] deviates by at most (2/m)²/8 |f''|.
    bend = np.abs(c) @ (k**2 * (k**2 - 1.0) / 3.0)
    wanted = np.maximum(1.0, np.ceil(np.sqrt(0.5 * bend / tolerance)))
    if not wanted.sum() <= MAX_PIECES:
        raise too_many_pieces()
    parts = wanted.astype(np.int64)
    points = parts + 1
    piece = np.repeat(np.arange(len(parts)), points)
    place = np.arange(len(piece)) - np.repeat(np.cumsum(points) - points, points)
    s = 2.0 * place / parts[piece] - 1.0
    values = np.zeros(len(piece))
    after = np.zeros(len(piece))
    for j in range(c.shape[1] - 1, 0, -1):  # Clenshaw's recursion
        values, after = c[piece, j] + 2.0 * s * values - after, values
    values = c[piece, 0] + s * values - after
    return np.column_stack([start[piece] + 0.5 * length[piece] * (1.0 + s), values])


@compiled()
def to_segment(x: float, y: float, B: Matrix, j: int) -> float:
    """Return the distance of a point from the segment j of a polyline, in the maximum norm.

    ``max(|a - b s|, |c - d s|)`` is minimal at an end, where a term is zero, or where both are equal.
    """
    a, c = x - B[j, 0], y - B[j, 1]
    b, d = B[j + 1, 0] - B[j, 0], B[j + 1, 1] - B[j, 1]
    least: float = min(max(abs(a), abs(c)), max(abs(a - b), abs(c - d)))
    for numerator, denominator in ((a, b), (c, d), (a - c, b - d), (a + c, b + d)):
        if denominator != 0.0:
            s = min(max(numerator / denominator, 0.0), 1.0)
            least = min(least, max(abs(a - b * s), abs(c - d * s)))
    return least


@compiled()
def segment_at(x: float, B: Matrix) -> int:
    """Return the last segment of a polyline that begins at or before x."""
    low, high = 0, len(B) - 1
    while high - low > 1:
        middle = (low + high) // 2
        if B[middle, 0] <= x:
            low = middle
        else:
            high = middle
    return low


@compiled()
def nearest_segment(x: float, y: float, B: Matrix) -> int:
    """Return the segment of a polyline nearest to a point, searching both ways from its abscissa."""
    here, last = segment_at(x, B), len(B) - 2
    best, least = here, to_segment(x, y, B, here)
    for way in (1, -1):
        j = here + way
        while 0 <= j <= last:
            away = B[j, 0] - x if way > 0 else x - B[j + 1, 0]
            if away > least:
                break
            distance = to_segment(x, y, B, j)
            if distance < least:
                best, least = j, distance
            j += way
    return best


@compiled(most=0)
def farthest(A: Matrix, B: Matrix, reached: float, most: int) -> float:
    """Return the largest distance from B of a point of A, or ``reached`` if that is larger.

    Both are polylines of at least two points with non-decreasing times. NaN if this takes more than ``most`` pieces.
    """
    stack = np.empty((64, 4))
    pieces = 0
    for i in range(len(A) - 1):
        stack[0, 0] = A[i, 0]
        stack[0, 1] = A[i, 1]
        stack[0, 2] = A[i + 1, 0]
        stack[0, 3] = A[i + 1, 1]
        depth = 1
        while depth > 0:
            depth -= 1
            pieces += 1
            if pieces > most:
                return np.nan
            x0, y0, x1, y1 = stack[depth]
            j = segment_at(0.5 * (x0 + x1), B)
            if max(to_segment(x0, y0, B, j), to_segment(x1, y1, B, j)) <= reached:
                continue
            first = nearest_segment(x0, y0, B)
            second = nearest_segment(x1, y1, B)
            d0 = to_segment(x0, y0, B, first)
            d1 = to_segment(x1, y1, B, second)
            reached = max(reached, d0, d1)
            above = min(max(d0, to_segment(x1, y1, B, first)), max(to_segment(x0, y0, B, second), d1))
            if above <= reached * (1.0 + SUPREMUM_RTOL) + SUPREMUM_RTOL or depth + 2 > len(stack):
                continue
            x, y = 0.5 * (x0 + x1), 0.5 * (y0 + y1)
            stack[depth, 0] = x
            stack[depth, 1] = y
            stack[depth, 2] = x1
            stack[depth, 3] = y1
            stack[depth + 1, 0] = x0
            stack[depth + 1, 1] = y0
            stack[depth + 1, 2] = x
            stack[depth + 1, 3] = y
            depth += 2
    return reached


def hausdorff(A: Array, B: Array) -> float:
    """Return the Hausdorff distance of two polylines (na, 2) and (nb, 2) with non-decreasing first columns.

    Examples
    --------
    >>> import numpy as np
    >>> step, late = ([[0, 0], [t, 0], [t, 1], [1, 1]] for t in (0.5, 0.6))
    >>> round(hausdorff(np.array(step, dtype=float), np.array(late, dtype=float)), 12)
    0.1

    Raises
    ------
    FailureError
        If this takes more than `MAX_PIECES`.
    """
    A = np.ascontiguousarray(A, dtype=np.float64)
    B = np.ascontiguousarray(B, dtype=np.float64)
    found = float(farthest(B, A, farthest(A, B, 0.0, MAX_PIECES), MAX_PIECES))
    if np.isnan(found):
        raise too_many_pieces()
    return found


def too_many_pieces() -> FailureError:
    """Return the error for graphs with too many oscillations."""
    return FailureError(
        f"the distance of the graphs would take more than {MAX_PIECES:,} pieces: the runs turn too often, or hold noise; "
        "take a shorter t_end, or name other norms",
        None,
    )
