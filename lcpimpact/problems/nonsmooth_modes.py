r"""Nonsmooth modes: free periodic motions of two masses, one of which strikes a stop without loss."""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.problems.base import Problem, above_zero
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.registered import registered
from lcpimpact.reading import Readable, interval, limit
from lcpimpact.scheme.elements.base import GROUND
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.elements.spring import Spring
from lcpimpact.scheme.scheme import Scheme


@registered
def nonsmooth_mode(
    m1: Annotated[float, "kg, mass at the fixed end"] = 1.0,
    m2: Annotated[float, "kg, mass that strikes the stop"] = 1.0,
    k1: Annotated[float, "N/m, stiffness between the first mass and the ground"] = 1.0,
    k2: Annotated[float, "N/m, stiffness between the masses"] = 1.0,
    d: Annotated[float, "m, gap of the stop at rest"] = 1.0,
    omega: Annotated[float, "rad/s, circular frequency ω of the motion"] = 0.9,
) -> Problem:
    r"""Two masses in a row, of which the last strikes a stop once in a period, without loss: a mode beyond the linear ones.

    ``M q'' + K q = 0`` while x_2 < d, and ``x_2'⁺ = -x_2'⁻`` at x_2 = d. A motion of one impact in a period ``T = 2 π/ω``
    is symmetric in time about the middle of its flight, so with the linear modes φ_j (of unit modal mass) and their ω_j

    - ``q = Σ_j a_j φ_j cos(ω_j (t - T/2))`` from one impact, t = 0, to the next,
    - where ``Σ_j a_j φ_1j ω_j sin(ω_j T/2) = 0``, as nothing stops the first mass, and ``Σ_j a_j φ_2j cos(ω_j T/2) = d``:
      two linear equations for each T,
    - the energy is ``E = Σ_j (a_j ω_j)²/2``, and the speed of the impact ``-Σ_j a_j φ_2j ω_j sin(ω_j T/2)``.

    A branch begins where a linear mode touches the stop, and its frequency rises with the energy up to a limit. Another one
    comes down from infinite energy, turns at a fold, and goes up again. With unit masses and springs the fold is at
    ω = 0.87146, E = 0.82737, and at E = 0.9 there are three motions of one impact in a period: ω = 0.755, 0.850, 0.901.
    Many of them are neutrally stable and some are not: at ω = 0.85 a deviation grows by a factor of 3 in each period. The
    trap is to follow a mode by raising the energy: the frequency is no function of it.

    Raises
    ------
    InputError
        If a parameter is not above zero, or there is no such motion.

    Examples
    --------
    >>> [round(fact.value, 6) for fact in nonsmooth_mode().facts]
    [6.981317, 0.990252, 0.104871, 0.896426]

    References
    ----------
    Thorin, Legrand and Junca, Nonsmooth modal analysis: investigation of a 2-dof spring-mass system subject to an elastic
    impact law (2015).
    """
    name = "nonsmooth-mode"
    above_zero(name, m1=m1, m2=m2, k1=k1, k2=k2, d=d, omega=omega)
    roots = np.sqrt([m1, m2])
    squares, vectors = np.linalg.eigh(np.array([[k1 + k2, -k2], [-k2, k2]]) / np.outer(roots, roots))
    φ, ω = vectors / roots[:, None], np.sqrt(squares)
    T = 2.0 * math.pi / omega
    S, C = np.sin(0.5 * ω * T), np.cos(0.5 * ω * T)
    try:
        a = np.linalg.solve([φ[0] * ω * S, φ[1] * C], [0.0, d])
    except np.linalg.LinAlgError:
        a = np.full(2, math.nan)
    v = float(-φ[1] @ (a * ω * S))

    def motion(t: Array) -> tuple[Array, Array]:
        s = np.mod(np.asarray(t, dtype=np.float64), T)[:, None] - 0.5 * T
        return (a * np.cos(ω * s)) @ φ.T, -(a * ω * np.sin(ω * s)) @ φ.T

    q, _ = motion(np.linspace(0.0, T, 513)[1:-1])
    if not v > 1e-6 * omega * d or not q[:, 1].max() < d:
        raise InputError(
            f"{name}: no motion of omega = {omega:g} strikes the stop just once in its period; it may do so above one of "
            f"{ω[0]:g} and {ω[1]:g}"
        )
    E = float(0.5 * (a * ω) @ (a * ω))

    def facts() -> tuple[Fact, ...]:
        start = float(φ[0] @ (a * C))
        return (
            Fact("T", "from impact to impact", T, "s", partial(interval, kind="impact", first=1, last=2)),
            Fact("v", "speed of each impact", v, "m/s",
                 partial(limit, kind="impact", number=2, of="v", i=1, side="left")),
            Fact("x_1", "place of the first mass at an impact", start, "m",
                 partial(limit, kind="impact", number=2, of="q", i=0, side="left"), scale=d),
            Fact("E", "energy", E, "J", _energy),
        )  # fmt: skip

    return Problem(
        name,
        Scheme(
            Spring("x1", GROUND, k1, symbols=("k_1",)), Mass("x1", m1, symbols=("m_1",)),
            Spring("x2", "x1", k2, symbols=("k_2",)), Mass("x2", m2, symbols=("m_2",)),
            Bumper("x2", GROUND, gap=d, e=1.0),
        ),
        q0={"x1": float(φ[0] @ (a * C)), "x2": d},
        v0={"x2": -v},
        t_end=2.75 * T,
        source="ThorinLegrandJunca2015",
        facts=facts,
        motion=motion,
    )  # fmt: skip


def _energy(run: Readable) -> float:
    """Return the energy at the end."""
    return float(run.problem.dynamics.energy(run.q[-1:], run.v[-1:])[0])
