"""Event-driven motion of Lagrangian systems against closed forms: contacts, friction, joints, impacts, jams."""

import math
from math import cos, sin, sqrt, tan

import mpmath as mp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

import lcpimpact as li
from lcpimpact.errors import Status
from lcpimpact.integrators.event_driven import EventDriven
from lcpimpact.record import Grid, Record

G = 9.81


def follow(system, q0, v0, t_end, steps=50, status=Status.SOLVED, **options):
    """Return the record of a run with DOP853 at rtol = 1e-12, without a judgement of it."""
    problem = li.Problem(
        "system", system, q0=dict(zip(system.nodes, q0, strict=True)), v0=dict(zip(system.nodes, v0, strict=True))
    )
    grid = Grid(t_end, steps)
    t, n, nc = grid.times(0, steps), len(system.nodes), len(problem.dynamics.contacts)
    record = Record(t, *(np.full((steps + 1, n), np.nan) for _ in range(2)), t, np.full((steps + 1, nc), np.nan))
    method = EventDriven(**{"rtol": 1e-12, **options})
    with np.errstate(all="ignore"):
        carry = method.start(problem, grid, "auto", record)
        found, last = method.advance(carry, record, 0, steps)
    assert found is status
    assert np.isfinite(record.q[: last + 1]).all()
    assert np.isfinite(record.reaction[: last + 1]).all()
    return record


def instants(record, kind, contact=None):
    """Return when events of a kind happen, of one contact or of all."""
    return [each.t for each in record.events if each.kind == kind and contact in (None, each.contact)]


def first(record, kind, contact=None):
    """Return the first event of a kind."""
    return next(each for each in record.events if each.kind == kind and contact in (None, each.contact))


# ---- bodies ---------------------------------------------------------------------------------------------------------


def point(contact, gx=0.0, gy=G, Q=None):
    return li.Lagrangian("x y", M=lambda q: np.eye(2), V=lambda q: gx * q[0] + gy * q[1], Q=Q, contacts=[contact])


def floor(mu=0.0, e=0.0, e_T=0.0, belt=0.0):
    return li.FrictionContact("floor", gap=lambda t, q: q[1], slip=lambda t, q, v: v[0] - belt, mu=mu, e=e, e_T=e_T)


def ball(k=0.4, R=0.1, gravity=G, table=None, **law):
    contacts = [
        li.FrictionContact("floor", gap=lambda t, q: q[1] - R, slip=lambda t, q, v: v[0] + R * v[2], **law),
    ]
    if table:
        contacts.append(
            li.FrictionContact("table", gap=lambda t, q: table - q[1] - R, slip=lambda t, q, v: v[0] - R * v[2], **law)
        )
    return li.Lagrangian(
        "x y φ", M=lambda q: np.diag([1.0, 1.0, k * R**2]), V=lambda q: gravity * q[1], contacts=contacts
    )


def corner(name, a, b, **law):
    """The point (a, b) of a body (x, y, φ) over the floor y = 0."""
    return li.FrictionContact(
        name,
        gap=lambda t, q: q[1] + a * np.sin(q[2]) + b * np.cos(q[2]),
        slip=lambda t, q, v: v[0] - (a * np.sin(q[2]) + b * np.cos(q[2])) * v[2],
        **law,
    )


def body(J, contacts, gravity=G, **more):
    return li.Lagrangian(
        "x y φ", M=lambda q: np.diag([1.0, 1.0, J]), V=lambda q: gravity * q[1], contacts=contacts, **more
    )


def block(b, h, mu=1.0, e=0.0):
    return body((b * b + h * h) / 3.0, [corner("L", -b, -h, mu=mu, e=e), corner("R", b, -h, mu=mu, e=e)])


# ---- sliding and sticking -------------------------------------------------------------------------------------------


def test_a_block_on_an_incline_stops_and_stays():
    α, mu, v0 = math.radians(30.0), 0.7, 2.0
    run = follow(point(floor(mu), gx=-G * sin(α), gy=G * cos(α)), [0, 0], [v0, 0], 3.0)
    t = v0 / (G * (mu * cos(α) - sin(α)))
    assert_allclose(instants(run, "stick"), t, rtol=1e-13)
    assert_allclose(run.q[-1], [v0 * t / 2.0, 0.0], rtol=1e-13, atol=1e-15)
    assert_allclose(run.v[-1], 0.0, atol=1e-15)
    assert_allclose(run.reaction[-1], [G * cos(α), -G * sin(α)], rtol=1e-12)


