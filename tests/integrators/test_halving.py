"""Steps that halve themselves: smooth motion to the tolerance, impacts located, and an honest end where that cannot be."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose

import lcpimpact as li
from lcpimpact.integrators import METHODS
from lcpimpact.integrators.stepping.halving import Halving
from lcpimpact.record import Grid
from lcpimpact.study.accuracy.norms import l1_v, sup_q

HALVING = [name for name, kind in METHODS.items() if "halved" in kind.declared.adaptive]


def run(problem, method="moreau-jean", *, dt, t_end, **options):
    return li.simulate(problem, method, dt=dt, t_end=t_end, **options)


@pytest.mark.parametrize("name", HALVING)
def test_impacts_are_located_to_the_tolerance(name):
    problem, t_end = li.load_problem("two-balls-spring"), 0.5
    truth = run(problem, "exact", dt=5e-3, t_end=t_end)
    errors = []
    for rtol in (1e-4, 1e-6):
        found = run(problem, name, dt=5e-3, t_end=t_end, rtol=rtol)
        assert [event.kind for event in found.events] == ["impact", "impact"]
        assert (
            max(abs(a.t - b.t) for a, b in zip(found.events, truth.events, strict=True)) < 1e-3 * (rtol / 1e-4) ** 0.5
        )
        errors.append((sup_q(found, truth), l1_v(found, truth)))
        fixed = run(problem, name, dt=t_end / (len(found.t) - 1), t_end=t_end)
        assert errors[-1][0] < 0.3 * sup_q(fixed, truth), "better than as many equal steps"
    assert errors[1][0] < 0.15 * errors[0][0]
    assert errors[1][1] < 0.15 * errors[0][1]


@pytest.mark.parametrize("name", HALVING)
def test_smooth_motion_takes_short_steps_only_where_it_must(name):
    scheme = li.Scheme(li.Mass("x", 1.0), li.Spring("x", "ground", 4.0), li.Load("x", _kick))
    problem = li.Problem("kicked", scheme, q0={"x": 0.01})
    found = run(problem, name, dt=0.1, t_end=4.0, rtol=1e-6)
    h = np.diff(found.t)
    middle = 0.5 * (found.t[1:] + found.t[:-1])
    kick = np.abs(middle - 2.0) < 0.05
    assert np.median(h[kick]) < 0.25 * np.median(h[~kick])
    assert_allclose(h.sum(), 4.0, rtol=1e-14)
    fine = run(problem, name, dt=1e-4, t_end=4.0)
    assert abs(found["x"][-1] - fine["x"][-1]) < 2e-4 * np.abs(fine["x"]).max()
    assert found.stats.steps == len(found.t) - 1 == len(found.t_reaction)
    assert found.stats.rejected > 0


def _kick(t: float) -> float:
    return float(500.0 * np.exp(-(((t - 2.0) / 0.01) ** 2)))


def test_forces_that_jump():
    problem = li.load_problem("system-1")
    truth = run(problem, "exact", dt=3e-2, t_end=3.0)
    coarse, tight = (run(problem, dt=3e-2, t_end=3.0, rtol=rtol) for rtol in (1e-4, 1e-7))
    assert sup_q(tight, truth) < 5e-5 < sup_q(coarse, truth)
    assert_allclose(tight.t_reaction, 0.5 * (tight.t[1:] + tight.t[:-1]), rtol=0.0, atol=1e-14)
    assert tight.certificate.energy_balance < 1e-9 * tight.certificate.energy_scale, "each accepted step is a θ-step"
    assert_allclose([event.t for event in tight.events], [event.t for event in truth.events], rtol=0.0, atol=2e-4)


def test_a_ball_goes_through_the_accumulation_of_its_impacts_to_rest():
    problem = li.load_problem("bouncing-ball")
    found = run(problem, dt=0.05, t_end=5.0, rtol=1e-6)
    assert abs(found.q[-1, 0] - 1.0) < 1e-5
    assert abs(found.v[-1, 0]) < 1e-5
    assert_allclose([event.t for event in found.events[:5]], [0.451524 * (1 + 2 * sum(0.8**k for k in range(1, n + 1)))
                    for n in range(5)], rtol=0.0, atol=2e-5)  # fmt: skip
    failed = run(problem, dt=0.05, t_end=5.0, rtol=1e-9, throw=False)
    assert failed.status is li.Status.STEP_SIZE
    assert 4.0 < failed.t[-1] < 4.1, "up to where the impacts accumulate"
    assert len(failed.t) == len(failed.q) == len(failed.t_reaction) + 1
    assert "rtol" in failed.message


def test_driven_nodes_static_nodes_and_sliders():
    for name, t_end in (("vibrating-table", 1.0), ("system-2", 2.0), ("coulomb-oscillator", 2.0)):
        problem = li.load_problem(name)
        truth = run(problem, "exact", dt=t_end / 50, t_end=t_end)
        found = run(problem, dt=t_end / 50, t_end=t_end, rtol=1e-6)
        assert np.abs(found.q - truth.sample(found.t).q).max() < 2e-3 * np.abs(truth.q).max(), name


@pytest.mark.parametrize("name", HALVING)
@pytest.mark.parametrize("rtol", [0.0, -1.0, 1.0, 1e-15, np.nan, "tight", True])
def test_tolerances_that_are_none(name, rtol):
    with pytest.raises(li.InputError, match="rtol"):
        METHODS[name](rtol=rtol)


@pytest.mark.parametrize("name", HALVING)
def test_without_a_tolerance_the_steps_are_those_of_dt(name):
    assert next(each for each in dataclasses.fields(METHODS[name]) if each.name == "rtol").default is None
    found = run(li.load_problem("bouncing-ball"), name, dt=1e-2, t_end=1.0)
    assert_allclose(np.diff(found.t), 1e-2, rtol=1e-12)
    assert found.stats.rejected == 0


def test_a_step_that_is_too_long_for_an_explicit_method_is_halved_and_ends_no_run():
    problem = li.load_problem("two-balls-spring")
    truth = run(problem, "exact", dt=5e-2, t_end=0.5)
    for rtol in (1e-3, 1e-5):
        # ω dt = 7, and the method is stable below 2; with springs met at the end of a step its LCP has no solution then.
        found = run(problem, "stormer-verlet-ns", dt=5e-2, t_end=0.5, rtol=rtol)
        assert found.stats.rejected > 0
        assert sup_q(found, truth) < 20.0 * rtol * np.abs(truth.q).max()
    failed = run(problem, "stormer-verlet-ns", dt=5e-2, t_end=0.5, throw=False)
    assert failed.status is li.Status.INFEASIBLE, "without rtol the step is dt"


def test_a_law_that_no_step_can_meet_ends_a_run_with_its_own_status():
    calls = []

    def never(level, t, y):
        calls.append(level)
        return li.Status.RAY, y, np.zeros(0)

    halving = Halving(never, 1.0, 1e-3, np.array([True]), lambda q: 0.0, lambda r, s: np.zeros(1), np.zeros(2))
    assert halving.advance(Grid(1.0, 1), 0, 1, lambda k, y: None) == (li.Status.RAY, 0)
    assert max(calls) <= 42
    assert len(halving.t) == 1
