"""Functions of time: of a force, or of the motion of a node."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from lcpimpact.errors import InputError
from lcpimpact.numbers import is_real


class Signal(Protocol):
    """A motion that is given: its place and its velocity at any time."""

    def __call__(self, t: float, /) -> float:
        """Return the value at time t."""

    def rate(self, t: float, /) -> float:
        """Return the derivative at time t."""


@dataclass(frozen=True)
class Harmonic:
    """The signal a cos(ω t + φ), which even the exact solution follows without error.

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

    def __post_init__(self) -> None:
        if not (is_real(self.amplitude) and is_real(self.phase) and is_real(self.omega) and self.omega > 0.0):
            raise InputError(f"{self}: amplitude, omega and phase must be finite numbers, omega above zero")

    def __call__(self, t: float) -> float:
        """Return the value at time t."""
        return self.amplitude * math.cos(self.omega * t + self.phase)

    def rate(self, t: float) -> float:
        """Return the derivative at time t."""
        return -self.amplitude * self.omega * math.sin(self.omega * t + self.phase)


@dataclass(frozen=True)
class Motion:
    """A motion from two functions of your own: the place y(t) and the velocity y'(t).

    Parameters
    ----------
    place, velocity : callable
        Take the time in s, and return m and m/s.

    Examples
    --------
    >>> Motion(lambda t: 0.5 * t, lambda t: 0.5).rate(1.0)
    0.5
    """

    place: Callable[[float], float]
    velocity: Callable[[float], float]

    def __call__(self, t: float) -> float:
        """Return the place at time t."""
        return float(self.place(t))

    def rate(self, t: float) -> float:
        """Return the velocity at time t."""
        return float(self.velocity(t))
