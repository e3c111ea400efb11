"""The order of time steps across many impacts: slopes of the L1 error of v over random chains, with their scatter.

python benchmarks/orders.py [--problems 23] [--methods moreau-jean,newmark-ns] [--out orders.csv]

Each chain has one to three bodies between springs, dashpots and bumpers with e in [0, 0.9], is shaken, and has three impacts
at least; in half of them impacts accumulate to rest, in the others none do. The truth is `exact`, where `event-driven` with
rtol = 1e-12 finds the same motion. Each method takes 20 primes of steps between 211 and 40,000, clear of events; a line is
fitted in each of three ranges, and in all of them together.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator

import numpy as np
import pandas as pd
from tiny import add_tiny

import lcpimpact as li
from lcpimpact.study.accuracy.convergence import steps_clear_of
from lcpimpact.study.accuracy.norms import l1_v
from lcpimpact.study.accuracy.orders import fit

METHODS = "moreau-jean,moreau-midpoint,newmark-ns,stormer-verlet-ns"

COARSEST, FINEST = 211, 40_000

RANGES = ((200, 2_600), (2_600, 11_000), (9_000, 41_000), (200, 41_000))

T_END = 2.0

AGREE = 1e-8
"""The two truths differ by no more than this, relative to the largest coordinate."""


def chain(seed: int) -> li.Problem:
    """Return a random chain of bodies that hang from the ground over a floor, the last of them shaken."""
    rng = np.random.default_rng(seed)
    nodes = [f"b{i}" for i in range(int(rng.integers(1, 4)))]
    elements: list[li.Element] = []
    v0 = {}
    for node in nodes:
        elements += [li.Mass(node, rng.uniform(0.5, 3.0)), li.Load(node, rng.uniform(5.0, 15.0))]
        v0[node] = float(rng.normal() * 1.5)
    for above, node in zip(["ground", *nodes[:-1]], nodes, strict=True):
        elements.append(li.Spring(above, node, rng.uniform(20.0, 200.0)))
        if rng.random() < 0.5:
            elements.append(li.Dashpot(above, node, rng.uniform(0.1, 1.0)))
    elements.append(li.Load(nodes[-1], li.Harmonic(rng.uniform(5.0, 30.0), rng.uniform(3.0, 12.0), 0.3)))
    for node, below in zip(nodes, [*nodes[1:], "ground"], strict=True):
        elements.append(li.Bumper(node, below, gap=rng.uniform(0.02, 0.15), e=rng.uniform(0.0, 0.9)))
    return li.Problem(f"chain {seed}", li.Scheme(*elements), v0=v0, t_end=T_END)


def truths(problems: int) -> Iterator[tuple[li.Problem, li.Trajectory]]:
    """Yield problems with three impacts or more on whose motion both references agree: as many with a rest as without."""
    wanted = {True: problems // 2, False: problems - problems // 2}
    seed = -1
    while any(wanted.values()):
        seed += 1
        problem = chain(seed)
        options = {"dt": T_END / 200, "t_end": T_END, "progress": False, "throw": False}
        exact = li.simulate(problem, "exact", **options)
        kinds = [event.kind for event in exact.events]
        if not exact.success or kinds.count("impact") < 3 or not wanted["close" in kinds]:
            continue
        other = li.simulate(problem, "event-driven", rtol=1e-12, atol=1e-13, **options)
        if other.success and np.abs(exact.q - other.q).max() <= AGREE * np.abs(exact.q).max():
            wanted["close" in kinds] -= 1
            yield problem, exact


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problems", type=int, default=23)
    parser.add_argument("--methods", default=METHODS)
    parser.add_argument("--out")
    parser.add_argument("--counts", type=int, default=20, help="step counts of each problem")
    parser.add_argument("--finest", type=int, default=FINEST, help="largest step count")
    add_tiny(parser, problems=1, methods="moreau-jean", counts=4, finest=1000)
    given = parser.parse_args()
    rows = []
    for problem, truth in truths(given.problems):
        events, kinds = [event.t for event in truth.events], [event.kind for event in truth.events]
        told = {
            "bodies": len(truth.problem.dynamics.nodes),
            "impacts": kinds.count("impact"),
            "rests": kinds.count("close"),
        }
        print(problem.name, told, flush=True)
        wanted = np.geomspace(COARSEST, given.finest, given.counts)
        counts = sorted({steps_clear_of(events, T_END, T_END / n) for n in wanted})
        for method in given.methods.split(","):
            for n in counts:
                run = li.simulate(problem, method, dt=T_END / n, t_end=T_END, progress=False)
                rows.append({"problem": problem.name, **told, "method": method, "n": n, "error": l1_v(run, truth)})
    table = pd.DataFrame(rows)
    if given.out:
        table.to_csv(given.out, index=False)
    summarize(table)


def summarize(table: pd.DataFrame) -> None:
    """Print the median order of each method in each range, the orders of nine in ten problems, and the median scatter."""
    found = []
    for (method, resting), runs in table.groupby(["method", table["rests"] > 0], sort=False):
        for low, high in RANGES:
            if low >= runs["n"].max():
                continue
            fits = [
                fit(list(T_END / part["n"]), list(part["error"]))
                for _, part in runs[(runs["n"] > low) & (runs["n"] < high)].groupby("problem")
            ]
            orders = np.array([each.slope for each in fits])
            found.append(
                {
                    "method": method,
                    "accumulate": "yes" if resting else "no",
                    "problems": len(fits),
                    "steps": f"{low}-{high}",
                    "order": np.median(orders),
                    "from": orders.min(),
                    "to": orders.max(),
                    "scatter": np.median([each.scatter for each in fits]),
                }
            )
    print(pd.DataFrame(found).to_string(index=False, float_format="{:.2f}".format))


if __name__ == "__main__":
    os.environ.setdefault("LCPIMPACT_COMPILE", "first")  # compiled code is measured
    main()
