"""The cache of compiled code: one folder for each version of the source; unused ones are removed.

Each folder has a ``CACHEDIR.TAG``, which identifies it, excludes it from backups, and stores the time of last use. What it
holds is executed, so a folder in which others can write is not used.
"""

from __future__ import annotations

import errno
import hashlib
import os
import shutil
import stat
import time
import uuid
from contextlib import suppress
from functools import cache
from multiprocessing import parent_process
from pathlib import Path

from platformdirs import user_cache_path

from lcpimpact.logs import LOG

TAG = "CACHEDIR.TAG"

SIGNATURE = (
    "Signature: 8a477f597d28d172789f06886806bc55\n# Compiled code of lcpimpact: it may be removed at any time.\n"
)
"""The first line is prescribed: https://bford.info/cachedir."""

DAY = 86_400.0

FORMER_NAMES = {
    "LCPIMPACT_CACHE": "NUMBA_CACHE_DIR",
    "LCPIMPACT_COMPILE": "NUMBA_DISABLE_JIT",
    "LCPIMPACT_CPU": "NUMBA_CPU_NAME",
}
"""Environment variables: the folder of the cache, when to compile, and for which processor, with their former names."""

GENERATED = "generated"
"""Folder of the code of generated sources, of which many patterns have one each."""


def variable(name: str) -> str:
    """Return the value of an environment variable, else that of its former name, else an empty text."""
    former = os.environ.get(FORMER_NAMES[name], "")
    if name == "LCPIMPACT_COMPILE":
        former = "never" if former not in ("", "0") else ""
    return os.environ.get(name) or former


def base() -> Path:
    """Return the parent folder of the compiled code of all versions of the source."""
    return Path(variable("LCPIMPACT_CACHE") or user_cache_path("lcpimpact"))


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

    A function's code is known by the source of that function; the name of the folder tells that of the functions it calls.
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
        folder().mkdir(mode=0o700, parents=True, exist_ok=True)
        check_owner()
        tag.write_text(SIGNATURE)
        remove_unused()
    except PermissionError:
        check_owner()  # a folder of the administrator can still be read


def check_owner() -> None:
    """Check that nobody but this user and the administrator can have written in the folder.

    Raises
    ------
    PermissionError
        Naming what is wrong.
    """
    if not hasattr(os, "geteuid"):  # Windows, where the folder of a user is closed to others
        return
    found = folder().lstat()
    if not stat.S_ISDIR(found.st_mode):
        raise PermissionError(errno.EACCES, "it is no folder but a link or a file")
    if found.st_uid not in (os.geteuid(), 0):
        raise PermissionError(errno.EACCES, f"the folder belongs to another user, {found.st_uid}")
    if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise PermissionError(errno.EACCES, f"others can write in the folder: its mode is {found.st_mode & 0o777:o}")


@cache
def usable() -> bool:
    """Return whether there is a folder for compiled code that nobody else can write in, and mark it as used."""
    try:
        mark_used()
        check_owner()
    except OSError as error:
        warn_once(f"is not kept ({reason(error)}) and is compiled again in each run")
        return False
    return True


def code_file(name: str) -> Path | None:
    """Return the file of a name in the folder; None if no folder is usable."""
    return folder() / name if usable() else None


def keep(path: Path, content: bytes) -> bool:
    """Write a file of the folder whole, which only this user can change; return whether there was room for it."""
    part = path.with_name(f"{path.name}.{uuid.uuid4().hex[:8]}.part")
    try:
        path.parent.mkdir(mode=0o700, exist_ok=True)
        try:
            part.write_bytes(content)
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        warn_once(f"cannot be saved ({reason(error)}) and is compiled again in each run")
        return False
    return True


def keep_code(path: Path, code: bytes) -> None:
    """Write compiled code, with a hash of it and of its name, by which damaged and wrong code is known."""
    keep(path, hashlib.sha256(path.name.encode() + code).digest() + code)


def kept_code(path: Path) -> bytes:
    """Return the compiled code of a file.

    Raises
    ------
    OSError, ValueError
        If it cannot be read, or is damaged.
    """
    content = path.read_bytes()
    code = content[32:]
    if content[:32] != hashlib.sha256(path.name.encode() + code).digest():
        raise ValueError(f"{path.name} is damaged")
    return code


def forget_generated(*, most: int = 200) -> None:
    """Remove the oldest code of generated sources, where there is more of it than the ``most`` files."""
    with suppress(OSError):  # another process removed some meanwhile
        files = sorted((folder() / GENERATED).glob("*"), key=lambda each: each.stat().st_mtime)
        for each in files[:-most]:
            each.unlink()


@cache
def source_hash(file: str) -> str | None:
    """Return the hash of a source file, which may belong to another package."""
    return hashlib.sha256(Path(file).read_bytes()).hexdigest() if Path(file).exists() else None


def reason(error: Exception) -> str:
    """Return the reason of an error in few words."""
    return (error.strerror if isinstance(error, OSError) else None) or str(error) or type(error).__name__


warned: list[str] = []
"""Warnings about the cache in this process."""


def warn_once(what: str) -> None:
    """Warn about the cache, once in a program: not for each function, and not in each worker."""
    if not warned and parent_process() is None:
        LOG.warning(
            "lcpimpact: the compiled code in %s %s; `lcpimpact cache --clear` empties the folder, and the environment "
            "variable LCPIMPACT_CACHE names another",
            folder(),
            what,
        )
    warned.append(what)


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


def remove_unused(*, max_folders: int = 3, max_idle: float = 30.0 * DAY) -> None:
    """Remove long unused folders of other versions, except the newest few.

    ``max_folders``: number of folders of other versions that are kept regardless of their age.
    ``max_idle``: time without use after which a folder is removed [s].
    """
    others = [each for each in folders() if each != folder()]
    for each in others[max_folders:]:
        with suppress(OSError):  # removed meanwhile, or without permission
            if time.time() - (each / TAG).stat().st_mtime > max_idle:
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
