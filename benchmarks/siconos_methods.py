#!/usr/bin/python3
"""What a step of Siconos costs on the problems of `methods.py`: it belongs to Debian's Python (python3-siconos).

    /usr/bin/python3 siconos_methods.py '{"steps": 20000, "t_end": 2.5, "rough": []}'

Its last line is JSON: a row for each of its methods, with the µs of a step in a loop that records.
"""

import json
import sys
import time

import numpy as np
import siconos.kernel as sk
import siconos.numerics as sn


def recorded(simulation, state, steps):
    """Return the µs of a step, with its state recorded."""
    rows = np.empty((steps, len(state)))
    began = time.perf_counter()
    for k in range(steps):
        simulation.computeOneStep()
        rows[k] = state
        simulation.nextStep()
    return 1e6 * (time.perf_counter() - began) / steps


def column(masses, gap, e, steps, h):
    """Return the cost of Moreau-Jean for bodies one above the other, over the ground."""
    n = len(masses)
    load = -9.81 * np.array(masses)
    heights = gap * np.arange(n, 0, -1.0)
    body = sk.LagrangianLinearTIDS(heights, np.zeros(n), np.diag(masses))
    body.setFExtPtr(load)
    world = sk.NonSmoothDynamicalSystem(0.0, (steps + 0.5) * h)
    world.insertDynamicalSystem(body)
    owned = []
    for i in range(n):
        row = np.zeros((1, n))
        row[0, i] = 1.0
        if i + 1 < n:
            row[0, i + 1] = -1.0
        contact = sk.Interaction(sk.NewtonImpactNSL(e), sk.LagrangianLinearTIR(row))
        world.link(contact, body)
        owned.append(contact)
    simulation = sk.TimeStepping(world, sk.TimeDiscretisation(0.0, h), sk.MoreauJeanOSI(0.5), sk.LCP())
    return recorded(simulation, body.q(), steps)


def friction(system, steps, h):
    """Return the cost of Moreau-Jean for contacts with friction, given by matrices."""
    M, C, K, f, H, q, v = (np.array(system[name], dtype=float) for name in ("M", "C", "K", "f", "H", "q", "v"))
    body = sk.LagrangianLinearTIDS(q, v, M, K, C)
    body.setFExtPtr(f)
    world = sk.NonSmoothDynamicalSystem(0.0, (steps + 0.5) * h)
    world.insertDynamicalSystem(body)
    owned = []
    for k, (e, mu, gap) in enumerate(zip(system["e"], system["mu"], system["gaps"], strict=True)):
        relation = sk.LagrangianLinearTIR(H[2 * k : 2 * k + 2].copy(), np.array(gap))
        contact = sk.Interaction(sk.NewtonImpactFrictionNSL(e, 0.0, mu, 2), relation)
        world.link(contact, body)
        owned.append((relation, contact))
    problem = sk.FrictionContact(2, sn.SICONOS_FRICTION_2D_LEMKE)
    problem.numericsSolverOptions().dparam[sn.SICONOS_DPARAM_TOL] = 1e-10
    simulation = sk.TimeStepping(world, sk.TimeDiscretisation(0.0, h), sk.MoreauJeanOSI(0.5), problem)
    return recorded(simulation, body.q(), steps)


def system_1(steps, h):
    """Return the cost of Euler-Moreau for System 1 in its first-order form."""
    A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, -3924.0 / 250.0]])
    b, B = np.array([0.0, 9.81, 0.0]), np.array([[0.0], [-0.01], [1.0 / 250.0]])
    C = np.array([[-1.0, 0.0, 1.0]])
    system = sk.FirstOrderLinearTIDS(np.array([0.0, 9.90454, 0.0]), A, b)
    bumper = sk.Interaction(sk.ComplementarityConditionNSL(1), sk.FirstOrderLinearTIR(C, B))
    world = sk.NonSmoothDynamicalSystem(0.0, (steps + 0.5) * h)
    world.insertDynamicalSystem(system)
    world.link(bumper, system)
    grid = sk.TimeDiscretisation(0.0, h)
    simulation = sk.TimeStepping(world, grid, sk.EulerMoreauOSI(0.5), sk.LCP())
    return recorded(simulation, system.x(), steps)


def main(steps, t_end, rough):
    """Print the rows."""
    costs = {
        ("bouncing-ball", "Siconos MoreauJeanOSI"): column([1.0], 1.0, 0.8, steps, t_end / steps),
        ("six beads", "Siconos MoreauJeanOSI"): column(
            [1.0 + 0.13 * i for i in range(6)], 0.1, 0.4, steps, 0.4 / steps
        ),
        ("system-1", "Siconos EulerMoreauOSI"): system_1(steps, 3.0 / steps),
    }
    for system in rough:
        costs[system["name"], "Siconos MoreauJeanOSI"] = friction(system, steps, system["t_end"] / steps)
    rows = [{"problem": problem, "method": method, "µs a step": cost} for (problem, method), cost in costs.items()]
    print(json.dumps(rows))


if __name__ == "__main__":
    main(**json.loads(sys.argv[1]))
