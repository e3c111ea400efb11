r"""What a step costs: `simulate` against a C loop for System 1 alone, against Siconos; and what the import costs.

    python benchmarks/speed.py [--steps 1000000] [--repeats 7] [--out FILE.json|.csv]

Further tables time kernel and certificate apart on other problems, `PARTS`, and the steps of bars, `BARS`.

All run the θ-method with θ = 1/2 on System 1. Contestants take turns within each repeat, so that a slow minute of the
machine meets them all; medians are compared. `simulate` and the C loop record every step into arrays of their own, in
memory fresh from the system, and `simulate` also certifies the run. What cannot be measured here stays in the table,
with the reason. The exit code is 1 if the contestants do not find the same motion, and 0 otherwise, whatever the speed.
"""

from __future__ import annotations

import argparse
import csv
import ctypes
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from datetime import date
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any, TypeVar

import numpy as np
from conditions import print_conditions
from rich.console import Console
from rich.table import Table
from tiny import add_tiny

from lcpimpact import Problem, Trajectory, load_problem, simulate
from lcpimpact.arrays import Array
from lcpimpact.certificate import certify
from lcpimpact.events import events_of_steps
from lcpimpact.files import whole_file
from lcpimpact.integrators.base import Integrator
from lcpimpact.integrators.moreau_jean import MoreauJean
from lcpimpact.integrators.newmark_ns import NewmarkNS
from lcpimpact.integrators.stepping.banded_table import DENSE
from lcpimpact.numerics.banded import solve_banded
from lcpimpact.record import Grid, Record

T = TypeVar("T")
Samples = defaultdict[str, list[float]]

HERE = Path(__file__).parent
DEBIAN_PYTHON = Path("/usr/bin/python3")
DT = 3e-6
THETA = 0.5
SICONOS_STEPS, SICONOS_DT = 20_000, 1.5e-4
PARTS: tuple[tuple[str, Integrator, float], ...] = (
    ("system-1", MoreauJean(), 3.0),
    ("system-2", MoreauJean(), 3.0),
    ("bouncing-ball", MoreauJean(), 2.5),
    ("bouncing-ball", NewmarkNS(), 2.5),
    ("woodpecker", MoreauJean(), 1.0),
)
"""Problems and methods whose kernel and certificate are timed apart, each up to its t_end in s."""
PART_STEPS = 100_000
BARS = ("bar-impact", "bouncing-bar", "plastic-bar-impact")
"""Bars whose steps by banded equations are timed beside those by the dense table, and two sweeps over a band alone."""
BAR_STEPS = 20_000
IMPORTS = 15
PAUSE = 0.1
FIRST_CALL = """
import time
began = time.perf_counter()
from lcpimpact import load_problem, simulate
simulate(load_problem("system-1"), dt=1e-2, t_end=3.0)
print(time.perf_counter() - began)
"""


class MissingError(Exception):
    """A contestant that this machine does not have; the text says what to install."""


@dataclass(frozen=True)
class Row:
    """One line of a table.

    Attributes
    ----------
    what : str                      what was measured
    median : float or None          None where it could not be
    unit : str                      of the median; or why there is none
    ratio, to : float, str          the median over that of another row
    goal : str                      bound on the ratio, as "<= 10"
    reached : bool or None          whether the ratio keeps to the goal
    """

    what: str
    median: float | None
    unit: str
    ratio: float | None = None
    to: str = ""
    goal: str = ""
    reached: bool | None = None


@dataclass(frozen=True)
class Agreement:
    """The largest relative difference of two runs in x, v, z at the end and in max R, and what is allowed."""

    what: str
    difference: float
    allowed: float

    @property
    def holds(self) -> bool:
        """Whether they agree; a NaN does not."""
        return self.difference <= self.allowed


def settle() -> None:
    """Leave nothing of the last contestant: its BLAS threads spin until they sleep, and its pages are still at hand.

    Freed memory goes back to the system where the C library can do that, so that everyone touches new pages first.
    """
    time.sleep(PAUSE)
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


def timed(call: Callable[[], T]) -> tuple[float, T]:
    """Return the seconds of one call, and its result."""
    settle()
    began = time.perf_counter()
    result = call()
    return time.perf_counter() - began, result


def parameters(problem: Problem) -> dict[str, float]:
    """Return m, k_o, c_o, g and v_o."""
    return {name: problem.parameters[name] for name in ("m", "k_o", "c_o", "g", "v_o")}


