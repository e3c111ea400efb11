#!/usr/bin/python3
"""Siconos on the problems of `others.py`: it belongs to Debian's Python (python3-siconos).

    /usr/bin/python3 siconos_others.py '{"kind": "mechanical", "M": [[1.0]], ...}'

Written after Siconos' tutorials: BouncingBallTS for bodies, FrictionOscillator and Filippov for relays, DiodeBridge for
first-order systems; friction as NewtonImpactFrictionNSL. Its last line is JSON: t, q, v, the force, and the median of
the CPU times of the repeats, each of which builds the model and takes all the steps.
"""

import json
import statistics
import sys
import time

import numpy as np
import siconos.kernel as sk
import siconos.numerics as sn


def mechanical(h, t_end, M, K, C, f, H, gaps, e, q, v, theta=0.5, mu=None, harmonic=None):
    """Return simulation, body, and what is not to be freed: M q'' + C q' + K q = f + Hᵀ r with impacts at H q + gap."""
    load = np.array(f, dtype=float)
    body = sk.LagrangianLinearTIDS(q, v, np.array(M), np.array(K), np.array(C))
    body.setFExtPtr(load)
    world = sk.NonSmoothDynamicalSystem(0.0, t_end + 0.5 * h)
    world.insertDynamicalSystem(body)
    H, owned = np.array(H, dtype=float), [load]
    rows = 1 if mu is None else 2
    for k, gap in enumerate(gaps):
        relation = sk.LagrangianLinearTIR(H[rows * k : rows * (k + 1)].copy(), np.array([gap, 0.0][:rows]))
        law = sk.NewtonImpactNSL(e[k]) if mu is None else sk.NewtonImpactFrictionNSL(e[k], 0.0, mu[k], 2)
        contact = sk.Interaction(law, relation)
        world.link(contact, body)
        owned += [relation, contact]
    problem = sk.LCP() if mu is None else sk.FrictionContact(2)
    simulation = sk.TimeStepping(world, sk.TimeDiscretisation(0.0, h), sk.MoreauJeanOSI(theta), problem)
    states = body.q(), body.velocity()

    def prepare(k):
        if harmonic:  # the θ-step with θ = 1/2 takes the mean of the force at its ends
            amplitude, omega, phase = harmonic
            body.fExt()[0] = np.mean([amplitude * np.cos(omega * h * i + phase) for i in (k, k + 1)])

    return simulation, prepare, lambda: (*states, None), (world, body, owned)


def first_order(h, t_end, A, a, B, C, D, x, law, theta=0.5, gamma=None, falling=None):
    """Return the same of X' = A X + a + B λ, w = C X + D λ, complementary or a relay; ``falling`` is the slope of -a_0."""
    A, a, B, C, D = (np.array(each, dtype=float) for each in (A, a, B, C, D))
    system, start = sk.FirstOrderLinearDS(x, A, a), float(a[0])
    relation = sk.FirstOrderLinearTIR(C, B)
    relation.setDPtr(D)
    size = len(C)
    relay = law == "relay"
    contact = sk.Interaction(sk.RelayNSL(size, -1, 1) if relay else sk.ComplementarityConditionNSL(size), relation)
    world = sk.NonSmoothDynamicalSystem(0.0, t_end + 0.5 * h)
    world.insertDynamicalSystem(system)
    world.link(contact, system)
    step = sk.EulerMoreauOSI(theta) if gamma is None else sk.EulerMoreauOSI(theta, gamma)
    problem = sk.LCP()
    if relay:
        problem = sk.Relay()
        problem.setSolverId(sn.SICONOS_RELAY_LEMKE)
        problem.numericsSolverOptions().dparam[0] = 1e-8
    simulation = sk.TimeStepping(world, sk.TimeDiscretisation(0.0, h), step, problem)
    state, force = system.x(), contact.lambda_(0)

    def prepare(k):
        if falling:
            system.b()[0] = start - falling * h * (k + 0.5)

    return simulation, prepare, lambda: (state, state, force), (world, A, a, B, C, D, relation, contact, system)


def run(kind, steps, **data):
    """Return t, q, v, force and the seconds of a run from the building of the model to its end."""
    began = time.process_time()
    simulation, prepare, read, owned = {"mechanical": mechanical, "first order": first_order}[kind](**data)
    q, v, force = read()
    rows_q, rows_v, forces = [q.copy()], [v.copy()], [0.0]
    for k in range(steps):
        prepare(k)
        simulation.computeOneStep()
        q, v, force = read()
        rows_q.append(q.copy())
        rows_v.append(v.copy())
        forces.append(0.0 if force is None else force[0])
        simulation.nextStep()
    del owned
    return np.array(rows_q), np.array(rows_v), np.array(forces), time.process_time() - began


def main(repeats, **data):
    """Run it as often as asked, and print what it found."""
    h = data["h"]
    steps = round(data["t_end"] / h)
    runs = [run(steps=steps, **data) for _ in range(repeats)]
    q, v, force, _ = runs[-1]
    found = {"t": (h * np.arange(steps + 1)).tolist(), "q": q.tolist(), "v": v.tolist(), "force": force.tolist()}
    print()
    print(json.dumps({**found, "seconds": statistics.median(each[3] for each in runs)}))


if __name__ == "__main__":
    main(**json.loads(sys.argv[1]))
