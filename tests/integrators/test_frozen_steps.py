"""Steps of Lagrangian systems: their orders on curved contacts and joints, and the three ways to their table."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from lagrangian_names import LAGRANGIAN
from scipy.special import ellipk

import lcpimpact as li
from lcpimpact.arrays import Array
from lcpimpact.errors import UnsupportedError
from lcpimpact.integrators import METHODS
from lcpimpact.integrators.stepping import frozen
from lcpimpact.integrators.stepping.frozen import FILLED, FrozenSteps
from lcpimpact.integrators.stepping.linear_step import LinearStep
from lcpimpact.scheme.structure import Feature
from lcpimpact.study.accuracy.siconos import INSTALL, python_with_siconos

g = 9.81
LINEAR_STEPS = [
    name
    for name, kind in METHODS.items()
    if issubclass(kind, LinearStep) and Feature.LAGRANGIAN in kind.declared.handles
]
TAKEN = {name: METHODS[name].declared.handles + METHODS[name].declared.moving for name in LINEAR_STEPS}
WITH_FRICTION = [name for name in LINEAR_STEPS if Feature.FRICTION in TAKEN[name]]
WITH_JOINTS = [name for name in LINEAR_STEPS if Feature.JOINTS in TAKEN[name]]


def double_pendulum() -> li.Problem:
    def M(q):
        c = np.cos(q[0] - q[1])
        return np.array([[2.0, c], [c, 1.0]])

    system = li.Lagrangian("φ1 φ2", M, lambda q: -g * (2.0 * np.cos(q[0]) + np.cos(q[1])))
    return li.Problem("double pendulum", system, q0={"φ1": -0.8, "φ2": -0.3}, t_end=1.0)


def bead(mu: float = 0.0) -> li.Problem:
    """A disc in a bowl: it slides without friction like a pendulum of length R - r, and rolls with much."""
    R, r, k, θ = 1.0, 0.1, 0.5, 0.6
    bowl = li.FrictionContact(
        "bowl",
        gap=lambda t, q: (R - r) - np.sqrt(q[0] ** 2 + q[1] ** 2),
        slip=(lambda t, q, v: (v[1] * q[0] - v[0] * q[1]) / np.sqrt(q[0] ** 2 + q[1] ** 2) + r * v[2]) if mu else None,
        mu=mu,
    )
    system = li.Lagrangian("x y φ", lambda q: np.diag([1.0, 1.0, k * r * r]), lambda q: g * q[1], contacts=[bowl])
    quarter = math.sqrt((1.0 + k * bool(mu)) * (R - r) / g) * ellipk(math.sin(θ / 2.0) ** 2)
    q0 = {"x": (R - r) * math.sin(θ), "y": -(R - r) * math.cos(θ)}
    return li.Problem("disc in a bowl", system, q0=q0, t_end=float(quarter))


def rod(joined: bool = True) -> li.Problem:
    """A rod on a pin: three coordinates with two joints, or its angle alone."""
    L, φ = 1.0, -1.0
    if not joined:
        one = li.Lagrangian("φ", lambda q: np.array([[L * L / 3.0]]), lambda q: -g * L / 2.0 * np.cos(q[0]))
        return li.Problem("rod", one, q0={"φ": φ}, t_end=1.0)
    joints = [
        li.Joint("X", lambda t, q: q[0] - L / 2.0 * np.sin(q[2])),
        li.Joint("Y", lambda t, q: q[1] + L / 2.0 * np.cos(q[2])),
    ]
    system = li.Lagrangian("x y φ", lambda q: np.diag([1.0, 1.0, L * L / 12.0]), lambda q: g * q[1], joints=joints)
    q0 = {"x": L / 2.0 * math.sin(φ), "y": -L / 2.0 * math.cos(φ), "φ": φ}
    return li.Problem("rod on a pin", system, q0=q0, t_end=1.0)


def ends(problem: li.Problem, method: str, steps: list[int]) -> list[Array]:
    """Final coordinates for several numbers of steps."""
    runs = [li.simulate(problem, method, dt=problem.t_end / n, error=False, throw=False) for n in steps]
    assert all(len(run.t) == n + 1 for run, n in zip(runs, steps, strict=True)), [run.message for run in runs]
    return [run.q[-1] for run in runs]


@pytest.mark.parametrize("method", LINEAR_STEPS)
def test_smooth_motion_has_order_two(method):
    q = ends(double_pendulum(), method, [100, 200, 400, 800])
    errors = [np.abs(a - b).max() for a, b in pairwise(q)]
    assert [math.log2(a / b) for a, b in pairwise(errors)] == pytest.approx([2.0, 2.0], abs=0.15)


@pytest.mark.parametrize("method", LINEAR_STEPS)
def test_closed_curved_contact_has_order_two(method):
    """The quarter period of a bead in a bowl is an elliptic integral; there it is at the lowest point."""
    q = ends(bead(), method, [100, 200, 400])
    errors = [np.abs(each[:2] - [0.0, -0.9]).max() for each in q]
    assert [math.log2(a / b) for a, b in pairwise(errors)] == pytest.approx([2.0, 2.0], abs=0.15)


@pytest.mark.parametrize("method", WITH_FRICTION)
def test_disc_that_rolls_in_a_bowl_has_order_two(method):
    q = ends(bead(mu=1.0), method, [100, 200, 400])
    errors = [np.abs(each - [0.0, -0.9, 0.6 * 0.9 / 0.1]).max() for each in q]
    assert [math.log2(a / b) for a, b in pairwise(errors)] == pytest.approx([2.0, 2.0], abs=0.15)


@pytest.mark.parametrize("method", WITH_JOINTS)
def test_joints_have_order_two_and_stay_closed(method):
    exact = li.simulate(rod(joined=False), "moreau-midpoint", dt=1e-5, t_end=1.0, error=False).q[-1, 0]
    q = ends(rod(), method, [400, 800, 1600])
    errors = [abs(each[2] - exact) for each in q]
    assert errors[-1] < 2e-6
    assert math.log2(errors[0] / errors[2]) > 3.0
    for each in q:
        assert abs(each[0] - math.sin(each[2]) / 2.0) < 1e-10


@pytest.mark.parametrize("method", LINEAR_STEPS)
@pytest.mark.parametrize("problem", [double_pendulum(), bead(), rod()], ids=lambda each: each.name)
def test_text_of_a_table_is_that_of_linear_algebra(method, problem):
    steps = FrozenSteps(METHODS[method](), problem.dynamics, 1e-2)
    rng = np.random.default_rng(2)
    written, t, n = steps.written, 0.3, len(problem.dynamics.nodes)
    for _ in range(5):
        y = np.concatenate([problem.initial_coordinates, np.zeros(n * (1 + len(steps.method.remembers)))])
        y += 0.1 * rng.standard_normal(len(y))
        by_algebra, by_text = steps.table(t, y), [getattr(written.table, name).copy() for name in FILLED]
        frozen._function(written.text, frozen.Fill, False)(t, y, written.constants, *by_text)
        for name, ours in zip(FILLED, by_text, strict=True):
            theirs = getattr(by_algebra, name)
            np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-12 * np.abs(theirs).max(initial=1e-300))


@pytest.mark.parametrize("name", [name for name in LAGRANGIAN if name != "painleve-jam"])
@pytest.mark.parametrize("method", ["cd-lagrange", "d1-minus"])
def test_registered_systems_keep_their_laws(method, name):
    """Near the jam the forces grow beyond what so long steps resolve, as the certificate says."""
    problem = li.load_problem(name)
    run = li.simulate(problem, method, dt=problem.t_end / 400, throw=False, error=False)
    assert run.success, run.message
    assert run.certificate.holds


def test_an_impulse_at_the_start_is_left_to_the_first_step():
    """No force holds the Painlevé rod: it jams, with the impulse in closed form, which the record of cd-lagrange has."""
    problem = li.load_problem("painleve-rod")
    run = li.simulate(problem, "cd-lagrange", dt=1e-4, t_end=2e-3, error=False)
    assert run.certificate.holds
    jam = run.events[0]
    assert (jam.kind, jam.contact) == ("jam", "N")
    assert jam.impulse == pytest.approx(9.74278579257, rel=1e-3)


def test_a_block_that_slides_starts_by_its_friction():
    """The first half step has μ m g as its friction, not what would hold the block."""
    problem = li.load_problem("block-on-corners")
    run = li.simulate(problem, "cd-lagrange", dt=1e-3, t_end=1e-2, error=False)
    μ = problem.dynamics.mu[1]
    assert run["v_x"][1:] == pytest.approx(problem.v0["x"] - μ * 9.81 * run.t[1:], rel=1e-10)


def test_a_scheme_and_its_lagrangian_take_the_same_steps():
    """A ball dropped with spin on a rough floor, as elements and by its energies."""
    R = 0.1
    scheme = li.Scheme(
        li.Mass("x", m=1.0), li.Mass("y", m=1.0), li.Mass("φ", m=0.4 * R * R), li.Load("y", f=-g),
        li.Bumper("ground", "y", gap=-R, e=0.5, name="floor"),
        li.Friction("ground", {"x": 1.0, "φ": R}, mu=0.2, normal="floor", e_T=0.3, name="floor_T"),
    )  # fmt: skip
    floor = li.FrictionContact(
        "floor", gap=lambda t, q: q[1] - R, slip=lambda t, q, v: v[0] + R * v[2], mu=0.2, e=0.5, e_T=0.3
    )
    body = li.Lagrangian("x y φ", lambda q: np.diag([1.0, 1.0, 0.4 * R * R]), lambda q: g * q[1], contacts=[floor])
    runs = [
        li.simulate(li.Problem("ball", each, q0={"y": 0.6}, v0={"φ": 50.0}), dt=1e-3, t_end=2.0, error=False)
        for each in (scheme, body)
    ]
    assert np.abs(runs[0].q - runs[1].q).max() < 1e-11
    assert np.abs(runs[0].v - runs[1].v).max() < 1e-10
    assert [event.kind for event in runs[0].events] == [event.kind for event in runs[1].events]


def test_more_coordinates_go_by_linear_algebra(monkeypatch):
    long, short = (li.simulate(rod(), dt=1e-2, error=False), None)
    monkeypatch.setattr(frozen, "MAX_WRITTEN", 0)
    short = li.simulate(rod(), dt=1e-2, error=False)
    assert np.abs(long.q - short.q).max() < 1e-12


@pytest.mark.parametrize("method", ["exact", "radau-fesd", "rk4-paper"])
def test_other_methods_refuse_by_name(method):
    with pytest.raises(
        UnsupportedError, match=f"{method} does not handle masses and directions that depend on the motion"
    ):
        li.simulate(double_pendulum(), method, dt=1e-2)


@pytest.mark.slow
def test_ball_with_spin_takes_the_steps_of_siconos():
    """The same 1,000 steps by Siconos' Moreau-Jean, with each of its solvers of friction in the plane."""
    python = python_with_siconos()
    if python is None:
        pytest.skip(f"Siconos is {INSTALL}")
    script = Path(__file__).parents[2] / "benchmarks" / "siconos_ball.py"
    done = subprocess.run([python, str(script), "1e-3", "1000"], capture_output=True, text=True, check=True)
    R = 0.1
    floor = li.FrictionContact("floor", lambda t, q: q[1] - R, lambda t, q, v: v[0] + R * v[2], mu=0.2, e=0.5)
    body = li.Lagrangian("x y φ", lambda q: np.diag([1.0, 1.0, 0.4 * R * R]), lambda q: g * q[1], contacts=[floor])
    run = li.simulate(li.Problem("ball", body, q0={"y": 0.6}, v0={"φ": 50.0}), dt=1e-3, t_end=1.0, error=False)
    for each in json.loads(done.stdout.splitlines()[-1]).values():
        assert np.abs(run.q[-1] - each["end"]).max() < 1e-9


