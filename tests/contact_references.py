"""Facts of problems with contacts by SciPy's DOP853, with modes and events written by hand; nothing of lcpimpact."""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq, minimize_scalar, root


def follow(rhs, start, t_end, event, falls=True, scale=1.0, steps=50):
    """Follow y' = rhs(t, y) until event(t, y) falls (or rises) through zero after the start; (t, y), or those at t_end."""

    def watched(t, y):
        return event(t, y)

    watched.direction, watched.terminal = -1 if falls else 1, True
    found = solve_ivp(
        rhs, t_end if np.ndim(t_end) else (0.0, t_end), start, "DOP853", rtol=1e-13, atol=1e-15 * np.asarray(scale),
        events=watched, max_step=np.max(t_end) / steps,
    )  # fmt: skip
    assert found.success
    return float(found.t[-1]), found.y[:, -1]


def row(N, n, stiffness, m):
    """Right side of N equal balls with springs F = stiffness δⁿ between them that do not pull."""

    def rhs(t, y):
        F = stiffness * np.maximum(y[: N - 1] - y[1:N], 0.0) ** n
        return np.concatenate([y[N:], (np.append(0.0, F) - np.append(F, 0.0)) / m])

    return rhs


def balls_on_springs(m, k, v0):
    unit = np.sqrt(m / k)
    rhs = row(3, 1.0, 1.0, 1.0)
    t_1, y = follow(rhs, [0.0, 0.0, 0.0, 1.0, 0.0, 0.0], 9.0, lambda t, y: y[0] - y[1])
    t_2, y = follow(rhs, y, (t_1, 9.0), lambda t, y: y[1] - y[2])
    return {"t_1": t_1 * unit, "t_2": t_2 * unit, **{f"v_{i}/v0": y[2 + i] for i in (1, 2, 3)}}


def hertz_chain(N, m, K, v0):
    """In the units of the problem itself; balls that touch no longer keep their velocities."""
    N, unit = int(N), (m**2 / (K**2 * v0)) ** 0.2
    start = np.append(np.zeros(N), v0 * np.eye(N)[0])
    scale = np.repeat([v0 * unit, v0], N)
    _, y = follow(row(N, 1.5, K, m), start, 12.0 * unit, lambda t, y: 1.0, scale=scale, steps=2000)
    assert (np.diff(y[N:]) > 0.0).all()
    assert (np.diff(y[:N]) > 0.0).all()
    return {"ΣT/T_0": np.sum((y[N:] / v0) ** 2), **{f"v_{i + 1}/v0": y[N + i] / v0 for i in range(N)}}


def impact_damper(M, m, k, c, d, e, F, omega):
    """Half a period by the exponential of oscillator and force; four equations by Powell's method from 16 starts."""
    A = np.array([[0, 1, 0, 0], [-k / M, -c / M, F / M, 0], [0, 0, 0, -omega], [0, 0, omega, 0]])
    T = np.pi / omega
    flow = expm(A * T)

    def arrival(z):
        x, v, _, phase = z
        return flow @ [x, v, np.cos(phase), np.sin(phase)]

    def residual(z):
        x, v, w, _ = z
        x_1, v_1 = arrival(z)[:2]
        impulse = (1.0 + e) * (v_1 + w) * M * m / (M + m)  # of the stop on the loose mass, which arrives with -w
        return [x_1 + x, v_1 - impulse / M + v, (impulse / m - w - w) / w, 2.0 * x + d - w * T]

    found = []
    for phase in np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False):
        for w in (d / T, 3.0 * d / T):
            z = root(residual, [0.5 * (w * T - d), -0.3 * w, w, phase], tol=1e-14)
            if np.abs(residual(z.x)).max() < 1e-10 * z.x[2]:
                found.append(z.x)
    z = max(found, key=lambda each: each[2])
    x, v, w, phase = z

    def place(t):
        return abs((expm(A * t) @ [x, v, np.cos(phase), np.sin(phase)])[0])

    times = np.linspace(0.0, T, 65)
    j = int(np.clip(np.argmax([place(t) for t in times]), 1, 63))
    top = minimize_scalar(lambda t: -place(t), bounds=(times[j - 1], times[j + 1]), options={"xatol": 1e-9 * T})
    return {"τ": T, "w": w, "v⁻": -arrival(z)[1], "P": 2.0 * m * w, "X": max(-top.fun, abs(x))}


