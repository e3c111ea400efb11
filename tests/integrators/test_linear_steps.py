"""The methods whose step is linear: each against its own formulas by hand, closed forms and the exact solution."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

import lcpimpact as li
from lcpimpact.integrators import METHODS
from lcpimpact.integrators.stepping.linear_step import LinearStep
from lcpimpact.scheme.structure import Feature

NAMES = [name for name in METHODS if issubclass(METHODS[name], LinearStep)]
STEPS = (211, 337, 541, 877, 1409, 2267)
"""Primes, so that no impact falls on a grid point."""

SLIDING = [name for name in NAMES if Feature.SLIDERS in METHODS[name].declared.handles]
EXACT_IN_PLACE = [name for name in NAMES if METHODS[name].declared.order_penetration == np.inf]
POSITION_LEVEL = {"generalized-alpha", "rattle-ns", "schatzman-paoli"}


def run(problem, name, dt, t_end, **options):
    return li.simulate(problem, name, dt=dt, t_end=t_end, progress=False, **options)


def slope(counts, errors):
    return -np.polyfit(np.log(counts), np.log(errors), 1)[0]


# ---- one mass, one spring, one dashpot, one wall: the formulas by hand ----------------------------------------------
#
# m x'' + c x' + k x = f(t) - r, u = g - x. Each loop is written from its source and knows nothing of the package.

m, c, k, g, e = 1.3, 0.4, 70.0, 0.11, 0.6
x0, v0, h, n = -0.2, 1.7, 1.3e-2, 300


def f(t):
    return 9.0 * np.cos(5.0 * t) + 4.0


def wall():
    scheme = li.Scheme(
        li.Mass("x", m), li.Spring("x", "ground", k), li.Dashpot("x", "ground", c), li.Load("x", f),
        li.Bumper("x", "ground", gap=g, e=e),
    )  # fmt: skip
    return li.Problem("wall", scheme, q0={"x": x0}, v0={"x": v0})


def push(free, response, closed):
    """Solve 0 <= P ⟂ free + response P >= 0 where the row is closed."""
    return max(0.0, -free / response) if closed else 0.0


def moreau_midpoint():
    x, v = x0, v0
    for i in range(n):
        x_M = x + h / 2 * v
        v_free = (m * v + h * (f((i + 0.5) * h) - k * x_M - c * v / 2)) / (m + h * c / 2)
        P = push(-v_free - e * v, 1 / (m + h * c / 2), x_M >= g)
        v = v_free - P / (m + h * c / 2)
        x = x_M + h / 2 * v
        yield x, v, P


def newmark(alpha=0.0, beta=0.25, gamma=0.5):
    x, v = x0, v0
    F = f(0.0) - k * x - c * v
    a = F / m
    S = m + (1 + alpha) * (gamma * h * c + beta * h * h * k)
    for i in range(n):

        def end(P, x=x, v=v, a=a, F=F, t=(i + 1) * h):
            x_0 = x + h * v + (0.5 - beta) * h * h * a - h * P / m / 2
            v_0 = v + (1 - gamma) * h * a - P / m
            a_new = ((1 + alpha) * (f(t) - k * x_0 - c * v_0) - alpha * F) / S
            return x_0 + beta * h * h * a_new, v_0 + gamma * h * a_new, a_new

        free, response = -end(0.0)[1] - e * v, end(0.0)[1] - end(1.0)[1]
        P = push(free, response, x + h * v / 2 + h * h * a / 8 >= g)
        x, v, a = end(P)
        F = f((i + 1) * h) - k * x - c * v
        yield x, v, P


def generalized_alpha(rho=0.8):
    a_m, a_f = (2 * rho - 1) / (rho + 1), rho / (rho + 1)
    gamma = 0.5 + a_f - a_m
    beta = (gamma + 0.5) ** 2 / 4
    x, v = x0, v0
    a = d = (f(0.0) - k * x - c * v) / m
    for i in range(n):
        # The unknowns x⁺, v⁺, d⁺, a⁺ of the smooth step, as the linear system that defines them; t is a push on the place.
        A = np.array(
            [
                [1, 0, 0, -beta * h * h],
                [0, 1, 0, -gamma * h],
                [k, c, m, 0],
                [0, 0, -(1 - a_f), 1 - a_m],
            ]
        )
        c_h = (1 - a_f) / (1 - a_m)

        def smooth(nu, A=A, x=x, v=v, a=a, d=d, t=(i + 1) * h, c_h=c_h):
            place = x + h * v + (0.5 - beta) * h * h * a - nu / (m + c_h * gamma * h * c)
            return np.linalg.solve(A, [place, v + (1 - gamma) * h * a, f(t), a_f * d - a_m * a])[0]

        nu = push(g - smooth(0.0), smooth(0.0) - smooth(1.0), closed=True)
        x_new = smooth(nu)

        def velocity(P, x_new=x_new, v=v, a=a, d=d, t=(i + 1) * h):
            B = np.array([[1, 0, -gamma * h], [c, m, 0], [0, -(1 - a_f), 1 - a_m]])
            return np.linalg.solve(B, [v + (1 - gamma) * h * a - P / m, f(t) - k * x_new, a_f * d - a_m * a])

        P = push(-velocity(0.0)[0] - e * v, velocity(0.0)[0] - velocity(1.0)[0], nu > 0)
        x, (v, d, a) = x_new, velocity(P)
        yield x, v, P


def rattle():
    x, v = x0, v0
    A = m + h * c / 2
    for i in range(n):
        v_half = (m * v + h / 2 * (f(i * h) - k * x)) / A
        P_1 = push(g - x - h * v_half, h / A, closed=True)
        v_half -= P_1 / A
        x += h * v_half
        v_free = v_half + (h / 2 * (f((i + 1) * h) - k * x - c * v_half) + P_1) / m
        P = push(-v_free - e * v, 1 / m, P_1 > 0)
        v = v_free - P / m
        yield x, v, P


def stormer_verlet():
    x, v = x0, v0
    A = m + h * c / 2
    for i in range(n):
        v_free = (m * v + h / 2 * (f(i * h) - k * x)) / A

        def end(P, x=x, v_free=v_free, t=(i + 1) * h):
            v_half = v_free - P / 2 / A
            return x + h * v_half, v_half + (h / 2 * (f(t) - k * (x + h * v_half) - c * v_half) - P / 2) / m

        P = push(-end(0.0)[1] - e * v, end(0.0)[1] - end(1.0)[1], x + h / 2 * v_free >= g)
        x, v = end(P)
        yield x, v, P


def d1_minus():
    x, v = x0, v0
    for i in range(n):
        closed = x >= g
        a_plus = (f(i * h) - k * x - c * v) / m
        λ_plus = push(-(v + h * a_plus) - e * v, h / m, closed)
        v_1 = v + h * (a_plus - λ_plus / m)
        x += h / 2 * (v + v_1)
        a_minus = (f((i + 1) * h) - k * x - c * v_1) / m
        v_minus = v + h / 2 * (a_plus - λ_plus / m + a_minus)
        λ_minus = push(-v_minus - e * v, h / 2 / m, closed)
        v_minus -= h / 2 * λ_minus / m
        P = push(-v_minus - e * v_minus, 1 / m, x >= g)
        v = v_minus - P / m
        yield x, v, P + h / 2 * (λ_plus + λ_minus)


def cd_lagrange():
    x = x0
    V = v0 + h / 2 * (f(0.0) - k * x0 - c * v0) / m
    for i in range(n):
        x += h * V
        V_free = (m * V + h * (f((i + 1) * h) - k * x - c * V / 2)) / (m + h * c / 2)
        P = push(-V_free - e * V, 1 / (m + h * c / 2), x >= g)
        V_new = V_free - P / (m + h * c / 2)
        mean = (V + V_new) / 2
        yield x, min(mean, V_new) if P > 0 else mean, P
        V = V_new


def schatzman_paoli():
    x, before = x0, x0 - h * v0 + h * h / 2 * (f(0.0) - k * x0 - c * v0) / m
    A = m + h * c / 2
    for i in range(n):
        free = (m * (2 * x - before) + h * h * (f(i * h) - k * x) + h * c / 2 * before) / A
        r = push((g - free) + e * (g - before), h * h / A, closed=True)
        new = free - h * h * r / A
        V = (new - x) / h
        v = V + h / 2 * (f((i + 1) * h) - k * new - c * V) / m
        yield new, min(v, 0.0) if r > 0 else v, h * r
        x, before = new, x


def moreau_jean(theta=0.5):
    x, v = x0, v0
    A = m / (theta * h) + c + theta * h * k
    for i in range(n):
        f_theta = (1 - theta) * f(i * h) + theta * f((i + 1) * h)
        w = (f_theta - k * x + m * v / (theta * h)) / A
        r = push(-w - (theta * e - (1 - theta)) * v, 1 / A, x + h * v / 2 >= g)
        w -= r / A
        x, v = x + h * w, v + (w - v) / theta
        yield x, v, h * r


BY_HAND = {
    "moreau-jean": (moreau_jean, {}),
    "moreau-midpoint": (moreau_midpoint, {}),
    "newmark-ns": (newmark, {}),
    "generalized-alpha": (generalized_alpha, {}),
    "rattle-ns": (rattle, {}),
    "stormer-verlet-ns": (stormer_verlet, {}),
    "d1-minus": (d1_minus, {}),
    "cd-lagrange": (cd_lagrange, {}),
    "schatzman-paoli": (schatzman_paoli, {}),
}
WITH_OPTIONS = [
    ("moreau-jean", lambda: moreau_jean(0.7), {"theta": 0.7}),
    ("moreau-jean", lambda: moreau_jean(1.0), {"theta": 1.0}),
    ("newmark-ns", lambda: newmark(-0.2, 0.36, 0.7), {"alpha": -0.2}),
    ("newmark-ns", lambda: newmark(0.0, 0.0, 0.5), {"beta": 0.0}),
    ("newmark-ns", lambda: newmark(0.0, 0.3025, 0.6), {"beta": 0.3025, "gamma": 0.6}),
    ("generalized-alpha", lambda: generalized_alpha(1.0), {"rho_inf": 1.0}),
    ("generalized-alpha", lambda: generalized_alpha(0.0), {"rho_inf": 0.0}),
]


def test_every_method_is_written_by_hand_too():
    assert set(BY_HAND) == set(NAMES)


@pytest.mark.parametrize(
    ("name", "by_hand", "options"), [(name, *BY_HAND[name]) for name in NAMES if name in BY_HAND] + WITH_OPTIONS
)
def test_steps_are_those_of_the_formulas(name, by_hand, options):
    found = run(wall(), name, h, n * h, **options)
    expected = np.array(list(by_hand()))
    assert (np.diff(expected[:, 2] > 0).astype(int) > 0).sum() >= 4, "no impacts, no test"
    assert_allclose(found["x"][1:], expected[:, 0], rtol=0, atol=1e-12)
    assert_allclose(found["v_x"][1:], expected[:, 1], rtol=0, atol=1e-11)
    in_events = sum(event.impulse for event in found.events)
    assert_allclose(in_events + h * found["R"].sum(), expected[:, 2].sum(), rtol=1e-11)


# ---- orders ---------------------------------------------------------------------------------------------------------


def chain():
    scheme = li.Scheme(
        li.Mass("a", 1.0), li.Mass("b", 2.0), li.Spring("a", "ground", 40.0), li.Spring("a", "b", 25.0),
        li.Dashpot("b", "ground", 0.7), li.Dashpot("a", "b", 0.4), li.Load("b", li.Harmonic(3.0, 4.0)),
    )  # fmt: skip
    return li.Problem("chain", scheme, q0={"a": 0.3}, v0={"b": 1.0})


@pytest.mark.parametrize("name", NAMES)
def test_order_in_smooth_motion(name):
    exact = run(chain(), "exact", 0.1, 2.0)
    errors = []
    for steps in STEPS:
        found = run(chain(), name, 2.0 / steps, 2.0)
        truth = exact.sample(found.t)
        errors.append([np.abs(found.q - truth.q).max(), np.abs(found.v - truth.v).max()])
    for error in np.transpose(errors):
        assert abs(slope(STEPS, error) - METHODS[name].declared.order_smooth) < 0.1


@pytest.mark.parametrize(("problem", "t_end"), [("bouncing-ball", 1.5), ("oscillator-stop", 2.0)])
@pytest.mark.parametrize("name", NAMES)
def test_order_across_impacts(name, problem, t_end):
    known = li.load_problem(problem)
    assert known.motion is not None
    errors = []
    for steps in (*STEPS, 3671, 5939):
        found = run(known, name, t_end / steps, t_end)
        t = np.linspace(0.0, t_end, 80001)
        errors.append(np.abs(np.interp(t, found.t, found.v[:, 0]) - known.motion(t)[1][:, 0]).mean() * t_end)
    assert abs(slope((*STEPS, 3671, 5939), errors) - METHODS[name].declared.order_impact) < 0.35
    assert errors[-1] < 3e-2


def many_bounces():
    scheme = li.Scheme(li.Mass("x", 1.0), li.Load("x", 9.81), li.Bumper("x", "ground", gap=1.0, e=0.9))
    return li.Problem("many bounces", scheme)


@pytest.mark.parametrize("name", NAMES)
def test_penetration(name):
    declared = METHODS[name].declared.order_penetration
    found = [run(many_bounces(), name, 6.0 / steps, 6.0).certificate.penetration for steps in STEPS]
    if declared == np.inf:
        assert max(found) < 1e-12
    else:
        assert abs(slope(STEPS, found) - declared) < 0.35
        assert found[-1] > 1e-4, "no penetration at all is to be declared"


@pytest.mark.parametrize("name", EXACT_IN_PLACE)
def test_none_penetrates_among_many_bodies(name):
    found = run(column(0.7), name, 2e-3, 1.5)
    assert found.success
    assert found.certificate.penetration < 1e-12
    assert len(found.events) > 10


@pytest.mark.parametrize("name", NAMES)
def test_hertz_and_hunt_crossley_impacts(name):
    for problem in ("hertz-impact", "hunt-crossley-impact"):
        known = li.load_problem(problem)
        coarse, fine = (run(known, name, known.t_end / steps, known.t_end) for steps in (503, 2003))
        for fact in known.facts:
            assert abs(fact.measure(fine) / fact.value - 1.0) < 3e-6, fact.symbol
        overlap = known.facts[0]
        ratio = abs(overlap.measure(coarse) - overlap.value) / abs(overlap.measure(fine) - overlap.value)
        assert 12.0 < ratio < 20.0


@pytest.mark.parametrize(("b", "order"), [(0.0, 2.0), (0.3, 1.0)])
@pytest.mark.parametrize("name", NAMES)
def test_non_linear_springs_beside_a_contact(name, b, order):
    """A mass falls on a non-linear spring whose lower end a bumper holds; by SciPy, the lower end as if it were fixed."""
    scheme = li.Scheme(
        li.Mass("x", 1.0), li.Mass("y", 2.0), li.HuntCrossley("x", "y", 400.0, b, 1.5) if b else
        li.HertzSpring("x", "y", 400.0, 1.5), li.Load("x", 9.81), li.Load("y", 30.0), li.Bumper("y", "ground", e=0.0),
    )  # fmt: skip
    problem = li.Problem("both", scheme, q0={"x": -0.3})

    def rhs(t, X):
        return [X[1], 9.81 - 400.0 * max(X[0], 0.0) ** 1.5 * (1.0 + b * X[1])]

    truth = solve_ivp(rhs, (0.0, 1.5), [-0.3, 0.0], "DOP853", rtol=1e-12, atol=1e-12).y[0, -1]
    errors = [abs(run(problem, name, 1.5 / steps, 1.5)["x"][-1] - truth) for steps in STEPS]
    assert slope(STEPS, errors) > order - 0.2
    assert errors[-1] < 1e-3


# ---- friction -------------------------------------------------------------------------------------------------------

TURNING = (211, 337, 541, 877, 1409, 2267, 3671)


@pytest.mark.parametrize("name", SLIDING)
def test_order_of_friction(name):
    known = li.load_problem("coulomb-oscillator")
    slopes = []
    for t_end in (0.9, 1.3, 2.2):
        errors = []
        for steps in TURNING:
            found = run(known, name, t_end / steps, t_end)
            errors.append(np.abs(found.q - known.motion(found.t)[0]).max())
        slopes.append(slope(TURNING, errors))
    assert abs(np.mean(slopes) - METHODS[name].declared.order_friction) < 0.35


@pytest.mark.parametrize("name", SLIDING)
def test_order_while_it_slides_one_way(name):
    known, errors = li.load_problem("coulomb-oscillator"), []
    for steps in STEPS:
        found = run(known, name, 0.3 / steps, 0.3)
        errors.append(np.abs(found.q - known.motion(found.t)[0]).max())
    assert abs(slope(STEPS, errors) - 2.0) < 0.1


@pytest.mark.parametrize("name", SLIDING)
def test_a_sliding_mass_stops_and_stays(name):
    known = li.load_problem("coulomb-oscillator")
    found = run(known, name, known.t_end / 4001, known.t_end)
    for fact in known.facts:
        assert fact.error(found) < 2e-2, fact.symbol
    at_rest = found.t > 1.8
    assert np.ptp(found["x"][at_rest]) < 1e-14
    assert_allclose(found["F"][found.t_reaction > 1.8], -100.0 * found["x"][-1], rtol=1e-9)


@pytest.mark.parametrize("name", SLIDING)
def test_friction_beside_a_contact(name):
    # A block on a rough table slides into a wall: the speed at the wall is sqrt(v0² - 2 F d/m), and e of it comes back.
    scheme = li.Scheme(
        li.Mass("x", 2.0), li.Slider("x", "ground", 3.0, name="F"), li.Bumper("x", "ground", gap=0.4, e=0.5)
    )
    found = run(li.Problem("block", scheme, v0={"x": 2.0}), name, 1.0 / 4001, 1.0)
    at_wall = np.sqrt(4.0 - 2.0 * 1.5 * 0.4)
    hit = next(event for event in found.events if event.kind == "impact")
    assert_allclose(hit.impulse, 2.0 * 1.5 * at_wall, rtol=5e-3)
    assert_allclose(found["x"][-1], 0.4 - (0.5 * at_wall) ** 2 / 3.0, rtol=5e-3)
    assert abs(found["v_x"][-1]) < 1e-14


@pytest.mark.parametrize("name", [name for name in NAMES if name not in SLIDING])
def test_sliders_are_refused_where_not_declared(name):
    assert METHODS[name].declared.order_friction == 0
    with pytest.raises(li.UnsupportedError, match=r"sliders.*moreau-jean"):
        run(li.load_problem("coulomb-oscillator"), name, 1e-2, 1.0)


# ---- contact --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_what_rests_stays_at_rest(name):
    scheme = li.Scheme(
        li.Mass("x", 2.0), li.Spring("x", "ground", 30.0), li.Dashpot("x", "ground", 3.0), li.Load("x", 20.0),
        li.Bumper("x", "ground", e=0.5),
    )  # fmt: skip
    found = run(li.Problem("resting", scheme), name, 1e-2, 0.5)
    assert found.events == ()
    assert np.abs(found.q).max() < 1e-15
    assert np.abs(found.v).max() < 1e-14
    assert_allclose(found["R"], 20.0, rtol=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_a_contact_that_lasts_keeps_order_two(name):
    """Of two masses on one spring the lower stays on the ground: the upper one swings as if the lower were the ground."""
    scheme = li.Scheme(
        li.Mass("a", 1.0), li.Mass("b", 1.0), li.Spring("a", "b", 50.0), li.Dashpot("a", "b", 1.0), li.Load("b", 30.0),
        li.Bumper("b", "ground", e=0.0),
    )  # fmt: skip
    alone = li.Scheme(li.Mass("a", 1.0), li.Spring("a", "ground", 50.0), li.Dashpot("a", "ground", 1.0))
    errors = []
    for steps in STEPS:
        found = run(li.Problem("pair", scheme, q0={"a": 0.2}), name, 1.0 / steps, 1.0)
        truth = run(li.Problem("alone", alone, q0={"a": 0.2}), "exact", 1.0 / steps, 1.0)
        there = truth.sample(found.t_reaction)
        a, v_a = there.q[:, 0], there.v[:, 0]
        force = np.abs(found["R"] - (30.0 + 50.0 * a + v_a))[1:-1].max()
        errors.append([np.abs(found["a"] - truth["a"]).max(), force])
        assert np.abs(found["b"]).max() < 30.0 / steps**2
        assert found.events == ()
    of_place, of_force = np.transpose(errors)
    assert abs(slope(STEPS, of_place) - 2.0) < 0.1
    assert slope(STEPS, of_force) > 1.8, "the reaction is a mean force that is to be read where it lives"


@pytest.mark.parametrize("name", NAMES)
def test_a_step_whose_square_is_no_number_is_refused(name):
    with pytest.raises(li.InputError, match=r"dt = 1e\+160 s is longer than"):
        run(li.load_problem("bouncing-ball"), name, 1e160, 3e160)


@pytest.mark.parametrize("name", NAMES)
def test_a_pile_at_rest_stays_at_rest(name):
    """Of equal bodies under their weight no gap closes by itself: only rounding opens the contacts between them."""
    scheme = li.Scheme(
        *(each for i in range(6) for each in (li.Mass(f"m{i}", 1.0), li.Load(f"m{i}", 10.0))),
        *(li.Bumper(f"m{i}", f"m{i + 1}" if i < 5 else "ground", e=0.0) for i in range(6)),
    )
    found = run(li.Problem("pile", scheme), name, 1e-3, 2.0)
    assert np.abs(found.q).max() < 1e-12
    assert_allclose(found.reaction[1:-1], np.tile(10.0 * np.arange(1, 7), (1998, 1)), rtol=1e-8)


@pytest.mark.parametrize("name", NAMES)
def test_momentum_and_restitution_of_an_inner_contact(name):
    scheme = li.Scheme(li.Mass("a", 1.0), li.Mass("b", 3.0), li.Bumper("a", "b", gap=0.5, e=0.7))
    found = run(li.Problem("two", scheme, v0={"a": 2.0}), name, 1e-3, 1.0)
    assert_allclose(found.v @ [1.0, 3.0], 2.0, rtol=1e-12)
    assert_allclose(found["v_b"][-1] - found["v_a"][-1], 0.7 * 2.0, rtol=1e-11)
    assert [event.kind for event in found.events] == ["impact"]
    assert_allclose(found.events[0].t, 0.25, atol=2.1e-3)
    assert_allclose(found.events[0].impulse, 0.75 * 1.7 * 2.0, rtol=1e-11)
    assert_allclose(found.reaction, 0.0, atol=0.0)


@pytest.mark.parametrize("name", NAMES)
def test_an_impact_at_the_start(name):
    scheme = li.Scheme(li.Mass("x", 2.0), li.Bumper("x", "ground", e=0.5))
    found = run(li.Problem("thrown", scheme, v0={"x": 1.0}), name, 1e-2, 0.2)
    assert_allclose(found["v_x"][-1], -0.5, rtol=1e-12)
    assert_allclose(sum(event.impulse for event in found.events), 3.0, rtol=1e-12)


@pytest.mark.parametrize("e", [0.0, 0.5, 0.8])
@pytest.mark.parametrize("name", NAMES)
def test_a_ball_comes_to_rest_after_infinitely_many_bounces(name, e):
    found = run(li.load_problem("bouncing-ball", e=e), name, 5.0 / 4001, 5.0)
    assert abs(found["v_x"][-1]) < 1e-9
    assert_allclose(found["R"][-1], 9.81, rtol=1e-9)
    assert abs(found["x"][-1] - 1.0) < 0.02
    # Impulses and forces together take all the momentum that gravity gave, but for what half a step holds.
    impulses = sum(event.impulse for event in found.events)
    assert_allclose(impulses + found["R"].sum() * 5.0 / 4001, 9.81 * 5.0, rtol=0, atol=9.81 * 5.0 / 4001)


# ---- many bodies, solvers, blocks -----------------------------------------------------------------------------------


def column(e, balls=4):
    """Balls above one another, falling on the ground."""
    below = [f"m{i + 1}" for i in range(balls - 1)] + ["ground"]
    scheme = li.Scheme(
        *(li.Mass(f"m{i}", 1.0 + 0.3 * i) for i in range(balls)),
        *(li.Load(f"m{i}", 9.81 * (1.0 + 0.3 * i)) for i in range(balls)),
        *(li.Bumper(f"m{i}", below[i], gap=0.01 * (i + 1), e=e, name=f"R{i}") for i in range(balls)),
    )
    return li.Problem("column", scheme)


@pytest.mark.parametrize("name", NAMES)
def test_a_column_settles_under_its_weight(name):
    found = run(column(0.2), name, 1e-3, 2.0)
    assert np.abs(found.v[-1]).max() < 1e-9
    assert_allclose(found.reaction[-1], 9.81 * np.cumsum(1.0 + 0.3 * np.arange(4)), rtol=1e-8)


@pytest.mark.parametrize("name", NAMES)
def test_a_qp_solver_gives_the_same(name):
    reference = run(column(0.3, balls=2), name, 2e-3, 0.4)
    found = run(column(0.3, balls=2), name, 2e-3, 0.4, lcp_solver="qp:osqp")
    assert len(reference.events) > 4
    for each in ("q", "v"):
        expected = getattr(reference, each)
        assert_allclose(getattr(found, each), expected, rtol=0, atol=1e-7 * np.abs(expected).max())


@pytest.mark.parametrize("name", NAMES)
def test_blocks_and_halves_do_not_change_the_bits(name, monkeypatch):
    import lcpimpact.simulation

    whole = run(column(0.3), name, 2.0**-10, 2.0)
    short = run(column(0.3), name, 2.0**-10, 1.0)
    assert whole.q[: len(short.q)].tobytes() == short.q.tobytes()
    assert whole.v[: len(short.v)].tobytes() == short.v.tobytes()
    monkeypatch.setattr(lcpimpact.simulation, "BLOCK_SECONDS", 0.0)
    pieces = run(column(0.3), name, 2.0**-10, 2.0)
    for each in ("q", "v", "reaction"):
        assert getattr(pieces, each).tobytes() == getattr(whole, each).tobytes()


@pytest.mark.parametrize("name", NAMES)
def test_a_starved_solver_stops_the_run(name):
    resting = li.Scheme(
        *(li.Mass(f"m{i}", 1.0) for i in range(6)),
        *(li.Load(f"m{i}", 10.0) for i in range(6)),
        *(li.Bumper(f"m{i}", f"m{i + 1}" if i < 5 else "ground", e=0.0, name=f"R{i}") for i in range(6)),
    )
    dropped = li.Problem("pile", resting, q0={f"m{i}": -0.1 for i in range(6)})
    failed = run(dropped, name, 1e-2, 0.5, lcp_solver="pgs", max_iter=1, throw=False)
    assert failed.status is li.Status.MAX_ITER
    assert abs(failed.t[-1] - np.sqrt(0.02)) < 0.02, "where the pile meets the ground"
    assert f"step {len(failed.t) - 1}" in failed.message


# ---- options and refusals -------------------------------------------------------------------------------------------


def test_newmark_is_the_theta_step_in_smooth_motion():
    # Only a constant load: the θ-step takes its mean over the step, Newmark its ends.
    scheme = li.Scheme(
        li.Mass("a", 1.0),
        li.Mass("b", 2.0),
        li.Spring("a", "ground", 40.0),
        li.Dashpot("a", "b", 0.4),
        li.Load("b", 3.0),
    )
    problem = li.Problem("two", scheme, q0={"a": 0.3}, v0={"b": 1.0})
    found, theta_step = (run(problem, name, 1e-2, 2.0) for name in ("newmark-ns", "moreau-jean"))
    assert_allclose(found.q, theta_step.q, rtol=0, atol=1e-12)
    assert_allclose(found.v, theta_step.v, rtol=0, atol=1e-11)


@pytest.mark.parametrize(
    ("name", "options", "factor"),
    [
        ("newmark-ns", {}, 1.0),
        ("newmark-ns", {"alpha": -1.0 / 3.0}, 0.5),
        ("newmark-ns", {"alpha": -0.1}, 0.9 / 1.1),
        ("generalized-alpha", {"rho_inf": 1.0}, 1.0),
        ("generalized-alpha", {}, 0.8),
        ("generalized-alpha", {"rho_inf": 0.5}, 0.5),
    ],
)
def test_factor_of_the_highest_frequencies(name, options, factor):
    scheme = li.Scheme(li.Mass("x", 1.0), li.Spring("x", "ground", 1e10))
    found = run(li.Problem("stiff", scheme, q0={"x": 1.0}), name, 1.0, 400.0, throw=False, **options)
    size = np.hypot(found["x"], found["v_x"])
    # A multiple root grows by a power of the number of steps, besides.
    assert_allclose((size[400] / size[200]) ** (1.0 / 200.0), factor, rtol=0.02)


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("newmark-ns", {"alpha": 0.1}),
        ("newmark-ns", {"alpha": -0.5}),
        ("newmark-ns", {"beta": -0.1}),
        ("newmark-ns", {"gamma": 0.4}),
        ("newmark-ns", {"beta": "0.25"}),
        ("generalized-alpha", {"rho_inf": 1.1}),
        ("generalized-alpha", {"rho_inf": float("nan")}),
    ],
)
def test_options_outside_their_limits_are_refused(name, options):
    with pytest.raises(li.InputError, match=next(iter(options))):
        run(chain(), name, 1e-2, 0.1, **options)


def test_hht_beside_contacts_refuses_non_linear_springs():
    scheme = li.Scheme(
        li.Mass("x", 1.0), li.HertzSpring("x", "ground", 10.0, 1.5), li.Bumper("x", "ground", gap=1.0, e=0.0)
    )
    with pytest.raises(li.UnsupportedError, match="generalized-alpha"):
        run(li.Problem("both", scheme), "newmark-ns", 1e-2, 0.1, alpha=-0.1)


@pytest.mark.parametrize("name", [name for name in NAMES if Feature.MASSLESS not in METHODS[name].declared.handles])
def test_massless_nodes_are_refused(name):
    with pytest.raises(li.UnsupportedError, match="moreau-jean"):
        run(li.load_problem("system-1"), name, 1e-2, 0.1)


def test_a_spring_with_loss_feels_the_impulse_of_its_own_step():
    """The balance of each step of the midpoint rule, with a Hunt-Crossley spring that joins the mass that bounces."""
    scheme = li.Scheme(
        li.Mass("a", 1.0), li.Mass("b", 2.0), li.HuntCrossley("a", "b", 4e3, 0.8), li.Load("a", 5.0),
        li.Bumper("b", "ground", gap=0.05, e=0.5), li.Spring("b", "ground", 30.0),
    )  # fmt: skip
    problem = li.Problem("pressed", scheme, q0={"a": -0.1}, v0={"a": 2.0})
    d, h = problem.dynamics, 1e-3
    found = run(problem, "moreau-midpoint", h, 1.0)
    w = 0.5 * (found.v[1:] + found.v[:-1])
    q_M = found.q[:-1] + 0.5 * h * found.v[:-1]
    change = np.diff(found.v, axis=0) @ d.M - h * (d.force(0.0) - q_M @ d.K + d.spring_force(q_M, w))
    impulses = sum(event.impulse for event in found.events) + h * found["R"].sum()
    assert len(found.events) >= 3
    assert ((d.approach(q_M) > 0.0).ravel() & (np.abs(change[:, 1]) > 1e-6)).any(), (
        "an impact while the spring is pressed"
    )
    assert_allclose(change[:, 0], 0.0, atol=1e-10)
    assert_allclose(-change[:, 1].sum(), impulses, rtol=1e-10)


@pytest.mark.parametrize("name", NAMES)
def test_the_residual_of_an_iterative_solver_is_reported(name):
    scheme = li.Scheme(
        *(li.Mass(f"m{i}", 1.0 + i) for i in range(3)), *(li.Load(f"m{i}", 10.0) for i in range(3)),
        *(li.Bumper(f"m{i}", f"m{i + 1}" if i < 2 else "ground", e=0.0, name=f"R{i}") for i in range(3)),
    )  # fmt: skip
    found = run(li.Problem("pile", scheme), name, 1e-2, 0.1, lcp_solver="pgs")
    assert 0.0 < found.certificate.residual < 1e-6


@pytest.mark.slow
def test_the_interpreter_gives_the_bits_of_the_compiled_code(python):
    code = f"""
