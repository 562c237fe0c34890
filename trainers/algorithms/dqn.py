"""Deep Q-learning (paper: DQN), made of TorchRL's parts, for a stack of independent seeds.

Where a stock class takes more than twice the time of what it does, a lean one stands for it, which a test
holds equal to it: `SeedDQNLoss` for DQNLoss, `returns` for MultiStep, `EpsilonGreedy` for QValueActor with
EGreedyModule, `FusedSoftUpdate` for SoftUpdate.
"""

import copy
import functools
import math
from collections.abc import Callable, Mapping
from typing import Any, cast

import torch
from tensordict import TensorDict, TensorDictBase, TensorDictParams
from tensordict.nn import TensorDictModuleBase
from torch import Tensor, nn
from torchrl.objectives import LossModule, SoftUpdate
from torchrl.objectives.utils import distance_loss

from swarm.envs.torchrl import SwarmEnv
from trainers.algorithms.base import (
    Algorithm,
    fused_adam,
    held_by,
    learning_rate_at,
    living_mean,
    worth_compiling,
)
from trainers.algorithms.collector import SeedCollector
from trainers.algorithms.compiled import CompiledUpdate
from trainers.algorithms.networks import memory_of, seed_mlp
from trainers.algorithms.replay import REACHED, Layout, SeedReplay, returns, transitions, width
from trainers.settings.learning import DQNSettings
from trainers.settings.schema import Settings

LOSSES = {"squared": "l2", "huber": "smooth_l1"}  # in TorchRL's words


class EpsilonGreedy(TensorDictModuleBase):
    """With probability ε a random action, else the best (paper: ε-greedy).

    EGreedyModule draws from torch's global generator; here the numbers are drawn outside.
    """

    in_keys = ["observation", "uniform"]
    out_keys = ["action"]

    def __init__(self, network: nn.Module, n_actions: int) -> None:
        super().__init__()
        self.network, self.n_actions, self.epsilon = network, n_actions, 1.0

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        best = self.values(tensordict).argmax(-1)
        coin, choice = tensordict["uniform"].unbind(-1)
        random = (choice * self.n_actions).long()
        return tensordict.set("action", torch.where(coin < self.epsilon, random, best))

    def values(self, tensordict: TensorDictBase) -> Tensor:
        return self.network(tensordict["observation"])


def epsilon_at(settings: DQNSettings, epoch: int, progress: float) -> float:
    """ε in an epoch (from 0); `progress` is the part of all epochs that is over."""
    if settings.epsilon_schedule == "exponential":
        return max(settings.epsilon_end, settings.epsilon_start * settings.epsilon_decay**epoch)
    fallen = min(1.0, progress / settings.epsilon_fraction)
    return settings.epsilon_start + (settings.epsilon_end - settings.epsilon_start) * fallen


def q_error(
    online: Callable, target: Callable, batch: Mapping, *, gamma: float, double: bool, loss_function: str
) -> tuple[Tensor, Tensor]:
    """Loss (seeds,) of a batch (seeds, rows) in the keys that DQNLoss reads, and the values (seeds, rows, 1)
    of what was done.

    With `double`, the online network chooses the next action and the target network values it (van Hasselt et
    al. 2016). Rows of cells that were not alive count for nothing.
    """
    following = batch["next", "observation"]
    with torch.no_grad():
        values = target(following)
        chooser = online(following) if double else values
        best = values.gather(-1, chooser.argmax(-1, keepdim=True))
    return of_values(online(batch["observation"]), best, batch, gamma, loss_function)


def of_values(
    values: Tensor, best: Tensor, batch: Mapping, gamma: float, loss_function: str
) -> tuple[Tensor, Tensor]:
    """`q_error` of the values (seeds, ..., actions) of what was seen, and the best (seeds, ..., 1) next."""
    with torch.no_grad():
        discount = gamma ** batch["steps_to_next_obs"] * ~batch["next", "terminated"]
        goal = torch.addcmul(batch["next", "reward"], discount, best)
    chosen = values.gather(-1, batch["action"].unsqueeze(-1))
    return living_mean(distance_loss(chosen, goal, loss_function), batch), chosen


class SeedDQNLoss(LossModule):
    """`torchrl.objectives.DQNLoss` for each of a leading axis of seeds."""

    in_keys = [*transitions(0)]
    out_keys = ["loss", "chosen_action_value"]

    value_network: nn.Module
    value_network_params: TensorDictParams
    target_value_network_params: TensorDictParams

    def __init__(self, network: nn.Module, *, delay_value: bool, error: Callable, **options: Any) -> None:
        super().__init__()
        self.error: Callable = functools.partial(error, **options)
        self.convert_to_functional(network, "value_network", create_target_params=delay_value)
        self.__dict__["target_network"] = target = copy.deepcopy(network) if delay_value else network
        if delay_value:
            self._modules["target_value_network_params"].to_module(target)

    def measured(self, batch: Mapping) -> tuple[Tensor, Tensor]:
        """Loss (seeds,) and values (seeds, rows, 1), without a TensorDict."""
        return self.error(self.value_network, self.target_network, batch)

    def forward(self, batch: Mapping) -> TensorDict:
        loss, chosen = self.measured(batch)
        means = {"loss": loss, "chosen_action_value": living_mean(chosen.detach(), batch)}
        return TensorDict(means, loss.shape)


class FusedSoftUpdate(SoftUpdate):
    """SoftUpdate of all tensors in one call."""

    def init_(self) -> None:
        super().init_()
        both = (self._targets.data, self._sources.data)
        self._old, self._new = (list(each.values(include_nested=True, leaves_only=True)) for each in both)

    def step(self) -> None:
        torch._foreach_lerp_(self._old, self._new, 1 - self.eps)


