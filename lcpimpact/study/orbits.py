r"""Periodic orbits: found by shooting, judged by their multipliers, followed along a parameter up to a grazing.

An orbit is a zero of P(X) - X, where P takes the state over one period by the exact motion. Newton's method needs the
derivative of P, the *monodromy matrix*, which is the product of the modes' flows and of the saltation matrices between them
(`lcpimpact.hybrid.tangent`); no difference quotient is taken. Its eigenvalues are the Floquet multipliers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.errors import FailureError, InputError, LcpImpactError, Status, UnsupportedError
from lcpimpact.hybrid.modes import System
from lcpimpact.hybrid.motion import Motion, begin, begin_problem, follow, read, state_before
from lcpimpact.hybrid.tangent import factors, place_derivative, tangent
from lcpimpact.numbers import is_count, is_real
from lcpimpact.problems.base import Problem
from lcpimpact.record import Event, State
from lcpimpact.registry import nearest
from lcpimpact.scheme.dynamics import Dynamics, Feature
from lcpimpact.scheme.signals import Harmonic, Square
from lcpimpact.study.watch import Watch, unwatched

CLOSED = 1e-10
"""An orbit is one if it comes back to itself this well, relative to the largest value of each state on its way."""

ROUNDING = 1e-13
"""Newton's method has nothing left to do below this."""

SINGULAR = 1e-9
"""Directions in which P(X) - X changes less than this, relative to the others, are left as they are: along a family of
orbits, as that of an oscillator without loss, Newton's method takes the nearest member."""

NEUTRAL = 1e-7
"""A multiplier so near the unit circle is on it: two that meet at 1 are known to half of the digits."""

OUT_OF_REACH = 1e3
"""A stop is taken away by so many times the largest gap of the scheme, and a metre."""

VANISHING = 1e-6
"""Like events that follow each other within so much of the length of a run are impacts that accumulate, and no period."""

RETURNS = 400
"""Instants at which a motion without force is looked at for its return."""

HALVINGS = 12
"""So often is a step of Newton's method, or of the parameter, shortened before it is given up."""


@dataclass(frozen=True, eq=False)
class PeriodicOrbit:
    """A motion that repeats itself.

    Attributes
    ----------
    problem : Problem
        Whose motion it is; its initial state was only the guess.
    T : float
        The period in s.
    forced : bool
        Whether T is that of the force, or several of them; else it was found together with the orbit.
    start : float
        An instant in s away from all events; times of the orbit run from it to start + T.
    motion : Motion
        The orbit itself, over one period.
    monodromy : (k, k) array
        The derivative of the state after a period by the state at ``start``, signals left out.
    residual : float
        How far it misses itself after one period, relative to the largest value of each state.
    iterations : int
        Steps of Newton's method.
    """

    problem: Problem
    T: float
    forced: bool
    start: float
    motion: Motion
    monodromy: Array
    residual: float
    iterations: int

    @property
    def floquet(self) -> Array:
        """The Floquet multipliers, the largest first; one is 1 where the period is not that of a force (k,)."""
        found = np.linalg.eigvals(self.monodromy)
        return np.asarray(found[np.lexsort((-found.imag, -found.real, -np.round(np.abs(found), 12)))])

    @property
    def stable(self) -> bool:
        """Whether a small deviation dies out: |μ| < 1, beyond rounding, for every multiplier but the 1 of a free phase."""
        return self.growth < 1.0 - NEUTRAL

    @property
    def growth(self) -> float:
        """The largest |μ|, by which a small deviation grows in one period; the 1 of a free phase is left out."""
        found = self.floquet
        if not self.forced:
            found = np.delete(found, np.argmin(np.abs(found - 1.0)))
        return float(np.abs(found).max(initial=0.0))

    @property
    def events(self) -> tuple[Event, ...]:
        """What happens in one period."""
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
        return np.array([-dynamics.gap_rate(e.left.v)[names.index(e.contact)] for e in self.impacts])

    def sample(self, t: ArrayLike, side: str = "right") -> State:
        """Return q, v and the reactions of the orbit at any times in s, before or after the period that was computed."""
        times = np.atleast_1d(np.asarray(t, dtype=np.float64))
        within = self.start + np.mod(times - self.start, self.T)
        order = np.argsort(within, kind="stable")
        back = np.argsort(order, kind="stable")
        q, v, r = read(self.motion.system, tuple(self.motion.segments), within[order], side)
        return State(q[back], v[back], r[back])

    def __repr__(self) -> str:
        largest = ", ".join(f"{each:.6g}" for each in self.floquet[:4])
        return (
            f"PeriodicOrbit of {self.problem.name}: T = {self.T:.9g} s, {len(self.impacts)} impacts, "
            f"{'stable' if self.stable else 'not stable'}, multipliers {largest}, residual {self.residual:.1e}"
        )


