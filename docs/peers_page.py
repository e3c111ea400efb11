"""Write docs/guide/peers.md: the examples of Siconos, nosnoc and cardillo, and what of each can be written here.

Run it as ``python docs/peers_page.py`` after docs/peers.csv or benchmarks/peers_examples.csv has changed.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd

HERE = Path(__file__).parent
PAGE = HERE / "guide" / "peers.md"
EXAMPLES = HERE / "peers.csv"
MEASURED = HERE.parent / "benchmarks" / "peers_examples.csv"

HEAD = """\
# Examples of Siconos, nosnoc and cardillo

Who comes from another program finds its examples here: what of each can be written here, and as what. *Yes* means
that the system and its laws can be written, *partly* that something of it is missing or another step takes its place,
*no* that it cannot be. A problem that is named is the same system, with the example's numbers or with others as the
row says; where there is none, the elements are named. Rows that are not *measured* were judged
by the name and the description of the example, of some twenty by its file.

The table is `docs/peers.csv`, and the page is written by `docs/peers_page.py`.
"""

MEASURES = """\
## What is measured

    python benchmarks/peers_examples.py [--python PYTHON] [--out FILE.csv]

runs examples by the program that they are from and the same systems here. The difference of the two and their errors are
the largest of $q$ or $x$ over the instants of the steps, in its unit, each coordinate alike; the errors are against
`exact`, and against `event-driven` at a relative tolerance of $10^{-12}$ (DOP853) where `exact` does not apply; a
remark says where they are against another. Times are CPU times of a run in ms: the other program from the building of
the model on, here of `simulate`, *fresh* in a new process without compiled code in its cache, and *warm* after that. Two
cores were shared with other work: times are good to a factor of two.
"""

VERSIONS = {
    "Siconos": """\
The examples are those of siconos-tutorials at b6c9bfd194 (July 2024), the newest that could be had. What is measured is
Siconos 4.4.0 as Debian packages it, and 4.5.0 (a copy of its repository of August 2026, built from source, as no package
registry has it): its Python modules have neither integration by events nor offsets and inputs of first-order systems.
Variants of a formulation or of a language share a row.
""",
    "nosnoc": """\
The MATLAB examples at 0abef40107 (after 0.9.0, August 2026). MATLAB is not installed: the examples are run by the Python
package nosnoc 0.2.0 with CasADi and IPOPT. It has Filippov systems, and neither impacts nor projected systems
nor time freezing: the other examples that can be written here are not measured.
""",
    "cardillo": """\
The examples at 451d581dff (February 2026). cardillo 1.0.0 is in no package registry; it was installed from a copy of its
repository by `pip install .`.
""",
}

NEWER = {"Siconos": "Siconos 4.5"}

REMARKS = {
    "Siconos": """\
By `MoreauJeanOSI` and `EulerMoreauOSI`, and here by `moreau-jean` with the same $\\theta$ and steps; the three with ED
in their names by `EventDriven` with LSODAR, and here by `event-driven`.

- Siconos 4.5.0 takes the steps of 4.4.0, to 2e-11, in the time that stands beside that of 4.4.0.
- Both programs take the same steps, to rounding, but for the following.
- In circuits whose law acts on the force itself $\\gamma$ is a choice: `moreau-jean` imposes the law at $t_\\theta$. So does
  Siconos where $\\gamma = \\theta$ is said for the relation too (`-ThetaGammaSchemes`), and both agree; elsewhere it does so
  for the force at most.
- From a start that breaks the laws `moreau-jean` takes the jump first; with $\\theta = \\tfrac12$ Siconos keeps the charge
  of the filter wrong (`DiodeBridgeCapFilter-ThetaGammaSchemes`).
- `DiodeBridgePowSup` is where Siconos is better, 390 times in the largest error: in the step in which a diode begins to
  conduct `moreau-jean` is late by up to a step, 0.05 V at one instant, and in the next it is exact; its mean error is
  6e-5 V.
- Warm, the runs here are faster but for those by events and the ball that turns, a `Lagrangian` system, whose steps are
  taken in the interpreter; fresh most are slower, for their code is compiled first.
- Where a motion winds or cycles the largest error is one of phase: `Filippov`, `helical`, the oscillators with a relay.
- The plane of `BallOnMovingPlane` is integrated by Siconos, and known here.
- `PRC` starts where `exact` cannot choose a mode: its errors are against `radau`, which is good to 0.006.
- Parts: `ImpactingBar` has 40 of its 500 degrees of freedom, `ImpactingEBBeam` 10 of its 100 elements;
  `ColpittsOscillator` runs to a fifth of its end, `helical` to half, `Filippov` to 1.8 of 10 s, before it has wound into
  the origin in ever shorter turns, and `LinearOscillatorED` to 0.33 of 8.5 s, where Siconos throws an exception without a
  text. The sleeve of `WoodPecker` starts on the pole, not 0.9 µm inside of it. Balls have none of the coordinates that do
  not move.
