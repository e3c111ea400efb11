r"""Standard deviations of outputs from those of uncertain parameters, to first order.

With the derivatives G = ∂y/∂p of the outputs (`lcpimpact.study.sensitivity`) and the covariance of the parameters,

.. math:: \operatorname{cov} y = G\, \operatorname{cov} p\, G^T, \qquad σ_y = \sqrt{(\operatorname{cov} y)_{yy}} .

It holds for deviations within which the outputs are near their tangents, and the events keep their order. A sweep of normal
samples of the same parameters shows whether they do.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.errors import InputError, Status
from lcpimpact.numbers import count as check_count
from lcpimpact.numbers import finite, random_numbers
from lcpimpact.registry import nearest
from lcpimpact.study.result import Study, table_lines
from lcpimpact.sweeps.samples import Samples, swept_parameters

if TYPE_CHECKING:
    from lcpimpact.sweeps.samples import Dataset


@dataclass(frozen=True, eq=False, repr=False)
class Uncertainty(Study):
    """How sure outputs of a run are, if its parameters are uncertain, to first order.

    Attributes
    ----------
    problem : str               name of the problem
    method : str
    values : dict               the values of the parameters, by address
    table : DataFrame           one row per output: ``output``, ``unit``, ``value``, its standard ``deviation``, and its
                                change for one standard deviation of each parameter
    covariance : DataFrame      of the outputs
    parameters : DataFrame      the covariance of the parameters
    """

    problem: str
    method: str
    values: dict[str, float]
    table: pd.DataFrame
    covariance: pd.DataFrame
    parameters: pd.DataFrame

    drawn_by = "lcpimpact.plotting.sensitivity:plot_uncertainty"
    title = "Uncertainty of {0.problem}"

    @property
    def deviations(self) -> dict[str, float]:
        """The standard deviations of the parameters."""
        return dict(zip(self.values, np.sqrt(np.diag(self.parameters)).tolist(), strict=True))

    def summary(self) -> str:
        """Return the outputs with their standard deviations."""
        of = ", ".join(f"{name} = {self.values[name]:g} ± {size:.3g}" for name, size in self.deviations.items())
        return "\n".join(
            [f"Uncertainty of {self.problem} by {self.method}, to first order: {of}", *table_lines(self.table, ".6g")]
        )

    @checked
    def samples(self, count: int, *, seed: int = 0) -> Samples:
        """Return normal samples of the parameters with their covariance, for `lcpimpact.sweep`.

        Parameters
        ----------
        count : int
            Number of samples.
        seed : int

        Examples
        --------
        >>> from lcpimpact import load_problem, sensitivity
        >>> found = sensitivity(load_problem("bouncing-ball"), ["H", "g"], ["impact:1"], t_end=0.6)
        >>> found.uncertainty({"H": 0.02}).samples(3).table.round(4)
                H     g
        0  1.0025  9.81
        1  1.0128  9.81
        2  0.9893  9.81
        """
        check_count("count", count)
        # The symmetric square root of the covariance is unique, whatever signs its eigenvectors have.
        values, vectors = np.linalg.eigh(self.parameters.to_numpy())
        normal = random_numbers(seed).standard_normal((count, len(values)))
        changes = normal @ (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
        return Samples({name: p + change for (name, p), change in zip(self.values.items(), changes.T, strict=True)})

    def compared(self, dataset: Dataset) -> pd.DataFrame:
        """Return these standard deviations beside those of a sweep of `samples`.

        Parameters
        ----------
        dataset : xarray.Dataset
            Of `lcpimpact.sweep` with samples of the same parameters, and the same outputs.

        Returns
        -------
        DataFrame
            One row per output: ``output``, ``unit``, ``deviation`` to first order, ``sampled``, that of the sweep,
            ``standard_error`` of ``sampled``, ``value`` and ``mean`` of the sweep, and ``results``, the number of runs that
            have the output.

        Raises
        ------
        InputError
            For a Dataset of no sweep, or one that lacks an output or has fewer than two results.

        Examples
        --------
        >>> from lcpimpact import load_problem, sensitivity, sweep
        >>> ball = load_problem("bouncing-ball")
        >>> found = sensitivity(ball, ["H"], ["impact:1"], t_end=0.6).uncertainty({"H": 0.02})
        >>> runs = sweep(ball, found.samples(400), "exact", dt=0.1, t_end=0.6, outputs=["impact:1"])
        >>> found.compared(runs)[["deviation", "sampled"]].round(4)
           deviation  sampled
        0     0.0045   0.0045
        """
        swept_parameters(dataset)
        solved = np.asarray(dataset["status"]) == Status.SOLVED
        rows = []
        for name, unit, value, deviation in self.table[["output", "unit", "value", "deviation"]].itertuples(
            index=False
        ):
            if name not in dataset:
                raise InputError(
                    f"dataset: {nearest(name, list(map(str, dataset.data_vars)), 'output')}; sweep with outputs=[{name!r}]"
                )
            found = np.asarray(dataset[name])[solved]
            found = found[np.isfinite(found)]
            if len(found) < 2:
                raise InputError(f"dataset has {len(found)} results of {name}: take more samples")
            sampled = float(np.std(found, ddof=1))
            # Of a normal variable s has the standard error σ/sqrt(2 (n - 1)).
            rows.append(
                (
                    name,
                    unit,
                    deviation,
                    sampled,
                    sampled / math.sqrt(2.0 * len(found) - 2.0),
                    value,
                    found.mean(),
                    len(found),
                )
            )
        columns = ["output", "unit", "deviation", "sampled", "standard_error", "value", "mean", "results"]
        return pd.DataFrame(rows, columns=columns)


def uncertainty_of(
    problem: str,
    method: str,
    values: dict[str, float],
    table: pd.DataFrame,
    deviations: Mapping[str, float] | pd.DataFrame,
) -> Uncertainty:
    """Return the uncertainty of outputs with a table of derivatives, as of `lcpimpact.Sensitivity`.

    Parameters
    ----------
    problem, method : str
    values : dict of str to float
        The parameters of the derivatives.
    table : DataFrame
        As of `lcpimpact.Sensitivity`.
    deviations : mapping or DataFrame
        Standard deviations by parameter, or a covariance.
    """
    names = list(values)
    parameters = _covariance(names, deviations)
    G = table[names].to_numpy()
    covariance = G @ parameters @ G.T
    outputs = list(table["output"])
    found = table[["output", "unit", "value"]].assign(deviation=np.sqrt(np.diag(covariance)))
    found[names] = G * np.sqrt(np.diag(parameters))
    return Uncertainty(
        problem, method, dict(values), found, pd.DataFrame(covariance, index=outputs, columns=outputs),
        pd.DataFrame(parameters, index=names, columns=names),
    )  # fmt: skip


def _covariance(
    names: list[str], deviations: Mapping[str, float] | pd.DataFrame, *, symmetry_rtol: float = 1e-9
) -> Array:
    """Return the covariance of all parameters (np, np), checked; those that are not named are known.

    ``symmetry_rtol``: asymmetry and negative eigenvalues, relative to the deviations, that count as rounding.
    """
    for name in [*deviations, *(deviations.index if isinstance(deviations, pd.DataFrame) else ())]:
        if name not in names:
            raise InputError(f"uncertainty: {nearest(str(name), names, 'parameter of the derivatives')}")
    found = np.zeros((len(names), len(names)))
    if not isinstance(deviations, pd.DataFrame):
        if not deviations:
            raise InputError("uncertainty: no parameter is uncertain: name one, as {'k_o': 10.0}")
        for name, value in deviations.items():
            finite(f"uncertainty: the standard deviation of {name}", value, least=0.0)
            found[names.index(name), names.index(name)] = value**2
        return found
    if set(deviations.columns) != set(deviations.index) or len(deviations) != len(set(deviations.index)):
        raise InputError("uncertainty: a covariance needs the same names as index and columns, each once")
    places = [names.index(name) for name in deviations.columns]
    given = deviations.loc[list(deviations.columns)].to_numpy(dtype=np.float64)
    sizes = np.sqrt(np.maximum(np.diag(given), 0.0))
    scaled = given / np.where(np.outer(sizes, sizes) > 0.0, np.outer(sizes, sizes), 1.0)
    if (
        not np.isfinite(given).all()
        or np.abs(scaled - scaled.T).max() > symmetry_rtol
        or np.linalg.eigvalsh(scaled).min() < -symmetry_rtol
    ):
        raise InputError(
            "uncertainty: a covariance must be finite, symmetric and without negative eigenvalues: fix parameters that the "
            "data say nothing of"
        )
    found[np.ix_(places, places)] = 0.5 * (given + given.T)
    return found
