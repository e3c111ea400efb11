"""Stops of other tools: restitution and contact time against closed forms and DOP853, what they refuse, what they keep."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad, solve_ivp
from scipy.special import beta

import lcpimpact as li
from lcpimpact import ElastoGap, HardStop, ImpactFunction, KelvinVoigtStop, KuwabaraKono, Tsuji
from lcpimpact.certificate.certification import certify
from lcpimpact.errors import Status
from lcpimpact.integrators.moreau_jean import MoreauJean
from lcpimpact.record import Record
from lcpimpact.scheme.power_law import greatest_rebound

M, GAP = 0.7, 0.05
ENDS = ("x", "ground")


def struck(stop, v0, method="event-driven", steps=20, **options):
    """A run of a free mass that meets a stop with v0 at t = GAP/v0."""
    case = li.Problem("struck", li.Scheme(li.Mass("x", M), stop), v0={"x": v0}, t_end=GAP / v0 + 0.15)
    return li.simulate(case, method, dt=case.t_end / steps, progress=False, **options)


def outcome(run):
    """Return e, and the time from first touch to the last end of the force."""
    v0 = run.v[0, 0]
    assert run.certificate.holds
    assert [event.kind for event in run.events] == ["close", "open"] * (len(run.events) // 2)
    return -run.v[-1, 0] / v0, run.events[-1].t - run.events[0].t


# ---- the laws by hand -----------------------------------------------------------------------------------------------


def clamped(x, low, high):
    return min(max(x, low), high)


def smooth_step(δ, depth):
    z = min(δ / depth, 1.0)
    return z * z * (3.0 - 2.0 * z)


STOPS = [
    (
        ElastoGap(*ENDS, k=9e3, c=60.0, n=1.5, gap=GAP),
        lambda δ, v: 9e3 * δ**1.5 + clamped(60.0 * v, -9e3 * δ**1.5, 9e3 * δ**1.5),
    ),
    (
        ImpactFunction(*ENDS, K=6e3, c=30.0, depth=9e-3, n=1.0, gap=GAP),
        lambda δ, v: max(0.0, 6e3 * δ + 30.0 * smooth_step(δ, 9e-3) * v),
    ),
    (
        ImpactFunction(*ENDS, K=7e5, c=150.0, depth=1e-3, n=1.5, gap=GAP),
        lambda δ, v: max(0.0, 7e5 * δ**1.5 + 150.0 * smooth_step(δ, 1e-3) * v),
    ),
    (Tsuji(*ENDS, K=6e5, c=300.0, gap=GAP), lambda δ, v: max(0.0, 6e5 * δ**1.5 + 300.0 * δ**0.25 * v)),
    (Tsuji(*ENDS, K=6e5, c=300.0, pulls=True, gap=GAP), lambda δ, v: 6e5 * δ**1.5 + 300.0 * δ**0.25 * v),
    (
        KuwabaraKono(*ENDS, K=6e5, A=9e-4, gap=GAP),
        lambda δ, v: max(0.0, 6e5 * (δ**1.5 + 1.5 * 9e-4 * math.sqrt(δ) * v)),
    ),
    (
        KuwabaraKono(*ENDS, K=6e5, A=9e-4, pulls=True, gap=GAP),
        lambda δ, v: 6e5 * (δ**1.5 + 1.5 * 9e-4 * math.sqrt(δ) * v),
    ),
]
NAMES = ["elasto-gap", "impact", "impact-touches-twice", "tsuji", "tsuji-pulls", "kuwabara-kono", "kuwabara-kono-pulls"]


@pytest.mark.parametrize(("stop", "law"), STOPS, ids=NAMES)
def test_the_force_is_that_of_the_formula(stop, law):
    dynamics = li.Scheme(li.Mass("x", M), stop).assemble()
    for δ in (1e-5, 2e-4, 3e-3, 2e-2):
        for v in (-2.0, -0.3, 0.0, 0.4, 1.5):
            found = dynamics.spring_force(np.array([GAP + δ]), np.array([v]))
            assert_allclose(-found, law(δ, v), rtol=1e-9, atol=1e-10)
    assert not dynamics.spring_force(np.array([GAP - 1e-3]), np.array([3.0])).any()


def reference(law, v0):
    """Return e and the last end of the force by DOP853, which stops and starts again where the force is zero."""
    pulls = law(1e-4, -1e3) < 0.0

    def rate(t, x):
        return [x[1], -law(x[0], x[1]) / M if x[0] > 0.0 else 0.0]

    def parted(t, x):
        return x[0]

    parted.terminal, parted.direction = True, -1.0
    run = solve_ivp(
        rate, (0.0, 1.0), [0.0, v0], "DOP853", events=parted, rtol=1e-13, atol=1e-16, first_step=1e-9, dense_output=True
    )
    if pulls or law(*run.sol(run.t[-1] - 1e-6)) > 0.0:
        return -run.y[1, -1] / v0, run.t[-1]
    low, high = 1e-6, run.t[-1]
    for _ in range(200):  # the force is zero from here on
        middle = 0.5 * (low + high)
        low, high = (middle, high) if law(*run.sol(middle)) > 0.0 else (low, middle)
    return -run.y[1, -1] / v0, low


@pytest.mark.parametrize("v0", [0.25, 1.0])
@pytest.mark.parametrize(
    ("stop", "law"), [each for each in STOPS if each is not STOPS[2]], ids=[n for n in NAMES if "twice" not in n]
)
def test_restitution_and_contact_time_are_those_of_dop853(stop, law, v0):
    e, T = outcome(struck(stop, v0, rtol=1e-12))
    assert_allclose([e, T], reference(law, v0), rtol=1e-9)


def test_a_force_of_the_impact_function_begins_again_just_before_the_ends_part():
    """Where its damping falls faster than its spring the event-driven method may step over the last push."""
    stop, law = STOPS[2]
    δ, v = 1e-5, -0.34
    assert law(δ, v) > 0.0 == law(10.0 * δ, v)
    e, _ = outcome(struck(stop, 1.0, rtol=1e-12))
    assert_allclose(e, reference(law, 1.0)[0], rtol=1e-5)


# ---- closed forms ---------------------------------------------------------------------------------------------------


def angle(ζ):
    """Return arccos ζ/sqrt(1 - ζ²) and its continuation for ζ > 1."""
    return math.acos(ζ) / math.sqrt(1.0 - ζ**2) if ζ < 1.0 else math.acosh(ζ) / math.sqrt(ζ**2 - 1.0)


def elasto_gap(ζ):
    s = math.sqrt(abs(1.0 - ζ**2))
    turned = 2.0 * ζ * s / (1.0 + 2.0 * ζ**2)
    τ = 2.0 * angle(ζ) - (math.atan(turned) if ζ < 1.0 else math.atanh(turned)) / s
    return math.exp(-ζ * τ), math.atan(2.0 * math.sqrt(2.0) * ζ) / math.sqrt(2.0) + τ


LINEAR = {
    "ElastoGap": (lambda k, c: ElastoGap(*ENDS, k=k, c=c, gap=GAP), elasto_gap),
    "damped": (
        lambda k, c: HardStop(*ENDS, k=k, c=c, rebound="damped", gap=GAP),
        lambda ζ: (math.exp(-math.pi * ζ / math.sqrt(1.0 - ζ**2)), math.pi / math.sqrt(1.0 - ζ**2)),
    ),
    "undamped": (
        lambda k, c: HardStop(*ENDS, k=k, c=c, rebound="undamped", gap=GAP),
        lambda ζ: (math.exp(-ζ * angle(ζ)), angle(ζ) + 0.5 * math.pi),
    ),
    "KelvinVoigtStop": (
        lambda k, c: KelvinVoigtStop(*ENDS, k=k, c=c, gap=GAP),
        lambda ζ: (math.exp(-2.0 * ζ * angle(ζ)), 2.0 * angle(ζ)),
    ),
}


@pytest.mark.parametrize("ζ", [0.02, 0.3, 0.8, 2.5])
@pytest.mark.parametrize("name", LINEAR)
def test_linear_stops_have_their_closed_forms(name, ζ):
    if name == "damped" and ζ > 1.0:
        pytest.skip("it never parts")
    make, exact = LINEAR[name]
    k = 8e3
    ω = math.sqrt(k / M)
    e, T = outcome(struck(make(k, 2.0 * ζ * math.sqrt(k * M)), 1.3, rtol=1e-12))
    assert_allclose([e, T * ω], exact(ζ), rtol=1e-9)


@pytest.mark.parametrize("n", [1.5, 2.0])
@pytest.mark.parametrize("pulls", [False, True])
def test_tsujis_law_is_a_linear_oscillator_in_disguise(n, pulls):
    K, c, v0 = 6e5, 250.0, 0.8
    ω = math.sqrt(0.5 * (n + 1.0) * K / M)
    ζ = c / (2.0 * M * ω)
    assert_allclose(ζ, c / math.sqrt(2.0 * (n + 1.0) * K * M))
    s = math.sqrt(1.0 - ζ**2)
    end = (math.pi if pulls else 2.0 * math.acos(ζ)) / s

    def y(τ):  # dy/dτ at the start is (n + 1)/2 v0
        return 0.5 * (n + 1.0) * v0 * math.exp(-ζ * τ) * math.sin(s * τ) / (s * ω)

    power = (n - 1.0) / (n + 1.0)
    # T = ∫ y^-power dτ is singular where y is zero: u^(1/(1-power)) from that end takes it away.
    parts = [(0.0, 1.0, 0.5 * end), (end, -1.0, 0.5 * end)]
    q = 1.0 / (1.0 - power)
    T = 0.0
    for at, way, length in parts:

        def slowness(u, at=at, way=way):
            return q * u ** (q - 1.0) * y(at + way * u**q) ** -power

        T += quad(slowness, 0.0, length ** (1.0 / q), epsrel=1e-12)[0] / ω
    e, found = outcome(struck(Tsuji(*ENDS, K=K, c=c, n=n, pulls=pulls, gap=GAP), v0, rtol=1e-12))
    assert_allclose([e, found], [math.exp(-ζ * end), T], rtol=1e-9)


def test_the_polynomial_of_tsuji_counts_the_mass_of_one_of_two_equal_spheres():
    """α(e) as LAMMPS prints it is that of the closed form for α² m = 2 α² m_eff: α/sqrt(2), to 1.3e-3."""
    coefficients = [1.2728, -4.2783, 11.087, -22.348, 27.467, -18.022, 4.8218]
    for e in np.linspace(0.1, 1.0, 19):
        α = -math.sqrt(5.0) * math.log(e) / math.hypot(math.pi, math.log(e))
        assert abs(np.polyval(coefficients[::-1], e) - α / math.sqrt(2.0)) < 1.3e-3 * (1.0 + 10.0 * (e < 0.3))


def test_kuwabara_and_konos_restitution_begins_with_the_known_term():
    K, v0 = 6e5, 1.0
    a = 1.2 * 1.25**0.6 * beta(0.6, 1.5)
    assert_allclose(a, 1.5 * 1.15344, rtol=1e-5)
    for A in (1e-5, 1e-4):
        e, _ = outcome(struck(KuwabaraKono(*ENDS, K=K, A=A, pulls=True, gap=GAP), v0, rtol=1e-12))
        x = a * A * (K / M) ** 0.4 * v0**0.2
        assert abs(1.0 - e - x) < x * x


# ---- as other elements ----------------------------------------------------------------------------------------------


EVERY = [stop for stop, _ in STOPS] + [make(8e3, 40.0) for make, _ in LINEAR.values()]


@pytest.mark.parametrize("stop", EVERY, ids=[*NAMES, *LINEAR])
def test_moreau_jean_tends_to_them(stop):
    e, _ = outcome(struck(stop, 1.0, rtol=1e-10))
    coarse, fine = (struck(stop, 1.0, "moreau-jean", steps) for steps in (1_000, 8_000))
    assert coarse.certificate.holds
    assert fine.certificate.holds
    errors = [abs(-run.v[-1, 0] - e) for run in (coarse, fine)]
    assert errors[1] < 2e-4
    assert errors[1] < 0.3 * errors[0] or errors[0] < 1e-5


@pytest.mark.parametrize("stop", EVERY, ids=[*NAMES, *LINEAR])
def test_a_scheme_file_keeps_them(stop, tmp_path):
    scheme = li.Scheme(li.Mass("x", M), replace(stop, name="S"))
    path = li.write_scheme_file(li.Problem("stop", scheme), tmp_path / "stop.toml")
    assert li.read_scheme_file(path).problem.scheme.elements[1] == scheme.elements[1]


@pytest.mark.parametrize(
    ("kind", "given", "says"),
    [
        (ElastoGap, {"k": 1.0}, "c is missing; give a number in N s/m"),
        (ElastoGap, {"k": 0.0, "c": 1.0}, "k = 0.0 must be"),
        (ElastoGap, {"k": 1.0, "c": 1.0, "n": 0.5}, "n = 0.5 must be"),
        (HardStop, {"k": 1.0, "c": 1.0}, "rebound is missing; give 'damped' or 'undamped'"),
        (HardStop, {"k": 1.0, "c": 1.0, "rebound": "dampd"}, "'damped'"),
        (ImpactFunction, {"K": 1.0, "c": 1.0, "n": 1.5}, "depth is missing"),
        (ImpactFunction, {"K": 1.0, "c": 1.0, "depth": 0.0, "n": 1.5}, "depth = 0.0 must be"),
        (ImpactFunction, {"K": 1.0, "c": 1.0, "depth": 1.0}, "n is missing"),
        (Tsuji, {"K": 1.0}, "c is missing"),
        (Tsuji, {"K": 1.0, "c": 1.0, "pulls": "yes"}, "pulls = 'yes' must be true or false"),
        (KuwabaraKono, {"K": 1.0}, "A is missing; give a number in s"),
        (KuwabaraKono, {"K": 1.0, "A": -1.0}, "A = -1.0 must be"),
    ],
)
def test_what_is_missing_or_wrong_is_refused(kind, given, says):
    with pytest.raises(li.InputError) as caught:
        kind(*ENDS, **given)
    assert says in str(caught.value)


def test_a_ball_that_stays_in_contact_rests_on_its_static_sag():
    for stop in (ElastoGap(*ENDS, k=1e4, c=60.0), HardStop(*ENDS, k=1e4, c=60.0, rebound="undamped")):
        ball = li.Scheme(li.Mass("x", 1.0), li.Load("x", 9.81), stop)
        run = li.simulate(li.Problem("ball", ball, v0={"x": 1.0}), "event-driven", dt=0.05, t_end=4.0, progress=False)
        assert_allclose(run.q[-1, 0], 9.81e-4, rtol=1e-3)
        assert run.certificate.holds


def test_the_bouncing_mass_of_exudyn_depends_on_whether_the_contact_pulls():
    """Its contactCoordinateTest, k g + d g' in contact, tends to 0.0556746 with its step; a push alone gives 0.0547888."""
    damped = HardStop(*ENDS, k=2e6, c=200.0, rebound="damped", gap=0.05)
    for stop, y in ((damped, 0.0556744531), (KelvinVoigtStop(*ENDS, k=2e6, c=200.0, gap=0.05), 0.0547887506579)):
        ball = li.Problem("ball", li.Scheme(li.Mass("x", 0.25), li.Load("x", 0.25 * 9.81), stop))
        run = li.simulate(ball, "event-driven", dt=0.05, t_end=0.25, rtol=1e-11, progress=False)
        assert_allclose(0.1 - run.q[-1, 0], y, rtol=1e-9)


