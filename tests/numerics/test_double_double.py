"""Double-doubles with derivatives, against differences of double-doubles."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from lcpimpact.numerics.double_double import (
    ONE_BY_ONE,
    DoubleDouble,
    lifted,
    on_whole,
    product,
    product_by_columns,
    stacked,
    with_slopes,
)
from lcpimpact.numerics.elimination import solve_finely


def formulas(A, b, c):
    """Results of all operations on a matrix (4, 4), a matrix (4, 2) and a vector (2,)."""
    X = solve_finely(A, b)
    Y = A @ X * 2.0 - X + b @ X.T @ b
    yield (c - Y) * c / (c + 3.0)
    yield stacked([[Y, np.ones((4, 1))], [A[:1, :3]]]) @ np.arange(3.0)
    yield solve_finely(A[:2, :2], c) @ c
    yield 2.0 * (np.ones((3, 4)) @ b) + c


@pytest.mark.parametrize("kept", [(1, 1, 1), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1)])
def test_derivatives_by_several_parameters(kept):
    rng = np.random.default_rng(0)
    values = [rng.normal(size=shape) for shape in ((4, 4), (4, 2), (2,))]
    slopes = [rng.normal(size=(3, *value.shape)) * factor for value, factor in zip(values, kept, strict=True)]
    given = [
        with_slopes(value, slope) if factor else DoubleDouble.of(value)
        for value, slope, factor in zip(values, slopes, kept, strict=True)
    ]
    h = 2.0**-34  # the error of the differences is h², that of rounding 1e-32/h
    for k in range(3):
        sides = [
            formulas(*(DoubleDouble.of(value) + slope[k] * side for value, slope in zip(values, slopes, strict=True)))
            for side in (h, -h)
        ]
        for found, plus, minus in zip(formulas(*given), *sides, strict=True):
            there = ((plus - minus) / (2.0 * h)).hi
            here = DoubleDouble(lifted(found, 8)).slopes.hi[k]
            assert_allclose(here, there, rtol=1e-13, atol=1e-14)


def test_values_are_those_without_derivatives():
    rng = np.random.default_rng(1)
    values = [rng.normal(size=shape) for shape in ((4, 4), (4, 2), (2,))]
    carried = [with_slopes(value, np.ones((1, *value.shape))) for value in values]
    for one, other in zip(formulas(*carried), formulas(*map(DoubleDouble.of, values)), strict=True):
        assert (one.value.parts == other.parts).all()
        assert one.slopes.shape == (1, *other.shape) or not other.slopes.parts.size


@pytest.mark.parametrize("kept", [(0, 0), (3, 3), (3, 0), (0, 3)])
@pytest.mark.parametrize("shape", [(4, 5, 3), (2, 0, 3), (0, 2, 2)])
def test_the_interpreter_gives_the_same_bits(kept, shape):
    n, m, q = shape
    rng = np.random.default_rng(2)
    A, B = (
        with_slopes(rng.normal(size=size), rng.normal(size=(p, *size))) / 3.0
        for p, size in zip(kept, ((n, m), (m, q)), strict=True)
    )
    A.parts[0, : n // 2, : m // 2] = 0.0
    assert_array_equal(product(A.parts, B.parts), product_by_columns(A.parts, B.parts))
    length = 2 + 2 * max(kept)
    a, b = (lifted(DoubleDouble(each.parts.reshape(len(each.parts), -1)[:, : n * q]), length) for each in (A, B))
    a, b = (np.ascontiguousarray(each[:, : min(a.shape[1], b.shape[1])]) for each in (a, b))
    for operation in ONE_BY_ONE:
        assert_array_equal(operation(a, b), on_whole(operation, a, b))
