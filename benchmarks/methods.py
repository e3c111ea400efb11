r"""What a step of every method costs, and how far it is off.

    python benchmarks/methods.py [--steps 20000] [--repeats 5] [--out methods.csv]

Every registered method takes the same steps of the same problems; who refuses a problem is shown with a dash. Methods take
turns within each repeat, and medians are shown. Siconos takes part where it is installed for /usr/bin/python3, timed inside
its own process. The methods that find events follow a ball to its rest, beside SciPy's events in a loop by hand. The orders
of the methods are in the public table, ``benchmarks/table.py``.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import subprocess
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median

from conditions import print_conditions
from rich.console import Console
from rich.table import Table
from scipy.integrate import solve_ivp
from tiny import add_tiny

import lcpimpact as li
from lcpimpact.files import whole_file
from lcpimpact.integrators import METHODS
from lcpimpact.study.accuracy.norms import l1_v, sup_q

DEBIAN_PYTHON = Path("/usr/bin/python3")
PEER = Path(__file__).parent / "siconos_methods.py"
SLOWEST = 1.0
"""A method that needs longer than this many seconds takes fewer steps."""


def chain() -> li.Problem:
    """Ten masses on springs, shaken: smooth for ever."""
    elements: list[object] = [li.Spring("m0", "ground", 400.0), li.Load("m9", li.Harmonic(5.0, 3.0))]
    for i in range(10):
        elements.append(li.Mass(f"m{i}", 1.0))
        if i:
            elements += [li.Spring(f"m{i - 1}", f"m{i}", 400.0), li.Dashpot(f"m{i - 1}", f"m{i}", 0.5)]
    return li.Problem("ten masses", li.Scheme(*elements), t_end=3.0)


def column() -> li.Problem:
    """Six beads fall on each other and on the ground."""
    elements: list[object] = []
    for i in range(6):
        below = f"b{i + 1}" if i < 5 else "ground"
        m = 1.0 + 0.13 * i
        elements += [li.Mass(f"b{i}", m), li.Load(f"b{i}", 9.81 * m), li.Bumper(f"b{i}", below, 0.1, 0.4, name=f"R{i}")]
    return li.Problem("six beads", li.Scheme(*elements), t_end=0.25)


PROBLEMS = {
    "ten masses": (chain(), 3.0),
    "bouncing-ball": (li.load_problem("bouncing-ball"), 2.5),
    "six beads": (column(), 0.25),
    "system-1": (li.load_problem("system-1"), 3.0),
    "system-2": (li.load_problem("system-2"), 3.0),
    "hertz-impact": (li.load_problem("hertz-impact"), li.load_problem("hertz-impact").t_end),
    "spinning-ball": (li.load_problem("spinning-ball"), 3.0),
    "woodpecker": (li.load_problem("woodpecker"), 0.4),
}


def seconds(problem: li.Problem, method: str, t_end: float, steps: int) -> float:
    """Return the seconds of a run, with its record and certificate; a run that fails counts as for ever."""
    began = time.perf_counter()
    run = li.simulate(problem, method, dt=t_end / steps, t_end=t_end, progress=False, throw=False)
    return time.perf_counter() - began if run.success else float("inf")


def costs(steps: int, repeats: int) -> list[dict[str, object]]:
    """Return a row for each method and problem: µs a step, errors with 1,000 steps."""
    rows = []
    for what, (problem, t_end) in PROBLEMS.items():
        truth = None
        if "exact" in runnable(problem):
            truth = li.simulate(problem, "exact", dt=t_end / 1009, t_end=t_end)
        able = {}
        for method in runnable(problem):
            seconds(problem, method, t_end, 100)
            trial = seconds(problem, method, t_end, 1000)
            if trial < float("inf"):
                able[method] = max(100, min(steps, int(1000 * SLOWEST / trial)))
        samples: dict[str, list[float]] = {method: [] for method in able}
        for _ in range(repeats):
            for method, count in able.items():
                samples[method].append(1e6 * seconds(problem, method, t_end, count) / count)
        for method, count in able.items():
            run = li.simulate(problem, method, dt=t_end / 1009, t_end=t_end, progress=False)
            row: dict[str, object] = {
                "problem": what,
                "method": method,
                "steps": count,
                "µs a step": median(samples[method]),
            }
            row["LCPs a step"] = run.stats.get("lcp_solves", 0) / 1009
            row["sup q"] = sup_q(run, truth) if truth else float("nan")
            row["L1 v"] = l1_v(run, truth) if truth else float("nan")
            row["overlap"] = run.certificate.penetration
            rows.append(row)
    return rows


def runnable(problem: li.Problem) -> list[str]:
    """Return the methods that do not refuse a problem."""
    able = []
    for method in METHODS:
        try:
            li.simulate(problem, method, dt=1e-6, t_end=1e-6, progress=False)
        except li.UnsupportedError:
            continue
        able.append(method)
    return able


def siconos(steps: int) -> list[dict[str, object]]:
    """Return the rows of Siconos, or one that says why there is none."""
    if not DEBIAN_PYTHON.exists():
        print(f"skipped: Siconos, as there is no {DEBIAN_PYTHON}")
        return []
    data = {
        "steps": min(steps, 20_000),
        "t_end": 2.5,
        "rough": [rough(name) for name in ("spinning-ball", "woodpecker")],
    }
    done = subprocess.run([DEBIAN_PYTHON, PEER, json.dumps(data)], capture_output=True, text=True, timeout=300)
    if done.returncode != 0:
        print(f"skipped: Siconos: {(done.stderr.strip().splitlines() or ['no reason given'])[-1]}")
        return []
    return [dict(row) for row in json.loads(done.stdout.splitlines()[-1])]


def rough(name: str) -> dict[str, object]:
    """Return the matrices of a problem with friction; in H each normal row stands before that of its friction."""
    problem, t_end = PROBLEMS[name]
    d = problem.dynamics
    tangents, normals, mu = d.friction
    rows = [i for pair in zip(normals, tangents, strict=True) for i in pair]
    vectors = {
        "f": d.force(0.0), "q": problem.initial_coordinates, "v": problem.initial_velocities, "e": d.restitution[normals],
        "mu": mu,
    }  # fmt: skip
    matrices = {"M": d.M, "C": d.C, "K": d.K, "H": d.H[rows], "gaps": d.u0[rows].reshape(-1, 2)}
    numbers = {key: each.tolist() for key, each in (vectors | matrices).items()}
    return {"name": name, "t_end": t_end} | numbers


def by_hand(height: float, e: float, g: float) -> int:
    """Follow a ball to its rest by SciPy's events, as a user would, and return the number of impacts."""

    def ground(t: float, y: list[float]) -> float:
        return y[0]

    ground.terminal, ground.direction = True, -1.0  # type: ignore[attr-defined]
    t, y, impacts = 0.0, [height, 0.0], 0
    while True:
        flight = solve_ivp(lambda t, y: [y[1], -g], (t, 10.0), y, events=ground, rtol=1e-10, atol=1e-12)
        t, speed = float(flight.t[-1]), -e * float(flight.y[1, -1])
        impacts += 1
        if 2.0 * speed / g < 1e-9:
            return impacts
        y = [0.0, speed]


