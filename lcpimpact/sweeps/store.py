"""Stores of the results of a sweep: arrays in memory, or a zarr store that an interrupted sweep resumes from."""

from __future__ import annotations

import hashlib
import json
import math
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from lcpimpact import __version__
from lcpimpact.arrays import Array
from lcpimpact.cache import source
from lcpimpact.errors import InputError, Status
from lcpimpact.files import Json, new_folder
from lcpimpact.memory import check_memory
from lcpimpact.problems import PROBLEMS
from lcpimpact.problems.parameters import is_registered, units_of
from lcpimpact.registry import import_extra
from lcpimpact.run_files import unit_attribute
from lcpimpact.simulation import describe
from lcpimpact.sweeps.identity import digest
from lcpimpact.sweeps.job import Job
from lcpimpact.sweeps.samples import Plan
from lcpimpact.sweeps.sets import Sets

if TYPE_CHECKING:
    from lcpimpact.sweeps.samples import Dataset

ENDING = ".zarr"

EXTRA = "sweep"
"""The extra of lcpimpact with the packages of sweeps."""

NOT_YET = -1
"""Status of a set that has not been run yet."""

FORM = 2
"""Number of the form of a store; those of form 1 tell neither the code of functions nor damage."""

SUMS = "blocks/sum"
"""Array beside the variables: for each block a sum of its results, which is written last."""

REMEDY = "name another folder, or remove it"

Block = tuple[slice, ...]
"""A box of the dimensions of a sweep."""


