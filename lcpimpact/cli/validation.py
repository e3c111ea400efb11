"""The command validate: what others published, run again."""

from __future__ import annotations

from pathlib import Path

import click
from click.exceptions import Exit

from lcpimpact.cli.finish import check_study, finish
from lcpimpact.cli.options import names_of, study_options
from lcpimpact.cli.output import table_output_options
from lcpimpact.validation.suites import SUITES


@click.command()
@click.argument(
    "suites",
    metavar="[SUITE]...",
    nargs=-1,
    shell_complete=names_of(SUITES),
    help=f"{', '.join(SUITES)}; all by default.",
)
@study_options
@table_output_options
def validate(suites: tuple[str, ...], out: Path | None, plot: Path | None, report: Path | None) -> None:
    """Run the cases that others published, and print their numbers beside ours.

    A number is met within the tolerance of its source, or refuted by a closed form. The exit code is 1 if one is neither.

    Example: lcpimpact validate code-aster --report validation.html
    """
    check_study((), (out,), plot, report)
    from lcpimpact.validation.validate import validate as run

    found = run(suites)
    finish(found, out, plot, report)
    raise Exit(0 if found.success else 1)
