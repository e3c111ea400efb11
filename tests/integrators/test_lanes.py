"""Runs side by side have the bits of runs alone, or are refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from lagrangian_names import LAGRANGIAN

import lcpimpact as li
from lcpimpact.errors import InputError, UnsupportedError
from lcpimpact.formula import NotTracedError, Program
from lcpimpact.integrators import METHODS
from lcpimpact.integrators.printed.lanes import LANES, SeriesReading, lanes
from lcpimpact.integrators.stepping.linear_step import LinearStep
from lcpimpact.numbers import is_real
from lcpimpact.numerics.rounding import EPS
from lcpimpact.problems import PROBLEMS
from lcpimpact.problems.parameters import changes_at, value_at, with_values
from lcpimpact.record import Grid
from lcpimpact.simulation import _missing

pytestmark = pytest.mark.compiled

QUICK = [("system-1", "moreau-jean")]
METHODS_IN_LANES = [name for name, kind in METHODS.items() if issubclass(kind, LinearStep)]
IN_TURN = ("kelvin-voigt-tension", "coulomb-oscillator", "shaw-holmes")
"""A node without mass, a slider, and an impact under a load.

Each pair compiles a text of its own, which takes seconds: moreau-jean meets every problem, each other method the bouncing
ball and one of these.
"""
PAIRS = [
    pytest.param(problem, method, marks=pytest.mark.always if (problem, method) in QUICK else pytest.mark.slow)
    for problem in PROBLEMS
    if problem not in LAGRANGIAN
    for method in METHODS_IN_LANES
    if method == "moreau-jean" or problem in ("bouncing-ball", IN_TURN[METHODS_IN_LANES.index(method) % len(IN_TURN)])
]
ALONE = ("three-balls", "impact-pair", "impact-damper", "nonsmooth-mode")
"""Problems whose sets are not regular: an LCP that is solved by cancellation, and starts that must touch a stop."""

REFUSED = ("hertz", "hunt", "plastic", "hereditary", "bar-", "bouncing-bar", "ball-in-air", "balls-on-springs")
"""Problems with springs of power laws, several massless nodes on springs, loads beside a varying one, or constants that
are no sums.
"""


def constants(problem):
    """Addresses of the constants of the elements that are not zero."""
    found = [f"{i}.{name}" for i, e in enumerate(problem.scheme.elements) for name, x in vars(e).items() if is_real(x)]
    return [address for address in found if value_at(problem, address) != 0.0]


def prepared(problem, method, addresses, grid, readings=(), stops=()):
    program = Program()
    traced = changes_at(problem, addresses)({each: program.parameter(value_at(problem, each)) for each in addresses})
    start = traced.initial_coordinates, traced.initial_velocities
    return lanes((method, method), (traced.dynamics, problem.dynamics), start, grid, program, readings, stops)


@pytest.mark.parametrize(("name", "method"), PAIRS)
def test_every_method_has_the_bits_of_single_runs(name, method, rng):
    problem, integrator = li.load_problem(name), METHODS[method]()
    d = problem.dynamics
    few = len(d.contacts) < 2 or (len(d.contacts) == 2 and d.impenetrable.all())
    if _missing(integrator.declared, d) or not d.stores_energy or not few:
        pytest.skip("no pair for lanes")
    grid, addresses = Grid(problem.t_end, 1000), constants(problem)
    try:
        compiled = prepared(
            problem, integrator, addresses, grid, [SeriesReading("max", "q", 0), SeriesReading("min", "v", 0)], [500]
        )
    except (NotTracedError, UnsupportedError, InputError):
        assert name.startswith(REFUSED) or name.endswith(REFUSED) or method in ("cd-lagrange", "schatzman-paoli")
        return
    base = np.array([value_at(problem, each) for each in addresses])
    values = base[:, None] * rng.uniform(0.85, 1.0, (len(base), LANES + 3))
    regular, kept, states = compiled.take(values)
    if name in ALONE:
        assert not regular.any()
        return
    assert regular.mean() > 0.9
    for k in np.flatnonzero(regular)[[0, 7, -1]]:
        single = with_values(problem, dict(zip(addresses, map(float, values[:, k]), strict=True)))
        run = li.simulate(single, integrator, dt=grid.h, t_end=grid.t_end, throw=False)
        n = run.q.shape[1]
        for step, state in zip((500, 1000), states, strict=True):
            assert (state[: 2 * n, k] == np.concatenate([run.q[step], run.v[step]])).all()
        assert (kept[0, k], kept[1, k]) == (run.q[:, 0].max(), run.v[:, 0].min())


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.mark.slow
def test_readings_are_the_extremes_of_the_series_and_their_steps():
    problem, grid = li.load_problem("system-1"), Grid(3.0, 3000)
    kinds = [
        SeriesReading("max", "r", 0),
        SeriesReading("argmax", "r", 0),
        SeriesReading("min", "r", 0),
        SeriesReading("argmax", "q", 1),
    ]
    compiled = prepared(problem, METHODS["moreau-jean"](), ["3.k", "3.c"], grid, kinds)
    values = np.array([[3000.0, 4000.0, 5000.0], [100.0, 250.0, 900.0]])
    _, kept, _ = compiled.take(values)
    for k in range(3):
        run = li.simulate(with_values(problem, {"3.k": values[0, k], "3.c": values[1, k]}), dt=1e-3, t_end=3.0)
        assert list(kept[:, k]) == [run["R"].max(), run["R"].argmax() + 1, run["R"].min(), run["z"].argmax()]


def test_sets_with_other_formulas_are_not_regular():
    """Bumpers that start penetrated are refused alone; side by side they are told apart."""
    problem = li.load_problem("bouncing-ball")
    compiled = prepared(problem, METHODS["moreau-jean"](), ["2.gap"], Grid(1.0, 100))
    regular, _, _ = compiled.take(np.array([[1.0, -0.5, 2.0]]))
    assert list(regular) == [True, False, True]


@pytest.mark.slow
def test_a_step_without_a_positive_w_is_not_regular():
    """A spring of so negative a stiffness that m - θ² h² k is below zero: its LCP has no closed form."""
    problem = li.load_problem("rocking-block")
    compiled = prepared(problem, METHODS["moreau-jean"](), ["1.k"], Grid(1.0, 100))
    regular, _, _ = compiled.take(np.array([[4.0, 1e5, 3.9]]))
    assert list(regular) == [True, False, True]


@pytest.mark.slow
def test_a_set_that_overflows_is_not_regular():
    problem = li.load_problem("bouncing-ball")
    compiled = prepared(problem, METHODS["moreau-jean"](), ["v0.x"], Grid(3.0, 300))
    regular, _, _ = compiled.take(np.array([[-1.0, -1e308, np.inf]]))
    assert list(regular) == [True, False, False]


def test_a_set_that_overflows_without_a_contact_is_not_regular():
    problem = li.Problem("free", li.Scheme(li.Mass("x", 1.0), li.Load("x", 1.0)), t_end=1.0)
    compiled = prepared(problem, METHODS["moreau-jean"](), ["v0.x", "1.f"], Grid(3.0, 300))
    regular, _, _ = compiled.take(np.array([[1.0, 1e308, -1e308], [1.0, 0.0, 1.0]]))
    assert list(regular) == [True, False, False]


@pytest.mark.parametrize("tol", [15.0 * EPS, 0.6])
def test_lcps_are_checked_to_moderate_tolerances_alone(tol):
    """With another tolerance the rounding of q + W z may be beyond it, although its value is not."""
    problem = li.load_problem("bouncing-ball")
    with pytest.raises(UnsupportedError, match="tolerance"):
        prepared(problem, METHODS["moreau-jean"](tol=tol), ["2.gap"], Grid(1.0, 100))


def test_the_state_is_kept_only_where_it_is_asked_for():
    problem, values = li.load_problem("bouncing-ball"), np.array([[0.5, 1.0]])
    grid, readings = Grid(1.0, 100), [SeriesReading("min", "q", 0)]
    lean, whole = (
        prepared(problem, METHODS["moreau-jean"](), ["2.gap"], grid, readings, stops).take(values)
        for stops in ([], [50])
    )
    assert lean[2].shape == (1, 0, 2)
    assert whole[2].shape == (2, 3, 2)
    assert (lean[1] == whole[1]).all()


def driven(a, ω, φ, f, g):
    """A mass under two loads that strikes a stop."""
    stop = li.Bumper("x", "ground", gap=0.3 + a, e=0.5)
    loads = li.Load("x", li.Harmonic(f, 1.3 * ω, φ)), li.Load("x", g)
    return li.Problem("driven", li.Scheme(li.Mass("x", 1.0), li.Spring("x", "ground", 100.0), *loads, stop), t_end=2.0)


def shaken(a, ω, φ, f, g, motion=li.Harmonic):
    """The same on a shaken support and with a shaken stop."""
    *elements, stop = driven(a, ω, φ, f, g).scheme.elements
    support = li.KelvinVoigt("x", "support", 100.0, 1.0), li.PrescribedMotion("support", motion(a, ω))
    table = li.PrescribedMotion("table", li.Harmonic(0.5 * a, ω, φ)), replace(stop, lower="table")
    return li.Problem("shaken", li.Scheme(*elements, *support, *table), t_end=2.0)


@pytest.mark.slow
@pytest.mark.parametrize("own_ends", [False, True])
@pytest.mark.parametrize(
    ("shaken", "method"), [(shaken, "moreau-jean"), (driven, "newmark-ns"), (driven, "schatzman-paoli")]
)
def test_loads_and_motions_of_each_set_have_the_bits_of_single_runs(shaken, method, own_ends, rng):
    base, integrator, steps = np.array([0.1, 12.0, 0.4, 3.0, -9.81]), METHODS[method](), 700
    values = base[:, None] * rng.uniform(0.8, 1.2, (5, LANES + 3))
    ends = rng.uniform(1.0, 3.0, LANES + 3) if own_ends else np.full(LANES + 3, 2.0)
    program = Program()
    traced, problem = shaken(*map(program.parameter, base)), shaken(*base)
    end = program.parameter(2.0) if own_ends else None
    compiled = lanes(
        (integrator, integrator),
        (traced.dynamics, problem.dynamics),
        (traced.initial_coordinates, traced.initial_velocities),
        Grid(2.0, steps),
        program,
        [SeriesReading("max", "q", 0)],
        [500],
        end=end,
    )
    regular, kept, states = compiled.take(np.vstack([values, ends]) if own_ends else values)
    assert regular.all()
    for k in (0, 11, LANES + 2):
        run = li.simulate(shaken(*map(float, values[:, k])), integrator, dt=ends[k] / steps, t_end=ends[k], throw=False)
        n = run.q.shape[1]
        for step, state in zip((500, steps), states, strict=True):
            assert (state[: 2 * n, k] == np.concatenate([run.q[step], run.v[step]])).all()
        assert kept[0, k] == run.q[:, 0].max()


def test_motions_of_each_set_that_are_no_harmonics_are_refused():
    program = Program()

    def ramp(a, ω):
        return li.Polynomial((0.0, a))

    with pytest.raises((NotTracedError, InputError)):
        shaken(program.parameter(0.1), 12.0, 0.4, 3.0, -9.81, ramp).dynamics  # noqa: B018
