"""Bodies as elements: against Lagrangian systems, linear schemes and closed forms; what they refuse."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest
from numpy.testing import assert_allclose

import lcpimpact as li
from lcpimpact.scheme.lagrangian import LagrangianDynamics

FLOOR = li.Wall("floor", li.Line((0.0, 0.0), (1.0, 0.0)))
R, G = 0.1, 9.81


def ball(shape=None, name="ball", m=1.0, k=0.4, g=G):
    return li.Body(name, m, k * m * R * R, shape or li.Disk(R), g)


def problem(*elements, t_end=1.0, q0=None, v0=None):
    return li.Problem("bodies", li.Scheme(*elements), q0 or {}, v0 or {}, t_end)


def prefixed(name, values):
    return {f"{name}.{node}": value for node, value in values.items()}


def as_bodies(registered, *elements, name="b", **parameters):
    """Return a registered problem of one body, and the same of elements with a body of that name."""
    given = li.load_problem(registered, **parameters)
    ours = problem(*elements, t_end=given.t_end, q0=prefixed(name, given.q0), v0=prefixed(name, given.v0))
    return ours, given


# ---- linear where directions are fixed --------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["moreau-jean", "exact", "event-driven"])
def test_a_ball_on_a_floor_has_the_rows_of_a_bumper_and_friction(method):
    more = (li.Spring("ball.x", "ground", 30.0), li.Dashpot("ball.y", "ground", 0.2))
    ours = problem(ball(), FLOOR, li.Touch("ball", "floor", e=0.5, e_T=0.3, mu=0.2), *more, q0={"ball.y": 0.6},
                   v0={"ball.φ": 50.0})  # fmt: skip
    up, rim = {"ball.y": 1.0}, {"ball.x": 1.0, "ball.φ": R}
    masses = (li.Mass("ball.x", 1.0), li.Mass("ball.y", 1.0), li.Mass("ball.φ", 0.4 * R * R), li.Load("ball.y", -G))
    rows = (li.Bumper("ground", up, -R, 0.5, "N"), li.Friction("ground", rim, 0.2, "N", 0.3, "N_T"))
    theirs = li.Problem("linear", li.Scheme(*masses, *rows, *more), ours.q0, ours.v0)
    assert not isinstance(ours.dynamics, LagrangianDynamics)
    for name in ("M", "C", "K", "H", "u0", "restitution", "mu"):
        assert_allclose(getattr(ours.dynamics, name), getattr(theirs.dynamics, name), rtol=1e-15, atol=0.0)
    a, b = (li.simulate(each, method, dt=1e-3, error=False) for each in (ours, theirs))
    assert_allclose(a.q, b.q, rtol=0.0, atol=1e-12)
    assert_allclose(a["N_T"], b["N_T"], rtol=0.0, atol=1e-10)
    assert np.ptp(a["ball.x"]) > 0.1


def test_a_ball_with_spin_is_that_of_a_lagrangian_system():
    touch = li.Touch("b", "floor", e=0.5, mu=0.2)
    ours, given = as_bodies("ball-with-spin", ball(name="b"), FLOOR, touch)
    a, b = (li.simulate(each, dt=1e-3, t_end=0.8, error=False) for each in (ours, given))
    assert_allclose(a.q, b.q, rtol=0.0, atol=1e-12)
    assert np.ptp(a["b.x"]) > 0.1


def test_a_slope_turns_the_normal_and_pins_and_guides_through_the_centre_are_linear():
    slope = li.Wall("slope", li.Line((0.0, 0.0), (2.0, 1.0)), x=0.5, y=-0.25)
    d = problem(ball(), slope, li.Touch("ball", "slope", e=0.0, mu=0.1), q0={"ball.y": 1.0}).dynamics
    n = np.array([-1.0, 2.0]) / math.sqrt(5.0)
    assert_allclose(d.H, [[*n, 0.0], [n[1], -n[0], R]], atol=1e-15)
    assert_allclose(d.u0[0], -R - n @ [0.5, -0.25], atol=1e-15)
    pin, guide = li.Pin("ball", (0.0, 0.0), "ground", (0.2, 0.3)), li.Guide("ball", (0.0, 0.0), FLOOR.shape, phi=0.5)
    d = problem(ball(), pin, q0={"ball.x": 0.2, "ball.y": 0.3}).dynamics
    assert_allclose(np.hstack([d.H, d.u0[:, None]]), [[1.0, 0.0, 0.0, -0.2], [0.0, 1.0, 0.0, -0.3]])
    d = problem(ball(), guide, q0={"ball.φ": 0.5}).dynamics
    assert [each.name for each in d.contacts] == ["J", "J.φ"]
    assert_allclose(np.hstack([d.H, d.u0[:, None]]), [[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -0.5]])


# ---- directions that turn ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ends", [("b", "bowl"), ("bowl", "b")])
def test_a_disc_in_a_bowl_is_that_of_a_lagrangian_system(ends):
    bowl = li.Wall("bowl", li.Disk(1.0, hollow=True))
    ours, given = as_bodies("disc-in-bowl", ball(name="b", k=0.5), bowl, li.Touch(*ends, e=0.0, mu=1.0))
    a, b = (li.simulate(each, dt=2e-3, t_end=2.0, error=False) for each in (ours, given))
    assert_allclose(a.q, b.q, rtol=0.0, atol=1e-12)
    assert_allclose(a.reaction, b.reaction, rtol=0.0, atol=1e-9)
    assert ours.units == {"b.φ": "rad"}


@pytest.mark.parametrize("method", ["moreau-jean", "event-driven"])
def test_a_rocking_polygon_is_the_block_on_two_corners(method):
    corners = [(-0.1, -0.4), (0.1, -0.4), (0.1, 0.4), (-0.1, 0.4)]
    block = li.Body("b", 1.0, 0.17 / 3.0, li.Polygon(corners), G)
    ours, given = as_bodies("rocking-block-bodies", block, FLOOR, li.Touch("b", "floor", e=0.0, mu=1.0, name="C"))
    assert [each.name for each in ours.dynamics.contacts][:4] == ["C.1", "C.1_T", "C.2", "C.2_T"]
    assert len(ours.dynamics.contacts) == 8
    a, b = (li.simulate(each, method, dt=2e-3, t_end=0.5, error=False) for each in (ours, given))
    assert_allclose(a.q, b.q, rtol=0.0, atol=1e-9)
    assert np.ptp(a["b.φ"]) > 0.1


def double_pendulum(phi, L=1.0, m=1.0):
    """Return a double pendulum of two rods, by bodies with pins and by its two angles from the vertical."""
    rods = [li.Body(name, m, m * L * L / 12.0, li.Line((0.0, 0.5 * L), (0.0, -0.5 * L)), G) for name in "AB"]
    upper, lower = (0.0, 0.5 * L), (0.0, -0.5 * L)
    (s, t), (c, d) = np.sin(phi), np.cos(phi)
    q0 = {"A.x": 0.5 * L * s, "A.y": -0.5 * L * c, "A.φ": phi[0],
          "B.x": L * s + 0.5 * L * t, "B.y": -L * c - 0.5 * L * d, "B.φ": phi[1]}  # fmt: skip
    bodies = problem(*rods, li.Pin("A", upper), li.Pin("A", lower, "B", upper), q0=q0)

    def M(q):
        coupling = 0.5 * m * L * L * np.cos(q[0] - q[1])
        return np.array([[4.0 / 3.0 * m * L * L, coupling], [coupling, m * L * L / 3.0]])

    two = li.Lagrangian("α β", M=M, V=lambda q: -m * G * L * (1.5 * np.cos(q[0]) + 0.5 * np.cos(q[1])))
    return bodies, li.Problem("two angles", two, q0={"α": phi[0], "β": phi[1]})


def test_a_double_pendulum_of_pinned_rods_converges_to_that_of_two_angles_with_order_2():
    bodies, two = double_pendulum(np.array([1.0, -0.5]))
    exact = li.simulate(two, "event-driven", dt=0.05, error=False)

    def error(dt):
        run = li.simulate(bodies, dt=dt, error=False)
        return max(abs(run["A.φ"][-1] - exact["α"][-1]), abs(run["B.φ"][-1] - exact["β"][-1]))

    coarse, fine = error(0.0025), error(0.00125)
    assert coarse < 1e-4
    assert math.log2(coarse / fine) == pytest.approx(2.0, abs=0.15)
    run = li.simulate(bodies, dt=0.01, error=False)
    assert np.abs(np.hypot(run["A.x"], run["A.y"]) - 0.5).max() < 1e-6


@pytest.mark.parametrize("mu", [0.05, 2.0])
def test_two_discs_collide_off_centre_by_the_laws_of_impact(mu):
    """Momentum, angular momentum, U_N⁺ = -e U_N⁻, and friction that slides or sticks, with radii and masses that differ."""
    e, e_T, a, b, m, M = 0.6, 0.4, 0.1, 0.25, 1.0, 3.0
    A = li.Body("A", m, 0.5 * m * a * a, li.Disk(a))
    B = li.Body("B", M, 0.4 * M * b * b, li.Disk(b))
    v0 = {"A.x": 2.0, "A.φ": 7.0, "B.φ": -3.0, "B.y": 0.5}
    p = problem(A, B, li.Touch("A", "B", e=e, e_T=e_T, mu=mu), q0={"A.x": -1.0, "A.y": 0.1}, v0=v0)
    assert isinstance(p.dynamics, LagrangianDynamics)
    run = li.simulate(p, "event-driven", dt=0.01, error=False)
    event = next(each for each in run.events if each.kind == "impact")
    q, u, w = event.left.q, event.left.v, event.right.v
    n = (q[:2] - q[3:5]) / (a + b)
    assert np.linalg.norm(n) == pytest.approx(1.0, abs=1e-9)
    t = np.array([n[1], -n[0]])

    def rates(v):
        return n @ (v[:2] - v[3:5]), t @ (v[:2] - v[3:5]) + a * v[2] + b * v[5]

    P = m * (w[:2] - u[:2])
    assert_allclose(M * (w[3:5] - u[3:5]), -P, atol=1e-12)
    (U_N, U_T), (V_N, V_T) = rates(u), rates(w)
    assert pytest.approx(-e * U_N, abs=1e-10) == V_N
    # Friction turns both discs alike: the moments about the centres are R P_T.
    assert_allclose([A.J * (w[2] - u[2]), B.J * (w[5] - u[5])], [a * P @ t, b * P @ t], atol=1e-12)
    stuck = -(1.0 + e_T) * U_T / (1.0 / m + 1.0 / M + a * a / A.J + b * b / B.J)
    slides = abs(stuck) > mu * (P @ n)
    assert slides == (mu < 1.0)
    assert P @ t == pytest.approx(math.copysign(mu * (P @ n), stuck) if slides else stuck, abs=1e-10)
    assert slides or pytest.approx(-e_T * U_T, abs=1e-10) == V_T


def test_slip_is_the_rate_of_the_material_points_for_every_pair():
    """U_T = t·(v of the point of A - v of the point of B), both found by moving the points with their bodies."""
    square = li.Polygon([(-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.1, 0.1)])
    q = np.array([0.3, 1.1, 0.4, -0.2, 0.1, 0.7])
    v = np.array([1.3, -0.4, 2.0, 0.6, 0.9, -1.7])
    for a, b, points in (
        (li.Disk(0.1), li.Line((0.3, 0.2), (-0.1, 0.5)), None),
        (square, li.Line((0.3, 0.2), (-0.1, 0.5)), square.points),
        (li.Disk(0.1), li.Disk(0.3), None),
        (li.Disk(0.1), li.Disk(3.0, hollow=True), None),
    ):
        scheme = li.Scheme(li.Body("A", 1.0, 1.0, a), li.Body("B", 1.0, 1.0, b), li.Touch("A", "B", e=0.0, mu=0.5))
        rows = scheme.assemble().rows(0.0, q, v)
        U = rows.rates(v)
        for i in range(0, len(U), 2):
            n = rows.H[i, :2]
            at = q[:2] - a.R * n if points is None else q[:2] + turned(q[2]) @ points[i // 2]
            foot = at - rows.g[i] * n
            of_A, of_B = (
                w[:2] + w[2] * np.array([-(p - c)[1], (p - c)[0]])
                for w, p, c in ((v[:3], at, q[:2]), (v[3:], foot, q[3:5]))
            )
            assert U[i + 1] == pytest.approx([n[1], -n[0]] @ (of_A - of_B), abs=1e-13), (a, b)
            assert np.linalg.norm(n) == pytest.approx(1.0)


def turned(φ):
    return np.array([[math.cos(φ), -math.sin(φ)], [math.sin(φ), math.cos(φ)]])


def test_a_rod_touches_by_its_ends_and_a_peg_from_outside():
    rod = li.Body("rod", 1.0, 1.0 / 12.0, li.Line((-0.5, 0.0), (0.5, 0.0)), G)
    for ends in (("rod", "floor"), ("floor", "rod")):
        d = li.Scheme(rod, FLOOR, li.Touch(*ends, e=0.0)).assemble()
        assert [each.name for each in d.contacts] == ["N.1", "N.2"]
        q = np.array([0.0, 0.6, 0.3])
        assert_allclose(d.rows(0.0, q, q).g, 0.6 + 0.5 * math.sin(0.3) * np.array([-1.0, 1.0]), rtol=1e-14)
    peg = li.Wall("peg", li.Disk(0.2), x=0.1, y=-0.5)
    d = li.Scheme(rod, peg, li.Touch("peg", "rod", e=0.0)).assemble()
    q = np.array([0.3, -0.1, 0.0])  # the rod is free on its left: the peg is on its right, below
    assert d.rows(0.0, q, q).g[0] == pytest.approx(-0.4 - 0.2)


# ---- other elements beside them ---------------------------------------------------------------------------------------


def test_elements_act_on_the_nodes_of_bodies_as_the_functions_of_a_lagrangian_system():
    """Springs, dashpots, loads of all kinds, a moved table, bumpers with friction and links beside a pin that turns."""
    J, k, c = 0.05, 40.0, 0.3
    table = li.PrescribedMotion("table", li.Harmonic(0.1, 3.0, -0.5 * math.pi))
    ours = problem(
        li.Spring("table", "rod.x", k), table, li.Dashpot("table", "rod.x", c),
        li.Body("rod", 2.0, J, g=G), li.Pin("rod", (0.0, 0.5)), li.Dashpot("rod.φ", "ground", c),
        li.Load("rod.x", li.Harmonic(3.0, 2.0) + 1.0), li.Load("rod.y", li.Polynomial([0.5, -0.25, 0.125])),
        li.Load("rod.φ", lambda t: np.sin(2.0 * t)), li.Load("rod.φ", lambda t, q, v: -0.1 * v**3),
        li.Force(("rod.x", "rod.φ"), lambda t, q, v: [0.2 * q[1], -0.2 * q[0]]),
        li.Bumper("ground", {"rod.x": -1.0, "rod.φ": -0.5}, 0.05, 0.4, "stop"),
        li.Friction("ground", {"rod.y": 1.0}, 0.1, "stop", name="rub"),
        q0={"rod.y": -0.5},
    )  # fmt: skip

    def Q(t, q, v):
        y, rate = 0.1 * np.sin(3.0 * t), 0.3 * np.cos(3.0 * t)
        return np.array([
            k * (y - q[0]) + c * (rate - v[0]) + 3.0 * np.cos(2.0 * t) + 1.0 + 0.2 * q[2],
            -2.0 * G + 0.5 - 0.25 * t + 0.125 * t**2,
            -c * v[2] + np.sin(2.0 * t) - 0.1 * v[2] ** 3 - 0.2 * q[0],
        ])  # fmt: skip

    stop = li.FrictionContact("stop", lambda t, q: 0.05 - q[0] - 0.5 * q[2], lambda t, q, v: v[1], 0.1, 0.4)
    joints = [
        li.Joint("J.x", lambda t, q: q[0] - 0.5 * np.sin(q[2])), li.Joint("J.y", lambda t, q: q[1] + 0.5 * np.cos(q[2]))
    ]  # fmt: skip
    theirs = li.Lagrangian("x y φ", M=lambda q: np.diag([2.0, 2.0, J]), Q=Q, contacts=[stop], joints=joints)
    assert ours.dynamics.nodes == ("rod.x", "rod.y", "rod.φ")
    assert ours.dynamics.rows(0.0, np.ones(3), np.ones(3)).g[1] == 0.0, "friction has no gap"
    a, b = (li.simulate(each, dt=1e-3, error=False) for each in (ours, li.Problem("b", theirs, q0={"y": -0.5})))
    assert_allclose(a.q, b.q, rtol=0.0, atol=1e-11)
    assert_allclose(a.reaction, b.reaction, rtol=0.0, atol=1e-7)
    assert a.reaction.any(axis=0).all()


def test_a_floor_that_moves_in_a_linear_scheme_stays_a_node():
    run = li.simulate(
        problem(ball(), FLOOR, li.Touch("ball", "floor", e=0.0), li.Spring("ball.x", "table", 9.0),
                li.PrescribedMotion("table", li.Harmonic(0.1, 3.0)), q0={"ball.y": R}),
        "exact", dt=0.01, error=False,
    )  # fmt: skip
    assert_allclose(run["table"], 0.1 * np.cos(3.0 * run.t), atol=1e-12)


# ---- files, drawings and copies ---------------------------------------------------------------------------------------

TURNING = (
    li.Body("block", 1.0, 0.1, li.Polygon([(-0.1, -0.1), (0.1, -0.1), (0.0, 0.2)]), G),
    li.Body("rod", 1.0, 0.1, li.Line((-0.5, 0.0), (0.5, 0.0))), FLOOR, li.Wall("bowl", li.Disk(9.0, hollow=True), y=8.0),
    ball(), li.Touch("block", "floor", e=0.5, mu=0.2, name="K"), li.Touch("ball", "bowl", e=0.0),
    li.Pin("rod", (0.5, 0.0), "block", (0.0, 0.2)), li.Guide("rod", (-0.5, 0.0), li.Line((-1.0, 0.2), (1.0, 0.2)), phi=0.0),
)  # fmt: skip


def test_a_scheme_of_bodies_comes_back_from_a_file_and_from_a_pickle(tmp_path):
    q0 = {"block.x": 1.0, "block.y": 0.3, "rod.x": 0.5, "rod.y": 0.5, "ball.y": 0.2}
    guide = li.Guide("rod", (-0.5, 0.0), li.Line((-1.0, 0.5), (1.0, 0.5)))
    p = problem(*TURNING[:-1], guide, q0=q0)
    back = li.read_scheme_file(li.write_scheme_file(p, tmp_path / "bodies.toml")).problem
    assert back == p
    assert pickle.loads(pickle.dumps(p)) == p
    a, b = (li.simulate(each, dt=1e-2, t_end=0.1, error=False) for each in (p, back))
    assert np.array_equal(a.q, b.q)
    assert "Contacts and joints" in p._repr_html_()
    assert "Contacts and joints" in p.scheme._repr_html_()
    a.plot(tmp_path / "run.png")
    with pytest.raises(li.InputError, match=r"bodies in the plane have no drawing .*: plot or animate a run"):
        li.draw_scheme(p.scheme)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("R = 0.1", "R = -0.1"), r"elements\[0\] \(line 1\): Body.shape: R of a Disk = -0.1 must be a positive"),
        (('type = "Disk", ', ""), r"elements\[0\] .*Body.shape: type is missing: give one of Disk, Polygon, Line"),
        (('"Disk"', '"Disc"'), r"elements\[0\] .*unknown shape 'Disc': did you mean 'Disk'\?"),
        (("R = 0.1", "r = 0.1"), r"elements\[0\] .*unknown key of Body.shape 'r'"),
        (('shape = { type = "Disk", R = 0.1 }', "shape = 1.0"), r"Body.shape = 1.0 must be a table { type, ... } of a Disk"),
        (("p = [0, 0]", "p = [0]"), r"elements\[1\] \(line 7\): .*p of a Line = \(0,\) must be a point"),
        (('b = "floor"', 'b = "flor"'), r"elements\[2\] \(line 11\): Touch .* unknown body or wall 'flor': did you mean"),
        (("e = 0.5", ""), r"elements\[2\] .*e is missing"),
    ],
)  # fmt: skip
def test_a_mistake_in_a_file_is_named_with_its_line(tmp_path, change, message):
    text = """[[elements]]
