r"""The derivative of an exact motion with respect to parameters p of its problem.

Within a mode X_p = ∂X/∂p follows

.. math:: X_p' = A X_p + A_p X .

At an event the row c falls through zero, at the instant

.. math:: t_p = -\frac{c\, X_p + c_p X^-}{c \cdot f^-},

so that with X⁺ = R X⁻ (see `lcpimpact.hybrid.tangent`)

.. math:: X_p^+ = R\, (X_p^- + f^- t_p) + R_p X^- - f^+ t_p .

The matrices are smooth functions of p as long as the modes stay what they are. Their derivatives A_p, c_p and R_p follow
from the formulas of the scheme (`lcpimpact.formula`) by the arithmetic that forms the matrices. By a parameter of which the
scheme is no formula, or at the end of its domain, they are differences of order 6, formed between double-doubles, of the
matrices of the same mode in problems with other values of it; so each constant of each element may be a parameter.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, NamedTuple, Protocol

import numpy as np

from lcpimpact.arrays import Array, Flags, inverse
from lcpimpact.errors import InputError, UnsupportedError
from lcpimpact.formula import FormulaSlopes, Program
from lcpimpact.hybrid.flow import NO_STEP
from lcpimpact.hybrid.forced_modes import ForcedSystem
from lcpimpact.hybrid.gaps import zero_rows
from lcpimpact.hybrid.generator import DEGREE, NO_BAND, Generator, SparseRows, expand_finely, horner, unit_rows, walk
from lcpimpact.hybrid.motion import Segment
from lcpimpact.hybrid.sampling import Expansions, Segments, sample
from lcpimpact.hybrid.system import Mode, System
from lcpimpact.hybrid.tangent import GRAZING_RTOL, Hit, Passage, hit_of, impulse_rows, jump_matrix, passage
from lcpimpact.hybrid.windows import Window
from lcpimpact.memo import Memo, remembered
from lcpimpact.numerics.double_double import DoubleDouble, stacked, with_slopes
from lcpimpact.problems.base import Problem
from lcpimpact.record import Event
from lcpimpact.scheme.first_order import FirstOrderForm
from lcpimpact.scheme.traced import slopes_of

SAME_RTOL = 1e-9
"""Difference of the derivatives of equal rows, relative to them, up to which it is rounding."""


class Member(NamedTuple):
    """A problem, its linear complementarity system, and its initial coordinates and velocities (n,).

    The system is that of ``forced`` if it has non-linear forces beside r.
    """

    problem: Problem
    system: System
    q0: DoubleDouble
    v0: DoubleDouble
    forced: ForcedSystem | None = None

    def like(self, problem: Problem) -> Member:
        """Return another problem with its system, of the same kind."""
        if self.forced is None:
            return member(problem, System(problem.dynamics, self.system.duration))
        forced = ForcedSystem.of(problem.dynamics, self.system.duration, "event-driven")
        return member(problem, forced.system, forced)

    @property
    def state(self) -> DoubleDouble:
        """X at t = 0 (N,)."""
        return self.system.start(self.q0, self.v0)


def member(problem: Problem, system: System, forced: ForcedSystem | None = None) -> Member:
    """Return a problem as a member of a family."""
    q0, v0 = map(DoubleDouble.of, (problem.initial_coordinates, problem.initial_velocities))
    return Member(problem, system, q0, v0, forced)


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
    """A problem, its numbers with their derivatives, and its neighbours in the parameters by which these are not known.

    Attributes
    ----------
    base : Member
    sizes : (np,) array             of the parameters, above zero
    formulas : Member               the numbers of the problem with their derivatives by some parameters
    traced : list of int            the numbers of these parameters
    neighbours : dict               by number of the other parameters
    names : tuple of str            of all parameters (np)
    """

    base: Member
    sizes: Array
    formulas: Member
    traced: list[int]
    neighbours: dict[int, Neighbours]
    names: tuple[str, ...]

    @property
    def differenced(self) -> tuple[str, ...]:
        """The names of the parameters by which matrices are differenced between neighbours."""
        return tuple(self.names[j] for j in self.neighbours)

    def derivative(self, of: Matrices) -> Array:
        """Return the derivatives (np, ...) of the matrices (...) with respect to the parameters.

        Raises
        ------
        UnsupportedError
            If their shape changes with a parameter.
        """
        slopes = DoubleDouble.of(of(self.formulas)).slopes.hi
        found = np.zeros((len(self.names), *slopes.shape[1:]))
        if len(slopes):
            found[self.traced] = slopes
        if self.neighbours:
            here = DoubleDouble.of(of(self.base)).parts
        for j, (members, offsets, weights) in self.neighbours.items():
            try:
                there = [DoubleDouble.of(of(member)).parts for member in members]
            except (np.linalg.LinAlgError, IndexError):
                raise _other_structure(self.names[j]) from None
            if any(each.shape != here.shape for each in there):
                raise _other_structure(self.names[j])
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
    make: Callable[[Mapping[str, Any]], Problem],
    values: Mapping[str, float],
    sizes: Mapping[str, float],
    forced: ForcedSystem | None = None,
    *,
    step: float = 2.0**-9,
) -> Family:
    """Return a problem with its derivatives.

    Its numbers are formulas of the parameters where these are sums, products and roots; by other parameters they are
    differenced between neighbouring problems.

    ``step``: distance of neighbouring values, relative to a power of two near the size of the parameter. The error of
    the difference of 1/p is 36 step⁶ = 2e-15; rounding in a number that is computed from p counts 1/step times.

    Parameters
    ----------
    system : System
        That of the motion of the problem.
    problem : Problem
    make : callable
        Returns the problem with other values of parameters, which may be formulas.
    values, sizes : mapping of str to float
        The value of each parameter, and its size, above zero.
    forced : ForcedSystem, optional
        The system with its non-linear forces, if it has some.

    Raises
    ------
    InputError
        If a parameter cannot be changed in either direction.
    UnsupportedError
        If the structure of the problem changes with a parameter.
    """
    base = member(problem, system, forced)
    formulas, traced = _traced(base, make, values)
    names, neighbours = tuple(values), {}
    for j, name in ((j, name) for j, name in enumerate(names) if j not in traced):
        d = step * 2.0 ** np.floor(np.log2(sizes[name]))
        try:
            neighbours[j] = _neighbours(base, partial(_changed, make, values, name), values[name], d)
        except InputError as error:
            raise InputError(
                f"there is no derivative by {name}, of which no value nearby is allowed: {error}"
            ) from None
        structure = _structure(base)
        if any(_structure(each) != structure for each in neighbours[j].members):
            raise _other_structure(name)
    return Family(base, np.array([sizes[name] for name in names]), formulas, traced, neighbours, names)


def _changed(
    make: Callable[[Mapping[str, Any]], Problem], values: Mapping[str, float], name: str, value: float
) -> Problem:
    """Return the problem with another value of one parameter."""
    return make({**values, name: value})


def _traced(
    base: Member, make: Callable[[Mapping[str, Any]], Problem], values: Mapping[str, float]
) -> tuple[Member, list[int]]:
    """Return the numbers of a problem with their derivatives, and the numbers of the parameters by which they are known."""
    names = list(values)
    found = _formulas(base, make, values, names)
    if found is None:
        able = [name for name in names if _formulas(base, make, values, [name])]
        found = _formulas(base, make, values, able)
    return found or (base, [])


def _formulas(
    base: Member, make: Callable[[Mapping[str, Any]], Problem], values: Mapping[str, float], able: list[str]
) -> tuple[Member, list[int]] | None:
    """Return `_traced` for some parameters, or None if other numbers depend on them than those that are known."""
    # Formulas follow neither a start that was changed, nor non-linear forces.
    if base.problem.note or not able or base.forced is not None:
        return None
    program, dynamics = Program(elementary=True), base.system.dynamics
    try:
        problem = make({**values, **{name: program.parameter(values[name]) for name in able}})
        traced = problem.dynamics
        kept = np.flatnonzero(~program.kinks())
        slopes = FormulaSlopes(program, kept.tolist())
        numbers = slopes_of(dynamics, traced, slopes)
        start = [
            with_slopes(value, slopes.of(formulas))
            for value, formulas in (
                (base.problem.initial_coordinates, problem.initial_coordinates),
                (base.problem.initial_velocities, problem.initial_velocities),
            )
        ]
    except (TypeError, InputError):  # of a function that takes no formulas
        return None
    system, (q0, v0) = System(replace(dynamics, slopes=numbers), base.system.duration), start
    return Member(base.problem, system, q0, v0), [list(values).index(able[k]) for k in kept]


def _neighbours(base: Member, make: Callable[[float], Problem], value: float, d: float) -> Neighbours:
    """Return the neighbours at multiples of d to both sides, or within the domain of the parameter."""
    refused: InputError | None = None
    for offsets in offsets_of_neighbours(d):
        values = value + offsets
        try:
            members = tuple(base.like(make(float(each))) for each in values)
        except InputError as error:
            refused = refused or error
            continue
        offsets = values - value
        return Neighbours(members, offsets, slope_weights(offsets / d) / d)
    assert refused is not None
    raise refused


def offsets_of_neighbours(d: float, *, order: int = 6) -> Iterator[Array]:
    """Yield the distances of neighbours, multiples of d: to both sides, and for the ends of a domain to either.

    ``order``: that of the differences, and the number of neighbours.
    """
    half = order // 2
    for places in (range(-half, half + 1), range(order + 1), range(0, -order - 1, -1)):
        yield d * np.array([float(each) for each in places if each])


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
        member.system.lines.shape, d.power_laws.shape, d.rate_laws.shape, len(d.loads), len(d.force_laws),
    )  # fmt: skip
    return repr(common)


def _other_structure(name: str) -> UnsupportedError:
    return UnsupportedError(
        f"{name}: beside its value the system has other states, contacts or signals, so the motion has no derivative with "
        "respect to it: change its value a little"
    )


def _law(number: int, t: float, q: Array, v: Array, member: Member) -> Array:
    """Return the forces (k,) of a sampled force by its law, with q and v of its nodes."""
    return member.system.form.holds[number].law(t, q, v)


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


@dataclass(frozen=True, eq=False)
class VariedFlow:
    """The flow exp(A t) of a mode with its derivatives by parameters.

    X and X_p together follow the sparse generator with the blocks A on its diagonal and A_p in its first column, whose
    windows are those of A.

    Attributes
    ----------
    generator : DoubleDouble        A (N, N), with its derivatives
    window : float                  δ in s, with ρ δ <= 1 (see `lcpimpact.hybrid.flow`), a power of two
    """

    generator: DoubleDouble
    window: float

    @cached_property
    def factors(self) -> Generator:
        """The generator of X and X_p, one after the other (N + np N)."""
        A, A_p = self.generator.value.parts, self.generator.slopes.parts
        blocks, N = A_p.shape[1] + 1, len(self.generator)
        rows = np.zeros((2, blocks, N, 2 * N))
        rows[:, 1:, :, :N], rows[..., N:] = A_p, A[:, None]
        columns = np.arange(2 * N) + np.where(np.arange(2 * N) < N, 0, N * (np.arange(blocks)[:, None] - 1))
        kept = rows[0] != 0.0
        starts = np.append(0, np.cumsum(kept.sum(axis=2)))
        at = np.broadcast_to(columns[:, None], kept.shape)[kept]
        return Generator(SparseRows(np.ascontiguousarray(rows[:, kept]), starts, at), 0, NO_BAND)

    @cached_property
    def powers(self) -> list[DoubleDouble]:
        """exp(2ᵏ A δ), as far as they were asked for."""
        N, units = len(self.generator), np.zeros((2, self.factors.Q.starts.size - 1))
        columns = []
        for j in range(N):
            units[0, j] = 1.0
            columns.append(_parted(walk(self.factors, self.window, units, 1, DEGREE), N).parts)
            units[0, j] = 0.0
        return [DoubleDouble(np.stack(columns, axis=-1))]

    def power(self, k: int) -> DoubleDouble:
        """Return exp(2ᵏ A δ) (N, N) with its derivatives."""
        while len(self.powers) <= k:
            self.powers.append(self.powers[-1] @ self.powers[-1])
        return self.powers[k]

    def _far(self, X: DoubleDouble, windows: int) -> DoubleDouble:
        """Return the state with its derivatives a number of windows after X, by powers of exp(A δ)."""
        for k in range(windows.bit_length()):
            if windows >> k & 1:
                X = self.power(k) @ X
        return X

    @property
    def near(self) -> int:
        """The number of windows up to which their series cost less than powers of exp(A δ)."""
        return 2 * len(self.generator)

    def carry(self, X: DoubleDouble, t: DoubleDouble) -> DoubleDouble:
        """Return the state (N,) with its derivatives at one time t >= 0 after X, in double-doubles."""
        δ, windows = self.window, int(t.hi // self.window)
        if windows > self.near:
            X, windows = self._far(X, windows), 0
        Z = walk(self.factors, δ, _together(X), windows, DEGREE)
        within = (t - δ * (t.hi // δ)) / δ
        terms = expand_finely(self.factors, δ, Z, DEGREE)
        return _parted(horner(terms, float(within.hi), float(within.lo)), len(self.generator))

    def move(self, X: DoubleDouble, times: Array) -> tuple[Array, Array]:
        """Return X (nt, N) and X_p (nt, N, np) at times t >= 0 after a state with its derivatives, in floats."""
        order = np.argsort(times, kind="stable")
        t, N = times[order], len(self.generator)
        windows = np.floor(t / self.window)
        far = np.flatnonzero(np.diff(windows, prepend=0.0) > self.near)
        cuts = np.append(0, far) if not len(far) or far[0] > 0 else far
        states, w = [], 0
        for cut in cuts.tolist():
            until = int(windows[cut]) if cut in far else 0
            X, w = self._far(X, until - w), until
            states.append(_together(X))
        starts = np.zeros((len(cuts), 2))
        starts[:, 0] = np.where(np.isin(cuts, far), windows[cuts], 0.0) * self.window
        found = np.empty((self.factors.Q.starts.size - 1, len(t)))
        none = Expansions(np.zeros(1, np.int64), np.zeros(0, np.int64), np.empty((0, len(found), DEGREE + 1)), False)
        sample(
            Window(self.factors, self.window, NO_STEP), np.zeros((0, 2, 0, 0)), Segments(starts, np.array(states)),
            np.arange(len(cuts)), t, np.append(cuts, len(t)), unit_rows(len(found)), none, found,
        )  # fmt: skip
        both = found.T[inverse(order)].reshape(len(t), -1, N)
        return both[:, 0], both[:, 1:].transpose(0, 2, 1)


def _together(X: DoubleDouble) -> Array:
    """Return a state with its derivatives (N,) as one state (2, N + np N)."""
    return np.concatenate([X.value.parts[:, None], X.slopes.parts], axis=1).reshape(2, -1)


def _parted(Z: Array, N: int) -> DoubleDouble:
    """Return one state (2, N + np N) as a state with its derivatives (N,)."""
    both = Z.reshape(2, -1, N)
    return DoubleDouble(np.concatenate([both[:, 0], both[:, 1:].reshape(-1, N)]))


class SegmentedMotion(Protocol):
    """A motion as a chain of segments, up to ``end`` in s."""

    @property
    def system(self) -> System:
        """The system."""

    @property
    def segments(self) -> Sequence[Segment]:
        """The segments."""

    @property
    def end(self) -> float:
        """The end in s."""


@dataclass(eq=False)
class Variation(Memo):
    """The derivatives of an exact motion with respect to the parameters of a family, as far as they were asked for.

    Attributes
    ----------
    solution : SegmentedMotion
    family : Family
    arrivals : list of Arrival          the end of each segment
    states : list of DoubleDouble       X_p (np, N) at the start of each segment, after its events
    """

    solution: SegmentedMotion
    family: Family
    arrivals: list[Arrival] = field(default_factory=list)
    states: list[DoubleDouble] = field(default_factory=list)

    @property
    def starts(self) -> Array:
        """The instants at which the segments start (ns,)."""
        return np.array([each.t0 for each in self.solution.segments])

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
        return len(self.family.names)

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

    def flow(self, mode: Mode) -> VariedFlow:
        """Return the flow of X and X_p in a mode."""
        return remembered(self, ("flow", mode.key), lambda: self._flow(mode))

    def _flow(self, mode: Mode) -> VariedFlow:
        flow, _ = self.family.base.system.reaction(mode)
        A_p = self.family.derivative(lambda each: each.system.reaction(mode)[0].generator)
        return VariedFlow(with_slopes(flow.generator, A_p), flow.window)

    def at(self, k: int, times: Array) -> tuple[Array, Array]:
        """Return X (nt, N) and X_p (nt, N, np) in segment k, at times in s after its start."""
        segment = self.solution.segments[k]
        self._refuse_touch(k, float(times.max()))
        return self.flow(segment.mode).move(with_slopes(segment.state, self._fine(k)), times)

    def _refuse_touch(self, k: int, until: float) -> None:
        """Refuse an event function that comes down to zero in segment k, up to a time after its start, without ending it.

        With another value of a parameter it ends the segment, so that derivatives are of one side at most.
        """
        for t, name in self._touches(k):
            if t <= until:
                raise UnsupportedError(
                    f"{name} comes to its limit and turns at t = {self.solution.segments[k].t0 + t:g} s without an event, "
                    "where the motion has derivatives of one side at most: change a parameter a little"
                )

    def _touches(self, k: int) -> list[tuple[float, str]]:
        """Return where event functions come down to zero in segment k without ending it, and whose they are."""
        mode = self.solution.segments[k].mode
        return remembered(self, ("touches", mode), lambda: self._touches_in(mode)).get(k, [])

    def _touches_in(
        self, mode: Mode, *, touch_rtol: float = GRAZING_RTOL**2, max_points: int = 20_000
    ) -> dict[int, list[tuple[float, str]]]:
        """Return the touches of all segments of a mode, by segment.

        ``touch_rtol``: least value of a row, relative to its terms, that counts as zero: the depth to which a slope of
        `GRAZING_RTOL` reaches.
        """
        system, segments = self.family.base.system, self.solution.segments
        flow, _ = system.reaction(mode)
        watch = system.watch(mode)
        rows, A = watch.rows.hi, flow.A
        if not len(rows):
            return {}
        mine = [k for k, segment in enumerate(segments) if segment.mode == mode]
        ends = [segments[k + 1].start if k + 1 < len(segments) else self.solution.end for k in mine]
        lengths = [max(float((end - segments[k].start).hi), 0.0) for k, end in zip(mine, ends, strict=True)]
        times = [np.linspace(0.0, each, min(3 + int(2.0 * each / flow.window), max_points)) for each in lengths]
        states = np.array([segments[k].state.parts for k in mine])
        values = np.split(flow.along(states, times, watch.entries).T, np.cumsum([*map(len, times)])[:-1])
        found: dict[int, list[tuple[float, str]]] = {}
        for k, at, y in zip(mine, times, values, strict=True):
            below = (y[1:-1] < y[:-2]) & (y[1:-1] <= y[2:])
            if k + 1 in self.accumulating:
                # Flights between accumulating impacts are as low as rounding.
                below[:, watch.contacts == self.accumulating[k + 1]] = False
            for i, a in zip(*np.nonzero(below), strict=True):
                t = at[i + 1]
                for _ in range(4):  # Newton's method for the instant of the least value
                    X = flow.move(segments[k].state, float(t)).hi
                    slope, curvature = rows[a] @ A @ X, rows[a] @ A @ A @ X
                    t = np.clip(t - slope / curvature if curvature > 0.0 else t, at[i], at[i + 2])
                if rows[a] @ X <= touch_rtol * (np.abs(rows[a]) @ self.scale):
                    found.setdefault(k, []).append((float(t), system.dynamics.contacts[watch.contacts[a]].name))
        return found

    def rows(self, mode: Mode) -> tuple[Array, Array]:
        """Return the rows of q, v and r (2 n + nc, N) in a mode, and their derivatives (np, 2 n + nc, N)."""

        def of(each: Member) -> DoubleDouble:
            return each.system.coordinates(mode).rows

        return of(self.family.base).hi, remembered(self, ("rows", mode.key), lambda: self.family.derivative(of))

    def series(self, k: int, times: Array) -> tuple[Array, Array]:
        """Return all series (nt, ns) in segment k, at times in s after its start, and their derivatives (nt, ns, np)."""
        X, X_p = self.at(k, times)
        rows, rows_p = self.rows(self.solution.segments[k].mode)
        return X @ rows.T, np.asarray(rows @ X_p + np.einsum("pij,tj->tip", rows_p, X))

    def limit(self, k: int, side: str) -> tuple[Array, Array]:
        """Return q, v and r at the events at the start of segment k, on one side of them, and their total derivatives."""
        if k == 0 and side == "left":
            return self._given()
        # The rate after an impact on a strong dashpot is large, and cancels in double-doubles only.
        segments, system, t_p = self.solution.segments, self.solution.system, self.instant(k)[:, None]
        if side == "left":
            mode, X, X_p = segments[k - 1].mode, self.arrival(k - 1).X, self.arrival(k - 1).X_p_fine
        else:
            mode, X, X_p = segments[k].mode, segments[k].state, self._fine(k)
        total = (X_p + t_p * (system.reaction(mode)[0].generator @ X)).hi.T
        rows, rows_p = self.rows(mode)
        return rows @ X.hi, rows @ total + (rows_p @ X.hi).T

    def _given(self) -> tuple[Array, Array]:
        """Return q, v and no forces as they are given at the start, and their derivatives."""

        def start(each: Member) -> DoubleDouble:
            return stacked([[each.q0[None], each.v0[None]]])[0]

        d = self.solution.system.dynamics
        none = np.zeros(len(d.forces))
        given = self.family.derivative(start).T
        return np.append(start(self.family.base).hi, none), np.vstack([given, np.zeros((len(none), self.count))])

    @property
    def events(self) -> Sequence[Event]:
        """The events of the motion, in their order."""
        return [event for segment in self.solution.segments for event in segment.events]

    def instant(self, k: int) -> Array:
        """Return the derivative of the instant (np,) at which segment k starts."""
        return self.arrival(k - 1).t_p if k else np.zeros(self.count)

    def started_by(self, event: Event) -> int:
        """Return the segment that starts with an event."""
        segments = self.solution.segments
        return next(k for k, segment in enumerate(segments) if any(each is event for each in segment.events))

    def _begin(self, *, start_rtol: float = 1e-12) -> Array:
        """Return X_p at the start, after impacts there, or refuse a start at the bound of a mode.

        ``start_rtol``: change of a row that is zero at the start with the parameter, both relative to their sizes, above
        which neighbours begin in another mode.
        """
        family, first = self.family, self.solution.segments[0]
        system, mode = family.base.system, first.mode
        if len(system.lines) and any(event.impulse for event in first.events):
            raise UnsupportedError(
                "bodies strike over massless nodes at the start, where derivatives are not known: start a little before"
            )
        hit = self.hit(0)

        def begun(each: Member) -> DoubleDouble:
            L = impulse_rows(each.system, mode, hit)
            return each.state + each.system.fine.B @ (L @ each.state)

        sizes = self._zeros(family.base, begun(family.base))[1]
        changes = np.abs(family.derivative(lambda each: self._zeros(each, begun(each))[0])) * family.sizes[:, None]
        wrong = (changes > start_rtol * sizes).any(axis=1)
        if wrong.any():
            raise UnsupportedError(
                f"{family.names[int(np.argmax(wrong))]}: with another value a contact that touches at the start is open or "
                "penetrated, or a slider at rest moves, so the motion has one-sided derivatives by it at most: start away "
                "from there"
            )
        return self._sampled(0.0, first.X, family.derivative(begun).T, np.zeros(self.count))

    def _zeros(self, each: Member, X: DoubleDouble) -> tuple[DoubleDouble, Array]:
        """Return the numbers that are zero at the start, at the start X of a member, and the sizes of their terms."""
        mode = self.solution.segments[0].mode
        watch = self.family.base.system.watch(mode)
        found = [zero_rows(each.system, mode, watch.held)]
        rows, A = each.system.watch(mode).rows, each.system.reaction(mode)[0].generator
        for j in range(int(watch.order.max(initial=0))):
            found.append(rows[np.flatnonzero(watch.order > j)])
            rows = rows @ A
        Z = stacked([[block] for block in found])
        return Z @ X, np.abs(Z.hi) @ np.abs(X.hi)

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
            event = event._replace(hit=hit, R=jump_matrix(system, before.mode, hit).hi)
        self._refuse_touch(k, float((after.start - before.start).hi))
        length = after.start - before.start
        there = self.flow(before.mode).carry(with_slopes(before.state, self._fine(k)), length)
        X, X_p = there.value, there.slopes
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
        c, c_p = self._event_row(before.mode, event.row, after.t0)
        falls = X_p @ c + DoubleDouble.of(c_p) @ X
        # Speeds of accumulating impacts fall below the rounding of floats.
        rate = float((DoubleDouble.of(event.c) @ (system.reaction(before.mode)[0].generator @ X)).hi)
        if accumulates and rate == 0.0:
            return Arrival(event, self.instant(k), X_p.hi.T, X, X_p)
        return Arrival(event, -falls.hi / rate, X_p.hi.T, X, X_p)

    def _event_row(self, mode: Mode, row: int, t: float) -> tuple[DoubleDouble, Array]:
        """Return a row whose zero ends a mode, at an instant t, (N,), and its derivatives (np, N)."""

        def found() -> tuple[DoubleDouble, Array]:
            rows = self.family.base.system.watch(mode).rows
            c_p = remembered(
                self, ("watch", mode), lambda: self.family.derivative(lambda each: each.system.watch(mode).rows)
            )
            same = c_p[:, (rows.hi == rows.hi[row]).all(axis=1)]
            if (np.abs(same - same[:, :1]) > SAME_RTOL * np.abs(same)).any():
                raise UnsupportedError(
                    f"two contacts switch together at t = {t:g} s, where the motion has no derivative: change a "
                    "parameter a little"
                )
            return rows[row], c_p[:, row]

        return remembered(self, ("row", mode, row), found)

    def _breakpoint(self, each: Member, t: float) -> Array:
        """Return the instant () of the breakpoint of the signals at t, in a member of the family."""
        found, here = (one.system.form.breakpoints(0.0, 2.0 * self.solution.end) for one in (each, self.family.base))
        return np.asarray(found[int(np.argmin(np.abs(here - t)))])

    def _after(self, k: int) -> DoubleDouble:
        """Return X_p (np, N) after the events at the end of segment k."""
        event, t_p, _, X, X_p = self.arrival(k)
        before, after = self.solution.segments[k], self.solution.segments[k + 1]
        arrives, leaves = self._sides(k)
        t_p = t_p[:, None]
        moved = X_p + DoubleDouble.of(t_p) @ arrives[None]
        form: FirstOrderForm = self.family.base.system.form
        if not event.c.any():
            piecewise = np.flatnonzero(form.piecewise)
            X = form.right_of(after.t0, after.before, self.scale.copy())
            moved.parts[0][:, piecewise] = self.family.derivative(
                lambda each: each.system.form.signals_at(self._breakpoint(each, after.t0))
            )[:, piecewise - form.constant]
            moved.parts[1][:, piecewise] = 0.0
        R = with_slopes(event.R, self._of_hit(jump_matrix, before.mode, event.hit))
        found = (R @ with_slopes(X.hi, moved)).slopes
        if event.hit is not None:
            self._refuse_other_mode(k, found.hi)
        if form.holds:
            found = DoubleDouble.of(self._sampled(after.t0, after.X, found.hi.T.copy(), t_p[:, 0]).T)
        return found - DoubleDouble.of(t_p) @ leaves[None]

    def _refuse_other_mode(self, k: int, change: Array, *, rest_rtol: float = 1e-7) -> None:
        """Refuse impacts at the end of segment k after which, with another value, a contact that rests leaves.

        ``change``: the total derivatives (np, N) of the state after them.
        ``rest_rtol``: change of a gap or rate that is zero, relative to its terms, above which it is not.
        """
        family, after = self.family, self.solution.segments[k + 1]

        def rest(each: Member) -> DoubleDouble:
            return zero_rows(each.system, after.mode, family.base.system.watch(after.mode).held)

        Z, Z_p = remembered(self, ("rest", after.mode), lambda: (rest(family.base).hi, family.derivative(rest)))
        moved = np.abs(change @ Z.T + Z_p @ after.X) * family.sizes[:, None]
        leaves = (moved > rest_rtol * (np.abs(Z) @ self.scale)).any(axis=1)
        if leaves.any():
            raise UnsupportedError(
                f"{family.names[int(np.argmax(leaves))]}: with another value a contact that rests after the impact at t = "
                f"{after.t0:g} s leaves, so the motion has one-sided derivatives by it at most: change it a little"
            )

    def _sides(self, k: int) -> tuple[DoubleDouble, DoubleDouble]:
        """Return f⁻ and f⁺ (N,) at the end of segment k."""
        system, after = self.family.base.system, self.solution.segments[k + 1]
        before = system.reaction(self.solution.segments[k].mode)[0].generator
        return before @ self.arrival(k).X, system.reaction(after.mode)[0].generator @ after.state

    def _sampled(self, t: float, X: Array, change: Array, t_p: Array) -> Array:
        """Return the total derivatives of the state X (N, np) with those of the sampled forces that are set at t.

        ``t_p``: the derivative of t (np,).
        """
        form: FirstOrderForm = self.family.base.system.form
        N = len(form.A)
        first = form.constant + len(form.signals_at(np.zeros(())))

        def rows(each: Member) -> DoubleDouble:
            A, _, _, _, Q, _ = each.system.form.double_doubles
            return stacked([[Q], [Q @ A]])

        for number, held in enumerate(form.holds):
            at, here = list(held.at), slice(first, first + len(held.at))
            if held.sets_at(t):
                n, both, by_p = len(form.Q), rows(self.family.base).hi, self.family.derivative(rows)
                moved = both @ change[:N] + (by_p @ X[:N]).T
                speeds = [n + i for i in at]
                q, v, q_p, v_p = both[at] @ X[:N], both[speeds] @ X[:N], moved[at], moved[speeds]
                by_q, by_v = held.law.tangents(t, q, v)
                by_law = self.family.derivative(partial(_law, number, t, q, v))
                change[here] = by_q @ q_p + by_v @ v_p + by_law.T
                if t_p.any():
                    step = 1e-6 * self.solution.end
                    change[here] += np.outer((held.law(t + step, q, v) - held.law(t - step, q, v)) / (2.0 * step), t_p)
            first = here.stop
        return change

    def _of_hit(self, of: Callable[[System, Mode, Hit | None], DoubleDouble], mode: Mode, hit: Hit | None) -> Array:
        """Return the derivative (np, ...) of the matrix of impacts that end a mode."""
        key = (of, mode.key, hit and hit.key)
        return remembered(self, key, lambda: self.family.derivative(lambda each: of(each.system, mode, hit)))

    def impulses(self, k: int) -> tuple[Array, Array]:
        """Return the impulses at the start of segment k (nc,), and their derivatives (nc, np)."""
        mode = self.solution.segments[max(k - 1, 0)].mode
        X, hit = self.solution.segments[k].before, self.hit(0)
        if k:
            arrival = self.arrival(k - 1)
            hit, moved = arrival.event.hit, arrival.X_p + np.outer(arrival.event.before, arrival.t_p)
        else:
            moved = self.family.derivative(lambda each: each.state).T
        L = impulse_rows(self.family.base.system, mode, hit).hi
        return L @ X, L @ moved + (self._of_hit(impulse_rows, mode, hit) @ X).T
