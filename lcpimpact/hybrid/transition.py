"""Transitions between contact modes: impacts, the next mode, and the events."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array, Flags
from lcpimpact.hybrid.gaps import scale_after, settled, still
from lcpimpact.hybrid.generator import on_rows
from lcpimpact.hybrid.impacts import impact
from lcpimpact.hybrid.mode_choice import choose_mode
from lcpimpact.hybrid.system import ZERO, Mode, Still, System
from lcpimpact.numerics.double_double import DoubleDouble
from lcpimpact.record import Event, State
from lcpimpact.scheme.dynamics import Dynamics


def parted(system: System, found: Array) -> tuple[Array, Array, Array]:
    """Return q, v and r, clipped to its bounds, from the values of the rows of `System.coordinates` (..., 2 n + nc)."""
    n = len(system.dynamics.nodes)
    r_min, r_max = system.bounds
    return found[..., :n], found[..., n : 2 * n], np.minimum(np.maximum(found[..., 2 * n :], r_min), r_max)


def coordinates(system: System, mode: Mode, X: Array) -> tuple[Array, Array, Array]:
    """Return q, v and r for states X (nt, N) of one mode, in floats."""
    return parted(system, X @ system.coordinates(mode).rows.hi.T)


def state_of(system: System, mode: Mode, X: ArrayLike | DoubleDouble) -> State:
    """Return the state X (N,) in the coordinates of the scheme."""
    parts = np.ascontiguousarray(DoubleDouble.of(X).parts)
    return State(*parted(system, on_rows(system.coordinates(mode).entries, parts)))


class Transition(NamedTuple):
    """The transition from one mode to the next.

    Attributes
    ----------
    mode : Mode                     the next mode
    state : DoubleDouble            the state after the impacts (N,)
    left : DoubleDouble             the state before them (N,): at a breakpoint of the signals their left limits
    events : tuple of Event         the events
    scale : (N,) array              the scale of the motion, including the effect of the impulses
    """

    mode: Mode
    state: DoubleDouble
    left: DoubleDouble
    events: tuple[Event, ...]
    scale: Array


def arrive(
    system: System, t: float, before: Mode | None, X: DoubleDouble, scale: Array, held: Still, breakpoint: bool
) -> tuple[DoubleDouble, DoubleDouble | None, Still]:
    """Return the state at t with the constraints of the last mode at zero, its left limit at a breakpoint, and the zeros.

    At a ``breakpoint`` the signals in X are left limits, replaced by right limits; a prescribed velocity may jump.
    """
    state = settled(system, before, X, scale, held)
    if not breakpoint:
        return state, None, held
    d = system.dynamics
    u = held.u & ~(d.H[:, d.jumping] != 0.0).any(axis=1)
    return system.form.right_of(t, state, scale), state, replace(held, u=u, U=np.zeros_like(held.U))


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
    """Return the transition at t from the last mode, in which X is reached, to the next one.

    At the start of a run, without a last mode, the right limit serves as both. Closed contacts stay closed unless an
    impulse, their own force or a jump of a prescribed velocity opens them. The rows ``together`` (nc,), where impacts
    have accumulated, close without restitution; ``held`` are the zeros that the last mode does not determine. v (n,) are
    the velocities before the start of a run, with those of massless nodes, which are not in X.
    """
    held = held or still(system, before)
    restitution = system.dynamics.restitution
    given = DoubleDouble.of(X)
    if together is not None:
        held = replace(held, u=held.u | (together & (system.degree > 0)), closed=held.closed | together)
        restitution = np.where(together, 0.0, restitution)
    state, left, held = arrive(system, t, before, given, scale, held, breakpoint)
    last = state if left is None else left
    U: Array | DoubleDouble | None = None if v is None else system.dynamics.H @ v
    if before is not None and system.mixed:
        U = system.rates(before) @ last
    after, P, held = impact(system, state, scale, solver, restitution, held, zero, left=left, rates=U)
    scale = scale_after(system, scale, P)
    after = system.form.sampled(t, after, scale)
    mode, after = choose_mode(system, after, scale, solver, held, zero)
    was = state_of(system, before or mode, last)
    now = state_of(system, mode, after)
    if v is not None:
        was = replace(was, v=v)
    events = happened(system.dynamics, t, before or mode, mode, P, was, now)
    return Transition(mode, after, given if left is None else left, tuple(events), scale)


def happened(
    d: Dynamics, t: float, before: Mode, after: Mode, P: Array, left: State, right: State, kind: str = "impact"
) -> list[Event]:
    """Return the events between two modes, with the impulses P (nc,) of one ``kind``."""
    found = []
    for i, contact in enumerate(d.contacts):
        if P[i] != 0.0:
            found.append(Event(t, contact.name, kind, left, right, float(P[i]), d.law_of_impacts))
        if change := _change(d, before, after, i):
            found.append(Event(t, contact.name, change, left, right))
    return found


def _change(d: Dynamics, before: Mode, after: Mode, i: int) -> str:
    """Return the kind of event of row i between two modes; "" if there is none."""
    contact = d.contacts[i]
    law, slips = contact.law, dict(after.slips)
    if i in slips:
        return law.at_bound if slips[i] != dict(before.slips).get(i) else ""
    # A row of a system that is closed without ever having a force, as a diode that another one keeps at zero, is not said.
    closed, was = (i in mode.closed and (d.stores_energy or mode.order[i] >= 0) for mode in (after, before))
    if closed:
        return law.between if not was else ""
    return law.at_bound if contact.impenetrable and was else ""
