"""Runs as tables and files: pandas, xarray, CSV, Excel, NumPy, netCDF, Parquet and MATLAB, each with units and metadata."""

from __future__ import annotations

import csv
import json
import math
import re
import unicodedata
import zipfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, fields
from itertools import chain, zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.files import Json, check_output, escape_cell, whole_files
from lcpimpact.finished import FinishedRun
from lcpimpact.integrators import METHODS
from lcpimpact.record import Event, State
from lcpimpact.registry import import_extra, load

if TYPE_CHECKING:
    import pandas as pd
    from xarray import Dataset

Cell: TypeAlias = float | str
"""A cell of a table."""

EVENT_COLUMNS = ("t", "contact", "kind", "impulse", "law", "solutions", "velocities")
"""Columns of an event in a file, beside those of its two limits; solutions is NaN where it was not examined, and velocities
are JSON, a list for each of several v⁺, or the extremes of a continuum; "" where there is one."""

EVENT_TEXTS = ("contact", "kind", "law", "velocities")
"""Columns of an event that hold texts."""

SCHEME_TEXT = "lcpimpact.schemefile:text_of_run"
"""Function that writes the text of a scheme file, by module and name."""

SIDES = ("left", "right")

EXTRAS = {".nc": ("xarray", "sweep"), ".parquet": ("pyarrow", "parquet"), ".xlsx": ("openpyxl", "excel")}
"""Ending to the package that writes it, and the extra that has it."""

SEPARATORS = {".": ",", ",": ";"}
"""Decimal mark of a CSV file to the separator of its cells."""

MATLAB_OWN = (
    "units", "metadata", "events", "names", "break", "case", "catch", "classdef", "continue", "else", "elseif", "end", "for",
    "function", "global", "if", "otherwise", "parfor", "persistent", "return", "spmd", "switch", "try", "while",
)  # fmt: skip
"""Names that a series cannot have in a .mat file: the structs beside it, and MATLAB's keywords."""


def check_format(path: Path) -> None:
    """Check, before any computation, that the package that writes the format of a file is installed.

    Raises
    ------
    UnsupportedError
        Naming the package and its extra.
    """
    if path.suffix in EXTRAS:
        import_extra(*EXTRAS[path.suffix])


def save(run: FinishedRun, path: Path, decimal: str = ".") -> None:
    """Write a run to the files of `companions` and to ``path``, all of them or none.

    Parameters
    ----------
    run : FinishedRun
    path : Path
    decimal : {".", ","}
        Decimal mark of a .csv file, as of `write_csv`.

    Raises
    ------
    InputError
        For an unknown ending, names that the format cannot hold, or a folder that cannot be written.
    UnsupportedError
        If the package that writes the format is not installed.
    """
    check_output(path, WRITERS)
    check_format(path)
    if decimal not in SEPARATORS:
        raise InputError(f"decimal = {decimal!r} must be '.' or ','")
    if decimal != "." and path.suffix != ".csv":
        raise InputError(f"decimal = {decimal!r} is for .csv, and {path.name!r} holds numbers, no texts: leave it out")
    marked = {"decimal": decimal} if path.suffix == ".csv" else {}
    with whole_files(*companions(path), path) as parts:
        WRITERS[path.suffix](run, *parts, **marked)


def companions(path: Path) -> tuple[Path, ...]:
    """Return the names of the files beside that of a run: run.events.csv and run.meta.json beside run.csv.

    Examples
    --------
    >>> [each.name for each in companions(Path("run.parquet"))], companions(Path("run.npz"))
    (['run.events.parquet'], ())
    """
    beside = {".csv": (".events.csv", ".meta.json"), ".parquet": (".events.parquet",)}
    return tuple(path.with_suffix(each) for each in beside.get(path.suffix, ()))


# ---- units and metadata ---------------------------------------------------------------------------------------------


def units(run: FinishedRun) -> dict[str, str]:
    """Return the unit of each series, of t and of t_R; "" for the series of a system of equations, which states none."""
    unit = run.problem.unit
    return {"t": unit("t"), "t_R": unit("t")} | {name: unit(name) for name in run.names}


