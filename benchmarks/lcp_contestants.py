"""Who takes part in `lcp.py`, and how each is called.

A contestant is made ready for one problem, and then takes its turns: a turn is one call, repeated while calls are short.
Whoever cannot take a problem says why.
"""

from __future__ import annotations

import json
import re
import select
import subprocess
import time
import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from enum import Enum
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from lcp_families import Case

from lcpimpact.arrays import Array
from lcpimpact.errors import LcpImpactError, Status, UnsupportedError
from lcpimpact.lcp import SOLVERS
from lcpimpact.lcp.operators import Banded
from lcpimpact.lcp.problem import LCPSolution
from lcpimpact.lcp.solve import prepare_lcp, solve_lcp

HERE = Path(__file__).parent
DEBIAN_PYTHON = Path("/usr/bin/python3")
CALLS, SAMPLE = 50, 5e-4
"""A call is repeated in a turn up to so many times, or for so many seconds, and longer until there are three."""
PATIENCE = 2.0
"""Seconds that Siconos may take for a turn; all others may take twice as long."""
LOADING = 60.0
"""Seconds for imports and compilation."""
HUNG = object()
"""The answer of a process that gives none."""
SICONOS = {
    "lemke": "LEMKE",
    "newton-min": "NEWTONMIN",
    "newton-min-ls": "NEWTON_MIN_FBLSA",
    "newton-fb-ls": "NEWTON_FB_FBLSA",
}
"""Name here to that of the solver in Siconos; ls: with a line search."""
POLISHED = {"eps_abs": 1e-9, "eps_rel": 1e-9, "polishing": True, "max_iter": 20_000}
FAILURES = (ArithmeticError, AttributeError, LookupError, RuntimeError, TypeError, ValueError, LcpImpactError)
"""What a contestant may raise instead of saying that it has failed."""


class MissingError(Exception):
    """Someone who does not take part; the text says why."""


class Verdict(Enum):
    """What a contestant says of its answer."""

    SOLVED = "solved"
    NONE = "there is no solution"
    FAILED = "failed"

    @classmethod
    def of(cls, solved: bool, none: bool = False) -> Verdict:
        """Return the verdict."""
        return cls.SOLVED if solved else cls.NONE if none else cls.FAILED


class Turn(NamedTuple):
    """The median seconds of a call, the answer, and what is said of it."""

    seconds: float
    z: Array | None
    verdict: Verdict


Run: TypeAlias = Callable[[], Turn]


@dataclass(frozen=True)
class Instance:
    """A case with what contestants need of it in other forms."""

    case: Case
    full: Array
    lower: Array
    upper: Array

    @classmethod
    def of(cls, case: Case) -> Instance:
        """Fill in M as an array, and the bounds."""
        n = len(case.q)
        return cls(
            case,
            case.M.array() if isinstance(case.M, Banded) else case.M,
            np.zeros(n) if case.lower is None else case.lower,
            np.full(n, np.inf) if case.upper is None else case.upper,
        )

    @property
    def convex(self) -> bool:
        """Whether it is the optimality condition of a convex QP."""
        return {"symmetric", "psd"} <= set(self.case.tags)


TRIAL = Instance.of(Case(2.0 * np.eye(2), np.array([-1.0, 1.0]), tags=("symmetric", "psd", "p", "positive_diagonal")))


@dataclass(frozen=True)
class Contestant:
    """Who takes part.

    Attributes
    ----------
    name : str
    kind : str          "lcpimpact", "qpsolvers", "peer", or "floor" for what solves no LCP and is no slower than any
    how : str           how it is called
    ready : callable    ready(instance) -> run; raises MissingError if the problem is not one for it
    """

    name: str
    kind: str
    how: str
    ready: Callable[[Instance], Run]


def local(call: Callable[[], Any], read: Callable[[Any], tuple[Array | None, Verdict]]) -> Run:
    """Return the turn of a contestant that is called in this process."""

    def run() -> Turn:
        seconds: list[float] = []
        result = None
        while not seconds or (len(seconds) < CALLS and sum(seconds) < (SAMPLE if len(seconds) > 2 else 10.0 * SAMPLE)):
            began = time.perf_counter()
            try:
                result = call()
            except FAILURES:
                result = None
            seconds.append(time.perf_counter() - began)
        return Turn(median(seconds), *((None, Verdict.FAILED) if result is None else read(result)))

    return run


