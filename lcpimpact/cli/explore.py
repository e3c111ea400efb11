"""The command explore."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from lcpimpact.cli.options import End, Set, files, names_of, resolve_run, stem
from lcpimpact.cli.output import print_answer
from lcpimpact.errors import InputError
from lcpimpact.files import check_outputs
from lcpimpact.problems import PROBLEMS


def explore(
    problem: Annotated[
        str | None,
        typer.Argument(
            help="A name of [bold]lcpimpact list problems[/bold], or a file ending in .toml; by default all problems that "
            "the page takes.",
            show_default=False,
            autocompletion=names_of(PROBLEMS),
        ),
    ] = None,
    set_: Set = None,
    t_end: End = None,
    out: Annotated[
        Path | None,
        typer.Option(help="File for the page: .html; by default explorer.html, or NAME.html.", show_default=False),
    ] = None,
    show: Annotated[bool, typer.Option("--open/--no-open", help="Whether to open the page in the browser.")] = True,
) -> None:
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
