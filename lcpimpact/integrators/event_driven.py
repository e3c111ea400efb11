r"""Event-driven integration by SciPy's adaptive solvers: modes by LCPs, events on the dense output, a restart after each.

In a contact mode r = F X + F_w w, and the motion is a smooth initial value problem,

.. math:: X' = (A + B F) X + (E + B F_w) w(t, X),

with w the forces of the non-linear springs, the general forces, and the loads that are arbitrary functions of time (see
`lcpimpact.scheme.first_order`). Any solver of `scipy.integrate` may follow it. The modes, their ends and the impacts are
those of `lcpimpact.hybrid`; where w is present they are chosen for the system made linear about the event.

*Events.* The dense output of a step is a polynomial. It is sampled at Chebyshev points and written in the Bernstein basis,
whose coefficients bound it; a step is free of events only if they are all positive. So two sign changes within a step are
detected, however close, down to rounding. The root is then located on the dense output itself.

*Accumulating impacts.* When three flights in a row of a contact with e < 1 are each shorter than ``zeno`` times the length
of the run, or lost in the rounding of the gap, its next impact has e = 0 and the contact stays closed.
A flight of T omits e T/(1 - e), which is the error of the end of the accumulation. (Flights need not shrink
monotonically: with several bodies they do not.)

*Several bodies.* If a second contact has an impact within a time that is short against the flights of the run, the impacts
that follow are computed by `lcpimpact.hybrid.motion` in double-doubles, with linearised forces w, until flights are long
again or the bodies stay in contact (see `lcpimpact.hybrid.burst`). If the forces are too nonlinear for that, the run ends
with the status ACCUMULATION.

*Long runs.* A free flight of 1e5 s of bodies joined by springs is accurate to 1e-12 of its length; stiff vibrations still
cost steps, and at ``max_steps`` the run ends with a message.

*Closed contacts* are imposed at acceleration level. The drift of their gaps by rounding is removed at each event.

*Lagrangian systems* have modes of their own (see `lcpimpact.hybrid.moving_modes`). Where friction leaves no acceleration, an
impulse follows, an event of the kind "jam". A jam at which forces grow without limit is found some 1e-11 s before it.

*The last instant.* An event is known to about rtol. One that is found after the end of the run by less than that, and by
less than 1e-9 of its length, is at its end, and is kept.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, ClassVar

import numpy as np
from scipy import integrate
from scipy.integrate import OdeSolver

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.errors import InputError, Status, UnsupportedError
from lcpimpact.hybrid.burst import SHORT_FLIGHT_RTOL, ImpactHistory, follow_burst, passed
from lcpimpact.hybrid.contact_loop import MIN_FLIGHTS
from lcpimpact.hybrid.dense_output import (
    DENSE_DEGREE,
    SINGLE_STEP_DEGREE,
    AtRest,
    EventDrivenSolution,
    InBurst,
    Piece,
    SolverLoop,
    samples_of,
)
from lcpimpact.hybrid.event_loop import Ending, refuse_undetermined
from lcpimpact.hybrid.forced_modes import ForcedSegment, ForcedSystem, Forces, SpringPhase
from lcpimpact.hybrid.gaps import gaps, project, settled, still
from lcpimpact.hybrid.impacts import impact
from lcpimpact.hybrid.mode_choice import choose_mode
from lcpimpact.hybrid.moving import ONE_STEP_SOLVERS, MovingMotion, SolverOptions, expected_scale_of_motion
from lcpimpact.hybrid.system import ZERO, Mode, Still, System, refuse_mixed_degrees
from lcpimpact.hybrid.transition import arrive, happened
from lcpimpact.integrators.base import Declared, Integrator, Limits
from lcpimpact.numbers import count, is_real
from lcpimpact.numerics.double_double import DoubleDouble
from lcpimpact.numerics.rounding import EPS, TINY
from lcpimpact.problems.base import Problem
from lcpimpact.record import ContinuousSolution, Grid, Record, Stats
from lcpimpact.registry import nearest
from lcpimpact.scheme.first_order import Inputs
from lcpimpact.scheme.impact_laws import IMPACT_LAWS
from lcpimpact.scheme.lagrangian import LagrangianDynamics
from lcpimpact.scheme.signals import SIGNAL_NAMES
from lcpimpact.scheme.structure import Feature

SCIPY_SOLVERS = ("RK23", "RK45", "DOP853", "Radau", "BDF", "LSODA")

MIN_TIME_RTOL, MAX_TIME_RTOL = 1e-12, 1e-9
"""Bounds of the accuracy of instants, relative to the run, whatever rtol is."""

NO_PHASE = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True)
class EventDriven(Integrator):
    """SciPy's solvers between events.

    Parameters
    ----------
    ode_solver : str or OdeSolver class
        A method of `scipy.integrate.solve_ivp`: RK23, RK45, DOP853, Radau, BDF, LSODA; or a class like those.
    rtol : float
        Relative tolerance of the solver.
    atol : float, optional
        Absolute tolerance in the units of each state; by default rtol / 10,000 of the scale that the state has.
    max_step : float
        Longest step in s, for loads that a longer step might miss.
    max_events : int
        Maximum number of events.
    max_steps : int
        Maximum number of steps of the solver, for stiff motions.
    zeno : float
        Duration of a flight, relative to the run, below which accumulating impacts end; 0 follows them to rounding.
    kinks : bool
        Whether the solver restarts where a non-linear spring closes or opens.

    Raises
    ------
    InputError
        If an option cannot be used.

    Notes
    -----
    dt is the spacing of the output, and changes nothing else. The reaction is the force at each instant of the grid (its
    right limit at an event); impulses are in the events. If the dense output of a solver is of lower order than its steps,
    so are the values between steps and the instants of events. Each breakpoint of a signal, as each event, begins a solver
    anew, which takes some 2 ms: a load that jumps ten thousand times takes over 20 s.

    Examples
    --------
    >>> from lcpimpact import load_problem, simulate
    >>> ball = simulate(load_problem("bouncing-ball", e=0.5), "event-driven", dt=0.01, t_end=2.0)
    >>> f"{ball['x'][-1]:.6f} m, {ball['R'][-1]:.6f} N"
    '1.000000 m, 9.810000 N'
    """

    ode_solver: str | type = "DOP853"
    rtol: float = 1e-9
    atol: float | None = None
    max_step: float = math.inf
    max_events: int = 100_000
    max_steps: int = 500_000
    zeno: float = 1e-9
    kinks: bool = True

    name: ClassVar[str] = "event-driven"
    narrowest: ClassVar[float] = ZERO
    family: ClassVar[str] = "SciPy between events"
    mode_choice: ClassVar[str] = "mode_choice.py"
    declared: ClassVar[Declared] = Declared(
        summary="SciPy's solvers between events, modes by LCPs, a restart after each event",
        order_smooth=math.inf,
        order_loss=math.inf,
        order_force_jump=math.inf,
        order_force_kink=math.inf,
        order_impact=math.inf,
        order_friction=math.inf,
        order_relay=math.inf,
        order_penetration=math.inf,
        level="position and velocity at events, acceleration between them",
        relative_degrees=(0, 1, 2),
        handles=tuple(Feature),
        impact_laws=tuple(IMPACT_LAWS),
        reaction_time="at t, right limit",
        energy="to the tolerance",
        balances_energy=True,
        dissipates=True,
        accuracy=1e-9,
        source="PfeifferGlocker1996",
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
        if self.atol is not None and (not is_real(self.atol) or not self.atol > 0.0):
            raise InputError(f"atol = {self.atol!r} must be above zero, in the units of the states")
        if isinstance(self.max_step, bool) or not isinstance(self.max_step, int | float) or not self.max_step > 0.0:
            raise InputError(f"max_step = {self.max_step!r} must be a time above zero in s, or inf")
        for limit in ("max_events", "max_steps"):
            count(limit, getattr(self, limit))
        if not is_real(self.zeno) or not 0.0 <= self.zeno < 1.0:
            raise InputError(f"zeno = {self.zeno!r} must be a part of the run, 0 <= zeno < 1")
        if not isinstance(self.kinks, bool):
            raise InputError(f"kinks = {self.kinks!r} must be True or False")

    def start(self, problem: Problem, grid: Grid, lcp_solver: str, record: Record) -> SolverMotion | MovingMotion:
        """Choose the first mode and write the initial values; impacts at t = 0 come before them."""
        d = problem.dynamics
        if isinstance(d, LagrangianDynamics):
            return self._start_moving(problem, d, grid, lcp_solver, record)
        forced = ForcedSystem.of(d, grid.t_end, self.name)
        system, inputs = forced.system, forced.inputs
        form = system.form
        refuse_mixed_degrees(system, self.name, except_contacts=True)
        if len(system.remembered) and inputs.D[:, inputs.of_state :].any():
            slider = d.contacts[system.remembered[0]].name
            raise UnsupportedError(
                f"the slider {slider!r} of {problem.name!r} moves a spring under a load that is a function of time, which "
                f"{self.name!r} does not handle: give the load as {SIGNAL_NAMES}, or ",
                ("moreau-jean",),
            )
        early = (
            d.bilateral & (d.relative_degree == 2) & (system.matrices[2] @ system.input_matrices[0] != 0.0).any(axis=1)
        )
        if early.any() and not d.stores_energy:
            raise UnsupportedError(
                f"the equation of {d.contacts[int(np.argmax(early))].name!r} has relative degree 2, so λ depends on the "
                f"derivative of a(t); {self.name!r} does not know that of a function of time: "
                f"give it as {SIGNAL_NAMES}, or ",
                ("moreau-jean",),
            )
        X = system.state(problem.initial_coordinates, problem.initial_velocities)
        set_ = form.sampled(0.0, DoubleDouble.of(X), np.abs(X)).hi
        record.events = []
        low = not inputs.count and issubclass(self.solver_class, ONE_STEP_SOLVERS)
        motion = SolverMotion(
            system, grid.t_end, lcp_solver, self.max_events, form.breakpoints(0.0, grid.t_end), np.abs(X),
            method=self, events=record.events, stats=record.stats, forced=forced,
            samples=samples_of(SINGLE_STEP_DEGREE if low else DENSE_DEGREE),
            impact_history=ImpactHistory.none(len(d.contacts)), sizes=np.zeros(inputs.count),
            expected=expected_scale(system, inputs, set_, grid.t_end),
        )  # fmt: skip
        with refuse_undetermined(problem, self.name):
            motion.begin_segment(0.0, X, v=problem.initial_velocities)
        first = motion.forced.state(motion.segment, 0.0, motion.begun)
        record.q[0] = first.q
        record.v[0] = first.v
        record.reaction[0] = first.reaction
        return motion

    def _start_moving(
        self, problem: Problem, d: LagrangianDynamics, grid: Grid, lcp_solver: str, record: Record
    ) -> MovingMotion:
        """Do the same for a Lagrangian system."""
        q, v = problem.initial_coordinates, problem.initial_velocities
        motion = self.moving_motion(d, q, v, grid.t_end, lcp_solver)
        record.events, record.stats = motion.events, motion.stats
        motion.begin(problem, record, self.name)
        return motion

    def moving_motion(self, d: LagrangianDynamics, q: Array, v: Array, end: float, lcp_solver: str) -> MovingMotion:
        """Return the motion of a Lagrangian system that is to begin near a state, up to an instant."""
        options = SolverOptions(self.solver_class, self.rtol, self.atol, self.max_step, self.max_steps, self.zeno)
        return MovingMotion(
            d, end, lcp_solver, self.max_events, np.zeros(0), np.abs(np.concatenate([q, v])), options=options,
            events=[], stats=Stats(), samples=samples_of(DENSE_DEGREE), expected=expected_scale_of_motion(d, q, v, end),
        )  # fmt: skip

    def advance(self, carry: SolverMotion | MovingMotion, record: Record, first: int, last: int) -> tuple[Status, int]:
        """Step past t_last, and sample the block on the grid."""
        return carry.advance(record, first, last)

    def limits(self, *, unresolved_kink_rtol: float = 1e-6) -> Limits:
        """Return the limits that follow from rtol; rebounds shorter than ``zeno`` times the run are suppressed.

        ``unresolved_kink_rtol``: smallest relative tolerance of the certificate for steps across kinks.
        """
        # The dense output of a solver is of lower order than its steps, 7 beside 8 for DOP853: with a slack of 3, registered
        # problems show up to 20 rtol at 1e-6, random ones with sliders 1,000 rtol at 1e-8, and System No. 2 with a stiff
        # spring needs a slack of 24 at 1e-11.
        rtol = self.rtol if self.kinks else max(self.rtol, unresolved_kink_rtol)
        precision = max(self.declared.precision, 33.0 * rtol**0.8)
        return replace(super().limits(), precision=precision, order=5.0, rest=self.zeno, slack=48.0)

    def dense(self, carry: SolverMotion | MovingMotion, *, work_parts: int = 4) -> ContinuousSolution:
        """Return the solution at any times of the run.

        ``work_parts``: number of subintervals of a step in the quadrature of its work.
        """
        solution = carry.solution
        starts, ends = np.array([(piece.start, piece.end) for piece in solution.pieces]).reshape(-1, 2).T
        parts = starts[:, None] + (ends - starts)[:, None] * np.arange(work_parts) / work_parts
        return ContinuousSolution(solution, np.append(parts.ravel(), ends[-1:]))

    @property
    def solver_class(self) -> Any:
        """The class of the solver."""
        return getattr(integrate, self.ode_solver) if isinstance(self.ode_solver, str) else self.ode_solver


@dataclass(eq=False, kw_only=True)
class SolverMotion(SolverLoop[System, ForcedSegment]):
    """A motion whose modes are linear but for its forces."""

    method: EventDriven
    forced: ForcedSystem
    solution: EventDrivenSolution = field(init=False)
    impact_history: ImpactHistory
    sizes: Array
    """Largest forces |w| so far (nw,)."""
    rates: dict[Hashable, float] = field(default_factory=dict)
    """Largest |eigenvalue| of the matrix of each mode so far in 1/s."""

    def __post_init__(self) -> None:
        self.solution = EventDrivenSolution(self.forced, self.pieces)

    def step(self) -> Ending | Status:
        """Take one step of the solver, up to the first event in it."""
        if len(self.pieces) >= self.method.max_steps:
            return Status.MAX_STEPS
        if (status := self._advance_solver()) is not Status.SOLVED:
            return status
        segment = self.segment
        within = min(max(self.method.rtol, MIN_TIME_RTOL), MAX_TIME_RTOL) * self.end
        ending = self.keep_step(self.scale, self._absolute_tolerance, within)
        if self.forced.inputs.count:
            self.sizes = np.maximum(self.sizes, np.abs(segment.forces(ending.t, ending.X)))
        breakpoint = segment.breaks and ending.t == segment.end
        return ending._replace(breakpoint=breakpoint) if ending.row >= 0 or breakpoint else Status.SOLVED

    def _fastest_rate(self, segment: ForcedSegment) -> float:
        """Return the largest |eigenvalue| of the matrix of a segment in 1/s."""
        if segment.mode.key not in self.rates:
            self.rates[segment.mode.key] = float(np.abs(np.linalg.eigvals(segment.A)).max(initial=0.0))
        return self.rates[segment.mode.key]

    def _absolute_tolerance(self, *, atol_factor: float = 1e-4, atol_floor: float = 1e-6) -> Array:
        """Return the absolute tolerance of each state (N,), relative to its scale so far if no other is given.

        ``atol_factor``: absolute tolerance, in units of rtol times the scale of a state.
        ``atol_floor``: smallest scale of a state in its tolerance, relative to the largest of its kind.
        """
        if self.method.atol is not None:
            return np.full(len(self.scale), self.method.atol)
        size = np.maximum(self.scale, self.expected)
        constant = self.system.form.constant
        speeds = constant - self.system.form.parts.massive.shape[1]
        for kind in (slice(0, speeds), slice(speeds, constant)):
            size[kind] = np.maximum(size[kind], atol_floor * size[kind].max(initial=0.0))
        return atol_factor * self.method.rtol * np.where((size > 0.0) & (size < math.inf), size, 1.0)

    def _advance_solver(self) -> Status:
        """Take a step of the solver, and report a failure."""
        try:
            if self.steps is None:
                self.steps = self._solver(self.segment, self.begun)
            self.steps.step()
        except InputError:  # a load that returns no number
            raise
        except (FloatingPointError, ValueError):  # SciPy's implicit solvers raise the latter for a matrix with NaN
            return Status.NON_FINITE
        self.stats.steps += 1
        if self.steps.status == "failed":
            return Status.STEP_SIZE
        return Status.SOLVED if np.isfinite(self.steps.y).all() else Status.NON_FINITE

    def enter(self, ending: Ending) -> Status:
        """Begin the next segment."""
        turn = ending.row - (len(self.segment.rows) - len(self.segment.phases))
        turned = self.segment.phases[turn] if ending.row >= 0 and turn >= 0 else None
        return self.begin_segment(ending.t, self._with_ended_slip(ending), turned, ending.breakpoint)

    def _with_ended_slip(self, ending: Ending) -> Array:
        """Return the state of an ending, projected to U = 0 if it is that of a slip between masses.

        An event is located to the tolerance of the solver, and static friction holds where the slip is zero.
        """
        system, mode = self.system, self.segment.mode
        contacts = system.watch(mode).contacts
        if not 0 <= ending.row < len(contacts):
            return ending.X
        i = int(contacts[ending.row])
        if i not in dict(mode.slips) or not system.dynamics.of_rate[i] or system.degree[i] < 2:
            return ending.X
        return project(system, system.fine.CA[[i]], DoubleDouble.of(ending.X), self.scale).hi

    def begin_segment(
        self,
        t: float,
        X: Array,
        turned: tuple[int, int] | None = None,
        breakpoint: bool = False,
        v: Array | None = None,
    ) -> Status:
        """Begin a segment at t: impacts, the mode, the events that this makes, and a solver for the next motion.

        ``turned`` is the spring that enters another phase. Before the start of the run the velocities are v (n,).
        """
        system = self.system
        forced = self.forced
        old = self.last_segment
        before = old.mode if old else None
        self.scale = np.maximum(self.scale, np.abs(X))
        kept = still(system, before)
        state, left, kept = arrive(system, t, before, DoubleDouble.of(X), self.scale, kept, breakpoint)
        rates = None if v is None else system.dynamics.H @ v
        if old and len(system.lines):
            closed = np.isin(np.arange(len(system.degree)), old.mode.closed)
            rates = np.where(closed, 0.0, system.dynamics.H @ forced.state(old, t - old.t0, X).v)
        meets, U = self._meeting(state, left, kept, rates)
        state, restitution, quick = self._land(t, state, kept, np.flatnonzero(meets), U)
        state, P, kept = impact(system, state, self.scale, self.solver, restitution, kept, left=left, rates=rates)
        forces = Forces(forced.inputs, self._phase(state.hi, turned))
        state = system.form.sampled(t, state, self.scale)
        mode, chosen = choose_mode(*self._linearized(t, state.hi, forced.in_mode(before, forces)), self.solver, kept)
        if self.system.dynamics.substitutes.any():
            agreed = self._agreed(t, state, forces, mode, kept)
            if agreed is None:
                return Status.NEWTON
            mode, chosen = agreed
        after = forced.without_inputs(chosen.hi)
        new = self._segment(t, mode, forces)
        was = forced.state(old, t - old.t0, X) if old else forced.state(new, 0.0, X)
        if v is not None:
            was = replace(was, v=v)
        self.events += happened(system.dynamics, t, before or mode, mode, P, was, forced.state(new, 0.0, after))
        status = Status.SOLVED
        if quick and t < self.end:
            status, new, after = self._burst(new, after, quick)
        self.last_segment = new
        if new.t0 >= self.end:
            # An event at the very end is followed by its right limit.
            self.pieces.append(Piece(new, new.t0, new.t0, AtRest(after)))
        else:
            self.steps, self.begun = None, after
        return status

    def _agreed(
        self, t: float, state: DoubleDouble, forces: Forces, mode: Mode, kept: Still, *, most: int = 20
    ) -> tuple[Mode, DoubleDouble] | None:
        """Return the mode that is chosen by the slopes that dashpots at massless nodes, whose rates jump, have in it.

        None if each of ``most`` choices leads to another mode.
        """
        for _ in range(most):
            again, chosen = choose_mode(
                *self._linearized(t, state.hi, self.forced.in_mode(mode, forces)), self.solver, kept
            )
            if again == mode:
                return again, chosen
            mode = again
        return None

    def _meeting(
        self, state: DoubleDouble, left: DoubleDouble | None, kept: Still, rates: Array | None
    ) -> tuple[Flags, Array]:
        """Return the contacts that undergo an impact (nc,), and the opening rates before it (nc,)."""
        system = self.system
        u, U = (each.hi for each in gaps(system, state, self.scale, kept))
        if not len(system.lines) or rates is None:
            return system.dynamics.rigid & (u <= 0.0) & (U < 0.0), U
        P = impact(system, state, self.scale, self.solver, None, kept, left=left, rates=rates)[1]
        return (P > 0.0) & (rates < 0.0), rates

    def _land(
        self,
        t: float,
        state: DoubleDouble,
        kept: Still,
        landing: Indices,
        U: Array,
        *,
        landing_rounding: float = 4.0 * EPS,
        min_flights: int = MIN_FLIGHTS,
    ) -> tuple[DoubleDouble, Array, float]:
        """Record the impacts of the contacts ``landing`` (k,): the state, their e, and the duration of a short flight.

        Where their impacts have accumulated e is zero, and they stay closed.

        ``landing_rounding``: rounding error of the gap of a contact that closes, relative to its terms.
        ``min_flights``: number of consecutive short flights after which impacts accumulate.
        """
        system = self.system
        impact_history = self.impact_history
        short = self.method.zeno * self.end
        quick = impact_history.quick(system, t, landing, U, self.scale, short)
        restitution = system.dynamics.restitution
        if not len(landing):
            return state, restitution, quick
        rounding = landing_rounding * (np.abs(system.matrices[2][landing]) @ self.scale)
        lost = rounding / np.maximum(-U[landing], TINY)
        if not system.mixed and (np.abs((system.fine.C[landing] @ state).hi) > rounding).any():
            # Roots have the rounding error of the dense output, which would accumulate from impact to impact.
            met = kept.u.copy()
            met[landing] = True
            state = settled(system, None, state, self.scale, replace(kept, u=met))
        impact_history.land(t, landing, short, lost)
        if not quick:
            over = (impact_history.short >= min_flights) & system.dynamics.rebounds_decay
            if system.dynamics.has_other_impact_law:
                # There e of a contact that passes an impact on counts, too.
                over[:] = over[landing].all()
            restitution = np.where(over, 0.0, restitution)
        return state, restitution, quick

    def _burst(
        self, first: ForcedSegment, X: Array, short: float, *, max_burst_flights: float = 10.0
    ) -> tuple[Status, ForcedSegment, Array]:
        """Follow a burst of impacts from X, with linearised forces: the segment after it, and its state.

        ``max_burst_flights``: maximum duration of a burst of impacts, in short flights, where there are
        nonlinear forces.
        """
        t = first.t0
        forces = first.forces
        forced = self.forced
        system, grown, scale = self._linearized(t, X, forces)
        most = max_burst_flights * short if forced.inputs.count else math.inf
        status, burst = follow_burst(self, system, t, DoubleDouble.of(grown), first.mode, scale, short, most)
        for each, end in passed(burst):
            dense = InBurst(system.mode(each.mode)[0], each.state, forced.added)
            self.pieces.append(Piece(self._segment(each.t0, each.mode, forces), each.t0, end, dense))
        self.events += burst.events
        self.switches += len({event.t for event in burst.events})
        self.impact_history.take(burst)
        self.scale = np.maximum(self.scale, forced.without_inputs(burst.scale))
        last = burst.segments[-1]
        there = forced.without_inputs(last.X)
        if forced.inputs.count and status is Status.SOLVED and last.t0 > t:
            bent = np.abs(
                Forces(forced.inputs, None)(last.t0, there)
                - forces.linear(t, X, last.t0, there, forced.difference_step)
            )
            if (bent > max_burst_flights * SHORT_FLIGHT_RTOL * self.sizes).any():
                status = Status.ACCUMULATION
        return status, self._segment(last.t0, last.mode, forces), there

    def _linearized(self, t: float, X: Array, forces: Forces) -> tuple[System, Array, Array]:
        """Return the system linearised about t and X, and X and its scale in it."""
        if not self.forced.inputs.count:
            return self.system, X, self.scale
        self.sizes = np.maximum(self.sizes, np.abs(forces(t, X)))
        return self.forced.linearized(t, X, forces, self.scale, self.sizes)

    def _segment(self, t: float, mode: Mode, forces: Forces) -> ForcedSegment:
        """Return the segment of a mode that begins at t."""
        stop = self.next_breakpoint(t)
        return self.forced.segment(mode, forces, t, min(stop, self.end), stop < math.inf)

    def _phase(self, X: Array, turned: tuple[int, int] | None) -> Indices | None:
        """Return the phase of each spring from X on; ``turned`` is one that has just entered another phase."""
        inputs, old = self.forced.inputs, self.last_segment
        if not self.method.kinks or not len(inputs.law):
            return NO_PHASE if self.method.kinks else None
        δ, rate = (
            rows @ X[: len(self.system.form.A)] for rows in (inputs.approach, inputs.approach @ self.system.form.A)
        )
        if old is None or old.forces.phase is None:
            touches = (δ > 0.0) | ((δ == 0.0) & (rate > 0.0))
        else:
            touches = old.forces.phase != SpringPhase.APART
        s, elastic = np.split(Forces(inputs, None).extended(X), 2)
        bounds = inputs.law[:, 7:].T
        with np.errstate(invalid="ignore"):
            # What no bound limits is not limited where rounding has made the penetration negative either.
            least, most = np.where(np.isfinite(bounds), bounds * elastic, bounds)
        below = (s < least) | ((s == least) & (rate <= 0.0))
        phases = [SpringPhase.APART, SpringPhase.LEAST, SpringPhase.MOST]
        phase = np.select([~touches, below, s > most], phases, SpringPhase.PUSHES)
        if turned is not None:
            phase[turned[0]] = turned[1]
        return phase

    def _solver(self, segment: ForcedSegment, X: Array, *, max_phase: float = 2.0) -> OdeSolver:
        """Return a solver that starts from X.

        ``max_phase``: maximum step of explicit solvers in radians of the fastest vibration; error control does
        not see the dense output.
        """
        method, kind = self.method, self.method.solver_class
        length = segment.end - segment.t0
        A = segment.A
        begun = False

        def forced_rate(τ: float, X: Array) -> Array:
            """Return X' (N,), which must be finite before the first step: SciPy would search for one for ever."""
            found = segment.rate(τ, X)
            if not begun and not np.isfinite(found).all():
                raise FloatingPointError
            return found

        rate: Callable[[float, Array], Array] = forced_rate if self.forced.inputs.count else lambda τ, X: A @ X
        options: dict[str, Any] = {"rtol": method.rtol, "atol": self._absolute_tolerance(), "max_step": method.max_step}
        if _takes_jacobian(kind):
            options["jac"] = segment.jacobian
        else:
            options["max_step"] = min(method.max_step, max_phase / max(self._fastest_rate(segment), TINY))
        # A row that leaves zero with curvature is resolved in a short step only.
        if self.first_step and issubclass(kind, ONE_STEP_SOLVERS) and (segment.order < 2).all():
            # The last step is as good a guess as SciPy's, and costs nothing: the error control checks it anyway.
            options["first_step"] = min(self.first_step, length)
        try:
            solver = kind(rate, 0.0, X, length, **options)
        except FloatingPointError:
            # The failure may lie ahead: a shorter step avoids it.
            solver = kind(rate, 0.0, X, length, **options | {"first_step": SHORT_FLIGHT_RTOL * length})
        begun = True
        return solver


def expected_scale(system: System, inputs: Inputs, start: Array, end: float, *, load_samples: int = 17) -> Array:
    """Return the sizes (N,) of the states of a start (N,) within the shortest period or decay time of the open contacts.

    ``load_samples``: number of instants at which loads are evaluated for their scale.
    """
    A, w = system.form.A, np.zeros(inputs.count)
    w[inputs.given : inputs.of_state] = np.abs(inputs.motion_forces(0.0, start))
    for k, load in enumerate(inputs.loads, inputs.of_state):
        sizes = [abs(load(float(t))) for t in np.linspace(0.0, end, load_samples)]
        w[k] = np.median(sizes) or max(sizes)
    time = 1.0 / max(np.abs(np.linalg.eigvals(A)).max(initial=0.0), 1.0 / end)
    grown = np.abs(start)
    for _ in range(2):  # forces move velocities, and these positions
        states = time * (np.abs(A) @ grown[: len(A)] + np.abs(inputs.E) @ w)
        grown[: len(A)] = np.maximum(grown[: len(A)], states)
    return grown


@cache
def _takes_jacobian(kind: type) -> bool:
    """Return whether a solver can be given the Jacobian."""
    return "jac" in inspect.signature(kind).parameters
