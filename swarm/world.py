"""The world: its parameters, the state of its cells, and one decision of every cell.

All functions are pure and written against the Python array API, so NumPy, torch and jax arrays of any leading
axes (..., cells) work alike. Randomness comes in as arrays.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from swarm import perception, swimmer
from swarm.arrays import as_array, at_least, compiling, join, namespace, nowhere
from swarm.checks import (
    check_box,
    check_cells,
    check_count,
    check_flag,
    check_function,
    check_methods,
    check_name,
    check_number,
    check_point,
)
from swarm.fields import DiffusingSource, Field, GaussianPlume, LinearField, RadialField
from swarm.flows import Flow, PoiseuilleFlow, ShearFlow, StillWater, TaylorGreen, UniformFlow, Vortex
from swarm.pieces import in_pieces
from swarm.swimmer import Motion, Pose

Array = Any

FIELDS: dict[str, type] = {
    "linear": LinearField,
    "radial": RadialField,
    "gaussian_plume": GaussianPlume,
    "diffusing_source": DiffusingSource,
}
FLOWS: dict[str, type] = {
    "still": StillWater,
    "taylor_green": TaylorGreen,
    "uniform": UniformFlow,
    "shear": ShearFlow,
    "poiseuille": PoiseuilleFlow,
    "vortex": Vortex,
}
INTERVAL_RULES = ("truncated", "exact")
NOISE_CHANNELS = 3  # sensed concentration, curvature, heading
DEFAULT_BOX = ((0.0, 10.0), (0.0, 10.0))
MAX_TICKS = 10_000  # of one decision: the tables have a row for each


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


class Tables(NamedTuple):
    """What a decision does: column `action · (longest + 2) + min(ticks left, longest + 1)`.

    The last column of an action is a whole interval, the others are the clipped last interval of a life.
    """

    rows: Array  # (3 + 4 · targets, columns): κ*, duration [time], speed, the motions of `swimmer`
    whole: Array  # (actions,) ticks of a whole interval; (1,) where they are all the same
    last: Array  # (1,) longest + 1
    weights: Array  # collocation weights


@dataclass(frozen=True)
class World:
    """Parameters of a world; the paper's values are the defaults. Checks itself when made.

    Raises TypeError or ValueError that names the parameter, the rule and the value.
    """

    n_records: int = 4  # N_T, records a cell keeps
    field: Field = dataclasses.field(default_factory=LinearField)  # or a name of `FIELDS`
    flow: Flow = dataclasses.field(default_factory=StillWater)  # or a name of `FLOWS`
    sense_flow: bool = False  # records carry the flow's velocity and spin too
    varying_speed: bool = False  # v₁ with κ₁ … v₂ with κ₂ instead of one speed
    life: float = 80.0  # t_life [time], paper table 1
    start_box: tuple[tuple[float, float], tuple[float, float]] | None = None  # ((x, x), (y, y)), see `box`
    curvatures: tuple[float, ...] = (3.0, 5.0)  # κ₁ … κ_m, evenly spaced [1 / length], paper table 1
    speed: float = 1.0  # v [length / time], paper table 1
    speeds: tuple[float, float] = (1.1, 0.9)  # v₁, v₂, paper table 1
    time_step: float = 0.02  # Δt, the tick that intervals are rounded down to [time], paper table 1
    interval_rule: str = "truncated"  # ΔT = int(T/(N_T Δt)) Δt, or "exact": T/N_T
    concentration_noise: float = 0.0  # standard deviation of a record's concentration [concentration]
    curvature_noise: float = 0.0  # standard deviation of the curvature swum during an interval [1 / length]
    rotational_diffusion: float = 0.0  # D of the heading: variance 2 D ΔT per interval [rad² / time]

    def __post_init__(self) -> None:
        for name, known in (("field", FIELDS), ("flow", FLOWS)):
            value = getattr(self, name)
            if isinstance(value, str):
                object.__setattr__(self, name, known[check_name(name, value, known)]())
        check_methods("field", self.field, ["concentration"], ["gradient_scale"])
        check_methods("flow", self.flow, ["velocity", "spin"], ["speed_scale", "spin_scale"])
        check_number("field.gradient_scale", self.field.gradient_scale, above=0.0)
        for name in ("speed_scale", "spin_scale"):
            check_number(f"flow.{name}", getattr(self.flow, name), at_least=0.0)
        object.__setattr__(self, "n_records", check_count("n_records", self.n_records, at_least=2))
        for name in ("sense_flow", "varying_speed"):
            object.__setattr__(self, name, check_flag(name, getattr(self, name)))
        for name in ("life", "speed", "time_step"):
            object.__setattr__(self, name, check_number(name, getattr(self, name), above=0.0))
        for name in ("concentration_noise", "curvature_noise", "rotational_diffusion"):
            object.__setattr__(self, name, check_number(name, getattr(self, name), at_least=0.0))
        check_name("interval_rule", self.interval_rule, INTERVAL_RULES)
        object.__setattr__(self, "curvatures", _check_curvatures(self.curvatures))
        object.__setattr__(self, "speeds", _check_speeds(self.speeds))
        if self.start_box is not None:
            object.__setattr__(self, "start_box", check_box("start_box", self.start_box))
        for item in ("field", "flow"):
            _check_options(item, getattr(self, item))
        units: set[Any] = {getattr(part, "length_unit", None) for part in (self.field, self.flow)} - {None}
        if len(units) > 1:
            raise ValueError(f"field and flow must have positions in the same unit, got {sorted(units)}")
        if self.sense_flow and not (self.flow.speed_scale > 0 and self.flow.spin_scale > 0):
            raise ValueError(
                "sense_flow needs a flow with speed_scale and spin_scale above 0 to normalise by, "
                f"got speed_scale {self.flow.speed_scale:g} and spin_scale {self.flow.spin_scale:g}"
            )
        rates = tuple(self.mean_curvature * speed for speed in self.action_speeds)
        if not all(1e-9 < rate < 1e9 for rate in rates):
            raise ValueError(
                f"mean curvature × speed must lie between 1e-9 and 1e9 rad per time, got {rates}"
            )
        steps = max(self.periods) / (self.n_records * self.time_step)
        if self.interval_rule == "truncated" and steps > MAX_TICKS:
            raise ValueError(
                f"time_step must leave at most {MAX_TICKS} steps per decision, got time_step = "
                f"{self.time_step:g} with period 2π/(κ̄ speed) = {max(self.periods):g} and "
                f"n_records = {self.n_records}"
            )
        if self.life / self.tick > 2**30:
            raise ValueError(f"life must be at most 2^30 ticks of {self.tick:g}, got {self.life:g}")
        if min(self.interval_ticks) < 1:
            raise ValueError(
                "n_records must leave at least one time_step per decision: T/(N_T Δt) must reach 1, got "
                f"n_records = {self.n_records} with period 2π/(κ̄ speed) = {min(self.periods):g} and "
                f"time_step = {self.time_step:g}"
            )
        if self.in_flow:
            _ = self.scheme  # raises where the flow varies too fast

    def replace(self, **changes: Any) -> World:
        """A copy with other parameters, checked again."""
        unknown = set(changes) - {item.name for item in dataclasses.fields(self)}
        if unknown:
            check_name("parameter", unknown.pop(), [item.name for item in dataclasses.fields(self)])
        return dataclasses.replace(self, **changes)

    # --- what follows from the parameters ------------------------------------------------------------------

    @cached_property
    def n_actions(self) -> int:
        """m, the number of curvatures."""
        return len(self.curvatures)

    @property
    def box(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Where starts are drawn: `start_box`, else the flow's `box` or one period of it, else the field's,
        else [0, 10]²."""
        if self.start_box is not None:
            return self.start_box
        period = getattr(self.flow, "period", None)
        box = getattr(self.flow, "box", None)
        if box is None and period is None:
            box = getattr(self.field, "box", None)
        if box is not None:
            return box
        return DEFAULT_BOX if period is None else ((0.0, float(period)), (0.0, float(period)))

    @property
    def features(self) -> int:
        """Numbers in a record: 2, or 5 with the flow sensed."""
        return 5 if self.sense_flow else 2

    @property
    def observation_size(self) -> int:
        """N_T · features."""
        return self.n_records * self.features

    @cached_property
    def mean_curvature(self) -> float:
        """κ̄ [1 / length]."""
        return 0.5 * (self.curvatures[0] + self.curvatures[-1])

    @cached_property
    def action_speeds(self) -> tuple[float, ...]:
        """Speed with each action [length / time]."""
        if not self.varying_speed:
            return (self.speed,) * self.n_actions
        return tuple(float(v) for v in np.linspace(*self.speeds, self.n_actions))

    @property
    def periods(self) -> tuple[float, ...]:
        """T = 2π/(κ̄ v) with each action [time] (paper: average period)."""
        return tuple(2 * math.pi / (self.mean_curvature * speed) for speed in self.action_speeds)

    @cached_property
    def has_common_tick(self) -> bool:
        """Whether all intervals are whole numbers of one tick."""
        return self.interval_rule == "truncated" or len(set(self.action_speeds)) == 1

    @cached_property
    def tick(self) -> float:
        """Unit of the clock [time]: Δt, or one decision where intervals are exact."""
        return self.time_step if self.interval_rule == "truncated" else self.periods[0] / self.n_records

    @cached_property
    def interval_ticks(self) -> tuple[int, ...]:
        """Ticks of a decision with each action. Paper: ΔT is rounded down to whole integration steps."""
        if self.interval_rule == "exact":
            return (1,) * self.n_actions
        # the small number keeps a quotient that is whole but for rounding
        return tuple(int(period / (self.n_records * self.time_step) + 1e-9) for period in self.periods)

    @property
    def intervals(self) -> tuple[float, ...]:
        """ΔT with each action [time]."""
        if self.interval_rule == "exact":
            return tuple(period / self.n_records for period in self.periods)
        return tuple(ticks * self.time_step for ticks in self.interval_ticks)

    @cached_property
    def life_ticks(self) -> int:
        """Ticks of a life; the last one may be cut short."""
        return max(1, math.ceil(self.life / self.tick - 1e-9))

    @property
    def max_decisions(self) -> int:
        """The most decisions a life can take."""
        return max(1, math.ceil(self.life / min(self.intervals) - 1e-9))

    @cached_property
    def has_noise(self) -> bool:
        """Whether any perturbation is on, so that `step` needs noise."""
        return max(self.concentration_noise, self.curvature_noise, self.rotational_diffusion) > 0

    @cached_property
    def in_flow(self) -> bool:
        """Whether there is a flow to integrate."""
        return not isinstance(self.flow, StillWater)

    @cached_property
    def reward_scale(self) -> float:
        """Reward per change of a normalised record: c_k/κ̄ over N_T c_k |1/κ₁ − 1/κ_m|."""
        contrast = abs(1 / self.curvatures[0] - 1 / self.curvatures[-1])
        return 1 / (self.mean_curvature * self.n_records * contrast)

    @cached_property
    def record_scale(self) -> float:
        """κ̄/c_k, by which records hold concentrations."""
        return self.mean_curvature / self.field.gradient_scale

    @cached_property
    def egg(self) -> tuple[tuple[float, float], float] | None:
        """Position and radius of the egg, or None."""
        radius = getattr(self.field, "egg_radius", None)
        if radius is None:
            return None
        return check_point("egg_position", getattr(self.field, "egg_position", (0.0, 0.0))), float(radius)

    @cached_property
    def domains(self) -> tuple[Any, ...]:
        """The field's and the flow's `inside`, where they have one."""
        parts = (getattr(part, "inside", None) for part in (self.field, self.flow))
        return tuple(inside for inside in parts if inside is not None)

    @cached_property
    def scheme(self) -> swimmer.Collocation:
        """How an interval in the flow is integrated."""
        duration = max(self.intervals)
        lengths = [
            speed * interval for speed, interval in zip(self.action_speeds, self.intervals, strict=True)
        ]
        turns = [kappa * length for kappa, length in zip(self.curvatures, lengths, strict=True)]
        spacing = self.time_step if self.egg is not None else None
        return swimmer.Collocation.for_interval(self.flow, max(turns), max(lengths), duration, spacing)

    @property
    def observation_bounds(self) -> np.ndarray:
        """Bounds b (observation_size,) float32 with −b <= observation <= b."""
        largest = float(np.finfo(np.float32).max)
        gradient = getattr(self.field, "max_gradient", None)
        current = getattr(self.flow, "max_speed", None)
        if gradient is None or current is None or self.concentration_noise > 0:
            reach = largest
        else:  # a record differs from the mean by less than the path between the first and the last record
            steps = [
                (speed + current) * dt for speed, dt in zip(self.action_speeds, self.intervals, strict=True)
            ]
            reach = 1.001 * (self.n_records - 1) * max(steps) * gradient * self.record_scale + 1e-3
        spin = getattr(self.flow, "max_spin", None)
        scales = (
            (current, self.flow.speed_scale),
            (current, self.flow.speed_scale),
            (spin, self.flow.spin_scale),
        )
        sensed = [
            largest if bound is None or scale == 0 else 1.001 * bound / scale + 1e-6
            for bound, scale in scales
        ]
        return np.tile(np.array([reach, 1.001, *sensed][: self.features], np.float32), self.n_records)

    # --- tables --------------------------------------------------------------------------------------------

    @cached_property
    def _table_width(self) -> int:
        """Columns of the tables for each action."""
        return max(self.interval_ticks) + 2

    @cached_property
    def _cached_tables(self) -> dict[Any, Tables]:
        return {}

    def tables(self, like: Array) -> Tables:
        """The tables in the array library, dtype and device of `like`."""
        xp = namespace(like)
        cacheable = type(like).__module__ in ("numpy", "torch")  # a jax tracer must not outlive its trace
        key = (type(like).__module__, like.dtype, str(like.device)) if cacheable else None
        tables = self._cached_tables.get(key)
        if tables is None:
            weights = as_array(self.scheme.weights, like) if self.in_flow else None
            ticks = self.interval_ticks if len(set(self.interval_ticks)) > 1 else self.interval_ticks[:1]
            whole = as_array(np.asarray(ticks), like, dtype=xp.int32)
            last = as_array(np.asarray([max(ticks) + 1]), like, dtype=xp.int32)
            tables = Tables(as_array(self._rows(), like), whole, last, weights)
            if cacheable:
                self._cached_tables[key] = tables
        return tables

    def _rows(self) -> np.ndarray:
        """`Tables.rows` in float64."""
        left = np.tile(np.arange(self._table_width), self.n_actions)
        action = np.repeat(np.arange(self.n_actions), self._table_width)
        whole = np.asarray(self.interval_ticks)[action]
        slack = self.life_ticks * self.tick - self.life  # what is missing of the last tick
        clipped = np.maximum(left * self.tick - slack, 0.0)
        duration = np.where(left > whole, np.asarray(self.intervals)[action], clipped)
        curvature, speed = np.asarray(self.curvatures)[action], np.asarray(self.action_speeds)[action]
        motion = self._motion(curvature, speed, duration)
        parts = (part.reshape(-1, len(left)) for part in motion)
        return np.vstack([self.normal_curvature(curvature), duration, speed, *parts])

    def _motion(self, curvature: Array, speed: Array, duration: Array) -> Motion:
        """Motion (2, ...) of an arc, or in a flow to all the scheme's targets (2, targets, ...)."""
        if not self.in_flow:
            return swimmer.arc(curvature, speed, duration)
        return self.scheme.motions(curvature, speed, duration)

    def normal_curvature(self, curvature: Array) -> Array:
        """κ* = 2 (κ − κ̄)/|κ₁ − κ_m| (paper: normalisation of curvature)."""
        return (curvature - self.mean_curvature) * (2 / (self.curvatures[-1] - self.curvatures[0]))

    # --- start and step ------------------------------------------------------------------------------------

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
            curvature, speed, interval = (_look_up(values, past[..., i]) for values in by_action)
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
        clock, motion, duration, speed, normal_curvature = self._interval(state, action, noise)
        if compiling(position) and not (self.in_flow and self.scheme.outputs):
            motion = Motion(*(in_pieces(part, 2 if self.in_flow else 1) for part in motion))
        if self.in_flow:
            weights = self.tables(position).weights
            pose, path = self.scheme.swim(state.pose, motion, speed, duration, weights, self.flow)
        else:
            pose, path = swimmer.along_arc(state.pose, motion), None
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
        truncated = finished = self._time_is_up(clock)
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

    def _interval(self, state: State, action: Array, noise: Array) -> tuple[Array, ...]:
        """Clock after it, motion, duration, speed and κ* of each cell's next interval."""
        if not self.has_common_tick:
            return self._counted_interval(state, action, noise)
        tables = self.tables(state.position)
        xp = namespace(state.position)
        action = xp.astype(action, xp.int32, copy=False)
        left = self.life_ticks - state.clock
        if self.egg is not None or self.domains:
            left = xp.where(state.finished, xp.zeros_like(left), left)
        whole = tables.whole if tables.whole.shape[0] == 1 else _look_up(tables.whole, action)
        clock = state.clock + xp.minimum(left, whole)
        column = action * self._table_width + xp.minimum(left, tables.last)
        rows = _look_up(tables.rows, column)
        normal_curvature, duration, speed = rows[0, ...], rows[1, ...], rows[2, ...]
        if self.curvature_noise > 0:
            curvature = self._curvature(action, state.position) + self.curvature_noise * noise[..., 1]
            motion = self._motion(curvature, speed, duration)
        else:
            parts = xp.reshape(rows[3:, ...], (4, -1, *column.shape)) if self.in_flow else rows[3:, ...]
            motion = Motion(parts[:2, ...], parts[2:, ...])
        return clock, motion, duration, speed, normal_curvature

    def _counted_interval(self, state: State, action: Array, noise: Array) -> tuple[Array, ...]:
        """`_interval` where no common tick exists: decisions are counted by action, so rounding never piles
        up."""
        xp = namespace(state.position)
        curvatures, speeds, intervals = (
            as_array(np.asarray(values), state.position)
            for values in (self.curvatures, self.action_speeds, self.intervals)
        )
        left = self.life - self.time(state)
        whole, speed = _look_up(intervals, action), _look_up(speeds, action)
        duration = xp.minimum(whole, left)
        duration = xp.where(state.finished | self._time_is_up(state.clock), xp.zeros_like(left), duration)
        actions = as_array(np.arange(self.n_actions), action)
        taken = xp.astype(action[..., None] == actions, xp.int32)
        clock = state.clock + xp.where((duration > 0)[..., None], taken, xp.zeros_like(taken))
        commanded = _look_up(curvatures, action)
        swum = commanded + self.curvature_noise * noise[..., 1] if self.curvature_noise > 0 else commanded
        return clock, self._motion(swum, speed, duration), duration, speed, self.normal_curvature(commanded)

    def _time_is_up(self, clock: Array) -> Array:
        if self.has_common_tick:
            return at_least(clock, self.life_ticks)
        return self._elapsed(clock, clock) >= self.life * (1 - 1e-6)

    def _elapsed(self, clock: Array, like: Array) -> Array:
        xp = namespace(clock)
        dtype = like.dtype if xp.isdtype(like.dtype, "real floating") else xp.float32
        if self.has_common_tick:
            return xp.astype(clock, dtype) * self.tick
        return xp.sum(
            xp.astype(clock, dtype) * as_array(np.asarray(self.intervals), clock, dtype=dtype), axis=-1
        )

    def time(self, state: State) -> Array:
        """Time lived (..., cells), `life` exactly when it is up [time]."""
        elapsed = self._elapsed(state.clock, state.position)
        xp = namespace(elapsed)
        life = xp.full_like(elapsed, self.life)
        return xp.where(self._time_is_up(state.clock), life, xp.minimum(elapsed, life))

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

    def _curvature(self, action: Array, like: Array) -> Array:
        return _look_up(as_array(np.asarray(self.curvatures), like), action)

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
            curvature = self._curvature(action, pose.position)
            if self.curvature_noise > 0:
                curvature = curvature + self.curvature_noise * noise[..., 1]
            speed = _look_up(as_array(np.asarray(self.action_speeds), pose.position), action)
            nearest = swimmer.closest_approach(state.pose, curvature, speed * duration, centre)
            reached = nearest <= radius
        else:
            from_egg = xp.concat([path, pose.position[None, ...]], axis=0) - as_array(
                np.asarray(centre), path
            )
            reached = xp.any(from_egg[..., 0] ** 2 + from_egg[..., 1] ** 2 <= radius**2, axis=0)
        return reached & ~state.finished