def metadata(run: FinishedRun) -> dict[str, Json]:
    """Return the settings that made a run, and its end: strings, numbers and the parameters by name.

    Examples
    --------
    >>> from lcpimpact import load_problem, simulate
    >>> found = metadata(simulate(load_problem("bouncing-ball", e=0.5), dt=0.1, t_end=1.0))
    >>> found["problem"], found["parameters"]["e"], found["dt"], found["t_end"], found["status"]
    ('bouncing-ball', 0.5, 0.1, 1.0, 'SOLVED')
    """
    from lcpimpact import __version__

    return {
        "problem": run.problem.name,
        "parameters": {name: float(value) for name, value in run.problem.parameters.items()},
        "method": run.method,
        "dt": float(run.t[1] - run.t[0]) if len(run.t) > 1 else float("nan"),
        "t_end": float(run.t[-1]),
        "status": run.status.name,
        "message": run.message,
        "version": f"lcpimpact {__version__}",
    }


def _flat_metadata(run: FinishedRun) -> dict[str, Json]:
    """Return the metadata with the parameters as JSON, for formats without nesting."""
    found = metadata(run)
    return found | {"parameters": json.dumps(found["parameters"], ensure_ascii=False)}


def account(run: FinishedRun) -> dict[str, Json]:
    """Return the account of a run as plain JSON: scheme, method, certificate, error, summary and cost.

    Numbers that are not finite are the texts "nan", "inf" and "-inf". The scheme is "" where a scheme file cannot hold it,
    and the error is null where it is not known, and not quick to estimate.
    """
    error = run.quick_error() if run.estimates else None
    text: str = load(SCHEME_TEXT)(run)
    found = {
        "scheme": text,
        "settings": _settings(run),
        "certificate": asdict(run.certificate),
        "error": None if error is None else error.to_dict(),
        "summary": run.summary(),
        "stats": dict(run.stats),
        "continuous": run.dense is not None,
        "estimates": run.estimates,
    }
    return {name: plain(value) for name, value in found.items()}


def _settings(run: FinishedRun) -> dict[str, Any]:
    """Return the name, the options and the LCP solver of a registered method; nothing of another one."""
    method = run.integrator
    if method is None or METHODS.get(method.name) is not type(method):
        return {}
    options = {each.name: getattr(method, each.name) for each in fields(method)}  # type: ignore[arg-type]
    return {"method": method.name, "options": options, "solver": run.lcp_solver}


def plain(value: Any) -> Json:
    """Return a value of plain JSON."""
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    if isinstance(value, np.generic):
        value = value.item()
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def _flat_account(run: FinishedRun) -> dict[str, str]:
    """Return the `account` with JSON in place of nested values, for formats without nesting."""
    return {name: value if isinstance(value, str) else json.dumps(value) for name, value in account(run).items()}


# ---- tables ---------------------------------------------------------------------------------------------------------


def columns(run: FinishedRun) -> dict[str, Array]:
    """Return the columns of a run: t, coordinates, velocities; then t_R and the forces, which may be of other length."""
    motion = run.names[: 2 * len(run.nodes)]
    forces = run.names[2 * len(run.nodes) :]
    return {
        "t": run.t,
        **{name: run[name] for name in motion},
        "t_R": run.t_reaction,
        **{name: run[name] for name in forces},
    }


def _event_header(run: FinishedRun) -> list[str]:
    return [*EVENT_COLUMNS, *(f"{name}_{side}" for side in SIDES for name in run.names)]


def _event_rows(run: FinishedRun) -> Iterable[list[Cell]]:
    """Yield the cells of each event."""
    for event in run.events:
        limits = ((side.q, side.v, _forces(run, side)) for side in (event.left, event.right))
        numbers = np.concatenate([*chain.from_iterable(limits)]).tolist()
        yield [*_event_values(event), *numbers]


def _event_values(event: Event) -> list[Cell]:
    """Return the values of the `EVENT_COLUMNS`."""
    solutions = float("nan") if event.solutions is None else float(event.solutions)
    velocities = json.dumps([v.tolist() for v in event.velocities]) if event.velocities else ""
    return [event.t, event.contact, event.kind, event.impulse, event.law, solutions, velocities]


def _forces(run: FinishedRun, state: State) -> Array:
    """Return the forces of a limit of an event (nc + ns,): its reactions, and those of the non-linear springs."""
    if not run.push.shape[1]:
        return state.reaction
    return np.append(state.reaction, run.problem.dynamics.push(state.q[None], state.v[None])[0])


def to_pandas(run: FinishedRun) -> pd.DataFrame:
    """Return the columns of a run as a DataFrame, with units and metadata in ``attrs``."""
    import pandas as pd

    frame = pd.DataFrame({name: pd.Series(values) for name, values in columns(run).items()})
    frame.attrs = metadata(run) | {"units": units(run)}
    return frame


