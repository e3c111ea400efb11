"""Two independent routes on schemes that nobody chose: the exact solution and the θ-step at a small step."""

import numpy as np
import pytest
from random_schemes import frictional, random_problem

import lcpimpact as li


def runnable(seeds, make=random_problem):
    """Yield the problems that assemble and that the exact solution takes, with its run."""
    for seed in seeds:
        try:
            problem = make(seed)
            exact = li.simulate(problem, "exact", dt=1e-2, t_end=2.0, throw=False)
        except (li.InputError, li.UnsupportedError):
            continue
        if exact.status is li.Status.ACCUMULATION:  # refused, and says why
            continue
        assert exact.success, exact.message
        yield problem, exact


@pytest.mark.parametrize("first", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (50, 100, 150))])
def test_exact_obeys_the_laws_and_the_step_converges_to_it(first):
    compared = degrees = 0
    for problem, exact in runnable(range(first, first + 50)):
        certificate = exact.certificate
        assert certificate.penetration < 1e-11
        assert certificate.complementarity < 1e-9 * (1.0 + certificate.energy_scale)
        assert certificate.energy_balance < 1e-9 * (1.0 + certificate.energy_scale)
        if (problem.dynamics.relative_degree < 2).all():
            found = li.simulate(problem, dt=1e-4, t_end=2.0)
            massive = problem.dynamics.massive
            error = np.abs(found.q[::100][:, massive] - exact.q[:, massive]).max()
            assert error < 2e-5 * (1.0 + np.abs(exact.q).max())
            compared += 1
            degrees += len(problem.dynamics.contacts)
    assert compared >= 5
    assert degrees >= 2


@pytest.mark.parametrize("first", [0, pytest.param(40, marks=pytest.mark.slow)])
def test_exact_and_the_step_agree_with_friction_and_shakers(first):
    compared = switches = 0
    for problem, exact in runnable(range(first, first + 40), frictional):
        certificate = exact.certificate
        assert certificate.penetration < 1e-11
        assert certificate.complementarity < 1e-9 * (1.0 + certificate.energy_scale)
        assert certificate.energy_balance < 1e-9 * (1.0 + certificate.energy_scale)
        if any(event.kind == "impact" for event in exact.events):
            continue
        found = li.simulate(problem, dt=2e-4, t_end=2.0)
        massive = problem.dynamics.massive
        error = np.abs(found.q[::50][:, massive] - exact.q[:, massive]).max()
        assert error < 4e-4 * (1.0 + np.abs(exact.q).max())
        compared += 1
        switches += sum(event.kind in ("stick", "slip") for event in exact.events)
    assert compared >= 5
    assert switches >= 30