# ---- lcpimpact ------------------------------------------------------------------------------------------------------


def read_solution(solution: LCPSolution) -> tuple[Array, Verdict]:
    """Return z, and what the status says."""
    return solution.z, Verdict.of(solution.success, solution.status in (Status.RAY, Status.INFEASIBLE))


def total(instance: Instance) -> Run:
    """Return the whole call, with all that is found out about M."""
    case = instance.case
    return local(lambda: solve_lcp(case.M, case.q, lower=case.lower, upper=case.upper, throw=False), read_solution)


def prepared(name: str) -> Contestant:
    """Return a solver of the registry, made ready beforehand for M, whose properties are told to it."""

    def ready(instance: Instance) -> Run:
        case = instance.case
        tags = () if isinstance(case.M, Banded) else case.tags
        try:
            lcp = prepare_lcp(case.M, name, lower=case.lower, upper=case.upper, tags=tags)
        except UnsupportedError as refusal:
            needs = re.search(r"(needs .*), and this problem", str(refusal))
            raise MissingError(needs[1] if needs else str(refusal)) from None
        return local(lambda: lcp.solve(case.q, throw=False), read_solution)

    kind = "qpsolvers" if name.startswith("qp:") else "lcpimpact"
    label = "auto:prepared" if name == "auto" else name
    return Contestant(label, kind, f"prepare_lcp(M, {name!r}), then .solve(q)", ready)


def ours() -> list[Contestant]:
    """Return `auto` as one call, and every solver of the registry and of qpsolvers made ready beforehand."""
    names = list(SOLVERS)
    try:
        import qpsolvers

        names += [f"qp:{backend}" for backend in qpsolvers.available_solvers if f"qp:{backend}" not in names]
    except ImportError:
        names = [name for name in names if not name.startswith("qp:")]
    return [Contestant("auto", "lcpimpact", "solve_lcp(M, q)", total), *map(prepared, names)]


# ---- others, in this process ----------------------------------------------------------------------------------------


def dposv(instance: Instance) -> Run:
    """Return one Cholesky solution of M x = -q, as if every row were free."""
    from scipy.linalg.lapack import dposv as solve

    if not {"symmetric", "p"} <= set(instance.case.tags) or isinstance(instance.case.M, Banded):
        raise MissingError("needs M dense, symmetric and positive definite")
    M, b = np.asfortranarray(instance.full), -instance.case.q
    return local(lambda: solve(M, b), lambda _: (None, Verdict.FAILED))


def quantecon(instance: Instance) -> Run:
    """Return quantecon's Lemke, with the limit of pivots that ours has."""
    from quantecon.optimize import lcp_lemke

    plain(instance)
    M, q = instance.full, instance.case.q
    return local(
        lambda: lcp_lemke(M, q, max_iter=10_000),
        lambda result: (result.z, Verdict.of(result.success, result.status == 2)),
    )


def daqp(instance: Instance) -> Run:
    """Return daqp, as a QP, or as an affine variational inequality if M is not symmetric."""
    from daqp import solve

    case, n = instance.case, len(instance.case.q)
    if "psd" not in case.tags:
        raise MissingError("needs M positive semidefinite")
    rows, upper, lower = np.zeros((0, n)), np.minimum(instance.upper, 1e30), np.maximum(instance.lower, -1e30)
    sense = np.zeros(n, np.int32)
    settings = {} if instance.convex else {"is_avi": True}
    return local(
        lambda: solve(instance.full, case.q, rows, upper, lower, sense, **settings),
        lambda result: (np.array(result[0]), Verdict.of(result[2] == 1, result[2] in (-1, -3))),
    )


