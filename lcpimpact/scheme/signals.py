r"""Functions of time: of a force, or of the motion of a node.

`Harmonic`, `Polynomial`, `Ramp`, `Table` and `Square` are states of the first-order form, which the exact solution follows
without error. The last four are polynomials of one degree between their breakpoints,

.. math:: f(t) = \sum_{k=0}^{d} f^{(k)}(t_i^+) \frac{(t - t_i)^k}{k!}, \qquad t_i \le t < t_{i+1} .

A step sees the left limit at its end and the right limit at its beginning (`limits_at`), and its mean where it holds
breakpoints (`means_in_steps`); a function of Python is sampled. A sum of signals is as exact as its terms: a load is one
load for each, and a motion has the states of all.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from numbers import Real
from typing import Any, ClassVar, Protocol, TypeAlias, TypeGuard, TypeVar

import numpy as np
from numpy.polynomial.polynomial import polyder, polyval
from numpy.typing import ArrayLike, DTypeLike

from lcpimpact.arguments import is_sequence
from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.errors import InputError
from lcpimpact.formula import NotTracedError, mentions
from lcpimpact.numbers import is_real, positive
from lcpimpact.scheme.waves import MAX_ANGLE, X, cosine, sine

MAX_DEGREE = 20
"""Largest degree of a polynomial; beyond it the powers of t lose all digits."""

NEAR_ULPS = 4.0
"""Distance of a breakpoint from an instant of a grid, in units of the spacing of floats there, up to which they are one."""

MAX_BREAKPOINTS = 1_000_000
"""Maximum number of breakpoints of one periodic signal in a run."""

UNITS = {"omega": "rad/s", "phase": "rad", "t_start": "s", "t_end": "s", "period": "s"}
"""Units of the numbers of signals that are not in the unit of the signal."""

TimeFunction: TypeAlias = Callable[[float], float]

T = TypeVar("T")


class Signal(Protocol):
    """A prescribed motion: position and velocity at any time."""

    def __call__(self, t: float, /) -> float:
        """Return the value at time t."""

    def rate(self, t: float, /) -> float:
        """Return the derivative at time t."""


def _number(name: str, function: TimeFunction, t: float, unit: str) -> float:
    """Return the value of a function at t, which must be a real number, if not finite."""
    try:
        value = function(t)
    except (TypeError, ValueError, ArithmeticError, LookupError) as error:
        raise InputError(
            f"{name}({t!r}) fails by {type(error).__name__}: {error}; a function takes the time in s, and nothing else, and "
            f"returns a number in {unit}"
        ) from error
    if type(value) is float:
        return value
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    if np.ndim(value) > 0 or not isinstance(value, Real) or isinstance(value, bool):
        shown = f"an array of the shape {value.shape}" if isinstance(value, np.ndarray) and value.ndim else repr(value)
        raise InputError(f"{name}({t!r}) returns {shown}; return a finite number in {unit}")
    return float(value)


@dataclass(frozen=True)
class Checked:
    """A function of time that a user wrote, whose values are made sure to be numbers.

    Attributes
    ----------
    name : str              whose it is
    given : callable        the function; as a motion it has a ``rate``
    unit : str              of its values
    """

    name: str
    given: Any
    unit: str

    def __call__(self, t: float, /) -> float:
        """Return the value at time t."""
        return _number(self.name, self.given, t, self.unit)

    def rate(self, t: float, /) -> float:
        """Return the derivative at time t, of a motion."""
        return _number(f"{self.name}.rate", self.given.rate, t, f"{self.unit}/s")


def checked(name: str, function: TimeFunction, unit: str, moves: bool = False) -> Described | Checked:
    """Return a function of time that checks its values; with ``moves`` it has a rate.

    Raises
    ------
    InputError
        Naming the function and its value, here if that is not a finite number at t = 0.
    """
    if mentions(function):
        terms = terms_of(function)
        if isinstance(function, Described) and all(isinstance(each, Harmonic) or not mentions(each) for each in terms):
            return function
        raise NotTracedError(f"{name} is no Harmonic, whose formulas alone are known")
    sure = Checked(name, function, unit)
    for label, value in ((name, sure(0.0)), *([(f"{name}.rate", sure.rate(0.0))] if moves else [])):
        if not math.isfinite(value):
            raise InputError(f"{label}(0.0) returns {value!r}; return a finite number in {unit}")
    return function if isinstance(function, Described) else sure


class Described(ABC):
    """A signal whose course is known: a state of the first-order form. Other functions of time are inputs.

    Signals are added to and subtracted from each other and numbers, and multiplied by numbers.
    """

    __array_ufunc__ = None  # a number of NumPy leaves the arithmetic to the signal

    sizes: ClassVar[tuple[str, ...]]
    """The fields in the unit of the signal."""

    @abstractmethod
    def __call__(self, t: float, /) -> float:
        """Return the value at time t, its right limit where it jumps."""

    @abstractmethod
    def rate(self, t: float, /) -> float:
        """Return the derivative at time t, its right limit where it jumps."""

    @property
    def continuous(self) -> bool:
        """Whether the value never jumps."""
        return True

    def breakpoints(self, start: float, end: float) -> Array:
        """Return the instants start < t <= end at which the value or a derivative may jump, in their order."""
        return np.zeros(0)

    def __add__(self, other: Described | float) -> Described:
        if isinstance(other, Described):
            return SignalSum((*terms_of(self), *terms_of(other)))
        if not is_real(other):
            raise InputError(
                f"{type(self).__name__} + {other!r}: signals are added to each other and to finite numbers; a function of "
                "Python stands beside them as another Load"
            )
        return self if other == 0.0 else SignalSum((*terms_of(self), Polynomial((other,))))  # sum() begins with 0

    __radd__ = __add__

    def __sub__(self, other: Described | float) -> Described:
        return self + -other if isinstance(other, Described) or is_real(other) else self + other

    def __rsub__(self, other: float) -> Described:
        return -self + other

    def __mul__(self, factor: float) -> Described:
        if not is_real(factor):
            raise InputError(f"{type(self).__name__} * {factor!r}: the factor must be a finite number")
        old = {name: getattr(self, name) for name in self.sizes}
        new = {
            name: tuple(factor * x for x in each) if is_sequence(each) else factor * each for name, each in old.items()
        }
        return replace(self, **new)  # type: ignore[type-var]

    __rmul__ = __mul__

    def __neg__(self) -> Described:
        return self * -1.0


@dataclass(frozen=True)
class Harmonic(Described):
    """The signal a cos(ω t + φ).

    Parameters
    ----------
    amplitude : float
        a, in N as a load and in m as a motion.
    omega : float
        ω in rad/s, positive.
    phase : float
        φ in rad.

    Examples
    --------
    >>> Harmonic(amplitude=2.0, omega=3.0)(0.0)
    2.0
    """

    amplitude: float
    omega: float
    phase: float = 0.0

    sizes: ClassVar[tuple[str, ...]] = ("amplitude",)

    def __post_init__(self) -> None:
        _check_wave(self, self.amplitude, self.omega, self.phase)

    def check_until(self, end: float) -> None:
        """Refuse a run whose steps cannot follow the oscillations until ``end``.

        Raises
        ------
        InputError
            If |ω t + φ| reaches 2³⁰ rad, as many as a run may have steps.
        """
        angle = self.omega * end + abs(self.phase)
        if not angle < MAX_ANGLE:
            raise InputError(
                f"{self} turns by {angle:.1e} rad until {end:g} s, and less than {MAX_ANGLE:.1e} are followed: "
                "shorten the run, take a lower omega, or a phase between -π and π"
            )

    def __call__(self, t: X) -> X:
        """Return the value at time t, or the values at an array of times."""
        return self.amplitude * cosine(self.omega * t + self.phase)

    def rate(self, t: X) -> X:
        """Return the derivative at time t, or those at an array of times."""
        return -self.amplitude * self.omega * sine(self.omega * t + self.phase)


class PiecewisePolynomial(Described):
    """A signal that is a polynomial of one degree between its breakpoints, and continuous from the right there."""

    @property
    @abstractmethod
    def degree(self) -> int:
        """The degree d of the pieces."""

    @abstractmethod
    def derivatives(self, t: ArrayLike) -> Array:
        """Return f and its first d derivatives at the times t, right limits, with the shape of t followed by (d + 1,)."""

    def __call__(self, t: float) -> float:
        """Return the value at time t, its right limit where it jumps."""
        return float(self.derivatives(t)[0])

    def rate(self, t: float) -> float:
        """Return the derivative at time t, its right limit where it jumps."""
        return float(self.derivatives(t)[1]) if self.degree else 0.0


@dataclass(frozen=True)
class Polynomial(PiecewisePolynomial):
    """The signal c_0 + c_1 t + c_2 t² + ...

    Parameters
    ----------
    coefficients : sequence of float
        c_k in N/s^k as a load and in m/s^k as a motion, from the constant on.

    Raises
    ------
    InputError
        If there is no coefficient, one is not a finite number, or the degree is above 20.

    Examples
    --------
    A belt that runs at 0.3 m/s:

    >>> belt = Polynomial([0.0, 0.3])
    >>> belt(2.0), belt.rate(2.0)
    (0.6, 0.3)
    """

    coefficients: tuple[float, ...]

    sizes: ClassVar[tuple[str, ...]] = ("coefficients",)

    def __post_init__(self) -> None:
        c = number_field(self, "coefficients")
        if not 1 <= len(c) <= MAX_DEGREE + 1:
            raise InputError(
                f"Polynomial: it has {len(c)} coefficients, and 1 to {MAX_DEGREE + 1} are possible; a longer course of "
                "time is a Table of points"
            )
        if not np.isfinite(self._derivatives).all():
            raise InputError(f"{self}: a derivative is larger than any number; give smaller coefficients")

    @cached_property
    def _derivatives(self) -> Array:
        """Row k: the coefficients of the k-th derivative, filled up by zeros (d + 1, d + 1)."""
        rows = [np.array(self.coefficients, dtype=np.float64)]
        with np.errstate(over="ignore"):
            for _ in range(self.degree):
                rows.append(np.append(polyder(rows[-1]), 0.0))
        return np.array(rows)

    @property
    def degree(self) -> int:
        """The number of the last coefficient."""
        return len(self.coefficients) - 1

    def derivatives(self, t: ArrayLike) -> Array:
        """Return f and its first d derivatives, with the shape of t followed by (d + 1,)."""
        times = np.asarray(t)
        times = times if times.dtype == object else np.asarray(t, dtype=np.float64)  # times may be formulas
        return np.stack([polyval(times, row) for row in self._derivatives], axis=-1)


@dataclass(frozen=True)
class Table(PiecewisePolynomial):
    """The piecewise linear signal through points; before the first and after the last it is constant, or it is periodic.

    Parameters
    ----------
    times : sequence of float
        In s, in ascending order. A repeated time is a jump, at which the second value applies.
    values : sequence of float
        In N as a load and in m as a motion, one for each time.
    period : float, optional
        In s: the points come again after it, before them and behind them without end, and the signal is linear from the
        last of them to the first of the next. A last time that is a period after the first is the same instant, a jump
        where the values differ.

    Raises
    ------
    InputError
        If the times decrease, one is listed more than twice, there are not as many values, or the points extend over more
        than the period; and for a run in which a periodic table has more than a million points.

    Examples
    --------
    >>> push = Table([0.0, 1.0, 3.0], [0.0, 50.0, 0.0])
    >>> push(2.0), push.rate(2.0), push(4.0)
    (25.0, -25.0, 0.0)
    >>> sawtooth = Table([0.0, 2.0], [0.0, 1.0], period=2.0)
    >>> sawtooth(1.0), sawtooth(2.0), sawtooth(3.0), sawtooth(-1.0)
    (0.5, 0.0, 0.5, 0.5)
    """

    times: tuple[float, ...]
    values: tuple[float, ...]
    period: float | None = None

    sizes: ClassVar[tuple[str, ...]] = ("values",)

    def __post_init__(self) -> None:
        times = number_field(self, "times")
        values = number_field(self, "values")
        if len(times) != len(values) or not times:
            raise InputError(f"Table: it has {len(times)} times and {len(values)} values; give one value for each time")
        back = np.flatnonzero(np.diff(times) < 0.0)
        if len(back):
            raise InputError(f"Table: the time {times[back[0] + 1]:g} s follows {times[back[0]]:g} s; sort the points")
        if self.period is not None:
            positive("Table: period", self.period, "s")
            if times[-1] - times[0] - self.period > self._rounding:
                raise InputError(
                    f"Table: its points extend over {times[-1] - times[0]:g} s, and period = {self.period:g} s is shorter: "
                    "leave points out, or give a longer period"
                )
            if not abs(times[0]) < MAX_ANGLE * self.period:
                raise InputError(
                    f"Table: its first time, {times[0]:g} s, is too many periods of {self.period:g} s from 0: begin near 0"
                )
        here = np.where(self._closed & (self._instants == times[-1]), times[0], self._instants)
        place, listed = np.unique(here, return_counts=True)
        if (listed > 2).any():
            raise InputError(
                f"Table: the time {place[np.argmax(listed)]:g} s is listed more than twice"
                f"{self._closed * ', with those a period later'}; two points make a jump"
            )
        if not np.isfinite(self._slopes).all():
            raise InputError(
                "Table: two points lie so close that their slope is larger than any number; move them apart"
            )

    @cached_property
    def _instants(self) -> Array:
        return np.array(self.times, dtype=np.float64)

    @property
    def _rounding(self) -> float:
        """The distance in s up to which two times are one."""
        return NEAR_ULPS * float(np.spacing(np.abs(self._instants).max()))

    @property
    def _closed(self) -> bool:
        """Whether the last time is a period after the first, but for rounding."""
        if self.period is None or len(self.times) == 1:
            return False
        return abs(self.times[-1] - self.times[0] - self.period) <= self._rounding

    @cached_property
    def _points(self) -> Array:
        """The distinct times, in one period if there is one, and the values before and after each (3, n)."""
        instants, first = np.unique(self._instants, return_index=True)
        last = np.append(first[1:], len(self.times)) - 1
        values = np.array(self.values, dtype=np.float64)
        points = np.stack([instants, values[first], values[last]])
        if self._closed:
            points[1, 0] = points[1, -1]
            return points[:, :-1]
        return points

    @cached_property
    def _slopes(self) -> Array:
        """The slopes before, between and after the distinct times (n + 1,)."""
        points = self._points
        if self.period is not None:
            points = np.column_stack([points, points[:, 0] + [self.period, 0.0, 0.0]])
        with np.errstate(over="ignore"):
            slopes = (points[1, 1:] - points[2, :-1]) / np.diff(points[0])
        return np.concatenate([[0.0], slopes, [0.0] if self.period is None else []])

    @cached_property
    def recurrence(self) -> float | None:
        """The period in s: as given, or the shortest after which the points come again, at least twice; None without one."""
        if self.period is not None:
            return float(self.period)
        instants = self._points[0]
        before, after = self._points[1, 1:], self._points[2, :-1]
        pieces, extent = len(instants) - 1, instants[-1] - instants[0]
        rounding = 4.0 * np.finfo(np.float64).eps * max(abs(instants[0]), abs(instants[-1]))
        for each in range(1, pieces // 2 + 1):
            T = extent * each / pieces
            if (
                pieces % each == 0
                and (np.abs(instants[:-each] + T - instants[each:]) <= rounding).all()
                and (after[:-each] == after[each:]).all()
                and (before[:-each] == before[each:]).all()
            ):
                return float(T)
        return None

    @property
    def degree(self) -> int:
        """One."""
        return 1

    @property
    def continuous(self) -> bool:
        """Whether no time has two different values."""
        return bool((self._points[1] == self._points[2]).all())

    def breakpoints(self, start: float, end: float) -> Array:
        """Return the times of the points in start < t <= end."""
        instants = self._points[0]
        if self.period is not None:
            with np.errstate(over="ignore"):
                first, last = (np.array([start, end]) - instants[0]) / self.period
            if not (last - first) * len(instants) <= MAX_BREAKPOINTS:
                raise InputError(
                    f"a Table with period = {self.period:g} s has {(last - first) * len(instants):.1e} points until "
                    f"{end:g} s, and at most {MAX_BREAKPOINTS:,} are followed: shorten the run, or take a longer period"
                )
            k = np.arange(math.floor(first) - 1, math.ceil(last) + 2, dtype=np.float64)
            instants = np.unique(instants + k[:, None] * self.period)
        first, last = np.searchsorted(instants, [start, end], side="right")
        return np.asarray(instants[first:last])

    def derivatives(self, t: ArrayLike) -> Array:
        """Return f and f', right limits, with the shape of t followed by (2,)."""
        t = np.asarray(t, dtype=np.float64)
        instants = self._points[0]
        shift = self._whole_periods(t)
        piece = np.searchsorted(instants, t - shift, side="right")
        if self.period is not None:
            # The instants of the points are rounded, and it is they that the pieces begin at.
            while (late := (piece < len(instants)) & (t >= np.append(instants, np.inf)[piece] + shift)).any():
                piece = piece + late
            while (early := (piece > 1) & (t < instants[piece - 1] + shift)).any():
                piece = piece - early
            piece = np.maximum(piece, 1)
        slope = self._slopes[piece]
        begin = np.append(instants[0], instants)[piece] + shift
        value = np.append(self._points[1, 0], self._points[2])[piece] + slope * (t - begin)
        return np.stack([value, slope], axis=-1)

    def _whole_periods(self, t: Array) -> Array:
        """Return by how much the points of the period of each time t lie behind those that are listed."""
        if self.period is None:
            return 0.0 * t
        first = self._points[0][0]
        k = np.floor((t - first) / self.period)
        k = k + (t >= first + (k + 1.0) * self.period)
        k = k - (t < first + k * self.period)
        return np.asarray(k * self.period)