# ---- the bound by which a blow within one step is judged ---------------------------------------------------------------


@pytest.mark.parametrize("v0", [0.25, 1.0])
@pytest.mark.parametrize(("stop", "law"), STOPS, ids=NAMES)
def test_the_greatest_rebound_is_above_that_of_dop853_and_close_to_it(stop, law, v0):
    row = li.Scheme(li.Mass("x", M), stop).assemble().power_laws[0]
    e, _ = reference(law, v0)
    assert e <= greatest_rebound(row, -1e-3, v0, 1.0 / M) / v0 <= e + 0.01


@pytest.mark.parametrize("ζ", [0.1, 0.5, 3.0, 30.0, 3000.0])
def test_the_greatest_rebound_is_close_for_weak_and_strong_dashpots(ζ):
    k = 9e3
    for kind, e in (
        ("undamped", rebound_undamped(ζ)),
        ("damped", math.exp(-math.pi * ζ / math.sqrt(1.0 - ζ * ζ)) if ζ < 1.0 else 0.0),
    ):
        stop = HardStop(*ENDS, k=k, c=2.0 * ζ * math.sqrt(k * M), rebound=kind)
        row = li.Scheme(li.Mass("x", M), stop).assemble().power_laws[0]
        assert e <= greatest_rebound(row, 0.0, 0.7, 1.0 / M) / 0.7 <= e + 0.01


