"""What a flow of the surrounding water is, and those that have a name.

A flow is any object with `velocity(position)`, `spin(position)`, `speed_scale` and `spin_scale`. The scales
normalise what is sensed, and from them follows how finely a path is integrated: they should be about the
largest values. Used when there and not None: `period` (length after which the flow repeats in x and y), `box`
(the default start box, else one period), `max_speed` and `max_spin` (bounds of |u| and |ω₀|, for the
observation space), `max_shear` (a bound of the velocity's derivatives, where they exceed the spin),
`inside(position)` (where the flow is known; a cell that leaves is truncated) and `velocity_and_spin(x, y)`
(u_x, u_y and ω₀ of all places at one go, for speed). One that changes has `at(time)`, which returns it
frozen at a time, and may have `max_frequency`, a bound [rad / time] of how fast the velocity at a
place turns, for the integration; scales and bounds never change.

In space a flow has `vorticity(position)` (..., 3) in place of `spin`, and positions and velocities of three
numbers; its spin scale is of half the vorticity, and `velocity_and_vorticity(x, y, z)` gives the six
components at one go. `max_wavenumber` [rad / length] says how fast it varies with place where that is faster
than its spin over its speed. One that holds in space only has `coordinates` = 3.
"""

from __future__ import annotations

from dataclasses import dataclass
from operator import attrgetter
from typing import Any, Protocol, runtime_checkable

from swarm._support.arrays import Array, join
from swarm._support.registry import Registry
from swarm.physics.fields.field import Frozen
from swarm.physics.motion.arc import components

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


class InPlane:
    """A flow of the plane that says all at one go: `velocity_and_spin(x, y)`."""

    velocity_and_spin: Any  # (x, y) -> u_x, u_y and ω₀ (...) at the places (x, y)

    def velocity(self, position: Array) -> Array:
        return join(*self.velocity_and_spin(position[..., 0], position[..., 1])[:2])

    def spin(self, position: Array) -> Array:
        return self.velocity_and_spin(position[..., 0], position[..., 1])[2]


class InSpace:
    """A flow of space that says all at one go: `velocity_and_vorticity(x, y, z)`."""

    velocity_and_vorticity: Any  # (x, y, z) -> the components (...) of both at the places (x, y, z)

    def velocity(self, position: Array) -> Array:
        return join(*self.velocity_and_vorticity(*components(position))[:3])

    def vorticity(self, position: Array) -> Array:
        return join(*self.velocity_and_vorticity(*components(position))[3:])


@dataclass(frozen=True, eq=False)
class FrozenFlow(Frozen, InPlane):
    """A flow as it is at one time, see `Frozen`; its `velocity_and_spin(x, y, time)` takes the time."""

    speed_scale = property(attrgetter("part.speed_scale"))
    spin_scale = property(attrgetter("part.spin_scale"))

    def velocity_and_spin(self, x: Array, y: Array) -> tuple[Array, Array, Array]:
        return self.part.velocity_and_spin(x, y, self.time)