@dataclass(frozen=True)
class Ramp(PiecewisePolynomial):
    """The signal that is ``start`` until t_start, ``end`` from t_end on, and linear between.

    Parameters
    ----------
    start, end : float
        In N as a load and in m as a motion.
    t_start, t_end : float
        In s; where they are equal, the signal is a step.

    Raises
    ------
    InputError
        If a number is not finite, or t_end lies before t_start.

    Examples
    --------
    >>> wall = Ramp(start=0.0, end=0.2, t_start=1.0, t_end=1.5)
    >>> wall(1.25), wall.rate(1.25), wall.rate(2.0)
    (0.1, 0.4, 0.0)
    """

    start: float
    end: float
    t_start: float
    t_end: float

    sizes: ClassVar[tuple[str, ...]] = ("start", "end")

    def __post_init__(self) -> None:
        if not all(is_real(each) for each in (self.start, self.end, self.t_start, self.t_end)):
            raise InputError(f"{self}: start, end, t_start and t_end must be finite numbers")
        if self.t_end < self.t_start:
            raise InputError(f"{self}: it ends at {self.t_end:g} s, before it starts; exchange t_start and t_end")
        if not np.isfinite(self._table.derivatives(self.t_start)).all():
            raise InputError(f"{self}: its slope is larger than any number; give it more time")

    @cached_property
    def _table(self) -> Table:
        return Table((self.t_start, self.t_end), (self.start, self.end))

    @property
    def degree(self) -> int:
        """One."""
        return 1

    @property
    def continuous(self) -> bool:
        """Whether it has no jump."""
        return self._table.continuous

    def breakpoints(self, start: float, end: float) -> Array:
        """Return t_start and t_end, where they lie in start < t <= end."""
        return self._table.breakpoints(start, end)

    def derivatives(self, t: ArrayLike) -> Array:
        """Return f and f', right limits, with the shape of t followed by (2,)."""
        return self._table.derivatives(t)


