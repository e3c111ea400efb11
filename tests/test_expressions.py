"""Code as nodes: what is printed has the order of operations and the value of the expression, in each language."""

from __future__ import annotations

import ast
import json
import math
import shutil
import subprocess

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lcpimpact.expressions import (
    INFINITY,
    TRUE,
    Assign,
    Constant,
    Name,
    Unless,
    When,
    assigned,
    carried,
    equal,
    every,
    expression,
    in_turn,
    largest,
    names,
    operation,
    replaced,
    select,
    smallest,
)
from lcpimpact.integrators.printed.javascript import javascript

NAMES = "abc"
OF_NUMBERS = ("+", "-", "*", "/", "max", "min")
COMPARED = ("<", "<=", ">", ">=", "==", "!=")
a, b, c = map(Name, NAMES)

NODE = """
const min = (a, b) => b < a ? b : a, max = (a, b) => b > a ? b : a, abs = Math.abs;
const given = JSON.parse(require("node:fs").readFileSync(0, "utf8"));
console.log(JSON.stringify(given.map(([text, a, b, c]) => String(new Function("min,max,abs,a,b,c", "return " + text)(min, max, abs, a, b, c)))));
"""  # noqa: E501


@st.composite
def conditions(draw, depth):
    kind = draw(st.sampled_from((*COMPARED, "and", "or", "not")))
    if depth == 0 or kind in COMPARED:
        return operation(kind if kind in COMPARED else "<", draw(numbers(depth - 1)), draw(numbers(depth - 1)))
    return operation(kind, *(draw(conditions(depth - 1)) for _ in range(1 if kind == "not" else 2)))


@st.composite
def numbers(draw, depth):
    kind = draw(st.sampled_from((*OF_NUMBERS, "sign", "abs", "if", "leaf")))
    if depth <= 0 or kind == "leaf":
        leaves = (*map(Name, NAMES), *map(expression, (-2.0, -0.0, 0.0, 1e-9, 3.0, math.inf)))
        return draw(st.sampled_from(leaves))
    if kind == "if":
        return select(draw(conditions(depth - 1)), draw(numbers(depth - 1)), draw(numbers(depth - 1)))
    if kind in ("sign", "abs"):
        return operation("-" if kind == "sign" else kind, draw(numbers(depth - 1)))
    return operation(kind, draw(numbers(depth - 1)), draw(numbers(depth - 1)))


def value(node, known):
    """The value of an expression by its nodes alone."""
    if isinstance(node, Name):
        return known[node.name]
    if isinstance(node, Constant):
        return float(node.text)
    if node.operation == "if":
        condition, x, y = node.operands
        return value(x if value(condition, known) else y, known)
    operands = [value(each, known) for each in node.operands]
    if node.operation == "-" and len(operands) == 1:
        return -operands[0]
    both = {
        "+": lambda x, y: x + y, "-": lambda x, y: x - y, "*": lambda x, y: x * y, "/": quotient, "max": max, "min": min,
        "<": lambda x, y: x < y, "<=": lambda x, y: x <= y, ">": lambda x, y: x > y, ">=": lambda x, y: x >= y,
        "==": lambda x, y: x == y, "!=": lambda x, y: x != y,
    }  # fmt: skip
    others = {"and": lambda *x: all(x), "or": lambda *x: any(x), "not": lambda x: not x, "abs": abs}
    return (both | others)[node.operation](*operands)


def quotient(x, y):
    """The quotient of IEEE, which Python refuses by zero."""
    return x / y if y else math.nan if x == 0.0 or x != x else math.copysign(math.inf, x) * math.copysign(1.0, y)


class Real(float):
    """A float that divides by zero as compiled code does."""

    def __truediv__(self, other):
        return Real(quotient(float(self), float(other)))

    def __rtruediv__(self, other):
        return Real(quotient(float(other), float(self)))


def real(operation):
    """An operation of floats whose result is a `Real`."""
    return lambda *x: Real(operation(*x))


