"""lcpimpact: a laboratory for impact mechanics.

One rheological scheme, run by smooth and nonsmooth integrators, and judged against an exact solution. Names are imported
when they are first used, so that ``import lcpimpact`` costs next to nothing.

>>> import lcpimpact
>>> traj = lcpimpact.simulate(lcpimpact.load_problem("system-1"), dt=1e-2, t_end=3.0)
>>> traj.success
True
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_NAMES = {
    "certificate": ["Certificate"],
    "errors": ["FailureError", "InputError", "LcpImpactError", "Status", "UnknownNameError", "UnsupportedError"],
    "integrators.base": ["Declared", "Integrator"],
    "integrators.stepping.linear_step": ["LinearStep"],
    "lcp.operators": ["Banded", "Dense", "Factored"],
    "lcp.problem": ["LCPSolution"],
    "lcp.solve": ["PreparedLCP", "prepare_lcp", "solve_lcp"],
    "lcp.solvers.enumeration": ["all_solutions"],
    "plotting.cones": ["plot_cones"],
    "problems": ["load_problem"],
    "problems.base": ["Problem"],
    "problems.penalty": ["penalized"],
    "record": ["Event", "State"],
    "scheme.dynamics": ["Feature"],
    "scheme.elements.bar": ["Bar"],
    "scheme.elements.bumper": ["Bumper"],
    "scheme.elements.dashpot": ["Dashpot"],
    "scheme.elements.generalized_maxwell": ["GeneralizedMaxwell"],
    "scheme.elements.hertz_spring": ["HertzSpring"],
    "scheme.elements.hunt_crossley": ["HuntCrossley"],
    "scheme.elements.jenkins": ["Jenkins"],
    "scheme.elements.kelvin_voigt": ["KelvinVoigt"],
    "scheme.elements.kelvin_voigt_stop": ["KelvinVoigtStop"],
    "scheme.elements.load": ["Load"],
    "scheme.elements.mass": ["Mass"],
    "scheme.elements.maxwell": ["Maxwell"],
    "scheme.elements.negative_spring": ["NegativeSpring"],
    "scheme.elements.prescribed_motion": ["PrescribedMotion"],
    "scheme.elements.rope": ["Rope"],
    "scheme.elements.slider": ["Slider"],
    "scheme.elements.spring": ["Spring"],
    "scheme.elements.spring_pot": ["SpringPot"],
    "scheme.elements.zener": ["Zener"],
    "scheme.scheme": ["Scheme"],
    "scheme.signals": ["Harmonic", "Motion", "Polynomial", "Ramp", "Square", "Table"],
    "scheme.system": ["LinearComplementaritySystem"],
    "schemefile": ["Run", "SchemeFile", "read_scheme_file", "write_scheme_file"],
    "simulation": ["simulate"],
    "study.accuracy.comparison": ["Comparison", "compare"],
    "study.accuracy.convergence": ["Convergence", "WorkPrecision", "convergence", "observed_orders", "work_precision"],
    "study.accuracy.cross_validation": ["CrossValidation", "cross_validate"],
    "study.design.fit": ["Fit", "Target", "fit"],
    "study.design.parameters": ["with_values"],
    "study.design.sizing": ["Design", "design"],
    "study.dynamics.basins": ["Basins", "basins"],
    "study.dynamics.continuation": ["Branch", "continue_orbit"],
    "study.dynamics.diagrams": ["BifurcationDiagram", "bifurcation"],
    "study.dynamics.grazing": ["Grazing", "grazing"],
    "study.dynamics.lyapunov": ["LyapunovExponents", "lyapunov"],
    "study.dynamics.sections": ["Crossing", "Impacts", "PoincareSection", "Stroboscope", "poincare"],
    "study.dynamics.shooting": ["PeriodicOrbit", "periodic_orbit"],
    "study.ledger": ["Ledger", "energy_ledger"],
    "study.result": ["Study"],
    "trajectory": ["Trajectory"],
}
"""Module to the names that it offers."""

_LOCATIONS = {name: f"lcpimpact.{module}:{name}" for module, names in _NAMES.items() for name in names}

__all__ = [
    "Banded", "Bar", "Basins", "BifurcationDiagram", "Branch", "Bumper", "Certificate", "Comparison", "Convergence",
    "CrossValidation", "Crossing", "Dashpot", "Declared", "Dense", "Design", "Event", "Factored", "FailureError", "Feature",
    "Fit", "GeneralizedMaxwell", "Grazing", "Harmonic", "HertzSpring", "HuntCrossley", "Impacts", "InputError", "Integrator",
    "Jenkins", "KelvinVoigt", "KelvinVoigtStop", "LCPSolution", "LcpImpactError", "Ledger", "LinearComplementaritySystem",
    "LinearStep", "Load", "LyapunovExponents", "Mass", "Maxwell", "Motion", "NegativeSpring", "PeriodicOrbit",
    "PoincareSection", "Polynomial", "PreparedLCP", "PrescribedMotion", "Problem", "Ramp", "Rope", "Run", "Scheme",
    "SchemeFile", "Slider", "Spring", "SpringPot", "Square", "State", "Status", "Stroboscope", "Study", "Table", "Target",
    "Trajectory", "UnknownNameError", "UnsupportedError", "WorkPrecision", "Zener", "__version__", "all_solutions", "basins",
    "bifurcation", "compare", "continue_orbit", "convergence", "cross_validate", "design", "energy_ledger", "fit", "grazing",
    "load_problem", "lyapunov", "observed_orders", "penalized", "periodic_orbit", "plot_cones", "poincare", "prepare_lcp",
    "read_scheme_file", "simulate", "solve_lcp", "with_values", "work_precision", "write_scheme_file",
]  # fmt: skip

if TYPE_CHECKING:
    from lcpimpact.certificate import Certificate
    from lcpimpact.errors import FailureError, InputError, LcpImpactError, Status, UnknownNameError, UnsupportedError
    from lcpimpact.integrators.base import Declared, Integrator
    from lcpimpact.integrators.stepping.linear_step import LinearStep
    from lcpimpact.lcp.operators import Banded, Dense, Factored
    from lcpimpact.lcp.problem import LCPSolution
    from lcpimpact.lcp.solve import PreparedLCP, prepare_lcp, solve_lcp
    from lcpimpact.lcp.solvers.enumeration import all_solutions
    from lcpimpact.plotting.cones import plot_cones
    from lcpimpact.problems import load_problem
    from lcpimpact.problems.base import Problem
    from lcpimpact.problems.penalty import penalized
    from lcpimpact.record import Event, State
    from lcpimpact.scheme.dynamics import Feature
    from lcpimpact.scheme.elements.bar import Bar
    from lcpimpact.scheme.elements.bumper import Bumper
    from lcpimpact.scheme.elements.dashpot import Dashpot
    from lcpimpact.scheme.elements.generalized_maxwell import GeneralizedMaxwell
    from lcpimpact.scheme.elements.hertz_spring import HertzSpring
    from lcpimpact.scheme.elements.hunt_crossley import HuntCrossley
    from lcpimpact.scheme.elements.jenkins import Jenkins
    from lcpimpact.scheme.elements.kelvin_voigt import KelvinVoigt
    from lcpimpact.scheme.elements.kelvin_voigt_stop import KelvinVoigtStop
    from lcpimpact.scheme.elements.load import Load
    from lcpimpact.scheme.elements.mass import Mass
    from lcpimpact.scheme.elements.maxwell import Maxwell
    from lcpimpact.scheme.elements.negative_spring import NegativeSpring
    from lcpimpact.scheme.elements.prescribed_motion import PrescribedMotion
    from lcpimpact.scheme.elements.rope import Rope
    from lcpimpact.scheme.elements.slider import Slider
    from lcpimpact.scheme.elements.spring import Spring
    from lcpimpact.scheme.elements.spring_pot import SpringPot
    from lcpimpact.scheme.elements.zener import Zener
    from lcpimpact.scheme.scheme import Scheme
    from lcpimpact.scheme.signals import Harmonic, Motion, Polynomial, Ramp, Square, Table
    from lcpimpact.scheme.system import LinearComplementaritySystem
    from lcpimpact.schemefile import Run, SchemeFile, read_scheme_file, write_scheme_file
    from lcpimpact.simulation import simulate
    from lcpimpact.study.accuracy.comparison import Comparison, compare
    from lcpimpact.study.accuracy.convergence import (
        Convergence,
        WorkPrecision,
        convergence,
        observed_orders,
        work_precision,
    )
    from lcpimpact.study.accuracy.cross_validation import CrossValidation, cross_validate
    from lcpimpact.study.design.fit import Fit, Target, fit
    from lcpimpact.study.design.parameters import with_values
    from lcpimpact.study.design.sizing import Design, design
    from lcpimpact.study.dynamics.basins import Basins, basins
    from lcpimpact.study.dynamics.continuation import Branch, continue_orbit
    from lcpimpact.study.dynamics.diagrams import BifurcationDiagram, bifurcation
    from lcpimpact.study.dynamics.grazing import Grazing, grazing
    from lcpimpact.study.dynamics.lyapunov import LyapunovExponents, lyapunov
    from lcpimpact.study.dynamics.sections import Crossing, Impacts, PoincareSection, Stroboscope, poincare
    from lcpimpact.study.dynamics.shooting import PeriodicOrbit, periodic_orbit
    from lcpimpact.study.ledger import Ledger, energy_ledger
    from lcpimpact.study.result import Study
    from lcpimpact.trajectory import Trajectory


def __getattr__(name: str) -> Any:
    if name not in _LOCATIONS:
        raise AttributeError(f"module 'lcpimpact' has no attribute {name!r}")
    from lcpimpact.registry import load

    value = load(_LOCATIONS[name])
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
