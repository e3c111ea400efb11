#!/usr/bin/python3
"""LCPs by the solvers of Siconos, one request after another, for `lcp.py`, which waits for each answer and no longer.

Siconos comes with Debian (``apt-get install python3-siconos``) and belongs to Debian's Python. The first line of the output
is {"missing": ""}, or {"missing": ...} with the reason. Each line of the input is a request,

    {"file": "problem.npz with M and q", "solver": "LEMKE", "calls": 50, "sample": 1e-3}

and is answered by one line {"seconds": median of a call, "info": 0 if it says solved, "z": [...]}.
"""

import json
import os
import sys
import time

import numpy as np

TOLERANCE = 1e-10


def main() -> None:
    """Answer until the input ends."""
    answers = os.fdopen(os.dup(1), "w")
    # What the library prints by itself must not come among the answers.
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    try:
        import siconos.numerics as sn
    except ImportError as error:
        print(json.dumps({"missing": f"{error}: apt-get install python3-siconos"}), file=answers, flush=True)
        return
    print(json.dumps({"missing": ""}), file=answers, flush=True)

    for line in sys.stdin:
        request = json.loads(line)
        data = np.load(request["file"])
        M, q = data["M"], data["q"]
        options = sn.SolverOptions(getattr(sn, "SICONOS_LCP_" + request["solver"]))
        options.dparam[sn.SICONOS_DPARAM_TOL] = TOLERANCE
        problem = sn.LCP(M, q)
        z, w = np.zeros(len(q)), np.zeros(len(q))
        seconds: list[float] = []
        while not seconds or (len(seconds) < request["calls"] and sum(seconds) < request["sample"]):
            z[:] = w[:] = 0.0
            began = time.perf_counter()
            info = sn.linearComplementarity_driver(problem, z, w, options)
            seconds.append(time.perf_counter() - began)
        answer = {"seconds": float(np.median(seconds)), "info": int(info), "z": z.tolist()}
        print(json.dumps(answer), file=answers, flush=True)


if __name__ == "__main__":
    main()
