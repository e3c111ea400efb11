"""The command explore."""

from __future__ import annotations

import webbrowser
from pathlib import Path

import click

from lcpimpact.cli.options import PATH, end_option, files, problem_or_file, resolve_run, set_option, stem
from lcpimpact.cli.output import output_options, print_answer
from lcpimpact.errors import InputError
from lcpimpact.files import check_outputs


@click.command()
@click.argument(
    "problem",
    required=False,
    shell_complete=problem_or_file,
    help="A name of `lcpimpact list problems`, or a file ending in .toml; by default all problems that the page takes.",
)
@set_option
@end_option
@click.option("--out", type=PATH, help="File for the page: .html; by default explorer.html, or NAME.html.")
@click.option("--open/--no-open", "show", default=True, help="Whether to open the page in the browser.")
@output_options
def explore(problem: str | None, set_: tuple[str, ...], t_end: float | None, out: Path | None, show: bool) -> None:
    """Write a page in which sliders change a problem, and its run, its exact motion and the LCP of each step follow.

    The page is one file that opens from disk and requests nothing. Its runs have the bits of simulate.

    Example: lcpimpact explore system-1
    """
    from lcpimpact.explorer.page import ENDINGS
    from lcpimpact.explorer.page import explore as write

    path = out or Path("explorer.html" if problem is None else f"{stem(problem)}.html")
    if problem is None:
        if set_ or t_end is not None:
            raise InputError("--set and --t-end go with a problem: name one, as in lcpimpact explore system-1")
        check_outputs([(path, ENDINGS)])
        written = write(path=path)
    else:
        check_outputs([(path, ENDINGS)], files(problem))
        stated = resolve_run(problem, set_, t_end=t_end)
        written = write(stated.problem, path, t_end=stated.run.t_end)
    print_answer([f"wrote {written}"], lambda: {"files": [written]})
    if show:
        webbrowser.open(written.resolve().as_uri())
