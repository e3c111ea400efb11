"""The command check: an answer to a lesson of the course."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import click
from click.exceptions import Exit

from lcpimpact.cli.options import PATH, names_of
from lcpimpact.cli.output import output_options, print_answer
from lcpimpact.course import LESSONS
from lcpimpact.course.check import SECONDS, check_answer


@click.command()
@click.argument("lesson", shell_complete=names_of(LESSONS), help="A name of `lcpimpact list lessons`.")
@click.argument("file", type=PATH, help="The Python file with your answer.")
@click.option("--seconds", default=SECONDS, help="Limit of time in s.")
@output_options
def check(lesson: str, file: Path, seconds: float) -> None:
    """Check the answer to the exercise of a lesson: say that it is right, or where it is wrong.

    The file runs in a process of its own, with a limit of time. The exit code is 0 only if the answer is right.

    Example: lcpimpact check lesson-3 answer.py
    """
    verdict = check_answer(lesson, file, seconds)
    print_answer(
        [f"{lesson}: {'right' if verdict.right else 'wrong'}: {verdict.message}"],
        lambda: {"lesson": lesson, **asdict(verdict)},
    )
    raise Exit(0 if verdict.right else 1)
