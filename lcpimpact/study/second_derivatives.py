"""Second derivatives of outputs: differences of their exact derivatives between neighbouring values of a parameter."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError, UnsupportedError
from lcpimpact.hybrid.variation import offsets_of_neighbours, slope_weights
from lcpimpact.study.event_order import Group


class Gradients(NamedTuple):
    """The derivatives (m, np) of outputs by all parameters, and the order of the events."""

    slopes: Array
    order: Sequence[Group]


def second_derivatives(
    beside: Callable[[float], Gradients], here: Gradients, name: str, size: float, *, far: float = 2.0**-9
) -> Array:
    """Return the derivatives (m, np) of gradients by one parameter, differences of order 6.

    All neighbours have the order of events of the value itself.

    ``far``: step, relative to the size of the parameter; a 16th of it at a time where the order changes. The error of the
    difference of 1/p is 36 far⁶ = 2e-15; rounding of the gradients counts 1/far times.

    Parameters
    ----------
    beside : callable
        Takes the difference from the value of the parameter.
    here : Gradients
        Those at the value itself.
    name : str
        The parameter.
    size : float
        Its size, above zero.

    Raises
    ------
    UnsupportedError
        If the order of the events changes at any distance, or neighbours have no derivatives.
    """
    reason = "the order of the events changes"
    for k in range(4):
        d = size * far * 2.0 ** (-4 * k)
        for offsets in offsets_of_neighbours(d):
            try:
                found = [beside(float(each)) for each in offsets]
            except UnsupportedError as error:
                reason = str(error)
                continue
            except InputError:  # beyond the domain of the parameter
                continue
            if all(each.order == here.order for each in found):
                changes = np.array([each.slopes - here.slopes for each in found])
                return np.tensordot(slope_weights(offsets / d) / d, changes, 1)
    raise UnsupportedError(f"there are no second derivatives by {name}: at any distance from its value {reason}")