def to_xarray(run: FinishedRun) -> Dataset:
    """Return a run as an xarray Dataset, with units in the attributes of its variables and metadata in its own."""
    xarray = import_extra(*EXTRAS[".nc"])
    given, unit = columns(run), units(run)
    forces = list(run.names[2 * len(run.nodes) :])
    axes = {name: "t_R" if name in forces else "t" for name in run.names}
    series = {name: (axis, given[name], unit_attribute(unit[name])) for name, axis in axes.items()}
    found = _event_arrays(run)
    events: dict[str, Any] = {f"event_{name}": ("event", found[f"event_{name}"]) for name in EVENT_COLUMNS}
    coordinates: dict[str, Any] = {name: (name, given[name], unit_attribute(unit[name])) for name in ("t", "t_R")}
    coordinates["event_side"] = list(SIDES)
    coordinates["event_node"] = list(run.nodes)
    places = {"q": "event_node", "v": "event_node"}
    if forces:  # netCDF has no axis of length 0 except that of the events
        coordinates["event_row"] = forces
        places["reaction"] = "event_row"
    for name, place in places.items():
        sides = [found[f"event_{name}_{side}"] for side in SIDES]
        events[f"event_{name}"] = (("event", "event_side", place), np.stack(sides, axis=1))
    for name in run.names:
        if name == "event" or name in events or name in coordinates:
            raise InputError(f"the series {name!r} has a name that a Dataset needs for the events: rename it")
    made: Dataset = xarray.Dataset(series | events, coords=coordinates, attrs=_flat_metadata(run))
    return made


def unit_attribute(unit: str) -> dict[str, str]:
    """Return the attributes of a variable of a Dataset with a unit; without one it has none."""
    return {"units": unit} if unit else {}


def _event_arrays(run: FinishedRun) -> dict[str, Array]:
    """Return the fields of the events as arrays with one row per event (ne, ...)."""
    n, rows = len(run.nodes), len(run.force_names)
    values = [_event_values(each) for each in run.events]
    arrays = {f"event_{name}": np.array([each[k] for each in values]) for k, name in enumerate(EVENT_COLUMNS)}
    for name in EVENT_TEXTS:
        arrays[f"event_{name}"] = arrays[f"event_{name}"].astype(str)
    for side in SIDES:
        for name, size in (("q", n), ("v", n), ("reaction", rows)):
            limits = [getattr(each, side) for each in run.events]
            of_side = [_forces(run, each) if name == "reaction" else getattr(each, name) for each in limits]
            arrays[f"event_{name}_{side}"] = np.array(of_side, dtype=np.float64).reshape(len(of_side), size)
    return arrays


# ---- files ----------------------------------------------------------------------------------------------------------


def _write_csv(run: FinishedRun, events: Path, meta: Path, path: Path, decimal: str) -> None:
    """Write the series and the events as tables of plain numbers, and the metadata as JSON beside them."""
    write_csv(path, columns(run), _rows(run), decimal)
    write_csv(events, _event_header(run), _event_rows(run), decimal)
    meta.write_text(_json(metadata(run) | {"units": units(run)} | account(run)), encoding="utf-8")


def _rows(run: FinishedRun) -> Iterable[tuple[Cell, ...]]:
    """Return the rows of the `columns` of a run, the ends of shorter ones empty."""
    return zip_longest(*(values.tolist() for values in columns(run).values()), fillvalue="")


def write_csv(path: Path, header: Iterable[str], rows: Iterable[Iterable[Cell | None]], decimal: str = ".") -> None:
    """Write a table as CSV, its texts escaped for spreadsheets.

    Parameters
    ----------
    path : Path
    header : iterable of str
    rows : iterable of iterables
        Numbers, to their last bit, and texts; None is an empty cell.
    decimal : {".", ","}
        Decimal mark; commas between cells go with points, and semicolons with commas.
    """
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, delimiter=SEPARATORS[decimal])
        writer.writerow(map(escape_cell, header))
        writer.writerows([_written(cell, decimal) for cell in row] for row in rows)


def _written(cell: Cell | None, decimal: str) -> Cell | None:
    """Return a cell of a CSV file: a text escaped for spreadsheets, a number with its decimal mark."""
    if isinstance(cell, str):
        return escape_cell(cell)
    return cell if decimal == "." or cell is None else str(cell).replace(".", decimal)


