r"""What others get: twelve problems of the registry by lcpimpact, Siconos, SciPy, and others within reach of a Python user.

    python benchmarks/others.py [--only NAME] [--out FILE.csv]

Each contestant is written as its own tutorials write it (`others_*.py`, one file each), at default settings and tuned
for accuracy. Its motion is compared with the closed form, or with `exact` where there is none: sup |q - q*|, the L1 norm of
the error of v, and the error of the quantity that a user would ask for. The time is the median CPU time of the whole, from
the building of the model to the arrays of the result, without imports, and for lcpimpact without compilation.

What is missing on a machine, and what a contestant cannot do, is a row with its reason. A run of everything writes
benchmarks/others.csv and docs/benchmarks/others.md; ``--only`` takes a problem or a contestant, and prints.
"""

from __future__ import annotations

import argparse
import importlib
import os
import statistics
import sys
import time
import warnings
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import Any

import pandas as pd
from others_page import page
from others_problems import CASES, Case, Motion
from table import conditions
from tiny import add_tiny

from lcpimpact.files import whole_file

CSV = Path(__file__).parent / "others.csv"
PAGE = Path(__file__).parent.parent / "docs" / "benchmarks" / "others.md"

CONTESTANTS = {
    "lcpimpact": "others_lcpimpact",
    "Siconos": "others_siconos",
    "SciPy, events": "others_scipy",
    "SciPy, penalty": "others_penalty",
    "MuJoCo": "others_mujoco",
    "Pymunk": "others_pymunk",
    "nosnoc": "others_nosnoc",
    "heyoka.py": "others_heyoka",
    "PathSim": "others_pathsim",
    "solve-nivp": "others_solve_nivp",
    "Exudyn": "others_exudyn",
}
"""The file of each contestant: `settings(title)` returns its runs, `ABSENT` why it has none."""

REPEATS, BUDGET = 5, 2.0
"""A run is timed so often, or until it has taken so many seconds."""


def module(contestant: str) -> tuple[ModuleType | None, dict[str, str], str]:
    """Return the contestant's file and versions, or why it is not here."""
    try:
        found = importlib.import_module(CONTESTANTS[contestant])
        versions = found.versions() if hasattr(found, "versions") else {name: version(name) for name in found.VERSIONS}
    except ModuleNotFoundError as missing:
        return None, {}, f"{missing.name} is not installed (pip install lcpimpact[peers])"
    except RuntimeError as missing:
        return None, {}, str(missing)
    return found, versions, ""


def timed(run: Any) -> tuple[Motion, float]:
    """Return the motion, and the median CPU seconds of the runs after the first; who measures itself is believed."""
    found, seconds = run(), []
    if found.seconds is not None:
        return found, found.seconds
    while len(seconds) < REPEATS and sum(seconds) < BUDGET:
        began = time.process_time()
        run()
        seconds.append(time.process_time() - began)
    return found, statistics.median(seconds)


def judged(case: Case, how: str, run: Any) -> dict[str, Any]:
    """Return the row of one run."""
    row: dict[str, Any] = {"how": how, "scale": case.scale, "true": case.value}
    try:
        found, seconds = timed(run)
    except RuntimeError as failure:
        return {**row, "reason": str(failure)}
    if found.t[-1] < case.t_end * (1.0 - 1e-6):
        return {**row, "reason": f"ends at t = {found.t[-1]:.4g} s"}
    sup_q, l1_v, asked_error = case.errors(found)
    errors = {"sup_q": sup_q, "l1_v": l1_v, "asked": case.quantity(found), "asked_error": asked_error}
    return {**row, **errors, "ms": 1e3 * seconds, "reason": ""}


COLUMNS = [
    *("problem", "contestant", "setting", "how", "sup_q", "l1_v", "asked", "asked_error", "true", "scale", "ms"),
    "reason",
]


def measure(only: str | None) -> tuple[pd.DataFrame, dict[str, str]]:
    """Return all rows, or those of one problem or contestant, and the versions of who took part."""
    rows, all_versions = [], {}
    for contestant in CONTESTANTS:
        if only in CONTESTANTS and contestant != only:
            continue
        entry, versions, missing = module(contestant)
        all_versions.update(versions)
        for title, case in CASES.items():
            if only in CASES and title != only:
                continue
            absent = missing or getattr(entry, "ABSENT", {}).get(title, "")
            if absent or entry is None:
                rows.append({"problem": title, "contestant": contestant, "reason": absent})
                continue
            for setting, (how, run) in entry.settings(title).items():
                print(f"{contestant}: {title}, {setting}", file=sys.stderr)
                row = judged(case, how, run)
                rows.append({"problem": title, "contestant": contestant, "setting": setting, **row})
    table = pd.DataFrame(rows, columns=COLUMNS)
    order = {title: place for place, title in enumerate(CASES)}
    return table.sort_values("problem", key=lambda names: names.map(order), kind="stable"), all_versions


def main() -> int:
    """Measure; write the CSV and the page, or print what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else "")
    parser.add_argument("--only", help="a problem or a contestant: " + ", ".join([*CASES, *CONTESTANTS]))
    parser.add_argument("--out", type=Path, help="the CSV file")
    add_tiny(parser, only="filippov")
    chosen = parser.parse_args()
    if chosen.only is not None and chosen.only not in {*CASES, *CONTESTANTS}:
        parser.error(
            f"--only {chosen.only}: neither a problem nor a contestant; take one of "
            + ", ".join([*CASES, *CONTESTANTS])
        )
    warnings.simplefilter("ignore")
    began = time.perf_counter()
    table, versions = measure(chosen.only)
    text = conditions(time.perf_counter() - began, 1, versions) + "\n" + table.to_csv(index=False, float_format="%.6g")
    if chosen.only is not None:
        print(table.drop(columns=["scale", "true"]).to_string(index=False))
    out = chosen.out or (CSV if chosen.only is None else None)
    written = [] if out is None else [(out, text)]
    if chosen.only is None and chosen.out is None:
        written.append((PAGE, page(text)))
    for path, content in written:
        with whole_file(path) as part:
            part.write_text(content, encoding="utf-8")
    return 0


if __name__ == "__main__":
    os.environ.setdefault("LCPIMPACT_COMPILE", "first")  # compiled code is measured
    sys.exit(main())
