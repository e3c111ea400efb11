r"""Impacts of several contacts by laws other than Newton's, without friction.

With the mobility G of the closed contacts, their rates U⁻ before the impact and U⁺ = U⁻ + G P after it, P >= 0:

*Sequential*: impacts of one contact each, P_i = -(1 + e_i) U_i/G_ii, that of the largest approach rate -U_i first, until
none approaches. Contacts of equal rates, to rounding, have theirs at once by Newton's law, so that what is symmetric stays
so. An infinite sequence tends to a limit; once the rates are rounding of the first one, impacts with e = 0 end it. One that
is longer than its limit raises `EndlessImpact`.

*Poisson*: compression to the end of all approach, then expansion, which returns the fraction e_i of each impulse or more,

.. math:: 0 \le P_c \perp U_c = U^- + G P_c \ge 0, \qquad
          0 \le P_e - E P_c \perp U^+ = U_c + G P_e \ge 0, \qquad P = P_c + P_e .

Both problems have a solution, and with e_i <= 1 none gains energy. Where contacts are redundant G leaves the shares of P_c
open, and with different e_i also v⁺: those of the LCP solver are taken.

*LZB* (see `lcpimpact.LZB`), with the deflections x_i = ((η + 1) E_i/k_i)^(1/(η + 1)) of the springs in the place of their
energies, and with the time s of the impact, in which dP_i = k_i x_i^η ds, in the place of the impulse of one contact:

.. math:: \frac{dx_i}{ds} = -U_i \times \begin{cases} 1 & U_i < 0 \\ 1/e_i^2 & U_i > 0 \end{cases}, \qquad
          \frac{dP_i}{ds} = k_i x_i^η, \qquad U = U^- + G P .

In this form the start is no singularity: where E = 0 everywhere, contacts that approach begin to be compressed, and those at
rest follow once the impulses of others make them approach. DOP853 follows it from one change of sign of x or U to the next.

Sources: Glocker and Pfeiffer, Multiple impacts with friction in rigid multibody systems (1995); Liu, Zhao and Brogliato,
Frictionless multiple impacts in multibody systems I (2008); Brogliato, *Nonsmooth Mechanics* (2016).
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from enum import IntEnum
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from lcpimpact.arrays import Array, Flags
from lcpimpact.hybrid.complementarity import complementary
from lcpimpact.hybrid.system import FINE_ZERO
from lcpimpact.lcp.solve import solve_lcp
from lcpimpact.numerics.double_double import DoubleDouble
from lcpimpact.numerics.rounding import EPS
from lcpimpact.scheme.impact_laws import LZB, ImpactLaw

if TYPE_CHECKING:
    from scipy.integrate import DenseOutput

Numbers: TypeAlias = tuple[float, ...]


class EndlessImpact(Exception):
    """An impact that does not end within the limits of its law."""


class Touching(NamedTuple):
    """The closed contacts of an impact (k,).

    Attributes
    ----------
    G : DoubleDouble (k, k)     rates by impulses
    U : DoubleDouble (k,)       rates before the impact
    e : (k,) array              coefficients of restitution
    names : sequence of str
    """

    G: DoubleDouble
    U: DoubleDouble
    e: Array
    names: Sequence[str]


def impulses(
    law: ImpactLaw, contacts: Touching, solver: str, zero: float, *, rest_rtol: float = 1e-10
) -> tuple[DoubleDouble, Flags]:
    """Return P (k,) in N s, and which rates it brings to zero (k,).

    Parameters
    ----------
    law : str or LZB
        Another law than Newton's.
    contacts : Touching
    solver : str
        Name of an LCP solver.
    zero : float
        Rounding of the rates, relative to their terms.
    rest_rtol : float
        Rate after the impact, relative to its terms, below which it has brought a contact to rest.

    Raises
    ------
    EndlessImpact
        If a sequence of impacts, or the motion of the springs, does not end within its limits.

    Examples
    --------
    Three equal balls that touch, the first of which comes with 1 m/s:

    >>> row = Touching(DoubleDouble.of([[2.0, -1.0], [-1.0, 2.0]]), DoubleDouble.of([-1.0, 0.0]), np.ones(2), ("R", "S"))
    >>> for law in ("sequential", "poisson", LZB()):
    ...     P, _ = impulses(law, row, "auto", 1e-12)
    ...     v = 1.0 - P.hi[0], P.hi[0] - P.hi[1], P.hi[1]
    ...     print(*(f"{each:.4f}" for each in v))
    0.0000 0.0000 1.0000
    -0.3333 0.6667 0.6667
    -0.0710 0.0764 0.9945
    """
    G, U = contacts.G, contacts.U
    if law == "poisson":
        P, rounding = _poisson(contacts, solver, zero)
    else:
        P = DoubleDouble.of(_by_springs(law, contacts) if isinstance(law, LZB) else _sequence(contacts, solver))
        rounding = rest_rtol * (np.abs(U.hi) + np.abs(G.hi) @ np.abs(P.hi))
    after = U + G @ P
    stops = np.abs(after.hi) <= rounding
    rows = np.flatnonzero(stops & (P.hi > 0.0))
    if after.hi[rows].any():
        rest = DoubleDouble(np.ascontiguousarray(after.parts[:, rows]))
        block = DoubleDouble(np.ascontiguousarray(G.parts[:, rows[:, None], rows]))
        rested = P[rows]
        for _ in range(2):  # each correction in floats adds their digits
            change = np.linalg.lstsq(block.hi, rest.hi, rcond=EPS * len(rows))[0]
            rested = rested - change
            rest = rest - block @ DoubleDouble.of(change)
        if (rested.hi >= 0.0).all():
            P.parts[:, rows] = rested.parts
    return P, stops


def _poisson(contacts: Touching, solver: str, zero: float) -> tuple[DoubleDouble, Array]:
    """Return P by Poisson's law, and the rounding of U⁺ (k,)."""
    G, U = contacts.G, contacts.U
    tiny = zero * np.abs(U.hi)
    P_c, _ = _complementary(G, U, tiny, solver)
    returned = P_c + P_c * contacts.e
    more, rounding = _complementary(G, U + G @ returned, tiny + FINE_ZERO * (np.abs(G.hi) @ returned.hi), solver)
    return returned + more, rounding


