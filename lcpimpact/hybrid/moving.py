"""Motion of a Lagrangian system from event to event, by a solver of SciPy.

A mode ends where a gap closes, a normal force or a slip comes to zero, friction comes to its limit, or accelerations become
singular (see `lcpimpact.hybrid.moving_modes`). These functions of the motion are sampled on the dense output of a step, and
their roots are found as those of `lcpimpact.hybrid.dense_output`.

Joints, closed gaps and zero rates hold by their second derivatives; after each step of a one-step solver, at each event, and
where the motion is read, it is projected onto them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
from scipy import integrate
from scipy.integrate import OdeSolver

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.errors import FailureError, Status
from lcpimpact.hybrid.burst import ImpactHistory
from lcpimpact.hybrid.contact_loop import MIN_FLIGHTS
from lcpimpact.hybrid.dense_output import AtRest, Piece, SolverLoop
from lcpimpact.hybrid.event_loop import Ending, read_segments, refuse_undetermined
from lcpimpact.hybrid.forced_modes import ZERO_FOR_EVER
from lcpimpact.hybrid.friction import NoVelocity
from lcpimpact.hybrid.moving_modes import Here, KnownRows, MovingMode, MovingSystem, RowBasis, solved
from lcpimpact.hybrid.system import ZERO
from lcpimpact.hybrid.transition import happened
from lcpimpact.numerics.rounding import EPS, TINY
from lcpimpact.problems.base import Problem
from lcpimpact.record import Record, State
from lcpimpact.scheme.lagrangian import LagrangianDynamics

ONE_STEP_SOLVERS = (integrate.RK23, integrate.RK45, integrate.DOP853)
"""One-step methods, which need no small first step."""

SINGULAR = 1e-11
"""|p| at which accelerations are singular."""

NEARLY_SINGULAR = 1e-6
"""|p| below which they are so where forces end the mode, or where the solver fails."""


class Watching(StrEnum):
    """Kind of a function of the motion that ends a mode where it falls below zero."""

    GAP = "gap"
    FORCE = "normal force"
    SLIP = "slip"
    LIMIT = "limit of friction"
    SINGULAR = "p"


class EndFunction(NamedTuple):
    """A function of the motion that ends a mode, of a row, with a sign; the order of its initial zero, and its size."""

    what: Watching
    row: int
    sign: int
    order: int
    size: float


@dataclass(frozen=True)
class SolverOptions:
    """Options of the solver, as those of `lcpimpact.integrators.event_driven.EventDriven`."""

    kind: type[OdeSolver]
    rtol: float
    atol: float | None
    max_step: float
    max_steps: int
    zeno: float


@dataclass(frozen=True, eq=False)
class MovingSegment:
    """One mode from t0 to ``end`` at the latest, and the functions that end it; the state is X = (q, v) at t0 + τ."""

    system: MovingSystem
    mode: MovingMode
    watch: tuple[EndFunction, ...]
    t0: float
    end: float

    @property
    def rows(self) -> Array:
        """The functions that end the mode are those that are watched."""
        return np.eye(len(self.watch))

    @property
    def order(self) -> Indices:
        """Order of the initial zero of each function (nw,)."""
        return np.array([each.order for each in self.watch], dtype=np.int64)

    @property
    def sizes(self) -> Array:
        """Size of each function (nw,)."""
        return np.array([each.size for each in self.watch])

    @property
    def turn(self) -> int:
        """Sign of p where friction slides, else 0."""
        last = self.watch[-1:]
        return last[0].sign if last and last[0].what is Watching.SINGULAR else 0

    @property
    def places(self) -> list[int]:
        """The rows whose gap is zero in the mode by their reaction."""
        return [i for i in self.mode.active if not self.system.d.tangential[i]]

    def parted(self, X: Array) -> tuple[Array, Array]:
        """Return q and v (..., n)."""
        n = X.shape[-1] // 2
        return X[..., :n], X[..., n:]

    def rate(self, τ: float, X: Array) -> Array:
        """Return X' (N,)."""
        q, v = self.parted(X)
        a, _, p = self.system.accelerations(self.system.here(self.t0 + τ, q, v), self.mode)
        # No step leads beyond a singular point: where there is no number a solver tries a shorter one.
        return np.concatenate([v, a if not self.turn or p * self.turn > 0.0 else np.full_like(a, np.nan)])

    def slopes(self, τ: float, X: Array) -> Array:
        """Return ∂X'/∂X (N, N) but for the turning of masses and rows."""
        q, v = self.parted(X)
        n, d = len(q), self.system.d
        _, _, K, C, _ = d.forces_at(self.t0 + τ, q, v)
        here = self.system.here(self.t0 + τ, q, v)
        each = [np.broadcast_to(values, (2 * n, *values.shape)) for values in here]
        falls = Here(*each)._replace(F=-np.hstack([K, C]).T, kappa=0.0 * each[-1])
        return np.vstack([np.eye(n, 2 * n, n), self.system.accelerations(falls, self.mode)[0].T])

    def held(self, τ: float | Array, X: Array) -> Array:
        """Return X (..., N) projected onto the gaps and rates that are zero in the mode."""
        if not self.mode.active:
            return X
        t, (q, v) = self.t0 + τ, self.parted(X)
        return np.concatenate(self.system.projected(t, q, v, self.places, list(self.mode.active)), axis=-1)

    def watched(self, τ: Array, X: Array) -> Array:
        """Return the functions that are watched (nt, nw)."""
        q, v = self.parted(X)
        here, d = self.system.here(self.t0 + τ, q, v), self.system.d
        _, r, p = self.system.accelerations(here, self.mode)
        U = here.rates(v)
        found = np.empty((len(X), len(self.watch)))
        for k, (what, i, sign, _, _) in enumerate(self.watch):
            if what is Watching.GAP:
                found[:, k] = here.g[:, i]
            elif what is Watching.FORCE:
                found[:, k] = r[:, i]
            elif what is Watching.SLIP:
                found[:, k] = sign * U[:, i]
            elif what is Watching.LIMIT:
                found[:, k] = d.mu[i] * r[:, d.normals[i]] - sign * r[:, i]
            else:
                found[:, k] = sign * p - SINGULAR
        return found

    def value(self, row: Array, τ: float, dense: Callable[[float | Array], Array]) -> float:
        """Return the value of a function at t0 + τ on the dense output."""
        at = np.array([τ])
        return float((self.watched(at, dense(at).T) @ row)[0])

    def coordinates(self, τ: Array, X: Array) -> tuple[Array, Array, Array]:
        """Return q, v and r for the states X (nt, N) at t0 + τ."""
        q, v = self.parted(self.held(τ, X))
        return q, v, self.system.accelerations(self.system.here(self.t0 + τ, q, v), self.mode)[1]

    def state(self, τ: float, X: Array) -> State:
        """Return the state X (N,) at t0 + τ, as it is."""
        q, v = self.parted(X)
        return State(q, v, self.system.accelerations(self.system.here(self.t0 + τ, q, v), self.mode)[1])


