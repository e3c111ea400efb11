r"""Mechanisms: slider-cranks with and without clearance, four-bar linkages, a chain of rods, the woodpecker as bodies."""

from __future__ import annotations

import math
from functools import partial
from itertools import pairwise
from typing import Annotated, NamedTuple

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.problems.base import Problem, above_zero, defaults, restitution, whole
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.registered import registered
from lcpimpact.problems.woodpecker import Lengths
from lcpimpact.problems.woodpecker import woodpecker as linear_woodpecker
from lcpimpact.reading import Readable, at, crossing, event, final, instant
from lcpimpact.scheme.lagrangian import FrictionContact, Joint, Lagrangian


class SliderCrankData(NamedTuple):
    """The lengths of a slider-crank in m, its masses in kg and moments of inertia in kg m².

    Attributes
    ----------
    l_1, l_2 : float    crank and connecting rod
    a, b : float        half the length and half the height of the slider
    m_1, m_2, m_3 : float
    J_1, J_2, J_3 : float
    """

    l_1: float = 0.153
    l_2: float = 0.306
    a: float = 0.05
    b: float = 0.025
    m_1: float = 0.038
    m_2: float = 0.038
    m_3: float = 0.076
    J_1: float = 7.4e-5
    J_2: float = 5.9e-4
    J_3: float = 2.7e-6

    def turns(self) -> tuple[float, float, float, float, float]:
        """Return A, B, X, G: T = A φ_1'²/2 + B φ_2'²/2 + X cos(φ_2 - φ_1) φ_1' φ_2', V = g (G_1 sin φ_1 + G_2 sin φ_2)."""
        l_1, l_2, _, _, m_1, m_2, m_3, J_1, J_2, _ = self
        A, B = J_1 + (0.25 * m_1 + m_2 + m_3) * l_1**2, J_2 + (0.25 * m_2 + m_3) * l_2**2
        return A, B, (0.5 * m_2 + m_3) * l_1 * l_2, (0.5 * m_1 + m_2 + m_3) * l_1, (0.5 * m_2 + m_3) * l_2


