r"""Lagrangian systems: bodies that turn, joints, and contacts with friction, given by their energies and their gaps.

.. math:: M(q) \dot v = F(t, q, v) + H_N^T r_N + H_T^T r_T + H_J^T r_J, \qquad
          F = Q - \frac{∂V}{∂q} - \dot M v + \frac12 \frac{∂ (v^T M v)}{∂q},

.. math:: 0 \le g \perp r_N \ge 0, \qquad -μ r_N \le r_T \le μ r_N \perp U_T, \qquad g_J = 0 .

A user writes M(q), V(q), other forces Q(t, q, v), the gaps g(t, q) and the rates U_T(t, q, v) at which surfaces slide. All
else follows by differentiation of what is traced (`lcpimpact.scheme.motion_function`): the gyroscopic terms, H = ∂g/∂q,
χ = ∂g/∂t, the tangential rows from U_T = H_T v + χ_T, and κ in U' = H v' + κ.

`LagrangianDynamics.at` gives the system frozen at a time, a place and a velocity: the linear one

.. math:: M \ddot q + C (\dot q - v) + K (q' - q) = F + H^T r, \qquad C = -\frac{∂F}{∂v}, \quad K = -\frac{∂F}{∂q},

of which integrators take their steps.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arguments import is_name, is_sequence
from lcpimpact.arrays import Array, Flags
from lcpimpact.errors import InputError
from lcpimpact.formula import Formula, Number
from lcpimpact.numbers import between, finite
from lcpimpact.numerics.rounding import EPS
from lcpimpact.registry import html_of
from lcpimpact.scheme.decomposition import decompose
from lcpimpact.scheme.dynamics import Dynamics, law_numbers
from lcpimpact.scheme.laws import FRICTION, JOINT
from lcpimpact.scheme.motion_function import MotionArguments, MotionFunction
from lcpimpact.scheme.structure import Contact, Feature, Structure

UNBOUNDED = -np.inf, np.inf

START_RTOL = 1e-9
"""Openings of joints and penetrations of contacts at a start, relative to their terms, that are rounding."""

Gap = Callable[[float, Array], ArrayLike | Number]
Slip = Callable[[float, Array, Array], ArrayLike | Number]


@dataclass(frozen=True)
class FrictionContact:
    r"""A contact with a gap g(t, q) >= 0, and with friction where a slip rate is given.

    .. math:: 0 \le g \perp r_N \ge 0, \qquad -μ r_N \le r_T \le μ r_N, \quad\text{complementary to}\quad U_T

    Parameters
    ----------
    name : str
        The name of the normal reaction r_N in results; that of the friction r_T is ``name`` and ``_T``.
    gap : callable
        g(t, q) in m, with q (n,).
    slip : callable, optional
        U_T(t, q, v) in m/s, the rate at which the surfaces slide at the point of contact, linear in v (n,).
    mu : float
        Coefficient of friction.
    e, e_T : float
        Normal and tangential coefficient of restitution, in [0, 1].

    Raises
    ------
    InputError
        If a number is out of its range, or friction is given without a slip rate.
    """

    name: str
    gap: Gap
    slip: Slip | None = None
    mu: float = 0.0
    e: float = 0.0
    e_T: float = 0.0

    def __post_init__(self) -> None:
        _check_row("contact", self.name, self.gap)
        finite(f"mu of contact {self.name!r}", self.mu, least=0.0)
        between(f"e of contact {self.name!r}", self.e, 0.0, 1.0)
        between(f"e_T of contact {self.name!r}", self.e_T, 0.0, 1.0)
        if self.slip is None and (self.mu > 0.0 or self.e_T > 0.0):
            raise InputError(
                f"contact {self.name!r} has friction, and no slip: give slip=, the rate U_T(t, q, v) of the surfaces"
            )
        if self.slip is not None and not callable(self.slip):
            raise InputError(f"slip = {self.slip!r} of contact {self.name!r} must be a function of t, q and v")


@dataclass(frozen=True)
class Joint:
    """A joint g(t, q) = 0, whose reaction has any sign.

    Parameters
    ----------
    name : str
        The name of the reaction in results.
    gap : callable
        g(t, q) in m or rad, with q (n,).
    """

    name: str
    gap: Gap

    def __post_init__(self) -> None:
        _check_row("joint", self.name, self.gap)


@dataclass(frozen=True, eq=False)
class Lagrangian:
    r"""A system given by its energies, forces, contacts and joints.

    Functions are written in arithmetic and NumPy's elementary functions, without cases; they are called once, with formulas.

    Parameters
    ----------
    nodes : str or sequence of str
        Names of the coordinates, as "x y φ".
    M : callable
        Mass matrix M(q) (n, n), symmetric and positive definite: the kinetic energy is ½ vᵀ M v.
    V : callable, optional
        Potential energy V(q) in J; 0 by default.
    Q : callable, optional
        Other forces Q(t, q, v) in N or N m (n,).
    contacts : sequence of FrictionContact
    joints : sequence of Joint

    Raises
    ------
    InputError
        Naming the function that fails, has another shape or is no arithmetic; names that repeat; a slip rate that is not
        linear in v.

    Examples
    --------
    A ball of radius 0.1 m that is dropped with spin on a rough floor:

    >>> import numpy as np
    >>> from lcpimpact import FrictionContact, Lagrangian, Problem, simulate
    >>> R = 0.1
    >>> ball = Lagrangian(
    ...     "x y φ", M=lambda q: np.diag([1.0, 1.0, 0.4 * R**2]), V=lambda q: 9.81 * q[1],
    ...     contacts=[
    ...         FrictionContact(
    ...             "floor", gap=lambda t, q: q[1] - R, slip=lambda t, q, v: v[0] + R * v[2], mu=0.2, e=0.5
    ...         )
    ...     ],
    ... )
    >>> run = simulate(Problem("ball with spin", ball, q0={"y": 0.6}, v0={"φ": 50.0}), dt=1e-3, t_end=1.0)
    >>> run.success, run.events[0].kind
    (True, 'impact')

    References
    ----------
    Glocker, *Set-Valued Force Laws* (2001); Acary and Brogliato, *Numerical Methods for Nonsmooth Dynamical Systems* (2008),
    chapter 3.
    """

    nodes: str | Sequence[str]
    M: Callable[[Array], ArrayLike]
    V: Callable[[Array], ArrayLike] | None = None
    Q: Callable[[float, Array, Array], ArrayLike] | None = None
    contacts: Sequence[FrictionContact] = ()
    joints: Sequence[Joint] = ()

    def __post_init__(self) -> None:
        nodes = tuple(self.nodes.split()) if isinstance(self.nodes, str) else tuple(self.nodes)
        if not nodes or not all(map(is_name, nodes)):
            raise InputError(f"nodes = {self.nodes!r} of a Lagrangian system must be names of coordinates, as 'x y φ'")
        object.__setattr__(self, "nodes", nodes)
        for name, kind in (("contacts", FrictionContact), ("joints", Joint)):
            given = getattr(self, name)
            if not is_sequence(given) or not all(isinstance(each, kind) for each in given):
                raise InputError(f"{name} = {given!r} of a Lagrangian system must be a sequence of {kind.__name__}")
            object.__setattr__(self, name, tuple(given))
        for name in "MVQ":
            function = getattr(self, name)
            if not callable(function) and (name == "M" or function is not None):
                raise InputError(f"{name} = {function!r} of a Lagrangian system must be a function")
        self.assemble()

    def assemble(self) -> LagrangianDynamics:
        """Return the equations of motion in the form that integrators take."""
        return self._dynamics

    @cached_property
    def _dynamics(self) -> LagrangianDynamics:
        nodes = tuple(self.nodes)
        n = len(nodes)
        x = MotionArguments.of(n)
        M = x.call("M", self.M, "q", (n, n))
        V = x.call("V", self.V, "q", ()) if self.V else np.array(0.0, dtype=object)
        Q = x.call("Q", self.Q, "tqv", (n,)) if self.Q else np.full(n, 0.0, dtype=object)
        return equations_of_motion(nodes, x, M, V, Q, traced_rows((*self.contacts, *self.joints), x))

    def __eq__(self, other: object) -> bool:
        """Return whether nodes, laws, and functions with their constants are the same arithmetic."""
        return isinstance(other, Lagrangian) and self._arithmetic == other._arithmetic

    def __hash__(self) -> int:
        return hash(self._arithmetic)

    @property
    def _arithmetic(self) -> tuple[Hashable, ...]:
        d = self._dynamics
        functions = (d.inertia, d.forces_of, d.rows_of, d.supplied_of)
        return d.nodes, d.contacts, *(each.written for each in functions)

    def __reduce__(self) -> tuple[Callable[..., Lagrangian], tuple[object, ...]]:
        """Pickle the functions, or what builds them again, as `lcpimpact.problems.registered` says; not what is traced."""
        given = (self.nodes, self.M, self.V, self.Q, self.contacts, self.joints)
        found: tuple[Callable[..., Lagrangian], tuple[object, ...]] = vars(self).get("rebuilt_by", (Lagrangian, given))
        return found

    def _repr_html_(self) -> str:
        return html_of(self)


class TracedRow(NamedTuple):
    """One row: its law, its gap g, U = H v + χ, and κ in U' = H v' + κ, as formulas."""

    contact: Contact
    g: Number
    H: Array
    chi: Number
    kappa: Number

    @classmethod
    def of_gap(cls, contact: Contact, gap: Gap, x: MotionArguments) -> TracedRow:
        """Return the row of a gap g(t, q)."""
        g = x.call(f"gap of {contact.name!r}", gap, "tq", ())
        (χ,) = x.program.derivatives([g.item()], x.t)
        return cls(contact, g.item(), x.by(g, x.q), χ, x.rate(x.rate(g)).item())

    @classmethod
    def of_slip(cls, contact: Contact, slip: Slip, x: MotionArguments) -> TracedRow:
        """Return the row of a slip rate, which must be linear in v."""
        name = contact.name.removesuffix("_T")
        U = x.call(f"slip of {name!r}", slip, "tqv", ())
        χ = replace(x, v=0.0 * x.v).call(f"slip of {name!r}", slip, "tqv", ())
        H = x.by(U, x.v)
        in_v = x.program.depending_on(list(x.v))
        if any(isinstance(each, Formula) and each.name in in_v for each in H):
            raise InputError(
                f"slip of {name!r} is not linear in v: return a row H_T(t, q) times v, and a rate χ_T(t, q)"
            )
        return cls(contact, 0.0, H, χ.item(), x.rate(U).item())


def traced_rows(laws: Iterable[FrictionContact | Joint], x: MotionArguments, *, before: int = 0) -> list[TracedRow]:
    """Return the rows of contacts and joints, which stand behind a number of others."""
    found: list[TracedRow] = []
    for each in laws:
        if isinstance(each, Joint):
            found.append(TracedRow.of_gap(Contact(each.name, "", "", 0.0, 0.0, 2, JOINT, UNBOUNDED), each.gap, x))
            continue
        found.append(TracedRow.of_gap(Contact(each.name, "", "", 0.0, each.e, 2), each.gap, x))
        if each.slip is not None:
            name, μ, normal = f"{each.name}_T", each.mu, before + len(found) - 1
            law = Contact(name, "", "", 0.0, each.e_T, 2, FRICTION, UNBOUNDED, μ, μ, normal)
            found.append(TracedRow.of_slip(law, each.slip, x))
    return found


def equations_of_motion(
    nodes: tuple[str, ...], x: MotionArguments, M: Array, V: Array, Q: Array, rows: Sequence[TracedRow]
) -> LagrangianDynamics:
    """Return the equations of motion of M (n, n), V () and Q (n,) as formulas, with rows."""
    n, nc = len(nodes), len(rows)
    momentum = M @ x.v
    turned = x.by(momentum, x.q)  # ∂(M v)/∂q
    rate = Q - x.by(V, x.q) + 0.5 * (x.v @ turned)
    F = rate - turned @ x.v
    contacts = tuple(row.contact for row in rows)
    every = ["t", "t_R", *nodes, *(f"v_{node}" for node in nodes), *(row.name for row in contacts)]
    if len(set(every)) < len(every):
        twice = next(name for name in every if every.count(name) > 1)
        raise InputError(f"the Lagrangian system has two series of the name {twice!r}: rename one")
    g, χ, κ = (np.array([getattr(row, name) for row in rows], dtype=object) for name in ("g", "chi", "kappa"))
    H = np.array([row.H for row in rows], dtype=object).reshape(nc, n)
    kinds = decompose(np.eye(n), np.zeros((n, n)), np.zeros(n, dtype=np.bool_))
    square, columns = np.full((n, n), np.nan), np.full((n, nc), np.nan)
    return LagrangianDynamics(
        Structure(nodes, contacts, kinds, np.ones((n, nc)), {Feature.LAGRANGIAN: "M(q)"}),
        M=square, C=square, K=square, loads=(), H=columns.T, u0=columns[0], chi=columns[0], B=columns,
        D=np.zeros((nc, nc)), **law_numbers(contacts),
        inertia=MotionFunction(x, (M, V.reshape(1))),
        forces_of=MotionFunction(x, (M, F, -x.by(F, x.q), -x.by(F, x.v), -x.by(Q, x.v))),
        rows_of=MotionFunction(x, (g, H, χ, κ)),
        supplied_of=MotionFunction(x, (Q, rate)),
    )  # fmt: skip


class MotionRows(NamedTuple):
    """The rows at a time, a place and a velocity.

    Attributes
    ----------
    g, chi, kappa : (..., nc) arrays    gaps in m, 0 of rows with friction; χ in m/s; and κ in m/s²
    H : (..., nc, n) array
    """

    g: Array
    H: Array
    chi: Array
    kappa: Array

    def rates(self, v: Array) -> Array:
        """Return U = H v + χ (..., nc)."""
        return images(self.H, v) + self.chi


class ForceSlopes(NamedTuple):
    """M, F, K = -∂F/∂q, C = -∂F/∂v and -∂Q/∂v at a time, a place and a velocity: (..., n, n), and F (..., n)."""

    M: Array
    F: Array
    K: Array
    C: Array
    damping: Array


@dataclass(frozen=True)
class FrozenDynamics(Dynamics):
    """The linear system that a Lagrangian one is at a time, a place and a velocity.

    Attributes
    ----------
    damping : (n, n) array      -∂Q/∂v, the part of C that is not gyroscopic
    kappa : (nc,) array         κ in m/s², of U' = H v' + κ
    """

    damping: Array = field(kw_only=True)
    kappa: Array = field(kw_only=True)


@dataclass(frozen=True)
class LagrangianDynamics(Dynamics):
    """The equations of motion of a Lagrangian system, whose values depend on where it is.

    M, C, K, H, u0, χ and B are NaN here, and numbers `at` a time, a place and a velocity.

    Attributes
    ----------
    inertia : MotionFunction        M(q) and V(q)
    forces_of : MotionFunction      M, F, K, C and -∂Q/∂v
    rows_of : MotionFunction        g, H, χ and κ
    supplied_of : MotionFunction    Q, and the rate of M v without reactions
    """

    inertia: MotionFunction = field(kw_only=True)
    forces_of: MotionFunction = field(kw_only=True)
    rows_of: MotionFunction = field(kw_only=True)
    supplied_of: MotionFunction = field(kw_only=True)

    def rows(self, t: ArrayLike, q: ArrayLike, v: ArrayLike) -> MotionRows:
        """Return g, H, χ and κ for t (...), q and v (..., n)."""
        return MotionRows(*self.rows_of(t, q, v))

    def forces_at(self, t: ArrayLike, q: ArrayLike, v: ArrayLike) -> ForceSlopes:
        """Return M, F, K and C for t (...), q and v (..., n)."""
        return ForceSlopes(*self.forces_of(t, q, v))

    def at(self, t: float, q: Array, v: Array) -> Dynamics:
        """Return the linear system that has the values, and the slopes of the forces, where this one is."""
        M, F, K, C, damping = self.forces_at(t, q, v)
        return self.linear(M, C, K, F + K @ q + C @ v, damping, self.rows(t, q, v), q)

    @cached_property
    def curved(self) -> Flags:
        """Flags of the rows with κ ≠ 0, whose rates change without forces (nc,)."""
        return np.array([isinstance(each, Formula) or each != 0.0 for each in self.rows_of.results[3]], dtype=np.bool_)

    @cached_property
    def damped(self) -> bool:
        """Whether other forces depend on velocities."""
        return any(isinstance(each, Formula) or each for each in self.forces_of.results[4].flat)

    @property
    def still(self) -> Dynamics:
        """The linear system with its structure, unit masses, and no forces and directions."""
        n, closed = len(self.nodes), np.zeros(len(self.contacts))
        nothing = np.zeros((n, n))
        rows = MotionRows(closed, np.zeros((len(closed), n)), closed, closed)
        return self.linear(np.eye(n), nothing, nothing, nothing[0], nothing, rows, nothing[0])

    def linear(
        self, M: Array, C: Array, K: Array, f: Array, damping: Array, rows: MotionRows, q: Array
    ) -> FrozenDynamics:
        """Return a linear system with its structure and laws, and with the ``rows`` that are known at q."""
        g, H, χ, κ = rows
        return FrozenDynamics(
            self.structure, damping=damping, kappa=κ, M=M, C=C, K=K, loads=tuple(enumerate(f.tolist())), H=H,
            u0=g - H @ q, chi=χ, B=np.ascontiguousarray(H.T), D=self.D, restitution=self.restitution,
            r_min=self.r_min, r_max=self.r_max, mu=self.mu, mu_s=self.mu_s,
        )  # fmt: skip

    @property
    def entries(self) -> tuple[Flags, Flags]:
        """Flags of the entries of H (nc, n) and M (n, n) that are not zero everywhere."""
        H, M = (
            np.array([isinstance(each, Formula) or each != 0.0 for each in A.flat], dtype=np.bool_).reshape(A.shape)
            for A in (self.rows_of.results[1], self.inertia.results[0])
        )
        return H, M

    @property
    def constant_loads(self) -> bool:
        """Whether no other force depends on time."""
        program = self.supplied_of.traced.program
        return not self.supplied_of.formulas & program.depending_on([self.supplied_of.traced.t])

    def force(self, t: ArrayLike) -> Array:
        """Return zero: all forces of a Lagrangian system are those of its motion."""
        return np.zeros((*np.shape(t), len(self.nodes)))

    def motion_forces(self, t: ArrayLike, q: ArrayLike, v: ArrayLike) -> Array:
        """Return the other forces Q(t, q, v) in N (..., n)."""
        return self.supplied_of(t, q, v)[0]

    def gap(self, t: ArrayLike, q: ArrayLike) -> Array:
        """Return the gaps g(t, q) in m, for q of shape (..., n); 0 of rows with friction."""
        return self.rows(t, q, np.zeros(np.shape(q))).g

    def gap_rate(self, t: ArrayLike, q: ArrayLike, v: ArrayLike) -> Array:
        """Return the opening and slip rates U = H v + χ in m/s at t and q, for v of shape (..., n)."""
        v = np.asarray(v, dtype=np.float64)
        return self.rows(t, q, v).rates(v)

    def mass(self, q: ArrayLike) -> Array:
        """Return M(q), for q of shape (..., n)."""
        return self._inertia(q)[0]

    def momentum(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Return M(q) v in N s, for v of shape (..., n)."""
        return images(self.mass(q), np.asarray(v))

    def reaction_force(self, q: ArrayLike, r: ArrayLike, t: ArrayLike = 0.0) -> Array:
        """Return Hᵀ r in N at t and q, the force of the reactions on the nodes, for r of shape (..., nc)."""
        H = self.rows(t, q, np.zeros(np.shape(q))).H
        return images(np.swapaxes(H, -1, -2), np.asarray(r))

    def along(self, t: Array, q: Array, v: Array) -> Dynamics:
        """Return the linear system with the largest |M|, |H| and |g - H q| along a motion, without forces."""
        rows, M = self.rows(t, q, v), np.abs(self.mass(q)).max(axis=0)
        H, none = np.abs(rows.H).max(axis=0), np.zeros_like(M)
        return replace(
            self.at(float(t[0]), q[0], v[0]), M=M, C=none, K=none, loads=(), H=H, B=np.ascontiguousarray(H.T),
            u0=np.abs(rows.g - images(rows.H, q)).max(axis=0), chi=np.abs(rows.chi).max(axis=0),
        )  # fmt: skip

    def turned(self, t: Array, q: Array, v: Array) -> Array:
        """Return how far rates U in m/s may be off zero where steps with the rows at q + h v end (steps, nc)."""
        ahead = q[:-1] + np.diff(t)[:, None] * v[:-1]
        return images(np.abs(self.rows(t[1:], ahead, v[1:]).H - self.rows(t[1:], q[1:], v[1:]).H), np.abs(v[1:]))

    def compliance(self, t: ArrayLike, q: ArrayLike) -> Array:
        """Return W = H M⁻¹ Hᵀ in 1/kg at t and q (..., nc, nc)."""
        H = self.rows(t, q, np.zeros(np.shape(q))).H
        return np.asarray(H @ np.linalg.solve(self.mass(q), np.swapaxes(H, -1, -2)))

    def kinetic_energy(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Return ½ vᵀ M(q) v in J, for v of shape (..., n)."""
        return np.asarray(0.5 * (self.momentum(q, v) * np.asarray(v)).sum(axis=-1))

    def elastic_energy(self, q: ArrayLike) -> Array:
        """Return the potential energy V(q) in J, for q of shape (..., n)."""
        return self._inertia(q)[1][..., 0]

    def _inertia(self, q: ArrayLike) -> list[Array]:
        q = np.asarray(q, dtype=np.float64)
        return self.inertia(np.zeros(q.shape[:-1]) if q.ndim > 1 else 0.0, q, np.zeros(q.shape))

    def refuse_start(self, problem: str, q: Array, v: Array) -> None:
        """Refuse a start where M is no mass matrix, contacts are penetrated, or joints are open or contradict each other.

        Raises
        ------
        InputError
            Naming the function, the contact or the joint.
        """
        where = f"where problem {problem!r} starts"
        rows, M = self.rows(0.0, q, v), self.mass(q)
        if not np.isfinite(M).all():
            raise InputError(f"M(q) is {M.tolist()} {where}: give it finite numbers there")
        if np.abs(M - M.T).max() > 64.0 * EPS * np.abs(M).max():
            raise InputError(f"M(q) is not symmetric {where}: the kinetic energy is ½ vᵀ M v, with M = Mᵀ")
        if (
            np.linalg.eigvalsh(M / np.sqrt(np.outer(np.diag(M), np.diag(M)))).min() <= 64.0 * EPS
            or (np.diag(M) <= 0.0).any()
        ):
            raise InputError(
                f"M(q) is not positive definite {where}: give each coordinate a mass or a moment of inertia"
            )
        for i, contact in enumerate(self.contacts):
            what = f"{'slip' if self.tangential[i] else 'gap'} of {contact.name.removesuffix('_T')!r}"
            if not np.isfinite([rows.g[i], *rows.H[i], rows.chi[i]]).all():
                raise InputError(
                    f"{what}, or its derivative, is not a finite number {where}: change the function or the start"
                )
        terms = np.abs(rows.H) @ np.abs(q) + START_RTOL * np.abs(rows.H).sum(axis=1)
        for i in map(int, np.flatnonzero(self.impenetrable & (rows.g < -START_RTOL * terms))):
            raise InputError(
                f"contact {self.contacts[i].name!r} of problem {problem!r} starts penetrated by {-rows.g[i]:g} m: change q0 "
                "or its gap"
            )
        joints = np.flatnonzero(self.bilateral)
        U = rows.rates(v)
        speeds = np.abs(rows.H) @ np.abs(v) + np.abs(rows.chi)
        speeds[:] = speeds.max(initial=0.0)  # the terms of a row may vanish by rounding alone, as cos(π/2)
        for i in map(int, joints):
            for what, off, size in (("q0", rows.g[i], terms[i]), ("v0", U[i], speeds[i])):
                if np.abs(off) > START_RTOL * size:
                    raise InputError(
                        f"joint {self.contacts[i].name!r} of problem {problem!r} is open by {off:g} in {what}: give values "
                        "that satisfy it"
                    )
        J = rows.H[joints]
        if len(joints):
            W = J @ np.linalg.solve(M, J.T)
            size = np.sqrt(np.diag(W))
            if not size.all() or np.linalg.eigvalsh(W / np.outer(size, size)).min() <= START_RTOL:
                names = ", ".join(repr(self.contacts[i].name) for i in map(int, joints))
                raise InputError(
                    f"the joints {names} repeat or contradict one another {where}: leave out those that follow from others"
                )


def images(A: Array, x: Array) -> Array:
    """Return A x (..., m) of matrices A (..., m, n) and vectors x (..., n)."""
    return np.asarray(np.einsum("...ij,...j->...i", A, x))


def _check_row(kind: str, name: str, gap: Gap) -> None:
    """Refuse a row without a name or a gap."""
    if not is_name(name):
        raise InputError(f"name = {name!r} of a {kind} must be a string that is not empty")
    if not callable(gap):
        raise InputError(f"gap = {gap!r} of {kind} {name!r} must be a function of t and q")
