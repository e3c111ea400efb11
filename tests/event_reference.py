"""A slow and plain event simulator in arithmetic of 300 digits: the outside reference of `exact`.

It reads the elements of a scheme, whose floats it takes as exact numbers, and shares nothing else with lcpimpact:

- A *mode* says of each bumper whether it is closed, and of each slider whether it sticks or which way it slips. With
  x = (r, q', q, signals) it is a linear differential-algebraic equation E x' = A x, whose coefficients are rational. Its
  constraints are found by Luenberger's shuffle algorithm: rows of E that vanish are constraints, which are differentiated
  until E can be inverted. All of this is done in exact rational arithmetic, so ranks are no matter of tolerance. What
  relative degree a contact has is never asked.
- On the consistent states x = N y the motion is a sum of terms tᵖ/p! exp(λt). The λ are the roots of the characteristic
  polynomial, which are isolated with their exact multiplicities.
- The first root of each watched quantity is bracketed by Bernstein's form of its Taylor polynomial, window by window.
- The mode after an event is found by enumeration: of all modes that fit the state, the one in which the first
  Taylor coefficient that is not zero, of every r and u, is positive. So are impacts, 0 <= P ⟂ U⁺ + e min(U⁻, 0) >= 0, where
  impulses balance on nodes without mass.
- Impacts that accumulate are followed until they are closer than `SHORT`. Then the rows that took part are
  closed: their gaps, of 1e-30 and less, and the rates of those are set to zero.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property, lru_cache
from itertools import combinations, pairwise, product
from math import comb, factorial, inf
from typing import Any

import numpy as np
from flint import acb, acb_mat, arb, arb_mat, arb_poly, ctx, fmpq, fmpq_mat

import lcpimpact as li

BITS = 1024
NOISE = arb(10) ** -240
ZERO = arb(10) ** -150
"""What counts as zero, relative to the terms of a sum: rounding is 1e-300, and flights of 1e-30 have gaps of 1e-60."""

SHORT = 1e-30
"""Impacts follow each other for ever when the time between them, relative to the run, is below this."""

SHORTEST = arb(10) ** -100
"""Flights below this, while bodies still move, would soon leave gaps that `ZERO` takes for none."""

MOST = 5_000
"""The limit of segments."""

CLOSED, OPEN, STICK, FORWARD, BACKWARD = "closed", "open", "stick", "slip +", "slip -"
DEGREE = 40


class Undecided(Exception):
    """The reference finds no motion, or more than one."""


def collide(masses, places, speeds, e, most=10_000):
    """Return the impacts (t, left body) of force-free bodies on a line in rational arithmetic, and where and how they end.

    Bodies at x_1 <= x_2 <= ... of vanishing size meet by Newton's law; ``e`` is one number, or one for each pair. Impacts of
    one instant must not share a body.
    """
    m, x, v = ([Fraction(each) for each in given] for given in (masses, places, speeds))
    e = [Fraction(each) for each in (e if isinstance(e, (list, tuple)) else [e] * (len(m) - 1))]
    t, impacts = Fraction(0), []
    while len(impacts) < most:
        U = [b - a for a, b in pairwise(v)]
        waits = [(x[i + 1] - x[i]) / -U[i] if U[i] < 0 else None for i in range(len(U))]
        if all(wait is None for wait in waits):
            break
        wait = min(each for each in waits if each is not None)
        t += wait
        x = [place + wait * speed for place, speed in zip(x, v, strict=True)]
        meeting = [i for i, each in enumerate(waits) if each == wait]
        if any(b - a == 1 for a, b in pairwise(meeting)):
            raise Undecided("three bodies meet at one point")
        for i in meeting:
            P = (1 + e[i]) * -U[i] / (1 / m[i] + 1 / m[i + 1])
            v[i] -= P / m[i]
            v[i + 1] += P / m[i + 1]
            impacts.append((t, i))
    return impacts, x, v


def rational(number: Any) -> fmpq:
    """Return a float as the exact number that it is."""
    if isinstance(number, fmpq):
        return number
    return fmpq(*Fraction(number).as_integer_ratio())


@dataclass(frozen=True)
class Row:
    """A bumper, or a slider with its threshold r0."""

    name: str
    upper: str
    lower: str
    gap: fmpq
    e: fmpq
    r0: fmpq | None = None


class Equations:
    """M q'' + C q' + K q = F s + Hᵀ r, u = H q + u0, in rationals; s = (1, cos, sin, ...) with s' = Ω s."""

    def __init__(self, problem: li.Problem) -> None:
        elements = problem.scheme.elements
        self.nodes = list(dict.fromkeys(node for each in elements for node in each.nodes if node != "ground"))
        n = len(self.nodes)
        self.M, self.C, self.K = (fmpq_mat(n, n) for _ in range(3))
        self.rows: list[Row] = []
        constant = [fmpq(0)] * n
        waves: list[tuple[int, Any]] = []
        for each in elements:
            match each:
                case li.Mass():
                    i = self.nodes.index(each.node)
                    self.M[i, i] += rational(each.m)
                case li.Spring():
                    self._join(self.K, each.a, each.b, each.k)
                case li.NegativeSpring():
                    self._join(self.K, each.a, each.b, -each.k)
                case li.Dashpot():
                    self._join(self.C, each.a, each.b, each.c)
                case li.KelvinVoigt():
                    self._join(self.K, each.a, each.b, each.k)
                    self._join(self.C, each.a, each.b, each.c)
                case li.Load(f=li.Harmonic()):
                    waves.append((self.nodes.index(each.node), each.f))
                case li.Load() if not callable(each.f):
                    constant[self.nodes.index(each.node)] += rational(each.f)
                case li.Bumper():
                    e = rational(each.e or 0.0)
                    self.rows.append(Row(each.name, each.upper, each.lower, rational(each.gap), e))
                case li.Slider():
                    self.rows.append(Row(each.name, each.a, each.b, fmpq(0), fmpq(0), rational(each.r0)))
                case _:
                    raise NotImplementedError(each)
        ns = 1 + 2 * len(waves)
        self.F, self.Ω = fmpq_mat(n, ns), fmpq_mat(ns, ns)
        self.s0 = [arb(1)]
        for i, f in enumerate(constant):
            self.F[i, 0] = f
        for j, (i, wave) in enumerate(waves):
            self.F[i, 1 + 2 * j] += rational(wave.amplitude)
            ω, φ = rational(wave.omega), arb(rational(wave.phase))
            self.Ω[1 + 2 * j, 2 + 2 * j], self.Ω[2 + 2 * j, 1 + 2 * j] = -ω, ω
            self.s0 += [φ.cos(), φ.sin()]
        self.H = fmpq_mat(len(self.rows), n)
        for i, row in enumerate(self.rows):
            for node, sign in ((row.lower, 1), (row.upper, -1)):
                if node != "ground":
                    self.H[i, self.nodes.index(node)] += sign
        self.massive = [i for i in range(n) if self.M[i, i] != 0]
        self.massless = [i for i in range(n) if self.M[i, i] == 0]
        self.n, self.nc, self.ns = n, len(self.rows), ns
        # x = (r, v, q, s): what stands first is eliminated first.
        self.v, self.q, self.s = self.nc, self.nc + n, self.nc + 2 * n
        self.size = self.nc + 2 * n + ns

    def _join(self, matrix: fmpq_mat, a: str, b: str, value: float) -> None:
        ends = [(self.nodes.index(node), sign) for node, sign in ((a, -1), (b, 1)) if node != "ground"]
        for i, si in ends:
            for j, sj in ends:
                matrix[i, j] += si * sj * rational(value)

    @cached_property
    def kept(self) -> fmpq_mat:
        """The rows that read off x what no switch changes, but for impulses: M v, q with mass, C q without, sliders, s."""
        rows = [[(self.v + i, fmpq(1))] for i in self.massive]
        rows += [[(self.q + i, fmpq(1))] for i in self.massive]
        rows += [[(self.q + j, self.C[i, j]) for j in range(self.n)] for i in self.massless]
        rows += [
            [(self.q + j, self.H[i, j]) for j in range(self.n)] for i in range(self.nc) if self.rows[i].r0 is not None
        ]
        rows += [[(self.s + i, fmpq(1))] for i in range(self.ns)]
        found = fmpq_mat(len(rows), self.size)
        for i, row in enumerate(rows):
            for j, value in row:
                found[i, j] = value
        return found

    @cached_property
    def opening(self) -> fmpq_mat:
        """The rows that read off x the openings u."""
        found = fmpq_mat(self.nc, self.size)
        for i, row in enumerate(self.rows):
            found[i, self.s] = row.gap
            for j in range(self.n):
                found[i, self.q + j] = self.H[i, j]
        return found

    @cached_property
    def rate(self) -> fmpq_mat:
        """The rows that read off x the rates U."""
        found = fmpq_mat(self.nc, self.size)
        for i in range(self.nc):
            for j in range(self.n):
                found[i, self.v + j] = self.H[i, j]
        return found


def _pivots(reduced: fmpq_mat, rank: int) -> list[int]:
    found, column = [], 0
    for i in range(rank):
        while reduced[i, column] == 0:
            column += 1
        found.append(column)
    return found


def _select(matrix: fmpq_mat, rows: list[int]) -> fmpq_mat:
    return fmpq_mat(len(rows), matrix.ncols(), [matrix[i, j] for i in rows for j in range(matrix.ncols())])


def _stack(*matrices: fmpq_mat) -> fmpq_mat:
    entries = [entry for each in matrices for entry in each.entries()]
    return fmpq_mat(sum(each.nrows() for each in matrices), matrices[0].ncols(), entries)


class Mode:
    """The motion while each row does what ``does`` says: y' = A y, x = N y."""

    def __init__(self, equations: Equations, does: tuple[str, ...]) -> None:
        self.equations, self.does = equations, does
        E, A = self._pencil()
        size, constraints = equations.size, []
        while True:
            both = fmpq_mat(size, 2 * size)
            for i in range(size):
                for j in range(size):
                    both[i, j], both[i, size + j] = E[i, j], A[i, j]
            both, rank = both.rref()
            if rank < size:
                raise Undecided("the rows of this mode depend on each other")
            E = fmpq_mat(size, size, [both[i, j] for i in range(size) for j in range(size)])
            A = fmpq_mat(size, size, [both[i, size + j] for i in range(size) for j in range(size)])
            hidden = [i for i in range(size) if all(E[i, j] == 0 for j in range(size))]
            if not hidden:
                break
            for i in hidden:
                constraints.append([A[i, j] for j in range(size)])
                for j in range(size):
                    E[i, j], A[i, j] = A[i, j], fmpq(0)
        # Now E is the identity.
        reduced, rank = fmpq_mat(len(constraints), size, [each for row in constraints for each in row]).rref()
        pivots = _pivots(reduced, rank)
        free = [j for j in range(size) if j not in pivots]
        N = fmpq_mat(size, len(free))
        for k, j in enumerate(free):
            N[j, k] = 1
            for i, pivot in enumerate(pivots):
                N[pivot, k] = -reduced[i, j]
        self.N, self.A = arb_mat(N), _select(A * N, free)
        self.free, self.order = free, len(free)
        kept = equations.kept * N
        reduced, rank = kept.transpose().rref()
        self.determined = rank == self.order
        if self.determined:
            chosen = _pivots(reduced, rank)
            start = _select(kept, chosen).inv()
            self.chosen, self.start, self.kept = chosen, arb_mat(start), arb_mat(kept)
            self.watched = [(i, sign, arb_mat(row * N)) for i, sign, row in self._watched()]

    def _pencil(self) -> tuple[fmpq_mat, fmpq_mat]:
        z = self.equations
        E, A = fmpq_mat(z.size, z.size), fmpq_mat(z.size, z.size)
        for i in range(z.n):
            E[z.v + i, z.q + i] = A[z.v + i, z.v + i] = 1
            for j in range(z.n):
                E[z.q + i, z.v + j] = z.M[i, j]
                A[z.q + i, z.v + j], A[z.q + i, z.q + j] = -z.C[i, j], -z.K[i, j]
            for j in range(z.ns):
                A[z.q + i, z.s + j] = z.F[i, j]
            for j in range(z.nc):
                A[z.q + i, j] = z.H[j, i]
        for i in range(z.ns):
            E[z.s + i, z.s + i] = 1
            for j in range(z.ns):
                A[z.s + i, z.s + j] = z.Ω[i, j]
        for i, does in enumerate(self.does):
            if does == CLOSED:
                for j in range(z.size):
                    A[i, j] = z.opening[i, j]
            elif does == STICK:
                for j in range(z.size):
                    A[i, j] = z.rate[i, j]
            else:
                A[i, i] = 1
                if does in (FORWARD, BACKWARD):
                    A[i, z.s] = z.rows[i].r0 * (1 if does == FORWARD else -1)
        return E, A

    def _watched(self) -> list[tuple[int, int, fmpq_mat]]:
        """Return (row, sign, c) of each c·x that must stay positive."""
        z, found = self.equations, []
        for i, does in enumerate(self.does):
            reaction = fmpq_mat(1, z.size)
            reaction[0, i] = 1
            if does == CLOSED:
                found.append((i, 0, reaction))
            elif does == OPEN:
                found.append((i, 0, _select(z.opening, [i])))
            elif does == STICK:
                for sign in (1, -1):
                    row = -sign * reaction
                    row[0, z.s] = z.rows[i].r0
                    found.append((i, sign, row))
            else:
                found.append((i, 0, _select(z.rate, [i]) * (1 if does == FORWARD else -1)))
        return found

    @cached_property
    def A_arb(self) -> arb_mat:
        return arb_mat(self.A)

    @cached_property
    def A_abs(self) -> arb_mat:
        return _absolute(self.A_arb)

    @cached_property
    def terms(self) -> list[tuple[acb, int]]:
        """The (λ, p) of the terms tᵖ/p! exp(λt)."""
        polynomial = self.A.charpoly().numer()
        found = []
        for factor, multiplicity in polynomial.factor_squarefree()[1]:
            for λ, _ in factor.complex_roots():
                found += [(λ, p) for p in range(multiplicity)]
        return found

    @cached_property
    def spectral(self) -> acb_mat:
        """The matrix from (y, A y, A² y, ...) to the coefficients of the terms."""
        n = self.order
        V = acb_mat(n, n)
        for j, (λ, p) in enumerate(self.terms):
            power = acb(1)
            for k in range(p, n):
                V[k, j] = power * comb(k, p)
                power *= λ
        return V.inv()

    def motion(self, y: arb_mat) -> Motion:
        """Return the motion that begins with y."""
        n = self.order
        powers = acb_mat(n, n)
        for k in range(n):
            for i in range(n):
                powers[k, i] = y[i, 0]
            y = self.A_arb * y
        return Motion(self, self.spectral * powers)


