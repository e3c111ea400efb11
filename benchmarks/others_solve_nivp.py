"""The contestant solve-nivp in `others.py`: implicit steps, with a projection for the nonsmooth law of each.

Written after its notebooks on the bouncing ball and on dry friction: the trapezoidal rule with the unilateral projection,
which has a coefficient of restitution, by fixed-point iteration for variational inequalities, and the composite rule with
Coulomb's projection by semismooth Newton, both with adaptive steps. The default has the tolerances of the notebooks, tuned
has smaller ones. A relay is dry friction on its own state. A massless plate is a contact whose "velocity" is the gap itself,
with constant steps of backward Euler and semismooth Newton, since the fixed-point iteration takes minutes.
"""

from __future__ import annotations

import contextlib
import io
import math
import time
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from others_problems import CASES, Array, Motion, shaken
from others_scipy import C_O, K_O, V_O, C, G, K, M
from solve_nivp import solve_ivp_ns

VERSIONS = ("solve-nivp",)


class Tolerance(NamedTuple):
    """The tolerances of a step, relative and absolute, and of the iteration in it; the constant step in s without."""

    relative: float
    absolute: float
    solver: float
    h: float


def stepped(
    title: str,
    rates: Callable[[float, Array], Array],
    jacobian: Array,
    start: list[float],
    method: str,
    tolerance: Tolerance,
    projection: str = "identity",
    **options: Any,
) -> tuple[Array, Array]:
    """Return the instants and the states of a run."""
    adaptive = method != "backward_euler" and not title.endswith("rest")
    with contextlib.redirect_stdout(io.StringIO()):
        t, states, *_ = solve_ivp_ns(
            rates, (0.0, CASES[title].t_end), np.array(start), method, projection,
            "VI" if method == "trapezoidal" else "semismooth_newton", projection_opts=options,
            solver_opts={"tol": tolerance.solver, "max_iter": 200, "rhs_jac": lambda t, y: jacobian},
            adaptive_opts={"h_min": 1e-12, "h_max": CASES[title].t_end / 100, "method_order": 1, "use_PI": False},
            rtol=tolerance.relative, atol=tolerance.absolute, adaptive=adaptive,
            h0=CASES[title].t_end / 2000 if adaptive else tolerance.h,
            component_slices=[slice(i, i + 1) for i in range(len(start))],
        )  # fmt: skip
    return np.asarray(t), np.asarray(states)


def contacts(gap: Callable[[Array], Array], speed: Array, push: Array, e: float) -> dict[str, Any]:
    """Return the unilateral projection: gaps of a state, the rows whose product with it is their speed, and what r does."""
    return {
        "gap": lambda t, y: gap(y), "u_map": lambda t, y: speed @ y, "J_u": lambda t, y: speed,
        "G_apply": lambda t, y, r: push @ r, "e": e, "lcp_maxit": 200, "lcp_tol": 1e-10, "tc_tol": 1e-10,
    }  # fmt: skip


def bodies(
    masses: list[float],
    H: list[list[float]],
    gaps: list[float],
    e: float,
    v: list[float],
    title: str,
    tolerance: Tolerance,
    force: Callable[[float], float] = lambda t: 0.0,
    law: Array | None = None,
) -> Motion:
    """Return bodies with contacts in the state (v, q): M v' = law (v, q) + force(t), on each of them."""
    n, rows, m = len(masses), np.array(H), np.array(masses)
    A = np.zeros((2 * n, 2 * n))
    A[n:, :n] = np.eye(n)
    if law is not None:
        A[:n] = law

    def rates(t: float, y: Array) -> Array:
        return A @ y + np.repeat([force(t), 0.0], n)

    speed, push = np.hstack([rows, np.zeros_like(rows)]), np.vstack([rows.T / m[:, None], np.zeros((n, len(gaps)))])
    laws = contacts(lambda y: np.array(gaps) + rows @ y[n:], speed, push, e)
    t, y = stepped(title, rates, A, [*v, *np.zeros(n)], "trapezoidal", tolerance, "unilateral", **laws)
    return Motion(t, y[:, n:], y[:, :n])


def impact_oscillator(title: str, tolerance: Tolerance) -> Motion:
    """Return the oscillator that strikes its stop."""
    start = float(CASES[title].problem.v0["x"])
    return bodies([1.0], [[-1.0]], [0.0], 0.8, [start], title, tolerance, shaken, np.array([[-0.1, -1.0]]))


def massless(A: Array, B: Array, gap: Array, start: list[float], title: str, tolerance: Tolerance) -> Motion:
    """Return a body in (x, v, ...) that presses on a massless plate: y' = A y + a + B R, 0 ≤ R ⟂ gap y ≥ 0."""
    a = np.zeros(len(A))
    a[1] = G
    laws = contacts(lambda y: np.array([-1.0]), gap[None, :], B[:, None], 0.0)  # the gap decides, not a distance
    t, y = stepped(title, lambda t, y: A @ y + a, A, start, "backward_euler", tolerance, "unilateral", **laws)
    force = M * (G - np.diff(y[:, 1]) / np.diff(t))
    return Motion(t, y[:, :1], y[:, 1:2], force)


def system_1(title: str, tolerance: Tolerance) -> Motion:
    """Return System 1 in (x, v, z)."""
    A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, -K_O / C_O]])
    return massless(
        A, np.array([0.0, -1.0 / M, 1.0 / C_O]), np.array([-1.0, 0.0, 1.0]), [0.0, V_O, 0.0], title, tolerance
    )