def force_period(dynamics: Dynamics) -> float | None:
    """Return the common period of all loads and given motions in s, None where nothing depends on time.

    Raises
    ------
    UnsupportedError
        If they have no common period, or one is a function of time that says none.
    """
    signals = [*(load for _, load in dynamics.loads), *dynamics.motions.values()]
    ω = []
    for signal in signals:
        if isinstance(signal, Harmonic | Square):
            ω.append(signal.omega)
        elif callable(signal):
            raise UnsupportedError(
                "a load or a motion is a function of time that tells no period: give it as Harmonic(...) or Square(...)"
            )
    if not ω:
        return None
    ratios = [Fraction(each / ω[0]).limit_denominator(100) for each in ω]
    if any(abs(float(ratio) * ω[0] - each) > 1e-12 * each for ratio, each in zip(ratios, ω, strict=True)):
        raise UnsupportedError(f"the frequencies {', '.join(f'{each:g}' for each in ω)} rad/s have no common period")
    # With ω_i = p_i/q_i ω_0 the common frequency is ω_0 gcd(p)/lcm(q).
    common = Fraction(math.gcd(*(r.numerator for r in ratios)), math.lcm(*(r.denominator for r in ratios)))
    return 2.0 * math.pi / (float(common) * ω[0])


MOST_STEPS = 40
"""Limit of Newton's steps."""


