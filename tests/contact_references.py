"""Facts of problems with contacts by SciPy's DOP853, with modes and events written by hand; nothing of lcpimpact."""

import numpy as np
from scipy.integrate import solve_ivp


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


REFERENCES = {
    "balls-on-springs": balls_on_springs,
    "hertz-chain": hertz_chain,
}
