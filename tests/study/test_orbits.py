"""Periodic orbits and their multipliers against closed forms and difference quotients of the exact motion."""

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from random_schemes import frictional, random_problem
from scipy.integrate import solve_ivp
from scipy.linalg import expm, null_space
from scipy.optimize import brentq

import lcpimpact as li
from lcpimpact.errors import Status
from lcpimpact.hybrid.event_loop import follow
from lcpimpact.hybrid.motion import begin, begin_problem, state_before
from lcpimpact.hybrid.system import System
from lcpimpact.hybrid.tangent import tangent
from lcpimpact.study.dynamics.grazing import least_gap
from lcpimpact.study.dynamics.shooting import force_period

ζ, ω, e = 0.05, 2.6, 0.8


def oscillator(f=1.0, omega=ω, s=0.0, e=e, zeta=ζ, x0=-0.3, **more):
    return li.load_problem("shaw-holmes", f=f, omega=omega, s=s, e=e, zeta=zeta, x0=x0, **more)


# ---- the derivative of the motion -----------------------------------------------------------------------------------


def away_from_events(motion):
    """The middle of the longest mode that others follow, and the middle of the mode a few events later."""
    joins = np.array([segment.t0 for segment in motion.segments] + [motion.end])
    if len(joins) < 4:
        return None
    k = int(np.argmax(np.diff(joins)[:-2]))
    last = min(k + 5, len(joins) - 2)
    start, end = 0.5 * (joins[k] + joins[k + 1]), 0.5 * (joins[last] + joins[last + 1])
    segment = motion.segments[k]
    A = motion.system.mode(segment.mode)[0].A
    return start, end, expm(A * (start - segment.t0)) @ segment.X


def arrive(system, X, start, end, scale):
    motion = begin(system, X, end, start, scale=scale.copy())
    if follow(motion, end) is not Status.SOLVED:
        raise li.UnsupportedError("impacts accumulate")
    return state_before(motion, end), motion


def happened(motion):
    return [(event.contact, event.kind) for segment in motion.segments[1:] for event in segment.events]


def derivative_and_quotient(problem, seed):
    """How far the derivative along a random direction is from the best central difference, and what happened meanwhile."""
    system = System(problem.dynamics, 5.0)
    long = begin_problem(problem, "exact", 5.0)
    follow(long, 5.0)
    place = away_from_events(long)
    if place is None:
        return None
    start, end, X = place
    _, motion = arrive(system, X, start, end, long.scale)
    Φ = tangent(motion, end)
    # Directions in which the start stays in its mode: signals are given, closed rows stay closed, and a slider at rest
    # that slips no further (order -1) stays at its limit, which its place u = 0 says.
    form = system.form
    free = [*range(form.constant), *range(len(form.A), len(X))]
    mode = motion.segments[0].mode
    held = [system.derivatives[j, i] for i in mode.closed for j in range(system.degree[i])]
    u = system.derivatives[0] + form.D @ system.mode(mode)[1]
    held += [u[i] for i, _ in mode.slips if mode.order[i] < 0]
    basis = null_space(np.array(held)[:, free]) if held else np.eye(len(free))
    direction = np.zeros(len(X))
    direction[free] = basis @ np.random.default_rng(seed).normal(size=basis.shape[1])
    best = math.inf
    for h in (1e-4, 1e-5, 1e-6, 1e-7):
        try:
            ahead, one = arrive(system, X + h * direction, start, end, long.scale)
            behind, other = arrive(system, X - h * direction, start, end, long.scale)
        except (li.LcpImpactError, np.linalg.LinAlgError):
            continue
        if happened(one) == happened(other) == happened(motion):
            quotient = (ahead - behind) / (2.0 * h)
            # The quotient carries the rounding of states over h, and a change may decay below it.
            size = max(np.abs(quotient).max(), 1e-5 * np.abs(direction).max(), 1e-300)
            best = min(best, np.abs(quotient - Φ @ direction).max() / size)
    return None if math.isinf(best) else (best, happened(motion))


@pytest.mark.parametrize(
    "seeds", [range(10, 24), pytest.param(range(24, 52), marks=pytest.mark.slow)], ids=["few", "many"]
)
def test_saltation_matrices_against_difference_quotients(seeds):
    kinds, compared = Counter(), 0
    for make in (random_problem, frictional):
        for seed in seeds:
            try:
                found = derivative_and_quotient(make(seed), seed)
            except (li.InputError, li.UnsupportedError, np.linalg.LinAlgError):
                continue  # refused, or at a grazing, where there is no derivative
            if found is not None:
                error, events = found
                assert error < 1e-6, (make.__name__, seed, events)
                compared += 1
                kinds.update(kind for _, kind in events)
    assert compared >= len(seeds) // 2
    assert set(kinds) == {"impact", "open", "close", "stick", "slip"}


