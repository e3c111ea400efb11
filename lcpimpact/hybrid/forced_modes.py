"""Contact modes with nonlinear forces: non-linear springs, general forces, and loads that are functions of time.

With these forces w as inputs a mode moves by X' = (A + B F) X + (E + B F_w) w(t, X).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.hybrid.system import Mode, System
from lcpimpact.memo import Memo, remembered
from lcpimpact.record import State
from lcpimpact.scheme import power_law, rate_law
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.first_order import Inputs, forced_form

ZERO_FOR_EVER = -1
"""Order of the zero of a row that only an input can make nonzero."""


class SpringPhase(IntEnum):
    """Phases of a non-linear spring: open, active, or with its force at the lower or the upper bound."""

    APART = 0
    PUSHES = 1
    LEAST = 2
    MOST = 3


class Arguments(NamedTuple):
    """Changes of what the laws of the forces depend on, in k columns.

    Attributes
    ----------
    approach, rate : (ns, k) arrays     δ and δ' of the springs
    place, speed : (ng, k) arrays       q and v of the nodes of the general forces
    parting : (nd, k) array             the rates of the dashpots, by all but w
    given : (nw, k) array               w itself, by time; 0 for the dashpots
    """

    approach: Array
    rate: Array
    place: Array
    speed: Array
    parting: Array
    given: Array


@dataclass(frozen=True, eq=False)
class Forces:
    """The inputs w(t, X): the springs, each in a phase of its law, the general forces, and the loads.

    Attributes
    ----------
    inputs : Inputs
    phase : (ns,) array or None
        `SpringPhase` of each spring in this segment. Its force is extended by K |δ|ⁿ sign δ through its zero, so that the
        solver sees no kink before the end of the segment.
        With None the springs follow their law everywhere.
    reacts : pair of (nc, N) and (nc, nw) arrays, optional
        F and F_w of the mode, r = F X + F_w w, which moves the ends of dashpots at massless nodes; None without contacts.
    """

    inputs: Inputs
    phase: Indices | None
    reacts: tuple[Array, Array] | None = None

    def __call__(self, t: Any, X: Array) -> Array:
        """Return w (..., nw) at X (..., N)."""
        s = self._springs(power_law.forces, X)
        if self.inputs.count == len(self.inputs.law):
            return s
        s = np.concatenate([s, np.zeros((*s.shape[:-1], len(self.inputs.rate_laws)))], axis=-1)
        if self.inputs.count == self.inputs.given:
            w = s
        elif np.ndim(t) == 0:
            w = np.append(s, self._others(float(t), X))
        else:
            w = np.column_stack([s, [self._others(float(at), x) for at, x in zip(t, X, strict=True)]])
        if len(self.inputs.rate_laws):
            v, laws = self._parting(X, w), self.inputs.rate_laws
            w[..., self.inputs.of_dashpots] = -laws[:, 7] * v - rate_law.forces(laws, v)
        return w

    def _parting(self, X: Array, w: Array) -> Array:
        """Return the rates of the dashpots (..., nd) under the other forces in w (..., nw), where their own are zero."""
        by_X, by_w = self._follow
        known = X[..., : by_X.shape[1]]
        return rate_law.rates(self.inputs.rate_laws, by_w[:, self.inputs.of_dashpots], known @ by_X.T + w @ by_w.T)

    def parting(self, t: float, X: Array) -> Array:
        """Return the rates of the dashpots at X (nd,)."""
        w = self(t, X)
        w[self.inputs.of_dashpots] = 0.0
        return self._parting(X, w)

    @cached_property
    def _follow(self) -> tuple[Array, Array]:
        """How the rates of the dashpots follow from the states, and from w, in the mode (nd, N) and (nd, nw)."""
        by_X, by_w = self.inputs.parting, self.inputs.w_parting
        if self.reacts is None:
            return by_X, by_w
        F, Fw = self.reacts
        widened = np.pad(by_X, ((0, 0), (0, F.shape[1] - by_X.shape[1])))
        return widened + self.inputs.r_parting @ F, by_w + self.inputs.r_parting @ Fw

    def reaction(self, t: float, X: Array) -> Array:
        """Return r in the mode (nc,), 0 without one."""
        if self.reacts is None:
            return np.zeros(self.inputs.r_parting.shape[1])
        F, Fw = self.reacts
        return np.asarray(F @ X + Fw @ self(t, X))

    def _others(self, t: float, X: Array) -> Array:
        """Return the general forces and the loads (nw - ns,)."""
        loads = np.array([load(t) for load in self.inputs.loads])
        return np.append(self.inputs.motion_forces(t, X), loads) if self.inputs.force_laws else loads

    def extended(self, X: Array) -> Array:
        """Return the forces that active springs would have, and those without damping (..., 2 ns)."""
        δ, rate = self._approach(X)
        parts = [power_law.forces(law, δ, rate, extended=True) for law in (self.inputs.law, self.inputs.elastic_law)]
        return np.concatenate(parts, axis=-1)

    def _springs(self, law: Callable[..., Array], X: Array) -> Array:
        """Return the forces of the springs in their phases (..., ns), or the tangents (3, ..., ns)."""
        if self.phase is None:
            return law(self.inputs.law, *self._approach(X))
        found = law(self.inputs.law, *self._approach(X), extended=True) * (self.phase == SpringPhase.PUSHES)
        bounds = self.inputs.law[:, 7:]
        bound = np.select([self.phase == SpringPhase.LEAST, self.phase == SpringPhase.MOST], list(bounds.T), 0.0)
        if bound.any():
            found = found + law(self.inputs.elastic_law, *self._approach(X), extended=True) * bound
        return np.asarray(found)

    def _approach(self, X: Array) -> tuple[Array, Array]:
        """Return δ and δ' (..., ns)."""
        known = X[..., : self.inputs.approach.shape[1]]
        return known @ self.inputs.approach.T, known @ self.inputs.rate.T

    def jacobian(self, t: float, X: Array) -> Array:
        """Return ∂w/∂X (nw, N)."""
        return self.response(t, X, self.arguments(len(X)))

    def arguments(self, states: int) -> Arguments:
        """Return the rows (..., N) that give the arguments of the laws from X."""
        i = self.inputs
        rows = i.approach, i.rate, i.place, i.speed, self._follow[0], np.zeros((i.count, states))
        return Arguments(*(np.pad(each, ((0, 0), (0, states - each.shape[1]))) for each in rows))

    @property
    def parting_by_w(self) -> Array:
        """How the rates of the dashpots follow from w in the mode (nd, nw)."""
        return self._follow[1]

    def response(self, t: float, X: Array, change: Arguments) -> Array:
        """Return the changes of w (nw, k) by those of the arguments of its laws."""
        inputs = self.inputs
        w = change.given.copy()
        if len(inputs.law):
            _, by_δ, by_rate = self._springs(power_law.tangents, X)
            w[: len(by_δ)] += by_δ[:, None] * change.approach + by_rate[:, None] * change.rate
        if inputs.force_laws:
            by_q, by_v = inputs.motion_tangents(t, X)
            w[inputs.given : inputs.of_state] += by_q @ change.place + by_v @ change.speed
        if len(inputs.rate_laws):
            by_w = self._follow[1]
            w[inputs.of_dashpots] = self.tangents(t, X, by_w) @ (change.parting + by_w @ w)
        return w

    def extended_response(self, X: Array, change: Arguments) -> Array:
        """Return the changes of `extended` (2 ns, k)."""
        parts = []
        for law in (self.inputs.law, self.inputs.elastic_law):
            _, by_δ, by_rate = power_law.tangents(law, *self._approach(X), extended=True)
            parts.append(by_δ[:, None] * change.approach + by_rate[:, None] * change.rate)
        return np.concatenate(parts)

    def tangents(self, t: float, X: Array, by_w: Array) -> Array:
        """Return ∂d/∂v of the forces d of the dashpots by rates v that would be, without the part by_w d (nd, nd)."""
        laws = self.inputs.rate_laws
        J = np.diag(-laws[:, 7] - rate_law.slopes(laws, self.parting(t, X)))
        return np.asarray(np.linalg.solve(np.eye(len(J)) - J @ by_w[:, self.inputs.of_dashpots], J))

    def linear(self, t: float, X: Array, later: float, X_later: Array, step: float) -> Array:
        """Return w at a later state, linearised about the state X at t (nw,)."""
        w = self(t, X) + self.jacobian(t, X) @ (X_later - X)
        w[self.inputs.given :] += (later - t) * self.rates(t, X, step, ahead=True)
        return w

    def rates(self, t: float, X: Array, step: float, ahead: bool) -> Array:
        """Return ∂/∂t of the general forces and the loads: central differences, or one-sided ones of the same order."""
        f = partial(self._others, X=X)
        if ahead:
            return np.asarray((4.0 * f(t + step) - f(t + 2.0 * step) - 3.0 * f(t)) / (2.0 * step))
        return np.asarray((f(t + step) - f(t - step)) / (2.0 * step))


