"""The command cache: location, size and removal of compiled code."""

from __future__ import annotations

import click

from lcpimpact.cache import base, folders, remove, size
from lcpimpact.cli.output import output_options, print_answer
from lcpimpact.errors import InputError


@click.command()
@click.option("--clear", is_flag=True, help="Remove it; the next run compiles again.")
@output_options
def cache(clear: bool) -> None:
    """Show the folder and the size of the compiled code that is cached between runs; --clear removes it.

    Each version of lcpimpact has its own folder; those of other versions are removed after a month without use.
    """
    found = folders()
    held = sum(map(size, found))
    kept = f"{held / 1e6:.1f} MB of compiled code of {len(found)} version{'s' * (len(found) != 1)}"
    if clear:
        try:
            for each in found:
                remove(each)
        except OSError as error:
            raise InputError(f"cannot empty {str(base())!r}: {error.strerror}; remove it by hand") from None
    print_answer(
        [f"{base()}: {kept}{' removed' if clear else ''}"],
        lambda: {"folder": base(), "bytes": held, "versions": len(found), "removed": clear},
    )