def test_a_block_at_the_limit_of_friction_stays():
    α = 0.4
    run = follow(point(floor(tan(α)), gx=-G * sin(α), gy=G * cos(α)), [0, 0], [0, 0], 3.0)
    assert not run.events
    assert_allclose(run.q, 0.0, atol=1e-12)


def test_a_block_on_a_belt_sticks_and_slips():
    mu, k, belt = 0.3, 100.0, 0.1
    run = follow(point(floor(mu, belt=belt), Q=lambda t, q, v: np.array([-k * q[0], 0.0 * q[0]])), [0, 0], [0, 0], 1.0)
    ω, x = sqrt(k), mu * G / k
    t1 = math.asin(belt / (x * ω)) / ω
    t2 = t1 + sqrt(x**2 - (belt / ω) ** 2) / belt
    assert [each.kind for each in run.events] == ["stick", "slip"]
    assert_allclose([each.t for each in run.events], [t1, t2], rtol=1e-12)
    assert_allclose(run.q[-1, 0], x + belt / ω * sin(ω * (1.0 - t2)), rtol=1e-12)


def test_a_thrown_block_bounces_slides_and_rests():
    mu, e, vx, vy = 0.1, 0.5, 3.0, 2.0
    run = follow(point(floor(mu, e)), [0, 0], [vx, vy], 4.0)
    d = mu * (1.0 + e) * vy / (1.0 - e)
    left = vx - d
    rest = 2.0 * vy / G * (left / (1.0 - e) + d / (1.0 - e**2)) + left**2 / (2.0 * mu * G)
    assert_allclose(run.q[-1, 0], rest, rtol=1e-9)
    assert_allclose(run.v[-1], 0.0, atol=1e-15)
    assert_allclose(instants(run, "impact", "floor")[:4], 2.0 * vy / G * np.cumsum(e ** np.arange(4.0)), rtol=1e-12)
    assert_allclose(first(run, "close").t, 2.0 * vy / G / (1.0 - e), rtol=1e-8)


# ---- balls ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("mu", "e_T"), [(0.2, 0.0), (0.5, 0.0), (0.5, 0.4)])
def test_a_ball_with_spin_slides_or_rolls_after_an_impact(mu, e_T):
    slip, vy, e, k = 5.0, 3.0, 0.5, 0.4
    P = -min(mu * (1.0 + e) * vy, (1.0 + e_T) * slip * k / (1.0 + k))
    run = follow(ball(mu=mu, e=e, e_T=e_T), [0, 0.1, 0], [0, -vy, slip / 0.1], 0.1)
    assert_allclose(run.v[0], [P, e * vy, (slip + P / k) / 0.1], rtol=1e-13, atol=1e-13)
    hit, rub = run.events[:2]
    assert (hit.contact, rub.contact, hit.kind, rub.kind) == ("floor", "floor_T", "impact", "impact")
    assert_allclose([hit.impulse, rub.impulse], [(1.0 + e) * vy, P], rtol=1e-13)
    assert_allclose(hit.left.v, [0.0, -vy, slip / 0.1])


@pytest.mark.parametrize("k", [0.4, 0.5])
def test_a_ball_slides_and_then_rolls(k):
    mu, v0 = 0.2, 2.0
    run = follow(ball(k=k, mu=mu), [0, 0.1, 0], [v0, 0, 0], 1.0)
    t = v0 * k / (1.0 + k) / (mu * G)
    assert [each.kind for each in run.events] == ["stick"]
    assert_allclose(run.events[0].t, t, rtol=1e-13)
    assert_allclose(run.q[-1, 0], v0 * t - mu * G * t**2 / 2.0 + v0 / (1.0 + k) * (1.0 - t), rtol=1e-12)


def test_a_draw_shot_rolls_back():
    run = follow(ball(mu=0.2), [0, 0.1, 0], [2.0, 0, 80.0], 2.0)
    assert_allclose(run.v[-1, 0], (2.0 - 0.4 * 8.0) / 1.4, rtol=1e-12)


