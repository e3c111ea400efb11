"""Measured curves, from tables, from text files as instruments and spreadsheets write them, and from Excel's .xlsx.

A header says the names of the columns, and their units beside them, as "Zeit [s];Kraft [kN]", "t (ms),F in kN" or "F/N", or
a row of units below says them. Before it may stand other lines, as the date of a test, and comments behind # or % anywhere.
Tabs, semicolons or commas separate the cells, whichever cuts the header and the numbers into as many. Between commas the
decimal mark is a point, and between others the one that the numbers show. What can be read in two ways is refused.
"""

from __future__ import annotations

import codecs
import csv
import math
import re
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from io import StringIO
from itertools import islice
from numbers import Real
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pandas as pd

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array, Indices
from lcpimpact.errors import InputError
from lcpimpact.files import reading, unescape_cell
from lcpimpact.registry import nearest
from lcpimpact.run_files import workbook_rows
from lcpimpact.units import Unit, conversion, is_unit

Cell: TypeAlias = float | str
"""A cell of a table: a number of a workbook, or a text."""

Row: TypeAlias = tuple[int, list[Cell]]
"""A row of a file: the number of its line, and its cells."""

DECIMAL_MARKS = (".", ",")

NUMBER = re.compile(r"[+−-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eEdD][+−-]?\d+)?")
"""A number, with one decimal mark or none, and an exponent behind e or, as Fortran writes it, D."""

MARKED = re.compile(r"[+−-]?(?:\d*[.,]\d*|\d{1,3}(?:[.,]\d{3})+(?:[.,]\d+)?)(?:[eEdD][+−-]?\d+)?")
"""A number with decimal marks or thousands separators."""

GROUPED = re.compile(r"[+−-]?[1-9]\d{0,2}(?:[.,]\d{3})+")
"""A number whose marks may all be thousands separators."""


PLAIN_SIGNS = str.maketrans(",−dD", ".-ee")
"""The signs of `NUMBER` to those that Python reads."""


