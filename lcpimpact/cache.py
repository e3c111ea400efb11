"""The cache of compiled code: one folder for each version of the source; unused ones are removed.

Each folder has a ``CACHEDIR.TAG``, which identifies it, excludes it from backups, and stores the time of last use.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import time
import uuid
from contextlib import suppress
from functools import cache
from pathlib import Path

from platformdirs import user_cache_path

TAG = "CACHEDIR.TAG"

SIGNATURE = (
    "Signature: 8a477f597d28d172789f06886806bc55\n# Compiled code of lcpimpact: it may be removed at any time.\n"
)
"""The first line is prescribed: https://bford.info/cachedir."""

DAY = 86_400.0

MAX_FOLDERS = 3
"""Number of folders of other versions that are kept regardless of their age."""

MAX_IDLE = 30.0 * DAY
"""Time without use after which a folder is removed [s]."""


def base() -> Path:
    """Return the parent folder of the compiled code of all versions of the source."""
    return Path(os.environ.get("NUMBA_CACHE_DIR") or user_cache_path("lcpimpact"))


@cache
def source() -> str:
    """Return a hash of all files of the package."""
    digest = hashlib.sha256()
    package = Path(__file__).parent
    for file in sorted(package.rglob("*.py")):
        digest.update(file.relative_to(package).as_posix().encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


@cache
def folder() -> Path:
    """Return the folder of the compiled code of this version of the source; it need not exist.

    numba's own cache does not detect changes of a function called from another file, so the name is the hash of the source.
    """
    return base() / source()


def mark_used() -> None:
    """Make the folder of this source and remove unused ones, or mark the existing one as used today.

    Raises
    ------
    OSError
        If it can neither be found nor made.
    """
    tag = folder() / TAG
    try:
        if time.time() - tag.stat().st_mtime < DAY:
            return
        os.utime(tag)
    except FileNotFoundError:
        folder().mkdir(parents=True, exist_ok=True)
        tag.write_text(SIGNATURE)
        remove_unused()
    except PermissionError:
        pass  # a folder of another user can still be read


def folders() -> list[Path]:
    """Return the folders of all versions of the source, the most recently used first."""
    found = []
    for tag in base().glob(f"*/{TAG}"):
        try:
            if tag.read_text() == SIGNATURE:
                found.append((tag.stat().st_mtime, tag.parent))
        except (OSError, ValueError):
            continue  # removed meanwhile, or not a folder of lcpimpact
    return [each for _, each in sorted(found, reverse=True)]


def remove_unused() -> None:
    """Remove long unused folders of other versions, except the newest few."""
    others = [each for each in folders() if each != folder()]
    for each in others[MAX_FOLDERS:]:
        with suppress(OSError):  # removed meanwhile, or without permission
            if time.time() - (each / TAG).stat().st_mtime > MAX_IDLE:
                remove(each)


def remove(path: Path) -> None:
    """Remove a folder of compiled code; it is renamed first, so that no process reads an incomplete one."""
    doomed = path.with_name(f"{path.name}.{uuid.uuid4().hex[:8]}.removed")
    with suppress(FileNotFoundError):  # another process was faster
        path.rename(doomed)
        shutil.rmtree(doomed)


def size(path: Path) -> int:
    """Return the size of all files in a folder in bytes."""
    total = 0
    for file in path.rglob("*"):
        with suppress(OSError):  # removed meanwhile
            total += file.stat().st_size
    return total
