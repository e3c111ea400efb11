"""Tutorials of Siconos beside the same systems here, on the same steps: difference, errors and times, fresh and warm.

Siconos comes with Debian (``apt-get install python3-siconos``) and belongs to Debian's Python, which runs
``siconos_others.py``:

    python siconos_tutorials.py --out tutorials.csv

writes the table from which docs/peers_page.py makes docs/guide/peers.md. The data are those of siconos-tutorials at
b6c9bfd194; positive is upwards as there, and balls are without the coordinates that do not move. Errors are the largest
over the run, in q or x, against `exact`, or `event-driven` for a body that turns.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd
from others_siconos import PYTHON, SCRIPT, bodies, versions
from tiny import add_tiny

from lcpimpact import LinearComplementaritySystem, Problem, Scheme, Trajectory, load_problem, simulate


@dataclass(frozen=True)
class Tutorial:
    """A tutorial: its system as numbers for Siconos, its step and end, the options of both, and the problem if it turns."""

    data: dict
    h: float
    t_end: float
    options: dict = field(default_factory=dict)
    body: Problem | None = None


def ball() -> Tutorial:
    """Return BouncingBallTS."""
    return Tutorial(bodies([1.0], [-9.81], [[1.0]], [0.0], 0.9, q=[1.0]), 0.005, 10.0)


def beads() -> Tutorial:
    """Return ColumnOfBeadsTS: ten beads."""
    H = np.eye(10) - np.eye(10, k=-1)
    gaps, q = [-0.1] + 9 * [-0.2], (1.0 + 0.25 * np.arange(10)).tolist()
    return Tutorial(bodies([1.0] * 10, [-9.81] * 10, H.tolist(), gaps, 0.9, q=q), 5e-4, 2.0)


def two_balls() -> Tutorial:
    """Return TwoBouncingBallTS."""
    H, gaps = [[1.0, 0.0], [-1.0, 1.0]], [0.0, -0.2]
    return Tutorial(bodies([1.0, 2.0], [-9.81, -19.62], H, gaps, 0.95, q=[0.1, 0.301]), 1e-3, 3.0)


def bar(n: int = 40) -> Tutorial:
    """Return ImpactingBar with 40 of its 500 degrees of freedom, and its θ = 1."""
    E, A, rho, dx = 210e9, 0.000314, 7800.0, 1.0 / n
    K = E * A / dx * (2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    M = rho * A * dx / 6.0 * (4.0 * np.eye(n) + np.eye(n, k=1) + np.eye(n, k=-1))
    K[0, 0], K[-1, -1] = 0.5 * K[0, 0], 0.5 * K[-1, -1]
    M[0, 0], M[-1, -1] = 0.5 * M[0, 0], 0.5 * M[-1, -1]
    data = bodies([1.0] * n, [0.0] * n, np.eye(n)[:1].tolist(), [0.0], 0.0, q=[5e-5] * n, v=[-0.1] * n)
    return Tutorial({**data, "M": M.tolist(), "K": K.tolist()}, 2e-7, 1.5e-3, {"theta": 1.0})


def first_order(law: str, A: list, B: list, C: list, D: list, x: list, a: list | None = None) -> dict:
    """Return a first-order system."""
    a = [0.0] * len(x) if a is None else a
    return {"kind": "first order", "law": law, "A": A, "a": a, "B": B, "C": C, "D": D, "x": x}


def circuit() -> Tutorial:
    """Return CircuitRLCD, with γ = 1/2 as its θ."""
    L, capacity, R = 1e-2, 1e-6, 1e3
    A, B = [[0.0, -1.0 / capacity], [1.0 / L, 0.0]], [[-1.0 / capacity], [0.0]]
    data = first_order("complementarity", A, B, [[-1.0, 0.0]], [[R]], [-1.0, 0.0])
    return Tutorial({**data, "gamma": 0.5}, 1e-5, 5e-3)


def bridge() -> Tutorial:
    """Return DiodeBridge, with γ = 1/2 as its θ."""
    L, capacity, R = 1e-2, 1e-6, 1e3
    A, B = [[0, -1 / capacity], [1 / L, 0]], [[0, 0, -1 / capacity, 1 / capacity], [0, 0, 0, 0]]
    D = [[1 / R, 1 / R, -1, 0], [1 / R, 1 / R, 0, -1], [1, 0, 0, 0], [0, 1, 0, 0]]
    data = first_order("complementarity", A, B, [[0, 0], [0, 0], [-1, 0], [1, 0]], D, [10.0, 0.0])
    return Tutorial({**data, "gamma": 0.5}, 1e-6, 5e-3)


def colpitts() -> Tutorial:
    """Return ColpittsOscillator, to a fifth of its end."""
    L, C_1, C_2, R_c, R_e, α_F, α_R, V_C, V_E = 0.1, 2.0, 0.8, 10.0, 20.0, 0.99, 0.015, 10.0, 20.0
    A = [
        [-1 / (R_c * C_1), -1 / (R_c * C_1), 1 / C_1],
        [-1 / (R_c * C_2), -(1 / R_c + 1 / R_e) / C_2, 1 / C_2],
        [-1 / L, -1 / L, 0.0],
    ]
    a = [V_C / (R_c * C_1), (V_C / R_c - V_E / R_e) / C_2, V_C / L]
    B, C = [[1 / C_1, -α_F / C_1], [(1 - α_R) / C_2, (1 - α_F) / C_2], [0, 0]], [[1, 1, 0], [0, 1, 0]]
    return Tutorial(first_order("complementarity", A, B, C, [[0, 0], [0, 0]], [0.0, 0.0, 0.0], a), 1e-3, 20.0)


def two_relays() -> Tutorial:
    """Return SimpleExampleRelay."""
    two = np.eye(2).tolist()
    data = first_order("relay", [[0, 0], [0, 0]], [[2, 0], [0, 2]], two, [[0, 0], [0, 0]], [1.0, -1.0])
    return Tutorial(data, 1e-3, 1.0)


def filippov() -> Tutorial:
    """Return Filippov."""
    α, two = 0.01, np.eye(2).tolist()
    B = [[500 * α, 500 * (1 - α)], [-500 * (1 - α), 500 * α]]
    return Tutorial(first_order("relay", [[0, 0], [0, 0]], B, two, [[0, 0], [0, 0]], [10.0, 10.0]), 1e-3, 10.0)


def oscillator() -> Tutorial:
    """Return RelayOscillator."""
    A, start = [[0, 1, 0], [0, 0, 1], [0, -3, -2]], 3.0 * np.sqrt(2.0) / (2.0 * np.pi)
    return Tutorial(first_order("relay", A, [[0], [0], [1]], [[1, 0, 0]], [[0]], [0.0, start, 0.0]), 1e-2, 100.0)


def friction() -> Tutorial:
    """Return FrictionOscillator."""
    return Tutorial(first_order("relay", [[0, 1], [-1, 0]], [[0], [1]], [[0, 1]], [[0]], [12.0, 6.0]), 1e-2, 100.0)


def spin() -> Tutorial:
    """Return Ball2D_kernel_only_with_friction: x, y upwards, and the angle, as a Lagrangian system here."""
    R, e, mu, omega = 0.5, 0.9, 0.1, 2.0
    start = {"q": [0.0, 1.0, 0.0], "v": [0.0, 0.0, omega], "mu": [mu]}
    data = bodies([1.0, 1.0, 0.4 * R**2], [0.0, -9.81, 0.0], [[0.0, 1.0, 0.0], [1.0, 0.0, R]], [-R], e, **start)
    known = load_problem("ball-with-spin", R=R, e=e, mu=mu)
    body = Problem("Ball2D", known.scheme, q0={"y": 1.0}, v0={"φ": omega}, t_end=10.0)
    return Tutorial(data, 0.005, 10.0, body=body)


TUTORIALS: dict[str, Callable[[], Tutorial]] = {
    "BouncingBallTS": ball,
    "ColumnOfBeadsTS": beads,
    "TwoBouncingBallTS": two_balls,
    "ImpactingBar, 40 of 500": bar,
    "CircuitRLCD": circuit,
    "DiodeBridge": bridge,
    "ColpittsOscillator": colpitts,
    "SimpleExampleRelay": two_relays,
    "Filippov": filippov,
    "RelayOscillator": oscillator,
    "FrictionOscillator": friction,
    "Ball2D_kernel_only_with_friction": spin,
}


def problem_of(name: str, tutorial: Tutorial) -> Problem:
    """Return the system of a tutorial."""
    if tutorial.body:
        return replace(tutorial.body, t_end=tutorial.t_end)
    d = tutorial.data
    if d["kind"] == "mechanical":
        scheme = Scheme.of_matrices(d["M"], d["C"], d["K"], d["f"], H=d["H"], gaps=d["gaps"], e=d["e"])
        names = scheme.assemble().nodes
        q0, v0 = (dict(zip(names, d[key], strict=True)) for key in ("q", "v"))
        return Problem(name, scheme, q0=q0, v0=v0, t_end=tutorial.t_end)
    states = [f"x{i + 1}" for i in range(len(d["x"]))]
    rows = len(d["C"])
    bounds = {"lower": [-1.0] * rows, "upper": [1.0] * rows} if d["law"] == "relay" else {}
    system = LinearComplementaritySystem(d["A"], d["B"], d["C"], d["D"], a=d["a"], states=states, **bounds)
    return Problem(name, system, q0=dict(zip(states, d["x"], strict=True)), t_end=tutorial.t_end)


def ours(tutorial: Tutorial, problem: Problem) -> tuple[Trajectory, float]:
    """Return the run by `moreau-jean` and its seconds of CPU."""
    began = time.process_time()
    run = simulate(problem, "moreau-jean", dt=tutorial.h, error=False, progress=False, **tutorial.options)
    return run, time.process_time() - began


def theirs(tutorial: Tutorial, repeats: int) -> tuple[np.ndarray, float]:
    """Return q or x by Siconos, and the median of its seconds of CPU."""
    data = {**tutorial.data, **tutorial.options, "h": tutorial.h, "t_end": tutorial.t_end, "repeats": repeats}
    done = subprocess.run(
        [PYTHON, str(SCRIPT), json.dumps(data)], capture_output=True, text=True, check=True, timeout=600
    )
    found = json.loads(done.stdout.splitlines()[-1])
    return np.array(found["q"]), found["seconds"]


def fresh(name: str) -> float:
    """Return the seconds of CPU of the first run in a new process with an empty cache of compiled code."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "LCPIMPACT_CACHE": folder}
        asked = [sys.executable, __file__, "--first", name]
        done = subprocess.run(asked, capture_output=True, text=True, check=True, env=environment, timeout=600)
    return float(done.stdout.splitlines()[-1])