def system_2(title: str, tolerance: Tolerance) -> Motion:
    """Return System 2 in (x, v, z), whose force is k max(0, x - z): nothing is to be projected."""

    def force(y: Array) -> Any:
        return K * np.maximum(y[0] - y[2], 0.0)

    def rates(t: float, y: Array) -> Array:
        return np.array([y[1], G - force(y) / M, (force(y) - K_O * y[2]) / C_O])

    stiff = np.array([[0.0, 1.0, 0.0], [-K / M, 0.0, K / M], [K / C_O, 0.0, -(K + K_O) / C_O]])
    t, y = stepped(title, rates, stiff, [0.0, V_O, 0.0], "composite", tolerance)
    return Motion(t, y[:, :1], y[:, 1:2], force(y.T))


def system_3(title: str, tolerance: Tolerance) -> Motion:
    """Return System 3 in (x, v, z, s), with the upper plate at x + s."""
    A = np.diag([0.0, 0.0, -K_O / C_O, -K / C])
    A[0, 1] = 1.0
    B, gap = np.array([0.0, -1.0 / M, 1.0 / C_O, -1.0 / C]), np.array([-1.0, 0.0, 1.0, -1.0])
    return massless(A, B, gap, [0.0, V_O, 0.0, 0.0], title, tolerance)


def rubbing(title: str, tolerance: Tolerance, rates: Callable, jacobian: Array, start: list[float], F: float) -> Any:
    """Return t and the states of a system whose first state has dry friction F."""
    laws = {
        "con_force_func": lambda y, t=None, Fk_val=None: np.array([F, *np.zeros(len(start) - 1)]),
        "rhok": np.ones(len(start)),
        "constraint_indices": [0], "jac_func": lambda y, t=None, Fk_val=None: np.zeros((len(start), len(start))),
        "component_slices": [slice(i, i + 1) for i in range(len(start))],
    }  # fmt: skip
    return stepped(title, rates, jacobian, start, "composite", tolerance, "coulomb", **laws)


def coulomb(title: str, tolerance: Tolerance) -> Motion:
    """Return the oscillator with dry friction in (v, x)."""
    A = np.array([[0.0, -100.0], [1.0, 0.0]])
    t, y = rubbing(title, tolerance, lambda t, y: A @ y, A, [0.0, 0.53], 5.0)
    return Motion(t, y[:, 1:], y[:, :1])


def incline(title: str, tolerance: Tolerance) -> Motion:
    """Return the block on the incline in (v, x), whose normal force is known."""
    α = math.pi / 6.0
    A = np.array([[0.0, 0.0], [1.0, 0.0]])
    slope = np.array([9.81 * math.sin(α), 0.0])
    t, y = rubbing(title, tolerance, lambda t, y: A @ y + slope, A, [2.0, 0.0], 0.7 * 9.81 * math.cos(α))
    still = np.zeros((len(t), 1))
    return Motion(t, np.hstack([y[:, 1:], still]), np.hstack([y[:, :1], still]))


def filippov(title: str, tolerance: Tolerance) -> Motion:
    """Return the relay, as dry friction on its state."""
    t, y = rubbing(title, tolerance, lambda t, y: np.array([2.0 - t]), np.zeros((1, 1)), [-1.5], 1.0)
    return Motion(t, y, y)


BALL = partial(bodies, [1.0], [[-1.0]], [1.0], 0.8, [0.0], force=lambda t: 9.81)

RUNS: dict[str, Callable[..., Motion]] = {
    "bouncing-ball": BALL,
    "bouncing-ball to rest": BALL,
    "system-1": system_1,
    "system-2": system_2,
    "system-3": system_3,
    "impact-oscillator": impact_oscillator,
    "coulomb-oscillator": coulomb,
    "block-on-incline": incline,
    "filippov": filippov,
}

STALLS = "its iteration does not converge where two bodies meet: the steps go on with the bodies frozen"
ABSENT = {
    "newtons-cradle": STALLS,
    "pi-billiard": STALLS,
    "diode-bridge": "its projections have no conditions in which a multiplier stands itself (D is not zero)",
}


def once(run: Callable[[], Motion]) -> Motion:
    """Return the motion with the CPU time of this run: there is nothing to warm up, and some take half a minute."""
    began = time.process_time()
    return run()._replace(seconds=time.process_time() - began)


def settings(title: str) -> dict[str, tuple[str, partial[Motion]]]:
    """Return the runs of a problem."""
    runs = {}
    for key, it in (("default", Tolerance(1e-3, 1e-6, 1e-7, 1e-3)), ("tuned", Tolerance(1e-5, 1e-8, 1e-10, 2e-4))):
        how = f"adaptive, rtol = {it.relative:g}"
        if title in ("system-1", "system-3"):
            how = f"backward Euler, h = {it.h:g} s"
        runs[key] = (how, partial(once, partial(RUNS[title], title=title, tolerance=it)))
    if title.endswith("rest"):  # adaptive steps take most of a minute where the impacts accumulate
        constant = Tolerance(1e-3, 1e-6, 1e-7, 5e-3)
        return {"default": ("trapezoidal, h = 0.005 s", partial(once, partial(BALL, title=title, tolerance=constant)))}
    return runs
