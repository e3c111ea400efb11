r"""Periodic orbits by shooting, and their Floquet multipliers.

An orbit is a zero of P(X) - X, where P is the period map of the exact motion. Newton's method needs the derivative of P, the
*monodromy matrix*, computed without difference quotients as the product of the modes' flows and the saltation matrices
between them (`lcpimpact.hybrid.tangent`). Its eigenvalues are the Floquet multipliers.

A Lagrangian system has no exact motion: P is that of ``event-driven``, and its derivative is by central differences, of
states that are projected onto the closed contacts and joints of the start.

A coordinate on which no force and no gap depends need not return: a toy that pecks its way down a pole is lower after each
period.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import islice
from typing import ClassVar, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.errors import FailureError, InputError, LcpImpactError, Status, UnsupportedError
from lcpimpact.hybrid.event_loop import follow, refuse_undetermined
from lcpimpact.hybrid.motion import ExactSolution, HybridMotion, begin, begin_problem, state_before
from lcpimpact.hybrid.moving import MovingMotion
from lcpimpact.hybrid.system import System
from lcpimpact.hybrid.tangent import place_derivative, tangent
from lcpimpact.integrators.event_driven import EventDriven
from lcpimpact.numbers import count, positive
from lcpimpact.problems.base import Problem
from lcpimpact.record import Event, State
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.impact_laws import name_of_law
from lcpimpact.scheme.lagrangian import LagrangianDynamics
from lcpimpact.scheme.signals import Harmonic, Square, Table, loads_of
from lcpimpact.scheme.structure import Feature
from lcpimpact.study.dynamics.period import extents
from lcpimpact.study.progress import Progress, watched
from lcpimpact.study.result import Study

REPEAT_RTOL = 1e-7
"""Difference of two states, relative to the largest values along the orbit, below which they are the same."""

MIN_PERIOD_RTOL = 1e-3
"""Shortest period, relative to the guess."""

UNIT_CIRCLE_TOL = 1e-7
"""Distance within which a multiplier counts as on the unit circle; double multipliers have half of the digits."""

RETURN_SAMPLES = 400
"""Number of samples of a motion in the search for its return, and of an orbit for its size."""

MAX_REPEATS = 16
"""Maximum number of least periods that are looked for in the period of an autonomous orbit."""

MAX_HALVINGS = 12
"""Maximum number of halvings of a Newton step or a parameter step."""

MAX_NEWTON_STEPS = 40
"""Maximum number of Newton iterations."""

MOVING_RTOL = 1e-12
"""Tolerance of the runs on which orbits of Lagrangian systems are found."""


AnyMotion = HybridMotion | MovingMotion


def exact(motion: AnyMotion) -> HybridMotion:
    """Return an exact motion; refuse that of a Lagrangian system."""
    if isinstance(motion, MovingMotion):
        raise UnsupportedError(
            "the orbit is of a Lagrangian system, and this study follows exact motions: change a parameter and call "
            "periodic_orbit again from the state of the orbit"
        )
    return motion


@dataclass(frozen=True, eq=False, repr=False)
class PeriodicOrbit(Study):
    """A periodic orbit.

    Attributes
    ----------
    problem : Problem
        The problem; its initial state was the guess.
    T : float
        The period in s.
    forced : bool
        Whether T is a multiple of the period of the force; else it was found together with the orbit.
    start : float
        An instant in s away from all events; times of the orbit run from it to start + T.
    motion : HybridMotion or MovingMotion
        The orbit itself, over one period.
    monodromy : (k, k) array
        The derivative of the state after one period with respect to the state at ``start``, without signals and without
        coordinates that need not return.
    residual : float
        |P(X) - X|, relative to the largest value of each state.
    iterations : int
        Number of Newton iterations.
    """

    problem: Problem
    T: float
    forced: bool
    start: float
    motion: AnyMotion
    monodromy: Array
    residual: float
    iterations: int

    drawn_by = "lcpimpact.plotting.dynamics:plot_orbit"
    title = "Periodic orbit of {0.problem.name}"

    @property
    def table(self) -> pd.DataFrame:
        """The Floquet multipliers: ``real``, ``imaginary``, ``modulus``."""
        μ = self.floquet
        return pd.DataFrame({"real": μ.real, "imaginary": μ.imag, "modulus": np.abs(μ)})

    def head(self) -> list[str]:
        """Return the period, the stability, and the residual of the orbit."""
        verdict = "stable" if self.stable else "not stable"
        found = f"found to {self.residual:.1e} in {self.iterations} steps"
        times = f" ({self.repeats} times the least period)" if self.repeats > 1 else ""
        return [f"{self.problem.name}: T = {self.T:.15g} s{times}, {verdict}, {found}"]

    def summary(self) -> str:
        """Return the period, the multipliers and the events."""
        multipliers = [f"  multiplier {μ.real:+.12f} {μ.imag:+.12f}i   |μ| = {abs(μ):.12f}" for μ in self.floquet]
        events = [f"  {event.kind} {event.contact} at t = {event.t:.12g} s" for event in self.events]
        return "\n".join([*self.head(), *multipliers, *events, *(f"  speed {speed:.15g} m/s" for speed in self.speeds)])

    @property
    def floquet(self) -> Array:
        """The Floquet multipliers (k,), the largest first; one is 1 for an autonomous orbit."""
        found = np.linalg.eigvals(self.monodromy)
        return np.asarray(found[np.lexsort((-found.imag, -found.real, -np.round(np.abs(found), 12)))])

    @property
    def stable(self) -> bool:
        """Whether |μ| < 1, beyond rounding, for all multipliers except the trivial one of an autonomous orbit."""
        return self.growth < 1.0 - UNIT_CIRCLE_TOL

    @property
    def growth(self) -> float:
        """The largest |μ|, without the trivial multiplier of an autonomous orbit."""
        found = self.floquet
        if not self.forced:
            found = np.delete(found, np.argmin(np.abs(found - 1.0)))
        return float(np.abs(found).max(initial=0.0))

    @property
    def repeats(self) -> int:
        """Number of times that the orbit repeats itself within T; 1 if T is the least period."""
        most = MAX_REPEATS
        if self.forced:
            most = round(self.T / (force_period(self.problem.dynamics, tables=True) or self.T))
        seen = self.sample(self.start + self.T * np.arange(RETURN_SAMPLES) / RETURN_SAMPLES)
        parts = [times for times in range(most, 1, -1) if not (self.forced and most % times)]
        later = self.sample(self.start + self.T / np.array([1, *parts]))
        returns = ~cyclic_coordinates(self.problem.dynamics)
        X = np.hstack([seen.q[:, returns], seen.v])
        Y = np.hstack([later.q[:, returns], later.v])
        same = (np.abs(Y[1:] - X[0]) <= REPEAT_RTOL * extents(X)).all(axis=1)
        return next((times for times, returned in zip(parts, same, strict=True) if returned), 1)

    @property
    def events(self) -> tuple[Event, ...]:
        """The events of one period."""
        if isinstance(self.motion, MovingMotion):
            return tuple(self.motion.events)
        return tuple(event for segment in self.motion.segments[1:] for event in segment.events)

    @property
    def impacts(self) -> tuple[Event, ...]:
        """The impacts of one period."""
        return tuple(event for event in self.events if event.kind == "impact")

    @property
    def speeds(self) -> Array:
        """The relative speed -U⁻ of each impact in m/s."""
        dynamics = self.problem.dynamics
        names = [contact.name for contact in dynamics.contacts]
        return np.array([-dynamics.gap_rate(e.t, e.left.q, e.left.v)[names.index(e.contact)] for e in self.impacts])

    def sample(self, t: ArrayLike, side: str = "right") -> State:
        """Return q, v and the reactions of the orbit at any times in s, also outside the computed period."""
        times = np.atleast_1d(np.asarray(t, dtype=np.float64))
        within = self.start + np.mod(times - self.start, self.T)
        order = np.argsort(within, kind="stable")
        back = np.argsort(order, kind="stable")
        motion = self.motion
        read = motion.solution if isinstance(motion, MovingMotion) else ExactSolution.of(motion)
        q, v, r = read(within[order], side)
        cyclic = cyclic_coordinates(self.problem.dynamics)
        ends = read(self.start + self.T * np.array([0.0, 1.0]), "left")[0]
        way = np.where(cyclic, ends[1] - ends[0], 0.0)
        return State(q[back] + np.floor((times - self.start) / self.T)[:, None] * way, v[back], r[back])


def event_sequence(orbit: PeriodicOrbit) -> tuple[tuple[str, str], ...]:
    """Return the contact and kind of the events of an orbit, sorted."""
    return tuple(sorted((event.contact, event.kind) for event in orbit.events))


def words(events: tuple[tuple[str, str], ...]) -> str:
    """Return events in words."""
    return ", ".join(f"{kind} {contact}" for contact, kind in events) or "none"


def force_period(dynamics: Dynamics, tables: bool = False) -> float | None:
    """Return the common period of all loads and prescribed motions in s, None for an autonomous system.

    A table that repeats its points has a period as far as it reaches: only where the caller allows for ``tables``.

    Raises
    ------
    UnsupportedError
        If they have no common period, or one is a function of time without a declared period.
    """
    signals = [*(load for _, load in dynamics.loads), *dynamics.motions.values()]
    ω = []
    for signal in (term for each in signals for term in loads_of(each)):
        if isinstance(signal, Harmonic | Square):
            ω.append(signal.omega)
        elif tables and isinstance(signal, Table) and signal.recurrence is not None:
            ω.append(2.0 * math.pi / signal.recurrence)
        elif callable(signal):
            raise UnsupportedError(
                "a load or a motion is a function of time whose period is unknown: give it as Harmonic(...) or Square(...)"
                + tables * ", or as a Table(...) with period=, or that repeats its points"
            )
    if not ω:
        return None
    ratios = [Fraction(each / ω[0]).limit_denominator(100) for each in ω]
    if any(abs(float(ratio) * ω[0] - each) > 1e-12 * each for ratio, each in zip(ratios, ω, strict=True)):
        raise UnsupportedError(f"the frequencies {', '.join(f'{each:g}' for each in ω)} rad/s have no common period")
    # With ω_i = p_i/q_i ω_0 the common frequency is ω_0 gcd(p)/lcm(q).
    common = Fraction(math.gcd(*(r.numerator for r in ratios)), math.lcm(*(r.denominator for r in ratios)))
    return 2.0 * math.pi / (float(common) * ω[0])


@checked
def periodic_orbit(
    problem: Problem,
    *,
    periods: int = 1,
    T: float | None = None,
    transient: int = 0,
    max_iter: int = MAX_NEWTON_STEPS,
    progress: Progress = True,
) -> PeriodicOrbit:
    r"""Find a periodic orbit near the motion from a problem's initial state, with its Floquet multipliers.

    .. math:: (M - I)\, ΔX = X - P(X), \qquad M = P'(X)

    by the exact motion, or for Lagrangian systems by ``event-driven``. For an autonomous system the period is also unknown,
    and the step is orthogonal to the flow.

    Parameters
    ----------
    problem : Problem
        A problem supported by the method ``exact``, or a Lagrangian system; its initial state is the guess.
    periods : int
        Number of periods of the force in one period of the orbit.
    T : float, optional
        Guess of the period in s without a force; by default the time between two equal events of the run. For a Lagrangian
        system whose functions depend on t it is the period of its force.
    transient : int
        Number of periods simulated before the search, to approach an attracting orbit.
    max_iter : int
        Maximum number of Newton iterations.
    progress : bool or callable
        As in `lcpimpact.study.progress`.

    Returns
    -------
    PeriodicOrbit
        With T, floquet, stable, events and ``sample(t)``.

    Raises
    ------
    InputError
        For invalid counts, or if the period cannot be guessed.
    UnsupportedError
        If ``exact`` does not support the problem, or the orbit grazes or has simultaneous events.
    FailureError
        If Newton's method does not converge from this guess, or ends at rest.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from lcpimpact import load_problem, periodic_orbit
    >>> struck = load_problem("impact-oscillator")
    >>> orbit = periodic_orbit(replace(struck, v0={"x": -0.38}))
    >>> f"{orbit.speeds[0]:.12f}", orbit.stable
    ('0.500672492549', True)

    References
    ----------
    Parker and Chua, *Practical Numerical Algorithms for Chaotic Systems* (1989), on shooting; Leine and Nijmeijer (2004).
    """
    return find_orbit(problem, None, periods, T, transient, max_iter, progress)


def find_orbit(
    problem: Problem,
    dynamics: Dynamics | None,
    periods: int,
    T: float | None,
    transient: int,
    max_iter: int,
    progress: Progress = False,
) -> PeriodicOrbit:
    """Find an orbit of a problem, or of the problem with other dynamics."""
    count("periods", periods, 1)
    count("transient", transient, 0)
    count("max_iter", max_iter, 1)
    if dynamics is None and isinstance(problem.dynamics, LagrangianDynamics):
        force = _given_period(problem, T)
    else:
        refuse_power_laws(problem)
        force = force_period(problem.dynamics, tables=True)
        if force is not None and T is not None:
            raise InputError(f"T = {T!r}: the period of the force, {force:g} s, is known; give periods = ... instead")
    if force is not None:
        length = periods * force
    else:
        length = _guessed_period(problem) if T is None else T
        positive("T", length, "s")
    motion = _begun(problem, (transient + 3) * length, dynamics)
    _refuse_short_tables(problem, motion.end)
    follow_exactly(motion, problem, motion.end)
    start, X = away_from_events(motion, transient * length, (transient + 1) * length)
    found = _equations(problem, motion, Guess(X, start, length, force is not None, motion.scale))
    if force is None:
        found = _equations(problem, motion, found.guess._replace(T=_closest_return(motion, found)))
    return shoot(found, max_iter, progress)


def _equations(problem: Problem, motion: AnyMotion, guess: Guess) -> Newton:
    """Return the equations of an orbit near a motion."""
    if isinstance(motion, MovingMotion):
        return MovingNewton(problem, None, guess)
    return Newton(problem, motion.system, guess)


def cyclic_coordinates(d: Dynamics) -> Flags:
    """Return the flags of the coordinates with mass on which no force and no gap depends (n,)."""
    if isinstance(d, LagrangianDynamics):
        x, used = d.forces_of.traced, d.forces_of.formulas | d.rows_of.formulas
        return np.array([not used & x.program.depending_on([each]) for each in x.q])
    gaps = (d.H[~d.of_rate] != 0.0).any(axis=0)
    return np.asarray(d.massive & ~d.driven & ~(d.K != 0.0).any(axis=0) & ~gaps)


def _given_period(problem: Problem, T: float | None) -> float | None:
    """Return the period of the force of a Lagrangian system, which only the user knows; None of an autonomous one."""
    d = problem.dynamics
    assert isinstance(d, LagrangianDynamics)
    x, used = d.forces_of.traced, d.forces_of.formulas | d.rows_of.formulas
    if not used & x.program.depending_on([x.t]):
        return None
    if T is None:
        raise InputError(f"{problem.name}: functions of the Lagrangian system depend on t: give their period, T = ...")
    positive("T", T, "s")
    return T


def _begun(problem: Problem, end: float, dynamics: Dynamics | None = None) -> AnyMotion:
    """Return the motion from the initial state of a problem."""
    d = problem.dynamics
    if dynamics is None and isinstance(d, LagrangianDynamics):
        motion = EventDriven(rtol=MOVING_RTOL).moving_motion(
            d, problem.initial_coordinates, problem.initial_velocities, end, "auto"
        )
        with refuse_undetermined(problem, EventDriven.name):
            motion.begin_segment(0.0, np.concatenate([problem.initial_coordinates, problem.initial_velocities]))
        return motion
    return begin_problem(problem, "exact", end, dynamics=dynamics)


def _refuse_short_tables(problem: Problem, end: float) -> None:
    """Raise for a table that ends before the motion that is searched for its orbit."""
    d = problem.dynamics
    signals = (*(load for _, load in d.loads), *d.motions.values())
    for signal in (term for each in signals for term in loads_of(each)):
        if isinstance(signal, Table) and signal.period is None and signal.times[-1] < end * (1.0 - 1e-12):
            raise UnsupportedError(
                f"a table ends at {signal.times[-1]:g} s, and the search for the orbit takes the motion until {end:g} s: "
                "repeat its points until then, or give it a period"
            )


def refuse_power_laws(problem: Problem) -> None:
    """Raise for what has no exact solution, as power laws, and for sampled forces, which add states."""
    if what := problem.dynamics.features.get(Feature.HOLDS):
        raise UnsupportedError(
            f"{problem.name!r} has {Feature.HOLDS.value} ({what}), which are no function of the state between their "
            "instants, so that studies of orbits do not take them: follow single runs of it by li.simulate"
        )
    if problem.dynamics.has_other_impact_law:
        raise UnsupportedError(
            f"{problem.name!r} has impact_law={name_of_law(problem.dynamics.impact_law)!r}, and studies of orbits take "
            "Newton's law: leave it out"
        )
    for feature in (Feature.POWER_LAWS, Feature.DASHPOTS, Feature.FORCES, Feature.LAGRANGIAN):
        if what := problem.dynamics.features.get(feature):
            raise UnsupportedError(
                f"{problem.name!r} has {feature.value} ({what}), which 'exact' does not handle: take another method where "
                "the study has one, as method='event-driven'"
            )


def follow_exactly(motion: AnyMotion, problem: Problem, until: float) -> None:
    """Follow the motion up to an instant; raise with the reason if it ends before."""
    if isinstance(motion, MovingMotion):
        with np.errstate(all="ignore"):  # as in a run
            status = follow(motion, until)
        if status is not Status.SOLVED:
            t = motion.pieces[-1].end if motion.pieces else 0.0
            raise FailureError(f"{problem.name}: the run by event-driven ended at t = {t:g} s: {status.sentence}", None)
        return
    status = follow(motion, until)
    if status is not Status.SOLVED:
        raise FailureError(
            f"{problem.name}: the exact run ended at t = {motion.next_event[0].hi:g} s: {status.sentence}", None
        )


def _guessed_period(problem: Problem, *, shortest_period_rtol: float = 1e-6) -> float:
    """Return the time between the last two equal events of a run.

    ``shortest_period_rtol``: time between two like events, relative to the run, below which they belong to an
    accumulation and not to a period.
    """
    motion = _begun(problem, problem.t_end)
    follow_exactly(motion, problem, problem.t_end)
    last: dict[tuple[str, ...], float] = {}
    T = math.nan
    for event in motion.events:
        # A relay switches to either side once a period.
        sides = tuple(map(str, np.sign(event.right.reaction))) if event.kind == "switch" else ()
        key = event.contact, event.kind, *sides
        if event.t > last.get(key, math.inf):
            T = event.t - last[key]
        last[key] = event.t
    if not T > 0.0:
        raise InputError(
            f"{problem.name}: the run to t_end = {problem.t_end:g} s shows no period; give a guess T = ..."
        )
    if shortest_period_rtol * problem.t_end > T:
        contact, *_ = max(last, key=lambda key: last[key])
        raise InputError(
            f"{problem.name}: the impacts of {contact} accumulate, so the run shows no period; give a guess T = ..., "
            "or take e = 1 or a motion that feeds the system"
        )
    return T


def _closest_return(motion: AnyMotion, newton: Newton) -> float:
    """Return the time near T of the closest return of a motion to X: where (X(t) - X)·X'(t) becomes positive."""
    free, X, start, T = newton.free, newton.guess.X, newton.start, newton.guess.T

    def apart(t: float) -> tuple[float, float]:
        here, rate = _state_at(motion, t)
        away = ((here - X)[free]) / newton.unit
        return float(away @ away), float(away @ (rate[free] / newton.unit))

    times = start + T * np.linspace(0.5, 1.5, RETURN_SAMPLES + 1)
    seen = np.array([apart(t) for t in times])
    turns = np.flatnonzero((seen[:-1, 1] < 0.0) & (seen[1:, 1] >= 0.0))
    if len(turns) == 0:
        return T
    k = int(turns[np.argmin(seen[turns, 0])])
    root = brentq(lambda t: apart(t)[1], times[k], times[k + 1], xtol=1e-300, rtol=4.0 * np.finfo(float).eps)
    return float(root) - start


