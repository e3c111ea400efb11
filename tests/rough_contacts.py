"""Bodies with rough contacts, from event to event: the outside reference of problems with friction.

M q'' + K q = f with the contacts of a list. DOP853 follows a mode, in which each closed contact sticks or slides one way;
modes and impacts are found by enumeration of all combinations. It imports nothing of lcpimpact.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.integrate import solve_ivp

OPEN, STICK = "open", 0
"""The states of a contact, beside the directions 1 and -1 of its slip."""


@dataclass(frozen=True)
class Rough:
    """A contact: gap + normal·q >= 0, and the slip tangent·q' - belt."""

    normal: tuple[float, ...]
    tangent: tuple[float, ...]
    gap: float = 0.0
    mu: float = 0.0
    e: float = 0.0
    e_T: float = 0.0
    belt: float = 0.0


@dataclass(frozen=True)
class Happened:
    """An event: when, "impact", "stick", "slip" or "open", which contact, q, v before and after, and the impulses."""

    t: float
    kind: str
    contact: int
    q: np.ndarray
    before: np.ndarray
    v: np.ndarray
    P: np.ndarray | None = None


class Bodies:
    """The bodies and their contacts."""

    def __init__(self, M, K, f, contacts):
        self.M, self.K, self.f = (np.asarray(each, float) for each in (M, K, f))
        self.contacts = contacts
        self.N, self.T = (np.array([getattr(each, name) for each in contacts]) for name in ("normal", "tangent"))
        self.gap0, self.mu, self.e, self.e_T, self.belt = (
            np.array([getattr(each, name) for each in contacts]) for name in ("gap", "mu", "e", "e_T", "belt")
        )

    def solve(self, mode, start, b):
        """Return x = start + M⁻¹ Hᵀ r with N x + b_N = 0 where closed and T x + b_T = 0 where it sticks, and r_N, r_T."""
        nc, D, rows, rhs = len(mode), [], [], []
        for i, state in enumerate(mode):
            if state != OPEN:
                D.append(self.N[i] - (self.mu[i] * state * self.T[i] if state else 0.0))
                rows.append(self.N[i])
                rhs.append(-b[i])
        for i, state in enumerate(mode):
            if state == STICK and self.mu[i] > 0.0:
                D.append(self.T[i])
                rows.append(self.T[i])
                rhs.append(-b[nc + i])
        r_N, r_T = np.zeros(nc), np.zeros(nc)
        if not D:
            return start, r_N, r_T
        X = np.linalg.solve(self.M, np.array(D).T)
        W = np.array(rows) @ X
        r = np.linalg.lstsq(W, np.array(rhs) - np.array(rows) @ start, rcond=1e-11)[0]
        closed = [i for i, state in enumerate(mode) if state != OPEN]
        r_N[closed] = r[: len(closed)]
        stuck = [i for i in closed if mode[i] == STICK and self.mu[i] > 0.0]
        r_T[stuck] = r[len(closed) :]
        for i in closed:
            if mode[i]:
                r_T[i] = -self.mu[i] * mode[i] * r_N[i]
        return start + X @ r, r_N, r_T

    def choose(self, choices, start, b):
        """Return the first mode of the choices that fits, with its solution."""
        nc = len(self.contacts)
        for mode in product(*choices):
            x, r_N, r_T = self.solve(mode, start, b)
            ξ_N, ξ_T = self.N @ x + b[:nc], self.T @ x + b[nc:]
            size, force = 1e-10 * (1e-30 + np.abs(start).max() + np.abs(b).max()), 1e-10 * (1e-30 + np.abs(r_N).max())
            fits = True
            for i, state in enumerate(mode):
                if len(choices[i]) == 1 and state == OPEN:
                    continue
                fits &= ξ_N[i] >= -size and r_N[i] >= -force and abs(ξ_N[i]) * (state != OPEN) <= size
                fits &= abs(r_T[i]) <= self.mu[i] * r_N[i] + force
                if state in (1, -1) and len(choices[i]) > 2:
                    fits &= state * ξ_T[i] >= -size
            if fits:
                return mode, x, r_N, r_T
        raise AssertionError("no mode fits")

    def impact(self, q, v, rest):
        """Return v after an impact by Newton's law, and the impulses; slower than ``rest`` nothing rebounds."""
        U_N, U_T = self.N @ v, self.T @ v - self.belt
        e = np.where(rest < -U_N, self.e, 0.0)
        b = np.concatenate([e * U_N, self.e_T * U_T - self.belt])
        choices = [(OPEN, STICK, 1, -1) if gap <= 1e-11 else (OPEN,) for gap in self.gaps(q)]
        _, after, P_N, P_T = self.choose(choices, v, b)
        return after, np.concatenate([P_N, P_T])

    def gaps(self, q):
        return self.gap0 + self.N @ q

    def run(self, q, v, t_end, rest=1e-9, stop=lambda log: False):
        """Return the events until t_end, and q and v there."""
        q, v, n, nc, t = np.array(q, float), np.array(v, float), len(q), len(self.contacts), 0.0
        log, forced, zero = [], {}, np.zeros(2 * len(self.contacts))
        while t < t_end and not stop(log):
            while (self.N[near := self.gaps(q) <= 1e-11] @ v < -1e-12).any():
                before, (v, P) = v, self.impact(q, v, rest)
                log.append(Happened(t, "impact", int(np.argmax(near)), q, before, v, P))
                forced = {}
            U_N, U_T = self.N @ v, self.T @ v - self.belt
            choices = []
            for i in range(nc):
                if not near[i] or U_N[i] > 1e-9 or forced.get(i) == OPEN:
                    choices.append((OPEN,))
                elif i in forced:
                    choices.append((OPEN, forced[i]))
                else:
                    choices.append((OPEN, int(np.sign(U_T[i]))) if abs(U_T[i]) > 1e-9 else (OPEN, STICK, 1, -1))
            # A contact that may close closes: the choices are tried from the closed ones on.
            mode, *_ = self.choose([each[1:] + each[:1] for each in choices], self.free(q), zero)
            run = self.follow(mode, t, np.concatenate([q, v]), t_end)
            t, q, v, forced = float(run.t[-1]), run.y[:n, -1], run.y[n:, -1], {}
            for (kind, i, side), hits in zip(self.watched(mode), run.t_events, strict=True):
                if len(hits):
                    forced = {i: OPEN} if kind == "open" else {i: side} if kind == "slip" else {}
                    if kind != "gap":
                        log.append(Happened(t, kind, i, q, v, v))
                    if kind == "stick":
                        h = self.T[i]
                        v = v - h * (h @ v - self.belt[i]) / (h @ h)
        return log, q, v

    def free(self, q):
        return np.linalg.solve(self.M, self.f - self.K @ q)

    def watched(self, mode):
        """Return what ends a mode: (kind, contact, direction of the slip that follows)."""
        for i, state in enumerate(mode):
            if state == OPEN:
                yield "gap", i, 0
                continue
            yield "open", i, 0
            if state:
                yield "stick", i, 0
            elif self.mu[i] > 0.0:
                yield from (("slip", i, side) for side in (1, -1))

    def follow(self, mode, t, y, t_end):
        """Integrate a mode to its end."""
        n, zero = len(y) // 2, np.zeros(2 * len(mode))

        def value(y, kind, i, side):
            if kind == "gap":
                return self.gap0[i] + self.N[i] @ y[:n] - shift[i]
            if kind == "stick":
                return mode[i] * (self.T[i] @ y[n:] - self.belt[i])
            _, r_N, r_T = self.solve(mode, self.free(y[:n]), zero)
            return r_N[i] if kind == "open" else self.mu[i] * r_N[i] + side * r_T[i]

        # A flight begins at the surface within rounding, and may be short.
        gaps, rise = self.gaps(y[:n]), self.N @ y[n:]
        shift = np.where(gaps < 1e-9, np.minimum(gaps, 0.0), 0.0)
        fall = self.N @ self.solve(mode, self.free(y[:n]), zero)[0]
        short = [-0.2 * u / a for u, a, g in zip(rise, fall, gaps, strict=True) if g < 1e-9 and u > 1e-12 and a < 0.0]
        events = []
        for each in self.watched(mode):
            events.append(lambda t, y, each=each: value(y, *each))
            events[-1].terminal, events[-1].direction = True, -1
        return solve_ivp(
            lambda t, y: np.concatenate([y[n:], self.solve(mode, self.free(y[:n]), zero)[0]]), (t, t_end), y, "DOP853",
            events=events, rtol=1e-12, atol=1e-14, first_step=min([1e-4, t_end - t, *short]), max_step=1e-2,
        )  # fmt: skip