# ---- the impact oscillator ------------------------------------------------------------------------------------------


def multipliers_by_hand(v, phase, T, f=1.0, s=0.0, e=e):
    """Of the orbit that strikes at v once in T: the free vibration, and the matrix of the impact, as derived on paper."""
    σ = math.sqrt(1.0 - ζ**2)
    S = math.exp(-ζ * T) * math.sin(σ * T) / σ
    dS = math.exp(-ζ * T) * (math.cos(σ * T) - ζ * math.sin(σ * T) / σ)
    flight = np.array([[dS + 2.0 * ζ * S, S], [-S, dS]])
    before, after = (f * math.cos(phase) - 2.0 * ζ * rate - s for rate in (v, -e * v))
    impact = np.array([[-e, 0.0], [(after + e * before) / v, -e]])
    return np.linalg.eigvals(impact @ flight)


@pytest.mark.parametrize("guess", [{"v0": {"x": -0.3}}, {"q0": {"x": -0.2}, "v0": {"x": -0.5}}])
def test_the_orbit_of_shaw_and_holmes_from_a_perturbed_guess(guess):
    orbit = li.periodic_orbit(replace(li.load_problem("impact-oscillator"), **guess))
    assert_allclose(orbit.speeds, [0.5006724925491698], rtol=0, atol=1e-13)
    assert_allclose(orbit.T, 2.0 * math.pi / ω, rtol=1e-15)
    assert orbit.residual < 1e-13
    assert orbit.stable


@pytest.mark.parametrize(("f", "omega", "s", "e"), [(1.0, 2.6, 0.0, 0.8), (1.0, 2.8, 0.0, 0.8), (1.3, 2.5, 0.1, 0.6)])
def test_multipliers_of_one_impact_a_period(f, omega, s, e):
    orbit = li.periodic_orbit(li.load_problem("impact-oscillator", f=f, omega=omega, s=s, e=e))
    (impact,) = orbit.impacts
    # The registered problem starts at an impact, with the phase of its load.
    load = next(each.f for each in orbit.problem.scheme.elements if isinstance(each, li.Load))
    by_hand = multipliers_by_hand(float(orbit.speeds[0]), omega * impact.t + load.phase, orbit.T, f, s, e)
    assert_allclose(np.sort_complex(orbit.floquet), np.sort_complex(by_hand), rtol=0, atol=1e-11)
    assert_allclose(np.prod(orbit.floquet).real, e**2 * math.exp(-2.0 * ζ * orbit.T), rtol=1e-12)
    assert orbit.stable == (np.abs(by_hand).max() < 1.0)


def test_the_monodromy_matrix_by_integration_of_the_equations():
    """DOP853, the impact by hand, and central differences: nothing of lcpimpact."""
    orbit = li.periodic_orbit(oscillator(), transient=30)

    def after_a_period(y):
        t, end, y = orbit.start, orbit.start + orbit.T, np.array(y)
        hit = lambda t, y: y[0]  # noqa: E731
        hit.terminal, hit.direction = True, 1
        while True:
            right = lambda t, y: [y[1], -2.0 * ζ * y[1] - y[0] + math.cos(ω * t)]  # noqa: E731
            found = solve_ivp(right, (t, end), y, "DOP853", rtol=1e-13, atol=1e-14, events=hit)
            if found.status == 0:
                return found.y[:, -1]
            t, y = found.t[-1], np.array([-1e-16, -e * found.y[1, -1]])

    state = orbit.sample(orbit.start)
    X, h = np.array([state.q[0, 0], state.v[0, 0]]), 1e-5
    assert_allclose(after_a_period(X), X, rtol=0, atol=1e-9)
    quotient = np.column_stack([(after_a_period(X + d) - after_a_period(X - d)) / (2.0 * h) for d in h * np.eye(2)])
    assert_allclose(orbit.monodromy, quotient, rtol=0, atol=1e-6)


def test_a_doubled_period_is_found_beside_the_orbit_that_lost_its_stability():
    once = li.periodic_orbit(oscillator(omega=2.7), transient=5)
    twice = li.periodic_orbit(oscillator(omega=2.7), periods=2, transient=60)
    assert (len(once.impacts), len(twice.impacts)) == (1, 2)
    assert once.floquet[0].real < -1.0
    assert not once.stable
    assert twice.stable
    assert_allclose(np.prod(twice.floquet).real, e**4 * math.exp(-2.0 * ζ * twice.T), rtol=1e-11)


