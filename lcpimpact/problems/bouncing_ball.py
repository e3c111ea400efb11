"""The bouncing ball: infinitely many impacts in finite time, then rest."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.problems.base import Problem
from lcpimpact.scheme.elements.base import GROUND
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.load import Load
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.scheme import Scheme


def bouncing_ball(m: float = 1.0, g: float = 9.81, H: float = 1.0, e: float = 0.8) -> Problem:
    """A ball dropped from rest at height H: relative degree 2, with impacts U⁺ = -e U⁻.

    The coordinate x is positive downwards from the start, so the height is H - x. The n-th impact has the approach speed
    eⁿ⁻¹ sqrt(2 g H), and the impacts accumulate at t = sqrt(2 H/g) (1 + e)/(1 - e).
    """
    if not (g > 0.0 and H > 0.0):
        raise InputError(f"bouncing-ball: g = {g:g} and H = {H:g} must be positive, or the ball does not fall")
    scheme = Scheme(Mass("x", m), Load("x", m * g, symbols=("mg",)), Bumper("x", GROUND, gap=H, e=e))
    return Problem(
        "bouncing-ball",
        scheme,
        t_end=3.0,
        parameters={"m": m, "g": g, "H": H, "e": e},
        source="Brogliato, Nonsmooth Mechanics (2016), section 1.1",
    )


def closed_form(t: ArrayLike, g: float, H: float, e: float) -> tuple[Array, Array]:
    """Return x(t) and the right limit of x'(t) of the bouncing ball, through the accumulation of its impacts."""
    times = np.atleast_1d(np.asarray(t, dtype=np.float64))
    x, v = 0.5 * g * times**2, g * times
    impact, speed = math.sqrt(2.0 * H / g), e * math.sqrt(2.0 * g * H)
    while speed > 1e-300 and impact <= times.max():
        after = times >= impact
        s = times[after] - impact
        x[after], v[after] = H - speed * s + 0.5 * g * s**2, -speed + g * s
        step = 2.0 * speed / g
        if impact + step == impact:
            break
        impact, speed = impact + step, e * speed
    if e < 1.0:
        rest = times >= math.sqrt(2.0 * H / g) * (1.0 + e) / (1.0 - e)
        x[rest], v[rest] = H, 0.0
    return x, v
