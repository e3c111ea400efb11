"""Where one contact mode ends: impacts, the mode that follows, and the events that this makes."""

from __future__ import annotations

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.integrators.base import Event, State
from lcpimpact.integrators.modes import Mode, System, choose_mode, impact


def coordinates(system: System, mode: Mode, X: Array) -> tuple[Array, Array, Array]:
    """Return q, v and r for the states X (nt, N) of one mode."""
    flow, F = system.mode(mode)
    Q, Qr = system.read
    read = Q + Qr @ F
    r = np.clip(X @ F.T, system.dynamics.r_min, system.dynamics.r_max)
    return X @ read.T, X @ (read @ flow.A).T, r


def state_of(system: System, mode: Mode, X: Array) -> State:
    """Return what one state X (N,) means in the coordinates of the scheme."""
    q, v, r = coordinates(system, mode, X[None, :])
    return State(q[0], v[0], r[0])


def enter(
    system: System, t: float, before: Mode | None, X: Array, scale: Array, solver: str
) -> tuple[Mode, Array, list[Event]]:
    """Return the mode in which the motion goes on from X, the state after the impacts at t, and what happened.

    Without a mode before, at the start of a run, the right limit stands for both.
    """
    after, P = impact(system, X, scale, solver)
    mode, after = choose_mode(system, after, scale, solver)
    right = state_of(system, mode, after)
    left = state_of(system, before or mode, X)
    return mode, after, happened(system, t, before or mode, mode, P, left, right)


def happened(system: System, t: float, before: Mode, after: Mode, P: Array, left: State, right: State) -> list[Event]:
    """Return the events that lead from one mode to another, with the impulses P (nc,)."""
    found = []
    for i, contact in enumerate(system.dynamics.contacts):
        if P[i] > 0.0:
            found.append(Event(t, contact.name, "impact", left, right, float(P[i])))
        if kind := _change(before, after, i, contact.r0 is not None):
            found.append(Event(t, contact.name, kind, left, right))
    return found


def _change(before: Mode, after: Mode, i: int, slider: bool) -> str | None:
    """Return what happens to row i between two modes, if anything."""
    if slider:
        slips = dict(after.slips)
        if i in slips:
            return "slip" if slips[i] != dict(before.slips).get(i) else None
        return "stick" if i not in before.closed else None
    if (i in before.closed) == (i in after.closed):
        return None
    return "close" if i in after.closed else "open"
