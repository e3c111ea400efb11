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
from typing import Any, Literal, ParamSpec, TypeAlias, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from lcpimpact.errors import InputError

P = ParamSpec("P")
R = TypeVar("R")

Hint: TypeAlias = type | types.GenericAlias | types.UnionType | TypeVar
"""An annotation, as `typing.get_type_hints` reads it."""

HIDDEN_CATEGORIES = ("Cc", "Cf", "Cs")
"""Unicode categories of control and format characters and of surrogates."""

WORDS: dict[Any, str] = {
    float: "a number", int: "a whole number", bool: "True or False", str: "a string", Path: "a path", type(None): "None",
    Sequence: "a sequence", Iterable: "an iterable", Collection: "a collection", Mapping: "a mapping",
    Callable: "a function", np.ndarray: "an array of numbers",
}  # fmt: skip

REMEDIES = {
    "Problem": "get one from load_problem(...), or make one of a Scheme",
    "Trajectory": "get one from simulate(...)",
    "DataFrame": "get one from a study, as convergence(...), or make one of your data",
}
"""Remedies for a missing object: the calls that give one, by the name of its type."""


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """Check the types of the arguments of a function against its annotations.

    Integers and NumPy numbers are numbers, a bool is not; lists, tuples and arrays are sequences, a string is not. The
    function itself checks the values.

    Raises
    ------
    InputError
        By the decorated function, naming the argument, its value and the required type.

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
    def kinds() -> dict[str, tuple[frozenset[type], Hint]]:
        hints = get_type_hints(function)
        return {name: (_types_of(hints[name]), hints[name]) for name in names if _is_restrictive(hints.get(name, Any))}

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        known = kinds()
        for name, value in (*zip(names, args, strict=False), *kwargs.items()):
            if name in known and type(value) not in known[name][0]:
                check_kind(name, value, known[name][1])
        return function(*args, **kwargs)

    return call


def _is_restrictive(hint: Hint) -> bool:
    """Return whether a hint excludes any value; array-like arguments are left to NumPy."""
    arrays = any(getattr(get_origin(part), "__name__", "") == "_SupportsArray" for part in get_args(hint))
    return hint is not Any and not isinstance(hint, TypeVar) and not arrays


def _types_of(hint: Hint) -> frozenset[type]:
    """Return classes whose instances satisfy a hint without a check of their items."""
    if get_origin(hint) in (Union, types.UnionType):
        return frozenset().union(*map(_types_of, get_args(hint)))
    if hint is float:
        return frozenset((float, int, np.float64))
    return frozenset((hint,)) if type(hint) is type and hint is not np.ndarray else frozenset()


def check_kind(name: str, value: Any, hint: Hint) -> None:
    """Check a value against a type hint.

    Raises
    ------
    InputError
        Naming the value, or the invalid part of it.
    """
    error = _find_error(name, value, hint)
    if error is not None:
        raise InputError(error)


def check_fields(thing: Any) -> None:
    """Check the fields of a dataclass against their annotations, as `checked` does for arguments.

    Raises
    ------
    InputError
        Naming the field.
    """
    kind: Any = type(thing)
    for name, hint in _field_hints(kind).items():
        check_kind(name, getattr(thing, name), hint)


@functools.cache
def _field_hints(kind: type) -> dict[str, Hint]:
    hints = get_type_hints(kind)
    return {each.name: hints[each.name] for each in fields(kind)}


def is_name(value: Any) -> bool:
    """Return whether a value is a non-empty string without control or format characters.

    Examples
    --------
    >>> is_name("θ_1"), is_name("free end"), is_name(""), is_name("a" + chr(27)), is_name(3)
    (True, True, False, False, False)
    """
    return isinstance(value, str) and value != "" and _is_visible(value)


def is_sequence(value: Any) -> bool:
    """Return whether a value is a sequence and no string."""
    return _is_kind(value, Sequence)


@functools.lru_cache(4096)
def _is_visible(text: str) -> bool:
    return not any(map(_is_hidden, text))


def _is_hidden(character: str) -> bool:
    """Return whether a character is invisible."""
    return unicodedata.category(character) in HIDDEN_CATEGORIES


def visible(text: str) -> str:
    r"""Return a text with its hidden characters, except line ends, as Python escape sequences.

    Examples
    --------
    >>> print(visible("a" + chr(27) + "[31m"))
    a\x1b[31m
    """
    hidden = (each != "\n" and _is_hidden(each) for each in text)
    return "".join(repr(each)[1:-1] if hides else each for each, hides in zip(text, hidden, strict=True))


def short(value: Any, *, max_repr_length: int = 60) -> str:
    """Return the representation of a value in a message: its repr, or its type if that is long.

    ``max_repr_length``: maximum number of characters of a value in an error.
    """
    try:
        text = repr(value)
    except Exception:  # noqa: BLE001 - a foreign __repr__ may raise anything
        text = "\n"
    if len(text) <= max_repr_length and "\n" not in text:
        return text
    return repr(value[: max_repr_length // 2] + "...") if isinstance(value, str) else f"a {type(value).__name__}"


def _find_error(name: str, value: Any, hint: Hint) -> str | None:
    """Return the error message for a value, or None."""
    if not _is_restrictive(hint):
        return None
    origin, parts = get_origin(hint) or hint, get_args(hint)
    if origin in (Union, types.UnionType):
        found = [_find_error(name, value, part) for part in parts]
        if None in found:
            return None
        # If the container fits one of the alternatives, its invalid item is named.
        part_errors = [text for text in found if text is not None and not text.startswith(f"{name} = ")]
        return part_errors[0] if part_errors else _must_be(name, value, hint)
    if origin is Literal:
        # Comparing an array or a table with a string does not give a bool.
        known = any(type(value) is type(part) and value == part for part in parts)
        return None if known else _must_be(name, value, hint)
    if not _is_kind(value, origin):
        return _must_be(name, value, hint)
    if origin is tuple:
        if parts and parts[-1] is not ... and len(parts) != len(value):
            return f"{name} = {short(value)} must have {len(parts)} items, and has {len(value)}"
        each = [parts[0]] * len(value) if parts and parts[-1] is ... else parts
        return _first(
            _find_error(f"{name}[{i}]", part, kind) for i, (part, kind) in enumerate(zip(value, each, strict=False))
        )
    if origin in (Sequence, Collection, Iterable, list) and parts and _is_sized(value):
        return _first(_find_error(f"{name}[{i}]", part, parts[0]) for i, part in enumerate(value))
    if origin in (Mapping, dict) and parts:
        return _first(
            _find_error(f"a key of {name}", key, parts[0]) or _find_error(f"{name}[{short(key)}]", part, parts[1])
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
    except TypeError:  # a zero-dimensional array has no length
        return False


def _must_be(name: str, value: Any, hint: Hint) -> str:
    if isinstance(value, str) and any((get_origin(each) or each) is Sequence for each in _alternatives(hint)):
        return f"{name} = {short(value)} must be a sequence: write [{value!r}]"
    named = [getattr(each, "__name__", "") for each in _alternatives(hint)]
    remedies = [REMEDIES[each] for each in named if each in REMEDIES]
    descriptions = " or ".join(dict.fromkeys(_describe(each) for each in _alternatives(hint)))
    return f"{name} = {short(value)} must be {descriptions}" + (f": {remedies[0]}" if remedies else "")


def _alternatives(hint: Hint) -> list[Hint]:
    if get_origin(hint) in (Union, types.UnionType):
        return [kind for part in get_args(hint) for kind in _alternatives(part)]
    return [hint]


def _describe(hint: Hint) -> str:
    origin = get_origin(hint) or hint
    if origin is Literal:
        return " or ".join(map(repr, get_args(hint)))
    if origin is tuple:
        return f"a tuple of {len(get_args(hint))}" if get_args(hint)[-1] is not ... else "a tuple"
    if origin in WORDS:
        return WORDS[origin]
    name = getattr(origin, "__name__", str(origin))
    return f"{'an' if name[0] in 'AEIO' or name.startswith('LCP') else 'a'} {name}"
