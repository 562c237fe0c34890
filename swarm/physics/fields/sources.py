"""Sources in still water: what they release spreads by diffusion, from the moment on that they release it.

In a world in the plane all lie on the plane z = 0 of the cells, in a film (2 dimensions) or in bulk fluid
(3). In space are eggs in bulk fluid.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from swarm._support.arrays import Array, moment, namespace
from swarm._support.checks import (
    Checked,
    check_count,
    check_number,
    check_pair,
    check_point,
    optional,
    parameter,
)
from swarm.physics.fields.field import FIELDS, FrozenField, distance_squared
from swarm.physics.fields.special import erfc, exponential_integral, scaled_erfc

# Where a Gaussian's steady cloud is steepest: the largest (1 − e^{−x²})/x and (erf x − 2x e^{−x²}/√π)/x².
STEEPEST = {2: 0.6381726863389515, 3: 0.42799831833888224}


def check_dimensions(name: str, value: int) -> int:
    """Return `value`; raises unless it is 2 or 3."""
    if check_count(name, value) not in (2, 3):
        raise ValueError(f"{name} must be 2 (a film) or 3 (bulk fluid), got {value}")
    return int(value)


def gaussian_peak(variance: float, dimensions: int) -> float:
    """Largest value of the normal density [1 / length^d] with a variance [length²] per axis."""
    return (2 * math.pi * variance) ** (-0.5 * dimensions)


@dataclass(frozen=True)
class Source(Checked):
    """What sources have in common. Their c_k is a number that never changes: as given, else the
    `_typical_gradient` at `distance`."""

    # M [concentration · length^d] at once, Q [concentration · length^d / time] steadily
    strength: float = parameter(1.0, check_number, above=0.0)
    diffusivity: float = parameter(0.024, check_number, above=0.0)  # D [length² / time]
    gradient_scale: float = parameter(None, optional(check_number), above=0.0)  # c_k
    distance: float = parameter(2.0, check_number, above=0.0)  # [length]
    offset: float = parameter(0.0, check_number)  # c_0, far away [concentration]

    coordinates: ClassVar[Any] = 2

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.gradient_scale is None:
            object.__setattr__(self, "gradient_scale", self._typical_gradient())

    def at(self, time: Array) -> FrozenField:
        """The field frozen at `time`, see `FrozenField`."""
        return FrozenField(self, time)

    def _shortest(self, length: float, like: Array) -> float:
        """Distances below, where differences of nearly equal numbers are divided by them, are taken as this:
        about as wrong as rounding there."""
        return float(namespace(like).finfo(like.dtype).eps) ** (1 / 3) * length


@dataclass(frozen=True)
class Egg(Source):
    """A source that stays where it is, an egg."""

    # how long ago it released at t = 0, or began to [time]
    age: float = parameter(10.0, check_number, above=0.0)
    dimensions: int = parameter(2, check_dimensions)  # d
    egg_position: tuple[float, ...] = parameter((0.0, 0.0), check_point)  # r₀ [length]
    # a path that comes this close to r₀ has arrived; None: nothing ends there
    egg_radius: float | None = parameter(0.5, optional(check_number), above=0.0)

    _steady: ClassVar[Any] = False  # it releases steadily, not all at once

    # in bulk fluid cells may swim in space too
    coordinates = property(lambda self: 2 if self.dimensions == 2 else None)

    def _typical_gradient(self) -> float:
        """|∇c| at `distance`, r: of what is released steadily in the end, Q/(2πDr), Q/(4πDr²); of a cloud
        released at once the largest ever, at 2Dt = r²/(d + 2)."""
        d, r = self.dimensions, self.distance
        if self._steady:
            surface = 2 * math.pi * r * (1 if d == 2 else 2 * r)
            return self.strength / (self.diffusivity * surface)
        variance = r * r / (d + 2)
        return self.strength * gaussian_peak(variance, d) * math.exp(-0.5 * (d + 2)) * r / variance


@dataclass(frozen=True)
class CoredEgg(Egg):
    """An egg that releases steadily what then spreads.

    Left out is what it has released within the last a²/2D, which no wider cloud than the core a has grown
    from: the concentration at the egg is finite, and outside the core it is that of a point. As much as this
    is released from a Gaussian of standard deviation a.
    """

    core: float = parameter(0.2, check_number, above=0.0)  # a [length]

    _steady = True

    def __post_init__(self) -> None:
        super().__post_init__()
        if self._steady and self.core_time >= self.age:
            rule = f"age must be above core²/2D = {self.core_time:g}"
            raise ValueError(f"{rule}, from when on there is something, got {self.age:g}")

    @property
    def core_time(self) -> float:
        """a²/2D, how long what is released takes to fill the core [time]."""
        return self.core**2 / (2 * self.diffusivity)


@FIELDS.register("released_source")
@dataclass(frozen=True)
class ReleasedSource(Egg):
    """The cloud of an egg that released all at once: c = c_0 + M/(4πDτ)^{d/2} exp(−r²/4Dτ), τ = t + age
    (Crank 1975, eq. 3.4). Having an age it is finite without a core.

    c_k, where it is not given, is the largest gradient ever at `distance`.
    """

    @property
    def _start(self) -> tuple[float, float]:
        """Variance and largest concentration at t = 0."""
        variance = 2 * self.diffusivity * self.age
        return variance, self.strength * gaussian_peak(variance, self.dimensions)

    @property
    def max_gradient(self) -> float:
        """Bound of |∇c|: the largest of t = 0, one standard deviation from the egg."""
        variance, peak = self._start
        return peak / math.sqrt(variance * math.e)

    @property
    def max_rate(self) -> float:
        """Bound of |∂c/∂t|: that of the egg at t = 0."""
        variance, peak = self._start
        return peak * self.dimensions * self.diffusivity / variance

    def concentration(self, position: Array, time: Array = 0.0) -> Array:
        spread = 4 * self.diffusivity * (moment(time, position) + self.age)
        cloud = namespace(position).exp(-distance_squared(position, self.egg_position) / spread)
        return self.offset + self.strength * (math.pi * spread) ** (-0.5 * self.dimensions) * cloud


@FIELDS.register("releasing_source")
@dataclass(frozen=True)
class ReleasingSource(CoredEgg):
    """The cloud of an egg that releases steadily. With τ = t + age (Crank 1975, section 3.4; Carslaw & Jaeger
    1959, section 10.4), less what has not left the core a yet, the same with a²/2D for τ:

    d = 2: c = c_0 + Q/(4πD) E₁(r²/4Dτ)

    d = 3: c = c_0 + Q/(4πDr) erfc(r/√(4Dτ))

    c_k, where it is not given, is the gradient at `distance` in the end.
    """

    @property
    def max_gradient(self) -> float:
        """Bound of |∇c|: the largest in the end, which is about a core from the egg."""
        steepest = STEEPEST[self.dimensions] / (math.sqrt(2) * self.core) ** (self.dimensions - 1)
        return self.strength * steepest / (2 * math.pi * self.diffusivity * (self.dimensions - 1))

    @property
    def max_rate(self) -> float:
        """Bound of |∂c/∂t|: that of the egg at t = 0."""
        return self.strength * gaussian_peak(2 * self.diffusivity * self.age, self.dimensions)

    def concentration(self, position: Array, time: Array = 0.0) -> Array:
        xp = namespace(position)
        spread = 4 * self.diffusivity * (moment(time, position) + self.age)
        square = distance_squared(position, self.egg_position)
        square = xp.clip(square, self._shortest(self.core, position) ** 2, None)
        core = 2 * self.core**2
        scale = self.strength / (4 * math.pi * self.diffusivity)
        if self.dimensions == 2:
            cloud = exponential_integral(square / spread) - exponential_integral(square / core)
            return self.offset + scale * cloud
        cloud = erfc(xp.sqrt(square / spread)) - erfc(xp.sqrt(square / core))
        return self.offset + scale * cloud / xp.sqrt(square)


@FIELDS.register("moving_source")
@dataclass(frozen=True)
class MovingSource(Source):
    """The wake of a source that has always released steadily while it moved straight on with the velocity v,
    in bulk fluid: c = c_0 + Q/(4πDr) e^{−v(r + ξ)/2D}, with r from where it is and ξ ahead of it (Rosenthal
    1946; Carslaw & Jaeger 1959, section 10.7), less what has not left the core a yet.

    It is released from a Gaussian of standard deviation a that lies v a²/2D behind. No life ends at it.
    c_k, where it is not given, is the gradient at `distance` behind it: Q/(4πDr²).
    """

    velocity: tuple[float, float] = parameter((0.1, 0.0), check_pair)  # v [length / time]
    position: tuple[float, float] = parameter((0.0, 0.0), check_pair)  # where it is at t = 0 [length]
    core: float = parameter(0.2, check_number, above=0.0)  # a [length]

    def _typical_gradient(self) -> float:
        return self.strength / (4 * math.pi * self.diffusivity * self.distance**2)

    @property
    def max_gradient(self) -> float:
        """Bound of |∇c|: the sum of the largest of all that was ever released."""
        narrowest = gaussian_peak(self.core**2, 3) * self.core / math.sqrt(math.e)
        return self.strength * narrowest / (2 * self.diffusivity)

    @property
    def max_rate(self) -> float:
        """Bound of |∂c/∂t| = |v·∇c|."""
        return math.hypot(*self.velocity) * self.max_gradient

    def concentration(self, position: Array, time: Array = 0.0) -> Array:
        xp, now = namespace(position), moment(time, position)
        x, y = (position[..., i] - (self.position[i] + self.velocity[i] * now) for i in (0, 1))
        shortest = self._shortest(self.core, position)
        r = xp.sqrt(xp.clip(x * x + y * y, shortest**2, None))
        speed, width = math.hypot(*self.velocity), math.sqrt(2) * self.core
        ahead = self.velocity[0] * x + self.velocity[1] * y  # v ξ
        away, carried = r / width, 0.25 * speed * width / self.diffusivity  # r and v a²/2D in core widths
        half = 0.5 / self.diffusivity
        wake = xp.exp(-half * (speed * r + ahead)) * erfc(carried - away)
        # e^{v(r − ξ)/2D} erfc(carried + away), of which the first may be beyond all numbers
        core = xp.exp(-(away * away) - half * ahead - carried**2) * scaled_erfc(carried + away)
        return self.offset + self.strength / (8 * math.pi * self.diffusivity) * (wake - core) / r
