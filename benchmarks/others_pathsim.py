"""The contestant PathSim in `others.py`: block diagrams with zero crossings that change the state of a block.

Written after its examples of events (bouncing ball, stick and slip) and its diode circuit: an `ODE` block, a `Scope`, and a
`ZeroCrossing` whose action sets the state, on the right side of the crossing, and switches the mode. An event counts as
located when its function is within a tolerance of zero. The default has the solver and the tolerances of its bouncing ball.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from others_penalty import bridge_current
from others_problems import CASES, Array, Motion, shaken
from others_scipy import C_O, K_O, V_O, C, G, K, M, swap
from pathsim import Connection, Simulation
from pathsim.blocks import ODE, Scope
from pathsim.events import ZeroCrossingDown
from pathsim.solvers import RKBS32, RKDP87

VERSIONS = ("pathsim",)


class Setting(NamedTuple):
    """A solver, its tolerances of a step, and the tolerance of an event; the thermal voltage of diodes in V."""

    solver: type
    relative: float
    absolute: float
    event: float
    thermal: float


DEFAULT = Setting(RKBS32, 1e-3, 1e-5, 1e-3, 2.585e-2)
TUNED = Setting(RKDP87, 1e-10, 1e-12, 1e-12, 2.585e-4)


class Switch:
    """The mode of a system: what its rates and its events read, and its actions change."""

    def __init__(self, mode: str = "") -> None:
        self.mode = mode


Watched = tuple[str, Callable[[float, Array], float], Callable[[Array], Array]]
"""The mode in which an event is watched, its function, which falls through zero, and the state after it."""


def simulated(
    title: str, rates: Callable, start: list[float], events: list[Watched], switch: Switch, setting: Setting
) -> tuple[Array, Array]:
    """Return the instants of the steps, of which there are 500 or more, and the states there."""
    t_end = CASES[title].t_end
    block, scope = ODE(rates, np.array(start)), Scope()
    wires = [Connection(block[i], scope[i]) for i in range(len(start))]

    def crossing(mode: str, function: Callable[[float, Array], float], after: Callable[[Array], Array]) -> Any:
        def watched(t: float) -> float:
            return function(t, block.engine.state) if switch.mode == mode else 1.0

        def act(_t: float) -> None:
            block.engine.set(after(block.engine.state.copy()))

        return ZeroCrossingDown(func_evt=watched, func_act=act, tolerance=setting.event)

    simulation = Simulation(
        [block, scope], wires, [crossing(*event) for event in events], dt=t_end / 500, dt_max=t_end / 500, log=False,
        Solver=setting.solver, tolerance_lte_rel=setting.relative, tolerance_lte_abs=setting.absolute,
    )  # fmt: skip
    simulation.run(t_end)
    t, states = scope.read()
    return np.array(t), np.array(states).T


def ball(title: str, setting: Setting, rest: float = 0.0) -> Motion:
    """Return the bouncing ball, its height kept positive as in the example; a rebound slower than ``rest`` is none."""
    switch = Switch("flight")

    def rates(y: Array, _u: Any, _t: float) -> Array:
        return np.array([y[1], 9.81 if switch.mode == "flight" else 0.0])

    def bounce(y: Array) -> Array:
        if abs(y[1]) < rest:
            switch.mode = "rest"
            return np.array([1.0, 0.0])
        return np.array([1.0 - abs(1.0 - y[0]), -0.8 * y[1]])

    events: list[Watched] = [("flight", lambda t, y: 1.0 - y[0], bounce)]
    t, y = simulated(title, rates, [0.0, 0.0], events, switch, setting)
    return Motion(t, y[:, :1], y[:, 1:])


def into(switch: Switch, mode: str, change: Callable[[Array], Array] = np.copy) -> Callable[[Array], Array]:
    """Return the action that changes the state and the mode."""

    def act(y: Array) -> Array:
        switch.mode = mode
        return change(y)

    return act


def system_1(title: str, setting: Setting) -> Motion:
    """Return System 1 in (x, v, z): the plate follows the body in contact, and creeps back in flight."""
    switch = Switch("contact")

    def force(_t: float, y: Array) -> float:
        return C_O * y[1] + K_O * y[2]

    def rates(y: Array, _u: Any, t: float) -> Array:
        if switch.mode == "contact":
            return np.array([y[1], G - force(t, y) / M, y[1]])
        return np.array([y[1], G, -K_O / C_O * y[2]])

    events: list[Watched] = [
        ("contact", force, into(switch, "flight")),
        ("flight", lambda t, y: y[2] - y[0], into(switch, "contact", lambda y: y[[0, 1, 0]])),
    ]
    t, y = simulated(title, rates, [0.0, V_O, 0.0], events, switch, setting)
    touching = y[:, 2] - y[:, 0] <= 1e-9
    return Motion(t, y[:, :1], y[:, 1:2], np.where(touching, C_O * y[:, 1] + K_O * y[:, 2], 0.0))


def system_2(title: str, setting: Setting) -> Motion:
    """Return System 2 in (x, v, z): its force is k max(0, x - z), which needs no events to be integrated."""

    def rates(y: Array, _u: Any, _t: float) -> Array:
        R = K * max(y[0] - y[2], 0.0)
        return np.array([y[1], G - R / M, (R - K_O * y[2]) / C_O])

    t, y = simulated(title, rates, [0.0, V_O, 0.0], [], Switch(), setting)
    return Motion(t, y[:, :1], y[:, 1:2], K * np.maximum(y[:, 0] - y[:, 2], 0.0))


def system_3(title: str, setting: Setting) -> Motion:
    """Return System 3 in (x, v, y, z), with y = z in contact."""
    switch = Switch("contact")

    def rate(s: Array) -> Any:
        return (C * s[1] - K * (s[2] - s[0]) - K_O * s[2]) / (C + C_O)

    def force(_t: float, s: Array) -> Any:
        return C_O * rate(s) + K_O * s[2]

    def rates(s: Array, _u: Any, t: float) -> Array:
        if switch.mode == "contact":
            return np.array([s[1], G - force(t, s) / M, rate(s), rate(s)])
        return np.array([s[1], G, s[1] - K / C * (s[2] - s[0]), -K_O / C_O * s[3]])

    events: list[Watched] = [
        ("contact", force, into(switch, "flight")),
        ("flight", lambda t, s: s[3] - s[2], into(switch, "contact", lambda s: s[[0, 1, 2, 2]])),
    ]
    t, s = simulated(title, rates, [0.0, V_O, 0.0, 0.0], events, switch, setting)
    touching = np.abs(s[:, 3] - s[:, 2]) <= 1e-9
    return Motion(t, s[:, :1], s[:, 1:2], np.where(touching, force(0.0, s.T), 0.0))


def impact_oscillator(title: str, setting: Setting) -> Motion:
    """Return the oscillator that strikes its stop."""

    def rates(y: Array, _u: Any, t: float) -> Array:
        return np.array([y[1], shaken(t) - y[0] - 0.1 * y[1]])

    def bounce(y: Array) -> Array:
        return np.array([-abs(y[0]), -0.8 * y[1]])

    start = [0.0, float(CASES[title].problem.v0["x"])]
    t, y = simulated(title, rates, start, [("", lambda t, y: -y[0], bounce)], Switch(), setting)
    return Motion(t, y[:, :1], y[:, 1:])


def row(
    gaps: list[float], wall: float | None, masses: list[float], v: list[float], title: str, setting: Setting
) -> Motion:
    """Return balls on one line, an event for each gap, with a wall to their right if there is one."""
    n, m = len(masses), np.array(masses)

    def rates(y: Array, _u: Any, _t: float) -> Array:
        return np.concatenate([y[n:], np.zeros(n)])

    def reach(i: int, gap: float) -> Watched:
        def strike(y: Array) -> Array:
            after = swap(i, m, y)
            after[i] = min(after[i], after[i + 1] + gap)
            return after

        return "", lambda t, y: gap + y[i + 1] - y[i], strike

    def rebound(y: Array) -> Array:
        y[n - 1], y[2 * n - 1] = min(y[n - 1], wall), -y[2 * n - 1]
        return y

    events = [reach(i, gap) for i, gap in enumerate(gaps)]
    if wall is not None:
        events.append(("", lambda t, y: wall - y[n - 1], rebound))
    t, y = simulated(title, rates, [0.0] * n + v, events, Switch(), setting)
    return Motion(t, y[:, :n], y[:, n:])


def coulomb(title: str, setting: Setting) -> Motion:
    """Return the oscillator with dry friction: two directions of sliding, and rest."""
    switch = Switch("back")
    way = {"forth": 1.0, "back": -1.0}

    def rates(y: Array, _u: Any, _t: float) -> Array:
        return np.array([y[1], -100.0 * y[0] - 5.0 * way[switch.mode]]) if switch.mode in way else np.zeros(2)

    def turn(y: Array) -> Array:
        switch.mode = "rest" if abs(100.0 * y[0]) <= 5.0 else "back" if y[0] > 0.0 else "forth"
        return np.array([y[0], 0.0])

    events: list[Watched] = [("forth", lambda t, y: y[1], turn), ("back", lambda t, y: -y[1], turn)]
    t, y = simulated(title, rates, [0.53, 0.0], events, switch, setting)
    return Motion(t, y[:, :1], y[:, 1:])


def incline(title: str, setting: Setting) -> Motion:
    """Return the block that slides until its velocity is zero; tan α < μ, so that it stays."""
    switch, α = Switch("slide"), math.pi / 6.0

    def rates(y: Array, _u: Any, _t: float) -> Array:
        slides = switch.mode == "slide"
        return np.array([y[1], 9.81 * (math.sin(α) - 0.7 * math.cos(α))]) if slides else np.zeros(2)

    events: list[Watched] = [("slide", lambda t, y: y[1], into(switch, "rest", lambda y: np.array([y[0], 0.0])))]
    t, y = simulated(title, rates, [0.0, 2.0], events, switch, setting)
    still = np.zeros((len(t), 1))
    return Motion(t, np.hstack([y[:, :1], still]), np.hstack([y[:, 1:], still]))


def diode_bridge(title: str, setting: Setting) -> Motion:
    """Return the bridge of four diodes of Shockley's law, as in its diode circuit."""
    L, C_F = 1e-2, 1e-6

    def rates(y: Array, _u: Any, _t: float) -> Array:
        return np.array([-(y[1] + bridge_current(y[0], setting.thermal)) / C_F, y[0] / L])

    t, y = simulated(title, rates, [10.0, 0.0], [], Switch(), setting)
    return Motion(t, y[:, :1], np.zeros((len(t), 1)))


