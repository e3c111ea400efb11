"""Schemes, systems and problems: the drawing, the parameters and the matrices."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape
from typing import Any

import numpy as np
import pandas as pd

from lcpimpact.bibliography import cited
from lcpimpact.plotting.schematic import draw_scheme
from lcpimpact.problems.base import Problem
from lcpimpact.report.contents import MAX_ORDER, MAX_ROWS
from lcpimpact.report.report import Section
from lcpimpact.scheme.bodies import has_bodies
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.lagrangian import Lagrangian, LagrangianDynamics
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.scheme.sparse_dynamics import SparseDynamics
from lcpimpact.scheme.system import LinearComplementaritySystem


def scheme(given: Scheme) -> tuple[str, list[Section]]:
    """Return the drawing and the matrices of a scheme."""
    d = given.assemble()
    sections = [_laws(d)] if isinstance(d, LagrangianDynamics) else _sections(given, d)
    return f"{type(given).__name__} of {len(given.elements)} elements", sections


def system(given: LinearComplementaritySystem) -> tuple[str, list[Section]]:
    """Return the block diagram and the matrices of a system."""
    return "Linear complementarity system", _sections(given, given.assemble())


def lagrangian(given: Lagrangian) -> tuple[str, list[Section]]:
    """Return the contacts and joints of a Lagrangian system."""
    return f"Lagrangian system in {', '.join(map(escape, given.nodes))}", [_laws(given.assemble())]


def problem(given: Problem) -> tuple[str, list[Section]]:
    """Return the scheme of a problem, its parameters, its initial state and its matrices."""
    d = given.dynamics
    if isinstance(given.scheme, Lagrangian) or isinstance(d, LagrangianDynamics):
        here = d.at(0.0, given.initial_coordinates, given.initial_velocities)
        values = zip(("M(q) at the start", "H at the start"), (here.M, here.H), (d.nodes, _names(d)), strict=True)
        text = "".join(_matrix(title, A, rows, d.nodes) for title, A, rows in values if len(A))
        drawing, matrices = [], [_laws(d), Section("Equations", text=f'<div class="row">{text}</div>')]
    else:
        first, *matrices = _sections(given.scheme, d)
        drawing = [first]
    source = "" if given.source == "-" else f" {escape(cited(given.source))}."
    lead = f"<b>{escape(given.name)}</b>, 0 ... {given.t_end:g} s.{source}"
    parameters = pd.DataFrame(list(given.parameters.items()), columns=["parameter", "value"])
    start = pd.DataFrame({"node": d.nodes, "q(0)": given.initial_coordinates, "v(0)": given.initial_velocities}).head(
        MAX_ROWS
    )
    sections = [*drawing, Section("Parameters", table=parameters, form="g")] if len(parameters) else drawing
    return lead, [*sections, Section("Initial state", table=start, form="g"), *matrices]


def _laws(d: Dynamics) -> Section:
    """Return the table of the rows with their laws."""
    rows = [(row.name, row.law.name, row.mu, row.e) for row in d.contacts]
    return Section("Contacts and joints", table=pd.DataFrame(rows, columns=["row", "law", "μ", "e"]), form="g")


def _names(d: Dynamics) -> tuple[str, ...]:
    """Return the names of the reactions."""
    return tuple(contact.name for contact in d.contacts)


def _sections(scheme: Scheme | LinearComplementaritySystem, d: Dynamics, *, max_elements: int = 200) -> list[Section]:
    """Return the drawing, and the matrices if they are small.

    ``max_elements``: largest number of elements that are drawn.
    """
    if isinstance(d, SparseDynamics):
        return [Section("", text=f"{len(d.nodes):,} nodes and {len(d.u0):,} contacts in sparse matrices.")]
    large = isinstance(scheme, Scheme) and len(scheme.elements) > max_elements
    drawn = not large and not (isinstance(scheme, Scheme) and has_bodies(scheme.elements))
    figures = [draw_scheme(scheme)] if drawn else []
    sections = [Section("", text="The scheme is too large to be drawn." if large else "", figures=figures)]
    if max(len(d.nodes), len(d.contacts)) > MAX_ORDER:
        return sections
    return [*sections, Section("Equations", text=f'<div class="row">{"".join(_matrices(scheme, d))}</div>')]


def _matrices(scheme: Scheme | LinearComplementaritySystem, d: Dynamics) -> Iterator[str]:
    """Yield the tables of M, C, K, H and the gaps, or of A, B, C and D."""
    if isinstance(scheme, LinearComplementaritySystem):
        x = tuple(scheme.states or ())
        λ = tuple(scheme.multipliers or ())
        for name, A, rows, columns in (
            ("A", scheme.A, x, x),
            ("B", scheme.B, x, λ),
            ("C", scheme.C, λ, x),
            ("D", scheme.D, λ, λ),
        ):
            yield _matrix(name, A, rows, columns)
        return
    reactions = _names(d)
    for name, A, unit in (("M", d.M, "kg"), ("C", d.C, "N s/m"), ("K", d.K, "N/m")):
        yield _matrix(f"{name} [{unit}]", A, d.nodes, d.nodes)
    if reactions:
        yield _matrix("H", d.H, reactions, d.nodes)
        yield _matrix("u at q = 0 [m]", d.u0[:, None], reactions, ("",))


def _matrix(title: str, A: Any, rows: tuple[str, ...], columns: tuple[str, ...]) -> str:
    frame = pd.DataFrame(np.asarray(A), index=list(rows), columns=list(columns))
    return f"<div>{escape(title)}{frame.to_html(float_format=lambda x: format(x + 0.0, '.6g'), border=0)}</div>"
