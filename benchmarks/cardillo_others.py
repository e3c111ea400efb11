"""Examples of cardillo in cardillo, for `peers_cardillo.py`: it needs a Python in which cardillo is installed.

    python cardillo_others.py '{"example": "friction_belt", "h": 1e-2, "t_end": 20.0, "repeats": 1}'

Written after cardillo's examples, with their solvers. Its last line is JSON: q at the instants of the steps, and the median
of the CPU times of the repeats, each of which builds the system and takes all the steps.
"""

import contextlib
import io
import json
import statistics
import sys
import time

import numpy as np
from cardillo import System
from cardillo.constraints import Revolute
from cardillo.contacts import Sphere2Plane
from cardillo.discrete import Frame, PointMass, RigidBody, Sphere
from cardillo.force_laws import KelvinVoigtElement
from cardillo.forces import Force
from cardillo.interactions import TwoPointInteraction
from cardillo.math import A_IB_basic
from cardillo.math.prox import Sphere as Disc
from cardillo.solver import Moreau, ScipyDAE, ScipyIVP, SolverOptions

TIGHT = {"fixed_point_atol": 1e-12, "fixed_point_rtol": 1e-12, "fixed_point_max_iter": 10_000}


def two_mass_oscillator(h, t_end):
    """Return the places of two masses on a spring and a dashpot, by RK45."""
    system = System()
    ends = [PointMass(1.0, q0=np.array([x, 0.0, 0.0]), u0=np.zeros(3), name=f"mass {x}") for x in (-1.45, 1.45)]
    points = {"B_r_CP1": np.array([0.5, 0.0, 0.0]), "B_r_CP2": np.array([-0.5, 0.0, 0.0])}
    system.add(*ends, KelvinVoigtElement(TwoPointInteraction(*ends, **points), 100.0, 2.0, l_ref=1.0))
    system.assemble()
    return ScipyIVP(system, t_end, h).solve().q[:, [0, 3]]


def bouncing_ball(h, t_end):
    """Return x, z and the angle of a ball with spin on a floor with friction, by Moreau's midpoint rule."""
    R, g = 0.05, np.array([0.0, 0.0, -10.0])
    q0, u0 = RigidBody.pose2q(np.array([-0.75, 0.0, 8 * R]), np.eye(3)), np.array([1.0, 0.0, 0.0, 0.0, -25.0, 0.0])
    system = System()
    ball = Sphere(RigidBody)(radius=R, density=1.0, subdivisions=3, q0=q0, u0=u0)
    floor = Frame(name="floor")
    system.add(ball, Force(ball.mass * g, ball), floor, Sphere2Plane(floor, ball, mu=0.5, r=R, e_N=0.75, e_F=0.0))
    system.assemble()
    found = Moreau(system, t_end, h, options=SolverOptions(**TIGHT)).solve()
    turned = h * np.concatenate([[0.0], np.cumsum(0.5 * (found.u[1:, 4] + found.u[:-1, 4]))])
    return np.column_stack([found.q[:, 0], found.q[:, 2], turned])


class Belt:
    """A block with a spring on a belt; the friction falls with the speed of sliding by a smooth force."""

    nq = nu = nla_F = 1
    constant_mass_matrix = True

    def __init__(self, q0, u0):
        self.q0, self.u0, self.e_F = q0, u0, np.zeros(1)
        self.friction_laws = [([], [0], Disc(5.0))]

    def q_dot(self, t, q, u):
        """Return q'."""
        return u

    def q_dot_u(self, t, q):
        """Return its slope by u."""
        return np.eye(1)

    def M(self, t, q):
        """Return the mass."""
        return np.eye(1)

    def h(self, t, q, u):
        """Return the spring and the smooth part of the friction."""
        return -q + 4.0 / np.pi * np.arctan(3.0 * (u - 3.0))

    def h_q(self, t, q, u):
        """Return its slope by q."""
        return -np.eye(1)

    def gamma_F(self, t, q, u):
        """Return the rate of sliding."""
        return u - 3.0

    def gamma_F_u(self, t, q):
        """Return its slope by u."""
        return np.eye(1)

    def gamma_F_dot(self, t, q, u, u_dot):
        """Return its rate."""
        return u_dot

    def W_F(self, t, q):
        """Return the direction of the friction."""
        return np.eye(1)

    def Wla_F_q(self, t, q, la_F):
        """Return its slope by q."""
        return np.zeros((1, 1))


def friction_belt(h, t_end):
    """Return the place of a block on a belt, by Moreau's midpoint rule."""
    system = System()
    system.add(Belt(np.array([0.2]), np.array([0.2])))
    system.assemble()
    return Moreau(system, t_end, h, options=SolverOptions(**TIGHT)).solve().q


