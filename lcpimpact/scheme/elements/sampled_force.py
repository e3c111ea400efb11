r"""A sampled force: a controller that reads the state at instants, and holds its force between them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.numbers import is_real
from lcpimpact.scheme.elements.base import GROUND, MISSING, Element, Polyline, described, distinct, positive
from lcpimpact.scheme.elements.load import Load
from lcpimpact.scheme.force_law import ForceLaw
from lcpimpact.scheme.held_force import HeldForce
from lcpimpact.scheme.signals import Signal, TimeFunction, checked
from lcpimpact.scheme.terms import Terms


@described
@dataclass(frozen=True)
class SampledForce(Element):
    r"""A force that a controller sets at instants by the state there, and holds until the next.

    .. math:: F(t) = f(t_k, q(t_k), v(t_k^+)), \qquad t_k \le t < t_{k+1}, \qquad t_k = \mathtt{phase} + k T

    ::

            |
            v  F        F  _____
            o                   |____       set at t_0, t_1, t_2, ..., T apart
                                     |___

    f is a function, or with ``kp`` and ``kd`` the linear law F = -kp (x - reference(t)) - kd v. On one node x and v are its
    own coordinate and velocity, and F acts on it, with the power F v. Between two nodes a, b the linear law is that of
    x = q_b - q_a and v = v_b - v_a; F pushes b downwards, and a upwards. Before its first instant the force is zero. Where
    an impact falls on an instant, the velocity is that after it.

    `exact` and `event-driven` begin a segment at each instant. The steps of `moreau-jean` must end at the instants: dt
    divides the period, and the phase. Its nodes have a mass or a prescribed motion.

    Parameters
    ----------
    node : str or tuple of str
        The node, or several that f reads and acts on.
    f : callable, optional
        Takes t in s, q in m and v in m/s, and returns the force in N; of several nodes q, v and the forces are arrays (k,).
        It has no memory: one value for one t, q and v.
    period : float
        T, between two instants.
    phase : float
        The first instant; 0 is the start of a run.
    kp : float, optional
    kd : float, optional
    reference : float or signal
        The place that the linear law steers to.
    symbols : tuple of str
        How drawings call the force.

    Raises
    ------
    InputError
        If neither f nor both kp and kd are given, or all; for a period that is not above zero, a phase below zero, the
        ground, and nodes without mass; and in a run, if f returns no finite number, or has a memory.

    Examples
    --------
    A mass that is steered to 1 m, by samples every 10 ms:

    >>> import lcpimpact as li
    >>> controller = li.SampledForce("x", kp=100.0, kd=20.0, reference=1.0, period=0.01)
    >>> loop = li.Problem("servo", li.Scheme(li.Mass("x", m=1.0), controller))
    >>> f"{li.simulate(loop, 'exact', dt=0.1, t_end=2.0)['x'][-1]:.6f} m"
    '1.000000 m'

    References
    ----------
    Åström and Wittenmark, *Computer-Controlled Systems* (1997).
    """

    node: str | tuple[str, ...]
    f: Callable[[float, float, float], float] | Callable[[float, Array, Array], Array] | None = None
    period: Annotated[float, "s, positive"] = MISSING
    phase: Annotated[float, "s, zero or more"] = 0.0
    kp: Annotated[float | None, "N/m, gain of the distance from the reference"] = None
    kd: Annotated[float | None, "N s/m, gain of the velocity"] = None
    reference: Annotated[
        float | Signal, "m, place: a number; a `Harmonic`, `Polynomial`, `Ramp`, `Table` or `Square`, or a sum of them"
    ] = 0.0
    symbols: tuple[str, ...] = ("F",)

    strokes: ClassVar[tuple[Polyline, ...]] = (
        *Load.strokes,
        ((-0.53, -0.12), (-0.53, -0.04), (-0.59, -0.04), (-0.59, 0.04), (-0.65, 0.04), (-0.65, 0.12)),
    )

    def __post_init__(self) -> None:
        if not isinstance(self.node, str | tuple) or not self.node:
            raise InputError(f"node = {self.node!r} of a SampledForce must be a node, or a tuple of nodes")
        distinct(self)
        if GROUND in self.nodes:
            raise InputError(f"{self}: a force on the ground moves nothing; name other nodes")
        positive(self, "period", self.period, "s")
        if not is_real(self.phase) or self.phase < 0.0:
            raise InputError(f"{self}: phase = {self.phase!r} must be a finite time in s, zero or more")
        linear = self.kp is not None and self.kd is not None
        if self.f is None and not linear:
            missing = "f is missing; give a function of t, q and v, or kp and kd of a linear law"
            if self.kp is not None or self.kd is not None:
                missing = f"{'kd' if self.kd is None else 'kp'} is missing; give a number, 0 for none"
            raise InputError(f"{self}: {missing}")
        if self.f is not None and (self.kp is not None or self.kd is not None or self.reference != 0.0):
            raise InputError(f"{self}: f is given beside constants of a linear law; give one of them")
        if self.f is not None and not callable(self.f):
            raise InputError(f"{self}: f = {self.f!r} must be a function of t, q and v")
        for name in ("kp", "kd") if linear else ():
            if not is_real(getattr(self, name)):
                raise InputError(f"{self}: {name} = {getattr(self, name)!r} must be a finite number")
        if not callable(self.reference) and not is_real(self.reference):
            raise InputError(f"{self}: reference = {self.reference!r} must be a finite place in m or a signal")
        if linear and len(self.nodes) > 2:
            raise InputError(
                f"{self}: the linear law is of one node, or between two; give f for {len(self.nodes)} nodes"
            )

    @property
    def nodes(self) -> tuple[str, ...]:
        """The nodes that it reads and acts on."""
        return (self.node,) if isinstance(self.node, str) else tuple(self.node)

    @property
    def inner(self) -> tuple[str, ...]:
        """No inner nodes: it acts on nodes of other elements."""
        return ()

    def drawn(self) -> tuple[Element, ...]:
        """Return an arrow below a staircase at each node."""
        return (self,) if len(self.nodes) == 1 else tuple(replace(self, node=node) for node in self.nodes)

    def contribute(self, terms: Terms) -> None:
        """Add the held force."""
        if self.f is not None:
            law = ForceLaw(str(self), self.nodes, self.f, scalar=isinstance(self.node, str))
        else:
            reference = self.reference
            if callable(reference):
                reference = checked(f"{self}: reference", reference, "m")
            law = ForceLaw(str(self), self.nodes, LinearLaw(self.kp or 0.0, self.kd or 0.0, reference))
        at = tuple(terms.index[node] for node in self.nodes)
        terms.holds.append(HeldForce(law, at, self.period, self.phase))


@dataclass(frozen=True)
class LinearLaw:
    """The law -kp (x - reference(t)) - kd v of one node, or of the distance of two."""

    kp: float
    kd: float
    reference: float | TimeFunction

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        """Return the forces on the nodes (k,)."""
        place = self.reference(t) if callable(self.reference) else self.reference
        ends = np.array([1.0] if len(q) == 1 else [-1.0, 1.0])
        return np.asarray((self.kp * (place - ends @ q) - self.kd * (ends @ v)) * ends)
