"""Whatever is given to the program, it answers, refuses or fails in words: by commands, files, calls and signals.

Each case follows from its seed alone: `case(kind, seed)`. A case breaks the program if it ends in an exception that is not
the package's own (on the command line: exit code 70), takes more than `LONGEST` seconds of processor time, changes a file
that was read, or leaves a part of a file.
"""

from __future__ import annotations

import contextlib
import gc
import io
import json
import math
import os
import shutil
import signal
import subprocess
import sys
import time
import traceback
import warnings
from collections.abc import Callable
from dataclasses import fields
from decimal import Decimal
from fractions import Fraction
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from random_schemes import frictional, random_problem

import lcpimpact as li
from lcpimpact.cli.main import TRACEBACK_VARIABLE, main
from lcpimpact.integrators import METHODS
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.files import read_lcp, write_lcp
from lcpimpact.plotting.schematic import draw_scheme
from lcpimpact.plotting.style import save
from lcpimpact.problems import PROBLEMS
from lcpimpact.problems.parameters import value_at
from lcpimpact.scheme.elements import ELEMENTS
from lcpimpact.study.accuracy.norms import NORMS, error_norms
from lcpimpact.study.accuracy.orders import observed_order
from lcpimpact.study.accuracy.reference import reference
from lcpimpact.study.design.curves import CurveTable
from lcpimpact.study.dynamics.grazing import least_gap

LONGEST = 20.0
"""Seconds of processor time."""

QUICK = {"calls": 60, "scheme files": 60, "LCP files": 60, "commands": 20, "measurements": 5}
"""Cases of each kind in a quick run, as their time allows."""

OFTEN = int(os.environ.get("LCPIMPACT_FUZZ", "1"))
"""Factor on the slow run: LCPIMPACT_FUZZ=10 pytest tests/cli/test_fuzz.py -m slow -k whatever -n 2."""

MANY = {
    "calls": 1_500 * OFTEN,
    "scheme files": 3_000 * OFTEN,
    "LCP files": 3_000 * OFTEN,
    "commands": 400 * OFTEN,
    "measurements": 200 * OFTEN,
}
"""Cases of each kind in the slow run, the more the less time one takes."""

SHARDS = 5
"""Parts of a slow run of one kind, which may run beside each other."""

WORDS = [
    "",
    " ",
    "x",
    "R",
    "z",
    "v_x",
    "t",
    "k_o",
    "c_o",
    "KelvinVoigt.k",
    "0.m",
    "v0.x",
    "$$",
    r"$\frac{",
    "\x1b[31m",
    "\ud800",
    "=1+1",
    "@x",
    "-",
    "--",
    "a" * 300,
    "ä",
    "θ",
    "../x",
    "/",
    ".",
    "nan",
    "[red]",
    "%s",
    "{}",
    "x=1",
    "k_o=1:2",
    "0,1",
    ",",
    ":",
    "force",
    "impact",
    "up x>0.1",
    "force:2",
    "kelvin-voigt:1e6",
    "hertz:1e300",
    "true",
    "None",
    "closed-form",
    "siconos",
]
NUMBERS = [
    "0",
    "1",
    "2",
    "-1",
    "0.5",
    "nan",
    "inf",
    "-inf",
    "1e300",
    "-1e300",
    "1e160",
    "1e-160",
    "1e-300",
    "5e-324",
    "1e25",
    "1e12",
    "1e400",
    "1_0",
    "0x10",
    "٣",
    "1e",
    "",
    "1,5",
    "true",
]
STEPS = ["0.01", "0.02", "0.1", "0.3", "1e160", "1e300", "1e-300", "0", "-1", "nan", "inf", "x"]
ENDS = ["0.1", "0.2", "0.5", "1", "1e-160", "1e160", "1e300", "0", "-1", "nan", "inf", "x"]
INPUTS = [
    "ball.toml",
    "soft.toml",
    "broken.toml",
    "curve.csv",
    "wild.csv",
    "comma.csv",
    "logger.csv",
    "two.lcp",
    "box.txt",
    "q.csv",
    "two.npz",
    "folder",
]
OUTPUTS = [
    "out.csv",
    "out.xlsx",
    "out.tex",
    "out.toml",
    "out.npz",
    "out.nc",
    "out.parquet",
    "out.mat",
    "out.html",
    "out.png",
    "out.svg",
    "out.txt",
    "out",
    "nowhere/out.csv",
    "link.csv",
    "old.csv",
    "",
    *INPUTS,
]


def one(rng, choices):
    return choices[int(rng.integers(len(choices)))]


def number(rng):
    return float(
        one(rng, ["0", "1", "2", "-1", "0.5", "nan", "inf", "1e300", "1e160", "1e-160", "1e25", "1e-300", "5e-324"])
    )


# ---- commands -------------------------------------------------------------------------------------------------------


