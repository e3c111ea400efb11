"""Output of a command: lines for people, JSON for programs, or nothing but errors; and its log."""

from __future__ import annotations

import functools
import json
import logging
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from enum import Enum
from typing import Any

import click

from lcpimpact.arguments import visible
from lcpimpact.cli.options import Command, together
from lcpimpact.errors import InputError
from lcpimpact.logs import LOG

AS_JSON: ContextVar[bool] = ContextVar("AS_JSON", default=False)
"""Whether the running command prints JSON."""

DECIMAL: ContextVar[str] = ContextVar("DECIMAL", default=".")
"""Decimal mark of the .csv files that the running command writes."""


def output_options(command: Command) -> Command:
    """Add --json, --quiet and --verbose to the options of a command."""

    @click.option("--json", "as_json", is_flag=True, help="Print the results as JSON.")
    @click.option("--quiet", "-q", is_flag=True, help="Print nothing but errors, and what --json prints.")
    @click.option(
        "--verbose", "-v", count=True, show_default=False, help="Log each run; -vv logs each compiled function too."
    )
    @functools.wraps(command)
    def with_options(as_json: bool, quiet: bool, verbose: int, decimal_comma: bool = False, **arguments: Any) -> None:
        token, mark = AS_JSON.set(as_json), DECIMAL.set("," if decimal_comma else ".")
        try:
            with _logging(quiet, verbose):
                command(**arguments)
        finally:
            AS_JSON.reset(token)
            DECIMAL.reset(mark)

    return with_options


table_output_options = together(
    click.option(
        "--decimal-comma", is_flag=True, help="Write .csv with decimal commas, and semicolons between the cells."
    ),
    output_options,
)


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
        click.echo(json.dumps(plain(data()), ensure_ascii=False, indent=2, allow_nan=False))
    elif LOG.isEnabledFor(logging.WARNING):
        click.echo(visible("\n".join(lines)))


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
