"""Tutorials of Siconos as numbers for ``siconos_others.py``, and the same systems here.

The data are those of siconos-tutorials at b6c9bfd194; positive is upwards as there, and balls are without the coordinates
that do not move.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from others_siconos import PYTHON, SCRIPT, bodies, versions
from peers_base import Example, run_by

from lcpimpact import (
    Bumper,
    Friction,
    Harmonic,
    LinearComplementaritySystem,
    Polynomial,
    PrescribedMotion,
    Problem,
    Scheme,
    Square,
    Table,
    load_problem,
)


@dataclass(frozen=True)
class System:
    """A tutorial as numbers: its step and end, what both programs are told, and what is said to this one alone."""

    data: dict
    h: float
    t_end: float
    options: dict = field(default_factory=dict)
    body: Problem | None = None


def ball() -> System:
    """Return BouncingBallTS."""
    return System(bodies([1.0], [-9.81], [[1.0]], [0.0], 0.9, q=[1.0]), 0.005, 10.0)


def beads() -> System:
    """Return ColumnOfBeadsTS: ten beads."""
    H = np.eye(10) - np.eye(10, k=-1)
    gaps, q = [-0.1] + 9 * [-0.2], (1.0 + 0.25 * np.arange(10)).tolist()
    return System(bodies([1.0] * 10, [-9.81] * 10, H.tolist(), gaps, 0.9, q=q), 5e-4, 2.0)


def two_balls() -> System:
    """Return TwoBouncingBallTS."""
    H, gaps = [[1.0, 0.0], [-1.0, 1.0]], [0.0, -0.2]
    return System(bodies([1.0, 2.0], [-9.81, -19.62], H, gaps, 0.95, q=[0.1, 0.301]), 1e-3, 3.0)


def bar(n: int = 40) -> System:
    """Return ImpactingBar with 40 of its 500 degrees of freedom, and its θ = 1."""
    E, A, rho, dx = 210e9, 0.000314, 7800.0, 1.0 / n
    K = E * A / dx * (2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    M = rho * A * dx / 6.0 * (4.0 * np.eye(n) + np.eye(n, k=1) + np.eye(n, k=-1))
    K[0, 0], K[-1, -1] = 0.5 * K[0, 0], 0.5 * K[-1, -1]
    M[0, 0], M[-1, -1] = 0.5 * M[0, 0], 0.5 * M[-1, -1]
    data = bodies([1.0] * n, [0.0] * n, np.eye(n)[:1].tolist(), [0.0], 0.0, q=[5e-5] * n, v=[-0.1] * n)
    return System({**data, "M": M.tolist(), "K": K.tolist()}, 2e-7, 1.5e-3, {"theta": 1.0})


def first_order(law: str, A: list, B: list, C: list, D: list, x: list, a: list | None = None) -> dict:
    """Return a first-order system."""
    a = [0.0] * len(x) if a is None else a
    return {"kind": "first order", "law": law, "A": A, "a": a, "B": B, "C": C, "D": D, "x": x}


def circuit() -> System:
    """Return CircuitRLCD, with γ = 1/2 as its θ."""
    L, capacity, R = 1e-2, 1e-6, 1e3
    A, B = [[0.0, -1.0 / capacity], [1.0 / L, 0.0]], [[-1.0 / capacity], [0.0]]
    data = first_order("complementarity", A, B, [[-1.0, 0.0]], [[R]], [-1.0, 0.0])
    return System({**data, "gamma": 0.5}, 1e-5, 5e-3)


def bridge() -> System:
    """Return DiodeBridge, with γ = 1/2 as its θ."""
    L, capacity, R = 1e-2, 1e-6, 1e3
    A, B = [[0, -1 / capacity], [1 / L, 0]], [[0, 0, -1 / capacity, 1 / capacity], [0, 0, 0, 0]]
    D = [[1 / R, 1 / R, -1, 0], [1 / R, 1 / R, 0, -1], [1, 0, 0, 0], [0, 1, 0, 0]]
    data = first_order("complementarity", A, B, [[0, 0], [0, 0], [-1, 0], [1, 0]], D, [10.0, 0.0])
    return System({**data, "gamma": 0.5}, 1e-6, 5e-3)


def colpitts() -> System:
    """Return ColpittsOscillator, to a fifth of its end."""
    L, C_1, C_2, R_c, R_e, α_F, α_R, V_C, V_E = 0.1, 2.0, 0.8, 10.0, 20.0, 0.99, 0.015, 10.0, 20.0
    A = [
        [-1 / (R_c * C_1), -1 / (R_c * C_1), 1 / C_1],
        [-1 / (R_c * C_2), -(1 / R_c + 1 / R_e) / C_2, 1 / C_2],
        [-1 / L, -1 / L, 0.0],
    ]
    a = [V_C / (R_c * C_1), (V_C / R_c - V_E / R_e) / C_2, V_C / L]
    B, C = [[1 / C_1, -α_F / C_1], [(1 - α_R) / C_2, (1 - α_F) / C_2], [0, 0]], [[1, 1, 0], [0, 1, 0]]
    return System(first_order("complementarity", A, B, C, [[0, 0], [0, 0]], [0.0, 0.0, 0.0], a), 1e-3, 20.0)


def two_relays() -> System:
    """Return SimpleExampleRelay."""
    two = np.eye(2).tolist()
    data = first_order("relay", [[0, 0], [0, 0]], [[2, 0], [0, 2]], two, [[0, 0], [0, 0]], [1.0, -1.0])
    return System(data, 1e-3, 1.0)


def filippov() -> System:
    """Return Filippov, to 1.8 of 10 s: at 2 s it has wound into the origin, in ever shorter turns."""
    α, two = 0.01, np.eye(2).tolist()
    B = [[500 * α, 500 * (1 - α)], [-500 * (1 - α), 500 * α]]
    return System(first_order("relay", [[0, 0], [0, 0]], B, two, [[0, 0], [0, 0]], [10.0, 10.0]), 1e-3, 1.8)


def oscillator() -> System:
    """Return RelayOscillator."""
    A, start = [[0, 1, 0], [0, 0, 1], [0, -3, -2]], 3.0 * np.sqrt(2.0) / (2.0 * np.pi)
    return System(first_order("relay", A, [[0], [0], [1]], [[1, 0, 0]], [[0]], [0.0, start, 0.0]), 1e-2, 100.0)


def friction() -> System:
    """Return FrictionOscillator."""
    return System(first_order("relay", [[0, 1], [-1, 0]], [[0], [1]], [[0, 1]], [[0]], [12.0, 6.0]), 1e-2, 100.0)


def spin() -> System:
    """Return Ball2D_kernel_only_with_friction: x, y upwards, and the angle, as a Lagrangian system here."""
    R, e, mu, omega = 0.5, 0.9, 0.1, 2.0
    start = {"q": [0.0, 1.0, 0.0], "v": [0.0, 0.0, omega], "mu": [mu]}
    data = bodies([1.0, 1.0, 0.4 * R**2], [0.0, -9.81, 0.0], [[0.0, 1.0, 0.0], [1.0, 0.0, R]], [-R], e, **start)
    known = load_problem("ball-with-spin", R=R, e=e, mu=mu)
    body = Problem("Ball2D", known.scheme, q0={"y": 1.0}, v0={"φ": omega}, t_end=10.0)
    return System(data, 0.005, 10.0, body=body)


def helical() -> System:
    """Return helical, to half its end: two relays, and a third state that rises."""
    α = 0.05
    B = [[-α / 2, 1 + α / 2], [-1 - α / 2, -α / 2], [0.0, 0.0]]
    C = [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]
    data = first_order("relay", np.zeros((3, 3)).tolist(), B, C, [[0, 0], [0, 0]], [10.0, 10.0, 0.0], [0.0, 0.0, 0.01])
    return System(data, 0.05, 200.0)


def chattering() -> System:
    """Return RelayOscillatorWithChattering."""
    ξ = 0.2
    A = [[0, 1, 0, 0], [-6, 0, 1, 0], [-4, 0, 0, 1], [-1, 0, 0, 0]]
    B, start = [[0.0], [1.0], [-2 * ξ], [ξ**2]], [-0.01, -0.02, -1.0, 0.5]
    return System(first_order("relay", A, B, [[1, 0, 0, 0]], [[0]], start), 1e-4, 5.0)


def sliding() -> System:
    """Return RelayOscillatorWithSliding, with its last set of parameters."""
    ξ, ω, λ = -0.07, 10.0, 0.05
    A = [[-(2 * ξ * ω + λ), 1, 0], [-(2 * ξ * ω * λ + ω**2), 0, 1], [-λ * ω**2, 0, 0]]
    return System(first_order("relay", A, [[1], [-2], [1]], [[1, 0, 0]], [[0]], [0.0, 0.5, 0.0]), 1e-2, 100.0)


def brakes() -> System:
    """Return train_tslcp: the pressure of the engine is let out at half the time."""
    n, R, S, C, D, u, ρ, w = 3, 100.0, 10.0, 1e-3, 1e-4, 7.5, 0.6667, 10.0
    one, ε = np.eye(n), ρ * u / n
    pipe = np.eye(n, k=1) + np.eye(n, k=-1) - 2.0 * one
    pipe[-1, -1] = -1.0
    A = np.block([[pipe / (R * C)] * 2, [pipe / (R * D)] * 2])
    B, C_y = np.vstack([0.0 * one, -one / D]), np.hstack([0.0 * one, -one])
    start = (1.0 - ρ) * np.repeat([u, -u], n) + ε * np.concatenate([np.arange(n), -np.arange(n, 2 * n)])
    data = first_order("complementarity", A.tolist(), B.tolist(), C_y.tolist(), (S * one).tolist(), start.tolist())
    inputs = [[0, "until", w / (R * C), 5.0], [n, "until", w / (R * D), 5.0]]
    return System({**data, "inputs": inputs}, 1e-3, 10.0)


def filtered() -> System:
    """Return DiodeBridgeCapFilter, with its θ = 1."""
    L, C, R, C_f = 1e-2, 1e-6, 1e3, 300e-9
    A = [[0.0, -1 / C, 0.0], [1 / L, 0.0, 0.0], [0.0, 0.0, -1 / (R * C_f)]]
    B = [[0.0, 0.0, -1 / C, 1 / C], [0.0, 0.0, 0.0, 0.0], [1 / C_f, 0.0, 1 / C_f, 0.0]]
    C_y = [[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [-1.0, 0.0, 1.0], [1.0, 0.0, 0.0]]
    D = [[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 1.0, -1.0], [0.0, -1.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]]
    return System(first_order("complementarity", A, B, C_y, D, [10.0, 0.0, 0.0]), 1e-6, 5e-3, {"theta": 1.0})


def converter() -> System:
    """Return PRC, a parallel resonant converter on a square wave of 55 kHz."""
    L_f, C_f, L_r, C_r, R = 0.4e-3, 2.2e-6, 150e-6, 68e-9, 33.0
    A = [[0, -1 / L_r, 0, 0], [1 / C_r, 0, 0, 0], [0, 0, 0, -1 / L_f], [0, 0, 1 / C_f, -1 / (R * C_f)]]
    B = [[0, 0, 0, 0], [-1 / C_r, 1 / C_r, 0, 0], [0, 0, 1 / L_f, 1 / L_f], [0, 0, 0, 0]]
    C_y = [[0, -1, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 1, 0]]
    D = [[0, 0, 1, 0], [0, 0, 0, 1], [-1, 0, 0, 0], [0, -1, 0, 0]]
    data = first_order("complementarity", A, B, C_y, D, [0.0, 0.0, 0.0, 0.0])
    return System({**data, "inputs": [[0, "square", 1 / L_r, 2.0 * np.pi * 55000.0]]}, 5e-8, 2e-3)


def supplied() -> System:
    """Return DiodeBridgePowSup: diodes with a threshold of 0.21 V between a source and a filter."""
    R, C_f, V = 1e3, 300e-9, 0.21
    D = [[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 1.0, -1.0], [0.0, -1.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]]
    C_y, B = [[1.0], [0.0], [1.0], [0.0]], [[1 / C_f, 0.0, 1 / C_f, 0.0]]
    data = first_order("complementarity", [[-1 / (R * C_f)]], B, C_y, D, [0.0])
    offsets = [[2, "harmonic", -10.0, 1e4], [3, "harmonic", 10.0, 1e4]]
    return System({**data, "c": [2 * V, 0.0, 2 * V, 0.0], "offsets": offsets}, 1e-6, 5e-3)


def two_masses() -> System:
    """Return TwoDofsFrictionOscillator."""
    A = [[0, 1, 0, 0], [-2, 0, 1, 0], [0, 0, 0, 1], [1, 0, -1, 0]]
    data = first_order("relay", A, [[0], [0], [0], [1]], [[0, 0, 0, 1]], [[0]], [1.0, 0.0, 0.0, 0.0])
    return System({**data, "bound": 0.5, "inputs": [[1, "harmonic", 1.0, 0.3]]}, 5e-2, 500.0)


def gammas(system: System) -> System:
    """Return a circuit of Circuit-ThetaGammaSchemes: γ = 1/2 for the relation too."""
    return System({**system.data, "gamma": 0.5, "for_relation": True}, system.h, system.t_end)


def moving_plane() -> System:
    """Return BallOnMovingPlane: the plane has the velocity 2 + cos π t/2."""
    data = bodies([1.0, 1.0], [-9.81, -9.81], [[1.0, -1.0]], [0.0], 0.9, q=[1.0, 0.0], v=[0.0, 3.0])
    return System({**data, "driven": [1, 2.0, 1.0, np.pi / 2.0]}, 0.005, 10.0)


def beam(n: int = 10) -> System:
    """Return ImpactingEBBeam with 10 of its 100 elements: a ball strikes the free end of a cantilever."""
    E, R, L, rho = 210e9, 0.01, 1.0, 7800.0
    inertia, area, length = 3.14 / 4.0 * R**4, 3.14 * R**2, L / n
    lengths = np.outer(*[[1.0, length, 1.0, length]] * 2)
    K_e = E * inertia / length**3 * lengths * [[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]]
    M_e = rho * area * length / 420.0 * lengths * [
        [156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]
    ]  # fmt: skip
    K, M = np.zeros((2, 2 * n + 2, 2 * n + 2))
    for i in range(0, 2 * n, 2):
        K[i : i + 4, i : i + 4] += K_e
        M[i : i + 4, i : i + 4] += M_e
    free = np.arange(2 * n)  # the last node is clamped; its place is the ball's
    K, M = (np.pad(each[np.ix_(free, free)], (0, 1)) for each in (K, M))
    M[-1, -1] = 1.0
    H = np.zeros((1, 2 * n + 1))
    H[0, 0], H[0, -1] = -1.0, 1.0
    zero = [0.0] * (2 * n)
    data = bodies([1.0] * (2 * n + 1), [*zero, 0.0], H.tolist(), [0.0], 0.0, q=[*zero, 1e-6], v=[*zero, -2.0])
    return System({**data, "M": M.tolist(), "K": K.tolist()}, 1e-3, 0.1)


def woodpecker() -> System:
    """Return WoodPecker, with the sleeve on the pole at the start: not 0.9 µm inside of it, but by more than rounding."""
    r_O, r_M, h_M, l_M, l_G, h_S, l_S = 0.0025, 0.0031, 0.0058, 0.010, 0.015, 0.02, 0.0201
    m_M, m_S, J_M, J_S, c, g = 0.0003, 0.0045, 5e-9, 7e-7, 0.0056, 9.81
    M = [
        [m_S + m_M, m_S * l_M, m_S * l_G],
        [m_S * l_M, J_M + m_S * l_M**2, m_S * l_M * l_G],
        [m_S * l_G, m_S * l_M * l_G, J_S + m_S * l_G**2],
    ]
    H = [[0, 0, -h_S], [1, l_M, l_G - l_S], [0, h_M, 0], [1, r_M, 0], [0, -h_M, 0], [1, r_M, 0]]
    f = [-(m_S + m_M) * g, -m_S * l_M * g, -m_S * l_G * g]
    gaps = [l_M + l_G - l_S - r_O, r_M - r_O, r_M - r_O]
    start = {
        "q": [0.0, -(r_M - r_O) / h_M - 1e-12, -0.2788],
        "v": [-0.3411, 0.0, -7.4583],
        "mu": [0.3] * 3,
        "tol": 1e-10,
    }
    data = bodies([1.0] * 3, f, H, gaps, 0.0, **start)
    return System({**data, "M": M, "K": [[0, 0, 0], [0, c, -c], [0, -c, c]], "e": [0.5, 0.0, 0.0]}, 2e-5, 0.3)


def by_events(data: dict, h: float, t_end: float) -> System:
    """Return a system that both programs run by events, and so that instants of the grid are compared."""
    return System({**data, "kind": "events"}, h, t_end)


def ball_by_events() -> System:
    """Return BouncingBallED."""
    return by_events(ball().data, 0.005, 8.5)


def oscillator_by_events() -> System:
    """Return LinearOscillatorED, to 0.33 of 8.5 s: at 0.335 s Siconos throws an exception that it does not explain."""
    stiff = [[100.0, 0.0], [0.0, 100.0]]
    data = bodies([1e-3, 1e-3], [-9.81e-3, 0.0], [[1.0, 0.0]], [0.0], 0.9, q=[1.0, 1e-3], K=stiff)
    return by_events(data, 0.005, 0.33)


def beads_by_events() -> System:
    """Return BeadColumnED_NewtonLaw: ten touching beads and e = 1."""
    R, n = 0.005, 10
    m = 4.0 / 3.0 * 3.14159265 * R**3 * 7780.0
    H = np.eye(n) - np.eye(n, k=-1)
    q = (0.05 + R + 2.0 * R * np.arange(n)).tolist()
    return by_events(bodies([m] * n, [-9.81 * m] * n, H.tolist(), [-R] + (n - 1) * [-2 * R], 1.0, q=q), 1e-3, 0.5)


EXAMPLES: dict[str, Callable[[], System]] = {
    "BouncingBallTS": ball,
    "ColumnOfBeadsTS": beads,
    "TwoBouncingBallTS": two_balls,
    "ImpactingBar, 40 of 500": bar,
    "ImpactingEBBeam, 10 of 100": beam,
    "BallOnMovingPlane": moving_plane,
    "Ball2D_kernel_only_with_friction": spin,
    "WoodPecker": woodpecker,
    "FrictionOscillator": friction,
    "TwoDofsFrictionOscillator": two_masses,
    "BouncingBallED": ball_by_events,
    "LinearOscillatorED": oscillator_by_events,
    "BeadColumnED_NewtonLaw": beads_by_events,
    "CircuitRLCD": circuit,
    "CircuitRLCD-ThetaGammaSchemes": lambda: gammas(circuit()),
    "DiodeBridge": bridge,
    "DiodeBridge-ThetaGammaSchemes": lambda: gammas(bridge()),
    "DiodeBridgeCapFilter": filtered,
    "DiodeBridgeCapFilter-ThetaGammaSchemes": lambda: gammas(filtered()),
    "DiodeBridgePowSup": supplied,
    "ColpittsOscillator": colpitts,
    "PRC": converter,
    "train_tslcp": brakes,
    "SimpleExampleRelay": two_relays,
    "Filippov": filippov,
    "helical": helical,
    "RelayOscillator": oscillator,
    "RelayOscillatorWithChattering": chattering,
    "RelayOscillatorWithSliding": sliding,
}


def signal(name: str, *values: float) -> Any:
    """Return a signal of ``siconos_others.py``."""
    if name == "harmonic":
        return Harmonic(*values)
    if name == "square":
        return Square(*values, phase=-0.5 * np.pi)
    value, end = values
    return Table([0.0, end, end], [value, value, 0.0])


def circuit_or_relay(d: dict) -> LinearComplementaritySystem:
    """Return a first-order system."""
    a, c = list(d["a"]), list(d.get("c", [0.0] * len(d["C"])))
    for terms, key in ((a, "inputs"), (c, "offsets")):
        for row, name, *values in d.get(key, ()):
            terms[row] = signal(name, *values) + terms[row] if terms[row] else signal(name, *values)
    rows, b = len(d["C"]), d.get("bound", 1.0)
    bounds = {"lower": [-b] * rows, "upper": [b] * rows} if d["law"] == "relay" else {}
    states = [f"x{i + 1}" for i in range(len(d["x"]))]
    return LinearComplementaritySystem(d["A"], d["B"], d["C"], d["D"], a=a, c=c, states=states, **bounds)


def masses(d: dict) -> Scheme:
    """Return a mechanical system, with friction where there are coefficients."""
    H, n = np.array(d["H"], dtype=float), len(d["q"])
    names = [f"q{i + 1}" for i in range(n)]
    normal = H if "mu" not in d else H[::2]
    contacts = [f"N{i + 1}" for i in range(len(normal))]
    if "driven" in d:  # the second body is driven
        row, mean, amplitude, omega = d["driven"]
        scheme = Scheme.of_matrices([[d["M"][0][0]]], f=d["f"][:1])
        moves = Polynomial([0.0, mean]) + Harmonic(amplitude / omega, omega, -0.5 * np.pi)
        return scheme.add(PrescribedMotion(names[row], moves), Bumper(names[row], names[0], 0.0, d["e"][0]))
    scheme = Scheme.of_matrices(d["M"], d["C"], d["K"], d["f"], H=normal, gaps=d["gaps"], e=d["e"], contacts=contacts)
    for slip, mu, contact in zip(H[1::2], d.get("mu", ()), contacts, strict=False):
        along = {name: float(part) for name, part in zip(names, slip, strict=True) if part}
        scheme.add(Friction(along, "ground", mu, normal=contact))
    return scheme


def example(name: str) -> Example:
    """Return a tutorial as an example."""
    found = EXAMPLES[name]()
    d = {**found.data, **found.options}
    run = {"h": found.h, "t_end": found.t_end, "data": d, "options": found.options}
    if found.body:
        return Example(found.body, **run, judge="event-driven", judge_options={"rtol": 1e-12, "atol": 1e-13})
    if d["kind"] == "first order":
        judge = "radau" if name == "PRC" else "exact"
        states = [f"x{i + 1}" for i in range(len(d["x"]))]
        problem = Problem(name, circuit_or_relay(d), q0=dict(zip(states, d["x"], strict=True)), t_end=found.t_end)
        return Example(problem, **run, columns=tuple(states), judge=judge)
    names = [f"q{i + 1}" for i in range(len(d["q"]))]
    moved = names[:1] if "driven" in d else names
    q0, v0 = ({n: d[key][i] for i, n in enumerate(moved)} for key in ("q", "v"))
    problem = Problem(name, masses(d), q0=q0, v0=v0, t_end=found.t_end)
    by_events = d["kind"] == "events"
    method = "event-driven" if by_events else "moreau-jean"
    return Example(problem, **run, columns=tuple(names), method=method)


def version(python: str) -> str:
    """Return the version of Siconos, which Debian's Python has, or raise `RuntimeError`."""
    return versions()["siconos"]


def theirs(example: Example, repeats: int, python: str) -> tuple[np.ndarray, float]:
    """Return q or x by Siconos, and the median of its seconds of CPU."""
    return run_by(PYTHON, SCRIPT, example, repeats)
