"""Derivatives of outputs by parameters: public digits, closed forms by hand, and differences of exact runs."""

import itertools
import math

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

import lcpimpact as li
from lcpimpact import (
    Bumper,
    Dashpot,
    Harmonic,
    Load,
    Mass,
    Polynomial,
    PrescribedMotion,
    Problem,
    Ramp,
    Scheme,
    Slider,
    Spring,
)
from lcpimpact.cli.main import main
from lcpimpact.problems.parameters import constants_of, value_at, with_values
from lcpimpact.quantities import quantity
from lcpimpact.study.sensitivity import AT_EVENT


def slopes(problem, wrt, outputs, **options):
    """The derivatives, outputs by parameters."""
    return li.sensitivity(problem, wrt, outputs, **options).table[list(wrt)].to_numpy()


def test_published_digits_of_system_1():
    """Twenty digits from power series in balls, which contain no saltation matrix."""
    outputs = ["open:1", "close:1", "open:2", "close:2", "R.max", "x@3.0"]
    found = slopes(li.load_problem("system-1"), ["c_o", "k_o"], outputs, t_end=3.0)
    by_c = [
        -4.906878955457143804e-5, -2.984925242008713838e-3, -1.061336157023747804e-3, -7.714630799777609049e-3,
        -2.845880978171018939, -3.595882189779274228e-3,
    ]  # fmt: skip
    assert_allclose(found[:, 0], by_c, rtol=1e-12)
    assert_allclose(found[4, 1], 0.7314600589879639019, rtol=1e-12)


@pytest.mark.parametrize(
    ("name", "close", "open_", "by_c", "by_k"),
    [
        ("system-2", -7.942590299008328752e-5, -9.928684465342639921e-4, -0.4905975327660961415, 0.2050625044677061950),
        ("system-3", 7.118346909728259240e-6, -8.842067967331013966e-4, -0.6764182947279898813, 0.1486702757009160099),
    ],
)
def test_published_digits_of_systems_2_and_3(name, close, open_, by_c, by_k):
    found = slopes(li.load_problem(name), ["c_o", "k_o"], ["open:1", "close:1", "R.max"], t_end=3.0)
    assert_allclose(found[:, 0], [close, open_, by_c], rtol=1e-12)
    assert_allclose(found[2, 1], by_k, rtol=1e-12)


def test_the_bouncing_ball():
    g, H, e = 9.81, 1.0, 0.8
    T, v = math.sqrt(2.0 * H / g), math.sqrt(2.0 * g * H)
    problem = li.load_problem("bouncing-ball", e=e)
    wrt = ["H", "g", "e", "m"]
    outputs = ["impact:1", "impact:2", "impact:1.speed", "impact:2.speed", "impact:2.impulse", "x@1"]
    found = slopes(problem, wrt, outputs, t_end=1.2)
    # impact 2 at (1 + 2 e) T with e v, which leaves (1 + e) e v m.
    c = 1.0 + 2.0 * e
    s = 1.0 - T
    # x counts downwards from the start: x = H - (e v s - g s²/2) with s = 1 - T after the first impact.
    by = {"H": (0.5 * v / H, 0.5 * T / H, 1.0, 0.0), "g": (0.5 * v / g, -0.5 * T / g, 0.0, 1.0)}
    for j, p in enumerate(("H", "g")):
        dv, dT, dH, dg = by[p]
        x = dH - (e * dv * s - e * v * dT + g * s * dT - 0.5 * s**2 * dg)
        assert_allclose(found[:, j], [dT, c * dT, dv, e * dv, (1.0 + e) * e * dv, x], rtol=1e-12, atol=1e-13)
    assert_allclose(found[:, 2], [0.0, 2.0 * T, 0.0, v, (1.0 + 2.0 * e) * v, -v * s], rtol=1e-12, atol=0)
    assert_allclose(found[-1, 0], -0.386502226263, rtol=1e-11)
    # The mass has no effect but on the impulse: exactly none.
    assert found[:, 3].tolist() == [0.0, 0.0, 0.0, 0.0, found[4, 3], 0.0]
    assert_allclose(found[4, 3], (1.0 + e) * e * v, rtol=1e-13)