def test_a_super_ball_comes_back_from_under_a_table():
    run = follow(ball(mu=50.0, e=1.0, e_T=1.0, gravity=0.0, table=1.0), [0, 0.5, 0], [1.0, -1.0, 0.0], 2.4)
    assert_allclose(run.v[-1, 0], -333.0 / 343.0, rtol=1e-12)
    assert [each.contact for each in run.events if not each.contact.endswith("_T")] == ["floor", "table", "floor"]


def test_every_other_bounce_of_a_super_ball_undoes_the_last():
    run = follow(ball(mu=50.0, e=1.0, e_T=1.0), [0, 0.6, 0], [0.0, 0.0, 20.0], 1.9)
    after = [each.right.v[0] for each in run.events if each.contact == "floor"]
    assert_allclose(after[:2], [-8.0 / 7.0, 0.0], rtol=1e-12, atol=1e-12)


# ---- blocks, rods, planks -------------------------------------------------------------------------------------------


def test_a_block_rocks_from_corner_to_corner():
    b, h, φ0 = 0.1, 0.4, 0.1
    α, R = math.atan(b / h), math.hypot(b, h)
    run = follow(block(b, h), [0.0, b * sin(φ0) + h * cos(φ0), φ0], [0, 0, 0], 1.0)
    with mp.workdps(30):

        def fall(a):
            return mp.quad(
                lambda φ: 1 / mp.sqrt(mp.mpf(3) * G / (2 * R) * (mp.cos(α - a) - mp.cos(α - φ))), [0, mp.mpf(a)]
            )

        ratio = mp.mpf(1) - mp.mpf("1.5") * mp.sin(α) ** 2
        φ1 = α - mp.acos(mp.cos(α) + ratio**2 * (mp.cos(α - φ0) - mp.cos(α)))
        t = [float(fall(φ0)), float(fall(φ0) + 2 * fall(φ1))]
    hits = [each for each in run.events if each.kind == "impact" and each.contact in "LR"]
    assert [each.contact for each in hits] == ["R", "L"]
    assert_allclose([each.t for each in hits], t, rtol=1e-10)
    assert_allclose(hits[0].right.v[2] / hits[0].left.v[2], 31.0 / 34.0, rtol=1e-12)
    assert [each.contact for each in run.events if each.kind == "open"] == ["L", "R"]


def test_a_squat_block_stays_where_it_lands():
    b, h = 0.4, 0.2
    run = follow(block(b, h), [0.0, h, 0.0], [h, -b, -1.0], 0.5)
    assert {each.contact for each in run.events if each.kind == "impact"} >= {"L", "R"}
    assert_allclose(run.v, 0.0, atol=1e-15)
    assert_allclose(run.reaction[-1, [0, 2]].sum(), G, rtol=1e-13)


def test_a_block_slides_on_two_corners_and_rests_on_both():
    mu, v0 = 0.3, 1.0
    run = follow(block(0.4, 0.2, mu), [0.0, 0.2, 0.0], [v0, 0.0, 0.0], 1.0)
    assert_allclose(instants(run, "stick"), v0 / (mu * G), rtol=1e-12)
    assert_allclose(run.q[-1, 0], v0**2 / (2.0 * mu * G), rtol=1e-12)
    assert_allclose(run.v[-1], 0.0, atol=1e-15)


def test_a_block_on_two_corners_is_pushed_until_it_slips():
    mu, rate = 0.3, 5.0
    push = lambda t, q, v: np.array([rate * t, 0.0 * t, 0.2 * rate * t * 0.0])  # noqa: E731
    system = body(0.1, [corner("L", -0.4, -0.1, mu=mu), corner("R", 0.4, -0.1, mu=mu)], Q=push)
    run = follow(system, [0.0, 0.1, 0.0], [0, 0, 0], 1.0)
    t = mu * G / rate
    assert_allclose(instants(run, "slip"), t, rtol=1e-9)
    assert {each.contact for each in run.events if each.kind == "slip"} == {"L_T", "R_T"}
    s = 1.0 - t
    assert_allclose(run.q[-1, 0], rate * s**3 / 6.0, rtol=1e-9)