def _look_up(table: Array, index: Array) -> Array:
    """`table[..., index]` for whole-number arrays of any shape."""
    xp = namespace(table)
    if index.ndim == 1:
        return xp.take(table, index, axis=-1)
    taken = xp.take(table, xp.reshape(index, (-1,)), axis=-1)
    return xp.reshape(taken, (*table.shape[:-1], *index.shape))


def _check_curvatures(values: Any) -> tuple[float, ...]:
    try:
        curvatures = tuple(check_number("curvatures", value) for value in values)
    except TypeError:
        raise TypeError(f"curvatures must be two or more numbers, got {values!r}") from None
    if len(curvatures) < 2:
        raise ValueError(f"curvatures must be two or more numbers, got {values!r}")
    steps = np.diff(curvatures)
    if curvatures[0] <= 0 or np.any(steps <= 1e-9 * curvatures[-1]):
        raise ValueError(f"curvatures must rise and be positive, got {curvatures}")
    if np.ptp(steps) > 1e-9 * steps[0]:
        raise ValueError(f"curvatures must be evenly spaced, got {curvatures}")
    return curvatures


def _check_speeds(values: Any) -> tuple[float, float]:
    try:
        first, last = (check_number("speeds", value, above=0.0) for value in values)
    except TypeError:
        raise TypeError(f"speeds must be two positive numbers, got {values!r}") from None
    except ValueError:
        raise ValueError(f"speeds must be two positive numbers, got {values!r}") from None
    return first, last


def _check_options(name: str, part: Any) -> None:
    """Checks what a field or a flow need not have."""
    for option in ("max_gradient", "max_speed", "max_spin", "max_shear"):
        if getattr(part, option, None) is not None:
            check_number(f"{name}.{option}", getattr(part, option), at_least=0.0)
    for option in ("period", "egg_radius"):
        if getattr(part, option, None) is not None:
            check_number(f"{name}.{option}", getattr(part, option), above=0.0)
    if getattr(part, "egg_radius", None) is not None:
        check_point(f"{name}.egg_position", getattr(part, "egg_position", (0.0, 0.0)))
    if getattr(part, "box", None) is not None:
        check_box(f"{name}.box", part.box)
    if getattr(part, "inside", None) is not None:
        check_function(f"{name}.inside", part.inside)
