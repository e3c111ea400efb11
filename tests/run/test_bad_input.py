"""Everything that a caller can get wrong is answered by an exception that names the thing and a remedy."""

from __future__ import annotations

import copy
import dataclasses
import math
import pickle
import re
import tracemalloc

import numpy as np
import pytest

import lcpimpact
from lcpimpact import (
    Bumper,
    FailureError,
    InputError,
    KelvinVoigt,
    LcpImpactError,
    Load,
    Mass,
    Motion,
    PrescribedMotion,
    Problem,
    Scheme,
    Spring,
    Status,
    UnsupportedError,
    load_problem,
    memory,
    simulate,
)
from lcpimpact.errors import UnknownNameError
from lcpimpact.integrators import METHODS as METHODS_BY_NAME
from lcpimpact.integrators.moreau_jean import MoreauJean

METHODS = ["moreau-jean", "exact", "rk4-paper"]


def run(name="system-1", method="moreau-jean", **changes):
    """A short run of a registered problem, with something changed."""
    return simulate(load_problem(name), method, **({"dt": 1e-2, "t_end": 1e-1} | changes))


def test_the_run_that_the_cases_change_is_good():
    for method in METHODS:
        assert run(method=method).success


def test_every_error_is_one_of_the_package():
    for kind in (InputError, UnknownNameError, UnsupportedError, FailureError):
        assert issubclass(kind, LcpImpactError)
    assert issubclass(InputError, ValueError)
    assert not issubclass(UnsupportedError, InputError)


# ---- problems and their parameters ----------------------------------------------------------------------------------

PHYSICAL = {
    "system-1": {"m": "kg", "k_o": "N/m", "c_o": "N s/m"},
    "system-2": {"m": "kg", "k": "N/m", "k_o": "N/m", "c_o": "N s/m"},
    "system-3": {"m": "kg", "k": "N/m", "k_o": "N/m", "c": "N s/m", "c_o": "N s/m"},
    "bouncing-ball": {"m": "kg"},
}
CASES = [(name, key, unit) for name, keys in PHYSICAL.items() for key, unit in keys.items()]


@pytest.mark.parametrize("value", [0.0, 0, -1.0])
@pytest.mark.parametrize(("name", "key", "unit"), CASES)
def test_a_constant_of_a_problem_that_is_not_positive(name, key, unit, value):
    with pytest.raises(
        InputError, match=rf"at '\w+'.*\b{key} = .*positive.* {unit}$|between .*\b{key} = .*positive.* {unit}$"
    ):
        load_problem(name, **{key: value})


@pytest.mark.parametrize(
    "value", [math.nan, math.inf, -math.inf, "heavy", None, True, [1.0], 10**400], ids=lambda v: repr(v)[:8]
)
@pytest.mark.parametrize("key", ["m", "k_o", "c_o", "g", "h_o", "v_o"])
def test_a_parameter_that_is_no_finite_number(key, value):
    with pytest.raises(InputError, match=rf"system-1: {key} = .*finite number"):
        load_problem("system-1", **{key: value})


@pytest.mark.parametrize(
    ("name", "wrong", "right"),
    [("system-1", "co", "c_o"), ("system-1", "mm", "m"), ("system-2", "k0", "k"), ("system-3", "h", "h_o"),
     ("bouncing-ball", "ee", "e"), ("system-1", "c", "c_o")],
)  # fmt: skip
def test_an_unknown_parameter_offers_the_nearest(name, wrong, right):
    with pytest.raises(InputError, match=rf"unknown parameter of {name} '{wrong}'.*\b{right}\b"):
        load_problem(name, **{wrong: 1.0})


def test_a_near_parameter_is_offered_first():
    with pytest.raises(InputError, match="did you mean 'c_o'"):
        load_problem("system-1", c_0=1.0)


@pytest.mark.parametrize(
    ("wrong", "right"), [("system1", "system-1"), ("sytem-2", "system-2"), ("bouncingball", "bouncing-ball")]
)
def test_an_unknown_problem_offers_the_nearest(wrong, right):
    with pytest.raises(InputError, match=rf"unknown problem '{wrong}': did you mean '{right}'"):
        load_problem(wrong)


@pytest.mark.parametrize("wrong", ["", "zzz"])
def test_a_problem_that_is_none(wrong):
    with pytest.raises(InputError, match=r"unknown problem .*system-1, system-2, system-3, bouncing-ball"):
        load_problem(wrong)


