"""Bodies that turn, from event to event, with equations written by hand: the outside references of Lagrangian problems.

DOP853 follows each motion in coordinates of its own, forces of contacts come from accelerations, and impacts from the
enumeration of `rough_contacts`. It imports nothing of lcpimpact. Each function takes the parameters of a problem, and
returns the values of its facts by symbol.
"""

from __future__ import annotations

import math

import numpy as np
from rough_contacts import OPEN, Bodies, Rough
from scipy.integrate import solve_ivp


def follow(rhs, y, until, *events, directions=None):
    """Integrate to the first event that falls through zero, or to the end; return t, y and the number of the event."""
    for event, direction in zip(events, directions or [-1] * len(events), strict=True):
        event.terminal, event.direction = True, direction
    run = solve_ivp(rhs, (0.0, until), y, "DOP853", events=events, rtol=1e-13, atol=1e-14, max_step=0.02 * until)
    hit = next((i for i, times in enumerate(run.t_events or []) if len(times)), None)
    return float(run.t[-1]), run.y[:, -1], hit


def strike(M, normals, tangents, v, mu=0.0, e=0.0, e_T=0.0):
    """Return v after an impact of closed contacts, and the impulses."""
    rows = [Rough(tuple(n), tuple(t), mu=mu, e=e, e_T=e_T) for n, t in zip(normals, tangents, strict=True)]
    n = len(v)
    return Bodies(M, np.zeros((n, n)), np.zeros(n), rows).impact(np.zeros(n), np.asarray(v, float), 1e-9)


def corner(φ, a, b):
    """Return the rows of the point (a, b) of a body over a floor, in x, y and φ."""
    c, s = math.cos(φ), math.sin(φ)
    return (0.0, 1.0, a * c - b * s), (1.0, 0.0, -(a * s + b * c))


# --- pendulums --------------------------------------------------------------------------------------------------------


def swings(phi, wall, e, rate, number):
    """Return the impacts of a pendulum with a wall: when, and the angular velocity before each."""
    t, y, found = 0.0, np.array([phi, 0.0]), []
    while len(found) < number:
        dt, y, _ = follow(lambda t, y: [y[1], -(rate**2) * math.sin(y[0])], y, 10.0 / rate, lambda t, y: wall - y[0])
        t += dt
        found.append((t, y[1]))
        # A step of the equation from the wall, so that the search begins inside.
        y = np.array([wall - 1e-15, -e * y[1]])
    return found


def pendulum_and_wall(m, L, phi, wall, e, g):
    (t_1, ω), (t_2, _), (t_3, _) = swings(phi, wall, e, math.sqrt(g / L), 3)
    # The moment of the impulse is P L cos φ.
    return {"t_1": t_1, "ω_1": ω, "P_1": m * L * L * (1.0 + e) * ω / (L * math.cos(wall)), "t_2": t_2, "t_3": t_3}


