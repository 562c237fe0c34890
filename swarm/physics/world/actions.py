"""What a cell can do: one of several curvatures, or any of a range, and the numbers that follow from them."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any

import numpy as np

from swarm._support.arrays import as_array, look_up, namespace
from swarm._support.checks import check_pair, check_rule
from swarm.physics.crowd.spread import Spread

Array = Any

ACTIONS = ("discrete", "continuous")
SLACK = 1e-6  # by which curvatures may be off their range, per its largest: float32 rounds


def check_range(name: str, value: Any) -> tuple[float, float]:
    """Return `value` as the lowest and the highest curvature; raises unless they are two that rise."""
    low, high = check_pair(name, value, rule="two finite numbers, the lowest and the highest")
    check_rule(high - low > 1e-9 * max(abs(low), abs(high)), f"{name} must rise", repr(value))
    return low, high


class Actions:
    """The part of a world's parameters that concerns actions.

    An action is a whole number 0 … m − 1 that chooses among `curvatures`; in a world of `continuous` actions
    it is the curvature itself [1 / length]. There the clock, all scales and the past before t = 0 stay those
    of `curvatures`.
    """

    curvatures: tuple[float, ...]
    torsions: tuple[float, ...] | None
    speed: float
    speeds: tuple[float, float]
    varying_speed: bool
    action: str
    curvature_range: tuple[float, float] | None
    n_records: int
    curvature_noise: float
    curvature_diffusion: float
    spread: Spread | None
    intervals: Any
    swimmer: Any

    def _check_actions(self) -> None:
        """Raises ValueError where the parameters of actions do not go together."""
        steered, limits = self.is_continuous, self.curvature_range
        rule = "curvature_range must go with action='continuous'"
        check_rule(steered or limits is None, rule, f"{limits} with {self.action!r}")
        rule = "action='continuous' must go with one speed"
        check_rule(not steered or not self.varying_speed, rule, "varying_speed=True")
        slow = self.largest_curvature * self.speed < 1e9
        check_rule(not steered or slow, "curvature_range × speed must lie below 1e9 rad per time", limits)

    @cached_property
    def n_actions(self) -> int:
        """m, the number of curvatures."""
        return len(self.curvatures)

    @cached_property
    def is_continuous(self) -> bool:
        """Whether an action is a curvature."""
        return self.action == "continuous"

    @cached_property
    def action_range(self) -> tuple[float, float] | None:
        """The lowest and the highest curvature that a continuous action can be [1 / length]; else None."""
        if not self.is_continuous:
            return None
        return self.curvature_range or (self.curvatures[0], self.curvatures[-1])

    @cached_property
    def curvature_bounds(self) -> tuple[float, float]:
        """The lowest and the highest curvature that cells choose, or had chosen before t = 0 [1 / length]."""
        ends = self.curvatures[0], self.curvatures[-1], *(self.action_range or ())
        return min(ends), max(ends)

    @cached_property
    def largest_curvature(self) -> float:
        """The largest size of a curvature [1 / length]."""
        return max(map(abs, self.curvature_bounds))

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
    def fastest(self) -> float:
        """The highest speed of any cell [length / time]."""
        return max(self.action_speeds) * (1.0 if self.spread is None else self.spread.largest[0])

    @cached_property
    def curvature_spreads(self) -> tuple[float, ...]:
        """Standard deviation of the curvature swum with each action [1 / length].

        A kick of the curvature turns the heading by v ΔT times as much: with the variance 2 D / (v² ΔT) that
        is a variance of 2 D ΔT in an interval, so 2 D t in a time t however often cells decide, as rotational
        diffusion has it. That of `curvature_noise`, which is the same for each N_T, is added.
        """
        pairs = zip(self.action_speeds, self.intervals, strict=True)
        variances = (2 * self.curvature_diffusion / (v * v * interval) for v, interval in pairs)
        return tuple(math.sqrt(self.curvature_noise**2 + each) for each in variances)

    @cached_property
    def reward_scale(self) -> float:
        """Reward per change of a normalised record: c_k/κ̄ over N_T c_k |1/κ₁ − 1/κ_m|."""
        contrast = abs(1 / self.curvatures[0] - 1 / self.curvatures[-1])
        return 1 / (self.mean_curvature * self.n_records * contrast)

    def normal_curvature(self, curvature: Array) -> Array:
        """κ* = 2 (κ − κ̄)/|κ₁ − κ_m| (paper: normalisation of curvature)."""
        return self.swimmer.normal_curvature(curvature)

    @cached_property
    def dimensions(self) -> int:
        """2, the plane, or 3, space: where actions have torsions."""
        return 2 if self.torsions is None else 3

    @cached_property
    def mean_torsion(self) -> float:
        """τ̄ [1 / length], 0 in the plane."""
        return 0.0 if self.torsions is None else sum(self.torsions) / self.n_actions

    @cached_property
    def mean_turning(self) -> float:
        """w̄ = √(κ̄² + τ̄²), how much a path turns per length, κ̄ in the plane [1 / length]."""
        return math.hypot(self.mean_curvature, self.mean_torsion)

    def torsion(self, state: Any) -> Array:
        """Torsion (..., cells) of the interval that ended now, 0 in the plane [1 / length]."""
        like = state.memory[..., 0, 1]
        if self.torsions is None:
            return namespace(like).zeros_like(like)
        return look_up(as_array(np.asarray(self.torsions), like), self.last_action(state))

    def curvature(self, state: Any) -> Array:
        """Curvature (..., cells) used during the interval that ended now [1 / length]."""
        contrast = 0.5 * (self.curvatures[-1] - self.curvatures[0])
        return state.memory[..., 0, 1] * contrast + self.mean_curvature

    def last_action(self, state: Any) -> Array:
        """The action (..., cells) of the interval that ended now, from its κ*."""
        if self.is_continuous:
            return self.curvature(state)
        xp = namespace(state.memory)
        normal = state.memory[..., 0, 1]
        return xp.astype(xp.round((normal + 1) * (0.5 * (self.n_actions - 1))), xp.int32)

    def action_of(self, number: Array, like: Array) -> Array:
        """The action (..., cells) that takes curvature κ_number; curvatures are of the kind of `like`."""
        if not self.is_continuous:
            return number
        return look_up(as_array(np.asarray(self.curvatures), like), number)

    def curvature_of(self, action: Array, like: Array) -> Array:
        """Curvature (..., cells) of an action, of the kind of `like` [1 / length]."""
        return action if self.is_continuous else look_up(as_array(np.asarray(self.curvatures), like), action)

    @cached_property
    def response_sign(self) -> int:
        """1 where cells climb by bending their path more where they sense more, −1 where by bending it less.

        The former holds in the plane, whose circles then move up the gradient. In space the axis of a helix
        turns up the gradient where the path is more stretched, by τ/κ in the sense of τ̄, the more is sensed:
        the sign is that of τ̄ (κ̄τ′ − τ̄κ′), κ′ and τ′ from the first action to the last.
        """
        if self.torsions is None:
            return 1
        stretched = [tau / kappa for kappa, tau in zip(self.curvatures, self.torsions, strict=True)]
        return -1 if self.mean_torsion * (stretched[-1] - stretched[0]) < 0 else 1

    def ends(self, like: Array) -> tuple[Array, Array]:
        """The actions (..., cells) that take κ₁ and κ_m."""
        low, high = (
            (self.curvatures[0], self.curvatures[-1]) if self.is_continuous else (0, self.n_actions - 1)
        )
        return namespace(like).full_like(like, low), namespace(like).full_like(like, high)

    def is_action(self, values: Array) -> Array:
        """Whether values (...) of the right kind are actions."""
        low, high = self.action_range or (0, self.n_actions - 1)
        slack = SLACK * self.largest_curvature if self.is_continuous else 0
        return (values >= low - slack) & (values <= high + slack)