@pytest.mark.parametrize("wrong", [None, 3, ["system-1"], load_problem("system-1")], ids=lambda v: repr(v)[:12])
def test_a_problem_that_is_no_name(wrong):
    with pytest.raises(InputError, match=r"^problem = .{,60} must be a string$"):
        load_problem(wrong)


def test_a_fall_that_has_no_speed():
    with pytest.raises(InputError, match=r"g = 9\.81.*h_o = -5.*make both positive, or give v_o"):
        load_problem("system-1", h_o=-5.0)
    with pytest.raises(InputError, match=r"make both positive"):
        load_problem("system-2", g=-9.81)
    assert load_problem("system-1", h_o=-5.0, v_o=3.0).parameters["v_o"] == 3.0
    for change in ({"g": 0.0}, {"g": -9.81}, {"H": 0.0}, {"H": -1.0}):
        with pytest.raises(InputError, match=r"bouncing-ball: g = .*H = .*must be positive"):
            load_problem("bouncing-ball", **change)


@pytest.mark.parametrize("e", [-0.1, 1.5])
def test_a_restitution_of_a_problem(e):
    with pytest.raises(InputError, match=r"Bumper.*e = .*between 0 and 1"):
        load_problem("bouncing-ball", e=e)


# ---- problems of one's own ------------------------------------------------------------------------------------------

BALL = Scheme(Mass("ball", m=1.0), Load("ball", f=9.81), Bumper("ball", "ground", gap=1.0, e=0.5))


@pytest.mark.parametrize("kind", ["q0", "v0"])
def test_an_initial_value_for_an_unknown_node(kind):
    with pytest.raises(InputError, match=rf"{kind} of problem 'mine'.*unknown node 'bal': did you mean 'ball'"):
        Problem("mine", BALL, **{kind: {"bal": 0.0}})
    with pytest.raises(InputError, match=rf"{kind} .*unknown node 'ground'.*known are ball"):
        Problem("mine", BALL, **{kind: {"ground": 0.0}})


@pytest.mark.parametrize("value", [math.nan, math.inf, "0", None, True, 10**400], ids=lambda v: repr(v)[:8])
@pytest.mark.parametrize("kind", ["q0", "v0"])
def test_an_initial_value_that_is_no_number(kind, value):
    with pytest.raises(InputError, match=rf"problem 'mine': {kind}\['ball'\] = .* must be a finite number"):
        Problem("mine", BALL, **{kind: {"ball": value}})


def test_starting_penetrated():
    with pytest.raises(
        InputError, match=r"bumper 'R' of problem 'mine' starts penetrated by 0\.25 m.*q0\['ball'\].*gap"
    ):
        Problem("mine", BALL, q0={"ball": 1.25})
    with pytest.raises(InputError, match=r"penetrated by 0\.5 m: lower q0\['x'\], raise q0\['z'\]"):
        dataclasses.replace(load_problem("system-1"), q0={"x": 0.5})
    assert Problem("mine", BALL, q0={"ball": 1.0}).dynamics.gap(0.0, [1.0]) == 0.0
    # A plate that only springs hold has no place of its own to start from.
    assert dataclasses.replace(load_problem("system-2"), q0={"y": 0.5}).dynamics.contacts[0].relative_degree == 0


def test_a_scheme_that_cannot_be_assembled_is_refused_with_the_problem():
    with pytest.raises(InputError, match="nothing holds node 'z'"):
        Problem("mine", Scheme(Mass("x", m=1.0), Bumper("x", "z")))


@pytest.mark.parametrize("scheme", ["system-1", None, [Mass("x", m=1.0)]], ids=repr)
def test_a_problem_without_a_scheme(scheme):
    with pytest.raises(InputError, match="Scheme"):
        Problem("mine", scheme)


NO_LOADS = {
    "of two arguments": (
        lambda t, v: 1.0,
        r"fails by TypeError: .*missing 1 required.* 'v'; a function takes the time in s",
    ),
    "of none": (lambda: 1.0, "fails by TypeError"),
    "that divides by zero": (lambda t: 1.0 / t, "fails by ZeroDivisionError"),
    "text": (lambda t: "a", "returns 'a'; return a finite number in N"),
    "None": (lambda t: None, "returns None"),
    "NaN": (lambda t: math.nan, "returns nan"),
    "infinite": (lambda t: math.inf, "returns inf"),
    "complex": (lambda t: 1j, "returns 1j"),
    "array": (lambda t: np.ones(2), r"returns an array of the shape \(2,\)"),
    "array of one": (lambda t: np.ones(1), r"returns an array of the shape \(1,\)"),
}


