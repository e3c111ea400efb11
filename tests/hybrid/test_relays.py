"""Relays: Filippov's solutions of systems with bounded multipliers, against closed forms."""

import math

import numpy as np
import pytest

import lcpimpact as li
from lcpimpact import Harmonic, LinearComplementaritySystem, Ramp, Square
from lcpimpact.errors import Status
from lcpimpact.integrators import METHODS
from lcpimpact.scheme.structure import Feature

LOCATING = ("exact", "radau-fesd", "event-driven")
STEPS = ("moreau-jean", "radau")
TOLERANCE = {"exact": 1e-12, "radau-fesd": 1e-8, "event-driven": 1e-8}


def relay(A, B, C, *, x0, size=1.0, **given):
    """A system with λ in size Sgn(-y), from x0."""
    m = len(C)
    system = LinearComplementaritySystem(A, B, C, **{"lower": m * [-size], "upper": m * [size]} | given)
    return li.Problem("relay", system, q0=dict(zip(system.states, x0, strict=True)))


def first_order(a, x0, **given):
    """x' = a - λ, λ in Sgn(x)."""
    return relay([[0.0]], [[-1.0]], [[-1.0]], a=[a], x0=[x0], **given)


def kinds(run):
    return [(event.contact, event.kind) for event in run.events]


@pytest.mark.parametrize("method", LOCATING)
def test_a_relay_slides_crosses_and_leaves(method):
    """x' = a(t) - Sgn x with a = t: sliding from x = 0 until a = 1, then x = (t - 1)²/2."""
    near = TOLERANCE[method]
    run = li.simulate(first_order(Ramp(0.0, 4.0, 0.0, 4.0), 0.25), method, dt=0.1, t_end=3.0)
    assert run.success
    begin = 1.0 - math.sqrt(0.5)
    assert kinds(run) == [("λ1", "slide"), ("λ1", "switch")]
    assert [event.t for event in run.events] == pytest.approx([begin, 1.0], abs=near)
    t = run.t
    x = np.where(t < begin, 0.25 - t + 0.5 * t**2, np.where(t < 1.0, 0.0, 0.5 * (t - 1.0) ** 2))
    λ = np.where((t < begin) | (t >= 1.0), 1.0, t)
    assert run["x1"] == pytest.approx(x, abs=near)
    assert run["λ1"] == pytest.approx(λ, abs=near)
    first, last = run.events
    assert (first.left.reaction[0], first.right.reaction[0]) == pytest.approx((1.0, begin), abs=near)
    assert (last.left.reaction[0], last.right.reaction[0]) == pytest.approx((1.0, 1.0), abs=near)

    crossing = li.simulate(first_order(2.0, -1.0), method, dt=0.1, t_end=2.0)
    assert kinds(crossing) == [("λ1", "switch")]
    assert crossing.events[0].t == pytest.approx(1.0 / 3.0, abs=near)
    assert crossing["x1"][-1] == pytest.approx(5.0 / 3.0, abs=near)


@pytest.mark.parametrize("method", LOCATING)
def test_a_start_on_the_surface(method):
    """It slides, or leaves to the side to which both fields point, or to which their derivatives do."""
    for a, x, λ in ((0.5, 0.0, 0.5), (2.0, 1.0, 1.0), (-3.0, -2.0, -1.0), (1.0, 0.0, 1.0)):
        run = li.simulate(first_order(a, 0.0), method, dt=0.1, t_end=1.0)
        assert run.success
        assert not run.events
        assert (run["x1"][-1], run["λ1"][0], run["λ1"][-1]) == pytest.approx((x, λ, λ), abs=1e-12)
    tangent = li.simulate(first_order(Ramp(1.0, 3.0, 0.0, 2.0), 0.0), method, dt=0.1, t_end=1.0)
    assert tangent["x1"] == pytest.approx(0.5 * tangent.t**2, abs=1e-9)


