"""lcpimpact: a laboratory for impact mechanics.

One rheological scheme, run by smooth and nonsmooth integrators, and compared with an exact solution where there is one.
Names are imported when first used, so that ``import lcpimpact`` costs next to nothing.

>>> import lcpimpact
>>> traj = lcpimpact.simulate(lcpimpact.load_problem("system-1"), dt=1e-2, t_end=3.0)
>>> traj.success
True
"""

from __future__ import annotations

from typing import Any

from lcpimpact.exports import exports

__version__ = "0.2.0"

_HERE = __path__[0]
_LOCATIONS = exports(f"{_HERE}/__init__.pyi") | exports(f"{_HERE}/scheme/elements/registry.pyi")
"""Each name that is offered, and where it is imported from."""

__all__ = ["__version__", *sorted(_LOCATIONS)]


def __getattr__(name: str) -> Any:
    if name not in _LOCATIONS:
        raise AttributeError(f"module 'lcpimpact' has no attribute {name!r}")
    from lcpimpact.registry import load

    value = load(_LOCATIONS[name])
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
