"""Siconos as an independent route: its time steps on the matrices of a problem, where it is installed.

Siconos is installed for the system's Python (Debian and Ubuntu: ``apt-get install python3-siconos``), which runs
``siconos_runs.py``. The environment variable LCPIMPACT_SICONOS_PYTHON selects another Python.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from lcpimpact.arrays import Array
from lcpimpact.errors import UnsupportedError
from lcpimpact.hybrid.state_jump import enter_constraint
from lcpimpact.problems.base import Problem
from lcpimpact.scheme.first_order import first_order_form
from lcpimpact.scheme.structure import Feature

PYTHON = "LCPIMPACT_SICONOS_PYTHON"
"""Environment variable with the path of the Python that has Siconos."""

INSTALL = "not installed: apt-get install python3-siconos"

SCRIPT = Path(__file__).with_name("siconos_runs.py")


@cache
def python_with_siconos() -> str | None:
    """Return the Python of LCPIMPACT_SICONOS_PYTHON or of the system if it has Siconos, else None."""
    named = os.environ.get(PYTHON)
    for python in [named] if named else ["/usr/bin/python3", shutil.which("python3")]:
        if python and Path(python).exists():
            found = subprocess.run([python, "-c", "import siconos.kernel"], capture_output=True, check=False)
            if found.returncode == 0:
                return python
    return None


def run_siconos(*, timeout: float = 600.0, **job: Any) -> dict[str, Array]:
    """Run one job of ``siconos_runs.py``, within ``timeout`` s.

    Its ``kind`` is "lagrangian" or "first_order", the others are its arguments.

    Returns
    -------
    dict
        "q" and "v" (steps + 1, n), or "x" (steps + 1, N) and "lambda" (steps, nc).

    Raises
    ------
    UnsupportedError
        If Siconos is not installed, or fails.
    """
    python = python_with_siconos()
    if python is None:
        raise UnsupportedError(INSTALL)
    job = {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in job.items()}
    try:
        done = subprocess.run(
            # As text: a script's own folder would come first on its path, and there siconos is this module.
            [python, "-c", SCRIPT.read_text(encoding="utf-8")],
            input=json.dumps([job]), capture_output=True, text=True, timeout=timeout, check=True,
        )  # fmt: skip
        # Siconos may print messages; the result is the last line of standard output.
        (answer,) = json.loads(done.stdout.splitlines()[-1])
    except (subprocess.SubprocessError, ValueError, IndexError) as error:
        raise UnsupportedError(f"Siconos gave no answer: {type(error).__name__}; take another route") from None
    return {key: np.array(value) for key, value in answer.items()}


def siconos(problem: Problem, steps: int, t_end: float, theta: float = 0.5) -> Array:
    """Return q at the grid points of a run by Siconos (steps + 1, n); massless nodes are taken from its own state.

    A scheme with mass at all nodes uses MoreauJeanOSI, like `moreau-jean`; others, and systems given directly, use
    EulerMoreauOSI in first-order form, with γ = 1 at relative degree 1 and γ = 1/2 at 0.

    Raises
    ------
    UnsupportedError
        If Siconos is not installed, or the problem is a Lagrangian system, or has sliders, friction, rigid links, relays,
        non-linear springs, general or sampled forces, prescribed motions, loads other than constants, `Harmonic` and
        `Polynomial`, or contacts of several relative degrees.
    """
    problem, _ = enter_constraint(problem)
    d = problem.dynamics
    degrees = set(d.relative_degree.tolist())
    for present, what in (
        (Feature.LAGRANGIAN in d.features, Feature.LAGRANGIAN.value),
        (bool((d.of_rate & ~d.tangential).any()), "sliders"),
        (bool(d.switches.any()), "relays"),
        (bool(d.tangential.any()), "friction that a normal force bounds"),
        (bool(d.bilateral.any()), "rigid links"),
        (bool(d.springs), "non-linear springs"),
        (bool(d.dashpots), "non-linear dashpots"),
        (bool(d.force_laws), "general forces"),
        (bool(d.holds), "sampled forces"),
        (bool(d.motions), "a prescribed motion"),
        (d.has_other_impact_law, "a law of impact other than Newton's"),
        (len(degrees) > 1, "contacts of several relative degrees"),
        (len(d.impulse_lines) > 0, "impulses that pass through massless nodes"),
        (2 in degrees and not d.massive.all(), "impacts beside massless nodes"),
        (2 in degrees and not d.constant_loads, "impacts under a load that depends on time"),
        (not degrees, "no contact"),
    ):
        if present:
            raise UnsupportedError(f"{problem.name!r} has {what}, which the route by Siconos does not handle")
    h = t_end / steps
    if 2 in degrees:
        found = run_siconos(
            kind="lagrangian", M=d.M, C=d.C, K=d.K, f=d.force(0.0), H=d.H, u0=d.u0, e=d.restitution,
            q0=problem.initial_coordinates, v0=problem.initial_velocities, theta=theta, h=h, steps=steps,
        )  # fmt: skip
        return found["q"]
    form = first_order_form(d)
    if len(form.breakpoints(0.0, t_end)):
        raise UnsupportedError(
            f"{problem.name!r} has a load with breakpoints, which the route by Siconos does not handle"
        )
    x0 = form.state(problem.initial_coordinates, problem.initial_velocities)
    gamma = 1.0 if 1 in degrees else 0.5
    found = run_siconos(
        kind="first_order", A=form.A, b=np.zeros(len(form.A)), B=form.B, C=form.C, D=form.D, x0=x0,
        theta=theta, gamma=gamma, h=h, steps=steps,
    )  # fmt: skip
    return found["x"] @ form.Q.T
