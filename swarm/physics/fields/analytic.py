"""Chemoattractant fields: concentration at a position.

A field is any object with `concentration(position)` and `gradient_scale`. Further attributes are used when
they are there and not None: `max_gradient` (a bound of |∇c|, for the observation space), `egg_radius` and
`egg_position` (the egg, whose reach ends a life), `inside(position)` (where the field is known; a cell that
leaves is truncated) and `box` (the default start box).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from swarm._support.arrays import namespace
from swarm._support.checks import check_box, check_function, check_number, check_point, settle

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
        settle(self, check_number, "gradient_scale", above=0.0)
        settle(self, check_number, "offset")

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
        settle(self, check_number, "gradient_scale", above=0.0)
        settle(self, check_number, "offset")
        settle(self, check_number, "egg_radius", above=0.0)

    @property
    def max_gradient(self) -> float:
        """Bound of |∇c|: c_k itself."""
        return self.gradient_scale

    def concentration(self, position: Array) -> Array:
        """Concentration (...) at `position` (..., 2)."""
        return self.offset - self.gradient_scale * _distance_squared(position, (0.0, 0.0)) ** 0.5


@dataclass(frozen=True)
class GaussianPlume:
    """A patch c = c_0 + A exp(−|r − r₀|²/2w²) around an egg at r₀.

    c_k is the steepest gradient, found at the distance w from r₀: c_k = A/(w √e), so A = c_k w √e.
    """

    gradient_scale: float = 1.0  # c_k, |∇c| at the distance `width` [concentration / length]
    width: float = 10.0  # w [length]
    offset: float = 0.0  # c_0, far away [concentration]
    egg_position: tuple[float, float] = (0.0, 0.0)  # r₀ [length]
    egg_radius: float | None = 1.0  # a path that comes this close to r₀ has arrived; None: nothing ends there

    def __post_init__(self) -> None:
        settle(self, check_number, "gradient_scale", above=0.0)
        settle(self, check_number, "width", above=0.0)
        settle(self, check_number, "offset")
        _settle_egg(self)

    @property
    def amplitude(self) -> float:
        """A, the concentration at r₀ above the offset."""
        return self.gradient_scale * self.width * math.sqrt(math.e)

    @property
    def max_gradient(self) -> float:
        """Bound of |∇c|: c_k itself."""
        return self.gradient_scale

    def concentration(self, position: Array) -> Array:
        """Concentration (...) at `position` (..., 2)."""
        xp = namespace(position)
        exponent = _distance_squared(position, self.egg_position) * (-0.5 / self.width**2)
        return self.offset + self.amplitude * xp.exp(exponent)


@dataclass(frozen=True)
class DiffusingSource:
    """The steady cloud c = c_0 + s/√(|r − r₀|² + a²) around an egg at r₀ that releases attractant.

    Far from the core a it is the s/|r − r₀| of diffusion in three dimensions, seen in a plane through the
    source; within it is smooth. Its gradient falls with the square of the distance, so c_k is stated at one:
    |∇c| at `distance`.
    """

    gradient_scale: float = 1.0  # c_k, |∇c| at `distance` [concentration / length]
    distance: float = 10.0  # where the gradient is c_k [length]
    core: float = 1.0  # a [length]
    offset: float = 0.0  # c_0, far away [concentration]
    egg_position: tuple[float, float] = (0.0, 0.0)  # r₀ [length]
    egg_radius: float | None = 1.0  # a path that comes this close to r₀ has arrived; None: nothing ends there

    def __post_init__(self) -> None:
        settle(self, check_number, "gradient_scale", above=0.0)
        settle(self, check_number, "distance", above=0.0)
        settle(self, check_number, "core", above=0.0)
        settle(self, check_number, "offset")
        _settle_egg(self)

    @property
    def strength(self) -> float:
        """s = c_k (d² + a²)^{3/2}/d with the distance d [concentration · length]."""
        return self.gradient_scale * (self.distance**2 + self.core**2) ** 1.5 / self.distance

    @property
    def max_gradient(self) -> float:
        """Bound of |∇c|: 2s/(3√3 a²), found at the distance a/√2."""
        return 2 * self.strength / (3 * math.sqrt(3) * self.core**2)

    def concentration(self, position: Array) -> Array:
        """Concentration (...) at `position` (..., 2)."""
        return (
            self.offset
            + self.strength * (_distance_squared(position, self.egg_position) + self.core**2) ** -0.5
        )


@dataclass(frozen=True)
class FunctionField:
    """A field from a plain function `concentration = function(position)`, with position (..., 2) of any array
    library.

    c_k cannot be guessed from a function, so it must be given. With `max_gradient`, a bound of |∇c|, the
    observation space is bounded by it.
    """

    function: Callable[[Array], Array]
    gradient_scale: float  # c_k [concentration / length]
    max_gradient: float | None = None  # [concentration / length]
    egg_position: tuple[float, float] = (0.0, 0.0)  # [length]
    egg_radius: float | None = None  # a path that comes this close to it has arrived [length]
    inside: Callable[[Array], Array] | None = (
        None  # position (..., 2) -> bool (...); a cell that leaves is truncated
    )
    box: tuple[tuple[float, float], tuple[float, float]] | None = None  # default start box ((x, x), (y, y))

    def __post_init__(self) -> None:
        check_function("function", self.function)
        settle(self, check_number, "gradient_scale", above=0.0)
        if self.max_gradient is not None:
            settle(self, check_number, "max_gradient", above=0.0)
        _settle_egg(self)
        if self.inside is not None:
            check_function("inside", self.inside)
        if self.box is not None:
            settle(self, check_box, "box")

    def concentration(self, position: Array) -> Array:
        """Concentration (...) at `position` (..., 2)."""
        return self.function(position)


def _distance_squared(position: Array, centre: tuple[float, float]) -> Array:
    x, y = position[..., 0] - centre[0], position[..., 1] - centre[1]
    return x * x + y * y


def _settle_egg(field: GaussianPlume | DiffusingSource | FunctionField) -> None:
    settle(field, check_point, "egg_position")
    if field.egg_radius is not None:
        settle(field, check_number, "egg_radius", above=0.0)
