"""Reference values of the paper's systems with Table 1, g = 9.81 and h_o = 5 m, computed with 40 digits."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Known:
    """Digits of one system that any correct solution must show.

    Attributes
    ----------
    label : str                     how tables call it
    problem : str                   registry name
    parameters : dict               what differs from Table 1
    switches : tuple                instants in s at which R falls to zero and the gap closes, in turn, up to 3 s
    at_3 : dict                     values at t = 3 s: coordinates in m, R in N
    peak : float or None            greatest R in N
    limits : tuple                  tolerances stated for sup |x - exact| of the θ = 1/2 step at h = 1e-2, 1e-3, 1e-4, in m
    """

    label: str
    problem: str
    parameters: dict[str, float]
    switches: tuple[float, ...]
    at_3: dict[str, float]
    peak: float | None
    limits: tuple[float, float, float]
    kinds: tuple[str, ...] = field(default=("open", "close", "open", "close"))


KNOWN = (
    Known(
        "System 1",
        "system-1",
        {},
        (0.522438236432474, 1.500100083187666, 2.150492924679755, 2.378371734294163),
        {"x": 0.3205131901714395, "R": 1091.6053437453},
        5818.4105,
        (2.5e-3, 1.3e-5, 2e-7),
    ),
    Known("System 2", "system-2", {}, (1.001720011624550, 2.743316022945684), {}, 4486.0845, (2e-3, 2e-5, 3e-7)),
    Known(
        "System 3",
        "system-3",
        {},
        (1.004304121938824, 2.219373769539099),
        {"x": 1.614947677834054, "R": 1833.8995831353},
        4009.5887,
        (1e-3, 1.2e-5, 2e-7),
    ),
    Known(
        "System 3, c = 60",
        "system-3",
        {"c": 60.0},
        (1.002784983230149, 2.469174921790925),
        {"x": 2.50289758910908, "y": 0.827402358685888, "R": 3266.5429974381},
        None,
        (1.5e-3, 2e-5, 3e-7),
    ),
)
