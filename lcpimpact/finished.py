"""A finished run, as its quantities and files read it: the type of `lcpimpact.Trajectory` for what stands below it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Protocol

from lcpimpact.arrays import Array
from lcpimpact.errors import Status
from lcpimpact.files import Json
from lcpimpact.integrators.base import Integrator
from lcpimpact.problems.base import Problem
from lcpimpact.reading import Readable
from lcpimpact.record import Stats

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


class EstimatedError(Protocol):
    """The estimated error of a run; see `lcpimpact.RunError`."""

    @property
    def known(self) -> bool:
        """Whether it could be estimated."""

    @property
    def summary(self) -> Mapping[str, float]:
        """Errors of the quantities of the run."""

    def to_dict(self) -> Mapping[str, Json]:
        """Return the error as plain JSON."""


class FinishedRun(Readable, Protocol):
    """A run with the problem, the method and the cost that belong to it."""

    @property
    def problem(self) -> Problem:
        """The problem of the run."""

    @property
    def method(self) -> str:
        """The method and its options."""

    @property
    def integrator(self) -> Integrator | None:
        """The method itself."""

    @property
    def lcp_solver(self) -> str:
        """Name of the LCP solver."""

    @property
    def status(self) -> Status:
        """Whether it is solved, or why it ended early."""

    @property
    def message(self) -> str:
        """The status in words."""

    @property
    def certificate(self) -> DataclassInstance:
        """Its certificate."""

    @property
    def stats(self) -> Stats:
        """Its cost."""

    @property
    def nodes(self) -> tuple[str, ...]:
        """Names of the coordinates."""

    @property
    def force_names(self) -> tuple[str, ...]:
        """Names of the forces."""

    @property
    def push(self) -> Array:
        """Forces of the non-linear springs (nr, ns)."""

    @property
    def estimates(self) -> bool:
        """Whether its error is estimated."""

    def quick_error(self) -> EstimatedError | None:
        """Return the error if it is known or quick to estimate."""

    def error_lines(self) -> Sequence[str]:
        """Return the error in words."""

    def summary(self) -> Mapping[str, float]:
        """Return its quantities by name."""