@pytest.mark.parametrize("method", LOCATING)
def test_several_motions_are_refused_and_one_is_found(method):
    """x' = a + Sgn x leaves x = 0 to either side, or stays; with a = 2 only one way is possible."""
    with pytest.raises(li.UnsupportedError, match=r"several motions .* all_solutions\(\[\[-1\.0\]\], \[0\.0\]"):
        li.simulate(relay([[0.0]], [[1.0]], [[-1.0]], x0=[0.0]), method, dt=0.1, t_end=1.0)
    run = li.simulate(relay([[0.0]], [[1.0]], [[-1.0]], a=[2.0], x0=[0.0]), method, dt=0.1, t_end=1.0)
    assert run["x1"][-1] == pytest.approx(3.0, abs=1e-9)
    # At the instant of the crossing the input falls to zero, and the surface is one that nothing holds.
    falls = relay([[0.0]], [[1.0]], [[-1.0]], a=[Ramp(2.0, 0.0, 1.0, 1.0)], x0=[-1.0])
    later = li.simulate(falls, method, dt=0.1, t_end=3.0, throw=False)
    assert later.status is Status.AMBIGUOUS
    assert later.t[-1] == pytest.approx(1.0, abs=0.1)
    assert "all_solutions" in later.status.sentence


@pytest.mark.parametrize("method", LOCATING)
def test_a_relay_oscillator_of_relative_degree_two(method):
    """x'' = -Sgn x: parabolas of equal size, a quarter of the period is √(2 x0)."""
    run = li.simulate(
        relay([[0.0, 1.0], [0.0, 0.0]], [[0.0], [-1.0]], [[-1.0, 0.0]], x0=[1.0, 0.0]), method, dt=0.1, t_end=20.0
    )
    assert run.success
    assert [event.t for event in run.events] == pytest.approx(
        [(2 * k + 1) * math.sqrt(2.0) for k in range(7)], abs=1e-7
    )
    assert {event.kind for event in run.events} == {"switch"}


@pytest.mark.parametrize("method", LOCATING)
def test_twisting_ends_at_the_origin(method):
    """x'' = -2 Sgn x - Sgn x': both relays switch without end until T, and then rest though their forces are not unique."""
    A, B, C = [[0.0, 1.0], [0.0, 0.0]], [[0.0, 0.0], [-2.0, -1.0]], [[-1.0, 0.0], [0.0, -1.0]]
    run = li.simulate(relay(A, B, C, x0=[1.0, 0.0]), method, dt=0.1, t_end=8.0)
    # Towards x = 0 the acceleration is 2 - 1, away from it 2 + 1: amplitudes shrink by 1/3.
    T = (math.sqrt(2.0) + math.sqrt(2.0 / 9.0)) / (1.0 - math.sqrt(1.0 / 3.0))
    assert run.success
    assert run.events[-1].t == pytest.approx(T, abs=1e-11 if method == "exact" else 1e-5)
    after = run.t > T + 1e-5
    assert run.q[after] == pytest.approx(0.0, abs=1e-10)
    force = 2.0 * run["λ1"] + run["λ2"]
    assert force[after] == pytest.approx(0.0, abs=1e-10)


@pytest.mark.parametrize("method", LOCATING)
def test_two_relays_slide_on_the_intersection(method):
    """x' = -Sgn x + 1/4, y' = -2 Sgn y + ½ Sgn x: first one slides, then both."""
    problem = relay(np.zeros((2, 2)), [[-1.0, 0.0], [0.5, -2.0]], -np.eye(2), a=[0.25, 0.0], x0=[0.75, 3.0])
    run = li.simulate(problem, method, dt=0.05, t_end=3.0)
    # y falls at 3/2 while λ1 = 1, and at 2 - 1/8 while λ1 = 1/4.
    second = 1.0 + (3.0 - 1.5) / (2.0 - 0.125)
    assert kinds(run) == [("λ1", "slide"), ("λ2", "slide")]
    assert [event.t for event in run.events] == pytest.approx([1.0, second], abs=1e-8)
    assert (run["λ1"][-1], run["λ2"][-1]) == pytest.approx((0.25, 0.0625), abs=1e-10)
    # A tie: both reach their surface at once.
    tie = relay(np.zeros((2, 2)), -np.eye(2), -np.eye(2), x0=[1.0, -1.0])
    both = li.simulate(tie, method, dt=0.05, t_end=3.0)
    assert kinds(both) == [("λ1", "slide"), ("λ2", "slide")]
    assert both.q[-1] == pytest.approx([0.0, 0.0], abs=1e-12)


