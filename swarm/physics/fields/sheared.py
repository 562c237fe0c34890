"""An egg in a linear flow, which draws out what the egg releases."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from swarm._support.arrays import Array, as_array, moment, namespace
from swarm._support.checks import check_name, check_number, parameter
from swarm.physics.fields.field import FIELDS
from swarm.physics.fields.sources import CoredEgg

NODES = 48  # release times of the quadrature
_LEGENDRE = np.polynomial.legendre.leggauss(NODES)  # places and weights on [−1, 1], next on [0, 1]
_QUADRATURE = 0.5 * (_LEGENDRE[0] + 1), 0.5 * _LEGENDRE[1]
LONGEST = 30.0  # s √(−det A) where a strained cloud is e^{−30} thin; older ones are taken as that old
NEAR = 1.0  # |z| below which power series are exact to rounding and closed forms are not

Matrix = tuple[tuple[float, float], tuple[float, float]]


def check_velocity_gradient(name: str, value: Any) -> Matrix:
    """Return `value` as ((∂u_x/∂x, ∂u_x/∂y), (∂u_y/∂x, ∂u_y/∂y)) of floats; raises unless its trace is 0."""
    rule = f"{name} must be ((a, b), (c, d)) with a + d = 0, no water being made"
    try:
        (a, b), (c, d) = ((check_number(name, number) for number in row) for row in value)
    except (TypeError, ValueError):
        raise ValueError(f"{rule}, got {value!r}") from None
    if abs(a + d) > 1e-12 * max(abs(a), abs(d)):
        raise ValueError(f"{rule}, got {value!r}")
    return (a, b), (c, d)


@FIELDS.register("sheared_source")
@dataclass(frozen=True)
class ShearedSource(CoredEgg):
    """The cloud of an egg in the linear flow u = A (r − r₀) around it: shear, strain, rotation.

    What it releases at a time is a Gaussian s later, whose covariance follows Σ̇ = AΣ + ΣAᵀ + 2D I from
    Σ = 0 (in shear Σ_xx = 2Ds(1 + γ²s²/3), Σ_xy = γDs², Σ_yy = 2Ds); in bulk fluid nothing flows along z.
    Released "at_once", c = c_0 + M G(r; Σ(τ)), τ = t + age, which needs no core; released "steadily", c = c_0
    + Q ∫ G(r; Σ(s)) ds from a²/2D, see `core`, to τ, by `NODES` Gauss–Legendre nodes in ln s.

    The flow is not the world's: with `ShearFlow(u₀, h)` around the same place A is ((0, u₀/h), (0, 0)), the
    default for its defaults. c_k, where it is not given, is that of the same egg in still water.
    """

    velocity_gradient: Matrix = parameter(((0.0, 0.01), (0.0, 0.0)), check_velocity_gradient)  # A [1 / time]
    release: str = parameter("steadily", check_name, known=("steadily", "at_once"))

    coordinates = 2

    _steady = property(lambda self: self.release == "steadily")

    def covariance(self, age: Array) -> tuple[Array, Array, Array]:
        """Σ_xx, Σ_xy, Σ_yy (...) [length²] of what was released `age` (...) ago [time]."""
        return self._covariance(age)[:3]

    def _covariance(self, age: Array) -> tuple[Array, Array, Array, Array]:
        """Σ_xx, Σ_xy, Σ_yy and det Σ.

        A² = μI, so that e^{As} = cosh(√μ s) I + sinh(√μ s)/√μ A, and Σ = 2D (p I + q (A + Aᵀ) + w AAᵀ), the
        integral of its product with its transpose. The determinant has a form that nothing cancels in.
        """
        (a, b), (c, d) = self.velocity_gradient
        mu, square = a * a + b * c, a * a + b * b + c * c + d * d
        s = age if mu <= 0 else namespace(age).clip(age, None, LONGEST / math.sqrt(mu))
        z = mu * s * s
        rest = _rest(z, mu)
        part = 1 + z * rest  # sinh(√z)/√z
        w = 2 * s**3 * _rest(4 * z, mu)  # (sinh(2√μ s)/2√μ − s)/2μ
        p, q = s + mu * w, 0.5 * (s * part) ** 2
        excess = s**4 * rest * (part + 1)  # (sinh²(√μ s)/μ − s²)/μ
        double = 2 * self.diffusivity
        determinant = s * s + (0.5 * mu + 0.25 * square) * excess
        return (
            double * (p + 2 * a * q + (a * a + b * b) * w),
            double * ((b + c) * q + (a * c + b * d) * w),
            double * (p + 2 * d * q + (c * c + d * d) * w),
            double**2 * determinant,
        )

    def _cloud(self, x: Array, y: Array, age: Array) -> Array:
        """The normal density (...) at (x, y) from the egg of what was released `age` ago."""
        xx, xy, yy, determinant = self._covariance(age)
        exponent = (yy * (x * x) - 2 * xy * (x * y) + xx * (y * y)) * (-0.5 / determinant)
        density = namespace(x).exp(exponent) * (determinant**-0.5 / (2 * math.pi))
        return density if self.dimensions == 2 else density * (4 * math.pi * self.diffusivity * age) ** -0.5

    def concentration(self, position: Array, time: Array = 0.0) -> Array:
        x, y = (position[..., axis] - self.egg_position[axis] for axis in (0, 1))
        age = moment(time, position) + self.age
        if not self._steady:
            return self.offset + self.strength * self._cloud(x, y, age)
        xp, shape = namespace(position), (-1, *(1,) * x.ndim)
        places, weights = (xp.reshape(as_array(each, position), shape) for each in _QUADRATURE)
        span = xp.log(age / self.core_time)
        ages = self.core_time * xp.exp(places * span)
        terms = self._cloud(x, y, ages) * (weights * ages)
        total = terms[0, ...]
        for i in range(1, NODES):  # in the same order however many cells there are
            total = total + terms[i, ...]
        return self.offset + self.strength * total * span

    @cached_property
    def _bounds(self) -> tuple[float, float]:
        """Bounds of |∇c| and |∂c/∂t|, from what was released at every age there is."""
        ages = np.geomspace(self.core_time if self._steady else self.age, 1e9 * self.age, 6000)
        xx, xy, yy, determinant = self._covariance(ages)
        along = 2 * self.diffusivity * ages  # Σ_zz
        narrowest = determinant / (0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy))
        peak = self.strength * determinant**-0.5 / (2 * math.pi)
        peak = peak if self.dimensions == 2 else peak * (2 * math.pi * along) ** -0.5
        steepest = peak / np.sqrt(narrowest * math.e)
        if self._steady:  # ages evenly spaced in their logarithm; the rest falls at least with its root
            total = np.trapezoid(steepest * ages, np.log(ages)) + 2 * steepest[-1] * ages[-1]
            return 1.01 * float(total), float(np.interp(self.age, ages, peak)) * 1.01
        # Ġ = G (r'Σ⁻¹Σ̇Σ⁻¹r − tr Σ⁻¹Σ̇)/2 is fastest at the egg, for Σ̇ = 2D e^{As}e^{A's} is positive
        fastest = peak * (self.diffusivity * (xx + yy) / determinant + (self.dimensions - 2) * 0.5 / ages)
        return 1.01 * float(steepest.max()), 1.01 * float(fastest.max())

    @property
    def max_gradient(self) -> float:
        """Bound of |∇c| at t >= 0."""
        return self._bounds[0]

    @property
    def max_rate(self) -> float:
        """Bound of |∂c/∂t| at t >= 0."""
        return self._bounds[1]


def _rest(z: Array, sign: float) -> Array:
    """(sinh(√z)/√z − 1)/z (...) of z (...) that all have a sign; with sin √−z where they are negative."""
    if sign == 0:
        return 1 / 6
    xp = namespace(z)
    near, is_near = xp.clip(z, -NEAR, NEAR), xp.abs(z) < NEAR
    far = xp.where(is_near, xp.full_like(z, math.copysign(NEAR, sign)), z)
    series = 1 / math.factorial(19)
    for n in range(17, 1, -2):
        series = series * near + 1 / math.factorial(n)
    root = xp.sqrt(xp.abs(far))
    sine = xp.sinh(root) if sign > 0 else xp.sin(root)
    return xp.where(is_near, series, (sine / root - 1) / far)
