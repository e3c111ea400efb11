"""The logger of lcpimpact, and the progress bars, which its level hides."""

from __future__ import annotations

import logging
import sys
import warnings
from functools import cache
from typing import Any

LOG = logging.getLogger("lcpimpact")
"""Runs are logged at the level INFO, compiled functions at DEBUG, faults of the cache at WARNING."""


SECONDS_A_LINE = 10.0
"""Seconds between two lines of progress where the output is a file or a pipe."""


class Lines:
    """The standard error stream where it is a file or a pipe: each state of a bar is a line of its own."""

    def write(self, text: str) -> None:
        """Write a state of a bar as a line."""
        if state := text.strip():
            sys.stderr.write(f"{state}\n")

    def flush(self) -> None:
        """Flush the stream."""
        sys.stderr.flush()


def bars_shown(progress: bool) -> bool:
    """Return whether bars are shown: they are wanted, and the level of the logger is not above WARNING.

    Examples
    --------
    >>> bars_shown(False), bars_shown(True)
    (False, True)
    """
    return progress and LOG.isEnabledFor(logging.WARNING)


def progress_bar(progress: bool, *items: Any, **options: str | float | Lines) -> Any:
    """Return a bar of tqdm.

    It shows after one second, as a line on a terminal or a widget in notebooks with ipywidgets. In a file or a pipe a line
    is written every ten seconds. The option ``delay`` is the time after which it shows.
    """
    bars = _tqdm()
    if bars.__module__ == "tqdm.asyncio" and not (sys.stderr and sys.stderr.isatty()):  # no notebook, no terminal
        options = {"delay": SECONDS_A_LINE} | options | {"file": Lines(), "mininterval": SECONDS_A_LINE}
    return bars(*items, **({"delay": 1.0} | options), disable=not bars_shown(progress))


@cache
def _tqdm() -> Any:
    """Return the class of bars, without the warning in notebooks that there is no ipywidgets."""
    from tqdm import TqdmWarning

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", category=TqdmWarning)
        from tqdm.auto import tqdm
    return tqdm
