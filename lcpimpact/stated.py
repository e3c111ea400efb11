"""Parameters as annotations state them, each once: ``m: Annotated[float, "kg, mass of the body"] = 100.0``.

The text is the unit, "1" for a pure number, and after the first comma the meaning.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from textwrap import fill
from typing import Annotated, Any, TypeVar, cast, get_args, get_origin, get_type_hints

T = TypeVar("T")


@dataclass(frozen=True)
class Parameter:
    """A parameter of a function or a constant of an element, as its annotation states it.

    Attributes
    ----------
    kind : str          "float", "int" or "float, optional", as docstrings call it
    unit : str          "" for a pure number
    meaning : str       in words
    """

    kind: str
    unit: str
    meaning: str

    @property
    def in_unit(self) -> str:
        """The unit as docstrings name it, after the kind."""
        return f", in {self.unit}" if self.unit else ""

    @property
    def sentence(self) -> str:
        """The meaning as a sentence."""
        return f"{self.meaning[0].upper()}{self.meaning[1:]}."


@cache
def stated(thing: Callable[..., object]) -> dict[str, Parameter]:
    """Return the parameters that the annotations of a function or class state, by name.

    Examples
    --------
    >>> from lcpimpact.problems import PROBLEMS
    >>> stated(PROBLEMS["system-1"])["c_o"]
    Parameter(kind='float', unit='N s/m', meaning='damping of the ground structure')
    """
    defaults = {name: each.default for name, each in inspect.signature(thing).parameters.items()}
    found = {}
    for name, hint in get_type_hints(inspect.unwrap(thing), include_extras=True).items():
        if get_origin(hint) is Annotated and isinstance(hint.__metadata__[0], str):
            unit, _, meaning = hint.__metadata__[0].partition(", ")
            optional = type(None) in get_args(get_args(hint)[0])
            kind = "float, optional" if optional else "int" if isinstance(defaults[name], int) else "float"
            found[name] = Parameter(kind, "" if unit == "1" else unit, meaning)
    return found


def with_parameters(doc: str, parameters: dict[str, Parameter]) -> str:
    """Return a docstring with a section of these parameters before its first section."""
    lines = ["Parameters", "----------"]
    for name, each in parameters.items():
        lines += [f"{name} : {each.kind}{each.in_unit}", f"    {each.sentence}"]
    text = inspect.cleandoc(doc)
    head, *sections = re.split(r"\n(?=\w[\w ]*\n-{3,}\n)", text, maxsplit=1)
    return "\n".join([head.rstrip(), "", *lines, *(f"\n{each}" for each in sections)])


def described(kind: type[T]) -> type[T]:
    """Return a dataclass whose docstring describes its constants, where it names them, as their annotations state them.

    Examples
    --------
    >>> from lcpimpact import Spring
    >>> Spring.__doc__.partition("k : float")[2].splitlines()[:2]
    [', in N/m', '    Stiffness, positive.']
    """
    hints = get_type_hints(kind)
    known: dict[str, Parameter] = stated(cast(Any, kind))
    lines = list[str]()
    for line in inspect.cleandoc(kind.__doc__ or "").splitlines():
        each = known.get(line.partition(" : ")[0])
        lines.append(line + (each.in_unit if each else ""))
        if each:
            lines.append(fill(each.sentence, 116, initial_indent="    ", subsequent_indent="    "))
    kind.__doc__ = "\n".join(lines)
    kind.__init__.__annotations__.update({name: inspect.formatannotation(hints[name]) for name in known})
    return kind
