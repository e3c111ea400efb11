"""The same problems by the same steps in Siconos: MoreauJeanOSI and EulerMoreauOSI agree with moreau-jean to 1e-9.

Skipped where Siconos is not installed (Debian: ``apt-get install python3-siconos``, which belongs to /usr/bin/python3).
"""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import lcpimpact as li
from lcpimpact.study.accuracy.siconos import INSTALL, python_with_siconos, run_siconos


@pytest.fixture
def siconos():
    if python_with_siconos() is None:
        pytest.skip(f"Siconos is {INSTALL}")
    return run_siconos


def lagrangian(siconos, problem, theta, h, steps):
    d = problem.dynamics
    return siconos(
        kind="lagrangian", M=d.M, C=d.C, K=d.K, f=d.force(0.0), H=d.H, u0=d.u0, e=d.restitution,
        q0=problem.initial_coordinates, v0=problem.initial_velocities, theta=theta, h=h, steps=steps,
    )  # fmt: skip


def column_of_beads(n=6, e=0.4):
    """Beads one above the other, with air between them, fall on the ground; the masses differ, so nothing is a tie."""
    elements = []
    for i in range(n):
        m = 1.0 + 0.13 * i
        below = f"b{i + 1}" if i + 1 < n else "ground"
        elements += [li.Mass(f"b{i}", m), li.Load(f"b{i}", 9.81 * m), li.Bumper(f"b{i}", below, 0.1, e, name=f"R{i}")]
    return li.Problem("column of beads", li.Scheme(*elements))


