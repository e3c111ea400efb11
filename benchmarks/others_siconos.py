"""The contestant Siconos in `others.py`: its models as numbers, for `siconos_others.py` in Debian's Python."""

from __future__ import annotations

import json
import math
import subprocess
from functools import partial
from pathlib import Path

import numpy as np
from others_lcpimpact import FINER, STEPS
from others_problems import CASES, Motion

import lcpimpact as li

PYTHON = "/usr/bin/python3"
SCRIPT = Path(__file__).with_name("siconos_others.py")

REPEATS = 3


def versions() -> dict[str, str]:
    """Return the version of Siconos.

    Raises
    ------
    RuntimeError
        If Debian's Python has none.
    """
    try:
        subprocess.run([PYTHON, "-c", "import siconos.kernel"], capture_output=True, check=True, timeout=120)
        asked = ["dpkg-query", "-W", "-f", "${Version}", "python3-siconos"]
        found = subprocess.run(asked, capture_output=True, check=True, text=True, timeout=60).stdout
    except (OSError, subprocess.SubprocessError):
        raise RuntimeError(f"not installed for {PYTHON} (Debian: apt-get install python3-siconos)") from None
    return {"siconos": found.partition("+")[0]}


def bodies(
    masses: list[float], f: list[float], H: list[list[float]], gaps: list[float], e: float, **more: object
) -> dict:
    """Return bodies without springs; more replaces any entry."""
    n = len(masses)
    zero = np.zeros((n, n)).tolist()
    base = {"kind": "mechanical", "M": np.diag(masses).tolist(), "K": zero, "C": zero, "f": f, "H": H, "gaps": gaps}
    return {**base, "e": [e] * len(gaps), "q": [0.0] * n, "v": [0.0] * n, **more}


M, K, K_O, C, C_O, G = 100.0, 1962.0, 3924.0, 125.0, 250.0, 9.81
V_O = math.sqrt(2.0 * G * 5.0)


def system(D: float) -> dict:
    """Return System 1 (D = 0) or 2 (D = 1/k) in (x, v, z)."""
    return {
        "kind": "first order", "law": "complementarity", "A": [[0, 1, 0], [0, 0, 0], [0, 0, -K_O / C_O]], "a": [0, G, 0],
        "B": [[0], [-1 / M], [1 / C_O]], "C": [[-1, 0, 1]], "D": [[D]], "x": [0, V_O, 0],
    }  # fmt: skip


def models() -> dict[str, dict]:
    """Return every problem in the terms of Siconos."""
    ball = bodies([1.0], [9.81], [[-1.0]], [1.0], 0.8)
    struck = CASES["impact-oscillator"].problem
    load = next(each.f for each in struck.scheme.elements if isinstance(each, li.Load))
    cradle = (np.diag([1.0] * 4, 1) - np.eye(5))[:4].tolist()
    α = math.pi / 6.0
    slope = [9.81 * math.sin(α), 9.81 * math.cos(α)]
    L, C_F, R = 1e-2, 1e-6, 1e3
    return {
        "bouncing-ball": ball,
        "bouncing-ball to rest": ball,
        "system-1": system(0.0),
        "system-2": system(1.0 / K),
        "system-3": {
            "kind": "first order", "law": "complementarity",
            "A": [[0, 1, 0, 0], [0, 0, 0, 0], [0, 0, -K_O / C_O, 0], [0, 0, 0, -K / C]], "a": [0, G, 0, 0],
            "B": [[0], [-1 / M], [1 / C_O], [-1 / C]], "C": [[-1, 0, 1, -1]], "D": [[0]], "x": [0, V_O, 0, 0],
        },
        "impact-oscillator": bodies(
            [1.0], [0.0], [[-1.0]], [0.0], 0.8, K=[[1.0]], C=[[0.1]], v=[struck.v0["x"]],
            harmonic=[load.amplitude, load.omega, load.phase],
        ),
        "newtons-cradle": bodies([1.0] * 5, [0.0] * 5, cradle, [0.1, 0.01, 0.01, 0.01], 1.0, v=[1.0, 0, 0, 0, 0]),
        "pi-billiard": bodies([100.0, 1.0], [0.0] * 2, [[-1.0, 1.0], [0.0, -1.0]], [1.0, 1.0], 1.0, v=[1.0, 0.0]),
        "coulomb-oscillator": {
            "kind": "first order", "law": "relay", "A": [[0, 1], [-100, 0]], "a": [0, 0], "B": [[0], [5]], "C": [[0, 1]],
            "D": [[0]], "x": [0.53, 0],
        },
        "block-on-incline": bodies([1.0] * 2, slope, [[0.0, -1.0], [1.0, 0.0]], [0.0], 0.0, mu=[0.7], v=[2.0, 0.0]),
        "diode-bridge": {
            "kind": "first order", "law": "complementarity", "A": [[0, -1 / C_F], [1 / L, 0]], "a": [0, 0],
            "B": [[0, 0, -1 / C_F, 1 / C_F], [0, 0, 0, 0]], "C": [[0, 0], [0, 0], [-1, 0], [1, 0]],
            "D": [[1 / R, 1 / R, -1, 0], [1 / R, 1 / R, 0, -1], [1, 0, 0, 0], [0, 1, 0, 0]], "x": [10, 0],
        },
        "filippov": {
            "kind": "first order", "law": "relay", "A": [[0]], "a": [2], "B": [[1]], "C": [[1]], "D": [[0]], "x": [-1.5],
            "falling": 1.0,
        },
    }  # fmt: skip


def columns(title: str, data: dict) -> tuple[list[int], list[int]]:
    """Return which of its states are q and which are v; first-order systems have both in one."""
    if data["kind"] == "mechanical":
        return [list(range(len(CASES[title].columns)))] * 2
    return ([0], [1]) if title.startswith(("system", "coulomb")) else ([0], [0])


def run(title: str, **more: float) -> Motion:
    """Run a problem in Debian's Python."""
    data = {**models()[title], "t_end": CASES[title].t_end, "repeats": REPEATS, **more}
    done = subprocess.run([PYTHON, str(SCRIPT), json.dumps(data)], capture_output=True, text=True, timeout=300)
    if done.returncode:
        raise RuntimeError(f"exit code {done.returncode}: {done.stderr.strip().splitlines()[-1:]}")
    found = json.loads(done.stdout.splitlines()[-1])
    q, v = columns(title, data)
    pick = (np.array(found[key])[:, where] for key, where in (("q", q), ("v", v)))
    force = np.array(found["force"])[1:] if title.startswith("system") else None
    return Motion(np.array(found["t"]), *pick, force, found["seconds"])


def settings(title: str) -> dict[str, tuple[str, partial[Motion]]]:
    """Return the runs of a problem: as in the tutorials, and with a smaller step; where D is not zero with γ = 1/2.

    System 1, where D is zero, is run with γ = 1/2 too: its force then rings.
    """
    h = STEPS[title]
    fine = h / FINER.get(title, 10)
    data = models()[title]
    name = "MoreauJeanOSI" if data["kind"] == "mechanical" else "EulerMoreauOSI"
    half = title in ("system-2", "diode-bridge")
    runs = {
        "default": (f"{name}, h = {h:g} s", partial(run, title, h=h)),
        "tuned": (
            f"{name}, h = {fine:g} s" + ", γ = 1/2" * half,
            partial(run, title, h=fine, **({"gamma": 0.5} if half else {})),
        ),
    }
    if title == "system-1":
        runs["γ = 1/2"] = (f"{name}, h = {h:g} s, γ = 1/2", partial(run, title, h=h, gamma=0.5))
    return runs