@checked
def periodic_orbit(
    problem: Problem,
    *,
    periods: int = 1,
    T: float | None = None,
    transient: int = 0,
    max_iter: int = MOST_STEPS,
) -> PeriodicOrbit:
    r"""Find a periodic orbit near the motion from a problem's initial state, with its Floquet multipliers.

    .. math:: (M - I)\, ΔX = X - P(X), \qquad M = P'(X)

    by the exact motion. Without a force the period is unknown too, and the step is taken across the motion.

    Parameters
    ----------
    problem : Problem
        One that the method ``exact`` handles; its initial state is the guess.
    periods : int
        Periods of the force in one period of the orbit.
    T : float, optional
        A guess of the period in s where there is no force; by default the time between two like events of the run.
    transient : int
        Periods to run before the search begins: an orbit that attracts is then near.
    max_iter : int
        Limit of Newton's steps.

    Returns
    -------
    PeriodicOrbit
        With T, floquet, stable, events and ``sample(t)``.

    Raises
    ------
    InputError
        For counts that are none, or if the period cannot be guessed.
    UnsupportedError
        If ``exact`` does not handle the problem, or the orbit grazes or has two events at once.
    FailureError
        If Newton's method finds none from this guess.

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
    return _orbit(problem, None, periods, T, transient, max_iter)


def _orbit(
    problem: Problem, dynamics: Dynamics | None, periods: int, T: float | None, transient: int, max_iter: int
) -> PeriodicOrbit:
    """Find an orbit of a problem, or of the problem with other dynamics."""
    _count("periods", periods, 1)
    _count("transient", transient, 0)
    _count("max_iter", max_iter, 1)
    refuse_power_laws(problem)
    force = force_period(problem.dynamics)
    if force is not None:
        if T is not None:
            raise InputError(f"T = {T!r}: the period of the force, {force:g} s, is given; say periods = ... of it")
        length = periods * force
    else:
        length = _guessed_period(problem) if T is None else T
        if not (is_real(length) and length > 0.0):
            raise InputError(f"T = {T!r} must be a positive number in s")
    motion = begin_problem(problem, "exact", (transient + 3) * length, dynamics=dynamics)
    _followed(motion, problem, motion.end)
    start, X = _away_from_events(motion, transient * length, (transient + 1) * length)
    if force is None:
        length = _closest_return(motion, start, X, length)
    return _shoot(problem, motion.system, X, start, length, force is not None, motion.scale, max_iter)


def _count(name: str, value: int, least: int) -> None:
    if not (is_count(value) or (value == 0 and least == 0 and not isinstance(value, bool))):
        raise InputError(f"{name} = {value!r} must be a whole number, at least {least}")


def refuse_power_laws(problem: Problem) -> None:
    """Refuse what has no exact solution."""
    if what := problem.dynamics.features.get(Feature.POWER_LAWS):
        raise UnsupportedError(
            f"{problem.name!r} has non-linear springs ({what}), which 'exact' does not handle: take a method that steps"
        )


def _followed(motion: Motion, problem: Problem, until: float) -> None:
    status = follow(motion, until)
    if status is not Status.SOLVED:
        raise FailureError(
            f"{problem.name}: the exact run ended at t = {motion.next_event[0].hi:g} s: {status.sentence}", None
        )


def _guessed_period(problem: Problem) -> float:
    """Return the time between the last two like events of a run."""
    motion = begin_problem(problem, "exact", problem.t_end)
    _followed(motion, problem, problem.t_end)
    last: dict[tuple[str, str], float] = {}
    T = math.nan
    for event in motion.events:
        key = event.contact, event.kind
        if event.t > last.get(key, math.inf):
            T = event.t - last[key]
        last[key] = event.t
    if not T > 0.0:
        raise InputError(
            f"{problem.name}: the run to t_end = {problem.t_end:g} s shows no period; give a guess T = ..."
        )
    if VANISHING * problem.t_end > T:
        contact, _ = max(last, key=lambda key: last[key])
        raise InputError(
            f"{problem.name}: the impacts of {contact} accumulate, so the run shows no period; give a guess T = ..., "
            "or take e = 1 or a motion that feeds the system"
        )
    return T


def _closest_return(motion: Motion, start: float, X: Array, T: float) -> float:
    """Return the time near T after which a motion comes back nearest to X: where (X(t) - X)·X'(t) turns positive."""
    unit = np.maximum(motion.scale, 1e-12 * motion.scale.max(initial=1e-300))
    joins = np.array([segment.t0 for segment in motion.segments])

    def apart(t: float) -> tuple[float, float]:
        segment = motion.segments[int(np.searchsorted(joins, t, side="right")) - 1]
        flow, _ = motion.system.mode(segment.mode)
        here = flow.move(segment.state, float(segment.since(np.array(t)))).hi
        away = (here - X) / unit
        return float(away @ away), float(away @ (flow.A @ here / unit))

    times = start + T * np.linspace(0.5, 1.5, RETURNS + 1)
    seen = np.array([apart(t) for t in times])
    turns = np.flatnonzero((seen[:-1, 1] < 0.0) & (seen[1:, 1] >= 0.0))
    if len(turns) == 0:
        return T
    k = int(turns[np.argmin(seen[turns, 0])])
    root = brentq(lambda t: apart(t)[1], times[k], times[k + 1], xtol=1e-300, rtol=4.0 * np.finfo(float).eps)
    return float(root) - start


def _away_from_events(motion: Motion, first: float, last: float) -> tuple[float, Array]:
    """Return the middle of the longest stretch without event between two instants, and X there."""
    joins = np.array([segment.t0 for segment in motion.segments])
    edges = np.concatenate([[first], joins[(joins > first) & (joins < last)], [last]])
    k = int(np.argmax(np.diff(edges)))
    t = float(0.5 * (edges[k] + edges[k + 1]))
    segment = motion.segments[int(np.searchsorted(joins, t, side="right")) - 1]
    flow, _ = motion.system.mode(segment.mode)
    return t, flow.move(segment.state, float(segment.since(np.array(t)))).hi


class Period(NamedTuple):
    """One period from a state: the motion, the miss P(X) - X, its derivative, and the velocity at the end."""

    motion: Motion
    X: Array
    miss: Array
    M: Array
    velocity: Array