@dataclass(frozen=True, eq=False)
class ForcedSegment:
    """One mode from t0 on: X' = A X + E w(t0 + τ, X), with event functions c·(X, w, s).

    It ends at ``end`` at the latest: the end of the run or, if it ``breaks``, a breakpoint of the signals.

    s are the forces that active springs would have, with and without damping. The last rows are theirs: ``phases`` lists
    the spring and its next phase. ``place`` and ``reaction`` are the matrices that give q and r from X and w, ``velocity``
    the one that gives v without inputs.
    """

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
    t0: float = 0.0
    end: float = 0.0
    breaks: bool = False

    def rate(self, τ: float | Array, X: Array) -> Array:
        """Return X' (..., N)."""
        if not self.E.shape[1]:
            return X @ self.A.T
        return X @ self.A.T + self.forces(self.t0 + τ, X) @ self.E.T

    def jacobian(self, τ: float, X: Array) -> Array:
        """Return ∂X'/∂X (N, N)."""
        return self.A + self.E @ self.forces.jacobian(self.t0 + τ, X)

    def watched(self, τ: Array, X: Array) -> Array:
        """Return the terms (X, w, s) of which the rows make sums (nt, N + nw + 2 ns)."""
        return np.column_stack([X, self.forces(self.t0 + τ, X), self.forces.extended(X)]) if self.E.shape[1] else X

    def value(self, row: Array, τ: float, dense: Callable[[float | Array], Array]) -> float:
        """Return the value of a row at t0 + τ on the dense output."""
        if not self.E.shape[1]:
            return float(row @ dense(τ))
        at = np.array([τ])
        return float((self.watched(at, dense(at).T) @ row)[0])


