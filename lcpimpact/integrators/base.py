"""What every integrator is: declared properties, a start, and a block of steps."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, fields, is_dataclass, replace
from inspect import isabstract
from typing import TYPE_CHECKING, Any, ClassVar, Self, cast

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError, Status
from lcpimpact.problems.base import Problem
from lcpimpact.record import ContinuousSolution, Grid, Record
from lcpimpact.scheme.dynamics import Feature

if TYPE_CHECKING:
    from lcpimpact.hybrid.motion import Motion


@dataclass(frozen=True, kw_only=True)
class Limits:
    """How far from its laws a run may be, in units of the scales of its motion; see `lcpimpact.certificate.Certificate`.

    Attributes
    ----------
    precision : float           to what part of the largest terms those laws hold that are solved for
    order : float               order in smooth motion: what its steps leave out of the momentum and the way (inf: nothing)
    penetration : float         largest penetration after an impact, in units of h |U|
    rest : float                a rebound whose flight is shorter than this part of the run counts as none
    balances_energy : bool      whether the balance of energy is promised
    kick : float                part of h times the force that recorded velocities or forces may lack
    slack : float               error of the steps in units of that of their rule, estimated by second differences
    step : float                error of a step away from events, in units of the second differences around it
    drift : float               largest displacement of massless nodes by a projection, in units of the change in a step
    relative_degrees : tuple    the relative degrees that the method handles
    """

    precision: float = 1e-9
    order: float = math.inf
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
    order_force_kink : float        order in q across switches at which r only bends (relative degree 0); 0 if refused
    order_force_jump : float        order in q across switches at which r jumps (relative degree 1); 0 if refused
    order_impact : float            order in the L1 norm of v across impacts (relative degree 2), the median over
                                    problems, since where in its step an impact falls is luck; 0 if refused
    order_friction : float          order in the coordinates where sliders of relative degree 2 turn or stop; 0 if refused
    order_penetration : float       order in h of the greatest overlap after impacts (inf: none beyond rounding)
    level : str                     where contacts are imposed: "position", "velocity", "acceleration" or several of them
    relative_degrees : tuple        the relative degrees that it handles
    handles : tuple of Feature      what else it handles
    reaction_lives : str            where its force is to be read
    energy : str                    what is true of its energy
    balances_energy : bool          whether the balance of energy closes, to its precision or its order
    precision : float               to what part of the largest terms the laws hold that it solves for
    kick : float                    part of h times the force that the velocities or forces of its record may lack
    slack : float                   error of the steps in units of that of their rule, estimated by second differences
    step : float                    error of a step away from events, in units of the second differences around it: twice the
                                    largest that registered problems and random schemes show, which is 0.9 for most
    drift : float                   largest displacement of massless nodes by a projection, in units of the change in a step
    dissipates : bool               whether impacts never leave a system with more energy than it began with
    adaptive : str                  how it chooses its steps, "" where they are those of dt
    accuracy : float                relative error of a run with its finest settings, as a reference for others
    source : str                    where it is from
    """

    summary: str
    order_smooth: float
    order_force_kink: float = 0.0
    order_force_jump: float = 0.0
    order_impact: float = 0.0
    order_friction: float = 0.0
    order_penetration: float
    level: str
    relative_degrees: tuple[int, ...]
    handles: tuple[Feature, ...]
    reaction_lives: str
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
        """The orders in words: "exact" or "to rtol" for what is no matter of steps, "-" for what is refused."""
        limit = "to rtol" if self.adaptive else "exact"
        orders = {
            "smooth": self.order_smooth,
            "r bends": self.order_force_kink,
            "r jumps": self.order_force_jump,
            "impacts": self.order_impact,
            "friction": self.order_friction,
        }
        return {name: limit if math.isinf(order) else f"{order:g}" if order else "-" for name, order in orders.items()}

    @property
    def penetration(self) -> str:
        """The greatest overlap after impacts, in words."""
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
    """Steps over which the impulse of one impact spreads."""
    reaction_is_mean: ClassVar[bool] = True
    """Whether a reaction that is recorded for each step is its mean there, which h times it makes the impulse."""
    family: ClassVar[str] = ""
    """The rule of the step, by name: methods of one family do not confirm each other. "" for a rule of its own."""
    mode_choice: ClassVar[str] = ""
    """What chooses the contact mode, where methods of several families share it; "" where the step itself does."""
    tolerances: ClassVar[tuple[str, ...]] = ("tol", "max_iter", "max_events", "max_newton", "rtol", "atol")
    """Options that do not change the orders that are declared."""
    rtol: float | None = None
    """The tolerance by which it chooses its steps, None where they are those of dt; an option of adaptive methods."""
    atol: float | None = None

    def reaction_times(self, grid: Grid) -> Array:
        """Return the instants at which the reactions of a run on ``grid`` live: those of the grid, unless overridden."""
        return grid.times(0, grid.steps)

    @abstractmethod
    def start(self, problem: Problem, grid: Grid, lcp_solver: str, record: Record) -> Any:
        """Write the initial values to the record, and return the carry that travels from block to block."""

    @abstractmethod
    def advance(self, carry: Any, record: Record, first: int, last: int) -> tuple[Status, int]:
        """Take the steps from t_first to t_last; return the status and the last step that was reached."""

    def finish(self, carry: Any, record: Record) -> None:  # noqa: B027
        """Put steps of the method's own choice in place of the grid, where it has chosen any."""

    def balance_point(self) -> float | None:
        """Return θ where the forces of a step balance at t + θ h, so that its energy can be balanced to rounding."""
        return None

    def limits(self) -> Limits:
        """Return how far from its laws a run may be, by what is declared."""
        declared = self.declared
        return Limits(
            precision=declared.precision,
            kick=declared.kick,
            slack=declared.slack,
            step=declared.step,
            drift=declared.drift,
            order=declared.order_smooth,
            penetration=0.0 if math.isinf(declared.order_penetration) else 1.0,
            balances_energy=declared.balances_energy,
            relative_degrees=declared.relative_degrees,
        )

    def with_tolerance(self, rtol: float) -> Self:
        """Return the method with another rtol, and with an atol that keeps its ratio to it."""
        scaled = {} if self.atol is None or self.rtol is None else {"atol": self.atol * rtol / self.rtol}
        changed: Self = replace(cast(Any, self), rtol=rtol, **scaled)
        return changed

    def motion(self, problem: Problem, end: float, lcp_solver: str) -> Motion | None:
        """Return the exact motion up to an instant, to be followed as far as is wanted; None of a method that steps."""
        return None

    def dense(self, carry: Any) -> ContinuousSolution | None:
        """Return the solution as a function of time, where the method has one."""
        return None


def check_method(thing: Any) -> None:
    """Check that what another package registers is a class of integrators that declares its properties.

    Raises
    ------
    InputError
        If it is not; the message says what is missing.
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
        }
        if not fits[str(kind)]:
            raise InputError(f"{thing.__name__}.declared has {each.name} = {value!r}, which must be {kind}")
