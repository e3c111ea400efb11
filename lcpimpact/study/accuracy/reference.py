"""Reference solutions: exact if available, else by the most accurate independent method."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

from lcpimpact.arguments import checked, short
from lcpimpact.errors import InputError, LcpImpactError, UnsupportedError
from lcpimpact.numbers import is_real
from lcpimpact.problems.base import Problem
from lcpimpact.simulation import simulate
from lcpimpact.trajectory import Trajectory

POINTS = 1009
"""Number of grid points of a reference with a continuous solution."""

CANDIDATES: tuple[tuple[str, int, dict[str, Any]], ...] = (
    ("exact", POINTS, {}),
    ("event-driven", POINTS, {"rtol": 1e-12}),
    ("radau-fesd", POINTS, {"stages": 4}),
    ("moreau-jean", 100_003, {}),
)
"""Method, number of steps and options of the references, the most accurate first."""


@dataclass(frozen=True)
class Reference:
    """A reference solution.

    Attributes
    ----------
    trajectory : Trajectory
    name : str                  method, with its resolution if not exact
    """

    trajectory: Trajectory
    name: str


def given_reference(given: Reference | Trajectory, problem: Problem, t_end: float) -> Reference:
    """Return the argument as a `Reference`, which must be of this problem with its parameters, and reach the end."""
    found = Reference(given, given.method) if isinstance(given, Trajectory) else given
    other = found.trajectory.problem
    for name, value in problem.parameters.items() if other.name == problem.name else ():
        if other.parameters.get(name, value) != value:
            raise InputError(
                f"reference is of {other.name!r} with {name} = {other.parameters[name]:g}, and the problem has {value:g}: "
                "take a run of the same problem"
            )
    if found.trajectory.t[-1] < t_end * (1.0 - 1e-9):
        raise InputError(
            f"reference ends at {found.trajectory.t[-1]:g} s, before t_end = {t_end:g} s: take a longer one"
        )
    return found


@checked
def reference(problem: Problem, t_end: float | None = None, unlike: Collection[str] = ()) -> Reference:
    """Return the reference solution of a problem.

    It is computed by `exact` if that supports the problem, else `event-driven` with relative tolerance 1e-12, else
    `radau-fesd` with four stages, else `moreau-jean` with 100,000 steps.

    Parameters
    ----------
    problem : Problem
        Any problem.
    t_end : float, optional
        End in s; by default that of the problem.
    unlike : collection of str
        Methods under study, excluded as references.

    Raises
    ------
    UnsupportedError
        If no other method reaches the end; the message gives the reasons.

    Examples
    --------
    >>> from lcpimpact import load_problem
    >>> reference(load_problem("bouncing-ball"), 1.0).name, reference(load_problem("hertz-impact")).name
    ('exact', 'event-driven (rtol=1e-12)')
    """
    end = problem.t_end if t_end is None else t_end
    if not is_real(end):
        raise InputError(f"t_end = {short(end)} must be a finite number in s")
    reasons = []
    for method, steps, options in CANDIDATES:
        if method in unlike:
            continue
        try:
            found = simulate(problem, method, dt=end / steps, t_end=end, progress=False, **options)
        except LcpImpactError as error:
            reasons.append(str(error))
            continue
        settings = [f"{name}={value:g}" for name, value in options.items()]
        settings += [f"{steps} steps"] * (found.dense is None)
        return Reference(found, f"{method} ({', '.join(settings)})" if settings else method)
    raise UnsupportedError(f"nothing to judge {problem.name!r} against: {'; '.join(reasons)}")