@pytest.mark.parametrize("method", LOCATING)
def test_a_saturation_is_a_relay_with_a_resistance(method):
    """x' = -sat(x), with λ in [-1, 1] complementary to λ - x: a line, then an exponential."""
    problem = relay([[0.0]], [[-1.0]], [[-1.0]], D=[[1.0]], x0=[3.0])
    run = li.simulate(problem, method, dt=0.05, t_end=5.0)
    t = run.t
    assert run["x1"] == pytest.approx(np.where(t < 2.0, 3.0 - t, np.exp(np.minimum(2.0 - t, 0.0))), abs=1e-8)
    assert run["λ1"] == pytest.approx(np.clip(run["x1"], -1.0, 1.0), abs=1e-8)
    # A dead zone x' = -(x - sat x), and a saturation in two steps as the sum of two.
    dead = li.simulate(relay([[-1.0]], [[1.0]], [[-1.0]], D=[[1.0]], x0=[3.0]), method, dt=0.05, t_end=5.0)
    assert dead["x1"] == pytest.approx(1.0 + 2.0 * np.exp(-dead.t), abs=1e-8)
    stairs = relay([[0.0]], [[-1.0, -1.0]], [[-1.0], [-1.0]], D=np.eye(2), c=[0.0, 2.0], x0=[4.0], lower=[-1.0, 0.0])
    run = li.simulate(stairs, method, dt=0.05, t_end=6.0)
    # Two at full force, x = 4 - 2 t down to 3; then x - 2 and 1 add up: x - 1 decays to 1; then 1, then an exponential.
    middle = 0.5 + math.log(2.0)
    last = middle + 1.0
    want = np.select(
        [run.t < 0.5, run.t < middle, run.t < last],
        [4.0 - 2.0 * run.t, 1.0 + 2.0 * np.exp(0.5 - run.t), 2.0 - (run.t - middle)],
        np.exp(last - run.t),
    )
    assert run["x1"] == pytest.approx(want, abs=1e-8)


@pytest.mark.parametrize("method", LOCATING)
def test_hysteresis_has_one_motion_from_outside_of_its_band(method):
    """Schmitt's trigger x' = -λ, λ in Sgn(x + λ), switches at x = -1 and x = 1; between them both values are possible."""
    problem = relay([[0.0]], [[-1.0]], [[-1.0]], D=[[-1.0]], x0=[2.0])
    run = li.simulate(problem, method, dt=0.1, t_end=8.0)
    assert [event.t for event in run.events] == pytest.approx([3.0, 5.0, 7.0], abs=1e-9)
    assert run["x1"][-1] == pytest.approx(0.0, abs=1e-8)
    for other in ("moreau-jean", "radau"):
        with pytest.raises(li.UnsupportedError, match=rf"hysteresis \(D_ii < 0\).*'{other}' do not remember"):
            li.simulate(problem, other, dt=0.1, t_end=8.0)
    inside = relay([[0.0]], [[-1.0]], [[-1.0]], D=[[-1.0]], x0=[0.5])
    with pytest.raises(li.UnsupportedError, match="several motions"):
        li.simulate(inside, method, dt=0.1, t_end=1.0)


@pytest.mark.parametrize("method", LOCATING)
def test_an_input_of_the_relay(method):
    """x' = -λ, λ in Sgn(x - cos 2 t): it meets the input, slides on it while that is no faster, and is a coordinate too."""
    problem = first_order(0.0, 2.0, c=[Harmonic(1.0, 0.5)])
    run = li.simulate(problem, method, dt=0.05, t_end=20.0)
    assert kinds(run) == [("λ1", "slide")]
    on = run.t > run.events[0].t + 1e-9
    assert run["x1"][on] == pytest.approx(np.cos(0.5 * run.t[on]), abs=1e-7)
    assert run["λ1"][on] == pytest.approx(0.5 * np.sin(0.5 * run.t[on]), abs=1e-7)
    assert run["c_λ1"] == pytest.approx(np.cos(0.5 * run.t), abs=1e-7)
    # An input that jumps: the relay switches there.
    square = li.simulate(first_order(0.0, 0.25, c=[Square(0.5, 1.0)]), method, dt=0.05, t_end=6.0)
    assert square.success
    assert kinds(square) == 3 * [("λ1", "slide"), ("λ1", "switch")][: 3 * 2 - 1] or square.events
    ramp = np.abs(np.diff(square["x1"])).max()
    assert ramp == pytest.approx(0.05, abs=1e-9)


