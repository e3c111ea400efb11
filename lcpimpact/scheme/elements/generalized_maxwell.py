r"""The generalised Maxwell element: any relaxation that is a sum of exponentials, a Prony series."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, ClassVar

from numpy.typing import ArrayLike

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.numbers import finite, is_real
from lcpimpact.scheme.elements.base import MISSING, Compound, Element, Polyline, described, distinct
from lcpimpact.scheme.elements.maxwell import inner_nodes, maxwell_arm, relaxation_modulus
from lcpimpact.scheme.elements.spring import Spring


@described
@dataclass(frozen=True)
class GeneralizedMaxwell(Compound):
    r"""A spring beside Maxwell elements: a hereditary force whose modulus is a Prony series.

    .. math:: F(t) = \int_0^t G(t - s)\, x'(s)\, ds, \qquad G(t) = k_\infty + \sum_i k_i \exp(-t/τ_i)

    with x the elongation, zero at t = 0.

    Each arm is a spring k_i and a dashpot c_i = k_i τ_i in series, and its inner node NAME.i carries the memory: the
    integral over the past becomes one ordinary differential equation for each arm. Energy: ½ k_∞ x² + Σ ½ F_i²/k_i; the
    dashpots dissipate Σ F_i²/c_i.

    ::

                      k_inf
             +-------/\/\/\-------+
             |          NAME.1    |
        a o--+--/\/\/\--o--[ |----+--o b      pulls a towards b when it is stretched
             |   k_1         c_1  |
             |          NAME.2    |
             +--/\/\/\--o--[ |----+
             :   k_2         c_2  :

    Parameters
    ----------
    a, b : str
        The nodes that it joins; one may be the ground.
    k_inf : float
    k : sequence of float
    tau : sequence of float
    name : str, optional
        The name of the inner nodes, without their number; by default the two ends, as in x-ground.
    symbols : tuple of str
        How drawings call k_inf, and k_i and c_i without their index.

    Raises
    ------
    InputError
        If a constant is missing, not finite or not positive, k and tau differ in length, or both ends are one node.

    Examples
    --------
    >>> block = GeneralizedMaxwell("x", "ground", k_inf=10.0, k=(20.0, 30.0), tau=(0.1, 1.0))
    >>> block.nodes
    ('x', 'x-ground.1', 'x-ground.2', 'ground')
    >>> float(block.modulus(0.0))
    60.0

    References
    ----------
    Tschoegl, *The Phenomenological Theory of Linear Viscoelastic Behavior* (1989), chapter 3.
    """

    a: str
    b: str
    k_inf: Annotated[float, "N/m, stiffness after a long time; 0 for what flows without end"] = MISSING
    k: Annotated[tuple[float, ...], "N/m, stiffness k_i of each arm, positive; at least one"] = MISSING
    tau: Annotated[tuple[float, ...], "s, relaxation time τ_i of each arm, positive; as many as k"] = MISSING
    name: str | None = None
    symbols: tuple[str, ...] = ("k_inf", "k", "c")

    strokes: ClassVar[tuple[Polyline, ...]] = (
        ((0.0, 0.0), (0.1, 0.0)),
        ((0.1, -1.0), (0.1, 1.1)),
        ((0.1, -0.8), (0.3, -0.8), (0.35, -1.1), (0.45, -0.5), (0.55, -1.1), (0.65, -0.5), (0.7, -0.8), (0.9, -0.8)),
        ((0.1, 0.0), (0.18, 0.0), (0.22, -0.3), (0.3, 0.3), (0.38, -0.3), (0.46, 0.3), (0.5, 0.0), (0.66, 0.0)),
        ((0.66, -0.24), (0.66, 0.24)),
        ((0.58, 0.33), (0.77, 0.33), (0.77, -0.33), (0.58, -0.33)),
        ((0.77, 0.0), (0.9, 0.0)),
        *(((0.5, t), (0.5, t + 0.01)) for t in (0.55, 0.75, 0.95)),
        ((0.9, -1.0), (0.9, 1.1)),
        ((0.9, 0.0), (1.0, 0.0)),
    )

    def __post_init__(self) -> None:
        # Lists are kept as tuples, so that elements compare and read back as equal.
        arms = {symbol: _as_tuple(getattr(self, symbol)) for symbol in ("k", "tau")}
        object.__setattr__(self, "k", arms["k"] or ())
        distinct(self)
        if self.k_inf is MISSING:
            raise InputError(f"{self}: k_inf is missing; give a number in N/m, or 0 for an element that flows")
        finite(f"{self}: k_inf", self.k_inf, "N/m", least=0.0)
        for (symbol, values), unit in zip(arms.items(), ("N/m", "s"), strict=True):
            if not values or not all(is_real(value) and value > 0.0 for value in values):
                raise InputError(f"{self}: {symbol} must hold a positive finite number in {unit} for each arm")
            object.__setattr__(self, symbol, values)
        if len(self.k) != len(self.tau):
            raise InputError(
                f"{self}: {len(self.k)} values of k and {len(self.tau)} of tau: give one of each for an arm"
            )

    def drawn(self) -> tuple[Element, ...]:
        """Return the parts of up to three arms, and of more one symbol for them all."""
        return self.parts() if len(self.k) <= 3 else (self,)

    @property
    def nodes(self) -> tuple[str, ...]:
        """The two ends, and between them a node for each arm."""
        return (self.a, *inner_nodes(self.name, self.a, self.b, len(self.k)), self.b)

    def modulus(self, t: ArrayLike) -> Array:
        """Return G(t) in N/m, the force a time t > 0 after a unit step of the elongation, with the shape of t."""
        return relaxation_modulus(t, self.k_inf, self.k, self.tau)

    def parts(self) -> tuple[Element, ...]:
        """Return the spring if there is one, and the spring and the dashpot of each arm."""
        a, *inner, b = self.nodes
        k_inf, k, c = self.symbols
        arms = [
            maxwell_arm(a, node, b, k_i, k_i * tau_i, (f"{k}_{i}", f"{c}_{i}"))
            for i, (node, k_i, tau_i) in enumerate(zip(inner, self.k, self.tau, strict=True), 1)
        ]
        lasting = (Spring(a, b, self.k_inf, (k_inf,)),) if self.k_inf > 0.0 else ()
        return (*lasting, *(piece for arm in arms for piece in arm))


def _as_tuple(values: Iterable[float]) -> tuple[float, ...] | None:
    """Return the values as a tuple, or None if they are not a sequence of numbers."""
    try:
        return None if isinstance(values, str) else tuple(float(v) if is_real(v) else v for v in values)
    except TypeError:
        return None