def _absolute(matrix: arb_mat) -> arb_mat:
    return arb_mat(matrix.nrows(), matrix.ncols(), [abs(each) for each in matrix.entries()])


def _exact(matrix: arb_mat) -> arb_mat:
    """Return the midpoints: rounding is judged by `ZERO`, not carried along."""
    return arb_mat(matrix.nrows(), matrix.ncols(), [each.mid() for each in matrix.entries()])


class Motion:
    """y(t) = Σ_j a_j tᵖ/p! exp(λ_j t)."""

    def __init__(self, mode: Mode, coefficients: acb_mat) -> None:
        self.mode, self.coefficients = mode, coefficients
        # Of a conjugate pair the term above the real axis stands for both.
        self.used = [j for j, (λ, _) in enumerate(mode.terms) if not λ.imag < 0]
        self.weight = [2 if mode.terms[j][0].imag > 0 else 1 for j in self.used]

    def at(self, t: arb) -> arb_mat:
        """Return x(t)."""
        y = [arb(0)] * self.mode.order
        for j, weight in zip(self.used, self.weight, strict=True):
            λ, p = self.mode.terms[j]
            φ = (λ * t).exp() * t**p / factorial(p) * weight
            for i in range(self.mode.order):
                y[i] += (self.coefficients[j, i] * φ).real
        return _exact(self.mode.N * arb_mat(self.mode.order, 1, y))

    def signal(self, c: arb_mat) -> Signal:
        """Return g(t) = c·y(t)."""
        b = acb_mat(c) * self.coefficients.transpose()
        terms = [
            (λ, p, (b[0, j] * weight).mid())
            for j, weight in zip(self.used, self.weight, strict=True)
            for λ, p in [self.mode.terms[j]]
        ]
        return Signal([(λ, p, b) for λ, p, b in terms if b != 0])


