"""Free memory, so that problems that do not fit are refused before allocation."""

from __future__ import annotations

import os
from pathlib import Path

from lcpimpact.errors import InputError

FREE_FRACTION = 0.9
"""Largest fraction of the free memory for one object."""

SMALL = 3e7
"""Bytes that are not worth reading how many are free."""

CGROUP = Path("/sys/fs/cgroup")
"""Folder in which Linux states the memory limits of a container or a job."""


def free_memory() -> float:
    """Return the memory in bytes that a process may still allocate, or inf if unknown."""
    return min(_of_machine(), _of_group())


def check_memory(wanted: float, what: str, remedy: str) -> None:
    """Raise an error if an object does not fit in the free memory.

    Parameters
    ----------
    wanted : float
        Bytes.
    what : str
        Subject and verb of the message: "1,000 steps do".
    remedy : str
        Advice at the end of the message.

    Raises
    ------
    InputError
        With both numbers and the remedy.
    """
    if wanted < SMALL:
        return
    free = free_memory()
    if wanted > FREE_FRACTION * free:
        raise InputError(
            f"{what} not fit in memory: about {wanted / 1e9:.3g} GB are needed, and {free / 1e9:.3g} GB are free; {remedy}"
        )


def _of_machine() -> float:
    try:
        for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                return 1024.0 * float(line.split()[1])
    except (OSError, ValueError, IndexError):
        pass
    for pages in ("SC_AVPHYS_PAGES", "SC_PHYS_PAGES"):
        try:
            return float(os.sysconf(pages) * os.sysconf("SC_PAGE_SIZE"))
        except (AttributeError, ValueError, OSError):
            continue
    return float("inf")


def _of_group() -> float:
    try:
        most, used = ((CGROUP / name).read_text(encoding="ascii") for name in ("memory.max", "memory.current"))
        return max(0.0, float(most) - float(used))
    except (OSError, ValueError):  # "max" where there is no limit
        return float("inf")
