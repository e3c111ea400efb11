"""Numbers at the edges of floats: a run has a status or an error of this package, and nothing else comes out."""

import warnings

import numpy as np
import pytest

from lcpimpact import (
    Bumper,
    Dashpot,
    Harmonic,
    KelvinVoigtStop,
    LcpImpactError,
    Load,
    Mass,
    Problem,
    Ramp,
    Scheme,
    Spring,
    Square,
    simulate,
)

SIZES = [0.0, 5e-324, 1e-300, 1e-30, 1e30, 1e300, 1e308, np.inf, np.nan]
METHODS = ["moreau-jean", "newmark-ns", "rattle-ns", "generalized-alpha", "schatzman-paoli", "cd-lagrange", "radau"]
METHODS += ["radau-fesd", "rk4", "dopri5", "event-driven", "exact"]
STIFFEST = 1e4
"""In N/m: a motion of more periods takes those that follow each of them for ever."""

REFUSED = None


def drawn(rng):
    """A body or two with springs, dashpots, stops and loads, of which some have numbers of extreme size."""

    def size(signed=False):
        number = rng.choice(SIZES) if rng.random() < 0.1 else rng.choice([0.5, 1.0, 2.0, 10.0])
        return float(number * rng.choice([-1.0, 1.0]) if signed else number)

    def parts():
        yield Mass("x", size())
        yield Spring("x", "ground", min(size(), STIFFEST))
        if rng.random() < 0.5:
            yield Dashpot("x", "ground", size())
        for load in (size(True), Harmonic(size(), size()), Square(size(), 3.0), Ramp(0.0, size(True), 0.1, size())):
            if rng.random() < 0.3:
                yield Load("x", load)
        if rng.random() < 0.7:
            yield Bumper("x", "ground", gap=size(), e=rng.choice([0.0, 0.5, 1.0]))
        if rng.random() < 0.4:
            yield Mass("y", size())
            yield Bumper("x", "y", gap=size(), e=rng.choice([0.0, 0.5, 1.0]))
        if rng.random() < 0.3:
            yield KelvinVoigtStop("x", "ground", gap=size(), k=min(size(), STIFFEST), c=size())

    t_end = float(rng.choice([1.0, 1.0, 1.0, 1e-300, 1e-30]))
    return Problem("drawn", Scheme(*parts()), v0={"x": size(True)}, t_end=t_end)


def outcome(seed):
    """The run of a random system, with all that prints it, or None where it is refused."""
    rng = np.random.default_rng(seed)
    try:
        problem = drawn(rng)
        run = simulate(problem, str(rng.choice(METHODS)), dt=problem.t_end / 8.0, throw=False, error=False)
    except LcpImpactError:
        return REFUSED
    str(run)
    run.summary()
    return run


def judge(seeds):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        runs = [run for run in map(outcome, seeds) if run is not REFUSED]
    assert all(np.isfinite(run.q).all() for run in runs if run.success)
    return runs


def test_random_numbers_of_extreme_size_have_a_status_or_are_refused():
    assert len(judge(range(40))) > 10


@pytest.mark.slow
def test_so_they_are_in_many_systems():
    assert len(judge(range(40, 340))) > 75