def nonsmooth_mode(m1, m2, k1, k2, d, omega):
    """By superposition of the motions over a period from unit x_1, x_2 and x_2': at its end x_2 = d and x_1' = 0 again."""
    T = 2.0 * np.pi / omega

    def end(start):
        rhs = lambda t, y: [y[2], y[3], (k2 * (y[1] - y[0]) - k1 * y[0]) / m1, k2 * (y[0] - y[1]) / m2]  # noqa: E731
        return solve_ivp(rhs, (0.0, T), start, "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]

    flow = np.array([end(each) for each in np.eye(4)]).T
    x, v = np.linalg.solve(flow[[1, 2]][:, [0, 3]], [d - flow[1, 1] * d, -flow[2, 1] * d])
    last = flow @ [x, d, 0.0, v]
    np.testing.assert_allclose(last, [x, d, 0.0, -v], rtol=0, atol=1e-9 * max(abs(x), d, abs(v)))
    E = 0.5 * (k1 * x**2 + k2 * (d - x) ** 2 + m2 * v**2)
    return {"T": T, "v": -v, "x_1": x, "E": E}


def cam_follower(m, k, F, A, omega, e):
    """One turn from where the cam is lowest: on it R is what its acceleration asks for, off it the motion is free."""
    T = 2.0 * np.pi / omega
    cam = lambda t: A * np.cos(omega * t)  # noqa: E731
    rate = lambda t: -A * omega * np.sin(omega * t)  # noqa: E731
    R = lambda t: F - k * cam(t) + m * omega**2 * cam(t)  # noqa: E731
    ends = R(0.0), R(0.5 * T)
    if min(ends) > 0.0:
        return {"R_max": max(ends), "R_min": min(ends)}
    t_1 = brentq(R, 0.0, 0.5 * T, xtol=1e-17)

    def rhs(t, y):
        return [y[1], (F - k * y[0]) / m]

    scale = [A, A * omega]
    start = [cam(t_1), rate(t_1)]
    soon = solve_ivp(rhs, (t_1, t_1 + 0.02 * T), start, "DOP853", rtol=1e-13, atol=1e-18).y[:, -1]
    t_0, y = follow(rhs, soon, (t_1 + 0.02 * T, t_1 + T), lambda t, y: rate(t) - y[1], scale=scale)
    t_2, y = follow(rhs, y, (t_0, t_1 + T), lambda t, y: cam(t) - y[0], scale=scale)
    U = y[1] - rate(t_2)
    return {"t_2": t_2 - t_0, "U": U, "P": (1.0 + e) * m * U, "t_1 + T": t_1 + T - t_0, "T": T}


def train_brakes(N, R, S, C, D, w0, u0, rho, t_s):
    """The circuit by its currents, restarted where a valve opens or closes and where the engine lets the air out."""
    N = int(N)
    i = np.arange(N)
    y = np.concatenate([(1 - rho) * u0 + rho * u0 / N * i, -(1 - rho) * u0 - rho * u0 / N * (N + i)])
    t, opened, found = 0.0, y[N:] > 0.0, {}
    while t < 2.0 * t_s:
        now = tuple(opened)

        def rhs(t, y, supply=w0 if t < t_s else 0.0, opened=now):
            w = np.concatenate([[supply], y[:N] + y[N:]])
            j = np.append((w[:-1] - w[1:]) / R, 0.0)
            k = np.where(opened, y[N:] / S, 0.0)
            return np.concatenate([(j[:-1] - j[1:]) / C, (j[:-1] - j[1:] - k) / D])

        events = [lambda t, y, n=n: y[N + n] for n in range(N)]
        for each, flows in zip(events, opened, strict=True):
            each.terminal, each.direction = True, -1 if flows else 1
        until = t_s if t < t_s else 2.0 * t_s
        run = solve_ivp(rhs, (t, until), y, "DOP853", rtol=1e-13, atol=1e-14, events=events, max_step=t_s / 200)
        t, y = run.t[-1], run.y[:, -1]
        for n in np.flatnonzero([len(each) for each in run.t_events]):
            opened[n] = not opened[n]
            found.setdefault(f"t_{n + 1}" if opened[n] else "t_c", t)
            if n == N - 1 and not opened[n]:
                found["t_c"] = t
            y[N + n] = 0.0
    return found | {"u_1'": y[0], f"u_{N}'": y[N - 1], f"v_{N}'": y[2 * N - 1]}


def diode_bridge_supply(V0, omega, C, R):
    """From where the supply is greatest, with what a bridge does: it conducts while its current is positive."""
    half = np.pi / omega
    current = lambda t: C * V0 * omega * np.cos(omega * t) + V0 * np.sin(omega * t) / R  # noqa: E731
    t_o = brentq(current, 0.5 * half, half, xtol=1e-20)
    discharge = lambda t, y: [-y[0] / (R * C)]  # noqa: E731
    t_c, _ = follow(
        discharge, [V0 * np.sin(omega * t_o)], (t_o, 1.5 * half), lambda t, y: y[0] + V0 * np.sin(omega * t)
    )
    v = solve_ivp(discharge, (t_o, half), [V0 * np.sin(omega * t_o)], "DOP853", rtol=1e-13, atol=1e-15).y[0, -1]
    i = current(0.5 * (t_c - half + t_o))
    return {"t_c": t_c - half, "t_o": t_o, "v_max": V0, "v_0": v, "i_m": i}


def inertia_drive(m, mu, g, A, T, share):
    """From rest, until the block has stuck in a period; then the next period."""
    T_2, a, x, v = share * T, mu * g, 0.0, 0.0
    V_1, V_2 = A / (T - T_2), A / T_2
    stuck, found = False, {"T_1": T - T_2}
    for _ in range(10_000):
        start = x, v
        t_s, y = follow(lambda t, y: [y[1], a], [x, v], T - T_2, lambda t, y: V_1 - y[1], scale=[A, V_1])
        x, v = y[0] + V_1 * (T - T_2 - t_s), y[1]
        if stuck:
            found |= {"t_s": t_s, "v_0": start[1]}
        turns, y = follow(lambda t, y: [y[1], -a], [x, v], T_2, lambda t, y: y[1] + V_2, scale=[A, V_1])
        assert turns == T_2
        x, v = y
        if stuck:
            return found | {"Δx": x - start[0]}
        stuck = t_s < T - T_2
    raise AssertionError("it never sticks")


REFERENCES = {
    "balls-on-springs": balls_on_springs,
    "diode-bridge-supply": diode_bridge_supply,
    "hertz-chain": hertz_chain,
    "cam-follower": cam_follower,
    "impact-damper": impact_damper,
    "inertia-drive": inertia_drive,
    "nonsmooth-mode": nonsmooth_mode,
    "train-brakes": train_brakes,
}
