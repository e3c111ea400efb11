r"""Painlevé's rod: Coulomb friction for which accelerations have no solution, or two."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Annotated

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.problems.base import Problem, above_zero
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.registered import registered
from lcpimpact.problems.rods import corner, of_corner, rigid_body
from lcpimpact.reading import Readable, at, crossing, event, final, limit

MU = 5.0 / 3.0
"""The friction with which the rod of `painleve_jam` jams at 45°, and its force grows as p^(-1/3)."""


@registered
def painleve_rod(
    m: Annotated[float, "kg, mass"] = 1.0,
    a: Annotated[float, "m, half the length"] = 1.0,
    phi: Annotated[float, "rad, angle φ of the rod with the floor"] = math.pi / 3.0,
    mu: Annotated[float, "1, coefficient of friction μ"] = 5.0 / 3.0,
    v0: Annotated[float, "m/s, speed at the start, towards the end on the floor"] = 30.0,
    g: Annotated[float, "m/s², gravity"] = 10.0,
) -> Problem:
    r"""A rod pushed along a rough floor, end first: no force fits, and an impulse follows without a collision.

    With ``J = m l²/3`` and the end that leads on the floor, sliding friction makes the rate of the gap
    ``g'' = p r_N/m + b`` with

    - ``p = 1 + 3 cos φ (cos φ - μ sin φ)``, below zero for μ above ``(4 + tan² φ)/(3 tan φ)``, which is at least 4/3,
    - ``b = a φ'² sin φ - g``, which is below zero at the start: *no* r_N >= 0 has ``g'' >= 0`` and ``g'' r_N = 0``.

    The way out is an impulse, although the end does not approach the floor. It ends the slip: ``P = -W⁻¹ (0, U_T)`` with ``W
    = (1/m) [[1 + 3 cos² φ, -3 sin φ cos φ], [-3 sin φ cos φ, 1 + 3 sin² φ]]``, and costs the energy ``v0 P_T/2``. The rod
    then vaults off the floor and flies. The trap is an event-driven code without such an event: it stops here, with a
    solver's message, and time stepping goes on without noticing.

    Raises
    ------
    InputError
        If a parameter is not above zero, phi is not below π/2, or p is not below zero there.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in painleve_rod().facts]
    [9.742785793, 13.125, 19.485571585, 196.875]

    References
    ----------
    Painlevé, Sur les lois du frottement de glissement (1895); Génot and Brogliato, New results on Painlevé paradoxes (1999).
    """
    name = "painleve-rod"
    above_zero(name, m=m, a=a, phi=phi, mu=mu, v0=v0, g=g)
    if not phi < 0.5 * math.pi:
        raise InputError(f"{name}: phi = {phi:g} must be below π/2")
    c, s = math.cos(phi), math.sin(phi)
    if not 1.0 + 3.0 * c * (c - mu * s) < 0.0:
        raise InputError(
            f"{name}: with phi = {phi:g} the rod slides on for mu = {mu:g}; mu must be above "
            f"{(1.0 + 3.0 * c * c) / (3.0 * s * c):g}"
        )
    J = m * a * a / 3.0
    P = -np.linalg.solve(of_corner(m, J, -a * c, -a * s), [0.0, -v0])
    v = np.array([P[1] / m - v0, P[0] / m, (-a * c * P[0] + a * s * P[1]) / J])

    def facts() -> tuple[Fact, ...]:
        return (
            Fact("P_N", "normal impulse", float(P[0]), "N s", partial(_momentum, i=1, m=m, start=0.0, g=g)),
            Fact("P_T", "impulse of friction", float(P[1]), "N s", partial(_momentum, i=0, m=m, start=-v0, g=0.0)),
            Fact("ω", "angular velocity after it", float(v[2]), "rad/s", partial(final, series="v_φ")),
            Fact("E_l", "energy lost", 0.5 * v0 * float(P[1]), "J", partial(_loss, v0=v0)),
        )

    def motion(t: Array) -> tuple[Array, Array]:
        times = np.asarray(t, dtype=np.float64)[:, None]
        fall = np.array([0.0, -g, 0.0])
        return np.array([0.0, a * s, phi]) + v * times + 0.5 * fall * times**2, v + fall * times

    return Problem(
        name,
        rigid_body(m, J, g, [corner("N", -a, 0.0, mu)]),
        q0={"y": a * s, "φ": phi},
        v0={"x": -v0},
        t_end=0.5 * math.pi / float(v[2]),
        units={"φ": "rad"},
        source="Painleve1895; GenotBrogliato1999",
        facts=facts,
        motion=motion,
    )


def _momentum(run: Readable, i: int, m: float, start: float, g: float) -> float:
    """Return the impulse on a coordinate of a rod that flies at last, by its velocity then and at the start."""
    return m * (float(run.v[-1, i]) + g * float(run.t[-1]) - start)


def _loss(run: Readable, v0: float) -> float:
    """Return the energy at the start less that at last."""
    energy = run.problem.dynamics.energy(run.q[[0, -1]], np.array([[-v0, 0.0, 0.0], run.v[-1]]))
    return float(energy[0] - energy[1])


@registered
def painleve_jam(
    m: Annotated[float, "kg, mass"] = 1.0,
    a: Annotated[float, "m, half the length"] = 1.0,
    phi: Annotated[float, "rad, angle φ of the rod at the start"] = math.radians(31.0),
    v0: Annotated[float, "m/s, speed at the start, towards the end on the floor"] = 30.0,
    g: Annotated[float, "m/s², gravity"] = 10.0,
) -> Problem:
    r"""A rod that slides into the singular point of Painlevé's paradox, where its force grows beyond all bounds.

    The rod of `painleve_rod` with μ = 5/3, let go at an angle below 45°, where ``p = 1 + 3 cos φ (cos φ - μ sin φ)`` is
    still above zero. Friction turns it up, and it arrives at 45° with p = 0 *and* ``b = a φ'² sin φ - g = 0``, whatever the
    start:

    - there ``ω = sqrt(g/(a sin 45°))``,
    - ``r_N = -m b/p`` has grown as ``p^(-1/3)``, which is integrable,
    - and it jams: ``P_N = (3/8) m |U_T|``, after which it vaults.

    The time and the slip are integrals; with ``φ = 45° - σ³`` they are smooth. At the point itself flight is a solution as
    well, so time stepping jams or lifts off by chance of its step; until then all agree. The trap is an error estimate: no
    step of an explicit method is short enough near there.

    Raises
    ------
    InputError
        If a parameter is not above zero, phi is not below 45°, or the rod stops before.

    Examples
    --------
    >>> [round(fact.value, 8) for fact in painleve_jam().facts]
    [0.57610637, 0.28991686, 0.81454966, 3.76060309, 3.49991668]

    References
    ----------
    Génot and Brogliato, New results on Painlevé paradoxes (1999); Glocker, *Set-Valued Force Laws* (2001).
    """
    name = "painleve-jam"
    above_zero(name, m=m, a=a, phi=phi, v0=v0, g=g)
    if not phi < 0.25 * math.pi:
        raise InputError(f"{name}: phi = {phi:g} must be below π/4")

    def sliding(t: float, y: Array) -> list[float]:
        """Return the rates of φ, ω and the slip; N is the normal force over m."""
        c, s, ω2 = math.cos(y[0]), math.sin(y[0]), y[1] ** 2
        N = (g - a * ω2 * s) / (1.0 + 3.0 * c * (c - MU * s))
        α = 3.0 / a * N * (MU * s - c)
        return [y[1], α, MU * N + a * (s * α + c * ω2)]

    def near(σ: float, state: Array) -> list[float]:
        """Return the rates of t, the slip and ``y = (g - a ω² sin φ)/σ²`` by σ, all smooth, with φ = 45° - σ³."""
        δ, y = σ**3, state[2]
        c, s = math.cos(0.25 * math.pi - δ), math.sin(0.25 * math.pi - δ)
        P = (1.5 * math.sin(2.0 * δ) + 5.0 * math.sin(δ) ** 2) / (3.0 * δ) if δ else 1.0
        turning = 2.0 - 5.0 * math.sin(2.0 * δ) + 6.0 * math.sin(δ) ** 2  # 6 sin φ (μ sin φ - cos φ)
        ω2 = (g - y * σ * σ) / (a * s)
        by_time = -3.0 / math.sqrt(ω2)
        # With N = y/(3 σ P), times σ².
        α = σ * y / (a * P) * (MU * s - c)
        slip = MU * σ * y / (3.0 * P) + a * (s * α + σ * σ * c * ω2)
        return [
            by_time * σ * σ,
            by_time * slip,
            (turning / P - 2.0) / σ * y + 3.0 * a * ω2 * c if σ else 3.0 * a * ω2 * c,
        ]

    def slides() -> tuple[float, float, Array]:
        """Return when the rod arrives at 45° and its slip there, and (φ, ω, slip) at 3/4 of this time."""
        from scipy.integrate import solve_ivp

        close = 0.24 * math.pi
        far = solve_ivp(
            sliding, (0.0, 100.0 * math.sqrt(a / g)), [phi, 0.0, -v0], "DOP853", rtol=1e-13, atol=1e-14,
            events=[_ending(lambda t, y: y[0] - close), _ending(lambda t, y: y[2])],
        )  # fmt: skip
        if not len(far.t_events[0]):
            raise InputError(f"{name}: with v0 = {v0:g} the rod does not slide up to 45 degrees; raise v0")
        φ, ω, slip = far.y[:, -1]
        σ = (0.25 * math.pi - φ) ** (1.0 / 3.0)
        y = (g - a * ω * ω * math.sin(φ)) / (σ * σ)
        t, slip, _ = solve_ivp(near, (σ, 0.0), [far.t[-1], slip, y], "DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
        then = solve_ivp(sliding, (0.0, 0.75 * t), [phi, 0.0, -v0], "DOP853", rtol=1e-13, atol=1e-14)
        return float(t), float(slip), then.y[:, -1]

    def t_end() -> float:
        return 1.02 * slides()[0]

    def facts() -> tuple[Fact, ...]:
        t, slip, (φ, ω, _) = slides()
        P = 0.375 * m * abs(slip)
        # The impulse ends the slip: P_T = P_N, with equal levers at 45°.
        jam = partial(limit, kind="jam", contact="N", of="v", i=2)
        before = math.sqrt(g / (a * math.sin(0.25 * math.pi)))
        return (
            Fact("φ", "angle after 3/4 of the way", float(φ), "rad", partial(at, series="φ", t=0.75 * t)),
            Fact("ω", "angular velocity then", float(ω), "rad/s", partial(at, series="v_φ", t=0.75 * t)),
            Fact(
                "t_j", "it arrives at 45°", t, "s", partial(crossing, series="φ", level=0.25 * math.pi), accuracy=1e-8
            ),
            Fact("ω_j", "angular velocity there", before, "rad/s", partial(jam, side="left"), accuracy=1e-7),
            Fact("P_N", "normal impulse of the jam", P, "N s", _jam, accuracy=1e-7),
        )

    return Problem(
        name,
        rigid_body(m, m * a * a / 3.0, g, [corner("N", -a, 0.0, MU)]),
        q0={"y": a * math.sin(phi), "φ": phi},
        v0={"x": -v0},
        t_end=t_end,
        units={"φ": "rad"},
        source="GenotBrogliato1999; Glocker2001",
        facts=facts,
    )


def _ending(function: Callable[[float, Array], float]) -> Callable[[float, Array], float]:
    """Return a function that ends an integration where it is zero."""
    function.terminal = True  # type: ignore[attr-defined]
    return function


def _jam(run: Readable) -> float:
    """Return the normal impulse of the first jam."""
    return float(event(run, "jam", contact="N").impulse)