def test_an_orbit_is_read_at_any_time():
    orbit = li.periodic_orbit(oscillator(), transient=30)
    run = li.simulate(oscillator(), "exact", dt=orbit.T, t_end=200 * orbit.T)
    t = np.linspace(190.0, 191.0, 7) * orbit.T
    here, there = run.sample(t), orbit.sample(t)
    assert_allclose(there.q, here.q, atol=1e-10)
    assert_allclose(there.v, here.v, atol=1e-10)
    (impact,) = orbit.impacts
    left, right = (orbit.sample(impact.t + 5 * orbit.T, side).v[0, 0] for side in ("left", "right"))
    assert {round(left, 6), round(right, 6)} <= {
        round(float(orbit.speeds[0]), 6),
        round(-e * float(orbit.speeds[0]), 6),
    }


# ---- other systems --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("e", "n"), [(0.5, 1), (0.3, 1), (0.8, 2)])
def test_the_table_loses_its_stability_where_holmes_says(e, n):
    """At (A ω²/g)² = (n π (1 - e)/(1 + e))² + (2 (1 + e²)/(1 + e)²)² a multiplier passes -1."""
    bound = math.hypot(n * math.pi * (1 - e) / (1 + e), 2 * (1 + e**2) / (1 + e) ** 2)
    table = 20.0 * math.pi

    def orbit(share):
        return li.periodic_orbit(
            li.load_problem("vibrating-table", e=e, n=n, A=share * bound * 9.81 / table**2), periods=n
        )

    assert_allclose(orbit(1.0).floquet[0], -1.0, rtol=0, atol=1e-8)
    assert_allclose(np.prod(orbit(1.0).floquet).real, e**2, rtol=1e-10)
    assert orbit(0.99).stable
    assert not orbit(1.01).stable


def test_orbits_without_a_force_find_their_period():
    bilinear = li.load_problem("bilinear-oscillator")
    T = bilinear.facts[0].value
    found = li.periodic_orbit(bilinear, T=1.1 * T)
    assert_allclose(found.T, T, rtol=1e-12)
    assert_allclose(np.abs(found.floquet), 1.0, rtol=0, atol=1e-7)
    assert not found.stable, "a neighbour stays a neighbour"
    assert not found.forced
    assert_allclose(np.abs(found.sample(0.0).v).max(), 1.0, rtol=1e-9)
    stop = li.periodic_orbit(li.load_problem("oscillator-stop", e=1.0), T=0.3)
    assert_allclose(stop.T, 0.1 * math.pi, rtol=1e-12)
    assert_allclose(stop.floquet, 1.0, rtol=0, atol=1e-7)
    ball = li.periodic_orbit(li.load_problem("bouncing-ball", e=1.0))
    assert_allclose(ball.T, 2.0 * math.sqrt(2.0 * ball.impacts[0].left.v[0] ** 2 / (2.0 * 9.81) / 9.81), rtol=1e-10)


def test_a_slider_that_sticks_forgets_where_it_came_from():
    problem = li.Problem(
        "stick-slip",
        li.Scheme(
            li.Mass("x", 1.0), li.Spring("x", "ground", 1.0), li.Load("x", li.Harmonic(1.0, 0.5)),
            li.Slider("x", "ground", 0.6),
        ),
    )  # fmt: skip
    orbit = li.periodic_orbit(problem, transient=20)
    assert {event.kind for event in orbit.events} == {"stick", "slip"}
    assert_allclose(orbit.floquet[-1], 0.0, rtol=0, atol=1e-12)
    assert orbit.stable
    # Two turns in a period, each of them a stop: half a period later it is the mirror image.
    t = np.linspace(0.0, 0.5, 5) * orbit.T
    assert_allclose(orbit.sample(t + 0.5 * orbit.T).q, -orbit.sample(t).q, rtol=0, atol=1e-9)


