"""Derivatives by the method event-driven: closed forms, the method exact, and differences of tight runs."""

import itertools
import math
from dataclasses import dataclass

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

import lcpimpact as li
from lcpimpact import (
    Bumper,
    Dashpot,
    Force,
    Harmonic,
    HertzSpring,
    HuntCrossley,
    KelvinVoigtStop,
    Load,
    Mass,
    NonlinearDashpot,
    PrescribedMotion,
    Problem,
    SampledForce,
    Scheme,
    Slider,
    Spring,
)
from lcpimpact.cli.main import main
from lcpimpact.integrators.event_driven import EventDriven
from lcpimpact.problems import PROBLEMS
from lcpimpact.problems.parameters import constants_of, value_at, with_values
from lcpimpact.quantities import quantity


def slopes(problem, wrt, outputs, method="event-driven", **options):
    """The derivatives, outputs by parameters."""
    return li.sensitivity(problem, wrt, outputs, method=method, **options).table[list(wrt)].to_numpy()


def by_hand(formula, *values):
    """The derivatives of a formula of several numbers by the complex step."""
    columns = []
    for j in range(len(values)):
        turned = [value + 1e-30j * (i == j) for i, value in enumerate(values)]
        columns.append(np.imag(formula(*turned)) / 1e-30)
    return np.column_stack(columns)


# ---- closed forms ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [1.5, 2.0])
def test_a_hertz_impact_on_a_wall(n):
    """The duration goes as v^((1-n)/(1+n)), the speed returns, and the peak of the force goes as K^(1/(n+1))."""
    m, K, v, gap = 2.0, 1e5, 1.0, 0.05
    problem = Problem(
        "hertz", Scheme(Mass("x", m=m), HertzSpring("x", "ground", K=K, n=n, gap=gap, name="F")), v0={"x": v}
    )

    def formula(m, K, v, gap):
        deepest = ((n + 1.0) * m * v**2 / (2.0 * K)) ** (1.0 / (n + 1.0))
        beta = math.gamma(1.0 + 1.0 / (n + 1.0)) / math.gamma(0.5 + 1.0 / (n + 1.0))
        duration = 2.0 * deepest / v * math.sqrt(math.pi) * beta
        t = gap / v
        return np.array([t, t + duration, gap + deepest, K * deepest**n, v, gap - v * (0.2 - t - duration)])

    wrt = ["Mass.m", "HertzSpring.K", "v0.x", "HertzSpring.gap"]
    outputs = ["close:1", "F.open:1", "x.max", "F.max", "open:1.speed", "x@0.2"]
    found = li.sensitivity(problem, wrt, outputs, t_end=0.22)
    assert found.method == "event-driven"
    assert_allclose(found.table["value"], formula(m, K, v, gap), rtol=1e-5)
    expected = by_hand(formula, m, K, v, gap)
    scale = np.abs(formula(m, K, v, gap))[:, None] / [m, K, v, gap]
    assert (np.abs(found.table[wrt].to_numpy() - expected) <= 1e-8 * scale).all()


@pytest.mark.parametrize("drag", ["dashpot", "force"])
def test_a_ball_that_falls_in_air(drag):
    """With the drag c v² the ball has fallen m/c ln cosh(t sqrt(g c/m))."""
    m, g, c, H, e = 0.5, 9.81, 0.2, 3.0, 0.6
    air = (
        NonlinearDashpot("x", "ground", c=c, n=2.0)
        if drag == "dashpot"
        else Force(["x"], f=lambda t, q, v: -0.2 * v * np.sqrt(v**2))
    )
    scheme = Scheme(Mass("x", m=m), Load("x", f=m * g), air, Bumper("x", "ground", gap=H, e=e, name="R"))

    def formula(m, load, c, H, e):
        t = np.arccosh(np.exp(H * c / m)) / np.sqrt(load * c) * m
        v = np.sqrt(load / c * (1.0 - np.exp(-2.0 * c * H / m)))
        # Upwards with e v: the top is at m/(2 c) ln(1 + c (e v)²/load) above the floor.
        top = m / (2.0 * c) * np.log(1.0 + c * (e * v) ** 2 / load)
        rise = m / np.sqrt(load * c) * np.arctan(e * v * np.sqrt(c / load))
        fall = np.arccosh(np.exp(top * c / m)) / np.sqrt(load * c) * m
        return np.array([t, v, (1.0 + e) * v * m, t + rise + fall])

    wrt = ["Mass.m", "Load.f", "NonlinearDashpot.c", "R.gap", "R.e"]
    expected = by_hand(formula, m, m * g, c, H, e)
    kept = [0, 1, 2, 3, 4] if drag == "dashpot" else [0, 1, 3, 4]
    outputs = ["impact:1", "impact:1.speed", "impact:1.impulse", "impact:2"]
    found = slopes(Problem("air", scheme), [wrt[j] for j in kept], outputs, t_end=1.9)
    assert_allclose(found, expected[:, kept], rtol=2e-8, atol=1e-9)


