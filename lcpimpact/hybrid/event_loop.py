"""The event loop: a motion is integrated to the event that ends its mode, enters the next mode there, and continues.

Common to `exact`, `event-driven` and `radau-fesd`: limits of the number of events, failures as statuses, and one-sided
limits at events. Each method has its own integration between events and its own event location.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from typing import ClassVar, Generic, NamedTuple, TypeVar

import numpy as np

from lcpimpact.arrays import Array, Indices
from lcpimpact.errors import FailureError, Status, UnsupportedError
from lcpimpact.hybrid.friction import NoVelocity
from lcpimpact.hybrid.mode_choice import Ambiguous, TooManyRows
from lcpimpact.hybrid.multiple_impacts import EndlessImpact
from lcpimpact.hybrid.system import System
from lcpimpact.problems.base import Problem
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.lagrangian import LagrangianDynamics

AnySystem = TypeVar("AnySystem", System, LagrangianDynamics)


class Unresolved(Exception):
    """Impacts of several bodies that follow each other within an instant without end."""


class Ending(NamedTuple):
    """The instant at which a mode ends, or a breakpoint of the signals.

    Attributes
    ----------
    t : float                   the instant in s
    duration : float            length in s of the last piece of the motion before it; 0: none since the last event
    X : (N,) array              the left limit of the state
    row : int                   event function that turns negative, in the numbering of the method; -1 if none
    breakpoint : bool           whether it is a breakpoint of the signals
    """

    t: float
    duration: float
    X: Array
    row: int = -1
    breakpoint: bool = False


@dataclass(eq=False)
class EventLoop(ABC, Generic[AnySystem]):
    """A hybrid motion up to the present instant.

    Attributes
    ----------
    system : System or LagrangianDynamics
    end : float                     end of the run in s
    solver : str                    name of an LCP solver
    max_events : int                limit of events
    breakpoints : (nb,) array       those of the signals, from the start to the end
    scale : (N,) array              largest |X| so far, the scale of rounding
    switches : int                  events so far
    at_once : int                   number of the last events at one instant
    """

    system: AnySystem
    end: float
    solver: str
    max_events: int
    breakpoints: Array
    scale: Array
    switches: int = field(default=0, init=False)
    at_once: int = field(default=1, init=False)

    max_at_once: ClassVar[int] = 100
    """Number of events at one instant that ends the run with MAX_EVENTS."""
    instant_rtol: ClassVar[float] = 0.0
    """Events nearer than this, relative to the time, are at one instant."""

    @abstractmethod
    def integrate(self, until: float) -> Ending | Status:
        """Integrate the mode to its end, or to ``until``: then the status is SOLVED."""

    @abstractmethod
    def enter(self, ending: Ending) -> Status:
        """Enter the next mode, after the impacts and with the events between."""

    def next_breakpoint(self, t: float) -> float:
        """Return the first breakpoint of the signals after t, or inf."""
        later = int(self.breakpoints.searchsorted(t, side="right"))
        return float(self.breakpoints[later]) if later < len(self.breakpoints) else np.inf

    def count_event(self, ending: Ending) -> bool:
        """Count an event, and return whether the run may go on."""
        self.switches += 1
        self.at_once = self.at_once + 1 if ending.duration <= self.instant_rtol * ending.t else 1
        return self.switches <= self.max_events and self.at_once < self.max_at_once


def follow(motion: EventLoop[System] | EventLoop[LagrangianDynamics], until: float) -> Status:
    """Follow a motion from event to event up to ``until``; a status other than SOLVED says why it ends before."""
    while not isinstance(ending := motion.integrate(until), Status):
        if ending.row >= 0 and not motion.count_event(ending):
            return Status.MAX_EVENTS
        try:
            status = motion.enter(ending)
        except Unresolved:
            return Status.ACCUMULATION
        except Ambiguous:
            return Status.AMBIGUOUS
        except TooManyRows:
            return Status.TOO_MANY_ROWS
        except NoVelocity:
            return Status.NO_VELOCITY
        except EndlessImpact:
            return Status.ENDLESS_IMPACT
        except FailureError as failure:
            return Status(failure.result.status)
        except np.linalg.LinAlgError:
            return Status.SINGULAR
        if status is not Status.SOLVED:
            return status
    return ending


@contextmanager
def refuse_undetermined(problem: Problem, method: str) -> Iterator[None]:
    """Refuse a problem whose initial state leaves contact forces undetermined.

    Raises
    ------
    UnsupportedError
        Where the first mode cannot be chosen.
    """
    try:
        yield
    except Ambiguous as several:
        lcp = several.lcp
        M = lcp.M.hi.tolist()
        q = lcp.q.hi.tolist()
        lower = lcp.lower.tolist()
        upper = lcp.upper.tolist()
        raise UnsupportedError(
            f"several motions of {problem.name!r} obey its laws from the start: all_solutions({M}, {q}, "
            f"lower={lower}, upper={upper}) lists the solutions of the LCP of its mode; change the initial state a little"
        ) from None
    except TooManyRows:
        raise UnsupportedError(
            f"more than five rough contacts of {problem.name!r} are closed at the start, too many for {method!r} to search "
            "the LCP of the mode for all its solutions: ",
            ("moreau-jean",),
        ) from None
    except (NoVelocity, EndlessImpact) as failure:
        status = Status.NO_VELOCITY if isinstance(failure, NoVelocity) else Status.ENDLESS_IMPACT
        sentence = status.sentence
        raise UnsupportedError(f"{problem.name!r} begins with an impact. {sentence}") from None
    except FailureError:
        raise UnsupportedError(
            f"no motion without an impulse obeys the laws of {problem.name!r} from the start, as in Painlevé's paradox, "
            f"which {method!r} does not handle: change the initial state, or ",
            ("moreau-jean",),
        ) from None
    except np.linalg.LinAlgError:
        raise UnsupportedError(
            f"some contacts or sliders of {problem.name!r} hold together at the start in a way that leaves their shares "
            f"undetermined, which {method!r} does not handle: ",
            ("moreau-jean",),
        ) from None


def read_segments(
    d: Dynamics,
    starts: Array,
    kind: Indices,
    t: Array,
    side: str,
    read: Callable[[Indices, Indices | slice], tuple[Array, Array, Array]],
) -> tuple[Array, Array, Array]:
    """Return q (nt, n), v (nt, n) and r (nt, nc) at the sorted times t (nt,), on one side of the events.

    Segment i has the ``kind[i]`` and lasts from ``starts[i]`` to the start of the next. ``read(owner, mine)`` returns
    q, v and r at the times t[mine], which are in the segments ``owner`` of one kind.
    """
    n, nc = len(d.nodes), len(d.contacts)
    q = np.empty((len(t), n))
    v = np.empty((len(t), n))
    r = np.empty((len(t), nc))
    if len(t) == 0:
        return q, v, r
    owner = np.maximum(starts.searchsorted(t, side="right" if side == "right" else "left") - 1, 0)
    kinds = kind[owner]
    order = np.argsort(kinds, kind="stable") if (kinds[1:] < kinds[:-1]).any() else None
    sorted_kinds = kinds if order is None else kinds[order]
    cuts = [0, *(np.flatnonzero(sorted_kinds[1:] != sorted_kinds[:-1]) + 1).tolist(), len(t)]
    for here in (slice(*each) if order is None else order[slice(*each)] for each in pairwise(cuts)):
        q[here], v[here], r[here] = read(owner[here], here)
    return q, v, r
