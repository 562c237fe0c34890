"""Flows of the surrounding water: velocity and spin at a position."""

from swarm.physics.flows.flow import FLOWS, Flow
from swarm.physics.flows.function import FunctionFlow
from swarm.physics.flows.gridded import GriddedFlow
from swarm.physics.flows.parallel import PoiseuilleFlow, ShearFlow, StillWater, UniformFlow
from swarm.physics.flows.spatial import ABCFlow, ShearAroundSphere
from swarm.physics.flows.vortices import DoubleGyre, OscillatingTaylorGreen, TaylorGreen, Vortex

__all__ = [
    "FLOWS",
    "ABCFlow",
    "DoubleGyre",
    "Flow",
    "FunctionFlow",
    "GriddedFlow",
    "OscillatingTaylorGreen",
    "PoiseuilleFlow",
    "ShearAroundSphere",
    "ShearFlow",
    "StillWater",
    "TaylorGreen",
    "UniformFlow",
    "Vortex",
]
