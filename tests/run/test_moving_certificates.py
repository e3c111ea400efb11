"""Certificates of runs of Lagrangian systems: right ones hold at coarse and fine steps, each fault is found by its law."""

import dataclasses

import numpy as np
import pytest

import lcpimpact as li
from lcpimpact.certificate.impact_gain import gain_eigenvalue

G = 9.81


def problem(name, system, q0, v0=None, t_end=2.0):
    """A problem with initial values in the order of the coordinates."""
    q = dict(zip(system.nodes, q0, strict=True))
    return li.Problem(name, system, q0=q, v0=dict(zip(system.nodes, v0 or [0.0] * len(q), strict=True)), t_end=t_end)


def pendulum(e=0.8, Ω=0.0, drag=0.0):
    """A pendulum that strikes a wall, which may move."""
    wall = li.FrictionContact("wall", gap=lambda t, q: 0.3 + 0.1 * np.sin(Ω * t) - q[0], e=e)
    Q = (lambda t, q, v: -drag * v) if drag else None
    return problem("pendulum", li.Lagrangian("φ", lambda q: [[1.0]], lambda q: -G * np.cos(q[0]), Q, [wall]), [-1.0])


def double_pendulum(e=0.5, coupling=1.0):
    """Two hinged rods whose end strikes a stop; without ``coupling`` their masses do not depend on the motion."""

    def M(q):
        c = coupling * np.cos(q[0] - q[1])
        return [[2.0, c], [c, 1.0]]

    stop = li.FrictionContact("stop", gap=lambda t, q: 0.2 - np.sin(q[0]) - np.sin(q[1]), e=e)
    system = li.Lagrangian("a b", M, lambda q: -G * (2.0 * np.cos(q[0]) + np.cos(q[1])), contacts=[stop])
    return problem("double pendulum", system, [-0.8, -0.3])


def ball(mu=0.2, e=0.5, side=1.0):
    """A ball that is dropped with spin, and comes to rest; friction with ``side`` -1 is that of the other spin."""
    floor = li.FrictionContact(
        "floor", gap=lambda t, q: q[1] - 0.1, slip=lambda t, q, v: v[0] + side * 0.1 * v[2], mu=mu, e=e
    )
    system = li.Lagrangian("x y φ", lambda q: np.diag([1.0, 1.0, 0.004]), lambda q: G * q[1], contacts=[floor])
    return problem("ball", system, [0.0, 0.6, 0.0], [0.0, 0.0, 50.0], t_end=3.0)


def bowl(radius=1.0, mu=1.0):
    """A disc of radius 0.1 m that rolls in a bowl."""
    way = radius - 0.1
    contact = li.FrictionContact(
        "bowl", gap=lambda t, q: way - np.sqrt(q[0] ** 2 + q[1] ** 2),
        slip=lambda t, q, v: (v[1] * q[0] - v[0] * q[1]) / np.sqrt(q[0] ** 2 + q[1] ** 2) + 0.1 * v[2], mu=mu,
    )  # fmt: skip
    system = li.Lagrangian("x y φ", lambda q: np.diag([1.0, 1.0, 0.005]), lambda q: G * q[1], contacts=[contact])
    return problem("bowl", system, [way * np.sin(0.6), -way * np.cos(0.6), 0.0])


def rod(e=0.8, length=1.0):
    """A rod on a pin of two joints, in three coordinates, that strikes a wall."""
    half = 0.5 * length
    pin = [
        li.Joint("p", gap=lambda t, q: q[0] - half * np.sin(q[2])),
        li.Joint("s", gap=lambda t, q: q[1] + half * np.cos(q[2])),
    ]
    wall = li.FrictionContact("wall", gap=lambda t, q: 0.3 - q[0] - half * np.sin(q[2]), e=e)
    system = li.Lagrangian("x y φ", lambda q: np.diag([1.0, 1.0, 1 / 12]), lambda q: G * q[1], None, [wall], pin)
    return problem("rod", system, [half * np.sin(-1.0), -half * np.cos(1.0), -1.0])


PROBLEMS = {make.__name__: make for make in (pendulum, double_pendulum, ball, bowl, rod)}


def run_of(of, steps=400, method="moreau-jean", **options):
    return li.simulate(of, method, dt=of.t_end / steps, progress=False, throw=False, error=False, **options)


