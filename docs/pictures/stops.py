"""Draw docs/images/stops.svg and print the table of rebounds of docs/guide/stops.md: ``python docs/pictures/stops.py``."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import brentq

import lcpimpact as li
from lcpimpact import Element, Load, Mass, Problem, Scheme, Trajectory, simulate

IMAGES = Path(__file__).parents[1] / "images"

ENDS = ("x", "ground")
m, g, k, ζ = 1.0, 9.81, 1e5, 0.1
c = 2.0 * ζ * math.sqrt(k * m)
K = 1.25 * m / (m / k) ** 1.25  # the largest penetration without loss at 1 m/s is that of k


def struck(stop: Element, v0: float = 1.0, dt: float = 1e-4) -> Trajectory:
    """Return the run of a free mass that strikes a stop."""
    case = Problem("struck", Scheme(Mass("x", m), stop), v0={"x": v0})
    return simulate(case, "event-driven", dt=dt, t_end=0.04, rtol=1e-8, progress=False)


def restitution(stop: Element, v0: float = 1.0) -> float:
    """Return e."""
    return float(-struck(stop, v0).v[-1, 0] / v0)


def rebounds(stop: Element) -> int:
    """Return how often a ball that falls on a stop with 1 m/s leaves it."""
    ball = Problem("ball", Scheme(Mass("x", m), Load("x", m * g), stop), v0={"x": 1.0})
    run = simulate(ball, "event-driven", dt=0.05, t_end=2.0, rtol=1e-6, progress=False)
    assert run.events[-1].t < 1.8
    return sum(event.kind == "open" for event in run.events)


def stops() -> dict[str, Element]:
    """Return the linear stops of one k and c, and the others of the e of `KelvinVoigtStop` at 1 m/s."""
    linear = {
        "KelvinVoigtStop": li.KelvinVoigtStop(*ENDS, k=k, c=c),
        "ElastoGap": li.ElastoGap(*ENDS, k=k, c=c),
        "HardStop, damped": li.HardStop(*ENDS, k=k, c=c, rebound="damped"),
        "HardStop, undamped": li.HardStop(*ENDS, k=k, c=c, rebound="undamped"),
    }
    e = restitution(linear["KelvinVoigtStop"])
    sys.stdout.write(f"e = {e:.6f}, k = {k:g} N/m, c = {c:.6g} N s/m, K = {K:.6g} N/m^1.5\n")

    def impact(c: float) -> Element:
        return li.ImpactFunction(*ENDS, K=K, c=c, depth=1e-3, n=1.5)

    others = {
        "ImpactFunction": impact(brentq(lambda c: restitution(impact(c)) - e, 20.0, 150.0, xtol=1e-3)),
        "Tsuji": li.Tsuji(*ENDS, K=K, c=li.design("tsuji", m=m, v0=1.0, e=e, k=K).c),
        "KuwabaraKono": li.KuwabaraKono(*ENDS, K=K, A=li.design("kuwabara-kono", m=m, v0=1.0, e=e, k=K).A),
        "HuntCrossley": li.HuntCrossley(*ENDS, K=K, b=li.design("hunt-crossley", m=m, v0=1.0, e=e, k=K).b),
    }
    return linear | others


@li.style()
def main() -> None:
    """Draw the picture and print the table."""
    figure = Figure(figsize=(10.0, 3.8), layout="constrained")
    loops, speeds = figure.subplots(1, 2)
    v = np.geomspace(0.01, 10.0, 49)
    rows = []
    for i, (name, stop) in enumerate(stops().items()):
        run = struck(stop, dt=1e-5)
        e = [float(-run.v[-1, 0])] * len(v)
        if i > 3 and name != "Tsuji":
            e = [restitution(stop, each) for each in v]
        until = int(np.argmax(run["x"] < -1e-5)) or len(run.t)
        loops.plot(1e3 * run["x"][:until], run["F"][:until])
        speeds.semilogx(v, e, label=name)
        rows.append(
            (
                stop,
                f"| {name} | {restitution(stop, 0.1):.3f} | {restitution(stop):.3f} | {1e3 * run.events[-1].t:.2f} |",
            )
        )
    loops.set(xlabel="penetration [mm]", ylabel="force [N]", xlim=(0.0, None), title="a blow of 1 m/s")
    speeds.set(xlabel="speed of the blow [m/s]", ylabel="restitution", title="without weight")
    loops.axhline(0.0, color="0.6", lw=0.8)
    figure.legend(*speeds.get_legend_handles_labels(), loc="outside right center")
    figure.savefig(IMAGES / "stops.svg")
    for stop, row in rows:
        sys.stdout.write(f"{row} {rebounds(stop)} |\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