def _free(system: System) -> Array:
    """Return which states are no signals."""
    form = system.form
    return np.array([*range(form.constant), *range(len(form.A), len(system.O.T))], dtype=np.int64)


def _one_period(problem: Problem, system: System, X: Array, start: float, T: float, scale: Array) -> Period:
    X = X.copy()
    X[system.form.constant : len(system.form.A)] = system.form.signals_at(np.array(start))
    motion = begin(system, X, start + T, start, scale=scale.copy())
    _followed(motion, problem, start + T)
    last = motion.segments[-1]
    # A slider of degree 0 that slips at the end has no place yet: it is put where it is, as at the start.
    settle = place_derivative(system, last.mode)
    end = settle @ state_before(motion, start + T)
    velocity = settle @ (system.mode(last.mode)[0].A @ state_before(motion, start + T))
    M = settle @ tangent(motion, start + T)
    return Period(motion, motion.segments[0].X, end - motion.segments[0].X, M, velocity)


def _shoot(
    problem: Problem, system: System, X: Array, start: float, T: float, forced: bool, scale: Array, max_iter: int
) -> PeriodicOrbit:
    """Find an orbit by Newton's method from the state X at ``start``, with steps shortened where they lead away."""
    free = _free(system)
    k = len(free)
    unit = np.maximum(scale[free], 1e-12 * max(scale[free].max(initial=0.0), 1e-300))

    def size(period: Period) -> float:
        return float(np.abs(period.miss[free] / unit).max(initial=0.0))

    here = _one_period(problem, system, X, start, T, scale)
    steps = 0
    while steps < max_iter and size(here) > ROUNDING:
        matrix = here.M[np.ix_(free, free)] - np.eye(k)
        right = -here.miss[free] / unit
        matrix = matrix * unit / unit[:, None]
        if not forced:
            # One more unknown, T, and one more equation: the step is taken across the motion.
            with np.errstate(over="ignore"):
                along = (system.mode(here.motion.segments[0].mode)[0].A @ here.X)[free] / unit
                across = here.velocity[free] / unit * T
            matrix = np.block([[matrix, across[:, None]], [along[None, :], np.zeros((1, 1))]])
            right = np.append(right, 0.0)
        if not (np.isfinite(matrix).all() and np.isfinite(right).all()):
            raise FailureError(
                f"{problem.name}: no periodic orbit found from this state: the derivative of the motion over T = {T:g} s is "
                "not finite; begin nearer to an orbit",
                None,
            )
        step = np.linalg.lstsq(matrix, right, rcond=SINGULAR)[0]
        better, share = None, 1.0
        for _ in range(HALVINGS):
            moved, length = here.X.copy(), T
            moved[free] += share * step[:k] * unit
            if not forced:
                length = T * (1.0 + share * float(step[k]))
            try:
                there = _one_period(problem, system, moved, start, length, scale) if length > 0.0 else None
            except (LcpImpactError, np.linalg.LinAlgError) as error:
                there, refused = None, error
                if share <= 2.0 ** (1 - HALVINGS):
                    if isinstance(refused, LcpImpactError):
                        raise refused from None
                    raise FailureError(
                        f"{problem.name}: no periodic orbit found from this state ({refused}): begin nearer to one",
                        None,
                    ) from None
            if there is not None and size(there) < size(here):
                better = there, length
                break
            share *= 0.5
        if better is None:
            break
        here, T = better
        steps += 1
    if not size(here) <= CLOSED:
        raise FailureError(
            f"{problem.name}: no periodic orbit found from this state; after {steps} steps of Newton's method it misses "
            f"itself by {size(here):.1e} of its size: begin nearer to an orbit, or with a longer transient",
            None,
        )
    return PeriodicOrbit(problem, T, forced, start, here.motion, here.M[np.ix_(free, free)], size(here), steps)


@dataclass(frozen=True, eq=False)
class Branch:
    """The orbits of a family of problems, along its parameter.

    Attributes
    ----------
    orbits : tuple of PeriodicOrbit
        One for each value that was reached.
    table : DataFrame
        One row a value: ``value``, ``T`` (s), the coordinates (m) and velocities (m/s, ``v_NAME``) at t = 0 of the force or
        at the start of the orbit, ``impacts`` in one period, ``speed`` (m/s, the fastest of them), ``gap`` (m, the least one
        between touches, NaN where there is none), ``growth`` (the largest |μ|), ``stable`` and ``failure``.
    ended : str
        Why the branch ends before the last value, "" where it does not.
    """

    orbits: tuple[PeriodicOrbit, ...]
    table: pd.DataFrame
    ended: str


