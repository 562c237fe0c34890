"""Flows of the surrounding water: velocity and spin at a position.

A flow is any object with `velocity(position)`, `spin(position)`, `speed_scale` and `spin_scale`. The scales
normalise what is sensed, and from them follows how finely a path is integrated: they should be about the
largest values. Used when there and not None: `period` (length after which the flow repeats in x and y), `box`
(the default start box, else one period), `max_speed` and `max_spin` (bounds of |u| and |ω₀|, for the
observation space), `max_shear` (a bound of the velocity's derivatives, where they exceed the spin),
`inside(position)` (where the flow is known; a cell that leaves is truncated) and `velocity_and_spin(x, y)`
(u_x, u_y and ω₀ of all places at one go, for speed).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from swarm._support.arrays import join, namespace
from swarm._support.checks import check_box, check_flag, check_function, check_number, check_point, settle

Array = Any

# Lamb–Oseen: x² = 1.2564… solves 1 + 2x² = exp(x²), and there (1 − exp(−x²))/x is largest.
PEAK_RADIUS = 1.1209064227785340  # where the velocity is largest, in cores
PEAK_VELOCITY = 0.6381726863389515  # the velocity there, in Γ/(2π core)


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
    max_spin = 0.0

    def velocity(self, position: Array) -> Array:
        """Zero velocity (..., 2)."""
        return 0.0 * position

    def spin(self, position: Array) -> Array:
        """Zero spin (...)."""
        return 0.0 * position[..., 0]


@dataclass(frozen=True)
class TaylorGreen:
    """Taylor–Green vortices u = u₀ (cos kx sin ky, −sin kx cos ky), ω₀ = −u₀ k cos kx cos ky (paper: external
    flow)."""

    speed_scale: float = 0.1  # u₀, paper table 1
    wavenumber: float = math.pi / 10  # k, paper table 1

    def __post_init__(self) -> None:
        settle(self, check_number, "speed_scale", above=0.0)
        settle(self, check_number, "wavenumber", above=0.0)

    @property
    def spin_scale(self) -> float:
        """u₀ k, the largest spin."""
        return self.speed_scale * self.wavenumber

    @property
    def max_speed(self) -> float:
        """Bound of |u|: u₀."""
        return self.speed_scale

    @property
    def max_spin(self) -> float:
        """Bound of |ω₀|: u₀ k."""
        return self.spin_scale

    @property
    def period(self) -> float:
        """Length 2π/k after which the flow repeats in x and in y."""
        return 2 * math.pi / self.wavenumber

    def velocity_and_spin(self, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """u_x, u_y and ω₀ (...) at the places (x, y)."""
        xp = namespace(x)
        # Products of sines and cosines are written as sums, which halves the number of transcendental
        # functions.
        plus, minus = self.wavenumber * (x + y), self.wavenumber * (x - y)
        sine_plus, sine_minus = xp.sin(plus), xp.sin(minus)
        speed, spin = 0.5 * self.speed_scale, 0.5 * self.spin_scale
        return (
            speed * (sine_plus - sine_minus),
            -speed * (sine_plus + sine_minus),
            -spin * (xp.cos(plus) + xp.cos(minus)),
        )

    def velocity(self, position: Array) -> Array:
        """Velocity u (..., 2) at `position` (..., 2)."""
        x, y, _ = self.velocity_and_spin(position[..., 0], position[..., 1])
        return join(x, y)

    def spin(self, position: Array) -> Array:
        """Angular velocity ω₀ (...) at `position` (..., 2)."""
        return self.velocity_and_spin(position[..., 0], position[..., 1])[2]


@dataclass(frozen=True)
class UniformFlow:
    """A current u = (u_x, u_y), the same everywhere. Nothing spins in it: ω₀ = 0.

    The spin scale is 1 rad per time, because a spin that is zero everywhere is so in any unit.
    """

    current: tuple[float, float] = (0.1, 0.0)  # (u_x, u_y) [length / time]

    spin_scale = 1.0
    max_spin = 0.0

    def __post_init__(self) -> None:
        settle(self, check_point, "current")
        if self.speed_scale == 0.0:
            raise ValueError(f"current must not be zero, got {self.current}; StillWater() has no flow")

    @property
    def speed_scale(self) -> float:
        """|u|."""
        return math.hypot(*self.current)

    @property
    def max_speed(self) -> float:
        """Bound of |u|: itself."""
        return self.speed_scale

    def velocity(self, position: Array) -> Array:
        """Velocity u (..., 2) at `position` (..., 2)."""
        xp = namespace(position)
        along = xp.ones_like(position[..., 0])
        return xp.stack([self.current[0] * along, self.current[1] * along], axis=-1)

    def spin(self, position: Array) -> Array:
        """Zero spin (...)."""
        return 0.0 * position[..., 0]


@dataclass(frozen=True)
class ShearFlow:
    """Simple shear u = (u₀ y/h, 0), ω₀ = −u₀/2h: at rest on the line y = 0, speed u₀ at the height h.

    Its speed has no bound, so neither has the observation of it.
    """

    speed_scale: float = 0.1  # u₀, the speed at `height` [length / time]
    height: float = 10.0  # h [length]

    def __post_init__(self) -> None:
        settle(self, check_number, "speed_scale", above=0.0)
        settle(self, check_number, "height", above=0.0)

    @property
    def spin_scale(self) -> float:
        """|ω₀| = u₀/2h, the same everywhere."""
        return 0.5 * self.speed_scale / self.height

    @property
    def max_spin(self) -> float:
        """Bound of |ω₀|: itself."""
        return self.spin_scale

    def velocity(self, position: Array) -> Array:
        """Velocity u (..., 2) at `position` (..., 2)."""
        xp = namespace(position)
        along = (self.speed_scale / self.height) * position[..., 1]
        return xp.stack([along, xp.zeros_like(along)], axis=-1)

    def spin(self, position: Array) -> Array:
        """Angular velocity ω₀ (...) at `position` (..., 2)."""
        xp = namespace(position)
        return xp.full_like(position[..., 0], -self.spin_scale)


@dataclass(frozen=True)
class PoiseuilleFlow:
    """Flow along a channel between walls at y = a and y = b: u = (4 u₀ (y − a)(b − y)/(b − a)², 0).

    Its spin is ω₀ = −2 u₀ (a + b − 2y)/(b − a)². A cell that leaves the channel is truncated; behind a wall
    the values at the wall go on.
    """

    speed_scale: float = 0.1  # u₀, the speed in the middle [length / time]
    walls: tuple[float, float] = (0.0, 10.0)  # a, b [length]

    def __post_init__(self) -> None:
        settle(self, check_number, "speed_scale", above=0.0)
        settle(self, check_point, "walls")
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
    def max_speed(self) -> float:
        """Bound of |u|: u₀."""
        return self.speed_scale

    @property
    def max_spin(self) -> float:
        """Bound of |ω₀|: the spin at the walls."""
        return self.spin_scale

    @property
    def box(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Default start box: a square from wall to wall."""
        return (0.0, self.width), self.walls

    def _place(self, position: Array) -> Array:
        """(2y − a − b)/(b − a): −1 at one wall, 1 at the other."""
        xp = namespace(position)
        return xp.clip((2 * position[..., 1] - (self.walls[0] + self.walls[1])) / self.width, -1.0, 1.0)

    def velocity(self, position: Array) -> Array:
        """Velocity u (..., 2) at `position` (..., 2)."""
        xp = namespace(position)
        place = self._place(position)
        return xp.stack([self.speed_scale * (1 - place * place), xp.zeros_like(place)], axis=-1)

    def spin(self, position: Array) -> Array:
        """Angular velocity ω₀ (...) at `position` (..., 2)."""
        return self.spin_scale * self._place(position)

    def inside(self, position: Array) -> Array:
        """Whether `position` (..., 2) lies in the channel, bool (...)."""
        return (position[..., 1] >= self.walls[0]) & (position[..., 1] <= self.walls[1])


