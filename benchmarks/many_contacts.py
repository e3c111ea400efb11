r"""What a step of many contacts costs: columns of 100 to a million beads, a pile of discs, and a lattice of beads.

    python benchmarks/many_contacts.py [--repeats 5] [--most 1000000] [--discs 316]

Times are CPU times of this process. A step is one of the blocks that `simulate` takes, with its judgement and its record;
what is paid once, before the first step, is shown beside it, for the first column with the loading of the compiled code.
The column is at rest, where all contacts are closed and all of them are solved for; or its beads fall one after another on
those that lie, from gaps of 1 mm; or it lies on a floor that vibrates, and a wave pulls each bead by a force of its own.
The lattice is of columns whose neighbours are joined by springs, so that its matrix has no bands.

All runs are judged as they go, and one that is not solved ends the script. The Thomas
solve is that of a tridiagonal system as large as the LCP, in the same language. Siconos' column is at rest too, with its own
Lemke solver.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import numpy as np
from conditions import print_conditions
from scipy.sparse import block_array
from scipy.sparse.linalg import splu
from tiny import add_tiny

from lcpimpact import Chain, Harmonic, Lattice, Loads, PrescribedMotion, Problem, SparseScheme, Status, simulate
from lcpimpact.arrays import Vector
from lcpimpact.compiled import compiled
from lcpimpact.integrators.moreau_jean import MoreauJean
from lcpimpact.lcp.judge import clear_residual_of_chain
from lcpimpact.lcp.solvers.banded import isotonic_chain
from lcpimpact.problems.balls import pile
from lcpimpact.record import Grid
from lcpimpact.sparse_run import SparseRun

DT = 1e-3
DEBIAN_PYTHON = "/usr/bin/python3"


def column(n: int, gap: float) -> Problem:
    """Return a column of beads above the floor, the lowest last."""
    return Problem("column", SparseScheme(Chain(n, m=0.1, gap=gap, e=0.0, f=0.981, b="ground", name="bead")))


def shaken(n: int) -> Problem:
    """Return a column on a floor that vibrates, with a harmonic load on each bead."""
    beads = Chain(n, m=0.1, gap=0.0, e=0.0, f=0.981, b="floor", name="bead")
    wave = Loads(np.arange(1, n + 1), f=Harmonic(0.1, 40.0), a=np.linspace(-1.0, 1.0, n), name="bead")
    floor = PrescribedMotion("floor", Harmonic(1e-5, 60.0))
    start = 1e-5  # the beads lie on the floor
    return Problem("shaken", SparseScheme(beads, wave, floor), q0=dict.fromkeys(beads.masses, start))


@compiled()
def thomas(below: Vector, diagonal: Vector, b: Vector, x: Vector, c: Vector) -> None:
    """Solve a symmetric tridiagonal system by elimination and substitution."""
    n = len(b)
    pivot = diagonal[0]
    x[0] = b[0] / pivot
    for i in range(1, n):
        c[i - 1] = below[i - 1] / pivot
        pivot = diagonal[i] - below[i - 1] * c[i - 1]
        x[i] = (b[i] - below[i - 1] * x[i - 1]) / pivot
    for i in range(n - 2, -1, -1):
        x[i] -= c[i] * x[i + 1]


def cpu(call: Callable[[], object], times: int, repeats: int) -> float:
    """Return the median CPU seconds of a call."""
    call()
    found = []
    for _ in range(repeats):
        began = time.process_time()
        for _ in range(times):
            call()
        found.append((time.process_time() - began) / times)
    return median(found)


def step_cost(problem: Problem, steps: int, repeats: int) -> tuple[float, float]:
    """Return the median CPU seconds of a step, and those of what `simulate` does before the first."""
    began = time.process_time()
    run = SparseRun(
        problem, MoreauJean(), Grid(DT * (repeats + 1) * steps, (repeats + 1) * steps), problem.dynamics.nodes[:1]
    )
    once, found = time.process_time() - began, []
    for k in range(repeats + 1):  # the first touches the memory
        began = time.process_time()
        status, _ = run.advance(k * steps, (k + 1) * steps)
        found.append((time.process_time() - began) / steps)
        assert status is Status.SOLVED, status
    assert run.trajectory(status, (repeats + 1) * steps, "").success
    return median(found[1:]), once


def siconos(n: int, steps: int) -> float | None:
    """Return the CPU seconds of a step of Siconos' column, or None without Siconos."""
    data = {"n": n, "steps": steps, "h": DT, "m": 0.1, "g": 9.81, "gap": 0.0, "e": 0.0}
    script = Path(__file__).with_name("siconos_column.py")
    try:
        done = subprocess.run(
            [DEBIAN_PYTHON, str(script), json.dumps(data)], capture_output=True, text=True, timeout=280, check=True
        )
        return float(json.loads(done.stdout.splitlines()[-1])["seconds_a_step"])
    except (OSError, subprocess.SubprocessError):
        return None


