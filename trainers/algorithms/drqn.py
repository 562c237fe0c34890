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

from trainers.algorithms.dqn import DQN, EpsilonGreedy, of_values, returns
from trainers.algorithms.networks import RecurrentMLP, memory_of
from trainers.algorithms.replay import SeedReplay
from trainers.settings.learning import DRQNSettings
from trainers.settings.schema import Settings

PARTS: tuple[Any, ...] = (("next", "reward"), "steps_to_next_obs", ("next", "terminated"))  # (..., 1)
BARE: tuple[Any, ...] = ("action", ("collector", "mask"))  # (...)


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


class SequenceReplay(SeedReplay):
    """Keeps sequences of at most `steps` decisions, with the hidden state (nodes) before the first one."""

    def __init__(self, size: int, sizes: tuple[int, int, int], generators: list[torch.Generator]) -> None:
        self.steps, inputs, self.nodes = sizes
        super().__init__(size, inputs, generators)

    @property
    def width(self) -> int:
        """Numbers in a row."""
        return self.nodes + (self.steps + 1) * self.inputs + (len(PARTS) + len(BARE)) * self.steps

    def pack(self, transitions: Mapping[Any, Tensor]) -> Tensor:
        """A row (1, seeds, cells, width) of every cell's decisions (decisions, seeds, cells); where there are
        fewer than `steps`, the rest was not alive.
        """

        def filled(part: Tensor, length: int) -> Tensor:
            missing = part.new_zeros(length - len(part), *part.shape[1:])
            return torch.cat([part, missing]).permute(1, 2, 0, 3).flatten(2).float()

        columns = [transitions[key] for key in PARTS] + [transitions[key].unsqueeze(-1) for key in BARE]
        seen = filled(transitions["seen"], self.steps + 1)
        rest = [filled(each, self.steps) for each in columns]
        return torch.cat([transitions["hidden"], seen, *rest], dim=-1).unsqueeze(0)

    def unpack(self, rows: Tensor) -> dict[Any, Tensor]:
        """The sequences (..., steps) that were packed in rows (..., width)."""
        count = len(PARTS) + len(BARE)
        sizes = self.nodes, (self.steps + 1) * self.inputs, *(self.steps,) * count
        hidden, seen, *rest = rows.split(sizes, dim=-1)
        found = dict(zip((*PARTS, *BARE), rest, strict=True))
        found |= {key: found[key].unsqueeze(-1) for key in PARTS}
        found |= {key: found[key].bool() for key in (PARTS[-1], BARE[-1])}
        found |= {"action": found["action"].long(), "hidden": hidden}
        return found | {"seen": seen.unflatten(-1, (-1, self.inputs))}


def sizes_of(settings: Settings) -> tuple[int, ...]:
    """Of the inputs, the recurrent layer, the hidden ones and the outputs."""
    learning, world = cast(DRQNSettings, settings.learning), settings.training_world()
    if learning.seen > world.n_records:
        rule = f"learning.seen must be at most world.n_records, {world.n_records}"
        raise ValueError(f"{rule}, got {learning.seen}")
    return (learning.seen * world.features, learning.nodes, *learning.hidden, world.n_actions)


def decisions_of(settings: Settings) -> int:
    """Decisions that a sequence is learnt from."""
    return settings.learning.collect or settings.training_world().max_decisions


class DRQN(DQN):
    """Decides for every cell by what it has seen so far, and learns from parts of lives."""

    settings: DRQNSettings
    explorers, error = RecurrentEpsilonGreedy, staticmethod(sequence_error)
    worth_compiling = math.inf  # step by step, it takes minutes
    kept = (*DQN.kept, "hidden")
    explorer: RecurrentEpsilonGreedy
    policy: RecurrentMLP

    @staticmethod
    def memory_needed(settings: Settings) -> int:
        learning, (inputs, nodes, *_) = cast(DRQNSettings, settings.learning), sizes_of(settings)
        decisions = decisions_of(settings)
        width = nodes + (learning.burn_in + decisions) * (inputs + len(PARTS) + len(BARE))
        rows = 2 * learning.buffer_size + learning.updates * learning.batch_size
        return 4 * rows * width // decisions + memory_of(sizes_of(settings), learning.batch_size)

    def network(self, settings: Settings) -> RecurrentMLP:
        sizes, features = sizes_of(settings), self.env.world.features
        return RecurrentMLP(sizes, features, [self.keys("network"), self.keys("network", 1)], self.env.device)

    def replay(self, settings: Settings) -> SeedReplay:
        learning, network, decisions = self.settings, self.policy, decisions_of(settings)
        self.rows = max(1, learning.batch_size // decisions)
        sizes = learning.burn_in + decisions, network.inputs, network.nodes
        return SequenceReplay(max(1, learning.buffer_size // decisions), sizes, self.draws)

    def begin(self, epoch: int) -> None:
        super().begin(epoch)
        cells = len(self.env.seeds), self.collector.cells, self.policy.nodes
        self.explorer.hidden = torch.zeros(cells, device=self.env.device)

    def remember(self, rollout: TensorDict) -> bool:
        """Put the decisions, behind those that bring the hidden state up to date, into the buffer."""
        window, old = {key: rollout[key] for key in self.kept}, 0
        if self.waiting:
            old = len(self.waiting["action"])
            window = {key: torch.cat([self.waiting[key], now]) for key, now in window.items()}
        burn_in = self.settings.burn_in
        self.waiting = {key: now[-burn_in:] for key, now in window.items()} if burn_in else {}
        rows = returns(window, self.settings.discount, self.settings.n_steps)
        alive = rows["collector", "mask"].clone()
        alive[:old] = False
        observation = torch.cat([window["observation"], window["next", "observation"][-1:]])
        whole = {
            **rows,
            ("collector", "mask"): alive,
            "hidden": window["hidden"][0],
            "seen": self.policy.seen(observation),
        }
        self.buffer.extend(whole)
        return True