def beyond(certificate):
    """Return the violations beyond their limits."""
    return {name for name, limit in certificate.limits.items() if not getattr(certificate, name) <= limit}


@pytest.fixture(scope="module")
def runs():
    return {name: run_of(make()) for name, make in PROBLEMS.items()}


@pytest.mark.parametrize("steps", [60, 400])
@pytest.mark.parametrize("name", PROBLEMS)
def test_runs_hold_at_coarse_and_at_fine_steps(name, steps):
    run = run_of(PROBLEMS[name](), steps)
    assert run.success, run.message
    assert run.certificate.limits["momentum"] > 0.0


@pytest.mark.parametrize("method", ["moreau-midpoint", "newmark-ns", "stormer-verlet-ns", "event-driven"])
@pytest.mark.parametrize("name", ["pendulum", "double_pendulum", "rod"])
def test_runs_of_other_methods_hold(name, method):
    run = run_of(PROBLEMS[name](), 200, method)
    assert run.success, run.message


@pytest.mark.parametrize("method", ["rattle-ns", "schatzman-paoli", "generalized-alpha"])
@pytest.mark.parametrize("name", ["pendulum", "double_pendulum"])
def test_runs_of_methods_that_hold_positions_hold(name, method):
    run = run_of(PROBLEMS[name](), 200, method)
    assert run.success, run.message


