"""Summaries against closed forms: those of the registry, and by hand from its parameters by momentum, work and restitution.

None of the numbers expected here is from `lcpimpact.quantities`, nor from a run.
"""

import math
from collections import Counter
from types import SimpleNamespace

import pytest

import lcpimpact as li
from lcpimpact.quantities import SUMMARY


def hard(e, speed, **more):
    """The first impact of bodies with restitution: no duration, no force."""
    return {"contact_time": 0.0, "restitution": e, "rebound_speed": e * speed} | more


def soft(m, v0, e, **more):
    """One impact on a compliant block without weight, which is unloaded at the end."""
    return {
        "impacts": 0.0,
        "restitution": e,
        "rebound_speed": e * v0,
        "impulse": m * v0 * (1.0 + e),
        "dissipated": 0.5 * m * v0**2 * (1.0 - e**2),
    } | more


def kelvin_voigt(p, f):
    """The peak is at R' = 0 of R = k x + c x' with x = v0/ω_d exp(-ζωt) sin ω_d t; the free plate relaxes from c e v0/k."""
    ω = math.sqrt(p.k / p.m)
    ζ = p.c / (2.0 * math.sqrt(p.k * p.m))
    s = math.sqrt(1.0 - ζ**2)
    left = 0.5 * (p.c * f["e"] * p.v0) ** 2 / p.k * math.exp(-2.0 * p.k / p.c * (f["t_end"] - f["t_c"]))
    known = soft(p.m, p.v0, f["e"])
    return known | {
        "peak_force": f["R_max"], "contact_time": f["t_c"], "deformation": f["x_max"],
        "peak_time": math.atan2(s * (1.0 - 4.0 * ζ**2), ζ * (3.0 - 4.0 * ζ**2)) / (s * ω),
        "dissipated": known["dissipated"] - left,
    }  # fmt: skip


def bilinear(p, f):
    """Four half periods of both springs: ∫ k_1 x dt of each is 2 k_1 v0/ω_2²."""
    square = (p.k + p.k_1) / p.m
    return {
        "peak_force": f["R_max"], "peak_time": 0.5 * f["π/ω_2"], "contact_time": f["π/ω_2"], "restitution": 1.0,
        "rebound_speed": p.v0, "impacts": 0.0, "dissipated": 0.0, "deformation": f["x_max"],
        "impulse": 4.0 * 2.0 * p.k_1 * p.v0 / square,
    }  # fmt: skip


def pi_billiard(p, f):
    """The momentum of the heavy ball is that of the balls' impacts; with the light one's it is that of the wall's."""
    between = p.M * p.v0 * (1.0 - f["V/v0"])
    light = p.m * f["v/V_m"] * p.v0 * math.sqrt(p.M / p.m)
    return hard(1.0, p.v0, impacts=f["N"], impulse=between + between - light, dissipated=0.0)


def rolling(p, f, rotation):
    """Friction takes what rolling does not keep."""
    kept = 0.5 * p.m * f["v_r"] ** 2 * (1.0 + p.k)
    return {
        "peak_force": p.m * p.g, "impulse": p.m * p.g * f["t_end"], "impacts": 0.0,
        "dissipated": 0.5 * p.m * p.v0**2 + rotation - kept,
    }  # fmt: skip


def on_belt(p, f):
    return {"peak_force": p.m * p.g, "impulse": p.m * p.g * f["t_end"], "impacts": 0.0}


def spin(p):
    return 0.5 * p.k * p.m * (p.R * p.omega0) ** 2


