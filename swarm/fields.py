"""Chemoattractant fields: concentration at a position.

A field is any object with `concentration(position)` and `gradient_scale`. Four further attributes are used when they are
there: `max_gradient` (a bound of |∇c|, for the observation space), `egg_radius` and `egg_position` (the egg, whose reach
ends a life), and `inside(position)` (where the field is known; a cell that leaves is truncated).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from swarm.checks import check_number

Array = Any


@runtime_checkable
class Field(Protocol):
    """What the world asks of a concentration field."""

    @property
    def gradient_scale(self) -> float:
        """Typical gradient c_k > 0 [concentration / length]; normalises perception and reward."""
        ...

    def concentration(self, position: Array) -> Array:
        """Concentration (...) at `position` (..., 2)."""
        ...


@dataclass(frozen=True)
class LinearField:
    """c = c_k y + c_0 (paper: linear concentration field)."""

    gradient_scale: float = 1.0  # c_k, paper table 1
    offset: float = 20.0  # c_0, paper table 1

    def __post_init__(self) -> None:
        check_number("gradient_scale", self.gradient_scale, above=0.0)
        check_number("offset", self.offset)

    @property
    def max_gradient(self) -> float:
        """Bound of |∇c|: c_k itself."""
        return self.gradient_scale

    def concentration(self, position: Array) -> Array:
        """Concentration (...) at `position` (..., 2)."""
        return self.gradient_scale * position[..., 1] + self.offset


@dataclass(frozen=True)
class RadialField:
    """c = c_0 − c_k √(x² + y²) around an egg at the origin (paper: radial concentration field)."""

    gradient_scale: float = 1.0  # c_k, paper table 1
    offset: float = 100.0  # c_0, paper table 1
    egg_radius: float = 1.0  # a path that comes this close to the origin has arrived

    egg_position = (0.0, 0.0)

    def __post_init__(self) -> None:
        check_number("gradient_scale", self.gradient_scale, above=0.0)
        check_number("offset", self.offset)
        check_number("egg_radius", self.egg_radius, above=0.0)

    @property
    def max_gradient(self) -> float:
        """Bound of |∇c|: c_k itself."""
        return self.gradient_scale

    def concentration(self, position: Array) -> Array:
        """Concentration (...) at `position` (..., 2)."""
        x, y = position[..., 0], position[..., 1]
        return self.offset - self.gradient_scale * (x * x + y * y) ** 0.5
