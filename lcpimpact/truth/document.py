r"""Truths as data: a problem with its facts as plain JSON, which any program reads without this package.

A scheme is written by its equations of motion, and a complementarity system by its own,

.. math:: M \ddot q + C \dot q + K q = f(t) + H^T r + \sum_k d_k^T s_k, \qquad u = H q + u_0 \quad\text{or}\quad
          \dot x = A x + B λ + a(t), \qquad y = C x + D λ + c(t),

with a law for each row of H or of y. Matrices are full, numbers have the digits that read back the same double, and a fact
is a decimal text with no more digits than are known. ``schema.json`` says what each entry means.
"""

from __future__ import annotations

import csv
import inspect
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from functools import cache, partial
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar, cast

import numpy as np

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.bibliography import cited, entries, keys
from lcpimpact.errors import InputError
from lcpimpact.files import Json, check_outputs, make_folder, whole_files
from lcpimpact.problems import PROBLEMS, load_problem
from lcpimpact.problems.base import Problem, defaults
from lcpimpact.problems.facts import Fact
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.lagrangian import Lagrangian
from lcpimpact.scheme.signals import SIGNALS, SignalSum, TimeFunction
from lcpimpact.scheme.structure import Contact
from lcpimpact.scheme.system import LinearComplementaritySystem
from lcpimpact.scheme.terms import PowerLaw
from lcpimpact.stated import stated

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

SCHEMA = "schema.json"
"""File name of the JSON schema, in this package and beside the files that are written."""

LICENCE = "BSD-3-Clause"

READINGS = {
    "at": "{series} at t = {t:.6g}{second}",
    "final": "{series} at the end of the run{unit}",
    "peak": "{extreme} value of {series}{until}",
    "crossing": "instant at which {series} crosses {level:g} {way}, number {number}",
    "instant": "instant of {which} of kind {kind}{at}",
    "interval": "time from event {first} to event {last} of kind {kind}",
    "limit": "{node} {when} {which} of kind {kind}{at}{unit}",
}
"""Function of `lcpimpact.reading` to what it measures, in words."""

T = TypeVar("T")


@checked
def truths(names: Sequence[str] = (), **parameters: float) -> dict[str, dict[str, Json]]:
    """Return problems with closed forms as plain data, by name.

    Parameters
    ----------
    names : sequence of str
        Registered problems; by default all that have facts.
    **parameters : float
        New values of parameters, of one problem alone.

    Returns
    -------
    dict
        For each problem its coordinates, matrices, laws, forces, initial state and facts, as its JSON file has them; the
        file ``schema.json`` beside the files says what each entry means.

    Raises
    ------
    InputError
        For an unknown name or parameter, parameters of several problems, a problem without facts, or a Lagrangian system.

    Examples
    --------
    >>> from lcpimpact import truths
    >>> ball = truths(["bouncing-ball"])["bouncing-ball"]
    >>> ball["M"], ball["rows"][0]["restitution"], ball["facts"][0]["value"]
    ([[1.0]], 0.8, '0.451523640985730904450811124338')
    """
    if parameters and len(names) != 1:
        raise InputError(f"the parameters {', '.join(parameters)} are those of one problem: name it alone")
    found = {name: load_problem(name, **parameters) for name in names or PROBLEMS}
    for name in names:
        if isinstance(found[name].scheme, Lagrangian):
            raise InputError(f"{name} is a Lagrangian system, given by functions, which a file of matrices cannot hold")
        if not found[name].facts:
            raise InputError(f"{name} has no facts with these parameters: take others")
    return {
        name: document(problem)
        for name, problem in found.items()
        if not isinstance(problem.scheme, Lagrangian) and problem.facts
    }


