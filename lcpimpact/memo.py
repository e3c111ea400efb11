"""Memory of objects that do not change: the results that have been computed from them, as long as they live."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from functools import partial, wraps
from typing import Any, TypeVar

T = TypeVar("T")
M = TypeVar("M", bound="Memo")


class Memo:
    """Base of frozen objects from which results are computed once.

    Attributes
    ----------
    memo : dict
        The results by key. They live as long as the object, and are neither compared, nor pickled, nor handed to a changed
        copy of it.

    Examples
    --------
    >>> from dataclasses import dataclass, replace
    >>> from lcpimpact.memo import Memo, remembered
    >>> @dataclass(frozen=True)
    ... class Number(Memo):
    ...     value: float
    >>> two = Number(2.0)
    >>> remembered(two, "square", lambda: two.value**2), two.memo
    (4.0, {'square': 4.0})
    >>> replace(two, value=3.0).memo
    {}
    """

    @property
    def memo(self) -> dict[Hashable, Any]:
        """The results by key."""
        found: dict[Hashable, Any] = vars(self).setdefault("_memo", {})
        return found

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_memo"}


def remembered(owner: Memo, key: Hashable, compute: Callable[[], T]) -> T:
    """Return a result that depends on its owner and on a key alone; it is computed once."""
    memo = owner.memo
    if key not in memo:
        memo[key] = compute()
    found: T = memo[key]
    return found


def once(function: Callable[[M], T]) -> Callable[[M], T]:
    """Let a function of an object compute its result once for each."""

    @wraps(function)
    def read(owner: M) -> T:
        return remembered(owner, function, partial(function, owner))

    return read
