#!/usr/bin/python3
"""The ball with spin in Siconos, by Moreau-Jean's θ-method with θ = 1/2 and its solvers of friction in the plane.

Siconos comes with Debian (``apt-get install python3-siconos``) and belongs to Debian's Python:

    /usr/bin/python3 siconos_ball.py 1e-3 3000

Its last line is JSON: for each solver the seconds of a step in a loop from Python that records q, and q at the end.
"""

import json
import sys
import time

import numpy as np
import siconos.kernel as sk
import siconos.numerics as sn

SOLVERS = {
    "enumeration": sn.SICONOS_FRICTION_2D_ENUM,
    "lemke": sn.SICONOS_FRICTION_2D_LEMKE,
    "nsgs": sn.SICONOS_FRICTION_2D_NSGS,
}


def run(solver: int, h: float, steps: int) -> dict:
    """Take the steps, and return their seconds and the end."""
    nothing = np.zeros((3, 3))
    ball = sk.LagrangianLinearTIDS([0.0, 0.6, 0.0], [0.0, 0.0, 50.0], np.diag([1.0, 1.0, 0.004]), nothing, nothing)
    ball.setFExtPtr(np.array([0.0, -9.81, 0.0]))
    world = sk.NonSmoothDynamicalSystem(0.0, (steps + 0.5) * h)
    world.insertDynamicalSystem(ball)
    law = sk.NewtonImpactFrictionNSL(0.5, 0.0, 0.2, 2)
    rows = sk.LagrangianLinearTIR(np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.1]]), np.array([-0.1, 0.0]))
    touch = sk.Interaction(law, rows)
    world.link(touch, ball)
    problem = sk.FrictionContact(2, solver)
    problem.numericsSolverOptions().dparam[sn.SICONOS_DPARAM_TOL] = 1e-14
    grid = sk.TimeDiscretisation(0.0, h)
    simulation = sk.TimeStepping(world, grid, sk.MoreauJeanOSI(0.5), problem)
    q = np.empty((steps + 1, 3))
    q[0] = ball.q()
    began = time.perf_counter()
    for i in range(steps):
        simulation.computeOneStep()
        q[i + 1] = ball.q()
        simulation.nextStep()
    return {"seconds": (time.perf_counter() - began) / steps, "end": q[-1].tolist()}


if __name__ == "__main__":
    h, steps = float(sys.argv[1]), int(sys.argv[2])
    print(json.dumps({name: run(solver, h, steps) for name, solver in SOLVERS.items()}))
