"""The tutorials of Siconos that the Python modules of 4.5 can run by ``siconos_newer.py``.

They have no events, and neither offsets of a first-order relation nor inputs that change.
"""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import peers_siconos
from peers_base import Example

SCRIPT = Path(__file__).with_name("siconos_newer.py")
EXAMPLES = [
    name
    for name, made in peers_siconos.EXAMPLES.items()
    if made().data["kind"] != "events" and not {"inputs", "offsets", "driven", "tol"} & set(made().data)
]
example = peers_siconos.example


def version(python: str) -> str:
    """Return the version of Siconos in a Python, or raise `RuntimeError`."""
    asked = [python, "-c", "import siconos, siconos.modeling; print(siconos.version)"]
    try:
        return subprocess.run(asked, capture_output=True, text=True, check=True, timeout=120).stdout.splitlines()[-1]
    except (OSError, subprocess.SubprocessError):
        raise RuntimeError(f"not installed for {python}: name the Python that has it by --python") from None


def theirs(example: Example, repeats: int, python: str) -> tuple[np.ndarray, float]:
    """Return q or x by Siconos, and the median of its seconds of CPU."""
    asked = json.dumps({**example.data, "h": example.h, "t_end": example.t_end, "repeats": repeats})
    done = subprocess.run([python, str(SCRIPT)], input=asked, capture_output=True, text=True, check=True, timeout=600)
    found = json.loads(done.stdout.splitlines()[-1])
    return np.array(found["q"]), found["seconds"]
