#!/usr/bin/python3
r"""System No. 1 in Siconos: a first-order linear complementarity system under Euler-Moreau's θ-method.

With the state X = (x, v, z), λ = R and w = u = z - x, Eqs (2) read

.. math:: \dot X = A X + b + B λ, \qquad w = C X, \qquad 0 \le w \perp λ \ge 0 .

Siconos comes with Debian (``apt-get install python3-siconos``) and belongs to Debian's Python:

    /usr/bin/python3 siconos_system_1.py \
        '{"steps": 20000, "h": 1.5e-4, "theta": 0.5, "m": 100, "k_o": 3924, "c_o": 250, "g": 9.81, "v_o": 9.90454}'

Its last line is JSON: the seconds of a step (mean and median of a loop that records, and mean of Siconos' own loop,
which records nothing), the state at the end, and the largest R.
"""

import json
import sys
import time
from typing import Any

import numpy as np
import siconos.kernel as sk


def model(
    steps: int, h: float, theta: float, m: float, k_o: float, c_o: float, g: float, v_o: float
) -> tuple[Any, ...]:
    """Return the simulation, X, the interaction, and what Siconos refers to without owning it."""
    A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, -k_o / c_o]])
    b = np.array([0.0, g, 0.0])
    B = np.array([[0.0], [-1.0 / m], [1.0 / c_o]])
    C = np.array([[-1.0, 0.0, 1.0]])
    system = sk.FirstOrderLinearTIDS(np.array([0.0, v_o, 0.0]), A, b)
    bumper = sk.Interaction(sk.ComplementarityConditionNSL(1), sk.FirstOrderLinearTIR(C, B))
    # Half a step beyond the end: rounding must neither add a step nor drop one.
    world = sk.NonSmoothDynamicalSystem(0.0, (steps + 0.5) * h)
    world.insertDynamicalSystem(system)
    world.link(bumper, system)
    grid = sk.TimeDiscretisation(0.0, h)
    simulation = sk.TimeStepping(world, grid, sk.EulerMoreauOSI(theta), sk.LCP())
    return simulation, system.x(), bumper, (world, A, b, B, C)


def recorded(steps: int, **data: float) -> tuple[np.ndarray, np.ndarray]:
    """Take the steps one by one; return rows (x, v, z, R) and the seconds of each step."""
    simulation, X, bumper, _owned = model(steps, **data)
    R = bumper.lambda_(0)
    rows, clock = np.empty((steps, 4)), np.empty(steps + 1)
    clock[0] = time.perf_counter()
    for k in range(steps):
        simulation.computeOneStep()
        rows[k, :3], rows[k, 3] = X, R[0]
        simulation.nextStep()
        clock[k + 1] = time.perf_counter()
    return rows, np.diff(clock)


def unrecorded(steps: int, **data: float) -> float:
    """Return the mean seconds of a step in Siconos' own loop."""
    simulation, *_owned = model(steps, **data)
    began = time.perf_counter()
    simulation.run()
    return (time.perf_counter() - began) / steps


def main(steps: int, **data: float) -> None:
    """Run both loops, and print what they cost and where they end."""
    rows, seconds = recorded(steps, **data)
    result = {
        "steps": steps,
        "seconds_a_step_mean": float(seconds.mean()),
        "seconds_a_step_median": float(np.median(seconds)),
        "seconds_a_step_without_recording": unrecorded(steps, **data),
        "final": dict(zip("xvz", rows[-1, :3].tolist(), strict=True)),
        "max_R": float(rows[:, 3].max()),
    }
    print(json.dumps(result))


if __name__ == "__main__":
    main(**json.loads(sys.argv[1]))
