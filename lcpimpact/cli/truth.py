"""The commands truths and score: problems with closed forms as data, and results of any program beside them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lcpimpact.cli.finish import check_study, finish
from lcpimpact.cli.options import Plot, Report, Table, assignment, names_of
from lcpimpact.cli.output import print_answer
from lcpimpact.errors import InputError
from lcpimpact.problems import PROBLEMS

Parameters = Annotated[
    list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="A parameter of the problem; repeatable.")
]


def truths(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            help="Names of [bold]lcpimpact list problems[/bold]; by default all that have facts.",
            show_default=False,
            autocompletion=names_of(PROBLEMS),
        ),
    ] = None,
    set_: Parameters = None,
    out: Annotated[Path, typer.Option(help="Folder for NAME.json of each problem and for schema.json.")] = Path(
        "truths"
    ),
) -> None:
    """Write problems with closed forms as data: equations, laws, start and facts, for any other program.

    Example: lcpimpact truths --out truths
    """
    from lcpimpact.truth.document import write_truths

    written = write_truths(out, names or (), **_parameters(set_))
    print_answer([f"wrote {len(written) - 1} problems and schema.json to {out}"], lambda: {"files": written})


def score(
    results: Annotated[
        Path, typer.Argument(help="CSV with t, the coordinates, and if known rates and reactions.", show_default=False)
    ],
    problem: Annotated[
        str,
        typer.Option(
            help="A name of [bold]lcpimpact list problems[/bold].",
            show_default=False,
            autocompletion=names_of(PROBLEMS),
        ),
    ],
    set_: Parameters = None,
    events: Annotated[
        Path | None,
        typer.Option(help="CSV of located events: t, contact, kind; by default they are found.", show_default=False),
    ] = None,
    out: Table = None,
    plot: Plot = None,
    report: Report = None,
) -> None:
    """Compare results of any program, sampled in a CSV file, with the facts and the exact motion of a problem.

    Columns are named as in the file of `lcpimpact truths`: t, NAME of each coordinate, v_NAME, and the reactions. The exit
    code is 0 if the results could be scored, however good they are.

    Example: lcpimpact score results.csv --problem bouncing-ball
    """
    check_study([results, *([events] if events else [])], (out,), plot, report)
    from lcpimpact.study.accuracy.score import score as found

    finish(found(results, problem, events=events, **_parameters(set_)), out, plot, report)


def _parameters(set_: list[str] | None) -> dict[str, float]:
    """Return the parameters of --set.

    Raises
    ------
    InputError
        For a value that is no number.
    """
    given = dict(assignment(each) for each in set_ or [])
    for name, value in given.items():
        if isinstance(value, (bool, str)):
            raise InputError(f"--set {name}={value}: the parameter of a problem is a number")
    return given
