"""The logger of lcpimpact, and the progress bars, which its level hides."""

from __future__ import annotations

import logging

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
