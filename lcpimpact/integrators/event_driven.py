r"""SciPy's adaptive solvers between events: the mode by LCPs, the event on the dense output, and a fresh start after it.

In a contact mode r = F X + F_w w, and the motion is a smooth initial value problem,

.. math:: X' = (A + B F) X + (E + B F_w) w(t, X),

with w the forces of the non-linear springs and the loads that are arbitrary functions of time (see
`lcpimpact.scheme.first_order`). Any solver of `scipy.integrate` may follow it. The modes, their ends and the impacts are
those of `lcpimpact.hybrid.modes`; where w is present they are chosen for the system made linear about the event.

*Events.* The dense output of a step is a polynomial. It is sampled at Chebyshev points and written in Bernstein's basis,
whose coefficients bound it; a step is passed over only if they are all positive. So two sign changes within a step are seen,
however close, down to the rounding of the samples. The root is then found on the dense output itself.

*Accumulating impacts.* When three flights in a row of a contact with e < 1 are each shorter than ``zeno`` times the length
of the run, or so low that they are lost in the rounding of the gap, its next impact has e = 0 and the contact stays closed.
A flight of T then leaves out a rest of e T/(1 - e), which is the error of the end of the accumulation. (That each is shorter
than the one before is not asked: among many bodies they shrink by fits and starts.)

*Several bodies.* When a second contact meets within a time that is short against the flights of the run, the impacts that
follow are those of `lcpimpact.hybrid.motion` in double-doubles, with the forces w made linear, until flights are long
again or the bodies have ended together (see `lcpimpact.hybrid.burst`). If forces bend too much for that meanwhile,
the run ends with the status ACCUMULATION.

*Long runs.* A free flight of 1e5 s of bodies joined by springs keeps 1e-12 of its length; every vibration of what is stiff
costs steps all the same, and at ``max_steps`` the run ends with a sentence.

*Closed contacts* are held by their accelerations. What rounding adds to their gaps is taken out at each event.

*The last instant.* An event is known to about rtol. One that is found nearer than that after the end of the run, and nearer
than 1e-9 of its length, is at its end, and is kept.
"""

from __future__ import annotations

import inspect
import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache, partial
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import integrate
from scipy.optimize import brentq

from lcpimpact.arrays import Array, Indices
from lcpimpact.double_double import DoubleDouble
from lcpimpact.errors import FailureError, InputError, Status, UnsupportedError
from lcpimpact.hybrid.burst import SHORT_FLIGHT, Burst, Meetings, follow_burst
from lcpimpact.hybrid.flow import Flow, casteljau, first_fall
from lcpimpact.hybrid.modes import (
    Mode,
    System,
    choose_mode,
    gaps,
    impact,
    refuse_mixed_degrees,
    settled,
    still,
)
from lcpimpact.hybrid.transition import happened
from lcpimpact.integrators.base import Declared, Integrator, Limits
from lcpimpact.lcp import SOLVERS
from lcpimpact.numbers import count, is_real
from lcpimpact.problems.base import Problem
from lcpimpact.record import ContinuousSolution, Grid, Record, State
from lcpimpact.registry import nearest
from lcpimpact.scheme import power_law
from lcpimpact.scheme.dynamics import Feature
from lcpimpact.scheme.first_order import Inputs, forced_form
from lcpimpact.scheme.signals import NAMED

SCIPY_SOLVERS = ("RK23", "RK45", "DOP853", "Radau", "BDF", "LSODA")

DENSE_DEGREE, SINGLE_STEP_DEGREE = 12, 7
"""Degree of the polynomial through the samples of a step: no dense output of SciPy has a higher one than the first, none of
its single-step methods than the second; and what is lower is less sensitive to rounding."""

WORK_PARTS = 4
"""Number of parts of a step over which its work is integrated."""

APART, PUSHES, SLACK = 0, 1, 2

ZERO_FOR_EVER = -1
"""Order of the zero of a row that is zero until an input makes it something else."""

MAX_EVENTS_AT_ONCE = 100
"""Maximum number of events at one instant; more end the run with MAX_EVENTS."""

MAX_BURST_FLIGHTS = 10.0
"""Maximum duration of a burst of impacts, in short flights, where there are nonlinear forces."""

SINGLE_STEP = (integrate.RK23, integrate.RK45, integrate.DOP853)
"""Solvers that need no small steps to begin with."""

MIN_TIME_RTOL, MAX_TIME_RTOL = 1e-12, 1e-9
"""Bounds of the accuracy of instants, relative to the run, whatever rtol is."""

EPS = float(np.finfo(float).eps)

ROOT_RTOL, INTERPOLATION_RTOL, NEWTON_STEPS = 4.0 * EPS, 1e-9, 6
"""Tolerance of a root; distance of the polynomial through the samples from the dense output; and Newton steps that find a
simple root."""

LOOK_BACK = 0.1
"""Part of the last step over which a row must fall."""

ZERO_RTOL, TINY = 4.0 * EPS, float(np.finfo(float).tiny)

NO_PHASE = np.zeros(0, dtype=np.int64)

MAX_ORDER = 7
"""Highest order of the zero with which a row begins; higher ones count as this less one."""

MIN_FLIGHTS = 3
"""Number of consecutive short flights after which impacts accumulate."""


class Samples(NamedTuple):
    """How polynomials on [0, 1] are found from samples.

    Attributes
    ----------
    points : (p + 1,) array             Chebyshev points
    fit : (p + 1, p + 1) array          what makes Bernstein coefficients of degree p of values there
    divided : list of arrays            by these the coefficients of sᵐ p(s), without the first m, become those of p
    noise : float                       rounding of the coefficients, relative to the terms of a sample
    """

    points: Array
    fit: Array
    divided: list[Array]
    noise: float


