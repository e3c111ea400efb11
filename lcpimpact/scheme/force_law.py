r"""General forces: functions f(t, q, v) of the time and of the coordinates and velocities of some nodes.

Their Jacobians are given, or found by the complex step

.. math:: \frac{∂f}{∂q_j} = \operatorname{Im} \frac{f(t, q + i ε e_j, v)}{ε}, \qquad ε = 10^{-30},

which has no rounding by subtraction, but needs a function that is analytic. So a Jacobian is compared with differences of f
before a run.

Source: Squire and Trapp, Using complex variables to estimate derivatives of real functions (1998).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.formula import NotTracedError, mentions
from lcpimpact.numerics.rounding import EPS

T = TypeVar("T")

COMPLEX_STEP = 1e-30

PROBE, DIFFERENCE = 1e-3, 1e-7
"""Distance from the start at which a Jacobian is compared with differences, and their step, relative to q or v."""


@dataclass(frozen=True)
class ForceLaw:
    """Forces f(t, q, v) on some nodes, by their own coordinates q and velocities v.

    Attributes
    ----------
    element : str               the element, for messages
    nodes : tuple of k str      the nodes
    f : callable                takes t, q (k,) and v (k,), and returns the forces in N (k,)
    jacobian : callable         takes the same, and returns ∂f/∂q in N/m and ∂f/∂v in N s/m (k, k); None for the complex step
    scalar : bool               whether both take and return numbers in place of arrays, at k = 1
    """

    element: str
    nodes: tuple[str, ...]
    f: Callable[..., ArrayLike]
    jacobian: Callable[..., Sequence[ArrayLike]] | None = None
    scalar: bool = False

    def __post_init__(self) -> None:
        if mentions(self.f):
            raise NotTracedError(f"{self.element}: its force depends on the motion, and formulas do not")

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        """Return the forces (k,)."""
        return self._numbers("f", self._called("f", self.f, t, q, v), (t, q, v), (len(self.nodes),))

    def tangents(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return ∂f/∂q and ∂f/∂v (k, k)."""
        k = len(self.nodes)
        if self.jacobian is None:
            turned = 1j * COMPLEX_STEP * np.eye(k)
            columns = (
                [self._turned(t, q + each, v) for each in turned],
                [self._turned(t, q, v + each) for each in turned],
            )
            return np.column_stack(columns[0]), np.column_stack(columns[1])
        given = self._called("jacobian", self.jacobian, t, q, v)
        if not isinstance(given, tuple | list) or len(given) != 2:
            raise InputError(f"{self.element}: jacobian returns {_short(given)}; return the pair of ∂f/∂q and ∂f/∂v")
        by_q, by_v = (self._numbers("jacobian", each, (t, q, v), (k, k)) for each in given)
        return by_q, by_v

    def check(self, t: float, q: Array, v: Array) -> None:
        """Refuse functions that fail where a run starts, or whose Jacobian near there is not the derivative of f.

        Raises
        ------
        InputError
            If f or its Jacobian has another shape or is not finite, or the Jacobian differs from difference quotients.
        """
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("error", np.exceptions.ComplexWarning)
            self._check(t, q, v)

    def _check(self, t: float, q: Array, v: Array, *, jacobian_rtol: float = 1e-3) -> None:
        # jacobian_rtol: largest difference of a Jacobian from the difference quotients, relative to both.
        for name, values in (("f", self(t, q, v)), ("jacobian", np.array(self.tangents(t, q, v)))):
            if not np.isfinite(values).all():
                raise InputError(
                    f"{self.element}: {self._at(name, t, q, v)} is {values.tolist()} where the run starts; return finite "
                    "numbers"
                )
        sizes = [float(np.abs(each).max()) or 1.0 for each in (q, v)]
        for sign in (PROBE, -PROBE):
            # No two nodes move alike, as the ends of a link that would not notice it.
            moved = [sign * size * (1.0 + 0.1 * np.arange(len(q))) for size in sizes]
            try:
                found = self.tangents(t, q + moved[0], v + moved[1])
                quotients = self._quotients(t, (q + moved[0], v + moved[1]), sizes)
            except InputError:  # outside of where f is defined
                continue
            for name, ours, (theirs, noise) in zip(("∂f/∂q", "∂f/∂v"), found, quotients, strict=True):
                if (np.abs(ours - theirs) > jacobian_rtol * (np.abs(ours) + np.abs(theirs)) + noise).any():
                    self._refuse_jacobian(name, ours, theirs)

    def _quotients(self, t: float, at: tuple[Array, Array], sizes: Sequence[float]) -> list[tuple[Array, float]]:
        """Return the central differences of f by q and by v (k, k), each with its rounding."""
        found = []
        for i, size in enumerate(sizes):
            step = DIFFERENCE * size
            columns = []
            largest = 0.0
            for turned in step * np.eye(len(self.nodes)):
                ahead, behind = (
                    self(t, *(each + sign * turned * (i == of) for of, each in enumerate(at))) for sign in (1.0, -1.0)
                )
                columns.append((ahead - behind) / (2.0 * step))
                largest = max(largest, float(np.abs(ahead).max()))
            slope = np.column_stack(columns)
            terms = largest + float(np.abs(at[i]).max()) * float(np.abs(slope).max())
            found.append((slope, 64.0 * EPS * terms / step))
        return found

    def _refuse_jacobian(self, name: str, ours: Array, theirs: Array) -> None:
        by, remedy = "jacobian", "mend jacobian, or leave it out"
        if self.jacobian is None:
            by = "the complex step"
            remedy = (
                "abs, np.sign and math have none; write np.sqrt(x**2), np.where(x > 0, ...), np.sin, or give jacobian="
            )
        raise InputError(
            f"{self.element}: {name} is {_short(ours)} by {by} where differences of f give {_short(theirs)}: {remedy}"
        )

    def _turned(self, t: float, q: Array, v: Array) -> Array:
        """Return Im f/ε for complex q or v (k,)."""
        value = np.asarray(self._called("f", self.f, t, q, v))
        if value.shape != (() if self.scalar else (len(self.nodes),)):
            self._numbers("f", value, (t, q, v), (len(self.nodes),))
        return np.asarray(np.imag(value) / COMPLEX_STEP, dtype=np.float64).reshape(len(self.nodes))

    def _called(self, name: str, function: Callable[..., T], t: float, q: Array, v: Array) -> T | float | Array:
        """Return the value of a function, NaN at an overflow."""
        try:
            if self.scalar and q.dtype == v.dtype:
                return function(t, q.item(), v.item())
            return function(t, q[0], v[0]) if self.scalar else function(t, q, v)
        except OverflowError:
            return np.nan if self.scalar else np.full(len(self.nodes), np.nan)
        except (TypeError, ValueError, ArithmeticError, LookupError, AttributeError, Warning) as error:
            if np.iscomplexobj(q) or np.iscomplexobj(v):
                raise InputError(
                    f"{self.element}: f fails by {type(error).__name__} ({error}) at complex numbers, which find its "
                    "Jacobian: take np.sin in place of math.sin, or give jacobian="
                ) from error
            raise InputError(
                f"{self.element}: {self._at(name, t, q, v)} fails by {type(error).__name__}: {error}; a function takes "
                "t, q and v"
            ) from error

    def _numbers(self, name: str, value: ArrayLike, at: tuple[float, Array, Array], shape: tuple[int, ...]) -> Array:
        """Return the value of a function as an array of real numbers of a shape."""
        expected = () if self.scalar else shape
        try:
            found = np.asarray(value)
        except ValueError:
            found = np.asarray(None)
        if found.shape != expected or found.dtype.kind not in "fiu":
            what = "a number" if self.scalar else f"real numbers of the shape {expected}"
            raise InputError(f"{self.element}: {self._at(name, *at)} returns {_short(value)}; return {what}")
        return np.asarray(found, dtype=np.float64).reshape(shape)

    def _at(self, name: str, t: float, q: Array, v: Array) -> str:
        """Return the call of a function in words."""
        q_, v_ = (each.item() if self.scalar else each.tolist() for each in (q, v))
        return f"{name}({t!r}, {q_!r}, {v_!r})"