def test_two_equal_balls_one_at_rest():
    """The case of nimblephysics #97: the second ball takes place and speed of the first."""
    x1, x2, v1, T = -1.0, 1.0, 2.0, 1.5
    scheme = Scheme(Mass("a", m=1.0), Mass("b", m=1.0), Bumper("a", "b", gap=0.0, e=1.0, name="R"))
    problem = Problem("two-balls", scheme, q0={"a": x1, "b": x2}, v0={"a": v1, "b": 0.0})
    found = slopes(problem, ["q0.a", "q0.b", "v0.a", "v0.b"], [f"b@{T}", f"a@{T}"], t_end=T)
    assert_allclose(found, [[1.0, 0.0, T, 0.0], [0.0, 1.0, 0.0, T]], rtol=0, atol=1e-12)


def test_free_vibration():
    k, m, x0, t = 7.0, 3.0, 0.4, 2.3
    problem = Problem("vibration", Scheme(Mass("x", m=m), Spring("x", "ground", k=k)), q0={"x": x0})
    ω = math.sqrt(k / m)
    found = slopes(problem, ["Spring.k", "Mass.m", "q0.x", "v0.x"], [f"x@{t}", f"v_x@{t}"], t_end=3.0)
    dx = -x0 * t * math.sin(ω * t)
    dv = -x0 * (math.sin(ω * t) + ω * t * math.cos(ω * t))
    by_ω = np.array([dx, dv])
    assert_allclose(found[:, 0], by_ω * ω / (2.0 * k), rtol=1e-12)
    assert_allclose(found[:, 1], -by_ω * ω / (2.0 * m), rtol=1e-12)
    assert_allclose(found[:, 2], [math.cos(ω * t), -ω * math.sin(ω * t)], rtol=1e-13)
    assert_allclose(found[:, 3], [math.sin(ω * t) / ω, math.cos(ω * t)], rtol=1e-13)


def test_a_harmonic_load_by_its_amplitude_frequency_and_phase():
    a, ω, φ, t, m = 3.0, 1.7, 0.4, 1.3, 2.0
    problem = Problem("driven", Scheme(Mass("x", m=m), Load("x", f=Harmonic(a, ω, φ))))
    found = slopes(problem, ["Load.f.amplitude", "f.omega", "1.f.phase"], [f"x@{t}"], t_end=2.0)[0]
    # x = a/(m ω²) (cos φ - cos(ω t + φ) - ω t sin φ)
    shape = math.cos(φ) - math.cos(ω * t + φ) - ω * t * math.sin(φ)
    by_ω = t * math.sin(ω * t + φ) - t * math.sin(φ)
    by_φ = -math.sin(φ) + math.sin(ω * t + φ) - ω * t * math.cos(φ)
    by_hand = [shape / (m * ω**2), a / (m * ω**2) * (by_ω - 2.0 * shape / ω), a / (m * ω**2) * by_φ]
    assert_allclose(found, by_hand, rtol=1e-11)


def test_a_sum_of_signals_by_the_constants_of_its_terms():
    """A ramp, whose breakpoints move, and a polynomial; x = ∬ f/m."""
    m, t, t_0, t_1, top = 2.0, 1.3, 0.5, 1.0, 4.0
    f = Ramp(0.0, top, t_0, t_1) + Polynomial([1.0, 2.0])
    wrt = ["f.terms.0.end", "f.terms.0.t_start", "f.terms.0.t_end", "f.terms.1.coefficients.1"]
    found = li.sensitivity(Problem("driven", Scheme(Mass("x", m=m), Load("x", f=f))), wrt, [f"x@{t}"], t_end=2.0)
    # x = top ((t - t_0)³ - (t - t_1)³)/(6 m (t_1 - t_0)) + ...
    x = top * ((t - t_0) ** 3 - (t - t_1) ** 3) / (6.0 * m * (t_1 - t_0))
    by_0 = x / (t_1 - t_0) - top * (t - t_0) ** 2 / (2.0 * m * (t_1 - t_0))
    by_1 = -x / (t_1 - t_0) + top * (t - t_1) ** 2 / (2.0 * m * (t_1 - t_0))
    assert_allclose(found.table[wrt].to_numpy()[0], [x / top, by_0, by_1, t**3 / (6.0 * m)], rtol=1e-10)
    assert [found.units[name] for name in wrt] == ["N", "s", "s", "N/s"]