@dataclass(frozen=True, eq=False)
class CurveTable:
    """A table of measured curves.

    Attributes
    ----------
    frame : DataFrame               the cells by header, in rows that have the numbers of their lines, or of a table's rows
    units : mapping of str to str   the unit that the table states of a column, by header; others have none
    decimal : str                   the decimal mark of the texts among the cells
    path : Path or None             the file that it is from
    """

    frame: pd.DataFrame
    units: Mapping[str, str]
    decimal: str = "."
    path: Path | None = None

    @classmethod
    @checked
    def of(cls, data: str | Path | pd.DataFrame, decimal: str | None = None) -> CurveTable:
        """Return the table of a file, or a table itself.

        Parameters
        ----------
        data : path or DataFrame
            A text file with a header, its cells separated by commas, semicolons or tabs; the first sheet of a workbook
            ending in .xlsx; or a table.
        decimal : {".", ","}, optional
            The decimal mark of the file. By default it is read from the numbers, where only one is possible.

        Raises
        ------
        InputError
            For a file that cannot be read, or can be read in two ways.
        UnsupportedError
            Without the extra ``excel`` for .xlsx.
        """
        if isinstance(data, pd.DataFrame):
            if decimal is not None:
                raise InputError(f"decimal = {decimal!r} is for a file, and the data are a table: leave it out")
            names = _words(data.columns)
            _check_distinct(names)
            return cls(data.set_axis(names, axis=1).reset_index(drop=True), _units(names, ()))
        path = Path(data)
        with reading(path, "cut the curve"):
            return _read(path, decimal)

    @property
    def header(self) -> list[str]:
        """The names of the columns, with their units."""
        return list(self.frame.columns)

    @property
    def names(self) -> list[str]:
        """The names of the columns, without their units."""
        return [_named(header)[0] for header in self.frame.columns]

    def column(self, name: str, needed: str = "") -> str:
        """Return the header of a column that is named by it, with its unit or without.

        Raises
        ------
        InputError
            For a name of none or of several; ``needed`` says what for.
        """
        if name in self.frame:
            return name
        found = [each for each in self.header if _named(each)[0] == name]
        if len(found) > 1:
            raise InputError(f"{name!r} names several columns: say one of {', '.join(map(repr, found))}")
        if not found:
            raise InputError(f"{nearest(name, self.header, 'column')}{needed}")
        return found[0]

    def clock(
        self,
        time: str | None = None,
        *,
        names: Sequence[str] = ("t", "time", "zeit", "temps", "tiempo", "tempo", "tijd"),
    ) -> str:
        """Return the header of the column of times.

        Parameters
        ----------
        time : str, optional
            Its name; by default it is one of ``names``, or the only column with a unit of time.

        Raises
        ------
        InputError
            If there is none, or several.
        """
        with self._reading():
            if time is not None:
                return self.column(time)
            for word in names:
                found = [each for each in self.header if _named(each)[0].casefold() == word]
                if len(found) == 1:
                    return found[0]
            second = Unit.of("s").dimension
            timed = [each for each, unit in self.units.items() if is_unit(unit) and Unit.of(unit).dimension == second]
            if len(timed) == 1:
                return timed[0]
            known = timed or self.header
            raise InputError(
                f"no column t: say which of {', '.join(map(repr, known))} has the times, as time={known[0]!r} (--time)"
            )

    def _reading(self) -> AbstractContextManager[None]:
        """Return the context that names the file in errors."""
        return nullcontext() if self.path is None else reading(self.path, "cut the curve")

    @checked
    def curve(
        self,
        columns: Mapping[str, str] | Sequence[str],
        time: str = "t",
        units: Mapping[str, str] | None = None,
        wanted: Mapping[str, str] | None = None,
    ) -> pd.DataFrame:
        """Return t and some columns in coherent units, checked.

        Parameters
        ----------
        columns : mapping of str to str, or sequence of str
            Names of the columns by the names that they get; or their names.
        time : str
            The column of their instants, which becomes t. Empty rows at its end are left out.
        units : mapping of str to str, optional
            Units of columns, in place of those that the table states. Without either the numbers are in the SI.
        wanted : mapping of str to str, optional
            The unit of each result, which those of the columns must fit.

        Returns
        -------
        DataFrame
            ``attrs`` has the ``units`` of its columns.

        Raises
        ------
        InputError
            For a column that is missing, an unknown or unfit unit, cells that hold no finite number, and times that are
            negative or do not rise; the message names the lines of the file, or the rows of the table.
        """
        with self._reading():
            asked = dict(columns) if isinstance(columns, Mapping) else {name: name for name in columns}
            needed = f"; a curve needs t and {', '.join(asked.values())}"
            headers = {"t": self.column(time, needed)}
            headers |= {name: self.column(each, needed) for name, each in asked.items()}
            given = {self.column(name): unit for name, unit in (units or {}).items()}
            fit = {"t": "s"} | dict(wanted or {})
            found = {name: self._unit(header, given, fit.get(name, "")) for name, header in headers.items()}
            cells = self.frame[list(headers.values())].set_axis(list(headers), axis=1)
            blank = _blank(self.frame if time == "t" else cells)
            table = self._numbers(cells[~(blank & blank[::-1].cummin()[::-1])], found)
            table.attrs["units"] = {name: unit.coherent for name, unit in found.items()}
            return table

    def said(self, name: str, column: str, unit: str, given: Mapping[str, str]) -> str:
        """Return the column and the unit of a result in words, "" where it has the same name and unit.

        Examples
        --------
        >>> CurveTable.of(pd.DataFrame({"t [s]": [0.0], "Kraft": [1.0]})).said("R", "Kraft", "N", {"Kraft": "kN"})
        "R [N] is 'Kraft' in kN"
        """
        header = self.column(column)
        unlike = {self.column(each): text for each, text in given.items()}.get(header, "")
        if header == name and unlike in ("", unit):
            return ""
        return f"{name} [{unit or 1}] is {header!r}" + (f" in {unlike}" if unlike else "")

    def _unit(self, header: str, given: Mapping[str, str], wanted: str) -> Unit:
        """Return the unit of a column, checked."""
        text = given.get(header, self.units.get(header, ""))
        if not text:
            return conversion(wanted, wanted)
        try:
            return conversion(text, wanted)
        except InputError as error:
            state = f"state another, as units={{{_named(header)[0]!r}: {wanted or 'm'!r}}} (--unit)"
            raise InputError(f"column {header!r}: {error}; {'change it' if header in given else state}") from None

    def _numbers(self, cells: pd.DataFrame, units: Mapping[str, Unit]) -> pd.DataFrame:
        """Return a table of finite numbers with rising times t."""
        table = {}
        for name in cells.columns:
            numbers = self._finite(cells[name])
            table[name] = units[name].converted(numbers)
        t = table["t"]
        if len(t) and t[0] < 0.0:
            first = self._places(cells.index[:1])
            raise InputError(f"t = {t[0]:g} s in {first} lies before the run, which begins at 0; shift the times")
        stuck: Indices = 1 + np.flatnonzero(np.diff(t) <= 0.0)
        if len(stuck):
            raise InputError(f"t does not rise in {self._places(cells.index[stuck])}; sort the rows and delete doubles")
        return pd.DataFrame(table)

    def _finite(self, column: pd.Series) -> Array:
        """Return the numbers of a column."""
        numbers = self.numbers(column)
        bad: Indices = np.flatnonzero(~np.isfinite(numbers))
        if len(bad):
            cell = column.iloc[bad[0]]
            shown = f", as {cell!r}" if isinstance(cell, str) and cell else ""
            joined = re.sub(r"(?<=\d)['’\s](?=\d{3})", "", str(cell))
            grouped = joined != cell and NUMBER.fullmatch(joined)
            remedy = f"write it without thousands separators, as {joined}" if grouped else "fill or delete them"
            raise InputError(
                f"column {column.name}: no finite number in {self._places(column.index[bad])}{shown}; {remedy}"
            )
        return numbers

    def numbers(self, column: pd.Series) -> Array:
        """Return the numbers of a column, NaN where a cell holds none."""
        if pd.api.types.is_complex_dtype(column):
            raise InputError(f"column {column.name} holds complex numbers: write real ones")
        numeric = pd.api.types.is_numeric_dtype(column)
        found = [column] if numeric else [_number(cell, self.decimal) for cell in column]
        return np.array(found, dtype=np.float64).reshape(len(column))

    def _places(self, rows: pd.Index) -> str:
        what = "row" if self.path is None else "line"
        shown = ", ".join(map(str, rows[:5]))
        more = f" and {len(rows) - 5} more" if len(rows) > 5 else ""
        return f"{what}{'s' if len(rows) > 1 else ''} {shown}{more}"


