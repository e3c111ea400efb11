"""How far the estimated error of a run is from the truth.

    python benchmarks/errors.py [--schemes 500] [--methods moreau-jean,radau] [--out errors.csv]

Each method takes the registered problems and random schemes that it and `exact` both handle, at dt = T/200. The error of
the coordinate that is off most, by halving, is divided by that against `exact`: a run counts as within where the ratio
lies between a third and three; the same of the velocity that is off most. Misses, each with its problem, are listed. What is
off by more than a tenth of the range of its motion shall be called coarse, and the dt named then shall do. A truth that
takes longer than ``--seconds`` is left out, and named.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator

import pandas as pd
from random_schemes import frictional, random_problem
from tiny import add_tiny

import lcpimpact as li
from lcpimpact.integrators import METHODS
from lcpimpact.problems import PROBLEMS
from lcpimpact.record import Grid
from lcpimpact.run_error import COARSE, RunError
from lcpimpact.simulation import methods_that_take, run_within
from lcpimpact.study.accuracy.error_of_run import AGREEMENT_RTOL, POINTS, error_against

JUDGED = "moreau-jean,newmark-ns,rattle-ns,generalized-alpha,schatzman-paoli,radau,rk4"

STEPS = 200

CLOSE = 3.0
"""Ratio of estimate and truth, or of truth and estimate, that counts as within."""

SMALL, LARGE = "too small", "too large"


def problems(schemes: range, registered: int) -> Iterator[li.Problem]:
    """Yield registered problems and random schemes, every second of them with friction."""
    for name in list(PROBLEMS)[:registered]:
        yield li.load_problem(name)
    for seed in schemes:
        try:
            yield random_problem(seed) if seed % 2 else frictional(seed)
        except li.InputError:  # an impulse through a node without mass
            continue


def truth_of(problem: li.Problem, seconds: float) -> li.Trajectory | str:
    """Return the exact motion of a problem, or why there is none."""
    try:
        truth = run_within(problem, METHODS["exact"](), Grid(problem.t_end, POINTS), seconds)
    except li.UnsupportedError:
        return "refused"
    except li.LcpImpactError:
        return "failed"
    return truth if truth.success else "slow" if truth.status is li.Status.INTERRUPTED else "failed"


def judged(problem: li.Problem, truth: li.Trajectory, method: str) -> dict[str, object]:
    """Return the estimate of a run, by halving, beside its error; NaN where the run fails, or the estimate is not known."""
    row: dict[str, object] = {"problem": problem.name, "method": method}
    run = li.simulate(problem, method, dt=problem.t_end / STEPS, throw=False, progress=False, error=False)
    if not run.ended:
        nothing = dict.fromkeys(("relative", "truth", "estimate", "named"), math.nan)
        return row | nothing | {"column": "", "found": "failed", "velocity": "failed", "reason": run.status.name}
    actual, found = error_against(run, truth), run.estimate_error("halving")
    name, relative = actual.worst
    row |= {"column": name, "relative": relative, "truth": actual[name], "estimate": found[name]}
    velocity = f"v_{max(run.nodes, key=lambda node: actual.relative[f'v_{node}'])}"
    return row | {
        "named": off_at(problem, truth, method, found.dt) if found.coarse else math.nan,
        "found": verdict(found, actual, name),
        "velocity": verdict(found, actual, velocity),
        "reason": found.reason,
    }


def off_at(problem: li.Problem, truth: li.Trajectory, method: str, dt: float) -> float:
    """Return the relative error with the step that a coarse run is told to take, infinite where it is told none."""
    if math.isnan(dt):
        return math.inf
    run = li.simulate(problem, method, dt=dt, throw=False, progress=False, error=False)
    return error_against(run, truth).worst[1] if run.ended else math.inf


def verdict(found: RunError, actual: RunError, name: str) -> str:
    """Return whether the estimated error of a column is that against the truth, to a factor of three."""
    if not found.known:
        return "unknown"
    rounding = AGREEMENT_RTOL * actual.ranges[name]
    estimate, truth = (max(each[name], rounding) for each in (found, actual))
    return SMALL if CLOSE * estimate < truth else LARGE if estimate > CLOSE * truth else "within"


def main() -> None:
    """Print the table and the misses."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--schemes", type=int, default=500, help="number of random schemes")
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    parser.add_argument("--registered", type=int, default=len(PROBLEMS), help="number of registered problems")
    parser.add_argument("--methods", default=JUDGED)
    parser.add_argument("--seconds", type=float, default=30.0, help="longest time for the exact motion")
    parser.add_argument("--out", help="name of a .csv with each run")
    add_tiny(parser, schemes=2, registered=2, methods="moreau-jean,rk4")
    given = parser.parse_args()
    rows: list[dict[str, object]] = []
    left_out: dict[str, list[str]] = {}
    for problem in problems(range(given.first, given.first + given.schemes), given.registered):
        truth = truth_of(problem, given.seconds)
        if isinstance(truth, str):
            left_out.setdefault(truth, []).append(problem.name)
            continue
        for method in methods_that_take(problem, given.methods.split(",")):
            rows.append(judged(problem, truth, method))
        if given.out:
            pd.DataFrame(rows).to_csv(given.out, index=False)
    for why, names in left_out.items():
        print(f"exact {why}: {len(names)} ({', '.join(names)})")
    summarize(pd.DataFrame(rows))


def summarize(runs: pd.DataFrame) -> None:
    """Print how many runs of each method are within, and each miss."""
    ended = runs[runs["found"] != "failed"]
    table = [
        {
            "method": method,
            "runs": len(of),
            "within a factor of 3": f"{(of['found'] == 'within').mean():.1%}",
            SMALL: int((of["found"] == SMALL).sum()),
            LARGE: int((of["found"] == LARGE).sum()),
            "unknown": int((of["found"] == "unknown").sum()),
            "velocity within 3": f"{(of['velocity'] == 'within').mean():.1%}",
            "off by 10 %": int((of["relative"] > COARSE).sum()),
            "called coarse": int(((of["relative"] > COARSE) & of["named"].notna()).sum()),
            "the dt named does": f"{int((of['named'] <= COARSE).sum())} of {of['named'].count()}",
        }
        for method, of in [*ended.groupby("method", sort=False), ("all", ended)]
    ]
    print(pd.DataFrame(table).to_string(index=False))
    for _, run in runs[runs["found"] != "within"].iterrows():
        numbers = f"{run['estimate']:.2g} for {run['truth']:.2g}"
        print(
            f"{run['found']}: {run['problem']} by {run['method']}: {numbers} ({run['relative']:.1e}), {run['reason']}"
        )


if __name__ == "__main__":
    main()