@checked
def write_truths(out: str | Path, names: Sequence[str] = (), **parameters: float) -> list[Path]:
    """Write problems with closed forms to a folder: NAME.json for each, and the schema of these files.

    All files are written, or none. The same registry gives the same bytes.

    Parameters
    ----------
    out : str or Path
        The folder; it is made if it does not exist.
    names : sequence of str
        Registered problems; by default all that have facts.
    **parameters : float
        New values of parameters, of one problem alone.

    Returns
    -------
    list of Path
        The files, the schema last.

    Raises
    ------
    InputError
        As `truths` does, or if a file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from lcpimpact import write_truths
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [each.name for each in write_truths(folder, ["bouncing-ball"])]
    ['bouncing-ball.json', 'schema.json']
    """
    texts = {f"{name}.json": f"{_text(found)}\n" for name, found in truths(names, **parameters).items()}
    texts[SCHEMA] = resources.files("lcpimpact.truth").joinpath(SCHEMA).read_text(encoding="utf-8")
    folder = Path(out)
    make_folder(folder)
    paths = [folder / name for name in texts]
    check_outputs((path, (".json",)) for path in paths)
    with whole_files(*paths) as parts:
        for part, text in zip(parts, texts.values(), strict=True):
            part.write_text(text, encoding="utf-8")
    return paths


def document(problem: Problem) -> dict[str, Json]:
    """Return a registered problem with its facts as plain data.

    Raises
    ------
    InputError
        If a force of it is a function that does not say its formula.
    """
    builder = PROBLEMS[problem.name]
    known = stated(builder)
    about, _, rest = (inspect.getdoc(builder) or "").partition("\nParameters\n")
    references = rest.partition("\nReferences\n")[2].partition("\n")[2]
    return {
        "$schema": SCHEMA,
        "name": problem.name,
        "title": about.split("\n")[0],
        "about": about.split("\n", 1)[-1].strip(),
        "source": cited(problem.source),
        "bibtex": [entries()[key] for key in keys(problem.source)],
        "references": " ".join(references.split()),
        "licence": LICENCE,
        "unit_of_time": problem.unit("t"),
        "parameters": {
            name: {"value": value, "unit": known[name].unit, "meaning": known[name].meaning}
            for name, value in problem.parameters.items()
        },
        **_equations(problem),
        "t_end": problem.t_end,
        "facts": [_fact(problem, each) for each in problem.facts],
        "motion": _motion(problem),
    }


def _equations(problem: Problem) -> dict[str, Json]:
    """Return the coordinates, the matrices, the rows with their laws, the forces and the initial state."""
    d = problem.dynamics
    places: dict[str, Json] = {
        "coordinates": [
            {"name": node, "unit": problem.unit(node), "kind": _kind(d, i), **_given_motion(d, i)}
            for i, node in enumerate(d.nodes)
        ]
    }
    start: dict[str, Json] = {
        "initial": {"q": problem.initial_coordinates.tolist(), "v": problem.initial_velocities.tolist()}
    }
    if isinstance(problem.scheme, LinearComplementaritySystem):
        system = problem.scheme
        n, m = np.shape(system.B)
        matrices = {name: np.asarray(getattr(system, name)).tolist() for name in "ABCD"}
        inputs = {"a": system.a or n * [0.0], "c": system.c or m * [0.0]}
        places["coordinates"] = cast(list[Json], places["coordinates"])[:n]
        start["initial"] = {"q": problem.initial_coordinates[:n].tolist()}
        return {
            "form": "first order",
            **places,
            **matrices,
            **{name: [_signal(each) for each in signals] for name, signals in inputs.items()},
            "rows": [_row(d, row) for row in d.contacts],
            **start,
        }
    return {
        "form": "second order",
        **places,
        **{name: getattr(d, name).tolist() for name in ("M", "C", "K", "H")},
        "u0": d.u0.tolist(),
        "rows": [_row(d, row) for row in d.contacts],
        "forces": _forces(d),
        "springs": [_spring(each, row) for each, row in zip(d.springs, d.directions, strict=True)],
        **start,
    }


def _spring(spring: PowerLaw, direction: Array) -> dict[str, Json]:
    """Return a one-sided non-linear spring."""
    names = ("gap", "K", "n", "b", "c", "p", "depth", "least", "most")
    constants: dict[str, Json] = {
        name: each if math.isfinite(each) else None for name, each in zip(names, spring.numbers, strict=True)
    }
    return {"name": spring.name, "direction": direction.tolist(), **constants}


