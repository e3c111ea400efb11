"""Smooth against nonsmooth: the rigid problem and its compliant variants, by any methods and steps, in one table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lcpimpact.errors import LcpImpactError
from lcpimpact.integrators.base import Integrator
from lcpimpact.problems.base import Problem
from lcpimpact.problems.penalty import penalized
from lcpimpact.simulation import simulate
from lcpimpact.study.norms import l1_v, sup_q
from lcpimpact.trajectory import Trajectory

Penalty = tuple[str, float] | tuple[str, float, Mapping[str, float]]
"""A law, its stiffness k, and what else `penalized` is to be given."""

WITHIN = 8
"""Samples between two points of a run that is known everywhere."""


@dataclass(frozen=True)
class Row:
    """What one run showed against the exact solution of the rigid problem.

    Attributes
    ----------
    method : str                name of the method
    law : str                   "rigid", or the law that stood for the bumpers
    k : float                   its stiffness in N/m or N/mⁿ; inf where rigid
    dt : float                  step in s, or spacing of the output for a method that chooses its steps
    sup_q : float               sup |q - q*| in m on the grid
    l1_v : float                ∫ Σ |v - v*| dt in m
    closings : int              how often a contact closed: events of the run, or touches that its grid or samples show
    penetration : float         greatest overlap of a bumper in m, likewise
    lcp_solves : int            LCPs that were solved
    newton_iterations : int     of the steps with compliant laws
    evaluations : int           right sides, of methods that count them
    seconds : float             time that the run took, with its first compilation if it was the first
    failure : str               why there is no result, "" where there is one; then the errors are NaN
    """

    method: str
    law: str
    k: float
    dt: float
    sup_q: float = math.nan
    l1_v: float = math.nan
    closings: int = 0
    penetration: float = math.nan
    lcp_solves: int = 0
    newton_iterations: int = 0
    evaluations: int = 0
    seconds: float = math.nan
    failure: str = ""


def compare(
    problem: Problem,
    methods: Sequence[str | Integrator],
    dts: Sequence[float],
    penalties: Sequence[Penalty] = (),
    t_end: float | None = None,
) -> list[Row]:
    """Run a problem with rigid bumpers and with compliant ones, and compare all runs with the exact rigid motion.

    What separates a compliant run from the rigid motion is the error of the method and that of the model together: with
    smaller steps the first goes, and what is left is of the order k^(-1/2).

    Parameters
    ----------
    problem : Problem
        A scheme with bumpers that the method ``exact`` handles.
    methods : sequence of str or Integrator
        Names or objects; each runs every variant.
    dts : sequence of float
        Steps in s, each shortened so that a whole number of them makes t_end.
    penalties : sequence of tuples
        ``(law, k)`` or ``(law, k, {"v0": ...})`` for each compliant variant, as of `penalized`.
    t_end : float, optional
        End in s; by default that of the problem.

    Returns
    -------
    list of Row
        By variant, the rigid one first, then by method and step. A run that fails, or a method that refuses, is a row with
        the reason.

    Raises
    ------
    LcpImpactError
        If ``exact`` cannot run the rigid problem, so that there is nothing to compare with.

    Examples
    --------
    >>> from lcpimpact import load_problem
    >>> rows = compare(load_problem("bouncing-ball"), ["moreau-jean"], [1e-3], [("kelvin-voigt", 1e6)], t_end=1.0)
    >>> [(row.law, row.closings, f"{row.penetration:.0e}") for row in rows]
    [('rigid', 1, '3e-03'), ('kelvin-voigt', 1, '4e-03')]
    """
    end = problem.t_end if t_end is None else t_end
    truth = simulate(problem, "exact", dt=end / 100, t_end=end, progress=False)
    variants: list[tuple[str, float, Problem | str]] = [("rigid", math.inf, problem)]
    for law, k, *more in penalties:
        try:
            variants.append((law, k, penalized(problem, law, k=k, **dict(*more))))
        except LcpImpactError as error:
            variants.append((law, k, str(error)))
    rows = []
    for law, k, variant in variants:
        for method in methods:
            for dt in dts:
                steps = max(1, math.ceil(end / dt * (1.0 - 1e-12)))
                row = Row(method if isinstance(method, str) else method.name, law, k, end / steps)
                if isinstance(variant, str):
                    rows.append(replace(row, failure=variant))
                    continue
                try:
                    run = simulate(variant, method, dt=end / steps, t_end=end, progress=False)
                except LcpImpactError as error:
                    rows.append(replace(row, failure=str(error)))
                else:
                    rows.append(_filled(row, run, truth))
    return rows


def _filled(row: Row, run: Trajectory, truth: Trajectory) -> Row:
    """Return the row of a run with what the run showed."""
    rigid, q = truth.problem.dynamics, run.q
    if run.dense is not None:
        # A contact may be shorter than the spacing of the output, but not than that of the segments it is made of.
        cuts = np.unique(np.concatenate([run.t, run.dense.cuts]))
        within = cuts[:-1, None] + np.diff(cuts)[:, None] * np.linspace(0.0, 1.0, WITHIN, endpoint=False)
        q = run.sample(np.append(within.ravel(), cuts[-1])).q
    u = rigid.gap(q)[:, ~rigid.slides]
    if run.problem is truth.problem:
        closings = sum(event.kind in ("close", "impact") for event in run.events)
    else:
        closings = int(((u[:-1] >= 0.0) & (u[1:] < 0.0)).sum())
    return replace(
        row,
        sup_q=sup_q(run, truth),
        l1_v=l1_v(run, truth),
        closings=closings,
        penetration=float(max(0.0, -np.min(u, initial=0.0))),
        lcp_solves=int(run.stats.get("lcp_solves", 0)) if run.problem.dynamics.contacts else 0,
        newton_iterations=int(run.stats.get("newton_iterations", 0)),
        evaluations=int(run.stats.get("evaluations", 0)),
        seconds=float(run.stats["seconds"]),
    )
