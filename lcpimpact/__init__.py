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

_LOCATIONS = {
    "load_problem": "lcpimpact.problems:load_problem",
    "penalized": "lcpimpact.problems.penalty:penalized",
    "simulate": "lcpimpact.simulation:simulate",
    "convergence": "lcpimpact.study.accuracy.convergence:convergence",
    "work_precision": "lcpimpact.study.accuracy.convergence:work_precision",
    "observed_orders": "lcpimpact.study.accuracy.convergence:observed_orders",
    "read_scheme_file": "lcpimpact.schemefile:read_scheme_file",
    "write_scheme_file": "lcpimpact.schemefile:write_scheme_file",
    "SchemeFile": "lcpimpact.schemefile:SchemeFile",
    "Run": "lcpimpact.schemefile:Run",
    "solve_lcp": "lcpimpact.lcp.solve:solve_lcp",
    "prepare_lcp": "lcpimpact.lcp.solve:prepare_lcp",
    "all_solutions": "lcpimpact.lcp.solvers.enumeration:all_solutions",
    "plot_cones": "lcpimpact.plotting.cones:plot_cones",
    "LCPSolution": "lcpimpact.lcp.problem:LCPSolution",
    "Dense": "lcpimpact.lcp.operators:Dense",
    "Banded": "lcpimpact.lcp.operators:Banded",
    "Factored": "lcpimpact.lcp.operators:Factored",
    "Scheme": "lcpimpact.scheme.scheme:Scheme",
    "Problem": "lcpimpact.problems.base:Problem",
    "Trajectory": "lcpimpact.trajectory:Trajectory",
    "Mass": "lcpimpact.scheme.elements.mass:Mass",
    "Spring": "lcpimpact.scheme.elements.spring:Spring",
    "Dashpot": "lcpimpact.scheme.elements.dashpot:Dashpot",
    "KelvinVoigt": "lcpimpact.scheme.elements.kelvin_voigt:KelvinVoigt",
    "KelvinVoigtStop": "lcpimpact.scheme.elements.kelvin_voigt_stop:KelvinVoigtStop",
    "Bumper": "lcpimpact.scheme.elements.bumper:Bumper",
    "Load": "lcpimpact.scheme.elements.load:Load",
    "Slider": "lcpimpact.scheme.elements.slider:Slider",
    "Jenkins": "lcpimpact.scheme.elements.jenkins:Jenkins",
    "HertzSpring": "lcpimpact.scheme.elements.hertz_spring:HertzSpring",
    "HuntCrossley": "lcpimpact.scheme.elements.hunt_crossley:HuntCrossley",
    "PrescribedMotion": "lcpimpact.scheme.elements.prescribed_motion:PrescribedMotion",
    "Maxwell": "lcpimpact.scheme.elements.maxwell:Maxwell",
    "Zener": "lcpimpact.scheme.elements.zener:Zener",
    "GeneralizedMaxwell": "lcpimpact.scheme.elements.generalized_maxwell:GeneralizedMaxwell",
    "SpringPot": "lcpimpact.scheme.elements.spring_pot:SpringPot",
    "NegativeSpring": "lcpimpact.scheme.elements.negative_spring:NegativeSpring",
    "Rope": "lcpimpact.scheme.elements.rope:Rope",
    "Bar": "lcpimpact.scheme.elements.bar:Bar",
    "Motion": "lcpimpact.scheme.signals:Motion",
    "LinearComplementaritySystem": "lcpimpact.scheme.system:LinearComplementaritySystem",
    "Harmonic": "lcpimpact.scheme.signals:Harmonic",
    "Polynomial": "lcpimpact.scheme.signals:Polynomial",
    "Ramp": "lcpimpact.scheme.signals:Ramp",
    "Square": "lcpimpact.scheme.signals:Square",
    "Table": "lcpimpact.scheme.signals:Table",
    "poincare": "lcpimpact.study.dynamics.sections:poincare",
    "bifurcation": "lcpimpact.study.dynamics.diagrams:bifurcation",
    "basins": "lcpimpact.study.dynamics.basins:basins",
    "Stroboscope": "lcpimpact.study.dynamics.sections:Stroboscope",
    "Impacts": "lcpimpact.study.dynamics.sections:Impacts",
    "Crossing": "lcpimpact.study.dynamics.sections:Crossing",
    "periodic_orbit": "lcpimpact.study.dynamics.shooting:periodic_orbit",
    "continue_orbit": "lcpimpact.study.dynamics.continuation:continue_orbit",
    "grazing": "lcpimpact.study.dynamics.grazing:grazing",
    "lyapunov": "lcpimpact.study.dynamics.lyapunov:lyapunov",
    "PeriodicOrbit": "lcpimpact.study.dynamics.shooting:PeriodicOrbit",
    "compare": "lcpimpact.study.accuracy.comparison:compare",
    "Comparison": "lcpimpact.study.accuracy.comparison:Comparison",
    "energy_ledger": "lcpimpact.study.ledger:energy_ledger",
    "Ledger": "lcpimpact.study.ledger:Ledger",
    "cross_validate": "lcpimpact.study.accuracy.cross_validation:cross_validate",
    "CrossValidation": "lcpimpact.study.accuracy.cross_validation:CrossValidation",
    "design": "lcpimpact.study.design.sizing:design",
    "Design": "lcpimpact.study.design.sizing:Design",
    "fit": "lcpimpact.study.design.fit:fit",
    "Fit": "lcpimpact.study.design.fit:Fit",
    "Target": "lcpimpact.study.design.fit:Target",
    "with_values": "lcpimpact.study.design.parameters:with_values",
    "Integrator": "lcpimpact.integrators.base:Integrator",
    "Declared": "lcpimpact.integrators.base:Declared",
    "LinearStep": "lcpimpact.integrators.stepping.linear_step:LinearStep",
    "Feature": "lcpimpact.scheme.dynamics:Feature",
    "Event": "lcpimpact.record:Event",
    "State": "lcpimpact.record:State",
    "Certificate": "lcpimpact.certificate:Certificate",
    "PreparedLCP": "lcpimpact.lcp.solve:PreparedLCP",
    "Branch": "lcpimpact.study.dynamics.continuation:Branch",
    "Grazing": "lcpimpact.study.dynamics.grazing:Grazing",
    "Basins": "lcpimpact.study.dynamics.basins:Basins",
    "Convergence": "lcpimpact.study.accuracy.convergence:Convergence",
    "WorkPrecision": "lcpimpact.study.accuracy.convergence:WorkPrecision",
    "PoincareSection": "lcpimpact.study.dynamics.sections:PoincareSection",
    "BifurcationDiagram": "lcpimpact.study.dynamics.diagrams:BifurcationDiagram",
    "Study": "lcpimpact.study.result:Study",
    "Status": "lcpimpact.errors:Status",
    "LcpImpactError": "lcpimpact.errors:LcpImpactError",
    "InputError": "lcpimpact.errors:InputError",
    "UnsupportedError": "lcpimpact.errors:UnsupportedError",
    "FailureError": "lcpimpact.errors:FailureError",
    "UnknownNameError": "lcpimpact.errors:UnknownNameError",
}

