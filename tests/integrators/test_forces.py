"""General forces by every method that takes them: closed forms, SciPy by hand, orders, energy, and spoilt runs."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from random_schemes import random_problem
from scipy.integrate import quad, solve_ivp

import lcpimpact as li
from lcpimpact.integrators import METHODS
from lcpimpact.scheme.structure import Feature

ABLE = [name for name, kind in METHODS.items() if Feature.FORCES in kind.declared.handles]
EXPLICIT = [name for name in ABLE if METHODS[name].family == "explicit Runge-Kutta"]
TIGHT = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}


def test_these_methods_take_general_forces_and_the_others_name_them():
    assert set(ABLE) == {"moreau-jean", "event-driven", "rk4", "heun", "ssprk3", "bs23", "dopri5"}
    scheme = li.Scheme(li.Mass("x", 1.0), li.Mass("y", 1.0), li.Force(("x", "y"), lambda t, q, v: -q))
    for method in set(METHODS) - set(ABLE):
        with pytest.raises(li.UnsupportedError, match=r"general forces \(Force between 'x' and 'y'\).*'moreau-jean'"):
            li.simulate(li.Problem("pair", scheme), method, dt=1e-2, t_end=0.1)


# ---- smooth motion against SciPy ------------------------------------------------------------------------------------


def duffing(t, q, v):
    return -5.0 * q**3 + 2.0 * np.cos(1.3 * t) - 0.2 * v * np.sqrt(v**2 + 1e-2)


DUFFING = li.Problem(
    "duffing",
    li.Scheme(li.Mass("x", 2.0), li.KelvinVoigt("x", "ground", 1.0, 0.1), li.Load("x", duffing)),
    q0={"x": 1.0},
    v0={"x": 0.3},
)


def duffing_by_scipy(t_end):
    found = solve_ivp(
        lambda t, y: [y[1], (duffing(t, *y) - y[0] - 0.1 * y[1]) / 2.0], (0.0, t_end), [1.0, 0.3], **TIGHT
    )
    return found.y[:, -1]


def error_of(problem, reference, method, steps, t_end, **options):
    run = li.simulate(problem, method, dt=t_end / steps, t_end=t_end, **options)
    assert run.success
    return float(np.abs(np.concatenate([run.q[-1], run.v[-1]]) - reference).max())


@pytest.mark.parametrize("method", ["moreau-jean", *EXPLICIT])
def test_the_order_of_smooth_motion_is_as_declared(method):
    reference = duffing_by_scipy(2.0)
    coarse, fine = (error_of(DUFFING, reference, method, steps, 2.0) for steps in (80, 160))
    assert math.log2(coarse / fine) == pytest.approx(METHODS[method].declared.order_smooth, abs=0.3)


def test_theta_one_is_of_order_one_and_damps():
    reference = duffing_by_scipy(2.0)
    coarse, fine = (error_of(DUFFING, reference, "moreau-jean", steps, 2.0, theta=1.0) for steps in (400, 800))
    assert math.log2(coarse / fine) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(
    ("method", "options", "bound"),
    [
        ("event-driven", {}, 1e-8), ("event-driven", {"ode_solver": "Radau"}, 1e-6), ("dopri5", {"rtol": 1e-9}, 1e-7),
        ("bs23", {"rtol": 1e-6}, 1e-4), ("moreau-jean", {"rtol": 1e-5}, 1e-2),
    ],
)  # fmt: skip
def test_adaptive_steps(method, options, bound):
    assert error_of(DUFFING, duffing_by_scipy(3.0), method, 30, 3.0, **options) < bound


def coupled(t, q, v):
    """Two bodies that attract by a cubic law and rub on each other by a smooth one, and a third, pushed by their sum."""
    pull = 40.0 * (q[1] - q[0]) ** 3 + 0.5 * np.tanh((v[1] - v[0]) / 0.1)
    return np.array([pull, -pull, 0.3 * np.sin(q[0] + q[1])])


def test_a_force_of_several_nodes():
    """Also with nodes in another order than those of the scheme, and a Jacobian that is given."""
    m, start = {"z": 3.0, "x": 1.0, "y": 2.0}, [0.1, -0.2, 0.05, 0.4, 0.0, -0.3]

    def rate(t, y):
        return [*y[3:], *(coupled(t, y[:3], y[3:]) / [1.0, 2.0, 3.0])]

    reference = solve_ivp(rate, (0.0, 2.0), start, **TIGHT).y[:, -1]
    law = li.Force(("x", "y", "z"), coupled)

    def jacobian(t, q, v):
        from lcpimpact.scheme.force_law import ForceLaw

        return ForceLaw("", law.nodes, coupled).tangents(t, q, v)

    q0, v0 = (dict(zip("xyz", each, strict=True)) for each in (start[:3], start[3:]))
    masses = [li.Mass(node, value) for node, value in m.items()]
    for force in (law, replace(law, jacobian=jacobian)):
        problem = li.Problem("three", li.Scheme(*masses, force), q0=q0, v0=v0)
        for method, bound in (("event-driven", 1e-7), ("dopri5", 1e-7), ("moreau-jean", 1e-3)):
            run = li.simulate(problem, method, dt=5e-3, t_end=2.0)
            found = [run[name][-1] for name in ("x", "y", "z", "v_x", "v_y", "v_z")]
            assert_allclose(found, reference, rtol=0.0, atol=bound)


@pytest.mark.parametrize("method", ABLE)
def test_a_force_may_follow_a_node_with_prescribed_motion(method):
    """A block on a shaken belt with arctan friction: the force that drives the belt takes what is left."""
    ε, belt = 0.05, li.Harmonic(0.3, 4.0, -0.5 * math.pi)

    def rub(t, q, v):
        slip = v[0] - v[1]
        return -2.0 / math.pi * np.arctan(slip / ε) * np.array([1.0, -1.0])

    scheme = li.Scheme(
        li.Mass("x", 1.0),
        li.Spring("x", "ground", 9.0),
        li.PrescribedMotion("belt", belt),
        li.Force(("x", "belt"), rub),
    )

    def rate(t, y):
        return [y[1], -9.0 * y[0] + rub(t, None, [y[1], belt.rate(t)])[0]]

    reference = solve_ivp(rate, (0.0, 2.0), [0.1, 0.0], **TIGHT).y[:, -1]
    run = li.simulate(li.Problem("belt", scheme, q0={"x": 0.1}), method, dt=2e-3, t_end=2.0)
    assert_allclose([run["x"][-1], run["v_x"][-1]], reference, rtol=0.0, atol=2e-4)


def test_a_massless_node_with_a_dashpot_follows_its_force_in_moreau_jean_alone():
    """c q' + k q = f(q, q'), by the root of a scalar equation inside SciPy's solver."""
    from scipy.optimize import brentq

    def f(t, q, v):
        return np.cos(q) - 0.5 * v**3

    scheme = li.Scheme(li.Dashpot("x", "ground", 2.0), li.Spring("x", "ground", 3.0), li.Load("x", f))
    problem = li.Problem("massless", scheme, q0={"x": -0.5})
    reference = solve_ivp(
        lambda t, y: [brentq(lambda v: 2.0 * v + 3.0 * y[0] - f(t, y[0], v), -9.0, 9.0, xtol=1e-14)],
        (0.0, 1.0),
        [-0.5],
        **TIGHT,
    ).y[0, -1]
    errors = [abs(li.simulate(problem, dt=h, t_end=1.0)["x"][-1] - reference) for h in (0.02, 0.01)]
    assert errors[1] < 1e-5
    assert math.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.2)
    for method in ("event-driven", "rk4"):
        with pytest.raises(
            li.UnsupportedError, match=r"^Load at 'x' stands at the node 'x', which is massless.*moreau-jean"
        ):
            li.simulate(problem, method, dt=1e-2, t_end=0.1)


