r"""Mode choice by LCPs on the one-sided derivatives, at the start of a motion and after every event.

The first LCP is 0 <= r ⟂ O X + G r >= 0 on the rows that touch (see `lcpimpact.hybrid.system`). For the rows that it leaves
undecided (both sides zero: grazing, and every switch that is not a jump), the next one asks the same of the next derivatives
of r and u, until each is decided.

For sliders the LCPs are the same, within bounds: -r_0 <= r <= r_0 at first, and for the derivatives r' >= 0 where r = -r_0,
r' <= 0 where r = r_0. Contacts without a common relative degree choose by `lcpimpact.hybrid.mixed_degrees`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numba import types
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array, Flags, Indices
from lcpimpact.compiled import compiled, cube, flags, indices
from lcpimpact.double_double import DoubleDouble, stacked
from lcpimpact.hybrid.complementarity import complementary
from lcpimpact.hybrid.gaps import openings_and_rates, still
from lcpimpact.hybrid.mixed_degrees import exchanged_mode
from lcpimpact.hybrid.system import ZERO, Mode, Still, System, round_to_zero, solve_regular
from lcpimpact.lcp.solve import solve_lcp


@compiled(types.int64[:, ::1](cube, indices, flags))
def motions(opening: Array, degree: Indices, slides: Flags) -> Indices:
    """Return whether a force is unknown in each row, the sign of U of slipping sliders, and the order of the zero (3, nc).

    A force is unknown in rows of degree 0, at closed contacts that do not open, and at sliders that do not slip. ``opening``
    holds u and U.
    """
    found = np.zeros((3, len(degree)), np.int64)
    for i in range(len(degree)):
        u, U = opening[0, 0, i], opening[1, 0, i] if degree[i] == 2 else 0.0
        moves = slides[i] and U != 0.0
        opens = not slides[i] and degree[i] > 0 and (u > 0.0 or U > 0.0)
        found[0, i] = not (moves or opens)
        found[1, i] = np.sign(U) if moves else 0
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

    @property
    def mode(self) -> Mode:
        """The mode, with undecided rows as they are where all derivatives are zero."""
        order, slips = list(self.order), list(self.slips)
        for i in self.undecided:
            order[i] = -1
            if self.side[i]:
                slips.append((i, -self.side[i]))
        return Mode(tuple(sorted(self.closed)), tuple(sorted(slips)), tuple(order), tuple(self.side))


class Derivative(NamedTuple):
    """One derivative of the motion.

    Attributes
    ----------
    level : int             which one, 0 for X and r themselves
    X : DoubleDouble        that of the state (N,)
    r : DoubleDouble        that of the forces of sliders that slip (nc,)
    scale : (N,) array      largest |X| of the run so far, likewise
    """

    level: int
    X: DoubleDouble
    r: DoubleDouble
    scale: Array


class Answer(NamedTuple):
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
    if system.mixed:
        return exchanged_mode(system, start, scale, held, zero)
    (A, B, *_), nc = system.fine, len(system.degree)
    opening = openings_and_rates(system, start, scale, held, zero)
    sought, sign, order = motions(opening, system.degree, system.slides).tolist()
    choice = Choice([i for i in range(nc) if sought[i]], [(i, sign[i]) for i in range(nc) if sign[i]], order, [0] * nc)
    slipping = DoubleDouble.of(-np.array(sign) * np.where(system.slides, system.bounds[1], 0.0))
    at = Derivative(0, start, slipping, scale)
    while choice.undecided and at.level <= len(start):
        answer = _solve_derivative(system, choice, at, solver, zero)
        state = at.X
        for i, move in _decide(system, choice, at.level, answer):
            start, state = system.put(start, i, move), system.put(state, i, move)
        size = np.abs(A.hi) @ at.scale + np.abs(B.hi) @ np.abs(answer.r.hi)
        at = Derivative(at.level + 1, A @ state + B @ answer.r, DoubleDouble.of(np.zeros(nc)), size)
    return choice.mode, start


def _solve_derivative(system: System, choice: Choice, at: Derivative, solver: str, zero: float) -> Answer:
    """Solve the LCP of one derivative: on closed rows that of u is zero, which gives theirs of r."""
    O, G, c, m = system.fine.O, system.fine.G, choice.closed, choice.undecided  # noqa: E741
    g, terms = O @ at.X + G @ at.r, np.abs(O.hi) @ at.scale + np.abs(G.hi) @ np.abs(at.r.hi)
    q, W, summed = g[m], _block(G, m, m), terms[m]
    if c:
        eliminated = solve_regular(_block(G, c, c), stacked([[g[c][:, None], _block(G, c, m)]]))
        q = q - _block(G, m, c) @ eliminated[:, 0]
        W = W - _block(G, m, c) @ eliminated[:, 1:]
        summed = summed + np.abs(_block(G, m, c).hi) @ np.abs(eliminated.hi[:, 0])
    q = round_to_zero(q, summed, zero)
    lower, upper = _bounds(system, m, choice.side, at.level)
    guess = solve_lcp(W.hi, q.hi, solver, lower=lower, upper=upper).z
    tiny = zero * (summed + np.abs(W.hi) @ np.abs(guess))
    z, w = complementary(W, q, guess, lower, upper, tiny)
    force = at.r.parts.copy()
    force[:, m] = z.parts
    if c:
        force[:, c] = (-eliminated[:, 0] - eliminated[:, 1:] @ z).parts
    return Answer(DoubleDouble(force), z, w, tiny)


def _decide(system: System, choice: Choice, level: int, answer: Answer) -> list[tuple[int, DoubleDouble]]:
    """Decide the rows whose force or opening is not zero; return the sliders of degree 0 that slip, and how far."""
    G, degree, slides, r_max = system.G, system.degree, system.slides, system.bounds[1]
    undecided, moved = choice.undecided, []
    choice.undecided = []
    for k, i in enumerate(undecided):
        unit, z, w = abs(G[i, i]) or np.abs(G[:, i]).max(), float(answer.z.hi[k]), float(answer.w.hi[k])
        at_threshold = slides[i] and level == 0
        room = min(z + r_max[i], r_max[i] - z) if at_threshold else abs(z)
        if room * unit > answer.tiny[k]:
            choice.closed.append(i)
            choice.order[i] = level
            continue
        if at_threshold:
            choice.side[i] = 1 if z > 0.0 else -1
            if degree[i] == 0:
                moved.append((i, answer.w[k]))
                w = 0.0
        if abs(w) > answer.tiny[k]:
            choice.order[i] = int(degree[i]) + level - int(slides[i])
            if slides[i]:
                choice.slips.append((i, -choice.side[i]))
        else:
            choice.undecided.append(i)
    return moved


def _block(G: DoubleDouble, rows: list[int], columns: list[int]) -> DoubleDouble:
    """Return the entries of some rows and columns."""
    return G[np.ix_(rows, columns)]


def _bounds(system: System, rows: list[int], side: list[int], level: int) -> tuple[Array, Array]:
    """Return the bounds of r, and for a higher level those of its derivative, for rows that are undecided."""
    slides = system.slides[rows]
    if level == 0:
        return system.bounds[0][rows], system.bounds[1][rows]
    at = np.array([side[i] for i in rows])
    return np.where(slides & (at > 0), -np.inf, 0.0), np.where(slides & (at > 0), 0.0, np.inf)
