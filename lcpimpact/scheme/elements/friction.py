r"""Coulomb friction of a contact: bounded by the normal force."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

from lcpimpact.arguments import is_name
from lcpimpact.errors import InputError
from lcpimpact.formula import number
from lcpimpact.numbers import between, is_real
from lcpimpact.scheme.elements.base import MISSING, Link, Polyline, described, distinct
from lcpimpact.scheme.laws import FRICTION
from lcpimpact.scheme.terms import End, Row, Terms


@described
@dataclass(frozen=True)
class Friction(Link):
    r"""Dry friction of a contact, bounded by its normal force.

    With U = v_lower - v_upper, the rate at which the surfaces slide, and the reaction r_N of the bumper ``normal``,

    .. math:: -μ r_N \le F \le μ r_N, \qquad F = -μ r_N \text{ where } U > 0, \quad F = μ r_N \text{ where } U < 0 .

    F pushes the ends apart, as the reaction of a bumper does. In an impact the same law holds for the impulses, with the
    tangential coefficient of restitution e_T,

    .. math:: -μ P_N \le P_F \le μ P_N, \quad\text{complementary to}\quad U^+ + e_T U^- .

    It dissipates the energy of sliding, μ r_N |U|; e_T > 0 returns some of that of an impact.

    With a static coefficient μ_s > μ it is a law with a memory, by the rule: surfaces that stick, U = 0, hold while
    |F| <= μ_s r_N; once they slide |F| = μ r_N, until U returns to zero, where they stick again if μ_s r_N suffices. In an
    impact the impulses obey the same rule, with U before it.

    ::

        o upper, feels -F
        ━━━
        ━━━  ---> U
        o lower, feels +F

    Parameters
    ----------
    upper, lower : str or mapping
        The two surfaces, as the coordinates along which they slide: {"x": 1.0, "φ": 0.1} for the rim of a wheel of 0.1 m.
    mu : float
    normal : str
        The name of the bumper whose reaction is the normal force.
    e_T : float
    name : str, optional
        The name of the force F in results; by default F, and F_2, F_3, ... for the next ones of a scheme without a name.
    mu_s : float, optional
    symbols : tuple of str
        How drawings call the coefficients.

    Raises
    ------
    InputError
        If mu is missing, negative or not finite, mu_s is less than mu, normal is no name, e_T lies outside [0, 1], mu_s > mu
        and e_T > 0 are given together, or both ends are one.

    Examples
    --------
    A ball of radius 0.1 m that is dropped on a rough floor:

    >>> from lcpimpact import Bumper, Load, Mass, Scheme
    >>> ball = Scheme(Mass("x", m=1.0), Mass("y", m=1.0), Mass("φ", m=0.004), Load("y", f=9.81))
    >>> ball = ball.add(Bumper("y", "ground", e=0.5, name="N"))
    >>> ball.add(Friction({"x": 1.0, "φ": 0.1}, "ground", mu=0.2, normal="N")).assemble().contacts[1].mu
    0.2

    References
    ----------
    Moreau (1988); Glocker, *Set-Valued Force Laws* (2001); Leine and Nijmeijer, *Dynamics and Bifurcations of Non-Smooth
    Mechanical Systems* (2004), on stick-slip.
    """

    upper: End
    lower: End
    mu: Annotated[float, "1, coefficient of friction, at least 0: the kinetic one if ``mu_s`` is given"] = MISSING
    normal: str = MISSING
    e_T: Annotated[
        float,
        "1, tangential coefficient of restitution in [0, 1]; 0 is Coulomb's law without one, and the only default "
        "of a physical constant",
    ] = 0.0
    name: str | None = None
    mu_s: Annotated[float | None, "1, static coefficient of friction, at least mu; mu by default"] = None
    symbols: tuple[str, ...] = ("μ", "μ_s")

    reaction: ClassVar[str] = "F"
    strokes: ClassVar[tuple[Polyline, ...]] = (
        ((0.0, 0.0), (0.47, 0.0)),
        ((0.47, -0.5), (0.47, 0.5)),
        ((0.53, -0.5), (0.53, 0.5)),
        ((0.53, -0.5), (0.6, -0.36)),
        ((0.53, -0.2), (0.6, -0.06)),
        ((0.53, 0.1), (0.6, 0.24)),
        ((0.53, 0.0), (1.0, 0.0)),
    )
    split: ClassVar[float | None] = 0.5

    def __post_init__(self) -> None:
        distinct(self)
        if self.mu is MISSING:
            raise InputError(f"{self}: mu is missing; give a coefficient of friction, 0 or more")
        if not is_real(self.mu) or not self.mu >= 0.0:
            raise InputError(f"{self}: mu = {self.mu!r} must be a finite number, 0 or more")
        if not is_name(self.normal):
            raise InputError(
                f"{self}: normal = {self.normal!r} must be the name of the bumper that bounds the friction"
            )
        between(f"{self}: e_T", self.e_T, 0.0, 1.0)
        if self.mu_s is None:
            return
        if not is_real(self.mu_s) or not self.mu_s >= self.mu:
            raise InputError(f"{self}: mu_s = {self.mu_s!r} must be a finite number, at least mu = {self.mu!r}")
        if self.mu_s > self.mu and self.e_T > 0.0:
            raise InputError(
                f"{self}: e_T = {self.e_T!r} and mu_s = {self.mu_s!r} above mu = {self.mu!r} together are no law: slip that "
                "an impact reverses does not stick; leave one of them out"
            )

    @property
    def ends(self) -> tuple[End, End]:
        """The two surfaces."""
        return (self.upper, self.lower)

    @property
    def labels(self) -> tuple[str, ...]:
        """The symbols of the coefficients that are given."""
        return self.symbols if self.mu_s is not None else self.symbols[:1]

    def contribute(self, terms: Terms) -> None:
        """Add a row to H, whose bounds follow from the reaction of another row."""
        terms.rows.append(
            Row(
                str(self),
                self.name or self.reaction,
                self.upper,
                self.lower,
                0.0,
                e=number(self.e_T),
                law=FRICTION,
                bounds=(-math.inf, math.inf),
                mu=number(self.mu),
                mu_s=number(self.mu if self.mu_s is None else self.mu_s),
                normal=self.normal,
            )
        )