def test_a_falling_rod_slips():
    mu, L, θ = 0.3, 1.0, 0.1
    φ, ω = math.pi / 2.0 - θ, sqrt(3.0 * G / L * (1.0 - cos(θ)))
    system = body(L**2 / 12.0, [corner("tip", -L / 2.0, 0.0, mu=mu)])
    run = follow(
        system, [L / 2 * cos(φ), L / 2 * sin(φ), φ], [L / 2 * sin(φ) * ω, -L / 2 * cos(φ) * ω, -ω], 0.5
    )  # fmt: skip
    with mp.workdps(30):
        ratio = lambda x: 3 * mp.sin(x) * (3 * mp.cos(x) - 2) / (1 - 3 * mp.cos(x)) ** 2 - mp.mpf(mu)  # noqa: E731
        slips = float(mp.findroot(ratio, 0.4))
    assert_allclose(math.pi / 2.0 - first(run, "slip").left.q[2], slips, rtol=1e-12)


def test_a_plank_slips_over_an_edge():
    mu, L, a = 0.4, 1.0, 0.2
    along = lambda q, v: v[0] * np.cos(q[2]) + v[1] * np.sin(q[2])  # noqa: E731
    height = lambda q: q[1] * np.cos(q[2]) - q[0] * np.sin(q[2])  # noqa: E731
    edge = li.FrictionContact(
        "edge", gap=lambda t, q: height(q), slip=lambda t, q, v: along(q, v) + v[2] * height(q), mu=mu
    )
    run = follow(body(L**2 / 12.0, [edge]), [a, 0, 0], [0, 0, 0], 0.5)
    assert_allclose(-first(run, "slip").left.q[2], math.atan(mu / (1.0 + 36.0 * a**2 / L**2)), rtol=1e-11)


def test_a_disc_rolls_in_a_bowl():
    R, r, k, θ0 = 1.0, 0.1, 0.5, 0.6
    roll = li.FrictionContact(
        "bowl",
        gap=lambda t, q: (R - r) - np.sqrt(q[0] ** 2 + q[1] ** 2),
        slip=lambda t, q, v: (v[1] * q[0] - v[0] * q[1]) / np.sqrt(q[0] ** 2 + q[1] ** 2) + r * v[2],
        mu=1.0,
    )
    with mp.workdps(30):
        quarter = float(mp.sqrt((1 + k) * (R - r) / mp.mpf(G)) * mp.ellipk(mp.sin(mp.mpf(θ0) / 2) ** 2))
    run = follow(body(k * r**2, [roll]), [(R - r) * sin(θ0), -(R - r) * cos(θ0), 0], [0, 0, 0], quarter)
    assert not run.events
    assert_allclose(run.q[-1], [0.0, -(R - r), θ0 * (R - r) / r], rtol=1e-11, atol=1e-11)
    assert_allclose(np.hypot(run.q[:, 0], run.q[:, 1]), R - r, rtol=1e-15)


# ---- pendulums ------------------------------------------------------------------------------------------------------


def test_a_pendulum_strikes_a_wall():
    e, φ0, wall = 0.8, -1.0, 0.3
    system = li.Lagrangian(
        "φ", M=lambda q: np.array([[1.0 + 0.0 * q[0]]]), V=lambda q: -G * np.cos(q[0]),
        contacts=[li.FrictionContact("wall", gap=lambda t, q: sin(wall) - np.sin(q[0]), e=e)],
    )  # fmt: skip
    run = follow(system, [φ0], [0.0], 4.0)
    with mp.workdps(30):
        unit = mp.sqrt(1 / mp.mpf(G))
        m, end = mp.sin(mp.mpf(φ0) / 2) ** 2, mp.sin(mp.mpf(wall) / 2) ** 2
        part = lambda m: unit * mp.ellipf(mp.asin(mp.sqrt(end / m)), m)  # noqa: E731
        times = [unit * mp.ellipk(m) + part(m)]
        for _ in range(2):
            m = end + mp.mpf(e) ** 2 * (m - end)
            times.append(times[-1] + 2 * unit * mp.ellipk(m) + 2 * part(m))
    assert_allclose(instants(run, "impact")[:3], [float(t) for t in times], rtol=1e-11)


