"""Flows of the surrounding water: velocity and spin at a position."""

from swarm.physics.flows.analytic import (
    Flow,
    FunctionFlow,
    PoiseuilleFlow,
    ShearFlow,
    StillWater,
    TaylorGreen,
    UniformFlow,
    Vortex,
)

__all__ = [
    "Flow",
    "FunctionFlow",
    "PoiseuilleFlow",
    "ShearFlow",
    "StillWater",
    "TaylorGreen",
    "UniformFlow",
    "Vortex",
]