def _complementary(
    G: DoubleDouble, q: DoubleDouble, tiny: Array, solver: str, *, redundant_rtol: float = 1e-13
) -> tuple[DoubleDouble, Array]:
    """Return P with 0 <= P ⟂ G P + q >= 0, where q has the rounding ``tiny`` (k,), and the rounding of that sum (k,).

    Where redundant contacts leave q to rounding no solution, P is that of the nearest q which has one.

    ``redundant_rtol``: eigenvalue of G, relative to the largest, that is rounding.
    """
    none, unbounded = np.zeros(len(q)), np.full(len(q), np.inf)
    guess = solve_lcp(G.hi, q.hi, solver, throw=False)
    tiny = tiny + FINE_ZERO * (np.abs(q.hi) + np.abs(G.hi) @ np.abs(guess.z))
    with suppress(np.linalg.LinAlgError):
        # Where floats have too few digits, as for masses that differ by 1e9, double-doubles decide.
        return complementary(G, q, guess.z, none, unbounded, tiny)[0], tiny
    in_floats = tiny + 1e-10 * (np.abs(q.hi) + np.abs(G.hi) @ np.abs(guess.z))
    if guess.success:
        return DoubleDouble.of(guess.z), in_floats
    from scipy.optimize import nnls  # here, as most runs do without it

    size, vectors = np.linalg.eigh(G.hi)
    kept = size > redundant_rtol * size.max()
    X = np.sqrt(size[kept])[:, None] * vectors[:, kept].T
    return DoubleDouble.of(nnls(X, -np.linalg.lstsq(X.T, q.hi, rcond=None)[0])[0]), in_floats


def _sequence(
    contacts: Touching, solver: str, *, equal_rates_rtol: float = 1e-12, max_sequence: int = 100_000
) -> Array:
    """Return P of impacts of one contact after another.

    ``equal_rates_rtol``: difference of two approach rates, relative to them, below which they are equal.
    ``max_sequence``: maximum number of impacts.
    """
    G, e = contacts.G.hi, contacts.e
    U = contacts.U.hi.copy()
    P, rounding = np.zeros(len(U)), EPS * np.abs(U).max()
    for _ in range(max_sequence):
        approach = -U
        fastest = approach.max()
        if fastest <= rounding:
            # The limit of an infinite sequence, or rounding of rates that end at zero.
            return P + solve_lcp(G, U, solver).z if fastest > 0.0 else P
        at = np.flatnonzero(approach >= (1.0 - equal_rates_rtol) * fastest)
        q = (1.0 + e[at]) * U[at]
        p = -q / G[at, at] if len(at) == 1 else solve_lcp(G[np.ix_(at, at)], q, solver).z
        P[at] += p
        U = U + G[:, at] @ p
        if len(at) == 1:
            U[at] = e[at] * fastest
    raise EndlessImpact


def _by_springs(law: LZB, contacts: Touching) -> Array:
    """Return P by springs between bodies that do not move, in units in which the largest entries of U, G and k are one."""
    speed, mobility = np.abs(contacts.U.hi).max(), np.diag(contacts.G.hi).max()
    k = np.array([law.stiffness.get(name, 1.0) for name in contacts.names])
    numbers = (contacts.G.hi / mobility, contacts.U.hi / speed, contacts.e, k / k.max())
    released = _released(*(tuple(each.ravel().tolist()) for each in numbers), law.exponent)
    return np.asarray(released * (speed / mobility))


@lru_cache(maxsize=1024)
def _released(G: Numbers, U: Numbers, e: Numbers, k: Numbers, η: float) -> Array:
    """Return P of `ImpactSprings`; impacts of all speeds have one where a single contact approaches."""
    n = len(U)
    return ImpactSprings(np.reshape(G, (n, n)), np.array(U), np.array(e), np.array(k), η).impulses()