class DQN(Algorithm):
    """Decides for every cell, remembers what came of it, and learns from random parts of that."""

    metrics = ("loss", "q_mean", "epsilon", "learning_rate")
    settings: DQNSettings
    explorers, error = EpsilonGreedy, staticmethod(q_error)
    worth_compiling: float = 30_000  # updates, from which compiling one saves more time than it takes

    def __init__(self, env: SwarmEnv, settings: Settings) -> None:
        if env.world.is_continuous:
            rule = "world.action must be 'discrete' where dqn learns, which values each action"
            raise ValueError(f"{rule}, got 'continuous'")
        learning, (sizes, layout, length) = cast(DQNSettings, settings.learning), self.design(settings)
        self.env, self.settings = env, learning
        self.policy = self.network(sizes)
        self.explorer = self.explorers(self.policy, env.world.n_actions)
        self.collector = SeedCollector(env, self.explorer)
        delayed = learning.target_rate < 1
        self.loss = SeedDQNLoss(
            self.policy,
            delay_value=delayed,
            error=self.error,
            gamma=learning.discount,
            double=learning.double and delayed,
            loss_function=LOSSES[learning.loss],
        )
        self.follow = FusedSoftUpdate(self.loss, tau=learning.target_rate) if delayed else None
        self.optimiser = fused_adam(self.policy.parameters())
        self.rows = max(1, learning.batch_size // length)  # of the buffer in a batch
        self.buffer = SeedReplay(max(1, learning.buffer_size // length), layout, len(env.seeds), env.device)
        self.update: Callable[[Mapping], tuple[Tensor, Tensor]] = self._update
        decisions = env.world.max_decisions
        rounds = learning.epochs * math.ceil(decisions / (learning.collect or decisions))
        if worth_compiling(settings, rounds * learning.updates, self.worth_compiling):
            self.update = CompiledUpdate(self.loss, self.optimiser, learning.target_rate)

    @staticmethod
    def design(settings: Settings) -> tuple[tuple[int, ...], Layout, int]:
        """Sizes of the network's layers, what a row of the buffer holds, and of how many decisions it is."""
        return settings.layers, transitions(settings.layers[0]), 1

    def network(self, sizes: tuple[int, ...]) -> nn.Module:
        """A fresh one of every seed."""
        return seed_mlp(sizes, self.keys("network"), self.env.device)

    @classmethod
    def memory_needed(cls, settings: Settings) -> int:
        learning, (sizes, layout, length) = cast(DQNSettings, settings.learning), cls.design(settings)
        rows = 2 * learning.buffer_size + learning.updates * learning.batch_size  # a checkpoint's, too
        return 4 * rows * width(layout) // length + memory_of(sizes, learning.batch_size)

    def _update(self, batch: Mapping) -> tuple[Tensor, Tensor]:
        """One step of the optimiser; what `q_error` says of the batch."""
        loss, chosen = self.loss.measured(batch)
        self.optimiser.zero_grad()
        loss.sum().backward()
        self.optimiser.step()
        if self.follow is not None:
            self.follow.step()
        return loss.detach(), chosen.detach()

    def begin(self, epoch: int) -> None:
        super().begin(epoch)
        self.waiting = dict[Any, Tensor]()

    def collect(self, progress: float) -> TensorDict:
        self.explorer.epsilon = epsilon_at(self.settings, self.epoch, progress)
        return super().collect(progress)

    def window(self, rollout: TensorDict) -> dict[Any, Tensor]:
        """What has waited, and what was collected now (decisions, ...)."""
        keys = "observation", *self.explorer.out_keys, ("collector", "mask"), *(("next", n) for n in REACHED)
        now = {key: rollout[key] for key in keys}
        return {key: torch.cat([self.waiting[key], now[key]]) for key in keys} if self.waiting else now

    def remember(self, rollout: TensorDict) -> bool:
        """Put what is complete into the buffer; whether anything was.

        The last decisions wait for the rewards of the next ones, unless all lives have ended.
        """
        window = self.window(rollout)
        decisions = len(window["action"])
        complete = decisions if self.env.all_finished() else max(0, decisions - self.settings.n_steps + 1)
        self.waiting = {key: now[complete:] for key, now in window.items()}
        if complete:
            self.buffer.extend(returns(window, self.settings.discount, self.settings.n_steps), complete)
        return complete > 0

    def learn(self, rollout: TensorDict, progress: float) -> dict[str, Tensor | float] | None:
        """One round of updates."""
        if not self.remember(rollout):
            return None
        for batch in self.buffer.batches(self.settings.updates, self.rows, self.draws):
            rate = learning_rate_at(self.settings, self.updates, progress)
            self.optimiser.param_groups[0]["lr"] = rate
            loss, chosen = self.update(batch)
            self.updates += 1
        means: dict[str, Tensor | float] = {"loss": loss, "q_mean": living_mean(chosen, batch)}
        return means | {"epsilon": self.explorer.epsilon, "learning_rate": rate}

    def tensors(self) -> dict[str, Tensor]:
        return held_by(self.optimiser, loss=self.loss) | {"buffer": self.buffer.rows}

    def counters(self) -> dict[str, int]:
        return super().counters() | {"cursor": self.buffer.cursor}

    def growing(self) -> dict[str, int]:
        return {"buffer": self.buffer.size}

    def restore(self, tensors: Mapping[str, Tensor], counters: Mapping[str, int]) -> None:
        self.buffer.refill(tensors["buffer"], counters["cursor"], self.env.world.n_actions)
        super().restore(tensors, counters)
