"""What the exact solution costs: `exact` against DOP853 with hand-written events, impacts, a bifurcation diagram, and bars.

    python benchmarks/exact.py [--repeats 9] [--values 200]

Systems 1-3 on 0..3 s: the motion alone (again on the same problem, and on a new one), the same through `simulate` with its
record and certificate, and SciPy's DOP853 at rtol 1e-13 with the right side of each mode, its event and the next mode
written out by hand. Contestants take turns, in which the motion is followed ten times; medians of the time on a processor
are compared, and the diagram is timed by the clock. The exit code is 1 if they do not find the same motion, and 0
otherwise, whatever the speed.
"""

from __future__ import annotations

import argparse
import os
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

from lcpimpact import bifurcation, load_problem, simulate
from lcpimpact.arrays import Array
from lcpimpact.hybrid.event_loop import follow
from lcpimpact.hybrid.motion import HybridMotion, begin_problem, state_before
from lcpimpact.problems.base import Problem

T_END, DT = 3.0, 1e-3
RTOL = 1e-13
TIMES = 10
SYSTEMS = ("system-1", "system-2", "system-3")
BARS = ("bar-impact", "bouncing-bar")


def motion(problem: Problem, end: float) -> HybridMotion:
    """Return the exact motion to its end."""
    found = begin_problem(problem, "exact", end)
    follow(found, end)
    return found


def dop853(problem: Problem) -> Callable[[], Array]:
    """Return a run of DOP853 from event to event, which returns the state at the end.

    The one contact of Systems 1-3 opens where its force, and closes where its gap falls through zero.
    """
    known = motion(problem, T_END)
    modes = {}
    for segment in known.segments:
        flow, _ = known.system.mode(segment.mode)
        modes[segment.mode.closed] = flow.A, known.system.watch(segment.mode).rows.hi[0]
    first, start = known.segments[0].mode.closed, known.segments[0].X

    def event(t: float, X: Array, c: Array) -> float:
        return float(c @ X)

    def run() -> Array:
        t, X, closed = 0.0, start, first
        while True:
            A, c = modes[closed]
            falls: Any = partial(event, c=c)
            falls.terminal, falls.direction = True, -1.0
            found = solve_ivp(lambda t, X, A=A: A @ X, (t, T_END), X, "DOP853", events=falls, rtol=RTOL, atol=RTOL)
            t, X = float(found.t[-1]), found.y[:, -1]
            if found.status != 1:
                return np.asarray(X)
            closed = () if closed else (0,)

    return run


def seconds(call: Callable[[], Any], clock: Callable[[], float] = time.perf_counter) -> float:
    """Return the time of a call by a clock."""
    began = clock()
    call()
    return clock() - began


def turns(contestants: dict[str, Callable[[], Any]], repeats: int) -> dict[str, float]:
    """Return the median time on a processor of each contestant; they take turns."""
    took: dict[str, list[float]] = {name: [] for name in contestants}
    for _ in range(repeats + 1):
        for name, call in contestants.items():
            took[name].append(seconds(call, time.thread_time))
    return {name: median(each[1:]) for name, each in took.items()}


def systems_table(repeats: int) -> tuple[Table, bool]:
    """Return the table of Systems 1-3, and whether DOP853 finds the same motion."""
    drawn = Table(
        "", "DOP853, ms", "motion, ms", "over DOP853", "of a new problem, ms", "through simulate, ms", "over DOP853",
        title=f"0..{T_END:g} s, rtol {RTOL:g}, medians",
    )  # fmt: skip
    same = True
    for name in SYSTEMS:
        problem, peer = load_problem(name), dop853(load_problem(name))
        exact = state_before(motion(problem, T_END), T_END)
        same &= bool((np.abs(exact - peer()) <= 1e-9 * np.abs(exact).max()).all())
        fresh = [load_problem(name) for _ in range(repeats + 1)]
        for each in fresh:
            each.initial_coordinates, each.dynamics  # noqa: B018 (the scheme is assembled before)
        took = turns(
            {
                "peer": peer,
                "motion": lambda problem=problem: [motion(problem, T_END) for _ in range(TIMES)],
                "new": lambda fresh=fresh: motion(fresh.pop(), T_END),
                "simulate": lambda problem=problem: simulate(problem, "exact", dt=DT, t_end=T_END),
            },
            repeats,
        )
        took["motion"] /= TIMES
        peers, whole = took["peer"], took["simulate"]
        ratios = [f"1/{peers / each:.0f}" for each in (took["motion"], whole)]
        times = [f"{1e3 * took[each]:.2f}" for each in ("peer", "motion", "new", "simulate")]
        drawn.add_row(name, times[0], times[1], ratios[0], times[2], times[3], ratios[1])
    return drawn, same


def others_table(repeats: int, values: int, elements: int) -> Table:
    """Return the table of impacts, the bifurcation diagram and the bars."""
    drawn = Table("what", "median")
    ball = load_problem("bouncing-ball")
    impacts = sum(event.kind == "impact" for event in motion(ball, ball.t_end).events)
    took = turns({"ball": lambda: motion(ball, ball.t_end)}, repeats)
    drawn.add_row(f"bouncing ball, µs an impact ({impacts} of them)", f"{1e6 * took['ball'] / impacts:.1f}")

    def shaw_holmes(omega: float) -> Problem:
        return load_problem("shaw-holmes", omega=omega)

    over = np.linspace(2.5, 3.4, values)
    for workers in (1, os.cpu_count() or 1):
        call = partial(bifurcation, shaw_holmes, over, "impact", workers=workers, progress=False)
        drawn.add_row(f"bifurcation, {values} values, 250 impacts, {workers} threads, s", f"{seconds(call):.2f}")
    for name in BARS:
        bar = load_problem(name, elements=elements)
        motion(load_problem(name, elements=10), bar.t_end)
        drawn.add_row(
            f"{name} of {elements} elements, motion, s",
            f"{seconds(lambda bar=bar: motion(bar, bar.t_end), time.thread_time):.2f}",
        )
        bar = load_problem(name, elements=elements)
        call = partial(simulate, bar, "exact", dt=bar.t_end / 500)
        drawn.add_row(f"{name} of {elements} elements, through simulate, s", f"{seconds(call, time.thread_time):.2f}")
    return drawn


def main() -> int:
    """Measure, print, and return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--values", type=int, default=200)
    parser.add_argument("--elements", type=int, default=100, help="of the bars")
    add_tiny(parser, repeats=1, values=2, elements=10)
    options = parser.parse_args()
    whole = partial(simulate, load_problem("system-1"), "exact", dt=DT, t_end=T_END)
    print_conditions({f"simulate, System 1, {T_END:g} s by exact": whole})
    table, same = systems_table(options.repeats)
    console = Console()
    console.print(table)
    console.print(others_table(options.repeats, options.values, options.elements))
    return 0 if same else 1


if __name__ == "__main__":
    os.environ.setdefault("LCPIMPACT_COMPILE", "first")  # compiled code is measured
    sys.exit(main())
