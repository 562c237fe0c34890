"""The parameters of a world, each with its rule, and every number that follows from them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter
from typing import Any, Self

import numpy as np

from swarm._support.checks import (
    Box,
    Checked,
    check_box,
    check_count,
    check_flag,
    check_name,
    check_number,
    check_pair,
    check_point,
    check_rule,
    optional,
    parameter,
)
from swarm.physics import species
from swarm.physics.crowd.interactions import Interaction, check_interactions
from swarm.physics.crowd.medium import Medium, check_medium
from swarm.physics.crowd.spread import Spread, check_spread
from swarm.physics.fields import Field
from swarm.physics.flows import Flow, StillWater
from swarm.physics.motion import clock
from swarm.physics.motion.clock import Clock
from swarm.physics.motion.helical import HelicalSwimmer
from swarm.physics.motion.swimmer import Swimmer
from swarm.physics.perception import Memory, MemoryWithFlow, MemoryWithFlowInSpace, Sensor, check_sensor
from swarm.physics.rewards import Reward, check_reward
from swarm.physics.world import rules
from swarm.physics.world.actions import ACTIONS, Actions, check_range
from swarm.physics.world.race import Race

Array = Any

DEFAULT_SIDE = 10.0  # of the start box [length]


@dataclass(frozen=True)
class Parameters(Actions, Checked):
    """Parameters of a world; the paper's values are the defaults. They check themselves when made.

    A field, a flow, a sensor or a reward is an object, its name, or `{"type": name, parameter: value, …}`.
    Raises TypeError or ValueError that names the parameter, the rule and the value.
    """

    n_records: int = parameter(4, check_count, at_least=2)  # N_T, records a cell keeps
    field: Field = parameter("linear", rules.check_field)
    flow: Flow = parameter("still", rules.check_flow)
    sense_flow: bool = parameter(False, check_flag)  # short for sensor="memory_with_flow"
    varying_speed: bool = parameter(False, check_flag)  # v₁ with κ₁ … v₂ with κ₂ instead of one speed
    life: float = parameter(80.0, check_number, above=0.0)  # t_life [time], paper table 1
    start_box: Box | None = parameter(None, optional(check_box))  # a side for each dimension [length]
    curvatures: tuple[float, ...] = parameter(
        (3.0, 5.0), rules.check_curvatures
    )  # κ₁ … κ_m [1 / length], table 1
    speed: float = parameter(1.0, check_number, above=0.0)  # v [length / time], paper table 1
    speeds: tuple[float, float] = parameter(  # v₁, v₂, paper table 1
        (1.1, 0.9), check_pair, rule="two positive numbers", above=0.0
    )
    time_step: float = parameter(0.02, check_number, above=0.0)  # Δt, tick of the clock [time], paper table 1
    interval_rule: str = parameter("truncated", check_name, known=clock.RULES)  # ΔT, see `Clock`
    # standard deviation of a record's concentration [concentration], and of the curvature swum during an
    # interval [1 / length]; D of the heading, whose variance is 2 D ΔT per interval [rad² / time]
    concentration_noise: float = parameter(0.0, check_number, at_least=0.0)
    curvature_noise: float = parameter(0.0, check_number, at_least=0.0)
    rotational_diffusion: float = parameter(0.0, check_number, at_least=0.0)
    # D that kicks of the curvature give the heading whatever N_T, see `curvature_spreads` [rad² / time]
    curvature_diffusion: float = parameter(0.0, check_number, at_least=0.0)
    sensor: Sensor = parameter(None, optional(check_sensor))  # what a record holds; None: see `sense_flow`
    reward: Reward = parameter("own", check_reward)
    # what cells share; with any of these on, all decide at the same moments
    interactions: tuple[Interaction, ...] = parameter((), check_interactions)
    medium: Medium | None = parameter(None, optional(check_medium))
    first_arrivals: int | None = parameter(None, optional(check_count))  # that win, and end the episode
    block_delay: float = parameter(0.0, check_number, at_least=0.0)  # so long after the last of them [time]
    binding_rate: float | None = parameter(  # λ_b, molecules bound per concentration [1 / (conc. · time)]
        None, optional(check_number), above=0.0
    )
    spread: Spread | None = parameter(None, optional(check_spread))  # of speeds and curvatures over cells
    units: tuple[str, str] | None = parameter(
        None, optional(rules.check_units)
    )  # of length and time, told in results
    # what a cell chooses: one of `curvatures`, or any curvature of the range, by default from κ₁ to κ_m
    action: str = parameter("discrete", check_name, known=ACTIONS)
    curvature_range: tuple[float, float] | None = parameter(None, optional(check_range))  # [1 / length]
    # of each action, with its curvature: cells swim helices in space; None: in the plane [1 / length]
    torsions: tuple[float, ...] | None = parameter(
        None, optional(rules.check_numbers), rule="a number for each of curvatures"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.sensor is None:
            with_flow = MemoryWithFlow if self.torsions is None else MemoryWithFlowInSpace
            object.__setattr__(self, "sensor", with_flow() if self.sense_flow else Memory())
        senses_flow = isinstance(self.sensor, MemoryWithFlow)
        rule = "sense_flow must go with the sensor memory_with_flow"
        check_rule(senses_flow or not self.sense_flow, rule, repr(self.sensor))
        object.__setattr__(self, "sense_flow", senses_flow)
        self._check_actions()
        rules.check_dimensions(self)
        rules.check_length_units(self.units, self.field, self.flow)
        for part in (self.sensor, self.reward):
            if hasattr(part, "check"):
                part.check(self)
        rates = tuple(self.mean_curvature * speed for speed in self.action_speeds)
        rule = "mean curvature × speed must lie between 1e-9 and 1e9 rad per time"
        check_rule(all(1e-9 < rate < 1e9 for rate in rates), rule, rates)
        rules.check_times(self.life, field=self.field, flow=self.flow)
        try:
            _ = self.swimmer.scheme  # raises where intervals cannot be counted or the flow varies too fast
        except ArithmeticError:
            raise ValueError(f"flow must vary slowly enough to be followed, got {self.flow!r}") from None
        self._check_company()
        rules.check_scale(self)

    def _check_company(self) -> None:
        """Raises ValueError where what cells share does not go with the rest."""
        check_rule(
            not self.is_shared or len(set(self.clock.intervals)) == 1,
            "interval_rule must be 'common' where cells share a medium, interact, race or sense others, so "
            "that all decide at the same moments",
            f"{self.interval_rule!r} with {self.clock.intervals}",
        )
        races, noise, delay = self.first_arrivals is not None, self.concentration_noise, self.block_delay
        rule = "first_arrivals must go with a field that has an egg"
        check_rule(not races or self.egg is not None, rule, repr(self.field))
        check_rule(races or delay == 0, "block_delay must go with first_arrivals", f"{delay:g} without")
        rule = "concentration_noise must be 0 where bindings are counted (binding_rate)"
        check_rule(self.binding_rate is None or noise == 0, rule, f"{noise:g}")
        for each in self.interactions:
            rule = "core must be above 0 in a world, whose cells may touch"
            check_rule(getattr(each, "core", None) != 0, rule, repr(each))
        _ = self.swimmer.company  # raises where they vary too fast
        if self.medium is not None:
            self.medium.check(
                self.field,
                self.flow,
                start_box=self.box,
                interval=max(self.intervals),
                speed=self.fastest,
                curvature=self.largest_curvature * (1.0 if self.spread is None else self.spread.largest[1]),
            )

    @classmethod
    def for_species(cls, name: str, **changes: Any) -> Self:
        """The default world at the scale of a [species][swarm.physics.species], in µm and s; other parameters
        are in these units. Raises ValueError for a species that is not known.
        """
        return cls(**{**species.parameters(name), **changes})

    @classmethod
    def in_space(cls, **changes: Any) -> Self:
        """The default world in three dimensions, whose two helices turn opposite ways along the gradient, see
        `docs/space.md`. Raises ValueError without torsions, which make the plane."""
        given = {"curvatures": (5.5, 7.5), "torsions": (7.7, 5.7), "speed": 2.0, **changes}
        check_rule(
            given["torsions"] is not None, "torsions must be a number for each of curvatures in space", None
        )
        return cls(**given)

    @classmethod
    def defaults(cls) -> dict[str, Any]:
        """Names and defaults of all parameters, in their order."""
        return {item.name: item.default for item in dataclasses.fields(cls)}

    def replace(self, **changes: Any) -> Self:
        """A copy with other parameters, checked again."""
        for name in changes:
            check_name("parameter", name, self.defaults())
        if "sense_flow" in changes:  # one of these follows from the other
            changes.setdefault("sensor", None)
        elif "sensor" in changes:
            changes["sense_flow"] = False
        return dataclasses.replace(self, **changes)

    def described(self) -> dict[str, Any]:
        """All parameters as plain data, from which the same world can be made; a part of a user's own class,
        or one that is more than plain data, is told by the name of its class.
        """
        return {
            item.name: rules.as_data(item.name, getattr(self, item.name)) for item in dataclasses.fields(self)
        }

    @property
    def box(self) -> Box:
        """Where starts are drawn: `start_box`, else the flow's `box` or one period of it, else the field's,
        else [0, 10]², in space [0, 10]³."""
        if self.start_box is not None:
            return self.start_box
        period = getattr(self.flow, "period", None)
        box = getattr(self.flow, "box", None)
        if box is None and period is None:
            box = getattr(self.field, "box", None)
        if box is not None:
            return box
        return self.dimensions * ((0.0, DEFAULT_SIDE if period is None else float(period)),)

    @cached_property
    def features(self) -> int:
        """Numbers in a record."""
        return len(self.sensor.names)

    @property
    def observation_size(self) -> int:
        """N_T · features."""
        return self.n_records * self.features

    @property
    def periods(self) -> tuple[float, ...]:
        """T = 2π/(w̄ v) with each action [time]; in the plane w̄ is κ̄ (paper: average period)."""
        return tuple(2 * math.pi / (self.mean_turning * speed) for speed in self.action_speeds)

    @cached_property
    def clock(self) -> Clock:
        """When cells decide, and how long they live."""
        periods = self.periods
        if self.interval_rule == "common":  # T of the mean speed for all
            mean = sum(self.action_speeds) / self.n_actions
            periods = (2 * math.pi / (self.mean_turning * mean),) * self.n_actions
        return Clock(periods, self.n_records, self.life, self.time_step, self.interval_rule)

    has_common_tick = property(attrgetter("clock.has_common_tick"))
    tick = property(attrgetter("clock.tick"))
    interval_ticks = property(attrgetter("clock.interval_ticks"))
    intervals = property(attrgetter("clock.intervals"))
    life_ticks = property(attrgetter("clock.life_ticks"))
    max_decisions = property(attrgetter("clock.max_decisions"))

    @cached_property
    def swimmer(self) -> Swimmer:
        """What each action does."""
        spacing = self.time_step if self.egg is not None else None  # of the places where its path is tested
        shared = self.interactions, self.spread, self.action_range
        given = self.curvatures, self.action_speeds, self.clock, self.flow, spacing, *shared
        return Swimmer(*given) if self.torsions is None else HelicalSwimmer(*given, self.torsions)

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        return ("x", "y", "z")[: self.dimensions]

    @cached_property
    def race(self) -> Race | None:
        """Who wins, or None where nobody races."""
        return None if self.first_arrivals is None else Race(self.first_arrivals, self.block_delay)

    @cached_property
    def is_shared(self) -> bool:
        """Whether what one cell does can matter to another."""
        meets = bool(self.interactions) or getattr(self.sensor, "senses_others", False)
        return meets or self.medium is not None or self.first_arrivals is not None

    @cached_property
    def has_noise(self) -> bool:
        """Whether any perturbation is on, so that `step` needs noise."""
        noise = self.concentration_noise, self.curvature_noise, self.rotational_diffusion
        return max(*noise, self.curvature_diffusion) > 0 or self.binding_rate is not None

    @cached_property
    def in_flow(self) -> bool:
        """Whether there is a flow to integrate."""
        return not isinstance(self.flow, StillWater)

    @cached_property
    def is_steady(self) -> bool:
        """Whether neither field nor flow changes with time."""
        return not any(hasattr(part, "at") for part in (self.field, self.flow))

    @cached_property
    def record_scale(self) -> float:
        """κ̄/c_k, by which records hold concentrations."""
        return self.mean_curvature / self.field.gradient_scale

    @cached_property
    def egg(self) -> tuple[Any, float] | None:
        """Position (dimensions numbers; one of two in space lies on z = 0) and radius of the egg, or None."""
        radius = getattr(self.field, "egg_radius", None)
        if radius is None:
            return None
        place = check_point("egg_position", getattr(self.field, "egg_position", (0.0, 0.0)))
        return (*place, 0.0)[: max(len(place), self.dimensions)], float(radius)

    @cached_property
    def domains(self) -> tuple[Any, ...]:
        """The field's and the flow's `inside`, where they have one."""
        parts = [getattr(part, "inside", None) for part in (self.field, self.flow)]
        if self.medium is not None and self.medium.leaving == "truncate":
            parts.append(self.medium.inside)
        return tuple(inside for inside in parts if inside is not None)

    @property
    def observation_bounds(self) -> np.ndarray:
        """Bounds b (observation_size,) float32 with −b <= observation <= b."""
        bounds: Sequence[float] = self.sensor.bounds(self)
        rule = f"sensor.bounds must be a number for each of {', '.join(self.sensor.names)}"
        check_rule(len(bounds) == self.features, rule, bounds)
        return np.tile(np.array(bounds, np.float32), self.n_records)