def to_rest(repeats: int) -> list[dict[str, object]]:
    """Return the milliseconds from the problem to the rest of a ball with e = 0.8, over 5 s."""
    problem = li.load_problem("bouncing-ball")
    height, e, g = problem.parameters["H"], problem.parameters["e"], problem.parameters["g"]
    contestants = {
        "exact": lambda: seconds(problem, "exact", 5.0, 500),
        "event-driven": lambda: seconds(problem, "event-driven", 5.0, 500),
        "SciPy's events by hand": lambda: _timed(lambda: by_hand(height, e, g)),
    }
    samples: dict[str, list[float]] = {name: [] for name in contestants}
    for _ in range(4 * repeats):
        for name, run in contestants.items():
            samples[name].append(1e3 * run())
    return [
        {"problem": what, "method": name, "ms to rest": each(found)}
        for name, found in samples.items()
        for what, each in (("least", min), ("median", median))
    ]


def _timed(run: Callable[[], object]) -> float:
    began = time.perf_counter()
    run()
    return time.perf_counter() - began


def show(title: str, rows: list[dict[str, object]], key: str) -> None:
    """Print a table with one line a method and one column a problem."""
    table = Table(title=title)
    table.add_column("method")
    problems = list(dict.fromkeys(str(row["problem"]) for row in rows))
    for problem in problems:
        table.add_column(problem, justify="right")
    for method in dict.fromkeys(str(row["method"]) for row in rows):
        cells = []
        for problem in problems:
            found = [row for row in rows if row["problem"] == problem and row["method"] == method]
            if not found or found[0].get(key) is None:
                cells.append("-")
            else:
                cells.append(f"{found[0][key]:.3g}")
        table.add_row(method, *cells)
    Console(width=160).print(table)


def main() -> None:
    """Measure, show and write."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else "")
    parser.add_argument("--steps", type=int, default=20_000)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--out", type=Path)
    add_tiny(parser, steps=200, repeats=1)
    chosen = parser.parse_args()
    ball = li.load_problem("bouncing-ball")
    whole = partial(li.simulate, ball, dt=ball.t_end / chosen.steps)
    print_conditions({f"simulate, bouncing ball, {chosen.steps:,} steps": whole})
    rows = costs(chosen.steps, chosen.repeats) + siconos(chosen.steps)
    show("µs a step, with record and certificate", rows, "µs a step")
    show("LCPs a step", rows, "LCPs a step")
    show("sup |q - exact| with 1009 steps, m", rows, "sup q")
    show("∫ |v - exact| dt with 1009 steps, m", rows, "L1 v")
    show("greatest overlap with 1009 steps, m", rows, "overlap")
    show("ms until a ball with e = 0.8 rests", to_rest(chosen.repeats), "ms to rest")
    if chosen.out:
        names = list(dict.fromkeys(name for row in rows for name in row))
        with whole_file(chosen.out) as part, part.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, names)
            writer.writeheader()
            writer.writerows(rows)


if __name__ == "__main__":
    os.environ.setdefault("LCPIMPACT_COMPILE", "first")  # compiled code is measured
    main()
