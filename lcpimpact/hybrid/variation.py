r"""The derivative of an exact motion with respect to parameters p of its problem.

Within a mode X_p = ∂X/∂p follows

.. math:: X_p' = A X_p + A_p X .

At an event the row c falls through zero, at the instant

.. math:: t_p = -\frac{c\, X_p + c_p X^-}{c \cdot f^-},

so that with X⁺ = R X⁻ (see `lcpimpact.hybrid.tangent`)

.. math:: X_p^+ = R\, (X_p^- + f^- t_p) + R_p X^- - f^+ t_p .

The matrices are smooth functions of p as long as the modes stay what they are: A_p, c_p and R_p are differences of order 6
of the matrices of the same mode in problems with other values of p, so each constant of each element may be a parameter. The
differences are formed between double-doubles.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np

from lcpimpact.arrays import Array, Flags
from lcpimpact.errors import InputError, UnsupportedError
from lcpimpact.hybrid.flow import Flow
from lcpimpact.hybrid.gaps import zero_rows
from lcpimpact.hybrid.motion import ExactSolution
from lcpimpact.hybrid.system import Mode, System
from lcpimpact.hybrid.tangent import GRAZING_RTOL, Hit, Passage, hit_of, impulse_rows, jump_matrix, passage
from lcpimpact.memo import Memo, remembered
from lcpimpact.numerics.double_double import DoubleDouble
from lcpimpact.problems.base import Problem
from lcpimpact.scheme.first_order import FirstOrderForm


class Member(NamedTuple):
    """A problem, and its linear complementarity system."""

    problem: Problem
    system: System

    @property
    def state(self) -> Array:
        """X at t = 0 (N,)."""
        return self.system.state(self.problem.initial_coordinates, self.problem.initial_velocities)


Matrices = Callable[[Member], Array | DoubleDouble]
"""Numbers of a problem that are smooth functions of its parameters."""


class Neighbours(NamedTuple):
    """The problems with other values of one parameter.

    Attributes
    ----------
    members : tuple of Member
    offsets : (k,) array            their values of the parameter less its own
    weights : (k,) array            those of f(p + offset) - f(p) in f'(p)
    """

    members: tuple[Member, ...]
    offsets: Array
    weights: Array


@dataclass(frozen=True, eq=False)
class Family:
    """A problem, and its neighbours in each parameter.

    Attributes
    ----------
    base : Member
    neighbours : dict               by parameter (np)
    """

    base: Member
    neighbours: dict[str, Neighbours]

    def derivative(self, of: Matrices) -> Array:
        """Return the derivatives (np, ...) of the matrices (...) with respect to the parameters.

        Raises
        ------
        UnsupportedError
            If their shape changes with a parameter.
        """
        here = DoubleDouble.of(of(self.base)).parts
        found = np.zeros((len(self.neighbours), *here.shape[1:]))
        for j, (name, (members, offsets, weights)) in enumerate(self.neighbours.items()):
            try:
                there = [DoubleDouble.of(of(member)).parts for member in members]
            except (np.linalg.LinAlgError, IndexError):
                raise _other_structure(name) from None
            if any(each.shape != here.shape for each in there):
                raise _other_structure(name)
            changes = np.array([(each[0] - here[0]) + (each[1] - here[1]) for each in there])
            slope = np.tensordot(weights, changes, 1)
            found[j] = np.where(_is_rounding(changes, here[0], np.multiply.outer(offsets, slope)), 0.0, slope)
        return found


def _is_rounding(
    changes: Array, here: Array, linear: Array, *, rounding_rtol: float = 2.0**-49, noise_rtol: float = 0.1
) -> Flags:
    """Return which numbers change by rounding only: by a few units in the last place, and not in proportion to p.

    ``rounding_rtol``: changes relative to the number, or to 1 where it is smaller than that.
    ``noise_rtol``: distance of the changes from a straight line, relative to the greatest.
    """
    largest = np.abs(changes).max(axis=0)
    return np.asarray(
        (largest <= rounding_rtol * np.abs(here)) & (np.abs(changes - linear).max(axis=0) > noise_rtol * largest)
    )


def family_of(
    system: System,
    problem: Problem,
    make: Callable[[str, float], Problem],
    values: Mapping[str, float],
    sizes: Mapping[str, float],
    *,
    step: float = 2.0**-9,
) -> Family:
    """Return a problem with its neighbours.

    ``step``: distance of neighbouring values, relative to a power of two near the size of the parameter. The error of
    the difference of 1/p is 36 step⁶ = 2e-15; rounding in a number that is computed from p counts 1/step times.

    Parameters
    ----------
    system : System
        That of the motion of the problem.
    problem : Problem
    make : callable
        Returns the problem with another value of a parameter.
    values, sizes : mapping of str to float
        The value of each parameter, and its size, above zero.

    Raises
    ------
    InputError
        If a parameter cannot be changed in either direction.
    UnsupportedError
        If the structure of the problem changes with a parameter.
    """
    base = Member(problem, system)
    structure = _structure(base)
    neighbours = {}
    for name, value in values.items():
        d = step * 2.0 ** np.floor(np.log2(sizes[name]))
        neighbours[name] = _neighbours(base, partial(make, name), value, d)
        if any(_structure(member) != structure for member in neighbours[name].members):
            raise _other_structure(name)
    return Family(base, neighbours)


def _neighbours(
    base: Member, make: Callable[[float], Problem], value: float, d: float, *, order: int = 6
) -> Neighbours:
    """Return the neighbours at multiples of d to both sides, or within the domain of the parameter.

    ``order``: that of the differences, and the number of neighbours.
    """
    half = order // 2
    refused: InputError | None = None
    for places in (range(-half, half + 1), range(order + 1), range(0, -order - 1, -1)):
        values = value + d * np.array([each for each in places if each])
        try:
            problems = [make(float(each)) for each in values]
            systems = [System(problem.dynamics, base.system.duration) for problem in problems]
        except InputError as error:
            refused = refused or error
            continue
        offsets = values - value
        return Neighbours(tuple(map(Member, problems, systems)), offsets, slope_weights(offsets / d) / d)
    assert refused is not None
    raise refused


def slope_weights(offsets: Array) -> Array:
    """Return the weights of f(x_k) - f(0) in f'(0), exact for polynomials whose degree is the number of points.

    Examples
    --------
    >>> slope_weights(np.array([-1.0, 1.0]))
    array([-0.5,  0.5])
    """
    powers = np.vander(offsets, len(offsets) + 1, increasing=True)[:, 1:]
    return np.asarray(np.linalg.solve(powers.T, np.eye(len(offsets))[0]))


def _structure(member: Member) -> str:
    """Return the parts that all problems of a family have in common, as text."""
    d, form = member.system.dynamics, member.system.form
    parts = (form.parts.massive, form.parts.damped, form.parts.static, form.parts.driven)
    common = (
        d.nodes, tuple(each.name for each in d.contacts),
        tuple(map(int, d.relative_degree)), tuple((part != 0.0).tobytes() for part in parts),
        tuple(type(each) for each in form.sources), len(form.signals), bool(member.problem.note),
        member.system.lines.shape,
    )  # fmt: skip
    return repr(common)


def _other_structure(name: str) -> UnsupportedError:
    return UnsupportedError(
        f"{name}: beside its value the system has other states, contacts or signals, so the motion has no derivative with "
        "respect to it: change its value a little"
    )


class Arrival(NamedTuple):
    """The end of a segment.

    Attributes
    ----------
    event : Passage
    t_p : (np,) array           the derivative of its instant
    X_p : (N, np) array         X_p at it, before the event
    X, X_p_fine : DoubleDouble  X (N,) and X_p (np, N) there, in double-doubles
    """

    event: Passage
    t_p: Array
    X_p: Array
    X: DoubleDouble
    X_p_fine: DoubleDouble


@dataclass(eq=False)
class Variation(Memo):
    """The derivatives of an exact motion with respect to the parameters of a family, as far as they were asked for.

    Attributes
    ----------
    solution : ExactSolution
    family : Family
    arrivals : list of Arrival          the end of each segment
    states : list of DoubleDouble       X_p (np, N) at the start of each segment, after its events
    """

    solution: ExactSolution
    family: Family
    arrivals: list[Arrival] = field(default_factory=list)
    states: list[DoubleDouble] = field(default_factory=list)

    @property
    def scale(self) -> Array:
        """The largest |X| of the segments (N,)."""
        return remembered(self, "scale", self._scale)

    def _scale(self) -> Array:
        sides = np.array([side for each in self.solution.segments for side in (each.before, each.X)])
        return np.asarray(np.abs(sides).max(axis=0))

    @property
    def count(self) -> int:
        """Number of parameters."""
        return len(self.family.neighbours)

    def start(self, k: int) -> Array:
        """Return X_p (N, np) after the events at the start of segment k.

        Raises
        ------
        UnsupportedError
            If it does not exist.
        """
        return self._fine(k).hi.T

    def _fine(self, k: int) -> DoubleDouble:
        """Return X_p (np, N) after the events at the start of segment k.

        Where impacts accumulate, instants move by the derivative of a gap over ever smaller speeds, so it needs more digits.
        """
        while len(self.states) <= k:
            self.states.append(self._after(len(self.states) - 1) if self.states else DoubleDouble.of(self._begin().T))
        return self.states[k]

    def arrival(self, k: int) -> Arrival:
        """Return the end of segment k."""
        while len(self.arrivals) <= k:
            self.arrivals.append(self._arrive(len(self.arrivals)))
        return self.arrivals[k]

    def flow(self, mode: Mode) -> Flow:
        """Return the flow of X and all X_p in a mode."""
        return remembered(self, ("flow", mode.key), lambda: self._flow(mode))

    def _flow(self, mode: Mode) -> Flow:
        system = self.family.base.system
        generator = system.reaction(mode)[0].generator
        A_p = self.family.derivative(lambda each: each.system.reaction(mode)[0].generator)
        N = len(generator)
        parts = np.zeros((2, (1 + self.count) * N, (1 + self.count) * N))
        for j in range(1 + self.count):
            here = slice(j * N, (j + 1) * N)
            parts[:, here, here] = generator.parts
            if j:
                parts[0, here, :N] = A_p[j - 1]
        return Flow(DoubleDouble(parts), system.duration)

    def at(self, k: int, times: Array) -> tuple[Array, Array]:
        """Return X (nt, N) and X_p (nt, N, np) in segment k, at times in s after its start."""
        segment = self.solution.segments[k]
        self._refuse_touch(k, float(times.max()))
        flow, Z = self._augmented(k)
        found = flow.move(Z, float(times[0])).hi[None] if len(times) == 1 else flow.at(Z, times)
        N = len(segment.X)
        return found[:, :N], found[:, N:].reshape(len(times), self.count, N).transpose(0, 2, 1)

    def _augmented(self, k: int) -> tuple[Flow, DoubleDouble]:
        """Return the flow of X and all X_p in segment k, and both at its start."""
        segment = self.solution.segments[k]
        parts = [segment.state.parts, self._fine(k).parts.reshape(2, -1)]
        return self.flow(segment.mode), DoubleDouble(np.concatenate(parts, axis=1))

    def _refuse_touch(
        self, k: int, until: float, *, touch_rtol: float = GRAZING_RTOL**2, max_points: int = 20_000
    ) -> None:
        """Refuse a row that comes down to zero in segment k, up to a time in s after its start, without ending it.

        With another value of a parameter it ends the segment, so that derivatives are of one side at most.
        ``touch_rtol``: least value of a row, relative to its terms, that counts as zero: the depth to which a slope of
        `GRAZING_RTOL` reaches.
        """
        system, segment = self.family.base.system, self.solution.segments[k]
        flow, _ = system.reaction(segment.mode)
        watch = system.watch(segment.mode)
        rows, A = watch.rows.hi, flow.A
        times = np.linspace(0.0, until, min(3 + int(2.0 * until / flow.window), max_points))
        values = flow.at(segment.state, times) @ rows.T
        below = (values[1:-1] < values[:-2]) & (values[1:-1] <= values[2:])
        if k + 1 in self.accumulating:
            # Flights between accumulating impacts are as low as rounding.
            below[:, watch.contacts == self.accumulating[k + 1]] = False
        for i, a in zip(*np.nonzero(below), strict=True):
            t = times[i + 1]
            for _ in range(4):  # Newton's method for the instant of the least value
                X = flow.move(segment.state, float(t)).hi
                slope, curvature = rows[a] @ A @ X, rows[a] @ A @ A @ X
                t = np.clip(t - slope / curvature if curvature > 0.0 else t, times[i], times[i + 2])
            if rows[a] @ X <= touch_rtol * (np.abs(rows[a]) @ self.scale):
                name = system.dynamics.contacts[watch.contacts[a]].name
                raise UnsupportedError(
                    f"{name} comes to its limit and turns at t = {segment.t0 + t:g} s without an event, where the motion "
                    "has derivatives of one side at most: change a parameter a little"
                )

    def rows(self, mode: Mode) -> tuple[Array, Array]:
        """Return the rows of q, v and r (2 n + nc, N) in a mode, and their derivatives (np, 2 n + nc, N)."""

        def of(each: Member) -> DoubleDouble:
            return each.system.coordinates(mode).rows

        return of(self.family.base).hi, remembered(self, ("rows", mode.key), lambda: self.family.derivative(of))

    def _begin(self, *, start_rtol: float = 1e-12) -> Array:
        """Return X_p at the start, after impacts there, or refuse a start at the bound of a mode.

        ``start_rtol``: value of a row that is zero at the start, relative to its terms, above which a neighbour begins
        in another mode.
        """
        system, first = self.family.base.system, self.solution.segments[0]
        mode = first.mode
        if len(system.lines) and any(event.impulse for event in first.events):
            raise UnsupportedError(
                "bodies strike over massless nodes at the start, where derivatives are not known: start a little before"
            )
        hit = self.hit(0)

        def begun(each: Member) -> Array:
            return np.asarray(
                each.state + each.system.matrices[1] @ (impulse_rows(each.system, mode, hit) @ each.state)
            )

        watch = system.watch(mode)
        for name, near in self.family.neighbours.items():
            for member in near.members:
                X, rows = begun(member), member.system.watch(mode).rows.hi
                A = member.system.reaction(mode)[0].A
                zeros = [zero_rows(member.system, mode, watch.held).hi]
                for j in range(int(watch.order.max(initial=0))):
                    zeros.append((rows @ np.linalg.matrix_power(A, j))[watch.order > j])
                Z = np.vstack(zeros)
                if (np.abs(Z @ X) > start_rtol * (np.abs(Z) @ np.abs(X))).any():
                    raise UnsupportedError(
                        f"{name}: with another value a contact that touches at the start is open or penetrated, or a slider "
                        "at rest moves, so the motion has one-sided derivatives by it at most: start away from there"
                    )
        return self.family.derivative(begun).T

    def hit(self, k: int) -> Hit | None:
        """Return the impacts at the start of segment k."""
        system, segment = self.family.base.system, self.solution.segments[k]
        P = np.zeros(len(system.degree))
        for event in segment.events:
            P[system.names[event.contact]] += event.impulse
        return hit_of(system, segment.mode, segment.before, P, self.scale)

    @property
    def accumulating(self) -> dict[int, int]:
        """The segments that begin with one of the accumulating impacts of a contact, and its row."""
        return remembered(self, "accumulating", self._accumulating)

    def _accumulating(self) -> dict[int, int]:
        system, segments = self.family.base.system, self.solution.segments

        def struck(k: int) -> int:
            """Return the contact whose impact alone is at the start of segment k, or -1."""
            rows = {system.names[event.contact] for event in segments[k].events}
            hit = any(event.impulse > 0.0 for event in segments[k].events)
            return rows.pop() if hit and len(rows) == 1 else -1

        found = {}
        for k in range(1, len(segments)):
            # A contact that rebounds stays closed after the last of infinitely many impacts only.
            i = struck(k)
            if i >= 0 and system.dynamics.restitution[i] > 0.0 and i in segments[k].mode.closed:
                while k >= 1 and struck(k) == i and segments[k - 1].mode.key == segments[k - 2].mode.key:
                    found[k] = i
                    k -= 1
        return found

    def _arrive(self, k: int) -> Arrival:
        """Return the end of segment k."""
        system, family = self.family.base.system, self.family
        before, after = self.solution.segments[k], self.solution.segments[k + 1]
        accumulates = k + 1 in self.accumulating
        event = passage(system, self.scale, before, after, slow=accumulates)
        if accumulates and event.hit is not None:
            # All impacts rebound, however slow, but for their limit, after which the contact rests.
            i = self.accumulating[k + 1]
            bounces = event.hit.bounces.copy()
            bounces[i] = i not in after.mode.closed
            hit = event.hit._replace(bounces=bounces)
            event = event._replace(hit=hit, R=jump_matrix(system, before.mode, hit))
        self._refuse_touch(k, float((after.start - before.start).hi))
        flow, Z = self._augmented(k)
        length = after.start - before.start
        there = flow.move(Z, float(length.hi), float(length.lo))
        N = len(after.before)
        X, X_p = there[:N], DoubleDouble(there.parts[:, N:].reshape(2, self.count, N))
        if not event.c.any():
            if event.hit is not None:
                raise UnsupportedError(
                    f"a body strikes as a signal jumps at t = {after.t0:g} s, where the motion has no derivative: change a "
                    "parameter a little"
                )
            t_p = family.derivative(lambda each: self._breakpoint(each, after.t0))
            return Arrival(event, t_p, X_p.hi.T, X, X_p)
        if event.row < 0:
            raise UnsupportedError(
                f"impacts accumulate, or follow each other too fast for their order to be told, at t = {after.t0:g} s, "
                "where the motion has no derivative: take outputs before"
            )
        rows = system.watch(before.mode).rows
        same = tuple(k for k, row in enumerate(rows.hi) if np.array_equal(row, event.c))
        c_p = remembered(
            self,
            ("row", before.mode, same),
            lambda: family.derivative(lambda each: each.system.watch(before.mode).rows[list(same)]),
        )
        if (c_p != c_p[:, :1]).any():
            raise UnsupportedError(
                f"two contacts switch together at t = {after.t0:g} s, where the motion has no derivative: change a "
                "parameter a little"
            )
        falls = X_p @ rows[event.row] + DoubleDouble.of(c_p[:, 0]) @ X
        return Arrival(event, -falls.hi / (event.c @ event.before), X_p.hi.T, X, X_p)

    def _breakpoint(self, each: Member, t: float) -> Array:
        """Return the instant () of the breakpoint of the signals at t, in a member of the family."""
        found, here = (one.system.form.breakpoints(0.0, 2.0 * self.solution.end) for one in (each, self.family.base))
        return np.asarray(found[int(np.argmin(np.abs(here - t)))])

    def _after(self, k: int) -> DoubleDouble:
        """Return X_p (np, N) after the events at the end of segment k."""
        event, t_p, _, X, X_p = self.arrival(k)
        system = self.family.base.system
        before, after = self.solution.segments[k], self.solution.segments[k + 1]
        t_p = t_p[:, None]
        moved = X_p + t_p * (system.reaction(before.mode)[0].generator @ X)
        form: FirstOrderForm = system.form
        if not event.c.any():
            signals = slice(form.constant, len(form.A))
            X = form.right_of(after.t0, after.before, self.scale.copy())
            moved.parts[0, :, signals] = self.family.derivative(
                lambda each: each.system.form.signals_at(self._breakpoint(each, after.t0))
            )
            moved.parts[1, :, signals] = 0.0
        R_p = self._of_hit(jump_matrix, before.mode, event.hit)
        leaves = system.reaction(after.mode)[0].generator @ after.state
        return moved @ event.R.T + R_p @ X.hi - t_p * leaves

    def _of_hit(self, of: Callable[[System, Mode, Hit | None], Array], mode: Mode, hit: Hit | None) -> Array:
        """Return the derivative (np, ...) of the matrix of impacts that end a mode."""
        key = None if hit is None else (hit.paths.tobytes(), hit.bounces.tobytes(), hit.slips)
        return remembered(
            self, (of, mode.key, key), lambda: self.family.derivative(lambda each: of(each.system, mode, hit))
        )

    def impulses(self, k: int) -> tuple[Array, Array]:
        """Return the impulses at the start of segment k (nc,), and their derivatives (nc, np)."""
        mode = self.solution.segments[max(k - 1, 0)].mode
        X, hit = self.solution.segments[k].before, self.hit(0)
        if k:
            event, t_p, X_p, _, _ = self.arrival(k - 1)
            hit, moved = event.hit, X_p + np.outer(event.before, t_p)
        else:
            moved = self.family.derivative(lambda each: each.state).T
        L = impulse_rows(self.family.base.system, mode, hit)
        return L @ X, L @ moved + (self._of_hit(impulse_rows, mode, hit) @ X).T
