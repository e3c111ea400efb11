"""The units of the numbers that sliders change, as problems and the docstrings of elements state them."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable
from functools import cache

from lcpimpact.problems import PROBLEMS
from lcpimpact.problems.base import Problem
from lcpimpact.problems.parameters import is_registered
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.stated import stated

SYMBOL = r"(?:kg|rad|N|J|W|V|A|F|H|Ω|m|s)[²³⁴]?"

UNIT = re.compile(rf"\bin ({SYMBOL}(?:[ /·]{SYMBOL})*)(?=[ ,;:.)]|$)(?! {SYMBOL}\^)")
"""A unit in a description, as in "Stiffness in N/m"."""

ENTRY = re.compile(r"^([^\W\d]\w*(?:, \w+)*) : .*\n((?:    .*\n?)+)", re.MULTILINE)
"""A parameter, or several, and its description in a docstring of numpydoc's form."""

OF_INITIAL = {"q0": "m", "v0": "m/s"}


@cache
def stated_units(thing: type) -> dict[str, str]:
    """Return the units that a docstring states of parameters, by their names; of others none.

    Examples
    --------
    >>> from lcpimpact import KelvinVoigt
    >>> stated_units(KelvinVoigt)
    {'k': 'N/m', 'c': 'N s/m'}
    """
    found, last = dict[str, str](), list[str]()
    for names, text in ENTRY.findall(inspect.getdoc(thing) or ""):
        each, units = names.split(", "), UNIT.findall(text)
        if not units and text.strip().startswith("The same"):
            units = last  # as "The same of the ground structure."
        last = units
        if len(each) == 1 or len(set(units)) == 1:
            units = units[:1] * len(each)
        if len(units) == len(each):
            found |= dict(zip(each, units, strict=True))
    return found


def units_of(problem: Problem, addresses: Iterable[str]) -> dict[str, str]:
    """Return the units of the numbers at addresses that are known, by address; pure numbers have none."""
    parameters = stated(PROBLEMS[problem.name]) if is_registered(problem) else {}
    found = dict[str, str]()
    for address in addresses:
        where, _, name = address.rpartition(".")
        if address in parameters:
            found |= {address: parameters[address].unit} if parameters[address].unit else {}
        elif where.partition(".")[0] in OF_INITIAL and isinstance(problem.scheme, Scheme):
            found[address] = OF_INITIAL[where.partition(".")[0]]
        elif where and isinstance(problem.scheme, Scheme):
            kinds = {
                type(each) for i, each in enumerate(problem.scheme.elements) if where in (str(i), type(each).__name__)
            }
            known = stated_units(next(iter(kinds))) if kinds else {}
            found |= {address: known[name]} if name in known else {}
    return found
