"""Names that are imported when they are first used, read from the stubs that show them to type checkers."""

from __future__ import annotations

from os import PathLike, fspath
from typing import Any


def exports(stub: str | PathLike[str]) -> dict[str, str]:
    """Return the sources of the names of a stub: ``"module:name"`` for each line ``from module import name as name``."""
    loader: Any = globals()["__loader__"]  # which reads from a zip application too
    text = loader.get_data(fspath(stub)).decode()
    lines = [line.split() for line in text.splitlines() if line.startswith("from ") and " as " in line]
    return {name: f"{module}:{name}" for _, module, _, name, _, _ in lines}
