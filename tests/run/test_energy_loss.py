"""Energy that no element takes: each method loses it in smooth motion at the order that it declares, and no more."""

import math
from dataclasses import replace

import numpy as np
import pytest

from lcpimpact import (
    Bumper,
    Dashpot,
    Harmonic,
    HertzSpring,
    KelvinVoigtStop,
    Load,
    Mass,
    PrescribedMotion,
    Problem,
    Scheme,
    SparseScheme,
    Spring,
    load_problem,
    simulate,
)
from lcpimpact.errors import Status
from lcpimpact.integrators import METHODS

PERIOD = 2.0 * math.pi / 10.0
VIBRATION = Problem("vibration", Scheme(Mass("x", 1.0), Spring("x", "ground", 100.0)), q0={"x": 1.0})
"""It has 50 J for ever."""

GENERAL = [name for name in METHODS if name != "rk4-paper"]

OPTIONS = [
    ("moreau-jean", {"theta": 1.0}, 1.0),
    ("moreau-jean", {"theta": 0.6}, 1.0),
    ("newmark-ns", {"gamma": 0.7, "beta": 0.36}, 1.0),
    ("newmark-ns", {"alpha": -0.1}, 3.0),
    ("generalized-alpha", {"rho_inf": 1.0}, math.inf),
    ("generalized-alpha", {"rho_inf": 0.0}, 3.0),
    ("radau", {"stages": 1}, 1.0),
    ("radau", {"stages": 2}, 3.0),
    ("radau-fesd", {"stages": 2}, 3.0),
]


def lost(method, steps, **options):
    """Return the logarithm of the ratio of the mean energies in the first and the last of three periods."""
    run = simulate(VIBRATION, method, dt=PERIOD / steps, t_end=3.0 * PERIOD, throw=False, error=False, **options)
    E = 0.5 * run.v[:, 0] ** 2 + 50.0 * run.q[:, 0] ** 2
    assert run.certificate.energy_loss <= 1e-3 * 50.0, "what is declared is no loss beyond it"
    return math.log(E[:steps].mean() / E[-steps:].mean())


@pytest.mark.parametrize(
    ("method", "options", "order"), [(name, {}, METHODS[name].declared.order_loss) for name in GENERAL] + OPTIONS
)
def test_energy_is_lost_in_smooth_motion_at_the_declared_order(method, options, order):
    assert METHODS[method](**options).own_loss()[0] == order
    few, many = (20, 40) if 3.0 < order < math.inf else (200, 400)
    coarse, fine = (lost(method, steps, **options) for steps in (few, many))
    assert fine < 1e-7 or math.log2(coarse / fine) > order - 0.2, (coarse, fine)


DRIVEN = (
    Mass("x", 1.0), Mass("y", 2.0), Spring("x", "ground", 100.0), Spring("x", "y", 50.0), Dashpot("y", "ground", 0.3),
    Load("x", Harmonic(5.0, 3.0)), Bumper("y", "ground", gap=0.05, e=0.5),
    Spring("y", "base", 30.0), PrescribedMotion("base", Harmonic(0.1, 4.0)),
)  # fmt: skip


@pytest.mark.parametrize("scheme", [Scheme, SparseScheme])
@pytest.mark.parametrize("θ", [0.55, 0.75, 1.0])
def test_a_theta_step_loses_what_it_declares_and_nothing_else(scheme, θ):
    """(θ - 1/2) (Δv·M Δv + Δq·K Δq) in each step, to rounding, with loads, motions, dashpots and impacts."""
    problem = Problem("driven", scheme(*DRIVEN), q0={"x": 1.0})
    c = simulate(problem, "moreau-jean", theta=θ, dt=5e-3, t_end=2.0, error=False).certificate
    assert c.energy_balance > 0.1 * c.energy_scale
    assert c.energy_loss < 1e-11 * c.energy_scale
    assert c.energy_loss < c.limits["energy_loss"] < 1e-7 * c.energy_scale