def test_a_stop_whose_force_jumps():
    """A spring with a dashpot beside it closes with the force c v, and opens where its force is zero."""
    m, k, c, v, gap = 2.0, 800.0, 9.0, 1.3, 0.04
    stop = KelvinVoigtStop("x", "ground", k=k, c=c, gap=gap, name="F")

    def formula(m, k, c, v, gap):
        a = c / (2.0 * m)
        ω = np.sqrt(k / m - a**2)
        t = (math.pi - np.arctan(2.0 * a * ω / (ω**2 - a**2))) / ω
        δ = v / ω * np.exp(-a * t) * np.sin(ω * t)
        rate = v * np.exp(-a * t) * (np.cos(ω * t) - a / ω * np.sin(ω * t))
        return np.array([gap / v, gap / v + t, -rate, gap + δ + rate * (0.3 - gap / v - t)])

    wrt = ["Mass.m", "KelvinVoigtStop.k", "KelvinVoigtStop.c", "v0.x", "KelvinVoigtStop.gap"]
    outputs = ["close:1", "open:1", "open:1.speed", "x@0.3"]
    found = slopes(Problem("stop", Scheme(Mass("x", m=m), stop), v0={"x": v}), wrt, outputs, t_end=0.31)
    assert_allclose(found, by_hand(formula, m, k, c, v, gap), rtol=1e-8, atol=3e-8)


@dataclass(frozen=True)
class Sine:
    """A load that is a function of time; equal ones are equal."""

    amplitude: float
    omega: float

    def __call__(self, t: float) -> float:
        return self.amplitude * math.sin(self.omega * t)


def pushed(amplitude: float = 3.0, omega: float = 1.7) -> Problem:
    """A mass of 2 kg under a load that is a function of time."""
    scheme = Scheme(Mass("x", m=2.0), Load("x", f=Sine(amplitude, omega)))
    return Problem("pushed", scheme, parameters={"amplitude": amplitude, "omega": omega})


def test_a_load_that_is_a_function_of_time(monkeypatch):
    monkeypatch.setitem(PROBLEMS._own, "pushed", f"{__name__}:pushed")
    found = slopes(pushed(), ["amplitude", "omega", "Mass.m"], ["x@1.3", "v_x@1.3"], t_end=2.0)

    def formula(a, ω, m):
        t = 1.3
        return np.array([a / (m * ω**2) * (ω * t - np.sin(ω * t)), a / (m * ω) * (1.0 - np.cos(ω * t))])

    assert_allclose(found, by_hand(formula, 3.0, 1.7, 2.0), rtol=1e-9)


# ---- against exact --------------------------------------------------------------------------------------------------


def sliding() -> Problem:
    scheme = Scheme(
        Mass("x", m=2.0), Spring("x", "ground", k=30.0), Slider("x", "ground", r0=1.0), Load("x", f=Harmonic(3.0, 4.0, 0.3)),
        Bumper("x", "ground", gap=0.2, e=0.6, name="R"),
    )  # fmt: skip
    return Problem("sliding", scheme, v0={"x": 1.0})


def moved() -> Problem:
    scheme = Scheme(
        Mass("x", m=1.0), PrescribedMotion("y", y=Harmonic(0.2, 3.0, 0.2)), Spring("x", "y", k=20.0),
        Slider("x", "ground", r0=0.4), Bumper("x", "ground", gap=0.15, e=0.5, name="R"),
    )  # fmt: skip
    return Problem("moved", scheme)