@dataclass(frozen=True)
class Square(PiecewisePolynomial):
    """The square wave a sign cos(ω t + φ), a load that jumps between a and -a.

    Parameters
    ----------
    amplitude : float
        a in N.
    omega : float
        ω in rad/s, positive.
    phase : float
        φ in rad.

    Raises
    ------
    InputError
        If a number is not finite, or ω is not above zero; and for a run in which it jumps more than a million times.

    Examples
    --------
    >>> push = Square(amplitude=2.0, omega=3.0)
    >>> push(0.0), push(1.0)
    (2.0, -2.0)
    """

    amplitude: float
    omega: float
    phase: float = 0.0

    sizes: ClassVar[tuple[str, ...]] = ("amplitude",)

    def __post_init__(self) -> None:
        _check_wave(self, self.amplitude, self.omega, self.phase)

    @property
    def degree(self) -> int:
        """Zero."""
        return 0

    @property
    def continuous(self) -> bool:
        """Whether there is nothing to jump."""
        return self.amplitude == 0.0

    def breakpoints(self, start: float, end: float) -> Array:
        """Return the instants of the jumps in start < t <= end."""
        first, last = (self.omega * t + self.phase for t in (start, end))
        if not (last - first) / math.pi <= MAX_BREAKPOINTS:
            raise InputError(
                f"{self} jumps {(last - first) / math.pi:.1e} times until {end:g} s, and at most {MAX_BREAKPOINTS:,} are "
                "followed: shorten the run, or take a lower omega"
            )
        if not abs(self.phase) < MAX_ANGLE:
            raise InputError(
                f"{self}: a phase of more than {MAX_ANGLE:.1e} rad has no digits left; take one from -π to π"
            )
        # One more at either side, since first and last are rounded.
        instants = self._instant(
            np.arange(math.floor(first / math.pi) - 1, math.ceil(last / math.pi) + 2, dtype=np.float64)
        )
        return np.unique(instants[(instants > start) & (instants <= end)])

    def derivatives(self, t: ArrayLike) -> Array:
        """Return f, its right limit, with the shape of t followed by (1,)."""
        t = np.asarray(t, dtype=np.float64)
        k = np.floor((self.omega * t + self.phase) / math.pi + 0.5)
        # The instants of the jumps are rounded, and it is they that the value jumps at.
        k = k + (t >= self._instant(k + 1.0)) - (t < self._instant(k))
        return np.asarray(self.amplitude * (1.0 - 2.0 * np.mod(k, 2.0)))[..., None]

    def _instant(self, k: Array) -> Array:
        """Return the instant at which ω t + φ = (k - 1/2) π."""
        return np.asarray(((k - 0.5) * math.pi - self.phase) / self.omega)