@pytest.mark.parametrize("θ", [0.6, 1.0])
def test_a_loss_that_a_theta_step_does_not_declare_is_found(θ):
    """A dashpot of 1e-5 N s/m takes 2e-3 J of 50 J; a certificate without it misses them, and sees the momentum off."""
    damped = Problem("damped", Scheme(*VIBRATION.scheme.elements, Dashpot("x", "ground", 1e-5)), q0={"x": 1.0})
    run = simulate(damped, "moreau-jean", theta=θ, dt=1e-3, t_end=1.0, error=False)
    assert run.certificate.energy_loss < run.certificate.limits["energy_loss"]
    found = run.certify(VIBRATION)
    taken = 1e-5 * float((np.diff(run.q[:, 0]) ** 2 / np.diff(run.t)).sum())
    assert found.energy_loss == pytest.approx(taken, rel=1e-6)
    assert found.energy_loss > found.limits["energy_loss"]


def test_the_ledger_of_the_certificate_knows_the_loss_of_a_step():
    """Of moreau-jean with θ = 1 it is the sum of (Δv·M Δv + Δq·K Δq)/2."""
    run = simulate(VIBRATION, "moreau-jean", theta=1.0, dt=1e-2, t_end=1.0, error=False)
    own = 0.5 * float((np.diff(run.v[:, 0]) ** 2 + 100.0 * np.diff(run.q[:, 0]) ** 2).sum())
    assert run.certificate.energy_balance == pytest.approx(own, rel=1e-12)
    assert own == pytest.approx(50.0 * (1.0 - 1.01**-100), rel=1e-12), "a step divides the energy by 1 + ω² h²"


@pytest.mark.parametrize("method", ["newmark-ns", "rk4", "heun", "radau", "stormer-verlet-ns", "generalized-alpha"])
def test_a_fifth_of_the_energy_that_is_lost_on_the_way_is_found(method):
    """From half way on velocities are 0.8 or 0.95 times those of the run: 18 J or 4.9 J of 50 J are missing."""
    run = simulate(VIBRATION, method, dt=1e-3, t_end=1.0, error=False)
    for factor in (0.8, 0.95):
        v = run.v.copy()
        v[500:] *= factor
        found = replace(run, v=v, dense=None).certify()
        assert found.energy_loss == pytest.approx(50.0 * (1.0 - factor**2), rel=0.2)
        assert (found.energy_loss > found.limits["energy_loss"]) == (factor == 0.8)


def test_a_theta_step_through_a_hertzian_contact_may_lose_a_fifth():
    """The balance of a non-linear spring is no identity; what θ = 1 loses in it is declared all the same."""
    scheme = Scheme(Mass("x", 1.0), HertzSpring("x", "ground", K=1e4, gap=0.1))
    run = simulate(Problem("hertz", scheme, v0={"x": 1.0}), "moreau-jean", theta=1.0, dt=1e-3, t_end=0.5, error=False)
    assert run.status is Status.SOLVED
    assert run.certificate.energy_balance > 1e-2 * run.certificate.energy_scale
    assert run.certificate.energy_loss < 1e-3 * run.certificate.energy_scale


def test_the_work_of_a_slider_within_a_step_is_no_loss():
    """The trapezoidal rule misses the work of a slider in the steps in which it turns: a third of the stored energy."""
    problem = load_problem("jenkins-cycle")
    run = simulate(problem, "radau", dt=problem.t_end / 400, error=False)
    assert run.certificate.energy_balance > 0.2 * run.certificate.energy_scale
    assert run.certificate.energy_loss < 1e-3 * run.certificate.energy_scale


@pytest.mark.parametrize("method", ["stormer-verlet-ns", "rk4", "moreau-midpoint", "generalized-alpha", "radau"])
def test_a_long_driven_motion_of_few_steps_is_right(method):
    """With 16 steps a period the works of load and dashpot are off by some hundredths, of many times the stored energy."""
    scheme = Scheme(
        Mass("x", 1.0), Spring("x", "ground", 100.0), Dashpot("x", "ground", 2.0), Load("x", Harmonic(50.0, 10.0))
    )
    run = simulate(Problem("driven", scheme), method, dt=PERIOD / 16, t_end=80 * PERIOD, error=False)
    assert run.status is Status.SOLVED
    assert np.abs(run["x"][-160:]).max() == pytest.approx(2.5, rel=0.05)


