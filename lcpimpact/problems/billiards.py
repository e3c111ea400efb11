r"""Points in boxes: a wedge under gravity, and a box that turns."""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.problems.base import Problem, above_zero, restitution
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.registered import registered
from lcpimpact.reading import Readable, at, first_root, instant, limit
from lcpimpact.scheme.lagrangian import FrictionContact, Lagrangian


@registered
def wedge_billiard(
    m: Annotated[float, "kg, mass"] = 1.0,
    x0: Annotated[float, "m, place at the start, to the side"] = 0.3,
    y0: Annotated[float, "m, height at the start, above the corner"] = 1.0,
    g: Annotated[float, "m/s², gravity"] = 9.81,
) -> Problem:
    r"""A point that bounces in a wedge of 90° without loss: two balls that know nothing of each other.

    The sides are ``y = ±x``. In the distances ``u = (y ∓ x)/√2`` from them gravity is ``g/√2`` each, and an impact on one
    side leaves the other distance alone, so

    - each is a bouncing ball with e = 1: impacts at ``t = T, 3 T, 5 T, ...``, ``T = sqrt(2 √2 u_0/g)``,
    - and the motion is quasi-periodic, in closed form for all times.

    A wedge of any other angle couples the two, and for most the motion is chaotic. The trap is to believe a long run of such
    a billiard; here one sees how long it is right.

    Raises
    ------
    InputError
        If m, y0 or g is not above zero, or the point is not inside of the wedge.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in wedge_billiard().facts]
    [0.377771781, 0.514816159, 0.143641562, 0.831358438]

    References
    ----------
    Lehtihet and Miller, Numerical study of a billiard in a gravitational field (1986).
    """
    name = "wedge-billiard"
    above_zero(name, m=m, y0=y0, g=g)
    if not abs(x0) < y0:
        raise InputError(f"{name}: x0 = {x0:g} and y0 = {y0:g} are outside of the wedge; raise y0")
    c = math.sqrt(0.5)
    starts = c * (y0 - x0), c * (y0 + x0)
    falls = [math.sqrt(2.0 * u / (g * c)) for u in starts]
    t_end = 5.0 * max(falls)

    def facts() -> tuple[Fact, ...]:
        q, _ = motion(np.array([0.9 * t_end]))
        return (
            Fact("t_A", "first impact on the right side", falls[0], "s", partial(instant, kind="impact", contact="A")),
            Fact("t_B", "first impact on the left side", falls[1], "s", partial(instant, kind="impact", contact="B")),
            Fact("x", "place late in the run", float(q[0, 0]), "m", partial(at, series="x", t=0.9 * t_end), scale=y0),
            Fact("y", "height then", float(q[0, 1]), "m", partial(at, series="y", t=0.9 * t_end), scale=y0),
        )

    def motion(t: Array) -> tuple[Array, Array]:
        u, w = [], []
        for u_0, T in zip(starts, falls, strict=True):
            # From one top to the next takes 2 T; the ball is at the top at t = 0.
            s = np.asarray(t, dtype=np.float64)
            s = s - 2.0 * T * np.floor((s + T) / (2.0 * T))
            u.append(u_0 - 0.5 * g * c * s**2)
            w.append(-g * c * s)
        return (
            c * np.column_stack([u[1] - u[0], u[1] + u[0]]),
            c * np.column_stack([w[1] - w[0], w[1] + w[0]]),
        )

    sides = [
        FrictionContact("A", gap=lambda t, q: c * (q[1] - q[0]), e=1.0),
        FrictionContact("B", gap=lambda t, q: c * (q[1] + q[0]), e=1.0),
    ]
    return Problem(
        name,
        Lagrangian("x y", M=lambda q: m * np.eye(2), V=lambda q: m * g * q[1], contacts=sides),
        q0={"x": x0, "y": y0},
        t_end=t_end,
        source="LehtihetMiller1986",
        facts=facts,
        motion=motion,
    )