def _state_at(motion: AnyMotion, t: float) -> tuple[Array, Array]:
    """Return X and X' (N,) at an instant."""
    if isinstance(motion, MovingMotion):
        starts = np.array([piece.start for piece in motion.pieces])
        piece = motion.pieces[max(int(np.searchsorted(starts, t, side="right")) - 1, 0)]
        τ = t - piece.segment.t0
        X = piece.segment.held(τ, np.asarray(piece.dense(τ)))
        return X, piece.segment.rate(τ, X)
    joins = np.array([segment.t0 for segment in motion.segments])
    segment = motion.segments[int(np.searchsorted(joins, t, side="right")) - 1]
    flow, _ = motion.system.mode(segment.mode)
    here = flow.move(segment.state, float(segment.since(np.array(t)))).hi
    return here, flow.A @ here


def away_from_events(motion: AnyMotion, first: float, last: float) -> tuple[float, Array]:
    """Return the midpoint of the longest event-free interval between two instants, and X there."""
    segments = [piece.segment for piece in motion.pieces] if isinstance(motion, MovingMotion) else motion.segments
    joins = np.unique([segment.t0 for segment in segments])
    edges = np.concatenate([[first], joins[(joins > first) & (joins < last)], [last]])
    k = int(np.argmax(np.diff(edges)))
    t = float(0.5 * (edges[k] + edges[k + 1]))
    return t, _state_at(motion, t)[0]


