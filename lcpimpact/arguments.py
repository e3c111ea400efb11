"""Argument checks of public functions by their annotations, with one-sentence errors."""

from __future__ import annotations

import functools
import inspect
import types
import typing
import unicodedata
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import fields
from numbers import Integral, Real
from pathlib import Path
from typing import Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from lcpimpact.errors import InputError

P = ParamSpec("P")
R = TypeVar("R")

HIDDEN_CATEGORIES = ("Cc", "Cf", "Cs")
"""Unicode categories of control and format characters and of surrogates."""

WORDS: dict[Any, str] = {
    float: "a number", int: "a whole number", bool: "True or False", str: "a string", Path: "a path", type(None): "None",
    Sequence: "a sequence", Iterable: "an iterable", Collection: "a collection", Mapping: "a mapping",
    Callable: "a function", np.ndarray: "an array of numbers",
}  # fmt: skip

REMEDY = {
    "Problem": "get one from load_problem(...), or make one of a Scheme",
    "Trajectory": "get one from simulate(...)",
    "DataFrame": "get one from a study, as convergence(...), or make one of your data",
}
"""How to get an object of a type, by the name of the type."""

MAX_REPR_LENGTH = 60
"""Maximum number of characters of a value in an error."""


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """Refuse arguments of a function that are not of the kinds that it is annotated with.

    Whole numbers and those of NumPy are numbers, and a bool is none; lists, tuples and arrays are sequences, and a string is
    none. What the values mean is left to the function.

    Raises
    ------
    InputError
        By the function: it names the argument, what it is, and what it must be.

    Examples
    --------
    >>> @checked
    ... def step(h: float, names: Sequence[str] | None = None) -> float:
    ...     return h
    >>> int(step(2)), int(step(np.int64(3), ["x"]))
    (2, 3)
    >>> step("2")
    Traceback (most recent call last):
        ...
    lcpimpact.errors.InputError: h = '2' must be a number
    >>> step(1.0, ["x", 3])
    Traceback (most recent call last):
        ...
    lcpimpact.errors.InputError: names[1] = 3 must be a string
    """
    parameters = inspect.signature(function).parameters
    variable = (inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL)
    names = [name for name, each in parameters.items() if each.kind not in variable]

    @functools.cache
    def kinds() -> dict[str, tuple[frozenset[type], Any]]:
        hints = get_type_hints(function)
        return {name: (_at_once(hints[name]), hints[name]) for name in names if _says_much(hints.get(name, Any))}

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        known = kinds()
        for name, value in (*zip(names, args, strict=False), *kwargs.items()):
            if name in known and type(value) not in known[name][0]:
                check_kind(name, value, known[name][1])
        return function(*args, **kwargs)

    return call


def _says_much(hint: Any) -> bool:
    """Return whether a hint excludes anything; what NumPy makes an array of is known to NumPy alone."""
    arrays = any(getattr(get_origin(part), "__name__", "") == "_SupportsArray" for part in get_args(hint))
    return hint is not Any and not isinstance(hint, TypeVar) and not arrays


def _at_once(hint: Any) -> frozenset[type]:
    """Return classes whose things are of the kind of a hint, whatever they hold."""
    if get_origin(hint) in (Union, types.UnionType):
        return frozenset().union(*map(_at_once, get_args(hint)))
    return {float: frozenset((float, int, np.float64)), int: frozenset((int,))}.get(
        hint, frozenset((hint,)) if type(hint) is type and hint is not np.ndarray else frozenset()
    )


def check_kind(name: str, value: Any, hint: Any) -> None:
    """Refuse a value that is not of the kind of a type hint.

    Raises
    ------
    InputError
        Naming the value, or the part of it that is wrong.
    """
    wrong = _wrong(name, value, hint)
    if wrong is not None:
        raise InputError(wrong)


def check_fields(thing: Any) -> None:
    """Refuse a dataclass whose fields are not of the kinds that it declares, as `checked` does arguments.

    Raises
    ------
    InputError
        Naming the field.
    """
    kind: Any = type(thing)
    for name, hint in _field_hints(kind).items():
        check_kind(name, getattr(thing, name), hint)


@functools.cache
def _field_hints(kind: Any) -> dict[str, Any]:
    hints = get_type_hints(kind)
    return {each.name: hints[each.name] for each in fields(kind)}


def is_name(value: Any) -> bool:
    """Return whether a value is a string that is not empty and holds nothing that a reader cannot see.

    Examples
    --------
    >>> is_name("θ_1"), is_name("free end"), is_name(""), is_name("a" + chr(27)), is_name(3)
    (True, True, False, False, False)
    """
    return isinstance(value, str) and value != "" and not any(map(_is_hidden, value))


def is_sequence(value: Any) -> bool:
    """Return whether a value has a length and things in it, and is no string."""
    return _is_kind(value, Sequence)


def _is_hidden(character: str) -> bool:
    """Return whether a character is not shown."""
    return unicodedata.category(character) in HIDDEN_CATEGORIES