def test_a_motion_by_its_amplitude():
    """x'' = k (y - x), y = a cos ω t, from rest."""
    a, ω, k, t = 0.3, 2.0, 9.0, 0.7
    scheme = Scheme(Mass("x", m=1.0), Spring("x", "y", k=k), PrescribedMotion("y", Harmonic(a, ω)))
    found = slopes(Problem("moved", scheme), ["PrescribedMotion.y.amplitude"], [f"x@{t}"], t_end=1.0)
    assert_allclose(found, [[k / (k - ω**2) * (math.cos(ω * t) - math.cos(3.0 * t))]], rtol=1e-11)


def test_a_block_that_coulomb_friction_stops():
    m, r0, v0 = 2.0, 5.0, 3.0
    problem = Problem("sliding", Scheme(Mass("x", m=m), Slider("x", "ground", r0=r0)), v0={"x": v0})
    found = slopes(problem, ["Mass.m", "Slider.r0", "v0.x"], ["stick:1", "x@2"], t_end=2.0)
    t, x = m * v0 / r0, m * v0**2 / (2.0 * r0)
    assert_allclose(found, [[t / m, -t / r0, t / v0], [x / m, -x / r0, 2.0 * x / v0]], rtol=1e-12)


def test_a_relay_of_degree_2():
    a, x0 = 1.5, 0.7
    problem = li.load_problem("relay-oscillator", a=a, x0=x0)
    t = math.sqrt(2.0 * x0 / a)
    found = slopes(problem, ["a", "x0"], ["switch:1", "switch:2", "x.min"], t_end=3.5 * t)
    by_hand = [[-0.5 * t / a, 0.5 * t / x0], [-1.5 * t / a, 1.5 * t / x0], [0.0, -1.0]]
    assert_allclose(found, by_hand, rtol=1e-12, atol=1e-13)


def test_a_relay_that_slides():
    f0, s, depth = 2.0, 1.0, 1.5
    root = math.sqrt((f0 + 1.0) ** 2 - 2.0 * s * depth)
    by_f0 = (1.0 - (f0 + 1.0) / root) / s
    by_depth = 1.0 / root
    found = slopes(li.load_problem("filippov"), ["f0", "depth"], ["switch:1", "slide:1", "switch:2"], t_end=3.5)
    assert_allclose(found, [[by_f0, by_depth], [2.0 / s - by_f0, -by_depth], [1.0 / s, 0.0]], rtol=1e-12, atol=1e-13)


def test_a_bilinear_stiffness():
    m, k, k_1, v0 = 1.0, 100.0, 800.0, 1.0
    ω_1, ω_2 = math.sqrt(k / m), math.sqrt((k + k_1) / m)
    problem = li.load_problem("bilinear-oscillator")
    found = slopes(problem, ["k", "k_1", "v0"], ["open:1", "close:1", "x.max", "x.min"], t_end=0.5)
    half_1, half_2 = -0.5 * math.pi / (ω_1 * k), -0.5 * math.pi / (ω_2 * (k + k_1))
    by_hand = [
        [half_2, half_2, 0.0],
        [half_1 + half_2, half_2, 0.0],
        [-0.5 * v0 / (ω_2 * (k + k_1)), -0.5 * v0 / (ω_2 * (k + k_1)), 1.0 / ω_2],
        [0.5 * v0 / (ω_1 * k), 0.0, -1.0 / ω_1],
    ]
    assert_allclose(found, by_hand, rtol=1e-11, atol=1e-14)


def test_parameters_at_the_end_of_their_domain():
    """e = 1 and e = 0 have derivatives to one side; a plastic ball keeps the height of the floor."""
    g, H = 9.81, 1.0
    T, v = math.sqrt(2.0 * H / g), math.sqrt(2.0 * g * H)
    found = slopes(li.load_problem("bouncing-ball", e=1.0), ["e"], ["impact:2", "x@1"], t_end=1.4)
    assert_allclose(found[:, 0], [2.0 * T, -v * (1.0 - T)], rtol=1e-12)
    ball = Scheme(Mass("x", m=1.0), Load("x", f=g), Bumper("x", "ground", gap=H, e=0.0))
    rest = slopes(Problem("plastic", ball), ["Bumper.gap", "Load.f", "q0.x"], ["x@1", "R@1"], t_end=1.0)
    assert_allclose(rest, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], rtol=0, atol=1e-12)


