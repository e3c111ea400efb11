"""Sets of parameters of a chunk: their runs, side by side or one after another, and their results."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from lcpimpact.arrays import Array, Indices
from lcpimpact.errors import LcpImpactError, Status
from lcpimpact.quantities import Quantity
from lcpimpact.reading import read
from lcpimpact.simulation import time_grid
from lcpimpact.sweeps.job import Job, changes_of
from lcpimpact.sweeps.samples import Plan
from lcpimpact.sweeps.side_by_side import Outputs, has_trace, readers_of, run_side_by_side


@dataclass(frozen=True, eq=False)
class Sets:
    """The results of N sets of parameters.

    Attributes
    ----------
    outputs : dict of str to (N,) or (N, nt) array      NaN where the run is not solved
    status : (N,) array of int                          codes of `lcpimpact.Status`
    messages : dict of int to str                       why a set is not solved, by its number in the chunk
    """

    outputs: dict[str, Array]
    status: Indices
    messages: dict[int, str] = field(default_factory=dict)

    @classmethod
    def joined(cls, parts: Sequence[Sets]) -> Sets:
        """Return the results of several chunks as one."""
        first = np.cumsum([0, *(len(part.status) for part in parts)])
        return cls(
            {name: np.concatenate([part.outputs[name] for part in parts]) for name in parts[0].outputs},
            np.concatenate([part.status for part in parts]),
            {
                int(start) + k: text
                for start, part in zip(first, parts, strict=False)
                for k, text in part.messages.items()
            },
        )

    def __getitem__(self, chosen: Indices) -> Sets:
        """Return the results of some of the sets."""
        kept = {int(k): i for i, k in enumerate(chosen)} if self.messages else {}
        messages = {kept[k]: text for k, text in self.messages.items() if k in kept}
        return Sets({name: values[chosen] for name, values in self.outputs.items()}, self.status[chosen], messages)


def run_sets(job: Job, values: Mapping[str, Array], threads: int = 1) -> Sets:
    """Run a chunk of sets of parameters, side by side where the method and the outputs allow it, else one after another.

    Parameters
    ----------
    job : Job
    values : mapping of str to (N,) array
        The values of each swept parameter: their names are those of `changes_of`.
    threads : int
        Number of threads for sets side by side.

    Returns
    -------
    Sets
        A set that the problem or the method refuses has the status NOT_RUN and its message.

    Examples
    --------
    >>> from lcpimpact import load_problem
    >>> from lcpimpact.simulation import make_integrator
    >>> job = Job(load_problem("system-1"), make_integrator("moreau-jean", {}), 1e-2, 3.0, "auto", ("R.max",))
    >>> found = run_sets(job, {"c_o": np.array([250.0, -1.0])})
    >>> found.outputs["R.max"].round(0), found.status, found.messages[1]
    (array([5817.,   nan]), array([ 0, 21]), "KelvinVoigt ... N s/m")
    """
    count = len(next(iter(values.values())))
    quantities = job.quantities()
    shapes = {each.name: len(job.times(each.series)) if each.series else None for each in quantities}
    outputs = {name: np.full((count,) if n is None else (count, n), np.nan) for name, n in shapes.items()}
    status = np.zeros(count, dtype=np.int64)
    messages = dict[int, str]()
    change = changes_of(job, tuple(values))
    done = np.zeros(count, dtype=np.bool_)

    def run_alone(k: int) -> Outputs | None:
        try:
            changed = change({name: float(each[k]) for name, each in values.items()})
            code, message, found = _run(changed, job.times, quantities)
        except Exception as error:  # noqa: BLE001 - one set must not end a sweep of a night
            code, found = Status.NOT_RUN, {}
            message = str(error) if isinstance(error, LcpImpactError) else f"{type(error).__name__}: {error}"
        status[k], done[k] = code, True
        for name, value in found.items():
            outputs[name][k] = value
        if code:
            messages[k] = message
        return None if code else found

    for rows, numbers in run_side_by_side(job, values, change, run_alone, threads, readers_of(job)):
        for name, each in numbers.items():
            outputs[name][rows] = each
        done[rows] = True
    for k in np.flatnonzero(~done):
        run_alone(int(k))
    return Sets(outputs, status, messages)


def runs_side_by_side(job: Job, plan: Plan) -> bool:
    """Return whether sets of a plan can run side by side; their code is compiled if so many are worth it."""
    some = plan.values(np.array([0, plan.size // 2, plan.size - 1]))
    steps = time_grid(float(some.get("dt", [job.dt])[0]), job.t_end).steps
    sets = {name: each for name, each in some.items() if name != "dt"}
    return has_trace(job, steps, sets, changes_of(job, tuple(some)), readers_of(job), plan.size)


def _run(job: Job, times: Callable[[str], Array], quantities: Sequence[Quantity]) -> tuple[Status, str, Outputs]:
    """Run one set, and return its status, message and outputs; ``times`` are the instants of the series of all sets."""
    run = job.run()
    if not run.success:
        return run.status, run.message, {}
    found = {each.name: each.measure(run) for each in quantities}
    for each in quantities:
        # A method that chooses its steps records those.
        if each.series and np.size(found[each.name]) != len(t := times(each.series)):
            found[each.name] = read(run, each.name, np.minimum(t, run.t[-1]))
    return run.status, "", found
