"""Processes of Python beside this one, which end when it ends."""

from __future__ import annotations

import os
import subprocess
import sys
from functools import cache

WATCH = "import os, threading; threading.Thread(target=lambda: os.read(0, 1) or os._exit(1), daemon=True).start()"
"""Ends a process when its standard input does: even a parent that is killed closes the other end of the pipe."""


@cache
def life_line() -> int:
    """Return the reading end of a pipe in which nothing is written, and whose other end is open while this process runs."""
    reading, writing = os.pipe()

    def let_go() -> None:
        os.close(writing)
        life_line.cache_clear()

    if hasattr(os, "register_at_fork"):
        os.register_at_fork(after_in_child=let_go)
    return reading


def start_python(code: str) -> subprocess.Popen[bytes]:
    """Start a process that runs code, with the path of this one: with its own it would import what lies in the folder.

    Raises
    ------
    OSError
        If it cannot be started.
    """
    if not sys.executable:
        raise FileNotFoundError("the program of Python is not known")
    path = f"import sys; sys.path[:] = {sys.path!r}"
    command = [sys.executable, "-c", f"{WATCH}; {path}; {code}"]
    return subprocess.Popen(command, stdin=life_line(), stderr=subprocess.DEVNULL)
