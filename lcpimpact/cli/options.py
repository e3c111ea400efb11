"""Options that several commands share, and the problem and run that they specify."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import click

from lcpimpact.errors import InputError
from lcpimpact.integrators import METHODS
from lcpimpact.lcp import SOLVERS
from lcpimpact.problems import PROBLEMS

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

    from lcpimpact.integrators.base import Integrator
    from lcpimpact.schemefile import SchemeFile

Command: TypeAlias = Callable[..., None]
Option: TypeAlias = Callable[[Command], Command]
"""Decorator that adds one or several options or arguments to the function of a command."""

PATH = click.Path(path_type=Path)


class Count(click.IntRange):
    """Whole number of at least ``min``, by the name of an integer in help and errors, and not of an integer range."""

    name = "integer"


def names_of(registry: Mapping[str, Any]) -> Callable[[click.Context, click.Parameter, str], list[str]]:
    """Return the function by which a shell completes a name of a registry."""
    return lambda context, parameter, incomplete: [name for name in registry if name.startswith(incomplete)]


def problem_or_file(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Return the problems that begin so, or that a shell completes a file where none does."""
    from click.shell_completion import CompletionItem

    names = names_of(PROBLEMS)(context, parameter, incomplete)
    return [CompletionItem(each) for each in names] or [CompletionItem(incomplete, type="file")]


def together(*options: Option) -> Option:
    """Return the decorator that adds all ``options``, which the help shows in their order."""

    def add(command: Command) -> Command:
        for option in reversed(options):
            command = option(command)
        return command

    return add


problem_argument = click.argument(
    "problem", shell_complete=problem_or_file, help="A name of `lcpimpact list problems`, or a file ending in .toml."
)
set_option = click.option(
    "--set",
    "set_",
    metavar="NAME=VALUE",
    multiple=True,
    help="A parameter or constant of the problem, or option of the method; repeatable.",
)
method_option = click.option(
    "--method",
    shell_complete=names_of(METHODS),
    help="A name of `lcpimpact list methods`; by default as in the file, or moreau-jean.",
)
step_option = click.option(
    "--dt", type=float, help="Step in s; by default that of the file, or 1e-3, or a thousandth of the end if smaller."
)
end_option = click.option("--t-end", type=float, help="End in s; by default that of the file, or of the problem.")
solver_option = click.option(
    "--solver",
    shell_complete=names_of(SOLVERS),
    help="A name of `lcpimpact list solvers`; by default that of the file, or auto.",
)
run_options = together(set_option, method_option, step_option, end_option, solver_option)

table_option = click.option("--out", type=PATH, help="File for the table: .csv, .xlsx, or .tex for LaTeX.")
plot_option = click.option("--plot", type=PATH, help="File for the picture: .png, .svg or .pdf.")
report_option = click.option("--report", type=PATH, help="File for a self-contained report: .html.")
study_options = together(table_option, plot_option, report_option)

penalty_option = click.option(
    "--penalty",
    metavar="LAW:K[:NAME=VALUE...]",
    multiple=True,
    help="Add a compliant variant, as kelvin-voigt:1e6 or hertz:1e8:e=1; repeatable.",
)
over_option = click.option(
    "--over",
    metavar="NAME=VALUES",
    multiple=True,
    help="A parameter and its values: LOW:HIGH:COUNT, or with :log after it, or values separated by commas; repeatable. "
    "--set takes them too.",
)
up_option = click.option(
    "--up", is_flag=True, help="Draw coordinates that point downwards as heights above the floor, or above zero."
)


def resolve_run(
    name: str,
    set_: Iterable[str],
    method: str | None = None,
    dt: float | None = None,
    t_end: float | None = None,
    solver: str | None = None,
) -> SchemeFile:
    """Return the problem and the run specified by a name or a file and the options of a command."""
    from lcpimpact.schemefile import read_scheme_file, registered_problem

    if name not in PROBLEMS and not _is_file(name) and (Path(name).suffix or Path(name).is_file()):
        raise InputError(
            f"{name!r} is no registered problem, and a scheme file ends in .toml: write it as TOML, or rename it"
        )
    stated = read_scheme_file(name) if _is_file(name) else registered_problem(name, {})
    run = stated.run.changed(method=method)
    parameters = [] if stated.registered is None else list(inspect.signature(PROBLEMS[stated.registered]).parameters)
    options = [each.name for each in fields(METHODS[run.method])]  # type: ignore[arg-type]
    given = dict(map(assignment, set_))
    changed = stated.with_parameters(**{key: value for key, value in given.items() if key in parameters})
    of_method = {key: value for key, value in given.items() if key not in parameters and key in options}
    others = {key: value for key, value in given.items() if key not in parameters and key not in options}
    problem = changed.problem
    if others:
        from lcpimpact.problems.parameters import check_address, with_values

        whose = f"parameter of {stated.registered} or " if stated.registered else ""
        for key in others:
            check_address(problem, key, [*parameters, *options], f"{whose}option of {run.method}")
        problem = with_values(problem, others)
    return replace(changed, problem=problem, run=run.changed(dt=dt, t_end=t_end, solver=solver, **of_method))


def _is_file(name: str) -> bool:
    return Path(name).suffix.lower() == ".toml"


def check_registered(*names: str) -> None:
    """Refuse files where names of the registry are wanted.

    Raises
    ------
    InputError
        For a scheme file.
    """
    for name in filter(_is_file, names):
        raise InputError(
            f"{name!r} is a scheme file, which states no facts and no source: take a problem of lcpimpact list problems"
        )


