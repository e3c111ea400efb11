"""The commands list and cite: the registries, filtered, all of one entry, and where it is from."""

from __future__ import annotations

import click
from rich.console import Console

from lcpimpact.cli.options import check_registered
from lcpimpact.cli.output import AS_JSON, output_options, print_answer, table_output_options
from lcpimpact.errors import InputError

KINDS = ("problems", "methods", "solvers", "elements", "lessons", "projects")
"""Registries that can be listed."""


@click.command("list")
@click.argument(
    "kind", metavar="KIND", type=click.Choice(KINDS), help="problems, methods, solvers, elements, lessons or projects."
)
@click.argument("name", required=False, help="One of them: everything about it.")
@click.option(
    "--matching", metavar="TEXT", multiple=True, help="Only those with this text in any property; repeatable."
)
@click.option("--for", "for_", metavar="NAME", help="Only methods for this problem, or problems for this method.")
@output_options
def list_(kind: str, name: str | None, matching: tuple[str, ...], for_: str | None) -> None:
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
    entries = [each for each in map(ENTRIES[kind], names(kind, for_)) if matches(each, matching)]
    if AS_JSON.get():
        print_answer((), lambda: entries)
        return
    console = Console()
    if not console.is_terminal:
        console = Console(width=200)
    console.print(TABLES[kind](entries, not matching and for_ is None))


@click.command()
@click.argument("names", nargs=-1, help="Methods, LCP solvers or problems; lcpimpact itself without one.")
@table_output_options
def cite(names: tuple[str, ...]) -> None:
    """Print the sources of methods, LCP solvers and problems as BibTeX.

    Example: lcpimpact cite moreau-jean lemke
    """
    check_registered(*names)
    from lcpimpact.bibliography import cite as cite_

    entries = cite_(*names)
    print_answer([entries], lambda: {"bibtex": entries})