@pytest.mark.slow
def test_siconos_and_the_slider_crank_converge_to_one_motion():
    """Until the first impact: Siconos, with M at the end of the step, by order 1, and the frozen step by order 2."""
    python = python_with_siconos()
    if python is None:
        pytest.skip(f"Siconos is {INSTALL}")
    script = Path(__file__).parents[2] / "benchmarks" / "siconos_slider_crank.py"
    counts = [100, 200, 400, 800]
    words = [python, str(script), "0.0025", *map(str, counts)]
    peer = json.loads(subprocess.run(words, capture_output=True, text=True, check=True).stdout.splitlines()[-1])
    problem = li.load_problem("slider-crank")
    t = 0.0025
    exact = li.simulate(problem, "event-driven", dt=t / 10, t_end=t, rtol=1e-12, error=False).q[-1]
    ours = [np.abs(li.simulate(problem, dt=t / n, t_end=t, error=False).q[-1] - exact).max() for n in counts]
    theirs = [np.abs(np.array(peer[str(n)]) - exact).max() for n in counts]
    assert theirs[-1] < 2e-5
    assert [math.log2(a / b) for a, b in pairwise(ours)] == pytest.approx([2.0] * 3, abs=0.02)
    assert [math.log2(a / b) for a, b in pairwise(theirs)] == pytest.approx([1.0] * 3, abs=0.02)


