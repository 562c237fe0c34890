"""The world: the state of its cells, its start, and one decision of every cell.

All functions are pure and written against the Python array API, so NumPy, torch and jax arrays of any leading
axes (..., cells) work alike. Randomness comes in as arrays.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from swarm._support.arrays import as_array, compiling, join, look_up, namespace, nowhere
from swarm._support.checks import check_cells
from swarm._support.pieces import in_pieces
from swarm.physics import perception
from swarm.physics.motion import intervals, swimmer
from swarm.physics.motion.intervals import Tables
from swarm.physics.motion.swimmer import Motion, Pose
from swarm.physics.parameters import Parameters

Array = Any

NOISE_CHANNELS = 3  # sensed concentration, curvature, heading


class State(NamedTuple):
    """Everything that changes; nothing is ever changed in place."""

    position: Array  # (..., cells, 2) [length]
    heading: Array  # (..., cells, 2) unit vector
    memory: Array  # (..., cells, N_T, features), newest first, see `perception`
    clock: Array  # (..., cells) ticks lived; without a common tick (..., cells, actions): decisions by action
    start_concentration: Array  # (..., cells) c(0)
    finished: Array  # (..., cells) bool: arrived, left the domain or out of time

    @property
    def pose(self) -> Pose:
        """Position and heading."""
        return Pose(self.position, self.heading)


class Outcome(NamedTuple):
    """What one decision led to."""

    observation: Array  # (..., cells, N_T · features) float32
    reward: Array  # (..., cells) change of the memory's mean concentration, normalised
    terminated: Array  # (..., cells) bool: reached the egg
    truncated: Array  # (..., cells) bool: out of time, or left the domain
    gain: Array  # (..., cells) c(t) − c(0) [concentration]


@dataclass(frozen=True)
class World(Parameters):
    """A world of cells: its [parameters][swarm.physics.parameters.Parameters], where lives start, and
    what a decision does.
    """

    @cached_property
    def _cached_tables(self) -> dict[Any, Tables]:
        return {}

    def tables(self, like: Array) -> Tables:
        """What a decision does, in the array library, dtype and device of `like`."""
        cacheable = type(like).__module__ in ("numpy", "torch")  # a jax tracer must not outlive its trace
        key = (type(like).__module__, like.dtype, str(like.device)) if cacheable else None
        tables = self._cached_tables.get(key)
        if tables is None:
            tables = intervals.make_tables(self, like)
            if cacheable:
                self._cached_tables[key] = tables
        return tables

    def start(self, position: Array, heading: Array, past: Array) -> State:
        """The state at t = 0 with a memory full of true records.

        `position` (..., cells, 2), `heading` (..., cells) [rad], `past` (..., cells, N_T) actions, newest
        first: the cell swam the newest N_T − 1 of them to its pose, the oldest is only recorded. Raises
        ValueError on wrong shapes and, where values are known (not inside a jax trace), on a start that is
        not finite, lies outside the field's or the flow's domain, has no finite concentration or whose past
        holds unknown actions; the cell is named.
        """
        xp = namespace(position)
        self._check_start(position, heading, past)
        position = join(*swimmer.components(position))
        heading = join(xp.cos(heading), xp.sin(heading))
        dtype = position.dtype
        by_action = [
            as_array(np.asarray(values), position, dtype=dtype)
            for values in (self.curvatures, self.action_speeds, self.intervals)
        ]
        pose = Pose(position, heading)
        records = []
        for i in range(self.n_records):
            curvature, speed, interval = (look_up(values, past[..., i]) for values in by_action)
            records.append(self._record(pose.position, self.normal_curvature(curvature)))
            if i < self.n_records - 1:
                pose = self._swim_back(pose, curvature, speed, interval)
        concentration = self.field.concentration(position)
        check_cells("position", "have a finite concentration", position, xp.isfinite(concentration))
        counters = () if self.has_common_tick else (self.n_actions,)
        return State(
            position=position,
            heading=heading,
            memory=perception.memory_of(records),
            clock=as_array(np.zeros((*position.shape[:-1], *counters)), position, dtype=xp.int32),
            start_concentration=concentration,
            finished=as_array(np.zeros(position.shape[:-1]), position, dtype=xp.bool),
        )

    def _swim_back(self, pose: Pose, curvature: Array, speed: Array, interval: Array) -> Pose:
        """The pose one interval before, by the scheme of the world: it must not depend on which cells there
        are."""
        if not self.in_flow:
            return swimmer.along_arc(pose, swimmer.arc(curvature, speed, -interval))
        scheme = dataclasses.replace(self.scheme, outputs=0)
        motions = scheme.motions(curvature, speed, -interval)
        weights = as_array(scheme.weights, interval)
        return scheme.swim(pose, motions, speed, -interval, weights, self.flow)[0]

    def _check_start(self, position: Array, heading: Array, past: Array) -> None:
        xp = namespace(position)
        cells = tuple(position.shape[:-1])
        if not cells or position.shape[-1] != 2 or not xp.isdtype(position.dtype, "real floating"):
            raise ValueError(
                "position must be floating numbers (..., cells, 2), got "
                f"{position.dtype} {tuple(position.shape)}"
            )
        if tuple(heading.shape) != cells:
            raise ValueError(
                f"heading must be {cells} like the cells of position, got {tuple(heading.shape)}"
            )
        if tuple(past.shape) != (*cells, self.n_records) or not xp.isdtype(past.dtype, "integral"):
            raise ValueError(
                f"past must be whole numbers {(*cells, self.n_records)}, got {past.dtype} {tuple(past.shape)}"
            )
        check_cells("position", "be finite", position, xp.all(xp.isfinite(position), axis=-1))
        check_cells("heading", "be finite", heading, xp.isfinite(heading))
        known = xp.all((past >= 0) & (past < self.n_actions), axis=-1)
        check_cells("past", f"hold actions from 0 to {self.n_actions - 1}", past, known)
        for inside in self.domains:
            check_cells(
                "position", "lie inside the domain of the field and the flow", position, inside(position)
            )

    def step(self, state: State, action: Array, noise: Array = None) -> tuple[State, Outcome]:
        """One decision of every cell, whatever its length; a finished cell stays where it is.

        `action` (..., cells) whole numbers 0 … m − 1; `noise` (..., cells, 3) standard normal numbers, needed
        when a perturbation is on. Pure: `state` is left as it was.
        """
        position, _, memory, clock, start_concentration, was_finished = state
        xp = namespace(position)
        needed = (*was_finished.shape, NOISE_CHANNELS)
        if self.has_noise and (noise is None or noise.shape != needed):
            raise ValueError(
                f"noise must be standard normal numbers {needed}, because the world has perturbations, "
                f"got {None if noise is None else tuple(noise.shape)}"
            )
        clock, motion, duration, speed, normal_curvature = intervals.next_interval(self, state, action, noise)
        pose, path = self._swim(state.pose, motion, speed, duration)
        if self.rotational_diffusion > 0:
            kick = noise[..., 2] * (2 * self.rotational_diffusion * duration) ** 0.5
            heading = swimmer.turned(swimmer.components(pose.heading), xp.cos(kick), xp.sin(kick))
            pose = Pose(pose.position, swimmer.unit(*heading))
        concentration = self.field.concentration(pose.position)
        sensed = concentration
        if self.concentration_noise > 0:
            sensed = concentration + self.concentration_noise * noise[..., 0]
        newest = self._record(pose.position, normal_curvature, sensed)
        reward = (newest[0] - memory[..., -1, 0]) * self.reward_scale
        memory, observation = perception.renew(memory, newest)
        truncated = finished = intervals.time_is_up(self, clock)
        terminated = nowhere(finished)
        if self.domains:
            for inside in self.domains:
                truncated = truncated | ~inside(pose.position)
            finished = truncated
        if self.egg is not None:
            terminated = self._arrived(state, pose, action, noise, duration, path)
            truncated = truncated & ~terminated
            finished = truncated | terminated
        if self.egg is not None or self.domains:
            finished = finished | was_finished
        state = State(pose.position, pose.heading, memory, clock, start_concentration, finished)
        gain = concentration - start_concentration
        return state, Outcome(observation, reward, terminated, truncated, gain)

    def _swim(self, pose: Pose, motion: Motion, speed: Array, duration: Array) -> tuple[Pose, Array | None]:
        """The pose after an interval, and in a flow the positions on the way to it."""
        if compiling(pose.position) and not (self.in_flow and self.scheme.outputs):
            motion = Motion(*(in_pieces(part, 2 if self.in_flow else 1) for part in motion))
        if not self.in_flow:
            return swimmer.along_arc(pose, motion), None
        weights = self.tables(pose.position).weights
        return self.scheme.swim(pose, motion, speed, duration, weights, self.flow)

    def time(self, state: State) -> Array:
        """Time lived (..., cells), `life` exactly when it is up [time]."""
        return intervals.time(self, state)

    def observation(self, state: State) -> Array:
        """Observation (..., cells, N_T · features) float32 of a state."""
        return perception.observe(state.memory)

    def heading_angle(self, state: State) -> Array:
        """Heading θ (..., cells) in (−π, π] [rad]."""
        xp = namespace(state.heading)
        return xp.atan2(state.heading[..., 1], state.heading[..., 0])

    def curvature(self, state: State) -> Array:
        """Curvature (..., cells) used during the interval that ended now [1 / length]."""
        contrast = 0.5 * (self.curvatures[-1] - self.curvatures[0])
        return state.memory[..., 0, 1] * contrast + self.mean_curvature

    def _record(self, position: Array, normal_curvature: Array, concentration: Array | None = None) -> Array:
        if concentration is None:
            concentration = self.field.concentration(position)
        flow: tuple[Array, ...] = ()
        if self.sense_flow:
            x, y, spin = swimmer.velocity_and_spin(self.flow, *swimmer.components(position))
            flow = (x / self.flow.speed_scale, y / self.flow.speed_scale, spin / self.flow.spin_scale)
        return perception.record(concentration, normal_curvature, flow, self.record_scale)

    def _arrived(
        self,
        state: State,
        pose: Pose,
        action: Array,
        noise: Array,
        duration: Array,
        path: Array | None,
    ) -> Array:
        """Whether the path of the interval came within reach of the egg; False for finished cells."""
        assert self.egg is not None
        xp = namespace(pose.position)
        centre, radius = self.egg
        if path is None:
            curvature = intervals.swum_curvature(self, action, noise, pose.position)
            speed = look_up(as_array(np.asarray(self.action_speeds), pose.position), action)
            nearest = swimmer.closest_approach(state.pose, curvature, speed * duration, centre)
            reached = nearest <= radius
        else:
            from_egg = xp.concat([path, pose.position[None, ...]], axis=0) - as_array(
                np.asarray(centre), path
            )
            reached = xp.any(from_egg[..., 0] ** 2 + from_egg[..., 1] ** 2 <= radius**2, axis=0)
        return reached & ~state.finished
