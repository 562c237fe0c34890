"""Continuous steering: cells whose curvature follows a response between decisions, too. In NumPy."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from swarm._support import streams
from swarm._support.arrays import join
from swarm.physics.crowd.binding import bindings
from swarm.physics.motion.arc import Pose
from swarm.physics.motion.clock import frozen
from swarm.physics.motion.collocation import velocity_and_spin
from swarm.physics.motion.domain import inside_all, instead, within
from swarm.physics.motion.steered import advanced
from swarm.physics.motion.swimmer import Interval, Way
from swarm.physics.world import State, World
from swarm.physics.world.state import NOISE_CHANNELS

Array = Any
Steering = Any  # has gain_at, levels, curvature, rates and steps, as `AdaptiveSteering`

X, Y, HEADING, OUTPUT, SENSITIVITY, TURNED = range(6)  # variables, the last is the integral of the curvature


def check_alone(world: World) -> None:
    """Raises ValueError unless cells of the world can steer continuously."""
    if world.dimensions != 2:
        raise ValueError(f"continuous steering must be in the plane, got torsions = {world.torsions}")
    speeds, intervals = set(world.action_speeds), set(world.intervals)
    if world.interactions or world.medium is not None or len(speeds) > 1 or len(intervals) > 1:
        raise ValueError(
            "continuous steering must be in a world of one speed, without interactions and medium, got "
            f"speeds {world.action_speeds}, {len(world.interactions)} interactions and medium={world.medium}"
        )


class _Cells(NamedTuple):
    """What stays as it is during an interval, and what differs from step to step."""

    steering: Steering
    world: World
    interval: Interval
    factor: Array  # of the curvature (..., cells)
    kick: Array  # of the curvature (..., cells) [1 / length]
    gain: Array = None  # (..., cells) [1 / length]
    origin: Array = None  # (..., cells, 2) where the step began, inside the domain
    time: Array = None  # (..., cells) when it began
    noise: Array = 0.0  # (..., cells) of the signal [length]

    def rates(self, values: Array, part: Array, region: Array) -> Array:
        """Of all variables (nodes, 6, ..., cells) [1 / time]."""
        world, speed = self.world, self.interval.speed
        place_x, place_y, heading, output, sensitivity, _ = np.moveaxis(values, 1, 0)
        signal = self.signal(join(place_x, place_y), part) + self.noise
        curvature = self.steering.curvature(world, output, self.gain, region) * self.factor + self.kick
        x, y, turn = speed * np.cos(heading), speed * np.sin(heading), speed * curvature
        if world.in_flow:
            flow = within(world.flow, self.origin)
            time = self.time + part if hasattr(world.flow, "at") else None
            u, v, spin = velocity_and_spin(flow, place_x, place_y, time)
            x, y, turn = x + u, y + v, turn + spin
        response = self.steering.rates(world, signal, output, sensitivity)
        return np.stack([x, y, turn, *response, curvature], axis=1)

    def signal(self, position: Array, part: Array) -> Array:
        """s = c/c_k (..., cells) without noise [length]."""
        world = self.world
        inside = inside_all(world.domains, position)
        if inside is not None:
            position = instead(inside, position, np.broadcast_to(self.origin, position.shape))
        return frozen(world.field, self.time + part).concentration(position) / world.field.gradient_scale


def swim(
    steering: Steering, world: World, state: State, noise: Array, response: tuple[Array, Array]
) -> tuple[Way, Array, Array]:
    """The way (..., cells) to the next decision, and the response then; noise as `World.step` takes it."""
    interval, kick = world.interval(state, np.zeros(state.finished.shape, np.int32), noise)
    factor = 1.0 if state.factors is None else state.factors[..., 1]
    cells = _Cells(steering, world, interval, factor, 0.0 if kick is None else kick)
    count = steering.steps(world)
    step, began = interval.length / count, world.time(state)
    values = np.stack([state.position[..., X], state.position[..., Y], world.heading_angle(state), *response])
    values = np.concatenate([values, np.zeros_like(values[:1])])
    path: list[Array] = []
    for number in range(count):
        origin = join(values[X], values[Y])
        if (inside := inside_all(world.domains, origin)) is not None:
            origin = instead(inside, origin, path[-1] if path else state.position)
        path.append(origin)
        now = cells._replace(
            gain=steering.gain_at(world, values[SENSITIVITY]), origin=origin, time=began + number * step
        )
        now = now._replace(noise=_noise(now, noise, number, count))
        values = advanced(now.rates, values, step, steering.levels(world, now.gain), OUTPUT)
    *_, output, sensitivity, turned = values
    length = np.where(interval.length > 0, interval.length, 1.0)
    curvature = np.where(interval.length > 0, turned / length, world.curvature(state))
    pose = Pose(join(values[X], values[Y]), join(np.cos(values[HEADING]), np.sin(values[HEADING])))
    told = interval._replace(curvature=world.normal_curvature(curvature), swum=curvature)
    return Way(pose, np.stack(path), told), output, sensitivity


def _noise(cells: _Cells, noise: Array, number: int, count: int) -> Array:
    """What the signal (..., cells) is off during a step [length]."""
    world = cells.world
    if world.concentration_noise > 0:
        return noise[..., 0] * (world.concentration_noise / world.field.gradient_scale)
    if world.binding_rate is None:
        return 0.0
    scale = world.field.gradient_scale
    volume = world.binding_rate * cells.interval.length / count
    true = np.clip(cells.signal(cells.origin, 0.0), 0.0, None) * scale
    uniform = streams.divided(noise[..., NOISE_CHANNELS], number)
    counted = bindings(uniform, volume * true) / np.where(volume > 0, volume, 1.0)
    return np.where(volume > 0, counted - true, 0.0) / scale
