"""Write docs/guide/integrators.md: how to choose an integrator, from the properties that the registered methods declare.

Run it as ``python docs/integrators_page.py`` after a method or what it declares has changed. A test compares the page with
what this would write.
"""

from __future__ import annotations

import inspect
import math
import sys
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

from tex import spelled, with_tex

from lcpimpact.bibliography import cited
from lcpimpact.integrators import METHODS
from lcpimpact.integrators.base import Declared
from lcpimpact.scheme.structure import Feature

PAGE = Path(__file__).parent / "guide" / "integrators.md"

FEATURES = (
    Feature.MASSLESS,
    Feature.RESTITUTION,
    Feature.IMPULSE_PATHS,
    Feature.SLIDERS,
    Feature.FRICTION,
    Feature.STATIC_FRICTION,
    Feature.JOINTS,
    Feature.POWER_LAWS,
    Feature.DASHPOTS,
    Feature.FORCES,
    Feature.HOLDS,
    Feature.MOTIONS,
    Feature.SYSTEMS,
    Feature.RELAYS,
    Feature.EQUATIONS,
    Feature.LAGRANGIAN,
)

WISHES: tuple[tuple[str, Callable[[Declared], bool]], ...] = (
    (
        "All elements and relative degrees",
        lambda d: set(d.relative_degrees) == {0, 1, 2} and set(d.handles) >= set(Feature),
    ),
    ("A reference, exact to rounding", lambda d: math.isinf(d.order_smooth) and not d.adaptive),
    ("Order 2 or more across force jumps (Systems 1 and 3)", lambda d: d.order_force_jump >= 2),
    ("Order above 1 across impacts", lambda d: d.order_impact > 1),
    ("No penetration after an impact", lambda d: 2 in d.relative_degrees and math.isinf(d.order_penetration)),
    ("Impacts add no energy, but by Newton's law itself", lambda d: d.dissipates),
    ("Adaptive steps", lambda d: bool(d.adaptive)),
    ("Dry friction on bodies with mass", lambda d: d.order_friction > 0),
    ("Relays and sliding modes", lambda d: d.order_relay > 0),
    (
        "Compliant contact by non-linear springs (see [penalty.md](penalty.md))",
        lambda d: Feature.POWER_LAWS in d.handles,
    ),
    ("General forces f(t, q, v), as drag or a Duffing spring", lambda d: Feature.FORCES in d.handles),
    ("Sampled forces, as of a controller with a zero-order hold", lambda d: Feature.HOLDS in d.handles),
    ("Prescribed motion, as of a shaking table", lambda d: Feature.MOTIONS in d.handles),
    ("Complementarity systems by their matrices", lambda d: Feature.SYSTEMS in d.handles),
    ("Lagrangian systems: bodies that turn, mechanisms", lambda d: Feature.LAGRANGIAN in d.handles),
)


def main() -> None:
    """Write the page."""
    PAGE.write_text(page(), encoding="utf-8")