def row(name: str, repeats: int, shortened: bool) -> dict[str, float | str]:
    """Return the measures of one tutorial."""
    tutorial = TUTORIALS[name]()
    if shortened:
        tutorial = replace(tutorial, t_end=20 * tutorial.h)
    problem = problem_of(name, tutorial)
    q, seconds = theirs(tutorial, repeats)
    first = fresh(name)
    run, _ = ours(tutorial, problem)
    warm = statistics.median(ours(tutorial, problem)[1] for _ in range(repeats))
    judge = "event-driven" if tutorial.body else "exact"
    truth = simulate(problem, judge, dt=tutorial.h, error=False, progress=False, throw=False)
    known = truth.ended and len(truth.q) == len(q)
    off = [float(np.abs(each - truth.q).max()) if known else float("nan") for each in (q, run.q)]
    return {
        "tutorial": name, "h": tutorial.h, "steps": len(q) - 1, "difference": float(np.abs(run.q - q).max()),
        "error_siconos": off[0], "error": off[1], "ms_siconos": 1e3 * seconds, "ms": 1e3 * warm, "ms_fresh": 1e3 * first,
    }  # fmt: skip


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--out", type=Path, help="file of the table, .csv")
    parser.add_argument("--names", nargs="*", default=list(TUTORIALS), help="tutorials, all by default")
    parser.add_argument("--first", help=argparse.SUPPRESS)
    add_tiny(parser, repeats=1, names=["BouncingBallTS"])
    options = parser.parse_args()
    if options.first:
        tutorial = TUTORIALS[options.first]()
        print(ours(tutorial, problem_of(options.first, tutorial))[1])
    else:
        table = pd.DataFrame([row(name, options.repeats, bool(options.tiny)) for name in options.names])
        print(f"Siconos {versions()['siconos']}")
        print(table.to_string(index=False))
        if options.out:
            table.to_csv(options.out, index=False, float_format="%.3g")