import json, lcpimpact as li
bits = []
for problem, t_end in (("two-balls-spring", 0.5), ("hunt-crossley-impact", 4e-5)):
    for name in {NAMES!r}:
        run = li.simulate(li.load_problem(problem), name, dt=t_end / 80, t_end=t_end)
        bits += [run.q.tobytes().hex(), run.v.tobytes().hex(), run.reaction.tobytes().hex()]
print(json.dumps(bits))
"""
    compiled = python(code)
    assert len(set(compiled)) > 2 * len(NAMES)
    assert python(code, LCPIMPACT_COMPILE="never") == compiled


# ---- what a method of one's own does not declare --------------------------------------------------------------------


class Undeclared(METHODS["moreau-midpoint"]):
    """The midpoint method, which reads the loads at t + h/2, with another declaration."""

    instants = (0.0,)


class Forgetful(METHODS["moreau-midpoint"]):
    """A method that reads what nothing remembers."""

    def equations(self, y, d, h):
        return y.memory["a"]


def test_loads_at_an_instant_that_the_method_does_not_declare_are_refused_with_the_remedy():
    with pytest.raises(li.InputError, match=r"use 0\.5, .*declare 0\.5 in instants, as instants = \(0\.0, 0\.5\)"):
        li.simulate(wall(), Undeclared(), dt=h, t_end=h)
    with pytest.raises(li.InputError, match=r"use 'a', .*declare 'a' in remembers, as remembers = \('a',\)"):
        li.simulate(wall(), Forgetful(), dt=h, t_end=h)