@pytest.mark.parametrize("theta", [0.5, 0.7, 1.0])
@pytest.mark.parametrize("e", [0.0, 0.5, 0.9])
def test_bouncing_ball(siconos, e, theta):
    problem = li.load_problem("bouncing-ball", e=e)
    h, steps = 1e-3, 3000
    peer = lagrangian(siconos, problem, theta, h, steps)
    run = li.simulate(problem, "moreau-jean", dt=h, t_end=steps * h, theta=theta)
    assert len(run.events) >= (1 if e == 0.0 else 4)
    assert_allclose(run.q, peer["q"], rtol=0.0, atol=1e-9)
    assert_allclose(run.v, peer["v"], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("theta", [0.5, 0.8])
def test_column_of_beads(siconos, theta):
    problem = column_of_beads()
    h, steps = 1.013e-3, 1500
    peer = lagrangian(siconos, problem, theta, h, steps)
    run = li.simulate(problem, "moreau-jean", dt=h, t_end=steps * h, theta=theta)
    assert len(run.events) > 30
    assert_allclose(run.q, peer["q"], rtol=0.0, atol=1e-9)
    assert_allclose(run.v, peer["v"], rtol=0.0, atol=1e-9)


def test_damped_chain_against_a_stop(siconos):
    scheme = li.Scheme(
        li.Mass("a", 1.0), li.Mass("b", 2.0), li.Spring("a", "b", 300.0), li.Dashpot("a", "b", 0.7),
        li.Spring("b", "ground", 90.0), li.Load("a", 3.0), li.Bumper("a", "ground", 0.02, 0.6),
    )  # fmt: skip
    problem = li.Problem("chain", scheme, v0={"a": 1.0})
    h, steps = 1e-3, 2000
    peer = lagrangian(siconos, problem, 0.5, h, steps)
    run = li.simulate(problem, "moreau-jean", dt=h, t_end=steps * h)
    assert len(run.events) > 5
    assert_allclose(run.q, peer["q"], rtol=0.0, atol=1e-9)
    assert_allclose(run.v, peer["v"], rtol=0.0, atol=1e-9)


def rough(siconos, problem, h, steps):
    """The rows in pairs, each normal one before the friction that it bounds."""
    d = problem.dynamics
    tangents = np.flatnonzero(d.tangential)
    rows = np.column_stack([d.normals[tangents], tangents]).ravel()
    return siconos(
        kind="lagrangian", M=d.M, C=d.C, K=d.K, f=d.force(0.0), H=d.H[rows], u0=d.u0[rows], e=d.restitution[rows],
        q0=problem.initial_coordinates, v0=problem.initial_velocities, theta=0.5, h=h, steps=steps, mu=d.mu[tangents],
    )  # fmt: skip


def ball_with_spin():
    ball = li.Scheme(li.Mass("x", 1.0), li.Mass("y", 1.0), li.Mass("φ", 0.004), li.Load("y", 9.81))
    ball.add(li.Bumper("y", "ground", gap=0.5, e=0.5, name="N"), li.Friction({"x": 1.0, "φ": 0.1}, "ground", 0.2, "N"))
    return li.Problem("ball with spin", ball, v0={"φ": 50.0})


def woodpecker():
    """Glocker's data: y, and the angles of the sleeve, which begins in the air, and of the woodpecker."""
    m_M, m_S, J_M, J_S, c, l_M, l_G, h_S, l_S, h_M, r_M, r_0 = (
        3e-4, 4.5e-3, 5e-9, 7e-7, 0.0056, 0.010, 0.015, 0.02, 0.0201, 0.0058, 0.0031, 0.0025,
    )  # fmt: skip
    arm = np.array([1.0, l_M, l_G])
    M = m_S * np.outer(arm, arm) + np.diag([m_M, J_M, J_S])
    K = c * np.array([[0.0, 0.0, 0.0], [0.0, 1.0, -1.0], [0.0, -1.0, 1.0]])
    toy = li.Scheme.of_matrices(
        M, None, K, list(map(float, -9.81 * (m_S * arm + [m_M, 0.0, 0.0]))), H=[[0, 0, -h_S], [0, h_M, 0], [0, -h_M, 0]],
        gaps=[l_M + l_G - l_S - r_0, r_M - r_0, r_M - r_0], e=[0.5, 0.0, 0.0], coordinates="yms", contacts=["A", "B", "C"],
    )  # fmt: skip
    for name, m, s in (("A", l_M, l_G - l_S), ("B", r_M, 0.0), ("C", r_M, 0.0)):
        slip = {"y": 1.0, "m": m} | ({"s": s} if s else {})
        toy.add(li.Friction("ground", slip, 0.3, name, name=f"T{name}"))
    return li.Problem("woodpecker", toy, q0={"m": -0.103, "s": -0.2788}, v0={"y": -0.3411, "s": -7.4583})


@pytest.mark.parametrize(
    ("make", "h", "steps"), [(ball_with_spin, 1e-3, 3000), (woodpecker, 2e-5, 5000)], ids=["ball", "woodpecker"]
)
def test_friction(siconos, make, h, steps):
    problem = make()
    peer = rough(siconos, problem, h, steps)
    run = li.simulate(problem, "moreau-jean", dt=h, t_end=steps * h)
    assert sum(event.kind in ("stick", "slip") for event in run.events) >= 1
    assert_allclose(run.q, peer["q"], rtol=0.0, atol=1e-9 * np.abs(peer["q"]).max())
    assert_allclose(run.v, peer["v"], rtol=0.0, atol=1e-9 * np.abs(peer["v"]).max())


def test_woodpecker_as_bodies(siconos):
    """Its masses and rows, which come from its energies and gaps, are constant: Siconos takes their values at the start."""
    # It starts in the air: at the registered start rounding decides whether the closed contact takes part in the first step.
    system = li.load_problem("woodpecker-bodies").scheme
    start = {"φ_M": 0.103, "φ_S": 0.2788}
    problem = li.Problem("woodpecker", system, q0=start, v0={"y": 0.3411, "φ_S": 7.4583})
    d, q, v = problem.dynamics, problem.initial_coordinates, problem.initial_velocities
    M, F, K, C, _ = d.forces_at(0.0, q, v)
    rows = d.rows(0.0, q, v)
    tangents = np.flatnonzero(d.tangential)
    pairs = np.column_stack([d.normals[tangents], tangents]).ravel()
    h, steps = 1.5e-4, 1000
    peer = siconos(
        kind="lagrangian", M=M, C=C, K=K, f=F + K @ q + C @ v, H=rows.H[pairs], u0=(rows.g - rows.H @ q)[pairs],
        e=d.restitution[pairs], q0=q, v0=v, theta=0.5, h=h, steps=steps, mu=d.mu[tangents],
    )  # fmt: skip
    run = li.simulate(problem, "moreau-jean", dt=h, t_end=steps * h, error=False)
    assert {event.contact for event in run.events} >= {"N1", "N2", "N3"}
    assert_allclose(run.q, peer["q"], rtol=0.0, atol=1e-9 * np.abs(peer["q"]).max())


def paper_system(number):
    """A, b, B, C, D and x(0) of a system of the paper, y eliminated: states (x, v, z), and y - x in System 3."""
    m, k, k_o, c, c_o, g = 100.0, 1962.0, 3924.0, 125.0, 250.0, 9.81
    v_o = np.sqrt(2.0 * g * 5.0)
    A = np.zeros((4, 4))
    A[0, 1], A[2, 2], A[3, 3] = 1.0, -k_o / c_o, -k / c
    b, B = np.array([0.0, g, 0.0, 0.0]), np.array([[0.0], [-1.0 / m], [1.0 / c_o], [-1.0 / c]])
    C, D = np.array([[-1.0, 0.0, 1.0, -1.0]]), np.array([[1.0 / k if number == 2 else 0.0]])
    n = 4 if number == 3 else 3
    return A[:n, :n], b[:n], B[:n], C[:, :n], D, np.array([0.0, v_o, 0.0, 0.0])[:n]


@pytest.mark.parametrize("theta", [0.5, 1.0])
@pytest.mark.parametrize("number", [1, 3])
@pytest.mark.parametrize("form", ["scheme", "first-order form"])
def test_systems_1_and_3(siconos, number, theta, form):
    A, b, B, C, D, x0 = paper_system(number)
    h, steps = 1e-3, 3000
    peer = siconos(kind="first_order", A=A, b=b, B=B, C=C, D=D, x0=x0, theta=theta, gamma=1.0, h=h, steps=steps)
    if form == "scheme":
        problem, x, v, z = li.load_problem(f"system-{number}"), "x", "v_x", "z"
    else:
        states = ("x", "v", "z", "y_x")[: len(x0)]
        system = li.LinearComplementaritySystem(A, B, C, D, a=b, states=states, multipliers=("R",))
        problem = li.Problem("first-order form", system, q0=dict(zip(states, x0, strict=True)))
        x, v, z = "x", "v", "z"
    run = li.simulate(problem, "moreau-jean", dt=h, t_end=steps * h, theta=theta)
    for name, column in ((x, 0), (v, 1), (z, 2)):
        assert_allclose(run[name], peer["x"][:, column], rtol=0.0, atol=1e-9)
    assert_allclose(run["R"], peer["lambda"][:, 0], rtol=0.0, atol=1e-6)
    assert run["R"].max() > 4000.0


def test_system_2_in_the_first_order_form(siconos):
    A, b, B, C, D, x0 = paper_system(2)
    h, steps = 1e-3, 3000
    peer = siconos(kind="first_order", A=A, b=b, B=B, C=C, D=D, x0=x0, theta=0.5, gamma=0.5, h=h, steps=steps)
    system = li.LinearComplementaritySystem(A, B, C, D, a=b, states=("x", "v", "z"), multipliers=("R",))
    problem = li.Problem("first-order form", system, q0=dict(zip(("x", "v", "z"), x0, strict=True)))
    run = li.simulate(problem, "moreau-jean", dt=h, t_end=steps * h)
    assert_allclose(run.q, peer["x"], rtol=0.0, atol=1e-9)
    assert_allclose(run["R"].max(), 4486.0845, rtol=1e-4)


@pytest.mark.parametrize(
    ("A", "b", "B", "C", "x0"),
    [
        ([[0.0]], [0.5], [[-1.0]], [[-1.0]], [1.0]),
        ([[0.0]], [2.0], [[-1.0]], [[-1.0]], [-1.0]),
        ([[0.0, 1.0], [0.0, 0.0]], [0.0, 0.25], [[0.0], [-1.0]], [[-1.0, -1.0]], [0.5, 0.0]),
        ([[0.0, 1.0], [-1.0, -0.2]], [0.0, 0.0], [[0.0], [-1.0]], [[-1.0, 0.0]], [4.0, 0.0]),
        ([[0.0, 1.0], [0.0, 0.0]], [0.0, 0.0], [[0.0, 0.0], [-2.0, -1.0]], [[-1.0, 0.0], [0.0, -1.0]], [1.0, 0.0]),
        ([[-1.0, 1.0], [-1.0, -1.0]], [0.0, 0.0], [[-1.0, 0.5], [0.5, -2.0]], [[-1.0, 0.0], [0.0, -1.0]], [1.0, -3.0]),
    ],
    ids=["slides", "crosses", "sliding mode", "oscillator", "twisting", "two"],
)
def test_relays(siconos, A, b, B, C, x0):
    """The same backward Euler steps: relays that cross, slide, and slide on an intersection."""
    h, steps = 1.013e-3, 4000
    A, b, B, C = map(np.array, (A, b, B, C))
    m = len(C)
    peer = siconos(
        kind="first_order",
        A=A,
        b=b,
        B=B,
        C=C,
        D=np.zeros((m, m)),
        x0=x0,
        theta=1.0,
        gamma=1.0,
        h=h,
        steps=steps,
        bound=1.0,
    )
    system = li.LinearComplementaritySystem(A, B, C, a=b, lower=m * [-1.0], upper=m * [1.0])
    problem = li.Problem("relays", system, q0=dict(zip(system.states, x0, strict=True)))
    run = li.simulate(problem, "moreau-jean", dt=h, t_end=steps * h, theta=1.0)
    assert run.events
    assert_allclose(run.q, peer["x"], rtol=0.0, atol=1e-9)
    assert_allclose(run.reaction @ B.T, peer["lambda"] @ B.T, rtol=0.0, atol=1e-6)