@dataclass(frozen=True)
class SignalSum(Described):
    """The sum of signals, which ``+`` makes of them and of numbers.

    Parameters
    ----------
    terms : tuple of signals
        `Harmonic`, `Polynomial`, `Ramp`, `Table` or `Square`, one or more.

    Raises
    ------
    InputError
        If a term is none of these.

    Examples
    --------
    A machine that starts in two seconds, and shakes:

    >>> push = Ramp(start=0.0, end=100.0, t_start=0.0, t_end=2.0) + Harmonic(amplitude=5.0, omega=30.0)
    >>> push(0.0), len(push.terms)
    (5.0, 2)
    >>> (2.0 * push - 10.0)(0.0)
    0.0
    """

    terms: tuple[Described, ...]

    sizes: ClassVar[tuple[str, ...]] = ("terms",)

    def __post_init__(self) -> None:
        if not isinstance(self.terms, tuple) or not self.terms:
            raise InputError(f"SignalSum: terms = {self.terms!r} must be a tuple of {SIGNAL_NAMES}")
        for i, each in enumerate(self.terms):
            if not isinstance(each, Described) or isinstance(each, SignalSum):
                raise InputError(f"SignalSum: terms[{i}] = {each!r} must be {SIGNAL_NAMES}")

    def __call__(self, t: float) -> float:
        """Return the value at time t, its right limit where it jumps."""
        return sum(each(t) for each in self.terms)

    def rate(self, t: float) -> float:
        """Return the derivative at time t, its right limit where it jumps."""
        return sum(each.rate(t) for each in self.terms)

    @property
    def continuous(self) -> bool:
        """Whether no term jumps."""
        return all(each.continuous for each in self.terms)

    def breakpoints(self, start: float, end: float) -> Array:
        """Return the instants of all terms in start < t <= end, in their order."""
        return np.unique(np.concatenate([each.breakpoints(start, end) for each in self.terms]))