class Woodpecker:
    """The woodpecker toy: y, and the angles of sleeve and woodpecker."""

    nq = nu = nla_N = nla_F = 3
    constant_mass_matrix = True
    m_M, m_S, J_M, J_S, c, g = 0.0003, 0.0045, 5e-9, 7e-7, 0.0056, 9.81
    r_O, r_M, h_M, l_M, l_G, h_S, l_S = 0.0025, 0.0031, 0.0058, 0.010, 0.015, 0.02, 0.0201
    at_rest = np.array([l_M + l_G - l_S - r_O, r_M - r_O, r_M - r_O])
    normal = np.array([[0.0, 0.0, 0.0], [0.0, h_M, -h_M], [-h_S, 0.0, 0.0]])
    along = np.array([[1.0, 1.0, 1.0], [l_M, r_M, r_M], [l_G - l_S, 0.0, 0.0]])
    lever = np.array([1.0, l_M, l_G])

    def __init__(self):
        self.q0 = np.array([0.0, -(self.r_M - self.r_O) / self.h_M, -0.2788])
        self.u0 = np.array([-0.3411, 0.0, -7.4583])
        self.e_N, self.e_F = np.array([0.5, 0.0, 0.0]), np.zeros(3)
        self.friction_laws = [([i], [i], Disc(0.3)) for i in range(3)]

    def q_dot(self, t, q, u):
        """Return q'."""
        return u

    def M(self, t, q):
        """Return the mass matrix."""
        return np.diag([self.m_M, self.J_M, self.J_S]) + self.m_S * np.outer(self.lever, self.lever)

    def h(self, t, q, u):
        """Return the weights and the spring."""
        twist = self.c * (q[1] - q[2])
        return np.array([-self.m_M * self.g, -twist, twist]) - self.m_S * self.g * self.lever

    def g_N(self, t, q):
        """Return the gaps."""
        return self.at_rest + self.normal.T @ q

    def W_N(self, t, q):
        """Return their directions."""
        return self.normal

    def g_N_dot(self, t, q, u):
        """Return their rates."""
        return self.normal.T @ u

    def W_F(self, t, q):
        """Return the directions of the frictions."""
        return self.along

    def gamma_F(self, t, q, u):
        """Return the rates of sliding."""
        return self.along.T @ u


def woodpecker_toy(h, t_end):
    """Return y and the angles of a woodpecker toy, by Moreau's midpoint rule."""
    system = System()
    system.add(Woodpecker())
    system.assemble(options=SolverOptions(compute_consistent_initial_conditions=False))
    return Moreau(system, t_end, h, options=SolverOptions(**TIGHT)).solve().q


LINKS = [
    (0.26703, [8.6107e-03, 2.1727e-06, 3.6012e-02],
     [[4.0827e-04, 1.2675e-09, 1.8738e-05], [1.2675e-09, 3.8791e-04, 3.5443e-08], [1.8738e-05, 3.5443e-08, 3.6421e-05]]),
    (0.33238, [-5.0107e-03, 1.9371e-10, 1.0088e-01],
     [[1.1753e-03, -3.8540e-13, -2.9304e-08], [-3.8540e-13, 1.1666e-03, -5.2365e-12],
      [-2.9304e-08, -5.2365e-12, 1.4553e-05]]),
]  # fmt: skip
"""Mass, centre from the joint, and inertia of the links."""


def double_pendulum(h, t_end):
    """Return the angles of two links about x, by a DAE solver (Radau IIA)."""
    system, at, joints, before = System(), np.array([3.0573e-03, -2.6279e-13, 5.8800e-03]), [], None
    for i, (angle, (mass, centre, inertia)) in enumerate(zip((np.pi / 4, np.pi / 3), LINKS, strict=True)):
        A = A_IB_basic(np.pi + angle).x
        q0, still = RigidBody.pose2q(at + A @ centre, A), np.zeros(6)
        link = RigidBody(mass, np.array(inertia), q0=q0, u0=still, name=f"link {i}")
        joint = Revolute(before or system.origin, link, axis=0, r_OJ0=at, angle0=angle, name=f"joint {i}")
        system.add(link, Force(mass * np.array([0.0, 0.0, -10.0]), link, name=f"weight {i}"), joint)
        at, before = at + A @ np.array([2.3e-02, 7.05451171e-24, 1.0e-01]), link
        joints.append((link, joint))
    system.assemble()
    found = ScipyDAE(system, t_end, h).solve()
    return np.array(
        [[joint.angle(t, q[joint.qDOF]) for _, joint in joints] for t, q in zip(found.t, found.q, strict=True)]
    )


EXAMPLES = {each.__name__: each for each in (
    two_mass_oscillator, bouncing_ball, friction_belt, double_pendulum,
    woodpecker_toy,
)}  # fmt: skip


def main(example, h, t_end, repeats):
    """Run it as often as asked, and print what it found."""
    seconds = []
    for _ in range(repeats):
        began = time.process_time()
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            q = EXAMPLES[example](h, t_end)
        seconds.append(time.process_time() - began)
    print(json.dumps({"q": q[: round(t_end / h) + 1].tolist(), "seconds": statistics.median(seconds)}))


if __name__ == "__main__":
    main(**json.loads(sys.stdin.read()))