def filippov(title: str, setting: Setting) -> Motion:
    """Return the relay, with the sliding mode as a mode of its own."""
    switch = Switch("below")
    input_of = {"below": 1.0, "above": -1.0, "fall": 1.0}

    def rates(y: Array, _u: Any, t: float) -> Array:
        return np.array([2.0 - t + input_of[switch.mode]]) if switch.mode in input_of else np.zeros(1)

    events: list[Watched] = [
        ("below", lambda t, y: -y[0], into(switch, "above", np.abs)),
        ("above", lambda t, y: y[0], into(switch, "surface", np.zeros_like)),
        ("surface", lambda t, y: 3.0 - t, into(switch, "fall")),
    ]
    t, y = simulated(title, rates, [-1.5], events, switch, setting)
    return Motion(t, y, y)


RUNS: dict[str, Callable[..., Motion]] = {
    "bouncing-ball": ball,
    "bouncing-ball to rest": ball,
    "system-1": system_1,
    "system-2": system_2,
    "system-3": system_3,
    "impact-oscillator": impact_oscillator,
    "newtons-cradle": partial(row, [0.1, 0.01, 0.01, 0.01], None, [1.0] * 5, [1.0, 0.0, 0.0, 0.0, 0.0]),
    "pi-billiard": partial(row, [1.0], 1.0, [100.0, 1.0], [1.0, 0.0]),
    "coulomb-oscillator": coulomb,
    "block-on-incline": incline,
    "diode-bridge": diode_bridge,
    "filippov": filippov,
}


def settings(title: str) -> dict[str, tuple[str, partial[Motion]]]:
    """Return the runs of a problem."""
    tuned = partial(ball, rest=1e-4) if title.endswith("rest") else RUNS[title]
    runs = {}
    for key, run, it in (("default", RUNS[title], DEFAULT), ("tuned", tuned, TUNED)):
        how = f"{it.solver.__name__}, rtol = {it.relative:g}, events within {it.event:g}"
        if title == "diode-bridge":
            how += f"; Shockley, n V_T = {1e3 * it.thermal:g} mV"
        elif run is not RUNS[title]:
            how += "; a rebound below 0.1 mm/s is rest"
        runs[key] = (how, partial(run, title, it))
    return runs
