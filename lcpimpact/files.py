"""Atomic file output: files appear whole or not at all."""

from __future__ import annotations

import os
import secrets
import shutil
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import TypeAlias

from lcpimpact.errors import InputError

Json: TypeAlias = bool | int | float | str | Sequence["Json"] | Mapping[str, "Json"] | None
"""A value of plain JSON."""


def check_output(path: Path, endings: Iterable[str]) -> None:
    """Check, before any computation, that a file has a known ending and can be written.

    Raises
    ------
    InputError
        Naming the file and the remedy.
    """
    if path.suffix not in endings:
        raise InputError(f"cannot write {str(path)!r}: the name must end in one of {', '.join(endings)}")
    check_name(path)
    target = _resolved(path)
    folder = target.parent
    if target.is_dir():
        raise InputError(f"cannot write {str(path)!r}: a folder has that name; name another")
    if target.exists() and not os.access(target, os.W_OK):
        raise InputError(
            f"cannot write {str(path)!r}: the file is write-protected; name another, or change its permissions"
        )
    if not folder.is_dir():
        raise InputError(f"cannot write {str(path)!r}: there is no folder {str(folder)!r}; make it, or name another")
    if not os.access(folder, os.W_OK):
        raise InputError(f"cannot write {str(path)!r}: the folder is write-protected; name another")


def check_name(path: Path) -> None:
    """Check that the system takes the name of a file, which it may refuse as too long.

    Raises
    ------
    InputError
        Naming the file and the remedy.
    """
    try:
        os.lstat(path)
    except (FileNotFoundError, NotADirectoryError, ValueError):
        return
    except OSError as error:
        raise InputError(f"cannot write {str(path)!r}: {error.strerror}; name another") from None


def check_outputs(outputs: Iterable[tuple[Path | None, Iterable[str]]], inputs: Iterable[Path] = ()) -> None:
    """Check, before any computation, that the output files of a command can be written and do not collide.

    Within `atomic_outputs` these files are replaced at its end, all of them or none.

    Parameters
    ----------
    outputs : iterable of (path or None, endings)
        As for `check_output`; None is skipped.
    inputs : iterable of Path
        Files that the command reads.

    Raises
    ------
    InputError
        Also if an output would replace an input or another output, directly or through a link.
    """
    named = [(path, endings) for path, endings in outputs if path is not None]
    given = list(inputs)
    for i, (path, endings) in enumerate(named):
        check_output(path, endings)
        for other in given:
            if _is_same_file(path, other):
                raise InputError(f"cannot write {str(path)!r}: the input {str(other)!r} is that file; name another")
        for other, _ in named[:i]:
            if _is_same_file(path, other):
                raise InputError(
                    f"cannot write {str(path)!r}: another output, {str(other)!r}, is that file; name another"
                )
    batch = _batch.get()
    if batch is not None:
        batch.targets.update(Path(os.path.realpath(path)) for path, _ in named)


def make_folder(folder: Path) -> None:
    """Make a folder for output, before any computation, unless it is there.

    Raises
    ------
    InputError
        If it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot make the folder {str(folder)!r}: {error.strerror}; name another with --out") from None


def _is_same_file(a: Path, b: Path) -> bool:
    """Return whether two paths denote the same file, existing or not, also through hard and symbolic links."""
    try:
        return os.path.samefile(a, b)
    except OSError:
        return os.path.realpath(a) == os.path.realpath(b)


STARTS_FORMULA = ("=", "+", "-", "@")


def escape_cell(text: str) -> str:
    """Return a text as a cell of a CSV file: with an apostrophe in front if a spreadsheet would read it as a formula.

    Examples
    --------
    >>> [escape_cell(text) for text in ("x", "=1+1", "'-x")]
    ['x', "'=1+1", "''-x"]
    >>> unescape_cell(escape_cell("'-x"))
    "'-x"
    """
    return f"'{text}" if text.lstrip("'").startswith(STARTS_FORMULA) else text


def unescape_cell(cell: str) -> str:
    """Return the text of a cell that `escape_cell` wrote."""
    return cell[1:] if cell.startswith("'") and cell.lstrip("'").startswith(STARTS_FORMULA) else cell


@contextmanager
def reading(path: Path, remedy: str) -> Iterator[None]:
    """Name the file in the errors of reading it; ``remedy`` is the advice if it does not fit in memory.

    Raises
    ------
    InputError
        For an InputError within, a file that cannot be read, or one that is too large.
    """
    try:
        yield
    except InputError as error:
        raise InputError(f"cannot read {str(path)!r}: {error}") from None
    except OSError as error:
        raise InputError(
            f"cannot read {str(path)!r}: {error.strerror or error}; check the name and the permissions"
        ) from None
    except UnicodeEncodeError:
        raise InputError(f"cannot read {str(path)!r}: the name holds half a character; write it anew") from None
    except MemoryError:
        raise InputError(f"cannot read {str(path)!r}: it does not fit in memory; {remedy}") from None


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a temporary file beside ``path``, which is renamed to ``path`` if the block succeeds.

    If ``path`` is a symbolic link, its target is written, and the link stays.

    Raises
    ------
    InputError
        If the file cannot be written; no temporary file remains.
    """
    with whole_files(path) as (part,):
        yield part


