"""Flows that change with time: vortices that swing, and two gyres whose border does."""

from __future__ import annotations

import math
from dataclasses import dataclass

from swarm._support.arrays import Array, moment, namespace
from swarm._support.checks import Checked, check_number, parameter
from swarm.physics.flows.flow import FLOWS, FrozenFlow, InPlane
from swarm.physics.flows.vortices import TaylorGreen


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
