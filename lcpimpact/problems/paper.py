r"""Systems No. 1, 2 and 3 of Grzesikiewicz and Zbiciak as schemes.

Coordinates are positive downwards: x the body, y the lower end of the body's own structure, z the upper plate on the
ground structure. The defaults are Table 1, and a fall from rest through h_o = 5 m.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated

from lcpimpact.problems.base import Problem, falling_speed
from lcpimpact.problems.facts import Fact
from lcpimpact.problems.reference import KNOWN, Known
from lcpimpact.problems.registered import registered
from lcpimpact.reading import at, instant, peak
from lcpimpact.scheme.elements.base import GROUND
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.kelvin_voigt import KelvinVoigt
from lcpimpact.scheme.elements.load import Load
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.elements.spring import Spring
from lcpimpact.scheme.scheme import Scheme

TABLE_1 = {"m": 100.0, "k": 1962.0, "k_o": 3924.0, "c": 125.0, "c_o": 250.0, "g": 9.81, "h_o": 5.0}


@registered
def system_1(
    m: Annotated[float, "kg, mass"] = 100.0,
    k_o: Annotated[float, "N/m, stiffness of the ground structure"] = 3924.0,
    c_o: Annotated[float, "N s/m, damping of the ground structure"] = 250.0,
    g: Annotated[float, "m/s², gravity"] = 9.81,
    h_o: Annotated[float, "m, height of fall, which with g gives v_o"] = 5.0,
    v_o: Annotated[float | None, "m/s, speed at first touch, instead of h_o"] = None,
) -> Problem:
    """System No. 1 (Fig. 1): mass | bumper | Kelvin-Voigt | ground.

    ``m x'' = m g - R``, ``c_o z' + k_o z = R``, ``0 <= z - x ⟂ R >= 0``: Eqs (2), of relative degree 1.

    The body drives a massless plate. R is a function and no impulse, yet it jumps to ``R(0+) = c_o v_o`` at first
    touch. Contact ends while the block is still pressed together, the plate creeps back, and the body, which gravity
    returns, hits it again on its way: four switches in 3 s with Table 1. The trap is the first-order form x' = A x + B R
    with R weighted by 1/2: R then rings for ever, and its peak comes out 43 % too high.

    Raises
    ------
    InputError
        If a constant is not above zero, or g and h_o give no speed.

    Examples
    --------
    >>> [round(fact.value, 6) for fact in system_1().facts[:3]]
    [2476.136103, 0.522438, 1.5001]

    References
    ----------
    Grzesikiewicz and Zbiciak, *Modelling of impact problems using rheological schemes*, Fig. 1.
    """
    speed = falling_speed("system-1", g, h_o, v_o)
    scheme = Scheme(
        Mass("x", m),
        Load("x", m * g, symbols=("mg",)),
        Bumper("x", "z"),
        KelvinVoigt("z", GROUND, k_o, c_o, symbols=("k_o", "c_o")),
    )
    problem = Problem(
        "system-1",
        scheme,
        v0={"x": speed},
        t_end=3.0,
        parameters={"v_o": speed},
        source="GrzesikiewiczZbiciak, Fig. 1",
        facts=lambda: _facts(problem, c_o * speed),
    )
    return problem


@registered
def system_2(
    m: Annotated[float, "kg, mass"] = 100.0,
    k: Annotated[float, "N/m, stiffness of the body's own structure"] = 1962.0,
    k_o: Annotated[float, "N/m, stiffness of the ground structure"] = 3924.0,
    c_o: Annotated[float, "N s/m, damping of the ground structure"] = 250.0,
    g: Annotated[float, "m/s², gravity"] = 9.81,
    h_o: Annotated[float, "m, height of fall, which with g gives v_o"] = 5.0,
    v_o: Annotated[float | None, "m/s, speed at first touch, instead of h_o"] = None,
) -> Problem:
    """System No. 2 (Fig. 4): mass | spring | bumper | Kelvin-Voigt | ground.

    As System No. 1 with ``k (y - x) = -R`` and ``0 <= z - y ⟂ R >= 0``: Eqs (5), of relative degree 0.

    A spring between body and bumper takes the jump out of the force: R starts from zero and is continuous, since
    ``u = z - x + R/k`` and so ``R = k [x - z]^+``. The node y has no equation of motion, only a balance of forces; in
    flight it follows x. The trap is to treat y as a state: with θ = 1/2 it oscillates about equilibrium for ever.

    Raises
    ------
    InputError
        If a constant is not above zero, or g and h_o give no speed.

    Examples
    --------
    >>> [round(fact.value, 6) for fact in system_2().facts]
    [0.0, 1.00172, 2.743316, 4486.0845]

    References
    ----------
    Grzesikiewicz and Zbiciak, *Modelling of impact problems using rheological schemes*, Fig. 4.
    """
    speed = falling_speed("system-2", g, h_o, v_o)
    scheme = Scheme(
        Mass("x", m),
        Load("x", m * g, symbols=("mg",)),
        Spring("x", "y", k),
        Bumper("y", "z"),
        KelvinVoigt("z", GROUND, k_o, c_o, symbols=("k_o", "c_o")),
    )
    problem = Problem(
        "system-2",
        scheme,
        v0={"x": speed},
        t_end=3.0,
        parameters={"v_o": speed},
        source="GrzesikiewiczZbiciak, Fig. 4",
        facts=lambda: _facts(problem, 0.0),
    )
    return problem


@registered
def system_3(
    m: Annotated[float, "kg, mass"] = 100.0,
    k: Annotated[float, "N/m, stiffness of the body's own structure"] = 1962.0,
    k_o: Annotated[float, "N/m, stiffness of the ground structure"] = 3924.0,
    c: Annotated[float, "N s/m, damping of the body's own structure"] = 125.0,
    c_o: Annotated[float, "N s/m, damping of the ground structure"] = 250.0,
    g: Annotated[float, "m/s², gravity"] = 9.81,
    h_o: Annotated[float, "m, height of fall, which with g gives v_o"] = 5.0,
    v_o: Annotated[float | None, "m/s, speed at first touch, instead of h_o"] = None,
) -> Problem:
    """System No. 3 (Fig. 5): mass | Kelvin-Voigt | bumper | Kelvin-Voigt | ground.

    As System No. 2 with ``c (y' - x') + k (y - x) = -R``: Eqs (7), of relative degree 1.

    Two dashpots in series share the first blow, ``R(0+) = v_o/(1/c + 1/c_o)``, and of the three systems this has the
    smallest force. The trap lies in the data: with Table 1, k/c = k_o/c_o, the two blocks act as one and x = 3 y in
    contact, which hides mistakes in their coupling; c = 60 has no such symmetry, and its facts are here too.

    Raises
    ------
    InputError
        If a constant is not above zero, or g and h_o give no speed.

    Examples
    --------
    >>> [round(fact.value, 6) for fact in system_3().facts[:3]]
    [825.378701, 1.004304, 2.219374]

    References
    ----------
    Grzesikiewicz and Zbiciak, *Modelling of impact problems using rheological schemes*, Fig. 5.
    """
    speed = falling_speed("system-3", g, h_o, v_o)
    scheme = Scheme(
        Mass("x", m),
        Load("x", m * g, symbols=("mg",)),
        KelvinVoigt("x", "y", k, c),
        Bumper("y", "z"),
        KelvinVoigt("z", GROUND, k_o, c_o, symbols=("k_o", "c_o")),
    )
    problem = Problem(
        "system-3",
        scheme,
        v0={"x": speed},
        t_end=3.0,
        parameters={"v_o": speed},
        source="GrzesikiewiczZbiciak, Fig. 5",
        facts=lambda: _facts(problem, speed / (1.0 / c + 1.0 / c_o)),
    )
    return problem


def _facts(problem: Problem, first_force: float) -> tuple[Fact, ...]:
    """Return the force at first touch, and the digits that are known with the data of Table 1 or a variant of it."""
    values = problem.parameters
    facts: tuple[Fact, ...] = ()
    if values["v_o"] > 0.0:
        scale = math.sqrt(values["m"] * values["k_o"]) * values["v_o"]
        facts = (Fact("R(0+)", "force at first touch", first_force, "N", partial(at, series="R", t=0.0), scale=scale),)
    for known in KNOWN:
        data = TABLE_1 | known.parameters
        data["v_o"] = math.sqrt(2.0 * data["g"] * data["h_o"])
        if known.problem == problem.name and all(value == data[symbol] for symbol, value in values.items()):
            facts += _digits(known)
    return facts


def _digits(known: Known) -> tuple[Fact, ...]:
    def switch(number: int, kind: str, t: float) -> Fact:
        what = "R falls to zero" if kind == "open" else "the gap closes"
        return Fact(
            f"t_{number + 1}", what, t, "s", partial(instant, kind=kind, number=number // 2 + 1), accuracy=1e-12
        )

    def value_at_3(series: str, value: float) -> Fact:
        unit = "N" if series == "R" else "m"
        return Fact(f"{series}(3)", "at 3 s", value, unit, partial(at, series=series, t=3.0))

    facts = [switch(i, kind, t) for i, (kind, t) in enumerate(zip(known.kinds, known.switches, strict=False))]
    facts += [value_at_3(series, value) for series, value in known.at_3.items()]
    if known.peak is not None:
        # Four decimals are known.
        facts.append(Fact("R_max", "greatest force", known.peak, "N", partial(peak, series="R"), 2e-8, digits=8))
    return tuple(facts)