@dataclass(frozen=True, eq=False)
class ForcedSystem(Memo):
    """A system with the inputs w, and its modes as initial value problems.

    Attributes
    ----------
    system : System
    inputs : Inputs
    difference_step : float     step in s of the difference quotients of loads
    """

    system: System
    inputs: Inputs
    difference_step: float

    @classmethod
    def of(cls, dynamics: Dynamics, duration: float, method: str) -> ForcedSystem:
        """Return the system of a run of ``duration`` s by a method."""
        form, inputs = forced_form(dynamics, method)
        return cls(System(dynamics, duration, form, (inputs.E, inputs.D)), inputs, 1e-6 * duration)

    @property
    def added(self) -> slice:
        """Positions of the forces in the states of the linearised system."""
        N = len(self.system.form.A)
        return slice(N, N + self.inputs.count)

    def without_inputs(self, X: Array) -> Array:
        """Return a state of the linearised system without its forces."""
        return np.delete(X, self.added) if self.inputs.count else X

    def segment(self, mode: Mode, forces: Forces, t0: float, end: float, breaks: bool) -> ForcedSegment:
        """Return the segment of a mode that begins at t0."""
        key = mode, None if forces.phase is None else tuple(forces.phase.tolist())
        course = remembered(self, key, lambda: self.course(mode, self.in_mode(mode, forces)))
        return replace(course, t0=t0, end=end, breaks=breaks)

    def in_mode(self, mode: Mode | None, forces: Forces) -> Forces:
        """Return forces whose dashpots move as in a mode."""
        if mode is None or not len(self.inputs.rate_laws):
            return forces
        return replace(forces, reacts=(self.system.mode(mode)[1], self.system.input_response(mode)))

    def course(self, mode: Mode, forces: Forces) -> ForcedSegment:
        """Return a segment of a mode, without an instant."""
        system, inputs = self.system, self.inputs
        flow, F = system.mode(mode)
        Fw = system.input_response(mode)
        E = system.input_matrices[0] + system.matrices[1] @ Fw
        # A row that is zero for ever in a linear system may change under an input.
        watch = system.watch(replace(mode, order=tuple(max(m, 0) for m in mode.order)) if inputs.count else mode)
        zeros = np.where(np.array(mode.order, dtype=np.int64)[watch.contacts] >= 0, watch.order, ZERO_FOR_EVER)
        ns = len(inputs.law)
        springs: tuple[tuple[int, int], ...] = ()
        rows = [np.pad(row, (0, 2 * ns)) for row in watch.rows.hi]
        order = zeros.tolist()
        if forces.phase is not None:
            springs, falls = _spring_ends(inputs, forces.phase, len(flow.A))
            rows += falls
            order += [0] * len(falls)
        n = len(system.dynamics.nodes)
        reading = system.coordinates(mode).rows.hi
        weights = np.array(rows).reshape(len(rows), len(flow.A) + inputs.count + 2 * ns)
        return ForcedSegment(
            mode=mode, A=flow.A, E=E, forces=forces, rows=weights, order=np.array(order, dtype=np.int64), phases=springs,
            place=(reading[:n], inputs.Q + system.read[1] @ Fw), reaction=(F, Fw), velocity=reading[n : 2 * n],
        )  # fmt: skip

    def linearized(self, t: float, X: Array, forces: Forces, scale: Array, sizes: Array) -> tuple[System, Array, Array]:
        """Return the system linearised about t and X, with X and its scale in it; ``sizes`` (nw,) are the largest |w|.

        With w = a + S X + a' τ the numbers a are states, the last before the positions of sliders, so that each has its
        scale.
        """
        system, inputs = self.system, self.inputs
        form = system.form
        N = len(system.form.A)
        nw = inputs.count
        w, slope = forces(t, X), forces.jacobian(t, X)[:, :N]
        by_r = np.zeros((nw, form.B.shape[1]))
        if len(inputs.rate_laws):
            # The reactions move the dashpots too, so that they are no part of what is known.
            free = inputs.w_parting
            by_v = forces.tangents(t, X, free)
            slope[inputs.of_dashpots] = 0.0
            slope[inputs.of_dashpots] = by_v @ (inputs.parting + free @ slope)
            by_r[inputs.of_dashpots] = by_v @ inputs.r_parting
            w = w - by_r @ forces.reaction(t, X)
        A = np.block([[form.A + inputs.E @ slope, inputs.E], [np.zeros((nw, N + nw))]])
        A[N + inputs.given :, form.constant] = forces.rates(t, X, self.difference_step, ahead=True)
        linear = replace(
            form,
            A=A,
            B=np.vstack([form.B + inputs.E @ by_r, np.zeros((nw, form.B.shape[1]))]),
            D=form.D + inputs.D @ by_r,
            Qr=form.Qr + inputs.Q @ by_r,
            C=np.column_stack([form.C + inputs.D @ slope, inputs.D]),
            Q=np.column_stack([form.Q + inputs.Q @ slope, inputs.Q]),
            signals=np.append(form.signals, np.zeros(nw)),
            rest=None,
        )
        grown = np.concatenate([X[:N], w - slope @ X[:N], X[N:]])
        return System(system.dynamics, system.duration, linear), grown, np.concatenate([scale[:N], sizes, scale[N:]])

    def coordinates(self, segment: ForcedSegment, τ: Array, X: Array) -> tuple[Array, Array, Array]:
        """Return q, v and r for the states X (nt, N) at t0 + τ."""
        place, place_w = segment.place
        F, Fw = segment.reaction
        low, high = self.system.bounds
        if not self.inputs.count:
            return X @ place.T, X @ segment.velocity.T, np.minimum(np.maximum(X @ F.T, low), high)
        w = segment.forces(segment.t0 + τ, X)
        q = X @ place.T + w @ place_w.T
        v = segment.rate(τ, X) @ place.T
        loads = place_w[:, self.inputs.given :]
        if loads.any():
            step = self.difference_step
            rates = [segment.forces.rates(segment.t0 + at, x, step, ahead=False) for at, x in zip(τ, X, strict=True)]
            v += np.array(rates).reshape(len(τ), -1) @ loads.T
        return q, v, np.minimum(np.maximum(X @ F.T + w @ Fw.T, low), high)

    def state(self, segment: ForcedSegment, τ: float, X: Array) -> State:
        """Return a state in the coordinates of the scheme."""
        q, v, r = self.coordinates(segment, np.array([τ]), X[None, :])
        return State(q[0], v[0], r[0])