def test_a_double_pendulum_strikes_a_stop():
    c = lambda q: np.cos(q[0] - q[1])  # noqa: E731
    system = li.Lagrangian(
        "a b", M=lambda q: np.array([[2.0, c(q)], [c(q), 1.0]]), V=lambda q: -G * (2 * np.cos(q[0]) + np.cos(q[1])),
        contacts=[li.FrictionContact("stop", gap=lambda t, q: 0.2 - np.sin(q[0]) - np.sin(q[1]), e=0.5)],
    )  # fmt: skip
    run = follow(system, [-0.8, -0.3], [0, 0], 1.0)

    def rate(t, y):
        a, b, u, w = y
        c, d = cos(a - b), sin(a - b)
        A, B = -d * w * w - 2 * G * sin(a), d * u * u - G * sin(b)
        return [u, w, (A - c * B) / (2 - c * c), (2 * B - c * A) / (2 - c * c)]

    def touches(t, y):
        return 0.2 - sin(y[0]) - sin(y[1])

    touches.terminal = True
    free = solve_ivp(
        rate, (0.0, 1.0), [-0.8, -0.3, 0.0, 0.0], "DOP853", events=touches, rtol=1e-13, atol=1e-15, max_step=0.01
    )
    a, b, u, w = free.y[:, -1]
    M, H = np.array([[2.0, cos(a - b)], [cos(a - b), 1.0]]), np.array([-cos(a), -cos(b)])
    P = -1.5 * (H @ [u, w]) / (H @ np.linalg.solve(M, H))
    # The instant is that of a Taylor series in 20 digits, too.
    assert_allclose([instants(run, "impact")[0], free.t[-1]], 0.746122042951, rtol=1e-12)
    assert_allclose(run.events[0].impulse, P, rtol=1e-11)
    assert_allclose(run.events[0].right.v, [u, w] + P * np.linalg.solve(M, H), rtol=1e-10)


def rod_on_a_pin(L=1.0, e=0.8):
    wall = li.FrictionContact("wall", gap=lambda t, q: L * sin(0.3) - q[0] - L / 2 * np.sin(q[2]), e=e)
    pin = [
        li.Joint("J1", gap=lambda t, q: q[0] - L / 2 * np.sin(q[2])),
        li.Joint("J2", gap=lambda t, q: q[1] + L / 2 * np.cos(q[2])),
    ]
    return body(L**2 / 12.0, [wall], joints=pin)


def test_a_rod_on_a_pin_moves_as_in_one_coordinate():
    L, e = 1.0, 0.8
    one = li.Lagrangian(
        "φ", M=lambda q: np.array([[L**2 / 3 + 0.0 * q[0]]]), V=lambda q: -G * L / 2 * np.cos(q[0]),
        contacts=[li.FrictionContact("wall", gap=lambda t, q: L * (sin(0.3) - np.sin(q[0])), e=e)],
    )  # fmt: skip
    of_one = follow(one, [-1.0], [0.0], 2.0)
    of_three = follow(rod_on_a_pin(), [L / 2 * sin(-1.0), -L / 2 * cos(-1.0), -1.0], [0, 0, 0], 2.0)
    assert_allclose(of_three.q[:, 2], of_one.q[:, 0], rtol=1e-10, atol=1e-10)
    assert_allclose(instants(of_three, "impact", "wall"), instants(of_one, "impact"), rtol=1e-11)
    φ, ω = of_three.q[:, 2], of_three.v[:, 2]
    # Joints do not drift: what is left is rounding.
    assert_allclose(of_three.q[:, 0], L / 2 * np.sin(φ), atol=1e-15)
    assert_allclose(of_three.v[:, 1], L / 2 * np.sin(φ) * ω, atol=1e-14)
    hit = {each.contact: each.impulse for each in of_three.events[:3]}
    assert hit.keys() == {"wall", "J1", "J2"}


# ---- impacts of several contacts ------------------------------------------------------------------------------------


def test_three_pendulums_in_touch_share_an_impact_by_newtons_law():
    gaps = [
        li.FrictionContact("A", gap=lambda t, q: np.sin(q[1]) - np.sin(q[0]), e=1.0),
        li.FrictionContact("B", gap=lambda t, q: np.sin(q[2]) - np.sin(q[1]), e=1.0),
    ]
    system = li.Lagrangian(
        "a b c", M=lambda q: np.eye(3), V=lambda q: -G * (np.cos(q[0]) + np.cos(q[1]) + np.cos(q[2])), contacts=gaps
    )
    run = follow(system, [0, 0, 0], [1.0, 0, 0], 0.2)
    assert_allclose(run.v[0], [-1 / 3, 2 / 3, 2 / 3], rtol=1e-14)
    assert {each.law for each in run.events if each.kind == "impact"} == {"newton"}