@dataclass(frozen=True, eq=False)
class MovingSolution:
    """The pieces of a run: the motion at any time."""

    d: LagrangianDynamics
    pieces: list[Piece[MovingSegment]]

    def __call__(self, t: Array, side: str) -> tuple[Array, Array, Array]:
        """Return q, v and r at the sorted times t (nt,); ``side`` tells which limit is meant at an event."""

        def read(owner: Indices, mine: Indices | slice) -> tuple[Array, Array, Array]:
            """Return q, v and r at times in one piece."""
            piece = self.pieces[int(owner[0])]
            τ = t[mine] - piece.segment.t0
            return piece.segment.coordinates(τ, piece.dense(τ).T)

        starts = np.array([piece.start for piece in self.pieces])
        return read_segments(self.d, starts, np.arange(len(starts)), t, side, read)


class Passed(NamedTuple):
    """Knowledge of the next mode that the end of the last one gives.

    Attributes
    ----------
    opened : (nc,) array of bool    the contact that its own force opens
    signs : (nc,) array of int      the sign of the slip of friction that breaks loose
    breaks : bool                   whether some does
    singular : float                |p| where accelerations become singular, else 0
    """

    opened: Flags
    signs: Indices
    breaks: bool = False
    singular: float = 0.0


@dataclass(eq=False, kw_only=True)
class MovingMotion(SolverLoop[LagrangianDynamics, MovingSegment]):
    """A motion of a Lagrangian system."""

    options: SolverOptions
    modes: MovingSystem = field(init=False)
    solution: MovingSolution = field(init=False)
    impact_history: ImpactHistory = field(init=False)

    def __post_init__(self) -> None:
        self.modes = MovingSystem.of(self.system, self.solver)
        self.solution = MovingSolution(self.system, self.pieces)
        self.impact_history = ImpactHistory.none(len(self.system.contacts))

    def begin(self, problem: Problem, record: Record, method: str) -> None:
        """Choose the first mode and write the initial values; impacts at t = 0 come before them."""
        with refuse_undetermined(problem, method):
            self.begin_segment(0.0, np.concatenate([problem.initial_coordinates, problem.initial_velocities]))
        first = self.segment.state(0.0, self.begun)
        record.q[0] = first.q
        record.v[0] = first.v
        record.reaction[0] = first.reaction

    # ---- between events ----------------------------------------------------------------------------------------------

    def step(self) -> Ending | Status:
        """Take one step of the solver, up to the first event in it."""
        if len(self.pieces) >= self.options.max_steps:
            return Status.MAX_STEPS
        segment = self.segment
        if self.steps is None:
            self.steps = self._solver(segment, self.begun)
        steps = self.steps
        try:
            steps.step()
        except (ArithmeticError, ValueError, np.linalg.LinAlgError):
            return self._singular(segment, steps.t, steps.y) or Status.NON_FINITE
        self.stats.steps += 1
        if steps.status == "failed":
            return self._singular(segment, steps.t, steps.y) or Status.STEP_SIZE
        if not np.isfinite(steps.y).all():
            return Status.NON_FINITE
        rounding = max(self.options.rtol, ZERO)
        ending = self.keep_step(segment.sizes, lambda: 16.0 * rounding * segment.sizes, rounding * self.end)
        if ending.row >= 0:
            return ending
        if steps.status != "finished" and segment.mode.active and isinstance(steps, ONE_STEP_SOLVERS):
            steps.y = segment.held(steps.t, steps.y)
            steps.f = segment.rate(steps.t, steps.y)
        return Status.SOLVED

    def row_at(self, τ: float, row: int, dense: Callable[[float | Array], Array]) -> int:
        """Return the row of the determinant where a force comes to zero or to its limit because of it."""
        segment = self.segment
        if segment.watch[row].what not in (Watching.FORCE, Watching.LIMIT):
            return row
        ending = self._singular(segment, τ, dense(τ))
        return ending.row if ending else row

    def _singular(self, segment: MovingSegment, τ: float, X: Array) -> Ending | None:
        """Return the end of a mode whose accelerations are nearly singular at t0 + τ, None if they are not."""
        k = len(segment.watch) - 1
        if not segment.turn or not segment.watched(np.array([τ]), X[None])[0, k] < NEARLY_SINGULAR:
            return None
        return Ending(segment.t0 + τ, τ, X, k)

    def _solver(self, segment: MovingSegment, X: Array, *, max_phase: float = 2.0) -> OdeSolver:
        """Return a solver that starts from X.

        ``max_phase``: maximum step of explicit solvers in radians of the fastest vibration about X; error control does not
        see the dense output.
        """
        given = self.options
        length = segment.end - segment.t0
        options: dict[str, Any] = {"rtol": given.rtol, "atol": self._absolute_tolerance(), "max_step": given.max_step}
        if issubclass(given.kind, ONE_STEP_SOLVERS):
            n = len(X) // 2
            M, _, K, C, _ = self.system.forces_at(segment.t0, X[:n], X[n:])
            slopes = np.block([[np.zeros((n, n)), np.eye(n)], [-solved(M, K), -solved(M, C)]])
            fastest = float(np.abs(np.linalg.eigvals(slopes)).max()) if np.isfinite(slopes).all() else 0.0
            options["max_step"] = min(given.max_step, max_phase / max(fastest, TINY))
            # A function that leaves zero with curvature is resolved in a short step only.
            if self.first_step and (segment.order < 2).all():
                options["first_step"] = min(self.first_step, length)
        return given.kind(segment.rate, 0.0, X, length, **options)

    def _absolute_tolerance(self, *, atol_factor: float = 1e-4) -> Array:
        """Return the absolute tolerance of each state (N,), relative to its scale so far if no other is given.

        ``atol_factor``: absolute tolerance, in units of rtol times the scale of a state.
        """
        if self.options.atol is not None:
            return np.full(len(self.scale), self.options.atol)
        size = np.maximum(self.scale, self.expected).reshape(2, -1)
        # Where forces balance, the accelerations of a state are the rounding of those of others.
        found = np.maximum(atol_factor * self.options.rtol * size, EPS * size.max(axis=1, keepdims=True)).ravel()
        return np.where((found > 0.0) & (found < math.inf), found, atol_factor * self.options.rtol)

    # ---- at events ---------------------------------------------------------------------------------------------------

    def enter(self, ending: Ending) -> Status:
        """Begin the next segment."""
        return self.begin_segment(ending.t, ending.X, self.segment.watch[ending.row])

    def begin_segment(self, t: float, X: Array, ended: EndFunction | None = None) -> Status:
        """Begin a segment at t: impacts, the mode, the events that this makes, and a solver for the next motion."""
        d = self.system
        old, n = self.last_segment, len(X) // 2
        self.scale = np.maximum(self.scale, np.abs(X))
        here = self.modes.here(t, X[:n], X[n:])
        near = d.impenetrable & (here.g <= ZERO * self._sizes(here)[0])
        passed = Passed(np.zeros(len(near), dtype=np.bool_), np.zeros(len(near), dtype=np.int64))
        q, v = X[:n], X[n:]
        if old is not None and ended is not None:
            near |= d.impenetrable & np.isin(np.arange(len(near)), old.mode.mode.closed)
            near[ended.row] |= ended.what is Watching.GAP
            passed = self._passed(here, old, ended, passed)
            q, v = self._settled(t, q, v, near, old, ended)
        first = State(q, v, np.zeros(len(near)))
        left = old.state(t - old.t0, np.concatenate([q, v])) if old else first
        mode, q, v, blows = self._land(t, q, v, near, passed)
        here = self.modes.here(t, q, v)
        after = np.concatenate([q, v])
        watch = self._watch(here, v, mode, passed)
        new = MovingSegment(self.modes, mode, watch, t, self.end)
        right = new.state(0.0, after)
        left = left if old else State(q, left.v, right.reaction)
        before = old.mode.mode if old else mode.mode
        values = d.at(t, q, v)
        blows = blows or [("impact", np.zeros(len(near)), v)]
        for kind, P, v_after in blows[:-1]:
            middle = State(q, v_after, left.reaction)
            self.events += happened(values, t, before, before, P, left, middle, kind)
            left = middle
        self.events += happened(values, t, before, mode.mode, blows[-1][1], left, right, blows[-1][0])
        self.last_segment, self.scale = new, np.maximum(self.scale, np.abs(after))
        if t >= self.end:
            # An event at the very end is followed by its right limit.
            self.pieces.append(Piece(new, t, t, AtRest(after)))
        else:
            self.steps, self.begun = None, new.held(0.0, after)
        return Status.SOLVED

    def _sizes(self, here: Here) -> tuple[Array, Array]:
        """Return the sizes of the gaps in m and of the rates in m/s (nc,), of which a part is rounding."""
        places, speeds = self.scale.reshape(2, -1)
        # A projection of velocities leaves rounding of their rounding in rates that have always been zero.
        fastest = np.sqrt(np.einsum("in,ni->i", here.H, solved(here.M, here.H.T)) * (speeds @ np.abs(here.M) @ speeds))
        return np.abs(here.H) @ places, np.abs(here.H) @ speeds + np.abs(here.chi) + EPS * fastest

    def _passed(self, here: Here, old: MovingSegment, ended: EndFunction, none: Passed) -> Passed:
        """Return the knowledge of the next mode that the end of the last one gives."""
        if ended.what is Watching.FORCE:
            none.opened[ended.row] = True
        elif ended.what is Watching.LIMIT:
            none.signs[ended.row] = -ended.sign
        elif ended.what is Watching.SINGULAR:
            return none._replace(singular=abs(float(self.modes.accelerations(here, old.mode)[2])))
        return none._replace(breaks=ended.what is Watching.LIMIT)

    def _settled(
        self, t: float, q: Array, v: Array, near: Flags, old: MovingSegment, ended: EndFunction
    ) -> tuple[Array, Array]:
        """Return q with the gaps ``near`` (nc,) and joints at zero, and v with the rates that the last mode kept zero."""
        here = self.modes.here(t, q, v)
        basis, places = RowBasis(here.M), list[int]()
        for i in (*old.places, *map(int, np.flatnonzero(near))):
            if i not in places and basis.add(here.H[i]):
                places.append(i)
        rates = list(old.mode.active)
        basis = RowBasis(here.M)
        for i in rates:
            basis.add(here.H[i])
        if ended.what is Watching.SLIP and basis.add(here.H[ended.row]):
            # Static friction holds where the slip is zero.
            rates.append(ended.row)
        return self.modes.projected(t, q, v, places, rates)

    def _land(
        self, t: float, q: Array, v: Array, near: Flags, passed: Passed, *, most: int = 8
    ) -> tuple[MovingMode, Array, Array, list[tuple[str, Array, Array]]]:
        """Return the next mode, q and v in it, and each impulse on the way: its kind, P (nc,), and v after it.

        ``most``: maximum number of jams at one instant.

        Raises
        ------
        NoVelocity
            If no impulse leads to a velocity with which the bodies can move on.
        """
        d = self.system
        blows: list[tuple[str, Array, Array]] = []
        here = self.modes.here(t, q, v)
        speeds = self._sizes(here)[1]
        landing = near & (here.rates(v) < -ZERO * speeds)
        if landing.any():
            e = self._restitution(t, here, v, near, landing)
            together = d.impenetrable & (e == 0.0) & (d.restitution > 0.0)
            q, near = self._gathered(t, q, near, together), near | together
            here = self.modes.here(t, q, v)
            blows.append(("impact", self.modes.impact(here, v, near, e, speeds), v))
        elif passed.singular:
            blows.append(("jam", self.modes.jam(here, v, near, speeds, passed.singular), v))
        for _ in range(most):
            if blows and blows[-1][2] is v:
                kind, P, _ = blows.pop()
                v = v + solved(here.M, here.H.T @ P)
                blows.append((kind, P, v.copy()))
                passed = Passed(np.zeros_like(passed.opened), np.zeros_like(passed.signs))
                self.scale = np.maximum(self.scale, np.abs(np.concatenate([q, v])))
                here = self.modes.here(t, q, v)
                speeds = self._sizes(here)[1]
            U = here.rates(v)
            closed = near & (ZERO * speeds >= U) & ~passed.opened
            signs = np.where(np.abs(U) > ZERO * speeds, np.sign(U), 0.0).astype(np.int64)
            signs[passed.signs != 0] = passed.signs[passed.signs != 0]
            try:
                return self.modes.choose(here, KnownRows(closed, signs, passed.breaks)), q, v, blows
            except FailureError:
                blows.append(("jam", self.modes.jam(here, v, closed, speeds), v))
        raise NoVelocity

    def _restitution(
        self, t: float, here: Here, v: Array, near: Flags, landing: Flags, *, landing_rounding: float = 4.0 * EPS
    ) -> Array:
        """Record the impacts of the contacts ``landing`` (nc,), and return e (nc,): 0 where impacts have accumulated.

        Contacts that take turns, as the two corners of a block, accumulate together, and do so once several are ``near``.

        ``landing_rounding``: rounding error of the gap of a contact that closes, relative to its terms.
        """
        history, rows = self.impact_history, np.flatnonzero(landing)
        lost = landing_rounding * self._sizes(here)[0][rows] / np.maximum(-here.rates(v)[rows], TINY)
        short = self.options.zeno * self.end
        recent = t - history.last <= max(short, float(lost.max()))
        history.land(t, rows, short, lost)
        over, quick = history.short >= MIN_FLIGHTS, (history.short > 0) & (landing | recent)
        if (over & landing).any() or ((quick & landing).any() and (quick & near & ~landing).any()):
            over |= quick
        return np.where(over & (self.system.restitution < 1.0), 0.0, self.system.restitution)

    def _gathered(self, t: float, q: Array, near: Flags, more: Flags) -> Array:
        """Return q (n,) with the gaps of ``more`` contacts (nc,) at zero, too, if these are not ``near`` (nc,) already."""
        if not (more & ~near).any():
            return q
        here = self.modes.here(t, q, np.zeros_like(q))
        basis = RowBasis(here.M)
        closed = self.system.bilateral | near | more
        rows = [i for i in map(int, np.flatnonzero(closed)) if basis.add(here.H[i])]
        return self.modes.projected(t, q, np.zeros_like(q), rows, [])[0]

    def _watch(self, here: Here, v: Array, mode: MovingMode, passed: Passed) -> tuple[EndFunction, ...]:
        """Return the functions of the motion that end a mode."""
        d, watch = self.system, list[EndFunction]()
        places, speeds = self._sizes(here)
        U = here.rates(v)
        _, r, p = self.modes.accelerations(here, mode)
        force = float(np.abs(r).max(initial=0.0))
        for i in map(int, np.flatnonzero(d.impenetrable)):
            if i in mode.mode.closed:
                if i in mode.active:
                    watch.append(EndFunction(Watching.FORCE, i, 1, 0, force))
                continue
            order = 2 + int(passed.opened[i])
            if here.g[i] > ZERO * places[i]:
                order = 0
            elif U[i] > ZERO * speeds[i]:
                order = 1
            elif i in mode.grazing:
                order = ZERO_FOR_EVER
            watch.append(EndFunction(Watching.GAP, i, 1, order, max(float(places[i]), abs(float(here.g[i])))))
        for i, sign in mode.mode.slips:
            order = 0 if abs(U[i]) > ZERO * speeds[i] else 2 if passed.breaks else 1
            watch.append(EndFunction(Watching.SLIP, i, sign, order, float(speeds[i])))
        for i in (i for i in mode.active if d.tangential[i]):
            order = ZERO_FOR_EVER if i in mode.at_limit else 0
            watch += [EndFunction(Watching.LIMIT, i, sign, order, force) for sign in (1, -1)]
        if mode.unsymmetric:
            watch.append(EndFunction(Watching.SINGULAR, -1, int(np.sign(p)) or 1, 0, 1.0))
        return tuple(watch)


def expected_scale_of_motion(d: LagrangianDynamics, q: Array, v: Array, end: float) -> Array:
    """Return the sizes (N,) of q and v within the shortest period or decay time from a start, for at most ``end`` s."""
    n = len(q)
    M, F, K, C, _ = d.forces_at(0.0, q, v)
    a = np.abs(solved(M, F))
    slopes = np.block([[np.zeros((n, n)), np.eye(n)], [-solved(M, K), -solved(M, C)]])
    time = 1.0 / max(float(np.abs(np.linalg.eigvals(slopes)).max()), 1.0 / end)
    speeds = np.maximum(np.abs(v), time * a)
    return np.concatenate([np.maximum(np.abs(q), time * speeds), speeds])
