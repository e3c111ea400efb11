"""Sobol' indices of the outputs of a sweep."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.registry import nearest
from lcpimpact.sweeps.samples import SAMPLE, swept_parameters

CONFIDENCE = 0.95
"""Level of the confidence intervals."""

RESAMPLES = 999
"""Number of bootstrap samples for the intervals."""

CONSTANT_RTOL = 1e-10
"""Range of an output, relative to its largest value, below which it is rounding."""


@checked
def sobol_indices(dataset: Any, output: str) -> pd.DataFrame:
    r"""Return the Sobol' indices of an output: the part of its variance that each parameter explains.

    With the output Y and the parameters X_i, independent over their ranges,

    .. math:: S_i = \frac{V(E(Y | X_i))}{V(Y)}, \qquad S_{Ti} = 1 - \frac{V(E(Y | X_{\sim i}))}{V(Y)},

    by the estimators of Saltelli et al. (2010) and of Jansen (1999). S_i is the part of X_i alone, S_Ti
    that of X_i with all its interactions.

    Parameters
    ----------
    dataset : xarray.Dataset
        Of `sweep`, with samples of ``draw_samples(ranges, n, "saltelli")``.
    output : str
        Name of an output that is a number.

    Returns
    -------
    DataFrame
        One row a parameter: ``parameter``, ``first`` and ``total``, and the ends of their 95 % intervals by the bootstrap,
        ``first_low``, ``first_high``, ``total_low`` and ``total_high``.

    Raises
    ------
    InputError
        For other samples, an unknown output, and one that has no value in some of the sets or varies by rounding only.

    Examples
    --------
    >>> from lcpimpact import draw_samples, load_problem, sobol_indices, sweep
    >>> ranges = {"m": (90.0, 110.0), "k_o": (3000.0, 5000.0), "c_o": (200.0, 300.0)}
    >>> found = sweep(load_problem("system-1"), draw_samples(ranges, 64, "saltelli"), dt=1e-2, t_end=0.5)
    >>> table = sobol_indices(found, "R.max")
    >>> table.loc[table["first"].idxmax(), "parameter"]
    'k_o'

    References
    ----------
    Saltelli et al., Variance based sensitivity analysis of model output (2010).
    """
    names = swept_parameters(dataset)
    if dataset.attrs["rule"] != "saltelli":
        raise InputError('Sobol\' indices need the sets of draw_samples(ranges, n, "saltelli"): sweep these')
    numbers = [
        name for name in dataset.data_vars if dataset[name].dims == (SAMPLE,) and name not in ("status", "message")
    ]
    if output not in numbers:
        raise InputError(nearest(output, numbers, "output"))
    y = np.asarray(dataset[output], dtype=np.float64)
    if missing := int(np.isnan(y).sum()):
        raise InputError(
            f"{output} has no value in {missing} of {len(y)} sets: see status and message, and narrow the ranges"
        )
    n = int(dataset.attrs["count"])
    if np.ptp(y) <= CONSTANT_RTOL * np.abs(y).max():
        raise InputError(f"{output} is the same in all sets but for rounding, so nothing explains its variance")
    parts = y.reshape(len(names) + 2, n)
    rng = np.random.default_rng(0)
    drawn = np.array([_indices(parts[:, rng.integers(n, size=n)]) for _ in range(RESAMPLES)])
    found = _indices(parts)
    low, high = np.quantile(drawn, [0.5 - 0.5 * CONFIDENCE, 0.5 + 0.5 * CONFIDENCE], axis=0)
    table = pd.DataFrame({"parameter": names})
    for k, name in enumerate(("first", "total")):
        table = table.assign(**{name: found[k], f"{name}_low": low[k], f"{name}_high": high[k]})
    return table


def _indices(parts: Array) -> Array:
    """Return the indices of first order and in total (2, d) of the outputs for A, B and their mixtures (d + 2, n)."""
    a, b, mixed = np.split(parts - parts[:2].mean(), [1, 2])
    first = (b * (mixed - a)).mean(axis=1)
    total = 0.5 * ((a - mixed) ** 2).mean(axis=1)
    return np.asarray(np.array([first, total]) / parts[:2].var())