@cache
def _samples(p: int) -> Samples:
    """Return those for the degree p."""
    s = 0.5 - 0.5 * np.cos(np.pi * np.arange(p + 1) / p)
    fit = np.linalg.inv(np.array([[math.comb(p, j) * x**j * (1.0 - x) ** (p - j) for j in range(p + 1)] for x in s]))
    divided = [
        np.array([math.comb(p, j + m) / math.comb(p - m, j) for j in range(p + 1 - m)])
        for m in range(min(p, MAX_ORDER))
    ]
    return Samples(s, fit, divided, 8.0 * EPS * float(np.abs(fit).sum(axis=1).max()))


@dataclass(frozen=True, eq=False)
class Forces:
    """The inputs w(t, X): the springs, each in a phase of its law, and the loads.

    Attributes
    ----------
    inputs : Inputs
    phase : (ns,) array or None
        What each spring does in this segment: it is APART, it PUSHES, or it is SLACK, since with c > 0 it would pull. One
        that pushes goes on by K |δ|ⁿ sign δ through its zero, so that the solver sees no kink before the segment ends there.
        With None the springs follow their law wherever they are.
    """

    inputs: Inputs
    phase: Indices | None

    def __call__(self, t: Any, X: Array) -> Array:
        """Return w (..., nw) at X (..., N)."""
        s, loads = self._springs(power_law.forces, X), self.inputs.loads
        if not loads:
            return s
        if np.ndim(t) == 0:
            return np.append(s, [load(float(t)) for load in loads])
        return np.column_stack([s, [[load(float(at)) for load in loads] for at in t]])

    def extended(self, X: Array) -> Array:
        """Return K |δ|ⁿ sign δ (1 + b δ') + c δ' (..., ns), whether a spring pushes or not."""
        return power_law.forces(self.inputs.law, *self._approach(X), extended=True)

    def _springs(self, law: Callable[..., Array], X: Array) -> Array:
        """Return the forces of the springs in their phases (..., ns), or the tangents (3, ..., ns)."""
        if self.phase is None:
            return law(self.inputs.law, *self._approach(X))
        return np.asarray(law(self.inputs.law, *self._approach(X), extended=True) * (self.phase == PUSHES))

    def _approach(self, X: Array) -> tuple[Array, Array]:
        """Return δ and δ' (..., ns)."""
        known = X[..., : self.inputs.approach.shape[1]]
        return known @ self.inputs.approach.T, known @ self.inputs.rate.T

    def jacobian(self, X: Array) -> Array:
        """Return ∂w/∂X (nw, N)."""
        known, slope = self.inputs.approach.shape[1], np.zeros((self.inputs.count, len(X)))
        _, by_δ, by_rate = self._springs(power_law.tangents, X)
        slope[: len(by_δ), :known] = by_δ[:, None] * self.inputs.approach + by_rate[:, None] * self.inputs.rate
        return slope

    def linear(self, t: float, X: Array, later: float, X_later: Array, step: float) -> Array:
        """Return w at a later state, made linear about the state X at t (nw,)."""
        w = self(t, X) + self.jacobian(X) @ (X_later - X)
        w[len(self.inputs.law) :] += (later - t) * self.load_rates(t, step, ahead=True)
        return np.asarray(w)

    def load_rates(self, t: float, step: float, ahead: bool) -> Array:
        """Return the derivatives of the loads: central differences, or one-sided ones of the same order."""
        if ahead:
            return np.array(
                [(4.0 * f(t + step) - f(t + 2.0 * step) - 3.0 * f(t)) / (2.0 * step) for f in self.inputs.loads]
            )
        return np.array([(f(t + step) - f(t - step)) / (2.0 * step) for f in self.inputs.loads])


@dataclass(frozen=True, eq=False)
class Segment:
    """One mode from t0 on: X' = A X + E w(t0 + τ, X), with the rows c of c·(X, w, s) whose fall below zero ends it.

    It ends at ``end`` at the latest, which is that of the run or, where it ``breaks``, a breakpoint of the signals.

    s are the forces that the springs would have if they pushed. The last rows are theirs: ``phases`` tells which spring goes
    over to which phase. ``place`` and ``reaction`` hold the matrices by which q and r are read off X and w, ``velocity`` the
    one by which v is, where there are no inputs.
    """

    t0: float
    end: float
    breaks: bool
    mode: Mode
    A: Array
    E: Array
    forces: Forces
    rows: Array
    order: Indices
    phases: tuple[tuple[int, int], ...]
    place: tuple[Array, Array]
    reaction: tuple[Array, Array]
    velocity: Array

    def rate(self, τ: Any, X: Array) -> Array:
        """Return X' (..., N)."""
        if not self.E.shape[1]:
            return X @ self.A.T
        return X @ self.A.T + self.forces(self.t0 + τ, X) @ self.E.T

    def jacobian(self, τ: float, X: Array) -> Array:
        """Return ∂X'/∂X (N, N)."""
        return self.A + self.E @ self.forces.jacobian(X)

    def watched(self, τ: Array, X: Array) -> Array:
        """Return the terms (X, w, s) of which the rows make sums (nt, N + nw + ns)."""
        return np.column_stack([X, self.forces(self.t0 + τ, X), self.forces.extended(X)]) if self.E.shape[1] else X


@dataclass(eq=False)
class Guarded:
    """X' of a segment for a solver, which must be finite before it has ``begun``: SciPy looks for a first step for ever."""

    segment: Segment
    begun: bool = False

    def __call__(self, τ: float, X: Array) -> Array:
        """Return X' (N,)."""
        found = self.segment.rate(τ, X)
        if not self.begun and not np.isfinite(found).all():
            raise FloatingPointError
        return found


