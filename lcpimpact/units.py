"""Units by their names, as measurements and annotations state them: kN, mm/s, N s/m, m/s², °, each a factor and a dimension.

A unit is a product of symbols with powers, with a space, ·, * or a point between them, and / before all that divides. A
symbol is one of `SYMBOLS`, with a prefix of the SI before it, but for those in `PLAIN`.
"""

from __future__ import annotations

import math
import re
import unicodedata
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.registry import nearest

PREFIXES = {
    "": 0, "da": 1, "h": 2, "k": 3, "M": 6, "G": 9, "d": -1, "c": -2, "m": -3, "u": -6, "\N{GREEK SMALL LETTER MU}": -6,
    "n": -9,
}  # fmt: skip
"""Prefix to its power of ten."""

POWER = re.compile(
    r"(?P<join>[ ·⋅*./(]*)(?P<symbol>[^\W\d_]+|[°%])"
    r"(?:\^?\((?P<broken>-?\d+/\d+)\)|(?:\^|\*\*)?(?P<power>-?\d+))?"
)
"""A power of a symbol, with what is between it and the one before."""


@dataclass(frozen=True)
class Unit:
    """A unit of measurement.

    Attributes
    ----------
    text : str                          as given
    factor : Fraction                   its size in the coherent unit of the SI
    dimension : tuple of Fraction       powers of mass, length, time, angle and current
    coherent : str                      that unit, as "N/m" for kN/mm
    """

    text: str
    factor: Fraction
    dimension: tuple[Fraction | int, ...]
    coherent: str

    @classmethod
    @cache
    def of(cls, text: str) -> Unit:
        """Return the unit of a text; "", "1" and "-" are that of pure numbers.

        Raises
        ------
        InputError
            For a text that names none; the nearest symbol is offered.

        Examples
        --------
        >>> kilonewton = Unit.of("kN")
        >>> int(kilonewton.factor), kilonewton.coherent, Unit.of("kN/mm").coherent
        (1000, 'N', 'N/m')
        """
        plain = unicodedata.normalize("NFKC", text).replace("\N{MINUS SIGN}", "-").strip()  # m² is m2 then
        factor, dimension = Fraction(1), [Fraction(0)] * 5
        if plain in ("", "1", "-"):
            return cls(text, factor, tuple(dimension), "")
        rest = plain.rstrip(" .")
        coherent, sign = "", 1
        if rest.startswith("1/"):
            coherent, rest = "1", rest[1:]
        while rest:
            found = POWER.match(rest)
            if found is None:
                raise InputError(_unknown(text, plain))
            rest = rest[found.end() :]
            if "/" in found["join"]:
                sign = -1
            one = _symbol(found["symbol"], text)
            power = sign * Fraction(found["broken"] or found["power"] or 1)
            factor *= Fraction(one.factor**power)  # a float where the power is broken
            dimension = [total + power * each for total, each in zip(dimension, one.dimension, strict=True)]
            coherent += found[0].replace(found["symbol"], one.coherent, 1)
            if rest.startswith(")"):
                coherent, rest = f"{coherent})", rest[1:]
        return cls(text, factor, tuple(dimension), text if coherent == plain else coherent)

    def converted(self, values: Array) -> Array:
        """Return values of this unit in the coherent one, each rounded where a factor has no exact reciprocal."""
        return values * float(self.factor.numerator) / float(self.factor.denominator)


