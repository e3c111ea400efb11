"""The command check: an answer to a lesson of the course."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from lcpimpact.cli.options import names_of
from lcpimpact.cli.output import print_answer
from lcpimpact.course import LESSONS


def check(
    lesson: Annotated[
        str,
        typer.Argument(
            help="A name of [bold]lcpimpact list lessons[/bold].", show_default=False, autocompletion=names_of(LESSONS)
        ),
    ],
    file: Annotated[Path, typer.Argument(help="The Python file with your answer.", show_default=False)],
    seconds: Annotated[float, typer.Option(help="Limit of time in s.")] = 60.0,
) -> None:
    """Check the answer to the exercise of a lesson: say that it is right, or where it is wrong.

    The file runs in a process of its own, with a limit of time. The exit code is 0 only if the answer is right.

    Example: lcpimpact check lesson-3 answer.py
    """
    from lcpimpact.course.check import check_answer

    verdict = check_answer(lesson, file, seconds)
    print_answer(
        [f"{lesson}: {'right' if verdict.right else 'wrong'}: {verdict.message}"],
        lambda: {"lesson": lesson, **asdict(verdict)},
    )
    raise typer.Exit(0 if verdict.right else 1)
