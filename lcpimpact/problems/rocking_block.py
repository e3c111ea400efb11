r"""A block that rocks from edge to edge: impacts that come ever faster."""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.formula import sqrt
from lcpimpact.problems.base import Problem, above_zero, restitution
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.registered import registered
from lcpimpact.reading import instant, limit
from lcpimpact.scheme.elements.base import GROUND
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.load import Load
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.elements.negative_spring import NegativeSpring
from lcpimpact.scheme.scheme import Scheme


@registered
def rocking_block(
    p: Annotated[float, "rad/s, frequency parameter"] = 2.0,
    alpha: Annotated[float, "rad, slenderness angle α"] = 0.2,
    theta: Annotated[float, "rad, angle θ at the start, below α"] = 0.1,
    e: Annotated[float | None, "1, ratio of the angular velocities after and before an impact"] = None,
) -> Problem:
    r"""Housner's slender block, tilted and let go: it rocks from one edge to the other until it stands.

    A rigid block with the angle α between its diagonal and its side rocks about its lower edges. For small angles
    ``θ'' = p² (θ - α)`` while θ > 0, with ``p² = m g R/I``, and the mirror image while θ < 0: gravity pulls it back less the
    farther it is tilted, a spring of *negative* stiffness. When it lands on the other edge its angular velocity drops by the
    factor e. Folded to y = |θ| that is a mass of unit inertia over the ground, ``y'' - p² y = -p² α`` with ``y'⁺ = -e y'⁻``
    at y = 0; so the scheme has one node, with a load that pulls it to the ground, a negative spring and a bumper.

    With ``s_0 = sqrt(1 - (1 - θ_0/α)²)``, which is the speed at the first impact over p α, and ``s_n = eⁿ s_0``,

    - the first impact is a quarter of a period after the start, ``t_1 = atanh(s_0)/p = acosh(1/(1 - θ_0/α))/p``,
    - half a period later the next, ``t_(n+1) = t_n + 2 atanh(s_n)/p``; between them it tilts to
      ``θ_n = α (1 - sqrt(1 - s_n²))``.

    The period goes to zero with the tilt, so the impacts accumulate as those of the bouncing ball do. Conserving the angular
    momentum about the new edge gives Housner's ``e = 1 - (3/2) sin² α``, the default. A block tilted to θ_0 >= α falls over.
    The trap is to measure a frequency: there is none.

    Raises
    ------
    InputError
        If p, alpha or theta is not above zero, theta is not below alpha, or e lies outside [0, 1].

    Examples
    --------
    >>> [round(fact.value, 6) for fact in rocking_block().facts[:2]]
    [0.658479, 0.34641]

    References
    ----------
    Housner, The behavior of inverted pendulum structures during earthquakes (1963).
    """
    name = "rocking-block"
    above_zero(name, p=p, alpha=alpha, theta=theta)
    if not theta < alpha:
        raise InputError(f"{name}: theta = {theta:g} must be below alpha = {alpha:g}, or the block falls over")
    e = 1.0 - 1.5 * math.sin(alpha) ** 2 if e is None else e
    restitution(name, e)
    φ = theta / alpha
    s_0 = sqrt(φ * (2.0 - φ))

    def impact(n: int) -> float:
        """Return t_n for n >= 1."""
        return (math.atanh(s_0) + 2.0 * sum(math.atanh(e**j * s_0) for j in range(1, n))) / p

    def t_end() -> float:
        return 1.1 * impact(6)

    def facts() -> tuple[Fact, ...]:
        facts: tuple[Fact, ...] = (
            Fact("T/4", "first impact", impact(1), "s", partial(instant, kind="impact")),
            Fact(
                "ω_1",
                "its angular speed",
                p * alpha * s_0,
                "rad/s",
                partial(limit, kind="impact", of="v", i=0, side="left", unit=-1.0),
            ),
        )
        if e > 0.0:
            facts += (
                Fact("t_2", "second impact", impact(2), "s", partial(instant, kind="impact", number=2)),
                Fact("t_3", "third impact", impact(3), "s", partial(instant, kind="impact", number=3)),
                Fact(
                    "ω_3",
                    "its angular speed",
                    p * alpha * e**2 * s_0,
                    "rad/s",
                    partial(limit, kind="impact", number=3, of="v", i=0, side="left", unit=-1.0),
                ),
            )
        return facts

    def motion(t: Array) -> tuple[Array, Array]:
        times = np.asarray(t, dtype=np.float64)
        θ = alpha - (alpha - theta) * np.cosh(p * times)
        rate = -(alpha - theta) * p * np.sinh(p * times)
        t_n, s = math.atanh(s_0) / p, e * s_0
        while t_n <= times.max():
            after = times >= t_n
            # About the top of the arc, where θ' = 0.
            top = np.sqrt((1.0 - s) * (1.0 + s)) * alpha
            τ = p * (times[after] - t_n) - math.atanh(s)
            θ[after] = alpha - top * np.cosh(τ)
            rate[after] = -top * p * np.sinh(τ)
            t_next = t_n + 2.0 * math.atanh(s) / p
            if t_next == t_n:
                θ[after], rate[after] = 0.0, 0.0
                break
            t_n, s = t_next, e * s
        return θ[:, None], rate[:, None]

    return Problem(
        name,
        Scheme(
            Mass("θ", 1.0, symbols=("1",)),
            NegativeSpring("θ", GROUND, p * p, symbols=("p²",)),
            Load("θ", -(p * p) * alpha, symbols=("p²α",)),
            Bumper(GROUND, "θ", e=e),
        ),
        q0={"θ": theta},
        t_end=t_end,
        parameters={"e": e},
        units={"θ": "rad"},
        source="Housner1963",
        facts=facts,
        motion=motion,
    )