@dataclass(frozen=True)
class Motion:
    """A motion from two functions: the position y(t) and the velocity y'(t).

    Parameters
    ----------
    place, velocity : callable
        Take the time in s, and return m and m/s.

    Examples
    --------
    >>> Motion(lambda t: 0.5 * t, lambda t: 0.5).rate(1.0)
    0.5
    """

    place: TimeFunction
    velocity: TimeFunction

    def __call__(self, t: float) -> float:
        """Return the position at time t."""
        return _number("place", self.place, t, "m")

    def rate(self, t: float) -> float:
        """Return the velocity at time t."""
        return _number("velocity", self.velocity, t, "m/s")


SIGNALS: dict[str, type[Described]] = {each.__name__: each for each in (Harmonic, Polynomial, Ramp, Table, Square)}
"""Signals that a scheme file can hold."""

SIGNAL_NAMES = "Harmonic(...), Polynomial(...), Ramp(...), Table(...) or Square(...)"
"""Names of these signals, for errors."""


@dataclass(frozen=True)
class Scaled:
    """A function of time times a number."""

    factor: float
    given: TimeFunction

    def __call__(self, t: float, /) -> float:
        """Return the value at time t."""
        return self.factor * self.given(t)


def scaled(signal: Any, factor: float) -> Any:
    """Return a number or a function of time times a number; a signal that is described stays so."""
    return Scaled(factor, signal) if callable(signal) and not isinstance(signal, Described) else factor * signal