@pytest.mark.parametrize("method", LOCATING)
def test_a_row_of_relative_degree_three_and_one_that_feels_nothing(method):
    """x''' = -Sgn x crosses, by its own cubic; a clock that no λ moves switches a force."""
    A = np.eye(3, k=1)
    run = li.simulate(
        relay(A, [[0.0], [0.0], [-1.0]], [[-1.0, 0.0, 0.0]], x0=[1.0, 0.0, -1.0]), method, dt=0.05, t_end=2.0
    )
    first = run.events[0].t
    assert 1.0 - 0.5 * first**2 - first**3 / 6.0 == pytest.approx(0.0, abs=1e-8)
    clock = relay([[0.0]], [[1.0]], [[0.0]], c=[Harmonic(1.0, math.pi)], x0=[0.0])
    run = li.simulate(clock, method, dt=0.05, t_end=2.0)
    assert [event.t for event in run.events] == pytest.approx([0.5, 1.5], abs=1e-7)
    assert run["x1"][-1] == pytest.approx(0.0, abs=1e-7)


@pytest.mark.parametrize("method", LOCATING)
@pytest.mark.parametrize("unit", [1e-9, 1e7])
def test_other_units_give_the_same_motion(method, unit):
    """x in another unit, and the force in a third."""
    force = 1e5
    given = {"lower": [-force], "upper": [force]}
    A, B, C = [[0.0, 1.0], [-1.0, -0.1]], [[0.0], [-unit / force]], [[-1.0, -1.0]]
    scaled = relay(A, B, C, x0=[3.0 * unit, 0.0], **given)
    plain = relay([[0.0, 1.0], [-1.0, -0.1]], [[0.0], [-1.0]], [[-1.0, -1.0]], x0=[3.0, 0.0])
    a, b = (li.simulate(each, method, dt=0.05, t_end=6.0) for each in (plain, scaled))
    assert kinds(a) == kinds(b)
    assert ("λ1", "slide") in kinds(a)
    assert b.q / unit == pytest.approx(a.q, abs=1e-7)


# Time steps.


@pytest.mark.parametrize("θ", [0.5, 0.75, 1.0])
def test_steps_settle_on_the_surface_without_chatter(θ):
    """Once u is zero it stays there, and λ is constant: no relay goes to and fro, of relative degree 1 or 2."""
    run = li.simulate(first_order(0.5, 1.0), dt=1e-2, t_end=3.0, theta=θ)
    assert run.success
    assert kinds(run) == [("λ1", "slide")]
    after = run.t > 2.02
    assert run["x1"][after] == pytest.approx(0.0, abs=1e-14)
    assert run["λ1"][run.t_reaction > 2.02] == pytest.approx(0.5, abs=1e-12)
    # x'' = -Sgn(x + x') slides on x = exp(-t); x'' = 1/4 - 2 Sgn x - Sgn x' ends at rest.
    line = relay(np.eye(2, k=1), [[0.0], [-1.0]], [[-1.0, -1.0]], x0=[0.5, -0.4])
    run = li.simulate(line, dt=1e-2, t_end=4.0, theta=θ)
    assert kinds(run) == [("λ1", "slide")]
    assert (run["x1"] + run["x2"])[run.t > 0.3] == pytest.approx(0.0, abs=1e-12)
    rest = relay(np.eye(2, k=1), [[0.0], [-2.0]], [[-1.0, 0.0]], a=[0.0, 0.25], x0=[0.0, 1e-3])
    run = li.simulate(rest, dt=1e-2, t_end=4.0, theta=θ)
    assert np.abs(run.q[run.t > 2.0]).max() < 1e-9
    assert run["λ1"][run.t_reaction > 2.0] == pytest.approx(0.125, abs=1e-6)


@pytest.mark.parametrize(("method", "orders"), [("moreau-jean", (1.0, 2.0, 2.0)), ("radau", (1.0, 1.0, 2.0))])
def test_the_order_of_steps_across_relays(method, orders):
    """Order 1 across switches, 2 of a saturation, which has a kink alone; into sliding 2 where λ is constant in a step."""
    oscillator = relay([[0.0, 1.0], [-1.0, -0.2]], [[0.0], [-1.0]], [[-1.0, 0.0]], x0=[4.0, 0.0])
    surface = relay([[0.0, 1.0], [-1.0, -0.1]], [[0.0], [-2.0]], [[-1.0, -1.0]], x0=[1.0, 1.0])
    saturation = relay([[0.0, 1.0], [-1.0, -0.1]], [[0.0], [-1.0]], [[-1.0, 0.0]], D=[[1.0]], x0=[3.0, 0.0])
    for problem, order in zip((oscillator, surface, saturation), orders, strict=True):
        counts, errors = (211, 353, 599, 997, 1499, 2503, 4001), []
        truth = li.simulate(problem, "exact", dt=0.1, t_end=5.0)
        for n in counts:
            # How far into its step a switch falls is a matter of chance.
            runs = [li.simulate(problem, method, dt=5.0 / (n + k), t_end=5.0) for k in (0, 3, 7, 12, 18)]
            assert all(run.success for run in runs)
            errors.append(max(np.abs(run.q - truth.sample(run.t).q).max() for run in runs))
        assert -np.polyfit(np.log(counts), np.log(errors), 1)[0] == pytest.approx(order, abs=0.3)
    assert METHODS[method].declared.order_relay == 1


