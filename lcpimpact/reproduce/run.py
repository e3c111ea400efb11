"""The reproduction: draw the figures, run the paper's systems, check the tolerances, write the report."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import pandas as pd

from lcpimpact.files import make_folder, whole_file
from lcpimpact.plotting.figures import figure_2, figure_3, force_figure, motion_figure
from lcpimpact.plotting.schematic import draw_scheme
from lcpimpact.plotting.style import save
from lcpimpact.problems import load_problem
from lcpimpact.report.report import Picture, Section, write_report
from lcpimpact.reproduce import tables
from lcpimpact.reproduce.checks import Check, all_checks
from lcpimpact.reproduce.runs import T_END, PaperRuns, run_all
from lcpimpact.reproduce.tables import Row
from lcpimpact.run_files import write_csv
from lcpimpact.simulation import simulate
from lcpimpact.study.progress import Progress, watched

LEAD = (
    "Systems 1, 2 and 3 of W. Grzesikiewicz and A. Zbiciak, by a small LCP in each step (moreau-jean), by the paper's own "
    "explicit RK4, and by an exact piecewise solution."
)


@dataclass(frozen=True)
class FigureText:
    """The caption of a figure: two sentences."""

    number: int
    group: str
    title: str
    caption: str


FIGURES = (
    FigureText(
        1,
        "schemes",
        "System No. 1",
        "System No. 1: the body hits, through a bumper, a plate on a Kelvin-Voigt structure. The plate z is massless and "
        "rests on a dashpot, so R has relative degree 1 and jumps to c<sub>o</sub> v<sub>o</sub> at first touch.",
    ),
    FigureText(
        2,
        "graphs",
        "The law of the bumper",
        "The graph of 0 &le; u &perp; R &ge; 0: open with no force, or closed with any pressure. It is no function of u, "
        "which is why each step solves an LCP instead of evaluating a force.",
    ),
    FigureText(
        3,
        "graphs",
        "Its differential succession",
        "The same corner between R and u', valid while u = 0: the plates stay in contact under pressure, or separate. It "
        "determines the next contact mode in the exact solution.",
    ),
    FigureText(
        4,
        "schemes",
        "System No. 2",
        "System No. 2: the body carries a spring whose lower end y touches the plate. The node y has neither mass nor "
        "dashpot, so R has relative degree 0 and is continuous.",
    ),
    FigureText(
        5,
        "schemes",
        "System No. 3",
        "System No. 3: a Kelvin-Voigt structure on both sides of the bumper. With Table 1 both have the same ratio k/c, so "
        "in contact they act as one; c = 60 N s/m in the tables has no such symmetry.",
    ),
    FigureText(
        6,
        "results",
        "R(t) of System 1",
        "The force in System 1, with LCP and RK4 at h = 0.01 s over the exact solution. It jumps at each closing and has "
        "the highest peak of the three.",
    ),
    FigureText(
        7,
        "results",
        "R(t) of System 2",
        "The force in System 2, with LCP and RK4 at h = 0.01 s over the exact solution. It starts from zero and is "
        "continuous, since a spring stands between the body and the bumper.",
    ),
    FigureText(
        8,
        "results",
        "R(t) of System 3",
        "The force in System 3, with LCP and RK4 at h = 0.01 s over the exact solution. Two dashpots in series soften the "
        "jump, and its peak is the lowest of the three.",
    ),
    FigureText(
        9,
        "results",
        "Motion of System 3",
        "The coordinates of System 3, positive downwards: body x, its lower end y, and plate z. In contact y and z are one "
        "curve; in flight each structure relaxes on its own.",
    ),
)


@dataclass(frozen=True)
class Reproduction:
    """The written files, and whether every stated tolerance holds.

    Attributes
    ----------
    report : Path
    found : PaperRuns
    checks : tuple of Check
    seconds : float
    """

    report: Path
    found: PaperRuns
    checks: tuple[Check, ...]
    seconds: float

    @property
    def holds(self) -> bool:
        """Whether every tolerance holds."""
        return all(check.holds for check in self.checks)


def draw(number: int, *, figure_step: float = 1e-2) -> Any:
    """Draw a figure of the paper.

    ``figure_step``: step in s of the runs in the figures: coarse enough to show the differences of the methods.
    """
    systems = {1: "system-1", 4: "system-2", 5: "system-3", 6: "system-1", 7: "system-2", 8: "system-3", 9: "system-3"}
    if number == 2:
        return figure_2()
    if number == 3:
        return figure_3()
    problem = load_problem(systems[number])
    if number in (1, 4, 5):
        return draw_scheme(problem.scheme)
    runs = [simulate(problem, each, dt=figure_step, t_end=T_END) for each in ("exact", "moreau-jean", "rk4-paper")]
    return motion_figure(*runs, number=number) if number == 9 else force_figure(*runs, number=number)


def reproduce(out: Path, *, workers: int | None = None, decimal: str = ".", progress: Progress = True) -> Reproduction:
    """Write every figure of the paper, the cross-validation tables and report.html to a folder.

    Parameters
    ----------
    out : Path
        The folder; it is made if it does not exist. Each file appears whole or not at all.
    workers : int, optional
        Processes; by default one a core.
    decimal : {".", ","}
        Decimal mark of the tables, as of `lcpimpact.run_files.write_csv`.
    progress : bool or callable
        As of `lcpimpact.study.progress`.

    Raises
    ------
    InputError
        If the folder cannot be made or written.
    """
    started = time.perf_counter()
    make_folder(out / "figures")

    def draw_figures() -> None:
        for text in watched(FIGURES, len(FIGURES), "figures", progress, stage=True):
            figure = draw(text.number)
            for suffix in (".png", ".svg"):
                save(figure, _figure_path(out, text.number, suffix))

    found = run_all(workers=workers, progress=progress, meanwhile=draw_figures)
    checks = tuple(sorted(all_checks(found), key=lambda check: check.holds))

    for name, header, rows in (
        ("cross-validation", tables.CROSS_VALIDATION_HEADER, tables.cross_validation_rows(found)),
        ("orders", tables.ORDERS_HEADER, tables.orders_rows(found)),
        ("tolerances", tables.CHECKS_HEADER, tables.checks_rows(checks)),
    ):
        with whole_file(out / f"{name}.csv") as part:
            write_csv(part, header, rows, decimal)
    report = out / "report.html"
    seconds = time.perf_counter() - started
    lead = LEAD + f" It took {seconds:.0f} s."
    title = "Modelling of impact problems using rheological schemes, reproduced"
    write_report(report, title, lead, _sections(out, found, checks))
    return Reproduction(report, found, checks, seconds)


def _figure_path(out: Path, number: int, suffix: str) -> Path:
    return out / "figures" / f"figure-{number}{suffix}"


def _sections(out: Path, found: PaperRuns, checks: tuple[Check, ...]) -> list[Section]:
    """Return the parts of the report."""
    failed = sum(not check.holds for check in checks)
    verdict = f"All {len(checks)} stated tolerances hold."
    if failed:
        verdict = (
            f"{failed} of the {len(checks)} stated tolerances do not hold; they are listed first in the last table."
        )
    degrees = [
        f"<li>{name}: {contact.sentence}</li>"
        for name, problem in (("System No. 1", "system-1"), ("System No. 2", "system-2"), ("System No. 3", "system-3"))
        for contact in load_problem(problem).dynamics.contacts
    ]
    return [
        Section("", verdict, verdict=not failed),
        Section("The systems", f"<ul>{''.join(degrees)}</ul>", _pictures(out, "schemes"), beside=True),
        Section("The law of the bumper", figures=_pictures(out, "graphs"), beside=True),
        Section("Forces and motion", figures=_pictures(out, "results")),
        *_report_tables(found, checks),
    ]


def _pictures(out: Path, group: str) -> list[Picture]:
    return [
        Picture(
            _figure_path(out, text.number, ".svg"),
            f"<b>Fig. {text.number}.</b> {text.caption}",
            text.title,
            f"figure-{text.number}",
        )
        for text in FIGURES
        if text.group == group
    ]


def _report_tables(found: PaperRuns, checks: tuple[Check, ...]) -> list[Section]:
    rows = tables.cross_validation_rows(found)
    shown = [row for row in rows if row[3] in ("lemke", "-") and row[1] != "exact"]
    return [
        _table(
            "Cross-validation",
            "Errors of the θ-step (with Lemke's method) and of the paper's RK4 against the exact solution; "
            "t<sub>1</sub> ... t<sub>4</sub> are errors of the switching times, and the mean error of R is its L1 error "
            f"over the length of the run, at the instants of the force (mid-step for θ = 1/2). "
            f"{tables.compared_with_rk4(found)} "
            f"{' '.join(f'{escape(line)}.' for verdict in found.verdicts.values() for line in verdict.head())}",
            tables.CROSS_VALIDATION_HEADER[:-5],
            [row[:-5] for row in shown],
            "cross-validation.csv",
        ),
        _table(
            "Peak forces",
            "The largest force is System 1's and the smallest System 3's, as the paper states. The exact peaks "
            "are found between the grid points; those of the step are means over a step.",
            tables.PEAKS_HEADER,
            tables.peaks_rows(found),
            "cross-validation.csv",
        ),
        _table(
            "Observed orders",
            "Least-squares slopes over twelve prime step counts from 307 to 49597, which no switch aligns with. "
            "θ = 1/2 keeps order 2 in x and x' across the switches, since only R jumps, while RK4 falls to order 1 "
            "(2 in System 2, whose force is continuous).",
            tables.ORDERS_HEADER,
            tables.orders_rows(found),
            "orders.csv",
        ),
        _table(
            "Every run",
            "All LCP solvers on all systems and steps, with the LCP residual, the penetration and the energy "
            "balance that each run certifies. The solvers give the same trajectory, so a difference between rows of one "
            "step is the solver's own accuracy.",
            tables.CROSS_VALIDATION_HEADER,
            rows,
            "cross-validation.csv",
            folded=True,
        ),
        _table(
            "Stated tolerances",
            "The reproduction counts as a success only if every line holds. The values were computed in this "
            "run; the limits are part of the program.",
            tables.CHECKS_HEADER,
            tables.checks_rows(checks),
            "tolerances.csv",
        ),
    ]


def _table(
    title: str, caption: str, header: Sequence[str], rows: Sequence[Row], file: str, *, folded: bool = False
) -> Section:
    text = f"{caption} The numbers are also in {file}."
    table = pd.DataFrame(rows, columns=[tables.HEADS.get(name, name) for name in header])
    formats = {tables.HEADS.get(name, name): form for name, form in tables.FORMATS.items()}
    return Section(title, text, table=table, form=".1e", formats=formats, folded=folded)
