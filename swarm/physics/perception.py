"""Perception: what a cell senses, the memory of its records, and their normalisation.

A record holds what a cell knows of one moment, in the paper's dimensionless units but for the mean of the
concentrations, which changes with every decision. Memory is (..., cells, N_T, features), newest record first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Protocol, runtime_checkable

import numpy as np

from swarm._support.arrays import as_array, join, namespace
from swarm._support.checks import Checked, check_count, check_number, check_rule, parameter
from swarm._support.registry import Registry
from swarm.physics.motion.arc import components, turned
from swarm.physics.motion.collocation import velocity_and_spin, velocity_and_vorticity

Array = Any
World = Any  # a `swarm.World`, which has a sensor

LARGEST = float(np.finfo(np.float32).max)
SENSORS = Registry("sensor", "chemoswarm.sensors")


class Situation(NamedTuple):
    """Where cells are when they take a record, and what the world finds there for them."""

    position: Array  # (..., cells, 2) [length]; in space (..., cells, 3)
    heading: Array  # (..., cells, 2) unit vector; in space frames (..., cells, 4)
    concentration: Array  # (..., cells) with its noise [concentration]
    curvature: Array  # (..., cells) κ*, chosen for the interval that ends here
    finished: Array  # (..., cells) bool: the life was over before
    factors: Array = None  # (..., cells, 2) of the cell's own speed and curvature; None where all are alike
    alone: bool = False  # in the past before t = 0, which every cell swam by itself


@runtime_checkable
class Sensor(Protocol):
    """What the world asks of a sensor.

    Used when there: `needs_time = True`; `senses_others = True`, which makes cells decide at the same
    moments; `coordinates`, 2 or 3, where it holds in the plane or in space only; and `check(world)`, which
    raises ValueError where the sensor does not fit a world.
    """

    @property
    def name(self) -> str:
        """What policies' cards call it."""
        ...

    @property
    def names(self) -> Sequence[str]:
        """Of the numbers in a record; first those of `Memory`, which strategies and rewards read."""
        ...

    def record(self, world: World, time: Array, situation: Situation) -> Sequence[Array]:
        """The numbers (..., cells) of a record, as many as `names`.

        `time` (..., cells) is the cells' own; None without `needs_time`, which spares its computation.
        """
        ...

    def bounds(self, world: World) -> Sequence[float]:
        """Bounds b of what is observed of each number: −b <= observation <= b; float32's largest where there
        is none."""
        ...


@SENSORS.register("memory")
@dataclass(frozen=True)
class Memory:
    """Concentration and curvature: c κ̄/c_k, observed as its deviation from the mean of the memory, and κ*."""

    name = "memory"
    names: ClassVar[tuple[str, ...]] = ("concentration", "curvature")

    def record(self, world: World, time: Array, situation: Situation) -> Sequence[Array]:
        """c κ̄/c_k and κ*."""
        return situation.concentration * world.record_scale, situation.curvature

    def bounds(self, world: World) -> Sequence[float]:
        """A record differs from the mean by less than between the first and the last, by path and time."""
        curvature = 1.001 * max(map(abs, map(world.normal_curvature, world.curvature_bounds)))
        gradient = getattr(world.field, "max_gradient", None)
        current = getattr(world.flow, "max_speed", None)
        rate = getattr(world.field, "max_rate", None) if hasattr(world.field, "at") else 0.0
        bounded = not world.interactions and world.medium is None and world.binding_rate is None
        if None in (gradient, current, rate) or world.concentration_noise > 0 or not bounded:
            return LARGEST, curvature
        pairs = zip(world.action_speeds, world.intervals, strict=True)
        wider = 1.0 if world.spread is None else world.spread.largest[0]
        largest = max(((speed * wider + current) * gradient + rate) * interval for speed, interval in pairs)
        return 1.001 * (world.n_records - 1) * largest * world.record_scale + 1e-3, curvature


@SENSORS.register("memory_with_flow")
@dataclass(frozen=True)
class MemoryWithFlow(Memory):
    """Concentration, curvature and the flow: u_x/u₀, u_y/u₀ and ω₀ by its scale besides."""

    name = "memory_with_flow"
    names: ClassVar[tuple[str, ...]] = (*Memory.names, "flow_x", "flow_y", "spin")
    coordinates = 2

    def check(self, world: World) -> None:
        """Raises ValueError where the flow has nothing to normalise by."""
        speed, spin = world.flow.speed_scale, world.flow.spin_scale
        rule = "sense_flow must go with a flow with speed_scale and spin_scale above 0 to normalise by"
        check_rule(speed > 0 and spin > 0, rule, f"speed_scale {speed:g} and spin_scale {spin:g}")

    def record(self, world: World, time: Array, situation: Situation) -> Sequence[Array]:
        """c κ̄/c_k, κ*, u_x*, u_y*, ω₀*."""
        flow = world.flow
        place_x, place_y = components(situation.position)
        x, y, spin = velocity_and_spin(flow, place_x, place_y, time)
        sensed = x / flow.speed_scale, y / flow.speed_scale, spin / flow.spin_scale
        return *super().record(world, time, situation), *sensed

    def bounds(self, world: World) -> Sequence[float]:
        """The flow's own bounds."""
        flow = world.flow
        speed, spin = (
            LARGEST if bound is None else 1.001 * bound / scale + 1e-6
            for bound, scale in (
                (getattr(flow, "max_speed", None), flow.speed_scale),
                (getattr(flow, "max_spin", None), flow.spin_scale),
            )
        )
        axes = world.dimensions
        return *super().bounds(world), *axes * [speed], *(2 * axes - 3) * [spin]


