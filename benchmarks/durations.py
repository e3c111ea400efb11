"""Where the time of the tests goes: seconds by folder, the longest tests, and what was skipped because it is missing here.

    python -m pytest -n 2 --junitxml quick.xml
    python benchmarks/durations.py quick.xml [slow.xml ...] [--longest 25] [--out benchmarks/durations.csv]

The times are those of the reports, set-up included; of tests that ran side by side they add up to more than the clock says.
The file holds the seconds by report and folder, to compare with.
"""

from __future__ import annotations

import argparse
import csv
import re
import sys
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree import ElementTree

import pytest
from tiny import add_tiny

TINY = Path(__file__).parents[1] / "tests" / "test_formula.py"
"""The tests that ``--tiny`` runs for a report."""

MISSING = re.compile(r"\bneeds\b|install|import|not here", re.IGNORECASE)
"""What is said where a test is skipped because of the machine; other tests are skipped as they ask for what is refused."""


@dataclass(frozen=True)
class Case:
    """One test of a report.

    Attributes
    ----------
    module : str                    its module, as "tests.run.test_files", with the class where there is one
    name : str                      its name, with its parameters
    seconds : float                 its time, set-up included
    skipped : str                   why it did not run, "" if it did
    """

    module: str
    name: str
    seconds: float
    skipped: str

    @property
    def folder(self) -> str:
        """The folder of its module."""
        parts = self.module.split(".")
        files = [i for i, part in enumerate(parts) if part.startswith("test_")]
        return "/".join(parts[: files[0] if files else -1]) or "."


def cases(reports: Iterable[Path]) -> Iterator[Case]:
    """Yield the tests of reports in the format of JUnit."""
    for report in reports:
        for each in ElementTree.parse(report).iter("testcase"):
            skip = each.find("skipped")
            said = "" if skip is None or skip.get("type") == "pytest.xfail" else skip.get("message", "no reason given")
            yield Case(each.get("classname", ""), each.get("name", ""), float(each.get("time", 0)), said)


def by_folder(run: Iterable[Case]) -> list[tuple[str, int, float]]:
    """Return the folders with their tests and seconds, the longest first."""
    found: dict[str, list[float]] = defaultdict(list)
    for case in run:
        found[case.folder].append(case.seconds)
    rows = [(folder, len(seconds), sum(seconds)) for folder, seconds in found.items()]
    return sorted(rows, key=lambda row: -row[2])


def print_folders(run: list[Case]) -> None:
    """Print the seconds of each folder."""
    print(f"{'seconds':>9} {'tests':>6}  folder")
    for folder, tests, seconds in [*by_folder(run), ("all", len(run), sum(case.seconds for case in run))]:
        print(f"{seconds:9.1f} {tests:6}  {folder}")


def write_folders(reports: Iterable[Path], out: Path) -> None:
    """Write the tests and seconds of each folder of each report."""
    with out.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["report", "folder", "tests", "seconds"])
        for report in reports:
            for folder, tests, seconds in by_folder(case for case in cases([report]) if not case.skipped):
                writer.writerow([report.stem, folder, tests, f"{seconds:.1f}"])


def print_longest(run: list[Case], count: int) -> None:
    """Print the tests that took longest."""
    print(f"\n{'seconds':>9}  the longest tests")
    for case in sorted(run, key=lambda case: -case.seconds)[:count]:
        print(f"{case.seconds:9.1f}  {case.module}::{case.name}")


def print_skipped(skipped: list[Case]) -> None:
    """Print how many tests were skipped for each thing that is missing here."""
    reasons = Counter(case.skipped for case in skipped if MISSING.search(case.skipped))
    print(f"\n{len(skipped)} tests skipped, {reasons.total()} of them for what is missing here")
    for reason, count in reasons.most_common():
        print(f"not tested: {count} tests: {' '.join(reason.split())}")


def main() -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("reports", type=Path, nargs="*", help="files that pytest --junitxml wrote")
    parser.add_argument("--longest", type=int, default=25, help="how many of the longest tests to print")
    parser.add_argument("--out", type=Path, help="CSV file for the seconds by report and folder")
    add_tiny(parser, longest=3)
    options = parser.parse_args()
    if not options.reports and not options.tiny:
        parser.error("name the reports that pytest --junitxml wrote")
    with TemporaryDirectory() as folder:
        if options.tiny:
            options.reports = [Path(folder) / "tiny.xml"]
            pytest.main([str(TINY), "-q", "-p", "no:cacheprovider", f"--junitxml={options.reports[0]}"])
        found = list(cases(options.reports))
        if options.out:
            write_folders(options.reports, options.out)
    run = [case for case in found if not case.skipped]
    print_folders(run)
    print_longest(run, options.longest)
    print_skipped([case for case in found if case.skipped])
    return 0


if __name__ == "__main__":
    sys.exit(main())
