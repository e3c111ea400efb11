"""A published case: where its numbers stand, the problem that they belong to, and how a run shows them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from importlib.resources import files

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.problems.base import Problem
from lcpimpact.schemefile import Run
from lcpimpact.trajectory import Trajectory

Measure = Callable[[Trajectory], float]

AGREEMENT = 0.1
"""Part of the error of a published value, within which our values agree with each other or with the closed form."""


class Fate(Enum):
    """The fate of a published value."""

    MET = "met"
    REFUTED = "refuted"
    NOT_MET = "not met"
    NOT_FOUND = "not found"


@dataclass(frozen=True)
class Published:
    """A number of a source, and how far from it the source lets a program be.

    Attributes
    ----------
    what : str              the quantity, in words
    value : float           as published; of a requirement the limit
    measure : str or callable
        A name of `lcpimpact.quantities`, or a function of a run.
    rtol, atol : float      tolerances of the source: relative to the value, and absolute
    truth : float           closed form that judges it; nan without one
    derivation : str        why a published value cannot be right
    below : bool            whether it is a requirement: to be below the value
    """

    what: str
    value: float
    measure: str | Measure
    rtol: float = 0.0
    atol: float = 0.0
    truth: float = math.nan
    derivation: str = ""
    below: bool = False

    @property
    def tolerance(self) -> float:
        """The largest error that the source lets pass."""
        return max(self.rtol * abs(self.value), self.atol)

    def verdict(self, ours: Array) -> Fate:
        """Return the verdict on the value, by what each of our methods gives (n,).

        It is met if each method is within the tolerance of the source. It is refuted if a derivation says why, and the
        closed form, or in its place two methods or more, are farther from it than that tolerance and ten times nearer to
        each other.
        """
        if self.below:
            return Fate.MET if bool((ours < self.value).all()) else Fate.NOT_MET
        if bool((abs(ours - self.value) <= self.tolerance).all()):
            return Fate.MET
        known = np.append(ours, self.truth) if math.isfinite(self.truth) else ours
        off = abs(known - self.value).min()
        agree = len(known) > 1 and float(known.max() - known.min()) <= AGREEMENT * off
        return Fate.REFUTED if agree and off > self.tolerance and self.derivation else Fate.NOT_MET


@dataclass(frozen=True)
class PublishedCase:
    """A published problem with its numbers.

    Attributes
    ----------
    name : str              as the source calls it
    what : str              the system, in a few words
    source : str            keys of the bibliography, or the repository, path and commit
    problem : callable      makes the `Problem`
    runs : tuple of Run     the methods, each with its step
    published : tuple of Published
    """

    name: str
    what: str
    source: str
    problem: Callable[[], Problem]
    runs: tuple[Run, ...]
    published: tuple[Published, ...]


@dataclass(frozen=True)
class NotFound:
    """Numbers that no source gives, or that cannot be reproduced here, with the reason."""

    name: str
    what: str
    source: str
    reason: str


@dataclass(frozen=True)
class Suite:
    """The cases of one publisher, and what of them is not there.

    Attributes
    ----------
    title : str
    cases : tuple of PublishedCase
    not_found : tuple of NotFound
    """

    title: str
    cases: tuple[PublishedCase, ...]
    not_found: tuple[NotFound, ...] = ()


def numbers_of(name: str) -> Array:
    """Return the published numbers of a file of this folder's ``data``: a row each line, without the header (n, m).

    Raises
    ------
    InputError
        If the file is not there.
    """
    file = files("lcpimpact.validation").joinpath("data", name)
    if not file.is_file():
        raise InputError(f"the data file {name!r} of published numbers is not there: install lcpimpact again")
    return np.loadtxt(file.read_text(encoding="utf-8").splitlines(), delimiter=",", comments="#", skiprows=1, ndmin=2)