@dataclass(frozen=True, eq=False)
class Piece:
    """One step of the solver, or what an event left of it up to ``end``: X at t0 + τ."""

    segment: Segment
    end: float
    solution: Any


@dataclass(frozen=True, eq=False)
class AtRest:
    """The dense output of no time at all: X, whenever it is asked for."""

    X: Array

    def __call__(self, τ: ArrayLike) -> Array:
        """Return X at τ: (N,), or (N, nt)."""
        return np.asarray(np.multiply.outer(self.X, np.ones_like(τ, dtype=np.float64)))


@dataclass(frozen=True, eq=False)
class InBurst:
    """The dense output of a segment that was followed in double-doubles: X without the ``added`` states of inputs."""

    flow: Flow
    state: DoubleDouble
    added: slice

    def __call__(self, τ: ArrayLike) -> Array:
        """Return X at τ: (N,), or (N, nt)."""
        τ = np.asarray(τ, dtype=np.float64)
        X = np.delete(self.flow.at(self.state, np.maximum(τ.ravel(), 0.0)), self.added, axis=1)
        return X[0] if τ.ndim == 0 else X.T


@dataclass
class Flights(Meetings):
    """The impacts of each contact, and how many flights before the last one were short (nc,)."""

    short: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    @classmethod
    def none(cls, contacts: int) -> Flights:
        """Return that no contact has met anything."""
        return cls(np.full(contacts, -np.inf), short=np.zeros(contacts, dtype=np.int64))

    def land(self, t: float, rows: Indices, short: float, low: Array) -> None:
        """Note an impact of these rows at t; a flight is short below one length, or below one of its own for each row."""
        flight = t - self.last[rows]
        self.short[rows] = np.where((flight < short) | (flight < low), self.short[rows] + 1, 0)
        self.note(t, rows)

    def take(self, burst: Burst) -> None:
        """Note the impacts of a burst: what meets on after it meets for the first time."""
        super().take(burst)
        self.short[:] = 0


@dataclass
class Run:
    """What travels from block to block."""

    system: System
    inputs: Inputs
    grid: Grid
    lcp_solver: str
    scale: Array
    forces: Array
    breakpoints: Array
    samples: Samples
    flights: Flights
    segment: Segment | None = None
    begun: Array = field(init=False)
    steps: Any = None
    first_step: float | None = None
    known: dict[object, Segment] = field(default_factory=dict)
    pieces: list[Piece] = field(default_factory=list)
    starts: list[float] = field(default_factory=list)
    events: list[float] = field(default_factory=list)

    @property
    def added(self) -> slice:
        """Where in the states of the system made linear those stand that are forces."""
        N = len(self.system.form.A)
        return slice(N, N + self.inputs.count)

    def without_inputs(self, X: Array) -> Array:
        """Return a state of the system made linear without them."""
        return np.delete(X, self.added) if self.inputs.count else X


