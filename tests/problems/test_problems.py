"""Every registered problem: its closed forms against computations that import nothing of lcpimpact, its runs against both.

`OUTSIDE` holds, problem by problem, the same numbers as its facts, found by SciPy's DOP853 with modes and events written by
hand, by enumeration of impacts, or along characteristics. A new problem is taken in by the tests over the registry at once,
and stays red until it has an entry there.
"""

import inspect
import math
import re
from functools import cache
from itertools import combinations, pairwise

import mpmath
import numpy as np
import pytest
from contact_references import REFERENCES as CONTACTS
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from lagrangian_references import REFERENCES
from numpy.testing import assert_allclose
from rough_contacts import Bodies, Rough
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq, minimize_scalar, root

import lcpimpact as li
from lcpimpact import reading
from lcpimpact.errors import InputError
from lcpimpact.integrators import METHODS
from lcpimpact.problems import PROBLEMS, load_problem
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.free_vibration import angle, free_vibration

BARS = {"bar-impact", "bouncing-bar", "plastic-bar-impact"}
"""Finite elements: their facts are those of the continuum, and `exact` takes long over so many nodes."""

MODELS = BARS | {"hereditary-impact"}
"""Whose scheme is itself an approximation, as the accuracy of their facts says."""

LAGRANGIAN = {name for name in PROBLEMS if isinstance(load_problem(name).scheme, li.Lagrangian)}
"""Whose runs are judged in test_lagrangian_problems.py: no run of them is exact."""

COUNTS = tuple(round(200 * 32.0 ** (i / 29)) for i in range(30))
"""Thirty step counts from 200 to 6400; the end of the run is no round number, so that events fall anywhere in a step."""


FINER = {"pi-billiard": 4, "ball-in-air": 0.25}
"""How many times as many steps: more where many impacts follow each other closely, fewer where forces are iterated."""


def exact_runs(problem):
    return set(problem.dynamics.features) <= set(METHODS["exact"].declared.handles)


def run(problem, method="exact", steps=200, stretch=1.0):
    t_end = problem.t_end * stretch
    return li.simulate(problem, method, dt=t_end / steps, t_end=t_end, progress=False)


@cache
def finest(name):
    """The most accurate run that there is of a problem with its own parameters."""
    problem = load_problem(name)
    if exact_runs(problem) and name not in BARS:
        return run(problem)
    if name in BARS:
        return run(problem, "moreau-jean", steps_of_half_an_element(problem))
    if problem.dynamics.force_laws:
        return by_events(problem)
    return run(problem, "moreau-jean", 40_009)


def by_events(problem):
    """The most accurate run under a force that is a function of the motion."""
    return li.simulate(problem, "event-driven", dt=problem.t_end / 200, t_end=problem.t_end, rtol=1e-12)


def steps_of_half_an_element(problem):
    p = problem.parameters
    return round(problem.t_end / (0.5 * p["L"] / p["elements"] / math.sqrt(p["E"] / p["rho"])))


def facts(name, **parameters):
    """The closed forms by symbol."""
    return {fact.symbol: fact.value for fact in load_problem(name, **parameters).facts}


# ---- over the whole registry -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", list(PROBLEMS))
def test_every_problem_teaches(name):
    problem, text = load_problem(name), inspect.getdoc(PROBLEMS[name])
    for part in ("Parameters\n---", "Raises\n---", "Examples\n---", "References\n---", "trap"):
        assert part in text, part
    assert len(text.split("Parameters\n---")[0]) > 400, "says what there is to learn"
    for parameter in problem.parameters:
        assert re.search(rf"^[\w, ]*\b{parameter}\b[\w, ]* : ", text, re.MULTILINE), f"{parameter} is documented"


@pytest.mark.parametrize("name", list(PROBLEMS))
def test_every_problem_has_facts_and_an_outside_reference(name):
    known = load_problem(name).facts
    assert known
    assert len({fact.symbol for fact in known}) == len(known)
    for fact in known:
        assert math.isfinite(fact.value)
        assert fact.what
        assert 0.0 < fact.accuracy < 0.5
        assert fact.accuracy <= 1e-7 or name in MODELS, "a closed form holds to rounding"
    assert name in OUTSIDE
    if not name.startswith(
        "system-"
    ):  # tests/hybrid/test_exact.py holds their digits against 40-digit arithmetic and DOP853
        assert set(OUTSIDE[name](**load_problem(name).parameters)) >= {fact.symbol for fact in known}


@pytest.mark.parametrize("name", list(PROBLEMS))
def test_closed_forms_against_the_outside(name):
    check_outside(name)


def check_outside(name, **parameters):
    problem = load_problem(name, **parameters)
    outside = OUTSIDE[name](**problem.parameters)
    for fact in problem.facts:
        if fact.symbol in outside:
            scale = max(abs(fact.value), fact.scale)
            assert abs(outside[fact.symbol] - fact.value) <= 1e-9 * scale, (
                fact.symbol,
                outside[fact.symbol],
                fact.value,
            )


@pytest.mark.parametrize("name", [name for name in PROBLEMS if name not in LAGRANGIAN])
def test_facts_hold_in_the_finest_run(name):
    found = finest(name)
    limit = 1e-6 if not exact_runs(found.problem) else 0.0
    for fact in found.problem.facts:
        assert fact.error(found) <= max(fact.accuracy, limit), fact


@pytest.mark.parametrize("name", [name for name in PROBLEMS if load_problem(name).motion and name not in LAGRANGIAN])
def test_motion_in_closed_form_is_the_exact_run(name):
    found = finest(name)
    away = away_from(found.events, found.t)
    q, v = found.problem.motion(found.t)
    assert q.shape == found.q.shape
    assert_allclose(q, found.q, rtol=0, atol=1e-9 * np.abs(q).max())
    assert_allclose(v[away], found.v[away], rtol=0, atol=1e-9 * np.abs(v).max())


def away_from(events, t):
    away = np.ones(len(t), dtype=bool)
    for event in events:
        away &= np.abs(t - event.t) > 1e-9 * t[-1]
    return away


@pytest.mark.parametrize("name", list(PROBLEMS))
def test_a_run_that_is_too_short_says_so(name):
    """A fact that a run never reaches is refused with a sentence, or its value is read; nothing else comes out."""
    problem = load_problem(name)
    found, sentences = li.simulate(problem, "moreau-jean", dt=problem.t_end * 1e-4, t_end=problem.t_end * 2e-4), []
    for fact in problem.facts:
        try:
            value = fact.measure(found)
        except InputError as error:
            value, sentence = 0.0, str(error)
            sentences.append(sentence)
        assert math.isfinite(value)
    assert all(re.search(r"run longer|within the run", sentence) for sentence in sentences)


# ---- the orders of the step ------------------------------------------------------------------------------------------


def declared_order(problem):
    declared = METHODS["moreau-jean"].declared
    orders = [declared.order_force_jump]
    for contact in problem.dynamics.contacts:
        if contact.law.of_rate:
            # Of a slider on a spring too, the step in which it begins to slip leaves an error of the first order.
            orders.append(declared.order_friction)
        elif contact.limited:
            orders.append(declared.order_relay)
        elif contact.relative_degree == 2:
            orders.append(declared.order_impact)
    return min(orders)


ORDERLY = [name for name in PROBLEMS if name not in MODELS | LAGRANGIAN]


HEAVY = ("ball-in-air", "block-on-belt", "jenkins-cycle", "twisting", "two-balls-spring")


def with_slow(names):
    return [pytest.param(name, marks=pytest.mark.slow) if name in HEAVY else name for name in names]


@cache
def steps_of(name):
    problem = load_problem(name)
    # Past the end of the last fact, by a number that no event of any problem is a simple share of.
    counts = [round(FINER.get(name, 1) * n) for n in COUNTS]
    return [run(problem, "moreau-jean", n, stretch=1.0 + 1.0 / (7.0 * math.pi)) for n in counts]


def falls(errors, order):
    """Whether errors fall at an order: the worst of the ten finest against the worst of the ten coarsest."""
    rounding, ratio = 1e-11, COUNTS[0] / COUNTS[20]
    return max(errors[-10:]) <= max(2.0 * max(errors[:10]) * ratio**order, rounding)


@pytest.mark.parametrize("name", with_slow(ORDERLY))
def test_moreau_jean_reaches_the_facts_at_its_order(name):
    problem = load_problem(name)
    # The worst of the facts at each step count: the error of one alone may pass through zero.
    errors = [max(fact.error(found) for fact in problem.facts) for found in steps_of(name)]
    assert falls(errors, declared_order(problem)), errors


@pytest.mark.parametrize("name", with_slow(name for name in ORDERLY if load_problem(name).motion is not None))
def test_moreau_jean_reaches_the_motion_at_its_order(name):
    problem = load_problem(name)
    errors = []
    for found in steps_of(name):
        q, _ = problem.motion(found.t)
        massive = problem.dynamics.massive if problem.dynamics.massive.any() else np.ones(q.shape[1], dtype=bool)
        errors.append(np.abs(found.q - q)[:, massive].max() / np.abs(q).max())
    # Every swing of a switch that accumulates adds an h to the time that is left, and there are log 1/h of them.
    order = declared_order(problem) - (0.25 if name == "twisting" else 0.0)
    assert falls(errors, order), errors


def test_an_order_that_is_too_high_is_noticed():
    assert falls([1e-3 / n for n in COUNTS], 1)
    assert not falls([1e-3 / n for n in COUNTS], 2)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "limits"), [("bar-impact", (0.01,)), ("bouncing-bar", (0.01,))])
def test_contact_force_of_400_elements_within_a_per_cent(name, limits):
    problem = load_problem(name, elements=400)
    found = run(problem, "moreau-jean", steps_of_half_an_element(problem))
    force = next(fact for fact in problem.facts if fact.symbol == "ε_R")
    assert force.measure(found) < limits[0]
    energy = problem.dynamics.energy(found.q, found.v)
    gravity = found.q @ problem.dynamics.force(0.0)
    total = energy - gravity
    assert (np.diff(total) < 1e-9 * energy.max()).all(), "no energy is gained"
    assert total[0] - total[-1] < 2e-3 * energy.max()


@pytest.mark.parametrize("name", sorted(BARS))
def test_bars_approach_the_continuum_as_their_elements_get_finer(name):
    errors = []
    for elements in (20, 80):
        problem = load_problem(name, elements=elements)
        found = run(problem, "moreau-jean", steps_of_half_an_element(problem))
        for fact in problem.facts:
            assert fact.error(found) <= fact.accuracy, fact
        errors.append(problem.facts[-1].error(found))
    assert errors[1] < 0.4 * errors[0]


# ---- other parameters ------------------------------------------------------------------------------------------------


def some(low, high):
    return st.floats(low, high)


GAP = st.one_of(st.just(0.0), some(1e-3, 0.5))
INELASTIC_OR_NOT = st.one_of(st.just(0.0), some(0.05, 1.0))

