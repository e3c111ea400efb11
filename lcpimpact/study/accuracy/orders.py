"""The order of one method on one problem, run with several step counts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from lcpimpact.arguments import checked
from lcpimpact.errors import InputError
from lcpimpact.integrators.base import Integrator, Option
from lcpimpact.problems.base import Problem
from lcpimpact.simulation import check_lcp_solver, make_integrator
from lcpimpact.study.accuracy.convergence import convergence
from lcpimpact.study.accuracy.fitted_order import Order, fit
from lcpimpact.study.accuracy.limits import floor_of
from lcpimpact.study.accuracy.reference import Reference
from lcpimpact.trajectory import Trajectory

COUNTS = (307, 487, 773, 1229, 1951, 3089)
"""Default numbers of steps: primes with ratios of about 1.6."""

COARSER_COUNTS = (
    (127, 181, 257, 367, 521, 743),
    (29, 43, 61, 89, 127, 181),
    (17, 23, 31, 41, 53, 71),
    (5, 7, 11, 13, 17, 23),
)
"""Default numbers of steps of high-order methods, whose errors soon reach rounding level."""


class RoundingError(InputError):
    """The errors of a method are at rounding level, so that no order is observable."""


@checked
def observed_order(
    problem: Problem,
    method: str | Integrator,
    counts: Sequence[int] = COUNTS,
    t_end: float | None = None,
    norm: str = "sup_q",
    reference: Trajectory | Reference | Literal["auto"] = "auto",
    lcp_solver: str = "auto",
    **method_options: Option,
) -> Order:
    """Run a method with several step counts, and fit the order of its errors.

    Parameters
    ----------
    problem : Problem
        Any problem with a reference.
    method : str or Integrator
        Name or object.
    counts : sequence of int
        Step counts; each is increased to a prime for which no event falls on the grid.
    t_end : float, optional
        End in s; by default that of the problem.
    norm : str
        A name of `lcpimpact.study.accuracy.norms.NORMS`.
    reference : Trajectory, Reference or "auto"
        The reference, as in `lcpimpact.convergence`.
    lcp_solver : str
        A name of ``lcpimpact list solvers``, for the LCPs of the method.
    **method_options
        Options of the method.

    Raises
    ------
    InputError
        For an unknown norm, fewer than two counts, a failed run, or errors at rounding level.

    Examples
    --------
    >>> from lcpimpact import load_problem
    >>> order = observed_order(load_problem("system-3"), "moreau-jean", counts=(101, 211, 401))
    >>> 1.8 < order.slope < 2.2
    True
    """
    if len(counts) < 2:
        raise InputError(f"counts = {counts!r} must hold at least two step counts, better six that are primes")
    end = problem.t_end if t_end is None else t_end
    integrator = make_integrator(method, method_options, ("t_end", "lcp_solver"))
    check_lcp_solver(integrator, lcp_solver)
    study = convergence(
        problem,
        [integrator],
        [end / steps for steps in counts],
        t_end=end,
        norms=[norm],
        reference=reference,
        lcp_solver=lcp_solver,
        progress=False,
    )
    table = study.table
    for failure in study.failures["failure"]:
        raise InputError(f"{integrator.name} on {problem.name!r}: {failure}")
    if table[norm].min() <= floor_of(table["reference"].iloc[0], norm) * study.scales[norm]:
        raise RoundingError(
            f"the errors of {integrator.name} on {problem.name!r} are rounding: take larger steps to see an order"
        )
    return fit(list(table["dt"]), list(table[norm]))
