"""Draw every picture of the site and build it, without a network: ``python docs/build.py [--out site] [--keep-pictures]``.

Notebooks and examples are executed by Sphinx; a warning is an error. ``--keep-pictures`` takes docs/images as it is, and
executes no page again whose code has not changed, which is what one wants while writing.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

DOCS = Path(__file__).parent
LONGEST = ("dynamics", "problems_page", "many_contacts")
"""Scripts that take minutes, which begin first, so that all cores are busy to the end."""


def scripts() -> list[Path]:
    """Return the scripts that draw, the longest first."""
    found = [*sorted((DOCS / "pictures").glob("*.py")), DOCS / "problems_page.py"]
    return sorted(found, key=lambda each: LONGEST.index(each.stem) if each.stem in LONGEST else len(LONGEST))


def run(*command: str | Path) -> None:
    """Run Python with these arguments; what fails ends the build."""
    subprocess.run([sys.executable, *map(str, command)], check=True)


def draw(script: Path) -> None:
    """Run a script that draws, and say how long it took."""
    begin = time.monotonic()
    run(script)
    print(f"{script.name} {time.monotonic() - begin:.0f} s", flush=True)


def main() -> int:
    """Build the site, and say how long it took."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("site"), help="folder of the site")
    parser.add_argument("--keep-pictures", action="store_true", help="do not draw docs/images anew")
    options = parser.parse_args()
    begin, jobs = time.monotonic(), os.cpu_count() or 1
    try:
        if not options.keep_pictures:
            with ThreadPoolExecutor(jobs) as pool:
                list(pool.map(draw, scripts()))
        drawn = time.monotonic()
        mode = (
            "cache" if options.keep_pictures else "force"
        )  # a page kept from another state of the package proves nothing
        execution = f"--define=nb_execution_mode={mode}"
        run("-m", "sphinx", "-W", "--keep-going", "--quiet", f"--jobs={jobs}", execution, DOCS, options.out)
    except subprocess.CalledProcessError as error:
        print(f"the site was not built: {' '.join(error.cmd)} failed", file=sys.stderr)
        return 1
    end = time.monotonic()
    print(f"pictures {drawn - begin:.0f} s, pages {end - drawn:.0f} s; open {options.out / 'index.html'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