def _write_excel(run: FinishedRun, path: Path) -> None:
    """Write the sheets run, events, units and metadata; a cell has no room for the scheme, which is left out."""
    told = _flat_metadata(run) | _flat_account(run)
    rows = [
        (name, value if isinstance(value, float) else str(value)) for name, value in told.items() if name != "scheme"
    ]
    write_workbook(
        path,
        {
            "run": (columns(run), _rows(run)),
            "events": (_event_header(run), _event_rows(run)),
            "units": (("series", "unit"), units(run).items()),
            "metadata": (("name", "value"), rows),
        },
    )


def write_workbook(
    path: Path,
    sheets: Mapping[str, tuple[Iterable[str], Iterable[Iterable[Cell]]]],
    *,
    most_rows: int = 1_048_576,
    most_columns: int = 16_384,
) -> None:
    """Write tables as the sheets of an Excel workbook, each a header and rows.

    Numbers have the 16 digits that openpyxl writes; NaN is an empty cell, and texts are escaped as in CSV files.
    ``most_rows``, ``most_columns``: size of a sheet of Excel.

    Raises
    ------
    InputError
        For more rows or columns than a sheet has, and for texts that a cell cannot hold.
    UnsupportedError
        Without the extra ``excel``.
    """
    openpyxl = import_extra(*EXTRAS[".xlsx"])
    tables = {
        title: [[*map(_in_sheet, row)] for row in chain([header], rows)] for title, (header, rows) in sheets.items()
    }
    for title, table in tables.items():
        if len(table) > most_rows or len(table[0]) > most_columns:
            raise InputError(
                f"a sheet of Excel has {most_rows:,} rows and {most_columns:,} columns, and {title} has more: write .csv or "
                ".npz, or take longer steps"
            )
    workbook = openpyxl.Workbook(write_only=True)
    for title, table in tables.items():
        sheet = workbook.create_sheet(title)
        for row in table:
            sheet.append(row)
    workbook.save(path)


def _in_sheet(cell: Cell, *, most: int = 32_767) -> Cell | None:
    """Return a cell of a workbook, whose texts have ``most`` characters, or None for an empty one."""
    if isinstance(cell, str):
        text = escape_cell(cell)
        if len(text) > most or re.search(r"[\x00-\x08\x0b\x0c\x0e-\x1f]", text):
            raise InputError(f"a cell of Excel cannot hold {text[:20]!r}...: it is too long or has control characters")
        return text
    if isinstance(cell, float) and not math.isfinite(cell):
        return None if math.isnan(cell) else str(cell)
    return cell


def workbook_rows(path: Path) -> list[tuple[int, list[Cell]]]:
    """Return the rows of the first sheet of an Excel workbook, with their numbers; empty cells are "".

    Raises
    ------
    InputError
        For a file that is none.
    UnsupportedError
        Without the extra ``excel``.
    """
    import_extra(*EXTRAS[".xlsx"])
    import pandas as pd

    try:
        frame = pd.read_excel(path, header=None, dtype=object, engine="openpyxl", keep_default_na=False)
    except (ValueError, KeyError, zipfile.BadZipFile) as error:
        raise InputError(f"it is no Excel workbook ({error}); save it as .xlsx, or as CSV") from None
    rows = frame.itertuples(index=False, name=None)
    return [(line, [_from_sheet(cell) for cell in row]) for line, row in enumerate(rows, 1)]


def _from_sheet(cell: Cell | None) -> Cell:
    """Return a cell of a workbook: a number, or a text."""
    if isinstance(cell, bool) or not isinstance(cell, int | float):
        return str(cell).strip()
    return "" if cell != cell else cell


def _json(found: Mapping[str, Json]) -> str:
    """Return metadata as JSON, which has no word for NaN: null."""
    known = {name: None if value != value else value for name, value in found.items()}
    return json.dumps(known, ensure_ascii=False, indent=1, allow_nan=False) + "\n"


def _write_npz(run: FinishedRun, path: Path) -> None:
    unit = units(run)
    everything: dict[str, Any] = {
        name: getattr(run, name) for name in ("t", "q", "v", "t_reaction", "reaction", "push")
    }
    everything |= {"names": np.array(run.names), "units": np.array([unit[name] for name in run.names])}
    everything |= _event_arrays(run) | _flat_metadata(run) | _flat_account(run)
    with path.open("wb") as file:
        np.savez_compressed(file, **everything)


