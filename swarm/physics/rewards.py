"""Rewards: what a decision is worth to a cell, from the states before and after it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias, runtime_checkable

from swarm._support.arrays import namespace
from swarm._support.checks import check_rule
from swarm._support.registry import Registry

Array = Any
World: TypeAlias = Any  # these are of `swarm.physics.world`
State: TypeAlias = Any
Outcome: TypeAlias = Any

REWARDS = Registry("reward", "chemoswarm.rewards")


@runtime_checkable
class Reward(Protocol):
    """What the world asks of a reward.

    Used when there: `check(world)`, which raises ValueError where the reward does not fit a world.
    """

    def reward(self, world: World, before: State, after: State, outcome: Outcome) -> Array:
        """The rewards (..., cells) of the decision that led from one state to the other.

        The outcome's own `reward` is not known yet: it is None. What cells get whose life was over before is
        left out by whoever shows them rewards.
        """
        ...


@REWARDS.register("own")
@dataclass(frozen=True)
class Own:
    """The change of the mean concentration in the cell's own memory, normalised (paper: reward)."""

    def reward(self, world: World, before: State, after: State, outcome: Outcome) -> Array:
        """The newest minus the oldest record, over N_T |1/κ₁ − 1/κ_m|."""
        return (after.memory[..., 0, 0] - before.memory[..., -1, 0]) * world.reward_scale


@REWARDS.register("team")
@dataclass(frozen=True)
class Team(Own):
    """What the cells of a world that lived until the decision get by themselves, shared out evenly."""

    def reward(self, world: World, before: State, after: State, outcome: Outcome) -> Array:
        """The mean of their own rewards, the same (..., cells) for all; 0 where nobody lived."""
        own = super().reward(world, before, after, outcome)
        xp, nothing = namespace(own), own - own
        total = xp.sum(xp.where(before.finished, nothing, own), axis=-1, keepdims=True)
        living = xp.sum(xp.where(before.finished, nothing, nothing + 1), axis=-1, keepdims=True)
        return total / xp.where(living > 0, living, living + 1) + nothing


@REWARDS.register("arrival")
@dataclass(frozen=True)
class Arrival:
    """1 for a winner of the race, at the decision in which it arrives in time; else 0."""

    def check(self, world: World) -> None:
        """Raises ValueError where nobody races."""
        rule = "reward 'arrival' must go with first_arrivals"
        check_rule(world.first_arrivals is not None, rule, "a world without a race")

    def reward(self, world: World, before: State, after: State, outcome: Outcome) -> Array:
        """Who has won now and had not before: later arrivals never take a win away."""
        xp = namespace(after.position)
        return xp.astype(world.won(after) & ~world.won(before), after.position.dtype)


@REWARDS.register("eaten")
@dataclass(frozen=True)
class Eaten:
    """What a cell eats in a decision, over k ΔT c_k/κ̄, in which k is the uptake.

    That is the mean concentration on its way, as records hold it.
    """

    def check(self, world: World) -> None:
        """Raises ValueError where nobody eats."""
        eats = world.medium is not None and world.medium.uptake > 0
        check_rule(eats, "reward 'eaten' must go with a medium with uptake", f"medium={world.medium!r}")

    def reward(self, world: World, before: State, after: State, outcome: Outcome) -> Array:
        """The amounts eaten since, by the whole ΔT also in the last decision, which may be shorter."""
        scale = world.record_scale / (world.medium.uptake * world.intervals[0])
        return (after.medium.eaten - before.medium.eaten) * scale


def check_reward(name: str, value: Any) -> Reward:
    """The reward that `value` is or describes; raises TypeError or ValueError unless it can be asked for."""
    reward = REWARDS.make(value)
    if isinstance(reward, type) or not isinstance(reward, Reward):
        rule = f"{name} must be an object with reward(world, before, after, outcome)"
        raise TypeError(f"{rule}, or one of {', '.join(sorted(REWARDS))}, got {reward!r}")
    return reward
