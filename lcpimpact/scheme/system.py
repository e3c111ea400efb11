r"""Linear complementarity systems given by their matrices, for circuits, control and tests of theory.

.. math:: x' = A x + B λ + a(t), \qquad 0 \le λ \perp C x + D λ + c \ge 0

Its coordinates are the states x, its reactions λ. In the terms of a scheme it has no mass, unit damping and the
stiffness -A, so integrators treat it as a scheme.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arguments import is_name, is_sequence
from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.numbers import is_real
from lcpimpact.scheme.dynamics import Contact, Dynamics
from lcpimpact.scheme.signals import checked

Signal = float | Callable[[float], float]


@dataclass(frozen=True, eq=False)
class LinearComplementaritySystem:
    r"""x' = A x + B λ + a(t), 0 <= λ ⟂ C x + D λ + c >= 0.

    Parameters
    ----------
    A : (n, n) array_like
    B : (n, m) array_like
    C : (m, n) array_like
    D : (m, m) array_like, optional
        Zero by default.
    a : sequence of n numbers, signals or functions of time, optional
        Zero by default.
    c : (m,) array_like, optional
        Zero by default.
    states, multipliers : sequence of str, optional
        Names of x and λ in results: by default x1, x2, ... and λ1, λ2, ...

    Raises
    ------
    InputError
        If shapes do not fit, a number is not finite, names repeat, or a row of λ has a relative degree of two or
        more, where x would jump by a law that the matrices do not determine.

    Examples
    --------
    A capacitor of 1 F that a diode keeps from going below zero, and a current draws down:

    >>> system = LinearComplementaritySystem([[0.0]], [[1.0]], [[1.0]], a=[-1.0])
    >>> system.assemble().contacts[0].relative_degree
    1

    References
    ----------
    Acary, Bonnefon and Brogliato, *Nonsmooth Modeling and Simulation for Switched Circuits* (2011), chapter 2.
    """

    A: ArrayLike
    B: ArrayLike
    C: ArrayLike
    D: ArrayLike | None = None
    a: Sequence[Signal] | None = None
    c: ArrayLike | None = None
    states: Sequence[str] | None = None
    multipliers: Sequence[str] | None = None

    def __post_init__(self) -> None:
        A = np.atleast_2d(self._array("A", self.A))
        n = len(A)
        m = np.atleast_2d(self._array("C", self.C)).shape[0]
        fill = {"D": np.zeros((m, m)), "c": np.zeros(m)}
        shapes = {"A": (n, n), "B": (n, m), "C": (m, n), "D": (m, m), "c": (m,)}
        for name, shape in shapes.items():
            value = getattr(self, name)
            array = fill[name] if value is None and name in fill else self._array(name, value)
            if array.shape != shape:
                raise InputError(f"{name} of the system has the shape {array.shape}, and A and C ask for {shape}")
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        if self.a is not None and not is_sequence(self.a):
            raise InputError(f"a of the system must be a sequence of {n} numbers or functions of time")
        a = tuple([0.0] * n if self.a is None else self.a)
        if len(a) != n or not all(callable(each) or is_real(each) for each in a):
            raise InputError(f"a of the system must hold {n} finite numbers or functions of time, one for each state")
        object.__setattr__(self, "a", a)
        for field, letter, count in (("states", "x", n), ("multipliers", "λ", m)):
            names = getattr(self, field)
            names = tuple(f"{letter}{i + 1}" for i in range(count)) if names is None else tuple(names)
            if len(names) != count or not all(map(is_name, names)):
                raise InputError(f"{field} of the system must hold {count} names")
            object.__setattr__(self, field, names)
        every = ["t", "t_R", *self.names, *(f"v_{name}" for name in self.states or ())]
        if len(set(every)) < len(every):
            twice = next(name for name in every if every.count(name) > 1)
            raise InputError(f"the system has two series of the name {twice!r}: rename one by states= or multipliers=")
        self.assemble()

    @property
    def names(self) -> tuple[str, ...]:
        """The states and the multipliers."""
        return (*(self.states or ()), *(self.multipliers or ()))

    def _array(self, name: str, value: Any) -> Array:
        try:
            array = np.array(value, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            raise InputError(f"{name} of the system must be a matrix of numbers") from None
        if not np.isfinite(array).all():
            raise InputError(f"{name} of the system holds a number that is not finite")
        return array

    @cached_property
    def _dynamics(self) -> Dynamics:
        A, B, C, D, c = (np.asarray(each) for each in (self.A, self.B, self.C, self.D, self.c))
        states, multipliers = self.states or (), self.multipliers or ()
        contacts = tuple(
            Contact(name, "", "", float(c[i]), 0.0, self._degree(i, name)) for i, name in enumerate(multipliers)
        )
        unit = "the unit of its state per second"
        loads = tuple(
            (i, checked(f"a[{i}] of the system", each, unit) if callable(each) else each)
            for i, each in enumerate(self.a or ())
            if callable(each) or each != 0.0
        )
        n = len(A)
        zero, identity = np.zeros((n, n)), np.eye(n)
        return Dynamics(
            nodes=tuple(states), M=zero, C=identity, K=-A, loads=loads, H=C, u0=c, contacts=contacts, B=B, D=D,
            stores_energy=False,
        )  # fmt: skip

    def _degree(self, i: int, name: str) -> int:
        B, C, D = np.asarray(self.B), np.asarray(self.C), np.asarray(self.D)
        if D[i].any():
            return 0
        terms = np.abs(C[i]) @ np.abs(B)
        if (np.abs(C[i] @ B) > 1e-12 * terms).any():
            return 1
        raise InputError(
            f"u of {name!r} does not feel λ before its second derivative: x would jump, by a law that A, B, C and D do "
            "not state; give the system as a Scheme of masses and bumpers"
        )

    def assemble(self) -> Dynamics:
        """Return the equations in the form that integrators take."""
        return self._dynamics

    def __eq__(self, other: Any) -> bool:
        return isinstance(other, LinearComplementaritySystem) and all(
            np.array_equal(np.asarray(getattr(self, name)), np.asarray(getattr(other, name)))
            for name in ("A", "B", "C", "D", "a", "c", "states", "multipliers")
        )

    __hash__ = None  # type: ignore[assignment]
