r"""Mode choice by LCPs on the one-sided derivatives, at the start of a motion and after every event.

The first LCP is 0 <= r ⟂ O X + G r >= 0 on the rows that touch (see `lcpimpact.hybrid.system`). For the rows that it leaves
undecided (both sides zero: grazing, and every switch that is not a jump), the next one asks the same of the next derivatives
of r and u, until each is decided. In small systems of contacts only `lcpimpact.hybrid.contacts` solves them.

For sliders and relays the LCPs are the same, within bounds: r_min <= r <= r_max at first, and for the derivatives r' >= 0
where r = r_min, r' <= 0 where r = r_max. Contacts without a common relative degree choose by
`lcpimpact.hybrid.mixed_degrees`.

Friction that a normal force bounds has two unknowns, and the LCP of all derivatives has its rows (see
`lcpimpact.hybrid.system.Laws`). Where it slips its force is -μ r_N sign U, a combination of reactions.

Static friction above the kinetic one holds at first where U = 0, with |r| <= μ_s r_N. What breaks loose so slides with μ,
and the choice is made again with it, until nothing more does.

With relays and friction the matrix of an LCP need not be a P-matrix, and then all its solutions are followed (see
`lcpimpact.all_solutions`). What the next derivatives contradict is dropped; if more than one motion is left, the choice is
refused.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array, Flags, IndexMatrix, Indices, Stack
from lcpimpact.compiled import compiled
from lcpimpact.errors import FailureError
from lcpimpact.hybrid.complementarity import complementary
from lcpimpact.hybrid.contacts import choose
from lcpimpact.hybrid.gaps import openings_and_rates, project, still
from lcpimpact.hybrid.mixed_degrees import exchanged_mode
from lcpimpact.hybrid.system import FINE_ZERO, ZERO, Mode, Still, System, contact_mode, round_to_zero, solve_regular
from lcpimpact.lcp.operators import Dense, Property
from lcpimpact.lcp.solve import solve_lcp
from lcpimpact.lcp.solvers.enumeration import SOLVER, all_solutions
from lcpimpact.numerics.double_double import DoubleDouble, stacked
from lcpimpact.scheme.decomposition import is_singular

SAME_RTOL = 1e-9
"""Difference of two derivatives of the state, relative to their terms, below which they are the same."""


class ModeLCP(NamedTuple):
    """The LCP of a mode: lower <= z <= upper complementary to M z + q."""

    M: DoubleDouble
    q: DoubleDouble
    lower: Array
    upper: Array


class Ambiguous(Exception):
    """Several motions obey the laws from here on; ``lcp`` is the LCP with several solutions."""

    def __init__(self, lcp: ModeLCP) -> None:
        super().__init__("several motions obey the laws")
        self.lcp = lcp


class TooManyRows(Exception):
    """The LCP of a mode may have several solutions and has too many rows to be searched for all of them."""


@compiled()
def motions(opening: Stack, degree: Indices, of_rate: Flags, switches: Flags) -> IndexMatrix:
    """Return whether a force is unknown in each row, the signs of rates and openings, and the order of the zero (3, nc).

    A force is unknown in rows of degree 0, at closed contacts that do not open, at sliders that do not slip, and at relays
    whose u is zero with all derivatives below the degree. The sign is that of U of slipping sliders and of u of relays that
    leave zero. ``opening`` holds u, U and the derivatives up to the largest degree.
    """
    found = np.zeros((3, len(degree)), np.int64)
    for i in range(len(degree)):
        if switches[i]:
            k = 0
            while k < degree[i] and opening[k, 0, i] == 0.0:
                k += 1
            found[0, i] = k == degree[i]
            found[1, i] = 0 if k == degree[i] else int(np.sign(opening[k, 0, i]))
            found[2, i] = k
            continue
        u = opening[0, 0, i]
        U = opening[1, 0, i] if degree[i] == 2 else 0.0
        moves = of_rate[i] and U != 0.0
        opens = not of_rate[i] and degree[i] > 0 and (u > 0.0 or U > 0.0)
        found[0, i] = not (moves or opens)
        found[1, i] = int(np.sign(U)) if moves else 0
        found[2, i] = 0 if u > 0.0 or moves else 1
    return found


@dataclass(eq=False)
class Choice:
    """The mode as far as the derivatives have decided it: see `Mode`, and the rows still ``undecided``."""

    undecided: list[int]
    slips: list[tuple[int, int]]
    order: list[int]
    side: list[int]
    closed: list[int] = field(default_factory=list)
    friction: tuple[tuple[int, int], ...] = ()
    """The rows with friction, and those of their normal forces."""
    rank: tuple[int, ...] = ()
    """Ranks of the rows, those of `lcpimpact.hybrid.system.Laws`."""
    tied: list[int] = field(default_factory=list)
    """Unknowns of friction at its bound that cannot slip since other rows stick."""

    def copy(self) -> Choice:
        """Return a copy to decide upon."""
        undecided = list(self.undecided)
        slips = list(self.slips)
        order = list(self.order)
        side = list(self.side)
        return Choice(undecided, slips, order, side, list(self.closed), self.friction, self.rank, list(self.tied))

    @property
    def mode(self) -> Mode:
        """The mode, with undecided rows as they are where all derivatives are zero."""
        nc = len(self.order) - len(self.friction)
        order = list(self.order)
        slips = list(self.slips)
        closed = set(self.closed)
        other = [0] * nc
        for i in self.undecided:
            order[i] = -1
            if self.side[i]:
                slips.append((i, -self.side[i]))
        for k, (i, normal) in enumerate(self.friction):
            # The unknowns of friction: μ r_N + r_T, and the negative part of the slip acceleration beside μ r_N - r_T.
            last = nc + k
            for_ever = not {i, nc + k}.isdisjoint([*self.undecided, *self.tied])
            sticks = i in closed and last not in closed and not for_ever
            if normal not in closed:
                slips, order[i] = [each for each in slips if each[0] != i], 0
            elif i in dict(slips):
                order[i] = 0
            elif sticks:
                order[i], other[i] = order[last], order[i]
            else:
                slips.append((i, -1 if i in closed else 1))
                order[i] = -1 if for_ever else self.rank[i] + order[last] if i in closed else order[i]
            if not sticks:
                closed.discard(i)
        held = tuple(sorted(i for i in closed if i < nc))
        return Mode(held, tuple(sorted(slips)), tuple(order[:nc]), tuple(self.side[:nc]), tuple(other))


class Derivative(NamedTuple):
    """One derivative of the motion.

    Attributes
    ----------
    level : int             which one, 0 for X and r themselves
    X : DoubleDouble        that of the state (N,)
    r : DoubleDouble        that of the forces of rows at a bound (nc,)
    scale : (N,) array      largest |X| of the run so far, likewise
    """

    level: int
    X: DoubleDouble
    r: DoubleDouble
    scale: Array


class DerivativeSolution(NamedTuple):
    """Solution of the LCP of one derivative on undecided rows.

    Attributes
    ----------
    r : DoubleDouble        the forces of all rows (nc,)
    z, w : DoubleDouble     forces of the undecided rows, and what is complementary to them (k,)
    tiny : (k,) array       tolerance for zero in w
    """

    r: DoubleDouble
    z: DoubleDouble
    w: DoubleDouble
    tiny: Array


def choose_mode(
    system: System,
    X: ArrayLike | DoubleDouble,
    scale: Array,
    solver: str,
    held: Still | None = None,
    zero: float = ZERO,
) -> tuple[Mode, DoubleDouble]:
    """Return the next mode from X, by LCPs on the one-sided derivatives, and X.

    X differs only in the positions of sliders of degree 0, which have slipped, or begin beyond their threshold.

    Raises
    ------
    Ambiguous
        If relays or friction leave several motions possible.
    TooManyRows
        If that cannot be found out.

    Parameters
    ----------
    system : System
    X : (N,) array or DoubleDouble
    scale : (N,) array          largest |X| of the run so far
    solver : str                name of an LCP solver
    held : Still, optional      exact zeros
    zero : float                tolerance for zero, relative to the terms of a sum
    """
    start, held = DoubleDouble.of(X), held or still(system, None)
    if solver == "auto" and system.plant is not None:
        state = np.ascontiguousarray(start.parts)
        closed, orders, determined = choose(system.plant, state, scale, held.u, held.U, zero)
        if determined:
            return contact_mode(closed, orders), start
    if system.mixed:
        return exchanged_mode(system, start, scale, held, zero)
    rows = np.flatnonzero(system.dynamics.mu_s > system.dynamics.mu).tolist()
    if not rows:
        return _choose(system, start, scale, solver, held, zero, {})
    U = openings_and_rates(system, start, scale, held, zero)[1, 0]
    moving = {i: int(np.sign(U[i])) for i in rows if U[i] != 0.0}
    slides = dict(moving)
    while True:
        holds = tuple(i for i in rows if i not in slides)
        mode, after = _choose(system.with_static_friction(holds), start, scale, solver, held, zero, slides)
        loose = {i: sign for i, sign in mode.slips if i in holds and mode.order[i] >= 0}
        if not loose:
            break
        slides |= loose
    mode = _with_static_orders(system, mode, after, scale, zero, (holds, [i for i in slides if i not in moving]))
    # Whether it sticks is read from the slip, also where a run is continued.
    still_rows = np.flatnonzero(held.U & ~system.dynamics.of_rate).tolist() + [i for i in holds if i in mode.closed]
    return mode, project(system, system.fine.CA[still_rows], after, scale)


def _with_static_orders(
    system: System, mode: Mode, X: DoubleDouble, scale: Array, zero: float, rows: tuple[tuple[int, ...], list[int]]
) -> Mode:
    """Return the mode in which the first of ``rows`` stick at their bound for all times, and the second slip.

    Friction that breaks loose falls to its kinetic bound, and its slip begins with another order than its force had.
    """
    holds, loose = rows
    order, other = list(mode.order), list(mode.other_order)
    at_bound = {i: sign for i, sign in mode.slips if i in holds}
    for i, sign in at_bound.items():
        order[i], other[i] = (-1, 0) if sign < 0 else (0, -1)
    closed = tuple(sorted((*mode.closed, *at_bound)))
    slips = tuple(each for each in mode.slips if each[0] not in at_bound)
    found = Mode(closed, slips, tuple(order), mode.side, tuple(other))
    contacts, _, ends = system.ends(found)
    generator = system.mode(found)[0].generator
    for i in (each for each in loose if each in dict(slips)):
        level = ends[np.flatnonzero(contacts == i)]
        order[i] = -1
        for k in range(1, len(scale) + 1):
            level = level @ generator
            if abs(float((level @ X).hi[0])) > zero * float(np.abs(level.hi[0]) @ scale):
                order[i] = k
                break
    return replace(found, order=tuple(order))


def _choose(
    system: System, start: DoubleDouble, scale: Array, solver: str, held: Still, zero: float, slides: dict[int, int]
) -> tuple[Mode, DoubleDouble]:
    """Return the next mode from a state, and the state, with friction that ``slides`` from U = 0 on to a known side."""
    nc = len(system.degree)
    low, high = system.bounds
    opening = openings_and_rates(system, start, scale, held, zero)
    if system.dynamics.switches.any():
        opening = _with_higher_derivatives(system, opening, start, scale, held, zero)
    unknown, sign, order = motions(opening, system.degree, system.dynamics.of_rate, system.dynamics.switches).tolist()
    for i, direction in slides.items():
        sign[i] = direction
    choice = _first_choice(system, unknown, sign, order)
    signs = dict(choice.slips)
    at_bound = DoubleDouble.of(
        [0.0 if i in system.friction else (high[i], 0.0, low[i])[signs.get(i, 0) + 1] for i in range(nc)]
    )
    found, lcp = _continuations(system, choice, start, Derivative(0, start, at_bound, scale), solver, zero)
    if lcp and any(not _same_motion(system, found[0], other, scale) for other in found[1:]):
        raise Ambiguous(lcp)
    return found[0]


def _first_choice(system: System, unknown: list[int], sign: list[int], order: list[int]) -> Choice:
    """Return the mode as far as openings and rates decide it (see `motions`): joints are closed, and rows that slip too."""
    d = system.dynamics
    nc = len(sign)
    closed = list(map(int, np.flatnonzero(d.bilateral)))
    friction = tuple((i, int(d.normals[i])) for i in system.friction)
    undecided = [i for i in range(nc) if unknown[i] and not d.bilateral[i] and not d.tangential[i]]
    slips = [(i, sign[i]) for i in range(nc) if sign[i] and not d.tangential[i]]
    for k, (i, normal) in enumerate(friction):
        if normal in undecided:
            if sign[i] == 0:
                undecided += [i, nc + k]
            elif sign[i] < 0:
                closed += [i, nc + k]
            slips += [(i, sign[i])] if sign[i] else []
    more = [0] * len(friction)
    return Choice(undecided, slips, order + more, [0] * nc + more, closed, friction, tuple(map(int, system.laws.rank)))


def _with_higher_derivatives(
    system: System, opening: Array, X: DoubleDouble, scale: Array, held: Still, zero: float
) -> Array:
    """Return u, U and the derivatives of u below the largest degree (k, 2, nc), with rounding set to zero."""
    level, found = system.fine.CA, list(opening)
    for _ in range(2, system.degree.max()):
        level = level @ system.fine.A
        value = round_to_zero(level @ X, np.abs(level.hi) @ scale, zero)
        value.parts[:, held.U] = 0.0
        found.append(value.parts)
    return np.ascontiguousarray(found)


def _continuations(
    system: System, choice: Choice, start: DoubleDouble, at: Derivative, solver: str, zero: float
) -> tuple[list[tuple[Mode, DoubleDouble]], ModeLCP | None]:
    """Return all modes that no derivative contradicts, with the state, and the first LCP with several solutions."""
    A = system.fine.A
    B = system.fine.B
    lcp = None
    failure = None
    pending, found = [(choice, start, at)], []
    while pending:
        choice, start, at = pending.pop()
        if not choice.undecided or at.level > len(start):
            found.append((choice.mode, start))
            continue
        try:
            solve = _solve_with_relays if system.dynamics.switches.any() else _solve_derivative
            answers, problem = solve(system, choice, at, solver, zero)
            lcp = lcp or (problem if len(answers) > 1 else None)
        except FailureError as none:
            failure = none
            continue
        for answer in answers:
            branch = choice.copy()
            begun = start
            state = at.X
            for i, move in _decide(system, branch, at.level, answer):
                begun = system.put(begun, i, move)
                state = system.put(state, i, move)
            size = np.abs(A.hi) @ at.scale + np.abs(B.hi) @ np.abs(answer.r.hi)
            constant = DoubleDouble.of(np.zeros(len(system.degree)))
            pending.append((branch, begun, Derivative(at.level + 1, A @ state + B @ answer.r, constant, size)))
    if not found and failure:
        raise failure
    return found, lcp


def _same_motion(
    system: System, one: tuple[Mode, DoubleDouble], other: tuple[Mode, DoubleDouble], scale: Array
) -> bool:
    """Return whether two modes move a state by the same derivatives, though their forces may differ."""
    flow, F = system.reaction(one[0])
    flow_, F_ = system.reaction(other[0])
    A, B, _ = system.matrices
    terms = np.abs(A) + np.abs(B) @ np.maximum(np.abs(F.hi), np.abs(F_.hi))
    states, sizes = [one[1].hi, other[1].hi], scale
    for _ in scale:
        states = [flow.generator.hi @ states[0], flow_.generator.hi @ states[1]]
        sizes = terms @ sizes
        if (np.abs(states[1] - states[0]) > SAME_RTOL * sizes).any():
            return False
    return True


def _solve_derivative(
    system: System, choice: Choice, at: Derivative, solver: str, zero: float
) -> tuple[list[DerivativeSolution], ModeLCP]:
    """Return the solution of the LCP of one derivative, and that LCP: on closed rows the derivative of u is zero.

    With friction all solutions are returned.

    Raises
    ------
    FailureError
        If it has no solution.
    """
    G = system.laws.G
    c = choice.closed
    m = choice.undecided
    g, terms = _free_motion(system, at)
    q = g[m]
    W = _block(G, m, m)
    summed = terms[m]
    if c:
        eliminated = solve_regular(_block(G, c, c), stacked([[g[c][:, None], _block(G, c, m)]]))
        q = q - _block(G, m, c) @ eliminated[:, 0]
        W = W - _block(G, m, c) @ eliminated[:, 1:]
        summed = summed + np.abs(_block(G, m, c).hi) @ np.abs(eliminated.hi[:, 0])
    q = round_to_zero(q, summed, zero)
    lower, upper = _bounds(system, m, choice.side, at.level)
    lcp = ModeLCP(W, q, lower, upper)

    def answer(guess: Array, rounding: float = zero) -> DerivativeSolution:
        """Return the solution in double-doubles, and the forces of all rows."""
        tiny = zero * summed + rounding * (np.abs(W.hi) @ np.abs(guess))
        z, w = complementary(W, q, guess, lower, upper, tiny)
        y = np.zeros((2, len(G)))
        y[:, m] = z.parts
        if c:
            y[:, c] = (-eliminated[:, 0] - eliminated[:, 1:] @ z).parts
        force = DoubleDouble.of(system.laws.T) @ DoubleDouble(y) if system.friction else DoubleDouble(y)
        return DerivativeSolution(at.r + force, z, w, tiny)

    if not system.friction:
        floats = solve_lcp(W.hi, q.hi, solver, lower=lower, upper=upper, throw=False)
        try:
            # Where floats have too few digits, double-doubles decide, to their own rounding.
            return [answer(floats.z, zero if floats.success else FINE_ZERO)], lcp
        except np.linalg.LinAlgError:
            if floats.success:
                raise
            raise FailureError(floats.message, floats) from None
    answers, failure = list[DerivativeSolution](), None
    for guess in basic_solutions(lcp, solver):
        try:
            answers.append(answer(guess))
        except np.linalg.LinAlgError as singular:
            # A solution in floats whose basis is degenerate; another one may be the same motion.
            failure = singular
    if not answers and failure:
        raise failure
    return _distinct(system, answers), lcp


def _distinct(system: System, answers: list[DerivativeSolution]) -> list[DerivativeSolution]:
    """Return the answers that differ in their motion: redundant contacts can have the same sum of forces in many ways."""
    B, found = system.matrices[1], list[DerivativeSolution]()
    for each in answers:
        size = SAME_RTOL * (np.abs(B) @ np.abs(each.r.hi))
        if all((np.abs(B @ (each.r.hi - other.r.hi)) > size).any() for other in found):
            found.append(each)
    return found


def _solve_with_relays(
    system: System, choice: Choice, at: Derivative, solver: str, zero: float
) -> tuple[list[DerivativeSolution], ModeLCP]:
    """Return all solutions of the LCP of one derivative, and that LCP, on the closed and the undecided rows.

    Closed rows stay in it, without bounds: what keeps a relay on its surface may be the force of an undecided row.

    Raises
    ------
    FailureError
        If it has no solution.
    """
    c, m = choice.closed, choice.undecided
    rows = [*c, *m]
    infinite = np.full(len(c), np.inf)
    undecided = slice(len(c), None)
    g, terms = _free_motion(system, at)
    lower, upper = _bounds(system, m, choice.side, at.level)
    q = round_to_zero(g[rows], terms[rows], zero)
    lcp = ModeLCP(_block(system.fine.G, rows, rows), q, np.append(-infinite, lower), np.append(infinite, upper))
    answers = []
    for guess in basic_solutions(lcp, solver):
        tiny = zero * (terms[rows] + np.abs(lcp.M.hi) @ np.abs(guess))
        z, w = complementary(*lcp[:2], guess, *lcp[2:], tiny)
        force = at.r.parts.copy()
        force[:, rows] = z.parts
        answers.append(DerivativeSolution(DoubleDouble(force), z[undecided], w[undecided], tiny[undecided]))
    return answers, lcp


def _free_motion(system: System, at: Derivative) -> tuple[DoubleDouble, Array]:
    """Return O X + G r of one derivative, with the known forces, and the sizes of its terms (m,)."""
    laws = system.laws
    terms = np.abs(system.fine.O.hi) @ at.scale + np.abs(system.G) @ np.abs(at.r.hi)
    return laws.O @ at.X + laws.by_force @ at.r, laws.weights @ terms


def basic_solutions(lcp: ModeLCP, solver: str, *, max_bases: int = 2**15) -> list[Array]:
    """Return the solution of an LCP, or all basic ones where there may be several.

    ``max_bases``: maximum number of complementary bases of an LCP that is searched for all solutions, 0.5 s: of
    five rough contacts.
    """
    M = lcp.M.hi
    q = lcp.q.hi
    lower, upper = lcp[2:]
    if Dense(M).has(Property.P):
        return [solve_lcp(M, q, solver, lower=lower, upper=upper).z]
    if np.prod(1.0 + np.isfinite(lower) + np.isfinite(upper)) > max_bases:
        raise TooManyRows
    found = all_solutions(M, q, lower=lower, upper=upper)
    return found or [solve_lcp(M, q, SOLVER.name, lower=lower, upper=upper).z]


def _decide(system: System, choice: Choice, level: int, answer: DerivativeSolution) -> list[tuple[int, DoubleDouble]]:
    """Decide the rows whose force or opening is not zero; return the sliders of degree 0 that slip, and how far."""
    G = system.laws.G.hi
    rank = system.laws.rank
    r_min, r_max = system.bounds
    boxed = _have_bounds(system)
    undecided, moved = choice.undecided, []
    choice.undecided = []
    for k, i in enumerate(undecided):
        unit = abs(G[i, i]) or np.abs(G[:, i]).max()
        z = float(answer.z.hi[k])
        w = float(answer.w.hi[k])
        at_threshold = boxed[i] and level == 0
        room = min(z - r_min[i], r_max[i] - z) if at_threshold else abs(z)
        if room * unit > answer.tiny[k]:
            choice.closed.append(i)
            choice.order[i] = level
            continue
        if at_threshold:
            choice.side[i] = 1 if r_max[i] - z < z - r_min[i] else -1
            if rank[i] < 0:
                moved.append((i, answer.w[k]))
                w = 0.0
        if abs(w) > answer.tiny[k]:
            choice.order[i] = int(rank[i]) + level
            if boxed[i]:
                choice.slips.append((i, -choice.side[i]))
        else:
            choice.undecided.append(i)
    for k, (i, normal) in enumerate(choice.friction):
        last = len(system.degree) + k
        if normal not in choice.closed and normal not in choice.undecided:
            # An open contact has no friction.
            choice.undecided, choice.closed = (
                [each for each in rows if each not in (i, last)] for rows in (choice.undecided, choice.closed)
            )
        elif last in choice.closed and i in choice.undecided:
            choice.undecided.remove(i)
            choice.closed.append(i)
        elif i in choice.closed and last in choice.undecided and is_singular(G[np.ix_(choice.closed, choice.closed)]):
            # Redundant contacts: this one stays at its bound while others hold it.
            choice.undecided.remove(last)
            choice.closed.append(last)
            choice.tied.append(last)
    return moved


def _have_bounds(system: System) -> Flags:
    """Return the flags of the unknowns that come to bounds of their own, as of sliders and relays (m,)."""
    d, boxed = system.dynamics, np.zeros(len(system.laws.rank), dtype=np.bool_)
    boxed[: len(system.degree)] = ~(d.impenetrable | d.bilateral | d.tangential)
    return boxed


def _block(G: DoubleDouble, rows: list[int], columns: list[int]) -> DoubleDouble:
    """Return the entries of some rows and columns."""
    return G[np.ix_(rows, columns)]


def _bounds(system: System, rows: list[int], side: list[int], level: int) -> tuple[Array, Array]:
    """Return the bounds of r, and for a higher level those of its derivative, for rows that are undecided."""
    if level == 0:
        return system.laws.lower[rows], system.laws.upper[rows]
    high = _have_bounds(system)[rows] & (np.array([side[i] for i in rows]) > 0)
    return np.where(high, -np.inf, 0.0), np.where(high, 0.0, np.inf)