__all__ = [
    "Banded",
    "Bar",
    "Basins",
    "BifurcationDiagram",
    "Branch",
    "Bumper",
    "Certificate",
    "Comparison",
    "Convergence",
    "CrossValidation",
    "Crossing",
    "Dashpot",
    "Declared",
    "Dense",
    "Design",
    "Event",
    "Factored",
    "FailureError",
    "Feature",
    "Fit",
    "GeneralizedMaxwell",
    "Grazing",
    "Harmonic",
    "HertzSpring",
    "HuntCrossley",
    "Impacts",
    "InputError",
    "Integrator",
    "Jenkins",
    "KelvinVoigt",
    "KelvinVoigtStop",
    "LCPSolution",
    "LcpImpactError",
    "Ledger",
    "LinearComplementaritySystem",
    "LinearStep",
    "Load",
    "Mass",
    "Maxwell",
    "Motion",
    "NegativeSpring",
    "PeriodicOrbit",
    "PoincareSection",
    "Polynomial",
    "PreparedLCP",
    "PrescribedMotion",
    "Problem",
    "Ramp",
    "Rope",
    "Run",
    "Scheme",
    "SchemeFile",
    "Slider",
    "Spring",
    "SpringPot",
    "Square",
    "State",
    "Status",
    "Stroboscope",
    "Study",
    "Table",
    "Target",
    "Trajectory",
    "UnknownNameError",
    "UnsupportedError",
    "WorkPrecision",
    "Zener",
    "__version__",
    "all_solutions",
    "basins",
    "bifurcation",
    "compare",
    "continue_orbit",
    "convergence",
    "cross_validate",
    "design",
    "energy_ledger",
    "fit",
    "grazing",
    "load_problem",
    "lyapunov",
    "observed_orders",
    "penalized",
    "periodic_orbit",
    "plot_cones",
    "poincare",
    "prepare_lcp",
    "read_scheme_file",
    "simulate",
    "solve_lcp",
    "with_values",
    "work_precision",
    "write_scheme_file",
]

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
    from lcpimpact.study.dynamics.lyapunov import lyapunov
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
