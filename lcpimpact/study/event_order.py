"""The order of the events of a run, and the range of a parameter in which they keep it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import groupby, pairwise, zip_longest
from typing import NamedTuple

from lcpimpact.problems.base import Problem
from lcpimpact.quantities import EVENT_NAME, quantity
from lcpimpact.record import Event


class Mark(NamedTuple):
    """An event, a sample, or the end of a run: its instant in s, the name in words, and the kind and contact of an event."""

    t: float
    name: str
    kind: str = ""
    contact: str = ""


class Group(NamedTuple):
    """Equal events that follow each other: their name, their number, and whether they accumulate, which has no number."""

    name: str
    number: int
    accumulates: bool


def marks_of(problem: Problem, events: Sequence[Event], end: float, outputs: Sequence[str]) -> list[Mark]:
    """Return the events and the end of a run and the samples among outputs, in their order."""
    samples = {min(quantity(name, problem).until, end) for name in outputs if "@" in name}
    marks = [Mark(event.t, f"{event.kind} of {event.contact}", event.kind, event.contact) for event in events]
    marks += [Mark(t, f"the sample at {t:g} s") for t in sorted(samples)]
    return sorted([*marks, Mark(end, "the end of the run")], key=lambda each: each.t)


def needed_of(marks: Sequence[Mark], outputs: Sequence[str]) -> list[Mark]:
    """Return the marks up to the last that an output depends on."""
    last = 0
    for name in outputs:
        if event := EVENT_NAME.fullmatch(name):
            kind, contact = event["kind"], event["contact"]
            alike = [k for k, each in enumerate(marks) if each.kind == kind and contact in (None, each.contact)]
            last = max(last, alike[int(event["number"]) - 1])
        elif "@" in name:
            t = float(name.rpartition("@")[2])
            last = max(last, max(k for k, each in enumerate(marks) if not each.kind and each.t <= t))
        else:
            last = len(marks) - 1
    return list(marks[: last + 1])


def groups_of(marks: Sequence[Mark], *, shortest: float = 1e-6) -> list[Group]:
    """Return the marks with equal ones that follow each other together.

    ``shortest``: time between two impacts, relative to the longest among them, below which they accumulate.
    """
    found = []
    for name, each in groupby(marks, key=lambda mark: mark.name):
        times = [mark.t for mark in each]
        flights = [after - before for before, after in pairwise(times)]
        accumulates = name.startswith("impact") and min(flights, default=1.0) < shortest * max(flights, default=1.0)
        found.append(Group(name, len(times), accumulates))
    return found


def first_difference(known: Sequence[Group], found: Sequence[Group]) -> str:
    """Return the first event in another order than that known, in words; "" if all that is known comes in its order."""
    for k, (old, new) in enumerate(zip_longest(known, found[: len(known)], fillvalue=Group("nothing", 0, False))):
        if new.name != old.name:
            return f"{new.name} instead of {old.name}"
        if (old.accumulates and new.accumulates) or new.number == old.number:
            continue
        if new.number < old.number:
            following = found[k + 1].name if k + 1 < len(found) else "nothing"
            return f"{following} instead of {old.name}"
        if k + 1 < len(known):
            return f"{old.name} instead of {known[k + 1].name}"
    return ""


def reach_of(
    value: float, size: float, happens: Callable[[float], str], *, limit: float = 1.0, first: float = 2.0**-20,
    growth: float = 4.0, least: float = 2.0**-40, rtol: float = 0.01,
) -> tuple[float, str]:  # fmt: skip
    """Return the farthest value of a parameter in one direction up to which nothing happens, and what happens behind it.

    From a distance that grows to ``limit`` times the size it is bisected. A change that is undone between two distances is
    not seen.

    Parameters
    ----------
    value, size : float
        The value, and its size with the sign of the direction.
    happens : callable
        Takes a value, and returns what happens there, in words, or "".
    limit : float
        Largest distance, relative to the size.
    first, growth, least : float
        First distance, relative to the size, the factor from one to the next, and the distance below which all is zero.
    rtol : float
        Part of the distance within which the bound is found.
    """
    near, far = 0.0, min(first, limit)
    while not (why := happens(value + far * size)):
        near = far
        if far >= limit:
            return value + limit * size, ""
        far = min(growth * far, limit)
    while far - near > rtol * far and far > least:
        middle = 0.5 * (near + far) if near else far / growth
        found = happens(value + middle * size)
        if found:
            far, why = middle, found
        else:
            near = middle
    return value + near * size, why