RUN = {"--set": None, "--dt": STEPS, "--t-end": ENDS, "--solver": [*SOLVERS, *WORDS]}
STUDY = {"--out": OUTPUTS, "--plot": OUTPUTS, "--report": OUTPUTS, "--decimal-comma": None}
LABELS = [*METHODS, "moreau-jean:theta=1", "moreau-jean:theta=x", "exact:max_events=1e300", "rk4,rk4", *WORDS]
OVER = [
    "omega=2.8:3:2",
    "x0=-1:0:2",
    "v0=0:1:2",
    "k_o=1:2:2",
    "x=1:2",
    "nan=nan:nan:2",
    "omega=1e300:1e300:1",
    "x0=0:1:1e9",
    "",
]
COUNTS = ["1", "2", "0", "-1", "x", "1e3", ""]
COMMANDS = {
    "simulate": RUN | {"--method": LABELS, "--out": OUTPUTS, "--plot": OUTPUTS, "--decimal-comma": None},
    "draw": {"--set": None, "--out": OUTPUTS},
    "export": RUN | {"--method": LABELS, "--out": OUTPUTS},
    "animate": RUN | {"--out": ["out.xls", "nowhere/out.gif", "out.csv"], "--seconds": NUMBERS, "--fps": COUNTS},
    "list": {"": ["problems", "methods", "solvers", "elements", "lessons", "projects", *WORDS]},
    "explore": {"--set": None, "--t-end": ENDS, "--out": ["out.html", *OUTPUTS]},
    "solve": {
        "--q": ["q.csv", *WORDS],
        "--solver": [*SOLVERS, *WORDS],
        "--tol": NUMBERS,
        "--max-iter": COUNTS,
        "--lower": NUMBERS,
        "--upper": NUMBERS,
        "--trace": None,
        "--tableau": COUNTS,
        "--all": None,
        "--out": OUTPUTS,
        "--plot": OUTPUTS,
        "--plot-trace": OUTPUTS,
    },
    "design": {
        "": ["kelvin-voigt", "maxwell", "hertz", "hunt-crossley", "tsuji", "kuwabara-kono", *WORDS],
        "--m": NUMBERS,
        "--v0": NUMBERS,
        "--g": NUMBERS,
        "--e": NUMBERS,
        "--contact-time": NUMBERS,
        "--peak-force": NUMBERS,
        "--deflection": NUMBERS,
        "--k": NUMBERS,
        "--c": NUMBERS,
        "--b": NUMBERS,
        "--a": NUMBERS,
        "--n": NUMBERS,
        **STUDY,
    },
    "fit": RUN
    | STUDY
    | {
        "--free": ["k_o", "k_o,c_o", "k_o=1e300", "k", "v0.x=0", *WORDS],
        "--to": INPUTS,
        "--column": ["R=Kraft", "R=F,x", *WORDS],
        "--time": ["Zeit", "t", *WORDS],
        "--unit": ["Kraft=kN", "Zeit=ms", "Kraft=kg", *WORDS],
        "--decimal-comma": None,
        "--decimal": [".", ",", *WORDS],
        "--bound": ["k_o=1:2", "k_o=nan:nan", *WORDS],
        "--sigma": NUMBERS,
        "--sampling": ["point", "mean", ""],
        "--loss": ["linear", "huber", "x"],
        "--starts": ["1", "0", "x"],
        "--seed": ["0", "-1", "1e3"],
        "--level": NUMBERS,
    },
    "sensitivity": {
        "--wrt": ["k_o", "k_o,c_o", "v0.x", "e", *WORDS],
        "--outputs": ["R.max", "x@0.05", "x", "open:1.speed", "impact:1", *WORDS],
        "--set": None,
        "--t-end": ENDS,
        **STUDY,
    },
    "converge": {
        "--set": None,
        "--t-end": ENDS,
        "--methods": LABELS,
        "--dts": ["0.05", "0.1,0.05", *STEPS],
        "--counts": ["7", "0", "x"],
        "--norm": [*NORMS, *WORDS],
        "--penalty": ["kelvin-voigt:1e6", "hertz:1e300", *WORDS],
        "--orders": OUTPUTS,
        **STUDY,
    },
    "compare": RUN | STUDY | {"--methods": LABELS, "--events": OUTPUTS, "--forces": OUTPUTS, "--energies": OUTPUTS},
    "sweep": RUN
    | {
        "--set": [
            "k_o=3000:5000:2",
            "e=0.1,0.2",
            "k_o=1:2",
            "k_o=1:9:2:log",
            "theta=0:2:3",
            "dt=0.1,0.05",
            "x=nan:1:2",
            *WORDS,
        ],
        "--output": ["R.max", "x@0.05", "x", "open:1.speed", "impact:0", *WORDS],
        "--samples": COUNTS,
        "--rule": ["sobol", "saltelli", "random", *WORDS],
        "--seed": ["0", "-1", "1e3"],
        "--out": [*OUTPUTS, "out.zarr"],
        "--decimal-comma": None,
        "--plot": OUTPUTS,
    },
    "poincare": {
        "--set": None,
        "--section": WORDS,
        "--skip": COUNTS,
        "--points": COUNTS,
        "--dt": STEPS,
        **STUDY,
    },
    "bifurcation": {"--over": OVER, "--section": WORDS, "--skip": COUNTS, "--points": COUNTS, "--y": WORDS, **STUDY},
    "basins": {"--over": OVER, "--longest": COUNTS, "--workers": COUNTS, "--dt": STEPS, **STUDY},
    "check": {"": ["lesson-1", "lesson-12", "lesson-13", *WORDS], "--seconds": NUMBERS},
    "project": {"": ["buffer", "bounces", "stops", *WORDS], "--out": OUTPUTS, "--seed": COUNTS},
    "orbit": {"--periods": COUNTS, "--period": NUMBERS, "--transient": COUNTS, **STUDY},
}
"""Options of each command, with what they are given; None: nothing, or --set of a parameter. "" is an argument."""

SLOW = {
    "compare": 0.1,
    "converge": 0.1,
    "sweep": 0.3,
    "poincare": 0.3,
    "bifurcation": 0.3,
    "basins": 0.3,
    "orbit": 0.3,
    "fit": 0.4,
    "check": 0.3,
    "explore": 0.4,
}
"""The commands that run much are given a wrong word more often, so that most of them end at once."""

