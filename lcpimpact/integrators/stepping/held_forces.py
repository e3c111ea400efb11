"""Sampled forces in steps: they are the last entries of the state, and set where a step begins at one of their instants."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.record import Grid
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.held_force import HeldForce
from lcpimpact.scheme.signals import snapped


@dataclass(frozen=True, eq=False)
class HeldSteps:
    """The steps of a grid at whose beginning sampled forces are set.

    Attributes
    ----------
    at : mapping        by the number of the step, each force with its instant and the position of its first entry
    n : int             number of coordinates
    """

    at: Mapping[int, list[tuple[HeldForce, float, int]]]
    n: int

    @classmethod
    def of(cls, d: Dynamics, grid: Grid) -> HeldSteps:
        """Return the steps of a grid that set the forces of a system.

        Raises
        ------
        InputError
            If a force is set within a step.
        """
        found: dict[int, list[tuple[HeldForce, float, int]]] = {}
        first = -len(d.held_at)
        for held in d.holds:
            times = held.instants(grid.t_end)
            steps, fits = snapped(grid.times(0, grid.steps), times)
            if not fits.all():
                raise InputError(_in_step(held, float(times[np.argmin(fits)]), grid))
            for k, t in zip(steps.tolist(), times.tolist(), strict=True):
                found.setdefault(k, []).append((held, t, first))
            first += len(held.at)
        return cls(found, len(d.nodes))

    def set(self, k: int, y: Array) -> None:
        """Write the forces that are set at the beginning of step k into the state y (N,)."""
        for held, t, first in self.at.get(k, ()):
            at = np.array(held.at)
            y[len(y) + first : len(y) + first + len(at)] = held(t, y[at], y[self.n + at])

    def next_after(self, k: int, last: int) -> int:
        """Return the first step after step k at whose beginning a force is set, and ``last`` at most."""
        return next((i for i in range(k + 1, last) if i in self.at), last) if self.at else last


def _in_step(held: HeldForce, t: float, grid: Grid, *, fits_rtol: float = 1e-9) -> str:
    """Return why steps do not take a force that is set at t, and which do.

    ``fits_rtol``: distance of a number of steps from a whole one below which it is that.
    """
    remedy = "take a dt of which its phase and period are whole multiples"
    for n in range(int(np.ceil(held.period / grid.h)), int(np.ceil(held.period / grid.h)) + 100):
        h = held.period / n
        if all(abs(T / h - round(T / h)) <= fits_rtol for T in (held.phase, grid.t_end)):
            remedy = f"take dt = {h:.12g} (period/{n})"
            break
    return (
        f"{held.law.element} is set at t = {t:g} s, within a step of dt = {grid.h:g} s: {remedy}, or method='exact', which "
        "needs none"
    )