@dataclass(frozen=True)
class Vortex:
    """A Lamb–Oseen vortex at r₀: u_φ = Γ/(2πr) (1 − exp(−r²/a²)), ω₀ = Γ/(2πa²) exp(−r²/a²), with r from r₀.

    Within about a core a the water turns like a solid body, farther out the velocity falls as 1/r. Γ follows
    from the largest speed, u₀ = 0.638 Γ/(2πa), found at r = 1.121 a.
    """

    speed_scale: float = 0.1  # u₀, the largest speed [length / time]
    core: float = 2.0  # a [length]
    centre: tuple[float, float] = (5.0, 5.0)  # r₀ [length]
    clockwise: bool = False

    def __post_init__(self) -> None:
        settle(self, check_number, "speed_scale", above=0.0)
        settle(self, check_number, "core", above=0.0)
        settle(self, check_point, "centre")
        settle(self, check_flag, "clockwise")

    @property
    def spin_scale(self) -> float:
        """|Γ|/(2πa²), the spin in the middle."""
        return self.speed_scale / (PEAK_VELOCITY * self.core)

    @property
    def max_speed(self) -> float:
        """Bound of |u|: u₀."""
        return self.speed_scale

    @property
    def max_spin(self) -> float:
        """Bound of |ω₀|: the spin in the middle."""
        return self.spin_scale

    @property
    def _turning(self) -> float:
        return -self.spin_scale if self.clockwise else self.spin_scale

    def _from_centre(self, position: Array) -> tuple[Array, Array, Array]:
        """x, y and r²/a² seen from the centre."""
        x, y = position[..., 0] - self.centre[0], position[..., 1] - self.centre[1]
        return x, y, (x * x + y * y) * (1 / self.core**2)

    def velocity(self, position: Array) -> Array:
        """Velocity u (..., 2) at `position` (..., 2)."""
        xp = namespace(position)
        x, y, square = self._from_centre(position)
        near = square < 1e-12  # there (1 − exp(−s))/s is 1 to rounding
        decay = -xp.expm1(-square) / xp.where(near, xp.ones_like(square), square)
        rate = self._turning * xp.where(near, xp.ones_like(square), decay)  # u_φ/r
        return xp.stack([-rate * y, rate * x], axis=-1)

    def spin(self, position: Array) -> Array:
        """Angular velocity ω₀ (...) at `position` (..., 2)."""
        xp = namespace(position)
        return self._turning * xp.exp(-self._from_centre(position)[2])


