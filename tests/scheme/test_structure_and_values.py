"""Structure and values: a system whose M and H move keeps its structure, and runs by the same equations."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lcpimpact import Bumper, Mass, Scheme, Spring, load_problem
from lcpimpact.arrays import Array
from lcpimpact.errors import Status
from lcpimpact.integrators.moreau_jean import MoreauJean
from lcpimpact.integrators.moreau_midpoint import MoreauMidpoint
from lcpimpact.integrators.stepping.held_forces import HeldSteps
from lcpimpact.integrators.stepping.linear_step import LinearStep
from lcpimpact.integrators.stepping.time_stepping import SteppingRun
from lcpimpact.integrators.stormer_verlet_ns import StormerVerletNS
from lcpimpact.memo import once
from lcpimpact.record import Grid, Record
from lcpimpact.scheme.decomposition import decompose
from lcpimpact.scheme.dynamics import Dynamics, law_numbers
from lcpimpact.scheme.structure import Contact, Structure

g = 9.81


@dataclass(frozen=True)
class DoublePendulum:
    """Two rods without mass, of length 1 m, with 1 kg at each end, at the angles q from below; a wall at x_2 = ``wall``.

    It is given as a Lagrangian system: M(q), the forces F(q, v) = -∂V/∂q - h(q, v) with their Jacobian, and one gap.
    The wall moves away with ``speed``.
    """

    wall: float
    e: float = 0.0
    speed: float = 0.0

    @cached_property
    def structure(self) -> Structure:
        """Two masses and a contact between masses."""
        contact = Contact("R", "ground", "end", self.wall, self.e, relative_degree=2)
        return Structure(
            ("φ_1", "φ_2"), (contact,), decompose(np.eye(2), np.zeros((2, 2)), np.zeros(2, bool)), np.ones((2, 1))
        )

    def M(self, q: Array) -> Array:
        c = np.cos(q[0] - q[1])
        return np.array([[2.0, c], [c, 1.0]])

    def F(self, q: Array, v: Array) -> Array:
        s = np.sin(q[0] - q[1])
        return np.array([-s * v[1] ** 2 - 2.0 * g * np.sin(q[0]), s * v[0] ** 2 - g * np.sin(q[1])])

    def C(self, q: Array, v: Array) -> Array:
        """-∂F/∂v."""
        s = np.sin(q[0] - q[1])
        return np.array([[0.0, 2.0 * s * v[1]], [-2.0 * s * v[0], 0.0]])

    def H(self, q: Array) -> Array:
        return -np.cos(q)[None]

    def gap(self, t: float, q: Array) -> Array:
        return np.array([self.wall + self.speed * t - np.sin(q).sum()])

    def gap_rate(self, t: float, q: Array, v: Array) -> Array:
        return np.asarray(self.H(q) @ v + self.speed)

    def momentum(self, q: Array, v: Array) -> Array:
        return self.M(q) @ v

    def energy(self, q: Array, v: Array) -> float:
        return float(0.5 * v @ self.M(q) @ v - g * (2.0 * np.cos(q[0]) + np.cos(q[1])))

    def at(self, t: float, q: Array, v: Array) -> Dynamics:
        """Return the linear system that agrees with this one to first order: F(q, v') = f - C v', gap(q') = H q' + u0."""
        H, C = self.H(q), self.C(q, v)
        f = self.F(q, v) + C @ v
        return Dynamics(
            self.structure, M=self.M(q), C=C, K=np.zeros((2, 2)), loads=tuple(enumerate(map(float, f))), H=H,
            u0=self.gap(t, q) - H @ q, chi=np.array([self.speed]), B=H.T, D=np.zeros((1, 1)),
            **law_numbers(self.structure.contacts),
        )  # fmt: skip


def run(
    system: DoublePendulum, method: LinearStep, q: Array, v: Array, t_end: float, n: int
) -> tuple[Array, Array, Array]:
    """Take n steps, each by the method's own equations on the values half way; return q, v (n + 1, 2) and r (n, 1)."""
    h = t_end / n
    qs, vs, rs = [q], [v], []
    for k in range(n):
        d = system.at((k + 0.5) * h, q + 0.5 * h * v, v)
        step = method.prepare(d, h, "auto")
        one = Record(np.array([0.0, h]), np.array([q, q]), np.array([v, v]), np.array([0.5 * h]), np.zeros((1, 1)))
        state = method.first_state(d, method.begin(d, q, v, h), h)
        grid = Grid(h, 1)
        carry = SteppingRun(d, grid, grid.times, "auto", state, {0: step}, None, HeldSteps.of(d, grid))
        status, _ = method.advance(carry, one, 0, 1)
        assert status is Status.SOLVED
        q, v = one.q[1], one.v[1]
        qs.append(q)
        vs.append(v)
        rs.append(one.reaction[0])
    return np.array(qs), np.array(vs), np.array(rs)


START = np.array([-0.8, -0.3])


@pytest.mark.parametrize("method", [MoreauJean(), MoreauMidpoint(), StormerVerletNS()], ids=lambda method: method.name)
def test_equations_of_linear_steps_run_on_a_moving_mass_matrix(method: LinearStep) -> None:
    """A free double pendulum: order two against DOP853, and the structure is one object throughout."""
    system = DoublePendulum(wall=10.0)

    def rates(t: float, y: Array) -> Array:
        return np.concatenate([y[2:], np.linalg.solve(system.M(y[:2]), system.F(y[:2], y[2:]))])

    truth = solve_ivp(rates, (0.0, 1.0), np.append(START, [0.0, 0.0]), method="DOP853", rtol=1e-12, atol=1e-13).y[
        :2, -1
    ]
    errors = [np.abs(run(system, method, START, np.zeros(2), 1.0, n)[0][-1] - truth).max() for n in (50, 100, 200)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders > 1.9).all(), (errors, orders)
    assert errors[-1] < 1e-3
    assert system.at(0.0, START, START).structure is system.at(0.5, 2.0 * START, START).structure


def test_the_law_holds_on_a_moving_row() -> None:
    """The first impact with a wall is at 0.746122042951 s (Taylor series in 40 digits); Newton's law holds on H(q)."""
    system, n = DoublePendulum(wall=0.2, e=0.5), 2000
    q, v, r = run(system, MoreauJean(), START, np.zeros(2), 0.8, n)
    h = 0.8 / n
    k = int(np.argmax(r[:, 0] > 0.0))
    assert k * h == pytest.approx(0.746122042951, abs=2.0 * h)
    before, after = (system.gap_rate(0.0, q[j], v[j])[0] for j in (k, k + 1))
    assert after == pytest.approx(-0.5 * before, rel=1e-2)
    assert system.gap(0.0, q[-1])[0] > 0.0
    # The impulse acts along H(q) half way: the momentum jumps in its direction, and in no other.
    jump = system.momentum(q[k + 1], v[k + 1]) - system.momentum(q[k], v[k])
    assert jump == pytest.approx(system.H(q[k])[0] * h * r[k, 0], rel=1e-2)
    E = np.array([system.energy(*each) for each in zip(q, v, strict=True)])
    lost = (
        0.5 * (1.0 - 0.5**2) * before**2 / (system.H(q[k]) @ np.linalg.solve(system.M(q[k]), system.H(q[k]).T)).item()
    )
    assert E[0] - E[-1] == pytest.approx(lost, rel=2e-2)


def test_a_wall_that_moves_is_hit_at_its_own_rate() -> None:
    """With χ the rate after an inelastic impact is zero relative to the wall, which recedes at 0.3 m/s."""
    system, n = DoublePendulum(wall=0.2, speed=0.3), 2000
    q, v, r = run(system, MoreauMidpoint(), START, np.zeros(2), 0.9, n)
    k = int(np.argmax(r[:, 0] > 0.0))
    assert r[k, 0] > 0.0
    U = system.gap_rate(0.0, q[k + 1], v[k + 1])[0]
    assert abs(U) < 1e-2 < 0.1 < abs(system.gap_rate(0.0, q[k], v[k])[0])
    # Without the speed of the wall in the law, the end would stop in space.
    assert abs(U - system.speed) > 0.2


def test_a_linear_system_has_one_set_of_values() -> None:
    """`at` returns the system itself, so that what is computed once is computed once for all times."""
    d, calls = load_problem("system-1").dynamics, []

    @once
    def number(d: Dynamics) -> int:
        calls.append(d)
        return len(calls)

    assert d.at(0.0, np.zeros(2), np.zeros(2)) is d.at(3.0, np.ones(2), np.ones(2)) is d
    assert number(d.at(0.0, np.zeros(2), np.zeros(2))) == number(d.at(1.0, np.ones(2), np.ones(2))) == 1


def test_other_values_keep_the_structure() -> None:
    """Values of other times share masks and paths with the first; what depends on numbers is found anew."""
    d = Scheme(Mass("x", 2.0), Spring("x", "ground", 3.0), Bumper("x", "ground", e=0.5)).assemble()
    stiffer = replace(d, K=4.0 * d.K)
    assert stiffer.structure is d.structure
    assert stiffer.impulse_paths is d.impulse_paths
    assert stiffer.of_rate is d.of_rate
    q, v = np.array([0.1]), np.array([2.0])
    assert stiffer.elastic_energy(q) == 4.0 * d.elastic_energy(q)
    assert d.kinetic_energy(q, v) == 0.5 * 2.0 * 2.0**2
    assert d.momentum(q, v).tolist() == [4.0]
    assert d.reaction_force(q, [3.0]).tolist() == (d.H.T @ [3.0]).tolist()
    moving = replace(d, chi=np.array([0.25]))
    assert moving.gap_rate(0.0, q, v) == d.gap_rate(0.0, q, v) + 0.25
