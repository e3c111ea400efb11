"""Base class of the integrators: declared properties, a start, and blocks of steps."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, fields, is_dataclass, replace
from inspect import isabstract
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeAlias, cast

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError, Status, UnsupportedError
from lcpimpact.problems.base import Problem
from lcpimpact.record import ContinuousSolution, Grid, Record
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.structure import Feature

if TYPE_CHECKING:
    from lcpimpact.hybrid.motion import HybridMotion

Option: TypeAlias = float | str | None
"""A value of an option of a method."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Tolerances of a certificate, in units of the scales of the motion; see `lcpimpact.certificate.Certificate`.

    Attributes
    ----------
    precision : float           residual of the laws that are solved for, relative to their largest terms
    order : float               order of momentum and displacement in smooth motion (inf: exact)
    order_loss : float          order of the energy that steps lose in smooth motion (inf: none)
    loss_constant : float       part of the energy of a vibration ω that a step loses, in units of (ω h)^(order_loss + 1)
    penetration : float         largest penetration after an impact, in units of h |U|
    rest : float                flight time of a rebound, relative to the run, below which there is none
    balances_energy : bool      whether the energy balance is declared
    kick : float                part of h times the force that is missing in recorded velocities or forces
    slack : float               error of the steps in units of that of their rule, estimated by second differences
    step : float                error of a step away from events, in units of the second differences around it
    drift : float               largest displacement of massless nodes by a projection, in units of the change in a step
    relative_degrees : tuple    the relative degrees that the method handles
    """

    precision: float = 1e-9
    order: float = math.inf
    order_loss: float = math.inf
    loss_constant: float = 1.0
    penetration: float = 0.0
    rest: float = 0.0
    balances_energy: bool = False
    kick: float = 0.0
    slack: float = 3.0
    step: float = 2.0
    drift: float = 0.0
    relative_degrees: tuple[int, ...] = (0, 1, 2)


@dataclass(frozen=True, kw_only=True)
class Declared:
    """The properties that a method declares; tests measure them over the whole registry.

    Attributes
    ----------
    summary : str                   one line
    order_smooth : float            order in smooth motion, in the coordinates (inf: to rounding)
    order_loss : float              least order of the energy that steps lose in smooth motion (inf: none that adds up); of
                                    other options by `Integrator.own_loss`
    loss_constant : float           part of the energy of a vibration ω that a step loses, in units of (ω h)^(order_loss + 1)
    order_force_kink : float        order in q across kinks of r (relative degree 0); 0 if refused
    order_force_jump : float        order in q across jumps of r (relative degree 1); 0 if refused
    order_impact : float            order in the L1 norm of v across impacts (relative degree 2): the median over
                                    problems, since it depends on where in the step an impact falls; 0 if refused
    order_friction : float          order in q where sliders of relative degree 2 reverse or stick; 0 if refused
    order_relay : float             order in q where relays switch or begin to slide; 0 if refused
    order_penetration : float       order in h of the largest penetration after impacts (inf: none beyond rounding)
    level : str                     level of the contact law: "position", "velocity", "acceleration" or several of them
    relative_degrees : tuple        the relative degrees that it handles
    handles : tuple of Feature      what else it handles
    moving : tuple of Feature       what it handles beyond that in Lagrangian systems
    impact_laws : tuple of str      the laws that it takes for impacts of several contacts (see `lcpimpact.Scheme`)
    reaction_time : str            instant to which the recorded force refers
    energy : str                    behaviour of the energy, in words
    balances_energy : bool          whether the energy balance closes, to its precision or its order
    precision : float               residual of the laws that it solves for, relative to their largest terms
    kick : float                    part of h times the force that is missing in recorded velocities or forces
    slack : float                   error of the steps in units of that of their rule, estimated by second differences
    step : float                    error of a step away from events, in units of the second differences around it: twice the
                                    largest that registered problems and random schemes show, which is 0.9 for most
    drift : float                   largest displacement of massless nodes by a projection, in units of the change in a step
    dissipates : bool               whether the energy after impacts never exceeds the initial energy, where Newton's law
                                    gains none (see `lcpimpact.certificate.impact_gain`)
    adaptive : str                  step control, "" for steps of dt
    accuracy : float                relative error of a run with its finest settings, as a reference for others
    source : str                    where it is from: keys of the bibliography, each with the place in it (see
                                    `lcpimpact.bibliography`), or words
    """

    summary: str
    order_smooth: float
    order_loss: float = 1.0
    loss_constant: float = 1.0
    order_force_kink: float = 0.0
    order_force_jump: float = 0.0
    order_impact: float = 0.0
    order_friction: float = 0.0
    order_relay: float = 0.0
    order_penetration: float
    level: str
    relative_degrees: tuple[int, ...]
    handles: tuple[Feature, ...]
    moving: tuple[Feature, ...] = ()
    impact_laws: tuple[str, ...] = ("newton",)
    reaction_time: str
    energy: str
    balances_energy: bool = False
    precision: float = 1e-9
    kick: float = 0.0
    slack: float = 3.0
    step: float = 2.0
    drift: float = 0.0
    dissipates: bool
    adaptive: str = ""
    accuracy: float = 1e-5
    source: str

    @property
    def is_exact(self) -> bool:
        """Whether its error is rounding, whatever dt is."""
        return math.isinf(self.order_smooth) and not self.adaptive

    @property
    def orders(self) -> dict[str, str]:
        """The orders in words: "exact" or "to rtol" if independent of dt, "-" if refused."""
        limit = "to rtol" if self.adaptive else "exact"
        orders = {
            "smooth": self.order_smooth,
            "force kink": self.order_force_kink,
            "force jump": self.order_force_jump,
            "impacts": self.order_impact,
            "friction": self.order_friction,
            "relays": self.order_relay,
        }
        return {name: limit if math.isinf(order) else f"{order:g}" if order else "-" for name, order in orders.items()}

    @property
    def loss(self) -> str:
        """The energy that steps lose in smooth motion, in words."""
        return (
            "none" if math.isinf(self.order_loss) else "O(h)" if self.order_loss == 1 else f"O(h^{self.order_loss:g})"
        )

    @property
    def penetration(self) -> str:
        """The largest penetration after impacts, in words."""
        if 2 not in self.relative_degrees:
            return "-"
        if math.isinf(self.order_penetration):
            return "none"
        return "O(h)" if self.order_penetration == 1 else f"O(h^{self.order_penetration:g})"


class Integrator(ABC):
    """A time integrator: frozen options, and no state of its own.

    To write a new one: make a frozen dataclass whose fields are the options of the method, declare its properties in
    ``declared``, check the problem in `start` (raising `UnsupportedError`), fill the record in `advance`, and add a line
    to the registry. An object of such a class may also be passed to `simulate` as the method.
    """

    name: ClassVar[str]
    declared: ClassVar[Declared]
    solves_lcp: ClassVar[bool] = True
    impact_steps: ClassVar[int] = 1
    """Steps over which the impulse of one impact is spread."""
    reaction_is_mean: ClassVar[bool] = True
    """Whether the reaction recorded for a step is its mean there, so that h r is the impulse."""
    narrowest: ClassVar[float] = 0.0
    """Gaps below this part of the coordinates count as closed; 0 where the gaps of steps are compared with zero."""
    family: ClassVar[str] = ""
    """Name of the step rule; methods of one family do not confirm each other. "" for a rule of its own."""
    mode_choice: ClassVar[str] = ""
    """Module that chooses the contact mode, if several families share it; "" if the step itself does."""
    tolerances: ClassVar[tuple[str, ...]] = ("tol", "max_iter", "max_events", "max_newton", "rtol", "atol")
    """Options that do not change the declared orders."""
    rtol: float | None = None
    """Relative tolerance of the step control, an option of adaptive methods; None for steps of dt."""
    atol: float | None = None

    def reaction_times(self, grid: Grid) -> Array:
        """Return the instants of the recorded reactions of a run on ``grid``: those of the grid, unless overridden."""
        return grid.times(0, grid.steps)

    @abstractmethod
    def start(self, problem: Problem, grid: Grid, lcp_solver: str, record: Record) -> Any:
        """Write the initial values to the record, unless `finish` writes all, and return the carry from block to block."""

    @abstractmethod
    def advance(self, carry: Any, record: Record, first: int, last: int) -> tuple[Status, int]:
        """Take the steps from t_first to t_last; return the status and the last step that was reached."""

    def finish(self, carry: Any, record: Record) -> None:  # noqa: B027
        """Complete the record, or replace its grid by the accepted steps of an adaptive method."""

    def balance_point(self) -> float | None:
        """Return θ if the forces of a step balance at t + θ h, so that its energy balance is exact."""
        return None

    def amplification(self, z: Array) -> Array | None:
        """Return R(h λ), by which an explicit step multiplies y of y' = λ y, at z = h λ; None for implicit methods."""
        return None

    def own_loss(self) -> tuple[float, float]:
        """Return p and c of the energy c (ω h)^(p + 1) of a vibration ω that a step loses, with p = inf if none adds up.

        They are the declared ones, unless overridden where options change them.
        """
        return self.declared.order_loss, self.declared.loss_constant

    def limits(self) -> Limits:
        """Return the tolerances of the certificate that follow from the declared properties."""
        declared = self.declared
        order, constant = self.own_loss()
        return Limits(
            precision=declared.precision,
            kick=declared.kick,
            slack=declared.slack,
            step=declared.step,
            drift=declared.drift,
            order=declared.order_smooth,
            order_loss=order,
            loss_constant=constant,
            penetration=0.0 if math.isinf(declared.order_penetration) else 1.0,
            balances_energy=declared.balances_energy,
            relative_degrees=declared.relative_degrees,
        )

    def with_tolerance(self, rtol: float) -> Self:
        """Return the method with another rtol, and an atol in the same ratio to it."""
        scaled = {} if self.atol is None or self.rtol is None else {"atol": self.atol * rtol / self.rtol}
        changed: Self = replace(cast(Any, self), rtol=rtol, **scaled)
        return changed

    def motion(self, problem: Problem, end: float, lcp_solver: str) -> HybridMotion | None:
        """Return the exact motion, which can be continued up to an instant; None of time-stepping methods."""
        return None

    def dense(self, carry: Any) -> ContinuousSolution | None:
        """Return the solution as a function of time, where the method has one."""
        return None