def test_a_wedge_billiard_is_two_bouncing_balls():
    a = sqrt(0.5)
    walls = [
        li.FrictionContact("A", gap=lambda t, q: a * (q[1] - q[0]), e=1.0),
        li.FrictionContact("B", gap=lambda t, q: a * (q[1] + q[0]), e=1.0),
    ]
    system = li.Lagrangian("x y", M=lambda q: np.eye(2), V=lambda q: G * q[1], contacts=walls)
    run = follow(system, [0.3, 1.0], [0, 0], 3.0)

    def bounced(height):
        g = G * a
        T = sqrt(2.0 * height / g)
        s = (3.0 + T) % (2.0 * T) - T
        return height - g * s**2 / 2.0

    u, w = bounced(a * 0.7), bounced(a * 1.3)
    assert_allclose(run.q[-1], [a * (w - u), a * (w + u)], rtol=1e-11)


def kane(e_T):
    tip = li.FrictionContact(
        "tip", gap=lambda t, q: cos(math.radians(20)) + cos(math.radians(30)) - np.cos(q[0]) - np.cos(q[1]),
        slip=lambda t, q, v: np.cos(q[0]) * v[0] + np.cos(q[1]) * v[1], mu=0.5, e=0.5, e_T=e_T,
    )  # fmt: skip
    c = lambda q: np.cos(q[0] - q[1])  # noqa: E731
    return li.Lagrangian("a b", M=lambda q: np.array([[4 / 3, c(q) / 2], [c(q) / 2, 1 / 3]]), contacts=[tip])


def test_kanes_pendulum_gains_energy_by_newtons_law():
    a, b = math.radians(20), math.radians(30)
    M = np.array([[4 / 3, cos(a - b) / 2], [cos(a - b) / 2, 1 / 3]])
    H = np.array([[sin(a), sin(b)], [cos(a), cos(b)]])
    before = np.array([-0.1, -0.2])
    run = follow(kane(0.0), [a, b], before, 1e-3)
    # It sticks: U_N⁺ = -e U_N⁻ and U_T⁺ = 0.
    after = np.linalg.solve(H, [-0.5 * H[0] @ before, 0.0])
    assert_allclose(run.v[0], after, rtol=1e-12)
    energy = [0.5 * v @ M @ v for v in (before, run.v[0])]
    assert_allclose(energy, [0.0231814108635, 0.0368003665813], rtol=1e-11)
    P = np.linalg.solve(H @ np.linalg.solve(M, H.T), H @ (after - before))
    assert_allclose([each.impulse for each in run.events[:2]], P, rtol=1e-12)
    assert abs(P[1]) < 0.5 * P[0]


def test_kanes_pendulum_gains_none_if_both_coefficients_are_equal():
    a, b = math.radians(20), math.radians(30)
    M = np.array([[4 / 3, cos(a - b) / 2], [cos(a - b) / 2, 1 / 3]])
    for angle in np.linspace(0.1, 6.2, 13):
        before = np.array([cos(angle), sin(angle)])
        after = follow(kane(0.5), [a, b], before, 1e-3).v[0]
        assert after @ M @ after <= before @ M @ before * (1.0 + 1e-12)


# ---- Painlevé -------------------------------------------------------------------------------------------------------


def rod(mu=5 / 3, gravity=10.0):
    return body(1.0 / 3.0, [corner("tip", -1.0, 0.0, mu=mu)], gravity)


def test_an_impact_without_collision():
    φ, V = math.radians(60), 30.0
    run = follow(rod(), [0, sin(φ), φ], [-V, 0, 0], 1e-3)
    W = np.array([[1 + 3 * cos(φ) ** 2, -3 * sin(φ) * cos(φ)], [-3 * sin(φ) * cos(φ), 1 + 3 * sin(φ) ** 2]])
    P = -np.linalg.solve(W, [0, -V])
    assert [(each.contact, each.kind) for each in run.events[:2]] == [("tip", "jam"), ("tip_T", "jam")]
    assert_allclose([each.impulse for each in run.events[:2]], P, rtol=1e-12)
    assert_allclose(run.v[0, 2], 3 * (sin(φ) * P[1] - cos(φ) * P[0]), rtol=1e-12)
    energy = lambda v: 0.5 * (v[0] ** 2 + v[1] ** 2 + v[2] ** 2 / 3)  # noqa: E731
    assert_allclose(energy(np.array([-V, 0, 0])) - energy(run.v[0]), V * P[1] / 2, rtol=1e-12)