@dataclass(frozen=True)
class EventDriven(Integrator):
    """SciPy's solvers between events.

    Parameters
    ----------
    ode_solver : str or OdeSolver class
        A method of `scipy.integrate.solve_ivp`: RK23, RK45, DOP853, Radau, BDF, LSODA; or a class like those.
    rtol : float
        Relative tolerance of the solver.
    atol : float
        Absolute tolerance in the units of each state: lower it for motions of micrometres.
    max_step : float
        Longest step in s, for loads that a long step might pass over.
    max_events : int
        Limit of events.
    max_steps : int
        Limit of steps of the solver, for motions that are stiff or vibrate fast for their length.
    zeno : float
        Impacts that accumulate are over when flights are shorter than this part of the run; 0 follows them to rounding.
    kinks : bool
        Whether the solver starts anew where a non-linear spring closes or opens.

    Raises
    ------
    InputError
        If an option cannot be used.

    Notes
    -----
    dt is the spacing of the output, and changes nothing else. The reaction is the force at each instant of the grid (its
    right limit at an event); impulses stand in the events. Where the dense output of a solver is of lower order than its
    steps, what is read between the steps, and so the instants of events, has the lower one.

    Examples
    --------
    >>> from lcpimpact import load_problem, simulate
    >>> ball = simulate(load_problem("bouncing-ball", e=0.5), "event-driven", dt=0.01, t_end=2.0)
    >>> f"{ball['x'][-1]:.6f} m, {ball['R'][-1]:.6f} N"
    '1.000000 m, 9.810000 N'
    """

    ode_solver: str | type = "DOP853"
    rtol: float = 1e-9
    atol: float = 1e-12
    max_step: float = math.inf
    max_events: int = 100_000
    max_steps: int = 500_000
    zeno: float = 1e-9
    kinks: bool = True

    name: ClassVar[str] = "event-driven"
    family: ClassVar[str] = "SciPy between events"
    mode_choice: ClassVar[str] = "modes.py"
    declared: ClassVar[Declared] = Declared(
        summary="SciPy's solvers between events, the mode by LCPs, and a fresh start after each event",
        order_smooth=math.inf,
        order_force_jump=math.inf,
        order_force_kink=math.inf,
        order_impact=math.inf,
        order_friction=math.inf,
        order_penetration=math.inf,
        level="position and velocity at events, acceleration between them",
        relative_degrees=(0, 1, 2),
        handles=tuple(Feature),
        reaction_lives="at t, right limit",
        energy="to the tolerance",
        balances_energy=True,
        dissipates=True,
        accuracy=1e-9,
        source="Pfeiffer and Glocker (1996)",
        adaptive="by the error control of the SciPy solver; dt is the spacing of the output",
    )

    def __post_init__(self) -> None:
        if isinstance(self.ode_solver, str) and self.ode_solver not in SCIPY_SOLVERS:
            raise InputError(nearest(self.ode_solver, list(SCIPY_SOLVERS), "solver of SciPy"))
        if not isinstance(self.ode_solver, str) and not (
            isinstance(self.ode_solver, type) and issubclass(self.ode_solver, integrate.OdeSolver)
        ):
            raise InputError(
                f"ode_solver = {self.ode_solver!r} must be one of {', '.join(SCIPY_SOLVERS)} or an OdeSolver class"
            )
        if not is_real(self.rtol) or not 1e-13 <= self.rtol < 1.0:
            raise InputError(f"rtol = {self.rtol!r} must lie between 1e-13 and 1: 1e-9 for nine digits")
        if not is_real(self.atol) or not self.atol > 0.0:
            raise InputError(f"atol = {self.atol!r} must be above zero, in the units of the states")
        if isinstance(self.max_step, bool) or not isinstance(self.max_step, int | float) or not self.max_step > 0.0:
            raise InputError(f"max_step = {self.max_step!r} must be a time above zero in s, or inf")
        for limit in ("max_events", "max_steps"):
            count(limit, getattr(self, limit))
        if not is_real(self.zeno) or not 0.0 <= self.zeno < 1.0:
            raise InputError(f"zeno = {self.zeno!r} must be a part of the run, 0 <= zeno < 1")
        if not isinstance(self.kinks, bool):
            raise InputError(f"kinks = {self.kinks!r} must be True or False")

    def reaction_times(self, grid: Grid) -> Array:
        """Return the grid."""
        return grid.times(0, grid.steps)

    def start(self, problem: Problem, grid: Grid, lcp_solver: str, record: Record) -> Run:
        """Choose the first mode and write the initial values; impacts at t = 0 come before them."""
        SOLVERS[lcp_solver]
        d = problem.dynamics
        form, inputs = forced_form(d, self.name)
        system = System(d, form, (inputs.E, inputs.D))
        refuse_mixed_degrees(system, self.name, except_schemes=True)
        if len(system.remembered) and inputs.D[:, len(inputs.law) :].any():
            slider = d.contacts[system.remembered[0]].name
            raise UnsupportedError(
                f"the slider {slider!r} of {problem.name!r} moves a spring under a load that is a function of time, which "
                f"{self.name!r} does not handle: give the load as {NAMED}, or take method='moreau-jean'"
            )
        X = system.state(problem.initial_coordinates, problem.initial_velocities)
        record.events = []
        breakpoints = form.breakpoints(0.0, grid.t_end)
        low = not inputs.count and issubclass(self._kind, SINGLE_STEP)
        run = Run(
            system, inputs, grid, lcp_solver, np.abs(X), np.zeros(inputs.count), breakpoints,
            _samples(SINGLE_STEP_DEGREE if low else DENSE_DEGREE), Flights.none(len(d.contacts)),
        )  # fmt: skip
        try:
            self._enter(run, record, 0.0, X, None, v=problem.initial_velocities)
        except np.linalg.LinAlgError:
            raise UnsupportedError(
                f"some contacts or sliders of {problem.name!r} hold together at the start in a way that leaves their shares "
                f"undetermined, which {self.name!r} does not handle: take method='moreau-jean'"
            ) from None
        assert run.segment is not None
        first = _state(run, run.segment, 0.0, run.begun)
        record.q[0], record.v[0], record.reaction[0] = first.q, first.v, first.reaction
        return run

    def advance(self, carry: Run, record: Record, first: int, last: int) -> tuple[Status, int]:
        """Step past t_last, and sample the block on the grid."""
        t_last = min(carry.grid.t_end * last / carry.grid.steps, carry.grid.t_end)
        status = Status.SOLVED
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            while status is Status.SOLVED and (not carry.pieces or carry.pieces[-1].end < t_last):
                status = self._step(carry, record)
        if status is not Status.SOLVED:
            reached_t = carry.pieces[-1].end if carry.pieces else 0.0
            reached = first + int(np.searchsorted(carry.grid.times(first, last), reached_t)) - 1
            _sample(carry, record, first + 1, reached)
            return status, max(reached, first)
        _sample(carry, record, first + 1, last)
        return Status.SOLVED, last

    def limits(self) -> Limits:
        """Return those of the tolerance; rebounds shorter than ``zeno`` times the run count as none."""
        # The dense output of a solver is of lower order than its steps, 7 beside 8 for DOP853: with a slack of 3, registered
        # problems show up to 20 rtol at 1e-6, random ones with sliders 1,000 rtol at 1e-8, and System No. 2 with a stiff
        # spring needs a slack of 24 at 1e-11.
        precision = max(self.declared.precision, 33.0 * self.rtol**0.8)
        return replace(super().limits(), precision=precision, order=5.0, rest=self.zeno, slack=48.0)

    def dense(self, carry: Run) -> ContinuousSolution:
        """Return the solution at any times of the run."""
        starts, ends = np.array(carry.starts), np.array([piece.end for piece in carry.pieces])
        parts = starts[:, None] + (ends - starts)[:, None] * np.arange(WORK_PARTS) / WORK_PARTS
        # Without its solver, which cannot be pickled, and is of no use any more.
        done = replace(carry, steps=None)
        return ContinuousSolution(partial(_read, done), np.append(parts.ravel(), ends[-1:]))

    def _step(self, run: Run, record: Record) -> Status:
        """Take one step of the solver, up to the first event in it."""
        segment, t_end = run.segment, run.grid.t_end
        assert segment is not None
        if len(run.pieces) >= self.max_steps:
            return Status.MAX_STEPS
        try:
            if run.steps is None:
                run.steps = self._solver(run, segment, run.begun)
            steps = run.steps
            steps.step()
        except InputError:  # a load that returns no number
            raise
        except (FloatingPointError, ValueError):  # SciPy's implicit solvers raise the latter for a matrix with NaN
            return Status.NON_FINITE
        record.stats.steps += 1
        if steps.status == "failed":
            return Status.STEP_SIZE
        if not np.isfinite(steps.y).all():
            return Status.NON_FINITE
        solution = steps.dense_output()
        found = _first_root(segment, run.samples, run.scale, steps.t_old, steps.t, solution, self.atol)
        if steps.status == "finished" and not found:
            within = min(max(self.rtol, MIN_TIME_RTOL), MAX_TIME_RTOL) * t_end
            found = _root_at_end(segment, run.samples, run.scale, steps.t_old, steps.t, solution, within)
        τ, row = found or (steps.t, -1)
        t = segment.end if steps.status == "finished" and not found else min(segment.t0 + τ, segment.end)
        breakpoint = segment.breaks and t == segment.end
        X = solution(τ) if found else steps.y
        run.scale = np.maximum(run.scale, np.abs(X))
        if run.inputs.count:
            run.forces = np.maximum(run.forces, np.abs(segment.forces(segment.t0 + τ, X)))
        run.starts.append(segment.t0 + steps.t_old)
        run.pieces.append(Piece(segment, t, solution))
        if steps.status == "finished" or found:
            record.stats.evaluations += steps.nfev
            run.first_step = float(getattr(steps, "h_abs", 0.0)) or None
        if not breakpoint and not found:
            return Status.SOLVED
        if found:
            run.events.append(t)
        stalled = len(run.events) > MAX_EVENTS_AT_ONCE and run.events[-MAX_EVENTS_AT_ONCE] == t
        if stalled or len(run.events) > self.max_events:
            return Status.MAX_EVENTS
        turn = row - (len(segment.rows) - len(segment.phases)) if found else -1
        try:
            return self._enter(run, record, t, X, segment.phases[turn] if turn >= 0 else None, breakpoint)
        except FailureError as failure:
            status: Status = failure.result.status
            return status
        except np.linalg.LinAlgError:
            return Status.SINGULAR

    def _phase(self, run: Run, X: Array, turned: tuple[int, int] | None) -> Indices | None:
        """Return what each spring does from X on; ``turned`` is one that has just gone over to another phase."""
        inputs, old = run.inputs, run.segment
        if not self.kinks or not len(inputs.law):
            return NO_PHASE if self.kinks else None
        δ, rate = (
            rows @ X[: len(run.system.form.A)] for rows in (inputs.approach, inputs.approach @ run.system.form.A)
        )
        if old is None or old.forces.phase is None:
            touches = (δ > 0.0) | ((δ == 0.0) & (rate > 0.0))
        else:
            touches = old.forces.phase != APART
        pulls = (inputs.law[:, 4] > 0.0) & (Forces(inputs, None).extended(X) <= 0.0)
        phase = np.where(touches, np.where(pulls, SLACK, PUSHES), APART)
        if turned is not None:
            phase[turned[0]] = turned[1]
        return phase

    def _enter(
        self,
        run: Run,
        record: Record,
        t: float,
        X: Array,
        turned: tuple[int, int] | None,
        breakpoint: bool = False,
        v: Array | None = None,
    ) -> Status:
        """Begin a segment at t: impacts, the mode, the events that this makes, and a solver for what follows.

        At a ``breakpoint`` the signals in X are left limits, and go over to the right ones. Before the start of the run the
        velocities are v (n,).
        """
        system, old = run.system, run.segment
        assert record.events is not None
        run.scale = np.maximum(run.scale, np.abs(X))
        kept = still(system, old.mode if old else None)
        state = settled(system, old.mode if old else None, DoubleDouble.of(X), run.scale)
        approach = None
        if breakpoint:
            approach, state = state, system.form.right_of(t, state, run.scale)
            kept = replace(kept, U=np.zeros_like(kept.U))

        u, U = (each.hi for each in gaps(system, state, run.scale, kept))
        rates = None if v is None else system.dynamics.gap_rate(v)
        if old and len(system.lines):
            closed = np.isin(np.arange(len(u)), old.mode.closed)
            rates = np.where(closed, 0.0, system.dynamics.gap_rate(_state(run, old, t - old.t0, X).v))
        meets = system.meets & (u <= 0.0) & (U < 0.0)
        if len(system.lines) and rates is not None:
            P = impact(system, state, run.scale, run.lcp_solver, None, kept, left=approach, rates=rates)[1]
            meets, U = (P > 0.0) & (rates < 0.0), rates
        landing = np.flatnonzero(meets)
        short, flights = self.zeno * run.grid.t_end, run.flights
        quick = flights.quick(system, t, landing, U, run.scale, short)
        restitution = system.restitution
        if len(landing):
            rounding = ZERO_RTOL * (np.abs(system.matrices[2][landing]) @ run.scale)
            lost = rounding / np.maximum(-U[landing], TINY)
            if not system.mixed and (np.abs((system.fine.C[landing] @ state).hi) > rounding).any():
                # A root is found to the rounding of a dense output; from impact to impact that would add up.
                met = kept.u.copy()
                met[landing] = True
                state = settled(system, None, state, run.scale, replace(kept, u=met))
            flights.land(t, landing, short, lost)
            if not quick:
                over = (flights.short >= MIN_FLIGHTS) & (restitution < 1.0)
                restitution = np.where(over, 0.0, restitution)
        pushed, P, kept = impact(
            system, state, run.scale, run.lcp_solver, restitution, kept, left=approach, rates=rates
        )
        forces = Forces(run.inputs, self._phase(run, pushed.hi, turned))
        mode, chosen = choose_mode(*_about(run, t, pushed.hi, forces), run.lcp_solver, kept)
        after = run.without_inputs(chosen.hi)

        new = self._segment(run, t, mode, forces)
        left = _state(run, old, t - old.t0, X) if old else _state(run, new, 0.0, X)
        if v is not None:
            left = replace(left, v=v)
        record.events += happened(system, t, old.mode if old else mode, mode, P, left, _state(run, new, 0.0, after))
        status = Status.SOLVED
        if quick and t < run.grid.t_end:
            status, new, after = self._burst(run, record, new, after, quick)
        run.segment = new
        if new.t0 >= run.grid.t_end:
            # What follows an event at the very end is its right limit.
            run.starts.append(new.t0)
            run.pieces.append(Piece(new, new.t0, AtRest(after)))
            return status
        run.steps, run.begun = None, after
        return status

    def _burst(self, run: Run, record: Record, first: Segment, X: Array, short: float) -> tuple[Status, Segment, Array]:
        """Follow impacts that come in quick succession after X, with the forces made linear: what goes on, and its state."""
        assert record.events is not None
        t, forces, inputs = first.t0, first.forces, run.inputs
        system, grown, scale = _about(run, t, X, forces)
        most = MAX_BURST_FLIGHTS * short if inputs.count else math.inf
        left = max(self.max_events - len(run.events), 1)
        burst = follow_burst(
            system,
            t,
            DoubleDouble.of(grown),
            first.mode,
            scale,
            solver=run.lcp_solver,
            end=run.grid.t_end,
            short=short,
            max_events=left,
            most=most,
        )
        for each, end in burst.passed:
            run.starts.append(each.t0)
            flow, _ = system.mode(each.mode)
            solution = InBurst(flow, each.state, run.added)
            run.pieces.append(Piece(self._segment(run, each.t0, each.mode, forces), end, solution))
        record.events += burst.events
        run.events += sorted({event.t for event in burst.events})
        run.flights.take(burst)
        run.scale = np.maximum(run.scale, run.without_inputs(burst.motion.scale))
        last, status = burst.last, burst.status
        there = run.without_inputs(last.X)
        if inputs.count and status is Status.SOLVED and last.t0 > t:
            bent = np.abs(Forces(inputs, None)(last.t0, there) - forces.linear(t, X, last.t0, there, _short(run)))
            if (bent > MAX_BURST_FLIGHTS * SHORT_FLIGHT * run.forces).any():
                status = Status.ACCUMULATION
        return status, self._segment(run, last.t0, last.mode, forces), there

    def _segment(self, run: Run, t: float, mode: Mode, forces: Forces) -> Segment:
        """Return the segment of a mode that begins at t."""
        key = mode, None if forces.phase is None else tuple(forces.phase.tolist())
        if key not in run.known:
            run.known[key] = _course(run, mode, forces)
        later = int(run.breakpoints.searchsorted(t, side="right"))
        breaks = later < len(run.breakpoints)
        return replace(
            run.known[key], t0=t, end=float(run.breakpoints[later]) if breaks else run.grid.t_end, breaks=breaks
        )

    @property
    def _kind(self) -> Any:
        """The class of the solver."""
        return getattr(integrate, self.ode_solver) if isinstance(self.ode_solver, str) else self.ode_solver

    def _solver(self, run: Run, segment: Segment, X: Array) -> Any:
        """Return a solver that starts from X."""
        kind = self._kind
        length, A, guarded = segment.end - segment.t0, segment.A, Guarded(segment)
        rate: Any = guarded if run.inputs.count else lambda τ, X: A @ X
        options: dict[str, Any] = {"rtol": self.rtol, "atol": self.atol, "max_step": self.max_step}
        if _takes_jacobian(kind):
            options["jac"] = segment.jacobian
        # What bends away from zero is seen well in a short step only.
        if run.first_step and issubclass(kind, SINGLE_STEP) and (segment.order < 2).all():
            # The step before is as good a guess as SciPy's, and costs nothing: the error of the step is judged all the same.
            options["first_step"] = min(run.first_step, length)
        try:
            solver = kind(rate, 0.0, X, length, **options)
        except FloatingPointError:
            # What fails may lie ahead: a step that is short enough does not come upon it.
            solver = kind(rate, 0.0, X, length, **options, first_step=SHORT_FLIGHT * length)
        guarded.begun = True
        return solver


