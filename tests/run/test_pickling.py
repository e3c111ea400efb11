"""Problems, runs, comparisons and failures travel between processes, whole."""

import pickle
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.sparse import csc_matrix, csr_matrix

import lcpimpact as li
from lcpimpact.integrators import METHODS
from lcpimpact.lcp import SOLVERS
from lcpimpact.problems import PROBLEMS


def copy(thing):
    return pickle.loads(pickle.dumps(thing))


def assert_same_run(a, b):
    for name in ("t", "q", "v", "t_reaction", "reaction"):
        assert_array_equal(getattr(a, name), getattr(b, name))
    assert repr(a) == repr(b)
    for left, right in zip(a.events, b.events, strict=True):
        assert (left.t, left.contact, left.kind, left.impulse) == (right.t, right.contact, right.kind, right.impulse)
        for name in ("q", "v", "reaction"):
            assert_array_equal(getattr(left.right, name), getattr(right.right, name))
    times = np.linspace(0.0, a.t[-1], 7)
    for side in ("left", "right"):
        for name in ("q", "v", "reaction"):
            assert_array_equal(getattr(a.sample(times, side), name), getattr(b.sample(times, side), name))


def measured(problem, run):
    found = {}
    for fact in problem.facts:
        try:
            found[fact.symbol] = fact.measure(run)
        except li.InputError as error:
            found[fact.symbol] = str(error)
    return found


@pytest.mark.parametrize("name", PROBLEMS)
def test_a_problem_that_was_pickled_gives_the_same_run_and_knows_the_same_facts(name):
    problem = li.load_problem(name)
    assert problem.facts is not None, "they are known when the problem is pickled"
    again = copy(problem)
    assert again == problem
    assert [(each.symbol, each.value) for each in again.facts] == [(each.symbol, each.value) for each in problem.facts]
    times = np.linspace(0.0, problem.t_end, 101)
    assert (again.motion is None) == (problem.motion is None)
    if problem.motion is not None:
        assert_array_equal(again.motion(times), problem.motion(times))
    runs = [li.simulate(each, dt=problem.t_end / 500, t_end=problem.t_end) for each in (problem, again)]
    assert_same_run(*runs)
    assert measured(problem, runs[0]) == measured(again, runs[1])


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ["system-1", "system-2", "bouncing-ball", "hertz-impact", "jenkins-cycle"])
def test_a_run_by_any_method_is_pickled_with_its_continuous_solution(name, method):
    parameters = {"e": 0.5} if name == "bouncing-ball" else {}
    problem = li.load_problem(name, **parameters)
    t_end = 1.2 if name == "bouncing-ball" else problem.t_end
    try:
        run = li.simulate(problem, method, dt=t_end / 400, t_end=t_end)
    except li.UnsupportedError:
        return
    again = copy(run)
    assert_same_run(run, again)
    assert (again.dense is None) == (run.dense is None)
    assert again.certificate == run.certificate
    assert dict(again.stats) == dict(run.stats)
    assert measured(problem, run) == measured(again.problem, again)


@pytest.mark.parametrize("solver", ["RK23", "RK45", "DOP853", "Radau", "BDF", "LSODA"])
def test_every_solver_of_scipy(solver):
    run = li.simulate(li.load_problem("system-1"), "event-driven", dt=0.1, t_end=2.0, ode_solver=solver)
    assert_same_run(run, copy(run))


def test_a_comparison_and_a_verdict():
    found = li.compare(li.load_problem("system-1"), ["moreau-jean", "rk4"], dt=1e-2, t_end=1.0)
    again = copy(found)
    assert list(again.runs) == list(found.runs)
    for name, run in found.runs.items():
        assert_same_run(run, again.runs[name])
    verdict = li.cross_validate(li.load_problem("bouncing-ball", e=0.5), ["exact", "moreau-jean"], t_end=0.5)
    assert str(copy(verdict)) == str(verdict)


M = [[4.0, -1.0, 0.0], [-1.0, 4.0, -1.0], [0.0, -1.0, 4.0]]
Q = [-1.0, 2.0, -3.0]