@contextmanager
def whole_files(*paths: Path) -> Iterator[tuple[Path, ...]]:
    """Yield temporary files as `whole_file` does, for several files: all of them are replaced, or none is.

    Existing files keep their permissions. Ctrl-C and SIGTERM leave no temporary files.
    """
    targets = [_resolved(path) for path in paths]
    parts = list[Path]()
    with _sigterm_handler():
        try:
            try:
                for target in targets:
                    parts.append(_name_beside(target))
                    parts[-1].touch(0o600, exist_ok=False)
            except OSError as error:
                raise InputError(
                    f"cannot write {_quoted(paths)}: {error.strerror}; name a folder that can be written"
                ) from None
            yield tuple(parts)
            for part, target in zip(parts, targets, strict=True):
                part.chmod(target.stat().st_mode & 0o7777 if target.exists() else 0o666 & ~_umask())
            batch = _batch.get()
            if batch is not None and {Path(os.path.realpath(target)) for target in targets} <= batch.targets:
                batch.pending += zip(parts, targets, strict=True)
                parts = []
            else:
                _replace(parts, targets)
        except OSError as error:
            raise InputError(f"cannot write {_quoted(paths)}: {error.strerror or error}; nothing was changed") from None
        finally:
            _remove(parts)


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """Yield a folder beside ``path``, which gets that name if the block succeeds and nothing has it.

    Raises
    ------
    OSError
        If it cannot be made; Ctrl-C and SIGTERM leave no temporary folder.
    """
    part = _name_beside(path)
    with _sigterm_handler():
        try:
            part.mkdir()
            yield part
            try:
                part.rename(path)
            except OSError:
                if not path.exists():
                    raise
                # another process was faster
        finally:
            _remove([part])


@dataclass
class _Batch:
    """Outputs to replace together: their paths, and the pairs of temporary file and target written so far."""

    targets: set[Path] = field(default_factory=set)
    pending: list[tuple[Path, Path]] = field(default_factory=list)


_batch: ContextVar[_Batch | None] = ContextVar("_batch", default=None)


@contextmanager
def atomic_outputs() -> Iterator[None]:
    """Replace the files registered by `check_outputs` within the block together at its end, or none if it raises.

    Raises
    ------
    InputError
        If one of them cannot be replaced.
    """
    batch = _Batch()
    token = _batch.set(batch)
    with _sigterm_handler():
        try:
            yield
            parts = [part for part, _ in batch.pending]
            targets = [target for _, target in batch.pending]
            try:
                _replace(parts, targets)
            except OSError as error:
                raise InputError(f"cannot write {_quoted(targets)}: {error.strerror}; nothing was changed") from None
        finally:
            _batch.reset(token)
            _remove(part for part, _ in batch.pending)


_temporaries: set[Path] = set()
"""Existing temporary files, folders and backups of this process."""


@contextmanager
def _sigterm_handler(end: Callable[[int, FrameType | None], None] | None = None) -> Iterator[None]:
    """Let SIGTERM call ``end``, by default `_end`, unless the program handles it otherwise."""
    handler = signal.getsignal(signal.SIGTERM)
    ours = threading.current_thread() is threading.main_thread() and handler in (signal.SIG_DFL, _end)
    if ours:
        signal.signal(signal.SIGTERM, end or _end)
    try:
        yield
    finally:
        if ours:
            signal.signal(signal.SIGTERM, handler)


@contextmanager
def _sigterm_deferred() -> Iterator[None]:
    """Defer SIGTERM to the end of the block."""
    received = []
    try:
        with _sigterm_handler(lambda number, frame: received.append(number)):
            yield
    finally:
        if received:
            signal.raise_signal(signal.SIGTERM)


def _end(number: int, frame: FrameType | None) -> None:
    """Remove the temporary files, and end the process as the signal does by default.

    An exception does not suffice: C code with callbacks, such as an import or a compiler, may swallow or replace it.
    """
    remove_temporaries()
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.raise_signal(signal.SIGTERM)


def remove_temporaries() -> None:
    """Remove the temporary files and backups of this process before it ends."""
    _remove(tuple(_temporaries))


def _replace(parts: Sequence[Path], targets: Sequence[Path]) -> None:
    """Rename each part to its target; if one cannot be renamed, restore those before it.

    SIGTERM is deferred.
    """
    backups: list[tuple[Path, Path | None]] = []
    with _sigterm_deferred():
        try:
            for part, target in zip(parts, targets, strict=True):
                # The last target needs no backup, since nothing can fail after it.
                if part != parts[-1]:
                    backups.append((target, _name_beside(target) if target.exists() else None))
                    if backups[-1][1]:
                        shutil.copy2(target, backups[-1][1])
                part.replace(target)
        except BaseException:
            # Ctrl-C may arrive after the last renaming.
            for (target, copy), part in zip(backups if parts[-1].exists() else [], parts, strict=False):
                if part.exists():
                    continue
                if copy:
                    copy.replace(target)
                else:
                    target.unlink()
            raise
        finally:
            _remove([copy for _, copy in backups if copy])


def _resolved(path: Path) -> Path:
    """Return the final target of a symbolic link, existing or not, or the path itself if it is no link."""
    target = Path(os.path.realpath(path)) if path.is_symlink() else path
    if target.is_symlink():
        raise InputError(f"cannot write {str(path)!r}: it is a link to itself; name another")
    return target


def _name_beside(path: Path, *, max_stem_length: int = 40) -> Path:
    """Return a new hidden name in the folder of ``path``, and register it as temporary.

    ``max_stem_length``: maximum number of characters, of up to four bytes each, of a file's name in the name of its
    temporary file.
    """
    name = path.with_name(f".{path.stem[:max_stem_length]}.{secrets.token_hex(6)}{path.suffix}")
    _temporaries.add(name)
    return name


def _remove(parts: Iterable[Path]) -> None:
    for part in parts:
        if part.is_dir():
            shutil.rmtree(part, ignore_errors=True)
        else:
            part.unlink(missing_ok=True)
        _temporaries.discard(part)


def _quoted(paths: Sequence[Path]) -> str:
    return " and ".join(repr(str(path)) for path in paths)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