def terms_of(signal: T) -> tuple[T | Described, ...]:
    """Return the terms of a sum; of another signal, number or function of time itself."""
    return signal.terms if isinstance(signal, SignalSum) else (signal,)


def loads_of(f: T) -> tuple[T | Described | float, ...]:
    """Return the terms of a force, a constant polynomial as a number."""
    return tuple(
        each.coefficients[0] if isinstance(each, Polynomial) and each.degree == 0 else each for each in terms_of(f)
    )


def values_at(function: TimeFunction, times: Array) -> Array:
    """Return the values of a function of time, with the shape of the times."""
    if isinstance(function, SignalSum):
        return np.asarray(sum(values_at(each, times) for each in function.terms))
    if isinstance(function, PiecewisePolynomial):
        return function.derivatives(times)[..., 0]
    if isinstance(function, Harmonic):
        return np.asarray(function(times))
    return np.array([function(float(s)) for s in times.ravel()]).reshape(times.shape)


def breakpoints_at(signal: Described, t: Array) -> tuple[Indices, Array]:
    """Return the instants of a grid (nt,) within `NEAR_ULPS` of which a signal has a breakpoint, by index, and these."""
    reach = NEAR_ULPS * np.spacing(np.abs(t))
    times = signal.breakpoints(float(np.nextafter(t[0] - reach[0], -np.inf)), float(t[-1] + reach[-1]))
    at, near = snapped(t, times)
    return at[near], times[near]


