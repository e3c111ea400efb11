"""The contestant heyoka.py in `others.py`: Taylor's method with events, to the precision of doubles.

Written after its notebooks "Event detection" and "The wavy ramp": an impact is a terminal event whose callback changes the
state, a mode is a parameter that the callback switches, and the event of a mode that is off is a constant. Modes, events and
jumps were derived by hand, as a user of it has to do. Its integrators are compiled by LLVM when they are made, and kept in
memory: the times are of the second and later runs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import heyoka as hy
import numpy as np
from others_problems import CASES, Array, Motion, shaking
from others_scipy import C_O, K_O, V_O, C, G, K, M, swap

VERSIONS = ("heyoka",)

FALLING, RISING = hy.event_direction.negative, hy.event_direction.positive

ON, WAY = hy.par[0], hy.par[1]
"""The mode, one of two: 1.0 in contact or in motion, 0.0 out of it; and the direction of sliding, 1.0 or -1.0."""

OFF = 1.0 - ON


def when(function: Any, direction: Any, change: Callable[[Any], None], active: Any = None) -> Any:
    """Return an event that changes the integrator and lets it go on; where ``active`` is zero there is none."""

    def callback(integrator: Any, _sign: int) -> bool:
        change(integrator)
        return True

    if active is not None:
        function = active * function + (1.0 - active)
    return hy.t_event(function, callback=callback, direction=direction)


def followed(
    title: str, equations: list, start: list[float], events: list, modes: Sequence[float] = (1.0,)
) -> tuple[Array, Array]:
    """Return 2001 instants and the states there.

    Raises
    ------
    RuntimeError
        If the integrator stops before.
    """
    integrator = hy.taylor_adaptive(equations, state=start, pars=list(modes), t_events=events)
    t = np.linspace(0.0, CASES[title].t_end, 2001)
    outcome, *_, states = integrator.propagate_grid(t)
    if outcome != hy.taylor_outcome.time_limit:
        raise RuntimeError(f"stops at t = {integrator.time:.4g} s: {outcome}")
    return t, states


def ball(title: str, rest: float = 0.0) -> Motion:
    """Return the bouncing ball; a rebound slower than ``rest`` is none."""
    x, v = hy.make_vars("x", "v")

    def bounce(it: Any) -> None:
        slow = abs(it.state[1]) < rest
        it.state[:] = [1.0, 0.0 if slow else -0.8 * it.state[1]]
        it.pars[0] = 0.0 if slow else 1.0

    flight = [(x, v), (v, 9.81 * ON)]
    t, y = followed(title, flight, [0.0, 0.0], [when(x - 1.0, RISING, bounce, ON)])
    return Motion(t, y[:, :1], y[:, 1:])


def leave(it: Any) -> None:
    """Begin the flight, with the plate where the body is."""
    it.pars[0] = 0.0


def system_1(title: str) -> Motion:
    """Return System 1 in (x, v, z): the plate follows the body in contact, and creeps back in flight."""
    x, v, z = hy.make_vars("x", "v", "z")
    force = C_O * v + K_O * z

    def land(it: Any) -> None:
        it.state[2], it.pars[0] = it.state[0], 1.0

    rates = [(x, v), (v, G - ON * force / M), (z, ON * v - OFF * K_O / C_O * z)]
    events = [when(force, FALLING, leave, ON), when(z - x, FALLING, land, OFF)]
    t, y = followed(title, rates, [0.0, V_O, 0.0], events)
    touching = y[:, 2] - y[:, 0] <= 1e-9
    return Motion(t, y[:, :1], y[:, 1:2], np.where(touching, C_O * y[:, 1] + K_O * y[:, 2], 0.0))


def system_2(title: str) -> Motion:
    """Return System 2 in (x, v, z), with the force k (x - z) in contact."""
    x, v, z = hy.make_vars("x", "v", "z")
    force = ON * K * (x - z)

    def land(it: Any) -> None:
        it.pars[0] = 1.0

    rates = [(x, v), (v, G - force / M), (z, (force - K_O * z) / C_O)]
    events = [when(x - z, FALLING, leave, ON), when(z - x, FALLING, land, OFF)]
    t, y = followed(title, rates, [0.0, V_O, 0.0], events)
    return Motion(t, y[:, :1], y[:, 1:2], K * np.maximum(y[:, 0] - y[:, 2], 0.0))


def system_3(title: str) -> Motion:
    """Return System 3 in (x, v, y, z), with y = z in contact."""
    x, v, y, z = hy.make_vars("x", "v", "y", "z")
    rate = (C * v - K * (y - x) - K_O * y) / (C + C_O)
    force = C_O * rate + K_O * y

    def land(it: Any) -> None:
        it.state[3], it.pars[0] = it.state[2], 1.0

    rates = [
        (x, v),
        (v, G - ON * force / M),
        (y, ON * rate + OFF * (v - K / C * (y - x))),
        (z, ON * rate - OFF * K_O / C_O * z),
    ]
    events = [when(force, FALLING, leave, ON), when(z - y, FALLING, land, OFF)]
    t, s = followed(title, rates, [0.0, V_O, 0.0, 0.0], events)
    speed = (C * s[:, 1] - K * (s[:, 2] - s[:, 0]) - K_O * s[:, 2]) / (C + C_O)
    touching = np.abs(s[:, 3] - s[:, 2]) <= 1e-9
    return Motion(t, s[:, :1], s[:, 1:2], np.where(touching, C_O * speed + K_O * s[:, 2], 0.0))


def impact_oscillator(title: str) -> Motion:
    """Return the oscillator that strikes its stop."""
    x, v = hy.make_vars("x", "v")
    amplitude, ω, phase = shaking()

    def bounce(it: Any) -> None:
        it.state[:] = [0.0, -0.8 * it.state[1]]

    rates = [(x, v), (v, amplitude * hy.cos(ω * hy.time + phase) - x - 0.1 * v)]
    start = [0.0, float(CASES[title].problem.v0["x"])]
    t, y = followed(title, rates, start, [when(x, RISING, bounce)], ())
    return Motion(t, y[:, :1], y[:, 1:])


def row(gaps: list[float], wall: float | None, masses: list[float], v: list[float], title: str) -> Motion:
    """Return balls on one line, an event for each gap, with a wall to their right if there is one."""
    n = len(masses)
    q, u = hy.make_vars(*(f"q{i}" for i in range(n))), hy.make_vars(*(f"u{i}" for i in range(n)))

    def struck(i: int) -> Callable[[Any], None]:
        def change(it: Any) -> None:
            it.state[:] = swap(i, np.array(masses), np.array(it.state))

        return change

    def rebound(it: Any) -> None:
        it.state[2 * n - 1] *= -1.0

    events = [when(gap + q[i + 1] - q[i], FALLING, struck(i)) for i, gap in enumerate(gaps)]
    if wall is not None:
        events.append(when(wall - q[-1], FALLING, rebound))
    rates = [*zip(q, u, strict=True), *((each, hy.expression(0.0)) for each in u)]
    t, y = followed(title, rates, [0.0] * n + v, events, ())
    return Motion(t, y[:, :n], y[:, n:])


def coulomb(title: str) -> Motion:
    """Return the oscillator with dry friction: two directions of sliding, and rest."""
    x, v = hy.make_vars("x", "v")

    def turn(it: Any) -> None:
        place = it.state[0]
        sticks = abs(100.0 * place) <= 5.0
        it.state[1] = 0.0
        it.pars[:] = [0.0 if sticks else 1.0, -1.0 if place > 0.0 else 1.0]

    rates = [(x, v), (v, ON * (-100.0 * x - 5.0 * WAY))]
    t, y = followed(title, rates, [0.53, 0.0], [when(WAY * v, FALLING, turn, ON)], (1.0, -1.0))
    return Motion(t, y[:, :1], y[:, 1:])


def incline(title: str) -> Motion:
    """Return the block that slides until its velocity is zero; tan α < μ, so that it stays."""
    α = math.pi / 6.0
    x, v = hy.make_vars("x", "v")

    def stop(it: Any) -> None:
        it.state[1], it.pars[0] = 0.0, 0.0

    rates = [(x, v), (v, ON * 9.81 * (math.sin(α) - 0.7 * math.cos(α)))]
    t, y = followed(title, rates, [0.0, 2.0], [when(v, FALLING, stop, ON)])
    still = np.zeros((len(t), 1))
    return Motion(t, np.hstack([y[:, :1], still]), np.hstack([y[:, 1:], still]))


def filippov(title: str) -> Motion:
    """Return the relay: below and above the surface, sliding on it, and leaving it."""
    x = hy.make_vars("x")

    def arrive(it: Any) -> None:
        from_below = it.pars[1] < 0.0
        it.state[0] = 0.0
        it.pars[:] = [1.0 if from_below else 0.0, 1.0]

    def fall(it: Any) -> None:
        it.pars[:] = [1.0, -1.0]

    events = [when(WAY * x, FALLING, arrive, ON), when(hy.time - 3.0, RISING, fall, OFF)]
    t, y = followed(title, [(x, ON * (2.0 - hy.time - WAY))], [-1.5], events, (1.0, -1.0))
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
    "filippov": filippov,
}

ABSENT = {"diode-bridge": "once the modes are worked out by hand nothing is left to switch: a linear equation"}


def settings(title: str) -> dict[str, tuple[str, partial[Motion]]]:
    """Return the runs of a problem: to its own tolerance, the precision of doubles; the ball to rest with a rule too."""
    runs = {"default": ("tolerance 2e-16", partial(RUNS[title], title))}
    if title.endswith("rest"):
        how = "tolerance 2e-16; a rebound below 1 µm/s is rest"
        runs["tuned"] = (how, partial(ball, title, rest=1e-6))
    return runs