def test_two_accelerations_are_refused():
    φ = math.radians(60)
    ω = 5.0
    v0 = [-30.0, cos(φ) * ω, ω]
    with pytest.raises(li.UnsupportedError, match="several motions"):
        follow(rod(), [0, sin(φ), φ], v0, 1e-3)


def test_a_rod_slides_into_a_singular_point_and_jams():
    mu, gravity = 5 / 3, 10.0
    φ0, φ1 = math.radians(31), math.pi / 4
    run = follow(rod(mu, gravity), [0, sin(φ0), φ0], [-30.0, 0, 0], 1.0)
    jam = first(run, "jam", "tip")

    # p and the free normal acceleration are zero at 45° together. In σ, with φ = 45° - σ³, the motion is smooth.
    def force(σ, ω):
        δ = σ**3
        return (gravity - ω**2 * sin(φ1 - δ)) / (1.5 * sin(2.0 * δ) + 5.0 * sin(δ) ** 2)

    def rate(σ, y):
        φ, (ω, _, _) = φ1 - σ**3, y
        N = force(σ, ω)
        α = 3.0 * N * (mu * sin(φ) - cos(φ))
        return -3.0 * σ**2 / ω * np.array([α, mu * N + sin(φ) * α + cos(φ) * ω**2, 1.0])

    sample = follow(rod(mu, gravity), [0, sin(φ0), φ0], [-30.0, 0, 0], 0.5, steps=1)
    q, v = sample.q[-1], sample.v[-1]
    start = [v[2], v[0] + sin(q[2]) * v[2], 0.5]
    smooth = solve_ivp(rate, ((φ1 - q[2]) ** (1 / 3), 1e-4), start, "DOP853", rtol=1e-12, atol=1e-14)
    ω, slip, t = smooth.y[:, -1]
    assert_allclose(ω, sqrt(gravity / sin(φ1)), rtol=1e-7)
    assert_allclose(jam.left.q[2], φ1, rtol=1e-10)
    assert_allclose(jam.t, t, rtol=1e-10)
    assert_allclose(jam.left.v[2], ω, rtol=1e-6)
    # It sticks: W P = (0, -U_T) with W = [[2.5, -1.5], [-1.5, 2.5]] at 45°.
    P = np.linalg.solve([[2.5, -1.5], [-1.5, 2.5]], [0.0, -slip])
    assert_allclose([jam.impulse, first(run, "jam", "tip_T").impulse], P, rtol=1e-6)
    assert_allclose(jam.right.v[2], ω + 3.0 * sin(φ1) * (P[1] - P[0]), rtol=1e-7)


@pytest.mark.parametrize("solver", ["RK45", "Radau"])
@pytest.mark.parametrize("rtol", [1e-5, 1e-8])
def test_the_jam_does_not_depend_on_the_solver(solver, rtol):
    φ = math.radians(31)
    run = follow(rod(), [0, sin(φ), φ], [-30.0, 0, 0], 1.0, rtol=rtol, ode_solver=solver)
    jam = first(run, "jam", "tip")
    assert_allclose(jam.t, 0.8145496587, rtol=10.0 * rtol)
    assert_allclose([jam.impulse, jam.right.v[2]], [3.499916751, 8.710232736], rtol=10.0 * rtol + 1e-6)


# ---- accumulating impacts, and long runs ----------------------------------------------------------------------------


