"""The logger of lcpimpact, and the progress bars, which its level hides."""

from __future__ import annotations

import logging
import warnings
from functools import cache
from typing import Any

LOG = logging.getLogger("lcpimpact")
"""Runs are logged at the level INFO, compiled functions at DEBUG if asked for, faults of the cache at WARNING."""


def bar_disabled(progress: bool) -> bool | None:
    """Return tqdm's option ``disable`` for a bar: hidden if unwanted or the level is above WARNING, else off a terminal.

    Examples
    --------
    >>> bar_disabled(False), bar_disabled(True)
    (True, None)
    """
    return None if progress and LOG.isEnabledFor(logging.WARNING) else True


def progress_bar(progress: bool, *items: Any, **options: Any) -> Any:
    """Return a bar of tqdm that shows after one second: a widget in notebooks with ipywidgets, a line on a terminal."""
    return _tqdm()(*items, delay=1.0, disable=bar_disabled(progress), **options)


@cache
def _tqdm() -> Any:
    """Return the class of bars, without the warning in notebooks that there is no ipywidgets."""
    from tqdm import TqdmWarning

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", category=TqdmWarning)
        from tqdm.auto import tqdm
    return tqdm
