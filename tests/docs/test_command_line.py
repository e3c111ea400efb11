"""The page of the command line has every command with all that it takes."""

import re

import click
import pytest
from commands_page import page

from lcpimpact.cli.commands import app

SECTIONS = dict(re.findall(r"^## `lcpimpact ([\w-]+)`\n(.*?)(?=^## |\Z)", page(), re.DOTALL | re.MULTILINE))


def test_every_command_has_a_section():
    assert list(SECTIONS) == list(app.commands)


@pytest.mark.parametrize("name", app.commands)
def test_a_section_has_the_help_of_its_command(name):
    command, lines = app.commands[name], SECTIONS[name].replace("`", "").splitlines()
    assert " ".join(command.help.replace("`", "").split()) in " ".join(" ".join(lines).split())
    for each in command.params:
        said = each.opts[0] if isinstance(each, click.Option) else each.make_metavar(click.Context(command))
        assert any(said in line and line.partition(": ")[2].startswith(each.help.replace("`", "")) for line in lines), (
            said
        )


def test_no_option_is_typeset_with_a_dash():
    outside = re.sub(r"```.*?```|`.*?`", "", page(), flags=re.DOTALL)
    assert "--" not in outside
