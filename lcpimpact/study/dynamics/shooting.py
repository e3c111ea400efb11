r"""Periodic orbits: found by shooting, judged by their multipliers, followed along a parameter up to a grazing.

An orbit is a zero of P(X) - X, where P takes the state over one period by the exact motion. Newton's method needs the
derivative of P, the *monodromy matrix*, which is the product of the modes' flows and of the saltation matrices between them
(`lcpimpact.hybrid.tangent`); without difference quotients. Its eigenvalues are the Floquet multipliers.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import islice
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.errors import FailureError, InputError, LcpImpactError, Status, UnsupportedError
from lcpimpact.hybrid.event_loop import follow
from lcpimpact.hybrid.motion import HybridMotion, begin, begin_problem, read, state_before
from lcpimpact.hybrid.system import System
from lcpimpact.hybrid.tangent import place_derivative, tangent
from lcpimpact.numbers import count, positive
from lcpimpact.problems.base import Problem
from lcpimpact.record import Event, State
from lcpimpact.scheme.dynamics import Dynamics, Feature
from lcpimpact.scheme.signals import Harmonic, Square
from lcpimpact.study.progress import Progress, watched
from lcpimpact.study.result import Study

CLOSURE_RTOL = 1e-10
"""Largest residual of a closed orbit, relative to the largest value of each state along it."""

NEWTON_RTOL = 1e-13
"""Residual at which Newton's method has converged."""

SINGULAR_RTOL = 1e-9
"""Singular values of the derivative of P(X) - X below this, relative to the largest, count as zero: in a continuous family
of orbits, as that of an oscillator without loss, Newton's method finds the nearest member."""

UNIT_CIRCLE_TOL = 1e-7
"""Distance from the unit circle below which a multiplier lies on it; double multipliers have half of the digits."""

ACCUMULATION_RTOL = 1e-6
"""Time between two like events, relative to the run, below which they belong to an accumulation and not to a period."""

RETURN_SAMPLES = 400
"""Samples of an autonomous motion among which its return is sought."""

MAX_HALVINGS = 12
"""Maximum number of times a step of Newton's method, or of the parameter, is halved."""

MAX_NEWTON_STEPS = 40
"""Maximum number of Newton iterations."""


@dataclass(frozen=True, eq=False, repr=False)
class PeriodicOrbit(Study):
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
    motion : HybridMotion
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
    motion: HybridMotion
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
        """Return the period, whether it is stable, and how well the orbit closes."""
        verdict = "stable" if self.stable else "not stable"
        found = f"found to {self.residual:.1e} in {self.iterations} steps"
        return [f"{self.problem.name}: T = {self.T:.15g} s, {verdict}, {found}"]

    def summary(self) -> str:
        """Return the period, the multipliers and the events."""
        multipliers = [f"  multiplier {μ.real:+.12f} {μ.imag:+.12f}i   |μ| = {abs(μ):.12f}" for μ in self.floquet]
        events = [f"  {event.kind} {event.contact} at t = {event.t:.12g} s" for event in self.events]
        return "\n".join([*self.head(), *multipliers, *events, *(f"  speed {speed:.15g} m/s" for speed in self.speeds)])

    @property
    def floquet(self) -> Array:
        """The Floquet multipliers, the largest first; one is 1 where the period is not that of a force (k,)."""
        found = np.linalg.eigvals(self.monodromy)
        return np.asarray(found[np.lexsort((-found.imag, -found.real, -np.round(np.abs(found), 12)))])

    @property
    def stable(self) -> bool:
        """Whether a small deviation dies out: |μ| < 1, beyond rounding, for every multiplier but the 1 of a free phase."""
        return self.growth < 1.0 - UNIT_CIRCLE_TOL

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
    progress : bool or callable
        As of `lcpimpact.study.progress`.

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
    refuse_power_laws(problem)
    force = force_period(problem.dynamics)
    if force is not None:
        if T is not None:
            raise InputError(f"T = {T!r}: the period of the force, {force:g} s, is given; say periods = ... of it")
        length = periods * force
    else:
        length = _guessed_period(problem) if T is None else T
        positive("T", length, "s")
    motion = begin_problem(problem, "exact", (transient + 3) * length, dynamics=dynamics)
    follow_exactly(motion, problem, motion.end)
    start, X = away_from_events(motion, transient * length, (transient + 1) * length)
    if force is None:
        length = _closest_return(motion, start, X, length)
    guess = Guess(X, start, length, force is not None, motion.scale)
    return shoot(problem, motion.system, guess, max_iter, progress)


