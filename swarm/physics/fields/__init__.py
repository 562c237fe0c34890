"""Chemoattractant fields: concentration at a position."""

from swarm.physics.fields.field import FIELDS, Field
from swarm.physics.fields.gridded import GriddedField
from swarm.physics.fields.sheared import ShearedSource
from swarm.physics.fields.sources import MovingSource, ReleasedSource, ReleasingSource
from swarm.physics.fields.steady import (
    DiffusingSource,
    FunctionField,
    GaussianPlume,
    LinearField,
    RadialField,
)

__all__ = [
    "FIELDS",
    "DiffusingSource",
    "Field",
    "FunctionField",
    "GaussianPlume",
    "GriddedField",
    "LinearField",
    "MovingSource",
    "RadialField",
    "ReleasedSource",
    "ReleasingSource",
    "ShearedSource",
]
