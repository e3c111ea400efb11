r"""Equal balls that touch, with springs as their contacts: what the impact laws of rows of balls leave open.

Coordinates are positive to the right, and count from where each ball starts.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated

from scipy.optimize import brentq

from lcpimpact.errors import InputError
from lcpimpact.formula import sqrt
from lcpimpact.problems.base import Problem, above_zero, whole
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.registered import registered
from lcpimpact.reading import Readable, final, instant
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.hertz_spring import HertzSpring
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.elements.spring import Spring
from lcpimpact.scheme.scheme import Scheme

FINAL = {
    2: (0.0, 1.0),
    3: (-0.07095235365, 0.07640303907, 0.99454931458),
    4: (-0.07108501612, -0.02962619649, 0.10973863989, 0.99097257272),
    5: (-0.07108501708, -0.03027376410, -0.01446362903, 0.12704498607, 0.98877742415),
    6: (-0.07108501709, -0.03027378936, -0.01583325948, -0.00679468441, 0.13651690654, 0.98746984380),
    7: (-0.07108501709, -0.03027378936, -0.01583339716, -0.00888527729, -0.00243024723, 0.14180267098, 0.98670505715),
}  # fmt: skip
"""Final velocities over v0 of N equal balls with Hertz contacts, by DOP853 in sqrt(t), in which they begin smoothly."""

SEPARATED = {2: 2.6, 3: 4.0, 4: 5.3, 5: 6.6, 6: 7.8, 7: 9.1}
"""Time over (m²/(K² v0))^(1/5) at which N balls touch no longer."""


@registered
def balls_on_springs(
    m: Annotated[float, "kg, mass of each ball"] = 1.0,
    k: Annotated[float, "N/m, stiffness of a contact"] = 1e4,
    v0: Annotated[float, "m/s, speed of the first ball"] = 1.0,
) -> Problem:
    r"""One ball strikes two equal ones that touch, and each contact is a linear spring that does not pull.

    With ``ω = sqrt(k/m)`` and the compressions ``δ_1 = x_1 - x_2``, ``δ_2 = x_2 - x_3``, while both are positive

    - ``δ_1 = v0 (sin ω t/ω + sin(√3 ω t)/(√3 ω))/2`` and ``δ_2 = v0 (sin ω t/ω - sin(√3 ω t)/(√3 ω))/2``,
    - so the first ball leaves at the root t_1 of ``√3 sin ω t + sin(√3 ω t) = 0``, with what velocity it has then,
    - and the other two swing with ``√2 ω`` against each other until δ_2 = 0 at t_2, where the speed at which they part
      follows from the energy: ``(v_3 - v_2)² = δ_2'² + 2 ω² δ_2²`` at t_1.

    The final velocities over v0 are -0.130, 0.150 and 0.980, whatever m, k and v0 are: as k grows the collision takes no
    time, and yet the outcome is neither that of two impacts in a row, (0, 0, 1), nor Moreau's, (-1/3, 2/3, 2/3), see
    `three_balls`. All three keep momentum and energy. What decides is the ratio of the stiffnesses of the contacts, which
    a coefficient of restitution does not know. The trap is to take a penalty method's result for the limit of the rigid
    bodies: it is one of many, and another law of the springs has another one, see `hertz_chain`.

    Raises
    ------
    InputError
        If m, k or v0 is not above zero.

    Examples
    --------
    >>> [round(fact.value, 6) for fact in balls_on_springs().facts]
    [0.025548, 0.03427, -0.130262, 0.15023, 0.980032]

    References
    ----------
    Herrmann and Schmälzle, Simple explanation of a well-known collision experiment (1981).
    """
    name = "balls-on-springs"
    above_zero(name, v0=v0)
    scheme = Scheme(
        Mass("x1", m), Bumper("x1", "z1", name="R1", symbols=("R_1",)), Spring("z1", "x2", k),
        Mass("x2", m), Bumper("x2", "z2", name="R2", symbols=("R_2",)), Spring("z2", "x3", k), Mass("x3", m),
    )  # fmt: skip
    ω = sqrt(k / m)

    def collision() -> tuple[float, float, tuple[float, float, float]]:
        """Return ω t_1, ω t_2 and the final velocities over v0."""
        r = math.sqrt(3.0)
        τ_1 = float(brentq(lambda τ: r * math.sin(τ) + math.sin(r * τ), 2.0, 3.0, xtol=1e-15))
        # δ_2 over v0/ω, and its rate over v0; the sum of the velocities is v0, and δ_1' + δ_2' = v_1 - v_3.
        δ, dδ = 0.5 * (math.sin(τ_1) - math.sin(r * τ_1) / r), 0.5 * (math.cos(τ_1) - math.cos(r * τ_1))
        v_1 = (1.0 + math.cos(τ_1) + 0.5 * (math.cos(τ_1) + math.cos(r * τ_1))) / 3.0
        part = math.hypot(dδ, math.sqrt(2.0) * δ)
        τ_2 = τ_1 + (math.pi - math.atan2(math.sqrt(2.0) * δ, dδ)) / math.sqrt(2.0)
        return τ_1, τ_2, (v_1, 0.5 * (1.0 - v_1 - part), 0.5 * (1.0 - v_1 + part))

    def facts() -> tuple[Fact, ...]:
        τ_1, τ_2, v = collision()
        return (
            Fact("t_1", "the first ball leaves", τ_1 / ω, "s", partial(instant, kind="open", contact="R1")),
            Fact("t_2", "the last ball leaves", τ_2 / ω, "s", partial(instant, kind="open", contact="R2")),
            *_final_velocities(v, v0),
        )

    return Problem(name, scheme, v0={"x1": v0}, t_end=4.0 / ω, source="HerrmannSchmaelzle1981", facts=facts)


@registered
def hertz_chain(
    N: Annotated[float, "1, number of balls, 2 to 7"] = 3,
    m: Annotated[float, "kg, mass of each ball"] = 0.0327,
    K: Annotated[float, "N/mⁿ, stiffness, n = 3/2, of two equal spheres sqrt(2 R)/3 E/(1 - ν²)"] = 1.09e10,
    v0: Annotated[float, "m/s, speed of the first ball"] = 1.0,
) -> Problem:
    r"""N equal balls that touch, by Hertz's law, and the first is struck: the toy on the desk as it is.

    ``m x_i'' = K max(x_{i-1} - x_i, 0)^(3/2) - K max(x_i - x_{i+1}, 0)^(3/2)``. In the units v0 of velocity and
    ``(m²/(K² v0))^(1/5)`` of time no number is left but N, so that the final velocities over v0 are constants:

    - N = 3: -0.07095, 0.07640 and 0.99455,
    - N = 5: -0.07109, -0.03027, -0.01446, 0.12704 and 0.98878,

    found by DOP853, as no closed form is known. Nearly all goes to the last ball, and the others are neither at rest
    nor together: the first comes back, and so in a longer chain do most of the others. Momentum and energy are kept by
    this as by every other outcome that is taught, see `newtons_cradle`. The trap is N - 1 rigid impacts in a row with
    e = 1: they are the limit of contacts that are left one after another, and those of balls that touch never are.

    Raises
    ------
    InputError
        If N is no whole number from 2 to 7, or m, K or v0 is not above zero.

    Examples
    --------
    >>> [round(fact.value, 6) for fact in hertz_chain().facts]
    [1.0, -0.070952, 0.076403, 0.994549]

    References
    ----------
    Herrmann and Seitz, How does the ball-chain work? (1982).
    """
    name = "hertz-chain"
    N = whole(name, "N", N, least=2)
    if N not in FINAL:
        raise InputError(f"{name}: N = {N:g} is too many: final velocities are known of up to {max(FINAL)} balls")
    above_zero(name, m=m, K=K, v0=v0)
    balls = [Mass(f"x{i}", m) for i in range(1, N + 1)]
    contacts = [HertzSpring(f"x{i}", f"x{i + 1}", K, name=f"F{i}", symbols=(f"F_{i}",)) for i in range(1, N)]

    def t_end() -> float:
        return float(1.1 * SEPARATED[N] * (m**2 / (K**2 * v0)) ** 0.2)

    def facts() -> tuple[Fact, ...]:
        energy = Fact("ΣT/T_0", "kinetic energy at the end", 1.0, "", partial(_kinetic_energy, unit=v0**2))
        return (energy, *_final_velocities(FINAL[N], v0, digits=9))

    return Problem(
        name,
        Scheme(*balls, *contacts),
        v0={"x1": v0},
        t_end=t_end,
        parameters={"N": N},
        source="HerrmannSeitz1982",
        facts=facts,
    )


def _final_velocities(v: tuple[float, ...], v0: float, digits: int = 14) -> list[Fact]:
    """Return the facts of the velocities at the end."""
    return [
        Fact(
            f"v_{i}/v0", f"final velocity of ball {i}", each, "", partial(final, series=f"v_x{i}", unit=v0),
            scale=1.0, digits=digits,
        )
        for i, each in enumerate(v, start=1)
    ]  # fmt: skip


def _kinetic_energy(run: Readable, unit: float) -> float:
    """Return the sum of the squares of the velocities at the end, in a unit."""
    return float((run.v[-1] ** 2).sum()) / unit
