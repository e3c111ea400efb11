"""Every method meets every problem: it runs, or refuses before the first step and names a method that does run."""

import re
from functools import cache, lru_cache

import numpy as np
import pytest

import lcpimpact as li
from lcpimpact.integrators import METHODS
from lcpimpact.problems import PROBLEMS

STOPPED_PLATE = li.Problem(
    "stopped plate",
    li.Scheme(
        li.Mass("x", m=1.0),
        li.Bumper("x", "z", name="R", e=0.5),
        li.KelvinVoigt("z", "ground", k=10.0, c=1.0),
        li.Bumper("z", "ground", gap=0.1, name="S", e=0.5),
    ),
    v0={"x": 1.0},
)
PUSHED_PLATE = li.Problem(
    "pushed plate",
    li.Scheme(
        li.Mass("x", m=1.0),
        li.Load("x", lambda t, q, v: -0.1 * q**3),
        li.Bumper("x", "z"),
        li.KelvinVoigt("z", "ground", k=10.0, c=1.0),
    ),
    v0={"x": 1.0},
)
LINKED_PAIR = li.Problem(
    "linked pair",
    li.Scheme(
        li.Mass("x", m=1.0),
        li.Load("x", f=9.81),
        li.Mass("y", m=2.0),
        li.RigidLink("x", "y"),
        li.Bumper("y", "ground", gap=0.1, e=0.5),
    ),
)
LOOP = li.Problem(
    "loop",
    li.LinearComplementaritySystem(
        [[0.0, 0.0], [0.0, -1.0]], [[1.0], [1.0]], [[1.0, 1.0]], c=[-1.0], lower=[-float("inf")]
    ),
    q0={"x2": 1.0},
)
HELD_BLOCK = li.Problem(
    "held block",
    li.Scheme(
        li.Mass("x", m=1.0),
        li.Mass("y", m=1.0),
        li.Load("x", f=4.0),
        li.Load("y", f=9.81),
        li.Bumper("y", "ground", e=0.0, name="N"),
        li.Friction("x", "ground", mu=0.3, mu_s=0.5, normal="N"),
    ),
)
BRAKED = li.Problem(
    "braked",
    li.Scheme(
        li.Mass("x", m=1.0),
        li.Load("x", f=9.81),
        li.Bumper("x", "ground", gap=0.1, e=0.5),
        li.NonlinearDashpot("x", "ground", c=2.0, n=2.0),
    ),
)
STEERED = li.Problem(
    "steered",
    li.Scheme(
        li.Mass("x", m=1.0),
        li.Bumper("x", "ground", gap=0.1, e=0.5),
        li.SampledForce("x", kp=40.0, kd=4.0, reference=0.2, period=1e-4),
    ),
)
OWN = {each.name: each for each in (STOPPED_PLATE, PUSHED_PLATE, LINKED_PAIR, LOOP, HELD_BLOCK, BRAKED, STEERED)}
"""Schemes with features that no registered problem has."""

EVERY = (*PROBLEMS, *OWN)
SMALLER = {"bar-impact": {"elements": 4.0}, "bouncing-bar": {"elements": 4.0}, "plastic-bar-impact": {"elements": 4.0}}
STEPS = 3
SAID = ("driven", "massive", "of_rate", "r_min", "r_max", "relative_degree", "restitution", "impulse_lines")


def new(name):
    return OWN.get(name) or li.load_problem(name, **SMALLER.get(name, {}))


load, untouched = lru_cache(maxsize=None)(new), lru_cache(maxsize=None)(new)
"""Problems that are run again and again, and others that are never run."""


def attempt(problem, method):
    dt = problem.t_end / 20_000
    return li.simulate(problem, method, dt=dt, t_end=STEPS * dt, progress=False)


@cache
def runs(name, method):
    try:
        return attempt(load(name), method).success
    except li.UnsupportedError:
        return False


@pytest.mark.parametrize("problem", EVERY)
@pytest.mark.parametrize("method", METHODS)
def test_a_method_runs_or_names_one_that_does(method, problem):
    name, problem = problem, load(problem)
    try:
        run = attempt(problem, method)
    except li.UnsupportedError as refusal:
        said = str(refusal)
        assert method in said, "who refuses"
        named = [each for each in re.findall(r"'([\w-]+)'", said) if each in METHODS and each != method]
        assert named, f"no other method is named: {said}"
        assert any(runs(name, each) for each in named), said
        return
    assert run.success
    d, fresh = problem.dynamics, untouched(name).dynamics
    for each in ("M", "C", "K", "H", "B", "D", "u0", *SAID):
        np.testing.assert_array_equal(getattr(d, each), getattr(fresh, each), err_msg=f"a run has changed {each}")
    assert np.isfinite(run.q).all()
    assert np.isfinite(run.v).all()
    assert np.isfinite(run.reaction).all()
    assert run.t[-1] == pytest.approx(STEPS * problem.t_end / 20_000)
    d = METHODS[method].declared
    assert {contact.relative_degree for contact in problem.dynamics.contacts} <= set(d.relative_degrees)
    assert set(problem.dynamics.features) <= {*d.handles, *d.moving}


