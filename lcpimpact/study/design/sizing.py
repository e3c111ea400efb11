r"""Sizing of a block: its constants from required properties of an impact, and conversely.

Two of the restitution e, contact time, peak force, maximum deflection and the constants (one for a law without loss)
determine the others. Each is

.. math:: Q = G(λ, γ)\, L^p\, m^i v_0^j, \qquad γ = g L/v_0^2,

with functions G of the law and a fixed power of its length L (`lcpimpact.study.design.law`). One of the two gives L for each
loss number λ; the other is then an equation in λ alone, whose solutions are all found by `lcpimpact.study.design.search`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import brentq

from lcpimpact.arguments import checked
from lcpimpact.arrays import Array
from lcpimpact.errors import InputError
from lcpimpact.hybrid.variation import offsets_of_neighbours, slope_weights
from lcpimpact.numbers import finite, positive
from lcpimpact.problems.base import Problem
from lcpimpact.reading import Series
from lcpimpact.registry import nearest
from lcpimpact.simulation import simulate
from lcpimpact.study.design.law import ContactLaw, Rebound
from lcpimpact.study.design.linear import HardStopLaw, KelvinVoigtLaw, MaxwellLaw, TensionLaw
from lcpimpact.study.design.power import HertzLaw, HuntCrossleyLaw, KuwabaraKonoLaw, TsujiLaw
from lcpimpact.study.design.search import solve
from lcpimpact.study.result import Study
from lcpimpact.study.uncertainty import Uncertainty, uncertainty_of
from lcpimpact.trajectory import Trajectory

LAWS: dict[str, ContactLaw] = {
    law.name: law
    for law in (
        KelvinVoigtLaw(),
        TensionLaw(),
        HardStopLaw(),
        MaxwellLaw(),
        HertzLaw(),
        HuntCrossleyLaw(),
        TsujiLaw(),
        KuwabaraKonoLaw(),
    )
}

OUTPUTS = {"e": "", "contact_time": "s", "peak_force": "N", "deflection": "m"}
"""Measured quantities of an impact, with units."""

WORDS = {
    "e": "restitution", "contact_time": "contact time", "peak_force": "greatest force", "deflection": "greatest deflection",
    "k": "stiffness", "c": "damping", "b": "loss", "A": "time of dissipation", "n": "exponent",
}  # fmt: skip
"""Descriptions of the constants and outputs."""

POWERS = {"e": 0.0, "contact_time": 1.0, "peak_force": -1.0, "deflection": 1.0}
"""The power of L in each output; that in k is -(n + 1), and that in the constant of loss its law says."""

GIVES_LENGTH = ("k", "c", "A", "deflection", "peak_force", "contact_time", "e")
"""Quantities that determine L, the preferred one of two first: constants in closed form, others are monotonic in L."""

LOSS_SAMPLES = {True: 25, False: 97}
"""Number of loss numbers at which an equation is sampled: fewer where each needs an integration."""

MAX_GAMMA = 100.0
"""Maximum γ = g L/v0² considered; L γ is the static deflection."""

MAX_LOG, ROOT_TOL = 50.0, 1e-9
"""Largest logarithm considered, and tolerance of a root in the logarithm."""


def unit_of(law: str, name: str, n: float | None) -> str:
    """Return the unit of a quantity of a law, whose exponent is n, None if it is linear."""
    if name == "k":
        return "N/m" if n is None else f"N/m^{n:g}"
    return LAWS[law].unit(n or 1.0) if name == LAWS[law].loss else OUTPUTS.get(name, "")


@dataclass(frozen=True, repr=False)
class Design(Study):
    """A designed impact: the constants of its block and its outputs.

    Attributes
    ----------
    law : str               a name of `LAWS`
    m, v0, g : float        mass in kg, speed at first touch in m/s, gravity in m/s²
    k : float               stiffness in N/m, or N/mⁿ
    c : float or None       damping in N s/m, of Tsuji's law in N s/m^((n+1)/2), of the laws that have it
    b : float or None       loss in s/m of Hunt and Crossley's law
    A : float or None       time of dissipation in s of Kuwabara and Kono's law
    n : float or None       exponent of a power law
    e : float               restitution; 0 without rebound
    contact_time : float    s; inf where the contact never ends
    peak_force : float      N
    deflection : float      m; inf if it is unbounded
    wanted : mapping        required quantities
    found : str             how the design was found
    others : tuple          other designs with the same required quantities, in order of damping
    """

    law: str
    m: float
    v0: float
    g: float
    k: float
    c: float | None
    b: float | None
    A: float | None
    n: float | None
    e: float
    contact_time: float
    peak_force: float
    deflection: float
    wanted: Mapping[str, float] = field(default_factory=dict)
    found: str = ""
    others: tuple[Design, ...] = ()

    drawn_by = "lcpimpact.plotting.design:plot_design"
    title = "Design of an impact"

    def head(self) -> list[str]:
        """Return the case and its required quantities."""
        gravity = f", g = {self.g:g} m/s²" if self.g else ""
        wanted = ", ".join(f"{name} = {value:g}" for name, value in self.wanted.items())
        return [f"{self.law}, m = {self.m:g} kg, v0 = {self.v0:g} m/s{gravity}; wanted: {wanted}"]

    def summary(self) -> str:
        """Return the constants of the block, its outputs, and alternative blocks."""
        lines = self.head() + [f"  {name:<13} {value:<20} {words}" for name, value, words in self._rows()]
        lines.append(f"  found by      {self.found}")
        for other in self.others:
            values = ", ".join(f"{name} = {value}" for name, value, _ in other._rows() if name not in self.wanted)
            lines.append(f"  another one   {values}")
        return "\n".join(lines)

    def _rows(self) -> list[tuple[str, str, str]]:
        """Return name, value and words of the constants and outputs."""
        rows = []
        for name, words in WORDS.items():
            value = getattr(self, name)
            if value is None:
                continue
            unit = unit_of(self.law, name, self.n)
            note = " (wanted)" if name in self.wanted else ""
            never = {"contact_time": ", the mass stays", "deflection": ", the mass sinks in"}.get(name, "")
            rows.append((name, f"{value:.8g} {unit}".strip(), words + note + (never if math.isinf(value) else "")))
        return rows

    def problem(self) -> Problem:
        """Return the impact as a problem: a registered one, with the load m g added if there is gravity."""
        kind = LAWS[self.law]
        problem = kind.problem(self.m, self.v0, self.g, self.k, self.c or self.b or self.A or 0.0, self.n or 1.0)
        return problem if math.isinf(self.contact_time) else replace(problem, t_end=1.2 * self.contact_time)

    def simulate(self) -> Trajectory:
        """Run it by ``exact``, or by ``event-driven`` with a tight tolerance if the law is not linear."""
        problem, method = self.problem(), LAWS[self.law].method
        options: dict[str, Any] = {} if method == "exact" else {"rtol": 1e-12}
        return simulate(problem, method, dt=problem.t_end / 400, t_end=problem.t_end, progress=False, **options)

    def force(self, run: Trajectory) -> Series:
        """Return the force on the mass as a series of a run, for `lcpimpact.reading`."""
        return LAWS[self.law].force(run)

    def measured(self) -> Rebound:
        """Return the outputs of the simulated impact: e, contact_time, peak_force, deflection."""
        return LAWS[self.law].measured(self.simulate())

    @checked
    def uncertainty(self, deviations: Mapping[str, float] | pd.DataFrame) -> Uncertainty:
        r"""Return how sure the outputs of the block are, if m, v0, g or its constants are uncertain, to first order.

        .. math:: \operatorname{cov} y = G\, \operatorname{cov} p\, G^T, \qquad G = ∂y/∂p .

        Outputs that are infinite, as the contact time of a mass that stays, are left out.

        Parameters
        ----------
        deviations : mapping of str to float, or DataFrame
            Standard deviations of m, v0, g, k, c, b, A or n in their units, those not named being known, or a covariance.

        Returns
        -------
        Uncertainty

        Raises
        ------
        InputError
            For an unknown parameter, or a deviation or covariance that is none.

        Examples
        --------
        A block whose stiffness is known to 2 % and its damping to 5 %:

        >>> block = design("kelvin-voigt", m=1.0, v0=2.0, e=0.5, contact_time=0.01)
        >>> unsure = block.uncertainty({"k": 0.02 * block.k, "c": 0.05 * block.c})
        >>> unsure.table[["output", "deviation"]].round(5)
                 output  deviation
        0             e    0.01535
        1  contact_time    0.00011
        2    peak_force    4.48380
        3    deflection    0.00009

        References
        ----------
        JCGM 100, Evaluation of measurement data: guide to the expression of uncertainty in measurement (2008).
        """
        values = {name: float(getattr(self, name)) for name in self._given() if getattr(self, name) is not None}
        outputs = [name for name in OUTPUTS if math.isfinite(getattr(self, name))]
        here = np.array([getattr(self, name) for name in outputs])
        table = pd.DataFrame({"output": outputs, "unit": [OUTPUTS[name] for name in outputs], "value": here})
        for name in values:
            table[name] = self._slopes(name, outputs, here) if name in deviations else 0.0
        return uncertainty_of(self.problem().name, "design", values, table, deviations)

    def _given(self) -> list[str]:
        """Return the names of what determines the outputs: mass, speed, gravity and the constants of the law."""
        exponent = ["n"] * (LAWS[self.law].n is None)
        return ["m", "v0", "g", "k", *[LAWS[self.law].loss] * bool(LAWS[self.law].loss), *exponent]

    def _slopes(self, name: str, outputs: list[str], here: Array, *, far: float = 2.0**-9) -> Array:
        """Return the derivatives of outputs by one quantity, differences of order 6.

        ``far``: distance of neighbouring values, relative to the quantity, or to v0²/deflection for g = 0.
        """
        given = {each: getattr(self, each) for each in self._given()}
        size = given[name] or self.v0**2 / self.deflection
        for offsets in offsets_of_neighbours(far * size):
            try:
                beside = [design(self.law, **{**given, name: given[name] + float(each)}) for each in offsets]
            except InputError:  # beyond the domain of the quantity
                continue
            changes = np.array([[getattr(each, output) for output in outputs] for each in beside]) - here
            return slope_weights(offsets) @ changes
        raise InputError(f"uncertainty: {self.law!r} has no outputs at values near {name} = {given[name]:g}")

    @property
    def table(self) -> pd.DataFrame:
        """One row per design (this one, then the others): law, m, v0, g, constants (SI), outputs (SI), found."""
        columns = [name for name in self.__dataclass_fields__ if name not in ("wanted", "others")]
        rows = [{name: getattr(each, name) for name in columns} for each in (self, *self.others)]
        table = pd.DataFrame(rows, columns=columns)
        return table.astype({name: float for name in columns if name not in ("law", "found")})


@checked
def design(
    law: str,
    *,
    m: float,
    v0: float,
    g: float = 0.0,
    e: float | None = None,
    contact_time: float | None = None,
    peak_force: float | None = None,
    deflection: float | None = None,
    k: float | None = None,
    c: float | None = None,
    b: float | None = None,
    A: float | None = None,
    n: float | None = None,
) -> Design:
    r"""Return the block that gives a wanted impact, or what a block gives: any two quantities determine all others.

    A mass m strikes a block with the speed v0; with g > 0 its weight m g acts all along. Give two of e, contact_time,
    peak_force, deflection, k and c (or b, A), for ``hertz`` one. All four outputs mean the first contact, from first touch
    to the instant at which the force ends (``kelvin-voigt``, ``maxwell``, ``tsuji``, ``kuwabara-kono``) or x returns to
    zero (the others).

    - ``kelvin-voigt``: spring and dashpot side by side that push and do not pull;
    - ``kelvin-voigt-tension``: the same, glued to the mass;
    - ``hard-stop``: a `lcpimpact.HardStop`, whose dashpot acts while it is compressed alone;
    - ``maxwell``: spring and dashpot in a row;
    - ``hertz``: k δⁿ; ``hunt-crossley``: k δⁿ (1 + b δ');
    - ``tsuji``: k δⁿ + c δ^((n-1)/2) δ', a `lcpimpact.Tsuji`, and ``kuwabara-kono``: k (δⁿ + n A δⁿ⁻¹ δ'), a
      `lcpimpact.KuwabaraKono`, that push and do not pull.

    Without gravity e depends on a loss number alone, ζ, b v0 or A v0/L, and there are closed forms but for Kuwabara and
    Kono's law. With it the end of the contact is a root of the closed motion of a linear law, and power laws with a loss
    are integrated. Gravity may hold the mass:
    then e = 0 and contact_time is inf. (On ``kelvin-voigt`` e does not fall to zero before that: the mass leaves a block
    that is still pressed together with at least c g/k, or not at all.)

    Parameters
    ----------
    law : str
        As above.
    m, v0 : float
        Mass in kg and speed at first touch in m/s.
    g : float
        Gravity in m/s² along v0.
    e : float, optional
        Wanted restitution, 0 < e < 1.
    contact_time, peak_force, deflection : float, optional
        Required contact duration in s, peak force in N, and maximum deflection in m.
    k : float, optional
        Stiffness in N/m, or N/mⁿ.
    c, b, A : float, optional
        Damping in N s/m, of ``tsuji`` in N s/m^((n+1)/2); loss in s/m of ``hunt-crossley``; time of dissipation in s of
        ``kuwabara-kono``.
    n : float, optional
        Exponent of a power law, at least 1; 3/2 if it is left out.

    Returns
    -------
    Design
        The solution with the least damping; further solutions are its ``others``.

    Raises
    ------
    InputError
        For an invalid value, too few or too many values, or requirements that no block meets; the message then gives the
        attainable range. The search covers 1e-6 <= ζ <= 100 (for ``maxwell`` ζ = sqrt(k m)/(2 c), for ``tsuji``
        ζ = c/sqrt(2 (n + 1) k m)), 1e-3 <= b v0 <= 100, and 1e-4 <= A v0/L <= 100 with the deflection without loss L, and
        a rebound above 1e-9 v0 if e or contact_time is required.

    Examples
    --------
    >>> wanted = design("kelvin-voigt", m=1.0, v0=2.0, e=0.5, contact_time=0.01)
    >>> round(wanted.k, 3), round(wanted.c, 6), round(wanted.peak_force, 4)
    (73727.954, 138.629436, 440.0764)
    >>> round(design("kelvin-voigt", m=1.0, v0=2.0, k=wanted.k, c=wanted.c).e, 12)
    0.5

    References
    ----------
    Schwager and Pöschel, Coefficient of restitution and linear-dashpot model revisited (2007); Hunt and Crossley (1975).
    """
    if law not in LAWS:
        raise InputError(nearest(str(law), list(LAWS), "law"))
    kind = LAWS[law]
    given = {"e": e, "contact_time": contact_time, "peak_force": peak_force, "deflection": deflection}
    wanted = _checked(kind, m, v0, g, given | {"k": k, "c": c, "b": b, "A": A}, n)
    case = _Case(kind, float(m), float(v0), float(g), kind.n or (1.5 if n is None else float(n)))
    try:
        first, *others = [case.design(λ, L, wanted) for λ, L in case.solutions(wanted)]
    except ArithmeticError:
        raise InputError(
            "design: a number overflows or underflows; take units in which m, v0 and the required values are nearer to 1"
        ) from None
    return replace(first, others=tuple(others))


def _checked(
    kind: ContactLaw, m: float, v0: float, g: float, given: Mapping[str, float | None], n: float | None
) -> dict[str, float]:
    """Return the given quantities; raise for invalid values, and for too few or too many."""
    positive("design: m", m)
    positive("design: v0", v0)
    finite("design: g", g, "m/s²", least=0.0)
    if n is not None and kind.n is not None:
        raise InputError(f"design: the law {kind.name!r} has no n; leave it out")
    if n is not None:
        finite("design: n", n, least=1.0)
    constants = ["k", *[kind.loss] * bool(kind.loss)]
    wanted = {name: value for name, value in given.items() if value is not None}
    for name, value in wanted.items():
        if name not in OUTPUTS and name not in constants:
            raise InputError(
                f"design: the law {kind.name!r} has no {name}; its constants are {' and '.join(constants)}"
            )
        positive(f"design: {name}", value)
    known = [*OUTPUTS, *constants]
    if "e" in wanted and not kind.loss:
        raise InputError("design: the law 'hertz' is conservative, so e = 1 for every k; leave e out")
    if wanted.get("e", 0.5) >= 1.0:
        raise InputError(
            f"design: e = {wanted['e']:g} must be below 1, since every block of {kind.name!r} dissipates energy; take "
            "'hertz' with n=1 for a conservative one"
        )
    if len(wanted) != len(constants):
        names = ", ".join(wanted) or "nothing"
        many = f"the law {kind.name!r} has {'two constants' if kind.loss else 'one constant'}"
        more = ", ".join(name for name in known if name not in wanted and (kind.loss or name != "e"))
        missing = len(constants) - len(wanted)
        advice = f"give {missing} more of {more}" if missing > 0 else "leave out all but as many of them"
        raise InputError(f"design: {many}, and {names} {'is' if len(wanted) < 2 else 'are'} given: {advice}")
    if g == 0.0 and set(wanted) == {"e", "b"}:
        raise InputError("design: without gravity e and b both determine only b v0: replace one of them")
    return {name: float(value) for name, value in wanted.items()}


@dataclass(frozen=True)
class _Case:
    """One law, mass and speed: quantities as functions of λ and L, and the equations that they make."""

    law: ContactLaw
    m: float
    v0: float
    g: float
    n: float

    @property
    def Γ(self) -> float:
        """γ/L in 1/m."""
        return self.g / self.v0**2

    def unit(self, name: str) -> float:
        """Return mⁱ v0ʲ of a quantity."""
        m, v0 = self.m, self.v0
        units = {
            "contact_time": 1.0 / v0,
            "peak_force": m * v0**2,
            "k": m * v0**2,
            "c": m * v0,
            "b": 1.0 / v0,
            "A": 1.0 / v0,
        }
        return units.get(name, 1.0)

    def power(self, name: str) -> float:
        """Return the power of L in a quantity."""
        if name == "k":
            return -(self.n + 1.0)
        return self.law.power(self.n) if name == self.law.loss else POWERS[name]

    def scaled(self, name: str, λ: float, γ: float) -> float:
        """Return G(λ, γ)."""
        if name == "k":
            return 0.5 * (self.n + 1.0)
        if name == self.law.loss:
            return self.law.constant(λ, self.n)
        value: float = getattr(_rebound(self.law, λ, γ, self.n), name)
        return value

    def quantity(self, name: str, λ: float, L: float) -> float:
        """Return the quantity in SI units."""
        return self.scaled(name, λ, self.Γ * L) * self.unit(name) * math.pow(L, self.power(name))

    def effective_quantity(self, name: str, λ: float, L: float, *, min_rebound: float = 1e-9) -> float:
        """Return the quantity for a search, with a negligible rebound counted as none.

        ``min_rebound``: rebound velocity, relative to v0, below which there is no rebound.
        """
        if name in ("e", "contact_time") and self.scaled("e", λ, self.Γ * L) < min_rebound:
            return 0.0 if name == "e" else math.inf
        return self.quantity(name, λ, L)

    def length(self, name: str, goal: float, λ: float, start: float = math.nan) -> float:
        """Return the L at which a quantity equals its goal, nan if there is none; ``start`` is an optional guess."""
        p, light = self.power(name), self.scaled(name, λ, 0.0)
        if p != 0.0:
            L = (goal / (light * self.unit(name))) ** (1.0 / p)
            if self.g == 0.0 or name not in OUTPUTS:
                reached = L > 0.0 and math.isfinite(self.effective_quantity(name, λ, L))
                return L if reached else math.nan
            start = L if math.isnan(start) else start
        top, sign = math.log(MAX_GAMMA / self.Γ), p or -1.0

        def excess(x: float) -> float:
            # It rises with L, and jumps where gravity begins to hold the mass.
            value = self.effective_quantity(name, λ, math.exp(x)) / goal
            return sign * (min(max(math.log(value), -MAX_LOG), MAX_LOG) if value > 0.0 else -MAX_LOG)

        x = min(math.log(start), top) if start > 0.0 else top - 10.0
        at, step = excess(x), 0.02
        while True:
            y = min(x - math.copysign(step, at), top)
            then = excess(y)
            if at * then <= 0.0:
                break
            if y == top or y < top - MAX_LOG:
                return math.nan
            x = y
            at = then
            step = 2.0 * step
        root = float(brentq(excess, min(x, y), max(x, y), xtol=1e-13))
        return math.exp(root) if abs(excess(root)) < ROOT_TOL else math.nan

    def solutions(self, wanted: Mapping[str, float]) -> list[tuple[float, float]]:
        """Return every (λ, L) with the required quantities."""
        names = sorted(wanted, key=lambda name: GIVES_LENGTH.index(name) if name in GIVES_LENGTH else -1)
        first, second = names[0], names[-1]
        if first == "b" or not self.law.loss:
            λ = self.law.number(wanted["b"] * self.v0, self.n) if self.law.loss else 0.0
            L = self.length(second, wanted[second], λ)
            if math.isnan(L):
                self.refuse(wanted, second, self.reach(second, λ))
            return [(λ, L)]
        if first == "k" and second == self.law.loss:
            L = self.length("k", wanted["k"], 1.0)
            return [(self.law.number(wanted[second] / self.unit(second) * L ** -self.power(second), self.n), L)]
        ratio = 1.0

        def equation(u: float) -> float:
            # The length is near what it would be without weight, times what weight made of it at the last λ.
            nonlocal ratio
            λ = math.exp(u)
            light = self.length_without_weight(first, wanted[first], λ)
            L = self.length(first, wanted[first], λ, ratio * light)
            if math.isnan(L):
                return math.nan
            ratio = L / light if 0.0 < light < math.inf else 1.0
            value = self.effective_quantity(second, λ, L)
            return value if 0.0 < value < math.inf else math.nan

        low, high = map(math.log, self.law.losses)
        slow = self.law.n is None and (self.g > 0.0 or not self.law.closed)
        found = solve(equation, np.linspace(low, high, LOSS_SAMPLES[slow]), wanted[second])
        if not found.solutions:
            self.refuse(wanted, second, (found.low, found.high))
        return [(math.exp(u), self.length(first, wanted[first], math.exp(u))) for u in found.solutions]

    def length_without_weight(self, name: str, goal: float, λ: float) -> float:
        """Return the L at which a quantity would have its goal if g were zero."""
        return replace(self, g=0.0).length(name, goal, λ)

    def reach(self, name: str, λ: float) -> tuple[float, float]:
        """Return the range of a quantity at one λ."""
        ends = [self.quantity(name, λ, math.exp(x) * MAX_GAMMA / self.Γ) for x in (-MAX_LOG, 0.0)]
        return min(ends), max(ends)

    def text(self, name: str, value: float) -> str:
        """Return a value with its unit."""
        unit = unit_of(self.law.name, name, self.n if self.law.n is None else None)
        return f"{value:.9g} {unit}".strip()

    def refuse(
        self, wanted: Mapping[str, float], name: str, reach: tuple[float, float], *, reach_rtol: float = 1e-6
    ) -> None:
        """Raise the error for unattainable requirements, with the attainable range.

        ``reach_rtol``: relative excess of a range over the required value above which only its near end is
        reported.
        """
        others = ", ".join(f"{each} = {self.text(each, value)}" for each, value in wanted.items() if each != name)
        case = f"m = {self.m:g} kg, v0 = {self.v0:g} m/s, g = {self.g:g} m/s²"
        weight = self.m * self.g
        if math.isnan(reach[0]) and wanted.get("peak_force", math.inf) <= weight:
            raise InputError(
                f"peak_force = {self.text('peak_force', wanted['peak_force'])} does not lift the mass, whose weight is "
                f"m g = {self.text('peak_force', weight)}: take a larger one"
            )
        if math.isnan(reach[0]):
            what = "has a finite deflection" if name == "deflection" else "lets the mass rebound"
            raise InputError(f"no {self.law.name} block with {others} {what} at {case}: change the requirements")
        low, high = (self.text(name, value) for value in reach)
        lies = f"lies between {low} and {high}"
        if reach[0] < reach_rtol * wanted[name]:
            lies = f"is at most {high}"
        elif wanted[name] < reach_rtol * reach[1]:
            lies = f"is at least {low}"
        raise InputError(
            f"no {self.law.name} block has {name} = {self.text(name, wanted[name])}"
            + (f" and {others}" if others else "")
            + f" at {case}: {name} {lies}{' then' if others else ''}"
        )

    def design(self, λ: float, L: float, wanted: Mapping[str, float]) -> Design:
        """Return the design for a λ and an L."""
        shown: dict[str, Any] = {name: self.quantity(name, λ, L) for name in OUTPUTS}
        shown["k"] = wanted.get("k", self.quantity("k", λ, L))
        if self.law.loss:
            shown[self.law.loss] = wanted.get(self.law.loss, self.quantity(self.law.loss, λ, L))
        n = self.n if self.law.n is None else None
        shown |= {name: shown.get(name) for name in ("c", "b", "A")}
        return Design(
            law=self.law.name,
            m=self.m,
            v0=self.v0,
            g=self.g,
            n=n,
            wanted=wanted,
            found=self.origin(wanted),
            **shown,
        )

    def origin(self, wanted: Mapping[str, float]) -> str:
        """Return the origin of the design, in words."""
        if self.g == 0.0 and self.law.closed:
            direct = "b" in wanted or not self.law.loss or set(wanted) == {"k", self.law.loss}
            return "closed form" if direct else "closed form, and the root of one equation"
        if self.law.n is not None:
            return "closed form of the motion; the end of the contact by root-finding"
        motion = "energy integral" if not self.law.loss else "integration by DOP853 to 1e-12"
        return motion if set(wanted) == {"k", self.law.loss} else f"{motion}, and root-finding"


@lru_cache(maxsize=4096)
def _rebound(law: ContactLaw, λ: float, γ: float, n: float) -> Rebound:
    return law.rebound(λ, γ, n)