CLOSED_FORMS = {
    "system-1": ("exact", lambda p, f: {"peak_force": f["R_max"], "contact_time": f["t_1"], "impacts": 0.0}),
    "system-2": ("exact", lambda p, f: {"peak_force": f["R_max"], "contact_time": f["t_1"], "impacts": 0.0}),
    "system-3": ("exact", lambda p, f: {"peak_force": f["R_max"], "contact_time": f["t_1"], "impacts": 0.0}),
    "bouncing-ball": ("exact", lambda p, f: hard(
        p.e, f["v_1"], peak_force=p.m * p.g, peak_time=f["t_∞"], dissipated=p.m * p.g * p.H,
        impulse=p.m * p.g * f["t_end"])),
    "ball-in-air": ("event-driven", lambda p, f: hard(p.e, f["v_1"], peak_force=0.0, impacts=3.0)),
    "kelvin-voigt-impact": ("exact", kelvin_voigt),
    "maxwell-impact": ("exact", lambda p, f: soft(
        p.m, p.v0, f["e"], peak_force=f["R_max"], contact_time=f["t_c"])),
    "hertz-impact": ("event-driven", lambda p, f: soft(
        p.m, p.v0, 1.0, peak_force=f["F_max"], peak_time=0.5 * f["T"], contact_time=f["T"], deformation=f["δ_max"])),
    "hunt-crossley-impact": ("event-driven", lambda p, f: soft(
        p.m, p.v0, f["e"], peak_force=f["F_max"], deformation=f["δ_max"])),
    "bilinear-oscillator": ("exact", bilinear),
    "shaw-holmes": ("exact", lambda p, f: hard(p.e, f["v_1"], peak_force=0.0)),
    "impact-oscillator": ("exact", lambda p, f: hard(
        p.e, f["v⁻"], impacts=5.0, impulse=5.0 * (1.0 + p.e) * f["v⁻"], peak_force=0.0)),
    "oscillator-stop": ("exact", lambda p, f: hard(
        p.e, p.v0, impacts=10.0, impulse=p.m * p.v0 * (1.0 + p.e) * (1.0 - p.e**10) / (1.0 - p.e),
        dissipated=0.5 * p.m * p.v0**2 * (1.0 - p.e**20), peak_force=0.0)),
    "two-ball-drop": ("exact", lambda p, f: hard(p.e, f["v"], dissipated=0.0, peak_force=0.0)),
    "three-balls": ("exact", lambda p, f: hard(
        p.e, p.v0, impacts=2.0, impulse=p.m * p.v0 * (1.0 - f["v_1/v0"] + f["v_3/v0"]), dissipated=0.0)),
    "newtons-cradle": ("exact", lambda p, f: hard(
        p.e, p.v0, impacts=p.N - 1.0, impulse=(p.N - 1.0) * p.m * p.v0, dissipated=0.0)),
    "two-balls-spring": ("exact", lambda p, f: hard(
        p.e, p.g * f["t_1"], impacts=2.0, impulse=2.0 * p.m * p.g - p.m * (f["v_1(1)"] + f["v_2(1)"]),
        dissipated=0.5 * p.m * (1.0 - p.e**2) * ((p.g * f["t_1"]) ** 2 + f["v_2"] ** 2))),
    "inelastic-collapse": ("exact", lambda p, f: hard(
        p.e, p.v0, impulse=p.m * p.v0 * (1.0 - f["v/v0"] + f["v/v0"]), dissipated=0.5 * p.m * p.v0**2 * (1.0 - f["v/v0"]))),
    "pi-billiard": ("exact", pi_billiard),
    "coulomb-oscillator": ("exact", lambda p, f: {"dissipated": 0.5 * p.k * (p.x0**2 - f["x_∞"] ** 2), "impacts": 0.0}),
    "forced-coulomb-oscillator": ("exact", lambda p, f: {
        "dissipated": p.F * (10.0 * f["X"] + f["X"] - f["x(T/8)"]), "impacts": 0.0}),
    "jenkins-cycle": ("exact", lambda p, f: {"dissipated": 2.25 * f["W"], "impacts": 0.0}),
    "block-on-incline": ("exact", lambda p, f: {
        "peak_force": p.m * p.g * math.cos(p.alpha), "impulse": p.m * p.g * math.cos(p.alpha) * f["t_end"], "impacts": 0.0,
        "dissipated": 0.5 * p.m * p.v0**2 + p.m * p.g * math.sin(p.alpha) * f["s"]}),
    "block-on-belt": ("exact", on_belt),
    "stick-slip-belt": ("exact", on_belt),
    "rolling-sphere": ("exact", lambda p, f: rolling(p, f, 0.0)),
    "draw-shot": ("exact", lambda p, f: rolling(p, f, spin(p))),
    "thrown-block": ("exact", lambda p, f: hard(
        p.e, p.v_y, peak_force=p.m * p.g, peak_time=f["t_1"] / (1.0 - p.e), impulse=p.m * (p.g * f["t_end"] - p.v_y),
        dissipated=0.5 * p.m * (p.v_x**2 + p.v_y**2))),
    "spinning-ball": ("exact", lambda p, f: hard(
        p.e, p.v_y, peak_force=p.m * p.g, impulse=p.m * p.g * f["t_end"],
        dissipated=0.5 * p.m * p.v_y**2 + spin(p) - 0.5 * p.m * f["v_r"] ** 2 * (1.0 + p.k))),
    "super-ball-table": ("exact", lambda p, f: hard(
        1.0, p.v_y, impacts=3.0, impulse=6.0 * p.m * p.v_y, dissipated=0.0)),
    "vibrating-table": ("exact", lambda p, f: hard(
        p.e, f["U"], impacts=5.0, impulse=5.0 * f["P"], dissipated=2.5 * p.m * (1.0 - p.e**2) * f["U"] ** 2)),
    "plastic-ball": ("exact", lambda p, f: {
        "restitution": 0.0, "rebound_speed": 0.0, "peak_force": p.m * (p.g + p.A * p.omega**2), "peak_time": 0.0}),
    "rocking-block": ("exact", lambda p, f: hard(
        p.e, f["ω_1"], impacts=6.0, impulse=f["ω_1"] * (1.0 + p.e) * (1.0 - p.e**6) / (1.0 - p.e),
        dissipated=0.5 * f["ω_1"] ** 2 * (1.0 - p.e**12), peak_force=0.0)),
}  # fmt: skip
"""Problem to the method that solves it best, and to the summary from its parameters p and facts f, t_end among them."""


