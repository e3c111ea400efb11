"""Without llvmlite everything runs in the interpreter, with the same bits, and says so once."""

import os
import subprocess
import sys

import pytest

RUNS = """
import hashlib, json, sys
for name in sys.argv[1:]:
    sys.modules[name] = None  # its import fails as that of a package that is not installed
import numpy as np
import lcpimpact as li

found = {}
for problem, method in [("system-2", "moreau-jean"), ("system-1", "exact"), ("bouncing-ball", "event-driven"),
                        ("woodpecker", "moreau-jean"), ("system-3", "rk4-paper"), ("hertz-impact", "newmark-ns")]:
    run = li.simulate(li.load_problem(problem), method, dt=1e-2, t_end=0.1, throw=False, progress=False)
    found[f"{problem} by {method}"] = hashlib.sha256(b"".join(a.tobytes() for a in (run.q, run.v, run.reaction))).hexdigest()
M = np.diag(np.full(40, 2.0)) + np.diag(np.full(39, -1.0), 1) + np.diag(np.full(39, -1.0), -1)
for solver in ("lemke", "dantzig", "block-pivoting"):  # of an order that LAPACK solves
    found[solver] = li.solve_lcp(M, np.sin(np.arange(40.0)), solver).z.tolist()
print(json.dumps(found))
"""


def runs(*missing: str) -> tuple[str, str]:
    """Return the output and the messages of the runs without some packages."""
    at_first = os.environ | {"LCPIMPACT_COMPILE": "later"}
    command = [sys.executable, "-c", RUNS, *missing]
    done = subprocess.run(command, env=at_first, capture_output=True, text=True, timeout=600, check=True)
    return done.stdout, done.stderr


@pytest.mark.compiled
def test_all_runs_without_a_compiler_and_has_the_same_bits():
    compiled, said = runs()
    without, told = runs("llvmlite")
    assert without == compiled
    assert "llvmlite" not in said
    assert told.count("llvmlite is not installed") == 1
    assert "pip install llvmlite" in told
