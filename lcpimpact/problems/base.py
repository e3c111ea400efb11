"""A named problem: a scheme, its initial state, its parameters, and where it is from."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property, partial
from typing import Any, Generic, TypeVar, cast, overload

import numpy as np

from lcpimpact.arguments import is_name
from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.formula import number, sqrt
from lcpimpact.memo import Memo
from lcpimpact.numbers import between, finite, is_count
from lcpimpact.numerics.rounding import EPS
from lcpimpact.problems.facts import Fact
from lcpimpact.registry import html_of, nearest
from lcpimpact.scheme.assembly import MAX_NODES
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.elements.body import Body
from lcpimpact.scheme.lagrangian import Lagrangian, LagrangianDynamics
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.scheme.signals import Described, Harmonic, terms_of
from lcpimpact.scheme.sparse_dynamics import SparseDynamics
from lcpimpact.scheme.system import LinearComplementaritySystem

T = TypeVar("T")

ANGULAR = {
    "m": "rad", "m/s": "rad/s", "m/s^(1/2)": "rad/s^(1/2)", "N": "N m", "N s": "N m s", "N/m": "N m/rad",
    "N s/m": "N m s/rad", "kg": "kg m²",
}  # fmt: skip
"""Unit in a problem of angles that stands for one in a problem of displacements."""

GIVEN_ZERO_RTOL = 8.0 * EPS
"""Tolerance for zero in an initial gap, whose data are floats, relative to its terms."""


class Deferred(Generic[T]):
    """A field of a problem given as its value, or as a function that returns it when it is first read."""

    def __init__(self, default: T) -> None:
        self.default = default

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    @overload
    def __get__(self, instance: None, owner: type) -> Deferred[T]: ...
    @overload
    def __get__(self, instance: Problem, owner: type) -> T: ...
    def __get__(self, instance: Problem | None, owner: type) -> Any:
        if instance is None:
            return self
        value = vars(instance)[self.name]
        if callable(value):
            value = vars(instance)[self.name] = _computed(instance.name, instance.parameters, value)
        return value

    def __set__(self, instance: Problem, value: T | Callable[[], T]) -> None:
        vars(instance)[self.name] = value.default if isinstance(value, Deferred) else value


@dataclass(frozen=True)
class Problem(Memo):
    """A scheme with an initial state.

    Parameters
    ----------
    name : str
        How results and messages call it.
    scheme : Scheme, LinearComplementaritySystem or Lagrangian
        The elements, the matrices of a system, or its energies and gaps.
    q0, v0 : mapping of str to float
        Initial coordinates (m) and velocities (m/s) by node; a node that is left out starts at zero.
    t_end : float
        Suggested end time in s, or a function that returns it.
    parameters : mapping of str to float
        The values that the scheme was built from.
    source : str
        Where it is from.
    facts : tuple of Fact
        Its closed-form values, or a function that returns them.
    motion : callable, optional
        The closed form of the motion: takes times (nt,) and returns q and v (nt, n), right limits.
    units : mapping of str to str
        Unit of each coordinate that is not in m: "rad" for an angle, as it is for those of bodies, "" in a dimensionless
        problem.
    note : str
        By how much q0 was changed: bumpers that start penetrated by less than 1e-5 of the largest coordinate or gap, as
        where published data were rounded, are opened by the least change Σ Δq². Runs say so in their message.

    Raises
    ------
    InputError
        If an initial value is for an unknown node or not finite, or a bumper starts penetrated.

    Examples
    --------
    >>> from lcpimpact import Bumper, Load, Mass, Problem, Scheme, simulate
    >>> ball = Scheme(Mass("x", m=1.0), Load("x", f=9.81), Bumper("x", "ground", gap=1.0, e=0.5))
    >>> simulate(Problem("ball", ball), dt=1e-3, t_end=0.5).success
    True
    """

    name: str
    scheme: Scheme | LinearComplementaritySystem | Lagrangian
    q0: Mapping[str, float] = field(default_factory=dict)
    v0: Mapping[str, float] = field(default_factory=dict)
    t_end: Deferred[float] = Deferred(1.0)
    parameters: Mapping[str, float] = field(default_factory=dict)
    source: str = "-"
    facts: Deferred[tuple[Fact, ...]] = field(default=Deferred(()), compare=False, repr=False)
    motion: Callable[[Array], tuple[Array, Array]] | None = field(default=None, compare=False, repr=False)
    units: Mapping[str, str] = field(default_factory=dict)
    note: str = field(default="", compare=False, repr=False)

    @np.errstate(all="ignore")
    def __post_init__(self) -> None:
        if not is_name(self.name):
            raise InputError(
                f"name = {self.name!r} of a problem must be a string that is not empty and has no hidden characters"
            )
        if not isinstance(self.scheme, (Scheme, LinearComplementaritySystem, Lagrangian)):
            raise InputError(
                f"scheme = {self.scheme!r} of problem {self.name!r} must be a Scheme, a LinearComplementaritySystem or a "
                "Lagrangian"
            )
        of = {"q0": "nodes", "v0": "nodes", "parameters": "names", "units": "nodes"}
        for kind, values in ((kind, getattr(self, kind)) for kind in of):
            if not isinstance(values, Mapping):
                what = "strings" if kind == "units" else "numbers"
                raise InputError(f"{kind} = {values!r} of problem {self.name!r} must map {of[kind]} to {what}")
        bodies = [each for each in getattr(self.scheme, "elements", ()) if isinstance(each, Body)]
        angles = {"units": {body.nodes[2]: "rad" for body in bodies}}
        for kind in of:
            object.__setattr__(self, kind, angles.get(kind, {}) | dict(getattr(self, kind)))
        nodes = {node: i for i, node in enumerate(self.dynamics.nodes)}
        for node, unit in self.units.items():
            if node not in nodes:
                raise InputError(f"units of problem {self.name!r}: {nearest(str(node), list(nodes), 'node')}")
            if not isinstance(unit, str):
                raise InputError(f"units[{node!r}] = {unit!r} of problem {self.name!r} must be a string, as 'rad'")
        for kind, values in (("q0", self.q0), ("v0", self.v0)):
            for node, value in values.items():
                if node not in nodes:
                    raise InputError(f"{kind} of problem {self.name!r}: {nearest(str(node), list(nodes), 'node')}")
                finite(f"problem {self.name!r}: {kind}[{node!r}]", value)
                if nodes[node] in self.dynamics.motions:
                    raise InputError(
                        f"{kind}[{node!r}] of problem {self.name!r}: the motion of that node is given, and begins as it "
                        "says; leave the value out"
                    )
        if self.sparse:
            self._refuse_penetration_of_bumpers()
        elif isinstance(self.dynamics, LagrangianDynamics):
            self.dynamics.refuse_start(self.name, self.initial_coordinates, self.initial_velocities)
        elif self.dynamics.stores_energy:
            self._open_touching_bumpers()
            self._refuse_penetration()
            self._refuse_open_joints()
            self._refuse_rates_against_their_law()
        else:
            self._refuse_broken_equations()

    def _open_touching_bumpers(self, *, published_rtol: float = 1e-5) -> None:
        """Open bumpers that start penetrated by the rounding of published data: min |Δq|² with P (u + H Δq) >= 0.

        ``published_rtol``: largest initial penetration that is taken for rounding of published data, relative
        to the largest coordinate or gap.
        """
        q, d = self.initial_coordinates, self.dynamics
        openings = d.gap_paths @ d.gap(0.0, q)
        # A formula of sets side by side takes no branch here: what penetrates is refused, and run alone.
        if q.dtype == object or not len(np.flatnonzero(openings < 0.0)):
            return
        size = max(np.abs(q).max(initial=0.0), np.abs(d.u0[d.impenetrable]).max(initial=0.0))
        deepest = -openings.min(initial=0.0)
        if not GIVEN_ZERO_RTOL * size < deepest <= published_rtol * size:
            return
        joints = d.H[d.bilateral]
        free = ~np.isin(np.arange(len(q)), list(d.motions))
        rows = np.vstack([d.gap_paths @ d.H, joints, -joints]) * free
        change = least_distance(rows, np.concatenate([-openings, np.zeros(2 * len(joints))]))
        if change is None:
            return
        q0 = {d.nodes[i]: float(q[i] + change[i]) for i in map(int, np.flatnonzero(change))}
        note = (
            f"The start was changed by at most {np.abs(change).max():.2g} in q0, as bumpers were penetrated by "
            f"{deepest:.2g} {self.own_unit('m')}"
        )
        vars(self).update(q0={**self.q0, **q0}, note=f"{note.rstrip()}.")

    def _refuse_penetration(self) -> None:
        q, d = self.initial_coordinates, self.dynamics
        sizes = np.abs(q)
        # The rounding of a cos(φ) is relative to a: a table that moves by a sin(ω t) starts 1e-17 m off zero.
        for i, motion in d.motions.items():
            parts = [abs(each.amplitude if isinstance(each, Harmonic) else each(0.0)) for each in terms_of(motion)]
            sizes[i] = max(sizes[i], sum(parts))
        gaps, terms = d.gap(0.0, q), np.abs(d.H) @ sizes + np.abs(d.u0)
        openings = d.gap_paths @ gaps
        # Final positions of another run may penetrate by rounding.
        for k in np.flatnonzero(openings < -GIVEN_ZERO_RTOL * (d.gap_paths @ terms)):
            u, rows = openings[k], np.flatnonzero(d.gap_paths[k])
            first = self.dynamics.contacts[rows[0]]
            if len(rows) == 1:
                moves = [f"lower q0[{first.upper!r}]"] * (first.upper in d.nodes)
                moves += [f"raise q0[{first.lower!r}]"] * (first.lower in d.nodes)
                raise InputError(
                    f"bumper {first.name!r} of problem {self.name!r} starts penetrated by {-u:g} m: "
                    f"{', '.join(moves) or 'move its sides apart in q0'}, or widen its gap"
                )
            names = ", ".join(repr(self.dynamics.contacts[i].name) for i in rows)
            raise InputError(
                f"bumpers {names} of problem {self.name!r} start penetrated by {-u:g} m together, wherever the springs put "
                "the nodes between them: move the bodies apart in q0, or widen a gap"
            )

    def _refuse_penetration_of_bumpers(self) -> None:
        """Refuse bumpers of a sparse scheme that start penetrated, where no quasi-static node can give way."""
        q = self.initial_coordinates
        d = cast(SparseDynamics, self.dynamics)
        u = d.gap(0.0, q)
        below = u < -GIVEN_ZERO_RTOL * (abs(d.H) @ np.abs(q) + np.abs(d.u0))
        if (below := below & (d.relative_degree > 0)).any():
            first = int(np.argmax(below))
            raise InputError(
                f"bumper {d.reactions[first]!r} of problem {self.name!r} starts penetrated by {-u[first]:g} m: move its "
                "sides apart in q0, or widen its gap"
            )

    def _refuse_open_joints(self) -> None:
        d, joints = self.dynamics, self.dynamics.bilateral
        if not joints.any():
            return
        for what, values, start in (
            ("q0", self.initial_coordinates, d.u0),
            ("v0", self.initial_velocities, 0.0 * d.u0),
        ):
            off = d.H @ values + start
            terms = np.abs(d.H) @ np.abs(values) + np.abs(start)
            # Velocities of massless nodes are no states, and places are free where a law is that of a rate.
            held = joints & (~d.of_rate if what == "q0" else d.relative_degree == 2)
            for i in np.flatnonzero(held & (np.abs(off) > GIVEN_ZERO_RTOL * terms)):
                link = d.contacts[i]
                raise InputError(
                    f"the ends of the rigid link {link.name!r} of problem {self.name!r} differ by {off[i]:g} in {what}: "
                    f"give {link.upper!r} and {link.lower!r} equal values"
                )

    def _refuse_rates_against_their_law(self) -> None:
        """Refuse rates between masses that start, or are given, where no reaction but an impulse allows them."""
        d = self.dynamics
        rows = np.flatnonzero(d.one_sided & d.of_rate & (d.relative_degree == 2))
        for i in rows:
            name = f"{d.contacts[i].law.name} {d.contacts[i].name!r} of problem {self.name!r}"
            U = float(d.gap_rate(0.0, self.initial_coordinates, self.initial_velocities)[i])
            if -GIVEN_ZERO_RTOL * float(np.abs(d.H[i]) @ np.abs(self.initial_velocities)) > U:
                raise InputError(f"the {name} starts at the rate {U:g} m/s, and its law is U >= 0: change v0")
            for node in np.flatnonzero(d.H[i] * d.driven):
                motion = d.motions[int(node)]
                if isinstance(motion, Described) and len(motion.breakpoints(0.0, self.t_end)):
                    raise InputError(
                        f"the {name} acts on {d.nodes[node]!r}, whose prescribed velocity may jump against its law: give it "
                        "a motion with a continuous velocity, a Harmonic or a Polynomial"
                    )

    def _refuse_broken_equations(self) -> None:
        """Refuse an initial state with y ≠ 0, or y' ≠ 0, of an equation y = 0 whose multiplier λ does not appear there."""
        d, x = self.dynamics, self.initial_coordinates
        rate = np.where(d.driven, self.initial_velocities, d.force(0.0) - d.K @ x)
        sizes = np.where(d.driven, np.abs(rate), np.abs(d.force(0.0)) + np.abs(d.K) @ np.abs(x))
        for value, terms, degree, what in (
            (d.gap(0.0, x), np.abs(d.H) @ np.abs(x) + np.abs(d.u0), 1, "y"),
            (d.H @ rate, np.abs(d.H) @ sizes, 2, "the rate of y"),
        ):
            off = np.abs(value) > GIVEN_ZERO_RTOL * terms
            for i in np.flatnonzero(d.bilateral & (d.relative_degree >= degree) & off):
                raise InputError(
                    f"{self.name!r} starts off the equation of {d.contacts[i].name!r}: {what} is {value[i]:g}, and no λ "
                    "makes it zero at once; give q0 that satisfies it"
                )

    @cached_property
    def dynamics(self) -> Dynamics:
        """The equations of motion."""
        return self.scheme.assemble()

    @property
    def sparse(self) -> bool:
        """Whether the equations of motion are in sparse matrices, which moreau-jean takes."""
        return isinstance(self.dynamics, SparseDynamics)

    @property
    def dimensionless(self) -> bool:
        """Whether all quantities, the time included, are without unit."""
        return bool(self.units) and not any(self.units.values())

    def unit(self, series: str) -> str:
        """Return the unit of a series of its runs: the time t, a coordinate, a velocity (v_NODE) or a force.

        It is "" without a unit, as for a system given by its matrices. The force on angles alone is a moment in N m, as in
        `own_unit`.

        Examples
        --------
        >>> from lcpimpact import load_problem
        >>> [load_problem("woodpecker").unit(series) for series in ("t", "y", "φ_M", "v_φ_M", "N1")]
        ['s', 'm', 'rad', 'rad/s', 'N']
        """
        second = "" if self.dimensionless else "s"
        nodes = self._nodes
        if series == "t":
            return second
        if isinstance(self.scheme, LinearComplementaritySystem):
            return ""
        if series in nodes:
            return self.units.get(series, "m")
        if series.startswith("v_") and series[2:] in nodes:
            length = self.units.get(series[2:], "m")
            return f"{length}/{second}" if length else ""
        return self.own_unit("N")

    def own_unit(self, unit: str, nodes: Sequence[str] = ()) -> str:
        """Return the unit of the problem, or of some of its nodes, for a quantity in s, m, m/s, N, N s, J, N/m, N s/m or kg.

        It is "" without a unit, as for `unit`. Contacts of angles alone have gaps in rad and moments, but for those of a
        Lagrangian system, whose gaps are lengths.

        Examples
        --------
        >>> from lcpimpact import load_problem
        >>> [load_problem("rocking-block").own_unit(unit) for unit in ("s", "m", "m/s", "N", "N s", "J")]
        ['s', 'rad', 'rad/s', 'N m', 'N m s', 'J']
        """
        if unit == "s":
            return self.unit("t")
        if self.dimensionless or isinstance(self.scheme, LinearComplementaritySystem):
            return ""
        moved = [node for node in nodes if node in self._nodes] or self._nodes
        angles = all(self.units.get(node) == "rad" for node in moved)
        if not nodes and isinstance(self.dynamics, LagrangianDynamics):
            return unit
        return ANGULAR.get(unit, unit) if angles else unit

    @property
    def initial_coordinates(self) -> Array:
        """q(0) in the order of the nodes (n,)."""
        return self._initial(self.q0, 0)

    @property
    def initial_velocities(self) -> Array:
        """v(0) in the order of the nodes (n,)."""
        return self._initial(self.v0, 1)

    @cached_property
    def _nodes(self) -> frozenset[str]:
        return frozenset(self.dynamics.nodes)

    def _repr_html_(self) -> str:
        return html_of(self)

    def _initial(self, given: Mapping[str, float], derivative: int) -> Array:
        d = self.dynamics
        found = {node: number(given.get(node, 0.0)) for node in d.nodes}
        if d.motions:
            driven = d.motion(0.0)[derivative]
            found |= dict(zip((d.nodes[i] for i in sorted(d.motions)), driven, strict=True))
        return np.array([*found.values()])


