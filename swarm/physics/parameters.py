"""The parameters of a world, and every number that follows from them."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np

from swarm._support.checks import check_name, check_point
from swarm.physics import parameter_checks
from swarm.physics.fields import FIELDS, Field, LinearField
from swarm.physics.flows import FLOWS, Flow, StillWater
from swarm.physics.motion import swimmer

Array = Any

DEFAULT_BOX = ((0.0, 10.0), (0.0, 10.0))


@dataclass(frozen=True)
class Parameters:
    """Parameters of a world; the paper's values are the defaults. They check themselves when made.

    Raises TypeError or ValueError that names the parameter, the rule and the value.
    """

    n_records: int = 4  # N_T, records a cell keeps
    field: Field = dataclasses.field(default_factory=LinearField)  # or its name, or {type: name, …}
    flow: Flow = dataclasses.field(default_factory=StillWater)  # likewise
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
        object.__setattr__(self, "field", FIELDS.make(self.field))
        object.__setattr__(self, "flow", FLOWS.make(self.flow))
        for name, value in parameter_checks.checked(self).items():
            object.__setattr__(self, name, value)
        parameter_checks.check_together(self)
        parameter_checks.check_times(self)
        if self.in_flow:
            _ = self.scheme  # raises where the flow varies too fast

    def replace(self, **changes: Any) -> Self:
        """A copy with other parameters, checked again."""
        unknown = set(changes) - {item.name for item in dataclasses.fields(self)}
        if unknown:
            check_name("parameter", unknown.pop(), [item.name for item in dataclasses.fields(self)])
        return dataclasses.replace(self, **changes)

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

    def normal_curvature(self, curvature: Array) -> Array:
        """κ* = 2 (κ − κ̄)/|κ₁ − κ_m| (paper: normalisation of curvature)."""
        return (curvature - self.mean_curvature) * (2 / (self.curvatures[-1] - self.curvatures[0]))