RANDOM = {
    "bouncing-ball": {"m": some(0.1, 10.0), "g": some(1.0, 20.0), "H": some(0.1, 10.0), "e": some(0.1, 0.9)},
    "kelvin-voigt-impact": {"m": some(1.0, 100.0), "k": some(50.0, 5e3), "c": some(1.0, 2e3), "v0": some(0.1, 10.0)},
    "kelvin-voigt-tension": {"m": some(1.0, 100.0), "k": some(50.0, 5e3), "c": some(1.0, 2e3), "v0": some(0.1, 10.0)},
    "maxwell-impact": {"m": some(1.0, 100.0), "k": some(50.0, 5e3), "c": some(30.0, 2e3), "v0": some(0.1, 10.0)},
    "impact-oscillator": {"zeta": some(0.01, 0.3), "omega": some(2.3, 2.9), "f": some(0.5, 2.0), "e": some(0.3, 0.9)},
    "oscillator-stop": {"m": some(0.1, 10.0), "k": some(1.0, 1e3), "e": some(0.2, 1.0), "v0": some(0.1, 10.0)},
    "bilinear-oscillator": {"m": some(0.1, 10.0), "k": some(1.0, 1e3), "k_1": some(1.0, 1e4), "v0": some(0.1, 10.0)},
    "three-balls": {"e": INELASTIC_OR_NOT, "v0": some(0.1, 10.0), "d": some(0.1, 1.0), "delta": GAP},
    "two-ball-drop": {"m1": some(0.2, 5.0), "m2": some(0.2, 5.0), "e": some(0.3, 1.0), "delta": some(1e-3, 0.05)},
    "two-balls-spring": {"m": some(0.5, 2.0), "k": some(1e3, 1e5), "e": some(0.3, 1.0), "x1": some(0.5, 2.0)},
    "newtons-cradle": {"N": st.integers(2, 7), "e": some(0.6, 1.0), "delta": GAP, "v0": some(0.1, 10.0)},
    "balls-on-springs": {"m": some(0.1, 10.0), "k": some(1e2, 1e8), "v0": some(0.1, 10.0)},
    "coulomb-oscillator": {"m": some(0.1, 10.0), "k": some(10.0, 100.0), "F": some(1.0, 10.0), "x0": some(0.05, 2.0)},
    "forced-coulomb-oscillator": {"F": some(0.5, 4.0), "P": some(9.0, 12.0), "omega": some(6.0, 8.5)},
    "block-on-incline": {"m": some(0.1, 10.0), "alpha": some(0.1, 0.6), "mu": some(0.75, 2.0), "v0": some(0.1, 10.0)},
    "block-on-belt": {"m": some(0.5, 2.0), "k": some(50.0, 200.0), "mu": some(0.2, 1.0), "v_b": some(0.01, 0.1)},
    "buck-converter": {"E": some(19.0, 23.5), "R": some(18.0, 26.0), "V_ref": some(10.8, 11.8)},
    "stick-slip-belt": {"m": some(0.5, 2.0), "mu": some(0.1, 0.4), "mu_s": some(0.45, 1.0), "v_b": some(0.02, 1.0)},
    "thrown-block": {"mu": some(0.05, 1.0), "e": some(0.1, 0.9), "v_x": some(0.5, 5.0), "v_y": some(0.5, 5.0)},
    "rolling-sphere": {"k": some(0.1, 1.0), "mu": some(0.1, 1.0), "v0": some(0.1, 5.0), "omega0": some(0.0, 100.0)},
    "spinning-ball": {"k": some(0.1, 1.0), "mu": some(0.05, 1.0), "e": some(0.1, 0.8), "omega0": some(1.0, 100.0)},
    "super-ball": {"k": some(0.1, 1.0), "H": some(0.1, 2.0), "omega0": some(1.0, 100.0)},
    "super-ball-table": {"k": some(0.1, 1.0), "h": some(0.1, 2.0), "v_x": some(0.1, 5.0), "v_y": some(0.5, 5.0)},
    "plastic-ball": {"m": some(0.1, 10.0), "A": some(0.0026, 0.006)},
    "impact-pair": {"m": some(0.1, 10.0), "d": some(0.05, 0.2), "e": some(0.3, 0.9), "omega": some(1.0, 100.0)},
    "impact-damper": {"m": some(0.09, 0.11), "d": some(0.18, 0.22), "e": some(0.3, 0.6), "F": some(0.95, 1.05)},
    "nonsmooth-mode": {"m1": some(0.95, 1.05), "k2": some(0.95, 1.05), "d": some(0.1, 2.0), "omega": some(0.92, 1.0)},
    "cam-follower": {"m": some(0.2, 0.22), "F": some(50.0, 60.0), "k": some(1e3, 2e3), "omega": some(290.0, 310.0)},
    "diode-bridge-supply": {"V0": some(1.0, 100.0), "omega": some(1e2, 1e5), "C": some(1e-7, 1e-6), "R": some(5e2, 2e3)},
    "inertia-drive": {"m": some(0.01, 10.0), "mu": some(0.05, 0.4), "T": some(0.03, 0.06), "share": some(0.05, 0.4)},
    "pi-billiard": {"M": some(0.3, 300.0), "v0": some(0.1, 10.0), "D": some(0.1, 2.0), "d": some(0.1, 2.0)},
    "inelastic-collapse": {"e": some(0.01, 0.06), "v0": some(0.1, 10.0), "d": some(0.1, 1.0), "delta": some(0.1, 1.0)},
    "jenkins-cycle": {"k": some(50.0, 200.0), "f_y": some(1.0, 8.0), "X": some(0.1, 1.0), "k_h": some(0.0, 100.0)},
    "vibrating-table": {"m": some(0.1, 10.0), "e": some(0.4, 0.9), "omega": some(20.0, 100.0), "swing": some(1.05, 1.3)},
    "rocking-block": {"p": some(0.5, 5.0), "alpha": some(0.05, 0.4), "tilt": some(0.05, 0.95), "e": some(0.5, 1.0)},
    "diode-bridge": {"L": some(1e-3, 1e-1), "C": some(1e-7, 1e-5), "R": some(30.0, 1e4), "v0": some(1.0, 100.0)},
    "sliding-mode": {"a": some(1.0, 3.0), "d": some(-0.5, 0.5), "c": some(0.3, 1.0), "x0": some(0.1, 1.0)},
    "relay-oscillator": {"a": some(0.1, 10.0), "x0": some(0.01, 100.0)},
    "twisting": {"r1": some(2.0, 9.0), "r2": some(0.5, 1.5), "x0": some(0.1, 10.0)},
    "reflected-motion": {"A": some(1.0, 3.0), "omega": some(0.3, 1.0), "x0": some(0.1, 0.9)},
    "system-1": {"m": some(50.0, 200.0), "k_o": some(1e3, 1e4), "c_o": some(50.0, 500.0), "h_o": some(1.0, 10.0)},
    "system-2": {"m": some(50.0, 200.0), "k": some(1e3, 1e4), "c_o": some(50.0, 500.0), "h_o": some(1.0, 10.0)},
    "system-3": {"m": some(50.0, 200.0), "c": some(50.0, 500.0), "c_o": some(50.0, 500.0), "h_o": some(1.0, 10.0)},
}  # fmt: skip


def physical(name, drawn):
    """Parameters of the problem, from those that are drawn relative to others."""
    drawn = dict(drawn)
    if name == "vibrating-table":
        e, omega = drawn["e"], drawn["omega"]
        drawn["A"] = drawn.pop("swing") * math.pi * (1 - e) / (1 + e) * 9.81 / omega**2
    if name == "rocking-block":
        drawn["theta"] = drawn.pop("tilt") * drawn["alpha"]
    if name == "coulomb-oscillator":
        # Where a turning point is the edge of the rest positions, rounding decides whether it swings on by nothing.
        half_swings = 0.5 * (drawn["k"] * drawn["x0"] / drawn["F"] - 1.0)
        assume(abs(half_swings - round(half_swings)) > 1e-9)
    return drawn


@pytest.mark.parametrize("name", with_slow(RANDOM))
@settings(max_examples=6)
@given(data=st.data())
def test_facts_hold_for_other_parameters(name, data):
    parameters = physical(name, data.draw(st.fixed_dictionaries(RANDOM[name])))
    check_outside(name, **parameters)
    problem = load_problem(name, **parameters)
    found = run(problem)
    for fact in problem.facts:
        assert fact.error(found) <= fact.accuracy, fact
    if problem.motion is not None:
        q, _ = problem.motion(found.t)
        assert_allclose(q, found.q, rtol=0, atol=1e-8 * np.abs(q).max())


REGIMES = [
    *(("kelvin-voigt-impact", {"m": 1.0, "k": 1.0, "c": 2.0 * ζ}) for ζ in (0.01, 0.5, 0.9, 1.0, 1.0 + 1e-9, 1.5, 4.0)),
    *(("kelvin-voigt-tension", {"m": 1.0, "k": 1.0, "c": 2.0 * ζ}) for ζ in (0.01, 0.9, 1.0, 2.0)),
    *(("maxwell-impact", {"m": 1.0, "k": 1.0, "c": 0.5 / ζ}) for ζ in (0.01, 0.7, 1.0, 1.3)),
    *(("diode-bridge", {"R": 50.0 / ζ}) for ζ in (0.001, 0.9, 1.0, 3.0)),
    ("coulomb-oscillator", {"x0": 0.04}),
    ("coulomb-oscillator", {"x0": 2.0}),
    ("jenkins-cycle", {"X": 0.04}),
    ("jenkins-cycle", {"k_h": 50.0}),
    ("forced-coulomb-oscillator", {"omega": 15.0, "F": 4.0}),
    ("forced-coulomb-oscillator", {"omega": 4.0, "F": 1.0}),
    ("block-on-incline", {"mu": 0.3}),
    ("block-on-incline", {"mu": 0.0}),
    ("thrown-block", {"mu": 0.6}),
    ("thrown-block", {"mu": 1.2}),
    ("rolling-sphere", {"omega0": -100.0}),
    ("rolling-sphere", {"k": 0.5, "omega0": 30.0}),
    ("spinning-ball", {"mu": 0.5}),
    ("spinning-ball", {"mu": 0.5, "e_T": 0.4}),
    ("spinning-ball", {"mu": 0.02}),
    ("spinning-ball", {"mu": 0.0}),
    ("spinning-ball", {"e": 0.0}),
    ("spinning-ball", {"e": 1.0, "e_T": 1.0, "mu": 5.0}),
    ("super-ball", {"k": 2.0 / 3.0}),
    ("super-ball-table", {"k": 0.5}),
    ("plastic-ball", {"A": 0.0083}),
    ("plastic-ball", {"A": 0.012}),
    ("impact-pair", {"n": 3, "d": 1.0}),
    ("nonsmooth-mode", {"omega": 0.7}),
    ("nonsmooth-mode", {"omega": 0.85}),
    ("nonsmooth-mode", {"omega": 1.7}),
    ("cam-follower", {"omega": 200.0}),
    ("cam-follower", {"omega": 50.0}),
    ("cam-follower", {"e": 0.7}),
    *(("train-brakes", {"N": N}) for N in (1, 2)),
    ("train-brakes", {"t_s": 0.1}),
    ("impact-damper", {"c": 0.01, "omega": 11.0, "d": 0.1}),
    ("impact-damper", {"e": 1.0, "m": 0.2, "d": 0.1}),
    ("impact-pair", {"e": 1.0, "A": 0.01}),
    *(("pi-billiard", {"M": M}) for M in (0.5, 1.0, 3.0, 1e4)),
    *(("inelastic-collapse", {"e": e}) for e in (0.01, 0.08, 0.5, 1.0)),
    ("two-ball-drop", {"delta": 0.0, "e": 0.7}),
    ("newtons-cradle", {"delta": 0.0, "e": 0.6}),
    ("newtons-cradle", {"N": 2}),
    ("vibrating-table", {"n": 2, "A": 0.006}),
    ("impact-oscillator", {"n": 2, "omega": 4.4}),
    ("impact-oscillator", {"s": 0.1}),
    ("shaw-holmes", {"s": 0.2, "v0": 1.0}),
    ("shaw-holmes", {"x0": -0.1, "v0": -1.0, "zeta": 1.0}),
    ("thrown-ball", {"v0": -1.0}),
    ("thrown-ball", {"h": 0.3, "e": 0.0}),
    ("rocking-block", {"theta": 0.199}),
    ("rocking-block", {"e": 0.0}),
    ("bouncing-ball", {"e": 0.0}),
    ("bouncing-ball", {"e": 1.0}),
    ("ball-in-air", {"e": 0.0}),
    ("ball-in-air", {"e": 1.0, "c": 5.0}),
    ("ball-in-air", {"c": 1e-6}),
    ("oscillator-stop", {"e": 0.0}),
    ("oscillator-stop", {"e": 0.99999, "m": 0.5, "k": 1.0, "v0": 1.0}),
    ("system-3", {"c": 60.0}),
]