SYMBOLS = {
    "m": Unit("m", Fraction(1), (0, 1, 0, 0, 0), "m"),
    "g": Unit("g", Fraction("1e-3"), (1, 0, 0, 0, 0), "kg"),
    "s": Unit("s", Fraction(1), (0, 0, 1, 0, 0), "s"),
    "rad": Unit("rad", Fraction(1), (0, 0, 0, 1, 0), "rad"),
    "A": Unit("A", Fraction(1), (0, 0, 0, 0, 1), "A"),
    "N": Unit("N", Fraction(1), (1, 1, -2, 0, 0), "N"),
    "Nm": Unit("Nm", Fraction(1), (1, 2, -2, 0, 0), "N m"),
    "Ns": Unit("Ns", Fraction(1), (1, 1, -1, 0, 0), "N s"),
    "J": Unit("J", Fraction(1), (1, 2, -2, 0, 0), "J"),
    "W": Unit("W", Fraction(1), (1, 2, -3, 0, 0), "W"),
    "Pa": Unit("Pa", Fraction(1), (1, -1, -2, 0, 0), "Pa"),
    "Hz": Unit("Hz", Fraction(1), (0, 0, -1, 0, 0), "Hz"),
    "V": Unit("V", Fraction(1), (1, 2, -3, 0, -1), "V"),
    "F": Unit("F", Fraction(1), (-1, -2, 4, 0, 2), "F"),
    "H": Unit("H", Fraction(1), (1, 2, -2, 0, -2), "H"),
    "Ω": Unit("Ω", Fraction(1), (1, 2, -3, 0, -2), "Ω"),
    "bar": Unit("bar", Fraction("1e5"), (1, -1, -2, 0, 0), "Pa"),
    "sec": Unit("sec", Fraction(1), (0, 0, 1, 0, 0), "s"),
    "Sek": Unit("Sek", Fraction(1), (0, 0, 1, 0, 0), "s"),
    "min": Unit("min", Fraction(60), (0, 0, 1, 0, 0), "s"),
    "h": Unit("h", Fraction(3600), (0, 0, 1, 0, 0), "s"),
    "°": Unit("°", Fraction(math.pi / 180.0), (0, 0, 0, 1, 0), "rad"),
    "deg": Unit("deg", Fraction(math.pi / 180.0), (0, 0, 0, 1, 0), "rad"),
    "in": Unit("in", Fraction("0.0254"), (0, 1, 0, 0, 0), "m"),
    "inch": Unit("inch", Fraction("0.0254"), (0, 1, 0, 0, 0), "m"),
    "ft": Unit("ft", Fraction("0.3048"), (0, 1, 0, 0, 0), "m"),
    "lbf": Unit("lbf", Fraction("4.4482216152605"), (1, 1, -2, 0, 0), "N"),
    "kp": Unit("kp", Fraction("9.80665"), (1, 1, -2, 0, 0), "N"),
    "rpm": Unit("rpm", Fraction(math.pi / 30.0), (0, 0, -1, 1, 0), "rad/s"),
    "%": Unit("%", Fraction("0.01"), (0, 0, 0, 0, 0), "1"),
}
"""Units by their symbols: factor, powers of kg, m, s, rad and A, and the coherent unit of the SI."""

PLAIN = ("min", "h", "°", "deg", "in", "inch", "ft", "lbf", "kp", "rpm", "%")
"""Symbols without prefixes."""


def conversion(text: str, wanted: str) -> Unit:
    """Return the unit of a text with its factor to another one.

    Parameters
    ----------
    text : str
        The unit of the values.
    wanted : str
        The unit that they are to have; "" for the coherent one of the SI.

    Raises
    ------
    InputError
        For an unknown unit, or one of another dimension.

    Examples
    --------
    >>> float(conversion("ms", "s").factor)
    0.001
    >>> conversion("kg", "N")
    Traceback (most recent call last):
        ...
    lcpimpact.errors.InputError: 'kg' is no unit for what is in N, as mN, kN or MN
    """
    if text == wanted:
        return Unit(text, Fraction(1), (), wanted)
    found = Unit.of(text)
    if not wanted:
        return found
    target = Unit.of(wanted)
    if found.dimension != target.dimension:
        alike = [f"{prefix}{wanted}" for prefix in ("m", "k", "M") if wanted in SYMBOLS and wanted not in PLAIN]
        hint = f", as {', '.join(alike[:2])} or {alike[2]}" if alike else ""
        raise InputError(f"{text!r} is no unit for what is in {wanted}{hint}")
    return Unit(text, found.factor / target.factor, found.dimension, wanted)


def is_unit(text: str) -> bool:
    """Return whether a text names a unit.

    Examples
    --------
    >>> [is_unit(text) for text in ("ms", "m/s²", "N s/m", "Kraft", "1.5")]
    [True, True, True, False, False]
    """
    try:
        return Unit.of(text).coherent != ""
    except InputError:
        return False


def is_alike(text: str, wanted: str) -> bool:
    """Return whether a text names a unit of the dimension of another, or none.

    Examples
    --------
    >>> [is_alike(text, "N") for text in ("", "kN", "mm")]
    [True, True, False]
    """
    return not text or (is_unit(text) and Unit.of(text).dimension == Unit.of(wanted).dimension)


def _symbol(name: str, text: str) -> Unit:
    """Return the unit of a symbol with its prefix."""
    if name in SYMBOLS:
        return SYMBOLS[name]
    for prefix, power in PREFIXES.items():
        symbol = name.removeprefix(prefix)
        if name.startswith(prefix) and symbol in SYMBOLS and symbol not in PLAIN:
            return replace(SYMBOLS[symbol], text=name, factor=SYMBOLS[symbol].factor * Fraction(10) ** power)
    raise InputError(_unknown(text, name))


def _unknown(text: str, name: str) -> str:
    """Return the sentence for a text of which a symbol is unknown."""
    usual = ["s", "ms", "us", "m", "mm", "um", "N", "kN", "MN", "rad", "°", "kg"]
    others = [f"{prefix}{symbol}" for symbol in SYMBOLS if symbol not in PLAIN for prefix in PREFIXES]
    alike = next((each for each in others if each.casefold() == name.casefold()), name)
    said = nearest(alike, [*usual, *PLAIN, *others], "unit", max_names=len(usual)).replace(repr(alike), repr(name), 1)
    return f"{said}{'' if name == text else f', in {text!r}'}, all listed in the guide 'Design and fit'"
