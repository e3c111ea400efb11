"""Runs that are read back from the files that they wrote, .npz and .nc."""

from __future__ import annotations

import json
import math
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.certificate import Certificate
from lcpimpact.certificate.impact_gain import ImpactGain
from lcpimpact.errors import InputError, Status
from lcpimpact.files import Json, reading
from lcpimpact.problems.base import Problem
from lcpimpact.record import Event, State, Stats
from lcpimpact.registry import import_extra
from lcpimpact.run_error import RunError
from lcpimpact.run_files import EVENT_COLUMNS, EXTRAS, SIDES
from lcpimpact.scheme.sparse_dynamics import SparseDynamics
from lcpimpact.scheme.system import LinearComplementaritySystem
from lcpimpact.schemefile import problem_of_text
from lcpimpact.simulation import make_integrator
from lcpimpact.trajectory import ARRAYS, Trajectory

ENDINGS = (".npz", ".nc")
"""Endings of the files that can be read back."""

PLAIN = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}
"""Numbers that JSON has no word for, by their texts."""


@checked
def read_run(path: str | Path, problem: Problem | None = None) -> Trajectory:
    """Read a run from a file that `Trajectory.save` wrote, with its scheme, certificate and error.

    Parameters
    ----------
    path : str or Path
        A file ending in .npz or .nc.
    problem : Problem, optional
        The problem of the run, where its scheme has what a scheme file cannot hold, as a Python function. Without it such a
        run has its series, events, certificate, error and summary, and neither units nor another error.

    Returns
    -------
    Trajectory
        The run, with the numbers of the file to the last bit. A continuous solution is not in it: of a run that had one,
        values between the instants of the grid are interpolated, and the certificate is that which was written.

    Raises
    ------
    InputError
        For a file that is no such run, and for another ending: a table, as .csv, .parquet and .mat, does not say what is
        what. Files are never executed.
    UnsupportedError
        Without the extra ``sweep`` for .nc.

    Examples
    --------
    >>> from tempfile import mkdtemp
    >>> from lcpimpact import load_problem, simulate
    >>> run = simulate(load_problem("bouncing-ball"), dt=1e-2, t_end=1.0)
    >>> again = read_run(run.save(Path(mkdtemp(), "ball.npz")))
    >>> bool((again["x"] == run["x"]).all()), again.problem.parameters == run.problem.parameters, again.certificate.holds
    (True, True, True)
    """
    path = Path(path)
    if path.suffix not in ENDINGS:
        known = path.suffix in (".csv", ".parquet", ".mat")
        why = "a table for other programs, which does not come back" if known else "no file of a run"
        raise InputError(f"cannot read {str(path)!r}: it is {why}; save the run as .npz or .nc and read that")
    with reading(path, "take a shorter run"):
        if not path.is_file():
            raise InputError("there is no such file; check the name")
        try:
            found = _npz(path) if path.suffix == ".npz" else _netcdf(path)
            return _run(found, problem)
        except InputError:
            raise
        except (KeyError, ValueError, TypeError, AttributeError, IndexError, EOFError, zipfile.BadZipFile) as error:
            what = f"{type(error).__name__}: {error}"
            raise InputError(
                f"it does not hold a run as this version writes it ({what}); run and save it again"
            ) from None


def _npz(path: Path) -> dict[str, Any]:
    """Return the contents of an .npz file by name."""
    with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
        found = {name: file[name] for name in file.files}
    return {name: value.item() if value.ndim == 0 else value for name, value in found.items()}


def _netcdf(path: Path) -> dict[str, Any]:
    """Return the contents of a .nc file by the names of an .npz file."""
    xarray = import_extra(*EXTRAS[".nc"])
    with xarray.open_dataset(path, engine="scipy", decode_times=False, mask_and_scale=False) as file:
        data = file.load()
    spelled = {name: each.attrs["long_name"] for name, each in data.variables.items() if "long_name" in each.attrs}
    data = data.rename(spelled)
    nodes = [str(each) for each in data["event_node"].values]
    forces = [str(each) for each in data["event_row"].values] if "event_row" in data else []
    t, t_reaction = data["t"].values, data["t_R"].values
    found = dict(data.attrs)

    def table(names: list[str], length: int) -> Array:
        return np.array([data[name].values for name in names]).reshape(len(names), length).T

    found |= {"t": t, "t_reaction": t_reaction, "q": table(nodes, len(t))}
    found |= {
        "v": table([f"v_{node}" for node in nodes], len(t)),
        "names": [*nodes, *(f"v_{n}" for n in nodes), *forces],
    }
    found["reaction"] = table(forces, len(t_reaction))
    found["push"] = np.zeros((len(t_reaction), 0))
    for name in EVENT_COLUMNS:
        found[f"event_{name}"] = data[f"event_{name}"].values
    for i, side in enumerate(SIDES):
        for name in ("q", "v", "reaction"):
            limits = data[f"event_{name}"].values if f"event_{name}" in data else np.zeros((len(data["event_t"]), 2, 0))
            found[f"event_{name}_{side}"] = limits[:, i]
    return found


