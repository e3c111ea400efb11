"""The commands truths and score: problems with closed forms as data, and results of any program beside them."""

from __future__ import annotations

from pathlib import Path

import click

from lcpimpact.cli.finish import check_study, finish
from lcpimpact.cli.options import PATH, assignment, check_registered, names_of, study_options
from lcpimpact.cli.output import print_answer, table_output_options
from lcpimpact.errors import InputError
from lcpimpact.problems import PROBLEMS

parameter_option = click.option(
    "--set", "set_", metavar="NAME=VALUE", multiple=True, help="A parameter of the problem; repeatable."
)


@click.command()
@click.argument(
    "names",
    nargs=-1,
    shell_complete=names_of(PROBLEMS),
    help="Names of `lcpimpact list problems`; by default all that have facts.",
)
@parameter_option
@click.option("--out", type=PATH, default="truths", help="Folder for NAME.json of each problem and for schema.json.")
@table_output_options
def truths(names: tuple[str, ...], set_: tuple[str, ...], out: Path) -> None:
    """Write problems with closed forms as data: equations, laws, start and facts, for any other program.

    Example: lcpimpact truths --out truths
    """
    check_registered(*names)
    from lcpimpact.truth.document import write_truths

    written = write_truths(out, names, **_parameters(set_))
    print_answer([f"wrote {len(written) - 1} problems and schema.json to {out}"], lambda: {"files": written})


@click.command()
@click.argument("results", type=PATH, help="CSV with t, the coordinates, and if known rates and reactions.")
@click.option(
    "--problem", required=True, shell_complete=names_of(PROBLEMS), help="A name of `lcpimpact list problems`."
)
@parameter_option
@click.option("--events", type=PATH, help="CSV of located events: t, contact, kind; by default they are found.")
@study_options
@table_output_options
def score(
    results: Path, problem: str, set_: tuple[str, ...], events: Path | None, out: Path | None, plot: Path | None,
    report: Path | None,
) -> None:  # fmt: skip
    """Compare results of any program, sampled in a CSV file, with the facts and the exact motion of a problem.

    Columns are named as in the file of `lcpimpact truths`: t, NAME of each coordinate, v_NAME, and the reactions. The exit
    code is 0 if the results could be scored, however good they are.

    Example: lcpimpact score results.csv --problem bouncing-ball
    """
    check_registered(problem)
    check_study([results, *([events] if events else [])], (out,), plot, report)
    from lcpimpact.study.accuracy.score import score as found

    finish(found(results, problem, events=events, **_parameters(set_)), out, plot, report)


def _parameters(set_: tuple[str, ...]) -> dict[str, float]:
    """Return the parameters of --set.

    Raises
    ------
    InputError
        For a value that is no number.
    """
    given = dict(assignment(each) for each in set_)
    for name, value in given.items():
        if isinstance(value, (bool, str)):
            raise InputError(f"--set {name}={value}: the parameter of a problem is a number")
    return given