@checked
def continue_orbit(
    family: Callable[[float], Problem],
    values: Sequence[float],
    *,
    periods: int = 1,
    T: float | None = None,
    transient: int = 0,
    watch: Watch = unwatched,
) -> Branch:
    """Follow a periodic orbit, stable or not, along a parameter, until it grazes a stop or turns back.

    The first orbit is that of `periodic_orbit`; each next one is sought from the two before. Where it is not found, or has
    other events, the step is halved up to 12 times, and then the branch ends.

    Parameters
    ----------
    family : callable
        Takes a value and returns a Problem; coordinates and contacts must stay the same.
    values : sequence of float
        In the order in which they are to be reached.
    periods, T, transient
        As of `periodic_orbit`, for the first value.
    watch : callable
        Sees the values go by.

    Returns
    -------
    Branch
        With orbits, table and ended.

    Raises
    ------
    LcpImpactError
        As `periodic_orbit` for the first value.

    Examples
    --------
    >>> from lcpimpact import continue_orbit, load_problem
    >>> branch = continue_orbit(lambda f: load_problem("impact-oscillator", f=f), [1.0, 1.1, 1.2])
    >>> [round(speed, 6) for speed in branch.table["speed"]]
    [0.500672, 0.55074, 0.600807]
    """
    targets = [float(value) for value in values]
    if not targets:
        raise InputError("values is empty: give those that the parameter is to take")
    first = periodic_orbit(family(targets[0]), periods=periods, T=T, transient=transient)
    orbits, found, ended = [first], [(targets[0], first)], ""
    events = _sequence(first)
    for target in watch(targets[1:], len(targets) - 1, "orbits"):
        while found[-1][0] != target and not ended:
            reason, share = "", 1.0
            for _ in range(HALVINGS):
                here = found[-1][0]
                value = target if share == 1.0 else here + share * (target - here)
                try:
                    orbit = _next_orbit(family(value), value, found)
                except (LcpImpactError, np.linalg.LinAlgError) as error:
                    reason = str(error)
                else:
                    if _sequence(orbit) == events:
                        found.append((value, orbit))
                        break
                    reason = f"it would have the events {_words(_sequence(orbit))} in place of {_words(events)}"
                share *= 0.5
            else:
                gap, contact, t = least_gap(found[-1][1])
                near = f"; there the least gap is {gap:.3g} m, of {contact} at t = {t:.6g} s" if contact else ""
                ended = f"the branch ends near {found[-1][0]:.9g}{near}: {reason}"
        if ended:
            break
        orbits.append(found[-1][1])
    return Branch(tuple(orbits), _branch_table(targets, orbits, ended), ended)


def _sequence(orbit: PeriodicOrbit) -> tuple[tuple[str, str], ...]:
    return tuple(sorted((event.contact, event.kind) for event in orbit.events))


def _words(events: tuple[tuple[str, str], ...]) -> str:
    return ", ".join(f"{kind} {contact}" for contact, kind in events) or "none"


def _next_orbit(problem: Problem, value: float, found: list[tuple[float, PeriodicOrbit]]) -> PeriodicOrbit:
    """Find an orbit from one or two earlier ones, by the line through them."""
    a, last = found[-1]
    b, other = found[-2] if len(found) > 1 else (a, last)
    slope = (value - a) / (a - b) if a != b else 0.0
    start, _ = _away_from_events(last.motion, last.start, last.start + last.T)
    X = _state_at(last, start)
    before = _state_at(other, start * other.T / last.T)
    T = last.T + slope * (last.T - other.T)
    system = System(problem.dynamics)
    if len(system.O.T) != len(X):
        raise InputError(f"the problem at {value:g} has other states than the one before: change constants only")
    if last.forced:
        force = force_period(problem.dynamics)
        if force is None:
            raise InputError(f"the problem at {value:g} has no force with a period, as the one before has")
        whole = force_period(last.problem.dynamics) or last.T
        T = force * round(last.T / whole)
    return _shoot(
        problem, system, X + slope * (X - before), start * T / last.T, T, last.forced, last.motion.scale, MOST_STEPS
    )