@pytest.mark.parametrize("method", METHODS)
def test_what_is_declared_as_handled_is_run(method):
    """Each feature and degree that a method declares occurs in a problem here that it runs."""
    d = METHODS[method].declared
    features, degrees = set(), set()
    for name in EVERY:
        problem = load(name)
        if set(problem.dynamics.features) <= set(d.handles) and runs(name, method):
            features |= set(problem.dynamics.features)
            degrees |= {contact.relative_degree for contact in problem.dynamics.contacts}
    assert features == set(d.handles)
    assert degrees == set(d.relative_degrees)


def plate_with_orifice():
    base = li.load_problem("system-1")
    orifice = li.Load("z", lambda t, q, v: -10.0 * v * np.sqrt(v**2 + 1e-12))
    return li.Problem("orifice", li.Scheme(*base.scheme.elements, orifice), q0=base.q0, v0=base.v0)


def trigger():
    system = li.LinearComplementaritySystem([[0.0]], [[1.0]], [[1.0]], D=[[-1.0]], lower=[-1.0], upper=[1.0])
    return li.Problem("trigger", system, q0={"x1": 1.5})


def kicked():
    table = li.PrescribedMotion("y", li.Table([0.0, 0.5, 1.0], [0.0, 1.0, 1.0]))
    return li.Problem("kicked", li.Scheme(table, li.Mass("x", 1.0), li.Bumper("x", "y", e=0.5)), q0={"x": -1.0})


@pytest.mark.parametrize("make", [plate_with_orifice, trigger, kicked])
def test_a_refusal_names_only_methods_that_take_the_problem(make):
    """Those that it names by their declarations may refuse the problem in turn, by a check of their own."""
    problem, refusals = make(), []
    for method in METHODS:
        try:
            li.simulate(problem, method, dt=0.02, t_end=0.1, throw=False, progress=False)
        except li.UnsupportedError as refusal:
            refusals.append(refusal)
    for refusal in refusals:
        assert refusal.methods
        assert str(refusal).endswith(f"take method={' or '.join(map(repr, refusal.methods))}")
    for method in {name for refusal in refusals for name in refusal.methods}:
        assert li.simulate(problem, method, dt=0.02, t_end=0.1, progress=False).success


def test_newton_advises_a_smaller_dt_only_where_that_helps():
    """A force that has no balance at any dt, since it jumps against the motion, and one that is too steep for long steps."""
    cliff = li.Load("x", lambda t, q, v: np.where(v.real > 0.0, -1e6, 1e6) + 0.0 * v)
    problem = li.Problem("cliff", li.Scheme(li.Mass("x", 1.0), cliff), v0={"x": 1.0})
    run = li.simulate(problem, dt=1e-2, t_end=0.1, throw=False, progress=False)
    assert run.status is li.Status.NEWTON
    assert "smaller dt" not in run.message


@pytest.mark.parametrize("method", ["exact", "event-driven"])
def test_a_slip_that_is_prescribed_is_refused_for_that_reason(method):
    """A rough block on a shaker whose motion is prescribed rubs on the ground: methods that are named take it."""
    scheme = li.Scheme(
        li.Mass("x", 1.0),
        li.Load("x", 10.0),
        li.Bumper("x", "ground", gap=0.0, e=0.0, name="N"),
        li.PrescribedMotion("shaker", li.Harmonic(0.1, 3.0)),
        li.Friction("shaker", "ground", mu=0.3, normal="N", name="F"),
    )
    problem = li.Problem("shaker", scheme)
    with pytest.raises(
        li.UnsupportedError, match="the rate of 'F', which prescribed motions alone determine"
    ) as refusal:
        li.simulate(problem, method, dt=0.01, t_end=0.1)
    assert refusal.value.methods == ("moreau-jean", "radau")
    for named in refusal.value.methods:
        run = li.simulate(problem, named, dt=0.01, t_end=0.1)
        np.testing.assert_allclose(run["F"][1:], -3.0, rtol=1e-9)