def _short(value: object) -> str:
    """Return a value in a few words."""
    if isinstance(value, np.ndarray) and value.size == 1 and value.dtype.kind in "fiu":
        return f"{value.item():.6g}"
    shown = value.tolist() if isinstance(value, np.ndarray) and value.size <= 4 else value
    return f"an array of the shape {shown.shape}" if isinstance(shown, np.ndarray) else repr(shown)[:60]


def forces(laws: Sequence[ForceLaw], t: float, q: Array, v: Array) -> Array:
    """Return the forces of laws (ng,), with q and v of the nodes of all of them, one law after another (ng,)."""
    found, at = np.empty(len(q)), 0
    for law in laws:
        here = slice(at, at + len(law.nodes))
        found[here], at = law(t, q[here], v[here]), here.stop
    return found


def tangents(laws: Sequence[ForceLaw], t: float, q: Array, v: Array) -> tuple[Array, Array]:
    """Return the derivatives of the forces of laws by q and by v (ng, ng)."""
    by_q = np.zeros((len(q), len(q)))
    by_v = np.zeros((len(q), len(q)))
    at = 0
    for law in laws:
        here = slice(at, at + len(law.nodes))
        by_q[here, here], by_v[here, here] = law.tangents(t, q[here], v[here])
        at = here.stop
    return by_q, by_v
