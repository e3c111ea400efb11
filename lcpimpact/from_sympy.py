r"""Mechanisms of sympy.physics.mechanics as Lagrangian systems.

SymPy derives M(q) v' = F(t, q, v) from points, bodies and forces. M and F are taken as they are: with the kinetic energy
½ vᵀ M v the other forces are

.. math:: Q = F + \frac{∂V}{∂q} + \dot M v - \frac12 \frac{∂ (v^T M v)}{∂q},

so that the equations are SymPy's whatever the energies are. V is known where there is a Lagrangian, V = -L at v = 0.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.problems.base import Problem
from lcpimpact.scheme.lagrangian import FrictionContact, Joint, Lagrangian


class SympyMechanism:
    """A mechanism whose equations SymPy has derived, with numbers for its constants.

    Parameters
    ----------
    equations : LagrangesMethod or KanesMethod
        After `form_lagranges_equations` or `kanes_equations`; the speeds of the latter are q'.
    constants : mapping of Symbol to float
        Values of the other symbols in the equations.

    Raises
    ------
    InputError
        If the equations are not formed, a symbol has no value, or speeds are others than q'.

    Examples
    --------
    A pendulum that strikes a wall:

    >>> from sympy import cos, sin, symbols
    >>> from sympy.physics.mechanics import LagrangesMethod, dynamicsymbols
    >>> from lcpimpact import FrictionContact, SympyMechanism, simulate
    >>> φ, (m, l, g) = dynamicsymbols("φ"), symbols("m l g")
    >>> L = m * l**2 * φ.diff() ** 2 / 2 + m * g * l * cos(φ)
    >>> method = LagrangesMethod(L, [φ])
    >>> _ = method.form_lagranges_equations()
    >>> mechanism = SympyMechanism(method, {m: 1.0, l: 1.0, g: 9.81})
    >>> wall = FrictionContact("wall", gap=mechanism.function(l * (sin(0.3) - sin(φ))), e=0.8)
    >>> problem = mechanism.problem("pendulum", contacts=[wall], q0={"φ": -1.0})
    >>> f"{simulate(problem, dt=1e-4, t_end=1.0).events[0].t:.3f} s"
    '0.636 s'
    """

    def __init__(self, equations: Any, constants: Mapping[Any, float]) -> None:
        try:
            from sympy.physics.mechanics import dynamicsymbols, find_dynamicsymbols
        except ImportError as error:
            raise InputError("SympyMechanism needs SymPy: pip install sympy") from error

        self.constants = dict(constants)
        self.q = list(equations.q)
        self.t = dynamicsymbols._t
        rates = [each.diff(self.t) for each in self.q]
        try:
            M, F = equations.mass_matrix[-len(self.q) :, : len(self.q)], equations.forcing
        except (ValueError, AttributeError, TypeError) as error:
            raise InputError(
                f"the equations of {type(equations).__name__} are not formed ({error}): call form_lagranges_equations() or "
                "kanes_equations() first"
            ) from error
        speeds = list(getattr(equations, "u", None) or rates)
        given: dict[Any, Any] = getattr(equations, "kindiffdict", dict)()
        if len(speeds) != len(self.q) or any(given.get(rate, u) != u for rate, u in zip(rates, speeds, strict=True)):
            raise InputError(
                "the speeds of the mechanism must be the derivatives of its coordinates, u = q', one for each"
            )
        self.v = speeds
        self.same = dict(zip(rates, speeds, strict=True))
        M, F = M.subs(self.same), F[: len(self.q), 0].subs(self.same)
        L = getattr(equations, "_L", None)
        V = 0 * self.t if L is None else -L[0].subs(self.same).subs(dict.fromkeys(speeds, 0))
        v = type(M)(speeds)
        turned = (M * v).jacobian(self.q)
        gyroscopic = -turned * v + turned.T * v / 2
        Q = F - gyroscopic + type(M)([V]).jacobian(self.q).T
        self.M, self.V, self.Q = M, V, Q.applyfunc(lambda each: each.expand().simplify())
        unknown = find_dynamicsymbols(Q) - {*self.q, *speeds}
        free = (M.free_symbols | Q.free_symbols | V.free_symbols) - {self.t, *self.constants}
        if unknown or free:
            names = ", ".join(sorted(map(str, unknown | free)))
            raise InputError(f"{names} of the mechanism have no value: give constants={{symbol: number}}")

    def function(self, expression: Any) -> Callable[..., Any]:
        """Return an expression of t, q and q' as a function for `FrictionContact` or `Joint`, of t, q and, if asked, v."""
        found = self._lambda(expression)
        zero = np.zeros(len(self.q))
        return lambda t, q, v=zero: found(t, q, v)

    def problem(
        self,
        name: str,
        contacts: Sequence[FrictionContact] = (),
        joints: Sequence[Joint] = (),
        q0: Mapping[str, float] | None = None,
        v0: Mapping[str, float] | None = None,
        t_end: float = 1.0,
    ) -> Problem:
        """Return the mechanism with contacts and joints as a problem; its nodes have the names of the coordinates."""
        nodes = [each.func.__name__ for each in self.q]
        M, V, Q = map(self._lambda, (self.M, self.V, self.Q))
        zero = np.zeros(len(nodes))
        system = Lagrangian(
            nodes,
            M=lambda q: M(0.0, q, zero),
            V=lambda q: V(0.0, q, zero),
            Q=lambda t, q, v: np.array(Q(t, q, v)).reshape(len(nodes)),
            contacts=contacts,
            joints=joints,
        )
        return Problem(name, system, q0=q0 or {}, v0=v0 or {}, t_end=t_end)

    def _lambda(self, expression: Any) -> Callable[[float, Array, Array], Any]:
        """Return an expression as a function of t, q and v by NumPy."""
        from sympy import lambdify

        values = expression.subs(self.same).subs(self.constants)
        called = lambdify([self.t, self.q, self.v], values, modules="numpy")
        return lambda t, q, v: called(t, list(q), list(v))
