"""Progress of a study: a bar, or a function of the caller."""

from __future__ import annotations

from collections.abc import Callable, Iterable
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