def snapped(t: Array, times: Array) -> tuple[Indices, Flags]:
    """Return the instants of a grid (nt,) nearest to some times, by index, and which of these are within `NEAR_ULPS`."""
    after = np.clip(np.searchsorted(t, times), 1, max(len(t) - 1, 1))
    at = after - (times - t[after - 1] < t[np.minimum(after, len(t) - 1)] - times)
    return at, np.abs(t[at] - times) <= NEAR_ULPS * np.spacing(np.abs(t[at]))


def limits_at(function: TimeFunction, t: Array) -> tuple[Array, Array]:
    """Return the left and the right limits of a function of time at the instants of a grid (nt,)."""
    values = values_at(function, t)
    if isinstance(function, SignalSum):
        limits = np.array([limits_at(each, t) for each in function.terms]).sum(axis=0)
        return limits[0], limits[1]
    if not breaks(function):
        return values, values
    left = values.copy()
    right = values.copy()
    at, before, after = limits_at_breakpoints(function, t)
    left[at], right[at] = before[:, 0], after[:, 0]
    return left, right


def limits_at_breakpoints(signal: PiecewisePolynomial, t: Array) -> tuple[Indices, Array, Array]:
    """Return the instants of a grid (nt,) at breakpoints of a signal, by index, and the limits of its derivatives there.

    Breakpoints within `NEAR_ULPS` of an instant are at it, since both are rounded: the left limit is that at the first of
    them, and the right one that at the last. A slope between them is a jump.
    """
    at, times = breakpoints_at(signal, t)
    first, last = np.diff(at, prepend=-1) > 0, np.diff(at, append=len(t)) > 0
    early = np.nextafter(times[first], -np.inf)
    left = signal.derivatives(early)
    left[:, :-1] += (times[first] - early)[:, None] * left[:, 1:]  # a steep piece changes up to its end
    return at[first], left, signal.derivatives(np.maximum(times[last], t[at[last]]))


def means_in_steps(signal: PiecewisePolynomial, t: Array) -> tuple[Indices, Array]:
    r"""Return the steps of a grid (nt,) with breakpoints of a signal inside, by index, and its means in them.

    They are \frac 1h \sum_j \sum_k f^{(k)}(t_j^+) \frac{(t_{j+1} - t_j)^{k+1}}{(k+1)!} over the pieces of the step.
    """
    times = signal.breakpoints(float(t[0]), float(t[-1]))
    at, near = snapped(t, times)
    inside, right = times[~near], t.copy()
    right[at[near]] = np.maximum(times[near], t[at[near]])
    steps = np.unique(np.searchsorted(t, inside) - 1)
    if not len(steps):
        return steps, np.zeros(0)
    starts = np.sort(np.concatenate([t[steps], inside]))
    of = np.searchsorted(t, starts, side="right") - 1
    Δ = np.minimum(np.append(starts[1:], np.inf), t[of + 1]) - starts
    f = signal.derivatives(np.where(starts == t[of], right[of], starts))
    impulse = 0.0 * Δ
    weight = Δ
    for k in range(signal.degree + 1):
        impulse = impulse + f[:, k] * weight
        weight = weight * Δ / (k + 2)
    return steps, np.add.reduceat(impulse, np.searchsorted(of, steps)) / np.diff(t)[steps]


def limits_in_steps(function: TimeFunction, t: Array, kept: float | None = None) -> tuple[Array, Array]:
    """Return the left and the right limits at the instants of a grid (nt,) of a function of time as steps see it.

    A step that holds breakpoints sees its mean. A limit at the end of the step that is ``kept``, at t + c h with c = 0 or 1,
    stays, and with that at the other end has this mean.
    """
    left, right = limits_at(function, t)
    if not breaks(function):
        return left, right
    left = left.copy()
    right = right.copy()
    k, mean = means_in_steps(function, t)
    begin, end = right[k], left[k + 1]
    right[k] = {None: mean, 0.0: begin, 1.0: 2.0 * mean - end}[kept]
    left[k + 1] = {None: mean, 0.0: 2.0 * mean - begin, 1.0: end}[kept]
    return left, right


def values_in_steps(function: TimeFunction, t: Array, c: float) -> Array:
    """Return a function of time at t + c h, 0 < c < 1, in the steps of a grid, or its mean where they hold breakpoints."""
    values = values_at(function, (1.0 - c) * t[:-1] + c * t[1:])
    if breaks(function):
        k, mean = means_in_steps(function, t)
        values[k] = mean
    return values


def breaks(function: float | TimeFunction) -> TypeGuard[PiecewisePolynomial]:
    """Whether a function of time is a signal, no sum, that may have breakpoints."""
    return isinstance(function, PiecewisePolynomial) and not isinstance(function, Polynomial)