@pytest.mark.parametrize(("name", "parameters"), REGIMES, ids=lambda value: value if isinstance(value, str) else "")
def test_facts_hold_in_every_regime(name, parameters):
    check_outside(name, **parameters)
    problem = load_problem(name, **parameters)
    assert problem.facts
    found = by_events(problem) if problem.dynamics.force_laws else run(problem)
    for fact in problem.facts:
        assert fact.error(found) <= fact.accuracy, fact


@pytest.mark.parametrize("name", ["hertz-impact", "hunt-crossley-impact"])
@settings(max_examples=10)
@given(n=some(1.0, 3.0), v0=some(0.1, 10.0), K=some(1.0, 1e6), b=some(0.05, 2.0))
def test_power_laws_for_other_parameters(name, n, v0, K, b):
    parameters = {"m": 1.0, "n": n, "v0": v0, "K": K} | ({"b": b / v0} if name == "hunt-crossley-impact" else {})
    check_outside(name, **parameters)


@pytest.mark.parametrize(
    "parameters", [*({"N": N} for N in (2, 4, 5, 6, 7)), {"m": 2.0, "K": 10.0, "v0": 3.0}], ids=str
)
def test_final_velocities_of_hertz_chains(parameters):
    check_outside("hertz-chain", **parameters)


@pytest.mark.slow
@pytest.mark.parametrize("alpha", [0.2, 0.5, 0.8])
def test_hereditary_impact_converges_with_its_sum_of_exponentials(alpha):
    T = 100.0 ** (-1.0 / (2.0 - alpha))
    for t_min, rtol in ((1e-2, 1e-3), (1e-3, 1e-4)):
        problem = load_problem("hereditary-impact", alpha=alpha, t_min=t_min * T, rtol=rtol)
        found = run(problem, "moreau-jean", 4001)
        for fact in problem.facts:
            assert fact.error(found) <= fact.accuracy


# ---- what cannot be ---------------------------------------------------------------------------------------------------

BAD = [
    ("pendulum-xy", {"m": -1.0}, "m = -1 must be above zero"),
    ("pendulum-xy", {"phi": 4.0}, "phi = 4 must be between 0 and π"),
    ("bouncing-dimer", {"mu": -1.0}, "mu = -1 must not be negative"),
    ("bouncing-dimer", {"h": 0.003}, "a ball is in the plate; raise h"),
    ("guided-slider-crank", {"omega": 2.0}, "the crank does not get over; raise omega"),
    ("pendulum-and-wall", {"m": -1.0}, "m = -1 must be above zero"),
    ("double-pendulum-stop", {"m": -1.0}, "m = -1 must be above zero"),
    ("rod-on-pin", {"m": -1.0}, "m = -1 must be above zero"),
    ("pendulum-cradle", {"m": -1.0}, "m = -1 must be above zero"),
    ("kane-pendulum", {"m": -1.0}, "m = -1 must be above zero"),
    ("rocking-block-bodies", {"m": -1.0}, "m = -1 must be above zero"),
    ("squat-block", {"m": -1.0}, "m = -1 must be above zero"),
    ("block-on-corners", {"m": -1.0}, "m = -1 must be above zero"),
    ("ball-with-spin", {"m": -1.0}, "m = -1 must be above zero"),
    ("rolling-disc", {"m": -1.0}, "m = -1 must be above zero"),
    ("disc-in-bowl", {"m": -1.0}, "m = -1 must be above zero"),
    ("falling-rod", {"m": -1.0}, "m = -1 must be above zero"),
    ("tipping-plank", {"m": -1.0}, "m = -1 must be above zero"),
    ("tumbling-rod", {"m": -1.0}, "m = -1 must be above zero"),
    ("painleve-rod", {"m": -1.0}, "m = -1 must be above zero"),
    ("painleve-jam", {"m": -1.0}, "m = -1 must be above zero"),
    ("wedge-billiard", {"m": -1.0}, "m = -1 must be above zero"),
    ("rotating-box", {"m": -1.0}, "m = -1 must be above zero"),
    ("slider-crank", {"c": -1.0}, "c = -1 must be above zero"),
    ("coupled-linkages", {"N": 0.5}, "must be a whole number"),
    ("rod-chain", {"N": 0.5}, "must be a whole number"),
    ("woodpecker-bodies", {"m_M": -1.0}, "m_M = -1 must be above zero"),
    ("bouncing-ball", {"H": -1.0}, "H = -1"),
    ("bouncing-ball", {"e": 1.5}, "e = 1.5 must lie between 0 and 1"),
    ("ball-in-air", {"c": 0.0}, "c = 0 must be above zero"),
    ("kelvin-voigt-impact", {"v0": 0.0}, "v0 = 0 must be above zero"),
    ("kelvin-voigt-impact", {"m": -1.0}, "m = -1.0 must be a positive"),
    ("kelvin-voigt-tension", {"c": 0.0}, "c = 0.0 must be a positive"),
    ("maxwell-impact", {"k": -3.0}, "k = -3.0 must be a positive"),
    ("hereditary-impact", {"alpha": 1.0}, "alpha = 1 must lie between 0.05 and 0.95"),
    ("hereditary-impact", {"t_min": -1.0}, "t_min = -1.0 must be a positive"),
    ("impact-oscillator", {"n": 1.5}, "n = 1.5 must be a whole number"),
    ("impact-oscillator", {"s": 5.0}, "no orbit strikes the stop s = 5"),
    ("impact-oscillator", {"e": -0.1}, "e = -0.1 must lie between 0 and 1"),
    ("shaw-holmes", {"x0": 0.5}, "x0 = 0.5 must not lie beyond the stop s = 0"),
    ("shaw-holmes", {"zeta": 0.0}, "zeta = 0 must be above zero"),
    ("thrown-ball", {"h": -0.5}, "h = -0.5 is below the table"),
    ("oscillator-stop", {"e": 2.0}, "e = 2.0 must lie between 0 and 1"),
    ("bilinear-oscillator", {"k_1": 0.0}, "k_1 = 0.0 must be a positive"),
    ("three-balls", {"delta": -1e-3}, "delta = -0.001 must not be negative"),
    ("three-balls", {"d": 0.0}, "d = 0 must be above zero"),
    ("newtons-cradle", {"N": 1.5}, "N = 1.5 must be a whole number, at least 2"),
    ("newtons-cradle", {"N": 1.0}, "N = 1 must be a whole number, at least 2"),
    ("balls-on-springs", {"v0": 0.0}, "v0 = 0 must be above zero"),
    ("hertz-chain", {"N": 8}, "N = 8 is too many"),
    ("hertz-chain", {"N": 2.5}, "N = 2.5 must be a whole number, at least 2"),
    ("two-ball-drop", {"e": 0.0}, "lands again before the upper meets it"),
    ("two-ball-drop", {"m1": 0.0}, "m_1 = 0.0 must be a positive"),
    ("two-balls-spring", {"R": 2.0}, "x1 = 1 must be above R = 2"),
    ("coulomb-oscillator", {"F": -1.0}, "F = -1 must be above zero"),
    ("coulomb-oscillator", {"x0": 0.0}, "x0 = 0 must be above zero"),
    ("forced-coulomb-oscillator", {"omega": 10.0}, "where there is no such motion"),
    ("forced-coulomb-oscillator", {"F": 9.0}, "stops within a swing"),
    ("forced-coulomb-oscillator", {"P": 0.0}, "P = 0 must be above zero"),
    ("block-on-incline", {"mu": -0.1}, "mu = -0.1 must not be negative"),
    ("block-on-incline", {"alpha": 2.0}, "alpha = 2 must be below π/2"),
    ("block-on-belt", {"v_b": 0.3}, "v_b = 0.3 is too fast for the block ever to stick; it must be below 0.2943 m/s"),
    ("buck-converter", {"E": 11.0}, "with E = 11 no motion of period T switches once in it"),
    ("buck-converter", {"periods": 2.5}, "periods = 2.5 must be a whole number"),
    ("stick-slip-belt", {"mu_s": 0.3}, "mu_s = 0.3 must be above mu = 0.3, or the vibration does not stick"),
    ("thrown-block", {"e": 1.0}, "e = 1 never lets the block rest"),
    ("thrown-block", {"mu": 0.0}, "mu = 0 must be above zero"),
    ("rolling-sphere", {"omega0": -20.0}, "the ball rolls from the start"),
    ("draw-shot", {"omega0": 10.0}, "omega0 = 10 is too weak to bring the ball back; it must be above 166.667"),
    ("spinning-ball", {"e_T": 1.5}, "e_T = 1.5 must lie between 0 and 1"),
    ("spinning-ball", {"mu": -1.0}, "mu = -1 must not be negative"),
    ("super-ball", {"mu": 0.1}, "mu = 0.1 is too little to turn the slip round; it must be at least 0.18"),
    ("super-ball-table", {"mu": 0.1}, "too little to turn the slip round"),
    ("woodpecker", {"mu": 0.0}, "mu = 0 must be above zero"),
    ("woodpecker", {"e": 1.5}, "e = 1.5 must lie between 0 and 1"),
    ("plastic-ball", {"A": 0.002}, "does not throw the ball: A omega²/g = 0.804861 must be above 1"),
    ("impact-pair", {"n": 2.0}, "n = 2 must be odd"),
    ("impact-pair", {"A": 0.001}, "A = 0.001 is too small for this motion"),
    ("impact-pair", {"e": 0.0, "A": 0.07}, "a wall strikes the mass on its way"),
    ("impact-damper", {"m": 0.0}, "m = 0 must be above zero"),
    ("impact-damper", {"F": 0.1}, "no motion strikes each end once in a period"),
    ("impact-damper", {"d": 1e-4}, "the slot strikes the mass on its way"),
    ("impact-damper", {"F": 0.5, "omega": 9.0, "d": 0.02}, "the slot strikes the mass on its way"),
    ("nonsmooth-mode", {"omega": 0.5}, "no motion of omega = 0.5 strikes the stop just once"),
    ("nonsmooth-mode", {"d": 0.0}, "d = 0 must be above zero"),
    ("cam-follower", {"A": 0.0}, "A = 0 must be above zero"),
    ("cam-follower", {"omega": 600.0}, "the follower flies past the end of a turn; it lifts off above 264.575"),
    ("train-brakes", {"N": 21}, "N = 21 is too many; take at most 20 cars"),
    ("train-brakes", {"S": 0.0}, "S = 0 must be above zero"),
    ("train-brakes", {"rho": -0.1}, "rho = -0.1 must not be negative"),
    ("diode-bridge-supply", {"C": 0.0}, "C = 0 must be above zero"),
    ("inertia-drive", {"m": 0.0}, "m = 0 must be above zero"),
    ("inertia-drive", {"share": 0.5}, "share = 0.5 must be below 1/2"),
    ("inertia-drive", {"T": 1.0}, "the block goes back with the table"),
    ("pi-billiard", {"M": 1e9}, "at most 10,000 are followed; lower M"),
    ("pi-billiard", {"d": 0.0}, "d = 0 must be above zero"),
    ("inelastic-collapse", {"e": 0.0}, "e = 0 leaves the first two balls together"),
    ("inelastic-collapse", {"delta": -1.0}, "delta = -1 must be above zero"),
    ("jenkins-cycle", {"k_h": -1.0}, "k_h = -1 must not be negative"),
    ("jenkins-cycle", {"f_y": 0.0}, "f_y = 0.0 must be a positive"),
    ("vibrating-table", {"A": 0.001}, "the table is too slow"),
    ("vibrating-table", {"e": 0.0, "A": 0.0078075}, "strikes the ball in its flight"),
    ("rocking-block", {"theta": 0.3}, "must be below alpha"),
    ("diode-bridge", {"R": 0.0}, "R = 0 must be above zero"),
    ("filippov", {"depth": 9.0}, "it does not cross, slide and leave"),
    ("sliding-mode", {"d": -2.0}, "must be below a = 1"),
    ("sliding-mode", {"c": 20.0}, "too weak to slide"),
    ("relay-oscillator", {"a": 0.0}, "a = 0 must be above zero"),
    ("twisting", {"r1": 1.0}, "r1 = 1 must be above r2 = 1"),
    ("reflected-motion", {"x0": 2.0}, "or it never comes down to zero"),
    ("hertz-impact", {"n": 0.5}, "n = 0.5 must be"),
    ("hunt-crossley-impact", {"b": -1.0}, "b = -1.0 must be a positive"),
    ("hunt-crossley-impact", {"b": 1e-9}, "take hertz-impact"),
    ("bar-impact", {"elements": 10.5}, "elements = 10.5 must be a whole number, at least 4"),
    ("bar-impact", {"mu": 0.3}, "μ from 0 to 1/4"),
    ("bouncing-bar", {"gap": -1.0}, "gap = -1 must be above zero"),
    ("plastic-bar-impact", {"v0": 1.0}, "or the bar stays elastic"),
    ("plastic-bar-impact", {"rho": -1.0}, "rho = -1 must be above zero"),
]