@checked
def read_curves(
    data: str | Path | pd.DataFrame,
    columns: Mapping[str, str] | Sequence[str] | None = None,
    *,
    time: str | None = None,
    units: Mapping[str, str] | None = None,
    decimal: str | None = None,
) -> pd.DataFrame:
    r"""Read measured curves from a file as instruments and spreadsheets write it, in units of the SI.

    Parameters
    ----------
    data : path or DataFrame
        A text file with cells between commas, semicolons or tabs, in UTF-8, UTF-16 or Windows-1252, a workbook ending in
        .xlsx (its first sheet), or a table. Its header names the columns, with units or without: "Zeit [s];Kraft [kN]",
        "t (ms),F in kN".
    columns : mapping of str to str, or sequence of str, optional
        Columns to read by the names that they get, ``{"R": "Kraft"}``; or their names; by default all.
    time : str, optional
        The column of the times; by default the one named t, time or Zeit, or the only one with a unit of time.
    units : mapping of str to str, optional
        Units of columns, ``{"Kraft": "kN"}``, in place of those in the header. Without either a column is in the SI.
    decimal : {".", ","}, optional
        The decimal mark of the file; by default the one that its numbers show.

    Returns
    -------
    DataFrame
        t in s and the columns, in coherent units of the SI, which ``attrs["units"]`` says.

    Raises
    ------
    InputError
        For a file that can be read in two ways, a column that is missing, an unknown unit, cells without a number, and times
        that do not rise, with the lines.
    UnsupportedError
        Without the extra ``excel`` for .xlsx.

    Examples
    --------
    >>> from tempfile import mkdtemp
    >>> file = Path(mkdtemp(), "test 5.csv")
    >>> _ = file.write_text("Zeit [ms];Kraft [kN]\n0;0,5\n2,5;1,25\n")
    >>> read_curves(file, {"R": "Kraft"}).to_dict("list")
    {'t': [0.0, 0.0025], 'R': [500.0, 1250.0]}
    """
    table = CurveTable.of(data, decimal)
    clock = table.clock(time)
    names = table.names
    short = {
        header: name if names.count(name) == 1 else header for header, name in zip(table.header, names, strict=True)
    }
    every = {short[header]: header for header in table.header if header != clock}
    return table.curve(every if columns is None else columns, clock, units)


