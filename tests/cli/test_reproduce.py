"""The reproduction: every stated tolerance can fail, and the whole runs from one command."""

import csv
import dataclasses
import os
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from html.parser import HTMLParser
from pathlib import Path
from threading import Event

import numpy as np
import pytest

from lcpimpact.problems.reference import KNOWN
from lcpimpact.reproduce import runs
from lcpimpact.reproduce.checks import Check, all_checks
from lcpimpact.reproduce.run import FIGURES
from lcpimpact.reproduce.runs import (
    Case,
    CaseResult,
    PaperRuns,
    all_cases,
    order_studies,
    run_all,
    run_case,
    switch_errors,
)
from lcpimpact.reproduce.tables import compared_with_rk4


@pytest.fixture(scope="module")
def found():
    """The runs without the slow QP runs at the smallest step."""
    cases = [case for case in all_cases() if not (case.lcp_solver.startswith("qp") and case.h < 1e-3)]
    return run_all(cases)


def test_cases_cover_what_is_promised():
    cases = all_cases()
    assert len(cases) == len(set(cases)) == 4 * 3 * (6 * 2 + 2)
    assert {case.method for case in cases} == {"moreau-jean", "rk4-paper", "exact"}


def test_figures_are_drawn_beside_the_runs_and_each_stage_is_a_line_of_a_file(monkeypatch, capsys):
    running, drawn = Event(), Event()

    def draw():
        assert running.wait(10.0)
        drawn.set()

    def run(case):
        running.set()
        return case, drawn.wait(10.0)

    monkeypatch.setattr(runs, "ProcessPoolExecutor", lambda workers, context: ThreadPoolExecutor(workers))
    monkeypatch.setattr(runs, "run_case", run)
    monkeypatch.setattr(runs, "observed_orders", lambda *study: study)
    monkeypatch.setattr(runs, "verdict", lambda label: label)
    cases = all_cases()[:3]
    assert run_all(cases, workers=1, meanwhile=draw).rows == tuple((case, True) for case in cases)
    lines = [line.split() for line in capsys.readouterr().err.splitlines()]
    done = {"runs": 3, "orders": len(order_studies()), "cross-validation": len(KNOWN)}
    assert [(line[0], line[-2]) for line in lines] == [(stage, f"{count}/{count}") for stage, count in done.items()]
    assert all(re.fullmatch(r"\d\d:\d\d", line[-1]) for line in lines)
    run_all(cases, workers=1, progress=False)
    assert capsys.readouterr().err == ""


@pytest.mark.slow
def test_every_tolerance_holds(found):
    checks = all_checks(found)
    assert len(checks) > 50
    assert [check for check in checks if not check.holds] == []


@pytest.mark.slow
def test_every_tolerance_can_fail(found):
    """Spoil each kind of figure; the checks on it must notice."""
    rows, orders = found.rows, found.orders

    def failing(**changes):
        return {check.what for check in all_checks(dataclasses.replace(found, **changes)) if not check.holds}

    spoilt = [
        {"rows": tuple(dataclasses.replace(row, sup_x=1.0) for row in rows)},
        {"rows": tuple(dataclasses.replace(row, sup_x=np.nan) for row in rows)},
        {"rows": tuple(dataclasses.replace(row, q_end=tuple(i + x for x in row.q_end)) for i, row in enumerate(rows))},
        {"rows": tuple(dataclasses.replace(row, failure="x") for row in rows)},
        {"rows": tuple(dataclasses.replace(row, certificate=(1.0, 1.0, 1.0, 1.0)) for row in rows)},
        {"orders": tuple(dataclasses.replace(each, x=1.5) for each in orders)},
        {"orders": tuple(dataclasses.replace(each, v=np.nan) for each in orders)},
        {"exact_errors": {label: dict.fromkeys(errors, 1.0) for label, errors in found.exact_errors.items()}},
        {"peaks": dict.fromkeys(found.peaks, 5000.0)},
        {"verdicts": {label: dataclasses.replace(each, resolution=np.nan) for label, each in found.verdicts.items()}},
    ]
    noticed = [failing(**changes) for changes in spoilt]
    assert all(noticed)
    assert set().union(*noticed) == {check.what for check in all_checks(found)} - {
        what for what in (check.what for check in all_checks(found)) if "R_2 / R_1" in what or "R_3 / R_2" in what
    }
    failed = tuple(CaseResult(row.case, failure="x") if row.case.lcp_solver == "pgs" else row for row in rows)
    assert {"runs that failed", "pgs ends where lemke ends, relative"} <= failing(rows=failed)
    swapped = dict(zip(found.peaks, [1.0, 2.0, 3.0, 4.0], strict=True))
    assert {what for what in failing(peaks=swapped) if "ranking" in what} == {
        check.what for check in all_checks(found) if "ranking" in check.what
    }


