"""Vortices: Taylor–Green's, which fill the plane, and one alone."""

from __future__ import annotations

import math
from dataclasses import dataclass
from operator import attrgetter

from swarm._support.arrays import Array, namespace
from swarm._support.checks import Checked, check_flag, check_number, check_pair, parameter
from swarm.physics.flows.flow import FLOWS, InPlane

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
