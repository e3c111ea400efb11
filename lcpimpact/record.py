"""Parts of a result: grid, state, event, record, and continuous solution."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from lcpimpact.arrays import Array, Flags

SLIP_RTOL = 1e-6
"""Distance of a slider force from its threshold, relative to it, below which the slider slips."""

CLOSED_GAP_RTOL = 1e-12
"""Gap or penetration, relative to the terms of the gap, below which a contact is closed."""


@dataclass(frozen=True)
class Grid:
    """The instants t_i = i t_end / steps; integers, never a float range."""

    t_end: float
    steps: int

    @property
    def h(self) -> float:
        """The step."""
        return self.t_end / self.steps

    def times(self, first: int, last: int) -> Array:
        """Return t_i for first <= i <= last."""
        t = np.arange(first, last + 1, dtype=np.float64)
        t *= self.t_end
        t /= self.steps
        if last == self.steps:
            t[-1] = self.t_end
        return t


@dataclass(frozen=True)
class State:
    """Coordinates q (n,), velocities v (n,) and reactions r (nc,) at one instant, on one side of it."""

    q: Array
    v: Array
    reaction: Array


@dataclass(frozen=True)
class Event:
    """A change of the contact mode, with both limits.

    Attributes
    ----------
    t : float               the instant in s
    contact : str           the name of the reaction
    kind : str              "close", "open" or "impact"; "stick" or "slip" of a slider, the latter also at a
                            reversal; "slide" of a relay where a sliding mode begins, "switch" where it goes to a
                            bound, from the other or from sliding; "jam" of friction, an impulse without approach;
                            "jump" of a system with an inconsistent initial state
    left, right : State     left and right limits; at the start only q has a left one
    impulse : float         N s; zero unless an impact, a jam or a jump
    law : str               of an impact "newton", "sequential", "poisson" or "lzb", that of its scheme; "" of other kinds
    solutions : float, optional
                            number of distinct v⁺ that obey the law there: 1 nearly always, inf for a continuum, None not
                            examined
    velocities : tuple of (n,) arrays
                            these v⁺ if there are several, of a continuum its extremes
    """

    t: float
    contact: str
    kind: str
    left: State
    right: State
    impulse: float = 0.0
    law: str = ""
    solutions: float | None = 1
    velocities: tuple[Array, ...] = ()


@dataclass(eq=False)
class Stats(Mapping[str, float]):
    """The cost of a run; ``stats["seconds"]`` and ``stats.seconds`` are the same.

    Attributes
    ----------
    steps : int                 accepted steps
    rejected : int              rejected steps
    lcp_solves : int            linear complementarity problems
    lcp_iterations : int        iterations of their solver
    newton_iterations : int     iterations of Newton's method
    evaluations : int           right sides evaluated
    residual : float            largest residual of an accepted step
    seconds : float             duration of the run in s
    """

    steps: int = 0
    rejected: int = 0
    lcp_solves: int = 0
    lcp_iterations: int = 0
    newton_iterations: int = 0
    evaluations: int = 0
    residual: float = 0.0
    seconds: float = 0.0

    def add_lcps(self, solves: int, iterations: int, residual: float, newton: int = 0) -> None:
        """Count the LCPs of a block of steps, each with a right side of its own, as each of Newton's iterations has."""
        self.lcp_solves += solves
        self.lcp_iterations += iterations
        self.newton_iterations += newton
        self.evaluations += solves + newton
        self.residual = max(self.residual, residual)

    def __getitem__(self, name: str) -> float:
        if name not in self.__dataclass_fields__:
            raise KeyError(name)
        value: float = getattr(self, name)
        return value

    def __iter__(self) -> Iterator[str]:
        return iter(self.__dataclass_fields__)

    def __len__(self) -> int:
        return len(self.__dataclass_fields__)


@dataclass
class Record:
    """The arrays that a run fills.

    Attributes
    ----------
    t (nt,), q (nt, n), v (nt, n)               the grid and the motion on it
    t_reaction (nr,), reaction (nr, nc)         the reactions and their instants
    events                                      events located by the method
    stats                                       cost so far
    """

    t: Array
    q: Array
    v: Array
    t_reaction: Array
    reaction: Array
    events: list[Event] | None = None
    stats: Stats = field(default_factory=Stats)

    def reader(self, dense: ContinuousSolution | None) -> Callable[[Array], tuple[Array, Array]]:
        """Return the function that gives q and v, right limits, at sorted times: dense, or at the nearest instants."""

        def read(t: Array) -> tuple[Array, Array]:
            if dense is not None:
                return dense.read(t)[:2]
            at = (0.5 * (self.t[1:] + self.t[:-1])).searchsorted(t)
            return self.q[at], self.v[at]

        return read


@dataclass(frozen=True, eq=False)
class ContinuousSolution:
    """The solution as a function of time.

    Attributes
    ----------
    solution : callable     solution(t, side) -> q, v, reaction at the sorted times t (nt,), on one side of the events
    cuts : (nk,) array      times from 0 to the end between which the solution is smooth and resolved
    resolved : (nk - 1,) array of bool, optional
        Whether it is resolved between two cuts, if not between all, as with too many oscillations.
    """

    solution: Callable[[Array, str], tuple[Array, Array, Array]]
    cuts: Array
    resolved: Flags | None = None

    def read(self, t: Array, side: str = "right") -> tuple[Array, Array, Array]:
        """Return q (nt, n), v (nt, n) and the reactions (nt, nc) at the sorted times t (nt,), on one side of the events."""
        # Compiled code takes no array that is read-only.
        return self.solution(np.require(t, np.float64, ["C", "W"]), side)

    def resolves(self, cuts: Array) -> Flags:
        """Return whether the solution is resolved between other, finer cuts (nk - 1,)."""
        if self.resolved is None or self.resolved.all():
            return np.ones(len(cuts) - 1, np.bool_)
        own = np.searchsorted(self.cuts, cuts[:-1], side="right") - 1
        return np.asarray(self.resolved[np.clip(own, 0, len(self.resolved) - 1)])