@cache
def _takes_jacobian(kind: type) -> bool:
    """Return whether a solver can be given the Jacobian."""
    return "jac" in inspect.signature(kind).parameters


def _course(run: Run, mode: Mode, forces: Forces) -> Segment:
    """Return a segment of a mode, at no instant yet."""
    system, inputs = run.system, run.inputs
    flow, F = system.mode(mode)
    Fw = system.input_response(mode)
    E = system.input_matrices[0] + system.matrices[1] @ Fw
    # What is zero for ever in a linear system need not stay so under an input.
    contacts, ends, zeros = system.watched(
        replace(mode, order=tuple(max(m, 0) for m in mode.order)) if inputs.count else mode
    )
    zeros = np.where(np.array(mode.order, dtype=np.int64)[contacts] >= 0, zeros, ZERO_FOR_EVER)
    ns = len(inputs.law)
    springs: tuple[tuple[int, int], ...] = ()
    rows, order = [np.pad(row, (0, ns)) for row in ends.hi], zeros.tolist()
    if forces.phase is not None:
        springs, falls = _spring_ends(inputs, forces.phase, len(flow.A))
        rows += falls
        order += [0] * len(falls)
    n, reading = len(system.dynamics.nodes), system.coordinates(mode).rows.hi
    return Segment(
        0.0,
        0.0,
        False,
        mode,
        flow.A,
        E,
        forces,
        np.array(rows).reshape(len(rows), len(flow.A) + inputs.count + ns),
        np.array(order, dtype=np.int64),
        springs,
        (reading[:n], inputs.Q + system.read[1] @ Fw),
        (F, Fw),
        reading[n : 2 * n],
    )


