"""Where the results of a sweep go: arrays in memory, or a zarr store that an interrupted sweep resumes from."""

from __future__ import annotations

import hashlib
import json
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from lcpimpact import __version__
from lcpimpact.arrays import Array
from lcpimpact.errors import InputError, Status
from lcpimpact.memory import check_memory
from lcpimpact.problems.base import Problem
from lcpimpact.registry import import_extra
from lcpimpact.run_files import unit_attribute
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.simulation import describe
from lcpimpact.sweeps.job import Job, Sets
from lcpimpact.sweeps.samples import Plan

ENDING = ".zarr"

EXTRA = "sweep"
"""The extra of lcpimpact with the packages of sweeps."""

NOT_YET = -1
"""Status of a set that has not been run yet."""

Block = tuple[slice, ...]
"""A box of the dimensions of a sweep."""


@dataclass(frozen=True, eq=False)
class Variable:
    """A variable of the Dataset of a sweep: dimensions, shape, type, value where nothing is, and attributes."""

    dims: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: Any
    fill: Any
    attributes: Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Store:
    """The arrays of a sweep, written block by block.

    Attributes
    ----------
    arrays : mapping of str to array        of NumPy or zarr, by the name of the variable
    coordinates : mapping                   name to dimension, values and attributes
    path : Path or None                     the folder, or None in memory
    chunk : tuple of int or None            size of a block of the folder along each dimension
    resumed : bool                          whether the folder was there
    """

    arrays: Mapping[str, Any]
    coordinates: Mapping[str, tuple[str, Array, dict[str, str]]]
    variables: Mapping[str, Variable]
    attributes: Mapping[str, Any]
    path: Path | None = None
    chunk: tuple[int, ...] | None = None
    resumed: bool = False

    def is_done(self, block: Block) -> bool:
        """Return whether all sets of a block are stored."""
        return bool((np.asarray(self.arrays["status"][block]) != NOT_YET).all())

    def write(self, block: Block, sets: Sets) -> None:
        """Write the results of a block; its status comes last, since a set with a status is finished."""
        shape = tuple(each.stop - each.start for each in block)
        for name, values in sets.outputs.items():
            self.arrays[name][(*block, *[slice(None)] * (values.ndim - 1))] = values.reshape(*shape, *values.shape[1:])
        if sets.messages:
            messages = np.full(len(sets.status), "", dtype=object)
            messages[list(sets.messages)] = list(sets.messages.values())
            self.arrays["message"][block] = messages.reshape(shape)
        self.arrays["status"][block] = sets.status.reshape(shape)

    def dataset(self) -> Any:
        """Return the results as an xarray Dataset; from a folder they are read when they are used."""
        xarray = import_extra("xarray", EXTRA)
        if self.path is not None:
            found = xarray.open_zarr(self.path)
            return found.assign(message=found["message"].astype(object))  # the same type as in memory
        data = {name: (each.dims, self.arrays[name], each.attributes) for name, each in self.variables.items()}
        return xarray.Dataset(data, coords=dict(self.coordinates), attrs=dict(self.attributes))


def open_store(job: Job, plan: Plan, chunk: tuple[int, ...], path: Path | None) -> Store:
    """Return the store of a sweep: in memory, or in a folder, which is made, or read if it is there.

    Raises
    ------
    InputError
        If the results do not fit in memory, or the folder holds something else.
    """
    variables, coordinates, attributes = _variables(job, plan), _coordinates(job, plan), _attributes(job, plan)
    if path is not None:
        return _in_folder(Store({}, coordinates, variables, attributes, path), chunk)
    size = sum(np.prod(each.shape, dtype=float) * np.dtype(each.dtype).itemsize for each in variables.values())
    check_memory(size, f"the results of {plan.size:,} sets do", "give out='sweep.zarr', which holds them on disk")
    arrays = {name: np.full(each.shape, each.fill, dtype=each.dtype) for name, each in variables.items()}
    return Store(arrays, coordinates, variables, attributes)


def _in_folder(store: Store, chunk: tuple[int, ...]) -> Store:
    """Return a store in its folder."""
    zarr, path = import_extra("zarr", EXTRA), store.path
    assert path is not None
    if path.exists():
        return _reopened(store)
    root = zarr.open_group(path, mode="w", zarr_format=3, attributes=dict(store.attributes))
    every = {name: (each, chunk) for name, each in store.variables.items()} | {
        name: (Variable((dim,), values.shape, values.dtype, 0, units), values.shape)
        for name, (dim, values, units) in store.coordinates.items()
    }
    for name, (each, pieces) in every.items():
        root.create_array(
            name, shape=each.shape, chunks=(*pieces, *each.shape[len(pieces) :]), attributes=dict(each.attributes),
            dtype=str if each.dtype is object else each.dtype, fill_value=each.fill, dimension_names=each.dims,
        )  # fmt: skip
    for name, (_, values, _) in store.coordinates.items():
        root[name][:] = values
    with warnings.catch_warnings():  # of zarr, which says that other programs need not know these metadata
        warnings.simplefilter("ignore")
        zarr.consolidate_metadata(path)
    return _opened(store, root, chunk)