class Period(NamedTuple):
    """One period from a state: the motion, the residual P(X) - X, its derivative, and the velocities X' at both ends."""

    motion: AnyMotion
    X: Array
    miss: Array
    M: Array
    velocity: Array
    rate: Array


def free_coordinates(system: System) -> Indices:
    """Return the states that are not signals."""
    form = system.form
    return np.array([*range(form.constant), *range(len(form.A), len(system.O.T))], dtype=np.int64)


class Guess(NamedTuple):
    """Initial guess of an orbit.

    The state X at the instant ``start`` (N,), the period T, whether it is imposed by a force, and the largest value of each
    state (N,).
    """

    X: Array
    start: float
    T: float
    forced: bool
    scale: Array


class Newton:
    """Newton's method for P(X) - X = 0, in units of the largest value of each state."""

    converged: ClassVar[float] = 1e-13
    """Residual at which the iteration ends."""

    def __init__(self, problem: Problem, system: System | None, guess: Guess) -> None:
        self.problem = problem
        self._system = system
        self.guess = guess
        self.start = guess.start
        self.forced = guess.forced
        self.scale = guess.scale
        self.free = self.returning()
        # Every motion returns to its start in no time.
        self.shortest = MIN_PERIOD_RTOL * guess.T
        size = guess.scale[self.free]
        self.unit = np.maximum(size, 1e-12 * max(size.max(initial=0.0), 1e-300))

    @property
    def system(self) -> System:
        """The system of the exact motion."""
        assert self._system is not None, "a Lagrangian system has none"
        return self._system

    def returning(self) -> Indices:
        """Return the states that return after a period: those that are not signals and not cyclic."""
        cyclic = cyclic_coordinates(self.problem.dynamics)
        advancing = np.flatnonzero((self.system.form.Q[cyclic] != 0.0).any(axis=0))
        return np.setdiff1d(free_coordinates(self.system), advancing)

    @classmethod
    def of(cls, orbit: PeriodicOrbit, start: float | None = None, X: Array | None = None) -> Newton:
        """Return the equations of an orbit, with another start and the state there if given."""
        motion = exact(orbit.motion)
        start, X = (orbit.start, motion.segments[0].X) if start is None or X is None else (start, X)
        return cls(orbit.problem, motion.system, Guess(X, start, orbit.T, orbit.forced, motion.scale))

    def orbit(self, here: Period, T: float, steps: int) -> PeriodicOrbit:
        """Return the orbit that was found in some steps."""
        monodromy = here.M[np.ix_(self.free, self.free)]
        residual = self.residual(here)
        return PeriodicOrbit(self.problem, T, self.forced, self.start, here.motion, monodromy, residual, steps)

    def period(self, X: Array, T: float) -> Period:
        """Follow the motion from X over one period."""
        system, end = self.system, self.start + T
        X = X.copy()
        X[system.form.constant : len(system.form.A)] = system.form.signals_at(np.array(self.start))
        motion = begin(system, X, end, self.start, scale=self.scale.copy())
        follow_exactly(motion, self.problem, end)
        last = motion.segments[-1]
        # The position of a slider of degree 0 that slips at the end is set as at the start.
        settle = place_derivative(system, last.mode).hi
        reached = state_before(motion, end)
        velocity = settle @ (system.mode(last.mode)[0].A @ reached)
        first = motion.segments[0].X
        rate = system.mode(motion.segments[0].mode)[0].A @ first
        return Period(motion, first, settle @ reached - first, settle @ tangent(motion, end), velocity, rate)

    def residual(self, period: Period) -> float:
        """Return the scaled residual of the period map."""
        return float(np.abs(period.miss[self.free] / self.unit).max(initial=0.0))

    def step(self, here: Period, T: float) -> Array:
        """Return the step of the free states, and of T where no force gives it, relative to their sizes (k,) or (k + 1,)."""
        free, unit = self.free, self.unit
        matrix = (here.M[np.ix_(free, free)] - np.eye(len(free))) * unit / unit[:, None]
        right = -here.miss[free] / unit
        if not self.forced:
            # T is an additional unknown; the additional equation makes the step orthogonal to the flow.
            with np.errstate(over="ignore"):
                along = here.rate[free] / unit
                across = here.velocity[free] / unit * T
            matrix = np.block([[matrix, across[:, None]], [along[None, :], np.zeros((1, 1))]])
            right = np.append(right, 0.0)
        if not (np.isfinite(matrix).all() and np.isfinite(right).all()):
            raise FailureError(
                f"{self.problem.name}: no periodic orbit found from this state: the derivative of the motion over "
                f"T = {T:g} s is not finite; begin nearer to an orbit",
                None,
            )
        return nearest_solution(matrix, right)

    def shortened(self, here: Period, T: float, step: Array) -> tuple[Period, float] | None:
        """Return the motion and period after the step, halved until the residual decreases; None if it never does."""
        k = len(self.free)
        for halvings in range(MAX_HALVINGS):
            fraction = 0.5**halvings
            X, length = here.X.copy(), T
            X[self.free] += fraction * step[:k] * self.unit
            if not self.forced:
                length = T * (1.0 + fraction * float(step[k]))
            try:
                there = self.period(X, length) if length > self.shortest else None
            except (LcpImpactError, np.linalg.LinAlgError) as error:
                if halvings < MAX_HALVINGS - 1:
                    continue
                if isinstance(error, LcpImpactError):
                    raise
                raise FailureError(
                    f"{self.problem.name}: no periodic orbit found from this state ({error}): begin nearer to one", None
                ) from None
            if there is not None and self.residual(there) < self.residual(here):
                return there, length
        return None

    def iterates(self, here: Period, T: float) -> Iterator[tuple[Period, float]]:
        """Yield the motion and its period after each step, until convergence or until no step reduces the residual."""
        while self.residual(here) > self.converged:
            better = self.shortened(here, T, self.step(here, T))
            if better is None:
                return
            here, T = better
            yield better