@pytest.mark.parametrize("c", [1.0, 1e2, 1e4, 1e8])
@pytest.mark.parametrize("dt", [0.1, 0.01])
def test_a_strong_dashpot_never_throws_a_mass_back(c, dt):
    """m v' = -c v: the way is v/c, to rounding where the mass stops in a step, and the velocity keeps its sign."""
    system = li.Lagrangian("x", lambda q: np.array([[1.0]]), Q=lambda t, q, v: -c * v)
    run = li.simulate(li.Problem("damped", system, v0={"x": 1.0}), dt=dt, t_end=2.0, error=False)
    assert (run["v_x"] >= 0.0).all()
    exact = -math.expm1(-2.0 * c) / c
    assert abs(run["x"][-1] - exact) < (1e-15 if c * dt > 20.0 else dt**2)


def test_weak_dashpots_keep_order_two():
    q = ends(damped_pendulum(), "moreau-jean", [100, 200, 400, 800])
    errors = [np.abs(a - b).max() for a, b in pairwise(q)]
    assert [math.log2(a / b) for a, b in pairwise(errors)] == pytest.approx([2.0, 2.0], abs=0.15)


def damped_pendulum() -> li.Problem:
    """The double pendulum with dashpots at both hinges."""

    def M(q):
        c = np.cos(q[0] - q[1])
        return np.array([[2.0, c], [c, 1.0]])

    def Q(t, q, v):
        return np.array([-1.5 * v[0] + 0.7 * (v[1] - v[0]), -0.7 * (v[1] - v[0])])

    system = li.Lagrangian("φ1 φ2", M, lambda q: -g * (2.0 * np.cos(q[0]) + np.cos(q[1])), Q)
    return li.Problem("damped pendulum", system, q0={"φ1": -0.8, "φ2": -0.3}, t_end=1.0)


