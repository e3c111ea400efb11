"""Closed-form values of a problem, and their measurement on a run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from lcpimpact.reading import Readable


@dataclass(frozen=True)
class Fact:
    """A number that is known of a problem, from a formula that has nothing to do with how runs are made.

    Attributes
    ----------
    symbol : str                how the literature calls it
    what : str                  in words
    value : float               from the closed form
    unit : str                  "" for a pure number
    measure : callable          takes a Trajectory, and returns the same quantity as the run shows it
    accuracy : float            relative to the largest of |value| and ``scale``: how far an exact run may be from the value,
                                because the closed form or the model behind the scheme (Prony series, finite elements) is
                                no better
    scale : float               what an error is compared with where the value itself is small or zero
    digits : int                significant digits of the value that are known, the last of them to one unit
    """

    symbol: str
    what: str
    value: float
    unit: str
    measure: Callable[[Readable], float]
    accuracy: float = 1e-9
    scale: float = 0.0
    digits: int = 14

    def error(self, trajectory: Readable) -> float:
        """Return |measured - value| relative to the largest of |value| and ``scale``."""
        return abs(self.measure(trajectory) - self.value) / max(abs(self.value), self.scale)