@pytest.mark.parametrize("case", NO_LOADS)
def test_a_function_that_gives_no_number_is_refused_with_its_element_before_the_run(case):
    f, says = NO_LOADS[case]
    of_load = "f must take t, or t, q and v" if case in ("of two arguments", "of none") else rf"f\(0\.0\) {says}"
    with pytest.raises(InputError, match=rf"^Load at 'x': {of_load}"):
        Scheme(Mass("x", m=1.0), Load("x", f=f)).assemble()
    says = says.replace("in N", "in m")
    driven = [(Motion(f, float), "y"), (Motion(float, f), r"y\.rate")]
    for y, name in driven:
        with pytest.raises(InputError, match=rf"^PrescribedMotion at 'b': {name}\(0\.0\) (fails|returns)"):
            Scheme(Mass("x", m=1.0), Spring("x", "b", k=1.0), PrescribedMotion("b", y)).assemble()
    with pytest.raises(InputError, match=r"^a\[1\] of the system\(0\.0\) (fails|returns)"):
        lcpimpact.LinearComplementaritySystem(np.zeros((2, 2)), np.ones((2, 1)), np.ones((1, 2)), a=[0.0, f])


@pytest.mark.parametrize("method", ["moreau-jean", "newmark-ns", "event-driven", "dopri5"])
@pytest.mark.parametrize("case", ["that divides by zero", "text", "None", "complex", "array"])
def test_a_function_that_gives_no_number_later_ends_the_run_with_a_sentence(case, method):
    f, says = NO_LOADS[case]
    scheme = Scheme(Mass("x", m=1.0), Load("x", f=lambda t: 1.0 if t < 0.05 else f(0.0)), *RIGID)
    with pytest.raises(InputError, match=rf"^Load at 'x': f\(0\.\d+\) {says}"):
        simulate(Problem("mine", scheme), method, dt=1e-2, t_end=1e-1)


@pytest.mark.parametrize(
    "f", [np.float32, int, lambda t: np.array(2.0)], ids=["float32", "int", "array of no dimension"]
)
def test_every_kind_of_real_number_is_a_force(f):
    assert simulate(Problem("mine", Scheme(Mass("x", m=1.0), Load("x", f=f))), dt=1e-2, t_end=1e-1).success


@pytest.mark.parametrize("method", ["moreau-jean", "rk4", "dopri5", "event-driven"])
def test_a_load_that_is_no_function_of_time_is_refused(method):
    rng = np.random.default_rng(1)
    problem = Problem("noise", Scheme(Mass("x", m=1.0), Load("x", f=lambda t: rng.normal())))
    with pytest.raises(InputError, match=r"The load on 'x' is .* when it is asked again: .* the points of a Table"):
        simulate(problem, method, dt=1e-2, t_end=0.1)


RIGID = [Bumper("x", "ground", gap=9.0, e=0.5)]
SOFT = [Bumper("x", "z", gap=0.1), KelvinVoigt("z", "ground", k=9.0, c=1.0)]


@pytest.mark.parametrize("late", [math.nan, math.inf])
@pytest.mark.parametrize("plate", [RIGID, SOFT], ids=["rigid", "soft"])
@pytest.mark.parametrize("method", METHODS_BY_NAME)
def test_a_load_that_becomes_infinite_ends_the_run_there_and_is_named(method, plate, late):
    scheme = Scheme(Mass("x", m=1.0), Load("x", f=lambda t: late if t > 0.352 else 1.0), *plate)
    problem = Problem("mine", scheme, v0={"x": 1.0})
    try:
        traj = simulate(problem, method, dt=1e-2, t_end=0.7, throw=False)
    except UnsupportedError:
        return
    assert traj.status is Status.NON_FINITE
    assert re.search(
        r"stopped after step 3\d .*not finite.*The load on 'x' is (nan|inf) at t = 0\.3[56]\d* s\.$", traj.message
    )
    assert 0.33 < traj.t[-1] < 0.3521
    assert np.isfinite(traj.q).all()