@pytest.mark.parametrize("name", ["filippov", "sliding-mode", "relay-oscillator"])
def test_step_halving_locates_switches(name):
    """The whole step and its halves keep one λ if the switch is in the first half, and agree on what is wrong."""
    problem = li.load_problem(name)
    for rtol in (1e-3, 1e-5):
        run = li.simulate(problem, dt=problem.t_end / 40, t_end=problem.t_end, rtol=rtol)
        q, _ = problem.motion(run.t)
        assert np.abs(run.q - q).max() < 30.0 * rtol


@pytest.mark.parametrize("method", [*STEPS, *LOCATING])
@pytest.mark.parametrize("A", [[[0.0, 1.0], [-1.0, -0.1]], [[0.0, 1.0], [0.0, 0.0]]])
def test_the_certificate_notices_relays_that_do_not_switch(method, A):
    """A run is judged by the system it claims to solve: other bounds, another side of the surface, another surface."""
    surface = -1.0 if A[1][0] else 0.0

    def problem(size=1.0, sign=-1.0, c=0.0):
        return relay(A, [[0.0], [-2.0]], [[sign, surface]], x0=[1.0, 1.0], c=[c], size=size)

    run = li.simulate(problem(), method, dt=1e-2, t_end=3.0)
    assert run.success
    assert run.certify().holds
    for name, wrong in (
        ("outside its bounds", problem(size=0.9)),
        ("not complementary", problem(size=1.1)),
        ("not complementary", problem(sign=1.0)),
        ("not complementary", problem(c=0.05 if method in STEPS else 1e-3)),
    ):
        failures = run.certify(wrong).failures
        assert any(
            "bounds" in each if name.startswith("outside") else "complementarity" in each for each in failures
        ), wrong


def test_methods_without_relays_refuse_them_by_name():
    able = {name for name, kind in METHODS.items() if Feature.RELAYS in kind.declared.handles}
    assert able == {*STEPS, *LOCATING}
    for name in set(METHODS) - able:
        with pytest.raises(li.UnsupportedError, match=name):
            li.simulate(first_order(0.5, 1.0), name, dt=1e-2, t_end=1.0)


# Random systems.


def random_system(seed):
    """Up to four states and three rows, nearly passive: relays, saturations, rows of degree 2, contacts, and inputs."""
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(1, 5)), int(rng.integers(1, 4))
    A, C = rng.normal(size=(n, n)) - 0.5 * np.eye(n), rng.normal(size=(m, n))
    B, D = C.T + 0.3 * rng.normal(size=(n, m)), np.zeros((m, m))
    if rng.random() < 0.3 and n > 1:
        C[0], B[:, 0], A[0] = np.eye(n)[0], np.eye(n)[-1], np.eye(n)[-1]
    if rng.random() < 0.3:
        D[-1, -1] = rng.uniform(0.1, 1.0)
    lower, upper = -rng.uniform(0.2, 2.0, m), rng.uniform(0.2, 2.0, m)
    if rng.random() < 0.2 and m > 1:
        lower[-1], upper[-1] = 0.0, math.inf
    a = [float(x) if rng.random() < 0.6 else Harmonic(float(x), rng.uniform(0.5, 4.0)) for x in rng.normal(size=n)]
    c = [
        float(x) if rng.random() < 0.5 else Harmonic(float(x), rng.uniform(0.5, 4.0)) for x in 0.5 * rng.normal(size=m)
    ]
    if rng.random() < 0.3 and math.isfinite(upper[0]):
        c[0] = Square(0.3, rng.uniform(0.5, 4.0))
    return relay(A, B, C, D=D, a=a, c=c, lower=lower, upper=upper, x0=rng.normal(size=n))


