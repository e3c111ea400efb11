"""Registries of solvers, methods, problems and elements by name, loaded on first use."""

from __future__ import annotations

import reprlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from difflib import get_close_matches
from functools import cached_property
from importlib import import_module
from textwrap import shorten
from typing import Any, Generic, TypeVar

from lcpimpact.errors import InputError, UnknownNameError, UnsupportedError

T = TypeVar("T")


def load(location: str) -> Any:
    """Import ``"package.module:attribute"`` and return the attribute."""
    module, attribute = location.split(":")
    return getattr(import_module(module), attribute)


def import_extra(package: str, extra: str) -> Any:
    """Import a package of an extra of lcpimpact.

    Raises
    ------
    UnsupportedError
        Where it is not installed.
    """
    try:
        return import_module(package)
    except ImportError:
        raise UnsupportedError(f"{package} is not installed: pip install 'lcpimpact[{extra}]'") from None


def html_of(thing: Any) -> str:
    """Return the HTML that notebooks show of a problem, scheme, run, solution, trace or study."""
    html: str = load("lcpimpact.report.notebook:html_of")(thing)
    return html


def nearest(name: str, known: list[str], kind: str, also: Sequence[str] = (), *, max_names: int = 30) -> str:
    """Return the error message for an unknown ``name``: the nearest match of ``known`` and ``also``, and the known names.

    ``max_names``: maximum number of names in a message.
    """
    close = [each for each in also if each.startswith(f"{name}_")]
    close = close or get_close_matches(name, [*known, *also], n=1, cutoff=0.5)
    hint = f"did you mean {close[0]!r}? " if close else ""
    more = f" and {len(known) - max_names} more" if len(known) > max_names else ""
    return f"unknown {kind} {name!r}: {hint}known are {', '.join(known[:max_names]) if known else 'none'}{more}"


class Registry(Mapping[str, T], Generic[T]):
    """A mapping from names to objects that are imported on first use.

    Parameters
    ----------
    kind : str
        Kind of the entries, for messages: ``"method"``, ``"problem"``, ...
    entries : mapping of str to str
        Name to ``"package.module:attribute"``.
    families : mapping of str to str
        Prefix of a name to the function that makes the entry from the whole name, for entries that are not listed.
    group : str
        Group of entry points by which other packages add entries; they cannot replace existing names. An entry that cannot
        be loaded is omitted, and listed in `broken`.
    check : str
        The function, as ``"package.module:attribute"``, that raises `InputError` for an invalid entry of another package.
    """

    def __init__(
        self,
        kind: str,
        entries: Mapping[str, str],
        families: Mapping[str, str] | None = None,
        group: str = "",
        check: str = "",
    ) -> None:
        self.kind = kind
        self._own = dict(entries)
        self._families = dict(families or {})
        self._group = group
        self._check = check
        self._loaded: dict[str, T] = {}
        self._broken: dict[str, str] = {}

    @cached_property
    def _added(self) -> dict[str, str]:
        """Name to location of the entries of other packages."""
        found: dict[str, str] = {}
        if self._group:
            from importlib.metadata import distributions

            for package in distributions():
                with suppress(Exception):  # the metadata of a package may be malformed
                    for each in package.entry_points.select(group=self._group):
                        if each.name not in self._own:
                            found.setdefault(each.name, each.value)
        return found

    @property
    def broken(self) -> dict[str, str]:
        """Entries of other packages that cannot be loaded: name to reason."""
        list(self)
        return dict(self._broken)

    def __getitem__(self, name: str) -> T:
        entry: T
        if isinstance(name, str) and name in self._loaded:
            return self._loaded[name]
        if not isinstance(name, str):
            raise InputError(f"{self.kind} = {reprlib.repr(name)} must be a string")
        for prefix, location in self._families.items():
            if name.startswith(prefix):
                entry = load(location)(name)
                return entry
        if name in self._own:
            self._loaded[name] = load(self._own[name])
        elif name in self._added:
            self._loaded[name] = self._load_added(name)
        else:
            raise UnknownNameError(nearest(name, list(self), self.kind))
        return self._loaded[name]

    def _load_added(self, name: str, *, max_error_length: int = 200) -> T:
        # max_error_length: maximum number of characters shown of another package's error.
        location = self._added[name]
        if name not in self._broken:
            try:
                entry: T = load(location)
                if self._check:
                    load(self._check)(entry)
            except (Exception, SystemExit) as error:  # noqa: BLE001 (foreign code may raise anything)
                text = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
                self._broken[name] = shorten(text, max_error_length, placeholder=" ...")
            else:
                return entry
        raise InputError(
            f"{self.kind} {name!r} is registered by another package as {location!r}, which cannot be "
            f"loaded ({self._broken[name]}): repair or uninstall that package"
        )

    def __contains__(self, name: object) -> bool:
        try:
            self[name]  # type: ignore[index]
        except InputError:
            return False
        return True

    def __iter__(self) -> Iterator[str]:
        yield from self._own
        for name in self._added:
            if name in self:
                yield name

    def get(self, name: str, default: Any = None) -> Any:
        """Return the entry, or ``default`` if the name is unknown."""
        try:
            return self[name]
        except InputError:
            return default

    def __len__(self) -> int:
        return sum(1 for _ in self)
