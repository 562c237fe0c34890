"""The world: the state of its cells, its start, and one decision of every cell.

All functions are pure and written against the Python array API, so NumPy, torch and jax arrays of any leading
axes (..., cells) work alike. Randomness comes in as arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from swarm._support.arrays import as_array, join, look_up, namespace, nowhere
from swarm._support.checks import check_cells
from swarm.physics import perception
from swarm.physics.motion.arc import Pose, closest_approach, comes_within, components, turned, unit
from swarm.physics.motion.clock import frozen
from swarm.physics.motion.swimmer import Interval
from swarm.physics.parameters import Parameters
from swarm.physics.perception import Situation

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
    reward: Array  # (..., cells) as the world's `reward` has it
    terminated: Array  # (..., cells) bool: reached the egg
    truncated: Array  # (..., cells) bool: out of time, or left the domain
    gain: Array  # (..., cells) c(t) − c(0) [concentration]


@dataclass(frozen=True)
class World(Parameters):
    """A world of cells: its [parameters][swarm.physics.parameters.Parameters], where lives start, and
    what a decision does.
    """

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
        position = join(*components(position))
        heading = join(xp.cos(heading), xp.sin(heading))
        concentration = frozen(self.field, 0.0).concentration(position)
        check_cells("position", "have a finite concentration", position, xp.isfinite(concentration))
        finished = as_array(np.zeros(position.shape[:-1]), position, dtype=xp.bool)
        count = self.clock.start(finished)  # of the past too, which is swum as at t = 0
        by_action = [
            as_array(np.asarray(values), position)
            for values in (self.curvatures, self.action_speeds, self.intervals)
        ]
        pose = Pose(position, heading)
        records: list[Sequence[Array]] = []
        for i in range(self.n_records):
            curvature, speed, interval = (look_up(values, past[..., i]) for values in by_action)
            sensed = frozen(self.field, 0.0).concentration(pose.position)
            records.append(self._record(pose, sensed, self.normal_curvature(curvature), finished, count))
            if i < self.n_records - 1:
                pose = self.swimmer.swim_back(pose, curvature, speed, interval)
        if len(records[0]) != self.features:
            names = ", ".join(self.sensor.names)
            raise ValueError(f"sensor must record a number for each of {names}, got {len(records[0])}")
        return State(
            position=position,
            heading=heading,
            memory=perception.memory_of(records),
            clock=count,
            start_concentration=concentration,
            finished=finished,
        )

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
        if self.has_noise:
            self._check_noise(state, noise)
        over = state.finished if self._ends_early or not self.clock.has_common_tick else None
        kick = self.curvature_noise * noise[..., 1] if self.curvature_noise > 0 else None
        interval = self.swimmer.next_interval(state.clock, action, over, kick, state.position)
        began = None if self.is_steady else self.time(state)
        pose, path = self.swimmer.swim(state.pose, interval, began)
        if self.rotational_diffusion > 0:
            xp = namespace(noise)
            turn = noise[..., 2] * (2 * self.rotational_diffusion * interval.length) ** 0.5
            pose = Pose(pose.position, unit(*turned(components(pose.heading), xp.cos(turn), xp.sin(turn))))
        concentration = sensed = self._concentration(pose.position, interval.count)
        if self.concentration_noise > 0:
            sensed = concentration + self.concentration_noise * noise[..., 0]
        newest = self._record(pose, sensed, interval.curvature, state.finished, interval.count)
        memory, observation = perception.renew(state.memory, newest)
        terminated, truncated, finished = self._ends(state, action, kick, interval, pose, path)
        start_concentration = state.start_concentration
        after = State(*pose, memory, interval.count, start_concentration, finished)
        ends = terminated, truncated, concentration - start_concentration
        reward = self.reward.reward(self, state, after, Outcome(observation, None, *ends))
        return after, Outcome(observation, reward, *ends)

    def _check_noise(self, state: State, noise: Array | None) -> None:
        needed = (*state.finished.shape, NOISE_CHANNELS)
        if noise is None or noise.shape != needed:
            raise ValueError(
                f"noise must be standard normal numbers {needed}, because the world has perturbations, "
                f"got {None if noise is None else tuple(noise.shape)}"
            )

    def time(self, state: State) -> Array:
        """Time lived (..., cells), `life` exactly when it is up [time]."""
        return self.clock.time(state.clock, state.position)

    def concentration(self, state: State) -> Array:
        """Concentration (..., cells) where the cells are, at their time [concentration]."""
        return self._concentration(state.position, state.clock)

    def _concentration(self, position: Array, count: Array) -> Array:
        field = self.field if self.is_steady else frozen(self.field, self.clock.time(count, position))
        return field.concentration(position)

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

    @cached_property
    def _ends_early(self) -> bool:
        """Whether anything but time ends lives."""
        return self.egg is not None or bool(self.domains)

    def _record(
        self, pose: Pose, concentration: Array, curvature: Array, finished: Array, count: Array
    ) -> Sequence[Array]:
        """What the sensor records."""
        time = self.clock.time(count, pose.position) if self._needs_time else None
        return self.sensor.record(self, time, Situation(*pose, concentration, curvature, finished))

    @cached_property
    def _needs_time(self) -> bool:
        return bool(getattr(self.sensor, "needs_time", False)) or not self.is_steady

    def _ends(
        self, state: State, action: Array, kick: Array, interval: Interval, pose: Pose, path: Array | None
    ) -> tuple[Array, Array, Array]:
        """Which cells have arrived, which are out of time or of the domain, and whose lives are over."""
        truncated = finished = self.clock.is_up(interval.count)
        terminated = nowhere(finished)
        for inside in self.domains:
            truncated = truncated | ~inside(pose.position)
        if self.egg is not None:
            centre, radius = self.egg
            if path is None:
                curvature = self.swimmer.swum_curvature(action, kick, pose.position)
                length = interval.speed * interval.length
                terminated = closest_approach(state.pose, curvature, length, centre) <= radius
            else:
                terminated = comes_within(path, pose.position, centre, radius)
            terminated = terminated & ~state.finished
            truncated = truncated & ~terminated
        if self._ends_early:
            finished = truncated | terminated | state.finished
        return terminated, truncated, finished
