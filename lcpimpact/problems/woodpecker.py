r"""The woodpecker toy: friction that locks and lets go, and impacts with friction, in one cycle."""

from __future__ import annotations

from functools import partial
from typing import Annotated, NamedTuple

from lcpimpact.problems.base import Problem, above_zero, defaults, restitution
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.registered import registered
from lcpimpact.reading import Readable, at, crossing, instant, limit
from lcpimpact.scheme.elements.base import GROUND
from lcpimpact.scheme.elements.friction import Friction
from lcpimpact.scheme.scheme import Scheme

ANGLE, SPEED = 0.2051353492435296, -17.574666205577
"""φ_S and φ_S' of the periodic motion where the sleeve begins to slip, for the values of the source."""


class Lengths(NamedTuple):
    """The lengths of the source in m.

    Attributes
    ----------
    r_O, r_M : float    radii of the pole and of the hole of the sleeve
    h_M : float         half the height of the sleeve
    l_M : float         from the middle of the sleeve to the spring
    l_G : float         from there to the centre of the woodpecker
    h_S, l_S : float    from this centre to the beak, upwards and towards the pole
    """

    r_O: float = 0.0025
    r_M: float = 0.0031
    h_M: float = 0.0058
    l_M: float = 0.010
    l_G: float = 0.015
    h_S: float = 0.02
    l_S: float = 0.0201


@registered
def woodpecker(
    m_M: Annotated[float, "kg, mass of the sleeve"] = 0.0003,
    m_S: Annotated[float, "kg, mass of the woodpecker"] = 0.0045,
    J_M: Annotated[float, "kg m², moment of inertia of the sleeve"] = 5e-9,
    J_S: Annotated[float, "kg m², moment of inertia of the woodpecker"] = 7e-7,
    c: Annotated[float, "N m, stiffness of the spring"] = 0.0056,
    mu: Annotated[float, "1, coefficient of friction μ of all contacts"] = 0.3,
    e: Annotated[float, "1, coefficient of restitution of the beak"] = 0.5,
    g: Annotated[float, "m/s², gravity"] = 9.81,
) -> Problem:
    r"""A toy woodpecker that pecks its way down a pole.

    A sleeve with play runs on a pole, and the woodpecker sits on it by a spring. Coordinates are y of the sleeve downwards,
    its angle φ_M and that φ_S of the woodpecker. For small angles their mass matrix is constant, with the kinetic energy
    ``m_M y'²/2 + J_M φ_M'²/2 + J_S φ_S'²/2 + m_S (y' + l_M φ_M' + l_G φ_S')²/2``.

    Three points may touch the pole, all with friction: the beak, ``u = l_M + l_G - l_S - r_O + h_S φ_S``, with restitution
    e, and the lower and the upper edge of the sleeve, ``u = r_M - r_O ∓ h_M φ_M``, which do not rebound. In a cycle the
    tilted sleeve is jammed while the woodpecker swings; it lets go, the toy falls, the other edge strikes, the beak strikes
    and throws the woodpecker back, and the sleeve jams again. With the values of the source that is an attracting periodic
    motion of 0.146 s; a deviation is multiplied by -0.84 in each cycle. The run starts on it, where the sleeve begins to
    slip.

    It hangs still as well, jammed, for ``μ >= h_M (m_M + m_S)/(m_S (l_M + l_G) - r_M (m_M + m_S)) = 0.285``: the pecking
    needs a push. The trap is a friction that is solved after the normal forces: the jam is a matter of both at once.

    Raises
    ------
    InputError
        If a parameter is not above zero, or e lies outside [0, 1].

    Examples
    --------
    >>> [round(fact.value, 9) for fact in woodpecker().facts]
    [0.145976065, 0.019445379, 17.574666206, 0.019811179, 16.911177368]

    References
    ----------
    Glocker and Studer, Formulation and preparation for numerical evaluation of linear complementarity systems in dynamics
    (2005); Leine, Glocker and van Campen, Nonlinear dynamics of the woodpecker toy (2001).
    """
    name = "woodpecker"
    above_zero(name, m_M=m_M, m_S=m_S, J_M=J_M, J_S=J_S, c=c, mu=mu, e=e, g=g)
    restitution(name, e)
    r_O, r_M, h_M, l_M, l_G, h_S, l_S = Lengths()
    m = m_M + m_S
    S_M = m_S * l_M
    S_S = m_S * l_G
    scheme = Scheme.of_matrices(
        [[m, S_M, S_S], [S_M, J_M + S_M * l_M, S_M * l_G], [S_S, S_M * l_G, J_S + S_S * l_G]],
        K=[[0.0, 0.0, 0.0], [0.0, c, -c], [0.0, -c, c]],
        f=[m * g, S_M * g, S_S * g],
        H=[[0.0, 0.0, h_S], [0.0, -h_M, 0.0], [0.0, h_M, 0.0]],
        gaps=[l_M + l_G - l_S - r_O, r_M - r_O, r_M - r_O],
        e=[e, 0.0, 0.0],
        coordinates=("y", "φ_M", "φ_S"),
        contacts=("N1", "N2", "N3"),
    )
    beak = {"y": 1.0, "φ_M": l_M, "φ_S": l_G - l_S}
    sleeve = {"y": 1.0, "φ_M": r_M}
    for i, rim in enumerate((beak, sleeve, sleeve), start=1):
        scheme.add(Friction(rim, GROUND, mu, normal=f"N{i}", name=f"F{i}"))

    def facts() -> tuple[Fact, ...]:
        """Return the facts of the periodic motion, a fixed point of the map of a cycle found by Newton's method."""
        if problem.parameters != defaults(woodpecker):
            return ()
        beak = partial(limit, kind="impact", contact="N1", of="v", i=2, side="left", unit=-1.0)
        T = 0.14597606514
        return (
            Fact("T", "period", T, "s", _period, digits=11),
            Fact("Δy", "fall in a period", 0.019445379285, "m", _fall, digits=11),
            Fact("ω_S", "speed of the woodpecker when the sleeve slips, a period later", -SPEED, "rad/s",
                 partial(_speed, T=T)),
            Fact("t_b", "the beak strikes", 0.01981117894, "s", partial(instant, kind="impact", contact="N1"),
                 digits=10),
            Fact("ω_b", "speed of the woodpecker just before", 16.911177368, "rad/s", beak, digits=11),
        )  # fmt: skip

    problem = Problem(
        name,
        scheme,
        q0={"φ_M": (r_M - r_O) / h_M, "φ_S": ANGLE},
        v0={"φ_S": SPEED},
        t_end=0.25,
        units={"φ_M": "rad", "φ_S": "rad"},
        source="LeineGlockerVanCampen2001",
        facts=facts,
    )
    return problem


def _period(run: Readable) -> float:
    """Return the time between the first two upward passages of φ_S through zero."""
    return crossing(run, "φ_S", number=2) - crossing(run, "φ_S")


def _fall(run: Readable) -> float:
    """Return the way down y between the first two upward passages of φ_S through zero."""
    return at(run, "y", crossing(run, "φ_S", number=2)) - at(run, "y", crossing(run, "φ_S"))


def _speed(run: Readable, T: float) -> float:
    """Return minus the rate of φ_S a period T after the start."""
    return -at(run, "v_φ_S", T)