@SENSORS.register("memory_with_flow_in_space")
@dataclass(frozen=True)
class MemoryWithFlowInSpace(MemoryWithFlow):
    """Concentration, curvature and the flow in space: u by u₀, and half the vorticity by its scale."""

    name = "memory_with_flow_in_space"
    names = (*Memory.names, "flow_x", "flow_y", "flow_z", "spin_x", "spin_y", "spin_z")
    coordinates = 3

    def record(self, world: World, time: Array, situation: Situation) -> Sequence[Array]:
        """c κ̄/c_k, κ*, u_x*, u_y*, u_z*, ω_x/2*, ω_y/2*, ω_z/2*."""
        x, y, z = components(situation.position)
        found = velocity_and_vorticity(world.flow, x, y, z, time)
        scales = 3 * [1 / world.flow.speed_scale] + 3 * [0.5 / world.flow.spin_scale]
        sensed = (each * scale for each, scale in zip(found, scales, strict=True))
        return *Memory.record(self, world, time, situation), *sensed


@SENSORS.register("memory_with_traits")
@dataclass(frozen=True)
class MemoryWithTraits(Memory):
    """Concentration, curvature and what the cell itself is: its factors of speed and curvature less 1."""

    name = "memory_with_traits"
    names: ClassVar[tuple[str, ...]] = (*Memory.names, "own_speed", "own_curvature")

    def check(self, world: World) -> None:
        """Raises ValueError where cells are all alike."""
        rule = "sensor memory_with_traits must go with a world that has a spread"
        check_rule(world.spread is not None, rule, None)

    def record(self, world: World, time: Array, situation: Situation) -> Sequence[Array]:
        """c κ̄/c_k, κ*, and both factors less 1."""
        factors = situation.factors
        return *super().record(world, time, situation), factors[..., 0] - 1, factors[..., 1] - 1

    def bounds(self, world: World) -> Sequence[float]:
        """Three standard deviations, at which the spread ends."""
        return *super().bounds(world), *(1.001 * (most - 1) + 1e-6 for most in world.spread.largest)


@SENSORS.register("memory_with_neighbours")
@dataclass(frozen=True)
class MemoryWithNeighbours(Checked):
    """Concentration, curvature and the `k` nearest living others within a `range`, the nearest first.

    Each is seen in the cell's own frame by four numbers: the direction to it, ahead and to the left, and its
    heading, along and across the own. All are scaled by its closeness 1 − r/range, so that who comes into
    sight appears gradually; where there are fewer than k, and in the past before t = 0, they are 0. Of a cell
    in the same place there is a heading but no direction. In a medium that wraps, the nearest image counts.
    All pairs of cells are looked at.
    """

    k: int = parameter(3, check_count)
    range: float = parameter(1.0, check_number, above=0.0)  # [length]

    name: ClassVar[str] = "memory_with_neighbours"
    senses_others: ClassVar[bool] = True
    coordinates: ClassVar[int] = 2

    @property
    def names(self) -> Sequence[str]:
        """neighbour_1_ahead, _left, _along, _across, neighbour_2_ahead, …, after those of `Memory`."""
        parts = ("ahead", "left", "along", "across")
        return *Memory.names, *(f"neighbour_{i + 1}_{part}" for i in range(self.k) for part in parts)

    def record(self, world: World, time: Array, situation: Situation) -> Sequence[Array]:
        """c κ̄/c_k, κ*, and four numbers of each neighbour."""
        plain = Memory().record(world, time, situation)
        if situation.alone:
            nothing = namespace(situation.position).zeros_like(situation.position[..., 0])
            return *plain, *(4 * self.k * [nothing])
        medium = world.medium
        size = medium.mesh.size if medium is not None and medium.leaving == "wrap" else None
        return *plain, *self._neighbours(situation, size)

    def bounds(self, world: World) -> Sequence[float]:
        """1 for all numbers of neighbours."""
        return *Memory().bounds(world), *(4 * self.k * [1.001])

    def _neighbours(self, situation: Situation, size: tuple[float, float] | None) -> list[Array]:
        xp = namespace(situation.position)
        apart = situation.position[..., None, :, :] - situation.position[..., :, None, :]  # maker − seer
        x, y = apart[..., 0], apart[..., 1]
        if size is not None:
            x, y = x - size[0] * xp.round(x / size[0]), y - size[1] * xp.round(y / size[1])
        row = as_array(np.arange(x.shape[-1]), x, dtype=xp.int64)
        others = (row[:, None] != row) & ~situation.finished[..., None, :]
        squared = x * x + y * y
        nowhere = xp.full_like(squared, math.inf)
        squared = xp.where(others & (squared < self.range**2), squared, nowhere)
        ahead, aside = components(situation.heading)
        frame = ahead, -aside  # by which the lab is turned into the cell's frame
        makers = [xp.broadcast_to(each[..., None, :], x.shape) for each in (ahead, aside)]
        seen: list[Array] = []
        for _ in range(self.k):
            nearest = xp.argmin(squared, axis=-1)[..., None]
            far, *found = (
                xp.take_along_axis(each, nearest, axis=-1)[..., 0] for each in (squared, x, y, *makers)
            )
            close = xp.isfinite(far)
            distance = xp.sqrt(xp.where(close, far, xp.zeros_like(far)))
            closeness = xp.where(close, 1 - distance / self.range, xp.zeros_like(far))
            per_length = closeness / xp.where(distance > 0, distance, xp.ones_like(distance))
            seen += turned((found[0] * per_length, found[1] * per_length), *frame)
            seen += turned((found[2] * closeness, found[3] * closeness), *frame)
            squared = xp.where(row == nearest, nowhere, squared)
        return seen


