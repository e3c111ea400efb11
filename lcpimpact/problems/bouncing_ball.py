"""The bouncing ball: infinitely many impacts in finite time, then rest."""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.problems.base import Problem
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.registered import registered
from lcpimpact.reading import Readable, instant, limit
from lcpimpact.scheme.elements.base import GROUND
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.load import Load
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.scheme import Scheme


@registered
def bouncing_ball(
    m: Annotated[float, "kg, mass"] = 1.0,
    g: Annotated[float, "m/s², gravity"] = 9.81,
    H: Annotated[float, "m, height of fall"] = 1.0,
    e: Annotated[float, "1, coefficient of restitution"] = 0.8,
) -> Problem:
    r"""A ball dropped from rest at height H: relative degree 2, with impacts U⁺ = -e U⁻.

    The coordinate x is positive downwards from the start, so the height is H - x. Its closed form is that of the parabola:

    - the n-th impact has the approach speed ``eⁿ⁻¹ sqrt(2 g H)``,
    - the impacts accumulate at ``t_∞ = sqrt(2 H/g) (1 + e)/(1 - e)``: infinitely many in finite time, then rest.

    This is Zeno's problem. A method that goes from event to event needs a rule to get past t_∞; a step that solves for
    the contact at its end passes it without noticing. The trap is a test on the sup norm of v, which converges for no
    method: between the true impact and the computed one the velocities have opposite signs.

    Raises
    ------
    InputError
        If m, g or H is not above zero, or e lies outside [0, 1].

    Examples
    --------
    >>> [round(fact.value, 6) for fact in bouncing_ball().facts]
    [0.451524, 4.429447, 2.834846, 1.751912, 4.063713]

    References
    ----------
    Brogliato, *Nonsmooth Mechanics* (2016), section 1.1.
    """
    if not (g > 0.0 and H > 0.0):
        raise InputError(f"bouncing-ball: g = {g:g} and H = {H:g} must be positive, or the ball does not fall")
    scheme = Scheme(Mass("x", m), Load("x", m * g, symbols=("mg",)), Bumper("x", GROUND, gap=H, e=e))

    def t_end() -> float:
        fall = math.sqrt(2.0 * H / g)
        return 1.25 * (fall * (1.0 + e) / (1.0 - e)) if 0.0 < e < 1.0 else 10.0 * fall

    def facts() -> tuple[Fact, ...]:
        fall, v = math.sqrt(2.0 * H / g), math.sqrt(2.0 * g * H)
        facts: tuple[Fact, ...] = (
            Fact("t_1", "first impact", fall, "s", partial(instant, kind="impact")),
            Fact("v_1", "its approach speed", v, "m/s", partial(limit, kind="impact", of="v", i=0, side="left")),
        )
        if e > 0.0:
            facts += (
                Fact(
                    "v_3",
                    "approach speed of the third",
                    e**2 * v,
                    "m/s",
                    partial(limit, kind="impact", number=3, of="v", i=0, side="left"),
                ),
                Fact(
                    "t_3", "third impact", fall * (1 + 2 * e + 2 * e**2), "s", partial(instant, kind="impact", number=3)
                ),
            )
        if 0.0 < e < 1.0:
            t_inf = fall * (1.0 + e) / (1.0 - e)
            facts += (Fact("t_∞", "accumulation of the impacts", t_inf, "s", _rest),)
        return facts

    def motion(t: Array) -> tuple[Array, Array]:
        x, v = closed_form(t, g, H, e)
        return x[:, None], v[:, None]

    return Problem(
        "bouncing-ball",
        scheme,
        t_end=t_end,
        source="Brogliato2016, section 1.1",
        facts=facts,
        motion=motion,
    )


def _rest(run: Readable) -> float:
    """Return the time of the last event, if a twentieth of the run has gone without one and the ball is slow by then."""
    last = run.events[-1].t if run.events else run.t[-1]
    if run.t[-1] - last < 0.05 * run.t[-1] or not abs(run.v[-1, 0]) < 0.05 * abs(run.events[0].left.v[0]):
        raise InputError("the ball is not at rest when the run ends: run longer")
    return float(last)


def closed_form(t: ArrayLike, g: float, H: float, e: float) -> tuple[Array, Array]:
    """Return x(t) and the right limit of x'(t) of the bouncing ball, through the accumulation of its impacts."""
    times = np.atleast_1d(np.asarray(t, dtype=np.float64))
    x, v = 0.5 * g * times**2, g * times
    impact = math.sqrt(2.0 * H / g)
    speed = e * math.sqrt(2.0 * g * H)
    while speed > 1e-300 and impact <= times.max():
        after = times >= impact
        s = times[after] - impact
        x[after] = H - speed * s + 0.5 * g * s**2
        v[after] = -speed + g * s
        step = 2.0 * speed / g
        if impact + step == impact:
            break
        impact, speed = impact + step, e * speed
    if e < 1.0:
        rest = times >= math.sqrt(2.0 * H / g) * (1.0 + e) / (1.0 - e)
        x[rest], v[rest] = H, 0.0
    return x, v