@pytest.mark.parametrize("name", CLOSED_FORMS)
def test_a_summary_is_its_closed_form(name):
    problem = li.load_problem(name)
    method, closed_form = CLOSED_FORMS[name]
    known = {fact.symbol: fact.value for fact in problem.facts} | {"t_end": problem.t_end}
    expected = closed_form(SimpleNamespace(**problem.parameters), known)
    found = li.simulate(problem, method, dt=problem.t_end / 200).summary()
    for key, value in expected.items():
        close = pytest.approx(value, rel=3e-8, abs=1e-10)
        assert found[key] == close, f"{key} of {name}"


def test_every_key_is_held_against_several_closed_forms():
    counts = Counter()
    for name, (_, closed_form) in CLOSED_FORMS.items():
        problem = li.load_problem(name)
        known = {fact.symbol: fact.value for fact in problem.facts} | {"t_end": problem.t_end}
        counts.update(list(closed_form(SimpleNamespace(**problem.parameters), known)))
    assert set(counts) == set(SUMMARY)
    assert min(counts.values()) >= 4
    assert sum(counts.values()) >= 150, counts


@pytest.mark.parametrize("name", ["kelvin-voigt-impact", "oscillator-stop", "rocking-block", "maxwell-impact"])
def test_a_summary_by_steps_approaches_its_closed_form(name):
    problem = li.load_problem(name)
    known = {fact.symbol: fact.value for fact in problem.facts} | {"t_end": problem.t_end}
    expected = CLOSED_FORMS[name][1](SimpleNamespace(**problem.parameters), known)
    found = li.simulate(problem, dt=problem.t_end / 4000).summary()
    for key, value in expected.items():
        assert found[key] == pytest.approx(value, rel=5e-3, abs=1e-9), f"{key} of {name}"


def test_without_a_force_there_is_no_instant_of_its_peak():
    ball = li.load_problem("bouncing-ball")
    for method in ("exact", "moreau-jean"):
        found = li.simulate(ball, method, dt=1e-2, t_end=0.3, progress=False).summary()
        assert found["peak_force"] == 0.0
        assert math.isnan(found["peak_time"])
    swept = li.sweep(ball, {"H": [1.0, 2.0]}, dt=1e-2, t_end=0.3, outputs=("peak_time",), certify=False, progress=False)
    assert all(math.isnan(value) for value in swept["peak_time"].values)
