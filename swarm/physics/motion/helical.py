"""The swimmer in space: a helix for each action, by its curvature and torsion.

Torsions belong to actions: perturbations change the curvature alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from swarm._support.arrays import as_array, join, look_up, namespace
from swarm.physics.motion.arc import Pose, comes_within, components
from swarm.physics.motion.helix import CELL, along, closest_approach, frame, screw, tangent
from swarm.physics.motion.swimmer import Interval, Swimmer

Array = Any


@dataclass(frozen=True)
class HelicalSwimmer(Swimmer):
    """Curvature, torsion, speed and interval of each action.

    What is swum is told by curvature and torsion (..., cells) [1 / length], a motion by the seven components
    of its screw.
    """

    torsions: tuple[float, ...] = ()  # [1 / length]

    def _largest(self) -> tuple[float, float, float]:
        lengths = [speed * time for speed, time in zip(self.speeds, self.clock.intervals, strict=True)]
        bends = map(math.hypot, self.curvatures, self.torsions)
        turns = [bend * length for bend, length in zip(bends, lengths, strict=True)]
        return max(turns), max(lengths), max(self.clock.intervals)

    def arc_of(self, action: Array, curvature: Array) -> tuple[Array, Array]:
        """Curvature and torsion (..., cells) of an action with this curvature."""
        if isinstance(action, np.ndarray) and isinstance(curvature, np.ndarray):
            return curvature, np.asarray(self.torsions, curvature.dtype)[action]
        return curvature, look_up(as_array(np.asarray(self.torsions), curvature), action)

    def _motion(self, arcs: tuple[Array, Array], speed: Array, length: Array) -> Sequence[Array]:
        return screw(*arcs, speed * length)

    def _motion_of(self, parts: Array) -> Sequence[Array]:
        return tuple(parts[i, ...] for i in range(7))

    def swim(self, pose: Pose, interval: Interval, time: Array = None) -> tuple[Pose, Array | None]:
        return along(pose, interval.motion), None

    def _along(self, pose: Pose, arcs: tuple[Array, Array], speed: Array, length: Array) -> Pose:
        return along(pose, screw(*arcs, speed * length))

    def pose(self, position: Array, heading: Array) -> Pose:
        """The pose of cells at positions (..., cells, 3) and frames (..., cells, 4), scaled to length 1."""
        norm = namespace(heading).sum(heading * heading, axis=-1) ** 0.5
        return Pose(join(*components(position)), join(*(part / norm for part in components(heading))))

    def orientation(self, heading: Array) -> Array:
        """The frame (..., cells, 4) itself."""
        return heading

    def direction(self, heading: Array) -> Array:
        """The tangent (..., cells, 3)."""
        return tangent(heading)

    def centre(self, pose: Pose, arcs: tuple[Array, Array]) -> Array:
        """The nearest point (..., cells, 3) of the axis of the helix that is swum, r + κ n/w²; NaN where it
        is straight.
        """
        curvature, torsion = arcs
        xp = namespace(curvature)
        square = curvature * curvature + torsion * torsion
        turning = curvature != 0
        radius = curvature / xp.where(turning, square, xp.full_like(square, math.nan))
        return pose.position + frame(pose.heading)[1] * radius[..., None]

    def comes_within(
        self, before: Pose, interval: Interval, end: Pose, path: Array | None, egg: tuple[Any, float]
    ) -> Array:
        """Whether cells (..., cells) come to an egg (position, radius) on their way to a pose."""
        if path is not None:
            return comes_within(path, end.position, *egg)
        centre, radius = egg
        length = interval.speed * interval.length
        cells = max(1, math.ceil(self._largest()[0] / CELL))
        curvature, torsion = interval.swum
        return closest_approach(before, curvature, torsion, length, centre, cells) <= radius