@pytest.mark.parametrize(
    "M",
    [
        li.Dense(M, ["p"]),
        li.Banded([[4.0, 4.0, 4.0], [-1.0, -1.0, 0.0]]),
        li.Factored(M, [[1.0, 0.0, 0.0], [0.0, -1.0, 1.0], [0.0, 0.0, 1.0]], ["p"]),
        li.Factored(csc_matrix(M), csr_matrix([[1.0, 0.0, 0.0], [0.0, -1.0, 1.0]])),
    ],
    ids=["dense", "banded", "factored", "sparse factors"],
)
def test_a_matrix_of_an_lcp(M):
    M.diagonal(np.empty(M.n))
    again = copy(M)
    assert (type(again), again.tags) == (type(M), M.tags)
    assert_array_equal(again.array(), M.array())


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_solver_that_was_made_ready(solver):
    n = 2 if solver == "closed-form" else 3
    ready = li.prepare_lcp(np.array(M)[:n, :n], solver, upper=None if "primal" in solver else np.inf)
    again = copy(ready)
    assert again.solver == ready.solver
    found, expected = again.solve(Q[:n]), ready.solve(Q[:n])
    assert_array_equal(found.z, expected.z)
    assert (found.status, found.route, found.iterations) == (expected.status, expected.route, expected.iterations)


def test_a_solution_with_its_trace_and_a_failure():
    found = li.solve_lcp(M, Q, "lemke", trace=True)
    again = copy(found)
    assert str(again.trace) == str(found.trace)
    assert_array_equal(again.z, found.z)
    with pytest.raises(li.FailureError) as caught:
        li.solve_lcp([[-1.0, 0.0], [0.0, 1.0]], [-1.0, -1.0], "lemke")
    failure = copy(caught.value)
    assert (type(failure), str(failure)) == (li.FailureError, str(caught.value))
    assert failure.result.status is caught.value.result.status is li.Status.RAY
    assert_array_equal(failure.result.ray, caught.value.result.ray)


def driven(omega):
    return li.load_problem("shaw-holmes", omega=omega)


def greatest(run):
    return run["R"].max()


STUDIES = {
    "ledger": lambda: li.energy_ledger(li.simulate(li.load_problem("system-1"), "exact", dt=1e-1, t_end=1.0)),
    "sensitivity": lambda: li.sensitivity(li.load_problem("system-1"), ["c_o"], ["R.max"], t_end=1.0),
    "design": lambda: li.design("kelvin-voigt", m=1.0, v0=2.0, e=0.5, contact_time=0.01),
    "orbit": lambda: li.periodic_orbit(driven(2.8), transient=20),
    "branch": lambda: li.continue_orbit(driven, [2.8, 2.81], transient=20),
    "fit": lambda: li.fit(
        li.load_problem("system-1"),
        ["k_o"],
        outputs={"R": li.Target(greatest, 2500.0)},
        method="moreau-jean",
        dt=1e-2,
        t_end=0.5,
    ),
}


@pytest.mark.parametrize("kind", STUDIES)
def test_what_a_study_found(kind):
    found = STUDIES[kind]()
    again = copy(found)
    assert type(again) is type(found)
    assert repr(again) == repr(found)


def fall(max_events):
    return li.simulate(li.load_problem("bouncing-ball"), "exact", dt=0.1, t_end=4.5, max_events=max_events)


def test_a_failure_keeps_its_result():
    with pytest.raises(li.FailureError) as caught:
        fall(3)
    again = copy(caught.value)
    assert (type(again), str(again)) == (li.FailureError, str(caught.value))
    assert_same_run(again.result, caught.value.result)


@pytest.mark.slow
def test_runs_and_failures_come_back_from_another_process():
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        run = pool.submit(li.simulate, li.load_problem("system-1"), "exact", dt=0.1, t_end=2.0).result()
        with pytest.raises(li.FailureError, match="max_events") as caught:
            pool.submit(fall, 3).result()
    assert_same_run(run, li.simulate(li.load_problem("system-1"), "exact", dt=0.1, t_end=2.0))
    assert caught.value.result.status is li.Status.MAX_EVENTS