def least_distance(A: Array, b: Array) -> Array | None:
    """Return the shortest x (n,) with A x >= b, by non-negative least squares; None if there is none.

    References
    ----------
    Lawson and Hanson, *Solving Least Squares Problems* (1974), chapter 23.
    """
    from scipy.optimize import nnls

    scale = np.abs(b).max()
    E = np.vstack([A.T, b / scale])
    f = np.append(np.zeros(A.shape[1]), 1.0)
    r = E @ nnls(E, f)[0] - f
    return None if r[-1] >= -GIVEN_ZERO_RTOL else scale * r[:-1] / -r[-1]


def build(name: str, builder: Callable[..., Problem], parameters: Mapping[str, float]) -> Problem:
    """Call a builder of the registry, after a check of the names and values of the parameters."""
    known = defaults(builder)
    for key, value in parameters.items():
        if key not in known:
            raise InputError(nearest(key, list(known), f"parameter of {name}"))
        finite(f"{name}: {key}", value)
    return _computed(name, parameters, partial(builder, **{key: number(value) for key, value in parameters.items()}))


@cache
def defaults(builder: Callable[..., Problem]) -> dict[str, float | None]:
    """Return the parameters of a builder and their defaults; None for one that follows from the others."""
    return {key: each.default for key, each in inspect.signature(builder).parameters.items()}