ALWAYS = {
    "explore": ["--no-open"],
    "poincare": ["--skip", "1", "--points", "2"],
    "bifurcation": ["--skip", "1", "--points", "1"],
    "basins": ["--longest", "2"],
    "fit": ["--t-end", "0.1"],
    "check": ["answer.py"],
    "compare": ["--t-end", "0.1"],
    "converge": ["--t-end", "0.1", "--counts", "7"],
    "sweep": ["--set", "c_o=200:300:2", "--t-end", "0.1", "--dt", "0.05"],
}


def a_command(rng):
    name = one(rng, list(COMMANDS))
    options = COMMANDS[name]
    problems = ["bouncing-ball", "system-1", "system-2", "shaw-holmes", "ball.toml", "soft.toml", "rocking-block"]
    wild = rng.random() < 0.2
    words = [name]
    if "" in options:
        words.append(one(rng, options[""]))
    else:
        known = ["two.lcp", "box.txt", "two.npz"] if name == "solve" else problems
        words.append(one(rng, [*list(PROBLEMS), *INPUTS, *WORDS] if wild else known))
    words += ALWAYS.get(name, []) if rng.random() < 0.9 or name == "explore" else []
    for _ in range(int(rng.integers(0, 5))):
        option = one(rng, [*options, "--help"])
        if rng.random() < 0.04:
            option = one(rng, WORDS)
        values = options.get(option)
        words.append(option)
        if option == "--set" and values is None:
            key = one(
                rng, ["k_o", "c_o", "m", "e", "g", "theta", "tol", "max_iter", "rtol", "max_events", "omega", *WORDS]
            )
            words.append(f"{key}={one(rng, NUMBERS)}")
        elif values is not None:
            words.append(one(rng, values))
    if rng.random() < (0.02 if rng.random() < SLOW.get(name, 1.0) else 0.9):
        words += ["--" + one(rng, ["x", "set", "t-end=x", "out=out.xls"])]
    return words, lambda: command(words)


def command(words):
    said, told = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(told):
        try:
            main([word.replace("\0", "") for word in words])
        except SystemExit as stop:
            code = stop.code
    assert code in (0, 1, 2), f"exit code {code}\n{told.getvalue()[-3000:]}"
    if code == 2:
        refusal = [line for line in told.getvalue().splitlines() if line.startswith("lcpimpact: ")]
        assert len(refusal) == 1, told.getvalue()[-3000:]
    assert "\x1b" not in said.getvalue() + told.getvalue()


# ---- files ----------------------------------------------------------------------------------------------------------


