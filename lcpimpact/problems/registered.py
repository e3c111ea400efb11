"""Builders of registered problems: functions of parameters that their annotations state."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import wraps
from types import FunctionType
from typing import ParamSpec, TypeAlias, get_type_hints

from lcpimpact.arrays import Array
from lcpimpact.problems.base import Problem
from lcpimpact.problems.facts import Fact
from lcpimpact.scheme.lagrangian import Lagrangian
from lcpimpact.stated import stated, with_parameters

P = ParamSpec("P")

Value: TypeAlias = float | tuple[Fact, ...] | tuple[Array, Array]
"""An end, the facts, or coordinates and velocities."""


@dataclass(frozen=True)
class ClosedForm:
    """A function inside a builder, that is pickled as the builder and the parameters that it was called with.

    Attributes
    ----------
    builder : callable
    parameters : mapping of str to float
    field : str                         "t_end", "facts" or "motion"
    function : callable
    """

    builder: Callable[..., Problem]
    parameters: Mapping[str, float]
    field: str
    function: Callable[..., Value]

    def __call__(self, *times: Array) -> Value:
        """Call the function."""
        return self.function(*times)

    def __reduce__(self) -> tuple[Callable[..., ClosedForm], tuple[Callable[..., Problem], dict[str, float], str]]:
        return _rebuilt, (self.builder, dict(self.parameters), self.field)


def _rebuilt(builder: Callable[..., Problem], parameters: Mapping[str, float], field: str) -> ClosedForm:
    form: ClosedForm = vars(builder(**parameters))[field]
    return form


def _scheme(builder: Callable[..., Problem], parameters: dict[str, float]) -> Lagrangian:
    scheme: Lagrangian = builder(**parameters).scheme  # type: ignore[assignment]
    return scheme


def registered(builder: Callable[P, Problem]) -> Callable[P, Problem]:
    """Return a builder whose problems keep its arguments as their parameters, and whose docstring lists them.

    A builder states each parameter once, in its annotation (see `lcpimpact.stated`); its end, facts and motion may be
    functions inside it. What it puts into ``parameters`` itself replaces an argument, as one that follows from others.

    Examples
    --------
    >>> from typing import Annotated
    >>> from lcpimpact import Load, Mass, Problem, Scheme
    >>> @registered
    ... def fall(m: Annotated[float, "kg, mass"] = 1.0, g: Annotated[float, "m/s², gravity"] = 9.81) -> Problem:
    ...     '''A body that falls.'''
    ...     return Problem("fall", Scheme(Mass("x", m), Load("x", m * g)))
    >>> fall(m=2.0).parameters
    {'m': 2.0, 'g': 9.81}
    >>> fall.__doc__.splitlines()[-2:]
    ['g : float, in m/s²', '    Gravity.']
    """
    signature = inspect.signature(builder)

    @wraps(builder)
    def build(*args: P.args, **kwargs: P.kwargs) -> Problem:
        given = signature.bind(*args, **kwargs)
        given.apply_defaults()
        problem = builder(*args, **kwargs)
        parameters = {**given.arguments, **problem.parameters}
        forms = {
            field: ClosedForm(build, parameters, field, value)
            for field, value in vars(problem).items()
            if isinstance(value, FunctionType)
        }
        vars(problem).update(parameters=parameters, **forms)
        if isinstance(problem.scheme, Lagrangian):
            # Its functions are inside the builder, and are not pickled themselves.
            vars(problem.scheme)["rebuilt_by"] = _scheme, (build, parameters)
        return problem

    kinds = {name: inspect.formatannotation(kind) for name, kind in get_type_hints(builder).items()}
    plain = [each.replace(annotation=kinds[name]) for name, each in signature.parameters.items()]
    build.__signature__ = signature.replace(parameters=plain)  # type: ignore[attr-defined]
    build.__doc__ = with_parameters(builder.__doc__ or "", stated(builder))
    return build
