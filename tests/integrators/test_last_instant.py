"""Events with 0 <= t <= t_end are kept, and a run ends with the right limit of what happens at its last instant."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import lcpimpact as li
from lcpimpact.integrators import METHODS as EVERY
from lcpimpact.integrators.event_driven import SCIPY_SOLVERS
from lcpimpact.record import Grid

METHODS = ("exact", "event-driven", "radau-fesd")


def run(problem, method, t_end, steps=4, **options):
    return li.simulate(problem, method, dt=t_end / steps, t_end=t_end, progress=False, **options)


def flight(gap=1.0, v=1.0, m=3.0):
    """A body without forces that meets a wall at gap/v."""
    scheme = li.Scheme(li.Mass("x", m), li.Bumper("x", "ground", gap=gap, e=0.5))
    return li.Problem("flight", scheme, v0={"x": v})


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("steps", [1, 3, 4, 7])
@pytest.mark.parametrize(("gap", "v"), [(1.0, 1.0), (1.0, 10.0), (0.3, 3.0), (7e-9, 1e-3), (2e6, 3.0)])
def test_an_impact_at_the_last_instant_is_kept(method, steps, gap, v):
    t_end = gap / v
    found = run(flight(gap, v), method, t_end, steps)
    assert [(event.t, event.kind) for event in found.events] == [(pytest.approx(t_end, rel=1e-12), "impact")]
    assert found.events[0].impulse == pytest.approx(3.0 * 1.5 * v, rel=1e-12)
    assert found.t[-1] == t_end
    assert_allclose(found.v[:, 0], [v] * steps + [-0.5 * v], rtol=1e-12)
    assert_allclose(found.q[-1], gap, rtol=1e-12)
    assert found.certificate.energy_balance < 1e-10 * found.certificate.energy_scale
    left, right = (found.sample(t_end, side) for side in ("left", "right"))
    assert_allclose([left.v[0, 0], right.v[0, 0]], [v, -0.5 * v], rtol=1e-12)


@pytest.mark.parametrize("method", ["exact", "event-driven"])
@pytest.mark.parametrize("ω", [0.3, 2.0, 7.0])
def test_a_mass_on_a_spring_meets_the_wall_after_a_quarter_of_its_period(method, ω):
    """The instant is no number of the machine, and SciPy's solvers know it to their tolerance."""
    scheme = li.Scheme(li.Mass("x", 1.0), li.Spring("x", "ground", ω**2), li.Bumper("x", "ground", e=0.5))
    for halves in (0, 1, 2):
        t_end = (0.5 + halves) * math.pi / ω
        found = run(li.Problem("swing", scheme, q0={"x": -1.0}), method, t_end)
        assert [event.kind for event in found.events] == ["impact"] * (1 + halves)
        assert found.events[-1].t == pytest.approx(t_end, rel=1e-9)
        assert_allclose([found.q[-1, 0], found.v[-1, 0]], [0.0, -ω * 0.5 ** (1 + halves)], rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("solver", SCIPY_SOLVERS)
def test_every_solver_of_scipy_ends_with_the_impact(solver):
    found = run(flight(), "event-driven", 1.0, ode_solver=solver)
    assert [event.kind for event in found.events] == ["impact"]
    assert found.v[-1, 0] == pytest.approx(-0.5, rel=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_a_ball_that_falls_until_it_meets_the_ground(method):
    ball, t_1 = li.load_problem("bouncing-ball", e=0.8), math.sqrt(2.0 / 9.81)
    for number in (1, 2, 3):
        t_end = t_1 * (1.0 + 2.0 * sum(0.8**i for i in range(1, number)))
        found = run(ball, method, t_end, 50)
        assert [event.kind for event in found.events] == ["impact"] * number
        assert found.events[-1].t <= t_end
        assert_allclose(found.v[-1], -(0.8**number) * 9.81 * t_1, rtol=1e-9)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("early", [1e-8, 1e-6, 1e-2])
def test_an_event_after_the_end_is_none_of_the_run(method, early):
    found = run(flight(), method, 1.0 - early)
    assert found.events == ()
    assert_allclose(found.v[-1], 1.0, rtol=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_a_body_that_friction_stops_at_the_last_instant(method):
    scheme = li.Scheme(li.Mass("x", 2.0), li.Slider("x", "ground", r0=4.0))
    found = run(li.Problem("brake", scheme, v0={"x": 1.0}), method, 0.5)
    assert [event.kind for event in found.events][-1] == "stick"
    assert_allclose([found.q[-1, 0], found.v[-1, 0], found.reaction[-1, 0]], [0.25, 0.0, 0.0], rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_a_plate_that_is_met_at_the_last_instant_pushes(method):
    """The force of a dashpot under a massless plate jumps to c v when the plate is met."""
    scheme = li.Scheme(li.Mass("x", 1.0), li.Bumper("x", "z", gap=0.5), li.KelvinVoigt("z", "ground", k=100.0, c=8.0))
    found = run(li.Problem("buffer", scheme, v0={"x": 2.0}), method, 0.25)
    assert [(event.t, event.kind) for event in found.events] == [(pytest.approx(0.25, rel=1e-12), "close")]
    assert_allclose(found.reaction[:, 0], [0.0, 0.0, 0.0, 0.0, 16.0], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_a_run_goes_on_from_its_last_instant_as_a_longer_one_does(method):
    first = run(flight(), method, 1.0)
    scheme = flight().scheme
    rest = run(li.Problem("rest", scheme, q0={"x": min(first.q[-1, 0], 1.0)}, v0={"x": first.v[-1, 0]}), method, 1.0)
    whole = run(flight(), method, 2.0, 8)
    assert_allclose(rest.q[-1], whole.q[-1], rtol=1e-12)
    assert len(whole.events) == len(first.events) + len(rest.events) == 1


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("λ", [40.0, 400.0])
def test_what_decays_to_rounding_by_the_end_is_no_event(method, λ):
    """A plate that creeps home, and a force that dies out, reach zero at no instant."""
    scheme = li.Scheme(
        li.Mass("x", 1.0), li.KelvinVoigt("x", "ground", k=λ**2, c=2.0 * λ), li.Bumper("x", "ground", e=0.0)
    )
    found = run(li.Problem("home", scheme, q0={"x": -1.0}), method, 5.0, 10)
    assert found.events == ()
    assert np.abs(found.q[-1]).max() < 1e-12


def test_an_opening_at_the_last_instant_under_a_load_that_ends():
    """exact takes no load that is a function."""
    scheme = li.Scheme(li.Mass("x", 1.0), li.Load("x", lambda t: 1.0 - t), li.Bumper("x", "ground", e=0.0))
    found = run(li.Problem("lift", scheme), "event-driven", 1.0)
    assert [(event.t, event.kind) for event in found.events] == [(pytest.approx(1.0, rel=1e-12), "open")]


@pytest.mark.parametrize("method", [name for name in EVERY if name != "rk4-paper"])
@pytest.mark.parametrize("v0", [1.0, 0.0])
def test_a_start_that_overlaps_by_rounding_touches(method, v0):
    """As where one run ends and another begins: the ball rebounds at once, or rests."""
    gap = 0.3
    scheme = li.Scheme(li.Mass("x", 1.0), li.Load("x", 9.81), li.Bumper("x", "ground", gap=gap, e=0.5))
    problem = li.Problem("restart", scheme, q0={"x": gap * (1.0 + 2.0**-52)}, v0={"x": v0})
    run = li.simulate(problem, method, dt=1e-4, t_end=0.05)
    fallen = 9.81 * run.t - 0.5 if v0 else np.zeros_like(run.t)
    assert_allclose(run["v_x"][2:], fallen[2:], rtol=0, atol=2e-3)
    assert_allclose(run["x"][2:], gap + (4.905 * run.t**2 - 0.5 * run.t if v0 else 0.0 * run.t)[2:], rtol=0, atol=2e-4)


@pytest.mark.parametrize(("method", "options"), [("moreau-jean", {"theta": 1.0}), ("cd-lagrange", {})])
def test_a_force_at_the_end_of_a_step_is_not_after_the_run(method, options):
    slider = li.Problem("slider", li.Scheme(li.Mass("x", 1.0), li.Slider("x", "ground", 1.0)), v0={"x": 0.19975})
    found = run(slider, method, 0.2, 400, **options)
    assert [event.kind for event in found.events] == ["stick"], "in the last step"
    for t_end in (0.2, 0.3, 0.7, 3.0):
        for steps in (3, 10, 401):
            grid = Grid(t_end, steps)
            assert_array_equal(EVERY[method](**options).reaction_times(grid), grid.times(1, steps))