@pytest.mark.parametrize(("name", "parameters", "message"), BAD)
def test_parameters_that_cannot_be_are_refused_in_one_sentence(name, parameters, message):
    with pytest.raises(InputError, match=re.escape(message)) as refusal:
        load_problem(name, **parameters)
    assert "\n" not in str(refusal.value)


def test_every_problem_refuses_something():
    assert {name for name, _, _ in BAD} >= set(PROBLEMS) - {"system-1", "system-2", "system-3"}
    for name in PROBLEMS:
        for parameter in load_problem(name).parameters:
            with pytest.raises(InputError, match="finite number"):
                load_problem(name, **{parameter: math.nan})


# ---- reading ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("method", "atol"), [("exact", 1e-13), ("moreau-jean", 2e-6)])
def test_reading_a_sine(method, atol):
    scheme = li.Scheme(li.Mass("x", 1.0), li.Spring("x", "ground", 1.0))
    found = li.simulate(li.Problem("sine", scheme, v0={"x": 1.0}), method, dt=20.0 / 9973, t_end=20.0)
    assert_allclose(reading.peak(found, "x"), 1.0, rtol=0, atol=atol)
    assert_allclose(reading.peak(found, "x", -1.0), -1.0, rtol=0, atol=atol)
    assert_allclose(reading.peak(found, lambda state: 2.0 * state.q[:, 0]), 2.0, rtol=0, atol=2 * atol)
    for number in (1, 2, 3):
        falling = reading.crossing(found, "x", 0.5, direction=-1.0, number=number)
        assert_allclose(falling, 5 * math.pi / 6 + 2 * math.pi * (number - 1), rtol=0, atol=10 * atol)
    assert_allclose(reading.crossing(found, "v_x"), 3 * math.pi / 2 - 0.0, rtol=0, atol=10 * atol)
    assert_allclose(reading.at(found, "v_x", 1.0), math.cos(1.0), rtol=0, atol=atol)
    with pytest.raises(InputError, match=r"crosses 0\.5 3 times, but crossing 4 is required: run longer"):
        reading.crossing(found, "x", 0.5, direction=-1.0, number=4)
    with pytest.raises(InputError, match="0 events 'open' of R, but number 2"):
        reading.event(found, "open", 2, "R")


def test_a_crossing_on_a_grid_point_is_found():
    # x returns to zero at half of t_end, up to rounding of either sign; with the first it has one sign among all the
    # samples of the grid and the other where it is sampled alone.
    for m, k, c in ((52.8440677674346, 1221.0, 1.6), *((50.0, 1000.0, c) for c in np.linspace(1.0, 3.0, 9))):
        problem = load_problem("kelvin-voigt-tension", m=m, k=k, c=c, v0=0.21875)
        assert problem.facts[0].error(run(problem)) < 1e-12


def test_the_end_of_a_run_is_the_end_that_was_asked_for():
    # Where the number of steps times t_end, over the number of steps, is another number.
    for t_end, steps in ((0.0012672046043805758, 200), (0.1, 3), (0.7, 11)):
        found = li.simulate(load_problem("diode-bridge"), dt=t_end / steps, t_end=t_end)
        assert found.t[-1] == t_end
    assert 0.1 * 3 / 3 != 0.1


def test_the_end_of_a_run_is_read_where_rounding_puts_it():
    problem = load_problem("diode-bridge", L=0.015625, C=8.448030695870505e-06, R=30.0, v0=1.0)
    found = run(problem, stretch=1.0 - 1e-15)
    assert found.t[-1] < problem.t_end < found.t[-1] * (1 + 1e-12)
    assert reading.at(found, "v_L", problem.t_end) == found["v_L"][-1]
    with pytest.raises(InputError, match="sample times must lie within the run"):
        reading.at(found, "v_L", problem.t_end * 1.001)


def test_a_peak_may_be_a_left_limit():
    found = run(load_problem("bouncing-ball"), steps=37)
    assert_allclose(reading.peak(found, "v_x"), math.sqrt(2 * 9.81), rtol=1e-12)


def test_a_peak_of_steps_lies_on_the_parabola():
    t = np.array([0.0, 0.3, 0.5, 1.1])
    assert_allclose(reading._top(t, 2.0 - 3.0 * (t - 0.4) ** 2), 2.0, rtol=1e-14)
    assert reading._top(t, t) == 1.1
    assert reading._top(t, 1.0 - t) == 1.0


def test_a_force_is_read_on_the_lines_between_the_steps():
    found = li.simulate(load_problem("kelvin-voigt-impact"), "moreau-jean", dt=1e-3, t_end=0.4)
    outside = li.simulate(load_problem("kelvin-voigt-impact"), "exact", dt=1e-3, t_end=0.4)
    t = np.array([0.0, 0.1234, 0.4])
    assert_allclose(reading.read(found, "R", t), outside.sample(t).reaction[:, 0], rtol=1e-4)


def test_the_error_of_a_fact_is_relative_to_its_scale():
    fact = Fact("a", "a", 0.0, "", lambda run: 0.5, scale=5.0)
    assert fact.error(None) == 0.1
    assert Fact("a", "a", 2.0, "", lambda run: 3.0, scale=1.0).error(None) == 0.5


@pytest.mark.parametrize("ζ", [0.0, 0.3, 0.999999, 1.0, 1.000001, 5.0, 300.0])
def test_free_vibration(ζ):
    ω, t = 3.0, np.linspace(0.0, 4.0, 9)
    S, C, dS = free_vibration(t, ω, ζ)
    # x'' + 2 ζ ω x' + ω² x = 0 by the power series of the matrix exponential is ill-conditioned; by DOP853 it is not.
    for x, start in ((S, (0.0, 1.0)), (C, (1.0, 0.0))):
        outside = solve_ivp(
            lambda _, y: [y[1], -2 * ζ * ω * y[1] - ω**2 * y[0]], (0.0, 4.0), start, "Radau" if ζ > 10 else "DOP853",
            t, rtol=1e-12, atol=1e-14,
        )  # fmt: skip
        assert_allclose(x, outside.y[0], rtol=0, atol=1e-9)
    assert_allclose(dS, C - 2 * ζ * ω * S, rtol=0, atol=1e-12 * max(1.0, ζ))
    if 0.0 < ζ < 1.0:
        assert_allclose(angle(ζ), math.acos(ζ) / math.sqrt(1 - ζ**2), rtol=1e-9)


def test_angle_is_continuous_at_critical_damping():
    assert_allclose([angle(1.0 - 1e-9), angle(1.0), angle(1.0 + 1e-9)], 1.0, rtol=0, atol=1e-8)
    assert_allclose(angle(2.0), math.acosh(2.0) / math.sqrt(3.0), rtol=1e-15)


# ---- what the docstrings say besides ----------------------------------------------------------------------------------


def test_restitution_of_the_spring_pot_as_printed():
    for alpha, e in ((0.1, 0.8208), (0.5, 0.3002), (0.9, 0.0279)):
        assert_allclose(facts("hereditary-impact", alpha=alpha)["e"], e, rtol=0, atol=5e-5)
        assert (
            facts("hereditary-impact", alpha=alpha, m=7.0, v0=3.0)["e"] == facts("hereditary-impact", alpha=alpha)["e"]
        )


def test_usual_damping_of_hunt_and_crossley_as_printed():
    assert_allclose(facts("hunt-crossley-impact", b=0.75)["e"], 0.66, rtol=0, atol=5e-3)
    assert_allclose(facts("hunt-crossley-impact", b=0.003)["e"], 1 - 2 * 0.003 / 3, rtol=0, atol=1e-5)


def test_published_numbers():
    """What tables and papers print, as BENCHMARKS.md has it."""
    assert_allclose(facts("impact-oscillator")["v⁻"], 0.5006724925491698, rtol=1e-14)
    hertz = facts("hertz-impact", m=2.0, K=3.0, v0=4.0)
    assert_allclose(hertz["δ_max"], (5 * 2.0 * 16.0 / 12.0) ** 0.4, rtol=1e-14)
    assert_allclose(hertz["T"], 2.94327518 * hertz["δ_max"] / 4.0, rtol=1e-8)
    assert_allclose(facts("two-balls-spring")["t_1"], 0.403855021876921781, rtol=1e-15)
    assert_allclose(facts("two-balls-spring")["t_2"], 0.423316968814706678, rtol=1e-13)
    bridge = facts("diode-bridge")
    assert_allclose([bridge["v_L"], bridge["i_L"]], [0.790322819644, -0.0026478501601], rtol=1e-11)
    drop = facts("two-ball-drop", delta=1e-12)
    v = math.sqrt(2 * 9.81)
    assert_allclose([drop["v_1"], drop["v_2"]], [0.0, -2.0 * v], rtol=0, atol=1e-10)
    assert_allclose([facts("three-balls")[f"v_{i}/v0"] for i in (1, 2, 3)], [-1 / 3, 2 / 3, 2 / 3], rtol=1e-15)
    assert_allclose([facts("three-balls", delta=1e-9)[f"v_{i}/v0"] for i in (1, 2, 3)], [0, 0, 1], atol=0)
    assert_allclose(facts("super-ball-table")["v_3"], -333 / 343, rtol=1e-15)
    assert_allclose(facts("super-ball")["v_1"], -8 / 7, rtol=1e-15)
    assert_allclose(facts("jenkins-cycle")["W"], 4 * 5.0 * (0.12 - 0.05), rtol=1e-14)
    assert_allclose(facts("bouncing-bar")["t_2"], 11 / 3, rtol=1e-15)


def test_amplitude_of_the_impact_oscillator_without_its_stop():
    assert_allclose(1.0 / math.hypot(1 - 2.6**2, 2 * 0.05 * 2.6), 0.17, rtol=0, atol=5e-3)


