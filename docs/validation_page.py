"""Write docs/guide/validate.md: published numbers beside ours, and the derivation of each that is refuted.

Run it as ``python docs/validation_page.py`` after a suite or a method has changed.
"""

from __future__ import annotations

from pathlib import Path

from tex import with_tex

from lcpimpact import Validation, simulate, validate
from lcpimpact.study.result import cell
from lcpimpact.validation.arch import accumulated, by_reset_maps, gearbox, meshed_at
from lcpimpact.validation.suites import SUITES

PAGE = Path(__file__).parent / "guide" / "validate.md"

HEAD = """\
# Published numbers

`lcpimpact validate` runs cases that others published, and prints their numbers beside ours. A number is

- *met* if each of our methods is within the tolerance that its source sets;
- *refuted* if a closed form, or two methods of ours that agree, have other digits, and a derivation says why;
- *not met* otherwise, and then the exit code is 1.

What a source does not give is listed as not found. In Python the same is `validate("code-aster").table`, and
`lcpimpact validate code-aster --report validation.html` writes it as a page. This one is written by
`docs/validation_page.py`.
"""


def page(found: Validation) -> str:
    """Return the text of the page."""
    parts = [HEAD, ". ".join(found.head()) + ".\n"]
    for name, rows in found.table.groupby("suite", sort=False):
        told, missing = (rows[(rows["verdict"] == "not found") == absent] for absent in (False, True))
        methods = [each for each in found.methods if told[each].notna().any()]
        shown = ["case", "quantity", "published", "tolerance", *methods, "truth", "verdict"]
        parts += [f"## {SUITES[str(name)].title}\n", f"`lcpimpact validate {name}`\n", table(told[shown])]
        refuted = told[told["verdict"] == "refuted"]
        for (case, why), quantities in refuted.groupby(["case", "why"], sort=False)["quantity"]:
            parts.append(f"**Refuted: {case}**, {'; '.join(map(coded, quantities))}. {with_tex(why)}\n")
        if name == "arch":
            parts.append(lesson())
        parts += [
            f"**Not found: {each.case}**, {coded(each.quantity)}: {with_tex(each.why)}.\n"
            for each in missing.itertuples()
        ]
        sources = "".join(
            f"- {case}: {source}\n" for case, source in dict(zip(rows["case"], rows["source"], strict=True)).items()
        )
        parts.append(f"Sources:\n\n{sources}")
    return "\n".join(parts)


def table(rows) -> str:
    """Return a table in Markdown."""
    lines = ["| " + " | ".join(map(str, rows.columns)) + " |", "|" + "---|" * len(rows.columns)]
    lines += [
        "| " + " | ".join(coded(cell(each, ".10g")) for each in row) + " |" for row in rows.itertuples(index=False)
    ]
    return "\n".join(lines) + "\n"


def coded(words: str) -> str:
    """Return the name of a quantity, as code where it is a formula."""
    return f"`{words}`" if not words.isascii() or "(" in words else words


def lesson(start: tuple[float, float, float] = (-0.0167, 0.003, 3.2)) -> str:
    """Return what `rattle-ns` makes of the gearbox in steps of 1 ms."""
    run = simulate(gearbox(*start), "rattle-ns", dt=1e-3, error=False)
    t, impulse = by_reset_maps(*start)
    return (
        f"**Solved is not right.** From the centre, `rattle-ns` in steps of 1 ms ends with the status {run.status.name}, "
        f"and strikes the teeth once too often: it meshes at {meshed_at(run):.4f} s with "
        f"{accumulated(run, start[2]):.2f} N s, and not at {t:.4f} s with {impulse:.2f} N s. The status says that the laws "
        "hold in each step, and nothing of the length of the steps; in steps of 0.1 ms the impacts are the right ones.\n"
    )


if __name__ == "__main__":
    PAGE.write_text(page(validate()), encoding="utf-8")