def _run(found: Mapping[str, Any], given: Problem | None) -> Trajectory:
    """Return the run of the contents of a file."""
    arrays = {name: np.array(found[name], dtype=np.float64, order="C") for name in ARRAYS}
    arrays["reaction"] = np.hstack([arrays["reaction"], np.array(found["push"], dtype=np.float64)])
    names = [str(name) for name in found["names"]]
    n = arrays["q"].shape[1]
    settings = _json(found["settings"])
    lacks = "continuous solution" if json.loads(str(found["continuous"])) else ""
    text = str(found["scheme"])
    problem = problem_of_text(text).problem if given is None and text else given
    if problem is None:
        lacks = "scheme"
        problem = _without_scheme(str(found["problem"]), names[:n], names[2 * n :])
    kind: Callable[..., Trajectory] = Trajectory
    recorded = [*names[:n], *names[2 * n :]]
    if problem.sparse:
        from lcpimpact.sparse_run import SparseTrajectory  # here, since other runs need none of its compiled code

        kind = partial(SparseTrajectory, recorded=tuple(names[:n]), reactions=tuple(names[2 * n :]))
        known = {*problem.dynamics.nodes, *cast(SparseDynamics, problem.dynamics).reactions}
        wanted = [name for name in recorded if name in known]
        rows = len(names) - 2 * n
    else:
        wanted = [*problem.dynamics.nodes, *(each.name for each in problem.dynamics.forces)]
        rows = len(problem.dynamics.contacts)  # the forces of springs follow from q and v
    if wanted != recorded:
        raise InputError(f"the series of its run are {', '.join(names)}, and those of {problem.name!r} others")
    arrays["reaction"] = np.ascontiguousarray(arrays["reaction"][:, :rows])
    run = kind(
        problem=problem,
        method=str(found["method"]),
        **arrays,
        events=_events(found, rows),
        status=Status[str(found["status"])],
        message=str(found["message"]),
        certificate=_certificate(_json(found["certificate"])),
        stats=Stats(**_json(found["stats"])),
        integrator=make_integrator(settings["method"], settings["options"]) if settings else None,
        lcp_solver=settings.get("solver", "auto"),
        estimates=bool(_json(found["estimates"])),
        lacks=lacks,
        quantities=_json(found["summary"]) or None,
    )
    if (error := _json(found["error"])) is not None:
        run.__dict__["error"] = RunError.of_dict(error)
    return run


def _without_scheme(name: str, nodes: list[str], forces: list[str]) -> Problem:
    """Return a problem with the names of the series of a run, and without laws."""
    n, m = len(nodes), len(forces)
    zero = np.zeros((n, n)), np.zeros((n, m)), np.zeros((m, n)), np.eye(m)
    return Problem(name, LinearComplementaritySystem(*zero, states=nodes, multipliers=forces))


def _events(found: Mapping[str, Any], rows: int) -> tuple[Event, ...]:
    """Return the events, with the reactions of so many rows."""
    columns = {name: np.asarray(found[f"event_{name}"]).tolist() for name in EVENT_COLUMNS}
    # Older files call Newton's law of several contacts so.
    columns["law"] = ["newton" if each == "simultaneous" else each for each in columns["law"]]
    columns["solutions"] = [_count(each) for each in columns["solutions"]]
    columns["velocities"] = [tuple(map(np.array, json.loads(each or "[]"))) for each in columns["velocities"]]
    sides = []
    for side in SIDES:
        q = np.asarray(found[f"event_q_{side}"], dtype=np.float64)
        v = np.asarray(found[f"event_v_{side}"], dtype=np.float64)
        r = np.asarray(found[f"event_reaction_{side}"], dtype=np.float64)
        sides.append([State(*each) for each in zip(q, v, r[:, :rows], strict=True)])
    return tuple(
        Event(left=left, right=right, **{name: values[k] for name, values in columns.items()})
        for k, (left, right) in enumerate(zip(*sides, strict=True))
    )


def _count(value: float) -> float | None:
    """Return a number of solutions: None where it was not examined, which a file holds as NaN."""
    return None if math.isnan(value) else math.inf if math.isinf(value) else int(value)


def _certificate(found: Mapping[str, Any]) -> Certificate:
    known = {each.name for each in fields(Certificate)}
    values = {name: value for name, value in found.items() if name in known}
    values["impact_gain"] = ImpactGain(**found["impact_gain"])
    return Certificate(**values)


def _json(text: str) -> Any:
    """Return a value of JSON text, in which "nan", "inf" and "-inf" are numbers."""

    def numbers(value: Json) -> Json:
        if isinstance(value, dict):
            return {name: numbers(each) for name, each in value.items()}
        if isinstance(value, list):
            return [numbers(each) for each in value]
        return PLAIN.get(value, value) if isinstance(value, str) else value

    return numbers(json.loads(str(text)))
