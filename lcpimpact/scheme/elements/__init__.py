"""The elements that rheological schemes are built from, by name."""

from lcpimpact.registry import Registry
from lcpimpact.scheme.elements.base import Element

ELEMENTS: Registry[type[Element]] = Registry(
    "element",
    {
        "Mass": "lcpimpact.scheme.elements.mass:Mass",
        "Spring": "lcpimpact.scheme.elements.spring:Spring",
        "Dashpot": "lcpimpact.scheme.elements.dashpot:Dashpot",
        "KelvinVoigt": "lcpimpact.scheme.elements.kelvin_voigt:KelvinVoigt",
        "Bumper": "lcpimpact.scheme.elements.bumper:Bumper",
        "Load": "lcpimpact.scheme.elements.load:Load",
    },
)
