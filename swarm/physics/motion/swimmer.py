"""The swimmer: what each of its actions does until the next decision.

Where all intervals are whole ticks, what a decision does is looked up in tables; else it is computed.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np

from swarm._support.arrays import as_array, join, kept_for, look_up, namespace
from swarm._support.compiler import unrolled
from swarm.physics.crowd.interactions import Interaction
from swarm.physics.crowd.spread import Spread
from swarm.physics.flows import Flow, StillWater
from swarm.physics.motion.arc import (
    Motion,
    Pose,
    along_arc,
    arc,
    arrival,
    arrival_on,
    centre_of_curvature,
    comes_within,
    components,
)
from swarm.physics.motion.clock import Clock, Ticks, frozen
from swarm.physics.motion.collocation import Collocation
from swarm.physics.motion.company import Company
from swarm.physics.motion.domain import within

Array = Any


class Tables(NamedTuple):
    """What decisions do, in one array library, precision and device."""

    rows: Array  # (3 + numbers · targets, columns of the clock): κ*, length [time], speed, motions
    ticks: Ticks
    weights: Array  # collocation weights; None in still water


class Interval(NamedTuple):
    """What every cell does until its next decision."""

    count: Array  # the clock's, after it
    motion: Any  # a `Motion` of the arc; in a flow to all the scheme's targets
    length: Array  # (..., cells) [time]
    speed: Array  # (..., cells) [length / time]
    curvature: Array  # (..., cells) κ*, as chosen
    swum: Any = None  # (..., cells) curvature of the arc [1 / length], see `arc_of`; None where nobody asks


class Way(NamedTuple):
    """What cells swim in an interval."""

    pose: Pose  # (..., cells, 2) at its end
    path: Array | None  # (places, ..., cells, 2) evenly spaced in time, without the end; None: the arc tells
    interval: Interval


@dataclass(frozen=True)
class Swimmer:
    """Curvature, speed and interval of each action."""

    curvatures: tuple[float, ...]  # [1 / length]
    speeds: tuple[float, ...]  # [length / time]
    clock: Clock
    flow: Flow
    spacing: float | None = None  # of the places on paths in a flow that are wanted too [time]
    interactions: tuple[Interaction, ...] = ()
    spread: Spread | None = None  # of speeds and curvatures over cells
    range: tuple[float, float] | None = None  # of curvatures that are actions themselves [1 / length]

    collocation: ClassVar[type[Collocation]] = Collocation

    @cached_property
    def company(self) -> Company | None:
        """How cells that influence each other swim together; None where they do not."""
        if not self.interactions:
            return None
        return Company.for_interval(self.flow, self.interactions, *self._largest(), self.spacing)

    def _largest(self) -> tuple[float, float, float]:
        """Largest turn [rad], length and duration of an interval."""
        wider = (1.0, 1.0) if self.spread is None else self.spread.largest
        lengths = [speed * time for speed, time in zip(self.speeds, self.clock.intervals, strict=True)]
        largest = max(map(abs, self.range or ()), default=0.0)
        turns = [max(bend, largest) * length for bend, length in zip(self._bends, lengths, strict=True)]
        return max(turns) * wider[0] * wider[1], max(lengths) * wider[0], max(self.clock.intervals)

    @property
    def _bends(self) -> tuple[float, ...]:
        return self.curvatures

    @cached_property
    def scheme(self) -> Collocation | None:
        """How intervals in the flow are integrated; None in still water."""
        if isinstance(self.flow, StillWater):
            return None
        return self.collocation.for_interval(self.flow, *self._largest(), self.spacing)

    def normal_curvature(self, curvature: Array) -> Array:
        """κ* = 2 (κ − κ̄)/|κ₁ − κ_m| (paper: normalisation of curvature)."""
        lowest, highest = self.curvatures[0], self.curvatures[-1]
        return (curvature - 0.5 * (lowest + highest)) * (2 / (highest - lowest))

    @cached_property
    def _tables(self) -> dict[Any, Tables]:
        return {}

    def tables(self, like: Array) -> Tables:
        """What decisions do, in the array library, dtype and device of `like`."""

        def made() -> Tables:
            action, length = self.clock.columns()
            curvature, speed = np.asarray(self.curvatures)[action], np.asarray(self.speeds)[action]
            motion = self._motion(self.arc_of(action, curvature), speed, length)
            parts = (part.reshape(-1, len(length)) for part in motion)
            rows = np.vstack([self.normal_curvature(curvature), length, speed, *parts])
            weights = None if self.scheme is None else as_array(self.scheme.weights, like)
            return Tables(as_array(rows, like), self.clock.ticks(like), weights)

        tables: Tables = kept_for(like, self._tables, made)
        return tables

    def chosen(self, action: Array, like: Array) -> Array:
        """Curvature (..., cells) of an action, of the kind of `like` [1 / length]."""
        if self.range is None:
            return look_up(as_array(np.asarray(self.curvatures), like), action)
        xp = namespace(like)
        return xp.clip(xp.astype(action, like.dtype, copy=False), *self.range)

    def next_interval(
        self,
        count: Array,
        action: Array,
        over: Array | None,
        kick: Array | None,
        like: Array,
        factors: Array = None,
    ) -> Interval:
        """The next interval of each cell, in the precision of `like`.

        `over` (..., cells) marks cells that stay where they are; None where time alone ends lives, and there
        is a common tick. `kick` perturbs the curvature; `factors` (..., cells, 2) multiply speed and
        curvature.
        """
        tabled = self.range is None and kick is None and factors is None
        if self.clock.has_common_tick:
            tables = self.tables(like)
            number = action if self.range is None else namespace(count).zeros_like(count)  # all are alike
            count, column = self.clock.next_column(count, number, tables.ticks, over)
            rows = look_up(tables.rows, column)
            curvature, length, speed = rows[0, ...], rows[1, ...], rows[2, ...]
            if tabled:
                return Interval(count, self._motion_of(rows[3:, ...]), length, speed, curvature)
        else:
            count, length = self.clock.next_length(count, action, over, like)
            speed = look_up(as_array(np.asarray(self.speeds), like), action)
        if self.range is not None or not self.clock.has_common_tick:
            curvature = self.normal_curvature(self.chosen(action, like))
        if factors is not None:
            speed = speed * factors[..., 0]
        motion = self._motion(self.arcs(action, kick, like, factors), speed, length)
        return Interval(count, motion, length, speed, curvature)

    def arcs(self, action: Array, kick: Array | None, like: Array, factors: Array = None) -> Any:
        """What is swum with an action, see `arc_of`: its curvature by the cell's own factor, and kicked."""
        curvature = self.chosen(action, like)
        if factors is not None:
            curvature = curvature * factors[..., 1]
        return self.arc_of(action, curvature if kick is None else curvature + kick)

    # --- the geometry of the plane, in place of which `helical` has that of space ---------------------------

    def arc_of(self, action: Array, curvature: Array) -> Any:
        """What tells the path of an action (..., cells) with this curvature: here the curvature."""
        return curvature

    def _motion(self, arcs: Any, speed: Array, length: Array) -> Any:
        return (arc if self.scheme is None else self.scheme.motions)(arcs, speed, length)

    def _motion_of(self, parts: Array) -> Any:
        """A motion of rows of the tables (4 · targets, ...)."""
        if self.scheme is not None:
            parts = namespace(parts).reshape(parts, (4, -1, *parts.shape[1:]))
        return Motion(parts[:2, ...], parts[2:, ...])

    def pose(self, position: Array, heading: Array) -> Pose:
        """The pose of cells at positions (..., cells, 2) with the heading (..., cells) [rad]."""
        xp = namespace(position)
        return Pose(join(*components(position)), join(xp.cos(heading), xp.sin(heading)))

    def orientation(self, heading: Array) -> Array:
        """The heading (..., cells) of which `pose` makes this one (..., cells, 2), in (−π, π] [rad]."""
        return namespace(heading).atan2(heading[..., 1], heading[..., 0])

    def direction(self, heading: Array) -> Array:
        """Unit vector (..., cells, 2) in which cells swim."""
        return heading

    def centre(self, pose: Pose, arcs: Any) -> Array:
        """Centre of the circle (..., cells, 2) that cells swim on."""
        return centre_of_curvature(pose, arcs)

    def arrival(self, before: Pose, way: Way, egg: tuple[Any, float]) -> Array:
        """The part (..., cells) of a way at which cells come to an egg (position, radius), else infinite."""
        if way.path is not None:
            return arrival_on(way.path, before.position, way.pose.position, *egg)
        interval = way.interval
        return arrival(before, interval.swum, interval.speed * interval.length, *egg)

    def comes_within(self, before: Pose, way: Way, egg: tuple[Any, float]) -> Array:
        """Whether cells (..., cells) come to an egg (position, radius) on their way."""
        if way.path is not None:
            return comes_within(way.path, way.pose.position, *egg)
        found = self.arrival(before, way, egg)
        return namespace(found).isfinite(found)

    def swim(self, pose: Pose, interval: Interval, time: Array = None) -> tuple[Pose, Array | None]:
        """The pose after an interval that begins at `time` (..., cells), which only a flow that changes
        needs, and in a flow the positions on the way to it, if the scheme has any.
        """
        scheme = self.scheme
        if scheme is None:
            return along_arc(pose, Motion(*unrolled(interval.motion, 1))), None
        weights = self.tables(pose.position).weights
        *motion, weights = unrolled((*interval.motion, weights), 0 if scheme.outputs else 2)
        given = interval.speed, interval.length, weights, within(self.flow, pose.position)
        return scheme.swim(pose, Motion(*motion), *given, time)

    def swim_back(self, pose: Pose, arcs: Any, speed: Array, length: Array) -> Pose:
        """The pose one interval before, in the flow at t = 0, by the same scheme: it must not depend on which
        cells there are.
        """
        if self.scheme is None:
            return self._along(pose, arcs, speed, -length)
        scheme = dataclasses.replace(self.scheme, outputs=0)
        motions = scheme.motions(arcs, speed, -length)
        weights, flow = as_array(scheme.weights, length), within(frozen(self.flow, 0.0), pose.position)
        return scheme.swim(pose, motions, speed, -length, weights, flow)[0]

    def places(self, pose: Pose, interval: Interval, end: Pose, parts: Sequence[float]) -> Array:
        """Positions (parts, ..., cells, 2) after parts of an interval: on the arc, from which the cell is led
        off evenly to where it ends; exact in still water. The interval must tell what is `swum`.
        """
        arcs = pose, interval.swum, interval.speed
        away = end.position - self._along(*arcs, interval.length).position
        return namespace(away).stack(
            [self._along(*arcs, part * interval.length).position + part * away for part in parts]
        )

    def _along(self, pose: Pose, arcs: Any, speed: Array, length: Array) -> Pose:
        """The pose after an interval in still water."""
        return along_arc(pose, arc(arcs, speed, length))
