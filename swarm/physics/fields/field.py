"""What a concentration field is, and those that have a name.

A field is any object with `concentration(position)` and `gradient_scale`. Further attributes are used when
they are there and not None: `max_gradient` (a bound of |∇c|, for the observation space), `egg_radius` and
`egg_position` (the egg, whose reach ends a life), `inside(position)` (where the field is known; a cell that
leaves is truncated) and `box` (the default start box). One that changes has `at(time)`, which returns it
frozen at a time, and may have `max_rate`, a bound of |∂c/∂t|; scales, bounds and egg never change. One that
holds in the plane only has `coordinates` = 2, one that holds in space only 3.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, Protocol, runtime_checkable

from swarm._support.arrays import Array
from swarm._support.registry import Registry

FIELDS = Registry("field", "chemoswarm.fields")
OFF = 2.0 * (1 + 1e-3)  # times that a scale may be too large or too small


@runtime_checkable
class Field(Protocol):
    """What the world asks of a concentration field."""

    @property
    def gradient_scale(self) -> float:
        """Typical gradient c_k > 0 [concentration / length]; normalises perception and reward."""
        ...

    def concentration(self, position: Array) -> Array:
        """Concentration (...) at `position` (..., 2), in space (..., 3)."""
        ...


def distance_squared(position: Array, centre: Sequence[float]) -> Array:
    """Square (...) of the distance of positions from a place; one of two numbers lies on z = 0 in space."""
    x, y = position[..., 0] - centre[0], position[..., 1] - centre[1]
    square = x * x + y * y
    if position.shape[-1] == 2:
        return square
    z = position[..., 2] - (0.0 if len(centre) == 2 else centre[2])
    return square + z * z


def warn_of_scale(given: float, typical: float, where: str) -> None:
    """Warns where a `gradient_scale` is off by more than `OFF` from the typical gradient."""
    if not typical / OFF <= given <= typical * OFF:
        rule = "gradient_scale normalises what cells sense, and should be about the root mean square of |∇c|"
        warnings.warn(f"{rule}: {typical:.3g} {where}, got {given:g}", stacklevel=2)


@dataclass(frozen=True, eq=False)
class Frozen:
    """A field or flow as it is at one time, a number or an array that broadcasts with `position[..., 0]`;
    everything else is its own. Nothing is checked, so that it may be made of traced numbers."""

    part: Any
    time: Any

    def __getattr__(self, name: str) -> Any:
        if name == "at" or name.startswith("_"):
            raise AttributeError(name)
        return getattr(self.part, name)


class FrozenField(Frozen):
    """A field as it is at one time, see `Frozen`; its `concentration(position, time)` takes the time."""

    gradient_scale = property(attrgetter("part.gradient_scale"))

    def concentration(self, position: Array) -> Array:
        return self.part.concentration(position, self.time)