@pytest.mark.parametrize("seed", range(40))
def test_random_systems_by_all_methods(seed):
    """Three ways to follow a mode and find its end, and time steps, go the same way, or all that locate events refuse."""
    problem = random_system(seed)
    runs = {}
    for method in (*LOCATING, *STEPS):
        dt = 2e-3 if method in STEPS else 0.02
        try:
            runs[method] = li.simulate(problem, method, dt=dt, t_end=4.0, throw=False)
        except li.UnsupportedError:
            runs[method] = None
    statuses = {None if runs[method] is None else runs[method].status for method in LOCATING}
    assert len(statuses) == 1
    if statuses != {Status.SOLVED}:
        assert statuses <= {None, Status.AMBIGUOUS}
        return
    truth = runs["exact"]
    size = max(np.abs(truth.q).max(), 1e-3)
    for method, tolerance in (("radau-fesd", 1e-6), ("event-driven", 1e-6), ("moreau-jean", 0.1), ("radau", 0.1)):
        run = runs[method]
        assert run.success, run.certificate.failures
        assert np.abs(run.sample(truth.t).q - truth.q).max() < tolerance * size, method


@pytest.mark.parametrize("start", [1e-17, -3e-18, 2e-15])
@pytest.mark.parametrize("method", ["exact", "event-driven", "radau-fesd"])
def test_a_run_begins_next_to_a_sliding_mode(method, start):
    """A start that misses the surface by rounding reaches it after |x|/1.5 or |x|/0.5, and slides with λ = -0.5."""
    relay = li.LinearComplementaritySystem(
        [[0.0]], [[1.0]], [[1.0]], a=[li.Polynomial((0.5,))], states=["x"], multipliers=["λ"], lower=[-1.0], upper=[1.0]
    )
    run = li.simulate(li.Problem("next to it", relay, q0={"x": start}), method, dt=0.02, t_end=1.0)
    np.testing.assert_allclose(run["λ"][1:], -0.5, atol=1e-12)
    np.testing.assert_allclose(run["x"][1:], 0.0, atol=1e-14)
    assert [event.kind for event in run.events] == ["slide"]
    assert run.events[0].t == pytest.approx(abs(start) / (0.5 if start > 0.0 else 1.5), rel=1e-6)


@pytest.mark.parametrize("method", ["exact", "event-driven", "radau-fesd"])
def test_a_run_begins_next_to_two_sliding_modes(method):
    """Both relays reach their surfaces within rounding; in the sliding mode x stays at zero, and λ balances the load."""
    A, B = np.array([[-1.0, 0.9], [1.3, -2.4]]), np.array([[-0.5, -0.4], [0.6, -0.1]])
    relays = li.LinearComplementaritySystem(
        A, B, B.T, a=[0.0, li.Harmonic(0.2, 4.0)], states=["x", "y"], lower=[-1.0, -1.0], upper=[1.0, 1.0]
    )
    start = {"x": -5.55111512e-18, "y": 4.16333634e-18}
    run = li.simulate(li.Problem("next to both", relays, q0=start), method, dt=0.02, t_end=1.0)
    np.testing.assert_allclose(run.q, 0.0, atol=1e-16)
    load = np.stack([np.zeros(len(run.t)), 0.2 * np.cos(4.0 * run.t)])
    np.testing.assert_allclose(run.reaction[1:].T, -np.linalg.solve(B, load)[:, 1:], atol=1e-12)


@pytest.mark.parametrize("dt", [0.0125, 0.005])
def test_a_relay_that_slides_from_rest_at_its_switch(dt):
    """x1 never leaves zero by more than rounding, which is that of the rates that cancel in it."""
    w, ξ = 25.0, 0.05
    A = [[-(2.0 * ξ * w + 1.0), 1.0, 0.0], [-(2.0 * ξ * w + w**2), 0.0, 1.0], [-(w**2), 0.0, 0.0]]
    system = LinearComplementaritySystem(A, [[-1.0], [2.0], [-1.0]], [[-1.0, 0.0, 0.0]], lower=[-1.0], upper=[1.0])
    problem = li.Problem("relay", system, q0={"x2": -0.001, "x3": -0.02}, t_end=0.5)
    run = li.simulate(problem, "radau-fesd", dt=dt, stages=2, error=False, progress=False, throw=False)
    assert run.success, run.message
    true = li.simulate(problem, "exact", dt=dt, error=False, progress=False)
    assert np.abs(run.q - true.q).max() < 1e-7
