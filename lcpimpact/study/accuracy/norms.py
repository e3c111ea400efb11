r"""Norms of the error of a run: those in which methods converge across impacts, and diagnostic ones.

A trajectory is a function of time, as returned by `Trajectory.sample`: the continuous solution of methods that have one
(exact, radau-fesd, event-driven), else the linear interpolant of q and v on the grid. Between the kinks and jumps of two
runs their difference is smooth, and is represented by a Chebyshev series to rounding error. Integrals and suprema are those
of the series, so they do not depend on sampling.

Across impacts the sup of v - v* converges for no method: for an impact delayed by δ the error equals the jump during δ. The
integral is O(δ), and so is the distance of the graphs; see docs/guide/norms.md.

Massless nodes are excluded from the norms of q and v: they follow the others by force balance, and in the step in which a
contact opens, a method that keeps it closed to the end of the step has an O(h) error there at that single instant.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.errors import FailureError, InputError
from lcpimpact.problems.base import Problem
from lcpimpact.record import Event
from lcpimpact.registry import nearest
from lcpimpact.study.accuracy.graphs import hausdorff, polyline
from lcpimpact.trajectory import Trajectory

DEGREE = 12
"""Degree of the Chebyshev series."""

MAX_HALVINGS = 27
"""Maximum number of halvings of an interval with a zero; the error is quadratic in its length."""

MAX_PIECES = 2_000_000
"""Maximum number of intervals of a series."""

SERIES_RTOL = 1e-13
"""Magnitude of the last terms, relative to the largest value, at which a series has converged."""

LAST_PLACES = 16.0

NOISE_RTOL = 1e-8
"""Magnitude, relative to the largest value, below which terms that halving does not reduce are noise, not a kink."""

NODES = np.cos(np.pi * (np.arange(DEGREE + 1) + 0.5) / (DEGREE + 1))
FIT = np.linalg.inv(chebyshev.chebvander(NODES, DEGREE))
INTEGRAL = np.array([0.0 if k % 2 else 2.0 / (1.0 - k * k) for k in range(DEGREE + 1)])
SIGNS = (-1.0) ** np.arange(DEGREE + 1)
LEFT, RIGHT = (FIT @ chebyshev.chebvander(0.5 * (NODES + shift), DEGREE) for shift in (-1.0, 1.0))
GAUSS_NODES, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(DEGREE + 1)
AT_GAUSS = chebyshev.chebvander(GAUSS_NODES, DEGREE)

Reading = Callable[[Trajectory, Array], Array]
"""Takes a run and times (nt,), and returns values (nt, m)."""


@dataclass(frozen=True, eq=False)
class Series:
    """Piecewise smooth functions as Chebyshev series.

    Attributes
    ----------
    start, length : (nk,) arrays        start and length of each piece in s
    c : (nk, DEGREE + 1, m) array       Chebyshev coefficients of m functions on each piece
    scale : float                       largest value before subtraction, to which rounding is relative

    Raises
    ------
    FailureError
        By its norms, if more than `MAX_PIECES` pieces were needed.
    """

    start: Array
    length: Array
    c: Array
    scale: float

    def l1(self) -> Array:
        """Return ∫ |f| dt for each function (m,)."""
        total = np.zeros(self.c.shape[2])
        c, length, column = self._flat()
        for level in range(MAX_HALVINGS + 1):
            turning = np.abs(c[:, 1:]).sum(axis=1)
            done = (np.abs(c[:, 0]) >= turning) | (turning <= np.finfo(float).eps * self.scale)
            if level == MAX_HALVINGS:
                done[:] = True
            np.add.at(total, column[done], np.abs(c[done] @ INTEGRAL) * 0.5 * length[done])
            c = c[~done]
            length = 0.5 * length[~done]
            column = column[~done]
            c = np.concatenate([c @ LEFT.T, c @ RIGHT.T])
            length = np.tile(length, 2)
            column = np.tile(column, 2)
            check_pieces(len(c))
        return total

    def l2(self) -> Array:
        """Return (∫ f² dt)^(1/2) for each function (m,)."""
        values = np.einsum("gk,ikm->igm", AT_GAUSS, self.c)
        return np.asarray(np.sqrt(np.einsum("g,igm,i->m", GAUSS_WEIGHTS, values**2, 0.5 * self.length)))

    def sup(self) -> float:
        """Return the largest |f| of all functions, by branch and bound over the pieces."""
        c, _, _ = self._flat()
        return _highest(np.concatenate([c, -c]), self.scale)

    def highest(self) -> Array:
        """Return the largest value of each function (m,)."""
        return np.array([_highest(self.c[:, :, i], self.scale) for i in range(self.c.shape[2])])

    def __call__(self, t: Array) -> Array:
        """Return the functions at the times t (nt,) within the pieces: (nt, m)."""
        piece = np.maximum(np.searchsorted(self.start, t, side="right") - 1, 0)
        s = np.clip(2.0 * (t - self.start[piece]) / self.length[piece] - 1.0, -1.0, 1.0)[:, None]
        value = np.zeros((len(t), self.c.shape[2]))
        after = np.zeros((len(t), self.c.shape[2]))
        for k in range(DEGREE, 0, -1):  # Clenshaw's recursion
            value, after = self.c[piece, k] + 2.0 * s * value - after, value
        return np.asarray(self.c[piece, 0] + s * value - after)

    def _flat(self) -> tuple[Array, Array, Indices]:
        """Return one row per function and piece: coefficients, length, and index of the function."""
        pieces, terms, m = self.c.shape
        c = self.c.transpose(0, 2, 1).reshape(pieces * m, terms)
        return c, np.repeat(self.length, m), np.tile(np.arange(m), pieces)


def _highest(c: Array, scale: float, *, flat_rtol: float = 1e-14) -> float:
    """Return the largest value of series (nk, DEGREE + 1), discarding those whose bound is below the value reached.

    Series that could exceed it only by rounding, relative to ``scale``, are discarded too.

    ``flat_rtol``: relative excess of a bound over the value reached below which a piece is discarded.
    """
    reached = -np.inf
    for _ in range(MAX_HALVINGS + 1):
        ends = np.concatenate([c.sum(axis=1), c @ SIGNS])
        reached = max(reached, float(ends.max(initial=-np.inf)))
        above = c[:, 0] + np.abs(c[:, 1:]).sum(axis=1) > reached + max(
            flat_rtol * abs(reached), np.finfo(float).eps * scale
        )
        c = np.concatenate([c[above] @ LEFT.T, c[above] @ RIGHT.T])
        check_pieces(len(c))
    return reached


def check_pieces(count: int) -> None:
    """Raise if there are more intervals than `MAX_PIECES`.

    Raises
    ------
    FailureError
        With the remedy.
    """
    if count > MAX_PIECES:
        raise FailureError(
            f"a norm would take more than {MAX_PIECES:,} intervals: the runs turn too often, or hold noise; take a shorter "
            "t_end, tighter tolerances, or name other norms",
            None,
        )


def corners(*runs: Trajectory) -> Array:
    """Return the ordered instants between which all runs are smooth, up to the earliest end."""
    first = max(run.t[0] for run in runs)
    last = min(run.t[-1] for run in runs)
    known = [run.t if run.dense is None else run.dense.cuts for run in runs]
    known += [np.array([event.t for event in run.events]) for run in runs if run.dense is not None]
    times = np.concatenate([*known, [first, last]])
    return np.unique(times[(times >= first) & (times <= last)])


def difference(run: Trajectory, truth: Trajectory, read: Reading, scale: float = 0.0) -> Series:
    """Return the difference of a quantity between a run and the reference as a series; ``scale`` as for `series`."""
    return series(corners(run, truth), lambda t: read(run, t), lambda t: read(truth, t), scale=scale)


def series(cuts: Array, *read: Callable[[Array], Array], scale: float = 0.0) -> Series:
    """Return the first of one or two functions of time, less the second, as a series between cuts.

    A piece on which the series does not end is halved until it does. What is summed from larger values, as a gap from
    coordinates, is told their size by ``scale``: to that its rounding is relative.
    """
    start = cuts[:-1]
    length = np.diff(cuts)
    before = np.full(len(cuts) - 1, np.inf)
    done: list[tuple[Array, Array, Array]] = []
    rounding = LAST_PLACES * np.finfo(float).eps * np.abs(cuts).max()
    for level in range(MAX_HALVINGS + 1):
        # Pieces as short as the spacing of floats hold no more than their ends.
        there = length > rounding
        start = start[there]
        length = length[there]
        before = before[there]
        times = (start[:, None] + 0.5 * length[:, None] * (1.0 + NODES[::-1])).ravel()
        values = [each(times) for each in read]
        scale = max([scale, *(float(np.abs(each).max(initial=0.0)) for each in values)])
        f = values[0] - values[1] if len(values) > 1 else values[0]
        f = f.reshape(len(start), DEGREE + 1, f.shape[1])[:, ::-1]
        c = np.einsum("kj,ijm->ikm", FIT, f)
        # An instant is known to a few units in its last place, and a function that is steep no better than that.
        steep = np.ptp(f, axis=1).max(axis=1, initial=0.0) / np.maximum(length, 1e-300)
        noise = SERIES_RTOL * scale + rounding * steep
        last = np.abs(c[:, -2:]).sum(axis=1).max(axis=1, initial=0.0)
        ends = (last <= noise) | ((last <= NOISE_RTOL * scale) & (last > 0.9 * before))
        if level == MAX_HALVINGS:
            ends[:] = True
        done.append((start[ends], length[ends], c[ends]))
        start = start[~ends]
        length = 0.5 * length[~ends]
        before = np.repeat(last[~ends], 2)
        start = np.stack([start, start + length], axis=1).ravel()
        length = np.repeat(length, 2)
        if len(start) == 0:
            break
        check_pieces(len(start) + sum(len(each) for each, _, _ in done))
    starts, lengths, coefficients = (np.concatenate(each) for each in zip(*done, strict=True))
    order = np.argsort(starts, kind="stable")
    return Series(starts[order], lengths[order], coefficients[order], scale)


def inertial(run: Trajectory) -> Flags:
    """Return the coordinates included in norms (n,): those with mass, or all if none has, as in a system given directly."""
    massive = run.problem.dynamics.massive
    return massive if massive.any() else ~massive


@lru_cache(maxsize=16)
def _known(run: Trajectory, what: str) -> Series:
    """Return q or v of a continuous solution as a series, which is faster to evaluate."""
    return series(corners(run), lambda t: getattr(run.sample(t), what), scale=slow(run) if what == "v" else 0.0)


def slow(run: Trajectory) -> float:
    """Return the largest displacement of a run over its duration, a speed scale for the rounding error at rest."""
    return float(np.abs(run.q).max(initial=0.0)) / float(run.t[-1] - run.t[0] or 1.0)


def _read(run: Trajectory, what: str, t: Array) -> Array:
    if run.dense is not None:
        return _known(run, what)(t)
    return np.asarray(getattr(run.sample(t), what))


def _v(run: Trajectory, t: Array) -> Array:
    return _read(run, "v", t)[:, inertial(run)]


def _q(run: Trajectory, t: Array) -> Array:
    return _read(run, "q", t)[:, inertial(run)]


def _energy(run: Trajectory, t: Array) -> Array:
    return run.problem.dynamics.energy(_read(run, "q", t), _read(run, "v", t))[:, None]


@lru_cache(maxsize=1)
def _error_of_v(run: Trajectory, truth: Trajectory) -> Series:
    """Return v - v*, shared by several norms."""
    return difference(run, truth, _v, scale=slow(truth))


def sup_q(run: Trajectory, truth: Trajectory) -> float:
    r"""Return :math:`\sup_t \max_i |q_i - q_i^*|` in m, over the nodes with mass.

    Over all times if the method has a continuous solution, else on its grid: linear interpolation would limit the order
    to 2.

    Converges with the order of the method where only r changes, and with order 1 across impacts.
    """
    if run.dense is not None:
        return difference(run, truth, _q).sup()
    t = run.t[run.t <= truth.t[-1]]
    return float(np.abs(run.q[: len(t)] - truth.sample(t).q)[:, inertial(run)].max(initial=0.0))


def l1_v(run: Trajectory, truth: Trajectory) -> float:
    r"""Return :math:`\int_0^T \sum_i |v_i - v_i^*| \, dt` in m, over the nodes with mass.

    Converges with order 1 across impacts. In smooth motion linear interpolation on the grid limits it to order 2.
    """
    return float(_error_of_v(run, truth).l1().sum())


def l2_v(run: Trajectory, truth: Trajectory) -> float:
    r"""Return :math:`\bigl(\int_0^T \sum_i (v_i - v_i^*)^2 \, dt\bigr)^{1/2}` in m/s^(1/2), over the nodes with mass.

    Converges with order 1/2 across impacts: a jump J delayed by δ contributes J δ^(1/2).
    """
    return float(np.linalg.norm(_error_of_v(run, truth).l2()))


def sup_v(run: Trajectory, truth: Trajectory) -> float:
    r"""Return :math:`\sup_t \max_i |v_i - v_i^*|` in m/s, over the nodes with mass; for illustration.

    Does not converge across impacts: it tends to the largest jump whose instant is not exact.

    Parameters
    ----------
    run, truth : Trajectory
        The run, and the reference with the same coordinates.

    Examples
    --------
    >>> from lcpimpact import load_problem, simulate
    >>> ball = load_problem("bouncing-ball")
    >>> truth = simulate(ball, "exact", dt=1.0, t_end=2.0)
    >>> [sup_v(simulate(ball, dt=h, t_end=2.0), truth) > 5.0 for h in (1e-2, 1e-3)]
    [True, True]
    """
    return _error_of_v(run, truth).sup()


def hausdorff_v(run: Trajectory, truth: Trajectory) -> float:
    r"""Return the Hausdorff distance between the filled-in graphs of v and v*, the maximum over the nodes with mass.

    A graph is filled in where v jumps by the segment from v⁻ to v⁺. The distance of two points is
    :math:`\max(|Δt|/T, |Δv|/V)`, with the length T of the run and the largest speed V of the truth: a pure number.

    Converges with order 1 across impacts: an impact delayed by δ contributes δ/T for any jump. Each impact and each
    grazing counts separately, in contrast to an integral.
    """
    T = min(run.t[-1], truth.t[-1])
    V = float(np.abs(_v(truth, corners(truth))).max(initial=0.0)) or 1.0
    graphs = [_graphs(each, T, V) for each in (run, truth)]
    return max(_distance(*pair) for pair in zip(*graphs, strict=True))


Graph = Callable[[float], Array]
"""Function of a tolerance that returns a polyline (np, 2) within this distance of the graph."""


def _graphs(run: Trajectory, T: float, V: float) -> list[Graph]:
    """Return the filled-in graph of each speed, scaled by T and V."""
    cuts = corners(run)
    cuts = np.append(cuts[cuts < T], T)
    if run.dense is None:
        values = _v(run, cuts) / V
        return [lambda tolerance, y=y: np.column_stack([cuts / T, y]) for y in values.T]  # type: ignore[misc]
    found = series(cuts, lambda t: _v(run, t), scale=slow(run))
    return [
        lambda tolerance, c=c: polyline(found.start / T, found.length / T, c / V, tolerance)  # type: ignore[misc]
        for c in found.c.transpose(2, 0, 1)
    ]


def _distance(a: Graph, b: Graph, *, chord_rtol: float = 1e-9) -> float:
    """Return the distance of two graphs to a relative accuracy of 1e-3, the accuracy of the chords.

    ``chord_rtol``: minimum tolerance of chords, relative to the size of the graph.
    """
    tolerance = 1e-2
    while True:
        found = hausdorff(a(tolerance), b(tolerance))
        if tolerance <= max(0.5e-3 * found, chord_rtol):
            return found
        tolerance = max(0.25e-3 * found, chord_rtol)


def event_times(run: Trajectory, truth: Trajectory) -> float:
    r"""Return :math:`\max_k |t_k - t_k^*|` in s over the events, the k-th of a contact and kind with the k-th.

    NaN if the runs have different events, as after an accumulation of impacts, or if one run grazes. If a compliant law
    replaces a bumper of the reference, each of its closings counts as an impact.

    Converges with the order of q: 2 if only r switches, 1 across impacts.
    """
    return max((abs(a.t - b.t) for a, b in _pairs(run, truth)), default=_none(run, truth))


def impulses(run: Trajectory, truth: Trajectory) -> float:
    r"""Return :math:`\max_k |P_k - P_k^*|` in N s over the impacts, the k-th of a contact with the k-th.

    NaN if the runs have different events, or impacts of finite duration by a compliant law. Converges with order 1, like
    the speed before an impact.
    """
    if run.problem.dynamics.springs != truth.problem.dynamics.springs:
        return np.nan
    return max((abs(a.impulse - b.impulse) for a, b in _pairs(run, truth)), default=_none(run, truth))


def _pairs(run: Trajectory, truth: Trajectory) -> list[tuple[Event, Event]]:
    """Return the paired events of two runs, none if the runs have different events."""
    inertia = {each.name for each in truth.problem.dynamics.contacts if each.relative_degree == 2}
    inertia &= {each.name for each in run.problem.dynamics.springs}
    kinds = [_by_kind(each, inertia) for each in (run, truth)]
    if {key: len(each) for key, each in kinds[0].items()} != {key: len(each) for key, each in kinds[1].items()}:
        return []
    return [pair for key, each in kinds[0].items() for pair in zip(each, kinds[1][key], strict=True)]


def _by_kind(run: Trajectory, yielding: set[str]) -> dict[tuple[str, str], list[Event]]:
    """Return the events by contact and kind; closings of contacts compliant in one run count as impacts."""
    found: dict[tuple[str, str], list[Event]] = {}
    for event in run.events:
        kind = event.kind
        if event.contact in yielding:
            if kind == "open":
                continue
            kind = "impact"
        found.setdefault((event.contact, kind), []).append(event)
    return found


def _none(run: Trajectory, truth: Trajectory) -> float:
    return np.nan if run.events or truth.events else 0.0


def energy(run: Trajectory, truth: Trajectory) -> float:
    r"""Return :math:`\frac 1T \int_0^T |E - E^*| \, dt` in J, of the stored energy E, kinetic and elastic.

    Converges with order 1 across impacts; its sup, like that of v, does not, since E jumps. NaN for a system given
    directly, which has no energy.
    """
    if not (run.problem.dynamics.stores_energy and truth.problem.dynamics.stores_energy):
        return np.nan
    found = difference(run, truth, _energy)
    return float(found.l1()[0] / found.length.sum())


def penetration(run: Trajectory, truth: Trajectory) -> float:
    r"""Return :math:`\sup_t \max_i (-u_i)^+` in m, the largest penetration of the bumpers of the reference.

    Over all times or on the grid, as for q. A velocity-level method leaves O(h) after an impact.
    """
    rigid = truth.problem.dynamics
    if rigid.D.any() or not rigid.impenetrable.any():
        return run.certificate.penetration
    if run.dense is None:
        depth = -rigid.gap(run.t, run.q)
    else:
        moved = float(np.abs(run.q).max())
        depth = series(corners(run), lambda t: -rigid.gap(t, run.sample(t).q), scale=moved).highest()
    return float(max(0.0, depth[..., rigid.impenetrable].max()))


def complementarity(run: Trajectory, truth: Trajectory) -> float:
    """Return the largest complementarity product in J of the run, as defined by `Certificate.complementarity`.

    At rounding level for a method that solves an LCP in each step.
    """
    return run.certificate.complementarity


@dataclass(frozen=True)
class ErrorLabel:
    """The words of an error.

    Attributes
    ----------
    symbol : str            in TeX
    unit : str              "" for a dimensionless number
    what : str              description
    """

    symbol: str
    unit: str
    what: str

    def unit_in(self, problem: Problem) -> str:
        """Return its unit in a problem."""
        return problem.own_unit(self.unit)


@dataclass(frozen=True)
class Norm(ErrorLabel):
    """A measure of the error of a run.

    Attributes
    ----------
    symbol, unit, what : str
        As of `ErrorLabel`.
    order : str             declared order that applies to it: "q", "v" or "" for none
    measure : callable      function of the run and the reference that returns a number
    """

    order: str
    measure: Callable[[Trajectory, Trajectory], float]

    def unit_in(self, problem: Problem) -> str:
        """Return its unit in a problem: of coordinates and velocities that of its nodes."""
        return problem.own_unit(self.unit, problem.dynamics.nodes if self.measure in (sup_q, l1_v, l2_v) else ())


NORMS = {
    "sup_q": Norm(r"\sup\,|q - q^{\ast}|", "m", "greatest error of the coordinates", "q", sup_q),
    "l1_v": Norm(r"\int |v - v^{\ast}| \, dt", "m", "integral of the error of the velocities", "v", l1_v),
    "l2_v": Norm(r"\|v - v^{\ast}\|_{L^2}", "m/s^(1/2)", "root of the integral of its square", "", l2_v),
    "hausdorff_v": Norm(
        r"d_H(v, v^{\ast})", "", "distance of the filled-in graphs of the velocities", "v", hausdorff_v
    ),
    "event_times": Norm(r"\max\,|t_k - t_k^{\ast}|", "s", "greatest error of the instants of events", "", event_times),
    "impulses": Norm(r"\max\,|P_k - P_k^{\ast}|", "N s", "greatest error of the impulses", "", impulses),
    "energy": Norm(r"\overline{|E - E^{\ast}|}", "J", "mean error of the stored energy", "", energy),
    "penetration": Norm(r"\max\,(-u)^+", "m", "largest penetration", "", penetration),
    "complementarity": Norm(r"\max\,|r\,u|", "J", "largest product of the laws", "", complementarity),
}


@checked
def error_norms(run: Trajectory, truth: Trajectory, norms: Sequence[str] | None = None) -> dict[str, float]:
    """Return the errors of a run in all norms or the named ones.

    Parameters
    ----------
    run : Trajectory
        The run; one that ended early is judged up to its end.
    truth : Trajectory
        The reference with the same coordinates, preferably with a continuous solution.
    norms : sequence of str, optional
        Names of `NORMS`.

    Raises
    ------
    InputError
        For an unknown norm, or runs with different coordinates.

    Examples
    --------
    >>> from lcpimpact import load_problem, simulate
    >>> ball = load_problem("bouncing-ball")
    >>> truth = simulate(ball, "exact", dt=1.0, t_end=2.0)
    >>> found = error_norms(simulate(ball, dt=1e-3, t_end=2.0), truth, ["sup_q", "hausdorff_v"])
    >>> {name: float(f"{value:.1g}") for name, value in found.items()}
    {'sup_q': 0.008, 'hausdorff_v': 0.005}
    """
    for name in NORMS if norms is None else norms:
        if name not in NORMS:
            raise InputError(nearest(str(name), list(NORMS), "norm"))
    if run.problem.dynamics.nodes != truth.problem.dynamics.nodes:
        raise InputError(
            f"{run.problem.name!r} and {truth.problem.name!r} do not have the same coordinates: compare runs of one problem"
        )
    return {name: NORMS[name].measure(run, truth) for name in (NORMS if norms is None else norms)}