@registered
def slider_crank(
    c: Annotated[float, "m, clearance between the slider and each side of its guide"] = 0.001,
    mu: Annotated[float, "1, coefficient of friction μ"] = 0.01,
    e: Annotated[float, "1, coefficient of restitution"] = 0.4,
    omega1: Annotated[float, "rad/s, angular velocity of the crank at the start"] = 150.0,
    omega2: Annotated[float, "rad/s, angular velocity of the rod at the start"] = -75.0,
    g: Annotated[float, "m/s², gravity"] = 9.81,
) -> Problem:
    r"""A slider-crank whose slider has clearance in its guide: four corners that strike both sides.

    Angles of the crank, the connecting rod and the slider. Until the first corner strikes, the slider hangs on a double
    pendulum that nobody guides; then each of its corners may touch, with friction:

    - until then the energy is that of the start, ``½ vᵀ M v`` with
      ``M_11 = J_1 + (m_1/4 + m_2 + m_3) l_1²``, ``M_12 = (m_2/2 + m_3) l_1 l_2 cos(φ_2 - φ_1)``,
      ``M_22 = J_2 + (m_2/4 + m_3) l_2²``, and ``M_33 = J_3``,
    - and the slider does not turn, as no moment acts on it,
    - so two corners of one side strike at once.

    With the values here the digits of the first impact are known from integrations with DOP853 and with LSODA. The trap is
    to hold positions only: corners that strike in pairs share their impulses by the law of both.

    Raises
    ------
    InputError
        If c or g is not above zero, mu is negative, or e lies outside [0, 1].

    Examples
    --------
    >>> [round(fact.value, 9) for fact in slider_crank().facts]
    [0.0, 0.0, 0.002692503]

    References
    ----------
    Flores, Leine and Glocker, Modeling and analysis of planar rigid multibody systems with translational clearance joints
    (2010).
    """
    name = "slider-crank"
    above_zero(name, c=c, g=g)
    restitution(name, e)
    if mu < 0.0:
        raise InputError(f"{name}: mu = {mu:g} must not be negative")
    data = SliderCrankData()
    l_1, l_2, a, b, J_3 = data.l_1, data.l_2, data.a, data.b, data.J_3
    A, B, X, G_1, G_2 = data.turns()

    def M(q: Array) -> Array:
        x = X * np.cos(q[1] - q[0])
        return np.array([[A, x, 0.0], [x, B, 0.0], [0.0, 0.0, J_3]])

    def corner(name: str, x: float, side: float) -> FrictionContact:
        """Return the contact of the corner (x, side b) of the slider with the upper (1) or lower (-1) side of the guide."""

        def lift(q: Array) -> Array:
            return np.asarray(x * np.sin(q[2]) + side * b * np.cos(q[2]))

        return FrictionContact(
            name,
            gap=lambda t, q: b + c - side * (l_1 * np.sin(q[0]) + l_2 * np.sin(q[1]) + lift(q)),
            slip=lambda t, q, v: -l_1 * np.sin(q[0]) * v[0] - l_2 * np.sin(q[1]) * v[1] - lift(q) * v[2],
            mu=mu,
            e=e,
        )

    def facts() -> tuple[Fact, ...]:
        v = np.array([omega1, omega2, 0.0])
        size = 0.5 * float(v @ np.asarray(M(np.zeros(3)), dtype=float) @ v)
        known: tuple[Fact, ...] = (
            Fact("E_d", "energy before the first impact less that of the start", 0.0, "J", _gained, scale=size),
            Fact("φ_3", "angle of the slider then", 0.0, "rad", _turned, scale=1.0),
        )
        if problem.parameters == defaults(slider_crank):
            first = Fact("t_1", "first impact", 0.00269250275202, "s", partial(instant, kind="impact"), digits=12)
            known += (first,)
        return known

    problem = Problem(
        name,
        Lagrangian(
            "φ_1 φ_2 φ_3",
            M=M,
            V=lambda q: g * (G_1 * np.sin(q[0]) + G_2 * np.sin(q[1])),
            contacts=[corner("A", -a, 1.0), corner("B", a, 1.0), corner("C", -a, -1.0), corner("D", a, -1.0)],
        ),
        v0={"φ_1": omega1, "φ_2": omega2},
        t_end=0.02,
        units=dict.fromkeys(("φ_1", "φ_2", "φ_3"), "rad"),
        source="FloresLeineGlocker2010",
        facts=facts,
    )
    return problem


def _gained(run: Readable) -> float:
    """Return the energy before the first impact less that of the start."""
    left = event(run, "impact").left
    energy = run.problem.dynamics.energy(np.stack([run.q[0], left.q]), np.stack([run.v[0], left.v]))
    return float(energy[1] - energy[0])


def _turned(run: Readable) -> float:
    """Return the angle of the slider before the first impact."""
    return float(event(run, "impact").left.q[2])


