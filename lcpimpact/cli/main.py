"""The entry point: run a command, and convert errors to one line and an exit code."""

from __future__ import annotations

import errno
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from io import TextIOWrapper
from types import FrameType
from typing import Any

import click

from lcpimpact.arguments import visible
from lcpimpact.errors import FailureError, LcpImpactError
from lcpimpact.files import atomic_outputs, remove_temporaries

INTERRUPTED, DEFECT = 130, 70

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""Errors of a disk or device that takes no more."""

TRACEBACK_VARIABLE = "LCPIMPACT_TRACEBACK"
"""Environment variable that shows the traceback of a defect."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line.

    Exit codes: 0 success, 1 a run or a check failed, 2 invalid input, 70 a defect of lcpimpact, 130 interrupted, 143
    terminated by SIGTERM.
    """
    # Without a stated algebra backend, OSQP searches for its optional ones at each set-up.
    os.environ.setdefault("OSQP_ALGEBRA_BACKEND", "builtin")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # for terminals with a smaller character set
    from lcpimpact.cli.commands import app

    interrupts: list[threading.Timer] = []
    try:
        with _interruptible(interrupts), atomic_outputs():
            code = app(args=arguments, prog_name="lcpimpact", standalone_mode=False)
            sys.stdout.flush()
    except (KeyboardInterrupt, click.Abort):
        code = INTERRUPTED
    except Exception as error:  # noqa: BLE001 - any unexpected error is reported as a defect
        # An import that Ctrl-C ended may appear as any error.
        code = INTERRUPTED if interrupts else _failure(error)
    if code == INTERRUPTED:
        remove_temporaries()  # Ctrl-C may arrive within their removal
        _print_interrupted()
    sys.exit(int(code or 0))


@contextmanager
def _interruptible(interrupts: list[threading.Timer], *, seconds: float = 1.0) -> Iterator[None]:
    """Let Ctrl-C raise KeyboardInterrupt, and end the process if it has no effect within some ``seconds``.

    C code with callbacks, such as an import or a compiler, may swallow or print the exception.
    """
    handles = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    handles = handles and threading.current_thread() is threading.main_thread()

    def interrupt(number: int, frame: FrameType | None) -> None:
        interrupts.append(threading.Timer(seconds, _exit_now))
        interrupts[-1].daemon = True
        interrupts[-1].start()
        raise KeyboardInterrupt

    def unless_interrupted(hook: Callable[..., None]) -> Callable[..., None]:
        return lambda *error: None if interrupts else hook(*error)

    hooks = sys.excepthook, sys.unraisablehook
    if handles:
        signal.signal(signal.SIGINT, interrupt)
        sys.excepthook = unless_interrupted(hooks[0])
        sys.unraisablehook = unless_interrupted(hooks[1])
    try:
        yield
    finally:
        if handles:
            signal.signal(signal.SIGINT, signal.default_int_handler)
            sys.excepthook, sys.unraisablehook = hooks
        for timer in interrupts:
            timer.cancel()


def _exit_now() -> None:
    """End the process at once, without partly written files."""
    _print_interrupted()
    remove_temporaries()  # last, since the main thread may still write
    os._exit(INTERRUPTED)


def _print_interrupted() -> None:
    _print_error("interrupted: finished files are complete, and no partial file remains", INTERRUPTED)


def _failure(error: Exception) -> int:
    """Print an error in one line, and return its exit code."""
    if isinstance(error, BrokenPipeError):
        sys.stderr.close()
        return 1
    if isinstance(error, click.ClickException):
        return _print_error(f"{error.format_message()} (see: lcpimpact --help)", 2)
    if isinstance(error, OSError) and error.filename is None and error.errno in NO_ROOM:
        _discard(sys.stdout)
        return _print_error(f"cannot write what is printed: {error.strerror}; send it to a place with room", 2)
    if isinstance(error, MemoryError):
        return _print_error("there is not enough memory: take fewer steps, values or coordinates", 2)
    if isinstance(error, LcpImpactError):
        return _print_error(str(error), 1 if isinstance(error, FailureError) else 2)
    return _defect(error)


def _discard(stream: Any) -> None:
    """Let a stream that cannot be written end in nothing, so that its end is no second error."""
    with suppress(OSError, ValueError, AttributeError), open(os.devnull, "w") as nothing:
        os.dup2(nothing.fileno(), stream.fileno())


def _defect(error: Exception) -> int:
    """Print that an error is a defect of the program, and where to report it."""
    if os.environ.get(TRACEBACK_VARIABLE):
        traceback.print_exception(error)
    return _print_error(
        f"this is a defect of lcpimpact: {type(error).__name__}: {error}. Please report it at the issue tracker of the "
        f"repository of lcpimpact, with the command, its files, and what it prints when {TRACEBACK_VARIABLE}=1 is set",
        DEFECT,
    )


def _print_error(message: str, code: int) -> int:
    click.echo(f"lcpimpact: {visible(' '.join(message.split()))}", err=True)
    return code
