"""The page: problems, their runs as JavaScript, and the interface, in one HTML file."""

from __future__ import annotations

import base64
import inspect
import json
import re
import zlib
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from lcpimpact import __version__
from lcpimpact.arguments import checked
from lcpimpact.errors import UnsupportedError
from lcpimpact.explorer.drawing import drawing
from lcpimpact.explorer.models import FIRST, MOST_STEPS, STEPS, Model, model, refusals_of, why_not_exact
from lcpimpact.files import Json, check_output, whole_file
from lcpimpact.integrators.printed.javascript import equations_source, run_source
from lcpimpact.plotting.layout import SYMBOL_WIDTH
from lcpimpact.plotting.vertical import axes_of
from lcpimpact.problems import PROBLEMS, load_problem
from lcpimpact.problems.base import Problem
from lcpimpact.problems.parameters import is_registered, units_of
from lcpimpact.scheme.bodies import has_bodies
from lcpimpact.scheme.scheme import Scheme

ENDINGS = (".html",)

METHODS_OF_ALL = 3
"""Number of methods for each problem in a page of all, which has some 120 kB."""


@checked
def explore(
    problem: Problem | str | None = None, path: str | Path = "explorer.html", *, t_end: float | None = None
) -> Path:
    """Write the explorer: one HTML file in which sliders change a problem, and its run and its exact motion follow.

    The page opens from disk and requests nothing. Its runs are those of `lcpimpact.simulate`, bit for bit.

    Parameters
    ----------
    problem : Problem or str, optional
        What the page holds: a problem, by its name or any scheme; by default all registered ones that it takes.
    path : str or Path
        A file ending in .html.
    t_end : float, optional
        End of the runs in s; by default that of the problem.

    Returns
    -------
    Path
        The file, which is written atomically.

    Raises
    ------
    InputError
        For another ending, or a folder that cannot be written.
    UnsupportedError
        For a problem that the page does not take, with the reason.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     explore("system-1", f"{folder}/system-1.html").name
    'system-1.html'
    """
    path = Path(path)
    check_output(path, ENDINGS)
    text = page(*(models(problem, t_end) if problem is not None else all_models()))
    with whole_file(path) as part:
        part.write_text(text, encoding="utf-8")
    return path


def models(problem: Problem | str, t_end: float | None = None) -> tuple[list[Model], dict[str, str]]:
    """Return one problem by all methods that a page takes, and no refusals."""
    problem = load_problem(problem) if isinstance(problem, str) else problem
    end = problem.t_end if t_end is None else t_end
    return [model(problem, end, most=len(FIRST))], {}


def all_models() -> tuple[list[Model], dict[str, str]]:
    """Return the registered problems that a page takes, and for the other problems the reason for its refusal, by name."""
    found, refused = list[Model](), dict[str, str]()
    for name in PROBLEMS:
        problem = load_problem(name)
        try:
            found.append(model(problem, problem.t_end, most=METHODS_OF_ALL))
        except UnsupportedError as error:
            refused[name] = str(error)
    return found, refused


def page(found: Sequence[Model], refused: dict[str, str]) -> str:
    """Return the HTML page of some problems; ``refused`` are the others, and why."""
    shapes: dict[str, int] = {}
    # As a computed key a name is no more than that: __proto__ would be the prototype.
    problems = ",\n".join(f"[{_json(each.problem.name)}]:{problem_source(each, shapes)}" for each in found)
    template = _environment().get_template("page.html.j2")
    limits = {"steps": STEPS, "most": MOST_STEPS, "symbol": SYMBOL_WIDTH}
    known = {"STROKES": f"[{','.join(shapes)}]", "REFUSED": _json(refused), "LIMITS": _json(limits)}
    constants = [f"const {name} = {value};" for name, value in known.items()]
    script = "\n".join(
        ['"use strict";', *constants, *(_without_comments(_text(each)) for each in ("engine.js", "interface.js"))]
    )
    return template.render(
        packed=[_packed(each) for each in (script, f"{{{problems}}}")], some_refused=bool(refused), version=__version__
    )


def _packed(text: str) -> str:
    """Return a text as base64 of its deflated bytes."""
    return base64.b64encode(zlib.compress(text.encode(), 9)).decode()