@registered
def guided_slider_crank(
    omega: Annotated[float, "rad/s, angular velocity of the crank at the start"] = 20.0,
    g: Annotated[float, "m/s², gravity"] = 9.81,
) -> Problem:
    r"""A slider-crank without clearance: one joint, one degree of freedom, and an inertia that depends on the crank.

    The lengths and masses of `slider_crank`, with ``l_1 sin φ_1 + l_2 sin φ_2 = 0`` for the guide. The rod turns with
    ``φ_2' = ρ φ_1'``, ``ρ = -λ cos φ_1/cos φ_2``, ``λ = l_1/l_2``, so with ``T = A φ_1'²/2 + B φ_2'²/2 + X cos(φ_2 - φ_1)
    φ_1' φ_2'`` the crank has the inertia ``I(φ_1) = A + 2 X ρ cos(φ_2 - φ_1) + B ρ²``:

    - ``I φ_1'²/2 + V`` is kept: at 90° ρ = 0, and ``A ω_90² = I(0) ω_0² - g (m_1 + m_2) l_1``,
    - half a turn takes ``∫ dφ_1/φ_1'``, after which the crank has ω_0 again,
    - and at 90°, with ``ρ' = λ/cos φ_2``, the guide carries
      ``((B - (λ X)²/A) ρ'/cos φ_2 - X) ω²/l_2 + (m_2/2 + m_3) g``.

    The trap is a mass matrix of the beginning of a step, which costs an order.

    Raises
    ------
    InputError
        If omega or g is not above zero, or the crank does not get over.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in guided_slider_crank().facts]
    [0.175459698, 7.170229081, 0.960663477, 0.308218353]

    References
    ----------
    Flores, Leine and Glocker, Modeling and analysis of planar rigid multibody systems with translational clearance joints
    (2010), for the data.
    """
    name = "guided-slider-crank"
    above_zero(name, omega=omega, g=g)
    data = SliderCrankData()
    l_1, l_2, (A, B, X, G_1, G_2) = data.l_1, data.l_2, data.turns()
    λ = l_1 / l_2

    def speed(φ: float) -> float:
        """Return φ_1' by the energy, 0 where there is none left."""
        rod = -math.asin(λ * math.sin(φ))
        ρ = -λ * math.cos(φ) / math.cos(rod)
        inertia = A + 2.0 * X * ρ * math.cos(rod - φ) + B * ρ * ρ
        at_start = A - 2.0 * X * λ + B * λ * λ
        return math.sqrt(max(at_start * omega**2 - 2.0 * g * (G_1 - λ * G_2) * math.sin(φ), 0.0) / inertia)

    if not speed(0.5 * math.pi) > 0.0:
        raise InputError(f"{name}: with omega = {omega:g} the crank does not get over; raise omega")

    def time(φ: float) -> float:
        """Return when the crank has turned by φ."""
        from scipy.integrate import quad

        return float(quad(lambda each: 1.0 / speed(each), 0.0, φ, epsabs=0.0, epsrel=1e-13)[0])

    def t_end() -> float:
        return 1.1 * time(math.pi)

    def facts() -> tuple[Fact, ...]:
        t, ω = time(0.5 * math.pi), speed(0.5 * math.pi)
        R = ((B - (λ * X) ** 2 / A) * λ / (1.0 - λ * λ) - X) * ω**2 / l_2 + (0.5 * data.m_2 + data.m_3) * g
        return (
            Fact("t_90", "a quarter of a turn", t, "s", partial(crossing, series="φ_1", level=0.5 * math.pi)),
            Fact("ω_90", "angular velocity of the crank then", ω, "rad/s", partial(at, series="v_φ_1", t=t)),
            Fact("R_90", "force of the guide then", R, "N", partial(at, series="guide", t=t)),
            Fact("t_180", "half a turn", time(math.pi), "s", partial(crossing, series="φ_1", level=math.pi)),
        )

    return Problem(
        name,
        Lagrangian(
            "φ_1 φ_2",
            M=lambda q: np.array([[A, X * np.cos(q[1] - q[0])], [X * np.cos(q[1] - q[0]), B]]),
            V=lambda q: g * (G_1 * np.sin(q[0]) + G_2 * np.sin(q[1])),
            joints=[Joint("guide", gap=lambda t, q: l_1 * np.sin(q[0]) + l_2 * np.sin(q[1]))],
        ),
        v0={"φ_1": omega, "φ_2": -λ * omega},
        t_end=t_end,
        units=dict.fromkeys(("φ_1", "φ_2"), "rad"),
        source="FloresLeineGlocker2010",
        facts=facts,
    )


def _bodies(count: int) -> list[str]:
    """Return the names of the coordinates of some rods."""
    return [f"{letter}{i}" for i in range(1, count + 1) for letter in ("x", "y", "φ")]


def _rods(count: int, m: float, L: float, g: float, joints: list[Joint]) -> Lagrangian:
    """Return uniform rods of mass m and length L, with x and y of the middle and the angle from the x-axis of each."""
    diagonal = np.tile([m, m, m * L * L / 12.0], count)
    return Lagrangian(_bodies(count), M=lambda q: np.diag(diagonal), V=lambda q: m * g * sum(q[1::3]), joints=joints)