def active(law: Array, phase: Indices) -> Flags:
    """Return the flags of springs that have a force in their phase (ns,)."""
    pushes = np.isin(phase, (SpringPhase.PUSHES, SpringPhase.MOST))
    return np.asarray(pushes | ((phase == SpringPhase.LEAST) & (law[:, 7] > 0.0)))


def _spring_ends(inputs: Inputs, phase: Indices, states: int) -> tuple[tuple[tuple[int, int], ...], list[Array]]:
    """Return the event functions of the springs: spring and next phase, and the row of (X, w, s)."""
    ns, known = len(phase), inputs.approach.shape[1]
    turns: list[tuple[int, int]] = []
    rows: list[Array] = []
    for j in range(ns):
        place, force, elastic = np.zeros((3, states + inputs.count + 2 * ns))
        place[:known] = inputs.approach[j]
        force[states + inputs.count + j] = 1.0
        elastic[states + inputs.count + ns + j] = 1.0
        p, depth, least, most = inputs.law[j, 5:]
        ends: list[tuple[SpringPhase, Array]] = [(SpringPhase.APART, place)]
        if phase[j] == SpringPhase.APART:
            ends = [(SpringPhase.MOST if most < np.inf else SpringPhase.PUSHES, -place)]
        elif phase[j] == SpringPhase.PUSHES:
            if least > -np.inf:
                # The force of a dashpot that acts at once is zero before the ends part.
                ends = [*ends[: int(p + depth > 0.0)], (SpringPhase.LEAST, force - least * elastic)]
            if most < np.inf:
                ends.append((SpringPhase.MOST, most * elastic - force))
        elif phase[j] == SpringPhase.LEAST:
            ends.insert(0, (SpringPhase.PUSHES, least * elastic - force))
        else:
            ends.insert(0, (SpringPhase.PUSHES, force - most * elastic))
        turns += [(j, end) for end, _ in ends]
        rows += [row for _, row in ends]
    return tuple(turns), rows
