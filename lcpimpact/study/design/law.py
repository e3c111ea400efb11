r"""Base class of the contact laws of a design: the first contact as a function of the loss λ and the weight γ.

A mass m strikes with v0, and its weight m g goes on acting. Measured in v0 and in the length

.. math:: L = \Bigl(\frac{(n+1)\, m v_0^2}{2 k}\Bigr)^{1/(n+1)}, \qquad n = 1: \quad L = v_0 \sqrt{m/k},

the largest deflection of a lossless spring k δⁿ without gravity, the contact depends on the loss number λ of its law and on
``γ = g L/v0²`` alone. Times scale with L/v0, forces with m v0²/L, and the constants of the law likewise;
so each required property of an impact is an equation in λ and L.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from lcpimpact.problems.base import Problem
from lcpimpact.reading import Series, at, crossing, peak
from lcpimpact.scheme.elements.compliant import CompliantContact
from lcpimpact.scheme.elements.load import Load
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.trajectory import Trajectory


@dataclass(frozen=True)
class Rebound:
    """Outputs of the first contact of an impact.

    Attributes
    ----------
    e : float               restitution: speed at which the contact is left over v0; 0 where it never ends
    contact_time : float    s; inf where it never ends
    peak_force : float      maximum force on the mass in N
    deflection : float      maximum displacement after first contact in m; inf if unbounded
    """

    e: float
    contact_time: float
    peak_force: float
    deflection: float


class ContactLaw(ABC):
    """A law of contact with a stiffness and at most one constant of loss."""

    name: ClassVar[str]
    loss: ClassVar[str] = "c"
    """Name of the damping constant, "" if there is none."""
    losses: ClassVar[tuple[float, float]]
    """Range of loss numbers λ of a design."""
    method: ClassVar[str] = "exact"
    """Method of the simulation."""
    n: ClassVar[float | None] = 1.0
    """Exponent of the spring, None if free."""
    closed: ClassVar[bool] = True
    """Whether the contact without weight has a closed form."""

    @abstractmethod
    def rebound(self, λ: float, γ: float, n: float) -> Rebound:
        """Return the first contact in the units v0 = m = L = 1."""

    @abstractmethod
    def constant(self, λ: float, n: float) -> float:
        """Return the constant of loss of a loss number in the units v0 = m = L = 1."""

    @abstractmethod
    def number(self, constant: float, n: float) -> float:
        """Return the loss number of a constant of loss in those units."""

    def power(self, n: float) -> float:
        """Return the power of L in the constant of loss."""
        return -1.0

    def unit(self, n: float) -> str:
        """Return the unit of the constant of loss."""
        return "N s/m"

    @abstractmethod
    def light(self, m: float, v0: float, k: float, loss: float, n: float) -> Problem:
        """Return the impact without weight, a registered problem."""

    @abstractmethod
    def measured(self, run: Trajectory) -> Rebound:
        """Return the outputs of the first contact of a run."""

    def force(self, run: Trajectory) -> Series:
        """Return the force on the mass in a run of it: of the bumper, for blocks that have one."""
        return "R"

    def problem(self, m: float, v0: float, g: float, k: float, loss: float, n: float) -> Problem:
        """Return the impact, with the weight m g on the mass if there is gravity."""
        light = self.light(m, v0, k, loss, n)
        if g == 0.0:
            return light
        heavy = Scheme(*light.scheme.elements, Load("x", m * g, symbols=("mg",)))  # type: ignore[union-attr]
        parameters = {**light.parameters, "g": g}
        return replace(
            light, name=f"{light.name} with gravity", scheme=heavy, parameters=parameters, facts=(), motion=None
        )


def struck(law: str, m: float, v0: float, stop: CompliantContact, t_end: float, **constants: float) -> Problem:
    """Return a mass that meets a stop at t = 0."""
    parameters = {"m": m, "v0": v0, **constants}
    scheme = Scheme(Mass("x", m), stop)
    return Problem(f"{law} impact", scheme, v0={"x": v0}, t_end=t_end, parameters=parameters)


def of_spring(run: Trajectory) -> Series:
    """Return the force of the only non-linear spring of a run on the mass."""
    dynamics = run.problem.dynamics
    return lambda state: np.asarray(-dynamics.spring_force(state.q, state.v)[:, 0])


def opened(run: Trajectory, force: Series) -> Rebound:
    """Return the first contact of a run, up to its first opening."""
    v0 = float(run.v[0, 0])
    opens = [each for each in run.events if each.kind == "open"]
    if not opens:
        return Rebound(0.0, math.inf, peak(run, force), peak(run, "x"))
    end, t_c = opens[0], opens[0].t
    return Rebound(-float(end.right.v[0]) / v0, t_c, peak(run, force, until=t_c), peak(run, "x", until=t_c))


def grounded(run: Trajectory, force: Series) -> Rebound:
    """Return the first contact of a run, up to the return of x to zero."""
    v0 = float(run.v[0, 0])
    if not ((run["x"][:-1] > 0.0) & (run["x"][1:] <= 0.0)).any():
        return Rebound(0.0, math.inf, peak(run, force), peak(run, "x"))
    t_c = crossing(run, "x", direction=-1.0)
    return Rebound(-at(run, "v_x", t_c) / v0, t_c, peak(run, force, until=t_c), peak(run, "x", until=t_c))
