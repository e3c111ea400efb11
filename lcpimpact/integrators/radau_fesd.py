r"""Radau IIA on finite elements whose ends are the switches: the lengths of the elements are unknowns of the collocation.

Within a step the contact mode may change any number of times. The step is cut into elements of lengths h_1 + h_2 + ... = h,
the mode is constant on each (so r and u of an element are complementary across all its stages, and not only stage by
stage), and where a mode ends the row c that ends it vanishes:

.. math:: X_i = X + h_n \sum_j a_{ij} A_m X_j, \qquad c \cdot X_s = 0, \qquad A_m = A + B F .

With the length free these are as many equations as unknowns, and Newton's method solves them; the stages are eliminated,
which leaves φ(h_n) = c·R(h_n A_m) X = 0. So no order is lost: 2 s - 1 in smooth motion and across switches.

Events are detected on the whole element, not at its stages. With k derivatives at each end (A_m^j X is known)
a row is a polynomial of degree 2 k - 1, whose error is

.. math:: |g - g_{2k-1}| \le \max |g^{(2k)}| \frac{(τ (h_n - τ))^k}{(2k)!} ,

and which lies in the hull of its Bernstein coefficients. An element is accepted where they exceed that error; where one
turns negative at the end, Newton's method locates the zero; if neither is certain, or the error estimate is above rtol, the
element is halved. A located switch is checked again with the final length.

Impacts of several bodies in quick succession are followed in double-doubles (see `lcpimpact.hybrid.burst`), and to
their limit where they accumulate. A row that falls to zero within 1e-12 of the run at its end makes a switch there. The
matrix of a step is one of floats, whose rounding is a small force on what is free to move: two bodies on a spring of
ω = 8/s are off by 2e-10 of their way after 1e4 s, and by 1e-8 after 1e5 s.

Nurkanović, Sperl, Albrecht and Diehl (2024) make one complementarity problem of a step, with its lengths and modes; here the
mode comes from the LCPs of `lcpimpact.hybrid.mode_choice`, and the impacts are those of `lcpimpact.hybrid.impacts`.
"""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.errors import InputError, Status
from lcpimpact.hybrid.burst import ImpactHistory, follow_burst, passed
from lcpimpact.hybrid.event_loop import Ending, EventLoop, follow, refuse_undetermined
from lcpimpact.hybrid.finite_elements import Elements, ElementSolution, ElementTable, K, first_crossing
from lcpimpact.hybrid.radau_iia import RadauIIA, radau_iia
from lcpimpact.hybrid.system import ZERO, Mode, System, refuse_mixed_degrees
from lcpimpact.hybrid.transition import coordinates, enter
from lcpimpact.integrators.base import Declared, Integrator, Limits
from lcpimpact.numbers import count, is_real
from lcpimpact.numerics.double_double import DoubleDouble
from lcpimpact.numerics.rounding import EPS
from lcpimpact.problems.base import Problem
from lcpimpact.record import ContinuousSolution, Event, Grid, Record, Stats
from lcpimpact.scheme.impact_laws import IMPACT_LAWS
from lcpimpact.scheme.structure import Feature

DEFECT_RTOL = 1e-9
"""Largest defect of the equations of an accepted element, judged outside the solve, relative to their terms."""

END_RTOL, LOOK_BACK = 1e-12, 0.1
"""Distance of a switch from the end of the run, relative to the run, below which it is at the end, if its row falls over
the part LOOK_BACK of the last element."""

MAX_STRIDE = 256
"""Maximum number of whole steps in a batch."""


