"""Numba types of annotations: all of the package, and those that say too little."""

import importlib
import pkgutil
from collections.abc import Callable
from types import FunctionType
from typing import NamedTuple

import numpy as np
import pytest
from numba import typeof, types

import lcpimpact
from lcpimpact.arrays import Array, FlagMatrix, Flags, Indices, Matrix, Places, Stack, Vector
from lcpimpact.compiled import ByAddress, address_type
from lcpimpact.numba_types import numba_type, signature_of


class Body(NamedTuple):
    m: float
    q: Vector
    H: Matrix
    kinds: tuple[Flags, Places]


BODY = Body(1.0, np.zeros(2), np.zeros((1, 2)), (np.zeros(2, bool), np.zeros(2, np.uint64)))


def momentum(body: Body, v: Vector, node: int) -> tuple[float, bool]: ...


def find(body: Body, v) -> None: ...


def test_types_are_those_of_the_values():
    values = {
        bool: True, int: 1, float: 1.0, Vector: np.zeros(1), Matrix: np.zeros((1, 1)), Stack: np.zeros((1, 1, 1)),
        Indices: np.zeros(1, np.int64), FlagMatrix: np.zeros((1, 1), bool), tuple[int, int]: (1, 1), Body: BODY,
    }  # fmt: skip
    for hint, value in values.items():
        assert numba_type(hint) == typeof(value), hint


def test_signatures_are_those_of_the_annotations():
    body, vector, result = typeof(BODY), types.float64[::1], types.Tuple((types.float64, types.boolean))
    assert signature_of(momentum) == result(body, vector, types.int64)
    solver = Callable[[Body, Vector, int], tuple[float, bool]]
    assert numba_type(solver) == types.FunctionType(result(body, vector, types.int64))
    assert numba_type(ByAddress[solver]) == address_type(numba_type(solver))
    assert numba_type(Callable[[int], None]).signature == types.void(types.int64)


def test_annotations_that_say_too_little_are_refused():
    for hint in (Array, list[int], str):
        with pytest.raises(TypeError, match="has no numba type"):
            numba_type(hint)
    with pytest.raises(KeyError, match="v"):
        signature_of(find)


def test_every_compiled_function_has_a_signature():
    names = [each.name for each in pkgutil.walk_packages(lcpimpact.__path__, "lcpimpact.")]
    members = [vars(importlib.import_module(name)).values() for name in names if not name.endswith("__main__")]
    functions = {
        each.py_func for values in members for each in values if type(getattr(each, "py_func", None)) is FunctionType
    }
    # Of a function that takes what it is given, numba finds the types itself.
    own = [each for each in functions if each.__annotations__ and each.__module__ != "lcpimpact.compiled"]
    own = [each for each in own if each.__module__.startswith("lcpimpact.")]
    assert len(own) > 300
    for each in own:
        assert len(signature_of(each).args) == each.__code__.co_argcount
