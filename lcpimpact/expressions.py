"""Code as typed nodes: expressions and statements that each printer writes in its own language, and nobody reads again.

An expression is written as the mathematics; as text it is Python.

Examples
--------
>>> W, q = Name("W"), Name("q")
>>> z = largest(-q / W, 0.0)
>>> print(select(z < INFINITY, z - (q - W), 1.0))
max(-q / W, 0.0) - (q - W) if max(-q / W, 0.0) < INFINITY else 1.0
>>> sorted(names(z))
['W', 'q']
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from typing import TypeAlias

RANKS = (
    {"if": 1, "or": 2, "and": 3, "not": 4}
    | dict.fromkeys(("<", "<=", ">", ">=", "==", "!="), 5)
    | {"+": 6, "-": 6, "*": 7, "/": 7, "sign": 8}
)
"""Operations that are written between or before their operands, by what binds more; the others are functions."""


class Expression:
    """A number or a condition, as a node."""

    __slots__ = ()

    def __add__(self, other: Term) -> Expression:
        return operation("+", self, other)

    def __sub__(self, other: Term) -> Expression:
        return operation("-", self, other)

    def __mul__(self, other: Term) -> Expression:
        return operation("*", self, other)

    def __rmul__(self, other: Term) -> Expression:
        return operation("*", other, self)

    def __truediv__(self, other: Term) -> Expression:
        return operation("/", self, other)

    def __neg__(self) -> Expression:
        return operation("-", self)

    def __abs__(self) -> Expression:
        return operation("abs", self)

    def __lt__(self, other: Term) -> Expression:
        return operation("<", self, other)

    def __le__(self, other: Term) -> Expression:
        return operation("<=", self, other)

    def __gt__(self, other: Term) -> Expression:
        return operation(">", self, other)

    def __ge__(self, other: Term) -> Expression:
        return operation(">=", self, other)

    def __and__(self, other: Term) -> Expression:
        return operation("and", self, other)

    def __or__(self, other: Term) -> Expression:
        return operation("or", self, other)

    def __invert__(self) -> Expression:
        return operation("not", self)

    def __bool__(self) -> bool:
        raise TypeError(f"{self} is neither true nor false: it is to be printed")


Term: TypeAlias = Expression | float
"""An expression, or a number or truth value that becomes one."""


@dataclass(frozen=True, slots=True)
class Name(Expression):
    """A variable."""

    name: str

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True, slots=True)
class Constant(Expression):
    """A number or a truth value by its text, for 0 and -0, and 1 and true, are different ones."""

    text: str

    def __str__(self) -> str:
        return self.text.replace("inf", "INFINITY")


@dataclass(frozen=True, slots=True)
class Operation(Expression):
    """An operation of its operands: one of ``RANKS``, or a function by its name."""

    operation: str
    operands: tuple[Expression, ...]

    def __str__(self) -> str:
        return python(self)


TRUE = Constant("True")
ZERO = Constant("0.0")
INFINITY = Constant("inf")


@dataclass(frozen=True, slots=True)
class Assign:
    """The statement name = value."""

    name: str
    value: Expression

    def __str__(self) -> str:
        return f"{self.name} = {self.value}"


@dataclass(frozen=True, slots=True)
class When:
    """Statements under a condition."""

    condition: Expression
    then: tuple[Statement, ...]


@dataclass(frozen=True, slots=True)
class Unless:
    """End before this step, which is out of the ordinary, unless a condition holds."""

    condition: Expression


Statement: TypeAlias = Assign | When | Unless


def expression(term: Term) -> Expression:
    """Return a term as an expression."""
    return term if isinstance(term, Expression) else Constant(repr(term if isinstance(term, bool) else float(term)))


def operation(name: str, *terms: Term) -> Expression:
    """Return an operation; one with `TRUE` is what is left of it."""
    operands = tuple(map(expression, terms))
    if name == "and":
        operands = tuple(each for each in joined(name, operands) if each != TRUE)
        return Operation(name, operands) if len(operands) > 1 else operands[0] if operands else TRUE
    if name == "or":
        operands = joined(name, operands)
        return TRUE if TRUE in operands else Operation(name, operands)
    if name == "if" and operands[0] == TRUE:
        return operands[1]
    return Operation(name, operands)


def joined(name: str, operands: tuple[Expression, ...]) -> tuple[Expression, ...]:
    """Return operands, of which the first may be the same operation: then with its operands in its place."""
    match operands:
        case (Operation(operation=first, operands=inner), *others) if first == name:
            return (*inner, *others)
    return operands


def largest(a: Term, b: Term) -> Expression:
    """Return the larger of two terms, the first of equal ones."""
    return operation("max", a, b)


def smallest(a: Term, b: Term) -> Expression:
    """Return the smaller of two terms, the first of equal ones."""
    return operation("min", a, b)


def equal(a: Term, b: Term) -> Expression:
    """Return the condition that two numbers are equal; ``==`` says whether two nodes are."""
    return operation("==", a, b)


def select(condition: Term, a: Term, b: Term) -> Expression:
    """Return a under a condition, else b."""
    return operation("if", condition, a, b)


def finite(x: Term) -> Expression:
    """Return the condition that a number is finite."""
    return abs(expression(x)) < INFINITY


def every(conditions: Iterable[Term]) -> Expression:
    """Return the condition that all of some conditions hold."""
    return operation("and", *conditions)


def conditions_of(condition: Expression) -> tuple[Expression, ...]:
    """Return the conditions that hold together where a condition holds."""
    both = isinstance(condition, Operation) and condition.operation == "and"
    return condition.operands if both else (condition,)  # type: ignore[attr-defined]


def names(node: Expression) -> set[str]:
    """Return the names in an expression."""
    if isinstance(node, Operation):
        return set().union(*map(names, node.operands))
    return {node.name} if isinstance(node, Name) else set()


def replaced(node: Expression, known: Mapping[Expression, Expression]) -> Expression:
    """Return an expression with others in the place of known parts."""
    if node in known:
        return known[node]
    if isinstance(node, Operation):
        return operation(node.operation, *(replaced(each, known) for each in node.operands))
    return node


def in_turn(results: Mapping[str, Expression], prefix: str) -> list[Assign]:
    """Return the assignments of results, of which each part that occurs several times is computed once."""
    uses = Counter[Expression]()
    found = list[Assign]()
    known = dict[Expression, Name]()

    def count(node: Expression) -> None:
        if isinstance(node, Operation):
            uses[node] += 1
            for each in node.operands if uses[node] == 1 else ():
                count(each)

    def named(node: Expression) -> Expression:
        if node in known or not isinstance(node, Operation):
            return known.get(node, node)
        made = Operation(node.operation, tuple(map(named, node.operands)))
        if uses[node] == 1:
            return made
        known[node] = Name(f"{prefix}{len(known)}")
        found.append(Assign(known[node].name, made))
        return known[node]

    for each in results.values():
        count(each)
    for name, each in results.items():
        found.append(Assign(name, named(each)))
    return found


def assigned(statements: Iterable[Statement]) -> set[str]:
    """Return the names that statements set."""
    found = set[str]()
    for each in statements:
        match each:
            case Assign(name, _):
                found.add(name)
            case When(_, then):
                found |= assigned(then)
    return found


def carried(statements: Sequence[Statement]) -> set[str]:
    """Return the names that statements set, but read before."""
    return read_first(statements, set()) & assigned(statements)


def read_first(statements: Iterable[Statement], known: Set[str]) -> set[str]:
    """Return the names that statements read before they set them, besides known ones."""
    read = set[str]()
    for each in statements:
        match each:
            case Assign(name, value):
                read |= names(value) - known
                known = known | {name}
            case When(condition, then):
                read |= (names(condition) - known) | read_first(then, known)
            case Unless(condition):
                read |= names(condition) - known
    return read


def rank(node: Expression) -> float:
    """Return how much the outermost operation of an expression binds its operands."""
    if not isinstance(node, Operation):
        return math.inf
    sign = node.operation == "-" and len(node.operands) == 1
    return RANKS.get("sign" if sign else node.operation, math.inf)


def python(node: Expression, least: float = 0.0) -> str:
    """Return an expression in Python, in parentheses if its outermost operation binds less than the ``least`` rank."""
    if not isinstance(node, Operation):
        return str(node)
    own = rank(node)
    name = node.operation
    if own == math.inf:
        return f"{name}({', '.join(map(python, node.operands))})"
    # Of equal operations the first comes first; comparisons are in no chain, and of "and" and "or" all operands are alike.
    first = python(node.operands[0], own if name in "+-*/" else own + 1)
    others = [python(each, own + 1) for each in node.operands[1:]]
    if name == "if":
        text = f"{others[0]} if {first} else {others[1]}"
    elif not others:
        text = f"{name}{' ' * (name == 'not')}{first}"
    else:
        text = f" {name} ".join([first, *others])
    return f"({text})" if own < least else text


def python_lines(statements: Iterable[Statement]) -> Iterator[str]:
    """Yield the lines of statements in a loop of Python, which `Unless` ends."""
    for each in statements:
        match each:
            case Assign():
                yield str(each)
            case When(condition, then):
                yield f"if {condition}:"
                yield from (f"    {line}" for line in python_lines(then))
            case Unless(condition):
                yield from (f"if not ({condition}):", "    break")
