"""The job that is run for every set of parameters, and the function that runs a chunk of sets."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from typing import Any

import numpy as np

from lcpimpact.arrays import Array, Indices
from lcpimpact.errors import InputError, LcpImpactError, Status
from lcpimpact.integrators.base import Integrator
from lcpimpact.problems.base import Problem
from lcpimpact.problems.parameters import changes_at, parameters_of, place
from lcpimpact.quantities import Quantity, quantity
from lcpimpact.reading import read
from lcpimpact.record import Grid
from lcpimpact.registry import nearest
from lcpimpact.simulation import simulate, time_grid
from lcpimpact.sweeps.samples import Plan
from lcpimpact.sweeps.side_by_side import Output, has_trace, output_of, run_side_by_side
from lcpimpact.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Job:
    """The run for every set of parameters; it can be pickled.

    Attributes
    ----------
    problem : Problem           with the values of all parameters that are not swept
    integrator : Integrator     the method with its options
    dt, t_end : float           step and end in s
    lcp_solver : str
    outputs : tuple of str      names of `lcpimpact.quantities`
    certify : bool              whether a set is run side by side only where its certificate cannot reject it
    """

    problem: Problem
    integrator: Integrator
    dt: float
    t_end: float
    lcp_solver: str
    outputs: tuple[str, ...] = ()
    certify: bool = True

    @property
    def grid(self) -> Grid:
        """The instants of the coordinates of a run."""
        return time_grid(self.dt, self.t_end)

    def run(self) -> Trajectory:
        """Run one set; a run that fails says so by its status, and Ctrl-C ends all.

        Raises
        ------
        LcpImpactError
            If the method refuses the problem.
        """
        solver = self.lcp_solver if self.integrator.solves_lcp else "auto"
        with np.errstate(over="ignore", invalid="ignore"):  # of the certificate of a run that diverges
            run = simulate(
                self.problem,
                self.integrator,
                dt=self.dt,
                t_end=self.t_end,
                lcp_solver=solver,
                throw=False,
                progress=False,
            )
        if run.status is Status.INTERRUPTED:
            raise KeyboardInterrupt
        return run

    def quantities(self) -> list[Quantity]:
        """Return the outputs as quantities."""
        return [quantity(name, self.problem) for name in self.outputs]

    def in_lanes(self, alone: Job, grid: Grid, traced: Job, h: Any) -> dict[str, Output]:
        """Return the readers in lanes of the outputs of a job ``alone``; h and the numbers of ``traced`` may be formulas.

        Raises
        ------
        NotTracedError
            If they cannot.
        """
        return {each.name: output_of(each, alone, grid, traced, h) for each in self.quantities()}

    def times(self, dimension: str) -> Array:
        """Return the instants of whole series: the instants of the grid, "t", or of the forces, "t_R"."""
        grid = self.grid
        return grid.times(0, grid.steps) if dimension == "t" else self.integrator.reaction_times(grid)


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
    status, messages = np.zeros(count, dtype=np.int64), dict[int, str]()
    change = changes_of(job, tuple(values))
    done = np.zeros(count, dtype=np.bool_)

    def run_alone(k: int) -> Mapping[str, Any] | None:
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

    for rows, numbers in run_side_by_side(job, values, change, run_alone, threads):
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
    return has_trace(job, steps, sets, changes_of(job, tuple(some)), plan.size)


def _run(job: Job, times: Callable[[str], Array], quantities: Sequence[Quantity]) -> tuple[Status, str, dict[str, Any]]:
    """Run one set, and return its status, message and outputs; ``times`` are the instants of the series of all sets."""
    run = job.run()
    if not run.success:
        return run.status, run.message, {}
    found = {each.name: each.measure(run) for each in quantities}
    for each in quantities:
        # A method that chooses its steps records those.
        if each.series and len(found[each.name]) != len(t := times(each.series)):
            found[each.name] = read(run, each.name, np.minimum(t, run.t[-1]))
    return run.status, "", found


@lru_cache(maxsize=1)
def changes_of(job: Job, names: tuple[str, ...]) -> Callable[[Mapping[str, float]], Job]:
    """Return the function that changes the values of these parameters of a job; that of the last job is kept for its chunks.

    A name is "dt", the address of a number of the problem, or an option of the method.

    Raises
    ------
    InputError
        For a name that is none of them, and for an option that is no number; the function raises it for values that the
        problem or the method refuses.
    """
    parameters = parameters_of(job.problem)
    known = {each.name: getattr(job.integrator, each.name) for each in fields(job.integrator)}  # type: ignore[arg-type]
    options = [name for name in names if name in known and name not in parameters]
    for name in options:
        if isinstance(known[name], (str, bool)):
            method = job.integrator.name
            raise InputError(f"the option {name} of {method} is no number: sweep once for each of its values")
    of_problem = [name for name in names if name not in ("dt", *options)]
    for name in of_problem:
        try:
            place(job.problem, name, parameters)
        except InputError as error:
            if "." in name or "several" in str(error):
                raise
            what = f"parameter of {job.problem.name!r}, or option of {job.integrator.name},"
            more = "; and constants of elements, as 0.m; and q0.NODE, v0.NODE"
            raise InputError(nearest(name, [*parameters, "dt", *known], what) + more) from None
    problem_with = changes_at(job.problem, of_problem)

    def change(values: Mapping[str, float]) -> Job:
        changed: dict[str, Any] = {name: values[name] for name in options}
        for name, value in changed.items():
            if not isinstance(known[name], float) and value.is_integer():
                changed[name] = int(value)
        return replace(
            job,
            problem=problem_with({name: values[name] for name in of_problem}),
            integrator=replace(job.integrator, **changed),  # type: ignore[type-var]
            dt=values.get("dt", job.dt),
        )

    return change
