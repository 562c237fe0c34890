"""Interactions: the extra velocity and spin that every living cell has from the poses of all.

An interaction is any object with `drift(position, heading, alive)`. Used when there: `speed_scale` [length
/ time] and `spin_scale` [rad / time], about the largest that a crowd causes, from which follows how finely
paths are integrated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from swarm._support.arrays import Array, join, namespace
from swarm._support.checks import Checked, check_name, check_number, optional, parameter
from swarm._support.registry import Registry

INTERACTIONS = Registry("interactions", "chemoswarm.interactions")
GEOMETRIES = ("film", "bulk")
SMALLEST = 1e-7  # core that none is taken as [length]
TAPER = 0.8  # of the cutoff: from there on an interaction fades smoothly to nothing


@runtime_checkable
class Interaction(Protocol):
    """What the world asks of an interaction."""

    def drift(self, position: Array, heading: Array, alive: Array) -> tuple[Array, Array]:
        """Velocity (..., cells, 2) [length / time] and spin (..., cells) [rad / time] of every cell.

        `position` (..., cells, 2), `heading` (..., cells, 2) unit vectors, `alive` (..., cells) bool: cells
        that have finished do not act, and what is said of them is ignored.
        """
        ...


class Pairwise(Checked):
    """An interaction that is the sum over pairs of cells."""

    @property
    def reach(self) -> float | None:
        """Distance beyond which a pair does not interact [length]; None: everywhere."""
        return None

    def between(self, x: Array, y: Array, ahead: Array, aside: Array) -> tuple[Array, Array, Array]:
        """u_x, u_y and spin (...) at the place (x, y) as seen from a cell that heads (ahead, aside)."""
        raise NotImplementedError

    def drift(self, position: Array, heading: Array, alive: Array) -> tuple[Array, Array]:
        """The sum over all pairs, see `Interaction`."""
        xp = namespace(position)
        x, y = position[..., 0], position[..., 1]
        makers = heading[..., None, :, 0], heading[..., None, :, 1]
        apart = x[..., :, None] - x[..., None, :], y[..., :, None] - y[..., None, :]
        acts = alive[..., None, :]
        sums = (
            xp.sum(xp.where(acts, each, xp.zeros_like(each)), axis=-1)
            for each in self.between(*apart, *makers)
        )
        u, v, spin = sums
        return join(u, v), spin


@INTERACTIONS.register("contact")
@dataclass(frozen=True)
class Contact(Pairwise):
    """Soft disks: nearer than d, two cells push each other apart with μK(d − r) along the line of centres.

    Head on, cells of speed v come to r = d − v/(μK). Exactly concentric cells do not push.
    """

    diameter: float = parameter(0.1, check_number, above=0.0)  # d [length]
    stiffness: float = parameter(100.0, check_number, above=0.0)  # μK [1 / time]

    @property
    def reach(self) -> float:
        """d."""
        return self.diameter

    def between(self, x: Array, y: Array, ahead: Array, aside: Array) -> tuple[Array, Array, Array]:
        """The push; nothing turns."""
        xp = namespace(x)
        distance = (x * x + y * y) ** 0.5
        far = distance >= self.diameter
        safe = xp.where(distance > 0, distance, xp.ones_like(distance))
        push = xp.where(far, xp.zeros_like(x), self.stiffness * (self.diameter - distance) / safe)
        return push * x, push * y, xp.zeros_like(x)


def film(x: Any, y: Any, ahead: Any, aside: Any, strength: Any, core: Any) -> tuple[Any, Any, Any]:
    """u_x, u_y and spin at (x, y) from a dipole that heads (ahead, aside), in a film, where r² cos 2θ is
    along² − across². Numbers or arrays; there is no literal, which would be of double precision.
    """
    along, across = ahead * x + aside * y, ahead * y - aside * x
    soft = x * x + y * y + core
    scale = strength / (soft * soft)
    radial, spin = scale * (along * along - across * across), scale * along * across
    return radial * x, radial * y, spin + spin


def bulk(x: Any, y: Any, ahead: Any, aside: Any, strength: Any, core: Any) -> tuple[Any, Any, Any]:
    """As `film`, in bulk fluid: r² (3cos²θ − 1) is 2 along² − across²."""
    along, across = ahead * x + aside * y, ahead * y - aside * x
    soft = x * x + y * y + core
    scale = strength / (soft * soft * soft**0.5)
    radial, spin = scale * (2 * along * along - across * across), 3 * scale * along * across
    return radial * x, radial * y, spin


@INTERACTIONS.register("dipole")
@dataclass(frozen=True)
class Dipole(Pairwise):
    """The flow of a force dipole, p > 0 a pusher, at the angle θ from the heading of its cell.

    In a thin film u = p cos 2θ r̂/(4πηr) with the spin p sin 2θ/(4πηr²); in bulk fluid, in the cells' plane,
    u = p (3cos²θ − 1) r̂/(8πηr²) with the spin 3p sin 2θ/(16πηr³). Within the core ε they are smooth: powers
    of r are those of √(r² + ε²). From 0.8 of the cutoff on it fades to nothing at the cutoff.
    """

    strength: float = parameter(0.1, check_number)  # p/η, film [length² / time], bulk [length³ / time]
    core: float = parameter(0.25, check_number, at_least=0.0)  # ε, about half a flagellum [length]
    geometry: str = parameter("film", check_name, known=GEOMETRIES)
    cutoff: float | None = parameter(None, optional(check_number), above=0.0)  # [length]

    @property
    def reach(self) -> float | None:
        """The cutoff."""
        return self.cutoff

    @property
    def speed_scale(self) -> float:
        """Bound of |u| beside one dipole [length / time]; infinite where the core is 0."""
        if self.core == 0:
            return math.inf
        film = 3 * math.sqrt(3) / (64 * math.pi * self.core)  # at r = √3 ε
        bulk = 1.5**1.5 / 2.5**2.5 / (4 * math.pi * self.core**2)  # at r = √(3/2) ε
        return abs(self.strength) * (film if self.geometry == "film" else bulk)

    @property
    def spin_scale(self) -> float:
        """Bound of the spin beside one dipole [rad / time]; infinite where the core is 0."""
        if self.core == 0:
            return math.inf
        film = 1 / (16 * math.pi * self.core**2)  # at r = ε
        bulk = 3 / (16 * math.pi) * (2 / 3) / (5 / 3) ** 2.5 / self.core**3  # at r = √(2/3) ε
        return abs(self.strength) * (film if self.geometry == "film" else bulk)

    @property
    def law(self) -> tuple[Callable[..., Any], float, float]:
        """`film` or `bulk`, with the strength over 4πη or 8πη and ε² that it takes."""
        core = max(self.core, SMALLEST) ** 2  # a cell does not move itself
        if self.geometry == "film":
            return film, self.strength / (4 * math.pi), core
        return bulk, self.strength / (8 * math.pi), core

    def between(self, x: Array, y: Array, ahead: Array, aside: Array) -> tuple[Array, Array, Array]:
        """The dipole's flow and half its vorticity."""
        law, strength, core = self.law
        found: tuple[Array, Array, Array] = law(x, y, ahead, aside, strength, core)
        if self.cutoff is None:
            return found
        fading = self._fading(x * x + y * y)
        return found[0] * fading, found[1] * fading, found[2] * fading

    def _fading(self, squared: Array) -> Array:
        """1 up to `TAPER` of the cutoff, smoothly 0 at it."""
        assert self.cutoff is not None
        xp = namespace(squared)
        left = xp.clip((1 - squared / self.cutoff**2) / (1 - TAPER**2), 0.0, 1.0)
        return left * left * (3 - 2 * left)


def check_interactions(name: str, value: Any) -> tuple[Interaction, ...]:
    """The interactions that `value` is or describes, one or several; raises TypeError or ValueError unless
    each has a `drift`.
    """
    alone = isinstance(value, (str, Mapping)) or not isinstance(value, Sequence)
    made = tuple(INTERACTIONS.make(each) for each in ([value] if alone else value))
    for each in made:
        if isinstance(each, type) or not isinstance(each, Interaction):
            known = ", ".join(sorted(INTERACTIONS))
            raise TypeError(
                f"{name} must be objects with drift(position, heading, alive), or of {known}, got {each!r}"
            )
    return made