def _state_at(orbit: PeriodicOrbit, t: float) -> Array:
    """Return X of an orbit at any time (N,)."""
    within = orbit.start + (t - orbit.start) % orbit.T
    segments = orbit.motion.segments
    segment = segments[int(np.searchsorted([each.t0 for each in segments], within, side="right")) - 1]
    flow, _ = orbit.motion.system.mode(segment.mode)
    return flow.move(segment.state, float(segment.since(np.array(within)))).hi


def _branch_table(values: list[float], orbits: list[PeriodicOrbit], ended: str) -> pd.DataFrame:
    nodes = orbits[0].problem.dynamics.nodes
    rows: list[dict[str, object]] = []
    for value, orbit in zip(values, orbits, strict=False):
        state = orbit.sample(0.0 if orbit.forced else orbit.start)
        gap = least_gap(orbit)[0]
        rows.append(
            {"value": value, "T": orbit.T}
            | dict(zip(nodes, state.q[0].tolist(), strict=True))
            | {f"v_{node}": v for node, v in zip(nodes, state.v[0].tolist(), strict=True)}
            | {"impacts": len(orbit.impacts), "speed": float(orbit.speeds.max(initial=0.0))}
            | {
                "gap": gap if math.isfinite(gap) else math.nan,
                "growth": orbit.growth,
                "stable": orbit.stable,
                "failure": "",
            }
        )
    if ended:
        rows.append({"value": values[len(orbits)], "failure": ended})
    table = pd.DataFrame(rows)
    table.attrs = {"problem": orbits[0].problem.name, "ended": ended}
    return table


@checked
def least_gap(orbit: PeriodicOrbit, contact: str | None = None) -> tuple[float, str, float]:
    """Return the least gap of an orbit between its touches, in m, of which contact, and when.

    It is the least of the minima of u(t), each found where u' passes through zero on the exact motion, to rounding.

    Parameters
    ----------
    orbit : PeriodicOrbit
    contact : str, optional
        One contact; by default the one that comes nearest. (inf, "", nan) where there is none.

    Raises
    ------
    InputError
        For an unknown contact.
    """
    best = (math.inf, "", math.nan)
    for i in _stops(orbit.problem, contact):
        name = orbit.problem.dynamics.contacts[i].name
        gap, t = _least(orbit.motion, orbit.start + orbit.T, i, float(orbit.problem.dynamics.u0[i]))
        best = min(best, (gap, name, t))
    return best


def _stops(problem: Problem, contact: str | None) -> list[int]:
    """Return the rows of the contact that is named, or of all that are no sliders."""
    contacts = problem.dynamics.contacts
    known = {each.name: i for i, each in enumerate(contacts) if each.r0 is None}
    if contact is None:
        return list(known.values())
    if contact not in known:
        raise InputError(nearest(str(contact), list(known), "contact"))
    return [known[contact]]


def _least(motion: Motion, until: float, i: int, u0: float) -> tuple[float, float]:
    """Return the least minimum of the gap of row i with the constant u0, and when, but for its own touches."""
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


@dataclass(frozen=True, eq=False)
class Grazing:
    """Where an orbit just touches a stop.

    Attributes
    ----------
    value : float           of the parameter
    contact : str           what is touched
    t : float               the instant of the touch, in s
    gap : float             the least gap of ``orbit`` in m; zero but for rounding
    orbit : PeriodicOrbit   the orbit there
    """

    value: float
    contact: str
    t: float
    gap: float
    orbit: PeriodicOrbit