def toml(value):
    """A value as a file may hold it: as TOML has it, or as it has not."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=bool(any("\ud800" <= each < "\ue000" for each in value)))
    return "[]" if value is None else repr(value)


def a_value(rng):
    return one(rng, [number(rng), one(rng, WORDS), True, [], [1.0, 2.0], {}, 3, -1, None, 10**400])


def a_scheme_file(rng):
    nodes = ["x", "z", "ground", "y"]
    lines = [f"name = {toml(one(rng, ['mine', *WORDS]))}"] if rng.random() < 0.8 else []
    for _ in range(int(rng.integers(0, 6))):
        kind = one(rng, list(ELEMENTS))
        lines += ["[[elements]]", f"type = {toml(kind if rng.random() < 0.95 else one(rng, WORDS))}"]
        for each in fields(ELEMENTS[kind]):
            if each.name == "symbols" or rng.random() < 0.1:
                continue
            is_node = each.type == "str" and each.name not in ("name", "normal")
            value = one(rng, nodes) if is_node else one(rng, [1.0, 10.0, 0.5, 100.0, number(rng)])
            if rng.random() < 0.1:
                value = a_value(rng)
            if each.name != "name" or rng.random() < 0.3:
                lines.append(f"{each.name} = {toml(value)}")
    for node in nodes:
        if rng.random() < 0.2:
            lines += [f"[initial.{node}]", f"{one(rng, ['q', 'v', 'w'])} = {toml(one(rng, [0.0, 1.0, a_value(rng)]))}"]
    if rng.random() < 0.7:
        lines += ["[run]", f"method = {toml(one(rng, [*METHODS, *WORDS]))}", f"dt = {one(rng, STEPS)}"]
        lines += [f"t_end = {one(rng, ENDS)}"]
    text = mangled(rng, "\n".join(lines).encode("utf-8", "surrogatepass"))

    def run():
        Path("fuzz.toml").write_bytes(text)
        stated = li.read_scheme_file("fuzz.toml")
        li.write_scheme_file(stated.problem, "again.toml", stated.run)
        if rng.random() < 0.1:
            save(draw_scheme(stated.problem.scheme), "out.png")
        run = li.simulate(stated.problem, stated.run.method, dt=0.05, t_end=0.5, throw=False)
        run.save("out.csv")
        str(run)

    return text, run


def an_lcp_file(rng):
    n = int(rng.integers(0, 5))
    ending = one(rng, [".lcp", ".txt", ".csv", ".mtx", ".npz", ".npy"])
    M = rng.normal(size=(n, n)) if rng.random() < 0.6 else np.eye(n) * 2.0
    q = np.array([number(rng) if rng.random() < 0.2 else rng.normal() for _ in range(n)])
    parts = {"M": M, "q": q}
    for bound in ("lower", "upper"):
        if rng.random() < 0.3:
            parts[bound] = np.array([number(rng) for _ in range(int(one(rng, [1, n, n, n + 1])))])
    if rng.random() < 0.1:
        parts[one(rng, ["A", "bands", "x", "M"])] = rng.normal(size=(n, one(rng, [n, 1, 2])))
    data = io.BytesIO()
    if ending == ".npz":
        np.savez_compressed(data, **parts)
    elif ending == ".npy":
        np.save(data, np.column_stack([M, q]))
    elif ending == ".mtx":
        entries = [f"{i + 1} {j + 1} {M[i, j]}" for i in range(n) for j in range(n)]
        data.write("\n".join(["%%MatrixMarket matrix coordinate real general", f"{n} {n} {n * n}", *entries]).encode())
    else:
        between = one(rng, [" ", ", ", "\t", ";"])
        rows = [between.join(map(str, row)) for row in M.tolist()]
        rows += [
            f"{name}: {between.join(map(str, each.ravel().tolist()))}" for name, each in parts.items() if name != "M"
        ]
        data.write("\n".join(rows).encode())
    text = mangled(rng, data.getvalue())
    solver = one(rng, [*SOLVERS, "x"]) if rng.random() < 0.9 else "qp:osqp"

    def run():
        Path(f"fuzz{ending}").write_bytes(text)
        given = read_lcp(f"fuzz{ending}", "q.csv" if ending == ".mtx" else None)
        write_lcp("again.lcp", given.M, given.q, given.lower, given.upper)
        kwargs = {"trace": bool(rng.random() < 0.2), "throw": False}
        found = li.solve_lcp(given.M, given.q, solver, lower=given.lower, upper=given.upper, **kwargs)
        str(found.trace)
        assert np.isfinite(found.z).all() or not found.success

    return (ending, solver, text), run


def a_measurement(rng):
    names = one(rng, [["t", "x", "R", "v_x", "t_R"], ["Zeit [ms]", "R [kN]", "x (mm)", "v_x in m/s", "T [°C]"]])
    header = [one(rng, names) if rng.random() < 0.3 else name for name in names[: int(rng.integers(1, 6))]]
    rows = [[f"{0.01 * i:g}", *(f"{rng.normal():.3g}" for _ in header[1:])] for i in range(int(rng.integers(0, 8)))]
    for row in rows:
        if rng.random() < 0.1:
            row[int(rng.integers(len(row)))] = one(rng, [*NUMBERS, *WORDS])
    lines = [",".join(header), *(",".join(row) for row in rows)]
    text = mangled(rng, "\n".join(lines).encode("utf-8", "surrogatepass"))
    free = one(rng, [["k_o"], ["k_o", "c_o"], {"k_o": number(rng)}, ["v0.x"], [one(rng, WORDS)]])
    column = one(rng, [None, "R", "x", ["x", "R"], one(rng, WORDS)])

    def run():
        Path("fuzz.csv").write_bytes(text)
        options = {"sampling": one(rng, ["point", "mean"]), "loss": one(rng, ["linear", "huber"])}
        li.fit(
            li.load_problem("system-1"),
            free,
            "fuzz.csv",
            column=column,
            method="moreau-jean",
            dt=0.01,
            t_end=0.1,
            **options,
        )

    return (text, free, column), run


def mangled(rng, data):
    """The bytes as they are, cut, with some changed, or with a piece twice."""
    if rng.random() < 0.6 or not data:
        return data
    i, j = sorted(int(each) for each in rng.integers(0, len(data) + 1, 2))
    changed = bytearray(data)
    for place in rng.integers(0, len(data), 3):
        changed[place] = int(rng.integers(256))
    return one(
        rng,
        [
            data[:i],
            data[:i] + data[j:],
            data[:j] + data[i:],
            bytes(changed),
            b"\xef\xbb\xbf" + data,
            b"\xff\xfe" + data,
        ],
    )


# ---- calls ----------------------------------------------------------------------------------------------------------


@cache
def things():
    """What calls are given, made once: a problem, its runs, and tables and results of studies."""
    ball, block = li.load_problem("bouncing-ball"), li.load_problem("system-1")
    forced = li.load_problem("shaw-holmes", omega=2.7)
    run = li.simulate(block, "exact", dt=0.05, t_end=0.5)
    convergence = li.convergence(ball, ["moreau-jean"], [0.1, 0.05], t_end=0.5)
    costs = li.work_precision(ball, ["moreau-jean"], [0.1], t_end=0.5, repeats=1)
    section = li.poincare(forced, "force", skip=1, points=3)
    swept = li.sweep(
        block, li.draw_samples({"k_o": (3000.0, 5000.0)}, 4, "saltelli"), dt=0.05, t_end=0.5, progress=False
    )
    data = pd.DataFrame({"t": run.t, "x": run["x"]})
    return {
        "problem": ball,
        "block": block,
        "forced": forced,
        "run": run,
        "trace": li.solve_lcp([[2.0, 1.0], [1.0, 2.0]], [-5.0, -6.0], "lemke", trace=True).trace,
        "convergence": convergence,
        "costs": costs,
        "section": section,
        "data": data,
        "comparison": li.compare(block, ["moreau-jean"], dt=0.05, t_end=0.5),
        "ledger": li.energy_ledger(run),
        "design": li.design("kelvin-voigt", m=1.0, v0=1.0, k=1e3, c=1.0),
        "fit": li.fit(block, ["k_o"], data, method="moreau-jean", dt=0.05, t_end=0.5),
        "diagram": li.bifurcation(lambda omega: li.load_problem("shaw-holmes", omega=omega), [2.7], skip=1, points=2),
        "orbit": li.periodic_orbit(forced, transient=30),
        "swept": swept,
        "indices": li.sobol_indices(swept, "R.max"),
        "M": [[2.0, 1.0], [1.0, 2.0]],
        "q": [-5.0, -6.0],
        "lcs": {"A": [[0.0, 1.0], [-1.0, 0.0]], "B": [[0.0], [1.0]], "C": [[1.0, 0.0]]},
    }


def family(**values):
    return li.load_problem("shaw-holmes", **values)


def calls():
    """Functions with arguments that are good: (function, {argument: value})."""
    g = things()
    axes = {"dt": 0.05, "t_end": 0.5}
    found = [
        (
            li.simulate,
            {
                "problem": g["problem"],
                "method": method,
                **axes,
                "lcp_solver": "auto",
                "throw": False,
                "progress": False,
            },
        )
        for method in ("moreau-jean", "exact", "event-driven", "generalized-alpha", "radau-fesd", "dopri5")
    ]
    found += [
        (li.load_problem, {"name": "system-1", "k_o": 1.0}),
        (
            li.sweep,
            {
                "problem": g["block"],
                "parameters": {"k_o": [3000.0]},
                "method": "moreau-jean",
                **axes,
                "outputs": ("R.max",),
                "executor": None,
                "out": None,
                "lcp_solver": "auto",
                "progress": False,
                "chunk": None,
            },
        ),
        (li.draw_samples, {"ranges": {"k_o": (1.0, 2.0)}, "count": 4, "rule": "sobol", "seed": 0, "log": ()}),
        (li.Samples, {"values": {"k_o": [1.0]}, "rule": "list", "count": 0}),
        (li.sobol_indices, {"dataset": g["swept"], "output": "R.max"}),
        (li.plot_sweep, {"dataset": g["swept"], "output": "R.max", "x": None, "at": None}),
        (li.plot_sobol, {"table": g["indices"], "title": ""}),
        (
            li.solve_lcp,
            {
                "M": g["M"],
                "q": g["q"],
                "solver": "auto",
                "lower": None,
                "upper": None,
                "tol": 1e-9,
                "max_iter": 50,
                "z0": None,
                "throw": False,
                "trace": False,
            },
        ),
        (li.prepare_lcp, {"M": g["M"], "solver": "lemke", "lower": None, "upper": None}),
        (li.all_solutions, {"M": g["M"], "q": g["q"], "lower": None, "upper": None}),
        (li.plot_cones, {"M": g["M"], "q": g["q"], "path": "out.png"}),
        (li.plot_trace, {"trace": g["trace"], "path": "out.png"}),
        (write_lcp, {"path": "again.lcp", "M": g["M"], "q": g["q"], "lower": None, "upper": None}),
        (read_lcp, {"path": "two.lcp", "q": None}),
        (li.read_scheme_file, {"path": "ball.toml"}),
        (li.write_scheme_file, {"problem": g["problem"], "path": "again.toml", "run": None}),
        (li.Run, {"method": "moreau-jean", "dt": 0.1, "t_end": 1.0, "solver": "auto", "options": {}}),
        (li.Dense, {"M": g["M"]}),
        (li.Banded, {"bands": [[2.0, 2.0], [1.0, 0.0]]}),
        (li.Factored, {"A": g["M"], "H": g["M"]}),
        (li.LinearComplementaritySystem, dict(g["lcs"], D=None, a=None, c=None)),
        (
            li.Problem,
            {
                "name": "mine",
                "scheme": g["problem"].scheme,
                "q0": {},
                "v0": {},
                "t_end": 1.0,
                "parameters": {},
                "source": "-",
            },
        ),
        (li.Scheme, {}),
        (li.Harmonic, {"amplitude": 1.0, "omega": 1.0, "phase": 0.0}),
        (li.Ramp, {"start": 0.0, "end": 1.0, "t_start": 0.0, "t_end": 1.0}),
        (li.Table, {"times": [0.0, 1.0], "values": [0.0, 1.0]}),
        (li.Polynomial, {"coefficients": [1.0, 2.0]}),
        (li.Target, {"measure": len, "value": 1.0, "sigma": None}),
        (li.Stroboscope, {"phase": 0.0, "period": None}),
        (li.Impacts, {"contact": None}),
        (li.Crossing, {"series": "x", "level": 0.0, "direction": 1}),
        (li.penalized, {"problem": g["problem"], "law": "kelvin-voigt", "k": 1e6}),
        (li.with_values, {"problem": g["block"], "values": {"k_o": 1.0}}),
        (value_at, {"problem": g["block"], "address": "k_o"}),
        (CurveTable.of, {"data": g["data"], "decimal": None}),
        (error_norms, {"run": g["run"], "truth": g["run"], "norms": ["sup_q"]}),
        (reference, {"problem": g["problem"], "t_end": 0.1, "unlike": []}),
        (
            li.convergence,
            {
                "problem": g["problem"],
                "methods": ["moreau-jean"],
                "dts": [0.1],
                "t_end": 0.2,
                "norms": ["sup_q"],
                "penalties": [],
                "reference": None,
                "repeats": 1,
                "lcp_solver": "auto",
            },
        ),
        (
            li.work_precision,
            {
                "problem": g["problem"],
                "methods": ["moreau-jean"],
                "dts": [0.1],
                "rtols": [1e-3],
                "t_end": 0.2,
                "norms": ["sup_q"],
                "repeats": 1,
            },
        ),
        (li.observed_orders, {"study": g["convergence"], "norm": "sup_q"}),
        (observed_order, {"problem": g["problem"], "method": "moreau-jean", "dts": [0.1, 0.05], "t_end": 0.2}),
        (li.energy_ledger, {"run": g["run"]}),
        (
            li.compare,
            {
                "problem": g["problem"],
                "methods": ["moreau-jean"],
                "dt": 0.05,
                "t_end": 0.2,
                "reference": None,
                "lcp_solver": "auto",
            },
        ),
        (li.cross_validate, {"problem": g["problem"], "routes": ["x"], "dt": 0.1, "t_end": 0.2, "tol": None}),
        (li.design, {"law": "kelvin-voigt", "m": 1.0, "v0": 1.0, "g": 0.0, "k": 1e3, "c": 1.0}),
        (li.design, {"law": "hunt-crossley", "m": 1.0, "v0": 1.0, "e": 0.5, "peak_force": 10.0, "n": 1.5}),
        (
            li.fit,
            {
                "problem": g["block"],
                "free": ["k_o"],
                "data": g["data"],
                "column": "x",
                "outputs": None,
                "sigma": None,
                "bounds": None,
                "sampling": "point",
                "loss": "linear",
                "method": "moreau-jean",
                "dt": 0.05,
                "t_end": 0.5,
                "starts": 1,
                "seed": 0,
                "level": 0.95,
            },
        ),
        (
            li.poincare,
            {"problem": g["forced"], "section": "force", "skip": 1, "points": 2, "t_end": None, "dt": None},
        ),
        (
            li.bifurcation,
            {
                "family": lambda omega: family(omega=omega),
                "values": [2.7],
                "section": "force",
                "skip": 1,
                "points": 1,
                "continue_from": False,
                "workers": 1,
            },
        ),
        (
            li.basins,
            {
                "family": lambda a, b: family(x0=a, v0=b),
                "first": [-0.1],
                "second": [0.1],
                "parameters": ("x0", "v0"),
                "longest": 2,
                "workers": 1,
            },
        ),
        (li.periodic_orbit, {"problem": g["forced"], "periods": 1, "T": None, "transient": 0}),
        (li.continue_orbit, {"family": lambda omega: family(omega=omega), "values": [2.7], "periods": 1}),
        (least_gap, {"orbit": g["orbit"], "contact": None}),
        (li.grazing, {"family": lambda omega: family(omega=omega), "bracket": (2.7, 2.71), "transient": 1}),
        (li.lyapunov, {"problem": g["forced"], "t_end": 2.0, "t_start": 0.0}),
        (g["convergence"].plot, {"norm": "sup_q", "path": None}),
        (g["costs"].plot, {"norm": "sup_q", "cost": "steps", "path": None}),
        (g["section"].plot, {"x": None, "path": None}),
        (g["diagram"].plot, {"y": None, "path": None}),
        (g["orbit"].plot, {"node": None, "path": None}),
        *((g[name].plot, {"path": None}) for name in ("comparison", "ledger", "design", "fit")),
        (g["run"].sample, {"t": [0.1], "side": "right"}),
        (g["run"].save, {"path": "out.csv", "decimal": ","}),
        (li.read_curves, {"data": g["data"], "columns": ["R"], "time": "t", "units": {"R": "kN"}, "decimal": None}),
        (g["run"].certify, {"problem": None}),
        (g["run"].__getitem__, {"name": "x"}),
        (g["run"].plot, {"path": None}),
    ]
    for kind in ELEMENTS.values():
        nodes = iter(["x", "z", "y", "w", "u", "s"])
        given = {}
        for each in fields(kind):
            if each.init and each.name != "symbols":
                is_node = each.type == "str" and each.name not in ("name", "normal")
                given[each.name] = next(nodes) if is_node else None if each.name == "name" else 1.0
        found.append((kind, given))
    return found


def wild_values():
    g = things()
    return [
        None,
        True,
        False,
        "",
        "x",
        "$$",
        "\x1b",
        "\ud800",
        b"x",
        0,
        1,
        -1,
        2,
        3.0,
        2.5,
        -0.0,
        1e300,
        1e160,
        1e-300,
        5e-324,
        math.nan,
        math.inf,
        -math.inf,
        10**400,
        1j,
        Decimal("1"),
        Fraction(1, 3),
        np.float32(1.5),
        np.int64(2),
        np.bool_(True),
        np.array(1.0),
        np.array([]),
        np.array([1.0, 2.0]),
        np.array([["a"]]),
        np.array([1j]),
        np.array([None]),
        np.eye(2),
        np.full((2, 2), np.nan),
        np.datetime64("2000-01-01"),
        [],
        [1],
        ["x"],
        [None],
        [[]],
        [math.nan],
        [1e300, 1e-300],
        [0.1, "x"],
        ("x",),
        (1.0, 2.0),
        {},
        {"x": 1},
        {1: "x"},
        {"k_o": math.nan},
        {"x": None},
        {"k_o": (1.0, 2.0)},
        set(),
        range(3),
        iter([]),
        object(),
        lambda: None,
        lambda *a, **k: None,
        lambda *a, **k: 1 / 0,
        int,
        str,
        li.Problem,
        li,
        g["problem"],
        g["block"],
        g["run"],
        g["data"],
        g["ledger"],
        pd.DataFrame(),
        pd.DataFrame({"t": [0.0, 1.0]}),
        pd.DataFrame({"t": ["a"], "x": [None]}),
        pd.Series([1.0]),
        Path("nowhere/out.csv"),
        Path("folder"),
        "out.csv",
        "out.png",
        "out.nc",
        "ball.toml",
        li.Status.SOLVED,
        li.Harmonic(1.0, 1.0),
        METHODS["exact"](),
        METHODS["exact"],
        slice(None),
        li.Mass("x", 1.0),
        "system-1",
        "moreau-jean",
        "exact",
        "lemke",
        "sup_q",
        "hertz",
        "maxwell",
    ]


OPTIONS = {"theta": 1.0, "rtol": 1e-6, "max_events": 10, "tol": 1e-9, "max_iter": 5, "atol": 1e-9, "max_steps": 100}


def a_call(rng):
    function, good = one(rng, calls())
    given = dict(good)
    for _ in range(int(rng.integers(1, 3))):
        names = list(given)
        if function is li.simulate and rng.random() < 0.3:
            names = list(OPTIONS)
        if function is li.lyapunov:
            names = ["problem"]  # 100,000 events are followed before a length is given up, which takes a minute
        if names:
            name, value = one(rng, names), one(rng, wild_values())
            # What a function of the user's own raises is the user's.
            if not (callable(good.get(name)) and callable(value)) and not (name == "problem" and callable(value)):
                given[name] = value
    if function is li.Scheme:
        wild = one(rng, wild_values())
        return (function, wild), lambda: li.Scheme(li.Mass("x", 1.0), wild).assemble()

    def run():
        made = function(**given)
        if isinstance(made, tuple(ELEMENTS.values())):
            li.Scheme(li.Mass("x", 1.0), made).assemble()
        if not isinstance(made, np.ndarray):
            str(made)

    return (
        getattr(function, "__name__", function),
        {name: given[name] for name in given if given[name] is not good.get(name)},
    ), run


# ---- what is asked of every case ------------------------------------------------------------------------------------

KINDS: dict[str, Callable] = {
    "commands": a_command,
    "scheme files": a_scheme_file,
    "LCP files": an_lcp_file,
    "measurements": a_measurement,
    "calls": a_call,
}

BALL = """name = "ball"
t_end = 0.5
[[elements]]
type = "Mass"
node = "x"
m = 1.0
[[elements]]
type = "Load"
node = "x"
f = 9.81
"""
WRITTEN = {
    "ball.toml": BALL + '[[elements]]\ntype = "Bumper"\nupper = "x"\nlower = "ground"\ngap = 0.1\ne = 0.5\n',
    "soft.toml": BALL
    + '[[elements]]\ntype = "KelvinVoigt"\na = "x"\nb = "ground"\nk = 100.0\nc = 1.0\n[run]\nmethod = "rk4"\n',
    "broken.toml": "name = [",
    "curve.csv": "t,R,x\n0,100,0\n0.05,300,0.1\n0.1,200,0.2\n",
    "comma.csv": "t;R;x\n0,1;1,234;x\n0,2;1.234,5;2,345\n",
    "logger.csv": "Test;5\nZeit [ms];Kraft [kN]\n0;0,1\n50;0,3\n100;0,2\n",
    "wild.csv": "=t,\x1b,R\nnan,1e999,x\n",
    "two.lcp": "2 1 -5\n1 2 -6\n",
    "box.txt": "M: 2 1\n1 2\nq: -5 -6\nlower: -1 0\nupper: 1 2\n",
    "q.csv": "-1,-2\n",
    "old.csv": "older\n",
    "answer.py": "def impact_time(n, g, H, e):\n    return 0.4\n",
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder of inputs in which cases run; `TRACEBACK_VARIABLE` lets a defect say where it arose."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(TRACEBACK_VARIABLE, "1")
    for name, text in WRITTEN.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    np.savez(tmp_path / "two.npz", M=np.eye(2), q=[-1.0, 1.0])
    (tmp_path / "folder").mkdir()
    with contextlib.suppress(OSError):
        (tmp_path / "link.csv").symlink_to("curve.csv")
    return tmp_path


def written(words):
    """The files that a command is told to write and not to read."""
    pairs = list(pairwise(words))
    told = {
        name
        for option, name in pairs
        if option in ("--out", "--plot", "--plot-trace", "--report", "--events", "--forces", "--energies", "--orders")
    }
    told |= {"curve.csv"} if "link.csv" in told else set()
    read = {words[1], *(name for option, name in pairs if option in ("--to", "--q"))}
    return told - read - ({"curve.csv"} if "link.csv" in read else set())


class HangError(BaseException):
    """A case took more than `LONGEST`."""


def stop(number, frame):
    raise HangError


def breaks(kind, seed, folder):
    """What is wrong with a case, or "". What takes too long is tried again: the first time may have compiled it."""
    wrong = tried(kind, seed, folder)
    return tried(kind, seed, folder) if "takes too long" in wrong else wrong


def tried(kind, seed, folder):
    kept = {path: path.read_bytes() for path in folder.iterdir() if path.name in WRITTEN or path.name == "two.npz"}
    rng = np.random.default_rng([list(KINDS).index(kind), seed])
    what, run = KINDS[kind](rng)
    wrong, began = "", time.process_time()
    timed = hasattr(signal, "SIGPROF")
    if timed:
        signal.signal(signal.SIGPROF, stop)
        signal.setitimer(signal.ITIMER_PROF, LONGEST)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            run()
    except li.LcpImpactError as error:
        if not str(error) or any(each in str(error) for each in "\x1b\ud800"):
            wrong = f"its message is {str(error)!r}"
    except HangError:
        wrong = "takes too long\n" + traceback.format_exc()[-2000:]
    except Exception:  # noqa: BLE001 - which of them it is, is the finding
        wrong = traceback.format_exc()[-3000:]
    finally:
        if timed:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
    if time.process_time() - began > LONGEST and not wrong:
        wrong = f"takes too long: {time.process_time() - began:.0f} s"
    free = written(what) if kind == "commands" else set()
    if kind == "calls" and str(what[0]).startswith("write"):
        free = {str(each) for each in what[1].values()}
    for path, data in kept.items():
        if not path.exists() or path.read_bytes() != data:
            if path.name not in free:
                wrong += f"\n{path.name} was changed"
            path.write_bytes(data)
    for path in folder.iterdir():
        if path.name.startswith("."):
            wrong += f"\n{path.name} was left"
        if path.name == "out.zarr" and path.is_dir():
            shutil.rmtree(path)
        if path.name.startswith((".", "out", "again", "fuzz")) and path.is_file():
            path.unlink()
    return wrong and f"case({kind!r}, {seed}): {what!r}\n{wrong}"


CASES = [pytest.param(kind, range(QUICK[kind]), id=f"{kind}-quick") for kind in KINDS]
CASES += [
    pytest.param(kind, range(1000 + i, 1000 + count, SHARDS), marks=pytest.mark.slow, id=f"{kind}-{i}")
    for kind, count in MANY.items()
    for i in range(SHARDS)
]


@pytest.mark.parametrize(("kind", "seeds"), CASES)
def test_whatever_is_given_is_answered_refused_or_fails_in_words(kind, seeds, folder):
    wrong = [text for seed in seeds if (text := breaks(kind, seed, folder))]
    assert not wrong, f"{len(wrong)} of {len(seeds)}:\n" + "\n".join(wrong[:5])


# ---- signals --------------------------------------------------------------------------------------------------------

SIGNALLED = {
    "a long run": ["simulate", "system-1", "--dt", "1e-6", "--t-end", "20", "--out", "old.csv", "--plot", "out.png"],
    "many runs": ["converge", "bouncing-ball", "--t-end", "3", "--out", "old.csv", "--plot", "out.png"],
}


PNG_END = b"IEND\xaeB`\x82"


def as_it_was_or_whole(path):
    """A table ends with a whole row, a picture with its last chunk."""
    written = path.read_bytes()
    if path.suffix == ".png":
        return written.endswith(PNG_END)
    rows = written.decode().splitlines()
    return written == b"older\n" or (
        written.endswith(b"\n") and len(rows) > 1 and rows[-1].count(",") == rows[0].count(",")
    )


def signalled(process, number):
    """What a process prints to stderr until a signal ends it.

    It is sent again as a user does who sees nothing happen: Python drops an interrupt that falls into a callback of its
    own import system before the command has begun.
    """
    for _ in range(5):
        process.send_signal(number)
        try:
            return process.communicate(timeout=20)[1]
        except subprocess.TimeoutExpired:
            continue
    process.kill()
    return process.communicate()[1]


@pytest.mark.skipif(os.name == "nt", reason="Windows has no signals to be caught")
@pytest.mark.parametrize(("number", "codes"), [("SIGTERM", (143, -15)), ("SIGINT", (130, 1, -2))])
@pytest.mark.parametrize("what", SIGNALLED)
@pytest.mark.parametrize("after", [0.7, *(pytest.param(after, marks=pytest.mark.slow) for after in (0.1, 1.5, 4.0))])
def test_a_signal_ends_a_command_and_leaves_its_files_as_they_were_or_whole(folder, what, number, codes, after):
    start = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
    program = [sys.executable, "-c", start + "from lcpimpact.cli.main import main; main()", *SIGNALLED[what]]
    before = {path.name for path in folder.iterdir()}
    process = subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=folder)
    time.sleep(after)
    error = signalled(process, getattr(signal, number))
    assert process.returncode in (*codes, 0)
    if process.returncode == 130:
        assert b"Traceback" not in error
    left = {path.name for path in folder.iterdir()}
    assert before <= left <= before | {"out.png", "old.events.csv"}
    if process.returncode == 0:
        assert "out.png" in left
    assert all(as_it_was_or_whole(folder / name) for name in left & {"old.csv", "old.events.csv", "out.png"})


INTERRUPTED_IMPORT = """
import ctypes, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
from lcpimpact.cli.main import main

