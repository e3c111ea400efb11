"""Where one contact mode ends: impacts, the mode that follows, and the events that this makes."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array, Flags
from lcpimpact.double_double import DoubleDouble
from lcpimpact.hybrid.flow import on_rows
from lcpimpact.hybrid.gaps import scale_after, settled, still
from lcpimpact.hybrid.impacts import impact
from lcpimpact.hybrid.mode_choice import choose_mode
from lcpimpact.hybrid.system import ZERO, Mode, Still, System
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


class Transition(NamedTuple):
    """How one mode goes over to the next.

    Attributes
    ----------
    mode : Mode                     the mode in which the motion goes on
    state : DoubleDouble            the state after the impacts (N,)
    left : DoubleDouble             the state before them (N,): at a breakpoint of the signals their left limits
    events : tuple of Event         what happened
    scale : (N,) array              the scale of the motion, with what the impulses have done
    """

    mode: Mode
    state: DoubleDouble
    left: DoubleDouble
    events: tuple[Event, ...]
    scale: Array


def arrive(
    system: System, t: float, before: Mode | None, X: DoubleDouble, scale: Array, held: Still, breakpoint: bool
) -> tuple[DoubleDouble, DoubleDouble | None, Still]:
    """Return the state at t with what the mode before holds at zero, its left limit at a breakpoint, and what is held.

    At a ``breakpoint`` the signals in X are left limits, and go over to the right ones; a prescribed velocity may jump.
    """
    state = settled(system, before, X, scale, held)
    if not breakpoint:
        return state, None, held
    return system.form.right_of(t, state, scale), state, replace(held, U=np.zeros_like(held.U))


def enter(
    system: System,
    t: float,
    before: Mode | None,
    X: ArrayLike | DoubleDouble,
    scale: Array,
    solver: str,
    *,
    zero: float = ZERO,
    together: Flags | None = None,
    held: Still | None = None,
    breakpoint: bool = False,
    v: Array | None = None,
) -> Transition:
    """Return the transition at t from the mode before, in which X is reached, to the next one.

    Without a mode before, at the start of a run, the right limit stands for both. What the mode before holds closed stays so
    unless an impulse, its own force or a jump of a prescribed velocity ends it. The rows ``together`` (nc,) touch, and meet
    without restitution: where impacts have accumulated; ``held`` is what is at zero where the mode before does not tell.
    v (n,) are the velocities before the start of a run, with those of massless nodes, which are no part of X.
    """
    held, restitution, given = held or still(system, before), system.restitution, DoubleDouble.of(X)
    if together is not None:
        held = replace(held, u=held.u | (together & (system.degree > 0)), closed=held.closed | together)
        restitution = np.where(together, 0.0, restitution)
    state, left, held = arrive(system, t, before, given, scale, held, breakpoint)
    last = state if left is None else left
    U: Array | DoubleDouble | None = None if v is None else system.dynamics.gap_rate(v)
    if before is not None and system.mixed:
        U = system.rates(before) @ last
    after, P, held = impact(system, state, scale, solver, restitution, held, zero, left=left, rates=U)
    scale = scale_after(system, scale, P)
    mode, after = choose_mode(system, after, scale, solver, held, zero)
    was, now = state_of(system, before or mode, last), state_of(system, mode, after)
    if v is not None:
        was = replace(was, v=v)
    events = happened(system, t, before or mode, mode, P, was, now)
    return Transition(mode, after, given if left is None else left, tuple(events), scale)


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