def refuse_power_laws(problem: Problem) -> None:
    """Refuse what has no exact solution."""
    if what := problem.dynamics.features.get(Feature.POWER_LAWS):
        raise UnsupportedError(
            f"{problem.name!r} has non-linear springs ({what}), which 'exact' does not handle: take a method that steps"
        )


def follow_exactly(motion: HybridMotion, problem: Problem, until: float) -> None:
    """Follow the exact motion up to an instant, or say why it ends before."""
    status = follow(motion, until)
    if status is not Status.SOLVED:
        raise FailureError(
            f"{problem.name}: the exact run ended at t = {motion.next_event[0].hi:g} s: {status.sentence}", None
        )


def _guessed_period(problem: Problem) -> float:
    """Return the time between the last two like events of a run."""
    motion = begin_problem(problem, "exact", problem.t_end)
    follow_exactly(motion, problem, problem.t_end)
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
    if ACCUMULATION_RTOL * problem.t_end > T:
        contact, _ = max(last, key=lambda key: last[key])
        raise InputError(
            f"{problem.name}: the impacts of {contact} accumulate, so the run shows no period; give a guess T = ..., "
            "or take e = 1 or a motion that feeds the system"
        )
    return T


def _closest_return(motion: HybridMotion, start: float, X: Array, T: float) -> float:
    """Return the time near T after which a motion comes back nearest to X: where (X(t) - X)·X'(t) turns positive."""
    unit = np.maximum(motion.scale, 1e-12 * motion.scale.max(initial=1e-300))
    joins = np.array([segment.t0 for segment in motion.segments])

    def apart(t: float) -> tuple[float, float]:
        segment = motion.segments[int(np.searchsorted(joins, t, side="right")) - 1]
        flow, _ = motion.system.mode(segment.mode)
        here = flow.move(segment.state, float(segment.since(np.array(t)))).hi
        away = (here - X) / unit
        return float(away @ away), float(away @ (flow.A @ here / unit))

    times = start + T * np.linspace(0.5, 1.5, RETURN_SAMPLES + 1)
    seen = np.array([apart(t) for t in times])
    turns = np.flatnonzero((seen[:-1, 1] < 0.0) & (seen[1:, 1] >= 0.0))
    if len(turns) == 0:
        return T
    k = int(turns[np.argmin(seen[turns, 0])])
    root = brentq(lambda t: apart(t)[1], times[k], times[k + 1], xtol=1e-300, rtol=4.0 * np.finfo(float).eps)
    return float(root) - start


def away_from_events(motion: HybridMotion, first: float, last: float) -> tuple[float, Array]:
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

    motion: HybridMotion
    X: Array
    miss: Array
    M: Array
    velocity: Array


def free_coordinates(system: System) -> Array:
    """Return which states are no signals."""
    form = system.form
    return np.array([*range(form.constant), *range(len(form.A), len(system.O.T))], dtype=np.int64)


class Guess(NamedTuple):
    """Where the search for an orbit begins.

    The state X at the instant ``start`` (N,), the period T, whether that is the period of a force, and the largest value of
    each state (N,).
    """

    X: Array
    start: float
    T: float
    forced: bool
    scale: Array


