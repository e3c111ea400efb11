"""The page of the command line, which docs/conf.py writes from the help of the commands."""

from __future__ import annotations

import re
from inspect import cleandoc

import click

from lcpimpact.cli.commands import app

COMPLETION = """\
## Completion

After one of these lines, which can stand in the start file of the shell, the tab key completes commands, options, and the
names of problems, methods, solvers, lessons and projects:

```sh
# bash 4.4 or newer, ~/.bashrc
eval "$(_LCPIMPACT_COMPLETE=bash_source lcpimpact)"
# zsh, ~/.zshrc after compinit
eval "$(_LCPIMPACT_COMPLETE=zsh_source lcpimpact)"
# fish, ~/.config/fish/config.fish
_LCPIMPACT_COMPLETE=fish_source lcpimpact | source
```"""


def page() -> str:
    """Return the page: the program, the completion by a shell, and each command."""
    program = click.Context(app, info_name="lcpimpact", **app.context_settings)
    parts = ["# Command line", *described(app, program), COMPLETION]
    for name, command in app.commands.items():
        context = click.Context(command, info_name=name, parent=program)
        parts += [f"## `lcpimpact {name}`", *described(command, context)]
    return "\n\n".join(parts) + "\n"


def marked(text: str) -> str:
    """Return a help text with its example and its options as code, in which -- is no dash."""
    text = re.sub(r"^Example: (.*)$", r"Example: `\1`", text, flags=re.MULTILINE)
    return re.sub(r"`.*?`|(?<![\w-])--?[a-z][a-z-]*", lambda found: f"`{found[0].strip('`')}`", text)


def described(command: click.Command, context: click.Context) -> list[str]:
    """Return the help of a command, its usage, and its arguments and options."""
    usage = " ".join(command.collect_usage_pieces(context))
    parts = [marked(cleandoc(command.help or "")), f"```console\n$ {context.command_path} {usage}\n```"]
    for heading, kind in (("Arguments", click.Argument), ("Options", click.Option)):
        parameters = [each for each in command.get_params(context) if isinstance(each, kind)]
        rows = [record for each in parameters if (record := each.get_help_record(context))]
        if rows:
            parts += [f"**{heading}**", "\n".join(f"- `{names}`: {marked(text)}" for names, text in rows)]
    return parts