def last_line(text: str) -> str:
    """Return what a failed program said last."""
    return (text.splitlines() or ["no message"])[-1]


def compiled_library(name: str, folder: Path, *options: str) -> ctypes.CDLL:
    """Compile NAME.c beside this file as a library."""
    compiler = shutil.which("gcc")
    if compiler is None:
        raise MissingError("gcc is not installed")
    library = folder / f"{name}.so"
    command = [compiler, "-O3", *options, "-shared", "-fPIC", "-o", str(library), str(HERE / f"{name}.c")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise MissingError(f"failed: {last_line(done.stderr)}")
    return ctypes.CDLL(str(library))


def c_loop(problem: Problem, folder: Path) -> Callable[[Array, float], Array]:
    """Compile system_1_floor.c; return (rows, h) -> rows, which fills rows (x, v, z, R), one for each step."""
    function = compiled_library("system_1_floor", folder).system_1
    function.argtypes = [ctypes.c_size_t, *[ctypes.c_double] * 7, ctypes.c_void_p]
    function.restype = None
    constants = parameters(problem).values()

    def run(rows: Array, h: float) -> Array:
        function(len(rows), h, THETA, *constants, rows.ctypes.data)
        return rows

    return run


def siconos(problem: Problem) -> dict[str, Any]:
    """Run siconos_system_1.py by the Python that Debian's Siconos belongs to."""
    data = {"steps": SICONOS_STEPS, "h": SICONOS_DT, "theta": THETA, **parameters(problem)}
    command = [str(DEBIAN_PYTHON), str(HERE / "siconos_system_1.py"), json.dumps(data)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    except FileNotFoundError:
        raise MissingError(f"no {DEBIAN_PYTHON}") from None
    except subprocess.TimeoutExpired:
        raise MissingError("no answer within 120 s") from None
    if "No module named 'siconos" in done.stderr:
        raise MissingError("not installed: apt-get install python3-siconos")
    if done.returncode != 0:
        raise MissingError(f"failed: {last_line(done.stderr)}")
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return result


def tried(call: Callable[[], T]) -> T | MissingError:
    """Return the result, or what is missing."""
    try:
        return call()
    except MissingError as reason:
        return reason


def child(code: str, **environment: str) -> str:
    """Run code in a fresh interpreter that may keep bytecode, as a user's does, and return what it prints."""
    inherited = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    done = subprocess.run(
        [sys.executable, "-c", code], env=inherited | environment, capture_output=True, text=True, check=True
    )
    return done.stdout


def measure_steps(problem: Problem, steps: int, repeats: int, loop: Any) -> tuple[Samples, Any]:
    """Let simulate, its parts, the C loop and Siconos take turns; return seconds, and the last answer of Siconos."""
    samples: Samples = defaultdict(list)
    t_end = steps * DT
    answer = tried(lambda: siconos(problem))
    for _ in range(repeats):
        samples["simulate"].append(timed(lambda: simulate(problem, dt=DT, t_end=t_end))[0])
        if not isinstance(loop, MissingError):
            for memory, seconds in both_memories(loop, steps, t_end / steps).items():
                samples[memory].append(seconds)
        for part, seconds in parts_of_simulate(problem, MoreauJean(theta=THETA), Grid(t_end, steps)).items():
            samples[part].append(seconds)
        if not isinstance(answer, MissingError):
            answer = siconos(problem)
            for key in ("mean", "median", "without_recording"):
                samples[f"siconos {key}"].append(answer[f"seconds_a_step_{key}"])
    return samples, answer


def both_memories(loop: Callable[[Array, float], Array], steps: int, h: float) -> dict[str, float]:
    """Return the seconds of the C loop with rows of its own, and with the same rows again."""
    fresh, rows = timed(lambda: loop(np.empty((steps, 4)), h))
    again, _ = timed(lambda: loop(rows, h))
    return {"C loop": fresh, "C loop again": again}


def parts_of_simulate(problem: Problem, integrator: Integrator, grid: Grid) -> dict[str, float]:
    """Return the seconds of the parts that simulate is made of, each on its own."""
    dynamics = problem.dynamics
    n, nc = len(dynamics.nodes), len(dynamics.contacts)
    rows = grid.steps + 1

    def allocate() -> Record:
        t, t_reaction = grid.times(0, grid.steps), integrator.reaction_times(grid)
        return Record(t, np.empty((rows, n)), np.empty((rows, n)), t_reaction, np.empty((grid.steps, nc)))

    def advance() -> None:
        carry = integrator.start(problem, grid, "auto", record)
        integrator.advance(carry, record, 0, grid.steps)

    times, record = timed(allocate)
    fresh, _ = timed(advance)
    again, _ = timed(advance)
    listing, (events, impulsive) = timed(lambda: events_of_steps(dynamics, record))
    record.reaction[impulsive] = 0.0
    start = (problem.initial_coordinates, problem.initial_velocities)
    judging, _ = timed(lambda: certify(dynamics, start, record, None, events, integrator))
    return {"time grids": times, "advance": fresh, "advance again": again, "events": listing, "certificate": judging}


def measure_parts(repeats: int, steps: int) -> list[dict[str, Any]]:
    """Return kernel and certificate in ns a step of each of `PARTS`, the least of the turns."""
    found: dict[tuple[str, str], Samples] = {}
    for turn in range(repeats + 1):
        for name, integrator, t_end in PARTS:
            parts = parts_of_simulate(load_problem(name), integrator, Grid(t_end, steps))
            for part in ("advance again", "certificate") if turn > 0 else ():
                found.setdefault((name, integrator.name), defaultdict(list))[part].append(1e9 * parts[part] / steps)
    return [
        {"problem": name, "method": method, **{part: min(values) for part, values in samples.items()}}
        for (name, method), samples in found.items()
    ]


def measure_bars(repeats: int, steps: int) -> list[dict[str, Any]]:
    """Return what steps of the bars cost, in ns a node, medians of processor time."""
    return [{"problem": name} | bar_costs(load_problem(name), repeats, steps) for name in BARS]


def bar_costs(problem: Problem, repeats: int, count: int) -> dict[str, float]:
    """Return the kernel with banded equations and the LCP of the last basis, without each, and two sweeps alone."""
    d, grid, integrator = problem.dynamics, Grid(problem.t_end, count), MoreauJean()
    n, nc, samples = len(d.nodes), len(d.contacts), defaultdict[str, list[float]](list)
    step = integrator.prepare(d, grid.h, "auto")
    steps = {"banded": step, "dense": replace(step, banded=DENSE, keeps=False)}
    right = np.ones(n)
    for _ in range(repeats):
        for name, each in steps.items():
            record = Record(
                grid.times(0, count),
                *np.zeros((2, count + 1, n)),
                integrator.reaction_times(grid),
                np.zeros((count, nc)),
            )
            carry = replace(integrator.start(problem, grid, "auto", record), steps={0: each})
            began = time.process_time()
            integrator.advance(carry, record, 0, count)
            samples[name].append(time.process_time() - began)
        began = time.process_time()
        simulate(problem, dt=grid.h, t_end=problem.t_end)
        samples["simulate"].append(time.process_time() - began)
        began = time.process_time()
        for _ in range(count):
            solve_banded(step.banded.factors[0], right)
        samples["sweeps"].append(time.process_time() - began)
    return {name: 1e9 * median(values) / (count * n) for name, values in samples.items()}


def measure_imports(repeats: int) -> Samples:
    """Import numpy and lcpimpact by turns, each in an interpreter of its own, after one that warms the caches."""
    samples: Samples = defaultdict(list)
    for turn in range(repeats + 1):
        for module in ("numpy", "lcpimpact"):
            seconds, _ = timed(lambda module=module: child(f"import {module}"))  # type: ignore[misc]
            if turn > 0:
                samples[module].append(seconds)
    return samples


def first_calls(folder: Path) -> dict[str, float]:
    """Return the seconds from the start of the import to the end of a short first run, by the code that is at hand."""
    states = {"interpreted": "later", "compiling": "first", "cached": "first"}
    return {
        state: float(child(FIRST_CALL, LCPIMPACT_CACHE=str(folder), LCPIMPACT_COMPILE=when))
        for state, when in states.items()
    }


def difference(found: Mapping[str, float], expected: Mapping[str, float]) -> float:
    """Return the largest relative difference of two motions; NaN if there is one."""
    return float(np.max([abs(found[name] - expected[name]) / abs(expected[name]) for name in expected]))


def summary(run: Trajectory) -> dict[str, float]:
    """Return x, v, z at the end, and the largest R."""
    return {"x": run["x"][-1], "v": run["v_x"][-1], "z": run["z"][-1], "R": run["R"].max()}


def agreements(problem: Problem, steps: int, loop: Any, answer: Any) -> list[Agreement]:
    """Compare the motions: simulate with the C loop on its grid, and with Siconos on the grid of Siconos."""
    found: list[Agreement] = []
    if not isinstance(loop, MissingError):
        run = simulate(problem, dt=DT, t_end=steps * DT)
        rows = loop(np.empty((steps, 4)), run.t[-1] / steps)
        expected = dict(zip("xvz", rows[-1, :3], strict=True)) | {"R": rows[:, 3].max()}
        found.append(Agreement("simulate and the C loop", difference(summary(run), expected), 1e-9))
    if not isinstance(answer, MissingError):
        run = simulate(problem, dt=SICONOS_DT, t_end=SICONOS_STEPS * SICONOS_DT)
        expected = answer["final"] | {"R": answer["max_R"]}
        found.append(Agreement("simulate and Siconos", difference(summary(run), expected), 1e-6))
    return found


def compared(what: str, value: float, unit: str, base: float | None, to: str, goal: str = "") -> Row:
    """Return the row of a value that is judged by its ratio to another one."""
    if base is None:
        return Row(what, value, unit, None, to, goal, None)
    ratio = value / base
    reached = None
    if goal:
        sign, bound = goal.split()
        reached = ratio <= float(bound) if sign == "<=" else ratio >= float(bound)
    return Row(what, value, unit, ratio, to, goal, reached)


def step_rows(samples: Samples, steps: int, loop: Any, answer: Any) -> list[Row]:
    """Return the rows of what a step costs, in ns."""
    ns = {
        name: median(values) * (1e9 if name.startswith("siconos") else 1e9 / steps) for name, values in samples.items()
    }
    ours, floor = ns["simulate"], ns.get("C loop")
    rows = [compared("simulate, with record and certificate", ours, "ns a step", floor, "C loop", "<= 10")]
    rows.append(Row("C loop, with record", floor, "ns a step" if floor else str(loop)))
    if floor is not None:
        rows.append(compared("C loop, into memory touched before", ns["C loop again"], "ns a step", floor, "C loop"))
    if isinstance(answer, MissingError):
        return [*rows, Row("Siconos, with record", None, str(answer), None, "simulate", ">= 50")]
    return [
        *rows,
        compared("Siconos, with record", ns["siconos mean"], "ns a step", ours, "simulate", ">= 50"),
        compared("Siconos, with record, its median step", ns["siconos median"], "ns a step", ours, "simulate"),
        compared("Siconos, its own loop, no record", ns["siconos without_recording"], "ns a step", ours, "simulate"),
    ]


def process_rows(imports: Samples, first: Mapping[str, float]) -> list[Row]:
    """Return the rows of whole processes."""
    theirs, ours = (1e3 * median(imports[module]) for module in ("numpy", "lcpimpact"))
    return [
        compared("import lcpimpact", ours, "ms a process", theirs, "import numpy", "<= 1.5"),
        Row("import numpy", theirs, "ms a process"),
        Row("import and first run, compiled before", first["cached"], "s"),
        Row("import and first run, without compiled code", first["interpreted"], "s"),
        Row("import and first run, compiling first", first["compiling"], "s"),
    ]


def breakdown(samples: Samples, steps: int) -> list[Row]:
    """Return where the time of simulate goes; the parts were timed by themselves, so the rest is a difference."""
    ns = {name: median(values) * 1e9 / steps for name, values in samples.items()}
    total = ns["simulate"]
    inside = ("advance", "certificate", "time grids", "events")
    rows = [compared(part, ns[part], "ns a step", total, "simulate") for part in inside]
    rest = total - sum(ns[part] for part in inside)
    again = compared("(advance, into memory touched before)", ns["advance again"], "ns a step", total, "simulate")
    return [*rows, compared("the rest", rest, "ns a step", total, "simulate"), again]


def main_table(title: str, rows: list[Row]) -> Table:
    """Return the rows with their goals."""
    drawn = Table("what", "median", "unit", "ratio to", "goal", "reached", title=title)
    for row in rows:
        value = "-" if row.median is None else f"{row.median:.4g}"
        ratio = "" if row.ratio is None else f"{row.ratio:.3g} x {row.to}"
        reached = {True: "yes", False: "no", None: "not measured" if row.goal else ""}[row.reached]
        drawn.add_row(row.what, value, row.unit, ratio, row.goal, reached)
    return drawn


def parts_table(title: str, rows: list[Row]) -> Table:
    """Return the rows with their shares."""
    drawn = Table("what", "median", "unit", "share", title=title)
    for row in rows:
        drawn.add_row(row.what, f"{row.median:.1f}", row.unit, f"{row.ratio:.0%}")
    return drawn


def methods_table(rows: list[dict[str, Any]]) -> Table:
    """Return kernel and certificate of each problem and method."""
    drawn = Table(
        "problem", "method", "kernel", "certificate", title=f"ns a step, {PART_STEPS:,} steps, least of all turns"
    )
    for row in rows:
        drawn.add_row(row["problem"], row["method"], f"{row['advance again']:.1f}", f"{row['certificate']:.1f}")
    return drawn


def bars_table(rows: list[dict[str, Any]]) -> Table:
    """Return the costs of the bars."""
    drawn = Table(
        "bar", "kernel", "by dense table", "simulate", "two sweeps", title=f"ns a node and step, {BAR_STEPS:,} steps"
    )
    for row in rows:
        costs = (f"{row[name]:.1f}" for name in ("banded", "dense", "simulate", "sweeps"))
        drawn.add_row(row["problem"], *costs)
    return drawn


def write(path: Path, report: Mapping[str, Any]) -> None:
    """Write the report as JSON, or its two tables as CSV; the file appears whole or not at all."""
    with whole_file(path) as part:
        if path.suffix == ".json":
            part.write_text(json.dumps(report, indent=1), encoding="utf-8")
            return
        with part.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, ["table", *Row.__dataclass_fields__])
            writer.writeheader()
            for name in ("rows", "breakdown"):
                writer.writerows({"table": name, **row} for row in report[name])


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--steps", type=int, default=1_000_000, help="steps of simulate and of the C loop")
    parser.add_argument("--repeats", type=int, default=7, help="turns of each contestant")
    parser.add_argument("--out", type=Path, help="write the figures to a .json or .csv file")
    parser.add_argument("--imports", type=int, default=IMPORTS, help="imports in fresh interpreters")
    parser.add_argument(
        "--part-steps", type=int, default=PART_STEPS, help="steps of the kernel and the certificate alone"
    )
    parser.add_argument("--bar-steps", type=int, default=BAR_STEPS, help="steps of the bars")
    add_tiny(parser, steps=200, repeats=1, imports=1, part_steps=200, bar_steps=200)
    options = parser.parse_args()
    if options.steps < 1 or options.repeats < 1:
        parser.error("--steps and --repeats must be at least 1")
    if options.out is not None and options.out.suffix not in (".json", ".csv"):
        parser.error(f"--out {options.out}: the name must end in .json or .csv")
    return options


def main() -> int:
    """Measure, print, and return the exit code."""
    options = arguments()
    problem = load_problem("system-1")
    whole = partial(simulate, problem, dt=DT, t_end=options.steps * DT)
    print_conditions({f"simulate, System 1, {options.steps:,} steps": whole})

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        loop = tried(lambda: c_loop(problem, folder))
        samples, answer = measure_steps(problem, options.steps, options.repeats, loop)
        imports = measure_imports(options.imports)
        first = first_calls(folder / "cache")
        checks = agreements(problem, options.steps, loop, answer)
        methods = measure_parts(options.repeats, options.part_steps)
        bars = measure_bars(options.repeats, options.bar_steps)

    rows = step_rows(samples, options.steps, loop, answer) + process_rows(imports, first)
    parts = breakdown(samples, options.steps)
    console = Console(width=None if sys.stdout.isatty() else 130)
    console.print(main_table(f"System 1, {options.steps:,} steps, medians of {options.repeats}", rows))
    console.print(parts_table("Where the time of simulate goes", parts))
    console.print(methods_table(methods))
    console.print(bars_table(bars))
    for check in checks:
        verdict = "agree" if check.holds else "DISAGREE"
        console.print(f"{check.what} {verdict}: {check.difference:.1e} relative, {check.allowed:g} allowed")

    if options.out is not None:
        report = {
            "date": date.today().isoformat(),
            "machine": {
                "cores": os.cpu_count(),
                "machine": platform.machine(),
                "python": platform.python_version(),
                "numpy": np.__version__,
            },
            "steps": options.steps,
            "repeats": options.repeats,
            "rows": [asdict(row) for row in rows],
            "breakdown": [asdict(row) for row in parts],
            "methods": methods,
            "bars": bars,
            "agreements": [asdict(check) for check in checks],
            "seconds": {**samples, **{f"import {module}": values for module, values in imports.items()}},
        }
        write(options.out, report)
    return 0 if all(check.holds for check in checks) else 1


if __name__ == "__main__":
    os.environ.setdefault("LCPIMPACT_COMPILE", "first")  # compiled code is measured
    sys.exit(main())
