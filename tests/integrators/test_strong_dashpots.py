"""Bodies on dashpots that stop them within a step are never thrown back, and a thrown-back body is no run that holds."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import lcpimpact as li
from lcpimpact.errors import Status, UnsupportedError
from lcpimpact.integrators.moreau_jean import MoreauJean
from lcpimpact.integrators.stepping.kernel import UNWATCHED
from lcpimpact.integrators.stepping.strong_dashpots import damped_rows, may_stop


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
    monkeypatch.setattr(MoreauJean, "stopping_contacts", lambda self, d, h: UNWATCHED)
    same = run(buffer(200.0))
    assert found.q.tobytes() == same.q.tobytes()
    assert found.reaction.tobytes() == same.reaction.tobytes()


@pytest.mark.parametrize("c", [250.0, 1e3, 1e6])
def test_a_body_that_is_thrown_back_violates_the_laws(monkeypatch, c):
    monkeypatch.setattr(MoreauJean, "stopping_contacts", lambda self, d, h: UNWATCHED)
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


def test_the_ledger_closes():
    ledger = li.energy_ledger(run(buffer(1e3)))
    assert ledger.balance < 1e-12
    end = ledger.table.iloc[-1]
    # The contact takes r u in the step in which it closes, and the dashpot all else.
    assert_allclose(end["dashpot z to ground"] + end["contact R"], 0.5, rtol=1e-9)
    assert end["contact R"] > 0.0