# ---- against differences of exact runs ------------------------------------------------------------------------------


def quotient(problem, address, outputs, h, **options):
    """Central differences of exact runs, extrapolated twice, and their rounding; None where the events change."""
    p, found, kinds, largest = value_at(problem, address), [], set(), 1.0
    for step in (h, h / 2.0, h / 4.0):
        sides = []
        for there in (p - step, p + step):
            other = with_values(problem, {address: there})
            run = li.simulate(other, "exact", dt=options["t_end"] / 50, error=False, **options)
            kinds.add(tuple((event.kind, event.contact) for event in run.events))
            sides.append(np.array([float(quantity(name, other).measure(run)) for name in outputs]))
            largest = max(largest, np.abs(sides[-1]).max())
        found.append((sides[1] - sides[0]) / (2.0 * step))
    for order in (4.0, 16.0):
        found = [fine + (fine - coarse) / (order - 1.0) for coarse, fine in itertools.pairwise(found)]
    return (found[0], 1e-14 * largest / h) if len(kinds) == 1 else None


# With 15 a peak lies between an impact and the first sample after it, with 29 impacts between moving masses accumulate.
QUICK_SEEDS = (0, 1, 2, 3, 4, 15, 29)


@pytest.mark.parametrize(
    "seed", [pytest.param(seed, marks=() if seed in QUICK_SEEDS else pytest.mark.slow) for seed in range(30)]
)
def test_random_schemes_against_differences_of_exact_runs(seed):
    """Chains of masses with springs, dashpots, bumpers with restitution, and sliders."""
    rng = np.random.default_rng(seed)
    nodes = ["a", "b", "c"][: int(rng.integers(1, 4))]
    elements = [Mass(node, m=rng.uniform(0.5, 3.0)) for node in nodes]
    elements += [Load(nodes[0], f=Harmonic(rng.uniform(2.0, 6.0), rng.uniform(1.0, 4.0), rng.uniform(0.0, 3.0)))]
    for one, other in itertools.pairwise([*nodes, "ground"]):
        elements += [Spring(one, other, k=rng.uniform(5.0, 40.0)), Dashpot(one, other, c=rng.uniform(0.1, 1.0))]
    elements += [Bumper(nodes[-1], "ground", gap=rng.uniform(0.05, 0.2), e=rng.uniform(0.3, 0.9), name="R")]
    if rng.random() < 0.6:
        elements += [Slider(nodes[0], "ground", r0=rng.uniform(0.2, 1.5))]
    if len(nodes) > 1:
        elements += [Bumper(nodes[0], nodes[1], gap=rng.uniform(0.05, 0.3), e=rng.uniform(0.3, 0.9), name="N")]
    problem = Problem("random", Scheme(*elements), v0={node: rng.uniform(0.5, 2.0) for node in nodes})
    t_end = 2.0
    run = li.simulate(problem, "exact", dt=t_end / 50, t_end=t_end, error=False)
    assert run.events
    first = next((f"{e.kind}:1" for e in run.events), "")
    outputs = [f"{nodes[0]}@1.9", f"v_{nodes[-1]}@1.9", f"{nodes[0]}.max", first, f"{first}.speed"]
    addresses = [str(name) for name in rng.choice(list(constants_of(problem)), 5, replace=False)]
    try:
        found = slopes(problem, addresses, outputs, t_end=t_end)
    except li.UnsupportedError as error:
        assert "together" in str(error) or "touches" in str(error)  # noqa: PT017
        return
    compared = 0
    for j, address in enumerate(addresses):
        for h in (1e-3, 1e-4):
            by_differences = quotient(problem, address, outputs, h * abs(value_at(problem, address)), t_end=t_end)
            if by_differences is not None:
                there, rounding = by_differences
                if (np.abs(found[:, j] - there) <= 1e-8 * np.abs(there) + rounding).all():
                    break
        else:
            assert by_differences is None, (address, found[:, j], by_differences)
            continue
        compared += 1
    assert compared >= 1


# ---- what has no derivative -----------------------------------------------------------------------------------------


