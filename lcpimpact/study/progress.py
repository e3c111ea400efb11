"""Progress of a study: a progress bar, or a function of the caller."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TypeAlias, TypeVar

from lcpimpact.logs import progress_bar

T = TypeVar("T")

Progress: TypeAlias = bool | Callable[[Iterable[Any], int, str], Iterable[Any]]
"""Whether progress is shown, as by `lcpimpact.logs.progress_bar`; or a function in its place, which takes items, their
number and their name, and yields the items."""

LAYOUT = "{desc:<17}{bar:30} {n_fmt}/{total_fmt} {elapsed}"


def watched(
    items: Iterable[T], total: int, what: str, progress: Progress, *, stage: bool = False, soon: float = 1e-9
) -> Iterable[T]:
    """Return an iterable of the items that shows progress during iteration, and of a ``stage`` the end in any case.

    ``soon``: delay in s of the bar of a stage, below the resolution of the clock; without any it would show the start too.
    """
    if callable(progress):
        return progress(items, total, what)
    delay = {"delay": soon} if stage else {}
    shown: Iterable[T] = progress_bar(progress, items, total=total, desc=what, bar_format=LAYOUT, **delay)
    return shown


def ignore_count(number: int) -> None:
    """Ignore the number of items done."""


@contextmanager
def counted(total: int, what: str, progress: Progress) -> Iterator[Callable[[int], None]]:
    """Show the progress of work that is not a loop: call the yielded function with the number of items done.

    Examples
    --------
    >>> with counted(3, "roots", False) as done:
    ...     done(1)
    ...     done(3)
    """
    steps = iter(watched(range(total), total, what, progress))
    shown = 0

    def done(number: int) -> None:
        nonlocal shown
        for _ in range(shown, number + 1):  # an item counts as done when the next one is requested
            next(steps, None)
        shown = max(shown, number + 1)

    done(0)
    try:
        yield done
    finally:
        if isinstance(steps, Generator):
            steps.close()
