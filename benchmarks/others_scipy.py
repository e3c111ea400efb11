"""The contestant "SciPy, events" in `others.py`: `solve_ivp` with terminal events, modes and restarts by hand.

This is the cannon in the documentation of `scipy.integrate.solve_ivp` with a loop around it: integrate a mode up to an
event, change the state or the mode, go on. Modes, events and jumps were derived by hand, as a user of it has to do.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from others_problems import CASES, Array, Motion, shaken
from scipy.integrate import solve_ivp

VERSIONS = ("scipy",)

TIGHT = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-12}

Rates = Callable[[float, Array], Sequence[float] | Array]
Jump = Callable[[int, Array], tuple[Array, "str | None"]]


def terminal(function: Callable[[float, Array], float], direction: float = -1.0) -> Callable[[float, Array], float]:
    """Mark an event that ends the integration."""
    function.terminal, function.direction = True, direction
    return function


def follow(modes: dict[str, tuple[Rates, list, Jump]], mode: str, y: Sequence[float], t_end: float, options: dict):
    """Integrate mode by mode; return 2001 instants and the states there.

    Raises
    ------
    RuntimeError
        If a hundred events follow one another at one instant: the solver cannot get past the point where they accumulate.
    """
    instants = np.linspace(0.0, t_end, 2001)
    t, y, still = 0.0, np.array(y, dtype=float), 0
    out = np.empty((len(instants), len(y)))
    while still < 100:
        rates, events, jump = modes[mode]
        found = solve_ivp(rates, (t, t_end), y, events=events, dense_output=True, **options)
        still = 0 if found.t[-1] > t else still + 1
        inside = (instants >= t) & (instants <= found.t[-1])
        if inside.any():
            out[inside] = found.sol(instants[inside]).T
        if found.status != 1:
            return instants, out
        which = next(i for i, when in enumerate(found.t_events) if len(when))
        t = found.t_events[which][0]
        y, changed = jump(which, found.y_events[which][0])
        mode = changed or mode
    raise RuntimeError(f"time stands still at t = {t:.4f} s, where event follows event at one instant")


def plain(columns: int, t: Array, y: Array) -> Motion:
    """Return the motion of a state (q, v)."""
    return Motion(t, y[:, :columns], y[:, columns : 2 * columns])


def ball(t_end: float, options: dict, rest: float = 0.0) -> Motion:
    """Return the bouncing ball; a rebound slower than ``rest`` is none."""
    floor = terminal(lambda t, y: 1.0 - y[0])

    def bounce(_, y):
        return (np.array([1.0, 0.0]), "rest") if abs(y[1]) < rest else (np.array([1.0, -0.8 * y[1]]), None)

    modes = {
        "flight": (lambda t, y: [y[1], 9.81], [floor], bounce),
        "rest": (lambda t, y: [0.0, 0.0], [], bounce),
    }
    return plain(1, *follow(modes, "flight", [0.0, 0.0], t_end, options))


M, K, K_O, C, C_O, G = 100.0, 1962.0, 3924.0, 125.0, 250.0, 9.81
V_O = math.sqrt(2.0 * G * 5.0)


def alternate(contact: tuple, flight: tuple) -> dict:
    """Return two modes that follow each other; each is (rates, what ends it by falling through zero)."""
    return {
        "contact": (contact[0], [terminal(contact[1])], lambda i, y: (y, "flight")),
        "flight": (flight[0], [terminal(flight[1])], lambda i, y: (y, "contact")),
    }


def system_1(t_end: float, options: dict) -> Motion:
    """Return System 1 in (x, v, z): the plate follows the body in contact, and creeps back in flight."""

    def force(t, y):
        return C_O * y[1] + K_O * y[2]

    modes = alternate(
        (lambda t, y: [y[1], G - force(t, y) / M, y[1]], force),
        (lambda t, y: [y[1], G, -K_O / C_O * y[2]], lambda t, y: y[2] - y[0]),
    )
    modes["flight"] = (*modes["flight"][:2], lambda i, y: (np.array([y[0], y[1], y[0]]), "contact"))
    t, y = follow(modes, "contact", [0.0, V_O, 0.0], t_end, options)
    touching = y[:, 2] - y[:, 0] <= 1e-9
    return Motion(t, y[:, :1], y[:, 1:2], np.where(touching, force(t, y.T), 0.0))


def system_2(t_end: float, options: dict, events: bool) -> Motion:
    """Return System 2 in (x, v, z): its force is k max(0, x - z), which needs no events to be integrated."""

    def rates(t, y):
        R = K * max(y[0] - y[2], 0.0)
        return [y[1], G - R / M, (R - K_O * y[2]) / C_O]

    if not events:
        t = np.linspace(0.0, t_end, 2001)
        y = solve_ivp(rates, (0.0, t_end), [0.0, V_O, 0.0], t_eval=t, **options).y.T
    else:
        modes = alternate((rates, lambda t, y: y[0] - y[2]), (rates, lambda t, y: y[2] - y[0]))
        t, y = follow(modes, "contact", [0.0, V_O, 0.0], t_end, options)
    return Motion(t, y[:, :1], y[:, 1:2], K * np.maximum(y[:, 0] - y[:, 2], 0.0))


def system_3(t_end: float, options: dict) -> Motion:
    """Return System 3 in (x, v, y, z), with y = z in contact."""

    def rate(s):
        return (C * s[1] - K * (s[2] - s[0]) - K_O * s[2]) / (C + C_O)

    def force(t, s):
        return C_O * rate(s) + K_O * s[2]

    def contact(t, s):
        return [s[1], G - force(t, s) / M, rate(s), rate(s)]

    def flight(t, s):
        return [s[1], G, s[1] - K / C * (s[2] - s[0]), -K_O / C_O * s[3]]

    modes = alternate((contact, force), (flight, lambda t, s: s[3] - s[2]))
    modes["flight"] = (*modes["flight"][:2], lambda i, s: (np.array([s[0], s[1], s[2], s[2]]), "contact"))
    t, s = follow(modes, "contact", [0.0, V_O, 0.0, 0.0], t_end, options)
    touching = np.abs(s[:, 3] - s[:, 2]) <= 1e-9
    return Motion(t, s[:, :1], s[:, 1:2], np.where(touching, force(t, s.T), 0.0))


def impact_oscillator(t_end: float, options: dict) -> Motion:
    """Return the oscillator that strikes its stop."""
    start = float(CASES["impact-oscillator"].problem.v0["x"])
    modes = {
        "swing": (
            lambda t, y: [y[1], shaken(t) - y[0] - 0.1 * y[1]],
            [terminal(lambda t, y: -y[0])],
            lambda i, y: (np.array([0.0, -0.8 * y[1]]), None),
        )
    }
    return plain(1, *follow(modes, "swing", [0.0, start], t_end, options))


def swap(i: int, masses: Array, y: Array) -> Array:
    """Return the state after an elastic impact of the bodies i and i + 1."""
    n, y = len(masses), y.copy()
    a, b = masses[i], masses[i + 1]
    impulse = 2.0 * (y[n + i] - y[n + i + 1]) / (1.0 / a + 1.0 / b)
    y[n + i] -= impulse / a
    y[n + i + 1] += impulse / b
    return y


def cradle(t_end: float, options: dict) -> Motion:
    """Return Newton's cradle, an event for each gap."""
    gaps = [0.1, 0.01, 0.01, 0.01]
    events = [terminal(lambda t, y, i=i, gap=gap: gap + y[i + 1] - y[i]) for i, gap in enumerate(gaps)]
    modes = {
        "free": (lambda t, y: [*y[5:], *np.zeros(5)], events, lambda i, y: (swap(i, np.ones(5), y), None)),
    }
    return plain(5, *follow(modes, "free", [0.0] * 5 + [1.0] + [0.0] * 4, t_end, options))