def _reopened(store: Store) -> Store:
    """Return the store in a folder that is there, after a check that it holds this sweep."""
    zarr, path = import_extra("zarr", EXTRA), store.path
    remedy = "name another folder, or remove it"
    try:
        root = zarr.open_group(path, mode="r+")
        same = all(np.array_equal(root[name][:], values) for name, (_, values, _) in store.coordinates.items())
        held, chunk = dict(root.attrs), root["status"].chunks
    except (OSError, KeyError, ValueError) as error:
        raise InputError(f"out = {str(path)!r} is there, and is no sweep ({type(error).__name__}): {remedy}") from None
    different = [key for key, value in store.attributes.items() if held.get(key) != value and key != "lcpimpact"]
    if different or not same:
        what = different[0].replace("_", " ") if different else "values of the parameters"
        raise InputError(f"out = {str(path)!r} holds another sweep, which differs in the {what}: {remedy}")
    return _opened(store, root, tuple(chunk), resumed=True)


def _opened(store: Store, root: Any, chunk: tuple[int, ...], resumed: bool = False) -> Store:
    arrays = {name: root[name] for name in store.variables}
    return replace(store, arrays=arrays, chunk=chunk, resumed=resumed)


def _variables(job: Job, plan: Plan) -> dict[str, Variable]:
    found = {}
    for each in job.quantities():
        attributes = unit_attribute(each.unit)
        series = ((each.series,), (len(job.times(each.series)),)) if each.series else ((), ())
        found[each.name] = Variable((*plan.dims, *series[0]), (*plan.shape, *series[1]), np.float64, np.nan, attributes)
    meanings = {
        "flag_values": [NOT_YET, *map(int, Status)],
        "flag_meanings": " ".join(["NOT_YET", *(each.name for each in Status)]),
    }
    found["status"] = Variable(plan.dims, plan.shape, np.int16, NOT_YET, meanings)
    found["message"] = Variable(plan.dims, plan.shape, object, "", {})
    return found


def _coordinates(job: Job, plan: Plan) -> dict[str, tuple[str, Array, dict[str, str]]]:
    found = {
        name: (plan.dims[0] if plan.listed else name, values, unit_attribute(_unit(name, job.problem)))
        for name, values in plan.axes.items()
    }
    for dimension in {each.series for each in job.quantities() if each.series}:
        found[dimension] = (dimension, job.times(dimension), unit_attribute(job.problem.unit("t")))
    return found


def _unit(parameter: str, problem: Problem) -> str:
    """Return the unit of a parameter where its address says it."""
    group, _, node = parameter.partition(".")
    series = {"dt": "t", "q0": node, "v0": f"v_{node}"}.get(group, "")
    return problem.unit(series) if series else ""


def _attributes(job: Job, plan: Plan) -> dict[str, Any]:
    """Return what a sweep is besides its values: two sweeps with the same are the same."""
    problem = job.problem
    initial = {f"q0.{node}": float(value) for node, value in problem.q0.items()}
    initial |= {f"v0.{node}": float(value) for node, value in problem.v0.items()}
    return {
        "problem": problem.name,
        "problem_parameters": json.dumps({name: float(value) for name, value in problem.parameters.items()}),
        "initial_values": json.dumps(initial),
        "scheme": _digest(problem.scheme),
        "method": describe(job.integrator, job.lcp_solver),
        "dt": job.dt,
        "t_end": job.t_end,
        "outputs": ", ".join(job.outputs),
        "certify": int(job.certify),
        "parameters": ", ".join(plan.axes),
        "rule": plan.rule,
        "count": plan.count,
        "lcpimpact": __version__,
    }


def _digest(scheme: Any) -> str:
    """Return a digest of the elements or matrices of a scheme, the same in every process."""
    parts = scheme.elements if isinstance(scheme, Scheme) else [getattr(scheme, each.name) for each in fields(scheme)]
    with np.printoptions(threshold=2**62, floatmode="unique"):
        text = re.sub(r" at 0x[0-9a-f]+", "", repr(parts))
    return hashlib.sha256(text.encode()).hexdigest()[:16]
