"""The job that is run for every set of parameters, and what changes from set to set."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import InputError, Status
from lcpimpact.integrators.base import Integrator
from lcpimpact.problems.base import Problem
from lcpimpact.problems.parameters import changes_at, check_address, parameters_of
from lcpimpact.quantities import Quantity, quantity
from lcpimpact.record import Grid
from lcpimpact.simulation import simulate, time_grid
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

    def times(self, dimension: str) -> Array:
        """Return the instants of whole series: the instants of the grid, "t", or of the forces, "t_R"."""
        grid = self.grid
        return grid.times(0, grid.steps) if dimension == "t" else self.integrator.reaction_times(grid)


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
    what = f"parameter of {job.problem.name!r}, or option of {job.integrator.name},"
    for name in of_problem:
        check_address(job.problem, name, [*parameters, "dt", *known], what)
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