def _spring_ends(inputs: Inputs, phase: Indices, states: int) -> tuple[tuple[tuple[int, int], ...], list[Array]]:
    """Return how the phases of the springs end: spring and next phase, and the row of (X, w, s) that falls below zero."""
    ns, known = len(phase), inputs.approach.shape[1]
    turns: list[tuple[int, int]] = []
    rows: list[Array] = []
    for j in range(ns):
        place, force = np.zeros(states + inputs.count + ns), np.zeros(states + inputs.count + ns)
        place[:known], force[states + inputs.count + j] = inputs.approach[j], 1.0
        lossy = inputs.law[j, 4] > 0.0
        if phase[j] == APART:
            turns.append((j, PUSHES))
            rows.append(-place)
        elif phase[j] == PUSHES:
            turns.append((j, SLACK if lossy else APART))
            rows.append(force if lossy else place)
        else:
            turns += [(j, PUSHES), (j, APART)]
            rows += [-force, place]
    return tuple(turns), rows


def _about(run: Run, t: float, X: Array, forces: Forces) -> tuple[System, Array, Array]:
    """Return the system made linear about t and X, with X and its scale in it.

    With w = a + S X + a' τ the numbers a are states, the last before the places of sliders, so that each has its scale.
    """
    system, inputs = run.system, run.inputs
    if not inputs.count:
        return system, X, run.scale
    form, N, nw = system.form, len(system.form.A), inputs.count
    w, slope = forces(t, X), forces.jacobian(X)[:, :N]
    run.forces = np.maximum(run.forces, np.abs(w))
    A = np.block([[form.A + inputs.E @ slope, inputs.E], [np.zeros((nw, N + nw))]])
    A[N + len(inputs.law) :, form.constant] = forces.load_rates(t, _short(run), ahead=True)
    linear = replace(
        form,
        A=A,
        B=np.vstack([form.B, np.zeros((nw, form.B.shape[1]))]),
        C=np.column_stack([form.C + inputs.D @ slope, inputs.D]),
        Q=np.column_stack([form.Q + inputs.Q @ slope, inputs.Q]),
        signals=np.append(form.signals, np.zeros(nw)),
        low=None,
    )
    grown = np.concatenate([X[:N], w - slope @ X[:N], X[N:]])
    return System(system.dynamics, linear), grown, np.concatenate([run.scale[:N], run.forces, run.scale[N:]])


