#!/usr/bin/python3
"""A column of beads on a floor in Siconos: MoreauJeanOSI with θ = 1/2, an LCP, and Newton's law of impact.

    /usr/bin/python3 siconos_column.py '{"n": 100, "steps": 50, "h": 1e-3, "m": 0.1, "g": 9.81, "gap": 0.0, "e": 0.0}'

Its last line is JSON: the CPU seconds of a step, and the lowest bead's place at the end, positive upwards.
"""

import itertools
import json
import sys
import time

import numpy as np
import siconos.kernel as sk
import siconos.numerics as sn


def main(n: int, steps: int, h: float, m: float, g: float, gap: float, e: float) -> None:
    """Run the column and print what a step costs; bead 0 is the lowest."""
    world = sk.NonSmoothDynamicalSystem(0.0, (steps + 1.5) * h)
    beads = []
    for i in range(n):
        bead = sk.LagrangianLinearTIDS([gap * (i + 1)], [0.0], [[m]])
        bead.setFExtPtr(np.array([-m * g]))
        world.insertDynamicalSystem(bead)
        beads.append(bead)
    law = sk.NewtonImpactNSL(e)
    floor = sk.Interaction(law, sk.LagrangianLinearTIR([[1.0]]))
    world.link(floor, beads[0])
    for below, above in itertools.pairwise(beads):
        world.link(sk.Interaction(law, sk.LagrangianLinearTIR([[-1.0, 1.0]])), below, above)
    lcp = sk.LCP(sn.SICONOS_LCP_LEMKE)
    simulation = sk.TimeStepping(world, sk.TimeDiscretisation(0.0, h), sk.MoreauJeanOSI(0.5), lcp)
    simulation.computeOneStep()
    simulation.nextStep()
    began = time.process_time()
    for _ in range(steps):
        simulation.computeOneStep()
        simulation.nextStep()
    print(json.dumps({"seconds_a_step": (time.process_time() - began) / steps, "lowest": float(beads[0].q()[0])}))


if __name__ == "__main__":
    main(**json.loads(sys.argv[1]))
