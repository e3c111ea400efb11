"""Dense and banded storage of M in compiled solvers, distinguished by shape.

dense    (n, n)        any matrix
banded   (b + 1, n)    the lower bands of a symmetric matrix, b + 1 < n: W[k, j] = M[j + k, j]
"""

from __future__ import annotations

import numpy as np

from lcpimpact.arrays import Matrix, Vector
from lcpimpact.compiled import compiled
from lcpimpact.lcp.lapack import multiply
from lcpimpact.numerics.rounding import EPS


@compiled()
def entry(W: Matrix, i: int, j: int) -> float:
    """Return M_ij."""
    found: float = 0.0
    low, high = min(i, j), max(i, j)
    if W.shape[0] == W.shape[1]:
        found = W[i, j]
    elif high - low < W.shape[0]:
        found = W[high - low, low]
    return found


@compiled()
def product(W: Matrix, z: Vector, w: Vector) -> None:
    """Set w = M z."""
    bands, n = W.shape
    if bands == n:
        multiply(W, z, w)
        return
    for j in range(n):
        w[j] = W[0, j] * z[j]
    for k in range(1, bands):
        for j in range(n - k):
            w[j + k] += W[k, j] * z[j]
        for j in range(n - k):
            w[j] += W[k, j] * z[j + k]


@compiled()
def transposed_product(W: Matrix, v: Vector, c: Vector) -> None:
    """Set c = Mᵀ v."""
    bands, n = W.shape
    if bands != n:
        product(W, v, c)
        return
    c[:] = 0.0
    for i in range(n):
        for j in range(n):
            c[j] += W[i, j] * v[i]


@compiled()
def absolute_product(W: Matrix, z: Vector, c: Vector) -> None:
    """Set c = |M| |z|; ε c bounds the rounding error of M z."""
    bands, n = W.shape
    if bands == n:
        columns, count = np.empty(n, np.int64), 0
        for j in range(n):
            if z[j] != 0.0:
                columns[count] = j
                count += 1
        whole = n - n % 4
        for i in range(0, whole, 4):  # the sums of four rows do not wait for each other
            a = 0.0
            b = 0.0
            d = 0.0
            e = 0.0
            for k in range(count):
                j = columns[k]
                a += abs(W[i, j] * z[j])
                b += abs(W[i + 1, j] * z[j])
                d += abs(W[i + 2, j] * z[j])
                e += abs(W[i + 3, j] * z[j])
            c[i] = a
            c[i + 1] = b
            c[i + 2] = d
            c[i + 3] = e
        for i in range(whole, n):
            total = 0.0
            for k in range(count):
                total += abs(W[i, columns[k]] * z[columns[k]])
            c[i] = total
        return
    c[:] = 0.0
    for k in range(bands):
        for j in range(n - k):
            c[j + k] += abs(W[k, j] * z[j])
        for j in range(n - k if k > 0 else 0):
            c[j] += abs(W[k, j] * z[j + k])


@compiled()
def absolute_transposed_product(W: Matrix, v: Vector, c: Vector) -> None:
    """Set c = |M|ᵀ |v|."""
    bands, n = W.shape
    if bands != n:
        absolute_product(W, v, c)
        return
    c[:] = 0.0
    for i in range(n):
        for j in range(n):
            c[j] += abs(W[i, j] * v[i])


@compiled()
def spread(W: Matrix, j: int, x: float, c: Vector) -> None:
    """Add |M_·j x| to c."""
    bands, n = W.shape
    for i in range(0 if bands == n else max(0, j - bands + 1), n if bands == n else min(n, j + bands)):
        c[i] += abs(entry(W, i, j) * x)


@compiled()
def weight(W: Matrix, j: int, size: Vector) -> float:
    """Return max_i |M_ij| / size_i: the largest effect of a unit change of z_j on a row, relative to its size."""
    bands, n = W.shape
    found: float = 0.0
    for i in range(0 if bands == n else max(0, j - bands + 1), n if bands == n else min(n, j + bands)):
        value = abs(entry(W, i, j))
        if value > found * size[i]:
            found = value / size[i]
    return found


@compiled()
def column(W: Matrix, j: int, c: Vector) -> None:
    """Set c = M_·j."""
    bands, n = W.shape
    if bands == n:
        for i in range(n):
            c[i] = W[i, j]
        return
    c[:] = 0.0
    for i in range(max(0, j - bands + 1), min(n, j + bands)):
        c[i] = entry(W, i, j)


@compiled()
def diagonal(W: Matrix, d: Vector) -> None:
    """Set d = (M_ii)."""
    for i in range(len(d)):
        d[i] = entry(W, i, i)


@compiled()
def has_positive_diagonal(W: Matrix) -> bool:
    """Return whether every M_ii > 0."""
    positive = True
    for i in range(W.shape[1]):
        positive = positive and entry(W, i, i) > 0.0
    return positive


@compiled()
def row_product(W: Matrix, i: int, z: Vector) -> float:
    """Return M_i· z."""
    bands, n = W.shape
    total = 0.0
    if bands == n:
        for j in range(n):
            total += W[i, j] * z[j]
        return total
    for j in range(max(0, i - bands + 1), min(n, i + bands)):
        total += entry(W, i, j) * z[j]
    return total


@compiled()
def row_terms(W: Matrix, i: int, z: Vector) -> float:
    """Return |M_i·| |z|."""
    bands, n = W.shape
    total = 0.0
    for j in range(0 if bands == n else max(0, i - bands + 1), n if bands == n else min(n, i + bands)):
        total += abs(entry(W, i, j) * z[j])
    return total


@compiled()
def longest_row(W: Matrix) -> int:
    """Return the largest number of entries of a row."""
    bands, n = W.shape
    longest: int = min(n, 2 * bands - 1)
    return longest


@compiled()
def is_symmetric(W: Matrix) -> bool:
    """Return whether M is symmetric to |M_ij - M_ji| <= 1e-12 sqrt(|M_ii M_jj|), or to the rounding of M_ij."""
    bands, n = W.shape
    if bands != n:
        return True
    tile = 32  # tile size, so that the transposed half stays in cache
    for rows in range(0, n, tile):
        for columns in range(0, rows + 1, tile):
            for i in range(rows, min(n, rows + tile)):
                for j in range(columns, min(i, columns + tile)):
                    difference = abs(W[i, j] - W[j, i])
                    if difference > 4.0 * EPS * abs(W[i, j]) and difference > 1e-12 * (
                        np.sqrt(abs(W[i, i])) * np.sqrt(abs(W[j, j]))
                    ):
                        return False
    return True


@compiled()
def bandwidth(M: Matrix) -> int:
    """Return the largest |i - j| with M_ij != 0."""
    n = len(M)
    b = 0
    for i in range(n):
        for j in range(i - b):
            if M[i, j] != 0.0:
                b = i - j
                break
        for j in range(n - 1, i + b, -1):
            if M[i, j] != 0.0:
                b = j - i
                break
    return b