@dataclass(frozen=True)
class RadauFESD(Integrator):
    """Radau IIA on finite elements with switch detection.

    Parameters
    ----------
    stages : int
        s, from 1 to 5; the order is 2 s - 1, in smooth motion and across switches.
    rtol : float, optional
        Halve elements until the error estimate of each state is below rtol times its largest value so far; None for
        elements as long as the step and the switches allow.
    max_newton : int
        Maximum number of Newton iterations for one switch.
    max_events : int
        Maximum number of switches.

    Raises
    ------
    InputError
        If stages is not 1 to 5, rtol lies outside [1e-14, 1), or a limit is not a whole number above zero.

    Notes
    -----
    Handles constant loads and signals, whose breakpoints end an element. The declared orders are those of three stages. The
    reaction is the force at each instant of the grid (its right limit at a switch); impulses are in the events.
    """

    stages: int = 3
    rtol: float | None = None
    max_newton: int = 20
    max_events: int = 100_000

    name: ClassVar[str] = "radau-fesd"
    narrowest: ClassVar[float] = ZERO
    family: ClassVar[str] = "Radau IIA"
    mode_choice: ClassVar[str] = "mode_choice.py"
    declared: ClassVar[Declared] = Declared(
        summary="Radau IIA on finite elements that end at the switches",
        order_smooth=5,
        order_loss=5,
        loss_constant=1 / 3600,
        order_force_jump=5,
        order_force_kink=5,
        order_impact=5,
        order_friction=5,
        order_relay=5,
        order_penetration=float("inf"),
        level="position and velocity",
        relative_degrees=(0, 1, 2),
        handles=tuple(
            each
            for each in Feature
            if each not in (Feature.POWER_LAWS, Feature.DASHPOTS, Feature.FORCES, Feature.HOLDS)
            and each not in (Feature.FRICTION, Feature.STATIC_FRICTION, Feature.JOINTS, Feature.LAGRANGIAN)
        ),
        impact_laws=tuple(IMPACT_LAWS),
        reaction_time="at t, right limit",
        energy="never gains in smooth motion and impacts; loses at order 2 s - 1",
        balances_energy=True,
        precision=1e-7,
        slack=24.0,
        dissipates=True,
        accuracy=1e-9,
        source="NurkanovicSperlAlbrechtDiehl2024; HairerWanner1996, section IV.5",
        adaptive="with rtol, halves the elements of a step by their error estimate",
    )

    def __post_init__(self) -> None:
        radau_iia(self.stages)
        if self.rtol is not None and not (is_real(self.rtol) and 1e-14 <= self.rtol < 1.0):
            raise InputError(
                f"rtol = {self.rtol!r} must lie in [1e-14, 1), or be None for elements of the step's length"
            )
        for option in ("max_newton", "max_events"):
            count(option, getattr(self, option))

    def own_loss(self) -> tuple[float, float]:
        """Return p and c of the energy loss, for its number of stages."""
        s = self.stages
        return 2.0 * s - 1.0, (math.factorial(s - 1) / math.factorial(2 * s - 1)) ** 2

    def limits(self) -> Limits:
        """Return the tolerances of the certificate, for its number of stages."""
        return replace(super().limits(), order=2.0 * self.stages - 1.0)

    def start(self, problem: Problem, grid: Grid, lcp_solver: str, record: Record) -> ElementChain:
        """Choose the first mode and write the initial values; impacts at t = 0 come before them."""
        system = System(problem.dynamics, grid.t_end)
        refuse_mixed_degrees(system, self.name, except_contacts=True)
        X = system.state(problem.initial_coordinates, problem.initial_velocities)
        breakpoints = system.form.breakpoints(0.0, grid.t_end)
        record.events = []
        chain = ElementChain(
            system, grid.t_end, lcp_solver, self.max_events, breakpoints, np.abs(X),
            method=self, radau=radau_iia(self.stages), grid=grid, events=record.events, stats=record.stats,
            impact_history=ImpactHistory.none(len(system.degree)),
        )  # fmt: skip
        with refuse_undetermined(problem, self.name):
            chain.begin_mode(0.0, X, v=problem.initial_velocities)
        chain.write(record, 0, chain.X[None, :])
        return chain

    def advance(self, carry: ElementChain, record: Record, first: int, last: int) -> tuple[Status, int]:
        """Take steps without a switch in batches, and the others element by element."""
        k = first
        while k < last:
            ahead = carry.breakpoints[carry.passed : carry.passed + 1]
            # The last step is taken alone, since an event may fall on its end.
            clear = min([last - k, carry.grid.steps - 1 - k, *(np.searchsorted(record.t[k : last + 1], ahead) - 1)])
            clear = clear if carry.t <= record.t[k] else 0
            taken = carry.whole_steps(record, k, min(carry.stride, clear)) if clear else 0
            k += taken
            if taken == carry.stride:
                carry.stride = min(2 * carry.stride, MAX_STRIDE)
            elif k < last:
                before, carry.stride = len(carry.events), 1
                carry.step, carry.offset = float(record.t[k]), 0.0
                end = float(record.t[k + 1])
                status = follow(carry, end)
                if status is not Status.SOLVED:
                    del carry.events[before:]
                    return status, k
                elements, X = carry.at(end)
                carry.write(record, k + 1, X[None, :], elements)
                k += 1
        return Status.SOLVED, last

    def dense(self, carry: ElementChain) -> ContinuousSolution:
        """Return the continuous solution, by elements that end at the requested times."""
        kinds = list(carry.modes.values())
        starts = np.concatenate([*carry.starts, [carry.t]])
        states = np.concatenate([*carry.states, carry.X[None, :]])
        kind = np.repeat([kinds.index(each) for each in carry.owners], [len(each) for each in carry.starts])
        kind = np.append(kind, kinds.index(carry.elements)).astype(np.int64)
        return ContinuousSolution(
            ElementSolution(carry.system, tuple(kinds), starts, states, kind, 8.0 * EPS * carry.end), starts
        )