def _kind(d: Dynamics, i: int) -> str:
    if d.driven[i]:
        return "prescribed"
    return "free" if d.massive[i] or not d.stores_energy else "massless"


def _given_motion(d: Dynamics, i: int) -> dict[str, Json]:
    return {"motion": _signal(d.motions[i])} if i in d.motions else {}


def _row(d: Dynamics, row: Contact) -> dict[str, Json]:
    """Return the law of a row; a bound that is infinite is null."""
    lower, upper = row.bounds
    law: dict[str, Json] = {
        "name": row.name,
        "law": row.law.name,
        "of": "rate" if row.law.of_rate else "place",
        "lower": None if math.isinf(lower) else lower,
        "upper": None if math.isinf(upper) else upper,
        "relative_degree": row.relative_degree,
        "restitution": row.e,
    }
    if row.law.tangential:
        law |= {"normal": d.contacts[row.normal].name, "friction": row.mu, "static_friction": row.mu_s}
    return law


def _forces(d: Dynamics) -> list[Json]:
    """Return the forces on coordinates: signals of the time, and formulas of the motion."""
    found: list[Json] = [{"coordinate": d.nodes[i], **_signal(load)} for i, load in d.loads]
    for held in d.holds:
        raise InputError(f"{held.law.element} is set at instants, and files of problems hold no such force")
    for law in d.force_laws:
        formula = getattr(law.f, "formula", None)
        if formula is None:
            raise InputError(f"{law.element} has a force that is a function without a formula, which no file can hold")
        (node,) = law.nodes
        found.append({"coordinate": node, "signal": "Formula", "formula": formula, "constants": _constants(law.f)})
    return found


def _signal(signal: float | TimeFunction) -> dict[str, Json]:
    """Return a function of time as its kind and its constants."""
    if isinstance(signal, SignalSum):
        return {"signal": "Sum", "terms": [_signal(each) for each in signal.terms]}
    name = type(signal).__name__
    if name in SIGNALS and callable(signal):
        return {"signal": name, **_constants(signal)}
    if callable(signal):
        raise InputError(f"the signal {signal!r} is a function of Python, which no file can hold")
    return {"signal": "Constant", "value": float(signal)}


def _constants(function: Callable[..., T]) -> dict[str, Json]:
    """Return the fields of a function of time or of the motion that is a dataclass, without those that are not given."""
    values = {each.name: getattr(function, each.name) for each in fields(cast("DataclassInstance", function))}
    return {name: value for name, value in values.items() if value is not None}


def _fact(problem: Problem, fact: Fact) -> dict[str, Json]:
    """Return a fact, its value as a decimal text of the digits that are known."""
    text = f"{fact.value:#.{fact.digits}g}"
    usual = {name: value for name, value in defaults(PROBLEMS[problem.name]).items() if value is not None}
    if usual.items() <= problem.parameters.items():
        text = decimals().get((problem.name, fact.symbol), text)
    return {
        "name": fact.symbol,
        "what": fact.what,
        "value": text,
        "digits": len(text.partition("e")[0].lstrip("-0.").replace(".", "")) or fact.digits,
        "unit": fact.unit,
        "measured": _words(problem, fact),
        "reading": _reading(fact),
        "accuracy": fact.accuracy,
        "scale": fact.scale,
    }


@cache
def decimals() -> dict[tuple[str, str], str]:
    """Return the decimals of facts with the default parameters that are known to more digits than those of a double.

    They are computed by `benchmarks/digits.py`, with other code than the values of the registry.
    """
    lines = resources.files("lcpimpact.truth").joinpath("digits.csv").read_text(encoding="utf-8").splitlines()
    return {(row["problem"], row["fact"]): row["value"] for row in csv.DictReader(lines)}


