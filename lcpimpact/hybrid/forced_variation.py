r"""The derivative with respect to parameters of a motion with non-linear forces, integrated beside the motion.

With the forces w(t, X) of non-linear springs and dashpots, general forces and loads that are functions of time (see
`lcpimpact.hybrid.forced_modes`) X_p follows in a mode

.. math:: X_p' = A X_p + A_p X + E\, \dot w_p + E_p w, \qquad \dot w_p = w_X X_p + w_p ,

which a solver integrates beside X' = A X + E w from the start of each segment, at a tolerance below that of the run. The
event functions are g = c·(X, w, s) with the forces s that active springs would have, so that

.. math:: t_p = -\frac{dg/dp}{dg/dt}, \qquad X_p^+ = R\, (X_p^- + f^- t_p) + R_p X^- - f^+ t_p .

A law whose force is zero where a spring touches is continuous there, and so is X_p; with a dashpot, c > 0, the force jumps.

The numbers of the laws are varied at the δ and δ' that they have, whose own change follows from their rows: a difference
with respect to a gap would pass the touch, where δⁿ is not smooth.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from lcpimpact.arrays import Array
from lcpimpact.errors import UnsupportedError
from lcpimpact.hybrid.dense_output import EventDrivenSolution, Piece
from lcpimpact.hybrid.forced_modes import ZERO_FOR_EVER, Arguments, ForcedSegment, Forces, SpringPhase, active
from lcpimpact.hybrid.gaps import zero_rows
from lcpimpact.hybrid.motion import Segment
from lcpimpact.hybrid.system import System
from lcpimpact.hybrid.tangent import GRAZING_RTOL, Hit, Passage, jump_matrix
from lcpimpact.hybrid.variation import Arrival, Member, Variation
from lcpimpact.memo import remembered
from lcpimpact.numerics.double_double import DoubleDouble
from lcpimpact.record import Event


@dataclass(frozen=True, eq=False)
class EventDrivenMotion:
    """A run by ``event-driven`` as a chain of segments, up to ``end`` in s.

    Attributes
    ----------
    system : System
    segments : list of Segment      of which ``ended`` is the row c of c·(X, w, s)
    courses : list of ForcedSegment the modes of the segments
    pieces : list of lists of Piece the steps of the run in each
    events : sequence of Event      all events of the run, those of non-linear springs too
    end : float
    """

    system: System
    segments: list[Segment]
    courses: list[ForcedSegment]
    pieces: list[list[Piece[ForcedSegment]]]
    events: Sequence[Event]
    end: float

    @classmethod
    def of(cls, solution: EventDrivenSolution, start: Array, events: Sequence[Event], end: float) -> EventDrivenMotion:
        """Return a run from the state ``start`` (N,) with these events."""
        chain, segments = solution.chain, list[Segment]()
        before, ended = start, np.zeros(0)
        names = solution.forced.system.names
        for pieces in chain:
            course, last = pieces[0].segment, pieces[-1]
            here = tuple(each for each in events if each.t == course.t0 and each.contact in names)
            X = pieces[0].dense(0.0)
            t0 = DoubleDouble.of(course.t0)
            segments.append(Segment(t0, before, DoubleDouble.of(X), course.mode, ended, here))
            before = last.dense(last.end - course.t0)
            ended = course.rows[last.row] if last.row >= 0 else np.zeros(course.rows.shape[1])
        return cls(solution.forced.system, segments, [each[0].segment for each in chain], chain, events, end)


class Geometry(NamedTuple):
    """The derivatives (np, ...) of the matrices of a mode: those of `ForcedSegment`, and those of the laws."""

    A: Array
    E: Array
    rows: Array
    Q: Array
    Qw: Array
    F: Array
    Fw: Array
    approach: Array
    rate: Array
    place: Array
    speed: Array
    parting: Array
    parting_w: Array


class LocalMotion(NamedTuple):
    """The motion and its derivative at an instant of a segment.

    Attributes
    ----------
    X, f : (N,) arrays              the state, and its rate
    terms, rates : arrays           (X, w, s), and its rate
    X_p, f_p : (N, np) arrays       their derivatives
    terms_p : (N + nw + 2 ns, np)     that of the terms
    """

    X: Array
    f: Array
    terms: Array
    rates: Array
    X_p: Array
    f_p: Array
    terms_p: Array


def _at(forces: Forces, at: float, X: Array) -> Array:
    """Return w (nw,) at a time."""
    return forces(at, X)


@dataclass(eq=False, kw_only=True)
class ForcedVariation(Variation):
    """The derivatives of a run by ``event-driven``, as far as they were asked for.

    Attributes
    ----------
    solution : EventDrivenMotion
    solver : str or OdeSolver class
    rtol, max_step : float          the tolerance of the run, and its longest step in s
    """

    solution: EventDrivenMotion
    solver: str | type
    rtol: float
    max_step: float

    @property
    def tolerance(self) -> float:
        """Error of the motion, relative to its size, within which two events, or a zero and a grazing, are one."""
        return max(10.0 * self.rtol, 1e-10)

    @property
    def events(self) -> Sequence[Event]:
        """The events of the run, those of non-linear springs too."""
        return self.solution.events

    # ---- the forces and their derivatives ---------------------------------------------------------------------------

    def _geometry(self, k: int) -> Geometry:
        """Return the derivatives of the matrices in the mode of segment k."""
        course = self.solution.courses[k]
        return remembered(self, ("geometry", *self._key(course)), lambda: self._geometry_of(course))

    def _key(self, course: ForcedSegment) -> tuple[Hashable, ...]:
        phase = course.forces.phase
        return course.mode, None if phase is None else tuple(phase.tolist())

    def _geometry_of(self, course: ForcedSegment) -> Geometry:
        def matrices(each: Member) -> tuple[Array, ...]:
            here = self._course(each, course)
            arguments = here.forces.arguments(len(here.A))
            by_w = here.forces.parting_by_w
            return here.A, here.E, here.rows, *here.place, *here.reaction, *arguments[:5], by_w

        shapes = [each.shape for each in matrices(self.family.base)]
        flat = self.family.derivative(lambda each: np.concatenate([part.ravel() for part in matrices(each)]))
        cuts = np.cumsum([int(np.prod(shape)) for shape in shapes])[:-1]
        parts = np.split(flat, cuts, axis=1)
        return Geometry(*(part.reshape(self.count, *shape) for part, shape in zip(parts, shapes, strict=True)))

    def _course(self, member: Member, course: ForcedSegment) -> ForcedSegment:
        """Return the mode of a segment in a member of the family."""
        assert member.forced is not None
        forces = Forces(member.forced.inputs, course.forces.phase)
        return member.forced.segment(course.mode, forces, course.t0, course.end, course.breaks)

    def _varied(self, course: ForcedSegment) -> list[tuple[int, Array, list[Forces]]]:
        """Return the parameters on which numbers of laws, general forces or loads depend, with weights and forces.

        The forces are those of the mode of a segment, with the laws of the neighbours.
        """
        return remembered(self, ("varied", *self._key(course)), lambda: self._vary(course.forces))

    def _vary(self, forces: Forces) -> list[tuple[int, Array, list[Forces]]]:
        here, found = forces.inputs, list[tuple[int, Array, list[Forces]]]()
        for j, near in self.family.neighbours.items():
            there = [each.forced.inputs for each in near.members if each.forced is not None]
            if any(
                not np.array_equal(here.law[:, 1:], each.law[:, 1:])
                or not np.array_equal(here.rate_laws, each.rate_laws)
                or (here.force_laws, here.loads) != (each.force_laws, each.loads)
                for each in there
            ):
                laws = [
                    replace(here, law=i.law, rate_laws=i.rate_laws, force_laws=i.force_laws, loads=i.loads)
                    for i in there
                ]
                found.append((j, near.weights, [replace(forces, inputs=each) for each in laws]))
        return found

    def _explicit(self, of: Callable[[Forces], Array], course: ForcedSegment) -> Array:
        """Return the derivatives (..., np) of w, or of other numbers of forces, by the numbers of the laws alone."""
        here = of(course.forces)
        found = np.zeros((*here.shape, self.count))
        for j, weights, there in self._varied(course):
            found[..., j] = sum(weight * (of(each) - here) for weight, each in zip(weights, there, strict=True))
        return found

    def _rates(self, course: ForcedSegment, t: float, X: Array, f: Array) -> Array:
        """Return the rates of the terms (X, w, s) along the motion (N + nw + 2 ns,)."""
        forces, inputs = course.forces, course.forces.inputs
        if not inputs.count:
            return f
        step = self._step
        given = np.zeros(inputs.count)
        given[inputs.given :] = forces.rates(t, X, step, ahead=t < step)
        change = Arguments(*(each @ f[:, None] for each in forces.arguments(len(X))))._replace(given=given[:, None])
        return np.concatenate([f, forces.response(t, X, change)[:, 0], forces.extended_response(X, change)[:, 0]])

    @property
    def _step(self) -> float:
        forced = self.family.base.forced
        assert forced is not None
        return forced.difference_step

    def _forced(self, k: int, t: float, X: Array, X_p: Array) -> tuple[Array, Array, Array, Arguments]:
        """Return w (nw,), its derivative (nw, np), that of f (N, np), and the changes of the arguments of the laws."""
        course, by = self.solution.courses[k], self._geometry(k)
        forces = course.forces
        f_p = course.A @ X_p + (by.A @ X).T
        if not forces.inputs.count:
            none = np.zeros((0, self.count))
            return np.zeros(0), none, f_p, Arguments(none, none, none, none, none, none)
        w = forces(t, X)
        rows = remembered(self, ("arguments", *self._key(course)), lambda: forces.arguments(len(X)))[:5]
        changes = [row @ X_p + (row_p @ X).T for row, row_p in zip(rows, by[7:12], strict=True)]
        changes[4] = changes[4] + (by.parting_w @ w).T
        change = Arguments(changes[0], changes[1], changes[2], changes[3], changes[4], np.zeros((len(w), self.count)))
        w_p = forces.response(t, X, change) + self._explicit(lambda each: each(t, X), course)
        return w, w_p, f_p + course.E @ w_p + (by.E @ w).T, change

    def _local(self, k: int, t: float, X: Array, X_p: Array) -> LocalMotion:
        """Return the motion and its derivative at an instant of segment k."""
        course = self.solution.courses[k]
        forces = course.forces
        w, w_p, f_p, change = self._forced(k, t, X, X_p)
        f = course.A @ X + course.E @ w
        if not len(w):
            return LocalMotion(X, f, X, f, X_p, f_p, X_p)
        s_p = forces.extended_response(X, change) + self._explicit(lambda each: each.extended(X), course)
        terms = np.concatenate([X, w, forces.extended(X)])
        return LocalMotion(X, f, terms, self._rates(course, t, X, f), X_p, f_p, np.vstack([X_p, w_p, s_p]))

    # ---- within a segment -------------------------------------------------------------------------------------------

    def _length(self, k: int) -> float:
        """Return the length of segment k in s."""
        segments = self.solution.segments
        return (segments[k + 1].t0 if k + 1 < len(segments) else self.solution.end) - segments[k].t0

    def _followed(self, k: int) -> Callable[[Array], Array]:
        """Return the function that gives X and X_p (N (1 + np), nt) at times after the start of segment k."""
        return remembered(self, ("followed", k), lambda: self._follow(k))

    def _follow(self, k: int, *, below_run: float = 0.1, atol_factor: float = 1e-4) -> Callable[[Array], Array]:
        """Integrate the motion and its derivative over segment k.

        ``below_run``: tolerance, relative to that of the run.
        ``atol_factor``: absolute tolerance, relative to the tolerance and the scale.
        """
        segment, course = self.solution.segments[k], self.solution.courses[k]
        length = self._length(k)
        N = len(segment.X)
        start = np.concatenate([segment.X[:, None], self.start(k)], axis=1)
        if not length > 0.0:
            return lambda τ: np.repeat(start.reshape(-1, 1), len(τ), axis=1)

        def rate(τ: float, Z: Array) -> Array:
            Z = Z.reshape(N, 1 + self.count)
            w, _, f_p, _ = self._forced(k, course.t0 + τ, Z[:, 0], Z[:, 1:])
            f = course.A @ Z[:, 0] + course.E @ w
            return np.column_stack([f, f_p]).ravel()

        rtol = max(below_run * self.rtol, 1e-13)
        size = atol_factor * rtol * self._sizes()
        atol = np.outer(size, np.append(1.0, 1.0 / self.family.sizes)).ravel()
        with np.errstate(all="ignore"):
            found = solve_ivp(
                rate, (0.0, length), start.ravel(), self.solver, dense_output=True, rtol=rtol, atol=atol,
                max_step=self.max_step,
            )  # fmt: skip
        if not found.success or not np.isfinite(found.y).all():
            raise UnsupportedError(
                f"the derivative grows beyond all numbers after t = {course.t0 + found.t[-1]:g} s, as where a law has an "
                "infinite slope: take outputs before"
            )
        follow: Callable[[Array], Array] = found.sol
        return follow

    def _sizes(self, *, floor: float = 1e-6) -> Array:
        """Return the scale of each state (N,), at least ``floor`` of the largest of its kind."""
        size, form = self.scale.copy(), self.solution.system.form
        speeds = form.constant - form.parts.massive.shape[1]
        for kind in (slice(0, speeds), slice(speeds, form.constant)):
            size[kind] = np.maximum(size[kind], floor * size[kind].max(initial=0.0))
        return np.where(size > 0.0, size, 1.0)

    def at(self, k: int, times: Array) -> tuple[Array, Array]:
        """Return X (nt, N) and X_p (nt, N, np) in segment k, at times in s after its start."""
        self._refuse_touch(k, float(times.max()))
        found = self._followed(k)(times).T.reshape(len(times), -1, 1 + self.count)
        return found[..., 0], found[..., 1:]

    @property
    def scale(self) -> Array:
        """The largest |X| of the steps of the run (N,)."""
        return self._scales[0][: len(self.solution.segments[0].X)]

    @property
    def _scales(self) -> tuple[Array, Array]:
        """The largest |(X, w, s)| of the steps of the run, and the largest of their rates (N + nw + 2 ns,)."""
        return remembered(self, "scales", self._measured)

    def _measured(self) -> tuple[Array, Array]:
        found = []
        for pieces in self.solution.pieces:
            for piece in pieces:
                course, τ = piece.segment, piece.end - piece.segment.t0
                X = piece.dense(τ)
                terms = course.watched(np.array([τ]), X[None])[0]
                found.append([terms, self._rates(course, piece.end, X, np.asarray(course.rate(τ, X)))])
        terms, rates = np.abs(found).max(axis=0)
        first = self.solution.segments[0].X
        terms[: len(first)] = np.maximum(terms[: len(first)], np.abs(first))
        return terms, rates

    def _watched(self, course: ForcedSegment) -> list[int]:
        """Return the event functions of a segment whose zeros change the motion to first order."""
        contacts = len(course.rows) - len(course.phases)
        of_springs = [contacts + a for a in range(len(course.phases)) if self._jumps(course, contacts + a)]
        return [a for a in range(contacts) if course.order[a] != ZERO_FOR_EVER] + of_springs

    def _jumps(self, course: ForcedSegment, row: int) -> bool:
        """Return whether a force jumps at the end of a phase of a spring: where a dashpot meets the body or lets it go."""
        spring, phase = course.phases[row - (len(course.rows) - len(course.phases))]
        if course.forces.phase is None or {course.forces.phase[spring], phase} != {
            SpringPhase.APART,
            SpringPhase.PUSHES,
        }:
            return False
        *_, c, p, depth, _, _ = course.forces.inputs.law[spring]
        return bool(c > 0.0 and p == depth == 0.0)

    def _touches(self, k: int) -> list[tuple[float, str]]:
        """Return where event functions come down to zero in segment k without ending it, and whose they are."""
        return remembered(self, ("touches", k), lambda: self._lows(k))

    def _lows(self, k: int, *, points: int = 9, near: float = 1e-2) -> list[tuple[float, str]]:
        """Return where event functions come down to zero in segment k without ending it, and whose they are.

        ``points``: samples of a step of the run.
        ``near``: value of a sample, relative to its terms, from which the least value is sought.
        """
        course, pieces = self.solution.courses[k], self.solution.pieces[k]
        rows, found = self._watched(course), list[tuple[float, str]]()
        if not rows or not self._length(k) > 0.0:
            return found
        ends = [(piece.start - course.t0, piece.end - course.t0) for piece in pieces]
        samples = [np.linspace(*each, points) for each in ends]
        states = [piece.dense(τ).T for piece, τ in zip(pieces, samples, strict=True)]
        τ = np.concatenate(samples)
        values = course.watched(τ, np.vstack(states)) @ course.rows[rows].T
        sizes = np.abs(course.rows[rows]) @ self._scales[0]
        unique = np.append(True, np.diff(τ) > 0.0)
        τ, values = τ[unique], values[unique]
        low = (values[1:-1] < values[:-2]) & (values[1:-1] <= values[2:]) & (values[1:-1] < near * sizes)
        starts = np.array([each[0] for each in ends])
        for i, a in zip(*np.nonzero(low), strict=True):
            from scipy.optimize import minimize_scalar  # here, as most runs do without it

            def value(t: float, row: Array = course.rows[rows[a]]) -> float:
                piece = pieces[max(int(np.searchsorted(starts, t, side="right")) - 1, 0)]
                return float(course.watched(np.array([t]), piece.dense(t)[None])[0] @ row)

            least = minimize_scalar(value, bounds=(τ[i], τ[i + 2]), method="bounded")
            if least.fun <= self.tolerance * sizes[a]:
                found.append((float(least.x), self._name(course, rows[a])))
        return found

    def _name(self, course: ForcedSegment, row: int) -> str:
        """Return the name of the contact or spring of an event function."""
        d = self.solution.system.dynamics
        contacts = len(course.rows) - len(course.phases)
        if row >= contacts:
            return str(d.springs[course.phases[row - contacts][0]].name)
        watch = self.solution.system.watch(replace(course.mode, order=tuple(max(m, 0) for m in course.mode.order)))
        return str(d.contacts[watch.contacts[row]].name)

    # ---- readings ---------------------------------------------------------------------------------------------------

    def series(self, k: int, times: Array) -> tuple[Array, Array]:
        """Return all series (nt, ns) in segment k, at times in s after its start, and their derivatives (nt, ns, np)."""
        t0 = self.solution.segments[k].t0
        X, X_p = self.at(k, times)
        found = [self._read(k, t0 + τ, self._local(k, t0 + τ, *each)) for τ, *each in zip(times, X, X_p, strict=True)]
        y, y_p = zip(*found, strict=True)
        return np.array(y), np.array(y_p)

    def _read(self, k: int, t: float, at: LocalMotion) -> tuple[Array, Array]:
        """Return the values of all series at an instant of segment k (ns,), and their derivatives (ns, np)."""
        course, by = self.solution.courses[k], self._geometry(k)
        forces, inputs = course.forces, course.forces.inputs
        N, nw = len(at.X), inputs.count
        w, w_p = at.terms[N : N + nw], at.terms_p[N : N + nw]
        (Q, Qw), (F, Fw) = course.place, course.reaction
        q_p = Q @ at.X_p + (by.Q @ at.X).T + Qw @ w_p + (by.Qw @ w).T
        v, v_p = Q @ at.f, Q @ at.f_p + (by.Q @ at.f).T
        if Qw[:, inputs.given :].any():
            h = self._step
            late, soon = (self._explicit(partial(_at, at=t + step, X=at.X), course) for step in (h, -h))
            rates = np.zeros(nw)
            rates[inputs.given :] = forces.rates(t, at.X, h, ahead=False)
            v, v_p = v + Qw @ rates, v_p + Qw @ (late - soon) / (2.0 * h) + (by.Qw @ rates).T
        r_p = F @ at.X_p + (by.F @ at.X).T + Fw @ w_p + (by.Fw @ w).T
        springs = slice(0, len(inputs.law))
        y = np.concatenate([Q @ at.X + Qw @ w, v, F @ at.X + Fw @ w, w[springs]])
        return y, np.vstack([q_p, v_p, r_p, w_p[springs]])

    def _slopes(self, k: int, at: LocalMotion) -> Array:
        """Return the rates of all series (ns,) at an instant of segment k, NaN for velocities that loads give directly."""
        course = self.solution.courses[k]
        inputs = course.forces.inputs
        N, nw = len(at.X), inputs.count
        w = at.rates[N : N + nw]
        (Q, Qw), (F, Fw) = course.place, course.reaction
        bent = np.where(Qw[:, inputs.given :].any(axis=1), np.nan, Q @ (course.A @ at.f + course.E @ w))
        return np.concatenate([Q @ at.f + Qw @ w, bent, F @ at.f + Fw @ w, w[: len(inputs.law)]])

    def limit(self, k: int, side: str) -> tuple[Array, Array]:
        """Return all series at the events at the start of segment k, on one side of them, and their total derivatives."""
        if k == 0 and side == "left":
            return self._given()
        segments, t = self.solution.segments, self.solution.segments[k].t0
        if side == "left":
            at, mine = self._local(k - 1, t, segments[k].before, self.arrival(k - 1).X_p), k - 1
        else:
            at, mine = self._local(k, t, segments[k].X, self.start(k)), k
        y, y_p = self._read(mine, t, at)
        t_p = self.instant(k)
        return y, y_p + np.outer(self._slopes(mine, at), t_p) if t_p.any() else y_p

    def started_by(self, event: Event) -> int:
        """Return the segment that starts with an event, of a contact or of a spring."""
        springs = [each.name for each in self.solution.system.dynamics.springs]
        if event.contact not in springs:
            return super().started_by(event)
        turned, found = springs.index(event.contact), [0]
        for k, course in enumerate(self.solution.courses[1:], 1):
            phase, before = course.forces.phase, self.solution.courses[k - 1].forces.phase
            assert phase is not None
            assert before is not None
            pushes = [bool(active(course.forces.inputs.law, each)[turned]) for each in (before, phase)]
            if pushes == [event.kind == "open", event.kind == "close"]:
                found.append(k)
        return min(found, key=lambda k: abs(self.solution.segments[k].t0 - event.t))

    def instant(self, k: int) -> Array:
        """Return the derivative of the instant (np,) at which segment k starts."""
        t_p = super().instant(k)
        if not np.isfinite(t_p).all():
            raise UnsupportedError(
                f"a spring only touches at t = {self.solution.segments[k].t0:g} s, an instant that has no derivative: "
                "change a parameter a little"
            )
        return t_p

    def stationary(self, row: int, t: float, *, instant_rtol: float = 1e-12, max_steps: int = 8) -> float:
        """Return the instant near t at which the rate of a series is zero, by the secant method, or t."""
        k = max(int(np.searchsorted(self.starts, t, side="right")) - 1, 0)
        t0, length = self.solution.segments[k].t0, self._length(k)
        none = np.zeros((len(self.solution.segments[k].X), self.count))

        def slope(τ: float) -> float:
            X = self._followed(k)(np.array([τ]))[:: 1 + self.count, 0]
            return float(self._slopes(k, self._local(k, t0 + τ, X, none))[row])

        first = np.clip(t - t0, 0.0, length)
        a, b = first, first + (1e-6 if first < 0.5 * length else -1e-6) * length
        f_a = slope(a)
        for _ in range(max_steps):
            f_b = slope(b)
            if not np.isfinite(f_b) or f_b == f_a:
                break
            change = -f_b * (b - a) / (f_b - f_a)
            a, f_a = b, f_b
            b = b + change
            if not 0.0 < b < length or abs(b - first) > 1e-3 * length:
                return t
            if abs(b - a) <= instant_rtol * self.solution.end:
                break
        return float(t0 + b)

    # ---- events -----------------------------------------------------------------------------------------------------

    def _zeros(self, each: Member, X: DoubleDouble) -> tuple[DoubleDouble, Array]:
        """Return the numbers that are zero at the start, at the start X of a member, and the sizes of their terms."""
        course, start = self.solution.courses[0], X.hi
        mode, here = course.mode, self._course(each, course)
        still = zero_rows(each.system, mode, self.solution.system.watch(mode).held).hi
        terms = here.watched(np.zeros(1), start[None])[0]
        rates = self._rates(here, 0.0, start, np.asarray(here.rate(0.0, start)))
        rows = self._watched(course)
        first, second = (here.rows[[a for a in rows if course.order[a] > j]] for j in range(2))
        found = [(still, start), (first, terms), (second, rates)]
        values = np.concatenate([Z @ by for Z, by in found])
        return DoubleDouble.of(values), np.concatenate([np.abs(Z) @ np.abs(by) for Z, by in found])

    def _arrive(self, k: int) -> Arrival:
        """Return the end of segment k; it grazes below the root of the tolerance, if that is larger than GRAZING_RTOL."""
        system, course = self.solution.system, self.solution.courses[k]
        before, after = self.solution.segments[k], self.solution.segments[k + 1]
        row = self.solution.pieces[k][-1].row
        _, X_p = self.at(k, np.array([self._length(k)]))
        now = self._local(k, after.t0, after.before, X_p[0])
        hit = self.hit(k + 1)
        R = jump_matrix(system, before.mode, hit).hi
        rate = np.asarray(self.solution.courses[k + 1].rate(0.0, after.X))
        event = Passage(row, after.ended, hit, R, now.f, rate)
        if row < 0 and course.breaks and after.t0 == course.end:
            self._refuse_together(k, now, event)
            if hit is not None:
                raise UnsupportedError(
                    f"a body strikes as a signal jumps at t = {after.t0:g} s, where the motion has no derivative: change a "
                    "parameter a little"
                )
            t_p = self.family.derivative(lambda each: self._breakpoint(each, after.t0))
            return self._arrival(event, t_p, X_p[0], after.before)
        if row < 0:
            raise self._accumulation(after.t0)
        c, c_p = after.ended, self._geometry(k).rows[:, row]
        scales = np.abs(c) @ self._scales[1]
        slope = float(c @ now.rates)
        touches = not -slope > max(GRAZING_RTOL, self.tolerance**0.5) * scales
        t_p = np.full(self.count, np.nan) if touches else -(c @ now.terms_p + c_p @ now.terms) / slope
        if row in self._watched(course) or row < len(course.rows) - len(course.phases):
            if touches:
                raise UnsupportedError(
                    f"{self._name(course, row)} only touches at t = {after.t0:g} s (a grazing, or the end of impacts that "
                    "accumulate), where the motion has no derivative: change a parameter a little"
                )
            self._refuse_together(k, now, event)
        return self._arrival(event, t_p, X_p[0], after.before)

    @staticmethod
    def _arrival(event: Passage, t_p: Array, X_p: Array, X: Array) -> Arrival:
        return Arrival(event, t_p, X_p, DoubleDouble.of(X), DoubleDouble.of(X_p.T))

    def _sides(self, k: int) -> tuple[DoubleDouble, DoubleDouble]:
        """Return f⁻ and f⁺ (N,) at the end of segment k."""
        event = self.arrival(k).event
        return DoubleDouble.of(event.before), DoubleDouble.of(event.after)

    def _accumulation(self, t: float) -> UnsupportedError:
        return UnsupportedError(
            f"impacts accumulate, or follow each other too fast for their order to be told, at t = {t:g} s, where the "
            "motion has no derivative: take outputs before"
        )

    def _refuse_together(self, k: int, now: LocalMotion, event: Passage) -> None:
        """Refuse another zero at the end of segment k, and states after it that the event does not explain."""
        system, course = self.solution.system, self.solution.courses[k]
        after = self.solution.segments[k + 1]
        by = self._geometry(k).rows
        for a in self._watched(course):
            c = course.rows[a]
            same = event.row >= 0 and np.array_equal(c, event.c) and np.array_equal(by[:, a], by[:, event.row])
            if not same and abs(c @ now.terms) <= self.tolerance * (np.abs(c) @ self._scales[0]):
                first = self._name(course, event.row) if event.row >= 0 else "a signal"
                raise UnsupportedError(
                    f"{self._name(course, a)} and {first} switch together at t = {after.t0:g} s, where the motion has no "
                    "derivative: change a parameter a little"
                )
        hit = event.hit
        if hit is None:
            return
        if len(system.lines) and course.forces.inputs.count:
            raise UnsupportedError(
                f"bodies strike over massless nodes at t = {after.t0:g} s beside non-linear forces, where derivatives are "
                "not known: take outputs before"
            )
        d = system.dynamics
        stays = [i for i in after.mode.closed if d.rigid[i] and hit.bounces[i] and d.restitution[i] > 0.0]
        far = np.abs(after.X - event.R @ after.before) > 1e3 * self.tolerance * self._sizes()
        if far.any() or self._closed_by_impact(hit, stays):
            raise self._accumulation(after.t0)

    @staticmethod
    def _closed_by_impact(hit: Hit, stays: list[int]) -> bool:
        """Return whether a contact that rebounds stays closed, as where impacts have accumulated."""
        return any(hit.paths[:, i].any() for i in stays)

    def _after(self, k: int) -> DoubleDouble:
        """Return X_p (np, N) after the events at the end of segment k."""
        event, _, _, _, X_p = self.arrival(k)
        course = self.solution.courses[k]
        turn = event.row - (len(course.rows) - len(course.phases))
        if event.row >= 0 and turn >= 0 and not self._jumps(course, event.row):
            return X_p
        return super()._after(k)