class _Newton:
    """Newton's method for P(X) - X = 0, in units of the largest value of each state."""

    def __init__(self, problem: Problem, system: System, guess: Guess) -> None:
        self.problem, self.system, self.start, self.forced, self.scale = (
            problem,
            system,
            guess.start,
            guess.forced,
            guess.scale,
        )
        self.free = free_coordinates(system)
        size = guess.scale[self.free]
        self.unit = np.maximum(size, 1e-12 * max(size.max(initial=0.0), 1e-300))

    def period(self, X: Array, T: float) -> Period:
        """Follow the motion from X over one period."""
        system, end = self.system, self.start + T
        X = X.copy()
        X[system.form.constant : len(system.form.A)] = system.form.signals_at(np.array(self.start))
        motion = begin(system, X, end, self.start, scale=self.scale.copy())
        follow_exactly(motion, self.problem, end)
        last = motion.segments[-1]
        # A slider of degree 0 that slips at the end has no place yet: it is put where it is, as at the start.
        settle = place_derivative(system, last.mode)
        reached = state_before(motion, end)
        velocity = settle @ (system.mode(last.mode)[0].A @ reached)
        first = motion.segments[0].X
        return Period(motion, first, settle @ reached - first, settle @ tangent(motion, end), velocity)

    def residual(self, period: Period) -> float:
        """Return how far a motion misses itself after the period."""
        return float(np.abs(period.miss[self.free] / self.unit).max(initial=0.0))

    def step(self, here: Period, T: float) -> Array:
        """Return the step of the free states, and of T where no force gives it, relative to their sizes (k,) or (k + 1,)."""
        free, unit = self.free, self.unit
        matrix = (here.M[np.ix_(free, free)] - np.eye(len(free))) * unit / unit[:, None]
        right = -here.miss[free] / unit
        if not self.forced:
            # One more unknown, T, and one more equation: the step is taken across the motion.
            with np.errstate(over="ignore"):
                along = (self.system.mode(here.motion.segments[0].mode)[0].A @ here.X)[free] / unit
                across = here.velocity[free] / unit * T
            matrix = np.block([[matrix, across[:, None]], [along[None, :], np.zeros((1, 1))]])
            right = np.append(right, 0.0)
        if not (np.isfinite(matrix).all() and np.isfinite(right).all()):
            raise FailureError(
                f"{self.problem.name}: no periodic orbit found from this state: the derivative of the motion over "
                f"T = {T:g} s is not finite; begin nearer to an orbit",
                None,
            )
        return np.asarray(np.linalg.lstsq(matrix, right, rcond=SINGULAR_RTOL)[0])

    def shortened(self, here: Period, T: float, step: Array) -> tuple[Period, float] | None:
        """Return the motion after the step, halved until it misses itself by less, and its period; None if it never does."""
        k = len(self.free)
        for halvings in range(MAX_HALVINGS):
            share = 0.5**halvings
            X, length = here.X.copy(), T
            X[self.free] += share * step[:k] * self.unit
            if not self.forced:
                length = T * (1.0 + share * float(step[k]))
            try:
                there = self.period(X, length) if length > 0.0 else None
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
        """Yield the motion and its period after each step, until it closes or no step makes it better."""
        while self.residual(here) > NEWTON_RTOL:
            better = self.shortened(here, T, self.step(here, T))
            if better is None:
                return
            here, T = better
            yield better


def shoot(
    problem: Problem, system: System, guess: Guess, max_iter: int = MAX_NEWTON_STEPS, progress: Progress = False
) -> PeriodicOrbit:
    """Find an orbit by Newton's method, with steps shortened where they lead away."""
    newton = _Newton(problem, system, guess)
    first = newton.period(guess.X, guess.T)
    iterates = islice(newton.iterates(first, guess.T), max_iter)
    found = [(first, guess.T), *watched(iterates, max_iter, "Newton steps", progress)]
    here, T = found[-1]
    steps = len(found) - 1
    residual = newton.residual(here)
    if not residual <= CLOSURE_RTOL:
        raise FailureError(
            f"{problem.name}: no periodic orbit found from this state; after {steps} steps of Newton's method it misses "
            f"itself by {residual:.1e} of its size: begin nearer to an orbit, or with a longer transient",
            None,
        )
    monodromy = here.M[np.ix_(newton.free, newton.free)]
    return PeriodicOrbit(problem, T, guess.forced, guess.start, here.motion, monodromy, residual, steps)
