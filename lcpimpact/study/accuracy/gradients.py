r"""The derivative of a discrete run by a parameter, and its error against the exact one.

With fixed steps a run is a function of the parameters that is smooth in pieces: it jumps or has a kink where an event
changes its step. Its derivative between is

.. math:: D_h y = \frac{y_h(p + d) - y_h(p - d)}{2 d}

with d so small that no event does, and so large that rounding does not count. Differences to both sides and for two d tell
both. Where p is at the end of its domain they are one-sided.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from lcpimpact.errors import FailureError, InputError
from lcpimpact.problems.base import Problem
from lcpimpact.problems.parameters import changes_at
from lcpimpact.quantities import quantity
from lcpimpact.simulation import simulate
from lcpimpact.study.accuracy.norms import ErrorLabel
from lcpimpact.study.accuracy.reference import Reference
from lcpimpact.study.sensitivity import sensitivity, sizes_of
from lcpimpact.trajectory import Trajectory

COLUMNS = ("gradient", "derivative", "noise")
"""Columns of the error of a derivative, of the derivative of the run, and of what its differences leave open."""

SHARES = (1e-6, 1e-7, 1e-8)
"""Differences d that are tried, relative to the size of the parameter; each also by a third."""

ADAPTIVE_SHARES = (1e-4, 1e-5, 1e-6)
"""As `SHARES`, for methods that choose their steps, which change with the parameter."""


@dataclass(frozen=True, eq=False)
class Gradient:
    """The derivative dy/dp of an output of a problem, by the exact motion, and that of discrete runs.

    Attributes
    ----------
    problem : Problem
    output, parameter : str
    value, size : float         of the parameter
    truth : float               dy/dp by `lcpimpact.sensitivity`
    unit : str                  of y over that of p
    t_end : float               s
    """

    problem: Problem
    output: str
    parameter: str
    value: float
    size: float
    truth: float
    unit: str
    t_end: float

    @classmethod
    def of(cls, problem: Problem, asked: Sequence[str], t_end: float) -> Gradient:
        """Return the exact derivative of an output by a parameter.

        Raises
        ------
        InputError
            If a pair of names is not given, or one of them is unknown.
        UnsupportedError
            If there is no exact derivative.
        """
        if isinstance(asked, str) or len(asked) != 2 or not all(isinstance(name, str) for name in asked):
            raise InputError(f'gradient = {asked!r} must name an output and a parameter, as in gradient=("x@1", "H")')
        output, parameter = asked
        found = sensitivity(problem, [parameter], [output], t_end=t_end)
        units = (found.table["unit"].item(), found.units.get(parameter, ""))
        return cls(
            problem,
            output,
            parameter,
            found.parameters[parameter],
            sizes_of(problem, found.parameters, found.units)[parameter],
            float(found.table[parameter].item()),
            f"{units[0] or 1} per {units[1]}" if units[1] else units[0],
            t_end,
        )

    @property
    def name(self) -> str:
        """The derivative in words, as ``d x@1/d H``."""
        return f"d {self.output}/d {self.parameter}"

    @property
    def label(self) -> ErrorLabel:
        """The words of its error."""
        return ErrorLabel("|D_h - D|", self.unit, f"error of {self.name}")

    def with_value(self, p: float) -> Problem:
        """Return the problem with another value of the parameter."""
        return changes_at(self.problem, [self.parameter])({self.parameter: p})

    def truth_unlike(self, method: str, reference: Reference) -> tuple[float, str]:
        """Return the derivative that judges a method, and its name.

        The saltation matrices move along the motion by ``exact``, so that this is judged by differences of the reference.
        """
        if method != "exact":
            return self.truth, f"{reference.name} with its saltation matrices"
        run = reference.trajectory
        if run.integrator is None or run.dense is None:
            raise FailureError(f"nothing judges {self.name} of {method}: {reference.name} locates no events", None)
        again = partial(
            simulate,
            method=run.integrator,
            dt=self.t_end / (len(run.t) - 1),
            t_end=self.t_end,
            progress=False,
            error=False,
        )
        return self.difference(lambda p: again(self.with_value(p)), run)[0], f"{reference.name} by differences"

    def measure(self, again: Callable[[float], Trajectory], run: Trajectory, truth: float) -> dict[str, float]:
        """Return the error of the derivative of a run, the derivative and its noise, as `COLUMNS`."""
        derivative, noise = self.difference(again, run)
        return dict(zip(COLUMNS, (abs(derivative - truth), derivative, noise), strict=True))

    def difference(
        self, again: Callable[[float], Trajectory], run: Trajectory, *, agreement: float = 1e-3, floor: float = 1e-6
    ) -> tuple[float, float]:
        """Return the derivative of a discrete run by the parameter, and how far its differences leave it open.

        The latter is ten times how far two of them differ, and their rounding.

        ``again``: returns the run with another value of the parameter; an `InputError` refuses the value.
        ``agreement``: largest spread of the differences to both sides with both d, relative to the derivative.
        ``floor``: least spread that counts, relative to the output over the size of the parameter.

        Raises
        ------
        FailureError
            If the differences do not agree.
        """
        y, p = self._measured(run), self.value
        least = floor * max(abs(y) / self.size, abs(self.truth))
        adaptive = run.integrator is not None and run.integrator.rtol is not None
        for share in ADAPTIVE_SHARES if adaptive else SHARES:
            d = share * self.size
            one_sided, both = list[float](), list[float]()
            for step in (d, d / 3.0):
                ends = [
                    (each, beside) for each in (step, -step) if (beside := self._beside(again, p + each)) is not None
                ]
                one_sided += [(beside - y) / each for each, beside in ends]
                (a, y_a), (b, y_b) = (*ends, (0.0, y))[:2]
                both.append((y_a - y_b) / (a - b))
            if np.ptp(one_sided) <= agreement * max(map(abs, one_sided)) + least:
                return both[0], 10.0 * (abs(both[0] - both[1]) + float(np.finfo(float).eps) * abs(y) / d)
        reason = "its steps change; take a tighter rtol" if adaptive else "an event changes its step; take another dt"
        raise FailureError(
            f"the run has no {self.name}: differences with d = {d / 3.0:.0e} are {min(one_sided):.3g} to "
            f"{max(one_sided):.3g}, as where {reason}",
            None,
        )

    def _measured(self, run: Trajectory) -> float:
        """Return the output of a run.

        Raises
        ------
        FailureError
            If the run does not have it.
        """
        if not run.ended:
            raise FailureError(run.message, None)
        y = float(quantity(self.output, run.problem).measure(run))
        if not math.isfinite(y):
            raise FailureError(f"the run has no {self.output}: take smaller steps", None)
        return y

    def _beside(self, again: Callable[[float], Trajectory], p: float) -> float | None:
        """Return the output of the run with another value of the parameter, or None where that is refused."""
        try:
            run = again(p)
        except InputError:
            return None
        return self._measured(run)