def test_the_table_throws_stably_up_to_the_bound_as_printed():
    """Two impacts after a small delay: below the bound it fades, above it grows; by the map from impact to impact."""
    e, g, ω = 0.5, 9.81, 20.0 * math.pi
    low, kink = math.pi * (1 - e) / (1 + e), 2 * (1 + e**2) / (1 + e) ** 2

    def spread(swing):
        A = swing * g / ω**2
        T = 2 * math.pi / ω
        phase = math.pi - math.asin(g * T / 2 * (1 - e) / (1 + e) / (A * ω))

        def height(t):
            return A * math.cos(ω * t + phase)

        def rate(t):
            return -A * ω * math.sin(ω * t + phase)

        def apart(s, t, x, v):
            return height(t + s) - x - v * s - 0.5 * g * s**2

        t, delays = 1e-7, []
        x, v = height(t), -g * T / 2
        for n in range(1, 60):
            flight = brentq(apart, 0.7 * T, 1.3 * T, (t, x, v), xtol=1e-16)
            t, x, before = t + flight, height(t + flight), v + g * flight
            v = rate(t) - e * (before - rate(t))
            delays.append(abs(t - n * T))
        return delays[-1] / 1e-7

    bound = math.hypot(low, kink)
    assert spread(0.98 * bound) < 1.0
    assert spread(1.02 * bound) > 1.0


def test_the_bridge_has_one_solution_and_conducts_both_ways():
    """By enumeration of the diodes' states: C v' = -i - v/R and L i' = v, whatever the signs."""
    problem = load_problem("diode-bridge")
    system, p = problem.scheme, problem.parameters
    for v, i in ((3.0, 0.01), (-3.0, 0.01), (2.0, -0.5), (-1.0, -0.5)):
        x, found = np.array([v, i]), []
        q = system.C @ x
        for size in range(5):
            for on in map(list, combinations(range(4), size)):
                D = system.D[np.ix_(on, on)]
                if size and abs(np.linalg.det(D)) < 1e-14:
                    continue
                λ = np.zeros(4)
                λ[on] = np.linalg.solve(D, -q[on]) if size else []
                if (λ >= -1e-12).all() and (q + system.D @ λ >= -1e-12).all():
                    found.append(λ)
        assert found
        for λ in found:
            rate = system.A @ x + system.B @ λ
            assert_allclose(rate, [(-i - v / p["R"]) / p["C"], v / p["L"]], rtol=1e-12)
            assert_allclose(λ[0] + λ[1], abs(v), rtol=1e-12)
        assert_allclose(np.ptp(found, axis=0), 0.0, atol=1e-12)


def test_three_nonsmooth_modes_have_one_energy_and_two_of_them_meet_in_a_fold():
    def energy(omega):
        return facts("nonsmooth-mode", omega=omega)["E"]

    fold = minimize_scalar(energy, bounds=(0.86, 0.89), options={"xatol": 1e-9})
    assert_allclose([fold.x, fold.fun], [0.87146, 0.82737], rtol=0, atol=5e-6)
    found = [brentq(lambda omega: energy(omega) - 0.9, *ends) for ends in ((0.64, 0.76), (0.83, fold.x), (fold.x, 1.0))]
    assert_allclose(found, [0.755, 0.850, 0.901], rtol=0, atol=5e-4)


@pytest.mark.parametrize("share", [0.999, 1.001])
def test_the_follower_leaves_its_cam_above_the_jump_speed(share):
    problem = load_problem("cam-follower", omega=share * math.sqrt((2000.0 + 60.0 / 0.005) / 0.2))
    assert {event.kind for event in run(problem).events} == (set() if share < 1.0 else {"impact", "close", "open"})


def test_the_follower_lifts_off_where_its_spring_is_too_weak():
    problem = load_problem("cam-follower")
    outside = OUTSIDE["cam-follower"](**problem.parameters)
    assert_allclose(reading.instant(finest("cam-follower"), "open"), outside["t_1 + T"], rtol=1e-12)


def test_the_diodes_of_a_supply_conduct_when_it_lifts_the_capacitor():
    outside = OUTSIDE["diode-bridge-supply"](**load_problem("diode-bridge-supply").parameters)
    found = finest("diode-bridge-supply")
    assert_allclose(reading.instant(found, "close", contact="i_DF1"), outside["t_c"], rtol=1e-12)
    for λ in found.reaction.T:
        assert λ.min() > -1e-12
    # The other two conduct in the other half of a period as these.
    half, t = np.pi / load_problem("diode-bridge-supply").parameters["omega"], np.linspace(0.0, 5e-4, 201)
    assert_allclose(reading.read(found, "v", t + half), reading.read(found, "v", t), rtol=0.0, atol=1e-9)
    assert_allclose(reading.read(found, "i_DR1", t + half), reading.read(found, "i_DF1", t), rtol=0.0, atol=1e-9)


def test_the_bridge_is_passive():
    D = np.asarray(load_problem("diode-bridge").scheme.D)
    assert np.linalg.eigvalsh(D + D.T).min() > -1e-15


# ---- the outside ------------------------------------------------------------------------------------------------------


def falling(rhs, start, t_end, *functions, scale=1.0):
    """Follow y' = rhs(y) by DOP853 until the first function of y falls through zero, and no longer than t_end.

    Returns for each function the time and the state at which it first falls through zero, None if it does not.
    """

    def watched(function):
        def event(t, y):
            return function(y)

        event.direction, event.terminal = -1, function is functions[0]
        return event

    found = solve_ivp(
        lambda t, y: rhs(y), (0.0, t_end), start, "DOP853", rtol=1e-13, atol=1e-15 * np.asarray(scale),
        events=[watched(function) for function in functions], max_step=t_end / 50,
    )  # fmt: skip
    assert found.success
    return [(t[0], y[0]) if len(t) else None for t, y in zip(found.t_events, found.y_events, strict=True)]


def moreau(masses, H, v, e):
    """Velocities after an impact, by enumeration of 0 <= P ⟂ U⁺ + e min(U⁻, 0) >= 0 over the sets of closed contacts."""
    H = np.atleast_2d(H)
    W, U = H @ (H / masses).T, H @ v
    q = U + e * np.minimum(U, 0.0)
    for size in range(len(U) + 1):
        for closed in map(list, combinations(range(len(U)), size)):
            P = np.zeros(len(U))
            P[closed] = np.linalg.solve(W[np.ix_(closed, closed)], -q[closed])
            if (P >= 0.0).all() and (q + W @ P >= -1e-12 * np.abs(U).max()).all():
                return v + (H / masses).T @ P
    raise AssertionError("no solution")


def row_of_balls(N, v0, e, d, delta, until):
    """Impacts of equal balls in a row, one after the other: (time, contacts that touch, velocities after)."""
    gap, v = np.array([d] + [delta] * (N - 2)), np.array([v0] + [0.0] * (N - 1))
    H, t, impacts = np.diff(np.eye(N), axis=0), 0.0, []
    for _ in range(200):
        closing = H @ v < -1e-12 * v0
        if not closing.any():
            break
        wait = np.min(gap[closing] / -(H @ v)[closing])
        if t + wait > until:
            break
        t, gap = t + wait, gap + wait * (H @ v)
        touching = np.flatnonzero(gap <= 1e-12 * (d + delta))
        v = moreau(np.ones(N), H[touching], v, e)
        impacts.append((t, set(touching), v))
    return impacts


def bouncing_ball(m, g, H, e):
    t, v = brentq(lambda t: 0.5 * g * t**2 - H, 0.0, 10.0 + H, xtol=1e-15), math.sqrt(2 * g * H)
    found = {"t_1": t, "v_1": v}
    for n in range(2, 2000 if e < 1.0 else 4):
        t, v = t + 2 * e * v / g, e * v
        found |= {f"t_{n}": t, f"v_{n}": v} if n == 3 else {}
    return found | {"t_∞": t}


def kelvin_voigt_impact(m, k, c, v0):
    def R(y):
        return c * y[1] + k * y[0]

    ω = math.sqrt(k / m)
    end, deepest, top = falling(
        lambda y: [y[1], -R(y) / m], [0.0, v0], 100.0 / ω * (1.0 + c * ω / k),
        R, lambda y: y[1], lambda y: k * y[1] - c * R(y) / m, scale=[1e-6 * v0 / ω, 1e-6 * v0],
    )  # fmt: skip
    return {
        "R(0+)": c * v0, "t_c": end[0], "e": -end[1][1] / v0, "x_max": deepest[1][0],
        "R_max": max(c * v0, R(top[1]) if top else 0.0),
    }  # fmt: skip


def kelvin_voigt_tension(m, k, c, v0):
    ω = math.sqrt(k / m)
    end, deepest = falling(
        lambda y: [y[1], -(c * y[1] + k * y[0]) / m], [0.0, v0], 20.0 / ω if c >= 2 * m * ω else 1e3 / ω,
        lambda y: y[0], lambda y: y[1], scale=[v0 / ω, v0],
    )  # fmt: skip
    found = {"x_max": deepest[1][0], "e": 0.0}
    return found | ({"t_c": end[0], "e": -end[1][1] / v0, "R(t_c)": c * end[1][1]} if end else {})


def maxwell_impact(m, k, c, v0):
    def rates(y):
        v, R, _ = y
        return [-R / m, k * (v - R / c), R / c]

    ω, ζ = math.sqrt(k / m), math.sqrt(k * m) / (2 * c)
    t_end = 10.0 / ω * (ζ + math.sqrt(ζ**2 - 1)) if ζ >= 1.0 else 1e3 / ω
    scale = [v0, k * v0 / ω, v0 / ω]
    end, top = falling(rates, [v0, 0.0, 0.0], t_end, lambda y: y[1], lambda y: y[0] - y[1] / c, scale=scale)
    found = {"R_max": top[1][1], "openings": float(end is not None)}
    if end:
        return found | {"t_c": end[0], "e": -end[1][0] / v0, "s": end[1][2]}
    last = solve_ivp(lambda t, y: rates(y), (0, t_end), [v0, 0.0, 0.0], "DOP853", rtol=1e-13, atol=1e-15 * v0)
    return found | {"v": last.y[0, -1]}


def hereditary_impact(m, c_alpha, alpha, v0, t_min, rtol):
    """E_β(-τ^β) as residues and an integral (Mainardi), and the force as its derivative: no power series."""
    β = 2 - alpha

    def kernel(r, power):
        return r**power * math.sin(β * math.pi) / math.pi / (r ** (2 * β) + 2 * r**β * math.cos(β * math.pi) + 1)

    def memory(τ, power):
        parts = [quad(lambda r: kernel(r, power) * math.exp(-r * τ), a, b, epsabs=1e-15, epsrel=1e-13)[0]
                 for a, b in ((0, 1), (1, 40))]  # fmt: skip
        return sum(parts)

    def velocity(τ):
        return 2 / β * math.exp(τ * math.cos(math.pi / β)) * math.cos(τ * math.sin(math.pi / β)) + memory(τ, β - 1)

    def force(τ):
        ring = math.exp(τ * math.cos(math.pi / β)) * math.cos(τ * math.sin(math.pi / β) + math.pi / β)
        return -2 / β * ring + memory(τ, β)

    T = (m / c_alpha) ** (1 / β)
    τ_c = brentq(force, 2.0, 6.0, xtol=1e-14)
    top = minimize_scalar(lambda τ: -force(τ), bounds=(0.5, τ_c), method="bounded", options={"xatol": 1e-9})
    return {"t_c": τ_c * T, "e": -velocity(τ_c), "R_max": -top.fun * m * v0 / T}


