"""Deep recurrent Q-learning (Hausknecht and Stone 2015): what a cell remembers is learnt, too.

A GRU is shown the newest records alone, and trained through time on sequences that begin with the hidden
state the cell had then, and with decisions that only bring it up to date (R2D2, Kapturowski et al. 2019).
"""

import math
from collections.abc import Callable, Mapping
from typing import Any, cast

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from trainers.algorithms.dqn import DQN, EpsilonGreedy, of_values
from trainers.algorithms.networks import RecurrentMLP
from trainers.algorithms.replay import Layout, returns, transitions
from trainers.settings.learning import DRQNSettings
from trainers.settings.schema import Settings


class RecurrentEpsilonGreedy(EpsilonGreedy):
    """`EpsilonGreedy` of a network with a hidden state, which it writes as it was before the decision."""

    out_keys = ["action", "hidden"]

    network: RecurrentMLP
    hidden: Tensor  # (seeds, cells, nodes)

    def values(self, tensordict: TensorDictBase) -> Tensor:
        tensordict.set("hidden", self.hidden)
        values, self.hidden = self.network.step(tensordict["observation"], self.hidden)
        return values


def sequence_error(
    online: Callable, target: Callable, batch: Mapping, *, gamma: float, double: bool, loss_function: str
) -> tuple[Tensor, Tensor]:
    """`q_error` of a batch of sequences (seeds, rows, steps), through which both networks run from the same
    hidden state (seeds, rows, nodes); of `seen` (seeds, rows, steps + 1, inputs) there is one more.
    """
    seen = batch["seen"].transpose(1, 2)
    values = online(seen, batch["hidden"])[0].transpose(1, 2)
    with torch.no_grad():
        others = target(seen, batch["hidden"])[0].transpose(1, 2)
        best = others.gather(-1, (values if double else others).argmax(-1, keepdim=True))
        steps = batch["steps_to_next_obs"].long()
        first = torch.arange(steps.shape[-2], device=steps.device)[:, None]
        following = best.gather(-2, first + steps)
    return of_values(values[..., :-1, :], following, batch, gamma, loss_function)


class DRQN(DQN):
    """Decides for every cell by what it has seen so far, and learns from parts of lives."""

    settings: DRQNSettings
    explorers, error = RecurrentEpsilonGreedy, staticmethod(sequence_error)
    worth_compiling = math.inf  # step by step, it takes minutes
    explorer: RecurrentEpsilonGreedy
    policy: RecurrentMLP

    @staticmethod
    def design(settings: Settings) -> tuple[tuple[int, ...], Layout, int]:
        """Sizes of the inputs, the recurrent layer, the hidden ones and the outputs; a row of the buffer is a
        sequence, with the hidden state (nodes,) before it.
        """
        learning, world = cast(DRQNSettings, settings.learning), settings.training_world()
        if learning.seen > world.n_records:
            rule = f"learning.seen must be at most world.n_records, {world.n_records}"
            raise ValueError(f"{rule}, got {learning.seen}")
        inputs, nodes = learning.seen * world.features, learning.nodes
        length = learning.collect or world.max_decisions
        steps = learning.burn_in + length
        layout: dict[Any, Any] = {
            "hidden": ((nodes,), torch.float32),
            "seen": ((steps + 1, inputs), torch.float32),
        }
        for key, (shape, dtype) in transitions(inputs).items():
            if "observation" not in key:
                layout[key] = ((steps, *shape), dtype)
        return (inputs, nodes, *learning.hidden, world.n_actions), layout, length

    def network(self, sizes: tuple[int, ...]) -> RecurrentMLP:
        keys = [self.keys("network"), self.keys("network", 1)]
        return RecurrentMLP(sizes, self.env.world.features, keys, self.env.device)

    def begin(self, epoch: int) -> None:
        super().begin(epoch)
        cells = len(self.env.seeds), self.collector.cells, self.policy.nodes
        self.explorer.hidden = torch.zeros(cells, device=self.env.device)

    def remember(self, rollout: TensorDict) -> bool:
        """Put the decisions, behind those that bring the hidden state up to date, into the buffer."""
        window, burn_in = self.window(rollout), self.settings.burn_in
        old = len(window["action"]) - len(rollout)
        self.waiting = {key: now[-burn_in:] for key, now in window.items()} if burn_in else {}
        rows = returns(window, self.settings.discount, self.settings.n_steps)
        rows["collector", "mask"] = rows["collector", "mask"].clone()
        rows["collector", "mask"][:old] = False
        seen = torch.cat([window["observation"], window["next", "observation"][-1:]])
        rows |= {"hidden": window["hidden"][:1], "seen": self.policy.seen(seen)}
        for key, (shape, _) in self.buffer.layout.items():
            if key != "hidden":  # where decisions are missing, the cell was not alive
                rest = rows[key].new_zeros(shape[0] - len(rows[key]), *rows[key].shape[1:])
                rows[key] = torch.cat([rows[key], rest]).movedim(0, 2).unsqueeze(0)
        self.buffer.extend(rows, 1)
        return True