@pytest.mark.parametrize("ε", [1e-2, 1e-4, 1e-7])
def test_newton_finds_steep_friction_in_long_steps(ε):
    """A block that rubs by arctan(v/ε) creeps where it would stick, by ε tan(π f/(2 μ N))."""
    rub = li.Load("x", lambda t, q, v: -2.0 / math.pi * 5.0 * np.arctan(v / ε))
    scheme = li.Scheme(li.Mass("x", 1.0), rub, li.Load("x", 3.0))
    run = li.simulate(li.Problem("block", scheme, v0={"x": 2.0}), "moreau-jean", dt=0.05, t_end=4.0, theta=1.0)
    assert run.success
    assert run["v_x"][-1] == pytest.approx(ε * math.tan(0.5 * math.pi * 0.6), rel=1e-6)


# ---- contacts -------------------------------------------------------------------------------------------------------

G, C, E, H = 9.81, 0.3, 0.7, 2.0
BALL = li.Problem(
    "ball in air",
    li.Scheme(
        li.Mass("x", 1.0),
        li.Load("x", G),
        li.Load("x", lambda t, q, v: -C * v * np.sqrt(v**2)),
        li.Bumper("x", "ground", gap=H, e=E),
    ),
)


def ball_in_closed_form(impacts):
    """Instants and speeds of the impacts of a ball that falls from rest against the drag c v²."""
    v_t, t, height, found = math.sqrt(G / C), 0.0, H, []
    for _ in range(impacts):
        t += v_t / G * math.acosh(math.exp(G * height / v_t**2))
        speed = v_t * math.sqrt(-math.expm1(-2.0 * G * height / v_t**2))
        found.append((t, speed))
        rebound = E * speed
        t += v_t / G * math.atan(rebound / v_t)
        height = v_t**2 / (2.0 * G) * math.log1p((rebound / v_t) ** 2)
    return np.array(found)