def power_law_impact(m, K, n, v0, b=0.0):
    def F(y):
        return K * max(y[0], 0.0) ** n * (1 + b * y[1])

    def slope(y):
        # F'/(K δⁿ⁻¹)
        return n * y[1] * (1 + b * y[1]) - max(y[0], 0.0) * b * F(y) / m

    size = (m * v0**2 / K) ** (1 / (n + 1))
    end, deepest, top = falling(
        lambda y: [y[1], -F(y) / m],
        [0.0, v0],
        40.0 * size / v0,
        lambda y: y[0],
        lambda y: y[1],
        slope,
        scale=[size, v0],
    )
    return {"δ_max": deepest[1][0], "T": end[0], "F_max": F(top[1]), "e": -end[1][1] / v0}


def oscillator_stop(m, k, e, v0):
    ω, found, t, v = math.sqrt(k / m), {}, 0.0, v0
    for n in (1, 2, 3):
        rates = lambda y: [y[1], -k / m * y[0]]  # noqa: E731
        home, far = falling(rates, [0.0, -v], 10.0 / ω, lambda y: -y[0], lambda y: -y[1], scale=[v0 / ω, v0])
        t, v = t + home[0], e * home[1][1]
        found[f"t_{n}"], found[f"v_{n}"] = t, v
        found.setdefault("x_min", -far[1][0])
        if v == 0.0:
            break
    return found


def bilinear_oscillator(m, k, k_1, v0):
    def rates(y):
        return [y[1], -(k + (k_1 if y[0] > 0.0 else 0.0)) / m * y[0]]

    ω = math.sqrt(k / m)
    scale = [v0 / math.sqrt((k + k_1) / m), v0]
    pressed, deep = falling(rates, [0.0, v0], 10 / ω, lambda y: y[0], lambda y: y[1], scale=scale)
    free, far = falling(rates, [-0.0, pressed[1][1]], 10 / ω, lambda y: -y[0], lambda y: -y[1], scale=scale)
    return {
        "T": pressed[0] + free[0], "π/ω_2": pressed[0], "x_max": deep[1][0], "x_min": far[1][0], "R_max": k_1 * deep[1][0]
    }  # fmt: skip


def impact_oscillator(zeta, omega, f, s, e, n):
    """From the start of the closed form: it comes back to the stop after n periods, and not before, as it left."""
    problem = load_problem("impact-oscillator", zeta=zeta, omega=omega, f=f, s=s, e=e, n=n)
    phase = next(each for each in problem.scheme.elements if isinstance(each, li.Load)).f.phase
    v = problem.v0["x"]

    def rates(y):
        return [y[1], -2 * zeta * y[1] - y[0] + f * math.cos(omega * y[2] + phase), 1.0]

    (t, y), *_ = falling(
        rates, [problem.q0["x"], v, 0.0], 3 * n * 2 * math.pi / omega, lambda y: s - y[0], scale=[f, f, 1]
    )
    assert_allclose(-e * y[1], v, rtol=1e-9)
    return {"v⁻": y[1], "T": t}


def shaw_holmes(zeta, omega, f, s, e, x0, v0):
    def rates(y):
        return [y[1], -2 * zeta * y[1] - y[0] + f * math.cos(omega * y[2]), 1.0]

    ((t, y),) = falling(rates, [x0, v0, 0.0], 8 * math.pi / omega, lambda y: s - y[0], scale=[f, f, 1])
    return {"t_1": t, "v_1": y[1]}


def thrown_ball(m, g, e, A, omega, h, v0):
    ((t, y),) = falling(
        lambda y: [y[1], g, 1.0],
        [-h, v0, 0.0],
        10 * math.sqrt(2 * (h + A) / g),
        lambda y: A * math.cos(omega * y[2]) - y[0],
        scale=[A, A * omega, 1],
    )
    return {"t_1": t, "U_1": y[1] + A * omega * math.sin(omega * t)}


def three_balls(m, v0, e, d, delta):
    impacts = row_of_balls(3, v0, e, d, delta, until=math.inf)
    t, _, v = impacts[0] if delta == 0.0 else next(each for each in impacts if 1 in each[1])
    return {"t_1": impacts[0][0], "t_2": t} | {f"v_{i + 1}/v0": v[i] / v0 for i in range(3)}


def newtons_cradle(N, m, v0, e, d, delta):
    impacts = row_of_balls(N, v0, e, d, delta, until=math.inf)
    t_N, _, v = next(each for each in impacts if N - 2 in each[1])
    return {"Σv/v0": sum(impacts[-1][2]) / v0, "t_N": t_N, "v_N/v0": v[-1] / v0, "v_1/v0": impacts[0][2][0] / v0}


def two_ball_drop(m1, m2, g, H, e, delta):
    masses, ground, pair = np.array([m1, m2]), np.array([-1.0, 0.0]), np.array([1.0, -1.0])
    t = brentq(lambda t: 0.5 * g * t**2 - H, 0.0, 10.0 + H, xtol=1e-15)
    v = np.full(2, g * t)
    found = {"t_1": t, "v": v[0]}
    if delta == 0.0:
        after = moreau(masses, np.array([ground, pair]), v, e)
        return found | {"t_2": t, "v_1": after[0], "v_2": after[1]}
    v = moreau(masses, ground, v, e)
    wait = brentq(lambda s: delta + (v[0] - v[1]) * s, 0.0, delta, xtol=1e-16)
    after = moreau(masses, pair, v + g * wait, e)
    return found | {"t_2": t + wait, "v_1": after[0], "v_2": after[1]}


def two_balls_spring(m, k, e, g, x1, R):
    H, t, y = x1 - R, 0.0, np.zeros(4)

    def rates(y):
        pull = k / m * (y[1] - y[0])
        return [y[2], y[3], g + pull, g - pull]

    found = {}
    for n in range(1, 9):
        end = falling(rates, y, 1.0 - t if n > 2 else 2.0, lambda y: H - y[0], scale=1e-1)[0]
        if end is None:
            break
        t, y = t + end[0], end[1] * 1.0
        found[f"t_{n}"] = t
        if n == 2:
            found["v_2"] = y[2]
        y[0], y[2] = H, -e * y[2]
        if t >= 1.0:
            return found
    last = solve_ivp(lambda _, y: rates(y), (t, 1.0), y, "DOP853", rtol=1e-13, atol=1e-16, max_step=1e-3).y[:, -1]
    return found | dict(zip(("q_1(1)", "q_2(1)", "v_1(1)", "v_2(1)"), last, strict=True))


def coulomb_oscillator(m, k, F, x0):
    t, x, turns = 0.0, x0, []
    while k * abs(x) > F:
        side = math.copysign(1.0, x)
        # y = (|x|, its rate), which falls until it turns.
        rates = lambda y: [y[1], -(k * y[0] - F) / m]  # noqa: E731
        (wait, y), *_ = falling(rates, [abs(x), 0.0], 10 * math.sqrt(m / k), lambda y: -y[1], scale=x0)
        t, x = t + wait, side * y[0]
        turns.append(x)
    return {"t_∞": t, "x_∞": x} | ({"x_1": turns[0]} if turns else {})


def forced_coulomb_oscillator(m, k, F, P, omega):
    """From the start of the closed form: after half a period it turns at the mirror image of it."""
    problem = load_problem("forced-coulomb-oscillator", m=m, k=k, F=F, P=P, omega=omega)
    phase = next(each for each in problem.scheme.elements if isinstance(each, li.Load)).f.phase
    X, T = problem.q0["x"], 2 * math.pi / omega

    def rates(y):
        return [y[1], (F - k * y[0] + P * math.cos(omega * y[2] + phase)) / m, 1.0]

    ((half, y),) = falling(rates, [X, 0.0, 0.0], T, lambda y: -y[1], scale=[X, X * omega, T])
    assert_allclose(y[0], -X, rtol=1e-10)
    eighth = solve_ivp(lambda _, y: rates(y), (0, T / 8), [X, 0.0, 0.0], "DOP853", rtol=1e-13, atol=1e-16).y[0, -1]
    return {"X": -y[0], "x(T/8)": eighth, "T/2": half}


def jenkins_cycle(k, f_y, X, omega, k_h):
    """Elastic trial and plastic correction along the branches 0, X, -X, X, ...; both are lines between their corners."""
    x, p, works, places = 0.0, 0.0, [], []
    for target in (X, -X, X, -X, X):
        side, work = math.copysign(1.0, target - x), 0.0
        x_y = p + (side * f_y + k_h * p) / k
        corners = [x, x_y, target] if (target - x_y) * side > 0.0 and (x_y - x) * side > 0.0 else [x, target]
        for a, b in pairwise(corners):
            before, trial = k * (a - p), k * (b - p) - k_h * p
            if abs(trial) > f_y:
                p += side * (abs(trial) - f_y) / (k + k_h)
            work += 0.5 * (before + k * (b - p)) * (b - a)
        x = target
        works.append(work)
        places.append(p)
    found = {"p_max": max(places), "f_max": k * (X - places[-1]), "W": works[-1] + works[-2]}
    return found | ({"t_y": brentq(lambda t: k * X * math.sin(omega * t) - f_y, 0, 0.5 * math.pi / omega, xtol=1e-16)}
                    if k * X > f_y else {})  # fmt: skip


def block_on_incline(m, g, alpha, mu, v0):
    block = Bodies(m * np.eye(2), np.zeros((2, 2)), m * g * np.array([math.sin(alpha), math.cos(alpha)]),
                   [Rough((0, -1), (1, 0), mu=mu)])  # fmt: skip
    t_end = load_problem("block-on-incline", m=m, g=g, alpha=alpha, mu=mu, v0=v0).t_end
    log, q, v = block.run([0, 0], [v0, 0], t_end)
    F = m * g * math.sin(alpha) if log else mu * m * g * math.cos(alpha)
    return {"t_s": log[0].t if log else None, "s": q[0], "v": v[0], "F": F}


def block_on_belt(m, g, k, mu, v_b):
    block = Bodies(m * np.eye(2), np.diag([k, 0.0]), [0, m * g], [Rough((0, -1), (1, 0), mu=mu, belt=v_b)])
    (stick, slip), _, _ = block.run([0, 0], [0, 0], load_problem("block-on-belt", m=m, g=g, k=k, mu=mu, v_b=v_b).t_end)
    # Its energy about the place where the spring balances the friction.
    balance = mu * m * g / k
    return {
        "t_1": stick.t,
        "t_2": slip.t,
        "x_max": balance + math.hypot(slip.q[0] - balance, slip.v[0] * math.sqrt(m / k)),
    }


def stick_slip_belt(m, g, k, mu, mu_s, v_b):
    """By SciPy, phase by phase, from the relaxed spring: the second cycle is that of the motion in the long run."""

    def rate(t, y):
        return [y[1], (mu * m * g - k * y[0]) / m]

    def catches(t, y):
        return y[1] - v_b

    catches.terminal, catches.direction = True, 1.0
    x = 0.0
    for _ in range(2):
        loose = mu_s * m * g / k
        sticks = (loose - x) / v_b
        slip = solve_ivp(
            rate, (0.0, 1e3), [loose, v_b], method="DOP853", rtol=1e-12, atol=1e-14, events=catches, dense_output=True
        )
        x = float(slip.y_events[0][0][0])
        slips = float(slip.t_events[0][0])
    # The largest displacement is where the velocity is zero.
    turn = brentq(lambda t: slip.sol(t)[1], 0.0, 0.75 * math.pi * math.sqrt(m / k), xtol=1e-15)
    return {"t_st": sticks, "T": sticks + slips, "x_max": float(slip.sol(turn)[0])}