def rebound_undamped(ζ):
    """Return e of a stop whose dashpot acts in the approach alone: exp(-ζ arccos(ζ)/σ)."""
    if ζ < 1.0:
        return math.exp(-ζ * math.acos(ζ) / math.sqrt(1.0 - ζ * ζ))
    return math.exp(-ζ * math.acosh(ζ) / math.sqrt(ζ * ζ - 1.0))


def test_the_greatest_rebound_holds_the_energy_of_a_spring_pressed_already_and_ends_for_any_damping():
    k, δ, v = 9e3, 2e-3, 0.4
    row = li.Scheme(li.Mass("x", M), KelvinVoigtStop(*ENDS, k=k, c=0.0)).assemble().power_laws[0].copy()
    assert_allclose(greatest_rebound(row, δ, v, 1.0 / M), math.sqrt(v * v + k * δ * δ / M), rtol=1e-12)
    row[4] = 1e30
    assert 0.0 <= greatest_rebound(row, δ, v, 1.0 / M) <= 0.05


# ---- blows that begin and end within one step -------------------------------------------------------------------------


def hard(upper, lower, ζ, gap=0.0, m=1.0):
    """A stop of ω = 316/s for a mass m, whose dashpot acts in the approach alone."""
    return HardStop(upper, lower, k=1e5 * m, c=2.0 * ζ * math.sqrt(1e5) * m, rebound="undamped", gap=gap)


