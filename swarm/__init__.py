"""Swarms of chemotactic microswimmers in one concentration-and-flow world."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import gymnasium as _gymnasium
import pettingzoo as _pettingzoo

from swarm._support.provenance import __version__
from swarm.envs.pettingzoo import parallel_env
from swarm.physics.crowd.interactions import INTERACTIONS as interactions
from swarm.physics.crowd.interactions import Contact, Dipole
from swarm.physics.crowd.medium import Medium
from swarm.physics.crowd.spread import Spread
from swarm.physics.fields import FIELDS as fields
from swarm.physics.fields import (
    DiffusingSource,
    FunctionField,
    GaussianPlume,
    GriddedField,
    LinearField,
    MovingSource,
    RadialField,
    ReleasedSource,
    ReleasingSource,
    ShearedSource,
)
from swarm.physics.flows import FLOWS as flows
from swarm.physics.flows import (
    ABCFlow,
    DoubleGyre,
    FunctionFlow,
    GriddedFlow,
    OscillatingTaylorGreen,
    PoiseuilleFlow,
    ShearAroundSphere,
    ShearFlow,
    StillWater,
    TaylorGreen,
    UniformFlow,
    Vortex,
)
from swarm.physics.motion.company import swim
from swarm.physics.perception import SENSORS as sensors
from swarm.physics.rewards import REWARDS as rewards
from swarm.physics.starts import draw_starts
from swarm.physics.world import World
from swarm.policies.adaptive import AdaptiveSteering
from swarm.policies.strategies import FromObservation, Greedy, Random, Swinging

# Loaded when they are first asked for: they need SciPy, xarray or time.
_LAZY = {
    "Network": "policies.network",
    "Optimal": "optimal.physical_limit",
    "RecurrentNetwork": "policies.network",
    "SpermSwarmVector": "envs.gymnasium",
    "contest": "population.contests",
    "export_policy": "policies.export",
    "limit": "optimal.physical_limit",
    "load_policy": "policies.network",
    "population_test": "population.contest",
    "save_policy": "policies.network",
}

__all__ = [
    "ABCFlow",
    "AdaptiveSteering",
    "Contact",
    "DiffusingSource",
    "Dipole",
    "DoubleGyre",
    "FromObservation",
    "FunctionField",
    "FunctionFlow",
    "GaussianPlume",
    "Greedy",
    "GriddedField",
    "GriddedFlow",
    "LinearField",
    "Medium",
    "MovingSource",
    "Network",
    "Optimal",
    "OscillatingTaylorGreen",
    "PoiseuilleFlow",
    "RadialField",
    "Random",
    "RecurrentNetwork",
    "ReleasedSource",
    "ReleasingSource",
    "ShearAroundSphere",
    "ShearFlow",
    "ShearedSource",
    "SpermSwarmVector",
    "Spread",
    "StillWater",
    "Swinging",
    "TaylorGreen",
    "UniformFlow",
    "Vortex",
    "World",
    "__version__",
    "contest",
    "draw_starts",
    "export_policy",
    "fields",
    "flows",
    "interactions",
    "limit",
    "load_policy",
    "parallel_env",
    "population_test",
    "rewards",
    "save_policy",
    "sensors",
    "swim",
]

for _kind, _maker in (("parallel", "parallel_env"), ("aec", "env")):
    if hasattr(_pettingzoo, "register"):  # from PettingZoo 1.27 on
        _entry = f"swarm.sperm_swarm_v0:{_maker}"
        _pettingzoo.register(_kind, "chemoswarm/sperm_swarm_v0", entry_point=_entry)
_gymnasium.register(
    "chemoswarm/SpermSwarm-v0",
    entry_point="swarm.envs.gymnasium:SpermSwimmer",
    vector_entry_point="swarm.envs.gymnasium:vector_env",
)


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module 'swarm' has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(f"swarm.{_LAZY[name]}"), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_LAZY})
