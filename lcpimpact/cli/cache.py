"""The command cache: location, size and removal of compiled code."""

from __future__ import annotations

from typing import Annotated

import typer

from lcpimpact.cache import base, folders, remove, size
from lcpimpact.cli.finish import say
from lcpimpact.errors import InputError


def cache(
    clear: Annotated[bool, typer.Option("--clear", help="Remove it: the next run compiles anew.")] = False,
) -> None:
    """Say where compiled code is kept between runs, and how much; --clear removes it.

    Each version of lcpimpact has a folder there; those of other versions that were not used for a month go by themselves.
    """
    found = folders()
    kept = f"{sum(map(size, found)) / 1e6:.1f} MB of compiled code of {len(found)} version{'s' * (len(found) != 1)}"
    if clear:
        try:
            for each in found:
                remove(each)
        except OSError as error:
            raise InputError(f"cannot empty {str(base())!r}: {error.strerror}; remove it by hand") from None
    say(f"{base()}: {kept}{' removed' if clear else ''}")
