"""The events within a step of an explicit Runge-Kutta method: impacts, closings and openings."""

from __future__ import annotations

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.integrators.stepping.runge_kutta.loop import GridValues
from lcpimpact.integrators.stepping.runge_kutta.right_side import add_dashpots
from lcpimpact.integrators.stepping.runge_kutta.run import RungeKuttaRun, coordinates
from lcpimpact.record import Event, State


def happened(run: RungeKuttaRun, t: Array, motion: GridValues) -> list[Event]:
    """Return the events of a step from the first to the second of two states, with the impulses P of the second.

    A contact of degree 0 closes where the line through its gaps is zero, and any contact opens where that of u^(ρ) is, which
    is -G r while r pushes, or at the end of the step, where a load jumps there. The limits of an impact are the state after
    it, moved back to its instant, and that without P.
    """
    d = run.system.dynamics
    degree = run.system.degree
    y = motion.y
    dy = motion.dy
    r = motion.r
    P = motion.P
    since = motion.since
    C = run.matrices.C
    O = run.matrices.O  # noqa: E741
    O_s = run.matrices.O_s
    G = run.matrices.G
    B = run.matrices.B
    q, v = coordinates(run, t, y, dy, r)
    given = run.given(t)
    after = np.append(y[1], given[1])
    gap = np.array([C @ np.append(y[0], given[0]), C @ after])
    s = np.empty(run.inputs.of_state)
    run.forces(after, run.matrices, s)
    add_dashpots(after, run.matrices, r[1], r[1] > 0.0, s, np.empty((1, len(run.inputs.rate_laws))))
    x_left = np.append(y[1], run.given_in_steps(t, np.ones(1), float(t[1] - t[0]))[0, 0])
    parting = np.array([-r[0] * np.diag(G), O @ x_left + O_s @ s + G @ r[1]])
    left, right = State(q[0], v[0], r[0]), State(q[1], v[1], r[1])
    closed = r > 0.0
    if t[0] == 0.0:
        # Contacts closed at the start are so even if their force starts from zero.
        closed[0] |= (gap[0] <= 0.0) & closed[1]
    found = []
    for i, contact in enumerate(d.contacts):
        meets = _zero(t, gap[:, i]) if degree[i] == 0 else float(t[1] - since[1, i])
        if degree[i] == 2 and P[1, i] > 0.0:
            back = y[1] - since[1, i] * dy[1]
            before, behind = (
                _at_event(run, meets, x, dy[1], force) for x, force in ((back - B @ P[1], r[0]), (back, r[1]))
            )
            found.append(Event(meets, contact.name, "impact", before, behind, float(P[1, i]), d.law_of_impacts))
        if closed[1, i] and not closed[0, i]:
            found.append(Event(meets, contact.name, "close", left, right))
        if closed[0, i] and not closed[1, i]:
            found.append(Event(_zero(t, parting[:, i]), contact.name, "open", left, right))
    return sorted(found, key=lambda event: event.t)


def _at_event(run: RungeKuttaRun, t: float, y: Array, dy: Array, r: Array) -> State:
    """Return one limit of an impact; the velocities of nodes with mass are from y, of other nodes from dy."""
    q, v = coordinates(run, np.array([t]), y[None], dy[None], r[None])
    massive = run.form.parts.massive
    return State(q[0], v[0] + massive @ (y[len(y) - massive.shape[1] :] - massive.T @ v[0]), r)


def _zero(t: Array, values: Array) -> float:
    """Return the instant at which the line through two values of different sign is zero, or the later instant."""
    if not min(values) < 0.0 < max(values):
        return float(t[1])
    return float(t[0] + (t[1] - t[0]) * values[0] / (values[0] - values[1]))
