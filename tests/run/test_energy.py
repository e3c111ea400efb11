"""No method that declares dissipation ever leaves a system with more energy than it began with.

The energy is that of masses, springs and constant loads, E = ½ vᵀ M v + ½ qᵀ K q - f·q. In a smooth step a method that is
explicit in the springs keeps, instead of E, a form that lies between (1 - (hω/2)²) E and E. So what is asserted is

    E(t) <= E(0)/(1 - (hω/2)²)   at every grid point, with the highest ω of the scheme,

which is E(t) <= E(0) without springs, and which no gain that adds up from impact to impact can keep. It does not say that
no single step gains: one that begins while bodies still overlap and part already may give back up to m (F h/m)²/2, which an
impact took before. No contact has friction, with which Newton's law itself may gain: that is in test_impact_gain.py.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import eigvalsh

import lcpimpact as li
from lcpimpact.integrators import METHODS
from lcpimpact.scheme.structure import Feature


def handles_impacts(name):
    declared = METHODS[name].declared
    return 2 in declared.relative_degrees and Feature.RESTITUTION in declared.handles


METHODS_WITH_IMPACTS = [name for name in METHODS if handles_impacts(name)]
DISSIPATING = [name for name in METHODS_WITH_IMPACTS if METHODS[name].declared.dissipates]


def ball(e):
    """One ball on the ground."""
    return li.load_problem("bouncing-ball", e=e)


def box(e):
    """Three balls between two walls: impacts for ever, also of two at once."""
    scheme = li.Scheme(
        li.Mass("a", 1.0), li.Mass("b", 2.0), li.Mass("c", 0.7),
        li.Bumper("ground", "a", gap=0.02, e=e, name="R0"), li.Bumper("a", "b", gap=0.01, e=e, name="R1"),
        li.Bumper("b", "c", gap=0.015, e=e, name="R2"), li.Bumper("c", "ground", gap=0.02, e=e, name="R3"),
    )  # fmt: skip
    return li.Problem("box", scheme, v0={"a": 1.0, "c": -0.6})


def pressed(e):
    """An oscillator that a load presses on its stop, or pulls off it, and a ball on its back."""
    scheme = li.Scheme(
        li.Mass("x", 1.0), li.Spring("x", "ground", 100.0), li.Load("x", 12.0),
        li.Mass("y", 0.5), li.Spring("y", "ground", 30.0),
        li.Bumper("x", "ground", gap=0.05, e=e, name="R1"), li.Bumper("y", "x", gap=0.03, e=e, name="R2"),
    )  # fmt: skip
    return li.Problem("pressed", scheme, q0={"x": -0.2, "y": -0.2})


def beaten(e):
    """Two oscillators whose stop stands beyond their rest, and before it."""
    scheme = li.Scheme(
        li.Mass("x", 1.0), li.Spring("x", "ground", 80.0), li.Load("x", -5.0),
        li.Mass("y", 2.0), li.Spring("y", "ground", 50.0), li.Bumper("x", "y", gap=0.02, e=e),
    )  # fmt: skip
    return li.Problem("beaten", scheme, q0={"x": -0.1, "y": 0.1}, v0={"y": -1.0})


SCHEMES = {"ball": ball, "box": box, "pressed": pressed, "beaten": beaten}


def energy(run):
    dynamics = run.problem.dynamics
    return dynamics.energy(run.q, run.v) - run.q @ dynamics.force(0.0)


def gain(run, h):
    """Return how far E rises over its bound, relative to the energies there are."""
    dynamics = run.problem.dynamics
    ω2 = eigvalsh(dynamics.K, dynamics.M).max()
    E = energy(run)
    # Loads make the zero of E arbitrary: it is counted from its least value, that of the rest without contacts.
    least = 0.0
    if dynamics.K.any():
        rest = np.linalg.solve(dynamics.K, dynamics.force(0.0))
        least = 0.5 * rest @ dynamics.K @ rest - rest @ dynamics.force(0.0)
    kinetic = dynamics.kinetic_energy(run.q, run.v).max()
    bound = least + (E[0] - least) / (1.0 - 0.25 * h**2 * ω2)
    return (E.max() - bound) / (kinetic + abs(E[0] - least))


def options(name, e, relative):
    """Draw θ of moreau-jean from where it dissipates."""
    return {"theta": 0.5 + relative * (1.0 / (1.0 + e) - 0.5)} if name == "moreau-jean" else {}


def impacts(run):
    return sum(event.kind == "impact" for event in run.events)


ROUNDING = 1e-10


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("name", DISSIPATING)
def test_impacts_never_leave_more_energy_than_there_was(name, scheme):
    @settings(max_examples=12)
    @given(
        e=st.one_of(st.just(1.0), st.floats(0.0, 1.0)),
        relative=st.floats(0.0, 1.0),
        h=st.floats(5e-4, 2e-2),
    )
    def never(e, relative, h):
        steps = 60 if METHODS[name].declared.order_impact > 1 else 1500
        found = li.simulate(SCHEMES[scheme](e), name, dt=h, t_end=steps * h, throw=False, **options(name, e, relative))
        assert found.ended
        assert gain(found, h) < ROUNDING

    never()


@pytest.mark.slow
@pytest.mark.parametrize("name", DISSIPATING)
def test_nor_do_thousands_of_impacts(name):
    """With e near 1, where little is lost that could hide a gain.

    A gain adds up within one run: each scheme is run long once, at e = 1, and twenty others of its kind are run for less.
    Methods that locate each impact take milliseconds for it, and are run long in the box alone.
    """
    located = METHODS[name].declared.order_impact > 1

    def gains_nothing(scheme, e, relative, h, steps):
        found = li.simulate(SCHEMES[scheme](e), name, dt=h, t_end=steps * h, throw=False, **options(name, e, relative))
        assert found.ended
        assert gain(found, h) < ROUNDING
        return found

    for scheme in SCHEMES:
        steps = 40_000 if not located else 25_000 if scheme == "box" else 1_500
        found = gains_nothing(scheme, 1.0, 0.0, 4e-3, steps)
        assert scheme != "box" or impacts(found) > 3000, "the balls go on bouncing"

    @settings(max_examples=20, database=None)
    @given(
        scheme=st.sampled_from(list(SCHEMES)),
        e=st.one_of(st.just(1.0), st.floats(0.99, 1.0)),
        relative=st.floats(0.0, 1.0),
        h=st.floats(1e-3, 8e-3),
    )
    def never(scheme, e, relative, h):
        gains_nothing(scheme, e, relative, h, 500 if located else 5_000)

    never()


@pytest.mark.parametrize(
    ("name", "scheme", "least"),
    [("generalized-alpha", "beaten", 0.05), ("rattle-ns", "beaten", 0.05), ("schatzman-paoli", "box", 0.5)],
)
def test_the_measure_sees_a_method_that_gains(name, scheme, least):
    assert not METHODS[name].declared.dissipates
    found = li.simulate(SCHEMES[scheme](1.0), name, dt=7e-3, t_end=3000 * 7e-3, progress=False, throw=False)
    assert gain(found, 7e-3) > least


@pytest.mark.parametrize("name", [name for name in METHODS_WITH_IMPACTS if name not in DISSIPATING])
def test_other_methods_lose_energy_too_where_impacts_take_much(name):
    found = li.simulate(ball(0.5), name, dt=1e-3, t_end=5.0, progress=False)
    E = energy(found)
    assert E[-1] < E[0] - 9.0
    assert E.max() < E[0] + 1e-3
