r"""Linear complementarity systems given by their matrices, for circuits, control and tests of theory.

.. math:: x' = A x + B λ + a(t), \qquad y = C x + D λ + c(t), \qquad
          λ_i = λ_{\min,i} \text{ where } y_i > 0, \quad λ_i = λ_{\max,i} \text{ where } y_i < 0, \quad
          λ_{\min,i} \le λ_i \le λ_{\max,i} \text{ where } y_i = 0

With the bounds 0 and ∞ a row is the contact law 0 <= λ ⟂ y >= 0; with finite bounds it is a *relay*, whose solution is that
of Filippov; without bounds it is an *equation*, y = 0 for any λ, as the loops of a circuit or the constraints of a
descriptor system.

Its coordinates are the states x, its reactions λ. In the terms of a scheme it has no mass, unit damping and the
stiffness -A, so integrators treat it as a scheme; a signal c_i(t) is a node with prescribed motion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arguments import is_name, is_sequence
from lcpimpact.errors import InputError
from lcpimpact.numbers import finite_array, is_real
from lcpimpact.registry import html_of
from lcpimpact.scheme.decomposition import decompose, is_singular
from lcpimpact.scheme.dynamics import Dynamics, law_numbers
from lcpimpact.scheme.laws import CONTACT, JOINT, RELAY
from lcpimpact.scheme.signals import SIGNAL_NAMES, Described, TimeFunction, checked, jumps, loads_of
from lcpimpact.scheme.structure import Contact, Feature, Structure

Signal = float | TimeFunction


@dataclass(frozen=True, eq=False)
class LinearComplementaritySystem:
    r"""x' = A x + B λ + a(t), with lower <= λ <= upper complementary to y = C x + D λ + c(t).

    λ_i is lower_i where y_i > 0, upper_i where y_i < 0, and anything between where y_i = 0.

    Parameters
    ----------
    A : (n, n) array_like
    B : (n, m) array_like
    C : (m, n) array_like
    D : (m, m) array_like, optional
        Zero by default.
    a : sequence of n numbers, signals or functions of time, optional
        Zero by default.
    c : sequence of m numbers or described signals, optional
        Zero by default. A signal is recorded as the coordinate ``c_`` and the name of its multiplier.
    lower, upper : sequence of m numbers, optional
        Bounds of λ, by default 0 and inf. Both are finite for a relay: λ in Sgn(σ) has the bounds -1 and 1 and y = -σ. Both
        are infinite for an equation, y = 0.
    states, multipliers : sequence of str, optional
        Names of x and λ in results: by default x1, x2, ... and λ1, λ2, ...

    Raises
    ------
    InputError
        If shapes do not fit, a number is not finite, names repeat, a row is neither a contact, a relay nor an equation, or a
        contact row has a relative degree of two or more, where x would jump by a law that the matrices do not determine.
        Relays may have any relative degree, equations one up to two; the equations together must determine their λ.

    Examples
    --------
    A capacitor of 1 F that a diode keeps from going below zero, and a current draws down:

    >>> system = LinearComplementaritySystem([[0.0]], [[1.0]], [[1.0]], a=[-1.0])
    >>> system.assemble().contacts[0].relative_degree
    1

    A relay, x' = 1/2 - λ with λ in Sgn(x), reaches x = 0 and slides there with λ = 1/2:

    >>> from lcpimpact import Problem, simulate
    >>> relay = LinearComplementaritySystem([[0.0]], [[-1.0]], [[-1.0]], a=[0.5], lower=[-1.0], upper=[1.0])
    >>> run = simulate(Problem("relay", relay, q0={"x1": 1.0}), "exact", dt=0.5, t_end=3.0)
    >>> [abs(round(x, 12)) for x in run["x1"].tolist()], run["λ1"].tolist()[-1], [event.kind for event in run.events]
    ([1.0, 0.75, 0.5, 0.25, 0.0, 0.0, 0.0], 0.5, ['slide'])

    Two capacitors of 1 F in a loop with a source of 1 V, x1 + x2 = 1, and a resistor of 1 Ω beside the second: the current
    of the loop is the multiplier, and λ = x2/2:

    >>> circuit = LinearComplementaritySystem(
    ...     [[0.0, 0.0], [0.0, -1.0]], [[1.0], [1.0]], [[1.0, 1.0]], c=[-1.0], lower=[-float("inf")]
    ... )
    >>> run = simulate(Problem("loop", circuit, q0={"x2": 1.0}), "exact", dt=0.5, t_end=2.0)
    >>> [round(float(x), 6) for x in (run["x2"][-1], run["λ1"][-1], run["x1"][-1] + run["x2"][-1])]
    [0.367879, 0.18394, 1.0]

    References
    ----------
    Filippov, *Differential Equations with Discontinuous Righthand Sides* (1988).

    Acary, Bonnefon and Brogliato, *Nonsmooth Modeling and Simulation for Switched Circuits* (2011), chapter 2; Kunkel and
    Mehrmann, *Differential-Algebraic Equations* (2006), on equations and their degree.
    """

    A: ArrayLike
    B: ArrayLike
    C: ArrayLike
    D: ArrayLike | None = None
    a: Sequence[Signal] | None = None
    c: Sequence[Signal] | None = None
    states: Sequence[str] | None = None
    multipliers: Sequence[str] | None = None
    lower: Sequence[float] | None = None
    upper: Sequence[float] | None = None

    def __post_init__(self) -> None:
        A = np.atleast_2d(finite_array("A of the system", self.A))
        n = len(A)
        m = np.atleast_2d(finite_array("C of the system", self.C)).shape[0]
        for name, shape in {"A": (n, n), "B": (n, m), "C": (m, n), "D": (m, m)}.items():
            value = getattr(self, name)
            array = np.zeros(shape) if name == "D" and value is None else finite_array(f"{name} of the system", value)
            if array.shape != shape:
                raise InputError(f"{name} of the system has the shape {array.shape}, and A and C ask for {shape}")
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        self._check_inputs(n, m)
        for field, letter, count in (("states", "x", n), ("multipliers", "λ", m)):
            names = getattr(self, field)
            names = tuple(f"{letter}{i + 1}" for i in range(count)) if names is None else tuple(names)
            if len(names) != count or not all(map(is_name, names)):
                raise InputError(f"{field} of the system must hold {count} names")
            object.__setattr__(self, field, names)
        self._check_bounds()
        nodes = self.assemble().nodes
        every = ["t", "t_R", *nodes, *(self.multipliers or ()), *(f"v_{name}" for name in nodes)]
        if len(set(every)) < len(every):
            twice = next(name for name in every if every.count(name) > 1)
            raise InputError(f"the system has two series of the name {twice!r}: rename one by states= or multipliers=")
        self._check_equations()

    def _check_inputs(self, n: int, m: int) -> None:
        """Make a and c tuples of numbers and functions of time."""
        for name, count, each_of, kinds in (
            ("a", n, "state", "numbers or functions of time"),
            ("c", m, "multiplier", f"numbers or {SIGNAL_NAMES}"),
        ):
            given = getattr(self, name)
            if isinstance(given, np.ndarray) and given.ndim == 1:
                given = given.tolist()
            if given is not None and not is_sequence(given):
                raise InputError(f"{name} of the system must be a sequence of {count} {kinds}")
            values = tuple([0.0] * count if given is None else given)
            fits = callable if name == "a" else lambda each: isinstance(each, Described)
            if len(values) != count or not all(fits(each) or is_real(each) for each in values):
                raise InputError(f"{name} of the system must hold {count} finite {kinds}, one for each {each_of}")
            object.__setattr__(self, name, values)

    def _check_bounds(self) -> None:
        """Make the bounds tuples of numbers, and refuse rows that are neither contacts, relays nor equations."""
        m = len(self.multipliers or ())
        for name in ("lower", "upper"):
            given = getattr(self, name)
            if given is None:
                continue
            if isinstance(given, np.ndarray) and given.ndim == 1:
                given = given.tolist()
            if not is_sequence(given) or len(given) != m or not all(map(_is_bound, given)):
                raise InputError(f"{name} of the system must hold {m} numbers or infinities, one for each multiplier")
            object.__setattr__(self, name, tuple(map(float, given)))
        for i, (name, (low, high)) in enumerate(zip(self.multipliers or (), self.bounds, strict=True)):
            if low > high:
                raise InputError(f"lower = {low:g} of {name!r} is above upper = {high:g}: exchange them")
            if low == high:
                raise InputError(
                    f"lower and upper of {name!r} are both {low:g}: a λ that is given is an input, part of a"
                )
            if math.isinf(low) != math.isinf(high) and (low, high) != (0.0, math.inf):
                raise InputError(
                    f"{name!r} has the bounds {low:g} and {high:g}, and a row has 0 and inf, two finite ones, or none: "
                    "count λ from its finite bound, upwards"
                )
            signal = (self.c or ())[i]
            if math.isinf(high) and jumps(signal):
                raise InputError(
                    f"c[{i}] of the system jumps, and so would x, since λ of {name!r} has no upper bound: "
                    "let it rise over a time by a Ramp or a Table"
                )

    @property
    def bounds(self) -> tuple[tuple[float, float], ...]:
        """Lower and upper bound of each multiplier."""
        m = len(self.multipliers or ())
        return tuple(zip(self.lower or m * (0.0,), self.upper or m * (math.inf,), strict=True))

    @cached_property
    def _dynamics(self) -> Dynamics:
        A = np.asarray(self.A)
        B = np.asarray(self.B)
        C = np.asarray(self.C)
        D = np.asarray(self.D)
        states = self.states or ()
        multipliers = self.multipliers or ()
        c = self.c or ()
        constants = [0.0 if callable(each) else float(each) for each in c]
        contacts = tuple(
            Contact(
                name, "", "", constants[i], 0.0, self._degree(i, name),
                JOINT if math.isinf(bounds[0]) else CONTACT if math.isinf(bounds[1]) else RELAY,
                bounds,
            )
            for i, (name, bounds) in enumerate(zip(multipliers, self.bounds, strict=True))
        )  # fmt: skip
        unit = "the unit of its state per second"
        loads = tuple(
            (i, checked(f"a[{i}] of the system", each, unit) if callable(each) else each)
            for i, given in enumerate(self.a or ())
            for each in loads_of(given)
            if callable(each) or each != 0.0
        )
        n = len(A)
        driven = [i for i, each in enumerate(c) if callable(each)]
        more = len(driven)
        nodes = (*states, *(f"c_{multipliers[i]}" for i in driven))
        B = np.pad(B, ((0, more), (0, 0)))
        nothing = np.zeros((n + more, n + more))
        kinds = decompose(nothing, np.eye(n + more), np.arange(n + more) >= n)
        causes = {Feature.MOTIONS: f"node {nodes[n]!r}"} if driven else {}
        return Dynamics(
            Structure(nodes, contacts, kinds, B, causes, stores_energy=False), M=nothing, C=np.eye(n + more),
            K=np.pad(-A, (0, more)), loads=loads, H=np.column_stack([C, np.eye(len(c))[:, driven]]), u0=np.array(constants),
            chi=np.zeros(len(contacts)), B=B, D=D, **law_numbers(contacts),
            motions={n + k: cast(Described, c[i]) for k, i in enumerate(driven)},
        )  # fmt: skip

    def _degree(self, i: int, name: str) -> int:
        """Return the number of derivatives of y_i after which λ appears; if it never does, the number of states."""
        A = np.asarray(self.A)
        B = np.asarray(self.B)
        D = np.asarray(self.D)
        if D[i].any():
            return 0
        row, degree = np.asarray(self.C)[i], 1
        size = np.abs(row)
        while not (feels := bool((np.abs(row @ B) > 1e-12 * (size @ np.abs(B))).any())) and degree < len(A):
            row = row @ A
            size = size @ np.abs(A)
            degree = degree + 1
        low, high = self.bounds[i]
        if math.isinf(low) and (degree > 2 or not feels):
            raise InputError(
                f"the equation of {name!r} does not feel λ before its third derivative, if at all, and they are taken up "
                "to a relative degree of two: differentiate it, C A in place of C, C a + c' of c"
            )
        if (degree > 1 or not feels) and math.isinf(high) and not math.isinf(low):
            raise InputError(
                f"u of {name!r} does not feel λ before its second derivative: x would jump, by a law that A, B, C and D do "
                "not state; give the system as a Scheme of masses and bumpers"
            )
        return degree

    def _check_equations(self) -> None:
        """Refuse equations that do not determine their λ together, and other rows that feel none once these hold."""
        d = self._dynamics
        equations, G = d.bilateral, d.markov
        if not equations.any():
            return
        block = G[np.ix_(equations, equations)]
        if (
            is_singular(block)
            or (np.abs(block).max(axis=1, initial=0.0) <= 1e-12 * np.abs(G[equations]).max(axis=1)).any()
        ):
            combination = np.abs(np.linalg.svd(block)[0][:, -1])
            names = [repr(d.contacts[i].name) for i in np.flatnonzero(equations)[combination > 1e-9]]
            raise InputError(
                f"the equations of {', '.join(names)} do not determine λ: they contradict or repeat one another, or a "
                "combination of them has a higher relative degree; give that combination in place of one of them"
            )
        left = np.abs(G @ d.elimination).max(axis=1, initial=0.0)
        size = (np.abs(G) @ np.abs(d.elimination)).max(axis=1, initial=0.0)
        for i in np.flatnonzero(~equations & (left <= 1e-12 * size) & (size > 0.0)):
            raise InputError(
                f"y of {d.contacts[i].name!r} feels λ only by way of the equations, which cancel it: solve these for "
                "λ, and give the system without them"
            )

    def _repr_html_(self) -> str:
        return html_of(self)

    def assemble(self) -> Dynamics:
        """Return the equations in the form that integrators take."""
        return self._dynamics

    def __eq__(self, other: Any) -> bool:
        return (
            isinstance(other, LinearComplementaritySystem)
            and all(
                np.array_equal(np.asarray(getattr(self, name)), np.asarray(getattr(other, name)))
                for name in ("A", "B", "C", "D", "states", "multipliers")
            )
            and (self.a, self.c, self.bounds) == (other.a, other.c, other.bounds)
        )

    __hash__ = None  # type: ignore[assignment]


def _is_bound(value: Any) -> bool:
    """Return whether a value is a real number or infinite."""
    return is_real(value) or (isinstance(value, float) and math.isinf(value))
