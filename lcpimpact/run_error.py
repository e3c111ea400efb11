"""The estimated error of a run: how far its columns, events and usual quantities are off, and how that is known."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from lcpimpact.errors import InputError
from lcpimpact.files import Json
from lcpimpact.registry import nearest

COARSE = 0.1
"""Error of a coordinate, relative to the range of its motion, above which a run is coarse."""

MAX_SHOWN = 8
"""Maximum number of columns, coordinates or reactions in a text."""

OFF = "turned off by error=False: run.estimate_error() computes it"


@dataclass(frozen=True)
class EventError:
    """The errors of one event of a run; NaN where the more accurate run has no such event near it.

    Attributes
    ----------
    t : float           instant in the run in s
    contact, kind : str
    instant : float     error of the instant in s
    impulse : float     error of the impulse in N s
    """

    t: float
    contact: str
    kind: str
    instant: float
    impulse: float


@dataclass(frozen=True)
class RunError:
    """The estimated error of a run.

    ``run.error["x"]`` is the largest error of a column over the run, in its unit. It is measured at the instants of the run:
    of a coordinate at all of them; of velocities and forces, which jump, at those that are more than a step away from an
    event in either run, so that an impact some milliseconds late is an error of its instant, in ``events``, and not of the
    whole jump; of velocities not at the first, where they are the given ones. An event that only one of the runs has excuses
    nothing.

    Attributes
    ----------
    how : str
        "exact", against the exact motion of the same problem; "halving", from the runs at dt/2, dt/4 and, across events,
        about dt/17; "unknown".
    reason : str
        How it was found, or why it is not known.
    columns : mapping of str to float
        The error of each coordinate, velocity and force.
    ranges : mapping of str to float
        The range of each column, its largest less its least value, in the more accurate run.
    coordinates : tuple of str
        The columns that are coordinates.
    events : tuple of EventError
        The errors of the events of the run, in their order.
    summary : mapping of str to float
        The error of each key of `Trajectory.summary`; NaN where the run or the more accurate one has no such quantity, and
        of a number of impacts that still changes with the step, as where they accumulate.
    order : float
        The order by which halving converged, of the coordinate with the largest relative error; NaN for other ways.
    dt : float
        The step in s by which a coarse run would not be: NaN where it is not coarse, or no step is known to do.

    Examples
    --------
    >>> from lcpimpact import load_problem, simulate
    >>> run = simulate(load_problem("bouncing-ball", e=0.5), dt=1e-2, t_end=1.0)
    >>> run.error.how, f"{run.error['x']:.2g} m", run.error.coarse
    ('exact', '0.027 m', False)
    """

    how: str
    reason: str
    columns: Mapping[str, float] = field(default_factory=dict)
    ranges: Mapping[str, float] = field(default_factory=dict)
    coordinates: tuple[str, ...] = ()
    events: tuple[EventError, ...] = ()
    summary: Mapping[str, float] = field(default_factory=dict)
    order: float = math.nan
    dt: float = math.nan

    @classmethod
    def unknown(cls, reason: str) -> RunError:
        """Return an error that is not known."""
        return cls("unknown", reason)

    def __getitem__(self, name: str) -> float:
        if self.how == "unknown":
            return math.nan
        if name not in self.columns:
            raise InputError(nearest(str(name), list(self.columns), "series"))
        return self.columns[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns)

    @property
    def known(self) -> bool:
        """Whether there is an estimate."""
        return self.how != "unknown"

    @property
    def relative(self) -> dict[str, float]:
        """The error of each column by its range; of one that does not move, zero without an error, else infinite."""
        return {name: _by(error, self.ranges[name]) for name, error in self.columns.items()}

    @property
    def worst(self) -> tuple[str, float]:
        """The coordinate with the largest error relative to the range of its motion, and that."""
        # What hardly moves beside others of its kind is measured by their motion.
        least = COARSE**6 * max((self.ranges[name] for name in self.coordinates), default=0.0)
        found = {name: _by(self.columns[name], max(self.ranges[name], least)) for name in self.coordinates}
        name = max(found, key=lambda each: found[each] if found[each] == found[each] else -1.0, default="")
        return name, found.get(name, math.nan)

    @property
    def coarse(self) -> bool:
        """Whether a coordinate is off by more than a tenth of the range of its motion."""
        return self.worst[1] > COARSE

    def lines(self, unit: Callable[[str], str] | None = None) -> list[str]:
        """Return the error in words, line by line; ``unit`` gives the unit of a column."""
        if not self.known:
            return [f"unknown: {self.reason}"]
        shown = self.coordinates[:MAX_SHOWN]
        texts = [f"{name} {self.columns[name]:.1e} {unit(name) if unit else ''}".rstrip() for name in shown]
        more = f", and {len(self.coordinates) - MAX_SHOWN} more" if len(self.coordinates) > MAX_SHOWN else ""
        instants = [each.instant for each in self.events if each.instant == each.instant]
        lines = [f"{', '.join(texts)}{more} ({self.reason})"]
        if missed := len(self.events) - len(instants):
            lines.append(f"{missed} of {len(self.events)} events have no counterpart in the more accurate run")
        if self.coarse:
            lines.append(f"coarse: {self.remark}")
        return lines

    @property
    def remark(self) -> str:
        """Error and remedy of a coarse run, in words; "" for others."""
        if not self.coarse:
            return ""
        name, relative = self.worst
        remedy = f"take dt = {self.dt:.3g}" if self.dt == self.dt else "take a smaller dt"
        return f"{name} is off by {relative:.0%} of the range of its motion: {remedy}"

    def of(self, columns: Sequence[str] | None) -> RunError:
        """Return the error of some of the columns; all where they are not named."""
        if columns is None or not self.known:
            return self
        return replace(
            self,
            columns={name: self.columns[name] for name in columns},
            ranges={name: self.ranges[name] for name in columns},
            coordinates=tuple(name for name in self.coordinates if name in columns),
        )

    def to_dict(self) -> dict[str, Json]:
        """Return plain numbers, strings, lists and dictionaries."""
        return asdict(self)

    @classmethod
    def of_dict(cls, found: Mapping[str, Any]) -> RunError:
        """Return the error of the dictionary that `to_dict` gave; null is NaN."""

        def number(value: float | None) -> float:
            return math.nan if value is None else float(value)

        def numbers(given: Mapping[str, float | None]) -> dict[str, float]:
            return {name: number(value) for name, value in given.items()}

        events = tuple(
            EventError(number(e["t"]), str(e["contact"]), str(e["kind"]), number(e["instant"]), number(e["impulse"]))
            for e in found["events"]
        )
        return cls(
            str(found["how"]), str(found["reason"]), numbers(found["columns"]), numbers(found["ranges"]),
            tuple(map(str, found["coordinates"])), events, numbers(found["summary"]),
            number(found["order"]), number(found["dt"]),
        )  # fmt: skip

    def __str__(self) -> str:
        return "\n".join(self.lines())


def _by(error: float, size: float) -> float:
    if size > 0.0:
        return error / size
    return 0.0 if error == 0.0 else math.inf if error > 0.0 else math.nan
