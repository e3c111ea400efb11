"""A sweep as a study: the table, the summary, the picture and the report of its Dataset."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from lcpimpact.errors import FailureError, InputError, Status
from lcpimpact.registry import nearest
from lcpimpact.study.result import Study
from lcpimpact.sweeps.samples import swept_parameters

if TYPE_CHECKING:
    from lcpimpact.sweeps.samples import Dataset


@dataclass(frozen=True, eq=False, repr=False)
class SweepStudy(Study):
    """A sweep with the table, summary, picture and report of every study.

    Attributes
    ----------
    dataset : xarray.Dataset        of `lcpimpact.sweep`, or read from its file

    Raises
    ------
    InputError
        For a Dataset that is not one of a sweep.

    Examples
    --------
    >>> from lcpimpact import SweepStudy, load_problem, sweep
    >>> found = SweepStudy(sweep(load_problem("system-1"), {"k_o": [3000.0, 4000.0, 5000.0]}, dt=1e-2))
    >>> print(found.summary().split(": ")[1])
    3 sets of k_o
      R.max          5101.91 ... 6558.36 N
    >>> list(found.table)
    ['k_o', 'R.max', 'status', 'message']
    """

    dataset: Dataset

    drawn_by = "lcpimpact.plotting.sweeps:plot_sweep_study"
    title = "{0.problem}: a sweep"

    def __post_init__(self) -> None:
        if not {"problem", "method", "parameters", "outputs"} <= getattr(self.dataset, "attrs", {}).keys():
            raise InputError("dataset has no problem, method, parameters and outputs in its attrs: give one of sweep")

    @property
    def problem(self) -> str:
        """The name of the problem."""
        return str(self.dataset.attrs["problem"])

    @property
    def outputs(self) -> list[str]:
        """The names of the outputs."""
        return list(self.dataset.attrs["outputs"].split(", "))

    @property
    def table(self) -> pd.DataFrame:
        """A row for each set: its parameters, the outputs that are numbers, ``status`` and ``message``."""
        numbers = [name for name in self.outputs if self.dataset[name].dims == self.dataset["status"].dims]
        shown = [*numbers, "status", "message"]
        return self.dataset[shown].to_dataframe().reset_index()[[*swept_parameters(self.dataset), *shown]]

    @property
    def failures(self) -> pd.DataFrame:
        """The rows of the table without a result."""
        return self.table[self.table["status"] != Status.SOLVED]

    def summary(self, *, max_reasons: int = 5) -> str:
        """Return the range of each output, and the sets without a result.

        ``max_reasons``: maximum number of reasons listed for sets without a result.

        Raises
        ------
        FailureError
            If no set has a result.
        """
        status = np.asarray(self.dataset["status"])
        messages = np.asarray(self.dataset["message"])
        shape = " x ".join(str(n) for n in status.shape)
        lines = [
            f"{self.problem} by {self.dataset.attrs['method']}: {shape} sets of {self.dataset.attrs['parameters']}"
        ]
        failed = status != Status.SOLVED
        if failed.all():
            raise FailureError(f"no set has a result: {messages.ravel()[0]}", None)
        for name in self.outputs:
            values = np.asarray(self.dataset[name])
            known = values[np.isfinite(values)]
            missing = int(np.isnan(values[~failed]).sum())
            unit = self.dataset[name].attrs.get("units", "")
            text = f"{known.min():.6g} ... {known.max():.6g} {unit}".rstrip() if len(known) else "none"
            lines.append(f"  {name:<14} {text}" + (f"; {missing} runs have none" if missing else ""))
        reasons, counts = np.unique(messages[failed].astype(str), return_counts=True)
        order = np.argsort(-counts, kind="stable")
        lines += [f"  {counts[k]} without a result: {reasons[k]}" for k in order[:max_reasons]]
        if len(order) > max_reasons:
            lines.append(f"  {counts[order[max_reasons:]].sum()} more without a result: see the message of each")
        return "\n".join(lines)

    def output(self, name: str | None) -> str:
        """Return the name of an output, by default the first."""
        if name is not None and name not in self.outputs:
            raise InputError(nearest(name, self.outputs, "output"))
        return self.outputs[0] if name is None else name