def test_a_rod_tumbles_to_rest_on_both_ends():
    mu, e, g = 0.3, 0.5, G
    ends = [corner("L", -0.5, 0.0, mu=mu, e=e), corner("R", 0.5, 0.0, mu=mu, e=e)]
    run = follow(body(1.0 / 12.0, ends, g), [0.0, 1.0, 0.3], [0, 0, 0], 2.0)
    # The first impact is that of a free fall; the others are those of a second program.
    hits = [each.t for each in run.events if each.kind == "impact" and each.contact in "LR"]
    assert_allclose(hits[0], sqrt(2.0 * (1.0 - 0.5 * sin(0.3)) / g), rtol=1e-12)
    assert_allclose(hits[1:4], [0.458709243712, 0.481580010953, 0.696073682421], rtol=1e-11)
    assert_allclose(run.q[-1, 1:], 0.0, atol=1e-9)
    assert_allclose(run.v[-1], 0.0, atol=1e-15)
    assert_allclose(run.reaction[-1, [0, 2]], g / 2.0, rtol=1e-8)


def woodpecker():
    rO, rM, hM, lM, lG, hS, lS = 0.0025, 0.0031, 0.0058, 0.010, 0.015, 0.02, 0.0201
    mM, mS, JM, JS, c = 0.0003, 0.0045, 5e-9, 7e-7, 0.0056
    M = np.array(
        [
            [mS + mM, mS * lM, mS * lG],
            [mS * lM, JM + mS * lM**2, mS * lM * lG],
            [mS * lG, mS * lM * lG, JS + mS * lG**2],
        ]
    )
    V = lambda q: c / 2 * (q[1] - q[2]) ** 2 + G * ((mS + mM) * q[0] + mS * lM * q[1] + mS * lG * q[2])  # noqa: E731
    contacts = [
        li.FrictionContact(
            "beak", gap=lambda t, q: lM + lG - lS - rO - hS * q[2],
            slip=lambda t, q, v: v[0] + lM * v[1] + (lG - lS) * v[2], mu=0.3, e=0.5,
        ),
        li.FrictionContact(
            "low", gap=lambda t, q: rM - rO + hM * q[1], slip=lambda t, q, v: v[0] + rM * v[1], mu=0.3
        ),
        li.FrictionContact(
            "up", gap=lambda t, q: rM - rO - hM * q[1], slip=lambda t, q, v: v[0] + rM * v[1], mu=0.3
        ),
    ]  # fmt: skip
    return li.Lagrangian("y a b", M=lambda q: M, V=V, contacts=contacts)


def test_a_woodpecker_returns_to_its_start():
    start = [0.0, -0.0006 / 0.0058, -0.2051353492435296], [0.0, 0.0, 17.574666205577]
    run = follow(woodpecker(), *start, 0.2, rtol=1e-11)
    slips = [each for each in run.events if each.kind == "slip" and each.contact == "low_T"]
    # The state is a fixed point of the map from slip to slip, by Newton's method on it.
    again = slips[-1]
    assert_allclose(again.t, 0.14597606514, rtol=1e-9)
    assert_allclose([again.left.v[2], -again.left.q[0]], [17.574666205577, 0.01944537928], rtol=1e-8)
    assert_allclose(again.left.q[1:], start[0][1:], rtol=1e-9)


@pytest.mark.parametrize(
    ("system", "q0", "v0", "t_end", "kinds"),
    [
        (ball(mu=0.2, e=0.5), {"y": 0.6}, {"φ": 50.0}, 1.0, {"impact", "close", "stick"}),
        (rod_on_a_pin(), {"x": 0.5 * sin(-1), "y": -0.5 * cos(-1), "φ": -1.0}, {}, 2.0, {"impact"}),
        (rod(), {"y": sin(math.radians(31)), "φ": math.radians(31)}, {"x": -30.0}, 1.0, {"jam", "open"}),
    ],
    ids=["ball", "pin", "jam"],
)
def test_runs_are_judged_to_obey_their_laws(system, q0, v0, t_end, kinds):
    run = li.simulate(li.Problem("system", system, q0=q0, v0=v0), "event-driven", dt=t_end / 100, t_end=t_end)
    assert run.success
    assert {each.kind for each in run.events} == kinds


@pytest.mark.parametrize("rtol", [1e-6, 1e-7, 1e-8, 1e-10])
def test_a_block_that_slides_to_rest_on_both_corners_stays_there(rtol):
    problem = li.load_problem("block-on-corners")
    run = li.simulate(problem, "event-driven", dt=problem.t_end / 20, rtol=rtol, max_events=20, error=False)
    assert [event.kind for event in run.events] == ["stick", "stick"]
