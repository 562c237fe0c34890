"""The seam between the training loop and an algorithm: what the loop needs, and nothing more."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from pkgutil import resolve_name
from typing import Any, ClassVar

import torch
from tensordict import TensorDict
from torch import Tensor, nn
from torch.optim import Adam

from swarm._support import streams
from swarm.envs.torchrl import SwarmEnv
from trainers.algorithms.collector import SeedCollector
from trainers.algorithms.networks import memory_of
from trainers.settings.learning import LearningSettings
from trainers.settings.schema import Settings


class Algorithm(ABC):
    """Learns to steer the cells of an environment whose worlds are shared out among independent seeds.

    The loop restarts the environment, calls `begin`, then `collect` and `learn` in turns until all lives have
    ended. Whatever is random is drawn from streams that are named by seed, epoch and decision; `tensors` and
    `counters` are all that an epoch hands to the next.
    """

    metrics: ClassVar[tuple[str, ...]]  # names of what `learn` measures: columns of metrics.csv
    env: SwarmEnv
    settings: LearningSettings
    collector: SeedCollector
    optimiser: Adam
    policy: nn.Module  # (seeds, rows, inputs) -> (seeds, rows, actions): the best has the largest number
    updates = 0  # so far
    epoch: int
    draws: list[torch.Generator]  # of each seed, for what it draws in this epoch

    @abstractmethod
    def __init__(self, env: SwarmEnv, settings: Settings) -> None: ...

    @staticmethod
    def memory_needed(settings: Settings) -> int:
        """Bytes that one seed works with beside its cells, roughly, and rather too few than too many."""
        return memory_of(settings.layers, settings.learning.batch_size)

    def keys(self, purpose: streams.Purpose, *index: int) -> list[int]:
        """For each seed that of a generator of its own."""
        return [streams.integer_seed("training", purpose, seed, *index) for seed in self.env.seeds]

    def begin(self, epoch: int) -> None:
        """Get ready for epoch number `epoch`, from 0 on, whose lives have begun."""
        self.epoch, device = epoch, self.env.device or "cpu"
        self.draws = [torch.Generator(device).manual_seed(key) for key in self.keys("replay", epoch)]

    def collect(self, progress: float) -> TensorDict:
        """Some decisions of every cell, as `SeedCollector` gives them; `progress` is the part of all epochs
        that is over.
        """
        return self.collector.collect(self.settings.collect or self.env.world.max_decisions)

    @abstractmethod
    def learn(self, rollout: TensorDict, progress: float) -> dict[str, Tensor | float] | None:
        """Learn from what was collected; one of each of `metrics`, (seeds,) or the same for all.

        None where there was nothing to learn from yet.
        """

    def tensors(self) -> dict[str, Tensor]:
        """What is carried from one epoch to the next, by name, none of it copied."""
        return held_by(self.optimiser, policy=self.policy)

    def counters(self) -> dict[str, int]:
        """The whole numbers that are carried from one epoch to the next."""
        return {"updates": self.updates}

    def growing(self) -> dict[str, int]:
        """The tensors whose first axis grows, by name, and the length that it has at most."""
        return {}

    @torch.no_grad()
    def restore(self, tensors: Mapping[str, Tensor], counters: Mapping[str, int]) -> None:
        """Go on from what `tensors` and `counters` gave, whose shapes are right.

        Raises ValueError where their contents are not.
        """
        growing = self.growing()
        for name, tensor in self.tensors().items():
            if name not in growing:
                tensor.copy_(tensors[name])
        self.updates = counters["updates"]


def learner_of(settings: Settings) -> type[Algorithm]:
    """What learns with these settings; raises ValueError where that is no algorithm."""
    named = settings.learning.learner
    learner = resolve_name(named) if isinstance(named, str) else named
    if not (isinstance(learner, type) and issubclass(learner, Algorithm)):
        raise ValueError(f"algorithm {settings.algorithm!r} must have an Algorithm as learner, got {named!r}")
    return learner


def learning_rate_at(settings: LearningSettings, updates: int, progress: float) -> float:
    """Learning rate after `updates` updates; `progress` is the part of all epochs that is over."""
    if settings.learning_rate_schedule == "inverse_time":
        return settings.learning_rate / (1 + settings.learning_rate_decay * updates)
    return settings.learning_rate * (1 + (settings.learning_rate_end - 1) * progress)


def worth_compiling(settings: Settings, amount: float, pays_from: float) -> bool:
    """Whether to compile what is done `amount` times in a run, and pays from so many times on."""
    return settings.compile == "always" or (settings.compile == "auto" and amount >= pays_from)


def living_mean(each: Tensor, batch: Mapping) -> Tensor:
    """The mean (seeds,) of numbers (seeds, ...) over the cells of a batch (seeds, ...) that were alive."""
    alive = batch["collector", "mask"].flatten(1)
    return torch.where(alive, each.flatten(1), 0.0).sum(-1) / alive.sum(-1).clamp_min(1)


def fused_adam(parameters: Iterable[nn.Parameter]) -> Adam:
    """Torch's Adam (Kingma and Ba 2015), whose state is there from the beginning."""
    optimiser = Adam(parameters, fused=True)
    for parameter in optimiser.param_groups[0]["params"]:
        optimiser.state[parameter] = {
            "step": torch.zeros((), device=parameter.device),
            "exp_avg": torch.zeros_like(parameter),
            "exp_avg_sq": torch.zeros_like(parameter),
        }
    return optimiser


def held_by(optimiser: Adam | None = None, **modules: nn.Module) -> dict[str, Tensor]:
    """The tensors of modules and of an optimiser by name, none of them copied."""
    parts: dict[str, Any] = {name: module.state_dict(keep_vars=True) for name, module in modules.items()}
    if optimiser is not None:
        parameters = optimiser.param_groups[0]["params"]
        parts |= {f"optimiser.{place}": optimiser.state[each] for place, each in enumerate(parameters)}
    return {f"{part}.{name}": tensor for part, held in parts.items() for name, tensor in held.items()}
