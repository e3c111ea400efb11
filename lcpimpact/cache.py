"""The cache of compiled code: one folder for each version of the source; old ones are removed.

Each bears a ``CACHEDIR.TAG``, by which it is known as ours and backups pass it over, and whose time is that of last use.
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
"""Number of folders of other versions that are kept, however old."""

MAX_IDLE = 30.0 * DAY
"""Time without use after which a folder is removed [s]."""


def base() -> Path:
    """Return the folder under which the compiled code of every source lies."""
    return Path(os.environ.get("NUMBA_CACHE_DIR") or user_cache_path("lcpimpact"))


@cache
def folder() -> Path:
    """Return the folder of the compiled code of exactly this source; it need not exist.

    numba's own cache does not notice that a function called from another file has changed, so the name is a hash of all
    files of the package.
    """
    digest = hashlib.sha256()
    package = Path(__file__).parent
    for file in sorted(package.rglob("*.py")):
        digest.update(file.relative_to(package).as_posix().encode())
        digest.update(file.read_bytes())
    return base() / digest.hexdigest()[:16]


def note_use() -> None:
    """Make the folder of this source, or mark it as used today; a new one lets those long unused go.

    Raises
    ------
    OSError
        If it can be neither found nor made.
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
        pass  # a folder of somebody else's may be read all the same


def folders() -> list[Path]:
    """Return the folders of compiled code of all sources, those used last first."""
    found = []
    for tag in base().glob(f"*/{TAG}"):
        try:
            if tag.read_text() == SIGNATURE:
                found.append((tag.stat().st_mtime, tag.parent))
        except (OSError, ValueError):
            continue  # gone meanwhile, or not ours
    return [each for _, each in sorted(found, reverse=True)]


def remove_unused() -> None:
    """Remove folders of other sources that were not used for long, but for the newest few."""
    others = [each for each in folders() if each != folder()]
    for each in others[MAX_FOLDERS:]:
        with suppress(OSError):  # gone meanwhile, or not ours to remove
            if time.time() - (each / TAG).stat().st_mtime > MAX_IDLE:
                remove(each)


def remove(path: Path) -> None:
    """Remove a folder of compiled code: renamed first, so that no process finds half of it."""
    doomed = path.with_name(f"{path.name}.{uuid.uuid4().hex[:8]}.removed")
    with suppress(FileNotFoundError):  # another process was faster
        path.rename(doomed)
        shutil.rmtree(doomed)


def size(path: Path) -> int:
    """Return the bytes of all files in a folder."""
    total = 0
    for file in path.rglob("*"):
        with suppress(OSError):  # gone meanwhile
            total += file.stat().st_size
    return total
