"""Chemoattractant fields: concentration at a position."""

from swarm.physics.fields.analytic import (
    DiffusingSource,
    Field,
    FunctionField,
    GaussianPlume,
    LinearField,
    RadialField,
)

__all__ = ["DiffusingSource", "Field", "FunctionField", "GaussianPlume", "LinearField", "RadialField"]
