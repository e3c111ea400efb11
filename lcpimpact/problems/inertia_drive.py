r"""A block on a table that moves in a sawtooth: the inertia drive, whose friction carries and slips in turn."""

from __future__ import annotations

from functools import partial
from typing import Annotated

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.problems.base import Problem, above_zero
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.registered import registered
from lcpimpact.reading import at, instant
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.elements.prescribed_motion import PrescribedMotion
from lcpimpact.scheme.elements.slider import Slider
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.scheme.signals import Table


@registered
def inertia_drive(
    m: Annotated[float, "kg, mass of the block"] = 0.1,
    mu: Annotated[float, "1, coefficient of friction μ"] = 0.2,
    g: Annotated[float, "m/s², gravity"] = 9.81,
    A: Annotated[float, "m, stroke of the table"] = 1e-3,
    T: Annotated[float, "s, period"] = 0.05,
    share: Annotated[float, "1, share σ of the period in which the table goes back"] = 0.2,
) -> Problem:
    r"""A block on a table that goes forth slowly and back quickly, in a sawtooth: friction makes steps of it.

    The table moves by A in ``T_1 = (1 - σ) T`` and back in ``T_2 = σ T``, with the velocities ``V_1 = A/T_1`` and
    ``V_2 = A/T_2``, again and again. Friction gives the block at most ``a = μ g``. In the periodic motion

    - the block slips when the table turns back under it at T_1, and has slowed down to ``V_1 - a T_2`` when that goes forth
      again,
    - then it is as long in getting V_1 back, and sticks from ``t_s = T_2`` to T_1,
    - so in each period it advances by ``V_1 T - a T_2²``, more than the stroke, while the table does not advance.

    The run begins where the table begins to go forth. What to learn: a force with μ g alone in it turns a motion without a
    mean into one with; the quicker the return, the less it costs. The trap is a step that does not end at the corners of
    the sawtooth: the block slips too early or too late in every period, by an error that does not average out.

    Raises
    ------
    InputError
        If a parameter is not above zero, share is not below 1/2, or the return is so slow that the block comes with it.

    Examples
    --------
    >>> [round(fact.value, 6) for fact in inertia_drive().facts]
    [0.01, 0.04, 0.001054, 0.00538]

    References
    ----------
    Pohl, Dynamic piezoelectric translation devices (1987).
    """
    name = "inertia-drive"
    above_zero(name, m=m, mu=mu, g=g, A=A, T=T, share=share)
    if not share < 0.5:
        raise InputError(
            f"{name}: share = {share:g} must be below 1/2, or the table does not go back faster than forth"
        )
    a = mu * g
    T_1, T_2 = (1.0 - share) * T, share * T
    V_1, V_2 = A / T_1, A / T_2
    if not a * T_2 < V_1 + V_2:
        raise InputError(
            f"{name}: with A = {A:g} and T = {T:g} the block goes back with the table; raise A or lower mu"
        )

    def motion(t: Array) -> tuple[Array, Array]:
        times = np.asarray(t, dtype=np.float64)
        periods = np.floor(times / T)
        s = times - periods * T
        # Less than V_1 t by the loss of velocity: from -T_2 on it grows by a, and from 0 on it falls by a.
        early, late = np.maximum(T_2 - s, 0.0), np.maximum(s - T_1, 0.0)
        x = periods * (V_1 * T - a * T_2**2) + V_1 * s - 0.5 * a * (T_2**2 - early**2 + late**2)
        back = s >= T_1
        y, rate = np.where(back, V_2 * (T - s), V_1 * s), np.where(back, -V_2, V_1)
        return np.column_stack([x, y]), np.column_stack([V_1 - a * (early + late), rate])

    def facts() -> tuple[Fact, ...]:
        step = V_1 * T - a * T_2**2
        return (
            Fact("t_s", "the block sticks", T_2, "s", partial(instant, kind="stick")),
            Fact("T_1", "it slips", T_1, "s", partial(instant, kind="slip")),
            Fact("Δx", "advance in a period", step, "m", partial(at, series="x", t=T), scale=A),
            Fact("v_0", "least velocity", V_1 - a * T_2, "m/s", partial(at, series="v_x", t=T), scale=V_1),
        )

    return Problem(
        name,
        Scheme(
            Mass("x", m),
            PrescribedMotion("y", Table((0.0, T_1, T), (0.0, A, 0.0), period=T)),
            Slider("x", "y", mu * m * g, symbols=("μ m g",)),
        ),
        v0={"x": V_1 - a * T_2},
        t_end=2.5 * T,
        source="Pohl1987",
        facts=facts,
        motion=motion,
    )
