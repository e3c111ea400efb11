"""Schemes that are given to a page: their elements, checks and steps, translated (see `translation`)."""

from __future__ import annotations

import json
from dataclasses import fields
from functools import cache
from importlib.resources import files
from types import UnionType
from typing import Any, Union, cast, get_args, get_origin, get_type_hints

from lcpimpact import schemefile
from lcpimpact.errors import InputError
from lcpimpact.explorer.drawing import drawing
from lcpimpact.explorer.models import FIRST, LOWER, MAX_NODES, UPPER
from lcpimpact.explorer.translation import Translation
from lcpimpact.explorer.units import OF_INITIAL, stated_units
from lcpimpact.integrators import METHODS
from lcpimpact.integrators.moreau_jean import MoreauJean
from lcpimpact.integrators.stepping import kernel, linear_step
from lcpimpact.integrators.stepping.linear_step import LinearStep
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.solve import limits
from lcpimpact.lcp.solvers.closed_form import closed_form
from lcpimpact.numerics import elimination
from lcpimpact.problems.base import Problem
from lcpimpact.scheme import assembly, decomposition, impulse_paths, scheme, waves
from lcpimpact.scheme.elements import ELEMENTS
from lcpimpact.scheme.signals import SIGNALS, Harmonic

TAKEN = (
    "Mass", "Spring", "Dashpot", "KelvinVoigt", "Maxwell", "Zener", "GeneralizedMaxwell", "Jenkins", "Slider", "Bumper",
    "Rope", "Load", "PrescribedMotion",
)  # fmt: skip
"""The elements of a page."""

OF_STEPS = {
    "equations", "remember", "matrix", "momentum", "end", "law_of_impact", "predicted_gap", "weights", "begin", "_symbols",
    "first_mass", "reaction_at", "weight_of_paths",
}  # fmt: skip
"""Members of a method that a page runs."""

GIVEN = {
    "Bar", "HertzSpring", "HuntCrossley", "KelvinVoigtStop", "math_text", "Layout.coordinate_places", "Layout.load_place",
    "Layout._link_box",
    ".modulus", ".tau", "_as_tuple", "_convert", "_floor", "_locate_errors", "_shared_step",
    "balance_together", "callable", "checked", "Described", "examine", "featured_at", "find_rows", "ForceLaw",
    "InputError", "is_name", "is_real", "jumping_nodes", "kept_at", "kernel_at",
    "lcpimpact.numerics.elimination.solve", "lcpimpact.integrators.stepping.impulse_paths.impulse_paths",
    "LcpImpactError", "Load.follows_motion", "mentions", "PiecewisePolynomial", "MoreauJean.__post_init__", "Named",
    "no_paths",
    "number", "product", "Run", "solve", "solve_lcp", "springs_at", "starting_mass", "Terms", "UnsupportedError",
}  # fmt: skip
"""Names that scheme.js and runtime.js define themselves."""


@cache
def translated() -> str:
    """Return the steps, elements and checks of the package in JavaScript."""
    found = Translation(GIVEN, {LinearStep: OF_STEPS, Problem: {"_refuse_penetration"}})
    found.add(elimination.add_product, elimination.eliminate, kernel.steps, closed_form)
    found.add(linear_step.tabulate, *(METHODS[name] for name in FIRST), Harmonic, *(ELEMENTS[name] for name in TAKEN))
    found.add(
        assembly._refuse_shared_inner_nodes, assembly._refuse_ambiguous_names, assembly._refuse_loose_nodes,
        assembly._refuse_driven_masses,
        assembly.refuse_parallel_contacts, assembly._refuse_levers, assembly._check_restitution,
        decomposition.decompose, decomposition.relative_degrees, impulse_paths.impulse_paths, scheme._named, Problem,
        schemefile._check_size, schemefile._statement_kind, schemefile._read_initial, schemefile._read_numbers,
        schemefile._check_time, waves.cosine, drawing,
    )  # fmt: skip
    return found.source()


def hint(kind: Any) -> dict[str, Any]:
    """Return the conversion to a type by the reader of scheme files: the types it takes, and its words for them."""
    kinds = get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)
    held = {schemefile._container(each): each for each in kinds}
    what = dict.fromkeys(word for word in map(schemefile._describe_type, kinds) if word) or [schemefile.FUNCTION]
    found: dict[str, Any] = {
        "types": [each.__name__ for each in kinds if isinstance(each, type)],
        "what": " or ".join(what),
    }
    if "array" in held:
        found["array"] = hint(get_args(held["array"])[0])
    return found | {name: True for name in ("signal", "table") if name in held}


def of_method(name: str) -> dict[str, Any]:
    """Return the facts about a method in a page: its options and, if the page runs it, all that a run needs."""
    kind: Any = METHODS[name]
    found: dict[str, Any] = {"options": [each.name for each in fields(kind)]}
    if name in FIRST:
        method = cast(LinearStep, kind())
        found |= {
            "kind": kind.__name__, "degrees": method.declared.relative_degrees, "summary": method.declared.summary,
            "handles": [each.name for each in method.declared.handles], "steps": method.impact_steps,
            "at": method.reaction_at, "laws": method.laws,
        }  # fmt: skip
    return found


@cache
def file_facts() -> dict[str, Any]:
    """Return the facts about the package that the reader of scheme files in the page needs."""
    try:
        MoreauJean(theta=0.125)
    except InputError as error:
        theta = str(error).replace("0.125", "{value}")
    kinds: tuple[Any, ...] = (*(ELEMENTS[name] for name in TAKEN), Harmonic, schemefile.Run)
    return {
        "hints": {each.__name__: {name: hint(of) for name, of in _hints(each).items()} for each in kinds},
        "units": {name: stated_units(ELEMENTS[name]) for name in TAKEN} | OF_INITIAL,
        "number": hint(float),
        "text": hint(str),
        "elements": list(ELEMENTS),
        "signals": list(SIGNALS),
        "solvers": list(SOLVERS),
        "methods": {name: of_method(name) for name in METHODS},
        "first": FIRST,
        "theta": theta,
        "lower": LOWER,
        "upper": UPPER,
        "inexact": "the exact motion is drawn for contacts, and for sliders on a mass or a dashpot",
        "nodes": MAX_NODES,
        "tol": limits(SOLVERS["auto"], None, None)[0],
    }


def _hints(kind: Any) -> dict[str, Any]:
    """Return the types of the fields of a class."""
    known = get_type_hints(kind)
    return {each.name: known[each.name] for each in fields(kind)}


def source() -> str:
    """Return a JavaScript expression: a function that gives `ownProblem` of scheme.js."""

    def text(name: str) -> str:
        return (files("lcpimpact.explorer") / name).read_text(encoding="utf-8")

    methods = ",".join(METHODS[name].__name__ for name in FIRST)
    facts = f"const FILES={json.dumps(file_facts(), ensure_ascii=False)};"
    parts = [
        text("runtime.js"),
        facts,
        translated(),
        f"const KINDS_OF_METHODS={{{methods}}};",
        text("toml.js"),
        text("scheme.js"),
    ]
    return f"()=>{{{chr(10).join(parts)}\nreturn ownProblem;}}"