@pytest.mark.parametrize("foot", [li.KelvinVoigt("z", "ground", k=50.0, c=3.0), li.Spring("z", "ground", 50.0)])
def test_plates_without_mass(foot):
    """With a dashpot behind it the plate's place is a state, which contact ties to the body's: a multiplier is 0."""
    scheme = li.Scheme(
        li.Mass("x", 1.0), li.KelvinVoigt("x", "ground", k=20.0, c=0.5), li.Load("x", li.Harmonic(8.0, 3.0)),
        li.Bumper("x", "z", gap=0.1), foot,
    )  # fmt: skip
    orbit = li.periodic_orbit(li.Problem("plate", scheme), transient=40)
    assert {event.kind for event in orbit.events} == {"open", "close"}
    assert orbit.stable
    assert orbit.residual < 1e-12
    if isinstance(foot, li.KelvinVoigt):
        assert_allclose(orbit.floquet[-1], 0.0, rtol=0, atol=1e-10)
    else:
        assert_allclose(np.prod(orbit.floquet).real, math.exp(-0.5 * orbit.T), rtol=1e-10)


# ---- grazing, continuation, exponents -------------------------------------------------------------------------------


@pytest.mark.parametrize(("omega", "s"), [(0.8, 1.0), (2.6, 0.3), (1.3, 2.0)])
def test_the_grazing_amplitude(omega, s):
    closed_form = s * math.hypot(1.0 - omega**2, 2.0 * ζ * omega)
    touch = li.grazing(lambda f: oscillator(f, omega, s), (0.2 * closed_form, 3.0 * closed_form))
    assert_allclose(touch.value, closed_form, rtol=1e-12)
    assert touch.contact == "R"
    assert abs(touch.gap) < 1e-13
    assert_allclose(touch.orbit.sample(touch.t).q[0, 0], s, rtol=1e-12)


def test_the_grazing_frequency():
    f, s = 0.3, 1.0
    closed_form = brentq(lambda w: s * math.hypot(1.0 - w**2, 2.0 * ζ * w) - f, 0.5, 0.95, xtol=1e-15)
    touch = li.grazing(lambda w: oscillator(f, w, s), (0.5, 0.95))
    assert_allclose(touch.value, closed_form, rtol=1e-12)


def test_the_least_gap_is_that_of_the_forced_motion():
    f, s, omega = 0.3, 1.0, 0.8
    orbit = li.periodic_orbit(oscillator(f, omega, s))
    gap, contact, t = least_gap(orbit)
    G = f / math.hypot(1.0 - omega**2, 2.0 * ζ * omega)
    assert_allclose(gap, s - G, rtol=0, atol=1e-14)
    assert contact == "R"
    assert_allclose(math.cos(omega * t - math.atan2(2.0 * ζ * omega, 1.0 - omega**2)), 1.0, rtol=0, atol=1e-14)
    assert orbit.events == ()
    assert_allclose(np.abs(orbit.floquet), math.exp(-ζ * orbit.T), rtol=1e-12)


def test_a_stop_is_named_where_there_are_several():
    def between(f):
        scheme = li.Scheme(
            li.Mass("x", 1.0), li.KelvinVoigt("x", "ground", 1.0, 2.0 * ζ), li.Load("x", li.Harmonic(f, 0.8)),
            li.Bumper("x", "ground", gap=1.0, e=e, name="below"), li.Bumper("ground", "x", gap=2.0, e=e, name="above"),
        )  # fmt: skip
        return li.Problem("between", scheme)

    with pytest.raises(li.InputError, match="one of below, above"):
        li.grazing(between, (0.1, 0.5))
    with pytest.raises(li.InputError, match="did you mean 'above'"):
        li.grazing(between, (0.1, 0.5), contact="abov")
    touch = li.grazing(between, (0.1, 0.5), contact="below")
    assert_allclose(touch.value, math.hypot(1.0 - 0.8**2, 2.0 * ζ * 0.8), rtol=1e-12)
    with pytest.raises(li.InputError, match="out of reach at one end"):
        li.grazing(between, (0.1, 0.2), contact="below")


def test_a_gap_that_jumps_is_no_grazing():
    with pytest.raises(li.FailureError, match=r"the least gap of 'R' jumps at 0\.3"):
        li.grazing(lambda f: oscillator(f, 0.8, 5.0 if f < 0.3 else 0.1), (0.1, 1.0))


def test_a_branch_ends_at_the_grazing_and_says_so():
    f_star = math.hypot(1.0 - 0.8**2, 2.0 * ζ * 0.8)
    branch = li.continue_orbit(lambda f: oscillator(f, 0.8, 1.0), np.linspace(0.3, 0.5, 5))
    assert len(branch.orbits) == 2
    assert "the branch ends near 0.36" in branch.ended
    reached = float(branch.ended.split("near ")[1].split(";")[0])
    assert 0.0 < f_star - reached < 1e-3
    assert "of R at" in branch.ended
    table = branch.table
    assert table["failure"].iloc[-1] == branch.ended
    assert_allclose(table["growth"].iloc[:2], math.exp(-ζ * 2.0 * math.pi / 0.8), rtol=1e-10)
    assert_allclose(table["gap"].iloc[:2], [1.0 - 0.3 / f_star, 1.0 - 0.35 / f_star], rtol=1e-10)