def _reading(fact: Fact) -> dict[str, Json]:
    """Return the function that measures a fact, with all of its arguments."""
    measure, given = _parts(fact.measure)
    known = inspect.signature(measure).parameters
    arguments = {name: given.get(name, known[name].default) for name in [*known][1:]}
    shared = measure.__module__ == "lcpimpact.reading"
    found = {name: _argument(value) for name, value in arguments.items()}
    return {"by": measure.__name__ if shared else "other", **found}


def _parts(function: Callable[..., T]) -> tuple[Callable[..., T], Mapping[str, Json]]:
    """Return a function and the arguments that it is given beforehand."""
    return (function.func, function.keywords) if isinstance(function, partial) else (function, {})


def _argument(value: Json | Callable[..., T]) -> Json:
    """Return an argument of a reading; a function by its docstring, and no limit as null."""
    if callable(value):
        return _sentence(_parts(value)[0])
    return None if isinstance(value, float) and math.isinf(value) else value


def _sentence(function: Callable[..., T]) -> str:
    """Return the first line of a docstring, without its verb."""
    text = (inspect.getdoc(function) or "").split("\n")[0]
    return text.removeprefix("Return ").removesuffix(".")


def _words(problem: Problem, fact: Fact) -> str:
    """Return how a fact is measured, in words."""
    measured = _reading(fact)
    by = str(measured.pop("by"))
    if by not in READINGS:
        others = [f"{name} = {value:g}" for name, value in measured.items() if isinstance(value, float | int)]
        others += [f"{name} {value}" for name, value in measured.items() if isinstance(value, str) and name != "force"]
        sentence = _sentence(_parts(fact.measure)[0])
        return f"{sentence} ({', '.join(others)})" if others else sentence
    nodes: dict[Json, str] = dict(enumerate(problem.dynamics.nodes))
    rate = "v_" if measured.get("of") == "v" else ""
    second = problem.unit("t")
    added = {
        "node": rate + nodes.get(measured.get("i"), ""),
        "at": f" at {measured['contact']}" if measured.get("contact") else "",
        "which": "the last event" if measured.get("number") == -1 else f"event {measured.get('number')}",
        "until": f" up to t = {measured['until']:.6g} {second}".rstrip() if measured.get("until") else "",
        "unit": f", divided by {measured['unit']:.6g}" if measured.get("unit", 1.0) != 1.0 else "",
        "second": f" {second}".rstrip(),
        "when": "just before" if measured.get("side") == "left" else "just after",
        "extreme": "greatest" if measured.get("sign") == 1.0 else "least",
        "way": "upwards" if measured.get("direction") == 1.0 else "downwards",
    }
    return READINGS[by].format(**(measured | added))


def _motion(problem: Problem, *, steps: int = 101) -> dict[str, Json] | None:
    """Return samples of the motion in closed form, or None without one.

    ``steps``: a prime number, since events in closed form are often at simple fractions of the end, where v jumps.
    """
    if problem.motion is None:
        return None
    t: Array = np.arange(steps + 1) * problem.t_end / steps
    states = np.shape(problem.scheme.B)[0] if isinstance(problem.scheme, LinearComplementaritySystem) else None
    q, v = (each[:, :states].tolist() for each in problem.motion(t))
    return {"t": t.tolist(), "q": q, "v": v}


def _text(value: Json, indent: str = "") -> str:
    """Return data as JSON with a line for each entry, and for each row of numbers or texts."""
    inner = f"{indent} "
    if isinstance(value, Mapping) and any(isinstance(each, Mapping | list | tuple) for each in value.values()):
        rows = [f"{inner}{_text(key)}: {_text(each, inner)}" for key, each in value.items()]
        return "{\n" + ",\n".join(rows) + f"\n{indent}}}"
    if isinstance(value, list | tuple) and any(isinstance(each, Mapping | list | tuple) for each in value):
        return "[\n" + ",\n".join(f"{inner}{_text(each, inner)}" for each in value) + f"\n{indent}]"
    return json.dumps(value, ensure_ascii=False, allow_nan=False)