def jumps(function: float | TimeFunction) -> TypeGuard[PiecewisePolynomial | SignalSum]:
    """Whether a function of time is a signal whose value jumps at breakpoints that it knows."""
    return isinstance(function, Described) and not function.continuous


def places_and_rates(motions: Sequence[Signal], times: Array, kind: DTypeLike = np.float64) -> tuple[Array, Array]:
    """Return y(t) and y'(t) of motions, with the shape of the times and then (np,)."""
    y, rate = np.zeros((2, *times.shape, len(motions)), kind)
    for k, term in ((k, term) for k, motion in enumerate(motions) for term in terms_of(motion)):
        if isinstance(term, PiecewisePolynomial):
            found = term.derivatives(times)
            y[..., k] += found[..., 0]
            if term.degree:
                rate[..., k] += found[..., 1]
        elif isinstance(term, Harmonic):
            y[..., k] += term(times)
            rate[..., k] += term.rate(times)
        else:
            y[..., k] += values_at(term, times)
            rate[..., k] += values_at(term.rate, times)
    return y, rate


class Signals:
    """Functions of time, each listed once: waves by their frequency and phase, others as they are.

    A load a cos(ω t + φ) is a times the signal cos(ω t + φ), and other loads are themselves times 1.
    """

    def __init__(self) -> None:
        self._waves: dict[tuple[float, float], int] = {}
        self._others: dict[PiecewisePolynomial | int, tuple[int, TimeFunction]] = {}

    def __len__(self) -> int:
        return len(self._waves) + len(self._others)

    @property
    def listed(self) -> list[TimeFunction]:
        """The signals, waves with the amplitude 1."""
        found: dict[int, TimeFunction] = {place: Harmonic(1.0, *wave) for wave, place in self._waves.items()}
        found |= dict(self._others.values())
        return [found[place] for place in sorted(found)]

    def place(self, signal: TimeFunction) -> tuple[float, int]:
        """List a signal if it is new; return its amplitude and its place."""
        if isinstance(signal, Harmonic):
            wave = float(signal.omega), float(signal.phase)
            return float(signal.amplitude), self._waves.setdefault(wave, len(self))
        key = signal if isinstance(signal, PiecewisePolynomial) else id(signal)
        return 1.0, self._others.setdefault(key, (len(self), signal))[0]

    def __call__(self, t: ArrayLike) -> Array:
        """Return s(t), with the shape of t followed by (ns,)."""
        times = np.asarray(t, dtype=np.float64)
        values = np.zeros((*times.shape, len(self)))
        if self._waves:
            omega, phase = np.array([*self._waves]).T
            values[..., list(self._waves.values())] = cosine(omega * times[..., None] + phase)
        for place, signal in self._others.values():
            values[..., place] = values_at(signal, times)
        return values

    def limits_in_steps(self, t: Array, at_ends: Flags) -> tuple[Array, Array]:
        """Return the left and the right limits of s at the instants of a grid as its steps see them (nt, ns).

        Those of some signals (ns,) are seen as they are ``at_ends`` of steps, and not by their means.
        """
        left = self(t)
        right = left.copy()
        for place, signal in self._others.values():
            if breaks(signal):
                limits = limits_at if at_ends[place] else limits_in_steps
                left[:, place], right[:, place] = limits(signal, t)
        return left, right


def check_harmonics(signals: Iterable[float | TimeFunction], end: float) -> None:
    """Refuse harmonic signals that steps cannot follow until ``end``: `Harmonic.check_until`."""
    for each in (term for signal in signals for term in terms_of(signal)):
        if isinstance(each, Harmonic):
            each.check_until(end)


def _check_wave(signal: Signal, amplitude: float, omega: float, phase: float) -> None:
    if not (is_real(amplitude) and is_real(phase) and is_real(omega) and omega > 0.0):
        raise InputError(f"{signal}: amplitude, omega and phase must be finite numbers, omega above zero")


def number_field(signal: Hashable, field: str) -> tuple[float, ...]:
    """Make a field a tuple of numbers, which can be hashed, and return it."""
    kind, given = type(signal).__name__, getattr(signal, field)
    if not is_sequence(given):
        raise InputError(f"{kind}: {field} = {given!r} must be a sequence of finite numbers")
    given = tuple(given)
    for i, each in enumerate(given):
        if not is_real(each):
            raise InputError(f"{kind}: {field}[{i}] = {each!r} must be a finite number")
    numbers = tuple(each if isinstance(each, int) else float(each) for each in given)
    object.__setattr__(signal, field, numbers)
    return numbers