def test_a_check_of_nothing_does_not_hold():
    assert not Check("nothing was found", float("nan"), 1.0).holds
    assert Check("zero", 0.0, 0.0).holds


def test_a_failed_run_is_a_row():
    row = run_case(Case("System 1", "moreau-jean", (("theta", 0.5), ("max_iter", 1), ("tol", 1e-15)), "qp:osqp", 1e-2))
    assert "MAX_ITER" in row.failure or "max_iter" in row.failure
    assert np.isnan(row.sup_x)


def test_switches_are_paired_and_missing_ones_shown():
    import lcpimpact as li

    exact = li.simulate(li.load_problem("system-1"), "exact", dt=1e-2, t_end=3.0)
    damped = li.simulate(li.load_problem("system-1"), dt=1e-2, t_end=3.0, theta=1.0)
    errors, extra = switch_errors(damped, exact)
    assert extra == 0
    assert np.isnan(errors).tolist() == [False, False, True, True]
    assert switch_errors(exact, exact) == ((0.0, 0.0, 0.0, 0.0), 0)
    assert switch_errors(exact, damped)[1] == 2


def test_the_sentence_on_rk4_says_what_the_rows_show():
    """Rows with known errors: R errs more than by RK4 in one of three."""

    def pair(label, h, R, R_by_rk4):
        step = Case(label, "moreau-jean", (("theta", 0.5),), "lemke", h)
        return [
            CaseResult(step, 1e-6, 1e-6, R),
            CaseResult(Case(label, "rk4-paper", (), "auto", h), 1e-4, 1e-4, R_by_rk4),
        ]

    rows = [
        *pair("System 1", 1e-2, 1.0, 2.0),
        *pair("System 3", 1e-2, 1.0, 3.0),
        *pair("System 3", 1e-3, 6.2e-2, 3.5e-2),
    ]
    said = compared_with_rk4(PaperRuns(tuple(rows), ()))
    assert said == (
        "Of 3 rows, the θ = 1/2 step errs less than RK4 in x in 3, in x' in 3 and in R in 2 (not for System 3 with "
        "h = 0.001 s)."
    )
    assert "in R in 2" in compared_with_rk4(PaperRuns(tuple(rows[::-1]), ()))
    # What is not in the table is not counted.
    assert compared_with_rk4(PaperRuns(tuple(rows[:3]), ())).startswith("Of 1 rows")


class Page(HTMLParser):
    def __init__(self):
        super().__init__()
        self.sources, self.links, self.rows = [], [], 0

    def handle_starttag(self, tag, attributes):
        attributes = dict(attributes)
        self.sources += [attributes["src"]] if "src" in attributes else []
        self.links += [attributes["href"]] if "href" in attributes else []
        self.rows += tag == "tr"


@pytest.fixture
def written(tmp_path):
    """The folder that the command wrote, and what it said: now, or before into the folder REPRODUCED and its said.txt."""
    if "REPRODUCED" in os.environ:
        folder = Path(os.environ["REPRODUCED"])
        return folder, (folder / "said.txt").read_text(encoding="utf-8")
    out = tmp_path / "report"
    command = [sys.executable, "-c", "from lcpimpact.cli.main import main; main()", "reproduce", "--out", str(out)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=500, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    return out, run.stdout


@pytest.mark.slow
def test_the_command_writes_everything_and_exits_0(written):
    out, said = written
    assert "all hold" in said
    for text in FIGURES:
        assert (out / "figures" / f"figure-{text.number}.png").read_bytes().startswith(b"\x89PNG")
        assert "<svg" in (out / "figures" / f"figure-{text.number}.svg").read_text(encoding="utf-8")
    with (out / "cross-validation.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(all_cases())
    assert {row["system"] for row in rows} == {known.label for known in KNOWN}
    page = Page()
    page.feed((out / "report.html").read_text(encoding="utf-8"))
    assert len(page.sources) == 9
    assert all(source.startswith("data:") for source in page.sources)
    assert page.links == []
    assert page.rows > len(all_cases())
    for text in FIGURES:
        plain = re.sub(r"<[^>]*>|&[a-z]+;", "", text.caption)
        assert len(re.findall(r"[.](?:\s|$)", plain.replace("No. ", "No "))) == 2