def test_a_ball_that_bounces_in_air():
    run = li.simulate(BALL, "event-driven", dt=0.01, t_end=2.0)
    found = [(event.t, event.left.v[0]) for event in run.events if event.kind == "impact"]
    assert_allclose(found, ball_in_closed_form(3), rtol=1e-8)


@pytest.fixture(scope="module")
def flight():
    return li.simulate(BALL, "event-driven", dt=1e-3, t_end=2.0)


@pytest.mark.parametrize("method", [name for name in ABLE if name != "event-driven"])
def test_the_order_across_impacts(method, flight):
    """L1 of the velocity over several impacts, by runs whose steps they fall into differently."""
    errors = []
    for steps in (100, 125, 160, 800, 1000, 1280):
        run = li.simulate(BALL, method, dt=2.0 / steps, t_end=2.0)
        truth = flight.sample(run.t, "right").v[:, 0]
        errors.append(np.abs(run.v[:, 0] - truth).mean())
    assert math.log2(np.mean(errors[:3]) / np.mean(errors[3:])) / 3.0 > 0.8


def duffing_with_stop(t, q, v):
    return 2.0 * np.cos(1.3 * t) - 4.0 * q**3


STOPPED = li.Problem(
    "duffing with stop",
    li.Scheme(
        li.Mass("x", 1.0),
        li.KelvinVoigt("x", "ground", 1.0, 0.2),
        li.Load("x", duffing_with_stop),
        li.Bumper("x", "ground", gap=0.4, e=0.8),
    ),
    v0={"x": 0.5},
)


def followed_by_hand(rate, stop, e, y, t_end):
    """Impacts by SciPy's events alone, which share nothing with the package."""
    t, impacts = 0.0, []
    while True:

        def gap(t, y):
            return stop - y[0]

        gap.terminal, gap.direction = True, -1.0
        found = solve_ivp(rate, (t, t_end), y, events=gap, max_step=0.02, **TIGHT)
        t, y = found.t[-1], found.y[:, -1]
        if found.status == 0:
            return np.array(impacts), y
        impacts.append((t, y[1]))
        y = [stop - 1e-15, -e * y[1]]


