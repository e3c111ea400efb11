"""Names: every solver, method, problem and element is found by its name here, and loaded only when it is asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from functools import cached_property
from importlib import import_module
from typing import Any, Generic, TypeVar

from lcpimpact.errors import InputError, UnknownNameError

T = TypeVar("T")

SHOWN = 50
"""So many names stand in a message; a bar has more nodes."""


def load(location: str) -> Any:
    """Import ``"package.module:attribute"`` and return the attribute."""
    module, attribute = location.split(":")
    return getattr(import_module(module), attribute)


def nearest(name: str, known: list[str], kind: str) -> str:
    """Return the sentence for an unknown ``name``: the nearest match first, then all that is known."""
    close = get_close_matches(name, known, n=1, cutoff=0.5)
    hint = f"did you mean {close[0]!r}? " if close else ""
    more = f" and {len(known) - SHOWN} more" if len(known) > SHOWN else ""
    return f"unknown {kind} {name!r}: {hint}known are {', '.join(known[:SHOWN]) if known else 'none'}{more}"


class Registry(Mapping[str, T], Generic[T]):
    """A mapping from names to objects that are imported on first use.

    Parameters
    ----------
    kind : str
        What the entries are, for messages: ``"method"``, ``"problem"``, ...
    entries : mapping of str to str
        Name to ``"package.module:attribute"``.
    families : mapping of str to str
        Prefix of a name to the function that makes the entry from the whole name, for what is not listed one by one.
    group : str
        Group of entry points by which other packages add entries; a name that is taken here stays what it is.
    """

    def __init__(
        self, kind: str, entries: Mapping[str, str], families: Mapping[str, str] | None = None, group: str = ""
    ) -> None:
        self.kind = kind
        self._own = dict(entries)
        self._families = dict(families or {})
        self._group = group
        self._loaded: dict[str, T] = {}

    @cached_property
    def _entries(self) -> dict[str, str]:
        """Names to locations, with those that other packages add."""
        if not self._group:
            return self._own
        from importlib.metadata import entry_points

        return {each.name: each.value for each in entry_points(group=self._group)} | self._own

    def __getitem__(self, name: str) -> T:
        entry: T
        if isinstance(name, str) and name in self._loaded:
            return self._loaded[name]
        if not isinstance(name, str):
            raise UnknownNameError(nearest(str(name), list(self._entries), self.kind))
        for prefix, location in self._families.items():
            if name.startswith(prefix):
                entry = load(location)(name)
                return entry
        if name not in self._entries:
            raise UnknownNameError(nearest(name, list(self._entries), self.kind))
        try:
            self._loaded[name] = load(self._entries[name])
        except (ImportError, AttributeError) as error:
            if name in self._own:
                raise
            raise InputError(
                f"{self.kind} {name!r} is registered by another package as {self._entries[name]!r}, which cannot be "
                f"loaded ({error}): mend or uninstall that package"
            ) from None
        return self._loaded[name]

    def __contains__(self, name: object) -> bool:
        try:
            self[name]  # type: ignore[index]
        except InputError:
            return False
        return True

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def get(self, name: str, default: Any = None) -> Any:
        """Return the entry, or ``default`` where the name is unknown."""
        try:
            return self[name]
        except InputError:
            return default

    def __len__(self) -> int:
        return len(self._entries)