- Not from Python: `D1MinusLinearOSI` and `SchatzmanPaoliOSI` are not in its modules, and relations that are not linear
  need functions in C, as those of `ImpactingStick`, `Pendulum` and `RockingBlock` do.
""",
    "nosnoc": """\
By finite elements with switch detection and two stages of Radau IIA, as many in a step by both, nosnoc to a tolerance of
$10^{-9}$; here by `radau-fesd` with its relative tolerance off, and `periodic_slip_stick`, whose forces are not linear, by
`event-driven` at $10^{-6}$. The MATLAB examples of `crossing`, `sliding` and `leaving` have two stages of Gauss and
Legendre; `relay_feedback_system` runs to 2 of its 10 s.
""",
    "cardillo": """\
`bouncing_ball`, `woodpecker_toy` and `friction_belt` by Moreau's midpoint rule with its fixed-point iteration to
$10^{-12}$, the others by SciPy's RK45 at a relative tolerance of $10^{-8}$ and by scipy_dae's Radau IIA at $10^{-3}$, their
defaults, which the runs here have too. The steps of `moreau-midpoint` are those of cardillo, to rounding. `friction_belt`
has a force that depends on the velocity, which cardillo takes at the start of the step, and `moreau-jean` implicitly.

Not measured: `elastic_chain_pendulum` has springs of $10^8$ N/m and a step of $10^{-2}$ s; `moreau-jean` runs half a second
of it and then refuses the result, for its steps miss 26 N s of the impulse of the forces, where 8.8 N s are allowed.
""",
}


def page() -> str:
    """Return the text of the page."""
    examples = pd.read_csv(EXAMPLES, keep_default_na=False)
    counts = examples.groupby("peer", sort=False)["fits"].value_counts().unstack(fill_value=0)
    parts = [HEAD, "| program | examples | yes | partly | no |\n|---|---|---|---|---|"]
    parts[-1] += "".join(
        f"\n| {peer} | {row.sum()} | {row['yes']} | {row['partly']} | {row['no']} |" for peer, row in counts.iterrows()
    )
    parts[-1] += "\n"
    parts.append(MEASURES)
    for peer, rows in examples.groupby("peer", sort=False):
        of = str(peer)
        parts += [f"## {of}\n", VERSIONS[of], table(rows), f"### {of} on the same steps\n", measured(of), REMARKS[of]]
    return "\n".join(parts)


def table(rows: pd.DataFrame) -> str:
    """Return the examples of a program."""
    lines = ["| example | here | as |", "|---|---|---|"]
    for row in rows.itertuples():
        problems = ", ".join(f"[`{name}`](../problems.md#{name})" for name in row.problems.split())
        example, told = row.example.replace("_", "\\_"), "measured below" if row.measured else ""
        lines.append(f"| {example} | {row.fits} | {'; '.join(filter(None, (problems, row.how, told)))} |")
    return "\n".join(lines) + "\n"


def measured(peer: str) -> str:
    """Return the examples of a program that were run, with the times of a newer version where there is one."""
    table = pd.read_csv(MEASURED)
    newer = table[table["peer"] == NEWER.get(peer)].set_index("example")["ms_theirs"]
    errors = ("difference", f"error, {peer}", "error, here")
    times = (f"{peer}, ms", *(["4.5.0, ms"] if len(newer) else []), "warm, ms", "fresh, ms")
    head = ["example", "by", "steps", *errors, *times]
    lines = ["| " + " | ".join(head) + " |", "|---|---|" + "---:|" * (len(head) - 2)]
    for row in table[table["peer"] == peer].itertuples():
        sizes = [number(each, ".1e") for each in (row.difference, row.error_theirs, row.error)]
        spent = [row.ms_theirs, *([newer.get(row.example)] if len(newer) else []), row.ms, row.ms_fresh]
        cells = sizes + [number(each, ".0f" if each is not None and each >= 100.0 else ".3g") for each in spent]
        lines.append(f"| `{row.example}` | `{row.method}` | {row.steps} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def number(value: float | None, form: str) -> str:
    """Return a number, or a dash where there is none."""
    return "-" if value is None or pd.isna(value) else f"{value:{form}}"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