# ---- the grid -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ["dt", "t_end"])
@pytest.mark.parametrize("value", [0.0, 0, -1e-2, math.nan, math.inf, -math.inf, "0.01", True, 1j], ids=repr)
def test_a_step_or_an_end_that_is_not_positive_and_finite(method, name, value):
    with pytest.raises(InputError, match=rf"^{name} = .*positive finite number in s"):
        run(method=method, **{name: value})


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("dt", "t_end", "fitting"), [(0.03, 0.1, 0.025), (0.3, 0.1, 0.001), (7e-3, 0.1, 0.1 / 15)])
def test_an_end_that_is_not_a_multiple_of_the_step(method, dt, t_end, fitting):
    with pytest.raises(InputError, match=r"t_end = 0\.1 s is not a whole number of steps dt = .*take dt = ") as caught:
        run(method=method, dt=dt, t_end=t_end)
    remedy = float(re.search(r"take dt = (\S+)", str(caught.value)).group(1))
    assert remedy == pytest.approx(fitting, rel=1e-11)
    assert run(method=method, dt=remedy, t_end=t_end).success


@pytest.mark.parametrize(("dt", "t_end", "steps"), [(0.1, 0.3, 3), (1e-2, 0.07, 7), (1e-3, 2.999, 2999), (0.7, 2.1, 3)])
def test_a_multiple_in_floating_point_is_one(dt, t_end, steps):
    """0.1 + 0.1 + 0.1 is not 0.3, and arange would add a point."""
    traj = run(dt=dt, t_end=t_end)
    assert len(traj.t) == steps + 1
    assert traj.t[-1] == t_end


@pytest.mark.parametrize("dt", [5e-324, 1e-300, 1e-12])
def test_a_step_that_is_too_small_for_any_computer(dt):
    with pytest.raises(InputError, match=r"dt = .*more than 1e9 steps: take a larger dt"):
        run(dt=dt, t_end=1.0)


@pytest.mark.parametrize("method", ["moreau-jean", "exact", "event-driven", "rk4"])
def test_more_steps_than_fit_in_memory_are_refused_before_any_memory_is_taken(method, monkeypatch):
    monkeypatch.setattr(memory, "free_memory", lambda: 8e9)
    tracemalloc.start()
    with pytest.raises(
        InputError,
        match=r"^1,000,000,000 steps do not fit in memory: .*112 GB are needed, and 8 GB are free; take a larger dt",
    ):
        run(method=method, dt=1e-9, t_end=1.0)
    assert tracemalloc.get_traced_memory()[1] < 1e8
    tracemalloc.stop()


def test_a_run_is_refused_where_its_arrays_take_half_of_what_it_may_take(monkeypatch):
    traj = run(method="exact", dt=1e-3)
    arrays = sum(each.nbytes for each in (traj.t, traj.q, traj.v, traj.t_reaction, traj.reaction))
    monkeypatch.setattr(memory, "SMALL", 0.0)
    monkeypatch.setattr(memory, "free_memory", lambda: 2.001 * arrays / memory.FREE_FRACTION)
    assert run(method="exact", dt=1e-3).success
    monkeypatch.setattr(memory, "free_memory", lambda: 1.999 * arrays / memory.FREE_FRACTION)
    with pytest.raises(InputError, match="100 steps do not fit in memory"):
        run(method="exact", dt=1e-3)


def test_the_free_memory_is_that_of_the_machine_or_of_the_job_and_unknown_elsewhere(tmp_path, monkeypatch):
    monkeypatch.setattr(memory, "CGROUP", tmp_path)
    machine = memory.free_memory()
    assert 1e7 < machine < 1e15
    for most, free in (("max", machine), ("3000000", 2e6), ("10", 0.0)):
        (tmp_path / "memory.max").write_text(most)
        (tmp_path / "memory.current").write_text("1000000")
        assert memory.free_memory() == pytest.approx(free, rel=0.5)
    (tmp_path / "memory.max").write_text("max")
    monkeypatch.setattr(memory.Path, "read_text", lambda *a, **k: "nothing")
    monkeypatch.delattr(memory.os, "sysconf")
    assert memory.free_memory() == math.inf


@pytest.mark.parametrize(("name", "count"), [("newtons-cradle", "N"), ("bar-impact", "elements")])
def test_more_bodies_than_matrices_are_kept_of_are_refused_before_they_are_made(name, count):
    with pytest.raises(InputError, match=rf"{count} = 1e\+09 must be a whole number, at least \d and at most 10,000"):
        load_problem(name, **{count: 1e9})


# ---- methods, solvers and options -----------------------------------------------------------------------------------


def test_dt_has_no_default():
    with pytest.raises(TypeError, match="dt"):
        simulate(load_problem("system-1"), t_end=1.0)
    with pytest.raises(InputError, match=r"^dt = None must be a positive finite number in s"):
        simulate(load_problem("system-1"), dt=None)


