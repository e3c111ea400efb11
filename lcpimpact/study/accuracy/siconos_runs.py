"""Runs by Siconos, executed by the Python that has it; independent of lcpimpact.

Standard input is a JSON list of jobs, each with the matrices of a system and its step; the last line of standard output
contains the computed steps.
"""

import json
import sys

import numpy as np


def lagrangian(M, C, K, f, H, u0, e, q0, v0, theta, h, steps, mu=None):  # type: ignore[no-untyped-def]
    """M q'' + C q' + K q = f + Hᵀ r, 0 <= r ⟂ u = H q + u0 >= 0, with Newton's law, by MoreauJeanOSI.

    With mu (nc,) the rows of H, u0 and e are pairs, a normal one and the tangential one with its friction.
    """
    import siconos.kernel as sk  # type: ignore[import-not-found]
    import siconos.numerics as sn  # type: ignore[import-not-found]

    M = np.array(M, dtype=float)
    C = np.array(C, dtype=float)
    K = np.array(K, dtype=float)
    f = np.array(f, dtype=float)
    H = np.array(H, dtype=float)
    u0 = np.array(u0, dtype=float)
    system = sk.LagrangianLinearTIDS(np.array(q0), np.array(v0), M, K, C)
    system.setFExtPtr(f)
    world = sk.NonSmoothDynamicalSystem(0.0, (steps + 0.5) * h)
    world.insertDynamicalSystem(system)
    owned = []
    rows = 1 if mu is None else 2
    for k in range(0, len(H), rows):
        relation = sk.LagrangianLinearTIR(H[k : k + rows].copy(), u0[k : k + rows].copy())
        law = sk.NewtonImpactNSL(e[k]) if mu is None else sk.NewtonImpactFrictionNSL(e[k], 0.0, mu[k // 2], 2)
        contact = sk.Interaction(law, relation)
        world.link(contact, system)
        owned.append((relation, contact))
    problem = sk.LCP() if mu is None else sk.FrictionContact(2, sn.SICONOS_FRICTION_2D_LEMKE)
    problem.numericsSolverOptions().dparam[sn.SICONOS_DPARAM_TOL] = 1e-14
    simulation = sk.TimeStepping(world, sk.TimeDiscretisation(0.0, h), sk.MoreauJeanOSI(theta), problem)
    q, v = [q0], [v0]
    for _ in range(steps):
        simulation.computeOneStep()
        q.append(system.q().tolist())
        v.append(system.velocity().tolist())
        simulation.nextStep()
    return {"q": q, "v": v}


def first_order(A, b, B, C, D, x0, theta, gamma, h, steps, bound=None):  # type: ignore[no-untyped-def]
    """0 <= λ ⟂ C x + D λ >= 0 with x' = A x + b + B λ, by EulerMoreauOSI; γ weights λ, and u if γ is not 1.

    With a bound the rows are relays, -bound <= λ <= bound.
    """
    import siconos.kernel as sk

    A = np.array(A, dtype=float)
    b = np.array(b, dtype=float)
    B = np.array(B, dtype=float)
    C = np.array(C, dtype=float)
    D = np.array(D, dtype=float)
    system = sk.FirstOrderLinearTIDS(np.array(x0), A, b)
    relation = sk.FirstOrderLinearTIR(C, B)
    if D.any():
        relation.setDPtr(D)
    law = sk.ComplementarityConditionNSL(len(C)) if bound is None else sk.RelayNSL(len(C), -bound, bound)
    contact = sk.Interaction(law, relation)
    world = sk.NonSmoothDynamicalSystem(0.0, (steps + 0.5) * h)
    world.insertDynamicalSystem(system)
    world.link(contact, system)
    method = sk.EulerMoreauOSI(theta) if gamma == 1.0 else sk.EulerMoreauOSI(theta, gamma)
    if gamma != 1.0:
        method.setUseGammaForRelation(True)
    problem = sk.LCP() if bound is None else sk.Relay()
    simulation = sk.TimeStepping(world, sk.TimeDiscretisation(0.0, h), method, problem)
    x, λ = [x0], []
    for _ in range(steps):
        simulation.computeOneStep()
        x.append(system.x().tolist())
        λ.append(contact.lambda_(0).tolist())
        simulation.nextStep()
    return {"x": x, "lambda": λ}


if __name__ == "__main__":
    jobs = json.load(sys.stdin)
    runs = {"lagrangian": lagrangian, "first_order": first_order}
    json.dump([runs[job.pop("kind")](**job) for job in jobs], sys.stdout)  # type: ignore[operator]
