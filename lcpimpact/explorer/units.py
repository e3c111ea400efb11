"""The units of the numbers that sliders change, as problems and elements state them."""

from __future__ import annotations

from collections.abc import Iterable

from lcpimpact.problems import PROBLEMS
from lcpimpact.problems.base import Problem
from lcpimpact.problems.parameters import is_registered
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.stated import stated

OF_INITIAL = {"q0": "m", "v0": "m/s"}


def units_of(problem: Problem, addresses: Iterable[str]) -> dict[str, str]:
    """Return the units of the numbers at addresses that are known, by address; pure numbers have none."""
    parameters = stated(PROBLEMS[problem.name]) if is_registered(problem) else {}
    found = dict[str, str]()
    for address in addresses:
        where, _, name = address.rpartition(".")
        if address in parameters:
            found[address] = parameters[address].unit
        elif where.partition(".")[0] in OF_INITIAL and isinstance(problem.scheme, Scheme):
            found[address] = OF_INITIAL[where.partition(".")[0]]
        elif where and isinstance(problem.scheme, Scheme):
            for i, each in enumerate(problem.scheme.elements):
                if where in (str(i), type(each).__name__) and name in (known := stated(type(each))):
                    found[address] = known[name].unit
    return {address: unit for address, unit in found.items() if unit}
