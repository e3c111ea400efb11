"""Output of a command: lines for people, JSON for programs, or nothing but errors; and its log."""

from __future__ import annotations

import functools
import inspect
import json
import logging
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from enum import Enum
from typing import Annotated, Any, get_type_hints

import typer
from rich.console import Console

from lcpimpact.arguments import visible
from lcpimpact.errors import InputError
from lcpimpact.logs import LOG

AS_JSON: ContextVar[bool] = ContextVar("AS_JSON", default=False)
"""Whether the running command prints JSON."""

DECIMAL: ContextVar[str] = ContextVar("DECIMAL", default=".")
"""Decimal mark of the .csv files that the running command writes."""

PANEL = "Output"

Json = Annotated[bool, typer.Option("--json", help="Print the results as JSON.", rich_help_panel=PANEL)]
Quiet = Annotated[
    bool,
    typer.Option("--quiet", "-q", help="Print nothing but errors, and what --json prints.", rich_help_panel=PANEL),
]
Verbose = Annotated[
    int,
    typer.Option(
        "--verbose", "-v", count=True, help="Log each run; -vv logs each compiled function too.", rich_help_panel=PANEL
    ),
]
DecimalComma = Annotated[
    bool,
    typer.Option(
        "--decimal-comma",
        help="Write .csv with decimal commas, and semicolons between the cells.",
        rich_help_panel=PANEL,
    ),
]


def with_output_options(command: Callable[..., None], *, tables: bool = False) -> Callable[..., None]:
    """Add --json, --quiet and --verbose to the options of a command, and --decimal-comma where it writes tables."""
    added = {"as_json": (Json, False), "quiet": (Quiet, False), "verbose": (Verbose, 0)}
    if tables:
        added["decimal_comma"] = (DecimalComma, False)

    @functools.wraps(command)
    def with_options(**arguments: Any) -> None:
        ours = {name: arguments.pop(name) for name in added}
        token, mark = AS_JSON.set(ours["as_json"]), DECIMAL.set("," if ours.get("decimal_comma") else ".")
        try:
            with _logging(ours["quiet"], ours["verbose"]):
                command(**arguments)
        finally:
            AS_JSON.reset(token)
            DECIMAL.reset(mark)

    hints = get_type_hints(command, include_extras=True)
    parameters = [each.replace(annotation=hints[name]) for name, each in inspect.signature(command).parameters.items()]
    parameters += [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, annotation=kind, default=default)
        for name, (kind, default) in added.items()
    ]
    with_options.__annotations__ = hints | {name: kind for name, (kind, _) in added.items()}
    with_options.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return with_options


@contextmanager
def _logging(quiet: bool, verbose: int) -> Iterator[None]:
    """Set the level of the logger of lcpimpact for one command, with standard error as its destination if verbose."""
    if quiet and verbose:
        raise InputError("--quiet and --verbose contradict each other: leave one out")
    level, handler = LOG.level, logging.StreamHandler()
    handler.setFormatter(logging.Formatter("%(name)s: %(message)s"))
    if quiet:
        LOG.setLevel(logging.ERROR)
    elif verbose:
        LOG.setLevel(logging.INFO if verbose == 1 else logging.DEBUG)
        LOG.addHandler(handler)
    try:
        yield
    finally:
        LOG.setLevel(level)
        LOG.removeHandler(handler)


def print_answer(lines: Iterable[str], data: Callable[[], Any]) -> None:
    """Print lines, or with --json the data, or with --quiet nothing."""
    if AS_JSON.get():
        typer.echo(json.dumps(plain(data()), ensure_ascii=False, indent=2, allow_nan=False))
    elif LOG.isEnabledFor(logging.WARNING):
        Console(highlight=False, soft_wrap=True, markup=False, emoji=False).print(visible("\n".join(lines)))


def plain(value: Any) -> Any:
    """Return data as JSON has them: a number that is not finite is null, and what JSON does not know is a string.

    Examples
    --------
    >>> from pathlib import Path
    >>> plain({"t": (0.5, float("nan")), "out": Path("run.csv")})
    {'t': [0.5, None], 'out': 'run.csv'}
    """
    if isinstance(value, Enum):
        return value.name
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items()}
    if hasattr(value, "tolist"):  # NumPy
        return plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [plain(each) for each in value]
    return str(value)
