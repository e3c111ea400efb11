"""The page docs/benchmarks/others.md, written from others.csv by `others.py`."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from io import StringIO
from typing import Any

import pandas as pd
from others_problems import CASES

NUMBERS = ("sup_q", "l1_v", "asked", "asked_error", "true", "scale", "ms")

GREEK = {"γ": r"$\gamma$", "ε": r"$\varepsilon$"}

CLOSE, ROUNDING = 1e-3, 1e-12
"""Errors of q over the greatest |q|: what counts as close to the truth, and what as rounding."""

HEAD = r"""# What others get

The same twelve problems by lcpimpact, by [Siconos](https://nonsmooth.gricad-pages.univ-grenoble-alpes.fr/siconos/), by
SciPy with events, by SciPy with stiff laws in place of contacts, and by others within reach of a Python user.

MADE
[others.csv](../../benchmarks/others.csv) has every number. A test compares this page with it.

## How it is measured

- All problems are [of the registry](../problems.md), with its default parameters. Each contestant has one file,
  `benchmarks/others_NAME.py`, and is written as its own documentation writes such problems.
- *default*: the time step or tolerance of its tutorial or of the package. *tuned*: a setting chosen for this accuracy.
  lcpimpact's default is `moreau-jean` with the step of Siconos' tutorial, or one like it; *accurate* is `exact`, or
  `radau-fesd` where `exact` is the truth.
- $q^*$, $v^*$ are the closed form. Systems 1 to 3 have none of the whole motion: there `exact` is the truth, and SciPy's
  tuned rows, which share no code with it, confirm it to 1e-9 m, and those of heyoka.py to 1e-14 m.
- The errors are $\sup_t \max_i |q_i - q_i^*|$ and $\int \max_i |v_i - v_i^*|\,dt$, the [L1 norm](../guide/norms.md), at
  the instants that each contestant gives, without those at which $v^*$ itself jumps. What a user asks for is read from
  the same instants, by a parabola or a line between them, so that sparse ones limit it: `exact` sampled every 5 ms finds
  the last millimetre of the ball no better than to 0.5 ms.
- *ms* is the CPU time of the whole, from the building of the model to the arrays of the result: the median of up to five
  runs, without imports. lcpimpact is compiled before (`LCPIMPACT_COMPILE=first`); the first run of a method in a new
  environment costs more ([benchmarks](index.md)). Siconos, Pymunk and MuJoCo are stepped from a Python loop that records,
  as in their tutorials. heyoka.py compiles an integrator in about a second when it is first made, and keeps it: its times
  are of later runs too. Each contestant ran by itself, and the machine was shared by others: times are good to a factor of
  two.

## Who takes part

- lcpimpact: [moreau-jean](../guide/method.md), [exact](../guide/exact.md) and
  [radau-fesd](../guide/integrators.md).
- Siconos: MoreauJeanOSI for bodies, EulerMoreauOSI for first-order systems and relays, as in BouncingBallTS,
  FrictionOscillator, Filippov and DiodeBridge of the [siconos-tutorials](https://github.com/siconos/siconos-tutorials).
- SciPy, events: `solve_ivp` with terminal events, modes and restarts by hand, after the cannon in
  [its documentation](https://docs.scipy.org/doc/scipy/reference/generated/scipy.integrate.solve_ivp.html).
- SciPy, penalty: `solve_ivp` with Kelvin-Voigt contacts, tanh friction and Shockley diodes ([penalty](../guide/penalty.md)).
- MuJoCo: its soft contacts, limits and friction losses, by the
  [solver parameters](https://mujoco.readthedocs.io/en/stable/modeling.html#solver-parameters) of its documentation.
- Pymunk: a 2-D engine of rigid bodies with impulses, after the example of
  [its documentation](https://www.pymunk.org/en/latest/overview.html).
- nosnoc: finite elements with switch detection for Filippov systems, solved by IPOPT, after simplest_example and
  periodic_stick_slip of [nosnoc_py](https://github.com/nosnoc/nosnoc_py). Its released package, 0.2.0, is the one that
  ran. Its main branch has impacts (complementarity Lagrangian systems by FESD-J) since August 2026
  ([#75](https://github.com/nosnoc/nosnoc_py/pull/75)); they will be here with the next release.
- [heyoka.py](https://github.com/bluescarni/heyoka.py): Taylor's method to the precision of doubles, compiled, with
  terminal events whose callbacks change the state or a mode, after its notebooks "Event detection" and "The wavy ramp".
- [PathSim](https://github.com/pathsim/pathsim): block diagrams with zero crossings, after its examples of the bouncing
  ball, of stick and slip, and of a diode.
- [solve-nivp](https://github.com/ERC-INJECT/solve_nivp): implicit steps with a projection for the nonsmooth law, after its
  notebooks on the bouncing ball and on dry friction.
- [Exudyn](https://github.com/jgerstmayr/EXUDYN): multibody dynamics with contacts of springs and dashpots whose switching
  reduces the step, and friction of bristles, after its test models contactCoordinateTest and coordinateSpringDamperExt.

Not here: PyBullet, Box2D and diffrax install from wheels but were not run; Assimulo has no wheel for this
Python; Drake and Chrono were not tried.

## Judged from outside

Problems and digits that others published (`benchmarks/others_published.py`, with their sources); a test compares these
figures with runs.

- The meshing gearbox of ARCH-COMP
  ([GRBX01](https://github.com/JuliaReach/ARCH2024_AFF_RE/blob/main/models/Gearbox/gearbox.jl), the centre of its initial
  box), a hybrid automaton whose reset maps are Newton's law at two oblique flanks. Its parabolas have roots in closed form:
  impacts at 0.0340244008, 0.0589193697 and 0.1078286103 s, meshed at 0.1492139668 s, accumulated impulse 16.8254667995 N s.
  `exact` has all of them to 1e-10; the specifications (0.2 s, 20 N s) hold there. With steps of 1 ms `rattle-ns` reports
  success and has not meshed at 0.15 s; with 0.1 ms it has.
- The bouncing ball of the [Reference FMUs](https://github.com/modelica/Reference-FMUs) (e = 0.7): the times of impact in its
  file are off the closed form, by 2e-06 s at the first and 3.3e-04 s at the eighth; `exact` has the closed form to 1e-12.
- The gradient across an elastic impact of two equal balls,
  [nimblephysics#97](https://github.com/keenon/nimblephysics/issues/97): $x_f = v_0 T + x_1 + 2 r$, so (1, 0, 1, 0) with
  respect to $x_1, x_2, v_0, u_0$, where Nimble gives (0.75, 0.25, 0.91, 0.08). Central differences of `exact` give it to
  1e-8. Those of `moreau-jean` with steps of 10 ms give (0, 1, 0.675, 0.325): differences of time steps mislead.

## To run it again

    pip install -e ".[peers]"
    apt-get install python3-siconos
    python benchmarks/others.py
    python benchmarks/others.py --only bouncing-ball

The first runs everything and writes the table and this page; the second prints one problem, or one contestant. What is
missing on a machine is a row with its reason.
"""


def read(text: str) -> tuple[str, pd.DataFrame]:
    """Return the first line of the CSV, and its table."""
    first, _, rest = text.partition("\n")
    return first, pd.read_csv(StringIO(rest), keep_default_na=False, na_values={name: [""] for name in NUMBERS})


def page(text: str) -> str:
    """Return the page of the documentation for the text of the CSV."""
    first, table = read(text)
    made = f"Made by `python benchmarks/others.py` on {first.removeprefix('# ').replace(': ', ' with ', 1)}."
    lines = [HEAD.replace("MADE", made), *overview(table)]
    lines += ["## What is seen", "", *(f"- {sentence}" for sentence in seen(table)), ""]
    for title in dict.fromkeys(table["problem"]):
        lines += section(title, table[table["problem"] == title])
    return re.sub("[γε]", lambda letter: GREEK[letter[0]], "\n".join(lines))


def overview(table: pd.DataFrame) -> list[str]:
    """Return the table of all problems: sup |q - q*| over max |q*|, default and best."""
    titles, contestants = (list(dict.fromkeys(table[name])) for name in ("problem", "contestant"))
    lines = [
        "## All problems",
        "",
        r"$\sup|q - q^*| / \sup|q^*|$ at the default setting, and the least of its rows; a dash: no row, or a failure.",
        "",
        "| problem | " + " | ".join(contestants) + " |",
        "|---|" + "---|" * len(contestants),
    ]
    for title in titles:
        cells = []
        for contestant in contestants:
            here = table[(table["problem"] == title) & (table["contestant"] == contestant)]
            relative = here["sup_q"] / here["scale"]
            default = relative[here["setting"] == "default"]
            said = number(default.iloc[0]) if len(default) else "-"
            cells.append("-" if here["setting"].eq("").all() else f"{said}, {number(relative.min())}")
        lines.append(f"| [{title}](#{title.replace(' ', '-')}) | " + " | ".join(cells) + " |")
    return [*lines, ""]


def section(title: str, table: pd.DataFrame) -> list[str]:
    """Return one problem: its rows, and who is closest and fastest."""
    case = CASES[title]
    asked, _, unit = case.asked.partition(", ")
    true, of = f"{case.value:.8g} {unit}".rstrip(), "" if case.unit == "-" else f", {case.unit}"
    lines = [
        f"## {title}",
        "",
        f"{case.what[0].upper()}{case.what[1:]}; {case.t_end:g} s. Asked for: {asked}, truly {true}.",
        "",
        f"| contestant | setting | how | sup q{of} | L1 of v, m | {case.asked} | its error | ms |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in table[table["setting"] != ""].itertuples():
        numbers = [number(row.sup_q), number(row.l1_v), number(row.asked, ".7g"), number(row.asked_error)]
        cells = [*numbers, number(row.ms, ".3g")] if not row.reason else [row.reason, "-", "-", "-", "-"]
        lines.append("| " + " | ".join([row.contestant, row.setting, row.how, *cells]) + " |")
    best, fastest = closest(table), fast(table)
    lines += [
        "",
        f"Closest: {' and '.join(best)}. Fastest with an error of q below {CLOSE:g} of the greatest: "
        f"{fastest['contestant']} ({fastest['how']}), {fastest['ms']:.3g} ms.",
        "",
    ]
    absent = table[table["setting"] == ""]
    lines += [f"- {row.contestant}: {row.reason}." for row in absent.itertuples()]
    return [*lines, *([""] if len(absent) else [])]


def closest(table: pd.DataFrame) -> list[str]:
    """Return the contestants with the least error of q, or all whose error is rounding."""
    least = max(table["sup_q"].min(), ROUNDING * float(table["scale"].max()))
    return list(dict.fromkeys(table.loc[table["sup_q"] <= least, "contestant"]))


def ahead(table: pd.DataFrame) -> list[str]:
    """Return the contestants whose default has a smaller error of q than that of lcpimpact, the closest first."""
    defaults = table[table["setting"] == "default"].set_index("contestant")["sup_q"]
    return list(defaults[defaults < 0.99 * defaults.get("lcpimpact", 0.0)].sort_values().index)


def fast(table: pd.DataFrame) -> pd.Series:
    """Return the fastest row among those that are close."""
    close = table[table["sup_q"] < CLOSE * table["scale"]]
    return close.loc[close["ms"].idxmin()]


def number(value: float, form: str = ".1e") -> str:
    """Return a number as the page shows it, with a hyphen in its exponent at which no line is broken."""
    return "-" if math.isnan(value) else format(value, form).replace("e-", "e\N{NON-BREAKING HYPHEN}")


def seen(table: pd.DataFrame) -> Iterator[str]:
    """Yield what the rows show; a sentence whose rows are missing is left out."""
    rows: dict[tuple[str, ...], Any] = {(row.problem, row.contestant, row.setting): row for row in table.itertuples()}
    for keys, sentence in SEEN:
        found = [rows.get(key) for key in keys]
        if all(row is not None for row in found):
            yield sentence.format(*found)
    titles = list(dict.fromkeys(table["problem"]))
    groups = {title: table[table["problem"] == title] for title in titles}
    closer = [
        f"{title} ({', '.join(closest(here))})" for title, here in groups.items() if "lcpimpact" not in closest(here)
    ]
    faster = [
        f"{title} ({fast(here)['contestant']})"
        for title, here in groups.items()
        if fast(here)["contestant"] != "lcpimpact"
    ]
    nearer = [f"{title} ({', '.join(names)})" for title, here in groups.items() if (names := ahead(here))]
    yield f"At their defaults, others are closer than lcpimpact at its own (moreau-jean) on: {'; '.join(nearer) or 'none'}."
    yield (
        f"Others are closer than every row of lcpimpact on: {', '.join(closer) or 'none of these problems'}. "
        "(Systems 1 to 3 are measured against its own `exact`.)"
    )
    yield f"Others are the fastest within {CLOSE:g} on: {', '.join(faster) or 'none of these problems'}."


SEEN: list[tuple[list[tuple[str, str, str]], str]] = [
    (
        [
            ("bouncing-ball", "lcpimpact", "default"),
            ("bouncing-ball", "Siconos", "default"),
            ("bouncing-ball", "lcpimpact", "tuned"),
            ("bouncing-ball", "Siconos", "tuned"),
            ("newtons-cradle", "lcpimpact", "tuned"),
            ("newtons-cradle", "Siconos", "tuned"),
        ],
        "moreau-jean and Siconos' MoreauJeanOSI are one scheme: with the same step their errors on the ball are "
        "{0.sup_q:.5g} and {1.sup_q:.5g} m, of order one across impacts, for {0.ms:.2g} and {1.ms:.2g} ms; with a "
        "fiftieth of it {2.sup_q:.3g} and {3.sup_q:.3g} m for {2.ms:.2g} and {3.ms:.3g} ms. On the cradle "
        "they differ: {4.sup_q:.1e} and {5.sup_q:.1e} m.",
    ),
    (
        [
            ("system-1", "Siconos", "default"),
            ("system-1", "Siconos", "γ = 1/2"),
            ("system-1", "lcpimpact", "default"),
        ],
        "Siconos' EulerMoreauOSI weights the multiplier by $\\gamma$, which is the user's choice. System 1 has $D = 0$: "
        "with its default, $\\gamma = 1$, the error is {0.sup_q:.2e} m, that of moreau-jean ({2.sup_q:.2e} m). With "
        "$\\gamma = 1/2$ the motion remains right ({1.sup_q:.1e} m), but the force rings: its peak is {1.asked:.0f} N in "
        "place of {1.true:.0f} N.",
    ),
    (
        [
            ("system-2", "Siconos", "default"),
            ("system-2", "lcpimpact", "default"),
            ("system-2", "Siconos", "tuned"),
            ("diode-bridge", "Siconos", "default"),
            ("diode-bridge", "lcpimpact", "default"),
            ("diode-bridge", "Siconos", "tuned"),
        ],
        "With $D \\neq 0$ it is the other way round: on System 2 and the diode bridge $\\gamma = 1$ leaves {0.sup_q:.1e} m "
        "and {3.sup_q:.1e} V, where moreau-jean, which chooses by the relative degree, leaves {1.sup_q:.1e} m and "
        "{4.sup_q:.1e} V with the same steps. Siconos with $\\gamma = 1/2$ and a smaller step gets System 2 to "
        "{2.sup_q:.1e} m and the bridge to {5.sup_q:.1e} V.",
    ),
    (
        [
            ("bouncing-ball to rest", "SciPy, events", "default"),
            ("bouncing-ball to rest", "SciPy, events", "tuned"),
            ("bouncing-ball to rest", "lcpimpact", "accurate"),
        ],
        "`solve_ivp` with events does not get the ball to rest: {0.reason}. The first step from the floor has "
        "become longer than the flight, and the event is found at its start. It needs a rule for rest by hand, "
        "which leaves {1.sup_q:.1e} m. `exact` gets past the accumulation point ({2.sup_q:.1e} m), and a "
        "time step does so unaware.",
    ),
    (
        [
            ("bouncing-ball", "SciPy, events", "default"),
            ("system-1", "SciPy, events", "default"),
            ("system-1", "SciPy, events", "tuned"),
        ],
        "Where the modes are few and known, events by hand are excellent: {0.sup_q:.0e} m on the ball at default "
        "tolerances, since Runge-Kutta steps are exact on parabolas; {1.sup_q:.1e} m on System 1, and "
        "{2.sup_q:.1e} m tuned. What they cost is the derivation of modes, events and jumps, anew for each "
        "problem.",
    ),
    (
        [
            ("bouncing-ball", "SciPy, penalty", "default"),
            ("bouncing-ball", "SciPy, penalty", "tuned"),
        ],
        "A stiff spring in place of a contact delays every rebound by about $\\pi\\sqrt{{m/k}}$, and a body at rest "
        "sinks in by $m g/k$, 1 mm at $10^4$ N/m: {0.sup_q:.1e} m on the ball, and {1.sup_q:.1e} m at $10^8$ N/m with "
        "the exact damping.",
    ),
    (
        [
            ("block-on-incline", "SciPy, penalty", "default"),
            ("block-on-incline", "SciPy, penalty", "tuned"),
        ],
        "Friction as $\\tanh(v/\\varepsilon)$ lets the block on the incline creep for ever at "
        "$\\varepsilon \\operatorname{{artanh}}(\\tan\\alpha/\\mu)$: it is {0.asked_error:.1e} m off after 2.8 s with "
        "$\\varepsilon = 0.01$ m/s, {1.asked_error:.1e} m with $10^{{-6}}$ m/s.",
    ),
    (
        [
            ("diode-bridge", "SciPy, penalty", "default"),
            ("diode-bridge", "SciPy, penalty", "tuned"),
        ],
        "Shockley's diodes are not the ideal ones: the drop of two of them is {0.sup_q:.2f} V of 10 V. That is a "
        "difference of models, not an error of the integrator; at a hundredth of the thermal voltage it is "
        "{1.sup_q:.1e} V.",
    ),
    (
        [
            ("bouncing-ball", "MuJoCo", "default"),
            ("bouncing-ball", "MuJoCo", "tuned"),
            ("block-on-incline", "MuJoCo", "default"),
        ],
        "MuJoCo has no coefficient of restitution; a damping chosen for it gives {0.asked:.4f} m for the third "
        "rebound of {0.true:.4f} m, tuned {1.asked:.4f} m. Its block on the incline stops within "
        "{2.asked_error:.1e} m of the right place, but hops on its way there (L1 of v {2.l1_v:.1e} m).",
    ),
    (
        [
            ("bouncing-ball", "Pymunk", "tuned"),
            ("bouncing-ball", "Siconos", "tuned"),
            ("pi-billiard", "Pymunk", "default"),
        ],
        "Pymunk applies impulses with a coefficient of restitution, and with small steps it is as good as the "
        "nonsmooth schemes: {0.sup_q:.1e} m on the ball, where Siconos has {1.sup_q:.1e} m with the same step. The "
        "step of its example is too long for the pi-billiard: the heavy ball ends at {2.asked:.3f} m/s in place of "
        "{2.true:.3f}.",
    ),
    (
        [
            ("filippov", "nosnoc", "tuned"),
            ("filippov", "lcpimpact", "accurate"),
            ("coulomb-oscillator", "nosnoc", "tuned"),
        ],
        "nosnoc finds switches inside its finite elements as radau-fesd does, and is accurate: {0.sup_q:.1e} on "
        "the relay, {2.sup_q:.1e} m on the oscillator with friction. Each step is an optimisation problem for "
        "IPOPT: {0.ms:.0f} ms, where `exact` takes {1.ms:.2g} ms. It is made for optimal control, which lcpimpact "
        "does not do.",
    ),
    (
        [
            ("system-1", "heyoka.py", "default"),
            ("system-1", "lcpimpact", "accurate"),
            ("pi-billiard", "heyoka.py", "default"),
            ("pi-billiard", "lcpimpact", "default"),
            ("bouncing-ball to rest", "heyoka.py", "default"),
            ("bouncing-ball to rest", "heyoka.py", "tuned"),
        ],
        "heyoka.py, with modes and jumps derived by hand, is as accurate as `exact`, at its default: {0.sup_q:.1e} m on "
        "System 1 in {0.ms:.2g} ms (radau-fesd: {1.sup_q:.1e} m in {1.ms:.2g} ms), and {2.sup_q:.1e} m on the billiard, "
        "where moreau-jean at its default is {3.sup_q:.1e} m off. Its equations need not be linear. The ball to rest "
        "falls through the floor without a word after the impacts accumulate ({4.sup_q:.1e} m); with a rule for rest it "
        "is {5.sup_q:.1e} m off.",
    ),
    (
        [
            ("bouncing-ball", "PathSim", "default"),
            ("bouncing-ball", "PathSim", "tuned"),
            ("bouncing-ball", "lcpimpact", "default"),
            ("impact-oscillator", "PathSim", "default"),
            ("impact-oscillator", "lcpimpact", "default"),
        ],
        "PathSim locates events to a tolerance: at that of its example it is {0.sup_q:.1e} m off on the ball in "
        "{0.ms:.2g} ms, and {1.sup_q:.1e} m with a tight one in {1.ms:.3g} ms. Its default is better than that of "
        "lcpimpact, there ({2.sup_q:.1e} m) and on the impact oscillator ({3.sup_q:.1e} and {4.sup_q:.1e} m), and "
        "slower.",
    ),
    (
        [
            ("bouncing-ball", "solve-nivp", "default"),
            ("bouncing-ball", "solve-nivp", "tuned"),
            ("bouncing-ball", "lcpimpact", "default"),
        ],
        "solve-nivp shortens its steps at impacts, so that its default beats that of lcpimpact on the ball "
        "({0.sup_q:.1e} and {2.sup_q:.1e} m; tuned {1.sup_q:.1e} m), and pays for it with its iteration in Python: "
        "{0.ms:.0f} ms.",
    ),
    (
        [
            ("bouncing-ball", "Exudyn", "default"),
            ("bouncing-ball", "Exudyn", "tuned"),
            ("block-on-incline", "Exudyn", "tuned"),
            ("system-1", "Exudyn", "tuned"),
        ],
        "Exudyn takes massless plates as it takes bodies, with accelerations at the start by hand ({3.sup_q:.1e} m on "
        "System 1, tuned), and takes small steps fast: {1.ms:.0f} ms for 125,000 on the ball. Its stiff contacts delay "
        "each rebound: {0.sup_q:.1e} m on the ball, {1.sup_q:.1e} m tuned. Its bristles hold the block on the incline to "
        "{2.sup_q:.1e} m.",
    ),
]
"""The rows whose numbers a sentence tells, and the sentence."""
