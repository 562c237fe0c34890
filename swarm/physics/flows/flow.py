"""What a flow of the surrounding water is, and those that have a name.

A flow is any object with `velocity(position)`, `spin(position)`, `speed_scale` and `spin_scale`. The scales
normalise what is sensed, and from them follows how finely a path is integrated: they should be about the
largest values. Used when there and not None: `period` (length after which the flow repeats in x and y), `box`
(the default start box, else one period), `max_speed` and `max_spin` (bounds of |u| and |ω₀|, for the
observation space), `max_shear` (a bound of the velocity's derivatives, where they exceed the spin),
`inside(position)` (where the flow is known; a cell that leaves is truncated) and `velocity_and_spin(x, y)`
(u_x, u_y and ω₀ of all places at one go, for speed).
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from swarm._support.arrays import Array
from swarm._support.registry import Registry

FLOWS = Registry("flow", "chemoswarm.flows")


@runtime_checkable
class Flow(Protocol):
    """What the world asks of a flow."""

    @property
    def speed_scale(self) -> float:
        """Typical speed u₀ [length / time]; normalises the sensed velocity."""
        ...

    @property
    def spin_scale(self) -> float:
        """Typical angular velocity [rad / time]; normalises the sensed spin."""
        ...

    def velocity(self, position: Array) -> Array:
        """Velocity u (..., 2) at `position` (..., 2)."""
        ...

    def spin(self, position: Array) -> Array:
        """Angular velocity ω₀ (...), half the vorticity, counter-clockwise, at `position` (..., 2)."""
        ...
