"""Vortices: Taylor–Green's, which fill the plane, and may swing; one alone; two gyres whose border swings."""

from __future__ import annotations

import math
from dataclasses import dataclass
from operator import attrgetter

from swarm._support.arrays import Array, moment, namespace
from swarm._support.checks import Checked, check_flag, check_number, check_pair, parameter
from swarm.physics.flows.flow import FLOWS, FrozenFlow, InPlane

# Lamb–Oseen: x² = 1.2564… solves 1 + 2x² = exp(x²), and there (1 − exp(−x²))/x is largest.
PEAK_VELOCITY = 0.6381726863389515  # at x = 1.1209064227785340 cores, in Γ/(2π core)


@FLOWS.register("taylor_green")
@dataclass(frozen=True)
class TaylorGreen(Checked, InPlane):
    """Taylor–Green vortices u = u₀ (cos kx sin ky, −sin kx cos ky), ω₀ = −u₀ k cos kx cos ky (paper: external
    flow)."""

    speed_scale: float = parameter(0.1, check_number, above=0.0)  # u₀, paper table 1
    wavenumber: float = parameter(math.pi / 10, check_number, above=0.0)  # k, paper table 1

    max_speed = property(attrgetter("speed_scale"))
    max_spin = property(attrgetter("spin_scale"))

    @property
    def spin_scale(self) -> float:
        """u₀ k, the largest spin."""
        return self.speed_scale * self.wavenumber

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


@FLOWS.register("vortex")
@dataclass(frozen=True)
class Vortex(Checked):
    """A Lamb–Oseen vortex at r₀: u_φ = Γ/(2πr) (1 − exp(−r²/a²)), ω₀ = Γ/(2πa²) exp(−r²/a²), with r from r₀.

    Within about a core a the water turns like a solid body, farther out the velocity falls as 1/r. Γ follows
    from the largest speed, u₀ = 0.638 Γ/(2πa), found at r = 1.121 a.
    """

    speed_scale: float = parameter(0.1, check_number, above=0.0)  # u₀, the largest speed [length / time]
    core: float = parameter(2.0, check_number, above=0.0)  # a [length]
    centre: tuple[float, float] = parameter((5.0, 5.0), check_pair)  # r₀ [length]
    clockwise: bool = parameter(False, check_flag)

    max_speed = property(attrgetter("speed_scale"))
    max_spin = property(attrgetter("spin_scale"))

    @property
    def spin_scale(self) -> float:
        """|Γ|/(2πa²), the spin in the middle."""
        return self.speed_scale / (PEAK_VELOCITY * self.core)

    @property
    def _turning(self) -> float:
        return -self.spin_scale if self.clockwise else self.spin_scale

    def _from_centre(self, position: Array) -> tuple[Array, Array, Array]:
        """x, y and r²/a² seen from the centre."""
        x, y = position[..., 0] - self.centre[0], position[..., 1] - self.centre[1]
        return x, y, (x * x + y * y) * (1 / self.core**2)

    def velocity(self, position: Array) -> Array:
        xp = namespace(position)
        x, y, square = self._from_centre(position)
        near = square < 1e-12  # there (1 − exp(−s))/s is 1 to rounding
        decay = -xp.expm1(-square) / xp.where(near, xp.ones_like(square), square)
        rate = self._turning * xp.where(near, xp.ones_like(square), decay)  # u_φ/r
        return xp.stack([-rate * y, rate * x], axis=-1)

    def spin(self, position: Array) -> Array:
        xp = namespace(position)
        return self._turning * xp.exp(-self._from_centre(position)[2])


@FLOWS.register("oscillating_taylor_green")
@dataclass(frozen=True)
class OscillatingTaylorGreen(TaylorGreen):
    """Taylor–Green vortices that swing along x: at t those of `TaylorGreen` at (x − φ/k, y), with the phase
    φ = φ₀ sin Ωt (Solomon & Gollub 1988, Phys. Rev. A 38, 6280)."""

    phase: float = parameter(0.5, check_number, at_least=0.0)  # φ₀ [rad]
    frequency: float = parameter(math.pi / 10, check_number, above=0.0)  # Ω [rad / time]

    @property
    def max_frequency(self) -> float:
        """Bound of |∂u/∂t|/u₀, Ω(1 + φ₀) [rad / time]: Ω, and how fast the vortices pass."""
        return self.frequency * (1 + self.phase)

    def at(self, time: Array) -> FrozenFlow:
        """The flow frozen at `time`, see `FrozenFlow`."""
        return FrozenFlow(self, time)

    def velocity_and_spin(self, x: Array, y: Array, time: Array = 0.0) -> tuple[Array, Array, Array]:
        """u_x, u_y and ω₀ (...) at the places (x, y) and at `time`."""
        swing = namespace(x).sin(self.frequency * moment(time, x)) * (self.phase / self.wavenumber)
        return super().velocity_and_spin(x - swing, y)


