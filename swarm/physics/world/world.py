"""The world: the state of its cells, its start, and one decision of every cell.

All functions are pure, of the Python array API: NumPy, torch and jax arrays of any leading axes (..., cells)
work alike. Randomness comes in as arrays.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from swarm._support.arrays import as_array, look_up, namespace, nowhere
from swarm._support.checks import check_cells, check_rule
from swarm.physics import perception
from swarm.physics.crowd.binding import counted
from swarm.physics.motion.arc import Pose, components, turned, unit
from swarm.physics.motion.clock import frozen
from swarm.physics.motion.domain import kept
from swarm.physics.motion.swimmer import Interval, Way
from swarm.physics.perception import Situation
from swarm.physics.world.parameters import Parameters
from swarm.physics.world.state import NOISE_CHANNELS, Outcome, State, check_noise, check_start, pose_of

Array = Any

GAUSS = {0.5 - 0.15**0.5: 5 / 18, 0.5: 4 / 9, 0.5 + 0.15**0.5: 5 / 18}  # parts of an interval, and weights


@dataclass(frozen=True)
class World(Parameters):
    """A world of cells: its [parameters][swarm.physics.world.parameters.Parameters], where lives start, and
    what a decision does.
    """

    def start(
        self,
        position: Array,
        heading: Array,
        past: Array,
        factors: Array = None,
        noise: Array = None,
        medium: Any = None,
    ) -> State:
        """The state at t = 0 with a memory full of true records.

        `position` (..., cells, 2), `heading` (..., cells) [rad], in space (..., cells, 3) and frames (...,
        cells, 4) as unit quaternions, `past` (..., cells, N_T) actions, newest first: the cell swam the
        newest N_T − 1 of them to its pose, alone and in the field and the flow at t = 0, the oldest is only
        recorded. `factors` (..., cells, 2) are the cells' own of speed and curvature, where the world spreads
        them, 1 by default; `noise` (..., cells, N_T) standard normal numbers for `concentration_noise`,
        without which records are exact; `medium` a `MediumState` that cells join, by default as it is at
        first. A past ends where it would come from outside the domain: before, the cell has waited there.
        Raises ValueError on wrong shapes and, where values are known (not inside a jax trace), on a start
        that is not finite, lies outside the field's or the flow's domain, has no finite concentration or
        whose past holds unknown actions; the cell is named.
        """
        xp = namespace(position)
        check_start(self, position, heading, past, factors, noise, medium)
        pose = self.swimmer.pose(position, heading)
        position = pose.position
        concentration = self._concentration(position, 0.0, None)
        check_cells("position", "have a finite concentration", position, xp.isfinite(concentration))
        finished = as_array(np.zeros(position.shape[:-1]), position, dtype=xp.bool)
        count = self.clock.start(finished)  # of the past too, which is swum as at t = 0
        if self.spread is not None and factors is None:
            factors = xp.ones_like(position)
        records = self._past(pose, past, (finished, count, factors), noise, medium)
        rule = f"sensor must record a number for each of {', '.join(self.sensor.names)}"
        check_rule(len(records[0]) == self.features, rule, len(records[0]))
        arrival_time = None if self.race is None else xp.full_like(concentration, math.inf)
        if self.medium is not None:
            medium = self.medium.start(self.field, position) if medium is None else medium
            concentration = self._concentration(position, self._moment(count, position), medium)
        first = perception.memory_of(records), count, concentration, finished
        return State(*pose, *first, factors, arrival_time, medium)

    def _past(
        self, pose: Pose, past: Array, cells: Sequence[Array], noise: Array, medium: Any
    ) -> list[Sequence[Array]]:
        """The records of a past, newest first, that was swum to a pose, in a medium as it is at first or as
        given; `cells` are what `_record` asks of them.
        """
        tables = self.curvatures, self.action_speeds, self.intervals
        by_action = [as_array(np.asarray(values), pose.position) for values in tables]
        records: list[Sequence[Array]] = []
        for i in range(self.n_records):
            action = past[..., i]
            curvature, speed, interval = (look_up(values, action) for values in by_action)
            sensed = self._concentration(pose.position, 0.0, medium)
            if self.concentration_noise > 0 and noise is not None:
                sensed = sensed + self.concentration_noise * noise[..., i]
            records.append(self._record(pose, sensed, self.normal_curvature(curvature), cells, alone=i > 0))
            if i < self.n_records - 1:
                if (factors := cells[-1]) is not None:
                    speed, curvature = speed * factors[..., 0], curvature * factors[..., 1]
                arcs = self.swimmer.arc_of(action, curvature)
                pose, _ = kept(self.domains, self.swimmer.swim_back(pose, arcs, speed, interval), pose)
        return records

    def step(
        self, state: State, action: Array, noise: Array = None, way: Any = None
    ) -> tuple[State, Outcome]:
        """One decision of every cell, whatever its length; a finished cell stays where it is, and one that
        leaves the domain where it was before: fields and flows are not asked outside.

        `action` (..., cells) whole numbers 0 … m − 1, in a world of continuous actions curvatures, of which
        those outside the range count as its ends; `noise` (..., cells, 3) standard normal numbers, needed
        when a perturbation is on, and with a `binding_rate` a fourth of uniform ones; a `Way` is swum in
        place of the action's. Pure: `state` is left as it was.
        """
        pose, path, interval = self.way(state, action, noise) if way is None else way
        medium = None if self.medium is None else self._medium(state, interval, pose)
        if self.rotational_diffusion > 0:
            xp = namespace(noise)
            turn = noise[..., 2] * (2 * self.rotational_diffusion * interval.length) ** 0.5
            pose = Pose(pose.position, unit(*turned(components(pose.heading), xp.cos(turn), xp.sin(turn))))
        swum, (pose, left) = Way(pose, path, interval), kept(self.domains, pose, pose_of(state))
        now = self._moment(interval.count, pose.position)
        concentration = sensed = self._concentration(pose.position, now, medium)
        if self.concentration_noise > 0:
            sensed = concentration + self.concentration_noise * noise[..., 0]
        if self.binding_rate is not None:
            mean = self._mean_concentration(state, interval, pose, medium)
            sensed = counted(noise[..., NOISE_CHANNELS], mean, self.binding_rate * interval.length)
        cells = state.finished, interval.count, state.factors
        newest = self._record(pose, sensed, interval.curvature, cells)
        memory, observation = perception.renew(state.memory, newest)
        arrival_time = None if self.race is None else self._arrival_time(state, swum)
        terminated, truncated, finished = self._ends(state, swum, left, medium, arrival_time)
        first = state.start_concentration
        after = State(*pose, memory, interval.count, first, finished, state.factors, arrival_time, medium)
        ends = terminated, truncated, concentration - first
        reward = self.reward.reward(self, state, after, Outcome(observation, None, *ends))
        return after, Outcome(observation, reward, *ends)

    def interval(self, state: State, action: Array, noise: Array = None) -> tuple[Interval, Array]:
        """What cells do until the next decision, and the kick of their curvature (None: none)."""
        if self.has_noise:
            check_noise(self, state, noise)
        kick = self.curvature_noise * noise[..., 1] if self.curvature_noise > 0 else None
        if self.curvature_diffusion > 0:
            spreads = as_array(np.asarray(self.curvature_spreads), noise)
            kick = (spreads[0] if self.is_continuous else look_up(spreads, action)) * noise[..., 1]
        over = state.finished if self._ends_early or not self.clock.has_common_tick else None
        given = over, kick, state.position, state.factors
        return self.swimmer.next_interval(state.clock, action, *given), kick

    def time(self, state: State) -> Array:
        """Time lived (..., cells), `life` exactly when it is up [time]."""
        return self.clock.time(state.clock, state.position)

    def concentration(self, state: State) -> Array:
        """Concentration (..., cells) where the cells are, at their time [concentration]."""
        return self._concentration(state.position, self._moment(state.clock, state.position), state.medium)

    def heading_angle(self, state: State) -> Array:
        """Heading θ (..., cells) in (−π, π], in the plane [rad]."""
        rule = "heading_angle must be asked for in the plane, in space ask for orientation"
        check_rule(self.dimensions == 2, rule, f"{self.dimensions} dimensions")
        return self.swimmer.orientation(state.heading)

    def orientation(self, state: State) -> Array:
        """What `World.start` takes as the heading: in the plane the angle (..., cells) in (−π, π] [rad], in
        space the frame (..., cells, 4).
        """
        return self.swimmer.orientation(state.heading)

    def direction(self, state: State) -> Array:
        """Unit vector (..., cells, dimensions) in which cells swim."""
        return self.swimmer.direction(state.heading)

    def centre(self, state: State) -> Array:
        """What cells turn about (..., cells, dimensions) with the curvature of the interval that ended now:
        in the plane the centre of curvature, in space the nearest point of the helix's axis; NaN where they
        swim straight on [length].
        """
        arcs = self.swimmer.arc_of(self.last_action(state), self.curvature(state))
        return self.swimmer.centre(pose_of(state), arcs)

    def won(self, state: State) -> Array:
        """Who has arrived in time (..., cells) bool; nobody in a world without `first_arrivals`."""
        return nowhere(state.finished) if self.race is None else self.race.won(state.arrival_time)

    # --- what happens within a decision ---------------------------------------------------------------------

    def _moment(self, count: Array, position: Array) -> Array | None:
        """Time lived (..., cells), None where nothing changes with it [time]."""
        return None if self.is_steady else self.clock.time(count, position)

    def _concentration(self, position: Array, time: Any, medium: Any) -> Array:
        field = self.field if time is None else frozen(self.field, time)
        found = field.concentration(position)
        if medium is None or self.medium is None:
            return found
        return self.medium.sense(medium, position, found)

    def way(self, state: State, action: Array, noise: Array) -> Way:
        """The way of an action."""
        interval, kick = self.interval(state, action, noise)
        if self._needs_arcs:
            arcs = self.swimmer.arcs(action, kick, state.position, state.factors)
            interval = interval._replace(swum=arcs)
        began = self._moment(state.clock, state.position)
        company = self.swimmer.company
        if company is None:
            return Way(*self.swimmer.swim(pose_of(state), interval, began), interval)
        arcs = interval.swum, interval.speed, interval.length
        return Way(*company.swim(pose_of(state), *arcs, ~state.finished, began), interval)

    def _medium(self, state: State, interval: Interval, pose: Pose) -> Any:
        """The medium at the end of a decision in which cells ate along their ways."""
        assert self.medium is not None
        xp = namespace(pose.position)
        return self.medium.step(
            state.medium,
            functools.partial(frozen, self.field),
            functools.partial(frozen, self.flow),
            self.swimmer.places(pose_of(state), interval, pose, self._middles),
            xp.max(interval.length, axis=-1),
            ~state.finished,
            xp.max(self.time(state), axis=-1),
        )

    @cached_property
    def _middles(self) -> tuple[float, ...]:
        """The middles of the medium's substeps, as parts of a decision."""
        assert self.medium is not None
        count = self.medium.substeps_for(self.flow, self.fastest, max(self.intervals))
        return tuple((i + 0.5) / count for i in range(count))

    def _mean_concentration(self, state: State, interval: Interval, pose: Pose, medium: Any) -> Array:
        """The mean (..., cells) on the way, by three Gauss points [concentration]."""
        start, mean = self._moment(state.clock, state.position), 0.0
        places = self.swimmer.places(pose_of(state), interval, pose, tuple(GAUSS))
        for i, (part, weight) in enumerate(GAUSS.items()):
            time = None if start is None else start + part * interval.length
            place, _ = kept(self.domains, Pose(places[i, ...], pose.heading), pose_of(state))
            mean = mean + weight * self._concentration(place.position, time, medium)
        return mean

    def _arrival_time(self, state: State, way: Way) -> Array:
        """When cells (..., cells) came to the egg [time], found on the way; infinite for who did not."""
        assert self.egg is not None
        part = self.swimmer.arrival(pose_of(state), way, self.egg)
        xp = namespace(part)
        there = xp.isfinite(part) & ~state.finished
        safe = xp.where(there, part, xp.zeros_like(part))
        came = self.time(state) + safe * way.interval.length
        return xp.where(there, came, state.arrival_time)

    def observation(self, state: State) -> Array:
        """Observation (..., cells, N_T · features) float32 of a state."""
        return perception.observe(state.memory)

    @cached_property
    def _ends_early(self) -> bool:
        """Whether anything but time ends lives."""
        return self.egg is not None or bool(self.domains) or self._follows

    @cached_property
    def _needs_arcs(self) -> bool:
        """Whether more is asked of the way than where it ends."""
        on_the_way = self.egg is not None or self.medium is not None or self.binding_rate is not None
        return on_the_way or bool(self.interactions)

    @cached_property
    def _follows(self) -> bool:
        """Whether the domain moves with the cells."""
        return self.medium is not None and self.medium.leaving == "follow"

    def _record(
        self, pose: Pose, concentration: Array, curvature: Array, cells: Sequence[Array], alone: bool = False
    ) -> Sequence[Array]:
        """What the sensor records; of `cells` it is known who has finished, their count and factors."""
        finished, count, factors = cells
        time = self.clock.time(count, pose.position) if self._needs_time else None
        situation = Situation(*pose, concentration, curvature, finished, factors, alone)
        return self.sensor.record(self, time, situation)

    @cached_property
    def _needs_time(self) -> bool:
        return bool(getattr(self.sensor, "needs_time", False)) or not self.is_steady

    def _ends(
        self, state: State, way: Way, left: Array | None, medium: Any, arrival_time: Array
    ) -> tuple[Array, Array, Array]:
        """Which cells have arrived, which are out of time or of the domain, and whose lives are over."""
        count = way.interval.count
        truncated = finished = self.clock.is_up(count, alone=not self._ends_early)
        terminated = nowhere(finished)
        if left is not None:
            truncated = truncated | left
        if self.medium is not None and self._follows:
            truncated = truncated | ~self.medium.inside(way.pose.position, medium.origin)
        if self.egg is not None:
            if self.race is None:
                ended = self.swimmer.comes_within(pose_of(state), way, self.egg)
            else:
                ended = self.race.ends(arrival_time, self.clock.time(count, arrival_time))
            terminated = ended & ~state.finished
            truncated = truncated & ~terminated
        if self._ends_early:
            finished = truncated | terminated | state.finished
        return terminated, truncated, finished
