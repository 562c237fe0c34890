"""The world: the state of its cells, its start, and one decision of every cell.

All functions are pure and written against the Python array API, so NumPy, torch and jax arrays of any leading
axes (..., cells) work alike. Randomness comes in as arrays.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from swarm._support.arrays import as_array, join, look_up, namespace, nowhere
from swarm._support.checks import check_cells
from swarm.physics import perception
from swarm.physics.crowd.binding import bindings
from swarm.physics.crowd.medium import MediumState
from swarm.physics.motion.arc import (
    Pose,
    along_arc,
    arc,
    arrival,
    arrival_on,
    closest_approach,
    comes_within,
    components,
    turned,
    unit,
)
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
    factors: Array = None  # (..., cells, 2) of the cell's speed and curvature; None where all are alike
    arrival_time: Array = None  # (..., cells) at the egg, infinite before [time]; None where nobody races
    medium: MediumState | None = None  # what cells have changed; None without a medium

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

    def start(self, position: Array, heading: Array, past: Array, factors: Array = None) -> State:
        """The state at t = 0 with a memory full of true records.

        `position` (..., cells, 2), `heading` (..., cells) [rad], `past` (..., cells, N_T) actions, newest
        first: the cell swam the newest N_T − 1 of them to its pose, alone and in the field and the flow at
        t = 0, the oldest is only recorded. `factors` (..., cells, 2) are the cells' own of speed and curvature,
        where the world spreads them, 1 by default. Raises
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
        factors = self._factors(position, factors)
        records: list[Sequence[Array]] = []
        for i in range(self.n_records):
            curvature, speed, interval = (look_up(values, past[..., i]) for values in by_action)
            sensed = frozen(self.field, 0.0).concentration(pose.position)
            chosen = self.normal_curvature(curvature)
            records.append(self._record(pose, sensed, chosen, finished, count, factors))
            if i < self.n_records - 1:
                if factors is not None:
                    speed, curvature = speed * factors[..., 0], curvature * factors[..., 1]
                pose = self.swimmer.swim_back(pose, curvature, speed, interval)
        if len(records[0]) != self.features:
            names = ", ".join(self.sensor.names)
            raise ValueError(f"sensor must record a number for each of {names}, got {len(records[0])}")
        state = State(
            position=position,
            heading=heading,
            memory=perception.memory_of(records),
            clock=count,
            start_concentration=concentration,
            finished=finished,
            factors=factors,
        )
        if self.first_arrivals is not None:
            self._check_enough(finished)
            state = state._replace(arrival_time=xp.full_like(concentration, math.inf))
        if self.medium is not None:
            state = state._replace(medium=self.medium.start(self.field, position))
            state = state._replace(start_concentration=self.concentration(state))
        return state

    def _check_enough(self, cells: Array) -> None:
        assert self.first_arrivals is not None
        if cells.shape[-1] < self.first_arrivals:
            raise ValueError(
                f"first_arrivals must be at most the number of cells, {cells.shape[-1]}, got "
                f"{self.first_arrivals}"
            )

    def _factors(self, position: Array, factors: Array) -> Array:
        """The cells' own factors (..., cells, 2), None in a world whose cells are all alike."""
        if self.spread is None:
            if factors is not None:
                raise ValueError(f"factors must go with a world that has a spread, got {factors!r}")
            return None
        return namespace(position).ones_like(position) if factors is None else factors

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
        when a perturbation is on, and with a `binding_rate` a fourth of uniform ones. Pure: `state` is left as
        it was.
        """
        if self.has_noise:
            self._check_noise(state, noise)
        over = state.finished if self._ends_early or not self.clock.has_common_tick else None
        kick = self.curvature_noise * noise[..., 1] if self.curvature_noise > 0 else None
        interval = self.swimmer.next_interval(
            state.clock, action, over, kick, state.position, state.factors
        )
        pose, path = self._swim(state, interval)
        medium = None if self.medium is None else self._medium(state, interval, pose)
        if self.rotational_diffusion > 0:
            xp = namespace(noise)
            turn = noise[..., 2] * (2 * self.rotational_diffusion * interval.length) ** 0.5
            pose = Pose(pose.position, unit(*turned(components(pose.heading), xp.cos(turn), xp.sin(turn))))
        concentration = sensed = self._concentration(pose.position, interval.count, medium)
        if self.concentration_noise > 0:
            sensed = concentration + self.concentration_noise * noise[..., 0]
        if self.binding_rate is not None:
            sensed = self._counted(state, interval, pose, medium, noise[..., NOISE_CHANNELS])
        newest = self._record(
            pose, sensed, interval.curvature, state.finished, interval.count, state.factors
        )
        memory, observation = perception.renew(state.memory, newest)
        arrival_time = self._arrival_time(state, interval, pose, path)
        terminated, truncated, finished = self._ends(state, interval, pose, path, medium, arrival_time)
        after = State(
            *pose, memory, interval.count, state.start_concentration, finished, state.factors, arrival_time, medium
        )
        ends = terminated, truncated, concentration - state.start_concentration
        reward = self.reward.reward(self, state, after, Outcome(observation, None, *ends))
        return after, Outcome(observation, reward, *ends)

    def _check_noise(self, state: State, noise: Array | None) -> None:
        needed = (*state.finished.shape, NOISE_CHANNELS + (self.binding_rate is not None))
        if noise is None or tuple(noise.shape) != needed:
            raise ValueError(
                f"noise must be standard normal numbers {needed}, because the world has perturbations, "
                f"got {None if noise is None else tuple(noise.shape)}"
            )

    def time(self, state: State) -> Array:
        """Time lived (..., cells), `life` exactly when it is up [time]."""
        return self.clock.time(state.clock, state.position)

    def concentration(self, state: State) -> Array:
        """Concentration (..., cells) where the cells are, at their time [concentration]."""
        return self._concentration(state.position, state.clock, state.medium)

    def _concentration(self, position: Array, count: Array, medium: MediumState | None) -> Array:
        field = self.field if self.is_steady else frozen(self.field, self.clock.time(count, position))
        found = field.concentration(position)
        return found if self.medium is None else self.medium.sense(medium, position, found)

    def won(self, state: State) -> Array:
        """Who has arrived in time (..., cells) bool, in a world with `first_arrivals`."""
        return state.arrival_time <= self._deadline(state.arrival_time)[..., None]

    def _deadline(self, arrival_time: Array) -> Array:
        """When the egg closes (...): infinite while it is not known [time]."""
        assert self.first_arrivals is not None
        ordered = namespace(arrival_time).sort(arrival_time, axis=-1)
        latest = ordered[..., self.first_arrivals - 1] + self.block_delay
        return namespace(latest).clip(latest, None, LATEST)

    # --- what happens within a decision ---------------------------------------------------------------------

    def _swim(self, state: State, interval: Interval) -> tuple[Pose, Array | None]:
        """The pose after it, and the places on the way to it where the arc does not tell them."""
        began = None if self.is_steady else self.time(state)
        company = self.swimmer.company
        if company is None:
            return self.swimmer.swim(state.pose, interval, began)
        arcs = interval.swum, interval.speed, interval.length
        return company.swim(state.pose, *arcs, ~state.finished, began)

    def _places(self, state: State, interval: Interval, pose: Pose, parts: np.ndarray) -> Array:
        """Positions (parts, ..., cells, 2) on the way: on the arc, from which the cell is led off evenly."""
        xp = namespace(pose.position)
        whole = along_arc(state.pose, arc(interval.swum, interval.speed, interval.length)).position
        places = []
        for part in parts.tolist():
            on_arc = along_arc(state.pose, arc(interval.swum, interval.speed, part * interval.length)).position
            places.append(on_arc + part * (pose.position - whole))
        return xp.stack(places)

    def _medium(self, state: State, interval: Interval, pose: Pose) -> MediumState:
        """The medium at the end of a decision in which cells ate along their ways."""
        assert self.medium is not None
        xp = namespace(pose.position)
        parts = (np.arange(self._substeps) + 0.5) / self._substeps
        return self.medium.step(
            state.medium,
            functools.partial(frozen, self.field),
            functools.partial(frozen, self.flow),
            self._places(state, interval, pose, parts),
            xp.max(interval.length, axis=-1),
            ~state.finished,
            xp.max(self.time(state), axis=-1),
        )

    @cached_property
    def _substeps(self) -> int:
        assert self.medium is not None
        fastest = max(self.action_speeds) * (1.0 if self.spread is None else self.spread.largest[0])
        return self.medium.substeps_for(self.flow, fastest, max(self.intervals))

    def _counted(
        self, state: State, interval: Interval, pose: Pose, medium: MediumState | None, uniform: Array
    ) -> Array:
        """The concentration told by the molecules that have bound in an interval, of mean λ_b ∫ c dt, which
        three Gauss points on the way give; at the end of it that of a cell which has stayed."""
        assert self.binding_rate is not None
        xp = namespace(uniform)
        points, weights = np.polynomial.legendre.leggauss(3)
        parts = 0.5 * (points + 1)
        start = self.clock.time(state.clock, pose.position)
        mean = 0.0
        for part, weight, place in zip(
            parts, weights, self._places(state, interval, pose, parts), strict=True
        ):
            field = self.field if self.is_steady else frozen(self.field, start + float(part) * interval.length)
            found = field.concentration(place)
            if self.medium is not None:
                found = self.medium.sense(medium, place, found)
            mean = mean + (0.5 * float(weight)) * found
        volume = self.binding_rate * interval.length
        some = volume > 0
        expected = xp.where(some, volume * xp.clip(mean, 0.0, None), xp.ones_like(volume))
        told = bindings(uniform, expected) / xp.where(some, volume, xp.ones_like(volume))
        return xp.where(some, told, mean)

    def _arrival_time(
        self, state: State, interval: Interval, pose: Pose, path: Array | None
    ) -> Array:
        """When cells (..., cells) came to the egg [time], found on the way; None where nobody races."""
        if self.first_arrivals is None or self.egg is None:
            return None
        centre, radius = self.egg
        if path is None:
            length = interval.speed * interval.length
            part = arrival(state.pose, interval.swum, length, centre, radius)
        else:
            part = arrival_on(path, state.position, pose.position, centre, radius)
        xp = namespace(part)
        there = xp.isfinite(part) & ~state.finished
        safe = xp.where(there, part, xp.zeros_like(part))
        came = self.clock.time(state.clock, pose.position) + safe * interval.length
        return xp.where(there, came, state.arrival_time)

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
        return self.egg is not None or bool(self.domains) or self._follows

    @cached_property
    def _follows(self) -> bool:
        """Whether the domain moves with the cells."""
        return self.medium is not None and self.medium.leaving == "follow"

    def _record(
        self,
        pose: Pose,
        concentration: Array,
        curvature: Array,
        finished: Array,
        count: Array,
        factors: Array,
    ) -> Sequence[Array]:
        """What the sensor records."""
        time = self.clock.time(count, pose.position) if self._needs_time else None
        return self.sensor.record(self, time, Situation(*pose, concentration, curvature, finished, factors))

    @cached_property
    def _needs_time(self) -> bool:
        return bool(getattr(self.sensor, "needs_time", False)) or not self.is_steady

    def _ends(
        self,
        state: State,
        interval: Interval,
        pose: Pose,
        path: Array | None,
        medium: MediumState | None,
        arrival_time: Array,
    ) -> tuple[Array, Array, Array]:
        """Which cells have arrived, which are out of time or of the domain, and whose lives are over."""
        truncated = finished = self.clock.is_up(interval.count)
        terminated = nowhere(finished)
        for inside in self.domains:
            truncated = truncated | ~inside(pose.position)
        if self.medium is not None and self._follows:
            truncated = truncated | ~self.medium.inside(pose.position, medium.origin)
        if arrival_time is not None:
            terminated = self._race_ends(state, interval, arrival_time)
            truncated = truncated & ~terminated
        elif self.egg is not None:
            centre, radius = self.egg
            if path is None:
                length = interval.speed * interval.length
                terminated = closest_approach(state.pose, interval.swum, length, centre) <= radius
            else:
                terminated = comes_within(path, pose.position, centre, radius)
            terminated = terminated & ~state.finished
            truncated = truncated & ~terminated
        if self._ends_early:
            finished = truncated | terminated | state.finished
        return terminated, truncated, finished

    def _race_ends(self, state: State, interval: Interval, arrival_time: Array) -> Array:
        """Whose life ends (..., cells) by an arrival: the cell's own, or the last that counts."""
        xp = namespace(arrival_time)
        closes = self._deadline(arrival_time)[..., None]
        over = closes <= self.clock.time(interval.count, arrival_time)
        return (xp.isfinite(arrival_time) | over) & ~state.finished
