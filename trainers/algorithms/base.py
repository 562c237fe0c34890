"""The seam between the training loop and an algorithm: what the loop needs, and nothing more."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from typing import ClassVar

import torch
from tensordict import TensorDict
from torch import Tensor, nn
from torch.optim import Adam

from swarm.envs.torchrl import SwarmEnv
from trainers.settings.schema import Settings


class Algorithm(ABC):
    """Learns to steer the cells of an environment whose worlds are shared out among independent seeds.

    The loop restarts the environment, calls `begin`, then `collect` and `learn` in turns until all lives have
    ended. Whatever is random is drawn from streams that are named by seed, epoch and decision; `tensors` and
    `counters` are all that an epoch hands to the next.
    """

    metrics: ClassVar[tuple[str, ...]]  # names of what `learn` measures: columns of metrics.csv
    env: SwarmEnv
    policy: (
        nn.Module
    )  # (seeds, rows, inputs) -> (seeds, rows, actions), the largest number is the best action
    updates = 0  # so far

    @abstractmethod
    def __init__(self, env: SwarmEnv, settings: Settings) -> None: ...

    @staticmethod
    @abstractmethod
    def memory_needed(settings: Settings) -> int:
        """Bytes that one seed works with beside its cells, roughly, and rather too few than too many."""

    @abstractmethod
    def begin(self, epoch: int) -> None:
        """Get ready for epoch number `epoch`, from 0 on, whose lives have begun."""

    @abstractmethod
    def collect(self, progress: float) -> TensorDict:
        """Some decisions of every cell, as `SeedCollector` gives them; `progress` is the part of all epochs
        that is over.
        """

    @abstractmethod
    def learn(self, rollout: TensorDict, progress: float) -> dict[str, Tensor | float] | None:
        """Learn from what was collected; one of each of `metrics`, (seeds,) or the same for all.

        None where there was nothing to learn from yet.
        """

    @abstractmethod
    def tensors(self) -> dict[str, Tensor]:
        """What is carried from one epoch to the next, by name, none of it copied."""

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


def worth_compiling(settings: Settings, amount: float, pays_from: float) -> bool:
    """Whether to compile what is done `amount` times in a run, and pays from so many times on."""
    return settings.compile == "always" or (settings.compile == "auto" and amount >= pays_from)


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


def optimiser_tensors(optimiser: Adam) -> dict[str, Tensor]:
    """The state of an optimiser by name, none of it copied."""
    states = (optimiser.state[parameter] for parameter in optimiser.param_groups[0]["params"])
    return {
        f"optimiser.{place}.{name}": tensor
        for place, state in enumerate(states)
        for name, tensor in state.items()
    }