def thrown(*elements, h, t_end=0.6, **start):
    case = li.Problem("thrown", li.Scheme(*elements), **start, t_end=t_end)
    return li.simulate(case, "moreau-jean", dt=h, throw=False, error=False, progress=False)


@pytest.mark.parametrize("h", [6e-2, 1e-2, 1e-3, 1e-4])
@pytest.mark.parametrize("ζ", [1.0, 3.0, 30.0, 300.0])
def test_moreau_jean_throws_no_body_off_a_stop_that_holds(h, ζ):
    """Steps of 0.1 ms resolve ζ = 1, and those of 60 ms nothing: the body meets the stop in the midst of them."""
    run = thrown(li.Mass("x", 1.0), hard("x", "ground", ζ), h=h, q0={"x": -0.01}, v0={"x": 1.0})
    e = math.exp(-1.0) if ζ == 1.0 else rebound_undamped(ζ)
    assert run.success, run.message
    assert abs(-run["v_x"][-1] - e) <= 0.03
    assert -run["v_x"].min() <= e + 0.03


@pytest.mark.parametrize(("stop", "law"), STOPS, ids=NAMES)
def test_no_law_is_thrown_off_where_its_damping_is_strong(stop, law):
    """With fifty times the damping e is below 0.01; with steps of 10 ms some threw back 0.99."""
    strong = replace(stop, **{name: 50.0 * getattr(stop, name) for name in ("c", "A") if hasattr(stop, name)})
    run = thrown(li.Mass("x", M), strong, h=1e-2, v0={"x": 1.0})
    assert run.success, run.message
    assert -run["v_x"].min() <= 0.12


