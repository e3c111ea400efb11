"""Measured curves, from tables and from CSV files as instruments and spreadsheets write them.

Cells are separated by commas, semicolons or tabs: whichever gives the header a column t. Between commas the decimal mark is
a point, and between others it is the one that the numbers show. A file that can be read in two ways is refused.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Hashable, Iterable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np
import pandas as pd

from lcpimpact.arguments import checked
from lcpimpact.arrays import Indices
from lcpimpact.errors import InputError
from lcpimpact.files import reading, unescape_cell
from lcpimpact.registry import nearest

T = TypeVar("T")
P = ParamSpec("P")

CSV_OPTIONS: dict[str, Any] = {"encoding": "utf-8-sig", "skipinitialspace": True}
"""Options of pandas.read_csv by which every version reads numbers to their last bit."""
if tuple(map(int, pd.__version__.split(".")[:2])) < (3, 1):
    CSV_OPTIONS["float_precision"] = "round_trip"

SEPARATORS = (",", ";", "\t")
DECIMAL_MARKS = (".", ",")

MARKED = r"[+-]?(?:\d*[.,]\d*|\d{1,3}(?:[.,]\d{3})+(?:[.,]\d+)?)(?:[eE][+-]?\d+)?"
"""A number with decimal marks or thousands separators."""

GROUPED = r"[+-]?[1-9]\d{0,2}(?:[.,]\d{3})+"
"""A number whose marks may all be thousands separators."""


@dataclass(frozen=True, eq=False)
class CurveTable:
    """A table of measured curves.

    Attributes
    ----------
    frame : DataFrame       the columns, with their names stripped
    path : Path or None     the file that it is from
    """

    frame: pd.DataFrame
    path: Path | None = None

    @classmethod
    @checked
    def of(cls, data: str | Path | pd.DataFrame, decimal: str | None = None) -> CurveTable:
        """Return the table of a CSV file, or a table itself.

        Parameters
        ----------
        data : path or DataFrame
            A CSV file with a header, its cells separated by commas, semicolons or tabs; or a table.
        decimal : {".", ","}, optional
            The decimal mark of the file. By default it is read from the numbers, where only one is possible.

        Raises
        ------
        InputError
            For a file that cannot be read, or can be read in two ways.
        """
        if isinstance(data, pd.DataFrame):
            if decimal is not None:
                raise InputError(f"decimal = {decimal!r} is for a file, and the data are a table: leave it out")
            _check_distinct(_words(data.columns))
            return cls(data.set_axis(_words(data.columns), axis=1))
        path = Path(data)
        with reading(path, "cut the curve"):
            return cls(_read_csv(path, decimal), path)

    @property
    def header(self) -> list[str]:
        """The names of the columns."""
        return list(self.frame.columns)

    @checked
    def curve(self, columns: Sequence[str], time: str = "t") -> pd.DataFrame:
        """Return t and some columns, checked.

        Parameters
        ----------
        columns : sequence of str
            Names of columns.
        time : str
            The column of their instants, which becomes t. Empty rows at its end are left out.

        Raises
        ------
        InputError
            For a column that is missing, cells that hold no finite number, and times that are negative or do not rise; the
            message names the lines of the file (its header is line 1), or the rows of the table.
        """
        with nullcontext() if self.path is None else reading(self.path, "cut the curve"):
            for name in (time, *columns):
                if name not in self.frame:
                    raise InputError(
                        f"{nearest(name, self.header, 'column')}; a curve needs t and {', '.join(columns)}"
                    )
            table = self.frame[[time, *columns]].set_axis(["t", *columns], axis=1)
            blank = (self.frame if time == "t" else table).isna().all(axis=1)
            return self._numbers(table[~(blank & blank[::-1].cummin()[::-1])])

    def _numbers(self, table: pd.DataFrame) -> pd.DataFrame:
        """Return a table of finite numbers with rising times t."""
        numbers = table.apply(pd.to_numeric, errors="coerce").astype(float)
        for name in numbers.columns:
            bad: Indices = np.flatnonzero(~np.isfinite(numbers[name].to_numpy()))
            if len(bad):
                raise InputError(f"column {name}: no finite number in {self._places(bad)}; fill or delete them")
        t = numbers["t"].to_numpy()
        if len(t) and t[0] < 0.0:
            first = self._places(np.zeros(1, dtype=int))
            raise InputError(f"t = {t[0]:g} s in {first} lies before the run, which begins at 0; shift the times")
        stuck: Indices = 1 + np.flatnonzero(np.diff(t) <= 0.0)
        if len(stuck):
            raise InputError(f"t does not rise in {self._places(stuck)}; sort the rows and delete doubles")
        return numbers.reset_index(drop=True)

    def _places(self, rows: Indices) -> str:
        what, first = ("row", 0) if self.path is None else ("line", 2)
        shown = ", ".join(str(first + int(row)) for row in rows[:5])
        more = f" and {len(rows) - 5} more" if len(rows) > 5 else ""
        return f"{what}{'s' if len(rows) > 1 else ''} {shown}{more}"


def _read_csv(path: Path, decimal: str | None) -> pd.DataFrame:
    """Return the table of a CSV file, its names stripped."""
    if decimal not in (None, *DECIMAL_MARKS):
        raise InputError(f"decimal = {decimal!r} must be '.' or ','")
    separator, names = _parsed(_header, path)
    options = CSV_OPTIONS | {"sep": separator, "skip_blank_lines": False}
    if decimal is None and separator != ",":
        decimal = _decimal_mark(_parsed(pd.read_csv, path, **options, dtype=str, keep_default_na=False))
    table = _parsed(pd.read_csv, path, **options, decimal=decimal or ".")
    _check_distinct([name for name in names if name])
    if not isinstance(table.index, pd.RangeIndex):  # pandas takes the cells in front as names of the rows
        raise InputError(
            f"line 2 has more cells than the header, which has {len(names)}; where commas are decimal marks, separate the "
            "cells by semicolons"
        )
    table.columns = pd.Index(_words(table.columns))
    return table.apply(_pointed) if decimal == "," else table


def _parsed(read: Callable[Concatenate[Path, P], T], path: Path, *args: P.args, **options: P.kwargs) -> T:
    """Return the table that a function reads from a CSV file, its errors in one sentence."""
    try:
        return read(path, *args, **options)
    except UnicodeDecodeError:
        raise InputError("its text is not in UTF-8; save it as CSV in UTF-8") from None
    except (ValueError, csv.Error) as error:
        raise InputError(
            "it is no CSV file with one header and commas, semicolons or tabs between cells: "
            f"{' '.join(str(error).split())}"
        ) from None


def _check_distinct(names: Sequence[str]) -> None:
    if len(set(names)) < len(names):
        raise InputError("two of its columns have one name; name each column once")


def _header(path: Path) -> tuple[str, list[str]]:
    """Return the separator of a CSV file and the names of its columns."""
    with path.open(encoding=CSV_OPTIONS["encoding"], newline="") as file:
        line = "".join(row for row, _ in zip(file, range(1), strict=False))
    read = {
        separator: _words(next(csv.reader([line], delimiter=separator, skipinitialspace=True), []))
        for separator in SEPARATORS
    }
    separator = next((each for each, names in read.items() if "t" in names), ",")
    return separator, read[separator]


def _words(header: Iterable[Hashable]) -> list[str]:
    """Return the names of columns."""
    return [unescape_cell(str(name).strip()) for name in header]


def _pointed(column: pd.Series) -> pd.Series:
    """Return a column with commas in its texts as points; numbers with points are none where the decimal mark is a comma."""
    if pd.api.types.is_numeric_dtype(column):
        return column
    text = column.astype("str").str.replace(".", "?", regex=False)
    return text.str.replace(",", ".", regex=False).where(column.notna())


def _decimal_mark(cells: pd.DataFrame) -> str:
    r"""Return the decimal mark that the numbers of a table of strings show.

    Raises
    ------
    InputError
        If they show both marks, or if all could have thousands separators in its place.

    Examples
    --------
    >>> _decimal_mark(pd.DataFrame({"t": ["0", "0,5"], "R": ["1,5e3", "2,125"]}))
    ','
    >>> _decimal_mark(pd.DataFrame({"t": ["1", "2"], "R": ["1,500", "2,125"]}))
    Traceback (most recent call last):
        ...
    lcpimpact.errors.InputError: the mark in '1,500' may separate decimals or thousands; state the decimal mark, '.' or ','
    """
    texts = cells.stack().astype("str").str.strip()
    numbers = texts[texts.str.fullmatch(MARKED)]
    of_mark = {mark: numbers[numbers.str.contains(mark, regex=False)] for mark in DECIMAL_MARKS}
    if all(len(each) for each in of_mark.values()):
        point, comma = (each.iloc[0] for each in of_mark.values())
        shown = repr(point) if point == comma else f"{point!r} and {comma!r}"
        raise InputError(f"{shown} have points and commas: remove thousands separators, and use one decimal mark")
    if not len(numbers):
        return "."
    if numbers.str.fullmatch(GROUPED).all():
        raise InputError(
            f"the mark in {numbers.iloc[0]!r} may separate decimals or thousands; state the decimal mark, '.' or ','"
        )
    return "." if len(of_mark["."]) else ","