class ImpactPhase(IntEnum):
    """Phase of a contact in an impact; where e = 1, compression and expansion are one."""

    APART = 0
    COMPRESSED = 1
    EXPANDS = 2


class ImpactSprings(NamedTuple):
    """The springs of contacts in an impact: their mobility, rates before, coefficients e, stiffnesses and exponent.

    They have come to rest below the rate ``slow``, in units of the largest before.
    """

    G: Array
    U: Array
    e: Array
    k: Array
    η: float
    slow: float = 1e-11

    def impulses(self, *, max_steps: int = 4_000) -> Array:
        """Return P (k,) after the last spring is released, or refuse more than ``max_steps``."""
        n, left = len(self.U), max_steps
        y = np.zeros(2 * n)
        phases = np.where(self.U < 0.0, ImpactPhase.COMPRESSED, ImpactPhase.APART)
        while phases.any():
            y, left = self.advance(y, phases, left)
            approaches = self.rates(y) < -self.slow
            phases[(phases == ImpactPhase.APART) & approaches] = ImpactPhase.COMPRESSED
        return y[n:]

    def rates(self, y: Array) -> Array:
        """Return U (k,) at x and P (2 k,)."""
        return np.asarray(self.U + self.G @ y[len(self.U) :])

    def rest(self, y: Array) -> bool:
        """Return whether no rate, and no energy of a spring, is left but slow ones, as where rebounds decay for ever."""
        energies = self.k * np.maximum(y[: len(self.U)], 0.0) ** (self.η + 1.0)
        return bool((np.abs(self.rates(y)) <= self.slow).all() and (energies <= self.slow**2).all())

    def until_end(self, y: Array, phases: Array) -> Array:
        """Return for each contact the number whose fall below zero ends its phase (k,)."""
        x, U = y[: len(self.U)], self.rates(y)
        pushes = np.where(self.e == 1.0, x, np.where(phases == ImpactPhase.EXPANDS, np.minimum(x, U), -U))
        return np.where(phases == ImpactPhase.APART, U, pushes)

    def advance(
        self, y: Array, phases: Array, left: int, *, rtol: float = 1e-12, sign_atol: float = 1e-14
    ) -> tuple[Array, int]:
        """Follow x and P (2 k,) to the first end of a phase, and enter the next; with the number of steps that are ``left``.

        ``rtol``: tolerance of the integration.
        ``sign_atol``: size, in units of the largest rate and deflections, below which a number has no sign.

        Raises
        ------
        EndlessImpact
            If no step is left.
        """
        from scipy.integrate import DOP853  # here, as most runs do without it

        n, touches = len(self.U), phases != ImpactPhase.APART
        swift = np.divide(1.0, self.e**2, out=np.ones(n), where=(phases == ImpactPhase.EXPANDS) & (self.e > 0.0))

        def slope(_: float, y: Array) -> Array:
            force = np.where(touches, self.k * np.maximum(y[:n], 0.0) ** self.η, 0.0)
            return np.concatenate([np.where(touches, -swift * self.rates(y), 0.0), force])

        solver = DOP853(slope, 0.0, y, np.inf, rtol=rtol, atol=0.01 * rtol)
        before = self.until_end(y, phases)
        while (left := left - 1) >= 0:
            solver.step()
            if self.rest(solver.y):
                phases[:] = ImpactPhase.APART
                return np.asarray(solver.y), left
            read = solver.dense_output()
            for start, end in pairwise(np.linspace(solver.t_old, solver.t, 5)):
                after = self.until_end(read(end), phases)
                ended = np.flatnonzero(after < -sign_atol)
                if len(ended):
                    roots = [
                        self.root(read, (start, end), phases, i) if before[i] > 0.0 else start for i in ended.tolist()
                    ]
                    y = read(min(roots))
                    self.enter(y, phases, int(ended[np.argmin(roots)]))
                    return y, left
                before = after
        raise EndlessImpact

    def root(self, read: DenseOutput, within: tuple[float, float], phases: Array, i: int) -> float:
        """Return the instant at which the phase of contact i ends."""
        from scipy.optimize import brentq

        def value(s: float) -> float:
            return float(self.until_end(read(s), phases)[i])

        return float(brentq(value, *within))

    def enter(self, y: Array, phases: Array, i: int) -> None:
        """Let contact i enter its next phase, at the end of one."""
        if phases[i] == ImpactPhase.APART or (phases[i] == ImpactPhase.EXPANDS and y[i] > self.rates(y)[i]):
            phases[i] = ImpactPhase.COMPRESSED
        elif phases[i] == ImpactPhase.COMPRESSED and 0.0 < self.e[i] < 1.0:
            phases[i] = ImpactPhase.EXPANDS
        else:
            phases[i] = ImpactPhase.APART
            y[i] = 0.0