def test_two_blows_of_different_laws_end_in_one_step():
    """Bodies on their own, and two that meet: these part with e of their relative velocity, as their centre goes on."""
    apart = li.Mass("x", 1.0), hard("x", "ground", 3.0), li.Mass("y", 2.0), hard("y", "ground", 1.0, m=2.0)
    run = thrown(*apart, h=1e-2, v0={"x": 1.0, "y": 1.0})
    assert run.success, run.message
    assert_allclose(run.v[1], [-rebound_undamped(3.0), -math.exp(-1.0)], atol=0.02)
    both = li.Mass("x", 1.0), li.Mass("y", 3.0), hard("x", "y", 3.0, m=0.75)
    run = thrown(*both, h=1e-2, v0={"x": 1.0})
    assert run.success, run.message
    assert_allclose(run["v_y"][1] - run["v_x"][1], rebound_undamped(3.0), atol=0.02)
    assert_allclose(run.v @ [1.0, 3.0], 1.0, rtol=1e-12)


def test_a_row_of_bodies_between_strong_stops():
    """A middle body that meets both its neighbours at once, by laws of different e, and a wall behind them."""
    row = [li.Mass(x, m) for x, m in (("a", 1.0), ("b", 2.0), ("c", 1.5))]
    stops = hard("a", "b", 30.0), hard("b", "c", 3.0), hard("c", "ground", 3.0, gap=0.05)
    case = {"v0": {"a": 2.0, "b": 1.0}, "t_end": 0.2}
    fine = thrown(*row, *stops, h=2e-6, **case)
    for h in (1e-3, 1e-2):
        run = thrown(*row, *stops, h=h, **case)
        assert run.success, run.message
        assert np.abs(run.v[-1] - fine.v[-1]).max() <= 0.2


