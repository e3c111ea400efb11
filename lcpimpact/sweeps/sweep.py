"""`sweep`: one problem run for many sets of parameters."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from lcpimpact.arguments import checked
from lcpimpact.errors import InputError
from lcpimpact.files import check_name
from lcpimpact.integrators.base import Integrator, Option
from lcpimpact.logs import progress_bar
from lcpimpact.numbers import count
from lcpimpact.problems.base import Problem
from lcpimpact.registry import import_extra
from lcpimpact.simulation import RUN_ARGUMENTS, check_handled, check_lcp_solver, make_integrator, time_grid
from lcpimpact.sweeps.chunks import blocks_of, chunk_shape, run_blocks, sets_per_chunk, try_sets
from lcpimpact.sweeps.job import Job, changes_of
from lcpimpact.sweeps.samples import SAMPLE, Plan, Samples
from lcpimpact.sweeps.store import ENDING, EXTRA, open_store

TAKEN = ("status", "message", "t", "t_R", SAMPLE)
"""Names of variables and dimensions that a sweep gives itself."""

ARGUMENTS = (*RUN_ARGUMENTS, "outputs", "executor", "out", "chunk", "certify")


@checked
def sweep(
    problem: Problem,
    parameters: Mapping[str, Any] | Samples | pd.DataFrame,
    method: str | Integrator = "moreau-jean",
    *,
    dt: float,
    t_end: float | None = None,
    outputs: Sequence[str] = ("R.max",),
    executor: Executor | None = None,
    out: str | Path | None = None,
    progress: bool = True,
    lcp_solver: str = "auto",
    chunk: int | None = None,
    certify: bool = True,
    **method_options: Option,
) -> Any:
    """Run a problem for many sets of parameters, and return the outputs of each.

    Parameters
    ----------
    problem : Problem
    parameters : mapping, Samples or DataFrame
        A mapping of names to values is a grid, with one dimension a parameter. `Samples`, as of `draw_samples`, and a
        DataFrame are a list of sets, with the one dimension "sample". Names are parameters of a registered problem
        (``k_o``), constants of elements (``2.k``, ``KelvinVoigt.k``), initial values (``q0.x``, ``v0.x``), ``dt``, and
        options of the method (``theta``).
    method, dt, t_end, lcp_solver, **method_options
        As of `simulate`, for all sets that do not change them; t_end is that of ``problem`` if it is not given.
    outputs : sequence of str
        Names of `lcpimpact.quantities`: ``R.max``, ``x@2.0``, ``open:1``, ``impact:2.speed``, ``restitution``, or ``x``, the
        whole series.
    executor : Executor, optional
        Runs the chunks: any of concurrent.futures, or ``Client.get_executor()`` of dask.distributed; by default this
        process does.
    out : path, optional
        A folder ending in .zarr, to which chunks are written as they finish. The same call with the same folder resumes.
    progress : bool
        Show progress when the sweep takes more than a second (not on a terminal: ten).
    chunk : int, optional
        Number of sets in a chunk; by default as many as take a moderate time.
    certify : bool
        Whether the certificate of each set must hold. With False all methods of linear steps run sets side by side
        (see docs/guide/sweeps.md): their LCPs are checked in each step, but whether dt is fine enough is judged for a few
        sets only.

    Returns
    -------
    xarray.Dataset
        One variable an output, named as asked; ``status``, the code of `Status` of each set; and ``message``, why a set is
        not solved: its outputs are NaN. A quantity that a run does not have is NaN with the status SOLVED. With ``out``
        values are read from the folder when they are used.

    Raises
    ------
    InputError
        For an unknown parameter or output, no values or a value that is not finite, and a folder that holds another sweep;
        before anything runs.
    UnsupportedError
        If the method does not handle the problem, or the extra ``sweep`` is not installed.

    Examples
    --------
    >>> from lcpimpact import load_problem, sweep
    >>> found = sweep(load_problem("system-1"), {"k_o": [3000.0, 4000.0], "c_o": [200.0, 250.0, 300.0]}, dt=1e-2)
    >>> found["R.max"].dims, found["R.max"].sel(k_o=4000.0, c_o=250.0).round(0).item(), int(found["status"].max())
    (('k_o', 'c_o'), 5871.0, 0)
    """
    integrator = make_integrator(method, method_options, ARGUMENTS)
    check_lcp_solver(integrator, lcp_solver)
    end = float(problem.t_end if t_end is None else t_end)
    job = Job(problem, integrator, float(dt), end, lcp_solver, tuple(outputs), certify)
    plan = Plan.of(parameters)
    path = None if out is None else Path(out)
    threads = 1 if executor else os.cpu_count() or 1
    _check(job, plan, path)
    if chunk is not None:
        count("chunk", chunk)
    known = None
    if path is not None and path.exists():
        sizes: tuple[int, ...] = plan.shape
    else:
        if chunk is None:
            seconds, known = try_sets(job, plan, threads)
            chunk = sets_per_chunk(job, plan, seconds)
        sizes = chunk_shape(plan.shape, int(chunk))
    store = open_store(job, plan, sizes, path)
    blocks = list(blocks_of(plan.shape, store.chunk or sizes))
    if store.resumed:
        blocks = [block for block in blocks if not store.is_done(block)]
    done = plan.size - sum(math.prod(each.stop - each.start for each in block) for block in blocks)
    with progress_bar(
        progress, total=plan.size, initial=done, desc="sweep", unit="set", unit_scale=True, leave=False
    ) as bar:
        for block, sets in run_blocks(job, plan, blocks, executor, known, threads):
            store.write(block, sets)
            bar.update(len(sets.status))
    return store.dataset()


def _check(job: Job, plan: Plan, path: Path | None) -> None:
    """Refuse a call that means nothing, before anything runs."""
    import_extra("xarray", EXTRA)
    if path is not None:
        if path.suffix != ENDING:
            raise InputError(f"out = {str(path)!r} must end in {ENDING}; write other files from the Dataset")
        check_name(path)
        if not path.parent.is_dir():
            raise InputError(f"out = {str(path)!r}: there is no folder {str(path.parent)!r}; make it, or name another")
        import_extra("zarr", EXTRA)
    check_handled(job.integrator, job.problem)
    changes_of(job, tuple(plan.axes))
    steps = plan.axes.get("dt", np.array([job.dt]))
    for dt in np.unique(steps):
        time_grid(float(dt), job.t_end)
    if not job.outputs:
        raise InputError("outputs names nothing: give one, as ['R.max']")
    quantities = job.quantities()
    for each in quantities:
        if each.until > job.t_end:
            raise InputError(f"{each.name}: the runs end at t_end = {job.t_end:g} s")
        if each.series and "dt" in plan.axes:
            raise InputError(
                f"{each.name}: whole series need one dt for all sets; take x.max or x@1.0, or sweep with one dt"
            )
    names = [*job.outputs, *plan.axes]
    for name in names:
        if name in TAKEN or names.count(name) > 1:
            raise InputError(
                f"{name!r} is named twice, or is a name that a sweep uses itself: rename it, or give it once"
            )
