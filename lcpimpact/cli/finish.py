"""The end of a command: output files and the summary."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lcpimpact.cli.options import files
from lcpimpact.cli.output import print_answer
from lcpimpact.files import Json, check_outputs, escape_cell, whole_file

if TYPE_CHECKING:
    from pandas import DataFrame

    from lcpimpact.problems.base import Problem
    from lcpimpact.schemefile import Run
    from lcpimpact.study.result import Study

TABLES = (".csv", ".tex")
SCHEME = ".toml"


def check_study(
    inputs: Iterable[str | Path],
    tables: Iterable[Path | None],
    plot: Path | None,
    report: Path | None,
    forms: tuple[str, ...] = TABLES,
) -> None:
    """Check, before any computation, that the files of a study can be written; ``forms`` are the endings of its tables."""
    from lcpimpact.plotting.style import METADATA as DRAWN_AS
    from lcpimpact.report.report import ENDINGS

    check_outputs((*((table, forms) for table in tables), (plot, DRAWN_AS), (report, ENDINGS)), files(*inputs))


def finish(
    result: Study,
    out: Path | None,
    plot: Path | None,
    report: Path | None,
    *,
    more: Iterable[tuple[Callable[[], DataFrame], Path | None]] = (),
    scheme: tuple[Problem, Run] | None = None,
    drawn: Mapping[str, bool] | None = None,
    said: Iterable[str] = (),
    data: Mapping[str, Json] | None = None,
) -> None:
    """Write the requested tables, picture and report, and print the summary and the names of the files.

    Parameters
    ----------
    result : Study
    out, plot, report : Path or None
        The files, or None.
    more : iterable of (callable, Path or None)
        Functions that return further tables of the study, with their files.
    scheme : (Problem, Run), optional
        Contents of ``out`` if it ends in .toml.
    drawn : mapping, optional
        Options of the picture.
    said : iterable of str
        Lines to print after the summary.
    data : mapping, optional
        Further data that --json prints.
    """
    lines, written = [result.summary(), *said], [out, plot, report]
    if out is not None and scheme is not None and out.suffix == SCHEME:
        from lcpimpact.schemefile import write_scheme_file

        problem, run = scheme
        lines.append(f"wrote {write_scheme_file(problem, out, run)}")
    elif out is not None:
        lines.append(write_table(result.table, out))
    for table, path in more:
        if path is not None:
            lines.append(write_table(table(), path))
            written.append(path)
    if plot is not None:
        result.plot(plot, **drawn or {})
        lines.append(f"drew {plot}")
    if report is not None:
        lines.append(f"wrote {result.report(report)}")
    print_answer(
        lines,
        lambda: {
            **(data or {}),
            "summary": result.summary().split("\n"),
            "table": result.table.to_dict("records"),
            "files": [path for path in written if path is not None],
        },
    )


def write_table(table: DataFrame, path: Path) -> str:
    """Write a table as CSV, or as a LaTeX table with the rules of booktabs, and return the line to print."""
    with whole_file(path) as part:
        if path.suffix == ".csv":
            words = {name: table[name].map(_cell) for name in table.columns if table[name].dtype.kind not in "fiub"}
            table.assign(**words).rename(columns=_cell).to_csv(part, index=False)
        else:
            text = table.to_latex(index=False, escape=True, float_format="%.3g", na_rep="-")
            part.write_text(text, encoding="utf-8")
    return f"wrote {path}"


def _cell(value: Any) -> Any:
    return escape_cell(value) if isinstance(value, str) else value