def test_what_ends_a_blow_stands_in_the_ledger_and_no_other_weight_is_explained():
    run = thrown(li.Mass("x", 1.0), hard("x", "ground", 30.0), h=1e-2, v0={"x": 1.0})
    ledger = li.energy_ledger(run)
    assert ledger.balance <= 1e-3
    d, early = run.problem.dynamics, run.q.copy()
    early[1:] -= 0.002  # as if the weight had been another
    record = Record(run.t, early, run.v, run.t_reaction, run.reaction)
    planted = certify(d, (early[0], run.v[0]), record, None, run.events, run.integrator)
    assert any("coordinates and velocities differ" in each for each in planted.failures)


def test_a_step_that_resolves_a_blow_keeps_its_bits(monkeypatch):
    here = li.Mass("x", 1.0), hard("x", "ground", 0.3)
    found = thrown(*here, h=1e-4, t_end=0.05, v0={"x": 1.0})
    monkeypatch.setattr(MoreauJean, "stopping_contacts", lambda self, d, h: None)
    assert found.q.tobytes() == thrown(*here, h=1e-4, t_end=0.05, v0={"x": 1.0}).q.tobytes()


def test_steps_that_throw_are_no_solution(monkeypatch):
    monkeypatch.setattr(MoreauJean, "stopping_contacts", lambda self, d, h: None)
    run = thrown(li.Mass("x", 1.0), hard("x", "ground", 30.0), h=1e-2, v0={"x": 1.0})
    assert -run["v_x"].min() > 0.9
    assert run.status is Status.VIOLATED