@checked
def grazing(
    family: Callable[[float], Problem],
    bracket: tuple[float, float],
    *,
    contact: str | None = None,
    periods: int = 1,
    T: float | None = None,
    transient: int = 0,
) -> Grazing:
    r"""Find the value of a parameter at which a periodic orbit just touches a stop that it does not strike.

    The root of the least gap along the orbit, the stop itself taken away, so that the orbit goes on beyond the touch and the
    gap changes its sign there. Other contacts act as ever.

    Parameters
    ----------
    family : callable
        Takes a value and returns a Problem.
    bracket : pair of float
        Two values, with the stop out of reach at one of them and within reach at the other.
    contact : str, optional
        Name of the stop; by default the only one.
    periods, T, transient
        As of `periodic_orbit`.

    Raises
    ------
    InputError
        If the gap has the same sign at both ends, or the stop is not named where there are several.
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
    rows = _stops(family(low), contact)
    if len(rows) != 1:
        names = [family(low).dynamics.contacts[i].name for i in rows]
        raise InputError(f"contact = ... must name the stop that is touched: one of {', '.join(names) or 'none'}")
    i = rows[0]
    orbits: dict[float, tuple[PeriodicOrbit, float, float]] = {}

    def gap(value: float) -> float:
        problem = family(value)
        dynamics = problem.dynamics
        u0 = dynamics.u0.copy()
        u0[i] += OUT_OF_REACH * (1.0 + np.abs(u0).max())
        orbit = _orbit(problem, replace(dynamics, u0=u0), periods, T, transient, MOST_STEPS)
        least, t = _least(orbit.motion, orbit.start + orbit.T, i, float(dynamics.u0[i]))
        orbits[value] = orbit, least, t
        return least

    ends = gap(low), gap(high)
    name = family(low).dynamics.contacts[i].name
    if ends[0] * ends[1] > 0.0:
        raise InputError(
            f"the least gap of {name!r} is {ends[0]:.3g} m at {low:g} and {ends[1]:.3g} m at {high:g}: "
            "a bracket must hold the stop out of reach at one end and within reach at the other"
        )
    value = float(brentq(gap, low, high, xtol=1e-300, rtol=4.0 * np.finfo(float).eps))
    gap(value)
    orbit, least, t = orbits[value]
    return Grazing(value, name, t, least, orbit)


@checked
def lyapunov(problem: Problem, *, t_end: float, transient: float = 0.0, watch: Watch = unwatched) -> Array:
    r"""Return the Lyapunov exponents of a motion in 1/s, the largest first.

    .. math:: λ_i = \lim_{t → ∞} \frac{1}{t} \sum \ln |R_{ii}|

    with the derivative along the motion, flows and saltation matrices in turn, kept as Q R. A largest exponent above zero
    means chaos; where a contact stays closed or a slider sticks, directions are lost for ever and their exponent is -inf.

    Parameters
    ----------
    problem : Problem
        One that the method ``exact`` handles.
    t_end : float
        Length of the average in s.
    transient : float
        Time before it in s.
    watch : callable
        Sees the events go by.

    Raises
    ------
    UnsupportedError
        If the motion grazes, or two events happen at once.

    Examples
    --------
    >>> import math
    >>> from lcpimpact import load_problem, lyapunov
    >>> T = 2.0 * math.pi / 2.6
    >>> λ = lyapunov(load_problem("impact-oscillator"), t_end=100 * T, transient=0.5 * T)
    >>> bool(abs(λ.sum() - (2.0 * math.log(0.8) / T - 0.1)) < 1e-9)
    True

    References
    ----------
    Müller, Calculation of Lyapunov exponents for dynamic systems with discontinuities (1995).
    """
    for name, value, least in (("t_end", t_end, 0.0), ("transient", transient, -1.0)):
        if not is_real(value) or not value > least:
            raise InputError(f"{name} = {value!r} must be a positive number in s")
    refuse_power_laws(problem)
    first = begin_problem(problem, "exact", transient + t_end)
    _followed(first, problem, transient)
    motion = first
    if transient > 0.0:
        motion = begin(first.system, state_before(first, transient), transient + t_end, transient, scale=first.scale)
    _followed(motion, problem, motion.end)
    free = _free(motion.system)
    Q, total = np.eye(len(free)), np.zeros(len(free))
    for factor in watch(factors(motion, motion.end), 2 * len(motion.segments) - 1, "events"):
        Q, R = np.linalg.qr(factor[np.ix_(free, free)] @ Q)
        with np.errstate(divide="ignore"):
            total += np.log(np.abs(np.diag(R)))
    return np.sort(total / t_end)[::-1]