def _pin(
    name: str, a: tuple[int, float], b: tuple[int, float] | tuple[float, float], L: float, ground: bool
) -> list[Joint]:
    """Return the joints x and y between places of two rods, or of one rod and a point of the ground.

    A place is the number of a rod, from 0, and -1 or 1 for its ends.
    """

    def end(q: Array, rod: int, side: float) -> tuple[Array, Array]:
        x, y, φ = q[3 * rod : 3 * rod + 3]
        return x + 0.5 * side * L * np.cos(φ), y + 0.5 * side * L * np.sin(φ)

    def other(q: Array) -> tuple[Array | float, Array | float]:
        return b if ground else end(q, int(b[0]), b[1])

    return [
        Joint(f"{name}_x", gap=lambda t, q: end(q, *a)[0] - other(q)[0]),
        Joint(f"{name}_y", gap=lambda t, q: end(q, *a)[1] - other(q)[1]),
    ]


@registered
def four_bars(
    N: Annotated[float, "1, number of four-bar linkages side by side"] = 1,
    m: Annotated[float, "kg, mass of each rod"] = 1.0,
    L: Annotated[float, "m, length of each rod"] = 1.0,
    v0: Annotated[float, "m/s, velocity of the upper joints at the start"] = 1.0,
    g: Annotated[float, "m/s², gravity"] = 9.81,
) -> Problem:
    r"""N four-bar linkages of equal rods: joints alone, and a motion that falls over by elliptic integrals.

    2 N + 1 rods with three coordinates each and 3 N + 1 pins: one degree of freedom, the angle θ from upright of the N + 1
    rods on the ground; the N rods on top of them stay level. With ``Ω² = (g/L) (3 N + 1)/2/(N + (N + 1)/3)``

    - ``θ'' = Ω² sin θ``, ``θ'² = (v0/L)² + 4 Ω² sin²(θ/2)``,
    - from upright to θ takes ``2 (L/v0) F(θ/2, k)`` with ``k² = -(2 Ω L/v0)²``.

    The run ends before the rods lie level: there all of them lie on one line, the joints depend on one another, and N more
    degrees of freedom open for an instant. That is the trap, for which this mechanism is a benchmark.

    Raises
    ------
    InputError
        If N is no whole number from 1 on, or m, L, v0 or g is not above zero.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in four_bars().facts]
    [0.585169359, 3.573793503, 0.866025404, 0.5]

    References
    ----------
    González, Dopico, Lugrís and Cuadrado, A benchmarking system for MBS simulation software (2006), problem A02.
    """
    name = "coupled-linkages"
    above_zero(name, m=m, L=L, v0=v0, g=g)
    n = whole(name, "N", N)
    rate2 = g / L * (1.5 * n + 0.5) / (n + (n + 1.0) / 3.0)
    level = math.pi / 3.0

    def time(θ: float) -> float:
        """Return when the rods have fallen by θ."""
        from scipy.special import ellipkinc

        w = v0 / L
        return 2.0 / w * float(ellipkinc(0.5 * θ, -4.0 * rate2 / (w * w)))

    def t_end() -> float:
        return time(0.45 * math.pi)

    def facts() -> tuple[Fact, ...]:
        t = time(level)
        ω = math.sqrt((v0 / L) ** 2 + 4.0 * rate2 * math.sin(0.5 * level) ** 2)
        return (
            Fact("t", "the rods have fallen by 60°", t, "s",
                 partial(crossing, series="φ1", level=0.5 * math.pi - level, direction=-1.0)),
            Fact("ω", "their angular velocity then", ω, "rad/s", partial(_falling, t=t)),
            Fact("x", "place of the first upper joint then", L * math.sin(level), "m", partial(_upper, i=0, t=t)),
            Fact("y", "its height", L * math.cos(level), "m", partial(_upper, i=1, t=t)),
        )  # fmt: skip

    # Rods 0 ... n stand on the ground, and rods n + 1 ... 2 n lie on top of them.
    joints: list[Joint] = []
    for i in range(n + 1):
        joints += _pin(f"foot{i + 1}", (i, -1.0), (i * L, 0.0), L, ground=True)
    for i in range(n):
        top = n + 1 + i
        joints += _pin(f"left{i + 1}", (top, -1.0), (i, 1.0), L, ground=False)
        joints += _pin(f"right{i + 1}", (top, 1.0), (i + 1, 1.0), L, ground=False)
    q0: dict[str, float] = {}
    v_0: dict[str, float] = {}
    for i in range(n + 1):
        q0 |= {f"x{i + 1}": i * L, f"y{i + 1}": 0.5 * L, f"φ{i + 1}": 0.5 * math.pi}
        v_0 |= {f"x{i + 1}": 0.5 * v0, f"φ{i + 1}": -v0 / L}
    for i in range(n):
        q0 |= {f"x{n + i + 2}": (i + 0.5) * L, f"y{n + i + 2}": L}
        v_0 |= {f"x{n + i + 2}": v0}
    return Problem(
        name,
        _rods(2 * n + 1, m, L, g, joints),
        q0=q0,
        v0=v_0,
        t_end=t_end,
        units={f"φ{i}": "rad" for i in range(1, 2 * n + 2)},
        source="GonzalezDopicoLugrisCuadrado2006, problem A02",
        facts=facts,
    )


