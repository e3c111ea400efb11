"""An example of another program: its system here, and the run that is compared."""

from __future__ import annotations

import json
import subprocess
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from lcpimpact import Problem


@dataclass(frozen=True)
class Example:
    """An example: a problem here, the step and end of both runs, and how each is run.

    Attributes
    ----------
    problem : Problem
    h, t_end : float
        Distance of the instants that are compared, the step in most, and end in s.
    data : dict
        The system as numbers, or its name, for the other program.
    method : str
        The method here.
    options : dict
        Its options.
    judge : str
        The method whose motion is taken for the true one where ``exact`` cannot run.
    judge_options : dict
        Its options.
    parts : int
        How many steps of the run here are in one of h.
    columns : tuple of str
        The columns of a run that are compared; all of q by default.
    """

    problem: Problem
    h: float
    t_end: float
    data: dict = field(default_factory=dict)
    method: str = "moreau-jean"
    options: dict = field(default_factory=dict)
    judge: str = "exact"
    judge_options: dict = field(default_factory=dict)
    parts: int = 1
    columns: tuple[str, ...] = ()


def run_by(python: str, script: Path, example: Example, repeats: int) -> tuple[np.ndarray, float]:
    """Return q or x of an example by a script of another Python, and the median of its seconds of CPU."""
    asked = json.dumps({**example.data, "h": example.h, "t_end": example.t_end, "repeats": repeats})
    done = subprocess.run([python, str(script)], input=asked, capture_output=True, text=True, check=True, timeout=900)
    found = json.loads(done.stdout.splitlines()[-1])
    return np.array(found["q"]), found["seconds"]


def version_in(python: str, package: str, code: str = "") -> str:
    """Return the version of a package in a Python, as its metadata say, or as some code prints it.

    Raises
    ------
    RuntimeError
        If it has none.
    """
    code = code or f"import {package}; from importlib.metadata import version; print(version({package!r}))"
    asked = [python, "-c", code]
    try:
        return subprocess.run(asked, capture_output=True, text=True, check=True, timeout=120).stdout.splitlines()[-1]
    except (OSError, subprocess.SubprocessError):
        raise RuntimeError(f"not installed for {python}: name the Python that has it by --python") from None