def _named(header: str) -> tuple[str, str]:
    """Return the name and the unit of a header, "" where it states none.

    Examples
    --------
    >>> [_named(header) for header in ("Zeit [s]", "t (ms)", "F in kN", "F/kN", "Weg, mm", "v_x", "F/l")]
    [('Zeit', 's'), ('t', 'ms'), ('F', 'kN'), ('F', 'kN'), ('Weg', 'mm'), ('v_x', ''), ('F/l', '')]
    """
    for found in re.finditer(r"\s*(?:\[([^][]*)\]|\(([^()]*)\))", header):
        name, unit = f"{header[: found.start()]}{header[found.end() :]}".strip(), (found[1] or found[2] or "").strip()
        if name and (found[1] is not None or not header[found.end() :] or is_unit(unit)):
            return name, unit
    behind = re.fullmatch(r"(.*\S)\s+in\s+(\S.*)", header) or re.fullmatch(r"(.*?[^\s,/])\s*[/,]\s*(\S.*)", header)
    if behind and (" in " in header or is_unit(behind[2].strip("()"))):
        return behind[1], behind[2].strip("()")
    return header, ""


def _units(names: Sequence[str], below: Sequence[Cell]) -> dict[str, str]:
    """Return the units that a header states, in its cells or in the row below."""
    beside = dict(zip(names, map(_bare, below), strict=False))
    found = {name: _named(name)[1] or beside.get(name, "") for name in names}
    return {name: unit for name, unit in found.items() if unit}


def _bare(cell: Cell) -> str:
    """Return a unit without brackets about it."""
    return str(cell).strip("[]() ")


def _number(cell: Cell, mark: str) -> float:
    """Return the number of a cell with this decimal mark, NaN for what is none."""
    if isinstance(cell, str):
        other = DECIMAL_MARKS[mark == "."]
        return float(cell.translate(PLAIN_SIGNS)) if NUMBER.fullmatch(cell) and other not in cell else math.nan
    return float(cell) if isinstance(cell, Real) and not isinstance(cell, bool) else math.nan


def _blank(frame: pd.DataFrame) -> pd.Series:
    """Return whether all cells of each row are empty."""
    return pd.Series((frame.isna() | (frame == "")).all(axis=1))


def _check_distinct(names: Sequence[str]) -> None:
    if len(set(names)) < len(names):
        raise InputError("two of its columns have one name; name each column once")


def _words(header: Iterable[Hashable]) -> list[str]:
    """Return the names of columns."""
    return [unescape_cell(str(name).strip()) for name in header]


# ---- files ----------------------------------------------------------------------------------------------------------


def _read(path: Path, decimal: str | None) -> CurveTable:
    """Return the table of a file."""
    if decimal not in (None, *DECIMAL_MARKS):
        raise InputError(f"decimal = {decimal!r} must be '.' or ','")
    if path.suffix.lower() == ".xlsx":
        separator, rows = "", workbook_rows(path)
    else:
        text = _text(path)
        separator = _separator(text)
        rows = list(_rows(text, separator))
    at, below = _header(rows) or _first(rows)
    if at is None:
        raise InputError("it holds no table; write a header and numbers, as t;R and 0;1")
    names = _words(str(cell).removeprefix("#").removeprefix("%") for cell in rows[at][1])
    _check_distinct([name for name in names if name])
    if len(names) == 1 and " " in names[0] and any(" " in str(cell) for _, row in rows[at + 1 :] for cell in row):
        raise InputError("blanks separate its columns; separate them by tabs or semicolons")
    units = _units(names, rows[below][1] if below is not None else ())
    body = rows[1 + (at if below is None else below) :]
    lines, cells = list[int](), list[list[Cell]]()
    for line, row in body:
        if _is_comment(row):
            continue
        if len(row) > len(names) and (separator == "," or any(cell != "" for cell in row[len(names) :])):
            raise InputError(
                f"line {line} has more cells than the header, which has {len(names)}; where commas are decimal marks, "
                "separate the cells by semicolons"
            )
        lines.append(line)
        cells.append([*row[: len(names)], *[""] * (len(names) - len(row))])
    places = [place for place, name in enumerate(names) if name]
    frame = pd.DataFrame(
        {names[place]: pd.Series([row[place] for row in cells], dtype=object) for place in places}
    ).set_axis(lines, axis=0)
    texts = [cell for row in cells for cell in row if isinstance(cell, str) and ("," in cell or "." in cell)]
    if decimal is None and (separator != "," or any("," in text for text in texts)):
        decimal = _decimal_mark(texts)
    return CurveTable(frame, units, decimal or ".", path)


def _text(path: Path) -> str:
    """Return the text of a file in UTF-8, UTF-16 or Windows-1252."""
    content = path.read_bytes()
    wide = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        text = content.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError:
        try:
            text = content.decode("cp1252")
        except UnicodeDecodeError:
            raise InputError("its text is in none of UTF-8, UTF-16 and Windows-1252; save it as CSV in UTF-8") from None
    if "\0" in text:
        raise InputError("it is no text; export it as CSV, or as .xlsx")
    return text