def test_a_duffing_oscillator_with_a_stop():
    impacts, end = followed_by_hand(
        lambda t, y: [y[1], duffing_with_stop(t, *y) - y[0] - 0.2 * y[1]], 0.4, 0.8, [0.0, 0.5], 12.0
    )
    assert len(impacts) > 4
    run = li.simulate(STOPPED, "event-driven", dt=0.05, t_end=12.0)
    found = [(event.t, event.left.v[0]) for event in run.events if event.kind == "impact"]
    assert_allclose(found, impacts, rtol=0.0, atol=1e-6)
    assert_allclose([run["x"][-1], run["v_x"][-1]], end, rtol=0.0, atol=1e-6)


@pytest.mark.slow
def test_stick_slip_by_a_smooth_stribeck_law():
    """A block on a belt under μ(v) that falls with the slip: the limit cycle by SciPy's Radau."""
    ε, belt, weight = 1e-3, 0.1, 10.0

    def rub(t, q, v):
        slip = v - belt
        return -weight * (0.3 + 0.2 * np.exp(-((slip / 0.2) ** 2))) * np.tanh(slip / ε)

    scheme = li.Scheme(li.Mass("x", 1.0), li.Spring("x", "ground", 100.0), li.Load("x", rub))
    problem = li.Problem("stribeck", scheme)
    truth = solve_ivp(
        lambda t, y: [y[1], rub(t, *y) - 100.0 * y[0]], (0.0, 2.0), [0.0, 0.0], method="Radau", rtol=1e-9, atol=1e-11,
        dense_output=True,
    ).sol  # fmt: skip
    errors = []
    for h in (2e-3, 1e-3, 5e-4):
        run = li.simulate(problem, dt=h, t_end=2.0)
        errors.append(float(np.abs(run["x"] - truth(run.t)[0]).max()))
    assert errors[-1] < 1e-4
    assert errors[0] > 6.0 * errors[-1]
    found = li.simulate(problem, "event-driven", dt=1e-2, t_end=2.0)
    assert_allclose(found["x"], truth(found.t)[0], rtol=0.0, atol=1e-6)


@pytest.mark.parametrize(("method", "bound"), [("event-driven", 1e-8), ("rk4", 2e-3), ("moreau-jean", 2e-3)])
def test_a_contact_opens_where_a_force_lifts_the_body(method, bound):
    """m g = k t v-free force: the body leaves the ground at t = (m g/a)^(1/2), and its reaction before is m g - a t²."""
    lift = li.Load("x", lambda t, q, v: -4.0 * t**2 * np.cos(q))
    problem = li.Problem(
        "lifted", li.Scheme(li.Mass("x", 1.0), li.Load("x", 1.0), lift, li.Bumper("x", "ground", e=0.0))
    )
    run = li.simulate(problem, method, dt=1e-3, t_end=1.0)
    (opens,) = (event.t for event in run.events if event.kind == "open")
    assert opens == pytest.approx(0.5, abs=bound)
    before = run.t_reaction < 0.49
    assert_allclose(run["R"][before], 1.0 - 4.0 * run.t_reaction[before] ** 2, rtol=0.0, atol=1e-9)


def fallen_column(method, c, resist, **options):
    elements = []
    for i, below in enumerate(("b1", "b2", "ground")):
        elements += [li.Mass(f"b{i}", 1.0), li.Load(f"b{i}", G), resist(f"b{i}", c)]
        elements.append(li.Bumper(f"b{i}", below, gap=0.1, e=0.4, name=f"R{i}"))
    return li.simulate(li.Problem("column", li.Scheme(*elements)), method, t_end=1.0, **options)