def test_a_plastic_impact_has_a_derivative_by_its_restitution_to_one_side_only():
    """With e > 0 the ball leaves the floor, and is at rest again soon."""
    ball = Problem("plastic", Scheme(Mass("x", m=1.0), Load("x", f=9.81), Bumper("x", "ground", gap=1.0, e=0.0)))
    with pytest.raises(
        li.UnsupportedError, match=r"Bumper\.e: with another value a contact that rests after the impact"
    ):
        slopes(ball, ["Bumper.gap", "Bumper.e"], ["x@0.6"], t_end=0.7)
    assert_allclose(slopes(ball, ["Bumper.gap", "Load.f"], ["x@0.6"], t_end=0.7), [[1.0, 0.0]], rtol=0, atol=1e-12)


def test_what_has_no_derivative_is_refused_with_the_reason():
    floors = [Bumper("a", "b", gap=0.3, e=0.4, name="R"), Bumper("b", "ground", gap=0.3, e=0.4, name="S")]
    falling = [Mass("a", m=1.0), Load("a", f=9.81), Mass("b", m=1.0), Load("b", f=9.81)]
    stack = Problem("stack", Scheme(*falling, *floors))
    with pytest.raises(li.UnsupportedError, match=r"R, S .* accumulate"):
        slopes(stack, ["R.gap"], ["a@1.5"], t_end=2.0)
    # Before the end of the impacts there is one.
    assert np.isfinite(slopes(stack, ["R.gap"], ["a@0.4"], t_end=2.0)).all()
    grazing = Problem(
        "grazing",
        Scheme(Mass("x", m=1.0), Spring("x", "ground", k=4.0), Bumper("x", "ground", gap=0.5, e=0.5)),
        v0={"x": 1.0 + 2.0**-52},
    )
    with pytest.raises(li.UnsupportedError, match="grazing"):
        slopes(grazing, ["Spring.k"], ["x@1.0"], t_end=1.2)
    touched = Problem("touched", grazing.scheme, v0={"x": 1.0})
    with pytest.raises(li.UnsupportedError, match="without an event"):
        slopes(touched, ["Spring.k"], ["x@1.0"], t_end=1.2)
    assert slopes(touched, ["v0.x"], ["x@0.7"], t_end=1.2) == pytest.approx(0.5 * math.sin(1.4), abs=1e-13)
    near = Problem("near", grazing.scheme, v0={"x": 1.0 - 1e-6})
    assert slopes(near, ["v0.x"], ["x@1.0"], t_end=1.2) == pytest.approx(0.5 * math.sin(2.0), abs=1e-13)
    masses = [Mass("a", m=1.0), Mass("b", m=1.0), Load("a", f=9.81), Load("b", f=9.81)]
    pair = Scheme(
        *masses, Bumper("a", "ground", gap=1.0, e=0.5, name="A"), Bumper("b", "ground", gap=1.0, e=0.5, name="B")
    )
    with pytest.raises(li.UnsupportedError, match="together"):
        slopes(Problem("pair", pair), ["A.gap"], ["a@0.6"], t_end=0.7)
    touching = Scheme(Mass("x", m=1.0), Load("x", f=9.81), Bumper("x", "ground", gap=0.0, e=0.0, name="R"))
    with pytest.raises(li.LcpImpactError, match=r"one-sided|penetrated"):
        slopes(Problem("touching", touching), ["R.gap"], ["x@0.5"], t_end=0.7)


@pytest.mark.parametrize("method", ["moreau-jean", "rattle-ns", "rk4", "radau-fesd"])
def test_other_methods_are_refused(method):
    with pytest.raises(li.UnsupportedError, match=f"not of runs by '{method}'.*'exact'"):
        li.sensitivity(li.load_problem("bouncing-ball"), ["g"], ["impact:1"], method=method)


@pytest.mark.parametrize(
    ("wrt", "outputs", "reason"),
    [
        (["k_x"], ["R.max"], "did you mean 'k_o'"),
        (["KelvinVoigt.name"], ["R.max"], "unknown"),
        ([], ["R.max"], "at least one"),
        (["k_o", "k_o"], ["R.max"], "each once"),
        (["k_o", "KelvinVoigt.k"], ["R.max"], "k_o sets KelvinVoigt.k, which is named too"),
        (["v0.x", "h_o"], ["R.max"], "h_o sets v0.x, which is named too"),
        (["k_o"], [], "at least one"),
        (["k_o"], ["R.mx"], "did you mean 'R.max'"),
        (["k_o"], ["R"], "is a curve"),
        (["k_o"], ["impacts"], "'impacts' is a number of events"),
        (["k_o"], ["open:9"], "has 2 events 'open'"),
        (["k_o"], ["impact:1"], "has 0 events 'impact'"),
        (["k_o"], ["x@3.5"], "after the end of the run"),
    ],
)
def test_bad_input_is_named(wrt, outputs, reason):
    with pytest.raises(li.InputError, match=reason):
        li.sensitivity(li.load_problem("system-1"), wrt, outputs, t_end=3.0)


