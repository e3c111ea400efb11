"""Tutorials of Siconos in Siconos 4.5, whose Python modules are others than those of 4.4, for `peers_siconos_newer.py`.

It needs a Python in which Siconos 4.5 is installed, and reads what ``siconos_others.py`` reads. Its last line is JSON: the
state at the instants of the steps, and the median of the CPU times of the repeats.
"""

import json
import statistics
import sys
import time

import numpy as np
import siconos.integrators as si
import siconos.modeling as sm
import siconos.nonsmooth_formulations as sf
import siconos.simulation as ss
from siconos.numerics._numerics import solver_ids


def columns(values):
    """Return a matrix in the order of Siconos."""
    return np.asfortranarray(np.array(values, dtype=float))


def mechanical(h, t_end, M, K, C, f, H, gaps, e, q, v, theta=0.5, mu=None):
    """Return simulation, state, and what is not to be freed; places are those where gaps are zero, for want of offsets."""
    M, K, C, H, f, v = columns(M), columns(K), columns(C), columns(H), np.array(f), np.array(v)
    rows = 1 if mu is None else 2
    openings = np.zeros(len(H))
    openings[::rows] = gaps
    shift = np.linalg.lstsq(H, openings, rcond=None)[0]
    body = sm.LagrangianLinearTIDS(np.array(q) + shift, v, M, sm.copy_t)
    body.setStiffnessMatrix(K, sm.copy_t)
    body.setDampingMatrix(C, sm.copy_t)
    body.setConstantFext(f + K @ shift, sm.copy_t)
    world = world_of(t_end, h, body)
    owned = []
    for k, each in enumerate(e):
        part = columns(H[rows * k : rows * (k + 1)])
        law = sm.NewtonImpactNSL(each) if mu is None else sm.NewtonImpactFrictionNSL(each, 0.0, mu[k], 2)
        owned += [part, sm.Interaction(law, sm.LagrangianLinearTIR(part))]
        world.link(owned[-1], body)
    problem = sf.LCP() if mu is None else sf.FrictionContact(2, int(solver_ids.SICONOS_FRICTION_2D_NSGS))
    simulation = ss.TimeStepping(world, ss.TimeDiscretisation(0.0, h), si.MoreauJeanOSI(theta), problem)
    return simulation, lambda: np.ravel(body.q()) - shift, (body, world, owned)


def world_of(t_end, h, system):
    """Return the world of a system."""
    world = sm.NonSmoothDynamicalSystem(0.0, t_end + 0.5 * h)
    world.insertDynamicalSystem(system)
    return world


def first_order(h, t_end, A, a, B, C, D, x, law, theta=0.5, gamma=None, for_relation=False):
    """Return the same of a first-order system."""
    A, B, C, D = (columns(each) for each in (A, B, C, D))
    system = sm.FirstOrderLinearDS(np.array(x, dtype=float), A, np.array(a, dtype=float), sm.copy_t)
    relation = sm.FirstOrderLinearTIR(C, B)
    relation.setConstantD(D)
    relay = law == "relay"
    law = sm.RelayNSL(len(C), -1.0, 1.0) if relay else sm.ComplementarityConditionNSL(len(C))
    contact = sm.Interaction(law, relation)
    world = world_of(t_end, h, system)
    world.link(contact, system)
    step = si.EulerMoreauOSI(theta) if gamma is None else si.EulerMoreauOSI(theta, gamma)
    step.useGammaForRelation = for_relation
    problem = sf.Relay(int(solver_ids.SICONOS_RELAY_LEMKE)) if relay else sf.LCP()
    simulation = ss.TimeStepping(world, ss.TimeDiscretisation(0.0, h), step, problem)
    return simulation, lambda: np.array(system.x(), copy=True).ravel(), (A, B, C, D, world, contact)


def run(kind, h, t_end, **data):
    """Return the states and the seconds of a run from the building of the model to its end."""
    began = time.process_time()
    simulation, read, owned = {"mechanical": mechanical, "first order": first_order}[kind](h, t_end, **data)
    found = [read()]
    for _ in range(round(t_end / h)):
        simulation.computeOneStep()
        found.append(read())
        simulation.nextStep()
    del owned
    return found, time.process_time() - began


def main(repeats, **data):
    """Run it as often as asked, and print what it found."""
    runs = [run(**data) for _ in range(repeats)]
    print()
    print(json.dumps({"q": np.array(runs[-1][0]).tolist(), "seconds": statistics.median(each for _, each in runs)}))


if __name__ == "__main__":
    main(**json.loads(sys.stdin.read()))