def test_bursts_of_impacts_under_a_force_that_is_linear():
    """A column of balls that falls on the ground, with dashpots, and with the same as forces."""
    ours = fallen_column("event-driven", 0.1, lambda node, c: li.Load(node, lambda t, q, v: -c * v), dt=1e-2)
    theirs = fallen_column("event-driven", 0.1, lambda node, c: li.Dashpot(node, "ground", c), dt=1e-2)
    assert len(ours.events) == len(theirs.events) > 100
    assert_allclose(ours.q, theirs.q, rtol=0.0, atol=1e-8)


def test_bursts_under_quadratic_drag_end_a_run_by_events_with_a_sentence_and_moreau_jean_passes_them():
    def drag(node, c):
        return li.Load(node, lambda t, q, v: -c * v * np.sqrt(v**2))

    stopped = fallen_column("event-driven", 0.5, drag, dt=1e-2, throw=False)
    assert stopped.status is li.Status.ACCUMULATION
    assert "take moreau-jean" in stopped.message
    passed = fallen_column("moreau-jean", 0.5, drag, dt=1e-3)
    assert_allclose(passed.q[-1], [0.3, 0.2, 0.1], rtol=0.0, atol=1e-2)
    assert_allclose(passed.q[: int(1e3 * stopped.t[-1]) : 10], stopped.q[: len(stopped.q) - 1], rtol=0.0, atol=1e-2)


def as_forces(problem):
    """The same problem with the springs and dashpots between nodes with mass, and the ground, as general forces."""
    d, elements, changed = problem.dynamics, [], 0
    heavy = {node for node, massive in zip(d.nodes, d.massive, strict=True) if massive} | {"ground"}
    for each in (part for element in problem.scheme.elements for part in element.parts()):
        if isinstance(each, li.Spring | li.Dashpot) and {each.a, each.b} <= heavy:
            nodes = tuple(node for node in (each.a, each.b) if node != "ground")
            signs, springy = np.array([1.0, -1.0])[: len(nodes)], isinstance(each, li.Spring)
            constant = each.k if springy else each.c

            def f(t, q, v, signs=signs, springy=springy, constant=constant):
                return -constant * signs * (signs @ (q if springy else v))

            elements.append(li.Force(nodes, f))
            changed += 1
        else:
            elements.append(each)
    return replace(problem, scheme=li.Scheme(*elements)), changed


@pytest.mark.parametrize("method", ["moreau-jean", "rk4", "event-driven"])
@pytest.mark.parametrize("seed", [0, 2, 3, 4, 9, 10, 16, 25, 26, 31])
def test_springs_and_dashpots_as_forces_move_alike(seed, method):
    """Random columns with contacts of all relative degrees: the linear elements are the reference."""
    linear = random_problem(seed)
    forced, changed = as_forces(linear)
    assert changed
    try:
        ours, theirs = (li.simulate(each, method, dt=1e-3, t_end=0.3, throw=False) for each in (forced, linear))
    except li.UnsupportedError as refusal:
        pytest.skip(str(refusal))
    assert ours.status is theirs.status
    bound = {"moreau-jean": 1e-9, "rk4": 5e-2, "event-driven": 1e-6}[method]
    assert_allclose(ours.q, theirs.q, rtol=0.0, atol=bound * np.abs(theirs.q).max())


def test_beside_a_hertzian_contact():
    """Both laws in one Newton iteration, against SciPy."""
    scheme = li.Scheme(
        li.Mass("x", 1.0),
        li.Load("x", G),
        li.HertzSpring("x", "ground", K=1e4, gap=0.1),
        li.Load("x", lambda t, q, v: -2.0 * v**3),
    )
    problem = li.Problem("soft ball", scheme, v0={"x": 1.0})

    def rate(t, y):
        return [y[1], G - 2.0 * y[1] ** 3 - 1e4 * max(y[0] - 0.1, 0.0) ** 1.5]

    reference = solve_ivp(rate, (0.0, 0.5), [0.0, 1.0], **TIGHT, max_step=1e-3).y[:, -1]
    for method, bound in (("moreau-jean", 2e-4), ("event-driven", 1e-7), ("rk4", 1e-5)):
        run = li.simulate(problem, method, dt=5e-4, t_end=0.5)
        assert_allclose([run["x"][-1], run["v_x"][-1]], reference, rtol=0.0, atol=bound)


