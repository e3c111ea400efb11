"""Contact modes with nonlinear forces: non-linear springs, general forces, and loads that are functions of time.

With these forces w as inputs a mode moves by X' = (A + B F) X + (E + B F_w) w(t, X).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import partial
from typing import Any

import numpy as np

from lcpimpact.arrays import Array, Indices
from lcpimpact.hybrid.system import Mode, System
from lcpimpact.memo import Memo, remembered
from lcpimpact.record import State
from lcpimpact.scheme import power_law
from lcpimpact.scheme.first_order import Inputs

ZERO_FOR_EVER = -1
"""Order of the zero of a row that only an input can make nonzero."""


class SpringPhase(IntEnum):
    """Phases of a non-linear spring: open, active, or slack, where it would pull."""

    APART = 0
    PUSHES = 1
    SLACK = 2


@dataclass(frozen=True, eq=False)
class Forces:
    """The inputs w(t, X): the springs, each in a phase of its law, the general forces, and the loads.

    Attributes
    ----------
    inputs : Inputs
    phase : (ns,) array or None
        `SpringPhase` of each spring in this segment: `SLACK` if with c > 0 it would pull. An active one is extended by
        K |δ|ⁿ sign δ through its zero, so that the solver sees no kink before the end of the segment.
        With None the springs follow their law everywhere.
    """

    inputs: Inputs
    phase: Indices | None

    def __call__(self, t: Any, X: Array) -> Array:
        """Return w (..., nw) at X (..., N)."""
        s = self._springs(power_law.forces, X)
        if self.inputs.count == len(self.inputs.law):
            return s
        if np.ndim(t) == 0:
            return np.append(s, self._others(float(t), X))
        return np.column_stack([s, [self._others(float(at), x) for at, x in zip(t, X, strict=True)]])

    def _others(self, t: float, X: Array) -> Array:
        """Return the general forces and the loads (nw - ns,)."""
        loads = np.array([load(t) for load in self.inputs.loads])
        return np.append(self.inputs.motion_forces(t, X), loads) if self.inputs.force_laws else loads

    def extended(self, X: Array) -> Array:
        """Return K |δ|ⁿ sign δ (1 + b δ') + c δ' (..., ns), whether a spring is active or not."""
        return power_law.forces(self.inputs.law, *self._approach(X), extended=True)

    def _springs(self, law: Callable[..., Array], X: Array) -> Array:
        """Return the forces of the springs in their phases (..., ns), or the tangents (3, ..., ns)."""
        if self.phase is None:
            return law(self.inputs.law, *self._approach(X))
        return np.asarray(law(self.inputs.law, *self._approach(X), extended=True) * (self.phase == SpringPhase.PUSHES))

    def _approach(self, X: Array) -> tuple[Array, Array]:
        """Return δ and δ' (..., ns)."""
        known = X[..., : self.inputs.approach.shape[1]]
        return known @ self.inputs.approach.T, known @ self.inputs.rate.T

    def jacobian(self, t: float, X: Array) -> Array:
        """Return ∂w/∂X (nw, N)."""
        known = self.inputs.approach.shape[1]
        slope = np.zeros((self.inputs.count, len(X)))
        _, by_δ, by_rate = self._springs(power_law.tangents, X)
        slope[: len(by_δ), :known] = by_δ[:, None] * self.inputs.approach + by_rate[:, None] * self.inputs.rate
        slope[len(by_δ) : self.inputs.of_state, :known] = self.inputs.motion_tangents(t, X)
        return slope

    def linear(self, t: float, X: Array, later: float, X_later: Array, step: float) -> Array:
        """Return w at a later state, linearised about the state X at t (nw,)."""
        w = self(t, X) + self.jacobian(t, X) @ (X_later - X)
        w[len(self.inputs.law) :] += (later - t) * self.rates(t, X, step, ahead=True)
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

    s are the forces that active springs would have. The last rows are theirs: ``phases`` lists the spring and its next
    phase. ``place`` and ``reaction`` are the matrices that give q and r from X and w, ``velocity`` the one that gives v
    without inputs.
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
        """Return the terms (X, w, s) of which the rows make sums (nt, N + nw + ns)."""
        return np.column_stack([X, self.forces(self.t0 + τ, X), self.forces.extended(X)]) if self.E.shape[1] else X


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
        course = remembered(self, key, lambda: self.course(mode, forces))
        return replace(course, t0=t0, end=end, breaks=breaks)

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
        rows = [np.pad(row, (0, ns)) for row in watch.rows.hi]
        order = zeros.tolist()
        if forces.phase is not None:
            springs, falls = _spring_ends(inputs, forces.phase, len(flow.A))
            rows += falls
            order += [0] * len(falls)
        n = len(system.dynamics.nodes)
        reading = system.coordinates(mode).rows.hi
        weights = np.array(rows).reshape(len(rows), len(flow.A) + inputs.count + ns)
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
        A = np.block([[form.A + inputs.E @ slope, inputs.E], [np.zeros((nw, N + nw))]])
        A[N + len(inputs.law) :, form.constant] = forces.rates(t, X, self.difference_step, ahead=True)
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
        loads = place_w[:, len(self.inputs.law) :]
        if loads.any():
            step = self.difference_step
            rates = [segment.forces.rates(segment.t0 + at, x, step, ahead=False) for at, x in zip(τ, X, strict=True)]
            v += np.array(rates).reshape(len(τ), -1) @ loads.T
        return q, v, np.minimum(np.maximum(X @ F.T + w @ Fw.T, low), high)

    def state(self, segment: ForcedSegment, τ: float, X: Array) -> State:
        """Return a state in the coordinates of the scheme."""
        q, v, r = self.coordinates(segment, np.array([τ]), X[None, :])
        return State(q[0], v[0], r[0])


def _spring_ends(inputs: Inputs, phase: Indices, states: int) -> tuple[tuple[tuple[int, int], ...], list[Array]]:
    """Return the event functions of the springs: spring and next phase, and the row of (X, w, s)."""
    ns, known = len(phase), inputs.approach.shape[1]
    turns: list[tuple[int, int]] = []
    rows: list[Array] = []
    for j in range(ns):
        place = np.zeros(states + inputs.count + ns)
        force = np.zeros(states + inputs.count + ns)
        place[:known] = inputs.approach[j]
        force[states + inputs.count + j] = 1.0
        lossy = inputs.law[j, 4] > 0.0
        if phase[j] == SpringPhase.APART:
            turns.append((j, SpringPhase.PUSHES))
            rows.append(-place)
        elif phase[j] == SpringPhase.PUSHES:
            turns.append((j, SpringPhase.SLACK if lossy else SpringPhase.APART))
            rows.append(force if lossy else place)
        else:
            turns += [(j, SpringPhase.PUSHES), (j, SpringPhase.APART)]
            rows += [-force, place]
    return tuple(turns), rows
