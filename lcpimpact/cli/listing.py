"""The commands list and cite: the registries, filtered, all of one entry, and where it is from."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer
from rich.console import Console

from lcpimpact.cli.output import AS_JSON, print_answer
from lcpimpact.errors import InputError


class Kind(StrEnum):
    """Registries that can be listed."""

    problems = "problems"
    methods = "methods"
    solvers = "solvers"
    elements = "elements"
    lessons = "lessons"
    projects = "projects"


def list_(
    kind: Annotated[Kind, typer.Argument(help="problems, methods, solvers, elements, lessons or projects.")],
    name: Annotated[str | None, typer.Argument(help="One of them: everything about it.", show_default=False)] = None,
    matching: Annotated[
        list[str] | None,
        typer.Option(metavar="TEXT", help="Only those with this text in any property; repeatable.", show_default=False),
    ] = None,
    for_: Annotated[
        str | None,
        typer.Option("--for", metavar="NAME", help="Only methods for this problem, or problems for this method."),
    ] = None,
) -> None:
    """List the registered problems, methods, solvers, elements, lessons or projects with their declared properties.

    Example: lcpimpact list methods --for system-1 --matching energy
    """
    from lcpimpact.cli.entries import ENTRIES, TABLES, details, matches, names

    if name is not None:
        if matching or for_ is not None:
            raise InputError(f"{name!r} is one entry: leave --matching and --for out, or leave the name out")
        entry = ENTRIES[kind](name)
        print_answer(details(entry), lambda: entry)
        return
    entries = [each for each in map(ENTRIES[kind], names(kind, for_)) if matches(each, matching or [])]
    if AS_JSON.get():
        print_answer((), lambda: entries)
        return
    console = Console()
    if not console.is_terminal:
        console = Console(width=200)
    console.print(TABLES[kind](entries, not matching and for_ is None))


def cite(
    names: Annotated[
        list[str] | None,
        typer.Argument(help="Methods, LCP solvers or problems; lcpimpact itself without one.", show_default=False),
    ] = None,
) -> None:
    """Print the sources of methods, LCP solvers and problems as BibTeX.

    Example: lcpimpact cite moreau-jean lemke
    """
    from lcpimpact.bibliography import cite as cite_

    entries = cite_(*(names or ()))
    print_answer([entries], lambda: {"bibtex": entries})
