"""Still water, and parallel currents: uniform, simple shear, a channel."""

from __future__ import annotations

import math
from dataclasses import dataclass
from operator import attrgetter

from swarm._support.arrays import Array, namespace
from swarm._support.checks import Checked, check_number, check_pair, check_point, parameter
from swarm.physics.flows.flow import FLOWS


class Spinless:
    """Nothing spins in it."""

    max_spin = 0.0

    def spin(self, position: Array) -> Array:
        return 0.0 * position[..., 0]

    def vorticity(self, position: Array) -> Array:
        """(..., 3), in space."""
        return 0.0 * position


@FLOWS.register("still")
@dataclass(frozen=True)
class StillWater(Spinless):
    """No flow. The world never integrates it: paths are exact arcs."""

    speed_scale = spin_scale = max_speed = 0.0

    def velocity(self, position: Array) -> Array:
        return 0.0 * position


@FLOWS.register("uniform")
@dataclass(frozen=True)
class UniformFlow(Checked, Spinless):
    """A current u = (u_x, u_y), in space with a third number or u_z = 0, the same everywhere. Nothing spins
    in it: ω₀ = 0.

    The spin scale is 1 rad per time, because a spin that is zero everywhere is so in any unit.
    """

    current: tuple[float, ...] = parameter((0.1, 0.0), check_point)  # (u_x, u_y[, u_z]) [length / time]

    spin_scale = 1.0
    max_speed = property(attrgetter("speed_scale"))

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.speed_scale == 0.0:
            raise ValueError(f"current must not be zero, got {self.current}; StillWater() has no flow")

    @property
    def speed_scale(self) -> float:
        """|u|."""
        return math.hypot(*self.current)

    @property
    def coordinates(self) -> int | None:
        """3 where the current says so."""
        return 3 if len(self.current) == 3 else None

    def velocity(self, position: Array) -> Array:
        xp = namespace(position)
        along = xp.ones_like(position[..., 0])
        parts = (*self.current, 0.0)[: position.shape[-1]]
        return xp.stack([part * along for part in parts], axis=-1)


@FLOWS.register("shear")
@dataclass(frozen=True)
class ShearFlow(Checked):
    """Simple shear u = (u₀ y/h, 0), ω₀ = −u₀/2h: at rest on the line y = 0, speed u₀ at the height h.

    In space it is u = (u₀ z/h, 0, 0), whose vorticity is (0, u₀/h, 0).

    Its speed has no bound, so neither has the observation of it.
    """

    speed_scale: float = parameter(0.1, check_number, above=0.0)  # u₀, the speed at `height` [length / time]
    height: float = parameter(10.0, check_number, above=0.0)  # h [length]

    max_spin = property(attrgetter("spin_scale"))

    @property
    def spin_scale(self) -> float:
        """|ω₀| = u₀/2h, the same everywhere."""
        return 0.5 * self.speed_scale / self.height

    def velocity(self, position: Array) -> Array:
        xp = namespace(position)
        along = (self.speed_scale / self.height) * position[..., -1]
        return xp.stack([along, *(xp.zeros_like(along) for _ in range(position.shape[-1] - 1))], axis=-1)

    def spin(self, position: Array) -> Array:
        xp = namespace(position)
        return xp.full_like(position[..., 0], -self.spin_scale)

    def vorticity(self, position: Array) -> Array:
        """(..., 3), in space."""
        xp = namespace(position)
        across = xp.full_like(position[..., 0], 2 * self.spin_scale)
        return xp.stack([xp.zeros_like(across), across, xp.zeros_like(across)], axis=-1)


@FLOWS.register("poiseuille")
@dataclass(frozen=True)
class PoiseuilleFlow(Checked):
    """Flow along a channel between walls at y = a and y = b: u = (4 u₀ (y − a)(b − y)/(b − a)², 0).

    Its spin is ω₀ = −2 u₀ (a + b − 2y)/(b − a)². A cell that leaves the channel is truncated; behind a wall
    the values at the wall go on.
    """

    # u₀, the speed in the middle [length / time]
    speed_scale: float = parameter(0.1, check_number, above=0.0)
    walls: tuple[float, float] = parameter((0.0, 10.0), check_pair)  # a, b [length]

    max_speed = property(attrgetter("speed_scale"))
    max_spin = property(attrgetter("spin_scale"))

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.walls[0] >= self.walls[1]:
            raise ValueError(f"walls must rise, got {self.walls}")

    @property
    def width(self) -> float:
        """b − a."""
        return self.walls[1] - self.walls[0]

    @property
    def spin_scale(self) -> float:
        """2u₀/(b − a), the spin at the walls."""
        return 2 * self.speed_scale / self.width

    @property
    def box(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Default start box: a square from wall to wall."""
        return (0.0, self.width), self.walls

    def _place(self, position: Array) -> Array:
        """(2y − a − b)/(b − a): −1 at one wall, 1 at the other."""
        xp = namespace(position)
        return xp.clip((2 * position[..., 1] - (self.walls[0] + self.walls[1])) / self.width, -1.0, 1.0)

    def velocity(self, position: Array) -> Array:
        xp = namespace(position)
        place = self._place(position)
        return xp.stack([self.speed_scale * (1 - place * place), xp.zeros_like(place)], axis=-1)

    def spin(self, position: Array) -> Array:
        return self.spin_scale * self._place(position)

    def inside(self, position: Array) -> Array:
        """Whether `position` (..., 2) lies in the channel, bool (...)."""
        return (position[..., 1] >= self.walls[0]) & (position[..., 1] <= self.walls[1])
