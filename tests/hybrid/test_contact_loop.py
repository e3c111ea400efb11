"""The compiled loop over events of contacts and the general code agree, and so do flows with and without a banded matrix."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from random_schemes import random_problem
from schemes import column
from scipy.linalg import expm

from lcpimpact import Bumper, Load, Mass, Problem, Scheme, Square, load_problem, simulate
from lcpimpact.errors import Status
from lcpimpact.hybrid.event_loop import follow
from lcpimpact.hybrid.flow import Flow
from lcpimpact.hybrid.generator import DEGREE
from lcpimpact.hybrid.motion import begin_problem
from lcpimpact.hybrid.spectrum import couplings, spectral_radius
from lcpimpact.hybrid.windows import BERNSTEIN, NO_HULLS, Window, hulls, lies_above, scan
from lcpimpact.numerics.double_double import DoubleDouble

PROBLEMS = (
    "system-1", "system-2", "system-3", "bouncing-ball", "vibrating-table", "shaw-holmes", "three-balls", "two-ball-drop",
)  # fmt: skip


def followed(problem, end, compiled=True):
    """Return the motion to its end, by the compiled loop or by the general code."""
    motion = begin_problem(problem, "exact", end)
    if not compiled:
        motion.table = None
    assert follow(motion, end) is Status.SOLVED
    return motion


def assert_same(one, other):
    """Check that two motions have the same segments and events, to rounding."""
    assert [each.mode for each in one.segments] == [each.mode for each in other.segments]
    assert [(each.contact, each.kind) for each in one.events] == [(each.contact, each.kind) for each in other.events]
    for a, b in zip(one.segments, other.segments, strict=True):
        np.testing.assert_allclose(a.t0, b.t0, rtol=1e-15)
        np.testing.assert_allclose(a.X, b.X, rtol=1e-14, atol=1e-14 * np.abs(one.scale).max())
        np.testing.assert_allclose(a.before, b.before, rtol=1e-14, atol=1e-14 * np.abs(one.scale).max())
        np.testing.assert_array_equal(a.ended, b.ended)
    for a, b in zip(one.events, other.events, strict=True):
        np.testing.assert_allclose(a.impulse, b.impulse, rtol=1e-13)
        for side in ("left", "right"):
            for name in ("q", "v", "reaction"):
                ours, theirs = (getattr(getattr(each, side), name) for each in (a, b))
                np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-13 * max(1.0, np.abs(theirs).max()))


@pytest.mark.always
@pytest.mark.parametrize("name", PROBLEMS)
def test_compiled_events_are_those_of_the_general_code(name):
    problem = load_problem(name)
    compiled = followed(problem, problem.t_end)
    assert compiled.table is not None
    assert_same(compiled, followed(problem, problem.t_end, compiled=False))


@pytest.mark.parametrize("seed", [1, 2, 3, 4, 7, 9, 10, 13, 14, 16, 17, 18, 19, 20, 21, 23, 24, 25, 26, 27])
def test_so_they_are_in_random_schemes(seed):
    problem = random_problem(seed)
    assert_same(followed(problem, 3.0), followed(problem, 3.0, compiled=False))


@pytest.mark.parametrize("name", ["system-1", "system-2", "system-3", "bouncing-ball", "shaw-holmes"])
def test_hulls_find_the_events_of_the_expanded_windows_bit_by_bit(name):
    problem = load_problem(name)
    motion = begin_problem(problem, "exact", problem.t_end)
    follow(motion, problem.t_end)
    for segment in motion.segments[:8]:
        (flow, _), watch = motion.system.reaction(segment.mode), motion.system.watch(segment.mode)
        window, order = Window(flow.factors, flow.window, flow.step), np.asarray(watch.order, dtype=np.int64)
        hull = hulls(flow.A, flow.window, watch.rows.hi, BERNSTEIN[0])
        found = []
        for each in (hull, NO_HULLS):
            X, scale = np.array(segment.state.parts, order="C"), np.abs(segment.X)
            found.append(
                (scan(window, X, watch.entries, each, order, BERNSTEIN, 200, scale), X.tolist(), scale.tolist())
            )
        assert found[0] == found[1]


def test_a_row_above_its_hull_is_positive_over_the_window():
    rng, proven = np.random.default_rng(3), 0
    for _ in range(200):
        A, c, X = rng.normal(size=(4, 4)), rng.normal(size=4), rng.normal(size=(2, 4))
        X[1], δ = 0.0, 0.25
        hull = hulls(A, δ, c[None], BERNSTEIN[0])[0]
        step, x, values = expm(A * δ / 59), X[0], np.empty(60)
        for i in range(60):
            values[i], x = c @ x, step @ x
        above = lies_above(hull, X, np.empty(DEGREE + 1))
        proven += above
        assert not above or values.min() > 0.0
        assert above or values.min() < 0.3 * np.abs(values).max()
    assert proven > 50


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_so_they_are_in_columns_that_meet_at_once(e):
    problem = column([1.0, 2.0, 1.0, 3.0], [0.1, 0.1, 0.2], [0.0, -1.0, -2.0, -3.0], e)
    assert_same(followed(problem, 2.0), followed(problem, 2.0, compiled=False))


@pytest.mark.parametrize("height", [0.0, 0.2])
def test_so_they_are_where_the_contacts_are_redundant(height):
    """A rigid beam on three supports, beside a ball whose impacts are events of the whole."""
    scheme = Scheme.of_matrices(
        np.diag([2.0, 0.1, 1.0]),
        f=[-2.0 * 9.81, 0.0, -9.81],
        H=[[1.0, -0.5, 0.0], [1.0, 0.0, 0.0], [1.0, 0.5, 0.0], [0.0, 0.0, 1.0]],
        gaps=[0.0, 0.0, 0.0, 0.0],
        e=[0.0, 0.0, 0.0, 0.5],
        coordinates=["y", "phi", "x"],
    )
    problem = Problem("beam", scheme, q0={"y": height, "x": 0.3})
    compiled = followed(problem, 0.6)
    assert compiled.table is not None
    assert len([event for event in compiled.events if event.kind == "impact"]) > 1
    np.testing.assert_allclose(compiled.segments[-1].X[:2], 0.0, atol=1e-15)
    assert_same(compiled, followed(problem, 0.6, compiled=False))


def test_so_they_are_about_breakpoints_of_a_load():
    scheme = Scheme(Mass("x", 1.0), Load("x", Square(30.0, 7.0)), Load("x", 9.81), Bumper("x", "ground", e=0.6))
    problem = Problem("pushed", scheme, q0={"x": -0.1})
    assert_same(followed(problem, 2.0), followed(problem, 2.0, compiled=False))


@pytest.mark.parametrize("late", [-1.0, 0.5, 3.0, 20.0])
def test_so_they_are_where_an_impact_is_at_the_end(late):
    scheme = Scheme(Mass("x", 1.0), Load("x", 9.81), Bumper("x", "ground", e=0.6))
    problem = Problem("ball", scheme, q0={"x": -0.1})
    end = np.sqrt(0.2 / 9.81) * (1.0 - late * np.finfo(float).eps)
    compiled = followed(problem, end)
    assert len(compiled.events) == (late < 4.0)
    assert_same(compiled, followed(problem, end, compiled=False))


def test_the_end_may_be_a_whole_number():
    problem = load_problem("system-1")
    assert_same(followed(problem, np.int64(3)), followed(problem, 3.0))


def test_a_named_solver_is_asked():
    problem = load_problem("system-1")
    assert begin_problem(problem, "exact", 3.0, "lemke").table is None


def test_the_limit_of_events_is_that_of_the_general_code():
    problem = load_problem("bouncing-ball")
    run = simulate(problem, "exact", dt=problem.t_end / 10, throw=False, max_events=7)
    assert run.status is Status.MAX_EVENTS
    assert sum(event.kind == "impact" for event in run.events) == 7


def test_runs_of_one_problem_in_threads_are_the_run_alone():
    problem = load_problem("vibrating-table")
    alone = followed(load_problem("vibrating-table"), problem.t_end)
    with ThreadPoolExecutor(4) as pool:
        runs = list(pool.map(lambda _: followed(problem, problem.t_end), range(8)))
    for run in runs:
        assert_same(run, alone)


def test_the_next_run_of_a_problem_knows_its_modes():
    problem = load_problem("system-2")
    first, second = followed(problem, 3.0), followed(problem, 3.0)
    assert second.system is first.system
    assert_same(first, second)
    assert followed(problem, 2.0).system is not first.system


def test_a_bar_moves_as_its_dense_generator_says():
    motion = begin_problem(load_problem("bar-impact", elements=20), "exact", 1.5)
    flow, _ = motion.system.reaction(motion.segments[0].mode)
    assert flow.factors.band.shape[2] == 20
    plain = Flow(flow.generator, flow.duration)
    X = DoubleDouble.of(np.random.default_rng(0).normal(size=len(flow.A)))
    t = 100.3 * flow.window
    size = np.abs(plain.move(X, t).hi).max()
    assert np.abs((flow.move(X, t) - plain.move(X, t)).hi).max() < 1e-26 * size
    steps = flow.move(X, t, far=True)
    object.__setattr__(flow, "walks", True)
    assert np.abs((flow.move(X, t) - steps).hi).max() < 1e-26 * size


def test_the_spectral_radius_is_bounded_closely_from_above():
    rng = np.random.default_rng(1)
    for n in (1, 2, 5, 30):
        A = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.6)
        exact = np.abs(np.linalg.eigvals(couplings(A))).max()
        assert exact <= spectral_radius(A) * (1.0 + 1e-12)
        assert spectral_radius(A) <= 1.001 * exact
    assert spectral_radius(np.array([[0.0, 1.0], [0.0, 0.0]])) == 0.0
