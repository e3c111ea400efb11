"""Lagrangian systems: what a step costs, compiled and in the interpreter, beside Siconos; and where each matrix must stand.

The ball with spin has three coordinates and a contact with friction. The table of orders freezes the system elsewhere than
`lcpimpact.integrators.stepping.frozen` does, to show what each choice costs: the law with the rows half way, and a matrix A
without C or K.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path
from unittest import mock

import numpy as np
from scipy.special import ellipk
from tiny import add_tiny

import lcpimpact as li
from lcpimpact.integrators.stepping.frozen import FrozenSteps
from lcpimpact.scheme.lagrangian import ForceSlopes, MotionRows

PYTHON = "/usr/bin/python3"
"""The Python that has Siconos."""

g = 9.81


def ball() -> li.Problem:
    """Return a ball that is dropped with spin on a rough floor."""
    R = 0.1
    floor = li.FrictionContact("floor", lambda t, q: q[1] - R, lambda t, q, v: v[0] + R * v[2], mu=0.2, e=0.5)
    system = li.Lagrangian("x y φ", lambda q: np.diag([1.0, 1.0, 0.4 * R * R]), lambda q: g * q[1], contacts=[floor])
    return li.Problem("ball with spin", system, q0={"y": 0.6}, v0={"φ": 50.0})


def double_pendulum() -> li.Problem:
    """Return two rods without mass, with a mass at each end."""

    def M(q):  # type: ignore[no-untyped-def]
        c = np.cos(q[0] - q[1])
        return np.array([[2.0, c], [c, 1.0]])

    system = li.Lagrangian("φ1 φ2", M, lambda q: -g * (2.0 * np.cos(q[0]) + np.cos(q[1])))
    return li.Problem("double pendulum", system, q0={"φ1": -0.8, "φ2": -0.3})


def bowl() -> li.Problem:
    """Return a disc that rolls in a bowl, up to the lowest point."""
    R, r, k, θ = 1.0, 0.1, 0.5, 0.6
    contact = li.FrictionContact(
        "bowl",
        gap=lambda t, q: (R - r) - np.sqrt(q[0] ** 2 + q[1] ** 2),
        slip=lambda t, q, v: (v[1] * q[0] - v[0] * q[1]) / np.sqrt(q[0] ** 2 + q[1] ** 2) + r * v[2],
        mu=1.0,
    )
    system = li.Lagrangian("x y φ", lambda q: np.diag([1.0, 1.0, k * r * r]), lambda q: g * q[1], contacts=[contact])
    quarter = math.sqrt((1.0 + k) * (R - r) / g) * ellipk(math.sin(θ / 2.0) ** 2)
    q0 = {"x": (R - r) * math.sin(θ), "y": -(R - r) * math.cos(θ)}
    return li.Problem("disc in a bowl", system, q0=q0, t_end=float(quarter))


def rod() -> li.Problem:
    """Return a rod on a pin: three coordinates and two joints."""
    joints = [
        li.Joint("X", lambda t, q: q[0] - 0.5 * np.sin(q[2])),
        li.Joint("Y", lambda t, q: q[1] + 0.5 * np.cos(q[2])),
    ]
    system = li.Lagrangian("x y φ", lambda q: np.diag([1.0, 1.0, 1.0 / 12.0]), lambda q: g * q[1], joints=joints)
    return li.Problem("rod on a pin", system, q0={"x": -0.5 * math.sin(1.0), "y": -0.5 * math.cos(1.0), "φ": -1.0})


def seconds(dt: float, steps: int, runs: int) -> float:
    """Return the median seconds of a step of the ball."""
    problem, found = ball(), []
    for _ in range(runs):
        began = time.perf_counter()
        li.simulate(problem, dt=dt, t_end=steps * dt, error=False, progress=False)
        found.append((time.perf_counter() - began) / steps)
    return sorted(found)[len(found) // 2]


def cost(dt: float, steps: int, runs: int) -> None:
    """Print the cost of a step."""
    print(
        f"{f'{steps} steps of {dt:g} s, with all that simulate does':60s} {1e6 * seconds(dt, steps, runs):8.2f} us a step"
    )
    interpreted = subprocess.run(
        [sys.executable, __file__, "--interpreted", "--steps", str(min(steps, 3000))],
        env=os.environ | {"LCPIMPACT_COMPILE": "never"}, capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    print(f"{'the same in the interpreter':60s} {1e6 * float(interpreted):8.2f} us a step")
    script = str(Path(__file__).with_name("siconos_ball.py"))
    peer = subprocess.run([PYTHON, script, str(dt), str(steps)], capture_output=True, text=True, check=False)
    if peer.returncode:
        print("Siconos: not installed (Debian: apt-get install python3-siconos)")
        return
    ours = li.simulate(ball(), dt=dt, t_end=steps * dt, error=False, progress=False).q[-1]
    for name, each in json.loads(peer.stdout.splitlines()[-1]).items():
        off = np.abs(ours - each["end"]).max()
        print(f"{f'Siconos, {name}; q differs by {off:.1e}':60s} {1e6 * each['seconds']:8.2f} us a step")


def slider_crank(steps: list[int]) -> None:
    """Print what moreau-jean and Siconos are off at t = 2.5 ms, before the first impact of the slider-crank."""
    t, script = 0.0025, str(Path(__file__).with_name("siconos_slider_crank.py"))
    words = [PYTHON, script, str(t), *map(str, steps)]
    peer = subprocess.run(words, capture_output=True, text=True, check=False)
    if peer.returncode:
        return
    theirs = json.loads(peer.stdout.splitlines()[-1])
    problem = li.load_problem("slider-crank")
    exact = li.simulate(problem, "event-driven", dt=t / 10, t_end=t, rtol=1e-12, error=False).q[-1]
    for n in steps:
        ours = li.simulate(problem, dt=t / n, t_end=t, error=False).q[-1]
        off = [np.abs(each - exact).max() for each in (ours, np.array(theirs[str(n)]))]
        print(f"slider-crank, {n:5d} steps: moreau-jean is off by {off[0]:.1e} rad, Siconos by {off[1]:.1e} rad")


def without(name: str, found: list[np.ndarray]) -> list[np.ndarray]:
    """Return the values of the forces without one of their slopes; those of other functions as they are."""
    if len(found) != len(ForceSlopes._fields):
        return found
    forces = ForceSlopes(*found)
    return [*forces._replace(**{name: 0.0 * np.zeros(getattr(forces, name).shape)})]


def orders(steps: list[int]) -> None:
    """Print the errors and orders of moreau-jean, with the system frozen in other ways too."""
    table = FrozenSteps._table
    ways = {
        "as it is": lambda found, part, at: found,
        "law with the rows half way": lambda found, part, at: (
            [*MotionRows(*found)._replace(H=at(0.5)[1])] if len(found) == 4 and part == 1.0 else found
        ),
        "A without C": lambda found, part, at: without("C", found),
        "A without K": lambda found, part, at: without("K", found),
    }
    print(f"\n{'':32s}{'':18s}differences of successive runs, N = {', '.join(map(str, steps))}")
    for name, way in ways.items():

        def changed(self, y, at, way=way):  # type: ignore[no-untyped-def]
            return table(self, y, lambda f, part: way(at(f, part), part, lambda other: at(f, other)))

        with mock.patch.object(FrozenSteps, "_table", changed):
            for problem in (double_pendulum(), bowl(), rod()):
                runs = [
                    li.simulate(problem, dt=problem.t_end / n, error=False, progress=False, throw=False) for n in steps
                ]
                off = [np.abs(a.q[-1] - b.q[-1]).max() for a, b in pairwise(runs)]
                rates = " ".join(f"{math.log2(a / b):5.2f}" for a, b in pairwise(off))
                print(f"{name:32s}{problem.name:18s}{' '.join(f'{each:.1e}' for each in off)}   orders {rates}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dt", type=float, default=1e-3)
    parser.add_argument("--steps", type=int, default=30_000)
    parser.add_argument("--runs", type=int, default=7)
    parser.add_argument("--most", type=int, default=3200, help="number of steps of the finest run of the orders")
    parser.add_argument("--interpreted", action="store_true", help=argparse.SUPPRESS)
    add_tiny(parser, steps=300, runs=1, most=200)
    options = parser.parse_args()
    if options.interpreted:
        print(seconds(options.dt, options.steps, 3))
    else:
        cost(options.dt, options.steps, options.runs)
        slider_crank([options.most // 2**k for k in (3, 2, 1, 0)])
        orders([options.most // 2**k for k in (4, 3, 2, 1, 0)])
