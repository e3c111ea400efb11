"""Bodies on dashpots that stop them within a step are never thrown back, and a thrown-back body is no run that holds."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import lcpimpact as li
from lcpimpact.certificate.certification import certify
from lcpimpact.errors import Status, UnsupportedError
from lcpimpact.integrators import METHODS
from lcpimpact.integrators.moreau_jean import MoreauJean
from lcpimpact.integrators.stepping.kernel import Watched
from lcpimpact.integrators.stepping.linear_step import Way
from lcpimpact.integrators.stepping.strong_dashpots import damped_rows, may_stop
from lcpimpact.record import Record


def buffer(c, gap=0.105, m=1.0):
    """Return a body with v = 1 before a plate on a dashpot, which stops at gap + m/c."""
    scheme = li.Scheme(li.Mass("x", m=m), li.Bumper("x", "z", gap=gap), li.Dashpot("z", "ground", c=c))
    return li.Problem("buffer", scheme, v0={"x": 1.0})


def run(problem, method="moreau-jean", dt=1e-2, t_end=0.4, **options):
    return li.simulate(problem, method, dt=dt, t_end=t_end, throw=False, **options)


@pytest.mark.parametrize("method", ["moreau-jean", "radau"])
@pytest.mark.parametrize("c", [250.0, 1e3, 1e5, 1e9])
@pytest.mark.parametrize("gap", [0.0, 0.105])
def test_a_dashpot_does_not_throw_a_body_back(method, c, gap):
    found = run(buffer(c, gap), method)
    assert found.status is Status.SOLVED, found.message
    assert_allclose(found["v_x"][-1], 0.0, atol=1e-3)
    assert_allclose(found["x"][-1], gap + 1.0 / c, rtol=1e-4, atol=1e-9)
    assert found["v_x"].min() >= -1e-9


@pytest.mark.parametrize("θ", [0.55, 0.75, 1.0])
def test_at_any_weight(θ):
    found = run(buffer(1e3), theta=θ)
    assert found.status is Status.SOLVED, found.message
    assert_allclose(found["x"][-1], 0.106, rtol=1e-9)
    assert found["v_x"].min() >= -1e-12


def test_what_the_step_resolves_keeps_its_bits(monkeypatch):
    found = run(buffer(200.0))
    monkeypatch.setattr(MoreauJean, "stopping_contacts", lambda self, d, h: None)
    same = run(buffer(200.0))
    assert found.q.tobytes() == same.q.tobytes()
    assert found.reaction.tobytes() == same.reaction.tobytes()


@pytest.mark.parametrize("c", [250.0, 1e3, 1e6])
def test_a_body_that_is_thrown_back_violates_the_laws(monkeypatch, c):
    monkeypatch.setattr(MoreauJean, "stopping_contacts", lambda self, d, h: None)
    found = run(buffer(c))
    assert found["v_x"].min() < -1e-4
    assert found.status is Status.VIOLATED
    assert "coordinates and velocities differ" in found.message


def test_weights_of_each_contact():
    scheme = li.Scheme(
        li.Mass("a", m=1.0),
        li.Mass("b", m=2.0),
        li.Bumper("a", "z"),
        li.Dashpot("z", "b", c=300.0),
        li.Spring("b", "ground", k=1.0),
    )
    d = scheme.assemble()
    rows = damped_rows(d)
    # The dashpot pushes the other body as the plate does: 1/1 + 1/2.
    assert_allclose(rows.G, [[1.5]])
    assert_allclose(rows.Y, [[1.0 / 300.0]])
    assert may_stop(d, 1.01 * 2.0 / 450.0, 0.5)
    assert not may_stop(d, 0.99 * 2.0 / 450.0, 0.5)
    assert not may_stop(d, 1.0, 1.0)


def test_bodies_exchange_their_momentum_alone():
    scheme = li.Scheme(
        li.Mass("a", m=1.0), li.Mass("b", m=2.0), li.Bumper("a", "z", gap=0.1), li.Dashpot("z", "b", c=1e6)
    )
    found = run(li.Problem("pair", scheme, v0={"a": 1.0}))
    assert found.status is Status.SOLVED, found.message
    assert_allclose(found.v[-1][[0, 1]], 1.0 / 3.0, rtol=1e-9)


def test_two_dashpots_side_by_side():
    scheme = li.Scheme(
        li.Mass("x", m=1.0), li.Bumper("x", "y", gap=0.1), li.Bumper("x", "z", gap=0.1), li.Dashpot("y", "ground", c=150.0),
        li.Dashpot("z", "ground", c=160.0),
    )  # fmt: skip
    found = run(li.Problem("two", scheme, v0={"x": 1.0}))
    assert found.status is Status.SOLVED, found.message
    assert found["v_x"].min() >= -1e-9
    assert_allclose(found["x"][-1], 0.1 + 1.0 / 310.0, rtol=1e-6)


def test_a_body_at_rest_on_its_buffer_has_no_velocity():
    scheme = li.Scheme(
        li.Mass("x", m=1.0),
        li.Load("x", f=9.81),
        li.Bumper("x", "z", gap=0.02),
        li.KelvinVoigt("z", "ground", k=981.0, c=1e4),
    )
    found = run(li.Problem("rest", scheme), t_end=0.5)
    assert found.status is Status.SOLVED, found.message
    # It creeps into the spring by x' = (m g - k x)/c.
    assert_allclose(found["v_x"][-1], 9.81e-4, rtol=0.05)
    assert_allclose(found["R"][-1], 9.81, rtol=1e-3)


def test_halved_steps_too():
    found = run(buffer(1e3), rtol=1e-4)
    assert found.status is Status.SOLVED, found.message
    assert_allclose(found["x"][-1], 0.106, rtol=1e-3)
    assert found["v_x"].min() >= -1e-3


def test_sparse_steps_refuse_by_name():
    elements = (li.Mass("x", m=1.0), li.Bumper("x", "z", gap=0.105), li.Dashpot("z", "ground", c=1e3))
    problem = li.Problem("sparse", li.SparseScheme(*elements), v0={"x": 1.0})
    with pytest.raises(UnsupportedError, match=r"contact 'R' stops its body .* dt <= 0.002"):
        run(problem)
    assert run(problem, dt=1e-3, t_end=0.1).status is Status.SOLVED


def test_sparse_steps_refuse_light_plates_by_name():
    elements = light_plate(1e3, 0.0).scheme.elements
    problem = li.Problem("sparse", li.SparseScheme(*elements), v0={"x": 1.0})
    with pytest.raises(UnsupportedError, match=r"contact 'R' stops its body .* dt <= 0.00202"):
        run(problem)
    found = run(problem, dt=2e-3, t_end=0.2)
    assert found.status is Status.SOLVED
    assert_allclose(found["z"][-1], 1e-3, rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["moreau-jean", "radau"])
@pytest.mark.parametrize(
    ("c", "dt"), [(1e4, 1e-2), (1e4, 1e-1), (3e4, 1e-2), (3e5, 1e-3), (1e6, 1e-3), (1e6, 1e-1), (1e9, 1e-2)]
)
def test_system_1_on_strong_dashpots(method, c, dt):
    problem = li.load_problem("system-1", c_o=c)
    found, exact = (run(problem, each, dt=dt, t_end=1.0) for each in (method, "exact"))
    assert found.status is Status.SOLVED, found.message
    z = c * dt / 100.0
    # The body moves by v m/c; a step of dt in which it is stopped, by v dt.
    assert np.abs(found["x"] - exact["x"]).max() <= (0.03 if z <= 2.0 else 0.01) * np.ptp(exact["x"])
    assert found["x"].min() >= 0.0


@pytest.mark.parametrize("method", ["moreau-jean", "radau"])
@pytest.mark.parametrize("c", [250.0, 1e6])
def test_the_force_with_which_a_contact_closes(method, c):
    found = run(buffer(c), method).summary()
    assert_allclose(found["peak_force"], c, rtol=1e-9)
    assert_allclose(found["peak_time"], 0.105, rtol=1e-9)


@pytest.mark.parametrize(("c", "dt"), [(1e3, 1e-2), (1e3, 2.5e-3), (1e4, 1e-2)])
def test_a_body_between_two_stops(c, dt):
    scheme = li.Scheme(
        li.Mass("x", m=1.0), li.Spring("x", "ground", k=400.0), li.Bumper("x", "r", gap=0.05),
        li.KelvinVoigt("r", "ground", k=1e3, c=c), li.Bumper("l", "x", gap=0.05), li.KelvinVoigt("l", "ground", k=1e3, c=c),
    )  # fmt: skip
    problem = li.Problem("stops", scheme, v0={"x": 2.0})
    found = run(problem, dt=dt, t_end=0.5)
    # It touches a stop in a step that is taken for closed, and in which the stop does not push.
    assert found.status is Status.SOLVED, found.message
    assert np.abs(found["v_x"]).max() <= 2.0


def test_each_mode_has_the_solver_that_is_prepared_for_its_matrix():
    """Also the second mode of a block; a solver that takes the place of another keeps it from mode to mode."""
    scheme = li.Scheme(
        li.Mass("x", m=1.0), li.Bumper("x", "z", gap=0.1), li.Dashpot("z", "ground", c=1e5),
        li.Bumper("y", "x", gap=0.1), li.Dashpot("y", "ground", c=1e5),
    )  # fmt: skip
    method, d = MoreauJean(), scheme.assemble()
    step = method.prepare(d, 1e-2, "auto")
    state = method.first_state(d, method.begin(d, np.zeros(3), np.zeros(3), 1e-2), 1e-2)
    open_ = Way.begin(step, state, None)
    modes = [open_, open_._replace(watched=np.array([Watched.CLOSED, Watched.OPEN])).by_mode()]
    modes.append(modes[1]._replace(watched=np.array([Watched.OPEN, Watched.CLOSED])).by_mode())
    assert len({id(mode.step) for mode in modes}) == 3
    assert [mode.solver is mode.step.solver for mode in modes] == [True] * 3
    instead, _ = open_.after(int(Status.MAX_ITER), lambda: open_)
    again = instead._replace(watched=np.array([Watched.CLOSED, Watched.OPEN])).by_mode()
    assert again.step is modes[1].step
    assert again.solver is instead.solver is not open_.solver


def test_the_ledger_closes():
    ledger = li.energy_ledger(run(buffer(1e3)))
    assert ledger.balance < 1e-12
    end = ledger.table.iloc[-1]
    # The contact takes r u in the step in which it closes, and the dashpot all else.
    assert_allclose(end["dashpot z to ground"] + end["contact R"], 0.5, rtol=1e-9)
    assert end["contact R"] > 0.0


def light_plate(c, e, m=0.01):
    """Return a body with v = 1 before a plate with mass on a dashpot, which takes the momentum: it moves by 1/c."""
    scheme = li.Scheme(
        li.Mass("x", m=1.0), li.Mass("z", m=m), li.Bumper("x", "z", gap=0.1, e=e), li.Dashpot("z", "ground", c=c)
    )
    return li.Problem("light plate", scheme, v0={"x": 1.0})


@pytest.mark.parametrize("method", ["moreau-jean", "radau"])
@pytest.mark.parametrize("e", [0.0, 0.5])
@pytest.mark.parametrize("c", [1e3, 1e6])
def test_a_light_plate_does_not_throw_a_body_back(method, c, e):
    found = run(light_plate(c, e), method)
    assert found.status is Status.SOLVED, found.message
    assert_allclose(found["z"][-1], 1.0 / c, rtol=1e-6)
    # The impact happens in a step, at whose end the body may be late, as on a rigid stop.
    assert_allclose(found["x"][-1], 0.1 + 1.0 / c, atol=1e-2)
    assert found.v.min() >= -1e-9
    assert_allclose(found.v[-1], 0.0, atol=1e-6)


def test_a_light_plate_on_another_body():
    scheme = li.Scheme(
        li.Mass("x", m=1.0), li.Mass("z", m=0.01), li.Mass("b", m=2.0), li.Bumper("x", "z", gap=0.1, e=0.5),
        li.Dashpot("z", "b", c=1e4),
    )  # fmt: skip
    found = run(li.Problem("two", scheme, v0={"x": 1.0}))
    assert found.status is Status.SOLVED, found.message
    assert_allclose(found.v[-1], 1.0 / 3.01, rtol=1e-5)


@pytest.mark.parametrize("c", [1e3, 1e5])
def test_an_oscillator_that_its_dashpot_stops_does_not_ring(c):
    k = 100.0
    scheme = li.Scheme(li.Mass("x", m=1.0), li.Spring("x", "ground", k=k), li.Dashpot("x", "ground", c=c))
    found = run(li.Problem("overdamped", scheme, v0={"x": 1.0}))
    slow, fast = sorted(np.roots([1.0, c, k]), key=abs)
    x = (np.exp(slow * found.t) - np.exp(fast * found.t)) / (slow - fast)
    assert found.status is Status.SOLVED, found.message
    assert np.abs(found["x"] - x).max() <= 1e-3 / c
    assert np.abs(found["v_x"][1:]).max() <= 1e-3


def test_two_bodies_on_a_dashpot_exchange_their_momentum_in_a_step():
    scheme = li.Scheme(li.Mass("a", m=1.0), li.Mass("b", m=2.0), li.Dashpot("a", "b", c=1e5))
    found = run(li.Problem("pair", scheme, v0={"a": 1.0}), t_end=0.05)
    assert found.status is Status.SOLVED, found.message
    assert_allclose(found.v[1:], 1.0 / 3.0, rtol=1e-12)


def test_steps_that_throw_a_light_plate_violate_the_laws(monkeypatch):
    monkeypatch.setattr(MoreauJean, "stopping_contacts", lambda self, d, h: None)
    found = run(light_plate(1e3, 0.0))
    assert found["v_x"].min() < -1e-2
    assert found.status is Status.VIOLATED
    assert "coordinates and velocities differ" in found.message


def test_a_plate_that_its_step_resolves_keeps_its_bits(monkeypatch):
    found = run(light_plate(1.9, 0.5))
    monkeypatch.setattr(MoreauJean, "stopping_contacts", lambda self, d, h: None)
    assert found.q.tobytes() == run(light_plate(1.9, 0.5)).q.tobytes()


@pytest.mark.parametrize("method", ["moreau-jean", "radau"])
@pytest.mark.parametrize("c", [12.0, 50.0, 150.0])
@pytest.mark.parametrize("gap", [0.0, 0.103])
def test_the_force_of_closing_where_the_step_resolves_the_dashpot(method, c, gap):
    found = run(buffer(c, gap), method, t_end=0.15)
    assert found.status is Status.SOLVED, found.message
    assert_allclose(found.summary()["peak_force"], c, rtol=1e-9)
    assert_allclose(found.summary()["peak_time"], gap, atol=1e-9)
    assert_allclose(found.summary()["impulse"], 1.0 - np.exp(-c * (0.15 - gap)), rtol=0.01)


def test_a_closed_contact_dissipates_nothing():
    """Its loss in a step is r u at the beginning less r u at the end, which the certificate judges."""
    found = run(buffer(100.0), t_end=0.2)
    d, first = found.problem.dynamics, int(np.argmax(found["R"] > 0.0))
    u, r = d.gap(found.t, found.q)[:, 0], found["R"]
    loss = -r * np.diff(u)
    assert_allclose(loss[first], r[first] * u[first], rtol=1e-9)
    assert np.abs(loss[first + 1 :]).max() < 1e-12 * loss[first]
    record = Record(*(each.copy() for each in (found.t, found.q, found.v, found.t_reaction, found.reaction)))
    q = record.q
    q[first + 3 :, 0] -= 1e-5  # a plate that is 1e-5 m ahead of the body that pushes it
    planted = certify(d, (q[0], found.v[0]), record, None, found.events, found.integrator)
    assert_allclose(planted.complementarity, 1e-5 * r[first + 2], rtol=1e-6)
    assert any("complementarity" in each for each in planted.failures)


def slowed(c, m=1.0, load=None):
    """Return a body with v = 1 on a dashpot to the ground, or from rest under a load."""
    loads = () if load is None else (li.Load("x", load),)
    return li.Problem(
        "slowed", li.Scheme(li.Mass("x", m), li.Dashpot("x", "ground", c), *loads), v0={"x": 0.0 if load else 1.0}
    )


@pytest.mark.parametrize("method", [name for name in METHODS if name not in ("rk4-paper", "event-driven")])
@pytest.mark.parametrize("z", [2.5, 3.0, 5.0, 50.0, 1e5])
def test_no_run_that_holds_keeps_a_velocity_that_dashpots_stop(method, z):
    c, dt = z / 0.02, 0.02
    found = run(slowed(c), method, dt=dt, t_end=0.2)
    # A body may be stopped at once or at the end of the step.
    off = np.abs(found["x"] - -np.expm1(-c * found.t) / c).max() / dt
    kept = np.abs(found["v_x"][1:] - np.exp(-c * found.t[1:])).max()
    right = off <= 0.7 and kept <= 0.2 + np.exp(-z)
    assert right or found.status is not Status.SOLVED
    if method in ("moreau-jean", "generalized-alpha", "cd-lagrange", "radau", "radau-fesd", "exact"):
        assert right
        assert found.status is Status.SOLVED, found.message


@pytest.mark.parametrize("method", ["generalized-alpha", "cd-lagrange", "moreau-jean", "radau"])
@pytest.mark.parametrize("c", [1e4, 1e7])
@pytest.mark.parametrize(("on", "off"), [(0.237, 0.619), (0.25, 0.6)])
@pytest.mark.parametrize("dt", [0.05, 0.005])
def test_a_load_that_jumps_moves_a_body_on_a_strong_dashpot(method, c, on, off, dt):
    found = run(slowed(c, load=li.Table([on, on, off, off], [0.0, 3.0, 3.0, 0.0])), method, dt=dt, t_end=1.0)
    assert found.status is Status.SOLVED, found.message
    # x' = f/c beside a transient of m/c. A method that sees the load at the ends of steps has it longer or shorter by dt.
    assert_allclose(found["x"][-1], 3.0 * (off - on) / c, rtol=1.2 * dt)
    assert np.abs(found["v_x"]).max() <= 3.7 / c


@pytest.mark.parametrize("method", ["moreau-midpoint", "newmark-ns"])
def test_a_body_that_creeps_on_a_strong_dashpot_keeps_no_velocity(method):
    load = li.Table([0.0, 0.5, 1.0], [0.0, 3.0, 0.0])
    found = run(slowed(1e7, load=load), method, dt=0.05, t_end=1.0)
    assert found.status is Status.SOLVED, found.message
    assert_allclose(found["x"][-1], 1.5e-7, rtol=1e-3)


def stopped(stop):
    """Return a body with v = 1 before a compliant stop with damping."""
    return li.Problem("stopped", li.Scheme(li.Mass("x", 1.0), stop), v0={"x": 1.0})


@pytest.mark.parametrize("method", ["moreau-midpoint", "newmark-ns", "rattle-ns", "generalized-alpha", "cd-lagrange"])
@pytest.mark.parametrize(
    ("stop", "leaves"),
    [
        (li.HuntCrossley("x", "ground", K=1e4, b=1e4, gap=0.105), 1e-4),
        (li.HuntCrossley("x", "ground", K=1e4, b=30.0, gap=0.105), 1.0 / 30.0),
        (li.KelvinVoigtStop("x", "ground", k=1e-3, c=1e4, gap=0.105), 0.0),
        (li.KelvinVoigtStop("x", "ground", k=1e-3, c=100.0, gap=0.105), 0.0),
    ],
)
def test_no_run_that_holds_is_thrown_back_by_a_damped_stop(method, stop, leaves):
    """It leaves Hunt and Crossley's stop at 1/b at most, and creeps in that of Kelvin and Voigt."""
    found = run(stopped(stop), method, error=False)
    thrown = -found["v_x"].min() - leaves
    assert thrown <= 0.21 or found.status is Status.VIOLATED
    if found.status is Status.VIOLATED:
        assert thrown > 0.2 or method == "rattle-ns"


def test_a_run_thrown_back_by_a_damped_stop_says_so():
    found = run(stopped(li.HuntCrossley("x", "ground", K=1e4, b=300.0, gap=0.105)), "moreau-midpoint", error=False)
    assert found["v_x"].min() < -0.8
    assert "dashpots stop masses within a step" in found.message
