"""Atomic file output: files appear whole or not at all."""

from __future__ import annotations

import os
import secrets
import shutil
import signal
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

from lcpimpact.errors import InputError

MAX_STEM_LENGTH = 60
"""Maximum number of characters that a part file takes over from the name of its file."""


def check_output(path: Path, endings: Iterable[str]) -> None:
    """Refuse, before any work is done, a file whose ending tells no known format, or that cannot be written.

    Raises
    ------
    InputError
        Naming the file and what to give instead.
    """
    if path.suffix not in endings:
        raise InputError(f"cannot write {str(path)!r}: the name must end in one of {', '.join(endings)}")
    target = _followed(path)
    folder = target.parent
    if target.is_dir():
        raise InputError(f"cannot write {str(path)!r}: a folder has that name; name another")
    if target.exists() and not os.access(target, os.W_OK):
        raise InputError(f"cannot write {str(path)!r}: the file may not be written to; name another, or allow it")
    if not folder.is_dir():
        raise InputError(f"cannot write {str(path)!r}: there is no folder {str(folder)!r}; make it, or name another")
    if not os.access(folder, os.W_OK):
        raise InputError(f"cannot write {str(path)!r}: the folder may not be written to; name another")


def check_outputs(outputs: Iterable[tuple[Path | None, Iterable[str]]], inputs: Iterable[Path] = ()) -> None:
    """Refuse, before any work is done, files of one command that cannot be written, or not beside its inputs.

    Within `outputs_together` these files are replaced at its end, all of them or none.

    Parameters
    ----------
    outputs : iterable of (path or None, endings)
        As for `check_output`; None is left out.
    inputs : iterable of Path
        What the command reads.

    Raises
    ------
    InputError
        Also where an output would replace an input or another output, by whatever name or link.
    """
    named = [(path, endings) for path, endings in outputs if path is not None]
    given = list(inputs)
    for i, (path, endings) in enumerate(named):
        check_output(path, endings)
        for other in given:
            if _same(path, other):
                raise InputError(f"cannot write {str(path)!r}: the input {str(other)!r} is that file; name another")
        for other, _ in named[:i]:
            if _same(path, other):
                raise InputError(
                    f"cannot write {str(path)!r}: another output, {str(other)!r}, is that file; name another"
                )
    together = _together.get()
    if together is not None:
        together.targets.update(Path(os.path.realpath(path)) for path, _ in named)


def _same(a: Path, b: Path) -> bool:
    """Say whether two names are of one file, through links of both kinds, whether it exists or not."""
    try:
        return os.path.samefile(a, b)
    except OSError:
        return os.path.realpath(a) == os.path.realpath(b)


STARTS_FORMULA = ("=", "+", "-", "@")


def cell_of(word: str) -> str:
    """Return how a word stands in a CSV file: behind an apostrophe where a spreadsheet would run it as a formula.

    Examples
    --------
    >>> [cell_of(word) for word in ("x", "=1+1", "'-x")]
    ['x', "'=1+1", "''-x"]
    >>> word_of(cell_of("'-x"))
    "'-x"
    """
    return f"'{word}" if word.lstrip("'").startswith(STARTS_FORMULA) else word


def word_of(cell: str) -> str:
    """Return the word of a cell that `cell_of` wrote."""
    return cell[1:] if cell.startswith("'") and cell.lstrip("'").startswith(STARTS_FORMULA) else cell


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
    """Do as `whole_file` for files that belong together: all of them are replaced, or none is.

    Files that existed keep their modes. Ctrl-C and SIGTERM leave nothing behind.
    """
    targets, parts = [_followed(path) for path in paths], list[Path]()
    with _terminable():
        try:
            try:
                for target in targets:
                    parts.append(_name_beside(target))
                    parts[-1].touch(0o600, exist_ok=False)
            except OSError as error:
                raise InputError(
                    f"cannot write {_names(paths)}: {error.strerror}; name a folder that can be written"
                ) from None
            yield tuple(parts)
            for part, target in zip(parts, targets, strict=True):
                part.chmod(target.stat().st_mode & 0o7777 if target.exists() else 0o666 & ~_umask())
            together = _together.get()
            if together is not None and {Path(os.path.realpath(target)) for target in targets} <= together.targets:
                together.waiting += zip(parts, targets, strict=True)
                parts = []
            else:
                _replace(parts, targets)
        except OSError as error:
            raise InputError(f"cannot write {_names(paths)}: {error.strerror or error}; nothing was changed") from None
        finally:
            _remove(parts)


