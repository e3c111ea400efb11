"""What the runs of two states of the package find: every verdict, and the motion at the end.

    python benchmarks/verdicts.py --out before.json
    python benchmarks/verdicts.py --out after.json --against before.json
    python benchmarks/verdicts.py --read after.json --against before.json

Every method runs every registered problem, with a coarse and a fine step, and random schemes, half of them with friction,
with the coarse one. Of each run is kept its status, or the kind of error by which it is refused; of its certificate whether
each violation is within its limit, and whether impacts can gain energy; the number of events of each kind; and q, v and r
at the end with the largest |q|, |v| and |r| of the run.

With ``--against`` runs whose status, verdicts or events differ are listed by name; so are those whose q, v or r at the end,
or their largest values, differ by more than ``--tol`` relative to the largest |q|, |v| or |r|. ``--read`` compares what was
recorded earlier and runs nothing. The exit code is 1 if there is a difference, or if a run of the other file is missing.

Both states are run by the same script: ``PYTHONPATH`` says which package is meant, and its folder is printed.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import time
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from errors import problems
from rich.console import Console
from rich.table import Table
from tiny import add_tiny

import lcpimpact as li
from lcpimpact.integrators import METHODS
from lcpimpact.problems import PROBLEMS

COARSE, FINE = 100, 1000
"""Steps of a run."""

LARGE = 50
"""Number of nodes above which a problem takes the coarse step alone."""

TOL = 1e-11

PARTS = ("q", "v", "r")

Run = dict[str, Any]
Runs = dict[str, Run]


def found(problem: li.Problem, method: str, steps: int) -> Run:
    """Return what is kept of a run."""
    try:
        run = li.simulate(problem, method, dt=problem.t_end / steps, progress=False, throw=False, error=False)
    except li.LcpImpactError as error:
        return {"status": type(error).__name__}
    certificate = run.certificate
    violations = {name: bool(getattr(certificate, name) <= limit) for name, limit in certificate.limits.items()}
    series = {"q": run.q, "v": run.v, "r": run.reaction}
    return {
        "status": run.status.name,
        "verdicts": violations | {"impact gain": certificate.impact_gain.case},
        "events": dict(sorted(Counter(event.kind for event in run.events).items())),
        "end": {name: values[-1].tolist() if len(values) else [] for name, values in series.items()},
        "largest": {name: float(np.abs(values).max(initial=0.0)) for name, values in series.items()},
    }


def record(schemes: int, registered: int, methods: list[str]) -> Runs:
    """Return what is kept of all runs, by their names."""
    runs: Runs = {}
    for problem in problems(range(schemes), registered):
        known = problem.name in PROBLEMS
        counts = (COARSE, FINE) if known and len(problem.dynamics.nodes) <= LARGE else (COARSE,)
        for method in methods:
            for steps in counts:
                runs[f"{problem.name} by {method}, {steps} steps"] = found(problem, method, steps)
        print(f"\r{len(runs)} runs, {problem.name:<40}", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    return runs


def verdict_differences(run: Run, other: Run) -> list[str]:
    """Return in which status, verdicts and numbers of events a run differs from another, as "what: before -> now"."""
    said = []
    if run["status"] != other["status"]:
        said.append(f"status: {other['status']} -> {run['status']}")
    for what in ("verdicts", "events"):
        now, before = run.get(what, {}), other.get(what, {})
        names = [name for name in {**before, **now} if now.get(name) != before.get(name)]
        said += [f"{name}: {before.get(name)} -> {now.get(name)}" for name in names]
    return said


def value_difference(run: Run, other: Run) -> tuple[float, str]:
    """Return the largest difference of q, v and r, relative to their largest values, and which has it."""
    if "end" not in run or "end" not in other:
        return 0.0, ""
    each = [(relative(run, other, part), part) for part in PARTS]
    return max(each, key=lambda pair: pair[0])


def relative(run: Run, other: Run, part: str) -> float:
    """Return how far one part of a run is from that of another; infinite where it has other entries or no numbers."""
    now, before = (np.array([*each["end"][part], each["largest"][part]]) for each in (run, other))
    if now.shape != before.shape or (np.isfinite(now) != np.isfinite(before)).any():
        return math.inf
    off = np.abs(now - before)[np.isfinite(now)].max(initial=0.0)
    scale = max(run["largest"][part], other["largest"][part])
    return float(off / scale) if off > 0.0 else 0.0


def compare(runs: Runs, others: Runs, tol: float) -> int:
    """Print the differences of two records, and return their number."""
    missing = [name for name in others if name not in runs]
    both = [name for name in others if name in runs]
    changed = {name: said for name in both if (said := verdict_differences(runs[name], others[name]))}
    off = {name: value_difference(runs[name], others[name]) for name in both}
    far = {name: pair for name, pair in off.items() if pair[0] > tol}
    for name in missing:
        print(f"missing: {name}")
    for name, said in changed.items():
        print(f"verdict: {name}: {'; '.join(said)}")
    for name, (size, part) in sorted(far.items(), key=lambda item: -item[1][0]):
        print(f"values: {name}: {part} differs by {size:.1e} of its largest")
    largest = max((size for size, _ in off.values()), default=0.0)
    print(
        f"{len(both)} runs in both, {len(missing)} missing, {len(runs) - len(both)} new: {len(changed)} differ in their "
        f"verdicts, {len(far)} in their values by more than {tol:g}, the largest by {largest:.1e}"
    )
    return len(missing) + len(changed) + len(far)


def summary(runs: Runs) -> Table:
    """Return how the runs of each method ended."""
    statuses = Counter(run["status"] for run in runs.values())
    drawn = Table("method", *(status for status, _ in statuses.most_common()), title=f"{len(runs)} runs")
    for method in dict.fromkeys(name.rsplit(" by ", 1)[1].split(",")[0] for name in runs):
        mine = Counter(run["status"] for name, run in runs.items() if f" by {method}," in name)
        drawn.add_row(method, *(str(mine[status]) for status, _ in statuses.most_common()))
    return drawn


def main() -> int:
    """Record, print and compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--schemes", type=int, default=1000, help="number of random schemes")
    parser.add_argument("--registered", type=int, default=len(PROBLEMS), help="number of registered problems")
    parser.add_argument("--methods", default=",".join(METHODS))
    parser.add_argument("--out", type=Path, metavar="FILE", help="where to keep the record")
    parser.add_argument("--read", type=Path, metavar="FILE", help="a record to take in place of running")
    parser.add_argument("--against", type=Path, metavar="FILE", help="the record of another state")
    parser.add_argument("--tol", type=float, default=TOL)
    add_tiny(parser, schemes=2, registered=2, methods="moreau-jean,rk4")
    given = parser.parse_args()
    began = time.perf_counter()
    if given.read:
        runs = json.loads(given.read.read_text(encoding="utf-8"))
    else:
        warnings.simplefilter("ignore")
        runs = record(given.schemes, given.registered, given.methods.split(","))
        where = f"{Path(li.__file__).parent}, {time.perf_counter() - began:.0f} s"
        Console(width=None if sys.stdout.isatty() else 130).print(summary(runs), where)
    if given.out:
        given.out.write_text(json.dumps(runs, indent=0), encoding="utf-8")
    if given.against is None:
        return 0
    return int(compare(runs, json.loads(given.against.read_text(encoding="utf-8")), given.tol) > 0)


if __name__ == "__main__":
    os.environ.setdefault("LCPIMPACT_COMPILE", "first")  # thousands of runs repay it
    sys.exit(main())
