r"""A force on a node: constant, a function of time, or of the time and the motion of the node."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from lcpimpact.errors import InputError
from lcpimpact.numbers import is_real
from lcpimpact.scheme.elements.base import GROUND, MISSING, Element, Polyline, described, distinct
from lcpimpact.scheme.force_law import ForceLaw
from lcpimpact.scheme.signals import Described, Signal, TimeFunction, checked, loads_of
from lcpimpact.scheme.terms import Terms


@described
@dataclass(frozen=True)
class Load(Element):
    r"""A force on a node: f(t), or f(t, q, v) of its own coordinate and velocity, positive downwards; its power is f v.

    ::

            |
            v  f(t)  or  f(t, q, v)
            o  node

    A function of one argument is f(t), and one of three is f(t, q, v): drag, friction by a smooth law, a Duffing spring.
    What could be called with one as well as with three is refused. A `Force` is such a law of several nodes.

    Where a `Table`, `Ramp` or `Square` jumps at an instant of the grid, the step that ends there sees its left limit, and
    the next one its right limit. A function of Python is sampled: nobody knows where it jumps, and a jump in a step or at
    its end is smeared over the step, with an error of the impulse up to the jump times dt.

    Parameters
    ----------
    node : str
        The node that it acts on.
    f : float, signal or callable
    jacobian : callable, optional
        For f(t, q, v): takes the same, and returns the pair of ∂f/∂q in N/m and ∂f/∂v in N s/m; by default the complex step
        finds them, for which f must be analytic: np.sin in place of math.sin, np.sqrt(v**2) in place of abs(v).
    symbols : tuple of str
        How drawings call the force.

    Raises
    ------
    InputError
        If f is missing, not finite, or neither f(t) nor f(t, q, v), jacobian is given to another, or the node is the
        ground; when a scheme is assembled, if f(0) is no finite number; and where a run starts, if f(t, q, v) or its
        Jacobian is none, or the Jacobian is not that of f.

    Examples
    --------
    >>> Load("x", f=100.0 * 9.81).f
    981.0
    >>> import numpy as np
    >>> drag = Load("x", lambda t, q, v: -0.5 * v * np.sqrt(v**2))
    """

    node: str
    f: Annotated[
        float | Signal | TimeFunction | Callable[[float, float, float], float],
        "N, force: a number; a `Harmonic`, `Polynomial`, `Ramp`, `Table` or `Square`, or a sum of them; any function of the "
        "time in s; or any function of the time, the node's coordinate in m and its velocity in m/s",
    ] = MISSING
    jacobian: Callable[[float, float, float], tuple[float, float]] | None = None
    symbols: tuple[str, ...] = ("f",)

    strokes: ClassVar[tuple[Polyline, ...]] = (
        ((-0.5, 0.0), (-0.15, 0.0)),
        ((-0.15, -0.06), (0.0, 0.0), (-0.15, 0.06), (-0.15, -0.06)),
    )

    def __post_init__(self) -> None:
        distinct(self)
        if self.node == GROUND:
            raise InputError(f"{self}: a force on the ground moves nothing; name another node")
        if self.f is MISSING:
            raise InputError(f"{self}: f is missing; give a force in N or a function of time")
        if not callable(self.f) and not is_real(self.f):
            raise InputError(f"{self}: f = {self.f!r} must be a finite force in N or a function of time")
        follows_motion = self.follows_motion
        if self.jacobian is not None and not (follows_motion and callable(self.jacobian)):
            raise InputError(
                f"{self}: jacobian = {self.jacobian!r} must be a function of t, q and v, beside f(t, q, v)"
            )

    @property
    def nodes(self) -> tuple[str, ...]:
        """The node that the force acts on."""
        return (self.node,)

    @property
    def follows_motion(self) -> bool:
        """Whether it is f(t, q, v)."""
        if not callable(self.f) or isinstance(self.f, Described):
            return False
        of_time, of_motion = _takes(self.f, 1), _takes(self.f, 3)
        if of_time and of_motion:
            raise InputError(
                f"{self}: f can be called as f(t) and as f(t, q, v): give it one argument or three, without defaults and *"
            )
        if not (of_time or of_motion):
            raise InputError(f"{self}: f must take t, or t, q and v; this function takes neither")
        return of_motion

    def contribute(self, terms: Terms) -> None:
        """Add the force to f; a function of time that gives no number is refused here."""
        f: Any = self.f
        if self.follows_motion:
            terms.force_laws.append(ForceLaw(str(self), self.nodes, f, self.jacobian, scalar=True))
        else:
            for each in loads_of(f):
                load = checked(f"{self}: f", each, "N") if callable(each) else each
                terms.loads.append((terms.index[self.node], load))


def _takes(function: Callable[..., float], count: int) -> bool:
    """Return whether a function can be called with ``count`` arguments; one without a signature is a function of time."""
    try:
        inspect.signature(function).bind(*range(count))
    except TypeError:
        return False
    except ValueError:
        return count == 1
    return True
