#!/usr/bin/python3
"""The slider-crank until its first impact in Siconos, by Moreau-Jean's θ-method with θ = 1/2: M(q) and gyroscopic forces.

Siconos takes M at the end of the step, and θ F(t + h) + (1 - θ) F(t), by Newton's iterations. Contacts are left out: Siconos
4.4 crashes in MoreauJeanOSI::computeFreeOutput at the first active contact whose relation is a LagrangianScleronomousR
written in Python. It comes with Debian (``apt-get install python3-siconos``) and belongs to Debian's Python:

    /usr/bin/python3 siconos_slider_crank.py 0.0025 250 500 1000

Its last line is JSON: for each number of steps of the time, q at the end.
"""

import json
import sys

import numpy as np
import siconos.kernel as sk

l_1, l_2 = 0.153, 0.306
m_1, m_2, m_3, J_1, J_2, J_3 = 0.038, 0.038, 0.076, 7.4e-5, 5.9e-4, 2.7e-6
A, B = J_1 + (m_1 / 4 + m_2 + m_3) * l_1**2, J_2 + (m_2 / 4 + m_3) * l_2**2
X = (m_2 / 2 + m_3) * l_1 * l_2
G_1, G_2 = 9.81 * (m_1 / 2 + m_2 + m_3) * l_1, 9.81 * (m_2 / 2 + m_3) * l_2


class Crank(sk.LagrangianDS):
    """The angles of crank, rod and slider; FGyr contains the weights too, as both depend on the motion."""

    def __init__(self, q, v):
        super().__init__(q, v)
        # Siconos keeps copies of these, which it shows by mass(), fGyr() and so on.
        self.setMassPtr(np.zeros((3, 3)))
        self.setFGyrPtr(np.zeros(3))
        self.setJacobianFGyrqPtr(np.zeros((3, 3)))
        self.setJacobianFGyrqDotPtr(np.zeros((3, 3)))

    def computeMass(self, q=None):
        """Write M."""
        q = self.q() if q is None else q
        x = X * np.cos(q[1] - q[0])
        self.mass()[:] = [[A, x, 0.0], [x, B, 0.0], [0.0, 0.0, J_3]]

    def computeFGyr(self, q=None, v=None):
        """Write the forces."""
        q, v = (self.q(), self.velocity()) if q is None else (q, v)
        s = X * np.sin(q[1] - q[0])
        self.fGyr()[:] = [-s * v[1] ** 2 + G_1 * np.cos(q[0]), s * v[0] ** 2 + G_2 * np.cos(q[1]), 0.0]

    def computeJacobianFGyrq(self, q=None, v=None):
        """Write their slopes by q."""
        q, v = (self.q(), self.velocity()) if q is None else (q, v)
        x = X * np.cos(q[1] - q[0])
        self.jacobianFGyrq()[0, :2] = x * v[1] ** 2 - G_1 * np.sin(q[0]), -x * v[1] ** 2
        self.jacobianFGyrq()[1, :2] = -x * v[0] ** 2, x * v[0] ** 2 - G_2 * np.sin(q[1])

    def computeJacobianFGyrqDot(self, q=None, v=None):
        """Write their slopes by v."""
        q, v = (self.q(), self.velocity()) if q is None else (q, v)
        s = X * np.sin(q[1] - q[0])
        by_v = self.jacobianFGyrqDot()
        by_v[0, 1], by_v[1, 0] = -2.0 * s * v[1], 2.0 * s * v[0]


def run(t_end: float, steps: int) -> list:
    """Take the steps, and return the end."""
    h = t_end / steps
    crank = Crank(np.zeros(3), np.array([150.0, -75.0, 0.0]))
    world = sk.NonSmoothDynamicalSystem(0.0, (steps + 0.5) * h)
    world.insertDynamicalSystem(crank)
    simulation = sk.TimeStepping(world, sk.TimeDiscretisation(0.0, h), sk.MoreauJeanOSI(0.5), sk.LCP())
    simulation.setNewtonTolerance(1e-11)
    simulation.setNewtonMaxIteration(50)
    for _ in range(steps):
        simulation.computeOneStep()
        simulation.nextStep()
    return crank.q().tolist()


if __name__ == "__main__":
    t_end = float(sys.argv[1])
    print(json.dumps({steps: run(t_end, int(steps)) for steps in sys.argv[2:]}))
