"""The result of a simulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from lcpimpact.arguments import checked, short
from lcpimpact.arrays import Array
from lcpimpact.certificate import Certificate, certify
from lcpimpact.errors import InputError, Status, UnsupportedError
from lcpimpact.integrators.base import Integrator
from lcpimpact.problems.base import Problem
from lcpimpact.quantities import Summary, forces_without_impulses
from lcpimpact.record import ContinuousSolution, Event, Record, State, Stats
from lcpimpact.registry import html_of, load, nearest
from lcpimpact.run_error import MAX_SHOWN, OFF, RunError
from lcpimpact.run_files import save, to_pandas, to_xarray
from lcpimpact.scheme.dynamics import Dynamics
from lcpimpact.scheme.impact_laws import name_of_law
from lcpimpact.scheme.power_law import mean_forces
from lcpimpact.scheme.structure import Contact
from lcpimpact.scheme.terms import PowerLaw

ARRAYS = ("t", "q", "v", "t_reaction", "reaction")
"""Arrays of a run, which are read-only."""

QUICK = 0.2
"""Time in s that an estimate of the error may take unasked, if the run took less."""

QUICK_ERROR = "_quick_error"
"""Name under which a run keeps the error that was quick to estimate, or None where none was."""

ESTIMATE = "lcpimpact.study.accuracy.error_of_run:estimate_error"
"""Function that estimates errors, by module and name: in a higher layer, since it needs more runs."""

NOT_ESTIMATED = "not estimated: run.error"

TIE = "\x1f"
"""Sign between words that stay in one line."""


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory:
    """The result of a simulation.

    Attributes
    ----------
    problem : Problem
        The problem; ``problem.dynamics`` has the matrices and the names.
    method : str
        The method and its options.
    t : (nt,) array                 grid in s
    q, v : (nt, n) arrays           coordinates in m and velocities in m/s (right limits)
    t_reaction : (nr,) array        instants of the forces in s
    reaction : (nr, nc) array       reactions of the rows in N, of contacts and others; impulses are in the events
    push : (nr, ns) array           forces of the non-linear springs in N, which follow from q and v
    events : tuple of Event         changes of the contact mode, with both limits
    status : Status                 SOLVED, VIOLATED where the certificate fails, or why the run ended early
    message : str                   the status in words, with the remedy
    certificate : Certificate       violations of the laws, and their limits
    stats : Stats                   cost of the run: steps, LCPs, iterations, seconds
    dense : ContinuousSolution or None           the solution as a function of time, where the method has one
    integrator : Integrator or None the method as an object, with what it declares
    lcp_solver : str                the solver of the LCPs of its steps
    estimates : bool                whether it has an estimated error
    lacks : str                     what a run that was read from a file lacks: its "scheme" or its "continuous solution"
    quantities : mapping, optional  the numbers of its summary, where it was read with them
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
    stats: Stats
    dense: ContinuousSolution | None = None
    integrator: Integrator | None = None
    lcp_solver: str = "auto"
    estimates: bool = True
    lacks: str = ""
    quantities: Mapping[str, float] | None = None

    def __post_init__(self) -> None:
        for name, array in zip(ARRAYS, self._arrays(), strict=True):
            view = array.view()
            view.flags.writeable = False
            object.__setattr__(self, name, view)

    def _arrays(self) -> list[Array]:
        return [getattr(self, name) for name in ARRAYS]

    @property
    def success(self) -> bool:
        """Whether the run reached its end, and its certificate holds."""
        return self.status is Status.SOLVED

    @property
    def ended(self) -> bool:
        """Whether the run reached its end, with or without a valid certificate, so that its error can be measured."""
        return self.status in (Status.SOLVED, Status.VIOLATED)

    @property
    def dynamics(self) -> Dynamics:
        """The equations of motion, with the sampled forces as the loads that they were in this run."""
        record = Record(self.t, self.q, self.v, self.t_reaction, self.reaction)
        return self.problem.dynamics.with_held_forces(float(self.t[-1]), record.reader(self.dense))

    @property
    def nodes(self) -> tuple[str, ...]:
        """The names of the coordinates."""
        return self.problem.dynamics.nodes

    @property
    def rows(self) -> tuple[Contact | PowerLaw, ...]:
        """The rows and the non-linear springs whose forces it has."""
        return self.problem.dynamics.forces

    @property
    def force_names(self) -> tuple[str, ...]:
        """The names of the forces: the reactions of the rows, and the forces of the non-linear springs."""
        return tuple(each.name for each in self.rows)

    @property
    def names(self) -> tuple[str, ...]:
        """Valid names in ``traj[name]``: coordinates, velocities (v_NAME), and forces of contacts and springs."""
        return (*self.nodes, *(f"v_{node}" for node in self.nodes), *self.force_names)

    @cached_property
    def push(self) -> Array:
        """The forces of the non-linear springs in N, at the instants of the reactions (nr, ns).

        On the grid they are `Dynamics.push` of q and v. Of a step they are the mean force of
        `lcpimpact.scheme.power_law`, at the place on the line from q to q⁺ and with its rate: what the θ-step itself
        balances, and of the order of the step for others.
        """
        d = self.problem.dynamics
        t = self.t_reaction
        h = np.diff(self.t)
        if len(t) == len(self.t):
            return d.push(self.q, self.v)
        weight = ((t - self.t[:-1]) / h)[:, None]
        q = (1.0 - weight) * self.q[:-1] + weight * self.q[1:]
        return mean_forces(d.power_laws, d.approach(q), d.approach_rate(np.diff(self.q, axis=0) / h[:, None]), h)

    @property
    def forces(self) -> Array:
        """The reactions, and after them the forces of the non-linear springs, in N (nr, nc + ns)."""
        return np.hstack([self.reaction, self.push])

    def __getitem__(self, name: str) -> Array:
        if not isinstance(name, str) or name not in self.names:
            raise InputError(nearest(str(name), list(self.names), "series"))
        n, nc = len(self.nodes), self.reaction.shape[1]
        column = self.names.index(name)
        if column < n:
            return self.q[:, column]
        if column < 2 * n:
            return self.v[:, column - n]
        column -= 2 * n
        return self.reaction[:, column] if column < nc else self.push[:, column - nc]

    if not TYPE_CHECKING:  # where an unknown attribute shall stay an error

        def __getattr__(self, name: str) -> Any:
            hint = (
                f": a series is run[{name!r}]"
                if "problem" in vars(self) and name in type(self).names.fget(self)
                else ""
            )
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}{hint}")

    @checked
    def sample(self, t: ArrayLike, side: str = "right") -> State:
        """Return q, v and the reactions at any times of the run.

        Parameters
        ----------
        t : array_like
            Times in s, within the run.
        side : {"right", "left"}
            The limit at a jump.

        Returns
        -------
        State
            q and v of shape (len(t), n), reaction of shape (len(t), nc). With ``exact`` they are exact; otherwise q, v
            are interpolated linearly between grid points, and forces that belong to a step are constant on it. Those of
            non-linear springs are ``problem.dynamics.push(state.q, state.v)``.

        Raises
        ------
        InputError
            For times outside the run, or another side.
        """
        try:
            times = np.atleast_1d(np.asarray(t, dtype=np.float64))
        except (TypeError, ValueError, OverflowError):
            times = np.empty((0, 0))
        if times.ndim > 1:
            raise InputError(f"t = {short(t)} must be times in s: a number, or a sequence of numbers")
        if side not in ("right", "left"):
            raise InputError(f"side = {side!r} must be 'right' or 'left'")
        if not ((times >= self.t[0]) & (times <= self.t[-1])).all():
            raise InputError(f"sample times must lie within the run, {self.t[0]:g} to {self.t[-1]:g} s")
        if self.dense is not None:
            order = np.argsort(times, kind="stable")
            back = np.argsort(order, kind="stable")
            q, v, r = self.dense.read(times[order], side)
            return State(q[back], v[back], r[back])
        q = _interpolate(times, self.t, self.q)
        v = _interpolate(times, self.t, self.v)
        if len(self.t_reaction) == len(self.t):
            return State(q, v, _interpolate(times, self.t, self.reaction))
        if len(self.reaction) == 0:
            return State(q, v, np.full((len(times), self.reaction.shape[1]), np.nan))
        step = np.searchsorted(self.t, times, side="right" if side == "right" else "left") - 1
        return State(q, v, self.reaction[np.clip(step, 0, len(self.reaction) - 1)])

    @checked
    def certify(self, problem: Problem | None = None) -> Certificate:
        """Certify the run by the laws of its own problem, or of another one.

        Parameters
        ----------
        problem : Problem, optional
            The problem that gives laws, parameters and initial state; its nodes and contacts must have the same names.

        Returns
        -------
        Certificate
            The greatest violation of each law, the limits that the method declares, and whether it ``holds``.

        Raises
        ------
        InputError
            If the problem has other nodes or contacts.

        Examples
        --------
        >>> from lcpimpact import load_problem, simulate
        >>> run = simulate(load_problem("bouncing-ball", e=0.9), dt=1e-3, t_end=1.0)
        >>> run.certify().holds
        True
        >>> f"{run.certify(load_problem('bouncing-ball', e=0.5)).impact_law:.2f} m/s"
        '1.77 m/s'
        """
        if self.lacks:
            raise UnsupportedError(
                f"a run that was read without its {self.lacks} cannot be judged anew: see its certificate, which was "
                "written with it, or run it again"
            )
        problem = self.problem if problem is None else problem
        d, own = problem.dynamics, self.problem.dynamics
        for what, theirs, ours in (
            ("nodes", d.nodes, own.nodes),
            ("contacts", tuple(each.name for each in d.contacts), tuple(each.name for each in own.contacts)),
        ):
            if theirs != ours:
                raise InputError(
                    f"{problem.name!r} has the {what} {', '.join(theirs) or '(none)'}, and the run has "
                    f"{', '.join(ours) or '(none)'}: give a problem with the same"
                )
        t, q, v, t_reaction, reaction = map(_for_compiled, self._arrays())
        record = Record(t, q, v, t_reaction, reaction, stats=replace(self.stats))
        start = (problem.initial_coordinates, problem.initial_velocities)
        rigid = {contact.name for contact in d.contacts}
        events = tuple(event for event in self.events if event.contact in rigid and event.kind != "jump")
        d = d.with_held_forces(float(t[-1]), record.reader(self.dense))
        return certify(d, start, record, self.dense, events, self.integrator)

    @cached_property
    def error(self) -> RunError:
        """The estimated error of the run, computed when it is first asked for, and kept; see `RunError`."""
        return self.estimate_error() if self.estimates else RunError.unknown(OFF)

    @checked
    def estimate_error(self, how: str = "auto", columns: Sequence[str] | None = None) -> RunError:
        """Estimate the error of the run anew.

        Parameters
        ----------
        how : {"auto", "exact", "halving"}
            "exact" compares with the exact motion of the same problem, "halving" with the runs at dt/2, dt/4 and, across
            impacts, about dt/17 (or, of a method that chooses its steps, with a tolerance a hundred times tighter), and
            "auto" takes the first where `exact` takes the problem.
        columns : sequence of str, optional
            Names of series; by default all.

        Returns
        -------
        RunError
            With ``how = "unknown"`` and the reason where it cannot be estimated.

        Raises
        ------
        InputError
            For another way, or unknown names.

        Examples
        --------
        >>> from lcpimpact import load_problem, simulate
        >>> run = simulate(load_problem("system-1"), dt=1e-3, t_end=3.0)
        >>> [f"{run.estimate_error(how)['x']:.0e} m" for how in ("exact", "halving")]
        ['1e-05 m', '1e-05 m']
        """
        found: RunError = load(ESTIMATE)(self, how, columns)
        return found

    def quick_error(self) -> RunError | None:
        """Return the error if it is known, or takes less than the run or `QUICK` to estimate; else None.

        Where the exact motion would take longer it is that by halving, which is then not kept as `error`.
        """
        if self.estimates and not {"error", QUICK_ERROR} & self.__dict__.keys():
            found: RunError | None = load(ESTIMATE)(self, seconds=max(QUICK, self.stats.seconds))
            self.__dict__["error" if found is not None and found.how == "exact" else QUICK_ERROR] = found
        return self._known_error()

    def _known_error(self) -> RunError | None:
        """Return the error if it has been estimated."""
        return self.__dict__.get("error", self.__dict__.get(QUICK_ERROR))

    def summary(self) -> Summary:
        """Return the usual quantities of an impact by name, in SI units.

        The keys are always those of `lcpimpact.quantities.SUMMARY`, so that the summaries of many runs make a table; a
        quantity that means nothing for the run, or that it does not reach, as the contact time of a contact that has not
        ended, is NaN.

        Returns
        -------
        Summary
            A dictionary of numbers that prints as a table: ``peak_force`` (N) and ``peak_time`` (s) of the contacts;
            ``contact_time`` (s), ``restitution`` -U⁺/U⁻ and ``rebound_speed`` U⁺ (m/s) of the first touch; the number of
            ``impacts``; the ``impulse`` (N s) of the contacts; the energy ``dissipated`` (J); the greatest ``deformation``
            (m). Contacts of angles alone have moments in N m and rad. Formulas: `lcpimpact.quantities`.

        Examples
        --------
        >>> from lcpimpact import load_problem, simulate
        >>> found = simulate(load_problem("bouncing-ball", e=0.5), "exact", dt=0.1, t_end=1.0).summary()
        >>> found["impacts"], round(found["restitution"], 9), round(found["rebound_speed"], 6), found["peak_force"]
        (2.0, 0.5, 2.214723, 0.0)
        """
        found = Summary.of(self, self.quantities)
        found.run = self
        return found

    @checked
    def plot(self, path: str | Path | None = None, *, up: bool = False) -> Any:
        """Draw coordinates and reactions over time, with the events marked; return the figure, or write it to ``path``.

        Coordinates point downwards; ``up`` draws them as heights (`lcpimpact.plotting.trajectory.plot_trajectory`).
        """
        return load("lcpimpact.plotting.trajectory:plot_trajectory")(self, path, up=up)

    @checked
    def animate(self, path: str | Path, **options: str | float | None) -> Path:
        """Write the run as an animation, .gif, .html or .mp4; options as of `lcpimpact.plotting.animation.animate`."""
        written: Path = load("lcpimpact.plotting.animation:animate")(self, path, **options)
        return written

    @checked
    def save(self, path: str | Path, decimal: str = ".") -> Path:
        """Write the run to a file whose ending gives the format: .csv, .xlsx, .npz, .nc, .parquet or .mat.

        Each holds the events too, with contact, kind, time, impulse and both limits of q, v and r; the units; and the
        problem, parameters, method, dt, t_end, status, message and version. Of a .csv these are in run.events.csv and
        run.meta.json beside run.csv, and the events of a .parquet in run.events.parquet. Files appear whole or not at all,
        and older ones of the name are replaced only by whole ones, all or none. See docs/guide/run-files.md.

        Parameters
        ----------
        path : str or Path
        decimal : {".", ","}
            Decimal mark of a .csv file; with commas, semicolons stand between its cells.

        Raises
        ------
        InputError
            For another ending, or a folder that cannot be written.
        UnsupportedError
            Without the extra ``sweep`` for .nc, ``parquet`` for .parquet, or ``excel`` for .xlsx.
        """
        path = Path(path)
        save(self, path, decimal)
        return path

    def to_pandas(self) -> Any:
        """Return the run as a pandas DataFrame with the columns of its CSV file.

        Returns
        -------
        DataFrame
            t, the coordinates by name and the velocities v_NAME at the instants of the grid; then t_R and the forces at
            their own instants, which may be fewer: the rest of these columns is NaN. ``attrs`` has the metadata of `save`,
            and the ``units`` by column.

        Examples
        --------
        >>> from lcpimpact import load_problem, simulate
        >>> frame = simulate(load_problem("system-1"), dt=1e-2, t_end=1.0).to_pandas()
        >>> list(frame), len(frame), len(frame["R"].dropna()), frame.attrs["units"]["v_x"]
        (['t', 'x', 'z', 'v_x', 'v_z', 't_R', 'R'], 101, 100, 'm/s')
        """
        return to_pandas(self)

    def to_xarray(self) -> Any:
        """Return the run as an xarray Dataset (needs the extra ``sweep``).

        Coordinates and velocities lie on t, reactions on t_R, and the events on a dimension of their own: event_t,
        event_contact, event_kind, event_impulse, and event_q, event_v and event_reaction on event_side "left" and "right".
        Each variable has the attribute ``units``, and the Dataset the metadata of `save`, the parameters as JSON.
        """
        return to_xarray(self)

    def _repr_html_(self) -> str:
        return html_of(self)

    def __repr__(self) -> str:
        return _narrow(self._lines(self._error_lines(self._known_error())))

    def __str__(self) -> str:
        return _narrow(self._lines(self.error_lines()))

    def error_lines(self) -> list[str]:
        """Return the estimated error in words, where it is known or quick; else how to ask for it."""
        if not self.estimates:
            return []
        return self._error_lines(self.quick_error()) or [NOT_ESTIMATED]

    def _error_lines(self, error: RunError | None) -> list[str]:
        return [] if error is None else error.lines(self.problem.unit)

    def _lines(self, error: Sequence[str]) -> list[str]:
        """Return the text of the run, line by line, with the lines of its error."""
        problem = self.problem
        d = self.problem.dynamics
        c = self.certificate
        second = f" {problem.own_unit('s')}".rstrip()
        gap = f"{TIE}{problem.own_unit('m')}".rstrip(TIE)
        force = f" {problem.own_unit('N')}".rstrip()
        energy = f"{TIE}{problem.own_unit('J')}".rstrip(TIE)
        method, _, options = self.method.removesuffix(")").partition("(")
        lines = [
            f"Trajectory of {problem.name} by {method}: {self.status.name.lower().replace('_', '-')}",
            *([f"  options     {options}"] if options else []),
            f"  grid        t = {self.t[0]:g} ... {self.t[-1]:g}{second} in {len(self.t) - 1:,} steps",
        ]
        for i, node in enumerate(d.nodes[:MAX_SHOWN]):
            q, unit = self.q[:, i], f" {problem.unit(node)}".rstrip()
            lines.append(f"  {node:<10}  {q.min():.6g} ... {q.max():.6g}{unit}, at the end {q[-1]:.6g}{unit}")
        for each, series in list(zip(d.forces, forces_without_impulses(self).T, strict=True))[:MAX_SHOWN]:
            peak = np.abs(series).max(initial=0.0)
            kind = f"relative degree {each.relative_degree}" if isinstance(each, Contact) else "compliant"
            lines.append(f"  {each.name:<10}  at most {peak:.6g}{force}; {kind}")
        for what, count in (("coordinates", len(d.nodes)), ("forces", len(d.forces))):
            if count > MAX_SHOWN:
                lines.append(f"  ...         and {count - MAX_SHOWN} more {what}")
        balance = f"energy {c.energy_balance:.1e} of {c.energy_scale:.3g}{energy}" if d.stores_energy else "no energy"
        shown = ", ".join(f"{event.kind}{TIE}{event.contact}{TIE}{event.t:.6f}" for event in self.events[:6])
        more = f", and {len(self.events) - 6} more" if len(self.events) > 6 else ""
        lines += [
            f"  events      {shown or 'none'}{more}",
            f"  certificate residual {c.residual:.1e}, complementarity{TIE}{c.complementarity:.1e}{energy}, "
            f"penetration{TIE}{c.penetration:.1e}{gap}, {balance}",
        ]
        if d.impact_law != "newton":
            lines.append(f"  impacts     by impact_law={name_of_law(d.impact_law)!r}")
        if c.impact_gain.sentence:
            lines.append(f"  impacts     {c.impact_gain.sentence}")
        return [*lines, *labelled(error), f"  {self.message}"]


def _narrow(lines: Sequence[str]) -> str:
    """Return lines of a run as a text that no page cuts; what is tied stays together."""
    head, *middle, message = lines
    parts = [*folded(head, 2), *(part for line in middle for part in folded(line)), *folded(message, 2)]
    return "\n".join(parts).replace(TIE, " ")


def folded(line: str, indent: int = 14, *, width: int = 78) -> list[str]:
    """Return a line in lines of at most ``width`` characters, of which all but the first are indented."""
    return wrap(line, width, subsequent_indent=" " * indent, break_long_words=False, break_on_hyphens=False)


def labelled(error: Sequence[str]) -> list[str]:
    """Return the lines of an error in the form of the lines of a run."""
    return [f"  {'' if i else 'error':<11} {line}" for i, line in enumerate(error)]


def _for_compiled(array: Array) -> Array:
    """Return a read-only array as writeable, for compiled functions, which do not write to it."""
    try:
        view = array.view()
        view.flags.writeable = True
    except ValueError:  # its owner has made it read-only
        return array.copy()
    return view


def _interpolate(times: Array, t: Array, values: Array) -> Array:
    columns = [np.interp(times, t, column) for column in values.T]
    return np.array(columns).reshape(len(columns), len(times)).T