def _short(run: Run) -> float:
    """Return the step in s of the difference quotients of loads."""
    return 1e-6 * run.grid.t_end


def _first_root(
    segment: Segment, samples: Samples, scale: Array, start: float, end: float, solution: Any, atol: float
) -> tuple[float, int] | None:
    """Return the first instant in a step at which a watched row falls below zero, and which row."""
    if not len(segment.rows):
        return None
    width = end - start
    τ = start + width * samples.points
    terms = segment.watched(τ, solution(τ).T)
    b = samples.fit @ (terms @ segment.rows.T)
    size = _size(segment, scale, terms)
    found: list[tuple[float, int]] = []
    for k, row in enumerate(segment.rows):
        # A zero of order m at the start of the segment is a factor sᵐ, and what the row has there is rounding.
        m = min(max(int(segment.order[k]), 0), len(samples.divided) - 1) if start == 0.0 else 0
        zero = float(b[0, k]) if m else 0.0
        coefficients = (b[m:, k] - zero) * samples.divided[m]
        floor = float(samples.noise * size[k] * samples.divided[m][0])
        if segment.order[k] == ZERO_FOR_EVER:
            floor += atol * float(np.abs(row).sum())
        if coefficients.min() >= -floor:
            continue
        s = first_fall(np.array([coefficients, np.zeros_like(coefficients)]), -floor)
        if math.isnan(s):
            continue
        if segment.order[k] == ZERO_FOR_EVER:
            # It falls below zero from zero itself: what counts is where it is below it by more than the tolerance.
            found.append((start + s * width, k))
            continue
        s, slope = _falls(coefficients, s)
        root = _Root(segment, row, solution, EPS * float(size[k]), samples.noise * float(size[k]) + 2.0 * abs(zero))
        found.append((root.near(start + s * width, s**m * slope / width, start, None if m else end), k))
    return min(found) if found else None


def _root_at_end(
    segment: Segment, samples: Samples, scale: Array, start: float, end: float, solution: Any, within: float
) -> tuple[float, int] | None:
    """Return when a row falls below zero at the end of a step, or less than ``within`` s after it, and which row."""
    if not len(segment.rows):
        return None
    τ = np.array([end - LOOK_BACK * (end - start), end])
    terms = segment.watched(τ, solution(τ).T)
    before, last = terms @ segment.rows.T
    size = _size(segment, scale, terms)
    fall = np.where((before > samples.noise * size) & (segment.order != ZERO_FOR_EVER), before - last, 0.0)
    falling = np.flatnonzero((fall > 0.0) & (last * (τ[1] - τ[0]) <= fall * within))
    if not len(falling):
        return None
    k = int(falling[np.argmin(last[falling] / fall[falling])])
    ahead = float(last[k] / fall[k] * (τ[1] - τ[0]))
    if ahead <= 0.0:
        return end, k
    return _Root(segment, segment.rows[k], solution).near(end + ahead, 0.0, end, end + within), k


def _size(segment: Segment, scale: Array, terms: Array) -> Array:
    """Return the sum of the absolute terms of the watched rows, for samples (nt, ...) of them."""
    size = np.abs(terms).max(axis=0)
    size[: len(scale)] = np.maximum(size[: len(scale)], scale)
    return np.asarray(np.abs(segment.rows) @ size)