@pytest.mark.parametrize("wrong", ["system-1", None, BALL, Problem], ids=lambda v: repr(v)[:10])
def test_what_is_no_problem(wrong):
    with pytest.raises(InputError, match=r"problem = .* must be a Problem: get one from load_problem"):
        simulate(wrong, dt=1e-2, t_end=1e-1)


@pytest.mark.parametrize(
    ("wrong", "right"),
    [("moreau_jean", "moreau-jean"), ("moreau", "moreau-jean"), ("exakt", "exact"), ("rk4-papr", "rk4-paper")],
)
def test_an_unknown_method_offers_the_nearest(wrong, right):
    with pytest.raises(InputError, match=rf"unknown method '{wrong}': did you mean '{right}'"):
        run(method=wrong)


@pytest.mark.parametrize("wrong", [None, 3, MoreauJean, ["exact"]], ids=lambda v: repr(v)[:12])
def test_a_method_that_is_neither_name_nor_object(wrong):
    with pytest.raises(InputError, match=r"method = .*must be a name or an Integrator"):
        run(method=wrong)


@pytest.mark.parametrize(
    ("method", "wrong", "right"),
    [("moreau-jean", "thetaa", "theta"), ("moreau-jean", "maxiter", "max_iter"), ("exact", "max_event", "max_events"),
     ("rk4-paper", "contacts", "contact")],
)  # fmt: skip
def test_an_unknown_option_offers_the_nearest(method, wrong, right):
    with pytest.raises(InputError, match=rf"unknown option of {method} '{wrong}': did you mean '{right}'"):
        run(method=method, **{wrong: 1})


def test_an_option_of_another_method():
    with pytest.raises(InputError, match=r"unknown option of exact 'theta'.*max_events"):
        run(method="exact", theta=1.0)
    with pytest.raises(InputError, match=r"unknown option of rk4-paper 'theta'.*contact"):
        run(method="rk4-paper", theta=1.0)


def test_options_beside_an_integrator_object():
    assert run(method=MoreauJean(theta=1.0)).success
    with pytest.raises(InputError, match=r"theta.*belong in the integrator object"):
        run(method=MoreauJean(), theta=1.0)


@pytest.mark.parametrize(
    "theta", [2.0, 1.0000001, 0.4999999, 0.3, 0.0, -0.5, math.nan, math.inf, "0.5", None, True], ids=repr
)
def test_theta_outside_one_half_to_1(theta):
    with pytest.raises(InputError, match=r"theta = .*must lie in \[0\.5, 1\].*0\.5.*1\.0.*below 0\.5 vibrations grow"):
        run(theta=theta)


@pytest.mark.parametrize("theta", [0.5, 0.6, 1.0])
def test_vibrations_change_by_the_stated_factor_and_never_grow(theta):
    """Which the refusal of θ < 1/2 rests on: |λ|² = (1 + (1 - θ)² ω² h²)/(1 + θ² ω² h²)."""
    spring = Problem("spring", Scheme(Mass("x", m=1.0), Spring("x", "ground", k=4.0)), q0={"x": 1.0})
    found = simulate(spring, dt=0.1, t_end=1.0, theta=theta)
    ωh = 2.0 * 0.1
    factor = (1.0 + (1.0 - theta) ** 2 * ωh**2) / (1.0 + theta**2 * ωh**2)
    energy = 0.5 * found["v_x"] ** 2 + 2.0 * found["x"] ** 2
    np.testing.assert_allclose(energy, 2.0 * factor ** np.arange(11), rtol=1e-13)
    assert factor <= 1.0


@pytest.mark.parametrize("value", [0, -1, 0.5, 2.5, math.nan, math.inf, "10", True], ids=repr)
def test_max_iter_that_is_no_whole_number_above_zero(value):
    with pytest.raises(InputError, match="max_iter"):
        run(max_iter=value)


@pytest.mark.parametrize("value", [0.0, -1e-9, math.nan, math.inf, "1e-9", True], ids=repr)
def test_tol_that_is_not_positive(value):
    with pytest.raises(InputError, match="tol"):
        run(tol=value)


@pytest.mark.parametrize("value", [0, -1, 2.5, math.nan, math.inf, "10", None, True], ids=repr)
def test_max_events_that_is_no_whole_number_above_zero(value):
    with pytest.raises(InputError, match=r"max_events = .*whole number, at least 1"):
        run(method="exact", max_events=value)


