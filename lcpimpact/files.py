"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from lcpimpact.errors import InputError


def check_output(path: Path, endings: Iterable[str]) -> None:
    """Refuse, before any work is done, a file whose ending tells no known format or whose folder cannot be written.

    Raises
    ------
    InputError
        Naming the file and what to give instead.
    """
    if path.suffix not in endings:
        raise InputError(f"cannot write {str(path)!r}: the name must end in one of {', '.join(endings)}")
    folder = _followed(path).parent
    if not folder.is_dir():
        raise InputError(f"cannot write {str(path)!r}: there is no folder {str(folder)!r}; make it, or name another")
    if not os.access(folder, os.W_OK):
        raise InputError(f"cannot write {str(path)!r}: the folder may not be written to; name another")


@contextmanager
def reading(path: Path, smaller: str) -> Iterator[None]:
    """Say of which file an error is, and of one that does not fit in memory what to give instead.

    Raises
    ------
    InputError
        For an InputError, a file that cannot be read, and one that is too large.
    """
    try:
        yield
    except InputError as error:
        raise InputError(f"cannot read {str(path)!r}: {error}") from None
    except OSError as error:
        raise InputError(
            f"cannot read {str(path)!r}: {error.strerror or error}; check the name and the rights"
        ) from None
    except MemoryError:
        raise InputError(f"cannot read {str(path)!r}: it does not fit in memory; {smaller}") from None


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give a name beside ``path`` to write to, and rename it to ``path`` only when that went well.

    Where ``path`` is a symbolic link, the file that it points to is written, and the link stays.

    Raises
    ------
    InputError
        If the file cannot be written; nothing is left behind.
    """
    with whole_files(path) as (part,):
        yield part


@contextmanager
def whole_files(*paths: Path) -> Iterator[tuple[Path, ...]]:
    """Do as `whole_file` for files that belong together: all of them are replaced, or none is."""
    targets, parts = [_followed(path) for path in paths], list[Path]()
    try:
        for target in targets:
            parts.append(_beside(target))
    except OSError as error:
        _remove(parts)
        raise InputError(f"cannot write {_names(paths)}: {error.strerror}; name a folder that can be written") from None
    try:
        yield tuple(parts)
        for part in parts:
            part.chmod(0o666 & ~_umask())
        _replace(parts, targets)
    except OSError as error:
        raise InputError(f"cannot write {_names(paths)}: {error.strerror or error}; nothing was changed") from None
    finally:
        _remove(parts)


def _replace(parts: Sequence[Path], targets: Sequence[Path]) -> None:
    """Rename each part to its target; if one cannot be renamed, those before it are put back as they were."""
    kept: list[tuple[Path, Path | None]] = []
    try:
        for part, target in zip(parts, targets, strict=True):
            # What is renamed last needs no copy: nothing can fail after it.
            if part != parts[-1]:
                kept.append((target, _beside(target) if target.exists() else None))
                if kept[-1][1]:
                    shutil.copy2(target, kept[-1][1])
            part.replace(target)
    except OSError:
        for (target, copy), part in zip(kept, parts, strict=False):
            if part.exists():
                continue
            if copy:
                copy.replace(target)
            else:
                target.unlink()
        raise
    finally:
        _remove([copy for _, copy in kept if copy])


def _followed(path: Path) -> Path:
    """Return the file that a symbolic link points to in the end, whether it exists or not, and else the path itself."""
    target = Path(os.path.realpath(path)) if path.is_symlink() else path
    if target.is_symlink():
        raise InputError(f"cannot write {str(path)!r}: it is a link to itself; name another")
    return target


def _beside(path: Path) -> Path:
    """Make an empty file of a new name in the folder of ``path``."""
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=path.suffix, dir=path.parent)
    os.close(handle)
    return Path(name)


def _remove(parts: Iterable[Path]) -> None:
    for part in parts:
        part.unlink(missing_ok=True)


def _names(paths: Sequence[Path]) -> str:
    return " and ".join(repr(str(path)) for path in paths)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