def buck_converter(E, L, C, R, V_ref, a, V_L, V_U, T, periods):
    """By SciPy: the state that a period with one switch brings back."""

    def rate(t, x, source):
        return [(x[1] - x[0] / R) / C, (source - x[0]) / L]

    def period(x, δ):
        options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
        off = solve_ivp(rate, (0.0, δ), x, args=(0.0,), **options).y[:, -1]
        return off, solve_ivp(rate, (δ, T), off, args=(E,), **options).y[:, -1]

    def missed(z):
        off, end = period(z[:2], z[2] * T)
        return [end[0] - z[0], end[1] - z[1], a * (off[0] - V_ref) - V_L - (V_U - V_L) * z[2]]

    v = V_ref + 0.5 * (V_L + V_U) / a
    found = root(missed, [v, v / R, 1.0 - v / E], tol=1e-13).x
    return {"δ": found[2] * T, "v_0": found[0], "i_0": found[1]}


def thrown_block(m, g, mu, e, v_x, v_y):
    """Flight by flight, until these are shorter than rounding."""
    t, x, v, w, speeds = 0.0, 0.0, v_x, v_y, []
    while w > 1e-18 * v_y:
        t, x = t + 2 * w / g, x + 2 * w / g * v
        v, w = max(v - mu * (1 + e) * w, 0.0), e * w
        speeds.append(v)
    return {"t_1": 2 * v_y / g, "v_1": speeds[0], "x_∞": x + v**2 / (2 * mu * g), "t_s": t + v / (mu * g)}


def ball(m, R, k, g, *contacts):
    return Bodies(np.diag([m, m, k * m * R**2]), np.zeros((3, 3)), [0, m * g, 0], contacts)


def rolling_sphere(m, R, k, g, mu, v0, omega0):
    log, _, v = ball(m, R, k, g, Rough((0, -1, 0), (1, 0, R), mu=mu)).run(
        [0, 0, 0], [v0, 0, omega0], 1e3 * v0 / g, stop=len
    )
    return {"t_r": log[0].t, "v_r": v[0], "x_r": log[0].q[0], "ω_r": v[2]}


def spinning_ball(m, R, k, g, mu, e, e_T, v_y, omega0):
    """Impact by impact: the slip changes by (1 + 1/k) P_F/m, and not beyond -e_T times its value."""
    v, ω, w, found = 0.0, omega0, v_y, {}
    while w > 1e-18 * v_y:
        s, P = v + R * ω, (1 + e) * m * w
        P_F = math.copysign(min(mu * P, (1 + e_T) * abs(s) * m / (1 + 1 / k)), s)
        v, ω, w = v - P_F / m, ω - R * P_F / (k * m * R**2), e * w
        found = found or {"t_1": v_y / g, "v": v, "ω": ω, "P": P, "P_F": P_F}
        if e == 1.0:
            break
    return found | {"v_r": v - k / (1 + k) * (v + R * ω)}


def super_ball(m, R, k, g, mu, H, omega0):
    body = ball(m, R, k, g, Rough((0, -1, 0), (1, 0, R), gap=H, mu=mu, e=1.0, e_T=1.0))
    log, *_ = body.run([0, 0, 0], [0, 0, omega0], 100.0, stop=lambda log: len(log) == 2)
    first, second = (each.v for each in log)
    return {"t_1": log[0].t, "v_1": first[0], "ω_1": first[2], "v_2": second[0], "ω_2": second[2]}


def super_ball_table(m, R, k, mu, h, v_x, v_y):
    sides = [Rough((0, -side, 0), (1, 0, side * R), gap=h / 2, mu=mu, e=1.0, e_T=1.0) for side in (1, -1)]
    log, *_ = ball(m, R, k, 0.0, *sides).run([0, 0, 0], [v_x, v_y, 0], 10 * h / v_y, stop=lambda log: len(log) == 3)
    return {"t_1": log[0].t, "ω_3": log[2].v[2]} | {f"v_{n}": each.v[0] for n, each in enumerate(log, 1)}


def woodpecker(m_M, m_S, J_M, J_S, c, mu, e, g):
    """One cycle of the toy, with Glocker's lengths, from the start of the problem: it comes back to its start."""
    r_O, r_M, h_M, l_M, l_G, h_S, l_S = 0.0025, 0.0031, 0.0058, 0.010, 0.015, 0.02, 0.0201
    weights = np.array([m_M + m_S, m_S * l_M, m_S * l_G])
    M = m_S * np.outer([1, l_M, l_G], [1, l_M, l_G]) + np.diag([m_M, J_M, J_S])
    toy = Bodies(M, c * np.array([[0, 0, 0], [0, 1, -1], [0, -1, 1]]), g * weights, [
        Rough((0, 0, h_S), (1, l_M, l_G - l_S), l_M + l_G - l_S - r_O, mu, e),
        Rough((0, -h_M, 0), (1, r_M, 0), r_M - r_O, mu),
        Rough((0, h_M, 0), (1, r_M, 0), r_M - r_O, mu),
    ])  # fmt: skip
    problem = load_problem("woodpecker")
    q, v = problem.initial_coordinates, problem.initial_velocities
    log, q_T, v_T = toy.run(q, v, 1.0, stop=lambda log: any(each.t > 0.03 and each.kind == "slip" for each in log))
    assert_allclose(q_T[1:], q[1:], rtol=1e-9)
    beak = next(each for each in log if each.kind == "impact" and each.contact == 0)
    return {"T": log[-1].t, "Δy": q_T[0], "ω_S": -v_T[2], "t_b": beak.t, "ω_b": -beak.before[2]}


def vibrating_table(m, g, e, A, omega, n):
    """From the start of the closed form: the ball lands after n periods, and takes off again as it did."""
    problem = load_problem("vibrating-table", m=m, g=g, e=e, A=A, omega=omega, n=n)
    phase = next(each for each in problem.scheme.elements if isinstance(each, li.PrescribedMotion)).y.phase
    x, v, T = problem.q0["x"], problem.v0["x"], 2 * math.pi * n / omega

    def gap(t):
        return A * np.cos(omega * t + phase) - x - v * t - 0.5 * g * t**2

    assert (gap(np.linspace(0.01, 0.98, 400) * T) > 0.0).all()
    t = brentq(gap, 0.98 * T, 1.02 * T, xtol=1e-16)
    w, landing = A * omega * math.sin(omega * t + phase), v + g * t
    take_off = -w - e * (landing + w)
    assert_allclose(take_off, v, rtol=1e-9)
    return {"T": t, "w": w, "U": landing + w, "P": m * (landing - take_off)}


def plastic_ball(m, g, A, omega):
    """Thrown where the table's downward acceleration passes g; caught by it, and held until the next such instant."""
    T = 2 * math.pi / omega
    throw = brentq(lambda t: -A * omega**2 * math.cos(omega * t) - g, 0.0, 0.5 * T, xtol=1e-17)
    start = [A * math.cos(omega * throw), -A * omega * math.sin(omega * throw), throw]

    def gap(y):
        return A * math.cos(omega * y[2]) - y[0]

    def rates(y):
        return [y[1], g, 1.0]

    # Past the instant of the throw, where the gap is zero for the first time.
    later = 1e-2 * T
    aloft = solve_ivp(lambda _, y: rates(y), (0.0, later), start, "DOP853", rtol=1e-13, atol=1e-16).y[:, -1]
    ((wait, y),) = falling(rates, aloft, 20 * T, gap, scale=[A, A * omega, T])
    landing = throw + later + wait
    return {
        "t_1": throw, "t_2": landing, "U": y[1] + A * omega * math.sin(omega * landing),
        "t_3": throw + T * math.ceil((landing - throw) / T),
    }  # fmt: skip


def impact_pair(m, d, e, A, omega, n):
    """From the start of the closed form: it reaches the other wall after half of the motion, and leaves it as it came."""
    problem = load_problem("impact-pair", m=m, d=d, e=e, A=A, omega=omega, n=n)
    phase = next(each for each in problem.scheme.elements if isinstance(each, li.PrescribedMotion)).y.phase
    x, v, τ = problem.q0["x"], problem.v0["x"], n * math.pi / omega

    def play(t):
        return 0.5 * d + x + v * t - A * np.cos(omega * t + phase)

    assert (play(np.linspace(0.0, 0.98, 400) * τ) > 0.0).all()
    t = brentq(play, 0.98 * τ, 1.02 * τ, xtol=1e-16)
    wall = -A * omega * math.sin(omega * t + phase)
    after = wall + e * (wall - v)
    assert_allclose(after, -v, rtol=1e-9)
    # The second impact is the mirror image of this one.
    return {"τ": t, "w": -v, "ρw": wall, "U": wall - v, "P": m * (after - v)}


def pi_billiard(m, M, v0, D, d):
    """From impact to impact, with the distances from the wall."""
    X, x, V, v, t, times = D + d, d, -v0, 0.0, 0.0, []
    while v < 0.0 or v > V * (1.0 + 1e-12):
        balls, wall = (X - x) / (v - V) if v > V else math.inf, -x / v if v < 0.0 else math.inf
        wait = min(balls, wall)
        t, X, x = t + wait, X + V * wait, x + v * wait
        if balls < wall:
            V, v = ((M - m) * V + 2 * m * v) / (M + m), ((m - M) * v + 2 * M * V) / (M + m)
        else:
            v = -v
        times.append(t)
    return {
        "N": len(times), "t_1": times[0], "t_2": times[1], "t_N": times[-1], "V/v0": -V / v0,
        "v/V_m": -v / v0 * math.sqrt(m / M),
    }  # fmt: skip


def inelastic_collapse(m, v0, e, d, delta):
    """In 60 digits, until the approach of the last pair is 1e-40 of the first."""
    with mpmath.workdps(60):
        gaps, v, t, impacts = [mpmath.mpf(d), mpmath.mpf(delta)], [mpmath.mpf(v0), mpmath.mpf(0), mpmath.mpf(0)], 0, []
        while True:
            waits = {i: gaps[i] / (v[i] - v[i + 1]) for i in (0, 1) if v[i] - v[i + 1] > 1e-40 * v0}
            if not waits:
                break
            i = min(waits, key=waits.get)
            t, gaps = t + waits[i], [gaps[j] - (v[j] - v[j + 1]) * waits[i] for j in (0, 1)]
            gaps[i], mean, half = mpmath.mpf(0), (v[i] + v[i + 1]) / 2, e * (v[i] - v[i + 1]) / 2
            impacts.append((float(t), float(2 * half / e)))
            v[i], v[i + 1] = mean - half, mean + half
    found = {f"t_{n + 1}": each[0] for n, each in enumerate(impacts[:3])}
    found |= {
        "N": len(impacts),
        "t_N": impacts[-1][0],
        "t_∞": impacts[-1][0],
        "p_2": impacts[min(2, len(impacts) - 1)][1],
    }
    v = [float(each) / v0 for each in v]
    return found | {"v/v0": v[0], "v_1/v0": v[0], "v_3/v0": v[2]}


def rocking_block(p, alpha, theta, e):
    found, t, y = {}, 0.0, [theta, 0.0]
    for n in (1, 2, 3):
        rates = lambda y: [y[1], p**2 * (y[0] - alpha)]  # noqa: E731
        (wait, end), *_ = falling(rates, y, 60.0 / p, lambda y: y[0], scale=[theta, p * theta])
        t += wait
        found |= {f"t_{n}": t, f"ω_{n}": -end[1]}
        if e == 0.0:
            break
        y = [0.0, -e * end[1]]
    return found | {"T/4": found["t_1"]}


def diode_bridge(L, C, R, v0):
    """Without diodes, in units of the oscillator: v0, v0 sqrt(C/L), sqrt(L C)."""
    ω, ζ = 1 / math.sqrt(L * C), math.sqrt(L / C) / (2 * R)
    rates = lambda y: [-y[1] - 2 * ζ * y[0], y[0]]  # noqa: E731
    slowest = ζ if ζ < 1 else ζ - math.sqrt(ζ**2 - 1)
    end = min(50.0, 2.5 / slowest)
    change = falling(rates, [1.0, 0.0], 50.0 * (1 + ζ), lambda y: y[0])[0]
    v, i = solve_ivp(lambda t, y: rates(y), (0, end), [1.0, 0.0], "DOP853", rtol=1e-13, atol=1e-16).y[:, -1]
    return {"t_1": change[0] / ω, "v_L": v * v0, "i_L": i * v0 * math.sqrt(C / L), "v_R": abs(v) * v0}


