"""Domains: fields and flows that hold somewhere only, and are not asked elsewhere."""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable, Sequence
from typing import Any

from swarm._support.arrays import join, namespace
from swarm.physics.flows import Flow
from swarm.physics.motion.arc import Pose, components
from swarm.physics.motion.collocation import velocity_and_spin, velocity_and_vorticity

Array = Any
Inside = Callable[[Array], Array]


class Within:
    """A flow that is asked in its domain only: for a place outside it answers as for where the cell comes
    from.
    """

    def __init__(self, flow: Flow, position: Array) -> None:
        """`position` (..., cells, 2) lies in the domain."""
        self._flow, self._origin = flow, components(position)
        if hasattr(flow, "at"):
            self.at = lambda time: Within(flow.at(time), position)

    def velocity_and_spin(self, x: Array, y: Array) -> tuple[Array, Array, Array]:
        """u_x, u_y and ω₀ (...) at the places (x, y)."""
        x, y = self._asked(x, y)
        return velocity_and_spin(self._flow, x, y)

    def velocity_and_vorticity(self, x: Array, y: Array, z: Array) -> tuple[Array, ...]:
        """The components (...) of velocity and vorticity at the places (x, y, z), in space."""
        return velocity_and_vorticity(self._flow, *self._asked(x, y, z))

    def _asked(self, *place: Array) -> tuple[Array, ...]:
        inside, where = self._flow.inside(join(*place)), namespace(place[0]).where  # type: ignore[attr-defined]
        return tuple(where(inside, *pair) for pair in zip(place, self._origin, strict=True))


def within(flow: Flow, position: Array) -> Any:
    """The flow as cells meet it that come from `position` (..., cells, 2)."""
    return flow if getattr(flow, "inside", None) is None else Within(flow, position)


def inside_all(domains: Sequence[Inside], position: Array) -> Array | None:
    """Whether positions (..., 2) lie in every domain, bool (...); None where there are none."""
    return functools.reduce(operator.and_, (each(position) for each in domains)) if domains else None


def kept(domains: Sequence[Inside], pose: Pose, before: Pose) -> tuple[Pose, Array | None]:
    """The pose, or where it lies outside a domain the one before, and where (...) that is so."""
    inside = inside_all(domains, pose.position)
    if inside is None:
        return pose, None
    return Pose(*(instead(inside, *pair) for pair in zip(pose, before, strict=True))), ~inside


def instead(good: Array, new: Array, old: Array) -> Array:
    """Vectors (..., k), `new` where they are `good` (...), else `old`."""
    pairs = zip(components(new), components(old), strict=True)
    return join(*(namespace(new).where(good, *pair) for pair in pairs))
