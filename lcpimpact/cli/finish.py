"""The end of a command: output files and the summary."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from lcpimpact.cli.options import files
from lcpimpact.cli.output import DECIMAL, print_answer
from lcpimpact.files import Json, check_outputs, whole_file

if TYPE_CHECKING:
    from pandas import DataFrame

    from lcpimpact.study.result import Study

TABLES = (".csv", ".tex", ".xlsx")


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
    from lcpimpact.run_files import check_format

    written = list(tables)
    check_outputs((*((table, forms) for table in written), (plot, DRAWN_AS), (report, ENDINGS)), files(*inputs))
    for table in written:
        if table is not None:
            check_format(table)


def finish(
    result: Study,
    out: Path | None,
    plot: Path | None,
    report: Path | None,
    *,
    more: Iterable[tuple[Callable[[], DataFrame], Path | None]] = (),
    writers: Mapping[str, Callable[[Path], Path | None]] | None = None,
    drawn: Mapping[str, bool] | None = None,
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
    writers : mapping of str to callable, optional
        Functions that write ``out``, by its ending, where that is none of a table.
    drawn : mapping, optional
        Options of the picture.
    data : mapping, optional
        Further data that --json prints.
    """
    summary = result.summary()
    lines, written = [summary], [out, plot, report]
    if out is not None and writers and out.suffix in writers:
        writers[out.suffix](out)
        lines.append(f"wrote {out}")
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
            "summary": summary.split("\n"),
            "table": result.table.to_dict("records"),
            "files": [path for path in written if path is not None],
        },
    )


def write_table(table: DataFrame, path: Path) -> str:
    """Write a table as CSV, as a workbook or as a LaTeX table with the rules of booktabs, and return the line to print."""
    from lcpimpact.run_files import write_csv, write_workbook

    header = [str(name) for name in table.columns]
    rows = table.astype(object).where(table.notna(), "").itertuples(index=False, name=None)
    with whole_file(path) as part:
        if path.suffix == ".csv":
            write_csv(part, header, rows, DECIMAL.get())
        elif path.suffix == ".xlsx":
            write_workbook(part, {"table": (header, rows)})
        else:
            text = table.to_latex(index=False, escape=True, float_format="%.3g", na_rep="-")
            part.write_text(text, encoding="utf-8")
    return f"wrote {path}"