class MovingNewton(Newton):
    """Newton's method for an orbit of a Lagrangian system, on runs by ``event-driven``."""

    converged: ClassVar[float] = 1e-10

    def returning(self) -> Indices:
        """Return the states (q, v) without coordinates that are cyclic."""
        cyclic = cyclic_coordinates(self.problem.dynamics)
        return np.flatnonzero(~np.concatenate([cyclic, np.zeros_like(cyclic)]))

    def period(self, X: Array, T: float) -> Period:
        """Follow the motion from X over one period; its derivative is left for `step`."""
        motion = self._followed(X, T)
        (first, rate), (reached, velocity) = (_state_at(motion, self.start + part * T) for part in (0.0, 1.0))
        return Period(motion, first, reached - first, np.full((len(X), len(X)), np.nan), velocity, rate)

    def step(self, here: Period, T: float) -> Array:
        """Return the step as `Newton` does."""
        return super().step(self._differenced(here, T), T)

    def orbit(self, here: Period, T: float, steps: int) -> PeriodicOrbit:
        """Return the orbit with its derivative."""
        return super().orbit(self._differenced(here, T), T, steps)

    def _followed(self, X: Array, T: float) -> MovingMotion:
        """Return the motion from X over one period."""
        n, d = len(X) // 2, self.problem.dynamics
        assert isinstance(d, LagrangianDynamics)
        motion = EventDriven(rtol=MOVING_RTOL).moving_motion(d, X[:n], X[n:], self.start + T, "auto")
        motion.scale = self.scale.copy()
        motion.begin_segment(self.start, X)
        follow_exactly(motion, self.problem, self.start + T)
        return motion

    def _differenced(self, here: Period, T: float, *, change: float = 1e-5) -> Period:
        """Return a period with the derivative of its map by central differences of states in its first mode.

        ``change``: change of a state, relative to its largest value.
        """
        assert isinstance(here.motion, MovingMotion)
        segment = here.motion.pieces[0].segment
        M = np.zeros_like(here.M)
        for j, size in zip(self.free.tolist(), (change * self.unit).tolist(), strict=True):
            ends = []
            for sign in (1.0, -1.0):
                X = segment.held(0.0, here.X + sign * size * (np.arange(len(here.X)) == j))
                # What closed contacts hold does not change.
                moves = np.abs(X - here.X)[self.free].max() > 1e-3 * size
                ends.append(_state_at(self._followed(X, T), self.start + T)[0] if moves else here.X + here.miss)
            M[:, j] = (ends[0] - ends[1]) / (2.0 * size)
        return here._replace(M=M)


