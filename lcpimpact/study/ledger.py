r"""The energy ledger: where the energy of a run is, where it came from, and which element took it.

.. math::

    T + V - f_0·(q - q(0)) = T_0 + V_0 + \int (f - f_0)·v\,dt + W_{motions} - \sum_e \int P_e\,dt - \sum \text{impacts}

with T the kinetic energy, V that of the springs, f_0 the constant loads and P_e >= 0 the power that one dashpot, slider or
non-linear spring with a loss turns into heat. What the two sides differ by is the balance of the ledger.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.certificate import Pieces
from lcpimpact.errors import UnsupportedError
from lcpimpact.events import step_of
from lcpimpact.problems.base import Problem
from lcpimpact.record import ContinuousSolution
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.elements.base import GROUND, Element
from lcpimpact.scheme.power_law import mean_forces
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.scheme.terms import Terms
from lcpimpact.study.result import Study, table_lines
from lcpimpact.trajectory import Trajectory

STORED = ("kinetic", "elastic", "gravity")
GIVEN = ("loads", "motions")


@dataclass(frozen=True, eq=False, repr=False)
class Ledger(Study):
    """The energies of a run over time.

    Attributes
    ----------
    table : DataFrame
        One row an instant; an impact has two, before and after. Columns, all in J but the first: ``t`` (s); what is stored,
        ``kinetic``, ``elastic`` (linear and non-linear springs) and ``gravity`` (potential -f·(q - q(0)) of the constant
        loads); what came in since t = 0, ``loads`` (work of the loads that depend on time) and ``motions`` (work of the
        forces that drive nodes whose motion is given); what has been dissipated since t = 0, one column an element, see
        ``dissipated``; and ``balance``, what is stored and dissipated less what came in and was there at t = 0.
    dissipated : tuple of str
        The columns of what is lost: "dashpot a to b" for each dashpot, also within other elements, "HuntCrossley a to b" or
        another type for each non-linear spring with a loss, "slider F", and "impact R" for each contact of relative degree
        2. "contact R" is a contact without impacts: zero in the exact motion, and else what a step loses in which
        the contact switches. Where a name would stand twice, a number follows.
    promise : str
        What the method promises about energy.
    closes : bool
        Whether it promises a balance that is zero but for rounding, or for the tolerance that it is given.
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
        """Return what the method promises, and the largest |balance|."""
        return [self.promise, f"The largest |balance| is {self.balance:.1e} J"]

    def summary(self) -> str:
        """Return what the method promises, the balance, and the totals."""
        return "\n".join([*self.head(), *table_lines(self.totals, ".5g")])

    @property
    def balance(self) -> float:
        """The largest |balance| in J."""
        return float(self.table["balance"].abs().max())

    @property
    def scale(self) -> float:
        """What the balance is to be compared with in J: the largest sum of energies that the run had to do with."""
        stored = self.table[list(STORED[:2])].abs().sum(axis=1) + self.table["gravity"].abs()
        return float((stored + self.table[[*GIVEN, *self.dissipated]].abs().sum(axis=1)).max())

    @property
    def totals(self) -> pd.DataFrame:
        """What each column came to at the end: ``item``, ``start`` and ``end`` in J, ``change`` in J."""
        first, last = self.table.iloc[0], self.table.iloc[-1]
        items = [*STORED, *GIVEN, *self.dissipated, "balance"]
        start, end = (np.array([float(row[item]) for item in items]) for row in (first, last))
        return pd.DataFrame({"item": items, "start": start, "end": end, "change": end - start})


