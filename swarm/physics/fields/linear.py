"""The linear field."""

from __future__ import annotations

from dataclasses import dataclass
from operator import attrgetter

from swarm._support.arrays import Array
from swarm._support.checks import check_number, settle
from swarm.physics.fields.field import FIELDS


@FIELDS.register("linear")
@dataclass(frozen=True)
class LinearField:
    """c = c_k y + c_0 (paper: linear concentration field)."""

    gradient_scale: float = 1.0  # c_k, paper table 1
    offset: float = 20.0  # c_0, paper table 1

    max_gradient = property(attrgetter("gradient_scale"))  # c_k itself

    def __post_init__(self) -> None:
        settle(self, check_number, "gradient_scale", above=0.0)
        settle(self, check_number, "offset")

    def concentration(self, position: Array) -> Array:
        return self.gradient_scale * position[..., 1] + self.offset