@dataclass(eq=False, kw_only=True)
class ElementChain(EventLoop[System]):
    """The elements so far, the state at the end of the last one, and the mode in which the motion goes on.

    ``zeros`` are the orders of the zeros with which the event functions of a new mode begin; ``passed`` counts the
    ``breakpoints`` of the signals so far. The current grid step begins at ``step``, and elements fill it up to ``offset``
    after that. ``entered`` is the start of the mode.
    """

    method: RadauFESD
    radau: RadauIIA
    grid: Grid
    events: list[Event]
    stats: Stats
    impact_history: ImpactHistory
    passed: int = 0
    t: float = 0.0
    step: float = 0.0
    offset: float = 0.0
    entered: float = 0.0
    stride: int = 1
    X: Array = field(init=False)
    elements: Elements = field(init=False)
    zeros: Indices = field(init=False)
    modes: dict[Hashable, Elements] = field(default_factory=dict)
    starts: list[Array] = field(default_factory=list)
    states: list[Array] = field(default_factory=list)
    owners: list[Elements] = field(default_factory=list)

    instant_rtol: ClassVar[float] = 2.0 * EPS

    def integrate(self, until: float) -> Ending | Status:
        """Fill a step of the grid with elements, up to the first that a switch or a breakpoint ends."""
        if self.entered == until == self.end:
            return Status.SOLVED
        t, h = self.step, self.grid.h
        waiting = self.pieces(t, max(self.offset, self.t - t), h)
        while waiting and self.t < t + h:
            begin, end, breaks = waiting.pop()
            status = Status.SOLVED
            length = 0.0
            switches = False
            if end > begin:
                # A piece after a breakpoint begins exactly there, as its events do.
                last = self.breakpoints[self.passed - 1] if self.passed else -np.inf
                start = last if abs(t + begin - last) <= 4.0 * EPS * (t + h) else self.t
                status, length, switches = self._element(start, end - begin)
            if status is not Status.SOLVED:
                return status
            if switches:
                self.offset = begin + length
                return Ending(self.t, length, self.X, 0)
            if length == end - begin:
                self.offset = end
                if breaks:
                    return Ending(float(self.breakpoints[self.passed]), length, self.X, breakpoint=True)
            elif end - begin <= 4.0 * EPS * (t + h):
                return Status.SWITCH
            else:
                middle = begin + 0.5 * (end - begin)
                waiting += [(middle, end, breaks), (begin, middle, False)]
                self.stats.rejected += 1
        if self.t - until <= 4.0 * EPS * until:
            self.t = until
            if until == self.end and self._ends():
                return Ending(until, until - self.entered, self.X, 0)
        return Status.SOLVED

    def enter(self, ending: Ending) -> Status:
        """Enter the next mode."""
        self.passed += ending.breakpoint
        return self.begin_mode(ending.t, ending.X, ending.breakpoint)

    def begin_mode(self, t: float, X: Array, breakpoint: bool = False, v: Array | None = None) -> Status:
        """Enter the next mode at t, with the impacts before it and a burst of impacts after it.

        v (n,) are the velocities before the start of the run.
        """
        before = self.elements.mode if self.modes else None
        found = enter(self.system, t, before, X, self.scale, self.solver, breakpoint=breakpoint, v=v)
        mode = found.mode
        after = found.state
        status = Status.SOLVED
        self.events += found.events
        short = self._land(t, found.events)
        if short and t < self.end:
            status, mode, after = self._burst(t, mode, after, short)
        self.X, self.elements, self.entered = after.hi, self._elements(mode), t
        self.zeros = np.minimum(self.system.watch(mode).order, K)
        self.scale = np.maximum(self.scale, np.abs(self.X))
        self.stride = 1
        return status

    def _burst(self, t: float, mode: Mode, X: DoubleDouble, short: float) -> tuple[Status, Mode, DoubleDouble]:
        """Follow a burst of impacts from X: the mode after it, and its state."""
        status, burst = follow_burst(self, self.system, t, X, mode, self.scale, short)
        for segment, _ in passed(burst):
            self.starts.append(np.array([segment.t0]))
            self.states.append(segment.X[None, :])
            self.owners.append(self._elements(segment.mode))
        self.events += burst.events
        self.switches += burst.switches
        self.impact_history.take(burst)
        self.scale = np.maximum(self.scale, burst.scale)
        last = burst.segments[-1]
        self.t = last.t0
        return status, last.mode, last.state

    def _land(self, t: float, events: tuple[Event, ...]) -> float:
        """Record the impacts at t; return the duration of a short flight if they may begin a burst, else 0."""
        hits = [event for event in events if event.impulse > 0.0]
        if not hits:
            return 0.0
        left = hits[0].left
        rates = self.system.dynamics.gap_rate(t, left.q, left.v)
        rows = np.array([self.system.names[event.contact] for event in hits], dtype=np.int64)
        rows = rows[rates[rows] < 0.0]
        short = self.impact_history.quick(self.system, t, rows, rates, self.scale)
        self.impact_history.note(t, rows)
        return short

    def _elements(self, mode: Mode) -> Elements:
        """Return the elements of a mode."""
        system = self.system
        ends = system.watch(mode).rows
        key = (mode.key, tuple(order < 0 for order in mode.order))
        if key not in self.modes:
            flow, F = system.mode(mode)
            contacts = [i for i in mode.closed if not system.dynamics.of_rate[i]]
            C, D = system.derivatives[0], system.form.D
            u = (C + D @ F)[contacts]
            A, B, _ = map(np.abs, system.matrices)
            # A gap that stays zero has the rounding of the rates that cancel in it.
            way = self.grid.h * np.abs(C) @ (A + B @ np.abs(F))
            terms = (np.abs(C) + way + np.abs(D) @ np.abs(F))[contacts]
            self.modes[key] = Elements(
                mode, self.radau, flow.A, ends.hi, u, terms, self.grid.h,
                estimated=self.method.rtol is not None, constant=system.form.constant,
            )  # fmt: skip
        return self.modes[key]

    def at(self, t: float) -> tuple[Elements, Array]:
        """Return the state at an instant up to the present, and its elements."""
        if t >= self.t:
            return self.elements, self.X
        for starts, states, elements in zip(
            reversed(self.starts), reversed(self.states), reversed(self.owners), strict=True
        ):
            if starts[0] <= t:
                j = int(np.searchsorted(starts, t, side="right")) - 1
                return elements, elements.at(states[j : j + 1], np.array([t - starts[j]]), EPS * self.end)[0]
        raise ValueError(f"t = {t} lies before the run")

    def pieces(self, t: float, begin: float, h: float) -> list[tuple[float, float, bool]]:
        """Return the remaining pieces of a step, the first one last: start, end, and whether that is a breakpoint."""
        later = self.breakpoints[self.passed :]
        offsets = later[later <= t + h * (1.0 + 4.0 * EPS) + 4.0 * EPS * t] - t
        # A breakpoint on the grid makes no piece of its own.
        offsets = np.where(h - offsets <= 4.0 * EPS * (t + h), h, np.maximum(offsets, begin))
        edges = [begin, *offsets.tolist(), h]
        breaks = [True] * len(offsets) + [False]
        return list(zip(edges[:-1], edges[1:], breaks, strict=True))[::-1]

    def whole_steps(self, record: Record, k: int, count: int) -> int:
        """Take up to ``count`` steps of one element each, while all tests pass; return their number."""
        elements, h = self.elements, self.grid.h
        table = elements.table(h)
        states = table.states(self.X, count)
        if not np.isfinite(states).all():
            return 0
        none = np.zeros_like(self.zeros)
        good = np.array(elements.safe(table, states[:-1], self.scale, none, none)[0].all(axis=1))
        if self.zeros.any():
            good[0] = elements.safe(table, states[:1], self.scale, self.zeros, none)[0].all()
        good &= self._accurate(table, states[:-1])
        taken = count if good.all() else int(np.argmin(good))
        if taken == 0:
            return 0
        states = states[: taken + 1]
        stages = np.einsum("inm,tm->tin", table.stages, states[:-1])
        residual = elements.judge(stages, states[:-1], h, np.maximum(self.scale, np.abs(states).max(axis=0)))
        if not residual <= DEFECT_RTOL:
            return 0
        self.write(record, k + 1, states[1:])
        self._append(record.t[k : k + taken], states, float(record.t[k + taken]), residual)
        return taken

    def _element(self, t: float, length: float) -> tuple[Status, float, bool]:
        """Take one element: the status, its length, and whether a switch ends it.

        The length is zero without a switch if the element must be shorter, and with one if the mode has ended already.
        """
        elements, none = self.elements, np.zeros_like(self.zeros)
        table = elements.table(length)
        X = self.X[None, :]
        if not np.isfinite(table.end @ self.X).all():
            return Status.NON_FINITE, 0.0, False
        if not self._accurate(table, X)[0]:
            return Status.SOLVED, 0.0, False
        safe, reduced, b = elements.safe(table, X, self.scale, self.zeros, none)
        if safe.all():
            return self._accept(t, length, table), length, False
        crossing = first_crossing(b[0], reduced[0], safe[0], self.zeros, elements.noise(self.scale))
        if crossing is None:
            return Status.SOLVED, 0.0, False
        row, guess = crossing
        if guess == 0.0:
            return Status.SOLVED, 0.0, True
        starts_at = float(elements.rows[row] @ self.X) if self.zeros[row] > 0 else 0.0
        root, count = elements.root(self.X, row, starts_at, guess * length, length, self.scale, self.method.max_newton)
        self.stats.newton_iterations += count
        self.stats.evaluations += count
        if root is None:
            return Status.SWITCH, 0.0, False
        table, ends = elements.table(root), none.copy()
        ends[row] = 1
        if not elements.safe(table, X, self.scale, self.zeros, ends)[0].all():
            return Status.SOLVED, 0.0, False
        return self._accept(t, root, table), root, True

    def _accurate(self, table: ElementTable, X: Array) -> Flags:
        """Return whether the error estimate of elements from X (nt, N) is below rtol (nt,)."""
        if table.estimate is None or self.method.rtol is None:
            return np.ones(len(X), dtype=np.bool_)
        largest = np.maximum(np.maximum(self.scale, np.abs(X)), np.abs(X @ table.end.T))
        return np.asarray((np.abs(X @ table.estimate.T) <= self.method.rtol * largest).all(axis=1))

    def _accept(self, t: float, length: float, table: ElementTable) -> Status:
        """Append an element to the run, if its equations hold."""
        stages = table.stages @ self.X
        scale = np.maximum(self.scale, np.abs(stages[-1]))
        residual = self.elements.judge(stages[None], self.X[None, :], length, scale)
        if not residual <= DEFECT_RTOL:
            return Status.SWITCH
        self._append(np.array([t]), np.array([self.X, stages[-1]]), t + length, residual)
        return Status.SOLVED

    def _append(self, starts: Array, states: Array, end: float, residual: float) -> None:
        """Append the elements that start at ``starts`` from all but the last of the ``states``."""
        self.starts.append(starts)
        self.states.append(states[:-1])
        self.owners.append(self.elements)
        self.t = end
        self.X = states[-1]
        self.zeros = np.zeros_like(self.zeros)
        self.scale = np.maximum(self.scale, np.abs(states).max(axis=0))
        self.stats.steps += len(starts)
        self.stats.evaluations += len(starts)
        self.stats.residual = max(self.stats.residual, residual)

    def write(self, record: Record, first: int, states: Array, elements: Elements | None = None) -> None:
        """Write states of this mode, or of the mode of other elements, to the grid from ``first``."""
        here = slice(first, first + len(states))
        mode = (elements or self.elements).mode
        record.q[here], record.v[here], record.reaction[here] = coordinates(self.system, mode, states)

    def _ends(self) -> bool:
        """Return whether a row falls to zero at the end of the run."""
        elements = self.elements
        length = self.t - float(self.starts[-1][-1])
        if elements is not self.owners[-1] or not length > 0.0:
            return False
        part = LOOK_BACK * length
        before = elements.rows @ elements.at(self.states[-1][-1:], np.array([length - part]), EPS * self.end)[0]
        last = elements.rows @ self.X
        falls = (before > elements.noise(self.scale)) & (last * part <= (before - last) * END_RTOL * self.end)
        return bool(falls.any())