def _falling(run: Readable, t: float) -> float:
    """Return minus the angular velocity of the first rod at a time."""
    return -at(run, "v_φ1", t)


def _upper(run: Readable, i: int, t: float) -> float:
    """Return x or y of the upper end of the first rod at a time, twice those of its middle."""
    return 2.0 * at(run, ("x1", "y1")[i], t)


@registered
def rod_chain(
    N: Annotated[float, "1, number of rods"] = 3,
    m: Annotated[float, "kg, mass of each rod"] = 1.0,
    L: Annotated[float, "m, length of each rod"] = 0.2,
    omega: Annotated[float, "rad/s, angular velocity ω"] = 6.0,
) -> Problem:
    r"""A chain of rods that whirls about a pin: 2 N joints, and a motion that is known for any number of rods.

    The rods lie on one line and turn about its inner end at ω, without gravity. That is a motion of the chain, and a stable
    one: each pin pulls the rods outside of it along with

    - ``R_i = m L ω² Σ_(j >= i) (j - 1/2) = m L ω² (N² - (i - 1)²)/2``,
    - ``m L ω² N²/2`` in the inner pin, ``m L ω² (N - 1/2)`` in the outermost.

    There are 3 N coordinates: a method for many bodies shows its cost here. The trap is to hold velocities only: the rods
    then move along tangents, and the chain grows longer in every step.

    Raises
    ------
    InputError
        If N is no whole number from 1 on, or m, L or omega is not above zero.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in rod_chain().facts]
    [7.0, 0.376951127, 32.4, 18.0]

    References
    ----------
    Glocker, *Set-Valued Force Laws* (2001).
    """
    name = "rod-chain"
    above_zero(name, m=m, L=L, omega=omega)
    n = whole(name, "N", N)
    t_end = 7.0 / omega

    def facts() -> tuple[Fact, ...]:
        pull = m * L * omega**2
        end = (n - 0.5) * L * math.cos(7.0)
        return (
            Fact("φ_N", "angle of the last rod at the end", 7.0, "rad", partial(final, series=f"φ{n}")),
            Fact("x_N", "place of its middle", end, "m", partial(final, series=f"x{n}"), scale=n * L),
            Fact("R_1", "force of the inner pin", 0.5 * pull * n * n, "N", partial(_pull, name="pin1", t=0.5 * t_end)),
            Fact(
                "R_N",
                "force of the outermost pin",
                pull * (n - 0.5),
                "N",
                partial(_pull, name=f"pin{n}", t=0.5 * t_end),
            ),
        )

    def motion(t: Array) -> tuple[Array, Array]:
        φ = omega * np.asarray(t, dtype=np.float64)[:, None]
        r = L * (np.arange(n) + 0.5)
        c, s = r * np.cos(φ), r * np.sin(φ)
        q = np.stack([c, s, np.broadcast_to(φ, c.shape)], axis=-1)
        v = omega * np.stack([-s, c, np.ones_like(c)], axis=-1)
        return q.reshape(len(φ), -1), v.reshape(len(φ), -1)

    joints = _pin("pin1", (0, -1.0), (0.0, 0.0), L, ground=True)
    for i, j in pairwise(range(n)):
        joints += _pin(f"pin{j + 1}", (j, -1.0), (i, 1.0), L, ground=False)
    return Problem(
        name,
        _rods(n, m, L, 0.0, joints),
        q0={f"x{i + 1}": (i + 0.5) * L for i in range(n)},
        v0={f"{letter}{i + 1}": omega * r for i in range(n) for letter, r in (("y", (i + 0.5) * L), ("φ", 1.0))},
        t_end=t_end,
        units={f"φ{i}": "rad" for i in range(1, n + 1)},
        source="Glocker2001",
        facts=facts,
        motion=motion,
    )


