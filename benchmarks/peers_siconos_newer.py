"""The tutorials of Siconos that the Python modules of 4.5 can run by ``siconos_newer.py``.

They have no events, and neither offsets of a first-order relation nor inputs that change.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import peers_siconos
from peers_base import Example, run_by, version_in

SCRIPT = Path(__file__).with_name("siconos_newer.py")
EXAMPLES = [
    name
    for name, made in peers_siconos.EXAMPLES.items()
    if made().data["kind"] != "events" and not {"inputs", "offsets", "driven", "tol"} & set(made().data)
]
example = peers_siconos.example


def version(python: str) -> str:
    """Return the version of Siconos in a Python, or raise `RuntimeError`."""
    return version_in(python, "siconos", "import siconos, siconos.modeling; print(siconos.version)")


def theirs(example: Example, repeats: int, python: str) -> tuple[np.ndarray, float]:
    """Return q or x by Siconos, and the median of its seconds of CPU."""
    return run_by(python, SCRIPT, example, repeats)
