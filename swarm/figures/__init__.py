"""What is looked at: figures of populations and of one life, films, pages and the viewer.

Every function of a figure takes results and returns a matplotlib Figure; `save` writes it.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_HOMES = {
    "Curve": "populations",
    "centrelines": "populations",
    "centrelines_and_gains": "populations",
    "comparison": "life",
    "gains": "populations",
    "groups": "populations",
    "noise_sweep": "populations",
    "path_of": "life",
    "plain": "style",
    "radial": "populations",
    "save": "style",
    "training": "populations",
}

__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'swarm.figures' has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(f"swarm.figures.{_HOMES[name]}"), name)
    return value
