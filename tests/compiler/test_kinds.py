"""Types of annotations in compiled code: all of the package, and those that say too little."""

import importlib
import pkgutil
from collections.abc import Callable
from types import FunctionType
from typing import NamedTuple

import pytest

import lcpimpact
from lcpimpact.arrays import Array, FlagMatrix, Flags, Indices, Matrix, Places, Stack, Vector
from lcpimpact.compiled import ByAddress
from lcpimpact.compiler.kinds import (
    FLAG,
    NONE,
    REAL,
    UNSIGNED,
    WHOLE,
    ArrayKind,
    FunctionKind,
    TupleKind,
    function_kind,
    kind_of,
)


class Body(NamedTuple):
    m: float
    q: Vector
    H: Matrix
    kinds: tuple[Flags, Places]


VECTOR = ArrayKind(REAL, 1)
BODY = TupleKind((REAL, VECTOR, ArrayKind(REAL, 2), TupleKind((ArrayKind(FLAG, 1), ArrayKind(UNSIGNED, 1)))), Body)


def momentum(body: Body, v: Vector, node: int) -> tuple[float, bool]: ...


def find(body: Body, v) -> None: ...


def test_types_are_those_of_the_values():
    kinds = {
        bool: FLAG, int: WHOLE, float: REAL, None: NONE, Vector: VECTOR, Matrix: ArrayKind(REAL, 2),
        Stack: ArrayKind(REAL, 3), Indices: ArrayKind(WHOLE, 1), FlagMatrix: ArrayKind(FLAG, 2),
        tuple[int, int]: TupleKind((WHOLE, WHOLE)), Body: BODY,
    }  # fmt: skip
    for hint, kind in kinds.items():
        assert kind_of(hint) == kind, hint


def test_types_of_functions_are_those_of_the_annotations():
    expected = FunctionKind((BODY, VECTOR, WHOLE), TupleKind((REAL, FLAG)))
    assert function_kind(momentum) == expected
    solver = Callable[[Body, Vector, int], tuple[float, bool]]
    assert kind_of(solver) == expected
    assert kind_of(ByAddress[solver]) == WHOLE
    assert kind_of(Callable[[int], None]) == FunctionKind((WHOLE,), NONE)


def test_annotations_that_say_too_little_are_refused():
    for hint in (Array, list[int], str):
        with pytest.raises(TypeError, match="has no type in compiled code"):
            kind_of(hint)
    with pytest.raises(KeyError, match="v"):
        function_kind(find)


@pytest.mark.compiled
def test_every_compiled_function_has_a_type():
    names = [each.name for each in pkgutil.walk_packages(lcpimpact.__path__, "lcpimpact.")]
    members = [vars(importlib.import_module(name)).values() for name in names if not name.endswith("__main__")]
    functions = {
        each.py_func
        for values in members
        for each in values
        if type(getattr(each, "py_func", None)) is FunctionType and hasattr(each, "declared")
    }
    own = [each for each in functions if each.__annotations__ and each.__module__ != "lcpimpact.compiled"]
    own = [each for each in own if each.__module__.startswith("lcpimpact.")]
    assert len(own) > 300
    for each in own:
        assert len(function_kind(each).takes) == each.__code__.co_argcount