# ---- attacks --------------------------------------------------------------------------------------------------------


def test_a_sample_at_an_event_is_that_of_the_motion_after_it_and_says_so():
    problem = li.load_problem("bouncing-ball", e=0.8, H=9.81 / 2.0)  # impact 1 at t = 1
    found = li.sensitivity(problem, ["H"], ["v_x@1", "v_x@0.5"], t_end=1.5)
    assert found.table["note"].tolist() == [AT_EVENT, ""]
    assert AT_EVENT in found.summary()
    # After the impact v = -e v_1 + g (t - t_1): at fixed t its derivative has the part -g dt_1/dH.
    v_1, t_1 = 9.81, 1.0
    H = 9.81 / 2.0
    assert_allclose(found.table["H"], [-0.8 * 0.5 * v_1 / H - 9.81 * 0.5 * t_1 / H, 0.0], rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize(("mass", "time"), [(1e6, 1.0), (1e-6, 1.0), (1.0, 1e6), (1.0, 1e-6)])
def test_relative_derivatives_know_no_units(mass, time):
    def made(mass, time):
        scheme = Scheme(
            Mass("x", m=2.0 * mass), Spring("x", "ground", k=30.0 * mass / time**2),
            Dashpot("x", "ground", c=0.5 * mass / time),
            Bumper("x", "ground", gap=0.1, e=0.7, name="R"), Slider("x", "ground", r0=0.3 * mass / time**2, name="F"),
        )  # fmt: skip
        return Problem("units", scheme, v0={"x": 1.5 / time})

    wrt = ["Mass.m", "Spring.k", "Dashpot.c", "R.gap", "R.e", "F.r0", "v0.x"]

    def relative(mass, time):
        outputs = ["impact:1", "impact:1.speed", f"x@{1.5 * time!r}", "x.min"]
        return li.sensitivity(made(mass, time), wrt, outputs, t_end=2.0 * time).relative[wrt].to_numpy()

    assert_allclose(relative(mass, time), relative(1.0, 1.0), rtol=1e-8, atol=1e-10)


def test_the_jacobian_of_curves_is_that_of_samples():
    problem = li.load_problem("system-1")
    times = [0.0, 0.3, 1.0, 1.9, 2.9]
    found = li.sensitivity(problem, ["c_o", "h_o"], [f"{s}@{t}" for t in times for s in ("x", "R")], t_end=3.0)
    curves = found.jacobian(times)
    assert curves.shape == (len(times), len(found.series), 2)
    rows = [found.series.index(s) for s in ("x", "R")]
    assert_allclose(curves[:, rows].reshape(-1, 2), found.table[["c_o", "h_o"]], rtol=1e-10, atol=1e-12)
    for bad in ([-0.1], [3.1], [math.nan], []):
        with pytest.raises(li.InputError, match="jacobian"):
            found.jacobian(bad)


def test_the_command(capsys, tmp_path):
    table = tmp_path / "table.csv"
    with pytest.raises(SystemExit) as end:
        main(
            [
                "sensitivity",
                "system-1",
                "--wrt",
                "c_o,k_o",
                "--outputs",
                "open:1,R.max",
                "--t-end",
                "3",
                "--out",
                str(table),
            ]
        )
    assert end.value.code == 0
    assert "R.max" in capsys.readouterr().out
    assert_allclose(pd.read_csv(table)["c_o"], [-4.906878955457143804e-5, -2.845880978171018939], rtol=1e-12)
    with pytest.raises(SystemExit) as end:
        main(["sensitivity", "system-1", "--wrt", "c_o", "--outputs", "open:9"])
    assert end.value.code == 2
    assert "open:9" in capsys.readouterr().err
