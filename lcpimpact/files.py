"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Iterator
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
    if not path.parent.is_dir():
        raise InputError(
            f"cannot write {str(path)!r}: there is no folder {str(path.parent)!r}; make it, or name another"
        )
    if not os.access(path.parent, os.W_OK):
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

    Raises
    ------
    InputError
        If the file cannot be written; nothing is left behind.
    """
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=path.suffix, dir=path.parent)
        os.close(handle)
    except OSError as error:
        raise InputError(f"cannot write {str(path)!r}: {error.strerror}; name a folder that can be written") from None
    part = Path(name)
    try:
        yield part
        part.chmod(0o666 & ~_umask())
        part.replace(path)
    except OSError as error:
        raise InputError(f"cannot write {str(path)!r}: {error.strerror or error}; nothing was changed") from None
    finally:
        part.unlink(missing_ok=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
