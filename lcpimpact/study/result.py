"""The result of a study: a table, a summary in words, a picture and a report."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import pandas as pd

from lcpimpact.arguments import checked
from lcpimpact.registry import html_of, load


class Study:
    """Base class of the results of studies.

    A result is a frozen dataclass derived from this class. Its summary, plot and report need only its fields, and its table
    contains only numbers and strings, so that it survives a CSV round trip.
    """

    drawn_by: ClassVar[str]
    """The function that draws the picture, as ``"package.module:function"``."""

    title: ClassVar[str]
    """The title of the report, a format string in which {0} is the result."""

    if TYPE_CHECKING:

        @property
        def table(self) -> pd.DataFrame:
            """The numbers."""

    def summary(self) -> str:
        """Return the result in a few lines; the first names the study."""
        raise NotImplementedError

    def head(self) -> list[str]:
        """Return the first lines of the summary, which name the study."""
        return self.summary().split("\n")[:1]

    @property
    def failures(self) -> pd.DataFrame:
        """The rows of the table without a result, with the reason in the column ``failure``."""
        return failed_rows(self.table)

    @checked
    def plot(self, path: str | Path | None = None, **options: str | float | None) -> Any:
        """Draw the picture of the study.

        Parameters
        ----------
        path : str or Path, optional
            A file ending in .png, .svg or .pdf to write.
        **options
            Options of the function named by ``drawn_by``.

        Returns
        -------
        matplotlib Figure

        Raises
        ------
        InputError
            For an invalid option, another ending, or a folder that cannot be written.
        """
        figure = load(self.drawn_by)(self, **options)
        if path is not None:
            load("lcpimpact.plotting.style:save")(figure, path)
        return figure

    @checked
    def report(self, path: str | Path) -> Path:
        """Write a self-contained page with the summary, the picture and the tables.

        Parameters
        ----------
        path : str or Path
            A file ending in .html, written atomically.

        Raises
        ------
        InputError
            For another ending, or a folder that cannot be written.
        """
        written: Path = load("lcpimpact.report.studies:report")(self, path)
        return written

    def __repr__(self) -> str:
        return self.summary()

    def _repr_html_(self) -> str:
        return html_of(self)


def failed_rows(table: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of a table with a non-empty column ``failure``, or none without such a column."""
    return table[table["failure"].fillna("") != ""] if "failure" in table else table.iloc[:0]


def failure_lines(failures: pd.DataFrame) -> list[str]:
    """Return a line for each reason of failure, with the number of rows that have it."""
    counted = failures["failure"].value_counts(sort=False) if len(failures) else {}
    return [f"  {number} without a result: {reason}" for reason, number in counted.items()]


def table_lines(table: pd.DataFrame, form: str = ".3g") -> list[str]:
    r"""Return a table as lines of text, its columns aligned.

    Examples
    --------
    >>> print("\n".join(table_lines(pd.DataFrame({"name": ["x", "long"], "value": [1.25, math.nan]}))))
      name  value
      x     1.25
      long  -
    """
    rows = [[str(name) for name in table.columns]]
    rows += [[cell(value, form) for value in row] for row in table.itertuples(index=False, name=None)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  " + "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip() for row in rows
    ]


def cell(value: float | str | None, form: str = ".3g") -> str:
    """Format a table cell, with a dash for a missing number."""
    if value is pd.NA:
        return "-"
    if isinstance(value, float):
        return "-" if math.isnan(value) else format(value, form)
    return str(value)