def _rows(text: str, separator: str) -> Iterator[Row]:
    """Yield the rows of a text."""
    reader = csv.reader(StringIO(text, newline=""), delimiter=separator, skipinitialspace=True)
    try:
        for cells in reader:
            yield reader.line_num, [cell.strip() for cell in cells]
    except csv.Error as error:
        raise InputError(
            "it is no CSV file with one header and commas, semicolons or tabs between cells: "
            f"{error} in line {reader.line_num}"
        ) from None


def _separator(text: str, *, most: int = 200) -> str:
    """Return the separator of the cells of a text, found in so many rows at its head."""
    told = re.match(r'"?sep=(.)"?[\r\n]', text)
    if told:
        return told[1]
    heads = {separator: list(islice(_rows(text, separator), most)) for separator in ("\t", ";", ",")}
    for separator, rows in heads.items():
        if _header(rows):
            return separator
    cells = {separator: max((len(row) for _, row in rows[:1]), default=0) for separator, rows in heads.items()}
    return max(cells, key=lambda separator: (cells[separator], separator == ","))


def _header(rows: Sequence[Row]) -> tuple[int, int | None] | None:
    """Return the places of the header and of the units below it, if numbers stand below; those of comments come last."""
    above = list[int]()
    for i, (_, row) in enumerate(rows):
        numbers = sum(_looks_numeric(cell) for cell in row)
        if numbers < 2:
            if any(cell != "" for cell in row):
                above.append(i)
            continue
        told = [place for place in above if not _is_comment(rows[place][1])] or above
        below = told[-1] if len(told) > 1 and _are_units(rows[told[-1]][1]) else None
        told = told[:-1] if below is not None else told
        if told:
            words = rows[told[-1]][1]
            if sum(cell != "" for cell in words) >= numbers and not any(map(_looks_numeric, words)):
                return told[-1], below
        above.append(i)
    return None


def _first(rows: Sequence[Row]) -> tuple[int | None, None]:
    """Return the place of the first row that is no comment and not empty."""
    written = (i for i, (_, row) in enumerate(rows) if any(cell != "" for cell in row) and not _is_comment(row))
    return next(written, None), None


def _is_comment(row: Sequence[Cell]) -> bool:
    """Return whether a row is a comment, or tells Excel the separator."""
    return bool(row) and str(row[0]).startswith(("#", "%", "sep="))


def _looks_numeric(cell: Cell) -> bool:
    return not isinstance(cell, str) or bool(NUMBER.fullmatch(cell) or MARKED.fullmatch(cell))


def _are_units(row: Sequence[Cell]) -> bool:
    """Return whether the cells of a row are units, known ones or in brackets, and not all of pure numbers."""
    bracketed = [re.fullmatch(r"\[[^][]*\]", str(cell)) is not None for cell in row]
    known = [is_unit(_bare(cell)) for cell in row]
    pure = [_bare(cell) in ("", "-", "1") for cell in row]
    return any(known) and all(map(any, zip(bracketed, known, pure, strict=True)))


def _decimal_mark(cells: Iterable[str]) -> str:
    r"""Return the decimal mark that the numbers among texts show.

    Raises
    ------
    InputError
        If they show both marks, or if all could have thousands separators in its place.

    Examples
    --------
    >>> _decimal_mark(["0", "0,5", "1,5e3", "2,125"])
    ','
    >>> _decimal_mark(["1", "2", "1,500", "2,125"])
    Traceback (most recent call last):
        ...
    lcpimpact.errors.InputError: the mark in '1,500' may separate decimals or thousands; state decimal='.' or ',' (--decimal)
    """
    numbers = [text for text in cells if MARKED.fullmatch(text) and ("," in text or "." in text)]
    of_mark = {mark: next((text for text in numbers if mark in text), "") for mark in DECIMAL_MARKS}
    if all(of_mark.values()):
        point, comma = of_mark.values()
        shown = repr(point) if point == comma else f"{point!r} and {comma!r}"
        raise InputError(f"{shown} have points and commas: remove thousands separators, and use one decimal mark")
    if numbers and all(map(GROUPED.fullmatch, numbers)):
        raise InputError(
            f"the mark in {numbers[0]!r} may separate decimals or thousands; state decimal='.' or ',' (--decimal)"
        )
    return "," if of_mark[","] else "."