def billiard(t_end: float, options: dict) -> Motion:
    """Return the balls that count the digits of π."""

    def jump(i, y):
        return (swap(0, np.array([100.0, 1.0]), y) if i == 0 else y * [1.0, 1.0, 1.0, -1.0]), None

    events = [terminal(lambda t, y: 1.0 + y[1] - y[0]), terminal(lambda t, y: 1.0 - y[1])]
    modes = {"free": (lambda t, y: [y[2], y[3], 0.0, 0.0], events, jump)}
    return plain(2, *follow(modes, "free", [0.0, 0.0, 1.0, 0.0], t_end, options))


def coulomb(t_end: float, options: dict) -> Motion:
    """Return the oscillator with dry friction: two directions of sliding, and rest."""

    def sliding(way):
        return lambda t, y: [y[1], -100.0 * y[0] - 5.0 * way]

    def turn(_, y):
        y = np.array([y[0], 0.0])
        return y, "rest" if abs(100.0 * y[0]) <= 5.0 else "back" if y[0] > 0.0 else "forth"

    modes = {
        "forth": (sliding(1.0), [terminal(lambda t, y: y[1])], turn),
        "back": (sliding(-1.0), [terminal(lambda t, y: -y[1])], turn),
        "rest": (lambda t, y: [0.0, 0.0], [], turn),
    }
    return plain(1, *follow(modes, "back", [0.53, 0.0], t_end, options))