class Interrupted:
    # What an import raises is printed, and an ImportError takes its place: so does the C macro import_array.
    def find_spec(self, name, *_):
        if name == "scipy":
            ctypes.CFUNCTYPE(None)(lambda: signal.raise_signal(signal.SIGINT))()  # as compiled code calls back
            try:
                signal.raise_signal(signal.SIGINT)
            except KeyboardInterrupt:
                sys.excepthook(*sys.exc_info())
                raise ImportError("a module failed to import") from None

sys.meta_path.insert(0, Interrupted())
main(["simulate", "system-1"])
"""


def test_an_interrupted_import_prints_one_sentence():
    done = subprocess.run([sys.executable, "-c", INTERRUPTED_IMPORT], capture_output=True, text=True, timeout=60)
    assert done.returncode == 130
    assert done.stderr == "lcpimpact: interrupted: finished files are complete, and no partial file remains\n"


# ---- a soak ---------------------------------------------------------------------------------------------------------

SOAK = int(os.environ.get("LCPIMPACT_SOAK", "600"))
"""Runs of random schemes in one process: LCPIMPACT_SOAK=10000 pytest tests/cli/test_fuzz.py -m slow -k soak."""

GROWTH = 50e6
"""Bytes by which a process may grow after a third of the runs, which has filled what it keeps."""


def resident():
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="only Linux tells what a process takes")
def test_a_soak_of_random_schemes_by_all_methods_keeps_no_memory_and_calls_no_broken_run_solved():
    runs, seed, early = 0, 0, 0
    solved, refused = dict.fromkeys(METHODS, 0), 0
    while runs < SOAK:
        seed += 1
        try:
            problem = (random_problem if seed % 2 else frictional)(seed)
        except li.InputError:
            continue
        for method in METHODS:
            try:
                run = li.simulate(problem, method, dt=1e-2, t_end=1.0, throw=False, progress=False)
            except li.UnsupportedError:
                refused += 1
                continue
            runs += 1
            solved[method] += run.success
            assert np.isfinite(run.q).all(), (seed, method)
            if run.success:
                assert run.certify().holds, (seed, method)
        if not early and runs > SOAK / 3:
            gc.collect()
            early = resident()
    gc.collect()
    grown = (resident() - early) / 1e6
    print(f"\n{runs} runs of {seed} schemes, {refused} refused, {grown:.1f} MB more; solved {solved}")  # noqa: T201
    assert 1e6 * grown < GROWTH
    assert sum(solved.values()) > runs / 2
