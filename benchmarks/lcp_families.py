r"""Families of test problems: random ones of every class that contacts lead to, and the formulas that break methods.

A random problem with a known answer is made backwards: from a complementary pair z, w follows q = w - M z. Tests and
benchmarks draw from the same families, each instance from the generator that is handed over.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.random import Generator

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.lcp.operators import Banded


@dataclass(frozen=True)
class Case:
    """One problem: w = M z + q with lower <= z <= upper.

    Attributes
    ----------
    M : (n, n) array or Banded
    q : (n,) array
    lower, upper : (n,) arrays or None      None: 0 and inf, a plain LCP
    z : (n,) array or None                  a solution, where the construction knows one; there may be others
    tags : tuple of str                     properties of M, as solvers take them
    """

    M: Array | Banded
    q: Array
    lower: Array | None = None
    upper: Array | None = None
    z: Array | None = None
    tags: tuple[str, ...] = ()


Build: TypeAlias = Callable[[int, Generator], Case]
"""build(n, rng) -> Case."""


@dataclass(frozen=True, kw_only=True)
class Family:
    """A class of problems of every order.

    Attributes
    ----------
    name : str
    summary : str               one sentence for tables
    source : str                where the class, its formula or its use as a test is from
    tags : tuple of str         properties of every M of the family
    solvable : bool             True: every instance has a solution; False: none has
    boxed : bool                whether there are bounds other than lower = 0, upper = inf
    smallest : int              least order that makes sense
    largest : int or None       largest one
    build : Build
    """

    name: str
    summary: str
    source: str
    tags: tuple[str, ...] = ()
    solvable: bool = True
    boxed: bool = False
    smallest: int = 1
    largest: int | None = None
    build: Build

    def has_order(self, n: int) -> bool:
        """Return whether the family has problems of order n."""
        return self.smallest <= n and (self.largest is None or n <= self.largest)

    def make(self, n: int, rng: Generator) -> Case:
        """Return an instance of order n, or of the largest order below n where contacts have several rows each.

        Raises
        ------
        InputError
            If the family has none of that order.

        Examples
        --------
        >>> case = FAMILIES["murty"].make(3, np.random.default_rng(0))
        >>> case.M @ case.z + case.q
        array([0., 1., 1.])
        """
        if not self.has_order(n):
            above = "" if self.largest is None else f" up to {self.largest}"
            raise InputError(f"family {self.name!r} has the orders from {self.smallest}{above}, and not n = {n}")
        return replace(self.build(n, rng), tags=self.tags)


# ---- pieces ---------------------------------------------------------------------------------------------------------


def gram(n: int, rank: int, rng: Generator) -> Array:
    """Return G Gᵀ / n of a normal G (n, rank)."""
    G = rng.normal(size=(n, rank))
    product: Array = G @ G.T
    return product / n


def definite(n: int, rng: Generator) -> Array:
    """Return G Gᵀ / n + I / 10."""
    return gram(n, n, rng) + 0.1 * np.eye(n)


def definite_and_skew(n: int, rng: Generator) -> Array:
    """Return a symmetric positive definite matrix plus a skew one as large."""
    S: Array = rng.normal(size=(n, n)) / np.sqrt(n)
    return definite(n, rng) + S - S.T


def singular(n: int, rng: Generator) -> Array:
    """Return a Gram matrix of rank n / 2."""
    return gram(n, max(1, n // 2), rng)


def complementary(n: int, rng: Generator, empty: float = 0.0) -> tuple[Array, Array]:
    """Return z, w >= 0 with z·w = 0; in the share ``empty`` of the rows both vanish."""
    side = rng.random(n)
    acts = side < 0.5 * (1.0 - empty)
    rests = side >= 0.5 * (1.0 + empty)
    return np.where(acts, rng.random(n), 0.0), np.where(rests, rng.random(n), 0.0)


def with_answer(M: Array, z: Array, w: Array) -> Case:
    """Return the LCP that z and w solve."""
    return Case(M, w - M @ z, z=z)


def inside_box(M: Array, rng: Generator) -> Case:
    """Return a boxed problem with a known answer; a third of the rows at each bound, many bounded on one side alone."""
    n = len(M)
    side = rng.integers(-1, 2, size=n)
    lower, upper = -0.1 - rng.random(n), 0.1 + rng.random(n)
    z = np.where(side < 0, lower, np.where(side > 0, upper, rng.uniform(lower, upper)))
    w = -side * rng.random(n)
    upper[(side <= 0) & (rng.random(n) < 0.5)] = np.inf
    lower[(side > 0) & (rng.random(n) < 0.5)] = -np.inf
    return Case(M, w - M @ z, lower, upper, z)


def cyclic(n: int, k: int) -> Array:
    """Return the permutation matrix with ones at (i, i - k mod n)."""
    return np.roll(np.eye(n), k, axis=0)


def triangle(n: int) -> Array:
    """Return the lower triangular matrix with 1 on its diagonal and 2 below."""
    return 2.0 * np.tri(n) - np.eye(n)


# ---- random families ------------------------------------------------------------------------------------------------


def spd(n: int, rng: Generator) -> Case:
    """Return a well-conditioned M and a normal q."""
    return Case(definite(n, rng), rng.normal(size=n))


def psd(n: int, rng: Generator) -> Case:
    """Return a singular M and a feasible q."""
    return with_answer(singular(n, rng), *complementary(n, rng))


def ill_conditioned(n: int, rng: Generator) -> Case:
    """Return M with the eigenvalues 1 ... 1e-8, equally spaced in their logarithm."""
    Q, _ = np.linalg.qr(rng.normal(size=(n, n)))
    M = (Q * np.logspace(0.0, -8.0, n)) @ Q.T
    return with_answer(0.5 * (M + M.T), *complementary(n, rng))


def chain(n: int, rng: Generator) -> Case:
    """Return the contacts of n bodies in a row on the ground: c are inverse masses, y velocities without contact."""
    c = 10.0 ** rng.uniform(-0.5, 0.5, n)
    y = rng.normal(size=n)
    q = np.diff(y, prepend=0.0)
    diagonal = c + np.append(0.0, c[:-1])
    if n > 2:
        return Case(Banded([diagonal, -c], ("psd", "p", "positive_diagonal")), q)
    return Case(np.diag(diagonal) - np.diag(c[:-1], 1) - np.diag(c[:-1], -1), q)


def p_positive(n: int, rng: Generator) -> Case:
    """Return a positive definite M that is far from symmetric, and a normal q."""
    return Case(definite_and_skew(n, rng), rng.normal(size=n))


def p_dominant(n: int, rng: Generator) -> Case:
    """Return M with M_ii = 0.1 + Σ_j |M_ij|, its rows scaled over two decades, and q scaled along."""
    M = rng.normal(size=(n, n))
    np.fill_diagonal(M, 0.0)
    np.fill_diagonal(M, 0.1 + np.abs(M).sum(axis=1))
    d = 10.0 ** rng.uniform(-1.0, 1.0, n) / np.diag(M)
    return Case(d[:, None] * M, d * rng.normal(size=n))


def degenerate(n: int, rng: Generator) -> Case:
    """Return an SPD M, and q such that z = w = 0 in a third of the rows."""
    return with_answer(definite(n, rng), *complementary(n, rng, empty=1.0 / 3.0))


def duplicated(n: int, rng: Generator) -> Case:
    """Return P M₀ Pᵀ with P that repeats every contact: only the sum of the impulses of its copies is determined."""
    m = (n + 1) // 2
    copy = np.arange(n) % m
    z, w = complementary(m, rng)
    return with_answer(definite(m, rng)[np.ix_(copy, copy)], (z / np.bincount(copy))[copy], w[copy])


def friction(n: int, rng: Generator) -> Case:
    r"""Return n / 6 contacts of balls with Coulomb friction in Stewart and Trinkle's form.

    Rows: normal impulses p, impulses β along four tangents of each contact, sliding speeds λ.

    .. math:: M = \begin{pmatrix} W_{nn} & W_{nt} & 0 \\ W_{tn} & W_{tt} & E \\ μ & -E^T & 0 \end{pmatrix}, \qquad
              q = \begin{pmatrix} J_n v \\ J_t v \\ 0 \end{pmatrix}, \qquad W = J A^{-1} J^T

    with v the velocities without contact. M is copositive, and whatever direction it leaves free, q is zero along it: there
    is a solution.
    """
    k = n // 6
    balls = max(1, 2 * k // 3)
    above = np.arange(k) % balls
    below = rng.integers(-1, above)  # -1 is the ground, which stands behind the last ball
    normal = rng.normal(size=(k, 3))
    normal[:, 2] = 0.5 + np.abs(normal[:, 2])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    tangent = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal), axis=1)])
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    other = np.cross(normal, tangent)
    d = np.stack([normal, tangent, other, -tangent, -other], axis=1)
    arm = np.cross(normal[:, None], d)  # of radius 1, from the centre of the lower ball
    contact = np.arange(k)
    blocks = np.zeros((k, 5, balls + 1, 6))
    blocks[contact, :, above] += np.concatenate([d, -arm], axis=2)
    blocks[contact, :, below] -= np.concatenate([d, arm], axis=2)
    rows = blocks[:, :, :balls].reshape(k, 5, 6 * balls)
    J = np.concatenate([rows[:, 0], rows[:, 1:].reshape(4 * k, 6 * balls)])

    mass = 10.0 ** rng.uniform(-0.5, 0.5, balls)
    A = np.outer(mass, [1.0, 1.0, 1.0, 0.4, 0.4, 0.4]).ravel()
    v = rng.normal(size=(balls, 6)) - np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    E = np.kron(np.eye(k), np.ones((4, 1)))
    M = np.zeros((6 * k, 6 * k))
    M[: 5 * k, : 5 * k] = (J / A) @ J.T
    M[k : 5 * k, 5 * k :] = E
    M[5 * k :, :k] = np.diag(rng.uniform(0.1, 1.0, k))
    M[5 * k :, k : 5 * k] = -E.T
    return Case(M, np.concatenate([J @ v.ravel(), np.zeros(k)]))


def copositive_plus(n: int, rng: Generator) -> Case:
    """Return a singular Gram matrix, plus a skew one, plus a positive block that makes it indefinite; and a feasible q.

    Where z >= 0 and z·Mz = 0, z vanishes on the block and the Gram matrix on z: M is copositive-plus.
    """
    S = rng.normal(size=(n, n)) / np.sqrt(n)
    positive = np.where(rng.random(n) < 0.5, 1.0, 0.0)
    N = rng.random((n, n)) * np.outer(positive, positive)
    return with_answer(singular(n, rng) + S - S.T + N + N.T, *complementary(n, rng))


def infeasible_psd(n: int, rng: Generator) -> Case:
    """Return M = B Bᵀ with M a = 0 for some a > 0, and q with a·q < 0: bodies between walls that close on each other."""
    a = 0.5 + rng.random(n)
    a /= np.linalg.norm(a)
    B = rng.normal(size=(n, max(1, n - 1))) / np.sqrt(n)
    B -= np.outer(a, a @ B)
    q = rng.normal(size=n)
    return Case(B @ B.T if n > 1 else np.zeros((1, 1)), q - a * (a @ q + 0.5 + rng.random()))


def infeasible_row(n: int, rng: Generator) -> Case:
    """Return M with a row that no z >= 0 lifts above q_i < 0."""
    M, q, i = definite(n, rng), rng.normal(size=n), rng.integers(n)
    M[i] = -np.abs(rng.normal(size=n)) / np.sqrt(n)
    q[i] = -0.5 - rng.random()
    return Case(M, q)


def badly_scaled(n: int, rng: Generator) -> Case:
    """Return D M D and D q of an SPD M, with D over 1e-4 ... 1e4: contacts of pebbles and of ships."""
    D = 10.0 ** rng.uniform(-4.0, 4.0, n)
    z, w = complementary(n, rng)
    M = definite(n, rng)
    return Case(np.outer(D, D) * M, D * (w - M @ z), z=z / D)


def boxed_spd(n: int, rng: Generator) -> Case:
    """Return an SPD M in a box, as dry-friction sliders give it."""
    return inside_box(definite(n, rng), rng)


def boxed_psd(n: int, rng: Generator) -> Case:
    """Return a singular M in a box."""
    return inside_box(singular(n, rng), rng)


def boxed_p(n: int, rng: Generator) -> Case:
    """Return a positive definite, not symmetric M in a box."""
    return inside_box(definite_and_skew(n, rng), rng)


def mixed_spd(n: int, rng: Generator) -> Case:
    """Return an SPD M with rows without bounds (joints) among those with z >= 0 (contacts)."""
    free = rng.random(n) < 0.5
    z, w = complementary(n, rng)
    z[free], w[free] = rng.normal(size=free.sum()), 0.0
    M = definite(n, rng)
    return Case(M, w - M @ z, np.where(free, -np.inf, 0.0), np.full(n, np.inf), z)


def saddle(n: int, rng: Generator) -> Case:
    """Return A v - Hᵀ r + b = 0 with 0 <= r ⟂ H v + g >= 0: a step with its velocities kept as unknowns."""
    k = max(1, n // 3)
    m = n - k
    H = rng.normal(size=(k, m)) / np.sqrt(m)
    M = np.block([[definite(m, rng), -H.T], [H, np.zeros((k, k))]])
    v, (r, gap) = rng.normal(size=m), complementary(k, rng)
    z, w = np.concatenate([v, r]), np.concatenate([np.zeros(m), gap])
    return Case(M, w - M @ z, np.repeat([-np.inf, 0.0], [m, k]), np.full(n, np.inf), z)


# ---- formulas -------------------------------------------------------------------------------------------------------


def murty(n: int, rng: Generator) -> Case:
    """Return M with 1 on its diagonal and 2 below, q = -1, z = (1, 0, ..., 0)."""
    return Case(triangle(n), np.full(n, -1.0), z=np.eye(n)[0])


def murty_reversed(n: int, rng: Generator) -> Case:
    """Return M with 1 on its diagonal and 2 above, q = -1, z = (0, ..., 0, 1)."""
    return Case(triangle(n).T.copy(), np.full(n, -1.0), z=np.eye(n)[-1])


def fathi(n: int, rng: Generator) -> Case:
    """Return M = L Lᵀ, L with 1 on its diagonal and 2 below, q = -1, z = (1, 0, ..., 0)."""
    L = triangle(n)
    return Case(L @ L.T, np.full(n, -1.0), z=np.eye(n)[0])


def csizmadia(n: int, rng: Generator) -> Case:
    """Return M with 1 on its diagonal and -1 below, and q for z = (1, 0, 1, 0, ...), w = (0, 1, 0, 1, ...)."""
    z = np.zeros(n)
    z[::2] = 1.0
    return with_answer(2.0 * np.eye(n) - np.tri(n), z, 1.0 - z)


def kostreva(n: int, rng: Generator) -> Case:
    """Return copies of I + 2 C along the diagonal, C a cyclic permutation of three rows, and q = -1: all ratios tie."""
    M, z = np.eye(n), np.ones(n)
    m = n - n % 3
    M[:m, :m] += 2.0 * np.kron(np.eye(n // 3), cyclic(3, -1))
    z[:m] = 1.0 / 3.0
    return Case(M, np.full(n, -1.0), z=z)


def ben_gharbia_gilbert(n: int, rng: Generator) -> Case:
    """Return a P-matrix for which min-Newton without a safeguard goes round for ever, started from z = 0.

    The published problem is M = I + α C, or I + α C + β C² for even n, with q = 1; it cycles from the point where row 1
    alone is free. Here z_1 and w_1 have changed places, so that this point is z = 0; the answer is z = (1, 0, ..., 0).
    """
    M = np.eye(n) + 2.0 * cyclic(n, 1) if n % 2 else np.eye(n) + 4.0 / 3.0 * cyclic(n, 1) + 0.5 * cyclic(n, 2)
    q = np.ones(n)
    row, column = M[0].copy(), M[:, 0].copy()
    # The principal pivot on M_11 = 1.
    M -= np.outer(column, row)
    q -= column
    M[0], M[:, 0] = -row, column
    q[0] = -1.0
    return Case(M, q, z=np.eye(n)[0])


def scaled(build: Build, of_M: float, of_q: float) -> Build:
    """Return the same problems with M and q in other units."""

    def build_scaled(n: int, rng: Generator) -> Case:
        case = build(n, rng)
        M = Banded(of_M * case.M.bands) if isinstance(case.M, Banded) else of_M * case.M
        z = None if case.z is None else case.z * (of_q / of_M)
        return Case(M, of_q * case.q, z=z)

    return build_scaled


# ---- the table ------------------------------------------------------------------------------------------------------

SPD = ("symmetric", "psd", "p", "positive_diagonal")
PSD = ("symmetric", "psd")
P = ("p", "positive_diagonal")
CPS = "Cottle, Pang and Stone (1992), chapter 3"

_RANDOM = (
    Family(name="spd", summary="symmetric positive definite, q normal", source=CPS, tags=SPD, build=spd),
    Family(
        name="psd", summary="positive semidefinite of rank n/2, feasible", source=CPS, tags=PSD, smallest=2, build=psd
    ),
    Family(
        name="ill-conditioned",
        summary="symmetric positive definite with the condition 1e8",
        source="-",
        tags=SPD,
        smallest=2,
        build=ill_conditioned,
    ),
    Family(
        name="chain",
        summary="contacts of bodies in a row on the ground, masses over a decade: tridiagonal",
        source="Moreau (1988) for the impulses of a chain of contacts",
        tags=SPD,
        build=chain,
    ),
    Family(
        name="p-positive",
        summary="positive definite plus skew: a P-matrix that is not symmetric",
        source=CPS,
        tags=("psd", *P),
        smallest=2,
        build=p_positive,
    ),
    Family(
        name="p-dominant",
        summary="dominant diagonal in each row, rows scaled: a P-matrix that need not be positive definite",
        source=CPS,
        tags=P,
        smallest=2,
        build=p_dominant,
    ),
    Family(
        name="degenerate",
        summary="symmetric positive definite, z = w = 0 in a third of the rows",
        source=CPS,
        tags=SPD,
        build=degenerate,
    ),
    Family(
        name="duplicated",
        summary="every contact twice: P M P', feasible, z not unique",
        source="-",
        tags=PSD,
        smallest=2,
        build=duplicated,
    ),
    Family(
        name="friction",
        summary="contacts of balls with polyhedral Coulomb friction, 6 rows each: copositive",
        source="Stewart and Trinkle (1996); Anitescu and Potra (1997) for the existence of solutions",
        smallest=6,
        build=friction,
    ),
    Family(
        name="copositive-plus",
        summary="copositive-plus and indefinite, feasible",
        source="Lemke (1965); Cottle, Pang and Stone (1992), section 4.4",
        smallest=2,
        build=copositive_plus,
    ),
    Family(
        name="infeasible-psd",
        summary="positive semidefinite, M a = 0 and a.q < 0 for some a > 0: no solution",
        source="Farkas's lemma",
        tags=PSD,
        solvable=False,
        build=infeasible_psd,
    ),
    Family(
        name="infeasible-row",
        summary="a row that cannot become positive: no solution",
        source="Farkas's lemma",
        solvable=False,
        build=infeasible_row,
    ),
    Family(
        name="badly-scaled",
        summary="D M D of a symmetric positive definite M, D over 1e-4 ... 1e4",
        source="-",
        tags=SPD,
        build=badly_scaled,
    ),
)

_FORMULAS = (
    Family(
        name="murty",
        summary="lower triangular, 2 below 1, q = -1: 2^n steps of Lemke's method, 2^n - 1 by the largest index",
        source="Murty (1978), Mathematical Programming Study 7",
        tags=P,
        largest=16,
        build=murty,
    ),
    Family(
        name="murty-reversed",
        summary="Murty's problem with its rows in reverse order: 2^n - 1 steps by the least index",
        source="Murty (1978), Mathematical Programming Study 7",
        tags=P,
        largest=16,
        build=murty_reversed,
    ),
    Family(
        name="fathi",
        summary="L L' of Murty's triangle, q = -1: 2^n steps of Lemke's method, 2^n - 1 by the largest index",
        source="Fathi (1979), Mathematical Programming 17",
        tags=SPD,
        largest=16,
        build=fathi,
    ),
    Family(
        name="csizmadia",
        summary="triangular, 1 and -1: its handicap, which bounds interior-point steps, is exponential in n",
        source="Csizmadia, in de Klerk and E.-Nagy (2011), Mathematical Programming 129",
        tags=P,
        build=csizmadia,
    ),
    Family(
        name="kostreva",
        summary="cyclic blocks of three, q = -1: Lemke's method cycles unless ties are broken with care",
        source="Kostreva (1979), example 1, Mathematical Programming 16",
        tags=P,
        smallest=3,
        build=kostreva,
    ),
    Family(
        name="ben-gharbia-gilbert",
        summary="a P-matrix on which min-Newton cycles from z = 0",
        source="Ben Gharbia and Gilbert (2012), Mathematical Programming 134, after a principal pivot",
        tags=P,
        smallest=3,
        build=ben_gharbia_gilbert,
    ),
)

_BOXED = (
    Family(
        name="boxed-spd",
        summary="symmetric positive definite in a box",
        source="-",
        tags=SPD,
        boxed=True,
        build=boxed_spd,
    ),
    Family(
        name="boxed-psd",
        summary="positive semidefinite of rank n/2 in a box",
        source="-",
        tags=PSD,
        boxed=True,
        smallest=2,
        build=boxed_psd,
    ),
    Family(
        name="boxed-p",
        summary="positive definite plus skew in a box",
        source="-",
        tags=("psd", *P),
        boxed=True,
        smallest=2,
        build=boxed_p,
    ),
    Family(
        name="mixed-spd",
        summary="symmetric positive definite, half of the rows without bounds",
        source="-",
        tags=SPD,
        boxed=True,
        build=mixed_spd,
    ),
    Family(
        name="mixed-saddle",
        summary="[[A, -H'], [H, 0]] with the velocities as free rows",
        source="Cottle, Pang and Stone (1992), section 1.5, mixed LCP",
        tags=("psd",),
        boxed=True,
        smallest=2,
        build=saddle,
    ),
)

UNITS = {"both-1e-6": (1e-6, 1e-6), "both-1e-9": (1e-9, 1e-9), "q-1e-9": (1.0, 1e-9), "M-1e9": (1e9, 1.0)}
"""Name of a scaled copy to the factors of M and of q."""


def _copies(family: Family) -> tuple[Family, ...]:
    return tuple(
        replace(
            family,
            name=f"{family.name}-{name}",
            summary=f"{family.name} with M times {of_M:g} and q times {of_q:g}",
            build=scaled(family.build, of_M, of_q),
        )
        for name, (of_M, of_q) in UNITS.items()
    )


_BASE = {each.name: each for each in (*_RANDOM, *_FORMULAS, *_BOXED)}

FAMILIES: Mapping[str, Family] = _BASE | {each.name: each for name in ("spd", "psd") for each in _copies(_BASE[name])}
"""Every family by its name."""
