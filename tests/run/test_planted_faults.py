"""A fault that is planted in a run is found by its own law, under each rule by which certificates integrate."""

import dataclasses

import numpy as np
import pytest

import lcpimpact as li

RULES = {"sums of θ-steps": "moreau-jean", "trapezoidal rule": "radau", "Gauss's rule on pieces": "exact"}

T_END = 2.0


def bouncing(e=0.5, gap=0.05):
    """A body on a spring and a dashpot that a load drives against a stop."""
    return li.Scheme(
        li.Mass("x", 1.3), li.Spring("x", "ground", 40.0), li.Dashpot("x", "ground", 0.7),
        li.Load("x", li.Harmonic(5.0, 5.0)), li.Bumper("x", "ground", gap=gap, e=e, name="R"),
    )  # fmt: skip


def pressed(e=0.0):
    """A body on a spring that a load holds on a stop, with another that swings on it."""
    return li.Scheme(
        li.Mass("x", 1.3), li.Spring("x", "ground", 40.0), li.Load("x", 9.0), li.Mass("y", 0.5),
        li.Spring("x", "y", 30.0), li.Load("y", li.Harmonic(1.0, 7.0)),
        li.Bumper("x", "ground", gap=0.0, e=e, name="R"),
    )  # fmt: skip


def sliding():
    """A body on a spring that a load drives back and forth against dry friction."""
    return li.Scheme(
        li.Mass("x", 1.3), li.Spring("x", "ground", 40.0), li.Load("x", li.Harmonic(20.0, 4.0)),
        li.Slider("x", "ground", 3.0, name="R"),
    )  # fmt: skip


SCHEMES = {scheme.__name__: scheme for scheme in (bouncing, pressed, sliding)}


@pytest.fixture(scope="module", params=RULES, ids=lambda rule: rule.replace(" ", "-"))
def runs(request):
    """Runs of the schemes by a method whose certificate integrates by one rule."""
    method = RULES[request.param]
    return {
        name: li.simulate(
            li.Problem(name, make(), v0={"x": -0.4} if make is bouncing else {}, t_end=T_END), method, dt=T_END / 4000,
            progress=False, error=False,
        )
        for name, make in SCHEMES.items()
    }  # fmt: skip


def planted(run, part, fault):
    """Return the run with another q, v or r, x = fault(t, x), in its record, its events and its continuous solution."""
    at = ("q", "v", "reaction").index(part)
    times = run.t_reaction if part == "reaction" else run.t
    changed = {part: fault(times, getattr(run, part))}
    if part == "reaction":
        ones = [fault(np.array([event.t]), np.array([[event.impulse]])) for event in run.events]
        changed["events"] = tuple(
            dataclasses.replace(event, impulse=float(one[0, 0])) for event, one in zip(run.events, ones, strict=True)
        )
    if run.dense is not None:
        true = run.dense.solution

        def solution(t, side):
            series = list(true(t, side))
            series[at] = fault(t, series[at])
            return tuple(series)

        changed["dense"] = dataclasses.replace(run.dense, solution=solution)
    return dataclasses.replace(run, **changed)


def late(t):
    """Return which instants are in the second half of a run (nt, 1)."""
    return (t > 0.5 * T_END)[:, None]


def beyond(certificate):
    """Return the violations beyond their limits."""
    return {name for name, limit in certificate.limits.items() if not getattr(certificate, name) <= limit}


FAULTS = {
    "reactions of a thousandth more": ("reaction", lambda t, r: 1.001 * r, {"momentum", "tension"}),
    "reactions of a hundredth more": ("reaction", lambda t, r: 1.01 * r, {"momentum"}),
    "reactions of the other sign": ("reaction", lambda t, r: -r, {"tension", "impact_law", "complementarity"}),
    "a shift of the places": ("q", lambda t, q: q - 0.01 * late(t), {"kinematics"}),
    "places beyond the stop": ("q", lambda t, q: q + 0.2 * late(t), {"kinematics"}),
    "a drift of the places": ("q", lambda t, q: q + 1e-2 * t[:, None], {"kinematics"}),
    "more speed": ("v", lambda t, v: v * np.where(late(t), 1.01, 1.0), {"momentum"}),
    "more energy": ("v", lambda t, v: v * np.where(late(t), 1.5, 1.0), {"energy_balance", "energy_growth"}),
}


@pytest.mark.parametrize("scheme", SCHEMES)
def test_runs_without_a_fault_hold(runs, scheme):
    assert runs[scheme].certify().holds


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_planted_fault_is_found_by_its_own_law(runs, scheme, fault):
    part, change, laws = FAULTS[fault]
    assert beyond(planted(runs[scheme], part, change).certify()) & laws


@pytest.mark.parametrize("e", [0.45, 0.55])
def test_a_wrong_coefficient_of_restitution_is_found_by_the_law_of_impact(runs, e):
    other = dataclasses.replace(runs["bouncing"].problem, scheme=bouncing(e))
    assert "impact_law" in beyond(runs["bouncing"].certify(other))


def test_a_stop_that_a_body_has_passed_is_found_by_its_penetration(runs):
    """A stop 2 cm before the one at which the body turned round."""
    other = dataclasses.replace(runs["bouncing"].problem, scheme=bouncing(gap=0.03))
    assert "penetration" in beyond(runs["bouncing"].certify(other))


@pytest.mark.parametrize("rule", RULES)
def test_a_force_at_a_distance_that_holds_a_body_in_the_air_is_found(rule):
    """All forces balance, no gap changes, and no contact is closed."""
    body, stop = li.Mass("x", 1.3), li.Bumper("x", "ground", gap=1.0, e=0.5, name="R")
    resting = li.Problem("resting", li.Scheme(body, stop), t_end=0.3)
    loaded = dataclasses.replace(resting, scheme=li.Scheme(body, stop, li.Load("x", 12.0)))
    run = li.simulate(resting, RULES[rule], dt=1e-2, progress=False, error=False)
    assert run.certify().holds
    assert beyond(planted(run, "reaction", lambda t, r: r + 12.0).certify(loaded)) == {"complementarity"}
