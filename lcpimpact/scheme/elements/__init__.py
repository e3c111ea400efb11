"""The elements that rheological schemes are built from, by name."""

from lcpimpact.registry import Registry
from lcpimpact.scheme.elements.base import Element

ELEMENTS: Registry[type[Element]] = Registry(
    "element",
    {
        "Mass": "lcpimpact.scheme.elements.mass:Mass",
        "Spring": "lcpimpact.scheme.elements.spring:Spring",
        "NegativeSpring": "lcpimpact.scheme.elements.negative_spring:NegativeSpring",
        "Dashpot": "lcpimpact.scheme.elements.dashpot:Dashpot",
        "KelvinVoigt": "lcpimpact.scheme.elements.kelvin_voigt:KelvinVoigt",
        "Maxwell": "lcpimpact.scheme.elements.maxwell:Maxwell",
        "Zener": "lcpimpact.scheme.elements.zener:Zener",
        "GeneralizedMaxwell": "lcpimpact.scheme.elements.generalized_maxwell:GeneralizedMaxwell",
        "SpringPot": "lcpimpact.scheme.elements.spring_pot:SpringPot",
        "Jenkins": "lcpimpact.scheme.elements.jenkins:Jenkins",
        "HertzSpring": "lcpimpact.scheme.elements.hertz_spring:HertzSpring",
        "HuntCrossley": "lcpimpact.scheme.elements.hunt_crossley:HuntCrossley",
        "KelvinVoigtStop": "lcpimpact.scheme.elements.kelvin_voigt_stop:KelvinVoigtStop",
        "Slider": "lcpimpact.scheme.elements.slider:Slider",
        "Bumper": "lcpimpact.scheme.elements.bumper:Bumper",
        "Rope": "lcpimpact.scheme.elements.rope:Rope",
        "Bar": "lcpimpact.scheme.elements.bar:Bar",
        "Load": "lcpimpact.scheme.elements.load:Load",
        "PrescribedMotion": "lcpimpact.scheme.elements.prescribed_motion:PrescribedMotion",
    },
)