def stem(name: str) -> str:
    """Return the name of a registered problem or of a file, without folder and ending."""
    return Path(name).stem if _is_file(name) else name


def assignment(text: str) -> tuple[str, Any]:
    """Return the name and value of NAME=VALUE: a whole number, another number, true or false, or a word."""
    name, equals, value = text.partition("=")
    if not equals or not name or not value:
        raise InputError(f"--set {text!r} must read NAME=VALUE, as in --set c_o=300")
    for kind in (int, float):
        try:
            return name.strip(), kind(value)
        except ValueError:
            continue
    truth = {"true": True, "false": False}
    return name.strip(), truth.get(value.strip().lower(), value.strip())


def files(*inputs: str | Path) -> list[Path]:
    """Return the inputs of a command that are files, without names of registered problems."""
    return [Path(each) for each in inputs if isinstance(each, Path) or _is_file(each)]


def parse_methods(text: str) -> dict[str, Integrator]:
    """Return the methods of a list ``NAME[:OPTION=VALUE...],...`` by their text."""
    from lcpimpact.simulation import make_integrator

    found: dict[str, Integrator] = {}
    for label in filter(None, (each.strip() for each in text.split(","))):
        name, *options = label.split(":")
        found[label] = make_integrator(name, dict(assignment(option) for option in options))
    if not found:
        raise InputError("--methods names no method: write --methods moreau-jean,rk4")
    return found


def numbers(text: str, option: str) -> list[float]:
    """Return the numbers of a list separated by commas."""
    try:
        return [float(each) for each in text.split(",") if each.strip()]
    except ValueError:
        raise InputError(f"{option} {text!r} must be numbers separated by commas, as in {option} 0.1,0.05") from None


def parse_penalty(text: str) -> tuple[str, float, dict[str, float]]:
    """Return the law, k and the other constants of LAW:K[:NAME=VALUE...]."""
    law, *rest = text.split(":")
    try:
        k = float(rest[0])
        more = {name: float(value) for name, _, value in (each.partition("=") for each in rest[1:])}
    except (IndexError, ValueError):
        raise InputError(
            f"--penalty {text!r} must read LAW:K[:NAME=VALUE...], as in --penalty kelvin-voigt:1e6"
        ) from None
    return law, k, more


def fixed_and_varied(set_: Sequence[str], over: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    """Return the options --set that fix a value, and by name the text of the values of --over, or of --set with several."""
    several = [text for text in set_ if any(mark in text.partition("=")[2] for mark in ":,")]
    fixed = [text for text in set_ if text not in several]
    for text in fixed:
        assignment(text)
    varied: dict[str, str] = {}
    for text in [*several, *over]:
        name, _, span = (part.strip() for part in text.partition("="))
        if not name or not span:
            raise InputError(f"--over {text!r} must read NAME=VALUES, as in --over k_o=3000:5000:50")
        if name in varied:
            raise InputError(f"--over {name} is given twice: give all its values at once")
        varied[name] = span
    return fixed, varied


def values_of(name: str, span: str, *, max_values: int = 100_000_000) -> list[float]:
    """Return the values of LOW:HIGH:COUNT, LOW:HIGH:COUNT:log or of a list.

    ``max_values``: maximum number of values of a parameter.
    """
    import numpy as np

    if ":" not in span:
        return numbers(span, "--over")
    low, high, *more = span.split(":")
    try:
        ends, count = (float(low), float(high)), int(more[0])
    except (ValueError, IndexError):
        ends, count = (np.nan, np.nan), 0
    log = more[1:] == ["log"]
    if not np.isfinite(ends).all() or not 1 <= count <= max_values or more[1:] not in ([], ["log"]):
        raise InputError(
            f"--over '{name}={span}' must read NAME=LOW:HIGH:COUNT, as in --over k_o=3000:5000:50, or :log after it"
        )
    if log and min(ends) <= 0.0:
        raise InputError(f"--over '{name}={span}': a logarithmic scale needs ends above zero")
    return [float(value) for value in (np.geomspace if log else np.linspace)(*ends, count)]


def pairs_of(text: str, option: str, form: str, example: str) -> dict[str, str]:
    """Return the names and values of NAME[=VALUE],..., "" for a name without one."""
    found = dict[str, str]()
    for part in text.split(","):
        name, value = part.partition("=")[::2]
        if not name.strip() or ("=" in part and not value.strip()):
            raise InputError(f"{option} {text!r} must read {form}, separated by commas, as in {option} {example}")
        if name.strip() in found:
            raise InputError(f"{option} {text!r} names {name.strip()} twice: name it once")
        found[name.strip()] = value.strip()
    return found


def number_of(text: str, option: str) -> float:
    """Return the number of a text."""
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{option}: {text!r} is not a number: write it as in 1e3") from None


deviations_option = click.option(
    "--deviations",
    metavar="NAME=VALUE,...",
    help="Standard deviations of parameters: those of the outputs follow, to first order.",
)


def deviations_of(text: str | None, example: str) -> dict[str, float] | None:
    """Return the standard deviations by name of ``--deviations``, None without it."""
    if text is None:
        return None
    given = pairs_of(text, "--deviations", "NAME=VALUE", example)
    return {name: number_of(value, "--deviations") for name, value in given.items()}