def _text(name: str) -> str:
    """Return the text of a file of the explorer."""
    return (files("lcpimpact.explorer") / name).read_text(encoding="utf-8")


def _without_comments(script: str) -> str:
    """Return a script without comments that end a line and without indentation."""
    lines = (re.sub(r"(^|  )//.*", "", line).strip() for line in script.split("\n"))
    return "\n".join(line for line in lines if line)


@cache
def _environment() -> Environment:
    return Environment(loader=PackageLoader("lcpimpact", "explorer"), undefined=StrictUndefined, trim_blocks=True)


def _json(value: Json) -> str:
    """Return a value as JSON that may stand in a script."""
    return json.dumps(value, ensure_ascii=False, separators=(",", ":")).replace("</", "<\\/")


def problem_source(found: Model, shapes: dict[str, int]) -> str:
    """Return a problem as a JavaScript object; ``shapes`` gathers the strokes of its elements, by their text."""
    problem, d = found.problem, found.problem.dynamics
    first = max((traces[0] for traces in found.traces.values()), key=lambda each: len(each.names))
    parts = d.decomposition
    fields: dict[str, Json] = {
        "about": _about(problem),
        "registered": is_registered(problem),
        "tEnd": found.t_end,
        "nodes": list(d.nodes),
        "contacts": [
            {"name": each.name, "law": each.law.name, "degree": each.relative_degree, "normal": each.normal}
            for each in d.contacts
        ],
        "axes": axes(problem),
        "H": d.H.astype(float).tolist(),
        "parts": {name: getattr(parts, name).T.tolist() for name in ("massive", "damped", "static", "driven")},
        "inexact": why_not_exact(d),
        "names": first.names,
        "numbers": found.numbers,
        "units": units_of(problem, first.names),
        "sliders": [[each.name, each.value, each.low, each.high] for each in found.sliders],
        "refusals": refusals_of(found),
        "drawing": drawn(problem, shapes),
    }
    methods = []
    for name, traces in found.traces.items():
        cases = ",\n".join(run_source(each.program, each.run) for each in traces)
        method = traces[0].method
        own: dict[str, Json] = {
            "names": traces[0].names, "laws": traces[0].run.writer.sizes[3], "impactSteps": method.impact_steps,
            "at": method.reaction_at, "summary": method.declared.summary,
        }  # fmt: skip
        methods.append(f"{_json(name)}:{{...{_json(own)},cases:[{cases}]}}")
    equations = equations_source(first.program, first.dynamics, first.start)
    return f"{{...{_json(fields)},equations:{equations},methods:{{{','.join(methods)}}}}}"


def axes(problem: Problem) -> list[Json]:
    """Return the axes of the coordinates of a problem: their indices, unit, unit of rates, and whether they point downwards.

    The last entry has the contact and the coordinate of each resting surface along the axis.
    """
    d = problem.dynamics
    found: list[Json] = []
    for axis in axes_of(problem, d.nodes):
        indices = [d.nodes.index(node) for node in axis.nodes]
        places = [each.place for each in axis.surfaces]
        resting: list[Json] = [
            [i, j]
            for i, row in enumerate(d.H)
            for j in np.flatnonzero(row).tolist()
            if np.count_nonzero(row) == 1 and j in indices and -d.u0[i] / row[j] in places
        ]
        unit, rate = problem.unit(axis.nodes[0]), problem.unit(f"v_{axis.nodes[0]}")
        found.append([indices, unit or "1", rate or "1", axis.down, resting])
    return found


def _about(problem: Problem) -> str:
    """Return the first line of what the registry says of a problem."""
    known = PROBLEMS[problem.name] if is_registered(problem) else None
    return (inspect.getdoc(known) or "").split("\n")[0] if known else ""


def drawn(problem: Problem, shapes: dict[str, int]) -> dict[str, Json] | None:
    """Return the drawing of a scheme, with the number of its strokes in ``shapes``; None for matrices and bodies."""
    if not isinstance(problem.scheme, Scheme) or has_bodies(problem.scheme.elements):
        return None
    nodes, links = drawing(problem.scheme.elements, problem.dynamics.nodes)
    numbered = [[shapes.setdefault(_json(strokes), len(shapes)), *others] for strokes, *others in links]
    return {"nodes": nodes, "links": numbered}
