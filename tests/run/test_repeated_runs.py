"""What a system keeps from one run for the next changes no run."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict

import numpy as np
import pytest
from numpy.testing import assert_array_equal, assert_equal

import lcpimpact as li
from lcpimpact.integrators import METHODS
from lcpimpact.integrators.moreau_jean import MoreauJean
from lcpimpact.memo import once

PROBLEMS = ("system-1", "system-2", "hertz-impact", "stick-slip-belt", "spinning-ball", "vibrating-table", "twisting")


def run(problem, method="moreau-jean", steps=700, **options):
    return li.simulate(problem, method, dt=problem.t_end / steps, t_end=problem.t_end, **options)


def assert_same(a, b):
    for name in ("t", "q", "v", "t_reaction", "reaction"):
        assert_array_equal(getattr(a, name), getattr(b, name))
    assert_equal(asdict(a.certificate), asdict(b.certificate))
    assert [(each.t, each.kind, each.impulse) for each in a.events] == [
        (each.t, each.kind, each.impulse) for each in b.events
    ]


@pytest.mark.parametrize("name", PROBLEMS)
def test_a_second_run_is_the_first(name):
    problem = li.load_problem(name)
    first = run(problem)
    other = run(problem, steps=300), run(problem, theta=1.0), run(problem, steps=300, theta=1.0)
    assert_same(first, run(problem))
    fresh = li.load_problem(name)
    for again, options in zip(other, ({"steps": 300}, {"theta": 1.0}, {"steps": 300, "theta": 1.0}), strict=True):
        assert_same(again, run(fresh, **options))
    assert not np.array_equal(first.q, other[1].q)


@pytest.mark.parametrize("solver", ["lemke", "qp:osqp"])
def test_a_table_belongs_to_its_solver(solver):
    problem = li.load_problem("three-balls")
    run(problem)
    assert_same(run(problem, lcp_solver=solver), run(li.load_problem("three-balls"), lcp_solver=solver))
    assert_same(run(problem, lcp_solver=solver), run(li.load_problem("three-balls"), lcp_solver=solver))


@pytest.mark.parametrize("name", PROBLEMS)
def test_runs_of_one_system_in_threads_are_those_of_one_thread(name):
    problem = li.load_problem(name)
    alone = run(problem)
    with ThreadPoolExecutor(4) as threads:
        for each in threads.map(lambda _: run(problem), range(8)):
            assert_same(alone, each)


@pytest.mark.compiled
def test_a_table_is_kept_only_if_no_run_changes_it():
    d = li.load_problem("system-1").dynamics
    assert MoreauJean().prepared(d, 1e-3, "auto") is MoreauJean().prepared(d, 1e-3, "auto")
    for other in (MoreauJean(theta=0.7).prepared(d, 1e-3, "auto"), MoreauJean().prepared(d, 2e-3, "auto")):
        assert other is not MoreauJean().prepared(d, 1e-3, "auto")
    assert METHODS["newmark-ns"]().prepared(li.load_problem("bouncing-ball").dynamics, 1e-3, "auto")
    assert MoreauJean().prepared(d, 1e-3, "qp:osqp") is not MoreauJean().prepared(d, 1e-3, "qp:osqp")
    belt = li.load_problem("stick-slip-belt").dynamics
    assert MoreauJean().prepared(belt, 1e-3, "auto") is not MoreauJean().prepared(belt, 1e-3, "auto")


def test_a_function_of_a_system_is_computed_once_for_each_system():
    calls = []

    @once
    def size(d):
        calls.append(d)
        return len(d.nodes)

    one, other = li.load_problem("system-1").dynamics, li.load_problem("bouncing-ball").dynamics
    assert [size(one), size(other), size(one), size(other)] == [2, 1, 2, 1]
    assert len(calls) == 2