@pytest.mark.parametrize("solver", ["lemke", "pgs", "newton-fb"])
def test_any_solver_of_lcps_will_do(solver):
    one, other = (li.simulate(BALL, dt=1e-2, t_end=1.0, lcp_solver=name) for name in ("auto", solver))
    assert_allclose(one.q, other.q, rtol=0.0, atol=1e-9)


# ---- energy and certificates ----------------------------------------------------------------------------------------


def test_a_midpoint_step_keeps_the_account_of_energy_to_rounding():
    for problem in (DUFFING, BALL):
        run = li.simulate(problem, dt=1e-2, t_end=2.0)
        assert run.certificate.energy_balance < 1e-12 * run.certificate.energy_scale


@pytest.mark.parametrize(("method", "bound"), [("moreau-jean", 2e-3), ("event-driven", 3e-8), ("rk4", 1e-3)])
def test_the_ledger_has_the_work_of_the_force(method, bound):
    """∫ f v dt of a ball that falls against quadratic drag, by quadrature of the closed form v = v_t tanh(g t/v_t)."""
    v_t = math.sqrt(G / C)
    work = quad(lambda t: -C * (v_t * math.tanh(G * t / v_t)) ** 3, 0.0, 0.5, epsabs=1e-13)[0]
    ledger = li.energy_ledger(li.simulate(BALL, method, dt=5e-3, t_end=0.5))
    assert ledger.table["loads"].iloc[-1] == pytest.approx(work, rel=bound)
    assert ledger.balance < bound * abs(work)


@pytest.mark.parametrize("method", ABLE)
@pytest.mark.parametrize("spoilt", [1.02, 0.0])
def test_a_run_with_a_wrong_force_is_found_out(method, spoilt):
    """A run with another drag does not pass as one of this problem."""
    scheme = li.Scheme(
        *BALL.scheme.elements[:2],
        li.Load("x", lambda t, q, v: -spoilt * C * v * np.sqrt(v**2)),
        BALL.scheme.elements[3],
    )
    run = li.simulate(replace(BALL, scheme=scheme), method, dt=2e-3, t_end=0.6)
    assert run.certificate.holds
    honest = li.simulate(BALL, method, dt=2e-3, t_end=0.6)
    assert honest.certificate.holds
    assert honest.certify(BALL).holds
    assert any("momentum" in failure for failure in run.certify(BALL).failures)


def test_schemes_without_such_forces_run_compiled():
    d = li.load_problem("bouncing-ball").dynamics
    assert METHODS["moreau-jean"]().prepare(d, 1e-3, "auto").forces is None


# --- forces beside closed contacts ------------------------------------------------------------------------------------


def struck(law, gap=0.0):
    """Two bodies of 1 kg, of which the first strikes the second without rebound; on the second the law acts."""
    scheme = li.Scheme(
        li.Mass("x", 1.0), li.Mass("z", 1.0), li.Bumper("x", "z", gap=gap, e=0.0, name="R"), li.Load("z", law)
    )
    return li.Problem("struck", scheme, v0={"x": 1.0})


LAWS = {
    "cubic": lambda t, q, v: -0.1 * v**3,
    "orifice": lambda t, q, v: -0.3 * v * np.sqrt(v**2),
    "smooth friction": lambda t, q, v: -2.0 * np.tanh(50.0 * v),
    "duffing": lambda t, q, v: -4.0 * q - 30.0 * q**3 - 0.2 * v,
    "strong": lambda t, q, v: -500.0 * v**3,
}


