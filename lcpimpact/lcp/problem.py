r"""The linear complementarity problem with bounds, and its solution.

.. math:: w = M z + q, \qquad lower \le z \le upper, \qquad
          w_i \ge 0 \text{ if } z_i < upper_i, \quad w_i \le 0 \text{ if } z_i > lower_i

lower = 0, upper = inf is the LCP 0 <= z ⟂ w >= 0. Finite bounds give a boxed LCP (dry-friction slider); a row without
bounds is free and requires w_i = 0 (mixed LCP).
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array, Vector
from lcpimpact.compiled import compiled
from lcpimpact.errors import InputError, Status
from lcpimpact.lcp.operators import Delassus, real_array
from lcpimpact.lcp.trace import Trace
from lcpimpact.registry import html_of, load

LOWER = -1
FREE = 0
UPPER = 1
"""Sides of a row in a complementary basis: at a bound, or between them with w = 0."""

UNKNOWN_SIDE = 2
"""Side of a row not yet identified."""


class LCP(NamedTuple):
    """An LCP with bounds.

    Attributes
    ----------
    M : Delassus
    q, lower, upper : (n,) arrays
    """

    M: Delassus
    q: Array
    lower: Array
    upper: Array


class LCPSolution(NamedTuple):
    """The solution of an LCP, checked independently of the solver.

    Attributes
    ----------
    z, w : (n,) arrays      the solution and w = M z + q
    status : Status
    residual : float        ‖z - P(z - w)‖_inf / max(1, ‖q‖_inf); for an LCP ‖min(z, w)‖_inf / max(1, ‖q‖_inf)
    iterations : int        pivots, sweeps or backend iterations
    solver : str            name of the requested solver
    route : tuple of str    the methods run in order; the last gave the solution
    ray : (n,) array        with the status RAY: certificate v that there is no solution, for an LCP
                            v >= 0, Mᵀ v <= 0, q·v < 0; else None
    trace : Trace           the pivots or iterates, if requested; else None
    problem : LCP           the problem solved
    """

    z: Array
    w: Array
    status: Status
    residual: float
    iterations: int
    solver: str
    route: tuple[str, ...]
    ray: Array | None = None
    trace: Trace | None = None
    problem: LCP | None = None

    @property
    def success(self) -> bool:
        """Whether the status is SOLVED."""
        return self.status is Status.SOLVED

    @property
    def message(self) -> str:
        """Description of the status, with its remedy."""
        return self.status.sentence_of(self.solver)

    @property
    def explanation(self) -> str:
        """The method that gave the solution, and the methods that failed before."""
        *failed, last = self.route
        before = f" after {', '.join(failed)} had given no answer that holds" if failed else ""
        return f"{self.solver}: {last}{before} ({self.iterations} iterations, residual {self.residual:.1e})"

    def derivative(
        self,
        dM: Any = None,
        dq: ArrayLike | None = None,
        *,
        dlower: ArrayLike | None = None,
        dupper: ArrayLike | None = None,
        one_sided: bool = False,
    ) -> Array:
        r"""Differentiate z where M, q and the bounds change at the rates dM, dq, dlower and dupper.

        With α the rows between their bounds and β those at a bound, of the rate db,

        .. math:: dz_β = db_β, \qquad M_{αα}\, dz_α = -(dq + dM\, z + M_{αβ}\, db_β)_α,

        where the solution is strictly complementary: w_i ≠ 0 at every bound. At a tie, z_i at a bound and w_i = 0, only the
        derivative in one direction exists, which solves an LCP itself: between the rows α, with dw = 0, and those with
        w_i ≠ 0, with dz = db, a tie at its lower bound has

        .. math:: 0 \le dz_i - db_i \perp (M\, dz + dq + dM\, z)_i \ge 0,

        and one at its upper bound both signs reversed.

        Parameters
        ----------
        dM : (n, n) array_like, sparse matrix or `Delassus`, optional
            Rate of M, in any form that M may have; by default 0. Only dM z counts, and may be added to dq instead.
        dq : (n,) array_like, optional
            Rate of q; by default 0.
        dlower, dupper : float or (n,) array_like, optional
            Rates of the bounds; by default 0.
        one_sided : bool
            Whether ties have the derivative for changes in this direction, and not in the opposite one, instead of an error.

        Returns
        -------
        (n,) array

        Raises
        ------
        InputError
            For rates of the wrong shape or kind, or if M, q or z were changed since the solution.
        UnsupportedError
            If there is no derivative: at a tie without ``one_sided``, for singular M_αα, if several solutions continue this
            one, or for a status other than SOLVED; or if the solution is too inexact to say which rows are at a bound.

        Examples
        --------
        z = -q/2 while q < 0, and 0 while q > 0:

        >>> from lcpimpact import solve_lcp
        >>> solve_lcp([[2.0]], [-5.0]).derivative(dq=[1.0])
        array([-0.5])
        >>> tie = solve_lcp([[2.0]], [0.0])
        >>> [tie.derivative(dq=[d], one_sided=True) for d in (1.0, -1.0)]
        [array([0.]), array([0.5])]

        References
        ----------
        Cottle, Pang and Stone, *The Linear Complementarity Problem* (1992), chapter 7.
        """
        found: Array = load("lcpimpact.lcp.derivative:derivative")(self, dM, dq, dlower, dupper, one_sided)
        return found

    def _repr_html_(self) -> str:
        return html_of(self)


@compiled()
def is_plain(lower: Vector, upper: Vector) -> bool:
    """Return whether lower = 0 and upper = inf."""
    plain = True
    for i in range(len(lower)):
        plain = plain and lower[i] == 0.0 and upper[i] == np.inf
    return plain


@lru_cache(maxsize=256)
def unbounded_above(n: int) -> tuple[Array, Array]:
    """Return lower = 0 and upper = inf of an LCP of order n; read only."""
    return np.zeros(n), np.full(n, np.inf)


def bounds(n: int, lower: ArrayLike | None, upper: ArrayLike | None) -> tuple[Array, Array, bool]:
    """Return the bounds as (n,) arrays, by default 0 and inf, and whether they differ from this default.

    Raises
    ------
    InputError
        If a bound is neither one number nor n numbers, is NaN, or lower exceeds upper.
    """
    default = unbounded_above(n)
    if lower is None and upper is None:
        return (*default, False)
    found = []
    for name, given, usual in (("lower", lower, default[0]), ("upper", upper, default[1])):
        array = usual if given is None else real_array(name, given)
        if array.shape not in ((), (n,)) or np.isnan(array).any():
            raise InputError(
                f"{name} must be one number or {n} numbers (inf where there is no bound), and it is {given!r}"
            )
        found.append(np.array(np.broadcast_to(array, (n,))))
    low, high = found
    if not (low <= high).all() or (low == np.inf).any() or (high == -np.inf).any():
        i = int(np.argmax((low > high) | (low == np.inf) | (high == -np.inf)))
        raise InputError(f"lower[{i}] = {low[i]:g} and upper[{i}] = {high[i]:g} leave no value: need lower <= upper")
    return low, high, bool((low != 0.0).any() or (high != np.inf).any())
