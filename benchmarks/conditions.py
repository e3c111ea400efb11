"""What a figure depends on: the machine, its load, the state of the cache, and how often the call ran before."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Mapping
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from lcpimpact.cache import TAG, folder


def processor() -> str:
    """Return the name of the processor."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def cache_state() -> str:
    """Return whether the cache holds compiled code of this version of the source."""
    files = [each for each in folder().rglob("*") if each.is_file() and each.name != TAG]
    return f"warm, {len(files)} files" if files else "empty"


def conditions() -> str:
    """Return the day, the machine, its load of the last minute, the versions and the state of the cache, in one line."""
    load = f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "not known"
    packages = [f"Python {platform.python_version()}"]
    for name in ("numpy", "scipy", "llvmlite"):
        try:
            packages.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            packages.append(f"no {name}")
    machine = f"{processor()}, {os.cpu_count()} cores, load {load}"
    return f"{date.today().isoformat()}: {machine}; {', '.join(packages)}; cache {cache_state()}"


def print_conditions(calls: Mapping[str, Callable[[], object]] | None = None, *, runs: int = 10) -> None:
    """Print the conditions, and what calls take by the clock when they run for the first, the second and the tenth time.

    Called before all else, so that the first run is that of a new process, with the code that the cache holds.
    """
    print(conditions(), flush=True)
    for what, call in (calls or {}).items():
        took = []
        for _ in range(runs):
            began = time.perf_counter()
            call()
            took.append(time.perf_counter() - began)
        shown = {"first": took[0], "second": took[1], "tenth": took[-1]}
        print(f"{what}: {', '.join(f'{name} {1e3 * each:.4g} ms' for name, each in shown.items())}", flush=True)
