"""The energy ledger: stored energy, work done on the system, and dissipation by element.

The energy account is computed by `lcpimpact.certificate.energy`; the certificate checks its sum.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from lcpimpact.arguments import checked
from lcpimpact.certificate.energy import INFLOWS, STORED, Account, Sinks
from lcpimpact.errors import UnsupportedError
from lcpimpact.problems.base import Problem
from lcpimpact.quantities import energy_flows
from lcpimpact.study.result import Study, table_lines
from lcpimpact.trajectory import Trajectory


@dataclass(frozen=True, eq=False, repr=False)
class Ledger(Study):
    """The energies of a run over time.

    Attributes
    ----------
    table : DataFrame
        One row per instant, two for an impact (before and after). Columns in J except ``t`` (s): the stored energies
        ``kinetic``, ``elastic`` (linear and non-linear springs) and ``gravity`` (potential -f·(q - q(0)) of the constant
        loads); the work done since t = 0, ``loads`` (of time-dependent loads) and ``motions`` (of the forces on nodes with
        prescribed motion); the energy dissipated since t = 0, one column per element, see ``dissipated``; and ``balance``,
        stored plus dissipated energy minus work and initial energy.
    dissipated : tuple of str
        The dissipation columns: "dashpot a to b" for each dashpot, also within other elements, "HuntCrossley a to b" or
        another type for each dissipative non-linear spring, "slider F", and "impact R" for each contact of relative degree
        2. "contact R" is a contact without impacts: zero in the exact motion, else the loss of steps in which the contact
        switches. Duplicate names are numbered.
    promise : str
        The energy property declared by the method.
    closes : bool
        Whether the method declares a balance that vanishes to rounding, or to its tolerance.
    problem : Problem
    method : str
        The method with its options.
    """

    table: pd.DataFrame
    dissipated: tuple[str, ...]
    promise: str
    closes: bool
    problem: Problem
    method: str

    drawn_by = "lcpimpact.plotting.comparison:plot_ledger"
    title = "{0.problem.name} by {0.method}: energy"

    def head(self) -> list[str]:
        """Return the declared energy property, and the largest |balance|."""
        return [self.promise, f"The largest |balance| is {self.balance:.1e} J"]

    def summary(self) -> str:
        """Return the declared energy property, the balance, and the totals."""
        return "\n".join([*self.head(), *table_lines(self.totals, ".5g")])

    @property
    def balance(self) -> float:
        """The largest |balance| in J."""
        return float(self.table["balance"].abs().max())

    @property
    def scale(self) -> float:
        """Scale of the balance in J: the largest sum of energies in the run."""
        stored = self.table[list(STORED[:2])].abs().sum(axis=1) + self.table["gravity"].abs()
        return float((stored + self.table[[*INFLOWS, *self.dissipated]].abs().sum(axis=1)).max())

    @property
    def totals(self) -> pd.DataFrame:
        """Initial and final value of each column: ``item``, ``start``, ``end`` and ``change`` in J."""
        first, last = self.table.iloc[0], self.table.iloc[-1]
        items = [*STORED, *INFLOWS, *self.dissipated, "balance"]
        start, end = (np.array([float(row[item]) for item in items]) for row in (first, last))
        return pd.DataFrame({"item": items, "start": start, "end": end, "change": end - start})


@checked
def energy_ledger(run: Trajectory) -> Ledger:
    r"""Account for the energy of a run, element by element.

    Between impacts the power of each element is integrated: by Gauss's rule for continuous solutions (``exact``,
    ``radau-fesd``, ``event-driven``); for a θ-method as h w·(forces at θ) with w = (q⁺ - q)/h, an identity of the step for
    θ = 1/2 and linear springs; otherwise by the trapezoidal rule, whose error is part of the balance. In an impact a
    contact dissipates

    .. math:: -Λ \tfrac12 (U^- + U^+),

    with the impulse Λ and the gap velocities U before and after; the sum over the contacts is the loss of kinetic energy,
    minus the work of prescribed motions.

    Parameters
    ----------
    run : Trajectory
        Any run of a scheme; one that ended early is evaluated up to its end.

    Returns
    -------
    Ledger
        The table over time, and its balance.

    Raises
    ------
    UnsupportedError
        For a system given directly, whose matrices define no energy.

    Examples
    --------
    A ball keeps e² of its energy in an impact:

    >>> from lcpimpact import load_problem, simulate
    >>> ledger = energy_ledger(simulate(load_problem("bouncing-ball", e=0.5), "exact", dt=0.1, t_end=0.9))
    >>> end = ledger.table.iloc[-1]
    >>> bool(abs(end["impact R"] - (1 - 0.5**2) * ledger.table["kinetic"].max()) < 1e-12)
    True
    >>> ledger.balance < 1e-12
    True

    References
    ----------
    Acary and Brogliato, *Numerical Methods for Nonsmooth Dynamical Systems* (2008), section 10.1.
    """
    d = run.dynamics
    if not d.stores_energy:
        raise UnsupportedError(
            f"{run.problem.name!r} is a system given by its matrices, which do not say what its energy is: "
            "an energy ledger needs a Scheme"
        )
    account = Account(d, Sinks.by_element(run.problem))
    θ = run.integrator.balance_point() if run.integrator is not None else None
    t, q, v, flows = energy_flows(run, account)
    stored = account.stored(q, v, q[0])
    columns = dict(zip((*STORED, *INFLOWS, *account.sinks.names), [*stored.T, *flows.T], strict=True))
    table = pd.DataFrame({"t": t, **columns, "balance": account.imbalance(stored, stored[0], account.balance(flows))})
    promise, closes = _promise(run, θ)
    return Ledger(table, account.sinks.names, promise, closes, run.problem, run.method)


def _promise(run: Trajectory, θ: float | None) -> tuple[str, bool]:
    """Return the declared energy property of the method, and whether it is a balance that closes."""
    declared = run.integrator.declared if run.integrator is not None else None
    text = declared.energy if declared is not None else "nothing is declared"
    if θ is not None:
        text = f"θ = {θ:g}: {text}"
    d = run.problem.dynamics
    # A force that only springs carry is balanced at the end of a step, not within it.
    within = not d.springs and not (d.relative_degree == 0).any()
    exact = run.dense is not None and declared is not None and np.isinf(declared.order_smooth)
    return text, bool(exact or (θ == 0.5 and within))
