"""Where one contact mode ends: impacts, the mode that follows, and the events that this makes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array, Flags
from lcpimpact.double_double import DoubleDouble
from lcpimpact.hybrid.flow import on_rows
from lcpimpact.hybrid.modes import ZERO, Mode, Still, System, choose_mode, impact, scale_after, settled, still
from lcpimpact.record import Event, State


def parted(system: System, found: Array) -> tuple[Array, Array, Array]:
    """Return q, v and r, within its bounds, from what the rows of `System.coordinates` give (..., 2 n + nc)."""
    n = len(system.dynamics.nodes)
    r_min, r_max = system.bounds
    return found[..., :n], found[..., n : 2 * n], np.minimum(np.maximum(found[..., 2 * n :], r_min), r_max)


def coordinates(system: System, mode: Mode, X: Array) -> tuple[Array, Array, Array]:
    """Return q, v and r for states X (nt, N) of one mode, in floats."""
    return parted(system, X @ system.coordinates(mode).rows.hi.T)


def state_of(system: System, mode: Mode, X: ArrayLike | DoubleDouble) -> State:
    """Return what one state X (N,) means in the coordinates of the scheme."""
    parts = np.ascontiguousarray(DoubleDouble.of(X).parts)
    return State(*parted(system, on_rows(system.coordinates(mode).entries, parts)))


def enter(
    system: System,
    t: float,
    before: Mode | None,
    X: ArrayLike | DoubleDouble,
    scale: Array,
    solver: str,
    zero: float = ZERO,
    together: Flags | None = None,
    held: Still | None = None,
    left: DoubleDouble | None = None,
    v: Array | None = None,
) -> tuple[Mode, DoubleDouble, list[Event]]:
    """Return the mode in which the motion goes on from X, the state after the impacts at t, and what happened.

    Without a mode before, at the start of a run, the right limit stands for both. What the mode before holds closed stays so
    unless an impulse, its own force or a jump of a prescribed velocity ends it. The rows ``together`` (nc,) touch, and meet
    without restitution: where impacts have accumulated; ``held`` is what is at zero where the mode before does not tell.
    ``left`` is the state before, where signals in X have jumped, and v (n,) are the velocities before the start of a run,
    with those of massless nodes, which are no part of X.
    """
    held, restitution = held or still(system, before), system.restitution
    if together is not None:
        held = replace(held, u=held.u | (together & (system.degree > 0)), closed=held.closed | together)
        restitution = np.where(together, 0.0, restitution)
    if left is not None:
        held, state = replace(held, U=np.zeros_like(held.U)), DoubleDouble.of(X)
    else:
        state = settled(system, before, DoubleDouble.of(X), scale, held)
    U: Array | DoubleDouble | None = None if v is None else system.dynamics.gap_rate(v)
    if before is not None and system.mixed:
        U = system.rates(before) @ (state if left is None else left)
    after, P, held = impact(system, state, scale, solver, restitution, held, zero, left=left, rates=U)
    mode, after = choose_mode(system, after, scale_after(system, scale, P), solver, held, zero)
    was, now = state_of(system, before or mode, state if left is None else left), state_of(system, mode, after)
    if v is not None:
        was = replace(was, v=v)
    return mode, after, happened(system, t, before or mode, mode, P, was, now)


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