def test_friction_is_active_with_its_normal_row_alone_in_any_units():
    """In units with large impulses a row with friction would count twice, beyond the end of an array."""
    scheme = li.Scheme(
        li.Mass("x", m=1.0), li.Mass("y", m=1.0), li.Load("y", f=9.81e9), li.Bumper("y", "ground", e=0.0, name="N"),
        li.Friction("x", "ground", mu=0.3, normal="N", name="T"),
    )  # fmt: skip
    d = scheme.assemble()
    near = METHODS["moreau-jean"]().tabulate(d, 0.1)[0].near
    assert (near[:, d.tangential] == 0.0).all()
    assert (near[:, ~d.tangential] > 0.0).all()
    run = li.simulate(li.Problem("block", scheme, v0={"x": 1e11}), dt=0.1, t_end=50.0, error=False)
    assert run["x"][-1] == pytest.approx(1e22 / (2.0 * 0.3 * 9.81e9), rel=1e-4)


def test_runs_of_one_system_in_threads_are_those_one_after_another():
    """Runs from several starts share the text of their table, and no array of it."""
    system = double_pendulum().scheme
    starts = [li.Problem("double pendulum", system, q0={"φ1": 0.1 * i}) for i in range(1, 9)]

    def end(problem: li.Problem) -> list[float]:
        return li.simulate(problem, dt=1e-3, t_end=0.5, error=False, progress=False).q[-1].tolist()

    alone = [end(each) for each in starts]
    switches = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(8) as threads:
            assert list(threads.map(end, starts)) == alone
    finally:
        sys.setswitchinterval(switches)
