r"""Quantities of a run by name: peaks, instants, speeds, contact time, restitution, impulse and energy.

A name is one of

- ``NAME``, the whole series of a coordinate, velocity (``v_NODE``) or force; ``NAME.max`` and ``NAME.min``, its greatest and
  least value; ``NAME@t``, its value at an instant in s (right limit);
- ``KIND:n``, the instant in s of the n-th event of a kind (close, open, impact, stick, slip, slide, switch, jam, jump), with
  ``KIND:n.speed`` in m/s and ``KIND:n.impulse`` in N s; ``CONTACT.KIND:n`` counts the events of one contact only;
- a key of `SUMMARY`, as ``peak_force``.

A quantity that a run does not have, as the tenth impact of a ball that hits three times, is NaN. With a continuous solution
(``exact``, ``event-driven``, ``radau-fesd``) peaks are searched between the grid points too; otherwise they are the greatest
recorded values, of forces those of steps that hold no impulses of accumulating impacts.

The bodies of a contact are the nodes with mass or prescribed motion, and the ground. Their gap is u = H q + u0 with each
massless node where the elements that carry it put it without force; U is its rate. So U is the rate of the contact itself
where both sides have mass, and otherwise that of the bodies behind the plates.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from lcpimpact.arrays import Array, Flags
from lcpimpact.certificate.energy import INFLOWS, Account, account_of
from lcpimpact.certificate.impacts import RunImpacts
from lcpimpact.certificate.quadrature import Pieces
from lcpimpact.errors import InputError
from lcpimpact.events import steps_of
from lcpimpact.finished import FinishedRun
from lcpimpact.formula import Number
from lcpimpact.integrators.stepping.strong_dashpots import damped_rows, may_stop
from lcpimpact.numerics.double_double import DoubleDouble, stacked
from lcpimpact.problems.base import Problem
from lcpimpact.reading import at, highest
from lcpimpact.record import ContinuousSolution, Event, Record
from lcpimpact.registry import html_of, nearest
from lcpimpact.scheme.decomposition import least_squares
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.lagrangian import LagrangianDynamics

KINDS = ("close", "open", "impact", "stick", "slip", "slide", "switch", "jam", "jump")
"""Kinds of events."""

AFTER = ("open", "slip", "slide", "switch")
"""Kinds of events whose speed is the right limit: the contact moves after them; others have the left limit."""

EVENT_NAME = re.compile(
    rf"(?:(?P<contact>.+)\.)?(?P<kind>{'|'.join(KINDS)}):(?P<number>\d+)(?:\.(?P<what>speed|impulse))?"
)

TAKEN = 0.1
"""Part c h/m of an approach up to which mean forces show the force with which a contact on a dashpot closes."""

AT_REST_RTOL = 1e-9
"""Approach or rebound speed, relative to the fastest coordinate of the run, below which it is rounding."""


@dataclass(frozen=True)
class Quantity:
    """A quantity of a run.

    Attributes
    ----------
    name : str              as asked
    unit : str              "" for a pure number, and where a system gives no units
    measure : callable      takes a Trajectory, and returns the number, or the series (nt,) or (nr,)
    series : str            the dimension of a series, "t" of coordinates and "t_R" of forces; "" of a number
    until : float           the instant in s that the run must reach
    """

    name: str
    unit: str
    measure: Callable[[FinishedRun], float | Array]
    series: str = ""
    until: float = 0.0


def series_names(d: Dynamics) -> tuple[str, ...]:
    """Return the names of the series of a run: coordinates, velocities (v_NAME), and forces of contacts and springs."""
    return (*d.nodes, *(f"v_{node}" for node in d.nodes), *(each.name for each in d.forces))


def quantity(name: str, problem: Problem) -> Quantity:
    """Return the quantity of a name.

    Parameters
    ----------
    name : str
        As in `lcpimpact.quantities`.
    problem : Problem
        The problem of the runs, with the names and units of its coordinates and forces.

    Raises
    ------
    InputError
        For a name that means nothing for the system; the nearest is offered.

    Examples
    --------
    >>> from lcpimpact import load_problem, simulate
    >>> problem = load_problem("bouncing-ball", e=0.5)
    >>> run = simulate(problem, "exact", dt=0.1, t_end=1.0)
    >>> [round(quantity(name, problem).measure(run), 6) for name in ("impact:2", "impact:2.speed", "x.max")]
    [0.903047, 2.214723, 1.0]
    >>> quantity("x.mx", problem)
    Traceback (most recent call last):
        ...
    lcpimpact.errors.InputError: unknown output 'x.mx': did you mean 'x.max'? known are ...
    """
    d = problem.dynamics
    known = series_names(d)
    if name in known:
        return Quantity(name, problem.unit(name), partial(_series, series=name), _dimension(d, name))
    if name in SUMMARY:
        return Quantity(name, problem.own_unit(SUMMARY[name][0]), SUMMARY[name][1])
    if event := EVENT_NAME.fullmatch(name):
        return _event_quantity(name, event, problem)
    series, dot, end = name.rpartition(".")
    if dot and series in known and end in ("max", "min"):
        return Quantity(name, problem.unit(series), partial(extreme, series=series, sign=1.0 if end == "max" else -1.0))
    series, sign, end = name.rpartition("@")
    if sign and series in known:
        t = _instant(name, end)
        return Quantity(name, problem.unit(series), partial(at, series=series, t=t), until=t)
    outputs = [*(f"{each}{of}" for of in ("", ".max", ".min", "@1.0") for each in known), *SUMMARY]
    raise InputError(nearest(name, [*outputs, *(f"{kind}:1" for kind in KINDS)], "output"))


def _event_quantity(name: str, event: re.Match[str], problem: Problem) -> Quantity:
    contacts = [each.name for each in problem.dynamics.forces]
    contact = event["contact"]
    kind = event["kind"]
    number = event["number"]
    what = event["what"]
    if contact is not None and contact not in contacts:
        raise InputError(f"{name}: {nearest(contact, contacts, 'contact')}")
    if int(number) < 1:
        raise InputError(f"{name}: events are counted from 1, as in {kind}:1")
    unit = problem.own_unit({"speed": "m/s", "impulse": "N s"}.get(what, "s"))
    return Quantity(name, unit, partial(_of_event, kind=kind, number=int(number), contact=contact, what=what))


def _instant(name: str, text: str) -> float:
    try:
        t = float(text)
    except ValueError:
        t = math.nan
    if not 0.0 <= t < math.inf:
        raise InputError(f"{name}: after @ there must be an instant in s, as in x@0.5")
    return t


def _dimension(d: Dynamics, series: str) -> str:
    return "t" if series_names(d).index(series) < 2 * len(d.nodes) else "t_R"


def _series(run: FinishedRun, series: str) -> Array:
    return run[series]


def extreme(run: FinishedRun, series: str, sign: float = 1.0) -> float:
    """Return max y(t) of a series, or min y(t) with ``sign=-1``; of a continuous solution it is the supremum."""
    if run.dense is not None:
        return highest(run, series, sign)[1]
    first = 2 * run.q.shape[1]
    values = forces_without_impulses(run)[:, i - first] if (i := run.names.index(series)) >= first else run[series]
    return sign * float((sign * values).max()) if len(values) else math.nan


def _of_event(run: FinishedRun, kind: str, number: int, contact: str | None, what: str | None) -> float:
    """Return the instant, speed or impulse of an event; NaN if the run has fewer."""
    found = [each for each in run.events if each.kind == kind and contact in (None, each.contact)]
    if len(found) < number:
        return math.nan
    event: Event = found[number - 1]
    if what is None:
        return event.t
    if what == "impulse":
        return event.impulse
    d = run.problem.dynamics
    at = event.right if kind in AFTER else event.left
    rates = np.append(d.gap_rate(event.t, at.q, at.v), d.approach_rate(at.v))
    return abs(float(rates[[each.name for each in d.forces].index(event.contact)]))


# ---- contacts -------------------------------------------------------------------------------------------------------


def pushing_columns(run: FinishedRun) -> Array:
    """Return the columns of the forces that only push: of unilateral contacts and of non-linear springs."""
    d = run.problem.dynamics
    return np.append(np.flatnonzero(d.impenetrable), len(d.contacts) + np.arange(len(d.springs)))


def peak_force(run: FinishedRun) -> float:
    """Return the greatest force of a unilateral contact or non-linear spring, max R(t), in N; impulses are no forces.

    Nor are those of the last of accumulating impacts, which steps hold in their forces without an event each. Where a
    dashpot takes more than a tenth of an approach within a step, the force with which the contact closes counts, c v, which
    the mean forces of steps do not reach.
    """
    return _strongest(run)[1]


def peak_time(run: FinishedRun) -> float:
    """Return the first instant in s at which the force is the `peak_force`; of a step, the instant of its force.

    It is NaN where there is no force.
    """
    t, force = _strongest(run)
    return t if force > 0.0 else math.nan


def _strongest(run: FinishedRun) -> tuple[float, float]:
    columns = pushing_columns(run)
    if not len(columns) or not len(run.t_reaction):
        return math.nan, math.nan
    if run.dense is not None:
        push = run.problem.dynamics.push
        return highest(run, lambda state: np.hstack([state.reaction, push(state.q, state.v)])[:, columns].max(axis=1))
    force = forces_without_impulses(run)[:, columns]
    closings = _closings(run)
    if not _has_means(run):
        # The force at the end of a step in which a contact closes overshoots.
        for t, row, _ in closings:
            force[np.searchsorted(run.t_reaction, t), list(columns).index(row)] = 0.0
    force = force.max(axis=1)
    j = int(np.argmax(force))
    found = [(t, each) for t, _, each in closings] + [(float(run.t_reaction[j]), float(force[j]))]
    return max(found, key=lambda each: each[1])


def hides_closing(d: Dynamics, h: Number) -> bool:
    """Return whether a dashpot takes so much of an approach within a step h that mean forces hide the closing force."""
    return may_stop(d, h / TAKEN, 0.0)


def _has_means(run: FinishedRun) -> bool:
    """Return whether the forces of a run are means of its steps."""
    return run.integrator is None or bool(run.integrator.reaction_is_mean)


def _closings(run: FinishedRun) -> list[tuple[float, int, float]]:
    """Return the instants, rows and forces at which contacts on dashpots close, where the forces of steps do not show these.

    A body that closes such a contact approaches its plate, which moves freely until then, with -U, and is pushed by -U/Y.
    """
    d, steps = run.problem.dynamics, len(run.t) - 1
    if (
        steps < 1
        or len(run.reaction) != steps
        or (_has_means(run) and not hides_closing(d, float(np.diff(run.t).max())))
    ):
        return []
    rows, _, Y, _ = damped_rows(d)
    h = np.diff(run.t)
    u = d.gap(run.t, run.q)[:, rows]
    U = d.gap_rate(run.t, run.q, run.v)[:, rows]
    names = {d.contacts[i].name: k for k, i in enumerate(rows)}
    later = [event for event in run.events if event.kind == "close" and event.contact in names]
    closings = [(0, k) for k in range(len(rows)) if u[0, k] <= 0.0 and run.reaction[0, rows[k]] > 0.0]
    begins = steps_of(later, run.t, run.q, run.v).tolist()
    closings += [(j, names[event.contact]) for j, event in zip(begins, later, strict=True)]
    found = []
    for j, k in closings:
        if not _has_means(run) and j > 0 and u[j - 1, k] > 0.0 and u[j - 1, k] + h[j - 1] * U[j - 1, k] < 0.0:
            j -= 1  # it closed one step earlier, at whose end its force was zero
        if Y[k, k] > 0.0 and U[j, k] < 0.0:
            after = min(max(float(u[j, k] / -U[j, k]), 0.0), float(h[j]))
            found.append((float(run.t[j]) + after, int(rows[k]), float(-U[j, k] / Y[k, k])))
    return found


def forces_without_impulses(run: FinishedRun) -> Array:
    """Return the forces in N (nr, nc + ns), and 0 for those of steps that hold the impulses of accumulating impacts."""
    return np.where(_holds_impulses(run), 0.0, run.forces)


def _holds_impulses(run: FinishedRun, *, impulse_rtol: float = 1e-4) -> Flags:
    """Return which forces of steps (nr, nc + ns) hold impulses too small for an event, as where impacts accumulate.

    A rate U of a contact between masses at either end of the step accounts for a part of the force, U/(h W_ii).

    ``impulse_rtol``: part of the force of a step that may be the impulse of an impact.
    """
    d = run.problem.dynamics
    found = np.zeros(run.forces.shape, dtype=bool)
    rigid = np.flatnonzero(d.rigid)
    if not len(rigid) or len(run.t) < 2:
        return found
    k = np.clip(np.searchsorted(run.t, run.t_reaction) - 1, 0, len(run.t) - 2)
    if isinstance(d, LagrangianDynamics):
        W = np.diagonal(d.compliance(run.t[k], run.q[k]), axis1=1, axis2=2)[:, rigid]
    else:
        free = d.massive & ~d.driven
        H = d.H[np.ix_(rigid, free)]
        W = (H * np.linalg.solve(d.M[np.ix_(free, free)], H.T).T).sum(axis=1)
    U = np.abs(d.gap_rate(run.t, run.q, run.v)[:, rigid])
    if isinstance(d, LagrangianDynamics):
        U[1:] = np.maximum(U[1:] - d.turned(run.t, run.q, run.v)[:, rigid], 0.0)
    with np.errstate(over="ignore"):
        part = np.maximum(U[k], U[k + 1]) / np.diff(run.t)[k, None]
        found[:, rigid] = (W > 0.0) & (part > impulse_rtol * W * run.forces[:, rigid])
    return found


def impacts(run: FinishedRun) -> float:
    """Return the number of impacts that the method resolves: events with an impulse of a unilateral contact.

    Each contact that an impulse goes through counts, closed before or not. Where impacts accumulate there are infinitely
    many: steps resolve flights that are longer than a step, and methods that locate events go on to their rounding.
    """
    d = run.problem.dynamics
    rigid = {d.contacts[i].name for i in np.flatnonzero(d.impenetrable)}
    return float(sum(event.kind == "impact" and event.contact in rigid for event in run.events))


def impulse(run: FinishedRun) -> float:
    """Return ∫ R dt + Σ Λ in N s, the sum over all unilateral contacts, with their impacts, and non-linear springs.

    Where forces are known at the ends of steps alone, it is what the balance of momentum says.
    """
    columns, d = pushing_columns(run), run.problem.dynamics
    if not len(columns):
        return math.nan
    rigid = {d.contacts[i].name for i in np.flatnonzero(d.impenetrable)}
    struck = sum(event.impulse for event in run.events if event.contact in rigid)
    if run.dense is not None:
        pieces = pieces_of(run, run.dense)
        q, v, r = run.dense.read(pieces.times, "right")
        return float(pieces.each(np.hstack([r, d.push(q, v)])[:, columns]).sum() + struck)
    if not _has_means(run) and (impulses := _impulses_by_momentum(run)) is not None:
        return float(impulses[d.impenetrable].sum())
    force, h = run.forces[:, columns].sum(axis=1), np.diff(run.t)
    mean = force if len(force) == len(h) else 0.5 * (force[1:] + force[:-1])
    return float(h @ mean + struck)


def _impulses_by_momentum(run: FinishedRun) -> Array | None:
    """Return ∫ r dt + Σ Λ of each row in N s (nc,), which moved the nodes; None where the motion does not tell them apart.

    Forces at the ends of steps do not show what acts within one.
    """
    d = run.problem.dynamics
    q = run.q
    v = run.v
    h = np.diff(run.t)[:, None]
    B = d.B[~d.driven]
    if (
        not d.stores_energy
        or d.springs
        or d.dashpots
        or d.force_laws
        or d.holds
        or isinstance(d, LagrangianDynamics)
        or len(h) < 1
        or np.linalg.matrix_rank(B) < B.shape[1]
    ):
        return None
    left, right = d.force_limits(run.t) if d.breaking_loads else (d.force(run.t),) * 2
    loads = 0.5 * (h * (right[:-1] + left[1:])).sum(axis=0)
    way = 0.5 * h * (q[1:] + q[:-1]) + np.where(d.massive, h**2 * (v[:-1] - v[1:]) / 12.0, 0.0)
    given = d.M @ (v[-1] - v[0]) + d.C @ (q[-1] - q[0]) + d.K @ way.sum(axis=0) - loads
    return np.asarray(np.linalg.lstsq(B, given[~d.driven], rcond=None)[0])


def contact_time(run: FinishedRun) -> float:
    """Return t⁺ - t⁻ in s, from the first touch with approach, U⁻ < 0, to the separation of that contact.

    Zero for an impact after which the bodies part at once; NaN without touch, or without separation in the run.
    """
    touch = first_touch(run)
    return touch.end - touch.begin


def restitution(run: FinishedRun) -> float:
    """Return -U⁺/U⁻ of the first touch: of its impact, or else over the whole phase of a compliant contact."""
    touch = first_touch(run)
    return -touch.after / touch.before


def rebound_speed(run: FinishedRun) -> float:
    """Return U⁺ in m/s, the speed at which the bodies part after the first touch, as in `restitution`."""
    return first_touch(run).after


def deformation(run: FinishedRun) -> float:
    """Return the greatest approach of the bodies beyond touch, max(-u(t), 0), in m.

    It is that of all compliant contacts and non-linear springs: NaN without one.
    """
    d = run.problem.dynamics
    compliant = np.append(d.impenetrable & (d.relative_degree < 2), np.ones(len(d.springs), dtype=bool))
    if not compliant.any() or not d.stores_energy:
        return math.nan
    rows = gaps_of_bodies(d).hi
    at_rest = np.append(d.u0, d.power_laws[:, 0])[compliant]

    def approach(q: Array) -> Array:
        return np.asarray(-(q @ rows[compliant].T + at_rest).min(axis=1))

    if run.dense is not None:
        return max(highest(run, lambda state: approach(state.q))[1], 0.0)
    return float(approach(run.q).max(initial=0.0))


def gaps_of_bodies(d: Dynamics) -> DoubleDouble:
    """Return the rows (nc + ns, n) of the gaps between the bodies of the contacts and springs: times v they are U."""
    bodies = d.massive | d.driven
    rows = stacked([[d.finely("H")], [d.directions]])
    if bodies.all():
        return rows
    unit, K = np.eye(len(bodies)), d.finely("K")
    moving, plates = unit[bodies], unit[~bodies]
    stiffness = (plates @ K @ plates.T).hi
    # A plate on dashpots alone stays where they were when it was free.
    carry = plates @ (K if np.linalg.matrix_rank(stiffness) == len(stiffness) else K + d.finely("C"))
    return rows @ (moving.T @ moving - plates.T @ least_squares(carry @ plates.T, carry @ moving.T) @ moving)


class ContactPhase(NamedTuple):
    """A phase of a contact: begin and end in s, U⁻ and U⁺ in m/s, NaN where unknown, its column, and the events of both."""

    begin: float
    end: float
    before: float
    after: float
    column: int = -1
    closing: Event | None = None
    opening: Event | None = None


def first_touch(run: FinishedRun) -> ContactPhase:
    """Return the first phase of a contact that begins with an approach."""
    none = ContactPhase(math.nan, math.nan, math.nan, math.nan)
    if not run.problem.dynamics.stores_energy:  # a system of equations has no bodies
        return none
    least = -AT_REST_RTOL * float(np.abs(run.v).max(initial=0.0))
    found = [each for column in pushing_columns(run) for each in _touches(run, int(column)) if each.before < least]
    return min(found, key=lambda each: each.begin, default=none)


def _touches(run: FinishedRun, column: int) -> Iterator[ContactPhase]:
    """Yield the phases of a contact; of an impact, U⁺ is right after it."""
    d = run.problem.dynamics
    name = d.forces[column].name
    rows = None if isinstance(d, LagrangianDynamics) else gaps_of_bodies(d).hi[column]
    own = [event for event in run.events if event.contact == name and event.kind in ("close", "open", "impact")]

    def rate(t: float, q: Array, v: Array) -> float:
        return float(d.gap_rate(t, q, v)[column] if rows is None else rows @ v)

    def rate_at(t: float, side: str) -> float:
        state = run.sample([t], side)
        return rate(t, state.q[0], state.v[0])

    if own and own[0].kind == "open":  # closed at the start
        before = rate(0.0, run.problem.initial_coordinates, run.problem.initial_velocities)
        yield ContactPhase(run.t[0], own[0].t, before, rate_at(own[0].t, "right"), column, None, own[0])
    for event, following in zip(own, [*own, None][1:], strict=True):
        opening = following if following is not None and following.kind == "open" else None
        end = math.nan if opening is None else opening.t
        if event.kind == "close":
            after = math.nan if opening is None else rate_at(end, "right")
            yield ContactPhase(event.t, end, float(rate_at(event.t, "left")), after, column, event, opening)
        elif event.kind == "impact":
            before = rate(event.t, event.left.q, event.left.v)
            after = rate(event.t, event.right.q, _velocity_after(run, event))
            parts = after > AT_REST_RTOL * abs(before)
            yield ContactPhase(
                event.t, event.t if parts else end, before, after, column, event, event if parts else opening
            )


def _velocity_after(run: FinishedRun, event: Event) -> Array:
    """Return v after an impact (n,), at the end of the steps over which the method spreads it."""
    spread = 1 if run.integrator is None else run.integrator.impact_steps
    if spread == 1 or run.dense is not None:
        return event.right.v
    last = steps_of([event], run.t, run.q, run.v)[0] + spread
    return np.asarray(run.v[min(last, len(run.v) - 1)])


# ---- energy ---------------------------------------------------------------------------------------------------------


def dissipated(run: FinishedRun) -> float:
    """Return the energy in J that dashpots, sliders, springs with loss and impacts dissipate in the run, Σ ∫ P dt."""
    d = run.problem.dynamics
    if not d.stores_energy:
        return math.nan
    return float(energy_flows(run, account_of(d))[3][-1, len(INFLOWS) :].sum())


def energy_flows(run: FinishedRun, account: Account) -> tuple[Array, Array, Array, Array]:
    """Return t, q, v and the flows of energy since the start in J, by the rule of the method.

    It is Gauss's rule for a continuous solution, with two rows for an impact: before and after it; the θ-rule for steps
    that balance their forces at a point of their own; otherwise the trapezoidal rule.
    """
    if run.dense is not None:
        return _flows_between_events(run, run.dense, account)
    θ, spread = None, 1
    if run.integrator is not None:
        θ = run.integrator.balance_point()
        spread = run.integrator.impact_steps
    record = Record(run.t, run.q, run.v, run.t_reaction, run.reaction)
    if θ is not None:
        of_steps = account.by_theta_rule(record, run.events, θ)
    else:
        of_steps = account.by_trapezoidal_rule(record, run.events, spread)
    flows = np.concatenate([np.zeros((1, of_steps.shape[1])), np.cumsum(of_steps, axis=0)])
    return run.t, run.q, run.v, flows


def pieces_of(run: FinishedRun, dense: ContinuousSolution) -> Pieces:
    """Return the pieces of a continuous solution between grid points, cuts and events."""
    end = run.t[-1]
    inside = dense.cuts[(dense.cuts >= run.t[0]) & (dense.cuts <= end)]
    return Pieces.between(np.concatenate([run.t, inside, [event.t for event in run.events if event.t <= end]]))


def _flows_between_events(
    run: FinishedRun, dense: ContinuousSolution, account: Account
) -> tuple[Array, Array, Array, Array]:
    impacts = RunImpacts.of(account.d, run.events)
    impacts = impacts[impacts.t <= run.t[-1]]
    pieces = pieces_of(run, dense)
    flows = pieces.integral(account.powers(pieces.times, *dense.read(pieces.times, "right")))
    instants, first = np.unique(impacts.t, return_index=True)
    doubled = 1 + np.isin(pieces.cuts, instants)
    t = np.repeat(pieces.cuts, doubled)
    flows = np.repeat(flows, doubled, axis=0)
    q, v = (np.repeat(each, doubled, axis=0) for each in dense.read(pieces.cuts, "right")[:2])
    before = np.searchsorted(t, instants)
    q[before], v[before] = impacts.q[first], impacts.before[first]
    for k, flow in zip(np.searchsorted(t, impacts.t), account.of_impacts(impacts), strict=True):
        flows[k + 1 :] += flow
    return t, q, v, flows


SUMMARY: dict[str, tuple[str, Callable[[FinishedRun], float]]] = {
    "peak_force": ("N", peak_force),
    "peak_time": ("s", peak_time),
    "contact_time": ("s", contact_time),
    "restitution": ("", restitution),
    "rebound_speed": ("m/s", rebound_speed),
    "impacts": ("", impacts),
    "impulse": ("N s", impulse),
    "dissipated": ("J", dissipated),
    "deformation": ("m", deformation),
}
"""The quantities that need no name of a series or event: their units and measures."""


class Summary(dict[str, float]):
    """The quantities of `SUMMARY` by name: numbers, printed and shown in notebooks as a table.

    Attributes
    ----------
    units : mapping of str to str
        SI unit of each quantity; of angles, and without units, those of the problem of the run.
    run : Trajectory, optional
        The run, whose error is shown beside the numbers where it is known or quick to estimate; it is not pickled.

    Examples
    --------
    >>> print(Summary(peak_force=1234.5678, restitution=math.nan))
    peak force         1234.57 N
    restitution              -
    """

    units: Mapping[str, str] = {name: unit for name, (unit, _) in SUMMARY.items()}
    run: FinishedRun | None = None

    @classmethod
    @np.errstate(all="ignore")
    def of(cls, run: FinishedRun, known: Mapping[str, float] | None = None) -> Summary:
        """Return the quantities of a run, or those that are ``known``."""
        found = cls(known or {name: float(measure(run)) for name, (_, measure) in SUMMARY.items()})
        found.units = {name: run.problem.own_unit(unit) for name, (unit, _) in SUMMARY.items()}
        return found

    def rows(self) -> list[tuple[str, float, str]]:
        """Return the rows of the table: quantity in words, value and unit."""
        return [(name.replace("_", " "), value, self.units[name]) for name, value in self.items()]

    def errors(self) -> dict[str, float]:
        """Return the estimated error of each quantity, where it is known or quick to estimate; else nothing."""
        found = None if self.run is None else self.run.quick_error()
        return {} if found is None or not found.known else dict(found.summary)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "run"}

    def __str__(self) -> str:
        errors = self.errors()
        lines = []
        for name, (words, x, unit) in zip(self, self.rows(), strict=True):
            error = errors.get(name, math.nan)
            off = "" if math.isnan(error) else f"±{error:.1e}"
            lines.append(f"{words:<14}{'-' if math.isnan(x) else f'{x:.6g}':>12} {unit:<6}{off}".rstrip())
        if self.run is not None and self.run.estimates and not errors:
            lines.extend(f"error: {line}" for line in self.run.error_lines()[:1])
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        return html_of(self)
