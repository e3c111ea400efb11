"""Derivatives of motions from the formulas of a scheme, against those from differences of neighbouring problems."""

import itertools

import numpy as np
import pytest
from numpy.testing import assert_allclose

import lcpimpact as li
from lcpimpact import Bumper, Dashpot, Friction, Harmonic, KelvinVoigt, Load, Mass, Problem, Scheme, Slider, Spring
from lcpimpact.hybrid import variation
from lcpimpact.hybrid.variation import Variation, VariedFlow, family_of
from lcpimpact.numerics.double_double import with_slopes
from lcpimpact.problems import PROBLEMS
from lcpimpact.problems.parameters import changes_at, constants_of, is_registered, numbers_of, value_at, with_values


def random_problem(seed):
    """A chain of bodies with bumpers, plates without mass, sliders, and a block that falls on a table and rubs on it."""
    rng = np.random.default_rng(seed)
    nodes = ["a", "b", "c"][: int(rng.integers(1, 4))]
    elements = [Mass(node, m=rng.uniform(0.5, 3.0)) for node in nodes]
    elements += [Load(nodes[0], f=Harmonic(rng.uniform(2.0, 6.0), rng.uniform(1.0, 4.0), rng.uniform(0.0, 3.0)))]
    for one, other in itertools.pairwise([*nodes, "ground"]):
        elements += [Spring(one, other, k=rng.uniform(5.0, 40.0)), Dashpot(one, other, c=rng.uniform(0.1, 1.0))]
    v0 = {node: rng.uniform(0.5, 2.0) for node in nodes}
    if rng.random() < 0.5:
        elements += [Bumper(nodes[-1], "ground", gap=rng.uniform(0.05, 0.2), e=rng.uniform(0.3, 0.9), name="R")]
    else:
        elements += [KelvinVoigt("p", "ground", k=rng.uniform(50.0, 90.0), c=rng.uniform(2.0, 9.0))]
        elements += [Bumper(nodes[-1], "p", gap=rng.uniform(0.02, 0.1), name="R")]
    if rng.random() < 0.5:
        elements += [Slider(nodes[0], "ground", r0=rng.uniform(0.2, 1.5))]
    if rng.random() < 0.5:
        elements += [Mass("y", m=rng.uniform(0.5, 1.5)), Load("y", f=rng.uniform(4.0, 12.0))]
        elements += [Bumper("y", "ground", e=0.0, name="N")]
        elements += [Friction(nodes[0], "ground", rng.uniform(0.05, 0.3), normal="N")]
        v0["y"] = -rng.uniform(0.5, 2.0)
    return Problem("random", Scheme(*elements), v0=v0)


def derivative(problem, addresses, t_end):
    """X_p at the end of a motion, and the parameters that are differenced."""
    run = li.simulate(problem, "exact", dt=t_end / 50, t_end=t_end, error=False, throw=False)
    solution = run.dense.solution
    values = {name: value_at(problem, name) for name in addresses}
    family = family_of(
        solution.system, problem, changes_at(problem, addresses), values, {n: abs(v) for n, v in values.items()}
    )
    last = len(solution.segments) - 1
    return Variation(solution, family).at(last, np.array([t_end - solution.segments[last].t0]))[1][
        0
    ], family.differenced


def two_ways(monkeypatch, problem, addresses, t_end):
    """X_p by formulas and by differences; None where neither exists."""
    found = []
    for traced in (True, False):
        if not traced:
            monkeypatch.setattr(variation, "_traced", lambda base, make, values: (base, []))
        try:
            found.append(derivative(problem, addresses, t_end))
        except li.UnsupportedError as error:
            found.append(str(error))
    monkeypatch.undo()
    if isinstance(found[0], str) or isinstance(found[1], str):
        assert found[0] == found[1]
        return None
    (by_formulas, differenced), (by_differences, every) = found
    assert every == tuple(addresses)
    return by_formulas, by_differences, differenced


@pytest.mark.parametrize("seeds", [range(10), pytest.param(range(10, 110), marks=pytest.mark.slow)])
def test_random_schemes_by_formulas_and_by_differences(monkeypatch, seeds):
    compared = 0
    for seed in seeds:
        problem = random_problem(seed)
        addresses = list(constants_of(problem))[seed % 3 :: 3]  # the others, of schemes like it, by the next seeds
        found = two_ways(monkeypatch, problem, addresses, 2.0)
        if found is None:
            continue
        compared += 1
        by_formulas, by_differences, differenced = found
        assert not differenced, seed
        size = np.abs(by_differences).max(axis=0)
        size = np.where(size > 0.0, size, 1.0)  # of a parameter on which nothing depends
        assert_allclose(by_formulas / size, by_differences / size, rtol=0, atol=1e-10, err_msg=str(seed))
    assert compared >= 0.7 * len(seeds)


def is_smooth(problem, address, value):
    """Whether a parameter may be changed a little, and is no whole number."""
    try:
        with_values(problem, {address: 0.999 * value})
    except li.InputError:
        return False
    return True


FEW = ("system-2", "impact-oscillator", "ball-in-air", "stick-slip-belt", "thrown-block", "relay-oscillator")


@pytest.mark.parametrize(
    "name", [name if name in FEW else pytest.param(name, marks=pytest.mark.slow) for name in PROBLEMS]
)
def test_registered_problems_by_formulas_and_by_differences(monkeypatch, name):
    problem = li.load_problem(name)
    assert is_registered(problem)
    if "elements" in problem.parameters:
        problem = li.load_problem(name, elements=10)  # the same elements as in a finer bar
    addresses = [each for each, value in numbers_of(problem).items() if value and is_smooth(problem, each, value)]
    t_end = min(problem.t_end, 2.0)
    try:
        found = two_ways(monkeypatch, problem, addresses, t_end)
    except li.UnsupportedError:  # by the method
        pytest.skip("exact does not handle it")
    if found is None or not addresses:
        pytest.skip("it has no derivative")
    by_formulas, by_differences, _ = found
    size = np.abs(by_differences).max(axis=0)
    size = np.maximum(size, 1e-6 * size.max())
    assert_allclose(by_formulas / size, by_differences / size, rtol=0, atol=1e-9)


def test_the_flow_of_strong_constants():
    """An overdamped oscillator: x' = -(k/c) x after the start, for c²/(m k) = 1e12."""
    m, c, k, t = 1.0, 1e6, 1.0, 3.0
    A = np.array([[0.0, 1.0], [-k / m, -c / m]])
    A_k, A_c = np.array([[0.0, 0.0], [-1.0 / m, 0.0]]), np.array([[0.0, 0.0], [0.0, -1.0 / m]])
    flow = VariedFlow(with_slopes(A, np.array([A_k, A_c])), 2.0**-20)
    X, X_p = flow.move(with_slopes([1.0, 0.0], np.zeros((2, 2))), np.array([t]))
    root = np.sqrt(c**2 - 4.0 * k * m)
    slow, fast = -2.0 * k / (c + root), -(c + root) / (2.0 * m)
    assert_allclose(X[0, 0], (fast * np.exp(slow * t) - slow * np.exp(fast * t)) / (fast - slow), rtol=1e-14)
    rates_p = np.array([[-1.0 / root, 1.0 / root], [-slow / root, fast / root]])  # of slow and fast, by k and c
    by_slow = fast * t * np.exp(slow * t) / (fast - slow) + X[0, 0] / (fast - slow)
    by_fast = np.exp(slow * t) / (fast - slow) - X[0, 0] / (fast - slow)
    assert_allclose(X_p[0, 0], rates_p @ [by_slow, by_fast], rtol=1e-10)