@pytest.mark.parametrize("amplitude", [0.0, 0.02])
@pytest.mark.parametrize("h", [1e-3, 1e-2])
def test_a_wall_that_moves_throws_no_body_off_either(amplitude, h, monkeypatch):
    wall = li.PrescribedMotion("w", li.Harmonic(amplitude, 7.0))
    here = li.Mass("x", 1.0), li.Load("x", 9.81), wall, hard("x", "w", 30.0)
    case = li.Problem("table", li.Scheme(*here), q0={"x": -0.1}, t_end=0.3)
    true = li.simulate(case, "event-driven", dt=1e-3, rtol=1e-9, error=False, progress=False)
    run = thrown(*here, h=h, t_end=0.3, q0={"x": -0.1})
    assert run.success, run.message
    assert abs(run["v_x"].min() - true["v_x"].min()) <= 0.06
    monkeypatch.setattr(MoreauJean, "stopping_contacts", lambda self, d, h: None)
    assert not thrown(*here, h=h, t_end=0.3, q0={"x": -0.1}).success


@pytest.mark.parametrize("h", [1e-3, 1e-2])
@pytest.mark.parametrize("c", [1e3, 1e6])
def test_a_stop_before_a_plate_on_a_dashpot_throws_no_body_off(h, c, monkeypatch):
    """The plate gives way and takes more: the body is slower than from a stop on the ground, whose e is 3e-4."""
    here = li.Mass("x", 1.0), KelvinVoigtStop("x", "z", k=1e5, c=60.0 * math.sqrt(1e5)), li.Dashpot("z", "ground", c=c)
    run = thrown(*here, h=h, t_end=0.2, q0={"x": -0.01}, v0={"x": 1.0})
    assert run.success, run.message
    assert -run["v_x"].min() <= 0.09
    monkeypatch.setattr(MoreauJean, "stopping_contacts", lambda self, d, h: None)
    if c * h > 1e2:
        assert not thrown(*here, h=h, t_end=0.2, q0={"x": -0.01}, v0={"x": 1.0}).success


# ---- Zener's plate ----------------------------------------------------------------------------------------------------


def on_a_plate(λ, v0, method="event-driven", steps=20, **options):
    """Return the run of a ball on a plate: Hertz's spring and a dashpot in a row, by Zener's number."""
    K = 6e5
    T = (M / K) ** 0.4 * v0**-0.2
    plate = li.HertzSpring("x", "plate", K, gap=GAP), li.Dashpot("plate", "ground", c=M / (λ * T))
    t_end = GAP / v0 + 10.0 * T
    case = li.Problem("plate", li.Scheme(li.Mass("x", M), *plate), v0={"x": v0}, t_end=t_end)
    return li.simulate(case, method, dt=t_end / steps, progress=False, **options), T


@pytest.mark.parametrize("v0", [0.3, 1.0])
@pytest.mark.parametrize("λ", [0.01, 0.1, 0.5, 2.0])
def test_zeners_plate_is_a_spring_and_a_dashpot_in_a_row(λ, v0):
    """σ'' + (1 + λ d/dτ) σ^(3/2) = 0 from σ' = 1, by DOP853; σ is the compression, and σ' that of x where it ends."""

    def rate(τ, state):
        s = max(state[0], 0.0)
        return [state[1], -(s**1.5) - 1.5 * λ * math.sqrt(s) * state[1]]

    def parted(τ, state):
        return state[0]

    parted.terminal, parted.direction = True, -1.0
    by_hand = solve_ivp(
        rate, (0.0, 100.0), [0.0, 1.0], "DOP853", events=parted, rtol=1e-13, atol=1e-16, first_step=1e-9
    )
    run, T = on_a_plate(λ, v0, rtol=1e-12)
    e, duration = outcome(run)
    assert_allclose([e, duration / T], [-by_hand.y[1, -1], by_hand.t[-1]], rtol=1e-9)
    assert run["plate"][-1] > 0.0
    coarse, fine = (on_a_plate(λ, v0, "moreau-jean", steps)[0] for steps in (1_000, 4_000))
    errors = [abs(-each.v[-1, 0] / v0 - e) for each in (coarse, fine)]
    assert errors[1] < 1e-5
    assert errors[1] < 0.3 * errors[0] or errors[0] < 1e-6
