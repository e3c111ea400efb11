"""The option ``--tiny`` of every script: sizes so small that a run shows only that the script works."""

from __future__ import annotations

import argparse
from typing import Any


def add_tiny(parser: argparse.ArgumentParser, **sizes: Any) -> None:
    """Add ``--tiny``, which sets the options named in ``sizes``."""

    class Tiny(argparse.Action):
        def __call__(self, parser: Any, options: argparse.Namespace, values: Any, text: Any = None) -> None:
            vars(options).update(sizes, tiny=True)

    parser.add_argument("--tiny", action=Tiny, nargs=0, default=False, help="see only that it works, in seconds")
