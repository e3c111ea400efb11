"""Data and tables for ``lcpimpact list``: the declared properties and the docstrings of the entries of the registries."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING as NO_DEFAULT
from dataclasses import fields
from importlib.metadata import metadata
from typing import Any, TypeAlias

from rich.table import Table
from rich.text import Text

from lcpimpact.bibliography import cited
from lcpimpact.cli.output import plain
from lcpimpact.course import LESSONS, PROJECTS
from lcpimpact.errors import InputError
from lcpimpact.integrators import METHODS
from lcpimpact.lcp import SOLVERS
from lcpimpact.problems import PROBLEMS, load_problem
from lcpimpact.scheme.elements import ELEMENTS
from lcpimpact.scheme.structure import Contact
from lcpimpact.simulation import methods_that_handle

Entry: TypeAlias = dict[str, Any]
"""Facts about an entry of a registry: "name", "summary", "about" (the docstring), and its declared properties."""


def names(kind: str, for_: str | None) -> list[str]:
    """Return the names of a registry, or of its problems and methods only those for one method or problem."""
    if for_ is None:
        return list(REGISTRIES[kind])
    if kind == "methods":
        return methods_that_handle(load_problem(for_).dynamics)
    if kind == "problems":
        METHODS[for_]
        return [each for each in PROBLEMS if for_ in methods_that_handle(load_problem(each).dynamics)]
    raise InputError(f"--for {for_!r} goes with problems and methods: leave it out for {kind}")


def matches(entry: Entry, texts: Iterable[str]) -> bool:
    """Return whether an entry has all texts in its properties."""
    words = " ".join(_words(plain(entry))).lower()
    return all(text.lower() in words for text in texts)


def _words(value: Any) -> Iterator[str]:
    """Yield all text of an entry, without the line breaks of docstrings."""
    if isinstance(value, Mapping):
        for key, each in value.items():
            yield from (str(key), *_words(each))
    elif isinstance(value, list):
        for each in value:
            yield from _words(each)
    else:
        yield " ".join(str(value).split())


def _entry(name: str, summary: str, documented: Any, **properties: Any) -> Entry:
    return {"name": name, "summary": summary, **properties, "about": inspect.getdoc(documented) or ""}


def _problem(name: str) -> Entry:
    problem = load_problem(name)
    d = problem.dynamics
    return _entry(
        name,
        _first_line(PROBLEMS[name]),
        PROBLEMS[name],
        parameters=dict(problem.parameters),
        nodes=list(d.nodes),
        contacts=[{"name": each.name, "relative degree": each.relative_degree} for each in d.contacts],
        degrees=_degrees(d.contacts),
        facts={each.symbol: {"value": each.value, "unit": each.unit, "what": each.what} for each in problem.facts},
        t_end=problem.t_end,
        methods=methods_that_handle(d),
        source=cited(problem.source),
    )


def _degrees(contacts: Sequence[Contact]) -> list[str]:
    """Return the relative degrees in words, with one sentence for rows of which it says the same."""
    named: dict[str, list[str]] = {}
    for each in contacts:
        named.setdefault(each.sentence.removeprefix(each.name), []).append(each.name)
    found = []
    for rest, (*others, last) in named.items():
        names = f"{', '.join(others)} and {last}" if others else last
        found.append(names + (rest.replace(" has ", " have ", 1) if others else rest))
    return found


def _method(name: str) -> Entry:
    kind = METHODS[name]
    d = kind.declared
    options = {each.name: each.default for each in fields(kind) if each.default is not NO_DEFAULT}  # type: ignore[arg-type]
    return _entry(
        name,
        d.summary,
        kind,
        orders=d.orders,
        relative_degrees=list(d.relative_degrees),
        handles=[feature.value for feature in d.handles],
        level=d.level,
        penetration=d.penetration,
        reaction_time=d.reaction_time,
        energy=d.energy + ("; impacts never increase it" if d.dissipates else ""),
        steps=d.adaptive or "dt",
        solves_lcp=kind.solves_lcp,
        options=options,
        source=cited(d.source),
    )


def _solver(name: str) -> Entry:
    solver = SOLVERS[name]
    return _entry(
        name,
        solver.summary,
        getattr(solver, "kernel", type(solver)),
        requires=[each.value for each in solver.requires],
        storages=list(solver.storages),
        bounds=solver.boxed,
        largest=solver.largest,
        residual=solver.tol,
        max_iter=solver.max_iter,
        source=cited(solver.source),
    )


def _element(name: str) -> Entry:
    kind = ELEMENTS[name]
    constants = [each.name for each in fields(kind) if each.name != "symbols"]  # type: ignore[arg-type]
    return _entry(name, _first_line(kind), kind, constants=constants)


def _lesson(name: str) -> Entry:
    lesson = LESSONS[name]
    return {"name": name, "summary": lesson.title, "asks for": [task.stated for task in lesson.tasks], "about": ""}


def _project(name: str) -> Entry:
    project = PROJECTS[name]
    return {"name": name, "summary": project.title, "asks": project.asks, "noise": dict(project.noise), "about": ""}


def _first_line(thing: Any) -> str:
    return (inspect.getdoc(thing) or "").split("\n")[0].strip()


def details(entry: Entry) -> Iterator[str]:
    """Yield the lines that say all of an entry."""
    yield f"{entry['name']}: {entry['summary']}"
    for key, value in entry.items():
        if key in ("name", "summary", "about", "contacts"):
            continue
        if key == "facts":
            yield from (f"  {symbol} = {_fact(fact)}" for symbol, fact in value.items())
        elif key == "degrees":
            yield from (f"  {sentence}" for sentence in value)
        else:
            yield f"  {key.replace('_', ' ')}: {_listed(value)}"
    yield from entry["about"].split("\n")[1:]


def _fact(fact: Mapping[str, Any]) -> str:
    return f"{fact['value']:.10g} {fact['unit']}".rstrip() + f"  ({fact['what']})"


def _listed(value: Any) -> str:
    """Return a property in one line."""
    if isinstance(value, Mapping):
        return ", ".join(f"{key}={_listed(each)}" for key, each in value.items()) or "none"
    if isinstance(value, list):
        return ", ".join(map(str, value)) or "none"
    if value is None or isinstance(value, bool):
        return {None: "none", True: "yes", False: "no"}[value]
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _table(*columns: str) -> Table:
    table = Table(box=None, header_style="bold", pad_edge=False)
    for column in columns:
        table.add_column(column, overflow="fold")
    return table


def _problems(entries: list[Entry], whole: bool, *, max_contacts: int = 3) -> Table:
    # max_contacts: maximum number of contacts listed in the table of problems.
    table = _table("problem", "parameters (SI)", "relative degree", "closed forms", "source")
    for each in entries:
        degrees = each["degrees"]
        more = f" And {len(degrees) - max_contacts} more." if len(degrees) > max_contacts else ""
        sentences = " ".join(degrees[:max_contacts]) + more
        table.add_row(each["name"], _listed(each["parameters"]), sentences, ", ".join(each["facts"]), each["source"])
    return table


def _methods(entries: list[Entry], whole: bool) -> Table:
    table = _table("method", "what it is; what it declares; where it is from")
    for each in entries:
        degrees = _listed(each["relative_degrees"])
        handles = ", ".join(each["handles"]) or "no further features"
        lines = (
            "orders: " + ", ".join(f"{where} {order}" for where, order in each["orders"].items()),
            f"relative degrees {degrees}; {handles}",
            f"contacts at level: {each['level']}; penetration after impacts: {each['penetration']}; "
            f"force {each['reaction_time']}",
            f"energy: {each['energy']}",
            *[f"steps: {each['steps']}"] * (each["steps"] != "dt"),
            f"options: {_listed(each['options'])}",
            each["source"],
        )
        table.add_row(each["name"], _lines(each["summary"], *lines))
    for name, reason in METHODS.broken.items() if whole else ():
        table.add_row(name, _lines("broken: registered by another package, and cannot be loaded", reason))
    return table


def _solvers(entries: list[Entry], whole: bool) -> Table:
    table = _table("solver", "what it is; what it declares; where it is from")
    for each in entries:
        declared = (
            f"M: {', '.join(each['requires'])}" if each["requires"] else "any M",
            f"reads {', '.join(each['storages'])}",
            f"bounds: {_listed(each['bounds'])}",
            "any n" if each["largest"] is None else f"n <= {each['largest']}",
            f"residual {each['residual']:g}",
        )
        lines = ("; ".join(declared), *[each["source"]] * (each["source"] != "-"))
        table.add_row(each["name"], _lines(each["summary"], *lines))
    if whole:
        here, elsewhere = _backends()
        installed = f"any backend of qpsolvers, as qp:osqp; installed: {', '.join(here) or 'none'}"
        install = f"not installed: {', '.join(elsewhere) or 'none'}; pip install 'qpsolvers[NAME]' installs one of them"
        table.add_row("qp:NAME", _lines(installed))
        table.add_row("", _lines(install))
    return table


def _lines(first: str, *others: str) -> Text:
    return Text(first).append("".join(f"\n{line}" for line in others), style="dim")


def _backends() -> tuple[list[str], list[str]]:
    """Return the QP backends that pip can install with qpsolvers: the installed ones, and the others."""
    extras = metadata("qpsolvers").get_all("Provides-Extra") or []
    # Two of the extras are collections of others.
    names = sorted(name for name in extras if "-" not in name and f"qp:{name}" not in list(SOLVERS))
    here = [name for name in names if f"qp:{name}" in SOLVERS]
    return here, [name for name in names if name not in here]


def _elements(entries: list[Entry], whole: bool) -> Table:
    table = _table("element", "what it is", "constants")
    for each in entries:
        table.add_row(each["name"], each["summary"], ", ".join(each["constants"]))
    return table


def _lessons(entries: list[Entry], whole: bool) -> Table:
    table = _table("lesson", "title", "the answer defines")
    for each in entries:
        table.add_row(each["name"], each["summary"], _lines(*each["asks for"]))
    return table


def _projects(entries: list[Entry], whole: bool) -> Table:
    table = _table("project", "title", "from data with noise")
    for each in entries:
        table.add_row(each["name"], each["summary"], each["asks"])
    return table


REGISTRIES: dict[str, Mapping[str, Any]] = {
    "problems": PROBLEMS,
    "methods": METHODS,
    "solvers": SOLVERS,
    "elements": ELEMENTS,
    "lessons": LESSONS,
    "projects": PROJECTS,
}
ENTRIES: dict[str, Callable[[str], Entry]] = {
    "problems": _problem,
    "methods": _method,
    "solvers": _solver,
    "elements": _element,
    "lessons": _lesson,
    "projects": _project,
}
TABLES: dict[str, Callable[[list[Entry], bool], Table]] = {
    "problems": _problems,
    "methods": _methods,
    "solvers": _solvers,
    "elements": _elements,
    "lessons": _lessons,
    "projects": _projects,
}
