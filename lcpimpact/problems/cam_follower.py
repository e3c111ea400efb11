r"""A cam and its follower: the speed from which on the spring does not hold them together."""

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
from lcpimpact.reading import Readable, event, first_root, instant, interval, peak
from lcpimpact.scheme.elements.base import GROUND
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.load import Load
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.elements.prescribed_motion import PrescribedMotion
from lcpimpact.scheme.elements.spring import Spring
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.scheme.signals import Harmonic


@registered
def cam_follower(
    m: Annotated[float, "kg, mass of the follower"] = 0.2,
    k: Annotated[float, "N/m, stiffness of its spring"] = 2000.0,
    F: Annotated[float, "N, force of the spring at mid stroke, with the weight"] = 60.0,
    A: Annotated[float, "m, eccentricity of the cam"] = 0.005,
    omega: Annotated[float, "rad/s, speed ω of the cam"] = 300.0,
    e: Annotated[float, "1, coefficient of restitution"] = 0.0,
) -> Problem:
    r"""A flat follower on an eccentric disc, faster than its spring allows: it lifts off, and comes down with a blow.

    The disc moves the follower by ``y = A cos ω t``, downwards, and the spring presses it down by F - k x. On the cam

    - the contact force is ``R = F + (m ω² - k) A cos ω t``, least where the cam is highest,
    - so the follower stays on up to the speed ``ω* = sqrt((k + F/A)/m)``, and above it lifts off at
      ``cos ω t_1 = -F/((m ω² - k) A)``.

    Off the cam it is a free vibration about F/k with ``ω_0 = sqrt(k/m)``, which begins at t_1 with the place and velocity of
    the cam, and ends at t_2, the first root of x = y; the run begins between them, where the gap is largest. By default
    ω* = 264.6 rad/s, 2526 turns a minute. With e = 0 the follower stays on the cam from t_2 on, and each turn is as the
    first. What to learn: the jump speed is a matter of the acceleration of the profile and of the preload; restitution
    decides what comes after it, one blow in each turn, several, or chaos. The trap is to count on the natural frequency
    ω_0, which here is 100 rad/s, and where nothing happens.

    Raises
    ------
    InputError
        If a parameter but e is not above zero, e lies outside [0, 1], the follower hardly lifts off, or it flies past the
        end of a turn.

    Examples
    --------
    >>> [round(fact.value, 6) for fact in cam_follower().facts]
    [0.002621, 1.07906, 0.215812, 0.020944]

    References
    ----------
    Osorio, di Bernardo and Santini, Corner-impact bifurcations: a novel class of discontinuity-induced bifurcations in
    cam-follower systems (2008).
    """
    name = "cam-follower"
    above_zero(name, m=m, k=k, F=F, A=A, omega=omega)
    restitution(name, e)
    ω, ω_0 = omega, math.sqrt(k / m)
    T = 2.0 * math.pi / ω
    excess = (m * ω**2 - k) * A
    flies = excess > F
    t_1 = (math.pi - math.acos(F / excess)) / ω if flies else math.inf

    def off(t: Array | float) -> tuple[Array, Array]:
        """Return x and x' of the flight that begins at t_1."""
        s = ω_0 * (np.asarray(t, dtype=np.float64) - t_1)
        x, v = A * math.cos(ω * t_1) - F / k, -A * ω * math.sin(ω * t_1) / ω_0
        return F / k + x * np.cos(s) + v * np.sin(s), ω_0 * (v * np.cos(s) - x * np.sin(s))

    def gap(s: Array) -> Array:
        """Return y - x of the flight, s after it begins."""
        return np.asarray(A * np.cos(ω * (t_1 + s)) - off(t_1 + s)[0])

    landing = first_root(gap, T, T) if flies else 0.0
    if flies and landing is not None and landing < T / 200.0:
        raise InputError(f"{name}: at omega = {omega:g} the follower hardly lifts off; take a higher speed")
    if landing is None or not F + excess * math.cos(ω * (t_1 + landing if flies else 0.0)) > 0.0:
        raise InputError(
            f"{name}: at omega = {omega:g} the follower flies past the end of a turn; it lifts off above "
            f"{math.sqrt((k + F / A) / m):g}: take a speed nearer to that"
        )
    t_2 = t_1 + landing
    # The run begins where the follower is farthest from the cam.
    top = first_root(lambda s: -A * ω * np.sin(ω * (t_1 + s)) - off(t_1 + s)[1], landing, T) if flies else None
    t_0 = 0.0 if top is None else t_1 + top

    def motion(t: Array) -> tuple[Array, Array]:
        times = np.asarray(t, dtype=np.float64) + t_0
        y, rate = A * np.cos(ω * times), -A * ω * np.sin(ω * times)
        if not flies:
            return np.column_stack([y, y]), np.column_stack([rate, rate])
        s = times - T * np.floor((times - t_1) / T)
        x, v = off(s)
        return (
            np.column_stack([np.where(s < t_2, x, y), y]),
            np.column_stack([np.where(s < t_2, v, rate), rate]),
        )

    def facts() -> tuple[Fact, ...]:
        if not flies:
            return (
                Fact("R_max", "greatest force", F + abs(excess), "N", partial(peak, series="R")),
                Fact("R_min", "least force", F - abs(excess), "N", partial(peak, series="R", sign=-1.0), scale=F),
            )
        U = float(off(t_2)[1]) + A * ω * math.sin(ω * t_2)
        blow = (
            Fact("t_2", "the follower strikes the cam", t_2 - t_0, "s", partial(instant, kind="impact")),
            Fact("U", "speed of the blow", U, "m/s", _blow),
            Fact("P", "its impulse", (1.0 + e) * m * U, "N s", _impulse),
        )
        again = Fact("T", "from blow to blow", T, "s", partial(interval, kind="impact", first=1, last=2))
        return blow if e > 0.0 else (*blow, again)

    return Problem(
        name,
        Scheme(
            Spring("x", GROUND, k),
            Mass("x", m),
            Load("x", F, symbols=("F",)),
            PrescribedMotion("y", Harmonic(A, ω, ω * t_0)),
            Bumper("x", "y", e=e),
        ),
        q0={"x": float(off(t_0)[0]) if flies else A},
        v0={"x": float(off(t_0)[1]) if flies else 0.0},
        t_end=1.6 * T,
        source="OsorioDiBernardoSantini2008",
        facts=facts,
        motion=motion if e == 0.0 or not flies else None,
    )


def _blow(run: Readable) -> float:
    """Return the speed of the follower against the cam just before the first impact."""
    v = event(run, "impact").left.v
    return float(v[0] - v[1])


def _impulse(run: Readable) -> float:
    """Return the impulse of the first impact."""
    return float(event(run, "impact").impulse)