def filippov(f0, s, depth):
    """The fields on both sides with the clock as a second state; on the surface λ = f is watched alone."""
    below, above = (lambda y, sign=sign: [f0 - s * y[1] - sign, 1.0] for sign in (-1.0, 1.0))
    first = falling(below, [-depth, 0.0], 9.0 / s, lambda y: -y[0])[0]
    second = falling(above, [0.0, first[0]], 9.0 / s, lambda y: y[0] if y[1] > first[0] + 1e-3 / s else 1.0)[0]
    t_2 = first[0] + second[0]
    t_3 = brentq(lambda t: f0 - s * t + 1.0, t_2, 99.0 / s, xtol=1e-14)
    x = quad(lambda t: f0 - s * t + 1.0, t_3, t_3 + 0.5 / s)[0]
    return {"t_1": first[0], "t_2": t_2, "t_3": t_3, "x": x}


def sliding_mode(a, d, c, x0):
    """Pushed until σ falls to zero; then Utkin's equivalent control in the equations of motion."""
    t_s, y = falling(lambda y: [y[1], d - a], [x0, 0.0], 99.0, lambda y: y[1] + c * y[0])[0]
    λ = lambda y: (d + c * y[1]) / a  # noqa: E731
    end = solve_ivp(lambda t, y: [y[1], d - a * λ(y)], (0.0, 3.0 / c), y, "DOP853", rtol=1e-13, atol=1e-15).y[:, -1]
    return {"t_s": t_s, "x_s": y[0], "x": end[0], "λ": λ(end)}


def relay_oscillator(a, x0):
    t_1, y = falling(lambda y: [y[1], -a], [x0, 0.0], 99.0, lambda y: y[0])[0]
    t_2, z = falling(lambda y: [y[1], a], [0.0, y[1]], 99.0, lambda y: -y[0] if y[1] > 0.0 else 1.0, lambda y: -y[1])
    return {"t_1": t_1, "v_1": y[1], "t_2": t_1 + t_2[0], "x_1": z[1][0]}


def twisting(r1, r2, x0):
    """Swing after swing, in its own units of length and time, until nothing is left of the sum."""
    found, t, x = {}, 0.0, x0
    while x > 1e-24 * x0:
        unit = math.sqrt(x / r1)
        first, y = falling(lambda y: [y[1], -(1 - r2 / r1)], [1.0, 0.0], 99.0, lambda y: y[0])[0]
        second, z = falling(lambda y: [y[1], 1 + r2 / r1], [0.0, y[1]], 99.0, lambda y: -y[1])[0]
        found = found or {"t_1": first * unit, "x_1": z[0] * x, "x": 0.0}
        t, x = t + (first + second) * unit, -z[0] * x
    return found | {"t_∞": t}


def reflected_motion(A, omega, x0):
    """By Skorokhod's formula on the free motion."""
    z = lambda t: x0 + A / omega * math.sin(omega * t)  # noqa: E731
    lowest = minimize_scalar(
        z, bounds=(math.pi / omega, 2.0 * math.pi / omega), method="bounded", options={"xatol": 1e-12}
    )
    t_2 = brentq(lambda t: math.cos(omega * t), 4.0 / omega, 5.0 / omega, xtol=1e-15)
    end = 2.5 * math.pi / omega
    return {
        "t_1": brentq(z, math.pi / omega, t_2, xtol=1e-15), "t_2": t_2, "L": -lowest.fun, "x": z(end) - lowest.fun
    }  # fmt: skip


class Characteristics:
    """A bar that falls on a wall, along its characteristics: f = v + s/(ρc) goes down, b = v - s/(ρc) up, both gain g dt.

    With dt = Δx/c nothing is approximated. It has what the facts read of a run.
    """

    def __init__(self, E, A, rho, L, gap, v0, g, t_end, cells=60):
        c = math.sqrt(E / rho)
        dt = L / cells / c
        f, b = np.full(cells, v0), np.full(cells, v0)
        self.t = dt * np.arange(round(t_end / dt) + 1)
        self.t_reaction, self.R, self.mean = self.t[:-1] + 0.5 * dt, [], []
        for _ in self.t_reaction:
            wave = f[-1] + 0.5 * g * dt
            touches = gap <= 1e-9 * L and wave > 0.0
            self.R.append(rho * c * A * wave if touches else 0.0)
            gap -= 0.0 if touches else wave * dt
            f, b = (
                np.concatenate([[b[0]], f[:-1]]) + g * dt,
                np.concatenate([b[1:], [wave * (-1.0 if touches else 1.0) - 0.5 * g * dt]]) + g * dt,
            )
            self.mean.append(0.5 * (f + b).mean())
        self.R = np.array(self.R)
        self.switches = self.t[1:-1][np.diff(self.R > 0.0)]

    def __getitem__(self, name):
        return {"R": self.R}[name]


def falling_bar(name, **parameters):
    problem = load_problem(name, **parameters)
    p = {symbol: value for symbol, value in parameters.items() if symbol not in ("elements", "mu")}
    bar = Characteristics(**({"v0": 0.0, "g": 0.0} | p), t_end=problem.t_end)
    measured = {fact.symbol: fact.measure(bar) for fact in problem.facts if fact.symbol in ("∫R dt", "ε_R")}
    return bar, measured


def bar_impact(**parameters):
    bar, found = falling_bar("bar-impact", **parameters)
    return found | {"t_c": bar.switches[0], "t_o": bar.switches[1], "v": bar.mean[-1]}


def bouncing_bar(**parameters):
    bar, found = falling_bar("bouncing-bar", **parameters)
    return found | dict(zip(("t_1", "t_1 + τ", "t_2"), bar.switches, strict=False))


def plastic_bar_impact(m, E, A, rho, L, sigma_y, v0, elements):
    """The struck section of an infinite bar: behind its wave it moves with min(v, v_y), and yields by the rest."""
    z = rho * math.sqrt(E / rho) * A
    v_y = A * sigma_y / z
    rates = lambda y: [-min(A * sigma_y, z * y[0]) / m, A * sigma_y * max(y[0] - v_y, 0.0)]  # noqa: E731
    t_y, y = falling(rates, [v0, 0.0], 1e3 * m / z, lambda y: y[0] - v_y)[0]
    quarter = solve_ivp(lambda t, y: rates(y), (0, 0.75 * t_y), [v0, 0.0], rtol=1e-12, atol=1e-12).y[0, -1]
    later = solve_ivp(lambda t, y: rates(y), (0, 2 * m / z), [v_y, 0.0], "DOP853", rtol=1e-13, atol=1e-14).y[0, -1]
    return {"R": m * (v0 - quarter) / (0.75 * t_y), "v(t_y)": y[0], "v(t_end)": later, "D": y[1]}


def first_force(m, c_o, v_o, c=None, **_):
    return {"R(0+)": c_o * v_o if c is None else v_o / (1 / c + 1 / c_o)}


def ball_in_air(m, g, c, H, e):
    t, y, found = 0.0, [0.0, 0.0], {}
    longest = 2.0 * (math.sqrt(2.0 * H / g) + H * math.sqrt(c / (m * g)))
    for n in (1, 2, 3) if e else (1,):
        duration, y = falling(lambda y: [y[1], g - c / m * y[1] * abs(y[1])], y, longest, lambda y: H - y[0])[-1]
        t += duration
        found |= {f"t_{n}": t, f"v_{n}": y[1]}
        y = [H, -e * y[1]]
    return found


OUTSIDE = {
    "system-1": first_force,
    "system-2": lambda **_: {"R(0+)": 0.0},
    "system-3": first_force,
    "bouncing-ball": bouncing_ball,
    "ball-in-air": ball_in_air,
    "kelvin-voigt-impact": kelvin_voigt_impact,
    "kelvin-voigt-tension": kelvin_voigt_tension,
    "maxwell-impact": maxwell_impact,
    "hereditary-impact": hereditary_impact,
    "hertz-impact": power_law_impact,
    "hunt-crossley-impact": power_law_impact,
    "oscillator-stop": oscillator_stop,
    "bilinear-oscillator": bilinear_oscillator,
    "impact-oscillator": impact_oscillator,
    "shaw-holmes": shaw_holmes,
    "three-balls": three_balls,
    "two-ball-drop": two_ball_drop,
    "two-balls-spring": two_balls_spring,
    "newtons-cradle": newtons_cradle,
    "coulomb-oscillator": coulomb_oscillator,
    "forced-coulomb-oscillator": forced_coulomb_oscillator,
    "jenkins-cycle": jenkins_cycle,
    "block-on-incline": block_on_incline,
    "block-on-belt": block_on_belt,
    "stick-slip-belt": stick_slip_belt,
    "buck-converter": buck_converter,
    "thrown-block": thrown_block,
    "rolling-sphere": rolling_sphere,
    "draw-shot": rolling_sphere,
    "spinning-ball": spinning_ball,
    "super-ball": super_ball,
    "super-ball-table": super_ball_table,
    "woodpecker": woodpecker,
    "vibrating-table": vibrating_table,
    "thrown-ball": thrown_ball,
    "plastic-ball": plastic_ball,
    "impact-pair": impact_pair,
    "pi-billiard": pi_billiard,
    "inelastic-collapse": inelastic_collapse,
    "rocking-block": rocking_block,
    "diode-bridge": diode_bridge,
    "filippov": filippov,
    "sliding-mode": sliding_mode,
    "relay-oscillator": relay_oscillator,
    "twisting": twisting,
    "reflected-motion": reflected_motion,
    "bar-impact": bar_impact,
    "bouncing-bar": bouncing_bar,
    "plastic-bar-impact": plastic_bar_impact,
    # As bodies they move as their linear schemes do.
    "ball-with-spin": spinning_ball,
    "rolling-disc": rolling_sphere,
    "woodpecker-bodies": woodpecker,
    **CONTACTS,
} | REFERENCES


# --- units ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", list(PROBLEMS))
def test_units_of_series_are_those_of_the_closed_forms(name):
    """A fact that has the unit of an angle or none for an instant says what the series of its problem are measured in."""
    problem = load_problem(name)
    of_facts = {fact.unit for fact in problem.facts}
    series = {problem.unit(node) for node in problem.dynamics.nodes}
    if problem.dimensionless:
        assert series == {""}
        assert problem.unit("t") == problem.unit(problem.dynamics.forces[0].name) == ""
        assert of_facts == {""}
    else:
        assert problem.unit("t") == "s"
    assert ("rad" in series) >= bool({"rad", "rad/s"} & of_facts)


def test_the_problems_of_a_dimensionless_oscillator_and_those_with_angles():
    assert [name for name in PROBLEMS if load_problem(name).dimensionless] == ["impact-oscillator", "shaw-holmes"]
    block = load_problem("rocking-block")
    assert [block.unit(series) for series in ("θ", "v_θ", "R")] == ["rad", "rad/s", "N m"]
    assert load_problem("diode-bridge").unit("v_L") == ""


def test_a_unit_of_an_unknown_node_is_refused():
    ball = load_problem("bouncing-ball")
    with pytest.raises(InputError, match="units of problem 'ball': unknown node 'y'"):
        li.Problem("ball", ball.scheme, units={"y": "rad"})
    with pytest.raises(InputError, match=r"units\['x'\] = 1 of problem 'ball' must be a string, as 'rad'"):
        li.Problem("ball", ball.scheme, units={"x": 1})