@FLOWS.register("double_gyre")
@dataclass(frozen=True)
class DoubleGyre(Checked, InPlane):
    """Two gyres side by side in [0, 2L] × [0, L], whose border swings (Shadden, Lekien & Marsden 2005,
    Physica D 212, 271; the defaults are theirs): ψ = AL sin(πf) sin(πY), X = x/L, Y = y/L,
    f = ε sin(Ωt) X² + (1 − 2ε sin Ωt) X, u = (−∂ψ/∂y, ∂ψ/∂x).

    A cell that leaves is truncated; behind a wall the values at the wall go on.
    """

    amplitude: float = parameter(0.1, check_number, above=0.0)  # A [length / time]
    displacement: float = parameter(0.25, check_number, at_least=0.0)  # ε, below 1/2
    frequency: float = parameter(math.pi / 5, check_number, above=0.0)  # Ω [rad / time]
    size: float = parameter(1.0, check_number, above=0.0)  # L [length]

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.displacement >= 0.5:
            raise ValueError(f"displacement must be below 0.5, or the gyres fold, got {self.displacement}")

    @property
    def speed_scale(self) -> float:
        """πA, the largest speed of gyres that do not swing."""
        return math.pi * self.amplitude

    @property
    def spin_scale(self) -> float:
        """π²A/L, the largest spin of gyres that do not swing."""
        return math.pi * self.speed_scale / self.size

    @property
    def max_speed(self) -> float:
        """(1 + 2ε) πA, reached at a side wall."""
        return self.speed_scale * (1 + 2 * self.displacement)

    @property
    def max_spin(self) -> float:
        """Bound of |ω₀|, from those of f' and f''."""
        return 0.5 * (self.max_shear + self.spin_scale)

    @property
    def max_shear(self) -> float:
        """Bound of the velocity's derivatives: that of ∂u_y/∂x."""
        return (self.speed_scale / self.size) * math.hypot(
            math.pi * (1 + 2 * self.displacement) ** 2, 2 * self.displacement
        )

    @property
    def max_frequency(self) -> float:
        """Bound of |∂u/∂t|/max_speed, Ω(1 + (π + 2)ε) [rad / time]: Ω, and how fast the border passes."""
        return self.frequency * (1 + (math.pi + 2) * self.displacement)

    @property
    def box(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Default start box: all there is."""
        return (0.0, 2 * self.size), (0.0, self.size)

    def at(self, time: Array) -> FrozenFlow:
        """The flow frozen at `time`, see `FrozenFlow`."""
        return FrozenFlow(self, time)

    def velocity_and_spin(self, x: Array, y: Array, time: Array = 0.0) -> tuple[Array, Array, Array]:
        """u_x, u_y and ω₀ (...) at the places (x, y) and at `time`."""
        xp = namespace(x)
        across, up = xp.clip(x / self.size, 0.0, 2.0), math.pi * xp.clip(y / self.size, 0.0, 1.0)
        swing = self.displacement * xp.sin(self.frequency * moment(time, x))
        border = math.pi * across * (swing * (across - 2) + 1)  # πf
        slope = 2 * swing * (across - 1) + 1  # f'
        sine, cosine, sine_up = xp.sin(border), xp.cos(border), xp.sin(up)
        bend = math.pi * sine * (slope * slope + 1) - 2 * swing * cosine
        return (
            -self.speed_scale * sine * xp.cos(up),
            self.speed_scale * cosine * slope * sine_up,
            (-0.5 * self.speed_scale / self.size) * bend * sine_up,
        )

    def inside(self, position: Array) -> Array:
        """Whether `position` (..., 2) lies in the gyres, bool (...)."""
        x, y = position[..., 0], position[..., 1]
        return (x >= 0) & (x <= 2 * self.size) & (y >= 0) & (y <= self.size)