@pytest.mark.parametrize(("wrong", "right"), [("clipp", "clip"), ("Project", "project"), ("equals", "equal")])
def test_an_unknown_contact_rule_offers_the_nearest(wrong, right):
    with pytest.raises(InputError, match=rf"unknown contact rule '{wrong}': did you mean '{right}'"):
        run(method="rk4-paper", contact=wrong)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("wrong", "right"), [("lemkee", "lemke"), ("closed_form", "closed-form"), ("qp:osqq", "qp:osqp")]
)
def test_an_unknown_lcp_solver_offers_the_nearest(method, wrong, right):
    with pytest.raises(InputError, match=rf"'{right}'"):
        run(method=method, lcp_solver=wrong)


@pytest.mark.parametrize("wrong", [None, 3, ["lemke"]], ids=repr)
def test_an_lcp_solver_that_is_no_name(wrong):
    with pytest.raises(InputError, match=r"solver = .* must be a string"):
        run(lcp_solver=wrong)


def test_an_lcp_solver_for_a_method_that_solves_none():
    with pytest.raises(InputError, match=r"rk4-paper solves no LCP.*lcp_solver = 'lemke' means nothing: leave it out"):
        run(method="rk4-paper", lcp_solver="lemke")
    assert run(method="rk4-paper", lcp_solver="auto").success


# ---- what a method does not handle ----------------------------------------------------------------------------------


def test_rk4_paper_on_the_bouncing_ball_names_a_method_that_does():
    with pytest.raises(
        UnsupportedError, match=r"rk4-paper.*relative degree 2.*'R'.*of 'bouncing-ball'.*moreau-jean.*exact"
    ):
        run("bouncing-ball", "rk4-paper")
    for method in ("moreau-jean", "exact"):
        assert run("bouncing-ball", method).success


def test_rk4_paper_on_another_scheme_names_a_method_that_does():
    scheme = Scheme(Mass("x", m=1.0), Bumper("x", "z", gap=0.5), KelvinVoigt("z", "ground", k=1.0, c=1.0))
    with pytest.raises(UnsupportedError, match=r"rk4-paper.*system-1, system-2, system-3.*'mine'.*moreau-jean"):
        simulate(Problem("mine", scheme), "rk4-paper", dt=1e-2, t_end=1e-1)


def test_rk4_paper_does_not_trust_a_name():
    """The constants come from `parameters`; a scheme that they do not describe must not be run as if they did."""
    paper = load_problem("system-1")
    changed = Scheme(*paper.scheme.elements, Load("x", f=500.0))
    with pytest.raises(UnsupportedError, match=r"rk4-paper.*moreau-jean"):
        simulate(dataclasses.replace(paper, scheme=changed), "rk4-paper", dt=1e-2, t_end=1e-1)
    by_hand = simulate(Problem("system-1", paper.scheme, v0=paper.v0), "rk4-paper", dt=1e-2, t_end=1e-1)
    assert by_hand.q.tobytes() == simulate(paper, "rk4-paper", dt=1e-2, t_end=1e-1).q.tobytes()


def test_exact_with_a_load_that_is_a_function():
    scheme = Scheme(Mass("x", m=1.0), Load("x", f=math.sin), Bumper("x", "ground", gap=1.0, e=0.5))
    problem = Problem("mine", scheme)
    with pytest.raises(UnsupportedError, match=r"load on 'x' is a function of time.*Harmonic.*moreau-jean"):
        simulate(problem, "exact", dt=1e-2, t_end=1e-1)
    assert simulate(problem, dt=1e-2, t_end=1e-1).success


def test_an_lcp_solver_that_is_not_made_for_the_delassus_matrix():
    bodies = [
        part
        for i in range(3)
        for part in (Mass(f"x{i}", m=1.0), Bumper(f"x{i}", "ground", gap=1.0, e=0.0, name=f"R{i}"))
    ]
    problem = Problem("mine", Scheme(*bodies))
    with pytest.raises(UnsupportedError, match=r"'closed-form' needs .*n <= 2.*lemke.*auto"):
        simulate(problem, dt=1e-2, t_end=1e-1, lcp_solver="closed-form")
    assert simulate(problem, dt=1e-2, t_end=1e-1).success