def _pull(run: Readable, name: str, t: float) -> float:
    """Return the force of a pin at a time."""
    return math.hypot(at(run, f"{name}_x", t), at(run, f"{name}_y", t))


@registered
def woodpecker_bodies(
    m_M: Annotated[float, "kg, mass of the sleeve"] = 0.0003,
    m_S: Annotated[float, "kg, mass of the woodpecker"] = 0.0045,
    J_M: Annotated[float, "kg m², moment of inertia of the sleeve"] = 5e-9,
    J_S: Annotated[float, "kg m², moment of inertia of the woodpecker"] = 7e-7,
    c: Annotated[float, "N m, stiffness of the spring"] = 0.0056,
    mu: Annotated[float, "1, coefficient of friction μ of all contacts"] = 0.3,
    e: Annotated[float, "1, coefficient of restitution of the beak"] = 0.5,
    g: Annotated[float, "m/s², gravity"] = 9.81,
) -> Problem:
    r"""The woodpecker toy by its energies and gaps: three contacts with friction, each a gap and a slip.

    The coordinates of `woodpecker`: y of the sleeve downwards, its angle φ_M and φ_S of the bird. Here one writes

    - ``T = m_M y'²/2 + J_M φ_M'²/2 + J_S φ_S'²/2 + m_S (y' + l_M φ_M' + l_G φ_S')²/2``,
    - ``V = c (φ_M - φ_S)²/2 - (m_M + m_S) g y - m_S g (l_M φ_M + l_G φ_S)``,
    - and for the beak and the edges of the sleeve a gap and a slip each; rows and forces follow.

    Its motion is that of the linear scheme, with the same period of 0.146 s: a check of what is derived against what was
    written by hand. The trap is to derive by hand: the weights of the sleeve and of the bird appear in all three equations.

    Raises
    ------
    InputError
        As `woodpecker`.

    Examples
    --------
    >>> [round(fact.value, 9) for fact in woodpecker_bodies().facts]
    [0.145976065, 0.019445379, 17.574666206, 0.019811179, 16.911177368]

    References
    ----------
    Glocker and Studer, Formulation and preparation for numerical evaluation of linear complementarity systems in dynamics
    (2005); Leine, Glocker and van Campen, Nonlinear dynamics of the woodpecker toy (2001).
    """
    linear = linear_woodpecker(m_M=m_M, m_S=m_S, J_M=J_M, J_S=J_S, c=c, mu=mu, e=e, g=g)
    r_O, r_M, h_M, l_M, l_G, h_S, l_S = Lengths()
    lever = np.array([1.0, l_M, l_G])

    def V(q: Array) -> Array:
        return np.asarray(0.5 * c * (q[1] - q[2]) ** 2 - m_M * g * q[0] - m_S * g * (lever @ q))

    def sleeve(name: str, side: float) -> FrictionContact:
        """Return the contact of the lower (-1) or the upper (1) edge of the sleeve."""
        return FrictionContact(
            name, gap=lambda t, q: r_M - r_O + side * h_M * q[1], slip=lambda t, q, v: v[0] + r_M * v[1], mu=mu
        )

    beak = FrictionContact(
        "N1",
        gap=lambda t, q: l_M + l_G - l_S - r_O + h_S * q[2],
        slip=lambda t, q, v: v[0] + l_M * v[1] + (l_G - l_S) * v[2],
        mu=mu,
        e=e,
    )

    def facts() -> tuple[Fact, ...]:
        return linear.facts

    return Problem(
        "woodpecker-bodies",
        Lagrangian(
            "y φ_M φ_S",
            M=lambda q: np.diag([m_M, J_M, J_S]) + m_S * np.outer(lever, lever),
            V=V,
            contacts=[beak, sleeve("N2", -1.0), sleeve("N3", 1.0)],
        ),
        q0=linear.q0,
        v0=linear.v0,
        t_end=linear.t_end,
        units={"φ_M": "rad", "φ_S": "rad"},
        source=linear.source,
        facts=facts,
    )