def _falls(b: Array, below: float) -> tuple[float, float]:
    """Return where the polynomial on [0, 1] with Bernstein coefficients b falls through zero, at or before ``below``.

    The slope there comes with it; where the polynomial is not above zero before, that is ``below`` itself.
    """
    s = below
    for _ in range(NEWTON_STEPS):
        value, slope = casteljau(b, s)
        if not slope < 0.0:
            break
        last, s = s, s - value / slope
        if not 0.0 < s <= below:
            break
        if abs(s - last) <= ROOT_RTOL * s:
            return float(s), float(slope)
    back = 1e-15 * below
    while casteljau(b, below)[0] < 0.0 and not casteljau(b, max(below - back, 0.0))[0] > 0.0:
        if below <= back:
            return below, float(casteljau(b, below)[1])
        back *= 8.0
    if casteljau(b, below)[0] < 0.0:
        below = float(brentq(lambda s: casteljau(b, s)[0], max(below - back, 0.0), below, xtol=1e-300, rtol=ROOT_RTOL))
    return below, float(casteljau(b, below)[1])


@dataclass(frozen=True, eq=False)
class _Root:
    """The fall of a row of a segment through zero, on the dense output itself.

    Values below ``rounding`` tell nothing; the polynomial through the samples, whose root is known, differs by ``blurred``.
    """

    segment: Segment
    row: Array
    solution: Any
    rounding: float = 0.0
    blurred: float = 0.0

    def value(self, τ: float) -> float:
        """Return what the row has."""
        if not self.segment.E.shape[1]:
            return float(self.row @ self.solution(τ))
        at = np.array([τ])
        return float((self.segment.watched(at, self.solution(at).T) @ self.row)[0])

    def near(self, τ: float, slope: float, start: float, end: float | None) -> float:
        """Return the root near τ, or τ where the values there are rounding.

        A negative ``slope`` of the row there is known, or it is 0. Without an ``end`` the row begins at zero, and only a
        root close to τ is another one.
        """
        # What the polynomial through the samples lacks of a smooth row is rounding, and Newton's method mends it.
        root, best, least = τ, τ, math.inf
        about = max(INTERPOLATION_RTOL * (τ - start), self.blurred / max(-slope, TINY))
        for _ in range(NEWTON_STEPS if slope < 0.0 else 0):
            u = self.value(root)
            if abs(u) <= -slope * ROOT_RTOL * root:
                return root
            if not abs(u) < 0.5 * least:
                break
            best, least, root = root, abs(u), root - u / slope
            if not start < root < τ + about or root < τ - about:
                break
        if least <= self.rounding:
            return best
        width, widest = 1e-15 * (τ - start), 1e-4 * (τ - start) if end is None else end - start
        while 0.0 < width < widest:
            before, after = max(τ - width, start), τ + width if end is None else min(τ + width, end)
            if self.value(before) > 0.0 > self.value(after):
                root = float(brentq(self.value, before, after, xtol=1e-300, rtol=ROOT_RTOL))
                # Where a load jumps, the event is the first instant after the jump.
                step = float(np.spacing(self.segment.t0 + root))
                while self.value(root) > 0.0 and root + step < after:
                    root, step = root + step, 2.0 * step
                return root
            width *= 8.0
        return τ


def _coordinates(run: Run, segment: Segment, τ: Array, X: Array) -> tuple[Array, Array, Array]:
    """Return q, v and r for the states X (nt, N) at t0 + τ."""
    (place, place_w), (F, Fw), (low, high) = segment.place, segment.reaction, run.system.bounds
    if not run.inputs.count:
        return X @ place.T, X @ segment.velocity.T, np.minimum(np.maximum(X @ F.T, low), high)
    w = segment.forces(segment.t0 + τ, X)
    q, v = X @ place.T + w @ place_w.T, segment.rate(τ, X) @ place.T
    loads = place_w[:, len(run.inputs.law) :]
    if loads.any():
        rates = [segment.forces.load_rates(segment.t0 + at, _short(run), ahead=False) for at in τ]
        v += np.array(rates).reshape(len(τ), -1) @ loads.T
    return q, v, np.minimum(np.maximum(X @ F.T + w @ Fw.T, low), high)


def _state(run: Run, segment: Segment, τ: float, X: Array) -> State:
    """Return what one state means in the coordinates of the scheme."""
    q, v, r = _coordinates(run, segment, np.array([τ]), X[None, :])
    return State(q[0], v[0], r[0])


def _read(run: Run, t: Array, side: str) -> tuple[Array, Array, Array]:
    """Return q, v and r at the times t, which must be sorted; ``side`` tells which limit is meant at an event."""
    owner = np.maximum(np.searchsorted(run.starts, t, side="right" if side == "right" else "left") - 1, 0)
    n, nc = len(run.system.dynamics.nodes), len(run.system.degree)
    q, v, r = np.empty((len(t), n)), np.empty((len(t), n)), np.empty((len(t), nc))
    cuts = np.flatnonzero(np.diff(owner, prepend=-1, append=len(run.pieces)))
    for mine in map(slice, cuts[:-1], cuts[1:]):
        piece = run.pieces[owner[mine.start]]
        τ = t[mine] - piece.segment.t0
        q[mine], v[mine], r[mine] = _coordinates(run, piece.segment, τ, piece.solution(τ).T)
    return q, v, r


def _sample(run: Run, record: Record, first: int, last: int) -> None:
    """Write the grid points first ... last to the record."""
    here = slice(first, last + 1)
    record.q[here], record.v[here], record.reaction[here] = _read(run, record.t[here], "right")