CONSTANTS = [
    *((name, {}) for name in ("ssprk3", "bs23", "rk4", "dopri5", "radau", "generalized-alpha")),
    *(("radau", {"stages": stages}) for stages in (1, 2)),
    ("generalized-alpha", {"rho_inf": 0.0}),
    ("newmark-ns", {"alpha": -0.1}),
    ("newmark-ns", {"gamma": 0.7, "beta": 0.36}),
    ("moreau-jean", {"theta": 0.7}),
]


@pytest.mark.parametrize(("method", "options"), CONSTANTS)
def test_a_step_loses_the_declared_part_of_the_energy(method, options):
    """c (ω h)^(p + 1) in each step."""
    limits, steps = METHODS[method](**options).limits(), 100
    part = lost(method, steps, **options) / (2 * steps)
    assert part == pytest.approx(limits.loss_constant * (2.0 * math.pi / steps) ** (limits.order_loss + 1.0), rel=0.05)


def thrown_back(k, dt, **options):
    """Return the run of 1 kg that meets a stop on a spring at 1 m/s after .105 m, and leaves it at -1 m/s."""
    stop = Scheme(Mass("x", m=1.0), Bumper("x", "z", gap=0.105), Spring("z", "ground", k=k))
    return simulate(Problem("stop", stop, v0={"x": 1.0}), dt=dt, t_end=0.4, throw=False, error=False, **options)


@pytest.mark.parametrize("ωh", [1e-2, 0.3, 0.5])
def test_a_spring_throws_a_body_back(ωh):
    run = thrown_back((ωh / 1e-3) ** 2, 1e-3)
    assert run.certificate.holds
    assert run["v_x"][-1] == pytest.approx(-1.0, abs=0.1)


@pytest.mark.parametrize("theta", [0.5, 0.7, 1.0])
@pytest.mark.parametrize("ωh", [1.8, 10.0, 1e3])
def test_a_spring_that_stops_a_body_within_a_step_is_no_solution(ωh, theta):
    run = thrown_back((ωh / 1e-2) ** 2, 1e-2, theta=theta)
    assert run["v_x"][-1] > -0.9
    assert run.status is Status.VIOLATED
    assert "take shorter ones" in run.message


def test_a_body_that_rests_on_a_stiff_spring_loses_nothing():
    floor = Scheme(Mass("x", m=1.0), Load("x", f=9.81), Bumper("x", "z", gap=1e-9), Spring("z", "ground", k=1e9))
    run = simulate(Problem("floor", floor), dt=1e-2, t_end=0.5, error=False)
    assert run.certificate.holds
    assert abs(run["x"]).max() < 1e-7


DAMPED_STOPS = ["newmark-ns", "cd-lagrange", "rk4", "stormer-verlet-ns", "generalized-alpha"]


def stopped(method, c):
    """Return the run of 1 kg at 1 m/s that a stop's dashpot stops from .105 m on, within 1/c."""
    stop = Scheme(Mass("x", m=1.0), KelvinVoigtStop("x", "ground", k=1e-3, c=c, gap=0.105))
    return simulate(Problem("stop", stop, v0={"x": 1.0}), method, dt=1e-2, t_end=0.4, throw=False, error=False)


@pytest.mark.parametrize("method", DAMPED_STOPS)
@pytest.mark.parametrize("c", [1.0, 50.0, 90.0])
def test_a_damped_stop_brakes_a_body(method, c):
    run = stopped(method, c)
    assert run.certificate.holds
    assert run["x"][-1] == pytest.approx(0.105 - math.expm1(-c * 0.295) / c, abs=5e-3)


@pytest.mark.parametrize("method", DAMPED_STOPS)
@pytest.mark.parametrize("c", [600.0, 1e4, 1e6])
def test_a_body_that_damping_throws_back_is_no_solution(method, c):
    run = stopped(method, c)
    assert run["x"][-1] < 0.05 or method == "rk4"
    assert run.status is Status.VIOLATED
