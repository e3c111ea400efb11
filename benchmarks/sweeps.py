"""What a run of a sweep costs: `sweep` against C with vector lanes and threads, and against a loop over `simulate`.

    python benchmarks/sweeps.py [--sets 1000000] [--steps 1000] [--repeats 5] [--cluster]

All run System 1 by the θ-method with θ = 1/2 and keep its greatest force, for random k_o and c_o. `sweep` divides by W and
checks the LCP of each step, and runs some of the sets alone, certificate included; the C program does nothing of that. It
is compiled with 16 lanes, with 64, which is the fastest, and with the operations of `sweep` but the check, in 64 lanes:
the first and the last are the yardsticks. Contestants take turns; medians are compared. The second table has every method
whose step is linear. With --cluster there is another table: a sweep of 100 chunks by a process pool and by a LocalCluster
of dask, of two processes each. The exit code is 1 if the contestants do not find the same numbers, and 0 otherwise,
whatever the speed.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from conditions import print_conditions
from rich.console import Console
from rich.table import Table
from speed import MissingError, compiled_library, parameters
from tiny import add_tiny

from lcpimpact import Samples, load_problem, simulate, sweep
from lcpimpact.arrays import Array
from lcpimpact.errors import LcpImpactError
from lcpimpact.integrators import METHODS
from lcpimpact.integrators.stepping.linear_step import LinearStep

THETA = 0.5
T_END = 1.0
ALONE = 200
"""Number of sets that a loop over `simulate` is timed with."""

LANES = 16, 64
"""Numbers of lanes of the C program."""

FLOOR = f"C, {LANES[0]} lanes and threads"
"""Name of the C program whose steps wait for each other."""

SAME = "C, the same operations"
"""Name of the C program with the operations of `sweep`."""

PROBLEMS = {
    "system-1": ("k_o", (3000.0, 5000.0)),
    "kelvin-voigt-tension": ("0.m", (0.5, 2.0)),
    "bouncing-ball": ("2.e", (0.2, 0.9)),
}
"""Problems of the second table, with the parameter that is swept and its range."""


def samples(sets: int) -> Samples:
    """Return random stiffnesses and dampings of the ground."""
    rng = np.random.default_rng(0)
    return Samples({"k_o": rng.uniform(3000.0, 5000.0, sets), "c_o": rng.uniform(100.0, 400.0, sets)})


def c_lanes(folder: Path, lanes: int, *options: str) -> Callable[[Samples, int], Array]:
    """Compile system_1_lanes.c; return (samples, steps) -> (max R, x at the end) of each set."""
    folder.mkdir()
    library = compiled_library("system_1_lanes", folder, "-march=native", "-fopenmp", f"-DLANES={lanes}", *options)
    size, number, array = ctypes.c_size_t, ctypes.c_double, np.ctypeslib.ndpointer(dtype=np.float64, flags="C")
    library.system_1_lanes.argtypes = [size, size, number, number, number, array, array, number, number, array]
    library.system_1_lanes.restype = None
    constants = parameters(load_problem("system-1"))

    def run(given: Samples, steps: int) -> Array:
        found, m, g, v_o = np.empty((len(given), 2)), constants["m"], constants["g"], constants["v_o"]
        k_o, c_o = given.values["k_o"], given.values["c_o"]
        library.system_1_lanes(len(given), steps, T_END / steps, THETA, m, k_o, c_o, g, v_o, found)
        return found

    return run


def swept(given: Samples, steps: int) -> Array:
    """Return max R of each set by `sweep`."""
    found = sweep(load_problem("system-1"), given, dt=T_END / steps, t_end=T_END, progress=False)
    if found["status"].any():
        raise AssertionError("a set is not solved")
    return np.asarray(found["R.max"])


def looped(given: Samples, steps: int) -> Array:
    """Return max R of the first sets by `simulate`."""
    pairs = zip(given.values["k_o"][:ALONE], given.values["c_o"][:ALONE], strict=True)
    problems = (load_problem("system-1", k_o=float(k), c_o=float(c)) for k, c in pairs)
    return np.array([simulate(each, dt=T_END / steps, t_end=T_END)["R"].max() for each in problems])


def seconds(call: Callable[[], Any]) -> tuple[float, Any]:
    """Return the time of a call, and its result."""
    began = time.perf_counter()
    found = call()
    return time.perf_counter() - began, found


def methods_table(sets: int, steps: int) -> Table:
    """Return ns a step a run of every method on the problems that it takes, one output, least of three."""
    drawn = Table("method", *PROBLEMS, title=f"ns a step a run, {sets:,} sets of {steps:,} steps, least of three")
    for name, kind in METHODS.items():
        if not issubclass(kind, LinearStep):
            continue
        cells = []
        for problem, (parameter, (low, high)) in PROBLEMS.items():
            values = {parameter: np.linspace(low, high, sets)}
            options = {"dt": T_END / steps, "t_end": T_END, "outputs": ("x.max",), "progress": False, "certify": False}
            call = partial(sweep, load_problem(problem), values, name, **options)
            try:
                cells.append(f"{1e9 * min(seconds(call)[0] for _ in range(3)) / sets / steps:.2f}")
            except LcpImpactError:
                cells.append("-")
        drawn.add_row(name, *cells)
    return drawn


def wait(job: Any, values: Any, threads: int = 1) -> Any:
    """Run a chunk of which only the first set costs anything, and wait 0.1 s."""
    from lcpimpact.sweeps.sets import run_sets

    time.sleep(0.1)
    first = run_sets(job, {name: each[:1] for name, each in values.items()})
    return first[np.zeros(len(next(iter(values.values()))), dtype=np.int64)]


def cluster_table(repeats: int) -> Table:
    """Return the times of a sweep by a process pool and by dask, two processes each, and their ratio."""
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    from dask.distributed import Client, LocalCluster

    from lcpimpact.sweeps import chunks

    values = {"c_o": np.linspace(100.0, 400.0, 100_000)}
    told = {"dt": 1e-3, "outputs": ("peak_force", "restitution"), "chunk": 1000, "progress": False}
    took: list[list[float]] = [[], []]
    chunks.run_sets = wait
    with (
        LocalCluster(2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster,
        Client(cluster) as client,
        ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool,
    ):
        for _ in range(repeats + 1):  # the first is not counted: it compiles
            for times, executor in zip(took, (pool, client.get_executor()), strict=True):
                call = partial(sweep, load_problem("system-1"), values, executor=executor, **told)
                times.append(seconds(call)[0])
    ours, theirs = (median(times[1:]) for times in took)
    drawn = Table("pool, s", "dask, s", "ratio", title="100 chunks of 1,000 sets that wait 0.1 s, two processes")
    drawn.add_row(f"{ours:.3g}", f"{theirs:.3g}", f"{theirs / ours:.2f}")
    return drawn


def main() -> int:
    """Measure, print, and return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--sets", type=int, default=1_000_000)
    parser.add_argument("--steps", type=int, default=1_000)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--cluster", action="store_true", help="measure a LocalCluster of dask instead")
    parser.add_argument("--square", type=int, default=50, help="sets on each side of the small sweep")
    add_tiny(parser, sets=128, steps=100, repeats=1, square=4)
    options = parser.parse_args()
    if options.cluster:
        Console().print(cluster_table(options.repeats))
        return 0
    small = samples(options.square**2)
    print_conditions({f"sweep, {options.square} x {options.square} sets": lambda: swept(small, 3000)})
    given, small = samples(options.sets // LANES[-1] * LANES[-1]), samples(options.square**2)
    contestants: dict[str, tuple[Callable[[], Array], int, int]] = {
        "sweep": (lambda: swept(given, options.steps), len(given), options.steps),
        f"sweep of {options.square} x {options.square}": (lambda: swept(small, 3000), len(small), 3000),
        "loop over simulate": (lambda: looped(given, options.steps), min(ALONE, len(given)), options.steps),
    }
    with tempfile.TemporaryDirectory() as name:
        try:
            for lanes in LANES:
                in_c = partial(c_lanes(Path(name, str(lanes)), lanes), given, options.steps)
                contestants[f"C, {lanes} lanes and threads"] = in_c, len(given), options.steps
            in_c = partial(c_lanes(Path(name, "same"), LANES[-1], "-DSAME", "-ffp-contract=off"), given, options.steps)
            contestants[SAME] = in_c, len(given), options.steps
        except MissingError as missing:
            print(f"C: {missing}")
        took: dict[str, list[float]] = {each: [] for each in contestants}
        found = {each: call() for each, (call, _, _) in contestants.items()}
        for _ in range(options.repeats):
            for each, (call, _, _) in contestants.items():
                took[each].append(seconds(call)[0])
    drawn = Table(
        "what",
        "s",
        "sets",
        "steps",
        "ns a step a run",
        f"ratio to C, {LANES[0]} lanes",
        "to the same operations",
        title=f"System 1, {os.cpu_count()} cores, medians",
    )
    per_step = {each: 1e9 * median(took[each]) / sets / steps for each, (_, sets, steps) in contestants.items()}
    for each, (_, sets, steps) in contestants.items():
        ratios = [f"{per_step[each] / per_step[to]:.2f}" if to in per_step else "-" for to in (FLOOR, SAME)]
        drawn.add_row(each, f"{median(took[each]):.4g}", f"{sets:,}", f"{steps:,}", f"{per_step[each]:.3g}", *ratios)
    console = Console(width=None if sys.stdout.isatty() else 130)
    console.print(drawn)
    console.print(methods_table(min(100_000, options.sets), options.steps))
    same = bool((found["loop over simulate"] == found["sweep"][: len(found["loop over simulate"])]).all())
    print(f"sweep and simulate: {'the same bits' if same else 'NOT the same bits'}")
    agree = True
    for each in (to for to in (FLOOR, SAME) if to in found):
        off = np.abs(found["sweep"] / found[each][:, 0] - 1.0).max()
        agree = agree and bool(off < 1e-9)
        print(f"sweep and {each} {'agree' if off < 1e-9 else 'DISAGREE'}: {off:.1e} relative")
    return 0 if same and agree else 1


if __name__ == "__main__":
    os.environ.setdefault("LCPIMPACT_COMPILE", "first")  # compiled code is measured
    sys.exit(main())
