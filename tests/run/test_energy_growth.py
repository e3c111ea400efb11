"""Energy that nothing supplies: a run that holds much of it is not called solved."""

import numpy as np
import pytest

from lcpimpact import Bumper, KelvinVoigtStop, Load, Mass, Problem, Scheme, Spring, load_problem, penalized, simulate
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


@pytest.mark.parametrize("method", [name for name in METHODS if name not in ("rk4-paper",)])
def test_what_rests_at_the_start_stays_solved(method):
    """Loads of a step, and rounding, move what rests by energies that are all there is."""
    scheme = Scheme(Mass("x", 2.0), Load("x", 19.62), Bumper("x", "ground", e=0.3))
    assert simulate(Problem("rest", scheme), method, dt=1e-2, t_end=1.0).status is Status.SOLVED


def test_a_plate_on_a_stop_settles():
    scheme = Scheme(Mass("x", 2.0), Load("x", 19.62), KelvinVoigtStop("x", "ground", k=1e4, c=20.0))
    run = simulate(Problem("settles", scheme), "moreau-jean", dt=1e-3, t_end=2.0)
    assert run.status is Status.SOLVED
    assert run["x"][-1] == pytest.approx(19.62 / 1e4, rel=1e-3)
