"""Systems 1-3 by SciPy's DOP853, with the modes and events of Eqs (3), (6), (8) written by hand.

It imports nothing of lcpimpact: it is the outside reference of the exact solution.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp


def modes(system, m, g, k, c, k_o, c_o):
    """Return for each mode the right side of s = (x, x', y, z), the function whose fall to zero ends it, and R."""

    def flight(t, s):
        x, dx, y, z = s
        dy = {1: dx, 2: dx, 3: dx + (k / c) * (x - y) if c else 0.0}[system]
        return [dx, g, dy, -k_o / c_o * z]

    def gap(t, s):
        return s[3] - (s[0] if system == 1 else s[2])

    if system == 1:

        def contact(t, s):
            x, dx = s[:2]
            return [dx, g - (c_o * dx + k_o * x) / m, dx, dx]

        def force(t, s):
            return c_o * s[1] + k_o * s[0]

    elif system == 2:

        def contact(t, s):
            x, dx, z = s[0], s[1], s[3]
            dz = (-(k_o + k) * z + k * x) / c_o
            return [dx, g - k * (x - z) / m, dz, dz]

        def force(t, s):
            return k * (s[0] - s[3])

    else:

        def force(t, s):
            x, dx, y, z = s
            return c * c_o / (c + c_o) * (dx + k / c * (x - y) + k_o / c_o * z)

        def contact(t, s):
            dx, z = s[1], s[3]
            dz = (force(t, s) - k_o * z) / c_o
            return [dx, g - force(t, s) / m, dz, dz]

    for event in (gap, force):
        event.terminal, event.direction = True, -1
    return {"contact": (contact, force), "flight": (flight, gap)}


def solve(system, t_end, v_o, times, **constants):
    """Return x and R at ``times`` and the switching times."""
    table = modes(system, **constants)
    force = table["contact"][1]
    s, t, mode, switches = np.array([0.0, v_o, 0.0, 0.0]), 0.0, "contact", []
    # Short steps, since the dense output is of lower order than the steps and k/c sets the fastest time.
    max_step = min(0.02, 0.2 * constants["c_o"] / (constants["k_o"] + (constants["k"] or 0.0)))
    x, R = np.full(len(times), np.nan), np.full(len(times), np.nan)
    while t < t_end:
        right_side, event = table[mode]
        run = solve_ivp(
            right_side, (t, t_end), s, method="DOP853", rtol=1e-13, atol=1e-14, events=event, dense_output=True,
            max_step=max_step,
        )  # fmt: skip
        here = (times >= t) & (times <= run.t[-1])
        states = run.sol(times[here]) if here.any() else np.empty((4, 0))
        x[here] = states[0]
        R[here] = force(0.0, states) if mode == "contact" else 0.0
        t, s = run.t[-1], run.y[:, -1].copy()
        if run.status == 1:
            switches.append(t)
            mode = "flight" if mode == "contact" else "contact"
            if mode == "flight" and system == 2:
                s[2] = s[0]
            if mode == "contact":
                s[3 if system == 1 else 2] = s[0] if system == 1 else s[3]
    return x, R, switches
