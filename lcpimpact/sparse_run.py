"""Runs of sparse schemes: the series of chosen nodes and reactions, and the laws, judged in the steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, cast

import numpy as np

from lcpimpact.arrays import Array, Flags
from lcpimpact.certificate import Certificate
from lcpimpact.certificate.damping import StrongDashpots
from lcpimpact.certificate.drives import MOMENTUM_FRACTION, missed_integral
from lcpimpact.certificate.scales import largest_violation
from lcpimpact.errors import InputError, Status, UnsupportedError
from lcpimpact.events import events_of_steps
from lcpimpact.integrators.moreau_jean import MoreauJean
from lcpimpact.integrators.stepping.law import with_fallbacks
from lcpimpact.integrators.stepping.sparse_kernel import BlockOfSteps, ChosenSeries, Given
from lcpimpact.integrators.stepping.sparse_symbols import input_sizes
from lcpimpact.integrators.stepping.sparse_table import begin, laws_of, tabulate_sparse
from lcpimpact.lcp.solver import SolverState
from lcpimpact.lcp.solvers.block_pivoting import block_pivoting
from lcpimpact.memory import check_memory
from lcpimpact.problems.base import Problem
from lcpimpact.quantities import SUMMARY, Summary
from lcpimpact.record import Grid, Record, State, Stats
from lcpimpact.registry import nearest
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.scheme.signals import breaks, check_harmonics
from lcpimpact.scheme.sparse_dynamics import SparseDynamics
from lcpimpact.scheme.structure import Contact
from lcpimpact.scheme.terms import PowerLaw
from lcpimpact.trajectory import Trajectory, labelled

LAWS = ("momentum", "kinematics", "impact_law", "complementarity", "equilibrium", "motion")
"""The laws that sparse steps judge, in the order of `lcpimpact.integrators.stepping.sparse_kernel`."""

MOST_INPUTS = 1 << 20
"""Numbers of loads and motions that are kept for steps to come."""


@dataclass(frozen=True, eq=False, repr=False)
class SparseTrajectory(Trajectory):
    """The result of a run of a sparse scheme: a `Trajectory` of the recorded nodes and reactions alone.

    The reactions are the mean forces of the steps, impulses included, and there are no events. The certificate was computed
    in the steps, for all nodes and contacts.

    Attributes
    ----------
    recorded, reactions : tuple of str      the names of the columns of q and v, and of the reactions
    final : State                           q, v and the mean reactions of all nodes and contacts at the end
    """

    recorded: tuple[str, ...] = ()
    reactions: tuple[str, ...] = ()
    final: State | None = None

    @property
    def nodes(self) -> tuple[str, ...]:
        """The recorded nodes."""
        return self.recorded

    @property
    def force_names(self) -> tuple[str, ...]:
        """The recorded reactions."""
        return self.reactions

    @property
    def push(self) -> Array:
        """No forces: a sparse scheme has no non-linear springs."""
        return np.zeros((len(self.t_reaction), 0))

    def certify(self, problem: Problem | None = None) -> Certificate:
        """Judge the run as `Trajectory.certify` does, where all series of up to 300 nodes are recorded."""
        if (full := self.in_full_matrices()) is None:
            raise UnsupportedError("a sparse run is judged again where all series of up to 300 nodes are recorded only")
        return full.certify(problem and _in_full_matrices(problem))

    @property
    def rows(self) -> tuple[Contact | PowerLaw, ...]:
        """The contacts whose reactions are recorded."""
        d = cast(SparseDynamics, self.problem.dynamics)
        place = {name: i for i, name in enumerate(d.reactions)}
        return tuple(d.contact(place[name]) for name in self.reactions)

    def in_full_matrices(self, largest: int = 300) -> Trajectory | None:
        """Return the run with events and full matrices, of up to ``largest`` nodes; None unless all series are recorded."""
        d = cast(SparseDynamics, self.problem.dynamics)
        whole = (self.recorded, self.reactions) == (d.nodes, d.reactions) and len(self.t) > 1
        if not whole or len(d.nodes) > largest or self.integrator is None:
            return None
        problem = _in_full_matrices(self.problem)
        r = self.reaction.copy()
        record = Record(self.t.copy(), self.q.copy(), self.v.copy(), self.t_reaction.copy(), r, stats=self.stats)
        events, impulsive = events_of_steps(problem.dynamics, record, self.integrator.impact_steps)
        r[impulsive] = 0.0
        own = {each.name: getattr(self, each.name) for each in fields(Trajectory)}
        return Trajectory(**own | {"problem": problem, "reaction": r, "events": tuple(events)})

    def summary(self) -> Summary:
        """Return the usual quantities of `Trajectory.summary` by name; NaN, unless all nodes and reactions are recorded."""
        full = None if self.quantities else self.in_full_matrices()
        if full is not None:
            return full.summary()
        return Summary.of(self, self.quantities or dict.fromkeys(SUMMARY, np.nan))

    def plot(self, path: Any = None, *, up: bool = False) -> Any:
        """Draw the recorded series over time, as `Trajectory.plot` does; with events if all of them are recorded."""
        full = self.in_full_matrices()
        return super().plot(path, up=up) if full is None else full.plot(path, up=up)

    def _lines(self, error: Sequence[str]) -> list[str]:
        d = cast(SparseDynamics, self.problem.dynamics)
        c = self.certificate
        violations = ", ".join(f"{name} {getattr(c, name):.1e}" for name in (*LAWS, "penetration"))
        violations += f", energy {c.energy_balance:.1e} of {c.energy_scale:.3g} J"
        return [
            f"SparseTrajectory of {self.problem.name} by {self.method}: {self.status.name.lower().replace('_', '-')}",
            f"  grid        t = {self.t[0]:g} ... {self.t[-1]:g} s in {len(self.t) - 1:,} steps",
            f"  scheme      {len(d.nodes):,} nodes and {len(d.reactions):,} contacts; {len(self.recorded)} and "
            f"{len(self.reactions)} recorded",
            f"  certificate residual {c.residual:.1e}, {violations}",
            *labelled(error),
            f"  {self.message}",
        ]


class SparseRun:
    """A run of a sparse scheme by moreau-jean: its table, its numbers, and its record and judgement so far.

    Attributes
    ----------
    size : int          numbers in the table of a step, per step of the first block
    stats : Stats       cost so far
    largest : Array     the largest value of each signal of the loads so far
    kept : tuple        the largest velocity that dashpots stop and the steps have kept, and its limit
    strong : StrongDashpots     the masses that dashpots may stop within a step
    """

    def __init__(self, problem: Problem, method: MoreauJean, grid: Grid, record: Sequence[str] | None) -> None:
        d = cast(SparseDynamics, problem.dynamics)
        self.problem = problem
        self.method = method
        self.grid = grid
        self.dynamics = d
        check_harmonics((*d.signals.listed, *d.motions.values()), grid.t_end)
        self.stats, self.size = Stats(), 64 * len(d.nodes)
        nodes, reactions = _chosen(d, record)
        wanted = 8.0 * (grid.steps + 1) * (2 + 2 * len(nodes) + len(reactions))
        check_memory(wanted, f"{grid.steps:,} steps of the recorded series do", "record fewer nodes, by record=[...]")
        self.step = tabulate_sparse(method.sparse_step(d, grid.h), grid.h, method.tol, method.max_iter)
        self.laws = laws_of(d, grid.h)
        start = (problem.initial_coordinates, problem.initial_velocities)
        self.largest = np.zeros(len(d.signals))
        self.kept = 0.0, 0.0
        self.strong = StrongDashpots(d, grid.h)
        self.motion, self.room, self.found = begin(d, self.laws, self.step.table, start, grid.h)
        q, v = np.empty((2, grid.steps + 1, len(nodes)))
        self.path = ChosenSeries(nodes, reactions, q, v, np.empty((grid.steps, len(reactions))))
        q[0], v[0] = start[0][nodes], start[1][nodes]

    def advance(self, first: int, last: int, *, judged: int = 4) -> tuple[Status, int]:
        """Take the steps from t_first to t_last; return the status and the last step that was reached.

        After every ``judged`` steps velocities that dashpots stop within one are looked for, if there may be any.
        """
        steps = max(1, MOST_INPUTS // max(1, sum(input_sizes(self.dynamics))))
        steps = min(steps, judged) if len(self.strong.rows) else steps
        status, reached = Status.SOLVED, first
        while status is Status.SOLVED and reached < last:
            # After the first step too, since what dashpots stop half is gone soon.
            first_alone = len(self.strong.rows) and not reached
            status, reached = self._advance(reached, min(last, reached + (1 if first_alone else steps)))
            if len(self.strong.rows) and reached > first:
                self._judge_damping(reached)
        return status, reached

    def _judge_damping(self, reached: int) -> None:
        """Note the velocity that dashpots stop and the last step has kept, if it is larger in proportion to its limit."""
        d, n = self.dynamics, len(self.dynamics.nodes)
        before, now = self.motion.x[1 - reached % 2], self.motion.x[reached % 2]
        r = before[2 * n : 2 * n + len(d.u0)] / self.grid.h
        loads = np.abs(d.f) + abs(d.F) @ self.largest
        start, end = State(before[:n], before[n : 2 * n], r), State(now[:n], now[n : 2 * n], r)
        found = self.strong.velocity_kept(start, end, loads, self.room.speed)
        self.kept = largest_violation(*np.transpose([found, self.kept]))

    def _advance(self, first: int, last: int) -> tuple[Status, int]:
        """Take steps whose loads and motions are kept together."""
        times, step = self.grid.times(first, last), self.step

        def run(solver: SolverState | None, begin: int, end: int) -> tuple[Status, int]:
            given = self._given(times[begin - first : end - first + 1])
            if not (known := np.isfinite(given.inputs).all(axis=1)).all():
                last_known = begin + int(np.argmin(known))
                found = run(solver, begin, last_known) if last_known > begin else (Status.SOLVED, begin)
                return (Status.NON_FINITE, found[1]) if found[0] is Status.SOLVED else found
            block = BlockOfSteps(
                begin, end, self.grid.h, float(self.method.theta), self.method.declared.precision, given
            )
            judge = (self.laws, self.room, self.found)
            kernel = solver.kernel if solver else block_pivoting
            status, reached, iterations, residual = step.loop(
                block, step.table, judge, step.contacts, self.motion, self.path, step.solve, kernel
            )
            self.stats.add_lcps(reached - begin, iterations, residual)
            return Status(status), reached

        return (
            with_fallbacks(run, step.solver, step.few, first, last)
            if step.solver and step.few
            else run(None, first, last)
        )

    def _given(self, t: Array) -> Given:
        """Return the loads and motions of the steps between instants, for the steps and for their judge."""
        d, θ = self.dynamics, self.method.theta
        left, right = d.signals.limits_in_steps(t, self._at_ends)
        y, rate = d.motion(t)
        np.maximum(self.largest, np.maximum(np.abs(left), np.abs(right)).max(axis=0), out=self.largest)
        inputs = [right[:-1], left[1:], y[1:], rate[1:], self.method.mean_rates(d, self.grid.h, t, y, rate)]
        s_θ = (1.0 - θ) * right[:-1] + θ * left[1:]
        rows = (np.hstack(inputs), s_θ, np.abs(s_θ), y[1:], rate[1:])
        return Given(*(np.ascontiguousarray(each) for each in rows))

    @cached_property
    def _at_ends(self) -> Flags:
        """Flags of the signals that load quasi-static nodes, in balance at the ends of steps (ns,)."""
        d = self.dynamics
        held = abs(d.kinds.static).sum(axis=1) > 0.0
        return np.asarray(np.asarray(abs(d.F)[np.flatnonzero(held)].sum(axis=0)).ravel() > 0.0)

    def trajectory(self, status: Status, reached: int, method: str) -> SparseTrajectory:
        """Return the result of the run up to a step."""
        d = self.dynamics
        path = self.path
        n = len(self.dynamics.nodes)
        nc = len(self.dynamics.u0)
        certificate = self._certificate(reached)
        why = status.sentence_of("auto")
        message = f"{self.method.name} stopped after step {reached} (t = {reached * self.grid.h:g} s): {why}"
        if status is Status.SOLVED:
            message = status.sentence
            if not certificate.holds:
                status = Status.VIOLATED
                message = f"{self.method.name}: {'; '.join(certificate.failures)}. {status.sentence}"
        self.stats.steps = reached
        now = self.motion.x[reached % 2]
        before = self.motion.x[1 - reached % 2]
        return SparseTrajectory(
            problem=self.problem, method=method, t=self.grid.times(0, self.grid.steps)[: reached + 1],
            q=path.q[: reached + 1], v=path.v[: reached + 1],
            t_reaction=self.method.reaction_times(self.grid)[:reached], reaction=path.r[:reached], events=(),
            status=status, message=message, certificate=certificate, stats=self.stats, integrator=self.method,
            recorded=tuple(d.nodes[i] for i in path.nodes), reactions=tuple(d.reactions[i] for i in path.contacts),
            final=State(now[:n].copy(), now[n : 2 * n].copy(), before[2 * n : 2 * n + nc] / self.grid.h),
        )  # fmt: skip

    def _certificate(self, steps: int) -> Certificate:
        """Return the certificate of the steps: their violations and limits."""
        _, *found = self.found.laws.tolist()
        ε = np.finfo(float).eps
        violations, limits = (dict(zip(LAWS, each, strict=True)) for each in found)
        with np.errstate(all="ignore"):  # where nothing moves, there is no scale
            violations["penetration"], limits["penetration"] = self._penetration()
            violations["missed_impulse"], limits["missed_impulse"] = self._missed_impulse(steps)
            # Under loads that do not vary, a body that is far away at last has gone there.
            place, forces = self._places_and_forces()
            gone = steps * ε * float(place @ forces)
        if len(self.strong.rows):
            violations["damping"], limits["damping"] = self.kept
        balance, scale = map(float, self.found.energy[:2])
        loss = 0.0
        # An identity, unless coordinates are moved to equilibrium after a step.
        if self.dynamics.kinds.static.shape[1] == 0:
            works = scale + self._energy_of_loads() + float(self.found.energy[5])
            allowed = (self.method.declared.precision + 8.0 * steps * ε) * works
            allowed += 8.0 * ε * float(self.found.energy[6]) + gone
            if self.method.theta == 0.5:
                limits["energy_balance"] = allowed
            else:
                loss = float(self.found.energy[9])
                limits["energy_loss"] = allowed
        return Certificate(
            residual=self.stats.residual,
            energy_balance=balance,
            energy_scale=scale,
            energy_loss=loss,
            velocity_scale=float(self.found.energy[4]),
            limits=limits,
            **cast(Any, violations),
        )

    def _penetration(self) -> tuple[float, float]:
        """Return the penetration with the largest ratio to its limit, as of other certificates, and that limit."""
        d = self.dynamics
        room = self.room
        h = self.grid.h
        ε = self.method.declared.precision
        place, forces = self._places_and_forces()
        speed = room.speed + h * forces * self.laws.per_mass
        # A contact at position level is closed exactly, unless coordinates are moved to equilibrium after a step.
        exact = (d.relative_degree < 2) & (d.kinds.static.shape[1] == 0)
        gap_change = np.where(exact, 0.0, h * np.maximum(room.rate, abs(d.H) @ speed))
        terms = abs(d.H) @ (place + h * self.found.energy[4]) + np.abs(d.u0)
        return largest_violation(room.penetration, gap_change + ε * terms)

    def _places_and_forces(self) -> tuple[Array, Array]:
        """Return the last |q| in m of each node, and the sum of the largest forces at it but reactions in N (n,)."""
        d = self.dynamics
        place = np.abs(self.motion.x[:, : len(d.nodes)]).max(axis=0)
        return place, np.abs(d.f) + abs(d.F) @ self.largest + abs(d.K) @ place + abs(d.C) @ self.room.speed

    def _missed_impulse(self, steps: int) -> tuple[float, float]:
        """Return the impulse of loads, or of motions by springs, that the steps miss, and its limit by the momenta."""
        d, t = self.dynamics, self.grid.times(0, steps)
        meant = zip(d.signals.listed, self._at_ends, strict=True)
        loads = [0.0 if breaks(signal) and not held else missed_integral(signal, t) for signal, held in meant]
        missed = abs(d.F) @ np.array(loads)
        missed += abs(d.K)[:, list(d.motions)] @ np.array([missed_integral(y, t) for y in d.motions.values()])
        momenta = abs(d.M) @ self.room.speed
        momenta[~d.massive] = momenta.max(initial=0.0)
        return largest_violation(missed[~d.driven], MOMENTUM_FRACTION * momenta[~d.driven])

    def _energy_of_loads(self) -> float:
        """Return the energy in J that loads that depend on time could give in a step to masses at rest."""
        d = self.dynamics
        fall = self.grid.h * (abs(d.F) @ self.largest) * self.laws.per_mass
        return float(fall @ (abs(d.M) @ fall))


def _in_full_matrices(problem: Problem) -> Problem:
    """Return the problem of a sparse scheme with full matrices; another one as it is."""
    scheme = problem.scheme
    if not problem.sparse or not isinstance(scheme, Scheme):
        return problem
    return replace(problem, scheme=Scheme(*scheme.elements, format="full"))


def _chosen(d: SparseDynamics, record: Sequence[str] | None) -> tuple[Any, Any]:
    """Return the indices of the recorded nodes and reactions, all by default."""
    if record is None:
        return np.arange(len(d.nodes)), np.arange(len(d.u0))
    if isinstance(record, str) or not all(isinstance(name, str) for name in record):
        raise InputError(f"record = {record!r} must be a sequence of names of nodes and reactions")
    wanted = dict.fromkeys(record)
    rows = {name: i for i, name in enumerate(d.reactions) if name in wanted}
    for name in wanted:
        if name not in d.index and name not in rows:
            raise InputError(nearest(name, [*d.nodes[:1000], *d.reactions[:1000]], "node or reaction"))
    nodes = [d.index[name] for name in wanted if name in d.index]
    return np.array(nodes, dtype=np.int64), np.array([rows[name] for name in wanted if name in rows], dtype=np.int64)
