"""The sets of parameters of a sweep: a grid, a list, or samples of ranges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.stats import qmc

from lcpimpact.arguments import checked, short
from lcpimpact.arrays import Array, Indices
from lcpimpact.errors import InputError
from lcpimpact.numbers import count as check_count
from lcpimpact.numbers import is_real, random_numbers
from lcpimpact.registry import nearest

if TYPE_CHECKING:
    from xarray import DataArray as DataArray
    from xarray import Dataset as Dataset

RULES = ("latin-hypercube", "sobol", "halton", "random", "saltelli")
"""Rules by which ranges are sampled."""

SAMPLE = "sample"
"""Dimension of a list of sets."""


@dataclass(frozen=True, eq=False)
class Samples:
    """A list of sets of parameters, one a row.

    Parameters
    ----------
    values : DataFrame or mapping of str to sequence of float
        One column a parameter, all of equal length, in SI units.
    rule : str
        How they were chosen; "list" if by hand.
    count : int
        Number of base points of the rule.

    Raises
    ------
    InputError
        For no values, columns of different lengths, and values that are not finite numbers.

    Examples
    --------
    >>> from lcpimpact import Samples, load_problem, sweep
    >>> stops = Samples({"k_o": [3000.0, 4000.0], "c_o": [250.0, 300.0]})
    >>> sweep(load_problem("system-1"), stops, dt=1e-2)["R.max"].dims
    ('sample',)
    """

    values: Mapping[str, Array]
    rule: str = "list"
    count: int = 0

    def __post_init__(self) -> None:
        given = self.values
        if not isinstance(given, (Mapping, pd.DataFrame)):
            raise InputError(f"values = {short(given)} must be a DataFrame, or map parameters to sequences of numbers")
        found = {str(name): _numbers(str(name), given[name]) for name in given}
        if len({len(each) for each in found.values()}) != 1:
            lengths = ", ".join(f"{len(each)} of {name}" for name, each in found.items()) or "none"
            raise InputError(f"a list of sets needs as many values of each parameter, and has {lengths}")
        object.__setattr__(self, "values", found)

    @property
    def table(self) -> pd.DataFrame:
        """The sets as a table, one a row."""
        return pd.DataFrame(dict(self.values))

    def __len__(self) -> int:
        return len(next(iter(self.values.values())))


@checked
def draw_samples(
    ranges: Mapping[str, Sequence[float]],
    count: int,
    rule: str = "latin-hypercube",
    *,
    seed: int = 0,
    log: Sequence[str] = (),
) -> Samples:
    """Return samples of ranges of parameters, the same for the same seed.

    Parameters
    ----------
    ranges : mapping of str to (low, high)
        Ends of the range of each parameter in SI units.
    count : int
        Number of samples n; a power of 2 for "sobol" and "saltelli".
    rule : str
        "latin-hypercube", "sobol" (scrambled), "halton" (scrambled), "random" (independent), or "saltelli": n (d + 2) sets
        of d parameters, from which `sobol_indices` finds the sensitivity to each.
    seed : int
    log : sequence of str
        Parameters that are uniform on a logarithmic scale.

    Returns
    -------
    Samples

    Raises
    ------
    InputError
        For an unknown rule, an empty or infinite range, and a logarithmic one that is not positive.

    Examples
    --------
    >>> from lcpimpact import draw_samples
    >>> draw_samples({"k_o": (3000.0, 5000.0), "c_o": (100.0, 400.0)}, 4, "sobol").table.round(0).shape
    (4, 2)

    References
    ----------
    Saltelli et al., Variance based sensitivity analysis of model output (2010).
    """
    check_count("count", count)
    if rule not in RULES:
        raise InputError(nearest(rule, list(RULES), "rule"))
    if not ranges:
        raise InputError("ranges names no parameter: give one, as {'k_o': (3000.0, 5000.0)}")
    if rule in ("sobol", "saltelli") and count & (count - 1):
        raise InputError(f"count = {count} must be a power of 2 for {rule}: take {1 << int(count).bit_length()}")
    ends = {name: _range(name, each, name in log) for name, each in ranges.items()}
    for name in log:
        if name not in ends:
            raise InputError(f"log: {nearest(name, list(ends), 'parameter of ranges')}")
    u = _unit_cube(rule, len(ends), int(count), seed)
    columns = {}
    for (name, (low, high)), x in zip(ends.items(), u.T, strict=True):
        columns[name] = low * (high / low) ** x if name in log else low + (high - low) * x
    return Samples(columns, rule, int(count))


def _unit_cube(rule: str, d: int, n: int, seed: int) -> Array:
    """Return points of the unit cube (n, d); of "saltelli" A, B, and A with each column of B in turn (n (d + 2), d)."""
    rng = random_numbers(seed)
    if rule == "random":
        return rng.random((n, d))
    if rule == "saltelli":
        a, b = np.hsplit(np.asarray(qmc.Sobol(2 * d, seed=rng).random(n)), 2)
        mixed = [np.where(np.arange(d) == i, b, a) for i in range(d)]
        return np.vstack([a, b, *mixed])
    engine = {"latin-hypercube": qmc.LatinHypercube, "sobol": qmc.Sobol, "halton": qmc.Halton}[rule]
    return np.asarray(engine(d, seed=rng).random(n))


def _range(name: str, ends: Sequence[float], log: bool) -> tuple[float, float]:
    if len(ends) != 2 or not all(map(is_real, ends)) or not ends[0] < ends[1]:
        raise InputError(f"ranges[{name!r}] = {short(ends)} must be two finite numbers, the lower one first")
    if log and ends[0] <= 0.0:
        raise InputError(f"ranges[{name!r}] = {short(ends)} must be above zero for a logarithmic scale")
    return float(ends[0]), float(ends[1])


@dataclass(frozen=True, eq=False)
class Plan:
    """The sets of a sweep in their order: a grid, last parameter fastest, or a list.

    Attributes
    ----------
    axes : mapping of str to (n,) array     values of each parameter: of the axes of a grid, or of the columns of a list
    listed : bool                           whether it is a list
    rule, count                             as of `Samples`
    """

    axes: Mapping[str, Array]
    listed: bool = False
    rule: str = "grid"
    count: int = field(default=0)

    @classmethod
    def of(cls, parameters: Any) -> Plan:
        """Return the sets of a mapping (a grid), a DataFrame or Samples (a list).

        Raises
        ------
        InputError
            For no parameters, no values, and values that are not finite numbers or occur twice in a grid.
        """
        if isinstance(parameters, pd.DataFrame):
            parameters = Samples(parameters)
        if isinstance(parameters, Samples):
            return cls(parameters.values, True, parameters.rule, parameters.count)
        if not isinstance(parameters, Mapping) or not parameters:
            raise InputError(
                f"parameters = {short(parameters)} must map names to values, as {{'k_o': [3000.0, 4000.0]}}, or be a "
                "DataFrame or Samples"
            )
        axes = {str(name): _numbers(str(name), values) for name, values in parameters.items()}
        for name, values in axes.items():
            if len(np.unique(values)) < len(values):
                raise InputError(f"the values of {name} repeat: give each once")
        return cls(axes)

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """Number of values along each dimension."""
        sizes = [len(values) for values in self.axes.values()]
        return (sizes[0],) if self.listed else tuple(sizes)

    @property
    def dims(self) -> tuple[str, ...]:
        """Names of the dimensions."""
        return (SAMPLE,) if self.listed else tuple(self.axes)

    @property
    def size(self) -> int:
        """Number of sets."""
        return int(np.prod(self.shape))

    def values(self, sets: Indices) -> dict[str, Array]:
        """Return the values of some sets, by their numbers in the order of the plan."""
        where = [sets] * len(self.axes) if self.listed else np.unravel_index(sets, self.shape)
        return {name: axis[at] for (name, axis), at in zip(self.axes.items(), where, strict=True)}


def _numbers(name: str, values: ArrayLike) -> Array:
    """Return the values of a parameter, after a check."""
    try:
        found = np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"the values of {name} must be numbers") from None
    if found.ndim != 1 or found.size == 0:
        raise InputError(f"{name} = {short(values)} must be a sequence of at least one number")
    if not np.isfinite(found).all():
        raise InputError(
            f"value {int(np.argmin(np.isfinite(found)))} of {name} is {found[~np.isfinite(found)][0]}: give finite numbers"
        )
    return found


def swept_parameters(dataset: Dataset) -> list[str]:
    """Return the names of the parameters of the Dataset of a sweep.

    Raises
    ------
    InputError
        For anything else.
    """
    attributes = getattr(dataset, "attrs", {})
    if not hasattr(dataset, "data_vars") or "parameters" not in attributes:
        raise InputError(f"dataset = {short(dataset)} must be a Dataset of sweep(...)")
    return str(attributes["parameters"]).split(", ")
