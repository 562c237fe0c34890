"""The swimmer in space: a helix for each action, exactly in still water, in a flow by collocation.

In a flow a cell moves as ṙ = v t + u(r), and its frame turns by v (τ t + κ b) + ω(r)/2, ω the vorticity.
Torsions belong to actions: perturbations change the curvature alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from swarm._support.arrays import as_array, join, look_up, namespace, polynomial, stacked
from swarm.physics.flows import Flow
from swarm.physics.motion.arc import Pose, components
from swarm.physics.motion.collocation import Collocation, integral, velocity_and_vorticity
from swarm.physics.motion.domain import within
from swarm.physics.motion.helix import (
    CELL,
    Parts,
    along_helix,
    closest_approach,
    cross,
    dot,
    frame,
    helix,
    led_off,
    product_parts,
    rotated_parts,
    tangent,
    tangent_parts,
    unit_quaternion,
)
from swarm.physics.motion.swimmer import Interval, Swimmer, Way

Array = Any


HALF_COSINE = [(-1) ** k / math.factorial(2 * k) for k in range(9)]  # cos h in powers of h²
HALF_SINE = [(-1) ** k / (2 * math.factorial(2 * k + 1)) for k in range(9)]  # sin(h)/2h
BENDING = [1 / 12, 1 / 720, 1 / 30240, 1 / 1209600, 1 / 47900160]  # (1 − h cot h)/4h² in powers of 4h²


@dataclass(frozen=True)
class HelicalCollocation(Collocation):
    """Picard sweeps on the deviation from the exact helix, which is exact without flow.

    The frame is p q with the helix's q and p = exp(θ), for which θ' = ω/2 − θ × ω/4 + … (the inverse of the
    exponential's differential: Hairer, Lubich & Wanner, Geometric Numerical Integration, IV.7); the place
    deviates by d' = v (p t p* − t) + u. Both are integrated as in the plane. In a flow whose vorticity has
    one direction everywhere θ is exact but for quadrature.
    """

    largest_turn = 1.0

    def motions(self, arcs: tuple[Array, Array], speed: Array, duration: Array) -> tuple[Array, ...]:
        """Screws (7 of (targets, ...)) from the start of a substep to each target."""
        length = speed * duration / self.substeps
        by_target = [helix(*arcs, float(target) * length) for target in self.targets]
        return tuple(namespace(length).stack(parts) for parts in zip(*by_target, strict=True))

    def _substep(
        self,
        pose: Pose,
        motions: Sequence[Array],
        speed: Array,
        table: Array,
        flow: Flow,
        times: list[Array] | None,
    ) -> tuple[Pose, Array | None]:
        n, start = self.nodes, components(pose.heading)
        moved = rotated_parts(start, motions[:3])
        places = [by + place for by, place in zip(moved, components(pose.position), strict=True)]
        frames = product_parts(start, motions[3:])  # (targets, ...)
        along = [part * speed for part in tangent_parts([part[:n, ...] for part in frames])]
        place, turn = [part[:n, ...] for part in places], None
        when = None if times is None else stacked(place[0], times)
        for sweep in range(self.sweeps):
            last = sweep == self.sweeps - 1
            *current, w_x, w_y, w_z = velocity_and_vorticity(flow, place[0], place[1], place[2], when)
            rates = _turning(turn, (0.5 * w_x, 0.5 * w_y, 0.5 * w_z))
            turn = [integral(table if last else table[:n, ...], rate) for rate in rates]
            led = quaternion_of(turn)
            off = led_off([part[:n, ...] for part in led], along)
            wanted = slice(n, None) if last else slice(n)
            place = [
                integral(table[wanted, ...], swum + by) + at[wanted, ...]
                for swum, by, at in zip(off, current, places, strict=True)
            ]
        end = product_parts([part[-1, ...] for part in led], [part[-1, ...] for part in frames])
        path = join(*(part[:-1, ...] for part in place)) if self.outputs else None
        return Pose(join(*(part[-1, ...] for part in place)), unit_quaternion(end)), path


def _turning(turn: Parts | None, spin: Parts) -> Parts:
    """Rates of a rotation vector θ, None for 0, where the frame turns by `spin` (half the vorticity)."""
    if turn is None:
        return spin
    once = cross(turn, spin)
    twice, bending = cross(turn, once), polynomial(BENDING, dot(turn, turn))
    return [s - 0.5 * o + bending * t for s, o, t in zip(spin, once, twice, strict=True)]


def quaternion_of(turn: Parts) -> tuple[Array, ...]:
    """Components of the quaternion of a rotation vector of a few rad at most."""
    square = 0.25 * dot(turn, turn)
    half = polynomial(HALF_SINE, square)
    return polynomial(HALF_COSINE, square), *(half * part for part in turn)


@dataclass(frozen=True)
class HelicalSwimmer(Swimmer):
    """Curvature, torsion, speed and interval of each action.

    What is swum is told by curvature and torsion (..., cells) [1 / length], a motion by the seven components
    of its screw.
    """

    torsions: tuple[float, ...] = ()  # [1 / length]

    collocation = HelicalCollocation

    @property
    def _bends(self) -> tuple[float, ...]:
        return tuple(map(math.hypot, self.curvatures, self.torsions))

    def arc_of(self, action: Array, curvature: Array) -> tuple[Array, Array]:
        """Curvature and torsion (..., cells) of an action with this curvature."""
        return curvature, look_up(as_array(np.asarray(self.torsions), curvature), action)

    def _motion(self, arcs: tuple[Array, Array], speed: Array, length: Array) -> Sequence[Array]:
        if self.scheme is None:
            return helix(*arcs, speed * length)
        return self.scheme.motions(arcs, speed, length)

    def _motion_of(self, parts: Array) -> Sequence[Array]:
        if self.scheme is not None:
            parts = namespace(parts).reshape(parts, (7, -1, *parts.shape[1:]))
        return tuple(parts[i, ...] for i in range(7))

    def swim(self, pose: Pose, interval: Interval, time: Array = None) -> tuple[Pose, Array | None]:
        """As in the plane."""
        if self.scheme is None:
            return along_helix(pose, interval.motion), None
        weights, flow = self.tables(pose.position).weights, within(self.flow, pose.position)
        return self.scheme.swim(pose, interval.motion, interval.speed, interval.length, weights, flow, time)

    def _along(self, pose: Pose, arcs: tuple[Array, Array], speed: Array, length: Array) -> Pose:
        return along_helix(pose, helix(*arcs, speed * length))

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

    def comes_within(self, before: Pose, way: Way, egg: tuple[Any, float]) -> Array:
        """As in the plane."""
        if way.path is not None:
            return super().comes_within(before, way, egg)
        (centre, radius), interval = egg, way.interval
        (curvature, torsion), length = interval.swum, interval.speed * interval.length
        cells = max(1, math.ceil(self._largest()[0] / CELL))
        return closest_approach(before, curvature, torsion, length, centre, cells) <= radius
