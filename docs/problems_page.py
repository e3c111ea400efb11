"""Write docs/problems.md: every registered problem with its text, its numbers, its scheme and a run of it.

Run it as ``python docs/problems_page.py`` after a problem or a drawing has changed, or with names of problems to redraw
these only; the text is always written for all. A test compares the text with what this would write.
"""

from __future__ import annotations

import inspect
import io
import re
import sys
from pathlib import Path

from matplotlib.figure import Figure
from PIL import Image
from tex import tex, with_tex

from lcpimpact import UnsupportedError, load_problem, simulate
from lcpimpact.bibliography import cited
from lcpimpact.plotting.animation import common_palette
from lcpimpact.plotting.schematic import draw_scheme
from lcpimpact.plotting.style import style
from lcpimpact.problems import PROBLEMS
from lcpimpact.scheme.lagrangian import Lagrangian
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.stated import stated

PAGE = Path(__file__).parent / "problems.md"
IMAGES = Path(__file__).parent / "images" / "problems"

STEPS = {
    "bar-impact": 900,
    "bouncing-bar": 2750,
    "plastic-bar-impact": 160,
}
"""Steps of some runs by moreau-jean: of bars those for which their mass was chosen."""

FINE = 2000
"""Steps of every other run."""

DPI = 110
COLORS = 64


def main(names: list[str]) -> None:
    """Write the page, and the pictures of the problems that are named, or of all."""
    IMAGES.mkdir(parents=True, exist_ok=True)
    for name in names or list(PROBLEMS):
        problem = load_problem(name)
        if not isinstance(problem.scheme, Lagrangian):
            with style():
                write(draw_scheme(problem.scheme), IMAGES / f"{name}-scheme.png")
        write(run(name).plot(), IMAGES / f"{name}-run.png")
    PAGE.write_text(page(), encoding="utf-8")


def run(name: str):
    """Return a run of a problem: exact where it can be."""
    problem = load_problem(name)
    if name in STEPS:
        return simulate(problem, "moreau-jean", dt=problem.t_end / STEPS[name], t_end=problem.t_end)
    try:
        return simulate(problem, "exact", dt=problem.t_end / FINE, t_end=problem.t_end)
    except UnsupportedError:
        return simulate(problem, "moreau-jean", dt=problem.t_end / FINE, t_end=problem.t_end)


def write(figure: Figure, path: Path) -> None:
    """Write a figure with few colours, which makes a small file."""
    data = io.BytesIO()
    with style():
        figure.savefig(data, format="png", dpi=DPI, metadata={"Software": None})
    picture = Image.open(data).convert("RGB")
    picture = picture.quantize(palette=common_palette([picture], COLORS), dither=Image.Dither.NONE)
    picture.save(path, format="PNG", optimize=True)


def page() -> str:
    """Return the text of the page."""
    names = list(PROBLEMS)
    head = [
        "# The problems",
        "",
        "Every registered problem, with what is known of it in closed form. Coordinates of schemes are positive downwards.",
        "Load one by `load_problem(name, **parameters)`, or run it by `lcpimpact simulate NAME`; draw it by",
        "`lcpimpact draw NAME`, and set it in motion by `lcpimpact animate NAME --out NAME.gif`. This page is written by",
        "`docs/problems_page.py`.",
        "",
        *(f"- [{name}](#{name}): {_plain(_summary(name))}" for name in names),
        "",
    ]
    return "\n".join(head) + "\n" + "\n".join(section(name) for name in names)


def section(name: str) -> str:
    """Return the text of one problem."""
    problem = load_problem(name)
    doc = inspect.getdoc(PROBLEMS[name]) or ""
    text = re.split(r"\n(?=\w[\w ]*\n-{3,}\n)", doc)[0]
    drawing = "The scheme" if isinstance(problem.scheme, Scheme) else "The system"
    drawn = [f"![{drawing} of {name}](images/problems/{name}-scheme.png)", ""]
    if isinstance(problem.scheme, Lagrangian):
        drawn = [
            "A Lagrangian system, given by functions; its coordinates are positive upwards and counterclockwise.",
            "",
        ]
    lines = [
        f"## {name}",
        "",
        _plain(text),
        "",
        *drawn,
        f"![A run of {name}](images/problems/{name}-run.png)",
        "",
        "| parameter | value | meaning |",
        "|---|---|---|",
        *(_row(*each) for each in parameters(name)),
        "",
    ]
    if problem.facts:
        lines += ["| known in closed form | | value |", "|---|---|---|"]
        lines += [
            _row(_symbol(fact.symbol), with_tex(fact.what), f"{fact.value:.10g} {fact.unit}") for fact in problem.facts
        ]
        lines.append("")
    if problem.motion is not None:
        lines += ["The whole motion is known in closed form: `load_problem(...).motion(t)` returns $q$ and $v$.", ""]
    lines += [f"Source: {cited(problem.source, '{{cite:t}}`{}`'.format)}.", ""]
    return "\n".join(lines)


def parameters(name: str) -> list[tuple[str, str, str]]:
    """Return for each parameter of a problem its name, its value with the unit, and what it is."""
    values = load_problem(name).parameters
    return [
        (symbol, f"{values[symbol]:.6g} {each.unit}", _plain(each.sentence))
        for symbol, each in stated(PROBLEMS[name]).items()
    ]


def _summary(name: str) -> str:
    return (inspect.getdoc(PROBLEMS[name]) or "").split("\n\n")[0].replace("\n", " ")


def _symbol(symbol: str) -> str:
    """Return the symbol of a fact as a formula, or as it is."""
    try:
        return f"${tex(symbol)}$"
    except ValueError:
        return symbol


def _plain(text: str) -> str:
    """Return a docstring's text as Markdown; a name of another problem's builder becomes its link."""
    links = {name.replace("-", "_"): f"[{name}](#{name})" for name in PROBLEMS}
    text = re.sub(r"``([^`]+)``", "\0\\1\0", with_tex(text.strip()))
    return re.sub(r"`(\w+)`", lambda match: links.get(match[1], match[0]), text).replace("\0", "`")


def _row(*cells: str) -> str:
    """Return a row of a table, where a bar would end a cell."""
    return "| " + " | ".join(cell.strip().replace("|", "\\|") for cell in cells) + " |"


if __name__ == "__main__":
    main(sys.argv[1:])
