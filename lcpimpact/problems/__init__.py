"""Named, parametrised problems with their sources and closed forms. They hold no solver."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from lcpimpact.registry import Registry

if TYPE_CHECKING:
    from lcpimpact.problems.base import Problem

PROBLEMS: Registry[Callable[..., Problem]] = Registry(
    "problem",
    {
        "system-1": "lcpimpact.problems.paper:system_1",
        "system-2": "lcpimpact.problems.paper:system_2",
        "system-3": "lcpimpact.problems.paper:system_3",
        "bouncing-ball": "lcpimpact.problems.bouncing_ball:bouncing_ball",
    },
)


def load_problem(name: str, **parameters: float) -> Problem:
    """Return the registered problem ``name`` with some of its parameters changed.

    Parameters
    ----------
    name : str
        A name of ``lcpimpact list problems``.
    **parameters : float
        New values, in SI units; the others keep the values of the problem's source.

    Raises
    ------
    InputError
        For an unknown name or parameter (the nearest is offered), or a value that the problem refuses.

    Examples
    --------
    >>> load_problem("system-1", c_o=300.0).parameters["c_o"]
    300.0
    """
    from lcpimpact.problems.base import build

    return build(name, PROBLEMS[name], parameters)