def incline(t_end: float, options: dict) -> Motion:
    """Return the block that slides until its velocity is zero; tan α < μ, so that it stays."""
    α = math.pi / 6.0
    a = 9.81 * (math.sin(α) - 0.7 * math.cos(α))
    modes = {
        "slide": (lambda t, y: [y[1], a], [terminal(lambda t, y: y[1])], lambda i, y: (np.array([y[0], 0.0]), "rest")),
        "rest": (lambda t, y: [0.0, 0.0], [], None),
    }
    t, y = follow(modes, "slide", [0.0, 2.0], t_end, options)
    still = np.zeros(len(t))
    return Motion(t, np.column_stack([y[:, 0], still]), np.column_stack([y[:, 1], still]))


def filippov(t_end: float, options: dict) -> Motion:
    """Return the relay, with the sliding mode as a mode of its own."""

    def leaves(t, y):
        return 3.0 - t

    def arrive(_, y):
        return np.zeros(1), "above"

    modes = {
        "below": (lambda t, y: [3.0 - t], [terminal(lambda t, y: -y[0])], arrive),
        "above": (lambda t, y: [1.0 - t], [terminal(lambda t, y: y[0])], lambda i, y: (np.zeros(1), "surface")),
        "surface": (lambda t, y: [0.0], [terminal(leaves)], lambda i, y: (np.zeros(1), "fall")),
        "fall": (lambda t, y: [3.0 - t], [], None),
    }
    t, y = follow(modes, "below", [-1.5], t_end, options)
    return Motion(t, y, y)


RUNS = {
    "bouncing-ball": (ball, ball),
    "bouncing-ball to rest": (ball, partial(ball, rest=1e-6)),
    "system-1": (system_1, system_1),
    "system-2": (partial(system_2, events=False), partial(system_2, events=True)),
    "system-3": (system_3, system_3),
    "impact-oscillator": (impact_oscillator, impact_oscillator),
    "newtons-cradle": (cradle, cradle),
    "pi-billiard": (billiard, billiard),
    "coulomb-oscillator": (coulomb, coulomb),
    "block-on-incline": (incline, incline),
    "filippov": (filippov, filippov),
}

ABSENT = {"diode-bridge": "once the modes are worked out by hand nothing is left to switch: a linear equation"}


def settings(title: str) -> dict[str, tuple[str, partial[Motion]]]:
    """Return the runs of a problem."""
    t_end = CASES[title].t_end
    plain_run, tuned = RUNS[title]
    said = "; a rebound below 1 µm/s is rest" if title.endswith("rest") else ""
    return {
        "default": ("RK45, rtol = 1e-3", partial(plain_run, t_end, {})),
        "tuned": (f"DOP853, rtol = 1e-10{said}", partial(tuned, t_end, TIGHT)),
    }