def refuse_hysteresis(d: Dynamics, method: str) -> None:
    """Refuse a relay with D_ii < 0, once equations hold, for methods whose steps do not remember its side.

    Raises
    ------
    UnsupportedError
        Naming the relay.
    """
    if (triggers := d.switches & (np.diag(d.D @ d.elimination) < 0.0)).any():
        raise UnsupportedError(
            f"the relay {d.contacts[int(np.argmax(triggers))].name!r} has a hysteresis (D_ii < 0), in whose band "
            f"several multipliers are possible, and the steps of {method!r} do not remember which: ",
            ("exact",),
        )


def check_method(thing: Any) -> None:
    """Check that a class registered by another package is an integrator that declares its properties.

    Raises
    ------
    InputError
        If it is not.
    """
    if not (isinstance(thing, type) and issubclass(thing, Integrator)):
        raise InputError(f"{thing!r} is no class derived from lcpimpact.integrators.base.Integrator")
    if not is_dataclass(thing) or isabstract(thing):
        raise InputError(f"{thing.__name__} must be a dataclass with all functions of an Integrator")
    declared = getattr(thing, "declared", None)
    if not isinstance(declared, Declared):
        raise InputError(f"{thing.__name__}.declared = {declared!r} must be a Declared")
    for each in fields(Declared):
        value, kind = getattr(declared, each.name), each.type
        parts = value if isinstance(value, tuple) else ()
        fits = {
            "str": isinstance(value, str),
            "float": isinstance(value, int | float) and not isinstance(value, bool),
            "bool": isinstance(value, bool),
            "tuple[int, ...]": isinstance(value, tuple) and all(isinstance(part, int) for part in parts),
            "tuple[Feature, ...]": isinstance(value, tuple) and all(isinstance(part, Feature) for part in parts),
            "tuple[str, ...]": isinstance(value, tuple) and all(isinstance(part, str) for part in parts),
        }
        if not fits[str(kind)]:
            raise InputError(f"{thing.__name__}.declared has {each.name} = {value!r}, which must be {kind}")
