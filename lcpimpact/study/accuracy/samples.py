r"""A run known by samples alone, as any program writes them: t, coordinates, and if there are any rates and reactions.

The facts of problems read runs by `lcpimpact.reading`, and so they read this one. Its events are found in the samples:

*Impacts* of a contact between masses are where its rate U grows, in one interval or in several in a row, by more than the
forces would let it, with the contact closed by then. The instant is the root of the parabola on which the gap falls from the
last sample before; the limits are those parabolas from both sides, and the impulses follow from the momentum,
:math:`M (v^+ - v^-) = H^T P`, by least squares.

*Closings and openings* are where the reaction of a massless plate begins and ends, and where the gap of a contact at rest
begins to open. *Stick and slip* are told by the rates of sliders and friction, *sliding and switching* of relays by y. All
are of the order of the samples' distance or better; what happens twice between two samples is not told. No events are
told where a column is missing that they follow from, or after a hole in the samples.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array, Flags
from lcpimpact.certificate.laws import moving_accelerations
from lcpimpact.errors import InputError
from lcpimpact.events import zero
from lcpimpact.problems.base import Problem
from lcpimpact.record import ContinuousSolution, Event, State
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.lagrangian import LagrangianDynamics, images


@dataclass(frozen=True, eq=False)
class SampledRun:
    """Samples of a run of a problem, which `lcpimpact.reading` reads.

    Attributes
    ----------
    problem : Problem
    t : (nt,) array                 instants in s, from 0 on
    q, v : (nt, n) arrays           coordinates and rates; nan where the samples have none
    t_reaction : (nr,) array        instants of the reactions in s
    reaction : (nr, nc) array       reactions in N; nan where the samples have none
    events : sequence of Event      changes of the contact mode in the order of time; see `events_in`
    """

    problem: Problem
    t: Array
    q: Array
    v: Array
    t_reaction: Array
    reaction: Array
    events: Sequence[Event] = ()

    @property
    def dense(self) -> ContinuousSolution | None:
        """None: nothing is known between the samples."""
        return None

    @property
    def names(self) -> Sequence[str]:
        """Names of the series: coordinates, velocities (v_NAME), and forces of rows and springs."""
        d = self.problem.dynamics
        return (*d.nodes, *(f"v_{node}" for node in d.nodes), *(each.name for each in d.forces))

    @property
    def forces(self) -> Array:
        """Reactions and forces of non-linear springs in N (nr, nc + ns)."""
        state = self.sample(self.t_reaction)
        return np.hstack([self.reaction, self.problem.dynamics.push(state.q, state.v)])

    def __getitem__(self, name: str) -> Array:
        columns = [*self.q.T, *self.v.T, *self.forces.T]
        return np.asarray(columns[self.names.index(name)])

    def sample(self, t: ArrayLike, side: str = "right") -> State:
        """Return q, v and the reactions at the times t by lines between the samples.

        Raises
        ------
        InputError
            For times beyond the last sample.
        """
        times = np.atleast_1d(np.asarray(t, dtype=np.float64))
        if not ((times >= self.t[0]) & (times <= self.t[-1])).all():
            raise InputError(f"the samples end at {self.t[-1]:g} s: run longer")
        q, v = (_between_samples(times, self.t, each) for each in (self.q, self.v))
        return State(q, v, _between_samples(times, self.t_reaction, self.reaction))

    @property
    def untold(self) -> list[str]:
        """The columns that the samples do not have."""
        nodes, d = len(self.problem.dynamics.nodes), self.problem.dynamics
        columns = [*self.q.T, *self.v.T, *self.reaction.T]
        rows = [each.name for each in d.contacts]
        names = [*self.names[: 2 * nodes], *rows]
        return [name for name, column in zip(names, columns, strict=True) if np.isnan(column).all()]


class KnownUntil(Sequence[Event]):
    """The first events of a run of which the later ones are unknown: whoever reads on is told why.

    Parameters
    ----------
    known : sequence of Event
    why : str                       message of the InputError for what lies behind the known ones, as their number
    """

    def __init__(self, known: Sequence[Event], why: str) -> None:
        self.known = known
        self.why = why

    def __iter__(self) -> Iterator[Event]:
        yield from self.known
        raise InputError(self.why)

    def __len__(self) -> int:
        raise InputError(self.why)

    @overload
    def __getitem__(self, place: int) -> Event: ...
    @overload
    def __getitem__(self, place: slice) -> Sequence[Event]: ...
    def __getitem__(self, place: int | slice) -> Event | Sequence[Event]:
        if isinstance(place, slice) or not 0 <= place < len(self.known):
            raise InputError(self.why)
        return self.known[place]


def events_in(run: SampledRun) -> Sequence[Event]:
    """Return the events that the samples of a run show, in the order of time.

    They are known up to a hole in the samples, and none of them where a column that they follow from is missing.
    """
    d = run.problem.dynamics
    pushes = [each.name for each in d.contacts if each.impenetrable and each.relative_degree != 2]
    absent = [name for name in run.untold if name in (*d.nodes, *pushes)]
    if absent and d.contacts:
        columns = f"column{'s' * (len(absent) > 1)} {', '.join(absent)}"
        return KnownUntil(
            (), f"the results have no {columns}, without which no events are found: write them, or give an events file"
        )
    search = _Events(run)
    found = sorted(search.found(), key=lambda each: each.t)
    hole = search.hole()
    if hole is None:
        return tuple(found)
    start, end = run.t[hole : hole + 2]
    why = f"no samples from {start:g} to {end:g} s, where events may lie: write samples there, or give an events file"
    return KnownUntil([each for each in found if each.t < start], why)


class _Events:
    """The search for events in samples."""

    def __init__(self, run: SampledRun) -> None:
        self.run = run
        self.d = d = run.problem.dynamics
        self.t = run.t
        self.h = np.diff(run.t)
        self.u = d.gap(run.t, run.q)
        self.U = d.gap_rate(run.t, run.q, run.v)
        self.r = _between_samples(run.t, run.t_reaction, run.reaction)
        self.free = self._free()

    def found(self) -> Iterator[Event]:
        """Yield the events, row by row."""
        if len(self.t) < 3:
            return
        for i, row in enumerate(self.d.contacts):
            if row.impenetrable and row.relative_degree == 2:
                yield from self.impacts(i)
                yield from self.openings(i)
            elif row.impenetrable:
                yield from self.changes(i)
            elif row.law.of_rate:
                yield from self.turns(i, self.U[:, i])
            elif row.switches and not self.d.D[i].any():
                yield from self.turns(i, -self.u[:, i])

    def hole(self, *, longest: float = 10.0) -> int | None:
        """Return the sample before the first step in which events may be hidden, None if there is none.

        That is a step that is longer than ``longest`` medians, unless each contact between masses is so far open that its
        gap cannot close and open again in it at the greatest rate of the run. Other rows may change in any.
        """
        bounces = [row.impenetrable and row.relative_degree == 2 for row in self.d.contacts]
        fastest = np.abs(self.U).max(axis=0, initial=0.0)
        near = ~np.array(bounces, dtype=bool) | (self.u[:-1] + self.u[1:] <= self.h[:, None] * fastest)
        holes = np.flatnonzero((self.h > longest * np.median(self.h)) & near.any(axis=1))
        return int(holes[0]) if len(holes) else None

    def _free(self) -> Array:
        """Return |H a| for the accelerations a that the forces alone give the masses, at the samples (nt, nc)."""
        d, run = self.d, self.run
        if not d.stores_energy or np.isnan(run.q).any():
            return np.zeros(self.U.shape)
        if isinstance(d, LagrangianDynamics):
            a = moving_accelerations(d, run.t, run.q, run.v, np.zeros_like(self.U))
            return np.abs(images(d.rows(run.t, run.q, run.v).H, a))
        f = d.applied(run.t, run.q, run.v) + d.spring_force(run.q, run.v) - run.v @ d.C.T - run.q @ d.K.T
        moving = np.where(d.driven, 0.0, 1.0)
        a = f * moving @ np.linalg.pinv(moving[:, None] * d.M * moving)
        if d.driven.any():
            a[:, d.driven] = np.gradient(run.v[:, d.driven], run.t, axis=0)
        return np.abs(a @ d.H.T)

    def struck(self, i: int) -> list[tuple[int, int]]:
        """Return the samples before and after each impact of a contact.

        Its rate grows there by more than twice what the forces make it, and within that time the gap can be passed.
        """
        u, U = self.u[:, i], self.U[:, i]
        h = self.h
        fastest = np.nanmax(np.abs(U), initial=0.0)
        free = self.free[:, i]
        grows = np.diff(U) > 2.0 * h * np.maximum(free[:-1], free[1:]) + 1e-9 * fastest
        runs = _stretches(grows)
        return [
            (first, last)
            for first, last in runs
            if U[first] < 0.0
            and np.min(u[first : last + 1]) <= 1.5 * h[first:last].sum() * max(-U[first], abs(U[last])) + 1e-12
        ]

    def impacts(self, i: int) -> Iterator[Event]:
        """Yield the impacts of a contact and of the friction that it bounds."""
        rows = [i, *np.flatnonzero(self.d.normals == i).tolist()]
        edges = self.struck(i)
        for k, (first, last) in enumerate(edges):
            before = edges[k - 1][1] if k else 0
            after = edges[k + 1][0] if k + 1 < len(edges) else len(self.t) - 1
            a_left = self.slope(first - 1, first) if first > before else self.slope(last, last + 1)
            a_right = self.slope(last, last + 1) if after > last else a_left
            here = self.d.at(float(self.t[first]), self.run.q[first], self.run.v[first])
            s = _root(self.u[first, i], self.U[first, i], float(here.H[i] @ a_left), self.t[last] - self.t[first])
            t = self.t[first] + s
            left, right = self.moved(first, a_left, s), self.moved(last, a_right, t - self.t[last])
            P = self.impulses(here, rows, right.v - left.v)
            for row, impulse in zip(rows, P, strict=True):
                yield Event(float(t), self.d.contacts[row].name, "impact", left, right, float(impulse), "newton")

    def impulses(self, d: Dynamics, rows: list[int], jump: Array) -> Array:
        """Return the impulses of some rows with M (v⁺ - v⁻) = Hᵀ P, by least squares."""
        acts = ~d.driven
        H = d.H[rows][:, acts]
        if np.isnan(jump).any():
            return np.full(len(rows), np.nan)
        return np.asarray(np.linalg.lstsq(H.T, (d.M @ jump)[acts], rcond=None)[0])

    def slope(self, j: int, k: int) -> Array:
        """Return the change of the rates over an interval by its length, zero beyond the samples (n,)."""
        if not 0 <= j < k < len(self.t):
            return np.zeros(self.run.v.shape[1])
        return np.asarray((self.run.v[k] - self.run.v[j]) / (self.t[k] - self.t[j]))

    def moved(self, j: int, a: Array, s: float) -> State:
        """Return the state at the time s after a sample, or before it, with the accelerations a."""
        v = self.run.v[j]
        return State(self.run.q[j] + v * s + 0.5 * a * s**2, v + a * s, self.r[j])

    def state(self, j: int) -> State:
        """Return the state at a sample."""
        j = min(max(j, 0), len(self.t) - 1)
        return State(self.run.q[j], self.run.v[j], self.r[j])

    def openings(self, i: int) -> Iterator[Event]:
        """Yield where a contact between masses that rests begins to open."""
        U, u = np.abs(self.U[:, i]), self.u[:, i]
        fastest = np.nanmax(U, initial=0.0)
        rests = (1e-9 * fastest >= U) & (u <= fastest * np.append(self.h, self.h[-1]))
        rests[:-1] &= rests[1:] | np.append(False, rests[:-2])
        for j in np.flatnonzero(rests[:-1] & ~rests[1:]).tolist():
            t = 0.5 * (self.t[j] + self.t[j + 1])
            yield Event(float(t), self.d.contacts[i].name, "open", self.state(j), self.state(j + 1))

    def changes(self, i: int) -> Iterator[Event]:
        """Yield where the force of a contact with a massless side begins and ends."""
        t, r = self.run.t_reaction, self.run.reaction[:, i]
        if np.isnan(r).all():
            return
        closed = r > 1e-12 * np.nanmax(np.abs(r))
        start = self.u[0, i] <= 0.0
        closed[0] |= bool(start and closed[1])
        if not start and closed[0]:
            yield Event(0.0, self.d.contacts[i].name, "close", self.state(0), self.state(1))
        for j in (1 + np.flatnonzero(closed[1:] != closed[:-1])).tolist():
            k = int(np.searchsorted(self.t, t[j - 1], side="right")) - 1
            if closed[j]:
                gaps = np.zeros(0) if self.d.D[i].any() else self.u[max(k - 1, 0) : k + 1, i]
                last = self.t[min(int(np.searchsorted(self.t, t[j])), len(self.t) - 1)]
                instant, kind = zero(self.t[max(k - 1, 0) : k + 1], gaps, self.t[k], last), "close"
            else:
                instant, kind = zero(t[max(j - 2, 0) : j], r[max(j - 2, 0) : j], t[j - 1], t[j]), "open"
            yield Event(float(instant), self.d.contacts[i].name, kind, self.state(k), self.state(k + 1))

    def turns(self, i: int, z: Array, *, rest_rtol: float = 1e-6) -> Iterator[Event]:
        """Yield where a rate, or y of a relay, comes to zero and stays, leaves it, or changes its sign.

        ``rest_rtol``: size relative to the largest in the run, below which it is zero.
        """
        row, t = self.d.contacts[i], self.t
        if np.isnan(z).any():
            return
        still = np.abs(z) <= rest_rtol * np.abs(z).max(initial=0.0)
        # A single sample at zero passes it; at the start nothing has happened yet.
        stays = still & (np.append(still[1:], still[-1]) | np.append(False, still[:-1]))
        side = np.where(stays, 0.0, np.where(still, np.nan, np.sign(z)))
        side[0] = side[1]
        for j in np.flatnonzero(np.isnan(side)).tolist():
            side[j] = side[j - 1] if j else side[1]
        for j in np.flatnonzero(side[1:] != side[:-1]).tolist():
            if side[j + 1] == 0.0:
                before = slice(max(j - 1, 0), j + 1)
                instant, kind = zero(t[before], np.abs(z[before]), t[j], t[j + 1]), row.law.between
            elif side[j] == 0.0:
                after = slice(j + 1, j + 3)
                back = -zero(-t[after][::-1], np.abs(z[after])[::-1], -t[j + 1], -t[j])
                instant, kind = back, row.law.at_bound
            else:
                weight = abs(z[j]) / (abs(z[j]) + abs(z[j + 1]))
                instant, kind = t[j] + weight * (t[j + 1] - t[j]), row.law.at_bound
            yield Event(float(instant), row.name, kind, self.state(j), self.state(j + 1))


def _stretches(flags: Flags) -> list[tuple[int, int]]:
    """Return the first and last sample of each row of intervals with a flag (nt - 1,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _root(u: float, U: float, a: float, h: float) -> float:
    """Return the first s in [0, h] with u + U s + a s²/2 = 0, or an end."""
    roots = np.roots([0.5 * a, U, u]) if a != 0.0 else np.array([-u / U])
    within = [float(s.real) for s in roots if abs(s.imag) == 0.0 and -1e-9 * h <= s.real <= h * (1.0 + 1e-9)]
    return min(max(min(within, default=-u / U), 0.0), h)


def _between_samples(times: Array, t: Array, values: Array) -> Array:
    """Return values (nt, m) at some times by lines, and beyond them the first or the last."""
    columns = [np.interp(times, t, column) for column in values.T]
    return np.array(columns).T.reshape(len(times), values.shape[1])