def test_a_branch_goes_on_where_the_orbit_is_not_stable():
    values = np.linspace(2.6, 2.9, 7)
    branch = li.continue_orbit(lambda w: oscillator(omega=w), values, transient=30)
    assert branch.ended == ""
    for value, speed in zip(values, branch.table["speed"], strict=True):
        known = li.load_problem("impact-oscillator", omega=value).facts[0].value
        assert_allclose(speed, known, rtol=1e-10)
    assert branch.table["stable"].tolist() == [True, True, *[False] * 5]
    assert branch.table["gap"].isna().all(), "between its impacts the mass turns far from the stop, and only there"


def test_rest_is_no_orbit():
    """A free vibration dies, and a ball or a slider stays where it stops: there is nothing periodic but the rest."""
    block = li.Scheme(li.Mass("x", 1.0), li.KelvinVoigt("x", "ground", k=4.0, c=0.2))
    for problem, transient in (
        (li.Problem("damped", block, q0={"x": 1.0}, t_end=20.0), 0),
        (li.load_problem("bouncing-ball", e=0.5), 10),
        (li.load_problem("coulomb-oscillator"), 10),
    ):
        with pytest.raises(li.FailureError, match="ends at rest, which has no period"):
            li.periodic_orbit(problem, T=1.0, transient=transient)


def test_a_multiple_of_the_least_period_is_said_so():
    once, twice = (li.periodic_orbit(oscillator(), periods=number, transient=20) for number in (1, 2))
    assert (once.repeats, twice.repeats) == (1, 2)
    assert "(2 times the least period)" in twice.head()[0]
    assert li.periodic_orbit(oscillator(omega=2.7), periods=2, transient=60).repeats == 1
    spring = li.Problem(
        "spring", li.Scheme(li.Mass("x", 1.0), li.Spring("x", "ground", k=4.0)), q0={"x": 1.0}, t_end=20.0
    )
    assert li.periodic_orbit(spring, T=3.0 * math.pi).repeats == 3


def test_the_multiplier_of_a_free_phase_is_left_out():
    orbit = replace(li.periodic_orbit(oscillator(), transient=20), monodromy=np.diag([1.0, -0.5]))
    assert (orbit.growth, orbit.stable) == (1.0, False)
    free = replace(orbit, forced=False)
    assert (free.growth, free.stable) == (0.5, True)


def test_exponents_of_an_orbit_are_those_of_its_multipliers():
    orbit = li.periodic_orbit(oscillator(omega=2.65), transient=60)
    λ = li.lyapunov(oscillator(omega=2.65), t_end=450 * orbit.T, t_start=150 * orbit.T).exponents
    assert_allclose(λ.sum(), (2.0 * math.log(e) / orbit.T) - 2.0 * ζ, rtol=1e-9)
    assert_allclose(λ, np.log(np.abs(orbit.floquet)) / orbit.T, rtol=0.02)


def test_exponents_are_averaged_from_t_start_to_t_end():
    problem = oscillator(omega=2.8)
    study = li.lyapunov(problem, t_end=40.0, t_start=10.0, progress=False)
    assert study.table["t"].iloc[0] > 10.0
    assert study.table["t"].iloc[-1] == 40.0
    contraction = -0.1 + 2.0 * math.log(0.8) * (len(study.table) - 1) / 30.0
    assert study.exponents.sum() == pytest.approx(contraction, rel=1e-9)
    assert li.lyapunov(problem, progress=False).table["t"].iloc[-1] == problem.t_end
    with pytest.raises(li.InputError, match=r"t_start = 3 s must lie before t_end = 3 s"):
        li.lyapunov(problem, t_end=3.0, t_start=3.0)


def test_chaos_has_an_exponent_above_zero():
    T = 2.0 * math.pi / 2.8
    study = li.lyapunov(oscillator(omega=2.8), t_end=200 * T, t_start=50 * T)
    λ = study.exponents
    assert λ[0] > 0.05
    assert λ[1] < 0.0
    assert "exponents, chaos" in study.summary()