@dataclass
class _Together:
    """Outputs that are replaced at one time: which they are, and the parts that wait for it."""

    targets: set[Path] = field(default_factory=set)
    waiting: list[tuple[Path, Path]] = field(default_factory=list)


_together: ContextVar[_Together | None] = ContextVar("_together", default=None)


@contextmanager
def outputs_together() -> Iterator[None]:
    """Replace the files that `check_outputs` is told of within all at the end, or none of them where an error passes.

    Raises
    ------
    InputError
        If one of them cannot be replaced.
    """
    together = _Together()
    token = _together.set(together)
    with _terminable():
        try:
            yield
            parts, targets = [part for part, _ in together.waiting], [target for _, target in together.waiting]
            try:
                _replace(parts, targets)
            except OSError as error:
                raise InputError(f"cannot write {_names(targets)}: {error.strerror}; nothing was changed") from None
        finally:
            _together.reset(token)
            _remove(part for part, _ in together.waiting)


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """Give a new folder for what is needed only within, and remove it afterwards, at the latest when SIGTERM comes."""
    with _terminable(), tempfile.TemporaryDirectory() as folder:
        _hidden.add(Path(folder))
        try:
            yield Path(folder)
        finally:
            _hidden.discard(Path(folder))


_hidden: set[Path] = set()
"""Parts, copies and scratch folders that are there."""


@contextmanager
def _terminable(end: Callable[[int, FrameType | None], Any] | None = None) -> Iterator[None]:
    """Let SIGTERM call ``end`` where it would end the process, by default `_end`."""
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
def _undisturbed() -> Iterator[None]:
    """Let SIGTERM wait until what is within is done."""
    told: list[int] = []
    try:
        with _terminable(lambda number, frame: told.append(number)):
            yield
    finally:
        if told:
            signal.raise_signal(signal.SIGTERM)


def _end(number: int, frame: FrameType | None) -> None:
    """Remove what is hidden, and end the process as the signal does by itself.

    An exception would not do: C code that calls back, as an import or a compiler does, swallows it or raises another.
    """
    remove_hidden()
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.raise_signal(signal.SIGTERM)


def remove_hidden() -> None:
    """Remove the parts of files, copies and scratch folders that this process has made, since it ends."""
    for path in tuple(_hidden):
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


def _replace(parts: Sequence[Path], targets: Sequence[Path]) -> None:
    """Rename each part to its target; if one cannot be renamed, those before it are put back as they were.

    SIGTERM waits until it is done.
    """
    kept: list[tuple[Path, Path | None]] = []
    with _undisturbed():
        try:
            for part, target in zip(parts, targets, strict=True):
                # What is renamed last needs no copy: nothing can fail after it.
                if part != parts[-1]:
                    kept.append((target, _name_beside(target) if target.exists() else None))
                    if kept[-1][1]:
                        shutil.copy2(target, kept[-1][1])
                part.replace(target)
        except BaseException:
            # Ctrl-C may come after the last of them.
            for (target, copy), part in zip(kept if parts[-1].exists() else [], parts, strict=False):
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


def _name_beside(path: Path) -> Path:
    """Return a new name in the folder of ``path``, which is hidden until it is removed."""
    name = path.with_name(f".{path.stem[:MAX_STEM_LENGTH]}.{secrets.token_hex(6)}{path.suffix}")
    _hidden.add(name)
    return name


def _remove(parts: Iterable[Path]) -> None:
    for part in parts:
        part.unlink(missing_ok=True)
        _hidden.discard(part)


def _names(paths: Sequence[Path]) -> str:
    return " and ".join(repr(str(path)) for path in paths)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