def visible(text: str) -> str:
    r"""Return a text whose hidden characters, but for ends of lines, are written as Python writes them.

    Examples
    --------
    >>> print(visible("a" + chr(27) + "[31m"))
    a\x1b[31m
    """
    hidden = (each != "\n" and _is_hidden(each) for each in text)
    return "".join(repr(each)[1:-1] if hides else each for each, hides in zip(text, hidden, strict=True))


def short(value: Any) -> str:
    """Return how a message shows a value: as Python writes it, or its type where that is long."""
    try:
        text = repr(value)
    except Exception:  # noqa: BLE001 - a repr of somebody else's may fail by anything
        text = "\n"
    if len(text) <= MAX_REPR_LENGTH and "\n" not in text:
        return text
    return repr(value[: MAX_REPR_LENGTH // 2] + "...") if isinstance(value, str) else f"a {type(value).__name__}"


def _wrong(name: str, value: Any, hint: Any) -> str | None:
    """Return what is wrong with a value, or None."""
    if not _says_much(hint):
        return None
    origin, parts = get_origin(hint) or hint, get_args(hint)
    if origin in (Union, types.UnionType):
        found = [_wrong(name, value, part) for part in parts]
        if None in found:
            return None
        # Of a list of wrong things the wrong one is named, if the list itself could be meant.
        inner = [text for text in found if text is not None and not text.startswith(f"{name} = ")]
        return inner[0] if inner else _must_be(name, value, hint)
    if origin is Literal:
        # An array or a table compared with a word is no truth value.
        known = any(type(value) is type(part) and value == part for part in parts)
        return None if known else _must_be(name, value, hint)
    if not _is_kind(value, origin):
        return _must_be(name, value, hint)
    if origin is tuple:
        if parts and parts[-1] is not ... and len(parts) != len(value):
            return f"{name} = {short(value)} must hold {len(parts)} things, and holds {len(value)}"
        each = [parts[0]] * len(value) if parts and parts[-1] is ... else parts
        return _first(
            _wrong(f"{name}[{i}]", part, kind) for i, (part, kind) in enumerate(zip(value, each, strict=False))
        )
    if origin in (Sequence, Collection, Iterable, list) and parts and _is_sized(value):
        return _first(_wrong(f"{name}[{i}]", part, parts[0]) for i, part in enumerate(value))
    if origin in (Mapping, dict) and parts:
        return _first(
            _wrong(f"a key of {name}", key, parts[0]) or _wrong(f"{name}[{short(key)}]", part, parts[1])
            for key, part in value.items()
        )
    return None


def _first(found: Iterable[str | None]) -> str | None:
    return next((each for each in found if each is not None), None)


def _is_kind(value: Any, kind: Any) -> bool:
    if kind in (float, int):
        return isinstance(value, Real if kind is float else Integral) and not isinstance(value, bool | np.bool_)
    if kind is bool:
        return isinstance(value, bool | np.bool_)
    if kind in (Sequence, Collection, Iterable, list):
        return (
            isinstance(value, Iterable)
            and not isinstance(value, str | bytes)
            and not (isinstance(value, np.ndarray) and value.ndim == 0)
            and (kind is Iterable or _is_sized(value))
        )
    if kind is tuple:
        return isinstance(value, tuple | list)
    if kind is Callable or kind is typing.Callable:
        return callable(value)
    if kind is np.ndarray:
        return isinstance(value, np.ndarray) and value.dtype.kind in "fiu"
    if kind is dict:
        kind = Mapping
    return isinstance(value, kind) if isinstance(kind, type) else True


def _is_sized(value: Any) -> bool:
    try:
        return len(value) >= 0
    except TypeError:  # an array without a dimension has no length
        return False


def _must_be(name: str, value: Any, hint: Any) -> str:
    if isinstance(value, str) and any((get_origin(each) or each) is Sequence for each in _kinds(hint)):
        return f"{name} = {short(value)} must be a sequence: write [{value!r}]"
    remedies = [REMEDY[each.__name__] for each in _kinds(hint) if getattr(each, "__name__", "") in REMEDY]
    words = " or ".join(dict.fromkeys(_words(each) for each in _kinds(hint)))
    return f"{name} = {short(value)} must be {words}" + (f": {remedies[0]}" if remedies else "")


def _kinds(hint: Any) -> list[Any]:
    if get_origin(hint) in (Union, types.UnionType):
        return [kind for part in get_args(hint) for kind in _kinds(part)]
    return [hint]


def _words(hint: Any) -> str:
    origin = get_origin(hint) or hint
    if origin is Literal:
        return " or ".join(map(repr, get_args(hint)))
    if origin is tuple:
        return f"a tuple of {len(get_args(hint))}" if get_args(hint)[-1] is not ... else "a tuple"
    if origin in WORDS:
        return WORDS[origin]
    name = getattr(origin, "__name__", str(origin))
    return f"{'an' if name[0] in 'AEIO' or name.startswith('LCP') else 'a'} {name}"
