"""Energy that nothing supplies: a run that holds much of it is not called solved."""

from dataclasses import replace

import numpy as np
import pytest

from lcpimpact import (
    Bumper,
    Dashpot,
    Force,
    Harmonic,
    HertzSpring,
    KelvinVoigtStop,
    Load,
    Mass,
    NegativeSpring,
    PrescribedMotion,
    Problem,
    Scheme,
    Spring,
    Table,
    UnsupportedError,
    load_problem,
    penalized,
    simulate,
)
from lcpimpact.errors import Status
from lcpimpact.integrators import METHODS

STIFF = penalized(load_problem("bouncing-ball", e=0.8), "kelvin-voigt", k=1e8)
"""The contact lasts 0.3 ms."""


@pytest.mark.parametrize("method", ["heun", "rk4", "dopri5", "bs23", "moreau-jean"])
@pytest.mark.parametrize("n", [2000, 2003, 1500])
def test_a_ball_that_is_thrown_up_is_not_called_solved(method, n):
    """The ball falls from 1 m. With a step of 1 ms the contact is passed in one step, and energy is made."""
    run = simulate(STIFF, method, dt=2.0 / n, t_end=2.0, throw=False)
    highest = -run["x"].min()
    assert run.status is not Status.SOLVED or highest < 1.0
    fine = simulate(STIFF, "event-driven", dt=2.0 / n, t_end=2.0)
    assert fine.status is Status.SOLVED
    assert fine.certificate.energy_growth == 0.0
    assert -fine["x"].min() < 1e-9


def test_an_unstable_oscillation_is_not_called_solved():
    """RK4 is unstable for h ω > 2.83; here the amplitude grows a thousand times before the numbers overflow."""
    problem = Problem("spring", Scheme(Mass("x", 1.0), Spring("x", "ground", 8.1)), q0={"x": 1.0})
    run = simulate(problem, "rk4", dt=1.0, t_end=60.0, throw=False)
    assert np.abs(run.q).max() > 10.0
    assert run.status is not Status.SOLVED


SPHERE = load_problem("hertz-impact")
"""A steel sphere touches a wall for 70 µs, and leaves it at the speed at which it came."""


@pytest.mark.parametrize("method", ["heun", "rk4", "dopri5", "moreau-jean", "newmark-ns", "stormer-verlet-ns"])
@pytest.mark.parametrize("n", [300, 500, 1000, 3000])
def test_a_sphere_leaves_about_as_fast_as_it_came(method, n):
    """The energy may change by a fifth, so the speed by its root. Heun's method with 3 steps in the contact adds a third.

    Moreau and Jean's with 5 steps takes two fifths.
    """
    problem = Problem("sphere", SPHERE.scheme, q0={"x": -0.01}, v0={"x": 1.0})
    run = simulate(problem, method, dt=0.02 / n, t_end=0.02, throw=False)
    assert (run.status is Status.SOLVED) == (np.sqrt(0.8) < abs(run.v[-1, 0]) < np.sqrt(1.2))


@pytest.mark.parametrize("n", [500, 510])
def test_two_balls_do_not_rebound_faster_than_they_fell(n):
    """e = 1: they fall at 4.43 m/s, and by two impacts in one step of Schatzman and Paoli leave at 6.1."""
    problem = load_problem("two-ball-drop")
    assert not simulate(problem, "schatzman-paoli", dt=problem.t_end / n, throw=False).success
    assert simulate(problem, "schatzman-paoli", dt=problem.t_end / 5000).success


@pytest.mark.parametrize("method", ["moreau-jean", "rk4", "event-driven", "newmark-ns"])
def test_the_force_of_a_contact_far_away_hides_no_error(method):
    """At |q| the spring of the contact would have 5e17 N. The velocity changes by 0.1 % in the air, where nothing acts."""
    problem = Problem("sphere", SPHERE.scheme, q0={"x": -1e5}, v0={"x": 1.0})
    run = simulate(problem, method, dt=1e-2, t_end=1.0)
    v = run.v.copy()
    v[50:] *= 1.001
    assert not replace(run, v=v, dense=None).certify().holds


FAST = 8.1
"""ω² of a body of 1 kg: with a step of 1 s, h ω = 2.85 is beyond the limits of all explicit methods."""

DRIVEN = {
    "by a load": (Spring("x", "ground", FAST), Load("x", Harmonic(1.0, 0.5))),
    "by a load, with a dashpot": (
        Spring("x", "ground", FAST),
        Dashpot("x", "ground", 0.1),
        Load("x", Harmonic(1.0, 0.5)),
    ),
    "by its base": (Spring("x", "base", FAST), PrescribedMotion("base", Harmonic(0.1, 0.5))),
}


@pytest.mark.parametrize("drive", DRIVEN)
@pytest.mark.parametrize("method", [name for name in METHODS if name not in ("rk4-paper",)])
def test_a_driven_oscillation_that_is_unstable_is_not_called_solved(method, drive):
    """The work of the drive is bounded by its force times the way of the body; what is far beyond it is made of nothing."""
    problem = Problem("driven", Scheme(Mass("x", 1.0), *DRIVEN[drive]))
    try:
        run = simulate(problem, method, dt=1.0, t_end=60.0, throw=False)
    except UnsupportedError:
        return
    resonance = 1.0 / (FAST - 0.5**2)
    bounded = np.abs(run["x"]).max() < 3.0 * resonance
    assert (run.status is Status.SOLVED or "lose" in run.message) == bounded