@pytest.mark.parametrize(
    ("problem", "wrt", "outputs", "t_end"),
    [
        (li.load_problem("system-1"), ["c_o", "k_o", "h_o"], ["open:1", "close:1", "R.max", "x@2.0", "R@0.3"], 3.0),
        (li.load_problem("system-3"), ["c_o", "k_o"], ["open:1", "R.max", "v_x@2.0"], 3.0),
        (li.load_problem("filippov"), ["f0", "depth"], ["switch:1", "slide:1", "switch:2"], 3.5),
        (
            sliding(),
            ["Mass.m", "Slider.r0", "v0.x", "Spring.k", "R.e", "R.gap"],
            ["impact:1", "x@2", "x.max", "slip:1"],
            2.5,
        ),
        (moved(), ["Mass.m", "Slider.r0", "Spring.k", "R.e", "R.gap"], ["impact:1", "impact:2.impulse", "x@1.9"], 2.0),
    ],
    ids=["system-1", "system-3", "relay", "stick-slip", "given motion"],
)
def test_agrees_with_exact(problem, wrt, outputs, t_end):
    found = slopes(problem, wrt, outputs, t_end=t_end)
    exact = slopes(problem, wrt, outputs, "exact", t_end=t_end)
    assert_allclose(found, exact, rtol=1e-6, atol=1e-9)
    assert (np.abs(found - exact) <= 1e-7 * np.abs(exact).max(axis=0)).all()


@pytest.mark.parametrize("rtol", [1e-6, 1e-9, 1e-12])
def test_the_estimated_error_is_that_to_a_closed_form(rtol):
    """Hertz's impact with m = 2 kg: δ = (5 m v²/(4 K))^(2/5), F = K δ^(3/2)."""
    ball = Scheme(Mass("x", m=2.0), HertzSpring("x", "ground", K=1e5, gap=0.1, name="F"))
    found = li.sensitivity(
        Problem("hertz", ball, v0={"x": 1.0}),
        ["HertzSpring.K", "v0.x"],
        ["F.max"],
        t_end=0.3,
        method=EventDriven(rtol=rtol),
    )
    force = 1e5 * (5.0 * 2.0 / (4.0 * 1e5)) ** 0.6
    closed = np.array([0.4 * force / 1e5, 1.2 * force])
    names = ["HertzSpring.K", "v0.x"]
    error = np.abs(found.table[names].to_numpy()[0] - closed)
    estimated = found.errors[names].to_numpy()[0]
    assert (error < 2.0 * estimated + 1e-14 * closed).all()
    assert (estimated < 20.0 * error + 1e-13 * closed).all()
    assert f"{estimated[1]:.1e}" in found.summary()
    assert li.sensitivity(li.load_problem("system-1"), ["c_o"], ["open:1"], t_end=1.0).errors is None


def test_second_derivatives_of_the_end_of_a_hertz_impact():
    """The mass leaves at gap/v + D K^(-2/5) v^(-1/5): an event of the spring, which is no impact."""
    ball = Scheme(Mass("x", m=2.0), HertzSpring("x", "ground", K=1e5, gap=0.1, name="F"))
    names = ["HertzSpring.K", "v0.x"]
    found = li.sensitivity(Problem("hertz", ball, v0={"x": 1.0}), names, ["open:1"], t_end=0.3, order=2)
    D = found.table["value"][0] - 0.1
    closed = np.array([[0.56 * D / 1e10, 0.08 * D / 1e5], [0.08 * D / 1e5, 0.2 + 0.24 * D]])
    assert_allclose(found.hessian["open:1"].to_numpy(), closed, rtol=1e-5)


def test_follows_the_tolerance():
    problem = sliding()
    wrt, outputs = ["Mass.m", "Slider.r0", "R.gap"], ["x@2", "v_x@2"]
    exact = slopes(problem, wrt, outputs, "exact", t_end=2.2)
    errors = [
        np.abs(slopes(problem, wrt, outputs, EventDriven(rtol=rtol), t_end=2.2) - exact).max() for rtol in (1e-6, 1e-11)
    ]
    assert errors[0] < 1e-3
    assert errors[1] < min(1e-8, 1e-2 * errors[0])


@pytest.mark.parametrize("method", ["exact", "event-driven"])
def test_a_sampled_force(method):
    """Its samples move with the motion, its law and its instants."""
    scheme = Scheme(
        Mass("x", m=2.0), SampledForce("x", period=0.1, phase=0.03, kp=5.0, kd=1.0, reference=0.3),
        Spring("x", "ground", k=3.0), Bumper("x", "ground", gap=1.1, e=0.5),
    )  # fmt: skip
    problem = Problem("sampled", scheme, q0={"x": 1.0}, v0={"x": 0.7})
    addresses = ["Mass.m", "SampledForce.kp", "SampledForce.kd", "SampledForce.phase", "SampledForce.period", "v0.x"]
    found = slopes(problem, addresses, ["x@1.05", "v_x@1.05"], method, t_end=1.2)
    for j, address in enumerate(addresses):
        by_differences = quotient(problem, address, ["x@1.05", "v_x@1.05"], 1e-3, "exact", t_end=1.2)
        assert_allclose(found[:, j], by_differences, rtol=2e-6)


