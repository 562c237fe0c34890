"""What a concentration field is, and those that have a name.

A field is any object with `concentration(position)` and `gradient_scale`. Further attributes are used when
they are there and not None: `max_gradient` (a bound of |∇c|, for the observation space), `egg_radius` and
`egg_position` (the egg, whose reach ends a life), `inside(position)` (where the field is known; a cell that
leaves is truncated) and `box` (the default start box).
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from swarm._support.arrays import Array
from swarm._support.registry import Registry

FIELDS = Registry("field", "chemoswarm.fields")


@runtime_checkable
class Field(Protocol):
    """What the world asks of a concentration field."""

    @property
    def gradient_scale(self) -> float:
        """Typical gradient c_k > 0 [concentration / length]; normalises perception and reward."""
        ...

    def concentration(self, position: Array) -> Array:
        """Concentration (...) at `position` (..., 2)."""
        ...