def columns(most: int, beads: int, repeats: int) -> dict[int, float]:
    """Print the cost of columns, and return the seconds of a step of those at rest."""
    found = {}
    print("column      beads   at rest: ns a bead   falling: ns a bead   shaken: ns a bead   paid once: ms")
    n = 100
    while n <= most:
        steps = max(10, beads // n)
        rest, once = step_cost(column(n, 0.0), steps, repeats)
        falling, _ = step_cost(column(n, 1e-3), steps, repeats)
        found[n] = rest
        moving, _ = step_cost(shaken(n), steps, repeats)
        each = f"{1e9 * rest / n:18.1f}   {1e9 * falling / n:18.1f}   {1e9 * moving / n:17.1f}"
        print(f"        {n:9,}   {each}   {1e3 * once:13.1f}", flush=True)
        n *= 10
    ratio = max(each / n for n, each in found.items()) / min(each / n for n, each in found.items())
    print(f"ns a bead at rest, largest over smallest: {ratio:.2f}\n")
    return found


def one_thousand(step: float, repeats: int) -> None:
    """Print the cost of the LCP of a thousand beads at rest, beside a Thomas solve and Siconos."""
    n = 1000
    run = SparseRun(column(n, 0.0), MoreauJean(), Grid(0.01, 10), ())
    run.advance(0, 10)
    contacts, z = run.step.contacts, run.motion.x[1, 2 * n : 3 * n].copy()
    x, c = np.empty((2, n))
    solve = cpu(lambda: isotonic_chain(contacts.mass, contacts.acting, z, contacts.pools), 2000, repeats)
    check = cpu(lambda: clear_residual_of_chain(contacts.W, contacts.acting, z), 2000, repeats)
    floor = cpu(lambda: thomas(contacts.W[1], contacts.W[0], contacts.L, x, c), 2000, repeats)
    print(
        f"1,000 beads at rest, µs: LCP {1e6 * (solve + check):.1f} (regression {1e6 * solve:.1f}, check {1e6 * check:.1f}),"
    )
    print(f"  whole step {1e6 * step:.1f}, one Thomas solve {1e6 * floor:.1f}")
    for beads, steps in ((100, 100), (300, 10), (1000, 2)):
        theirs = siconos(beads, steps)
        if theirs is None:
            print(f"  Siconos, {beads} beads: not measured")
            continue
        ours, _ = step_cost(column(beads, 0.0), 500, repeats)
        print(
            f"  Siconos, {beads} beads: {1e6 * theirs:.0f} µs a step, {theirs / ours:.0f} times ours ({1e6 * ours:.1f})"
        )
    print()


def discs(rows: int, repeats: int) -> None:
    """Print the cost of a pile at rest, beside a factorisation and a solve of its matrix."""
    problem = pile(rows, 0.0)
    cost, once = step_cost(problem, 5, repeats)
    d = problem.dynamics
    W = (d.H @ d.B).tocsc()
    b = np.ones(W.shape[0])
    factor = cpu(lambda: splu(W, permc_spec="MMD_AT_PLUS_A").solve(b), 1, repeats)
    print(f"pile of {W.shape[0]:,} contacts at rest: {1e3 * cost:.1f} ms a step, {1e3 * once:.0f} ms paid once;")
    print(f"  one factorisation and solve of W {1e3 * factor:.1f} ms: a step is {cost / factor:.2f} of it")
    falling = pile(rows, 1e-3)
    steps = 60
    began = time.process_time()
    run = simulate(falling, dt=DT, t_end=steps * DT, record=())
    cost = (time.process_time() - began) / steps
    print(f"  falling from gaps of 1 mm: {1e3 * cost:.1f} ms a step, {cost / factor:.2f} of it; "
          f"{run.stats.lcp_iterations / steps:.2f} pivots a step")  # fmt: skip


def lattice(rows: int, repeats: int) -> None:
    """Print the cost of a square lattice at rest on a table, beside a factorisation and a solve of its matrix."""
    beads = Lattice(rows, rows, m=0.1, gap=0.0, e=0.0, k_side=200.0, f=0.981, b="ground")
    problem = Problem("lattice", SparseScheme(beads))
    cost, once = step_cost(problem, 5, repeats)
    d = problem.dynamics
    A, n = MoreauJean().matrix(d, DT), len(d.nodes)
    both, b = block_array([[A, -d.B], [d.H, None]]).tocsc(), np.ones(n + len(d.u0))
    factor = cpu(lambda: splu(both).solve(b), 1, 1)
    print(f"lattice of {len(d.u0):,} contacts at rest: {1e3 * cost:.1f} ms a step, {1e3 * once:.0f} ms paid once;")
    print(f"  one factorisation and solve of [A -Hᵀ; H 0] {1e3 * factor:.1f} ms: a step is {cost / factor:.2f} of it")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--most", type=int, default=1_000_000)
    parser.add_argument("--discs", type=int, default=316)
    parser.add_argument("--bead-steps", type=int, default=1_000_000, help="beads times steps of each column")
    add_tiny(parser, repeats=1, most=1000, discs=4, bead_steps=1000)
    given = parser.parse_args()
    print_conditions()
    found = columns(given.most, given.bead_steps, given.repeats)
    one_thousand(found[1000], given.repeats)
    discs(given.discs, given.repeats)
    lattice(given.discs, given.repeats)


if __name__ == "__main__":
    os.environ.setdefault("LCPIMPACT_COMPILE", "first")  # compiled code is measured
    main()
