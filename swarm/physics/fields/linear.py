"""The linear field."""

from __future__ import annotations

from dataclasses import dataclass
from operator import attrgetter

from swarm._support.arrays import Array
from swarm._support.checks import Checked, check_number, parameter
from swarm.physics.fields.field import FIELDS


@FIELDS.register("linear")
@dataclass(frozen=True)
class LinearField(Checked):
    """c = c_k y + c_0 (paper: linear concentration field), in space c_k z + c_0."""

    gradient_scale: float = parameter(1.0, check_number, above=0.0)  # c_k, paper table 1
    offset: float = parameter(20.0, check_number)  # c_0, paper table 1

    max_gradient = property(attrgetter("gradient_scale"))  # c_k itself

    def concentration(self, position: Array) -> Array:
        return self.gradient_scale * position[..., -1] + self.offset
