"""Where the time of the tests goes: seconds by folder, the longest tests, and what was skipped because it is missing here.

    python -m pytest -n 2 --junitxml quick.xml
    python benchmarks/durations.py quick.xml [slow.xml ...] [--longest 25]

The times are those of the reports, set-up included; of tests that ran side by side they add up to more than the clock says.
"""

from __future__ import annotations

import argparse
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


def print_folders(run: list[Case]) -> None:
    """Print the seconds of each folder, the longest first."""
    seconds: dict[str, float] = defaultdict(float)
    for case in run:
        seconds[case.folder] += case.seconds
    tests = Counter(case.folder for case in run)
    print(f"{'seconds':>9} {'tests':>6}  folder")
    for folder, total in sorted(seconds.items(), key=lambda item: -item[1]):
        print(f"{total:9.1f} {tests[folder]:6}  {folder}")
    print(f"{sum(seconds.values()):9.1f} {len(run):6}  all")


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
    add_tiny(parser, longest=3)
    options = parser.parse_args()
    if not options.reports and not options.tiny:
        parser.error("name the reports that pytest --junitxml wrote")
    with TemporaryDirectory() as folder:
        if options.tiny:
            options.reports = [Path(folder) / "tiny.xml"]
            pytest.main([str(TINY), "-q", "-p", "no:cacheprovider", f"--junitxml={options.reports[0]}"])
        found = list(cases(options.reports))
    run = [case for case in found if not case.skipped]
    print_folders(run)
    print_longest(run, options.longest)
    print_skipped([case for case in found if case.skipped])
    return 0


if __name__ == "__main__":
    sys.exit(main())