def pendulum_xy(m, L, phi, g):
    def rhs(t, y):
        # The pull of the bar by what keeps the mass on its circle.
        pull = (y[2] ** 2 + y[3] ** 2 - g * y[1]) / (L * L)
        return [y[2], y[3], -pull * y[0], -pull * y[1] - g]

    start = [L * math.sin(phi), -L * math.cos(phi), 0.0, 0.0]
    t, (_, _, v_x, _), _ = follow(rhs, start, 10.0, lambda t, y: y[0])
    end = solve_ivp(rhs, (0.0, 4.0 * t), start, "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    return {"t": t, "v": -v_x, "R": m * (g + v_x**2 / L), "x(T)": end[0]}


def rod_on_pin(m, L, phi, wall, e, g):
    rate = math.sqrt(m * g * 0.5 * L / (m * L * L / 3.0))
    (t_1, ω), (t_2, _), (t_3, _) = swings(phi, wall, e, rate, 3)
    t_0, (_, w), _ = follow(lambda t, y: [y[1], -(rate**2) * math.sin(y[0])], [phi, 0.0], 10.0, lambda t, y: -y[0])
    return {"t_1": t_1, "ω_1": ω, "t_0": t_0, "R": m * (g + 0.5 * L * w * w), "t_2": t_2, "t_3": t_3}


def double_pendulum_stop(m, L, phi1, phi2, d, e, g):
    def rhs(t, y):
        a, b, u, w = y
        c, s = math.cos(a - b), math.sin(a - b)
        A, B = -s * w * w - 2.0 * g / L * math.sin(a), s * u * u - g / L * math.sin(b)
        return [u, w, (A - c * B) / (2.0 - c * c), (2.0 * B - c * A) / (2.0 - c * c)]

    t, y, found = 0.0, np.array([phi1, phi2, 0.0, 0.0]), {}
    while t < 2.0:
        dt, y, hit = follow(rhs, y, 2.0 - t, lambda t, y: d - L * (math.sin(y[0]) + math.sin(y[1])))
        t += dt
        if hit is None:
            break
        c = math.cos(y[0] - y[1])
        M = m * L * L * np.array([[2.0, c], [c, 1.0]])
        row = -L * np.cos(y[:2])
        v, _ = strike(M, [row], [(0.0, 0.0)], y[2:], e=e)
        if not found:
            jump = M @ (v - y[2:]) / np.cos(y[:2])
            E = 0.5 * y[2:] @ M @ y[2:] - m * g * L * (2.0 * math.cos(y[0]) + math.cos(y[1]))
            found = {"E": E, "e": -(row @ v) / (row @ y[2:]), "δp": jump[0] - jump[1], "t_1": t}
        y = np.array([*(y[:2] + 1e-15 * np.sign(row)), *v])
    return found | {"φ_1": y[0], "φ_2": y[1]}


def pendulum_cradle(m, L, r, phi, e, g):
    def rhs(t, y):
        return [y[1], -g / L * math.sin(y[0])]

    t, (_, ω), _ = follow(rhs, [-phi, 0.0], 10.0, lambda t, y: -y[0])
    rows = L * np.array([[-1.0, 1.0, 0.0], [0.0, -1.0, 1.0]])
    v, _ = strike(m * L * L * np.eye(3), rows, np.zeros((2, 3)), [ω, 0.0, 0.0], e=e)
    _, (top, _), _ = follow(rhs, [0.0, v[2]], 10.0, lambda t, y: y[1])
    return {"t_1": t, "ω_1": v[0], "ω_2": v[1], "ω_3": v[2], "φ_3": top}


def kane_pendulum(m, L, phi1, phi2, v1, v2, mu, e, e_T):
    # Kinetic energy of the two rods by their middles, differentiated by hand.
    c, s = np.cos([phi1, phi2]), np.sin([phi1, phi2])
    middles = [
        np.array([[0.5 * L * c[0], 0.0], [0.5 * L * s[0], 0.0]]),
        L * np.array([[c[0], 0.5 * c[1]], [s[0], 0.5 * s[1]]]),
    ]
    M = m * L * L / 12.0 * np.eye(2) + m * sum(J.T @ J for J in middles)
    v, P = strike(M, [L * s], [L * c], [v1, v2], mu, e, e_T)
    return {"ω_1": v[0], "ω_2": v[1], "T": 0.5 * v @ M @ v, "P_N": P[0], "P_T": P[1]}


# --- blocks -----------------------------------------------------------------------------------------------------------


def rocks(b, h, φ, ω, g):
    """Return when a block that stands on its left corner lands flat, and its angular velocity."""

    def rhs(t, y):
        # The moment of the weight about the corner; the middle is at (b, h) turned by φ from it.
        return [y[1], -0.75 * g * (b * math.cos(y[0]) - h * math.sin(y[0])) / (b * b + h * h)]

    t, y, _ = follow(rhs, [φ, ω], 10.0, lambda t, y: y[0])
    return t, y[1]


def lands(m, b, h, ω, mu):
    """Return x', y' and φ' after a block on its left corner has landed with φ' = ω, and the impulses."""
    M = np.diag([m, m, m * (b * b + h * h) / 3.0])
    rows = [corner(0.0, -b, -h), corner(0.0, b, -h)]
    return strike(M, [each[0] for each in rows], [each[1] for each in rows], [-h * ω, b * ω, ω], mu)


def rocking_block_bodies(m, b, h, phi, mu, g):
    t_1, ω = rocks(b, h, phi, 0.0, g)
    v, _ = lands(m, b, h, ω, mu)
    # It rocks to the other side as its mirror image does to this one.
    half = -v[2]

    def rhs(t, y):
        return [y[1], -0.75 * g * (b * math.cos(y[0]) - h * math.sin(y[0])) / (b * b + h * h)]

    up, (tilt, _), _ = follow(rhs, [1e-300, half], 10.0, lambda t, y: y[1])
    down, _ = rocks(b, h, tilt, 0.0, g)
    return {"t_1": t_1, "ω_1": -ω, "ω_1⁺": half, "φ_1": -tilt, "t_2": t_1 + up + down}


def squat_block(m, b, h, phi, mu, g):
    t_1, ω = rocks(b, h, phi, 0.0, g)
    v, P = lands(m, b, h, ω, mu)
    return {"t_1": t_1, "ω_1": -ω, "ω_1⁺": -v[2], "φ": 0.0, "P_N": P[:2].sum()}


def block_on_corners(m, b, h, mu, v0, g):
    rows = [corner(0.0, -b, -h), corner(0.0, b, -h)]
    block = Bodies(
        np.diag([m, m, m * (b * b + h * h) / 3.0]), np.zeros((3, 3)), [0.0, -m * g, 0.0],
        [Rough(n, t, mu=mu) for n, t in rows],
    )  # fmt: skip
    log, _, _ = block.run([0.0, 0.0, 0.0], [v0, 0.0, 0.0], 2.0 * v0 / (mu * g), stop=lambda log: len(log) > 0)
    _, r_N, _ = block.solve((1, 1), block.free(np.zeros(3)), np.zeros(4))
    return {"t": 0.5 * log[0].t, "x_s": log[0].q[0], "N_A": r_N[0], "N_B": r_N[1]}


# --- rolling and falling ----------------------------------------------------------------------------------------------


def disc_in_bowl(m, R, r, k, theta, mu, g):
    d = R - r

    def rhs(t, y):
        # Energy ½ m (1 + k) d² θ'² - m g d cos θ; the disc turns against its way by d/r.
        return [y[1], -g * math.sin(y[0]) / ((1.0 + k) * d), -d / r * y[1]]

    T, (_, ω, φ), _ = follow(rhs, [theta, 0.0, 0.0], 10.0, lambda t, y: y[0])
    end = solve_ivp(rhs, (0.0, 4.0 * T), [theta, 0.0, 0.0], "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    return {"T/4": T, "φ": φ, "N": m * (g + d * ω * ω), "x(T)": d * math.sin(end[0])}


def falling_rod(m, L, mu, theta, g):
    def forces(y):
        """Return T and N from the accelerations of the middle, (L/2) (sin θ, cos θ)."""
        α, c, s = 1.5 * g / L * math.sin(y[0]), math.cos(y[0]), math.sin(y[0])
        return 0.5 * m * L * (α * c - y[1] ** 2 * s), m * (g - 0.5 * L * (α * s + y[1] ** 2 * c))

    def margin(t, y):
        T, N = forces(y)
        return mu * N - T

    ω = math.sqrt(3.0 * g / L * (1.0 - math.cos(theta)))
    t, y, _ = follow(lambda t, y: [y[1], 1.5 * g / L * math.sin(y[0])], [theta, ω], 5.0, margin)
    return {"θ_s": y[0], "t_s": t, "ω_s": y[1], "N_s": forces(y)[1]}


def tipping_plank(m, L, a, mu, g):
    J = m * L * L / 12.0 + m * a * a

    def acceleration(θ):
        return m * g * a * math.cos(θ) / J

    def forces(y):
        """Return the forces of the edge along and across the plank, by those of its middle on a circle of the radius a."""
        return m * (g * math.sin(y[0]) + a * y[1] ** 2), m * (g * math.cos(y[0]) - a * acceleration(y[0]))

    def margin(t, y):
        T, N = forces(y)
        return mu * N - T

    t, y, _ = follow(lambda t, y: [y[1], acceleration(y[0])], [0.0, 0.0], 5.0, margin)
    return {"θ_s": y[0], "t_s": t, "ω_s": y[1], "N_s": forces(y)[1]}


def tumbling_rod(m, L, mu, e, h, phi, g):
    found = two_ends(m, m * L * L / 12.0, 0.5 * L, 0.0, mu, e, h, phi, g)
    found.pop("v_1")
    return found


def bouncing_dimer(m, r, L, mu, e, a, omega, h, phi, g):
    J = 2.0 * (2.0 / 5.0 * m * r * r + m * (0.5 * L) ** 2)
    return two_ends(2.0 * m, J, 0.5 * L, r, mu, e, h, phi, g, a, omega)


def two_ends(m, J, half, r, mu, e, h, phi, g, a=0.0, w=0.0):
    """Follow a body with balls at both ends over a plate at a sin(w t), through four impacts."""
    t, y, found = 0.0, np.array([0.0, h, phi, 0.0, 0.0, 0.0]), {}
    for number in range(1, 5):
        lifts = [
            lambda s, y, x=x, t=t: y[1] + x * math.sin(y[2]) - r - a * math.sin(w * (t + s)) for x in (-half, half)
        ]
        dt, y, hit = follow(lambda t, y: [*y[3:], 0.0, -g, 0.0], y, 1.2 * math.sqrt(2.0 * h / g), *lifts)
        t += dt
        normal, tangent = corner(y[2], (-half, half)[hit], 0.0)
        plate = np.array([0.0, a * w * math.cos(w * t), 0.0])
        # The point of contact is r below the middle of the ball.
        v, _ = strike(np.diag([m, m, J]), [normal], [np.add(tangent, (0.0, 0.0, r))], y[3:] - plate, mu, e)
        v = v + plate
        found[f"t_{number}"] = t
        found.setdefault("v_1", v[0])
        found.setdefault("ω_1", v[2])
        y = np.array([y[0], y[1] + 1e-15, y[2], *v])
    return found


# --- Painlevé ---------------------------------------------------------------------------------------------------------


def painleve_rod(m, a, phi, mu, v0, g):
    M = np.diag([m, m, m * a * a / 3.0])
    v = np.array([-v0, 0.0, 0.0])
    normal, tangent = corner(phi, -a, 0.0)
    body = Bodies(M, np.zeros((3, 3)), np.zeros(3), [Rough(normal, tangent, mu=mu)])
    # No mode of the contact has an acceleration: neither open nor in slip.
    free = np.array([0.0, -g, 0.0])
    assert np.dot(normal, free) < 0.0
    assert body.solve((-1,), free, np.zeros(2))[1][0] < 0.0
    # A contact that is pressed for an instant sticks.
    mode, after, P_N, P_T = body.choose([(0, 1, -1, OPEN)], v, np.array([-1e-14, 0.0]))
    assert mode == (0,)
    return {"P_N": P_N[0], "P_T": P_T[0], "ω": after[2], "E_l": 0.5 * (v @ M @ v - after @ M @ after)}


def painleve_jam(m, a, phi, v0, g):
    # In the time s with dt = p ds nothing is singular; δ = 45° - φ falls exponentially at last, and is carried itself.
    mu = 5.0 / 3.0

    def rhs(s, y):
        _, δ, D, _ = y
        c, s = math.cos(0.25 * math.pi - δ), math.sin(0.25 * math.pi - δ)
        p = 1.5 * math.sin(2.0 * δ) + 5.0 * math.sin(δ) ** 2
        w2 = max(g - D, 0.0) / (a * s)
        ω = math.sqrt(w2)
        turn = 3.0 * D * (mu * s - c) / a
        return [p, -ω * p, -2.0 * a * ω * s * turn - a * w2 * c * ω * p, mu * D + a * (s * turn + c * w2 * p)]

    # At rest the square root of ω² has no slope, and D hides it near there: begin later.
    start = solve_ivp(
        lambda t, y: _slides(y, a, g, mu),
        (0.0, 0.3 * math.sqrt(a / g)),
        [phi, 0.0, -v0],
        "DOP853",
        rtol=1e-13,
        atol=1e-15,
    )
    φ, ω, slip = start.y[:, -1]
    y = [start.t[-1], 0.25 * math.pi - φ, g - a * ω * ω * math.sin(φ), slip]
    end = solve_ivp(rhs, (0.0, 8.0), y, "DOP853", rtol=1e-13, atol=1e-30, max_step=0.05)
    t, _, _, slip = end.y[:, -1]
    way = solve_ivp(
        lambda t, y: _slides(y, a, g, mu), (0.0, 0.75 * t), [phi, 0.0, -v0], "DOP853", rtol=1e-13, atol=1e-15
    )
    M = np.diag([m, m, m * a * a / 3.0])
    ω = math.sqrt(g / (a * math.sqrt(0.5)))
    normal, tangent = corner(0.25 * math.pi, -a, 0.0)
    # The velocities with the slip and without approach, and the least change that ends both.
    v = np.array([slip - a * math.sqrt(0.5) * ω, a * math.sqrt(0.5) * ω, ω])
    H = np.array([normal, tangent])
    P = -np.linalg.solve(H @ np.linalg.solve(M, H.T), H @ v)
    return {
        "φ": way.y[0, -1],
        "ω": way.y[1, -1],
        "t_j": t,
        "ω_j": math.sqrt((g - end.y[2, -1]) / (a * math.sqrt(0.5))),
        "P_N": P[0],
    }


def _slides(y, a, g, mu):
    """Return the rates of φ, φ' and the slip of a rod with m = 1 that slides with its end first, by its normal force."""
    c, s = math.cos(y[0]), math.sin(y[0])
    H = np.array([-a * c, a * s])
    J = a * a / 3.0
    # Friction μ N pulls towards +x; the gap stays closed.
    N = (g - a * y[1] ** 2 * s) / (1.0 + H[0] * (H[0] + mu * H[1]) / J)
    α = N * (H[0] + mu * H[1]) / J
    return [y[1], α, mu * N + H[1] * α + a * c * y[1] ** 2]


# --- points in boxes --------------------------------------------------------------------------------------------------


def wedge_billiard(m, x0, y0, g):
    t, y, found = 0.0, np.array([x0, y0, 0.0, 0.0]), {}
    fall = [math.sqrt(2.0 * (y0 + side * x0) / g) for side in (-1.0, 1.0)]
    until = 0.9 * 5.0 * max(fall)
    normals = math.sqrt(0.5) * np.array([[-1.0, 1.0], [1.0, 1.0]])
    while t < until:
        events = [lambda t, y, n=n: n @ y[:2] for n in normals]
        dt, y, hit = follow(lambda t, y: [y[2], y[3], 0.0, -g], y, until - t, *events)
        t += dt
        if hit is None:
            break
        found.setdefault(f"t_{'AB'[hit]}", t)
        v, _ = strike(m * np.eye(2), [normals[hit]], [(0.0, 0.0)], y[2:], e=1.0)
        y = np.array([*(y[:2] + 1e-15 * normals[hit]), *v])
    return found | {"x": y[0], "y": y[1]}


def rotating_box(m, a, omega, v_x, v_y, e):
    t, x, v, found = 0.0, np.zeros(2), np.array([v_x, v_y]), {}
    for number in range(1, 6):
        walls = [lambda s, y, k=k, t=t: a - _turned(omega * (t + s) + 0.5 * math.pi * k) @ y[:2] for k in range(4)]
        dt, y, hit = follow(lambda s, y: [y[2], y[3], 0.0, 0.0], [*x, *v], 10.0 * a / np.hypot(*v), *walls)
        t, x, v = t + dt, y[:2], y[2:]
        n = _turned(omega * t + 0.5 * math.pi * hit)
        moving = omega * np.array([-x[1], x[0]])  # velocity of the wall where it is struck
        relative, _ = strike(m * np.eye(2), [-n], [(0.0, 0.0)], v - moving, e=e)
        v = relative + moving
        x = x - 1e-15 * n
        found[f"t_{number}"] = t
    found |= {"v_x": v[0], "v_y": v[1]}
    return found | ({"H": 0.5 * m * v @ v - omega * m * (x[0] * v[1] - x[1] * v[0])} if e == 1.0 else {})


def _turned(φ):
    return np.array([math.cos(φ), math.sin(φ)])


# --- mechanisms -------------------------------------------------------------------------------------------------------


def slider_crank(c, mu, e, omega1, omega2, g, l_1=0.153, l_2=0.306, b=0.025, m_1=0.038, m_2=0.038, m_3=0.076):
    J_1, J_2 = 7.4e-5, 5.9e-4
    A, B, C = J_1 + (m_1 / 4 + m_2 + m_3) * l_1**2, J_2 + (m_2 / 4 + m_3) * l_2**2, (m_2 / 2 + m_3) * l_1 * l_2

    def rhs(t, y):
        p, q, u, w, _ = y
        k, s = C * math.cos(q - p), C * math.sin(q - p)
        f = s * w * w - g * (m_1 / 2 + m_2 + m_3) * l_1 * math.cos(p)
        h = -s * u * u - g * (m_2 / 2 + m_3) * l_2 * math.cos(q)
        D = A * B - k * k
        return [u, w, (B * f - k * h) / D, (A * h - k * f) / D, 0.0]

    def energy(y):
        kinetic = 0.5 * A * y[2] ** 2 + 0.5 * B * y[3] ** 2 + C * math.cos(y[1] - y[0]) * y[2] * y[3]
        return kinetic + g * ((m_1 / 2 + m_2 + m_3) * l_1 * math.sin(y[0]) + (m_2 / 2 + m_3) * l_2 * math.sin(y[1]))

    start = np.array([0.0, 0.0, omega1, omega2, 0.0])
    sides = [lambda t, y, side=side: c - side * (l_1 * math.sin(y[0]) + l_2 * math.sin(y[1])) for side in (1.0, -1.0)]
    t, y, _ = follow(rhs, start, 0.02, *sides)
    return {"t_1": t, "E_d": energy(y) - energy(start), "φ_3": y[4]}


def guided_slider_crank(omega, g, l_1=0.153, l_2=0.306, m_1=0.038, m_2=0.038, m_3=0.076, J_1=7.4e-5, J_2=5.9e-4):
    # Bodies one by one: x and y of the middles of crank and rod, x of the slider, by the angle of the crank.
    def places(p):
        q = -np.arcsin(l_1 * np.sin(p) / l_2)
        x = l_1 * np.cos(p)
        return [
            0.5 * x,
            0.5 * l_1 * np.sin(p),
            x + 0.5 * l_2 * np.cos(q),
            0.5 * l_1 * np.sin(p),
            x + l_2 * np.cos(q),
            p,
            q,
        ]

    masses = np.array([m_1, m_1, m_2, m_2, m_3, J_1, J_2])

    def slopes(p):
        """Return the first and second derivatives of the places."""
        z = np.exp(2j * math.pi * np.arange(16) / 16)
        values = np.array(places(p + 0.2 * z)) / 16
        return (values @ z**-1 / 0.2).real, (2.0 * values @ z**-2 / 0.04).real

    def rates(t, y):
        first, second = slopes(y[0])
        weight = g * (m_1 * first[1] + m_2 * first[3])
        return [y[1], -(masses @ (first * second) * y[1] ** 2 + weight) / (masses @ first**2)]

    t, (p, w), _ = follow(rates, [0.0, omega], 5.0, lambda t, y: 0.5 * math.pi - y[0])
    first, second = slopes(p)
    accelerations = first * rates(0.0, [p, w])[1] + second * w * w
    q = places(p)[6]
    # About the crank pin: what turns the rod, by its inertia, and by the slider's push and the guide.
    half_x, half_y = 0.5 * l_2 * math.cos(q), 0.5 * l_2 * math.sin(q)
    a_x, a_y = accelerations[2], accelerations[3] + g
    inertia = J_2 * accelerations[6] + m_2 * (half_x * a_y - half_y * a_x)
    push = -m_3 * accelerations[4]
    rod = (inertia + 2.0 * half_y * push) / (2.0 * half_x)
    end, _, _ = follow(rates, [0.0, omega], 5.0, lambda t, y: math.pi - y[0])
    return {"t_90": t, "ω_90": w, "R_90": rod + m_3 * g, "t_180": end}


def four_bars(N, m, L, v0, g):
    n = int(N)
    # Lagrange's equation of the angle of the standing rods from upright.
    J, weight = (n + 1) * m * L * L / 3.0 + n * m * L * L, ((n + 1) * 0.5 + n) * m * g * L
    t, (θ, ω), _ = follow(
        lambda t, y: [y[1], weight / J * math.sin(y[0])], [0.0, v0 / L], 20.0, lambda t, y: math.pi / 3.0 - y[0]
    )
    return {"t": t, "ω": ω, "x": L * math.sin(θ), "y": L * math.cos(θ)}


def rod_chain(N, m, L, omega):
    n = int(N)
    # Each middle on its circle, summed from the outer end.
    pulls = np.cumsum([m * omega**2 * L * (j - 0.5) for j in range(n, 0, -1)])
    x = solve_ivp(
        lambda t, y: [-omega * y[1], omega * y[0]],
        (0.0, 7.0 / omega),
        [L * (n - 0.5), 0.0],
        "DOP853",
        rtol=1e-13,
        atol=1e-15,
    )
    return {"φ_N": 7.0, "x_N": x.y[0, -1], "R_1": pulls[-1], "R_N": pulls[0]}


REFERENCES = {
    "pendulum-xy": pendulum_xy, "pendulum-and-wall": pendulum_and_wall, "double-pendulum-stop": double_pendulum_stop,
    "rod-on-pin": rod_on_pin, "pendulum-cradle": pendulum_cradle, "kane-pendulum": kane_pendulum,
    "rocking-block-bodies": rocking_block_bodies, "squat-block": squat_block, "block-on-corners": block_on_corners,
    "disc-in-bowl": disc_in_bowl, "falling-rod": falling_rod, "tipping-plank": tipping_plank,
    "tumbling-rod": tumbling_rod, "bouncing-dimer": bouncing_dimer, "guided-slider-crank": guided_slider_crank,
    "painleve-rod": painleve_rod, "painleve-jam": painleve_jam, "wedge-billiard": wedge_billiard,
    "rotating-box": rotating_box, "slider-crank": slider_crank, "coupled-linkages": four_bars,
    "rod-chain": rod_chain,
}  # fmt: skip