@pytest.mark.parametrize("solver", ["auto", "closed-form", "lemke", "pgs", "enumeration", "qp:osqp", "qp:osqp:primal"])
@pytest.mark.parametrize("method", ["moreau-jean", "exact"])
def test_a_scheme_without_contacts_runs_with_every_solver(method, solver):
    problem = Problem("mine", Scheme(Mass("x", m=1.0), Spring("x", "ground", k=4.0)), q0={"x": 1.0})
    traj = simulate(problem, method, dt=1e-2, t_end=1.0, lcp_solver=solver)
    assert traj.success
    assert traj.reaction.shape[1] == 0
    assert traj["x"][-1] == pytest.approx(math.cos(2.0), abs=1e-4)


# ---- failures -------------------------------------------------------------------------------------------------------

PILE = Problem(
    "pile",
    Scheme(
        Mass("x", m=1.0), Load("x", f=9.81), Bumper("x", "y", e=0.0, name="A"),
        Mass("y", m=1.0), Load("y", f=9.81), Bumper("y", "ground", e=0.0, name="B"),
    ),
)  # fmt: skip


def test_a_run_that_fails_says_where_and_why():
    """The pile falls at first, and one sweep is enough for that; standing on each other it needs more."""
    falling = Problem("falling", PILE.scheme, q0={"x": -0.2, "y": -0.2})
    with pytest.raises(FailureError, match=r"moreau-jean stopped after step \d+ .*max_iter") as caught:
        simulate(falling, dt=1e-2, t_end=1.0, lcp_solver="pgs", max_iter=1)
    traj = caught.value.result
    assert traj.status is Status.MAX_ITER
    assert not traj.success
    assert traj.message == str(caught.value)
    steps = len(traj.t) - 1
    assert 10 < steps == traj.stats.steps == len(traj.reaction) < 100
    assert np.isfinite(traj.q).all()
    quiet = simulate(falling, dt=1e-2, t_end=1.0, lcp_solver="pgs", max_iter=1, throw=False)
    assert quiet.status is Status.MAX_ITER
    assert quiet.q.tobytes() == traj.q.tobytes()


@pytest.mark.parametrize("solver", ["lemke", "pgs"])
def test_a_run_that_fails_in_its_first_step_is_a_failure_too(solver):
    """Nothing but the initial state was reached; the result is still whole."""
    traj = simulate(PILE, dt=1e-2, t_end=1.0, lcp_solver=solver, max_iter=1, throw=False)
    assert traj.status is Status.MAX_ITER
    assert traj.t.tolist() == [0.0]
    assert traj.reaction.shape == (0, 2)
    assert traj.events == ()
    assert "max-iter" in repr(traj)
    with pytest.raises(FailureError, match=r"after step 0 .*max_iter"):
        simulate(PILE, dt=1e-2, t_end=1.0, lcp_solver=solver, max_iter=1)


def test_a_run_cut_to_its_initial_state_can_be_sampled_and_saved(tmp_path):
    traj = simulate(PILE, dt=1e-2, t_end=1.0, lcp_solver="lemke", max_iter=1, throw=False)
    assert traj.sample(0.0).q.tolist() == [[0.0, 0.0]]
    assert traj.save(tmp_path / "run.csv").read_text().count("\n") == 2


def test_too_many_events_are_a_failure_with_a_remedy():
    with pytest.raises(FailureError, match=r"max_events.*moreau-jean") as caught:
        run("bouncing-ball", "exact", t_end=3.0, max_events=5)
    traj = caught.value.result
    assert traj.status is Status.MAX_EVENTS
    # The sixth impact would be at t_1 (1 + 2 (e + ... + e^5)).
    sixth = math.sqrt(2.0 / 9.81) * (1.0 + 2.0 * sum(0.8**i for i in range(1, 6)))
    assert traj.t[-1] <= sixth
    assert traj.t[-1] > sixth - 3e-2
    assert np.isfinite(traj.q).all()


def test_numbers_that_overflow_are_a_failure():
    scheme = Scheme(Mass("x", m=1e-300), Load("x", f=1e300))
    with np.errstate(all="ignore"):
        traj = simulate(Problem("mine", scheme), dt=1.0, t_end=10.0, throw=False)
    assert traj.status is Status.NON_FINITE
    assert np.isfinite(traj.q).all()


def test_statuses_are_sentences_with_a_remedy():
    assert len({status.sentence for status in Status}) == len(Status)
    for status in Status:
        assert status.sentence.endswith(".")
        assert Status(int(status)) is status
    for status in (
        Status.MAX_ITER,
        Status.INACCURATE,
        Status.UNDECIDED,
        Status.SINGULAR,
        Status.RAY,
        Status.MAX_EVENTS,
    ):
        assert re.search(r"raise|loosen|try|take", status.sentence)


