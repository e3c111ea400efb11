"""Functions of the motion, traced once: they have derivatives as formulas, and are one straight-line text.

A user writes M(q), V(q) or a gap in NumPy's arithmetic and elementary functions. Called with arguments of a
`lcpimpact.formula.SymbolicProgram` such a function returns formulas, whose derivatives are formulas again: no step of a
difference quotient, no rounding, and nothing that the user must derive.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.expressions import Assign, Constant, Expression, Name, names, replaced
from lcpimpact.formula import Formula, NotTracedError, Number, SymbolicProgram, is_number
from lcpimpact.interpreter import function_of

LITERALS = ("0.0", "0.5", "1.0", "2.0")
"""Constants that are written in the text; others are arguments, so that systems with other constants share the text."""

SCALAR = {"atan2": math.atan2} | {name: getattr(math, name) for name in ("sqrt", "exp", "log", "sin", "cos")}
ELEMENTWISE = {"atan2": np.arctan2} | {name: getattr(np, name) for name in ("sqrt", "exp", "log", "sin", "cos")}


class NotArithmeticError(InputError, NotTracedError):
    """A function of the motion that is not arithmetic, in its arguments or in a parameter that is a formula."""


@dataclass(frozen=True, eq=False)
class MotionArguments:
    """The arguments t, q and v of functions of the motion, and what is traced of them.

    Attributes
    ----------
    program : SymbolicProgram
    t : Formula
    q, v : (n,) arrays of formulas
    """

    program: SymbolicProgram
    t: Formula
    q: Array
    v: Array

    @classmethod
    def of(cls, n: int) -> MotionArguments:
        """Return the arguments of a system with n coordinates."""
        program = SymbolicProgram()
        t = program.argument("t")
        q, v = (np.array([program.argument(f"{letter}{i}") for i in range(n)], dtype=object) for letter in "qv")
        return cls(program, t, q, v)

    def call(
        self, what: str, function: Callable[..., ArrayLike | Number], arguments: str, shape: tuple[int, ...]
    ) -> Array:
        """Return the formulas of a function of t, q and v, or of some of them, as an array of a shape.

        Raises
        ------
        InputError
            Naming the function, if it fails, is no arithmetic, or has another shape.
        """
        call = f"{what} (a function of {', '.join(arguments)})"
        given = {"t": self.t, "q": self.q.copy(), "v": self.v.copy()}
        # A function that numba has compiled holds the one that it was compiled from.
        function = getattr(function, "py_func", function)
        try:
            found = np.array(function(*(given[name] for name in arguments)), dtype=object)
        except (NotTracedError, np.exceptions.AxisError) as error:
            raise NotArithmeticError(f"{call} is not arithmetic: {error}; {REMEDY}") from error
        except Exception as error:
            raise InputError(f"{call} fails by {type(error).__name__} ({error}); {REMEDY}") from error
        if found.shape != shape:
            expected = f"an array of the shape {shape}" if shape else "a number"
            raise InputError(f"{call} returns an array of the shape {found.shape}: return {expected}")
        for each in found.flat:
            if not is_number(each) or not (isinstance(each, Formula) or math.isfinite(each)):
                raise InputError(f"{call} returns {each!r}: return finite numbers")
        return found

    def by(self, results: Array, arguments: Array) -> Array:
        """Return the derivatives (..., m) of formulas by m arguments."""
        columns = [self.program.derivatives(list(results.flat), each) for each in arguments]
        found = np.array(columns, dtype=object).reshape(len(arguments), *results.shape)
        return np.moveaxis(found, 0, -1)

    def rate(self, results: Array) -> Array:
        """Return the rate of change of formulas of t and q along the motion, ∂/∂t + v·∂/∂q."""
        by_t = np.array(self.program.derivatives(list(results.flat), self.t), dtype=object).reshape(results.shape)
        return np.asarray(self.by(results, self.q) @ self.v + by_t)


REMEDY = (
    "write it with +, -, *, /, ** and NumPy's np.sin, np.sqrt, np.exp, ... (np.sin in place of math.sin, "
    "np.array([...]) in place of assignments to np.zeros), without cases (if, np.where, np.maximum)"
)


@dataclass(frozen=True, eq=False)
class MotionFunction:
    """Arrays as functions of t, q and v.

    Attributes
    ----------
    traced : MotionArguments
    results : tuple of arrays of numbers and formulas
    """

    traced: MotionArguments
    results: tuple[Array, ...]

    @cached_property
    def numbers(self) -> list[Any]:
        """All results in turn."""
        return [each for result in self.results for each in result.flat]

    @cached_property
    def formulas(self) -> set[str]:
        """The names of the results that are formulas."""
        return {each.name for each in self.numbers if isinstance(each, Formula)}

    @cached_property
    def written(self) -> tuple[str, tuple[float, ...]]:
        """The lines of the text, with results r0, r1, ..., and the constants in it."""
        results = {f"r{i}": each for i, each in enumerate(self.numbers)}
        lines, constants = without_constants(self.traced.program.assignments(results, assumed=False))
        return "\n".join(map(str, lines)), tuple(constants)

    def at(self, point: str, program: SymbolicProgram) -> tuple[list[Array], list[Assign]]:
        """Return the results at a point as arguments of another program, and the assignments that compute these.

        All names are followed by that of the ``point``, those of t, q and v at it too.
        """
        results = {each.name: each for each in self.numbers if isinstance(each, Formula)}
        arguments = {name: program.argument(name + point) for name in results}
        lines = [
            Assign(
                line.name + point, replaced(line.value, {Name(each): Name(each + point) for each in names(line.value)})
            )
            for line in self.traced.program.assignments(results, assumed=False)
        ]
        found = [
            np.array([arguments.get(getattr(each, "name", ""), each) for each in result.flat], dtype=object)
            for result in self.results
        ]
        return [each.reshape(result.shape) for each, result in zip(found, self.results, strict=True)], lines

    def __call__(self, t: ArrayLike, q: ArrayLike, v: ArrayLike) -> list[Array]:
        """Return the results (..., shape) for t (...), q and v (..., n)."""
        text, constants = self.written
        q, v = np.asarray(q, dtype=np.float64), np.asarray(v, dtype=np.float64)
        one = q.ndim == 1 and np.ndim(t) == 0
        arguments = (
            (t, *q.tolist(), *v.tolist()) if one else (np.asarray(t), *np.moveaxis(q, -1, 0), *np.moveaxis(v, -1, 0))
        )
        given = tuple(each.name for each in self.traced.program.parameters)
        run = _function(text, given, len(constants), len(self.numbers), one)
        try:
            values = run(*arguments, *constants)
        except (ArithmeticError, ValueError):  # of floats, where arrays have NaN or infinities
            with np.errstate(all="ignore"):
                return [each[0] for each in self(np.array([t]), q[None], v[None])]
        shape = () if one else np.broadcast_shapes(np.shape(t), q.shape[:-1])
        table = np.empty((*shape, len(values)))
        for i, value in enumerate(values):
            table[..., i] = value
        ends = np.cumsum([result.size for result in self.results])[:-1]
        parts = np.split(table, ends, axis=-1)
        return [part.reshape(*shape, *result.shape) for part, result in zip(parts, self.results, strict=True)]


def without_constants(lines: Iterable[Assign]) -> tuple[list[Assign], list[float]]:
    """Return assignments with c0, c1, ... in place of constants other than `LITERALS`, and these."""
    constants: dict[Expression, Expression] = {}
    found = []
    for line in lines:
        for each in _constants(line.value):
            if each.text not in LITERALS:
                constants.setdefault(each, Name(f"c{len(constants)}"))
        found.append(Assign(line.name, replaced(line.value, constants)))
    return found, [float(str(each)) for each in constants]


def _constants(expression: Any) -> list[Constant]:
    """Return the constants of an expression."""
    if isinstance(expression, Constant):
        return [expression]
    return [found for each in getattr(expression, "operands", ()) for found in _constants(each)]


@cache
def _function(
    text: str, given: tuple[str, ...], constants: int, results: int, scalar: bool
) -> Callable[..., tuple[Any, ...]]:
    """Return the function of a text, of numbers or of arrays."""
    arguments = ", ".join([*given, *(f"c{i}" for i in range(constants))])
    found = ", ".join([*(f"r{i}" for i in range(results)), ""])
    lines = [
        f"def run({arguments}):",
        *(f"    {line}" for line in text.split("\n") if line),
        f"    return {found or '()'}",
    ]
    run: Callable[..., tuple[Any, ...]] = function_of("\n".join(lines), SCALAR if scalar else ELEMENTWISE)
    return run