def nearest_solution(matrix: Array, right: Array, *, singular_rtol: float = 1e-9) -> Array:
    """Return the smallest step of Newton's method.

    ``singular_rtol``: singular values below this, relative to the largest, count as zero: in a continuous family of
    orbits, as that of an oscillator without loss, Newton's method finds the nearest member.
    """
    return np.asarray(np.linalg.lstsq(matrix, right, rcond=singular_rtol)[0])


def shoot(
    newton: Newton,
    max_iter: int = MAX_NEWTON_STEPS,
    progress: Progress = False,
    *,
    closure_rtol: float = 1e-10,
    rest_rtol: float = 1e-6,
) -> PeriodicOrbit:
    """Find an orbit by Newton's method with step halving.

    ``closure_rtol``: maximum residual of a closed orbit, relative to the largest value of each state along it.
    ``rest_rtol``: change of the states in a period, relative to their largest values, below which a motion without
    events is at rest.
    """
    problem, guess = newton.problem, newton.guess
    first = newton.period(guess.X, guess.T)
    iterates = islice(newton.iterates(first, guess.T), max_iter)
    found = [(first, guess.T), *watched(iterates, max_iter, "Newton steps", progress)]
    here, T = found[-1]
    steps = len(found) - 1
    residual = newton.residual(here)
    if not residual <= closure_rtol:
        raise FailureError(
            f"{problem.name}: no periodic orbit found from this state; after {steps} steps of Newton's method it misses "
            f"itself by {residual:.1e} of its size: begin nearer to an orbit, or with a longer transient",
            None,
        )
    moved = T * float(np.abs(here.velocity[newton.free] / newton.unit).max(initial=0.0))
    orbit = newton.orbit(here, T, steps)
    if not guess.forced and not orbit.events and moved <= rest_rtol:
        raise FailureError(
            f"{problem.name}: the search from this state ends at rest, which has no period: begin nearer to an orbit, or "
            "take a motion that feeds the system",
            None,
        )
    return orbit
