"""An option of a command that is a parameter of its study has the default of the study."""

import inspect

import click
import pytest

import lcpimpact as li
from lcpimpact.cli import comparison, convergence, design, dynamics, runs, sweep

STUDIES = [
    (comparison.compare, li.compare),
    (comparison.cross_validate, li.cross_validate),
    (convergence.converge, li.convergence),
    (convergence.work_precision, li.work_precision),
    (design.design, li.design),
    (design.fit, li.fit),
    (dynamics.poincare, li.poincare),
    (dynamics.bifurcation, li.bifurcation),
    (dynamics.basins, li.basins),
    (dynamics.orbit, li.periodic_orbit),
    (dynamics.orbit, li.continue_orbit),
    (runs.simulate, li.simulate),
    (sweep.sweep, li.sweep),
    (sweep.sweep, li.draw_samples),
]

OWN = {
    ("poincare", "skip"),  # a picture of the attractor, where a script may want the transient
    ("poincare", "points"),
}
"""Options whose defaults are of the command."""


def differing(command, study):
    """Return the names of the options whose defaults differ; None is found in the run, as of a file, or by the study."""
    ours = {each["name"]: each["default"] for each in command.to_info_dict(click.Context(command))["params"]}
    theirs = {name: each.default for name, each in inspect.signature(study).parameters.items()}
    defaults = {name: (ours[name], theirs[name]) for name in ours if name in theirs}
    assert defaults
    found_later = (None, inspect.Parameter.empty)
    return {(command.name, name) for name, (a, b) in defaults.items() if a != b and not {a, b} & {*found_later}}


@pytest.mark.parametrize(("command", "study"), STUDIES)
def test_an_option_has_the_default_of_the_study(command, study):
    own = {each for each in OWN if each[0] == command.name}
    assert differing(command, study) == own
