"""The parameters of a problem by address, for changes, sweeps and fits.

An address is

- the name of a parameter of a registered problem, as ``k_o``, which changes everything that is built from it;
- ``WHERE.FIELD``, a constant of an element: WHERE is its number in the scheme, counted from 0, as ``2.k``; the name of its
  type, as ``KelvinVoigt.k``, or of its reaction, as ``R.gap``, if only one element has that;
- ``WHERE.FIELD.CONSTANT``, one of a signal of an element, as ``Load.f.amplitude``, ``Load.f.coefficients.1`` of a polynomial
  and ``Load.f.terms.0.omega`` of a sum; the points of a `Table` are none;
- ``FIELD`` or ``FIELD.CONSTANT`` alone, if no parameter and one element only has it;
- ``q0.NODE`` or ``v0.NODE``, an initial value.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from functools import partial
from typing import Any, TypeVar, cast

from lcpimpact.arguments import checked
from lcpimpact.errors import InputError
from lcpimpact.memo import once
from lcpimpact.numbers import is_real
from lcpimpact.problems import PROBLEMS
from lcpimpact.problems.base import Problem, build, defaults
from lcpimpact.registry import nearest
from lcpimpact.scheme.elements.base import Element
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.scheme.signals import UNITS, Described, Polynomial, SignalSum
from lcpimpact.stated import Parameter, stated

INITIAL = ("q0", "v0")

T = TypeVar("T")

Place = tuple[str, int, str]
"""("parameter", -1, name), ("element", its number, field or path), or ("q0" or "v0", -1, node)."""


@checked
def with_values(problem: Problem, values: Mapping[str, float]) -> Problem:
    """Return the problem with changed values at these addresses.

    Parameters
    ----------
    problem : Problem
        A registered problem, or any scheme.
    values : mapping of str to float
        Address to value, in SI units.

    Raises
    ------
    InputError
        For an unknown or ambiguous address, or a value that the problem rejects.

    Examples
    --------
    >>> from lcpimpact import load_problem
    >>> changed = with_values(load_problem("system-1"), {"c_o": 300.0, "v0.x": 5.0})
    >>> changed.scheme.elements[3].c, changed.v0["x"]
    (300.0, 5.0)
    >>> from lcpimpact import Harmonic, Load, Mass, Problem, Scheme
    >>> driven = Problem("driven", Scheme(Mass("x", m=1.0), Load("x", f=Harmonic(amplitude=2.0, omega=3.0))))
    >>> with_values(driven, {"Load.f.amplitude": 5.0}).scheme.elements[1].f
    Harmonic(amplitude=5.0, omega=3.0, phase=0.0)
    """
    return changes_at(problem, values)(values)


def changes_at(problem: Problem, addresses: Iterable[str]) -> Callable[[Mapping[str, float]], Problem]:
    """Return the function `with_values` of a problem for many values at the same addresses.

    Raises
    ------
    InputError
        For an unknown or ambiguous address; the function raises it for values that the problem rejects.
    """
    parameters = parameters_of(problem)
    places = {address: place(problem, address, parameters) for address in addresses}
    given = dict(problem.parameters)
    if any(kind == "parameter" for kind, _, _ in places.values()):
        for name in _derived(problem):
            del given[name]
    return partial(_changed, problem, places, given)


def _changed(
    problem: Problem, places: Mapping[str, Place], given: Mapping[str, float], values: Mapping[str, float]
) -> Problem:
    of_problem = {name: values[address] for address, (kind, _, name) in places.items() if kind == "parameter"}
    if of_problem:
        problem = build(problem.name, PROBLEMS[problem.name], {**given, **of_problem})
    others = {address: where for address, where in places.items() if where[0] != "parameter"}
    if not others:
        return problem
    changes: dict[str, Any] = {"parameters": {**problem.parameters, **{each: values[each] for each in others}}}
    for address, (kind, number, name) in others.items():
        if kind == "element":
            elements = list(changes.get("scheme", problem.scheme).elements)
            elements[number] = _replaced(elements[number], name, values[address])
            changes["scheme"] = cast(Scheme, problem.scheme).with_elements(elements)
        else:
            changes[kind] = {**changes.get(kind, getattr(problem, kind)), name: values[address]}
    return replace(problem, facts=(), motion=None, **changes)


def check_independent(problem: Problem, addresses: Sequence[str], *, change: float = 2.0**-20) -> None:
    """Refuse parameters of a problem together with numbers that follow from them.

    ``change``: that of a parameter, relative to it, or of a parameter that is 0.

    Raises
    ------
    InputError
        For a parameter and a constant or initial value that it sets.
    """
    parameters = parameters_of(problem)
    others = [address for address in addresses if address not in parameters]
    for name in parameters if others else ():
        if name not in addresses:
            continue
        value = value_at(problem, name)
        for near in (value + change * (value or 1.0), value - change * (value or 1.0)):
            try:
                changed = with_values(problem, {name: near})
            except InputError:
                continue
            for other in others:
                if value_at(changed, other) != value_at(problem, other):
                    raise InputError(
                        f"{name} sets {other}, which is named too and would not follow a change of {name}: leave one out"
                    )
            break


@checked
def value_at(problem: Problem, address: str) -> float:
    """Return the number at an address.

    Raises
    ------
    InputError
        For an address that names nothing or several things.

    Examples
    --------
    >>> from lcpimpact import load_problem
    >>> value_at(load_problem("system-1"), "KelvinVoigt.k")
    3924.0
    """
    kind, number, name = place(problem, address, parameters_of(problem))
    if kind == "parameter":
        return float(problem.parameters[name])
    if kind == "element":
        return _number(problem.scheme.elements[number], name)  # type: ignore[union-attr]
    return float(getattr(problem, kind).get(name, 0.0))


def units_of(problem: Problem, addresses: Iterable[str]) -> dict[str, str]:
    """Return the units of the numbers at addresses, by address; pure numbers, and what is no address, have none.

    Examples
    --------
    >>> from lcpimpact import load_problem
    >>> units_of(load_problem("system-1"), ["k_o", "KelvinVoigt.c", "v0.x", "theta"])
    {'k_o': 'N/m', 'KelvinVoigt.c': 'N s/m', 'v0.x': 'm/s'}
    """
    parameters = parameters_of(problem)
    of_problem = stated(PROBLEMS[problem.name]) if parameters else {}
    elements = problem.scheme.elements if isinstance(problem.scheme, Scheme) else ()
    found = dict[str, str]()
    for address in addresses:
        try:
            kind, number, name = place(problem, address, parameters)
        except InputError:
            continue
        if kind in INITIAL:
            found[address] = problem.unit(name if kind == "q0" else f"v_{name}")
        elif kind == "parameter" and name in of_problem:
            found[address] = of_problem[name].unit
        elif kind == "element" and name.partition(".")[0] in (known := stated(type(elements[number]))):
            found[address] = _unit_of_constant(problem, elements[number], name, known)
    return {address: unit for address, unit in found.items() if unit}


def parameters_of(problem: Problem) -> list[str]:
    """Return the names of the parameters of a registered problem, and none of another."""
    return list(defaults(PROBLEMS[problem.name])) if is_registered(problem) else []


def place(problem: Problem, address: str, parameters: Sequence[str]) -> Place:
    """Return the place that an address names in a problem with these parameters."""
    where, dot, name = address.partition(".")
    if dot and where in INITIAL:
        nodes = list(problem.dynamics.nodes)
        if name not in nodes:
            raise InputError(f"{address}: {nearest(name, nodes, 'node')}")
        return where, -1, name
    if address in parameters:
        return "parameter", -1, address
    known = _constants(problem)
    found = [
        (number, constant)
        for number, names, constant in known
        if constant == address or (constant == name and where in names)
    ]
    if len(found) == 1:
        return "element", *found[0]
    if found:
        several = ", ".join(f"{number}.{constant}" for number, constant in found)
        raise InputError(f"{address} of problem {problem.name!r} names several constants: say one of {several}")
    addresses = [*parameters, *(f"{number}.{constant}" for number, _, constant in known)]
    raise InputError(f"{nearest(address, addresses, f'number of problem {problem.name!r}')}; and q0.NODE, v0.NODE")


def check_address(problem: Problem, name: str, others: list[str], what: str) -> None:
    """Refuse a name that is no address; a message calls ``others``, among which it may have been meant to be, ``what``.

    Raises
    ------
    InputError
        For an unknown or ambiguous address.
    """
    try:
        place(problem, name, parameters_of(problem))
    except InputError as error:
        if "." in name or "several" in str(error):
            raise
        raise InputError(
            f"{nearest(name, others, what)}; and constants of elements, as 0.m; and q0.NODE, v0.NODE"
        ) from None


def numbers_of(problem: Problem) -> dict[str, float]:
    """Return the parameters of a registered problem that do not follow from others, and of another its `constants_of`.

    Examples
    --------
    >>> from lcpimpact import load_problem
    >>> list(numbers_of(load_problem("system-1")))
    ['m', 'k_o', 'c_o', 'g', 'h_o']
    """
    if not is_registered(problem):
        return constants_of(problem)
    derived = _derived(problem)
    return {name: value for name, value in problem.parameters.items() if name not in derived}


def constants_of(problem: Problem) -> dict[str, float]:
    """Return the constants of the elements and the initial values of a scheme by address, without those that are 0.

    Examples
    --------
    >>> from lcpimpact import load_problem
    >>> list(constants_of(load_problem("system-1")))
    ['Mass.m', 'Load.f', 'KelvinVoigt.k', 'KelvinVoigt.c', 'v0.x']
    """
    known = _constants(problem)
    addresses = []
    for number, names, name in known:
        kind = next(iter(names - {str(number), getattr(problem.scheme.elements[number], "name", "")}))  # type: ignore[union-attr]
        alone = sum(kind in others and each == name for _, others, each in known) == 1
        addresses.append(f"{kind if alone else number}.{name}")
    addresses += [f"{kind}.{node}" for kind in INITIAL for node in getattr(problem, kind)]
    found = {address: value_at(problem, address) for address in addresses}
    return {address: value for address, value in found.items() if value != 0.0 and math.isfinite(value)}


@once
def is_registered(problem: Problem) -> bool:
    """Return whether a problem equals the one that the registry builds from its name and parameters."""
    if problem.name not in PROBLEMS:
        return False
    try:
        again = build(problem.name, PROBLEMS[problem.name], problem.parameters)
    except InputError:
        return False
    return (again.scheme, again.q0, again.v0) == (problem.scheme, problem.q0, problem.v0)


def _derived(problem: Problem) -> list[str]:
    """Return the parameters of a registered problem that follow from its others, as v_o from g and h_o."""
    builder = PROBLEMS[problem.name]
    optional = [name for name, default in defaults(builder).items() if default is None]
    if not optional:
        return []
    given = {name: value for name, value in problem.parameters.items() if name not in optional}
    found = build(problem.name, builder, given).parameters
    return [name for name in optional if found[name] == problem.parameters[name]]


@once
def _constants(problem: Problem) -> list[tuple[int, set[str], str]]:
    """Return the constants of the elements: index of the element, its possible names, and the field, or the path to it."""
    if not isinstance(problem.scheme, Scheme):
        return []
    return [
        (number, {str(number), type(element).__name__, getattr(element, "name", "")}, path)
        for number, element in enumerate(problem.scheme.elements)
        for path in _paths(element)
    ]


def _paths(thing: Element | Described) -> Iterator[str]:
    """Yield the paths of the numbers of an element or signal: fields, and numbers in a polynomial or sum, with dots."""
    for each in fields(thing):  # type: ignore[arg-type]
        value = getattr(thing, each.name)
        if is_real(value):
            yield each.name
        elif isinstance(value, Described):
            yield from (f"{each.name}.{path}" for path in _paths(value))
        elif isinstance(thing, Polynomial):
            yield from (f"{each.name}.{k}" for k in range(len(value)))
        elif isinstance(thing, SignalSum):
            yield from (f"{each.name}.{k}.{path}" for k, term in enumerate(value) for path in _paths(term))


def _number(thing: object, path: str) -> float:
    """Return the number at a path of fields and places of tuples."""
    step, dot, rest = path.partition(".")
    inner = thing[int(step)] if isinstance(thing, tuple) else getattr(thing, step)
    return _number(inner, rest) if dot else float(inner)


def _replaced(thing: T, path: str, value: float) -> T:
    """Return an element, signal or tuple with another number at a path."""
    step, dot, rest = path.partition(".")
    inner = thing[int(step)] if isinstance(thing, tuple) else getattr(thing, step)
    new = _replaced(inner, rest, value) if dot else value
    if isinstance(thing, tuple):
        return cast(T, (*thing[: int(step)], new, *thing[int(step) + 1 :]))
    return replace(thing, **{step: new})  # type: ignore[type-var]


def _unit_of_constant(problem: Problem, element: Element, path: str, known: Mapping[str, Parameter]) -> str:
    """Return the unit of a constant of an element, or of a signal of it."""
    name, _, inner = path.partition(".")
    last = inner.rpartition(".")[2]
    if last in UNITS:
        return problem.own_unit(UNITS[last])
    unit = problem.own_unit(known[name].unit, element.nodes)
    power = int(last) if last.isdigit() else 0
    return f"{unit}/s{f'^{power}' if power > 1 else ''}" if unit and power else unit
