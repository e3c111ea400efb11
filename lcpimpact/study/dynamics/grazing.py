"""Grazing: the parameter value at which an orbit becomes tangent to a stop."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import brentq

from lcpimpact.arguments import checked
from lcpimpact.errors import FailureError, InputError
from lcpimpact.hybrid.motion import HybridMotion
from lcpimpact.problems.base import Problem
from lcpimpact.registry import nearest
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.study.dynamics.shooting import MAX_NEWTON_STEPS, PeriodicOrbit, exact, find_orbit
from lcpimpact.study.progress import Progress, counted
from lcpimpact.study.result import Study

FAR_GAPS = 1e3
"""Gap of a stop that is removed, in units of the largest gap of the scheme plus one metre."""

GRAZING_RTOL = 1e-6
"""Largest gap of a grazing orbit, relative to those at the ends of the bracket; a larger one has jumped."""

MAX_ORBITS = 100
"""Maximum number of orbits computed in the search for the grazing one; about ten suffice."""


@checked
def least_gap(orbit: PeriodicOrbit, contact: str | None = None) -> tuple[float, str, float]:
    """Return the minimum gap of an orbit between contacts in m, with its contact and time.

    It is the smallest local minimum of u(t), at a zero of u' of the exact motion.

    Parameters
    ----------
    orbit : PeriodicOrbit
    contact : str, optional
        One contact; by default the one with the smallest gap. (inf, "", nan) if there is none.

    Raises
    ------
    InputError
        For an unknown contact.
    """
    best = (math.inf, "", math.nan)
    for i in _stops(orbit.problem, contact):
        name = orbit.problem.dynamics.contacts[i].name
        gap, t = least(exact(orbit.motion), orbit.start + orbit.T, i, float(orbit.problem.dynamics.u0[i]))
        best = min(best, (gap, name, t))
    return best


def _stops(problem: Problem, contact: str | None) -> list[int]:
    """Return the row of the named contact, or the rows of all contacts except sliders."""
    contacts = problem.dynamics.contacts
    known = {each.name: i for i, each in enumerate(contacts) if each.impenetrable}
    if contact is None:
        return list(known.values())
    if contact not in known:
        raise InputError(nearest(str(contact), list(known), "contact"))
    return [known[contact]]


def touched_stop(problem: Problem, contact: str | None) -> int:
    """Return the row of the named contact, or of the only stop."""
    rows = _stops(problem, contact)
    if len(rows) != 1:
        names = [problem.dynamics.contacts[i].name for i in rows]
        raise InputError(f"contact = ... must name the stop that is touched: one of {', '.join(names) or 'none'}")
    return rows[0]


def out_of_reach(dynamics: Dynamics, i: int) -> Dynamics:
    """Return the dynamics with the stop of row i so far away that no motion reaches it."""
    u0 = dynamics.u0.copy()
    u0[i] += FAR_GAPS * (1.0 + np.abs(u0).max())
    return replace(dynamics, u0=u0)


def least(motion: HybridMotion, until: float, i: int, u0: float) -> tuple[float, float]:
    """Return the smallest minimum of the gap of row i with the constant u0, and its time, excluding contacts."""
    system, best = motion.system, (math.inf, math.nan)
    name = system.dynamics.contacts[i].name
    segments = motion.segments
    for k, segment in enumerate(segments):
        if i in segment.mode.closed:
            continue
        flow, F = system.mode(segment.mode)
        c = system.derivatives[0, i] + system.form.D[i] @ F
        c[system.form.constant] = u0
        last = segments[k + 1].t0 if k + 1 < len(segments) else until
        t, X = segment.t0, segment.X
        touched = any(event.contact == name for event in segment.events)
        if k and not touched:
            best = min(best, (float(c @ X), t))
        sign, zeros = (1.0 if c @ flow.A @ X >= 0.0 else -1.0), 0
        while True:
            crossing = flow.first_crossing(X, motion.scale, (sign * c @ flow.A)[None], np.array([zeros]), last - t)
            if crossing.row < 0:
                break
            t, X = t + float(crossing.t.hi), crossing.state.hi
            if sign < 0.0:
                best = min(best, (float(c @ X), t))
            sign, zeros = -sign, 1
    return best


@dataclass(frozen=True, eq=False, repr=False)
class Grazing(Study):
    """A grazing orbit.

    Attributes
    ----------
    value : float           parameter value
    contact : str           grazed contact
    t : float               time of the grazing in s
    gap : float             minimum gap of ``orbit`` in m; zero to rounding
    orbit : PeriodicOrbit   grazing orbit
    """

    value: float
    contact: str
    t: float
    gap: float
    orbit: PeriodicOrbit

    title = "Grazing orbit of {0.orbit.problem.name}"

    @property
    def table(self) -> pd.DataFrame:
        """One row: ``value``, ``contact``, ``t`` (s), ``gap`` (m), ``T`` (s), ``growth`` (the largest |μ|)."""
        row = {"value": self.value, "contact": self.contact, "t": self.t, "gap": self.gap}
        return pd.DataFrame([row | {"T": self.orbit.T, "growth": self.orbit.growth}])

    def summary(self) -> str:
        """Return the parameter value, contact and time of the grazing, and the orbit."""
        first = (
            f"{self.orbit.problem.name}: at {self.value:.12g} the orbit touches {self.contact} at t = {self.t:.9g} s"
        )
        return f"{first}\n{self.orbit.summary()}"

    @checked
    def plot(self, path: str | Path | None = None, **options: str | float | None) -> Any:
        """Draw the orbit, as in `PeriodicOrbit`."""
        return self.orbit.plot(path, **options)


@checked
def grazing(
    family: Callable[[float], Problem],
    bracket: tuple[float, float],
    *,
    contact: str | None = None,
    periods: int = 1,
    T: float | None = None,
    transient: int = 0,
    max_iter: int = MAX_NEWTON_STEPS,
    progress: Progress = True,
) -> Grazing:
    r"""Find the parameter value at which a periodic orbit grazes a stop.

    It is the root of the minimum gap along the orbit with the stop removed, so that the orbit continues beyond the grazing
    and the gap changes sign. Other contacts remain active.

    Parameters
    ----------
    family : callable
        Takes a value and returns a Problem.
    bracket : pair of float
        Two values between which the minimum gap changes sign.
    contact : str, optional
        Name of the stop; by default the only one.
    periods, T, transient, max_iter
        As in `periodic_orbit`.
    progress : bool or callable
        As in `lcpimpact.study.progress`.

    Raises
    ------
    InputError
        If the gap has the same sign at both ends, or no stop is named although there are several.
    FailureError
        If the gap changes sign by a jump, where the orbit itself changes.
    LcpImpactError
        As `periodic_orbit`.

    Examples
    --------
    >>> from lcpimpact import grazing, load_problem
    >>> touch = grazing(lambda f: load_problem("shaw-holmes", omega=0.8, s=1.0, f=f), (0.1, 1.0))
    >>> f"{touch.value:.12f}", f"{((1 - 0.8**2) ** 2 + (2 * 0.05 * 0.8) ** 2) ** 0.5:.12f}"
    ('0.368781778292', '0.368781778292')

    References
    ----------
    Nordmark, Non-periodic motion caused by grazing incidence in an impact oscillator (1991).
    """
    low, high = (float(value) for value in bracket)
    i = touched_stop(family(low), contact)
    orbits: dict[float, tuple[PeriodicOrbit, float, float]] = {}

    def gap(value: float) -> float:
        problem = family(value)
        dynamics = problem.dynamics
        orbit = find_orbit(problem, out_of_reach(dynamics, i), periods, T, transient, max_iter)
        orbits[value] = orbit, *least(exact(orbit.motion), orbit.start + orbit.T, i, float(dynamics.u0[i]))
        done(len(orbits))
        return orbits[value][1]

    name = family(low).dynamics.contacts[i].name
    with counted(MAX_ORBITS, "orbits", progress) as done:
        ends = gap(low), gap(high)
        if ends[0] * ends[1] > 0.0:
            raise InputError(
                f"the least gap of {name!r} is {ends[0]:.3g} m at {low:g} and {ends[1]:.3g} m at {high:g}: "
                "a bracket must hold the stop out of reach at one end and within reach at the other"
            )
        value = float(brentq(gap, low, high, xtol=1e-300, rtol=4.0 * np.finfo(float).eps, maxiter=MAX_ORBITS))
        gap(value)
    orbit, gap_there, t = orbits[value]
    if not abs(gap_there) <= GRAZING_RTOL * max(map(abs, ends)):
        raise FailureError(
            f"the least gap of {name!r} jumps at {value:.9g} and is not zero there ({gap_there:.3g} m): the orbit changes "
            "in the bracket without grazing; take a bracket beside it",
            None,
        )
    return Grazing(value, name, t, gap_there, orbit)
