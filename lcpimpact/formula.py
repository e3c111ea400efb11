"""Numbers known as formulas: what a computation made of its arguments, so that it can be repeated for many at once.

A `Formula` is the result of arithmetic on the parameters of a `Program`. It has the value that belongs to one set of
parameters, and is compared by that value; the program remembers each comparison, since for other parameters the formulas
hold only where all comparisons come out as they did. What would lose the formula, such as a function that wants a float, is
refused.

Examples
--------
>>> program = Program()
>>> k, m = program.parameter(4.0), program.parameter(1.0)
>>> ω = sqrt(k / m) if k > 0.0 else 0.0
>>> print(*program.assignments({"ω": ω}), sep="; ")
t0 = p0 / p1; t1 = sqrt(t0); ω = t1
>>> print(*program.assumptions())
p0 > 0.0
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, NoReturn, TypeAlias, TypeGuard, overload

import numpy as np

from lcpimpact.arrays import Array, Flags
from lcpimpact.expressions import Assign, Constant, Expression, Name, Operation, names

OPERATIONS: dict[str, Callable[..., float]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "abs": abs,
    "sqrt": math.sqrt,
    "floor": math.floor,
    "exp": math.exp,
    "sin": math.sin,
    "cos": math.cos,
    "log": math.log,
    "atan2": math.atan2,
}

ELEMENTARY = ("exp", "log", "sin", "cos", "atan2")
"""The operations that have a derivative, and are not repeated by a printed program, in which their last bits may differ."""

PARTIALS: dict[str, Callable[..., tuple[float, ...]]] = {
    "+": lambda c, a, b: (1.0, 1.0),
    "-": lambda c, a, b: (1.0, -1.0),
    "*": lambda c, a, b: (b, a),
    "/": lambda c, a, b: (1.0 / b, -c / b),
    "abs": lambda c, a: (math.copysign(1.0, a),),
    "sqrt": lambda c, a: (0.5 / c if c else 0.0,),
    "floor": lambda c, a: (0.0,),
    "exp": lambda c, a: (c,),
    "sin": lambda c, a: (math.cos(a),),
    "cos": lambda c, a: (-math.sin(a),),
    "log": lambda c, a: (1.0 / a,),
    "atan2": lambda c, a, b: (b / (a * a + b * b), -a / (a * a + b * b)),
}
"""The derivatives of the result c of an operation by its operands; where it has none, see `Program.kinks`."""

COMPARISONS: dict[str, Callable[[float, float], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
}

NEGATIONS = {"<": ">=", "<=": ">", ">": "<=", ">=": "<", "==": "!="}


class NotTracedError(TypeError):
    """A computation that is not arithmetic, so that it cannot be repeated as a formula."""


@dataclass(frozen=True, eq=False, slots=True)
class Formula:
    """A number as a result of arithmetic.

    Attributes
    ----------
    program : Program
    name : str          of the variable in the program that holds it
    value : float       for the parameters with which the program was traced
    """

    program: Program = field(repr=False)
    name: str
    value: float

    def __add__(self, other: Number) -> Number:
        return self.program.apply("+", self, other)

    def __radd__(self, other: Number) -> Number:
        return self.program.apply("+", other, self)

    def __sub__(self, other: Number) -> Number:
        return self.program.apply("-", self, other)

    def __rsub__(self, other: Number) -> Number:
        return self.program.apply("-", other, self)

    def __mul__(self, other: Number) -> Number:
        return self.program.apply("*", self, other)

    def __rmul__(self, other: Number) -> Number:
        return self.program.apply("*", other, self)

    def __truediv__(self, other: Number) -> Number:
        return self.program.apply("/", self, other)

    def __rtruediv__(self, other: Number) -> Number:
        return self.program.apply("/", other, self)

    def __neg__(self) -> Number:
        return self.program.apply("-", 0.0, self)

    def __abs__(self) -> Number:
        return self.program.apply("abs", self)

    def sqrt(self) -> Number:
        """Return the square root."""
        return self.program.apply("sqrt", self)

    def exp(self) -> Number:
        """Return the exponential function."""
        return self.program.apply("exp", self)

    def sin(self) -> Number:
        """Return the sine."""
        return self.program.apply("sin", self)

    def cos(self) -> Number:
        """Return the cosine."""
        return self.program.apply("cos", self)

    def __floor__(self) -> Number:
        return self.program.apply("floor", self)

    def __lt__(self, other: Number) -> bool:
        return self.program.compare("<", self, other)

    def __le__(self, other: Number) -> bool:
        return self.program.compare("<=", self, other)

    def __gt__(self, other: Number) -> bool:
        return self.program.compare(">", self, other)

    def __ge__(self, other: Number) -> bool:
        return self.program.compare(">=", self, other)

    def __eq__(self, other: object) -> bool:
        return self.program.compare("==", self, other)

    def __ne__(self, other: object) -> bool:
        return not self.__eq__(other)

    def __bool__(self) -> bool:
        return self != 0.0

    def __hash__(self) -> int:
        return id(self)

    def _refuse(self, *_: Number | str | None) -> NoReturn:
        raise NotTracedError(f"{self.name} is a formula, of which only sums, products and square roots are known")

    __float__ = __int__ = __index__ = __round__ = __format__ = _refuse
    __pow__ = __rpow__ = __mod__ = __rmod__ = __floordiv__ = __rfloordiv__ = _refuse


class Unknown(Formula):
    """A formula of a `SymbolicProgram`, with the functions by which NumPy computes on objects."""

    __slots__ = ()
    incomparable: ClassVar[bool] = True

    def log(self) -> Number:
        """Return the natural logarithm."""
        return self.program.apply("log", self)

    def tan(self) -> Number:
        """Return the tangent."""
        return self.sin() / self.cos()

    def sinh(self) -> Number:
        """Return the hyperbolic sine."""
        return 0.5 * (exp(self) - exp(-self))

    def cosh(self) -> Number:
        """Return the hyperbolic cosine."""
        return 0.5 * (exp(self) + exp(-self))

    def tanh(self) -> Number:
        """Return the hyperbolic tangent."""
        return 1.0 - 2.0 / (1.0 + exp(2.0 * self))

    def arctan(self) -> Number:
        """Return the angle whose tangent it is."""
        return self.arctan2(1.0)

    def arcsin(self) -> Number:
        """Return the angle in [-π/2, π/2] whose sine it is."""
        return self.arctan2(sqrt(1.0 - self * self))

    def arccos(self) -> Number:
        """Return the angle in [0, π] whose cosine it is."""
        return self.program.apply("atan2", sqrt(1.0 - self * self), self)

    def arctan2(self, x: Number) -> Number:
        """Return the angle of the point (x, self)."""
        return self.program.apply("atan2", self, x)

    def hypot(self, other: Number) -> Number:
        """Return the distance of the point (self, other) from the origin."""
        return sqrt(self * self + other * other)

    def conjugate(self) -> Number:
        """Return itself, which is real."""
        return self

    def __pos__(self) -> Number:
        return self

    def __pow__(self, exponent: Number) -> Number:  # type: ignore[override]
        if isinstance(exponent, Formula):
            return exp(exponent * self.log())
        if exponent < 0.0:
            return 1.0 / self**-exponent
        half, odd = divmod(2.0 * exponent, 2.0)
        if odd not in (0.0, 1.0):
            return exp(exponent * self.log())
        found: Number = self.sqrt() if odd else 1.0
        power: Number = self
        for bit in reversed(f"{int(half):b}"):
            found = found * power if bit == "1" else found
            power = power * power
        return found

    def __rpow__(self, base: float) -> Number:  # type: ignore[override]
        return exp(math.log(base) * self)


Number: TypeAlias = float | Formula


NUMBERS = (Formula, int, float, np.integer)


def is_number(value: object) -> TypeGuard[Number]:
    """Return whether a value is a number that formulas can be made of."""
    return isinstance(value, NUMBERS)


@overload
def number(value: Formula) -> Formula: ...
@overload
def number(value: float) -> float: ...
def number(value: Number) -> Number:
    """Return a value as a float; a formula as it is."""
    return value if isinstance(value, Formula) else float(value)


def value_of(number: Number) -> float:
    """Return the value of a number."""
    return number.value if isinstance(number, Formula) else float(number)


def mentions(thing: object) -> bool:
    """Return whether a thing is a formula, or a dataclass with one among its fields."""
    if is_dataclass(thing) and not isinstance(thing, Formula):
        return any(mentions(getattr(thing, each.name)) for each in fields(thing))
    return isinstance(thing, Formula) or (isinstance(thing, tuple | list) and any(map(mentions, thing)))


def with_values(thing: Any) -> Any:
    """Return a thing with the values of the formulas that it `mentions`."""
    if isinstance(thing, Formula):
        return thing.value
    if not mentions(thing):
        return thing
    if is_dataclass(thing):
        return replace(thing, **{each.name: with_values(getattr(thing, each.name)) for each in fields(thing)})  # type: ignore[type-var]
    return type(thing)(map(with_values, thing))


@overload
def sqrt(x: float) -> float: ...
@overload
def sqrt(x: Formula) -> Number: ...
def sqrt(x: Number) -> Number:
    """Return the square root of a number, which may be a formula."""
    return x.sqrt() if isinstance(x, Formula) else math.sqrt(x)


def exp(x: Number) -> Number:
    """Return the exponential function of a number, which may be a formula."""
    return x.exp() if isinstance(x, Formula) else math.exp(x)


@overload
def atan2(y: float, x: float) -> float: ...
@overload
def atan2(y: Number, x: Number) -> Number: ...
def atan2(y: Number, x: Number) -> Number:
    """Return the angle of the point (x, y), whose coordinates may be formulas."""
    formula = next((each for each in (y, x) if isinstance(each, Formula)), None)
    return formula.program.apply("atan2", y, x) if formula else math.atan2(value_of(y), value_of(x))


@dataclass
class Program:
    """The arithmetic on some parameters, in the order in which it was done.

    Attributes
    ----------
    elementary : bool   whether it may hold the operations of `ELEMENTARY`, as one that is differentiated only
    parameters : list of Formula
    lines : dict        operation to the formula that holds the result; each is done once
    assumed : dict      comparisons that were made, and came out true
    """

    elementary: bool = False
    parameters: list[Formula] = field(default_factory=list)
    lines: dict[Operation, Formula] = field(default_factory=dict)
    assumed: dict[Operation, None] = field(default_factory=dict)

    def parameter(self, value: float) -> Formula:
        """Return a new parameter with its value for this trace."""
        self.parameters.append(Formula(self, f"p{len(self.parameters)}", float(value)))
        return self.parameters[-1]

    def apply(self, operation: str, *operands: Number) -> Number:
        """Return the result of an operation, which is a number where the formula does not matter."""
        if not all(map(is_number, operands)):
            unknown: Number = NotImplemented
            return unknown
        self._refuse_others(operands)
        if operation in ELEMENTARY and not self.elementary:
            raise NotTracedError(f"{operation} of a formula, of which only sums, products and square roots are known")
        found = _simplified(operation, *operands)
        if found is not None:
            return found
        line = Operation(operation, tuple(map(node, operands)))
        if line not in self.lines:
            self.lines[line] = self._result(f"t{len(self.lines)}", operation, operands)
        return self.lines[line]

    def _result(self, name: str, operation: str, operands: Sequence[Number]) -> Formula:
        """Return the formula of an operation, by the name of its line."""
        return Formula(self, name, float(OPERATIONS[operation](*map(value_of, operands))))

    def compare(self, comparison: str, a: Number, b: object) -> bool:
        """Return the comparison of two numbers by their values, and remember it."""
        if not is_number(b):
            unknown: bool = NotImplemented
            return unknown
        self._refuse_others((a, b))
        holds = COMPARISONS[comparison](value_of(a), value_of(b))
        self.assumed[Operation(comparison if holds else NEGATIONS[comparison], (node(a), node(b)))] = None
        return holds

    def _refuse_others(self, operands: Sequence[Number]) -> None:
        """Refuse formulas of another program."""
        if any(isinstance(each, Formula) and each.program is not self for each in operands):
            raise NotTracedError(
                "a parameter that is a formula meets the motion, whose formulas hold for one value of it"
            )

    def assumptions(self) -> list[Operation]:
        """Return the comparisons that hold for all sets of parameters for which the formulas do."""
        return [*self.assumed]

    def holds(self, values: Sequence[float]) -> bool:
        """Return whether the comparisons come out as they did for these values of the parameters.

        Examples
        --------
        >>> program = Program()
        >>> k = program.parameter(4.0)
        >>> k > 1.0, program.holds([2.0]), program.holds([0.5])
        (True, True, False)
        """
        known = {each.name: value for each, value in zip(self.parameters, values, strict=True)}

        def read(operand: Expression) -> float:
            return float(operand.text) if isinstance(operand, Constant) else known[str(operand)]

        try:
            for line, formula in self.lines.items():
                known[formula.name] = float(OPERATIONS[line.operation](*map(read, line.operands)))
        except (ArithmeticError, ValueError):
            return False
        return all(COMPARISONS[each.operation](*map(read, each.operands)) for each in self.assumed)

    def slopes(self) -> dict[str, Array]:
        """Return the derivatives of all formulas by the parameters (p,), by name.

        Examples
        --------
        >>> program = Program()
        >>> ω = sqrt(program.parameter(4.0) / program.parameter(1.0))
        >>> program.slopes()[ω.name]
        array([ 0.25, -1.  ])
        """
        read = self._reader()
        found = dict(zip((each.name for each in self.parameters), np.eye(len(self.parameters)), strict=True))
        for line, formula in self.lines.items():
            partials = PARTIALS[line.operation](formula.value, *map(read, line.operands))
            terms = zip(line.operands, partials, strict=True)
            found[formula.name] = sum(
                (by * found[str(operand)] for operand, by in terms if not isinstance(operand, Constant)),
                np.zeros(len(self.parameters)),
            )
        return found

    def kinks(self) -> Flags:
        """Return whether formulas hold on one side of each parameter at most, as for a comparison of equal numbers (p,)."""
        read, slopes, none = self._reader(), self.slopes(), np.zeros(len(self.parameters))
        found = np.zeros(len(self.parameters), dtype=np.bool_)
        for comparison in self.assumed:
            a, b = comparison.operands
            if read(a) == read(b):
                found |= slopes.get(str(a), none) != slopes.get(str(b), none)
        for line, formula in self.lines.items():
            corner = {"abs": 0.0, "sqrt": 0.0, "floor": formula.value}.get(line.operation)
            if corner == read(line.operands[0]):
                found |= slopes.get(str(line.operands[0]), none) != 0.0
        return found

    def _reader(self) -> Callable[[Expression], float]:
        """Return the function that reads the value of an operand."""
        values = {each.name: each.value for each in (*self.parameters, *self.lines.values())}
        return lambda operand: float(operand.text) if isinstance(operand, Constant) else values[str(operand)]

    def depending_on(self, parameters: Iterable[Formula]) -> set[str]:
        """Return the names of the formulas in which some parameters are, and of these."""
        found = {each.name for each in parameters}
        for line, formula in self.lines.items():
            if not found.isdisjoint(names(line)):
                found.add(formula.name)
        return found

    def assignments(
        self, results: Mapping[str, Number], known: Iterable[str] = (), assumed: bool = True
    ) -> list[Assign]:
        """Return the assignments that compute results, and the numbers that are compared, from the parameters p0, p1, ...

        Parameters
        ----------
        results : mapping of str to number      variable to its formula
        known : iterable of str                 variables that have been computed
        assumed : bool                          whether to compute what the assumptions compare
        """
        lines = [Assign(formula.name, line) for line, formula in self._lines_for(results, set(known), assumed)]
        return lines + [Assign(name, node(value)) for name, value in results.items() if node(value) != Name(name)]

    def inputs(self, results: Mapping[str, Number], known: Iterable[str]) -> dict[str, Formula]:
        """Return the known formulas from which results are computed, by name."""
        used = {name for line, _ in self._lines_for(results, set(known)) for name in names(line)} & set(known)
        return {each.name: each for each in (*self.parameters, *self.lines.values()) if each.name in used}

    def _lines_for(
        self, results: Mapping[str, Number], known: set[str], assumed: bool = True
    ) -> list[tuple[Operation, Formula]]:
        """Return the lines that results and assumptions need beside known ones, in their order."""
        needed = {each.name for each in results.values() if isinstance(each, Formula)}
        if assumed:
            needed = needed.union(*map(names, self.assumed))
        needed -= known
        found = []
        for line, formula in reversed(self.lines.items()):
            if formula.name in needed:
                needed |= names(line) - known
                found.append((line, formula))
        return found[::-1]


@dataclass
class SymbolicProgram(Program):
    """Arithmetic on arguments that have no values: it has no cases, and its derivatives are formulas too.

    Examples
    --------
    >>> program = SymbolicProgram()
    >>> φ = program.argument("φ")
    >>> (by_φ,) = program.derivatives([φ * φ.sin()], φ)
    >>> print(*program.assignments({"y": by_φ}), sep="; ")
    t0 = sin(φ); t2 = cos(φ); t3 = φ * t2; t4 = t0 + t3; y = t4
    """

    elementary: bool = True

    def argument(self, name: str) -> Unknown:
        """Return a new argument."""
        self.parameters.append(Unknown(self, name, math.nan))
        return self.parameters[-1]  # type: ignore[return-value]

    def _result(self, name: str, operation: str, operands: Sequence[Number]) -> Formula:
        """Return a formula without value."""
        if operation == "floor":
            raise NotTracedError("floor has jumps")
        return Unknown(self, name, math.nan)

    def compare(self, comparison: str, a: Number, b: object) -> bool:
        """Refuse a comparison, whose outcome the motion may change."""
        raise NotTracedError(f"it compares numbers ({comparison})")

    def derivatives(self, results: Sequence[Number], by: Formula) -> list[Number]:
        """Return the derivatives of results by an argument or another formula, as formulas."""
        slopes: dict[str, Number] = {by.name: 1.0}
        known = {each.name: each for each in (*self.parameters, *self.lines.values())}
        for line, formula in self._lines_for(dict(enumerate(results)), {by.name}, False):  # type: ignore[arg-type]
            if formula.name == by.name:
                continue
            operands = [known[str(each)] if isinstance(each, Name) else float(str(each)) for each in line.operands]
            rates = [slopes.get(str(each), 0.0) for each in line.operands]
            if any(isinstance(rate, Formula) or rate for rate in rates):
                slopes[formula.name] = _slope(line.operation, formula, operands, rates)
        return [slopes.get(each.name, 0.0) if isinstance(each, Formula) else 0.0 for each in results]


def _slope(operation: str, c: Number, operands: Sequence[Number], rates: Sequence[Number]) -> Number:
    """Return the derivative of the result c of an operation as a formula, by those of its operands."""
    # Beside the smallest number those of |x| and √(x²) are 0 at 0, where that of √x is infinite.
    least = math.ulp(0.0)
    a, b = (*operands, 0.0)[:2]
    da, db = (*rates, 0.0)[:2]
    match operation:
        case "+":
            return da + db
        case "-":
            return da - db
        case "*":
            return da * b + a * db
        case "/":
            return (da - c * db) / b
        case "abs":
            return da * a / (c + least)
        case "sqrt":
            return 0.5 * da / (c + least)
        case "exp":
            return c * da
        case "log":
            return da / a
        case "sin":
            return da * a.cos()  # type: ignore[union-attr]
        case "cos":
            return 0.0 - da * a.sin()  # type: ignore[union-attr]
        case _:
            return (b * da - a * db) / (a * a + b * b)


@dataclass(frozen=True, eq=False)
class FormulaSlopes:
    """The derivatives of formulas by some of the parameters of their program.

    Attributes
    ----------
    program : Program
    kept : list of int  the numbers of the p parameters
    """

    program: Program
    kept: Sequence[int]

    @cached_property
    def slopes(self) -> dict[str, Array]:
        """The derivatives by all parameters, by name of the formula."""
        return self.program.slopes()

    def of(self, numbers: Array) -> Array:
        """Return the derivatives (p, ...) of an array of numbers."""
        found = np.zeros((len(self.kept), *numbers.shape))
        for place, each in np.ndenumerate(numbers):
            if isinstance(each, Formula):
                found[:, *place] = self.slopes[each.name][self.kept]
        return found


def node(number: Number) -> Name | Constant:
    """Return a number as it is printed: a formula by its name."""
    return Name(number.name) if isinstance(number, Formula) else Constant(repr(float(number)))


def _simplified(operation: str, a: Number, b: Number = 0.0) -> Number | None:
    """Return the result of an operation with 0 or 1, which needs no line; None for another."""
    if operation == "+":
        return b if _is(a, 0.0) else a if _is(b, 0.0) else None
    if operation == "-":
        return a if _is(b, 0.0) else None
    if operation == "*":
        return 0.0 if _is(a, 0.0) or _is(b, 0.0) else b if _is(a, 1.0) else a if _is(b, 1.0) else None
    if operation == "/":
        return 0.0 if _is(a, 0.0) else a if _is(b, 1.0) else None
    return None


def _is(number: Number, value: float) -> bool:
    return not isinstance(number, Formula) and number == value