def page() -> str:
    """Return the text of the page."""
    methods = {name: kind.declared for name, kind in METHODS.items() if kind.__module__.startswith("lcpimpact.")}
    lines = [
        "# How to choose an integrator",
        "",
        "This page lists the declared properties of the methods, written by `docs/integrators_page.py`; tests measure them",
        "over the whole registry. `lcpimpact list methods` shows the same. `simulate` refuses what a method does not",
        "declare, before the first step, and names those that can. Measured orders with their scatter, errors and costs are",
        "in [table.md](../benchmarks/table.md), what a step costs in [benchmarks](../benchmarks/index.md). To add a",
        "method: [new-method.md](../howto/new-method.md). Columns, chains and lattices of up to millions of nodes are run",
        "by `moreau-jean` with sparse matrices: [many-contacts.md](many-contacts.md).",
        "",
        "## Methods by requirement",
        "",
        "| requirement | methods |",
        "|---|---|",
    ]
    for wish, offers in WISHES:
        able = [name for name, declared in methods.items() if offers(declared)]
        lines.append(f"| {with_tex(wish)} | {', '.join(f'[{name}](#{name})' for name in able) or 'none'} |")
    lines += [
        "",
        "Otherwise: `moreau-jean` for studies, `exact` as the reference, `event-driven` for a smooth method of",
        "high order between few events, `radau-fesd` for many digits at large steps, and a penalised problem to see what",
        "smoothing costs.",
        "",
        "## Features by method",
        "",
        "Relative degree 0: the contact plate is massless on a spring, 1: on a dashpot, 2: both sides have mass, and",
        "velocities jump.",
        "",
        "| method | degree 0 | 1 | 2 | " + " | ".join(feature.value for feature in FEATURES) + " |",
        "|---|" + "---|" * (3 + len(FEATURES)),
    ]
    for name, d in methods.items():
        degrees = ["yes" if degree in d.relative_degrees else "" for degree in (0, 1, 2)]
        features = ["yes" if feature in d.handles else "" for feature in FEATURES]
        lines.append(f"| [{name}](#{name}) | " + " | ".join(degrees + features) + " |")
    lines += [
        "",
        "## Orders",
        "",
        "In the coordinates with mass (sup norm), across impacts in the velocities ($L^1$ norm; their sup norm converges",
        "for no method; what is declared is a median: [slopes scatter](convergence.md#the-order-across-many-impacts)).",
        "*force kink*: relative degree 0; *force jump*: degree 1; *friction*: reversal or sticking of a body",
        "on a slider; *relays*: switches, and the start of sliding modes; *loss*: energy lost in smooth motion by",
        "steps with the default options. What is said of energy leaves out what",
        "Newton's law itself gains in impacts with friction, by",
        "[Kane's paradox](comparing.md#energy-that-an-impact-gains-kanes-paradox).",
        "",
        "| method | "
        + " | ".join(next(iter(methods.values())).orders)
        + " | penetration after impacts | loss | adds no energy | steps |",
        "|---|" + "---|" * 10,
    ]
    for name, d in methods.items():
        cells = [
            *d.orders.values(),
            with_tex(d.penetration),
            with_tex(d.loss),
            "yes" if d.dissipates else "",
            d.adaptive or "dt",
        ]
        lines.append(f"| [{name}](#{name}) | " + " | ".join(cells) + " |")
    lines.append("")
    for name, d in methods.items():
        lines += section(name, d)
    return "\n".join(lines)


def section(name: str, d: Declared) -> list[str]:
    """Return the text of one method: what its module says, its options, and what it declares."""
    kind = METHODS[name]
    module = inspect.getdoc(sys.modules[kind.__module__]) or ""
    options = ", ".join(f"`{each.name}={each.default}`" for each in fields(kind))  # type: ignore[arg-type]
    return [
        f"## {name}",
        "",
        markdown(module),
        "",
        f"- Contacts at level: {d.level}.",
        f"- Force: {with_tex(d.reaction_time)}.",
        f"- Energy: {with_tex(d.energy)}.",
        f"- Options: {options or 'none'}.",
        f"- Source: {cited(d.source, '{{cite:t}}`{}`'.format)}.",
        "",
    ]


def markdown(text: str) -> str:
    """Return reStructuredText of a docstring as Markdown: formulas as TeX, literals with one backquote."""
    lines, formula = [], False
    for line in text.splitlines():
        if line.startswith(".. math::"):
            formula = True
            lines.append("$$" + spelled(line.removeprefix(".. math::").strip()))
        elif formula and line and not line.startswith(" "):
            raise ValueError(f"a formula must be indented and end with an empty line: {line!r}")
        elif formula and not line:
            if lines[-1] == "$$":
                continue
            formula = False
            lines[-1] += "$$"
            lines.append("")
        else:
            lines.append(spelled(line.strip()) if formula else line)
    if formula:
        lines[-1] += "$$"
    return with_tex("\n".join(lines)).replace("``", "`")


if __name__ == "__main__":
    main()
