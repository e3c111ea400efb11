"""Draw the pictures of docs/guide/dynamics.md: ``python docs/pictures/dynamics.py``, or with the names of some of them.

It takes about four minutes on one core.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from lcpimpact import (
    Bumper,
    Harmonic,
    KelvinVoigt,
    Load,
    Mass,
    Problem,
    Scheme,
    Spring,
    basins,
    bifurcation,
    bifurcation_curve,
    continue_orbit,
    grazing,
    load_problem,
    periodic_orbit,
)

IMAGES = Path(__file__).parents[1] / "images"


def driven(omega: float) -> Problem:
    """Return the oscillator with its stop at the place of equilibrium."""
    return load_problem("shaw-holmes", omega=omega)


def pushed(f: float) -> Problem:
    """Return the oscillator below resonance, with a stop that it reaches when it is pushed hard enough."""
    return load_problem("shaw-holmes", omega=0.8, s=1.0, x0=0.0, f=f)


def started(x0: float, v0: float) -> Problem:
    """Return the oscillator from any state."""
    return load_problem("shaw-holmes", x0=x0, v0=v0)


def pressed(omega: float, f: float) -> Problem:
    """Return an oscillator that a second spring stops softly."""
    mass, spring = Mass("x", 1.0), KelvinVoigt("x", "ground", k=1.0, c=0.1)
    stop = Bumper("x", "z", gap=1.0), Spring("z", "ground", 3.0)
    return Problem("oscillator with a soft stop", Scheme(mass, spring, *stop, Load("x", Harmonic(f, omega))))


def draw_bifurcation(path: Path) -> None:
    """Draw doubled periods and chaos, with the orbit that lost its stability."""
    diagram = bifurcation(driven, np.linspace(2.5, 3.4, 200), "impact", parameter="ω")
    branch = continue_orbit(driven, np.linspace(2.5, 3.4, 91), transient=60)
    replace(diagram, branches=(branch,)).plot(path)


def draw_grazing(path: Path) -> None:
    """Draw what a grazing does, with the orbits on both sides."""
    diagram = bifurcation(pushed, np.linspace(0.3, 0.6, 150), skip=150, parameter="f")
    touch = grazing(pushed, (0.1, 1.0))
    below = continue_orbit(pushed, np.linspace(0.3, 0.42, 61), transient=150)
    above = continue_orbit(pushed, np.linspace(0.6, 0.3, 121), transient=150)
    marks = [(touch.value, f"grazing, f = {touch.value:.6f}")]
    replace(diagram, branches=(below, above)).plot(path, marks=marks)


def draw_basins(path: Path) -> None:
    """Draw the basins of the orbit that strikes in every period, and of one of three periods beside it."""
    grid = np.linspace(-1.5, 0.0, 61), np.linspace(-1.5, 1.5, 61)
    basins(started, *grid, parameters=("x0", "v0"), longest=200).plot(path)


def draw_orbit(path: Path) -> None:
    """Draw an orbit of doubled period."""
    periodic_orbit(driven(2.7), periods=2, transient=60).plot(path)


def draw_two_parameters(path: Path) -> None:
    """Draw the folds of a bent resonance with their cusp, and the grazing."""
    names = ("ω", "f")
    folds = bifurcation_curve(pressed, (0.98, 1.1), (0.14, 0.1), "fold", parameters=names, transient=40)
    line = bifurcation_curve(lambda f, omega: pressed(omega, f), (0.08, 0.14), (0.95, 1.2), "grazing", step=0.01)
    folds.plot(path, others=[replace(line, parameters=names, table=line.table.rename(columns={"p": "f", "s": "ω"}))])


PICTURES = {
    "bifurcation": draw_bifurcation,
    "grazing": draw_grazing,
    "basins": draw_basins,
    "orbit": draw_orbit,
    "two-parameters": draw_two_parameters,
}


if __name__ == "__main__":
    for name in sys.argv[1:] or PICTURES:
        PICTURES[name](IMAGES / f"{name}.svg")