for name in ("add", "radd", "sub", "rsub", "mul", "rmul", "neg", "abs"):
    setattr(Real, f"__{name}__", real(getattr(float, f"__{name}__")))


class WithReals(ast.NodeTransformer):
    """Python in which each constant is a `Real`."""

    def visit_Constant(self, node):
        return ast.Call(ast.Name("Real", ast.Load()), [node], [])


def same(x, y):
    return repr(float(x)) == repr(float(y))


@given(numbers(4), st.tuples(*[st.sampled_from((-1.5, -0.0, 0.0, 0.1, 0.3, 7.0, math.inf, math.nan))] * 3))
def test_python_has_the_value_of_the_nodes(node, values):
    known = dict(zip(NAMES, map(Real, values), strict=True))
    tree = ast.fix_missing_locations(WithReals().visit(ast.parse(str(node), mode="eval")))
    names = {**known, "Real": Real, "INFINITY": Real(math.inf)}
    assert same(eval(compile(tree, "text", "eval"), names), value(node, known))


@pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")
def test_javascript_has_the_value_of_the_nodes():
    cases = []

    @settings(max_examples=200)
    @given(numbers(4), st.tuples(*[st.sampled_from((-1.5, 0.0, 0.1, 0.3, 7.0))] * 3))
    def collect(node, values):
        cases.append((node, values))

    collect()
    sent = json.dumps([[javascript(node), *values] for node, values in cases])
    done = subprocess.run(["node", "-e", NODE], input=sent, capture_output=True, text=True, check=True, timeout=60)
    found = [float(each.replace("Infinity", "inf").replace("NaN", "nan")) for each in json.loads(done.stdout)]
    assert len(found) == len(cases) > 100
    for (node, values), theirs in zip(cases, found, strict=True):
        ours = float(value(node, dict(zip(NAMES, values, strict=True))))
        assert theirs == ours or (theirs != theirs and ours != ours), javascript(node)


def test_the_order_of_operations_is_kept():
    assert str(a - (b - c) - -a * (b / c)) == "a - (b - c) - -a * (b / c)"
    assert javascript(a - (b - c) - -a * (b / c)) == "a-(b-c)- -a*(b/c)"
    either = (a >= 0.0) & ((a < INFINITY) | ~equal(b, -1.0))
    assert str(either) == "a >= 0.0 and (a < INFINITY or not b == -1.0)"
    assert javascript(either) == "a>=0&&(a<Infinity||!(b===-1))"
    assert javascript(select(a < 1e-9, b, -2.5)) == "(a<1e-09?b:-2.5)"
    assert str(-(a + b) / smallest(a, 1.0)) == "-(a + b) / min(a, 1.0)"


def test_what_is_true_leaves_no_trace():
    assert operation("and", TRUE, a < b) == (a < b)
    assert every([]) == operation("or", a < b, TRUE) == TRUE
    assert select(TRUE, a, b) == a
    assert replaced(largest(a, b) + c, {a: c}) == largest(c, b) + c


def test_a_condition_is_not_asked_for_its_truth():
    with pytest.raises(TypeError, match="neither true nor false"):
        max(a, b)


def test_zeros_of_two_signs_are_two_numbers():
    assert expression(0.0) != expression(-0.0)
    assert expression(1.0) != TRUE == expression(True)


def test_equal_parts_are_computed_once():
    shared = a * b + c
    lines = in_turn({"x": shared / a, "y": shared - shared * c}, "s")
    assert [*map(str, lines)] == ["s0 = a * b + c", "x = s0 / a", "y = s0 - s0 * c"]


def test_a_step_carries_only_what_it_reads_before_it_sets_it():
    step = [
        Assign("a", b + 0.0),
        When(a > c, (Assign("c", a), Assign("d", c + 0.0))),
        Unless(Name("g") < a),
        Assign("f", Name("d") * 1.0),
        Assign("b", Name("e") + 0.0),
    ]
    assert carried(step) == {"b", "c", "d"}
    assert assigned(step) == {"a", "b", "c", "d", "f"}
    assert names(b / c - Name("g")) == {"b", "c", "g"}
