"""Chemoattractant fields: concentration at a position."""

from swarm.physics.fields.field import FIELDS, Field
from swarm.physics.fields.function import FunctionField
from swarm.physics.fields.gridded import GriddedField
from swarm.physics.fields.linear import LinearField
from swarm.physics.fields.peaks import DiffusingSource, GaussianPlume, RadialField

__all__ = [
    "FIELDS",
    "DiffusingSource",
    "Field",
    "FunctionField",
    "GaussianPlume",
    "GriddedField",
    "LinearField",
    "RadialField",
]
