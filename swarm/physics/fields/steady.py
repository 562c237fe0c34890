"""Fields that do not change: linear, highest at an egg, from plain functions."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import MISSING, dataclass
from operator import attrgetter

from swarm._support.arrays import Array, namespace
from swarm._support.checks import (
    Box,
    Checked,
    check_box,
    check_function,
    check_number,
    check_point,
    optional,
    parameter,
)
from swarm.physics.fields.field import FIELDS, distance_squared


@FIELDS.register("linear")
@dataclass(frozen=True)
class LinearField(Checked):
    """c = c_k y + c_0 (paper: linear concentration field), in space c_k z + c_0."""

    gradient_scale: float = parameter(1.0, check_number, above=0.0)  # c_k, paper table 1
    offset: float = parameter(20.0, check_number)  # c_0, paper table 1

    max_gradient = property(attrgetter("gradient_scale"))  # c_k itself

    def concentration(self, position: Array) -> Array:
        return self.gradient_scale * position[..., -1] + self.offset


@FIELDS.register("radial")
@dataclass(frozen=True)
class RadialField(Checked):
    """c = c_0 − c_k |r| around an egg at the origin (paper: radial concentration field)."""

    gradient_scale: float = parameter(1.0, check_number, above=0.0)  # c_k, paper table 1
    offset: float = parameter(100.0, check_number)  # c_0, paper table 1
    # a path that comes this close to the origin has arrived
    egg_radius: float = parameter(1.0, check_number, above=0.0)

    egg_position = (0.0, 0.0)
    max_gradient = property(attrgetter("gradient_scale"))  # c_k itself

    def concentration(self, position: Array) -> Array:
        return self.offset - self.gradient_scale * distance_squared(position, (0.0, 0.0)) ** 0.5


@FIELDS.register("gaussian_plume")
@dataclass(frozen=True)
class GaussianPlume(Checked):
    """A patch c = c_0 + A exp(−|r − r₀|²/2w²) around an egg at r₀.

    c_k is the steepest gradient, found at the distance w from r₀: c_k = A/(w √e), so A = c_k w √e.
    """

    # c_k, |∇c| at the distance `width` [concentration / length]
    gradient_scale: float = parameter(1.0, check_number, above=0.0)
    width: float = parameter(10.0, check_number, above=0.0)  # w [length]
    offset: float = parameter(0.0, check_number)  # c_0, far away [concentration]
    egg_position: tuple[float, ...] = parameter((0.0, 0.0), check_point)  # r₀ [length]
    # a path that comes this close to r₀ has arrived; None: nothing ends there
    egg_radius: float | None = parameter(1.0, optional(check_number), above=0.0)

    max_gradient = property(attrgetter("gradient_scale"))  # c_k itself

    @property
    def amplitude(self) -> float:
        """A, the concentration at r₀ above the offset."""
        return self.gradient_scale * self.width * math.sqrt(math.e)

    def concentration(self, position: Array) -> Array:
        xp = namespace(position)
        exponent = distance_squared(position, self.egg_position) * (-0.5 / self.width**2)
        return self.offset + self.amplitude * xp.exp(exponent)


@FIELDS.register("diffusing_source")
@dataclass(frozen=True)
class DiffusingSource(Checked):
    """The steady cloud c = c_0 + s/√(|r − r₀|² + a²) around an egg at r₀ that releases attractant.

    Far from the core a it is the s/|r − r₀| of diffusion in three dimensions, seen in a plane through the
    source; within it is smooth. Its gradient falls with the square of the distance, so c_k is stated at one:
    |∇c| at `distance`.
    """

    # c_k, |∇c| at `distance` [concentration / length]
    gradient_scale: float = parameter(1.0, check_number, above=0.0)
    distance: float = parameter(10.0, check_number, above=0.0)  # where the gradient is c_k [length]
    core: float = parameter(1.0, check_number, above=0.0)  # a [length]
    offset: float = parameter(0.0, check_number)  # c_0, far away [concentration]
    egg_position: tuple[float, ...] = parameter((0.0, 0.0), check_point)  # r₀ [length]
    # a path that comes this close to r₀ has arrived; None: nothing ends there
    egg_radius: float | None = parameter(1.0, optional(check_number), above=0.0)

    @property
    def strength(self) -> float:
        """s = c_k (d² + a²)^{3/2}/d with the distance d [concentration · length]."""
        return self.gradient_scale * (self.distance**2 + self.core**2) ** 1.5 / self.distance

    @property
    def max_gradient(self) -> float:
        """Bound of |∇c|: 2s/(3√3 a²), found at the distance a/√2."""
        return 2 * self.strength / (3 * math.sqrt(3) * self.core**2)

    def concentration(self, position: Array) -> Array:
        softened = distance_squared(position, self.egg_position) + self.core**2
        return self.offset + self.strength * softened**-0.5


@dataclass(frozen=True)
class FunctionField(Checked):
    """A field from a plain function `concentration = function(position)`, with position (..., 2) of any array
    library, in space (..., 3).

    c_k cannot be guessed from a function, so it must be given: about the root mean square of |∇c| where
    lives start, and a world warns of one that is off by more than twice. With `max_gradient`, a bound of
    |∇c|, the observation space is bounded by it.
    """

    function: Callable[[Array], Array] = parameter(MISSING, check_function)
    gradient_scale: float = parameter(MISSING, check_number, above=0.0)  # c_k [concentration / length]
    max_gradient: float | None = parameter(None, optional(check_number), above=0.0)
    egg_position: tuple[float, ...] = parameter((0.0, 0.0), check_point)  # [length]
    # a path that comes this close to the egg has arrived [length]
    egg_radius: float | None = parameter(None, optional(check_number), above=0.0)
    # position (..., 2) -> bool (...); a cell that leaves is truncated
    inside: Callable[[Array], Array] | None = parameter(None, optional(check_function))
    # default start box ((x, x), (y, y)), in space of three sides [length]
    box: Box | None = parameter(None, optional(check_box))

    def concentration(self, position: Array) -> Array:
        return self.function(position)