@pytest.mark.parametrize("read", [lcpimpact.peak, lcpimpact.crossing, lcpimpact.final], ids=lambda read: read.__name__)
@pytest.mark.parametrize("method", ["moreau-jean", "exact"])
def test_a_series_that_is_not_in_the_run(read, method):
    found = lcpimpact.simulate(lcpimpact.load_problem("system-1"), method, dt=1e-2, t_end=0.1)
    with pytest.raises(InputError, match="unknown series 'v_xx': did you mean 'v_x'"):
        read(found, "v_xx")


# ---- saving ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["run", "run.txt", "run.csv.gz", "run.CSVX", ".csv"])
def test_an_unknown_ending(tmp_path, name):
    with pytest.raises(InputError, match=rf"{re.escape(name)}.*must end in one of \.csv, \.npz, \.nc"):
        run().save(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("ending", [".csv", ".npz"])
def test_a_folder_that_does_not_exist(tmp_path, ending):
    with pytest.raises(InputError, match=rf"cannot write .*nowhere.*run\{ending}.*there is no folder.*name another"):
        run().save(tmp_path / "nowhere" / f"run{ending}")


def test_a_folder_that_cannot_be_written():
    with pytest.raises(InputError, match=r"cannot write .*'/proc/run\.csv'.*folder that can be written"):
        run().save("/proc/run.csv")


def test_a_folder_of_that_name(tmp_path):
    (tmp_path / "run.csv").mkdir()
    with pytest.raises(InputError, match=r"cannot write .*run\.csv': a folder has that name; name another"):
        run().save(tmp_path / "run.csv")
    assert [path.name for path in tmp_path.iterdir()] == ["run.csv"]


# ---- the package itself ---------------------------------------------------------------------------------------------


def test_an_unknown_attribute_of_the_package():
    with pytest.raises(AttributeError, match="no attribute 'Masss'"):
        lcpimpact.Masss  # noqa: B018
    for name in lcpimpact.__all__:
        assert getattr(lcpimpact, name) is not None
    assert set(lcpimpact.__all__) <= set(dir(lcpimpact))


# ---- what a newcomer meets ------------------------------------------------------------------------------------------


def test_a_step_that_does_not_fit_is_told_as_a_part_of_the_end():
    with pytest.raises(InputError, match=r"take dt = 0\.00299401197605 \(t_end/334\)$"):
        run(dt=3e-3, t_end=1.0)
    with pytest.raises(InputError, match=r"dt = 10 s, which is longer than the run: take dt = 0\.01 \(t_end/100\)"):
        run(dt=10.0, t_end=1.0)


@pytest.mark.parametrize("kind", [lcpimpact.Scheme, lcpimpact.SparseScheme])
@pytest.mark.parametrize("name", ["Ground", "GROUND"])
def test_the_ground_in_capitals_is_no_node(kind, name):
    mass, spring = lcpimpact.Mass("x", m=1.0), lcpimpact.Spring("x", name, k=1.0)
    for element in (spring, lcpimpact.Bumper("x", name, gap=1.0), lcpimpact.Dashpot("x", name, c=1.0)):
        with pytest.raises(InputError, match=rf"node '{name}' has no mass: did you mean 'ground'\?"):
            kind(mass, element).assemble()
    assert kind(mass, lcpimpact.Mass(name, m=2.0), spring).assemble().nodes == ("x", name)


def test_twins_of_one_name_are_told_as_twins():
    twins = [lcpimpact.Bumper("x", "ground", gap=gap, e=0.5, name="R") for gap in (1.0, 2.0)]
    with pytest.raises(InputError, match="two forces have the same name 'R', each the reaction of Bumper"):
        lcpimpact.Scheme(lcpimpact.Mass("x", m=1.0), *twins).assemble()


def test_a_series_is_no_attribute_and_the_message_says_how_it_is_read():
    found = lcpimpact.simulate(lcpimpact.load_problem("system-1"), dt=0.1, t_end=0.2)
    for name in found.names:
        with pytest.raises(AttributeError, match=rf"has no attribute '{name}': a series is run\['{name}'\]$"):
            getattr(found, name)
    with pytest.raises(AttributeError, match=r"has no attribute 'foo'$"):
        _ = found.foo
    assert pickle.loads(pickle.dumps(found)).names == copy.copy(found).names == found.names