@pytest.mark.parametrize("kind", LAWS)
@pytest.mark.parametrize("gap", [0.0, 0.05])
def test_a_struck_body_under_any_force(kind, gap):
    """After the impact both move as one body of 2 kg with 0.5 m/s."""
    law, t_end = LAWS[kind], 0.1 + gap
    motion = solve_ivp(
        lambda t, s: [s[1], float(law(t, s[0], s[1])) / 2.0], (gap, t_end), [0.0, 0.5], rtol=1e-11, atol=1e-13
    )
    coarse, fine = (
        li.simulate(struck(law, gap), dt=dt, t_end=t_end, progress=False) for dt in (t_end / 100, t_end / 200)
    )
    # The step with the impact moves the bodies by the mean of their velocities before and after it.
    assert abs(fine["z"][-1] - motion.y[0, -1]) < 0.6 * t_end / 200
    if gap == 0.0:
        assert_allclose(2.0 * fine["z"][-1] - coarse["z"][-1], motion.y[0, -1], rtol=1e-3)
    assert_allclose(fine["v_z"][-1], motion.y[1, -1], rtol=2e-2)


def test_a_struck_body_under_a_cubic_force_in_closed_form():
    """2 v' = -0.1 v³ from 0.5 m/s: v = (4 + 0.1 t)^(-1/2) and z(0.1) = 20 (√4.01 - 2) = 0.049968789."""
    coarse, fine = (
        li.simulate(struck(LAWS["cubic"]), dt=dt, t_end=0.1, progress=False)["z"][-1] for dt in (1e-3, 5e-4)
    )
    assert 2.0 * fine - coarse == pytest.approx(20.0 * (math.sqrt(4.01) - 2.0), abs=2e-8)


@pytest.mark.parametrize("system", [1, 2])
def test_the_plates_of_the_paper_with_an_orifice(system):
    """An orifice beside the Kelvin-Voigt element of the plate, while it is pushed."""
    base, c = li.load_problem(f"system-{system}"), 100.0
    scheme = li.Scheme(*base.scheme.elements, li.Load("z", lambda t, q, v: -c * v * np.sqrt(v**2 + 1e-12)))
    problem, p = li.Problem("orifice", scheme, q0=base.q0, v0=base.v0), base.parameters
    run = li.simulate(problem, dt=1e-3, t_end=0.1, progress=False)

    def velocity(push):
        """The velocity of a plate under a force, by c_o v + c v |v| = push."""
        return 2.0 * push / (p["c_o"] + math.sqrt(p["c_o"] ** 2 + 4.0 * c * abs(push)))

    def rate(t, s):
        x, v, z = s
        if system == 1:
            return [v, p["g"] - (p["k_o"] * x + p["c_o"] * v + c * v * abs(v)) / p["m"], v]
        push = p["k"] * (x - z)
        return [v, p["g"] - push / p["m"], velocity(push - p["k_o"] * z)]

    motion = solve_ivp(rate, (0.0, 0.1), [0.0, problem.v0["x"], 0.0], rtol=1e-10, atol=1e-12, max_step=1e-3)
    assert_allclose(run["x"][-1], motion.y[0, -1], rtol=1e-4)
    assert_allclose(run["z"][-1], motion.y[2, -1], rtol=1e-3)


@pytest.mark.parametrize("e", [0.0, 0.5])
def test_a_landing_under_drag(e):
    """The fall is v_t tanh(g t/v_t), and the body comes to rest."""
    g, c, H = 10.0, 0.01, 1000.0
    drag = li.Load("x", lambda t, q, v: -c * v * np.sqrt(v**2))
    scheme = li.Scheme(li.Mass("x", 1.0), li.Load("x", g), drag, li.Bumper("x", "ground", gap=H, e=e, name="R"))
    run = li.simulate(li.Problem("landing", scheme), dt=0.05, t_end=60.0, progress=False)
    first, limit = next(event for event in run.events if event.kind == "impact"), math.sqrt(g / c)
    lands = limit / g * math.acosh(math.exp(H * g / limit**2))
    assert abs(first.t - lands) < 0.05
    assert first.impulse == pytest.approx((1.0 + e) * limit * math.tanh(g * lands / limit), rel=2e-2)
    assert run["R"][-1] == pytest.approx(g, rel=1e-9)