# ---- against differences of tight runs ------------------------------------------------------------------------------


def quotient(problem, address, outputs, h, method, **options):
    """Central differences of runs, extrapolated once; None where the events change."""
    p, found, kinds = value_at(problem, address), [], set()
    for step in (h * abs(p), 0.5 * h * abs(p)):
        sides = []
        for there in (p - step, p + step):
            other = with_values(problem, {address: there})
            run = li.simulate(other, method, dt=options["t_end"] / 50, error=False, **options)
            kinds.add(tuple((event.kind, event.contact) for event in run.events))
            sides.append(np.array([float(quantity(name, other).measure(run)) for name in outputs]))
        found.append((sides[1] - sides[0]) / (2.0 * step))
    return found[1] + (found[1] - found[0]) / 3.0 if len(kinds) == 1 else None


def random_scheme(rng):
    """Masses in a row with springs, dashpots, a compliant stop before a rigid one, a slider, and forces; and their nodes."""
    nodes = ["a", "b", "c"][: int(rng.integers(1, 4))]
    ω, c = rng.uniform(1.0, 4.0), rng.uniform(1.0, 20.0)
    elements = [Mass(node, m=rng.uniform(0.5, 3.0)) for node in nodes]
    elements += [Load(nodes[0], f=lambda t: 4.0 * np.sin(ω * t) / (1.0 + t))]
    for one, other in itertools.pairwise([*nodes, "ground"]):
        elements += [Spring(one, other, k=rng.uniform(5.0, 40.0))]
        damping = rng.uniform(0.1, 1.0)
        if rng.random() < 0.6:
            elements += [NonlinearDashpot(one, other, c=damping, n=rng.uniform(1.0, 2.5))]
        else:
            elements += [Dashpot(one, other, c=damping)]
    gap, K = rng.uniform(0.05, 0.2), rng.uniform(500.0, 5000.0)
    stops = [
        HertzSpring(nodes[-1], "ground", K=K, gap=gap, name="F"),
        HuntCrossley(nodes[-1], "ground", K=K, b=rng.uniform(0.1, 1.0), gap=gap, name="F"),
        KelvinVoigtStop(nodes[-1], "ground", k=0.2 * K, c=rng.uniform(0.5, 5.0), gap=gap, name="F"),
    ]
    elements += [stops[int(rng.integers(0, 3))]]
    elements += [Bumper(nodes[-1], "ground", gap=gap + rng.uniform(0.005, 0.02), e=rng.uniform(0.3, 0.9), name="R")]
    if rng.random() < 0.6:
        elements += [Slider(nodes[0], "ground", r0=rng.uniform(0.2, 1.5))]
    if rng.random() < 0.5:
        elements += [Force([nodes[0]], f=lambda t, q, v: -c * q**3 - 0.1 * v * np.sqrt(v * v + 0.01))]
    return Problem("random", Scheme(*elements), v0={node: rng.uniform(0.5, 2.0) for node in nodes}), nodes


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 12))])
def test_random_schemes_against_differences_of_tight_runs(seed):
    rng = np.random.default_rng(seed)
    problem, nodes = random_scheme(rng)
    t_end = 0.6
    outputs = [f"{nodes[0]}@0.55", f"v_{nodes[-1]}@0.55", f"{nodes[0]}.max"]
    addresses = [str(name) for name in rng.choice(list(constants_of(problem)), 2, replace=False)]
    tight = EventDriven(rtol=1e-12)
    try:
        found = slopes(problem, addresses, outputs, t_end=t_end)
    except li.UnsupportedError as error:
        assert "together" in str(error) or "touches" in str(error) or "accumulate" in str(error)  # noqa: PT017
        return
    for j, address in enumerate(addresses):
        by_differences = quotient(problem, address, outputs, 1e-3, tight, t_end=t_end)
        if by_differences is not None:
            assert_allclose(found[:, j], by_differences, rtol=2e-6, atol=1e-7 / abs(value_at(problem, address)))