@checked
def energy_ledger(run: Trajectory) -> Ledger:
    r"""Account for the energy of a run, element by element.

    Between impacts the power of each element is integrated: by Gauss's rule where the method knows its motion at all times
    (``exact``, ``radau-fesd``, ``event-driven``); for a θ-method as h w·(forces at θ) with w = (q⁺ - q)/h, which for θ = 1/2
    and linear springs is an identity of the step; for others by the trapezoidal rule, whose error then is part of the
    balance. In an impact a contact takes

    .. math:: -Λ \tfrac12 (U^- + U^+),

    Λ its impulse and U the rate at which it opens, before and after; summed over the contacts this is the loss of kinetic
    energy, less what given motions put in.

    Parameters
    ----------
    run : Trajectory
        Any run of a scheme; one that ended early is accounted for as far as it came.

    Returns
    -------
    Ledger
        The table over time, and its balance.

    Raises
    ------
    UnsupportedError
        For a system that is given directly, whose matrices say nothing of an energy.

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
    d = run.problem.dynamics
    if not d.stores_energy:
        raise UnsupportedError(
            f"{run.problem.name!r} is a system given by its matrices, which do not say what its energy is: "
            "an energy ledger needs a Scheme"
        )
    takers = tuple(takers_of(run.problem))
    θ = run.integrator.balance_point() if run.integrator is not None else None
    if run.dense is not None:
        t, q, v, flows = _by_gauss(run, run.dense, takers)
    elif θ is not None:
        t, q, v, flows = _by_steps(run, θ, takers)
    else:
        t, q, v, flows = _by_trapezoid(run, takers)
    f0 = _constant(d)
    stored = [d.kinetic_energy(v), d.elastic_energy(q), -(q - q[0]) @ f0]
    came, lost = flows[:, : len(GIVEN)], flows[:, len(GIVEN) :]
    balance = np.sum(stored, axis=0)
    balance = balance - balance[0] - came.sum(axis=1) + lost.sum(axis=1)
    names = [taker.name for taker in takers]
    columns = dict(zip((*STORED, *GIVEN, *names), [*stored, *flows.T], strict=True))
    table = pd.DataFrame({"t": t, **columns, "balance": balance})
    promise, closes = _promise(run, θ)
    return Ledger(table, tuple(names), promise, closes, run.problem, run.method)


@dataclass(frozen=True, eq=False)
class Taker:
    """One that dissipates: its name, and its power P(q, v, r) >= 0 in W for arrays (nt, ...).

    Attributes
    ----------
    name : str
    power : callable
        Takes q, v and r. For a non-linear spring r is not used.
    contact, spring : int or None
        Which row of H, or which non-linear spring it is; None for a dashpot.
    """

    name: str
    power: Callable[[Array, Array, Array], Array]
    contact: int | None = None
    spring: int | None = None


def takers_of(problem: Problem) -> Iterator[Taker]:
    """Yield what dissipates in a scheme: dashpots, non-linear springs with a loss, sliders and contacts."""
    d, taken = problem.dynamics, Counter[str]()

    def unique(name: str) -> str:
        taken[name] += 1
        return name if taken[name] == 1 else f"{name} {taken[name]}"

    index = {node: i for i, node in enumerate(d.nodes)}
    elements = problem.scheme.elements if isinstance(problem.scheme, Scheme) else ()
    for piece in (piece for element in elements for piece in _pieces(element)):
        own = [node for node in piece.nodes if node != GROUND]
        terms = Terms(own)
        piece.contribute(terms)
        if terms.C.value.any():
            rows = [index[node] for node in own]
            yield Taker(unique(f"dashpot {' to '.join(piece.nodes)}"), _viscous(terms.C.value, rows))
    for a, spring in enumerate(d.springs):
        if spring.b > 0.0 or spring.c > 0.0:
            kind = spring.element.split()[0]
            yield Taker(unique(f"{kind} {spring.upper} to {spring.lower}"), _hysteretic(d, a), spring=a)
    for i, contact in enumerate(d.contacts):
        kind = "slider" if contact.r0 is not None else "impact" if contact.relative_degree == 2 else "contact"
        yield Taker(unique(f"{kind} {contact.name}"), _frictional(d, i), contact=i)


def _pieces(element: Element) -> Iterator[Element]:
    """Yield the elementary pieces of an element, however deep they lie."""
    parts = element.parts()
    if len(parts) == 1 and parts[0] is element:
        yield element
    else:
        for part in parts:
            yield from _pieces(part)


def _viscous(C: Array, rows: Sequence[int]) -> Callable[[Array, Array, Array], Array]:
    def power(q: Array, v: Array, r: Array) -> Array:
        return np.asarray(((v[:, rows] @ C) * v[:, rows]).sum(axis=1))

    return power


def _hysteretic(d: Dynamics, a: int) -> Callable[[Array, Array, Array], Array]:
    def power(q: Array, v: Array, r: Array) -> Array:
        return d.spring_losses(q, v)[:, a]

    return power


def _frictional(d: Dynamics, i: int) -> Callable[[Array, Array, Array], Array]:
    def power(q: Array, v: Array, r: Array) -> Array:
        return np.asarray(-r[:, i] * d.gap_rate(v)[:, i])

    return power


def _constant(d: Dynamics) -> Array:
    """Return the loads that do not depend on time (n,)."""
    f0 = np.zeros(len(d.nodes))
    for i, load in d.loads:
        if not callable(load):
            f0[i] += load
    return f0


def _flows(d: Dynamics, takers: Sequence[Taker], t: Array, q: Array, v: Array, r: Array) -> Array:
    """Return the powers in W of time-dependent loads, of given motions, and of all that dissipates (nt, 2 + takers)."""
    loads = ((d.force(t) - _constant(d)) * v).sum(axis=1)
    return np.column_stack([loads, d.driving_power(t, q, v, r), *(taker.power(q, v, r) for taker in takers)])


def _jumps(run: Trajectory, takers: Sequence[Taker], spread: int = 0) -> Iterator[tuple[float, int, Array]]:
    """Yield time, first step and flows (steps, 2 + takers) in J of each impact.

    With ``spread`` the velocities are those of the grid before and after each of the steps over which the impulse spreads,
    and each step has the share of the impulse that it has in the change of U.
    """
    d = run.problem.dynamics
    column = {taker.contact: k for k, taker in enumerate(takers) if taker.contact is not None}
    row = {contact.name: i for i, contact in enumerate(d.contacts)}
    for event in run.events:
        if not event.impulse > 0.0:
            continue
        i, node = row[event.contact], -1
        v = np.array([event.left.v, event.right.v])
        if spread:
            node = step_of(event, run.t, run.q, run.v)
            v = run.v[node : node + spread + 1]
        U = d.gap_rate(v)[:, i]
        mean = 0.5 * (v[1:] + v[:-1])
        share = np.diff(U) / (U[-1] - U[0]) if len(U) > 2 and U[-1] != U[0] else np.full(len(mean), 1.0 / len(mean))
        flows = np.zeros((len(mean), len(GIVEN) + len(takers)))
        flows[:, 1] = -event.impulse * share * (d.H[i] * mean)[:, d.driven].sum(axis=1)
        flows[:, len(GIVEN) + column[i]] = -event.impulse * share * d.gap_rate(mean)[:, i]
        yield event.t, node, flows


def _by_gauss(run: Trajectory, dense: ContinuousSolution, takers: Sequence[Taker]) -> tuple[Array, Array, Array, Array]:
    """Return t, q, v and what has flown since the start, with two rows for an impact."""
    d = run.problem.dynamics
    inside = dense.cuts[(dense.cuts >= run.t[0]) & (dense.cuts <= run.t[-1])]
    cuts = np.unique(np.concatenate([run.t, inside, [event.t for event in run.events if event.t <= run.t[-1]]]))
    pieces = Pieces(cuts)
    at = pieces.times
    flows = pieces.integral(_flows(d, takers, at, *dense.read(at, "right")))
    jumps = [jump for jump in _jumps(run, takers) if jump[0] <= run.t[-1]]
    double = np.isin(cuts, [t for t, _, _ in jumps])
    rows = np.repeat(np.arange(len(cuts)), 1 + double)
    after = np.append(np.diff(rows) != 0, True)  # the last row of each time holds what its impacts did
    q, v, _ = (each[rows] for each in dense.read(cuts, "right"))
    flows = flows[rows]
    t = cuts[rows]
    for time, _, jump in jumps:
        flows[(t > time) | ((t == time) & after)] += jump[0]
    seen: set[float] = set()
    for event in run.events:
        if event.impulse > 0.0 and event.t not in seen and event.t <= run.t[-1]:
            seen.add(event.t)
            left = np.searchsorted(t, event.t)
            q[left], v[left] = event.left.q, event.left.v
    return t, q, v, flows


def _by_steps(run: Trajectory, θ: float, takers: Sequence[Taker]) -> tuple[Array, Array, Array, Array]:
    """Return t, q, v and what has flown since the start, step by step with the forces at t + θ h."""
    d, h = run.problem.dynamics, np.diff(run.t)
    r = run.reaction.copy()
    row = {contact.name: i for i, contact in enumerate(d.contacts)}
    for event in run.events:
        if event.impulse > 0.0:
            k = step_of(event, run.t, run.q, run.v)
            r[k, row[event.contact]] += event.impulse / h[k]
    w = np.diff(run.q, axis=0) / h[:, None]
    q = (1.0 - θ) * run.q[:-1] + θ * run.q[1:]
    f = d.force(run.t) - _constant(d)
    f_θ = (1.0 - θ) * f[:-1] + θ * f[1:]
    s = mean_forces(d.power_laws, d.approach(q), d.approach_rate(w), h)
    losses = d.spring_losses(q, w, s)
    powers = np.empty((len(h), len(GIVEN) + len(takers)))
    powers[:, 0] = (f_θ * w).sum(axis=1)
    driving = q @ d.K.T + w @ d.C.T - r @ d.H - f_θ - _constant(d) - s @ d.directions
    powers[:, 1] = (driving * w)[:, d.driven].sum(axis=1)
    for k, taker in enumerate(takers, len(GIVEN)):
        powers[:, k] = taker.power(q, w, r) if taker.spring is None else losses[:, taker.spring]
    flows = np.concatenate([np.zeros((1, powers.shape[1])), np.cumsum(h[:, None] * powers, axis=0)])
    return run.t, run.q, run.v, flows


def _by_trapezoid(run: Trajectory, takers: Sequence[Taker]) -> tuple[Array, Array, Array, Array]:
    """Return t, q, v and what has flown since the start, with the powers at the grid points.

    Forces that belong to a step meet the mean of the two states at its ends.
    """
    d, h = run.problem.dynamics, np.diff(run.t)[:, None]
    nothing = np.zeros((len(run.t), len(d.contacts)))
    if len(run.reaction) == len(run.t):
        powers = _flows(d, takers, run.t, run.q, run.v, run.reaction)
        steps = 0.5 * h * (powers[1:] + powers[:-1])
    else:
        powers = _flows(d, takers, run.t, run.q, run.v, nothing)
        steps = 0.5 * h * (powers[1:] + powers[:-1])
        t, q, v = (0.5 * (each[1:] + each[:-1]) for each in (run.t, run.q, run.v))
        of_forces = _flows(d, takers, t, q, v, run.reaction)
        driven_by_forces = of_forces[:, 1] - _flows(d, takers, t, q, v, nothing[1:])[:, 1]
        steps[:, 1] += h[:, 0] * driven_by_forces
        contacts = [k for k, taker in enumerate(takers, len(GIVEN)) if taker.contact is not None]
        steps[:, contacts] = h * of_forces[:, contacts]
    spread = run.integrator.impact_steps if run.integrator is not None else 1
    for _, node, jump in _jumps(run, takers, spread):
        steps[node : node + len(jump)] += jump
    return run.t, run.q, run.v, np.concatenate([np.zeros((1, powers.shape[1])), np.cumsum(steps, axis=0)])


def _promise(run: Trajectory, θ: float | None) -> tuple[str, bool]:
    """Say what the method promises, and whether it is a balance that closes."""
    declared = run.integrator.declared if run.integrator is not None else None
    text = declared.energy if declared is not None else "nothing is declared"
    if θ is not None:
        text = f"θ = {θ:g}: {text}"
    d = run.problem.dynamics
    # A force that only springs carry is balanced at the end of a step, not within it.
    within = not d.springs and not (d.relative_degree == 0).any()
    exact = run.dense is not None and declared is not None and np.isinf(declared.order_smooth)
    return text, bool(exact or (θ == 0.5 and within))
