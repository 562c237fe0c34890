"""Flows of the surrounding water: velocity and spin at a position.

A flow is any object with `velocity(position)`, `spin(position)`, `speed_scale` and `spin_scale`. Used when there: `period`
(length after which the flow repeats in x and y; the default start box), `max_speed` (a bound of |u|, for the observation
space) and `inside(position)` (where the flow is known; a cell that leaves is truncated).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from array_api_compat import array_namespace

from swarm.checks import check_number

Array = Any


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


@dataclass(frozen=True)
class StillWater:
    """No flow. The world never integrates it: paths are exact arcs."""

    speed_scale = 0.0
    spin_scale = 0.0
    max_speed = 0.0

    def velocity(self, position: Array) -> Array:
        """Zero velocity (..., 2)."""
        return 0.0 * position

    def spin(self, position: Array) -> Array:
        """Zero spin (...)."""
        return 0.0 * position[..., 0]


@dataclass(frozen=True)
class TaylorGreen:
    """Taylor–Green vortices u = u₀ (cos kx sin ky, −sin kx cos ky), ω₀ = −u₀ k cos kx cos ky (paper: external flow)."""

    speed_scale: float = 0.1  # u₀, paper table 1
    wavenumber: float = math.pi / 10  # k, paper table 1

    def __post_init__(self) -> None:
        check_number("speed_scale", self.speed_scale, above=0.0)
        check_number("wavenumber", self.wavenumber, above=0.0)

    @property
    def spin_scale(self) -> float:
        """u₀ k, the largest spin."""
        return self.speed_scale * self.wavenumber

    @property
    def max_speed(self) -> float:
        """Bound of |u|: u₀."""
        return self.speed_scale

    @property
    def period(self) -> float:
        """Length 2π/k after which the flow repeats in x and in y."""
        return 2 * math.pi / self.wavenumber

    # Products of sines and cosines are written as sums, which halves the number of transcendental functions.

    def velocity(self, position: Array) -> Array:
        """Velocity u (..., 2) at `position` (..., 2)."""
        xp = array_namespace(position)
        phase = self.wavenumber * position
        kx, ky = phase[..., 0], phase[..., 1]
        plus, minus = xp.sin(kx + ky), xp.sin(kx - ky)
        return (0.5 * self.speed_scale) * xp.stack([plus - minus, -(plus + minus)], axis=-1)

    def spin(self, position: Array) -> Array:
        """Angular velocity ω₀ (...) at `position` (..., 2)."""
        xp = array_namespace(position)
        phase = self.wavenumber * position
        kx, ky = phase[..., 0], phase[..., 1]
        return (-0.5 * self.spin_scale) * (xp.cos(kx + ky) + xp.cos(kx - ky))
