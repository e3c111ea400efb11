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


def contacts(h, t_end, body, H, gaps, e, mu):
    """Return the world of a body that touches at H q + gap, with rows for friction where mu is given, and what it owns."""
    world = sk.NonSmoothDynamicalSystem(0.0, t_end + 0.5 * h)
    world.insertDynamicalSystem(body)
    H, owned = np.array(H, dtype=float), []
    rows = 1 if mu is None else 2
    for k, gap in enumerate(gaps):
        relation = sk.LagrangianLinearTIR(H[rows * k : rows * (k + 1)].copy(), np.array([gap, 0.0][:rows]))
        law = sk.NewtonImpactNSL(e[k]) if mu is None else sk.NewtonImpactFrictionNSL(e[k], 0.0, mu[k], 2)
        contact = sk.Interaction(law, relation)
        world.link(contact, body)
        owned += [relation, contact]
    return world, owned


def linear(M, K, C, f, q, v):
    """Return the body with M q'' + C q' + K q = f, and what it owns."""
    load = np.array(f, dtype=float)
    body = sk.LagrangianLinearTIDS(q, v, np.array(M), np.array(K), np.array(C))
    body.setFExtPtr(load)
    return body, load


def mechanical(h, t_end, M, K, C, f, H, gaps, e, q, v, theta=0.5, mu=None, harmonic=None, driven=None, tol=None):
    """Return simulation, body, and what is not to be freed: M q'' + C q' + K q = f + Hᵀ r with impacts at H q + gap.

    ``driven`` is [i, V, A, ω] where v_i = V + A cos ω t.
    """
    body, load = linear(M, K, C, f, q, v)
    owned = [load]
    if driven:
        row, mean, swing, rate = driven
        moved = sk.BoundaryCondition([row], np.zeros(1))
        owned.append(moved)
        body.setBoundaryConditions(moved)
    world, held = contacts(h, t_end, body, H, gaps, e, mu)
    problem = sk.LCP() if mu is None else sk.FrictionContact(2)
    if tol:
        problem.numericsSolverOptions().dparam[0] = tol
        problem.numericsSolverOptions().iparam[0] = 10_000
    simulation = sk.TimeStepping(world, sk.TimeDiscretisation(0.0, h), sk.MoreauJeanOSI(theta), problem)
    states = body.q(), body.velocity()

    def prepare(k):
        if harmonic:  # the θ-step with θ = 1/2 takes the mean of the force at its ends
            amplitude, omega, phase = harmonic
            body.fExt()[0] = np.mean([amplitude * np.cos(omega * h * i + phase) for i in (k, k + 1)])
        if driven:
            moved.prescribedVelocity()[0] = mean + swing * np.cos(rate * h * (k + 1))

    return simulation, prepare, lambda: (*states, None), (world, body, owned, held)


def events(h, t_end, M, K, C, f, H, gaps, e, q, v):
    """Return the same by events, between which LSODAR integrates."""
    body, load = linear(M, K, C, f, q, v)
    world, held = contacts(h, t_end, body, H, gaps, e, None)
    step = sk.LsodarOSI()
    simulation = sk.EventDriven(world, sk.TimeDiscretisation(0.0, h))
    simulation.insertIntegrator(step)
    laws = sk.LCP(), sk.LCP()
    simulation.insertNonSmoothProblem(laws[0], sk.SICONOS_OSNSP_ED_IMPACT)
    simulation.insertNonSmoothProblem(laws[1], sk.SICONOS_OSNSP_ED_SMOOTH_ACC)
    return simulation, None, lambda: (body.q(), body.velocity(), None), (world, body, load, held, step, laws)


SIGNALS = {
    "harmonic": lambda t, amplitude, omega: amplitude * np.cos(omega * t),
    "square": lambda t, amplitude, omega: amplitude * np.sign(np.sin(omega * t)),
    "until": lambda t, value, end: value if t < end else 0.0,
}


def first_order(
    h,
    t_end,
    A,
    a,
    B,
    C,
    D,
    x,
    law,
    theta=0.5,
    gamma=None,
    for_relation=False,
    falling=None,
    bound=1.0,
    inputs=(),
    offsets=(),
    c=None,
):
    """Return the same of X' = A X + a + B λ, w = C X + D λ + c, complementary or a relay of ± bound.

    ``falling`` is the slope of -a_0, and ``inputs`` and ``offsets`` are signals [i, name, parameters] in a_i and c_i;
    ``for_relation`` says that γ is for the relation too.
    """
    A, a, B, C, D = (np.array(each, dtype=float) for each in (A, a, B, C, D))
    system, start = sk.FirstOrderLinearDS(x, A, a), a.copy()
    relation = sk.FirstOrderLinearTIR(C, B)
    relation.setDPtr(D)
    size = len(C)
    fixed = np.zeros(size) if c is None else np.array(c, dtype=float)
    if offsets or c:
        relation.setePtr(fixed)
    relay = law == "relay"
    law = sk.RelayNSL(size, -bound, bound) if relay else sk.ComplementarityConditionNSL(size)
    contact = sk.Interaction(law, relation)
    world = sk.NonSmoothDynamicalSystem(0.0, t_end + 0.5 * h)
    world.insertDynamicalSystem(system)
    world.link(contact, system)
    step = sk.EulerMoreauOSI(theta) if gamma is None else sk.EulerMoreauOSI(theta, gamma)
    step.setUseGammaForRelation(for_relation)
    problem = sk.LCP()
    if relay:
        problem = sk.Relay()
        problem.setSolverId(sn.SICONOS_RELAY_LEMKE)
        problem.numericsSolverOptions().dparam[0] = 1e-8
    simulation = sk.TimeStepping(world, sk.TimeDiscretisation(0.0, h), step, problem)
    state, force = system.x(), contact.lambda_(0)

    def prepare(k):
        if falling:
            system.b()[0] = start[0] - falling * h * (k + 0.5)
        for row, name, *values in inputs:
            inside = 0.0 if name == "harmonic" else 1e-6  # where a signal jumps, its limit within the step
            old, new = (SIGNALS[name](h * i, *values) for i in (k + inside, k + 1 - inside))
            system.b()[row] = start[row] + (1.0 - theta) * old + theta * new
        for row, name, *values in offsets:
            relation.e()[row] = fixed[row] + SIGNALS[name](h * (k + 1), *values)

    owned = world, A, a, B, C, D, relation, contact, system, law, step, fixed
    return simulation, prepare, lambda: (state, state, force), owned


def run(kind, steps, **data):
    """Return t, q, v, force and the seconds of a run from the building of the model to its end."""
    began = time.process_time()
    simulation, prepare, read, owned = {"mechanical": mechanical, "first order": first_order, "events": events}[kind](
        **data
    )
    q, v, force = read()
    rows_q, rows_v, forces = [q.copy()], [v.copy()], [0.0]
    k, h = 0, data["h"]
    while k < steps:
        if kind == "events":
            simulation.advanceToEvent()
            simulation.processEvents()
            if simulation.startingTime() < h * (k + 1) - 1e-6 * h:
                continue  # an impact between two instants of the grid
        else:
            prepare(k)
            simulation.computeOneStep()
        q, v, force = read()
        rows_q.append(q.copy())
        rows_v.append(v.copy())
        forces.append(0.0 if force is None else force[0])
        if kind != "events":
            simulation.nextStep()
        k += 1
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
    main(**json.loads(sys.argv[1] if len(sys.argv) > 1 else sys.stdin.read()))