def osqp(settings: dict[str, Any]) -> Callable[[Instance], Run]:
    """Return OSQP kept alive for one M: a call hands q over and solves, from a cold start."""

    def ready(instance: Instance) -> Run:
        from osqp import OSQP as Solver
        from scipy.sparse import csc_matrix, identity, triu

        if not instance.convex:
            raise MissingError("needs M symmetric and positive semidefinite")
        q, solver = instance.case.q, Solver()
        # OSQP takes the upper triangle, with its zeros left out.
        solver.setup(
            P=csc_matrix(triu(instance.full)),
            q=q,
            A=identity(len(q), format="csc"),
            l=instance.lower,
            u=instance.upper,
            verbose=False,
            warm_starting=False,
            **settings,
        )

        def call() -> Any:
            solver.update(q=q)
            return solver.solve(raise_error=False)

        def read(result: Any) -> tuple[Array | None, Verdict]:
            status = result.info.status
            return result.x, Verdict.of(status == "solved", status == "dual infeasible")

        return local(call, read)

    return ready


def plain(instance: Instance) -> None:
    """Refuse bounds."""
    if instance.case.lower is not None:
        raise MissingError("takes no bounds")


# ---- Siconos, in a process of its own -------------------------------------------------------------------------------


@dataclass
class Siconos:
    """The process of siconos_lcp.py: it is started when needed, and ended if it does not answer in time."""

    folder: Path
    process: subprocess.Popen[str] | None = field(default=None)
    last: Instance | None = field(default=None)

    def start(self) -> None:
        """Start it.

        Raises
        ------
        MissingError
            With the reason if there is none.
        """
        command = [str(DEBIAN_PYTHON), str(HERE / "siconos_lcp.py")]
        pipe, nothing = subprocess.PIPE, subprocess.DEVNULL
        try:
            self.process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=nothing, text=True)
        except FileNotFoundError:
            raise MissingError(f"no {DEBIAN_PYTHON}") from None
        answer = self.answer(30.0)
        reason = "does not start" if answer is None else answer["missing"]
        if reason:
            self.stop()
            raise MissingError(reason)

    def answer(self, patience: float) -> dict[str, Any] | None:
        """Return the next answer, or None and no process if there is none in time."""
        assert self.process is not None
        assert self.process.stdout is not None
        # One line answers one request, so nothing is ever left in the buffer of the pipe.
        readable, _, _ = select.select([self.process.stdout], [], [], patience)
        line = self.process.stdout.readline() if readable else ""
        if not line:
            self.stop()
            return None
        found: dict[str, Any] = json.loads(line)
        return found

    def stop(self) -> None:
        """End the process."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            self.process = None

    def contestant(self, name: str, solver: str) -> Contestant:
        """Return one of its solvers."""

        def ready(instance: Instance) -> Run:
            plain(instance)
            file = self.folder / "problem.npz"
            if self.last is not instance:
                np.savez(file, M=instance.full, q=instance.case.q)
                self.last = instance

            def run() -> Turn:
                if self.process is None:
                    self.start()
                assert self.process is not None
                assert self.process.stdin is not None
                request = {"file": str(file), "solver": solver, "calls": CALLS, "sample": SAMPLE}
                self.process.stdin.write(json.dumps(request) + "\n")
                self.process.stdin.flush()
                answer = self.answer(PATIENCE)
                if answer is None:
                    return Turn(PATIENCE, None, Verdict.FAILED)
                return Turn(answer["seconds"], np.array(answer["z"], dtype=float), Verdict.of(answer["info"] == 0))

            return run

        return Contestant(f"siconos:{name}", "peer", f"SICONOS_LCP_{solver}, tolerance 1e-10", ready)


# ---- all, in a process that may be ended -----------------------------------------------------------------------------


def everyone(siconos: Siconos) -> list[Contestant]:
    """Return all contestants."""
    osqp_how = "set up for M, then update(q) and solve"
    return [
        *ours(),
        Contestant("lapack:dposv", "floor", "scipy.linalg.lapack.dposv(M, -q): no LCP, the cost of one solve", dposv),
        Contestant("quantecon:lemke", "peer", "quantecon.optimize.lcp_lemke(M, q)", quantecon),
        Contestant("daqp", "peer", "daqp.solve, as an affine variational inequality if M is not symmetric", daqp),
        Contestant("osqp:1e-9", "peer", f"{osqp_how}, eps 1e-9, polished", osqp(POLISHED)),
        Contestant("osqp:default", "peer", osqp_how, osqp({})),
        *(siconos.contestant(name, solver) for name, solver in SICONOS.items()),
    ]


class Reply(NamedTuple):
    """What a turn came to.

    Attributes
    ----------
    preparing : float       seconds that it took to be made ready; 0.0 from the second turn
    spent : float           all seconds, with repeated calls
    turn : Turn or None     None for who does not take the problem
    reason : str            why there is no turn, or no good one
    """

    preparing: float
    spent: float
    turn: Turn | None
    reason: str = ""


def serve(connection: Connection, folder: Path) -> None:
    """Answer ("instance", Instance) by None, ("load", name) by what is missing, ("turn", name) by a `Reply`."""
    warnings.simplefilter("ignore")  # what a solver warns of shows in its answers
    siconos = Siconos(folder)
    known = {each.name: each for each in everyone(siconos)}
    ready: dict[str, Run] = {}
    instance = TRIAL
    try:
        while True:
            what, argument = connection.recv()
            if what == "instance":
                instance, ready = argument, {}
                connection.send(None)
            elif what == "load":
                connection.send(load(known[argument], siconos))
            else:
                connection.send(one_turn(known[argument], instance, ready))
    except EOFError:
        siconos.stop()


def load(contestant: Contestant, siconos: Siconos) -> str:
    """Let it solve something small, so that nobody is timed while it compiles or loads; return what is missing."""
    try:
        if contestant.name.startswith("siconos:") and siconos.process is None:
            siconos.start()
        with suppress(MissingError):
            contestant.ready(TRIAL)()
    except MissingError as reason:
        return str(reason)
    except ImportError as error:
        return f"{error}: pip install {(error.name or contestant.name).split('.')[0]}"
    except FAILURES as error:
        return f"cannot be loaded: {error}"
    return ""


def one_turn(contestant: Contestant, instance: Instance, ready: dict[str, Run]) -> Reply:
    """Make ready who is not yet, and let it take its turn."""
    began = time.perf_counter()
    preparing = 0.0
    if contestant.name not in ready:
        try:
            ready[contestant.name] = contestant.ready(instance)
        except MissingError as reason:
            return Reply(0.0, 0.0, None, str(reason))
        except FAILURES as error:
            return Reply(0.0, 0.0, Turn(0.0, None, Verdict.FAILED), f"not made ready: {error}")
        preparing = time.perf_counter() - began
    turn = ready[contestant.name]()
    return Reply(preparing, time.perf_counter() - began, turn)


@dataclass
class Ring:
    """The process in which all turns are taken: who does not come back from one is ended with it, and it starts anew."""

    folder: Path
    process: BaseProcess | None = None
    connection: Connection | None = None
    instance: Instance | None = None
    loaded: set[str] = field(default_factory=set)

    def ask(self, what: str, argument: Any, patience: float) -> Any:
        """Return the answer to a request; `HUNG`, and no process any more, if there is none in time."""
        if self.connection is None:
            context = get_context("spawn")
            self.connection, theirs = context.Pipe()
            self.process = context.Process(target=serve, args=(theirs, self.folder), daemon=True)
            self.process.start()
            theirs.close()
            patience += LOADING
        try:
            self.connection.send((what, argument))
            if self.connection.poll(patience):
                return self.connection.recv()
        except (EOFError, OSError):
            pass
        self.stop()
        return HUNG

    def load(self, name: str) -> str:
        """Return what the contestant lacks on this machine; "" for nothing."""
        missing = self.ask("load", name, LOADING)
        self.loaded.add(name)
        return "does not load" if missing is HUNG else str(missing)

    def turn(self, instance: Instance, name: str) -> Reply:
        """Let the contestant take a turn."""
        if name not in self.loaded:
            self.load(name)
        if self.instance is not instance:
            self.ask("instance", instance, LOADING)
            self.instance = instance
        reply = self.ask("turn", name, 2.0 * PATIENCE)
        if reply is HUNG:
            seconds = 2.0 * PATIENCE
            return Reply(0.0, seconds, Turn(seconds, None, Verdict.FAILED), f"no answer within {seconds:g} s")
        found: Reply = reply
        return found

    def stop(self) -> None:
        """End the process."""
        if self.process is not None and self.connection is not None:
            self.connection.close()  # an idle process ends by itself, and Siconos with it
            self.process.join(0.5)
            if self.process.is_alive():
                self.process.kill()
                self.process.join()
        self.process = self.connection = self.instance = None
        self.loaded = set()
