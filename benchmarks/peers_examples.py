"""Examples of Siconos, nosnoc and cardillo beside the same systems here, on the same steps: errors and times.

    python peers_examples.py [--peers Siconos nosnoc cardillo] [--names NAME ...] [--out examples.csv]

writes the table from which docs/peers_page.py makes docs/guide/peers.md. The examples of a program are in
``peers_siconos.py``, ``peers_nosnoc.py`` and ``peers_cardillo.py``; what is not installed is left out, and said. Siconos is
Debian's, and Siconos 4.5 another, whose Python modules have less.
Errors are the largest over the instants of the steps, in q or x, the start apart, against the judge of the example.
"""

from __future__ import annotations

import argparse
import importlib
import os
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pandas as pd
from peers_base import Example
from tiny import add_tiny

from lcpimpact import Trajectory, simulate

PEERS = {
    "Siconos": "peers_siconos",
    "Siconos 4.5": "peers_siconos_newer",
    "nosnoc": "peers_nosnoc",
    "cardillo": "peers_cardillo",
}


def ours(example: Example) -> tuple[Trajectory, float]:
    """Return the run here and its seconds of CPU."""
    began = time.process_time()
    asked = {"dt": example.h / example.parts, "t_end": example.t_end, "error": False, "progress": False}
    asked |= example.options
    run = simulate(example.problem, example.method, **asked)
    return run, time.process_time() - began


def fresh(peer: str, name: str) -> float:
    """Return the seconds of CPU of the first run in a new process with an empty cache of compiled code."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "LCPIMPACT_CACHE": folder}
        asked = [sys.executable, __file__, "--first", peer, name]
        done = subprocess.run(asked, capture_output=True, text=True, check=True, env=environment, timeout=600)
    return float(done.stdout.splitlines()[-1])


def compared(example: Example, run: Trajectory, parts: int = 1) -> np.ndarray:
    """Return the columns that are compared, at the instants of h but the start."""
    found = np.column_stack([run[name] for name in example.columns]) if example.columns else run.q
    return found[parts::parts]


def largest(one: np.ndarray, other: np.ndarray) -> float:
    """Return the largest difference over the instants that both have, or NaN if these are less than nine in ten."""
    n = min(len(one), len(other))
    return float(np.abs(one[:n] - other[:n]).max()) if n > 0.9 * max(len(one), len(other)) else float("nan")


def row(peer: str, module: ModuleType, name: str, python: str, repeats: int, shortened: bool) -> dict[str, float | str]:
    """Return the measures of one example."""
    example = module.example(name)
    if shortened:
        example = replace(example, t_end=5 * example.h)
    q, seconds = module.theirs(example, repeats, python)
    first = fresh(peer, name)
    run, _ = ours(example)
    warm = statistics.median(ours(example)[1] for _ in range(repeats))
    asked = {"dt": example.h, "t_end": example.t_end, "error": False, "progress": False, **example.judge_options}
    truth = compared(example, simulate(example.problem, example.judge, throw=False, **asked))
    found = compared(example, run, example.parts)
    return {
        "peer": peer, "example": name, "method": example.method, "judge": example.judge, "h": example.h,
        "steps": example.parts * len(found), "difference": largest(found, q[1:]), "error_theirs": largest(truth, q[1:]),
        "error": largest(truth, found), "ms_theirs": 1e3 * seconds, "ms": 1e3 * warm, "ms_fresh": 1e3 * first,
    }  # fmt: skip


def rows(
    peers: list[str], names: list[str], python: str, repeats: int, shortened: bool
) -> list[dict[str, float | str]]:
    """Return the rows of the programs that are installed."""
    found = []
    for peer in peers:
        module = importlib.import_module(PEERS[peer])
        try:
            print(f"{peer} {module.version(python)}")
        except RuntimeError as missing:
            print(f"{peer}: {missing}")
            continue
        for name in module.EXAMPLES:
            if not names or name in names:
                found.append(row(peer, module, name, python, repeats, shortened))
                print(found[-1], flush=True)
    return found


def merged(table: pd.DataFrame, file: Path) -> pd.DataFrame:
    """Return the rows of a file with those of a table in their places."""
    order = {(peer, name): i for i, (peer, name) in enumerate(
        (peer, name) for peer, file in PEERS.items() for name in importlib.import_module(file).EXAMPLES
    )}  # fmt: skip
    old = [pd.read_csv(file)] if file.exists() else []
    found = pd.concat([*old, table]).drop_duplicates(["peer", "example"], keep="last")
    at = [order.get(key, -1) for key in zip(found["peer"], found["example"], strict=True)]
    return found.assign(at=at).query("at >= 0").sort_values("at").drop(columns="at")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--out", type=Path, help="file of the table, .csv, in which other rows stay")
    parser.add_argument("--peers", nargs="*", choices=PEERS, default=list(PEERS), help="programs, all by default")
    parser.add_argument("--names", nargs="*", default=[], help="examples, all by default")
    parser.add_argument(
        "--python", default=sys.executable, help="the Python that has nosnoc and cardillo, or Siconos 4.5"
    )
    parser.add_argument("--first", nargs=2, help=argparse.SUPPRESS)
    add_tiny(parser, repeats=1, names=["BouncingBallTS", "crossing", "two_mass_oscillator"])
    options = parser.parse_args()
    if options.first:
        peer, name = options.first
        print(ours(importlib.import_module(PEERS[peer]).example(name))[1])
    else:
        table = pd.DataFrame(rows(options.peers, options.names, options.python, options.repeats, bool(options.tiny)))
        print(table.to_string(index=False))
        if options.out and len(table):
            merged(table, options.out).to_csv(options.out, index=False, float_format="%.3g")
