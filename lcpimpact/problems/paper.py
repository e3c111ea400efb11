r"""Systems No. 1, 2 and 3 of Grzesikiewicz and Zbiciak, as three schemes and nothing else.

Coordinates are positive downwards: x the body, y the lower end of the body's own structure, z the upper plate on the
ground structure. The defaults are Table 1, and a fall from rest through h_o = 5 m.
"""

from __future__ import annotations

from lcpimpact.problems.base import Problem, falling_speed
from lcpimpact.scheme.elements.base import GROUND
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.kelvin_voigt import KelvinVoigt
from lcpimpact.scheme.elements.load import Load
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.elements.spring import Spring
from lcpimpact.scheme.scheme import Scheme

SOURCE = "Grzesikiewicz and Zbiciak, Modelling of impact problems using rheological schemes"


def system_1(
    m: float = 100.0,
    k_o: float = 3924.0,
    c_o: float = 250.0,
    g: float = 9.81,
    h_o: float = 5.0,
    v_o: float | None = None,
) -> Problem:
    """System No. 1 (Fig. 1): mass | bumper | Kelvin-Voigt | ground.

    ``m x'' = m g - R``, ``c_o z' + k_o z = R``, ``0 <= z - x ⟂ R >= 0``: Eqs (2), of relative degree 1.
    """
    speed = falling_speed("system-1", g, h_o, v_o)
    scheme = Scheme(
        Mass("x", m),
        Load("x", m * g, symbols=("mg",)),
        Bumper("x", "z"),
        KelvinVoigt("z", GROUND, k_o, c_o, symbols=("k_o", "c_o")),
    )
    parameters = {"m": m, "k_o": k_o, "c_o": c_o, "g": g, "h_o": h_o, "v_o": speed}
    return Problem("system-1", scheme, v0={"x": speed}, t_end=3.0, parameters=parameters, source=f"{SOURCE}, Fig. 1")


def system_2(
    m: float = 100.0,
    k: float = 1962.0,
    k_o: float = 3924.0,
    c_o: float = 250.0,
    g: float = 9.81,
    h_o: float = 5.0,
    v_o: float | None = None,
) -> Problem:
    """System No. 2 (Fig. 4): mass | spring | bumper | Kelvin-Voigt | ground.

    As System No. 1 with ``k (y - x) = -R`` and ``0 <= z - y ⟂ R >= 0``: Eqs (5), of relative degree 0.
    """
    speed = falling_speed("system-2", g, h_o, v_o)
    scheme = Scheme(
        Mass("x", m),
        Load("x", m * g, symbols=("mg",)),
        Spring("x", "y", k),
        Bumper("y", "z"),
        KelvinVoigt("z", GROUND, k_o, c_o, symbols=("k_o", "c_o")),
    )
    parameters = {"m": m, "k": k, "k_o": k_o, "c_o": c_o, "g": g, "h_o": h_o, "v_o": speed}
    return Problem("system-2", scheme, v0={"x": speed}, t_end=3.0, parameters=parameters, source=f"{SOURCE}, Fig. 4")


def system_3(
    m: float = 100.0,
    k: float = 1962.0,
    k_o: float = 3924.0,
    c: float = 125.0,
    c_o: float = 250.0,
    g: float = 9.81,
    h_o: float = 5.0,
    v_o: float | None = None,
) -> Problem:
    """System No. 3 (Fig. 5): mass | Kelvin-Voigt | bumper | Kelvin-Voigt | ground.

    As System No. 2 with ``c (y' - x') + k (y - x) = -R``: Eqs (7), of relative degree 1. With Table 1, k/c = k_o/c_o
    and x = 3 y in contact; c = 60 has no such symmetry.
    """
    speed = falling_speed("system-3", g, h_o, v_o)
    scheme = Scheme(
        Mass("x", m),
        Load("x", m * g, symbols=("mg",)),
        KelvinVoigt("x", "y", k, c),
        Bumper("y", "z"),
        KelvinVoigt("z", GROUND, k_o, c_o, symbols=("k_o", "c_o")),
    )
    parameters = {"m": m, "k": k, "k_o": k_o, "c": c, "c_o": c_o, "g": g, "h_o": h_o, "v_o": speed}
    return Problem("system-3", scheme, v0={"x": speed}, t_end=3.0, parameters=parameters, source=f"{SOURCE}, Fig. 5")
