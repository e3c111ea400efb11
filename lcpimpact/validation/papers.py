"""Statements of papers that a run can meet or miss: energies, orders, switches and penetration."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.integrators.newmark_ns import NewmarkNS
from lcpimpact.numerics.elimination import solve
from lcpimpact.problems import load_problem
from lcpimpact.problems.base import Problem
from lcpimpact.reading import at, crossing
from lcpimpact.scheme.elements.base import GROUND
from lcpimpact.scheme.elements.bumper import Bumper
from lcpimpact.scheme.elements.mass import Mass
from lcpimpact.scheme.elements.spring import Spring
from lcpimpact.scheme.scheme import Scheme
from lcpimpact.scheme.system import LinearComplementaritySystem
from lcpimpact.schemefile import Run
from lcpimpact.simulation import simulate
from lcpimpact.trajectory import Trajectory
from lcpimpact.validation.case import NotFound, Published, PublishedCase, Suite

# ---- Acary (2016): energies -----------------------------------------------------------------------------------------


def struck_chain(e: float) -> Problem:
    """Return six masses in a row of springs that strike a wall at 1 m/s."""
    masses = [Mass(f"x{i}", m=1.0) for i in range(1, 7)]
    springs = [Spring(f"x{i}", f"x{i + 1}", k=1000.0) for i in range(1, 6)]
    wall = Bumper("x6", GROUND, gap=0.1, e=e)
    v0 = dict.fromkeys((mass.node for mass in masses), 1.0)
    return Problem("chain", Scheme(*masses, *springs, wall), v0=v0, t_end=2.0)


def algorithmic_energy(run: Trajectory) -> Array:
    r"""Return the energy that a method's smooth steps never raise, at each instant of its grid (nt,).

    It is that of the system, and for Newmark's methods with α, β and γ

    .. math:: H = \tfrac12 v^T M v + \tfrac12 q^T K q + \tfrac{h^2}{4} (2 β - γ)\, a^T M a
              - \tfrac{α}{2} (\tfrac12 + α)\, (q - q^-)^T K (q - q^-),

    with the q⁻ of the step before, for a system without dashpots and loads.
    """
    d = run.problem.dynamics
    energy = _quadratic(run.v, d.M) + _quadratic(run.q, d.K)
    method = run.integrator
    if not isinstance(method, NewmarkNS):
        return energy
    β, γ = method.weights()
    α, h = method.alpha, float(run.t[1] - run.t[0])
    moved: Array = np.diff(run.q, axis=0, prepend=run.q[:1])
    a = solve(d.M, -d.K @ (run.q + α * moved).T).T
    return energy + h * h * (β - 0.5 * γ) * _quadratic(a, d.M) - α * (0.5 + α) * _quadratic(moved, d.K)


def _quadratic(x: Array, A: Array) -> Array:
    """Return ½ xᵀ A x of each row of x."""
    energy: Array = 0.5 * np.einsum("ti,ij,tj->t", x, A, x)
    return energy


def largest_gain(run: Trajectory) -> float:
    """Return the largest growth of the energy in a step, relative to that of the start; 0 if it never grows."""
    energy = algorithmic_energy(run)
    return max(float(np.diff(energy).max() / energy[0]), 0.0)


def energy_case(e: float, *runs: Run) -> PublishedCase:
    """Return the requirement that the energy never grows."""
    return PublishedCase(
        f"energy, e = {e:g}",
        "six masses and springs strike a wall",
        "Acary2016",
        partial(struck_chain, e),
        runs,
        (Published("largest growth of the energy in a step, relative", 0.0, largest_gain, atol=1e-12),),  # rounding
    )


ENERGY = (
    energy_case(0.0, Run("moreau-jean", dt=0.02, options={"theta": 1.0}), Run("newmark-ns", dt=0.02)),
    energy_case(
        0.5,
        Run("moreau-jean", dt=0.02, options={"theta": 2.0 / 3.0}),
        Run("newmark-ns", dt=0.02, options={"beta": 0.3, "gamma": 0.6}),
    ),
    energy_case(1.0, Run("moreau-jean", dt=0.02), Run("newmark-ns", dt=0.02, options={"alpha": -0.1})),
)

# ---- Nurkanović, Sperl, Albrecht and Diehl (2024): finite elements with switch detection ----------------------------

NOSNOC = "NurkanovicSperlAlbrechtDiehl2024; nosnoc_py, github.com/nosnoc/nosnoc_py, {} at 0c3f3bb2fd"


def simplest(above: float) -> Problem:
    """Return x' = 3 below zero and x' = ``above`` over it, from -1."""
    mean, half = 0.5 * (3.0 + above), 0.5 * (3.0 - above)
    system = LinearComplementaritySystem(
        A=[[0.0]], B=[[-half]], C=[[-1.0]], D=[[0.0]], a=[mean], lower=[-1.0], upper=[1.0], states=("x",)
    )
    return Problem("simplest", system, q0={"x": -1.0}, t_end=0.25 * math.pi)


def simplest_case(name: str, above: float) -> PublishedCase:
    """Return the test of the two fields with its tolerance: x reaches zero at 1/3 s, and goes on or slides."""
    t_end, reached = simplest(above).t_end, 1.0 / 3.0
    end = max(above, 0.0) * (t_end - reached)
    return PublishedCase(
        f"FESD, {name}",
        "two constant fields",
        NOSNOC.format("test/simple_sim_test.py"),
        partial(simplest, above),
        tuple(Run(method, dt=t_end / 8.0) for method in ("exact", "event-driven", "radau-fesd")),
        (
            Published(
                "reaches zero at t in s", reached, partial(crossing, series="x", level=-1e-12), 0.0, 1e-6, reached
            ),
            Published("x at the end", end, partial(at, series="x", t=t_end), 0.0, 1e-6, end),
        ),
    )


def measured_order(run: Trajectory, finer: int = 4) -> float:
    """Return the order of (q, v) at the end, by the errors of the run and of one whose steps are ``finer`` times smaller."""
    dt, method = run.problem.t_end / (len(run.t) - 1), run.integrator or run.method
    truth = simulate(run.problem, "exact", dt=dt, error=False, progress=False)
    fine = simulate(run.problem, method, dt=dt / finer, error=False, progress=False)
    errors = [np.abs(each.q[-1] - truth.q[-1]).max() + np.abs(each.v[-1] - truth.v[-1]).max() for each in (run, fine)]
    return math.log(errors[0] / errors[1], finer)


def order_case(name: str, stages: int, divisions: int) -> PublishedCase:
    """Return the order of Radau IIA across the switches of a problem."""
    problem = load_problem(name)
    return PublishedCase(
        f"FESD, {name}, s = {stages}",
        "order across switches",
        NOSNOC.format("examples/oscillator/integration_order_experiment_oscillator.py"),
        partial(load_problem, name),
        (Run("radau-fesd", dt=problem.t_end / divisions, options={"stages": stages}),),
        # The source draws lines of these orders, and sets no tolerance.
        (Published("order", 2.0 * stages - 1.0, measured_order, atol=0.15),),
    )


ORDERS = tuple(
    order_case(name, stages, divisions)
    for name, steps in (
        ("impact-oscillator", {2: 80, 3: 40, 4: 40}),
        ("coulomb-oscillator", {2: 40, 3: 40, 4: 20}),
        ("system-3", {2: 80, 3: 40, 4: 20}),
    )
    for stages, divisions in steps.items()
)

# ---- Capobianco, Harsch, Eugster and Leine (2021): no penetration ---------------------------------------------------

CAPOBIANCO = (
    "CapobiancoHarschEugsterLeine2021; PyNonsmooth, github.com/JonasBreuling/PyNonsmooth, "
    "benchmarks/bouncing_ball/bouncing_ball_scenario1.py at f8e7628b3f"
)


def depth(run: Trajectory) -> float:
    """Return the largest penetration at the ends of the steps in m."""
    return float(max(run["x"].max() - run.problem.parameters["H"], 0.0))


BALL = PublishedCase(
    "ball, figure 1",
    "ball without spin, e = 0.5",
    CAPOBIANCO,
    partial(load_problem, "bouncing-ball", H=0.9, e=0.5),
    (Run("generalized-alpha", dt=2e-3, t_end=1.5, options={"rho_inf": 0.5}), Run("rattle-ns", dt=2e-3, t_end=1.5)),
    (Published("largest penetration in m", 0.0, depth, atol=1e-12),),
)

UNREAD = "no more of the paper than its title, abstract and references could be read"

SUITE = Suite(
    title="Papers: energies, orders, switches and penetration",
    cases=(*ENERGY, simplest_case("sliding", -1.0), simplest_case("switch", 1.0), *ORDERS, BALL),
    not_found=(
        NotFound("Acary 2012", "digits of its convergence studies", "Acary2012", UNREAD),
        NotFound("Acary 2013", "digits of its examples", "Acary2013", UNREAD),
        NotFound("Acary 2016", "digits of its examples", "Acary2016", UNREAD),
        NotFound("Doyen et al. 2011", "digits of energies and contact forces by scheme", "DoyenErnPiperno2011", UNREAD),
        NotFound("Kovtunenko 2025, 2026", "digits of their convergence", "Kovtunenko2025; Kovtunenko2026", UNREAD),
        NotFound("Di Stasio et al. 2019", "parameters and digits of its three cases", "DiStasioEtAl2019", UNREAD),
        NotFound("Schindler, Acary 2014", "digits of the bouncing ball", "SchindlerAcary2014", UNREAD),
        NotFound(
            "FESD, oscillator",
            "error at the end",
            NOSNOC.format("test/oscillator_test.py"),
            "its fields switch on a circle, x_1² + x_2² = 1, and rows here are linear in the state",
        ),
        NotFound(
            "Capobianco et al. 2021",
            "digits of figure 2, and the systems of later sections",
            "CapobiancoHarschEugsterLeine2021",
            "the script of section 10.1 has the data of its figures and no results, and those of later sections are in no "
            "source that could be read",
        ),
    ),
)
