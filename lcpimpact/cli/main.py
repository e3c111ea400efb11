"""The entry point: run a command, and turn what went wrong into one line and an exit code."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

from rich.console import Console
from typer import Abort
from typer.exceptions import TyperException

from lcpimpact.errors import FailureError, LcpImpactError
from lcpimpact.files import outputs_together

INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line.

    Exit codes: 0 success, 1 a run or a check failed, 2 wrong input, 130 interrupted.
    """
    # OSQP looks for its optional backends anew at each set-up unless it is told which one to take.
    os.environ.setdefault("OSQP_ALGEBRA_BACKEND", "builtin")
    from lcpimpact.cli.commands import app

    try:
        # Typer itself turns Ctrl-C within a command into the exit code 130.
        with outputs_together():
            code = app(
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
    except BrokenPipeError:
        sys.stderr.close()
        code = 1
    if code == INTERRUPTED:
        _say("interrupted: files that were finished are whole, and no other was left", code)
    sys.exit(int(code or 0))


def _say(message: str, code: int) -> int:
    line = " ".join(message.split())
    Console(stderr=True, soft_wrap=True, highlight=False, markup=False).print(f"lcpimpact: {line}")
    return code
