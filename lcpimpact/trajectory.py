"""The result of a simulation."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arrays import Array
from lcpimpact.certificate import Certificate
from lcpimpact.errors import InputError, Status, UnsupportedError
from lcpimpact.files import check_output, whole_file
from lcpimpact.integrators.base import Dense, Event, Integrator, State
from lcpimpact.problems.base import Problem
from lcpimpact.registry import load, nearest

SAVED_AS = (".csv", ".npz", ".nc")

SHOWN = 8
"""Of more coordinates or reactions than these, the summary shows the first."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """What a simulation found.

    Attributes
    ----------
    problem : Problem
        What was simulated; ``problem.dynamics`` has the matrices and the names.
    method : str
        The method and its options.
    t : (nt,) array                 grid in s
    q, v : (nt, n) arrays           coordinates in m and velocities in m/s (right limits)
    t_reaction : (nr,) array        where the reactions live, in s
    reaction : (nr, nc) array       reactions in N; impulses stand in the events
    events : tuple of Event         changes of the contact mode, with both limits
    status : Status                 SOLVED, or why the run ended early
    message : str                   the status in words, with the remedy
    certificate : Certificate       residual, complementarity, penetration and energy balance
    stats : dict                    steps, counted costs, seconds
    dense : Dense or None           the solution as a function of time, where the method has one
    integrator : Integrator or None the method as an object, with what it declares
    """

    problem: Problem
    method: str
    t: Array
    q: Array
    v: Array
    t_reaction: Array
    reaction: Array
    events: tuple[Event, ...]
    status: Status
    message: str
    certificate: Certificate
    stats: Mapping[str, float]
    dense: Dense | None = None
    integrator: Integrator | None = None

    @property
    def success(self) -> bool:
        """Whether the run reached its end."""
        return self.status is Status.SOLVED

    @property
    def names(self) -> tuple[str, ...]:
        """What can be asked for by ``traj[name]``: coordinates, velocities (v_NAME) and reactions."""
        d = self.problem.dynamics
        return (*d.nodes, *(f"v_{node}" for node in d.nodes), *(contact.name for contact in d.contacts))

    def __getitem__(self, name: str) -> Array:
        if name not in self.names:
            raise InputError(nearest(str(name), list(self.names), "series"))
        n = len(self.problem.dynamics.nodes)
        column = self.names.index(name)
        if column < n:
            return self.q[:, column]
        if column < 2 * n:
            return self.v[:, column - n]
        return self.reaction[:, column - 2 * n]

    def sample(self, t: ArrayLike, side: str = "right") -> State:
        """Return q, v and the reactions at any times of the run.

        Parameters
        ----------
        t : array_like
            Times in s, within the run.
        side : {"right", "left"}
            Which limit is meant where a value jumps.

        Returns
        -------
        State
            q and v of shape (len(t), n), reaction of shape (len(t), nc). With ``exact`` they are exact; otherwise q, v
            are interpolated linearly between grid points, and forces that belong to a step are constant on it.

        Raises
        ------
        InputError
            For times outside the run, or another side.
        """
        times = np.atleast_1d(np.asarray(t, dtype=np.float64))
        if side not in ("right", "left"):
            raise InputError(f"side = {side!r} must be 'right' or 'left'")
        if not ((times >= self.t[0]) & (times <= self.t[-1])).all():
            raise InputError(f"sample times must lie within the run, {self.t[0]:g} to {self.t[-1]:g} s")
        if self.dense is not None:
            order = np.argsort(times, kind="stable")
            back = np.argsort(order, kind="stable")
            q, v, r = self.dense.read(times[order], side)
            return State(q[back], v[back], r[back])
        q, v = _interpolate(times, self.t, self.q), _interpolate(times, self.t, self.v)
        if len(self.t_reaction) == len(self.t):
            return State(q, v, _interpolate(times, self.t, self.reaction))
        if len(self.reaction) == 0:
            return State(q, v, np.full((len(times), self.reaction.shape[1]), np.nan))
        step = np.searchsorted(self.t, times, side="right" if side == "right" else "left") - 1
        return State(q, v, self.reaction[np.clip(step, 0, len(self.reaction) - 1)])

    def plot(self, path: str | Path | None = None) -> Any:
        """Draw coordinates and reactions over time, with the events marked; return the figure, or write it to ``path``."""
        return load("lcpimpact.plotting.trajectory:plot_trajectory")(self, path)

    def animate(self, path: str | Path, **options: Any) -> Path:
        """Write the run as a moving picture, .gif, .html or .mp4; options as of `lcpimpact.plotting.animation.animate`."""
        written: Path = load("lcpimpact.plotting.animation:animate")(self, path, **options)
        return written

    def save(self, path: str | Path) -> Path:
        """Write the run to a file whose ending tells the format: .csv, .npz, or .nc (with the extra ``xarray``).

        The file appears whole or not at all, and an older one of the name is replaced only by a whole one.

        Raises
        ------
        InputError
            For another ending, or a folder that cannot be written.
        """
        path = Path(path)
        writers = dict(zip(SAVED_AS, (self._write_csv, self._write_npz, self._write_netcdf), strict=True))
        check_output(path, writers)
        with whole_file(path) as part:
            writers[path.suffix](part)
        return path

    def to_xarray(self) -> Any:
        """Return the run as an xarray Dataset with the coordinates t and t_R (needs the extra ``xarray``)."""
        try:
            import xarray
        except ImportError:
            raise UnsupportedError("xarray is not installed: pip install 'lcpimpact[xarray]'") from None
        n = len(self.problem.dynamics.nodes)
        series = {name: ("t", self[name]) for name in self.names[: 2 * n]}
        forces = {name: ("t_R", self[name]) for name in self.names[2 * n :]}
        attributes = {"problem": self.problem.name, "method": self.method, "status": self.status.name}
        return xarray.Dataset(series | forces, coords={"t": self.t, "t_R": self.t_reaction}, attrs=attributes)

    def _write_csv(self, path: Path) -> None:
        n = len(self.problem.dynamics.nodes)
        header = ["t", *self.names[: 2 * n], "t_R", *self.names[2 * n :]]
        motion = np.column_stack([self.t, self.q, self.v]).tolist()
        forces = np.column_stack([self.t_reaction, self.reaction]).tolist()
        empty = [""] * (1 + self.reaction.shape[1])
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(header)
            writer.writerows(a + b for a, b in zip_longest(motion, forces, fillvalue=empty))

    def _write_npz(self, path: Path) -> None:
        events = self.events
        with path.open("wb") as file:
            np.savez_compressed(
                file,
                t=self.t,
                q=self.q,
                v=self.v,
                t_reaction=self.t_reaction,
                reaction=self.reaction,
                names=np.array(self.names),
                event_t=np.array([event.t for event in events]),
                event_contact=np.array([event.contact for event in events], dtype=str),
                event_kind=np.array([event.kind for event in events], dtype=str),
                problem=self.problem.name,
                method=self.method,
                status=self.status.name,
            )

    def _write_netcdf(self, path: Path) -> None:
        self.to_xarray().to_netcdf(path, engine="scipy")

    def __repr__(self) -> str:
        d, c = self.problem.dynamics, self.certificate
        lines = [
            f"Trajectory of {self.problem.name} by {self.method}: {self.status.name.lower().replace('_', '-')}",
            f"  grid        t = {self.t[0]:g} ... {self.t[-1]:g} s in {len(self.t) - 1:,} steps",
        ]
        metre, newton = (" m", " N") if d.stores_energy else ("", "")
        for i, node in enumerate(d.nodes[:SHOWN]):
            q = self.q[:, i]
            lines.append(f"  {node:<10}  {q.min():.6g} ... {q.max():.6g}{metre}, at the end {q[-1]:.6g}{metre}")
        for i, contact in enumerate(d.contacts[:SHOWN]):
            peak = np.abs(self.reaction[:, i]).max(initial=0.0)
            lines.append(f"  {contact.name:<10}  at most {peak:.6g}{newton}; relative degree {contact.relative_degree}")
        for what, count in (("coordinates", len(d.nodes)), ("reactions", len(d.contacts))):
            if count > SHOWN:
                lines.append(f"  ...         and {count - SHOWN} more {what}")
        balance = f"energy {c.energy_balance:.1e} of {c.energy_scale:.3g} J" if d.stores_energy else "no energy"
        shown = ", ".join(f"{event.kind} {event.contact} {event.t:.6f}" for event in self.events[:6])
        more = f", and {len(self.events) - 6} more" if len(self.events) > 6 else ""
        lines += [
            f"  events      {shown or 'none'}{more}",
            f"  certificate residual {c.residual:.1e}, complementarity {c.complementarity:.1e}{metre and ' J'}, "
            f"penetration {c.penetration:.1e}{metre}, {balance}",
            f"  {self.message}",
        ]
        return "\n".join(lines)


def _interpolate(times: Array, t: Array, values: Array) -> Array:
    columns = [np.interp(times, t, column) for column in values.T]
    return np.array(columns).reshape(len(columns), len(times)).T