def described(sensor: Sensor) -> str | dict[str, Any]:
    """A sensor as policies' cards hold it: its name, or type and parameters, of which a world makes it."""
    told = SENSORS.describe(sensor) or {}
    return told if len(told) > 1 else sensor.name


def check_sensor(name: str, value: Any) -> Sensor:
    """The sensor that `value` is or describes; raises TypeError or ValueError unless it can take records."""
    sensor = SENSORS.make(value)
    if isinstance(sensor, type) or not isinstance(sensor, Sensor):
        rule = f"{name} must be an object with name, names, record(world, time, situation) and bounds(world)"
        raise TypeError(f"{rule}, or one of {', '.join(sorted(SENSORS))}, got {sensor!r}")
    names = sensor.names
    known = tuple(names[:2]) == Memory.names and len(set(names)) == len(names)
    rule = f"{name}.names must be {', '.join(Memory.names)} and further ones, each once"
    check_rule(known, rule, ", ".join(map(str, names)))
    return sensor


def memory_of(records: list[Sequence[Array]]) -> Array:
    """Memory (..., N_T, features) of records, newest first."""
    memory = join(*(number for numbers in records for number in numbers))
    return namespace(memory).reshape(memory, (*memory.shape[:-1], len(records), len(records[0])))


def renew(memory: Array, newest: Sequence[Array]) -> tuple[Array, Array]:
    """Memory with a record more and the oldest dropped, and the observation of it."""
    features = len(newest)
    if isinstance(memory, np.ndarray):
        older = memory.reshape(*memory.shape[:-2], -1)[..., :-features]
        numbers = np.concatenate([*(number[..., None] for number in newest), older], axis=-1)
        return numbers.reshape(memory.shape), _observed(numbers, features)
    columns = (*newest, *_columns(memory)[:-features])
    return namespace(memory).reshape(join(*columns), memory.shape), _observed_by_column(columns, features)


def observe(memory: Array) -> Array:
    """Observation (..., N_T · features) in float32: the memory with concentrations measured from their mean.

    c*, κ* (u_x*, u_y*, ω₀*) of the newest record, then of the next older, … (paper: normalisation of the
    input vector).
    """
    if isinstance(memory, np.ndarray):
        return _observed(memory.reshape(*memory.shape[:-2], -1), memory.shape[-1])
    return _observed_by_column(_columns(memory), memory.shape[-1])


def _observed(numbers: np.ndarray, features: int) -> np.ndarray:
    concentrations = numbers[..., ::features]
    n_records = concentrations.shape[-1]
    total = concentrations[..., 0]
    for i in range(1, n_records):  # much quicker than a sum over a short axis
        total = total + concentrations[..., i]
    seen = numbers.copy()  # only differences need fit into float32
    seen[..., ::features] -= (total / n_records)[..., None]
    return seen.astype(np.float32, copy=False)


# Other arrays are worked on number by number, see `join`, and cannot be written to.


def _columns(memory: Array) -> tuple[Array, ...]:
    """The numbers (...) of all records, newest first."""
    xp = namespace(memory)
    return xp.unstack(xp.reshape(memory, (*memory.shape[:-2], -1)), axis=-1)


def _observed_by_column(columns: Sequence[Array], features: int) -> Array:
    concentrations = columns[::features]
    mean = sum(concentrations[1:], start=concentrations[0]) / len(concentrations)
    seen = [column if i % features else column - mean for i, column in enumerate(columns)]
    observation = join(*seen)
    xp = namespace(observation)
    return xp.astype(observation, xp.float32, copy=False)
