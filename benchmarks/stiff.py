"""What stiff schemes cost by `exact`, beside SciPy's Radau at rtol 1e-10: rates from 1e3 to 1e12 times those of the motion.

    python benchmarks/stiff.py [--repeats 10] [--only "spring-pot"]

Ten schemes, with and without contacts. `exact` runs through `simulate`, with its record and certificate, the first time on a
new problem and again on the same, of which the second and the last run are shown; Radau follows the same X' = A X from event
to event, as far as it gets, with the modes that `exact` found, and locates the events by its own dense output. Times on a
processor, by whatever executor is at hand: compiled code with LCPIMPACT_COMPILE=first, the interpreter with
LCPIMPACT_COMPILE=never; the ratio is that of the median without the first. The exit code is 1 if a certificate fails, or
q or v at the end differ by more than 1e-7 of the largest |q| and |v|, and 0 otherwise.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from functools import partial
from statistics import median
from typing import Any

import numpy as np
from conditions import print_conditions
from rich.console import Console
from rich.table import Table
from scipy.integrate import solve_ivp
from tiny import add_tiny

import lcpimpact as li
from lcpimpact.arrays import Array
from lcpimpact.hybrid.event_loop import follow
from lcpimpact.hybrid.motion import begin_problem

STEPS = 500
RTOL, AGREES = 1e-10, 1e-7

POT = partial(li.SpringPot, "x", "ground", alpha=0.3, t_min=1e-5, t_max=4.0, rtol=1e-7)
TAU = tuple(10.0**k for k in range(-7, 2))
PAD = tuple(10.0**k for k in range(-6, 0))


def schemes() -> dict[str, li.Problem]:
    """Return the ten problems, each new."""
    mass, load = li.Mass("x", 1.0), li.Load("x", 9.81)

    def problem(name: str, t_end: float, *elements: Any, **start: dict[str, float]) -> li.Problem:
        return li.Problem(name, li.Scheme(*elements), t_end=t_end, **start)

    def rests_on(pad: Any) -> tuple[Any, ...]:
        """Return a mass that falls onto a massless plate on a pad."""
        return mass, load, li.Bumper("x", "y", gap=0.1, name="R"), pad

    found = [
        problem("spring-pot", 2.0, mass, POT(c_alpha=7.0), v0={"x": 1.0}),
        problem("Prony, 9 decades", 10.0, mass, li.GeneralizedMaxwell("x", "ground", 20.0, (5.0,) * 9, TAU), v0={"x": 1.0}),
        problem("Zener, arm of 0.1 µs", 5.0, mass, li.Zener("x", "ground", 30.0, 1e4, 1e-3), v0={"x": 1.0}),
        problem("1 g on a dashpot of 1e6", 5.0, li.Mass("x", 1e-3), li.KelvinVoigt("x", "ground", 1e6, 1e6), q0={"x": 1.0}),
        problem(
            "two masses and a dashpot of 1e9", 5.0, mass, li.Mass("y", 2.0), li.Dashpot("x", "y", 1e9),
            li.Spring("x", "ground", 50.0), li.Spring("y", "ground", 20.0), q0={"x": 0.1, "y": 0.1}, v0={"x": 1.0},
        ),
        problem(
            "chain of 6, dashpots 1e3 to 1e7", 5.0,
            li.Chain(6, m=1.0, k=100.0, c=(1e3, 1e4, 1e5, 1e6, 1e7), a=None, b=None), li.Spring("x.1", "ground", 50.0),
            v0={"x.1": 1.0},
        ),
        problem(
            "bar with a damped end", 2.0,
            li.Bar("a", "b", E=100.0, A=1.0, rho=1.0, L=1.0, elements=10), li.Dashpot("a", "ground", 1e7),
            li.Spring("a", "ground", 10.0), v0={"b": 1.0},
        ),
        li.load_problem("system-1", c_o=1e5),
        problem("falls on a Prony pad", 1.0, *rests_on(li.GeneralizedMaxwell("y", "ground", 2e3, (1e3,) * 6, PAD))),
        problem("falls on a spring-pot", 1.0, *rests_on(li.SpringPot("y", "ground", 200.0, 0.3, 1e-5, 2.0, 1e-5))),
    ]  # fmt: skip
    return {each.name: each for each in found}


def radau(problem: li.Problem) -> Callable[[], tuple[Array, Array]]:
    """Return a run of Radau from event to event, which returns q and v at the end."""
    known = begin_problem(problem, "exact", problem.t_end)
    follow(known, problem.t_end)
    pieces = [
        (known.system.mode(segment.mode)[0].A, segment.ended, segment.X, segment.before) for segment in known.segments
    ]
    rows = known.system.coordinates(known.segments[-1].mode).rows.hi
    n = len(problem.dynamics.nodes)
    scale = known.scale

    def event(t: float, X: Array, c: Array) -> float:
        return float(c @ X)

    def run() -> tuple[Array, Array]:
        t, X = 0.0, pieces[0][2]
        for k, (A, _, after, before) in enumerate(pieces):
            X = X + (after - before) if k else X
            falls: Any = partial(event, c=pieces[k + 1][1] if k + 1 < len(pieces) else np.zeros(len(X)))
            falls.terminal, falls.direction = True, -1.0
            found = solve_ivp(
                lambda t, X, A=A: A @ X, (t, problem.t_end), X, "Radau", jac=A, rtol=RTOL, atol=1e-12 * scale.max(),
                events=falls if k + 1 < len(pieces) else None,
            )  # fmt: skip
            t, X = float(found.t[-1]), found.y[:, -1]
        return rows[:n] @ X, rows[n : 2 * n] @ X

    return run


def seconds(call: Callable[[], Any]) -> tuple[float, Any]:
    """Return the time of a call on a processor, and what it returns."""
    began = time.process_time()
    found = call()
    return time.process_time() - began, found


def exact(problem: li.Problem) -> li.Trajectory:
    """Return the run by `exact`, with its certificate."""
    return li.simulate(problem, "exact", dt=problem.t_end / STEPS, progress=False, error=False, throw=False)


def main() -> int:
    """Measure, print, and return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--repeats", type=int, default=10, help="runs of exact")
    parser.add_argument("--only", default="", help="part of the names of the schemes to run")
    add_tiny(parser, repeats=1, only="1 g")
    options = parser.parse_args()
    print_conditions()
    drawn = Table(
        "", "nodes", "events", "first, ms", "second, ms", "tenth, ms", "Radau, ms", "over Radau", "differs by"
    )
    good = True
    for name, problem in schemes().items():
        if options.only not in name:
            continue
        took, runs = zip(*(seconds(partial(exact, problem)) for _ in range(max(2, options.repeats))), strict=True)
        again, run = median(took[1:]), runs[0]
        peer, (q, v) = seconds(radau(problem))
        off = max(np.abs(a[-1] - b).max() / np.abs(a).max() for a, b in ((run.q, q), (run.v, v)))
        good &= bool(off <= AGREES) and run.certificate.holds
        nodes = str(len(problem.dynamics.nodes))
        times = [f"{1e3 * each:.1f}" for each in (took[0], took[1], took[-1], peer)]
        said = "" if run.certificate.holds else " (certificate fails)"
        drawn.add_row(name, nodes, str(len(run.events)), *times, f"1/{peer / again:.1f}", f"{off:.1e}{said}")
    Console(width=None if sys.stdout.isatty() else 130).print(drawn)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
