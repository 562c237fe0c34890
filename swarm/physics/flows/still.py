"""Water at rest."""

from __future__ import annotations

from dataclasses import dataclass

from swarm._support.arrays import Array
from swarm.physics.flows.flow import FLOWS


@FLOWS.register("still")
@dataclass(frozen=True)
class StillWater:
    """No flow. The world never integrates it: paths are exact arcs."""

    speed_scale = 0.0
    spin_scale = 0.0
    max_speed = 0.0
    max_spin = 0.0

    def velocity(self, position: Array) -> Array:
        return 0.0 * position

    def spin(self, position: Array) -> Array:
        return 0.0 * position[..., 0]

    def vorticity(self, position: Array) -> Array:
        """(..., 3), in space."""
        return 0.0 * position
