"""The errors that lcpimpact raises and the statuses that its results carry.

A failure is data: a solver or an integrator that does not succeed returns a `Status`, whose sentence names the remedy.
Only invalid input, and a failure with ``throw=True``, raise an exception.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import Any


class Status(IntEnum):
    """Outcome of a solve or a simulation; ``status.sentence`` states it in words and names the remedy."""

    SOLVED = 0, "Solved: the laws hold to the stated residuals, checked outside the solver."
    RAY = (
        1,
        "The problem has no solution: a ray in the result proves it; check q and M, and take the rows of the ray first.",
    )
    INFEASIBLE = 2, "The problem has no solution: no complementary basis is feasible; check the sign of q and M."
    UNDECIDED = (
        3,
        "The method could not decide whether a solution exists: try solver='auto', or 'enumeration' for n <= 15.",
    )
    MAX_ITER = (
        4,
        "The iteration limit was reached first: raise max_iter, loosen tol or take another solver ('newton-fb' for any M).",
    )
    SINGULAR = 5, "A matrix that had to be factored is singular: look for redundant contacts, or take solver='lemke'."
    NON_FINITE = 6, "A number overflowed or is not finite: check the data, or take a smaller dt."
    INACCURATE = 7, "The solver's answer failed the check outside it: loosen tol or take a direct solver."
    MAX_EVENTS = (
        8,
        "More events than max_events: impacts or switches may accumulate; raise max_events or take moreau-jean.",
    )
    INTERRUPTED = 9, "Interrupted: the trajectory holds the steps that were finished."
    NEWTON = 10, "The non-linear springs and forces did not converge: check their constants and their derivatives."
    STEP_SIZE = (
        11,
        "The steps fell below what their error allows: loosen rtol and atol, or, if stiff, take another method.",
    )
    SWITCH = (
        12,
        "An element that ends at a switch of the contact mode could not be solved: take a smaller dt, raise max_newton, or "
        "take method='exact'.",
    )
    VIOLATED = (
        20,
        "The run reached its end, but breaks its laws by more than its method allows: take a smaller dt or tighter "
        "tolerances, or take another method.",
    )

    ACCUMULATION = (
        14,
        "Impacts of several bodies accumulate, faster than numbers can tell in which order: the run ends before the limit; "
        "give the bodies a spring between them, or take moreau-jean.",
    )

    AMBIGUOUS = (
        16,
        "Several motions obey the laws of friction or relays from here on, since the LCP of the mode has several solutions "
        "(see all_solutions): change the initial state, the bounds or the inputs a little.",
    )

    TOO_MANY_ROWS = (
        17,
        "More than five rough contacts are closed at once, so that the LCP of the mode cannot be searched for all its "
        "solutions: take moreau-jean, or fewer contacts.",
    )

    NO_VELOCITY = (
        18,
        "No velocity was found that obeys the law of impact of all contacts that meet, as where the rebounds of redundant "
        "contacts exclude each other: take e = 0 there, with which one exists between bodies at rest.",
    )

    ENDLESS_IMPACT = (
        19,
        "An impact of touching bodies does not end within the steps of its law, as where masses or stiffnesses differ by "
        "orders of magnitude: take impact_law='poisson', or leave it out, which is Newton's law.",
    )

    MAX_STEPS = (
        15,
        "More steps than max_steps: the motion is stiff, or vibrates fast for its length; take method='exact' if it is "
        "linear, ode_solver='Radau' if fast rates have decayed, or raise max_steps.",
    )

    NOT_RUN = 21, "The run could not be made with these values: the message of the set says why, and the remedy."

    sentence: str

    def __new__(cls, code: int, sentence: str = "") -> Status:
        """Attach the sentence to the code."""
        member = int.__new__(cls, code)
        member._value_ = code
        member.sentence = sentence
        return member

    def sentence_of(self, solver: str) -> str:
        """Return the sentence for an LCP solver: 'auto' is no remedy where it was taken."""
        if self is Status.UNDECIDED and solver == "auto":
            return (
                "No method could decide whether a solution exists: look for equations or contacts that depend on each "
                "other, and leave one of them out, or change q a little."
            )
        return self.sentence


class LcpImpactError(Exception):
    """Base class of the errors of lcpimpact."""


class InputError(LcpImpactError, ValueError):
    """An invalid value; the message names it and the remedy."""


class UnknownNameError(InputError):
    """A name that is not registered; the message offers the nearest one."""


class UnsupportedError(LcpImpactError):
    """A feature that a method does not handle; the message names methods that do.

    Attributes
    ----------
    reason : str            the message without their names
    methods : tuple of str  their names
    """

    def __init__(self, reason: str, methods: Sequence[str] = ()) -> None:
        self.reason, self.methods = reason, tuple(methods)
        named = f"take method={' or '.join(map(repr, methods))}"
        super().__init__(reason + named if methods else reason.removesuffix(": ").removesuffix(", or "))


class FailureError(LcpImpactError):
    """A solve or a simulation failed and ``throw=True`` was set.

    Attributes
    ----------
    result : LCPSolution or Trajectory
        The result up to the failure, the same object that ``throw=False`` returns.
    """

    def __init__(self, message: str, result: Any) -> None:
        super().__init__(message)
        self.result = result

    def __reduce__(self) -> tuple[Any, ...]:
        """Keep the result when the error is pickled, as on its way from another process."""
        return type(self), (str(self), self.result)
