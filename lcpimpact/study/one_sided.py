"""One-sided derivatives: limits of the derivatives beside a value of a parameter."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import UnsupportedError
from lcpimpact.study.event_order import Group


class Nearby(NamedTuple):
    """The outputs with another value of a parameter.

    Attributes
    ----------
    values : (m,) array
    slopes : (m,) array         their derivatives
    order : sequence            the order of the events
    """

    values: Array
    slopes: Array
    order: Sequence[Group]


def limit_of(
    beside: Callable[[float], Nearby], values: Array, size: float, *, far: float = 2.0**-9, limit_rtol: float = 1e-7
) -> Array:
    """Return the limit (m,) of the derivatives of outputs as a parameter comes to its value from one side.

    Six neighbours at equal distances with one order of events lie on a polynomial.

    ``far``: distance of the farthest, relative to the size of the parameter; a 32nd of it at a time where that is too far.
    ``limit_rtol``: difference of the limits by six and by five neighbours, and of the outputs there from those at the value
    itself, relative to the output and its change by the size of the parameter, above which there is none.

    Parameters
    ----------
    beside : callable
        Takes the difference from the value of the parameter.
    values : (m,) array
        The outputs at the value itself.
    size : float
        The size of the parameter, with the sign of the side.

    Raises
    ------
    UnsupportedError
        If there is no limit, or the outputs jump.
    """
    weights = np.array([[6.0, -15.0, 20.0, -15.0, 6.0, -1.0], [5.0, -10.0, 10.0, -5.0, 1.0, 0.0]])
    reason = "the order of the events changes at any distance"
    for k in range(4):
        offsets = size * far * 2.0 ** (-5 * k) / 6.0 * np.arange(1, 7)
        try:
            found = [beside(float(each)) for each in offsets]
        except UnsupportedError as error:
            reason = str(error)
            continue
        if any(each.order != found[0].order for each in found):
            continue
        slopes, coarse = weights @ np.array([each.slopes for each in found])
        there = weights[0] @ np.array([each.values for each in found])
        scale = np.abs(values) + np.abs(slopes * size)
        if (np.abs(slopes - coarse) * abs(size) > limit_rtol * scale).any():
            reason = "they grow without bound, as where a contact is just touched"
            continue
        if (np.abs(there - values) > limit_rtol * scale).any():
            j = int(np.argmax(np.abs(there - values) / np.maximum(scale, np.finfo(float).tiny)))
            reason = f"an output jumps there, from {values[j]:.9g} to {there[j]:.9g}"
            break
        return np.asarray(slopes)
    raise UnsupportedError(f"the derivatives have no limit on this side: {reason}")