def _write_netcdf(run: FinishedRun, path: Path) -> None:
    netcdf(to_xarray(run).assign_attrs(_flat_account(run))).to_netcdf(path, engine="scipy")


def netcdf(dataset: Dataset) -> Dataset:
    """Return a Dataset as netCDF takes it: a name with other than ASCII letters is spelled by `matlab_names`.

    The name as it was is the attribute ``long_name`` of the variable.
    """
    names = sorted(map(str, {*dataset.variables, *dataset.dims}), key=lambda name: (not name.isascii(), name))
    renamed = {name: plain for name, plain in zip(names, matlab_names(names), strict=True) if not name.isascii()}
    found = dataset.rename(renamed)
    for name, plain in renamed.items():
        if plain in found.variables:
            found[plain].attrs["long_name"] = name
    return found


def _write_parquet(run: FinishedRun, events: Path, path: Path) -> None:
    import pandas as pd

    frame = to_pandas(run)
    frame.attrs |= account(run)
    frame.to_parquet(path, engine="pyarrow", index=False)
    found = pd.DataFrame(list(_event_rows(run)), columns=_event_header(run))
    found = found.astype({name: "str" if name in EVENT_TEXTS else "float64" for name in found})
    found.attrs = frame.attrs
    found.to_parquet(events, engine="pyarrow", index=False)


def _write_matlab(run: FinishedRun, path: Path) -> None:
    """Write each series as a column, and the structs units, metadata, events and names, which has the names of the run."""
    from scipy.io import savemat
    from scipy.io.matlab import MatWriteError

    series = columns(run)
    told = metadata(run) | _flat_account(run)
    valid = dict(zip(series, matlab_names(series), strict=True))
    parameters = run.problem.parameters
    told["parameters"] = dict(zip(matlab_names(parameters), map(float, parameters.values()), strict=True))
    found = _event_arrays(run)
    events = {name.removeprefix("event_"): found[name] for name in found}
    events |= {name: events[name].astype(object) for name in EVENT_TEXTS}  # cell arrays of texts
    everything = {valid[name]: values for name, values in series.items()} | {
        "units": {valid[name]: unit for name, unit in units(run).items()},
        "names": {valid[name]: name for name in series},
        "metadata": told,
        "events": events,
    }
    try:
        with path.open("wb") as file:
            savemat(file, everything, long_field_names=True, do_compression=True, oned_as="column")
            file.seek(0)  # SciPy's heading holds the date, which would make each file another one
            file.write(f"MATLAB 5.0 MAT-file by {told['version']}".encode().ljust(116)[:116])
    except MatWriteError as error:
        raise InputError(f"a .mat file cannot hold this run ({error}): save as .npz or .parquet") from None


def matlab_names(names: Iterable[str], *, matlab_name_length: int = 63) -> list[str]:
    """Return names as MATLAB accepts them: ASCII letters, digits and underscores after a letter, each another one.

    ``matlab_name_length``: maximum length of a name in MATLAB.

    Examples
    --------
    >>> matlab_names(["x", "v_x", "θ", "theta", "1 a", "end", "units"])
    ['x', 'v_x', 'theta', 'theta_2', 'x1_a', 'end_2', 'units_2']
    """
    taken, found = set(MATLAB_OWN), []
    for name in names:
        plain = re.sub(r"\W", "_", "".join(map(_ascii, name)), flags=re.ASCII)
        plain = plain if plain[:1].isalpha() else f"x{plain}"
        plain = valid = plain[: matlab_name_length - 7]
        number = 1
        while valid in taken:
            number += 1
            valid = f"{plain}_{number}"
        taken.add(valid)
        found.append(valid)
    return found


def _ascii(letter: str) -> str:
    """Return a Greek letter by its name, and any other as it is."""
    words = unicodedata.name(letter, "").split()
    if words[:1] != ["GREEK"] or "LETTER" not in words:
        return letter
    name = words[words.index("LETTER") + 1].lower()
    return name if "SMALL" in words else name.capitalize()


WRITERS: dict[str, Callable[..., None]] = {
    ".csv": _write_csv,
    ".npz": _write_npz,
    ".nc": _write_netcdf,
    ".parquet": _write_parquet,
    ".mat": _write_matlab,
    ".xlsx": _write_excel,
}
"""Ending to the function that writes a run to the `companions` and the file itself."""
