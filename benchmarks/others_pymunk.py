"""The contestant Pymunk in `others.py`: a 2-D physics engine (Chipmunk), used as its documentation shows.

The default is the time step of the example in its documentation, 0.02 s, with elasticities and frictions of shapes,
which multiply; tuned has a step of 0.1 ms and no collision slop.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
import pymunk
from others_problems import CASES, Motion, shaken

VERSIONS = ("pymunk",)

R = 0.05
"""Radius of all balls in m."""


def space(gravity: tuple[float, float], exact: bool) -> pymunk.Space:
    """Return an empty space; Chipmunk's slop of 0.1 is meant for pixels, and more than these balls."""
    world = pymunk.Space()
    world.gravity = gravity
    world.collision_slop = 0.0 if exact else 1e-3
    return world


def disc(world: pymunk.Space, x: float, y: float, mass: float, elasticity: float) -> pymunk.Body:
    """Add a disc that does not turn."""
    body = pymunk.Body(mass, math.inf)
    body.position = x, y
    shape = pymunk.Circle(body, R)
    shape.elasticity = elasticity
    world.add(body, shape)
    return body


def wall(world: pymunk.Space, face: str, at: float, friction: float = 0.0) -> None:
    """Add a wall whose face is x = at or y = at; it is a metre thick, since a thin one is tunnelled at large steps."""
    ends = ((-10.0, at - 0.5), (10.0, at - 0.5)) if face == "y" else ((at + 0.5, -1.0), (at + 0.5, 1.0))
    segment = pymunk.Segment(world.static_body, *ends, 0.5)
    segment.elasticity, segment.friction = 1.0, friction  # those of two shapes multiply
    world.add(segment)


def stepped(
    world: pymunk.Space, bodies: list[pymunk.Body], title: str, h: float, push: Callable[[float], None] | None = None
) -> tuple[np.ndarray, ...]:
    """Return t, and positions and velocities (nt, bodies, 2)."""
    steps = round(CASES[title].t_end / h)
    q, v = np.zeros((steps + 1, len(bodies), 2)), np.zeros((steps + 1, len(bodies), 2))
    for k in range(steps + 1):
        q[k] = [body.position for body in bodies]
        v[k] = [body.velocity for body in bodies]
        if push:
            push(h * (k + 0.5))
        world.step(h)
    return h * np.arange(steps + 1), q, v


def ball(title: str, h: float, exact: bool) -> Motion:
    """Return a disc on a segment."""
    world = space((0.0, -9.81), exact)
    wall(world, "y", 0.0)
    t, q, v = stepped(world, [disc(world, 0.0, 1.0 + R, 1.0, 0.8)], title, h)
    return Motion(t, 1.0 + R - q[:, :, 1], -v[:, :, 1])


def impact_oscillator(title: str, h: float, exact: bool) -> Motion:
    """Return a disc on a damped spring, between a force and a wall."""
    world = space((0.0, 0.0), exact)
    wall(world, "x", R)
    body = disc(world, 0.0, 0.0, 1.0, 0.8)
    body.velocity = float(CASES[title].problem.v0["x"]), 0.0
    world.add(pymunk.DampedSpring(world.static_body, body, (-10.0, 0.0), (0.0, 0.0), 10.0, 1.0, 0.1))

    def push(t):
        body.apply_force_at_local_point((shaken(t), 0.0))

    t, q, v = stepped(world, [body], title, h, push)
    return Motion(t, q[:, :, 0], v[:, :, 0])


def row(
    masses: list[float], gaps: list[float], last: float | None, v: list[float], title: str, h: float, exact: bool
) -> Motion:
    """Return discs on one line, with a wall to their right if there is one."""
    world = space((0.0, 0.0), exact)
    places = np.cumsum([0.0, *(2.0 * R + gap for gap in gaps)])
    bodies = [disc(world, x, 0.0, m, 1.0) for x, m in zip(places, masses, strict=True)]
    for body, speed in zip(bodies, v, strict=True):
        body.velocity = speed, 0.0
    if last is not None:
        wall(world, "x", places[-1] + R + last)
    t, q, rates = stepped(world, bodies, title, h)
    return Motion(t, q[:, :, 0] - places, rates[:, :, 0])


def block(world: pymunk.Space, friction: float) -> pymunk.Body:
    """Add a box that does not turn, on a rough segment."""
    wall(world, "y", 0.0, friction=1.0)
    body = pymunk.Body(1.0, math.inf)
    body.position = 0.0, R
    shape = pymunk.Poly.create_box(body, (2.0 * R, 2.0 * R))
    shape.friction = friction
    world.add(body, shape)
    return body


def coulomb(title: str, h: float, exact: bool) -> Motion:
    """Return a box on a rough segment, with a spring; its weight gives the friction."""
    world = space((0.0, -9.81), exact)
    body = block(world, 5.0 / 9.81)
    body.position = 0.53, R
    world.add(pymunk.DampedSpring(world.static_body, body, (-10.0, R), (0.0, 0.0), 10.0, 100.0, 0.0))
    t, q, v = stepped(world, [body], title, h)
    return Motion(t, q[:, :, 0], v[:, :, 0])


def incline(title: str, h: float, exact: bool) -> Motion:
    """Return a box on a rough segment under inclined gravity."""
    α = math.pi / 6.0
    world = space((9.81 * math.sin(α), -9.81 * math.cos(α)), exact)
    body = block(world, 0.7)
    body.velocity = 2.0, 0.0
    t, q, v = stepped(world, [body], title, h)
    return Motion(t, (q[:, 0] - [0.0, R]) * [1.0, -1.0], v[:, 0] * [1.0, -1.0])


RUNS = {
    "bouncing-ball": ball,
    "bouncing-ball to rest": ball,
    "impact-oscillator": impact_oscillator,
    "newtons-cradle": partial(row, [1.0] * 5, [0.1, 0.01, 0.01, 0.01], None, [1.0, 0.0, 0.0, 0.0, 0.0]),
    "pi-billiard": partial(row, [100.0, 1.0], [1.0], 1.0, [1.0, 0.0]),
    "coulomb-oscillator": coulomb,
    "block-on-incline": incline,
}

ABSENT = {
    **dict.fromkeys(("system-1", "system-2", "system-3"), "a massless plate: its bodies need mass"),
    "diode-bridge": "no mechanics",
    "filippov": "no mechanics",
}


def settings(title: str) -> dict[str, tuple[str, partial[Motion]]]:
    """Return the runs of a problem."""
    return {
        "default": ("h = 0.02 s", partial(RUNS[title], title, 0.02, False)),
        "tuned": ("h = 0.0001 s, no slop", partial(RUNS[title], title, 1e-4, True)),
    }
