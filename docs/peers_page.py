"""Write docs/guide/peers.md: the examples of Siconos, nosnoc and cardillo, and what of each can be written here.

Run it as ``python docs/peers_page.py`` after docs/peers.csv or benchmarks/siconos_tutorials.csv has changed.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd

HERE = Path(__file__).parent
PAGE = HERE / "guide" / "peers.md"
EXAMPLES = HERE / "peers.csv"
MEASURED = HERE.parent / "benchmarks" / "siconos_tutorials.csv"

HEAD = """\
# Examples of Siconos, nosnoc and cardillo

Who comes from another program finds its examples here: what of each can be written here, and as what. *Yes* means
that the system and its laws can be written, *partly* that something of it is missing or another step takes its place,
*no* that it cannot be. A problem that is named is the same system, with the example's numbers or with others as the
row says; where there is none, the elements are named. Rows without "measured" were judged
by the name and the description of the example, of some twenty by its file.

The table is `docs/peers.csv`, and the page is written by `docs/peers_page.py`.
"""

VERSIONS = {
    "Siconos": """\
The examples are those of siconos-tutorials at b6c9bfd194 (July 2024), the newest that could be had. Siconos 4.5.0 is
out, as source; what is measured below is Debian's package, 4.4.0, and 4.5.0 was not run. Variants of a formulation or of
a language share a row.
""",
    "nosnoc": """\
The MATLAB examples at 0abef40107 (after 0.9.0, August 2026). MATLAB is not installed, and what the Python package nosnoc
0.2.0 runs stands in [what others get](../benchmarks/others.md): nothing is run for this table.
""",
    "cardillo": """\
The examples at 451d581dff (February 2026). It is not packaged, and nothing is run.
""",
}

MEASURES = """\
## On the same steps

`python benchmarks/siconos_tutorials.py` runs tutorials of Siconos by its `MoreauJeanOSI` and `EulerMoreauOSI`, and
the same systems by `moreau-jean` with the same $\\theta$ and steps. The difference and the errors are the largest of
$q$ or $x$ over the run, in its unit; the errors are against `exact`, for the ball that turns against `event-driven`.
Times are CPU times of a run: Siconos from the building of the model on, here of `simulate`, *fresh* in a new process
without compiled code in its cache.
"""

REMARKS = """\
- The two are the same steps, to rounding, in all but `CircuitRLCD` and `DiodeBridge`: there the law acts on the force
  itself, and `moreau-jean` imposes it at $t_\\theta$, where Siconos with $\\gamma = \\tfrac12$ does so for the force
  and not for the relation. The bridge gains a factor of eight in accuracy by it, the circuit nothing.
- Fresh, a short tutorial is slower here, for its code is compiled first; warm, it is faster, but for the ball that
  turns: a `Lagrangian` system of 2,000 steps runs in the interpreter, at 0.13 ms a step.
- `Filippov` winds around the origin in ever shorter turns, and `exact` stops at its largest number of events: no
  error is known.
- `ImpactingBar` has 40 of its 500 degrees of freedom, `ColpittsOscillator` a fifth of its time, and balls none of the
  coordinates that do not move.
"""


def page() -> str:
    """Return the text of the page."""
    examples = pd.read_csv(EXAMPLES, keep_default_na=False)
    counts = examples.groupby("peer", sort=False)["fits"].value_counts().unstack(fill_value=0)
    parts = [HEAD, "| program | examples | yes | partly | no |\n|---|---|---|---|---|"]
    parts[-1] += "".join(
        f"\n| {peer} | {row.sum()} | {row['yes']} | {row['partly']} | {row['no']} |" for peer, row in counts.iterrows()
    )
    parts[-1] += "\n"
    for peer, rows in examples.groupby("peer", sort=False):
        parts += [f"## {peer}\n", VERSIONS[str(peer)], table(rows)]
        if peer == "Siconos":
            parts += [MEASURES, measured(), REMARKS]
    return "\n".join(parts)


def table(rows: pd.DataFrame) -> str:
    """Return the examples of a program."""
    lines = ["| example | here | as |", "|---|---|---|"]
    for row in rows.itertuples():
        problems = ", ".join(f"[`{name}`](../problems.md#{name})" for name in row.problems.split())
        example, what = row.example.replace("_", "\\_"), "; ".join(filter(None, (problems, row.how)))
        lines.append(f"| {example} | {row.fits} | {what} |")
    return "\n".join(lines) + "\n"


def measured() -> str:
    """Return the tutorials that were run."""
    head = [
        "tutorial",
        "steps",
        "difference",
        "error, Siconos",
        "error, here",
        "Siconos in ms",
        "warm in ms",
        "fresh in ms",
    ]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for row in pd.read_csv(MEASURED).itertuples():
        numbers = (row.difference, row.error_siconos, row.error)
        errors = ["-" if pd.isna(each) else f"{each:.1e}" for each in numbers]
        times = [f"{each:.3g}" for each in (row.ms_siconos, row.ms, row.ms_fresh)]
        lines.append(f"| `{row.tutorial}` | {row.steps} | {' | '.join(errors + times)} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
