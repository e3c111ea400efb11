"""Events of unilateral contacts in compiled code, one after the other and without the interpreter.

Between events it is `lcpimpact.hybrid.windows`, at events `lcpimpact.hybrid.contacts`. All else is left to
`lcpimpact.hybrid.transition`, event by event: redundant contacts, accumulating impacts, breakpoints of signals, and modes
that last for many windows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum
from threading import Lock
from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Array, FlagMatrix, Flags, IndexMatrix, Indices, Matrix, Stack, Stacks, Vector
from lcpimpact.compiled import compiled
from lcpimpact.hybrid.contacts import choose, settle, size_of, strike
from lcpimpact.hybrid.gaps import reading
from lcpimpact.hybrid.generator import Generator, SparseRows, on_rows, sparse
from lcpimpact.hybrid.system import FINE_ZERO, Mode, Plant, System, contact_mode
from lcpimpact.hybrid.windows import Window, hulls, scan
from lcpimpact.memo import remembered
from lcpimpact.numerics.double_double import add
from lcpimpact.numerics.rounding import EPS

ADDING = Lock()
"""Lock for adding a mode to a table, which runs of one problem in several threads share."""

WINDOWS = 512
"""Number of windows of a mode above which the general code looks for its end, as it does at once in a stiff flow."""

GAP_RESOLUTION = 2.0**-65
"""Gap, relative to its terms, below which it has fewer than nine digits."""

MIN_FLIGHTS, LAST_FLIGHT_RTOL = 3, 2.0**-52
"""Impacts accumulate after MIN_FLIGHTS consecutive flights, each shorter than LAST_FLIGHT_RTOL times the time passed."""

END_RTOL = 4.0 * EPS
"""Delay of an event after the end, relative to it, below which the event is at the end."""


class Reason(IntEnum):
    """Reasons for which the compiled loop returns.

    The instant is reached, the next event is left to the general code, its mode is not in the table, the last mode has no
    end yet, or the log is full.
    """

    REACHED = 0
    GENERAL = 1
    NEW_MODE = 2
    NO_END = 3
    FULL = 4


class Modes(NamedTuple):
    """The modes met so far (nm): closed rows, windows and how many to scan, exp(A δ), `hulls`; A, event rows and readings.

    The entries of all sparse matrices of a kind are in one array, into which the rows of ``starts`` point.
    """

    closed: FlagMatrix
    δ: Vector
    scanned: Indices
    step: Stacks
    hull: Stacks
    entries: Matrix
    starts: IndexMatrix
    columns: Indices
    row_entries: Matrix
    row_starts: IndexMatrix
    row_columns: Indices
    read_entries: Matrix
    read_starts: IndexMatrix
    read_columns: Indices


class Present(NamedTuple):
    """The present state of the motion: its last segment and the next event; the loop changes these arrays.

    Attributes
    ----------
    start, state : (2,), (2, N) arrays  initial instant and state of the last segment
    t, X : (2,), (2, N) arrays          the next event, and the state there
    scale : (N,) array                  largest |X| so far
    order : (nc,) array                 orders of the zeros in the last mode
    impacts, short : (2, nc), (nc,)     last impact of each row, and its consecutive short flights
    numbers : (4,) array                the mode, the row that ends it (-1: none), events so far, and those at this instant
    wanted : (nc,) array                closed rows of the mode that is not in the table
    """

    start: Vector
    state: Matrix
    t: Vector
    X: Matrix
    scale: Vector
    order: Indices
    impacts: Matrix
    short: Indices
    numbers: Indices
    wanted: Flags


class Log(NamedTuple):
    """The segments begun (k): instant, states before and after, q, v, r on both sides, impulses, orders, modes and row."""

    start: Matrix
    before: Matrix
    state: Stack
    left: Matrix
    right: Matrix
    impulse: Matrix
    order: IndexMatrix
    switch: IndexMatrix


class LoopLimits(NamedTuple):
    """Limits of the loop: its last instant, the end of the run, the number of events, and of events at one instant."""

    until: float
    end: float
    events: int
    at_once: int


@compiled()
def unresolved(plant: Plant, present: Present, no_gap: Flags, no_rate: Flags, scale: Vector) -> bool:
    """Return whether a gap has too few digits to order the impacts of several contacts.

    That is one at the start of the last segment, or one that is rounding at its end, where it still opens.
    """
    if np.sum(plant.meets) < 2:
        return False
    u = reading(plant.C, plant.CA, present.state, scale, no_gap, no_rate, FINE_ZERO)[0]
    v, V = reading(plant.C, plant.CA, present.X, scale, no_gap, no_rate, FINE_ZERO)
    for i in range(len(plant.meets)):
        if plant.meets[i] and 0.0 < u[0, i] < GAP_RESOLUTION * size_of(plant.C[0, i], scale):
            return True
        if plant.meets[i] and not no_gap[i] and v[0, i] <= 0.0 and V[0, i] > 0.0:
            return True
    return False


@compiled()
def place_of(modes: Modes, closed: Flags) -> int:
    """Return the place of a mode in the table, or -1."""
    for k in range(len(modes.closed)):
        same = True
        for i in range(len(closed)):
            same &= modes.closed[k, i] == closed[i]
        if same:
            return k
    return -1


@compiled()
def find_end(plant: Plant, modes: Modes, present: Present, limits: LoopLimits) -> bool:
    """Find the end of the last segment, and return whether it is found: else there are many windows, or a breakpoint."""
    mode, t0 = present.numbers[0], present.start[0]
    δ, last = modes.δ[mode], limits.end * (1.0 + END_RTOL)
    stop = np.inf
    for each in plant.breakpoints:
        if each > t0:
            stop = each
            break
    horizon = min(stop, last) - t0
    windows = math.floor(min(horizon / δ, 1e18)) + 1
    A = SparseRows(modes.entries, modes.starts[mode], modes.columns)
    rows = SparseRows(modes.row_entries, modes.row_starts[mode], modes.row_columns)
    window = Window(Generator(A, 0, np.zeros((2, 1, 0))), δ, modes.step[mode])
    X, largest = present.state.copy(), present.scale.copy()
    count = min(windows, modes.scanned[mode])
    j, row, s, s_lo = scan(window, X, rows, modes.hull[mode], present.order, plant.basis, count, largest)
    t, t_lo = np.inf, 0.0
    if j >= 0:
        t, t_lo = add(s * δ, s_lo * δ, j * δ, 0.0)
        t, t_lo = add(t0, present.start[1], t, t_lo)
    if not (row >= 0 and t <= last and t < stop):
        if stop <= limits.end or (j < 0 and windows > count):
            return False
        t = np.inf
        t_lo = 0.0
        row = -1
    elif t > limits.end:
        t, t_lo = limits.end, 0.0
    present.t[0] = t
    present.t[1] = t_lo
    present.numbers[1] = row
    present.scale[:], present.X[:] = largest, X
    return True


@compiled()
def may_accumulate(plant: Plant, present: Present, P: Vector, passes_on: Flags) -> bool:
    """Return whether the impacts of a row with e < 1 may have accumulated, after the impulses P (nc,) of the next event."""
    t, t_lo = present.t[0], present.t[1]
    for i in range(len(P)):
        flight = (t - present.impacts[0, i]) + (t_lo - present.impacts[1, i])
        short = present.short[i] + 1 if flight < LAST_FLIGHT_RTOL * abs(t) else 0
        if P[i] > 0.0 and not passes_on[i] and short >= MIN_FLIGHTS and plant.e[i] < 1.0:
            return True
    return False


@compiled()
def enter(plant: Plant, modes: Modes, present: Present, log: Log, k: int) -> int:
    """Switch to the next mode at the event, and write entry k of the log; return `REACHED`, `GENERAL` or `NEW_MODE`."""
    mode = present.numbers[0]
    nc = len(plant.degree)
    N = present.X.shape[1]
    scale = present.scale.copy()
    no_gap = np.empty(nc, np.bool_)
    no_rate = np.empty(nc, np.bool_)
    finite = True
    for i in range(N):
        scale[i] = max(scale[i], abs(present.X[0, i]))
        finite &= math.isfinite(present.X[0, i])
    for i in range(nc):
        held = modes.closed[mode, i] or present.order[i] < 0
        no_gap[i] = held and plant.degree[i] > 0
        no_rate[i] = held and plant.degree[i] >= 2
    if not finite or unresolved(plant, present, no_gap, no_rate, scale):
        return Reason.GENERAL
    before, independent = settle(plant, present.X, scale, no_gap, no_rate)
    after, P, rests, determined = strike(plant, before, scale, no_gap, no_rate, FINE_ZERO)
    if not (independent and determined) or may_accumulate(plant, present, P, no_rate):
        return Reason.GENERAL
    for i in range(N):
        scale[i] = max(scale[i], size_of(plant.B[0, i], P))
    closed, order, determined = choose(plant, after, scale, no_gap, rests, FINE_ZERO)
    if not determined:
        return Reason.GENERAL
    place = place_of(modes, closed)
    if place < 0:
        present.wanted[:] = closed
        return Reason.NEW_MODE
    log.left[k] = on_rows(SparseRows(modes.read_entries, modes.read_starts[mode], modes.read_columns), before)
    log.right[k] = on_rows(SparseRows(modes.read_entries, modes.read_starts[place], modes.read_columns), after)
    log.switch[k, 0] = mode
    log.switch[k, 1] = place
    log.switch[k, 2] = present.numbers[1]
    t, t_lo = present.t[0], present.t[1]
    for i in range(nc):
        log.impulse[k, i] = P[i]
        log.order[k, i] = order[i]
        present.order[i] = order[i]
        if P[i] > 0.0 and not no_rate[i]:
            flight = (t - present.impacts[0, i]) + (t_lo - present.impacts[1, i])
            present.short[i] = present.short[i] + 1 if flight < LAST_FLIGHT_RTOL * abs(t) else 0
            present.impacts[0, i], present.impacts[1, i] = t, t_lo
    for part in range(2):
        log.start[k, part] = present.start[part] = present.t[part]
        for i in range(N):
            log.state[k, part, i] = present.state[part, i] = after[part, i]
    for i in range(N):
        log.before[k, i] = present.X[0, i]
        present.scale[i] = max(scale[i], size_of(plant.reach[i], scale))
    present.numbers[0] = place
    return Reason.REACHED


@compiled()
def follow_contacts(plant: Plant, modes: Modes, present: Present, log: Log, limits: LoopLimits) -> tuple[int, int]:
    """Follow the motion from event to event; return why the loop ends, and how many segments are in the log."""
    k, numbers = 0, present.numbers
    while present.t[0] <= limits.until:
        duration = (present.t[0] - present.start[0]) + (present.t[1] - present.start[1])
        at_once = numbers[3] + 1 if duration <= 0.0 else 1
        if numbers[1] < 0 or numbers[2] >= limits.events or at_once >= limits.at_once:
            return Reason.GENERAL, k
        if k == len(log.start):
            return Reason.FULL, k
        why = enter(plant, modes, present, log, k)
        if why != Reason.REACHED:
            return why, k
        numbers[2] = numbers[2] + 1
        numbers[3] = at_once
        k = k + 1
        if not find_end(plant, modes, present, limits):
            return Reason.NO_END, k
    return Reason.REACHED, k


@dataclass(eq=False)
class ContactTable:
    """The system and its modes so far, for the compiled loop.

    Attributes
    ----------
    plant : Plant
    modes : Modes
    places : dict               the place of each mode by its closed rows
    rows : list of arrays       the event rows (nc, N) of each
    named : dict                the modes with their orders
    """

    plant: Plant
    modes: Modes
    places: dict[tuple[int, ...], int] = field(default_factory=dict)
    rows: list[Array] = field(default_factory=list)
    named: dict[tuple[int, bytes], Mode] = field(default_factory=dict)

    @classmethod
    def of(cls, system: System, plant: Plant) -> ContactTable:
        """Return the table of a system, without modes or with those of its last run."""
        return remembered(system, "contacts", lambda: cls._empty(system, plant))

    @classmethod
    def _empty(cls, system: System, plant: Plant) -> ContactTable:
        """Return the table without modes."""
        N = len(plant.moves)
        nc = len(plant.e)
        m = 2 * len(system.dynamics.nodes) + len(plant.e)
        none = np.zeros(0, np.int64)
        step = np.zeros((0, 2, N, N))
        closed = np.zeros((0, nc), np.bool_)
        hull = np.zeros((0, nc, N, plant.basis.shape[1] + 1))
        rows = [(np.zeros((2, 0)), np.zeros((0, n + 1), np.int64), none) for n in (N, nc, m)]
        return cls(plant, Modes(closed, np.zeros(0), none, step, hull, *rows[0], *rows[1], *rows[2]))

    def place(self, system: System, closed: tuple[int, ...]) -> int:
        """Return the place of a mode, which is added if it is new."""
        with ADDING:
            if closed not in self.places:
                self._add(system, closed)
        return self.places[closed]

    def _add(self, system: System, closed: tuple[int, ...]) -> None:
        """Add a mode."""
        mode, old = Mode(closed, (), (), ()), self.modes
        flow, _ = system.reaction(mode)
        rows = system.ends(mode)[2]
        found = []
        generator, ends = sparse(flow.generator), sparse(rows)
        for k, each in enumerate((generator, ends, system.coordinates(mode).entries)):
            entries, starts, columns = old[5 + 3 * k : 8 + 3 * k]
            found += [
                np.concatenate([entries, each.entries], axis=1),
                np.concatenate([starts, each.starts[None] + entries.shape[1]]),
                np.concatenate([columns, each.columns]),
            ]
        shut = np.isin(np.arange(len(system.degree)), closed)[None]
        step = np.concatenate([old.step, flow.squares[0].parts[None]])
        hull = np.concatenate([old.hull, hulls(flow.A, flow.window, rows.hi, self.plant.basis[0])[None]])
        self.rows.append(rows.hi)  # before the compiled loop of another thread can name the mode
        scanned = np.append(old.scanned, WINDOWS if flow.stiff is None else 0)
        self.modes = Modes(
            np.concatenate([old.closed, shut]), np.append(old.δ, flow.window), scanned, step, hull, *found
        )
        self.places[closed] = len(self.places)

    def mode(self, place: int, order: Indices) -> Mode:
        """Return the mode at a place with the orders of its zeros."""
        key = place, order.tobytes()
        if key not in self.named:
            self.named[key] = contact_mode(self.modes.closed[place], order)
        return self.named[key]

    def new_log(self, *, events_per_call: int = 128) -> Log:
        """Return an empty log.

        ``events_per_call``: number of events in one call of compiled code; Ctrl-C acts between calls.
        """
        k = events_per_call
        nc = len(self.plant.e)
        N = len(self.plant.moves)
        m = self.modes.read_starts.shape[1] - 1
        return Log(
            np.empty((k, 2)), np.empty((k, N)), np.empty((k, 2, N)), np.empty((k, m)), np.empty((k, m)),
            np.empty((k, nc)), np.empty((k, nc), np.int64), np.empty((k, 3), np.int64),
        )  # fmt: skip