def _computed(name: str, parameters: Mapping[str, float], compute: Callable[[], T]) -> T:
    """Return the value of a function of parameters, and refuse those that are too large or small for floats."""
    try:
        return compute()
    except InputError:
        raise
    except (ArithmeticError, ValueError, MemoryError) as error:
        text = ", ".join(f"{key} = {value:g}" for key, value in parameters.items())
        raise InputError(f"{name} cannot be computed with {text} ({error}): take values nearer to 1") from None


def falling_speed(name: str, g: float, h_o: float, v_o: float | None) -> float:
    """Return v_o, or if it is None sqrt(2 g h_o), the speed after a fall from rest."""
    if v_o is not None:
        return v_o
    if g * h_o < 0.0:
        raise InputError(f"{name}: g = {g:g} and h_o = {h_o:g} give no speed of fall; make both positive, or give v_o")
    return sqrt(2.0 * g * h_o)


def above_zero(name: str, **values: float) -> None:
    """Check that parameters of a problem are positive."""
    for symbol, value in values.items():
        if not value > 0.0:
            raise InputError(f"{name}: {symbol} = {value:g} must be above zero")


def not_negative(name: str, **values: float) -> None:
    """Refuse parameters of a problem that are below zero."""
    for symbol, value in values.items():
        if not value >= 0.0:
            raise InputError(f"{name}: {symbol} = {value:g} must not be negative")


def restitution(name: str, e: float) -> None:
    """Check that a coefficient of restitution is between 0 and 1."""
    between(f"{name}: e", e, 0.0, 1.0)


def whole(name: str, symbol: str, value: float, least: int = 1) -> int:
    """Return a number of bodies as an int, after a check that it is a whole number within the limits."""
    if not is_count(value) or not least <= value <= MAX_NODES:
        raise InputError(
            f"{name}: {symbol} = {value:g} must be a whole number, at least {least} and at most {MAX_NODES:,}"
        )
    return int(value)