def test_a_shear_is_no_chaos():
    # Balls that bounce without loss part in proportion to time: the exponents are zero, and ln t/t in a run of length t.
    study = li.lyapunov(li.load_problem("bouncing-ball", e=1.0), t_end=100.0)
    assert 0.0 < study.exponents[0] < 0.1
    assert study.stretching == pytest.approx(math.log(2.0), abs=0.1)
    assert "too short a run to tell a positive exponent from zero" in study.summary()
    still = li.lyapunov(
        li.Problem("oscillator", li.Scheme(li.Mass("x", 1.0), li.Spring("x", "ground", 9.0))), t_end=10.3
    )
    assert "exponents, chaos" not in still.summary()


# ---- what is refused ------------------------------------------------------------------------------------------------


def test_the_common_period_of_forces():
    def period(*omegas):
        loads = [li.Load("x", li.Harmonic(1.0, omega)) for omega in omegas]
        return force_period(li.Scheme(li.Mass("x", 1.0), *loads).assemble())

    assert period() is None
    assert_allclose(period(3.0), 2.0 * math.pi / 3.0)
    assert_allclose(period(2.0, 3.0), 2.0 * math.pi)
    assert_allclose(period(1.5, 1.0), 4.0 * math.pi)
    with pytest.raises(li.UnsupportedError, match="no common period"):
        period(1.0, math.sqrt(2.0))


@pytest.mark.parametrize(
    ("problem", "told", "message"),
    [
        (oscillator(), {"T": 1.0}, "the period of the force"),
        (oscillator(), {"periods": 0}, "periods = 0 must be a whole number"),
        (oscillator(), {"transient": -1}, "transient = -1 must be a whole number"),
        (li.load_problem("bilinear-oscillator"), {"T": -1.0}, "T = -1.0 must be a positive finite number"),
        (li.load_problem("kelvin-voigt-impact"), {}, "shows no period"),
        (li.load_problem("hertz-impact"), {}, "non-linear springs"),
        ("oscillator", {}, "must be a Problem: get one from"),
    ],
)
def test_what_has_no_orbit_is_refused_in_one_sentence(problem, told, message):
    with pytest.raises(li.LcpImpactError, match=message) as refusal:
        li.periodic_orbit(problem, **told)
    assert "\n" not in str(refusal.value)


def test_impacts_that_accumulate_have_no_derivative():
    # The ball comes to rest on the table in each period, by infinitely many impacts, and is thrown off again.
    ball = li.load_problem("thrown-ball", e=0.3, A=1.1 * 9.81 / (20.0 * math.pi) ** 2)
    with pytest.raises(li.UnsupportedError, match=r"R only touches at t = .* \(a grazing, or the end of impacts"):
        li.periodic_orbit(ball, transient=5)


def test_two_events_at_once_have_no_derivative():
    pair = [li.Mass(n, 1.0) for n in "ab"] + [li.KelvinVoigt(n, "ground", 1.0, 0.1) for n in "ab"]
    pair += [li.Load(n, li.Harmonic(1.0, ω)) for n in "ab"] + [li.Bumper(n, "ground", e=e, name=f"R{n}") for n in "ab"]
    with pytest.raises(li.UnsupportedError, match="switch together"):
        li.periodic_orbit(li.Problem("twins", li.Scheme(*pair), q0={"a": -0.3, "b": -0.3}), transient=10)


def test_a_search_that_fails_says_how_far_it_came():
    with pytest.raises(li.FailureError, match="no periodic orbit found from this state; after 1 steps"):
        li.periodic_orbit(oscillator(x0=-2.0), max_iter=1)


@pytest.mark.parametrize(("E", "stable"), [(22.0, True), (24.4, True), (24.6, False)])
def test_the_orbit_of_a_converter_is_found_through_the_jumps_of_its_sawtooth(E, stable):
    problem = li.load_problem("buck-converter", E=E)
    orbit = li.periodic_orbit(problem)
    values = problem.parameters
    assert pytest.approx(values["T"], rel=1e-15) == orbit.T
    # Liouville: both modes have the trace -1/(R C), and a switch at a jump of the sawtooth shifts no instant
    assert np.prod(orbit.floquet) == pytest.approx(math.exp(-values["T"] / (values["R"] * values["C"])), rel=1e-9)
    assert orbit.stable == stable  # the period doubles at E = 24.52 V


def test_a_table_that_ends_before_the_search_is_refused():
    with pytest.raises(li.UnsupportedError, match="a table ends at"):
        li.periodic_orbit(li.load_problem("buck-converter", periods=2))
