r"""Penalty approximation: every bumper of a scheme replaced by a compliant law.

A rigid bumper becomes a stiff one-sided spring, so that the problem is an ordinary differential equation that any smooth
method can run. The model errs by the time that the contact takes and by the depth that it needs, both of the order
k^(-1/2) for a linear spring.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from lcpimpact.arguments import check_kind
from lcpimpact.arrays import Array
from lcpimpact.errors import InputError, UnsupportedError
from lcpimpact.formula import Formula, SymbolicProgram, sqrt
from lcpimpact.numbers import between, finite
from lcpimpact.problems.base import Problem
from lcpimpact.problems.free_vibration import angle
from lcpimpact.registry import nearest
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.elements.base import GROUND, Element
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.hertz_spring import HertzSpring
from lcpimpact.scheme.elements.hunt_crossley import HuntCrossley
from lcpimpact.scheme.elements.kelvin_voigt_stop import KelvinVoigtStop
from lcpimpact.scheme.elements.rope import Rope
from lcpimpact.scheme.elements.touch import Touch
from lcpimpact.scheme.lagrangian import FrictionContact, Lagrangian, traced_rows
from lcpimpact.scheme.motion_function import MotionArguments
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.scheme.sparse_dynamics import TAKE_SCHEME
from lcpimpact.scheme.terms import Terms

LAWS = {"kelvin-voigt": ("c",), "hertz": ("n",), "hunt-crossley": ("b", "n", "v0")}
"""The compliant laws, and the options of each beside k and e."""


def penalized(
    problem: Problem,
    law: str,
    *,
    k: float,
    c: float | None = None,
    b: float | None = None,
    n: float | None = None,
    v0: float | None = None,
    e: float | None = None,
    v_s: float | None = None,
) -> Problem:
    r"""Return the problem with every bumper, and every rope, replaced by a compliant law of the stiffness k.

    With δ the penetration of the plates, or the elongation of a rope, the laws are for δ > 0

    - ``kelvin-voigt``: ``f = max(0, k δ + c δ')``, a `KelvinVoigtStop`;
    - ``hertz``: ``f = k δⁿ``, a `HertzSpring`, which loses nothing;
    - ``hunt-crossley``: ``f = k δⁿ (1 + b δ')``, a `HuntCrossley`.

    Where both sides of a bumper have mass its restitution e tells the loss. One impact alone returns with e if

    .. math:: c = 2 ζ \sqrt{k\, m_{eff}}, \quad e = \exp\Bigl(-\frac{2 ζ \arccos ζ}{\sqrt{1 - ζ^2}}\Bigr), \quad
              m_{eff} = (H M^{-1} H^T)^{-1}, \qquad\text{or}\qquad
              b = \frac a{v_0}, \quad a - \ln(1 + a) = -e a - \ln(1 - e a).

    So Kelvin and Voigt's e holds at all speeds, and Hunt and Crossley's at the speed v0 that is given. At a massless
    plate e has no meaning, and the law has no loss unless one is given.

    What rests on the law sinks in by m g/k, or (m g/k)^(1/n); it leaves the ground only where its impacts are strong
    against its weight, so a ball that bounces ever lower comes to rest earlier than on a rigid ground.

    Parameters
    ----------
    problem : Problem
        A scheme with bumpers, or a Lagrangian system with contacts, for ``hertz`` and ``hunt-crossley``.
    law : {"kelvin-voigt", "hertz", "hunt-crossley"}
        The law.
    k : float
        Stiffness in N/m, or K in N/mⁿ.
    c : float, optional
        Damping of ``kelvin-voigt`` in N s/m, for all bumpers, in place of that from e.
    b : float, optional
        Loss of ``hunt-crossley`` in s/m, likewise.
    n : float, optional
        Exponent of ``hertz`` and ``hunt-crossley``, at least 1; 3/2 if it is left out, as of smooth bodies.
    v0 : float, optional
        Approach speed in m/s at which ``hunt-crossley`` shall return with e; needed where some e is below 1.
    e : float, optional
        Restitution in (0, 1] for all bumpers, in place of their own.
    v_s : float, optional
        Of a Lagrangian system with friction: slip rate in m/s over which the force changes its sign,
        ``-μ f U_T/sqrt(U_T² + v_s²)`` in place of Coulomb's law; needed where some μ is above 0.

    Returns
    -------
    Problem
        With the same nodes, initial state, parameters, end and source, without facts and closed form. The force of each law
        has the name of the bumper that it replaces, as ``run["R"]``, and its closings and openings are events of the run.

    Raises
    ------
    InputError
        If the problem has no bumper, a constant is missing, out of its range or of another law, or e = 0, which no finite
        c or b reaches.
    UnsupportedError
        If the problem is given by its matrices, or an element of your own makes a unilateral row.

    Examples
    --------
    >>> from lcpimpact import load_problem, penalized, simulate
    >>> soft = penalized(load_problem("bouncing-ball", e=0.8), "kelvin-voigt", k=1e6)
    >>> soft.name, round(soft.scheme.elements[2].c, 1)
    ('bouncing-ball (kelvin-voigt)', 148.7)
    >>> run = simulate(soft, dt=2.5e-4, t_end=1.0)
    >>> bool(run["x"].max() < 1.005), f"{run['R'].max():.0f} N"
    (True, '3988 N')
    >>> [event.kind for event in run.events]
    ['close', 'open']

    References
    ----------
    Schwager and Pöschel (2007) for ``kelvin-voigt``; Hunt and Crossley (1975).
    """
    for name, value, kind in (("problem", problem, Problem), ("law", law, str)):
        check_kind(name, value, kind)
    if law not in LAWS:
        raise InputError(nearest(law, list(LAWS), "law"))
    given = {"k": k, "c": c, "b": b, "n": n, "v0": v0, "e": e, "v_s": v_s}
    _check(law, given)
    if isinstance(problem.scheme, Lagrangian):
        return _of_lagrangian(problem, problem.scheme, law, given)
    if v_s is not None:
        raise InputError("penalized: v_s is of the friction of Lagrangian systems; leave it out")
    if not isinstance(problem.scheme, Scheme):
        raise UnsupportedError(
            f"penalized: {problem.name!r} is given by its matrices, and a law can replace only the bumpers of a Scheme"
        )
    if problem.sparse:
        raise UnsupportedError(
            f"penalized: {problem.name!r} is in sparse matrices, which take no compliant laws: {TAKE_SCHEME}"
        )
    dynamics = problem.dynamics

    def compliant(bumper: Bumper) -> Element:
        return _compliant(bumper, law, given, *_impact(dynamics, bumper, e))

    elements = [each for element in problem.scheme.elements for each in _replaced(element, compliant)]
    if tuple(elements) == problem.scheme.elements:
        raise InputError(f"penalized: {problem.name!r} has no bumper that a law could replace")
    scheme = Scheme(*elements)
    if scheme.assemble().nodes != dynamics.nodes:
        # The plates of a rope are exchanged in the law, so the nodes are named in the order of the problem.
        place = {node: i for i, node in enumerate((GROUND, *dynamics.nodes))}
        scheme = Scheme(*sorted(elements, key=lambda each: max(place[node] for node in each.nodes)))
    return replace(problem, name=f"{problem.name} ({law})", scheme=scheme, facts=(), motion=None)


def _check(law: str, given: dict[str, float | None]) -> None:
    """Refuse constants that are missing, that are out of their range, or that the law does not have."""
    for symbol, value in given.items():
        if value is None:
            continue
        if symbol not in ("k", "e", "v_s", *LAWS[law]):
            takes = ", ".join(("k", "e", *LAWS[law]))
            raise InputError(f"penalized: the law {law!r} has no {symbol}; leave it out (it takes {takes})")
        finite(f"penalized: {symbol}", value)
    for symbol in ("k", "v0", "v_s"):
        value = given[symbol]
        if value is not None and not value > 0.0:
            raise InputError(f"penalized: {symbol} = {value:g} must be above zero")
    if given["k"] is None:
        raise InputError("penalized: k is missing; give the stiffness of the law")
    for symbol in ("c", "b"):
        value = given[symbol]
        if value is not None and value < 0.0:
            raise InputError(f"penalized: {symbol} = {value:g} must not be below zero")
        if value is not None and given["e"] is not None:
            raise InputError(f"penalized: {symbol} and e both determine the loss; leave one of them out")
    if given["n"] is not None and given["n"] < 1.0:
        raise InputError(f"penalized: n = {given['n']:g} must be at least 1")
    if given["e"] is not None:
        between("penalized: e", given["e"], 0.0, 1.0)


def _replaced(element: Element, compliant: Callable[[Bumper], Element]) -> Iterator[Element]:
    """Yield an element unchanged, or its replacement: the law for a bumper, and the parts of a compound with bumpers."""
    if isinstance(element, Bumper):
        yield compliant(element)
    elif isinstance(element, Rope):
        # A rope is a bumper with its plates exchanged.
        yield compliant(Bumper(element.b, element.a, element.slack, element.e, element.name))
    elif not (isinstance(element, Touch) or _unilateral(element)):
        yield element
    elif element.parts() == (element,):
        raise UnsupportedError(
            f"penalized: {element} makes a unilateral row by itself, and only a Bumper, a Rope, or a Compound of them "
            "can be replaced"
        )
    else:
        for part in element.parts():
            yield from _replaced(part, compliant)


def _unilateral(element: Element) -> bool:
    terms = Terms([node for node in element.nodes if node != GROUND])
    element.contribute(terms)
    return any(row.impenetrable for row in terms.rows)


def _impact(dynamics: Dynamics, bumper: Bumper, e: float | None) -> tuple[float | None, float]:
    """Return the required restitution of the law, None if there are no impacts, and m_eff = 1/(H M⁻¹ Hᵀ) in kg."""
    row = [contact.name for contact in dynamics.contacts].index(bumper.name or bumper.reaction)
    contact = dynamics.contacts[row]
    if contact.relative_degree < 2:
        return None, 0.0
    E = dynamics.decomposition.massive
    h = dynamics.H[row] @ E
    mobility = float(h @ np.linalg.solve(E.T @ dynamics.M @ E, h))
    if mobility == 0.0:
        raise InputError(
            f"penalized: neither side of bumper {bumper.name!r} is free to move, so no law can be sized for it"
        )
    return contact.e if e is None else e, 1.0 / mobility


def _compliant(bumper: Bumper, law: str, given: dict[str, float | None], e: float | None, m_eff: float) -> Element:
    """Return the law that stands for a bumper."""
    gap = bumper.gap
    k = given["k"]
    name = bumper.name or bumper.reaction
    if not isinstance(bumper.upper, str) or not isinstance(bumper.lower, str):
        raise InputError(f"penalized: an end of bumper {name!r} is a sum of coordinates, and springs join nodes alone")
    ends = bumper.upper, bumper.lower
    assert k is not None
    n = 1.5 if given["n"] is None else given["n"]
    loss = _loss(f"bumper {name!r}", law, given, e, m_eff)
    if law == "kelvin-voigt":
        return KelvinVoigtStop(*ends, k, loss or 0.0, gap, name)
    if loss:
        return HuntCrossley(*ends, k, loss, n, gap, name)
    return HertzSpring(*ends, k, n, gap, name)


def _loss(what: str, law: str, given: dict[str, float | None], e: float | None, m_eff: float) -> float | None:
    """Return the c or b of a law in place of ``what``, by e where it is not given."""
    symbol = {"kelvin-voigt": "c", "hunt-crossley": "b"}.get(law, "")
    k = given["k"]
    assert k is not None
    loss = given.get(symbol)
    if loss is None and e is not None and e < 1.0:
        if law == "hertz":
            raise InputError(
                f"penalized: {what} has e = {e:g}, and Hertz's law is conservative: take "
                "law='hunt-crossley', or e=1 to run without loss"
            )
        if e == 0.0:
            raise InputError(f"penalized: {what} has e = 0, which no finite {symbol} reaches: give {symbol}=, or e > 0")
        if law == "kelvin-voigt":
            return 2.0 * damping_ratio(e) * math.sqrt(k * m_eff)
        if given["v0"] is None:
            raise InputError(
                f"penalized: {what} has e = {e:g}, which Hunt and Crossley's law has at one speed: "
                "give v0=, the approach speed in m/s, or b="
            )
        return loss_number(e) / given["v0"]
    return loss


@dataclass(frozen=True)
class CompliantForces:
    """Other forces Q(t, q, v) of a Lagrangian system with compliant laws in place of its contacts.

    Attributes
    ----------
    Q : callable or None            those beside the contacts
    contacts : tuple                the contacts replaced
    K, n, v_s : float               stiffness, exponent, and the slip rate in m/s over which friction changes its sign
    b : tuple of float              loss of each contact in s/m
    """

    Q: Callable[..., ArrayLike] | None
    contacts: tuple[FrictionContact, ...]
    K: float
    n: float
    v_s: float
    b: tuple[float, ...]

    def __call__(self, t: float | Formula, q: Array, v: Array) -> Array:
        """Return the forces as formulas (n,)."""
        assert isinstance(t, Formula)
        assert isinstance(t.program, SymbolicProgram)
        x = MotionArguments(t.program, t, q, v)
        total = np.asarray(self.Q(t, q, v) if self.Q else np.zeros(len(q)), dtype=object)
        for each, b in zip(self.contacts, self.b, strict=True):
            normal, *slips = traced_rows([each], x)
            δ = 0.5 * (abs(normal.g) - normal.g)
            f = self.K * δ**self.n * (1.0 - b * (np.dot(normal.H, v) + normal.chi))
            total = total + normal.H * f
            for slip in slips:
                U = np.dot(slip.H, v) + slip.chi
                total = total - slip.H * (each.mu * f * U / sqrt(U * U + self.v_s**2))
        return total


def _of_lagrangian(problem: Problem, system: Lagrangian, law: str, given: dict[str, float | None]) -> Problem:
    """Return a Lagrangian system with a compliant law in place of each contact."""
    if law == "kelvin-voigt":
        raise UnsupportedError(
            f"penalized: the force of {law!r} jumps where a contact closes, and forces of the Lagrangian system "
            f"{problem.name!r} have derivatives: take law='hunt-crossley', with n=1 for a linear spring"
        )
    contacts = tuple(system.contacts)
    if not contacts:
        raise InputError(f"penalized: {problem.name!r} has no contact that a law could replace")
    if given["v_s"] is None and any(each.mu > 0.0 for each in contacts):
        raise InputError(
            f"penalized: {problem.name!r} has friction: give v_s=, the slip rate in m/s over which its force changes sign"
        )
    for each in contacts:
        if each.e_T > 0.0:
            raise UnsupportedError(
                f"penalized: contact {each.name!r} has e_T = {each.e_T:g}, and friction that is a force of the slip rate "
                "turns no slip round: take e_T = 0"
            )
    k, n = given["k"], given["n"]
    assert k is not None
    losses = [
        _loss(f"contact {each.name!r}", law, given, each.e if given["e"] is None else given["e"], 0.0) or 0.0
        for each in contacts
    ]
    soft = _softened(system, k, 1.5 if n is None else n, given["v_s"] or 1.0, tuple(losses))
    return replace(problem, name=f"{problem.name} ({law})", scheme=soft, facts=(), motion=None)


def _softened(system: Lagrangian, K: float, n: float, v_s: float, b: tuple[float, ...]) -> Lagrangian:
    """Return a system with `CompliantForces` in place of its contacts, pickled as this call."""
    forces = CompliantForces(system.Q, tuple(system.contacts), K, n, v_s, b)
    soft = replace(system, Q=forces, contacts=())
    vars(soft)["rebuilt_by"] = _softened, (system, K, n, v_s, b)
    return soft


def damping_ratio(e: float) -> float:
    r"""Return the ζ of a Kelvin-Voigt stop that returns with e: ``-ln e = 2 ζ acos ζ/sqrt(1 - ζ²)``, acosh past ζ = 1.

    Parameters
    ----------
    e : float
        Restitution, above 0 and at most 1; e falls to 0 only as ζ grows without bound, as ``1/(2ζ)²``.

    Examples
    --------
    >>> round(damping_ratio(0.5), 9), damping_ratio(1.0)
    (0.255275638, 0.0)
    """
    goal, high = -math.log(e), 1.0
    while 2.0 * high * angle(high) < goal:
        high *= 2.0
    return float(brentq(lambda ζ: 2.0 * ζ * angle(ζ) - goal, 0.0, high, xtol=1e-300, rtol=1e-15))


def loss_number(e: float) -> float:
    r"""Return the a = b v0 at which Hunt and Crossley's law returns with e: ``a - ln(1 + a) = -e a - ln(1 - e a)``.

    Parameters
    ----------
    e : float
        Restitution, above 0 and at most 1; a is below 1/e.

    Examples
    --------
    >>> round(loss_number(0.5), 9), loss_number(1.0)
    (1.432750533, 0.0)
    """
    if e == 1.0:
        return 0.0

    def lost(a: float) -> float:
        if a >= 1.0 / e or e * a >= 1.0:
            return -1.0
        return (_beyond_linear(a) - _beyond_linear(-e * a)) / a**2

    # For small a what is lost is (1 - e²)/2 - a (1 + e³)/3 + ..., for a near 1/e minus infinity.
    low = 1.5 * (1.0 - e**2) / (1.0 + e**3)
    while lost(low) < 0.0:
        low *= 0.5
    return float(brentq(lost, low, 1.0 / e, xtol=1e-300, rtol=1e-15))


def _beyond_linear(x: float) -> float:
    """Return x - ln(1 + x) without the cancellation at small x."""
    if abs(x) > 0.05:
        return x - math.log1p(x)
    return math.fsum((-x) ** i / i for i in range(2, 16))
