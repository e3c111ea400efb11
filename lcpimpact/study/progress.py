"""Progress of a study: a bar, or a function of the caller."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TypeAlias

from tqdm import tqdm

Progress: TypeAlias = bool | Callable[[Iterable[Any], int, str], Iterable[Any]]
"""Whether a bar is shown on a terminal when a study takes more than a second; or a function in place of the bar, which takes
things, their number and what they are, and yields the things."""

LAYOUT = "{desc:<17}{bar:30} {n_fmt}/{total_fmt} {elapsed}"


def watched(items: Iterable[Any], total: int, what: str, progress: Progress) -> Iterable[Any]:
    """Return the things, which show the progress as they are taken."""
    if callable(progress):
        return progress(items, total, what)
    shown: Iterable[Any] = tqdm(
        items, total=total, desc=what, bar_format=LAYOUT, delay=1.0, disable=None if progress else True
    )
    return shown


def unseen(number: int) -> None:
    """Show nothing of how many things are done."""


@contextmanager
def counted(total: int, what: str, progress: Progress) -> Iterator[Callable[[int], None]]:
    """Show the progress of work that is no loop: the function says how many things are done so far.

    Examples
    --------
    >>> with counted(3, "roots", False) as done:
    ...     done(1)
    ...     done(3)
    """
    steps, shown = iter(watched(range(total), total, what, progress)), 0

    def done(number: int) -> None:
        nonlocal shown
        for _ in range(shown, number + 1):  # a thing is done when the next one is asked for
            next(steps, None)
        shown = max(shown, number + 1)

    done(0)
    try:
        yield done
    finally:
        if isinstance(steps, Generator):
            steps.close()