@lru_cache
def basis(n: int) -> np.ndarray:
    """Return the matrix from the coefficients c of a polynomial on [0, 1] to Bernstein's, B_i = Σ_k C(i, k)/C(n, k) c_k."""
    return np.array([[comb(i, k) / comb(n, k) for k in range(n + 1)] for i in range(n + 1)])


class Signal:
    """g(t) = Σ Re b tᵖ/p! exp(λt)."""

    def __init__(self, terms: list[tuple[acb, int, acb]]) -> None:
        self.terms = terms
        self.rates = [float(abs(λ).mid()) for λ, _, _ in terms]

    def value(self, t: arb) -> arb:
        return sum((((λ * t).exp() * b).real * t**p / factorial(p) for λ, p, b in self.terms), arb(0)).mid()

    def slope(self, t: arb) -> arb:
        found = arb(0)
        for λ, p, b in self.terms:
            φ = (λ * t).exp() * b
            found += (φ * λ).real * t**p / factorial(p)
            if p:
                found += φ.real * t ** (p - 1) / factorial(p - 1)
        return found.mid()

    def first_root(self, order: int, end: arb) -> arb | None:
        """Return the first root in 0 < t <= end of a signal that is positive after 0, or one soon after ``end``."""
        end = end * arb("1.001")
        a, h = arb(0), end
        while a < end:
            h = min(h, end - a, key=lambda each: each.mid())
            amplitude = [
                float(abs((λ * a).exp() * b).mid() * (a + h).mid() ** p / factorial(p)) for λ, p, b in self.terms
            ]
            total = sum(amplitude)
            kept = [i for i, size in enumerate(amplitude) if size > 1e-200 * total]
            # Try to step over the terms that have nearly decayed.
            for least in (1e-3, 1e-6, 1e-12, 1e-24):
                large = [
                    i for i in kept if amplitude[i] > least * total or self.terms[i][0].real > 0 or self.terms[i][1]
                ]
                if len(large) < len(kept) and large:
                    wide = self._width(large, h)
                    if wide > 4 * self._width(kept, h) and self._positive(large, a, wide, amplitude, order):
                        h, kept = wide, []
                        break
            if kept:
                h = self._width(kept, h)
                c = self._taylor(kept, a, h)
                if a == 0:
                    c = c[order:]
                while True:
                    changes, sure = _sign_changes(c)
                    if changes < 2 and sure:
                        break
                    h = h / 2
                    c = [each / 2**k for k, each in enumerate(c)]
                    if h < end * arb(10) ** -60:
                        # A double root, or two that are as near: it grazes zero and is not stopped.
                        changes, h = 0, 4 * h
                        if self.value(a + h) <= 0:
                            return a
                        break
                if changes == 1:
                    return self._refine(a, h, c)
                if kept and self.value(a + h) < 0:
                    raise Undecided("a signal that should be positive is not")
            a, h = (a + h).mid(), h * 8
        return None

    def _width(self, kept: list[int], h: arb) -> arb:
        rate = max(self.rates[i] for i in kept)
        return h if rate == 0.0 else min(h, arb(2.0 / rate), key=lambda each: each.mid())

    def _taylor(self, kept: list[int], a: arb, h: arb) -> list[arb]:
        """Return c_k = g⁽ᵏ⁾(a) hᵏ/k!."""
        angle, degree = float(h) * max(self.rates[i] for i in kept), 16
        while degree < DEGREE and angle ** (degree + 1) > 1e-38 * factorial(degree + 1):
            degree += 1
        with ctx.workprec(BITS // 2):
            found = [arb(0)] * (degree + 1)
            for i in kept:
                λ, p, b = self.terms[i]
                real = λ.imag == 0
                power, μ = (λ * a).exp() * b, λ * h
                if real:
                    power, μ = power.real, μ.real
                series = [power]
                for k in range(1, degree + 1):
                    power = power * μ / k
                    series.append(power)
                if not real:
                    series = [each.real for each in series]
                for j in range(p + 1):
                    # (a + h s)ᵖ/p! = Σ_j (a^(p - j)/(p - j)!) (h^j/j!) sʲ
                    factor = a ** (p - j) / factorial(p - j) * h**j / factorial(j)
                    if factor != 0:
                        for k in range(degree + 1 - j):
                            found[k + j] += series[k] * factor
            return [each.mid() for each in found]

    def _positive(self, large: list[int], a: arb, h: arb, amplitude: list[float], order: int) -> bool:
        """Return whether the large terms stay above what the others are at most, in floats."""
        if a == 0:
            return False
        c = np.array([float(each) for each in self._taylor(large, a, h)])
        rest = sum(size for i, size in enumerate(amplitude) if i not in large)
        return bool((basis(len(c) - 1) @ c).min() > 2.0 * rest + 1e-12 * np.abs(c).sum())

    def _refine(self, a: arb, h: arb, c: list[arb]) -> arb:
        """Return the root in a window that has one: bisection of the Taylor polynomial, then Newton on the signal."""
        low, high, polynomial = arb(0), arb(1), arb_poly(c)
        s = high / 2
        for _ in range(600):
            if polynomial(s).mid() > 0:
                low = s
            else:
                high = s
            if low > 0 and (high - low) < low * arb(2) ** -20:
                break
            s = ((low + high) / 2 if low > 0 else high / 2**8).mid()
        t = (a + h * s).mid()
        for _ in range(12):
            slope = self.slope(t)
            if slope == 0:
                break
            step = (self.value(t) / slope).mid()
            t = (t - step).mid()
            if abs(step) <= abs(t) * arb(10) ** -290:
                break
        if not a + h * low - h * arb(10) ** -6 <= t <= a + h * high + h * arb(10) ** -6:
            raise Undecided("Newton's method left its bracket")
        return t


def _sign_changes(c: list[arb]) -> tuple[int, bool]:
    """Return the sign changes of the Bernstein coefficients of Σ c_k sᵏ on [0, 1], and whether they are beyond doubt."""
    n, size = len(c) - 1, max(abs(each) for each in c)
    if size == 0:
        return 0, True
    B = basis(n) @ np.array([float(each / size) for each in c])
    if (np.abs(B) > 1e-11).all():
        return int((B[1:] * B[:-1] < 0.0).sum()), True
    # Once more with integers, in units of 2^-BITS: B_i are the sums whose differences are c_k/C(n, k).
    parts = [each.man_exp() for each in c]
    unit = max(int(man).bit_length() + int(exp) for man, exp in parts if man != 0) - BITS
    differences = [_shifted(int(man), int(exp) - unit) // comb(n, k) for k, (man, exp) in enumerate(parts)]
    exact = []
    while differences:
        exact.append(differences[0])
        differences = [a + b for a, b in pairwise(differences)]
    signs = [each > 0 for each in exact if each]
    changes = sum(a != b for a, b in pairwise(signs))
    # The remainder of the series is 1e-37 of the terms at s = 1, and of a power of s before it.
    return changes, changes > 1 or abs(exact[-1]) > 2**BITS // 10**36


def _shifted(number: int, by: int) -> int:
    return number << by if by >= 0 else number >> -by


@dataclass(frozen=True)
class Happening:
    """An event: what happened to which contact; the impulse of an impact."""

    t: arb
    kind: str
    contact: str
    impulse: arb = field(default_factory=lambda: arb(0))


@dataclass(frozen=True)
class Segment:
    """One mode from t on."""

    t: arb
    motion: Motion


class Reference:
    """The motion of a problem from 0 to ``end``, or until there are ``enough`` events that stand apart by 1e-6 of that.

    Attributes
    ----------
    events : list of Happening
    segments : list of Segment
    accumulations : list of (t, names)      the limits of impacts without end, and the contacts that they close
    apart : list of float                   the instants of events that stand apart
    """

    def __init__(self, problem: li.Problem, end: float, enough: float = inf, short: float = SHORT) -> None:
        with ctx.workprec(BITS):
            self._run(problem, end, enough, short)

    def _run(self, problem: li.Problem, end: float, enough: float, short: float) -> None:
        self.equations = z = Equations(problem)
        self.end, self.modes = arb(rational(end)), {}
        self.last = -1
        self.events: list[Happening] = []
        self.segments: list[Segment] = []
        self.accumulations: list[tuple[arb, tuple[str, ...]]] = []
        x = arb_mat(z.size, 1)
        for i, node in enumerate(z.nodes):
            x[z.q + i, 0] = arb(rational(problem.q0.get(node, 0.0)))
            x[z.v + i, 0] = arb(rational(problem.v0.get(node, 0.0)))
        for i, each in enumerate(z.s0):
            x[z.s + i, 0] = each
        self.scale = _absolute(x)
        for i in range(z.q, z.s):
            self.scale[i, 0] = max((arb(abs(row.gap)) for row in z.rows), default=arb(0))
        self._grow(x)
        t, does, impacts = arb(0), None, []
        self.apart: list[float] = [0.0]
        while len(self.apart) <= enough:
            if len(self.segments) > MOST:
                raise Undecided("more events than are followed")
            P, x = self._impact(x)
            accumulated: set[int] = set()
            if any(p != 0 for p in P):
                hit = [i for i, p in enumerate(P) if p != 0]
                rates = _absolute(arb_mat(z.rate) * x)
                rest = all(rates[i, 0] < arb(short) ** arb("0.5") * self.scale[z.v, 0] for i in hit)
                if impacts and not rest and t - impacts[-1][0] < self.end * SHORTEST:
                    raise Undecided("impacts of several bodies accumulate faster than 300 digits tell apart")
                impacts.append((t, hit))
                # As many short flights as rows and more, since a row may be missed in a cycle of impacts.
                last = impacts[-3 * z.nc - 1 :]
                if len(last) == 3 * z.nc + 1 and last[-1][0] - last[0][0] < self.end * arb(short):
                    rows = {i for _, hit in last for i in hit}
                    if all(rates[i, 0] < arb(short) ** arb("0.5") * self.scale[z.v, 0] for i in rows):
                        accumulated = rows
            self._note(t, P)
            if accumulated:
                self.accumulations.append((t, tuple(z.rows[i].name for i in sorted(accumulated))))
                x, impacts = self._close(x, accumulated), []
            mode, y = self._choose(x)
            if does is not None:
                self._compare(t, does, mode.does)
            does = mode.does
            motion = mode.motion(y)
            self.segments.append(Segment(t, motion))
            step = self._next(mode, motion, y, self.end - t)
            if step is None:
                return
            self._grow(motion.at(step * arb("0.37")))
            x = motion.at(step)
            t = (t + step).mid()
            if float(t) - self.apart[-1] > 1e-6 * end:
                self.apart.append(float(t))
            self._grow(x)

    def _grow(self, x: arb_mat) -> None:
        """Keep the largest place and the largest velocity so far as the scale of all."""
        z = self.equations
        for first, last in ((z.v, z.q), (z.q, z.s)):
            largest = max([abs(x[i, 0]) for i in range(first, last)] + [self.scale[i, 0] for i in range(first, last)])
            for i in range(first, last):
                self.scale[i, 0] = largest

    def _note(self, t: arb, P: list[arb]) -> None:
        for i, p in enumerate(P):
            if p != 0:
                self.events.append(Happening(t, "impact", self.equations.rows[i].name, p))

    def _compare(self, t: arb, before: tuple[str, ...], after: tuple[str, ...]) -> None:
        for i, (old, new) in enumerate(zip(before, after, strict=True)):
            if old != new:
                kind = {CLOSED: "close", OPEN: "open", STICK: "stick", FORWARD: "slip", BACKWARD: "slip"}[new]
                self.events.append(Happening(t, kind, self.equations.rows[i].name))

    def _close(self, x: arb_mat, rows: set[int]) -> arb_mat:
        """Return the limit of impacts without end: the gaps of these rows and their rates are zero."""
        z = self.equations
        u, U = self._read(z.opening, x), self._read(z.rate, x)
        touching = [i for i in range(z.nc) if i in rows or (z.rows[i].r0 is None and u[i] <= 0 and U[i] <= 0)]
        found = x * 1
        for start, wanted in (
            (z.q, {i: -arb(z.rows[i].gap) for i in touching}),
            (z.v, dict.fromkeys(touching, arb(0))),
        ):
            for j, value in self._balance(x, start, touching, wanted)[1].items():
                if abs(value - x[start + j, 0]) > arb(10) ** -12 * max(self.scale[start + k, 0] for k in range(z.n)):
                    raise Undecided("impacts without end that do not come to rest")
                found[start + j, 0] = value
        return found

    def _read(self, rows: fmpq_mat, x: arb_mat) -> list[arb]:
        """Return rows·x, where what is lost in rounding is zero."""
        rows = arb_mat(rows)
        values, scale = rows * x, _absolute(rows) * self.scale
        return [
            arb(0) if abs(value.mid()) <= ZERO * size else value.mid()
            for value, size in zip(values.entries(), scale.entries(), strict=True)
        ]

    def _impact(self, x: arb_mat) -> tuple[list[arb], arb_mat]:
        """Return the impulses and x after them: 0 <= P ⟂ U⁺ + e min(U⁻, 0) >= 0."""
        z = self.equations
        u, U = self._read(z.opening, x), self._read(z.rate, x)
        P = [arb(0)] * z.nc
        meeting = [i for i in range(z.nc) if z.rows[i].r0 is None and u[i] <= 0]
        gaps, sizes = arb_mat(z.opening) * x, _absolute(arb_mat(z.opening)) * self.scale
        if any(U[i] < 0 for i in meeting) and any(abs(gaps[i, 0].mid()) > NOISE * sizes[i, 0] for i in meeting):
            raise Undecided("impacts of several bodies accumulate faster than 300 digits tell apart")
        if not any(U[i] < 0 for i in meeting):
            return P, x
        if any(U[i] > 0 and any(z.H[i, j] != 0 for j in z.massless) for i in meeting):
            raise Undecided("a plate leaves what it touches, as it may at the start only")
        wanted = {i: -arb(z.rows[i].e) * min(U[i], arb(0)) for i in meeting}
        for count in range(len(meeting) + 1):
            for rows in combinations(meeting, count):
                found = self._impulses(x, list(rows), meeting, wanted)
                if found is not None:
                    after = x * 1
                    for i, p in zip(rows, found[0], strict=True):
                        P[i] = p
                    for j, v in found[1].items():
                        after[z.v + j, 0] = v
                    return P, after
        raise Undecided("no impulses obey the law of impact")

    def _balance(
        self, x: arb_mat, start: int, rows: list[int], wanted: dict[int, arb]
    ) -> tuple[list[arb], dict[int, arb]]:
        """Return P and w with M (w - w⁻) = Hᵀ P and H w = wanted on the rows, where w⁻ are the entries of x from ``start``.

        Of the nodes without mass, where Hᵀ P = 0, w holds those that the rows touch.
        """
        z = self.equations
        light = [j for j in z.massless if any(z.H[i, j] != 0 for i in rows)]
        size = len(rows) + len(light)
        matrix, right = arb_mat(size, size), arb_mat(size, 1)
        for a, i in enumerate(rows):
            for b, k in enumerate(rows):
                matrix[a, b] = arb(sum((z.H[i, j] * z.H[k, j] / z.M[j, j] for j in z.massive), fmpq(0)))
            for b, j in enumerate(light):
                matrix[a, len(rows) + b] = matrix[len(rows) + b, a] = arb(z.H[i, j])
            right[a, 0] = wanted[i] - sum((arb(z.H[i, j]) * x[start + j, 0] for j in z.massive), arb(0))
        solution = _exact(matrix.solve(right)) if size else right
        P = [solution[a, 0] for a in range(len(rows))]
        w = {j: x[start + j, 0] for j in z.massive}
        for p, i in zip(P, rows, strict=True):
            for j in z.massive:
                w[j] = (w[j] + p * arb(z.H[i, j] / z.M[j, j])).mid()
        return P, w | {j: solution[len(rows) + b, 0] for b, j in enumerate(light)}

    def _impulses(
        self, x: arb_mat, rows: list[int], meeting: list[int], wanted: dict[int, arb]
    ) -> tuple[list[arb], dict[int, arb]] | None:
        """Return the impulses of these rows, and the velocities after them, or None if the law of impact is broken."""
        z = self.equations
        try:
            P, v = self._balance(x, z.v, rows, wanted)
        except ZeroDivisionError:
            return None
        zero = ZERO * max(self.scale[z.v + j, 0] for j in range(z.n))
        for p, i in zip(P, rows, strict=True):
            masses = [arb(z.M[j, j]) for j in z.massive if z.H[i, j] != 0]
            if p <= zero * min(masses, default=arb(1)):
                return None
        # A massless node that no impulse reaches may take any velocity that its rows allow: at least ``least``.
        least: dict[int, arb] = {}
        others = [i for i in meeting if i not in rows]
        for _ in range(len(z.massless) + 1):
            for i in others:
                below, above = (
                    next((j for j in range(z.n) if z.H[i, j] == sign), None) for sign in (fmpq(1), fmpq(-1))
                )
                held = arb(0) if above is None else v.get(above, least.get(above))
                if held is None:
                    continue
                if below is not None and below not in v:
                    least[below] = max(least.get(below, held + wanted[i]), held + wanted[i])
                elif (arb(0) if below is None else v[below]) < held + wanted[i] - zero:
                    return None
        return P, v

    def _mode(self, does: tuple[str, ...]) -> Mode | None:
        if does not in self.modes:
            try:
                self.modes[does] = Mode(self.equations, does)
            except Undecided:
                self.modes[does] = None
        return self.modes[does]

    def _choose(self, x: arb_mat) -> tuple[Mode, arb_mat]:
        """Return the mode in which the motion goes on from x, and y."""
        z = self.equations
        kept = _exact(arb_mat(z.kept) * x)
        scale = _absolute(arb_mat(z.kept)) * self.scale
        u = self._read(z.opening, x)
        options = []
        for i, row in enumerate(z.rows):
            fixed = not any(z.H[i, j] != 0 and all(z.C[j, k] == 0 for k in range(z.n)) for j in z.massless)
            if row.r0 is not None:
                options.append((STICK, FORWARD, BACKWARD))
            else:
                options.append((OPEN,) if fixed and u[i] > 0 else (OPEN, CLOSED))
        valid = []
        for does in sorted(product(*options), key=lambda each: each.count(CLOSED)):
            mode = self._mode(does)
            if mode is None or not mode.determined:
                continue
            y = _exact(mode.start * arb_mat(mode.order, 1, [kept[i, 0] for i in mode.chosen]))
            wrong = (mode.kept * y - kept).entries()
            if any(abs(each.mid()) > ZERO * size for each, size in zip(wrong, scale.entries(), strict=True)):
                continue
            if all(self._order(mode, c, y) is not None for _, _, c in mode.watched):
                valid.append((mode, y))
        if not valid:
            raise Undecided("no mode goes on from here")
        first = valid[0]
        for mode, y in valid[1:]:
            if not self._same(first, (mode, y)):
                raise Undecided("more than one motion goes on from here")
        return first

    def _order(self, mode: Mode, c: arb_mat, y: arb_mat) -> int | None:
        """Return the order of the first Taylor coefficient of c·y that is not zero: -1 if none is, None if below zero."""
        size = arb_mat(
            mode.order,
            1,
            [max(abs(a), b) for a, b in zip(y.entries(), (self.scale[j, 0] for j in mode.free), strict=True)],
        )
        c_abs = _absolute(c)
        for k in range(mode.order + 1):
            value, terms = (c * y)[0, 0].mid(), (c_abs * size)[0, 0]
            if abs(value) > ZERO * terms:
                return k if value > 0 else None
            y, size = mode.A_arb * y, mode.A_abs * size
        return -1

    def _same(self, one: tuple[Mode, arb_mat], other: tuple[Mode, arb_mat]) -> bool:
        """Return whether two modes are one motion: what they say differently of a row is zero for ever."""
        differ = [i for i, (a, b) in enumerate(zip(one[0].does, other[0].does, strict=True)) if a != b]
        return all(self._order(mode, c, y) == -1 for mode, y in (one, other) for i, _, c in mode.watched if i in differ)

    def _next(self, mode: Mode, motion: Motion, y: arb_mat, left: arb) -> arb | None:
        """Return after what time the mode ends, if before the end of the run."""
        first = None
        # The one that ended the last mode is the likeliest, and where it ends the search for others may stop.
        for i, _, c in sorted(mode.watched, key=lambda each: each[0] != self.last):
            order = self._order(mode, c, y)
            if order < 0:
                continue
            root = motion.signal(c).first_root(order, left if first is None else first)
            if root is not None and root <= left and (first is None or root < first):
                first, self.last = root, i
        return first

    def at(self, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return q, v and r at t, right limits."""
        with ctx.workprec(BITS):
            exact = arb(rational(t))
            segment = [each for each in self.segments if each.t <= exact][-1]
            x = segment.motion.at((exact - segment.t).mid())
            z = self.equations
            values = np.array([float(each) for each in x.entries()])
            return values[z.q : z.s], values[z.v : z.q], values[: z.nc]
