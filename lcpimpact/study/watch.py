"""Progress of a study: it passes its tasks, or its results, through a function of the caller."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, TypeAlias

Watch: TypeAlias = Callable[[Iterable[Any], int, str], Iterable[Any]]
"""Given things, their number and what they are, yields them: the place for a progress bar."""


def unwatched(items: Iterable[Any], total: int, what: str) -> Iterable[Any]:
    """Return the things, and show nothing."""
    return items
