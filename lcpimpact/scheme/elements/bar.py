r"""The bar: a one-dimensional continuum in finite elements, elastic or elastic-plastic."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import chain, pairwise
from typing import Annotated, ClassVar

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.formula import number
from lcpimpact.numbers import is_count, is_real
from lcpimpact.scheme.elements.base import GROUND, MISSING, Element, Polyline, described, distinct, positive
from lcpimpact.scheme.elements.jenkins import Jenkins
from lcpimpact.scheme.elements.load import Load
from lcpimpact.scheme.elements.spring import Spring
from lcpimpact.scheme.terms import Terms

COUPLING_MASSES = {"lumped": 0.0, "higher-order": 1.0 / 12.0, "consistent": 1.0 / 6.0}
"""Coupling mass μ of a bar element, as a fraction of the element's mass, by name."""

MAX_ELEMENTS = 5_000
"""Maximum number of elements of a bar: its full matrices have 200 MB."""


@described
@dataclass(frozen=True)
class Bar(Element):
    r"""A bar from a to b: ρ A u_tt = (A σ)_x with σ = E u_x, in equal elements of length Δx = L/elements.

    An element is a spring E A/Δx with the mass

    .. math:: ρ A Δx \begin{pmatrix} ½ - μ & μ \\ μ & ½ - μ \end{pmatrix},

    so that a wave of the wave number κ has ω = (2c/Δx) sin(κΔx/2)/sqrt(1 - 4μ sin²(κΔx/2)) with c = sqrt(E/ρ): as the
    continuum's cκ up to a relative error of (κΔx)² (μ/2 - 1/24), thus of the second order for "lumped" (μ = 0, too slow) and
    "consistent" (μ = 1/6, too fast), and of the fourth for "higher-order" (μ = 1/12). Energy: ½ ∫ ρ A u_t² dx and
    ½ ∫ E A u_x² dx.

    With σ_y the stress of each element stays in -σ_y <= σ <= σ_y, by a `Jenkins` element: spring E A/Δx in series with a
    slider A σ_y, and with E_t a hardening spring beside the slider, so that the stiffness past yield is E_t A/Δx. The
    sliders dissipate A σ_y per plastic elongation. The element of a massless end stays elastic.

    ::

             |<--------- L --------->|
        a o==|====|====|====|====|===|==o b      E, A, ρ; coordinates u positive downwards (from a to b)
               NAME.1 NAME.2 ...

    Parameters
    ----------
    a, b : str
        The nodes at its two ends; one may be the ground.
    E : float
    A : float
    rho : float
    L : float
    elements : int
        How many finite elements.
    mass : str or float
        "lumped", "consistent", "higher-order", or μ itself, 0 <= μ <= 1/4; see `for_step`.
    massless : str or sequence of str
        The massless ends: their element leaves its mass to the next node, and nothing of the total is lost. A contact
        there has relative degree 0: no impact, no coefficient of restitution, and its force is a function of time.
    sigma_y : float, optional
    E_t : float, optional
    name : str, optional
        The name of the inner nodes, without their number, and of the stresses' forces NAME.F1, NAME.F2, ... of a plastic
        bar; by default the two ends, as in top-bottom.
    symbols : tuple of str
        How drawings call the constants.

    Raises
    ------
    InputError
        If a constant is missing, not positive or not finite, elements is no whole number, mass or massless is unknown, μ
        lies outside [0, 1/4], E_t is given without sigma_y or is not below E, or both ends are one node; also if μ = 1/4 and
        neither end is massless or the ground, since a zigzag of the nodes would then have no mass.

    Notes
    -----
    An elastic bar that falls on a wall, where the contact force is a rectangle (bar-impact) or two trapezia
    (bouncing-bar) in closed form, tells the settings apart. Measured with 400 elements and moreau-jean, θ = 1/2: the
    error of the force in L1, relative to its integral, in both, and the largest loss of energy, relative to that of
    the impact, in the second.

    ============  ============  =======  ==========  ============  ===========
    mass          contact node  c dt/Δx  bar-impact  bouncing-bar  energy lost
    ============  ============  =======  ==========  ============  ===========
    lumped        with mass     1/2      0.53 %      2.7 %         2e-3
    lumped        massless      1/2      0.56 %      3.2 %         3e-5
    consistent    with mass     1/2      1.9 %       3.3 %         2e-3
    consistent    massless      1/2      1.9 %       3.3 %         1e-4
    higher-order  massless      1/4      0.33 %      1.2 %         4e-5
    higher-order  massless      1/2      0.43 %      2.0 %         6e-5
    for_step      massless      1/4      0.27 %      0.87 %        4e-5
    for_step      massless      1/2      0.27 %      0.84 %        8e-5
    for_step      massless      1        0.24 %      0.53 %        1e-3
    ============  ============  =======  ==========  ============  ===========

    A contact node with mass loses its kinetic energy in an impact of its own. Without mass, energy leaves only in the step
    that closes a gap (that of r u, with u the gap before), and none is ever gained.

    A bar that yields is best left with its mass at the contact (e = 0): the elastic element of a massless end rings against
    the plastic one beside it, by some 25 % of the force in perfect plasticity and 3 % at E_t = E/9, with 40 elements. With
    the mass the force of the wall is A σ_y, or A (σ_y + ρ c_p (v_0 - σ_y/(ρ c))) with c_p = sqrt(E_t/ρ), within 1 %.

    Examples
    --------
    >>> bar = Bar("top", "bottom", E=900.0, A=1.0, rho=1.0, L=10.0, elements=4, massless="bottom")
    >>> bar.nodes, bar.wave_speed
    (('top', 'top-bottom.1', 'top-bottom.2', 'top-bottom.3', 'bottom'), 30.0)
    >>> bar.for_step(1 / 12).mass
    0.25

    References
    ----------
    Hughes, *The Finite Element Method* (1987), section 7.3 and 9.3 (higher-order mass); Khenous, Laborde and Renard, Mass
    redistribution method for finite element contact problems in elastodynamics (2008); Doyen, Ern and Piperno,
    Time-integration schemes for the finite element dynamic Signorini problem (2011), for the two problems.
    """

    a: str
    b: str
    E: Annotated[float, "Pa, Young's modulus, positive"] = MISSING
    A: Annotated[float, "m², cross-section, positive"] = MISSING
    rho: Annotated[float, "kg/m³, density, positive"] = MISSING
    L: Annotated[float, "m, length, positive"] = MISSING
    elements: int = MISSING
    mass: str | float = "consistent"
    massless: tuple[str, ...] = ()
    sigma_y: Annotated[float | None, "Pa, yield stress, positive; without it the bar is elastic"] = None
    E_t: Annotated[float | None, "Pa, tangent modulus past yield, below E; without it the plasticity is perfect"] = None
    name: str | None = None
    symbols: tuple[str, ...] = ("E", "A", "ρ", "L")

    strokes: ClassVar[tuple[Polyline, ...]] = (
        ((0.0, 0.0), (0.12, 0.0)),
        ((0.12, -0.3), (0.88, -0.3), (0.88, 0.3), (0.12, 0.3), (0.12, -0.3)),
        *(((0.12 + 0.76 * i / 6, -0.3), (0.12 + 0.76 * i / 6, 0.3)) for i in range(1, 6)),
        ((0.88, 0.0), (1.0, 0.0)),
    )

    def __post_init__(self) -> None:
        if isinstance(self.massless, str):
            object.__setattr__(self, "massless", (self.massless,))
        elif isinstance(self.massless, list):
            object.__setattr__(self, "massless", tuple(self.massless))
        elif not isinstance(self.massless, tuple):
            raise InputError(f"{self}: massless = {self.massless!r} must name an end, or be a sequence of its ends")
        for symbol, unit in (("E", "Pa"), ("A", "m²"), ("rho", "kg/m³"), ("L", "m")):
            positive(self, symbol, getattr(self, symbol), unit)
        if not is_count(self.elements) or self.elements > MAX_ELEMENTS:
            raise InputError(
                f"{self}: elements = {self.elements!r} must be a whole number from 1 to {MAX_ELEMENTS}: M and K are full"
            )
        object.__setattr__(self, "elements", int(self.elements))
        distinct(self)
        self._check_mass()
        self._check_plasticity()

    def _check_mass(self) -> None:
        for node in self.massless:
            if node not in (self.a, self.b) or node == GROUND:
                raise InputError(f"{self}: massless = {node!r} must name one of its ends that is not the ground")
        if self.massless and self.elements < 2:
            raise InputError(
                f"{self}: elements = {self.elements} leaves no node to take the mass of a massless end: give more"
            )
        known = (
            self.mass in COUPLING_MASSES
            if isinstance(self.mass, str)
            else is_real(self.mass) and 0.0 <= self.mass <= 0.25
        )
        if not known:
            raise InputError(
                f"{self}: mass = {self.mass!r} must be 'lumped', 'consistent', 'higher-order', or a number μ from 0 to 1/4"
            )
        if self.mu == 0.25 and not self.massless and GROUND not in (self.a, self.b):
            raise InputError(f"{self}: with μ = 1/4 a zigzag of its nodes has no mass: give massless=, or a smaller μ")

    def _check_plasticity(self) -> None:
        if self.sigma_y is not None:
            positive(self, "sigma_y", self.sigma_y, "Pa")
        if self.E_t is not None:
            positive(self, "E_t", self.E_t, "Pa")
            if self.sigma_y is None:
                raise InputError(f"{self}: E_t without sigma_y means nothing: give sigma_y, or leave E_t out")
            if not self.E_t < self.E:
                raise InputError(f"{self}: E_t = {self.E_t!r} must be below E = {self.E!r}")

    def __str__(self) -> str:
        # The inner nodes follow from the constants, so a message about these cannot count on them.
        return f"Bar between {self.a!r} and {self.b!r}"

    @property
    def _name(self) -> str:
        return self.name or f"{self.a}-{self.b}"

    @property
    def joints(self) -> tuple[str, ...]:
        """The ends of the elements, from a to b (elements + 1)."""
        return (self.a, *(f"{self._name}.{i}" for i in range(1, self.elements)), self.b)

    @property
    def plastic(self) -> range:
        """The numbers, from 1, of the elements that can yield.

        That of a massless end stays elastic: behind a perfectly plastic slider its position would be undetermined.
        """
        if self.sigma_y is None:
            return range(0)
        return range(2 if self.a in self.massless else 1, self.elements + (0 if self.b in self.massless else 1))

    @property
    def nodes(self) -> tuple[str, ...]:
        """The joints and, in elements that can yield, the nodes of the plastic strain NAME.F1.1, NAME.F2.1, ..."""
        plastic = self.plastic
        inner = (
            (f"{self._name}.F{i}.1", joint) if i in plastic else (joint,) for i, joint in enumerate(self.joints[1:], 1)
        )
        return (self.a, *chain.from_iterable(inner))

    @property
    def dx(self) -> float:
        """Δx, the length of an element in m."""
        return self.L / self.elements

    @property
    def mu(self) -> float:
        """μ, the coupling mass of an element as a fraction of its mass."""
        return COUPLING_MASSES[self.mass] if isinstance(self.mass, str) else number(self.mass)

    @property
    def wave_speed(self) -> float:
        """C = sqrt(E/ρ) in m/s."""
        return math.sqrt(self.E / self.rho)

    def for_step(self, dt: float) -> Bar:
        """Return the bar with the mass that suits a step dt of the trapezoidal rule (moreau-jean with θ = 1/2).

        The rule has tan²(ω dt/2) = (c dt/Δx)² sin²(κΔx/2)/(1 - 4μ sin²(κΔx/2)). With μ = 1/12 + (c dt/Δx)²/6 the errors of
        space and time cancel to the fourth order, and with dt = Δx/c, μ = 1/4, altogether: every wave has ω = cκ.

        Parameters
        ----------
        dt : float
            The step in s, positive and at most Δx/c.

        Raises
        ------
        InputError
            If dt is longer.
        """
        r = self.wave_speed * dt / self.dx
        if not 0.0 < r <= 1.0 + 1e-9:
            raise InputError(
                f"{self}: dt = {dt!r} s must be positive and at most dx/c = {self.dx / self.wave_speed:.6g} s: take fewer "
                "elements or a smaller dt"
            )
        return replace(self, mass=min(1.0 / 12.0 + r * r / 6.0, 0.25))

    def mass_matrix(self) -> Array:
        """Return M of the joints in kg (elements + 1, elements + 1), before anything else stands at the ends.

        An element has the energy of the sum of the velocities of its two ends, and of their difference; a massless end takes
        its neighbour's.
        """
        n = self.elements
        left, right = np.arange(n), np.arange(1, n + 1)
        if self.a in self.massless:
            left[0] = right[0]
        if self.b in self.massless:
            right[-1] = left[-1]
        sums, differences = np.zeros((2, n + 1, n + 1))
        for i, j, sign in ((left, left, 1.0), (right, right, 1.0), (left, right, -1.0), (right, left, -1.0)):
            np.add.at(sums, (i, j), 1.0)
            np.add.at(differences, (i, j), sign)
        return np.asarray(self.rho * self.A * self.dx * (0.25 * sums + (0.25 - self.mu) * differences))

    def weight(self, g: float) -> tuple[Load, ...]:
        """Return its weight as loads on its joints, M g, so that it falls freely without strain.

        Parameters
        ----------
        g : float
            Gravity in m/s², positive downwards.
        """
        loads = zip(self.joints, (self.mass_matrix().sum(axis=1) * g).tolist(), strict=True)
        return tuple(Load(node, f) for node, f in loads if f != 0.0 and node != GROUND)

    def pieces(self) -> tuple[Element, ...]:
        """Return the elements from a to b, as springs or, where they can yield, as Jenkins elements."""
        k = self.E * self.A / self.dx
        k_h = None
        plastic = self.plastic
        if self.E_t is not None:
            # Spring and hardening in series: 1/E_t = 1/E + 1/H.
            k_h = self.E * self.E_t / (self.E - self.E_t) * self.A / self.dx
        return tuple(
            Jenkins(p, q, k, self.A * self.sigma_y, k_h, f"{self._name}.F{i}")
            if self.sigma_y is not None and i in plastic
            else Spring(p, q, k)
            for i, (p, q) in enumerate(pairwise(self.joints), 1)
        )

    def contribute(self, terms: Terms) -> None:
        """Add the springs to K, the sliders to H, and the mass to M."""
        for piece in self.pieces():
            piece.contribute(terms)
        joints = self.joints
        moving = [i for i, node in enumerate(joints) if node != GROUND]
        at = [terms.index[joints[i]] for i in moving]
        terms.M.add(self.mass_matrix()[np.ix_(moving, moving)], np.ix_(at, at))