@registered
def rotating_box(
    m: Annotated[float, "kg, mass of the ball"] = 1.0,
    a: Annotated[float, "m, half the clear width of the box"] = 1.0,
    omega: Annotated[float, "rad/s, angular velocity ω of the box"] = 1.0,
    v_x: Annotated[float, "m/s, velocity at the start"] = 2.0,
    v_y: Annotated[float, "m/s, velocity at the start"] = 0.7,
    e: Annotated[float, "1, coefficient of restitution"] = 1.0,
) -> Problem:
    r"""A ball in a square box that turns: walls that move, without gravity and without friction.

    It starts in the middle, flies straight, and strikes the walls ``n·x = a`` with the normals
    ``n = (cos(ω t + k π/2), sin(ω t + k π/2))``. The gap g depends on the time, so that

    - its rate is ``U = -n·v - n'·x``, and an impact changes the velocity by ``(1 + e) U n``, the wall's own motion included,
    - impacts are roots of one function of the time each, ``n(t)·(x + v t) = a``,
    - and with e = 1 ``m v²/2 - ω m (x v_y - y v_x)`` is kept, the energy as the box sees it.

    The ball gains and loses energy; what it gains the drive of the box supplies. The trap is an energy balance without the
    work of walls that move.

    Raises
    ------
    InputError
        If m or a is not above zero, e lies outside [0, 1], or the ball is at rest.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in rotating_box().facts]
    [0.476586208, 1.708639705, 1.928421902, 2.342092413, 2.581047507, -1.509943308, -0.948263237, 2.245]

    References
    ----------
    Brogliato, *Nonsmooth Mechanics* (2016).
    """
    name = "rotating-box"
    above_zero(name, m=m, a=a)
    restitution(name, e)
    if not math.hypot(v_x, v_y) > 0.0:
        raise InputError(f"{name}: the ball is at rest; change v_x or v_y")

    def normal(t: Array | float, k: int) -> Array:
        return np.array([np.cos(omega * t + 0.5 * math.pi * k), np.sin(omega * t + 0.5 * math.pi * k)])

    def flight(t: float, x: Array, v: Array) -> tuple[float, int]:
        """Return how long the ball flies from x at the time t, and the wall that it strikes."""
        until = 2.0 * math.sqrt(2.0) * a / math.hypot(*v)

        def gap(s: Array, k: int) -> Array:
            n = normal(t + s, k)
            return np.asarray(a - n[0] * (x[0] + v[0] * s) - n[1] * (x[1] + v[1] * s))

        turn = min(until, 2.0 * math.pi / max(abs(omega), 1e-9))
        found = [(first_root(partial(gap, k=k), 1.001 * until, turn), k) for k in range(4)]
        return min((s, k) for s, k in found if s is not None)

    def impacts(number: int) -> list[tuple[float, Array]]:
        """Return the first impacts: when, and the velocity after each."""
        t, x, v = 0.0, np.zeros(2), np.array([v_x, v_y])
        found: list[tuple[float, Array]] = []
        while len(found) < number:
            s, k = flight(t, x, v)
            t, x = t + s, x + s * v
            n = normal(t, k)
            U = -n @ v - omega * normal(t, k + 1) @ x
            v = v + (1.0 + e) * U * n
            found.append((t, v))
        return found

    def t_end() -> float:
        return 1.01 * impacts(5)[-1][0]

    def facts() -> tuple[Fact, ...]:
        known = impacts(5)
        size = math.hypot(v_x, v_y)
        last = known[-1][1]
        facts = (
            *(
                Fact(f"t_{n}", f"impact {n}", t, "s", partial(instant, kind="impact", number=n))
                for n, (t, _) in enumerate(known, start=1)
            ),
            *(
                Fact(f"v_{series}", "velocity after the last", float(last[i]), "m/s",
                     partial(limit, kind="impact", number=5, of="v", i=i, side="right"), scale=size)
                for i, series in enumerate("xy")
            ),
        )  # fmt: skip
        if e == 1.0:
            kept = partial(_energy_in_box, m=m, omega=omega)
            facts += (Fact("H", "energy as the box sees it", 0.5 * m * size * size, "J", kept),)
        return facts

    def wall(k: int) -> FrictionContact:
        return FrictionContact(f"N{k + 1}", gap=lambda t, q: a - normal(t, k) @ q, e=e)

    return Problem(
        name,
        Lagrangian("x y", M=lambda q: m * np.eye(2), contacts=[wall(k) for k in range(4)]),
        v0={"x": v_x, "y": v_y},
        t_end=t_end,
        source="Brogliato2016",
        facts=facts,
    )


def _energy_in_box(run: Readable, m: float, omega: float) -> float:
    """Return m v²/2 - ω m (x v_y - y v_x) at the end."""
    (x, y), (v, w) = run.q[-1], run.v[-1]
    return float(0.5 * m * (v * v + w * w) - omega * m * (x * w - y * v))