@pytest.mark.parametrize("method", ["heun", "dopri5", "rk4", "moreau-jean", "stormer-verlet-ns"])
def test_a_ball_on_a_stiff_stop_that_a_load_shakes_is_not_called_solved_where_it_is_thrown_up(method):
    stop = KelvinVoigtStop("x", "ground", k=1e8, c=100.0, gap=1.0)
    scheme = Scheme(Mass("x", 1.0), Load("x", 9.81), Load("x", Harmonic(3.0, 7.0)), stop)
    run = simulate(Problem("shaken", scheme), method, dt=1e-3, t_end=2.0, throw=False)
    assert run.status is not Status.SOLVED or -run["x"].min() < 0.5


FORCED = ["moreau-jean", "heun", "ssprk3", "bs23", "rk4", "dopri5"]


@pytest.mark.parametrize("method", FORCED)
def test_a_ball_on_a_stop_that_a_function_describes_is_not_called_solved_where_it_is_thrown_up(method):
    """The same contact of 0.3 ms as a function, of which a step of 1 ms knows one or two values."""
    stop = Force(("x",), lambda t, q, v: np.where(q > 0.0, -1e8 * q, 0.0))
    problem = Problem("stop", Scheme(Mass("x", 1.0), Load("x", 9.81), stop), q0={"x": -1.0})
    run = simulate(problem, method, dt=1e-3, t_end=2.0, throw=False)
    assert -run["x"].min() > 5.0
    assert run.status is not Status.SOLVED


@pytest.mark.parametrize("method", FORCED)
@pytest.mark.parametrize("dt", [0.02, 0.1])
def test_a_self_excited_oscillation_is_supplied_by_its_force(method, dt):
    """Van der Pol's oscillator grows from 0.01 to 2.02 in 13 s and stays there."""
    pump = Force(("x",), lambda t, q, v: (1.0 - q**2) * v)
    problem = Problem("van der pol", Scheme(Mass("x", 1.0), Spring("x", "ground", 1.0), pump), q0={"x": 0.01})
    run = simulate(problem, method, dt=dt, t_end=30.0)
    assert np.abs(run["x"]).max() == pytest.approx(2.01, abs=0.03)


@pytest.mark.parametrize("method", ["moreau-jean", "heun", "rk4", "stormer-verlet-ns", "cd-lagrange"])
def test_a_body_that_a_negative_spring_drives_away_gains_what_the_spring_loses(method):
    """x = 0.01 cosh 2t: kinetic energies of 1e13 J that those of the spring cancel to 1e-4 J."""
    scheme = Scheme(Mass("x", 1.0), NegativeSpring("x", "ground", 4.0))
    run = simulate(Problem("away", scheme, q0={"x": 0.01}), method, dt=0.05, t_end=10.0)
    assert run["x"][-1] == pytest.approx(0.01 * np.cosh(20.0), rel=0.04)


@pytest.mark.parametrize("method", ["moreau-jean", "radau", "heun", "rk4"])
def test_a_base_that_rises_in_one_step_supplies_energy(method):
    """A base that moves by 0.1 m at once puts ½ k (0.1 m)² into the spring of a body at rest."""
    rise = Table([0.0, 0.5, 0.51, 2.0], [0.0, 0.0, 0.1, 0.1])
    scheme = Scheme(Mass("x", 1.0), Spring("x", "base", 100.0), PrescribedMotion("base", rise))
    run = simulate(Problem("rise", scheme), method, dt=1e-2, t_end=2.0)
    assert run.certificate.energy_scale == pytest.approx(0.5, rel=0.1)
    assert run.certificate.energy_growth < 0.05


@pytest.mark.parametrize("method", [name for name in METHODS if name not in ("rk4-paper",)])
def test_what_rests_at_the_start_stays_solved(method):
    """Loads of a step, and rounding, move what rests by energies that are all there is."""
    scheme = Scheme(Mass("x", 2.0), Load("x", 19.62), Bumper("x", "ground", e=0.3))
    assert simulate(Problem("rest", scheme), method, dt=1e-2, t_end=1.0).status is Status.SOLVED


@pytest.mark.parametrize("method", ["heun", "rk4", "stormer-verlet-ns", "moreau-jean"])
def test_a_ball_that_a_hertzian_contact_throws_up_is_not_called_solved(method):
    """At the height of its flight, 2 m to 10 km, the law would give a force of 1e12 to 1e18 N, but there is no contact."""
    hertz = HertzSpring("x", "ground", K=1e12, gap=0.1)
    problem = Problem("hertz", Scheme(Mass("x", 1.0), Load("x", 9.81), hertz))
    run = simulate(problem, method, dt=1e-3, t_end=2.0, throw=False)
    assert -run["x"].min() > 1.0
    assert run.status is not Status.SOLVED


def test_a_plate_on_a_stop_settles():
    scheme = Scheme(Mass("x", 2.0), Load("x", 19.62), KelvinVoigtStop("x", "ground", k=1e4, c=20.0))
    run = simulate(Problem("settles", scheme), "moreau-jean", dt=1e-3, t_end=2.0)
    assert run.status is Status.SOLVED
    assert run["x"][-1] == pytest.approx(19.62 / 1e4, rel=1e-3)