# ---- what has no derivative, and what is said -----------------------------------------------------------------------


def beside(*more):
    """The elements with a weak cubic spring, so that exact does not reach."""
    return [*more, Force(["x"], f=lambda t, q, v: -1e-3 * q**3)]


def test_what_has_no_derivative_is_refused_with_the_reason():
    fall = [Mass("x", m=1.0), Load("x", f=9.81), Bumper("x", "ground", gap=1.0, e=0.5, name="R")]
    ball = Problem("ball", Scheme(*beside(*fall)))
    with pytest.raises(li.UnsupportedError, match="accumulate"):
        slopes(ball, ["Load.f"], ["x@1.5"], t_end=2.0)
    assert np.isfinite(slopes(ball, ["Load.f"], ["x@1.0"], t_end=2.0)).all()
    wall = [Mass("x", m=1.0), Spring("x", "ground", k=4.0), Bumper("x", "ground", gap=0.5, e=0.5, name="R")]
    for speed, reason in ((1.0 + 1e-9, "only touches"), (1.0, "R .*without an event|only touches")):
        grazing = Problem("grazing", Scheme(*wall, Force(["x"], f=lambda t, q, v: 0.0 * v)), v0={"x": speed})
        with pytest.raises(li.UnsupportedError, match=reason):
            slopes(grazing, ["Spring.k"], ["x@1.0"], t_end=1.2)
    masses = [Mass("y", m=1.0), Load("y", f=9.81), Bumper("y", "ground", gap=1.0, e=0.5, name="B")]
    free = Force(["x"], f=lambda t, q, v: 0.0 * v)
    with pytest.raises(li.UnsupportedError, match="together"):
        slopes(Problem("pair", Scheme(*fall, *masses, free)), ["R.gap"], ["x@0.6"], t_end=0.7)


def test_a_spring_that_only_touches():
    """A force that grows from zero has a derivative there; the instant has none, nor has a force that jumps."""
    struck = [Mass("x", m=1.0), Spring("x", "ground", k=4.0)]
    soft = Scheme(*struck, HertzSpring("x", "ground", K=50.0, gap=0.5 - 1e-12, name="F"))
    found = slopes(Problem("soft", soft, v0={"x": 1.0}), ["v0.x"], ["x@1.0"], t_end=1.2)
    assert found == pytest.approx(0.5 * math.sin(2.0), abs=1e-4)
    hard = Scheme(*struck, KelvinVoigtStop("x", "ground", k=50.0, c=2.0, gap=0.5 - 1e-12, name="F"))
    with pytest.raises(li.UnsupportedError, match=r"F .*touches|F .*without an event"):
        slopes(Problem("hard", hard, v0={"x": 1.0}), ["v0.x"], ["x@1.0"], t_end=1.2)


def test_the_method_is_chosen_and_named():
    hertz = Problem("hertz", Scheme(Mass("x", m=2.0), HertzSpring("x", "ground", K=1e5, gap=0.1)), v0={"x": 1.0})
    assert li.sensitivity(hertz, ["v0.x"], ["x@0.05"], t_end=0.1).method == "event-driven"
    assert li.sensitivity(li.load_problem("bouncing-ball"), ["g"], ["x@0.2"], t_end=0.3).method == "exact"
    with pytest.raises(li.UnsupportedError, match=r"HertzSpring.*take method='event-driven'$"):
        slopes(hertz, ["v0.x"], ["x@0.05"], "exact", t_end=0.1)
    with pytest.raises(li.UnsupportedError, match="kinks=True"):
        slopes(hertz, ["v0.x"], ["x@0.05"], EventDriven(kinks=False), t_end=0.1)


def test_the_command_takes_the_method_and_its_tolerance(capsys, tmp_path):
    table = tmp_path / "table.csv"
    command = ["sensitivity", "bouncing-ball", "--wrt", "H", "--outputs", "impact:1", "--t-end", "0.6", "--method"]
    with pytest.raises(SystemExit) as end:
        main([*command, "event-driven", "--set", "rtol=1e-11", "--out", str(table)])
    assert end.value.code == 0
    assert "by event-driven" in capsys.readouterr().out
    assert_allclose(pd.read_csv(table)["H"], 0.5 * math.sqrt(2.0 / 9.81), rtol=1e-10)
    with pytest.raises(SystemExit) as end:
        main([*command, "moreau-jean"])
    assert end.value.code == 2
    assert "wrong numbers" in capsys.readouterr().err