type = "Body"
name = "ball"
m = 1.0
J = 0.004
shape = { type = "Disk", R = 0.1 }
[[elements]]
type = "Wall"
name = "floor"
shape = { type = "Line", p = [0, 0], q = [1, 0] }
[[elements]]
type = "Touch"
a = "ball"
b = "floor"
e = 0.5
[initial."ball.y"]
q = 0.1
"""
    file = tmp_path / "ball.toml"
    file.write_text(text, encoding="utf-8")
    assert li.read_scheme_file(file).problem.dynamics.nodes == ("ball.x", "ball.y", "ball.φ")
    assert change[0] in text
    file.write_text(text.replace(*change), encoding="utf-8")
    with pytest.raises(li.InputError, match=message):
        li.read_scheme_file(file)


# ---- bad input --------------------------------------------------------------------------------------------------------

CORNERS = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: li.Body("b", m=-1.0, J=1.0), r"Body 'b': m = -1.0 must be a positive finite number in kg"),
        (lambda: li.Body("b", m=1.0), r"Body 'b': J is missing; give a positive number in kg m²"),
        (lambda: li.Body("b", m=1.0, J=math.nan), r"Body 'b': J = nan must be"),
        (lambda: li.Body("b", 1.0, 1.0, g=math.inf), r"Body 'b': g = inf must be a finite number in m/s²"),
        (lambda: li.Body("ground", 1.0, 1.0), r"name = 'ground' of a Body"),
        (lambda: li.Body("b", 1.0, 1.0, shape="disc"), r"Body 'b': shape = 'disc' must be a Disk, Polygon, Line"),
        (lambda: li.Wall("w"), r"Wall 'w': shape is missing"),
        (lambda: li.Wall("w", li.Disk(1.0), x=math.nan), r"Wall 'w': x = nan"),
        (lambda: li.Disk(0.0), r"R of a Disk = 0.0 must be a positive"),
        (lambda: li.Disk(1.0, hollow=1), r"hollow = 1 of a Disk must be True or False"),
        (lambda: li.Line((0.0, 0.0), (0.0, 0.0)), r"a Line from .* has no direction: give two different"),
        (lambda: li.Line((0.0, math.nan), (0.0, 0.0)), r"p of a Line = \(0.0, nan\) must be a point"),
        (lambda: li.Polygon(CORNERS[:2]), r"points = .* must be three corners \(x, y\) or more"),
        (lambda: li.Polygon(CORNERS[::-1]), r"run clockwise or enclose nothing: list its corners counterclockwise"),
        (lambda: li.Polygon([*CORNERS, (0.0, "a")]), r"corner 4 of a Polygon"),
        (lambda: li.Touch("a", "b"), r"Touch between 'a' and 'b': e is missing"),
        (lambda: li.Touch("a", "b", e=2.0), r"e = 2.0 must lie between 0 and 1"),
        (lambda: li.Touch("a", "b", e=0.0, mu=-0.1), r"mu = -0.1 must be a finite number, at least 0"),
        (lambda: li.Touch("a", "a", e=0.0), r"a body is not coupled to itself; name two"),
        (lambda: li.Touch("a", 3, e=0.0), r"3 of a Touch must be the name of a body"),
        (lambda: li.Pin("a", (0.0,)), r"Pin between 'a' and 'ground': p = \(0.0,\) must be a point"),
        (lambda: li.Guide("a", (0.0, 0.0), "x"), r"Guide .*: line = 'x' must be a Line of two points"),
        (lambda: li.Guide("a", (0.0, 0.0), FLOOR.shape, phi=math.nan), r"phi = nan must be a finite number in rad"),
    ],
)  # fmt: skip
def test_bodies_shapes_and_couplings_refuse_what_is_none(make, message):
    with pytest.raises(li.InputError, match=message):
        make()


POLYGON = li.Body("p", 1.0, 1.0, li.Polygon(CORNERS))
PIN = li.Pin("ball", (0.1, 0.0), "ground", (0.1, 0.0))


@pytest.mark.parametrize(
    ("elements", "message"),
    [
        ((ball(), li.Touch("bal", "floor", e=0.0), FLOOR), r"Touch between 'bal' and 'floor': unknown body or wall"),
        ((ball(), ball()), r"Body 'ball': two bodies or walls have the name 'ball'; rename one"),
        ((ball(), FLOOR, li.Wall("w", li.Disk(1.0)), li.Touch("w", "floor", e=0.0)), r"neither is a body"),
        ((ball(), li.Touch("ball", "ground", e=0.0)), r"'ground' has no shape: name a Wall"),
        ((li.Body("b", 1.0, 1.0), FLOOR, li.Touch("b", "floor", e=0.0)), r"'b' has no shape: give it shape=Disk"),
        ((POLYGON, ball(), li.Touch("p", "ball", e=0.0)), r"a Polygon and a Disk do not touch here: give a disc and"),
        ((FLOOR,), r"nothing that moves: add a Body"),
    ],
)  # fmt: skip
def test_schemes_refuse_couplings_by_name(elements, message):
    with pytest.raises(li.InputError, match=message):
        li.Scheme(*elements).assemble()


def test_starts_with_an_open_pin_or_a_penetrated_contact_are_refused():
    with pytest.raises(li.InputError, match=r"joint 'J.x' of problem 'bodies' is open by 1 in q0: give values"):
        problem(ball(), PIN, q0={"ball.x": 1.0})
    with pytest.raises(li.InputError, match=r"contact 'N.1' of problem 'bodies' starts penetrated by 0.5 m: change q0"):
        problem(POLYGON, FLOOR, li.Touch("p", "floor", e=0.0), q0={"p.y": -0.5})


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ((li.HertzSpring("ball.x", "ground", K=1.0),), r"HertzSpring between 'ball.x' and 'ground' has non-linear springs"),
        ((li.Maxwell("ball.x", "ground", 1.0, 1.0),), r"node 'ball.x-ground.1' has no mass"),
        ((li.Slider("ball.x", "ground", r0=1.0),), r"'F' is a slider"),
        ((li.Load("ball.x", li.Square(1.0, 2.0)),), r"the load on node 'ball.x' is a Square, no single formula"),
        ((li.Load("ball.x", math.sin),), r"the load on node 'ball.x' \(a function of t\) .*np.sin in place of math.sin"),
    ],
)  # fmt: skip
def test_what_a_lagrangian_system_does_not_take_is_refused_by_name(more, message):
    with pytest.raises(li.LcpImpactError, match=message):
        li.Scheme(ball(), PIN, *more).assemble()


def test_friction_is_bounded_by_the_normal_force_of_its_own_contact():
    guard = (li.Bumper("ground", "ball.x", 5.0, 0.0, "left"), li.Bumper("ball.x", "ground", 5.0, 0.0, "right"))
    bowl = li.Wall("bowl", li.Disk(9.0, hollow=True))
    touches = (li.Touch("ball", "floor", e=0.0, mu=0.2), li.Touch("ball", "bowl", e=0.0, mu=0.3, name="B"))
    for which in (touches, touches[:1]):  # turning, and linear
        contacts = li.Scheme(*guard, ball(), FLOOR, bowl, *which).assemble().contacts
        bound = {row.name: contacts[row.normal].name for row in contacts if row.law.tangential}
        assert bound == {f"{each.name or 'N'}_T": each.name or "N" for each in which}


@pytest.mark.parametrize("method", ["moreau-jean", "moreau-midpoint", "newmark-ns", "radau", "event-driven"])
def test_a_guide_along_an_axis_is_judged_by_what_it_holds(method):
    """A piston whose y and φ stay zero but for rounding, under the weight of the rod that hangs on it."""
    scheme = li.Scheme(
        li.Body("piston", m=1.0, J=0.1, g=9.81),
        li.Guide("piston", (0.0, 0.0), li.Line((0.0, 0.0), (1.0, 0.0)), phi=0.0),
        li.Spring("piston.x", "ground", k=10.0),
        li.Body("rod", m=0.5, J=0.02, g=9.81),
        li.Pin("rod", (0.0, 0.5), "piston", (0.0, 0.0)),
    )
    problem = li.Problem("piston", scheme, q0={"rod.y": -0.5}, v0={"piston.x": 1.0, "rod.x": 1.0})
    run = li.simulate(problem, method, dt=1e-2, t_end=1.0, throw=False, error=False)
    assert run.success, run.message
    assert np.abs(run["piston.φ"]).max() < 1e-15