@dataclass(frozen=True, eq=False)
class Variable:
    """A variable of the Dataset of a sweep: dimensions, shape, type, value where nothing is, and attributes."""

    dims: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: DTypeLike
    fill: float | str
    attributes: Mapping[str, Json]


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
    sums : array or None                    a sum of the results of each block of the folder
    """

    arrays: Mapping[str, Any]
    coordinates: Mapping[str, tuple[str, Array, dict[str, str]]]
    variables: Mapping[str, Variable]
    attributes: Mapping[str, Json]
    path: Path | None = None
    chunk: tuple[int, ...] | None = None
    resumed: bool = False
    sums: Any = None

    def is_done(self, block: Block) -> bool:
        """Return whether all sets of a block are stored, as they were written."""
        if self.sums is None:
            return bool((np.asarray(self.arrays["status"][block]) != NOT_YET).all())
        try:
            found = {name: self.arrays[name][block] for name in self.variables}
            return int(self.sums[self._number(block)]) == self._sum(found)
        except Exception:  # noqa: BLE001 - a damaged piece may fail in any of zarr's codecs
            return False

    def write(self, block: Block, sets: Sets) -> None:
        """Write the results of a block; its sum comes last, since a block with its sum is finished.

        Raises
        ------
        InputError
            If the folder cannot be written.
        """
        shape = tuple(each.stop - each.start for each in block)
        messages = np.full(len(sets.status), "", dtype=object)
        messages[list(sets.messages)] = list(sets.messages.values())
        found = {**sets.outputs, "message": messages, "status": sets.status}
        with _writing(self.path):
            if self.sums is not None:
                self._forget(block)
            for name, values in found.items():
                self.arrays[name][(*block, *[slice(None)] * (values.ndim - 1))] = values.reshape(
                    *shape, *values.shape[1:]
                )
            if self.sums is not None:
                self.sums[self._number(block)] = self._sum(found)

    def _number(self, block: Block) -> tuple[int, ...]:
        """Return the number of a block along each dimension."""
        assert self.chunk is not None
        return tuple(each.start // size for each, size in zip(block, self.chunk, strict=True))

    def _sum(self, found: Mapping[str, ArrayLike]) -> int:
        """Return a sum of the results of a block, which is never 0."""
        total = hashlib.sha256()
        for name, each in self.variables.items():
            words = each.dtype is object
            values = np.asarray(found[name])
            total.update(json.dumps(values.ravel().tolist()).encode() if words else values.astype(each.dtype).tobytes())
        return int.from_bytes(total.digest()[:7], "little") + 1

    def _forget(self, block: Block) -> None:
        """Remove the pieces of a block, which may be damaged, so that none is read when it is written."""
        assert self.path is not None
        number = self._number(block)
        for array in (self.sums, *self.arrays.values()):
            key = array.metadata.encode_chunk_key((*number, *[0] * (len(array.shape) - len(number))))
            (self.path / array.path / key).unlink(missing_ok=True)

    def dataset(self) -> Dataset:
        """Return the results as an xarray Dataset; from a folder they are read when they are used."""
        xarray = import_extra("xarray", EXTRA)
        if self.path is not None:
            stored = xarray.open_zarr(self.path)
            found: Dataset = stored.assign(message=stored["message"].astype(object))  # the same type as in memory
            return found
        data = {name: (each.dims, self.arrays[name], each.attributes) for name, each in self.variables.items()}
        made: Dataset = xarray.Dataset(data, coords=dict(self.coordinates), attrs=dict(self.attributes))
        return made


def open_store(job: Job, plan: Plan, chunk: tuple[int, ...], path: Path | None) -> Store:
    """Return the store of a sweep: in memory, or in a folder, which is made, or read if it is there.

    Raises
    ------
    InputError
        If the results do not fit in memory, or the folder holds something else.
    """
    variables = _variables(job, plan)
    coordinates = _coordinates(job, plan)
    attributes = _attributes(job, plan)
    if path is not None:
        return _in_folder(Store({}, coordinates, variables, {**attributes, **_identity(job, plan)}, path), chunk)
    size = sum(np.prod(each.shape, dtype=float) * np.dtype(each.dtype).itemsize for each in variables.values())
    check_memory(size, f"the results of {plan.size:,} sets do", "give out='sweep.zarr', which holds them on disk")
    arrays = {name: np.full(each.shape, each.fill, dtype=each.dtype) for name, each in variables.items()}
    return Store(arrays, coordinates, variables, attributes)


def _in_folder(store: Store, chunk: tuple[int, ...]) -> Store:
    """Return a store in its folder, which appears whole, or is there and holds this sweep."""
    path = store.path
    assert path is not None
    if not path.exists():
        with _writing(path), new_folder(path) as part:
            zarr = import_extra("zarr", EXTRA)
            root = zarr.open_group(part, mode="w", zarr_format=3, attributes={**store.attributes, "chunk": list(chunk)})
            for name in _arrays(store, chunk):
                _make(root, store, chunk, name)
            _consolidate(part)
    return _reopened(store)


def _arrays(store: Store, chunk: tuple[int, ...]) -> dict[str, tuple[Variable, tuple[int, ...], Array | None]]:
    """Return the arrays of a folder by name: the variable, the size of its pieces, and its values if they are known."""
    every: dict[str, tuple[Variable, tuple[int, ...], Array | None]] = {
        name: (each, (*chunk, *each.shape[len(chunk) :]), None) for name, each in store.variables.items()
    }
    for name, (dim, values, units) in store.coordinates.items():
        every[name] = (Variable((dim,), values.shape, values.dtype, 0, units), values.shape, values)
    sets = store.variables["status"].shape
    blocks = tuple(math.ceil(n / size) for n, size in zip(sets, chunk, strict=True))
    every[SUMS] = (Variable((), blocks, np.int64, 0, {}), (1,) * len(blocks), None)
    return every


def _make(root: Any, store: Store, chunk: tuple[int, ...], name: str) -> Any:
    """Make an array of a folder, in place of a damaged one."""
    each, pieces, values = _arrays(store, chunk)[name]
    made = root.create_array(
        name, shape=each.shape, chunks=pieces, attributes=dict(each.attributes), overwrite=True,
        dtype=str if each.dtype is object else each.dtype, fill_value=each.fill, dimension_names=each.dims or None,
    )  # fmt: skip
    if values is not None:
        made[:] = values
    return made


def _consolidate(path: Path) -> None:
    with warnings.catch_warnings():  # of zarr, which says that other programs need not know these metadata
        warnings.simplefilter("ignore")
        import_extra("zarr", EXTRA).consolidate_metadata(path)


def _reopened(store: Store) -> Store:
    """Return the store in a folder that is there, after a check that it holds this sweep.

    What is lost or damaged of it is made again, empty.
    """
    zarr, path = import_extra("zarr", EXTRA), store.path
    assert path is not None
    try:
        root = zarr.open_group(path, mode="r+", use_consolidated=False)
        held = dict(root.attrs)
    except PermissionError as error:
        raise _unwritten(path, error) from None
    except Exception as error:  # noqa: BLE001 - zarr raises what it meets in a file that is not its own
        raise InputError(f"out = {str(path)!r} is there, and is no sweep ({type(error).__name__}): {REMEDY}") from None
    if held.get("form") != FORM:
        what = (
            "is a sweep of an older lcpimpact, which does not tell its functions" if "count" in held else "is no sweep"
        )
        raise InputError(f"out = {str(path)!r} is there, and {what}: {REMEDY}")
    different = [key for key, value in store.attributes.items() if held.get(key) != value and key != "lcpimpact"]
    if different:
        raise InputError(
            f"out = {str(path)!r} holds another sweep, which differs in the {different[0].replace('_', ' ')}: {REMEDY}"
        )
    chunk = tuple(held["chunk"])
    arrays, lost = dict[str, Any](), False
    with _writing(path):
        for name, (each, pieces, values) in _arrays(store, chunk).items():
            try:
                found = root[name]
                whole = found.shape == each.shape and found.chunks == pieces
                whole = whole and (values is None or np.array_equal(found[:], values))
            except Exception:  # noqa: BLE001 - as above
                whole = False
            if not whole:
                found, lost = _make(root, store, chunk, name), True
            arrays[name] = found
        if lost:
            _consolidate(path)
    sums = arrays.pop(SUMS)
    arrays = {name: arrays[name] for name in store.variables}
    return replace(store, arrays=arrays, chunk=chunk, resumed=True, sums=sums)


@contextmanager
def _writing(path: Path | None) -> Iterator[None]:
    """Name the folder in the errors of writing it."""
    try:
        yield
    except OSError as error:
        raise _unwritten(path, error) from None


def _unwritten(path: Path | None, error: OSError) -> InputError:
    return InputError(
        f"cannot write {str(path)!r}: {error.strerror or error}; finished chunks are kept, and the same call resumes once "
        "the folder can be written"
    )


def _variables(job: Job, plan: Plan) -> dict[str, Variable]:
    found = {}
    for each in job.quantities():
        attributes = unit_attribute(each.unit)
        series = ((each.series,), (len(job.times(each.series)),)) if each.series else ((), ())
        found[each.name] = Variable((*plan.dims, *series[0]), (*plan.shape, *series[1]), np.float64, np.nan, attributes)
    meanings: dict[str, Json] = {
        "flag_values": [NOT_YET, *map(int, Status)],
        "flag_meanings": " ".join(["NOT_YET", *(each.name for each in Status)]),
    }
    found["status"] = Variable(plan.dims, plan.shape, np.int16, NOT_YET, meanings)
    found["message"] = Variable(plan.dims, plan.shape, object, "", {})
    return found


def _coordinates(job: Job, plan: Plan) -> dict[str, tuple[str, Array, dict[str, str]]]:
    units = {"dt": job.problem.unit("t")} | units_of(job.problem, plan.axes)
    found = {
        name: (plan.dims[0] if plan.listed else name, values, unit_attribute(units.get(name, "")))
        for name, values in plan.axes.items()
    }
    for dimension in {each.series for each in job.quantities() if each.series}:
        found[dimension] = (dimension, job.times(dimension), unit_attribute(job.problem.unit("t")))
    return found


def _attributes(job: Job, plan: Plan) -> dict[str, Json]:
    """Return the attributes of the stored results: the problem, the settings of its runs and the plan of the sweep."""
    problem = job.problem
    initial = {f"q0.{node}": float(value) for node, value in problem.q0.items()}
    initial |= {f"v0.{node}": float(value) for node, value in problem.v0.items()}
    return {
        "problem": problem.name,
        "problem_parameters": json.dumps({name: float(value) for name, value in problem.parameters.items()}),
        "initial_values": json.dumps(initial),
        "units": json.dumps(dict(problem.units)),
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


def _identity(job: Job, plan: Plan) -> dict[str, Json]:
    """Return digests of the parts of a sweep that its attributes do not hold: values, functions and code.

    Raises
    ------
    InputError
        Naming what cannot be told from another.
    """
    problem = job.problem
    built = PROBLEMS[problem.name] if is_registered(problem) else None
    return {
        "form": FORM,
        "values_of_the_parameters": digest(dict(plan.axes), "parameters"),
        "scheme": digest([problem.scheme, built], f"the scheme of problem {problem.name!r}"),
        "code_of_the_method": digest(job.integrator, f"the method {job.integrator.name!r}"),
        "source_of_lcpimpact": source(),
    }
