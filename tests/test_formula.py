"""Formulas: what a computation makes of its parameters, repeated for others."""

from __future__ import annotations

import math
import operator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from lcpimpact.formula import Formula, NotTracedError, Program, atan2, mentions, sqrt, value_of

POSITIVE = st.floats(0.1, 10.0)


def computation(a, b, c):
    """Arithmetic with zeros, ones, repetitions and cases."""
    x = (a + 0.0) * 1.0 - b / c
    y = abs(x) + sqrt(b * c) if x < a * b else -x * 0.5 + c
    z = max(x, y) * min(b, 2.0) + 0.0 * a
    return z - (x - y) / (1.0 + b * b), y if z >= 1.0 else 1.0 * c


def evaluated(program, results, values):
    names = {"sqrt": math.sqrt, "abs": abs, "INFINITY": math.inf} | {f"p{i}": each for i, each in enumerate(values)}
    found = {f"r{i}": each for i, each in enumerate(results)}
    exec("\n".join(map(str, program.assignments(found))), names)
    return [names[name] for name in found], all(eval(str(each), names) for each in program.assumptions())


@given(st.tuples(POSITIVE, POSITIVE, POSITIVE), st.tuples(POSITIVE, POSITIVE, POSITIVE))
def test_formulas_repeat_a_computation_bit_for_bit_where_its_assumptions_hold(first, second):
    program = Program()
    results = computation(*map(program.parameter, first))
    assert tuple(map(value_of, results)) == computation(*first)
    found, holds = evaluated(program, results, second)
    if holds:
        assert tuple(found) == computation(*second)
    assert evaluated(program, results, first) == (list(computation(*first)), True)


def test_another_case_is_told_by_the_assumptions():
    program = Program()
    x = program.parameter(1.0)
    result = 2.0 * x if x < 3.0 else 5.0 * x
    assert evaluated(program, [result], [2.5]) == ([5.0], True)
    assert evaluated(program, [result], [3.5])[1] is False


@pytest.mark.parametrize("compare", [operator.lt, operator.le, operator.gt, operator.ge, operator.eq, operator.ne])
def test_comparisons_are_told_apart_at_ties_too(compare):
    pairs = [(1.0, 2.0), (2.0, 2.0), (3.0, 2.0)]
    for traced in pairs:
        program = Program()
        found = compare(*map(program.parameter, traced))
        assert found is compare(*traced)
        for pair in pairs:
            assert evaluated(program, [], pair)[1] is (compare(*pair) is found)


def test_matrices_of_formulas_multiply_and_equal_terms_are_computed_once():
    program = Program()
    k, c = program.parameter(2.0), program.parameter(3.0)
    A = np.array([[k, 0.0], [-k, c]], dtype=object)
    B = A @ np.array([[1.0, 0.0], [0.0, 1.0]])
    assert all(isinstance(B[i, j], Formula) for i, j in [(0, 0), (1, 0), (1, 1)])
    assert B[0, 1] == 0.0
    before = len(program.lines)
    assert (k * c).name == (k * c).name
    assert len(program.lines) == before + 1


@pytest.mark.parametrize("lose", [float, int, math.sin, lambda x: x**2, lambda x: x % 2.0, round, "{:g}".format])
def test_what_would_lose_a_formula_is_refused(lose):
    with pytest.raises(NotTracedError):
        lose(Program().parameter(1.0))


def test_formulas_are_found_in_dataclasses_and_tuples():
    import lcpimpact as li

    p = Program().parameter(1.0)
    assert mentions(p)
    assert mentions((1.0, [p]))
    assert mentions(li.Mass("x", p))
    assert not mentions(li.Mass("x", 1.0))


def test_slopes_are_those_of_differences():
    def formula(a, b):
        return abs(sqrt(a * a + 2.0 / b) - 3.0 * a) / (b - 0.5) - math.floor(b)

    program = Program()
    a, b = program.parameter(1.25), program.parameter(2.5)
    result = formula(a, b)
    found, h = program.slopes()[result.name], 1e-5
    there = [
        (formula(1.25 + h, 2.5) - formula(1.25 - h, 2.5)) / (2.0 * h),
        (formula(1.25, 2.5 + h) - formula(1.25, 2.5 - h)) / (2.0 * h),
    ]
    assert found == pytest.approx(there, rel=1e-9)
    assert not program.kinks().any()


@pytest.mark.parametrize(
    ("tie", "kinks"),
    [
        (lambda a, b: a <= 1.0, [True, False]),
        (lambda a, b: a > b, [False, False]),
        (lambda a, b: 2.0 * a == b, [True, True]),
        (lambda a, b: abs(b - 2.0), [False, True]),
        (lambda a, b: sqrt(a - 1.0), [True, False]),
        (lambda a, b: math.floor(b), [False, True]),
        (lambda a, b: a + b <= a + b, [False, False]),
    ],
)
def test_kinks_are_where_another_case_begins(tie, kinks):
    program = Program()
    tie(program.parameter(1.0), program.parameter(2.0))
    assert program.kinks().tolist() == kinks


def test_elementary_functions_have_derivatives_and_are_not_printed():
    program = Program(elementary=True)
    x, y = program.parameter(0.7), program.parameter(-0.4)
    found = atan2(np.sin(x), np.exp(y)) * np.cos(x)
    s, c, e = math.sin(0.7), math.cos(0.7), math.exp(-0.4)
    angle = math.atan2(s, e)
    assert found.value == angle * c
    assert_allclose(
        program.slopes()[found.name], [c * c * e / (s * s + e * e) - angle * s, -c * s * e / (s * s + e * e)]
    )
    with pytest.raises(NotTracedError, match="exp of a formula"):
        np.exp(Program().parameter(1.0))