FAULTS = {
    "without gyroscopic terms": ("double_pendulum", lambda: double_pendulum(coupling=0.0), {"momentum"}),
    "friction on the wrong side": ("ball", lambda: ball(side=-1.0), {"momentum"}),
    "less friction": ("ball", lambda: ball(mu=0.1), {"impact_law"}),
    "less friction where it rolls": ("bowl", lambda: bowl(mu=0.05), {"tension"}),
    "another restitution": ("double_pendulum", lambda: double_pendulum(e=0.6), {"impact_law"}),
    "another restitution with joints": ("rod", lambda: rod(e=0.6), {"impact_law"}),
    "no restitution": ("pendulum", lambda: pendulum(e=0.0), {"impact_law"}),
    "a wall that moves": ("pendulum", lambda: pendulum(Ω=3.0), {"impact_law"}),
    "a drag": ("pendulum", lambda: pendulum(drag=0.1), {"momentum"}),
    "a smaller bowl": ("bowl", lambda: bowl(radius=0.95), {"penetration"}),
    "a shorter rod": ("rod", lambda: rod(length=0.9), {"penetration", "momentum"}),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_run_is_none_of_another_problem(runs, fault):
    name, other, laws = FAULTS[fault]
    assert laws <= beyond(runs[name].certify(other()))


CHANGES = {
    "reactions of a hundredth more": ("bowl", "reaction", lambda r: 1.01 * r, "momentum"),
    "friction of the other sign": ("bowl", "reaction", lambda r: r * np.array([1.0, -1.0]), "momentum"),
    "a force at a distance": ("pendulum", "reaction", lambda r: r + 1.0, "complementarity"),
    "a jump of the place": ("double_pendulum", "q", lambda q: q + 1e-3 * (np.arange(len(q)) > 200)[:, None], "kinematics"),
    "more speed": ("double_pendulum", "v", lambda v: v * (1.0 + 0.01 * (np.arange(len(v)) > 200))[:, None], "momentum"),
    "joints that open": ("rod", "q", lambda q: q + np.array([1e-3, 0.0, 0.0]), "penetration"),
}  # fmt: skip


@pytest.mark.parametrize("change", CHANGES)
def test_a_planted_fault_is_found_by_its_own_law(runs, change):
    name, part, fault, law = CHANGES[change]
    changed = dataclasses.replace(runs[name], **{part: fault(getattr(runs[name], part))})
    assert law in beyond(changed.certify())


@pytest.mark.parametrize("name", ["pendulum", "double_pendulum", "bowl", "rod"])
def test_steps_of_ten_periods_are_found(name):
    period = 2.0
    run = li.simulate(
        PROBLEMS[name](), "moreau-jean", dt=10.0 * period, t_end=60.0 * period, progress=False, throw=False, error=False
    )
    assert not run.success
    assert beyond(run.certificate) & {"missed_impulse", "energy_growth"}


def test_an_impact_that_gains_energy_is_told():
    """Kane's two hinged rods: without tangential restitution the energy grows, with one e for both it does not."""

    def rods(e_T):
        tip = li.FrictionContact(
            "tip", gap=lambda t, q: 1.80571802 - np.cos(q[0]) - np.cos(q[1]),
            slip=lambda t, q, v: np.cos(q[0]) * v[0] + np.cos(q[1]) * v[1], mu=0.5, e=0.5, e_T=e_T,
        )  # fmt: skip
        c = lambda q: 0.5 * np.cos(q[0] - q[1])  # noqa: E731
        system = li.Lagrangian("a b", lambda q: [[4 / 3, c(q)], [c(q), 1 / 3]], contacts=[tip])
        return problem("rods", system, np.radians([20.0, 30.0]) + 1e-3, [-0.1, -0.2], t_end=0.02)

    run, other = run_of(rods(0.0)), run_of(rods(0.5))
    assert run.success, run.message
    gain = run.certificate.impact_gain
    T = run.dynamics.kinetic_energy(run.q, run.v)
    assert gain.gained == pytest.approx(T[-1] - T[0], rel=1e-3)
    assert gain.gained == pytest.approx(0.0368003665813 - 0.0231814108635, rel=3e-2)  # at 20° and 30°, in 12 digits
    assert gain.eigenvalue < 0.0
    assert other.success
    assert other.certificate.impact_gain.gained == 0.0
    d = run.dynamics
    assert gain_eigenvalue(d.at(0.0, run.q[0], run.v[0])) == pytest.approx(gain.eigenvalue, rel=1e-2)


@pytest.mark.parametrize("make", [pendulum, ball, rod, lambda: pendulum(Ω=3.0, drag=0.3)])
def test_the_ledger_accounts_for_losses_drives_and_moving_walls(make):
    """The balance falls with the step, and what is dissipated is what is missing."""
    coarse, fine = (li.energy_ledger(run_of(make(), steps)) for steps in (200, 1600))
    assert fine.balance <= 0.3 * coarse.balance + 1e-12
    end = fine.table.iloc[-1]
    assert end["kinetic"] + end["elastic"] + end[list(fine.dissipated)].sum() == pytest.approx(
        fine.table["kinetic"].iloc[0] + end["loads"] + end["motions"], abs=2.0 * fine.balance + 1e-12
    )


def test_a_run_is_printed_saved_and_read(runs, tmp_path):
    run = runs["rod"]
    assert "impact wall" in str(run).replace("\n", " ")
    assert run.summary()["restitution"] == pytest.approx(0.8, abs=0.02)
    run.save(tmp_path / "run.npz")
    alone, again = li.read_run(tmp_path / "run.npz"), li.read_run(tmp_path / "run.npz", PROBLEMS["rod"]())
    assert alone.lacks == "scheme"
    assert again.certify().holds
    assert again["v_φ"] == pytest.approx(run["v_φ"])
    assert "wall" in run.problem._repr_html_()
    with pytest.raises(li.UnsupportedError, match="how its bodies look: build it of Body"):
        run.animate(tmp_path / "run.gif")


def test_the_error_of_a_run_is_estimated_by_halving():
    error = run_of(double_pendulum(), 200, "moreau-jean").estimate_error("halving")
    truth = run_of(double_pendulum(), 200, "event-driven")
    run = run_of(double_pendulum(), 200)
    off = np.abs(run["a"] - truth["a"]).max()
    assert 0.3 * off < error["a"] < 10.0 * off


@pytest.mark.parametrize("method", ["event-driven", "moreau-jean", "newmark-ns", "radau", "cd-lagrange"])
def test_a_ball_that_falls_straight_on_a_rough_floor_holds(method):
    """It neither slides nor turns but for rounding, which is no speed to judge its friction by."""
    ball = li.Problem("straight", li.load_problem("ball-with-spin").scheme, q0={"y": 1.0}, units={"φ": "rad"})
    run = li.simulate(ball, method, dt=1e-2, t_end=1.5, throw=False, error=False, progress=False)
    assert run.success, run.message
    assert np.abs(run["v_x"]).max() < 1e-13