@dataclass(frozen=True)
class FunctionFlow:
    """A flow from plain functions of the position (..., 2) of any array library.

    Without `spin` it is found from the velocity by central differences, which is right to about 1e-11 of its
    scale in float64 (1e-5 in float32) where the velocity is smooth. The scales cannot be guessed, so they
    must be given: about the largest speed and spin, for they also set how finely paths are integrated.
    """

    function: Callable[[Array], Array]  # velocity (..., 2) at position (..., 2)
    speed_scale: float  # [length / time]
    spin_scale: float  # [rad / time]; where nothing spins, about the largest velocity gradient
    spin_function: Callable[[Array], Array] | None = None  # spin (...) at position (..., 2)
    max_speed: float | None = None  # a bound of |u|
    max_spin: float | None = None  # a bound of |ω₀|
    period: float | None = None  # length after which the flow repeats in x and y
    inside: Callable[[Array], Array] | None = (
        None  # position (..., 2) -> bool (...); a cell that leaves is truncated
    )
    box: tuple[tuple[float, float], tuple[float, float]] | None = None  # default start box ((x, x), (y, y))

    def __post_init__(self) -> None:
        check_function("function", self.function)
        settle(self, check_number, "speed_scale", above=0.0)
        settle(self, check_number, "spin_scale", above=0.0)
        for name in ("spin_function", "inside"):
            if getattr(self, name) is not None:
                check_function(name, getattr(self, name))
        for name in ("max_speed", "max_spin"):
            if getattr(self, name) is not None:
                settle(self, check_number, name, at_least=0.0)
        if self.period is not None:
            settle(self, check_number, "period", above=0.0)
        if self.box is not None:
            settle(self, check_box, "box")

    def velocity(self, position: Array) -> Array:
        """Velocity u (..., 2) at `position` (..., 2)."""
        return self.function(position)

    def spin(self, position: Array) -> Array:
        """Angular velocity ω₀ (...) at `position` (..., 2): as given, else half the vorticity by central
        differences."""
        if self.spin_function is not None:
            return self.spin_function(position)
        xp = namespace(position)
        # The step balances the fourth-order formula's error against rounding.
        length = min(self.speed_scale / self.spin_scale, 1.0)
        step = float(xp.finfo(position.dtype).eps) ** 0.2 * length
        x, y = position[..., 0], position[..., 1]

        def difference(component: int, along_x: float, along_y: float) -> Array:
            place = xp.stack([x + along_x * step, y + along_y * step], axis=-1)
            back = xp.stack([x - along_x * step, y - along_y * step], axis=-1)
            return self.function(place)[..., component] - self.function(back)[..., component]

        vorticity = (
            8 * (difference(1, 1, 0) - difference(0, 0, 1)) - difference(1, 2, 0) + difference(0, 0, 2)
        ) / (12 * step)
        return 0.5 * vorticity
