"""Energy that no element takes: a run that loses much of it is not called solved."""

from dataclasses import replace

import numpy as np
import pytest

from lcpimpact import (
    Bumper,
    Dashpot,
    Harmonic,
    InputError,
    Load,
    Mass,
    PrescribedMotion,
    Problem,
    Scheme,
    Spring,
    UnsupportedError,
    load_problem,
    simulate,
)
from lcpimpact.errors import Status
from lcpimpact.integrators import METHODS

VIBRATION = Problem("vibration", Scheme(Mass("x", 1.0), Spring("x", "ground", 100.0)), q0={"x": 1.0})
"""It has 50 J for ever."""

GENERAL = [name for name in METHODS if name != "rk4-paper"]


def lost(method, steps, **options):
    """Return the energy that a run of one second loses, by its certificate and by the quadratic form at its points."""
    run = simulate(VIBRATION, method, dt=1.0 / steps, t_end=1.0, throw=False, error=False, **options)
    own = float((50.0 - 0.5 * run.v[:, 0] ** 2 - 50.0 * run.q[:, 0] ** 2).max())
    return run.certificate.energy_loss, own


@pytest.mark.parametrize(
    ("method", "options", "order"),
    [(name, {}, METHODS[name].declared.order_smooth) for name in GENERAL]
    + [
        ("moreau-jean", {"theta": 1.0}, 1.0),
        ("moreau-jean", {"theta": 0.6}, 1.0),
        ("generalized-alpha", {"rho_inf": 0.5}, 2.0),
        ("newmark-ns", {"alpha": -0.1}, 2.0),
        ("radau", {"stages": 1}, 1.0),
        ("radau", {"stages": 2}, 3.0),
    ],
)
def test_steps_lose_energy_in_smooth_motion_at_the_order_of_the_method_or_not_at_all(method, options, order):
    (coarse, own), (fine, _) = (lost(method, steps, **options) for steps in (200, 400))
    assert coarse == pytest.approx(max(own, 0.0), abs=1e-3 * own + 1e-6)
    assert fine < 1e-6 or np.log2(coarse / fine) > min(order, 5.0) - 0.25


@pytest.mark.parametrize("method", GENERAL)
def test_a_fifth_of_the_energy_that_is_lost_on_the_way_is_found(method):
    """From half way on velocities are 0.8 or 0.95 times those of the run: 18 J or 4.9 J of 50 J are missing."""
    run = simulate(VIBRATION, method, dt=1e-3, t_end=1.0, error=False)
    assert run.status is Status.SOLVED
    for factor in (0.8, 0.95):
        v = run.v.copy()
        v[500:] *= factor
        found = replace(run, v=v, dense=None).certify()
        assert found.energy_loss == pytest.approx(50.0 * (1.0 - factor**2), rel=0.01)
        assert (found.energy_loss > found.limits["energy_loss"]) == (factor == 0.8)


@pytest.mark.parametrize(("steps", "holds"), [(50, False), (200, False), (1000, True)])
def test_implicit_steps_that_damp_are_told_to_be_shorter(steps, holds):
    """A step of θ = 1 divides the energy by 1 + ω² h²: after a second of 200 steps 30 J are left of 50."""
    run = simulate(VIBRATION, "moreau-jean", theta=1.0, dt=1.0 / steps, t_end=1.0, throw=False, error=False)
    left = 50.0 * (1.0 + 100.0 / steps**2) ** -steps
    assert run.certificate.energy_loss == pytest.approx(50.0 - left, rel=1e-6)
    assert (run.status is Status.SOLVED) == holds
    if not holds:
        assert "J of energy that no element takes: take shorter steps, and θ = 1/2 if they damp" in run.message


@pytest.mark.parametrize("method", ["d1-minus", "cd-lagrange", "radau", "schatzman-paoli", "stormer-verlet-ns"])
def test_an_impact_that_is_late_within_its_step_is_no_loss(method):
    """e = 1: the ball keeps its energy, though at the ends of steps its speeds before and after an impact differ by g h."""
    scheme = Scheme(Mass("x", 0.6938), Load("x", 8.3292), Bumper("x", "ground", gap=0.2838, e=1.0))
    ball = Problem("ball", scheme, v0={"x": 0.42445})
    run = simulate(ball, method, dt=1e-2, t_end=2.0, throw=False, error=False)
    kept = 0.5 * 0.6938 * run.v[:, 0] ** 2 - 8.3292 * run.q[:, 0]
    assert run.certificate.energy_loss <= max(kept[0] - kept.min(), 0.0) + 0.02 * run.certificate.energy_scale


SUPPLIED = {
    "a damped body that a load drives": (
        Spring("x", "ground", 100.0), Dashpot("x", "ground", 20.0), Load("x", Harmonic(50.0, 9.0)),
    ),
    "a damped body that its base drives": (
        Spring("x", "base", 100.0), Dashpot("x", "base", 4.0), PrescribedMotion("base", Harmonic(0.3, 9.0)),
    ),
    "a body that a load drives on a stop": (
        Spring("x", "ground", 100.0), Load("x", Harmonic(20.0, 9.0)), Bumper("x", "ground", gap=0.05, e=0.4),
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", SUPPLIED)
@pytest.mark.parametrize("method", GENERAL)
def test_what_elements_take_is_no_loss(method, what):
    """In five seconds dashpots and impacts take many times the energy that is stored."""
    problem = Problem("driven", Scheme(Mass("x", 1.0), *SUPPLIED[what]))
    try:
        run = simulate(problem, method, dt=5e-3, t_end=5.0, throw=False, error=False)
    except (UnsupportedError, InputError):
        return
    assert run.status is Status.SOLVED, run.message
    assert run.certificate.energy_loss < 0.1 * run.certificate.energy_scale


def test_the_work_of_a_slider_within_a_step_is_no_loss():
    """The trapezoidal rule misses the work of a slider in the steps in which it turns: a third of the stored energy."""
    run = simulate(load_problem("jenkins-cycle"), "radau", dt=load_problem("jenkins-cycle").t_end / 400, error=False)
    assert run.certificate.energy_balance > 0.2 * run.certificate.energy_scale
    assert run.certificate.energy_loss < 1e-3 * run.certificate.energy_scale
    assert run.status is Status.SOLVED
