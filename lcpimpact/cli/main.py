"""The entry point: run a command, and turn errors into one line and an exit code."""

from __future__ import annotations

import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from io import TextIOWrapper
from types import FrameType

from rich.console import Console
from typer import Abort
from typer.exceptions import TyperException
from typer.main import get_command

from lcpimpact.arguments import visible
from lcpimpact.errors import FailureError, LcpImpactError
from lcpimpact.files import outputs_together, remove_hidden

INTERRUPTED, DEFECT = 130, 70

PATIENCE = 1.0
"""Seconds within which Ctrl-C ends a command."""

SHOWS_TRACEBACK = "LCPIMPACT_TRACEBACK"
"""The environment variable that, set to anything, shows where in the program a defect arose."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line.

    Exit codes: 0 success, 1 a run or a check failed, 2 wrong input, 70 a defect of lcpimpact, 130 interrupted, 143 ended by
    SIGTERM.
    """
    # OSQP looks for its optional backends anew at each set-up unless it is told which one to take.
    os.environ.setdefault("OSQP_ALGEBRA_BACKEND", "builtin")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a terminal that knows fewer letters gets their numbers
    from lcpimpact.cli.commands import app

    interrupts: list[threading.Timer] = []
    try:
        # Typer itself turns Ctrl-C within a command into the exit code 130.
        with _interruptible(interrupts), outputs_together():
            code = get_command(app)(
                args=None if arguments is None else list(arguments), prog_name="lcpimpact", standalone_mode=False
            )
    except (KeyboardInterrupt, Abort):
        code = INTERRUPTED
    except TyperException as error:
        code = _say(f"{error.format_message()} (see: lcpimpact --help)", 2)
    except FailureError as error:
        code = _say(str(error), 1)
    except LcpImpactError as error:
        code = _say(str(error), 2)
    except MemoryError:
        code = _say("there is not enough memory for this: take fewer steps, values or coordinates", 2)
    except BrokenPipeError:
        sys.stderr.close()
        code = 1
    except Exception as error:  # noqa: BLE001 - what nobody foresaw is a defect, and is said to be one
        code = INTERRUPTED if interrupts else _defect(error)
    if code == INTERRUPTED:
        _say_interrupted()
    sys.exit(int(code or 0))


@contextmanager
def _interruptible(interrupts: list[threading.Timer]) -> Iterator[None]:
    """Let Ctrl-C raise KeyboardInterrupt, and end the process where nothing comes of it for `PATIENCE` seconds.

    C code that calls back, as an import or a compiler does, may swallow the exception, or print it.
    """
    ours = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    ours = ours and threading.current_thread() is threading.main_thread()

    def interrupt(number: int, frame: FrameType | None) -> None:
        interrupts.append(threading.Timer(PATIENCE, _leave))
        interrupts[-1].daemon = True
        interrupts[-1].start()
        raise KeyboardInterrupt

    def unless_interrupted(hook: Callable[..., None]) -> Callable[..., None]:
        return lambda *error: None if interrupts else hook(*error)

    hooks = sys.excepthook, sys.unraisablehook
    if ours:
        signal.signal(signal.SIGINT, interrupt)
        sys.excepthook, sys.unraisablehook = unless_interrupted(hooks[0]), unless_interrupted(hooks[1])
    try:
        yield
    finally:
        if ours:
            signal.signal(signal.SIGINT, signal.default_int_handler)
            sys.excepthook, sys.unraisablehook = hooks
        for timer in interrupts:
            timer.cancel()


def _leave() -> None:
    """End the process at once, with nothing half written."""
    remove_hidden()
    _say_interrupted()
    os._exit(INTERRUPTED)


def _say_interrupted() -> None:
    _say("interrupted: files that were finished are whole, and no other was left", INTERRUPTED)


def _defect(error: Exception) -> int:
    """Say that an error is one of the program, and where to report it."""
    if os.environ.get(SHOWS_TRACEBACK):
        traceback.print_exception(error)
    return _say(
        f"this is a defect of lcpimpact: {type(error).__name__}: {error}. Please report it at the issue tracker of the "
        f"repository of lcpimpact, with the command, its files, and what it prints when {SHOWS_TRACEBACK}=1 is set",
        DEFECT,
    )


def _say(message: str, code: int) -> int:
    line = visible(" ".join(message.split()))
    Console(stderr=True, soft_wrap=True, highlight=False, markup=False).print(f"lcpimpact: {line}")
    return code
