"""Swarms of chemotactic microswimmers in one concentration-and-flow world."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import gymnasium as _gymnasium
import pettingzoo as _pettingzoo

from swarm.fields import DiffusingSource, FunctionField, GaussianPlume, LinearField, RadialField
from swarm.flows import (
    FunctionFlow,
    PoiseuilleFlow,
    ShearFlow,
    StillWater,
    TaylorGreen,
    UniformFlow,
    Vortex,
)
from swarm.sperm_swarm_v0 import parallel_env
from swarm.strategies import FromObservation, Greedy, Random, Swinging
from swarm.world import World

__version__ = "0.1.0"

# Loaded when they are first asked for: they need SciPy, xarray or time.
_LAZY = {
    "GriddedField": "gridded",
    "GriddedFlow": "gridded",
    "Network": "network",
    "Optimal": "optimal",
    "SpermSwarmVector": "gymnasium_env",
    "limit": "optimal",
    "load_policy": "network",
    "population_test": "population",
    "save_policy": "network",
}

__all__ = [
    "DiffusingSource",
    "FromObservation",
    "FunctionField",
    "FunctionFlow",
    "GaussianPlume",
    "Greedy",
    "GriddedField",
    "GriddedFlow",
    "LinearField",
    "Network",
    "Optimal",
    "PoiseuilleFlow",
    "RadialField",
    "Random",
    "ShearFlow",
    "SpermSwarmVector",
    "StillWater",
    "Swinging",
    "TaylorGreen",
    "UniformFlow",
    "Vortex",
    "World",
    "__version__",
    "limit",
    "load_policy",
    "parallel_env",
    "population_test",
    "save_policy",
]

for _kind, _maker in (("parallel", "parallel_env"), ("aec", "env")):
    _pettingzoo.register(_kind, "chemoswarm/sperm_swarm_v0", entry_point=f"swarm.sperm_swarm_v0:{_maker}")
_gymnasium.register("chemoswarm/SpermSwarm-v0", vector_entry_point="swarm.gymnasium_env:vector_env")


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module 'swarm' has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(f"swarm.{_LAZY[name]}"), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_LAZY})
