"""Flows in space: Beltrami's waves, and shear around a sphere."""

from __future__ import annotations

import math
from dataclasses import dataclass
from operator import attrgetter

from swarm._support.arrays import Array, namespace
from swarm._support.checks import Checked, check_flag, check_number, check_triple, parameter
from swarm.physics.flows.flow import FLOWS, InSpace
from swarm.physics.motion.arc import components


@FLOWS.register("abc")
@dataclass(frozen=True)
class ABCFlow(Checked, InSpace):
    """Arnold–Beltrami–Childress flow, whose paths are chaotic in parts: u = (A sin kz + C cos ky,
    B sin kx + A cos kz, C sin ky + B cos kx), ω = k u (Dombre et al. 1986, J. Fluid Mech. 167, 353).
    """

    amplitudes: tuple[float, ...] = parameter((0.1, 0.1, 0.1), check_triple)  # A, B, C [length / time]
    wavenumber: float = parameter(math.pi / 10, check_number, above=0.0)  # k [1 / length]

    max_wavenumber = property(attrgetter("wavenumber"))

    def __post_init__(self) -> None:
        super().__post_init__()
        if not any(self.amplitudes):
            raise ValueError(
                f"amplitudes must not all be zero, got {self.amplitudes}; StillWater() has no flow"
            )

    @property
    def speed_scale(self) -> float:
        """√(A² + B² + C²), the root mean square of |u|."""
        return math.hypot(*self.amplitudes)

    @property
    def spin_scale(self) -> float:
        """Half of k times that, the root mean square of |ω|/2."""
        return 0.5 * self.wavenumber * self.speed_scale

    @property
    def max_speed(self) -> float:
        """Bound of |u|, attained where A = B = C: with |2 sin α cos β| ≤ sin²α + cos²β."""
        a, b, c = map(abs, self.amplitudes)
        return math.sqrt(self.speed_scale**2 + max(a * c, a * b) + max(b * a, b * c) + max(c * b, c * a))

    @property
    def max_spin(self) -> float:
        """Bound of |ω|/2."""
        return 0.5 * self.wavenumber * self.max_speed

    @property
    def max_shear(self) -> float:
        """Bound of the velocity's derivatives."""
        return self.wavenumber * max(map(abs, self.amplitudes))

    @property
    def period(self) -> float:
        """Length 2π/k after which the flow repeats in each direction."""
        return 2 * math.pi / self.wavenumber

    def velocity_and_vorticity(self, x: Array, y: Array, z: Array) -> tuple[Array, ...]:
        """The components (...) of velocity and vorticity at the places (x, y, z)."""
        xp, k, (a, b, c) = namespace(x), self.wavenumber, self.amplitudes
        sines, cosines = ([wave(k * part) for part in (x, y, z)] for wave in (xp.sin, xp.cos))
        velocity = (
            a * sines[2] + c * cosines[1],
            b * sines[0] + a * cosines[2],
            c * sines[1] + b * cosines[0],
        )
        return *velocity, *(k * part for part in velocity)


@FLOWS.register("shear_around_sphere")
@dataclass(frozen=True)
class ShearAroundSphere(Checked, InSpace):
    """Stokes flow around a sphere, an egg, in the simple shear u = (γ z, 0, 0) about its centre, γ = u₀/h.

    With the strain rate E, the vorticity 2Ω of the shear and the radius a,
    u = Ω × r + E r (1 − a⁵/r⁵) − (5/2) r (r·E r) (a³/r⁵ − a⁵/r⁷) where the sphere turns freely with the
    water, and less Ω × r a³/r³ where it is held (Batchelor, An Introduction to Fluid Dynamics, § 4.11);
    ω = 2Ω + 5 (a³/r⁵) r × E r, less (a³/r³) (3 r (r·Ω)/r² − Ω). A cell
    that comes into the sphere is truncated, unless it has arrived at an egg as large before.
    """

    # u₀, the speed far from the sphere at the height h above its centre [length / time]
    speed_scale: float = parameter(0.1, check_number, above=0.0)
    height: float = parameter(10.0, check_number, above=0.0)  # h [length]
    radius: float = parameter(1.0, check_number, above=0.0)  # a [length]
    centre: tuple[float, ...] = parameter((0.0, 0.0, 0.0), check_triple)  # [length]
    rotates: bool = parameter(True, check_flag)  # the sphere turns freely; else it is held

    @property
    def rate(self) -> float:
        """γ [1 / time]."""
        return self.speed_scale / self.height

    @property
    def spin_scale(self) -> float:
        """Bound of |ω|/2, found above and below the sphere."""
        return (1.75 if self.rotates else 2.0) * self.rate

    max_spin = property(attrgetter("spin_scale"))

    @property
    def max_shear(self) -> float:
        """Bound of the velocity's derivatives, found at the sphere."""
        return 4.0 * self.rate

    @property
    def max_wavenumber(self) -> float:
        """Near the sphere the flow changes over a fifth of its radius."""
        return 5.0 / self.radius

    def velocity_and_vorticity(self, x: Array, y: Array, z: Array) -> tuple[Array, ...]:
        """The components (...) of velocity and vorticity at the places (x, y, z)."""
        x, y, z = (part - middle for part, middle in zip((x, y, z), self.centre, strict=True))
        square = (x * x + y * y + z * z) * (1 / self.radius**2)  # r²/a²
        inverse = square**-0.5  # a/r
        third = inverse / square
        fifth = third / square
        half = 0.5 * self.rate
        # r·E r = γ x z, E r = γ (z, 0, x)/2, Ω = (0, γ, 0)/2, Ω × r = γ (z, 0, −x)/2
        strained = half * (1 - fifth)
        turned = half if self.rotates else half * (1 - third)
        pressed = (-2.5 / self.radius**2) * self.rate * (fifth - fifth / square) * x * z
        strong = (5 / self.radius**2) * half * fifth
        vorticity = [strong * x * y, 2 * half + strong * (z * z - x * x), -strong * y * z]
        if not self.rotates:
            lost = half * third
            along = (3 * y / (square * self.radius**2)) * lost
            vorticity = [vorticity[0] - along * x, vorticity[1] - along * y + lost, vorticity[2] - along * z]
        velocity = (
            (strained + turned) * z + pressed * x,
            pressed * y,
            (strained - turned) * x + pressed * z,
        )
        return *velocity, *vorticity

    def inside(self, position: Array) -> Array:
        """Whether `position` (..., 3) lies in the water, bool (...)."""
        away = [part - middle for part, middle in zip(components(position), self.centre, strict=True)]
        return sum((part * part for part in away[1:]), start=away[0] * away[0]) >= self.radius**2
